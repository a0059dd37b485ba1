! SPDX-License-Identifier: BSD-3-Clause
!> One boulder from release to rest: fly, land, look up what the slope is made of, rebound, turn, fly again.
!> A pure function of the scene and the boulder's number.
module rockfall_trajectory
   use rockfall_kinds, only: wp, i1, i8
   use rockfall_random, only: random_key_t, normal_table_t, random_words, uniform, for_impact, for_ground, &
                              for_tree, words_per_block, rebound_words, turn_word, obstacle_word, ratio_word, &
                              roughness_word
   use rockfall_sobol, only: sobol_t, sobol_word, scrambled, volume_dimension, obstacle_dimension
   use rockfall_terrain, only: terrain_t, patch_t, in_window, locate, within, height, gradient, cell_of, &
                               cell_descent
   use rockfall_surface, only: surface_t, rock_radius, ground_at
   use rockfall_boulder, only: boulder_t, source_boulder_t, feature_t, volume_distribution_t, release_t, draw_boulder, &
                               boulder_of, source_of, first_of, inertia_factor, kinetic_energy
   use rockfall_flight, only: flight_t, landing_t, span_t, fly, end_flight, flight_from, launch_rate, arc_length, never
   use rockfall_rolling, only: roll_t, touch_t, find_roll, launch, speed_within, cut_roll
   use rockfall_impact, only: impact_set_t, impact_ratios, ratio_class, ratio_between, beyond_fit, rebound_t, &
                              rebound, twice_energy
   use rockfall_classical_rebound, only: absorbs
   use rockfall_ground, only: ground_t, ground_rebound, is_stochastic
   use rockfall_direction, only: turning_t, lateral_t, past_aspect, by_lab, lateral_angle, new_heading, unit_vector, &
                                 any_heading, rotated
   use rockfall_local_frame, only: decompose, launch_velocity
   use rockfall_table_contact, only: table_contact_t, table_contact, keep_touch
   use rockfall_line, only: line_t, first_crossing, next_crossing
   use rockfall_barrier, only: barrier_t, barrier_outcome, stopped_there, broken_through, passed_over
   use rockfall_forest, only: forest_t, tree_hit_t, tree_impact_t, first_hit, tree_impact
   use rockfall_maps, only: visits_t, start_visits, visit_path, visit_cell
   use rockfall_travel_maps, only: time_visits
   use rockfall_tree_maps, only: tree_hits_t, gather_tree_hit
   use rockfall_histogram, only: histograms_t, count_rebound
   implicit none
   private
   public :: scene_t, boulder_result_t, crossing_t, contact_t, scratch_t, obstacle_t, trace_full, choose_trace
   public :: goes_in_lanes
   public :: has_obstacles, at_rest, start_boulder, end_boulder, departure, record_crossings, handle_impact, find_rocks
   public :: clear, find_class, count_outcome, inertia_of
   public :: close_impact, rest_or_roll, roll_on, meet_ground, count_ground, with_all
   public :: one_by_one, narrow_lanes, wide_lanes
   public :: stopped, absorbed, left_domain, impact_limit, hit_nodata, stopped_by_tree, stopped_by_barrier, left_window

   !> Status, in the order of the table of rockfall_variables; 0 while a boulder is on its way.
   integer, parameter :: stopped = 1, absorbed = 2, left_domain = 3, impact_limit = 4, hit_nodata = 5, &
                         stopped_by_tree = 6, stopped_by_barrier = 7
   real(wp), parameter :: smooth = 1.0e-9_wp  !! R_m of ground without rocks: to its boulders all rocks are small [m]
   integer, parameter :: left_window = -1  !! the terrain goes on, but is not at hand: to be traced again; in no result

   !> What may be recorded besides the boulder's result, if it is requested: nothing; lines and histograms; visits of
   !> raster cells too; and all that the rest may ask for: vertices of the trajectory, obstacles, the energy balance.
   integer, parameter :: basic = 0, with_lines = 1, with_maps = 2, with_all = 3

   !> How boulders are carried on: each alone; several at a time; more of them, where the processor can.
   integer, parameter :: one_by_one = 0, narrow_lanes = 1, wide_lanes = 2

   !> What a flight may end at before it meets the ground.
   integer, parameter :: none = 0, barrier = 1, tree = 2

   !> What stands this near to a barrier is behind it, over the width of the terrain [-]: far more than places are
   !> rounded, and a micrometre on a slope of a kilometre.
   real(wp), parameter :: beside = 1.0e-9_wp

   !> Everything that a boulder needs to know; the same for all boulders of a run.
   type :: scene_t
      type(random_key_t) :: key            !! from the seed
      type(normal_table_t) :: table
      type(sobol_t) :: sobol               !! of the volume and of the words of the first rebound
      type(terrain_t) :: dem
      type(surface_t) :: surface
      type(impact_set_t) :: sets(impact_ratios)
      logical :: between_ratios = .false.  !! a ratio between two sets is served by either, at random
      logical :: ground_drawn = .false.    !! it or something else of the ground is random: more words an impact
      integer :: turning = past_aspect     !! rule of turning_t
      type(lateral_t), allocatable :: lateral(:)  !! of each ratio; only by_lab
      type(ground_t), allocatable :: grounds(:)   !! only where there are others than `sets`
      type(volume_distribution_t) :: volumes
      type(source_boulder_t), allocatable :: of_source(:)  !! where sources say it; `volumes` are factors on these
      type(feature_t), allocatable :: features(:)          !! where a layer says more of releases than where they are
      type(release_t) :: release
      type(line_t), allocatable :: lines(:)        !! evaluation lines, and those of the barriers
      type(barrier_t), allocatable :: barriers(:)
      type(forest_t), allocatable :: forest
      real(wp) :: gravity = 9.81_wp        !! [m/s2]
      real(wp) :: stop_speed = 0.5_wp      !! slower after a rebound: it rests, or rolls on [m/s]
      real(wp) :: rest_slope = 1.0e30_wp   !! tangent of the rest angle of its sets: where it is steeper it rolls [-]
      integer :: max_impacts = 100000      !! contacts, after which a boulder ends
      logical :: histograms_requested = .false.
      logical :: energies_requested = .false.
      integer :: lanes = wide_lanes        !! or less, where the processor or what is requested has none
   end type scene_t

   !> What became of the energy of a boulder: released = ground + trees + barriers + left [J].
   type :: energy_balance_t
      real(wp) :: released = 0.0_wp  !! kinetic at the release, potential from there to the end
      real(wp) :: ground = 0.0_wp, trees = 0.0_wp, barriers = 0.0_wp  !! what they took
      real(wp) :: left = 0.0_wp      !! kinetic at the end
   end type energy_balance_t

   !> Where a flight ends in the air.
   type :: obstacle_t
      integer :: kind = none        !! barrier, tree
      integer :: number = 0         !! of the barrier
      real(wp) :: time = never      !! since the start of the flight [s]
      type(tree_hit_t) :: hit       !! of a tree
   end type obstacle_t

   !> What became of a boulder (theory, chapter 10).
   type :: boulder_result_t
      type(boulder_t) :: boulder
      integer :: status = 0
      integer :: impacts = 0               !! contacts with the slope
      integer :: source = 0                !! 1..
      real(wp) :: start(3) = 0.0_wp, stop(3) = 0.0_wp  !! local coordinates [m]
      integer :: stop_cell(2) = 0          !! column, row; only with a contact
      real(wp) :: path_length = 0.0_wp     !! along the flights [m]
      real(wp) :: time = 0.0_wp            !! [s]
      real(wp) :: speed_max = 0.0_wp       !! [m/s]
      real(wp) :: jump_height_max = 0.0_wp !! [m]
      integer :: rebounds = 0, redrawn = 0, forced = 0
      integer :: out_of_range = 0, out_of_speed = 0, out_of_angle = 0  !! rebounds beyond what a set was fitted on
      integer :: trees_hit = 0             !! each time counts
      type(energy_balance_t) :: energy     !! where the scene has more than ground, or it is requested
   end type boulder_result_t

   !> First crossing of an evaluation line.
   type :: crossing_t
      logical :: crossed = .false.
      integer(i1) :: outcome = 0       !! what the barrier there did, in all (rockfall_barrier); 0: it was not met
      real(wp) :: x = 0, y = 0, time = 0  !! local coordinates [m], since release [s]
      real(wp) :: v(3) = 0, omega = 0  !! [m/s], [rad/s]
      real(wp) :: jump_height = 0      !! point above the surface [m]
      real(wp) :: passing_height = 0   !! centre of the sphere above the surface, vertical [m]
   end type crossing_t

   !> One vertex of a recorded trajectory: the release, each contact, each obstacle that it met, the end.
   type :: contact_t
      real(wp) :: x = 0, y = 0, z = 0, time = 0  !! local coordinates [m], since release [s]
      real(wp) :: v(3) = 0                   !! velocity after it [m/s]
      real(wp) :: v_in(3) = 0, v_out(3) = 0  !! V_t, V_n, W before and after; 0 without a rebound [m/s]
      real(wp) :: ratio = 0            !! R_b/R_m; 0 without a rebound
   end type contact_t

   !> A boulder's work space; what a scene does not ask for is not allocated.
   type :: scratch_t
      logical :: cells_requested = .false.       !! maps need visits of raster cells
      logical :: heights_requested = .false.     !! and the heights over them
      type(visits_t) :: visits
      type(histograms_t) :: histograms
      integer(i8), allocatable :: by_ground(:)   !! rebounds on each of the scene's grounds
      type(crossing_t), allocatable :: crossings(:)
      integer, allocatable :: felled(:)          !! trees that it broke
      logical :: tree_hits_requested = .false.   !! by maps
      type(tree_hits_t) :: tree_hits
      type(contact_t), allocatable :: record(:)  !! allocated by who requests the trajectory
      integer :: recorded = 0                    !! vertices there were, also beyond size(record)
      type(touch_t) :: touch                     !! of a boulder on the ground of a table
   end type scratch_t

