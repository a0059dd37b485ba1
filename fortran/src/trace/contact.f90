! SPDX-License-Identifier: BSD-3-Clause
!> Contact with the ground: find the ground properties; rebound by impact sets, a classical model or an impact table;
!> then fly, roll, or rest.
module rockfall_contact
   use rockfall_kinds, only: wp, i8
   use rockfall_math, only: squared_length
   use rockfall_random, only: uniform, side_of, words_per_block, rebound_words, turn_word, obstacle_word, ratio_word, &
                              roughness_word
   use rockfall_terrain, only: gradient, steepness_of, cell_of
   use rockfall_surface, only: rock_radius, ground_at
   use rockfall_boulder, only: inertia_factor
   use rockfall_block_shape, only: ground_of_shape
   use rockfall_flight, only: flight_t, landing_t
   use rockfall_rolling, only: roll_t, touch_t, find_roll
   use rockfall_impact, only: find_nearest_set, interpolated_set, beyond_fit, rebound_t, rebound, twice_energy
   use rockfall_classical_rebound, only: absorbs
   use rockfall_ground, only: ground_t, ground_rebound, is_stochastic
   use rockfall_direction, only: turning_t, by_lab, lateral_angle
   use rockfall_local_frame, only: decompose, outgoing_flight
   use rockfall_table_contact, only: table_contact_t, table_contact, update_touch
   use rockfall_histogram, only: count_rebound
   use rockfall_scene_type, only: scene_t, inertia_of, is_slow
   use rockfall_outcome, only: boulder_result_t, count_outcome, add_ground_loss, stopped, absorbed, impact_limit
   use rockfall_record, only: vertex_t, record_vertex
   use rockfall_scratch, only: scratch_t, with_lines, with_all, count_ground
   use rockfall_draws, only: impact_words, ground_uniforms
   implicit none
   private
   public :: handle_impact, find_ground, find_impact_set, close_impact, rest_or_roll

   real(wp), parameter :: rockless_radius = 1.0e-9_wp  !! R_m for ground without rocks, smaller than any boulder [m]

