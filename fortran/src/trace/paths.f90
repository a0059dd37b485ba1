! SPDX-License-Identifier: BSD-3-Clause
!> Path of a boulder to its next contact or obstacle, in the air or along the ground, and all that is recorded along it.
module rockfall_paths
   use rockfall_kinds, only: wp
   use rockfall_math, only: squared_length
   use rockfall_boulder, only: inertia_factor
   use rockfall_flight, only: flight_t, landing_t, span_t, fly, end_flight
   use rockfall_rolling, only: roll_t, touch_t, flight_after_roll, speed_within, cut_roll, &
                               ground_points
   use rockfall_scene_type, only: scene_t
   use rockfall_outcome, only: boulder_result_t
   use rockfall_crossings, only: record_crossings
   use rockfall_maps, only: visit_path
   use rockfall_travel_maps, only: time_visits
   use rockfall_hit_maps, only: record_path
   use rockfall_record, only: vertex_t, record_vertex, start_ground_leg, ground_leg, rest_leg
   use rockfall_scratch, only: scratch_t, with_lines, with_maps, with_all
   use rockfall_obstacles, only: obstacle_t, find_obstacle, none
   implicit none
   private
   public :: fly_over_cells, fly_to_obstacle, follow_roll, visit_cells

contains

   !> Fly to the ground, and record visits of raster cells.
   pure subroutine fly_over_cells(scene, flight, omega_r, start_time, landing, scratch, spans)
      type(scene_t), intent(in) :: scene
      type(flight_t), intent(in) :: flight
      real(wp), intent(in) :: omega_r  !! W [m/s]
      real(wp), intent(in) :: start_time  !! time since the release [s]
      type(landing_t), intent(out) :: landing
      type(scratch_t), intent(inout) :: scratch
      type(span_t), intent(inout), contiguous :: spans(:)
      integer :: n

      n = 0
      if (scratch%heights_requested) then
         call fly(scene%dem, scene%gravity, flight, landing, spans, n)
      else
         call fly(scene%dem, scene%gravity, flight, landing)
      end if
      call visit_cells(scene, scene%gravity, flight, omega_r, start_time, landing%time, spans(:n), scratch)
   end subroutine fly_over_cells

   !> Fly to the ground or to the first obstacle, and record the lines and cells up to there.
   pure subroutine fly_to_obstacle(scene, result, flight, omega_r, landing, obstacle, scratch, spans)
      type(scene_t), intent(in) :: scene
      type(boulder_result_t), intent(in) :: result
      type(flight_t), intent(in) :: flight
      real(wp), intent(in) :: omega_r  !! W [m/s]
      type(landing_t), intent(out) :: landing
      type(obstacle_t), intent(out) :: obstacle
      type(scratch_t), intent(inout) :: scratch
      type(span_t), intent(inout), contiguous :: spans(:)
      integer :: n

      call fly(scene%dem, scene%gravity, flight, landing, spans, n)
      call find_obstacle(scene, scene%gravity, result, flight, landing, omega_r, spans(:n), scratch, obstacle)
      if (obstacle%kind /= none) &
         call end_flight(scene%dem, scene%gravity, flight, obstacle%time, spans, n, landing)
      if (scratch%cells_requested) &
         call visit_cells(scene, scene%gravity, flight, omega_r, result%time, landing%time, &
                          spans(:n), scratch)
   end subroutine fly_to_obstacle

   !> Follow a roll, or the slide of a contact from a table, to the first obstacle or to its end, where the next flight
   !> starts. Lines and cells receive the mean speed; the end receives the exact speed.
   pure subroutine follow_roll(scene, level, roll, result, flight, omega_r, landing, v, obstacle, scratch)
      type(scene_t), intent(in) :: scene
      integer, value :: level                 !! basic, ..., with_all
      type(roll_t), intent(inout) :: roll     !! reset on return
      type(boulder_result_t), intent(inout) :: result
      type(flight_t), intent(inout) :: flight !! velocity after the rebound on entry; the next flight, if any, on return
      real(wp), intent(inout) :: omega_r      !! W after the rebound on entry, at the end on return [m/s]
      type(landing_t), intent(out) :: landing
      real(wp), intent(out) :: v(3)           !! velocity at the end [m/s]
      type(obstacle_t), intent(out) :: obstacle
      type(scratch_t), intent(inout) :: scratch
      real(wp), parameter :: no_gravity = 0.0_wp
      type(span_t) :: span(1)
      real(wp) :: energy_before, mean, fraction, above

      energy_before = squared_length(flight%v) + inertia_factor*omega_r*omega_r
      flight = roll%path
      landing = roll%landing
      roll%rolls = .false.
      mean = sqrt(squared_length(flight%v))
      span = span_t(flight%patch%i, flight%patch%j, 0.0_wp, landing%time, 0.0_wp, 0.0_wp, 0.0_wp)
      if (level >= with_all) then
         call find_obstacle(scene, no_gravity, result, flight, landing, mean, span, scratch, obstacle)
      else if (level >= with_lines .and. allocated(scene%lines)) then
         call record_crossings(scene, no_gravity, result, flight, landing, mean, scratch%crossings)
      end if
      fraction = 1
      if (obstacle%kind /= none) then
         scratch%touch = touch_t()
         fraction = obstacle%time/landing%time
         call cut_roll(scene%dem, roll, obstacle%time, landing)
         span%t1 = landing%time
      end if
      if (level >= with_maps .and. scratch%cells_requested) &
         call visit_cells(scene, no_gravity, flight, mean, result%time, landing%time, span, &
                          scratch)
      if (.not. roll%from_table) then
         omega_r = speed_within(roll, fraction)
         v = omega_r*roll%direction
      else
         omega_r = roll%w
         v = roll%v
         if (obstacle%kind /= none) v = flight%v
      end if
      if (level >= with_all) call record_ground_leg(scene, roll, flight, landing, result, scratch)
      above = merge(roll%above, 0.0_wp, roll%from_table .and. landing%contact)
      result%path_length = result%path_length + merge(fraction*roll%length, mean*landing%time, roll%from_table)
      result%time = result%time + landing%time
      if (roll%from_table .and. landing%contact) result%time = result%time + roll%waits
      result%speed_max = max(result%speed_max, squared_length(v))
      if (level >= with_all) result%energy%ground = result%energy%ground + result%boulder%mass &
         *(scene%gravity*(flight%z - landing%z - above) &
           + 0.5_wp*(energy_before - squared_length(v) - inertia_factor*omega_r*omega_r))
      if (.not. landing%contact) return
      flight = flight_after_roll(scene%dem, roll, landing, v)
      if (level >= with_all) &
         call record_vertex(scratch%record, vertex_t(landing%x, landing%y, landing%z, result%time, v))
   end subroutine follow_roll

   !> Record the points of a leg on the ground between its start and end, and the point where the boulder waits.
   pure subroutine record_ground_leg(scene, roll, flight, landing, result, scratch)
      type(scene_t), intent(in) :: scene
      type(roll_t), intent(in) :: roll
      type(flight_t), intent(in) :: flight    !! path of the leg
      type(landing_t), intent(in) :: landing  !! end of the leg
      type(boulder_result_t), intent(in) :: result  !! result up to the start of the leg
      type(scratch_t), intent(inout) :: scratch
      real(wp), allocatable :: time(:), place(:, :)
      logical :: waits
      integer :: k

      if (.not. allocated(scratch%record%vertex)) return
      waits = roll%from_table .and. landing%contact .and. roll%waits > 0
      call start_ground_leg(scratch%record, flight%v, merge(rest_leg, ground_leg, waits .and. .not. landing%time > 0))
      call ground_points(scene%dem, flight, landing%time, result%boulder%radius, time, place)
      do k = 1, size(time)
         call record_vertex(scratch%record, vertex_t(place(1, k), place(2, k), place(3, k), result%time + time(k), &
                                                     flight%v, leg=ground_leg))
      end do
      if (waits .and. landing%time > 0) &
         call record_vertex(scratch%record, vertex_t(landing%x, landing%y, landing%z, result%time + landing%time, &
                                                     leg=rest_leg))
   end subroutine record_ground_leg

   !> Record the raster cells under a flight, or along a roll (a path without gravity).
   pure subroutine visit_cells(scene, gravity, flight, omega_r, start_time, time, spans, scratch)
      type(scene_t), intent(in) :: scene
      real(wp), intent(in) :: gravity  !! gravity along the path [m/s2]
      type(flight_t), intent(in) :: flight
      real(wp), intent(in) :: omega_r  !! W [m/s]
      real(wp), intent(in) :: start_time  !! time since the release [s]
      real(wp), intent(in) :: time     !! duration of the flight [s]
      type(span_t), intent(in), contiguous :: spans(:)
      type(scratch_t), intent(inout) :: scratch

      associate (visits => scratch%visits, spin => inertia_factor*omega_r**2)
         if (scratch%heights_requested) then
            call visit_path(visits, scene%dem, gravity, flight, time, spin, spans)
         else
            call visit_path(visits, scene%dem, gravity, flight, time, spin)
         end if
         if (allocated(visits%time)) &
            call time_visits(visits, scene%dem, [flight%x, flight%y], flight%v(:2), start_time, time)
         if (scratch%hits_requested) call record_path(scratch%paths, gravity, flight, time, spin)
      end associate
   end subroutine visit_cells
end module rockfall_paths
