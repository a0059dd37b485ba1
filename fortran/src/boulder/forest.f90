! SPDX-License-Identifier: BSD-3-Clause
!> Tree hits: the first stem hit by a flight, the energy that it absorbs, and the turn of the boulder. In plan, stem and
!> boulder are discs: a hit occurs when the boulder's centre enters a disc around the stem with the sum of both radii.
module rockfall_forest
   use rockfall_kinds, only: wp, i8
   use rockfall_math, only: degree, exponential, logarithm, sine_cosine
   use rockfall_random, only: uniform, side_of, words_per_block, tree_class_word, tree_within_word
   use rockfall_flight, only: span_t
   implicit none
   private
   public :: forest_t, stem_t, tree_model_t, tree_hit_t, tree_impact_t, build_forest, may_hit_tree, find_first_hit, &
             tree_impact
   public :: max_stem_energy, absorbed_fraction, hit_type, frontal, lateral, scratch, class_ends

   !> Types of a hit, by how far from the stem axis the path of the boulder's centre passes.
   integer, parameter :: frontal = 1, lateral = 2, scratch = 3
   !> Class limits of the turn [degree].
   real(wp), parameter :: class_ends(0:3) = [0.0_wp, 22.5_wp, 67.5_wp, 76.0_wp]

   real(wp), parameter :: radius_per_dbh = 0.005_wp  !! [m/cm]
   !> Relative squared distance from the edge of a disc within which a flight counts as starting
   !> inside [-]. At the stem just hit, rounding errors would otherwise decide.
   real(wp), parameter :: on_edge = 1.0e-6_wp
   !> Offset from a stem's axis, over its radius, below which a hit has no side: only rounding would decide [-].
   real(wp), parameter :: centred_offset = 1.0e-9_wp
   real(wp), parameter :: along_rows = 1.0e-9_wp  !! heading component below which the row of buckets never changes [-]
   real(wp), parameter :: min_side = 5.0_wp       !! minimum size of a bucket [m], for one or two trees
   integer, parameter :: buckets_per_stem = 2     !! approximate maximum number of buckets per stem

   type :: stem_t
      real(wp) :: x = 0.0_wp, y = 0.0_wp          !! axis, local coordinates [m]
      real(wp) :: radius = 0.0_wp                 !! radius at breast height [m]
      real(wp) :: max_energy = 0.0_wp             !! maximum energy absorbed in a central hit [J]
   end type stem_t

   !> Parameters common to all stems.
   type :: tree_model_t
      real(wp) :: stem_height = huge(1.0_wp)      !! boulders higher than this pass over the stem [m]
      real(wp) :: limit(2) = [0.58_wp, 0.75_wp]  !! limits between the types of a hit, for x of absorbed_fraction [-]
      !> Frequency of each class of the turn by type of hit (class, type), in any unit. The default, the widths of the
      !> classes, makes all angles up to 76 degrees equally likely.
      real(wp) :: weight(3, 3) = spread(class_ends(1:3) - class_ends(0:2), 2, 3)
   end type tree_model_t

   !> Stems in buckets: bucket (i, j), from (0, 0), contains stem(first(k):first(k + 1) - 1), k = 1 + i + nx*j.
   type :: forest_t
      type(tree_model_t) :: model
      type(stem_t), allocatable :: stem(:)
      integer, allocatable :: first(:)
      integer :: nx = 0, ny = 0                   !! buckets
      real(wp) :: low(2) = 0.0_wp                 !! south-western corner [m]
      real(wp) :: side = min_side                 !! side length of a bucket [m]
      real(wp) :: per_side = 1/min_side           !! [1/m]
      real(wp) :: max_radius = 0.0_wp             !! maximum radius of a stem [m]
   end type forest_t

   !> Hit of a stem by a flight.
   type :: tree_hit_t
      integer :: tree = 0                         !! index in the forest; 0: no hit
      real(wp) :: time = 0.0_wp                   !! time since the start of the flight [s]
      real(wp) :: offset = 0.0_wp                 !! offset of the stem's axis from the path, > 0: to the left [m]
      real(wp) :: height = 0.0_wp                 !! height of the contact point above the ground [m]
   end type tree_hit_t

   !> Effect of a hit on a boulder.
   type :: tree_impact_t
      real(wp) :: absorbed = 0.0_wp               !! energy absorbed by the stem [J]
      real(wp) :: sine = 0.0_wp, cosine = 1.0_wp  !! sine and cosine of the turn in plan, > 0: to the left [-]
      logical :: breaks = .false.                 !! the stem breaks: later flights of this boulder ignore it
   end type tree_impact_t

