! SPDX-License-Identifier: BSD-3-Clause
!> Rest and rolling on planes: where friction holds a boulder, the closed form compared with small time steps, and rolls
!> that are cut short or leave the terrain.
program test_rolling
   use rockfall_kinds, only: wp
   use rockfall_math, only: degree, tangent
   use rockfall_boulder, only: inertia_factor
   use rockfall_terrain, only: terrain_t, terrain, locate, height
   use rockfall_flight, only: landing_t
   use rockfall_rolling, only: roll_t, find_roll, find_slide, speed_within, cut_roll, ground_points
   use check_m, only: check, check_close, finish
   implicit none
   integer, parameter :: n = 12
   real(wp), parameter :: cell = 2.0_wp, gravity = 9.81_wp, radius = 0.4_wp, near = 1.0e-12_wp
   real(wp), target :: z(n, n)
   type(terrain_t) :: dem

   call test_rest_angle()
   call test_closed_form()
   call test_descent()
   call test_hollow()
   call test_edge()
   call test_cut()
   call test_slide()
   call test_ground_points()
   call finish()

contains

   !> Set a plane that falls to the south and to the east by given slopes [degree].
   subroutine set_plane(south, east)
      real(wp), intent(in) :: south, east
      integer :: i, r

      do r = 1, n
         do i = 1, n
            z(i, r) = 100 - cell*(r*tan(south*degree) + i*tan(east*degree))
         end do
      end do
      dem = terrain(0.0_wp, 0.0_wp, cell, z8=z)
   end subroutine set_plane

   pure type(landing_t) function contact_at(x, y) result(landing)
      real(wp), intent(in) :: x, y

      landing%contact = .true.
      landing%x = x
      landing%y = y
      call locate(dem, x, y, landing%patch, landing%u, landing%w)
      landing%z = height(landing%patch, landing%u, landing%w)
   end function contact_at

   !> On ground flatter than the rest angle a boulder rests, on steeper ground it rolls; on flat ground it always rests.
   subroutine test_rest_angle()
      type(roll_t) :: roll
      integer :: slope

      do slope = 0, 80
         call set_plane(real(slope, wp), 0.0_wp)
         call find_roll(dem, gravity, tangent(30.0_wp), radius, contact_at(9.3_wp, 13.1_wp), 0.2_wp, 0.1_wp, roll)
         call check("rolls above the rest angle only", roll%rolls .eqv. slope > 30)
         call find_roll(dem, gravity, 1.0e30_wp, radius, contact_at(9.3_wp, 13.1_wp), 0.2_wp, 0.1_wp, roll)
         call check("a rest angle of 90 degrees holds everything", .not. roll%rolls)
      end do
   end subroutine test_rest_angle

   !> Azzoni et al. (1995): speed and time after one radius, compared with small steps of (1 + k) dv/dt = g (sin b - mu
   !> cos b).
   subroutine test_closed_form()
      real(wp), parameter :: slope = 41.0_wp, friction = 0.5_wp, dt = 1.0e-6_wp
      type(roll_t) :: roll
      real(wp) :: v, s, t, a

      call set_plane(slope, 0.0_wp)
      call find_roll(dem, gravity, friction, radius, contact_at(9.3_wp, 13.1_wp), 0.09_wp, 0.3_wp, roll)
      a = gravity*(sin(slope*degree) - friction*cos(slope*degree))/(1 + inertia_factor)
      v = 0.3_wp
      s = 0
      t = 0
      do while (s < radius)
         s = s + (v + 0.5_wp*a*dt)*dt
         v = v + a*dt
         t = t + dt
      end do
      call check_close("speed", sqrt(roll%speed2(2)), v, 1.0e-5_wp)
      call check_close("time", roll%landing%time, t, 1.0e-5_wp)
      call check_close("speed on the way", speed_within(roll, 0.0_wp), 0.3_wp, near)
      call check_close("energy of rolling and friction", (1 + inertia_factor)*(roll%speed2(2) - roll%speed2(1)), &
                       2*gravity*radius*(sin(slope*degree) - friction*cos(slope*degree)), 1.0e-10_wp)
      call find_roll(dem, gravity, friction, radius, contact_at(9.3_wp, 13.1_wp), 0.09_wp, 5.0_wp, roll)
      call check("rotation beyond rolling adds nothing", roll%speed2(1) <= 0.09_wp*(1 + 1.0e-15_wp))
      call find_roll(dem, gravity, friction, radius, contact_at(9.3_wp, 13.1_wp), 0.09_wp, 0.0_wp, roll)
      call check_close("what does not rotate shares its energy", roll%speed2(1), 0.09_wp/1.4_wp, near)
   end subroutine test_closed_form

   !> A roll goes down the steepest descent, one radius along the slope, and ends on the ground.
   subroutine test_descent()
      type(roll_t) :: roll
      type(landing_t) :: start

      call set_plane(30.0_wp, 25.0_wp)
      start = contact_at(9.3_wp, 13.1_wp)
      call find_roll(dem, gravity, 0.5_wp, radius, start, 0.0_wp, 0.0_wp, roll)
      associate (end => roll%landing)
         call check_close("heading", roll%path%heading(1)/(-roll%path%heading(2)), &
                          tan(25*degree)/tan(30*degree), 1.0e-10_wp)
         call check_close("one radius", norm2([end%x - start%x, end%y - start%y, end%z - start%z]), radius, 1.0e-10_wp)
         call check_close("on the ground", end%z, height(end%patch, end%u, end%w), near)
         call check_close("the path ends there", roll%path%z + end%time*roll%path%v(3), end%z, near)
      end associate
   end subroutine test_descent

   !> If the ground rises again within a radius, a boulder rests however steep the patch is.
   subroutine test_hollow()
      type(roll_t) :: roll
      integer :: r

      do r = 1, n
         z(:, r) = 50 + cell*abs(r - 6)  ! slopes of 45 degrees on both sides of a row
      end do
      dem = terrain(0.0_wp, 0.0_wp, cell, z8=z)
      call find_roll(dem, gravity, 0.5_wp, radius, contact_at(9.3_wp, 12.5_wp), 0.0_wp, 0.0_wp, roll)
      call check("it rolls on the slope", roll%rolls)
      call find_roll(dem, gravity, 0.5_wp, radius, contact_at(9.3_wp, 12.1_wp), 0.0_wp, 0.0_wp, roll)
      call check("and rests at the bottom", .not. roll%rolls)
   end subroutine test_hollow

   !> A boulder that rolls off the terrain leaves it at its edge.
   subroutine test_edge()
      type(roll_t) :: roll
      type(landing_t) :: start

      call set_plane(45.0_wp, 0.0_wp)
      start = contact_at(9.3_wp, 0.1_wp)
      call find_roll(dem, gravity, 0.5_wp, radius, start, 0.0_wp, 0.0_wp, roll)
      call check("it rolls out", roll%rolls .and. .not. roll%landing%contact)
      call check("beyond the first row", roll%landing%patch%j < 1)
      call check_close("to the edge and no further", roll%landing%y + 1, 1.0_wp, near)
      call check_close("down to there", roll%landing%z, start%z - 0.1_wp, near)
      start = contact_at(9.3_wp, 0.0_wp)
      call find_roll(dem, gravity, 0.5_wp, radius, start, 0.0_wp, 0.0_wp, roll)
      call check("at once from the edge itself", roll%rolls .and. .not. roll%landing%contact .and. &
                 abs(roll%landing%time) <= 0)
      call find_roll(dem, gravity, 1.5_wp, radius, start, 0.0_wp, 0.0_wp, roll)
      call check("it rests there where friction holds it", .not. roll%rolls)
   end subroutine test_edge

   !> A roll that is cut short ends on its path, with the speed of constant acceleration.
   subroutine test_cut()
      type(roll_t) :: roll
      type(landing_t) :: landing

      call set_plane(45.0_wp, 0.0_wp)
      call find_roll(dem, gravity, 0.5_wp, radius, contact_at(9.3_wp, 13.1_wp), 0.04_wp, 0.2_wp, roll)
      call cut_roll(dem, roll, 0.25_wp*roll%landing%time, landing)
      call check("in the air of it", .not. landing%contact)
      call check_close("a quarter of the way", landing%y, 13.1_wp - 0.25_wp*radius*sqrt(0.5_wp), near)
      call check_close("speed there", speed_within(roll, 0.25_wp)**2, &
                       0.75_wp*roll%speed2(1) + 0.25_wp*roll%speed2(2), near)
   end subroutine test_cut

   !> A slide ends on the ground: on its own patch or on another with other slopes; at the edge of the terrain; or at
   !> its start if the ground falls away.
   subroutine test_slide()
      type(roll_t) :: roll
      type(landing_t) :: start, there
      real(wp) :: t(3), length
      logical :: off
      integer :: k

      call set_plane(10.0_wp, 5.0_wp)
      z(5:8, 5:8) = z(5:8, 5:8) + reshape([(0.3_wp*sin(7.0_wp*k), k=1, 16)], [4, 4])
      start = contact_at(9.3_wp, 13.1_wp)
      do k = 0, 40
         t = [0.6_wp, -0.75_wp, 0.0_wp]
         t(3) = sqrt(1 - sum(t**2))
         length = 0.2_wp*k
         call find_slide(dem, gravity, start, t, length, 10.0_wp, 2.0_wp, roll, off)
         there = contact_at(start%x + length*t(1), start%y + length*t(2))
         call check("the slide ends on the ground", roll%landing%contact .and. .not. off)
         call check("on the patch that lies there", all([roll%landing%patch%i, roll%landing%patch%j] &
                                                        == [there%patch%i, there%patch%j]))
         call check_close("at its height", roll%landing%z, there%z, near)
         call check_close("its time and the wait are the contact's", roll%landing%time + roll%waits, 10.0_wp, near)
      end do
      call find_slide(dem, gravity, start, [0.0_wp, -1.0_wp, 0.0_wp], 1.2_wp, 0.1_wp, 12.0_wp, roll, off)
      call check("ground that falls away is left at once", off .and. .not. abs(roll%length) > 0)
      call check_close("at the place", roll%landing%y, start%y, near)
      call find_slide(dem, gravity, start, [0.0_wp, -1.0_wp, 0.0_wp], 14.0_wp, 10.0_wp, 12.0_wp, roll, off)
      call check("beyond the edge nothing is known", .not. roll%landing%contact)
      call check_close("a slide goes no farther", roll%landing%y + 1, 1.0_wp, near)
   end subroutine test_slide

   !> Chords between the points of a slide deviate by at most 1 % of the radius; on a plane, patch borders suffice.
   subroutine test_ground_points()
      integer, parameter :: samples = 50
      type(roll_t) :: roll
      type(landing_t) :: there
      real(wp), allocatable :: time(:), place(:, :), at(:), on(:, :)
      real(wp) :: t(3), chord(3), off_ground
      logical :: off, bumps
      integer :: angle, k, j

      do angle = 0, 359, 15
         do k = 0, 1
            bumps = k == 1
            call set_plane(10.0_wp, 5.0_wp)
            if (bumps) z = z + reshape([(0.3_wp*sin(7.0_wp*j), j=1, n*n)], [n, n])
            t = [0.9_wp*cos(angle*degree), 0.9_wp*sin(angle*degree), 0.0_wp]
            call find_slide(dem, gravity, contact_at(9.3_wp, 13.1_wp), t, 6.0_wp, 10.0_wp, 2.0_wp, roll, off)
            call ground_points(dem, roll%path, roll%landing%time, radius, time, place)
            associate (path => roll%path, end => roll%landing)
               at = [0.0_wp, time, end%time]
               on = reshape([path%x, path%y, path%z, place, end%x, end%y, end%z], [3, size(at)])
               call check("times rise", all(at(2:) > at(:size(at) - 1)))
               off_ground = 0
               do j = 0, (size(at) - 1)*samples - 1
                  associate (i => j/samples + 1, part => real(modulo(j, samples), wp)/samples)
                     chord = on(:, i) + part*(on(:, i + 1) - on(:, i))
                     call check_close("the path is straight and steady in plan", chord(1), &
                                      path%x + path%v(1)*(at(i) + part*(at(i + 1) - at(i))), near)
                  end associate
                  there = contact_at(chord(1), chord(2))
                  off_ground = max(off_ground, abs(chord(3) - there%z))
               end do
               call check("chords follow the ground", off_ground <= 0.01_wp*radius + near)
               call check("no more points than needed", bumps .or. size(time) == crossed(path%x, end%x) &
                          + crossed(path%y, end%y))
            end associate
         end do
      end do
   end subroutine test_ground_points

   !> Number of patch borders between two coordinates [m], without a border at `b`.
   pure integer function crossed(a, b)
      real(wp), intent(in) :: a, b

      crossed = abs(floor((b - 1.0e-9_wp*(b - a))/cell) - floor(a/cell))
   end function crossed
end program test_rolling
