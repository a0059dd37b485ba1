! SPDX-License-Identifier: BSD-3-Clause
!> Elementary functions compared with those of the compiler, in units in the last place.
program test_math
   use, intrinsic :: iso_fortran_env, only: real128
   use rockfall_kinds, only: wp, sp
   use rockfall_math, only: pi, degree, logarithm, exponential, cube_root, sine_cosine, squared_sine, tangent, &
                            arcsine, rounded_up
   use check_m, only: check, check_close, finish
   implicit none

   call random_init(.true., .false.)
   call test_constants()
   call test_logarithm()
   call test_exponential()
   call test_cube_root()
   call test_sine_cosine()
   call test_squared_sine()
   call test_tangent()
   call test_arcsine()
   call test_rounded_up()
   call finish()

contains

   !> Difference of `got` from `want`, in units in the last place of `want`.
   elemental real(wp) function units(got, want)
      real(wp), intent(in) :: got
      real(real128), intent(in) :: want

      units = real(abs(got - want)/spacing(real(want, wp)), wp)
   end function units

   subroutine test_tangent()
      real(wp) :: slope
      integer :: k

      do k = 0, 890
         slope = 0.1_wp*k
         call check_close("tangent", tangent(slope), tan(slope*degree), 4.0e-15_wp*(1 + 90/(90 - slope)))
      end do
      call check("45 degrees", tangent(45.0_wp) >= 1 .and. tangent(45.0_wp) <= 1)
      call check("0 degrees", abs(tangent(0.0_wp)) <= 0)
      call check("both ways of the tangent meet", tangent(nearest(22.5_wp, -1.0_wp)) < tangent(22.5_wp + 1.0e-12_wp))
   end subroutine test_tangent

   subroutine test_constants()
      call check_close("pi", pi, acos(-1.0_wp), 0.0_wp)
      call check_close("180 degrees", 180*degree, pi, 2.0e-16_wp)
   end subroutine test_constants

   subroutine test_arcsine()
      real(wp) :: x, far
      integer :: k

      far = 0
      do k = -100000, 100000
         x = k/100000.0_wp
         far = max(far, real(abs(arcsine(x) - asin(real(x, real128))), wp))
      end do
      call check("arcsine within 2e-15 rad", far < 2.0e-15_wp)
      call check_close("all beyond is vertical", arcsine(1 + 1.0e-9_wp), pi/2, 3.0e-16_wp)
   end subroutine test_arcsine

   subroutine test_logarithm()
      real(wp) :: x, worst, step
      integer :: k

      worst = 0
      do k = 1, 200000
         call random_number(step)
         x = scale(0.5_wp + 1.5_wp*step, mod(k, 2001) - 1000)
         if (mod(k, 2) == 0) x = 0.5_wp + 1.5_wp*step  ! near 1, where the logarithm changes its sign
         worst = max(worst, units(logarithm(x), log(real(x, real128))))
      end do
      call check("logarithm within 5 units", worst < 5)
      call check_close("logarithm of 1", logarithm(1.0_wp), 0.0_wp, 0.0_wp)
      call check_close("logarithm of the smallest", logarithm(tiny(x)), log(tiny(x)), 3.0e-16_wp)
      call check_close("logarithm of the largest", logarithm(huge(x)), log(huge(x)), 3.0e-16_wp)
   end subroutine test_logarithm

   !> The argument reduction by k ln 2 loses up to two units for each unit of x.
   subroutine test_exponential()
      real(wp) :: x, worst
      integer :: k

      worst = 0
      do k = 1, 200000
         call random_number(x)
         x = (2*x - 1)*merge(699.0_wp, 3.0_wp, mod(k, 2) == 0)
         worst = max(worst, units(exponential(x), exp(real(x, real128)))/(5 + 2*abs(x)))
      end do
      call check("exponential within 5 + 2|x| units", worst < 1)
      call check_close("exponential of 0", exponential(0.0_wp), 1.0_wp, 0.0_wp)
   end subroutine test_exponential

   subroutine test_cube_root()
      real(wp) :: x, worst
      integer :: k

      worst = 0
      do k = 1, 100000
         call random_number(x)
         x = scale(0.5_wp + x, mod(k, 601) - 300)
         worst = max(worst, units(cube_root(x), real(x, real128)**(1/3.0_real128)))
      end do
      call check("cube root within 2 units", worst < 2)
      do k = 1, 100
         call check_close("cube root of a cube", cube_root(real(k, wp)**3), real(k, wp), 3.0e-16_wp)
      end do
   end subroutine test_cube_root

   !> Test numbers of both signs, subnormal numbers, and the neighbours of zero and of the largest number.
   subroutine test_rounded_up()
      real(wp), parameter :: special(*) = [0.0_wp, tiny(1.0_wp), -tiny(1.0_wp), 1.0e-45_wp, real(huge(1.0_sp), wp), &
                                           -0.5_wp*huge(1.0_sp)]
      real(wp) :: x
      real(sp) :: up
      logical :: least
      integer :: k

      least = .true.
      do k = 1, 100000
         if (k <= size(special)) then
            x = special(k)
         else
            call random_number(x)
            x = scale(x - 0.5_wp, mod(k, 270) - 145)
         end if
         up = rounded_up(x)
         least = least .and. up >= x .and. nearest(up, -1.0_sp) < x
      end do
      call check("no smaller number of single precision is at least as large", least)
   end subroutine test_rounded_up

   subroutine test_sine_cosine()
      real(wp) :: angle, s, c, worst(3)
      integer :: k

      worst = 0
      do k = -100000, 100000
         angle = 0.88_wp*k/100000
         call sine_cosine(angle, s, c)
         if (k /= 0) worst(1) = max(worst(1), units(s, sin(real(angle, real128))))
         worst(2) = max(worst(2), units(c, cos(real(angle, real128))))
         worst(3) = max(worst(3), abs(s*s + c*c - 1))
      end do
      call check("sine within 4 units", worst(1) < 4)
      call check("cosine within 4 units", worst(2) < 4)
      call check("sine and cosine make a unit vector", worst(3) < 1.0e-15_wp)
      call sine_cosine(0.0_wp, s, c)
      call check("no turn is no turn", abs(s) <= 0 .and. abs(c - 1) <= 0)
   end subroutine test_sine_cosine

   subroutine test_squared_sine()
      real(wp) :: degrees, off
      integer :: k

      off = 0
      do k = 0, 9000
         degrees = 0.01_wp*k
         off = max(off, abs(squared_sine(degrees) - sin(degrees*degree)**2))
      end do
      call check("squared sine within 4 roundings", off < 4*epsilon(off))
      call check("exact at both ends", abs(squared_sine(0.0_wp)) <= 0 .and. abs(squared_sine(90.0_wp) - 1) <= 0)
   end subroutine test_squared_sine
end program test_math
