! SPDX-License-Identifier: BSD-3-Clause
!> Durations and lengths of contacts from a table: uniform deceleration, contacts as in the laboratory along a plane,
!> and properties that hold for any record.
program test_table_contact
   use rockfall_kinds, only: wp, sp
   use rockfall_math, only: degree
   use rockfall_random, only: words_per_block
   use rockfall_terrain, only: terrain_t, terrain, locate, height
   use rockfall_boulder, only: boulder_t, soil_draw_t, inertia_factor
   use rockfall_flight, only: landing_t
   use rockfall_rolling, only: roll_t, touch_t
   use rockfall_impact_table, only: impact_table_t, index_records, record_fields, map_fields, t_in, n_in, w_in, &
                                    speed_in, along_out, across_out, n_out, w_out, duration_out, advance_out, &
                                    rise_out, pull_along, exit_code, follower, low, high, flies, rolls_on, stops
   use rockfall_table_contact, only: table_contact_t, table_contact, update_touch
   use check_m, only: check, check_close, finish
   implicit none
   integer, parameter :: n = 20
   real(wp), parameter :: cell = 100.0_wp, gravity = 9.81_wp, near = 1.0e-12_wp
   real(wp), parameter :: lab_radius = 0.4_wp, density = 2700.0_wp, strength = 2.0e6_wp, pi = acos(-1.0_wp)
   real(wp), parameter :: radii(*) = [0.05_wp, 0.2_wp, 0.57_wp, 3.0_wp]
   real(wp), parameter :: speeds(*) = [1.0e-7_wp, 1.0e-3_wp, 0.02_wp, 0.3_wp, 1.0_wp, 2.5_wp, 30.0_wp]  ! V/sqrt(g R_b)
   real(wp), target :: z(n, n)
   type(terrain_t) :: dem
   type(impact_table_t) :: table
   type(table_contact_t) :: contact
   type(roll_t) :: roll
   type(touch_t) :: touch

   call test_even_deceleration()
   call test_sums_on_a_plane()
   call test_limited_contacts()
   call test_any_record()
   call finish()

