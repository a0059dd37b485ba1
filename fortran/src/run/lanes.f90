! SPDX-License-Identifier: BSD-3-Clause
!> Boulders in lanes: a thread carries a pool of them on from contact to contact. Flights are flown one by one; what
!> comes after is the same for all and is computed for several at a time, in loops over the contacts of the pool.
!> Each lane does what `trace` does, in the same order, so the bits are the same.
!>
!> The file is compiled twice, the second time for processors with AVX2, as the module rockfall_wide_lanes.
module rockfall_lanes
   use rockfall_kinds, only: wp, i8
   use rockfall_math, only: real_of
   use rockfall_random, only: philox, for_impact, words_per_block, purpose_bit, normal, uniform
   use rockfall_terrain, only: gradient, cell_of, read_window, horn
   use rockfall_flight, only: flight_t, landing_t, span_t, fly, parabola_length
   use rockfall_impact, only: impact_set_t, impact_ratios, rebound_t, first_draw, draw_again, energy_of, &
                              beyond_fit
   use rockfall_direction, only: turn_past_aspect, divide_by_length, shortest
   use rockfall_trajectory, only: scene_t, boulder_result_t, crossing_t, scratch_t, start_boulder, end_boulder, &
                                  clear, departure, fly_over_cells, record_crossings, handle_impact, find_rocks, &
                                  find_class, count_outcome, close_impact, start_from, in_local_frame, rolled_before, &
                                  launch_velocity, meet_ground, count_ground, with_all, absorbed
   use rockfall_ground, only: is_stochastic
   use rockfall_tallies, only: totals_t, prepare, add_boulder
   use rockfall_maps, only: maps_t, needs_visits
   use rockfall_histogram, only: count_rebound
   implicit none
   private
   public :: run_in_lanes

   integer, parameter :: lanes = 64  !! boulders of a pool
   integer, parameter :: lanes_over_cells = 16  !! where cells are noted: those of more boulders leave the cache
   integer, parameter :: batch = 16  !! boulders that a thread takes at a time

   !> A boulder on its way.
   type :: lane_t
      integer :: place              !! in the results
      integer :: scratch            !! its work space
      type(flight_t) :: flight
      type(landing_t) :: landing
      real(wp) :: omega_r = 0.0_wp  !! W = R_b omega [m/s]
      integer :: at(2)              !! raster cell of the contact
      integer :: ground             !! of the scene, where it has several
      integer :: set                !! of all its impact sets; past them: no contact, or a classical one
      logical :: outside            !! of the ratios that sets are for
   end type lane_t

   !> All impact sets of a scene, those of a ground one after the other.
   type :: laws_t
      type(impact_set_t), allocatable :: set(:)
      integer, allocatable :: before(:)  !! sets before those of each ground; -1: it has none
   end type laws_t

   !> The contacts of the pool, in the order of their impact sets.
   type :: contacts_t
      integer :: n = 0
      integer :: met = 0                                 !! those that follow an impact set
      integer, allocatable :: first(:)                   !! of each set, and of none
      integer :: lane(lanes)
      integer(i8), dimension(lanes) :: number, impact
      real(wp), dimension(lanes) :: v1, v2, v3           !! of the flight: its start, its end, then of the next [m/s]
      real(wp), dimension(lanes) :: time                 !! of the flight [s]
      real(wp), dimension(lanes) :: length               !! of it [m]
      real(wp), dimension(lanes) :: speed2_in, speed2    !! at its end, of the next [m2/s2]
      integer :: draws(lanes)
      logical :: forced(lanes)
      real(wp), dimension(lanes) :: w, next_w            !! W = R_b omega before it, of the next [m/s]
      real(wp), dimension(lanes) :: heading1, heading2   !! [-]
      real(wp), dimension(lanes) :: g1, g2, steepness    !! of the patch [-]
      real(wp), dimension(lanes) :: tangential, normal   !! V_t, V_n before it [m/s]
      real(wp), dimension(lanes) :: out1, out2, out3     !! V_t, V_n, W after it [m/s]
      real(wp), dimension(lanes) :: rate                 !! of the next flight [m/s]
      real(wp), dimension(lanes) :: admissible, usual    !! 1 or 0
      real(wp), dimension(lanes) :: z1, z2, z3, u, side  !! random numbers [-]
      real(wp), dimension(lanes, 9) :: z                 !! elevations of the cell and its neighbours [m]
   end type contacts_t