contains

   !> Handle a contact: the boulder is absorbed, stops, or starts its next flight or roll.
   pure subroutine handle_impact(scene, number, landing, v, omega_r, level, result, flight, roll, scratch)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: number
      type(landing_t), intent(in) :: landing
      real(wp), intent(in) :: v(3)          !! incoming velocity [m/s]
      real(wp), intent(inout) :: omega_r    !! W [m/s]
      integer, value :: level               !! basic, ..., with_all
      type(boulder_result_t), intent(inout) :: result
      type(flight_t), intent(inout) :: flight
      type(roll_t), intent(inout) :: roll   !! next roll, if any
      type(scratch_t), intent(inout) :: scratch
      integer(i8) :: word(words_per_block)
      integer :: cell(2), set, ground
      logical :: outside, slow
      real(wp) :: radius, obstacle, ratio, fast, steep, v_in(3), heading(2), g(2), steepness
      real(wp) :: u_ground(words_per_block)
      type(rebound_t) :: out
      type(turning_t) :: turning

      word = impact_words(scene, number, result%impacts)
      cell = cell_of(scene%dem, landing%patch, landing%u, landing%w)
      u_ground = 0
      if (scene%ground_drawn) u_ground = ground_uniforms(scene, number, result%impacts)
      call find_ground(scene, u_ground(obstacle_word), result%block_shape, cell, level, ground, radius, obstacle, &
                       result%status)
      if (result%status == absorbed) return
      ratio = result%boulder%radius/radius
      if (level >= with_all) ratio = ratio*result%soil%ratio_factor
      if (level >= with_all .and. ground > 0) then
         if (allocated(scene%grounds(ground)%table)) then
            call handle_table_contact(scene, scene%grounds(ground), number, ground, landing, v, ratio, uniform(word), &
                                      omega_r, level, result, flight, roll, scratch)
            return
         end if
      end if
      scratch%touch = touch_t()
      call find_impact_set(scene, ratio, u_ground(ratio_word), set, outside)
      g = gradient(scene%dem, landing%patch, landing%u, landing%w)
      steepness = steepness_of(g(1), g(2))
      call decompose(v, g, steepness, flight%heading, omega_r, v_in, heading)
      if (level >= with_all .and. ground > 0) then
         call ground_rebound(scene%grounds(ground), scene%table, scene%key, number, int(result%impacts, i8), &
                             word(:rebound_words), u_ground(roughness_word), result%boulder, &
                             inertia_of(scene, number), obstacle, scene%gravity/steepness, set, v_in, out)
         call check_fit_range(scene%grounds(ground), set, v_in, outside, fast, steep, ratio)
         call count_ground(ground, scratch)
      else
         call rebound(scene%sets(set), scene%table, scene%key, number, int(result%impacts, i8), &
                      word(:rebound_words), v_in, out)
         call beyond_fit(scene%sets(set)%fitted, v_in(1), v_in(2), fast, steep)
      end if
      call count_outcome(out, outside, fast > 0, steep > 0, result)
      if (level >= with_lines .and. scene%histograms_requested) call count_rebound(scratch%histograms, v_in, out%v)
      turning = turning_t(scene%turning, uniform(word(turn_word)), side_of(word(turn_word)))
      if (turning%rule == by_lab) turning%lateral = lateral_angle(scene%lateral(set), v_in(1:2), turning%u)
      if (level >= with_all .and. ground > 0 .and. turning%rule == by_lab) then
         if (is_stochastic(scene%grounds(ground))) &
            turning%lateral = lateral_angle(scene%grounds(ground)%lateral(set), v_in(1:2), turning%u)
      end if
      call outgoing_flight(scene%dem, landing, cell, g, steepness, heading, turning, out%v, flight, omega_r)
      if (level >= with_all) then
         call record_vertex(scratch%record, vertex_t(landing%x, landing%y, landing%z, result%time, flight%v, v_in, &
                                                     out%v, ratio))
         call add_ground_loss(twice_energy(v_in), twice_energy(out%v), 0.0_wp, result)
      end if
      slow = is_slow(scene, squared_length(flight%v))
      call close_impact(scene, squared_length(flight%v), .not. slow, result)
      if (slow) call rest_or_roll(scene, ground, landing, squared_length(flight%v), omega_r, result, roll)
   end subroutine handle_impact

   !> Handle a contact from a table: compute its end, unless the boulder stops.
   pure subroutine handle_table_contact(scene, ground_data, number, ground, landing, v, ratio, u, omega_r, level, &
                                        result, flight, roll, scratch)
      type(scene_t), intent(in) :: scene
      type(ground_t), intent(in) :: ground_data
      integer(i8), intent(in) :: number
      integer, intent(in) :: ground          !! index of the ground
      type(landing_t), intent(in) :: landing
      real(wp), intent(in) :: v(3)           !! incoming velocity [m/s]
      real(wp), intent(in) :: ratio          !! R_b/R_m [-]
      real(wp), intent(in) :: u(words_per_block)  !! uniform in (0, 1) [-]
      real(wp), intent(inout) :: omega_r     !! W [m/s]
      integer, value :: level                !! basic, ..., with_all
      type(boulder_result_t), intent(inout) :: result
      type(flight_t), intent(inout) :: flight
      type(roll_t), intent(inout) :: roll
      type(scratch_t), intent(inout) :: scratch
      type(table_contact_t) :: contact
      real(wp) :: before

      before = squared_length(v) + inertia_factor*omega_r*omega_r
      call update_touch(ground_data%table, ground, ratio, result%boulder, result%soil, scene%gravity, &
                        landing%jump_height, scratch%touch)
      call table_contact(scene%dem, scene%gravity, ground_data%table, result%boulder, inertia_of(scene, number), &
                         u, landing, v, flight%heading, omega_r, scratch%touch, roll, contact)
      call count_outcome(rebound_t(contact%v_out, forced=contact%limited), scratch%touch%beyond, &
                         contact%fast, .false., result)
      call count_ground(ground, scratch)
      if (scene%histograms_requested) call count_rebound(scratch%histograms, contact%v_in, contact%v_out)
      flight%v = roll%v
      flight%heading = roll%heading
      omega_r = roll%w
      if (level >= with_all) then
         call record_vertex(scratch%record, vertex_t(landing%x, landing%y, landing%z, result%time, flight%v, &
                                                     contact%v_in, contact%v_out, ratio))
         ! neither velocity includes V_n of a rolling boulder, because its next contact restores it
         call add_ground_loss(before, squared_length(flight%v), inertia_factor*omega_r*omega_r, result)
      end if
      call close_impact(scene, squared_length(flight%v), .not. contact%stops, result)
      if (contact%stops) then
         scratch%touch = touch_t()
         call rest_or_roll(scene, ground, landing, squared_length(flight%v), omega_r, result, roll)
      end if
   end subroutine handle_table_contact

   !> Find the ground of a raster cell, its rock radius and obstacle height, and whether it absorbs the boulder.
   pure subroutine find_ground(scene, u_obstacle, shape, cell, level, ground, radius, obstacle, status)
      type(scene_t), intent(in) :: scene
      real(wp), intent(in) :: u_obstacle    !! uniform in (0, 1), selects the obstacle size of method A [-]
      integer, intent(in) :: shape          !! shape of the boulder, as in boulder_result_t
      integer, intent(in) :: cell(2)        !! column, row from the north
      integer, value :: level               !! basic, ..., with_all
      integer, intent(out) :: ground        !! index of the ground; 0 if the scene has only the case's impact sets
      real(wp), intent(out) :: radius       !! R_m of the rocks; positive if the scene has several grounds [m]
      real(wp), intent(out) :: obstacle     !! obstacle height, if the scene has several grounds [m]
      integer, intent(inout) :: status

      radius = rock_radius(scene%surface, cell, u_obstacle)
      ground = 0
      obstacle = 0
      if (radius > huge(radius)) then
         status = absorbed
      else if (level >= with_all .and. allocated(scene%grounds)) then
         ground = ground_at(scene%surface, cell)
         if (allocated(scene%shapes)) ground = ground_of_shape(scene%shapes, ground, shape)
         obstacle = radius/scene%surface%size_to_radius
         if (absorbs(scene%grounds(ground)%classical, obstacle)) status = absorbed
         radius = max(radius, rockless_radius)
      end if
   end subroutine find_ground

   !> Choose the impact set for a ratio R_b/R_m.
   pure subroutine find_impact_set(scene, ratio, u_ratio, set, outside)
      type(scene_t), intent(in) :: scene
      real(wp), intent(in) :: ratio, u_ratio  !! R_b/R_m; uniform in (0, 1), selects between two sets [-]
      integer, intent(out) :: set
      logical, intent(out) :: outside  !! R_b/R_m is outside the calibrated ratios

      call find_nearest_set(ratio, set, outside)
      if (scene%between_ratios) set = interpolated_set(ratio, u_ratio)
   end subroutine find_impact_set

   !> Check whether a rebound is outside the fitted range of its impact set; classical models have no range or ratio.
   pure subroutine check_fit_range(ground, set, v_in, outside, fast, steep, ratio)
      type(ground_t), intent(in) :: ground
      integer, intent(in) :: set
      real(wp), intent(in) :: v_in(3)      !! V_t, V_n, W [m/s]
      logical, intent(inout) :: outside    !! R_b/R_m is outside the calibrated ratios
      real(wp), intent(out) :: fast, steep !! 1 if the speed, and 1 if the angle, is outside; else 0
      real(wp), intent(inout) :: ratio     !! R_b/R_m; -1 for a classical model [-]

      fast = 0
      steep = 0
      if (is_stochastic(ground)) then
         call beyond_fit(ground%sets(set)%fitted, v_in(1), v_in(2), fast, steep)
      else
         outside = .false.
         ratio = -1
      end if
   end subroutine check_fit_range

   !> Finish an impact: end a boulder that would fly on after its maximum number of contacts.
   pure subroutine close_impact(scene, speed2, flies, result)
      type(scene_t), intent(in) :: scene
      real(wp), intent(in) :: speed2  !! |v|**2 after the impact [m2/s2]
      logical, intent(in) :: flies    !! the boulder neither rests nor rolls
      type(boulder_result_t), intent(inout) :: result

      result%speed_max = max(result%speed_max, speed2)
      if (flies .and. result%impacts >= scene%max_impacts) result%status = impact_limit
   end subroutine close_impact

   !> Decide whether a boulder that is too slow to fly rests or rolls.
   pure subroutine rest_or_roll(scene, ground, landing, speed2, omega_r, result, roll)
      type(scene_t), intent(in) :: scene
      integer, intent(in) :: ground    !! index of the ground; ignored if the scene has only the case's impact sets
      type(landing_t), intent(in) :: landing
      real(wp), intent(in) :: speed2   !! |v|**2 [m2/s2]
      real(wp), intent(in) :: omega_r  !! W [m/s]
      type(boulder_result_t), intent(inout) :: result
      type(roll_t), intent(inout) :: roll
      real(wp) :: rest_slope

      rest_slope = scene%rest_slope
      if (ground > 0 .and. allocated(scene%grounds)) rest_slope = scene%grounds(ground)%rest_slope
      call find_roll(scene%dem, scene%gravity, rest_slope, result%boulder%radius, landing, speed2, omega_r, roll)
      if (.not. roll%rolls) then
         result%status = stopped
      else if (result%impacts >= scene%max_impacts) then
         result%status = impact_limit
      end if
   end subroutine rest_or_roll
end module rockfall_contact
