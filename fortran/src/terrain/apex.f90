! SPDX-License-Identifier: BSD-3-Clause
!> Apex of the talus below a source, from which shadow angles are measured (Evans and Hungr 1993, Can. Geotech. J. 30,
!> 620): the first point of the descent from the source that is no longer a cliff.
module rockfall_apex
   use rockfall_kinds, only: wp
   use rockfall_terrain, only: terrain_t, patch_t, locate, height, on_terrain, in_window
   implicit none
   private
   public :: find_apex, found, not_loaded, baseline

   !> Apex found; or end of the descent: in a pit, at unknown terrain, or at the edge of the loaded window.
   integer, parameter :: found = 0, pit = 1, unknown = 2, not_loaded = 3

   real(wp), parameter :: cliff = 1.0_wp      !! tangent of 45 degrees: talus is flatter
   real(wp), parameter :: flat = 0.364_wp     !! tangent of 20 degrees, below the shadow angles of boulders at rest
   real(wp), parameter :: baseline = 20.0_wp  !! shortest plan distance over which a slope is measured [m]
   integer, parameter :: sides(2, 4) = reshape([-1, 0, 1, 0, 0, -1, 0, 1], [2, 4])

contains

   !> Follow the steepest descent in steps of one cell. The apex is the point that a straight line as steep as a cliff
   !> touches from below: the mean slope from any point above it is steeper, to any point below it flatter. The descent
   !> ends in a pit, at unknown terrain, or where the line from the apex is flat; an apex within `baseline` of the end
   !> does not count.
   pure subroutine find_apex(dem, start, apex, status)
      type(terrain_t), intent(in) :: dem
      real(wp), intent(in) :: start(2)  !! source, local coordinates [m]
      real(wp), intent(out) :: apex(3)  !! apex, or point where the descent leaves the loaded window [m]
      integer, intent(out) :: status    !! one of the constants above
      real(wp) :: above(0:ceiling(baseline/dem%cell)), at(3), heading(2)
      integer :: k, n, since

      n = ubound(above, 1)
      heading = 0
      at = [start, 0.0_wp]
      call find_height(dem, at, status)
      apex = at
      since = 0  ! steps since the apex
      do k = 0, 4*(dem%nx + dem%ny)
         if (status == not_loaded) apex = at
         if (status == not_loaded) return
         if (status /= found) exit
         if (at(3) + cliff*since*dem%cell <= apex(3)) then
            apex = at
            since = 0
         end if
         if (k >= n) then
            if (at(3) >= above(mod(k - n, n + 1))) exit  ! a pit
         end if
         above(mod(k, n + 1)) = at(3)
         if (since >= n .and. apex(3) - at(3) < flat*since*dem%cell) exit
         call step_down(dem, heading, at, status)
         since = since + 1
      end do
      status = merge(found, pit, since >= n)
   end subroutine find_apex

   !> Go down by one cell along the mean gradient over `baseline`, so that hollows do not stop the descent; straight on
   !> if the ground is level; halfway between old and new direction if these are opposite, as in gullies.
   pure subroutine step_down(dem, heading, at, status)
      type(terrain_t), intent(in) :: dem
      real(wp), intent(inout) :: heading(2)  !! unit vector; 0 at the source
      real(wp), intent(inout) :: at(3)       !! [m]
      integer, intent(out) :: status         !! one of the constants above
      real(wp) :: probe(3), descent(2), before
      logical :: turns_back
      integer :: k

      descent = 0
      do k = 1, 4
         probe(:2) = at(:2) + 0.5_wp*baseline*sides(:, k)
         call find_height(dem, probe, status)
         if (status /= found) then
            at = probe
            return
         end if
         descent = descent - sides(:, k)*probe(3)
      end do
      descent = unit(descent)
      turns_back = dot_product(descent, heading) < 0
      if (turns_back) descent = unit(descent + heading)
      if (any(abs(descent) > 0)) heading = descent
      before = at(3)
      at(:2) = at(:2) + dem%cell*heading
      call find_height(dem, at, status)
      if (status == found .and. turns_back .and. at(3) >= before) status = pit
   end subroutine step_down

   !> Unit vector in the direction of a vector; 0 for 0.
   pure function unit(v)
      real(wp), intent(in) :: v(2)
      real(wp) :: unit(2)

      unit = v
      if (any(abs(v) > 0)) unit = v/sqrt(sum(v**2))
   end function unit

   !> Set at(3) to the elevation of a point.
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
