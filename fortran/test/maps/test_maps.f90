! SPDX-License-Identifier: BSD-3-Clause
!> Maps: a flight visits the cells under its path, each boulder counts once per cell, and maxima equal those from a fine
!> sampling.
program test_map
   use, intrinsic :: ieee_arithmetic, only: ieee_is_nan
   use rockfall_kinds, only: wp, sp, i4, i8
   use rockfall_terrain, only: terrain_t, terrain, locate, height
   use rockfall_flight, only: flight_t, landing_t, span_t, fly, launch_rate
   use rockfall_bins, only: energy, speed, jump_height, n_log_bins, log_bin
   use rockfall_maps, only: maps_t, visits_t, needs_visits, start_visits, visit_path, &
      visit_cell, enter_cell, enter_other_cell, raise_values, mark_path, take_back_path, &
      join_visits, add_visits, add_deposit, lacks_slots, init_locks, free_locks
   use rockfall_map_values, only: map_plan_t, map_plan, stack_layers, map_views, map_row
   use check_m, only: check, check_close, finish
   implicit none

   integer, parameter :: nx = 60, ny = 50
   real(wp), parameter :: gravity = 9.81_wp, cell = 2.0_wp
   integer(i4), target :: passages(nx, ny), deposits(nx, ny)
   integer(i8), target :: energy_sum(nx, ny)
   real(sp), target :: energy_max(nx, ny), speed_max(nx, ny), jump_height_max(nx, ny)
   real(wp), target :: z(nx, ny)
   type(maps_t) :: maps
   type(terrain_t) :: dem

   call random_init(.true., .false.)
   call random_number(z)
   dem = terrain(0.0_wp, 0.0_wp, cell, z8=z)
   maps%passages => passages
   maps%deposits => deposits
   maps%layer(energy)%sum => energy_sum
   maps%layer(energy)%max => energy_max
   maps%layer(speed)%max => speed_max
   maps%layer(jump_height)%max => jump_height_max
   call test_flights()
   call test_axes()
   call test_once()
   call test_joined()
   call test_taken_back()
   call test_totals()
   call test_many_cells()
   call test_what_is_asked()
   call test_bins_of_cells()
   call test_spread()
   call test_threads()
   call finish()

