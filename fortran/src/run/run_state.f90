! SPDX-License-Identifier: BSD-3-Clause
!> State of a run: rows of its boulders, sums over them, and map tallies. Both programs open it, advance it in chunks in
!> any order, and read its arrays through the table of `arrays_of`; a run without a scene is joined from parts.
module rockfall_run_state
   use rockfall_kinds, only: wp, sp, i1, i4, i8
   use rockfall_error, only: error_t, fail
   use rockfall_math, only: rounded_up
   use rockfall_memory, only: prefetch
   use rockfall_text, only: integer_text
   use rockfall_scene_type, only: scene_t, n_grounds
   use rockfall_outcome, only: boulder_result_t, left_window
   use rockfall_crossings, only: crossings_t
   use rockfall_maps, only: maps_t, lacks_slots
   use rockfall_source_maps, only: contributing_t, first_partial
   use rockfall_map_values, only: map_plan_t, map_plan
   use rockfall_map_tallies, only: map_tallies_t, tells_sources, allocate_maps => allocate_tallies, move_tallies, &
                                   add_tallies, free_tallies, forget_maps => forget_tallies, views_of_threads, &
                                   take_own_tallies, settle_partial_sources, restore_sources
   use rockfall_histogram, only: bins, quantities, n_bins
   use rockfall_boulder, only: release_t
   use rockfall_variables, only: boulder_counts, line_fields, crossing_fields, vertex_fields, histogram_fields, &
                                 statuses, row_reals, row_integers, real_groups, integer_groups
   use rockfall_rows, only: boulder_row, boulder_count_row, real_row, integer_row, line_row, crossing_row
   use rockfall_crossing_rows, only: crossing_rows_t, start_rows, make_room, append_rows, clear_rows, sort_rows, n_reals
   use rockfall_ensemble, only: run_boulders, recorded_boulders
   use rockfall_threads, only: team_size
   use rockfall_case_keys, only: map_names, n_maps
   use rockfall_case, only: case_t, keeps_all
   use rockfall_samples, only: samples_t, allocate_samples, continue_samples, merge_samples, free_samples, &
                               forget_samples
   use rockfall_line_samples, only: layout_t, layout_of, add_end, add_crossings, n_quantities, tails
   use rockfall_state_table, only: table_t
   use rockfall_bounds, only: boulder_count
   implicit none
   private
   public :: run_t, open_run, open_joined_run, continue_run, merge_run, close_run, advance
   public :: arrays_of, rows_of, row_kept, no_row, plan_of, settle_run, restore_run, forget_tallies
   public :: sort_crossings, forget_crossings, add_crossing_arrays

   integer(i8), parameter :: no_row = huge(1_i8)           !! row number of an empty row
   integer, parameter :: passing_height = findloc(crossing_fields, "passing_height", dim=1)
   integer, parameter :: at_once = 256                     !! boulders whose crossings are stored together
   integer, parameter :: ahead = 8                         !! number of crossings prefetched in advance
   integer, parameter :: n_totals = size(boulder_counts) - 3  !! number of boulder_counts that are summed

   !> A complete run, or a range of its boulders. Arrays that the case does not need have size zero.
   type :: run_t
      integer(i8) :: total = 0, before = 0, boulders = 0  !! boulders of the run, before the range, in the range
      integer(i8) :: done = 0                             !! completed boulders of the range, from its start
      integer(i8) :: per_source = 0                       !! boulders of each source as in the case; 0 if not given
      integer :: threads = 1
      real(wp) :: wall = 0.0_wp, cpu = 0.0_wp             !! [s]
      ! Rows of all boulders of the range, or only of those in `number`; then samples cover all boulders.
      integer(i8), allocatable :: number(:)
      integer, allocatable :: real_columns(:), integer_columns(:)  !! columns of row_reals and row_integers in use
      real(wp), allocatable :: reals(:, :)                !! (rows, columns)
      integer(i1), allocatable :: status(:)
      integer(i4), allocatable :: integers(:, :)
      integer :: lines = 0
      integer(i8) :: crossed(1) = 0                       !! number of crossings in the last chunk, stored or sampled
      type(crossing_rows_t) :: crossings                  !! line crossings of the boulders with rows
      ! Sums over the completed boulders:
      integer(i8) :: count(n_totals) = 0                  !! sums of the last columns of boulder_counts
      integer(i8) :: histogram(bins, quantities) = 0
      logical :: histograms_requested = .false.
      integer(i8), allocatable :: by_ground(:)            !! rebounds by ground, if the scene has several grounds
      type(layout_t) :: layout
      type(samples_t) :: samples
      real(wp), allocatable :: vertex(:, :)               !! vertices (vertices, vertex_fields) of recorded boulders
      integer(i8), allocatable :: vertex_boulder(:)       !! boulder of each vertex, if the run loop records them
      logical :: sampled = .false.                        !! the sources are a sample
      logical :: map(n_maps) = .false.                    !! requested maps, in the order of map_names
      type(map_tallies_t) :: maps                         !! tallies of the cells in a window
      integer :: min_passages = 1                         !! minimum number of passages for a mean or a quantile
      ! Boulders of the last chunk that left the window of the terrain, and where they left it:
      integer(i8), allocatable :: left(:)
      real(wp), allocatable :: left_at(:, :)              !! (boulders, 2), map coordinates [m]
   end type run_t

