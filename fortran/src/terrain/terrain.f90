! SPDX-License-Identifier: BSD-3-Clause
!> Terrain on a regular raster. Elevations refer to cell centres (nodes); between four nodes the surface is bilinear: a
!> patch. Coordinates are local: x east, y north from the south-western node [m], so that large map coordinates cost no
!> precision.
module rockfall_terrain
   use rockfall_kinds, only: wp, sp
   implicit none
   private
   public :: terrain_t, patch_t, terrain, set_window, in_window, locate, patch_position, on_terrain, is_known_at, &
             read_patch, find_coefficients
   public :: fraction_of, height, height_at, node_height, gradient, slope_at, cell_of, nearest_node, cell_descent
   public :: is_within, horn, is_pit, steepness_of, max_elevation

   real(wp), parameter :: max_elevation = 1.0e7_wp  !! maximum absolute elevation; larger: undeclared nodata [m]

   !> Distance from a side of a patch within which a point counts as on it [cells]: map coordinates of 1e7 m have a
   !> resolution of 2e-9 m, so a source at a cell centre may be off by this amount.
   real(wp), parameter :: on_side = 1.0e-6_wp

   !> View of the caller's array in native precision. `z(i, r)`: column i from the west, row r from the north, as in
   !> files; NaN = no data. The array may be a window of the raster: columns, rows and coordinates refer to the complete
   !> raster, so that results do not depend on the window.
   type :: terrain_t
      integer :: nx = 0, ny = 0                           !! nodes of the raster
      integer :: lo(2) = 1, hi(2) = 0                     !! first and last patch that boulders may fly over
      real(wp) :: cell = 1.0_wp                           !! node spacing [m]
      real(wp) :: per_cell = 1.0_wp                       !! 1/cell [1/m]
      real(wp) :: x0 = 0.0_wp, y0 = 0.0_wp                !! south-western node in map coordinates [m]
      real(wp), pointer, contiguous :: z8(:, :) => null() !! elevations, double precision [m], or
      real(sp), pointer, contiguous :: z4(:, :) => null() !! single precision
   end type terrain_t

   !> Bilinear patch z(u, w) = z00 + a u + b w + c u w between nodes (i, j) and (i+1, j+1), j from the south; u, w in
   !> 0..1.
   type :: patch_t
      integer :: i = 0, j = 0
      real(wp) :: z00 = 0.0_wp, a = 0.0_wp, b = 0.0_wp, c = 0.0_wp  !! coefficients [m]
      logical :: known = .false.  !! false if a corner has no data or is outside
   end type patch_t

