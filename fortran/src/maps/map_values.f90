! SPDX-License-Identifier: BSD-3-Clause
!> Map values: which tallies a map needs, and how its rows are computed from them.
module rockfall_map_values
   use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan
   use rockfall_kinds, only: wp, sp, i4, i8, i16
   use rockfall_dimensions, only: n_map_counts, n_map_sums, n_map_maxima
   use rockfall_bins, only: energy, speed, jump_height, passing_height, n_log_bins, log_bin_quantile, log_bin_value
   use rockfall_maps, only: maps_t, per_unit, square_base
   use rockfall_travel_maps, only: steepest_angle, flattest_angle, shortest_time
   implicit none
   private
   public :: map_plan_t, map_plan, stack_layers, map_views, map_row, map_min_count, map_thin_below, fraction_limit
   public :: z_95, limit_rank, min_for_mean, min_for_std, max_columns, halvings

   real(wp), parameter :: z_95 = 1.959964_wp  !! standard normal quantile of 0.975, for 95 % intervals [-]
   integer, parameter :: min_for_mean = 10  !! passages below which the interval of a mean is not reliable
   integer, parameter :: min_for_std = 100  !! passages below which the interval of a standard deviation is not reliable
   integer(i8), parameter :: max_columns = 2_i8**31 - 2  !! maximum number of columns; one more marks overflow
   integer, parameter :: halvings = 5  !! number of times that the number of columns may be halved

   !> Index of each tally in its stack of layers; 0 = not requested.
   type :: map_plan_t
      integer :: count(n_map_counts - 2) = 0  !! passages, deposits, contributing sources, their boulders, hits
      !> Energy, speed, jump height, passing height; for tree hits: heights, absorbed energies, number.
      integer :: sum(n_map_sums) = 0
      integer :: square(4) = 0 !! for each quantity, the first of two layers for squares among the sums
      integer :: max(n_map_maxima) = 0    !! as `sum`, without the last two
      integer :: travel(3) = 0     !! steepest and flattest energy line, shortest time: indices among the maxima
      integer :: exceeded(2) = 0   !! first layer of thresholds among the counts, for passages and for hits
      integer :: thresholds = 0    !! number of thresholds
      integer :: bins(4) = 0   !! first row of each quantity in the bin counts
      integer :: rows = 0      !! number of rows of the bin counts
   end type map_plan_t

   enum, bind(c)
      enumerator :: a_count, a_fraction, a_source_fraction, a_lower_limit, an_upper_limit, a_maximum, a_mean, &
                    a_std, a_quantile, an_exceedance, a_hit_exceedance, a_steepest, a_flattest, a_shortest, &
                    a_tree_maximum, a_tree_mean, a_tree_sum
   end enum

   !> Indices of the tree quantities in a plan.
   integer, parameter :: tree_height = 5, tree_energy = 6, tree_impacts = 7

   !> Kind of a map, parsed from its name.
   type :: kind_t
      integer :: form = a_count
      integer :: quantity = energy
      real(wp) :: probability = 0.0_wp  !! probability of a quantile [-]
      integer :: side = 0               !! 0: the quantile; -1, 1: lower, upper limit of its interval
   end type kind_t

