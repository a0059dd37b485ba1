! SPDX-License-Identifier: BSD-3-Clause
!> Minima of blocks skip nodata, and no comparison with nodata raises a floating-point exception (which the build with
!> run-time checks would trap).
program test_reach
   use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan, ieee_get_flag, ieee_set_flag, ieee_invalid
   use rockfall_kinds, only: wp, sp
   use rockfall_terrain, only: terrain_t, terrain
   use rockfall_reach, only: block_side, update_block_minima
   use check_m, only: check, check_close, finish
   implicit none
   integer, parameter :: nx = 7, ny = 5
   real(wp), target :: z8(nx, ny)
   real(sp), target :: z4(nx, ny)
   integer :: i

   z8 = reshape([(1.5_wp*i, i=1, nx*ny)], [nx, ny])
   z8(2:6, :) = ieee_value(1.0_wp, ieee_quiet_nan)
   z4 = real(z8, sp)
   call test_minima("double", terrain(0.0_wp, 0.0_wp, 1.0_wp, z8=z8))
   call test_minima("single", terrain(0.0_wp, 0.0_wp, 1.0_wp, z4=z4))
   call finish()

contains

   subroutine test_minima(name, dem)
      character(len=*), intent(in) :: name
      type(terrain_t), intent(in) :: dem
      real(wp) :: minima(nx, ny)
      logical :: invalid

      call check("a block is a cell here", block_side([nx, ny]) == 1)
      minima = huge(minima)
      call ieee_set_flag(ieee_invalid, .false.)
      call update_block_minima(dem, 1, ny, minima)
      call ieee_get_flag(ieee_invalid, invalid)
      call check(name//": no exception", .not. invalid)
      call check_close(name//": an elevation", minima(7, 5), z8(7, 5), 0.0_wp)
      call check_close(name//": nodata is no minimum", minima(3, 2), huge(minima), 0.0_wp)
      call check(name//": all of them", count(minima < huge(minima)) == 2*ny)
   end subroutine test_minima
end program test_reach
