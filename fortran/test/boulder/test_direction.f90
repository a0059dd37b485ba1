! SPDX-License-Identifier: BSD-3-Clause
!> Turn after a rebound: by the printed classes, past the descent or at most to it; by the laboratory; upslope; in pits.
program test_direction
   use rockfall_kinds, only: wp
   use rockfall_math, only: pi, degree
   use rockfall_direction, only: turning_t, past_aspect, to_aspect, by_lab, lateral_t, lateral, lateral_angle, &
                                rebound_turn_angle, &
      new_heading, unit_vector, random_heading
   use check_m, only: check, check_close, finish
   implicit none

   integer, parameter :: n = 1000000
   real(wp), parameter :: level(2) = 0.0_wp

   call random_init(.true., .false.)
   call test_classes()
   call test_downslope()
   call test_past()
   call test_either_side()
   call test_not_past()
   call test_lateral_angle()
   call test_by_lab()
   call test_upslope()
   call test_unchanged()
   call test_mirror()
   call test_unit_vector()
   call test_any_heading()
   call finish()

contains

   pure function at_angle(angle) result(v)
      real(wp), intent(in) :: angle  !! [rad]
      real(wp) :: v(2)

      v = [cos(angle), sin(angle)]
   end function at_angle

   !> Angle from a to b, anticlockwise, -pi to pi.
   pure real(wp) function angle_between(a, b)
      real(wp), intent(in) :: a(2), b(2)

      angle_between = atan2(a(1)*b(2) - a(2)*b(1), dot_product(a, b))
   end function angle_between

   !> Check that the fraction of hits in n draws is within 4 standard errors of its probability.
   subroutine check_share(name, hits, p)
      character(len=*), intent(in) :: name
      integer, intent(in) :: hits
      real(wp), intent(in) :: p

      call check(name, abs(hits - n*p) < 4*sqrt(n*p*(1 - p)))
   end subroutine check_share

   !> 72 % of turns are below 22.5 degrees, 24 % below 45, 4 % below 50; uniform within each class.
   subroutine test_classes()
      real(wp) :: u, turn
      integer :: k, hits(20)
      real(wp), parameter :: near = 1.0e-15_wp
      real(wp), parameter :: p(20) = [(0.72_wp/9, k=1, 9), (0.24_wp/9, k=1, 9), 0.04_wp/2, &
                                      0.04_wp/2]

      hits = 0
      do k = 1, n
         call random_number(u)
         turn = rebound_turn_angle(u)/(2.5_wp*degree)  ! 9, 9 and 2 bins of 2.5 degrees
         call check("no turn beyond 50 degrees", turn >= 0 .and. turn < 20)
         hits(1 + int(turn)) = hits(1 + int(turn)) + 1
      end do
      call check_share("72 % below 22.5 degrees", sum(hits(:9)), 0.72_wp)
      call check_share("24 % between 22.5 and 45", sum(hits(10:18)), 0.24_wp)
      call check_share("4 % between 45 and 50", sum(hits(19:)), 0.04_wp)
      do k = 1, 20
         call check_share("uniform inside the class", hits(k), p(k))
      end do
      call check_close("the start of the first class", rebound_turn_angle(0.0_wp), 0.0_wp, 0.0_wp)
      call check_close("its end", rebound_turn_angle(0.72_wp - near), 22.5_wp*degree, 2*near)
      call check_close("the start of the second", rebound_turn_angle(0.72_wp), 22.5_wp*degree, near)
      call check_close("its end", rebound_turn_angle(0.96_wp - near), 45*degree, 2*near)
      call check_close("the start of the third", rebound_turn_angle(0.96_wp), 45*degree, near)
      call check_close("its end", rebound_turn_angle(1.0_wp), 50*degree, 4*near)
   end subroutine test_classes

   !> Far from the descent, the heading turns towards it by the drawn angle, and stays a unit vector.
   subroutine test_downslope()
      real(wp) :: before(2), after(2), draw(3), apart, turned
      integer :: k

      do k = 1, 10000
         call random_number(draw)
         before = at_angle(2*pi*draw(1))
         apart = (50.01_wp + 129.98_wp*draw(2))*degree
         if (mod(k, 4) > 1) apart = -apart
         after = new_heading(turning_t(1 + mod(k, 2), draw(3)), before, &
                              level, &
                             0.37_wp*at_angle(2*pi*draw(1) + apart), .false.)
         turned = angle_between(before, after)
         call check("turned by the drawn angle, towards the descent", &
                    abs(turned - sign(rebound_turn_angle(draw(3)), apart)) < 1.0e-14_wp)
         call check("a unit vector", abs(sum(after**2) - 1) < 2.0e-15_wp)
      end do
   end subroutine test_downslope

   !> Near the descent, the heading also turns by the full angle to the side of the descent, whatever the random side,
   !> so that the printed classes occur.
   subroutine test_past()
      real(wp) :: before(2), after(2), draw(3), apart, turned
      integer :: k, beyond

      beyond = 0
      do k = 1, 10000
         call random_number(draw)
         before = at_angle(2*pi*draw(1))
         apart = (draw(2) - 0.5_wp)*100*degree
         after = new_heading(turning_t(past_aspect, draw(3), sign(1.0_wp, mod(k, 2) - 0.5_wp)), &
                             before, level, &
                             at_angle(2*pi*draw(1) + apart), .false.)
         turned = angle_between(before, after)
         call check("by the whole angle, to the side of the aspect", &
                    abs(turned - sign(rebound_turn_angle(draw(3)), apart)) < 1.0e-14_wp)
         if (abs(turned) > abs(apart)) beyond = beyond + 1
      end do
      call check("both past and short of it", beyond > 1000 .and. beyond < 9000)
   end subroutine test_past

   !> A heading along the descent, up to rounding, turns to the random side.
   subroutine test_either_side()
      real(wp) :: draw(3), after(2), apart
      integer :: k

      do k = 1, 1000
         call random_number(draw)
         apart = 1.0e-10_wp*sign(draw(2), mod(k, 4) - 1.5_wp)
         after = new_heading(turning_t(past_aspect, draw(3), sign(1.0_wp, mod(k, 2) - 0.5_wp)), &
                             at_angle(2*pi*draw(1)), level, at_angle(2*pi*draw(1) + apart), .false.)
         call check("to the side of chance", abs(angle_between(at_angle(2*pi*draw(1)), after) &
                                                 - sign(rebound_turn_angle(draw(3)), mod(k, 2) - 0.5_wp)) < 1.0e-14_wp)
      end do
   end subroutine test_either_side

   !> Incidence classes change at their bounds. Quantiles are at 0, 10, ..., 90, 95, 99, 100 % and linear in between.
   subroutine test_lateral_angle()
      real(wp), parameter :: bound(3) = [10.0_wp, 45.0_wp, 71.0_wp], p(13) = [0.0_wp, 0.1_wp, 0.2_wp, 0.3_wp, 0.4_wp, &
         0.5_wp, 0.6_wp, 0.7_wp, 0.8_wp, 0.9_wp, 0.95_wp, 0.99_wp, 1.0_wp]
      type(lateral_t) :: this
      real(wp) :: q(13, 9), v(2), u, expected
      integer :: class, k, j

      do k = 1, 9
         q(:, k) = min(k, 4)*[(0.1_wp*j**2, j=1, 13)]
      end do
      this = lateral([bound, (90.0_wp, k=1, 5)], q)
      do k = 1, 8999
         v = 7*[cos(0.01_wp*k*degree), -sin(0.01_wp*k*degree)]
         if (any(abs(bound - 0.01_wp*k) < 1.0e-6_wp)) cycle
         class = 1 + count(0.01_wp*k > bound)
         u = (k - 0.5_wp)/8999
         j = max(1, min(12, count(p <= u)))
         expected = q(j, class) + (q(j + 1, class) - q(j, class))*(u - p(j))/(p(j + 1) - p(j))
         call check_close("a lateral deviation", lateral_angle(this, v, u), expected*degree, 1.0e-13_wp)
      end do
      call check_close("a vertical impact", lateral_angle(this, [0.0_wp, -3.0_wp], 0.5_wp), q(6, 4)*degree, 1.0e-14_wp)
      call check_close("a grazing one", lateral_angle(this, [3.0_wp, 0.0_wp], 0.5_wp), q(6, 1)*degree, 1.0e-14_wp)
   end subroutine test_lateral_angle

   !> The tangent above the heading rotates in the plane of the patch by the angle, towards the descent or away from it;
   !> also if nothing descends.
   subroutine test_by_lab()
      real(wp) :: before(2), after(2), draw(5), g(2), t(3), u(3), normal(3), side
      integer :: k

      do k = 1, 10000
         call random_number(draw)
         g = 2*draw(1:2) - 1
         before = at_angle(2*pi*draw(3))
         if (dot_product(g, before) > 0) before = -before
         after = new_heading(turning_t(by_lab, draw(5), sign(1.0_wp, mod(k, 2) - 0.5_wp), pi/2*draw(4)), &
                             before, g, -g, .false.)
         t = [before, dot_product(g, before)]
         u = [after, dot_product(g, after)]
         call check("by the angle on the patch", &
                    abs(dot_product(t, u)/(norm2(t)*norm2(u)) - cos(pi/2*draw(4))) < 1.0e-14_wp)
         normal = [t(2)*u(3) - t(3)*u(2), t(3)*u(1) - t(1)*u(3), t(1)*u(2) - t(2)*u(1)]
         side = sign(1.0_wp, angle_between(before, -g))*sign(1.0_wp, mod(k, 2) - 0.5_wp)
         call check("to a side", normal(3)*side > -1.0e-12_wp)
         call check("a unit vector", abs(sum(after**2) - 1) < 1.0e-15_wp)
      end do
      after = new_heading(turning_t(by_lab, 0.1_wp, -1.0_wp, 0.3_wp), at_angle(1.0_wp), level, level, .false.)
      call check_close("on the flat", angle_between(at_angle(1.0_wp), after), -0.3_wp, 1.0e-14_wp)
   end subroutine test_by_lab

   !> If the descent is within the drawn angle, it becomes the heading.
   subroutine test_not_past()
      real(wp) :: before(2), after(2), aspect(2), draw(3), apart
      integer :: k, met

      met = 0
      do k = 1, 10000
         call random_number(draw)
         apart = (draw(2) - 0.5_wp)*100*degree
         before = at_angle(2*pi*draw(1))
         aspect = at_angle(2*pi*draw(1) + apart)
         after = new_heading(turning_t(to_aspect, draw(3)), before, level, 2*aspect, .false.)
         if (abs(apart) < rebound_turn_angle(draw(3)) - 1.0e-12_wp) then
            met = met + 1
            call check("down the aspect, not past it", maxval(abs(after - aspect)) < 1.0e-15_wp)
         else
            call check("still on its side of the aspect", &
                       angle_between(after, aspect)*apart > -1.0e-12_wp)
         end if
      end do
      call check("both happen", met > 1000 .and. met < 9000)
   end subroutine test_not_past

   !> Upslope, turns are uniform within 22.5 degrees of the heading before, whatever the class.
   subroutine test_upslope()
      real(wp) :: before(2), draw(2), turned
      integer :: k, bin, hits(10)

      hits = 0
      before = at_angle(1.0_wp)
      do k = 1, n
         call random_number(draw)
         turned = angle_between(before, new_heading(turning_t(1 + mod(k, 3), draw(2)), before, before, &
                                                    at_angle(3.0_wp), .false.))
         call check("within 22.5 degrees", abs(turned) <= 22.5_wp*degree)
         bin = 1 + int(5 + 4.999999_wp*turned/(22.5_wp*degree))
         hits(bin) = hits(bin) + 1
      end do
      do k = 1, 10
         call check_share("uniform upslope", hits(k), 0.1_wp)
      end do
   end subroutine test_upslope

   !> In a pit, and if nothing descends, the heading is unchanged.
   subroutine test_unchanged()
      real(wp) :: before(2)
      type(turning_t) :: turning
      integer :: rule

      before = at_angle(1.0_wp)
      do rule = past_aspect, by_lab
         turning = turning_t(rule, 0.9_wp, 1.0_wp, 0.3_wp)
         call check("in a pit", all(abs(new_heading(turning, before, level, at_angle(3.0_wp), .true.) - before) <= 0))
         call check("in a pit, upslope", &
                    all(abs(new_heading(turning, before, before, at_angle(3.0_wp), .true.) - before) <= 0))
         if (rule == by_lab) cycle
         call check("nothing descends", all(abs(new_heading(turning, before, level, level, .false.) - before) <= 0))
      end do
   end subroutine test_unchanged

   !> A mirrored scene has exactly mirrored headings.
   subroutine test_mirror()
      real(wp) :: before(2), down(2), draw(4), g(2), one(2), other(2)
      type(turning_t) :: turning
      integer :: k

      do k = 1, 10000
         call random_number(draw)
         before = at_angle(2*pi*draw(1))
         down = at_angle(2*pi*draw(2))
         g = merge(1, -1, mod(k, 2) == 0)*before
         turning = turning_t(1 + mod(k, 3), draw(3), sign(1.0_wp, draw(4) - 0.5_wp), draw(3))
         one = new_heading(turning, before, g, down, .false.)
         other = new_heading(turning, [-before(1), before(2)], [-g(1), g(2)], [-down(1), down(2)], .false.)
         call check("east is as west", all(abs(other - [-one(1), one(2)]) <= 0))
      end do
   end subroutine test_mirror

   subroutine test_unit_vector()
      real(wp) :: v(2)
      integer :: k

      do k = -300, 150, 10
         v = unit_vector([3.0_wp, -4.0_wp]*10.0_wp**k)
         call check("unit vectors of any length", maxval(abs(v - [0.6_wp, -0.8_wp])) < 4.0e-16_wp)
      end do
      call check("zero stays zero", all(abs(unit_vector([0.0_wp, 0.0_wp])) <= 0))
   end subroutine test_unit_vector

   !> Each quarter of the circle gets a quarter of the numbers, with no jump in between.
   subroutine test_any_heading()
      real(wp) :: u, heading(2)
      integer :: k

      do k = 0, 999
         u = (k + 0.5_wp)/1000
         heading = random_heading(u)
         call check("the circle in equal parts", &
                    maxval(abs(heading - at_angle(2*pi*u - pi/4))) < 2.0e-15_wp)
      end do
   end subroutine test_any_heading
end program test_direction
