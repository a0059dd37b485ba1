! SPDX-License-Identifier: BSD-3-Clause
!> Door 2: runs all boulders of a scene, and keeps what the case asks for.
module rockfall_simulate
   use rockfall_kinds, only: wp, sp, i4, i8
   use rockfall_error, only: error_t, fail, our_fault
   use rockfall_text, only: integer_text
   use rockfall_trajectory, only: boulder_result_t, crossing_t, contact_t, scratch_t, left_window
   use rockfall_boulder, only: last_of
   use rockfall_maps, only: maps_t, needs_visits, lacks_slots
   use rockfall_source_maps, only: contributing_t, first_partial, contributing_cells, settle
   use rockfall_map_values, only: map_plan_t, map_plan, map_views
   use rockfall_limits, only: check_tallies
   use rockfall_histogram, only: bins, quantities, bin_width
   use rockfall_variables, only: boulder_counts
   use rockfall_result, only: boulder_count_row
   use rockfall_threads, only: team_size
   use rockfall_ensemble, only: run_boulders, trace_boulder
   use rockfall_case, only: case_t, map_names
   use rockfall_load, only: inputs_t
   use rockfall_grid, only: grid_t
   use rockfall_terrain, only: keep_within
   use rockfall_reach, only: block_side, take_minima, reach_box
   implicit none
   private
   public :: results_t, keeper_t, simulate, is_part, map_tallies, reached_cells, bin_edge, rebound_counts

   integer(i8), parameter :: first_chunk = 1024   !! boulders in one call
   real(wp), parameter :: chunk_seconds = 1.0_wp  !! that a call is to take: at its end threads wait for each other
   integer(i8), parameter :: most_columns = 2_i8**31 - 2  !! and one more can be counted
   integer, parameter :: halvings = 5  !! of the columns, before they are too few to begin with

   !> The vertices of a trajectory.
   type :: path_t
      type(contact_t), allocatable :: vertex(:)
   end type path_t

   !> What a run found, in local coordinates. Maps that nobody asked for are not allocated.
   type :: results_t
      integer(i8) :: boulders = 0                        !! of which there is room here
      integer(i8) :: done = 0                            !! of them
      integer(i8) :: before = 0, asked = 0               !! those before them in the run, all of the run
      type(boulder_result_t), allocatable :: fate(:)
      type(crossing_t), allocatable :: crossing(:, :)    !! (lines, boulders)
      type(grid_t) :: grid                               !! of maps: the cells that boulders can reach
      integer :: at(2) = 1                               !! its first column and row
      type(map_plan_t) :: plan                           !! where maps stand in these stacks
      integer(i4), allocatable :: counts(:, :, :)
      integer(i8), allocatable :: sums(:, :, :)
      real(sp), allocatable :: greatest(:, :, :)
      integer(i4), allocatable :: bin_counts(:, :), column(:, :)
      integer(i4) :: columns = 0
      integer(i4), allocatable :: stamp(:, :, :)         !! as in maps_t, with its `head`
      integer(i8) :: head = 0
      type(contributing_t) :: fed                                 !! by the sources that this part cuts
      integer(i8) :: histogram(bins, quantities) = 0
      type(path_t), allocatable :: path(:)               !! of the first boulders of the run
      integer :: threads = 1
      real(wp) :: wall = 0.0_wp, cpu = 0.0_wp            !! [s]
   end type results_t

   !> Who keeps the results of a run while it goes on, and may have some of it to begin with.
   type, abstract :: keeper_t
   contains
      procedure(bring_results), deferred :: restore  !! before the first chunk
      procedure(see_results), deferred :: look       !! before each; an error when the run is to stop
      procedure(let_go), deferred :: finish          !! before they may change in other ways, or go
   end type keeper_t

   abstract interface
      subroutine bring_results(this, results, error)
         import :: keeper_t, results_t, error_t
         class(keeper_t), intent(inout) :: this
         type(results_t), intent(inout) :: results
         type(error_t), allocatable, intent(out) :: error
      end subroutine bring_results
      subroutine see_results(this, results, error)
         import :: keeper_t, results_t, error_t
         class(keeper_t), intent(inout) :: this
         type(results_t), intent(inout), target :: results
         type(error_t), allocatable, intent(out) :: error
      end subroutine see_results
      subroutine let_go(this)
         import :: keeper_t
         class(keeper_t), intent(inout) :: this
      end subroutine let_go
   end interface

