! SPDX-License-Identifier: BSD-3-Clause
!> Run loop of the standalone program: all boulders of a scene, in chunks.
module rockfall_run_loop
   use rockfall_kinds, only: wp, i8
   use rockfall_error, only: error_t, fail, our_fault
   use rockfall_text, only: integer_text
   use rockfall_scene_type, only: scene_t
   use rockfall_outcome, only: boulder_result_t
   use rockfall_scratch, only: scratch_t
   use rockfall_map_overflow, only: check_overflow
   use rockfall_variables, only: vertex_fields
   use rockfall_rows, only: vertex_row
   use rockfall_threads, only: team_size
   use rockfall_ensemble, only: trace_boulder, recorded_boulders
   use rockfall_shares, only: proportional_part
   use rockfall_case, only: case_t
   use rockfall_grid, only: grid_t
   use rockfall_terrain, only: set_window
   use rockfall_reach, only: block_side, update_block_minima, reach_box
   use rockfall_run_state, only: run_t, open_run, advance, plan_of
   use rockfall_bounds, only: check_sources, boulder_count, max_volumes, max_tree_hits
   use rockfall_scene, only: object_reach
   implicit none
   private
   public :: run_observer_t, run_case, scan_terrain, save_rest, first_chunk, chunk_crossings

   integer(i8), parameter :: first_chunk = 16     !! boulders in the first call
   real(wp), parameter :: chunk_seconds = 1.0_wp  !! duration of a call; threads wait for each other at its end

   !> Approximate maximum number of line crossings in a call; all are in memory, with 170 bytes each.
   integer(i8), parameter :: chunk_crossings = 250000

   !> Minimum time between saves of a run, as a multiple of the duration of the last save.
   real(wp), parameter :: save_rest = 20.0_wp

   !> Observer of a run; it may restore a part of the run before the first chunk.
   type, abstract :: run_observer_t
   contains
      procedure(see_run), deferred :: on_start  !! before the first chunk
      procedure(see_run), deferred :: on_chunk  !! before each chunk; an error stops the run
   end type run_observer_t

   abstract interface
      subroutine see_run(this, run, error)
         import :: run_observer_t, run_t, error_t
         class(run_observer_t), intent(inout) :: this
         type(run_t), intent(inout), target :: run
         type(error_t), allocatable, intent(out) :: error
      end subroutine see_run
   end interface

