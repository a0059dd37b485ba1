! SPDX-License-Identifier: BSD-3-Clause
!> Spatial index of many lines: a grid of buckets lists the lines that touch each bucket, so that a path is compared
!> with few lines.
module rockfall_line_index
   use rockfall_kinds, only: wp
   use rockfall_line, only: line_t
   implicit none
   private
   public :: line_index_t, line_index, buckets_of, is_near_lines, worth_indexing

   integer, parameter :: worth_indexing = 12  !! number of lines from which an index is faster than testing all lines
   integer, parameter :: max_buckets = 256    !! maximum number of buckets along each axis
   real(wp), parameter :: margin = 1.0e-6_wp  !! lines are widened by this margin, against rounding [buckets]

   !> Lines in buckets.
   type :: line_index_t
      real(wp) :: low(2) = 0.0_wp        !! south-west corner [m]
      real(wp) :: per_bucket(2) = 0.0_wp !! inverse size of a bucket [1/m]
      integer :: n(2) = 1                !! buckets along each axis
      integer, allocatable :: first(:)   !! first element of `line` for each bucket, row by row eastward; then the end
      integer, allocatable :: line(:)    !! indices of lines, bucket by bucket
   end type line_index_t

contains

   !> Build the index of lines.
   pure type(line_index_t) function line_index(lines) result(index)
      type(line_t), intent(in) :: lines(:)
      integer, allocatable :: last(:)  !! last line listed in each bucket
      real(wp) :: high(2)
      integer :: k, pass, total

      index%low = huge(high)
      high = -huge(high)
      do k = 1, size(lines)
         index%low = min(index%low, lines(k)%low)
         high = max(high, lines(k)%high)
      end do
      index%n = max(1, min(max_buckets, int(4*sqrt(real(size(lines), wp)))))
      where (high > index%low)
         index%per_bucket = index%n/(high - index%low)
      else where
         index%n = 1
      end where
      allocate (index%first(product(index%n) + 1), source=0)
      do pass = 1, 2  ! count first, then store
         last = [(0, k=1, product(index%n))]
         do k = 1, size(lines)
            call list_line(lines(k), k, pass == 2, last, index)
         end do
         if (pass == 2) exit
         total = 1
         do k = 1, product(index%n)
            total = total + index%first(k)
            index%first(k) = total  ! end of the bucket; decreases to its first element while lines are stored
         end do
         index%first(size(index%first)) = total
         allocate (index%line(total - 1))
      end do
   end function line_index

   !> List a line in the buckets touched by its segments.
   pure subroutine list_line(this, number, store, last, index)
      type(line_t), intent(in) :: this
      integer, intent(in) :: number
      logical, intent(in) :: store       !! store the line; false: only count it
      integer, intent(inout) :: last(:)
      type(line_index_t), intent(inout) :: index
      real(wp) :: p(2), q(2), reach(2), from, to, t(2), x(2)
      integer :: k, j, column, bucket, rows(2), columns(2)

      reach = margin + index%per_bucket*max(0.0_wp, minval(this%x) - this%low(1))  ! half width and margin
      do k = 2, size(this%x)
         p = ([this%x(k - 1), this%y(k - 1)] - index%low)*index%per_bucket
         q = ([this%x(k), this%y(k)] - index%low)*index%per_bucket
         rows = within([min(p(2), q(2)) - reach(2), max(p(2), q(2)) + reach(2)], index%n(2))
         do j = rows(1), rows(2)
            ! the widened part of the segment in the row
            from = j - 1 - reach(2)
            to = j + reach(2)
            t = [0.0_wp, 1.0_wp]
            if (abs(q(2) - p(2)) > margin) t = max(0.0_wp, min(1.0_wp, ([from, to] - p(2))/(q(2) - p(2))))
            x = p(1) + t*(q(1) - p(1))
            columns = within([minval(x) - reach(1), maxval(x) + reach(1)], index%n(1))
            do column = columns(1), columns(2)
               bucket = column + (j - 1)*index%n(1)
               if (last(bucket) == number) cycle
               last(bucket) = number
               if (.not. store) then
                  index%first(bucket) = index%first(bucket) + 1
               else
                  index%first(bucket) = index%first(bucket) - 1
                  index%line(index%first(bucket)) = number
               end if
            end do
         end do
      end do
   end subroutine list_line

   !> First and last bucket of an interval along an axis [buckets]; positions outside are clamped to the grid.
   pure function within(interval, n) result(ends)
      real(wp), intent(in) :: interval(2)
      integer, intent(in) :: n
      integer :: ends(2)

      ends = 1 + int(max(0.0_wp, min(real(n - 1, wp), interval)))
   end function within

   !> First and last column and row of the buckets under the path from a to b.
   pure subroutine buckets_of(index, a, b, columns, rows)
      type(line_index_t), intent(in) :: index
      real(wp), intent(in) :: a(2), b(2)  !! ends of the path [m]
      integer, intent(out) :: columns(2), rows(2)
      real(wp) :: low(2), high(2)

      low = (min(a, b) - index%low)*index%per_bucket
      high = (max(a, b) - index%low)*index%per_bucket
      columns = within([low(1), high(1)], index%n(1))
      rows = within([low(2), high(2)], index%n(2))
   end subroutine buckets_of

   !> Return whether any line is listed in the buckets under the path from a to b.
   pure logical function is_near_lines(index, a, b)
      type(line_index_t), intent(in) :: index
      real(wp), intent(in) :: a(2), b(2)  !! ends of the path [m]
      integer :: columns(2), rows(2), j, row

      call buckets_of(index, a, b, columns, rows)
      is_near_lines = .false.
      do j = rows(1), rows(2)
         row = (j - 1)*index%n(1)
         is_near_lines = is_near_lines .or. index%first(row + columns(2) + 1) > index%first(row + columns(1))
      end do
   end function is_near_lines
end module rockfall_line_index
