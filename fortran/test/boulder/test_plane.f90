! SPDX-License-Identifier: BSD-3-Clause
!> Boulder that bounces down a plane with a fixed matrix, so that every contact is known in closed form.
program test_plane
   use rockfall_kinds, only: wp, i8
   use rockfall_error, only: error_t
   use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan
   use rockfall_terrain, only: terrain, set_window
   use rockfall_random, only: random_key, normal_table
   use rockfall_bounds, only: check_sources
   use rockfall_impact, only: impact_set
   use rockfall_direction, only: to_aspect
   use rockfall_scene_type, only: scene_t
   use rockfall_outcome, only: boulder_result_t, impact_limit, left_domain, hit_nodata, left_window
   use rockfall_scratch, only: scratch_t
   use rockfall_record, only: vertex_t
   use rockfall_ensemble, only: trace_boulder
   use check_m, only: check, check_close, finish
   implicit none

   integer, parameter :: rebounds = 100, nx = 80, ny = 70
   real(wp), parameter :: cell = 5.0_wp, gravity = 9.81_wp, drop = 2.0_wp, small = 1.0e-10_wp
   !> With this matrix no rebound gains energy, and speeds on a slope of 30 degrees stay almost constant.
   real(wp), parameter :: matrix(3, 3) = reshape([0.675_wp, 0.2_wp, 0.3_wp, 0.05_wp, -0.4_wp, &
                                                  0.05_wp, &
                                                  0.1_wp, -0.1_wp, 0.4_wp], [3, 3])
   real(wp), target :: z(nx, ny)

   call test_contacts(0.0_wp)
   call test_contacts(37.0_wp)
   call test_contacts(111.0_wp)
   call test_contacts(270.0_wp)
   call test_sliding()
   call test_departures()
   call finish()

