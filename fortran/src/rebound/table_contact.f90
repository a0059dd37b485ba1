! SPDX-License-Identifier: BSD-3-Clause
!> Contact from an impact table, adapted to the boulder's own ground: local frame, gravity and terrain (theory, chapter
!> 5).
module rockfall_table_contact
   use rockfall_kinds, only: wp
   use rockfall_random, only: words_per_block
   use rockfall_terrain, only: terrain_t, gradient, steepness_of
   use rockfall_boulder, only: boulder_t, soil_draw_t
   use rockfall_flight, only: landing_t
   use rockfall_rolling, only: roll_t, touch_t, find_slide
   use rockfall_direction, only: unit_vector, random_heading, along_aspect, shortest
   use rockfall_local_frame, only: in_local_frame, signed_w
   use rockfall_impact_table, only: impact_table_t, approach_t, outcome_t, find_part, beyond_ratios, &
                                    begin_draw, whole_bin, find_window, is_held, nearest_record, transfer_record, &
                                    exceeds_table, scaled_energy, mean_speed, flies, rolls_on, stops
   implicit none
   private
   public :: table_contact_t, table_contact, record_u, side_u
   ! Steps of table_contact:
   public :: update_touch, end_touch, keeps_sequence, resolve_on_plane, find_pull, find_record, apply_record, &
             limit_energy, after_fall, scale_to_energy, compute_departure, takeoff_height, velocity_after

   !> Indices of the uniform numbers of a contact: for the record, and for side or heading if the ground does not
   !> determine it.
   integer, parameter :: record_u = 1, side_u = 3

   !> Rise over R_b up to which a truncated contact continues [-]; the laboratory records higher rises as flights.
   real(wp), parameter :: max_rise = 0.02_wp
   !> V_n over V_t above which a contact of a rolling boulder on steeper ground counts as one after a flight [-].
   real(wp), parameter :: impact_ratio = 0.5_wp

   !> Twice the kinetic energy over m g R_b below which the laboratory considers a block at rest [-].
   real(wp), parameter :: rest_energy = 0.01_wp

   !> Speed over sqrt(g R_b) below which a boulder does not move [-]; avoids divisions by zero.
   real(wp), parameter :: min_speed = 1.0e-6_wp

   !> Energy fraction lost when a contact is limited [-]: every contact loses energy, so rocking boulders come to rest.
   real(wp), parameter :: min_loss = 0.02_wp

   type :: table_contact_t
      real(wp) :: v_in(3), v_out(3)  !! V_t, V_n, W [m/s]
      logical :: stops = .false.     !! the boulder stops, if the ground permits
      logical :: limited = .false.   !! the energy was limited
      logical :: fast = .false.      !! faster than all records at the same incidence and spin
   end type table_contact_t

