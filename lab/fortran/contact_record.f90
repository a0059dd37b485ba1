! SPDX-License-Identifier: BSD-3-Clause
!> Records of consecutive contacts of a block with yielding ground, or of a boulder with rocks. Both laboratories share
!> these definitions of throws, contacts, and recorded quantities.
!>
!> A contact begins when the body touches the ground, and ends when the body leaves for a flight: away from the mean
!> surface, over the top of its path, and for longer and higher than the limits below. Smaller hops, and hollows crossed
!> in the air while falling, belong to the contact. A contact that lasts too long is cut into several records.
module lab_contact_record
   use rockfall_kinds, only: wp
   use rockfall_math, only: degree, sine_cosine
   implicit none
   private
   public :: throw_t, contact_t, instant_t, thrown_t, record, fall_line_gravity, thrown_velocity, cut_time_of
   public :: from_flight, from_rolling, flies, rolls_on, stops
   public :: cut, hop_time, hop_height, rest_energy, max_time

   !> How a contact begins, and how it ends.
   integer, parameter :: from_flight = 0, from_rolling = 1
   integer, parameter :: flies = 0, rolls_on = 1, stops = 2

   !> Initial conditions of a throw.
   type :: throw_t
      real(wp) :: place(2) = 0                     !! position in plan, on the patch [m]
      real(wp) :: downhill(2) = [1.0_wp, 0.0_wp]   !! direction of the fall line, unit [-]
      real(wp) :: slope = 0                        !! slope of the mean surface [degrees]
      real(wp) :: speed = 10                       !! [m/s]
      real(wp) :: angle = 30                       !! angle of the path to the mean surface, 90 = normal to it [degrees]
      real(wp) :: spin = 0                         !! W/V [-]
      real(wp) :: orientation(4) = [1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp]  !! unit quaternion [-]
      real(wp) :: gravity = 9.81_wp                !! [m/s2]
   end type throw_t

   !> Contact. Directions refer to the mean surface: along the heading before the contact, and normal to it.
   type :: contact_t
      integer :: entry = from_flight
      integer :: exit = flies
      real(wp) :: downhill = 0      !! distance along the fall line to the start of the contact [m]
      real(wp) :: heading(2) = 0    !! heading before the contact: components downhill and to the left, unit [-]
      real(wp) :: incoming(3) = 0   !! (V_t, V_n, W) before the contact [m/s]
      real(wp) :: outgoing(3) = 0   !! (V_t, V_n, W) after the contact, without the impulse of gravity [m/s]
      real(wp) :: lateral = 0       !! sine of the turn of V_t, > 0 to the left [-]
      real(wp) :: duration = 0      !! duration of the contact [s]
      real(wp) :: advance = 0       !! distance during the contact, along the heading before it [m]
      real(wp) :: rise = 0          !! rise of the centre during the contact [m]
      real(wp) :: height = 0        !! height of the centre above the mean surface at the start of the contact [m]
      real(wp) :: energy = 0        !! kinetic energy after the contact over that before [-]
   end type contact_t

   !> State of motion at the beginning or the end of a contact [s], [m], [m/s], [rad/s], [J].
   type :: instant_t
      real(wp) :: time = 0, x(3) = 0, v(3) = 0, spin(3) = 0, energy = 0
   end type instant_t

   !> Throw: its body, initial conditions, and contacts.
   type :: thrown_t
      integer :: body = 0                          !! index of the block, or of the layer of rocks
      type(throw_t) :: throw
      integer :: n = 0                             !! number of contacts
      logical :: complete = .true.                 !! false: time limit reached, or motion not computable
      type(contact_t), allocatable :: contacts(:)  !! only the first n are valid
   end type thrown_t

   ! Limits in units of sqrt(R_b/g), R_b and g R_b:
   real(wp), parameter :: cut = 1.5_wp             !! longer contacts are cut: 0.3 s for R_b = 0.4 m
   real(wp), parameter :: hop_time = 0.1_wp        !! minimum duration of a flight
   real(wp), parameter :: hop_height = 0.02_wp     !! minimum height of a flight
   real(wp), parameter :: rest_energy = 0.005_wp   !! energy per mass below which a block is at rest
   real(wp), parameter :: max_time = 500           !! time limit of a throw

contains

   !> Time after which a contact is cut [s].
   pure real(wp) function cut_time_of(radius, gravity)
      real(wp), intent(in) :: radius, gravity  !! [m], [m/s2]

      cut_time_of = cut*sqrt(radius/gravity)
   end function cut_time_of

   !> Gravity on the plane of a throw, in its frame: along the fall line, and away from the plane [m/s2].
   pure function fall_line_gravity(throw) result(gravity)
      type(throw_t), intent(in) :: throw
      real(wp) :: gravity(3), s, c

      call sine_cosine(throw%slope*degree, s, c)
      gravity = throw%gravity*[s*throw%downhill(1), s*throw%downhill(2), -c]
   end function fall_line_gravity

   !> Initial velocity [m/s] and spin [rad/s] of a throw, down the fall line.
   pure function thrown_velocity(throw, radius) result(v)
      type(throw_t), intent(in) :: throw
      real(wp), intent(in) :: radius  !! R_b [m]
      real(wp) :: v(6), s, c

      call sine_and_cosine(throw%angle, s, c)
      v(1:3) = throw%speed*[c*throw%downhill(1), c*throw%downhill(2), -s]
      v(4:6) = throw%speed*throw%spin/radius*[-throw%downhill(2), throw%downhill(1), 0.0_wp]
   end function thrown_velocity

   !> Sine and cosine of an angle from 0 to 90 degrees.
   pure subroutine sine_and_cosine(angle, s, c)
      real(wp), intent(in) :: angle  !! [degrees]
      real(wp), intent(out) :: s, c  !! [-]

      if (angle <= 45) then
         call sine_cosine(angle*degree, s, c)
      else
         call sine_cosine((90 - angle)*degree, c, s)
      end if
   end subroutine sine_and_cosine

   !> Build the record of a contact from its beginning and end.
   pure type(contact_t) function record(radius, throw, entry, exit, first, last) result(c)
      real(wp), intent(in) :: radius  !! R_b [m]
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

      !> Split a velocity; V_t is negative if the block was thrown back: the frame of its heading is kept.
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

      !> W = R_b omega about the axis in the surface that is normal to a direction; > 0 for forward rolling.
      pure real(wp) function rolling(now, t)
         type(instant_t), intent(in) :: now
         real(wp), intent(in) :: t(2)

         rolling = radius*(now%spin(2)*t(1) - now%spin(1)*t(2))
      end function rolling
   end function record
end module lab_contact_record
