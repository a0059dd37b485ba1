! SPDX-License-Identifier: BSD-3-Clause
!> Part of a run as stored in files: rows and sums of the run, tallies of reached cells, and samples in non-empty bins.
!> Writing packs a run into a part; reading checks the values of a part and unpacks it into a run.
module rockfall_part
   use, intrinsic :: iso_c_binding, only: c_f_pointer
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use rockfall_kinds, only: wp, sp, i1, i4, i8
   use rockfall_error, only: error_t, fail
   use rockfall_grid, only: grid_t
   use rockfall_boulder, only: release_t, source_of
   use rockfall_crossing_rows, only: make_rows => make_room, first_unsorted
   use rockfall_variables, only: row_integers, name_in_files
   use rockfall_samples, only: samples_t, base_bits, filled_bins_t, filled_bins, fill_bins, list_blocks, find_blocks
   use rockfall_map_tallies, only: tells_sources
   use rockfall_reached_cells, only: reached_cells_t, find_reached_cells, allocate_reached_cells, pack_cells, &
                                     unpack_cells
   use rockfall_source_maps, only: contributing_t
   use rockfall_line_samples, only: layout_t
   use rockfall_state_table, only: array_t, table_t
   use rockfall_run_state, only: run_t, arrays_of, rows_of, row_kept, no_row, sort_crossings
   use rockfall_value_rules, only: value_fault
   implicit none
   private
   public :: part_t, part_lengths_t, pack_part, pack_samples, make_room, unpack_part, unpack_samples, part_arrays

   !> Arrays of a part that differ from the arrays of its run.
   type :: part_t
      integer(i8), allocatable :: number(:)            !! boulder number of each row, if not all rows are kept
      type(layout_t) :: layout                         !! layout of samples
      integer(i8), allocatable :: block(:)             !! blocks of the sample bins
      type(filled_bins_t) :: groups                    !! groups of samples
      type(reached_cells_t) :: maps
   end type part_t

   !> Lengths of the arrays of a part in a file; -1: absent.
   type :: part_lengths_t
      integer(i8) :: rows = -1, cells = -1, shared = -1, blocks = -1, group_bins = -1, crossings = -1
   end type part_lengths_t

