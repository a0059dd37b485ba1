! SPDX-License-Identifier: BSD-3-Clause
!> Boulders in lanes: a thread advances a pool of boulders from contact to contact. Loops over all landed boulders
!> perform the operations they have in common; then these boulders take off again. Each boulder undergoes the operations
!> of `trace` in the same order, so results are bitwise identical.
!>
!> Compiled three times: for any processor; as the module rockfall_wide_lanes for AVX2; as rockfall_masked_lanes for
!> AVX-512, where conditions become masks. Conditions in loops are numbers, 1 or 0, so that they vectorise.
module rockfall_lanes
   use, intrinsic :: iso_c_binding, only: c_int, c_int64_t, c_double, c_float
   use rockfall_kinds, only: wp, i8
   use rockfall_math, only: squared_length
   use rockfall_threads, only: take_batch, batch
   use rockfall_random, only: for_impact, for_ground, last_counter, words_per_block, turn_word, obstacle_word, &
                              ratio_word, uniform, side_of
   use rockfall_terrain, only: terrain_t, patch_t, slope_at, steepness_of, nearest_node, is_within, horn, is_pit
   use rockfall_boulder, only: inertia_factor
   use rockfall_flight, only: flight_t, landing_t, span_t, parabola_length
   use rockfall_rolling, only: roll_t, touch_t
   use rockfall_flights, only: flights_t, landings_t, take_off, take_off_again, fly_to_landings, flight_of, &
                               landing_of, take_off_from, replace_landing, lanes, width, padded
   use rockfall_impact, only: impact_set_t, impact_ratios, rebound_t, draw_rebound, redraw_rebound, admissible, &
                              energy_of, beyond_fit, max_draws
   use rockfall_direction, only: to_aspect, turn_by_class, divide_by_length, shortest
   use rockfall_table_lanes, only: table_batch_t, clear_batch, add_contact, handle_table_contacts, find_paths_near_lines
   use rockfall_table_contact, only: velocity_after
   use rockfall_impact_table, only: prefetch_record
   use rockfall_forest, only: forest_t, may_hit_tree
   use rockfall_scene_type, only: scene_t, has_obstacles, needs_energies, inertia_of, is_slow
   use rockfall_outcome, only: boulder_result_t, departure_status, add_flight, count_outcome, add_ground_loss, &
                               close_energy_balance, absorbed
   use rockfall_crossings, only: crossings_t, record_crossings, keep_crossings
   use rockfall_scratch, only: scratch_t, with_all, clear_scratch, count_ground
   use rockfall_start, only: start_boulder, energy_head, end_boulder
   use rockfall_contact, only: handle_impact, find_ground, find_impact_set, close_impact, rest_or_roll
   use rockfall_obstacles, only: obstacle_t, hit_obstacle, record_passed_over, none
   use rockfall_paths, only: fly_to_obstacle, follow_roll, visit_cells
   use rockfall_local_frame, only: in_local_frame, signed_w, face_forward, launch_velocity
   use rockfall_ground, only: is_stochastic
   use rockfall_tallies, only: totals_t, prepare_scratch, add_boulder
   use rockfall_maps, only: maps_t, needs_visits, take_back_path
   use rockfall_travel_maps, only: time_visits
   use rockfall_hit_maps, only: record_path
   use rockfall_histogram, only: count_rebound
   implicit none
   private
   public :: run_in_lanes, impact_numbers, read_squares

   integer, parameter :: lanes_with_visits = 64
   !> Number of inadmissible draws below which single redraws are faster than a loop.
   integer, parameter :: few = 2
   integer, parameter :: slots = lanes*width  !! capacity for draws; each impact set starts a new vector
   integer, parameter :: counters = 4  !! counters used in turn for the draws of a set

   !> Boulders of a thread; a boulder stays in its lane until it ends.
   type :: pool_t
      integer :: index(lanes) = 0                       !! index in the results
      integer(i8) :: number(lanes) = 0
      real(wp) :: heading1(lanes) = 0, heading2(lanes) = 0  !! heading after the last rebound [-]
      real(wp) :: w(lanes) = 0                          !! W = R_b omega [m/s]
      real(wp) :: v(3, lanes) = 0                       !! velocity of a boulder that has ended [m/s]
      type(touch_t) :: touch(lanes)                     !! state on ground with a table (not in scratch_t)
      integer :: free(lanes) = 0, n_free = 0            !! lanes without a boulder
      integer :: from = 1, to = 0                       !! range of assigned boulders not yet started
   end type pool_t

   !> All impact sets of a scene, ground by ground.
   type :: set_list_t
      type(impact_set_t), allocatable :: set(:)
      integer, allocatable :: offset(:)  !! number of sets of the grounds before each ground; -1 if a ground has none
   end type set_list_t

   !> Contacts of the landed boulders, in order of landing.
   type :: contacts_t
      integer :: set(lanes)                                      !! impact set; a number past the last: no set
      integer :: ground(lanes)                                   !! index of the ground, if the scene has several
      logical :: obstructed(lanes) = .false.                     !! the flight ended at an obstacle, not on the ground
      logical :: outside(lanes)                                  !! R_b/R_m is outside the calibrated range
      integer(i8), dimension(lanes) :: number = 0, impact = 0
      real(wp), dimension(lanes) :: length = 0                   !! length of the flight [m]
      real(wp), dimension(lanes) :: speed2_in = 0, speed2 = 0    !! |v|**2 after this flight, before the next [m2/s2]
      integer :: draws(lanes)
      logical :: forced(lanes)
      real(wp), dimension(lanes) :: fast = 0, steep = 0          !! outside the fitted range of speed, of angle: 1 or 0
      real(wp), dimension(lanes) :: w = 0, next_w = 0            !! W = R_b omega before the contact, after it [m/s]
      real(wp), dimension(lanes) :: heading1 = 0, heading2 = 0   !! unit heading [-]
      real(wp), dimension(lanes) :: g1 = 0, g2 = 0, steepness = 0  !! gradient and steepness of the patch [-]
      real(wp), dimension(lanes) :: tangential = 0, normal = 0   !! V_t, V_n before the contact [m/s]
      real(wp), dimension(lanes) :: out1 = 0, out2 = 0, out3 = 0 !! V_t, V_n, W after the contact [m/s]
      real(wp), dimension(lanes) :: v1 = 0, v2 = 0, v3 = 0       !! velocity of the next flight [m/s]
      real(wp), dimension(lanes) :: rate = 0                     !! rate of change of the next flight's height [m/s]
      real(wp), dimension(lanes) :: in_loops = 0                 !! 1 if handled by the vectorised loops, else 0
      real(wp), dimension(lanes) :: z1 = 0, z2 = 0, z3 = 0, u = 0, side = 0  !! random numbers [-]
      real(wp), dimension(lanes) :: ratio = 0                    !! R_b/R_m [-]
      integer(i8) :: word(lanes, words_per_block) = 0            !! random words
      real(wp), dimension(lanes) :: column = 0, row = 0          !! raster cell, row from the north [-]
      real(wp), dimension(lanes) :: complete = 0                 !! 1 if all neighbours exist, else 0
      real(wp), dimension(lanes) :: at = 1                       !! index of the north-western neighbour
      real(wp), dimension(lanes, 9) :: z = 0                     !! elevations of the cell and its neighbours [m]
   end type contacts_t

   !> Draws of V_out, sorted by impact set.
   type :: draws_t
      integer :: contact(slots) = 0                              !! contact of each draw
      real(wp), dimension(slots) :: tangential = 0, normal = 0, w = 0  !! V_t, V_n, W before the contact [m/s]
      real(wp), dimension(slots) :: z1 = 0, z2 = 0, z3 = 0       !! standard normal numbers [-]
      real(wp), dimension(slots) :: out1 = 0, out2 = 0, out3 = 0 !! V_t, V_n, W after the contact [m/s]
      real(wp), dimension(slots) :: admissible = 0               !! 1 if the draw is admissible, else 0
      real(wp), dimension(slots) :: fast = 0, steep = 0          !! outside the fitted range of speed, of angle: 1 or 0
   end type draws_t

   interface
      !> Random words of n impacts, and standard normal numbers of the first three words, in vectorised loops.
      subroutine impact_numbers(round_keys, coefficients, with_normals, n, number, impact, last, word1, word2, word3, &
                                word4, z1, z2, z3) bind(c, name="rockfall_impact_numbers")
         import :: c_int, c_int64_t, c_double
         integer(c_int64_t), intent(in) :: round_keys(2, *)   !! as in random_key_t
         real(c_double), intent(in) :: coefficients(6, *)     !! as in normal_table_t
         integer(c_int), value :: with_normals                    !! 1 to compute normal numbers, else 0
         integer(c_int), value :: n
         integer(c_int64_t), intent(in) :: number(*), impact(*)  !! numbers, padded to a multiple of `width`
         integer(c_int64_t), value :: last                       !! as returned by last_counter
         integer(c_int64_t), intent(inout) :: word1(*), word2(*), word3(*), word4(*)
         real(c_double), intent(inout) :: z1(*), z2(*), z3(*)    !! [-]
      end subroutine impact_numbers

      !> Read n squares of 3 x 3 cells in vectorised loops.
      subroutine read_squares(n, at, columns, elevation, lanes, z) bind(c, name="rockfall_read_squares")
         import :: c_int, c_int64_t, c_double, c_float
         integer(c_int), value :: n
         real(c_double), intent(in) :: at(*)      !! index of each north-western cell, padded to a multiple of `width`
         integer(c_int64_t), value :: columns     !! columns of the raster
         real(c_float), intent(in) :: elevation(*)     !! [m]
         integer(c_int64_t), value :: lanes
         real(c_double), intent(inout) :: z(lanes, *)  !! row by row, from the north-west [m]
      end subroutine read_squares
   end interface

