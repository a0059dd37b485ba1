! SPDX-License-Identifier: BSD-3-Clause
!> Terrain: planes and saddles give the exact height and gradient, cells give their aspect; edges and nodata are
!> detected before they are read.
program test_terrain
   use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan
   use rockfall_kinds, only: wp, sp
   use rockfall_terrain, only: terrain_t, patch_t, terrain, locate, patch_position, on_terrain, &
      read_patch, height, gradient, cell_of, cell_descent
   use check_m, only: check, check_close, finish
   implicit none

   integer, parameter :: nx = 7, ny = 5
   real(wp), parameter :: cell = 2.5_wp, west = 600000.0_wp, north = 5.0e6_wp

   call random_init(.true., .false.)
   call test_place()
   call test_plane()
   call test_saddle()
   call test_precisions()
   call test_cells()
   call test_horn()
   call test_pit()
   call test_edges()
   call test_nodata()
   call finish()

contains

   !> Elevations of p + a x + b y + c x y at the nodes, x and y from the south-western node [m].
   pure function surface(p, a, b, c) result(z)
      real(wp), intent(in) :: p, a, b, c
      real(wp) :: z(nx, ny), x, y
      integer :: i, r

      do r = 1, ny
         do i = 1, nx
            x = (i - 1)*cell
            y = (ny - r)*cell
            z(i, r) = p + a*x + b*y + c*x*y
         end do
      end do
   end function surface

   !> Random point of the terrain.
   subroutine draw_place(x, y)
      real(wp), intent(out) :: x, y

      call random_number(x)
      call random_number(y)
      x = x*(nx - 1)*cell
      y = y*(ny - 1)*cell
   end subroutine draw_place

   subroutine test_place()
      real(wp), target :: z(nx, ny)
      type(terrain_t) :: dem
      type(patch_t) :: patch
      real(wp) :: u, w

      z = surface(0.0_wp, 1.0_wp, 10.0_wp, 0.0_wp)
      dem = terrain(west, north, cell, z8=z)
      call check_close("x of the first node", dem%x0, west + 1.25_wp, 0.0_wp)
      call check_close("y of the southernmost node", dem%y0, north - 11.25_wp, 0.0_wp)
      call locate(dem, 6.0_wp, 4.0_wp, patch, u, w)
      call check("the patch of a point", patch%i == 3 .and. patch%j == 2 .and. patch%known)
      call check_close("east in it", u, 0.4_wp, 1.0e-15_wp)
      call check_close("north in it", w, 0.6_wp, 1.0e-15_wp)
      call check_close("within an interval", patch_position(dem, 6.0_wp, 3), 0.4_wp, 1.0e-15_wp)
      call check_close("not past it", patch_position(dem, 6.0_wp, 1), 1.0_wp, 0.0_wp)
      call check_close("nor before it", patch_position(dem, 6.0_wp, 5), 0.0_wp, 0.0_wp)
   end subroutine test_place

   subroutine test_plane()
      real(wp), target :: z(nx, ny)
      type(terrain_t) :: dem
      type(patch_t) :: patch
      real(wp) :: x, y, u, w, g(2)
      integer :: k

      z = surface(1000.0_wp, 0.75_wp, -0.5_wp, 0.0_wp)
      dem = terrain(west, north, cell, z8=z)
      do k = 1, 1000
         call draw_place(x, y)
         call locate(dem, x, y, patch, u, w)
         g = gradient(dem, patch, u, w)
         call check_close("height of a plane", height(patch, u, w), 1000 + 0.75_wp*x - 0.5_wp*y, &
                          1.0e-15_wp)
         call check_close("eastward gradient of a plane", g(1), 0.75_wp, 1.0e-12_wp)
         call check_close("northward gradient of a plane", g(2), -0.5_wp, 1.0e-12_wp)
      end do
   end subroutine test_plane

   !> x y is bilinear over every patch, so height and gradient are exact everywhere.
   subroutine test_saddle()
      real(wp), target :: z(nx, ny)
      type(terrain_t) :: dem
      type(patch_t) :: patch
      real(wp) :: x, y, u, w, g(2)
      integer :: k

      z = surface(100.0_wp, -0.25_wp, 0.5_wp, 0.125_wp)
      dem = terrain(west, north, cell, z8=z)
      do k = 1, 1000
         call draw_place(x, y)
         call locate(dem, x, y, patch, u, w)
         g = gradient(dem, patch, u, w)
         call check_close("height of a saddle", height(patch, u, w), &
                          100 - 0.25_wp*x + 0.5_wp*y + 0.125_wp*x*y, 1.0e-14_wp)
         call check_close("1 + eastward gradient of a saddle", 1 + g(1), 0.75_wp + 0.125_wp*y, &
                          1.0e-12_wp)
         call check_close("northward gradient of a saddle", g(2), 0.5_wp + 0.125_wp*x, 1.0e-12_wp)
      end do
   end subroutine test_saddle

   !> The same elevations in single and in double precision give bitwise identical terrain.
   subroutine test_precisions()
      real(sp), target :: z4(nx, ny)
      real(wp), target :: z8(nx, ny)
      type(terrain_t) :: single, double
      type(patch_t) :: a, b
      real(wp) :: x, y, u, w, down(2, 2)
      logical :: pit(2), same
      integer :: k

      call random_number(z4)
      z4 = 1000 + 10*z4
      z8 = z4
      single = terrain(west, north, cell, z4=z4)
      double = terrain(west, north, cell, z8=z8)
      same = .true.
      do k = 1, 1000
         call draw_place(x, y)
         call locate(single, x, y, a, u, w)
         call locate(double, x, y, b, u, w)
         same = same .and. abs(height(a, u, w) - height(b, u, w)) <= 0
         call cell_descent(single, cell_of(single, a, u, w), gradient(single, a, u, w), &
                           down(:, 1), pit(1))
         call cell_descent(double, cell_of(double, b, u, w), gradient(double, b, u, w), &
                           down(:, 2), pit(2))
         same = same .and. all(abs(down(:, 1) - down(:, 2)) <= 0) .and. (pit(1) .eqv. pit(2))
      end do
      call check("single and double precision agree", same)
   end subroutine test_precisions

   !> The cell of a point is that of the nearest node.
   subroutine test_cells()
      real(wp), target :: z(nx, ny)
      type(terrain_t) :: dem
      type(patch_t) :: patch
      integer :: at(2), k
      real(wp) :: x, y, u, w
      logical :: nearest

      z = 0
      dem = terrain(west, north, cell, z8=z)
      nearest = .true.
      do k = 1, 1000
         call draw_place(x, y)
         call locate(dem, x, y, patch, u, w)
         at = cell_of(dem, patch, u, w)
         nearest = nearest .and. at(1) == nint(x/cell) + 1 .and. at(2) == ny - nint(y/cell)
      end do
      call check("the cell of a place", nearest)
   end subroutine test_cells

   !> Horn's differences equal the explicit weights; on a plane they are the gradient.
   subroutine test_horn()
      real(wp), target :: z(nx, ny)
      type(terrain_t) :: dem
      real(wp) :: down(2), east, north_
      logical :: pit

      z = surface(0.0_wp, 0.75_wp, -0.5_wp, 0.0_wp)
      dem = terrain(west, north, cell, z8=z)
      call cell_descent(dem, [3, 3], [9.0_wp, 9.0_wp], down, pit)
      call check_close("eastward descent of a plane", down(1), -0.75_wp, 1.0e-14_wp)
      call check_close("northward descent of a plane", down(2), 0.5_wp, 1.0e-14_wp)
      call check("a plane has no pit", .not. pit)
      call random_number(z)
      call cell_descent(dem, [4, 2], [9.0_wp, 9.0_wp], down, pit)
      east = (z(5, 1) + 2*z(5, 2) + z(5, 3) - z(3, 1) - 2*z(3, 2) - z(3, 3))/(8*cell)
      north_ = (z(3, 1) + 2*z(4, 1) + z(5, 1) - z(3, 3) - 2*z(4, 3) - z(5, 3))/(8*cell)
      call check_close("eastward descent by Horn", down(1), -east, 1.0e-13_wp)
      call check_close("northward descent by Horn", down(2), -north_, 1.0e-13_wp)
   end subroutine test_horn

   !> A pit has no lower neighbour among all eight; a cell of level ground is a pit.
   subroutine test_pit()
      real(wp), target :: z(nx, ny)
      type(terrain_t) :: dem
      real(wp) :: down(2)
      logical :: pit
      integer :: i, r

      z = 5
      dem = terrain(west, north, cell, z8=z)
      call cell_descent(dem, [3, 3], [0.0_wp, 0.0_wp], down, pit)
      call check("level ground is a pit", pit)
      z(3, 3) = 4
      call cell_descent(dem, [3, 3], [0.0_wp, 0.0_wp], down, pit)
      call check("a hole is a pit", pit)
      do r = 2, 4
         do i = 2, 4
            if (i == 3 .and. r == 3) cycle
            z(i, r) = 3.9_wp
            call cell_descent(dem, [3, 3], [0.0_wp, 0.0_wp], down, pit)
            call check("a lower neighbour, no pit", .not. pit)
            z(i, r) = 5
         end do
      end do
   end subroutine test_pit

   subroutine test_edges()
      real(wp), target :: z(nx, ny)
      type(terrain_t) :: dem
      type(patch_t) :: patch
      real(wp) :: u, w, down(2)
      logical :: pit
      integer :: i, j

      z = surface(0.0_wp, 0.75_wp, -0.5_wp, 0.0_wp)
      dem = terrain(west, north, cell, z8=z)
      do i = 0, nx
         do j = 0, ny
            call read_patch(dem, i, j, patch)
            call check("patches are known inside", &
                       patch%known .eqv. (i > 0 .and. j > 0 .and. i < nx .and. j < ny))
         end do
      end do
      call check("the corners are terrain", on_terrain(dem, 0.0_wp, 0.0_wp) &
                 .and. on_terrain(dem, 15.0_wp, 10.0_wp))
      call check("so is what lies there up to rounding", on_terrain(dem, -1.0e-9_wp, 10.0_wp + 1.0e-9_wp))
      call check("beyond them is none", .not. (on_terrain(dem, 15.001_wp, 1.0_wp) &
                                               .or. on_terrain(dem, 1.0_wp, -0.001_wp)))
      call locate(dem, 100.0_wp, -100.0_wp, patch, u, w)
      call check("a point beyond gets the nearest patch", patch%i == nx - 1 .and. patch%j == 1)
      call check("and its nearest corner", abs(u - 1) <= 0 .and. abs(w) <= 0)
      call locate(dem, 15.0_wp, 10.0_wp, patch, u, w)
      call check_close("height in the last corner", height(patch, u, w), 6.25_wp, 1.0e-15_wp)
      call cell_descent(dem, [1, 3], [0.25_wp, -2.0_wp], down, pit)
      call check("a cell of the edge has the descent of the patch", &
                 all(abs(down - [-0.25_wp, 2.0_wp]) <= 0))
      call check("and no pit", .not. pit)
   end subroutine test_edges

   subroutine test_nodata()
      real(wp), target :: z(nx, ny)
      type(terrain_t) :: dem
      type(patch_t) :: patch
      real(wp) :: u, w, down(2)
      logical :: pit
      integer :: i, j

      z = surface(0.0_wp, 0.75_wp, -0.5_wp, 0.0_wp)
      z(4, 3) = ieee_value(0.0_wp, ieee_quiet_nan)  ! node (4, 3), also counted from the south
      dem = terrain(west, north, cell, z8=z)
      do i = 1, nx - 1
         do j = 1, ny - 1
            call read_patch(dem, i, j, patch)
            call check("patches beside nodata are unknown", &
                       patch%known .neqv. ((i == 3 .or. i == 4) .and. (j == 2 .or. j == 3)))
         end do
      end do
      call locate(dem, 5.0_wp, 3.0_wp, patch, u, w)
      call check("on the side of nodata the known patch", patch%known .and. patch%i == 2 &
                 .and. patch%j == 2)
      call check_close("at its east side", u, 1.0_wp, 0.0_wp)
      call locate(dem, 5.0_wp, 2.5_wp, patch, u, w)
      call check("at its corner a known patch", patch%known)
      call check_close("of the same height", height(patch, u, w), 2.5_wp, 1.0e-15_wp)
      call locate(dem, 6.0_wp, 4.0_wp, patch, u, w)
      call check("inside nodata none", .not. patch%known)
      call cell_descent(dem, [3, 2], [0.25_wp, -2.0_wp], down, pit)
      call check("beside nodata the descent of the patch", &
                 all(abs(down - [-0.25_wp, 2.0_wp]) <= 0) .and. .not. pit)
   end subroutine test_nodata
end program test_terrain
