! SPDX-License-Identifier: BSD-3-Clause
!> Contacts drawn from a table of contacts simulated in a laboratory (theory, chapter 5), like the paper's random
!> operator but without its linearity. A contact draws a record from the bin of its velocity; the least-squares map of
!> the bin adapts the record to the velocity.
!>
!> Velocities are scaled by U = sqrt(g R_b), times by sqrt(R_b/g), lengths by R_b. On ground that yields, contacts are
!> similar if the scaled quantities, the ground strength over rho_b g R_b, and the relief agree. Size, density and
!> strength therefore form one axis of the table.
module rockfall_impact_table
   use rockfall_memory, only: prefetch
   use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan
   use rockfall_kinds, only: wp, sp, i8
   use rockfall_math, only: logarithm, exponential, power, tangent
   use rockfall_boulder, only: soil_draw_t
   implicit none
   private
   public :: impact_table_t, yielding_ground_t, bins_t, approach_t, outcome_t, index_records, has_ratios
   public :: largest_block, beyond_ratios, find_part, begin_draw, followed_record, is_copied, bin_keys, key_bin
   public :: bins_before, whole_bin, find_window, is_held, nearest_record, prefetch_record, transfer_record
   public :: exceeds_table, scaled_energy
   public :: record_fields, t_in, n_in, w_in, speed_in, height_in, along_out, across_out, n_out, w_out, duration_out, &
             advance_out, rise_out, pull_along, pull_across, exit_code, follower, map_fields, along_map, n_map, w_map, &
             low, high, edge_vector, flies, rolls_on, stops
   ! Steps of transfer_record:
   public :: speed_scale, input_change, mapped_shift, own_duration, own_reach, mean_speed, own_velocity, held_longer, &
             takes_shift, allowed_energy

   !> Exit codes of a record, as written by the laboratory.
   integer, parameter :: flies = 0, rolls_on = 1, stops = 2

   !> Fields of a record: before the contact (V_t, V_n, W), speed, height; after it the velocity along the incoming
   !> heading and across it towards the descent, V_n, W; duration, advance, rise; gravity along and across, over g;
   !> exit; index of the record that followed in the laboratory (0: unknown, or too fast to be followed).
   integer, parameter :: t_in = 1, n_in = 2, w_in = 3, speed_in = 4, height_in = 5, along_out = 6, across_out = 7, &
                         n_out = 8, w_out = 9, duration_out = 10, advance_out = 11, rise_out = 12, pull_along = 13, &
                         pull_across = 14, exit_code = 15, follower = 16, record_fields = 16

   !> Inputs of the map of a bin: V_t, V_n, W, and for a rolling block its height.
   integer, parameter :: n_inputs = 4
   !> Offsets in `map`: rows of the map of a bin for velocity along, V_n and W (n_inputs numbers each), then minimum and
   !> maximum of each input; those of W are over V.
   integer, parameter :: along_map = 0, n_map = 4, w_map = 8, low = 12, high = 16, map_fields = 20
   real(wp), parameter, public :: usual_density = 2700         !! usual density of boulders [kg/m3]
   real(wp), parameter, public :: usual_weight = usual_density*9.81_wp  !! [N/m3]
   integer, parameter :: window = 6      !! 1/window of a bin's records are eligible for a slow contact: see find_window
   integer, parameter :: fewest = 16     !! minimum number of eligible records, so that identical landings differ
   integer, parameter :: candidates = 3  !! number of records drawn; the nearest in gravity across the heading is used
   !> Maximum number of parts of a bin; only one part is searched. With 16, gfortran unrolls the loop into scalar code.
   integer, parameter :: marks = 32
   integer, parameter :: edge_vector = 4 !! edges compared by one instruction
   integer, parameter :: vector = 8      !! records compared by one instruction; parts are multiples of it

   !> Tolerances within which a contact counts as the one that followed in the laboratory: V, V_n and W differ by at
   !> most the speed there or `relief_speed`, whichever is larger; gravity along and across the heading, over g, by at
   !> most `pull_tolerance`; the height of a rolling block, over R_b, by at most `height_tolerance` [-].
   real(wp), parameter :: pull_tolerance = 0.2_wp, height_tolerance = 0.6_wp
   !> Speed over sqrt(g R_b) below which the relief governs the motion, so that it is not proportional to velocity [-].
   real(wp), parameter :: relief_speed = 0.5_wp
   !> Initial speed over sqrt(g R_b) above which hollows do not stop a block, and contacts are drawn independently [-].
   real(wp), parameter, public :: max_held_speed = 2.0_wp

   !> Bins of one kind of contact. Each bin of a key has its own edges of the next key. Edges are padded with infinity
   !> to full vectors, because a remainder loop would be mispredicted.
   type :: bins_t
      integer :: n(3) = 0
      integer :: total = 0                              !! number of bins in each part
      integer :: vectors(3) = 0                         !! vectors of edges per key
      real(wp), allocatable :: first_edge(:, :)         !! (at least n(1) - 1, parts)
      real(wp), allocatable :: second_edge(:, :, :)     !! (at least n(2) - 1, n(1), parts)
      real(wp), allocatable :: third_edge(:, :, :, :)   !! (at least n(3) - 1, n(2), n(1), parts)
   end type bins_t

   !> Ground represented by a table.
   type :: yielding_ground_t
      real(wp) :: rest_angle = 90.0_wp      !! a boulder that stops on steeper ground rolls on [degrees]
      real(wp) :: strength = 0.0_wp         !! median pressure at which the ground yields; 0: never [Pa]
      real(wp) :: strength_sigma = 0.0_wp   !! standard deviation of ln(strength) between boulders [-]
      real(wp) :: strength_radius = 0.0_wp  !! R_b for this strength if strength is proportional to R_b, else 0 [m]
      real(wp) :: relief = 0.0_wp           !! slope of the relief [degrees]
      real(wp) :: relief_radius = 1.0_wp    !! R_b to which this slope applies [m]
      real(wp) :: hurst = 1.0_wp            !! exponent: the slope is proportional to R_b**(hurst - 1) [-]
   end type yielding_ground_t

   type :: impact_table_t
      ! A table has one or several parts, numbered column by column within each row:
      real(wp), allocatable :: size(:)     !! size of each column, increasing: R_b/R_m; on yielding ground rho_b g R_b
                                           !! over strength [-]
      real(wp), allocatable :: relief(:)   !! slope of the relief for each row, increasing [degrees]
      real(wp) :: inertia = 0.4_wp         !! moment of inertia of the laboratory's blocks, I/(m R_b**2) [-]
      type(yielding_ground_t) :: ground    !! ground that the table represents
      type(bins_t) :: flights, rolls       !! keys (V_n/V)**2, W/V, speed; keys speed, height, V_n
      integer, allocatable :: first(:)     !! first record of each bin, and the end; by part, flights before rolls
      real(wp), allocatable :: map(:, :)        !! (map_fields, bins)
      real(sp), allocatable :: record(:, :)     !! (record_fields, records), sorted by pull_along within a bin
      ! Set by `index_records`:
      real(sp), allocatable :: pull_across(:)   !! gravity across the heading of each record, over g [-]
      real(sp), allocatable :: pull_along(:)    !! gravity along the heading; bins are padded to full parts with
                                                !! infinity
      integer, allocatable :: place(:)          !! first element of each bin in `pull_along`, and the end
      real(wp), allocatable :: fastest(:)       !! for each bin: maximum speed key at its incidence and spin
      real(sp), allocatable :: mark(:, :)       !! pull_along where the next part of each bin begins (marks, bins)
      real(wp), allocatable :: step(:)          !! logarithm of the ratio of successive sizes [-], then 0
      real(wp) :: hold = 0.0_wp                 !! tangent of the rest angle; 0 if nothing can rest [-]
   end type impact_table_t

   !> Start of a contact.
   type :: approach_t
      real(wp) :: v(3)              !! V_t, V_n, W [-]
      real(wp) :: speed             !! sqrt(V_t**2 + V_n**2) [-]
      real(wp) :: height = 0.0_wp   !! height above the mean ground, of a rolling block [-]
      logical :: rolling = .false.  !! continuation of a truncated contact
      real(wp) :: key  !! factor from V**2 to the speed key: the boulder's size over the size of its column, so that
                       !! rho_b V_n**2/(2 p_y) equals that of the record [-]
      real(wp) :: stretch           !! ratio of the contact's duration to the record's, sqrt(key) [-]
      real(wp) :: inertia           !! I/(m R_b**2) [-]
      real(wp) :: pull(2)           !! gravity along the heading, and across it towards the descent, over g [-]
      integer :: next = 0           !! record that followed the previous contact's record; 0: none
   end type approach_t

   !> End of a contact.
   type :: outcome_t
      real(wp) :: along, across, normal, w  !! velocity along the initial heading, towards the descent, V_n, W [-]
      real(wp) :: duration, rise            !! duration; rise of the centre during it [-]
      real(wp) :: reach                     !! advance over mean_speed [-]
      real(wp) :: height                    !! height of the centre above the mean ground [-]
      real(wp) :: allowed                   !! maximum of twice the kinetic energy, over m g R_b, without the work of
                                            !! gravity along the slope
      integer :: exit = flies
      integer :: next = 0                   !! record that followed in the laboratory; 0: none
   end type outcome_t