contains

   !> Open a run of a scene, or of the `boulders` boulders after the first `before`; none is completed. Maps cover a
   !> window: first column and row, numbers of columns and rows.
   subroutine open_run(case, scene, before, boulders, window, run, error)
      type(case_t), intent(in) :: case
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: before, boulders
      integer, intent(in) :: window(4)
      type(run_t), intent(inout) :: run
      type(error_t), allocatable, intent(out) :: error

      call set_dimensions(case, scene, before, boulders, window, run)
      call allocate_rows(case, n_grounds(scene), allocated(scene%release%feature), allocated(scene%shapes), run, error)
      if (.not. allocated(error)) call allocate_tallies(run, error)
   end subroutine open_run

   subroutine set_dimensions(case, scene, before, boulders, window, run)
      type(case_t), intent(in) :: case
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: before, boulders
      integer, intent(in) :: window(4)
      type(run_t), intent(inout) :: run

      run%total = boulder_count(scene)
      run%before = before
      run%boulders = boulders
      run%maps%at = window(:2)
      run%maps%nodes = window(3:)
      if (case%kept /= keeps_all) then
         run%number = recorded_boulders(scene%release, case%kept, before + 1, before + boulders)
         run%layout = layout_of(scene%release, size(case%lines) + 1)
      end if
      call set_case(case, run)
      if (tells_sources(run%maps)) run%maps%first_partial = first_partial(scene%release, before + 1)
   end subroutine set_dimensions

   !> Set the properties of a run that its case determines.
   subroutine set_case(case, run)
      type(case_t), intent(in) :: case
      type(run_t), intent(inout) :: run

      run%per_source = merge(0_i8, case%boulders, case%by_area)
      run%sampled = case%sampled
      run%map = case%map
      run%maps%plan = plan_of(case)
      run%maps%thresholds = case%thresholds
      run%min_passages = case%min_passages
   end subroutine set_case

   !> Tallies that a case's maps need.
   pure type(map_plan_t) function plan_of(case) result(plan)
      type(case_t), intent(in) :: case

      plan = map_plan(pack(map_names, case%map), size(case%thresholds))
   end function plan_of

   !> Open a run without a scene: a part, or a run to be joined from parts, whose rows may arrive in any order.
   subroutine open_joined_run(case, total, before, boulders, window, grounds, features, shapes, layout, run, error)
      type(case_t), intent(in) :: case
      integer(i8), intent(in) :: total             !! number of boulders in the complete run
      integer(i8), intent(in) :: before, boulders  !! number before the part; number in the part
      integer, intent(in) :: window(4)
      integer, intent(in) :: grounds   !! number of grounds; 0: only the impact sets
      logical, intent(in) :: features  !! sources come from the features of a layer
      logical, intent(in) :: shapes    !! boulders have several shapes
      type(layout_t), intent(in) :: layout  !! layout of samples
      type(run_t), intent(inout) :: run
      type(error_t), allocatable, intent(out) :: error

      run%total = total
      run%before = before
      run%boulders = boulders
      run%done = boulders
      run%maps%at = window(:2)
      run%maps%nodes = window(3:)
      run%layout = layout
      if (case%kept /= keeps_all) allocate (run%number(min(case%kept, boulders)), source=no_row)
      call set_case(case, run)
      if (tells_sources(run%maps)) &
         run%maps%shared = contributing_t([integer(i8) ::], [integer(i4) ::], [integer(i4) ::])
      call allocate_rows(case, grounds, features, shapes, run, error)
      if (.not. allocated(error)) call allocate_tallies(run, error)
   end subroutine open_joined_run

   !> Open a run of a scene that continues another run with the same first boulders. Tallies are moved, so the other run
   !> cannot continue.
   subroutine continue_run(case, scene, other, run, error)
      type(case_t), intent(in) :: case
      type(scene_t), intent(in) :: scene
      type(run_t), intent(inout) :: other
      type(run_t), intent(inout) :: run
      type(error_t), allocatable, intent(out) :: error
      logical :: fit

      call set_dimensions(case, scene, other%before, boulder_count(scene) - other%before, &
                          [other%maps%at, other%maps%nodes], run)
      call allocate_rows(case, n_grounds(scene), allocated(scene%release%feature), allocated(scene%shapes), run, error)
      if (allocated(error)) return
      call copy_rows(run, 0_i8, other)
      call append_rows(run%crossings, other%crossings, fit)
      if (.not. fit) then
         call report_memory(run, error)
         return
      end if
      run%count = other%count
      run%histogram = other%histogram
      run%by_ground = other%by_ground
      run%done = other%done
      run%threads = other%threads
      call move_tallies(other%maps, run%maps)
      if (.not. allocated(run%number)) return
      call continue_samples(other%samples, run%samples, run%total, run%sampled, fit)
      if (.not. fit) call report_memory(run, error)
   end subroutine continue_run

   !> Add a part to a run. If not all rows are kept, its rows are appended to the rows of earlier parts.
   subroutine merge_run(run, part, error)
      type(run_t), intent(inout) :: run
      type(run_t), intent(in) :: part
      type(error_t), allocatable, intent(out) :: error
      integer(i8) :: row, n
      logical :: fit

      n = rows_of(part)
      row = part%before - run%before
      if (allocated(run%number)) row = rows_of(run)
      if (row + n > size(run%status, kind=i8)) then
         call fail(error, "cannot merge: the parts have more rows than the run has boulders ("// &
                   integer_text(run%total)//")")
         return
      else if (size(run%reals, 2) /= size(part%reals, 2) .or. size(run%integers, 2) /= size(part%integers, 2)) then
         call fail(error, "cannot merge: a part has different boulder variables from those of the first part")
         return
      end if
      if (allocated(run%number)) run%number(row + 1:row + n) = part%number(:n)
      call copy_rows(run, row, part)
      call append_rows(run%crossings, part%crossings, fit)
      if (.not. fit) then
         call report_memory(run, error)
         return
      end if
      run%count = run%count + part%count
      run%histogram = run%histogram + part%histogram
      run%by_ground = run%by_ground + part%by_ground
      if (allocated(run%number)) call merge_samples(run%samples, part%samples)
      call add_tallies(run%maps, part%maps, fit)
      if (.not. fit) call fail(error, "the counts of quantile maps do not fit in memory")
   end subroutine merge_run

   !> Copy the rows of another run to follow the first `row` rows.
   pure subroutine copy_rows(run, row, other)
      type(run_t), intent(inout) :: run
      integer(i8), intent(in) :: row
      type(run_t), intent(in) :: other

      associate (n => rows_of(other))
         run%reals(row + 1:row + n, :) = other%reals(:n, :)
         run%status(row + 1:row + n) = other%status(:n)
         run%integers(row + 1:row + n, :) = other%integers(:n, :)
      end associate
   end subroutine copy_rows

   !> Sort crossings by line, then by boulder.
   subroutine sort_crossings(run, error)
      type(run_t), intent(inout) :: run
      type(error_t), allocatable, intent(out) :: error
      logical :: fit

      call sort_rows(run%lines, run%crossings, fit)
      if (.not. fit) call report_memory(run, error)
   end subroutine sort_crossings

   subroutine close_run(run)
      type(run_t), intent(inout) :: run

      call free_tallies(run%maps)
      call free_samples(run%samples)
   end subroutine close_run

   !> Free the tallies and samples of a run once all results are computed; counts, sums and maxima of maps only where
   !> `stacks` is true. Views of other arrays stay valid.
   subroutine forget_tallies(run, stacks)
      type(run_t), intent(inout) :: run
      logical, intent(in) :: stacks(3)

      call forget_maps(run%maps, stacks)
      call forget_samples(run%samples)
   end subroutine forget_tallies

   !> Discard the crossings, which the caller now keeps.
   subroutine forget_crossings(run)
      type(run_t), intent(inout) :: run

      call clear_rows(run%crossings)
   end subroutine forget_crossings

   ! ---- memory -------------------------------------------------------------------------------

   !> Allocate the sums and the rows of boulders, with the columns that the case needs.
   subroutine allocate_rows(case, grounds, features, shapes, run, error)
      type(case_t), intent(in) :: case
      integer, intent(in) :: grounds
      logical, intent(in) :: features, shapes
      type(run_t), intent(inout) :: run
      type(error_t), allocatable, intent(out) :: error
      integer(i8) :: n
      integer :: k, status

      run%real_columns = pack([(k, k=1, size(row_reals))], real_groups == "boulder" &
                              .or. (real_groups == "energy" .and. case%energy_balance) &
                              .or. (real_groups == "mass" .and. (features .or. case%source_density)) &
                              .or. (real_groups == "shadow" .and. case%shadow_angle) &
                              .or. (real_groups == "breakage" .and. allocated(case%breakage)))
      run%integer_columns = pack([(k, k=1, size(row_integers))], integer_groups == "boulder" &
                                 .or. (integer_groups == "feature" .and. features) &
                                 .or. (integer_groups == "shape" .and. shapes) &
                                 .or. (integer_groups == "tree" .and. case%forest) &
                                 .or. (integer_groups == "breakage" .and. allocated(case%breakage)))
      run%histograms_requested = case%rebounds
      allocate (run%by_ground(grounds), source=0_i8)
      n = run%boulders
      if (allocated(run%number)) n = size(run%number, kind=i8)
      allocate (run%reals(n, size(run%real_columns)), run%status(n), run%integers(n, size(run%integer_columns)), &
                stat=status)
      if (status /= 0) call report_memory(run, error)
      run%lines = size(case%lines)
      call start_rows(allocated(case%breakage), any(case%lines%height > 0), run%crossings)
   end subroutine allocate_rows

   !> Allocate empty maps, and samples if not all rows are kept.
   subroutine allocate_tallies(run, error)
      type(run_t), intent(inout) :: run
      type(error_t), allocatable, intent(out) :: error
      logical :: fit

      call allocate_maps(run%maps, fit)
      if (fit .and. allocated(run%number)) &
         call allocate_samples(run%samples, n_quantities, size(run%layout%part_last), size(run%layout%group_part), &
                               run%lines + 1, size(statuses), tails, run%total, run%sampled, fit)
      if (.not. fit) call report_memory(run, error)
   end subroutine allocate_tallies

   subroutine report_memory(run, error)
      type(run_t), intent(in) :: run
      type(error_t), allocatable, intent(out) :: error

      call fail(error, integer_text(run%total)//" boulders and the requested maps do not fit in memory")
   end subroutine report_memory

   ! ---- boulders -----------------------------------------------------------------------------

   !> Run `chunk` boulders, every `step`-th from the first, on a scene, which may be a window of the run's terrain.
   !> Boulders that leave the window are not counted, and must be rerun. With a step above 1, which maps of sources do
   !> not allow, `done` does not change.
   subroutine advance(run, scene, first, step, chunk, seconds, n, error)
      type(run_t), intent(inout), target :: run
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: first, step, chunk
      real(wp), intent(in) :: seconds   !! time after which no more boulders start [s]
      integer(i8), intent(out) :: n     !! number of boulders run, at least one, including those that left
      type(error_t), allocatable, intent(out) :: error
      type(boulder_result_t), allocatable :: results(:)
      type(crossings_t), allocatable :: crossings(:)
      type(maps_t), allocatable :: maps(:)
      integer(i8), allocatable :: row(:)  !! row of each boulder; 0 if it has none
      integer(i8) :: k
      integer :: status, thread, threads
      logical :: fit

      n = 0
      allocate (results(chunk), crossings(chunk), row(chunk), stat=status)
      if (status /= 0) then
         call fail(error, integer_text(chunk)//" boulders of one chunk do not fit in memory")
         return
      end if
      maps = views_of_threads(run%maps, run%threads, chunk)
      call run_boulders(scene, first, step, run%threads, results, crossings, maps, run%histogram, run%by_ground, &
                        seconds, n)
      if (size(maps) > 1) call take_own_tallies(run%maps)
      if (lacks_slots(maps(1))) then
         call fail(error, "&output maps: boulders reach more than "//integer_text(size(run%maps%bin_counts, 2)) &
                   //" cells, for which quantile maps do not fit in memory: omit these maps")
         return
      end if
      run%crossed = sum(int(crossings(:n)%n, i8))
      row = 0
      do k = 1, n
         if (results(k)%status == left_window) cycle
         row(k) = row_kept(run, first + (k - 1)*step)
         if (row(k) > 0) call store_row(run, scene, results(k), row(k))
         call add_counts(run, results(k))
         if (allocated(run%number)) call add_end(run%samples, run%layout, boulder_row(scene%dem, results(k)), &
                                                 boulder_count_row(results(k)))
      end do
      if (allocated(scene%lines)) then
         call store_crossings(run, scene, first, step, results(:n), crossings(:n), row(:n), fit)
         if (.not. fit) then
            call report_memory(run, error)
            return
         end if
      end if
      if (allocated(scene%lines) .and. allocated(run%number)) then
         threads = min(team_size(run%threads), size(scene%lines))
         ! use the whole team: a smaller team would end idle threads and restart them for the next chunk
         !$omp parallel do default(none) num_threads(team_size(run%threads)) &
         !$omp& shared(run, scene, results, crossings, n, threads)
         do thread = 1, threads
            call sample_crossings(run, scene, results(:n), crossings(:n), thread, threads)
         end do
         !$omp end parallel do
      end if
      run%left = pack([(first + (k - 1)*step, k=1, n)], results(:n)%status == left_window)
      if (allocated(run%left_at)) deallocate (run%left_at)
      allocate (run%left_at(size(run%left), 2))
      run%left_at(:, 1) = pack(results(:n)%stop(1), results(:n)%status == left_window) + scene%dem%x0
      run%left_at(:, 2) = pack(results(:n)%stop(2), results(:n)%status == left_window) + scene%dem%y0
      if (step == 1) run%done = max(run%done, first + n - 1 - run%before)
   end subroutine advance

   pure subroutine add_counts(run, result)
      type(run_t), intent(inout) :: run
      type(boulder_result_t), intent(in) :: result
      integer :: counts(size(boulder_counts))

      counts = boulder_count_row(result)
      run%count = run%count + counts(size(counts) - n_totals + 1:)
   end subroutine add_counts

   !> Store the row of a boulder.
   subroutine store_row(run, scene, result, row)
      type(run_t), intent(inout) :: run
      type(scene_t), intent(in) :: scene
      type(boulder_result_t), intent(in) :: result
      integer(i8), intent(in) :: row
      real(wp) :: reals(size(row_reals))
      integer :: integers(size(row_integers))

      reals = real_row(scene%dem, result)
      integers = integer_row(scene%release, result)
      run%reals(row, :) = reals(run%real_columns)
      run%status(row) = int(result%status, i1)
      run%integers(row, :) = integers(run%integer_columns)
   end subroutine store_row

   !> Append the crossings of a chunk to the crossings of earlier chunks; only for boulders that have rows.
   subroutine store_crossings(run, scene, first, step, results, crossings, row, fit)
      type(run_t), intent(inout) :: run
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: first, step  !! number of the first boulder; step to the next
      type(boulder_result_t), intent(in) :: results(:)
      type(crossings_t), intent(in) :: crossings(:)
      integer(i8), intent(in) :: row(:)       !! row of each boulder; 0 if it has none
      logical, intent(out) :: fit
      integer(i8) :: before(size(crossings) + 1), k

      before(1) = run%crossings%n
      do k = 1, size(crossings, kind=i8)
         before(k + 1) = before(k)
         if (row(k) > 0) before(k + 1) = before(k) + count(crossings(k)%at(:crossings(k)%n)%crossed)
      end do
      associate (last => before(size(before)))
         call make_room(run%crossings, last - run%crossings%n, fit)
         if (.not. fit) return
         run%crossings%n = last
      end associate
      !$omp parallel do default(none) num_threads(team_size(run%threads)) schedule(static, at_once) &
      !$omp& shared(run, scene, first, step, results, crossings, before)
      do k = 1, size(crossings, kind=i8)
         if (before(k + 1) > before(k)) &
            call store_boulder(run%crossings, scene, first + (k - 1)*step, crossings(k), before(k))
      end do
      !$omp end parallel do
   end subroutine store_crossings

   !> Store the crossings of a boulder after the first `before` rows.
   pure subroutine store_boulder(rows, scene, number, crossings, before)
      type(crossing_rows_t), intent(inout) :: rows
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: number
      type(crossings_t), intent(in) :: crossings
      integer(i8), intent(in) :: before
      real(wp) :: values(n_reals)
      integer(i8) :: row
      integer :: j, k

      row = before
      do j = 1, crossings%n
         associate (at => crossings%at(j))
            if (.not. at%crossed) cycle
            row = row + 1
            values = crossing_row(scene%lines(at%line), at)
            rows%boulder(row) = number
            rows%line(row) = at%line - 1
            do k = 1, n_reals
               rows%real(k)%of(row) = real(values(k), sp)
            end do
            ! rounded up, so that a barrier as high as the highest crossing in a result stops that boulder
            rows%real(passing_height)%of(row) = rounded_up(values(passing_height))
            if (rows%may_break) then
               rows%volume(row) = real(at%fragment%volume, sp)
               rows%fragments(row) = at%fragments
            end if
            if (rows%may_hit) rows%outcome(row) = at%outcome
         end associate
      end do
   end subroutine store_boulder

   !> Add the boulders of a chunk to the samples of the lines assigned to one thread, line by line, because the samples
   !> of a line are contiguous in memory.
   subroutine sample_crossings(run, scene, results, crossings, thread, threads)
      type(run_t), intent(inout) :: run
      type(scene_t), intent(in) :: scene
      type(boulder_result_t), intent(in) :: results(:)
      type(crossings_t), intent(in) :: crossings(:)
      integer, intent(in) :: thread, threads   !! number of this thread, and of all threads
      integer, allocatable :: first(:), boulder(:), place(:)
      real(wp) :: radius(at_once), row(size(line_fields), at_once)  !! values of a batch of crossings
      integer :: source(at_once), line, k, m, n

      allocate (first(size(scene%lines) + 1), boulder(sum(crossings%n)), place(sum(crossings%n)))
      call sort_by_line(crossings, first, boulder, place)
      do line = thread, size(scene%lines), threads
         n = 0
         do m = first(line), first(line + 1) - 1
            k = boulder(min(m + ahead, size(boulder)))
            associate (at => crossings(k)%at(place(min(m + ahead, size(place)))))
               call prefetch(at%crossed)
               call prefetch(at%line)
            end associate
            k = boulder(m)
            associate (at => crossings(k)%at(place(m)))
               if (at%crossed .and. results(k)%status /= left_window) then
                  n = n + 1
                  radius(n) = results(k)%boulder%radius
                  source(n) = int(results(k)%source)
                  row(:, n) = line_row(scene%dem, results(k), at)
               end if
            end associate
            if (n < at_once .and. m < first(line + 1) - 1) cycle
            call add_crossings(run%samples, run%layout, line, scene%lines(line), [scene%dem%x0, scene%dem%y0], &
                               radius(:n), source(:n), row(:, :n))
            n = 0
         end do
      end do
   end subroutine sample_crossings

   !> Sort the crossings of some boulders by line, then by boulder.
   pure subroutine sort_by_line(crossings, first, boulder, place)
      type(crossings_t), intent(in) :: crossings(:)
      integer, intent(out) :: first(:)  !! first crossing of each line, and the end
      integer, dimension(:), intent(out) :: boulder, place  !! boulder of each crossing; index among its own crossings
      integer :: next(size(first)), j, k

      next = 0
      do k = 1, size(crossings)
         do j = 1, crossings(k)%n
            associate (line => crossings(k)%at(j)%line)
               next(line + 1) = next(line + 1) + 1
            end associate
         end do
      end do
      next(1) = 1
      do k = 2, size(next)
         next(k) = next(k - 1) + next(k)
      end do
      first = next
      do k = 1, size(crossings)
         do j = 1, crossings(k)%n
            associate (m => next(crossings(k)%at(j)%line))
               boulder(m) = k
               place(m) = j
               m = m + 1
            end associate
         end do
      end do
   end subroutine sort_by_line

   !> Row of a boulder; 0 if no row is kept.
   pure integer(i8) function row_kept(run, number) result(row)
      type(run_t), intent(in) :: run
      integer(i8), intent(in) :: number

      row = rows_before(run, number) + 1
      if (.not. allocated(run%number)) return
      if (row > size(run%status, kind=i8)) then
         row = 0
      else if (run%number(row) /= number) then
         row = 0
      end if
   end function row_kept

   !> Number of rows of boulders before a given boulder.
   pure integer(i8) function rows_before(run, number) result(rows)
      type(run_t), intent(in) :: run
      integer(i8), intent(in) :: number
      integer(i8) :: last, middle

      rows = number - 1 - run%before
      if (.not. allocated(run%number)) return
      rows = 0
      last = size(run%number, kind=i8)
      do while (rows < last)
         middle = (rows + last)/2
         if (run%number(middle + 1) < number) then
            rows = middle + 1
         else
            last = middle
         end if
      end do
   end function rows_before

   !> Number of rows of the completed boulders.
   pure integer(i8) function rows_of(run)
      type(run_t), intent(in) :: run

      rows_of = rows_before(run, run%before + run%done + 1)
   end function rows_of

   ! ---- arrays -------------------------------------------------------------------------------

   !> Table of all arrays of a run: rows (allocated for all boulders); sums; samples; then the stacks of maps.
   function arrays_of(run) result(table)
      type(run_t), intent(in), target :: run
      type(table_t) :: table
      integer :: k

      if (allocated(run%number)) call table%add("kept", "boulder", ["boulder"], run%number)
      do k = 1, size(run%real_columns)
         associate (column => run%real_columns(k))
            call table%add(real_groups(column), row_reals(column), ["boulder"], run%reals(:, k))
         end associate
      end do
      call table%add("boulder", "status", ["boulder"], run%status)
      do k = 1, size(run%integer_columns)
         associate (column => run%integer_columns(k))
            call table%add(integer_groups(column), row_integers(column), ["boulder"], run%integers(:, k))
         end associate
      end do
      if (run%lines > 0) call add_crossing_arrays(run%crossings, table)
      do k = 1, n_totals
         call table%add("count", boulder_counts(size(boulder_counts) - n_totals + k), [character ::], run%count(k))
      end do
      if (size(run%by_ground) > 0) call table%add("ground", "rebounds_by_ground", ["ground"], run%by_ground)
      if (run%histograms_requested) then
         do k = 1, size(histogram_fields)
            call table%add("histogram", histogram_fields(k), [trim(histogram_fields(k))//"_bin"], &
                           run%histogram(:n_bins(k), k))
         end do
      end if
      if (allocated(run%number)) call add_sample_arrays(run, table)
      call add_map_arrays(run, table)
      if (allocated(run%vertex)) then
         if (size(run%vertex) > 0) call table%add("vertex", "boulder", ["trajectory_vertex"], run%vertex_boulder)
         do k = 1, merge(size(vertex_fields), 0, size(run%vertex) > 0)
            call table%add("vertex", vertex_fields(k), ["trajectory_vertex"], run%vertex(:, k))
         end do
      end if
      call table%add("work", "crossed", ["one"], run%crossed, "i8")
      if (.not. allocated(run%left)) return
      call table%add("work", "left", ["left"], run%left, "i8")
      call table%add("work", "left_at", [character(len=4) :: "left", "axis"], run%left_at, "f8")
   end function arrays_of

   !> Add the columns of crossings.
   subroutine add_crossing_arrays(rows, table)
      type(crossing_rows_t), intent(in), target :: rows
      type(table_t), intent(inout) :: table
      integer :: k

      associate (n => rows%n)
         call table%add("crossing", "boulder", ["crossing"], rows%boulder(:n))
         call table%add("crossing", "line", ["crossing"], rows%line(:n))
         do k = 1, n_reals
            call table%add("crossing", crossing_fields(k), ["crossing"], rows%real(k)%of(:n))
         end do
         if (rows%may_break) then
            call table%add("fragment", "volume", ["crossing"], rows%volume(:n))
            call table%add("fragment", "fragments", ["crossing"], rows%fragments(:n))
         end if
         if (rows%may_hit) call table%add("hit", "outcome", ["crossing"], rows%outcome(:n))
      end associate
   end subroutine add_crossing_arrays

   subroutine add_sample_arrays(run, table)
      type(run_t), intent(in), target :: run
      type(table_t), intent(inout) :: table
      character(len=*), parameter :: blocks(*) = [character(len=15) :: "sample_fine", "sample_entry"], &
                                     coarse(*) = [character(len=15) :: "sample_coarse", "sample_quantity", &
                                                                   "sample_group", "sample_place"]

      call table%add("work", "blocks", blocks, run%samples%counts(:, :run%samples%blocks), "i4")
      call table%add("work", "groups", coarse, run%samples%groups, "i4")
      call table%add("sample", "sums", values=run%samples%sums)
      call table%add("sample", "largest", values=run%samples%largest)
      call table%add("work", "known", ["sample_line"], run%samples%known, "i4")
      call table%add("sample", "ended", values=run%samples%ended)
      call table%add("sample", "part_last", values=run%layout%part_last)
      call table%add("sample", "group_part", values=run%layout%group_part)
   end subroutine add_sample_arrays

   !> Add the stacks of maps (columns, rows, layers); files contain only cells reached by boulders. Also add, after
   !> `settle_partial_sources`, the cells of partial sources.
   subroutine add_map_arrays(run, table)
      type(run_t), intent(in), target :: run
      type(table_t), intent(inout) :: table
      character(len=*), parameter :: cells(*) = [character(len=9) :: "x", "y"]

      associate (maps => run%maps)
         if (size(maps%counts, 3) > 0) &
            call table%add("tally", "counts", [character(len=18) :: cells, "tally_counts_layer"], maps%counts)
         if (size(maps%sums, 3) > 0) &
            call table%add("tally", "sums", [character(len=16) :: cells, "tally_sums_layer"], maps%sums)
         if (size(maps%maxima, 3) > 0) &
            call table%add("tally", "maxima", [character(len=18) :: cells, "tally_maxima_layer"], maps%maxima)
         if (maps%plan%rows > 0) then
            call table%add("tally", "bin_counts", [character(len=9) :: "tally_bin", "column"], maps%bin_counts)
            call table%add("work", "column", cells, maps%column, "i4")
            call table%add("work", "columns", ["one"], maps%columns, "i4")
         end if
         if (size(maps%last_source) > 0) &
            call table%add("work", "last_source", [character(len=5) :: cells, "layer"], maps%last_source, "i4")
         if (.not. allocated(maps%shared%cell)) return
         call table%add("tally", "shared_cell", ["tally_shared"], maps%shared%cell)
         call table%add("tally", "shared_source", ["tally_shared"], maps%shared%source)
         call table%add("tally", "shared_boulders", ["tally_shared"], maps%shared%boulders)
      end associate
   end subroutine add_map_arrays

   ! ---- partial sources ----------------------------------------------------------------------

   !> Make maps count only completed boulders of partial sources (sign 1), or revert this (-1), as in map_tallies.
   subroutine settle_run(run, release, sign)
      type(run_t), intent(inout) :: run
      type(release_t), intent(in) :: release
      integer, intent(in) :: sign

      call settle_partial_sources(run%maps, release, run%before + 1, run%before + run%done, sign)
   end subroutine settle_run

   !> Restore the cells of the sources split by the completed boulders; `good` is false if they do not match.
   subroutine restore_run(run, release, good)
      type(run_t), intent(inout) :: run
      type(release_t), intent(in) :: release
      logical, intent(out) :: good

      call restore_sources(run%maps, release, run%before + 1, run%before + run%done, good)
   end subroutine restore_run
end module rockfall_run_state
