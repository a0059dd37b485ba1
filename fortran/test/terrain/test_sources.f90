! SPDX-License-Identifier: BSD-3-Clause
!> Sources from the terrain: slopes compared with thresholds, surfaces of planes, and the source of each boulder.
program test_sources
   use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan
   use rockfall_kinds, only: wp, sp, i2, i8
   use rockfall_terrain, only: terrain_t, terrain
   use rockfall_boulder, only: release_t, source_of, first_of, last_of, released_by
   use rockfall_steep_cells, only: usual_threshold, keep_steep_cells, surface_ratios
   use rockfall_shares, only: last_boulders
   use check_m, only: check, check_close, finish
   implicit none

   integer, parameter :: nx = 8, ny = 6
   real(wp), parameter :: cell = 2.5_wp, degree = acos(-1.0_wp)/180

   call test_threshold()
   call test_planes()
   call test_windows()
   call test_surfaces()
   call test_totals()
   call test_unequal()
   call test_equal()
   call finish()

contains

   !> The threshold is 55 RES**-0.075 degrees.
   subroutine test_threshold()
      real(wp), parameter :: cells(5) = [0.25_wp, 1.0_wp, 2.5_wp, 10.0_wp, 50.0_wp]
      integer :: k

      do k = 1, size(cells)
         call check_close("threshold", usual_threshold(cells(k)), 55*cells(k)**(-0.075_wp), 1.0e-14_wp)
      end do
   end subroutine test_threshold

   !> Plane that falls by `slope` to the east and equally to the north.
   pure function plane(slope) result(z)
      real(wp), intent(in) :: slope
      real(wp) :: z(nx, ny)
      integer :: i, r

      do r = 1, ny
         do i = 1, nx
            z(i, r) = 100 - slope*cell*(i - r)
         end do
      end do
   end function plane

   subroutine test_planes()
      real(wp), target :: z8(nx, ny)
      real(sp), target :: z4(nx, ny)
      integer(i2) :: cells(nx, ny), inner(nx, ny)
      integer :: k

      inner = 0
      inner(2:nx - 1, 2:ny - 1) = 1
      z8 = plane(0.5_wp)
      z4 = real(z8, sp)
      do k = -1, 1, 2
         cells = 1
         call keep_steep_cells(terrain(0.0_wp, 0.0_wp, cell, z8=z8), atan(sqrt(0.5_wp))/degree + k*1.0e-10_wp, 1, cells)
         call check("a plane in double precision", all(cells == merge(inner, 0_i2, k < 0)))
         cells = 1
         call keep_steep_cells(terrain(0.0_wp, 0.0_wp, cell, z4=z4), atan(sqrt(0.5_wp))/degree + k*1.0e-10_wp, 1, cells)
         call check("in single precision", all(cells == merge(inner, 0_i2, k < 0)))
      end do
      cells = 1
      cells(4, :) = 0
      call keep_steep_cells(terrain(0.0_wp, 0.0_wp, cell, z8=z8), 30.0_wp, 3, cells(:, 3:4))
      call check("rows in the middle, and only cells that may be", all(cells(:, 3:4) == &
                 merge(inner(:, 3:4), 0_i2, spread([1, 2, 3, 4, 5, 6, 7, 8], 2, 2) /= 4)) .and. all(cells(1, :2) == 1))
   end subroutine test_planes

   !> Cells without elevation, and their neighbours, are not sources.
   subroutine test_windows()
      real(wp), target :: z(nx, ny)
      integer(i2) :: cells(nx, ny), expected(nx, ny)

      z = plane(2.0_wp)
      z(4, 3) = ieee_value(1.0_wp, ieee_quiet_nan)
      cells = 1
      expected = 0
      expected(2:nx - 1, 2:ny - 1) = 1
      expected(3:5, 2:4) = 0
      call keep_steep_cells(terrain(0.0_wp, 0.0_wp, cell, z8=z), 45.0_wp, 1, cells)
      call check("windows with nodata", all(cells == expected))
   end subroutine test_windows

   !> The ratio is sqrt(1 + tan**2) everywhere on a plane, also at its corners.
   subroutine test_surfaces()
      real(wp), target :: z(nx, ny)
      type(terrain_t) :: dem
      real(wp) :: x(nx*ny), y(nx*ny)
      integer :: k

      do k = 1, nx*ny
         x(k) = mod(k - 1, nx)*cell
         y(k) = (k - 1)/nx*cell
      end do
      z = plane(0.5_wp)
      dem = terrain(0.0_wp, 0.0_wp, cell, z8=z)
      call check("surface of a plane", all(abs(surface_ratios(dem, x, y) - sqrt(1.5_wp)) < 1.0e-12_wp))
      z = 7
      call check("a flat has its plan area", all(abs(surface_ratios(dem, x, y) - 1) <= 0))
      z(1:2, :) = ieee_value(1.0_wp, ieee_quiet_nan)
      call check("off known terrain", all(abs(surface_ratios(dem, [0.0_wp, -5.0_wp], [0.0_wp, 1.0e9_wp]) - 1) <= 0))
   end subroutine test_surfaces

   subroutine test_totals()
      real(wp) :: ratio(1000)
      integer(i8) :: last(1000)
      integer(i8), parameter :: n(3) = [1_i8, 7_i8, 100000_i8]
      integer :: k

      call random_init(.true., .false.)
      call random_number(ratio)
      ratio = 1 + ratio
      do k = 1, 3
         last = last_boulders(ratio, n(k))
         call check_close("the total", real(last(1000), wp), n(k)*sum(ratio), 1.0_wp/(n(k)*1000))
         call check("each down or up", all(abs(last(2:) - last(:999) - n(k)*ratio(2:)) < 1))
      end do
      call check("far too many are not wrapped", all(last_boulders(ratio, 10_i8**15*9000) > 0))
   end subroutine test_totals

   !> Sources with one, no, three and one boulders.
   subroutine test_unequal()
      type(release_t) :: release
      integer(i8), parameter :: owner(5) = [1_i8, 3_i8, 3_i8, 3_i8, 4_i8]
      integer(i8) :: b

      release%last = [1_i8, 1_i8, 4_i8, 5_i8]
      call check("the source of each boulder", all([(source_of(release, b), b=1, 5)] == owner))
      call check("the first of each source", all([(first_of(release, b), b=1, 4)] == [1_i8, 2_i8, 2_i8, 5_i8]))
      call check("how many", all([(released_by(release, b), b=1, 4)] == [1_i8, 0_i8, 3_i8, 1_i8]))
   end subroutine test_unequal

   subroutine test_equal()
      type(release_t) :: release

      release%boulders_per_source = 10_i8**9
      call check("the first of a source", first_of(release, 1_i8) == 1 .and. first_of(release, 5_i8) == 4*10_i8**9 + 1)
      call check("the last", last_of(release, 5_i8) == 5*10_i8**9 .and. released_by(release, 5_i8) == 10_i8**9)
   end subroutine test_equal
end program test_sources
