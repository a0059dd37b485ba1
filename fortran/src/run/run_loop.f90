! SPDX-License-Identifier: BSD-3-Clause
!> The standalone program's run: all boulders of a scene, in chunks, and what the case asks to keep of them.
module rockfall_run_loop
   use rockfall_kinds, only: wp, sp, i1, i4, i8
   use rockfall_error, only: error_t, fail, our_fault
   use rockfall_text, only: integer_text
   use rockfall_scene_type, only: scene_t
   use rockfall_outcome, only: boulder_result_t, left_window
   use rockfall_crossings, only: crossing_t
   use rockfall_scratch, only: scratch_t
   use rockfall_maps, only: maps_t, lacks_slots
   use rockfall_source_maps, only: first_partial
   use rockfall_map_values, only: map_plan_t, map_plan, stack_layers, map_views, max_columns, halvings
   use rockfall_limits, only: check_tallies
   use rockfall_histogram, only: bins, quantities
   use rockfall_variables, only: boulder_fields, boulder_counts, energy_fields, line_fields, vertex_fields
   use rockfall_result, only: boulder_row, boulder_count_row, energy_row, line_row, vertex_row
   use rockfall_threads, only: team_size
   use rockfall_ensemble, only: run_boulders, trace_boulder, recorded_boulders
   use rockfall_sources, only: share_of
   use rockfall_boulder, only: feature_of
   use rockfall_case_keys, only: map_names
   use rockfall_case, only: case_t, keeps_all
   use rockfall_samples, only: samples_t
   use rockfall_line, only: line_t
   use rockfall_line_samples, only: layout_t, layout_of, make_samples, add_samples
   use rockfall_grid, only: grid_t
   use rockfall_terrain, only: keep_within
   use rockfall_reach, only: block_side, take_minima, reach_box
   use rockfall_scene, only: check_sources, boulders_of, largest_volumes, n_barriers
   implicit none
   private
   public :: results_t, run_observer_t, run_case, map_tallies

   integer(i8), parameter :: first_chunk = 1024   !! boulders in one call
   real(wp), parameter :: chunk_seconds = 1.0_wp  !! that a call is to take: at its end threads wait for each other

   !> What a run found, as rows of numbers in map coordinates. Maps that nobody asked for have no cells.
   type :: results_t
      integer(i8) :: boulders = 0                        !! that are to be done here
      integer(i8) :: done = 0                            !! of them
      integer(i8) :: before = 0, asked = 0               !! those before them in the run, all of the run
      integer(i8) :: rows = 0                            !! of boulders done: all, or those with a `number`
      integer(i8), allocatable :: number(:)              !! of the boulders that have rows, where not all have,
      type(layout_t) :: layout                           !! and then all are in samples
      type(samples_t) :: samples
      real(wp), allocatable :: boulder(:, :)             !! (rows, boulder_fields)
      integer(i1), allocatable :: status(:)              !! the first of boulder_counts,
      integer(i4), allocatable :: impacts(:)             !! the second,
      integer(i4), allocatable :: source(:)              !! the third,
      integer(i8) :: count(size(boulder_counts)) = 0     !! and of all boulders done, the others
      real(wp), allocatable :: energy(:, :)              !! (boulders, energy_fields), or no boulders
      integer(i4), allocatable :: feature(:)             !! of the source of each boulder, or of none
      integer(i4), allocatable :: trees_hit(:)           !! of each boulder, or of none
      real(wp), allocatable :: line(:, :, :)             !! (rows, lines, line_fields)
      integer(i1), allocatable :: outcome(:, :)          !! (rows, barriers), as in crossing_t
      real(wp), allocatable :: vertex(:, :)              !! (vertices, vertex_fields) of recorded boulders
      integer(i8), allocatable :: vertex_boulder(:)
      type(grid_t) :: grid                               !! of maps: the cells that boulders can reach
      integer :: at(2) = 1                               !! its first column and row
      type(map_plan_t) :: plan                           !! where maps stand in these stacks
      real(wp), allocatable :: thresholds(:)             !! of energy [J]
      integer(i4), allocatable :: counts(:, :, :)
      integer(i8), allocatable :: sums(:, :, :)
      real(sp), allocatable :: maxima(:, :, :)
      integer(i4), allocatable :: bin_counts(:, :), column(:, :)
      integer(i4) :: columns = 0
      integer(i4), allocatable :: stamp(:, :, :)         !! as in maps_t, with its `head`
      integer(i8) :: head = 0
      integer(i8) :: histogram(bins, quantities) = 0
      integer(i8), allocatable :: by_ground(:)           !! rebounds, where the scene has several grounds
      integer :: threads = 1
      real(wp) :: wall = 0.0_wp, cpu = 0.0_wp            !! [s]
   end type results_t

   !> Who looks at the results of a run while it goes on, and may have some of them to begin with.
   type, abstract :: run_observer_t
   contains
      procedure(see_results), deferred :: on_start  !! before the first chunk
      procedure(see_results), deferred :: on_chunk  !! before each; an error when the run is to stop
   end type run_observer_t

   abstract interface
      subroutine see_results(this, results, error)
         import :: run_observer_t, results_t, error_t
         class(run_observer_t), intent(inout) :: this
         type(results_t), intent(inout), target :: results
         type(error_t), allocatable, intent(out) :: error
      end subroutine see_results
   end interface

