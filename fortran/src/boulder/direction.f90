! SPDX-License-Identifier: BSD-3-Clause
!> Heading of a boulder after a rebound (Bourrier et al. 2009, section 3.3): it turns by a random angle towards the
!> steepest descent of the raster cell, or to either side by angles measured in the laboratory. Headings are unit
!> vectors in plan.
module rockfall_direction
   use rockfall_kinds, only: wp
   use rockfall_dimensions, only: n_lateral_classes, n_lateral_quantiles
   use rockfall_math, only: pi, degree, sine_cosine, squared_sine
   use rockfall_terrain, only: steepness_of
   implicit none
   private
   public :: turning_t, lateral_t, lateral, lateral_classes, lateral_quantiles
   public :: past_aspect, to_aspect, by_lab, rebound_turn_angle, lateral_angle, new_heading, unit_vector, &
             random_heading, rotated
   public :: turn_by_class, divide_by_length, shortest, along_aspect

   !> Turning rules: by the classes printed in the paper, where a turn larger than the angle to the
   !> aspect goes past the aspect (as written in the paper) or ends at it; or by deviations measured
   !> in the laboratory.
   integer, parameter :: past_aspect = 1, to_aspect = 2, by_lab = 3

   !> Length below which a vector is rescaled before it is normalised [-]: far above 1.5e-154, the root of the smallest
   !> normal number.
   real(wp), parameter :: shortest = 1.0e-150_wp

   !> Headings within this angle of the aspect [rad] are treated as along it: on a plane the difference is only
   !> rounding, and its sign must not turn all boulders to the same side. Double-precision elevations cause about 1e-12.
   real(wp), parameter :: along_aspect = 1.0e-9_wp

   !> Classes of the turn in the paper: thresholds in (0, 1) of the second and third class; widths of the first two and
   !> of the third class [degree].
   real(wp), parameter :: second_class = 0.72_wp, third_class = 0.96_wp
   real(wp), parameter :: sector = 22.5_wp, last_sector = 5.0_wp
   !> Slope of the quantile function of the turn within each class [rad].
   real(wp), parameter :: in_first = sector*degree/second_class, &
                          in_second = sector*degree/(third_class - second_class), &
                          in_third = last_sector*degree/(1 - third_class)

   integer, parameter :: lateral_classes = n_lateral_classes  !! maximum number of incidence classes
   !> Probabilities of the quantiles of a class: steps of a tenth, then the tail.
   real(wp), parameter :: probability(n_lateral_quantiles) = &
      [0.0_wp, 0.1_wp, 0.2_wp, 0.3_wp, 0.4_wp, 0.5_wp, 0.6_wp, 0.7_wp, 0.8_wp, 0.9_wp, 0.95_wp, 0.99_wp, 1.0_wp]
   integer, parameter :: lateral_quantiles = n_lateral_quantiles
   real(wp), parameter :: per_probability(*) = 1/(probability(2:) - probability(:lateral_quantiles - 1))

   !> Lateral deviations measured in the laboratory, by classes of the incidence angle.
   type :: lateral_t
      real(wp) :: sine2(lateral_classes - 1) = 1.0_wp  !! squared sines of the class limits [-]
      real(wp) :: angle(lateral_quantiles, lateral_classes) = 0.0_wp  !! quantiles of the absolute deviation [rad]
   end type lateral_t

   !> Rule and random numbers of a turn.
   type :: turning_t
      integer :: rule = past_aspect
      real(wp) :: u = 0.0_wp        !! quantile of the turn, uniform in (0, 1) [-]
      real(wp) :: side = 1.0_wp     !! side of the turn if the ground does not determine it, 1 or -1 [-]
      real(wp) :: lateral = 0.0_wp  !! by_lab: angle of the turn [rad]
   end type turning_t