contains

   !> Index the records of a table, so that a contact reads few of them.
   pure subroutine index_records(table)
      type(impact_table_t), intent(inout) :: table
      integer :: bins, bin, parts, k

      call drop_fast_followers(table%record)
      bins = size(table%first) - 1
      table%pull_across = table%record(pull_across, :)
      if (table%ground%rest_angle < 90) table%hold = tangent(table%ground%rest_angle)
      table%step = [logarithm(table%size(2:)/table%size(:size(table%size) - 1)), 0.0_wp]
      table%flights%total = product(table%flights%n)
      table%rolls%total = product(table%rolls%n)
      call find_fastest(table, bins)
      allocate (table%mark(marks, bins), source=huge(1.0_sp))
      allocate (table%place(bins + 1), source=1)
      do bin = 1, bins
         parts = (table%first(bin + 1) - table%first(bin) - 1)/part_size(table, bin) + 1
         table%place(bin + 1) = table%place(bin) + parts*part_size(table, bin)
      end do
      allocate (table%pull_along(table%place(bins + 1) - 1), source=huge(1.0_sp))
      do bin = 1, bins
         associate (along => table%record(pull_along, table%first(bin):table%first(bin + 1) - 1))
            table%pull_along(table%place(bin):table%place(bin) + size(along) - 1) = along
            do k = 1, (size(along) - 1)/part_size(table, bin)
               table%mark(k, bin) = along(k*part_size(table, bin) + 1)
            end do
         end associate
      end do
   end subroutine index_records

   !> Find the maximum speed key of the records with the incidence and spin of each bin. Bins of rolling blocks have no
   !> maximum.
   pure subroutine find_fastest(table, bins)
      type(impact_table_t), intent(inout) :: table
      integer, intent(in) :: bins
      integer :: part, bin, speeds

      allocate (table%fastest(bins), source=huge(1.0_wp))
      speeds = table%flights%n(3)
      do part = 1, size(table%size)*size(table%relief)
         do bin = bins_before(table, part, .false.) + 1, bins_before(table, part, .true.), speeds
            associate (speed => table%record(speed_in, table%first(bin):table%first(bin + speeds) - 1))
               table%fastest(bin:bin + speeds - 1) = real(maxval(speed), wp)**2
            end associate
         end do
      end do
   end subroutine find_fastest

   !> Remove links to following records that no boulder can follow, so that these records need not be read.
   pure subroutine drop_fast_followers(record)
      real(sp), intent(inout) :: record(:, :)
      integer :: k, next

      do k = 1, size(record, 2)
         next = int(record(follower, k))
         if (next == 0) cycle
         if (record(speed_in, next) > max_held_speed) record(follower, k) = 0
      end do
   end subroutine drop_fast_followers

   !> Number of records in each part of a bin; the last part may have fewer.
   pure integer function part_size(table, bin)
      type(impact_table_t), intent(in) :: table
      integer, intent(in) :: bin

      part_size = ((table%first(bin + 1) - table%first(bin) - 1)/(marks*vector) + 1)*vector
   end function part_size

   !> Return whether a table has parts for R_b/R_m, given the number of its columns and the strength of its ground [Pa].
   pure logical function has_ratios(columns, strength)
      integer, intent(in) :: columns
      real(wp), intent(in) :: strength

      has_ratios = columns > 1 .and. .not. strength > 0
   end function has_ratios

   !> Maximum R_b [m] covered by a table column, at the median ground strength and the usual boulder weight. NaN if R_b
   !> is unlimited: on hard ground, and if the strength is proportional to R_b.
   pure real(wp) function largest_block(largest_size, strength, strength_radius)
      real(wp), intent(in) :: largest_size               !! largest size of a column [-]
      real(wp), intent(in) :: strength, strength_radius  !! as in yielding_ground_t [Pa], [m]

      largest_block = ieee_value(0.0_wp, ieee_quiet_nan)
      if (strength > 0 .and. .not. strength_radius > 0) largest_block = largest_size*strength/usual_weight
   end function largest_block

   !> Return whether a ratio R_b/R_m is outside the range of a table, which then uses its smallest or largest size.
   pure logical function beyond_ratios(table, ratio)
      type(impact_table_t), intent(in) :: table
      real(wp), intent(in) :: ratio  !! R_b/R_m [-]

      beyond_ratios = .false.
      if (.not. has_ratios(size(table%size), table%ground%strength)) return
      beyond_ratios = ratio < table%size(1) .or. ratio > table%size(size(table%size))
   end function beyond_ratios

   !> Find the part of a table for a boulder: one of the two nearest columns for its size and one of the two nearest
   !> rows for its relief, with probabilities that interpolate linearly in the logarithm of the size and in the relief.
   !> A boulder that finds the ground strong does so along its whole path and on all grounds (theory, eq. 5.25).
   pure subroutine find_part(table, radius, density, gravity, ratio, soil, part, key)
      type(impact_table_t), intent(in) :: table
      real(wp), intent(in) :: radius, density, gravity  !! R_b [m]; density of the boulder [kg/m3]; [m/s2]
      real(wp), intent(in) :: ratio                     !! R_b/R_m [-]
      type(soil_draw_t), intent(in) :: soil
      integer, intent(out) :: part
      real(wp), intent(out) :: key                      !! as in approach_t [-]
      real(wp) :: own, strength
      integer :: column, row

      column = 1
      row = 1
      own = ratio
      associate (ground => table%ground)
         if (ground%strength > 0) then
            strength = ground%strength
            if (ground%strength_radius > 0) strength = strength*(radius/ground%strength_radius)
            if (ground%strength_sigma > 0) strength = strength*exponential(ground%strength_sigma*soil%deviate)
            own = density*gravity*radius/strength
         end if
         if (size(table%size) > 1) then
            column = place_below(table%size, own)
            if (own > table%size(column)) then
               if (soil%column*table%step(column) < logarithm(own/table%size(column))) column = column + 1
            end if
         end if
         if (size(table%relief) > 1) row = drawn_row(table%relief, relief_at(ground, radius), soil%row)
         key = 1
         if (ground%strength > 0) key = own/table%size(column)
      end associate
      part = (row - 1)*size(table%size) + column
   end subroutine find_part

   !> Index of the last value not above `x`, limited to 1..size - 1.
   pure integer function place_below(values, x) result(k)
      real(wp), intent(in) :: values(:)  !! increasing
      real(wp), intent(in) :: x

      k = 1
      do while (k < size(values) - 1)
         if (x < values(k + 1)) exit
         k = k + 1
      end do
   end function place_below

   pure integer function drawn_row(relief, own, u) result(row)
      real(wp), intent(in) :: relief(:), own  !! relief of each row; relief of this ground [degrees]
      real(wp), intent(in) :: u               !! uniform in (0, 1) [-]

      row = place_below(relief, own)
      if (u*(relief(row + 1) - relief(row)) < own - relief(row)) row = row + 1
   end function drawn_row

   !> Slope of the relief for a boulder [degrees].
   pure real(wp) function relief_at(ground, radius) result(relief)
      type(yielding_ground_t), intent(in) :: ground
      real(wp), intent(in) :: radius  !! R_b [m]

      relief = ground%relief
      if (ground%hurst < 1 .or. ground%hurst > 1) &
         relief = relief*power(radius/ground%relief_radius, ground%hurst - 1)
   end function relief_at

   !> Find the bin of a contact, and its record if the contact follows the recorded sequence.
   pure subroutine begin_draw(table, part, in, bin, record)
      type(impact_table_t), intent(in) :: table
      integer, intent(in) :: part       !! as returned by find_part
      type(approach_t), intent(in) :: in
      integer, intent(out) :: bin       !! bin of the contact; 0 if the record is copied (is_copied)
      integer, intent(out) :: record    !! record; 0 if it must be drawn from the bin by nearest_record

      record = followed_record(table, in)
      bin = contact_bin(table, part, in)
      if (record > 0) bin = merge(0, bin, is_copied(table, record))
   end subroutine begin_draw

   !> Record of a contact in the recorded sequence, or 0.
   pure integer function followed_record(table, in) result(record)
      type(impact_table_t), intent(in) :: table
      type(approach_t), intent(in) :: in

      record = merge(in%next, 0, continues_sequence(table, in))
   end function followed_record

   !> Return whether a following record is copied without scaling, because the relief governs its motion.
   pure logical function is_copied(table, record)
      type(impact_table_t), intent(in) :: table
      integer, intent(in) :: record

      is_copied = table%record(speed_in, record) < relief_speed
   end function is_copied

   !> Apply a record to a boulder: scale it to the boulder's velocity by the map of its bin, and adapt it to the slope.
   !> For a slow block in a hollow, a small difference in velocity or slope changes nothing: the record is copied.
   pure subroutine transfer_record(table, bin, record, in, out)
      type(impact_table_t), intent(in) :: table
      integer, intent(in) :: bin, record  !! as returned by begin_draw and nearest_record
      type(approach_t), intent(in) :: in
      type(outcome_t), intent(out) :: out
      real(wp) :: r(record_fields), ratio, scale, unit, change(n_inputs), shift, rolling, keeps, shifts
      integer :: k

      r = real(table%record(:, record), wp)
      ratio = in%speed/r(speed_in)
      rolling = merge(1.0_wp, 0.0_wp, in%rolling)
      out%exit = int(r(exit_code))
      out%next = int(r(follower))
      if (out%next > 0) call prefetch_record(table, out%next)
      out%rise = r(rise_out)
      keeps = merge(1.0_wp, rolling, bin == 0)
      out%duration = own_duration(r(duration_out), keeps, in%stretch)
      out%reach = own_reach(r(advance_out), keeps, in%stretch, r(speed_in), r(along_out), r(across_out), r(n_out))
      if (bin == 0) then
         out%height = r(height_in) + out%rise
         out%along = r(along_out)
         out%across = r(across_out)
         out%normal = r(n_out)
         out%w = r(w_out)
      else
         associate (map => table%map(:, bin))
            scale = speed_scale(ratio, rolling, in%v(1), map(high + 1))
            unit = merge(scale, in%speed, in%rolling)
            do k = 1, n_inputs - 1
               change(k) = input_change(in%v(k), merge(in%speed, unit, k == w_in), map(low + k), map(high + k), &
                                        scale*r(k))
            end do
            change(n_inputs) = 0
            if (in%rolling) change(n_inputs) = input_change(in%height, 1.0_wp, map(low + n_inputs), &
                                                            map(high + n_inputs), r(height_in))
            out%height = merge(in%height, r(height_in), in%rolling) + out%rise
            out%along = own_velocity(scale, r(along_out), in%pull(1), out%duration, r(pull_along), r(duration_out))
            out%along = held_longer(out%along, rolling, table%hold, in%pull(1), in%pull(2), in%stretch, &
                                    r(duration_out))
            out%across = own_velocity(scale, r(across_out), in%pull(2), out%duration, r(pull_across), r(duration_out))
            out%normal = scale*r(n_out)
            out%w = scale*r(w_out)
            shift = mapped_shift(change(1), change(2), change(3), change(4), map(n_map + 1), map(n_map + 2), &
                                 map(n_map + 3), map(n_map + 4))
            shifts = takes_shift(r(exit_code), out%normal, shift)
            if (shifts > 0) then
               out%normal = out%normal + shift
               out%along = out%along + mapped_shift(change(1), change(2), change(3), change(4), map(along_map + 1), &
                                                    map(along_map + 2), map(along_map + 3), map(along_map + 4))
               out%w = out%w + mapped_shift(change(1), change(2), change(3), change(4), map(w_map + 1), &
                                            map(w_map + 2), map(w_map + 3), map(w_map + 4))
            end if
         end associate
      end if
      out%allowed = allowed_energy(in%v(1), in%v(2), in%v(3), in%inertia, in%pull(1), ratio, &
                                   r(t_in), r(n_in), r(w_in), r(along_out), r(across_out), r(n_out), r(w_out), &
                                   r(pull_along), r(advance_out))
   end subroutine transfer_record

   !> Load a record into the cache before its use: records are scattered in memory, and each takes two cache lines.
   pure subroutine prefetch_record(table, record)
      type(impact_table_t), intent(in) :: table
      integer, intent(in) :: record

      call prefetch(table%record(1, record))
      call prefetch(table%record(record_fields, record))
   end subroutine prefetch_record

   !> Factor on the record's velocities: the ratio of the speeds, or 1 for a rolling block. The fastest bin has no upper
   !> limit: beyond its fastest record, a contact is a scaled copy of that record.
   elemental real(wp) function speed_scale(ratio, rolling, v1, fastest)
      real(wp), intent(in) :: ratio    !! ratio of the boulder's speed to the record's [-]
      real(wp), intent(in) :: rolling  !! 1 if rolling, as in approach_t; else 0
      real(wp), intent(in) :: v1       !! V_t [-]
      real(wp), intent(in) :: fastest  !! V_t of the bin's fastest record [-]
      real(wp) :: beyond

      beyond = merge(rolling, 0.0_wp, v1 > fastest)
      beyond = merge(beyond, 0.0_wp, fastest > 0)
      speed_scale = merge(1.0_wp, ratio, rolling > 0)
      speed_scale = merge(v1/merge(fastest, 1.0_wp, beyond > 0), speed_scale, beyond > 0)
   end function speed_scale

   !> Map input of a contact, limited to the range of the bin's records, minus the value of its record.
   elemental real(wp) function input_change(input, unit, lowest, highest, of_record)
      real(wp), intent(in) :: input            !! [-]
      real(wp), intent(in) :: unit             !! scale of the range, for V_t and V_n or for W [-]
      real(wp), intent(in) :: lowest, highest  !! range of the bin's records [-]
      real(wp), intent(in) :: of_record        !! value of the record, scaled to the boulder [-]

      input_change = max(unit*lowest, min(unit*highest, input)) - of_record
   end function input_change

   !> Apply a row of the map of a bin.
   elemental real(wp) function mapped_shift(change1, change2, change3, change4, m1, m2, m3, m4)
      real(wp), intent(in) :: change1, change2, change3, change4, m1, m2, m3, m4  !! inputs; the row [-]

      mapped_shift = change1*m1 + change2*m2 + change3*m3 + change4*m4
   end function mapped_shift

   !> Duration of a contact. If the key is the absolute speed, the duration scales with R_b instead of sqrt(R_b).
   elemental real(wp) function own_duration(of_record, keeps, stretch)
      real(wp), intent(in) :: of_record  !! duration of the record [-]
      real(wp), intent(in) :: keeps      !! 1: the boulder rolls or follows the recorded sequence; else 0
      real(wp), intent(in) :: stretch    !! as in approach_t [-]

      own_duration = merge(of_record, of_record*stretch, keeps > 0)
   end function own_duration

   !> Advance of a contact over its mean_speed: the record's value, scaled to the boulder's duration.
   elemental real(wp) function own_reach(of_record, keeps, stretch, speed, along, across, normal)
      real(wp), intent(in) :: of_record       !! advance of the record [-]
      real(wp), intent(in) :: keeps, stretch  !! as in own_duration [-]
      real(wp), intent(in) :: speed, along, across, normal  !! of the record, before and after the contact [-]

      own_reach = own_duration(of_record, keeps, stretch)/mean_speed(speed, along, across, normal)
   end function own_reach

   !> Speed that corresponds to the mean translational energy before and after a contact.
   elemental real(wp) function mean_speed(speed, along, across, normal)
      real(wp), intent(in) :: speed                  !! speed before the contact [-]
      real(wp), intent(in) :: along, across, normal  !! velocities after the contact [-]

      mean_speed = sqrt(0.5_wp*(speed*speed + (along*along + across*across + normal*normal)))
   end function mean_speed

   !> Velocity along or across the heading. Velocities scale with the speed, but the contribution of gravity scales with
   !> the duration: it is replaced separately.
   elemental real(wp) function own_velocity(scale, of_record, pull, duration, record_pull, record_duration)
      real(wp), intent(in) :: scale, of_record               !! ratio from speed_scale; velocity of the record [-]
      real(wp), intent(in) :: pull, duration  !! pull of gravity along or across, over g; duration of the contact [-]
      real(wp), intent(in) :: record_pull, record_duration   !! pull and duration of the record [-]

      own_velocity = scale*of_record + pull*duration - scale*record_pull*record_duration
   end function own_velocity

   !> Velocity along the heading, with friction for the boulder's own duration of the contact instead of the
   !> laboratory's. The friction equals gravity along a slope at the rest angle. The velocity is not reversed.
   elemental real(wp) function held_longer(along, rolling, hold, pull1, pull2, stretch, duration)
      real(wp), intent(in) :: along  !! velocity of the boulder if friction acted for the duration of the record [-]
      real(wp), intent(in) :: rolling       !! 1: the boulder rolls, with the block's duration; else 0
      real(wp), intent(in) :: hold          !! as in impact_table_t [-]
      real(wp), intent(in) :: pull1, pull2  !! gravity along and across the heading, over g [-]
      real(wp), intent(in) :: stretch       !! as in approach_t [-]
      real(wp), intent(in) :: duration      !! duration of the record [-]
      real(wp) :: pressing                  !! gravity normal to the plane, over g [-]

      pressing = sqrt(max(0.0_wp, 1 - pull1*pull1 - pull2*pull2))
      held_longer = sign(max(0.0_wp, abs(along) - hold*pressing*duration*(stretch - 1/stretch)), along)
      held_longer = merge(along, held_longer, rolling > 0)
   end function held_longer

   !> Return 1 if the map of the bin shifts a record, else 0: a flight must not be shifted into the ground.
   elemental real(wp) function takes_shift(exit, normal, shift)
      real(wp), intent(in) :: exit           !! as in outcome_t
      real(wp), intent(in) :: normal, shift  !! V_n before the shift, and the shift of V_n [-]

      takes_shift = merge(1.0_wp, 0.0_wp, normal + shift > 0)
      takes_shift = merge(1.0_wp, takes_shift, exit > flies)
   end function takes_shift

   !> Maximum of twice the kinetic energy after a contact, over m g R_b, without the work of gravity along the slope:
   !> the energy before the contact, plus the energy that the record gains beyond that work, from relief and from spin
   !> about other axes. This gain is allowed in full on ground as steep as the record's, and not at all on flat ground.
   elemental real(wp) function allowed_energy(v1, v2, v3, inertia, pull, ratio, in1, in2, in3, along, across, normal, &
                                              w, record_pull, advance)
      real(wp), intent(in) :: v1, v2, v3, inertia, pull, ratio  !! V_t, V_n, W; as in approach_t, speed_scale [-]
      real(wp), intent(in) :: in1, in2, in3                     !! V_t, V_n, W of the record before the contact [-]
      real(wp), intent(in) :: along, across, normal, w          !! velocities of the record after the contact [-]
      real(wp), intent(in) :: record_pull, advance              !! pull and advance of the record [-]
      real(wp) :: gain, gain_fraction

      gain = max(0.0_wp, scaled_energy(along, across, normal, w, inertia) &
                 - scaled_energy(in1, 0.0_wp, in2, in3, inertia) &
                 - 2*max(0.0_wp, record_pull)*max(0.0_wp, advance))
      gain_fraction = min(1.0_wp, pull/max(record_pull, tiny(pull)))
      gain_fraction = merge(gain_fraction, 0.0_wp, pull > 0)
      allowed_energy = scaled_energy(v1, 0.0_wp, v2, v3, inertia) + min(1.0_wp, ratio*ratio)*gain*gain_fraction
   end function allowed_energy

   pure integer function contact_bin(table, part, in) result(bin)
      type(impact_table_t), intent(in) :: table
      integer, intent(in) :: part
      type(approach_t), intent(in) :: in
      real(wp) :: key(3), over(2)

      call bin_keys(in%v(2), in%v(3), in%speed, in%height, in%key, merge(1.0_wp, 0.0_wp, in%rolling), key(1), over(1), &
                    key(2), over(2), key(3))
      if (in%rolling) then
         bin = bins_before(table, part, .true.) + key_bin(table%rolls, part, key, over)
      else
         bin = bins_before(table, part, .false.) + key_bin(table%flights, part, key, over)
      end if
   end function contact_bin

   !> Number of bins before the bins of one kind of contact in a part.
   pure integer function bins_before(table, part, rolling)
      type(impact_table_t), intent(in) :: table
      integer, intent(in) :: part
      logical, intent(in) :: rolling

      bins_before = (part - 1)*(table%flights%total + table%rolls%total) + merge(table%flights%total, 0, rolling)
   end function bins_before

   !> Keys of a contact's bin. Each is a numerator and a denominator, to avoid divisions.
   elemental subroutine bin_keys(v2, v3, speed, height, key, rolling, key1, over1, key2, over2, key3)
      real(wp), intent(in) :: v2, v3              !! V_n, W [-]
      real(wp), intent(in) :: speed, height, key  !! as in approach_t [-]
      real(wp), intent(in) :: rolling             !! 1 if rolling, as in approach_t; else 0
      real(wp), intent(out) :: key1, key2, key3   !! numerators [-]
      real(wp), intent(out) :: over1, over2       !! denominators [-]
      real(wp) :: speed2

      speed2 = speed*speed
      key1 = merge(speed2, v2*v2, rolling > 0)
      over1 = merge(1.0_wp, speed2, rolling > 0)
      key2 = merge(height, v3, rolling > 0)
      over2 = merge(1.0_wp, speed, rolling > 0)
      key3 = merge(v2, key*speed2, rolling > 0)
   end subroutine bin_keys

   !> Bin of a contact, counted from the first of its kind and part.
   pure integer function key_bin(bins, part, key, over) result(bin)
      type(bins_t), intent(in) :: bins
      integer, intent(in) :: part
      real(wp), intent(in) :: key(3), over(2)  !! numerators; denominators of the first two
      integer :: i, j, k

      i = min(bins%n(1), edge_bin(bins%vectors(1), bins%first_edge(:, part), over(1), key(1)))
      j = min(bins%n(2), edge_bin(bins%vectors(2), bins%second_edge(:, i, part), over(2), key(2)))
      k = min(bins%n(3), edge_bin(bins%vectors(3), bins%third_edge(:, j, i, part), 1.0_wp, key(3)))
      bin = ((i - 1)*bins%n(2) + j - 1)*bins%n(3) + k
   end function key_bin

   !> Return 1 + the number of edges that, multiplied by a unit, are below a value. All edges are compared, because an
   !> early exit would be mispredicted.
   pure integer function edge_bin(vectors, edge, unit, value)
      integer, intent(in) :: vectors
      real(wp), intent(in) :: edge(edge_vector, vectors)
      real(wp), intent(in) :: unit, value
      integer(i8) :: below(edge_vector)  ! as wide as an edge
      integer :: k

      below = 0
      do k = 1, vectors
         below = below + merge(1_i8, 0_i8, edge(:, k)*unit < value)
      end do
      edge_bin = 1 + int(sum(below))
   end function edge_bin

   !> Return whether a hollow may stop a boulder. If so, its record is drawn only from records with similar gravity
   !> along the heading, else from the whole bin. Faster boulders respond in proportion to gravity, and with few
   !> candidates a rare record would be drawn too often on slopes near its own.
   pure logical function is_held(speed)
      real(wp), intent(in) :: speed  !! as in approach_t [-]

      is_held = .not. speed > max_held_speed
   end function is_held

   !> Select all records of a bin as candidates.
   pure subroutine whole_bin(table, bin, from, n)
      type(impact_table_t), intent(in) :: table
      integer, intent(in) :: bin
      integer, intent(out) :: from, n   !! first record; number of records

      from = table%first(bin)
      n = table%first(bin + 1) - from
   end subroutine whole_bin

   !> Select the records of a bin that are nearest in gravity along the heading.
   pure subroutine find_window(table, bin, pull, from, n)
      type(impact_table_t), intent(in) :: table
      integer, intent(in) :: bin
      real(wp), intent(in) :: pull      !! gravity along the heading, over g [-]
      integer, intent(out) :: from, n   !! first record; number of records
      integer :: first, last, start, below, k
      real(sp) :: along

      first = table%first(bin)
      last = table%first(bin + 1) - 1
      n = max((last - first + window)/window, min(last - first + 1, fewest))
      along = real(pull, sp)
      below = 0
      do k = 1, marks  ! a vectorised comparison of all marks is faster than bisection
         below = below + merge(1, 0, table%mark(k, bin) < along)
      end do
      start = below*part_size(table, bin)
      below = 0
      do k = table%place(bin) + start, table%place(bin) + start + part_size(table, bin) - 1
         below = below + merge(1, 0, table%pull_along(k) < along)
      end do
      from = max(first, min(first + start + below - n/2, last + 1 - n))
   end subroutine find_window

   !> Choose a record: of three evenly spaced candidates, the nearest in gravity across the heading. The response of
   !> slow blocks to gravity is not proportional.
   pure integer function nearest_record(table, from, n, pull, u)
      type(impact_table_t), intent(in) :: table
      integer, intent(in) :: from, n   !! as returned by whole_bin or find_window
      real(wp), intent(in) :: pull, u  !! gravity across the heading, over g; uniform in (0, 1) [-]
      integer :: candidate, nearer, k
      real(wp) :: separation, min_separation

      nearest_record = from
      min_separation = huge(min_separation)
      do k = 0, candidates - 1
         candidate = int(u*n) + (k*n)/candidates
         candidate = from + candidate - merge(n, 0, candidate >= n)
         separation = abs(table%pull_across(candidate) - pull)
         nearer = merge(1, 0, separation < min_separation)
         nearest_record = nearest_record + nearer*(candidate - nearest_record)  ! a branch would be mispredicted
         min_separation = min(min_separation, separation)
      end do
      call prefetch_record(table, nearest_record)
   end function nearest_record

   !> Return whether a boulder follows the block of its last record, because this contact begins like the block's next
   !> contact. A boulder thus stays in a hollow of the relief as long as the block did in the laboratory.
   pure logical function continues_sequence(table, in)
      type(impact_table_t), intent(in) :: table
      type(approach_t), intent(in) :: in
      real(wp) :: tolerance, excess

      continues_sequence = .false.
      if (in%next == 0) return
      associate (record => table%record(:, in%next))  ! a single comparison: several would be mispredicted
         tolerance = max(relief_speed, real(record(speed_in), wp))
         excess = max(abs(in%pull(1) - record(pull_along)) - pull_tolerance, &
                      abs(in%pull(2) - record(pull_across)) - pull_tolerance, &
                      abs(in%speed - record(speed_in)) - tolerance, &
                      abs(in%v(2) - record(n_in)) - tolerance, &
                      abs(in%v(3) - record(w_in)) - tolerance)
         if (in%rolling) excess = max(excess, abs(in%height - record(height_in)) - height_tolerance)
      end associate
      continues_sequence = .not. excess > 0
   end function continues_sequence

   !> Twice the kinetic energy, over m g R_b.
   elemental real(wp) function scaled_energy(along, across, normal, w, inertia)
      real(wp), intent(in) :: along, across, normal, w, inertia  !! as in outcome_t, approach_t [-]

      scaled_energy = along*along + across*across + normal*normal + inertia*w*w
   end function scaled_energy

   !> Return 1 if a contact is faster than all records at its incidence and spin, else 0. Also 0 if it copies a record.
   elemental real(wp) function exceeds_table(fastest, key3, copies)
      real(wp), intent(in) :: fastest  !! as in impact_table_t
      real(wp), intent(in) :: key3     !! as returned by bin_keys
      real(wp), intent(in) :: copies   !! 1 if the contact copies a record, else 0

      exceeds_table = merge(1.0_wp, 0.0_wp, key3 > fastest)
      exceeds_table = merge(0.0_wp, exceeds_table, copies > 0)
   end function exceeds_table
end module rockfall_impact_table
