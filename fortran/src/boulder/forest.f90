! SPDX-License-Identifier: BSD-3-Clause
!> Trees. Which stem a flight hits first, what energy the stem takes, and how far the boulder turns. In plan a stem is
!> a disc and the boulder another, so the boulder's centre meets a disc whose radius is the sum of both.
module rockfall_forest
   use rockfall_kinds, only: wp, i8
   use rockfall_math, only: degree, exponential, logarithm, sine_cosine
   use rockfall_random, only: uniform, side_of, words_per_block, tree_class_word, tree_within_word
   use rockfall_flight, only: span_t
   implicit none
   private
   public :: forest_t, stem_t, tree_law_t, tree_hit_t, tree_impact_t, build_forest, first_hit, tree_impact
   public :: max_stem_energy, energy_share, hit_type, frontal, lateral, scratch, class_ends

   !> Types of a hit, by where on the stem the boulder touches it.
   integer, parameter :: frontal = 1, lateral = 2, scratch = 3
   !> The classes of the turn lie between these angles [degree].
   real(wp), parameter :: class_ends(0:3) = [0.0_wp, 22.5_wp, 67.5_wp, 76.0_wp]

   real(wp), parameter :: radius_per_dbh = 0.005_wp  !! [m/cm]
   !> A flight that starts this near to the edge of a disc, as a part of its squared radius, starts inside: at the stem
   !> that it has just hit only rounding says on which side it is [-].
   real(wp), parameter :: on_edge = 1.0e-6_wp
   !> A hit this near to the middle of a stem, as a part of the radius, has no side: only rounding says which [-].
   real(wp), parameter :: in_the_middle = 1.0e-9_wp
   real(wp), parameter :: along_rows = 1.0e-9_wp  !! a heading that changes no row of buckets [-]
   real(wp), parameter :: min_side = 5.0_wp       !! of a bucket [m]: the room of a tree or two
   integer, parameter :: buckets_per_stem = 2     !! about, at most

   type :: stem_t
      real(wp) :: x = 0.0_wp, y = 0.0_wp          !! its axis, local coordinates [m]
      real(wp) :: radius = 0.0_wp                 !! at breast height [m]
      real(wp) :: max_energy = 0.0_wp             !! that it can take, hit in the middle [J]
   end type stem_t

   !> What is the same for all stems.
   type :: tree_law_t
      real(wp) :: stem_height = huge(1.0_wp)      !! boulders that are higher pass over it [m]
      real(wp) :: limit(2) = [0.58_wp, 0.75_wp]   !! of x: from here on a hit is lateral, and a scratch [-]
      !> How often each class of the turn follows each type of hit (class, type), in any unit. As the widths of the
      !> classes are, every angle up to 76 degrees is as likely as any other.
      real(wp) :: weight(3, 3) = spread(class_ends(1:3) - class_ends(0:2), 2, 3)
   end type tree_law_t

   !> Stems by the buckets of a grid: bucket (i, j) = (0.., 0..) has stem(first(k):first(k + 1) - 1), k = 1 + i + nx*j.
   type :: forest_t
      type(tree_law_t) :: law
      type(stem_t), allocatable :: stem(:)
      integer, allocatable :: first(:)
      integer :: nx = 0, ny = 0                   !! buckets
      real(wp) :: low(2) = 0.0_wp                 !! south-western corner [m]
      real(wp) :: side = min_side                 !! of a bucket [m]
      real(wp) :: max_radius = 0.0_wp             !! of a stem [m]
   end type forest_t

   !> Where a flight hits a stem.
   type :: tree_hit_t
      integer :: tree = 0                         !! its number in the forest; 0: none is hit
      real(wp) :: time = 0.0_wp                   !! since the start of the flight [s]
      real(wp) :: offset = 0.0_wp                 !! of the stem's axis from the path, > 0: to the left [m]
      real(wp) :: height = 0.0_wp                 !! of the boulder's point above the ground [m]
   end type tree_hit_t

   !> What a hit does to a boulder.
   type :: tree_impact_t
      real(wp) :: taken = 0.0_wp                  !! energy that the stem takes [J]
      real(wp) :: sine = 0.0_wp, cosine = 1.0_wp  !! of the turn in plan, > 0: to the left [-]
      logical :: breaks = .false.                 !! the stem: later flights of this boulder do not hit it
   end type tree_impact_t