contains

   !> Build lateral deviations from angles in degrees, the unit of set files.
   pure type(lateral_t) function lateral(incidence, angle) result(this)
      real(wp), intent(in) :: incidence(lateral_classes - 1)             !! class limits, 0 to 90 [degree]
      real(wp), intent(in) :: angle(lateral_quantiles, lateral_classes)  !! quantiles of each class [degree]

      this%sine2 = squared_sine(incidence)
      this%angle = angle*degree
   end function lateral

   !> Lateral deviation [rad] by inversion of its distribution; linear between quantiles.
   pure real(wp) function lateral_angle(this, v_in, u)
      type(lateral_t), intent(in) :: this
      real(wp), intent(in) :: v_in(2)  !! V_t, V_n [m/s]
      real(wp), intent(in) :: u        !! uniform in (0, 1) [-]
      integer :: class, k

      do class = 1, lateral_classes - 1  ! sin**2 of the incidence angle = V_n**2/(V_t**2 + V_n**2)
         if (v_in(2)**2 < this%sine2(class)*(v_in(1)**2 + v_in(2)**2)) exit
      end do
      k = min(10, 1 + int(10*u))  ! steps of a tenth, then the tail
      if (u >= probability(11)) k = 11
      if (u >= probability(12)) k = 12
      associate (q => this%angle(k:k + 1, class))
         lateral_angle = q(1) + (q(2) - q(1))*((u - probability(k))*per_probability(k))
      end associate
   end function lateral_angle

   !> Angle of a turn [rad] (section 3.3) by inversion of its distribution: 0-22.5 degrees with probability 0.72,
   !> 22.5-45 with 0.24, 45-50 with 0.04; uniform within a class, which is our assumption (theory, chapter 6).
   elemental real(wp) function rebound_turn_angle(u)
      real(wp), intent(in) :: u  !! uniform in (0, 1) [-]

      rebound_turn_angle = in_first*u
      if (u >= second_class) rebound_turn_angle = sector*degree + in_second*(u - second_class)
      if (u >= third_class) rebound_turn_angle = 2*sector*degree + in_third*(u - third_class)
   end function rebound_turn_angle

   !> Heading after a rebound (section 3.3; theory, chapter 6): unchanged in a pit; upslope, uniform within 22.5 degrees
   !> of the heading before; otherwise by the turning rule. The printed classes apply only if the cell has a descent.
   pure function new_heading(turning, heading, g, descent, pit) result(after)
      type(turning_t), intent(in) :: turning
      real(wp), intent(in) :: heading(2)     !! heading before the rebound, unit [-]
      real(wp), intent(in) :: g(2)           !! gradient of the patch [-]
      real(wp), intent(in) :: descent(2)     !! descent of the cell, any length [-]
      logical, intent(in) :: pit
      real(wp) :: after(2)
      real(wp) :: across, side, aspect(2)

      aspect = unit_vector(descent)
      if (pit .or. turning%rule /= by_lab .or. dot_product(g, heading) > 0) then  ! all rules agree in a pit and upslope
         call turn_by_class(turning%u, turning%side, merge(1.0_wp, 0.0_wp, pit), &
                            merge(1.0_wp, 0.0_wp, turning%rule == to_aspect), heading(1), heading(2), g(1), g(2), &
                            aspect(1), aspect(2), after(1), after(2))
         return
      end if
      across = heading(1)*aspect(2) - heading(2)*aspect(1)
      ! Angles are positive towards the descent, so that a mirrored scene gives mirrored trajectories.
      side = turning%side*merge(1.0_wp, sign(1.0_wp, across), abs(across) <= along_aspect)
      after = rotated_on_patch(heading, g, side*turning%lateral)
   end function new_heading

   !> Heading after a rebound by the printed classes. All cases are expressed by one angle and one turn, so that the
   !> loop over boulders vectorises.
   elemental subroutine turn_by_class(u, free_side, pit, ends_there, east, north, g_east, g_north, aspect_east, &
                                      aspect_north, after_east, after_north)
      real(wp), intent(in) :: u, free_side               !! as in turning_t [-]
      real(wp), intent(in) :: pit                        !! as returned by is_pit
      real(wp), intent(in) :: ends_there                 !! 1 for the rule to_aspect, else 0
      real(wp), intent(in) :: east, north                !! heading before the rebound, unit [-]
      real(wp), intent(in) :: g_east, g_north            !! gradient of the patch [-]
      real(wp), intent(in) :: aspect_east, aspect_north  !! aspect of the cell, unit or zero [-]
      real(wp), intent(out) :: after_east, after_north   !! heading after the rebound [-]
      real(wp) :: across, up, side, angle, s, c, reached

      across = east*aspect_north - north*aspect_east
      up = g_east*east + g_north*north
      side = merge(free_side, sign(1.0_wp, across), abs(across) <= along_aspect)
      side = merge(sign(1.0_wp, across), side, max(up, ends_there) > 0)
      angle = merge(rebound_turn_angle(u), 0.0_wp, abs(aspect_east) + abs(aspect_north) > 0)
      angle = merge((2*u - 1)*sector*degree, angle, up > 0)
      call sine_cosine(angle, s, c)
      reached = merge(ends_there, 0.0_wp, east*aspect_east + north*aspect_north >= c)
      reached = merge(0.0_wp, reached, up > 0)
      s = side*s
      after_east = merge(aspect_east, c*east - s*north, reached > 0)
      after_north = merge(aspect_north, s*east + c*north, reached > 0)
      after_east = merge(east, after_east, pit > 0)
      after_north = merge(north, after_north, pit > 0)
   end subroutine turn_by_class

   !> Heading in plan after rotating the tangent above a heading in the plane of the patch, as in the laboratory.
   pure function rotated_on_patch(heading, g, angle) result(after)
      real(wp), intent(in) :: heading(2)  !! unit [-]
      real(wp), intent(in) :: g(2)        !! gradient of the patch [-]
      real(wp), intent(in) :: angle       !! -pi/2 to pi/2, anticlockwise [rad]
      real(wp) :: after(2)
      real(wp) :: s, c, along

      call sine_cosine(angle/2, s, c)
      along = dot_product(g, heading)
      ! cos times the tangent (heading, along) plus sin times normal x tangent, in plan, up to a common factor
      after = unit_vector((1 - 2*s*s)*heading + (2*s*c/steepness_of(g(1), g(2))) &
                          *[-(heading(2) + g(2)*along), heading(1) + g(1)*along])
   end function rotated_on_patch

   !> Rotate v anticlockwise.
   pure function rotated(v, s, c)
      real(wp), intent(in) :: v(2)  !! any unit
      real(wp), intent(in) :: s, c  !! sine and cosine of the angle [-]
      real(wp) :: rotated(2)

      rotated = [c*v(1) - s*v(2), s*v(1) + c*v(2)]
   end function rotated

   !> Normalise v; zero stays zero.
   pure function unit_vector(v) result(unit)
      real(wp), intent(in) :: v(2)  !! any unit
      real(wp) :: unit(2)
      real(wp) :: length

      call divide_by_length(v(1), v(2), unit(1), unit(2), length)
      if (.not. length > shortest) then  ! squares of components this small underflow: rescale first
         unit = 0
         if (any(abs(v) > 0)) unit = v/maxval(abs(v))
         if (any(abs(v) > 0)) unit = unit/sqrt(unit(1)**2 + unit(2)**2)
      end if
   end function unit_vector

   !> Normalise v if it is longer than `shortest`.
   elemental subroutine divide_by_length(x, y, unit_x, unit_y, length)
      real(wp), intent(in) :: x, y             !! any unit
      real(wp), intent(out) :: unit_x, unit_y  !! [-]
      real(wp), intent(out) :: length          !! as x, y
      real(wp) :: inverse

      length = sqrt(x*x + y*y)
      inverse = 1/max(length, shortest)
      unit_x = x*inverse
      unit_y = y*inverse
   end subroutine divide_by_length

   !> Heading uniform on the circle, for a vertical impact on ground without descent: an angle within 45 degrees of
   !> east, where the series of sine and cosine are valid, then quarter turns.
   pure function random_heading(u) result(heading)
      real(wp), intent(in) :: u  !! uniform in (0, 1) [-]
      real(wp) :: heading(2)
      real(wp) :: s, c
      integer :: quarter

      quarter = int(4*u)
      call sine_cosine((4*u - quarter - 0.5_wp)*pi/2, s, c)
      heading = [c, s]
      do quarter = quarter, 1, -1
         heading = [-heading(2), heading(1)]
      end do
   end function random_heading
end module rockfall_direction
