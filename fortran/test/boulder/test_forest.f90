! SPDX-License-Identifier: BSD-3-Clause
!> Trees: energies computed with 30 digits; all hits are found, and no others.
program test_forest
   use rockfall_kinds, only: wp, i8
   use rockfall_math, only: degree
   use rockfall_random, only: random_key, random_words, for_tree
   use rockfall_flight, only: span_t
   use rockfall_forest, only: forest_t, stem_t, tree_model_t, tree_hit_t, tree_impact_t, build_forest, may_hit_tree, &
                              find_first_hit, tree_impact, max_stem_energy, absorbed_fraction, hit_type, frontal, &
                              lateral, scratch
   use check_m, only: check, check_close, finish
   implicit none

   integer, parameter :: none(0) = [integer ::]
   real(wp), parameter :: origin(2) = 0.0_wp
   type(stem_t), parameter :: thin = stem_t(0.0_wp, 0.0_wp, 0.2_wp, 1.0_wp)

   call random_init(.true., .false.)
   call test_energy()
   call test_share()
   call test_entering()
   call test_start_inside()
   call test_passing_over()
   call test_broken()
   call test_large_discs()
   call test_all_are_found()
   call test_symmetry()
   call test_spacing()
   call test_taken()
   call test_turns()
   call test_sides()
   call finish()

