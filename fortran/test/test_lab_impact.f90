! SPDX-License-Identifier: BSD-3-Clause
!> Impacts on layers: first contact, signs, scaling with speed, what counts as a rebound, extremes,
!> explosions that are named, and the same bits for any threads and chunks.
program test_lab_impact
   use rockfall_kinds, only: wp, i8
   use rockfall_error, only: error_t
   use rockfall_random, only: random_key
   use lab_contact, only: material_t
   use lab_packing, only: packing_t, layer_t, pack_layer
   use lab_step, only: sound, too_soft
   use lab_impact, only: shot_t, outcome_t, film_t, fire, first_contact, check_shot, &
      rebounded, lifted, captured, exploded, misfit
   use lab_ensemble, only: range_t, identity_t, draw_shot, check_range, pack_layers, fire_shots
   use check_m, only: check, check_close, finish
   implicit none

   type(layer_t) :: layer
   type(material_t) :: stone

   stone = material_t(young=1.0e9_wp, friction=0.3_wp, damping=0.05_wp)
   layer = soil(packing_t(width=40.0_wp, depth=8.0_wp), stone)
   call test_first_contact()
   call test_one_body()
   call test_states()
   call test_capture()
   call test_linearity()
   call test_film()
   call test_explosion()
   call test_extremes()
   call test_misfit()
   call test_draws()
   call test_threads()
   call test_refusals()
   call finish()

