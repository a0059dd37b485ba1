! SPDX-License-Identifier: BSD-3-Clause
!> Trajectory of one boulder from release to rest: fly, land, find the ground properties, rebound, turn, fly again.
!> A pure function of the scene and the boulder's number.
module rockfall_trajectory
   use rockfall_kinds, only: wp, i8
   use rockfall_math, only: squared_length
   use rockfall_flight, only: flight_t, landing_t, span_t, fly, arc_length
   use rockfall_rolling, only: roll_t
   use rockfall_scene_type, only: scene_t, has_obstacles
   use rockfall_outcome, only: boulder_result_t, departure_status, add_flight, close_energy_balance, absorbed, &
                               left_domain, hit_nodata
   use rockfall_crossings, only: record_crossings
   use rockfall_record, only: vertex_t, record_vertex, end_record
   use rockfall_scratch, only: scratch_t, basic, with_lines, with_maps, with_all, clear_scratch
   use rockfall_start, only: start_boulder, start_piece, energy_head, end_boulder
   use rockfall_breaking, only: break_at_impact
   use rockfall_contact, only: handle_impact
   use rockfall_obstacles, only: obstacle_t, hit_obstacle, record_passed_over, none
   use rockfall_paths, only: fly_over_cells, fly_to_obstacle, follow_roll
   implicit none
   private
   public :: trace_full, choose_tracer

contains

   !> Trace boulder `number` (1..) from its release to its end, and record everything requested.
   pure subroutine trace_full(scene, number, result, scratch, spans)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: number
      type(boulder_result_t), intent(out) :: result
      type(scratch_t), intent(inout) :: scratch
      type(span_t), intent(inout), contiguous :: spans(:)

      call trace_at_level(scene, number, result, scratch, spans, with_all)
   end subroutine trace_full

   !> Trace a boulder without recording trajectory, obstacles, and energies.
   pure subroutine trace_maps(scene, number, result, scratch, spans)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: number
      type(boulder_result_t), intent(out) :: result
      type(scratch_t), intent(inout) :: scratch
      type(span_t), intent(inout), contiguous :: spans(:)

      call trace_at_level(scene, number, result, scratch, spans, with_maps)
   end subroutine trace_maps

   !> Trace a boulder without maps, trajectory, obstacles, and energies.
   pure subroutine trace_lines(scene, number, result, scratch, spans)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: number
      type(boulder_result_t), intent(out) :: result
      type(scratch_t), intent(inout) :: scratch
      type(span_t), intent(inout), contiguous :: spans(:)

      call trace_at_level(scene, number, result, scratch, spans, with_lines)
   end subroutine trace_lines

   !> Trace a boulder for its result only.
   pure subroutine trace_basic(scene, number, result, scratch, spans)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: number
      type(boulder_result_t), intent(out) :: result
      type(scratch_t), intent(inout) :: scratch
      type(span_t), intent(inout), contiguous :: spans(:)

      call trace_at_level(scene, number, result, scratch, spans, basic)
   end subroutine trace_basic

   !> Choose, once per run, the trace procedure without code that the scene does not need. Run-time tests would not
   !> suffice: with unused code present, the compiler does not keep a flight in registers.
   subroutine choose_tracer(scene, cells_requested, trace)
      type(scene_t), intent(in) :: scene
      logical, intent(in) :: cells_requested
      procedure(trace_full), pointer, intent(out) :: trace  !! procedure that records what the scene needs

      trace => trace_basic
      if (allocated(scene%lines) .or. scene%histograms_requested) trace => trace_lines
      if (cells_requested) trace => trace_maps
      if (has_obstacles(scene) .or. scene%energies_requested .or. allocated(scene%grounds) &
          .or. allocated(scene%of_source) .or. allocated(scene%features) &
          .or. allocated(scene%shapes) .or. scene%radius_sigma > 0) trace => trace_full
   end subroutine choose_tracer

   !> Common body of the trace_* procedures, specialised by `level`, a compile-time constant at each call.
   pure subroutine trace_at_level(scene, number, result, scratch, spans, level)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: number
      type(boulder_result_t), intent(out) :: result
      type(scratch_t), intent(inout) :: scratch
      type(span_t), intent(inout), contiguous :: spans(:)
      integer, value :: level  !! basic, ..., with_all
      type(flight_t) :: flight
      type(landing_t) :: landing
      type(obstacle_t) :: obstacle
      real(wp) :: omega_r  !! W = R_b omega [m/s]
      real(wp) :: v_in(3)  !! velocity at the end of a flight [m/s]
      type(roll_t) :: roll
      logical :: obstacles

      omega_r = 0
      obstacles = .false.
      if (level >= with_all) obstacles = has_obstacles(scene)
      if (level >= with_all .and. allocated(scratch%start)) then
         call start_piece(scene, level, result, flight, omega_r, scratch)
      else
         call start_boulder(scene, number, level, result, flight)
         if (result%status /= 0) return
         call clear_scratch(scene, level, scratch)
         if (level >= with_all) then
            call record_vertex(scratch%record, vertex_t(flight%x, flight%y, flight%z, 0.0_wp, flight%v))
            result%energy%released = energy_head(scene%gravity, result%boulder, flight)
         end if
      end if
      do
         if (roll%rolls) then
            call follow_roll(scene, level, roll, result, flight, omega_r, landing, v_in, obstacle, scratch)
            if (landing%contact) cycle
         else
            if (level >= with_all .and. obstacles) then
               call fly_to_obstacle(scene, result, flight, omega_r, landing, obstacle, scratch, spans)
            else if (level >= with_maps .and. scratch%cells_requested) then
               call fly_over_cells(scene, flight, omega_r, result%time, landing, scratch, spans)
            else
               call fly(scene%dem, scene%gravity, flight, landing)
            end if
            if (level >= with_lines .and. allocated(scene%lines) .and. .not. obstacles) then
               call record_crossings(scene, scene%gravity, result, flight, landing, omega_r, scratch%crossings)
            end if
            v_in = flight%v
            v_in(3) = v_in(3) - scene%gravity*landing%time
            call add_flight(arc_length(flight%v, scene%gravity, landing%time), landing%time, squared_length(v_in), &
                            landing%jump_height, result)
         end if
         if (level >= with_all .and. obstacle%kind /= none) then
            call hit_obstacle(scene, number, obstacle, landing, v_in, omega_r, result, flight, scratch)
         else if (.not. landing%contact) then
            result%status = departure_status(scene%dem, landing%patch)
         else
            result%impacts = result%impacts + 1
            call handle_impact(scene, number, landing, v_in, omega_r, level, result, flight, roll, scratch)
            if (level >= with_all .and. allocated(scratch%start)) &
               call break_at_impact(scene, landing, v_in, omega_r, roll, result, flight, scratch)
         end if
         if (result%status /= 0) exit
      end do
      if (level >= with_all) then
         if (any(result%status == [absorbed, left_domain, hit_nodata])) then
            call record_vertex(scratch%record, vertex_t(landing%x, landing%y, landing%z, result%time, v_in))
            flight%v = v_in
         end if
         call end_record(scratch%record)
         call close_energy_balance(scene%gravity, landing%z, flight%v, omega_r, result)
         if (allocated(scene%barriers)) call record_passed_over(scene, result, scratch%crossings)
      end if
      call end_boulder(scene, landing, level, result, scratch)
   end subroutine trace_at_level
end module rockfall_trajectory
