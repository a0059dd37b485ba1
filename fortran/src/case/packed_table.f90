! SPDX-License-Identifier: BSD-3-Clause
!> Table of impacts as bytes, as passed to the kernel and stored in scene files (docs/impact_tables.md): a first line,
!> counts, and the concatenated arrays, in native byte order. Users have a netCDF file;
!> python/rockfall/grounds/impact_tables.py packs it.
module rockfall_packed_table
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use rockfall_kinds, only: wp, sp, i4
   use rockfall_error, only: error_t, fail
   use rockfall_impact_table, only: impact_table_t, yielding_ground_t, bins_t, index_records, record_fields, &
                                    speed_in, duration_out, pull_along, follower, map_fields, low, edge_vector
   implicit none
   private
   public :: table_start, read_packed_table

   character(len=*), parameter :: first_line = "rockfall impact table 4"//new_line("a")
   integer, parameter :: n_counts = 9   !! columns; rows; bins of flights and of rolls, three each; records
   integer, parameter :: n_scales = 8   !! inertia; rest_angle, ..., hurst of the ground
   integer, parameter :: max_bins = 100000, max_columns = 100, max_rows = 100

contains

   !> Where a packed table starts in the text of a ground; 0: it has none.
   pure integer function table_start(text)
      character(len=*), intent(in) :: text

      table_start = index(text, first_line)
   end function table_start

   !> Unpack a table. Errors: damaged.
   pure subroutine read_packed_table(text, file, table, error)
      character(len=*), intent(in) :: text
      character(len=*), intent(in) :: file  !! for messages
      type(impact_table_t), intent(out) :: table
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: scales(n_scales)
      integer :: counts(n_counts), parts, bins, bin, position, k

      position = len(first_line)
      call take_integers(text, position, counts)
      if (all(counts >= 1) .and. all(counts(:2) <= [max_columns, max_rows]) .and. all(counts(3:8) <= max_bins)) then
         parts = counts(1)*counts(2)
         bins = parts*(product(counts(3:5)) + product(counts(6:8)))
         if (expected_size(counts, bins) == len(text)) then
            allocate (table%size(counts(1)), table%relief(counts(2)))
            allocate (table%first(bins + 1), table%map(map_fields, bins), table%record(record_fields, counts(9)))
            call take_reals(text, position, table%size)
            call take_reals(text, position, table%relief)
            call take_reals(text, position, scales)
            table%inertia = scales(1)
            table%ground = yielding_ground_t(scales(2), scales(3), scales(4), scales(5), scales(6), scales(7), &
                                             scales(8))
            call take_bins(text, position, parts, counts(3:5), table%flights)
            call take_bins(text, position, parts, counts(6:8), table%rolls)
            call take_integers(text, position, table%first)
            do bin = 1, bins
               call take_reals(text, position, table%map(:, bin))
            end do
            do k = 1, counts(9)
               call take_singles(text, position, table%record(:, k))
            end do
            if (is_valid(table, counts(9), bins)) then
               call index_records(table)
               return
            end if
         end if
      end if
      call fail(error, file//": is a damaged table of impacts")
   end subroutine read_packed_table

   !> Check the assumptions of the kernel: sizes and reliefs in order, finite numbers, a record in each bin, records of
   !> a bin in order of gravity along the heading, no negative durations, and valid indices of following records.
   pure logical function is_valid(table, records, bins)
      type(impact_table_t), intent(in) :: table
      integer, intent(in) :: records, bins
      integer :: bin, columns, rows

      columns = size(table%size)
      rows = size(table%relief)
      associate (ground => table%ground)
         is_valid = all(ieee_is_finite(table%record)) .and. all(ieee_is_finite(table%map(:low, :))) &
                    .and. table%first(1) == 1 .and. table%first(bins + 1) == records + 1 &
                    .and. all(table%first(2:) > table%first(:bins)) &
                    .and. all(ieee_is_finite([table%size, table%relief, table%inertia, ground%rest_angle, &
                                              ground%strength, ground%strength_sigma, ground%strength_radius, &
                                              ground%relief, ground%relief_radius, ground%hurst])) &
                    .and. table%inertia > 0 .and. ground%rest_angle >= 0 .and. ground%strength >= 0 &
                    .and. ground%strength_sigma >= 0 .and. ground%strength_radius >= 0 .and. ground%relief >= 0 &
                    .and. ground%relief_radius > 0 .and. ground%hurst >= 0 &
                    .and. all(table%record(speed_in, :) > 0) .and. all(table%record(duration_out, :) >= 0) &
                    .and. (columns == 1 .and. .not. ground%strength > 0 .or. table%size(1) > 0) &
                    .and. all(table%size(2:) > table%size(:columns - 1)) &
                    .and. all(table%relief(2:) > table%relief(:rows - 1)) &
                    .and. all(table%record(follower, :) >= 0 .and. table%record(follower, :) <= records)
      end associate
      if (.not. is_valid) return
      do bin = 1, bins
         associate (pull => table%record(pull_along, table%first(bin):table%first(bin + 1) - 1))
            is_valid = is_valid .and. all(pull(2:) >= pull(:size(pull) - 1))
         end associate
      end do
   end function is_valid

   !> Size in bytes of a packed table, with a final newline.
   pure integer function expected_size(counts, bins) result(bytes)
      integer, intent(in) :: counts(n_counts), bins
      integer :: edges

      associate (f => counts(3:5), r => counts(6:8))
         edges = f(1) - 1 + f(1)*(f(2) - 1 + f(2)*(f(3) - 1)) + r(1) - 1 + r(1)*(r(2) - 1 + r(2)*(r(3) - 1))
      end associate
      bytes = len(first_line) + 4*(n_counts + bins + 1) + 8*(product(counts(:2))*edges + sum(counts(:2)) + n_scales) &
              + 8*bins*map_fields + 4*record_fields*counts(9) + 1
   end function expected_size

   pure subroutine take_bins(text, position, parts, n, bins)
      character(len=*), intent(in) :: text
      integer, intent(inout) :: position
      integer, intent(in) :: parts, n(3)
      type(bins_t), intent(out) :: bins
      integer :: edges(3), part, i, j

      bins%n = n
      bins%vectors = (n - 1 + edge_vector - 1)/edge_vector
      edges = bins%vectors*edge_vector
      allocate (bins%first_edge(edges(1), parts), bins%second_edge(edges(2), n(1), parts), &
                bins%third_edge(edges(3), n(2), n(1), parts), source=huge(1.0_wp))
      do part = 1, parts
         call take_reals(text, position, bins%first_edge(:n(1) - 1, part))
         do i = 1, n(1)
            call take_reals(text, position, bins%second_edge(:n(2) - 1, i, part))
            do j = 1, n(2)
               call take_reals(text, position, bins%third_edge(:n(3) - 1, j, i, part))
            end do
         end do
      end do
   end subroutine take_bins

   !> Read integers from a text: `position` is the last byte before them on entry, and their last on return.
   pure subroutine take_integers(text, position, values)
      character(len=*), intent(in) :: text
      integer, intent(inout) :: position
      integer, intent(out) :: values(:)
      integer(i4) :: integers(size(values))

      values = 0
      if (position + 4*size(values) > len(text)) return
      integers = transfer(text(position + 1:position + 4*size(values)), integers)
      values = int(integers)
      position = position + 4*size(values)
   end subroutine take_integers

   !> Read reals from a text, whose size has been checked.
   pure subroutine take_reals(text, position, values)
      character(len=*), intent(in) :: text
      integer, intent(inout) :: position
      real(wp), intent(out) :: values(:)

      values = transfer(text(position + 1:position + 8*size(values)), values)
      position = position + 8*size(values)
   end subroutine take_reals

   pure subroutine take_singles(text, position, values)
      character(len=*), intent(in) :: text
      integer, intent(inout) :: position
      real(sp), intent(out) :: values(:)

      values = transfer(text(position + 1:position + 4*size(values)), values)
      position = position + 4*size(values)
   end subroutine take_singles
end module rockfall_packed_table
