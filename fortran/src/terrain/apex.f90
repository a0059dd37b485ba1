! SPDX-License-Identifier: BSD-3-Clause
!> Apex of the talus below a source, from which shadow angles are measured (Evans and Hungr 1993, Can. Geotech. J. 30,
!> 620): the first point of the descent from the source that is no longer a cliff.
module rockfall_apex
   use rockfall_kinds, only: wp
   use rockfall_math, only: tangent
   use rockfall_terrain, only: terrain_t, patch_t, locate, height, on_terrain, in_window
   use rockfall_steep_cells, only: usual_threshold
   implicit none
   private
   public :: find_apex, found, not_loaded

   !> Ends of the descent: at the apex, in a pit, at unknown terrain, or at the edge of the loaded window.
   integer, parameter :: found = 0, pit = 1, unknown = 2, not_loaded = 3

   real(wp), parameter :: beyond = 20.0_wp  !! distance below the apex that must not be a cliff either [m]
   integer, parameter :: sides(2, 4) = reshape([-1, 0, 1, 0, 0, -1, 0, 1], [2, 4])

contains

   !> Follow the steepest descent in steps of one cell, to the first point from which neither the next step nor the next
   !> `beyond` metres exceed the usual slope threshold of sources. The descent ends in a pit where it turns back or does
   !> not get lower.
   pure subroutine find_apex(dem, start, apex, status)
      type(terrain_t), intent(in) :: dem
      real(wp), intent(in) :: start(2)  !! source, local coordinates [m]
      real(wp), intent(out) :: apex(3)  !! apex, or point where the descent leaves the terrain [m]
      integer, intent(out) :: status    !! one of the constants above
      real(wp) :: way(3, 0:ceiling(beyond/dem%cell)), at(3), heading(2), fall
      integer :: k, n

      n = ubound(way, 2)
      fall = dem%cell*tangent(usual_threshold(dem%cell))
      heading = 0
      at = [start, 0.0_wp]
      call find_height(dem, at, status)
      way(:, 0) = at
      do k = 1, 4*(dem%nx + dem%ny)
         if (status == found) call step_down(dem, heading, at, status)
         apex = at
         if (status /= found) return
         way(:, mod(k, n + 1)) = at
         if (k < n) cycle
         apex = way(:, mod(k + 1, n + 1))
         if (apex(3) - way(3, mod(k + 2, n + 1)) >= fall .or. apex(3) - at(3) >= n*fall) cycle
         if (at(3) > apex(3)) exit
         return
      end do
      status = pit
   end subroutine find_apex

   !> Go down by one cell along the mean gradient over `beyond`, so that hollows do not stop the descent; straight on if
   !> the ground is level.
   pure subroutine step_down(dem, heading, at, status)
      type(terrain_t), intent(in) :: dem
      real(wp), intent(inout) :: heading(2)  !! unit vector; 0 at the source
      real(wp), intent(inout) :: at(3)       !! [m]
      integer, intent(out) :: status         !! one of the constants above
      real(wp) :: probe(3), descent(2)
      integer :: k

      descent = 0
      do k = 1, 4
         probe(:2) = at(:2) + 0.5_wp*beyond*sides(:, k)
         call find_height(dem, probe, status)
         if (status /= found) then
            at = probe
            return
         end if
         descent = descent - sides(:, k)*probe(3)
      end do
      if (dot_product(descent, heading) < 0) status = pit
      if (any(abs(descent) > 0)) heading = descent/sqrt(sum(descent**2))
      at(:2) = at(:2) + dem%cell*heading
      if (status == found) call find_height(dem, at, status)
   end subroutine step_down

   !> Elevation at a point.
   pure subroutine find_height(dem, at, status)
      type(terrain_t), intent(in) :: dem
      real(wp), intent(inout) :: at(3)  !! [m]
      integer, intent(out) :: status    !! found, unknown or not_loaded
      type(patch_t) :: patch
      real(wp) :: u, w

      status = unknown
      if (.not. on_terrain(dem, at(1), at(2))) return
      call locate(dem, at(1), at(2), patch, u, w)
      if (patch%known) status = found
      if (.not. in_window(dem, patch%i, patch%j)) status = not_loaded
      at(3) = height(patch, u, w)
   end subroutine find_height
end module rockfall_apex