contains

   !> One thread's part of the boulders: as many as it gets of `next`, which all threads share.
   subroutine run_in_lanes(scene, first, results, crossings, maps, next, spans, totals)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: first                    !! number of the first boulder
      type(boulder_result_t), intent(inout) :: results(:)
      type(crossing_t), intent(inout) :: crossings(:, :)  !! (lines, boulders)
      type(maps_t), intent(in) :: maps                    !! none by source
      integer, intent(inout) :: next                      !! place of the next boulder
      type(span_t), intent(inout), contiguous :: spans(:)             !! of a flight
      type(totals_t), intent(inout) :: totals
      type(lane_t) :: lane(lanes)
      type(scratch_t), allocatable :: scratch(:)
      type(contacts_t) :: contacts
      type(laws_t) :: laws
      integer :: n, from, to, k, room

      laws = laws_of(scene)
      room = merge(lanes_over_cells, lanes, needs_visits(maps))
      allocate (scratch(room), contacts%first(size(laws%set) + 1))
      do k = 1, room
         call prepare(scene, maps, scratch(k))
         lane(k)%scratch = k
      end do
      n = 0
      from = 1
      to = 0
      do
         call refill(scene, first, results, next, from, to, lane(:room), scratch, n)
         if (n == 0) exit
         call fly_all(scene, results, lane(:n), scratch, spans)
         call land_all(scene, laws, first, results, lane(:n), scratch)
         call gather(scene, first, results, lane(:n), contacts)
         call land(contacts, scene%gravity)
         call meet(contacts)
         call draw(scene, laws, contacts)
         call redraw(scene, laws, contacts)
         call turn(contacts, scene%dem%per_cell)
         call go_on(scene, laws, results, lane, contacts, scratch)
         call take_out(scene, results, crossings, maps, lane, scratch, totals, n)
      end do
   end subroutine run_in_lanes

   !> The impact sets of the scene: the case's, or those of its grounds.
   pure type(laws_t) function laws_of(scene) result(laws)
      type(scene_t), intent(in) :: scene
      integer :: ground, n

      if (.not. allocated(scene%grounds)) then
         laws%set = scene%sets
         laws%before = [0]
         return
      end if
      allocate (laws%before(size(scene%grounds)), source=-1)
      n = 0
      do ground = 1, size(scene%grounds)
         if (.not. is_stochastic(scene%grounds(ground))) cycle
         laws%before(ground) = n
         n = n + impact_ratios
      end do
      allocate (laws%set(n))
      do ground = 1, size(scene%grounds)
         n = laws%before(ground)
         if (n >= 0) laws%set(n + 1:n + impact_ratios) = scene%grounds(ground)%sets
      end do
   end function laws_of

   !> Fill the pool with the next boulders.
   subroutine refill(scene, first, results, next, from, to, lane, scratch, n)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: first
      type(boulder_result_t), intent(inout) :: results(:)
      integer, intent(inout) :: next, from, to  !! from..to are this thread's
      type(lane_t), intent(inout) :: lane(:)
      type(scratch_t), intent(inout) :: scratch(:)
      integer, intent(inout) :: n

      do while (n < size(lane))
         if (from > to) then
            !$omp atomic capture
            from = next
            next = next + batch
            !$omp end atomic
            to = min(from + batch - 1, size(results))
            if (from > to) return
         end if
         n = n + 1
         lane(n)%place = from
         lane(n)%omega_r = 0
         call start_boulder(scene, first + from - 1, with_all, results(from), lane(n)%flight)
         call clear(scene, with_all, scratch(lane(n)%scratch))
         if (results(from)%status /= 0) n = n - 1
         from = from + 1
      end do
   end subroutine refill

   !> Fly each boulder to its next contact, or out of the terrain.
   subroutine fly_all(scene, results, lane, scratch, spans)
      type(scene_t), intent(in) :: scene
      type(boulder_result_t), intent(in) :: results(:)
      type(lane_t), intent(inout) :: lane(:)
      type(scratch_t), intent(inout) :: scratch(:)
      type(span_t), intent(inout), contiguous :: spans(:)
      integer :: k

      if (scratch(1)%cells_requested) then
         do k = 1, size(lane)
            call fly_over_cells(scene, lane(k)%flight, lane(k)%omega_r, results(lane(k)%place)%time, lane(k)%landing, &
                                scratch(lane(k)%scratch), spans)
         end do
      else
         do k = 1, size(lane)
            call fly(scene%dem, scene%gravity, lane(k)%flight, lane(k)%landing)
         end do
      end if
   end subroutine fly_all

   !> Record the lines that they crossed, and look up the impact sets where they landed.
   subroutine land_all(scene, laws, first, results, lane, scratch)
      type(scene_t), intent(in) :: scene
      type(laws_t), intent(in) :: laws
      integer(i8), intent(in) :: first
      type(boulder_result_t), intent(inout) :: results(:)
      type(lane_t), intent(inout) :: lane(:)
      type(scratch_t), intent(inout) :: scratch(:)
      real(wp) :: radius, obstacle, u_ground(words_per_block)
      integer :: k, p, class, none

      none = size(laws%set) + 1
      do k = 1, size(lane)
         p = lane(k)%place
         lane(k)%ground = 1
         lane(k)%set = none
         associate (result => results(p), landing => lane(k)%landing)
            if (allocated(scene%lines)) call record_crossings(scene, result, lane(k)%flight, landing, lane(k)%omega_r, &
                                                              scratch(lane(k)%scratch)%crossings)
            if (.not. landing%contact) then
               result%status = departure(scene%dem, landing%patch)
               cycle
            end if
            result%impacts = result%impacts + 1
            lane(k)%at = cell_of(scene%dem, landing%patch, landing%u, landing%w)
            call find_rocks(scene, first + p - 1, result%impacts, lane(k)%at, radius, u_ground)
            if (radius > huge(radius)) then
               result%status = absorbed
            else if (allocated(scene%grounds)) then
               call meet_ground(scene, lane(k)%at, radius, lane(k)%ground, obstacle, result%status)
            end if
            if (result%status == absorbed .or. laws%before(lane(k)%ground) < 0) cycle
            call find_class(scene, result%boulder%radius/radius, u_ground, class, lane(k)%outside)
            lane(k)%set = laws%before(lane(k)%ground) + class
         end associate
      end do
   end subroutine land_all

   !> The lanes in the order of their impact sets; those without one at the end.
   subroutine gather(scene, first, results, lane, c)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: first
      type(boulder_result_t), intent(in) :: results(:)
      type(lane_t), intent(in) :: lane(:)
      type(contacts_t), intent(inout) :: c
      integer :: count(size(c%first)), slot(size(c%first))
      integer :: none, set, k, n

      none = size(c%first)
      count = 0
      do k = 1, size(lane)
         count(lane(k)%set) = count(lane(k)%set) + 1
      end do
      n = 1
      do set = 1, none
         c%first(set) = n
         n = n + count(set)
      end do
      c%met = c%first(none) - 1
      slot = c%first
      do k = 1, size(lane)
         n = slot(lane(k)%set)
         slot(lane(k)%set) = n + 1
         c%lane(n) = k
         call load(scene, first, results(lane(k)%place), lane(k), c, n)
      end do
      c%n = size(lane)
   end subroutine gather

   !> What the loops need of a lane.
   subroutine load(scene, first, result, lane, c, n)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: first
      type(boulder_result_t), intent(in) :: result
      type(lane_t), intent(in) :: lane
      type(contacts_t), intent(inout) :: c
      integer, intent(in) :: n
      real(wp) :: z(3, 3), g(2)
      integer :: row
      logical :: complete

      c%number(n) = first + lane%place - 1
      c%impact(n) = result%impacts
      c%v1(n) = lane%flight%v(1)
      c%v2(n) = lane%flight%v(2)
      c%v3(n) = lane%flight%v(3)
      c%time(n) = lane%landing%time
      c%w(n) = lane%omega_r
      c%heading1(n) = lane%flight%heading(1)
      c%heading2(n) = lane%flight%heading(2)
      if (lane%set == size(c%first)) then
         c%usual(n) = 0
         return
      end if
      g = gradient(scene%dem, lane%landing%patch, lane%landing%u, lane%landing%w)
      c%g1(n) = g(1)
      c%g2(n) = g(2)
      call read_window(scene%dem, lane%at, z, complete)
      if (result%impacts == 1 .and. scene%sobol%dimensions > 1) z = 0  ! a flat cell is no usual one: see `turn`
      do row = 1, 3
         c%z(n, 3*row - 2) = z(1, row)
         c%z(n, 3*row - 1) = z(2, row)
         c%z(n, 3*row) = z(3, row)
      end do
   end subroutine load

   !> The ends of the flights.
   subroutine land(c, gravity)
      type(contacts_t), intent(inout) :: c
      real(wp), intent(in) :: gravity  !! [m/s2]
      integer :: k

      !$omp simd
      do k = 1, c%n
         c%length(k) = parabola_length(c%v1(k)*c%v1(k) + c%v2(k)*c%v2(k), c%v3(k), gravity, c%time(k))
         c%v3(k) = c%v3(k) - gravity*c%time(k)
         c%speed2_in(k) = c%v1(k)*c%v1(k) + c%v2(k)*c%v2(k) + c%v3(k)*c%v3(k)
      end do
   end subroutine land

   !> The velocities in the local frames.
   subroutine meet(c)
      type(contacts_t), intent(inout) :: c
      real(wp) :: plan1, plan2, unit1, unit2, length
      integer :: k

      !$omp simd private(plan1, plan2, unit1, unit2, length)
      do k = 1, c%met
         c%steepness(k) = sqrt(1 + c%g1(k)*c%g1(k) + c%g2(k)*c%g2(k))
         call in_local_frame(c%v1(k), c%v2(k), c%v3(k), c%g1(k), c%g2(k), c%steepness(k), &
                             c%tangential(k), c%normal(k), plan1, plan2)
         call divide_by_length(plan1, plan2, unit1, unit2, length)
         c%w(k) = rolled_before(c%w(k), c%heading1(k), c%heading2(k), unit1, unit2)
         c%heading1(k) = unit1
         c%heading2(k) = unit2
         c%usual(k) = merge(1.0_wp, 0.0_wp, length > shortest)
      end do
   end subroutine meet

   !> The random numbers of the contacts, and the velocities after them, by impact set.
   subroutine draw(scene, laws, c)
      type(scene_t), intent(in) :: scene
      type(laws_t), intent(in) :: laws
      type(contacts_t), intent(inout) :: c
      integer(i8) :: w1, w2, w3, w4, word(lanes, 4)
      integer(i8), parameter :: low32 = 2_i8**32 - 1
      integer :: k, set

      !$omp simd private(w1, w2, w3, w4)
      do k = 1, c%met
         w1 = iand(c%number(k), low32)
         w2 = shiftr(c%number(k), 32)
         w3 = iand(c%impact(k), low32)
         w4 = shiftl(for_impact, purpose_bit)
         call philox(scene%key, w1, w2, w3, w4)
         word(k, 1) = w1
         word(k, 2) = w2
         word(k, 3) = w3
         word(k, 4) = w4
      end do
      !$omp simd
      do k = 1, c%met
         c%z1(k) = normal(scene%table, word(k, 1))
         c%z2(k) = normal(scene%table, word(k, 2))
         c%z3(k) = normal(scene%table, word(k, 3))
      end do
      !$omp simd
      do k = 1, c%met
         c%u(k) = uniform(word(k, 4))
         c%side(k) = 2*real_of(iand(word(k, 4), 1_i8)) - 1
      end do
      do set = 1, size(laws%set)
         call draw_of_set(laws%set(set), c, c%first(set), c%first(set + 1) - 1)
      end do
   end subroutine draw

   !> Velocities after the contacts first..last.
   subroutine draw_of_set(set, c, first, last)
      type(impact_set_t), intent(in) :: set
      type(contacts_t), intent(inout) :: c
      integer, intent(in) :: first, last
      real(wp) :: leaves
      integer :: k

      !$omp simd private(leaves)
      do k = first, last
         call first_draw(set, c%tangential(k), c%normal(k), c%w(k), c%z1(k), c%z2(k), c%z3(k), &
                         c%out1(k), c%out2(k), c%out3(k))
         leaves = merge(1.0_wp, 0.0_wp, c%out2(k) > 0)
         c%admissible(k) = merge(leaves, 0.0_wp, energy_of(c%out1(k), c%out2(k), c%out3(k)) &
                                                 <= energy_of(c%tangential(k), c%normal(k), c%w(k)))
      end do
   end subroutine draw_of_set

   !> The next flights. What is not usual (a cell that is flat or has not all its neighbours, a vertical impact) is left
   !> to the scalar procedures.
   subroutine turn(c, per_cell)
      type(contacts_t), intent(inout) :: c
      real(wp), intent(in) :: per_cell  !! [1/m]
      real(wp) :: d1, d2, a1, a2, h1, h2, lowest, length, forward, before1, before2, u, side, usual, middle
      integer :: k

      !$omp simd private(d1, d2, a1, a2, h1, h2, lowest, length, forward, before1, before2, u, side, usual, middle)
      do k = 1, c%met
         call horn(c%z(k, 1), c%z(k, 2), c%z(k, 3), c%z(k, 4), c%z(k, 6), c%z(k, 7), c%z(k, 8), c%z(k, 9), per_cell, &
                   d1, d2, lowest)
         call divide_by_length(d1, d2, a1, a2, length)
         usual = c%usual(k)
         c%usual(k) = merge(usual, 0.0_wp, length > shortest)
         forward = merge(-1.0_wp, 1.0_wp, c%out1(k) < 0)
         before1 = forward*c%heading1(k)
         before2 = forward*c%heading2(k)
         c%next_w(k) = forward*c%out3(k)
         u = c%u(k)
         side = c%side(k)
         call turn_past_aspect(u, side, before1, before2, c%g1(k), c%g2(k), a1, a2, h1, h2)
         middle = c%z(k, 5)
         c%heading1(k) = merge(before1, h1, lowest >= middle)
         c%heading2(k) = merge(before2, h2, lowest >= middle)
         call launch_velocity(c%out1(k), c%out2(k), c%heading1(k), c%heading2(k), c%g1(k), c%g2(k), &
                              c%steepness(k), c%v1(k), c%v2(k), c%v3(k))
         c%rate(k) = c%out2(k)*c%steepness(k)
         c%speed2(k) = c%v1(k)*c%v1(k) + c%v2(k)*c%v2(k) + c%v3(k)*c%v3(k)
      end do
   end subroutine turn

   !> Draw again what was not admissible.
   subroutine redraw(scene, laws, c)
      type(scene_t), intent(in) :: scene
      type(laws_t), intent(in) :: laws
      type(contacts_t), intent(inout) :: c
      type(rebound_t) :: out
      integer :: k, set

      do set = 1, size(laws%set)
         do k = c%first(set), c%first(set + 1) - 1
            c%draws(k) = 1
            c%forced(k) = .false.
            if (c%admissible(k) > 0) cycle
            out = rebound_t([c%out1(k), c%out2(k), c%out3(k)])
            call draw_again(laws%set(set), scene%table, scene%key, c%number(k), c%impact(k), &
                            [c%tangential(k), c%normal(k), c%w(k)], out)
            c%out1(k) = out%v(1)
            c%out2(k) = out%v(2)
            c%out3(k) = out%v(3)
            c%draws(k) = out%draws
            c%forced(k) = out%forced
         end do
      end do
   end subroutine redraw

   !> Each boulder after its contact: on its next flight, or at its end.
   subroutine go_on(scene, laws, results, lane, c, scratch)
      type(scene_t), intent(in) :: scene
      type(laws_t), intent(in) :: laws
      type(boulder_result_t), intent(inout) :: results(:)
      type(lane_t), intent(inout) :: lane(:)
      type(contacts_t), intent(in) :: c
      type(scratch_t), intent(inout) :: scratch(:)
      logical :: fast, steep
      integer :: k

      do k = 1, c%n
         associate (this => lane(c%lane(k)), result => results(lane(c%lane(k))%place))
            result%path_length = result%path_length + c%length(k)
            result%time = result%time + c%time(k)
            result%speed_max = max(result%speed_max, c%speed2_in(k))
            result%jump_height_max = max(result%jump_height_max, this%landing%jump_height)
            if (result%status /= 0) cycle
            if (c%usual(k) > 0) then
               call beyond_fit(laws%set(this%set)%fitted, [c%tangential(k), c%normal(k)], fast, steep)
               call count_outcome(rebound_t([0.0_wp, 0.0_wp, 0.0_wp], c%draws(k), c%forced(k)), this%outside, fast, &
                                  steep, result)
               if (allocated(scene%grounds)) call count_ground(this%ground, scratch(this%scratch))
               if (scene%histograms_requested) &
                  call count_rebound(scratch(this%scratch)%histograms, [c%tangential(k), c%normal(k), c%w(k)], &
                                     [c%out1(k), c%out2(k), c%out3(k)])
               this%flight%v = [c%v1(k), c%v2(k), c%v3(k)]
               this%flight%rate = c%rate(k)
               this%flight%heading = [c%heading1(k), c%heading2(k)]
               this%omega_r = c%next_w(k)
               call start_from(this%landing, this%flight)
               call close_impact(scene, c%speed2(k), result)
            else
               call handle_impact(scene, c%number(k), this%landing, &
                                  [this%flight%v(1), this%flight%v(2), &
                                   this%flight%v(3) - scene%gravity*this%landing%time], this%omega_r, with_all, &
                                  result, this%flight, scratch(this%scratch))
            end if
         end associate
      end do
   end subroutine go_on

   !> Take boulders that have come to their end out of the pool.
   subroutine take_out(scene, results, crossings, maps, lane, scratch, totals, n)
      type(scene_t), intent(in) :: scene
      type(boulder_result_t), intent(inout) :: results(:)
      type(crossing_t), intent(inout) :: crossings(:, :)
      type(maps_t), intent(in) :: maps
      type(lane_t), intent(inout) :: lane(:)
      type(scratch_t), intent(inout) :: scratch(:)
      type(totals_t), intent(inout) :: totals
      integer, intent(inout) :: n
      type(lane_t) :: ended
      integer :: k

      do k = n, 1, -1
         associate (result => results(lane(k)%place), own => scratch(lane(k)%scratch))
            if (result%status == 0) cycle
            call end_boulder(scene, lane(k)%landing, with_all, result, own)
            if (allocated(own%crossings)) crossings(:, lane(k)%place) = own%crossings
            call add_boulder(scene, maps, result, own, totals)
         end associate
         ended = lane(k)
         lane(k) = lane(n)
         lane(n) = ended
         n = n - 1
      end do
   end subroutine take_out
end module rockfall_lanes
