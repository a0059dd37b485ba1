! SPDX-License-Identifier: BSD-3-Clause
!> Area that boulders can reach. No rebound adds energy (theory, chapter 5), so a boulder never rises above its initial
!> energy head, and never passes higher terrain.
module rockfall_reach
   use rockfall_kinds, only: wp
   use rockfall_terrain, only: terrain_t
   implicit none
   private
   public :: block_side, update_block_minima, reach_box

   integer, parameter :: max_blocks = 1024   !! maximum number along a side of the raster: 8 MB of minima
   integer, parameter :: margin = 3           !! a patch and its neighbours extend this far around a cell [cells]
   real(wp), parameter :: slack = 0.01_wp     !! far above the rounding error of the energy head [m]

   !> Blocks reached by a flood fill, and the stack of blocks whose neighbours are still to be visited.
   type :: flood_t
      real(wp) :: level = 0.0_wp           !! elevation below which blocks can be reached [m]
      logical, allocatable :: reached(:, :)
      integer, allocatable :: stack(:, :)  !! column and row of each block
      integer :: n = 0                     !! number of blocks on the stack
   end type flood_t

contains

   !> Side length, in cells, of the blocks for which minimum elevations are stored.
   pure integer function block_side(nodes)
      integer, intent(in) :: nodes(2)  !! columns, rows of the raster

      block_side = (maxval(nodes) + max_blocks - 1)/max_blocks
   end function block_side

   !> Update the minima of blocks [m] with the known elevations of rows first to last.
   pure subroutine update_block_minima(dem, first, last, minima)
      type(terrain_t), intent(in) :: dem        !! terrain with all columns of these rows
      integer, intent(in) :: first, last        !! rows, counted from the north
      real(wp), intent(inout) :: minima(:, :)   !! (columns, rows) of blocks
      real(wp) :: z
      integer :: i, r, k, side

      side = block_side([dem%nx, dem%ny])
      do r = first, last
         do k = 1, size(minima, 1)
            associate (lowest => minima(k, (r - 1)/side + 1))
               do i = (k - 1)*side + 1, min(k*side, dem%nx)
                  if (associated(dem%z8)) then
                     z = dem%z8(i, r)
                  else
                     z = dem%z4(i, r)
                  end if
                  if (z == z) lowest = min(lowest, z)  ! comparing a NaN by < would raise a floating-point exception
               end do
            end associate
         end do
      end do
   end subroutine update_block_minima

   !> Rectangle of cells (first column, first row, last column, last row) that contains all cells that boulders from the
   !> sources can reach or affect, and their neighbours. It covers all blocks below the energy head that are connected
   !> to a block with a source.
   pure function reach_box(dem, minima, head, x, y, beyond) result(box)
      type(terrain_t), intent(in) :: dem       !! terrain, used only for its geometry
      real(wp), intent(in) :: minima(:, :)     !! minima of all blocks [m]
      real(wp), intent(in) :: head             !! maximum energy head of all sources [m]
      real(wp), intent(in) :: x(:), y(:)       !! sources, local coordinates [m]
      integer, intent(in) :: beyond            !! number of cells around reached cells that boulders affect
      integer :: box(4)
      type(flood_t) :: flood
      integer :: k, block(2), side

      flood%level = head + slack
      allocate (flood%reached(size(minima, 1), size(minima, 2)), source=.false.)
      allocate (flood%stack(2, size(minima)))
      side = block_side([dem%nx, dem%ny])
      do k = 1, size(x)
         block = [nint(x(k)*dem%per_cell) + 1, dem%ny - nint(y(k)*dem%per_cell)]
         call push_blocks(flood, minima, (block - 2)/side + 1, block/side + 1)  ! one neighbour is not above the source
      end do
      do while (flood%n > 0)
         block = flood%stack(:, flood%n)
         flood%n = flood%n - 1
         call push_blocks(flood, minima, block - 1, block + 1)
      end do
      box(1) = findloc(any(flood%reached, dim=2), .true., dim=1)
      box(2) = findloc(any(flood%reached, dim=1), .true., dim=1)
      box(3) = findloc(any(flood%reached, dim=2), .true., dim=1, back=.true.)
      box(4) = findloc(any(flood%reached, dim=1), .true., dim=1, back=.true.)
      box(:2) = max(1, (box(:2) - 1)*side + 1 - margin - beyond)
      box(3:) = min([dem%nx, dem%ny], box(3:)*side + margin + beyond)
   end function reach_box

   !> Push the blocks of a rectangle that are low enough and not yet visited.
   pure subroutine push_blocks(flood, minima, first, last)
      type(flood_t), intent(inout) :: flood
      real(wp), intent(in) :: minima(:, :)       !! [m]
      integer, intent(in) :: first(2), last(2)   !! first and last block, possibly beyond the raster
      integer :: i, r

      do r = max(1, first(2)), min(last(2), size(minima, 2))
         do i = max(1, first(1)), min(last(1), size(minima, 1))
            if (flood%reached(i, r) .or. minima(i, r) > flood%level) cycle
            flood%reached(i, r) = .true.
            flood%n = flood%n + 1
            flood%stack(:, flood%n) = [i, r]
         end do
      end do
   end subroutine push_blocks
end module rockfall_reach