contains

   !> Draw a contact, and find the path `roll` to its end. `touch` comes from update_touch, and is updated for the next
   !> contact.
   pure subroutine table_contact(dem, gravity, table, boulder, inertia, u, landing, v, before, omega_r, touch, &
                                 roll, contact)
      type(terrain_t), intent(in) :: dem
      real(wp), intent(in) :: gravity         !! [m/s2]
      type(impact_table_t), intent(in) :: table
      type(boulder_t), intent(in) :: boulder
      real(wp), intent(in) :: inertia         !! I/(m R_b**2) [-]
      real(wp), intent(in) :: u(words_per_block)  !! uniform in (0, 1) [-]
      type(landing_t), intent(in) :: landing
      real(wp), intent(in) :: v(3)            !! incoming velocity [m/s]
      real(wp), intent(in) :: before(2)       !! heading after the last contact, of any length
      real(wp), intent(in) :: omega_r         !! W relative to that heading [m/s]
      type(touch_t), intent(inout) :: touch
      type(roll_t), intent(inout) :: roll
      type(table_contact_t), intent(out) :: contact
      type(approach_t) :: in
      type(outcome_t) :: out
      real(wp) :: g(2), g_end(2), steepness, cosine, unit, t(3), side, slide, speed, total, left, per_total, &
                  velocity_factor, normal
      real(wp) :: touches, falls, flown, rolls, rests  ! 1 or 0
      integer :: bin, record, from, n
      logical :: off

      g = gradient(dem, landing%patch, landing%u, landing%w)
      steepness = steepness_of(g(1), g(2))
      cosine = 1/steepness
      unit = sqrt(gravity*boulder%radius)
      touches = merge(1.0_wp, 0.0_wp, touch%rolling)
      call resolve_on_plane(v(1), v(2), v(3), g(1), g(2), steepness, touches, touch%normal, &
                            contact%v_in(1), contact%v_in(2), t(1), t(2), t(3))
      if (.not. contact%v_in(1) > shortest) t = random_tangent(g, u(side_u))
      contact%v_in(3) = signed_w(omega_r, before(1), before(2), t(1), t(2))
      call find_pull(g(1), g(2), cosine, t(1), t(2), t(3), u(side_u), in%pull(1), in%pull(2), side)
      in%v = contact%v_in*(1/unit)
      in%speed = sqrt(in%v(1)*in%v(1) + in%v(2)*in%v(2))
      call find_record(table, inertia, touch, in, bin, record, contact%fast)
      if (record == 0) then
         call whole_bin(table, bin, from, n)
         if (is_held(in%speed)) call find_window(table, bin, in%pull(1), from, n)
         record = nearest_record(table, from, n, in%pull(2), u(record_u))
      end if
      call apply_record(table, bin, record, in, touch, out)

      call limit_energy(out%along, out%across, out%normal, out%w, inertia, out%allowed, in%speed, in%pull(1), &
                        out%reach, boulder%radius, total, left, per_total, speed, slide)
      contact%limited = left < total
      call find_slide(dem, gravity, landing, t, slide, out%duration*(unit/gravity), unit*speed, roll, off)
      g_end = g  ! beyond the known terrain, the gradient stays constant
      associate (end => roll%landing)
         if (end%contact) g_end = gradient(dem, end%patch, end%u, end%w)
         falls = merge(1.0_wp, 0.0_wp, off)
         left = after_fall(left, (landing%z - end%z - in%pull(1)*slide)/boulder%radius, falls)
      end associate

      flown = merge(1.0_wp, 0.0_wp, out%exit == flies)
      rolls = merge(1.0_wp, 0.0_wp, touch%rolling .and. .not. off)
      call scale_to_energy(per_total, left, out%along, out%across, out%normal, out%w, inertia, cosine, flown, &
                           touch%lift, velocity_factor, normal, rests)
      contact%stops = out%exit == stops .or. rests > 0
      contact%v_out = velocity_after(unit, velocity_factor*out%along, velocity_factor*out%across, normal, &
                                     velocity_factor*out%w)
      roll%w = unit*(velocity_factor*out%w)
      call compute_departure(unit*(velocity_factor*out%along), unit*(velocity_factor*side*out%across), unit*normal, &
                             g(1), g(2), cosine, t(1), t(2), t(3), g_end(1), g_end(2), rolls, touch%normal, &
                             roll%heading(1), roll%heading(2), roll%v(1), roll%v(2), roll%v(3))
      call end_touch(off, rolls > 0, touch)
      roll%above = takeoff_height(touch%lift, boulder%radius, rolls)
   end subroutine table_contact

   !> Update the state of the previous contact. The boulder is still in that contact if it has hardly risen since. On a
   !> different ground or R_b/R_m, the sequence of records ends, and another part of a table applies.
   pure subroutine update_touch(table, ground, ratio, boulder, soil, gravity, jump_height, touch)
      type(impact_table_t), intent(in) :: table  !! impact table of the ground
      integer, intent(in) :: ground
      real(wp), intent(in) :: ratio        !! R_b/R_m [-]
      type(boulder_t), intent(in) :: boulder
      type(soil_draw_t), intent(in) :: soil
      real(wp), intent(in) :: gravity      !! [m/s2]
      real(wp), intent(in) :: jump_height  !! maximum height since the previous contact [m]
      type(touch_t), intent(inout) :: touch
      integer :: stays, rolling  ! 1 or 0

      if (touch%ground /= ground .or. touch%ratio /= ratio) then
         touch%next = 0
         touch%ground = ground
         touch%ratio = ratio
         touch%beyond = beyond_ratios(table, ratio)
         call find_part(table, boulder%radius, boulder%mass/boulder%volume, gravity, ratio, soil, touch%part, touch%key)
      end if
      stays = merge(0, 1, jump_height > max_rise*boulder%radius)  ! branches would be mispredicted
      rolling = merge(1, 0, touch%rolling)
      touch%next = touch%next*max(stays, 1 - rolling)
      touch%rolling = rolling*stays > 0
      touch%lift = touch%lift*(rolling*stays)
   end subroutine update_touch

   !> Update whether a boulder is still in contact. The recorded sequence ends where the ground falls away, or where the
   !> boulder leaves the ground although the block stayed on it.
   pure subroutine end_touch(off, rolls, touch)
      logical, intent(in) :: off    !! from find_slide
      logical, intent(in) :: rolls  !! as returned by compute_departure
      type(touch_t), intent(inout) :: touch

      touch%next = touch%next*int(keeps_sequence(merge(1.0_wp, 0.0_wp, off), merge(1.0_wp, 0.0_wp, touch%rolling), &
                                          merge(1.0_wp, 0.0_wp, rolls)))
      touch%rolling = rolls
   end subroutine end_touch

   !> Return 1 if the next contact follows the recorded sequence, else 0.
   elemental real(wp) function keeps_sequence(off, rolled, rolls)
      real(wp), intent(in) :: off            !! as returned by find_slide: 1 or 0
      real(wp), intent(in) :: rolled, rolls  !! 1 if the block stayed on the ground, and if the boulder does; else 0

      keeps_sequence = merge(0.0_wp, 1.0_wp, rolled > rolls)
      keeps_sequence = merge(0.0_wp, keeps_sequence, off > 0)
   end function keeps_sequence

   !> Split a velocity into V_t and V_n, with the unit tangent of its motion on a plane. A boulder still in contact
   !> keeps the V_n of that contact.
   elemental subroutine resolve_on_plane(v1, v2, v3, g1, g2, steepness, touches, pressed, tangential, normal, t1, t2, &
                                         t3)
      real(wp), intent(in) :: v1, v2, v3           !! [m/s]
      real(wp), intent(in) :: g1, g2, steepness    !! gradient of the plane, sqrt(1 + |g|**2) [-]
      real(wp), intent(in) :: touches, pressed     !! still in the previous contact: 1 or 0; V_n of that contact [m/s]
      real(wp), intent(out) :: tangential, normal  !! V_t, V_n [m/s]
      real(wp), intent(out) :: t1, t2, t3          !! tangent; zero if V_t is not above `shortest` [-]
      real(wp) :: plan1, plan2, inverse

      call in_local_frame(v1, v2, v3, g1, g2, steepness, tangential, normal, plan1, plan2)
      normal = merge(pressed, normal, touches > 0)
      inverse = 1/max(tangential, shortest)
      t1 = plan1*inverse
      t2 = plan2*inverse
      t3 = g1*t1 + g2*t2
   end subroutine resolve_on_plane

   !> Unit tangent for an impact along the normal of a plane: downslope, or in a random direction on a flat plane.
   pure function random_tangent(g, u) result(t)
      real(wp), intent(in) :: g(2)  !! gradient of the plane [-]
      real(wp), intent(in) :: u     !! uniform in (0, 1) [-]
      real(wp) :: t(3)

      t(1:2) = unit_vector(-g)
      if (all(t(1:2) == 0)) t(1:2) = random_heading(u)
      t(3) = g(1)*t(1) + g(2)*t(2)
      t = t/sqrt(1 + t(3)*t(3))
   end function random_tangent

   !> Components of gravity along and across a tangent, and side of the descent.
   elemental subroutine find_pull(g1, g2, cosine, t1, t2, t3, u, along, across, side)
      real(wp), intent(in) :: g1, g2             !! gradient of the plane [-]
      real(wp), intent(in) :: cosine             !! cosine of the slope, 1/sqrt(1 + |g|**2) [-]
      real(wp), intent(in) :: t1, t2, t3         !! unit tangent [-]
      real(wp), intent(in) :: u                  !! uniform in (0, 1), used if neither side descends [-]
      real(wp), intent(out) :: along, across     !! components over g; across towards the descent [-]
      real(wp), intent(out) :: side              !! side of the descent: 1 left, -1 right [-]
      real(wp) :: left

      along = -t3
      left = (g1*t2 - g2*t1)*cosine
      across = abs(left)
      side = merge(1.0_wp, -1.0_wp, u < 0.5_wp)
      side = merge(sign(1.0_wp, left), side, across > along_aspect)
   end subroutine find_pull

   !> Find the bin of a contact, and its record unless it must be drawn from the bin.
   pure subroutine find_record(table, inertia, touch, in, bin, record, fast)
      type(impact_table_t), intent(in) :: table
      real(wp), intent(in) :: inertia               !! as in table_contact [-]
      type(touch_t), intent(in) :: touch
      type(approach_t), intent(inout) :: in         !! v, speed and pull on entry; complete on return
      integer, intent(out) :: bin, record           !! as returned by begin_draw
      logical, intent(out) :: fast                  !! as in table_contact_t

      in%next = touch%next
      in%height = touch%height
      in%rolling = touch%rolling
      in%inertia = inertia
      in%key = touch%key
      in%stretch = sqrt(touch%key)
      call begin_draw(table, touch%part, in, bin, record)
      fast = .false.
      if (bin > 0) fast = exceeds_table(table%fastest(bin), in%key*(in%speed*in%speed), 0.0_wp) > 0
   end subroutine find_record

   !> Apply the record, and store the state for the next contact.
   pure subroutine apply_record(table, bin, record, in, touch, out)
      type(impact_table_t), intent(in) :: table
      integer, intent(in) :: bin, record
      type(approach_t), intent(in) :: in
      type(touch_t), intent(inout) :: touch
      type(outcome_t), intent(out) :: out

      call transfer_record(table, bin, record, in, out)
      touch%lift = touch%lift + out%rise
      touch%height = out%height
      touch%rolling = out%exit == rolls_on
      touch%next = out%next
   end subroutine apply_record

   !> Limit the energy to slightly less than the energy before the contact plus the work of gravity along the slope.
   !> Compute the mean speed and the length that remain; gravity works only along this length.
   elemental subroutine limit_energy(along, across, normal, w, inertia, allowed, speed_in, pull, reach, radius, total, &
                                     left, per_total, speed, slide)
      real(wp), intent(in) :: along, across, normal, w, inertia, allowed, reach  !! as in outcome_t [-]
      real(wp), intent(in) :: speed_in, pull  !! speed before the contact; gravity along the tangent, over g [-]
      real(wp), intent(in) :: radius        !! R_b [m]
      real(wp), intent(out) :: total, left  !! twice the kinetic energy over m g R_b: as drawn, after limiting [-]
      real(wp), intent(out) :: per_total    !! 1/total [-]
      real(wp), intent(out) :: speed        !! remaining mean speed [-]
      real(wp), intent(out) :: slide        !! remaining length along the ground [m]
      real(wp) :: drawn, factor, work, limit

      total = scaled_energy(along, across, normal, w, inertia)
      drawn = mean_speed(speed_in, along, across, normal)
      work = 2*max(0.0_wp, pull)*max(0.0_wp, reach)  ! work of gravity, divided by the speed
      limit = allowed + work*drawn
      left = merge((1 - min_loss)*limit, total, total > limit)
      per_total = 1/max(total, tiny(total))
      factor = merge(left*per_total, 1.0_wp, total > limit)
      speed = sqrt(0.5_wp*(speed_in*speed_in + factor*(along*along + across*across + normal*normal)))
      left = max(0.0_wp, left - work*(drawn - speed))
      slide = max(0.0_wp, reach)*speed*radius
   end subroutine limit_energy

   !> Correct the remaining energy for ground that falls more or less than a plane. No correction if the boulder leaves
   !> the ground at once because the ground falls away.
   elemental real(wp) function after_fall(left, extra_drop, off)
      real(wp), intent(in) :: left  !! as returned by limit_energy [-]
      real(wp), intent(in) :: extra_drop  !! drop beyond the drop of the plane, over R_b [-]
      real(wp), intent(in) :: off   !! 1 if the ground falls away, else 0

      after_fall = merge(max(0.0_wp, left + 2*extra_drop), left, left > min_speed*min_speed)
      after_fall = merge(left, after_fall, off > 0)
   end function after_fall

   !> Scale the velocity to the remaining energy, and decide whether the boulder rests. A boulder that takes off below
   !> the height of its landing is in a hollow of the relief and must climb to the mean ground; if it is too slow, it
   !> lands in the hollow again.
   elemental subroutine scale_to_energy(per_total, left, along, across, drawn, w, inertia, cosine, flies, lift, &
                                        velocity_factor, normal, rests)
      real(wp), intent(in) :: per_total, left         !! as returned by limit_energy [-]
      real(wp), intent(in) :: along, across, drawn, w, inertia  !! as in limit_energy; V_n as drawn [-]
      real(wp), intent(in) :: cosine                  !! as in find_pull [-]
      real(wp), intent(in) :: flies                   !! 1 if the boulder takes off, else 0
      real(wp), intent(inout) :: lift                 !! as in touch_t [-]
      real(wp), intent(out) :: velocity_factor        !! factor on the velocity [-]
      real(wp), intent(out) :: normal                 !! remaining V_n [-]
      real(wp), intent(out) :: rests                  !! 1 if the boulder rests, else 0
      real(wp) :: energy_fraction, square, climbs

      energy_fraction = left*per_total
      velocity_factor = sqrt(energy_fraction)
      square = energy_fraction*(drawn*drawn) + 2*lift*cosine
      climbs = merge(flies, 0.0_wp, lift < 0)
      climbs = merge(climbs, 0.0_wp, square > 0)
      normal = merge(sqrt(max(0.0_wp, square)), velocity_factor*drawn, climbs > 0)
      lift = merge(0.0_wp, lift, climbs > 0)
      rests = merge(1.0_wp, 0.0_wp, scaled_energy(velocity_factor*along, velocity_factor*across, normal, &
                                                  velocity_factor*w, inertia) < rest_energy)
   end subroutine scale_to_energy

   !> Height [m] above the ground at which the next flight starts.
   elemental real(wp) function takeoff_height(lift, radius, rolls)
      real(wp), intent(in) :: lift    !! as in touch_t [-]
      real(wp), intent(in) :: radius  !! R_b [m]
      real(wp), intent(in) :: rolls   !! 1 if the boulder stays on the ground, else 0

      takeoff_height = merge(0.0_wp, max(0.0_wp, lift)*radius, rolls > 0)
   end function takeoff_height

   !> V_t, V_n, W [m/s] after a contact.
   pure function velocity_after(unit, along, across, normal, w) result(v)
      real(wp), intent(in) :: unit                      !! unit of speed, sqrt(g R_b) [m/s]
      real(wp), intent(in) :: along, across, normal, w  !! values after limiting [-]
      real(wp) :: v(3)

      v = unit*[sign(sqrt(along*along + across*across), along), normal, merge(-w, w, along < 0)]
   end function velocity_after

   !> Velocity at the end of a contact. A flying boulder keeps its velocity relative to the ground at the start; a
   !> rolling boulder stays on the ground, and hits it where it rises.
   elemental subroutine compute_departure(along, across, normal, g1, g2, cosine, t1, t2, t3, end1, end2, rolls, &
                                          pressed, heading1, heading2, v1, v2, v3)
      real(wp), intent(in) :: along, across, normal  !! velocity in the frame of the start, across to the left [m/s]
      real(wp), intent(in) :: g1, g2, cosine         !! ground at the start, as in find_pull [-]
      real(wp), intent(in) :: t1, t2, t3             !! tangent at the start [-]
      real(wp), intent(in) :: end1, end2             !! gradient at the end [-]
      real(wp), intent(inout) :: rolls               !! 1 if the boulder stays on the ground, else 0
      real(wp), intent(inout) :: pressed             !! V_n of a rolling boulder [m/s]
      real(wp), intent(out) :: heading1, heading2    !! heading of any length
      real(wp), intent(out) :: v1, v2, v3            !! [m/s]
      real(wp) :: plan1, plan2, rise, end_steepness, speed, tangential, against, slope1, slope2, runs, up

      ! components along the tangent and along normal x tangent
      plan1 = along*t1 - across*((t2 + g2*t3)*cosine)
      plan2 = along*t2 + across*((t1 + g1*t3)*cosine)
      end_steepness = steepness_of(end1, end2)
      speed = sqrt(along*along + across*across)
      call in_local_frame(plan1, plan2, g1*plan1 + g2*plan2, end1, end2, end_steepness, tangential, against, slope1, &
                          slope2)
      runs = merge(1.0_wp, 0.0_wp, against < 0)
      pressed = merge(normal + against, pressed, rolls > 0)
      heading1 = merge(slope1, plan1, rolls > 0)
      heading2 = merge(slope2, plan2, rolls > 0)
      speed = merge(merge(tangential, speed, runs > 0), speed, rolls > 0)  ! ground that falls away deflects the boulder
      up = merge(pressed, max(0.0_wp, normal), rolls > 0)
      rolls = merge(merge(rolls, 0.0_wp, pressed > -impact_ratio*tangential), rolls, runs > 0)
      up = merge(0.0_wp, up*(1/end_steepness), rolls > 0)
      rise = end1*heading1 + end2*heading2
      speed = speed/max(sqrt(heading1*heading1 + heading2*heading2 + rise*rise), tiny(speed))
      v1 = speed*heading1 - up*end1
      v2 = speed*heading2 - up*end2
      v3 = speed*rise + up
   end subroutine compute_departure
end module rockfall_table_contact
