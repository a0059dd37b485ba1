! SPDX-License-Identifier: BSD-3-Clause
!> Contacts by tables of impacts, for several boulders at a time. Each goes through the steps of `table_contact` in the
!> same order, so results are bitwise identical. Steps with roots and divisions are loops over all contacts. Records
!> are chosen in several loops of little each, and before the first is read, so that memory accesses overlap. Only a
!> path that is needed, or leaves the known terrain, is found by `find_slide`.
!>
!> Compiled twice, like rockfall_lanes.
module rockfall_table_lanes
   use rockfall_kinds, only: wp, i8
   use rockfall_random, only: words_per_block, uniform
   use rockfall_terrain, only: terrain_t, patch_t, slope_at, gradient
   use rockfall_boulder, only: boulder_t
   use rockfall_rolling, only: roll_t, touch_t, find_slide, slide_on_patch, walk_patches, falls_away, &
                               time_slide
   use rockfall_direction, only: shortest
   use rockfall_local_frame, only: signed_w
   use rockfall_impact_table, only: impact_table_t, approach_t, outcome_t, whole_bin, find_window, is_held, &
                                    nearest_record, flies, rolls_on, stops
   use rockfall_table_contact, only: record_u, part_u, side_u, update_touch, resolve_on_plane, find_pull, find_record, &
                                     apply_record, limit_energy, after_fall, scale_to_energy, compute_departure, &
                                     takeoff_height
   use rockfall_line, only: boxes_touch
   use rockfall_line_index, only: is_near_lines
   use rockfall_flights, only: landings_t, landing_of, lanes, padded
   use rockfall_scene_type, only: scene_t
   implicit none
   private
   public :: table_batch_t, clear_batch, add_contact, handle_table_contacts, find_paths_near_lines

   !> Contacts by a table among the landings, each at the index of its landing. Elements are not cleared when they
   !> become free.
   type :: table_batch_t
      integer :: n = 0, landing(lanes) = 0                        !! indices of the n contacts
      logical, dimension(lanes) :: by_table = .false.             !! the contact is by a table
      integer, dimension(lanes) :: ground = 0, bin = 0, record = 0
      type(boulder_t) :: boulder(lanes)
      type(approach_t) :: in(lanes)
      real(wp), dimension(lanes) :: radius = 1, inertia = 0       !! R_b [m]; as in approach_t [-]
      real(wp), dimension(lanes) :: before1 = 0, before2 = 0      !! heading before, of any length
      real(wp), dimension(lanes) :: touches = 0, pressed = 0      !! still in previous contact: 1 or 0; its V_n [m/s]
      real(wp), dimension(lanes) :: tangential = 0, normal = 0, w = 0  !! V_t, V_n, W before the contact [m/s]
      real(wp), dimension(lanes) :: unit = 1                      !! sqrt(g R_b) [m/s]
      real(wp), dimension(lanes) :: t1 = 0, t2 = 0, t3 = 0        !! unit tangent [-]
      real(wp), dimension(lanes) :: side = 0, pull = 0            !! of the descent; gravity along tangent, over g [-]
      real(wp), dimension(lanes) :: speed_in = 0                  !! as in approach_t [-]
      real(wp), dimension(lanes) :: along = 0, across = 0, drawn = 0, w_drawn = 0  !! as in outcome_t; V_n, W [-]
      real(wp), dimension(lanes) :: allowed = 0, advance = 0, duration = 0         !! likewise [-]
      real(wp), dimension(lanes) :: lift = 0                      !! as in touch_t [-]
      real(wp), dimension(lanes) :: flown = 0, rolls = 0, stops = 0  !! kind of its end: 1 or 0
      real(wp), dimension(lanes) :: total = 0, left = 0           !! energies, as in limit_energy [-]
      real(wp), dimension(lanes) :: velocity_factor = 0, n_left = 0  !! as in scale_to_energy; V_n [-]
      real(wp), dimension(lanes) :: slide = 0, time = 0, speed = 0  !! as in find_slide [m], [s], [m/s]
      real(wp), dimension(lanes) :: inside = 0, off = 0           !! ends on its first patch; ground falls away: 1 or 0
      real(wp), dimension(lanes) :: i = 0, j = 0, z00 = 0, a = 0, b = 0, c = 0  !! patch of its end, as in patch_t
      real(wp), dimension(lanes) :: covered = 0                   !! length within the known terrain [m]
      real(wp), dimension(lanes) :: found = 0                     !! the loops find its end: 1 or 0
      real(wp), dimension(lanes) :: x = 0, y = 0, z = 0           !! end [m]
      real(wp), dimension(lanes) :: end1 = 0, end2 = 0            !! gradient at the end [-]
      real(wp), dimension(lanes) :: length = 0, slides = 0, waits = 0  !! from time_slide [m], [s]
      real(wp), dimension(lanes) :: near = 0                      !! 1: the path may cross a line
      real(wp), dimension(lanes) :: heading1 = 0, heading2 = 0    !! after the contact, of any length
      real(wp), dimension(lanes) :: next_w = 0                    !! W after the contact [m/s]
      real(wp), dimension(lanes) :: v1 = 0, v2 = 0, v3 = 0        !! of the next flight [m/s]
      real(wp), dimension(lanes) :: speed2 = 0, rate = 0, above = 0  !! of the next flight [m2/s2], [m/s], [m]
      logical, dimension(lanes) :: fast = .false., walks = .false.   !! as in table_contact_t; path in `roll`
      type(roll_t) :: roll(lanes)
   end type table_batch_t

