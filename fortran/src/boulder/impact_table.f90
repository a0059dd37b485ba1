! SPDX-License-Identifier: BSD-3-Clause
!> Contacts drawn from a table of contacts that happened in a laboratory (theory, chapter 5): the paper's random
!> operator without its linearity. A contact finds the bin of its own velocity, draws one of the bin's records, and
!> moves it to its own velocity by the least-squares map of the bin.
!>
!> Velocities are over U = sqrt(g R_b), times over sqrt(R_b/g), lengths over R_b: two contacts that are alike in these,
!> and in the speed over what the ground yields to, are alike.
module rockfall_impact_table
   use rockfall_kinds, only: wp, sp
   use rockfall_math, only: logarithm
   implicit none
   private
   public :: impact_table_t, bins_t, approach_t, outcome_t, choose_record, follow_record, ratio_at, beyond_table, &
             compare_scales, energy
   public :: record_fields, pull_along, pull_across, follower, n_inputs, n_mapped, flies, rolls_on, stops

   !> How a record ends, as the laboratory writes it.
   integer, parameter :: flies = 0, rolls_on = 1, stops = 2

   !> Places in a record: (V_t, V_n, W) before it, its speed, the height of its beginning; after it the velocity along
   !> the heading before it, across it towards the descent, V_n, W; duration, advance, rise; gravity along and across,
   !> over g; exit; the place of the record that followed in the laboratory, 0: none is known.
   integer, parameter :: t_in = 1, n_in = 2, w_in = 3, speed_in = 4, height_in = 5, along_out = 6, across_out = 7, &
                         n_out = 8, w_out = 9, lasts = 10, advances = 11, rises = 12, pull_along = 13, &
                         pull_across = 14, exit_code = 15, follower = 16, record_fields = 16

   integer, parameter :: n_inputs = 4  !! of the map of a bin: V_t, V_n, W, and the height where a block rolls
   integer, parameter :: n_mapped = 3  !! along, V_n, W
   integer, parameter :: window = 6      !! a contact draws from this part of its bin: the nearest in gravity along it
   integer, parameter :: candidates = 3  !! of which the nearest in gravity across is taken

   !> A contact is like the one that followed in the laboratory where V, V_n and W differ by no more than the speed
   !> there, or than `slow`; gravity along and across the heading by no more than `alike_pull`, over g; and the height
   !> of what rolls by no more than `alike_height`, over R_b [-].
   real(wp), parameter :: alike_pull = 0.2_wp, alike_height = 0.6_wp
   !> A block this slow, over sqrt(g R_b), moves as its hollow lets it, not in proportion to its velocity [-].
   real(wp), parameter :: slow = 0.5_wp
   !> One that begins faster than this, over sqrt(g R_b), flies from place to place: no hollow holds it, and each
   !> contact is drawn on its own [-].
   real(wp), parameter :: quick = 2.0_wp

   !> Bins of one kind of contacts. Each key has its edges within the bin of the key before.
   type :: bins_t
      integer :: n(3) = 0
      real(wp), allocatable :: first_edge(:, :)         !! (n(1) - 1, ratios)
      real(wp), allocatable :: second_edge(:, :, :)     !! (n(2) - 1, n(1), ratios)
      real(wp), allocatable :: third_edge(:, :, :, :)   !! (n(3) - 1, n(2), n(1), ratios)
   end type bins_t

   type :: impact_table_t
      real(wp), allocatable :: ratio(:)    !! R_b/R_m of each part, rising; one that is zero: it does not matter [-]
      real(wp) :: speed = 0.0_wp           !! sqrt(g R_b) in the laboratory where the speed itself is a key, or 0 [m/s]
      real(wp) :: density = 1.0_wp         !! of the laboratory's blocks [kg/m3]
      real(wp) :: inertia = 0.4_wp         !! of its blocks, I/(m R_b**2) [-]
      real(wp) :: rest_angle = 90.0_wp     !! of its ground: where it is steeper a boulder that stops rolls on [degrees]
      type(bins_t) :: flights, rolls       !! by (V_n/V)**2, W/V, speed; by speed, height, V_n
      integer, allocatable :: first(:)     !! record of each bin, and past the last; flights before rolls, by ratio
      real(wp), allocatable :: map(:, :, :)     !! (n_inputs, n_mapped, bins)
      real(wp), allocatable :: low(:, :), high(:, :)  !! ends of a bin's inputs, W over V (n_inputs, bins)
      real(wp) :: fastest = huge(1.0_wp)   !! V**2 of the fastest record, as the key of speed
      real(sp), allocatable :: record(:, :)     !! (record_fields, records), those of a bin by its pull_along
      real(sp), allocatable :: pull_along(:), pull_across(:)  !! gravity along and across the heading, over g
   end type impact_table_t

   !> A contact as it begins.
   type :: approach_t
      real(wp) :: v(3)              !! V_t, V_n, W [-]
      real(wp) :: speed             !! sqrt(V_t**2 + V_n**2) [-]
      real(wp) :: height = 0.0_wp   !! above the mean ground, of a block that rolls [-]
      logical :: rolling = .false.  !! it goes on from a contact that was cut
      real(wp) :: key               !! what makes V**2 the key of speed, of `speed_scales` [-]
      real(wp) :: stretch           !! how much longer than its record it lasts, likewise [-]
      real(wp) :: inertia           !! I/(m R_b**2) [-]
      real(wp) :: pull(2)           !! gravity along the heading, and across it towards the descent, over g [-]
      integer :: next = 0           !! record that followed that of the contact before; 0: none
   end type approach_t

   !> And as it ends.
   type :: outcome_t
      real(wp) :: along, across, normal, w  !! velocity along the heading before, towards the descent, V_n, W [-]
      real(wp) :: duration, advance, rise   !! [-]
      real(wp) :: height                    !! of the centre at its end, above the mean ground [-]
      real(wp) :: allowed                   !! twice the kinetic energy, over m g R_b, that it may have
      integer :: exit = flies
      integer :: next = 0                   !! record that followed in the laboratory; 0: none
   end type outcome_t

