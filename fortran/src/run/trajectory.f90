! SPDX-License-Identifier: BSD-3-Clause
!> One boulder from release to rest: fly, land, ask what the slope is made of, rebound, turn, fly again.
!> A pure function of the scene and the boulder's number.
module rockfall_trajectory
   use rockfall_kinds, only: wp, i8
   use rockfall_random, only: random_key_t, normal_table_t, random_words, four_words, uniform, for_impact, &
                              for_ratio
   use rockfall_sobol, only: sobol_t, sobol_word, scrambled
   use rockfall_terrain, only: terrain_t, patch_t, in_window, locate, height, gradient, cell_of, cell_descent
   use rockfall_surface, only: surface_t, rock_radius
   use rockfall_boulder, only: boulder_t, boulder_law_t, release_t, draw_boulder, source_of, first_of, &
                               spin_inertia
   use rockfall_flight, only: flight_t, landing_t, span_t, fly, launch_rate, arc_length
   use rockfall_impact, only: impact_set_t, impact_ratios, ratio_class, ratio_between, beyond_fit, rebound_t, rebound
   use rockfall_direction, only: turning_t, lateral_t, past_aspect, by_lab, lateral_angle, new_heading, unit_vector, &
                                 any_heading
   use rockfall_line, only: line_t, first_crossing
   use rockfall_map, only: visits_t, start_visits, visit_spans, visit_cell
   use rockfall_histogram, only: histograms_t, count_rebound
   implicit none
   private
   public :: scene_t, fate_t, crossing_t, contact_t, scratch_t, follow, choose_follow
   public :: stopped, absorbed, left_domain, impact_limit, left_window

   integer, parameter :: stopped = 1, absorbed = 2, left_domain = 3, impact_limit = 4  !! status
   integer, parameter :: left_window = 5  !! the terrain goes on, but is not at hand: to be flown again

   !> What is noted on the way besides the boulder's fate, if it is wanted: nothing; lines and histograms; visits of
   !> raster cells too; vertices of the trajectory too.
   integer, parameter :: fate_only = 0, notes = 1, cells = 2, vertices = 3

   !> Everything that a boulder needs to know; the same for all boulders of a run.
   type :: scene_t
      type(random_key_t) :: key            !! from the seed
      type(normal_table_t) :: table
      type(sobol_t) :: sobol               !! of the volume and of the words of the first rebound
      type(terrain_t) :: dem
      type(surface_t) :: surface
      type(impact_set_t) :: sets(impact_ratios)
      logical :: between_ratios = .false.  !! a ratio between two sets is served by either, by chance
      integer :: turning = past_aspect     !! rule of turning_t
      type(lateral_t), allocatable :: lateral(:)  !! of each ratio; only by_lab
      type(boulder_law_t) :: law
      type(release_t) :: release
      type(line_t), allocatable :: lines(:)
      real(wp) :: gravity = 9.81_wp        !! [m/s2]
      real(wp) :: stop_speed = 0.5_wp      !! after a rebound [m/s]
      integer :: most_impacts = 100000
      logical :: wants_cells = .false.     !! visits of raster cells
      logical :: wants_histograms = .false.
   end type scene_t

   !> What became of a boulder.
   type :: fate_t
      type(boulder_t) :: boulder
      integer :: status = 0
      integer :: impacts = 0               !! contacts with the slope
      real(wp) :: start(3) = 0.0_wp, stop(3) = 0.0_wp  !! local coordinates [m]
      integer :: stop_cell(2) = 0          !! column, row; only with a contact
      real(wp) :: path_length = 0.0_wp     !! along the flights [m]
      real(wp) :: time = 0.0_wp            !! [s]
      real(wp) :: speed_max = 0.0_wp       !! [m/s]
      real(wp) :: jump_height_max = 0.0_wp !! [m]
      integer :: rebounds = 0, redrawn = 0, forced = 0
      integer :: out_of_range = 0, out_of_speed = 0, out_of_angle = 0  !! rebounds beyond what a set was fitted on
   end type fate_t

   !> First crossing of an evaluation line.
   type :: crossing_t
      logical :: crossed = .false.
      real(wp) :: x = 0, y = 0, time = 0  !! local coordinates [m], since release [s]
      real(wp) :: v(3) = 0, omega = 0  !! [m/s], [rad/s]
      real(wp) :: jump_height = 0      !! point above the surface [m]
      real(wp) :: passing_height = 0   !! centre of the sphere above the surface, vertical [m]
   end type crossing_t

   !> One vertex of a recorded trajectory: the release, each contact, the end.
   type :: contact_t
      real(wp) :: x = 0, y = 0, z = 0, time = 0  !! local coordinates [m], since release [s]
      real(wp) :: v(3) = 0                   !! velocity after it [m/s]
      real(wp) :: v_in(3) = 0, v_out(3) = 0  !! V_t, V_n, W before and after; 0 without a rebound [m/s]
      real(wp) :: ratio = 0            !! R_b/R_m; 0 without a rebound
   end type contact_t

   !> A thread's work space; what a scene does not ask for is not allocated.
   type :: scratch_t
      type(span_t), allocatable :: spans(:)
      type(visits_t) :: visits
      type(histograms_t) :: histograms
      type(crossing_t), allocatable :: crossings(:)
      type(contact_t), allocatable :: record(:)  !! allocated by who wants the trajectory
      integer :: recorded = 0                    !! vertices there were, also beyond size(record)
      procedure(follow), pointer, nopass :: follow => null()  !! what the scene needs of `follow`
   end type scratch_t

