! SPDX-License-Identifier: BSD-3-Clause
!> Contacts from impact tables, for several boulders at a time. Each contact performs the steps of `table_contact` in
!> the same order, so results are bitwise identical. Steps with roots and divisions are loops over all contacts. Records
!> are chosen in several short loops before the first is read, so that memory accesses overlap. `find_slide` is only
!> called for paths whose energies are needed, that may cross a line, or that leave the known terrain.
!>
!> Compiled three times, like rockfall_lanes.
module rockfall_table_lanes
   use, intrinsic :: iso_c_binding, only: c_int, c_ptr, c_loc
   use rockfall_kinds, only: wp, sp, i8
   use rockfall_random, only: words_per_block, uniform
   use rockfall_terrain, only: terrain_t, patch_t, slope_at, gradient
   use rockfall_boulder, only: boulder_t, soil_draw_t
   use rockfall_rolling, only: roll_t, touch_t, find_slide, slide_on_patch, walk_patches, falls_away, &
                               time_slide
   use rockfall_direction, only: shortest
   use rockfall_local_frame, only: signed_w
   use rockfall_impact_table, only: impact_table_t, bins_t, approach_t, followed_record, is_copied, &
                                    bin_keys, bins_before, exceeds_table, whole_bin, find_window, &
                                    is_held, nearest_record, speed_scale, input_change, mapped_shift, own_duration, &
                                    own_reach, own_velocity, held_longer, takes_shift, allowed_energy, t_in, n_in, &
                                    w_in, speed_in, height_in, along_out, across_out, n_out, w_out, duration_out, &
                                    advance_out, rise_out, pull_along, pull_across, exit_code, follower, &
                                    record_fields, map_fields, along_map, n_map, w_map, low, high, flies, rolls_on, &
                                    stops
   use rockfall_table_contact, only: record_u, side_u, update_touch, resolve_on_plane, find_pull, &
                                     limit_energy, after_fall, scale_to_energy, compute_departure, takeoff_height, &
                                     keeps_sequence
   use rockfall_line, only: boxes_touch
   use rockfall_line_index, only: is_near_lines
   use rockfall_flights, only: landings_t, landing_of, lanes, padded
   use rockfall_scene_type, only: scene_t
   implicit none
   private
   public :: table_batch_t, clear_batch, add_contact, handle_table_contacts, find_paths_near_lines, read_rows, find_bins

   !> Stride between fields of the records: a power of two would map all values of a lane to the same few cache sets.
   integer, parameter :: column = lanes + 8

   !> Contacts from a table among the landings, each at the index of its landing. Free elements keep their old values.
   type :: table_batch_t
      integer :: n = 0, landing(lanes) = 0                        !! indices of the n contacts
      logical, dimension(lanes) :: by_table = .false.             !! the contact is from a table
      integer, dimension(lanes) :: ground = 0, part = 0, bin = 0, record = 0
      real(wp), dimension(lanes) :: volume = 1, mass = 1          !! as in boulder_t [m3], [kg]
      real(wp), dimension(lanes) :: radius = 1, inertia = 0       !! R_b [m]; as in approach_t [-]
      real(wp), dimension(lanes) :: before1 = 0, before2 = 0      !! heading before the contact, of any length
      real(wp), dimension(lanes) :: touches = 0, pressed = 0      !! 1 if still in the previous contact; its V_n [m/s]
      real(wp), dimension(lanes) :: tangential = 0, normal = 0, w = 0  !! V_t, V_n, W before the contact [m/s]
      real(wp), dimension(lanes) :: unit = 1                      !! sqrt(g R_b) [m/s]
      real(wp), dimension(lanes) :: t1 = 0, t2 = 0, t3 = 0        !! unit tangent [-]
      real(wp), dimension(lanes) :: side = 0, pull = 0            !! side of descent; gravity along tangent, over g [-]
      real(wp), dimension(lanes) :: v1_in = 0, v2_in = 0, v3_in = 0, speed_in = 0  !! as in approach_t [-]
      real(wp), dimension(lanes) :: key = 1                       !! as in approach_t [-]
      real(wp), dimension(lanes) :: fastest = 0                   !! as in impact_table_t
      real(wp), dimension(lanes) :: key1 = 0, key2 = 0, key3 = 0, over1 = 1, over2 = 1  !! as in bin_keys
      real(wp), dimension(lanes) :: fast = 0                      !! as in table_contact_t: 1 or 0
      real(wp), dimension(lanes) :: next = 0                      !! as in outcome_t
      real(wp), dimension(lanes) :: along = 0, across = 0, drawn = 0, w_drawn = 0  !! as in outcome_t; V_n, W [-]
      real(wp), dimension(lanes) :: allowed = 0, reach = 0, duration = 0           !! as in outcome_t [-]
      real(wp), dimension(lanes) :: lift = 0, height = 0          !! as in touch_t [-]
      real(wp), dimension(lanes) :: copies = 1                    !! 1 if the record is copied, else 0
      real(wp), dimension(lanes) :: hold = 0                      !! as in impact_table_t [-]
      real(wp), dimension(lanes) :: stretch = 1, pull_across = 0  !! as in approach_t [-]
      real(wp) :: r(column, record_fields) = 1, map(column, map_fields) = 0  !! record and map of each contact
      type(c_ptr), dimension(lanes) :: record_at, map_at          !! addresses of record and map
      real(sp) :: no_record(record_fields) = 1                    !! stands in for the record of contacts without one
      real(wp) :: no_map(map_fields) = 0
      real(wp), dimension(lanes) :: flown = 0, rolls = 0, stops = 0  !! type of the contact's end, each 1 or 0
      real(wp), dimension(lanes) :: rolled = 0                    !! 1 if the block of the record rolled, else 0
      real(wp), dimension(lanes) :: total = 0, left = 0, per_total = 0  !! energies, as in limit_energy [-]
      real(wp), dimension(lanes) :: velocity_factor = 0, n_left = 0  !! as in scale_to_energy; V_n [-]
      real(wp), dimension(lanes) :: slide = 0, time = 0, speed = 0  !! as in find_slide [m], [s], [m/s]
      real(wp), dimension(lanes) :: inside = 0, off = 0  !! path ends on its first patch; leaves the ground: 1 or 0
      real(wp), dimension(lanes) :: i = 0, j = 0, z00 = 0, a = 0, b = 0, c = 0  !! patch at the end, as in patch_t
      real(wp), dimension(lanes) :: covered = 0                   !! length within the known terrain, up to the end [m]
      real(wp), dimension(lanes) :: found = 0                     !! 1 if the vectorised loops find the end, else 0
      real(wp), dimension(lanes) :: x = 0, y = 0, z = 0           !! end [m]
      real(wp), dimension(lanes) :: end1 = 0, end2 = 0            !! gradient at the end [-]
      real(wp), dimension(lanes) :: length = 0, slides = 0, waits = 0  !! from time_slide [m], [s]
      real(wp), dimension(lanes) :: near = 0                      !! 1 if the path may cross a line
      real(wp), dimension(lanes) :: heading1 = 0, heading2 = 0    !! heading after the contact, of any length
      real(wp), dimension(lanes) :: next_w = 0                    !! W after the contact [m/s]
      real(wp), dimension(lanes) :: v1 = 0, v2 = 0, v3 = 0        !! velocity of the next flight [m/s]
      real(wp), dimension(lanes) :: speed2 = 0, rate = 0, above = 0  !! speed**2; as in flight_t [m2/s2], [m/s], [m]
      logical, dimension(lanes) :: walks = .false.                !! the path is in `roll`
      type(roll_t) :: roll(lanes)
   end type table_batch_t

   interface
      !> Read records and maps of bins from their addresses into columns.
      subroutine read_rows(n, column, record_fields, record_at, record, map_fields, map_at, map) &
         bind(c, name="rockfall_read_rows")
         import :: c_int, c_ptr, wp
         integer(c_int), value :: n, column, record_fields, map_fields  !! multiples of 4
         type(c_ptr), intent(in) :: record_at(*), map_at(*)       !! records in single, maps in double precision
         real(wp), intent(inout) :: record(column, *), map(column, *)
      end subroutine read_rows

      !> Find the bins of n contacts of one kind, from the same table, counted from the first bin of their part.
      subroutine find_bins(n, contact, key1, over1, key2, over2, key3, part, count, vectors, first_edge, second_edge, &
                           third_edge, bin) bind(c, name="rockfall_find_bins")
         import :: c_int, wp
         integer(c_int), value :: n
         integer(c_int), intent(in) :: contact(*)  !! indices of the contacts
         real(wp), dimension(*), intent(in) :: key1, over1, key2, over2, key3  !! as from bin_keys, for each contact
         integer(c_int), intent(in) :: part(*)     !! part of the table for each contact
         integer(c_int), intent(in) :: count(3), vectors(3)  !! n, vectors of bins_t
         real(wp), dimension(*), intent(in) :: first_edge, second_edge, third_edge  !! as in bins_t
         integer(c_int), intent(inout) :: bin(*)
      end subroutine find_bins
   end interface

