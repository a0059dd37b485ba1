! SPDX-License-Identifier: BSD-3-Clause
!> Crossings of lines over a plane that falls to the east: position, time, velocity and heights of a parabola; only the
!> first crossing, and none beyond an obstacle.
program test_crossings
   use rockfall_kinds, only: wp
   use rockfall_terrain, only: terrain, locate, height
   use rockfall_flight, only: flight_t, landing_t, launch_rate, fly
   use rockfall_line, only: line
   use rockfall_scene_type, only: scene_t
   use rockfall_outcome, only: boulder_result_t
   use rockfall_crossings, only: crossings_t, record_crossings, start_crossings, clear_crossings
   use check_m, only: check, check_close, finish
   implicit none

   integer, parameter :: n = 40
   real(wp), parameter :: cell = 2.0_wp, gravity = 9.81_wp, fall = 0.5_wp, radius = 0.4_wp, near = 1.0e-12_wp
   real(wp), target :: z(n, n)
   type(scene_t) :: scene
   type(boulder_result_t) :: result
   type(flight_t) :: flight
   type(landing_t) :: landing
   integer :: k

   z = spread([(-fall*cell*(k - 1), k=1, n)], 2, n)
   scene%dem = terrain(0.0_wp, 0.0_wp, cell, z8=z)
   scene%gravity = gravity
   scene%lines = [line([20.0_wp, 20.0_wp], [1.0_wp, 70.0_wp]), line([26.0_wp, 26.0_wp], [1.0_wp, 70.0_wp]), &
                  line([9.0_wp, 9.0_wp], [1.0_wp, 70.0_wp])]
   result%boulder%radius = radius
   result%time = 3
   flight = eastward(10.0_wp, [8.0_wp, 1.0_wp, 4.0_wp], 5.0_wp)
   call fly(scene%dem, gravity, flight, landing)
   call test_state()
   call test_first_only()
   call test_until()
   call finish()

contains

   !> Flight that starts above the ground at a distance from the western edge.
   type(flight_t) function eastward(x, v, above) result(flight)
      real(wp), intent(in) :: x, v(3), above
      real(wp) :: u, w

      flight%x = x
      flight%y = 30
      call locate(scene%dem, flight%x, flight%y, flight%patch, u, w)
      flight%v = v
      flight%above = above
      flight%z = height(flight%patch, u, w) + above
      flight%rate = launch_rate(scene%dem, flight%patch, u, w, v)
   end function eastward

   !> After ten metres at 8 m/s, the boulder has been in the air for 1.25 s.
   subroutine test_state()
      type(crossings_t) :: crossings
      real(wp), parameter :: t = 1.25_wp
      real(wp) :: above

      call start_crossings(3, crossings)
      call check("flies over both lines", landing%x > 26)
      call record_crossings(scene, gravity, result, flight, landing, 2.0_wp, crossings)
      call check("crosses those ahead of it", all((crossings%place > 0) .eqv. [.true., .true., .false.]))
      associate (c => crossings%at(crossings%place(1)))
         above = 5 + 4*t - 0.5_wp*gravity*t**2 + fall*8*t
         call check_close("x", c%x, 20.0_wp, near)
         call check_close("y", c%y, 30 + t, near)
         call check_close("time since the release", c%time, 3 + t, near)
         call check_close("horizontal speed", c%v(1), 8.0_wp, near)
         call check_close("vertical speed", c%v(3), 4 - gravity*t, near)
         call check_close("W = R_b omega", c%omega*radius, 2.0_wp, near)
         call check_close("jump height", c%jump_height, above, near)
         call check_close("passing height: R_b/cos(slope) higher", c%passing_height, &
                          above + radius*sqrt(1 + fall**2), near)
      end associate
   end subroutine test_state

   !> A second flight over the same line changes nothing, unless it is by the next boulder.
   subroutine test_first_only()
      type(crossings_t) :: crossings

      call start_crossings(3, crossings)
      call record_crossings(scene, gravity, result, flight, landing, 2.0_wp, crossings)
      result%time = 50
      call record_crossings(scene, gravity, result, flight, landing, 7.0_wp, crossings)
      call check_close("the first crossing stays", crossings%at(crossings%place(1))%time, 4.25_wp, near)
      call clear_crossings(crossings)
      call check("forgotten", crossings%n == 0 .and. all(crossings%place == 0))
      call record_crossings(scene, gravity, result, flight, landing, 7.0_wp, crossings)
      call check_close("the next boulder's", crossings%at(crossings%place(1))%time, 51.25_wp, near)
      result%time = 3
   end subroutine test_first_only

   !> Lines beyond an obstacle are not crossed.
   subroutine test_until()
      type(crossings_t) :: crossings

      call start_crossings(3, crossings)
      call record_crossings(scene, gravity, result, flight, landing, 2.0_wp, crossings, 1.5_wp)
      call check("up to the obstacle only", all((crossings%place > 0) .eqv. [.true., .false., .false.]))
   end subroutine test_until
end program test_crossings
