! SPDX-License-Identifier: BSD-3-Clause
!> Where the cells of a raster lie.
module rockfall_grid
   use rockfall_kinds, only: wp
   implicit none
   private
   public :: grid_t, is_outside

   !> North-up, square cells; row 1 is the northernmost and x runs fastest, as in files.
   type :: grid_t
      real(wp) :: west = 0.0_wp, north = 0.0_wp  !! outer edges of the raster [m]
      real(wp) :: cell = 1.0_wp                  !! edge of a cell [m]
      integer :: nx = 0, ny = 0                  !! columns, rows
   end type grid_t

contains

   !> Whether points, and all between them, lie beyond one side of the cells.
   pure logical function is_outside(grid, x, y)
      type(grid_t), intent(in) :: grid
      real(wp), intent(in) :: x(:), y(:)  !! map coordinates [m]

      is_outside = maxval(x) < grid%west .or. minval(x) > grid%west + grid%nx*grid%cell .or. &
                   maxval(y) < grid%north - grid%ny*grid%cell .or. minval(y) > grid%north
   end function is_outside
end module rockfall_grid
