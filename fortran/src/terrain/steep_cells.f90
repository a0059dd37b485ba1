! SPDX-License-Identifier: BSD-3-Clause
!> Cells as steep as rock faces, and surface areas of cells.
module rockfall_steep_cells
   use, intrinsic :: ieee_arithmetic, only: ieee_is_nan, ieee_value, ieee_quiet_nan
   use rockfall_kinds, only: wp, i2
   use rockfall_math, only: exponential, logarithm, tangent
   use rockfall_terrain, only: terrain_t, patch_t, locate, read_patch, gradient, cell_of, cell_descent
   implicit none
   private
   public :: usual_threshold, keep_steep_cells, surface_ratios

contains

   !> Slope threshold [degree] of sources for a cell size, 55 RES**-0.075: faces appear flatter with larger cells
   !> (practice of Rockyfor3D; Dorren 2016, v5.2 revealed, ecorisQ).
   pure real(wp) function usual_threshold(cell) result(slope)
      real(wp), intent(in) :: cell  !! [m]

      slope = 55*exponential(-0.075_wp*logarithm(cell))
   end function usual_threshold

   !> Set positive cells, from row `first` on, to 1 if they are at least as steep as a threshold (Horn 1981), and to 0
   !> if they are flatter or have an incomplete 3x3 window.
   pure subroutine keep_steep_cells(dem, threshold, first, cells)
      type(terrain_t), intent(in) :: dem
      real(wp), intent(in) :: threshold      !! [degree]
      integer, intent(in) :: first           !! row of cells(:, 1), counted from 1 in the north
      integer(i2), intent(inout) :: cells(:, :)
      type(patch_t) :: patch
      real(wp) :: min_tangent, missing(2), descent(2)
      logical :: pit
      integer :: i, r

      min_tangent = tangent(threshold)
      missing = ieee_value(min_tangent, ieee_quiet_nan)
      do r = first, first + size(cells, 2) - 1
         do i = 1, size(cells, 1)
            associate (cell => cells(i, r - first + 1))
               if (cell <= 0) cycle
               cell = 0
               call read_patch(dem, i, dem%ny + 1 - r, patch)  ! Horn's method does not use the cell itself
               if (.not. patch%known) cycle
               call cell_descent(dem, [i, r], missing, descent, pit)
               if (ieee_is_nan(descent(1))) cycle
               if (sqrt(descent(1)**2 + descent(2)**2) >= min_tangent) cell = 1
            end associate
         end do
      end do
   end subroutine keep_steep_cells

   !> Ratio of surface to plan area for the cells of sources, sqrt(1 + tan**2) [-] by Horn (1981). If the 3x3 window is
   !> incomplete, the gradient of the patch at the source is used, as in cell_descent. The ratio is 1 outside the known
   !> terrain, where sources are not allowed.
   pure function surface_ratios(dem, x, y) result(ratio)
      type(terrain_t), intent(in) :: dem
      real(wp), intent(in) :: x(:), y(:)  !! local coordinates [m]
      real(wp) :: ratio(size(x))
      type(patch_t) :: patch
      real(wp) :: u, w, descent(2)
      logical :: pit
      integer :: k

      ratio = 1
      do k = 1, size(x)
         call locate(dem, x(k), y(k), patch, u, w)
         if (.not. patch%known) cycle
         call cell_descent(dem, cell_of(dem, patch, u, w), gradient(dem, patch, u, w), descent, pit)
         ratio(k) = sqrt(1 + descent(1)**2 + descent(2)**2)
      end do
   end function surface_ratios
end module rockfall_steep_cells