contains

   !> The part of a table that serves R_b/R_m: of the two beside it the upper one with the probability of how near the
   !> ratio comes to it, in the logarithm.
   pure integer function ratio_at(table, ratio, u) result(part)
      type(impact_table_t), intent(in) :: table
      real(wp), intent(in) :: ratio  !! R_b/R_m [-]
      real(wp), intent(in) :: u      !! uniform in (0, 1) [-]

      part = 1
      if (size(table%ratio) == 1) return
      do while (part < size(table%ratio) - 1)
         if (ratio < table%ratio(part + 1)) exit
         part = part + 1
      end do
      associate (low => table%ratio(part), high => table%ratio(part + 1))
         if (ratio <= low) return
         if (ratio >= high) then
            part = part + 1
         else if (u*logarithm(high/low) < logarithm(ratio/low)) then
            part = part + 1
         end if
      end associate
   end function ratio_at

   !> The record that a contact follows: that which followed in the laboratory, or one that is drawn, by one random
   !> number.
   pure subroutine choose_record(table, part, u, in, bin, record)
      type(impact_table_t), intent(in) :: table
      integer, intent(in) :: part      !! of the table, as of ratio_at
      real(wp), intent(in) :: u        !! uniform in (0, 1) [-]
      type(approach_t), intent(in) :: in
      integer, intent(out) :: bin      !! of the contact; 0: the boulder is as the block of the record
      integer, intent(out) :: record

      record = in%next
      bin = 0
      if (goes_on(table, in)) then
         if (table%record(speed_in, record) < slow) return
         bin = bin_of(table, part, in)
      else
         bin = bin_of(table, part, in)
         record = chosen(table, bin, in%pull, u)
      end if
   end subroutine choose_record

   !> What a record does to this boulder.
   pure subroutine follow_record(table, bin, record, in, out)
      type(impact_table_t), intent(in) :: table
      integer, intent(in) :: bin, record  !! as from choose_record
      type(approach_t), intent(in) :: in
      type(outcome_t), intent(out) :: out
      real(wp) :: r(record_fields), ratio

      r = real(table%record(:, record), wp)
      ratio = in%speed/r(speed_in)
      out%exit = nint(r(exit_code))
      out%next = nint(r(follower))
      out%advance = r(advances)
      out%rise = r(rises)
      if (bin == 0) then
         call take_over(r, out)
      else
         call move(table, bin, in, ratio, r, out)
      end if
      out%allowed = energy(in%v(1), 0.0_wp, in%v(2), in%v(3), in%inertia) &
                    + 2*max(0.0_wp, in%pull(1))*max(0.0_wp, out%advance) &
                    + min(1.0_wp, ratio*ratio)*hidden_gain(r, in%inertia)*hidden_part(in%pull(1), r(pull_along))
   end subroutine follow_record

   !> The block of the record itself: what is slow is held by its hollow, so that a small difference in velocity or
   !> slope changes nothing.
   pure subroutine take_over(record, out)
      real(wp), intent(in) :: record(record_fields)
      type(outcome_t), intent(inout) :: out

      out%duration = record(lasts)
      out%height = record(height_in) + out%rise
      out%along = record(along_out)
      out%across = record(across_out)
      out%normal = record(n_out)
      out%w = record(w_out)
   end subroutine take_over

   !> The record moved to the boulder's own velocity, by the map of its bin, and to its own slope.
   pure subroutine move(table, bin, in, ratio, record, out)
      type(impact_table_t), intent(in) :: table
      integer, intent(in) :: bin
      type(approach_t), intent(in) :: in
      real(wp), intent(in) :: ratio   !! of its speed and that of the record [-]
      real(wp), intent(in) :: record(record_fields)
      type(outcome_t), intent(inout) :: out
      real(wp) :: scaled, change(n_inputs), shift(n_mapped)
      integer :: k

      associate (low => table%low(:, bin), high => table%high(:, bin))
         scaled = ratio
         if (in%rolling) then  ! the fastest bin has no end: beyond it a contact is as its last at a larger scale
            scaled = 1
            if (in%v(1) > high(1) .and. high(1) > 0) scaled = in%v(1)/high(1)
         end if
         change = within([in%v, in%height], merge(scaled, in%speed, in%rolling), in%speed, low, high) &
                  - [scaled*record(t_in:w_in), record(height_in)]
      end associate
      if (.not. in%rolling) change(4) = 0
      do k = 1, n_mapped  ! matmul of parts of an array is a call of the library
         shift(k) = sum(change*table%map(:, k, bin))
      end do
      out%duration = record(lasts)
      ! at one speed a contact lasts as R_b, not as its root
      if (.not. in%rolling) out%duration = out%duration*in%stretch
      out%height = merge(in%height, record(height_in), in%rolling) + out%rise
      ! velocities scale with the speed, the work of gravity with the duration alone: that of the record is taken out
      out%along = scaled*record(along_out) + in%pull(1)*out%duration - scaled*record(pull_along)*record(lasts)
      out%across = scaled*record(across_out) + in%pull(2)*out%duration - scaled*record(pull_across)*record(lasts)
      out%normal = scaled*record(n_out)
      out%w = scaled*record(w_out)
      if (out%exit /= flies .or. out%normal + shift(2) > 0) then
         out%along = out%along + shift(1)
         out%normal = out%normal + shift(2)
         out%w = out%w + shift(3)
      end if
   end subroutine move

   !> What a record gained beyond the work of gravity along the slope.
   pure real(wp) function hidden_gain(record, inertia)
      real(wp), intent(in) :: record(record_fields), inertia

      hidden_gain = max(0.0_wp, energy(record(along_out), record(across_out), record(n_out), record(w_out), inertia) &
                        - energy(record(t_in), 0.0_wp, record(n_in), record(w_in), inertia) &
                        - 2*max(0.0_wp, record(pull_along))*max(0.0_wp, record(advances)))
   end function hidden_gain

   !> How much of what a record gained, beyond the work of gravity, a boulder may gain: the record had it of relief that
   !> it stood on and of spin about other axes. All on ground as steep as the record's, nothing on the flat.
   pure real(wp) function hidden_part(pull, of_record)
      real(wp), intent(in) :: pull, of_record  !! gravity along the heading, over g [-]

      hidden_part = 0
      if (pull > 0) hidden_part = min(1.0_wp, pull/max(of_record, tiny(pull)))
   end function hidden_part

   !> The bin of a contact. Its keys are compared times what they are over: no quotient is needed.
   pure integer function bin_of(table, part, in) result(bin)
      type(impact_table_t), intent(in) :: table
      integer, intent(in) :: part
      type(approach_t), intent(in) :: in

      associate (f => table%flights%n, r => table%rolls%n, speed2 => in%speed*in%speed)
         bin = (part - 1)*(product(f) + product(r))
         if (in%rolling) then
            bin = bin + product(f) + bin_among(table%rolls, part, [speed2, in%height, in%v(2)], [1.0_wp, 1.0_wp])
         else
            bin = bin + bin_among(table%flights, part, [in%v(2)*in%v(2), in%v(3), in%key*speed2], [speed2, in%speed])
         end if
      end associate
   end function bin_of

   pure integer function bin_among(bins, part, key, over) result(bin)
      type(bins_t), intent(in) :: bins
      integer, intent(in) :: part
      real(wp), intent(in) :: key(3), over(2)  !! of the first two
      integer :: i, j, k

      i = place(bins%first_edge(:, part), over(1), key(1))
      j = place(bins%second_edge(:, i, part), over(2), key(2))
      k = place(bins%third_edge(:, j, i, part), 1.0_wp, key(3))
      bin = ((i - 1)*bins%n(2) + j - 1)*bins%n(3) + k
   end function bin_among

   !> 1 + the number of edges, times a unit, below a value. All are compared: a way out of the loop would be guessed
   !> wrong each time.
   pure integer function place(edge, unit, value)
      real(wp), intent(in), contiguous :: edge(:)
      real(wp), intent(in) :: unit, value
      integer :: k

      place = 1
      do k = 1, size(edge)
         place = place + merge(1, 0, edge(k)*unit < value)
      end do
   end function place

   !> A record of a bin: of three, evenly spaced among those whose gravity along the heading is the nearest, that whose
   !> gravity across it is. What is slow answers to gravity as its slope lets it, not in proportion.
   pure integer function chosen(table, bin, pull, u)
      type(impact_table_t), intent(in) :: table
      integer, intent(in) :: bin
      real(wp), intent(in) :: pull(2), u
      integer :: first, last, n, from, one, k
      real(sp) :: along
      real(wp) :: apart, least

      first = table%first(bin)
      last = table%first(bin + 1) - 1
      n = (last - first + window)/window
      along = real(pull(1), sp)
      from = first - n/2
      do k = first, last  ! to compare all, several at a time, is faster than to find it by halves
         from = from + merge(1, 0, table%pull_along(k) < along)
      end do
      from = max(first, min(from, last + 1 - n))
      chosen = from
      least = huge(least)
      do k = 0, candidates - 1
         one = int(u*n) + (k*n)/candidates
         one = from + one - merge(n, 0, one >= n)
         apart = abs(table%pull_across(one) - pull(2))
         chosen = merge(one, chosen, apart < least)
         least = min(least, apart)
      end do
   end function chosen

   !> Whether a boulder goes on as the block of its last record did: the contact that followed there began as this one
   !> does. So what sits in a hollow of the relief stays in it as long as it did in the laboratory.
   pure logical function goes_on(table, in)
      type(impact_table_t), intent(in) :: table
      type(approach_t), intent(in) :: in
      real(wp) :: alike

      goes_on = .false.
      if (in%next == 0) return
      associate (record => table%record(:, in%next))
         if (record(speed_in) > quick) return
         if (any(abs(in%pull - record(pull_along:pull_across)) > alike_pull)) return
         if (in%rolling .and. abs(in%height - record(height_in)) > alike_height) return
         alike = max(slow, real(record(speed_in), wp))
         goes_on = abs(in%speed - record(speed_in)) <= alike .and. abs(in%v(2) - record(n_in)) <= alike &
                   .and. abs(in%v(3) - record(w_in)) <= alike
      end associate
   end function goes_on

   !> The inputs of the map, no farther than the records of the bin reach.
   pure function within(input, unit, speed, low, high) result(x)
      real(wp), intent(in) :: input(n_inputs), low(n_inputs), high(n_inputs)  !! [-]
      real(wp), intent(in) :: unit   !! of V_t and V_n of the bin [-]
      real(wp), intent(in) :: speed  !! which is that of W [-]
      real(wp) :: x(n_inputs), of(n_inputs)

      of = [unit, unit, speed, 1.0_wp]
      x = max(of*low, min(of*high, input))
   end function within

   !> Twice the kinetic energy, over m g R_b.
   elemental real(wp) function energy(along, across, normal, w, inertia)
      real(wp), intent(in) :: along, across, normal, w, inertia

      energy = along*along + across*across + normal*normal + inertia*w*w
   end function energy

   !> Whether a contact is faster than any of the table.
   pure logical function beyond_table(table, in)
      type(impact_table_t), intent(in) :: table
      type(approach_t), intent(in) :: in

      beyond_table = .not. in%rolling .and. in%key*(in%speed*in%speed) > table%fastest
   end function beyond_table

   !> How a boulder compares with the laboratory's blocks where the ground yields to the speed itself: the key is the
   !> speed there, with the density, so that S = rho_b V_n**2/(2 p_y) is the same.
   pure subroutine compare_scales(table, unit, density, key, stretch)
      type(impact_table_t), intent(in) :: table
      real(wp), intent(in) :: unit          !! sqrt(g R_b) [m/s]
      real(wp), intent(in) :: density       !! of the boulder [kg/m3]
      real(wp), intent(out) :: key, stretch !! as in approach_t [-]

      key = 1
      stretch = 1
      if (.not. table%speed > 0) return
      stretch = unit/table%speed
      key = stretch*stretch*(density/table%density)
   end subroutine compare_scales
end module rockfall_impact_table
