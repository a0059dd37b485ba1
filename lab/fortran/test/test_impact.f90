! SPDX-License-Identifier: BSD-3-Clause
!> Impacts on layers: first contact, signs, scaling with speed, rotated and mirrored layers, the definition of a
!> rebound, extremes, reported explosions, and identical results for any threads and chunks.
program test_lab_impact
   use rockfall_kinds, only: wp, i8
   use rockfall_error, only: error_t
   use rockfall_math, only: pi
   use rockfall_random, only: random_key
   use lab_contact, only: material_t
   use lab_packing, only: packing_t, layer_t, pack_layer
   use lab_step, only: sound, too_soft
   use lab_impact, only: shot_t, outcome_t, fire, first_contact, check_shot, &
      rebounded, lifted, rolled_on, exploded, misfit
   use lab_ensemble, only: range_t, identity_t, draw_shot, check_range, pack_layers, fire_shots
   use check_m, only: check, check_close, finish
   implicit none

   type(layer_t) :: layer
   type(packing_t) :: packing
   type(material_t) :: stone

   stone = material_t(young=1.0e9_wp, friction=0.3_wp, damping=0.05_wp)
   packing = packing_t(ratio=2.0_wp, depth=2.0_wp)
   layer = soil(packing, stone)
   call test_first_contact()
   call test_one_body()
   call test_states_of()
   call test_ends()
   call test_rolling_on()
   call test_linearity()
   call test_turned()
   call test_mirrored()
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

   !> Unit vector in plan.
   pure function direction(angle)
      real(wp), intent(in) :: angle
      real(wp) :: direction(2)

      direction = [cos(angle), sin(angle)]
   end function direction

   !> At the start the sphere touches a body, an image of one or the floor, and overlaps none. Its path met none before,
   !> and leads along its heading to its aim.
   subroutine test_first_contact()
      type(shot_t) :: shot
      real(wp) :: start(3), back(3), aim(3)
      integer :: k, l
      logical :: touches, clear, aims

      touches = .true.
      clear = .true.
      aims = .true.
      do k = 0, 59
         shot = shot_t(radius=(0.5_wp + mod(k, 5))*0.2_wp, angle=1 + 89*(k/59.0_wp), &
            aim=modulo([0.37_wp, 0.73_wp]*k, 1.0_wp), heading=direction(1.1_wp*k))
         start = first_contact(layer, shot)
         touches = touches .and. abs(nearest_gap(start, shot%radius)) < 1.0e-8_wp
         back = [-cos(shot%angle*pi/180)*shot%heading, sin(shot%angle*pi/180)]
         do l = 1, 200
            clear = clear .and. nearest_gap(start + 0.05_wp*l*back, shot%radius) > 0
         end do
         aim = start + back*(layer%surface - start(3))/back(3)
         aims = aims .and. maxval(abs(aim(1:2) - layer%box%width*shot%aim)) < 1.0e-9_wp
      end do
      call check("the first contact touches", touches)
      call check("nothing was met before", clear)
      call check("on the line through the aim", aims)
   end subroutine test_first_contact

   !> Smallest gap to a body or one of its images, or to the floor.
   real(wp) function nearest_gap(x, radius)
      real(wp), intent(in) :: x(3), radius
      real(wp) :: d(3)
      integer :: k

      nearest_gap = x(3) - radius
      do k = 1, size(layer%radius)
         d = layer%x(:, k) - x
         d(1:2) = modulo(d(1:2) + layer%box%width/2, layer%box%width) - layer%box%width/2
         nearest_gap = min(nearest_gap, sqrt(sum(d**2)) - radius - layer%radius(k))
      end do
   end function nearest_gap

   !> Layer of one small sphere on the floor, hit next to it: the floor determines the outcome, e = 1 without damping,
   !> and gross slip spins the sphere forward (W > 0), for any heading.
   subroutine test_one_body()
      type(layer_t) :: bare
      type(shot_t) :: shot
      type(outcome_t) :: outcome
      real(wp) :: v_t, v_n
      integer :: k

      bare%x = reshape([1.0_wp, 1.0_wp, 0.1_wp], [3, 1])
      bare%radius = [0.1_wp]
      bare%box%width = 20
      bare%top = 0.2_wp
      v_t = 10*cos(20*pi/180)
      v_n = 10*sin(20*pi/180)
      do k = 0, 3
         shot = shot_t(radius=1.0_wp, speed=10.0_wp, angle=20.0_wp, gravity=0.0_wp, &
            heading=direction(1.3_wp*k))
         call fire(bare, packing_t(), material_t(young=1.0e11_wp, friction=0.2_wp), shot, outcome)
         call check("a rebound from the floor", outcome%status == rebounded &
            .and. outcome%trouble == sound)
         call check_close("V_t in", outcome%incoming(1), v_t, 1.0e-14_wp)
         call check_close("V_n in is negative", outcome%incoming(2), -v_n, 1.0e-14_wp)
         associate (out => outcome%peak%v)
            call check_close("V_n out", out(2), v_n, 1.0e-3_wp)
            call check_close("V_t out", out(1), v_t - 0.2_wp*(v_n + out(2)), 1.0e-6_wp)
            call check_close("W out, forward", out(3), 0.5_wp*(v_n + out(2)), 1.0e-2_wp)
         end associate
         call check_close("straight on", outcome%peak%lateral, 0.0_wp, 1.0e-9_wp)
         call check_close("peak, loss and clear are one", &
            maxval(abs([outcome%loss%v, outcome%clear%v] - [outcome%peak%v, outcome%peak%v])), 0.0_wp, &
            1.0e-9_wp)
         shot%spin = 0.7_wp
         call fire(bare, packing_t(), material_t(young=1.0e11_wp, friction=0.0_wp), shot, outcome)
         call check_close("spin goes through without friction", outcome%peak%v(3), 7.0_wp, 1.0e-12_wp)
         call check_close("and comes in as W = spin*V", outcome%incoming(3), 7.0_wp, 1.0e-14_wp)
      end do
   end subroutine test_one_body

   !> Outgoing states are relative to the heading. Rolling without slip gives W = V_t, a rebound backwards from a steep
   !> face gives V_t < 0, and a deflection to the left gives lateral > 0.
   subroutine test_states_of()
      type(layer_t) :: step
      type(shot_t) :: shot
      type(outcome_t) :: outcome
      real(wp) :: u(3), n(3), heading(2), left(2), expected(2)
      real(wp), parameter :: side(3) = [0.0_wp, 0.3_wp, -0.3_wp]
      type(packing_t) :: ground
      integer :: k, l

      ground%rigid_base = .true.
      allocate (step%x(3, 1), step%radius(1))
      do l = 1, 3
         do k = 0, 2
            ! a body too heavy to move, with its centre next to the path
            heading = direction(0.4_wp + 2*k)
            left = [-heading(2), heading(1)]
            step%x = reshape([10.0_wp, 10.0_wp, 4.0_wp], [3, 1])
            step%x(1:2, 1) = step%x(1:2, 1) - side(l)*left
            step%radius = [4.0_wp]
            step%box%width = 20
            step%surface = 4
            step%top = 8
            ground%density = 1.0e12_wp
            ground%mean_radius = 4
            shot = shot_t(radius=0.5_wp, speed=10.0_wp, angle=25.0_wp, gravity=0.0_wp, heading=heading, &
               retries=30)
            u = shot%speed*[cos(25*pi/180)*heading, -sin(25*pi/180)]
            n = first_contact(step, shot) - step%x(:, 1)
            n = n/sqrt(sum(n**2))
            u = u - 2*dot_product(u, n)*n
            call fire(step, ground, material_t(young=1.0e11_wp, friction=0.0_wp), shot, outcome)
            call check("thrown back from a face", outcome%status == rebounded)
            associate (out => outcome%peak)
               expected = [dot_product(u(1:2), heading), dot_product(u(1:2), left)]
               call check_close("V_t < 0", out%v(1), -sqrt(sum(expected**2)), 3.0e-3_wp)
               call check_close("V_n", out%v(2), u(3), 2.0e-2_wp)
               call check_close("lateral, of the line of V_t", out%lateral + expected(2)/sqrt(sum(expected**2)), &
                  0.0_wp, 3.0e-3_wp)
            end associate
         end do
      end do
      ! over the top of the body to the left: V_t > 0
      heading = direction(0.4_wp)
      left = [-heading(2), heading(1)]
      step%x(:, 1) = [10 - 2*left(1), 10 - 2*left(2), 4.0_wp]
      shot = shot_t(radius=0.5_wp, speed=10.0_wp, angle=60.0_wp, gravity=0.0_wp, heading=heading, retries=30)
      step%surface = 7.5_wp
      call fire(step, ground, material_t(young=1.0e11_wp, friction=0.0_wp), shot, outcome)
      call check("thrown to the left", outcome%status == rebounded .and. outcome%peak%v(1) > 0 &
         .and. outcome%peak%lateral > 0.1_wp)
      ! rolling in without slip gives rolling out
      step%x(:, 1) = [1.0_wp, 1.0_wp, 0.1_wp]
      step%radius = [0.1_wp]
      step%top = 0.2_wp
      step%surface = 0
      shot = shot_t(radius=1.0_wp, speed=10.0_wp, angle=30.0_wp, spin=cos(pi/6), gravity=0.0_wp, heading=heading, &
         retries=30)
      ground%mean_radius = 0.25_wp
      call fire(step, ground, material_t(young=1.0e11_wp, friction=0.3_wp), shot, outcome)
      call check_close("rolling without slip is W = V_t", outcome%peak%v(3), outcome%peak%v(1), 5.0e-3_wp)
      call check_close("as it was", outcome%peak%v(1), 10*cos(pi/6), 2.0e-3_wp)
   end subroutine test_states_of

   !> No impact gains energy, rebounds move upwards, and the peak is the fastest upward motion.
   subroutine test_ends()
      type(shot_t) :: shot
      type(outcome_t) :: outcome
      real(wp) :: most
      integer :: k, ends(5)
      logical :: loses, rises, sines

      loses = .true.
      rises = .true.
      sines = .true.
      ends = 0
      do k = 1, 40
         shot = draw_shot(shot_t(radius=0.5_wp), range_t(), random_key(5_i8), &
            identity_t(impact=int(k, i8), point=int(k, i8)))
         call fire(layer, packing, stone, shot, outcome)
         ends(outcome%status) = ends(outcome%status) + 1
         most = energy(outcome%incoming) + 2*shot%gravity*(outcome%depth + layer%top - layer%surface)
         loses = loses .and. max(energy(outcome%peak%v), energy(outcome%loss%v), energy(outcome%clear%v)) < most
         sines = sines .and. max(abs(outcome%peak%lateral), abs(outcome%loss%lateral), &
            abs(outcome%clear%lateral)) <= 1
         if (outcome%status <= lifted) rises = rises .and. outcome%loss%v(2) > 0
         if (outcome%status == rebounded) rises = rises .and. outcome%clear%v(2) > 0
         rises = rises .and. outcome%peak%v(2) >= max(outcome%loss%v(2), outcome%clear%v(2))
      end do
      print "(a, 5i4)", "rebounded, lifted, rolled on, exploded, misfit:", ends
      call check("all ended as results", sum(ends(:rolled_on)) == 40)
      call check("many rebounded", ends(rebounded) >= 10)
      call check("none gained energy", loses)
      call check("rebounds go up, and the peak is the peak", rises)
      call check("lateral is a sine", sines)
   end subroutine test_ends

   pure real(wp) function energy(v)
      real(wp), intent(in) :: v(3)

      energy = v(1)**2 + v(2)**2 + 0.4_wp*v(3)**2
   end function energy

   !> With strong damping, some spheres that fall vertically never lose contact upwards.
   subroutine test_rolling_on()
      type(shot_t) :: shot
      type(outcome_t) :: outcome
      integer :: k, stayed
      logical :: spent

      stayed = 0
      spent = .true.
      do k = 1, 30
         shot = shot_t(radius=0.5_wp, speed=5.0_wp, angle=90.0_wp, aim=modulo([0.095_wp, 0.31_wp]*k, 1.0_wp), &
            spent=0.01_wp)
         call fire(layer, packing, material_t(young=1.0e9_wp, friction=0.6_wp, damping=0.9_wp), shot, outcome)
         if (outcome%status /= rolled_on) cycle
         stayed = stayed + 1
         spent = spent .and. outcome%peak%v(2)**2 < 0.05_wp*shot%speed**2
         spent = spent .and. all(abs(outcome%loss%v - outcome%peak%v) <= 0) &
            .and. all(abs(outcome%clear%v - outcome%peak%v) <= 0)
      end do
      print "(i0, a)", stayed, " of 30 stay in contact"
      call check("some stay in contact", stayed >= 3)
      call check("with little upward motion, of one state", spent)
   end subroutine test_rolling_on

   !> Layer without the overlaps caused by its weight, for impacts without gravity.
   type(layer_t) function weightless(of)
      type(layer_t), intent(in) :: of

      weightless = of
      weightless%radius = 0.998_wp*of%radius
      weightless%x(3, :) = of%x(3, :)
   end function weightless

   !> Without gravity, and with stiffness proportional to speed**2, all velocities are proportional to the speed.
   subroutine test_linearity()
      type(shot_t) :: shot
      type(outcome_t) :: slow, fast
      type(packing_t) :: ground
      integer :: k

      ground = packing
      do k = 1, 5
         shot = shot_t(radius=0.5_wp, speed=4.0_wp, angle=20.0_wp*k - 15, aim=modulo([0.17_wp, 0.4_wp]*k, 1.0_wp), &
            gravity=0.0_wp, heading=direction(1.0_wp*k))
         ground%base_speed = 100
         call fire(weightless(layer), ground, material_t(young=1.0e8_wp, friction=0.3_wp), shot, slow)
         shot%speed = 16
         ground%base_speed = 400
         call fire(weightless(layer), ground, material_t(young=1.6e9_wp, friction=0.3_wp), shot, fast)
         call check("the same end", slow%status == fast%status .and. slow%steps == fast%steps)
         call check_close("all in proportion", maxval(abs(states_of(fast)/16 - states_of(slow)/4)), 0.0_wp, 1.0e-6_wp)
      end do
   end subroutine test_linearity

   !> (V_t, V_n, W) of the three states.
   pure function states_of(outcome) result(v)
      type(outcome_t), intent(in) :: outcome
      real(wp) :: v(9)

      v = [outcome%peak%v, outcome%loss%v, outcome%clear%v]
   end function states_of

   pure function laterals_of(outcome) result(lateral)
      type(outcome_t), intent(in) :: outcome
      real(wp) :: lateral(3)

      lateral = [outcome%peak%lateral, outcome%loss%lateral, outcome%clear%lateral]
   end function laterals_of

   !> Heading and layer rotated by quarter turns give the same outcome up to rounding.
   subroutine test_turned()
      type(shot_t) :: shot
      type(outcome_t) :: a, b
      type(layer_t) :: turned
      integer :: k, l

      do k = 1, 4
         shot = shot_t(radius=0.5_wp, angle=20.0_wp*k - 10, aim=[0.2_wp*k, 0.3_wp], heading=direction(0.7_wp*k), &
            spin=0.3_wp)
         call fire(layer, packing, stone, shot, a)
         turned = layer
         do l = 1, k
            turned%x = reshape([layer%box%width - turned%x(2, :), turned%x(1, :), turned%x(3, :)], &
               shape(layer%x), order=[2, 1])
            shot%heading = [-shot%heading(2), shot%heading(1)]
            shot%aim = [1 - shot%aim(2), shot%aim(1)]
         end do
         call fire(turned, packing, stone, shot, b)
         call check("turned: the same end", a%status == b%status .and. a%steps == b%steps)
         call check_close("turned: the same states", maxval(abs(states_of(a) - states_of(b))), 0.0_wp, 1.0e-6_wp)
         call check_close("turned: the same angles", maxval(abs(laterals_of(a) - laterals_of(b))), 0.0_wp, 1.0e-6_wp)
      end do
   end subroutine test_turned

   !> A mirrored heading and layer give the mirrored outcome.
   subroutine test_mirrored()
      type(shot_t) :: shot
      type(outcome_t) :: a, b
      type(layer_t) :: mirrored
      integer :: k
      logical :: sideways

      mirrored = layer
      mirrored%x(2, :) = layer%box%width - layer%x(2, :)
      sideways = .false.
      do k = 1, 4
         shot = shot_t(radius=0.5_wp, angle=20.0_wp*k - 10, aim=[0.2_wp*k, 0.3_wp], heading=direction(0.7_wp*k))
         call fire(layer, packing, stone, shot, a)
         shot%heading(2) = -shot%heading(2)
         shot%aim(2) = 1 - shot%aim(2)
         call fire(mirrored, packing, stone, shot, b)
         call check("mirrored: the same end", a%status == b%status .and. a%steps == b%steps)
         call check_close("mirrored: the same states", maxval(abs(states_of(a) - states_of(b))), 0.0_wp, 1.0e-6_wp)
         call check_close("mirrored: to the other side", maxval(abs(laterals_of(a) + laterals_of(b))), 0.0_wp, &
            1.0e-6_wp)
         sideways = sideways .or. abs(a%peak%lateral) > 0.01_wp
      end do
      call check("some went aside", sideways)
   end subroutine test_mirrored

   !> A step 20 times too long is reported if there are no retries; otherwise it is halved until it is stable.
   subroutine test_explosion()
      type(shot_t) :: shot
      type(outcome_t) :: outcome, sound_one

      shot = shot_t(radius=0.75_wp, speed=20.0_wp, step_factor=20.0_wp, retries=0)
      call fire(layer, packing, stone, shot, outcome)
      call check("an explosion is named", outcome%status == exploded .and. outcome%trouble /= sound)
      call check_close("and its numbers are none", energy(outcome%peak%v), 0.0_wp, 0.0_wp)
      shot%retries = 8
      call fire(layer, packing, stone, shot, outcome)
      call check("halving helps, and is counted", outcome%trouble == sound &
         .and. outcome%halvings >= 3)
      shot%step_factor = 20.0_wp/2**outcome%halvings
      call fire(layer, packing, stone, shot, sound_one)
      call check("as if it had been short at once", &
         all(abs(states_of(outcome) - states_of(sound_one)) <= 0))
   end subroutine test_explosion

   !> Young's modulus 1e7 to 1e10 Pa, 0.5 to 100 m/s, R_b/R_m 0.5 to 4: each impact ends with at most its own energy
   !> plus that of gravity, or as an explosion with its reason.
   subroutine test_extremes()
      type(layer_t) :: wide
      type(shot_t) :: shot
      type(outcome_t) :: outcome
      type(material_t) :: material
      type(packing_t) :: ground
      real(wp), parameter :: young(3) = [1.0e7_wp, 1.0e9_wp, 1.0e10_wp], &
         speed(3) = [0.5_wp, 5.0_wp, 100.0_wp], ratio(3) = [0.5_wp, 2.0_wp, 4.0_wp]
      real(wp) :: fall
      integer :: i, j, k, ends(5), softness
      logical :: good

      good = .true.
      ends = 0
      softness = 0
      ground = packing_t(ratio=1.0_wp, width=14.0_wp, depth=1.0_wp)
      do i = 1, 3
         material = material_t(young=young(i), friction=0.3_wp, damping=0.1_wp)
         wide = soil(ground, material_t(young=max(young(i), 1.0e9_wp)))
         do j = 1, 3
            do k = 1, 3
               shot = shot_t(radius=0.25_wp*ratio(k), speed=speed(j), angle=50.0_wp, patience=2.0_wp)
               call fire(wide, ground, material, shot, outcome)
               ends(outcome%status) = ends(outcome%status) + 1
               if (outcome%trouble == too_soft) softness = softness + 1
               if (outcome%status <= rolled_on) then
                  fall = outcome%depth + wide%top - wide%surface
                  good = good .and. max(energy(outcome%peak%v), energy(outcome%loss%v), energy(outcome%clear%v)) &
                     <= energy(outcome%incoming) + 2*shot%gravity*fall
               else
                  good = good .and. outcome%status == exploded .and. outcome%trouble /= sound
               end if
               if (young(i) > 2.0e9_wp .and. speed(j) < 50) good = good .and. outcome%status <= rolled_on
            end do
         end do
      end do
      print "(a, 5i4, a, i0)", "extremes: rebounded, lifted, rolled on, exploded, misfit:", ends, &
         "; too soft: ", softness
      call check("extremes are results or named", good)
      call check("soft ones at high speed are found out", softness > 0)
   end subroutine test_extremes

   !> A sphere that would touch two images of a body, or its own image, is rejected.
   subroutine test_misfit()
      type(shot_t) :: shot
      type(outcome_t) :: outcome
      type(layer_t) :: few

      shot = shot_t(radius=0.35_wp*layer%box%width)
      call fire(layer, packing, stone, shot, outcome)
      call check("too large for the period", outcome%status == misfit)
      few%x = reshape([1.0_wp, 1.0_wp, 2.0_wp], [3, 1])
      few%radius = [2.0_wp]
      few%box%width = 8
      few%surface = 1
      few%top = 4
      shot = shot_t(radius=2.1_wp)
      call fire(few, packing, stone, shot, outcome)
      call check("too large beside the largest rock", outcome%status == misfit)
      shot%radius = 1
      call fire(few, packing, stone, shot, outcome)
      call check("this one fits", outcome%status <= rolled_on)
   end subroutine test_misfit

   !> All impacts at a point have the same aim and heading. Half of the speeds, angles and spins are below the median,
   !> and each half is uniform; headings go in all directions.
   subroutine test_draws()
      type(shot_t) :: shot, other
      type(range_t) :: range
      real(wp) :: v(3), limits(3, 3), low(3), high(3), mean(3, 2), plan(2), cross(2)
      integer, parameter :: n = 4000
      integer :: k, l, below(3)

      other = draw_shot(shot_t(), range, random_key(5_i8), identity_t(layer=2, point=7))
      limits = reshape([range%speed, range%angle, range%spin], [3, 3])
      low = huge(1.0_wp)
      high = -low
      mean = 0
      below = 0
      do k = 1, n
         shot = draw_shot(shot_t(radius=3.0_wp), range, random_key(5_i8), &
            identity_t(layer=2, point=7, impact=int(k, i8)))
         v = [shot%speed, shot%angle, shot%spin]
         low = min(low, v)
         high = max(high, v)
         do l = 1, 3
            if (v(l) < limits(2, l)) then
               below(l) = below(l) + 1
               mean(l, 1) = mean(l, 1) + v(l)
            else
               mean(l, 2) = mean(l, 2) + v(l)
            end if
         end do
         if (k <= 3) call check("the same aim and heading", &
            all(abs([shot%aim - other%aim, shot%heading - other%heading]) <= 0))
      end do
      call check_close("the template is kept", shot%radius, 3.0_wp, 0.0_wp)
      call check("half below the median", all(abs(below - n/2) < 2*sqrt(real(n, wp))))
      do l = 1, 3
         call check("ranges are filled, not left", low(l) >= limits(1, l) .and. high(l) <= limits(3, l) &
            .and. high(l) - low(l) > 0.99_wp*(limits(3, l) - limits(1, l)))
         call check("evenly below", abs(mean(l, 1)/below(l) - sum(limits(1:2, l))/2) &
            < 4*(limits(2, l) - limits(1, l))/sqrt(12.0_wp*below(l)))
         call check("evenly above", abs(mean(l, 2)/(n - below(l)) - sum(limits(2:3, l))/2) &
            < 4*(limits(3, l) - limits(2, l))/sqrt(12.0_wp*(n - below(l))))
      end do
      plan = 0
      cross = 0
      do k = 1, n
         shot = draw_shot(shot_t(), range, random_key(5_i8), identity_t(layer=2, point=int(k, i8)))
         plan = plan + shot%heading
         cross = cross + [shot%heading(1)**2 - shot%heading(2)**2, 2*product(shot%heading)]
         if (k <= 100) call check_close("a heading is a direction", sum(shot%heading**2), 1.0_wp, 1.0e-14_wp)
      end do
      call check("headings go everywhere", maxval(abs([plan, cross])) < 4*sqrt(n/2.0_wp))
      shot = draw_shot(shot_t(), range, random_key(5_i8), identity_t(layer=7, point=2))
      call check("another point, another aim", all(abs(shot%aim - other%aim) > 0))
   end subroutine test_draws

   !> Results are identical for 1 and 2 threads, and for one or two calls.
   subroutine test_threads()
      integer, parameter :: n = 24
      type(layer_t) :: layers(2), again(2), single(1)
      type(identity_t) :: ids(n)
      type(shot_t) :: shots(n), shot_b(n)
      type(outcome_t) :: a(n), b(n), c(n)
      type(error_t), allocatable :: error
      type(packing_t) :: ground
      integer :: k

      ground = packing_t(ratio=1.0_wp)
      call pack_layers(ground, stone, random_key(9_i8), 3_i8, 1, layers, error)
      call check("packed", .not. allocated(error))
      call pack_layers(ground, stone, random_key(9_i8), 3_i8, 2, again, error)
      call pack_layers(ground, stone, random_key(9_i8), 4_i8, 2, single, error)
      call check("layers: threads do not matter", all(abs(layers(1)%x - again(1)%x) <= 0) &
         .and. all(abs(layers(2)%x - again(2)%x) <= 0))
      call check("layers: chunks do not matter", all(abs(layers(2)%x - single(1)%x) <= 0))
      do k = 1, n
         ids(k) = identity_t(place=1 + mod(k, 2), layer=3 + mod(k, 2), point=int(k/6, i8), &
            impact=int(k, i8))
      end do
      call fire_shots(layers, ground, stone, shot_t(radius=0.25_wp), range_t(), random_key(9_i8), ids, 1, &
         shots, a)
      call fire_shots(layers, ground, stone, shot_t(radius=0.25_wp), range_t(), random_key(9_i8), ids, 2, &
         shot_b, b)
      call fire_shots(layers, ground, stone, shot_t(radius=0.25_wp), range_t(), random_key(9_i8), ids(:7), &
         2, shot_b(:7), c(:7))
      call fire_shots(layers, ground, stone, shot_t(radius=0.25_wp), range_t(), random_key(9_i8), ids(8:), &
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
         same = same .and. all(abs(states_of(a(k)) - states_of(b(k))) <= 0) &
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
      call check_shot(shot_t(aim=[0.5_wp, 1.5_wp]), error)
      call check("an aim beside the layer is refused", allocated(error))
      call check_range(shot_t(), range_t(angle=[10.0_wp, 20.0_wp, 100.0_wp]), error)
      call check("a path from below is refused", allocated(error))
      call check_range(shot_t(), range_t(speed=[3.0_wp, 2.0_wp, 5.0_wp]), error)
      call check("a median below the min is refused", allocated(error))
      call check_shot(shot_t(heading=[1.0_wp, 1.0_wp]), error)
      call check("a heading that is no unit vector is refused", allocated(error))
      call check_shot(shot_t(retries=31), error)
      call check("endless retries are refused", allocated(error))
      call check_range(shot_t(), range_t(), error)
      call check("the default ranges are fine", .not. allocated(error))
   end subroutine test_refusals
end program test_lab_impact
