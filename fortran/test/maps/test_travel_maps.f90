! SPDX-License-Identifier: BSD-3-Clause
!> Arrival of boulders in cells: times equal those from a fine sampling, energy lines those of right-angled triangles;
!> counts above energy thresholds.
program test_travel_maps
   use rockfall_kinds, only: wp, sp, i4, i8
   use rockfall_terrain, only: terrain_t, terrain, locate, height
   use rockfall_flight, only: flight_t, landing_t, span_t, fly, launch_rate
   use rockfall_maps, only: maps_t, visits_t, needs_visits, start_visits, visit_path, visit_cell, join_visits, &
                            add_visits
   use rockfall_travel_maps, only: needs_times, needs_travel, time_visits, add_travel, steepest_angle, flattest_angle, &
      shortest_time
   use check_m, only: check, check_close, finish
   implicit none

   integer, parameter :: nx = 40, ny = 30
   real(wp), parameter :: gravity = 9.81_wp, cell = 2.0_wp, begun = 7.5_wp
   real(wp), target :: z(nx, ny)
   real(sp), target :: steep(nx, ny), flat(nx, ny), short(nx, ny)
   integer(i4), target :: exceeded(nx, ny, 3)
   type(terrain_t) :: dem
   type(maps_t) :: maps

   call random_init(.true., .false.)
   call random_number(z)
   dem = terrain(0.0_wp, 0.0_wp, cell, z8=z)
   maps%steepest => steep
   maps%flattest => flat
   maps%shortest => short
   call test_what_is_asked()
   call test_times()
   call test_lines()
   call test_extremes()
   call test_thresholds()
   call finish()

