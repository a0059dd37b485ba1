! SPDX-License-Identifier: BSD-3-Clause
!> Where a boulder heads after a rebound (Bourrier et al. 2009, section 3.3): it turns towards the
!> steepest descent of the raster cell by a random angle. Headings are unit vectors in plan.
module rockfall_direction
   use rockfall_kinds, only: wp
   use rockfall_math, only: pi, degree, sine_cosine
   implicit none
   private
   public :: turn_angle, new_heading, unit_vector, any_heading

contains

   !> The angle of a turn [rad]: 0-22.5 degrees with probability 0.72, 22.5-45 with 0.24, 45-50 with 0.04;
   !> uniform inside a class.
   pure real(wp) function turn_angle(class, within)
      real(wp), intent(in) :: class, within  !! uniform in (0, 1)

      if (class < 0.72_wp) then
         turn_angle = 22.5_wp*within
      else if (class < 0.96_wp) then
         turn_angle = 22.5_wp + 22.5_wp*within
      else
         turn_angle = 45.0_wp + 5.0_wp*within
      end if
      turn_angle = turn_angle*degree
   end function turn_angle

   !> The heading after a rebound.
   !> In a pit, or where the cell has no descent: unchanged. Upslope: uniform within 22.5 degrees of the
   !> heading before. Else: turned towards the descent of the cell, and not past it.
   pure function new_heading(heading, descent, pit, rising, class, within) result(after)
      real(wp), intent(in) :: heading(2)     !! before, unit
      real(wp), intent(in) :: descent(2)     !! of the cell, any length
      logical, intent(in) :: pit
      logical, intent(in) :: rising          !! the patch rises along the heading
      real(wp), intent(in) :: class, within  !! uniform in (0, 1)
      real(wp) :: after(2)
      real(wp) :: s, c, side, aspect(2)

      after = heading
      if (pit) return
      aspect = unit_vector(descent)
      ! Angles count towards the descent: then a mirrored scene has mirrored trajectories.
      side = sign(1.0_wp, heading(1)*aspect(2) - heading(2)*aspect(1))
      if (rising) then
         call sine_cosine((2*within - 1)*22.5_wp*degree, s, c)
         after = rotated(heading, side*s, c)
      else if (any(abs(aspect) > 0)) then
         call sine_cosine(turn_angle(class, within), s, c)
         if (dot_product(heading, aspect) >= c) then
            after = aspect
         else
            after = rotated(heading, side*s, c)
         end if
      end if
   end function new_heading

   pure function rotated(v, s, c)
      real(wp), intent(in) :: v(2), s, c  !! sine and cosine of the angle, anticlockwise
      real(wp) :: rotated(2)

      rotated = [c*v(1) - s*v(2), s*v(1) + c*v(2)]
   end function rotated

   !> v divided by its length; zero stays zero.
   pure function unit_vector(v) result(unit)
      real(wp), intent(in) :: v(2)
      real(wp) :: unit(2)
      real(wp) :: length

      length = sqrt(v(1)*v(1) + v(2)*v(2))
      if (length > 1.0e-150_wp) then
         unit = v*(1/length)
      else  ! the squares of such numbers are zero: first to order one
         unit = 0
         if (any(abs(v) > 0)) unit = v/maxval(abs(v))
         if (any(abs(v) > 0)) unit = unit/sqrt(unit(1)**2 + unit(2)**2)
      end if
   end function unit_vector

   !> A heading anywhere on the circle, for a vertical impact where nothing descends.
   pure function any_heading(u) result(heading)
      real(wp), intent(in) :: u  !! uniform in (0, 1)
      real(wp) :: heading(2)
      real(wp) :: s, c
      integer :: quarter

      quarter = int(4*u)
      call sine_cosine((4*u - quarter - 0.5_wp)*pi/2, s, c)
      heading = [c, s]
      do quarter = quarter, 1, -1
         heading = [-heading(2), heading(1)]
      end do
   end function any_heading
end module rockfall_direction