contains

   !> Follow boulder `number` (1..) from release to its end, and note what is asked for on the way.
   pure subroutine follow(scene, number, fate, scratch)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: number
      type(fate_t), intent(out) :: fate
      type(scratch_t), intent(inout) :: scratch

      call travel(scene, number, fate, scratch, vertices)
   end subroutine follow

   !> The same without a record.
   pure subroutine follow_over_cells(scene, number, fate, scratch)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: number
      type(fate_t), intent(out) :: fate
      type(scratch_t), intent(inout) :: scratch

      call travel(scene, number, fate, scratch, cells)
   end subroutine follow_over_cells

   !> The same without maps either.
   pure subroutine follow_off_the_map(scene, number, fate, scratch)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: number
      type(fate_t), intent(out) :: fate
      type(scratch_t), intent(inout) :: scratch

      call travel(scene, number, fate, scratch, notes)
   end subroutine follow_off_the_map

   !> The same when only the boulder's fate is asked for.
   pure subroutine follow_to_its_fate(scene, number, fate, scratch)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: number
      type(fate_t), intent(out) :: fate
      type(scratch_t), intent(inout) :: scratch

      call travel(scene, number, fate, scratch, fate_only)
   end subroutine follow_to_its_fate

   !> Choose, once a run, the `follow` in which the compiler has left out what the scene does not need. Tests alone
   !> would not do: beside code that may run, the compiler does not keep a flight in registers.
   subroutine choose_follow(scene, scratch)
      type(scene_t), intent(in) :: scene
      type(scratch_t), intent(inout) :: scratch

      scratch%follow => follow_to_its_fate
      if (allocated(scene%lines) .or. scene%wants_histograms) scratch%follow => follow_off_the_map
      if (scene%wants_cells) scratch%follow => follow_over_cells
   end subroutine choose_follow

   !> All that `follow` is. Wherever it is called `noted` is a constant, so that each gets a copy of its own.
   pure subroutine travel(scene, number, fate, scratch, noted)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: number
      type(fate_t), intent(out) :: fate
      type(scratch_t), intent(inout) :: scratch
      integer, value :: noted  !! fate_only, ..., vertices
      type(flight_t) :: flight
      type(landing_t) :: landing
      real(wp) :: omega_r  !! W = R_b omega [m/s]
      real(wp) :: v_in(3)  !! velocity at a contact [m/s]

      if (scene%sobol%dimensions > 0) then
         fate%boulder = draw_boulder(scene%law, scene%table, scene%key, number, even_word(scene, number, 1))
      else
         fate%boulder = draw_boulder(scene%law, scene%table, scene%key, number)
      end if
      call release(scene, number, flight)
      fate%start = [flight%x, flight%y, flight%z]
      if (.not. flight%patch%known) then
         fate%status = left_window
         fate%stop = fate%start
         return
      end if
      fate%speed_max = square(flight%v)
      omega_r = 0
      if (noted >= cells .and. scene%wants_cells) call start_visits(scratch%visits, number)
      if (noted >= notes .and. allocated(scratch%crossings)) scratch%crossings%crossed = .false.
      scratch%recorded = 0
      if (noted >= vertices) call record(scratch, contact_t(flight%x, flight%y, flight%z, 0.0_wp, flight%v))
      do
         if (noted >= cells .and. scene%wants_cells) then
            call fly_over_cells(scene, flight, omega_r, landing, scratch)
         else
            call fly(scene%dem, scene%gravity, flight, landing)
         end if
         if (noted >= notes .and. allocated(scene%lines)) then
            call meet_lines(scene, fate, flight, landing, omega_r, scratch%crossings)
         end if
         v_in = flight%v
         v_in(3) = v_in(3) - scene%gravity*landing%time
         fate%path_length = fate%path_length + arc_length(flight%v, scene%gravity, landing%time)
         fate%time = fate%time + landing%time
         fate%speed_max = max(fate%speed_max, square(v_in))
         fate%jump_height_max = max(fate%jump_height_max, landing%jump_height)
         if (.not. landing%contact) then
            fate%status = merge(left_domain, left_window, at_end(scene%dem, landing%patch))
         else
            fate%impacts = fate%impacts + 1
            call touch(scene, number, landing, v_in, omega_r, noted, fate, flight, scratch)
         end if
         if (fate%status /= 0) exit
      end do
      if (noted >= vertices .and. (fate%status == absorbed .or. fate%status == left_domain)) then
         call record(scratch, contact_t(landing%x, landing%y, landing%z, fate%time, v_in))
      end if
      fate%speed_max = sqrt(fate%speed_max)
      fate%stop = [landing%x, landing%y, landing%z]
      if (.not. landing%contact) return
      fate%stop_cell = cell_of(scene%dem, landing%patch, landing%u, landing%w)
      if (noted >= cells .and. scene%wants_cells) call visit_cell(scratch%visits, fate%stop_cell, 0.0_wp, 0.0_wp, 0.0_wp)
   end subroutine travel

   !> Whether the terrain ends at a patch that is not known: beyond the raster, or beside nodata.
   pure logical function at_end(dem, patch)
      type(terrain_t), intent(in) :: dem
      type(patch_t), intent(in) :: patch

      at_end = in_window(dem, patch%i, patch%j) .or. min(patch%i, patch%j) < 1 &
               .or. patch%i >= dem%nx .or. patch%j >= dem%ny
   end function at_end

   !> A word of the boulder's scrambled Sobol' point: 1 for its volume, then those of its first draw of A.
   pure integer(i8) function even_word(scene, number, dimension)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: number
      integer, intent(in) :: dimension
      integer(i8) :: source, index

      source = source_of(scene%release, number)
      index = number - first_of(scene%release, source)
      even_word = scrambled(sobol_word(scene%sobol, index, dimension), scene%key, source, dimension)
   end function even_word

   !> Those of the first draw of A. All at once: an index that varies would keep the usual words in memory.
   pure function even_words(scene, number) result(word)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: number
      integer(i8) :: word(12)
      integer :: k

      do k = 1, size(word)
         word(k) = even_word(scene, number, k + 1)
      end do
   end function even_words

   !> The start of the first flight: above the source, at rest or with the velocity of the release.
   pure subroutine release(scene, number, flight)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: number
      type(flight_t), intent(out) :: flight
      integer(i8) :: source
      real(wp) :: u, w

      source = source_of(scene%release, number) - scene%release%before
      flight%x = scene%release%x(source)
      flight%y = scene%release%y(source)
      associate (dem => scene%dem)
         call locate(dem, flight%x, flight%y, flight%patch, u, w)
         flight%above = scene%release%drop_height
         flight%z = height(flight%patch, u, w) + flight%above
         flight%v = scene%release%velocity
         flight%rate = launch_rate(dem, flight%patch, u, w, flight%v)
      end associate
   end subroutine release

   !> Fly, and note the raster cells on the way.
   pure subroutine fly_over_cells(scene, flight, omega_r, landing, scratch)
      type(scene_t), intent(in) :: scene
      type(flight_t), intent(in) :: flight
      real(wp), intent(in) :: omega_r
      type(landing_t), intent(out) :: landing
      type(scratch_t), intent(inout) :: scratch
      integer :: n

      call fly(scene%dem, scene%gravity, flight, landing, scratch%spans, n)
      call visit_spans(scratch%visits, scene%dem, scene%gravity, flight%x, flight%y, flight%v, &
                       spin_inertia*omega_r**2, scratch%spans(:n))
   end subroutine fly_over_cells

   !> Record the lines that a flight crosses for the first time.
   pure subroutine meet_lines(scene, fate, flight, landing, omega_r, crossings)
      type(scene_t), intent(in) :: scene
      type(fate_t), intent(in) :: fate
      type(flight_t), intent(in) :: flight
      type(landing_t), intent(in) :: landing
      real(wp), intent(in) :: omega_r
      type(crossing_t), intent(inout) :: crossings(:)
      real(wp) :: share
      integer :: k

      do k = 1, size(scene%lines)
         if (crossings(k)%crossed) cycle
         share = first_crossing(scene%lines(k), [flight%x, flight%y], [landing%x, landing%y])
         if (share <= 1) crossings(k) = crossing(scene, fate, flight, share*landing%time, omega_r)
      end do
   end subroutine meet_lines

   !> The state of a boulder in flight, `t` after the flight's start.
   pure type(crossing_t) function crossing(scene, fate, flight, t, omega_r) result(c)
      type(scene_t), intent(in) :: scene
      type(fate_t), intent(in) :: fate
      type(flight_t), intent(in) :: flight
      real(wp), intent(in) :: t, omega_r
      type(patch_t) :: patch
      real(wp) :: u, w, g(2)

      c%crossed = .true.
      c%time = fate%time + t
      c%x = flight%x + flight%v(1)*t
      c%y = flight%y + flight%v(2)*t
      c%v = [flight%v(1), flight%v(2), flight%v(3) - scene%gravity*t]
      c%omega = omega_r/fate%boulder%radius
      associate (dem => scene%dem)
         call locate(dem, c%x, c%y, patch, u, w)
         c%jump_height = max(0.0_wp, flight%z + t*(flight%v(3) - 0.5_wp*scene%gravity*t) - height(patch, u, w))
         g = gradient(dem, patch, u, w)
         c%passing_height = c%jump_height + fate%boulder%radius*sqrt(1 + g(1)**2 + g(2)**2)
      end associate
   end function crossing

   !> A contact: absorbed, stopped, or off again on the next flight.
   pure subroutine touch(scene, number, landing, v, omega_r, noted, fate, flight, scratch)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: number
      type(landing_t), intent(in) :: landing
      real(wp), intent(in) :: v(3)          !! incoming velocity [m/s]
      real(wp), intent(inout) :: omega_r    !! W [m/s]
      integer, value :: noted               !! as in travel
      type(fate_t), intent(inout) :: fate
      type(flight_t), intent(inout) :: flight
      type(scratch_t), intent(inout) :: scratch
      integer(i8) :: word(12)
      integer :: at(2), class
      logical :: outside, fast, steep
      real(wp) :: radius, ratio, v_in(3), heading(2), g(2), steepness
      type(rebound_t) :: out
      type(turning_t) :: turning

      word = random_words(scene%key, for_impact, number, int(fate%impacts, i8), 0_i8)
      if (fate%impacts == 1 .and. scene%sobol%dimensions > 1) word = even_words(scene, number)
      at = cell_of(scene%dem, landing%patch, landing%u, landing%w)
      radius = rock_radius(scene%surface, at, uniform(word(12)))
      if (radius > huge(radius)) then
         fate%status = absorbed
         return
      end if
      ratio = fate%boulder%radius/radius
      call ratio_class(ratio, class, outside)
      if (scene%between_ratios) class = ratio_between(ratio, ratio_chance(scene%key, number, fate%impacts))
      g = gradient(scene%dem, landing%patch, landing%u, landing%w)
      steepness = sqrt(1 + g(1)**2 + g(2)**2)
      call decompose(v, g, steepness, flight%heading, omega_r, v_in, heading)
      call rebound(scene%sets(class), scene%table, scene%key, number, int(fate%impacts, i8), word(1:9), v_in, out)
      fate%rebounds = fate%rebounds + 1
      if (out%draws > 1) fate%redrawn = fate%redrawn + 1
      if (out%forced) fate%forced = fate%forced + 1
      if (outside) fate%out_of_range = fate%out_of_range + 1
      call beyond_fit(scene%sets(class)%fitted, v_in(1:2), fast, steep)
      if (fast) fate%out_of_speed = fate%out_of_speed + 1
      if (steep) fate%out_of_angle = fate%out_of_angle + 1
      if (noted >= notes .and. scene%wants_histograms) call count_rebound(scratch%histograms, v_in, out%v)
      turning = turning_t(scene%turning, uniform(word(10)), uniform(word(11)), merge(1.0_wp, -1.0_wp, btest(word(11), 0)))
      if (turning%rule == by_lab) turning%lateral = lateral_angle(scene%lateral(class), v_in(1:2), turning%class)
      call leave(scene, landing, at, g, steepness, heading, turning, out%v, flight, omega_r)
      if (noted >= vertices) then
         call record(scratch, contact_t(landing%x, landing%y, landing%z, fate%time, flight%v, v_in, out%v, ratio))
      end if
      fate%speed_max = max(fate%speed_max, square(flight%v))
      if (square(flight%v) < scene%stop_speed**2) then
         fate%status = stopped
      else if (fate%impacts >= scene%most_impacts) then
         fate%status = impact_limit
      end if
   end subroutine touch

   !> A number in (0, 1) that chooses between two sets, at a contact of a boulder.
   pure real(wp) function ratio_chance(key, number, impact)
      type(random_key_t), intent(in) :: key
      integer(i8), intent(in) :: number
      integer, intent(in) :: impact
      integer(i8) :: word(4)

      word = four_words(key, for_ratio, number, int(impact, i8), 0_i8)
      ratio_chance = uniform(word(1))
   end function ratio_chance

   !> The incoming velocity in the plane of the surface normal and the tangent of travel
   !> (V_t >= 0, V_n <= 0, W), and the plan heading of that tangent; zero when there is none.
   pure subroutine decompose(v, g, steepness, before, omega_r, v_in, heading)
      real(wp), intent(in) :: v(3), g(2)  !! velocity [m/s], gradient of the patch [-]
      real(wp), intent(in) :: steepness   !! sqrt(1 + g**2)
      real(wp), intent(in) :: before(2)   !! heading after the last rebound
      real(wp), intent(in) :: omega_r     !! W with respect to it [m/s]
      real(wp), intent(out) :: v_in(3), heading(2)
      real(wp) :: normal(3), tangential(3)

      normal = [-g(1), -g(2), 1.0_wp]*(1/steepness)
      v_in(2) = dot_product(v, normal)
      tangential = v - v_in(2)*normal
      v_in(1) = sqrt(square(tangential))
      v_in(2) = min(0.0_wp, v_in(2))
      heading = unit_vector(tangential(1:2))
      ! What rolled forward seen from the heading before rolls backward seen from an opposite one.
      v_in(3) = omega_r
      if (before(1)*heading(1) + before(2)*heading(2) < 0) v_in(3) = -omega_r
   end subroutine decompose

   !> The next flight: V_t_out in the tangent plane over the new heading, V_n_out along the normal.
   !> A negative V_t_out turns the heading round first.
   pure subroutine leave(scene, landing, at, g, steepness, before, turning, v_out, flight, omega_r)
      type(scene_t), intent(in) :: scene
      type(landing_t), intent(in) :: landing
      integer, intent(in) :: at(2)            !! raster cell of the contact
      real(wp), intent(in) :: g(2)            !! gradient of the patch [-]
      real(wp), intent(in) :: steepness       !! sqrt(1 + g**2)
      real(wp), intent(in) :: before(2)       !! heading; zero after a vertical impact on the flat
      type(turning_t), intent(in) :: turning
      real(wp), intent(in) :: v_out(3)        !! V_t, V_n, W [m/s]
      type(flight_t), intent(inout) :: flight
      real(wp), intent(out) :: omega_r        !! W [m/s]
      real(wp) :: heading(2), descent(2), along
      logical :: pit

      call cell_descent(scene%dem, at, g, descent, pit)
      heading = before
      if (all(heading == 0)) heading = unit_vector(descent)
      if (all(heading == 0)) heading = any_heading(turning%within)
      omega_r = v_out(3)
      if (v_out(1) < 0) then
         heading = -heading
         omega_r = -omega_r
      end if
      heading = new_heading(turning, heading, g, descent, pit)
      along = dot_product(g, heading)
      flight%v = (abs(v_out(1))/sqrt(1 + along**2))*[heading(1), heading(2), along] &
                 + (v_out(2)/steepness)*[-g(1), -g(2), 1.0_wp]
      flight%rate = v_out(2)*steepness
      flight%heading = heading
      flight%above = 0
      flight%x = landing%x
      flight%y = landing%y
      flight%z = landing%z
      flight%patch = landing%patch
   end subroutine leave

   pure real(wp) function square(v)
      real(wp), intent(in) :: v(3)

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