contains

   subroutine clear()
      steep = 0
      flat = 0
      short = 0
      exceeded = 0
   end subroutine clear

   subroutine test_what_is_asked()
      type(maps_t) :: none, times, counts

      times%shortest => short
      counts%exceeded => exceeded
      call check("nothing needs nothing", .not. (needs_visits(none) .or. needs_travel(none) .or. needs_times(none)))
      call check("times need visits", needs_visits(times) .and. needs_travel(times) .and. needs_times(times))
      call check("counts need visits, and no times", needs_visits(counts) .and. .not. needs_travel(counts))
   end subroutine test_what_is_asked

   !> Each cell under a flight has the time of the first sample in it.
   subroutine test_times()
      type(flight_t) :: start
      type(landing_t) :: landing
      type(span_t) :: spans(nx + ny)
      type(visits_t) :: visits
      real(wp) :: draw(5), u, w, found, t, far
      integer, parameter :: samples = 40000
      integer :: turn, k, n, i, r
      real(wp) :: first(nx, ny)

      far = 0
      do turn = 1, 200
         call random_number(draw)
         start%x = draw(1)*(nx - 1)*cell
         start%y = draw(2)*(ny - 1)*cell
         start%v = [40*draw(3) - 20, 40*draw(4) - 20, 30*draw(5)]
         if (mod(turn, 10) == 0) start%v(1) = 0  ! along an axis
         call locate(dem, start%x, start%y, start%patch, u, w)
         start%above = 0.5_wp
         start%z = height(start%patch, u, w) + start%above
         start%rate = launch_rate(dem, start%patch, u, w, start%v)
         call clear()
         if (allocated(visits%time)) deallocate (visits%time)
         allocate (visits%time(0))
         call start_visits(visits)
         call fly(dem, gravity, start, landing, spans, n)
         call visit_path(visits, dem, gravity, start, landing%time, 0.0_wp, spans(:n))
         call time_visits(visits, dem, [start%x, start%y], start%v(:2), begun, landing%time)
         call add_travel(maps, visits, dem, [start%x, start%y, start%z])
         first = -1
         do k = 0, samples
            t = landing%time*k/samples
            i = nint((start%x + start%v(1)*t)/cell) + 1
            r = ny - nint((start%y + start%v(2)*t)/cell)
            if (first(i, r) < 0) first(i, r) = begun + t
         end do
         do r = 1, ny
            do i = 1, nx
               if (first(i, r) < 0 .or. short(i, r) <= 0) cycle
               found = shortest_time(short(i, r))
               far = max(far, abs(found - first(i, r)))
            end do
         end do
         call check("every sampled cell has a time", all(short > 0 .or. first < 0))
      end do
      call check("times are those of a sampling", far < 1.0e-3_wp)
   end subroutine test_times

   !> Energy lines end on the ground at cell centres; none to the first cell, which contains the release.
   subroutine test_lines()
      type(visits_t) :: visits
      real(wp), parameter :: degree = acos(-1.0_wp)/180
      real(wp) :: drop

      call clear()
      call start_visits(visits)
      call visit_cell(visits, [3, 4], 1.0_wp, 0.0_wp, 0.0_wp)
      call visit_cell(visits, [6, 8], 1.0_wp, 0.0_wp, 0.0_wp)  ! 6 m east, 8 m south
      allocate (visits%time(0))
      call add_travel(maps, visits, dem, [2*cell, (ny - 4)*cell, 12.0_wp])
      drop = 12 - z(6, 8)
      call check_close("the angle of a triangle", real(steepest_angle(steep(6, 8)), wp), atan(drop/10)/degree, &
                       2.0e-5_wp)
      call check_close("from both sides", real(flattest_angle(flat(6, 8)), wp), &
                       real(steepest_angle(steep(6, 8)), wp), 0.0_wp)
      call check("none where it was released", steep(3, 4) <= 0 .and. flat(3, 4) <= 0)
      call check("no time that was not noted", all(short <= 0))
      call add_travel(maps, visits, dem, [2*cell, (ny - 4)*cell, z(6, 8) - 10.0_wp])
      call check_close("a line upwards", real(flattest_angle(flat(6, 8)), wp), -45.0_wp, 3.0e-5_wp)
      call check_close("the steepest stays", real(steepest_angle(steep(6, 8)), wp), atan(drop/10)/degree, 2.0e-5_wp)
   end subroutine test_lines

   !> Steepest, flattest and first of many boulders, in any order.
   subroutine test_extremes()
      type(visits_t) :: visits
      real(wp) :: high(9), time(9)
      integer :: k

      call clear()
      high = [30, 90, 50, 20, 60, 70, 10, 80, 40]
      time = [8, 3, 9, 2, 7, 4, 6, 1, 5]
      do k = 1, 9
         call start_visits(visits)
         call visit_cell(visits, [1, 1], 1.0_wp, 0.0_wp, 0.0_wp)
         call visit_cell(visits, [11, 1], 1.0_wp, 0.0_wp, 0.0_wp)
         visits%time = [0.0_wp, time(k)]
         visits%timed = 2
         call add_travel(maps, visits, dem, [0.0_wp, (ny - 1)*cell, z(11, 1) + high(k)])
      end do
      call check_close("steepest", tan_of(steepest_angle(steep(11, 1))), 90.0_wp/20, 1.0e-5_wp)
      call check_close("flattest", tan_of(flattest_angle(flat(11, 1))), 10.0_wp/20, 1.0e-6_wp)
      call check_close("first", real(shortest_time(short(11, 1)), wp), 1.0_wp, 1.0e-6_wp)
      call check_close("at once where it was released", real(shortest_time(short(1, 1)), wp), 0.0_wp, 0.0_wp)
   end subroutine test_extremes

   pure real(wp) function tan_of(angle)
      real(sp), intent(in) :: angle  !! [degree]

      tan_of = tan(real(angle, wp)*acos(-1.0_wp)/180)
   end function tan_of

   !> A boulder counts at each threshold below its maximum energy, but not at an equal threshold.
   subroutine test_thresholds()
      type(maps_t) :: counts
      type(visits_t) :: visits
      integer :: k

      call clear()
      counts%exceeded => exceeded
      counts%threshold = [0.0_wp, 8.0_wp, 32.0_wp]
      do k = 1, 6
         call start_visits(visits)
         call visit_cell(visits, [2, 3], 1.0_wp*k**2, 0.0_wp, 0.0_wp)
         call visit_cell(visits, [2, 3], 0.5_wp, 0.0_wp, 0.0_wp)
         call visit_cell(visits, [9, 9], 0.0_wp, 0.0_wp, 0.0_wp)
         call join_visits(visits)
         call add_visits(counts, visits, 2.0_wp)  ! energies of k**2 J
      end do
      call check("above 0, 8 and 32 J", all(exceeded(2, 3, :) == [6, 4, 1]))
      call check("none without energy", all(exceeded(9, 9, :) == 0) .and. sum(exceeded) == 11)
   end subroutine test_thresholds
end program test_travel_maps
