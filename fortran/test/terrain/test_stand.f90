! SPDX-License-Identifier: BSD-3-Clause
!> Trees from stems per hectare: numbers follow their distributions, and depend only on the seed and the cell.
program test_stand
   use rockfall_kinds, only: wp, i8
   use rockfall_random, only: random_key
   use rockfall_stand, only: stems_in_cell, stem_numbers
   use check_m, only: check, finish
   implicit none

   call test_poisson(0.3_wp)
   call test_poisson(3.7_wp)
   call test_poisson(40.0_wp)
   call test_poisson(700.0_wp)
   call test_even()
   call test_places()
   call finish()

contains

   !> Mean and variance of a Poisson number are equal, within 4 standard errors over n cells.
   subroutine test_poisson(expected)
      real(wp), intent(in) :: expected  !! [-]
      integer, parameter :: n = 40000
      real(wp), allocatable :: number(:)
      real(wp) :: mean, variance
      integer :: k

      number = [(real(stems_in_cell(random_key(7_i8), int(k, i8), expected, .false.), wp), k=1, n)]
      mean = sum(number)/n
      variance = sum((number - mean)**2)/(n - 1)
      call check("mean of a Poisson number", abs(mean - expected) < 4*sqrt(expected/n))
      call check("its variance", abs(variance - expected) < 4*sqrt((expected + 2*expected**2)/n))
   end subroutine test_poisson

   !> The number of stems is the integer part, and one more in a fraction of the cells.
   subroutine test_even()
      integer, parameter :: n = 40000
      integer, allocatable :: number(:)
      integer :: k

      number = [(stems_in_cell(random_key(7_i8), int(k, i8), 2.25_wp, .true.), k=1, n)]
      call check("2 or 3", all(number == 2 .or. number == 3))
      call check("3 in a quarter", abs(count(number == 3)/real(n, wp) - 0.25_wp) < 4*sqrt(0.25_wp*0.75_wp/n))
      number = [(stems_in_cell(random_key(7_i8), int(k, i8), 5.0_wp, .true.), k=1, n)]
      call check("whole numbers stay", all(number == 5))
      call check("none where none is expected", stems_in_cell(random_key(7_i8), 1_i8, 0.0_wp, .true.) == 0)
      call check("nor by chance", stems_in_cell(random_key(7_i8), 1_i8, 0.0_wp, .false.) == 0)
   end subroutine test_even

   !> All four numbers are uniform, and differ between neighbouring cells.
   subroutine test_places()
      integer, parameter :: n = 20000
      real(wp), allocatable :: u(:, :), v(:, :)
      real(wp) :: mean(4)
      integer :: k

      allocate (u(4, n), v(4, n))
      do k = 1, n
         u(:, k) = stem_numbers(random_key(1_i8), int(k, i8), 1)
         v(:, k) = stem_numbers(random_key(1_i8), int(k, i8), 2)
      end do
      mean = sum(u, dim=2)/n
      call check("within the cell", all(u > 0 .and. u < 1))
      call check("in its middle on average", all(abs(mean - 0.5_wp) < 4*sqrt(1/(12.0_wp*n))))
      mean = sum((u - 0.5_wp)*(v - 0.5_wp), dim=2)/n
      call check("stems of a cell are independent", all(abs(mean) < 4/(12*sqrt(real(n, wp)))))
      mean = sum((u(:, 2:) - 0.5_wp)*(u(:, :n - 1) - 0.5_wp), dim=2)/n
      call check("so are those of neighbours", all(abs(mean) < 4/(12*sqrt(real(n, wp)))))
      call check("another seed, another forest", any(abs(stem_numbers(random_key(2_i8), 5_i8, 1) - u(:, 5)) > 0))
   end subroutine test_places
end program test_stand
