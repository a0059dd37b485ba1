! SPDX-License-Identifier: BSD-3-Clause
!> Maps of trees: the number of hits in each raster cell, their heights, and the absorbed energy. Like all maps, they
!> consist of counts, integer sums, and maxima. The hits of a boulder are collected first.
module rockfall_tree_maps
   use rockfall_kinds, only: wp, sp, i8
   use rockfall_maps, only: maps_t, per_unit, add_value, lock_band, unlock_band
   use rockfall_bins, only: jump_height
   implicit none
   private
   public :: tree_hits_t, needs_tree_hits, add_tree_hit, add_tree_hits

   integer, parameter :: first_capacity = 64  !! initial capacity for the hits of a boulder

   type :: tree_contact_t
      integer :: cell(2) = 0      !! column, row
      real(wp) :: height = 0.0_wp !! height of the contact point above the ground [m]
      real(wp) :: absorbed = 0.0_wp  !! energy absorbed by the tree [J]
   end type tree_contact_t

   !> Hits of one boulder.
   type :: tree_hits_t
      integer :: n = 0
      type(tree_contact_t), allocatable :: hit(:)
   end type tree_hits_t

contains

   !> Return whether a map needs the hits of trees.
   pure logical function needs_tree_hits(maps)
      type(maps_t), intent(in) :: maps

      needs_tree_hits = associated(maps%tree_impacts) .or. associated(maps%tree_energy) .or. &
                        associated(maps%tree_height%max)
   end function needs_tree_hits

   pure subroutine add_tree_hit(hits, cell, height, absorbed)
      type(tree_hits_t), intent(inout) :: hits
      integer, intent(in) :: cell(2)         !! column, row
      real(wp), intent(in) :: height, absorbed  !! as in tree_contact_t [m], [J]
      type(tree_contact_t), allocatable :: larger(:)

      if (.not. allocated(hits%hit)) allocate (hits%hit(first_capacity))
      if (hits%n == size(hits%hit)) then
         allocate (larger(2*hits%n))
         larger(:hits%n) = hits%hit
         call move_alloc(larger, hits%hit)
      end if
      hits%n = hits%n + 1
      hits%hit(hits%n) = tree_contact_t(cell, height, absorbed)
   end subroutine add_tree_hit

   !> Add a boulder's tree hits to the maps; thread-safe.
   subroutine add_tree_hits(maps, hits)
      type(maps_t), intent(in) :: maps
      type(tree_hits_t), intent(in) :: hits
      integer :: k, held

      held = -1
      do k = 1, hits%n
         associate (i => hits%hit(k)%cell(1), r => hits%hit(k)%cell(2))
            call lock_band(maps, r, held)
            if (associated(maps%tree_impacts)) maps%tree_impacts(i, r) = maps%tree_impacts(i, r) + 1
            if (associated(maps%tree_energy)) &
               maps%tree_energy(i, r) = maps%tree_energy(i, r) + nint(hits%hit(k)%absorbed, i8)
            call add_value(maps%tree_height, i, r, hits%hit(k)%height, per_unit(jump_height))
         end associate
      end do
      call unlock_band(maps, held)
   end subroutine add_tree_hits
end module rockfall_tree_maps
