! SPDX-License-Identifier: BSD-3-Clause
!> Many spheres: no contact is missed by the list of neighbours, momentum is kept, a layer keeps its
!> energy over an impact, and a step that is too long is found out.
program test_lab_step
   use rockfall_kinds, only: wp, i8
   use rockfall_error, only: error_t
   use rockfall_random, only: random_key, random_words, uniform
   use lab_contact, only: material_t
   use lab_bodies, only: bodies_t, bodies, body_energy
   use lab_neighbours, only: box_t, find_pair
   use lab_packing, only: packing_t, layer_t, pack_layer
   use lab_impact, only: shot_t, first_contact
   use lab_step, only: assembly_t, assemble, advance, watch_energy, total_energy, deepest_share, &
      safe_step, &
      trouble_text, sound, leapt, too_soft, step_too_long, energy_grew
   use check_m, only: check, check_close, finish
   implicit none

   real(wp), parameter :: density = 2650

   call test_neighbours(periodic=.true.)
   call test_neighbours(periodic=.false.)
   call test_memory()
   call test_angular_momentum()
   call test_energy_of_layer()
   call test_long_steps()
   call test_watches()
   call test_too_soft()
   call finish()

contains

   !> A gas of 80 spheres and a large one, in disorder and fast. After every step the list must hold
   !> each pair that overlaps, as found by comparing all with all; and momentum is kept, with
   !> friction and damping.
   subroutine test_neighbours(periodic)
      logical, intent(in) :: periodic
      integer, parameter :: n = 81
      type(assembly_t) :: s
      type(bodies_t) :: b
      type(material_t) :: material
      type(box_t) :: box
      real(wp) :: x(2, n), radius(n), v(3, n), u(12), momentum(2), scale, dt
      integer :: k, steps, missed, met, renewals
      real(wp) :: x0

      box = box_t(12.0_wp, periodic, floor=.not. periodic)
      do k = 1, n
         u = uniform(random_words(random_key(3_i8), 1_i8, int(k, i8), 0_i8, 0_i8))
         x(:, k) = [mod(k - 1, 10) + 1.0_wp, 4 + (k - 1)/10 + 1.0_wp] + 0.1_wp*u(1:2)
         radius(k) = 0.1_wp + 0.3_wp*u(3)
         v(:, k) = 20*(u(4:6) - 0.5_wp)
      end do
      x(:, n) = [6.0_wp, 2.5_wp]
      radius(n) = 1.6_wp
      v(:, n) = [10.0_wp, 20.0_wp, -5.0_wp]
      material = material_t(young=1.0e9_wp, friction=0.4_wp, damping=0.05_wp, rolling=0.1_wp)
      b = bodies(x, radius, spread(density, 1, n))
      b%v = v
      dt = safe_step(material, 0.1_wp, density, 60.0_wp)
      call assemble(s, b, box, material, 0.0_wp, dt, 0.1_wp, 1, sum([(body_energy(b, k), k=1, n)]))
      momentum = matmul(b%v(1:2, :), b%mass)
      scale = sum(b%mass*sqrt(b%v(1, :)**2 + b%v(2, :)**2))
      missed = 0
      met = 0
      renewals = 0
      do steps = 1, 12000
         x0 = s%near%x0(1, 1)
         call advance(s)
         if (s%trouble /= sound) exit
         if (abs(s%near%x0(1, 1) - x0) > 0) renewals = renewals + 1
         if (mod(steps, 7) == 0) call compare(s, missed, met)
      end do
      call watch_energy(s)
      call check("no trouble: "//trouble_text(s%trouble), s%trouble == sound)
      call check("no contact was missed", missed == 0)
      call check("there were many", met > 2000)
      call check("lists were renewed, but seldom", renewals > 20 .and. renewals < 3000)
      if (.not. periodic) return
      call check_close("momentum along x is kept", &
         (dot_product(s%bodies%v(1, :), b%mass) - momentum(1))/scale, &
         0.0_wp, 1.0e-12_wp)
      call check_close("momentum along z is kept", &
         (dot_product(s%bodies%v(2, :), b%mass) - momentum(2))/scale, &
         0.0_wp, 1.0e-12_wp)
   end subroutine test_neighbours

   !> Overlapping pairs, and those of them that the list does not know as touching.
   subroutine compare(s, missed, met)
      type(assembly_t), intent(in) :: s
      integer, intent(inout) :: missed, met
      real(wp) :: dx, dz, reach
      integer :: i, j, place

      associate (b => s%bodies)
         do j = 2, b%n
            do i = 1, j - 1
               dx = b%x(1, j) - b%x(1, i)
               dz = b%x(2, j) - b%x(2, i)
               if (s%box%periodic) dx = dx - s%box%width*anint(dx/s%box%width)
               reach = b%radius(i) + b%radius(j)
               if (dx*dx + dz*dz >= (reach*(1 - 1.0e-12_wp))**2) cycle
               met = met + 1
               place = find_pair(s%near, i, j)
               if (place == 0) then
                  missed = missed + 1
               else if (s%touch(place)%root <= 0) then
                  missed = missed + 1
               end if
            end do
         end do
      end associate
   end subroutine compare

   !> How often the list is made anew must not matter: contacts keep their springs, of friction and
   !> rolling.
   subroutine test_memory()
      type(layer_t) :: layer
      type(material_t) :: material
      type(assembly_t) :: often, seldom
      real(wp) :: input
      integer :: k, renewals
      real(wp) :: x0

      material = material_t(young=1.0e9_wp, friction=0.5_wp, rolling=0.2_wp)
      layer = soil(packing_t(width=40.0_wp, depth=6.0_wp), material)
      often = struck(layer, material, 1.0_wp, input, skin=0.002_wp)
      seldom = struck(layer, material, 1.0_wp, input, skin=0.5_wp)
      renewals = 0
      do k = 1, 300
         x0 = often%near%x0(1, 1)
         call advance(often)
         call advance(seldom)
         if (abs(often%near%x0(1, 1) - x0) > 0) renewals = renewals + 1
      end do
      call check("many new lists", renewals > 50)
      call check("they change nothing but last digits", &
         maxval(abs(often%bodies%v - seldom%bodies%v)) < 1.0e-6_wp)
   end subroutine test_memory

   !> Two unequal spheres that graze: spin and orbital moment together are kept, also with friction
   !> and rolling resistance.
   subroutine test_angular_momentum()
      type(assembly_t) :: s
      type(bodies_t) :: b
      type(material_t) :: material
      real(wp) :: before, energy
      integer :: k

      material = material_t(young=1.0e7_wp, friction=0.5_wp, damping=0.1_wp, rolling=0.3_wp)
      b = bodies(reshape([20.0_wp, 20.0_wp, 21.2_wp, 20.8_wp], [2, 2]), [1.0_wp, 0.44_wp], &
         [density, density])
      b%v(:, 1) = [1.0_wp, -0.5_wp, 2.0_wp]
      b%v(:, 2) = [-2.0_wp, -1.0_wp, -3.0_wp]
      call assemble(s, b, box_t(40.0_wp, floor=.false.), material, 0.0_wp, &
                    safe_step(material, 0.44_wp, density, 4.0_wp), 0.1_wp, 0, 1.0e9_wp)
      before = turning(s)
      energy = total_energy(s)
      do k = 1, 1000
         call advance(s)
      end do
      call check("they met", abs(s%bodies%v(3, 1) - 2) > 0.1_wp &
         .and. total_energy(s) < 0.99_wp*energy)
      call check_close("moment of momentum is kept", turning(s), before, 1.0e-12_wp)
   end subroutine test_angular_momentum

   !> Moment of momentum about the origin, clockwise [kg m2/s].
   pure real(wp) function turning(s)
      type(assembly_t), intent(in) :: s

      associate (b => s%bodies)
         turning = sum(b%mass*(b%x(2, :)*b%v(1, :) - b%x(1, :)*b%v(2, :)) &
            + b%v(3, :)/b%inverse(3, :))
      end associate
   end function turning

   !> 400 spheres without friction or damping: at the default step the energy is kept to 1e-4 of the
   !> sphere's, at every moment of an impact, and four times better with half the step.
   subroutine test_energy_of_layer()
      type(layer_t) :: layer
      type(assembly_t) :: s
      type(material_t) :: material
      real(wp) :: worst(2), end(2)

      material = material_t(young=1.0e9_wp, friction=0)
      layer = soil(packing_t(width=80.0_wp, depth=21.0_wp), material)
      call check("about 400 spheres", abs(size(layer%radius) - 405) < 20)
      call keep_energy(layer, material, 1.0_wp, s, worst(1), end(1))
      call keep_energy(layer, material, 0.5_wp, s, worst(2), end(2))
      print "(a, 4es9.1)", "layer: worst and final errors of energy, default and half step:", &
         worst, end
      call check("the energy of a layer is kept", worst(1) < 1.0e-4_wp &
         .and. abs(end(1)) < 1.0e-4_wp)
      call check("four times better with half the step", worst(2) < 0.3_wp*worst(1))
   end subroutine test_energy_of_layer

   subroutine keep_energy(layer, material, share, s, worst, end)
      type(layer_t), intent(in) :: layer
      type(material_t), intent(in) :: material
      real(wp), intent(in) :: share
      type(assembly_t), intent(out) :: s
      real(wp), intent(out) :: worst, end
      real(wp) :: before, input

      s = struck(layer, material, share, input)
      before = total_energy(s)
      worst = 0
      call run(s, 0.15_wp, before, worst)
      call check("no trouble in the layer", s%trouble == sound)
      worst = worst/input
      end = (total_energy(s) - before)/input
      call check("the layer was struck", body_energy(s%bodies, s%bodies%n) < 0.5_wp*input)
   end subroutine keep_energy

   subroutine run(s, duration, before, worst)
      type(assembly_t), intent(inout) :: s
      real(wp), intent(in) :: duration, before
      real(wp), intent(inout) :: worst
      integer :: k

      do k = 1, int(duration/s%dt)
         call advance(s)
         if (s%trouble /= sound) return
         if (mod(k, 3) == 0) worst = max(worst, abs(total_energy(s) - before))
         if (mod(k, 3) == 0) call watch_energy(s)
      end do
   end subroutine run

   type(layer_t) function soil(packing, material)
      type(packing_t), intent(in) :: packing
      type(material_t), intent(in) :: material
      type(error_t), allocatable :: error

      call pack_layer(packing, material, random_key(1_i8), 1_i8, soil, error)
      call check("a layer for the test", .not. allocated(error))
   end function soil

   !> A sphere three times the mean size about to hit a layer at 45 degrees and 20 m/s.
   function struck(layer, material, share, input, skin) result(s)
      type(layer_t), intent(in) :: layer
      type(material_t), intent(in) :: material
      real(wp), intent(in) :: share  !! of the safe step
      real(wp), intent(out) :: input
      real(wp), intent(in), optional :: skin  !! of the list of neighbours [m]
      type(assembly_t) :: s
      type(bodies_t) :: b
      type(shot_t) :: shot
      real(wp) :: thickness
      integer :: n

      thickness = 0.06_wp
      if (present(skin)) thickness = skin
      shot = shot_t(radius=3*layer%mean_radius)
      n = size(layer%radius) + 1
      b = bodies(reshape([layer%x, first_contact(layer, shot)], [2, n]), &
         [layer%radius, shot%radius], &
                 spread(density, 1, n))
      b%v(1:2, n) = 20*sqrt(0.5_wp)*[1, -1]
      input = body_energy(b, n)
      call assemble(s, b, layer%box, material, 9.81_wp, &
                    share*safe_step(material, minval(b%radius), density, 40.0_wp), thickness, 1, &
                    input)
   end function struck

   !> A step that is too long is found out, whatever sees it first; 20 times is far too long.
   subroutine test_long_steps()
      type(layer_t) :: layer
      type(assembly_t) :: s
      type(material_t) :: material
      real(wp), parameter :: share(4) = [4.0_wp, 10.0_wp, 20.0_wp, 100.0_wp]
      real(wp) :: input, worst
      integer :: k

      material = material_t(young=1.0e9_wp, friction=0.3_wp)
      layer = soil(packing_t(width=40.0_wp, depth=6.0_wp), material)
      do k = 1, size(share)
         s = struck(layer, material, share(k), input)
         worst = 0
         call run(s, 0.15_wp, 0.0_wp, worst)
         print "(f6.0, 2a)", share(k), " times the safe step: ", trouble_text(s%trouble)
         call check("a long step is found out", &
            any(s%trouble == [leapt, step_too_long, energy_grew]))
      end do
   end subroutine test_long_steps

   !> Each watch sees its own fault: energy from nowhere, a leap.
   subroutine test_watches()
      type(layer_t) :: layer
      type(assembly_t) :: s
      type(material_t) :: material
      real(wp) :: input

      material = material_t(young=1.0e9_wp, friction=0.3_wp)
      layer = soil(packing_t(width=40.0_wp, depth=6.0_wp), material)
      s = struck(layer, material, 1.0_wp, input)
      s%bodies%v = s%bodies%v*1.005_wp
      call watch_energy(s)
      call check("1 % more energy is within the tolerance", s%trouble == sound)
      s%bodies%v = s%bodies%v*1.01_wp
      call watch_energy(s)
      call check("3 % more is not", s%trouble == energy_grew)
      s = struck(layer, material, 1.0_wp, input)
      s%bodies%v(1, 1) = 0.3_wp*s%bodies%radius(1)/s%dt
      call advance(s)
      call check("a leap of 0.3 radii is found out", s%trouble == leapt)
      s = struck(layer, material, 1.0_wp, input)
      s%bodies%v(2, 3) = 1/(s%dt*tiny(1.0_wp)**0.25_wp)
      call advance(s)
      call check("so is a huge one", s%trouble == leapt)
   end subroutine test_watches

   !> Very soft spheres at high speed would pass through each other: not a matter of the step.
   subroutine test_too_soft()
      type(layer_t) :: layer
      type(assembly_t) :: s
      type(material_t) :: material
      real(wp) :: input, worst

      material = material_t(young=1.0e9_wp, friction=0.3_wp)
      layer = soil(packing_t(width=40.0_wp, depth=6.0_wp), material)
      worst = 0
      s = struck(layer, material, 1.0_wp, input)
      call run(s, 0.02_wp, 0.0_wp, worst)
      call check("1 GPa stands 20 m/s", s%trouble == sound .and. deepest_share(s) > 0 &
         .and. deepest_share(s) < 1)
      material%young = 1.0e6_wp
      s = struck(layer, material, 0.5_wp, input)
      call run(s, 0.15_wp, 0.0_wp, worst)
      call check("1 MPa does not: "//trouble_text(s%trouble), s%trouble == too_soft)
   end subroutine test_too_soft
end program test_lab_step
