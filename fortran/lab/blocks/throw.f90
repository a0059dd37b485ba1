! SPDX-License-Identifier: BSD-3-Clause
!> A block thrown at a tilted ground, and the records of its first contacts.
!>
!> A contact begins when the block touches the ground, and ends when it leaves it for a flight: upwards from
!> the mean surface and past the top of its path, longer and higher than the limits below. Smaller hops, and
!> hollows that it flies over while it falls, belong to the contact. One that lasts too long is cut into
!> records.
module lab_throw
   use rockfall_kinds, only: wp
   use rockfall_math, only: degree, sine_cosine
   use lab_block, only: block_t
   use lab_rotation, only: rotation_matrix
   use lab_yielding_ground, only: relief_t
   use lab_pressure, only: law_t
   use lab_block_motion, only: motion_t, start_motion, advance, feel_ground, free_step, contact_step, spin_of, &
      kinetic_energy
   implicit none
   private
   public :: throw_t, contact_t, follow_throw, cut_time_of
   public :: from_flight, from_rolling, flies, rolls_on, stops

   !> How a contact begins and ends.
   integer, parameter :: from_flight = 0, from_rolling = 1
   integer, parameter :: flies = 0, rolls_on = 1, stops = 2

   !> What is thrown, and how.
   type :: throw_t
      real(wp) :: place(2) = 0                     !! in plan, on the patch [m]
      real(wp) :: downhill(2) = [1.0_wp, 0.0_wp]   !! direction in which the plane falls, unit [-]
      real(wp) :: slope = 0                        !! of the mean surface [degrees]
      real(wp) :: speed = 10                       !! [m/s]
      real(wp) :: angle = 30                       !! of the path from the mean surface, 90 = at right angles [degrees]
      real(wp) :: spin = 0                         !! W/V [-]
      real(wp) :: orientation(4) = [1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp]  !! unit quaternion [-]
      real(wp) :: gravity = 9.81_wp                !! [m/s2]
   end type throw_t

   !> A contact. Directions are those of the mean surface: along the heading before it, and normal to it.
   type :: contact_t
      integer :: entry = from_flight
      integer :: exit = flies
      real(wp) :: downhill = 0      !! from the place of the throw to its beginning, along the fall line [m]
      real(wp) :: heading(2) = 0    !! before it: components downhill and to the left of that, unit [-]
      real(wp) :: incoming(3) = 0   !! (V_t, V_n, W) [m/s]
      real(wp) :: outgoing(3) = 0   !! (V_t, V_n, W), gravity's work along the slope taken out [m/s]
      real(wp) :: lateral = 0       !! sine of the angle of V_t from the heading before, left > 0 [-]
      real(wp) :: duration = 0      !! [s]
      real(wp) :: advance = 0       !! along the heading before [m]
      real(wp) :: rise = 0          !! of the centre [m]
      real(wp) :: height = 0        !! of the centre above the mean surface at the beginning [m]
      real(wp) :: energy = 0        !! kinetic, after / before [-]
   end type contact_t

   !> A motion at the beginning or the end of a contact.
   type :: instant_t
      real(wp) :: time = 0, x(3) = 0, v(3) = 0, spin(3) = 0, energy = 0
   end type instant_t

   ! in units of sqrt(R_b/g), R_b and g R_b
   real(wp), parameter :: cut = 1.5_wp             !! a contact that lasts longer is cut: 0.3 s for R_b = 0.4 m
   real(wp), parameter :: hop_time = 0.1_wp        !! a flight lasts longer
   real(wp), parameter :: hop_height = 0.02_wp     !! and is higher
   real(wp), parameter :: rest_energy = 0.005_wp   !! of a kilogram of a block at rest
   real(wp), parameter :: max_time = 500           !! of a throw