contains

   !> Trace boulder `number` (1..) from release to its end, and record all that is requested.
   pure subroutine trace_full(scene, number, result, scratch, spans)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: number
      type(boulder_result_t), intent(out) :: result
      type(scratch_t), intent(inout) :: scratch
      type(span_t), intent(inout), contiguous :: spans(:)

      call trace(scene, number, result, scratch, spans, with_all)
   end subroutine trace_full

   !> The same without a record of the trajectory, obstacles, and energies.
   pure subroutine trace_maps(scene, number, result, scratch, spans)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: number
      type(boulder_result_t), intent(out) :: result
      type(scratch_t), intent(inout) :: scratch
      type(span_t), intent(inout), contiguous :: spans(:)

      call trace(scene, number, result, scratch, spans, with_maps)
   end subroutine trace_maps

   !> The same without maps either.
   pure subroutine trace_lines(scene, number, result, scratch, spans)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: number
      type(boulder_result_t), intent(out) :: result
      type(scratch_t), intent(inout) :: scratch
      type(span_t), intent(inout), contiguous :: spans(:)

      call trace(scene, number, result, scratch, spans, with_lines)
   end subroutine trace_lines

   !> The same when only the boulder's result is requested.
   pure subroutine trace_basic(scene, number, result, scratch, spans)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: number
      type(boulder_result_t), intent(out) :: result
      type(scratch_t), intent(inout) :: scratch
      type(span_t), intent(inout), contiguous :: spans(:)

      call trace(scene, number, result, scratch, spans, basic)
   end subroutine trace_basic

   !> Choose, once a run, the copy of `trace` in which the compiler has left out what the scene does not need. Tests
   !> alone would not do: beside code that may run, the compiler does not keep a flight in registers.
   subroutine choose_trace(scene, cells_requested, trace)
      type(scene_t), intent(in) :: scene
      logical, intent(in) :: cells_requested
      procedure(trace_full), pointer, intent(out) :: trace  !! what the scene needs of `trace_full`

      trace => trace_basic
      if (allocated(scene%lines) .or. scene%histograms_requested) trace => trace_lines
      if (cells_requested) trace => trace_maps
      if (has_obstacles(scene) .or. scene%energies_requested .or. allocated(scene%grounds) &
          .or. allocated(scene%of_source) .or. allocated(scene%features)) trace => trace_full
   end subroutine choose_trace

   !> Whether several boulders may be carried on at a time: they meet nothing but the ground, and turn past the aspect.
   pure logical function goes_in_lanes(scene)
      type(scene_t), intent(in) :: scene

      goes_in_lanes = .not. (has_obstacles(scene) .or. scene%energies_requested) .and. scene%turning == past_aspect
   end function goes_in_lanes

   !> Whether there is anything but the ground to meet.
   pure logical function has_obstacles(scene)
      type(scene_t), intent(in) :: scene

      has_obstacles = allocated(scene%barriers) .or. allocated(scene%forest)
   end function has_obstacles

   !> Whether a boulder has come to rest somewhere.
   elemental logical function at_rest(status)
      integer, intent(in) :: status

      at_rest = any(status == [stopped, absorbed, stopped_by_tree, stopped_by_barrier])
   end function at_rest

   !> All that `trace_full` is. Wherever it is called `level` is a constant, so that each gets a copy of its own.
   pure subroutine trace(scene, number, result, scratch, spans, level)
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

      call start_boulder(scene, number, level, result, flight)
      if (result%status /= 0) return
      omega_r = 0
      call clear(scene, level, scratch)
      obstacles = .false.
      if (level >= with_all) then
         call record(scratch, contact_t(flight%x, flight%y, flight%z, 0.0_wp, flight%v))
         obstacles = has_obstacles(scene)
         result%energy%released = sum(kinetic_energy(result%boulder, flight%v, 0.0_wp)) &
                                  + result%boulder%mass*scene%gravity*flight%z
      end if
      do
         if (roll%rolls) then
            call roll_on(scene, level, roll, result, flight, omega_r, landing, v_in, obstacle, scratch)
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
            result%path_length = result%path_length + arc_length(flight%v, scene%gravity, landing%time)
            result%time = result%time + landing%time
            result%speed_max = max(result%speed_max, square(v_in))
            result%jump_height_max = max(result%jump_height_max, landing%jump_height)
         end if
         if (level >= with_all .and. obstacle%kind /= none) then
            call meet_obstacle(scene, number, obstacle, landing, v_in, omega_r, result, flight, scratch)
         else if (.not. landing%contact) then
            result%status = departure(scene%dem, landing%patch)
         else
            result%impacts = result%impacts + 1
            call handle_impact(scene, number, landing, v_in, omega_r, level, result, flight, roll, scratch)
         end if
         if (result%status /= 0) exit
      end do
      if (level >= with_all) then
         if (any(result%status == [absorbed, left_domain, hit_nodata])) then
            call record(scratch, contact_t(landing%x, landing%y, landing%z, result%time, v_in))
            flight%v = v_in
         end if
         call close_balance(scene, landing%z, flight%v, omega_r, result)
         if (allocated(scene%barriers)) call note_passed_over(scene, result, scratch%crossings)
      end if
      call end_boulder(scene, landing, level, result, scratch)
   end subroutine trace

   !> The work space as a boulder finds it.
   pure subroutine clear(scene, level, scratch)
      type(scene_t), intent(in) :: scene
      integer, value :: level  !! as in trace
      type(scratch_t), intent(inout) :: scratch

      scratch%recorded = 0
      scratch%touch = touch_t()
      if (level >= with_lines) then
         if (allocated(scratch%crossings)) scratch%crossings%crossed = .false.
         if (scene%histograms_requested) scratch%histograms%count = 0
      end if
      if (level >= with_maps .and. scratch%cells_requested) call start_visits(scratch%visits)
      if (level >= with_all) then
         if (allocated(scene%barriers)) scratch%crossings%outcome = 0
         if (allocated(scratch%by_ground)) scratch%by_ground = 0
         if (allocated(scene%forest)) scratch%felled = [integer ::]
         scratch%tree_hits%n = 0
      end if
   end subroutine clear

   !> What a boulder is, and the start of its first flight.
   pure subroutine start_boulder(scene, number, level, result, flight)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: number
      integer, value :: level  !! as in trace
      type(boulder_result_t), intent(out) :: result
      type(flight_t), intent(out) :: flight

      result%source = int(source_of(scene%release, number))
      if (level >= with_all .and. allocated(scene%features)) then
         result%boulder = drawn(scene, scene%features(scene%release%feature(result%source))%volumes, number)
      else
         result%boulder = drawn(scene, scene%volumes, number)
      end if
      if (level >= with_all .and. allocated(scene%of_source)) &
         result%boulder = boulder_of(scene%of_source(result%source), result%boulder%volume)
      call release(scene, result%source, flight)
      result%start = [flight%x, flight%y, flight%z]
      result%speed_max = square(flight%v)  ! the root is taken at the end
      if (flight%patch%known) return
      result%status = left_window
      result%stop = result%start
   end subroutine start_boulder

   !> What is left to say of a boulder at its end.
   pure subroutine end_boulder(scene, landing, level, result, scratch)
      type(scene_t), intent(in) :: scene
      type(landing_t), intent(in) :: landing
      integer, value :: level  !! as in trace
      type(boulder_result_t), intent(inout) :: result
      type(scratch_t), intent(inout) :: scratch

      result%speed_max = sqrt(result%speed_max)
      result%stop = [landing%x, landing%y, landing%z]
      if (.not. (landing%contact .or. at_rest(result%status))) return
      result%stop_cell = cell_of(scene%dem, landing%patch, landing%u, landing%w)
      if (level >= with_maps .and. scratch%cells_requested) &
         call visit_cell(scratch%visits, result%stop_cell, 0.0_wp, 0.0_wp, 0.0_wp)
   end subroutine end_boulder

   !> Why a boulder goes no further at a patch that is not known.
   pure integer function departure(dem, patch) result(status)
      type(terrain_t), intent(in) :: dem
      type(patch_t), intent(in) :: patch

      status = merge(left_domain, left_window, min(patch%i, patch%j) < 1 .or. patch%i >= dem%nx .or. patch%j >= dem%ny)
      if (in_window(dem, patch%i, patch%j)) status = hit_nodata
   end function departure

   !> A word of the boulder's scrambled Sobol' point: its volume, then the words of its first rebound.
   pure integer(i8) function scrambled_word(scene, number, dimension)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: number
      integer, intent(in) :: dimension
      integer(i8) :: source, index

      source = source_of(scene%release, number)
      index = number - first_of(scene%release, source)
      scrambled_word = scrambled(sobol_word(scene%sobol, index, dimension), scene%key, source, dimension)
   end function scrambled_word

   !> Those of the first rebound. All at once: an index that varies would keep the usual words in memory.
   pure function scrambled_words(scene, number) result(word)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: number
      integer(i8) :: word(words_per_block)
      integer :: k

      do k = 1, size(word)
         word(k) = scrambled_word(scene, number, volume_dimension + k)
      end do
   end function scrambled_words

   !> The boulder of a number, of a distribution of volumes.
   pure type(boulder_t) function drawn(scene, volumes, number) result(boulder)
      type(scene_t), intent(in) :: scene
      type(volume_distribution_t), intent(in) :: volumes
      integer(i8), intent(in) :: number

      if (scene%sobol%dimensions > 0) then
         boulder = draw_boulder(volumes, scene%table, scene%key, number, &
                                scrambled_word(scene, number, volume_dimension))
      else
         boulder = draw_boulder(volumes, scene%table, scene%key, number)
      end if
   end function drawn

   !> The start of the first flight: above the source, at rest or with the velocity of the release.
   pure subroutine release(scene, source, flight)
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
   end subroutine release

   !> Fly, and record the visits of raster cells.
   pure subroutine fly_over_cells(scene, flight, omega_r, begun, landing, scratch, spans)
      type(scene_t), intent(in) :: scene
      type(flight_t), intent(in) :: flight
      real(wp), intent(in) :: omega_r  !! W [m/s]
      real(wp), intent(in) :: begun    !! since the release [s]
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
      call visit_cells(scene, scene%gravity, flight, omega_r, begun, landing%time, spans(:n), scratch)
   end subroutine fly_over_cells

   !> Record the raster cells under a flight, or along a roll, whose path has no gravity.
   pure subroutine visit_cells(scene, gravity, flight, omega_r, begun, time, spans, scratch)
      type(scene_t), intent(in) :: scene
      real(wp), intent(in) :: gravity  !! of the path [m/s2]
      type(flight_t), intent(in) :: flight
      real(wp), intent(in) :: omega_r  !! W [m/s]
      real(wp), intent(in) :: begun    !! since the release [s]
      real(wp), intent(in) :: time     !! of the flight [s]
      type(span_t), intent(in), contiguous :: spans(:)  !! of it
      type(scratch_t), intent(inout) :: scratch

      associate (visits => scratch%visits, spin => inertia_factor*omega_r**2)
         if (scratch%heights_requested) then
            call visit_path(visits, scene%dem, gravity, flight, time, spin, spans)
         else
            call visit_path(visits, scene%dem, gravity, flight, time, spin)
         end if
         if (allocated(visits%time)) &
            call time_visits(visits, scene%dem, [flight%x, flight%y], flight%v(:2), begun, time)
      end associate
   end subroutine visit_cells

   !> Fly to the ground or to the first obstacle on the way there, and record the lines and cells up to there.
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
         call visit_cells(scene, scene%gravity, flight, omega_r, result%time, landing%time, spans(:n), scratch)
   end subroutine fly_to_obstacle

   !> The first obstacle on a path, and the lines that are crossed up to there.
   pure subroutine find_obstacle(scene, gravity, result, flight, landing, omega_r, spans, scratch, obstacle)
      type(scene_t), intent(in) :: scene
      real(wp), intent(in) :: gravity  !! of the path [m/s2]
      type(boulder_result_t), intent(in) :: result
      type(flight_t), intent(in) :: flight
      type(landing_t), intent(in) :: landing
      real(wp), intent(in) :: omega_r  !! W [m/s]
      type(span_t), intent(in), contiguous :: spans(:)
      type(scratch_t), intent(inout) :: scratch
      type(obstacle_t), intent(out) :: obstacle

      if (allocated(scene%barriers)) &
         call find_barrier(scene, gravity, result, flight, landing, omega_r, scratch%crossings, obstacle)
      if (allocated(scene%forest)) &
         call find_tree(scene%forest, result%boulder%radius, flight, spans, scratch%felled, obstacle)
      if (allocated(scene%lines)) &
         call record_crossings(scene, gravity, result, flight, landing, omega_r, scratch%crossings, obstacle%time)
   end subroutine find_obstacle

   !> Roll, or slide in a contact that a table gave, to its end, from where the boulder flies on, or to the first
   !> obstacle on the way there. Lines and cells as on a flight; they get the mean speed, the end gets the exact one.
   pure subroutine roll_on(scene, level, roll, result, flight, omega_r, landing, v, obstacle, scratch)
      type(scene_t), intent(in) :: scene
      integer, value :: level                 !! as in trace
      type(roll_t), intent(inout) :: roll     !! none afterwards
      type(boulder_result_t), intent(inout) :: result
      type(flight_t), intent(inout) :: flight !! with the velocity after the rebound; then the next, if it goes on
      real(wp), intent(inout) :: omega_r      !! W: after the rebound, and at the end [m/s]
      type(landing_t), intent(out) :: landing
      real(wp), intent(out) :: v(3)           !! velocity at the end [m/s]
      type(obstacle_t), intent(out) :: obstacle
      type(scratch_t), intent(inout) :: scratch
      real(wp), parameter :: no_gravity = 0.0_wp
      type(span_t) :: span(1)
      real(wp) :: before, mean, fraction, above

      before = square(flight%v) + inertia_factor*omega_r*omega_r
      flight = roll%path
      landing = roll%landing
      roll%rolls = .false.
      mean = sqrt(square(flight%v))
      if (level >= with_all) call replace_velocity(scratch, flight%v)
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
         call visit_cells(scene, no_gravity, flight, mean, result%time, landing%time, span, scratch)
      if (.not. roll%drawn) then
         omega_r = speed_within(roll, fraction)
         v = omega_r*roll%direction
      else
         omega_r = roll%w
         v = roll%v
         if (obstacle%kind /= none) v = flight%v
      end if
      above = merge(roll%above, 0.0_wp, roll%drawn .and. landing%contact)
      result%path_length = result%path_length + merge(fraction*roll%length, mean*landing%time, roll%drawn)
      result%time = result%time + landing%time
      if (roll%drawn .and. landing%contact) result%time = result%time + roll%waits
      result%speed_max = max(result%speed_max, square(v))
      if (level >= with_all) result%energy%ground = result%energy%ground + result%boulder%mass &
         *(scene%gravity*(flight%z - landing%z - above) &
           + 0.5_wp*(before - square(v) - inertia_factor*omega_r*omega_r))
      if (.not. landing%contact) return
      flight = launch(scene%dem, roll, landing, v)
      if (level >= with_all) call record(scratch, contact_t(landing%x, landing%y, landing%z, result%time, v))
   end subroutine roll_on

   !> A boulder leaves the last vertex with another velocity: it rolls.
   pure subroutine replace_velocity(scratch, v)
      type(scratch_t), intent(inout) :: scratch
      real(wp), intent(in) :: v(3)  !! [m/s]

      if (.not. allocated(scratch%record)) return
      if (scratch%recorded <= size(scratch%record)) scratch%record(scratch%recorded)%v = v
   end subroutine replace_velocity

   !> The first barrier that stands in the way of a flight, if it does before the obstacle.
   pure subroutine find_barrier(scene, gravity, result, flight, landing, omega_r, crossings, obstacle)
      type(scene_t), intent(in) :: scene
      real(wp), intent(in) :: gravity    !! of the path [m/s2]
      type(boulder_result_t), intent(in) :: result
      type(flight_t), intent(in) :: flight
      type(landing_t), intent(in) :: landing
      real(wp), intent(in) :: omega_r    !! W [m/s]
      type(crossing_t), intent(in) :: crossings(:)
      type(obstacle_t), intent(inout) :: obstacle
      real(wp) :: fraction, time
      integer :: k

      do k = 1, size(scene%barriers)
         if (crossings(scene%barriers(k)%line)%outcome == broken_through) cycle
         fraction = -1
         do  ! a bent barrier may be crossed several times
            fraction = next_crossing(scene%lines(scene%barriers(k)%line), [flight%x, flight%y], &
                                     [landing%x, landing%y], fraction)
            time = fraction*landing%time
            if (fraction > 1 .or. time >= obstacle%time) exit
            if (stands_in_way(scene%barriers(k), result, crossing(scene, gravity, result, flight, time, omega_r))) then
               obstacle = obstacle_t(barrier, k, time)
               exit
            end if
         end do
      end do
   end subroutine find_barrier

   !> Whether a boulder that crosses a barrier does not pass over it.
   pure logical function stands_in_way(this, result, crossing)
      type(barrier_t), intent(in) :: this
      type(boulder_result_t), intent(in) :: result
      type(crossing_t), intent(in) :: crossing

      stands_in_way = passed_over /= barrier_outcome(this%height, this%capacity, crossing%passing_height, &
                                                     sum(kinetic_energy(result%boulder, crossing%v, crossing%omega)))
   end function stands_in_way

   !> Barriers that a boulder crossed and that never stood in its way: it passed over them.
   pure subroutine note_passed_over(scene, result, crossings)
      type(scene_t), intent(in) :: scene
      type(boulder_result_t), intent(in) :: result
      type(crossing_t), intent(inout) :: crossings(:)
      integer :: k

      do k = 1, size(scene%barriers)
         associate (at => crossings(scene%barriers(k)%line))
            if (.not. at%crossed .or. at%outcome /= 0) cycle
            if (.not. stands_in_way(scene%barriers(k), result, at)) at%outcome = passed_over
         end associate
      end do
   end subroutine note_passed_over

   !> The first tree on the way of a flight, if it is hit before the obstacle.
   pure subroutine find_tree(forest, radius, flight, spans, felled, obstacle)
      type(forest_t), intent(in) :: forest
      real(wp), intent(in) :: radius  !! of the boulder [m]
      type(flight_t), intent(in) :: flight
      type(span_t), intent(in), contiguous :: spans(:)
      integer, intent(in) :: felled(:)
      type(obstacle_t), intent(inout) :: obstacle
      type(tree_hit_t) :: hit

      call first_hit(forest, spans, flight%x, flight%y, flight%v(1:2), radius, felled, hit)
      if (hit%tree > 0 .and. hit%time < obstacle%time) obstacle = obstacle_t(tree, 0, hit%time, hit)
   end subroutine find_tree

   !> An obstacle takes energy; with the rest the boulder flies on from there.
   pure subroutine meet_obstacle(scene, number, obstacle, landing, v, omega_r, result, flight, scratch)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: number
      type(obstacle_t), intent(in) :: obstacle
      type(landing_t), intent(in) :: landing
      real(wp), intent(in) :: v(3)        !! velocity there [m/s]
      real(wp), intent(inout) :: omega_r  !! W [m/s]
      type(boulder_result_t), intent(inout) :: result
      type(flight_t), intent(inout) :: flight
      type(scratch_t), intent(inout) :: scratch
      type(tree_impact_t) :: impact
      type(landing_t) :: place
      real(wp) :: energy, taken, remains, turned(2), heading(2)

      energy = sum(kinetic_energy(result%boulder, v, omega_r/result%boulder%radius))
      turned = v(1:2)
      heading = flight%heading
      if (obstacle%kind == tree) then
         call hit_tree(scene, number, obstacle%hit, landing, energy, result, scratch, impact)
         taken = impact%taken
         result%energy%trees = result%energy%trees + taken
         turned = rotated(turned, impact%sine, impact%cosine)
         heading = rotated(heading, impact%sine, impact%cosine)
      else
         taken = min(energy, scene%barriers(obstacle%number)%capacity)
         result%energy%barriers = result%energy%barriers + taken
      end if
      remains = 0
      if (energy > taken) remains = sqrt((energy - taken)/energy)
      omega_r = remains*omega_r
      place = landing
      if (obstacle%kind == barrier) place = little_before(scene%dem, landing, v(1:2))
      flight = flight_from(scene%dem, place, remains*[turned, v(3)], heading)
      if (taken > 0 .and. square(flight%v) < scene%stop_speed**2) then
         result%status = merge(stopped_by_tree, stopped_by_barrier, obstacle%kind == tree)
      else if (result%trees_hit >= scene%max_impacts) then
         result%status = impact_limit
      end if
      if (obstacle%kind == barrier) scratch%crossings(scene%barriers(obstacle%number)%line)%outcome = &
         int(merge(stopped_there, broken_through, result%status == stopped_by_barrier), i1)
      call record(scratch, contact_t(landing%x, landing%y, landing%z, result%time, flight%v))
   end subroutine meet_obstacle

   !> A place in the air a little before it, on the way there: places are rounded, and what else lies there, such as a
   !> line along a barrier, must still be ahead of the flight that goes on.
   pure type(landing_t) function little_before(dem, landing, v) result(place)
      type(terrain_t), intent(in) :: dem
      type(landing_t), intent(in) :: landing
      real(wp), intent(in) :: v(2)  !! in plan [m/s]
      real(wp) :: way(2)

      place = landing
      way = unit_vector(v)*(beside*dem%cell*max(dem%nx, dem%ny))
      place%x = place%x - way(1)
      place%y = place%y - way(2)
      place%u = within(dem, place%x, place%patch%i)
      place%w = within(dem, place%y, place%patch%j)
   end function little_before

   !> What a hit of a tree does, and what is to be known of it later.
   pure subroutine hit_tree(scene, number, hit, landing, energy, result, scratch, impact)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: number
      type(tree_hit_t), intent(in) :: hit
      type(landing_t), intent(in) :: landing
      real(wp), intent(in) :: energy  !! of the boulder [J]
      type(boulder_result_t), intent(inout) :: result
      type(scratch_t), intent(inout) :: scratch
      type(tree_impact_t), intent(out) :: impact

      result%trees_hit = result%trees_hit + 1
      impact = tree_impact(scene%forest%law, scene%forest%stem(hit%tree), hit%offset, result%boulder%radius, energy, &
                           random_words(scene%key, for_tree, number, int(result%trees_hit, i8), 0_i8))
      if (impact%breaks) scratch%felled = [scratch%felled, hit%tree]
      if (.not. scratch%tree_hits_requested) return
      call gather_tree_hit(scratch%tree_hits, cell_of(scene%dem, landing%patch, landing%u, landing%w), hit%height, &
                           impact%taken)
   end subroutine hit_tree

   !> What is left of the energy, and what was released down to the end.
   pure subroutine close_balance(scene, z, v, omega_r, result)
      type(scene_t), intent(in) :: scene
      real(wp), intent(in) :: z        !! of the end [m]
      real(wp), intent(in) :: v(3)     !! velocity there [m/s]
      real(wp), intent(in) :: omega_r  !! W there [m/s]
      type(boulder_result_t), intent(inout) :: result
      real(wp) :: kinetic

      kinetic = sum(kinetic_energy(result%boulder, v, omega_r/result%boulder%radius))
      associate (energy => result%energy)
         energy%released = energy%released - result%boulder%mass*scene%gravity*z
         if (result%status == absorbed) then
            energy%ground = energy%ground + kinetic
         else
            energy%left = kinetic
         end if
      end associate
   end subroutine close_balance

   !> Record the lines that a flight crosses for the first time, up to a time.
   pure subroutine record_crossings(scene, gravity, result, flight, landing, omega_r, crossings, until)
      type(scene_t), intent(in) :: scene
      real(wp), intent(in) :: gravity  !! of the path [m/s2]
      type(boulder_result_t), intent(in) :: result
      type(flight_t), intent(in) :: flight
      type(landing_t), intent(in) :: landing
      real(wp), intent(in) :: omega_r  !! W [m/s]
      type(crossing_t), intent(inout) :: crossings(:)
      real(wp), intent(in), optional :: until  !! since the start of the flight [s]
      real(wp) :: fraction
      integer :: k

      do k = 1, size(scene%lines)
         if (crossings(k)%crossed) cycle
         fraction = first_crossing(scene%lines(k), [flight%x, flight%y], [landing%x, landing%y])
         if (present(until)) then
            if (fraction*landing%time > until) cycle
         end if
         if (fraction <= 1) crossings(k) = crossing(scene, gravity, result, flight, fraction*landing%time, omega_r)
      end do
   end subroutine record_crossings

   !> The state of a boulder in flight, `t` after the flight's start.
   !>
   !> The passing height is that of the centre of the sphere (the paper measures from it). A sphere on a slope touches
   !> it along the normal, so its centre lies R_b sqrt(1 + |g|**2) = R_b/cos(slope) above the surface, vertically; and
   !> higher by the jump height where it flies (theory, chapter 10).
   pure type(crossing_t) function crossing(scene, gravity, result, flight, t, omega_r) result(c)
      type(scene_t), intent(in) :: scene
      real(wp), intent(in) :: gravity  !! of the path [m/s2]
      type(boulder_result_t), intent(in) :: result
      type(flight_t), intent(in) :: flight
      real(wp), intent(in) :: t        !! [s]
      real(wp), intent(in) :: omega_r  !! W [m/s]
      type(patch_t) :: patch
      real(wp) :: u, w, g(2)

      c%crossed = .true.
      c%time = result%time + t
      c%x = flight%x + flight%v(1)*t
      c%y = flight%y + flight%v(2)*t
      c%v = [flight%v(1), flight%v(2), flight%v(3) - gravity*t]
      c%omega = omega_r/result%boulder%radius
      associate (dem => scene%dem)
         call locate(dem, c%x, c%y, patch, u, w)
         c%jump_height = max(0.0_wp, flight%z + t*(flight%v(3) - 0.5_wp*gravity*t) - height(patch, u, w))
         g = gradient(dem, patch, u, w)
         c%passing_height = c%jump_height + result%boulder%radius*sqrt(1 + g(1)**2 + g(2)**2)
      end associate
   end function crossing

   !> A contact: absorbed, stopped, or off again on the next flight.
   pure subroutine handle_impact(scene, number, landing, v, omega_r, level, result, flight, roll, scratch)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: number
      type(landing_t), intent(in) :: landing
      real(wp), intent(in) :: v(3)          !! incoming velocity [m/s]
      real(wp), intent(inout) :: omega_r    !! W [m/s]
      integer, value :: level               !! as in trace
      type(boulder_result_t), intent(inout) :: result
      type(flight_t), intent(inout) :: flight
      type(roll_t), intent(inout) :: roll   !! where it goes on so; else none
      type(scratch_t), intent(inout) :: scratch
      integer(i8) :: word(words_per_block)
      integer :: at(2), class, ground  !! 0: the scene has the case's impact sets alone
      logical :: outside, fast, steep, slow
      real(wp) :: radius, obstacle, ratio, v_in(3), heading(2), g(2), steepness
      real(wp) :: u_ground(words_per_block)
      type(rebound_t) :: out
      type(turning_t) :: turning

      word = random_words(scene%key, for_impact, number, int(result%impacts, i8), 0_i8)
      if (result%impacts == 1 .and. scene%sobol%dimensions > 1) word = scrambled_words(scene, number)
      at = cell_of(scene%dem, landing%patch, landing%u, landing%w)
      call find_rocks(scene, number, result%impacts, at, radius, u_ground)
      if (radius > huge(radius)) then
         result%status = absorbed
         return
      end if
      ground = 0
      if (level >= with_all .and. allocated(scene%grounds)) then
         call meet_ground(scene, at, radius, ground, obstacle, result%status)
         if (result%status == absorbed) return
      end if
      ratio = result%boulder%radius/radius
      if (level >= with_all .and. ground > 0) then
         if (allocated(scene%grounds(ground)%table)) then
            call contact_by_table(scene, scene%grounds(ground), number, ground, landing, v, ratio, uniform(word), &
                                  omega_r, level, result, flight, roll, scratch)
            return
         end if
      end if
      scratch%touch = touch_t()
      call find_class(scene, ratio, u_ground, class, outside)
      g = gradient(scene%dem, landing%patch, landing%u, landing%w)
      steepness = sqrt(1 + g(1)**2 + g(2)**2)
      call decompose(v, g, steepness, flight%heading, omega_r, v_in, heading)
      if (level >= with_all .and. ground > 0) then
         call ground_rebound(scene%grounds(ground), scene%table, scene%key, number, int(result%impacts, i8), &
                             word(:rebound_words), u_ground(roughness_word), result%boulder, &
                             inertia_of(scene, number), obstacle, scene%gravity/steepness, class, v_in, out)
         call see_ground_fit(scene%grounds(ground), class, v_in, outside, fast, steep, ratio)
         call count_ground(ground, scratch)
      else
         call rebound(scene%sets(class), scene%table, scene%key, number, int(result%impacts, i8), &
                      word(:rebound_words), v_in, out)
         call beyond_fit(scene%sets(class)%fitted, v_in(1:2), fast, steep)
      end if
      call count_outcome(out, outside, fast, steep, result)
      if (level >= with_lines .and. scene%histograms_requested) call count_rebound(scratch%histograms, v_in, out%v)
      turning = turning_t(scene%turning, uniform(word(turn_word)), merge(1.0_wp, -1.0_wp, btest(word(turn_word), 0)))
      if (turning%rule == by_lab) turning%lateral = lateral_angle(scene%lateral(class), v_in(1:2), turning%u)
      if (level >= with_all .and. ground > 0 .and. turning%rule == by_lab) then
         if (is_stochastic(scene%grounds(ground))) &
            turning%lateral = lateral_angle(scene%grounds(ground)%lateral(class), v_in(1:2), turning%u)
      end if
      call outgoing_flight(scene, landing, at, g, steepness, heading, turning, out%v, flight, omega_r)
      if (level >= with_all) then
         call record(scratch, contact_t(landing%x, landing%y, landing%z, result%time, flight%v, v_in, out%v, ratio))
         result%energy%ground = result%energy%ground &
                                + 0.5_wp*result%boulder%mass*(twice_energy(v_in) - twice_energy(out%v))
      end if
      call close_impact(scene, square(flight%v), result, slow)
      if (slow) call rest_or_roll(scene, ground, landing, square(flight%v), omega_r, result, roll)
   end subroutine handle_impact

   !> A contact that is drawn from a table: where it leads, or where the boulder stops.
   pure subroutine contact_by_table(scene, here, number, ground, landing, v, ratio, u, omega_r, level, result, flight, &
                                    roll, scratch)
      type(scene_t), intent(in) :: scene
      type(ground_t), intent(in) :: here
      integer(i8), intent(in) :: number
      integer, intent(in) :: ground          !! its number
      type(landing_t), intent(in) :: landing
      real(wp), intent(in) :: v(3)           !! incoming velocity [m/s]
      real(wp), intent(in) :: ratio          !! R_b/R_m [-]
      real(wp), intent(in) :: u(words_per_block)  !! uniform in (0, 1) [-]
      real(wp), intent(inout) :: omega_r     !! W [m/s]
      integer, value :: level                !! as in trace
      type(boulder_result_t), intent(inout) :: result
      type(flight_t), intent(inout) :: flight
      type(roll_t), intent(inout) :: roll
      type(scratch_t), intent(inout) :: scratch
      type(table_contact_t) :: contact
      real(wp) :: before

      before = square(v) + inertia_factor*omega_r*omega_r
      call keep_touch(ground, ratio, result%boulder%radius, landing%jump_height, scratch%touch)
      call table_contact(scene%dem, scene%gravity, here%table, result%boulder, inertia_of(scene, number), ratio, u, &
                         landing, v, flight%heading, omega_r, scratch%touch, roll, contact)
      call count_outcome(rebound_t(contact%v_out, forced=contact%limited), .false., contact%fast, .false., result)
      call count_ground(ground, scratch)
      if (scene%histograms_requested) call count_rebound(scratch%histograms, contact%v_in, contact%v_out)
      flight%v = roll%v
      flight%heading = roll%heading
      omega_r = roll%w
      if (level >= with_all) then
         call record(scratch, contact_t(landing%x, landing%y, landing%z, result%time, flight%v, contact%v_in, &
                                        contact%v_out, ratio))
         ! of a boulder that rolls on, V_n is in neither: it has it back at its next contact
         result%energy%ground = result%energy%ground + 0.5_wp*result%boulder%mass &
                                *(before - square(flight%v) - inertia_factor*omega_r*omega_r)
      end if
      result%speed_max = max(result%speed_max, square(flight%v))
      if (contact%stops) then
         scratch%touch = touch_t()
         call rest_or_roll(scene, ground, landing, square(flight%v), omega_r, result, roll)
      else if (result%impacts >= scene%max_impacts) then
         result%status = impact_limit
      end if
   end subroutine contact_by_table

   !> The radius of the rocks at a raster cell [m], and the random numbers of what a boulder meets there.
   pure subroutine find_rocks(scene, number, impact, at, radius, u_ground)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: number
      integer, intent(in) :: impact, at(2)
      real(wp), intent(out) :: radius, u_ground(words_per_block)

      u_ground = 0
      if (scene%ground_drawn) u_ground = ground_uniforms(scene, number, impact)
      radius = rock_radius(scene%surface, at, u_ground(obstacle_word))
   end subroutine find_rocks

   !> The impact set that serves a ratio R_b/R_m.
   pure subroutine find_class(scene, ratio, u_ground, class, outside)
      type(scene_t), intent(in) :: scene
      real(wp), intent(in) :: ratio, u_ground(words_per_block)
      integer, intent(out) :: class
      logical, intent(out) :: outside  !! of the ratios that sets are for

      call ratio_class(ratio, class, outside)
      if (scene%between_ratios) class = ratio_between(ratio, u_ground(ratio_word))
   end subroutine find_class

   !> Count a rebound, and what was odd about it.
   pure subroutine count_outcome(out, outside, fast, steep, result)
      type(rebound_t), intent(in) :: out
      logical, intent(in) :: outside, fast, steep
      type(boulder_result_t), intent(inout) :: result

      result%rebounds = result%rebounds + 1
      if (out%draws > 1) result%redrawn = result%redrawn + 1
      if (out%forced) result%forced = result%forced + 1
      if (outside) result%out_of_range = result%out_of_range + 1
      if (fast) result%out_of_speed = result%out_of_speed + 1
      if (steep) result%out_of_angle = result%out_of_angle + 1
   end subroutine count_outcome

   !> Count a rebound on a ground.
   pure subroutine count_ground(ground, scratch)
      integer, intent(in) :: ground
      type(scratch_t), intent(inout) :: scratch

      scratch%by_ground(ground) = scratch%by_ground(ground) + 1
   end subroutine count_ground

   !> Whether a boulder goes on after an impact, or is too slow to fly.
   pure subroutine close_impact(scene, speed2, result, slow)
      type(scene_t), intent(in) :: scene
      real(wp), intent(in) :: speed2  !! after it, |v|**2 [m2/s2]
      type(boulder_result_t), intent(inout) :: result
      logical, intent(out) :: slow

      result%speed_max = max(result%speed_max, speed2)
      slow = speed2 < scene%stop_speed**2
      if (.not. slow .and. result%impacts >= scene%max_impacts) result%status = impact_limit
   end subroutine close_impact

   !> Whether a boulder that is too slow to fly rests where it is, or rolls on.
   pure subroutine rest_or_roll(scene, ground, landing, speed2, omega_r, result, roll)
      type(scene_t), intent(in) :: scene
      integer, intent(in) :: ground    !! its number, where the scene has several
      type(landing_t), intent(in) :: landing
      real(wp), intent(in) :: speed2   !! as in close_impact
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

   !> The ground of a raster cell, the height of obstacles there, and whether it absorbs the boulder.
   pure subroutine meet_ground(scene, at, radius, ground, obstacle, status)
      type(scene_t), intent(in) :: scene
      integer, intent(in) :: at(2)          !! column, row from the north
      real(wp), intent(inout) :: radius     !! R_m; above zero afterwards [m]
      integer, intent(out) :: ground
      real(wp), intent(out) :: obstacle     !! [m]
      integer, intent(inout) :: status

      ground = ground_at(scene%surface, at)
      obstacle = radius/scene%surface%size_to_radius
      if (absorbs(scene%grounds(ground)%classical, obstacle)) status = absorbed
      radius = max(radius, smooth)
   end subroutine meet_ground

   !> Whether a rebound lies beyond what its impact set was fitted on; a classical one has none, and no ratio.
   pure subroutine see_ground_fit(ground, class, v_in, outside, fast, steep, ratio)
      type(ground_t), intent(in) :: ground
      integer, intent(in) :: class
      real(wp), intent(in) :: v_in(3)      !! V_t, V_n, W [m/s]
      logical, intent(inout) :: outside    !! of the ratios that sets are for
      logical, intent(out) :: fast, steep
      real(wp), intent(inout) :: ratio     !! R_b/R_m [-]

      fast = .false.
      steep = .false.
      if (is_stochastic(ground)) then
         call beyond_fit(ground%sets(class)%fitted, v_in(1:2), fast, steep)
      else
         outside = .false.
         ratio = -1
      end if
   end subroutine see_ground_fit

   !> The moment of inertia of a boulder, I/(m R_b**2) [-].
   pure real(wp) function inertia_of(scene, number)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: number

      inertia_of = inertia_factor
      if (allocated(scene%of_source)) inertia_of = scene%of_source(source_of(scene%release, number))%inertia
   end function inertia_of

   !> Numbers in (0, 1) [-] for what a boulder meets at a contact.
   pure function ground_uniforms(scene, number, impact) result(u)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: number
      integer, intent(in) :: impact
      integer(i8) :: word(words_per_block)
      real(wp) :: u(words_per_block)

      word = random_words(scene%key, for_ground, number, int(impact, i8), 0_i8)
      if (impact == 1 .and. scene%sobol%dimensions > 1) &
         word(obstacle_word) = scrambled_word(scene, number, obstacle_dimension)
      u = uniform(word)
   end function ground_uniforms

   !> The next flight: V_t_out in the tangent plane over the new heading h, along (h, g.h)/sqrt(1 + (g.h)**2), V_n_out
   !> along the normal. A negative V_t_out turns the heading round first. The height above the patch grows at
   !> v.(-g, 1) = V_n_out sqrt(1 + |g|**2) (theory, chapters 5 and 6).
   pure subroutine outgoing_flight(scene, landing, at, g, steepness, before, turning, v_out, flight, omega_r)
      type(scene_t), intent(in) :: scene
      type(landing_t), intent(in) :: landing
      integer, intent(in) :: at(2)            !! raster cell of the contact
      real(wp), intent(in) :: g(2)            !! gradient of the patch [-]
      real(wp), intent(in) :: steepness       !! sqrt(1 + |g|**2) [-]
      real(wp), intent(in) :: before(2)       !! heading [-]; zero after a vertical impact on the flat
      type(turning_t), intent(in) :: turning
      real(wp), intent(in) :: v_out(3)        !! V_t, V_n, W [m/s]
      type(flight_t), intent(inout) :: flight
      real(wp), intent(out) :: omega_r        !! W [m/s]
      real(wp) :: heading(2), descent(2)
      logical :: pit

      call cell_descent(scene%dem, at, g, descent, pit)
      heading = before
      if (all(heading == 0)) heading = unit_vector(descent)
      if (all(heading == 0)) heading = any_heading(turning%u)
      omega_r = v_out(3)
      if (v_out(1) < 0) then
         heading = -heading
         omega_r = -omega_r
      end if
      heading = new_heading(turning, heading, g, descent, pit)
      call launch_velocity(v_out(1), v_out(2), heading(1), heading(2), g(1), g(2), steepness, &
                           flight%v(1), flight%v(2), flight%v(3))
      flight%rate = v_out(2)*steepness
      flight%heading = heading
      call start_from(landing, flight)
   end subroutine outgoing_flight

   !> Start a flight on the ground, where the last one landed.
   pure subroutine start_from(landing, flight)
      type(landing_t), intent(in) :: landing
      type(flight_t), intent(inout) :: flight

      flight%above = 0
      flight%x = landing%x
      flight%y = landing%y
      flight%z = landing%z
      flight%patch = landing%patch
   end subroutine start_from

   !> |v|**2 [m2/s2].
   pure real(wp) function square(v)
      real(wp), intent(in) :: v(3)  !! [m/s]

      square = v(1)*v(1) + v(2)*v(2) + v(3)*v(3)
   end function square

   !> Add a vertex to the record, if there is one; counts on when it is full, so that the caller knows what it needs.
   pure subroutine record(scratch, vertex)
      type(scratch_t), intent(inout) :: scratch
      type(contact_t), intent(in) :: vertex

      if (.not. allocated(scratch%record)) return
      scratch%recorded = scratch%recorded + 1
      if (scratch%recorded <= size(scratch%record)) scratch%record(scratch%recorded) = vertex
   end subroutine record
end module rockfall_trajectory