contains

   !> Pack a run into a part, after settle_partial_sources.
   subroutine pack_part(run, part, error)
      type(run_t), intent(inout) :: run
      type(part_t), intent(inout) :: part
      type(error_t), allocatable, intent(out) :: error
      logical :: fit

      call pack_samples(run, part)
      call find_reached_cells(run%maps, part%maps)
      call allocate_reached_cells(run%maps, part%maps, fit)
      if (fit) call pack_cells(run%maps, part%maps)
      if (.not. fit) call fail(error, "the maps of a part do not fit in memory")
   end subroutine pack_part

   !> Pack the samples of a run, after sorting their counts.
   subroutine pack_samples(run, part)
      type(run_t), intent(inout) :: run
      type(part_t), intent(out) :: part

      if (.not. allocated(run%number)) return
      part%number = run%number
      part%layout = run%layout
      call list_blocks(run%samples, part%block)
      part%groups = filled_bins(size(run%samples%groups, kind=i8), run%samples%groups)
   end subroutine pack_samples

   !> Table of the arrays of a part as stored in files; more rows may be allocated than are used.
   function part_arrays(run, part) result(table)
      type(run_t), intent(in), target :: run
      type(part_t), intent(in), target :: part
      type(table_t) :: table, of_run
      integer :: k

      of_run = arrays_of(run)
      allocate (table%row(0))
      do k = 1, size(of_run%row)
         associate (row => of_run%row(k))
            if (any(row%axis(1) == [character(len=12) :: "x", "tally_bin", "sample_part", "sample_group"])) cycle
            if (all(row%variable%group /= ["work", "kept"])) table%row = [table%row, row]
         end associate
      end do
      if (allocated(part%number)) then
         call table%add("kept", "boulder", ["boulder"], part%number)
         call table%add("sample", "part_last", values=part%layout%part_last)
         call table%add("sample", "group_part", values=part%layout%group_part)
         call table%add("sample", "block", values=part%block)
         call table%add("sample", "count", values=run%samples%counts(:, :run%samples%blocks))
         call table%add("sample", "group_bin", values=part%groups%bin)
         call table%add("sample", "group_count", values=part%groups%count)
      end if
      if (.not. allocated(part%maps%cell)) return
      associate (maps => part%maps)
         call table%add("tally", "cell", ["tally"], maps%cell)
         if (size(maps%counts, 2) > 0) &
            call table%add("tally", "counts", [character(len=18) :: "tally", "tally_counts_layer"], maps%counts)
         if (size(maps%sums, 2) > 0) &
            call table%add("tally", "sums", [character(len=16) :: "tally", "tally_sums_layer"], maps%sums)
         if (size(maps%maxima, 2) > 0) &
            call table%add("tally", "maxima", [character(len=18) :: "tally", "tally_maxima_layer"], maps%maxima)
         if (size(maps%bin_counts, 1) > 0) &
            call table%add("tally", "bin_counts", [character(len=9) :: "tally_bin", "tally"], maps%bin_counts)
      end associate
   end function part_arrays

   ! ---- from a file --------------------------------------------------------------------------

   !> Allocate a part for the completed boulders of a run, to be read from a file with arrays of these lengths.
   subroutine make_room(run, part, length, error)
      type(run_t), intent(inout) :: run
      type(part_t), intent(out) :: part
      type(part_lengths_t), intent(in) :: length
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: fault
      integer(i8) :: cells
      integer :: status
      logical :: fit

      fault = ""
      cells = product(int(run%maps%nodes, i8))
      if (.not. is_between(length%cells, cells)) fault = "tally_cell"
      if (tells_sources(run%maps) .and. .not. is_between(length%shared, 2*cells)) fault = "tally_shared_cell"
      if (allocated(run%number)) then
         if (.not. is_between(length%rows, size(run%number, kind=i8))) fault = "boulder"
         if (.not. is_between(length%blocks, size(run%samples%counts, 2, i8))) fault = "sample_block"
         if (.not. is_between(length%group_bins, size(run%samples%groups, kind=i8))) fault = "sample_group_bin"
      end if
      if (run%lines > 0 .and. .not. is_between(length%crossings, run%lines*size(run%status, kind=i8))) &
         fault = "crossing_boulder"
      if (fault /= "") then
         call fail(error, "is damaged: "//fault)
         return
      end if
      allocate (part%maps%cell(length%cells), stat=status)
      fit = status == 0
      if (fit) call allocate_reached_cells(run%maps, part%maps, fit)
      if (fit .and. run%lines > 0) then
         run%crossings%n = 0
         call make_rows(run%crossings, length%crossings, fit)
         if (fit) run%crossings%n = length%crossings
      end if
      if (fit .and. allocated(run%number)) then
         part%layout = run%layout
         run%samples%blocks = int(length%blocks)
         allocate (part%number(length%rows), part%block(length%blocks), &
                   part%groups%bin(length%group_bins), part%groups%count(length%group_bins), stat=status)
      end if
      if (fit .and. status == 0 .and. tells_sources(run%maps)) then
         run%maps%shared = contributing_t()
         associate (shared => run%maps%shared, n => length%shared)
            allocate (shared%cell(n), shared%source(n), shared%boulders(n), stat=status)
         end associate
      end if
      if (.not. fit .or. status /= 0) call fail(error, "the maps of a part do not fit in memory")

   contains

      pure logical function is_between(n, most)
         integer(i8), intent(in) :: n, most

         is_between = n >= 0 .and. n <= most
      end function is_between
   end subroutine make_room

   !> Store a part in an empty run that begins with the same boulders, if its values are possible. The cells of sources
   !> split by the part must then be joined or restored.
   subroutine unpack_part(run, part, grid, error)
      type(run_t), intent(inout), target :: run
      type(part_t), intent(in), target :: part
      type(grid_t), intent(in) :: grid  !! grid of the terrain
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: fault
      integer(i8) :: cells

      call unpack_samples(run, part, error)
      if (allocated(error)) return
      cells = product(int(run%maps%nodes, i8))
      fault = ""
      if (.not. are_rising(part%maps%cell, cells)) fault = "tally_cell"
      if (allocated(run%maps%shared%cell)) then
         if (any(run%maps%shared%cell < 0 .or. run%maps%shared%cell >= cells)) fault = "tally_shared_cell"
      end if
      if (fault == "") fault = array_fault(run, part_arrays(run, part), grid)
      if (fault == "") fault = source_fault(run)
      if (fault == "") fault = crossing_fault(run)
      if (fault /= "") then
         call fail(error, "is damaged: "//fault)
      else if (size(part%maps%bin_counts, 2, i8) > size(run%maps%bin_counts, 2, i8)) then
         call fail(error, "the counts of quantile maps do not fit in memory")
      else
         call unpack_cells(part%maps, run%maps)
      end if
   end subroutine unpack_part

   !> Store the boulder numbers of the rows, and the samples, of a part.
   subroutine unpack_samples(run, part, error)
      type(run_t), intent(inout) :: run
      type(part_t), intent(in) :: part
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: fault

      if (.not. allocated(run%number)) return
      fault = sample_fault(run, part)
      if (fault == "") then
         call find_blocks(run%samples, part%block)
         call fill_bins(size(run%samples%groups, kind=i8), part%groups, run%samples%groups)
         if (.not. are_heaps(run%samples)) fault = "sample_largest"
      end if
      if (fault == "" .and. size(part%number) > 0) then
         associate (number => run%number(:size(part%number)))
            if (any(number /= part%number .and. number /= no_row)) fault = "boulder"
            number = part%number
         end associate
         if (.not. are_rising(part%number - run%before - 1, run%done)) fault = "boulder"
      end if
      if (fault == "" .and. rows_of(run) /= size(part%number)) fault = "boulder"
      if (fault /= "") call fail(error, "is damaged: "//fault)
   end subroutine unpack_samples

   !> Return whether numbers from 0 to n - 1 increase strictly.
   pure logical function are_rising(numbers, n)
      integer(i8), intent(in) :: numbers(:), n

      are_rising = all(numbers >= 0 .and. numbers < n) .and. all(numbers(2:) > numbers(:size(numbers) - 1))
   end function are_rising

   ! ---- values -------------------------------------------------------------------------------

   !> First sample array with values that are impossible for the completed boulders; "" if none.
   function sample_fault(run, part) result(fault)
      type(run_t), intent(in) :: run
      type(part_t), intent(in) :: part
      character(len=:), allocatable :: fault
      integer(i4), allocatable :: last(:)

      fault = ""
      associate (sums => run%samples%sums, ended => run%samples%ended)
         if (any(sums(2:, :, :, :) < 0) .or. any(shiftr(sums(2:4:2, :, :, :), base_bits) /= 0)) fault = "sample_sums"
         if (any(ended < 0) .or. sum(ended) /= run%done) fault = "sample_ended"
      end associate
      if (.not. are_rising(part%block, size(run%samples%at, kind=i8))) fault = "sample_block"
      if (.not. are_rising(part%groups%bin, size(run%samples%groups, kind=i8))) fault = "sample_group_bin"
      associate (counts => run%samples%counts(:, :run%samples%blocks))
         if (any(counts < 0 .or. counts > run%done)) fault = "sample_count"
      end associate
      if (any(part%groups%count < 1 .or. part%groups%count > run%done)) fault = "sample_group_count"
      last = [0, part%layout%part_last]
      if (any(last(2:) <= last(:size(last) - 1)) .or. any(part%layout%part_last /= run%layout%part_last)) &
         fault = "sample_part_last"
      if (any(part%layout%group_part < 1 .or. part%layout%group_part > size(part%layout%part_last)) &
          .or. any(part%layout%group_part /= run%layout%group_part)) fault = "sample_group_part"
   end function sample_fault

   !> Return whether the largest values of each tail are finite and not negative, and form a heap, as sorted values do.
   pure logical function are_heaps(samples)
      type(samples_t), intent(in) :: samples
      integer :: k, line

      are_heaps = .true.
      do line = 1, size(samples%known)
         associate (heaps => samples%largest(:samples%known(line), :, line))
            are_heaps = are_heaps .and. all(ieee_is_finite(heaps)) .and. all(heaps >= 0)
            do k = 2, size(heaps, 1)
               are_heaps = are_heaps .and. all(heaps(k, :) >= heaps(k/2, :))
            end do
         end associate
      end do
   end function are_heaps

   !> Describe the first array with values that are impossible in a run; "" if none.
   function array_fault(run, table, grid) result(fault)
      type(run_t), intent(in), target :: run
      type(table_t), intent(in) :: table
      type(grid_t), intent(in) :: grid
      character(len=:), allocatable :: fault
      integer :: k

      fault = ""
      do k = 1, size(table%row)
         associate (row => table%row(k))
            if (any(row%variable%group == ["sample", "kept  ", "vertex"]) .or. product(row%length) == 0) cycle
            fault = fault_of(row, name_in_files(row%variable))
         end associate
         if (fault /= "") return
      end do

   contains

      function fault_of(row, name) result(fault)
         type(array_t), intent(in) :: row
         character(len=*), intent(in) :: name
         character(len=:), allocatable :: fault
         integer(i1), pointer, contiguous :: i1_values(:, :)
         integer(i4), pointer, contiguous :: i4_values(:, :)
         integer(i8), pointer, contiguous :: i8_values(:, :)
         real(sp), pointer, contiguous :: f4_values(:, :)
         real(wp), pointer, contiguous :: f8_values(:, :)
         integer(i8) :: shape(2), n

         shape = [row%length(1), product(row%length(2:))]
         n = shape(1)
         if (row%axis(1) == "boulder") n = rows_of(run)
         fault = ""
         if (n == 0) return
         select case (row%kind)
         case ("i1")
            call c_f_pointer(row%at, i1_values, shape)
            fault = value_fault(name, real([minval(i1_values(:n, :)), maxval(i1_values(:n, :))], wp))
         case ("i4")
            call c_f_pointer(row%at, i4_values, shape)
            fault = value_fault(name, real([minval(i4_values(:n, :)), maxval(i4_values(:n, :))], wp))
         case ("i8")
            call c_f_pointer(row%at, i8_values, shape)
            fault = value_fault(name, real([minval(i8_values), maxval(i8_values)], wp))
         case ("f4")
            call c_f_pointer(row%at, f4_values, shape)
            fault = value_fault(name, real([minval(f4_values), maxval(f4_values)], wp))
            if (fault == "" .and. .not. all(ieee_is_finite(f4_values))) fault = name//": must be a number"
         case ("f8")
            call c_f_pointer(row%at, f8_values, shape)
            fault = value_fault(name, f8_values(:n, 1), grid)
         end select
      end function fault_of
   end function array_fault

   !> Check that crossings belong to lines of the case and to boulders with rows, each pair once; sort them.
   function crossing_fault(run) result(fault)
      type(run_t), intent(inout) :: run
      character(len=:), allocatable :: fault
      type(error_t), allocatable :: error
      integer(i8) :: k, row

      fault = ""
      associate (rows => run%crossings)
         if (rows%n == 0) return
         if (any(rows%line(:rows%n) < 0 .or. rows%line(:rows%n) >= run%lines)) fault = "crossing_line"
         do k = 1, rows%n
            row = row_kept(run, rows%boulder(k))
            if (row < 1 .or. row > rows_of(run)) fault = "crossing_boulder"
         end do
         if (fault /= "") return
         call sort_crossings(run, error)
         if (allocated(error)) then
            fault = error%message
         else if (first_unsorted(rows) <= rows%n) then
            fault = "crossing_boulder"
         end if
      end associate
   end function crossing_fault

   !> Check that boulders come from sources in order and, if each source releases the same number, from the expected
   !> source.
   function source_fault(run) result(fault)
      type(run_t), intent(in) :: run
      character(len=:), allocatable :: fault
      integer, parameter :: source = findloc(row_integers, "source", dim=1)
      type(release_t) :: release
      integer(i8) :: row, number
      logical :: good

      release%boulders_per_source = run%per_source
      associate (sources => run%integers(:rows_of(run), findloc(run%integer_columns, source, dim=1)))
         good = all(sources(2:) >= sources(:size(sources) - 1)) .and. all(sources <= run%total)
         do row = 1, merge(size(sources, kind=i8), 0_i8, run%per_source > 0)
            number = run%before + row
            if (allocated(run%number)) number = run%number(row)
            good = good .and. sources(row) == source_of(release, number)
         end do
      end associate
      fault = ""
      if (.not. good) fault = "source: must be that from which each boulder comes"
   end function source_fault
end module rockfall_part