contains

   !> Run the case, or part shard(1) of shard(2) ranges of its boulders, which differ by one boulder at most. It is
   !> refused when its results do not fit in memory.
   subroutine run_case(case, grid, scene, shard, observer, results, error)
      type(case_t), intent(in) :: case
      type(grid_t), intent(in) :: grid  !! of the terrain
      type(scene_t), intent(inout) :: scene
      integer(i8), intent(in) :: shard(2)
      class(run_observer_t), intent(inout) :: observer
      type(results_t), intent(out), target :: results
      type(error_t), allocatable, intent(out) :: error

      results%asked = boulders_of(scene)
      if (shard(2) > max(1_i8, results%asked)) then
         call fail(error, "--shard "//integer_text(shard(1))//"/"//integer_text(shard(2))//": there are " &
                   //integer_text(results%asked)//" boulders only")
         return
      end if
      results%before = share_of(results%asked, shard(1) - 1, shard(2))
      results%boulders = share_of(results%asked, shard(1), shard(2)) - results%before
      results%grid = grid
      results%thresholds = case%thresholds
      results%plan = map_plan(pack(map_names, case%map), size(case%thresholds))
      call survey(case, scene, results, error)
      if (.not. allocated(error)) call make_room(case, scene, results, error)
      if (allocated(error)) return
      call keep_within(scene%dem, results%at, results%at + [results%grid%nx, results%grid%ny] - 1)
      call observer%on_start(results, error)
      if (.not. allocated(error)) call follow_all(case, scene, observer, results, error)
      if (.not. allocated(error)) call trace(case, scene, results, error)
   end subroutine run_case

   !> Look at the terrain: whether boulders can start from the sources, what maps could come to, and where they lie.
   subroutine survey(case, scene, results, error)
      type(case_t), intent(in) :: case
      type(scene_t), intent(in) :: scene
      type(results_t), intent(inout) :: results
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: minima(:, :)
      real(wp) :: head
      integer :: side, box(4)

      associate (dem => scene%dem, release => scene%release, grid => results%grid)
         head = -huge(head)
         call check_sources(scene, 1, dem%ny, head, error)
         if (allocated(error)) error%message = case%file//": "//error%message
         if (allocated(error) .or. .not. any(case%map)) return
         side = block_side([dem%nx, dem%ny])
         allocate (minima((dem%nx - 1)/side + 1, (dem%ny - 1)/side + 1), source=huge(1.0_wp))
         call take_minima(dem, 1, dem%ny, minima)
         call check_tallies(results%plan, largest_volumes(scene), case%gravity, head - minval(minima), results%asked, &
                            case%impact_limit, error)
         if (allocated(error)) error%message = case%file//": "//error%message
         if (allocated(error) .or. case%whole_maps) return
         box = reach_box(dem, minima, head, release%x, release%y)
         results%at = box(:2)
         grid%west = grid%west + (box(1) - 1)*grid%cell
         grid%north = grid%north - (box(2) - 1)*grid%cell
         grid%nx = box(3) - box(1) + 1
         grid%ny = box(4) - box(2) + 1
      end associate
   end subroutine survey

   !> Places for the results of all boulders, and empty maps.
   subroutine make_room(case, scene, results, error)
      type(case_t), intent(in) :: case
      type(scene_t), intent(in) :: scene
      type(results_t), intent(inout) :: results
      type(error_t), allocatable, intent(out) :: error
      integer :: rows(3), cells(6), stacks(3), layers, lines
      integer(i8) :: n

      rows = 0
      cells = 0
      allocate (results%by_ground(0))
      if (allocated(scene%grounds)) results%by_ground = spread(0_i8, 1, size(scene%grounds))
      lines = size(case%lines)
      stacks = stack_layers(results%plan)
      n = results%boulders
      if (case%kept /= keeps_all) then
         results%number = recorded_boulders(scene%release, case%kept, results%before + 1, results%before + n)
         n = size(results%number, kind=i8)
         results%layout = layout_of(scene%release, lines + 1)
         call make_samples(results%layout, lines, results%asked, results%samples, rows(1))
      end if
      associate (nx => results%grid%nx, ny => results%grid%ny, plan => results%plan)
         if (rows(1) == 0) allocate (results%boulder(n, size(boulder_fields)), stat=rows(1))
         if (rows(1) == 0) allocate (results%status(n), results%impacts(n), results%source(n), stat=rows(2))
         if (all(rows == 0)) &
            allocate (results%energy(merge(n, 0_i8, case%energy_balance), size(energy_fields)), &
                      results%feature(merge(n, 0_i8, allocated(scene%release%feature))), &
                      results%trees_hit(merge(n, 0_i8, case%forest)), stat=rows(2))
         if (all(rows == 0)) allocate (results%line(n, lines, size(line_fields)), &
                                        results%outcome(n, n_barriers(scene)), stat=rows(3))
         allocate (results%counts(nx, ny, stacks(1)), source=0_i4, stat=cells(1))
         allocate (results%sums(nx, ny, stacks(2)), source=0_i8, stat=cells(2))
         allocate (results%maxima(nx, ny, stacks(3)), source=0.0_sp, stat=cells(3))
         if (plan%rows == 0) then
            allocate (results%bin_counts(0, 0), results%column(0, 0))
         else
            allocate (results%column(nx, ny), source=0_i4, stat=cells(4))
            call make_columns(plan%rows, int(nx, i8)*ny, results%bin_counts, cells(5))
         end if
         layers = 0
         if (any(plan%count(3:4) > 0)) then
            results%head = first_partial(scene%release, results%before + 1)
            layers = merge(2, 1, results%head > 0)
         end if
         allocate (results%stamp(nx, ny, layers), source=0_i4, stat=cells(6))
         if (any(rows /= 0)) then
            call fail(error, case%file//": "//integer_text(results%boulders)//" boulders do not fit in memory")
         else if (any(cells /= 0)) then
            call fail(error, case%file//": &output maps do not fit in memory")
         end if
      end associate
   end subroutine make_room

   !> Counts of classes of all cells, or of half as many as the system grants (the run needs memory for other
   !> things too): it takes the memory of a column when a boulder first passes the cell, and few may be passed.
   subroutine make_columns(rows, cells, bin_counts, status)
      integer, intent(in) :: rows
      integer(i8), intent(in) :: cells
      integer(i4), allocatable, intent(out) :: bin_counts(:, :)
      integer, intent(out) :: status  !! 0 = success
      integer(i8) :: columns
      integer :: k

      columns = min(cells, max_columns)
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

      maps = map_views(results%plan, results%thresholds, at, results%counts, results%sums, results%maxima, &
                       results%bin_counts, results%column, results%columns)
      maps%last_source(at(1):, at(2):, 1:) => results%stamp
      maps%first_partial = results%head
   end function map_tallies

   !> Follow the boulders that are not done, in chunks whose size follows the clock.
   subroutine follow_all(case, scene, observer, results, error)
      type(case_t), intent(in) :: case
      type(scene_t), intent(inout) :: scene
      class(run_observer_t), intent(inout) :: observer
      type(results_t), intent(inout), target :: results
      type(error_t), allocatable, intent(out) :: error
      type(maps_t) :: maps
      real(wp) :: cpu_begun, cpu
      integer(i8) :: chunk, begun, end, rate

      maps = map_tallies(results, results%at)
      results%threads = team_size(case%threads)
      chunk = first_chunk
      do while (results%done < results%boulders)
         call observer%on_chunk(results, error)
         if (allocated(error)) return
         chunk = min(chunk, results%boulders - results%done)
         call system_clock(begun, rate)
         call cpu_time(cpu_begun)
         call follow_some(case, scene, chunk, maps, results, error)
         if (allocated(error)) return
         call system_clock(end)
         call cpu_time(cpu)
         results%wall = results%wall + real(end - begun, wp)/rate
         results%cpu = results%cpu + cpu - cpu_begun
         chunk = max(1_i8, int(chunk*min(4.0_wp, chunk_seconds*rate/max(1_i8, end - begun)), i8))
      end do
   end subroutine follow_all

   !> The next n boulders: their rows to their places.
   subroutine follow_some(case, scene, n, maps, results, error)
      type(case_t), intent(in) :: case
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: n
      type(maps_t), intent(in) :: maps
      type(results_t), intent(inout) :: results
      type(error_t), allocatable, intent(out) :: error
      type(boulder_result_t), allocatable :: fate(:)
      type(crossing_t), allocatable :: crossing(:, :)
      integer :: status
      integer(i8) :: k

      allocate (fate(n), crossing(size(case%lines), n), stat=status)
      if (status /= 0) then
         call fail(error, case%file//": "//integer_text(n)//" boulders do not fit in memory")
         return
      end if
      call run_boulders(scene, results%before + results%done + 1, results%threads, fate, crossing, maps, &
                         results%histogram, results%by_ground)
      if (any(fate%status == left_window)) then
         call fail(error, case%file//": a boulder went where none can go", our_fault)
      else if (lacks_slots(maps)) then
         call fail(error, case%file//": &output maps: boulders reach more than " &
                   //integer_text(size(results%bin_counts, 2))//" cells; the counts of quantile maps in more " &
                   //"do not fit in memory")
      end if
      if (allocated(error)) return
      do k = 1, n
         results%count = results%count + boulder_count_row(fate(k))
         if (allocated(results%number)) then
            call sample_one(scene, fate(k), crossing(:, k), results)
            if (results%rows == size(results%number, kind=i8)) cycle
            if (results%number(results%rows + 1) /= results%before + results%done + k) cycle
         end if
         results%rows = results%rows + 1
         call keep_row(case, scene, fate(k), crossing(:, k), results%rows, results)
      end do
      results%done = results%done + n
   end subroutine follow_some

   !> The rows of a boulder, to their place.
   subroutine keep_row(case, scene, fate, crossing, row, results)
      type(case_t), intent(in) :: case
      type(scene_t), intent(in) :: scene
      type(boulder_result_t), intent(in) :: fate
      type(crossing_t), intent(in) :: crossing(:)
      integer(i8), intent(in) :: row
      type(results_t), intent(inout) :: results
      integer :: count(size(boulder_counts)), line

      results%boulder(row, :) = boulder_row(scene%dem, fate)
      count = boulder_count_row(fate)
      results%status(row) = int(count(1), i1)
      results%impacts(row) = count(2)
      results%source(row) = count(3)
      if (case%energy_balance) results%energy(row, :) = energy_row(fate)
      if (size(results%feature) > 0) results%feature(row) = feature_of(scene%release, int(fate%source, i8))
      if (case%forest) results%trees_hit(row) = fate%trees_hit
      do line = 1, size(case%lines)
         results%line(row, line, :) = line_row(scene%dem, fate, crossing(line))
      end do
      if (allocated(scene%barriers)) results%outcome(row, :) = crossing(scene%barriers%line)%outcome
   end subroutine keep_row

   !> Add a boulder to the samples.
   subroutine sample_one(scene, fate, crossing, results)
      type(scene_t), intent(in) :: scene
      type(boulder_result_t), intent(in) :: fate
      type(crossing_t), intent(in) :: crossing(:)
      type(results_t), intent(inout) :: results
      real(wp) :: rows(size(line_fields), size(crossing))
      type(line_t) :: none(0)
      integer :: k

      do k = 1, size(crossing)
         rows(:, k) = line_row(scene%dem, fate, crossing(k))
      end do
      associate (origin => [scene%dem%x0, scene%dem%y0], row => boulder_row(scene%dem, fate))
         if (allocated(scene%lines)) then
            call add_samples(results%samples, results%layout, scene%lines, origin, row, boulder_count_row(fate), rows)
         else
            call add_samples(results%samples, results%layout, none, origin, row, boulder_count_row(fate), rows)
         end if
      end associate
   end subroutine sample_one

   !> Follow some boulders of the run once more, each alone, and keep their trajectories: first to count the
   !> vertices, then to keep them.
   subroutine trace(case, scene, results, error)
      type(case_t), intent(in) :: case
      type(scene_t), intent(in) :: scene
      type(results_t), intent(inout) :: results
      type(error_t), allocatable, intent(out) :: error
      type(boulder_result_t) :: fate
      type(scratch_t) :: scratch
      integer(i8), allocatable :: number(:)
      integer(i8) :: k, n
      integer, allocatable :: vertices(:)
      integer :: j, status

      number = recorded_boulders(scene%release, int(case%trajectories, i8), results%before + 1, &
                                 results%before + results%boulders)
      allocate (vertices(size(number)), stat=status)
      do k = 1, size(number)
         if (status /= 0) exit
         call trace_boulder(scene, number(k), 0, fate, scratch)
         vertices(k) = scratch%recorded
      end do
      n = 0
      if (status == 0) n = sum(int(vertices, i8))
      if (status == 0) allocate (results%vertex(n, size(vertex_fields)), results%vertex_boulder(n), stat=status)
      if (status /= 0) then
         call fail(error, case%file//": &output trajectories = " &
                   //integer_text(size(number, kind=i8))//": do not fit in memory")
         return
      end if
      n = 0
      do k = 1, size(number)
         call trace_boulder(scene, number(k), vertices(k), fate, scratch)
         do j = 1, vertices(k)
            results%vertex(n + j, :) = vertex_row(scene%dem, scratch%record(j))
         end do
         results%vertex_boulder(n + 1:n + vertices(k)) = number(k)
         n = n + vertices(k)
      end do
   end subroutine trace
end module rockfall_run_loop
