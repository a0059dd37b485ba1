! SPDX-License-Identifier: BSD-3-Clause
!> Contact model and time stepping compared with theory: Hertz's collision, restitution of the viscous part, oblique
!> impacts on a plane and of a pair from gross slip to stick, springs that rotate with the contact, no gain of energy,
!> second order in the step.
program test_lab_contact
   use rockfall_kinds, only: wp, i8
   use rockfall_error, only: error_t
   use rockfall_math, only: pi
   use rockfall_random, only: random_key, random_words, uniform
   use lab_contact, only: material_t, law_t, touch_t, pair_law, plane_law, press, &
      stored_energy, check_material, reduced_modulus, cross, in_plane, collision_time, rayleigh_time
   use lab_bodies, only: bodies_t, bodies
   use lab_neighbours, only: box_t
   use lab_step, only: assembly_t, assemble, advance, shorten_step, lengthen_step, total_energy, safe_step, sound
   use check_m, only: check, check_close, finish
   implicit none

   real(wp), parameter :: density = 2650
   real(wp), parameter :: slanted(3) = [0.48_wp, 0.6_wp, 0.64_wp]  !! unit vector

   call test_hertz()
   call test_elastic_energy()
   call test_adaptive_step()
   call test_restitution()
   call test_gross_slip()
   call test_gross_slip_of_pair()
   call test_stick()
   call test_stick_of_pair()
   call test_rolling_end()
   call test_order()
   call test_order_of_pair()
   call test_turning_springs()
   call test_rigid_rotation()
   call test_no_gain()
   call test_rolling()
   call test_frictionless_spin()
   call test_times()
   call test_refusals()
   call finish()