contains

   !> Plane of 30 degrees that descends towards `bearing`, anticlockwise from east [degrees].
   subroutine test_contacts(bearing)
      real(wp), intent(in) :: bearing
      type(scene_t) :: scene
      type(boulder_result_t) :: result
      type(scratch_t) :: scratch
      type(error_t), allocatable :: error
      real(wp) :: down(2), tangent
      integer :: i, r

      tangent = sqrt(1/3.0_wp)
      down = [cosd_(bearing), cosd_(bearing - 90)]
      do r = 1, ny
         do i = 1, nx
            z(i, r) = -tangent*cell*(down(1)*(i - 40) - down(2)*(r - 35))
         end do
      end do
      call make_scene(scene, -110*down, error)
      call check("a scene", .not. allocated(error))
      call trace_boulder(scene, 1_i8, 2*rebounds, result, scratch)
      call check("bounces to its limit", result%status == impact_limit .and. result%impacts == rebounds)
      call check("nothing redrawn", result%redrawn == 0 .and. result%forced == 0)
      call compare(scratch%record%vertex(:scratch%record%n), result, tangent, down)
   end subroutine test_contacts

   !> Rebounds so flat that rounding of the velocity exceeds V_n still take their time.
   subroutine test_sliding()
      type(scene_t) :: scene
      type(boulder_result_t) :: result
      type(scratch_t) :: scratch
      type(error_t), allocatable :: error
      real(wp), parameter :: flat = 1.0e-18_wp, kept = 0.99_wp
      real(wp) :: time
      integer :: k

      z = spread([(-0.7_wp*cell*k, k=1, nx)], 2, ny)
      call make_scene(scene, [0.0_wp, 0.0_wp], error)
      scene%release%drop_height = 0
      scene%release%velocity = [7.0_wp, 1.0_wp, -9.0_wp]
      call set_matrix(scene, [kept, 0.0_wp, 0.0_wp, flat, (0.0_wp, k=5, 9)], error)
      call trace_boulder(scene, 1_i8, 2*rebounds, result, scratch)
      call check("slides on", result%impacts == rebounds .and. result%rebounds == rebounds)
      time = 0
      do k = 1, min(result%impacts, 50)
         call check_close("sum of the flights", scratch%record%vertex(k + 1)%time, time, 1.0e-10_wp)
         time = time + 2*flat*(scratch%record%vertex(2)%v_in(1)*kept**(k - 1))*sqrt(1.49_wp)/gravity
      end do
   end subroutine test_sliding

   !> A boulder that moves eastward down a plane leaves over the edge of the raster, into a column without elevations,
   !> or out of a window.
   subroutine test_departures()
      type(scene_t) :: scene
      type(boulder_result_t) :: result
      type(scratch_t) :: scratch
      type(error_t), allocatable :: error
      integer :: k

      z = spread([(-0.7_wp*cell*k, k=1, nx)], 2, ny)
      call make_scene(scene, [0.0_wp, 0.0_wp], error)
      scene%max_impacts = 10000
      call set_matrix(scene, [0.9_wp, 0.0_wp, 0.0_wp, 0.3_wp, (0.0_wp, k=5, 9)], error)
      call trace_boulder(scene, 1_i8, 2, result, scratch)
      call check("over the edge", result%status == left_domain)
      call check_close("at the outer cell centres", result%stop(1), (nx - 1)*cell, 1.0e-12_wp)
      call set_window(scene%dem, [1, 1], [62, ny])
      call trace_boulder(scene, 1_i8, 2, result, scratch)
      call check("out of the window", result%status == left_window)
      z(61, :) = ieee_value(0.0_wp, ieee_quiet_nan)
      call trace_boulder(scene, 1_i8, 2, result, scratch)
      call check("into nodata", result%status == hit_nodata)
      call check_close("at the last column with elevation", result%stop(1), 59*cell, 1.0e-12_wp)
   end subroutine test_departures

   !> Cosine of an angle in degrees, exact at right angles.
   pure real(wp) function cosd_(angle)
      real(wp), intent(in) :: angle

      cosd_ = cos(angle*acos(-1.0_wp)/180)
      if (abs(mod(angle, 90.0_wp)) <= 0) cosd_ = anint(cosd_)
   end function cosd_

   !> Scene with a release at `place`, relative to the middle of the terrain [m].
   subroutine make_scene(scene, place, error)
      type(scene_t), intent(out) :: scene
      real(wp), intent(in) :: place(2)
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: head

      scene%dem = terrain(4.0e5_wp, 5.0e6_wp, cell, z8=z)
      scene%key = random_key(3_i8)
      scene%table = normal_table()
      scene%gravity = gravity
      scene%max_impacts = rebounds
      scene%surface%sizes = reshape([0.25_wp], [1, 1])
      scene%volumes%mean = 0.8_wp
      scene%release%drop_height = drop
      scene%release%x = [39*cell + place(1)]
      scene%release%y = [35*cell + place(2)]
      head = -huge(head)
      call check_sources(scene, 1, scene%dem%ny, head, error)
      if (allocated(error)) return
      call set_matrix(scene, reshape(transpose(matrix), [9]), error)
   end subroutine make_scene

   !> Impact sets with one fixed matrix, given row by row.
   subroutine set_matrix(scene, elements, error)
      type(scene_t), intent(inout) :: scene
      real(wp), intent(in) :: elements(9)
      type(error_t), allocatable, intent(out) :: error
      integer :: i, k

      scene%turning = to_aspect
      do k = 1, size(scene%sets)
         call impact_set(elements, spread([(0.0_wp, i=1, 9)], 2, 9), scene%sets(k), error)
         if (allocated(error)) return
      end do
   end subroutine set_matrix

   !> Compare contacts with theory: V_n is reversed after T = 2 V_n/(g cos); meanwhile, along the slope, the velocity
   !> increases by g sin T and the distance is V_t T + g sin T**2/2.
   subroutine compare(record, result, tangent, down)
      type(vertex_t), intent(in) :: record(:)
      type(boulder_result_t), intent(in) :: result
      real(wp), intent(in) :: tangent, down(2)
      real(wp) :: sine, cosine, v_in(3), v_out(3), along, time, flight, fastest, highest
      integer :: k

      cosine = 1/sqrt(1 + tangent**2)
      sine = tangent*cosine
      time = sqrt(2*drop/gravity)
      v_in = gravity*time*[sine, -cosine, 0.0_wp]
      along = 0
      fastest = gravity*time
      highest = drop
      call check("as many vertices", size(record) == rebounds + 1)
      do k = 1, rebounds
         associate (c => record(k + 1))
            v_out = matmul(matrix, v_in)
            call check_close("time", c%time, time, small)
            call check("x", abs(c%x - record(1)%x - along*cosine*down(1)) <= small*max(1.0_wp, &
               along))
            call check("y", abs(c%y - record(1)%y - along*cosine*down(2)) <= small*max(1.0_wp, &
               along))
            call check("z", abs(c%z - (record(1)%z - drop) + along*sine) <= small*max(1.0_wp, &
               along))
            call check("incoming", all(abs(c%v_in - v_in) <= small*norm2(v_in)))
            call check("outgoing", all(abs(c%v_out - v_out) <= small*norm2(v_out)))
            call check("velocity", all(abs(c%v - v_out(1)*[cosine*down, -sine] &
                                           - v_out(2)*[sine*down, cosine]) <= small*norm2(v_out)))
            fastest = max(fastest, norm2(v_in(:2)), norm2(v_out(:2)))
            if (k < rebounds) highest = max(highest, (v_out(2)/cosine)**2/(2*gravity))
            flight = 2*v_out(2)/(gravity*cosine)
            time = time + flight
            along = along + v_out(1)*flight + 0.5_wp*gravity*sine*flight**2
            v_in = [v_out(1) + gravity*sine*flight, -v_out(2), v_out(3)]
         end associate
      end do
      call check("it went far", along > 200)
      call check_close("maximum speed", result%speed_max, fastest, small)
      call check_close("maximum jump", result%jump_height_max, highest, small)
   end subroutine compare
end program test_plane
