! SPDX-License-Identifier: BSD-3-Clause
!> The contact law and its stepping against theory: Hertz's collision, restitution of the viscous
!> part, oblique impacts on a plane between gross slip and stick, no gain of energy, second order in
!> the step.
program test_lab_contact
   use rockfall_kinds, only: wp, i8
   use rockfall_error, only: error_t
   use rockfall_math, only: pi
   use rockfall_random, only: random_key, random_words, uniform
   use lab_contact, only: material_t, law_t, touch_t, pair_law, plane_law, press, stored_energy, &
      check_material, reduced_modulus, collision_time, rayleigh_time
   use lab_bodies, only: bodies_t, bodies
   use lab_neighbours, only: box_t
   use lab_step, only: assembly_t, assemble, advance, total_energy, safe_step, sound
   use check_m, only: check, check_close, finish
   implicit none

   real(wp), parameter :: density = 2650

   call test_hertz()
   call test_elastic_energy()
   call test_restitution()
   call test_gross_slip()
   call test_stick()
   call test_rolling_end()
   call test_order()
   call test_order_of_pair()
   call test_no_gain()
   call test_rolling()
   call test_frictionless_spin()
   call test_times()
   call test_refusals()
   call finish()

contains

   !> Two spheres, 1 m and 0.4 m, that meet head on with `speed` along a slanted line.
   function pair(material, speed, dt) result(s)
      type(material_t), intent(in) :: material
      real(wp), intent(in) :: speed, dt
      type(assembly_t) :: s
      type(bodies_t) :: b
      real(wp) :: n(2)

      n = [0.6_wp, 0.8_wp]
      b = bodies(reshape([[20.0_wp, 20.0_wp], [20.0_wp, 20.0_wp] + 1.4_wp*(1 + 1.0e-9_wp)*n], &
         [2, 2]), &
                 [1.0_wp, 0.4_wp], [density, density])
      b%v(1:2, 2) = -speed*n
      call assemble(s, b, box_t(40.0_wp, periodic=.true., floor=.false.), material, 0.0_wp, dt, &
                    0.1_wp, 0, 1.0e9_wp)
   end function pair

   pure real(wp) function overlap_of(s)
      type(assembly_t), intent(in) :: s

      overlap_of = 1.4_wp - sqrt(sum((s%bodies%x(:, 2) - s%bodies%x(:, 1))**2))
   end function overlap_of

   subroutine test_hertz()
      type(assembly_t) :: s
      type(material_t) :: material
      real(wp) :: overlap, before, deepest, begin, end, speed, m, r, limit, theory
      integer :: k

      material%friction = 0
      speed = 3
      s = pair(material, speed, 1.0e-6_wp)
      m = product(s%bodies%mass)/sum(s%bodies%mass)
      r = 0.4_wp/1.4_wp
      theory = collision_time(material, r, m, speed)
      s = pair(material, speed, theory/1000)
      deepest = 0
      begin = -1
      end = -1
      overlap = overlap_of(s)
      do k = 1, 1200
         before = overlap
         call advance(s)
         overlap = overlap_of(s)
         deepest = max(deepest, overlap)
         if (before <= 0 .and. overlap > 0) begin = (k - overlap/(overlap - before))*s%dt
         if (before > 0 .and. overlap <= 0) end = (k - overlap/(overlap - before))*s%dt
      end do
      limit = (15*m*speed**2/(16*sqrt(r)*reduced_modulus(material)))**0.4_wp
      call check_close("Hertz: greatest overlap", deepest, limit, 1.0e-3_wp)
      call check_close("Hertz: duration", end - begin, theory, 1.0e-3_wp)
      call check_close("Hertz: duration, the issue's formula", end - begin, &
         2.87_wp*(m**2/(r*reduced_modulus(material)**2*speed))**0.2_wp, 1.0e-3_wp)
      call check("Hertz: no trouble", s%trouble == sound)
   end subroutine test_hertz

   subroutine test_elastic_energy()
      type(assembly_t) :: s
      type(material_t) :: material
      real(wp) :: before, momentum(2)
      integer :: k

      material%friction = 0
      s = pair(material, 5.0_wp, safe_step(material, 0.4_wp, density, 5.0_wp)/20)
      before = total_energy(s)
      momentum = matmul(s%bodies%v(1:2, :), s%bodies%mass)
      do k = 1, 2000
         call advance(s)
      end do
      call check("the spheres have parted", overlap_of(s) < 0)
      print "(a, es9.1)", "energy of an elastic collision: error", total_energy(s)/before - 1
      call check_close("an elastic collision keeps its energy", total_energy(s), before, 1.0e-6_wp)
      call check_close("and momentum along x", sum(s%bodies%v(1, :)*s%bodies%mass), momentum(1), &
         1.0e-12_wp)
      call check_close("and along z", sum(s%bodies%v(2, :)*s%bodies%mass), momentum(2), 1.0e-12_wp)
   end subroutine test_elastic_energy

   !> In terms of overlap**1.25 the collision is that of a linear oscillator, which lets go when its
   !> force is zero (Schwager & Poeschel 2007): the same restitution at every speed.
   subroutine test_restitution()
      type(assembly_t) :: s
      type(material_t) :: material
      real(wp), parameter :: share(3) = [0.02_wp, 0.1_wp, 0.4_wp], speed(2) = [0.1_wp, 10.0_wp]
      real(wp) :: root, theory, dt
      integer :: i, j, k

      material%friction = 0
      do i = 1, 3
         material%damping = share(i)
         root = sqrt(1 - share(i)**2)
         theory = exp(-share(i)/root*(pi - atan2(2*share(i)*root, 1 - 2*share(i)**2)))
         do j = 1, 2
            dt = collision_time(material, 0.4_wp/1.4_wp, 0.06_wp*4*pi/3*density, speed(j))/2000
            s = pair(material, speed(j), dt)
            do k = 1, 6000
               call advance(s)
            end do
            call check_close("restitution of the viscous part", closing_speed(s)/speed(j), &
               -theory, 1.0e-3_wp)
         end do
      end do
   end subroutine test_restitution

   pure real(wp) function closing_speed(s)
      type(assembly_t), intent(in) :: s

      closing_speed = -sum((s%bodies%v(1:2, 2) - s%bodies%v(1:2, 1))*[0.6_wp, 0.8_wp])
   end function closing_speed

   !> A sphere of radius 1 m thrown at the floor: velocity after (x, z, R omega). Steps: as many as
   !> the collision has, and half as many again.
   function bounce(material, v, steps) result(after)
      type(material_t), intent(in) :: material
      real(wp), intent(in) :: v(3)
      integer, intent(in) :: steps
      real(wp) :: after(3)
      type(assembly_t) :: s
      type(bodies_t) :: b
      integer :: k

      b = bodies(reshape([5.0_wp, 1.01_wp], [2, 1]), [1.0_wp], [density])
      b%v(:, 1) = v
      call assemble(s, b, box_t(10.0_wp), material, 0.0_wp, &
                    collision_time(material, 1.0_wp, b%mass(1), -v(2))/steps, 0.1_wp, 0, 1.0e9_wp)
      do k = 1, 3*steps + int(0.01_wp/(-v(2)*s%dt))
         call advance(s)
      end do
      call check("bounce: no trouble", s%trouble == sound)
      after = s%bodies%v(:, 1)
   end function bounce

   !> A contact that slips all the time gives dv_t = -mu dv_n, and R domega = 5/2 mu dv_n.
   subroutine test_gross_slip()
      type(material_t) :: material
      real(wp) :: after(3)

      material = material_t(young=1.0e13_wp, friction=0.2_wp)
      after = bounce(material, [6.0_wp, -2.0_wp, 0.0_wp], 500)
      call check_close("gross slip: e = 1", after(2), 2.0_wp, 1.0e-6_wp)
      call check_close("gross slip: tangential", after(1), 6 - 0.2_wp*(after(2) + 2), 1.0e-12_wp)
      call check_close("gross slip: spin", after(3), 2.5_wp*0.2_wp*(after(2) + 2), 1.0e-3_wp)
      after = bounce(material, [0.0_wp, -2.0_wp, -6.0_wp], 500)
      call check_close("gross slip: backspin drives it back", after(1), -0.2_wp*(after(2) + 2), &
         1.0e-12_wp)
      call check_close("gross slip: and loses", after(3), -6 + 2.5_wp*0.2_wp*(after(2) + 2), &
         1.0e-3_wp)
      after = bounce(material, [6.0_wp, -2.0_wp, 6.0_wp], 500)
      call check_close("rolling in, rolling out", after(1), 6.0_wp, 2.0e-3_wp)
      material%damping = 0.2_wp
      after = bounce(material, [6.0_wp, -2.0_wp, 0.0_wp], 500)
      call check("viscous: e < 0.6", after(2) > 0 .and. after(2) < 1.2_wp)
      ! the viscous force, overlap**0.25, comes before the tangential spring can follow
      call check_close("gross slip with e < 1", after(1), 6 - 0.2_wp*(after(2) + 2), 1.0e-3_wp)
   end subroutine test_gross_slip

   !> Without slip the tangential spring swings on its own. The judge integrates the same law by
   !> itself: Runge-Kutta in the overlap, the velocities and the force of the spring. Rigid bodies
   !> would roll off at 5/7 v_t; the compliance sends the surface back instead, so v_t ends between
   !> 3/7 (fully back) and 1.
   subroutine test_stick()
      type(material_t) :: material
      real(wp) :: after(3), judge(3)

      material = material_t(young=1.0e9_wp, friction=1.0e6_wp)
      after = bounce(material, [0.3_wp, -2.0_wp, 0.0_wp], 2000)
      judge = judged(material, [0.3_wp, -2.0_wp, 0.0_wp])
      call check_close("stick: normal", after(2), judge(2), 1.0e-6_wp)
      call check_close("stick: tangential", after(1), judge(1), 1.0e-4_wp)
      call check_close("stick: spin", after(3), judge(3), 1.0e-4_wp)
      call check("stick: between full return and none", after(1) > 0.3_wp*3/7 &
         .and. after(1) < 0.3_wp)
      material%young = 1.0e11_wp
      after = bounce(material, [0.3_wp, -2.0_wp, 0.0_wp], 2000)
      call check_close("stick: moment of momentum about the contact", after(1) + 0.4_wp*after(3), &
         0.3_wp, 2.0e-3_wp)
   end subroutine test_stick

   !> Velocity (x, z, R omega) after an impact on the floor without slip, R = 1 m.
   function judged(material, v) result(after)
      type(material_t), intent(in) :: material
      real(wp), intent(in) :: v(3)
      real(wp) :: after(3), y(5), k1(5), k2(5), k3(5), k4(5), dt, mass
      type(law_t) :: law
      logical :: unloads

      mass = 4*pi/3*density
      law = plane_law(material, 1.0_wp, mass)
      dt = collision_time(material, 1.0_wp, mass, -v(2))/50000
      y = [0.0_wp, -v(2), v(1), v(3), 0.0_wp]
      unloads = .false.
      do
         k1 = rates(law, mass, y, unloads)
         k2 = rates(law, mass, y + dt/2*k1, unloads)
         k3 = rates(law, mass, y + dt/2*k2, unloads)
         k4 = rates(law, mass, y + dt*k3, unloads)
         y = y + dt/6*(k1 + 2*k2 + 2*k3 + k4)
         if (y(1) <= 0 .and. y(2) < 0) exit
         ! from now on the length of the spring is kept, not its force
         if (y(2) < 0 .and. .not. unloads) then
            unloads = .true.
            y(5) = y(5)/(law%mindlin*sqrt(y(1)))
         end if
      end do
      after = [y(3), -y(2), y(4)]
   end function judged

   !> Rates of overlap, its rate, v_x, R omega, and the force of the spring along x (its length /
   !> law).
   pure function rates(law, mass, y, unloads) result(dy)
      type(law_t), intent(in) :: law
      real(wp), intent(in) :: mass, y(5)
      logical, intent(in) :: unloads
      real(wp) :: dy(5), d, stiffness, force

      d = max(y(1), 0.0_wp)
      stiffness = law%mindlin*sqrt(d)
      force = merge(stiffness, 1.0_wp, unloads)*y(5)
      dy(1) = y(2)
      dy(2) = -law%hertz*d*sqrt(d)/mass
      dy(3) = force/mass
      dy(4) = -2.5_wp*(1 - d)*force/mass
      dy(5) = -merge(1.0_wp, stiffness, unloads)*(y(3) - (1 - d)*y(4))
   end function rates

   !> A sphere thrown along the floor hops until it rolls: v = 5/7 v_t, whatever friction and
   !> damping. On average: nothing damps the tangential spring once it no longer slips.
   subroutine test_rolling_end()
      type(assembly_t) :: s
      type(bodies_t) :: b
      type(material_t) :: material
      real(wp) :: mean(4)
      integer :: k, n

      material = material_t(young=1.0e11_wp, friction=0.3_wp, damping=0.2_wp)
      b = bodies(reshape([5.0_wp, 1.1_wp], [2, 1]), [1.0_wp], [density])
      b%v(:, 1) = [7.0_wp, -1.0_wp, 0.0_wp]
      call assemble(s, b, box_t(10.0_wp), material, 9.81_wp, &
         safe_step(material, 1.0_wp, density, 2.0_wp), &
                    0.1_wp, 0, 1.0e9_wp)
      n = int(6.0_wp/s%dt)
      mean = 0
      do k = 1, n
         call advance(s)
         if (k > n/2) mean = mean + [s%bodies%v(:, 1), s%floor_force]/(n - n/2)
      end do
      call check("it has stopped hopping", abs(s%bodies%v(2, 1)) < 1.0e-4_wp)
      call check_close("it rolls", mean(3), mean(1), 1.0e-3_wp)
      call check_close("at 5/7 of its speed", mean(1), 5.0_wp, 1.0e-3_wp)
      call check_close("the floor carries it", mean(4), 9.81_wp*b%mass(1), 1.0e-4_wp)
   end subroutine test_rolling_end

   !> Halving the step quarters the error: Hertz alone, with friction, with rolling resistance. The
   !> viscous force starts as time**0.25, which allows no more than the order 1.25, and of that the
   !> slope of a few halvings shows more than 1. The grid of the step moves over the ends of the
   !> contact, so the order is that of all halvings together, not of each.
   subroutine test_order()
      type(material_t) :: material
      real(wp) :: exact(3), error(0:4), order
      integer :: k, k_law

      do k_law = 1, 4
         material = material_t(young=1.0e9_wp, friction=0)
         if (k_law >= 2) material%friction = 0.5_wp
         if (k_law == 3) material%rolling = 0.2_wp
         if (k_law == 4) material%damping = 0.1_wp
         exact = bounce(material, [1.0_wp, -2.0_wp, 0.5_wp], 50000)
         do k = 0, 4
            error(k) = sqrt(sum((bounce(material, [1.0_wp, -2.0_wp, 0.5_wp], 25*2**k) - exact)**2))
         end do
         order = log(error(0)/error(4))/log(16.0_wp)
         print "(a, i0, a, f5.2, a, *(es9.1))", "law ", k_law, ": order ", order, ", errors", error
         call check("second order in the step", order > merge(1.0_wp, 1.8_wp, k_law == 4) &
            .and. error(4) < 1.0e-3_wp)
      end do
   end subroutine test_order

   !> The same for two soft spheres that graze, spin, and turn about each other while they touch.
   subroutine test_order_of_pair()
      type(material_t) :: material
      real(wp) :: exact(6), error(0:4), order
      integer :: k, k_law

      do k_law = 1, 3
         material = material_t(young=1.0e7_wp, friction=0)
         if (k_law >= 2) material%friction = 0.6_wp
         if (k_law == 3) material%damping = 0.1_wp
         exact = graze(material, 50000)
         do k = 0, 4
            error(k) = sqrt(sum((graze(material, 25*2**k) - exact)**2))
         end do
         order = log(error(0)/error(4))/log(16.0_wp)
         print "(a, i0, a, f5.2, a, *(es9.1))", "pair, law ", k_law, ": order ", order, &
            ", errors", error
         call check("second order in the step, two spheres", &
            order > merge(1.0_wp, 1.8_wp, k_law == 3) &
                    .and. error(4) < 1.0e-3_wp)
      end do
   end subroutine test_order_of_pair

   !> Velocities (x, z, spin) of two spheres after they met off centre; about `steps` steps of
   !> contact.
   function graze(material, steps) result(after)
      type(material_t), intent(in) :: material
      integer, intent(in) :: steps
      real(wp) :: after(6), time
      type(assembly_t) :: s
      type(bodies_t) :: b
      integer :: k

      b = bodies(reshape([20.0_wp, 20.0_wp, 21.3_wp, 20.8_wp], [2, 2]), [1.0_wp, 0.5_wp], &
         [density, density])
      b%v(:, 1) = [1.0_wp, 0.5_wp, 0.3_wp]
      b%v(:, 2) = [-2.0_wp, 0.5_wp, -0.2_wp]
      time = collision_time(material, 1/3.0_wp, product(b%mass)/sum(b%mass), 2.0_wp)
      call assemble(s, b, box_t(40.0_wp, floor=.false.), material, 0.0_wp, time/steps, 0.3_wp, 0, &
         1.0e9_wp)
      do k = 1, 3*steps
         call advance(s)
      end do
      call check("graze: no trouble", s%trouble == sound)
      after = [s%bodies%v(:, 1), s%bodies%v(:, 2)]
   end function graze

   !> Over any path of overlap and slip the contact gives back no more than it was given.
   subroutine test_no_gain()
      type(material_t) :: material
      type(law_t) :: law
      type(touch_t) :: touch, before
      real(wp) :: d, d_before, normal, normal_before, slip, turn, loss, least, scale, u(4)
      real(wp), parameter :: dt = 1.0e-6_wp
      integer :: k

      material = material_t(friction=0.4_wp, rolling=0.3_wp)
      law = pair_law(material, 1.0_wp, 1.0_wp, 0.5_wp, 1.0_wp)
      d = 1.0e-3_wp
      u = 0
      least = 0
      loss = 0
      scale = 0
      normal = law%hertz*d*sqrt(d)
      touch%root = sqrt(d)
      do k = 0, 40000
         if (mod(k, 50) == 0) &
            u = uniform(four(random_words(random_key(7_i8), 1_i8, 1_i8, int(k, i8), 0_i8)))
         before = touch
         d_before = d
         normal_before = normal
         d = max(1.0e-5_wp, min(2.0e-3_wp, d + (u(1) - 0.5_wp)*1.0e-5_wp))
         slip = (u(2) - 0.5_wp)*10
         turn = (u(3) - 0.5_wp)*20
         call press(law, d, (d - d_before)/dt, slip, turn, dt, touch, normal)
         loss = 0.5_wp*(normal + normal_before)*(d - d_before) &
            - 0.5_wp*(touch%shear + before%shear)*slip*dt &
                - 0.5_wp*(touch%moment + before%moment)*turn*dt - stored_energy(law, touch) &
                + stored_energy(law, before)
         least = min(least, loss)
         scale = max(scale, stored_energy(law, touch))
      end do
      call check("no step of a contact yields energy", least > -1.0e-6_wp*scale)
      call check("the path was no trifle", &
         scale > 0.1_wp*0.4_wp*law%hertz*(2.0e-3_wp)**2*sqrt(2.0e-3_wp))
   end subroutine test_no_gain

   pure function four(word)
      integer(i8), intent(in) :: word(12)
      integer(i8) :: four(4)

      four = word(:4)
   end function four

   !> The rolling spring: stiffness 2.25 k_n (rolling R*)**2 up to the moment rolling R* F, and
   !> back.
   subroutine test_rolling()
      type(material_t) :: material
      type(law_t) :: law
      type(touch_t) :: touch
      real(wp), parameter :: d = 1.0e-3_wp, angle = 1.0e-6_wp
      real(wp) :: normal, stiffness
      integer :: k

      material = material_t(friction=0.5_wp, rolling=0.2_wp)
      law = pair_law(material, 1.0_wp, 1.0_wp, 1.0_wp, 1.0_wp)
      call press(law, d, 0.0_wp, 0.0_wp, 0.0_wp, 1.0_wp, touch, normal)
      call check_close("rolling: nothing at rest", touch%moment, 0.0_wp, 0.0_wp)
      call press(law, d, 0.0_wp, 0.0_wp, angle, 1.0_wp, touch, normal)
      stiffness = 2.25_wp*2*reduced_modulus(material)*sqrt(0.5_wp*d)*(0.2_wp*0.5_wp)**2
      call check_close("rolling: stiffness", touch%moment, -stiffness*angle, 1.0e-12_wp)
      do k = 1, 10000
         call press(law, d, 0.0_wp, 0.0_wp, angle, 1.0_wp, touch, normal)
      end do
      call check_close("rolling: greatest moment", touch%moment, -0.2_wp*0.5_wp*normal, 1.0e-12_wp)
      call press(law, d, 0.0_wp, 0.0_wp, -angle, 1.0_wp, touch, normal)
      call check_close("rolling: and back", touch%moment, -0.2_wp*0.5_wp*normal &
         + stiffness*angle, 1.0e-12_wp)
   end subroutine test_rolling

   subroutine test_frictionless_spin()
      real(wp) :: after(3)

      after = bounce(material_t(friction=0), [6.0_wp, -2.0_wp, 3.0_wp], 100)
      call check_close("without friction: v_x", after(1), 6.0_wp, 0.0_wp)
      call check_close("without friction: spin", after(3), 3.0_wp, 0.0_wp)
   end subroutine test_frictionless_spin

   !> The Rayleigh wave is slower than the shear wave by (0.862 + 1.14 nu)/(1 + nu) (Viktorov 1967).
   subroutine test_times()
      type(material_t) :: material
      real(wp) :: shear_speed
      integer :: k

      do k = 0, 4
         material%poisson = 0.1_wp*k
         shear_speed = sqrt(material%young/(2*(1 + material%poisson)*density))
         call check_close("Rayleigh time", rayleigh_time(material, 0.3_wp, density), &
            0.3_wp*pi/(shear_speed*(0.862_wp + 1.14_wp*material%poisson)/(1 + material%poisson)), &
            2.0e-2_wp)
      end do
   end subroutine test_times

   subroutine test_refusals()
      type(error_t), allocatable :: error

      call check_material(material_t(), error)
      call check("the default material is one", .not. allocated(error))
      call check_material(material_t(young=0), error)
      call check("no stiffness is refused", allocated(error))
      call check_material(material_t(poisson=0.6_wp), error)
      call check("poisson above 0.5 is refused", allocated(error))
      call check_material(material_t(friction=-0.1_wp), error)
      call check("negative friction is refused", allocated(error))
   end subroutine test_refusals
end program test_lab_contact
