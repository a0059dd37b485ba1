! SPDX-License-Identifier: BSD-3-Clause
!> A contact from a table on the boulder's own ground: in its local frame, with its gravity, over its terrain
!> (theory, chapter 5).
module rockfall_table_contact
   use rockfall_kinds, only: wp
   use rockfall_random, only: words_per_block
   use rockfall_terrain, only: terrain_t, gradient
   use rockfall_boulder, only: boulder_t
   use rockfall_flight, only: landing_t
   use rockfall_rolling, only: roll_t, touch_t, find_slide
   use rockfall_direction, only: unit_vector, any_heading, along_aspect
   use rockfall_local_frame, only: decompose, launch_velocity
   use rockfall_impact_table, only: impact_table_t, approach_t, outcome_t, draw_contact, ratio_at, beyond_table, &
                                    flies, rolls_on, stops
   implicit none
   private
   public :: table_contact_t, table_contact

   !> What of the random numbers of a contact is for what: the record; the part of the table; where there is no side or
   !> heading of its own.
   integer, parameter :: record_u = 1, ratio_u = 2, side_u = 3

   !> A boulder whose last contact was cut is still in it if it has not risen more than this since, over R_b [-]: what
   !> the laboratory calls a flight is higher.
   real(wp), parameter :: hop = 0.02_wp
   !> One that rolls against steeper ground meets it as if it flew where V_n is more than this part of V_t [-].
   real(wp), parameter :: meets = 0.5_wp

   !> Twice the kinetic energy over m g R_b below which the laboratory takes a block for one at rest [-].
   real(wp), parameter :: rest_energy = 0.01_wp

   !> A boulder this slow goes nowhere, over sqrt(g R_b) [-]: times must be numbers.
   real(wp), parameter :: still = 1.0e-6_wp

   type :: table_contact_t
      real(wp) :: v_in(3), v_out(3)  !! V_t, V_n, W [m/s]
      logical :: stops = .false.     !! if the ground lets it
      logical :: limited = .false.   !! to its energy
      logical :: fast = .false.      !! faster than the table knows
   end type table_contact_t

