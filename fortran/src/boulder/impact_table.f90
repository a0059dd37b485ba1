! SPDX-License-Identifier: BSD-3-Clause
!> Contacts drawn from a table of contacts simulated in a laboratory (theory, chapter 5): the paper's random operator
!> without its linearity. A contact finds the bin of its velocity, draws one of the bin's records, and scales it to
!> its own velocity by the least-squares map of the bin.
!>
!> Velocities are scaled by U = sqrt(g R_b), times by sqrt(R_b/g), lengths by R_b: contacts that agree in the scaled
!> quantities, and in the ratio of the speed to the yield speed of the ground, are similar.
module rockfall_impact_table
   use, intrinsic :: iso_c_binding, only: c_float
   use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan
   use rockfall_kinds, only: wp, sp, i8
   use rockfall_math, only: logarithm, tangent
   use rockfall_boulder, only: boulder_t
   implicit none
   private
   public :: impact_table_t, bins_t, approach_t, outcome_t, index_records, has_ratios, largest_block, beyond_ratios, &
             find_part, drawn_part, begin_draw, whole_bin, find_window, is_held, nearest_record, transfer_record, &
             exceeds_table, scaled_energy
   public :: record_fields, pull_along, pull_across, follower, n_inputs, n_mapped, map_rows, edge_vector, flies, &
             rolls_on, stops

   !> Exit codes of a record, as written by the laboratory.
   integer, parameter :: flies = 0, rolls_on = 1, stops = 2

   !> Fields of a record: before the contact (V_t, V_n, W), speed, height; after it the velocity along the incoming
   !> heading and across it towards the descent, V_n, W; duration, advance, rise; gravity along and across, over g;
   !> exit; index of the record that followed in the laboratory, 0: unknown, or too fast to be followed.
   integer, parameter :: t_in = 1, n_in = 2, w_in = 3, speed_in = 4, height_in = 5, along_out = 6, across_out = 7, &
                         n_out = 8, w_out = 9, duration_out = 10, advance_out = 11, rise_out = 12, pull_along = 13, &
                         pull_across = 14, exit_code = 15, follower = 16, record_fields = 16

   integer, parameter :: n_inputs = 4  !! of the map of a bin: V_t, V_n, W, and the height for a rolling block
   integer, parameter :: n_mapped = 3  !! along, V_n, W
   integer, parameter :: map_rows = 4  !! the same, filled up to whole vectors
   integer, parameter :: window = 6      !! 1/window of a bin is eligible for a slow contact: see find_window
   integer, parameter :: candidates = 3  !! of these, the nearest in gravity across it is taken
   !> A bin has at most so many parts, of which only one is searched. With 16, gfortran unrolls the loop, all scalar.
   integer, parameter :: marks = 32
   integer, parameter :: edge_vector = 4 !! edges compared by one instruction
   integer, parameter :: vector = 8      !! records compared by one instruction; parts are multiples of it

   !> Tolerances within which a contact equals the one that followed in the laboratory: V, V_n and W differ by no more
   !> than the speed there, or than `relief_speed`; gravity along and across the heading by no more than
   !> `pull_tolerance`, over g; the height of a rolling block by no more than `height_tolerance`, over R_b [-].
   real(wp), parameter :: pull_tolerance = 0.2_wp, height_tolerance = 0.6_wp
   !> Speed over sqrt(g R_b) below which the relief governs the motion, which is then not proportional to velocity [-].
   real(wp), parameter :: relief_speed = 0.5_wp
   !> Initial speed over sqrt(g R_b) above which no hollow holds a block, and each contact is drawn independently [-].
   real(wp), parameter :: max_held_speed = 2.0_wp

   !> Bins of one kind of contact. Edges of each key are given per bin of the previous key. Infinite edges fill whole
   !> vectors: a loop over what is left would be mispredicted.
   type :: bins_t
      integer :: n(3) = 0
      integer :: total = 0                              !! in each part
      integer :: vectors(3) = 0                         !! of edges
      real(wp), allocatable :: first_edge(:, :)         !! (n(1) - 1 and more, parts)
      real(wp), allocatable :: second_edge(:, :, :)     !! (n(2) - 1 and more, n(1), parts)
      real(wp), allocatable :: third_edge(:, :, :, :)   !! (n(3) - 1 and more, n(2), n(1), parts)
   end type bins_t

   type :: impact_table_t
      ! Of each part, made from boulders of one size; a table may have a single one:
      real(wp), allocatable :: size(:)     !! increasing: R_b [m] if the absolute speed is a key, else R_b/R_m [-]
      real(wp), allocatable :: speed(:)    !! sqrt(g R_b) in the laboratory if the absolute speed is a key, else 0 [m/s]
      real(wp), allocatable :: fastest(:)  !! V**2 of the fastest record, scaled like the speed key
      real(wp) :: density = 1.0_wp         !! of the laboratory's blocks [kg/m3]
      real(wp) :: inertia = 0.4_wp         !! of the laboratory's blocks, I/(m R_b**2) [-]
      real(wp) :: rest_angle = 90.0_wp     !! of its ground: on steeper ground a boulder that stops rolls on [degrees]
      type(bins_t) :: flights, rolls       !! by (V_n/V)**2, W/V, speed; by speed, height, V_n
      integer, allocatable :: first(:)     !! first record of each bin, and end; flights before rolls, by part
      real(wp), allocatable :: map(:, :, :)     !! (map_rows, n_inputs, bins), the last row 0
      real(wp), allocatable :: low(:, :), high(:, :)  !! range of a bin's inputs, W over V (n_inputs, bins)
      real(sp), allocatable :: record(:, :)     !! (record_fields, records), sorted by pull_along within a bin
      ! From `index_records`:
      real(sp), allocatable :: pull_across(:)   !! gravity across the heading, over g, of each record
      real(sp), allocatable :: pull_along(:)    !! likewise along it, each bin filled to whole parts with infinite ones
      integer, allocatable :: place(:)          !! where those of each bin begin, and end
      real(sp), allocatable :: mark(:, :)       !! pull_along where the next part of each bin begins (marks, bins)
      real(wp), allocatable :: step(:)          !! logarithm of the size of the next part over that of each [-], and 0
      real(wp) :: hold = 0.0_wp                 !! tangent of the rest angle; 0 where nothing rests [-]
   end type impact_table_t

   !> Start of a contact.
   type :: approach_t
      real(wp) :: v(3)              !! V_t, V_n, W [-]
      real(wp) :: speed             !! sqrt(V_t**2 + V_n**2) [-]
      real(wp) :: height = 0.0_wp   !! above the mean ground, of a block that rolls [-]
      logical :: rolling = .false.  !! continues a contact that was cut
      real(wp) :: key               !! factor from V**2 to the speed key, from `begin_draw` [-]
      real(wp) :: stretch           !! ratio of its duration to that of the record, likewise [-]
      real(wp) :: inertia           !! I/(m R_b**2) [-]
      real(wp) :: pull(2)           !! gravity along the heading, and across it towards the descent, over g [-]
      integer :: next = 0           !! record that followed that of the previous contact; 0: none
   end type approach_t

   !> End of a contact.
   type :: outcome_t
      real(wp) :: along, across, normal, w  !! velocity along the heading before, towards the descent, V_n, W [-]
      real(wp) :: duration, advance, rise   !! [-]
      real(wp) :: height                    !! of the centre above the mean ground [-]
      real(wp) :: allowed                   !! maximum of twice the kinetic energy, over m g R_b
      integer :: exit = flies
      integer :: next = 0                   !! record that followed in the laboratory; 0: none
   end type outcome_t

   interface
      !> Load the cache line of a number into the cache, without waiting for it.
      pure subroutine prefetch(number) bind(c, name="rockfall_prefetch")
         import :: c_float
         real(c_float), intent(in) :: number
      end subroutine prefetch
   end interface