contains

   !> Run the case, or part shard(1) of shard(2) ranges of its boulders, which differ by one boulder at
   !> most. It is refused when its results do not fit in memory.
   subroutine simulate(case, inputs, shard, keeper, results, error)
      type(case_t), intent(in) :: case
      type(inputs_t), intent(inout), target :: inputs
      integer(i8), intent(in) :: shard(2)
      class(keeper_t), intent(inout) :: keeper
      type(results_t), intent(out), target :: results
      type(error_t), allocatable, intent(out) :: error
      type(maps_t) :: maps

      results%asked = boulders_of(case, inputs)
      if (results%asked > huge(1_i4)) then  ! passages count them in 32 bits
         call fail(error, case%file//": &case boulders = "//integer_text(case%boulders)//" from each of " &
                   //integer_text(size(inputs%scene%release%x))//" sources: must be at most " &
                   //integer_text(huge(1_i4))//" together")
         return
      end if
      if (shard(2) > max(1_i8, results%asked)) then
         call fail(error, "shard = "//integer_text(shard(1))//"/"//integer_text(shard(2))//": there are " &
                   //integer_text(results%asked)//" boulders only")
         return
      end if
      results%plan = map_plan(pack(map_names, case%map))
      call check_tallies(results%plan, case%volumes, case%gravity, inputs%head - inputs%lowest, results%asked, error)
      if (allocated(error)) error%message = case%file//": "//error%message
      if (allocated(error)) return
      results%before = share_of(results%asked, shard(1) - 1, shard(2))
      results%boulders = share_of(results%asked, shard(1), shard(2)) - results%before
      call make_room(case, inputs, results, error)
      if (allocated(error)) return
      call keep_within(inputs%scene%dem, results%at, results%at + [results%grid%nx, results%grid%ny] - 1)
      call keeper%restore(results, error)
      if (.not. allocated(error)) call fly(case, inputs, keeper, results, error)
      if (allocated(error)) return
      maps = map_tallies(results, [1, 1])
      results%fed = contributing_cells(maps, inputs%scene%release, results%before + 1, &
                                       results%before + results%boulders)
      call settle(maps, inputs%scene%release, results%fed)
      call trace(case, inputs, results, error)
   end subroutine simulate

   !> Fly the boulders that are not done, in chunks that follow the clock.
   subroutine fly(case, inputs, keeper, results, error)
      type(case_t), intent(in) :: case
      type(inputs_t), intent(inout), target :: inputs
      class(keeper_t), intent(inout) :: keeper
      type(results_t), intent(inout), target :: results
      type(error_t), allocatable, intent(out) :: error
      type(maps_t) :: maps
      real(wp) :: wall_before, cpu_before, cpu_begun, cpu
      integer(i8) :: first, last, chunk, begun, start, end, rate

      maps = map_tallies(results, results%at)
      inputs%scene%cells_requested = needs_visits(maps)
      results%threads = team_size(case%threads)
      wall_before = results%wall
      cpu_before = results%cpu
      call system_clock(begun, rate)
      call cpu_time(cpu_begun)
      chunk = first_chunk
      do while (results%done < results%boulders)
         call keeper%look(results, error)
         if (allocated(error)) exit
         call system_clock(start)
         first = results%done + 1
         last = min(results%boulders, results%done + chunk)
         call run_boulders(inputs%scene, results%before + first, results%threads, results%fate(first:last), &
                           results%crossing(:, first:last), maps, results%histogram)
         if (any(results%fate(first:last)%status == left_window)) then
            call fail(error, case%file//": a boulder went where none can go", our_fault)
            exit
         end if
         if (lacks_slots(maps)) then
            call fail(error, case%file//": &output maps: boulders reach more than " &
                      //integer_text(size(results%bin_counts, 2))//" cells; the counts of quantile maps in more " &
                      //"do not fit in memory")
            exit
         end if
         call system_clock(end)
         call cpu_time(cpu)
         results%done = last
         results%wall = wall_before + real(end - begun, wp)/rate
         results%cpu = cpu_before + cpu - cpu_begun
         chunk = max(1_i8, int(chunk*min(4.0_wp, chunk_seconds*rate/max(1_i8, end - start)), i8))
      end do
      call keeper%finish()
   end subroutine fly

   !> Boulders of the whole run, or more than there may be.
   pure integer(i8) function boulders_of(case, inputs) result(n)
      type(case_t), intent(in) :: case
      type(inputs_t), intent(in) :: inputs
      integer(i8) :: sources

      sources = size(inputs%scene%release%x)
      n = huge(1_i8)
      if (case%boulders <= huge(1_i4)/sources) n = last_of(inputs%scene%release, sources)
   end function boulders_of

   !> n*part/of without overflow.
   pure integer(i8) function share_of(n, part, of)
      integer(i8), intent(in) :: n, part, of

      share_of = n/of*part + mod(n, of)*part/of
   end function share_of

   !> True if there are more boulders in the run.
   pure logical function is_part(results)
      type(results_t), intent(in) :: results

      is_part = results%boulders < results%asked
   end function is_part

   !> Places for the results of all boulders, and empty maps.
   subroutine make_room(case, inputs, results, error)
      type(case_t), intent(in) :: case
      type(inputs_t), intent(in) :: inputs
      type(results_t), intent(inout) :: results
      type(error_t), allocatable, intent(out) :: error
      integer(i8) :: n
      integer :: status(7), layers

      n = results%boulders
      results%grid = inputs%grid
      if (any(case%map) .and. .not. case%whole_maps) call find_reach(inputs, results)
      status = 0
      allocate (results%fate(n), stat=status(1))
      if (status(1) == 0) allocate (results%crossing(size(case%lines), n), stat=status(1))
      associate (nx => results%grid%nx, ny => results%grid%ny, plan => results%plan)
         allocate (results%counts(nx, ny, maxval(plan%count)), source=0_i4, stat=status(2))
         allocate (results%sums(nx, ny, maxval(plan%sum)), source=0_i8, stat=status(3))
         allocate (results%greatest(nx, ny, maxval(plan%max)), source=0.0_sp, stat=status(4))
         if (plan%rows == 0) then
            allocate (results%bin_counts(0, 0), results%column(0, 0))
         else
            allocate (results%column(nx, ny), source=0_i4, stat=status(5))
            call make_columns(plan%rows, int(nx, i8)*ny, results%bin_counts, status(6))
         end if
         layers = 0
         if (any(plan%count(3:) > 0)) then
            results%head = first_partial(inputs%scene%release, results%before + 1)
            layers = merge(2, 1, results%head > 0)
         end if
         allocate (results%stamp(nx, ny, layers), source=0_i4, stat=status(7))
      end associate
      if (status(1) /= 0) then
         call fail(error, case%file//": "//integer_text(n)//" boulders do not fit in memory")
      else if (any(status /= 0)) then
         call fail(error, case%file//": &output maps do not fit in memory")
      end if
   end subroutine make_room

   !> Where maps lie: the cells that boulders can reach.
   subroutine find_reach(inputs, results)
      type(inputs_t), intent(in) :: inputs
      type(results_t), intent(inout) :: results
      real(wp), allocatable :: minima(:, :)
      integer :: side, box(4)

      associate (dem => inputs%scene%dem, release => inputs%scene%release, grid => results%grid)
         side = block_side([dem%nx, dem%ny])
         allocate (minima((dem%nx - 1)/side + 1, (dem%ny - 1)/side + 1), source=huge(1.0_wp))
         call take_minima(dem, 1, dem%ny, minima)
         box = reach_box(dem, minima, inputs%head, release%x, release%y)
         results%at = box(:2)
         grid%west = grid%west + (box(1) - 1)*grid%cell
         grid%north = grid%north - (box(2) - 1)*grid%cell
         grid%nx = box(3) - box(1) + 1
         grid%ny = box(4) - box(2) + 1
      end associate
   end subroutine find_reach

   !> Counts of classes of all cells, or of half as many as the system grants (the run needs memory for other
   !> things too): it takes the memory of a column when a boulder first passes the cell, and few may be passed.
   subroutine make_columns(rows, cells, bin_counts, status)
      integer, intent(in) :: rows
      integer(i8), intent(in) :: cells
      integer(i4), allocatable, intent(out) :: bin_counts(:, :)
      integer, intent(out) :: status  !! 0 = success
      integer(i8) :: columns
      integer :: k

      columns = min(cells, most_columns)
      allocate (bin_counts(rows, columns), stat=status)
      if (status == 0) return
      do k = 1, halvings
         columns = columns/2
         allocate (bin_counts(rows, columns), stat=status)
         if (status /= 0) cycle
         deallocate (bin_counts)
         allocate (bin_counts(rows, columns/2), stat=status)
         return
      end do
   end subroutine make_columns

   !> The kernel's view of the maps, which begin at a column and row.
   function map_tallies(results, at) result(maps)
      type(results_t), intent(in), target :: results
      integer, intent(in) :: at(2)
      type(maps_t) :: maps

      maps = map_views(results%plan, at, results%counts, results%sums, results%greatest, results%bin_counts, &
                       results%column, results%columns)
      maps%last_source(at(1):, at(2):, 1:) => results%stamp
      maps%first_partial = results%head
   end function map_tallies

   !> Cells in which any tally is not zero, counted from 0 by rows.
   pure function reached_cells(results) result(cells)
      type(results_t), intent(in) :: results
      integer(i8), allocatable :: cells(:)
      integer(i8) :: n, turn
      integer :: i, j
      logical :: reached

      do turn = 1, 2  ! count them, then note them
         n = 0
         do j = 1, size(results%counts, 2)
            do i = 1, size(results%counts, 1)
               reached = any(results%counts(i, j, :) /= 0) .or. any(results%sums(i, j, :) /= 0) &
                         .or. any(results%greatest(i, j, :) > 0)
               if (size(results%column) > 0) reached = reached .or. results%column(i, j) > 0
               if (.not. reached) cycle
               n = n + 1
               if (turn == 2) cells(n) = (j - 1)*int(size(results%counts, 1), i8) + i - 1
            end do
         end do
         if (turn == 1) allocate (cells(n))
      end do
   end function reached_cells

   !> Fly the first boulders once more, each alone, and keep their way.
   subroutine trace(case, inputs, results, error)
      type(case_t), intent(in) :: case
      type(inputs_t), intent(in), target :: inputs
      type(results_t), intent(inout) :: results
      type(error_t), allocatable, intent(out) :: error
      type(boulder_result_t) :: fate
      type(scratch_t) :: scratch
      integer :: k, n, status

      n = int(max(0_i8, min(int(case%trajectories, i8) - results%before, results%boulders)))
      allocate (results%path(n), stat=status)
      do k = 1, n
         if (status /= 0) exit
         call trace_boulder(inputs%scene, results%before + k, results%fate(k)%impacts + 3, fate, scratch)
         allocate (results%path(k)%vertex(scratch%recorded), stat=status)
         if (status == 0) results%path(k)%vertex = scratch%record(:scratch%recorded)
      end do
      if (status /= 0) then
         call fail(error, case%file//": &output trajectories = "//integer_text(n) &
                   //": do not fit in memory")
      end if
   end subroutine trace

   !> Edge k = 0, 1, ... of the bins of a histogram.
   pure real(wp) function bin_edge(quantity, k)
      integer, intent(in) :: quantity, k
      real(wp), parameter :: decimals = 1.0e10_wp

      bin_edge = anint(k*bin_width(quantity)*decimals)/decimals
   end function bin_edge

   !> The integers of all boulders (`boulder_counts`), added up.
   pure function rebound_counts(results) result(total)
      type(results_t), intent(in) :: results
      integer(i8) :: total(size(boulder_counts))
      integer(i8) :: b

      total = 0
      do b = 1, results%boulders
         total = total + boulder_count_row(results%fate(b))
      end do
   end function rebound_counts
end module rockfall_simulate
