! SPDX-License-Identifier: BSD-3-Clause
!> Many spheres: the neighbour list misses no contact, momentum and angular momentum are conserved, a layer conserves
!> energy over an impact, an absorbing base agrees with theory, and too long a step is detected.
program test_lab_step
   use rockfall_kinds, only: wp, i8
   use rockfall_error, only: error_t
   use rockfall_random, only: random_key, random_words, uniform
   use lab_contact, only: material_t, law_t, pair_law, plane_law, cross
   use lab_bodies, only: bodies_t, bodies, body_energy
   use lab_neighbours, only: box_t, find_pair
   use lab_packing, only: packing_t, layer_t, pack_layer
   use lab_impact, only: shot_t, first_contact
   use lab_step, only: assembly_t, assemble, set_absorbing_base, advance, watch_energy, total_energy, &
      deepest_share, safe_step, trouble_text, sound, leapt, too_soft, step_too_long, energy_grew
   use check_m, only: check, check_close, finish
   implicit none

   real(wp), parameter :: density = 2650

   call test_neighbours(width=12.0_wp)
   call test_neighbours(width=0.0_wp)
   call test_narrow_box()
   call test_memory()
   call test_angular_momentum()
   call test_energy_of_layer()
   call test_dashpot()
   call test_base_at_rest()
   call test_waves()
   call test_base_loses_energy()
   call test_long_steps()
   call test_watches()
   call test_too_soft()
   call finish()

