! SPDX-License-Identifier: BSD-3-Clause
!> Maps of trees: the number of hits in each raster cell, their heights, and the absorbed energy. Like all maps, they
!> consist of counts, integer sums, and maxima; a boulder collects its hits first.
module rockfall_tree_maps
   use rockfall_kinds, only: wp, sp, i8
   use rockfall_maps, only: maps_t, per_unit, add_value, hold, let_go
   use rockfall_bins, only: jump_height
   implicit none
   private
   public :: tree_hits_t, needs_tree_hits, gather_tree_hit, add_tree_hits

   integer, parameter :: first_room = 64  !! initial capacity for the hits of a boulder

   type :: placed_t
      integer :: at(2) = 0        !! column, row
      real(wp) :: height = 0.0_wp !! of the contact point above the ground [m]
      real(wp) :: taken = 0.0_wp  !! energy absorbed by the tree [J]
   end type placed_t

   !> Hits of one boulder.
   type :: tree_hits_t
      integer :: n = 0
      type(placed_t), allocatable :: hit(:)
   end type tree_hits_t

contains

   !> Return whether a map needs the hits of trees.
   pure logical function needs_tree_hits(maps)
      type(maps_t), intent(in) :: maps

      needs_tree_hits = associated(maps%tree_impacts) .or. associated(maps%tree_energy) .or. &
                        associated(maps%tree_height%max)
   end function needs_tree_hits

   !> Add a hit.
   pure subroutine gather_tree_hit(hits, at, height, taken)
      type(tree_hits_t), intent(inout) :: hits
      integer, intent(in) :: at(2)           !! column, row
      real(wp), intent(in) :: height, taken  !! as in placed_t [m], [J]
      type(placed_t), allocatable :: larger(:)

      if (.not. allocated(hits%hit)) allocate (hits%hit(first_room))
      if (hits%n == size(hits%hit)) then
         allocate (larger(2*hits%n))
         larger(:hits%n) = hits%hit
         call move_alloc(larger, hits%hit)
      end if
      hits%n = hits%n + 1
      hits%hit(hits%n) = placed_t(at, height, taken)
   end subroutine gather_tree_hit

   !> Add a boulder's hits to the maps; thread-safe.
   subroutine add_tree_hits(maps, hits)
      type(maps_t), intent(in) :: maps
      type(tree_hits_t), intent(in) :: hits
      integer :: k, held

      held = -1
      do k = 1, hits%n
         associate (i => hits%hit(k)%at(1), r => hits%hit(k)%at(2))
            call hold(maps, r, held)
            if (associated(maps%tree_impacts)) maps%tree_impacts(i, r) = maps%tree_impacts(i, r) + 1
            if (associated(maps%tree_energy)) &
               maps%tree_energy(i, r) = maps%tree_energy(i, r) + nint(hits%hit(k)%taken, i8)
            call add_value(maps%tree_height, i, r, hits%hit(k)%height, per_unit(jump_height))
         end associate
      end do
      call let_go(maps, held)
   end subroutine add_tree_hits
end module rockfall_tree_maps
