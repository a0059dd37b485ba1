! SPDX-License-Identifier: BSD-3-Clause
!> Names and order of the numbers in the Python interface.
module lab_tables
   use rockfall_kinds, only: wp
   use rockfall_math, only: arcsine, degree
   use lab_contact, only: material_t
   use lab_packing, only: packing_t, layer_t
   use lab_impact, only: shot_t, outcome_t
   use lab_ensemble, only: range_t
   use lab_contact_record, only: thrown_t
   use lab_throw_range, only: throw_range_t
   use lab_rock_throw, only: boulder_t
   implicit none
   private
   public :: material_of, packing_of, shot_of, range_of, outcome_row, outcome_count_row, layer_row
   public :: material_row, packing_row, shot_row, range_row
   public :: boulder_of, boulder_row, boulder_keys
   public :: throw_range_of, throw_range_row, contact_row, contact_count_row, throw_keys, contact_fields, contact_counts
   public :: material_keys, packing_keys, shot_keys, range_keys, outcome_fields, outcome_counts, &
      layer_fields

   integer, parameter :: long = 16
   character(len=long), parameter :: material_keys(6) = [character(len=long) :: &
      "young", "poisson", "friction", "damping", "rolling", "boulder_rolling"]
   character(len=long), parameter :: packing_keys(12) = [character(len=long) :: &
      "mean_radius", "ratio", "grading", "by_mass", "width", "depth", "density", "friction", &
      "gravity", "rigid_base", "base_speed", "clumps"]
   character(len=long), parameter :: shot_keys(16) = [character(len=long) :: &
      "radius", "density", "speed", "angle", "spin", "aim_x", "aim_y", "heading_x", "heading_y", &
      "gravity", "patience", "spent", "past", "wait", "step_factor", "retries"]
   character(len=long), parameter :: range_keys(9) = [character(len=long) :: &
      "speed_min", "speed_median", "speed_max", "angle_min", "angle_median", "angle_max", &
      "spin_min", "spin_median", "spin_max"]
   character(len=long), parameter :: outcome_fields(26) = [character(len=long) :: &
      "speed", "angle", "spin", "aim_x", "aim_y", "heading_x", "heading_y", "vt_in", "vn_in", "w_in", &
      "vt_peak", "vn_peak", "w_peak", "lateral_peak", "vt_loss", "vn_loss", "w_loss", "lateral_loss", &
      "vt_clear", "vn_clear", "w_clear", "lateral_clear", "duration", "travel", "depth", "overlap"]
   character(len=long), parameter :: outcome_counts(4) = [character(len=long) :: &
      "status", "trouble", "halvings", "steps"]
   character(len=long), parameter :: layer_fields(6) = [character(len=long) :: &
      "surface", "top", "solid", "floor_share", "width", "steps"]
   character(len=long), parameter :: throw_keys(12) = [character(len=long) :: &
      "slope_min", "slope_max", "speed_min", "speed_median", "speed_max", "angle_min", "angle_median", "angle_max", &
      "spin_min", "spin_median", "spin_max", "gravity"]
   character(len=long), parameter :: boulder_keys(7) = [character(len=long) :: &
      "radius", "density", "relief", "step_factor", "retries", "shape", "adaptive"]  ! shape: an index in `shape_names`
   character(len=long), parameter :: contact_fields(16) = [character(len=long) :: &
      "slope", "downhill", "heading", "speed", "incidence", "spin", "s", "vt_out", "vn_out", "w_out", "lateral", &
      "duration", "advance", "rise", "height", "energy_out"]
   character(len=long), parameter :: contact_counts(3) = [character(len=long) :: &
      "block", "entry", "exit"]