contains

   subroutine clear_batch(b)
      type(table_batch_t), intent(inout) :: b

      b%n = 0
      b%by_table = .false.
   end subroutine clear_batch

   subroutine add_contact(b, k, table, ground, boulder, soil, gravity, inertia, ratio, jump_height, w, heading1, &
                          heading2, touch)
      type(table_batch_t), intent(inout) :: b
      integer, intent(in) :: k                    !! index of the landing
      type(impact_table_t), intent(in) :: table   !! impact table of the ground
      integer, intent(in) :: ground
      type(boulder_t), intent(in) :: boulder
      type(soil_draw_t), intent(in) :: soil
      real(wp), intent(in) :: gravity             !! [m/s2]
      real(wp), intent(in) :: inertia, ratio      !! I/(m R_b**2), R_b/R_m [-]
      real(wp), intent(in) :: jump_height, w      !! maximum height of the flight [m]; W [m/s]
      real(wp), intent(in) :: heading1, heading2  !! heading after the previous contact, of any length
      type(touch_t), intent(inout) :: touch       !! state of the boulder

      b%n = b%n + 1
      b%landing(b%n) = k
      b%by_table(k) = .true.
      b%ground(k) = ground
      b%volume(k) = boulder%volume
      b%mass(k) = boulder%mass
      b%inertia(k) = inertia
      b%radius(k) = boulder%radius
      b%w(k) = w
      b%before1(k) = heading1
      b%before2(k) = heading2
      call update_touch(table, ground, ratio, boulder, soil, gravity, jump_height, touch)
      b%touches(k) = merge(1.0_wp, 0.0_wp, touch%rolling)
      b%pressed(k) = touch%normal
   end subroutine add_contact

   !> Compute all contacts of a batch.
   subroutine handle_table_contacts(scene, l, g1, g2, steepness, word, paths, touch, b)
      type(scene_t), intent(in), target :: scene
      type(landings_t), intent(in) :: l
      real(wp), dimension(lanes), intent(in) :: g1, g2, steepness  !! gradient and steepness at the landings [-]
      integer(i8), intent(in) :: word(lanes, words_per_block)      !! random words
      logical, intent(in) :: paths                                 !! compute all paths
      type(touch_t), intent(in) :: touch(lanes)                    !! state of each lane's boulder
      type(table_batch_t), intent(inout), target :: b
      integer :: first(2*size(scene%grounds) + 1)

      if (b%n == 0) return
      call compute_incidence(l, scene%gravity, g1, g2, steepness, word(:, side_u), b)
      call sort_contacts(b, first)
      call draw_records(scene, l, first, word, touch, b)
      call follow_records(l, b)
      call start_slides(l, scene%gravity, scene%dem%per_cell, b)
      if (.not. paths) call leave_patches(scene%dem, l, b)
      call end_slides(l, scene%gravity, scene%dem%per_cell, b)
      if (allocated(scene%lines)) call find_paths_near_lines(scene, l%n, l%x, l%y, b%x, b%y, b%near)
      call find_paths(scene, l, g1, g2, paths, b)
      call set_departures(l, g1, g2, steepness, b)
   end subroutine handle_table_contacts

   !> Transform the velocities to the local frames, also in units of `unit`.
   subroutine compute_incidence(l, gravity, g1, g2, steepness, word, b)
      type(landings_t), intent(in) :: l
      real(wp), intent(in) :: gravity  !! [m/s2]
      real(wp), dimension(lanes), intent(in) :: g1, g2, steepness  !! as in handle_table_contacts [-]
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
         call find_pull(g1(k), g2(k), 1/steepness(k), b%t1(k), b%t2(k), b%t3(k), uniform(word(k)), along, across, &
                        b%side(k))
         unit = sqrt(gravity*b%radius(k))
         b%unit(k) = unit
         a1 = b%tangential(k)*(1/unit)
         a2 = normal*(1/unit)
         a3 = b%w(k)*(1/unit)
         speed = sqrt(a1*a1 + a2*a2)
         b%speed_in(k) = speed
         b%pull(k) = along
         b%pull_across(k) = across
         b%v1_in(k) = a1
         b%v2_in(k) = a2
         b%v3_in(k) = a3
      end do
   end subroutine compute_incidence

   !> Sort contacts by ground; within a ground, contacts after flights come before contacts of rolling boulders.
   !> Boulders that land along the normal have no tangent; `table_contact` handles them.
   subroutine sort_contacts(b, first)
      type(table_batch_t), intent(inout) :: b
      integer, intent(out) :: first(:)  !! first contact after flights (2*ground - 1) and of rolls (2*ground)
      integer :: kind(lanes), place(size(first)), number(size(first)), landing(lanes), m, k

      number = 0
      do m = 1, b%n
         k = b%landing(m)
         b%by_table(k) = b%tangential(k) > shortest
         kind(m) = merge(2*b%ground(k) - 1 + int(b%touches(k)), size(first), b%tangential(k) > shortest)
         number(kind(m)) = number(kind(m)) + 1
         landing(m) = k
      end do
      first(1) = 1
      do k = 2, size(first)
         first(k) = first(k - 1) + number(k - 1)
      end do
      place = first
      do m = 1, b%n
         k = place(kind(m))
         place(kind(m)) = k + 1
         b%landing(k) = landing(m)
      end do
      b%n = first(size(first)) - 1
   end subroutine sort_contacts

   !> Draw the records of all contacts.
   subroutine draw_records(scene, l, first, word, touch, b)
      type(scene_t), intent(in), target :: scene
      type(landings_t), intent(in) :: l
      integer, intent(in) :: first(:)                               !! as returned by sort_contacts
      integer(i8), intent(in) :: word(lanes, words_per_block)
      type(touch_t), intent(in) :: touch(lanes)                     !! state of each lane's boulder
      type(table_batch_t), intent(inout), target :: b
      integer :: ground, last

      do ground = 1, size(scene%grounds)
         last = first(2*ground + 1) - 1
         if (first(2*ground - 1) > last) cycle
         call find_parts(scene%grounds(ground)%table, b%landing(first(2*ground - 1):last), l%lane, touch, b)
      end do
      call find_keys(l, b)
      b%record_at = c_loc(b%no_record)
      b%map_at = c_loc(b%no_map)
      do ground = 1, size(scene%grounds)
         last = first(2*ground + 1) - 1
         if (first(2*ground - 1) > last) cycle
         associate (table => scene%grounds(ground)%table)
            call find_kind_bins(table, table%flights, .false., b%landing(first(2*ground - 1):first(2*ground) - 1), b)
            call find_kind_bins(table, table%rolls, .true., b%landing(first(2*ground):last), b)
            call choose_records(table, b%landing(first(2*ground - 1):last), word(:, record_u), b)
         end associate
      end do
   end subroutine draw_records

   !> Find the part of the table for each boulder, and the record of a contact that follows the recorded sequence.
   subroutine find_parts(table, contact, lane, touch, b)
      type(impact_table_t), intent(in) :: table
      integer, intent(in) :: contact(:)          !! indices of the contacts that use this table
      integer, intent(in) :: lane(lanes)         !! lane of each contact
      type(touch_t), intent(in) :: touch(lanes)  !! state of each lane's boulder
      type(table_batch_t), intent(inout) :: b
      type(approach_t) :: in
      integer :: m, k

      do m = 1, size(contact)
         k = contact(m)
         associate (kept => touch(lane(k)))
            in%v = [b%v1_in(k), b%v2_in(k), b%v3_in(k)]
            in%speed = b%speed_in(k)
            in%pull = [b%pull(k), b%pull_across(k)]
            in%height = kept%height
            in%rolling = kept%rolling
            in%next = kept%next
            b%record(k) = followed_record(table, in)
            b%lift(k) = kept%lift
            b%height(k) = kept%height
            b%part(k) = kept%part
            b%key(k) = kept%key
         end associate
         b%copies(k) = merge(1.0_wp, 0.0_wp, is_copied(table, max(1, b%record(k))))
         b%copies(k) = min(b%copies(k), real(b%record(k), wp))  ! 0 if the contact does not follow the recorded sequence
         b%hold(k) = table%hold
      end do
   end subroutine find_parts

   !> Find the keys of the bins.
   subroutine find_keys(l, b)
      type(landings_t), intent(in) :: l
      type(table_batch_t), intent(inout) :: b
      real(wp) :: rolling, key1, over1, key2, over2, key3
      integer :: k

      !$omp simd private(rolling, key1, over1, key2, over2, key3)
      do k = 1, padded(l%n)
         rolling = b%touches(k)
         call bin_keys(b%v2_in(k), b%v3_in(k), b%speed_in(k), b%height(k), b%key(k), rolling, key1, over1, &
                       key2, over2, key3)
         b%stretch(k) = sqrt(b%key(k))
         b%key1(k) = key1
         b%over1(k) = over1
         b%key2(k) = key2
         b%over2(k) = over2
         b%key3(k) = key3
      end do
   end subroutine find_keys

   !> Find the bins of contacts of one kind.
   subroutine find_kind_bins(table, bins, rolling, contact, b)
      type(impact_table_t), intent(in) :: table
      type(bins_t), intent(in) :: bins           !! bins for this kind of contact
      logical, intent(in) :: rolling             !! kind of the contacts: rolling, or after a flight
      integer, intent(in) :: contact(:)
      type(table_batch_t), intent(inout) :: b
      integer :: m, k

      call find_bins(size(contact), contact, b%key1, b%over1, b%key2, b%over2, b%key3, b%part, bins%n, bins%vectors, &
                     bins%first_edge, bins%second_edge, bins%third_edge, b%bin)
      do m = 1, size(contact)
         k = contact(m)
         b%bin(k) = bins_before(table, b%part(k), rolling) + b%bin(k)
      end do
   end subroutine find_kind_bins

   !> Choose the records of contacts that do not follow a sequence, in short loops, so that memory accesses overlap.
   subroutine choose_records(table, contact, word, b)
      type(impact_table_t), intent(in), target :: table
      integer, intent(in) :: contact(:)  !! indices of the contacts that use this table
      integer(i8), intent(in) :: word(lanes)
      type(table_batch_t), intent(inout) :: b
      integer, dimension(lanes + 1) :: drawn, held, from, width
      integer :: n, n_held, m, k

      n = 0
      do m = 1, size(contact)
         k = contact(m)
         drawn(n + 1) = k  ! branchless for the same reason as in `leave_patches`
         n = n + merge(1, 0, b%record(k) == 0)
      end do
      n_held = 0
      do m = 1, n
         k = drawn(m)
         call whole_bin(table, b%bin(k), from(m), width(m))
         held(n_held + 1) = m
         n_held = n_held + merge(1, 0, is_held(b%speed_in(k)))
      end do
      do m = 1, n_held
         k = drawn(held(m))
         call find_window(table, b%bin(k), b%pull(k), from(held(m)), width(held(m)))
      end do
      do m = 1, n
         k = drawn(m)
         b%record(k) = nearest_record(table, from(m), width(m), b%pull_across(k), uniform(word(k)))
      end do
      do m = 1, size(contact)
         k = contact(m)
         b%record_at(k) = c_loc(table%record(1, b%record(k)))
         b%map_at(k) = c_loc(table%map(1, b%bin(k)))
         b%fastest(k) = table%fastest(b%bin(k))
      end do
   end subroutine choose_records

   !> Apply the records, as `transfer_record` does.
   subroutine follow_records(l, b)
      type(landings_t), intent(in) :: l
      type(table_batch_t), intent(inout) :: b
      real(wp) :: rolling, copies, keeps, ratio, scale, unit, change1, change2, change3, change4, duration, along, &
                  across, normal, w, n_shift, shifts, height
      integer :: k

      call read_rows(padded(l%n), column, record_fields, b%record_at, b%r, map_fields, b%map_at, b%map)
      !$omp simd private(rolling, copies, keeps, ratio, scale, unit, change1, change2, change3, change4, duration, &
      !$omp& along, across, normal, w, n_shift, shifts, height)
      do k = 1, padded(l%n)
         rolling = b%touches(k)
         copies = b%copies(k)
         b%fast(k) = exceeds_table(b%fastest(k), b%key3(k), copies)
         ratio = b%speed_in(k)/b%r(k, speed_in)
         scale = speed_scale(ratio, rolling, b%v1_in(k), b%map(k, high + 1))
         unit = merge(scale, b%speed_in(k), rolling > 0)
         change1 = input_change(b%v1_in(k), unit, b%map(k, low + 1), b%map(k, high + 1), scale*b%r(k, t_in))
         change2 = input_change(b%v2_in(k), unit, b%map(k, low + 2), b%map(k, high + 2), scale*b%r(k, n_in))
         change3 = input_change(b%v3_in(k), b%speed_in(k), b%map(k, low + 3), b%map(k, high + 3), scale*b%r(k, w_in))
         change4 = input_change(b%height(k), 1.0_wp, b%map(k, low + 4), b%map(k, high + 4), b%r(k, height_in))
         change4 = merge(change4, 0.0_wp, rolling > 0)
         keeps = max(rolling, copies)
         duration = own_duration(b%r(k, duration_out), keeps, b%stretch(k))
         along = own_velocity(scale, b%r(k, along_out), b%pull(k), duration, b%r(k, pull_along), b%r(k, duration_out))
         along = held_longer(along, rolling, b%hold(k), b%pull(k), b%pull_across(k), b%stretch(k), &
                             b%r(k, duration_out))
         across = own_velocity(scale, b%r(k, across_out), b%pull_across(k), duration, b%r(k, pull_across), &
                               b%r(k, duration_out))
         normal = scale*b%r(k, n_out)
         w = scale*b%r(k, w_out)
         n_shift = mapped_shift(change1, change2, change3, change4, b%map(k, n_map + 1), b%map(k, n_map + 2), &
                                b%map(k, n_map + 3), b%map(k, n_map + 4))
         shifts = takes_shift(b%r(k, exit_code), normal, n_shift)
         along = merge(along + mapped_shift(change1, change2, change3, change4, &
                                            b%map(k, along_map + 1), b%map(k, along_map + 2), &
                                            b%map(k, along_map + 3), b%map(k, along_map + 4)), along, shifts > 0)
         normal = merge(normal + n_shift, normal, shifts > 0)
         w = merge(w + mapped_shift(change1, change2, change3, change4, &
                                    b%map(k, w_map + 1), b%map(k, w_map + 2), &
                                    b%map(k, w_map + 3), b%map(k, w_map + 4)), w, shifts > 0)
         height = merge(b%height(k), b%r(k, height_in), rolling > 0)
         b%along(k) = merge(b%r(k, along_out), along, copies > 0)
         b%across(k) = merge(b%r(k, across_out), across, copies > 0)
         b%drawn(k) = merge(b%r(k, n_out), normal, copies > 0)
         b%w_drawn(k) = merge(b%r(k, w_out), w, copies > 0)
         b%duration(k) = duration
         b%reach(k) = own_reach(b%r(k, advance_out), keeps, b%stretch(k), b%r(k, speed_in), b%r(k, along_out), &
                                b%r(k, across_out), b%r(k, n_out))
         b%height(k) = merge(b%r(k, height_in), height, copies > 0) + b%r(k, rise_out)
         b%allowed(k) = allowed_energy(b%v1_in(k), b%v2_in(k), b%v3_in(k), b%inertia(k), b%pull(k), ratio, &
                                       b%r(k, t_in), b%r(k, n_in), b%r(k, w_in), b%r(k, along_out), &
                                       b%r(k, across_out), b%r(k, n_out), b%r(k, w_out), b%r(k, pull_along), &
                                       b%r(k, advance_out))
         b%lift(k) = b%lift(k) + b%r(k, rise_out)
         b%next(k) = b%r(k, follower)
         b%rolls(k) = merge(1.0_wp, 0.0_wp, abs(b%r(k, exit_code) - rolls_on) <= 0)
         b%rolled(k) = b%rolls(k)
         b%flown(k) = merge(1.0_wp, 0.0_wp, abs(b%r(k, exit_code) - flies) <= 0)
         b%stops(k) = merge(1.0_wp, 0.0_wp, abs(b%r(k, exit_code) - stops) <= 0)
      end do
   end subroutine follow_records

   !> Find the lengths of the paths of contacts, and which paths end on their first patch.
   subroutine start_slides(l, gravity, per_cell, b)
      type(landings_t), intent(in) :: l
      real(wp), intent(in) :: gravity, per_cell  !! [m/s2], [1/m]
      type(table_batch_t), intent(inout) :: b
      real(wp) :: speed, slide, u, w, x, y, z, inside
      integer :: k

      !$omp simd private(speed, slide, u, w, x, y, z, inside)
      do k = 1, padded(l%n)
         call limit_energy(b%along(k), b%across(k), b%drawn(k), b%w_drawn(k), b%inertia(k), b%allowed(k), &
                           b%speed_in(k), b%pull(k), b%reach(k), b%radius(k), b%total(k), b%left(k), &
                           b%per_total(k), speed, slide)
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

   !> Find the last patches of the paths that leave their first patch.
   subroutine leave_patches(dem, l, b)
      type(terrain_t), intent(in) :: dem
      type(landings_t), intent(in) :: l
      type(table_batch_t), intent(inout) :: b
      type(patch_t) :: patch, beyond
      logical :: known
      integer :: leaving(lanes + 1), n, m, k

      n = 0
      do m = 1, b%n  ! branchless, because the outcome is unpredictable
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

   !> Find the ends of the paths; where the ground falls away, a path ends at its start.
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
         b%covered(k) = slide
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
      real(wp), dimension(lanes), intent(in) :: x0, y0, x, y  !! ends of the paths [m]
      real(wp), dimension(lanes), intent(out) :: near         !! 1 if the path may cross a line, else 0
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

   !> Trace one by one the paths whose ends the vector loops did not find, or that may cross a line; all if requested.
   subroutine find_paths(scene, l, g1, g2, paths, b)
      type(scene_t), intent(in) :: scene
      type(landings_t), intent(in) :: l
      real(wp), dimension(lanes), intent(in) :: g1, g2  !! as in handle_table_contacts [-]
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
      real(wp), dimension(lanes), intent(in) :: g1, g2, steepness  !! as in handle_table_contacts [-]
      type(table_batch_t), intent(inout) :: b
      real(wp) :: left, lift, velocity_factor, normal, rests, rolls, pressed, unit, cosine
      integer :: k

      !$omp simd private(left, lift, velocity_factor, normal, rests, rolls, pressed, unit, cosine)
      do k = 1, padded(l%n)
         left = after_fall(b%left(k), (l%z(k) - b%z(k) - b%pull(k)*b%slide(k))/b%radius(k), b%off(k))
         lift = b%lift(k)
         cosine = 1/steepness(k)
         rolls = merge(0.0_wp, b%rolls(k), b%off(k) > 0)
         call scale_to_energy(b%per_total(k), left, b%along(k), b%across(k), b%drawn(k), b%w_drawn(k), b%inertia(k), &
                              cosine, b%flown(k), lift, velocity_factor, normal, rests)
         b%velocity_factor(k) = velocity_factor
         b%n_left(k) = normal
         b%stops(k) = max(b%stops(k), rests)
         unit = b%unit(k)
         b%next_w(k) = unit*(velocity_factor*b%w_drawn(k))
         pressed = b%pressed(k)
         call compute_departure(unit*(velocity_factor*b%along(k)), unit*(velocity_factor*b%side(k)*b%across(k)), &
                                unit*normal, &
                                g1(k), g2(k), cosine, b%t1(k), b%t2(k), b%t3(k), b%end1(k), b%end2(k), rolls, &
                                pressed, b%heading1(k), b%heading2(k), b%v1(k), b%v2(k), b%v3(k))
         b%pressed(k) = pressed
         b%rolls(k) = rolls
         b%next(k) = b%next(k)*keeps_sequence(b%off(k), b%rolled(k), rolls)
         b%lift(k) = lift
         b%above(k) = takeoff_height(lift, b%radius(k), rolls)
         b%speed2(k) = b%v1(k)*b%v1(k) + b%v2(k)*b%v2(k) + b%v3(k)*b%v3(k)
         b%rate(k) = b%v3(k) - (b%end1(k)*b%v1(k) + b%end2(k)*b%v2(k))
      end do
   end subroutine set_departures
end module rockfall_table_lanes