contains

   !> Run one thread's share of the boulders, in batches from the shared counter `next`.
   subroutine run_in_lanes(scene, first, step, results, crossings, maps, next, deadline, totals)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: first, step              !! number of the first boulder; step to the next
      type(boulder_result_t), intent(inout) :: results(:)
      type(crossings_t), intent(inout) :: crossings(:)
      type(maps_t), intent(in) :: maps                    !! maps that do not count sources
      integer, intent(inout) :: next                      !! index of the next boulder
      integer(i8), intent(in) :: deadline                 !! time after which no more boulders start [ticks]
      type(totals_t), intent(inout) :: totals
      type(pool_t) :: pool
      type(boulder_result_t), allocatable :: active(:)    !! results so far, by lane
      type(scratch_t), allocatable :: scratch(:)          !! work space of each lane
      type(flights_t) :: flights
      type(landings_t) :: landings
      type(contacts_t) :: contacts
      type(draws_t) :: draws
      type(table_batch_t), allocatable :: by_table
      type(set_list_t) :: sets
      type(span_t), allocatable :: spans(:)
      integer :: k

      allocate (active(lanes))  ! a thread's stack may be only 512 kB (rockfall_threads)
      sets = all_sets(scene)
      pool%n_free = lanes_of_run(maps)
      if (has_obstacles(scene)) allocate (flights%start(pool%n_free), spans(scene%dem%nx + scene%dem%ny))
      flights%refill_below = pool%n_free*3/16
      allocate (scratch(pool%n_free))
      do k = 1, pool%n_free
         call prepare_scratch(scene, maps, scratch(k))
         pool%free(k) = k
      end do
      if (scene%has_tables) allocate (by_table)
      do
         call refill(scene, first, step, results, next, deadline, pool, active, scratch, flights)
         if (flights%n == 0) exit
         call fly_to_landings(scene%dem, scene%gravity, pool%w, flights, landings, scratch)
         if (has_obstacles(scene)) then
            call meet_obstacles(scene, active, pool, landings, flights, scratch, spans, contacts)
         else if (allocated(scene%lines)) then
            call record_line_crossings(scene, active, pool, landings, scratch)
         end if
         call find_cells(scene%dem, landings, contacts)
         if (size(sets%set) > 0) call read_elevations(scene%dem, landings%n, contacts)
         call classify_contacts(scene, sets, active, pool, landings, scratch, contacts, by_table)
         if (size(sets%set) > 0) then
            call compute_incidence(landings, scene%gravity, scene%dem%per_cell, .true., contacts)
         else
            call compute_incidence(landings, scene%gravity, scene%dem%per_cell, .false., contacts)
         end if
         call draw_random_numbers(scene, size(sets%set) > 0, landings%n, contacts)
         if (size(sets%set) > 0) then
            call draw_rebounds(scene, sets, landings%n, contacts, draws)
            if (scene%turning == to_aspect) then
               call turn_and_launch(landings%n, scene%dem%per_cell, 1.0_wp, contacts)
            else
               call turn_and_launch(landings%n, scene%dem%per_cell, 0.0_wp, contacts)
            end if
         end if
         if (allocated(by_table)) then
            call handle_table_contacts(scene, landings, contacts%g1, contacts%g2, contacts%steepness, contacts%word, &
                                       needs_energies(scene), pool%touch, by_table)
         end if
         call advance_boulders(scene, sets, active, pool, landings, contacts, by_table, flights, scratch)
         call retire_boulders(scene, active, results, crossings, maps, landings, pool, scratch, totals)
      end do
   end subroutine run_in_lanes

   !> Number of lanes: fewer if maps need the visited cells, so that these fit in the cache.
   pure integer function lanes_of_run(maps) result(n)
      type(maps_t), intent(in) :: maps

      n = merge(lanes_with_visits, lanes, needs_visits(maps))
   end function lanes_of_run

   !> Collect the impact sets of a scene, from the case or from its grounds.
   pure type(set_list_t) function all_sets(scene) result(sets)
      type(scene_t), intent(in) :: scene
      integer :: ground, n

      if (.not. allocated(scene%grounds)) then
         sets%set = scene%sets
         sets%offset = [0]
         return
      end if
      allocate (sets%offset(size(scene%grounds)), source=-1)
      n = 0
      do ground = 1, size(scene%grounds)
         if (.not. is_stochastic(scene%grounds(ground))) cycle
         sets%offset(ground) = n
         n = n + impact_ratios
      end do
      allocate (sets%set(n))
      do ground = 1, size(scene%grounds)
         n = sets%offset(ground)
         if (n >= 0) sets%set(n + 1:n + impact_ratios) = scene%grounds(ground)%sets
      end do
   end function all_sets

   !> Fill the free lanes with the next boulders.
   subroutine refill(scene, first, step, results, next, deadline, pool, active, scratch, flights)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: first, step
      type(boulder_result_t), intent(inout) :: results(:)
      integer, intent(inout) :: next
      integer(i8), intent(in) :: deadline
      type(pool_t), intent(inout) :: pool
      type(boulder_result_t), intent(inout) :: active(lanes)
      type(scratch_t), intent(inout) :: scratch(:)
      type(flights_t), intent(inout) :: flights
      type(flight_t) :: flight
      integer :: lane

      do while (pool%n_free > 0)
         if (pool%from > pool%to) then
            call take_batch(next, size(results), batch, deadline, pool%from, pool%to)
            if (pool%from > pool%to) return
         end if
         lane = pool%free(pool%n_free)
         pool%index(lane) = pool%from
         pool%from = pool%from + 1
         pool%number(lane) = first + (pool%index(lane) - 1)*step
         associate (result => results(pool%index(lane)))
            call start_boulder(scene, pool%number(lane), with_all, result, flight)
            if (result%status /= 0) cycle
            if (needs_energies(scene)) result%energy%released = energy_head(scene%gravity, result%boulder, flight)
            active(lane) = result
         end associate
         call clear_scratch(scene, with_all, scratch(lane))
         call set_heading(pool, lane, flight%heading(1), flight%heading(2), 0.0_wp)
         pool%touch(lane) = touch_t()
         call take_off(flights, lane, flight)
         pool%n_free = pool%n_free - 1
      end do
   end subroutine refill

   !> Set heading and rotation of a boulder.
   subroutine set_heading(pool, lane, heading1, heading2, w)
      type(pool_t), intent(inout) :: pool
      integer, intent(in) :: lane
      real(wp), intent(in) :: heading1, heading2  !! [-]
      real(wp), intent(in) :: w                   !! [m/s]

      pool%heading1(lane) = heading1
      pool%heading2(lane) = heading2
      pool%w(lane) = w
   end subroutine set_heading

   !> Find the flights that meet an obstacle before the ground, and compute the hits. Flights that may hit an obstacle
   !> or cross a line are computed again one by one.
   subroutine meet_obstacles(scene, active, pool, l, flights, scratch, spans, c)
      type(scene_t), intent(in) :: scene
      type(boulder_result_t), intent(inout) :: active(lanes)
      type(pool_t), intent(inout) :: pool
      type(landings_t), intent(inout) :: l
      type(flights_t), intent(inout) :: flights
      type(scratch_t), intent(inout) :: scratch(:)
      type(span_t), intent(inout), contiguous :: spans(:)
      type(contacts_t), intent(inout) :: c
      type(flight_t) :: flight
      type(landing_t) :: landing
      type(obstacle_t) :: obstacle
      real(wp) :: near(lanes)
      integer :: k, lane

      near = 0
      if (allocated(scene%lines)) call find_paths_near_lines(scene, l%n, l%x0, l%y0, l%x, l%y, near)
      if (allocated(scene%forest)) call find_paths_to_trees(scene%forest, active, l, near)
      do k = 1, l%n
         c%obstructed(k) = .false.
         if (.not. near(k) > 0) cycle
         lane = l%lane(k)
         flight = flights%start(lane)
         flight%heading = [pool%heading1(lane), pool%heading2(lane)]
         if (scratch(lane)%cells_requested) call take_back_path(scratch(lane)%visits)
         associate (result => active(lane))
            call fly_to_obstacle(scene, result, flight, pool%w(lane), landing, obstacle, scratch(lane), spans)
            if (obstacle%kind == none) cycle
            c%obstructed(k) = .true.
            call hit_single(scene, pool%number(lane), obstacle, landing, &
                            [flight%v(1), flight%v(2), flight%v(3) - scene%gravity*landing%time], l, k, pool, result, &
                            flight, flights, scratch(lane))
         end associate
      end do
   end subroutine meet_obstacles

   !> Mark the flights that may hit a tree.
   subroutine find_paths_to_trees(forest, active, l, near)
      type(forest_t), intent(in) :: forest
      type(boulder_result_t), intent(in) :: active(lanes)
      type(landings_t), intent(in) :: l
      real(wp), intent(inout) :: near(lanes)  !! set to 1 for these flights
      integer :: k

      do k = 1, l%n
         if (may_hit_tree(forest, l%x0(k), l%y0(k), l%time(k)*[l%v1(k), l%v2(k)], &
                          active(l%lane(k))%boulder%radius)) near(k) = 1
      end do
   end subroutine find_paths_to_trees

   !> Compute the hit of an obstacle, and continue the flight from there.
   subroutine hit_single(scene, number, obstacle, landing, v, l, k, pool, result, flight, flights, scratch)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: number
      type(obstacle_t), intent(in) :: obstacle
      type(landing_t), intent(in) :: landing   !! point of the hit
      real(wp), intent(in) :: v(3)             !! velocity at that point [m/s]
      type(landings_t), intent(inout) :: l
      integer, intent(in) :: k
      type(pool_t), intent(inout) :: pool
      type(boulder_result_t), intent(inout) :: result
      type(flight_t), intent(inout) :: flight  !! next flight, including its heading
      type(flights_t), intent(inout) :: flights
      type(scratch_t), intent(inout) :: scratch
      integer :: lane

      lane = l%lane(k)
      call replace_landing(l, k, landing)
      call hit_obstacle(scene, number, obstacle, landing, v, pool%w(lane), result, flight, scratch)
      call set_heading(pool, lane, flight%heading(1), flight%heading(2), pool%w(lane))
      pool%v(:, lane) = flight%v
      if (result%status == 0) call take_off(flights, lane, flight)
   end subroutine hit_single

   !> Record the line crossings of the landed boulders.
   subroutine record_line_crossings(scene, active, pool, l, scratch)
      type(scene_t), intent(in) :: scene
      type(boulder_result_t), intent(in) :: active(lanes)
      type(pool_t), intent(in) :: pool
      type(landings_t), intent(in) :: l
      type(scratch_t), intent(inout) :: scratch(:)
      real(wp) :: near(lanes)
      integer :: k, lane

      call find_paths_near_lines(scene, l%n, l%x0, l%y0, l%x, l%y, near)
      do k = 1, l%n
         if (.not. near(k) > 0) cycle
         lane = l%lane(k)
         call record_crossings(scene, scene%gravity, active(lane), flight_of(l, k), landing_of(l, k), &
                               pool%w(lane), scratch(lane)%crossings)
      end do
   end subroutine record_line_crossings

   !> Find the raster cells in which the flights end.
   subroutine find_cells(dem, l, c)
      type(terrain_t), intent(in) :: dem
      type(landings_t), intent(in) :: l
      type(contacts_t), intent(inout) :: c
      real(wp) :: nx, ny, column, row
      integer :: k

      nx = dem%nx
      ny = dem%ny
      !$omp simd private(column, row)
      do k = 1, padded(l%n)
         column = nearest_node(l%i(k), l%u(k))
         row = ny + 1 - nearest_node(l%j(k), l%w(k))
         c%complete(k) = merge(is_within(column, row, nx, ny), 0.0_wp, l%contact(k) > 0)
         c%column(k) = column
         c%row(k) = row
      end do
   end subroutine find_cells

   !> Read the elevations of the cells and their neighbours. If neighbours are missing, the elevations of other cells
   !> are read, which avoids branches.
   subroutine read_elevations(dem, n, c)
      type(terrain_t), intent(in) :: dem
      integer, intent(in) :: n
      type(contacts_t), intent(inout) :: c
      real(wp), pointer, contiguous :: z8(:)
      real(wp) :: first(2), columns, column, row
      integer :: across(2), k, m

      if (associated(dem%z8)) then
         across = shape(dem%z8)
         first = lbound(dem%z8)
      else
         across = shape(dem%z4)
         first = lbound(dem%z4)
      end if
      if (any(across < 3)) return  ! raster too small: no neighbourhood is complete
      columns = across(1)
      !$omp simd private(column, row)
      do k = 1, padded(n)
         column = merge(c%column(k) - 1, first(1), c%complete(k) > 0)
         row = merge(c%row(k) - 1, first(2), c%complete(k) > 0)
         c%at(k) = 1 + (column - first(1)) + (row - first(2))*columns
      end do
      if (.not. associated(dem%z8)) then
         call read_squares(padded(n), c%at, int(across(1), i8), dem%z4, int(lanes, i8), c%z)
         return
      end if
      z8(1:size(dem%z8, kind=i8)) => dem%z8
      do m = 1, 9
         do k = 1, n
            c%z(k, m) = z8(int(c%at(k), i8) + (m - 1)/3*across(1) + mod(m - 1, 3))
         end do
      end do
   end subroutine read_elevations

   !> Look up the ground at each landing, and collect the contacts on ground with impact tables.
   subroutine classify_contacts(scene, sets, active, pool, l, scratch, c, by_table)
      type(scene_t), intent(in) :: scene
      type(set_list_t), intent(in) :: sets
      type(boulder_result_t), intent(inout) :: active(lanes)
      type(pool_t), intent(inout) :: pool
      type(landings_t), intent(in) :: l
      type(scratch_t), intent(inout) :: scratch(:)
      type(contacts_t), intent(inout) :: c
      type(table_batch_t), intent(inout), allocatable :: by_table
      type(patch_t) :: patch
      real(wp) :: radius, obstacle
      integer :: cell(2), k, lane, set
      logical :: timed

      if (allocated(by_table)) call clear_batch(by_table)
      timed = allocated(scratch(1)%visits%time)
      do k = 1, l%n
         c%number(k) = pool%number(l%lane(k))
         c%impact(k) = active(l%lane(k))%impacts + 1
      end do
      if (scene%ground_drawn) &
         call impact_numbers(scene%key%round, scene%table%c, 0, l%n, c%number, c%impact, &
                             last_counter(for_ground, 0_i8), c%word(:, 1), c%word(:, 2), c%word(:, 3), c%word(:, 4), &
                             c%z1, c%z2, c%z3)
      do k = 1, l%n
         lane = l%lane(k)
         c%ground(k) = 1
         c%set(k) = size(sets%set) + 1
         c%w(k) = pool%w(lane)
         c%heading1(k) = pool%heading1(lane)
         c%heading2(k) = pool%heading2(lane)
         if (c%obstructed(k)) cycle
         associate (result => active(lane))
            if (timed) &
               call time_visits(scratch(lane)%visits, scene%dem, [l%x0(k), l%y0(k)], [l%v1(k), l%v2(k)], result%time, &
                                l%time(k))
            if (scratch(lane)%hits_requested) &
               call record_path(scratch(lane)%paths, scene%gravity, flight_of(l, k), l%time(k), &
                                inertia_factor*pool%w(lane)**2)
            if (.not. l%contact(k) > 0) then
               patch%i = int(l%i(k))
               patch%j = int(l%j(k))
               result%status = departure_status(scene%dem, patch)
               cycle
            end if
            result%impacts = result%impacts + 1
            cell = [int(c%column(k)), int(c%row(k))]
            call find_ground(scene, uniform(c%word(k, obstacle_word)), result%block_shape, cell, with_all, &
                             c%ground(k), radius, obstacle, result%status)
            c%ground(k) = max(1, c%ground(k))
            if (result%status == absorbed) cycle
            c%ratio(k) = result%boulder%radius/radius*result%soil%ratio_factor
            if (sets%offset(c%ground(k)) < 0) then
               if (allocated(scene%grounds(c%ground(k))%table)) &
                  call add_contact(by_table, k, scene%grounds(c%ground(k))%table, c%ground(k), result%boulder, &
                                   result%soil, scene%gravity, inertia_of(scene, c%number(k)), c%ratio(k), &
                                   l%jump_height(k), c%w(k), c%heading1(k), c%heading2(k), pool%touch(lane))
               cycle
            end if
            call find_impact_set(scene, c%ratio(k), uniform(c%word(k, ratio_word)), set, c%outside(k))
            c%set(k) = sets%offset(c%ground(k)) + set
            ! at the edge of the raster: a flat neighbourhood, which scalar code handles
            if (.not. c%complete(k) > 0) c%z(k, :) = 0
         end associate
      end do
   end subroutine classify_contacts

   !> Find the slopes where the flights end and, if `frames`, transform the velocities to the local frames. `frames` is
   !> a compile-time constant at each call.
   subroutine compute_incidence(l, gravity, per_cell, frames, c)
      type(landings_t), intent(in) :: l
      real(wp), intent(in) :: gravity, per_cell  !! [m/s2], [1/m]
      logical, value :: frames                   !! local frames are needed, for impact sets
      type(contacts_t), intent(inout) :: c
      real(wp) :: v3, plan1, plan2, unit1, unit2, length
      integer :: k

      !$omp simd private(v3, plan1, plan2, unit1, unit2, length)
      do k = 1, padded(l%n)
         c%length(k) = parabola_length(l%v1(k)*l%v1(k) + l%v2(k)*l%v2(k), l%v3(k), gravity, l%time(k))
         v3 = l%v3(k) - gravity*l%time(k)
         c%speed2_in(k) = l%v1(k)*l%v1(k) + l%v2(k)*l%v2(k) + v3*v3
         c%g1(k) = slope_at(l%a(k), l%c(k), l%w(k), per_cell)
         c%g2(k) = slope_at(l%b(k), l%c(k), l%u(k), per_cell)
         c%steepness(k) = steepness_of(c%g1(k), c%g2(k))
         if (.not. frames) cycle
         call in_local_frame(l%v1(k), l%v2(k), v3, c%g1(k), c%g2(k), c%steepness(k), &
                             c%tangential(k), c%normal(k), plan1, plan2)
         call divide_by_length(plan1, plan2, unit1, unit2, length)
         c%w(k) = signed_w(c%w(k), c%heading1(k), c%heading2(k), unit1, unit2)
         c%heading1(k) = unit1
         c%heading2(k) = unit2
         c%in_loops(k) = merge(1.0_wp, 0.0_wp, length > shortest)
      end do
   end subroutine compute_incidence

   !> Draw the random numbers of the contacts.
   subroutine draw_random_numbers(scene, rebounds, n, c)
      type(scene_t), intent(in) :: scene
      logical, intent(in) :: rebounds  !! include the numbers for rebounds by impact sets
      integer, intent(in) :: n
      type(contacts_t), intent(inout) :: c
      integer :: k

      call impact_numbers(scene%key%round, scene%table%c, merge(1, 0, rebounds), n, c%number, c%impact, &
                          last_counter(for_impact, 0_i8), c%word(:, 1), c%word(:, 2), c%word(:, 3), c%word(:, 4), &
                          c%z1, c%z2, c%z3)
      if (.not. rebounds) return
      !$omp simd
      do k = 1, padded(n)
         c%u(k) = uniform(c%word(k, turn_word))
         c%side(k) = side_of(c%word(k, turn_word))
      end do
   end subroutine draw_random_numbers

   !> Draw the velocities after the contacts, by impact set.
   subroutine draw_rebounds(scene, sets, n, c, d)
      type(scene_t), intent(in) :: scene
      type(set_list_t), intent(in) :: sets
      integer, intent(in) :: n
      type(contacts_t), intent(inout) :: c
      type(draws_t), intent(inout) :: d
      integer, dimension(size(sets%set) + 1) :: first, left  !! first draw, and remaining number of draws, of each set
      integer :: set, draw, m

      call group_by_set(n, c, first, left, d)
      do set = 1, size(sets%set)
         do draw = 1, max_draws
            if (left(set) < merge(few, 1, draw > 1)) exit
            if (draw > 1) call draw_other_numbers(scene, draw, first(set), left(set), c, d)
            call draw_set_rebounds(sets%set(set), d, first(set), left(set))
            call keep_inadmissible(draw, first(set), c, d, left(set))
         end do
         do m = first(set), first(set) + left(set) - 1
            call redraw_single(scene, sets, d%contact(m), c)
         end do
      end do
   end subroutine draw_rebounds

   !> Sort the draws by impact set; the draws of each set fill separate vectors. Adjacent contacts mostly belong to the
   !> same set, so several `counters` are used in turn: increments of a single counter would wait for each other.
   subroutine group_by_set(n, c, first, number, d)
      integer, intent(in) :: n
      type(contacts_t), intent(in) :: c
      integer, intent(out) :: first(:), number(:)  !! indices and numbers by set; last element: no set
      type(draws_t), intent(inout) :: d
      integer, dimension(counters, size(first)) :: counted, slot
      integer :: counter, set, k, m

      counted = 0
      do k = 1, n
         counter = 1 + mod(k, counters)
         counted(counter, c%set(k)) = counted(counter, c%set(k)) + 1
      end do
      m = 1
      do set = 1, size(first)
         first(set) = m
         number(set) = sum(counted(:, set))
         do counter = 1, counters
            slot(counter, set) = m
            m = m + counted(counter, set)
         end do
         m = first(set) + padded(number(set))
      end do
      do k = 1, n
         counter = 1 + mod(k, counters)
         m = slot(counter, c%set(k))
         slot(counter, c%set(k)) = m + 1
         d%contact(m) = k
         d%tangential(m) = c%tangential(k)
         d%normal(m) = c%normal(k)
         d%w(m) = c%w(k)
         d%z1(m) = c%z1(k)
         d%z2(m) = c%z2(k)
         d%z3(m) = c%z3(k)
      end do
   end subroutine group_by_set

   !> Draw new random numbers for inadmissible draws.
   subroutine draw_other_numbers(scene, draw, first, n, c, d)
      type(scene_t), intent(in) :: scene
      integer, intent(in) :: draw      !! number of the draw: 2, 3, ...
      integer, intent(in) :: first, n  !! first draw; number of draws
      type(contacts_t), intent(in) :: c
      type(draws_t), intent(inout) :: d
      integer(i8), dimension(lanes) :: number, impact, w1, w2, w3, w4
      integer :: m

      do m = 1, n
         number(m) = c%number(d%contact(first + m - 1))
         impact(m) = c%impact(d%contact(first + m - 1))
      end do
      number(n + 1:padded(n)) = 0
      impact(n + 1:padded(n)) = 0
      call impact_numbers(scene%key%round, scene%table%c, 1, n, number, impact, &
                          last_counter(for_impact, draw - 1_i8), w1, w2, w3, w4, &
                          d%z1(first:), d%z2(first:), d%z3(first:))
   end subroutine draw_other_numbers

   !> Store the admissible draws, and keep the inadmissible ones for redrawing.
   subroutine keep_inadmissible(draw, first, c, d, n)
      integer, intent(in) :: draw      !! number of the draw: 1, 2, ...
      integer, intent(in) :: first     !! first draw
      type(contacts_t), intent(inout) :: c
      type(draws_t), intent(inout) :: d
      integer, intent(inout) :: n      !! number of draws
      integer :: from(lanes + 1), n_kept, k, m, to

      n_kept = 0
      do m = first, first + n - 1  ! branchless, because the outcome is unpredictable
         k = d%contact(m)
         c%out1(k) = d%out1(m)
         c%out2(k) = d%out2(m)
         c%out3(k) = d%out3(m)
         c%fast(k) = d%fast(m)
         c%steep(k) = d%steep(m)
         c%draws(k) = draw
         c%forced(k) = .false.
         from(n_kept + 1) = m
         n_kept = n_kept + 1 - int(d%admissible(m))
      end do
      n = n_kept
      do k = 1, n
         m = from(k)
         to = first + k - 1
         d%contact(to) = d%contact(m)
         d%tangential(to) = d%tangential(m)
         d%normal(to) = d%normal(m)
         d%w(to) = d%w(m)
      end do
   end subroutine keep_inadmissible

   !> Compute n draws of one impact set.
   subroutine draw_set_rebounds(set, d, first, n)
      type(impact_set_t), intent(in) :: set
      type(draws_t), intent(inout) :: d
      integer, intent(in) :: first, n
      integer :: k

      !$omp simd
      do k = first, first + padded(n) - 1
         call draw_rebound(set, d%tangential(k), d%normal(k), d%w(k), d%z1(k), d%z2(k), d%z3(k), &
                           d%out1(k), d%out2(k), d%out3(k))
         d%admissible(k) = admissible(d%out1(k), d%out2(k), d%out3(k), &
                                      energy_of(d%tangential(k), d%normal(k), d%w(k)))
         call beyond_fit(set%fitted, d%tangential(k), d%normal(k), d%fast(k), d%steep(k))
      end do
   end subroutine draw_set_rebounds

   !> Continue to redraw a rebound that was not admissible.
   subroutine redraw_single(scene, sets, k, c)
      type(scene_t), intent(in) :: scene
      type(set_list_t), intent(in) :: sets
      integer, intent(in) :: k
      type(contacts_t), intent(inout) :: c
      type(rebound_t) :: out

      out = rebound_t([c%out1(k), c%out2(k), c%out3(k)], c%draws(k))
      call redraw_rebound(sets%set(c%set(k)), scene%table, scene%key, c%number(k), c%impact(k), &
                          [c%tangential(k), c%normal(k), c%w(k)], out)
      c%out1(k) = out%v(1)
      c%out2(k) = out%v(2)
      c%out3(k) = out%v(3)
      c%draws(k) = out%draws
      c%forced(k) = out%forced
   end subroutine redraw_single

   !> Compute the next flights. Scalar procedures handle flat cells, incomplete neighbourhoods and vertical impacts.
   !> `ends_there` is a compile-time constant at each call.
   subroutine turn_and_launch(n, per_cell, ends_there, c)
      integer, intent(in) :: n
      real(wp), intent(in) :: per_cell    !! [1/m]
      real(wp), intent(in) :: ends_there  !! as in turn_by_class
      type(contacts_t), intent(inout) :: c
      real(wp) :: d1, d2, a1, a2, h1, h2, lowest, length, before1, before2, w, u, side, in_loops, pit
      integer :: k

      !$omp simd private(d1, d2, a1, a2, h1, h2, lowest, length, before1, before2, w, u, side, in_loops, pit)
      do k = 1, padded(n)
         call horn(c%z(k, 1), c%z(k, 2), c%z(k, 3), c%z(k, 4), c%z(k, 6), c%z(k, 7), c%z(k, 8), c%z(k, 9), per_cell, &
                   d1, d2, lowest)
         call divide_by_length(d1, d2, a1, a2, length)
         in_loops = c%in_loops(k)
         c%in_loops(k) = merge(in_loops, 0.0_wp, length > shortest)
         before1 = c%heading1(k)
         before2 = c%heading2(k)
         w = c%out3(k)
         call face_forward(c%out1(k), before1, before2, w)
         c%next_w(k) = w
         u = c%u(k)
         side = c%side(k)
         pit = is_pit(c%z(k, 5), lowest)
         call turn_by_class(u, side, pit, ends_there, before1, before2, c%g1(k), c%g2(k), a1, a2, h1, h2)
         c%heading1(k) = h1
         c%heading2(k) = h2
         call launch_velocity(c%out1(k), c%out2(k), h1, h2, c%g1(k), c%g2(k), c%steepness(k), &
                              c%v1(k), c%v2(k), c%v3(k), c%rate(k))
         c%speed2(k) = c%v1(k)*c%v1(k) + c%v2(k)*c%v2(k) + c%v3(k)*c%v3(k)
      end do
   end subroutine turn_and_launch

   !> Advance each boulder from its contact to its next flight, or end it.
   subroutine advance_boulders(scene, sets, active, pool, l, c, by_table, flights, scratch)
      type(scene_t), intent(in) :: scene
      type(set_list_t), intent(in) :: sets
      type(boulder_result_t), intent(inout) :: active(lanes)
      type(pool_t), intent(inout) :: pool
      type(landings_t), intent(inout) :: l
      type(contacts_t), intent(in) :: c
      type(table_batch_t), intent(inout), allocatable :: by_table
      type(flights_t), intent(inout) :: flights
      type(scratch_t), intent(inout) :: scratch(:)
      type(flight_t) :: flight
      type(roll_t) :: roll
      logical :: slow, energies
      integer :: k, lane

      energies = needs_energies(scene)
      do k = 1, l%n
         lane = l%lane(k)
         associate (result => active(lane))
            call add_flight(c%length(k), l%time(k), c%speed2_in(k), l%jump_height(k), result)
            if (c%obstructed(k)) cycle
            if (result%status /= 0) then
               pool%v(:, lane) = [l%v1(k), l%v2(k), l%v3(k) - scene%gravity*l%time(k)]
               cycle
            end if
            if (allocated(by_table)) then
               if (by_table%by_table(k)) then
                  call finish_table_contact(scene, c%number(k), by_table, l, k, pool, result, flights, scratch(lane))
                  cycle
               end if
            end if
            if (c%set(k) > size(sets%set) .or. .not. c%in_loops(k) > 0) then
               call rebound_single(scene, c%number(k), l, k, pool, result, flights, scratch(lane))
               cycle
            end if
            if (allocated(by_table)) pool%touch(lane) = touch_t()
            call count_outcome(rebound_t([0.0_wp, 0.0_wp, 0.0_wp], c%draws(k), c%forced(k)), c%outside(k), &
                               c%fast(k) > 0, c%steep(k) > 0, result)
            if (allocated(scene%grounds)) call count_ground(c%ground(k), scratch(lane))
            if (scene%histograms_requested) &
               call count_rebound(scratch(lane)%histograms, [c%tangential(k), c%normal(k), c%w(k)], &
                                  [c%out1(k), c%out2(k), c%out3(k)])
            if (energies) &
               call add_ground_loss(energy_of(c%tangential(k), c%normal(k), c%w(k)), &
                                    energy_of(c%out1(k), c%out2(k), c%out3(k)), 0.0_wp, result)
            slow = is_slow(scene, c%speed2(k))
            call close_impact(scene, c%speed2(k), .not. slow, result)
            call set_heading(pool, lane, c%heading1(k), c%heading2(k), c%next_w(k))
            if (slow) then
               call rest_or_roll(scene, c%ground(k), landing_of(l, k), c%speed2(k), c%next_w(k), result, roll)
               flight%v = [c%v1(k), c%v2(k), c%v3(k)]
               if (result%status == 0) then
                  call roll_single(scene, c%number(k), l, k, pool, result, flight, roll, flights, scratch(lane))
                  cycle
               end if
            end if
            if (result%status /= 0) then
               pool%v(:, lane) = [c%v1(k), c%v2(k), c%v3(k)]
               cycle
            end if
            call take_off_again(flights, l, k, c%v1(k), c%v2(k), c%v3(k), c%rate(k))
         end associate
      end do
   end subroutine advance_boulders

   !> Start the next flight of a boulder after a contact from a table, or end the boulder.
   subroutine finish_table_contact(scene, number, b, l, k, pool, result, flights, scratch)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: number
      type(table_batch_t), intent(inout) :: b
      type(landings_t), intent(inout) :: l
      integer, intent(in) :: k
      type(pool_t), intent(inout) :: pool
      type(boulder_result_t), intent(inout) :: result
      type(flights_t), intent(inout) :: flights
      type(scratch_t), intent(inout) :: scratch
      type(flight_t) :: flight
      integer :: lane

      lane = l%lane(k)
      call count_outcome(rebound_t([0.0_wp, 0.0_wp, 0.0_wp], forced=b%left(k) < b%total(k)), &
                         pool%touch(lane)%beyond, b%fast(k) > 0, .false., result)
      call count_ground(b%ground(k), scratch)
      if (scene%histograms_requested) &
         call count_rebound(scratch%histograms, [b%tangential(k), b%normal(k), b%w(k)], &
                            velocity_after(b%unit(k), b%velocity_factor(k)*b%along(k), &
                                           b%velocity_factor(k)*b%across(k), b%n_left(k), &
                                           b%velocity_factor(k)*b%w_drawn(k)))
      if (needs_energies(scene)) &
         call add_ground_loss(squared_length([l%v1(k), l%v2(k), l%v3(k) - scene%gravity*l%time(k)]) &
                              + inertia_factor*pool%w(lane)*pool%w(lane), b%speed2(k), &
                              inertia_factor*b%next_w(k)*b%next_w(k), result)
      associate (touch => pool%touch(lane))
         touch%normal = b%pressed(k)
         touch%lift = b%lift(k)
         touch%height = b%height(k)
         touch%rolling = b%rolls(k) > 0
         touch%next = int(b%next(k))
         ! prefetch an arbitrary record if none followed: a branch would be mispredicted
         call prefetch_record(scene%grounds(b%ground(k))%table, max(1, touch%next))
      end associate
      call set_heading(pool, lane, b%heading1(k), b%heading2(k), b%next_w(k))
      call close_impact(scene, b%speed2(k), .not. b%stops(k) > 0, result)
      if (.not. (result%status /= 0 .or. b%stops(k) > 0 .or. b%walks(k))) then
         if (scratch%cells_requested) call visit_slide(scene, b, l, k, result%time, scratch)
         result%path_length = result%path_length + b%length(k)
         result%time = result%time + b%slides(k)
         result%time = result%time + b%waits(k)
         call take_off_from(flights, l, k, b%x(k), b%y(k), b%z(k), b%i(k), b%j(k), b%z00(k), b%a(k), b%b(k), b%c(k), &
                            b%above(k), b%v1(k), b%v2(k), b%v3(k), b%rate(k))
         return
      end if
      flight%v = [b%v1(k), b%v2(k), b%v3(k)]
      pool%v(:, lane) = flight%v
      if (result%status /= 0) return
      if (b%stops(k) > 0) then
         pool%touch(lane) = touch_t()
         call rest_or_roll(scene, b%ground(k), landing_of(l, k), b%speed2(k), b%next_w(k), result, b%roll(k))
         if (result%status /= 0) return
      else
         associate (roll => b%roll(k))
            roll%v = [b%v1(k), b%v2(k), b%v3(k)]
            roll%w = b%next_w(k)
            roll%heading = [b%heading1(k), b%heading2(k)]
            roll%above = b%above(k)
         end associate
      end if
      call roll_single(scene, number, l, k, pool, result, flight, b%roll(k), flights, scratch)
   end subroutine finish_table_contact

   !> Record the cells along a contact from a table, as `follow_roll` does along the path of `find_slide`.
   subroutine visit_slide(scene, b, l, k, start_time, scratch)
      type(scene_t), intent(in) :: scene
      type(table_batch_t), intent(in) :: b
      type(landings_t), intent(in) :: l
      integer, intent(in) :: k
      real(wp), intent(in) :: start_time  !! time since the release [s]
      type(scratch_t), intent(inout) :: scratch
      type(flight_t) :: path
      type(span_t) :: span(1)

      path%patch = patch_t(int(l%i(k)), int(l%j(k)))
      path%x = l%x(k)
      path%y = l%y(k)
      path%z = l%z(k)
      path%v = 0
      if (b%slides(k) > 0) &
         path%v = 1/b%slides(k)*[b%covered(k)*b%t1(k), b%covered(k)*b%t2(k), -(l%z(k) - b%z(k))]
      span = span_t(path%patch%i, path%patch%j, 0.0_wp, b%slides(k), 0.0_wp, 0.0_wp, 0.0_wp)
      call visit_cells(scene, 0.0_wp, path, sqrt(squared_length(path%v)), start_time, b%slides(k), span, scratch)
   end subroutine visit_slide

   !> Compute a rebound that the vectorised loops do not cover, and the next flight.
   subroutine rebound_single(scene, number, l, k, pool, result, flights, scratch)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: number
      type(landings_t), intent(inout) :: l
      integer, intent(in) :: k
      type(pool_t), intent(inout) :: pool
      type(boulder_result_t), intent(inout) :: result
      type(flights_t), intent(inout) :: flights
      type(scratch_t), intent(inout) :: scratch
      type(flight_t) :: flight
      type(roll_t) :: roll
      integer :: lane

      lane = l%lane(k)
      flight = flight_of(l, k)
      flight%heading = [pool%heading1(lane), pool%heading2(lane)]
      scratch%touch = pool%touch(lane)
      call handle_impact(scene, number, landing_of(l, k), [l%v1(k), l%v2(k), l%v3(k) - scene%gravity*l%time(k)], &
                         pool%w(lane), with_all, result, flight, roll, scratch)
      pool%touch(lane) = scratch%touch
      if (roll%rolls .and. result%status == 0) then
         call roll_single(scene, number, l, k, pool, result, flight, roll, flights, scratch)
         return
      end if
      call set_heading(pool, lane, flight%heading(1), flight%heading(2), pool%w(lane))
      pool%v(:, lane) = flight%v
      if (result%status == 0) call take_off(flights, lane, flight)
   end subroutine rebound_single

   !> Compute a roll, and the next flight.
   subroutine roll_single(scene, number, l, k, pool, result, flight, roll, flights, scratch)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: number
      type(landings_t), intent(inout) :: l
      integer, intent(in) :: k
      type(pool_t), intent(inout) :: pool
      type(boulder_result_t), intent(inout) :: result
      type(flight_t), intent(inout) :: flight  !! on entry, with the velocity after the rebound
      type(roll_t), intent(inout) :: roll
      type(flights_t), intent(inout) :: flights
      type(scratch_t), intent(inout) :: scratch
      type(landing_t) :: landing
      type(obstacle_t) :: obstacle
      real(wp) :: v(3)
      integer :: lane

      lane = l%lane(k)
      call follow_roll(scene, with_all, roll, result, flight, pool%w(lane), landing, v, obstacle, scratch)
      if (obstacle%kind /= none) then
         pool%touch(lane) = touch_t()
         call hit_single(scene, number, obstacle, landing, v, l, k, pool, result, flight, flights, scratch)
      else if (landing%contact) then
         call set_heading(pool, lane, flight%heading(1), flight%heading(2), pool%w(lane))
         call take_off(flights, lane, flight)
      else
         result%status = departure_status(scene%dem, landing%patch)
         pool%v(:, lane) = v
         call replace_landing(l, k, landing)
      end if
   end subroutine roll_single

   !> Remove finished boulders from the pool.
   subroutine retire_boulders(scene, active, results, crossings, maps, l, pool, scratch, totals)
      type(scene_t), intent(in) :: scene
      type(boulder_result_t), intent(inout) :: active(lanes)
      type(boulder_result_t), intent(inout) :: results(:)
      type(crossings_t), intent(inout) :: crossings(:)
      type(maps_t), intent(in) :: maps
      type(landings_t), intent(in) :: l
      type(pool_t), intent(inout) :: pool
      type(scratch_t), intent(inout) :: scratch(:)
      type(totals_t), intent(inout) :: totals
      integer :: k, lane

      do k = 1, l%n
         lane = l%lane(k)
         if (active(lane)%status == 0) cycle
         associate (result => active(lane), work => scratch(lane))
            if (needs_energies(scene)) &
               call close_energy_balance(scene%gravity, l%z(k), pool%v(:, lane), pool%w(lane), result)
            if (allocated(scene%barriers)) call record_passed_over(scene, result, work%crossings)
            call end_boulder(scene, landing_of(l, k), with_all, result, work)
            if (allocated(work%crossings)) call keep_crossings(work%crossings, crossings(pool%index(lane)))
            call add_boulder(scene, maps, result, work, totals)
            results(pool%index(lane)) = result
         end associate
         pool%n_free = pool%n_free + 1
         pool%free(pool%n_free) = lane
      end do
   end subroutine retire_boulders
end module rockfall_lanes