contains

   subroutine clear_batch(b)
      type(table_batch_t), intent(inout) :: b

      b%n = 0
      b%by_table = .false.
   end subroutine clear_batch

   !> Add a contact.
   subroutine add_contact(b, k, table, ground, boulder, inertia, ratio, jump_height, w, heading1, heading2, touch)
      type(table_batch_t), intent(inout) :: b
      integer, intent(in) :: k                    !! its index
      type(impact_table_t), intent(in) :: table   !! of its ground
      integer, intent(in) :: ground
      type(boulder_t), intent(in) :: boulder
      real(wp), intent(in) :: inertia, ratio      !! I/(m R_b**2), R_b/R_m [-]
      real(wp), intent(in) :: jump_height, w      !! of the flight [m], W [m/s]
      real(wp), intent(in) :: heading1, heading2  !! after the previous contact, of any length
      type(touch_t), intent(inout) :: touch       !! of its boulder

      b%n = b%n + 1
      b%landing(b%n) = k
      b%by_table(k) = .true.
      b%ground(k) = ground
      b%boulder(k) = boulder
      b%inertia(k) = inertia
      b%radius(k) = boulder%radius
      b%w(k) = w
      b%before1(k) = heading1
      b%before2(k) = heading2
      call update_touch(table, ground, ratio, boulder%radius, jump_height, touch)
      b%touches(k) = merge(1.0_wp, 0.0_wp, touch%rolling)
      b%pressed(k) = touch%normal
   end subroutine add_contact

   !> Compute all contacts of a batch.
   subroutine handle_table_contacts(scene, l, g1, g2, steepness, word, paths, touch, b)
      type(scene_t), intent(in) :: scene
      type(landings_t), intent(in) :: l
      real(wp), dimension(lanes), intent(in) :: g1, g2, steepness  !! of the ground where they landed [-]
      integer(i8), intent(in) :: word(lanes, words_per_block)      !! random words
      logical, intent(in) :: paths                                 !! paths are needed for maps
      type(touch_t), intent(inout) :: touch(lanes)                 !! of each lane
      type(table_batch_t), intent(inout) :: b

      if (b%n == 0) return
      call compute_incidence(l, scene%gravity, g1, g2, steepness, word(:, side_u), b)
      call sort_contacts(b)
      call draw_records(scene, l%lane, word, touch, b)
      call follow_records(scene, l%lane, touch, b)
      call start_slides(l, scene%gravity, scene%dem%per_cell, b)
      if (.not. paths) call leave_patches(scene%dem, l, b)
      call end_slides(l, scene%gravity, scene%dem%per_cell, b)
      if (allocated(scene%lines)) call find_paths_near_lines(scene, l%n, l%x, l%y, b%x, b%y, b%near)
      call find_paths(scene, l, g1, g2, paths, b)
      call set_departures(l, g1, g2, steepness, b)
   end subroutine handle_table_contacts

   !> Transform the velocities to the local frames, in units of `unit` too.
   subroutine compute_incidence(l, gravity, g1, g2, steepness, word, b)
      type(landings_t), intent(in) :: l
      real(wp), intent(in) :: gravity  !! [m/s2]
      real(wp), dimension(lanes), intent(in) :: g1, g2, steepness
      integer(i8), intent(in) :: word(lanes)
      type(table_batch_t), intent(inout) :: b
      real(wp) :: normal, unit, a1, a2, a3, speed, along, across
      integer :: k

      !$omp simd private(normal, unit, a1, a2, a3, speed, along, across)
      do k = 1, padded(l%n)
         call resolve_on_plane(l%v1(k), l%v2(k), l%v3(k) - gravity*l%time(k), g1(k), g2(k), steepness(k), &
                               b%touches(k), b%pressed(k), b%tangential(k), normal, b%t1(k), b%t2(k), b%t3(k))
         b%normal(k) = normal
         b%w(k) = signed_w(b%w(k), b%before1(k), b%before2(k), b%t1(k), b%t2(k))
         call find_pull(g1(k), g2(k), steepness(k), b%t1(k), b%t2(k), b%t3(k), uniform(word(k)), along, across, &
                        b%side(k))
         unit = sqrt(gravity*b%radius(k))
         b%unit(k) = unit
         a1 = b%tangential(k)*(1/unit)
         a2 = normal*(1/unit)
         a3 = b%w(k)*(1/unit)
         speed = sqrt(a1*a1 + a2*a2)
         b%speed_in(k) = speed
         b%pull(k) = along
         b%in(k)%v(1) = a1
         b%in(k)%v(2) = a2
         b%in(k)%v(3) = a3
         b%in(k)%speed = speed
         b%in(k)%pull(1) = along
         b%in(k)%pull(2) = across
      end do
   end subroutine compute_incidence

   !> Put contacts by a flight before those of boulders that roll: their branches differ, and an unpredictable order
   !> would be mispredicted. Boulders that land along the normal have no tangent; `table_contact` handles them.
   subroutine sort_contacts(b)
      type(table_batch_t), intent(inout) :: b
      integer :: rolling(lanes + 1), n, n_rolling, m, k, moves, rolls

      n = 0
      n_rolling = 0
      do m = 1, b%n  ! branchless, as in `leave_patches`; those that fly move forward in place
         k = b%landing(m)
         b%by_table(k) = b%tangential(k) > shortest
         moves = merge(1, 0, b%tangential(k) > shortest)
         rolls = moves*int(b%touches(k))
         b%landing(n + 1) = k
         rolling(n_rolling + 1) = k
         n = n + moves - rolls
         n_rolling = n_rolling + rolls
      end do
      b%n = n + n_rolling
      b%landing(n + 1:b%n) = rolling(:n_rolling)
   end subroutine sort_contacts

   !> Draw the records, in loops of little each, so that many contacts overlap.
   subroutine draw_records(scene, lane, word, touch, b)
      type(scene_t), intent(in) :: scene
      integer, intent(in) :: lane(lanes)  !! of each contact
      integer(i8), intent(in) :: word(lanes, words_per_block)
      type(touch_t), intent(in) :: touch(lanes)  !! of each lane
      type(table_batch_t), intent(inout) :: b
      integer, dimension(lanes + 1) :: drawn, held, from, width
      integer :: n, n_held, m, k

      n = 0
      do m = 1, b%n
         k = b%landing(m)
         call find_record(scene%grounds(b%ground(k))%table, b%boulder(k), b%inertia(k), b%unit(k), &
                          uniform(word(k, part_u)), touch(lane(k)), b%in(k), b%bin(k), b%record(k), b%fast(k))
         drawn(n + 1) = k  ! branchless, as in `leave_patches`
         n = n + merge(1, 0, b%record(k) == 0)
      end do
      n_held = 0
      do m = 1, n
         k = drawn(m)
         call whole_bin(scene%grounds(b%ground(k))%table, b%bin(k), from(m), width(m))
         held(n_held + 1) = m
         n_held = n_held + merge(1, 0, is_held(b%in(k)%speed))
      end do
      do m = 1, n_held
         k = drawn(held(m))
         call find_window(scene%grounds(b%ground(k))%table, b%bin(k), b%in(k)%pull(1), from(held(m)), width(held(m)))
      end do
      do m = 1, n
         k = drawn(m)
         b%record(k) = nearest_record(scene%grounds(b%ground(k))%table, from(m), width(m), b%in(k)%pull(2), &
                                      uniform(word(k, record_u)))
      end do
   end subroutine draw_records

   subroutine follow_records(scene, lane, touch, b)
      type(scene_t), intent(in) :: scene
      integer, intent(in) :: lane(lanes)            !! of each contact
      type(touch_t), intent(inout) :: touch(lanes)  !! of each lane
      type(table_batch_t), intent(inout) :: b
      type(outcome_t) :: out
      integer :: m, k

      do m = 1, b%n
         k = b%landing(m)
         call apply_record(scene%grounds(b%ground(k))%table, b%bin(k), b%record(k), b%in(k), touch(lane(k)), out)
         b%along(k) = out%along
         b%across(k) = out%across
         b%drawn(k) = out%normal
         b%w_drawn(k) = out%w
         b%allowed(k) = out%allowed
         b%advance(k) = out%advance
         b%duration(k) = out%duration
         b%lift(k) = touch(lane(k))%lift
         b%rolls(k) = merge(1.0_wp, 0.0_wp, out%exit == rolls_on)
         b%flown(k) = merge(1.0_wp, 0.0_wp, out%exit == flies)
         b%stops(k) = merge(1.0_wp, 0.0_wp, out%exit == stops)
      end do
   end subroutine follow_records

   !> Find the lengths of contacts, and which of them end on their first patch.
   subroutine start_slides(l, gravity, per_cell, b)
      type(landings_t), intent(in) :: l
      real(wp), intent(in) :: gravity, per_cell  !! [m/s2], [1/m]
      type(table_batch_t), intent(inout) :: b
      real(wp) :: speed, slide, u, w, x, y, z, inside
      integer :: k

      !$omp simd private(speed, slide, u, w, x, y, z, inside)
      do k = 1, padded(l%n)
         call limit_energy(b%along(k), b%across(k), b%drawn(k), b%w_drawn(k), b%inertia(k), b%allowed(k), &
                           b%speed_in(k), b%advance(k), b%radius(k), b%total(k), b%left(k), speed, slide)
         b%slide(k) = slide
         b%covered(k) = slide
         b%speed(k) = b%unit(k)*speed
         b%time(k) = b%duration(k)*(b%unit(k)/gravity)
         call slide_on_patch(l%x(k), l%y(k), l%z(k), l%u(k), l%w(k), b%t1(k), b%t2(k), slide, per_cell, l%i(k), &
                             l%j(k), l%z00(k), l%a(k), l%b(k), l%c(k), x, y, z, u, w, inside)
         b%inside(k) = inside
         b%found(k) = inside
         b%i(k) = l%i(k)
         b%j(k) = l%j(k)
         b%z00(k) = l%z00(k)
         b%a(k) = l%a(k)
         b%b(k) = l%b(k)
         b%c(k) = l%c(k)
      end do
   end subroutine start_slides

   !> Find the patches on which the other contacts end.
   subroutine leave_patches(dem, l, b)
      type(terrain_t), intent(in) :: dem
      type(landings_t), intent(in) :: l
      type(table_batch_t), intent(inout) :: b
      type(patch_t) :: patch, beyond
      logical :: known
      integer :: leaving(lanes + 1), n, m, k

      n = 0
      do m = 1, b%n  ! branchless: the outcome is unpredictable
         k = b%landing(m)
         leaving(n + 1) = k
         n = n + 1 - int(b%inside(k))
      end do
      do m = 1, n
         k = leaving(m)
         patch = patch_t(int(l%i(k)), int(l%j(k)), l%z00(k), l%a(k), l%b(k), l%c(k), .true.)
         call walk_patches(dem, l%x(k), l%y(k), [b%t1(k), b%t2(k)], b%covered(k), patch, beyond, known)
         b%found(k) = merge(1.0_wp, 0.0_wp, known)
         b%i(k) = patch%i
         b%j(k) = patch%j
         b%z00(k) = patch%z00
         b%a(k) = patch%a
         b%b(k) = patch%b
         b%c(k) = patch%c
      end do
   end subroutine leave_patches

   !> Find the ends of contacts: where the ground falls away, the point where they begin.
   subroutine end_slides(l, gravity, per_cell, b)
      type(landings_t), intent(in) :: l
      real(wp), intent(in) :: gravity, per_cell  !! [m/s2], [1/m]
      type(table_batch_t), intent(inout) :: b
      real(wp) :: slide, time, u, w, x, y, z, inside, off
      integer :: k

      !$omp simd private(slide, time, u, w, x, y, z, inside, off)
      do k = 1, padded(l%n)
         call slide_on_patch(l%x(k), l%y(k), l%z(k), l%u(k), l%w(k), b%t1(k), b%t2(k), b%covered(k), per_cell, &
                             b%i(k), b%j(k), b%z00(k), b%a(k), b%b(k), b%c(k), x, y, z, u, w, inside)
         off = falls_away(l%z(k) - z, b%t3(k), b%covered(k), gravity, b%time(k))
         b%off(k) = off
         slide = merge(0.0_wp, b%covered(k), off > 0)
         time = merge(0.0_wp, b%time(k), off > 0)
         b%i(k) = merge(l%i(k), b%i(k), off > 0)
         b%j(k) = merge(l%j(k), b%j(k), off > 0)
         b%z00(k) = merge(l%z00(k), b%z00(k), off > 0)
         b%a(k) = merge(l%a(k), b%a(k), off > 0)
         b%b(k) = merge(l%b(k), b%b(k), off > 0)
         b%c(k) = merge(l%c(k), b%c(k), off > 0)
         call slide_on_patch(l%x(k), l%y(k), l%z(k), l%u(k), l%w(k), b%t1(k), b%t2(k), slide, per_cell, b%i(k), &
                             b%j(k), b%z00(k), b%a(k), b%b(k), b%c(k), x, y, z, u, w, inside)
         b%found(k) = min(b%found(k), inside)
         call time_slide(b%t1(k), b%t2(k), slide, l%z(k) - z, time, b%speed(k), b%length(k), b%slides(k), b%waits(k))
         b%x(k) = x
         b%y(k) = y
         b%z(k) = z
         b%end1(k) = slope_at(b%a(k), b%c(k), w, per_cell)
         b%end2(k) = slope_at(b%b(k), b%c(k), u, per_cell)
      end do
   end subroutine end_slides

   !> Find the straight paths that may cross a line.
   subroutine find_paths_near_lines(scene, n, x0, y0, x, y, near)
      type(scene_t), intent(in) :: scene
      integer, intent(in) :: n
      real(wp), dimension(lanes), intent(in) :: x0, y0, x, y  !! both ends [m]
      real(wp), dimension(lanes), intent(out) :: near         !! 1 or 0
      real(wp) :: low1, low2, high1, high2
      integer :: line, k

      if (allocated(scene%line_index)) then
         do k = 1, n
            near(k) = merge(1.0_wp, 0.0_wp, is_near_lines(scene%line_index, [x0(k), y0(k)], [x(k), y(k)]))
         end do
         return
      end if
      near = 0
      do line = 1, size(scene%lines)
         low1 = scene%lines(line)%low(1)
         low2 = scene%lines(line)%low(2)
         high1 = scene%lines(line)%high(1)
         high2 = scene%lines(line)%high(2)
         !$omp simd
         do k = 1, padded(n)
            near(k) = max(near(k), boxes_touch(low1, low2, high1, high2, x0(k), y0(k), x(k), y(k)))
         end do
      end do
   end subroutine find_paths_near_lines

   !> Find the paths of the other contacts, and of those whose path is needed.
   subroutine find_paths(scene, l, g1, g2, paths, b)
      type(scene_t), intent(in) :: scene
      type(landings_t), intent(in) :: l
      real(wp), dimension(lanes), intent(in) :: g1, g2
      logical, intent(in) :: paths
      type(table_batch_t), intent(inout) :: b
      real(wp) :: g(2)
      logical :: off
      integer :: m, k

      do m = 1, b%n
         k = b%landing(m)
         b%walks(k) = paths .or. .not. b%found(k) > b%near(k)
         if (.not. b%walks(k)) cycle
         associate (roll => b%roll(k))
            call find_slide(scene%dem, scene%gravity, landing_of(l, k), [b%t1(k), b%t2(k), b%t3(k)], b%slide(k), &
                            b%time(k), b%speed(k), roll, off)
            g = [g1(k), g2(k)]
            if (roll%landing%contact) g = gradient(scene%dem, roll%landing%patch, roll%landing%u, roll%landing%w)
            b%z(k) = roll%landing%z
         end associate
         b%off(k) = merge(1.0_wp, 0.0_wp, off)
         b%end1(k) = g(1)
         b%end2(k) = g(2)
      end do
   end subroutine find_paths

   !> Compute the velocities after the contacts.
   subroutine set_departures(l, g1, g2, steepness, b)
      type(landings_t), intent(in) :: l
      real(wp), dimension(lanes), intent(in) :: g1, g2, steepness
      type(table_batch_t), intent(inout) :: b
      real(wp) :: left, lift, velocity_factor, normal, rests, rolls, pressed, unit
      integer :: k

      !$omp simd private(left, lift, velocity_factor, normal, rests, rolls, pressed, unit)
      do k = 1, padded(l%n)
         left = after_fall(b%left(k), (l%z(k) - b%z(k) - b%pull(k)*b%slide(k))/b%radius(k), b%off(k))
         lift = b%lift(k)
         rolls = merge(0.0_wp, b%rolls(k), b%off(k) > 0)
         call scale_to_energy(b%total(k), left, b%along(k), b%across(k), b%drawn(k), b%w_drawn(k), b%inertia(k), &
                              steepness(k), b%flown(k), lift, velocity_factor, normal, rests)
         b%velocity_factor(k) = velocity_factor
         b%n_left(k) = normal
         b%stops(k) = max(b%stops(k), rests)
         unit = b%unit(k)
         b%next_w(k) = unit*(velocity_factor*b%w_drawn(k))
         pressed = b%pressed(k)
         call compute_departure(unit*(velocity_factor*b%along(k)), unit*(velocity_factor*b%side(k)*b%across(k)), &
                                unit*normal, &
                                g1(k), g2(k), steepness(k), b%t1(k), b%t2(k), b%t3(k), b%end1(k), b%end2(k), rolls, &
                                pressed, b%heading1(k), b%heading2(k), b%v1(k), b%v2(k), b%v3(k))
         b%pressed(k) = pressed
         b%rolls(k) = rolls
         b%lift(k) = lift
         b%above(k) = takeoff_height(lift, b%radius(k), rolls)
         b%speed2(k) = b%v1(k)*b%v1(k) + b%v2(k)*b%v2(k) + b%v3(k)*b%v3(k)
         b%rate(k) = b%v3(k) - (b%end1(k)*b%v1(k) + b%end2(k)*b%v2(k))
      end do
   end subroutine set_departures
end module rockfall_table_lanes