contains

   pure type(material_t) function material_of(v)
      real(wp), intent(in) :: v(size(material_keys))  !! values in the [units] of material_t

      material_of = material_t(young=v(1), poisson=v(2), friction=v(3), damping=v(4), rolling=v(5), &
                               boulder_rolling=v(6))
   end function material_of

   pure function material_row(m) result(row)
      type(material_t), intent(in) :: m
      real(wp) :: row(size(material_keys))

      row = [m%young, m%poisson, m%friction, m%damping, m%rolling, m%boulder_rolling]
   end function material_row

   pure type(packing_t) function packing_of(v)
      real(wp), intent(in) :: v(size(packing_keys))  !! values in the [units] of packing_t

      packing_of = packing_t(mean_radius=v(1), ratio=v(2), grading=v(3), by_mass=is_true(v(4)), &
                             width=v(5), depth=v(6), density=v(7), friction=v(8), gravity=v(9), &
                             rigid_base=is_true(v(10)), base_speed=v(11), clumps=is_true(v(12)))
   end function packing_of

   pure function packing_row(p) result(row)
      type(packing_t), intent(in) :: p
      real(wp) :: row(size(packing_keys))

      row = [p%mean_radius, p%ratio, p%grading, one_if(p%by_mass), p%width, p%depth, p%density, &
             p%friction, p%gravity, one_if(p%rigid_base), p%base_speed, one_if(p%clumps)]
   end function packing_row

   pure type(shot_t) function shot_of(v)
      real(wp), intent(in) :: v(size(shot_keys))  !! values in the [units] of shot_t

      shot_of = shot_t(radius=v(1), density=v(2), speed=v(3), angle=v(4), spin=v(5), aim=v(6:7), &
                       heading=v(8:9), gravity=v(10), patience=v(11), spent=v(12), past=v(13), &
                       wait=v(14), step_factor=v(15), retries=nint(v(16)))
   end function shot_of

   pure function shot_row(s) result(row)
      type(shot_t), intent(in) :: s
      real(wp) :: row(size(shot_keys))

      row = [s%radius, s%density, s%speed, s%angle, s%spin, s%aim, s%heading, s%gravity, s%patience, &
             s%spent, s%past, s%wait, s%step_factor, real(s%retries, wp)]
   end function shot_row

   pure type(range_t) function range_of(v)
      real(wp), intent(in) :: v(size(range_keys))  !! values in the [units] of range_t

      range_of = range_t(speed=v(1:3), angle=v(4:6), spin=v(7:9))
   end function range_of

   pure function range_row(r) result(row)
      type(range_t), intent(in) :: r
      real(wp) :: row(size(range_keys))

      row = [r%speed, r%angle, r%spin]
   end function range_row

   pure logical function is_true(v)
      real(wp), intent(in) :: v  !! 0 or 1 [-]

      is_true = nint(v) /= 0
   end function is_true

   pure real(wp) function one_if(condition)
      logical, intent(in) :: condition

      one_if = merge(1.0_wp, 0.0_wp, condition)
   end function one_if

   pure function outcome_row(shot, outcome) result(row)
      type(shot_t), intent(in) :: shot
      type(outcome_t), intent(in) :: outcome
      real(wp) :: row(size(outcome_fields))

      associate (o => outcome)
         row = [shot%speed, shot%angle, shot%spin, shot%aim, shot%heading, o%incoming, &
                o%peak%v, o%peak%lateral, o%loss%v, o%loss%lateral, o%clear%v, o%clear%lateral, &
                o%duration, o%travel, o%depth, o%overlap]
      end associate
   end function outcome_row

   pure function outcome_count_row(outcome) result(row)
      type(outcome_t), intent(in) :: outcome
      integer :: row(size(outcome_counts))

      row = [outcome%status, outcome%trouble, outcome%halvings, outcome%steps]
   end function outcome_count_row

   pure function layer_row(layer) result(row)
      type(layer_t), intent(in) :: layer
      real(wp) :: row(size(layer_fields))

      row = [layer%surface, layer%top, layer%solid, layer%floor_share, layer%box%width, &
             real(layer%steps, wp)]
   end function layer_row

   pure type(throw_range_t) function throw_range_of(v)
      real(wp), intent(in) :: v(size(throw_keys))  !! values in the [units] of throw_range_t

      throw_range_of = throw_range_t(slope=v(1:2), speed=v(3:5), angle=v(6:8), spin=v(9:11), gravity=v(12))
   end function throw_range_of

   pure function throw_range_row(r) result(row)
      type(throw_range_t), intent(in) :: r
      real(wp) :: row(size(throw_keys))

      row = [r%slope, r%speed, r%angle, r%spin, r%gravity]
   end function throw_range_row

   pure type(boulder_t) function boulder_of(v)
      real(wp), intent(in) :: v(size(boulder_keys))  !! values in the [units] of boulder_t

      boulder_of = boulder_t(radius=v(1), density=v(2), relief=v(3), step_factor=v(4), retries=nint(v(5)))
      boulder_of%kind = nint(v(6))
      boulder_of%adaptive = is_true(v(7))
   end function boulder_of

   pure function boulder_row(b) result(row)
      type(boulder_t), intent(in) :: b
      real(wp) :: row(size(boulder_keys))

      row = [b%radius, b%density, b%relief, b%step_factor, real([b%retries, b%kind], wp), one_if(b%adaptive)]
   end function boulder_row

   !> Row of contact k of a throw. Velocities are divided by the speed before the contact, lengths by R_b.
   pure function contact_row(o, k, radius, strength) result(row)
      type(thrown_t), intent(in) :: o
      integer, intent(in) :: k
      real(wp), intent(in) :: radius    !! R_b [m]
      real(wp), intent(in) :: strength  !! 2 p_y/rho_b [m2/s2]
      real(wp) :: row(size(contact_fields)), speed, incidence, turn

      associate (c => o%contacts(k))
         speed = max(sqrt(c%incoming(1)**2 + c%incoming(2)**2), tiny(1.0_wp))
         incidence = arcsine(min(1.0_wp, abs(c%incoming(2))/speed))/degree
         turn = arcsine(min(1.0_wp, abs(c%heading(2))))/degree
         if (c%heading(1) < 0) turn = 180 - turn
         row = [o%throw%slope, c%downhill/radius, sign(turn, c%heading(2)), speed, sign(incidence, -c%incoming(2)), &
                c%incoming(3)/speed, c%incoming(2)**2/strength, &
                c%outgoing/speed, arcsine(min(1.0_wp, max(-1.0_wp, c%lateral)))/degree, c%duration, c%advance/radius, &
                c%rise/radius, c%height/radius, c%energy]
      end associate
   end function contact_row

   pure function contact_count_row(o, k) result(row)
      type(thrown_t), intent(in) :: o
      integer, intent(in) :: k
      integer :: row(size(contact_counts))

      row = [o%body, o%contacts(k)%entry, o%contacts(k)%exit]
   end function contact_count_row
end module lab_tables