contains

   !> Fast, disordered gas of 256 spheres and a large sphere. Every few steps, the list must contain each overlapping
   !> pair, found by comparing all spheres; in a periodic box, momentum is conserved, with friction and damping. Width
   !> 0: not periodic, with a floor.
   subroutine test_neighbours(width)
      real(wp), intent(in) :: width
      integer, parameter :: n = 257
      type(assembly_t) :: s
      type(bodies_t) :: b
      type(material_t) :: material
      real(wp) :: x(3, n), radius(n), v(6, n), u(12), momentum(3), after(3), scale, dt, x0
      integer(i8) :: draw
      integer :: k, steps, missed, met, renewals

      do k = 1, n
         u = uniform([(random_words(random_key(3_i8), 1_i8, int(k, i8), 0_i8, draw), draw=0, 2)])
         x(:, k) = [1.5_wp*mod(k - 1, 8), 1.5_wp*mod((k - 1)/8, 8), 5.5_wp + 1.2_wp*((k - 1)/64)] + 0.3_wp*u(1:3)
         radius(k) = 0.1_wp + 0.3_wp*u(4)
         v(:, k) = 20*(u(5:10) - 0.5_wp)
      end do
      x(:, n) = [6.0_wp, 6.0_wp, 2.7_wp]
      radius(n) = 2.0_wp
      v(:, n) = [10.0_wp, -5.0_wp, 20.0_wp, 1.0_wp, 2.0_wp, 3.0_wp]
      material = material_t(young=1.0e9_wp, friction=0.4_wp, damping=0.05_wp, rolling=0.1_wp)
      b = bodies(x, radius, spread(density, 1, n))
      b%v = v
      dt = safe_step(material, 0.1_wp, density, 60.0_wp)
      call assemble(s, b, box_t(width, floor=width <= 0), material, 0.0_wp, dt, 0.1_wp, 1, &
                    sum([(body_energy(b, k), k=1, n)]))
      momentum = matmul(b%v(1:3, :), b%mass)
      scale = sum(b%mass*sqrt(sum(b%v(1:3, :)**2, 1)))
      missed = 0
      met = 0
      renewals = 0
      do steps = 1, 4000
         x0 = s%near%x0(1, 1)
         call advance(s)
         if (s%trouble /= sound) exit
         if (abs(s%near%x0(1, 1) - x0) > 0) renewals = renewals + 1
         if (mod(steps, 7) == 0) call compare(s, missed, met)
      end do
      call watch_energy(s)
      call check("no trouble: "//trouble_text(s%trouble), s%trouble == sound)
      call check("no contact was missed", missed == 0)
      print "(2(i0, a))", met, " contacts met, ", renewals, " new lists"
      call check("there were many", met > 500)
      call check("lists were renewed, but seldom", renewals > 20 .and. renewals < 1000)
      if (width <= 0) return
      after = matmul(s%bodies%v(1:3, :), b%mass)
      call check_close("momentum is kept", maxval(abs(after - momentum))/scale, 0.0_wp, 1.0e-12_wp)
   end subroutine test_neighbours

   !> Number of overlapping pairs, and how many of them are missing in the list.
   subroutine compare(s, missed, met)
      type(assembly_t), intent(in) :: s
      integer, intent(inout) :: missed, met
      real(wp) :: d(3), reach
      integer :: i, j, place

      associate (b => s%bodies)
         do j = 2, b%n
            do i = 1, j - 1
               d = b%x(:, j) - b%x(:, i)
               if (s%box%width > 0) d(1:2) = d(1:2) - s%box%width*anint(d(1:2)/s%box%width)
               reach = b%radius(i) + b%radius(j)
               if (sum(d**2) >= (reach*(1 - 1.0e-12_wp))**2) cycle
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

   !> In a box with few cells, an image across a corner is found.
   subroutine test_narrow_box()
      type(assembly_t) :: s, far
      type(bodies_t) :: b
      type(material_t) :: material
      real(wp) :: x(3, 2)
      integer :: k

      material = material_t(young=1.0e8_wp, friction=0.5_wp)
      x = reshape([4.7_wp, 0.2_wp, 3.0_wp, 0.3_wp, 4.75_wp, 3.1_wp], [3, 2])
      call assemble(s, meeting(x, [0.4_wp, 0.45_wp, 0.1_wp]), box_t(5.0_wp, floor=.false.), material, &
                    0.0_wp, 1.0e-4_wp, 0.1_wp, 0, 1.0e9_wp)
      x(1:2, 2) = x(1:2, 2) + [5, -5]
      call assemble(far, meeting(x, [0.4_wp, 0.45_wp, 0.1_wp]), box_t(0.0_wp, floor=.false.), material, &
                    0.0_wp, 1.0e-4_wp, 0.1_wp, 0, 1.0e9_wp)
      do k = 1, 1000
         call advance(s)
         call advance(far)
      end do
      b = far%bodies
      call check("they met across the corner", abs(b%v(6, 1)) > 0.01_wp)
      call check_close("as if there were no sides", maxval(abs(s%bodies%v - b%v)), 0.0_wp, 1.0e-10_wp)
   end subroutine test_narrow_box

   !> Two spheres of radius 0.4 m meet off centre: the first at rest, the second at 1.1 m/s with spin d [rad/s].
   type(bodies_t) function meeting(x, d) result(b)
      real(wp), intent(in) :: x(3, 2), d(3)

      b = bodies(x, [0.4_wp, 0.4_wp], [density, density])
      b%v(1:3, 2) = [-1.0_wp, 0.5_wp, 0.0_wp]
      b%v(4:6, 2) = d
   end function meeting

   !> The frequency of rebuilding the list has no effect: contacts keep their springs of friction and rolling.
   subroutine test_memory()
      type(layer_t) :: layer
      type(material_t) :: material
      type(assembly_t) :: often, seldom
      real(wp) :: input
      integer :: k, renewals
      real(wp) :: x0

      material = material_t(young=1.0e9_wp, friction=0.5_wp, rolling=0.2_wp)
      layer = soil(small(), material)
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

   !> For two unequal grazing spheres, the sum of spin and orbital angular momentum is conserved in all directions, also
   !> with friction and rolling resistance.
   subroutine test_angular_momentum()
      type(assembly_t) :: s
      type(bodies_t) :: b
      type(material_t) :: material
      real(wp) :: before(3), after(3), energy
      integer :: k

      material = material_t(young=1.0e7_wp, friction=0.5_wp, damping=0.1_wp, rolling=0.3_wp)
      b = bodies(reshape([20.0_wp, 20.0_wp, 20.0_wp, 21.2_wp, 20.5_wp, 20.6_wp], [3, 2]), &
         [1.0_wp, 0.44_wp], [density, density])
      b%v(:, 1) = [1.0_wp, -0.5_wp, 0.2_wp, 1.0_wp, 2.0_wp, 3.0_wp]
      b%v(:, 2) = [-2.0_wp, -1.0_wp, 0.3_wp, -3.0_wp, 0.5_wp, -1.0_wp]
      call assemble(s, b, box_t(40.0_wp, floor=.false.), material, 0.0_wp, &
                    safe_step(material, 0.44_wp, density, 4.0_wp), 0.1_wp, 0, 1.0e9_wp)
      before = turning(s)
      energy = total_energy(s)
      do k = 1, 1000
         call advance(s)
      end do
      call check("they met", maxval(abs(s%bodies%v(4:6, 1) - b%v(4:6, 1))) > 0.1_wp &
         .and. total_energy(s) < 0.99_wp*energy)
      after = turning(s)
      call check_close("moment of momentum is kept", maxval(abs(after - before)) &
         /sqrt(sum(before**2)), 0.0_wp, 1.0e-12_wp)
   end subroutine test_angular_momentum

   !> Angular momentum about the origin [kg m2/s].
   pure function turning(s)
      type(assembly_t), intent(in) :: s
      real(wp) :: turning(3)
      integer :: k

      turning = 0
      associate (b => s%bodies)
         do k = 1, b%n
            turning = turning + b%mass(k)*cross(b%x(:, k), b%v(1:3, k)) + b%v(4:6, k)/b%inverse(4:6, k)
         end do
      end associate
   end function turning

   !> 200 spheres without friction or damping: at the default step, the energy during an impact is conserved to 1e-4 of
   !> the energy of the sphere, and several times better with half the step.
   subroutine test_energy_of_layer()
      type(layer_t) :: layer
      type(assembly_t) :: s
      type(material_t) :: material
      real(wp) :: worst(2), end(2)

      material = material_t(young=1.0e9_wp, friction=0)
      layer = soil(packing_t(ratio=3.0_wp), material)
      print "(a, i0)", "bodies of the layer: ", size(layer%radius)
      call keep_energy(layer, material, 1.0_wp, s, worst(1), end(1))
      call keep_energy(layer, material, 0.5_wp, s, worst(2), end(2))
      print "(a, 4es9.1)", "layer: worst and final errors of energy, default and half step:", &
         worst, end
      call check("the energy of a layer is kept", worst(1) < 1.0e-4_wp .and. abs(end(1)) < 1.0e-4_wp)
      call check("much better with half the step", worst(2) < 0.4_wp*worst(1))
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
      call run(s, 0.08_wp, before, worst)
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

   !> Layer of a few hundred bodies.
   pure type(packing_t) function small()
      small = packing_t(ratio=2.0_wp, depth=1.5_wp)
   end function small

   type(layer_t) function soil(packing, material)
      type(packing_t), intent(in) :: packing
      type(material_t), intent(in) :: material
      type(error_t), allocatable :: error

      call pack_layer(packing, material, random_key(1_i8), 1_i8, soil, error)
      call check("a layer for the test", .not. allocated(error))
      if (allocated(error)) print "(a)", error%message
   end function soil

   !> Sphere of three times the mean size about to hit a layer at 45 degrees and 20 m/s.
   function struck(layer, material, share, input, skin) result(s)
      type(layer_t), intent(in) :: layer
      type(material_t), intent(in) :: material
      real(wp), intent(in) :: share  !! fraction of the safe step
      real(wp), intent(out) :: input
      real(wp), intent(in), optional :: skin  !! skin of the neighbour list [m]
      type(assembly_t) :: s
      type(bodies_t) :: b
      type(shot_t) :: shot
      real(wp) :: thickness
      integer :: n

      thickness = 0.06_wp
      if (present(skin)) thickness = skin
      shot = shot_t(radius=0.75_wp)
      n = size(layer%radius) + 1
      b = bodies(reshape([layer%x, first_contact(layer, shot)], [3, n]), [layer%radius, shot%radius], &
                 spread(density, 1, n))
      b%v(1:3, n) = 20*sqrt(0.5_wp)*[1, 0, -1]
      input = body_energy(b, n)
      call assemble(s, b, layer%box, material, 9.81_wp, &
                    share*safe_step(material, minval(b%radius), density, 40.0_wp), thickness, 1, &
                    input)
   end function struck

   !> The velocity of one body on a dashpot c decays as exp(-c t/m); a far stiffer dashpot does not amplify it.
   subroutine test_dashpot()
      type(assembly_t) :: s
      type(bodies_t) :: b
      real(wp), parameter :: kick(3) = [1.0e-3_wp, -2.0e-3_wp, -3.0e-3_wp]
      real(wp) :: theory(3), rate
      integer :: k, stiff

      do stiff = 0, 1
         b = bodies(reshape([5.0_wp, 5.0_wp, 1.0_wp], [3, 1]), [1.0_wp], [density])
         b%x(3, 1) = 1 - (9.81_wp*b%mass(1)/hertz_of(plane_law(material_t(), 1.0_wp, b%mass(1), 0.0_wp))) &
            **(2.0_wp/3)
         call assemble(s, b, box_t(10.0_wp), material_t(), 9.81_wp, 1.0e-4_wp, 0.1_wp, 0, 1.0e9_wp)
         rate = merge(1.0e6_wp, 30.0_wp, stiff == 1)
         call set_absorbing_base(s, rate*b%mass(1)/100)
         s%bodies%v(1:3, 1) = kick
         ! acceleration as if it had moved at this speed before
         s%bodies%a(1:3, 1) = -rate*kick
         if (stiff == 1) s%bodies%a = 0
         do k = 1, 1000
            call advance(s)
         end do
         theory = kick*exp(-rate*0.1_wp)
         if (stiff == 0) call check_close("decays as theory says", &
            maxval(abs(s%bodies%v(1:3, 1) - theory))/theory(1), 0.0_wp, 1.0e-5_wp)
         call check("no impedance is too great for the step", &
            all(abs(s%bodies%v(1:3, 1)) <= abs(kick)))
      end do
   end subroutine test_dashpot

   pure real(wp) function hertz_of(law)
      type(law_t), intent(in) :: law

      hertz_of = law%hertz
   end function hertz_of

   !> Column of spheres exactly on top of each other in a box of 1 m2, at rest under a heavy sphere: overlaps carry the
   !> weights above.
   function column(n, impedance_factor, z, energy) result(s)
      integer, intent(in) :: n
      real(wp), intent(in) :: impedance_factor !! impedance of the base over that of the column; < 0: rigid
      real(wp), intent(out) :: z               !! impedance of the column [N s/m]
      real(wp), intent(out) :: energy          !! energy at rest [J]
      type(assembly_t) :: s
      type(bodies_t) :: b
      type(material_t) :: material
      type(law_t) :: law
      real(wp) :: x(3, n), dense(n), m, load, overlap
      real(wp), parameter :: r = 0.05_wp, gravity = 0.01_wp
      integer :: k

      material = material_t(young=1.0e9_wp, friction=0)
      dense = density
      dense(n) = density*3.6e4_wp
      b = bodies(spread([0.5_wp, 0.5_wp, 0.0_wp], 2, n), spread(r, 1, n), dense)
      m = b%mass(1)
      law = plane_law(material, r, m, 0.0_wp)
      x = b%x
      overlap = 0
      x(3, 1) = r - (gravity*sum(b%mass)/law%hertz)**(2.0_wp/3)
      law = pair_law(material, r, m, r, m, 0.0_wp)
      do k = 2, n
         load = gravity*sum(b%mass(k:))
         overlap = (load/law%hertz)**(2.0_wp/3)
         x(3, k) = x(3, k - 1) + 2*r - overlap
      end do
      b%x = x
      z = sqrt(1.5_wp*law%hertz*sqrt(overlap)*m)
      call assemble(s, b, box_t(1.0_wp), material, gravity, safe_step(material, r, density, 1.0_wp)/2, &
                    0.01_wp, 0, 1.0e9_wp)
      if (impedance_factor >= 0) call set_absorbing_base(s, impedance_factor*z)
      energy = total_energy(s)
   end function column

   !> Bodies at rest stay at rest.
   subroutine test_base_at_rest()
      type(assembly_t) :: s
      real(wp) :: z, energy
      integer :: k

      s = column(20, 1.0_wp, z, energy)
      do k = 1, 2000
         call advance(s)
      end do
      call check("at rest: no trouble", s%trouble == sound)
      call check("nothing moves on the absorbing base", maxval(abs(s%bodies%v)) < 1.0e-7_wp)
   end subroutine test_base_at_rest

   !> A base of impedance c reflects the fraction ((Z - c)/(Z + c))**2 of the energy of a long compression wave in a
   !> column of impedance Z; a rigid floor reflects all.
   subroutine test_waves()
      integer, parameter :: n = 121
      real(wp), parameter :: share(5) = [1.0_wp, 3.0_wp, 1/3.0_wp, 10.0_wp, -1.0_wp], sigma = 8
      type(assembly_t) :: s
      real(wp) :: z, still, put, left, factor
      integer :: k, l

      do l = 1, size(share)
         s = column(n, share(l), z, still)
         do k = 1, n - 1
            s%bodies%v(3, k) = -3.0e-3_wp*exp(-((k - 60)/sigma)**2)
         end do
         put = total_energy(s) - still
         ! half goes up and is reflected by the weight, and both halves come down: over 180 and 60 spheres, and back
         do k = 1, nint(260*s%bodies%mass(1)/z/s%dt)
            call advance(s)
         end do
         left = (total_energy(s) - still)/put
         factor = ((1 - share(l))/(1 + share(l)))**2
         if (share(l) < 0) factor = 1
         print "(a, f6.2, a, f7.4, a, f7.4)", "base of", share(l), " of the impedance keeps", left, ", theory", factor
         call check("waves: no trouble", s%trouble == sound)
         call check("the base takes what it should of a wave", abs(left - factor) < 0.01_wp)
      end do
   end subroutine test_waves

   !> An absorbing base under a layer without friction never adds energy to an impact, and takes at least a fifth of it.
   subroutine test_base_loses_energy()
      type(layer_t) :: layer
      type(assembly_t) :: s
      type(material_t) :: material
      real(wp) :: input, before, last, highest
      integer :: k

      material = material_t(young=1.0e9_wp, friction=0)
      layer = soil(small(), material)
      s = struck(layer, material, 1.0_wp, input)
      call set_absorbing_base(s, density*layer%solid*300)
      before = total_energy(s)
      highest = -huge(1.0_wp)
      last = before
      do k = 1, int(0.1_wp/s%dt)
         call advance(s)
         highest = max(highest, total_energy(s) - last)
         last = min(last, total_energy(s))
      end do
      call check("no trouble over the base", s%trouble == sound)
      call check("the base only takes", highest < 1.0e-4_wp*input)
      call check("and takes much of it", last < before - 0.2_wp*input)
   end subroutine test_base_loses_energy

   !> A step that is too long is detected by one of the checks; 20 times the default is far too long.
   subroutine test_long_steps()
      type(layer_t) :: layer
      type(assembly_t) :: s
      type(material_t) :: material
      real(wp), parameter :: share(4) = [4.0_wp, 10.0_wp, 20.0_wp, 100.0_wp]
      real(wp) :: input, worst
      integer :: k

      material = material_t(young=1.0e9_wp, friction=0.3_wp)
      layer = soil(small(), material)
      do k = 1, size(share)
         s = struck(layer, material, share(k), input)
         worst = 0
         call run(s, 0.08_wp, 0.0_wp, worst)
         print "(f6.0, 2a)", share(k), " times the safe step: ", trouble_text(s%trouble)
         call check("a long step is found out", &
            any(s%trouble == [leapt, step_too_long, energy_grew]))
      end do
   end subroutine test_long_steps

   !> Each check detects its own fault: a gain of energy, a jump.
   subroutine test_watches()
      type(layer_t) :: layer
      type(assembly_t) :: s
      type(material_t) :: material
      real(wp) :: input

      material = material_t(young=1.0e9_wp, friction=0.3_wp)
      layer = soil(small(), material)
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
      s%bodies%v(3, 3) = 1/(s%dt*tiny(1.0_wp)**0.25_wp)
      call advance(s)
      call check("so is a huge one", s%trouble == leapt)
   end subroutine test_watches

   !> Very soft spheres at high speed would pass through each other, for any step.
   subroutine test_too_soft()
      type(layer_t) :: layer
      type(assembly_t) :: s
      type(material_t) :: material
      real(wp) :: input, worst

      material = material_t(young=1.0e9_wp, friction=0.3_wp)
      layer = soil(small(), material)
      worst = 0
      s = struck(layer, material, 1.0_wp, input)
      call run(s, 0.02_wp, 0.0_wp, worst)
      call check("1 GPa stands 20 m/s", s%trouble == sound .and. deepest_share(s) > 0 &
         .and. deepest_share(s) < 1)
      material%young = 1.0e6_wp
      s = struck(layer, material, 0.5_wp, input)
      call run(s, 0.08_wp, 0.0_wp, worst)
      call check("1 MPa does not: "//trouble_text(s%trouble), s%trouble == too_soft)
   end subroutine test_too_soft
end program test_lab_step
