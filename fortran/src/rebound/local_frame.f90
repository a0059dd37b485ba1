! SPDX-License-Identifier: BSD-3-Clause
!> Local frame of an impact: the plane of the surface normal and the tangential direction of motion. Procedures
!> transform the incoming velocity to this frame, and compute the next flight from the velocity after the impact.
module rockfall_local_frame
   use rockfall_kinds, only: wp
   use rockfall_terrain, only: terrain_t, cell_descent
   use rockfall_flight, only: flight_t, landing_t
   use rockfall_direction, only: turning_t, unit_vector, random_heading, new_heading
   implicit none
   private
   public :: decompose, in_local_frame, signed_w, face_forward, launch_velocity, outgoing_flight

contains

   !> Transform the incoming velocity to the local frame of the impact (Bourrier et al. 2009, eqs 4, 5; theory, chapter
   !> 5): the plane of the surface normal n = (-g, 1)/sqrt(1 + |g|**2) and the tangential direction of motion t. Hence
   !> V_n = v.n <= 0 and V_t = |v - V_n n| >= 0. `heading` is the heading of t in plan, or zero if t is undefined.
   pure subroutine decompose(v, g, steepness, before, omega_r, v_in, heading)
      real(wp), intent(in) :: v(3)         !! [m/s]
      real(wp), intent(in) :: g(2)         !! gradient of the patch [-]
      real(wp), intent(in) :: steepness    !! sqrt(1 + |g|**2) [-]
      real(wp), intent(in) :: before(2)    !! heading after the last rebound, of any length
      real(wp), intent(in) :: omega_r      !! W with respect to this heading [m/s]
      real(wp), intent(out) :: v_in(3)     !! V_t, V_n, W [m/s]
      real(wp), intent(out) :: heading(2)  !! unit, or zero [-]
      real(wp) :: plan(2)

      call in_local_frame(v(1), v(2), v(3), g(1), g(2), steepness, v_in(1), v_in(2), plan(1), plan(2))
      heading = unit_vector(plan)
      v_in(3) = signed_w(omega_r, before(1), before(2), heading(1), heading(2))
   end subroutine decompose

   !> Split a velocity into V_t and V_n, with its tangential part in plan.
   elemental subroutine in_local_frame(v1, v2, v3, g1, g2, steepness, tangential, normal, plan1, plan2)
      real(wp), intent(in) :: v1, v2, v3           !! [m/s]
      real(wp), intent(in) :: g1, g2               !! gradient of the patch [-]
      real(wp), intent(in) :: steepness            !! sqrt(1 + |g|**2) [-]
      real(wp), intent(out) :: tangential, normal  !! V_t, V_n [m/s]
      real(wp), intent(out) :: plan1, plan2        !! [m/s]
      real(wp) :: n1, n2, n3, t3

      n3 = 1/steepness
      n1 = -g1*n3
      n2 = -g2*n3
      normal = v1*n1 + v2*n2 + v3*n3
      plan1 = v1 - normal*n1
      plan2 = v2 - normal*n2
      t3 = v3 - normal*n3
      tangential = sqrt(plan1*plan1 + plan2*plan2 + t3*t3)
      normal = min(0.0_wp, normal)
   end subroutine in_local_frame

   !> W before an impact [m/s]: its sign changes if the heading has reversed since the last rebound.
   elemental real(wp) function signed_w(omega_r, before1, before2, heading1, heading2) result(w)
      real(wp), intent(in) :: omega_r             !! W with respect to the heading before [m/s]
      real(wp), intent(in) :: before1, before2    !! heading after the last rebound, of any length
      real(wp), intent(in) :: heading1, heading2  !! present heading, of any length

      w = omega_r
      if (before1*heading1 + before2*heading2 < 0) w = -omega_r
   end function signed_w

   !> Make V_t non-negative after an impact by reversing the heading and the sign of W.
   elemental subroutine face_forward(tangential, heading1, heading2, w)
      real(wp), intent(in) :: tangential             !! V_t [m/s]
      real(wp), intent(inout) :: heading1, heading2  !! heading before the impact [-]
      real(wp), intent(inout) :: w                   !! W after the impact [m/s]
      real(wp) :: forward

      forward = merge(-1.0_wp, 1.0_wp, tangential < 0)
      heading1 = forward*heading1
      heading2 = forward*heading2
      w = forward*w
   end subroutine face_forward

   !> Velocity after an impact from V_t (of either sign) along a heading and V_n. The height above the patch grows at
   !> v.(-g, 1) = V_n sqrt(1 + |g|**2) (theory, chapter 5).
   elemental subroutine launch_velocity(tangential, normal, heading1, heading2, g1, g2, steepness, v1, v2, v3, rate)
      real(wp), intent(in) :: tangential, normal  !! V_t, V_n [m/s]
      real(wp), intent(in) :: heading1, heading2  !! unit [-]
      real(wp), intent(in) :: g1, g2              !! gradient of the patch [-]
      real(wp), intent(in) :: steepness           !! sqrt(1 + |g|**2) [-]
      real(wp), intent(out) :: v1, v2, v3         !! [m/s]
      real(wp), intent(out) :: rate               !! rate of change of the height above the patch [m/s]
      real(wp) :: along, forward, up

      along = g1*heading1 + g2*heading2
      forward = abs(tangential)/sqrt(1 + along*along)
      up = normal/steepness
      v1 = forward*heading1 - up*g1
      v2 = forward*heading2 - up*g2
      v3 = forward*along + up
      rate = normal*steepness
   end subroutine launch_velocity

   !> Start of the next flight: V_t_out in the tangent plane over the new heading h, along (h, g.h)/sqrt(1 + (g.h)**2),
   !> and V_n_out along the normal (theory, chapters 5 and 6).
   pure subroutine outgoing_flight(dem, landing, cell, g, steepness, before, turning, v_out, flight, omega_r)
      type(terrain_t), intent(in) :: dem
      type(landing_t), intent(in) :: landing
      integer, intent(in) :: cell(2)          !! raster cell of the contact
      real(wp), intent(in) :: g(2)            !! gradient of the patch [-]
      real(wp), intent(in) :: steepness       !! sqrt(1 + |g|**2) [-]
      real(wp), intent(in) :: before(2)       !! heading before the impact [-]; zero if vertical on flat ground
      type(turning_t), intent(in) :: turning
      real(wp), intent(in) :: v_out(3)        !! V_t, V_n, W [m/s]
      type(flight_t), intent(inout) :: flight
      real(wp), intent(out) :: omega_r        !! W [m/s]
      real(wp) :: heading(2), descent(2)
      logical :: pit

      call cell_descent(dem, cell, g, descent, pit)
      heading = before
      if (all(heading == 0)) heading = unit_vector(descent)
      if (all(heading == 0)) heading = random_heading(turning%u)
      omega_r = v_out(3)
      call face_forward(v_out(1), heading(1), heading(2), omega_r)
      heading = new_heading(turning, heading, g, descent, pit)
      call launch_velocity(v_out(1), v_out(2), heading(1), heading(2), g(1), g(2), steepness, &
                           flight%v(1), flight%v(2), flight%v(3), flight%rate)
      flight%heading = heading
      call start_at_landing(landing, flight)
   end subroutine outgoing_flight

   !> Start a flight on the ground at the last landing.
   pure subroutine start_at_landing(landing, flight)
      type(landing_t), intent(in) :: landing
      type(flight_t), intent(inout) :: flight

      flight%above = 0
      flight%x = landing%x
      flight%y = landing%y
      flight%z = landing%z
      flight%patch = landing%patch
   end subroutine start_at_landing
end module rockfall_local_frame
