! SPDX-License-Identifier: BSD-3-Clause
!> Start and end of a boulder: draws and releases it, and finalises its result.
module rockfall_start
   use rockfall_kinds, only: wp, i8
   use rockfall_math, only: squared_length
   use rockfall_terrain, only: locate, height, cell_of
   use rockfall_boulder, only: boulder_t, draw_boulder, boulder_of, source_of, kinetic_energy
   use rockfall_flight, only: flight_t, landing_t, launch_rate
   use rockfall_maps, only: visit_cell
   use rockfall_scene_type, only: scene_t
   use rockfall_outcome, only: boulder_result_t, at_rest, left_window
   use rockfall_apex, only: find_apex, found, not_loaded
   use rockfall_record, only: vertex_t, record_vertex, store_path
   use rockfall_scratch, only: scratch_t, with_maps, with_all, clear_scratch
   use rockfall_draws, only: block_shape_of, drawn_soil
   implicit none
   private
   public :: start_boulder, start_piece, energy_head, end_boulder

contains

   !> Draw a boulder, and start its first flight.
   pure subroutine start_boulder(scene, number, level, result, flight)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: number
      integer, value :: level  !! basic, ..., with_all
      type(boulder_result_t), intent(out) :: result
      type(flight_t), intent(out) :: flight
      integer :: status  !! status of the descent to the apex

      result%source = int(source_of(scene%release, number))
      if (level >= with_all .and. allocated(scene%features)) then
         associate (volumes => scene%features(scene%release%feature(result%source))%volumes)
            result%boulder = draw_boulder(volumes, scene%table, scene%key, number)
            result%block_shape = block_shape_of(scene, volumes, result%source, number)
         end associate
      else
         result%boulder = draw_boulder(scene%volumes, scene%table, scene%key, number)
         if (level >= with_all) result%block_shape = block_shape_of(scene, scene%volumes, result%source, number)
      end if
      if (level >= with_all .and. allocated(scene%of_source)) &
         result%boulder = boulder_of(scene%of_source(result%source), result%boulder%volume)
      if (level >= with_all .and. (scene%has_tables .or. scene%radius_sigma > 0)) &
         result%soil = drawn_soil(scene%key, scene%table, scene%radius_sigma, number)
      call set_first_flight(scene, result%source, flight)
      result%start = [flight%x, flight%y, flight%z]
      result%speed_max = squared_length(flight%v)  ! squared until the end of the boulder
      if (.not. flight%patch%known) then
         result%status = left_window
         result%stop = result%start
      else if (scene%apexes_requested) then
         call find_apex(scene%dem, result%start(:2), result%apex, status)
         result%has_apex = status == found
         if (status /= not_loaded) return
         result%status = left_window
         result%stop = result%apex
      end if
   end subroutine start_boulder

   !> Clear the work space, then start the first flight of the piece in it; the path recorded so far is kept.
   pure subroutine start_piece(scene, level, result, flight, omega_r, scratch)
      type(scene_t), intent(in) :: scene
      integer, value :: level  !! basic, ..., with_all
      type(boulder_result_t), intent(out) :: result
      type(flight_t), intent(out) :: flight
      real(wp), intent(out) :: omega_r  !! W [m/s]
      type(scratch_t), intent(inout) :: scratch

      call clear_scratch(scene, level, scratch)
      result = scratch%start%result
      flight = scratch%start%flight
      omega_r = scratch%start%omega_r
      call store_path(scratch%start%path, scratch%record)
      if (scratch%record%n == 0) &
         call record_vertex(scratch%record, vertex_t(flight%x, flight%y, flight%z, result%time, flight%v))
   end subroutine start_piece

   !> Kinetic and potential energy [J] of a boulder without spin.
   pure real(wp) function energy_head(gravity, boulder, flight)
      real(wp), intent(in) :: gravity       !! [m/s2]
      type(boulder_t), intent(in) :: boulder
      type(flight_t), intent(in) :: flight  !! first flight of the boulder

      energy_head = sum(kinetic_energy(boulder, flight%v, 0.0_wp)) + boulder%mass*gravity*flight%z
   end function energy_head

   !> First flight: starts above the source, at rest or with the release velocity.
   pure subroutine set_first_flight(scene, source, flight)
      type(scene_t), intent(in) :: scene
      integer, intent(in) :: source
      type(flight_t), intent(out) :: flight
      real(wp) :: u, w

      flight%x = scene%release%x(source)
      flight%y = scene%release%y(source)
      associate (dem => scene%dem)
         call locate(dem, flight%x, flight%y, flight%patch, u, w)
         flight%above = scene%release%drop_height
         flight%v = scene%release%velocity
         if (allocated(scene%features)) then
            flight%above = scene%features(scene%release%feature(source))%drop_height
            flight%v = scene%features(scene%release%feature(source))%velocity
         end if
         flight%z = height(flight%patch, u, w) + flight%above
         flight%rate = launch_rate(dem, flight%patch, u, w, flight%v)
      end associate
   end subroutine set_first_flight

   !> Finalise the result of a boulder.
   pure subroutine end_boulder(scene, landing, level, result, scratch)
      type(scene_t), intent(in) :: scene
      type(landing_t), intent(in) :: landing
      integer, value :: level  !! basic, ..., with_all
      type(boulder_result_t), intent(inout) :: result
      type(scratch_t), intent(inout) :: scratch

      result%speed_max = sqrt(result%speed_max)
      result%stop = [landing%x, landing%y, landing%z]
      if (.not. (landing%contact .or. at_rest(result%status))) return
      result%stop_cell = cell_of(scene%dem, landing%patch, landing%u, landing%w)
      if (level >= with_maps .and. scratch%cells_requested) &
         call visit_cell(scratch%visits, result%stop_cell, 0.0_wp, 0.0_wp, 0.0_wp)
   end subroutine end_boulder
end module rockfall_start