contains

   !> Run all boulders of the case, or range shard(1) of shard(2) ranges, whose sizes differ by at most one boulder. A
   !> run whose results do not fit in memory is refused.
   subroutine run_case(case, grid, scene, shard, observer, run, error)
      type(case_t), intent(in) :: case
      type(grid_t), intent(in) :: grid  !! grid of the terrain
      type(scene_t), intent(inout) :: scene
      integer(i8), intent(in) :: shard(2)
      class(run_observer_t), intent(inout) :: observer
      type(run_t), intent(out), target :: run
      type(error_t), allocatable, intent(out) :: error
      integer(i8) :: total, before
      integer :: window(4)

      total = boulder_count(scene)
      if (shard(2) > max(1_i8, total)) then
         call fail(error, "--shard "//integer_text(shard(1))//"/"//integer_text(shard(2))//": the run has only "// &
                   integer_text(total)//" boulders")
         return
      end if
      before = proportional_part(total, shard(1) - 1, shard(2))
      window = [1, 1, grid%nx, grid%ny]
      call scan_terrain(case, scene, window, error)
      if (.not. allocated(error)) call open_run(case, scene, before, proportional_part(total, shard(1), shard(2)) &
                                                - before, window, run, error)
      call name_case(case, error)
      if (allocated(error)) return
      call set_window(scene%dem, run%maps%at, run%maps%at + run%maps%nodes - 1)
      run%threads = team_size(case%threads)
      call observer%on_start(run, error)
      if (.not. allocated(error)) call run_all(case, scene, observer, run, error)
      if (.not. allocated(error)) call record_trajectories(case, scene, run, error)
   end subroutine run_case

   !> Prefix an error message with the name of the case.
   subroutine name_case(case, error)
      type(case_t), intent(in) :: case
      type(error_t), allocatable, intent(inout) :: error

      if (allocated(error)) error%message = case%file//": "//error%message
   end subroutine name_case

   !> Scan the terrain: check the sources, and that no map can overflow; find the window of the maps.
   subroutine scan_terrain(case, scene, window, error)
      type(case_t), intent(in) :: case
      type(scene_t), intent(in) :: scene
      integer, intent(inout) :: window(4)  !! window of the maps: first column and row, numbers of columns and rows
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: minima(:, :)
      real(wp) :: max_head
      integer :: side, box(4)

      associate (dem => scene%dem, release => scene%release)
         max_head = -huge(max_head)
         call check_sources(scene, 1, dem%ny, max_head, error)
         if (allocated(error) .or. .not. any(case%map)) return
         side = block_side([dem%nx, dem%ny])
         allocate (minima((dem%nx - 1)/side + 1, (dem%ny - 1)/side + 1), source=huge(1.0_wp))
         call update_block_minima(dem, 1, dem%ny, minima)
         call check_overflow(plan_of(case), max_volumes(scene), case%gravity, max_head - minval(minima), &
                            boulder_count(scene), max_tree_hits(scene), error)
         if (allocated(error) .or. case%full_maps) return
         box = reach_box(dem, minima, max_head, release%x, release%y, object_reach(scene, case))
         window = [box(:2), box(3:) - box(:2) + 1]
      end associate
   end subroutine scan_terrain

   !> Run the remaining boulders, in chunks whose size is adapted to their duration.
   subroutine run_all(case, scene, observer, run, error)
      type(case_t), intent(in) :: case
      type(scene_t), intent(in) :: scene
      class(run_observer_t), intent(inout) :: observer
      type(run_t), intent(inout), target :: run
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: cpu_start, cpu
      integer(i8) :: chunk, done, clock_start, clock_end, rate

      chunk = first_chunk
      do while (run%done < run%boulders)
         call observer%on_chunk(run, error)
         if (allocated(error)) return
         chunk = min(chunk, run%boulders - run%done)
         call system_clock(clock_start, rate)
         call cpu_time(cpu_start)
         call advance(run, scene, run%before + run%done + 1, 1_i8, chunk, chunk_seconds, done, error)
         if (.not. allocated(error) .and. size(run%left) > 0) &
            call fail(error, "internal error: a boulder left the reachable area", our_fault)
         call name_case(case, error)
         if (allocated(error)) return
         call system_clock(clock_end)
         call cpu_time(cpu)
         run%wall = run%wall + real(clock_end - clock_start, wp)/rate
         run%cpu = run%cpu + cpu - cpu_start
         chunk = max(1_i8, int(done*min(4.0_wp, chunk_seconds*rate/max(1_i8, clock_end - clock_start)), i8))
         chunk = min(chunk, max(1_i8, chunk_crossings*done/max(1_i8, run%crossed(1))))
      end do
   end subroutine run_all

   !> Rerun the selected boulders one by one and keep their trajectories: first to count the vertices, then to store
   !> them.
   subroutine record_trajectories(case, scene, run, error)
      type(case_t), intent(in) :: case
      type(scene_t), intent(in) :: scene
      type(run_t), intent(inout) :: run
      type(error_t), allocatable, intent(out) :: error
      type(boulder_result_t) :: result
      type(scratch_t) :: scratch
      integer(i8), allocatable :: number(:)
      integer(i8) :: k, n
      integer, allocatable :: vertices(:)
      integer :: j, status

      number = recorded_boulders(scene%release, int(case%trajectories, i8), run%before + 1, run%before + run%boulders)
      allocate (vertices(size(number)), stat=status)
      do k = 1, size(number)
         if (status /= 0) exit
         call trace_boulder(scene, number(k), 0, result, scratch)
         vertices(k) = scratch%record%n
      end do
      n = 0
      if (status == 0) n = sum(int(vertices, i8))
      if (status == 0) allocate (run%vertex(n, size(vertex_fields)), run%vertex_boulder(n), stat=status)
      if (status /= 0) then
         call fail(error, case%file//": &output trajectories = " &
                   //integer_text(size(number, kind=i8))//": do not fit in memory")
         return
      end if
      n = 0
      do k = 1, size(number)
         call trace_boulder(scene, number(k), vertices(k), result, scratch)
         do j = 1, vertices(k)
            run%vertex(n + j, :) = vertex_row(scene%dem, scratch%record%vertex(j))
         end do
         run%vertex_boulder(n + 1:n + vertices(k)) = number(k)
         n = n + vertices(k)
      end do
   end subroutine record_trajectories
end module rockfall_run_loop