contains

   !> The energy [J] that a stem can absorb is 38.7 DBH**2.31, with the DBH in cm.
   subroutine test_energy()
      call check_close("10 cm", max_stem_energy(10.0_wp), 7901.52584587107851_wp, 1.0e-14_wp)
      call check_close("30 cm", max_stem_energy(30.0_wp), 99968.0137871888292_wp, 1.0e-14_wp)
      call check_close("80 cm", max_stem_energy(80.0_wp), 963493.601702790811_wp, 1.0e-14_wp)
   end subroutine test_energy

   !> Forest of given stems.
   pure type(forest_t) function forest(x, y, at, dbh, factor, law) result(this)
      real(wp), intent(in) :: x(:), y(:), at(2), dbh(:), factor(:)  !! as in build_forest
      type(tree_model_t), intent(in) :: law

      call build_forest(x, y, at, dbh, factor, law, this)
   end function forest

   subroutine test_share()
      call check_close("in the middle", absorbed_fraction(0.0_wp), 0.979976714932332450_wp, 1.0e-14_wp)
      call check_close("beside it", absorbed_fraction(0.3_wp), 0.974156048421733373_wp, 1.0e-14_wp)
      call check_close("half", absorbed_fraction(0.58_wp), 0.467_wp, 1.0e-14_wp)
      call check_close("little", absorbed_fraction(0.7_wp), 0.0552057359667322585_wp, 1.0e-12_wp)
      call check("nothing at the side", abs(absorbed_fraction(0.746_wp)) + abs(absorbed_fraction(1.0_wp)) <= 0)
   end subroutine test_share

   !> Flight of two spans at a constant height above the ground.
   pure function flown(time, height) result(spans)
      real(wp), intent(in) :: time, height  !! [s], [m]
      type(span_t) :: spans(2)

      spans%t0 = [0.0_wp, 0.3_wp*time]
      spans%t1 = [0.3_wp*time, time]
      spans%d0 = height
      spans%d1 = 0
      spans%d2 = 0
   end function flown

   !> Flight of 10 s, 1 m above the ground.
   pure function level() result(spans)
      type(span_t) :: spans(2)

      spans = flown(10.0_wp, 1.0_wp)
   end function level

   !> First hit of a flight from (0, 0) that lasts 10 s at 2 m/s along x.
   pure type(tree_hit_t) function hit_of(this, radius)
      type(forest_t), intent(in) :: this
      real(wp), intent(in) :: radius  !! [m]

      call find_first_hit(this, level(), 0.0_wp, 0.0_wp, [2.0_wp, 0.0_wp], radius, none, hit_of)
   end function hit_of

   !> Forest of one stem of 40 cm DBH.
   pure type(forest_t) function one_stem(x, y) result(this)
      real(wp), intent(in) :: x, y  !! [m]

      this = forest([x], [y], origin, [40.0_wp], [1.0_wp], tree_model_t())
   end function one_stem

   subroutine test_entering()
      type(tree_hit_t) :: hit

      hit = hit_of(one_stem(5.0_wp, 0.0_wp), 0.5_wp)
      call check("a stem on the path is hit", hit%tree == 1)
      call check_close("where the discs touch", hit%time, (5.0_wp - 0.7_wp)/2, 1.0e-15_wp)
      call check("in the middle", abs(hit%offset) <= 0)
      hit = hit_of(one_stem(5.0_wp, 0.42_wp), 0.5_wp)
      call check_close("left of it, later", hit%time, (5.0_wp - sqrt(0.7_wp**2 - 0.42_wp**2))/2, 1.0e-14_wp)
      call check_close("left is above zero", hit%offset, 0.42_wp, 1.0e-15_wp)
      hit = hit_of(one_stem(5.0_wp, -0.42_wp), 0.5_wp)
      call check_close("right is below", hit%offset, -0.42_wp, 1.0e-15_wp)
      hit = hit_of(one_stem(5.0_wp, 0.7_wp), 0.5_wp)
      call check("a tangent is no hit", hit%tree == 0)
      hit = hit_of(one_stem(5.0_wp, 0.7_wp - 1.0e-9_wp), 0.5_wp)
      call check("a nanometre nearer is one", hit%tree == 1)
      hit = hit_of(one_stem(-5.0_wp, 0.0_wp), 0.5_wp)
      call check("not what lies behind", hit%tree == 0)
      hit = hit_of(one_stem(20.7_wp + 1.0e-9_wp, 0.0_wp), 0.5_wp)
      call check("nor beyond the landing", hit%tree == 0)
      hit = hit_of(one_stem(20.7_wp - 1.0e-9_wp, 0.0_wp), 0.5_wp)
      call check("but up to there", hit%tree == 1)
      call find_first_hit(one_stem(0.1_wp, 1.0_wp), level(), 0.0_wp, 0.0_wp, [0.0_wp, 0.0_wp], 0.5_wp, none, hit)
      call check("a vertical flight hits nothing", hit%tree == 0)
      call find_first_hit(one_stem(0.1_wp, 1.0_wp), level(), 0.0_wp, 0.0_wp, [0.0_wp, 1.0e-300_wp], 0.5_wp, none, &
                          hit)
      call check("nor one that is nearly so", hit%tree == 0)
   end subroutine test_entering

   !> A flight that starts in a disc, or on its edge as after a hit, does not hit this stem; it may after leaving it.
   subroutine test_start_inside()
      type(tree_hit_t) :: hit, again
      real(wp) :: x, y, angle
      integer :: k, wrong

      hit = hit_of(one_stem(0.6_wp, 0.1_wp), 0.5_wp)
      call check("started inside", hit%tree == 0)
      wrong = 0
      do k = 0, 359  ! from the point of a hit, far from the origin, in all directions
         hit = hit_of(one_stem(5.0_wp, 0.3_wp), 0.5_wp)
         x = 2*hit%time
         y = 0
         angle = k*degree
         call find_first_hit(one_stem(5.0_wp, 0.3_wp), level(), x, y, [cos(angle), sin(angle)], 0.5_wp, none, again)
         wrong = wrong + again%tree
         x = x + 1.0e5_wp
         y = y + 1.0e5_wp
         call find_first_hit(one_stem(100005.0_wp, 100000.3_wp), level(), x, y, [cos(angle), sin(angle)], 0.5_wp, &
                             none, again)
         wrong = wrong + again%tree
      end do
      call check("not twice from the same place", wrong == 0)
      call find_first_hit(one_stem(5.0_wp, 0.3_wp), level(), 4.0_wp, 0.3_wp, [1.0_wp, 0.0_wp], 0.5_wp, none, again)
      call check("but once it was left", again%tree == 1)
   end subroutine test_start_inside

   !> The height at the point where the boulder touches the stem decides whether it passes over.
   subroutine test_passing_over()
      type(tree_model_t) :: law
      type(tree_hit_t) :: hit
      type(span_t) :: rising(2)

      law%stem_height = 15
      rising = flown(10.0_wp, 0.0_wp)
      rising(1)%d1 = 2   ! rises to 6 m in 3 s (6 m along the path), then at 3 m/s to 15 m in 3 s more (at 12 m)
      rising(2)%d0 = 6
      rising(2)%d1 = 3
      call find_first_hit(forest([12.69_wp], [0.0_wp], origin, [40.0_wp], [1.0_wp], law), rising, 0.0_wp, 0.0_wp, &
                          [2.0_wp, 0.0_wp], 0.5_wp, none, hit)
      call check("just below the top", hit%tree == 1)
      call check_close("the height of the hit", hit%height, 6 + 3*((12.69_wp - 0.7_wp)/2 - 3), 1.0e-13_wp)
      call find_first_hit(forest([12.71_wp, 16.0_wp], [0.0_wp, 0.0_wp], origin, [40.0_wp, 40.0_wp], [1.0_wp, 1.0_wp], &
                                 law), rising, 0.0_wp, 0.0_wp, [2.0_wp, 0.0_wp], 0.5_wp, none, hit)
      call check("over it, and over the next", hit%tree == 0)
   end subroutine test_passing_over

   subroutine test_broken()
      type(forest_t) :: this
      type(tree_hit_t) :: hit

      this = forest([5.0_wp, 9.0_wp], [0.0_wp, 0.0_wp], origin, [40.0_wp, 20.0_wp], [1.0_wp, 1.0_wp], tree_model_t())
      hit = hit_of(this, 0.5_wp)
      call check_close("the nearer first", hit%time, 4.3_wp/2, 1.0e-15_wp)
      call find_first_hit(this, level(), 0.0_wp, 0.0_wp, [2.0_wp, 0.0_wp], 0.5_wp, [hit%tree], hit)
      call check_close("then the one behind it", hit%time, 8.4_wp/2, 1.0e-15_wp)
   end subroutine test_broken

   !> Boulders and a stem that are larger than a bucket.
   subroutine test_large_discs()
      type(forest_t) :: this
      type(tree_hit_t) :: hit
      real(wp) :: x(400), y(400), dbh(400)

      call random_number(x)
      call random_number(y)
      x = 60*x + 30
      y = 60*y + 30
      dbh = 30
      dbh(77) = 1500
      this = forest(x, y, origin, dbh, spread(1.0_wp, 1, 400), tree_model_t())
      call check("buckets are small", this%side < 6)
      call compare(this, 0.0_wp, 45.0_wp, [1.0_wp, 0.1_wp], 20.0_wp, 150.0_wp, hit)
      call check("one is hit", hit%tree > 0)
      call compare(this, 60.0_wp, 200.0_wp, [-0.1_wp, -5.0_wp], 9.0_wp, 50.0_wp, hit)
      call check("from above, too", hit%tree > 0)
   end subroutine test_large_discs

   !> The grid finds the same hits as a search of all stems.
   subroutine test_all_are_found()
      integer, parameter :: n = 600
      type(forest_t) :: this
      type(tree_hit_t) :: hit
      real(wp) :: x(n), y(n), u(6)
      integer :: k, scene, hits, suspected

      hits = 0
      suspected = 0
      do scene = 1, 20
         call random_number(x)
         call random_number(y)
         x = 10.0_wp**mod(scene, 4)*x  ! extents from 1 m to 1 km in each direction
         y = 10.0_wp**mod(scene/4, 4)*y
         if (scene == 9) y = 3
         if (scene > 15) x = 5*nint(x/5)  ! on the edges of buckets
         if (scene > 15) y = 5*nint(y/5)
         this = forest(x, y, [-1.0_wp, 2.0_wp], 5 + 50*x/(1 + maxval(x)), spread(1.0_wp, 1, n), tree_model_t())
         do k = 1, 500
            call random_number(u)
            u(1:2) = (1.4_wp*u(1:2) - 0.2_wp)*[maxval(x), maxval(y)] + [1.0_wp, -2.0_wp]
            u(3:4) = merge(20*u(3:4) - 10, real(nint(4*u(3:4) - 2), wp), mod(k, 2) == 0)
            call compare(this, u(1), u(2), u(3:4), 0.05_wp + 2*u(5)**4, &
                         50*u(6)**3, hit)
            hits = hits + min(1, hit%tree)
            suspected = suspected + merge(1, 0, may_hit_tree(this, u(1), u(2), 50*u(6)**3*u(3:4), 0.05_wp + 2*u(5)**4))
         end do
      end do
      call check("both happen", hits > 2000 .and. hits < 9000)
      call check("few are taken for hits that are none", suspected < hits + hits/10)
   end subroutine test_all_are_found

   !> Compare the first hit by the grid with that of a search of all stems.
   subroutine compare(this, x, y, v, radius, time, hit)
      type(forest_t), intent(in) :: this
      real(wp), intent(in) :: x, y, v(2), radius, time  !! [m], [m/s], [m], [s]
      type(tree_hit_t), intent(out) :: hit
      real(wp) :: d(2), d2, r, along, across, t, first
      integer :: k, number

      call find_first_hit(this, flown(time, 1.0_wp), x, y, v, radius, none, hit)
      first = time
      number = 0
      if (any(abs(v) > 0)) then
         do k = 1, size(this%stem)
            d = [this%stem(k)%x - x, this%stem(k)%y - y]
            r = radius + this%stem(k)%radius
            d2 = dot_product(d, d)
            along = dot_product(d, v)/norm2(v)
            across = (v(1)*d(2) - v(2)*d(1))/norm2(v)
            if (d2 <= r**2*(1 + 1.0e-6_wp) .or. abs(across) >= r*(1 - 1.0e-12_wp) .or. along <= 0) cycle
            t = (along - sqrt(r**2 - across**2))/norm2(v)
            if (t >= first) cycle
            first = t
            number = k
         end do
      end if
      call check("suspected", hit%tree == 0 .or. may_hit_tree(this, x, y, time*v, radius))
      if (hit%tree == 0 .or. number == 0) then
         call check("hit or not", hit%tree == number)
      else
         call check_close("the same time", hit%time, first, 1.0e-7_wp)
      end if
   end subroutine compare

   !> A scene rotated by 90 degrees or mirrored has exactly the same hits.
   subroutine test_symmetry()
      integer, parameter :: n = 300
      type(forest_t) :: this, turned, mirrored
      type(tree_hit_t) :: hit(3)
      real(wp) :: x(n), y(n), dbh(n), one(n), u(6)
      real(wp), parameter :: at(2) = [0.0_wp, 0.0_wp]
      integer :: k, hits

      call random_number(x)
      call random_number(y)
      call random_number(dbh)
      x = 100*x - 50
      y = 100*y - 50
      one = 1
      this = forest(x, y, at, 60*dbh, one, tree_model_t())
      turned = forest(-y, x, at, 60*dbh, one, tree_model_t())
      mirrored = forest(-x, y, at, 60*dbh, one, tree_model_t())
      hits = 0
      do k = 1, 2000
         call random_number(u)
         u(1:4) = 2*u(1:4) - 1
         associate (spans => flown(8*u(5), 1.0_wp), p => 50*u(1:2), v => 10*u(3:4))
            call find_first_hit(this, spans, p(1), p(2), v, u(6), none, hit(1))
            call find_first_hit(turned, spans, -p(2), p(1), [-v(2), v(1)], u(6), none, hit(2))
            call find_first_hit(mirrored, spans, -p(1), p(2), [-v(1), v(2)], u(6), none, hit(3))
         end associate
         hits = hits + min(1, hit(1)%tree)
         call check("same time", all(abs(hit%time - hit(1)%time) <= 0))
         call check("same offset when turned", abs(hit(2)%offset - hit(1)%offset) <= 0)
         call check("the other side in the mirror", abs(hit(3)%offset + hit(1)%offset) <= 0)
      end do
      call check("many hits", hits > 500)
   end subroutine test_symmetry

   !> Along a line through a random forest, the mean distance between stems is 10000/(stems per hectare (2 R_b + DBH)).
   subroutine test_spacing()
      integer, parameter :: n = 200000
      real(wp), parameter :: width = 2000.0_wp, per_hectare = 500.0_wp, radius = 0.6_wp, dbh = 35.0_wp
      real(wp), parameter :: expected = 1.0e4_wp/(per_hectare*(2*radius + 0.01_wp*dbh))
      integer, parameter :: lines = 60000
      type(forest_t) :: this
      type(tree_hit_t) :: hit
      real(wp), allocatable :: x(:), y(:)
      real(wp) :: u(3), distance, total, squares
      integer :: k, inside

      allocate (x(n), y(n))
      call random_number(x)
      call random_number(y)
      this = forest(width*x, width*y, origin, spread(dbh, 1, n), spread(1.0_wp, 1, n), tree_model_t())
      total = 0
      squares = 0
      inside = 0
      do k = 1, lines
         call random_number(u)
         u(1:2) = 200 + (width - 400)*u(1:2)
         associate (angle => 360*degree*u(3))
            call find_first_hit(this, flown(200.0_wp, 1.0_wp), u(1), u(2), [cos(angle), sin(angle)], radius, none, hit)
         end associate
         if (hit%tree == 0) inside = inside + 1
         distance = hit%time
         total = total + distance
         squares = squares + distance**2
      end do
      call check("nobody flies 200 m through it", inside == 0)
      associate (mean => total/lines, error => sqrt(squares/lines - (total/lines)**2)/sqrt(real(lines, wp)))
         print "(3(a, f0.3))", "   mean tree-free distance [m] ", mean, ", error ", error, ", formula ", expected
         call check("standard error of this estimate is below 1 %", error < 0.01_wp*expected)
         call check("mean tree-free distance", abs(mean - expected) < 3*error)
      end associate
   end subroutine test_spacing

   !> A stem absorbs at most the energy of the boulder and at most its capacity; the boulder keeps the rest.
   subroutine test_taken()
      type(tree_impact_t) :: impact
      type(stem_t) :: stem
      real(wp) :: u(4), energy
      integer :: k, stopped

      stopped = 0
      do k = 1, 5000
         call random_number(u)
         stem = stem_t(0.0_wp, 0.0_wp, 0.5_wp*u(1) + 0.01_wp, 1.0e6_wp*u(2))
         energy = 10.0_wp**(8*u(3) - 1)
         impact = tree_impact(tree_model_t(), stem, u(4)*stem%radius, energy, words(k))
         call check("at most what there is", impact%absorbed <= energy .and. impact%absorbed <= stem%max_energy)
         call check("never less than nothing", impact%absorbed >= 0)
         call check("a stem breaks only if it was not enough", .not. impact%breaks .or. &
                    (impact%absorbed < energy .and. u(4) < 0.58_wp))
         if (impact%absorbed >= energy) stopped = stopped + 1
      end do
      call check("some are stopped", stopped > 500 .and. stopped < 4500)
      stem = stem_t(0.0_wp, 0.0_wp, 0.15_wp, max_stem_energy(30.0_wp))
      impact = tree_impact(tree_model_t(), stem, 0.3_wp*0.15_wp, 2.0e5_wp, words(1))
      call check_close("x is offset/(DBH/2)", impact%absorbed, 0.974156048421733373_wp*99968.0137871888292_wp, &
                       1.0e-14_wp)
      impact = tree_impact(tree_model_t(), stem, 200*stem%radius, 2.0e5_wp, words(1))
      call check("a scratch beyond the side takes nothing", abs(impact%absorbed) <= 0 .and. .not. impact%breaks)
   end subroutine test_taken

   pure function words(k)
      integer, intent(in) :: k
      integer(i8) :: words(4)

      words = random_words(random_key(3_i8), for_tree, int(k, i8), 1_i8, 0_i8)
   end function words

   !> Turns follow the weights for the type of hit; by default, all angles up to 76 degrees are equally likely.
   subroutine test_turns()
      integer, parameter :: n = 40000
      type(tree_model_t) :: law
      type(tree_impact_t) :: impact
      real(wp), parameter :: x(3) = [0.2_wp, 0.6_wp, 0.9_wp]
      real(wp), allocatable :: angle(:)
      real(wp) :: share(3), want(3)
      integer :: k, type

      allocate (angle(n))
      call check("types", hit_type(law, 0.57_wp) == frontal .and. hit_type(law, 0.58_wp) == lateral .and. &
                 hit_type(law, 0.75_wp) == scratch)
      do k = 1, n
         impact = tree_impact(law, thin, 0.1_wp, 10.0_wp, words(k))
         angle(k) = acos(impact%cosine)/degree
         call check("a turn changes no length", abs(impact%sine**2 + impact%cosine**2 - 1) < 1.0e-14_wp)
      end do
      call check("up to 76 degrees", minval(angle) < 0.02_wp .and. abs(maxval(angle) - 75.99_wp) < 0.01_wp)
      call check_close("38 on average", sum(angle)/n, 38.0_wp, 4*76/sqrt(12.0_wp*n)/38)
      law%weight = reshape([1.0_wp, 2.0_wp, 1.0_wp, 0.0_wp, 3.0_wp, 0.0_wp, 0.3_wp, 0.0_wp, 0.7_wp], [3, 3])
      do type = frontal, scratch
         do k = 1, n
            impact = tree_impact(law, thin, 0.2_wp*x(type), 10.0_wp, words(k))
            angle(k) = acos(impact%cosine)/degree
         end do
         share = [count(angle < 22.5_wp), 0, count(angle > 67.5_wp)]/real(n, wp)
         share(2) = 1 - share(1) - share(3)
         want = law%weight(:, type)/sum(law%weight(:, type))
         call check("shares of the classes", all(abs(share - want) <= 4*sqrt(want*(1 - want)/n) + 1.0e-12_wp))
      end do
   end subroutine test_turns

   !> Boulders turn away from the stem; after a central hit, to either side.
   subroutine test_sides()
      integer, parameter :: n = 10000
      type(tree_impact_t) :: impact
      integer :: k, left

      left = 0
      do k = 1, n
         impact = tree_impact(tree_model_t(), thin, 0.1_wp, 10.0_wp, words(k))
         call check("stem on the left: to the right", impact%sine < 0)
         impact = tree_impact(tree_model_t(), thin, -0.1_wp, 10.0_wp, words(k))
         call check("stem on the right: to the left", impact%sine > 0)
         impact = tree_impact(tree_model_t(), thin, 1.0e-16_wp, 10.0_wp, words(k))
         if (impact%sine > 0) left = left + 1
      end do
      call check("either side", abs(left - n/2) < 2*sqrt(real(n, wp)))
   end subroutine test_sides
end program test_forest
