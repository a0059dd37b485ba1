! SPDX-License-Identifier: BSD-3-Clause
!> Geometry of a raster.
module rockfall_grid
   use rockfall_kinds, only: wp
   implicit none
   private
   public :: grid_t, is_outside

   !> North-up raster of square cells; row 1 is the northernmost and x varies fastest, as in files.
   type :: grid_t
      real(wp) :: west = 0.0_wp, north = 0.0_wp  !! outer edges of the raster [m]
      real(wp) :: cell = 1.0_wp                  !! cell size [m]
      integer :: nx = 0, ny = 0                  !! columns, rows
   end type grid_t

contains

   !> Return whether points, and all points between them, are on the outer side of one edge of the raster.
   pure logical function is_outside(grid, x, y)
      type(grid_t), intent(in) :: grid
      real(wp), intent(in) :: x(:), y(:)  !! map coordinates [m]

      is_outside = maxval(x) < grid%west .or. minval(x) > grid%west + grid%nx*grid%cell .or. &
                   maxval(y) < grid%north - grid%ny*grid%cell .or. minval(y) > grid%north
   end function is_outside
end module rockfall_grid