contains

   !> Set a plane that falls to the south.
   subroutine set_plane(slope)
      real(wp), intent(in) :: slope  !! [degree]
      integer :: r

      do r = 1, n
         z(:, r) = -cell*r*tan(slope*degree)
      end do
      dem = terrain(0.0_wp, 0.0_wp, cell, z8=z)
   end subroutine set_plane

   !> Set a table with one bin for each kind of contact; the first record begins with a flight.
   subroutine set_table(record, by_speed)
      real(wp), intent(in) :: record(:, :)  !! (record_fields, records): the first for flights, then for rolls
      logical, intent(in) :: by_speed       !! the ground yields
      integer :: k

      table = impact_table_t()
      table%ground%strength = merge(strength, 0.0_wp, by_speed)
      table%size = [density*gravity*lab_radius/strength]
      table%relief = [0.0_wp]
      table%flights%n = 1
      allocate (table%flights%first_edge(0, 1), table%flights%second_edge(0, 1, 1), &
                table%flights%third_edge(0, 1, 1, 1))
      table%rolls = table%flights
      table%first = [1, 2, size(record, 2) + 1]
      allocate (table%map(map_fields, 2), source=0.0_wp)
      do k = 1, 4
         table%map(low + k, :) = -100
         table%map(high + k, :) = 100
      end do
      table%record = real(record, sp)
      call index_records(table)
   end subroutine set_table

   !> Contact of a boulder that moves down the fall line of the plane.
   subroutine touch_plane(radius, slope, along, normal, w)
      real(wp), intent(in) :: radius            !! [m]
      real(wp), intent(in) :: slope             !! [degree]
      real(wp), intent(in) :: along, normal, w  !! V_t, V_n, W [m/s]
      type(landing_t) :: landing
      type(boulder_t) :: boulder
      real(wp) :: v(3), u(words_per_block)

      landing%contact = .true.
      landing%x = 0.47_wp*n*cell
      landing%y = 0.53_wp*n*cell
      call locate(dem, landing%x, landing%y, landing%patch, landing%u, landing%w)
      landing%z = height(landing%patch, landing%u, landing%w)
      boulder%radius = radius
      boulder%volume = 4*pi/3*radius**3
      boulder%mass = density*boulder%volume
      v = along*[0.0_wp, -cos(slope*degree), -sin(slope*degree)] &
          + normal*[0.0_wp, -sin(slope*degree), cos(slope*degree)]
      u = 0.5_wp
      call update_touch(table, 1, 1.0_wp, boulder, soil_draw_t(), gravity, 0.0_wp, touch)
      call table_contact(dem, gravity, table, boulder, inertia_factor, u, landing, v, [0.0_wp, -1.0_wp], w, touch, &
                         roll, contact)
   end subroutine touch_plane

   !> A block slows down uniformly from v to c v in a time T, over a length (1 + c) v T/2. So does a boulder of any size
   !> and speed: a length s takes 2 s over the sum of its speeds. T scales with sqrt(R_b/g), or at equal speed with R_b.
   subroutine test_even_deceleration()
      real(wp), parameter :: left(*) = [0.0_wp, 0.25_wp, 0.75_wp], v = 2.0_wp, time = 1.25_wp
      real(wp) :: record(record_fields, 2), unit, expected
      integer :: j, k, m, kind

      call set_plane(0.0_wp)
      do kind = 0, 1
         do m = 1, size(left)
            record = 0
            record(t_in, :) = v
            record(speed_in, :) = v
            record(along_out, :) = left(m)*v
            record(duration_out, :) = time
            record(advance_out, :) = 0.5_wp*(1 + left(m))*v*time
            record(exit_code, :) = rolls_on
            call set_table(record, kind == 1)
            do k = 1, size(radii)
               do j = 1, size(speeds)
                  unit = sqrt(gravity*radii(k))
                  touch = touch_t()
                  call touch_plane(radii(k), 0.0_wp, speeds(j)*unit, 0.0_wp, 0.0_wp)
                  expected = time*unit/gravity
                  if (kind == 1) expected = time*sqrt(lab_radius/gravity)*(radii(k)/lab_radius)
                  call check_close("duration", roll%landing%time + roll%waits, expected, near)
                  call check_close("speed left", contact%v_out(1), left(m)*speeds(j)*unit, near)
                  call check_close("way over mean speed", 2*roll%length/(contact%v_in(1) + contact%v_out(1)), &
                                   expected, near)
                  call check_close("speed of the mean energy", norm2(roll%path%v), &
                                   sqrt(0.5_wp*(contact%v_in(1)**2 + contact%v_out(1)**2)), near)
               end do
            end do
         end do
      end do
   end subroutine test_even_deceleration

   !> A boulder that starts like the block of a throw moves down the plane for as long and as far as the block, over all
   !> of its consecutive contacts.
   subroutine test_sums_on_a_plane()
      real(wp), parameter :: slope = 17.0_wp, time(*) = [1.5_wp, 1.5_wp, 0.75_wp, 1.5_wp, 1.25_wp]
      real(wp), parameter :: speed(*) = [0.25_wp, 0.4375_wp, 0.0625_wp, 0.3125_wp, 0.375_wp, 0.125_wp]
      real(wp) :: record(record_fields, size(time)), unit, duration, way
      integer :: j, k

      call set_plane(slope)
      record = 0
      record(t_in, :) = speed(:size(time))
      record(speed_in, :) = speed(:size(time))
      record(along_out, :) = speed(2:)
      record(duration_out, :) = time
      record(advance_out, :) = 0.875_wp*speed(:size(time))*time  ! not uniform: some slow down late, some are fast in
                                                                 ! between
      record(pull_along, :) = sin(slope*degree)
      record(exit_code, :) = rolls_on
      record(follower, :) = [2, 3, 4, 5, 0]
      call set_table(record, .false.)
      do k = 1, size(radii)
         unit = sqrt(gravity*radii(k))
         touch = touch_t()
         duration = 0
         way = 0
         do j = 1, size(time)
            call touch_plane(radii(k), slope, speed(j)*unit, 0.0_wp, 0.0_wp)
            duration = duration + roll%landing%time + roll%waits
            way = way + roll%length
            call check_close("follows the block", contact%v_out(1), speed(j + 1)*unit, 1.0e-6_wp)
         end do
         call check_close("time down the plane", duration, sum(time)*sqrt(radii(k)/gravity), near)
         call check_close("way down the plane", way, 0.875_wp*sum(speed(:size(time))*time)*radii(k), 1.0e-6_wp)
      end do
   end subroutine test_sums_on_a_plane

   !> On flat ground a boulder must not gain the energy that the block gained from the relief: it is slower than the
   !> block, and covers less distance in the same time. Down a slope it gains at most that and the work of gravity on
   !> its path.
   subroutine test_limited_contacts()
      real(wp), parameter :: record_speed(*) = [0.0625_wp, 1.0_wp, 6.0_wp]
      real(wp) :: record(record_fields, 2), unit, before, after, gain
      integer :: slope, i, j, k

      do slope = 0, 30, 10
         call set_plane(real(slope, wp))
         do i = 1, size(record_speed)
            record = 0
            record(t_in, :) = record_speed(i)
            record(speed_in, :) = record_speed(i)
            record(along_out, :) = 3*record_speed(i)
            record(duration_out, :) = 1.5_wp
            record(advance_out, :) = 3*record_speed(i)
            record(pull_along, :) = sin(slope*degree)
            record(exit_code, :) = rolls_on
            call set_table(record, .false.)
            do k = 1, size(radii)
               do j = 1, size(speeds)
                  unit = sqrt(gravity*radii(k))
                  touch = touch_t()
                  touch%rolling = mod(j, 2) == 0
                  call touch_plane(radii(k), real(slope, wp), speeds(j)*unit, 0.0_wp, 0.0_wp)
                  before = contact%v_in(1)**2
                  after = contact%v_out(1)**2
                  call check_close("duration", roll%landing%time + roll%waits, 1.5_wp*unit/gravity, near)
                  gain = max(0.0_wp, 8*record_speed(i)**2 - 6*record_speed(i)*sin(slope*degree)) &
                         *min(1.0_wp, (speeds(j)/record_speed(i))**2)*unit**2
                  if (slope == 0) gain = 0
                  call check("no energy from nothing", after <= (before + gain &
                                                                 + 2*gravity*roll%length*sin(slope*degree))*(1 + near))
                  if (slope > 0) cycle
                  call check("limited where it would gain", &
                             contact%limited .neqv. mod(j, 2) == 0 .and. speeds(j) > 3*record_speed(i))
                  if (.not. contact%limited) cycle
                  call check_close("energy left", after, 0.98_wp*before, near)
                  call check_close("way by its own speeds", roll%length, 1.5_wp*unit/gravity &
                                   *2/sqrt(5.0_wp)*sqrt(0.5_wp*(before + after)), 1.0e-6_wp)
               end do
            end do
         end do
      end do
   end subroutine test_limited_contacts

   !> For any record, boulder and slope, the boulder moves to the end of its path within the duration of the contact,
   !> and waits there for the rest. A boulder that leaves the ground at once takes no time.
   subroutine test_any_record()
      integer, parameter :: exits(*) = [flies, rolls_on, stops]
      real(wp) :: record(record_fields, 2), x(12), unit, time, speed
      integer :: k, slope

      call random_init(.true., .false.)
      do k = 1, 4000
         if (mod(k, 50) == 1) then
            slope = mod(7*(k/50), 81) - 40
            call set_plane(real(slope, wp))
         end if
         call random_number(x)
         record = 0
         record(t_in, :) = real(10**(4*x(1) - 3), sp)
         record(n_in, :) = -record(t_in, :)*x(2)
         record(speed_in, :) = sqrt(record(t_in, :)**2 + record(n_in, :)**2)
         record(w_in, :) = record(t_in, :)*x(3)
         record(along_out, :) = record(t_in, :)*(2*x(4) - 0.5_wp)
         record(across_out, :) = record(t_in, :)*(x(5) - 0.5_wp)
         record(n_out, :) = record(t_in, :)*x(6)
         record(w_out, :) = record(t_in, :)*x(7)
         record(duration_out, :) = merge(0.0_wp, 3*x(8), x(8) < 0.1_wp)
         record(advance_out, :) = (4*x(9) - 0.5_wp)*record(speed_in, :)
         record(rise_out, :) = x(10) - 0.5_wp
         record(pull_along, :) = x(11) - 0.3_wp
         record(exit_code, :) = exits(1 + mod(k, 3))
         call set_table(record, mod(k, 2) == 0)
         touch = touch_t()
         touch%rolling = mod(k/2, 2) == 0
         speed = 10**(10.5_wp*x(12) - 9)  ! speed over sqrt(g R_b)
         associate (radius => radii(1 + mod(k, size(radii))))
            unit = sqrt(gravity*radius)
            time = real(table%record(duration_out, 1), wp)*unit/gravity
            if (mod(k, 2) == 0 .and. .not. touch%rolling) time = time*sqrt(radius/lab_radius)
            touch%normal = -0.1_wp*speed*unit
            call touch_plane(radius, real(slope, wp), speed*unit, -0.3_wp*speed*unit, speed*unit)
         end associate
         associate (path => roll%path, end => roll%landing)
            call check("known ground", end%contact)
            call check("it moves for a part of the time", end%time >= 0 .and. roll%waits >= 0)
            call check("no longer than the contact", end%time + roll%waits <= time*(1 + near))
            if (roll%length > 0) call check_close("and as long", end%time + roll%waits, time, near)
            if (end%time > 0) call check_close("to its end", norm2([end%x - path%x, end%y - path%y, end%z - path%z] &
                                                                   - end%time*path%v) + 1, 1.0_wp, 1.0e-9_wp)
            call check("finite", all(abs([roll%v, roll%length, roll%above]) < 1.0e6_wp))
         end associate
      end do
   end subroutine test_any_record
end program test_table_contact