contains

   !> Index the records of a table, so that a contact reads few of them.
   pure subroutine index_records(table)
      type(impact_table_t), intent(inout) :: table
      integer :: bins, bin, parts, k

      call drop_fast_followers(table%record)
      bins = size(table%first) - 1
      table%pull_across = table%record(pull_across, :)
      if (table%rest_angle < 90) table%hold = tangent(table%rest_angle)
      table%step = [logarithm(table%size(2:)/table%size(:size(table%size) - 1)), 0.0_wp]
      table%flights%total = product(table%flights%n)
      table%rolls%total = product(table%rolls%n)
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

   !> Drop the followers that no boulder can follow, so that they need not be read.
   pure subroutine drop_fast_followers(record)
      real(sp), intent(inout) :: record(:, :)
      integer :: k, next

      do k = 1, size(record, 2)
         next = int(record(follower, k))
         if (next == 0) cycle
         if (record(speed_in, next) > max_held_speed) record(follower, k) = 0
      end do
   end subroutine drop_fast_followers

   !> Number of records in each part of a bin; the last one may have fewer.
   pure integer function part_size(table, bin)
      type(impact_table_t), intent(in) :: table
      integer, intent(in) :: bin

      part_size = ((table%first(bin + 1) - table%first(bin) - 1)/(marks*vector) + 1)*vector
   end function part_size

   !> Return whether a table has parts for R_b/R_m, from the number of its parts and the speed of one.
   pure logical function has_ratios(parts, speed)
      integer, intent(in) :: parts
      real(wp), intent(in) :: speed  !! as in impact_table_t, or its square

      has_ratios = parts > 1 .and. .not. speed > 0
   end function has_ratios

   !> R_b of the largest blocks of a table [m], from its sizes and speeds; NaN if size does not matter, or is R_b/R_m.
   pure real(wp) function largest_block(sizes, speeds)
      real(wp), intent(in) :: sizes(:)
      real(wp), intent(in) :: speeds(:)  !! as in impact_table_t, or their squares

      largest_block = ieee_value(0.0_wp, ieee_quiet_nan)
      if (any(speeds > 0)) largest_block = maxval(sizes)
   end function largest_block

   !> Return whether a ratio R_b/R_m is outside those of a table, so that its smallest or largest serves in its place.
   pure logical function beyond_ratios(table, ratio)
      type(impact_table_t), intent(in) :: table
      real(wp), intent(in) :: ratio  !! R_b/R_m [-]

      beyond_ratios = .false.
      if (.not. has_ratios(size(table%size), table%speed(1))) return
      beyond_ratios = ratio < table%size(1) .or. ratio > table%size(size(table%size))
   end function beyond_ratios

   !> Find the part of a table below the size of a boulder, and how far above it the boulder is.
   pure subroutine find_part(table, radius, ratio, part, excess)
      type(impact_table_t), intent(in) :: table
      real(wp), intent(in) :: radius   !! R_b [m]
      real(wp), intent(in) :: ratio    !! R_b/R_m [-]
      integer, intent(out) :: part
      real(wp), intent(out) :: excess  !! logarithm of its size over that of the part; 0 below it [-]
      real(wp) :: own

      part = 1
      excess = 0
      if (size(table%size) == 1) return
      own = merge(ratio, radius, has_ratios(size(table%size), table%speed(1)))
      do while (part < size(table%size) - 1)
         if (own < table%size(part + 1)) exit
         part = part + 1
      end do
      associate (low => table%size(part), high => table%size(part + 1))
         if (own >= high) then
            part = part + 1
         else if (own > low) then
            excess = logarithm(own/low)
         end if
      end associate
   end subroutine find_part

   !> Part of a table for a contact: the next smaller or larger one, with the probability given by interpolation linear
   !> in the logarithm of the size.
   pure integer function drawn_part(table, part, excess, u)
      type(impact_table_t), intent(in) :: table
      integer, intent(in) :: part     !! from find_part
      real(wp), intent(in) :: excess  !! likewise
      real(wp), intent(in) :: u       !! uniform in (0, 1) [-]

      drawn_part = part + merge(1, 0, u*table%step(part) < excess)
   end function drawn_part

   !> Part to which a record belongs.
   pure integer function part_of(table, record) result(part)
      type(impact_table_t), intent(in) :: table
      integer, intent(in) :: record
      integer :: bins

      bins = (size(table%first) - 1)/size(table%size)
      do part = 1, size(table%size) - 1
         if (record < table%first(part*bins + 1)) exit
      end do
   end function part_of

   !> Find the bin of a contact, and its record if that is the one that followed in the laboratory; compare the scales
   !> of boulder and block.
   pure subroutine begin_draw(table, boulder, unit, in, part, bin, record)
      type(impact_table_t), intent(in) :: table
      type(boulder_t), intent(in) :: boulder
      real(wp), intent(in) :: unit      !! sqrt(g R_b) [m/s]
      type(approach_t), intent(inout) :: in  !! its `key` and `stretch` are set
      integer, intent(inout) :: part    !! from drawn_part, unless a record decides
      integer, intent(out) :: bin       !! bin of the contact; 0: the boulder is like the block of the record
      integer, intent(out) :: record    !! or 0, to be drawn from the bin by nearest_record

      record = merge(in%next, 0, continues_sequence(table, in))
      if (record > 0) part = part_of(table, record)
      call compare_scales(table, part, unit, boulder%mass/boulder%volume, in%key, in%stretch)
      bin = contact_bin(table, part, in)
      if (record > 0) bin = merge(0, bin, table%record(speed_in, record) < relief_speed)
   end subroutine begin_draw

   !> Apply a record to this boulder.
   pure subroutine transfer_record(table, bin, record, in, out)
      type(impact_table_t), intent(in) :: table
      integer, intent(in) :: bin, record  !! from begin_draw and nearest_record
      type(approach_t), intent(in) :: in
      type(outcome_t), intent(out) :: out
      real(wp) :: r(record_fields), ratio

      r = real(table%record(:, record), wp)
      ratio = in%speed/r(speed_in)
      out%exit = int(r(exit_code))
      out%next = int(r(follower))
      if (out%next > 0) call prefetch_record(table, out%next)
      out%advance = r(advance_out)
      out%rise = r(rise_out)
      if (bin == 0) then
         call copy_outcome(r, out)
      else
         call map_outcome(table, bin, in, ratio, r, out)
      end if
      out%allowed = scaled_energy(in%v(1), 0.0_wp, in%v(2), in%v(3), in%inertia) &
                    + 2*max(0.0_wp, in%pull(1))*max(0.0_wp, out%advance) &
                    + min(1.0_wp, ratio*ratio)*hidden_gain(r, in%inertia) &
                      *hidden_gain_fraction(in%pull(1), r(pull_along))
   end subroutine transfer_record

   !> Load a record into the cache ahead of its use: records lie anywhere in memory, and two cache lines hold each.
   pure subroutine prefetch_record(table, record)
      type(impact_table_t), intent(in) :: table
      integer, intent(in) :: record

      call prefetch(table%record(1, record))
      call prefetch(table%record(record_fields, record))
   end subroutine prefetch_record

   !> Copy the outcome of the record: a slow block is held by its hollow, so a small difference in velocity or slope
   !> changes nothing.
   pure subroutine copy_outcome(record, out)
      real(wp), intent(in) :: record(record_fields)
      type(outcome_t), intent(inout) :: out

      out%duration = record(duration_out)
      out%height = record(height_in) + out%rise
      out%along = record(along_out)
      out%across = record(across_out)
      out%normal = record(n_out)
      out%w = record(w_out)
   end subroutine copy_outcome

   !> Transfer the record to the boulder's velocity, by the map of its bin, and to its slope.
   pure subroutine map_outcome(table, bin, in, ratio, record, out)
      type(impact_table_t), intent(in) :: table
      integer, intent(in) :: bin
      type(approach_t), intent(in) :: in
      real(wp), intent(in) :: ratio   !! ratio of its speed to that of the record [-]
      real(wp), intent(in) :: record(record_fields)
      type(outcome_t), intent(inout) :: out
      real(wp) :: scaled, change(n_inputs), shift(map_rows)
      integer :: k

      associate (low => table%low(:, bin), high => table%high(:, bin))
         scaled = ratio
         if (in%rolling) then  ! the fastest bin is open: beyond it a contact is a scaled copy of the fastest
            scaled = 1
            if (in%v(1) > high(1) .and. high(1) > 0) scaled = in%v(1)/high(1)
         end if
         change = clamped_inputs([in%v, in%height], merge(scaled, in%speed, in%rolling), in%speed, low, high) &
                  - [scaled*record(t_in:w_in), record(height_in)]
      end associate
      if (.not. in%rolling) change(4) = 0
      do k = 1, map_rows  ! matmul of array sections would be a library call
         shift(k) = change(1)*table%map(k, 1, bin) + change(2)*table%map(k, 2, bin) + change(3)*table%map(k, 3, bin) &
                    + change(4)*table%map(k, 4, bin)
      end do
      out%duration = record(duration_out)
      ! where the absolute speed is the key, duration scales with R_b, not with its square root
      if (.not. in%rolling) out%duration = out%duration*in%stretch
      out%height = merge(in%height, record(height_in), in%rolling) + out%rise
      ! velocities scale with speed, the work of gravity with duration only: that of the record is removed
      out%along = scaled*record(along_out) + in%pull(1)*out%duration - scaled*record(pull_along)*record(duration_out)
      out%across = scaled*record(across_out) + in%pull(2)*out%duration - scaled*record(pull_across)*record(duration_out)
      if (.not. in%rolling) out%along = held_longer(out%along, table%hold, in, record(duration_out))
      out%normal = scaled*record(n_out)
      out%w = scaled*record(w_out)
      if (out%exit /= flies .or. out%normal + shift(2) > 0) then
         out%along = out%along + shift(1)
         out%normal = out%normal + shift(2)
         out%w = out%w + shift(3)
      end if
   end subroutine map_outcome

   !> Velocity along the heading, held back by the weight over the boulder's own duration of the contact, not that of
   !> the block in the laboratory: by as much as drives it at the rest angle of the ground. It is not reversed.
   pure real(wp) function held_longer(along, hold, in, duration)
      real(wp), intent(in) :: along     !! of a boulder that was held as long as the block [-]
      real(wp), intent(in) :: hold      !! as in impact_table_t [-]
      type(approach_t), intent(in) :: in
      real(wp), intent(in) :: duration  !! of the record [-]
      real(wp) :: pressing              !! gravity across the plane, over g [-]

      pressing = sqrt(max(0.0_wp, 1 - in%pull(1)*in%pull(1) - in%pull(2)*in%pull(2)))
      held_longer = sign(max(0.0_wp, abs(along) - hold*pressing*duration*(in%stretch - 1/in%stretch)), along)
   end function held_longer

   !> Energy that a record gained beyond the work of gravity along the slope.
   pure real(wp) function hidden_gain(record, inertia)
      real(wp), intent(in) :: record(record_fields), inertia

      hidden_gain = max(0.0_wp, scaled_energy(record(along_out), record(across_out), record(n_out), record(w_out), &
                                              inertia) &
                        - scaled_energy(record(t_in), 0.0_wp, record(n_in), record(w_in), inertia) &
                        - 2*max(0.0_wp, record(pull_along))*max(0.0_wp, record(advance_out)))
   end function hidden_gain

   !> Fraction of the record's gain beyond the work of gravity that a boulder may gain: the record owes it to the relief
   !> and to spin about other axes. All on ground as steep as the record's, nothing on flat ground.
   pure real(wp) function hidden_gain_fraction(pull, of_record)
      real(wp), intent(in) :: pull, of_record  !! gravity along the heading, over g [-]

      hidden_gain_fraction = 0
      if (pull > 0) hidden_gain_fraction = min(1.0_wp, pull/max(of_record, tiny(pull)))
   end function hidden_gain_fraction

   !> Bin of a contact. Keys are compared multiplied by their denominators, to avoid divisions.
   pure integer function contact_bin(table, part, in) result(bin)
      type(impact_table_t), intent(in) :: table
      integer, intent(in) :: part
      type(approach_t), intent(in) :: in

      associate (f => table%flights%total, r => table%rolls%total, speed2 => in%speed*in%speed)
         bin = (part - 1)*(f + r)
         if (in%rolling) then
            bin = bin + f + key_bin(table%rolls, part, [speed2, in%height, in%v(2)], [1.0_wp, 1.0_wp])
         else
            bin = bin + key_bin(table%flights, part, [in%v(2)*in%v(2), in%v(3), in%key*speed2], [speed2, in%speed])
         end if
      end associate
   end function contact_bin

   pure integer function key_bin(bins, part, key, over) result(bin)
      type(bins_t), intent(in) :: bins
      integer, intent(in) :: part
      real(wp), intent(in) :: key(3), over(2)  !! of the first two
      integer :: i, j, k

      i = min(bins%n(1), edge_bin(bins%vectors(1), bins%first_edge(:, part), over(1), key(1)))
      j = min(bins%n(2), edge_bin(bins%vectors(2), bins%second_edge(:, i, part), over(2), key(2)))
      k = min(bins%n(3), edge_bin(bins%vectors(3), bins%third_edge(:, j, i, part), 1.0_wp, key(3)))
      bin = ((i - 1)*bins%n(2) + j - 1)*bins%n(3) + k
   end function key_bin

   !> Return 1 + the number of edges, scaled by a unit, below a value. All edges are compared: an early exit would be
   !> mispredicted.
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

   !> Return whether a hollow may hold a boulder. If so, its record is drawn from those nearest in gravity along the
   !> heading, else from the whole bin: its response to gravity is then proportional, and among few, a record that
   !> happened once in the laboratory would be drawn at every other contact on slopes near its own.
   pure logical function is_held(speed)
      real(wp), intent(in) :: speed  !! as in approach_t [-]

      is_held = .not. speed > max_held_speed
   end function is_held

   !> All records of a bin.
   pure subroutine whole_bin(table, bin, from, n)
      type(impact_table_t), intent(in) :: table
      integer, intent(in) :: bin
      integer, intent(out) :: from, n   !! the first, their number

      from = table%first(bin)
      n = table%first(bin + 1) - from
   end subroutine whole_bin

   !> Find the records of a bin that are nearest in gravity along the heading.
   pure subroutine find_window(table, bin, pull, from, n)
      type(impact_table_t), intent(in) :: table
      integer, intent(in) :: bin
      real(wp), intent(in) :: pull      !! gravity along the heading, over g [-]
      integer, intent(out) :: from, n   !! the first, their number
      integer :: first, last, start, below, k
      real(sp) :: along

      first = table%first(bin)
      last = table%first(bin + 1) - 1
      n = (last - first + window)/window
      along = real(pull, sp)
      below = 0
      do k = 1, marks  ! comparing all, vectorised, is faster than bisection
         below = below + merge(1, 0, table%mark(k, bin) < along)
      end do
      start = below*part_size(table, bin)
      below = 0
      do k = table%place(bin) + start, table%place(bin) + start + part_size(table, bin) - 1
         below = below + merge(1, 0, table%pull_along(k) < along)
      end do
      from = max(first, min(first + start + below - n/2, last + 1 - n))
   end subroutine find_window

   !> Choose one of these records: of three candidates, evenly spaced, the nearest in gravity across the heading. The
   !> response of slow blocks to gravity is not proportional.
   pure integer function nearest_record(table, from, n, pull, u)
      type(impact_table_t), intent(in) :: table
      integer, intent(in) :: from, n   !! from whole_bin or find_window
      real(wp), intent(in) :: pull, u  !! gravity across the heading, over g; uniform in (0, 1) [-]
      integer :: candidate, k
      real(wp) :: separation, min_separation

      nearest_record = from
      min_separation = huge(min_separation)
      do k = 0, candidates - 1
         candidate = int(u*n) + (k*n)/candidates
         candidate = from + candidate - merge(n, 0, candidate >= n)
         separation = abs(table%pull_across(candidate) - pull)
         nearest_record = merge(candidate, nearest_record, separation < min_separation)
         min_separation = min(min_separation, separation)
      end do
      call prefetch_record(table, nearest_record)
   end function nearest_record

   !> Return whether a boulder follows the block of its last record: the contact that followed there begins like this
   !> one. So a boulder in a hollow of the relief stays in it as long as it did in the laboratory.
   pure logical function continues_sequence(table, in)
      type(impact_table_t), intent(in) :: table
      type(approach_t), intent(in) :: in
      real(wp) :: tolerance, excess

      continues_sequence = .false.
      if (in%next == 0) return
      associate (record => table%record(:, in%next))  ! one comparison: several would be mispredicted
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

   !> Inputs of the map, clamped to the range of the bin's records.
   pure function clamped_inputs(input, unit, speed, low, high) result(x)
      real(wp), intent(in) :: input(n_inputs), low(n_inputs), high(n_inputs)  !! [-]
      real(wp), intent(in) :: unit   !! scale of V_t and V_n of the bin [-]
      real(wp), intent(in) :: speed  !! scale of W [-]
      real(wp) :: x(n_inputs), scales(n_inputs)

      scales = [unit, unit, speed, 1.0_wp]
      x = max(scales*low, min(scales*high, input))
   end function clamped_inputs

   !> Twice the kinetic energy, over m g R_b.
   elemental real(wp) function scaled_energy(along, across, normal, w, inertia)
      real(wp), intent(in) :: along, across, normal, w, inertia

      scaled_energy = along*along + across*across + normal*normal + inertia*w*w
   end function scaled_energy

   !> Return whether a contact is faster than all records of its part of the table.
   pure logical function exceeds_table(table, part, in)
      type(impact_table_t), intent(in) :: table
      integer, intent(in) :: part
      type(approach_t), intent(in) :: in

      exceeds_table = .not. in%rolling .and. in%key*(in%speed*in%speed) > table%fastest(part)
   end function exceeds_table

   !> Scale factors between a boulder and the laboratory's blocks if the ground yields at an absolute speed: the key is
   !> the speed there, adjusted for density, so that S = rho_b V_n**2/(2 p_y) is equal.
   pure subroutine compare_scales(table, part, unit, density, key, stretch)
      type(impact_table_t), intent(in) :: table
      integer, intent(in) :: part
      real(wp), intent(in) :: unit          !! sqrt(g R_b) [m/s]
      real(wp), intent(in) :: density       !! of the boulder [kg/m3]
      real(wp), intent(out) :: key, stretch !! as in approach_t [-]

      key = 1
      stretch = 1
      if (.not. table%speed(part) > 0) return
      stretch = unit/table%speed(part)
      key = stretch*stretch*(density/table%density)
   end subroutine compare_scales
end module rockfall_impact_table