contains

   subroutine clear()
      passages = 0
      deposits = 0
      energy_sum = 0
      energy_max = 0
      speed_max = 0
      jump_height_max = 0
   end subroutine clear

   !> Add a flight from a point above the ground to the maps, by a boulder of 3 kg with a rotational energy of 10.5 J.
   subroutine map_flight(x, y, v, start, landing)
      real(wp), intent(in) :: x, y, v(3)
      type(flight_t), intent(out) :: start
      type(landing_t), intent(out) :: landing
      type(span_t) :: spans(nx + ny)
      type(visits_t) :: visits
      real(wp) :: u, w
      integer :: n

      call clear()
      start%x = x
      start%y = y
      start%v = v
      call locate(dem, x, y, start%patch, u, w)
      start%above = 0.5_wp
      start%z = height(start%patch, u, w) + start%above
      start%rate = launch_rate(dem, start%patch, u, w, v)
      call start_visits(visits)
      call fly(dem, gravity, start, landing, spans, n)
      call visit_path(visits, dem, gravity, start, landing%time, 7.0_wp, spans(:n))
      call add_visits(maps, visits, 3.0_wp)
      call check_without_heights(start, landing, visits)
   end subroutine map_flight

   !> Maps without heights have the same cells in the same order, with the same speeds and energies.
   subroutine check_without_heights(start, landing, visits)
      type(flight_t), intent(in) :: start
      type(landing_t), intent(in) :: landing
      type(visits_t), intent(in) :: visits
      type(visits_t) :: alone
      integer :: k
      logical :: same

      call start_visits(alone)
      call visit_path(alone, dem, gravity, start, landing%time, 7.0_wp)
      same = alone%n == visits%n
      do k = 1, min(alone%n, visits%n)
         associate (one => alone%visit(k), other => visits%visit(k))
            same = same .and. all(one%cell == other%cell) .and. all(one%max(1:2) == other%max(1:2))
         end associate
      end do
      call check("the same cells and speeds without heights", same)
   end subroutine check_without_heights

   !> Every cell of a fine sampling is visited, with the same maxima. No other cell is visited, except cells that the
   !> path cuts for less than one sample.
   subroutine test_flights()
      type(flight_t) :: start
      type(landing_t) :: landing
      real(wp) :: draw(5)
      integer :: k, most

      most = 0
      do k = 1, 400
         call random_number(draw)
         call map_flight(draw(1)*(nx - 1)*cell, draw(2)*(ny - 1)*cell, &
                         [40*draw(3) - 20, 40*draw(4) - 20, 30*draw(5)], start, landing)
         call compare_with_sampling(start, landing)
         most = max(most, int(sum(passages)))
      end do
      call check("long flights", most > 40)
   end subroutine test_flights

   !> Flights along an axis, along the diagonal, straight down, and from sides of cells and patches.
   subroutine test_axes()
      type(flight_t) :: start
      type(landing_t) :: landing
      real(wp), parameter :: x(3) = [50.0_wp, 51.0_wp, 50.3_wp]
      integer :: k, i, j

      do k = 1, 3
         do i = -1, 1
            do j = -1, 1
               call map_flight(x(k), x(4 - k), [9.0_wp*i, 9.0_wp*j, 12.0_wp], start, landing)
               call compare_with_sampling(start, landing)
               call check("one cell for a fall", sum(passages) == 1 .or. i /= 0 .or. j /= 0)
            end do
         end do
      end do
   end subroutine test_axes

   subroutine compare_with_sampling(start, landing)
      type(flight_t), intent(in) :: start
      type(landing_t), intent(in) :: landing
      integer, parameter :: samples = 20000
      real(wp) :: best(3, nx, ny), t, x, y, speed2
      integer :: k, i, r
      logical :: missed, other, less, more

      best = -1
      missed = .false.
      do k = 0, samples
         t = landing%time*k/samples
         x = (start%x + start%v(1)*t)/cell
         y = (start%y + start%v(2)*t)/cell
         if (abs(abs(x - floor(x)) - 0.5_wp) < 1.0e-9_wp &
             .or. abs(abs(y - floor(y)) - 0.5_wp) < 1.0e-9_wp) cycle
         i = 1 + nint(x)
         r = ny - nint(y)
         speed2 = start%v(1)**2 + start%v(2)**2 + (start%v(3) - gravity*t)**2
         missed = missed .or. passages(i, r) /= 1
         best(:, i, r) = max(best(:, i, r), [sqrt(speed2), 0.5_wp*3*(speed2 + 7), &
                                             above_ground(start, x, y, t)])
      end do
      call check("every cell under a flight is visited, once", .not. missed)
      other = .false.
      less = .false.
      more = .false.
      do r = 1, ny
         do i = 1, nx
            if (passages(i, r) == 0) cycle
            if (best(1, i, r) < 0) then
               other = other .or. .not. near_corner(start, landing, i, ny - r)
               cycle
            end if
            associate (found => real([speed_max(i, r), energy_max(i, r), jump_height_max(i, r)], &
                                     wp))
               less = less .or. any(found < best(:, i, r)*(1 - 1.0e-6_wp) - 1.0e-6_wp)
               more = more .or. any(found > best(:, i, r)*(1 + 1.0e-2_wp) + 2.0e-2_wp)
            end associate
            more = more .or. abs(real(energy_sum(i, r), wp) - energy_max(i, &
               r)) > 0.6_wp + 1.0e-6_wp*energy_max(i, r)
         end do
      end do
      call check("no other cell is", .not. other)
      call check("maximum values are not below a sampling", .not. less)
      call check("nor far above", .not. more)
   end subroutine compare_with_sampling

   pure real(wp) function above_ground(start, x, y, t)
      type(flight_t), intent(in) :: start
      real(wp), intent(in) :: x, y, t  !! position in cells, time [s]
      integer :: i, r

      i = min(nx - 1, 1 + int(x))
      r = max(2, ny - int(y))
      associate (u => x - (i - 1), w => y - (ny - r))
         above_ground = start%z + start%v(3)*t - 0.5_wp*gravity*t**2 &
                        - (1 - w)*((1 - u)*z(i, r) + u*z(i + 1, r)) - w*((1 - u)*z(i, &
                           r - 1) + u*z(i + 1, r - 1))
      end associate
   end function above_ground

   !> True if a path comes within 1e-4 cells of the cell of node (i - 1, j): this visit may be too short for the
   !> sampling.
   pure logical function near_corner(start, landing, i, j)
      type(flight_t), intent(in) :: start
      type(landing_t), intent(in) :: landing
      integer, intent(in) :: i, j
      integer :: k
      real(wp) :: p(2), far

      near_corner = .false.
      do k = 0, 200000
         p = [start%x + start%v(1)*landing%time*k/200000, &
              start%y + start%v(2)*landing%time*k/200000]/cell
         far = maxval(abs(p - [i - 1, j]))
         near_corner = near_corner .or. far < 0.5001_wp
      end do
   end function near_corner

   !> A boulder that returns to a cell counts once there, with the larger values.
   subroutine test_once()
      type(visits_t) :: visits

      call clear()
      call start_visits(visits)
      call visit_cell(visits, [5, 6], 9.0_wp, 2.0_wp, 3.0_wp)
      call visit_cell(visits, [6, 6], 1.0_wp, 0.0_wp, 0.5_wp)
      call visit_cell(visits, [5, 6], 4.0_wp, 20.0_wp, 1.0_wp)
      call join_visits(visits)
      call add_visits(maps, visits, 2.0_wp)
      call check("passed once", passages(5, 6) == 1 .and. passages(6, 6) == 1 &
                 .and. sum(passages) == 2)
      call check_close("maximum speed", real(speed_max(5, 6), wp), 3.0_wp, 0.0_wp)
      call check_close("maximum energy, of one moment", real(energy_max(5, 6), wp), 24.0_wp, &
                       0.0_wp)
      call check("its sum", energy_sum(5, 6) == 24)
      call check_close("maximum height", real(jump_height_max(5, 6), wp), 3.0_wp, 0.0_wp)
   end subroutine test_once

   !> Joined visits are in the order of first visits, each with the earliest known time.
   subroutine test_joined()
      type(visits_t) :: visits
      integer :: k

      call start_visits(visits)
      do k = 1, 7
         call visit_cell(visits, [1 + mod(k*k, 3), 5], real(8 - k, wp), 1.0_wp, real(k, wp))
      end do
      call check("a visit for each entry into a cell", visits%n == 5)
      visits%time = [1.0_wp, 2.0_wp, 0.5_wp, 3.0_wp, 9.0_wp]
      visits%timed = 4
      call join_visits(visits)
      call check("two cells, the first first", visits%n == 2 .and. visits%visit(1)%cell(1) == 2 &
                 .and. visits%visit(2)%cell(1) == 1)
      call check("maximum speeds and heights", all(abs(visits%visit(1)%max - [7.0_wp, 8.0_wp, 7.0_wp]) <= 0) &
                 .and. all(abs(visits%visit(2)%max - [5.0_wp, 6.0_wp, 6.0_wp]) <= 0))
      call check("earliest times", visits%timed == 2 .and. all(abs(visits%time(:2) - [0.5_wp, 2.0_wp]) <= 0))
      call join_visits(visits)
      call check("joined once is joined", visits%n == 2 .and. visits%timed == 2)
   end subroutine test_joined

   !> Taking back a path leaves its first cell unchanged, however long the path is and whatever came before.
   subroutine test_taken_back()
      type(visits_t) :: visits
      integer :: before, k

      do before = 0, 2000, 400
         call start_visits(visits)
         do k = 1, before
            call visit_cell(visits, [1 + k/900, 1 + mod(k, 2)], 1.0_wp, 0.0_wp, 0.0_wp)
         end do
         call visit_cell(visits, [4, 1], 2.0_wp, 1.0_wp, 0.5_wp)
         call enter_cell(visits, [4, 1])
         call mark_path(visits)
         call raise_values(visits, 9.0_wp, 9.0_wp, 9.0_wp)
         do k = 1, 3000
            call enter_other_cell(visits, [5, 1 + mod(k, 2)])
         end do
         call take_back_path(visits)
         call check("the cell where it starts", all(visits%visit(visits%n)%cell == [4, 1]) &
                    .and. all(abs(visits%visit(visits%n)%max - [2.0_wp, 3.0_wp, 0.5_wp]) <= 0))
         call join_visits(visits)
         call check("and those before", visits%n == 1 + merge(0, 2*(1 + before/900), before == 0))
      end do
   end subroutine test_taken_back

   !> Over boulders, counts and sums add up, maxima are kept, and visits are cleared.
   subroutine test_totals()
      type(visits_t) :: visits
      integer(i8) :: b

      call clear()
      do b = 1, 10
         call start_visits(visits)
         call visit_cell(visits, [int(b), 1], 1.0_wp, 0.0_wp, 0.0_wp)
         call visit_cell(visits, [20, 20], real(merge(b, 11 - b, b > 5)**2, wp), 0.0_wp, 0.1_wp*b)
         call add_visits(maps, visits, 2.0_wp)
         call add_deposit(maps, [20, 20])
      end do
      call check("every boulder passed its own cell alone", all(passages(:10, 1) == 1))
      call check("and all the common one", passages(20, 20) == 10 .and. sum(passages) == 20)
      call check("all came to rest there", deposits(20, 20) == 10 .and. sum(deposits) == 10)
      call check("sum of their energies", energy_sum(20, 20) == 2*(36 + 49 + 64 + 81 + 100))
      call check_close("the maximum of all", real(speed_max(20, 20), wp), 10.0_wp, 0.0_wp)
      call check_close("the highest of all", real(jump_height_max(20, 20), wp), 1.0_wp, 1.0e-7_wp)
   end subroutine test_totals

   !> A boulder that visits all cells several times, in any order, counts once in each.
   subroutine test_many_cells()
      type(visits_t) :: visits
      integer :: turn, k

      call clear()
      do turn = 1, 2  ! the second boulder finds the slots of the first
         call start_visits(visits)
         do k = 0, 3*nx*ny - 1
            associate (c => mod(7919*k, nx*ny))
               call visit_cell(visits, [1 + mod(c, nx), 1 + c/nx], real(k + 1, wp), 0.0_wp, 0.0_wp)
            end associate
         end do
         call join_visits(visits)
         call add_visits(maps, visits, 1.0_wp)
         call check("all cells, once a boulder", all(passages == turn))
      end do
      call check_close("the last visit was the fastest", real(maxval(speed_max), wp), &
                       sqrt(3.0_wp*nx*ny), 1.0e-7_wp)
      call check("nowhere an early one", minval(speed_max) > sqrt(2.0_sp*nx*ny))
   end subroutine test_many_cells

   !> Maps that are not requested are not changed; deposits alone need no visits.
   subroutine test_what_is_asked()
      type(maps_t) :: some
      type(visits_t) :: visits

      call clear()
      call check("nothing asked", .not. needs_visits(some))
      some%deposits => deposits
      call check("deposits need no visits", .not. needs_visits(some))
      some%layer(speed)%max => speed_max
      call check("a speed does", needs_visits(some))
      call start_visits(visits)
      call visit_cell(visits, [3, 3], 4.0_wp, 0.0_wp, 0.0_wp)
      call add_visits(some, visits, 1.0_wp)
      call check("the asked map is written", abs(speed_max(3, 3) - 2) <= 0)
      call check("the others are not", sum(passages) == 0 .and. sum(energy_sum) == 0)
      nullify (some%deposits)
      call add_deposit(some, [3, 3])
      call check("nor deposits", sum(deposits) == 0)
   end subroutine test_what_is_asked

   !> Boulders are counted by bins in the cells that they pass, whatever was in memory before.
   subroutine test_bins_of_cells()
      integer(i4), target :: counts(n_log_bins(speed) + n_log_bins(jump_height), 0:3), slot(nx, ny), slots
      type(maps_t) :: some
      type(visits_t) :: visits
      integer(i8) :: b
      integer :: k

      counts = 99
      slot = 0
      slots = 0
      some%bin_counts => counts(:, 1:)
      some%slot => slot
      some%slots => slots
      some%layer(speed)%bin_offset = 0
      some%layer(jump_height)%bin_offset = n_log_bins(speed)
      call check("bins need visits", needs_visits(some))
      do b = 1, 6
         call start_visits(visits)
         call visit_cell(visits, [4, 7], real(b*b, wp), 0.0_wp, 2.0_wp)
         if (b > 4) call visit_cell(visits, [5, 7], 1.0_wp, 0.0_wp, 0.0_wp)
         call add_visits(some, visits, 1.0_wp)
      end do
      call check("two cells have a slot", slots == 2 .and. slot(4, 7) == 1 .and. slot(5, 7) == 2 &
                 .and. sum(slot) == 3)
      call check("no memory of others is touched", all(counts(:, 3) == 99))
      associate (one => counts(:n_log_bins(speed), 1), other => counts(n_log_bins(speed) + 1:, 1))
         call check("each boulder in its bin of speed", sum(one) == 6 &
                    .and. all(one([(log_bin(speed, 1.0_wp*b), b=1, 6)]) == 1))
         call check("all in one of height", sum(other) == 6 .and. other(log_bin(jump_height, 2.0_wp)) == 6)
      end associate
      call check("a height of zero counts too", counts(n_log_bins(speed) + 1, 2) == 2 .and. sum(counts(:, 2)) == 4)
      do k = 6, 9
         call check("slots are left", lacks_slots(some) .eqv. k > 7)
         call visit_cell(visits, [k, 7], 1.0_wp, 0.0_wp, 0.0_wp)
         call add_visits(some, visits, 1.0_wp)
      end do
      call check("none is given that is not there", slots == 4 .and. maxval(slot) == 3 &
                 .and. all(counts(:, 0) == 99))
   end subroutine test_bins_of_cells

   !> Standard deviations of numbers whose squares overflow integers: 0 for equal numbers, 1e5 J for a - 1e5 J, a, a +
   !> 1e5 J; undefined for one number.
   subroutine test_spread()
      real(wp), parameter :: a = 5.0e9_wp, d = 1.0e5_wp  !! [J]
      integer(i4), target :: counts(nx, ny, 1), bin_counts(1, 1), slot(1, 1), slots
      integer(i8), target :: sums(nx, ny, 3)
      real(sp), target :: maxima(1, 1, 1)
      real(sp) :: row(nx)
      type(map_plan_t) :: plan
      type(maps_t) :: some
      type(visits_t) :: visits
      integer(i8) :: b

      plan = map_plan(["energy_std"], 0)
      call check("a count, a sum, two digits of squares", all(stack_layers(plan) == [1, 3, 0]))
      counts = 0
      sums = 0
      some = map_views(plan, [real(wp) ::], [1, 1], counts, sums, maxima, bin_counts, slot, slots)
      do b = 1, 3
         call start_visits(visits)
         call visit_cell(visits, [1, 9], a, 0.0_wp, 0.0_wp)
         call visit_cell(visits, [2, 9], a + (b - 2)*d, 0.0_wp, 0.0_wp)
         if (b == 1) call visit_cell(visits, [3, 9], a, 0.0_wp, 0.0_wp)
         call add_visits(some, visits, 2.0_wp)
      end do
      call map_row(some, "energy_std", 9, 3_i8, 1_i8, 1, row)
      call check("equal numbers have no spread", .not. abs(row(1)) > 0)
      call check_close("the spread of three", real(row(2), wp), d, 0.0_wp)
      call check("that of one is not known", all(ieee_is_nan(row(3:))))
   end subroutine test_spread

   !> Several threads in the same cells give the result of a single thread.
   subroutine test_threads()
      integer, parameter :: boulders = 100
      integer(i4), target :: counts(n_log_bins(speed), nx*ny), slot(nx, ny), slots
      type(maps_t) :: some
      integer(i8) :: b
      integer :: i, r, turn
      logical :: given(nx*ny), right

      some = maps
      some%bin_counts => counts
      some%slot => slot
      some%slots => slots
      some%layer(speed)%bin_offset = 0
      right = .true.
      do turn = 1, 3
         call clear()
         counts = 99
         slot = 0
         slots = 0
         call init_locks(some, ny)
         !$omp parallel do num_threads(8) schedule(static, 1)
         do b = 1, boulders
            call pass_all_cells(some, b)
         end do
         !$omp end parallel do
         call free_locks(some)
         given = .false.
         do r = 1, ny
            do i = 1, nx
               given(slot(i, r)) = .true.
            end do
         end do
         right = right .and. all(given) .and. slots == nx*ny .and. all(sum(counts, 1) == boulders) &
                 .and. all(passages == boulders) .and. all(energy_sum == boulders*(boulders + 1)/2) &
                 .and. all(abs(speed_max - sqrt(real(boulders, sp))) <= 0)
      end do
      call check("threads lose nothing", right)
   end subroutine test_threads

   !> Boulder of 2 kg that passes all cells, faster than the boulders before it.
   subroutine pass_all_cells(some, b)
      type(maps_t), intent(in) :: some
      integer(i8), intent(in) :: b
      type(visits_t) :: visits
      integer :: i, r

      call start_visits(visits)
      do r = 1, ny
         do i = 1, nx
            call visit_cell(visits, [i, r], real(b, wp), 0.0_wp, 0.0_wp)
         end do
      end do
      call add_visits(some, visits, 2.0_wp)
   end subroutine pass_all_cells
end program test_map