contains

   !> Two spheres of radius 1 m and 0.4 m, about to touch along a slanted line.
   function pair(material, v, dt) result(s)
      type(material_t), intent(in) :: material
      real(wp), intent(in) :: v(6, 2), dt
      type(assembly_t) :: s
      type(bodies_t) :: b
      real(wp), parameter :: x(3) = [20.0_wp, 21.0_wp, 22.0_wp]

      b = bodies(reshape([x, x + 1.4_wp*(1 + 1.0e-9_wp)*slanted], [3, 2]), [1.0_wp, 0.4_wp], &
                 [density, density])
      b%v = v
      call assemble(s, b, box_t(40.0_wp, floor=.false.), material, 0.0_wp, dt, 0.1_wp, 0, 1.0e9_wp)
   end function pair

   !> Velocities of a head-on collision.
   pure function head_on(speed) result(v)
      real(wp), intent(in) :: speed
      real(wp) :: v(6, 2)

      v = 0
      v(1:3, 2) = -speed*slanted
   end function head_on

   pure real(wp) function overlap_of(s)
      type(assembly_t), intent(in) :: s

      overlap_of = 1.4_wp - sqrt(sum((s%bodies%x(:, 2) - s%bodies%x(:, 1))**2))
   end function overlap_of

   !> Reduced mass of the pair [kg].
   pure real(wp) function reduced_mass()
      reduced_mass = 4*pi/3*density*0.064_wp/1.064_wp
   end function reduced_mass

   subroutine test_hertz()
      type(assembly_t) :: s
      type(material_t) :: material
      real(wp) :: overlap, before, deepest, begin, end, r, limit, theory
      real(wp), parameter :: speed = 3
      integer :: k

      material%friction = 0
      r = 0.4_wp/1.4_wp
      theory = collision_time(material, r, reduced_mass(), speed)
      s = pair(material, head_on(speed), theory/1000)
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
      limit = (15*reduced_mass()*speed**2/(16*sqrt(r)*reduced_modulus(material)))**0.4_wp
      call check_close("Hertz: max overlap", deepest, limit, 1.0e-3_wp)
      call check_close("Hertz: duration", end - begin, theory, 1.0e-3_wp)
      call check_close("Hertz: duration, the textbook's formula", end - begin, &
         2.87_wp*(reduced_mass()**2/(r*reduced_modulus(material)**2*speed))**0.2_wp, 1.0e-3_wp)
      call check("Hertz: no trouble", s%trouble == sound)
   end subroutine test_hertz

   subroutine test_elastic_energy()
      type(assembly_t) :: s
      type(material_t) :: material
      real(wp) :: before, momentum(3), after(3)
      integer :: k

      material%friction = 0
      s = pair(material, head_on(5.0_wp), safe_step(material, 0.4_wp, density, 5.0_wp)/20)
      before = total_energy(s)
      momentum = matmul(s%bodies%v(1:3, :), s%bodies%mass)
      do k = 1, 2000
         call advance(s)
      end do
      call check("the spheres have parted", overlap_of(s) < 0)
      print "(a, es9.1)", "energy of an elastic collision: error", total_energy(s)/before - 1
      call check_close("an elastic collision keeps its energy", total_energy(s), before, 1.0e-6_wp)
      after = matmul(s%bodies%v(1:3, :), s%bodies%mass)
      do k = 1, 3
         call check_close("and momentum", after(k), momentum(k), 1.0e-12_wp)
      end do
   end subroutine test_elastic_energy

   !> A step that is too long for the collision is shortened within it, at the cost of some energy, and lengthened
   !> afterwards.
   subroutine test_adaptive_step()
      type(assembly_t) :: s
      type(material_t) :: material
      real(wp) :: before, first, shortest
      integer :: k

      material%friction = 0
      s = pair(material, head_on(5.0_wp), 2.8_wp*safe_step(material, 0.4_wp, density, 5.0_wp))
      first = s%dt
      shortest = first
      before = total_energy(s)
      do k = 1, 100
         call advance(s)
         call shorten_step(s)
         shortest = min(shortest, s%dt)
         if (mod(k, 4) == 0) call lengthen_step(s)
      end do
      print "(a, es9.1, a, f5.2)", "adaptive step: error of the energy", total_energy(s)/before - 1, &
         ", shortest step", shortest/first
      call check("the spheres have parted, without trouble", overlap_of(s) < 0 .and. s%trouble == sound)
      call check("the step was shortened in the collision", shortest < 0.8_wp*first)
      call check("and lengthened after it, to at most the first", s%dt > 0.9_wp*first .and. s%dt <= first)
      call check_close("the energy is nearly kept", total_energy(s), before, 5.0e-2_wp)
   end subroutine test_adaptive_step

   !> In terms of overlap**1.25, the collision is that of a linear oscillator that is released at zero force (Schwager &
   !> Poeschel 2007): the restitution does not depend on speed.
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
            dt = collision_time(material, 0.4_wp/1.4_wp, reduced_mass(), speed(j))/2000
            s = pair(material, head_on(speed(j)), dt)
            do k = 1, 6000
               call advance(s)
            end do
            associate (v => s%bodies%v(1:3, :))
               call check_close("restitution of the viscous part", &
                  dot_product(v(:, 2) - v(:, 1), slanted)/speed(j), theory, 1.0e-3_wp)
            end associate
         end do
      end do
   end subroutine test_restitution

   !> Velocity and spin of a sphere of radius 1 m after it is thrown at the floor. `steps` is the number of steps of the
   !> collision; half as many follow.
   function bounce(material, v, steps) result(after)
      type(material_t), intent(in) :: material
      real(wp), intent(in) :: v(6)
      integer, intent(in) :: steps
      real(wp) :: after(6)
      type(assembly_t) :: s
      type(bodies_t) :: b
      integer :: k

      b = bodies(reshape([5.0_wp, 5.0_wp, 1.01_wp], [3, 1]), [1.0_wp], [density])
      b%v(:, 1) = v
      call assemble(s, b, box_t(10.0_wp), material, 0.0_wp, &
                    collision_time(material, 1.0_wp, b%mass(1), -v(3))/steps, 0.1_wp, 0, 1.0e9_wp)
      do k = 1, 3*steps + int(0.01_wp/(-v(3)*s%dt))
         call advance(s)
      end do
      call check("bounce: no trouble", s%trouble == sound)
      after = s%bodies%v(:, 1)
   end function bounce

   !> Velocities (6) from (V_t, V_n, W) for a heading, R = 1 m; `along` is the inverse, where `rest` has the other
   !> components.
   pure function headed(v, angle) result(six)
      real(wp), intent(in) :: v(3), angle
      real(wp) :: six(6)

      six = [v(1)*cos(angle), v(1)*sin(angle), v(2), -v(3)*sin(angle), v(3)*cos(angle), 0.0_wp]
   end function headed

   subroutine along(six, angle, v, rest)
      real(wp), intent(in) :: six(6), angle
      real(wp), intent(out) :: v(3), rest

      v = [six(1)*cos(angle) + six(2)*sin(angle), six(3), six(5)*cos(angle) - six(4)*sin(angle)]
      rest = maxval(abs(six - headed(v, angle)))
   end subroutine along

   !> A contact that always slips gives dv_t = -mu dv_n and R domega = 5/2 mu dv_n along its slip, in any direction.
   subroutine test_gross_slip()
      type(material_t) :: material
      real(wp) :: after(3), rest, angle, six(6), slip(2)
      integer :: k

      do k = 0, 4
         angle = 0.25_wp*k*pi + merge(0.3_wp, 0.0_wp, k > 2)
         material = material_t(young=1.0e13_wp, friction=0.2_wp)
         call along(bounce(material, headed([6.0_wp, -2.0_wp, 0.0_wp], angle), 500), angle, after, rest)
         call check_close("gross slip: e = 1", after(2), 2.0_wp, 1.0e-6_wp)
         call check_close("gross slip: tangential", after(1), 6 - 0.2_wp*(after(2) + 2), 1.0e-12_wp)
         call check_close("gross slip: spin", after(3), 2.5_wp*0.2_wp*(after(2) + 2), 1.0e-3_wp)
         call check_close("gross slip: straight on", rest, 0.0_wp, 1.0e-12_wp)
         call along(bounce(material, headed([0.0_wp, -2.0_wp, -6.0_wp], angle), 500), angle, after, rest)
         call check_close("gross slip: backspin drives it back", after(1), -0.2_wp*(after(2) + 2), &
            1.0e-12_wp)
         call check_close("gross slip: and loses", after(3), -6 + 2.5_wp*0.2_wp*(after(2) + 2), &
            1.0e-3_wp)
         call along(bounce(material, headed([6.0_wp, -2.0_wp, 6.0_wp], angle), 500), angle, after, rest)
         call check_close("rolling in, rolling out", after(1), 6.0_wp, 2.0e-3_wp)
         material%damping = 0.2_wp
         call along(bounce(material, headed([6.0_wp, -2.0_wp, 0.0_wp], angle), 500), angle, after, rest)
         call check("viscous: e < 0.6", after(2) > 0 .and. after(2) < 1.2_wp)
         ! the viscous force grows as overlap**0.25, and acts before the tangential spring can follow
         call check_close("gross slip with e < 1", after(1), 6 - 0.2_wp*(after(2) + 2), 1.0e-3_wp)
      end do
      ! velocity along x, spin about x: the surface slips along (0.6, 0.8), and the spin about z is unchanged
      material%damping = 0
      six = bounce(material, [6.0_wp, 0.0_wp, -2.0_wp, 8.0_wp, 0.0_wp, 3.0_wp], 500)
      slip = [0.6_wp, 0.8_wp]
      call check_close("side spin: v_x", six(1), 6 - 0.2_wp*0.6_wp*(six(3) + 2), 1.0e-3_wp)
      call check_close("side spin: v_y", six(2), -0.2_wp*0.8_wp*(six(3) + 2), 1.0e-3_wp)
      call check_close("side spin: about x", six(4), 8 - 2.5_wp*0.2_wp*0.8_wp*(six(3) + 2), 1.0e-3_wp)
      call check_close("side spin: about y", six(5), 2.5_wp*0.2_wp*0.6_wp*(six(3) + 2), 1.0e-3_wp)
      call check_close("side spin: about z", six(6), 3.0_wp, 0.0_wp)
   end subroutine test_gross_slip

   !> Velocities before and after an impact of the spheres of `pair` at 2 m/s, with an additional velocity across the
   !> line of centres, and spins about all axes.
   subroutine hit(material, across, before, after)
      type(material_t), intent(in) :: material
      real(wp), intent(in) :: across(3)
      real(wp), intent(out) :: before(6, 2), after(6, 2)
      type(assembly_t) :: s
      integer :: k

      before = head_on(2.0_wp)
      before(1:3, 2) = before(1:3, 2) + in_plane(across, slanted)
      before(4:6, 1) = [1.0_wp, -0.5_wp, 2.0_wp]
      before(4:6, 2) = [-2.0_wp, 3.0_wp, 1.5_wp]
      s = pair(material, before, collision_time(material, 0.4_wp/1.4_wp, reduced_mass(), 2.0_wp)/2000)
      do k = 1, 3000
         call advance(s)
      end do
      call check("pair: no trouble", s%trouble == sound)
      after = s%bodies%v
   end subroutine hit

   !> Tangential velocity of the first surface relative to the second, for rigid spheres.
   pure function slip_of(v) result(slip)
      real(wp), intent(in) :: v(6, 2)
      real(wp) :: slip(3)

      slip = in_plane(v(1:3, 1) - v(1:3, 2) + cross(v(4:6, 1) + 0.4_wp*v(4:6, 2), slanted), slanted)
   end function slip_of

   !> Check that momentum is conserved, and that the impulse, which acts on the line of centres, changes the spins.
   subroutine check_impulse(name, before, after, impulse)
      character(len=*), intent(in) :: name
      real(wp), intent(in) :: before(6, 2), after(6, 2)
      real(wp), intent(out) :: impulse(3)
      real(wp) :: mass(2), turned(3)

      mass = 4*pi/3*density*[1.0_wp, 0.064_wp]
      impulse = mass(1)*(after(1:3, 1) - before(1:3, 1))
      call check_close(name//": momentum", &
         maxval(abs(mass(2)*(after(1:3, 2) - before(1:3, 2)) + impulse))/sqrt(sum(impulse**2)), &
         0.0_wp, 1.0e-10_wp)
      turned = cross(slanted, impulse)/(0.4_wp*mass(1))
      call check_close(name//": spin of the first", maxval(abs(after(4:6, 1) - before(4:6, 1) - turned)) &
         /sqrt(sum(turned**2)), 0.0_wp, 3.0e-3_wp)
      turned = cross(slanted, impulse)/(0.4_wp*mass(2)*0.4_wp)
      call check_close(name//": spin of the second", &
         maxval(abs(after(4:6, 2) - before(4:6, 2) - turned))/sqrt(sum(turned**2)), 0.0_wp, 3.0e-3_wp)
   end subroutine check_impulse

   subroutine test_gross_slip_of_pair()
      real(wp) :: before(6, 2), after(6, 2), slip(3), impulse(3), theory(3)
      integer :: k

      do k = 1, 3
         call hit(material_t(young=1.0e15_wp, friction=0.2_wp), &
            8*[real(wp) :: merge(1, 0, k == 1), merge(1, 0, k == 2), merge(1, 0, k == 3)], before, after)
         call check_impulse("gross slip of a pair", before, after, impulse)
         slip = slip_of(before)
         theory = -2*reduced_mass()*2*(slanted + 0.2_wp*slip/sqrt(sum(slip**2)))
         call check_close("gross slip of a pair: impulse", maxval(abs(impulse - theory)) &
            /sqrt(sum(theory**2)), 0.0_wp, 1.0e-3_wp)
      end do
   end subroutine test_gross_slip_of_pair

   !> Without slip the tangential spring oscillates freely. The reference integrates the same equations independently,
   !> by Runge-Kutta in overlap, velocities and spring force. Rigid bodies would leave rolling at 5/7 v_t; with
   !> compliance the surface is driven back, so v_t ends between 3/7 (fully back) and 1. The two directions in the plane
   !> are independent.
   subroutine test_stick()
      type(material_t) :: material
      real(wp) :: six(6), judge(3), after(3), rest

      material = material_t(young=1.0e9_wp, friction=1.0e6_wp)
      six = bounce(material, [0.3_wp, 0.2_wp, -2.0_wp, 0.4_wp, 0.0_wp, 0.0_wp], 2000)
      judge = judged(material, [0.3_wp, -2.0_wp, 0.0_wp])
      call check_close("stick: normal", six(3), judge(2), 1.0e-6_wp)
      call check_close("stick: along x", six(1), judge(1), 1.0e-4_wp)
      call check_close("stick: spin about y", six(5), judge(3), 1.0e-4_wp)
      call check("stick: between full return and none", six(1) > 0.3_wp*3/7 .and. six(1) < 0.3_wp)
      judge = judged(material, [0.2_wp, -2.0_wp, -0.4_wp])
      call check_close("stick: along y", six(2), judge(1), 1.0e-4_wp)
      call check_close("stick: spin about x", -six(4), judge(3), 1.0e-4_wp)
      material%young = 1.0e11_wp
      call along(bounce(material, headed([0.3_wp, -2.0_wp, 0.0_wp], 2.0_wp), 2000), 2.0_wp, after, rest)
      call check_close("stick: moment of momentum about the contact", after(1) + 0.4_wp*after(3), &
         0.3_wp, 2.0e-3_wp)
      call check_close("stick: straight on", rest, 0.0_wp, 1.0e-10_wp)
   end subroutine test_stick

   !> For stiff bodies, the ratio of the slip after the impact to that before depends only on Poisson's ratio, and
   !> equals that of a sphere on the floor.
   subroutine test_stick_of_pair()
      type(material_t) :: material
      real(wp) :: before(6, 2), after(6, 2), judge(3), impulse(3), slip(3)

      material = material_t(young=1.0e13_wp, friction=1.0e6_wp)
      judge = judged(material, [1.0_wp, -2.0_wp, 0.0_wp])
      call hit(material, [0.5_wp, -0.3_wp, 0.4_wp], before, after)
      call check_impulse("stick of a pair", before, after, impulse)
      slip = (judge(1) - judge(3))*slip_of(before)
      call check_close("stick of a pair: slip", maxval(abs(slip_of(after) - slip))/sqrt(sum(slip**2)), &
         0.0_wp, 3.0e-3_wp)
   end subroutine test_stick_of_pair

   !> Reference (V_t, V_n, W) after an impact on the floor without slip, R = 1 m.
   function judged(material, v) result(after)
      type(material_t), intent(in) :: material
      real(wp), intent(in) :: v(3)
      real(wp) :: after(3), y(5), k1(5), k2(5), k3(5), k4(5), dt, mass
      type(law_t) :: law
      logical :: unloads

      mass = 4*pi/3*density
      law = plane_law(material, 1.0_wp, mass, 0.0_wp)
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
         ! from here on, the length of the spring is kept, not its force
         if (y(2) < 0 .and. .not. unloads) then
            unloads = .true.
            y(5) = y(5)/(law%mindlin*sqrt(y(1)))
         end if
      end do
      after = [y(3), -y(2), y(4)]
   end function judged

   !> Rates of change of the overlap, its rate, V_t, W, and the spring force along V_t (or its length over law).
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

   !> A sphere thrown along the floor hops until it rolls at v = 5/7 v_t, for any friction and damping; only on average,
   !> because nothing damps the tangential spring without slip.
   subroutine test_rolling_end()
      type(assembly_t) :: s
      type(bodies_t) :: b
      type(material_t) :: material
      real(wp) :: mean(7), v(3), rest
      real(wp), parameter :: heading = 2.2_wp
      integer :: k, n

      material = material_t(young=1.0e11_wp, friction=0.3_wp, damping=0.2_wp)
      b = bodies(reshape([5.0_wp, 5.0_wp, 1.1_wp], [3, 1]), [1.0_wp], [density])
      b%v(:, 1) = headed([7.0_wp, -1.0_wp, 0.0_wp], heading)
      call assemble(s, b, box_t(10.0_wp), material, 9.81_wp, safe_step(material, 1.0_wp, density, 2.0_wp), &
                    0.1_wp, 0, 1.0e9_wp)
      n = int(6.0_wp/s%dt)
      mean = 0
      do k = 1, n
         call advance(s)
         if (k > n/2) mean = mean + [s%bodies%v(:, 1), s%floor_force]/(n - n/2)
      end do
      call along(mean(:6), heading, v, rest)
      call check("it has stopped hopping", abs(s%bodies%v(3, 1)) < 1.0e-4_wp)
      call check_close("it rolls", v(3), v(1), 1.0e-3_wp)
      call check_close("at 5/7 of its speed", v(1), 5.0_wp, 1.0e-3_wp)
      call check_close("straight on", rest, 0.0_wp, 1.0e-3_wp)
      call check_close("the floor carries it", mean(7), 9.81_wp*b%mass(1), 1.0e-4_wp)
   end subroutine test_rolling_end

   !> Halving the step quarters the error: Hertz alone, with friction, with rolling resistance, without slip. The
   !> viscous force starts as time**0.25, which limits the order to 1.25; over a few halvings the measured order is
   !> above 1. If a force rotates while it slips, the order is 1. Steps do not coincide with the ends of the contact, so
   !> the order is measured over all halvings together.
   subroutine test_order()
      type(material_t) :: material
      real(wp) :: exact(6), error(0:6), order, v(6)
      integer :: k, k_law

      do k_law = 1, 6
         v = headed([1.0_wp, -2.0_wp, 0.5_wp], 0.7_wp)
         material = material_t(young=1.0e9_wp, friction=0)
         if (k_law >= 2) material%friction = 0.5_wp
         if (k_law == 3) material%rolling = 0.2_wp
         if (k_law == 4) material%damping = 0.1_wp
         if (k_law >= 5) v(4:6) = [0.6_wp, 0.5_wp, 3.0_wp]
         if (k_law == 6) material%friction = 100
         exact = bounce(material, v, 50000)
         do k = 0, 6
            error(k) = sqrt(sum((bounce(material, v, 25*2**k) - exact)**2))
         end do
         order = log(error(0)/error(6))/log(64.0_wp)
         print "(a, i0, a, f5.2, a, *(es9.1))", "law ", k_law, ": order ", order, ", errors", error
         call check("second order in the step", order > merge(1.0_wp, 1.7_wp, any(k_law == [4, 5])) &
            .and. error(4) < 1.0e-3_wp)
      end do
   end subroutine test_order

   !> Order for two soft spheres that graze, spin, and rotate about each other in contact, out of any coordinate plane.
   subroutine test_order_of_pair()
      type(material_t) :: material
      real(wp) :: exact(12), error(0:6), order
      integer :: k, k_law

      do k_law = 1, 5
         material = material_t(young=1.0e7_wp, friction=0)
         if (k_law >= 2) material%friction = merge(100.0_wp, 0.6_wp, k_law < 4)
         if (k_law == 3) material%rolling = 0.2_wp
         if (k_law == 4) material%damping = 0.1_wp
         exact = graze(material, 50000)
         do k = 0, 6
            error(k) = sqrt(sum((graze(material, 25*2**k) - exact)**2))
         end do
         order = log(error(0)/error(6))/log(64.0_wp)
         print "(a, i0, a, f5.2, a, *(es9.1))", "pair, law ", k_law, ": order ", order, &
            ", errors", error
         call check("second order in the step, two spheres", &
            order > merge(1.7_wp, 1.0_wp, k_law < 4) .and. error(4) < 1.0e-3_wp)
      end do
   end subroutine test_order_of_pair

   !> Velocities and spins of two spheres after an off-centre contact of about `steps` steps.
   function graze(material, steps) result(after)
      type(material_t), intent(in) :: material
      integer, intent(in) :: steps
      real(wp) :: after(12), time
      type(assembly_t) :: s
      type(bodies_t) :: b
      integer :: k

      b = bodies(reshape([20.0_wp, 20.0_wp, 20.0_wp, 21.3_wp, 20.5_wp, 20.6_wp], [3, 2]), &
         [1.0_wp, 0.5_wp], [density, density])
      b%v(:, 1) = [1.0_wp, 0.5_wp, -0.2_wp, 1.3_wp, -0.4_wp, 0.6_wp]
      b%v(:, 2) = [-2.0_wp, -1.0_wp, 1.5_wp, 1.2_wp, 2.0_wp, -1.5_wp]
      time = collision_time(material, 1/3.0_wp, product(b%mass)/sum(b%mass), 2.0_wp)
      call assemble(s, b, box_t(40.0_wp, floor=.false.), material, 0.0_wp, time/steps, 0.3_wp, 0, &
         1.0e9_wp)
      do k = 1, 3*steps
         call advance(s)
      end do
      call check("graze: no trouble", s%trouble == sound)
      after = [s%bodies%v(:, 1), s%bodies%v(:, 2)]
   end function graze

   !> Springs of a contact that rotates in any manner keep their lengths and stay in the plane; about a fixed normal
   !> they turn by the angle.
   subroutine test_turning_springs()
      type(touch_t) :: touch
      type(law_t) :: law
      real(wp), parameter :: none(3) = 0, d = 1.0e-3_wp
      real(wp) :: n(3), rotation(3), length, longest, leaning, normal
      integer :: k

      law = pair_law(material_t(friction=1.0e9_wp), 1.0_wp, 1.0_wp, 1.0_wp, 1.0_wp, 1.0_wp)
      touch%root = sqrt(d)
      touch%shear = in_plane([1.0_wp, 2.0_wp, -0.5_wp], slanted)
      touch%moment = 2*cross(slanted, touch%shear)
      length = sqrt(sum(touch%shear**2))
      longest = 0
      leaning = 0
      n = slanted
      do k = 1, 1000
         rotation = 0.01_wp*(uniform3(k) - 0.5_wp)
         n = turned(n, rotation/sqrt(sum(rotation**2)), sqrt(sum(rotation**2)))
         call press(law, n, d, 0.0_wp, none, none, rotation, 1.0_wp, touch, normal)
         longest = max(longest, abs(sqrt(sum(touch%shear**2)) - length), &
            abs(sqrt(sum(touch%moment**2)) - 2*length))
         leaning = max(leaning, abs(dot_product(n, touch%shear)), &
            maxval(abs(touch%moment - 2*cross(n, touch%shear))))
      end do
      call check("the normal has gone far", dot_product(n, slanted) < 0.999_wp)
      call check_close("springs keep their lengths", longest, 0.0_wp, 1.0e-6_wp)
      call check_close("and their place in the plane", leaning, 0.0_wp, 1.0e-5_wp)
      n = [1.0_wp, 0.0_wp, 0.0_wp]
      touch%shear = [0.0_wp, 2.0_wp, 0.0_wp]
      touch%moment = 0
      do k = 1, 1000
         call press(law, n, d, 0.0_wp, none, none, 0.001_wp*n, 1.0_wp, touch, normal)
      end do
      call check_close("they turn, anticlockwise", atan2(touch%shear(3), touch%shear(2)), 1.0_wp, 1.0e-6_wp)
   end subroutine test_turning_springs

   pure function uniform3(k) result(u)
      integer, intent(in) :: k
      real(wp) :: u(3), all(4)

      all = uniform(random_words(random_key(8_i8), 1_i8, 1_i8, int(k, i8), 0_i8))
      u = all(:3)
   end function uniform3

   !> Two spheres rotate as one body about any axis: after a full turn the spring is unchanged.
   subroutine test_rigid_rotation()
      real(wp) :: error(2), grown(2)
      real(wp), parameter :: axes(3, 3) = reshape([slanted, [0.0_wp, 0.0_wp, 1.0_wp], &
         [-0.6_wp, 0.0_wp, 0.8_wp]], [3, 3])
      integer :: k

      do k = 1, 3
         call turn_round(axes(:, k), 1000, error(1), grown(1))
         call turn_round(axes(:, k), 4000, error(2), grown(2))
         print "(a, 4es9.1)", "a full turn: error of the spring, growth of its energy:", error, grown
         call check("a full turn changes nothing", error(1) < 0.05_wp &
            .and. error(2) < 0.07_wp*error(1))
         call check("and makes no energy", grown(2) < 0.07_wp*abs(grown(1)))
      end do
   end subroutine test_rigid_rotation

   !> One full turn of two heavy spheres held together: relative change of the spring force, and growth of the stored
   !> energy.
   subroutine turn_round(axis, steps, error, grown)
      real(wp), intent(in) :: axis(3)
      integer, intent(in) :: steps
      real(wp), intent(out) :: error, grown
      type(assembly_t) :: s
      type(bodies_t) :: b
      type(material_t) :: material
      real(wp) :: arm(3), shear(3), x(3, 0:1), before
      integer :: k

      material = material_t(young=1.0e7_wp, friction=1.0e3_wp)
      arm = 1.395_wp*[0.8_wp, 0.0_wp, 0.6_wp]
      b = bodies(reshape([spread(20.0_wp, 1, 3), 20 + arm], [3, 2]), [1.0_wp, 0.4_wp], &
         [1.0e20_wp, 1.0e20_wp])
      call assemble(s, b, box_t(40.0_wp, floor=.false.), material, 0.0_wp, 2*pi/steps, 3.0_wp, 0, &
         huge(1.0_wp))
      shear = in_plane([300.0_wp, 200.0_wp, 100.0_wp], arm/1.395_wp)
      s%touch(1)%shear = shear
      before = stored_energy(s%law(1), s%touch(1))
      do k = 1, steps
         x(:, 0) = 20 + turned(arm, axis, (k - 1)*s%dt)
         x(:, 1) = 20 + turned(arm, axis, k*s%dt)
         s%bodies%x = reshape([spread(20.0_wp, 1, 3), x(:, 0)], [3, 2])
         s%bodies%v(:, 1) = [spread(0.0_wp, 1, 3), axis]
         s%bodies%v(:, 2) = [(x(:, 1) - x(:, 0))/s%dt, axis]
         call advance(s)
      end do
      error = sqrt(sum((s%touch(1)%shear - shear)**2)/sum(shear**2))
      grown = stored_energy(s%law(1), s%touch(1))/before - 1
   end subroutine turn_round

   !> Vector rotated about an axis (Rodrigues).
   pure function turned(v, axis, angle)
      real(wp), intent(in) :: v(3), axis(3), angle
      real(wp) :: turned(3)

      turned = cos(angle)*v + sin(angle)*cross(axis, v) + (1 - cos(angle))*dot_product(axis, v)*axis
   end function turned

   !> For any path of overlap, slip and rotation, a contact returns no more energy than it received.
   subroutine test_no_gain()
      type(material_t) :: material
      type(law_t) :: law
      type(touch_t) :: touch, before
      real(wp) :: d, d_before, normal, normal_before, slip(3), turn(3), loss, lowest, scale, u(8)
      real(wp), parameter :: dt = 1.0e-6_wp
      integer(i8) :: draw
      integer :: k

      material = material_t(friction=0.4_wp)
      law = pair_law(material, 1.0_wp, 1.0_wp, 0.5_wp, 1.0_wp, 0.3_wp)
      d = 1.0e-3_wp
      u = 0
      lowest = 0
      scale = 0
      normal = law%hertz*d*sqrt(d)
      touch%root = sqrt(d)
      do k = 0, 40000
         if (mod(k, 50) == 0) &
            u = uniform([(random_words(random_key(7_i8), 1_i8, 1_i8, int(k, i8), draw), draw=0, 1)])
         before = touch
         d_before = d
         normal_before = normal
         d = max(1.0e-5_wp, min(2.0e-3_wp, d + (u(1) - 0.5_wp)*1.0e-5_wp))
         slip = in_plane((u(2:4) - 0.5_wp)*10, slanted)
         turn = in_plane((u(5:7) - 0.5_wp)*20, slanted)
         call press(law, slanted, d, (d - d_before)/dt, slip, turn, [0.0_wp, 0.0_wp, 0.0_wp], dt, touch, normal)
         loss = 0.5_wp*(normal + normal_before)*(d - d_before) &
            - 0.5_wp*dot_product(touch%shear + before%shear, slip)*dt &
            - 0.5_wp*dot_product(touch%moment + before%moment, turn)*dt &
            - stored_energy(law, touch) + stored_energy(law, before)
         lowest = min(lowest, loss)
         scale = max(scale, stored_energy(law, touch))
      end do
      call check("no step of a contact yields energy", lowest > -1.0e-6_wp*scale)
      call check("the path was no trifle", &
         scale > 0.1_wp*0.4_wp*law%hertz*(2.0e-3_wp)**2*sqrt(2.0e-3_wp))
   end subroutine test_no_gain

   !> Rolling spring: stiffness 2.25 k_n (rolling R*)**2 up to the moment rolling R* F, against the rotation, and back.
   subroutine test_rolling()
      type(material_t) :: material
      type(law_t) :: law
      type(touch_t) :: touch
      real(wp), parameter :: d = 1.0e-3_wp, angle = 1.0e-6_wp, none(3) = 0
      real(wp) :: normal, stiffness, axis(3)
      integer :: k

      material = material_t(friction=0.5_wp)
      law = pair_law(material, 1.0_wp, 1.0_wp, 1.0_wp, 1.0_wp, 0.2_wp)
      axis = cross(slanted, [1.0_wp, 0.0_wp, 0.0_wp])
      axis = axis/sqrt(sum(axis**2))
      call press(law, slanted, d, 0.0_wp, none, none, none, 1.0_wp, touch, normal)
      call check_close("rolling: nothing at rest", maxval(abs(touch%moment)), 0.0_wp, 0.0_wp)
      call press(law, slanted, d, 0.0_wp, none, angle*axis, none, 1.0_wp, touch, normal)
      stiffness = 2.25_wp*2*reduced_modulus(material)*sqrt(0.5_wp*d)*(0.2_wp*0.5_wp)**2
      call check_close("rolling: stiffness", dot_product(touch%moment, axis), -stiffness*angle, 1.0e-12_wp)
      do k = 1, 10000
         call press(law, slanted, d, 0.0_wp, none, angle*axis, none, 1.0_wp, touch, normal)
      end do
      call check_close("rolling: max moment", dot_product(touch%moment, axis), -0.2_wp*0.5_wp*normal, &
         1.0e-12_wp)
      call press(law, slanted, d, 0.0_wp, none, -angle*axis, none, 1.0_wp, touch, normal)
      call check_close("rolling: and back", dot_product(touch%moment, axis), -0.2_wp*0.5_wp*normal &
         + stiffness*angle, 1.0e-12_wp)
      call check_close("rolling: about its axis alone", maxval(abs(cross(touch%moment, axis)))/normal, &
         0.0_wp, 1.0e-12_wp)
   end subroutine test_rolling

   subroutine test_frictionless_spin()
      real(wp) :: after(6)
      real(wp), parameter :: before(6) = [6.0_wp, -1.0_wp, -2.0_wp, 3.0_wp, -4.0_wp, 5.0_wp]
      integer :: k

      after = bounce(material_t(friction=0), before, 100)
      do k = 1, 6
         if (k /= 3) call check_close("without friction: unchanged", after(k), before(k), 0.0_wp)
      end do
   end subroutine test_frictionless_spin

   !> The Rayleigh wave is slower than the shear wave by the factor (0.862 + 1.14 nu)/(1 + nu) (Viktorov 1967).
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
      call check_material(material_t(damping=1.1_wp), error)
      call check("more than critical damping is refused", allocated(error))
      call check_material(material_t(rolling=2.1_wp), error)
      call check("rolling above 2 is refused", allocated(error))
      call check_material(material_t(boulder_rolling=-0.1_wp), error)
      call check("negative boulder_rolling is refused", allocated(error))
   end subroutine test_refusals
end program test_lab_contact