contains

   !> Time after which a contact is cut [s].
   pure real(wp) function cut_time_of(radius, gravity)
      real(wp), intent(in) :: radius, gravity  !! [m], [m/s2]

      cut_time_of = cut*sqrt(radius/gravity)
   end function cut_time_of

   !> The first contacts of a throw, as many as fit; `complete` is false where the time ran out before.
   pure subroutine follow_throw(block, law, relief, throw, step, contacts, n, complete)
      type(block_t), intent(in) :: block
      type(law_t), intent(in) :: law
      type(relief_t), intent(in) :: relief
      type(throw_t), intent(in) :: throw
      real(wp), intent(in) :: step                  !! time step over the usual one [-]
      type(contact_t), intent(out) :: contacts(:)
      integer, intent(out) :: n                     !! contacts
      logical, intent(out) :: complete
      type(motion_t) :: m
      type(instant_t) :: first, last                !! of this contact, as yet
      real(wp) :: gravity(3), time, unit, dt, least, slow_since
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
         least = step*contact_step(block, law, m)
         dt = least
         if (.not. m%wet) dt = free_step(block, relief, gravity, least, m)
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
            contacts(n) = record(block, throw, entry, merge(stops, rolls_on, rests), first, last)
            if (rests) return
            entry = from_rolling
            first = last
         else if (in_contact) then
            high = high .or. m%clear > hop_height*block%radius
            if (.not. (high .and. last%v(3) > 0 .and. m%v(3) <= 0 .and. time - last%time > hop_time*unit)) cycle
            n = n + 1
            contacts(n) = record(block, throw, entry, flies, first, last)
            in_contact = .false.
            entry = from_flight
         end if
         if (time > max_time*unit) exit
      end do
      complete = n == size(contacts)
   end subroutine follow_throw

   !> Gravity on the tilted plane, and the block just above the ground at its place.
   pure subroutine set_out(block, law, relief, throw, gravity, m)
      type(block_t), intent(in) :: block
      type(law_t), intent(in) :: law
      type(relief_t), intent(in) :: relief
      type(throw_t), intent(in) :: throw
      real(wp), intent(out) :: gravity(3)  !! [m/s2]
      type(motion_t), intent(out) :: m
      real(wp), parameter :: gap = 1.0e-6_wp  !! left above the ground / R_b
      real(wp) :: s, c, v(3), spin(3)

      call sine_cosine(throw%slope*degree, s, c)
      gravity = throw%gravity*[s*throw%downhill(1), s*throw%downhill(2), -c]
      call sine_and_cosine(throw%angle, s, c)
      v = throw%speed*[c*throw%downhill(1), c*throw%downhill(2), -s]
      spin = throw%speed*throw%spin/block%radius*[-throw%downhill(2), throw%downhill(1), 0.0_wp]
      call start_motion(block, law, [throw%place, 0.0_wp], v, throw%orientation, spin, m)
      call feel_ground(block, law, relief, 0.0_wp, m)  ! for its depth there
      call start_motion(block, law, [throw%place, gap*block%radius - m%clear], v, throw%orientation, spin, m)
      call feel_ground(block, law, relief, 0.0_wp, m)
   end subroutine set_out

   !> Of an angle of 0 to 90 degrees.
   pure subroutine sine_and_cosine(angle, s, c)
      real(wp), intent(in) :: angle  !! [degrees]
      real(wp), intent(out) :: s, c  !! [-]

      if (angle <= 45) then
         call sine_cosine(angle*degree, s, c)
      else
         call sine_cosine((90 - angle)*degree, c, s)
      end if
   end subroutine sine_and_cosine

   pure type(instant_t) function instant_of(block, m, time) result(now)
      type(block_t), intent(in) :: block
      type(motion_t), intent(in) :: m
      real(wp), intent(in) :: time  !! [s]

      now = instant_t(time, m%x, m%v, spin_of(block, m), kinetic_energy(block, m))
   end function instant_of

   !> A contact from its beginning to its end.
   pure type(contact_t) function record(block, throw, entry, exit, first, last) result(c)
      type(block_t), intent(in) :: block
      type(throw_t), intent(in) :: throw
      integer, intent(in) :: entry, exit
      type(instant_t), intent(in) :: first, last
      real(wp) :: heading(2), v(2), speed, sine, cosine

      c%entry = entry
      c%exit = exit
      c%duration = last%time - first%time
      c%downhill = dot_product(first%x(:2) - throw%place, throw%downhill)
      c%height = first%x(3)
      c%rise = last%x(3) - first%x(3)
      c%energy = last%energy/max(first%energy, tiny(1.0_wp))
      speed = sqrt(sum(first%v(:2)**2))
      heading = throw%downhill
      if (speed > 0) heading = first%v(:2)/speed
      c%heading = [dot_product(heading, throw%downhill), &
                   heading(2)*throw%downhill(1) - heading(1)*throw%downhill(2)]
      c%advance = dot_product(last%x(:2) - first%x(:2), heading)
      c%incoming = [speed, first%v(3), rolling(first, heading)]
      call sine_cosine(throw%slope*degree, sine, cosine)
      v = last%v(:2) - throw%gravity*sine*c%duration*throw%downhill
      call split(v, heading, c)
      c%outgoing(3) = rolling(last, unit_vector(last%v(:2), heading))

   contains

      !> V_t is below zero where the block was thrown back; the frame of its heading stays.
      pure subroutine split(v, heading, c)
         real(wp), intent(in) :: v(2), heading(2)
         type(contact_t), intent(inout) :: c
         real(wp) :: along, across, size_v

         along = dot_product(v, heading)
         across = v(2)*heading(1) - v(1)*heading(2)
         size_v = sqrt(sum(v**2))
         c%outgoing(1:2) = [sign(size_v, along), last%v(3)]
         if (size_v > 0) c%lateral = sign(1.0_wp, along)*across/size_v
      end subroutine split

      pure function unit_vector(v, otherwise) result(t)
         real(wp), intent(in) :: v(2), otherwise(2)
         real(wp) :: t(2)

         t = otherwise
         if (any(v /= 0)) t = v/sqrt(sum(v**2))
      end function unit_vector

      !> W = R_b omega about the axis in the surface across a direction: > 0 forward.
      pure real(wp) function rolling(now, t)
         type(instant_t), intent(in) :: now
         real(wp), intent(in) :: t(2)

         rolling = block%radius*(now%spin(2)*t(1) - now%spin(1)*t(2))
      end function rolling
   end function record
end module lab_throw
