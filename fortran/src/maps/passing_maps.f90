! SPDX-License-Identifier: BSD-3-Clause
!> Maps of the passing height of boulder centres, vertically above the surface. If the lowest point of a boulder is at
!> height h over a slope, its centre is at h + R / cos(slope), as at lines, with the slope of the cell (Horn 1981).
module rockfall_passing_maps
   use rockfall_kinds, only: wp
   use rockfall_terrain, only: terrain_t
   use rockfall_steep_cells, only: surface_ratios
   use rockfall_bins, only: passing_height
   use rockfall_maps, only: maps_t, visits_t, visit_cell, per_unit, add_value, count_bin, is_requested, lock_band, &
                            unlock_band
   implicit none
   private
   public :: needs_passing, add_passing, merge_passing, max_steepness

   real(wp), parameter :: max_steepness = 1.0e3_wp  !! maximum 1/cos(slope) of a cell [-]; larger values are clamped

contains

   !> Return whether any map shows passing heights.
   pure logical function needs_passing(maps)
      type(maps_t), intent(in) :: maps

      needs_passing = is_requested(maps%layer(passing_height))
   end function needs_passing

   !> Merge the maximum heights of a fragment's centre into the heights of its boulder, cell by cell; `add_passing` then
   !> uses radius zero.
   pure subroutine merge_passing(passing, visits, dem, radius)
      type(visits_t), intent(inout) :: passing
      type(visits_t), intent(in) :: visits
      type(terrain_t), intent(in) :: dem
      real(wp), intent(in) :: radius  !! radius of the fragment [m]
      integer :: k

      do k = 1, visits%n
         call visit_cell(passing, visits%visit(k)%cell, 0.0_wp, 0.0_wp, centre_height(visits, k, dem, radius))
      end do
   end subroutine merge_passing

   !> Height of a boulder's centre [m] in the k-th cell visited.
   pure real(wp) function centre_height(visits, k, dem, radius) result(height)
      type(visits_t), intent(in) :: visits
      integer, intent(in) :: k
      type(terrain_t), intent(in) :: dem
      real(wp), intent(in) :: radius  !! [m]
      real(wp) :: ratio(1)

      associate (visit => visits%visit(k))
         ratio = surface_ratios(dem, [(visit%cell(1) - 1)*dem%cell], [(dem%ny - visit%cell(2))*dem%cell])
         height = visit%max(3) + radius*min(max_steepness, ratio(1))
      end associate
   end function centre_height

   !> Add the maximum heights of a boulder's centre in its visited cells; thread-safe.
   subroutine add_passing(maps, visits, dem, radius)
      type(maps_t), intent(in) :: maps
      type(visits_t), intent(in) :: visits
      type(terrain_t), intent(in) :: dem
      real(wp), intent(in) :: radius  !! R_b [m]
      real(wp) :: height
      integer :: k, held

      held = -1
      do k = 1, visits%n
         associate (visit => visits%visit(k))
            height = centre_height(visits, k, dem, radius)
            call lock_band(maps, visit%cell(2), held)
            call add_value(maps%layer(passing_height), visit%cell(1), visit%cell(2), height, per_unit(passing_height))
            call count_bin(maps, passing_height, visit%cell(1), visit%cell(2), height)
         end associate
      end do
      call unlock_band(maps, held)
   end subroutine add_passing
end module rockfall_passing_maps
