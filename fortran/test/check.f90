! SPDX-License-Identifier: BSD-3-Clause
!> Output of every test program: a line for each failure, a count, and the exit status.
module check_m
   use, intrinsic :: ieee_arithmetic, only: ieee_is_nan
   use rockfall_kinds, only: wp
   implicit none
   private
   public :: check, check_close, finish

   integer, save :: passed = 0, failed = 0

contains

   !> Check a condition: `ok` must be true.
   subroutine check(name, ok)
      character(len=*), intent(in) :: name
      logical, intent(in) :: ok

      if (ok) then
         passed = passed + 1
      else
         failed = failed + 1
         print "(2a)", "FAILED: ", name
      end if
   end subroutine check

   !> Check that `got` is within `relative` of `want` (absolute if `want` is zero); NaN always fails.
   subroutine check_close(name, got, want, relative)
      character(len=*), intent(in) :: name
      real(wp), intent(in) :: got, want, relative
      real(wp) :: scale
      logical :: ok

      scale = merge(abs(want), 1.0_wp, abs(want) > 0.0_wp)
      ok = .false.
      if (.not. ieee_is_nan(got)) then  ! comparing a NaN may trap
         ok = got >= want .and. got <= want
         if (max(abs(got), abs(want)) <= huge(want)) ok = abs(got - want) <= relative*scale
      end if
      call check(name, ok)
      if (.not. ok) print "(2(a, g0))", "   got ", got, ", want ", want
   end subroutine check_close

   !> Print the count. The program ends with status 1 if a check failed, or if there was none.
   subroutine finish()
      print "(i0, a, i0, a)", passed, " passed, ", failed, " failed"
      if (failed > 0 .or. passed == 0) error stop 1
   end subroutine finish
end module check_m
