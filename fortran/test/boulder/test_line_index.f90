! SPDX-License-Identifier: BSD-3-Clause
!> The index finds every line that a path crosses, and few others.
program test_line_index
   use rockfall_kinds, only: wp
   use rockfall_line, only: line_t, line, object_line, first_meeting
   use rockfall_line_index, only: line_index_t, line_index, buckets_of, is_near_lines
   use check_m, only: check, finish
   implicit none

   call random_init(.true., .false.)
   call test_random_lines()
   call test_parallel_lines()
   call test_degenerate()
   call finish()

contains

   !> Return whether a line is listed under a path.
   pure logical function is_listed(index, number, a, b)
      type(line_index_t), intent(in) :: index
      integer, intent(in) :: number
      real(wp), intent(in) :: a(2), b(2)
      integer :: columns(2), rows(2), j

      call buckets_of(index, a, b, columns, rows)
      is_listed = .false.
      do j = rows(1), rows(2)
         associate (row => (j - 1)*index%n(1))
            is_listed = is_listed .or. any(index%line(index%first(row + columns(1)): &
                                                      index%first(row + columns(2) + 1) - 1) == number)
         end associate
      end do
   end function is_listed

   !> Polylines and objects of any direction; paths inside and outside the index.
   subroutine test_random_lines()
      integer, parameter :: n = 150
      type(line_t) :: lines(n)
      type(line_index_t) :: index
      real(wp) :: x(4), y(4), a(2), b(2), radius
      integer :: k, path, met, empty

      do k = 1, n
         call random_number(x)
         call random_number(y)
         x = 1000*x(1) + 60*x
         y = 500*y(1) + 60*y
         if (mod(k, 5) == 0) then
            lines(k) = object_line(x, y, 4.0_wp, 1.5_wp)
         else if (mod(k, 7) == 0) then
            lines(k) = line([0.0_wp, 1060.0_wp], y(:2))
         else
            lines(k) = line(x, y)
         end if
      end do
      index = line_index(lines)
      met = 0
      empty = 0
      do path = 1, 4000
         call random_number(a)
         call random_number(b)
         a = [1200.0_wp, 800.0_wp]*a - 100
         b = a + 40*(b - 0.5_wp)
         radius = 1.5_wp
         if (.not. is_near_lines(index, a, b)) empty = empty + 1
         do k = 1, n
            if (.not. first_meeting(lines(k), a, b, radius) <= 1) cycle
            met = met + 1
            call check("near", is_near_lines(index, a, b))
            call check("listed", is_listed(index, k, a, b))
         end do
      end do
      call check("paths meet lines", met > 500)
      call check("and some do not", empty > 500)
   end subroutine test_random_lines

   !> Of many lines, few are listed under a short path.
   subroutine test_parallel_lines()
      integer, parameter :: n = 1000
      type(line_t) :: lines(n)
      type(line_index_t) :: index
      real(wp), parameter :: a(2) = [300.0_wp, 500.2_wp], b(2) = [303.0_wp, 503.4_wp]
      integer :: k, listed

      lines = [(line([0.0_wp, 1000.0_wp], [1.0_wp*k, 1.0_wp*k]), k=1, n)]
      index = line_index(lines)
      listed = 0
      do k = 1, n
         if (is_listed(index, k, a, b)) listed = listed + 1
      end do
      call check("those that it crosses", all([(is_listed(index, k, a, b), k=501, 503)]))
      call check("few others", listed <= 20)
      call check("room for each line in each column", size(index%line) <= 2*n*index%n(1))
   end subroutine test_parallel_lines

   !> Lines without extent along an axis, or at a single point.
   subroutine test_degenerate()
      type(line_index_t) :: index
      real(wp), parameter :: zero(2) = 0.0_wp

      index = line_index([line([0.0_wp, 10.0_wp], [5.0_wp, 5.0_wp])])
      call check("flat", is_listed(index, 1, [3.0_wp, 0.0_wp], [3.0_wp, 9.0_wp]))
      index = line_index([line([5.0_wp, 5.0_wp], [0.0_wp, 10.0_wp])])
      call check("upright", is_listed(index, 1, [3.0_wp, 4.0_wp], [8.0_wp, 4.0_wp]))
      index = line_index([line(zero, zero)])
      call check("a point", is_listed(index, 1, [-1.0_wp, 0.0_wp], [1.0_wp, 0.0_wp]))
   end subroutine test_degenerate
end program test_line_index