contains

   !> Parse a map name; composed names are quantity_max, quantity_mean, quantity_std, quantity_q95, quantity_q95_low.
   pure type(kind_t) function parsed_kind(name) result(kind)
      character(len=*), intent(in) :: name  !! a name in map_fields of rockfall_variables
      integer :: q, percent

      select case (name)
      case ("passages", "deposits", "sources", "hits", "tree_impacts"); return
      case ("reach_probability"); kind%form = a_fraction; return
      case ("reach_probability_by_source"); kind%form = a_source_fraction; return
      case ("reach_probability_low"); kind%form = a_lower_limit; return
      case ("reach_probability_high"); kind%form = an_upper_limit; return
      case ("energy_exceeded"); kind%form = an_exceedance; return
      case ("hits_energy_exceeded"); kind%form = a_hit_exceedance; return
      case ("energy_line_angle_max"); kind%form = a_steepest; return
      case ("energy_line_angle_min"); kind%form = a_flattest; return
      case ("travel_time_min"); kind%form = a_shortest; return
      case ("tree_impact_height_max"); kind%form = a_tree_maximum; return
      case ("tree_impact_height_mean"); kind%form = a_tree_mean; return
      case ("tree_energy"); kind%form = a_tree_sum; return
      end select
      if (index(name, "speed") == 1) kind%quantity = speed
      if (index(name, "jump_height") == 1) kind%quantity = jump_height
      if (index(name, "passing_height") == 1) kind%quantity = passing_height
      kind%form = merge(a_maximum, a_mean, index(name, "_max") > 0)
      if (index(name, "_std") > 0) kind%form = a_std
      q = index(name, "_q", back=.true.)
      if (q == 0) return
      kind%form = a_quantile
      kind%side = merge(1, 0, index(name, "_high") > 0) - merge(1, 0, index(name, "_low") > 0)
      read (name(q + 2:q + 3), "(i2)") percent
      kind%probability = percent/100.0_wp
   end function parsed_kind

   !> Tallies needed by a list of maps.
   pure type(map_plan_t) function map_plan(names, thresholds) result(plan)
      character(len=*), intent(in) :: names(:)
      integer, intent(in) :: thresholds  !! number of energy thresholds
      type(kind_t) :: kind
      logical :: count(5), sum(7), square(4), max(5), bins(4), travel(3), exceeded(2)
      integer :: k

      count = .false.
      exceeded = .false.
      sum = .false.
      square = .false.
      max = .false.
      bins = .false.
      travel = .false.
      do k = 1, size(names)
         kind = parsed_kind(names(k))
         select case (kind%form)
         case (a_count)
            count(:3) = count(:3) .or. names(k) == [character(len=8) :: "passages", "deposits", "sources"]
            count(5) = count(5) .or. names(k) == "hits"
            sum(tree_impacts) = sum(tree_impacts) .or. names(k) == "tree_impacts"
         case (a_source_fraction); count([1, 4]) = .true.
         case (a_maximum); max(kind%quantity) = .true.
         case (a_mean); sum(kind%quantity) = .true.
         case (a_std); square(kind%quantity) = .true.
         case (a_quantile); bins(kind%quantity) = .true.
         case (an_exceedance); exceeded(1) = .true.
         case (a_hit_exceedance); exceeded(2) = .true.
         case (a_steepest); travel(1) = .true.
         case (a_flattest); travel(2) = .true.
         case (a_shortest); travel(3) = .true.
         case (a_tree_maximum); max(tree_height) = .true.
         case (a_tree_mean); sum(tree_height) = .true.
         case (a_tree_sum); sum(tree_energy) = .true.
         case default; count(1) = .true.
         end select
      end do
      sum(:4) = sum(:4) .or. square
      count(1) = count(1) .or. any(sum(:4))
      sum(tree_impacts) = sum(tree_impacts) .or. sum(tree_height)
      plan%count = layer_numbers(count)
      plan%sum = layer_numbers(sum)
      plan%square = merge(2*layer_numbers(square) - 1 + maxval(plan%sum), 0, square)
      plan%max = layer_numbers(max)
      plan%travel = merge(layer_numbers(travel) + maxval(plan%max), 0, travel)
      if (any(exceeded)) plan%thresholds = thresholds
      plan%exceeded = merge(maxval(plan%count) + 1 + (layer_numbers(exceeded) - 1)*thresholds, 0, exceeded)
      do k = 1, size(bins)
         if (.not. bins(k)) cycle
         plan%bins(k) = plan%rows + 1
         plan%rows = plan%rows + n_log_bins(k)
      end do
   end function map_plan

   !> Number of layers of each stack: counts, sums, maxima.
   pure function stack_layers(plan) result(layers)
      type(map_plan_t), intent(in) :: plan
      integer :: layers(3)

      layers = [maxval(plan%count) + count(plan%exceeded > 0)*plan%thresholds, &
                maxval(plan%sum) + 2*count(plan%square > 0), maxval([plan%max, plan%travel])]
   end function stack_layers

   !> Number the requested items 1, 2, ... consecutively.
   pure function layer_numbers(requested)
      logical, intent(in) :: requested(:)
      integer :: layer_numbers(size(requested))
      integer :: k

      layer_numbers = [(merge(count(requested(:k)), 0, requested(k)), k=1, size(requested))]
   end function layer_numbers

   !> Maps as views of the stacks described by a plan; unused stacks may have any size. The first element of the stacks
   !> is column and row `origin` of the raster.
   function map_views(plan, thresholds, origin, counts, sums, maxima, bin_counts, slot, slots) result(maps)
      type(map_plan_t), intent(in) :: plan
      real(wp), intent(in) :: thresholds(:)                              !! energy thresholds [J]
      integer, intent(in) :: origin(2)
      integer(i4), intent(in), target, contiguous :: counts(:, :, :)     !! (nx, ny, layers)
      integer(i8), intent(in), target, contiguous :: sums(:, :, :)
      real(sp), intent(in), target, contiguous :: maxima(:, :, :)      !! [J], [m/s], [m] by quantity
      integer(i4), intent(in), target, contiguous :: bin_counts(:, :)  !! (plan%rows, slots)
      integer(i4), intent(in), target, contiguous :: slot(:, :)        !! (nx, ny)
      integer(i4), intent(in), target :: slots
      type(maps_t) :: maps
      integer :: k

      if (plan%count(1) > 0) maps%passages(origin(1):, origin(2):) => counts(:, :, plan%count(1))
      if (plan%count(2) > 0) maps%deposits(origin(1):, origin(2):) => counts(:, :, plan%count(2))
      if (plan%count(3) > 0) maps%sources(origin(1):, origin(2):) => counts(:, :, plan%count(3))
      if (plan%count(4) > 0) maps%released(origin(1):, origin(2):) => counts(:, :, plan%count(4))
      if (plan%count(5) > 0) maps%hits(origin(1):, origin(2):) => counts(:, :, plan%count(5))
      do k = 1, size(maps%layer)
         if (plan%sum(k) > 0) maps%layer(k)%sum(origin(1):, origin(2):) => sums(:, :, plan%sum(k))
         if (plan%square(k) > 0) maps%layer(k)%square(origin(1):, origin(2):, 1:) => sums(:, :, plan%square(k):)
         if (plan%max(k) > 0) maps%layer(k)%max(origin(1):, origin(2):) => maxima(:, :, plan%max(k))
         maps%layer(k)%bin_offset = plan%bins(k) - 1
      end do
      if (plan%thresholds > 0) then
         maps%threshold = thresholds
         if (plan%exceeded(1) > 0) maps%exceeded(origin(1):, origin(2):, 1:) => counts(:, :, plan%exceeded(1):)
         if (plan%exceeded(2) > 0) maps%hits_exceeded(origin(1):, origin(2):, 1:) => counts(:, :, plan%exceeded(2):)
      end if
      if (plan%travel(1) > 0) maps%steepest(origin(1):, origin(2):) => maxima(:, :, plan%travel(1))
      if (plan%travel(2) > 0) maps%flattest(origin(1):, origin(2):) => maxima(:, :, plan%travel(2))
      if (plan%travel(3) > 0) maps%shortest(origin(1):, origin(2):) => maxima(:, :, plan%travel(3))
      if (plan%sum(tree_impacts) > 0) maps%tree_impacts(origin(1):, origin(2):) => sums(:, :, plan%sum(tree_impacts))
      if (plan%sum(tree_height) > 0) maps%tree_height%sum(origin(1):, origin(2):) => sums(:, :, plan%sum(tree_height))
      if (plan%max(tree_height) > 0) maps%tree_height%max(origin(1):, origin(2):) => maxima(:, :, plan%max(tree_height))
      if (plan%sum(tree_energy) > 0) maps%tree_energy(origin(1):, origin(2):) => sums(:, :, plan%sum(tree_energy))
      if (plan%rows == 0) return
      maps%bin_counts => bin_counts
      maps%slot(origin(1):, origin(2):) => slot
      maps%slots => slots
   end function map_views

   !> Minimum number of passages in a cell for which a map shows a value; 0 for maps without a minimum.
   pure integer function map_min_count(name, min_passages)
      character(len=*), intent(in) :: name
      integer, intent(in) :: min_passages  !! as given in the case
      type(kind_t) :: kind

      kind = parsed_kind(name)
      map_min_count = 0
      if (any(kind%form == [a_mean, a_tree_mean, a_quantile])) map_min_count = min_passages
      if (kind%form == a_std) map_min_count = max(2, min_passages)
   end function map_min_count

   !> Number of passages below which a map value is unreliable; 0 for maps that are always reliable. A quantile needs
   !> enough passages for both limits of its interval.
   pure integer function map_thin_below(name, per_cluster) result(n)
      character(len=*), intent(in) :: name
      integer(i8), intent(in) :: per_cluster  !! as for limit_rank
      type(kind_t) :: kind

      kind = parsed_kind(name)
      n = 0
      if (kind%form == a_mean) n = min_for_mean
      if (kind%form == a_std) n = min_for_std
      if (kind%form /= a_quantile .or. kind%side /= 0) return
      n = 1
      do while (.not. (has_limit(kind%probability, int(n, i8), per_cluster, -1) &
                       .and. has_limit(kind%probability, int(n, i8), per_cluster, 1)))
         n = n + 1
      end do
   end function map_thin_below

   !> Compute row j of a real map; NaN in cells that too few boulders passed.
   pure subroutine map_row(maps, name, j, boulders, per_cluster, min_passages, row)
      type(maps_t), intent(in) :: maps
      character(len=*), intent(in) :: name
      integer, intent(in) :: j
      integer(i8), intent(in) :: boulders     !! boulders of the run
      integer(i8), intent(in) :: per_cluster  !! as for limit_rank
      integer, intent(in) :: min_passages     !! as for map_min_count
      real(sp), intent(out) :: row(:)         !! in the unit of the map
      type(kind_t) :: kind
      real(wp) :: n_boulders, clusters
      integer :: min_count

      kind = parsed_kind(name)
      n_boulders = real(boulders, wp)
      clusters = n_boulders/per_cluster
      min_count = max(1, map_min_count(name, min_passages))
      row = ieee_value(1.0_sp, ieee_quiet_nan)
      select case (kind%form)
      case (a_count); call count_row(maps, name, j, row)
      case (a_fraction); row = real(maps%passages(:, j)/n_boulders, sp)
      case (a_source_fraction)
         associate (n => maps%passages(:, j), released => maps%released(:, j))
            where (released > 0) row = real(n/real(max(1, released), wp), sp)
         end associate
      case (a_lower_limit); row = real(fraction_limit(maps%passages(:, j)/n_boulders, clusters, -1), sp)
      case (an_upper_limit); row = real(fraction_limit(maps%passages(:, j)/n_boulders, clusters, 1), sp)
      case (a_maximum)
         associate (maximum => maps%layer(kind%quantity)%max(:, j))
            where (maximum > 0) row = maximum
         end associate
      case (a_steepest)
         where (maps%steepest(:, j) > 0) row = steepest_angle(maps%steepest(:, j))
      case (a_flattest)
         where (maps%flattest(:, j) > 0) row = flattest_angle(maps%flattest(:, j))
      case (a_shortest)
         where (maps%shortest(:, j) > 0) row = shortest_time(maps%shortest(:, j))
      case (a_mean)
         associate (total => maps%layer(kind%quantity)%sum(:, j), n => maps%passages(:, j))
            where (n >= min_count) row = real(total/(per_unit(kind%quantity)*max(1, n)), sp)
         end associate
      case (a_std)
         associate (layer => maps%layer(kind%quantity), n => maps%passages(:, j))
            where (n >= min_count) row = real(std_of_sums(layer%sum(:, j), layer%square(:, j, 1), &
                                                          layer%square(:, j, 2), max(2, n)) &
                                              /per_unit(kind%quantity), sp)
         end associate
      case (a_tree_maximum)
         associate (maximum => maps%tree_height%max(:, j))
            where (maximum > 0) row = maximum
         end associate
      case (a_tree_mean)
         associate (total => maps%tree_height%sum(:, j), n => maps%tree_impacts(:, j))
            where (n >= min_count) row = real(total/(per_unit(jump_height)*max(1_i8, n)), sp)
         end associate
      case (a_tree_sum)
         associate (total => maps%tree_energy(:, j))
            where (total > 0) row = real(total, sp)
         end associate
      case (a_quantile)
         call quantile_row(maps, kind, j, per_cluster, min_count, row)
      end select
   end subroutine map_row

   !> Row j of a map of counts.
   pure subroutine count_row(maps, name, j, row)
      type(maps_t), intent(in) :: maps
      character(len=*), intent(in) :: name
      integer, intent(in) :: j
      real(sp), intent(inout) :: row(:)

      select case (name)
      case ("passages"); row = real(maps%passages(:, j), sp)
      case ("deposits"); row = real(maps%deposits(:, j), sp)
      case ("sources"); row = real(maps%sources(:, j), sp)
      case ("hits"); row = real(maps%hits(:, j), sp)
      case ("tree_impacts"); row = real(maps%tree_impacts(:, j), sp)
      end select
   end subroutine count_row

   !> Standard deviation (n - 1) of n integers from their sum and the two digits of the sum of their squares; exact up
   !> to the last operations, so that equal numbers give zero.
   elemental real(wp) function std_of_sums(total, high, low, n) result(std)
      integer(i8), intent(in) :: total, high, low
      integer(i4), intent(in) :: n
      integer(i16) :: squares

      squares = int(high, i16)*square_base + low
      std = sqrt(real(n*squares - int(total, i16)*total, wp)/(real(n, wp)*(n - 1)))
   end function std_of_sums

   !> Rank of a limit of the 95 % interval for quantile p of n numbers, from the binomial distribution, as in line
   !> statistics. No limit exists below the first or above the last number. Boulders of a cluster may behave alike,
   !> which increases the variance at most by a factor equal to the cluster size.
   pure real(wp) function limit_rank(p, n, per_cluster, side)
      real(wp), intent(in) :: p    !! [-]
      integer(i8), intent(in) :: n
      real(wp), intent(in) :: per_cluster  !! boulders per cluster, or n over the effective number; 1 if independent
      integer, intent(in) :: side  !! -1 lower, 1 upper

      limit_rank = n*p + side*z_95*sqrt(n*per_cluster*p*(1 - p))
   end function limit_rank

   !> Return whether a limit of the interval exists within n numbers.
   pure logical function has_limit(p, n, per_cluster, side)
      real(wp), intent(in) :: p    !! [-]
      integer(i8), intent(in) :: n, per_cluster
      integer, intent(in) :: side  !! as in limit_rank

      has_limit = abs(limit_rank(p, n, real(per_cluster, wp), side) - 0.5_wp*n) <= 0.5_wp*(n - 1)
   end function has_limit

   !> Compute row j of a quantile of the maxima of passing boulders, or of a limit of its interval.
   pure subroutine quantile_row(maps, kind, j, per_cluster, min_count, row)
      type(maps_t), intent(in) :: maps
      type(kind_t), intent(in) :: kind
      integer, intent(in) :: j, min_count
      integer(i8), intent(in) :: per_cluster  !! as for limit_rank
      real(sp), intent(inout) :: row(:)       !! in the unit of the quantity
      integer(i8) :: n
      integer :: i, first, last

      first = maps%layer(kind%quantity)%bin_offset + 1
      last = first + n_log_bins(kind%quantity) - 1
      do i = 1, size(row)
         if (maps%slot(i, j) == 0) cycle
         associate (counts => maps%bin_counts(first:last, maps%slot(i, j)))
            n = sum(int(counts, i8))
            if (n < min_count) cycle
            if (kind%side == 0) row(i) = real(log_bin_quantile(kind%quantity, counts, kind%probability), sp)
            if (kind%side == 0) cycle
            if (has_limit(kind%probability, n, per_cluster, kind%side)) &
               row(i) = real(log_bin_value(kind%quantity, counts, &
                                           limit_rank(kind%probability, n, real(per_cluster, wp), kind%side)), sp)
         end associate
      end do
   end subroutine quantile_row

   !> Limit of the 95 % interval of a fraction of n [-] (Wilson 1927, doi:10.1080/01621459.1927.10502953).
   elemental real(wp) function fraction_limit(p, n, side)
      real(wp), intent(in) :: p, n  !! fraction, sample size [-]
      integer, intent(in) :: side   !! -1 lower, 1 upper

      associate (z => z_95)
         fraction_limit = (p + z*z/(2*n) + side*z*sqrt(p*(1 - p)/n + (z/(2*n))**2))/(1 + z*z/n)
      end associate
      if (.not. p > 0 .and. side < 0) fraction_limit = 0
      if (.not. p < 1 .and. side > 0) fraction_limit = 1
   end function fraction_limit
end module rockfall_map_values
