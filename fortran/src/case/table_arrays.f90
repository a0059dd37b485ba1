! SPDX-License-Identifier: BSD-3-Clause
!> Impact tables as arrays of a scene (docs/files.md): each array contains the values of all tables, one table after the
!> other.
module rockfall_table_arrays
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use rockfall_kinds, only: wp, sp
   use rockfall_error, only: error_t, fail
   use rockfall_impact_table, only: impact_table_t, yielding_ground_t, bins_t, index_records, record_fields, &
                                    speed_in, duration_out, pull_along, follower, map_fields, low, edge_vector
   implicit none
   private
   public :: table_arrays_t, count_tables, take_table

   integer, parameter :: table_counts = 9   !! columns; rows; bins of flights and of rolls, three numbers each; records
   integer, parameter :: table_scales = 8   !! inertia, and the ground's properties from rest_angle to hurst
   integer, parameter :: max_bins = 100000, max_columns = 100, max_rows = 100

   !> Pointers to arrays that belong to the caller.
   type :: table_arrays_t
      integer, pointer, contiguous :: shape(:, :) => null()   !! (table_counts, tables)
      real(wp), pointer, contiguous :: scale(:, :) => null()  !! (table_scales, tables)
      real(wp), pointer, contiguous :: size(:) => null(), relief(:) => null()  !! of each column; of each row
      !> Edges of bins, for flights and then for rolls. First key: by part. Second key: by part and first bin. Third
      !> key: by part, first and second bin.
      real(wp), pointer, contiguous :: edge(:) => null()
      integer, pointer, contiguous :: first(:) => null()      !! first record of each bin, from 1, and end
      real(wp), pointer, contiguous :: map(:, :) => null()    !! (map_fields, bins)
      real(sp), pointer, contiguous :: record(:, :) => null() !! (record_fields, records)
   end type table_arrays_t

contains

   !> Number of tables; -1 if the arrays do not agree.
   pure integer function count_tables(arrays) result(tables)
      type(table_arrays_t), intent(in) :: arrays
      integer :: edges

      tables = 0
      if (.not. associated(arrays%shape)) return
      tables = -1
      if (.not. (associated(arrays%scale) .and. associated(arrays%size) .and. associated(arrays%relief) &
                 .and. associated(arrays%first) .and. associated(arrays%map) .and. associated(arrays%record))) return
      if (any([size(arrays%shape, 1), size(arrays%scale, 1), size(arrays%map, 1), size(arrays%record, 1)] &
              /= [table_counts, table_scales, map_fields, record_fields])) return
      if (any(arrays%shape < 1) .or. any(arrays%shape(3:8, :) > max_bins) &
          .or. any(arrays%shape(1, :) > max_columns .or. arrays%shape(2, :) > max_rows)) return
      edges = 0
      if (associated(arrays%edge)) edges = size(arrays%edge)
      if (size(arrays%scale, 2) == size(arrays%shape, 2) &
          .and. .not. any(abs(lengths(arrays%shape) &
                              - [size(arrays%size), size(arrays%relief), edges, size(arrays%map, 2), &
                                 size(arrays%first), size(arrays%record, 2)]) > 0)) tables = size(arrays%shape, 2)
   end function count_tables

   !> Numbers of columns, rows, edges, bins, bin ends, and records of tables. They are reals, because products of
   !> invalid numbers may have any size.
   pure function lengths(counts) result(n)
      integer, intent(in) :: counts(:, :)  !! (table_counts, tables)
      real(wp) :: n(6), c(table_counts), parts, bins
      integer :: k

      n = 0
      do k = 1, size(counts, 2)
         c = counts(:, k)
         parts = c(1)*c(2)
         bins = parts*(product(c(3:5)) + product(c(6:8)))
         n = n + [c(1), c(2), parts*(edges_of(c(3:5)) + edges_of(c(6:8))), bins, bins + 1, c(9)]
      end do
   end function lengths

   pure real(wp) function edges_of(n)
      real(wp), intent(in) :: n(3)

      edges_of = n(1) - 1 + n(1)*(n(2) - 1 + n(2)*(n(3) - 1))
   end function edges_of

   !> Extract table k from arrays of consistent lengths. Error: the table is damaged.
   pure subroutine take_table(arrays, k, file, table, error)
      type(table_arrays_t), intent(in) :: arrays
      integer, intent(in) :: k
      character(len=*), intent(in) :: file  !! file name, for messages
      type(impact_table_t), intent(out) :: table
      type(error_t), allocatable, intent(out) :: error
      integer :: first(6), last(6), parts, edge

      first = int(lengths(arrays%shape(:, :k - 1))) + 1
      last = int(lengths(arrays%shape(:, :k)))
      associate (counts => arrays%shape(:, k), scale => arrays%scale(:, k))
         parts = product(counts(:2))
         table%size = arrays%size(first(1):last(1))
         table%relief = arrays%relief(first(2):last(2))
         table%inertia = scale(1)
         table%ground = yielding_ground_t(scale(2), scale(3), scale(4), scale(5), scale(6), scale(7), scale(8))
         edge = first(3) - 1
         call take_bins(arrays, edge, parts, counts(3:5), table%flights)
         call take_bins(arrays, edge, parts, counts(6:8), table%rolls)
         table%map = arrays%map(:, first(4):last(4))
         table%first = arrays%first(first(5):last(5))
         table%record = arrays%record(:, first(6):last(6))
      end associate
      if (is_valid(table)) then
         call index_records(table)
      else
         call fail(error, file//": is a damaged impact table")
      end if
   end subroutine take_table

   !> Check the assumptions of the kernel: increasing sizes and reliefs, finite numbers, a record in each bin, records
   !> sorted by gravity along the heading, no negative durations, and valid indices of following records.
   pure logical function is_valid(table)
      type(impact_table_t), intent(in) :: table
      integer :: bin, bins, columns, records, rows

      columns = size(table%size)
      rows = size(table%relief)
      bins = size(table%map, 2)
      records = size(table%record, 2)
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

   !> Extract the bins of one kind of contact, whose edges follow the first `edge`.
   pure subroutine take_bins(arrays, edge, parts, n, bins)
      type(table_arrays_t), intent(in) :: arrays
      integer, intent(inout) :: edge
      integer, intent(in) :: parts, n(3)
      type(bins_t), intent(out) :: bins
      integer :: room(3), part, i, j

      bins%n = n
      bins%vectors = (n - 1 + edge_vector - 1)/edge_vector
      room = bins%vectors*edge_vector
      allocate (bins%first_edge(room(1), parts), bins%second_edge(room(2), n(1), parts), &
                bins%third_edge(room(3), n(2), n(1), parts), source=huge(1.0_wp))
      do part = 1, parts
         call take(arrays, edge, bins%first_edge(:n(1) - 1, part))
      end do
      do part = 1, parts
         do i = 1, n(1)
            call take(arrays, edge, bins%second_edge(:n(2) - 1, i, part))
         end do
      end do
      do part = 1, parts
         do i = 1, n(1)
            do j = 1, n(2)
               call take(arrays, edge, bins%third_edge(:n(3) - 1, j, i, part))
            end do
         end do
      end do
   end subroutine take_bins

   pure subroutine take(arrays, edge, values)
      type(table_arrays_t), intent(in) :: arrays
      integer, intent(inout) :: edge
      real(wp), intent(inout) :: values(:)

      if (size(values) == 0) return
      values = arrays%edge(edge + 1:edge + size(values))
      edge = edge + size(values)
   end subroutine take
end module rockfall_table_arrays
