! SPDX-License-Identifier: BSD-3-Clause
!> Throw of a block at a tilted ground, and the records of its first contacts.
module lab_throw
   use rockfall_kinds, only: wp
   use lab_block, only: block_t
   use lab_yielding_ground, only: relief_t
   use lab_pressure, only: law_t
   use lab_block_motion, only: motion_t, start_motion, advance, feel_ground, free_step, contact_step, spin_of, &
      kinetic_energy
   use lab_contact_record, only: throw_t, contact_t, instant_t, record, fall_line_gravity, thrown_velocity, &
      from_flight, from_rolling, flies, rolls_on, stops, cut, hop_time, hop_height, rest_energy, max_time
   implicit none
   private
   public :: follow_throw

contains

   !> Compute the first contacts of a throw, up to the size of `contacts`. `complete` is false at the time limit.
   pure subroutine follow_throw(block, law, relief, throw, step, contacts, n, complete)
      type(block_t), intent(in) :: block
      type(law_t), intent(in) :: law
      type(relief_t), intent(in) :: relief
      type(throw_t), intent(in) :: throw
      real(wp), intent(in) :: step                  !! time step relative to the default [-]
      type(contact_t), intent(out) :: contacts(:)
      integer, intent(out) :: n                     !! number of contacts
      logical, intent(out) :: complete
      type(motion_t) :: m
      type(instant_t) :: first, last                !! first and last instant of the current contact so far
      real(wp) :: gravity(3), time, unit, dt, min_step, slow_since
      integer :: entry
      logical :: in_contact, high, cut_now, rests

      unit = sqrt(block%radius/throw%gravity)
      call set_out(block, law, relief, throw, gravity, m)
      time = 0
      slow_since = 0
      in_contact = .false.
      high = .false.
      entry = from_flight
      n = 0
      complete = .true.
      do while (n < size(contacts))
         min_step = step*contact_step(block, law, m)
         dt = min_step
         if (.not. m%wet) dt = free_step(block, relief, gravity, min_step, m)
         if (.not. in_contact) first = instant_of(block, m, time)
         call advance(block, law, relief, gravity, dt, m)
         time = time + dt
         if (m%wet) then
            if (.not. in_contact) slow_since = time
            in_contact = .true.
            high = .false.
            last = instant_of(block, m, time)
            if (last%energy > rest_energy*block%mass*throw%gravity*block%radius) slow_since = time
            rests = time - slow_since > cut*unit
            cut_now = time - first%time > cut*unit
            if (.not. (rests .or. cut_now)) cycle
            n = n + 1
            contacts(n) = record(block%radius, throw, entry, merge(stops, rolls_on, rests), first, last)
            if (rests) return
            entry = from_rolling
            first = last
         else if (in_contact) then
            high = high .or. m%clear > hop_height*block%radius
            if (.not. (high .and. last%v(3) > 0 .and. m%v(3) <= 0 .and. time - last%time > hop_time*unit)) cycle
            n = n + 1
            contacts(n) = record(block%radius, throw, entry, flies, first, last)
            in_contact = .false.
            entry = from_flight
         end if
         if (time > max_time*unit) exit
      end do
      complete = n == size(contacts)
   end subroutine follow_throw

   !> Set gravity on the tilted plane, and place the block just above the ground.
   pure subroutine set_out(block, law, relief, throw, gravity, m)
      type(block_t), intent(in) :: block
      type(law_t), intent(in) :: law
      type(relief_t), intent(in) :: relief
      type(throw_t), intent(in) :: throw
      real(wp), intent(out) :: gravity(3)  !! [m/s2]
      type(motion_t), intent(out) :: m
      real(wp), parameter :: gap = 1.0e-6_wp  !! initial gap above the ground, over R_b [-]
      real(wp) :: v(6)

      gravity = fall_line_gravity(throw)
      v = thrown_velocity(throw, block%radius)
      call start_motion(block, law, [throw%place, 0.0_wp], v(:3), throw%orientation, v(4:), m)
      call feel_ground(block, law, relief, 0.0_wp, m)  ! computes the height of the lowest vertex above the ground there
      call start_motion(block, law, [throw%place, gap*block%radius - m%clear], v(:3), throw%orientation, v(4:), m)
      call feel_ground(block, law, relief, 0.0_wp, m)
   end subroutine set_out

   pure type(instant_t) function instant_of(block, m, time) result(now)
      type(block_t), intent(in) :: block
      type(motion_t), intent(in) :: m
      real(wp), intent(in) :: time  !! [s]

      now = instant_t(time, m%x, m%v, spin_of(block, m), kinetic_energy(block, m))
   end function instant_of
end module lab_throw
