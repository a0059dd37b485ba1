! SPDX-License-Identifier: BSD-3-Clause
!> Where boulders can come at all. No rebound adds energy (theory, chapter 5), so a boulder never rises above
!> the elevation that its energy at the release could lift it to, and never passes terrain that is higher.
module rockfall_reach
   use rockfall_kinds, only: wp
   use rockfall_terrain, only: terrain_t
   implicit none
   private
   public :: block_side, take_minima, reach_box

   integer, parameter :: max_blocks = 1024   !! along a side of the raster: 8 MB of minima at most
   integer, parameter :: margin = 3           !! cells: of a patch, and round the cells of a patch
   real(wp), parameter :: slack = 0.01_wp     !! [m] far more than rounding adds to the energy head

   !> Blocks that were reached, and those of them whose neighbours are still to be looked at.
   type :: flood_t
      real(wp) :: level = 0.0_wp           !! what is higher is not reached [m]
      logical, allocatable :: reached(:, :)
      integer, allocatable :: stack(:, :)  !! column, row
      integer :: n = 0                     !! on the stack
   end type flood_t

contains

   !> Cells along the side of a block of cells, of which only the lowest elevation is looked at.
   pure integer function block_side(nodes)
      integer, intent(in) :: nodes(2)  !! columns, rows of the raster

      block_side = (maxval(nodes) + max_blocks - 1)/max_blocks
   end function block_side

   !> Lower the minima of blocks [m] to the known elevations of rows first to last.
   pure subroutine take_minima(dem, first, last, minima)
      type(terrain_t), intent(in) :: dem        !! all columns of these rows are at hand
      integer, intent(in) :: first, last        !! rows from the north
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
                  if (z == z) lowest = min(lowest, z)  ! to order a NaN would be a floating-point exception
               end do
            end associate
         end do
      end do
   end subroutine take_minima

   !> The rectangle of cells (first column, first row, last column, last row) that holds every cell that a
   !> boulder can reach from these sources, and their neighbours: blocks that are lower than the energy head,
   !> joined to one that a source is in.
   pure function reach_box(dem, minima, head, x, y) result(box)
      type(terrain_t), intent(in) :: dem       !! where it lies; elevations need not be at hand
      real(wp), intent(in) :: minima(:, :)     !! of all blocks [m]
      real(wp), intent(in) :: head             !! energy head, the highest of all sources [m]
      real(wp), intent(in) :: x(:), y(:)       !! sources, local coordinates [m]
      integer :: box(4)
      type(flood_t) :: flood
      integer :: k, here(2), side

      flood%level = head + slack
      allocate (flood%reached(size(minima, 1), size(minima, 2)), source=.false.)
      allocate (flood%stack(2, size(minima)))
      side = block_side([dem%nx, dem%ny])
      do k = 1, size(x)
         here = [nint(x(k)*dem%per_cell) + 1, dem%ny - nint(y(k)*dem%per_cell)]
         call enter(flood, minima, (here - 2)/side + 1, here/side + 1)  ! of the cells round it one is lower
      end do
      do while (flood%n > 0)
         here = flood%stack(:, flood%n)
         flood%n = flood%n - 1
         call enter(flood, minima, here - 1, here + 1)
      end do
      box(1) = findloc(any(flood%reached, dim=2), .true., dim=1)
      box(2) = findloc(any(flood%reached, dim=1), .true., dim=1)
      box(3) = findloc(any(flood%reached, dim=2), .true., dim=1, back=.true.)
      box(4) = findloc(any(flood%reached, dim=1), .true., dim=1, back=.true.)
      box(:2) = max(1, (box(:2) - 1)*side + 1 - margin)
      box(3:) = min([dem%nx, dem%ny], box(3:)*side + margin)
   end function reach_box

   !> Go to those blocks of a rectangle that are low enough and new.
   pure subroutine enter(flood, minima, first, last)
      type(flood_t), intent(inout) :: flood
      real(wp), intent(in) :: minima(:, :)       !! [m]
      integer, intent(in) :: first(2), last(2)   !! block, also beyond the raster
      integer :: i, r

      do r = max(1, first(2)), min(last(2), size(minima, 2))
         do i = max(1, first(1)), min(last(1), size(minima, 1))
            if (flood%reached(i, r) .or. minima(i, r) > flood%level) cycle
            flood%reached(i, r) = .true.
            flood%n = flood%n + 1
            flood%stack(:, flood%n) = [i, r]
         end do
      end do
   end subroutine enter
end module rockfall_reach
