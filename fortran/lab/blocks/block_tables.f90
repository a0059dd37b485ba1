! SPDX-License-Identifier: BSD-3-Clause
!> Names and order of the numbers of the laboratory of blocks in the Python interface.
module lab_block_tables
   use rockfall_kinds, only: wp
   use rockfall_math, only: arcsine, degree
   use lab_yielding_ground, only: ground_t
   use lab_throw, only: contact_t
   use lab_throws, only: throw_range_t, thrown_t
   implicit none
   private
   public :: ground_of, ground_row, throw_range_of, throw_range_row, contact_row, contact_count_row
   public :: ground_keys, throw_keys, contact_fields, contact_counts

   integer, parameter :: long = 16
   character(len=long), parameter :: ground_keys(5) = [character(len=long) :: &
      "yield_pressure", "restitution", "friction", "soil_density", "plough"]
   character(len=long), parameter :: throw_keys(12) = [character(len=long) :: &
      "slope_min", "slope_max", "speed_min", "speed_median", "speed_max", "angle_min", "angle_median", "angle_max", &
      "spin_min", "spin_median", "spin_max", "gravity"]
   character(len=long), parameter :: contact_fields(14) = [character(len=long) :: &
      "slope", "speed", "incidence", "spin", "s", "vt_out", "vn_out", "w_out", "lateral", "duration", "advance", "rise", &
      "height", "energy_out"]
   character(len=long), parameter :: contact_counts(3) = [character(len=long) :: &
      "block", "entry", "exit"]

contains

   pure type(ground_t) function ground_of(v)
      real(wp), intent(in) :: v(size(ground_keys))  !! [units] of ground_t

      ground_of = ground_t(yield_pressure=v(1), restitution=v(2), friction=v(3), soil_density=v(4), &
                           plough=nint(v(5)) /= 0)
   end function ground_of

   pure function ground_row(g) result(row)
      type(ground_t), intent(in) :: g
      real(wp) :: row(size(ground_keys))

      row = [g%yield_pressure, g%restitution, g%friction, g%soil_density, merge(1.0_wp, 0.0_wp, g%plough)]
   end function ground_row

   pure type(throw_range_t) function throw_range_of(v)
      real(wp), intent(in) :: v(size(throw_keys))  !! [units] of throw_range_t

      throw_range_of = throw_range_t(slope=v(1:2), speed=v(3:5), angle=v(6:8), spin=v(9:11), gravity=v(12))
   end function throw_range_of

   pure function throw_range_row(r) result(row)
      type(throw_range_t), intent(in) :: r
      real(wp) :: row(size(throw_keys))

      row = [r%slope, r%speed, r%angle, r%spin, r%gravity]
   end function throw_range_row

   !> Contact k of a throw, velocities over the speed before it, lengths over R_b.
   pure function contact_row(o, k, radius, strength) result(row)
      type(thrown_t), intent(in) :: o
      integer, intent(in) :: k
      real(wp), intent(in) :: radius    !! R_b [m]
      real(wp), intent(in) :: strength  !! 2 p_y/rho_b [m2/s2]
      real(wp) :: row(size(contact_fields)), speed, incidence

      associate (c => o%contacts(k))
         speed = max(sqrt(c%incoming(1)**2 + c%incoming(2)**2), tiny(1.0_wp))
         incidence = arcsine(min(1.0_wp, abs(c%incoming(2))/speed))/degree
         row = [o%throw%slope, speed, sign(incidence, -c%incoming(2)), c%incoming(3)/speed, c%incoming(2)**2/strength, &
                c%outgoing/speed, arcsine(min(1.0_wp, max(-1.0_wp, c%lateral)))/degree, c%duration, c%advance/radius, &
                c%rise/radius, c%height/radius, c%energy]
      end associate
   end function contact_row

   pure function contact_count_row(o, k) result(row)
      type(thrown_t), intent(in) :: o
      integer, intent(in) :: k
      integer :: row(size(contact_counts))

      row = [o%block, o%contacts(k)%entry, o%contacts(k)%exit]
   end function contact_count_row
end module lab_block_tables
