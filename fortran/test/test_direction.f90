! SPDX-License-Identifier: BSD-3-Clause
!> Turning after a rebound: the printed classes, towards the descent and not past it, upslope, in pits.
program test_direction
   use rockfall_kinds, only: wp
   use rockfall_math, only: pi, degree
   use rockfall_direction, only: turn_angle, new_heading, unit_vector, any_heading
   use check_m, only: check, check_close, finish
   implicit none

   integer, parameter :: n = 1000000

   call random_init(.true., .false.)
   call test_classes()
   call test_downslope()
   call test_not_past()
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

   !> A share of n draws within 4 standard errors of its probability.
   subroutine check_share(name, hits, p)
      character(len=*), intent(in) :: name
      integer, intent(in) :: hits
      real(wp), intent(in) :: p

      call check(name, abs(hits - n*p) < 4*sqrt(n*p*(1 - p)))
   end subroutine check_share

   !> 72 % below 22.5 degrees, 24 % below 45, 4 % below 50; each class uniform.
   subroutine test_classes()
      real(wp) :: class, within, turn
      integer :: k, hits(20)
      real(wp), parameter :: p(20) = [(0.72_wp/9, k=1, 9), (0.24_wp/9, k=1, 9), 0.04_wp/2, &
                                      0.04_wp/2]

      hits = 0
      do k = 1, n
         call random_number(class)
         call random_number(within)
         turn = turn_angle(class, within)/(2.5_wp*degree)  ! 9, 9 and 2 bins of 2.5 degrees
         call check("no turn beyond 50 degrees", turn >= 0 .and. turn < 20)
         hits(1 + int(turn)) = hits(1 + int(turn)) + 1
      end do
      call check_share("72 % below 22.5 degrees", sum(hits(:9)), 0.72_wp)
      call check_share("24 % between 22.5 and 45", sum(hits(10:18)), 0.24_wp)
      call check_share("4 % between 45 and 50", sum(hits(19:)), 0.04_wp)
      do k = 1, 20
         call check_share("uniform inside the class", hits(k), p(k))
      end do
      call check_close("the end of the first class", turn_angle(0.7199_wp, 1.0_wp), &
                       22.5_wp*degree, 1.0e-15_wp)
      call check_close("the start of the second", turn_angle(0.72_wp, 0.0_wp), 22.5_wp*degree, &
                       1.0e-15_wp)
      call check_close("the end of the second", turn_angle(0.9599_wp, 1.0_wp), 45*degree, &
                       1.0e-15_wp)
      call check_close("the start of the third", turn_angle(0.96_wp, 0.0_wp), 45*degree, 1.0e-15_wp)
      call check_close("the end of the third", turn_angle(1.0_wp, 1.0_wp), 50*degree, 1.0e-15_wp)
   end subroutine test_classes

   !> Far from the descent the heading turns towards it by the drawn angle, and stays a unit vector.
   subroutine test_downslope()
      real(wp) :: before(2), after(2), draw(4), apart, turned
      integer :: k

      do k = 1, 10000
         call random_number(draw)
         before = at_angle(2*pi*draw(1))
         apart = (50.01_wp + 129.98_wp*draw(2))*degree
         if (mod(k, 2) == 0) apart = -apart
         after = new_heading(before, 0.37_wp*at_angle(2*pi*draw(1) + apart), .false., .false., &
                             draw(3), draw(4))
         turned = angle_between(before, after)
         call check("turned by the drawn angle, towards the descent", &
                    abs(turned - sign(turn_angle(draw(3), draw(4)), apart)) < 1.0e-14_wp)
         call check("a unit vector", abs(sum(after**2) - 1) < 2.0e-15_wp)
      end do
   end subroutine test_downslope

   !> Within the drawn angle of the descent the heading becomes the descent itself.
   subroutine test_not_past()
      real(wp) :: before(2), after(2), aspect(2), draw(4), apart
      integer :: k, met

      met = 0
      do k = 1, 10000
         call random_number(draw)
         apart = (draw(2) - 0.5_wp)*100*degree
         before = at_angle(2*pi*draw(1))
         aspect = at_angle(2*pi*draw(1) + apart)
         after = new_heading(before, 2*aspect, .false., .false., draw(3), draw(4))
         if (abs(apart) < turn_angle(draw(3), draw(4)) - 1.0e-12_wp) then
            met = met + 1
            call check("down the aspect, not past it", maxval(abs(after - aspect)) < 1.0e-15_wp)
         else
            call check("still on its side of the aspect", &
                       angle_between(after, aspect)*apart > -1.0e-12_wp)
         end if
      end do
      call check("both happen", met > 1000 .and. met < 9000)
   end subroutine test_not_past

   !> Upslope: uniform within 22.5 degrees of the heading before, whatever the class.
   subroutine test_upslope()
      real(wp) :: before(2), draw(2), turned
      integer :: k, bin, hits(10)

      hits = 0
      before = at_angle(1.0_wp)
      do k = 1, n
         call random_number(draw)
         turned = angle_between(before, new_heading(before, at_angle(3.0_wp), .false., .true., &
                                                    draw(1), draw(2)))
         call check("within 22.5 degrees", abs(turned) <= 22.5_wp*degree)
         bin = 1 + int(5 + 4.999999_wp*turned/(22.5_wp*degree))
         hits(bin) = hits(bin) + 1
      end do
      do k = 1, 10
         call check_share("uniform upslope", hits(k), 0.1_wp)
      end do
   end subroutine test_upslope

   !> In a pit, and where nothing descends, the heading stays.
   subroutine test_unchanged()
      real(wp) :: before(2)

      before = at_angle(1.0_wp)
      call check("in a pit", all(abs(new_heading(before, at_angle(3.0_wp), .true., .false., &
                                                 0.5_wp, 0.9_wp) - before) <= 0))
      call check("in a pit, upslope", &
                 all(abs(new_heading(before, at_angle(3.0_wp), .true., .true., 0.5_wp, &
                                     0.9_wp) - before) <= 0))
      call check("nothing descends", &
                 all(abs(new_heading(before, [0.0_wp, 0.0_wp], .false., .false., 0.5_wp, &
                                     0.9_wp) - before) <= 0))
   end subroutine test_unchanged

   !> A mirrored scene has mirrored headings, to the bit.
   subroutine test_mirror()
      real(wp) :: before(2), down(2), draw(4), one(2), other(2)
      integer :: k

      do k = 1, 10000
         call random_number(draw)
         before = at_angle(2*pi*draw(1))
         down = at_angle(2*pi*draw(2))
         one = new_heading(before, down, .false., mod(k, 2) == 0, draw(3), draw(4))
         other = new_heading([-before(1), before(2)], [-down(1), down(2)], .false., &
                             mod(k, 2) == 0, draw(3), draw(4))
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

   !> A quarter of the numbers for each quarter of the circle, and no jump between them.
   subroutine test_any_heading()
      real(wp) :: u, heading(2)
      integer :: k

      do k = 0, 999
         u = (k + 0.5_wp)/1000
         heading = any_heading(u)
         call check("the circle in equal parts", &
                    maxval(abs(heading - at_angle(2*pi*u - pi/4))) < 2.0e-15_wp)
      end do
   end subroutine test_any_heading
end program test_direction
