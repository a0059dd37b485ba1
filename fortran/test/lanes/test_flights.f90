! SPDX-License-Identifier: BSD-3-Clause
!> Several flights at a time: over flat ground they are parabolas, over rough ground bitwise identical to single calls
!> of `fly`.
program test_flights
   use rockfall_kinds, only: wp
   use rockfall_terrain, only: terrain_t, terrain, locate, height
   use rockfall_flight, only: flight_t, landing_t, launch_rate, fly
   use rockfall_scratch, only: scratch_t
   use rockfall_flights, only: flights_t, landings_t, take_off, take_off_again, take_off_from, fly_to_landings, &
                               landing_of, flight_of, lanes, padded
   use check_m, only: check, check_close, finish
   implicit none

   integer, parameter :: nx = 60, ny = 45
   real(wp), parameter :: cell = 2.5_wp, gravity = 9.81_wp, near = 1.0e-12_wp
   real(wp), target :: z(nx, ny)
   real(wp) :: spin(lanes)
   type(terrain_t) :: dem
   type(scratch_t) :: scratch(lanes)
   type(flight_t) :: start(lanes)
   type(landing_t) :: landing(lanes)

   call random_init(.true., .false.)
   spin = 0
   call test_filled()
   call test_parabolas()
   call test_one_by_one()
   call test_hops()
   call finish()

contains

   !> Lanes are filled to whole vectors of four.
   subroutine test_filled()
      call check("none", padded(0) == 0)
      call check("one to four", all([padded(1), padded(3), padded(4)] == 4))
      call check("five", padded(5) == 8)
      call check("all", padded(lanes) == lanes)
   end subroutine test_filled

   !> Flight from a point above the ground.
   type(flight_t) function flight_at(x, y, above, v) result(flight)
      real(wp), intent(in) :: x, y, above, v(3)
      real(wp) :: u, w

      flight%x = x
      flight%y = y
      flight%v = v
      flight%above = above
      call locate(dem, x, y, flight%patch, u, w)
      flight%z = height(flight%patch, u, w) + above
      flight%rate = launch_rate(dem, flight%patch, u, w, v)
   end function flight_at

   !> Run all flights to their ends.
   subroutine fly_all(f)
      type(flights_t), intent(inout) :: f
      type(landings_t) :: l
      integer :: k, landed

      landed = 0
      do while (f%n > 0)
         call fly_to_landings(dem, gravity, spin, f, l, scratch)
         do k = 1, l%n
            landing(l%lane(k)) = landing_of(l, k)
         end do
         landed = landed + l%n
      end do
      call check("each lands once", landed == lanes)
   end subroutine fly_all

   subroutine test_parabolas()
      type(flights_t) :: f
      real(wp) :: time, above, v(3)
      integer :: k, m

      z = 7
      dem = terrain(0.0_wp, 0.0_wp, cell, z8=z)
      do k = 1, lanes
         m = mod(k, 64)
         above = 0.1_wp*(m + 1)
         v = [0.3_wp*m - 10, 5 - 0.1_wp*m, 0.2_wp*m - 6]
         start(k) = flight_at(70.0_wp, 55.0_wp, above, v)
         call take_off(f, k, start(k))
      end do
      call fly_all(f)
      do k = 1, lanes
         v = start(k)%v
         time = (v(3) + sqrt(v(3)**2 + 2*gravity*start(k)%above))/gravity
         call check("a contact", landing(k)%contact)
         call check_close("time", landing(k)%time, time, near)
         call check_close("x", landing(k)%x, 70 + v(1)*time, near)
         call check_close("y", landing(k)%y, 55 + v(2)*time, near)
         call check_close("on the ground", landing(k)%z, 7.0_wp, near)
         call check_close("jump height", landing(k)%jump_height, &
                          start(k)%above + max(0.0_wp, v(3))**2/(2*gravity), near)
      end do
   end subroutine test_parabolas

   !> Flights have the same ends as single calls of `fly`, also over the edge.
   subroutine test_one_by_one()
      type(flights_t) :: f
      type(landing_t) :: alone
      real(wp) :: r(6)
      integer :: k, round, left

      left = 0
      do round = 1, 50
         call random_number(z)
         dem = terrain(0.0_wp, 0.0_wp, cell, z8=z)
         do k = 1, lanes
            call random_number(r)
            start(k) = flight_at(r(1)*(nx - 1)*cell, r(2)*(ny - 1)*cell, 5*r(3), 40*(r(4:6) - 0.5_wp))
            if (mod(k, 7) == 0) start(k) = flight_at(start(k)%x, start(k)%y, r(3), [0.0_wp, 20*(r(5) - 0.5_wp), r(6)])
            call take_off(f, k, start(k))
         end do
         call fly_all(f)
         do k = 1, lanes
            call fly(dem, gravity, start(k), alone)
            call check("the same end", same(landing(k), alone))
            if (.not. alone%contact) left = left + 1
         end do
      end do
      call check("some left the terrain", left > 100 .and. left < 50*lanes - 100)
   end subroutine test_one_by_one

   !> Return whether two flights ended at exactly the same point.
   logical function same(a, b)
      type(landing_t), intent(in) :: a, b

      same = (a%contact .eqv. b%contact) .and. all([a%time, a%x, a%y, a%z, a%jump_height] &
                                                   == [b%time, b%x, b%y, b%z, b%jump_height]) &
             .and. all([a%patch%i, a%patch%j] == [b%patch%i, b%patch%j])
      if (a%contact) same = same .and. all([a%u, a%w, a%patch%z00, a%patch%a, a%patch%b, a%patch%c] &
                                           == [b%u, b%w, b%patch%z00, b%patch%a, b%patch%b, b%patch%c])
   end function same

   !> The next flight starts at the last landing, or at another point on the same patch.
   subroutine test_hops()
      type(flights_t) :: f
      type(landings_t) :: first, l
      type(flight_t) :: flight

      z = 0
      dem = terrain(0.0_wp, 0.0_wp, cell, z8=z)
      call take_off(f, 5, flight_at(60.0_wp, 50.0_wp, 4.905_wp, [3.0_wp, 0.0_wp, 0.0_wp]))
      call fly_to_landings(dem, gravity, spin, f, first, scratch)
      flight = flight_of(first, 1)
      call check_close("where it began", flight%x, 60.0_wp, near)
      call check_close("falls for a second", first%time(1), 1.0_wp, near)
      call take_off_again(f, first, 1, 3.0_wp, 0.0_wp, gravity, gravity)
      call fly_to_landings(dem, gravity, spin, f, l, scratch)
      call check_close("hops for two", l%time(1), 2.0_wp, near)
      call check_close("from its landing", l%x(1), 69.0_wp, near)
      call check("in its lane", l%lane(1) == 5)
      call take_off_from(f, first, 1, 64.0_wp, 50.0_wp, 0.0_wp, first%i(1), first%j(1), 0.0_wp, 0.0_wp, 0.0_wp, &
                         0.0_wp, 4.905_wp, -1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp)
      call fly_to_landings(dem, gravity, spin, f, l, scratch)
      call check_close("falls from above another place", l%x(1), 63.0_wp, near)
   end subroutine test_hops
end program test_flights
