! SPDX-License-Identifier: BSD-3-Clause
!> Local frame of an impact: transformation into it and back, reversal by a backward rebound, heading kept in a pit.
program test_local_frame
   use rockfall_kinds, only: wp
   use rockfall_terrain, only: terrain_t, terrain, locate, height, gradient, cell_of, steepness_of, is_pit
   use rockfall_flight, only: flight_t, landing_t
   use rockfall_direction, only: turning_t
   use rockfall_local_frame, only: decompose, launch_velocity, face_forward, signed_w, outgoing_flight
   use check_m, only: check, check_close, finish
   implicit none

   integer, parameter :: n = 8
   real(wp), parameter :: cell = 2.0_wp, near = 1.0e-12_wp
   real(wp), target :: z(n, n)
   type(terrain_t) :: dem

   call random_init(.true., .false.)
   call test_mirror()
   call test_backward()
   call test_pit()
   call test_next_flight()
   call finish()

contains

   !> A rebound that only reverses V_n mirrors the velocity at the plane: v - 2 (v.n) n.
   subroutine test_mirror()
      real(wp) :: r(5), v(3), g(2), steepness, normal(3), v_in(3), heading(2), out(3), rate
      integer :: k

      do k = 1, 1000
         call random_number(r)
         v = 20*(r(1:3) - 0.5_wp)
         g = 3*(r(4:5) - 0.5_wp)
         steepness = steepness_of(g(1), g(2))
         normal = [-g, 1.0_wp]/steepness
         if (dot_product(v, normal) > 0) v = v - 2*dot_product(v, normal)*normal
         call decompose(v, g, steepness, [1.0_wp, 0.0_wp], 0.0_wp, v_in, heading)
         call check_close("V_n", v_in(2), dot_product(v, normal), 1.0e-10_wp)
         call check_close("V_t", v_in(1), norm2(v - v_in(2)*normal), 1.0e-10_wp)
         call launch_velocity(v_in(1), -v_in(2), heading(1), heading(2), g(1), g(2), steepness, &
                              out(1), out(2), out(3), rate)
         call check("mirrored", all(abs(out - (v - 2*v_in(2)*normal)) <= 1.0e-11_wp*norm2(v)))
         call check_close("rate of the height", rate, out(3) - dot_product(g, out(1:2)), 1.0e-10_wp)
      end do
   end subroutine test_mirror

   !> A boulder thrown back reverses its heading, and with it the sign of W.
   subroutine test_backward()
      real(wp) :: heading(2), w

      heading = [0.6_wp, -0.8_wp]
      w = 3
      call face_forward(2.0_wp, heading(1), heading(2), w)
      call check("forward: as it was", all(abs([heading, w] - [0.6_wp, -0.8_wp, 3.0_wp]) <= 0))
      call face_forward(-2.0_wp, heading(1), heading(2), w)
      call check("backward: the other way", all(abs([heading, w] + [0.6_wp, -0.8_wp, 3.0_wp]) <= 0))
      call check("rolled on", signed_w(3.0_wp, 1.0_wp, 0.0_wp, 0.9_wp, 0.1_wp) > 0)
      call check("rolled back", signed_w(3.0_wp, 1.0_wp, 0.0_wp, -0.9_wp, 0.1_wp) < 0)
   end subroutine test_backward

   !> Contact at a point of the terrain.
   type(landing_t) function contact_at(x, y) result(landing)
      real(wp), intent(in) :: x, y

      landing%contact = .true.
      landing%x = x
      landing%y = y
      call locate(dem, x, y, landing%patch, landing%u, landing%w)
      landing%z = height(landing%patch, landing%u, landing%w)
   end function contact_at

   !> In a pit, a boulder keeps its heading, whatever is drawn.
   subroutine test_pit()
      type(landing_t) :: landing
      type(flight_t) :: flight
      real(wp) :: g(2), w
      integer :: k

      call check("as low as its neighbours", is_pit(1.0_wp, 1.0_wp) > 0)
      call check("a lower neighbour", .not. is_pit(1.0_wp, 0.9_wp) > 0)
      z = 5
      z(4, 5) = 4.5_wp
      dem = terrain(0.0_wp, 0.0_wp, cell, z8=z)
      landing = contact_at(6.1_wp, 6.2_wp)
      g = gradient(dem, landing%patch, landing%u, landing%w)
      call check("the pit", all(cell_of(dem, landing%patch, landing%u, landing%w) == [4, 5]))
      do k = 0, 9
         call outgoing_flight(dem, landing, [4, 5], g, steepness_of(g(1), g(2)), [0.0_wp, 1.0_wp], &
                              turning_t(u=0.05_wp + 0.1_wp*k), [2.0_wp, 1.0_wp, 0.5_wp], flight, w)
         call check("straight on", all(abs(flight%heading - [0.0_wp, 1.0_wp]) <= 0))
      end do
   end subroutine test_pit

   !> On a plane, the next flight starts at the contact with the speed of the rebound, turned towards the descent.
   subroutine test_next_flight()
      type(landing_t) :: landing
      type(flight_t) :: flight
      real(wp) :: g(2), w
      integer :: k

      z = spread([(-0.5_wp*cell*k, k=1, n)], 2, n)
      dem = terrain(0.0_wp, 0.0_wp, cell, z8=z)
      landing = contact_at(6.1_wp, 6.2_wp)
      g = gradient(dem, landing%patch, landing%u, landing%w)
      call outgoing_flight(dem, landing, cell_of(dem, landing%patch, landing%u, landing%w), g, &
                           steepness_of(g(1), g(2)), [0.0_wp, 1.0_wp], turning_t(u=0.36_wp), &
                           [3.0_wp, 4.0_wp, 0.5_wp], flight, w)
      call check_close("the speed", norm2(flight%v), 5.0_wp, near)
      call check_close("W", w, 0.5_wp, near)
      call check_close("turned by half of 22.5 degrees", flight%heading(1), sin(acos(-1.0_wp)/16), near)
      call check_close("from the contact", flight%z, landing%z, near)
      call check_close("on the ground", flight%above, 0.0_wp, near)
   end subroutine test_next_flight
end program test_local_frame