contains

   !> Draw a contact, and find where it leads: `roll`.
   pure subroutine table_contact(dem, gravity, table, boulder, inertia, ratio, u, landing, v, before, omega_r, touch, &
                                 roll, contact)
      type(terrain_t), intent(in) :: dem
      real(wp), intent(in) :: gravity         !! [m/s2]
      type(impact_table_t), intent(in) :: table
      type(boulder_t), intent(in) :: boulder
      real(wp), intent(in) :: inertia         !! I/(m R_b**2) [-]
      real(wp), intent(in) :: ratio           !! R_b/R_m [-]
      real(wp), intent(in) :: u(words_per_block)  !! uniform in (0, 1) [-]
      type(landing_t), intent(in) :: landing
      real(wp), intent(in) :: v(3)            !! incoming velocity [m/s]
      real(wp), intent(in) :: before(2)       !! heading after the last contact [-]
      real(wp), intent(in) :: omega_r         !! W with respect to it [m/s]
      type(touch_t), intent(inout) :: touch
      type(roll_t), intent(inout) :: roll
      type(table_contact_t), intent(out) :: contact
      type(approach_t) :: in
      type(outcome_t) :: out
      real(wp) :: g(2), steepness, heading(2), unit, along, side, slide, speed
      logical :: off

      g = gradient(dem, landing%patch, landing%u, landing%w)
      steepness = sqrt(1 + g(1)**2 + g(2)**2)
      call decompose(v, g, steepness, before, omega_r, contact%v_in, heading)
      if (all(heading == 0)) heading = unit_vector(-g)
      if (all(heading == 0)) heading = any_heading(u(side_u))
      if (landing%jump_height > hop*boulder%radius .and. touch%rolling) then
         touch%rolling = .false.
         touch%next = 0
      end if
      if (touch%rolling) contact%v_in(2) = touch%normal
      if (.not. touch%rolling) touch%lift = 0
      unit = sqrt(gravity*boulder%radius)
      in%v = contact%v_in/unit
      in%height = touch%height
      in%rolling = touch%rolling
      in%next = touch%next
      in%unit2 = gravity*boulder%radius
      in%density = boulder%mass/boulder%volume
      in%inertia = inertia
      along = g(1)*heading(1) + g(2)*heading(2)
      in%pull(1) = -along/sqrt(1 + along*along)
      in%pull(2) = (g(1)*heading(2) - g(2)*heading(1))/(steepness*sqrt(1 + along*along))
      side = sign(1.0_wp, in%pull(2))
      if (abs(in%pull(2)) <= along_aspect) side = merge(1.0_wp, -1.0_wp, u(side_u) < 0.5_wp)
      in%pull(2) = abs(in%pull(2))
      contact%fast = beyond_table(table, in)
      call draw_contact(table, ratio_at(table, ratio, u(ratio_u)), u(record_u), in, out)
      contact%limited = out%limited
      touch%lift = touch%lift + out%rise
      touch%height = out%height
      touch%rolling = out%exit == rolls_on
      touch%next = out%next
      slide = max(0.0_wp, out%advance)*boulder%radius/sqrt(1 + along*along)
      speed = unit*sqrt(0.5_wp*(in%v(1)**2 + in%v(2)**2 + out%along**2 + out%across**2 + out%normal**2))
      if (.not. speed > still*unit) slide = 0
      call find_slide(dem, gravity, landing, heading, slide, out%duration*sqrt(boulder%radius/gravity), speed, &
                      roll, off)
      if (off) then
         call find_slide(dem, gravity, landing, heading, 0.0_wp, 0.0_wp, 0.0_wp, roll, off)
         touch%rolling = .false.
         touch%next = 0
      else
         call fall(out, (landing%z - roll%landing%z)/boulder%radius &
                   - in%pull(1)*slide*sqrt(1 + along*along)/boulder%radius, inertia)
      end if
      if (out%exit == flies) call climb(out, touch%lift, 1/steepness)
      contact%v_out = unit*[sign(sqrt(out%along**2 + out%across**2), out%along), out%normal, &
                           merge(-out%w, out%w, out%along < 0)]
      contact%stops = out%exit == stops .or. energy_left(out, inertia) < rest_energy
      call leave(dem, g, steepness, heading, along, side, unit, out, touch, roll)
      roll%above = 0
      if (.not. touch%rolling) roll%above = max(0.0_wp, touch%lift)*boulder%radius
   end subroutine table_contact

   !> Where the ground falls by more, or less, than a plane would have, gravity has done so much more work.
   pure subroutine fall(out, more, inertia)
      type(outcome_t), intent(inout) :: out
      real(wp), intent(in) :: more     !! over R_b [-]
      real(wp), intent(in) :: inertia  !! I/(m R_b**2) [-]
      real(wp) :: energy, part

      energy = energy_left(out, inertia)
      if (.not. energy > still**2) return
      part = sqrt(max(0.0_wp, 1 + 2*more/energy))
      out%along = part*out%along
      out%across = part*out%across
      out%normal = part*out%normal
      out%w = part*out%w
   end subroutine fall

   !> What takes off lower than it landed, in a hollow of the relief, has that much to climb to the mean ground. What is
   !> too slow for it lands in its hollow again.
   pure subroutine climb(out, lift, gravity)
      type(outcome_t), intent(inout) :: out
      real(wp), intent(inout) :: lift   !! over R_b [-]
      real(wp), intent(in) :: gravity   !! along the normal, over g [-]
      real(wp) :: square

      square = out%normal**2 + 2*gravity*lift
      if (lift >= 0 .or. square <= 0) return
      out%normal = sqrt(square)
      lift = 0
   end subroutine climb

   !> Twice the kinetic energy, over m g R_b.
   pure real(wp) function energy_left(out, inertia)
      type(outcome_t), intent(in) :: out
      real(wp), intent(in) :: inertia  !! I/(m R_b**2) [-]

      energy_left = out%along**2 + out%across**2 + out%normal**2 + inertia*out%w**2
   end function energy_left

   !> The velocity at the end of the contact. What flies takes its velocity along to the ground there; what rolls on
   !> stays on it, and runs against it where it is steeper.
   pure subroutine leave(dem, g, steepness, heading, along, side, unit, out, touch, roll)
      type(terrain_t), intent(in) :: dem
      real(wp), intent(in) :: g(2), steepness, heading(2), along  !! where the contact began [-]
      real(wp), intent(in) :: side  !! of the descent: 1 left, -1 right [-]
      real(wp), intent(in) :: unit  !! [m/s]
      type(outcome_t), intent(in) :: out
      type(touch_t), intent(inout) :: touch
      type(roll_t), intent(inout) :: roll
      real(wp) :: across(2), plan(2), after(2), there, level, speed, v(3), v_end(3), onward(2)

      ! the tangent over the heading, and normal x tangent, in plan
      level = sqrt(1 + along*along)
      across = [-(heading(2) + g(2)*along), heading(1) + g(1)*along]/steepness
      plan = (out%along*heading + side*out%across*across)/level
      after = unit_vector(plan)
      if (all(after == 0)) after = heading
      speed = unit*sqrt(out%along**2 + out%across**2)
      roll%w = unit*out%w
      roll%heading = after
      v_end(1:2) = g  ! where the known terrain ends, the ground goes on as it was
      associate (end => roll%landing)
         if (end%contact) v_end(1:2) = gradient(dem, end%patch, end%u, end%w)
      end associate
      there = sqrt(1 + v_end(1)**2 + v_end(2)**2)
      if (.not. touch%rolling) then
         call launch_velocity(speed, unit*max(0.0_wp, out%normal), after(1), after(2), v_end(1), v_end(2), there, &
                              roll%v(1), roll%v(2), roll%v(3))
         return
      end if
      call launch_velocity(speed, 0.0_wp, after(1), after(2), g(1), g(2), steepness, v(1), v(2), v(3))
      call decompose(v, v_end(1:2), there, after, 0.0_wp, roll%v, onward)
      if (any(onward /= 0)) roll%heading = onward
      touch%normal = unit*out%normal + roll%v(2)
      if (roll%v(2) >= 0) roll%v(1) = speed  ! falling ground turns it
      touch%rolling = touch%normal > -meets*roll%v(1) .or. roll%v(2) >= 0
      if (.not. touch%rolling) touch%next = 0
      speed = roll%v(1)
      call launch_velocity(speed, merge(0.0_wp, touch%normal, touch%rolling), roll%heading(1), roll%heading(2), &
                           v_end(1), v_end(2), there, roll%v(1), roll%v(2), roll%v(3))
   end subroutine leave
end module rockfall_table_contact
