! SPDX-License-Identifier: BSD-3-Clause
!> State of a run: rows of its boulders, sums over them, tallies of maps. Both programs open it, advance it in chunks of
!> any order, and read its arrays through the table of `arrays_of`; without a scene it is joined from parts.
module rockfall_run_state
   use, intrinsic :: iso_c_binding, only: c_ptr, c_null_ptr, c_associated, c_f_pointer
   use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan
   use rockfall_kinds, only: wp, sp, i1, i4, i8
   use rockfall_error, only: error_t, fail
   use rockfall_text, only: integer_text
   use rockfall_scene_type, only: scene_t
   use rockfall_outcome, only: boulder_result_t, left_window
   use rockfall_crossings, only: crossings_t
   use rockfall_maps, only: maps_t, lacks_slots
   use rockfall_source_maps, only: contributing_t, contributing_cells, partial_sources, boulders_within, &
                                   first_partial, adjust_released
   use rockfall_map_values, only: map_plan_t, map_plan, stack_layers, map_views, max_columns, halvings
   use rockfall_histogram, only: bins, quantities, n_bins
   use rockfall_boulder, only: release_t
   use rockfall_variables, only: boulder_counts, line_fields, vertex_fields, histogram_fields, statuses, row_reals, &
                                 row_integers, real_groups, integer_groups
   use rockfall_rows, only: boulder_row, boulder_count_row, real_row, integer_row, line_row
   use rockfall_ensemble, only: run_boulders, recorded_boulders
   use rockfall_case_keys, only: map_names, n_maps
   use rockfall_case, only: case_t, keeps_all
   use rockfall_samples, only: merge_samples, merge_tails, samples_t, n_sample_bins, n_coarse_bins, n_words, n_largest
   use rockfall_line_samples, only: layout_t, layout_of, add_end, add_crossing, n_quantities, tails
   use rockfall_state_table, only: table_t
   use rockfall_bounds, only: boulder_count
   implicit none
   private
   public :: run_t, open_run, open_joined_run, continue_run, merge_run, close_run, advance
   public :: arrays_of, rows_of, tells_sources, no_row, map_tallies, plan_of
   public :: settle_partial_sources, restore_sources, forget_tallies

   integer(i8), parameter :: no_row = huge(1_i8)           !! number of a row that is still empty
   integer, parameter :: n_totals = size(boulder_counts) - 3  !! of boulder_counts: those summed over all boulders

   !> Tallies of maps, in stacks of layers as those of run_t.
   type :: tallies_t
      integer(i4), allocatable :: counts(:, :, :)
      integer(i8), allocatable :: sums(:, :, :)
      real(sp), allocatable :: maxima(:, :, :)
   end type tallies_t

   !> Run, or a range of its boulders. Arrays that the case does not need have size zero.
   type :: run_t
      integer(i8) :: total = 0, before = 0, boulders = 0  !! boulders of the whole run, before the range, in the range
      integer(i8) :: done = 0                             !! boulders of the range done, from its first on
      integer(i8) :: per_source = 0                       !! boulders from each source; 0: different numbers
      integer :: threads = 1
      real(wp) :: wall = 0.0_wp, cpu = 0.0_wp             !! [s]
      ! Rows: of all boulders of the range, or only of those in `number`; then all are in samples.
      integer(i8), allocatable :: number(:)
      integer, allocatable :: real_columns(:), integer_columns(:)  !! selected row_reals and row_integers
      real(wp), allocatable :: reals(:, :)                !! (rows, columns)
      integer(i1), allocatable :: status(:)
      integer(i4), allocatable :: integers(:, :)
      real(wp), allocatable :: line(:, :, :)              !! (rows, lines, line_fields)
      integer(i1), allocatable :: outcome(:, :)           !! (rows, barriers), as in crossing_t
      real(wp), allocatable :: line_volume(:, :)          !! (rows, lines), if boulders may break: of the fragment [m3]
      integer(i4), allocatable :: line_fragments(:, :)    !! (rows, lines), if they may: those that crossed
      ! Sums over the boulders done:
      integer(i8) :: count(n_totals) = 0                  !! the last of boulder_counts
      integer(i8) :: histogram(bins, quantities) = 0
      logical :: histograms_requested = .false.
      integer(i8), allocatable :: by_ground(:)            !! rebounds, if the scene has several grounds
      type(layout_t) :: layout
      type(samples_t) :: samples
      real(wp), allocatable :: vertex(:, :)               !! (vertices, vertex_fields) of recorded boulders,
      integer(i8), allocatable :: vertex_boulder(:)       !! where the run loop records them
      ! Maps of the cells of a window.
      integer :: at(2) = 1, nodes(2) = 0                  !! its first column and row; columns and rows
      logical :: map(n_maps) = .false.                    !! requested, in the order of map_names
      type(map_plan_t) :: plan                            !! where maps stand in these stacks
      real(wp), allocatable :: thresholds(:)              !! of energy [J]
      integer(i4), pointer, contiguous :: counts(:, :, :) => null()
      integer(i8), pointer, contiguous :: sums(:, :, :) => null()
      real(sp), pointer, contiguous :: maxima(:, :, :) => null()
      integer(i4), pointer, contiguous :: bin_counts(:, :) => null(), column(:, :) => null()
      integer(i4), pointer :: columns(:) => null()        !! scalar: number assigned
      integer(i4), pointer, contiguous :: last_source(:, :, :) => null()  !! as in maps_t, with its first_partial
      integer(i8) :: first_partial = 0
      type(tallies_t), allocatable :: own(:)              !! of each thread after the first, as maps_of_threads decides
      integer(i8) :: max_columns = max_columns            !! maximum for `bin_counts`
      integer :: min_passages = 1                         !! for a mean or a quantile in a cell
      type(contributing_t) :: shared                      !! cells of partial sources, set by `settle_partial_sources`
      ! Boulders of the last chunk that left the window of the terrain, and where:
      integer(i8), allocatable :: left(:)
      real(wp), allocatable :: left_at(:, :)              !! (boulders, 2), map coordinates [m]
      type(c_ptr), private :: block(12) = c_null_ptr      !! of memory
   end type run_t

   !> Tallies of threads' own: their maximum size, in all and for each boulder of a call, which takes some 30 us while
   !> these bytes are added in less than one.
   integer(i8), parameter :: max_own = 2_i8**23, own_per_boulder = 4096  !! [bytes]

   interface
      !> Zeroed memory, allocated lazily.
      type(c_ptr) function c_zeros(n, size) bind(c, name="rockfall_zeros")
         import :: c_ptr, i8
         integer(i8), value :: n, size
      end function c_zeros
      subroutine c_free(block) bind(c, name="free")
         import :: c_ptr
         type(c_ptr), value :: block
      end subroutine c_free
   end interface