contains

   type(layer_t) function soil(packing, material)
      type(packing_t), intent(in) :: packing
      type(material_t), intent(in) :: material
      type(error_t), allocatable :: error

      call pack_layer(packing, material, random_key(1_i8), 1_i8, soil, error)
      call check("a layer for the test", .not. allocated(error))
   end function soil

   !> At the start the sphere touches one body, and overlaps none in any image; on its way it would
   !> have met none.
   subroutine test_first_contact()
      type(shot_t) :: shot
      real(wp) :: start(2), back(2)
      real(wp), parameter :: pi = acos(-1.0_wp)
      integer :: k, l
      logical :: touches, clear

      touches = .true.
      clear = .true.
      do k = 0, 59
         shot = shot_t(radius=(0.5_wp + mod(k, 5))*0.25_wp, angle=1 + 89*(k/59.0_wp), &
            aim=mod(0.37_wp*k, 1.0_wp))
         start = first_contact(layer, shot)
         touches = touches .and. abs(nearest_gap(start, shot%radius)) < 1.0e-8_wp
         do l = 1, 200
            back = [-cos(shot%angle*pi/180), sin(shot%angle*pi/180)]
            clear = clear .and. nearest_gap(start + 0.05_wp*l*back, shot%radius) > 0
         end do
      end do
      call check("the first contact touches", touches)
      call check("nothing was met before", clear)
   end subroutine test_first_contact

   !> Smallest gap to a body in any image, or the floor.
   real(wp) function nearest_gap(x, radius)
      real(wp), intent(in) :: x(2), radius
      real(wp) :: dx
      integer :: k

      nearest_gap = x(2) - radius
      do k = 1, size(layer%radius)
         dx = modulo(layer%x(1, k) - x(1) + layer%box%width/2, layer%box%width) - layer%box%width/2
         nearest_gap = min(nearest_gap, sqrt(dx**2 + (layer%x(2, k) - x(2))**2) - radius &
            - layer%radius(k))
      end do
   end function nearest_gap

   !> A layer of one small sphere on the floor, hit beside it: the floor gives the answer, e = 1
   !> without damping, and gross slip turns the sphere forward: W > 0.
   subroutine test_one_body()
      type(layer_t) :: bare
      type(shot_t) :: shot
      type(outcome_t) :: outcome
      real(wp) :: v_t, v_n

      bare%x = reshape([1.0_wp, 0.1_wp], [2, 1])
      bare%radius = [0.1_wp]
      bare%mean_radius = 0.1_wp
      bare%density = 2650
      bare%box%width = 20
      bare%top = 0.2_wp
      shot = shot_t(radius=1.0_wp, speed=10.0_wp, angle=20.0_wp, aim=0.5_wp, gravity=0.0_wp)
      v_t = 10*cos(20*acos(-1.0_wp)/180)
      v_n = 10*sin(20*acos(-1.0_wp)/180)
      call fire(bare, material_t(young=1.0e11_wp, friction=0.2_wp), shot, outcome)
      call check("a rebound from the floor", outcome%status == rebounded &
         .and. outcome%trouble == sound)
      call check_close("V_t in", outcome%incoming(1), v_t, 1.0e-14_wp)
      call check_close("V_n in is negative", outcome%incoming(2), -v_n, 1.0e-14_wp)
      call check_close("V_n out", outcome%outgoing(2), v_n, 1.0e-3_wp)
      call check_close("V_t out", outcome%outgoing(1), v_t - 0.2_wp*(v_n + outcome%outgoing(2)), &
         1.0e-6_wp)
      call check_close("W out, forward", outcome%outgoing(3), 0.5_wp*(v_n + outcome%outgoing(2)), &
         1.0e-2_wp)
      shot%spin = 0.7_wp
      call fire(bare, material_t(young=1.0e11_wp, friction=0.0_wp), shot, outcome)
      call check_close("spin goes through without friction", outcome%outgoing(3), 7.0_wp, &
         1.0e-12_wp)
      call check_close("and comes in as W = spin*V", outcome%incoming(3), 7.0_wp, 1.0e-14_wp)
   end subroutine test_one_body

   !> No impact yields energy; one that rebounds goes up.
   subroutine test_states()
      type(shot_t) :: shot
      type(outcome_t) :: outcome
      integer :: k, ends(5)
      logical :: loses, rises

      loses = .true.
      rises = .true.
      ends = 0
      do k = 1, 60
         shot = draw_shot(shot_t(radius=0.5_wp), range_t(), random_key(5_i8), &
            identity_t(impact=int(k, i8), &
            point=int(k, i8)))
         call fire(layer, stone, shot, outcome)
         ends(outcome%status) = ends(outcome%status) + 1
         loses = loses .and. energy(outcome%outgoing) < energy(outcome%incoming)
         if (outcome%status <= lifted) rises = rises .and. outcome%outgoing(2) > 0.009_wp*shot%speed
      end do
      print "(a, 5i4)", "rebounded, lifted, captured, exploded, misfit:", ends
      call check("all ended as results", sum(ends(:captured)) == 60)
      call check("most rebounded", ends(rebounded) > 20)
      call check("none gained energy", loses)
      call check("rebounds go up", rises)
   end subroutine test_states

   pure real(wp) function energy(v)
      real(wp), intent(in) :: v(3)

      energy = v(1)**2 + v(2)**2 + 0.4_wp*v(3)**2
   end function energy

   !> In a loose layer with strong damping most spheres rise by less than a tenth of their speed (a
   !> hundredth of the energy), and are counted as captured if that is the threshold.
   subroutine test_capture()
      type(layer_t) :: loose
      type(shot_t) :: shot
      type(outcome_t) :: outcome
      integer :: k, stayed
      logical :: spent

      loose = soil(packing_t(width=40.0_wp, depth=12.0_wp, friction=0.6_wp), stone)
      stayed = 0
      spent = .true.
      do k = 1, 10
         shot = shot_t(radius=0.5_wp, speed=5.0_wp, angle=90.0_wp, aim=0.095_wp*k, spent=0.01_wp)
         call fire(loose, material_t(young=1.0e9_wp, friction=0.6_wp, damping=0.9_wp), shot, &
            outcome)
         if (outcome%status /= captured) cycle
         stayed = stayed + 1
         spent = spent .and. outcome%outgoing(2)**2 < 0.01_wp*shot%speed**2
      end do
      call check("most are captured", stayed >= 6)
      call check("without upward motion", spent)
   end subroutine test_capture

   !> Without gravity and with stiffness in proportion to speed**2 the problem has no scale: all
   !> velocities are in proportion. The layer is laid bare of its overlaps first, for they are the
   !> weight's.
   subroutine test_linearity()
      type(shot_t) :: shot
      type(outcome_t) :: slow, fast
      type(layer_t) :: thin
      integer :: k

      thin = layer
      thin%radius = 0.999_wp*layer%radius
      do k = 1, 5
         shot = shot_t(radius=0.5_wp, speed=4.0_wp, angle=20.0_wp*k - 15, aim=0.17_wp*k, &
            gravity=0.0_wp)
         call fire(thin, material_t(young=1.0e8_wp, friction=0.3_wp), shot, slow)
         shot%speed = 16
         call fire(thin, material_t(young=1.6e9_wp, friction=0.3_wp), shot, fast)
         call check("the same end", slow%status == fast%status .and. slow%steps == fast%steps)
         call check_close("V_t in proportion", fast%outgoing(1)/16 - slow%outgoing(1)/4, 0.0_wp, &
            1.0e-6_wp)
         call check_close("V_n in proportion", fast%outgoing(2)/16 - slow%outgoing(2)/4, 0.0_wp, &
            1.0e-6_wp)
         call check_close("W in proportion", fast%outgoing(3)/16 - slow%outgoing(3)/4, 0.0_wp, &
            1.0e-6_wp)
      end do
   end subroutine test_linearity

   !> Pictures come when they are due, start with the layer as it is, and change nothing.
   subroutine test_film()
      type(shot_t) :: shot
      type(outcome_t) :: outcome, filmed
      type(film_t) :: film
      integer :: n

      shot = shot_t(radius=0.5_wp, angle=40.0_wp)
      n = size(layer%radius)
      film%interval = 0.01_wp
      allocate (film%time(50), film%x(2, n + 1, 50), film%v(3, n + 1, 50))
      call fire(layer, stone, shot, outcome)
      call fire(layer, stone, shot, filmed, film)
      call check("a film changes nothing", all(abs(outcome%outgoing - filmed%outgoing) <= 0))
      call check("several pictures", film%frames > 3 .and. film%frames < 50)
      call check_close("the first at time 0", film%time(1), 0.0_wp, 0.0_wp)
      call check("of the layer", maxval(abs(film%x(:, :n, 1) - layer%x)) < 1.0e-12_wp)
      call check("and of the sphere at its first contact", &
         maxval(abs(film%x(:, n + 1, 1) - first_contact(layer, shot))) < 1.0e-12_wp)
      call check("in even times", abs(film%time(3) - 0.02_wp) < 1.0e-3_wp)
   end subroutine test_film

   !> A step 20 times too long: named if nothing may be done about it, halved until it is sound if
   !> it may.
   subroutine test_explosion()
      type(shot_t) :: shot
      type(outcome_t) :: outcome, sound_one

      shot = shot_t(radius=0.75_wp, speed=20.0_wp, step_share=20.0_wp, retries=0)
      call fire(layer, stone, shot, outcome)
      call check("an explosion is named", outcome%status == exploded .and. outcome%trouble /= sound)
      call check_close("and its numbers are none", energy(outcome%outgoing), 0.0_wp, 0.0_wp)
      shot%retries = 8
      call fire(layer, stone, shot, outcome)
      call check("halving helps, and is counted", outcome%trouble == sound &
         .and. outcome%halvings >= 3)
      shot%step_share = 20.0_wp/2**outcome%halvings
      call fire(layer, stone, shot, sound_one)
      call check("as if it had been short at once", &
         all(abs(outcome%outgoing - sound_one%outgoing) <= 0))
   end subroutine test_explosion

   !> Stiffness 1e7 to 1e11 Pa, 0.1 to 100 m/s, R_b/R_m 0.5 to 20, sizes 1:20: each impact ends as a
   !> result that has no more energy than it and its weight gave, or as an explosion with its
   !> reason.
   subroutine test_extremes()
      type(layer_t) :: wide
      type(shot_t) :: shot
      type(outcome_t) :: outcome
      type(material_t) :: material
      real(wp), parameter :: young(3) = [1.0e7_wp, 1.0e9_wp, 1.0e11_wp], &
         speed(3) = [0.1_wp, 5.0_wp, 100.0_wp], &
                             ratio(3) = [0.5_wp, 4.0_wp, 20.0_wp]
      real(wp) :: fall
      integer :: i, j, k, ends(5), softness
      logical :: good

      good = .true.
      ends = 0
      softness = 0
      do i = 1, 3
         material = material_t(young=young(i), friction=0.3_wp, damping=0.1_wp)
         wide = soil(packing_t(width=50.0_wp, depth=3.0_wp, size_ratio=20.0_wp), material)
         do j = 1, 3
            do k = 1, 3
               shot = shot_t(radius=0.25_wp*ratio(k), speed=speed(j), angle=50.0_wp, &
                  patience=4.0_wp)
               call fire(wide, material, shot, outcome)
               ends(outcome%status) = ends(outcome%status) + 1
               if (outcome%trouble == too_soft) softness = softness + 1
               if (outcome%status <= captured) then
                  fall = outcome%depth + wide%top - wide%surface
                  good = good .and. energy(outcome%outgoing) <= energy(outcome%incoming) &
                     + 2*shot%gravity*fall
               else
                  good = good .and. outcome%status == exploded .and. outcome%trouble /= sound
               end if
               if (young(i) > 1.0e10_wp .and. speed(j) < 50) good = good &
                  .and. outcome%status <= captured
            end do
         end do
      end do
      print "(a, 5i4, a, i0)", "extremes: rebounded, lifted, captured, exploded, misfit:", ends, &
         "; too soft: ", softness
      call check("extremes are results or named", good)
      call check("soft ones at high speed are found out", softness > 0)
   end subroutine test_extremes

   !> A sphere that would touch two images of a body, or a wall at its start.
   subroutine test_misfit()
      type(shot_t) :: shot
      type(outcome_t) :: outcome
      type(layer_t) :: walled

      shot = shot_t(radius=5.0_wp)
      call fire(layer, stone, shot, outcome)
      call check("too large for the period", outcome%status == misfit)
      walled = soil(packing_t(width=30.0_wp, depth=5.0_wp, periodic=.false.), stone)
      shot = shot_t(radius=0.5_wp, angle=90.0_wp, aim=0.01_wp)
      call fire(walled, stone, shot, outcome)
      call check("in the wall", outcome%status == misfit)
      shot%aim = 0.5_wp
      call fire(walled, stone, shot, outcome)
      call check("between walls", outcome%status <= captured)
   end subroutine test_misfit

   !> All impacts at a point have one aim; speeds, angles and spins fill their ranges.
   subroutine test_draws()
      type(shot_t) :: shot, other
      type(range_t) :: range
      real(wp) :: low(3), high(3), v(3), mean(3)
      integer, parameter :: n = 2000
      integer :: k

      other = draw_shot(shot_t(), range, random_key(5_i8), identity_t(layer=2, point=7))
      low = huge(1.0_wp)
      high = -low
      mean = 0
      do k = 1, n
         shot = draw_shot(shot_t(radius=3.0_wp), range, random_key(5_i8), &
            identity_t(layer=2, point=7, impact=int(k, i8)))
         v = [shot%speed, shot%angle, shot%spin]
         low = min(low, v)
         high = max(high, v)
         mean = mean + v/n
         if (k <= 3) call check("the same aim", abs(shot%aim - other%aim) <= 0)
      end do
      call check_close("the template is kept", shot%radius, 3.0_wp, 0.0_wp)
      call check("ranges are filled, not left", &
         all(low > [5.0_wp, 10.0_wp, -0.5_wp] .and. high < [30.0_wp, 90.0_wp, 1.0_wp] &
         .and. high - low > 0.99_wp*[25.0_wp, 80.0_wp, 1.5_wp]))
      call check("evenly", &
         all(abs(mean - [17.5_wp, 50.0_wp, 0.25_wp]) < 4*[25.0_wp, 80.0_wp, &
            1.5_wp]/sqrt(12.0_wp*n)))
      shot = draw_shot(shot_t(), range, random_key(5_i8), identity_t(layer=7, point=2))
      call check("another point, another aim", abs(shot%aim - other%aim) > 0)
   end subroutine test_draws

   !> The same bits for 1 and 2 threads, one call or two.
   subroutine test_threads()
      integer, parameter :: n = 24
      type(layer_t) :: layers(2), again(2), single(1)
      type(identity_t) :: ids(n)
      type(shot_t) :: shots(n), shot_b(n)
      type(outcome_t) :: a(n), b(n), c(n)
      type(error_t), allocatable :: error
      type(packing_t) :: packing
      integer :: k

      packing = packing_t(width=30.0_wp, depth=4.0_wp)
      call pack_layers(packing, stone, random_key(9_i8), 3_i8, 1, layers, error)
      call check("packed", .not. allocated(error))
      call pack_layers(packing, stone, random_key(9_i8), 3_i8, 2, again, error)
      call pack_layers(packing, stone, random_key(9_i8), 4_i8, 2, single, error)
      call check("layers: threads do not matter", all(abs(layers(1)%x - again(1)%x) <= 0) &
         .and. all(abs(layers(2)%x - again(2)%x) <= 0))
      call check("layers: chunks do not matter", all(abs(layers(2)%x - single(1)%x) <= 0))
      do k = 1, n
         ids(k) = identity_t(place=1 + mod(k, 2), layer=3 + mod(k, 2), point=int(k/6, i8), &
            impact=int(k, i8))
      end do
      call fire_shots(layers, stone, shot_t(radius=0.5_wp), range_t(), random_key(9_i8), ids, 1, &
         shots, a)
      call fire_shots(layers, stone, shot_t(radius=0.5_wp), range_t(), random_key(9_i8), ids, 2, &
         shot_b, b)
      call fire_shots(layers, stone, shot_t(radius=0.5_wp), range_t(), random_key(9_i8), ids(:7), &
         2, shot_b(:7), c(:7))
      call fire_shots(layers, stone, shot_t(radius=0.5_wp), range_t(), random_key(9_i8), ids(8:), &
         1, shot_b(8:), c(8:))
      call check("impacts: threads do not matter", same(a, b))
      call check("impacts: chunks do not matter", same(a, c))
      call check("impacts differ", .not. same(a(:n - 1), a(2:)))
   end subroutine test_threads

   pure logical function same(a, b)
      type(outcome_t), intent(in) :: a(:), b(:)
      integer :: k

      same = all(a%status == b%status .and. a%steps == b%steps)
      do k = 1, size(a)
         same = same .and. all(abs(a(k)%outgoing - b(k)%outgoing) <= 0) &
            .and. abs(a(k)%depth - b(k)%depth) <= 0
      end do
   end function same

   subroutine test_refusals()
      type(error_t), allocatable :: error

      call check_shot(shot_t(), error)
      call check("the default shot is one", .not. allocated(error))
      call check_shot(shot_t(radius=0.0_wp), error)
      call check("no radius is refused", allocated(error))
      call check_shot(shot_t(speed=0.0_wp), error)
      call check("no speed is refused", allocated(error))
      call check_shot(shot_t(angle=0.0_wp), error)
      call check("a path along the surface is refused", allocated(error))
      call check_shot(shot_t(aim=1.5_wp), error)
      call check("an aim beside the layer is refused", allocated(error))
      call check_range(shot_t(), range_t(angle=[10.0_wp, 100.0_wp]), error)
      call check("a path from below is refused", allocated(error))
      call check_range(shot_t(), range_t(), error)
      call check("the default ranges are fine", .not. allocated(error))
   end subroutine test_refusals
end program test_lab_impact