contains

   !> Build a terrain from the elevations of a raster whose outer north-western corner is (west, north) in map
   !> coordinates, or from a window of the raster that starts at column and row `first`.
   function terrain(west, north, cell, z8, z4, nodes, first) result(dem)
      real(wp), intent(in) :: west, north, cell                  !! [m]
      real(wp), intent(in), target, contiguous, optional :: z8(:, :)  !! exactly one of the two [m]
      real(sp), intent(in), target, contiguous, optional :: z4(:, :)  !! [m]
      integer, intent(in), optional :: nodes(2), first(2)        !! nodes of the full raster; first node of the window
      type(terrain_t) :: dem
      integer :: from(2), across(2)

      from = 1
      if (present(first)) from = first
      if (present(z8)) then
         dem%z8(from(1):, from(2):) => z8
         across = shape(z8)
      else
         dem%z4(from(1):, from(2):) => z4
         across = shape(z4)
      end if
      dem%nx = across(1); dem%ny = across(2)
      if (present(nodes)) then
         dem%nx = nodes(1); dem%ny = nodes(2)
      end if
      dem%cell = cell
      dem%per_cell = 1/cell
      dem%x0 = west + 0.5_wp*cell
      dem%y0 = north - (dem%ny - 0.5_wp)*cell
      dem%lo = 1
      dem%hi = [dem%nx, dem%ny] - 1
      call set_window(dem, from, from + across - 1)
   end function terrain

   !> Restrict boulders to patches whose cells have all neighbours within these columns and rows, or beyond an edge of
   !> the raster.
   pure subroutine set_window(dem, first, last)
      type(terrain_t), intent(inout) :: dem
      integer, intent(in) :: first(2), last(2)  !! column and row, from the north

      if (first(1) > 1) dem%lo(1) = max(dem%lo(1), first(1) + 1)
      if (last(1) < dem%nx) dem%hi(1) = min(dem%hi(1), last(1) - 2)
      if (last(2) < dem%ny) dem%lo(2) = max(dem%lo(2), dem%ny + 2 - last(2))
      if (first(2) > 1) dem%hi(2) = min(dem%hi(2), dem%ny - 1 - first(2))
   end subroutine set_window

   !> Return whether boulders may fly over a patch, if it is known.
   pure logical function in_window(dem, i, j)
      type(terrain_t), intent(in) :: dem
      integer, intent(in) :: i, j

      in_window = i >= dem%lo(1) .and. j >= dem%lo(2) .and. i <= dem%hi(1) .and. j <= dem%hi(2)
   end function in_window

   !> Find the patch that contains a point, and the position of the point in it. Points outside the raster get the
   !> nearest patch; points on the edge of the known terrain (up to `on_side`) get a known patch.
   pure subroutine locate(dem, x, y, patch, u, w)
      type(terrain_t), intent(in) :: dem
      real(wp), intent(in) :: x, y  !! [m]
      type(patch_t), intent(out) :: patch
      real(wp), intent(out) :: u, w  !! 0..1 [cells]
      integer :: i, j, k

      i = max(1, min(dem%nx - 1, int(x*dem%per_cell) + 1))
      j = max(1, min(dem%ny - 1, int(y*dem%per_cell) + 1))
      do k = 0, 3  ! try the patch itself, then its neighbours across a side and a corner
         call read_patch(dem, i + mod(k, 2)*side_step(patch_position(dem, x, i)), j &
                         + k/2*side_step(patch_position(dem, y, j)), patch)
         if (patch%known) exit
      end do
      if (.not. patch%known) call read_patch(dem, i, j, patch)
      u = patch_position(dem, x, patch%i)
      w = patch_position(dem, y, patch%j)
   end subroutine locate

   !> Step (-1 or 1) to the neighbour across the side on which a position 0..1 lies; 0 away from sides.
   pure integer function side_step(u)
      real(wp), intent(in) :: u  !! [cells]

      side_step = 0
      if (u < on_side) side_step = -1
      if (u > 1 - on_side) side_step = 1
   end function side_step

   !> Position 0..1 [cells] of a coordinate in patch interval k.
   pure real(wp) function patch_position(dem, x, k)
      type(terrain_t), intent(in) :: dem
      real(wp), intent(in) :: x  !! [m]
      integer, intent(in) :: k

      patch_position = fraction_of(dem%per_cell, x, real(k, wp))
   end function patch_position

   !> Position 0..1 [cells] of a coordinate in patch interval k, for vectorised loops.
   elemental real(wp) function fraction_of(per_cell, x, k)
      real(wp), intent(in) :: per_cell  !! [1/m]
      real(wp), intent(in) :: x         !! [m]
      real(wp), intent(in) :: k         !! number of the interval, an integer [-]

      fraction_of = max(0.0_wp, min(1.0_wp, x*per_cell - (k - 1)))
   end function fraction_of

   !> Return whether a point is inside the convex hull of the cell centres, or on its edge; ignores nodata.
   pure logical function on_terrain(dem, x, y)
      type(terrain_t), intent(in) :: dem
      real(wp), intent(in) :: x, y  !! [m]
      real(wp) :: at(2)

      at = [x, y]*dem%per_cell
      on_terrain = all(at >= -on_side .and. at <= [dem%nx, dem%ny] - 1 + on_side)
   end function on_terrain

   !> Return whether a boulder can start from a point: between four nodes with known elevation.
   pure logical function is_known_at(dem, x, y)
      type(terrain_t), intent(in) :: dem
      real(wp), intent(in) :: x, y  !! [m]
      type(patch_t) :: patch
      real(wp) :: u, w

      is_known_at = on_terrain(dem, x, y)
      if (.not. is_known_at) return
      call locate(dem, x, y, patch, u, w)
      is_known_at = patch%known
   end function is_known_at

   !> Read patch (i, j), which is unknown outside the window or next to nodata.
   pure subroutine read_patch(dem, i, j, patch)
      type(terrain_t), intent(in) :: dem
      integer, intent(in) :: i, j
      type(patch_t), intent(out) :: patch
      real(wp) :: z10, z01, z11, known

      patch%i = i
      patch%j = j
      if (.not. in_window(dem, i, j)) return
      call read_corners(dem, i, j, patch%z00, z10, z01, z11)
      call find_coefficients(patch%z00, z10, z01, z11, patch%a, patch%b, patch%c, known)
      patch%known = known > 0
   end subroutine read_patch

   !> Elevations of the corners of a patch in the window [m].
   pure subroutine read_corners(dem, i, j, z00, z10, z01, z11)
      type(terrain_t), intent(in) :: dem
      integer, intent(in) :: i, j
      real(wp), intent(out) :: z00, z10, z01, z11
      integer :: r

      r = dem%ny + 1 - j
      if (associated(dem%z8)) then
         z00 = dem%z8(i, r); z10 = dem%z8(i + 1, r)
         z01 = dem%z8(i, r - 1); z11 = dem%z8(i + 1, r - 1)
      else
         z00 = dem%z4(i, r); z10 = dem%z4(i + 1, r)
         z01 = dem%z4(i, r - 1); z11 = dem%z4(i + 1, r - 1)
      end if
   end subroutine read_corners

   !> Coefficients of a patch from the elevations of its corners [m]; `known` is 1, or 0 if a corner is unknown.
   elemental subroutine find_coefficients(z00, z10, z01, z11, a, b, c, known)
      real(wp), intent(in) :: z00, z10, z01, z11
      real(wp), intent(out) :: a, b, c  !! as in patch_t
      real(wp), intent(out) :: known

      a = z10 - z00
      b = z01 - z00
      c = (z11 - z10) - b
      known = merge(1.0_wp, 0.0_wp, a + z11 == a + z11)  ! NaN differs from itself
      known = merge(known, 0.0_wp, b == b)
   end subroutine find_coefficients

   !> Elevation at a position in a patch [m].
   pure real(wp) function height(patch, u, w)
      type(patch_t), intent(in) :: patch
      real(wp), intent(in) :: u, w  !! 0..1 [cells]

      height = height_at(patch%z00, patch%a, patch%b, patch%c, u, w)
   end function height

   !> Elevation in a patch [m], from its coefficients.
   elemental real(wp) function height_at(z00, a, b, c, u, w)
      real(wp), intent(in) :: z00, a, b, c  !! as in patch_t [m]
      real(wp), intent(in) :: u, w          !! 0..1 [cells]

      height_at = z00 + a*u + w*(b + c*u)
   end function height_at

   !> Elevation of a raster cell (node) in the window [m].
   pure real(wp) function node_height(dem, at)
      type(terrain_t), intent(in) :: dem
      integer, intent(in) :: at(2)  !! column from the west, row from the north

      if (associated(dem%z8)) then
         node_height = dem%z8(at(1), at(2))
      else
         node_height = dem%z4(at(1), at(2))
      end if
   end function node_height

   !> Gradient (dz/dx, dz/dy) [-] at a position in a patch.
   pure function gradient(dem, patch, u, w) result(g)
      type(terrain_t), intent(in) :: dem
      type(patch_t), intent(in) :: patch
      real(wp), intent(in) :: u, w  !! 0..1 [cells]
      real(wp) :: g(2)

      g(1) = slope_at(patch%a, patch%c, w, dem%per_cell)
      g(2) = slope_at(patch%b, patch%c, u, dem%per_cell)
   end function gradient

   !> One component of the gradient: dz/dx with a and w, dz/dy with b and u [-].
   elemental real(wp) function slope_at(rise, twist, across, per_cell)
      real(wp), intent(in) :: rise, twist  !! a or b, and c, as in patch_t [m]
      real(wp), intent(in) :: across       !! w or u, 0..1 [cells]
      real(wp), intent(in) :: per_cell     !! [1/m]

      slope_at = (rise + twist*across)*per_cell
   end function slope_at

   !> Steepness sqrt(1 + |g|**2) [-] of a gradient: 1/cos of the slope.
   elemental real(wp) function steepness_of(g1, g2)
      real(wp), intent(in) :: g1, g2  !! [-]

      steepness_of = sqrt(1 + g1*g1 + g2*g2)
   end function steepness_of

   !> Raster cell (node) nearest to a position in a patch: column from the west, row from the north.
   pure function cell_of(dem, patch, u, w) result(at)
      type(terrain_t), intent(in) :: dem
      type(patch_t), intent(in) :: patch
      real(wp), intent(in) :: u, w  !! 0..1 [cells]
      integer :: at(2)

      at(1) = int(nearest_node(real(patch%i, wp), u))
      at(2) = dem%ny + 1 - int(nearest_node(real(patch%j, wp), w))
   end function cell_of

   !> Node nearest to a position in patch interval k, for vectorised loops.
   elemental real(wp) function nearest_node(k, u)
      real(wp), intent(in) :: k  !! number of the interval, an integer [-]
      real(wp), intent(in) :: u  !! 0..1 [cells]

      nearest_node = k + merge(1.0_wp, 0.0_wp, u >= 0.5_wp)
   end function nearest_node

   !> Direction of steepest descent of a raster cell by 3x3 finite differences (Horn 1981, doi:10.1109/PROC.1981.11918),
   !> as the downhill vector -grad z, not normalised; and whether the cell is a pit (none of its eight neighbours is
   !> lower). If the window is incomplete, the gradient of the patch is used, and the cell is no pit.
   pure subroutine cell_descent(dem, at, patch_gradient, descent, pit)
      type(terrain_t), intent(in) :: dem
      integer, intent(in) :: at(2)              !! as returned by cell_of
      real(wp), intent(in) :: patch_gradient(2) !! [-]
      real(wp), intent(out) :: descent(2)       !! [-]
      logical, intent(out) :: pit
      real(wp) :: z(3, 3), horns(2), lowest

      descent = -patch_gradient
      pit = .false.
      if (.not. has_neighbours(dem, at)) return
      call read_window(dem, at, z)
      if (.not. sum(z) == sum(z)) return  ! NaN differs from itself
      call horn(z(1, 1), z(2, 1), z(3, 1), z(1, 2), z(3, 2), z(1, 3), z(2, 3), z(3, 3), dem%per_cell, &
                horns(1), horns(2), lowest)
      descent = horns
      pit = is_pit(z(2, 2), lowest) > 0
   end subroutine cell_descent

   !> Return 1 if a raster cell is a pit, else 0.
   elemental real(wp) function is_pit(middle, lowest)
      real(wp), intent(in) :: middle, lowest  !! elevations of the cell and of its lowest neighbour [m]

      is_pit = merge(1.0_wp, 0.0_wp, lowest >= middle)
   end function is_pit

   !> Return whether a raster cell has all eight neighbours.
   pure logical function has_neighbours(dem, at)
      type(terrain_t), intent(in) :: dem
      integer, intent(in) :: at(2)  !! as returned by cell_of

      has_neighbours = is_within(real(at(1), wp), real(at(2), wp), real(dem%nx, wp), real(dem%ny, wp)) > 0
   end function has_neighbours

   !> Return 1 if a raster cell is not on the edge of its raster, else 0.
   elemental real(wp) function is_within(column, row, nx, ny)
      real(wp), intent(in) :: column, row  !! integers, from 1 [-]
      real(wp), intent(in) :: nx, ny       !! columns and rows of the raster, integers [-]

      is_within = merge(1.0_wp, 0.0_wp, column >= 2)
      is_within = merge(is_within, 0.0_wp, row >= 2)
      is_within = merge(is_within, 0.0_wp, column < nx)
      is_within = merge(is_within, 0.0_wp, row < ny)
   end function is_within

   !> Elevations of a raster cell and its eight neighbours [m].
   pure subroutine read_window(dem, at, z)
      type(terrain_t), intent(in) :: dem
      integer, intent(in) :: at(2)         !! as returned by cell_of
      real(wp), intent(out) :: z(3, 3)     !! columns west to east, rows north to south

      if (associated(dem%z8)) then
         z = dem%z8(at(1) - 1:at(1) + 1, at(2) - 1:at(2) + 1)
      else
         z = dem%z4(at(1) - 1:at(1) + 1, at(2) - 1:at(2) + 1)
      end if
   end subroutine read_window

   !> Downhill vector of a cell from its eight neighbours, named by direction, and elevation of the lowest neighbour.
   elemental subroutine horn(nw, n, ne, w, e, sw, s, se, per_cell, east, north, lowest)
      real(wp), intent(in) :: nw, n, ne, w, e, sw, s, se  !! [m]
      real(wp), intent(in) :: per_cell                    !! [1/m]
      real(wp), intent(out) :: east, north                !! [-]
      real(wp), intent(out) :: lowest                     !! [m]
      real(wp) :: per_eight

      per_eight = 0.125_wp*per_cell  ! weights 1, 2, 1 on both sides, two cells apart: division by 8 cells
      east = -((ne - nw) + 2*(e - w) + (se - sw))*per_eight
      north = -((nw - sw) + 2*(n - s) + (ne - se))*per_eight
      lowest = min(min(min(nw, n), min(ne, w)), min(min(e, sw), min(s, se)))
   end subroutine horn
end module rockfall_terrain
