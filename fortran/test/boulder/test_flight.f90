! SPDX-License-Identifier: BSD-3-Clause
!> Flights: parabolas over planes, ridges and saddles compared with closed forms; over random ground no flight goes
!> below it, checked by independent code.
program test_flight
   use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan
   use rockfall_kinds, only: wp
   use rockfall_terrain, only: terrain_t, patch_t, terrain, locate, read_patch, height
   use rockfall_flight, only: flight_t, landing_t, span_t, fly, launch_rate, arc_length
   use check_m, only: check, check_close, finish
   implicit none

   integer, parameter :: nx = 40, ny = 30
   real(wp), parameter :: gravity = 9.81_wp

   call random_init(.true., .false.)
   call test_plane()
   call test_fall()
   call test_starts_on_sides()
   call test_ridge()
   call test_saddle()
   call test_tiny_hop()
   call test_leaving()
   call test_spans()
   call test_never_below_ground()
   call test_arc_length()
   call finish()

contains

   !> Elevations a x + b y [m] at nodes with spacing `cell` [m].
   pure function plane(a, b, cell) result(z)
      real(wp), intent(in) :: a, b, cell
      real(wp) :: z(nx, ny)
      integer :: i, r

      do r = 1, ny
         do i = 1, nx
            z(i, r) = (a*(i - 1) + b*(ny - r))*cell
         end do
      end do
   end function plane

   !> Flight from a point `above` the ground.
   type(flight_t) function flight_from(dem, x, y, above, v) result(start)
      type(terrain_t), intent(in) :: dem
      real(wp), intent(in) :: x, y, above, v(3)
      real(wp) :: u, w

      start%x = x
      start%y = y
      start%v = v
      call locate(dem, x, y, start%patch, u, w)
      start%above = above
      start%z = height(start%patch, u, w) + above
      start%rate = launch_rate(dem, start%patch, u, w, v)
   end function flight_from

   !> Random number between two bounds.
   real(wp) function between(low, high)
      real(wp), intent(in) :: low, high

      call random_number(between)
      between = low + (high - low)*between
   end function between

   !> A flight above a plane lands at a root of a single quadratic.
   subroutine test_plane()
      real(wp), target :: z(nx, ny)
      type(terrain_t) :: dem
      type(flight_t) :: start
      type(landing_t) :: landing
      real(wp) :: rate, above, time
      integer :: k

      z = plane(-0.7_wp, 0.4_wp, 10.0_wp)
      dem = terrain(0.0_wp, 0.0_wp, 10.0_wp, z8=z)
      do k = 1, 1000
         above = merge(0.0_wp, between(0.0_wp, 20.0_wp), mod(k, 2) == 0)
         start = flight_from(dem, between(150.0_wp, 250.0_wp), between(100.0_wp, 200.0_wp), above, &
                             [between(-15.0_wp, 15.0_wp), between(-15.0_wp, 15.0_wp), &
                              between(12.0_wp, 20.0_wp)])
         rate = start%v(3) + 0.7_wp*start%v(1) - 0.4_wp*start%v(2)
         if (rate <= 0.1_wp) cycle
         call fly(dem, gravity, start, landing)
         time = (rate + sqrt(rate**2 + 2*gravity*above))/gravity
         call check("a contact on the plane", landing%contact)
         call check_close("its time", landing%time, time, 1.0e-11_wp)
         call check_close("its x", landing%x, start%x + start%v(1)*time, 1.0e-11_wp)
         call check_close("its y", landing%y, start%y + start%v(2)*time, 1.0e-11_wp)
         call check("its z", abs(landing%z - (-0.7_wp*landing%x + 0.4_wp*landing%y)) < 1.0e-12_wp)
         call check_close("the jump", landing%jump_height, above + rate**2/(2*gravity), 1.0e-11_wp)
      end do
   end subroutine test_plane

   !> A vertical fall does not move in plan, also on a side or a corner of patches.
   subroutine test_fall()
      real(wp), target :: z(nx, ny)
      type(terrain_t) :: dem
      type(landing_t) :: landing
      real(wp), parameter :: x(4) = [123.4_wp, 120.0_wp, 123.4_wp, 120.0_wp], &
         y(4) = [56.7_wp, 56.7_wp, 50.0_wp, 50.0_wp]
      integer :: k

      z = plane(-0.7_wp, 0.4_wp, 10.0_wp)
      dem = terrain(0.0_wp, 0.0_wp, 10.0_wp, z8=z)
      do k = 1, 4
         call fly(dem, gravity, flight_from(dem, x(k), y(k), 5.0_wp, [0.0_wp, 0.0_wp, 0.0_wp]), &
                  landing)
         call check("a fall meets the ground", landing%contact)
         call check_close("after sqrt(2 h/g)", landing%time, sqrt(10/gravity), 1.0e-14_wp)
         call check_close("where it began, x", landing%x, x(k), 1.0e-14_wp)
         call check_close("where it began, y", landing%y, y(k), 1.0e-14_wp)
         call check_close("jump height of a fall", landing%jump_height, 5.0_wp, 1.0e-14_wp)
      end do
      call fly(dem, gravity, flight_from(dem, 120.0_wp, 50.0_wp, 0.0_wp, &
                                         [0.0_wp, 0.0_wp, 9.81_wp]), landing)
      call check_close("thrown straight up, back after 2 v/g", landing%time, 2.0_wp, 1.0e-14_wp)
      call fly(dem, gravity, flight_from(dem, 55.0_wp, 55.0_wp, 0.0_wp, &
                                         [0.0_wp, 0.0_wp, 0.0_wp]), landing)
      call check("at rest on the ground: a contact at once", landing%contact &
                 .and. abs(landing%time) <= 0)
   end subroutine test_fall

   !> Flights from a corner of four patches in 16 directions have the same landing for each of the four start patches.
   subroutine test_starts_on_sides()
      real(wp), target :: z(nx, ny)
      type(terrain_t) :: dem
      type(flight_t) :: start
      type(landing_t) :: landing
      real(wp) :: angle, rate
      integer :: k, i, j

      z = plane(-0.7_wp, 0.4_wp, 10.0_wp)
      dem = terrain(0.0_wp, 0.0_wp, 10.0_wp, z8=z)
      do k = 0, 15
         angle = k*acos(-1.0_wp)/8
         do i = 19, 20
            do j = 14, 15
               start = flight_from(dem, 190.0_wp, 140.0_wp, 0.0_wp, &
                                   [8*cos(angle), 8*sin(angle), 20.0_wp])
               if (mod(k, 4) == 0) start%v = [nint(cos(angle))*8.0_wp, nint(sin(angle))*8.0_wp, &
                                              20.0_wp]
               call read_patch(dem, i, j, start%patch)
               rate = start%v(3) + 0.7_wp*start%v(1) - 0.4_wp*start%v(2)
               start%rate = rate
               call fly(dem, gravity, start, landing)
               call check_close("from a corner", landing%time, 2*rate/gravity, 1.0e-12_wp)
            end do
         end do
      end do
   end subroutine test_starts_on_sides

   !> A level flight of known drop towards a ridge: just below the crest it hits the near face; just above, it lands
   !> behind the ridge.
   subroutine test_ridge()
      real(wp), target :: z(nx, ny)
      type(terrain_t) :: dem
      type(flight_t) :: start
      type(landing_t) :: landing
      real(wp), parameter :: off(2) = [-1.0e-9_wp, 1.0e-9_wp]
      integer :: k, i

      do i = 1, nx
         z(i, :) = -abs(i - 20)*8.0_wp  ! crest of height 0 at x = 190
      end do
      dem = terrain(0.0_wp, 0.0_wp, 10.0_wp, z8=z)
      do k = 1, 2
         start = flight_from(dem, 185.0_wp, 77.0_wp, 0.0_wp, [20.0_wp, 0.0_wp, 0.0_wp])
         start%z = 0.5_wp*gravity*0.0625_wp + off(k)  ! reaches the crest after 0.25 s
         start%above = start%z + 4
         call fly(dem, gravity, start, landing)
         if (k == 1) then
            call check("just below the crest: the near face", landing%contact &
                       .and. landing%patch%i == 19)
            call check("within a nanometre of it", abs(landing%x - 190) < 1.0e-8_wp &
                       .and. abs(landing%z) < 1.0e-8_wp)
         else
            call check("just above the crest: beyond it", landing%contact .and. landing%x > 195)
            call check_close("on the far face", landing%z, -0.8_wp*(landing%x - 190), 1.0e-12_wp)
         end if
      end do
   end subroutine test_ridge

   !> Along the diagonal of a saddle the ground is a dome, steeper than the parabola. The minimum height above it is (a)
   !> 0, a double root: a contact; (b) one nanometre: no contact; (c) negative: two roots.
   subroutine test_saddle()
      real(wp), target :: z(2, 2)
      type(terrain_t) :: dem
      type(patch_t) :: patch
      type(flight_t) :: start
      type(landing_t) :: landing

      z = reshape([20.0_wp, 0.0_wp, 0.0_wp, 20.0_wp], [2, 2])  ! 20 (u + w) - 40 u w: 40 u (1 - u) for u = w
      dem = terrain(0.0_wp, 0.0_wp, 1.0_wp, z8=z)
      call read_patch(dem, 1, 1, patch)
      start = flight_t(patch, 0.0_wp, 0.0_wp, 9.0_wp, [1.0_wp, 1.0_wp, 4.0_wp], 9.0_wp, -36.0_wp)
      call fly(dem, 8.0_wp, start, landing)  ! 9 + 4 t - 4 t**2 touches it at t = 1/2, 9 - 36 t + 36 t**2 = 0
      call check("a double root is a contact", landing%contact)
      call check_close("at its place", landing%time, 0.5_wp, 1.0e-12_wp)
      start%z = 9 + 1.0e-9_wp
      start%above = start%z
      call fly(dem, 8.0_wp, start, landing)
      call check("a nanometre above there is none", .not. landing%contact)
      call check_close("it flies on to the corner", landing%time, 1.0_wp, 1.0e-12_wp)
      start%z = 9 - 1.0e-6_wp
      start%above = start%z
      call fly(dem, 8.0_wp, start, landing)
      call check("a micrometre below: a contact", landing%contact)
      call check_close("at the first of two roots", landing%time, 0.5_wp - sqrt(1.0e-6_wp/36), &
                       1.0e-9_wp)
   end subroutine test_saddle

   !> Hops far shorter than a rounding error of the position still take their time, and end; also along the slope, where
   !> the rounding error of the velocity far exceeds the rate at which the boulder leaves the ground.
   subroutine test_tiny_hop()
      real(wp), target :: z(nx, ny)
      type(terrain_t) :: dem
      type(flight_t) :: start
      type(landing_t) :: landing
      real(wp) :: rate, normal(3), along(3)
      integer :: k

      z = plane(-0.7_wp, 0.4_wp, 10.0_wp)
      dem = terrain(0.0_wp, 0.0_wp, 10.0_wp, z8=z)
      normal = [0.7_wp, -0.4_wp, 1.0_wp]
      along = [1.1_wp, 3.3_wp, -0.7_wp*1.1_wp + 0.4_wp*3.3_wp]
      do k = 2, 150, 2
         rate = 10.0_wp**(-k)
         start = flight_from(dem, 200.0_wp, 150.0_wp, 0.0_wp, rate*normal/sum(normal**2))
         if (mod(k, 4) == 0) start%v = start%v + along
         start%rate = rate
         call fly(dem, gravity, start, landing)
         call check("a tiny hop lands", landing%contact)
         call check_close("in its time", landing%time, 2*rate/gravity, 1.0e-12_wp)
         call check("close by", max(abs(landing%x - 200), &
                                    abs(landing%y - 150)) <= rate + 1.0e-13_wp)
      end do
   end subroutine test_tiny_hop

   !> Nodata and the outer edge end a flight at their border.
   subroutine test_leaving()
      real(wp), target :: z(nx, ny)
      type(terrain_t) :: dem
      type(landing_t) :: landing

      z = 0
      z(20, :) = ieee_value(0.0_wp, ieee_quiet_nan)  ! patches 19 and 20: x 180 to 200
      dem = terrain(0.0_wp, 0.0_wp, 10.0_wp, z8=z)
      call fly(dem, gravity, flight_from(dem, 152.0_wp, 55.0_wp, 1.0_wp, &
                                         [10.0_wp, 3.0_wp, 20.0_wp]), landing)
      call check("nodata ends a flight", .not. landing%contact)
      call check_close("where it begins", landing%x, 180.0_wp, 1.0e-14_wp)
      call check_close("after its time", landing%time, 2.8_wp, 1.0e-14_wp)
      call check_close("at its height", landing%z, 1 + 2.8_wp*20 - 0.5_wp*gravity*2.8_wp**2, &
                       1.0e-13_wp)
      call fly(dem, gravity, flight_from(dem, 152.0_wp, 285.0_wp, 1.0_wp, &
                                         [1.0_wp, 10.0_wp, 20.0_wp]), landing)
      call check("the northern edge ends a flight", .not. landing%contact)
      call check_close("at y of the last node", landing%y, 290.0_wp, 1.0e-14_wp)
      call fly(dem, gravity, flight_from(dem, 5.0_wp, 4.0_wp, 1.0_wp, &
                                         [-2.0_wp, -1.0_wp, 20.0_wp]), landing)
      call check("the western edge ends a flight", .not. landing%contact)
      call check_close("at x of the first node", landing%x, 0.0_wp, 1.0e-14_wp)
      call fly(dem, gravity, flight_from(dem, 5.0_wp, 4.0_wp, 1.0_wp, &
                                         [-1.0_wp, -2.0_wp, 20.0_wp]), landing)
      call check_close("and the southern at y of its node", landing%y, 0.0_wp, 1.0e-14_wp)
   end subroutine test_leaving

   !> The spans of a flight are consecutive, and their quadratics give the height above the ground.
   subroutine test_spans()
      real(wp), target :: z(nx, ny)
      type(terrain_t) :: dem
      type(flight_t) :: start
      type(landing_t) :: landing, alone
      type(span_t) :: spans(nx + ny)
      integer :: n, k
      logical :: joined

      call random_number(z)
      z = 5*z
      dem = terrain(0.0_wp, 0.0_wp, 10.0_wp, z8=z)
      start = flight_from(dem, 31.0_wp, 222.0_wp, 3.0_wp, [25.0_wp, -17.0_wp, 40.0_wp])
      call fly(dem, gravity, start, landing, spans, n)
      call fly(dem, gravity, start, alone)
      call check_close("spans change nothing", alone%time, landing%time, 0.0_wp)
      call check("several spans", n > 20)
      call check_close("the first starts", spans(1)%t0, 0.0_wp, 0.0_wp)
      call check_close("the last ends", spans(n)%t1, landing%time, 0.0_wp)
      joined = .true.
      do k = 1, n - 1
         joined = joined .and. abs(spans(k)%t1 - spans(k + 1)%t0) <= 0
         associate (s => spans(k), length => spans(k)%t1 - spans(k)%t0)
            call check("heights of neighbours meet", &
                       abs(s%d0 + length*(s%d1 + length*s%d2) - spans(k + 1)%d0) < 1.0e-11_wp)
         end associate
      end do
      call check("no gap between spans", joined)
   end subroutine test_spans

   !> None of 10**5 flights over rough ground goes below it: from the air, from the ground, from the last landing.
   subroutine test_never_below_ground()
      real(wp), target :: z(nx, ny)
      type(terrain_t) :: dem
      type(flight_t) :: start
      type(landing_t) :: landing
      type(span_t) :: spans(nx + ny)
      real(wp) :: deepest, off, v(3)
      integer :: k, n, contacts
      logical :: above, exact

      call random_number(z)
      z = 25*z
      dem = terrain(0.0_wp, 0.0_wp, 2.5_wp, z8=z)
      deepest = 0
      off = 0
      contacts = 0
      above = .true.
      exact = .true.
      landing%contact = .false.
      do k = 1, 100000
         v = [between(-20.0_wp, 20.0_wp), between(-20.0_wp, 20.0_wp), between(-20.0_wp, 20.0_wp)]
         if (mod(k, 7) == 0) v(1 + mod(k, 2)) = 0
         if (mod(k, 5) == 0) v = 1.0e-3_wp*v
         if (landing%contact .and. mod(k, 3) > 0) then
            start = flight_t(landing%patch, landing%x, landing%y, landing%z, v, 0.0_wp, &
                             launch_rate(dem, landing%patch, landing%u, landing%w, v))
            if (start%rate <= 0) cycle
         else
            start = flight_from(dem, between(0.0_wp, 97.5_wp), between(0.0_wp, 72.5_wp), &
                                between(0.0_wp, 9.0_wp), v)
            if (mod(k, 2) == 0) start = flight_from(dem, anint(start%x/2.5_wp)*2.5_wp, start%y, &
                                                    0.5_wp, v)
         end if
         call fly(dem, gravity, start, landing, spans, n)
         above = above .and. all(spans(:n)%d0 >= 0 .and. spans(:n)%t1 >= spans(:n)%t0)
         deepest = max(deepest, depth(z, 2.5_wp, start, landing%time))
         if (.not. landing%contact) cycle
         contacts = contacts + 1
         exact = exact .and. abs(height(landing%patch, landing%u, landing%w) - landing%z) <= 0
         off = max(off, abs(ground(z, landing%x/2.5_wp, landing%y/2.5_wp) - landing%z))
      end do
      print "(a, es9.2, a)", "deepest below the ground: ", deepest, " m"
      call check("many contacts", contacts > 50000)
      call check("no flight goes through the ground", deepest < 1.0e-9_wp)
      call check("contacts lie on it", off < 1.0e-11_wp)
      call check("to the bit, by the place in their patch", exact)
      call check("every patch is entered on or above the ground, later than the one before", above)
   end subroutine test_never_below_ground

   !> Bilinear elevation at x, y in node spacings.
   pure real(wp) function ground(z, x, y)
      real(wp), intent(in) :: z(:, :), x, y
      integer :: i, r

      i = max(1, min(size(z, 1) - 1, 1 + floor(x)))
      r = max(2, min(size(z, 2), size(z, 2) - floor(y)))
      associate (u => x - (i - 1), w => y - (size(z, 2) - r))
         ground = (1 - w)*((1 - u)*z(i, r) + u*z(i + 1, r)) + w*((1 - u)*z(i, &
            r - 1) + u*z(i + 1, r - 1))
      end associate
   end function ground

   !> Maximum depth of a flight below the ground [m]. Between sides of patches, depth is a quadratic, determined by
   !> three points.
   real(wp) function depth(z, cell, start, time)
      real(wp), intent(in) :: z(:, :), cell, time
      type(flight_t), intent(in) :: start
      real(wp) :: t0, t1, at_side(2), d(3), s, bend
      integer :: k, side(2)

      depth = 0
      t0 = 0
      side = merge(ceiling([start%x, start%y]/cell), floor([start%x, start%y]/cell), &
                   start%v(1:2) > 0)
      do while (t0 < time)
         at_side = huge(time)
         where (abs(start%v(1:2)) > 0) at_side = (side*cell - [start%x, start%y])/start%v(1:2)
         t1 = min(time, at_side(1), at_side(2))
         do k = 1, 3
            d(k) = below(z, cell, start, t0 + (k - 1)*0.5_wp*(t1 - t0))
         end do
         depth = max(depth, maxval(d))
         bend = 2*(d(1) - 2*d(2) + d(3))
         if (bend < 0) then
            s = 0.5_wp - (d(3) - d(1))/(2*bend)  ! vertex of the parabola through these points
            if (s > 0 .and. s < 1) depth = max(depth, below(z, cell, start, t0 + s*(t1 - t0)))
         end if
         where (t1 >= at_side) side = side + int(sign(1.0_wp, start%v(1:2)))
         t0 = max(t0, t1)
      end do
   end function depth

   !> Depth below the ground at one time [m].
   pure real(wp) function below(z, cell, start, t)
      real(wp), intent(in) :: z(:, :), cell, t
      type(flight_t), intent(in) :: start

      below = ground(z, (start%x + start%v(1)*t)/cell, (start%y + start%v(2)*t)/cell) &
              - (start%z + start%v(3)*t - 0.5_wp*gravity*t*t)
   end function below

   !> The closed form equals Simpson's rule, also where it must not divide by the plan speed.
   subroutine test_arc_length()
      real(wp) :: v(3), time, sum
      integer :: k, n, m

      do k = 1, 100
         v = [between(-20.0_wp, 20.0_wp), between(-20.0_wp, 20.0_wp), between(-30.0_wp, 30.0_wp)]
         if (k > 50) v(1:2) = 1.0e-3_wp*v(1:2)
         time = between(0.01_wp, 6.0_wp)
         n = 200000/merge(100, 1, k <= 50)
         sum = speed(v, 0.0_wp) + speed(v, time)
         do m = 1, n - 1
            sum = sum + merge(4, 2, mod(m, 2) == 1)*speed(v, m*time/n)
         end do
         call check_close("length of an arc", arc_length(v, gravity, time), sum*time/(3*n), &
                          1.0e-8_wp)
      end do
      do k = 1, 10000  ! from almost vertical to almost level, from hops to long falls
         v = 30*[between(-1.0_wp, 1.0_wp), between(-1.0_wp, 1.0_wp), between(-1.0_wp, 1.0_wp)]
         v(1:2) = v(1:2)*10.0_wp**between(-12.0_wp, 0.0_wp)
         time = 6*10.0_wp**between(-9.0_wp, 0.0_wp)
         call check("to rounding", abs(arc_length(v, gravity, time) - exact_arc_length(v, time)) &
                    <= 8*epsilon(time)*(speed(v, 0.0_wp)**2 + speed(v, time)**2)/gravity)
      end do
      call check("of no hop below zero", all([(arc_length(v, gravity, scale(0.1_wp, -n)), n=1, 60)] >= 0))
      call check_close("of a fall", arc_length([0.0_wp, 0.0_wp, 0.0_wp], gravity, 2.0_wp), &
                       2*gravity, 1.0e-14_wp)
      call check_close("up and down", arc_length([0.0_wp, 0.0_wp, gravity], gravity, 2.0_wp), &
                       gravity, 1.0e-14_wp)
      call check_close("almost a fall", arc_length([1.0e-200_wp, 0.0_wp, 0.0_wp], gravity, &
                                                   2.0_wp), 2*gravity, 1.0e-14_wp)
      call check_close("of no time", arc_length([3.0_wp, 4.0_wp, -5.0_wp], gravity, 0.0_wp), &
                       0.0_wp, 0.0_wp)
   end subroutine test_arc_length

   !> Closed form as in textbooks, in 33 digits.
   pure real(wp) function exact_arc_length(v, time) result(length)
      real(wp), intent(in) :: v(3), time
      integer, parameter :: qp = selected_real_kind(33)
      real(qp) :: plan, w(2), s(2)

      plan = sqrt(real(v(1), qp)**2 + real(v(2), qp)**2)
      w = [real(v(3), qp), real(v(3), qp) - real(gravity, qp)*real(time, qp)]
      s = w*sqrt(plan**2 + w**2) + plan**2*asinh(w/plan)
      length = real((s(1) - s(2))/(2*real(gravity, qp)), wp)
   end function exact_arc_length

   pure real(wp) function speed(v, t)
      real(wp), intent(in) :: v(3), t

      speed = sqrt(v(1)**2 + v(2)**2 + (v(3) - gravity*t)**2)
   end function speed
end program test_flight
