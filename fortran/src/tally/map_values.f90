! SPDX-License-Identifier: BSD-3-Clause
!> What a map shows: which tallies it needs, and how a row of it is made of them, the same for both doors.
module rockfall_mapvalues
   use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan
   use rockfall_kinds, only: wp, sp, i4, i8
   use rockfall_classes, only: energy, speed, jump_height, n_classes, class_quantile, fewest_for
   use rockfall_map, only: maps_t, per_unit
   implicit none
   private
   public :: map_plan_t, map_plan, map_views, map_row, map_fewest, is_count

   real(wp), parameter :: z = 1.959964_wp  !! of a normal distribution, 95 % within

   !> Where each tally stands in its stack of layers; 0 = nobody asked for it.
   type :: map_plan_t
      integer :: count(4) = 0     !! passages, deposits, sources that feed a cell, boulders of these
      integer :: sum(3) = 0       !! of energy, speed, jump height
      integer :: greatest(3) = 0
      integer :: classes(3) = 0   !! the first row of its counts
      integer :: rows = 0         !! of counts of classes
   end type map_plan_t

   enum, bind(c)
      enumerator :: a_count, a_share, a_source_share, a_lower_share, an_upper_share, a_maximum, a_mean, a_quantile
   end enum

   !> What a map is, from its name.
   type :: kind_t
      integer :: is = a_count
      integer :: quantity = energy
      real(wp) :: share = 0.0_wp  !! of a quantile
   end type kind_t