contains

   !> A forest; the diameters say how thick stems are, the factors how tough, beside silver fir. No function: its result
   !> would be there twice for a moment.
   pure subroutine build_forest(x, y, origin, dbh, factor, law, this)
      real(wp), intent(in) :: x(:), y(:)  !! map coordinates, one stem at least [m]
      real(wp), intent(in) :: origin(2)   !! of local coordinates [m]
      real(wp), intent(in) :: dbh(:)      !! diameters at breast height, > 0 [cm]
      real(wp), intent(in) :: factor(:)   !! [-]
      type(tree_law_t), intent(in) :: law
      type(forest_t), intent(out) :: this
      integer, allocatable :: next(:)
      real(wp) :: across(2)
      integer :: k, b

      this%law = law
      this%low = [minval(x), minval(y)] - origin
      across = [maxval(x), maxval(y)] - origin - this%low
      associate (buckets => real(buckets_per_stem, wp)*size(x))
         this%side = max(min_side, sqrt(across(1)*across(2)/buckets), maxval(across)/buckets)
      end associate
      this%nx = int(across(1)/this%side) + 1
      this%ny = int(across(2)/this%side) + 1
      this%max_radius = radius_per_dbh*maxval(dbh)
      allocate (this%stem(size(x)), this%first(this%nx*this%ny + 1), next(this%nx*this%ny))
      next = 0
      do k = 1, size(x)
         b = bucket(this, x(k) - origin(1), y(k) - origin(2))
         next(b) = next(b) + 1
      end do
      this%first(1) = 1
      do b = 1, size(next)
         this%first(b + 1) = this%first(b) + next(b)
         next(b) = this%first(b)
      end do
      do k = 1, size(x)
         b = bucket(this, x(k) - origin(1), y(k) - origin(2))
         this%stem(next(b)) = stem_t(x(k) - origin(1), y(k) - origin(2), radius_per_dbh*dbh(k), &
                                     factor(k)*max_stem_energy(dbh(k)))
         next(b) = next(b) + 1
      end do
   end subroutine build_forest

   !> The bucket of a place within the grid.
   pure integer function bucket(this, x, y)
      type(forest_t), intent(in) :: this
      real(wp), intent(in) :: x, y  !! [m]

      bucket = 1 + strip(this, 1, x) + this%nx*strip(this, 2, y)
   end function bucket

   !> The column (axis 1) or row (axis 2) of buckets of a coordinate, from 0; beyond the grid the nearest.
   pure integer function strip(this, axis, coordinate)
      type(forest_t), intent(in) :: this
      integer, intent(in) :: axis
      real(wp), intent(in) :: coordinate  !! [m]

      associate (last => merge(this%nx, this%ny, axis == 1) - 1.0_wp)
         strip = int(max(0.0_wp, min(last, (coordinate - this%low(axis))/this%side)))
      end associate
   end function strip

   !> The greatest energy [J] that a stem of silver fir can take, hit in the middle
   !> (Dorren and Berger 2006, doi:10.1093/treephys/26.1.63): 38.7 DBH**2.31, DBH in cm.
   elemental real(wp) function max_stem_energy(dbh)
      real(wp), intent(in) :: dbh  !! > 0 [cm]

      max_stem_energy = 38.7_wp*exponential(2.31_wp*logarithm(dbh))
   end function max_stem_energy

   !> The share of that energy that it can take when the boulder touches it beside the middle (Dorren and Berger 2006).
   elemental real(wp) function energy_share(x)
      real(wp), intent(in) :: x  !! from the middle of the stem (0) to its side (1) [-]
      real(wp), parameter :: ln10 = 2.30258509299404568402_wp

      energy_share = max(0.0_wp, -0.046_wp + 1.026_wp/(1 + exponential(-8.007_wp*(0.58_wp - x)*ln10)))
   end function energy_share

   !> The first stem whose disc the straight plan path of a flight enters from outside, below the stem's height. A stem
   !> in whose disc the path starts is not hit: so the one just hit is not, until the boulder has left its disc.
   !>
   !> Row by row of buckets, in the order in which the path comes near to them: of each those columns that lie within
   !> reach of the path while the row does, which follow each other in `stem`.
   pure subroutine first_hit(this, spans, x, y, v, radius, broken, hit)
      type(forest_t), intent(in) :: this
      type(span_t), intent(in), contiguous :: spans(:)    !! of the flight
      real(wp), intent(in) :: x, y            !! its start [m]
      real(wp), intent(in) :: v(2)            !! plan velocity [m/s]
      real(wp), intent(in) :: radius          !! of the boulder [m]
      integer, intent(in) :: broken(:)        !! stems that it does not hit
      type(tree_hit_t), intent(out) :: hit
      real(wp) :: speed, heading(2), length, reach, near, from, to
      integer :: step, row, left, right, k

      speed = sqrt(v(1)*v(1) + v(2)*v(2))
      if (.not. speed > 0) return
      heading = v/speed
      length = speed*spans(size(spans))%t1    ! from here on to the first hit [m]
      reach = (radius + this%max_radius)*(1 + on_edge)
      step = merge(1, -1, heading(2) > 0)
      do row = strip(this, 2, y - step*reach), strip(this, 2, y + heading(2)*length + step*reach), step
         near = this%low(2) + (row + (1 - step)/2)*this%side - step*reach - y
         from = 0
         to = length
         if (abs(heading(2)) > along_rows) then
            from = max(from, near/heading(2))
            to = min(to, (near + step*(this%side + 2*reach))/heading(2))
         end if
         if (from > length) exit
         if (to < 0) cycle
         left = strip(this, 1, x + min(heading(1)*from, heading(1)*to) - reach)
         right = strip(this, 1, x + max(heading(1)*from, heading(1)*to) + reach)
         do k = this%first(1 + left + this%nx*row), this%first(2 + right + this%nx*row) - 1
            call meet(this%stem(k), k, this%law%stem_height, spans, x, y, heading, speed, radius, broken, length, hit)
         end do
      end do
   end subroutine first_hit

   !> Take a stem for the first that is hit, if it is nearer than `length`. Of the two places at which the path crosses
   !> the disc, s**2 - 2 along s + d**2 - r**2 = 0, the nearer by the form without cancellation.
   pure subroutine meet(stem, number, stem_height, spans, x, y, heading, speed, radius, broken, length, hit)
      type(stem_t), intent(in) :: stem
      integer, intent(in) :: number
      real(wp), intent(in) :: stem_height     !! [m]
      type(span_t), intent(in), contiguous :: spans(:)
      real(wp), intent(in) :: x, y            !! start of the flight [m]
      real(wp), intent(in) :: heading(2)      !! unit [-]
      real(wp), intent(in) :: speed, radius   !! in plan [m/s]; of the boulder [m]
      integer, intent(in) :: broken(:)
      real(wp), intent(inout) :: length       !! of the path to the first hit [m]
      type(tree_hit_t), intent(inout) :: hit
      real(wp) :: d(2), along, across, r2, d2, s, above

      d = [stem%x - x, stem%y - y]
      along = d(1)*heading(1) + d(2)*heading(2)
      across = heading(1)*d(2) - heading(2)*d(1)
      r2 = (radius + stem%radius)**2
      if (across*across >= r2 .or. along <= 0) return
      d2 = d(1)*d(1) + d(2)*d(2)
      if (d2 <= r2*(1 + on_edge)) return
      s = (d2 - r2)/(along + sqrt(r2 - across*across))
      if (s >= length) return
      above = height_in(spans, s/speed)
      if (above >= stem_height .or. any(broken == number)) return
      length = s
      hit = tree_hit_t(number, s/speed, across, above)
   end subroutine meet

   !> Height above the ground at a time of a flight [m].
   pure real(wp) function height_in(spans, time) result(height)
      type(span_t), intent(in), contiguous :: spans(:)
      real(wp), intent(in) :: time  !! since its start [s]
      integer :: k

      do k = 1, size(spans) - 1
         if (time <= spans(k)%t1) exit
      end do
      associate (span => spans(k), s => time - spans(k)%t0)
         height = max(0.0_wp, span%d0 + s*(span%d1 + s*span%d2))
      end associate
   end function height_in

   !> What a hit takes from a boulder, and where it turns: away from the stem.
   !>
   !> Two discs touch on the line between their centres, so the boulder touches the stem at x = offset/(R_b + DBH/2) of
   !> the stem's radius beside its middle. A frontal hit after which the boulder flies on breaks the stem.
   pure type(tree_impact_t) function tree_impact(law, stem, offset, radius, energy, word) result(impact)
      type(tree_law_t), intent(in) :: law
      type(stem_t), intent(in) :: stem
      real(wp), intent(in) :: offset          !! of its axis from the path, > 0: to the left [m]
      real(wp), intent(in) :: radius          !! of the boulder [m]
      real(wp), intent(in) :: energy          !! of the boulder, translational and rotational, > 0 [J]
      integer(i8), intent(in) :: word(words_per_block)  !! random, for_tree
      real(wp) :: x, side, s, c
      integer :: type

      x = abs(offset)/(radius + stem%radius)
      type = hit_type(law, x)
      impact%taken = min(energy, energy_share(x)*stem%max_energy)
      impact%breaks = type == frontal .and. impact%taken < energy
      side = -sign(1.0_wp, offset)
      if (x < in_the_middle) side = side_of(word(tree_within_word))
      call sine_cosine(turn_angle(law%weight(:, type), uniform(word(tree_class_word)), &
                                  uniform(word(tree_within_word)))/2, s, c)
      impact%sine = side*2*s*c
      impact%cosine = 1 - 2*s*s
   end function tree_impact

   !> frontal, lateral or scratch.
   pure integer function hit_type(law, x)
      type(tree_law_t), intent(in) :: law
      real(wp), intent(in) :: x  !! as in energy_share [-]

      hit_type = frontal + count(x >= law%limit)
   end function hit_type

   !> The angle of a turn [rad]: its class by the weights, uniform inside the class.
   pure real(wp) function turn_angle(weight, class, within)
      real(wp), intent(in) :: weight(3)      !! of the classes, one at least > 0 [any unit]
      real(wp), intent(in) :: class, within  !! uniform in (0, 1) [-]
      integer :: k

      k = 1 + count(class*sum(weight) >= [weight(1), weight(1) + weight(2)])
      turn_angle = (class_ends(k - 1) + within*(class_ends(k) - class_ends(k - 1)))*degree
   end function turn_angle
end module rockfall_forest