contains

   !> Open a run of a scene, or of `boulders` of its boulders after the first `before`, with none done. Maps cover a
   !> window: first column and row, numbers of columns and rows.
   subroutine open_run(case, scene, before, boulders, window, run, error)
      type(case_t), intent(in) :: case
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: before, boulders
      integer, intent(in) :: window(4)
      type(run_t), intent(inout) :: run
      type(error_t), allocatable, intent(out) :: error

      call set_dimensions(case, scene, before, boulders, window, run)
      call allocate_rows(case, n_grounds(scene), allocated(scene%release%feature), run, error)
      if (.not. allocated(error)) call allocate_tallies(run, error)
   end subroutine open_run

   !> Set the dimensions of a run from its scene.
   subroutine set_dimensions(case, scene, before, boulders, window, run)
      type(case_t), intent(in) :: case
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: before, boulders
      integer, intent(in) :: window(4)
      type(run_t), intent(inout) :: run

      run%total = boulder_count(scene)
      run%before = before
      run%boulders = boulders
      run%at = window(:2)
      run%nodes = window(3:)
      if (case%kept /= keeps_all) then
         run%number = recorded_boulders(scene%release, case%kept, before + 1, before + boulders)
         run%layout = layout_of(scene%release, size(case%lines) + 1)
      end if
      call set_case(case, run)
      if (tells_sources(run)) run%first_partial = first_partial(scene%release, before + 1)
   end subroutine set_dimensions

   !> Set what a run needs of its case.
   subroutine set_case(case, run)
      type(case_t), intent(in) :: case
      type(run_t), intent(inout) :: run

      run%per_source = merge(0_i8, case%boulders, case%by_area)
      run%map = case%map
      run%plan = plan_of(case)
      run%thresholds = case%thresholds
      run%min_passages = case%min_passages
   end subroutine set_case

   !> Tallies that the maps of a case need.
   pure type(map_plan_t) function plan_of(case) result(plan)
      type(case_t), intent(in) :: case

      plan = map_plan(pack(map_names, case%map), size(case%thresholds))
   end function plan_of

   !> Return whether maps of a run need the source of each boulder.
   pure logical function tells_sources(run)
      type(run_t), intent(in) :: run

      tells_sources = any(run%plan%count(3:4) > 0)
   end function tells_sources

   !> Open a run without a scene: one to be joined from parts, whose rows may arrive in any order, or a part.
   subroutine open_joined_run(case, total, before, boulders, window, grounds, features, layout, run, error)
      type(case_t), intent(in) :: case
      integer(i8), intent(in) :: total             !! boulders of the complete run
      integer(i8), intent(in) :: before, boulders  !! of the part: before it, and in it
      integer, intent(in) :: window(4)
      integer, intent(in) :: grounds   !! number of grounds; 0: only the impact sets
      logical, intent(in) :: features  !! sources come from the features of a layer
      type(layout_t), intent(in) :: layout  !! layout of samples
      type(run_t), intent(inout) :: run
      type(error_t), allocatable, intent(out) :: error

      run%total = total
      run%before = before
      run%boulders = boulders
      run%done = boulders
      run%at = window(:2)
      run%nodes = window(3:)
      run%layout = layout
      if (case%kept /= keeps_all) allocate (run%number(min(case%kept, boulders)), source=no_row)
      call set_case(case, run)
      if (tells_sources(run)) allocate (run%shared%cell(0), run%shared%source(0), run%shared%boulders(0))
      call allocate_rows(case, grounds, features, run, error)
      if (.not. allocated(error)) call allocate_tallies(run, error)
   end subroutine open_joined_run

   !> Open a run of a scene that continues another one, whose boulders are its first; tallies are moved, so the other
   !> run cannot continue itself.
   subroutine continue_run(case, scene, other, run, error)
      type(case_t), intent(in) :: case
      type(scene_t), intent(in) :: scene
      type(run_t), intent(inout) :: other
      type(run_t), intent(inout) :: run
      type(error_t), allocatable, intent(out) :: error

      call set_dimensions(case, scene, other%before, boulder_count(scene) - other%before, [other%at, other%nodes], run)
      call allocate_rows(case, n_grounds(scene), allocated(scene%release%feature), run, error)
      if (allocated(error)) return
      call copy_rows(run, 0_i8, other)
      run%count = other%count
      run%histogram = other%histogram
      run%by_ground = other%by_ground
      run%done = other%done
      run%threads = other%threads
      run%counts => other%counts
      run%sums => other%sums
      run%maxima => other%maxima
      run%bin_counts => other%bin_counts
      run%column => other%column
      run%columns => other%columns
      run%last_source => other%last_source
      run%samples = other%samples
      run%block(:11) = other%block(:11)
      other%block(:11) = c_null_ptr
      if (allocated(run%number)) call allocate_largest(run, error)
      if (.not. allocated(error) .and. allocated(run%number)) &
         call merge_tails(run%samples%largest, other%samples%largest)
   end subroutine continue_run

   !> Add a part to a run. Where not all rows are kept, those of the part follow those of earlier arrivals.
   subroutine merge_run(run, part, error)
      type(run_t), intent(inout) :: run
      type(run_t), intent(in) :: part
      type(error_t), allocatable, intent(out) :: error
      integer(i8) :: row, n

      n = rows_of(part)
      row = part%before - run%before
      if (allocated(run%number)) row = rows_of(run)
      if (row + n > size(run%status, kind=i8)) then
         call fail(error, "a run of "//integer_text(run%total)//" boulders has no more rows to be merged")
         return
      end if
      if (allocated(run%number)) run%number(row + 1:row + n) = part%number(:n)
      call copy_rows(run, row, part)
      run%count = run%count + part%count
      run%histogram = run%histogram + part%histogram
      run%by_ground = run%by_ground + part%by_ground
      if (allocated(run%number)) call merge_samples(run%samples, part%samples)
      call merge_maps(run, part, error)
   end subroutine merge_run

   !> Copy the rows of another run, after the first `row` rows.
   pure subroutine copy_rows(run, row, other)
      type(run_t), intent(inout) :: run
      integer(i8), intent(in) :: row
      type(run_t), intent(in) :: other

      associate (n => rows_of(other))
         run%reals(row + 1:row + n, :) = other%reals(:n, :)
         run%status(row + 1:row + n) = other%status(:n)
         run%integers(row + 1:row + n, :) = other%integers(:n, :)
         run%line(row + 1:row + n, :, :) = other%line(:n, :, :)
         run%outcome(row + 1:row + n, :) = other%outcome(:n, :)
         run%line_volume(row + 1:row + n, :) = other%line_volume(:n, :)
         run%line_fragments(row + 1:row + n, :) = other%line_fragments(:n, :)
      end associate
   end subroutine copy_rows

   !> Add the tallies of a part to those of the same cells; memory of cells without any remains untouched.
   subroutine merge_maps(run, part, error)
      type(run_t), intent(inout) :: run
      type(run_t), intent(in) :: part
      type(error_t), allocatable, intent(out) :: error
      integer :: i, j

      do j = 1, run%nodes(2)
         call add_row(j, part%counts, part%sums, part%maxima, run)
         do i = 1, merge(run%nodes(1), 0, size(part%column) > 0)
            if (part%column(i, j) == 0) cycle
            if (run%column(i, j) == 0) then
               if (run%columns(1) == size(run%bin_counts, 2)) then
                  call fail(error, "the counts of quantile maps do not fit in memory")
                  return
               end if
               run%columns = run%columns + 1
               run%column(i, j) = run%columns(1)
            end if
            associate (counts => run%bin_counts(:, run%column(i, j)))
               counts = counts + part%bin_counts(:, part%column(i, j))
            end associate
         end do
      end do
   end subroutine merge_maps

   !> Add row j of other tallies of the same cells.
   pure subroutine add_row(j, counts, sums, maxima, run)
      integer, intent(in) :: j
      integer(i4), intent(in) :: counts(:, :, :)
      integer(i8), intent(in) :: sums(:, :, :)
      real(sp), intent(in) :: maxima(:, :, :)
      type(run_t), intent(inout) :: run
      integer :: k

      do k = 1, size(run%counts, 3)
         where (counts(:, j, k) /= 0) run%counts(:, j, k) = run%counts(:, j, k) + counts(:, j, k)
      end do
      do k = 1, size(run%sums, 3)
         where (sums(:, j, k) /= 0) run%sums(:, j, k) = run%sums(:, j, k) + sums(:, j, k)
      end do
      do k = 1, size(run%maxima, 3)
         where (maxima(:, j, k) > run%maxima(:, j, k)) run%maxima(:, j, k) = maxima(:, j, k)
      end do
   end subroutine add_row

   subroutine close_run(run)
      type(run_t), intent(inout) :: run
      integer :: k

      do k = 1, size(run%block)
         if (c_associated(run%block(k))) call c_free(run%block(k))
      end do
      run%block = c_null_ptr
   end subroutine close_run

   !> Free the tallies and samples of a run, once all results are computed; counts, sums and maxima of maps only where
   !> `free_maps` is true. Views of other arrays remain valid.
   subroutine forget_tallies(run, free_maps)
      type(run_t), intent(inout) :: run
      logical, intent(in) :: free_maps(3)  !! counts, sums, maxima
      logical :: freed(size(run%block))
      integer :: k

      freed = [free_maps, .true., .true., .false., .true., .true., .true., .false., .false., .false.]
      do k = 1, size(run%block)
         if (.not. freed(k) .or. .not. c_associated(run%block(k))) cycle
         call c_free(run%block(k))
         run%block(k) = c_null_ptr
      end do
      if (free_maps(1)) call c_f_pointer(c_null_ptr, run%counts, [0, 0, 0])
      if (free_maps(2)) call c_f_pointer(c_null_ptr, run%sums, [0, 0, 0])
      if (free_maps(3)) call c_f_pointer(c_null_ptr, run%maxima, [0, 0, 0])
      call c_f_pointer(c_null_ptr, run%column, [0, 0])
      call c_f_pointer(c_null_ptr, run%last_source, [0, 0, 0])
      call c_f_pointer(c_null_ptr, run%bin_counts, [0, 0])
      call c_f_pointer(c_null_ptr, run%samples%bins, [0, 0, 0, 0])
      call c_f_pointer(c_null_ptr, run%samples%groups, [0, 0, 0, 0])
   end subroutine forget_tallies

   ! ---- memory -------------------------------------------------------------------------------

   !> Allocate the rows of boulders, with the columns that the case needs, and the sums.
   subroutine allocate_rows(case, grounds, features, run, error)
      type(case_t), intent(in) :: case
      integer, intent(in) :: grounds
      logical, intent(in) :: features
      type(run_t), intent(inout) :: run
      type(error_t), allocatable, intent(out) :: error
      integer(i8) :: n
      integer :: k, status

      run%real_columns = pack([(k, k=1, size(row_reals))], real_groups == "boulder" &
                              .or. (real_groups == "energy" .and. case%energy_balance) &
                              .or. (real_groups == "mass" .and. (features .or. case%source_density)) &
                              .or. (real_groups == "breakage" .and. allocated(case%breakage)))
      run%integer_columns = pack([(k, k=1, size(row_integers))], integer_groups == "boulder" &
                                 .or. (integer_groups == "feature" .and. features) &
                                 .or. (integer_groups == "tree" .and. case%forest) &
                                 .or. (integer_groups == "breakage" .and. allocated(case%breakage)))
      run%histograms_requested = case%rebounds
      allocate (run%by_ground(grounds), source=0_i8)
      n = run%boulders
      if (allocated(run%number)) n = size(run%number, kind=i8)
      allocate (run%reals(n, size(run%real_columns)), run%status(n), run%integers(n, size(run%integer_columns)), &
                run%line(n, size(case%lines), size(line_fields)), &
                run%outcome(n, count(case%lines%height > 0)), &
                run%line_volume(n, merge(size(case%lines), 0, allocated(case%breakage))), &
                run%line_fragments(n, merge(size(case%lines), 0, allocated(case%breakage))), stat=status)
      if (status /= 0) then
         call report_memory(run, error)
         return
      end if
      run%line = ieee_value(0.0_wp, ieee_quiet_nan)  ! of thousands of lines a boulder crosses few
      run%line_volume = ieee_value(0.0_wp, ieee_quiet_nan)
   end subroutine allocate_rows

   !> Empty maps, and samples where not all rows are kept.
   subroutine allocate_tallies(run, error)
      type(run_t), intent(inout) :: run
      type(error_t), allocatable, intent(out) :: error
      integer(i8) :: cells, n
      integer :: stacks(3), layers, parts, groups, places, k

      stacks = stack_layers(run%plan)
      cells = product(int(run%nodes, i8))
      layers = 0
      if (tells_sources(run)) layers = merge(2, 1, run%first_partial > 0)
      run%block(1) = zeroed_block(cells*stacks(1), 4)
      run%block(2) = zeroed_block(cells*stacks(2), 8)
      run%block(3) = zeroed_block(cells*stacks(3), 4)
      run%block(4) = zeroed_block(merge(cells, 0_i8, run%plan%rows > 0), 4)
      run%block(5) = zeroed_block(cells*layers, 4)
      run%block(6) = zeroed_block(1_i8, 4)
      associate (nx => run%nodes(1), ny => run%nodes(2))
         call c_f_pointer(run%block(1), run%counts, [nx, ny, stacks(1)])
         call c_f_pointer(run%block(2), run%sums, [nx, ny, stacks(2)])
         call c_f_pointer(run%block(3), run%maxima, [nx, ny, stacks(3)])
         call c_f_pointer(run%block(4), run%column, merge([nx, ny], 0, run%plan%rows > 0))
         call c_f_pointer(run%block(5), run%last_source, [nx, ny, layers])
         call c_f_pointer(run%block(6), run%columns, [1])
      end associate
      call allocate_bin_counts(run, merge(cells, 0_i8, run%plan%rows > 0))
      if (.not. all([(c_associated(run%block(k)), k=1, 7)])) call report_memory(run, error)
      if (allocated(error) .or. .not. allocated(run%number)) return
      parts = size(run%layout%part_last)
      groups = size(run%layout%group_part)
      places = size(run%line, 2) + 1
      n = int(n_quantities, i8)*places
      run%block(8) = zeroed_block(n_sample_bins*parts*n, 4)
      run%block(9) = zeroed_block(n_coarse_bins*groups*n, 4)
      run%block(10) = zeroed_block(n_words*parts*n, 8)
      run%block(11) = zeroed_block(size(statuses, kind=i8), 8)
      if (.not. all([(c_associated(run%block(k)), k=8, 11)])) call report_memory(run, error)
      if (allocated(error)) return
      associate (samples => run%samples)
         call c_f_pointer(run%block(8), samples%bins, [n_sample_bins, n_quantities, parts, places])
         call c_f_pointer(run%block(9), samples%groups, [n_coarse_bins, n_quantities, groups, places])
         call c_f_pointer(run%block(10), samples%sums, [n_words, n_quantities, parts, places])
         call c_f_pointer(run%block(11), samples%ended, [size(statuses)])
      end associate
      call allocate_largest(run, error)
   end subroutine allocate_tallies

   !> Allocate bin counts for all cells, or repeatedly half as many if memory is short (the run needs memory for other
   !> data too): a column uses memory only once a boulder passes the cell, and few cells may be passed.
   subroutine allocate_bin_counts(run, cells)
      type(run_t), intent(inout) :: run
      integer(i8), intent(in) :: cells
      integer(i8) :: columns
      integer :: k

      columns = min(cells, run%max_columns)
      do k = 0, halvings
         run%block(7) = zeroed_block(columns*run%plan%rows, 4)
         if (c_associated(run%block(7))) exit
         columns = columns/2
      end do
      if (k > 0 .and. c_associated(run%block(7))) then  ! and half of what fits
         call c_free(run%block(7))
         columns = columns/2
         run%block(7) = zeroed_block(columns*run%plan%rows, 4)
      end if
      call c_f_pointer(run%block(7), run%bin_counts, [int(run%plan%rows, i8), columns])
   end subroutine allocate_bin_counts

   !> Tails of samples, without a number.
   subroutine allocate_largest(run, error)
      type(run_t), intent(inout) :: run
      type(error_t), allocatable, intent(out) :: error
      integer :: shape(3)

      shape = [int(min(run%total, int(n_largest, i8))), tails, size(run%line, 2)]
      run%block(12) = zeroed_block(product(int(shape, i8)), 8)
      if (.not. c_associated(run%block(12))) call report_memory(run, error)
      if (allocated(error)) return
      call c_f_pointer(run%block(12), run%samples%largest, shape)
      run%samples%largest = -1
   end subroutine allocate_largest

   type(c_ptr) function zeroed_block(n, bytes) result(block)
      integer(i8), intent(in) :: n
      integer, intent(in) :: bytes

      block = c_zeros(max(1_i8, n), int(bytes, i8))
   end function zeroed_block

   subroutine report_memory(run, error)
      type(run_t), intent(in) :: run
      type(error_t), allocatable, intent(out) :: error

      call fail(error, integer_text(run%total)//" boulders and the requested maps do not fit in memory")
   end subroutine report_memory

   pure integer function n_grounds(scene)
      type(scene_t), intent(in) :: scene

      n_grounds = 0
      if (allocated(scene%grounds)) n_grounds = size(scene%grounds)
   end function n_grounds

   ! ---- boulders -----------------------------------------------------------------------------

   !> Run n boulders of the run, every `step`-th from the first on, on a scene, which may be a window of that of the
   !> run: boulders that leave it are not counted, and must be rerun. With a step above 1, which maps of sources do not
   !> allow, `done` does not change.
   subroutine advance(run, scene, first, step, n, error)
      type(run_t), intent(inout), target :: run
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: first, step, n
      type(error_t), allocatable, intent(out) :: error
      type(boulder_result_t), allocatable :: results(:)
      type(crossings_t), allocatable :: crossings(:)
      type(maps_t), allocatable :: maps(:)
      integer(i8) :: k, row
      integer :: status

      allocate (results(n), crossings(n), stat=status)
      if (status /= 0) then
         call fail(error, integer_text(n)//" boulders of a chunk do not fit in memory")
         return
      end if
      maps = maps_of_threads(run, n)
      call run_boulders(scene, first, step, run%threads, results, crossings, maps, run%histogram, run%by_ground)
      if (size(maps) > 1) call take_own_tallies(run)
      if (lacks_slots(maps(1))) then
         call fail(error, "&output maps: boulders reach more than "//integer_text(size(run%bin_counts, 2)) &
                   //" cells; the counts of quantile maps in more do not fit in memory")
         return
      end if
      do k = 1, n
         if (results(k)%status == left_window) cycle
         row = row_kept(run, first + (k - 1)*step)
         if (row > 0) call store_row(run, scene, results(k), crossings(k), row)
         call add_counts(run, results(k))
         if (allocated(run%number)) call add_sample(run, scene, results(k), crossings(k))
      end do
      run%left = pack([(first + (k - 1)*step, k=1, n)], results%status == left_window)
      if (allocated(run%left_at)) deallocate (run%left_at)
      allocate (run%left_at(size(run%left), 2))
      run%left_at(:, 1) = pack(results%stop(1), results%status == left_window) + scene%dem%x0
      run%left_at(:, 2) = pack(results%stop(2), results%status == left_window) + scene%dem%y0
      if (step == 1) run%done = max(run%done, first + n - 1 - run%before)
   end subroutine advance

   !> Maps to which each thread adds in a call of n boulders: its own while they are small, because threads that share
   !> them wait for each other; else the first for all. Columns of bin counts and marks of sources are shared.
   function maps_of_threads(run, n) result(maps)
      type(run_t), intent(inout), target :: run
      integer(i8), intent(in) :: n
      type(maps_t), allocatable :: maps(:)
      integer(i8) :: bytes
      logical :: share
      integer :: k

      bytes = (4*size(run%counts, kind=i8) + 8*size(run%sums, kind=i8) + 4*size(run%maxima, kind=i8))*(run%threads - 1)
      share = run%plan%rows > 0 .or. any(run%plan%count(3:4) > 0) .or. bytes > min(max_own, own_per_boulder*n)
      allocate (maps(merge(1, run%threads, share)))
      maps(1) = map_tallies(run, run%at)
      if (share) return
      if (.not. allocated(run%own)) then
         allocate (run%own(run%threads - 1))
         do k = 1, size(run%own)
            allocate (run%own(k)%counts(size(run%counts, 1), size(run%counts, 2), size(run%counts, 3)), source=0_i4)
            allocate (run%own(k)%sums(size(run%sums, 1), size(run%sums, 2), size(run%sums, 3)), source=0_i8)
            allocate (run%own(k)%maxima(size(run%maxima, 1), size(run%maxima, 2), size(run%maxima, 3)), source=0.0_sp)
         end do
      end if
      do k = 1, size(run%own)
         maps(k + 1) = map_views(run%plan, run%thresholds, run%at, run%own(k)%counts, run%own(k)%sums, &
                                 run%own(k)%maxima, run%bin_counts, run%column, run%columns(1))
      end do
   end function maps_of_threads

   !> Move what threads added to their own tallies to those of the run.
   subroutine take_own_tallies(run)
      type(run_t), intent(inout) :: run
      integer :: k, j

      do k = 1, size(run%own)
         associate (own => run%own(k))
            do j = 1, run%nodes(2)
               call add_row(j, own%counts, own%sums, own%maxima, run)
            end do
            own%counts = 0
            own%sums = 0
            own%maxima = 0
         end associate
      end do
   end subroutine take_own_tallies

   pure subroutine add_counts(run, result)
      type(run_t), intent(inout) :: run
      type(boulder_result_t), intent(in) :: result
      integer :: counts(size(boulder_counts))

      counts = boulder_count_row(result)
      run%count = run%count + counts(size(counts) - n_totals + 1:)
   end subroutine add_counts

   !> Store the rows of a boulder.
   subroutine store_row(run, scene, result, crossings, row)
      type(run_t), intent(inout) :: run
      type(scene_t), intent(in) :: scene
      type(boulder_result_t), intent(in) :: result
      type(crossings_t), intent(in) :: crossings
      integer(i8), intent(in) :: row
      real(wp) :: reals(size(row_reals))
      integer :: integers(size(row_integers)), k

      reals = real_row(scene%dem, result)
      integers = integer_row(scene%release, result)
      run%reals(row, :) = reals(run%real_columns)
      run%status(row) = int(result%status, i1)
      run%integers(row, :) = integers(run%integer_columns)
      run%outcome(row, :) = 0
      run%line_fragments(row, :) = 0
      do k = 1, crossings%n
         associate (at => crossings%at(k))
            if (at%outcome /= 0) run%outcome(row, findloc(scene%barriers%line, at%line, dim=1)) = at%outcome
            run%line(row, at%line, :) = line_row(scene%dem, result, at)
            if (at%fragments == 0) cycle
            run%line_volume(row, at%line) = at%fragment%volume
            run%line_fragments(row, at%line) = at%fragments
         end associate
      end do
   end subroutine store_row

   !> Add a boulder to the samples.
   subroutine add_sample(run, scene, result, crossings)
      type(run_t), intent(inout) :: run
      type(scene_t), intent(in) :: scene
      type(boulder_result_t), intent(in) :: result
      type(crossings_t), intent(in) :: crossings
      integer :: k

      associate (origin => [scene%dem%x0, scene%dem%y0], row => boulder_row(scene%dem, result))
         call add_end(run%samples, run%layout, row, boulder_count_row(result))
         do k = 1, crossings%n
            associate (at => crossings%at(k))
               if (at%crossed) call add_crossing(run%samples, run%layout, at%line, scene%lines(at%line), origin, row, &
                                                 int(result%source), line_row(scene%dem, result, at))
            end associate
         end do
      end associate
   end subroutine add_sample

   !> Row of a boulder; 0: it is not kept.
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

   !> Number of rows of the boulders before a given one.
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

   !> Number of rows of the boulders done.
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
      if (size(run%line, 2) > 0) then
         do k = 1, size(line_fields)
            call table%add("line", line_fields(k), [character(len=7) :: "boulder", "line"], run%line(:, :, k))
         end do
      end if
      if (size(run%line_volume, 2) > 0) then
         call table%add("fragment", "volume", [character(len=7) :: "boulder", "line"], run%line_volume)
         call table%add("fragment", "fragments", [character(len=7) :: "boulder", "line"], run%line_fragments)
      end if
      if (size(run%outcome, 2) > 0) &
         call table%add("barrier", "outcome", [character(len=7) :: "boulder", "barrier"], run%outcome)
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
      if (.not. allocated(run%left)) return
      call table%add("work", "left", ["left"], run%left, "i8")
      call table%add("work", "left_at", [character(len=4) :: "left", "axis"], run%left_at, "f8")
   end function arrays_of

   subroutine add_sample_arrays(run, table)
      type(run_t), intent(in), target :: run
      type(table_t), intent(inout) :: table
      character(len=*), parameter :: by(*) = [character(len=15) :: "sample_quantity", "sample_part", "sample_place"]
      character(len=*), parameter :: bins(*) = [character(len=15) :: "sample_fine", by], &
                                     coarse(*) = [character(len=15) :: "sample_coarse", by(1), "sample_group", by(3)], &
                                     sums(*) = [character(len=15) :: "sample_word", by], &
                                     largest(*) = [character(len=15) :: "sample_rank", "sample_tail", "sample_line"]

      call table%add("work", "bins", bins, run%samples%bins, "i4")
      call table%add("work", "groups", coarse, run%samples%groups, "i4")
      call table%add("sample", "sums", sums, run%samples%sums)
      call table%add("sample", "largest", largest, run%samples%largest)
      call table%add("sample", "ended", ["sample_status"], run%samples%ended)
      call table%add("sample", "part_last", ["sample_part"], run%layout%part_last)
      call table%add("sample", "group_part", ["sample_group"], run%layout%group_part)
   end subroutine add_sample_arrays

   !> Add the stacks of maps (columns, rows, layers), of which files contain the cells reached by boulders; and, after
   !> `settle_partial_sources`, the cells of partial sources.
   subroutine add_map_arrays(run, table)
      type(run_t), intent(in), target :: run
      type(table_t), intent(inout) :: table
      character(len=*), parameter :: cells(*) = [character(len=9) :: "x", "y"]

      if (size(run%counts, 3) > 0) &
         call table%add("tally", "counts", [character(len=18) :: cells, "tally_counts_layer"], run%counts)
      if (size(run%sums, 3) > 0) &
         call table%add("tally", "sums", [character(len=16) :: cells, "tally_sums_layer"], run%sums)
      if (size(run%maxima, 3) > 0) &
         call table%add("tally", "maxima", [character(len=18) :: cells, "tally_maxima_layer"], run%maxima)
      if (run%plan%rows > 0) then
         call table%add("tally", "bin_counts", [character(len=9) :: "tally_bin", "column"], run%bin_counts)
         call table%add("work", "column", cells, run%column, "i4")
         call table%add("work", "columns", ["one"], run%columns, "i4")
      end if
      if (size(run%last_source) > 0) &
         call table%add("work", "last_source", [character(len=5) :: cells, "layer"], run%last_source, "i4")
      if (.not. allocated(run%shared%cell)) return
      call table%add("tally", "shared_cell", ["tally_shared"], run%shared%cell)
      call table%add("tally", "shared_source", ["tally_shared"], run%shared%source)
      call table%add("tally", "shared_boulders", ["tally_shared"], run%shared%boulders)
   end subroutine add_map_arrays

   ! ---- maps ---------------------------------------------------------------------------------

   !> View of the maps for the kernel, starting at a column and row.
   function map_tallies(run, at) result(maps)
      type(run_t), intent(in), target :: run
      integer, intent(in) :: at(2)
      type(maps_t) :: maps

      maps = map_views(run%plan, run%thresholds, at, run%counts, run%sums, run%maxima, run%bin_counts, run%column, &
                       run%columns(1))
      maps%last_source(at(1):, at(2):, 1:) => run%last_source
      maps%first_partial = run%first_partial
   end function map_tallies

   !> In the cells of partial sources, count only the boulders done (sign 1), as required for a part; these cells are
   !> stored in `shared`. Sign -1 reverts this, for a run that continues.
   subroutine settle_partial_sources(run, release, sign)
      type(run_t), intent(inout), target :: run
      type(release_t), intent(in) :: release
      integer, intent(in) :: sign
      type(maps_t) :: maps

      if (.not. tells_sources(run)) return
      maps = map_tallies(run, [1, 1])
      if (sign > 0) run%shared = contributing_cells(maps, release, run%before + 1, run%before + run%done)
      call adjust_released(maps, release, run%shared, sign)
   end subroutine settle_partial_sources

   !> Restore the cells of partial sources from `shared`, as read from a file. Not `good` unless they belong to the
   !> sources cut by the boulders done, with the correct numbers of boulders, and cells in order.
   subroutine restore_sources(run, release, good)
      type(run_t), intent(inout), target :: run
      type(release_t), intent(in) :: release
      logical, intent(out) :: good
      integer(i8), allocatable :: sources(:)
      integer :: k, n, left

      associate (shared => run%shared, first => run%before + 1, last => run%before + run%done)
         sources = partial_sources(release, first, last)
         n = size(shared%cell)
         good = all(shared%cell >= 0 .and. shared%cell < product(int(run%nodes, i8)))
         good = good .and. all(shared%source(2:) > shared%source(:n - 1) &
                               .or. (shared%source(2:) == shared%source(:n - 1) &
                                     .and. shared%cell(2:) > shared%cell(:n - 1)))
         left = n
         do k = 1, size(sources)
            left = left - count(shared%source == sources(k) &
                                .and. shared%boulders == boulders_within(release, sources(k), first, last))
         end do
         good = good .and. left == 0
         if (.not. good) return
         do k = 1, n
            associate (layer => merge(2, 1, shared%source(k) == run%first_partial), nx => int(run%nodes(1), i8))
               run%last_source(mod(shared%cell(k), nx) + 1, shared%cell(k)/nx + 1, layer) = shared%source(k)
            end associate
         end do
      end associate
      call settle_partial_sources(run, release, -1)
   end subroutine restore_sources
end module rockfall_run_state