contains

   pure type(kind_t) function kind_of(name) result(kind)
      character(len=*), intent(in) :: name  !! one of map_fields of rockfall_variables
      integer :: q, percent

      select case (name)
      case ("passages", "deposits", "sources"); return
      case ("reach_probability"); kind%is = a_share; return
      case ("reach_probability_by_source"); kind%is = a_source_share; return
      case ("reach_probability_low"); kind%is = a_lower_share; return
      case ("reach_probability_high"); kind%is = an_upper_share; return
      end select
      if (index(name, "speed") == 1) kind%quantity = speed
      if (index(name, "jump_height") == 1) kind%quantity = jump_height
      kind%is = merge(a_maximum, a_mean, index(name, "_max") > 0)
      q = index(name, "_q", back=.true.)
      if (q == 0) return
      kind%is = a_quantile
      read (name(q + 2:q + 3), "(i2)") percent
      kind%share = percent/100.0_wp
   end function kind_of

   !> Whether a map holds integers.
   pure logical function is_count(name)
      character(len=*), intent(in) :: name
      type(kind_t) :: kind

      kind = kind_of(name)
      is_count = kind%is == a_count
   end function is_count

   !> The tallies that some maps need.
   pure type(map_plan_t) function map_plan(names) result(plan)
      character(len=*), intent(in) :: names(:)
      type(kind_t) :: kind
      logical :: count(4), sum(3), greatest(3), classes(3)
      integer :: k

      count = .false.
      sum = .false.
      greatest = .false.
      classes = .false.
      do k = 1, size(names)
         kind = kind_of(names(k))
         select case (kind%is)
         case (a_count); count(:3) = count(:3) .or. names(k) == [character(len=8) :: "passages", "deposits", "sources"]
         case (a_source_share); count([1, 4]) = .true.
         case (a_maximum); greatest(kind%quantity) = .true.
         case (a_mean); sum(kind%quantity) = .true.
         case (a_quantile); classes(kind%quantity) = .true.
         case default; count(1) = .true.
         end select
      end do
      count(1) = count(1) .or. any(sum)
      plan%count = places(count)
      plan%sum = places(sum)
      plan%greatest = places(greatest)
      do k = 1, 3
         if (.not. classes(k)) cycle
         plan%classes(k) = plan%rows + 1
         plan%rows = plan%rows + n_classes(k)
      end do
   end function map_plan

   !> 1, 2, ... for what is wanted, in order.
   pure function places(wanted)
      logical, intent(in) :: wanted(:)
      integer :: places(size(wanted))
      integer :: k

      places = [(merge(count(wanted(:k)), 0, wanted(k)), k=1, size(wanted))]
   end function places

   !> Maps as views of the stacks that a plan describes; what it has not may be of any size. The stacks begin
   !> at column and row `at` of the raster.
   function map_views(plan, at, counts, sums, greatest, class_counts, column, columns) result(maps)
      type(map_plan_t), intent(in) :: plan
      integer, intent(in) :: at(2)
      integer(i4), intent(in), target, contiguous :: counts(:, :, :)     !! (nx, ny, layers)
      integer(i8), intent(in), target, contiguous :: sums(:, :, :)
      real(sp), intent(in), target, contiguous :: greatest(:, :, :)
      integer(i4), intent(in), target, contiguous :: class_counts(:, :)  !! (plan%rows, cells)
      integer(i4), intent(in), target, contiguous :: column(:, :)        !! (nx, ny)
      integer(i4), intent(in), target :: columns
      type(maps_t) :: maps
      integer :: k

      if (plan%count(1) > 0) maps%passages(at(1):, at(2):) => counts(:, :, plan%count(1))
      if (plan%count(2) > 0) maps%deposits(at(1):, at(2):) => counts(:, :, plan%count(2))
      if (plan%count(3) > 0) maps%sources(at(1):, at(2):) => counts(:, :, plan%count(3))
      if (plan%count(4) > 0) maps%released(at(1):, at(2):) => counts(:, :, plan%count(4))
      do k = 1, 3
         if (plan%sum(k) > 0) maps%layer(k)%sum(at(1):, at(2):) => sums(:, :, plan%sum(k))
         if (plan%greatest(k) > 0) maps%layer(k)%greatest(at(1):, at(2):) => greatest(:, :, plan%greatest(k))
         maps%layer(k)%classes = plan%classes(k) - 1
      end do
      if (plan%rows == 0) return
      maps%class_counts => class_counts
      maps%column(at(1):, at(2):) => column
      maps%columns => columns
   end function map_views

   !> The fewest passages for which a cell of a map shows a number; 0 for maps that show all.
   !> A quantile needs as many as both limits of its own 95 % interval do.
   pure integer function map_fewest(name, least)
      character(len=*), intent(in) :: name
      integer, intent(in) :: least  !! what the case asks for
      type(kind_t) :: kind

      kind = kind_of(name)
      map_fewest = 0
      if (kind%is == a_mean) map_fewest = least
      if (kind%is == a_quantile) map_fewest = max(least, fewest_for(kind%share))
   end function map_fewest

   !> Row j of a map of reals; NaN where too few boulders passed.
   pure subroutine map_row(maps, name, j, boulders, least, row)
      type(maps_t), intent(in) :: maps
      character(len=*), intent(in) :: name
      integer, intent(in) :: j
      integer(i8), intent(in) :: boulders  !! of the run
      integer, intent(in) :: least         !! as for map_fewest
      real(sp), intent(out) :: row(:)
      type(kind_t) :: kind
      integer :: fewest

      kind = kind_of(name)
      fewest = max(1, map_fewest(name, least))
      row = ieee_value(1.0_sp, ieee_quiet_nan)
      select case (kind%is)
      case (a_share); row = real(maps%passages(:, j)/real(boulders, wp), sp)
      case (a_source_share)
         associate (n => maps%passages(:, j), of => maps%released(:, j))
            where (of > 0) row = real(n/real(max(1, of), wp), sp)
         end associate
      case (a_lower_share); row = real(share_limit(maps%passages(:, j), boulders, -1), sp)
      case (an_upper_share); row = real(share_limit(maps%passages(:, j), boulders, 1), sp)
      case (a_maximum)
         associate (greatest => maps%layer(kind%quantity)%greatest(:, j))
            where (greatest > 0) row = greatest
         end associate
      case (a_mean)
         associate (total => maps%layer(kind%quantity)%sum(:, j), n => maps%passages(:, j))
            where (n >= fewest) row = real(total/(per_unit(kind%quantity)*max(1, n)), sp)
         end associate
      case (a_quantile)
         call quantile_row(maps, kind, j, fewest, row)
      end select
   end subroutine map_row

   pure subroutine quantile_row(maps, kind, j, fewest, row)
      type(maps_t), intent(in) :: maps
      type(kind_t), intent(in) :: kind
      integer, intent(in) :: j, fewest
      real(sp), intent(inout) :: row(:)
      integer :: i, first, last

      first = maps%layer(kind%quantity)%classes + 1
      last = first + n_classes(kind%quantity) - 1
      do i = 1, size(row)
         if (maps%column(i, j) == 0) cycle
         associate (counts => maps%class_counts(first:last, maps%column(i, j)))
            if (sum(int(counts, i8)) >= fewest) row(i) = real(class_quantile(kind%quantity, counts, kind%share), sp)
         end associate
      end do
   end subroutine quantile_row

   !> A limit of the 95 % interval of the share k/n (Wilson 1927, doi:10.1080/01621459.1927.10502953).
   elemental real(wp) function share_limit(k, n, side)
      integer(i4), intent(in) :: k
      integer(i8), intent(in) :: n
      integer, intent(in) :: side  !! -1 lower, 1 upper
      real(wp) :: share, all

      all = real(n, wp)
      share = k/all
      share_limit = (share + z*z/(2*all) + side*z*sqrt(share*(1 - share)/all + (z/(2*all))**2))/(1 + z*z/all)
      if (k == 0 .and. side < 0) share_limit = 0
      if (k == n .and. side > 0) share_limit = 1
   end function share_limit
end module rockfall_mapvalues