contains

   !> Build a forest. A subroutine, to avoid a temporary copy of the result.
   pure subroutine build_forest(x, y, origin, dbh, factor, model, this)
      real(wp), intent(in) :: x(:), y(:)  !! map coordinates, at least one stem [m]
      real(wp), intent(in) :: origin(2)   !! origin of local coordinates [m]
      real(wp), intent(in) :: dbh(:)      !! diameters at breast height, > 0 [cm]
      real(wp), intent(in) :: factor(:)   !! strength of each stem relative to silver fir [-]
      type(tree_model_t), intent(in) :: model
      type(forest_t), intent(out) :: this
      integer, allocatable :: next(:)
      real(wp) :: across(2)
      integer :: k, b

      this%model = model
      this%low = [minval(x), minval(y)] - origin
      across = [maxval(x), maxval(y)] - origin - this%low
      associate (buckets => real(buckets_per_stem, wp)*size(x))
         this%side = max(min_side, sqrt(across(1)*across(2)/buckets), maxval(across)/buckets)
      end associate
      this%per_side = 1/this%side
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

   !> Bucket of a point within the grid.
   pure integer function bucket(this, x, y)
      type(forest_t), intent(in) :: this
      real(wp), intent(in) :: x, y  !! [m]

      bucket = 1 + bucket_index(this, 1, x) + this%nx*bucket_index(this, 2, y)
   end function bucket

   !> Column (axis 1) or row (axis 2), from 0, of the bucket that contains a coordinate; clamped to the grid.
   pure integer function bucket_index(this, axis, coordinate)
      type(forest_t), intent(in) :: this
      integer, intent(in) :: axis
      real(wp), intent(in) :: coordinate  !! [m]

      associate (last => merge(this%nx, this%ny, axis == 1) - 1.0_wp)
         bucket_index = int(max(0.0_wp, min(last, (coordinate - this%low(axis))*this%per_side)))
      end associate
   end function bucket_index

   !> Maximum energy [J] absorbed by a stem of silver fir in a central hit
   !> (Dorren and Berger 2006, doi:10.1093/treephys/26.1.63): 38.7 DBH**2.31, DBH in cm.
   elemental real(wp) function max_stem_energy(dbh)
      real(wp), intent(in) :: dbh  !! > 0 [cm]

      max_stem_energy = 38.7_wp*exponential(2.31_wp*logarithm(dbh))
   end function max_stem_energy

   !> Fraction of the maximum energy that a stem absorbs in an off-centre hit (Dorren and Berger 2006).
   elemental real(wp) function absorbed_fraction(x)
      real(wp), intent(in) :: x  !! position of the path, from the middle of the stem (0) to its side (1) [-]
      real(wp), parameter :: ln10 = 2.30258509299404568402_wp

      absorbed_fraction = max(0.0_wp, -0.046_wp + 1.026_wp/(1 + exponential(-8.007_wp*(0.58_wp - x)*ln10)))
   end function absorbed_fraction

   !> Return whether the plan path of a flight may enter the disc of a stem from outside. True for all flights for which
   !> find_first_hit finds a stem, and for few others; the test needs no roots or divisions.
   pure logical function may_hit_tree(this, x, y, path, radius)
      type(forest_t), intent(in) :: this
      real(wp), intent(in) :: x, y            !! start of the flight [m]
      real(wp), intent(in) :: path(2)         !! path from the start to the end, in plan [m]
      real(wp), intent(in) :: radius          !! R_b [m]
      real(wp) :: reach, length2, d(2), along, across, beyond, r2, d2, within, hits
      integer :: left, right, row, k

      reach = (radius + this%max_radius)*(1 + on_edge)
      left = bucket_index(this, 1, x + min(0.0_wp, path(1)) - reach)
      right = bucket_index(this, 1, x + max(0.0_wp, path(1)) + reach)
      length2 = path(1)*path(1) + path(2)*path(2)
      hits = 0
      do row = bucket_index(this, 2, y + min(0.0_wp, path(2)) - reach), &
               bucket_index(this, 2, y + max(0.0_wp, path(2)) + reach)
         do k = this%first(1 + left + this%nx*row), this%first(2 + right + this%nx*row) - 1
            d = [this%stem(k)%x - x, this%stem(k)%y - y]
            along = d(1)*path(1) + d(2)*path(2)         ! these three distances are multiplied by the length of the path
            across = path(1)*d(2) - path(2)*d(1)
            beyond = max(0.0_wp, along - length2)
            r2 = (radius + this%stem(k)%radius)**2
            d2 = d(1)*d(1) + d(2)*d(2)
            within = merge(1.0_wp, 0.0_wp, max(across*across, beyond*beyond) < r2*length2*(1 + on_edge))
            within = merge(within, 0.0_wp, along > 0)
            within = merge(within, 0.0_wp, d2 > r2*(1 + on_edge))
            hits = max(hits, within)
         end do
      end do
      may_hit_tree = hits > 0
   end function may_hit_tree

   !> Find the first stem whose disc the straight plan path of a flight enters from outside, below the stem's height.
   !> Stems whose disc contains the start are ignored, so the stem just hit is ignored until the boulder has left it.
   !>
   !> Rows of buckets are searched in the order in which the path approaches them. The columns within reach of the path
   !> in each row are contiguous in `stem`.
   pure subroutine find_first_hit(this, spans, x, y, v, radius, broken, hit)
      type(forest_t), intent(in) :: this
      type(span_t), intent(in), contiguous :: spans(:)
      real(wp), intent(in) :: x, y            !! start of the flight [m]
      real(wp), intent(in) :: v(2)            !! plan velocity [m/s]
      real(wp), intent(in) :: radius          !! R_b [m]
      integer, intent(in) :: broken(:)        !! stems to ignore
      type(tree_hit_t), intent(out) :: hit
      real(wp) :: speed, heading(2), length, reach, near, from, to
      integer :: step, row, left, right, k

      speed = sqrt(v(1)*v(1) + v(2)*v(2))
      if (.not. speed > 0) return
      heading = v/speed
      length = speed*spans(size(spans))%t1    ! length of the path up to the first hit [m]
      reach = (radius + this%max_radius)*(1 + on_edge)
      step = merge(1, -1, heading(2) > 0)
      do row = bucket_index(this, 2, y - step*reach), bucket_index(this, 2, y + heading(2)*length + step*reach), step
         near = this%low(2) + (row + (1 - step)/2)*this%side - step*reach - y
         from = 0
         to = length
         if (abs(heading(2)) > along_rows) then
            from = max(from, near/heading(2))
            to = min(to, (near + step*(this%side + 2*reach))/heading(2))
         end if
         if (from > length) exit
         if (to < 0) cycle
         left = bucket_index(this, 1, x + min(heading(1)*from, heading(1)*to) - reach)
         right = bucket_index(this, 1, x + max(heading(1)*from, heading(1)*to) + reach)
         do k = this%first(1 + left + this%nx*row), this%first(2 + right + this%nx*row) - 1
            call test_stem(this%stem(k), k, this%model%stem_height, spans, x, y, heading, speed, radius, broken, &
                           length, hit)
         end do
      end do
   end subroutine find_first_hit

   !> Record the hit of this stem if it is nearer than `length`. The path crosses the disc where
   !> s**2 - 2 along s + d**2 - r**2 = 0; the nearer root is computed in the form without cancellation.
   pure subroutine test_stem(stem, number, stem_height, spans, x, y, heading, speed, radius, broken, length, hit)
      type(stem_t), intent(in) :: stem
      integer, intent(in) :: number
      real(wp), intent(in) :: stem_height     !! [m]
      type(span_t), intent(in), contiguous :: spans(:)
      real(wp), intent(in) :: x, y            !! start of the flight [m]
      real(wp), intent(in) :: heading(2)      !! unit [-]
      real(wp), intent(in) :: speed, radius   !! speed in plan [m/s]; radius of the boulder [m]
      integer, intent(in) :: broken(:)
      real(wp), intent(inout) :: length       !! length of the path to the first hit [m]
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
      above = flight_height(spans, s/speed)
      if (above >= stem_height .or. any(broken == number)) return
      length = s
      hit = tree_hit_t(number, s/speed, across, above)
   end subroutine test_stem

   !> Height above the ground at a time of a flight [m].
   pure real(wp) function flight_height(spans, time) result(height)
      type(span_t), intent(in), contiguous :: spans(:)
      real(wp), intent(in) :: time  !! time since the start of the flight [s]
      integer :: k

      do k = 1, size(spans) - 1
         if (time <= spans(k)%t1) exit
      end do
      associate (span => spans(k), s => time - spans(k)%t0)
         height = max(0.0_wp, span%d0 + s*(span%d1 + s*span%d2))
      end associate
   end function flight_height

   !> Effect of a hit: absorbed energy, and turn of the boulder away from the stem.
   !>
   !> The distance of the path of the boulder's centre from the stem axis, x = |offset|/(DBH/2), determines the type of
   !> the hit. If only the boulder's side touches the stem, x > 1 counts as 1. A frontal hit that the boulder survives
   !> breaks the stem.
   pure type(tree_impact_t) function tree_impact(model, stem, offset, energy, word) result(impact)
      type(tree_model_t), intent(in) :: model
      type(stem_t), intent(in) :: stem
      real(wp), intent(in) :: offset          !! offset of the stem's axis from the path, > 0: to the left [m]
      real(wp), intent(in) :: energy          !! translational and rotational energy of the boulder, > 0 [J]
      integer(i8), intent(in) :: word(words_per_block)  !! random words, for_tree
      real(wp) :: x, side, s, c
      integer :: type

      x = min(1.0_wp, abs(offset)/stem%radius)
      type = hit_type(model, x)
      impact%absorbed = min(energy, absorbed_fraction(x)*stem%max_energy)
      impact%breaks = type == frontal .and. impact%absorbed < energy
      side = -sign(1.0_wp, offset)
      if (x < centred_offset) side = side_of(word(tree_within_word))
      call sine_cosine(tree_turn_angle(model%weight(:, type), uniform(word(tree_class_word)), &
                                       uniform(word(tree_within_word)))/2, s, c)
      impact%sine = side*2*s*c
      impact%cosine = 1 - 2*s*s
   end function tree_impact

   !> Type of a hit: frontal, lateral or scratch.
   pure integer function hit_type(model, x)
      type(tree_model_t), intent(in) :: model
      real(wp), intent(in) :: x  !! as in absorbed_fraction [-]

      hit_type = frontal + count(x >= model%limit)
   end function hit_type

   !> Angle of a turn [rad]: the class is drawn by the weights, the angle uniformly within the class.
   pure real(wp) function tree_turn_angle(weight, class, within)
      real(wp), intent(in) :: weight(3)      !! weights of the classes, at least one > 0 [any unit]
      real(wp), intent(in) :: class, within  !! uniform in (0, 1) [-]
      integer :: k

      k = 1 + count(class*sum(weight) >= [weight(1), weight(1) + weight(2)])
      tree_turn_angle = (class_ends(k - 1) + within*(class_ends(k) - class_ends(k - 1)))*degree
   end function tree_turn_angle
end module rockfall_forest
