! SPDX-License-Identifier: BSD-3-Clause
!> Time stepping of spheres and clumps in contact: velocity Verlet, with a step determined by the stiffest contact and
!> checked at every step. An unstable run sets `trouble` and must not be continued.
module lab_step
   use rockfall_kinds, only: wp
   use lab_contact, only: material_t, law_t, touch_t, pair_law, plane_law, press, stored_energy, &
      batch_t, batch_size, put_contact, touch_in, press_batch, &
      collision_time, rayleigh_time, cross, in_plane
   use lab_clump, only: move_clump, place_spheres, accelerate_clump
   use lab_bodies, only: bodies_t, sphere_mass, update_spheres, in_clump, kinetic_energy, mass_moment, body_mass
   use lab_neighbours, only: box_t, pair_t, neighbours_t, find_neighbours, outdated, find_pair
   implicit none
   private
   public :: assembly_t, assemble, set_tilt, set_absorbing_base, stiffen, advance, shorten_step, lengthen_step, &
      watch_energy, total_energy, deepest_share, safe_step, energy_tolerance, trouble_text
   public :: sound, leapt, too_soft, step_too_long, energy_grew

   !> Trouble codes; the first that occurs is kept.
   integer, parameter :: sound = 0, leapt = 1, too_soft = 2, step_too_long = 3, energy_grew = 4

   real(wp), parameter :: steps_per_collision = 14 !! for a collision of the two smallest bodies at maximum speed
   real(wp), parameter :: rayleigh_share = 0.2_wp     !! fraction of the Rayleigh time of the smallest body
   real(wp), parameter :: longest_leap = 0.2_wp       !! maximum displacement per step, over the radius of the body [-]
   real(wp), parameter :: deepest_overlap = 1  !! maximum overlap over smaller radius [-]; Hertz's law fails earlier
   ! A body with several contacts at this limit oscillates up to 2.5 times faster, and its spin 1.7 times; Verlet
   ! requires a phase below 2.
   real(wp), parameter :: greatest_phase = 0.4_wp     !! maximum sqrt(k/m*) dt of a contact
   real(wp), parameter :: shortest_step = 1.0_wp/64   !! minimum of an adaptive step, over the first step [-]
   ! sqrt(k/m*) is proportional to overlap**(1/4): after lengthening the step, every phase is at most 0.84 of its limit.
   real(wp), parameter :: step_ratio = sqrt(2.0_wp)   !! factor between adaptive steps
   real(wp), parameter :: shallow = 1.0_wp/8  !! maximum overlap for lengthening the step, over its limit [-]
   real(wp), parameter :: energy_tolerance = 0.02_wp  !! maximum gain of energy, over the energy input [-]

   !> Body supported by an absorbing base.
   type :: base_t
      integer :: body = 0
      real(wp) :: force = 0  !! supporting force at rest, upward [N]
      real(wp) :: drag = 0   !! drag force over speed of the body [N s/m]
   end type base_t

   !> Pairs in contact that are advanced together.
   type :: pairs_t
      real(wp), dimension(batch_size) :: d, radius, fraction  !! distance [m]; radius of the first [m]; fraction of the
                                                              !! overlap in the first [-]
      real(wp), dimension(batch_size, 3) :: separation        !! between centres, first to second [m]
      real(wp), dimension(batch_size, 3) :: u, pull  !! velocity [m/s], acceleration [m/s2] of the second relative to
                                                     !! the first
      real(wp), dimension(batch_size, 3) :: spin, other_spin  !! spins of first, second [rad/s]
   end type pairs_t

   type :: assembly_t
      type(bodies_t) :: bodies
      type(box_t) :: box
      type(material_t) :: material
      real(wp) :: gravity = 9.81_wp                !! [m/s2]
      real(wp) :: tilt(3) = 0                      !! additional gravity of the last body [m/s2]
      real(wp) :: tilt_work = 0                    !! work of the tilt so far [J]
      real(wp) :: dt = 0, first_dt = 0             !! current step; step at the start [s]
      type(neighbours_t) :: near
      type(law_t), allocatable :: law(:)           !! contact law of each pair
      type(touch_t), allocatable :: touch(:)
      real(wp), allocatable :: max_overlap(:)      !! limit from the step and Hertz's law [m]
      type(law_t), allocatable :: floor_law(:)     !! contact law of each body near the floor
      type(touch_t), allocatable :: floor_touch(:)
      real(wp), allocatable :: floor_max_overlap(:)
      type(base_t), allocatable :: base(:)         !! bodies supported by an absorbing base
      logical, allocatable :: on_base(:)           !! for each body: it is supported by the base
      real(wp) :: floor_force = 0                  !! upward force of the floor [N]
      real(wp) :: energy_limit = huge(1.0_wp)      !! total energy above which energy was gained [J]
      integer :: trouble = sound
   end type assembly_t

contains

   !> Safe step for bodies with at least `radius` that collide with at most `speed` [s].
   elemental real(wp) function safe_step(material, radius, density, speed) result(dt)
      type(material_t), intent(in) :: material
      real(wp), intent(in) :: radius, density, speed  !! [m], [kg/m3], > 0 [m/s]

      dt = collision_time(material, radius/2, sphere_mass(radius, density)/2, speed)
      dt = min(dt/steps_per_collision, &
               rayleigh_time(material, radius, density)*rayleigh_share)
   end function safe_step

   !> Assemble the system: neighbours and forces of the initial state. `input` is the energy scale for the stability
   !> check: the kinetic and potential energy at the start [J].
   pure subroutine assemble(s, bodies, box, material, gravity, dt, skin, n_large, input)
      type(assembly_t), intent(out) :: s
      type(bodies_t), intent(in) :: bodies
      type(box_t), intent(in) :: box
      type(material_t), intent(in) :: material
      real(wp), intent(in) :: gravity, dt, skin, input  !! [m/s2], [s], [m], [J]
      integer, intent(in) :: n_large  !! see `neighbours_t`

      s%bodies = bodies
      s%box = box
      s%material = material
      s%gravity = gravity
      s%dt = dt
      s%first_dt = dt
      s%near%skin = skin
      s%near%n_large = n_large
      if (allocated(bodies%owner)) s%near%owner = bodies%owner
      allocate (s%on_base(bodies%n), source=.false.)
      call find_neighbours(s%near, s%box, s%bodies%x, s%bodies%radius)
      call make_laws(s)
      call set_rates(s)
      s%energy_limit = total_energy(s) + energy_tolerance*input
   end subroutine assemble

   !> Tilt gravity for the last body only, from now on.
   pure subroutine set_tilt(s, tilt)
      type(assembly_t), intent(inout) :: s
      real(wp), intent(in) :: tilt(3)  !! [m/s2]

      s%tilt = tilt
      call set_rates(s)
   end subroutine set_tilt

   !> Advance by one step.
   pure subroutine advance(s)
      type(assembly_t), intent(inout) :: s
      logical :: sound_step

      associate (b => s%bodies)
         call drift(b%n, s%dt, b%radius, b%a, b%v, b%x, sound_step)
         if (.not. sound_step) then  ! also true for NaN
            call note(s, leapt)
            return
         end if
         if (allocated(b%clump)) call move_clumps(s)
         s%tilt_work = s%tilt_work + s%dt*body_mass(b, b%n)*dot_product(s%tilt, b%v(1:3, b%n))
         if (outdated(s%near, b%x)) call renew(s)
         call find_forces(s)
         call accelerate(b%n, s%gravity, s%tilt, 0.5_wp*s%dt, b%f, b%inverse, b%a, b%v)
         if (allocated(b%clump)) call accelerate_clumps(s, 0.5_wp*s%dt)
      end associate
   end subroutine advance

   !> Shorten a step that was just found too long, unless it is the shortest. The motion is still stable, because the
   !> phase limit is well below the stability limit.
   pure subroutine shorten_step(s)
      type(assembly_t), intent(inout) :: s

      if (s%trouble /= step_too_long .or. s%dt < shortest_step*s%first_dt) return
      s%trouble = sound
      call set_step(s, s%dt/step_ratio)
   end subroutine shorten_step

   !> Lengthen a shortened step, if all contacts permit it.
   pure subroutine lengthen_step(s)
      type(assembly_t), intent(inout) :: s
      integer :: n

      n = s%near%n_pairs
      if (step_ratio*s%dt > s%first_dt) return
      if (any(s%touch(:n)%root**2 > shallow*s%max_overlap(:n))) return
      if (any(s%floor_touch%root**2 > shallow*s%floor_max_overlap)) return
      call set_step(s, step_ratio*s%dt)
   end subroutine lengthen_step

   pure subroutine set_step(s, dt)
      type(assembly_t), intent(inout) :: s
      real(wp), intent(in) :: dt  !! [s]

      s%dt = dt
      call set_limits(s)
   end subroutine set_step

   !> Move clumps, and place their spheres, which were moved as separate bodies before.
   pure subroutine move_clumps(s)
      type(assembly_t), intent(inout) :: s
      integer :: c

      do c = 1, size(s%bodies%clump)
         call move_clump(s%bodies%clump(c), s%dt)
         call place_spheres(s%bodies%clump(c), s%box%width, s%bodies%x)
      end do
   end subroutine move_clumps

   !> Advance the velocities of clumps by a time, and update the velocities of their spheres.
   pure subroutine accelerate_clumps(s, time)
      type(assembly_t), intent(inout) :: s
      real(wp), intent(in) :: time  !! [s]
      real(wp) :: gravity(3)
      integer :: c

      do c = 1, size(s%bodies%clump)
         gravity = [0.0_wp, 0.0_wp, -s%gravity]
         associate (b => s%bodies, first => s%bodies%clump(c)%first, last => s%bodies%clump(c)%last)
            if (last == b%n) gravity = gravity + s%tilt
            call accelerate_clump(b%clump(c), gravity, time, b%f(:, first:last))
            call update_spheres(b, c)
         end associate
      end do
   end subroutine accelerate_clumps

   !> Move bodies to the end of the step with the velocity at the middle of the step.
   pure subroutine drift(n, dt, radius, a, v, x, sound_step)
      integer, intent(in) :: n
      real(wp), intent(in) :: dt, radius(n), a(6, n)  !! [s], [m], [m/s2] and [rad/s2]
      real(wp), intent(inout) :: v(6, n), x(3, n)     !! [m/s] and [rad/s], [m]
      logical, intent(out) :: sound_step  !! no body has moved too far
      real(wp) :: leap(3)
      integer :: k

      sound_step = .true.
      do k = 1, n
         v(:, k) = v(:, k) + 0.5_wp*dt*a(:, k)
         leap = dt*v(1:3, k)
         x(:, k) = x(:, k) + leap
         sound_step = sound_step .and. leap(1)**2 + leap(2)**2 + leap(3)**2 <= (longest_leap*radius(k))**2
      end do
   end subroutine drift

   !> Compute accelerations from forces, and advance velocities by `time`.
   pure subroutine accelerate(n, gravity, tilt, time, f, inverse, a, v)
      integer, intent(in) :: n
      real(wp), intent(in) :: gravity, time   !! [m/s2], [s]
      real(wp), intent(in) :: tilt(3)         !! additional gravity of the last body [m/s2]
      real(wp), intent(in) :: f(6, n)         !! [N] and [N m]
      real(wp), intent(in) :: inverse(6, n)   !! inverse of mass [1/kg] and inertia [1/(kg m2)]
      real(wp), intent(out) :: a(6, n)        !! [m/s2] and [rad/s2]
      real(wp), intent(inout) :: v(6, n)      !! [m/s] and [rad/s]
      integer :: k

      do k = 1, n
         a(:, k) = f(:, k)*inverse(:, k)
         a(3, k) = a(3, k) - gravity
         v(:, k) = v(:, k) + time*a(:, k)
      end do
      a(1:3, n) = a(1:3, n) + tilt
      v(1:3, n) = v(1:3, n) + time*tilt
   end subroutine accelerate

   !> Compute forces and accelerations for the current state.
   pure subroutine set_rates(s)
      type(assembly_t), intent(inout) :: s

      call find_forces(s)
      associate (b => s%bodies)
         call accelerate(b%n, s%gravity, s%tilt, 0.0_wp, b%f, b%inverse, b%a, b%v)
         if (allocated(b%clump)) call accelerate_clumps(s, 0.0_wp)
      end associate
   end subroutine set_rates

   !> Record trouble; the first trouble is kept.
   elemental subroutine note(s, trouble)
      type(assembly_t), intent(inout) :: s
      integer, intent(in) :: trouble

      if (s%trouble == sound) s%trouble = trouble
   end subroutine note

   pure subroutine find_forces(s)
      type(assembly_t), intent(inout) :: s
      logical :: beyond

      associate (b => s%bodies)
         call pair_forces(b%n, s%near%n_pairs, s%near%pair, s%law, s%max_overlap, s%dt, b%x, b%v, b%a, &
                          b%radius, s%touch, b%f, beyond)
         call floor_forces(s, beyond)
         call base_forces(s)
      end associate
      if (beyond) call find_beyond(s)
   end subroutine find_forces

   !> Find the pairs in contact and their centre distances; other pairs lose their state.
   pure subroutine find_touching(n, n_pairs, pair, x, touch, count, place, distance)
      integer, intent(in) :: n, n_pairs
      type(pair_t), intent(in) :: pair(n_pairs)
      real(wp), intent(in) :: x(3, n)               !! [m]
      type(touch_t), intent(inout) :: touch(n_pairs)
      integer, intent(out) :: count, place(n_pairs)
      real(wp), intent(out) :: distance(n_pairs)    !! [m]
      real(wp) :: dx, dy, dz, square
      integer :: k

      count = 0
      do k = 1, n_pairs
         dx = x(1, pair(k)%j) + pair(k)%shift(1) - x(1, pair(k)%i)
         dy = x(2, pair(k)%j) + pair(k)%shift(2) - x(2, pair(k)%i)
         dz = x(3, pair(k)%j) - x(3, pair(k)%i)
         square = dx*dx + dy*dy + dz*dz
         if (square < pair(k)%reach**2) then
            count = count + 1
            place(count) = k
            distance(count) = max(sqrt(square), tiny(square))
         else if (touch(k)%root > 0) then
            touch(k) = touch_t()
         end if
      end do
   end subroutine find_touching

   !> Compute the forces of all pairs. `v` is the velocity at the middle of the step, `a` the acceleration at its start.
   pure subroutine pair_forces(n, n_pairs, pair, law, max_overlap, dt, x, v, a, radius, touch, f, beyond)
      integer, intent(in) :: n, n_pairs
      type(pair_t), intent(in) :: pair(n_pairs)
      type(law_t), intent(in) :: law(n_pairs)
      real(wp), intent(in) :: max_overlap(n_pairs), dt  !! [m], [s]
      real(wp), intent(in) :: x(3, n), v(6, n), a(6, n), radius(n)  !! [m], [m/s] and [rad/s], [m/s2] and [rad/s2], [m]
      type(touch_t), intent(inout) :: touch(n_pairs)
      real(wp), intent(out) :: f(6, n)  !! [N] and [N m]
      logical, intent(out) :: beyond
      type(batch_t) :: b
      type(pairs_t) :: p
      real(wp) :: distance(n_pairs), arm, force(3), moment(3), normal_at(3), shear(3), rolling(3)
      integer :: place(n_pairs), count, first, c, k, i, j

      call find_touching(n, n_pairs, pair, x, touch, count, place, distance)
      beyond = .false.
      f = 0
      do first = 1, count, batch_size
         b%count = min(batch_size, count - first + 1)
         do c = 1, b%count
            k = place(first + c - 1)
            i = pair(k)%i
            j = pair(k)%j
            p%d(c) = distance(first + c - 1)
            b%overlap(c) = pair(k)%reach - p%d(c)
            beyond = beyond .or. .not. b%overlap(c) <= max_overlap(k)
            p%separation(c, :) = x(:, j) - x(:, i)
            p%separation(c, 1:2) = p%separation(c, 1:2) + pair(k)%shift
            p%u(c, :) = v(1:3, j) - v(1:3, i)
            p%pull(c, :) = a(1:3, j) - a(1:3, i)
            p%spin(c, :) = v(4:6, i)
            p%other_spin(c, :) = v(4:6, j)
            p%radius(c) = radius(i)
            p%fraction(c) = law(k)%overlap_fraction
            call put_contact(b, c, law(k), touch(k))
         end do
         call find_rates(p, dt, b)
         call press_batch(b, dt)
         do c = 1, b%count
            k = place(first + c - 1)
            i = pair(k)%i
            j = pair(k)%j
            touch(k) = touch_in(b, c)
            normal_at = b%n(c, :)
            shear = b%shear(c, :)
            rolling = b%moment(c, :)
            arm = p%radius(c) - p%fraction(c)*b%overlap(c)
            force = shear - b%normal(c)*normal_at
            moment = cross(normal_at, shear)
            f(1:3, i) = f(1:3, i) + force
            f(4:6, i) = f(4:6, i) + arm*moment + rolling
            f(1:3, j) = f(1:3, j) - force
            f(4:6, j) = f(4:6, j) + (p%d(c) - arm)*moment - rolling
         end do
      end do
   end subroutine pair_forces

   !> Compute normals and rates of the contacts of pairs, from the geometry at the end of the step and the motion at its
   !> middle: slip is computed at the middle, where the normal was different.
   pure subroutine find_rates(p, dt, b)
      type(pairs_t), intent(in) :: p
      real(wp), intent(in) :: dt           !! [s]
      type(batch_t), intent(inout) :: b
      real(wp) :: inverse, nx, ny, nz, ux, uy, uz, mx, my, mz, ax, ay, az, sx, sy, sz, distance, arm, far_arm, twist
      integer :: k

      do k = 1, b%count
         inverse = 1/p%d(k)
         nx = p%separation(k, 1)*inverse
         ny = p%separation(k, 2)*inverse
         nz = p%separation(k, 3)*inverse
         b%n(k, 1) = nx
         b%n(k, 2) = ny
         b%n(k, 3) = nz
         ux = p%u(k, 1)
         uy = p%u(k, 2)
         uz = p%u(k, 3)
         b%closing(k) = -((ux + 0.5_wp*dt*p%pull(k, 1))*nx + (uy + 0.5_wp*dt*p%pull(k, 2))*ny &
                          + (uz + 0.5_wp*dt*p%pull(k, 3))*nz)
         mx = p%d(k)*nx - 0.5_wp*dt*ux  ! normal at the middle of the step
         my = p%d(k)*ny - 0.5_wp*dt*uy
         mz = p%d(k)*nz - 0.5_wp*dt*uz
         distance = max(sqrt(mx*mx + my*my + mz*mz), tiny(dt))
         inverse = 1/distance
         mx = inverse*mx
         my = inverse*my
         mz = inverse*mz
         ax = my*uz - mz*uy
         ay = mz*ux - mx*uz
         az = mx*uy - my*ux
         arm = p%radius(k) - p%fraction(k)*(b%overlap(k) + p%d(k) - distance)
         far_arm = distance - arm
         twist = 0.5_wp*dt*((p%spin(k, 1) + p%other_spin(k, 1))*mx + (p%spin(k, 2) + p%other_spin(k, 2))*my &
                            + (p%spin(k, 3) + p%other_spin(k, 3))*mz)
         b%rotation(k, 1) = (dt*inverse)*ax + twist*mx
         b%rotation(k, 2) = (dt*inverse)*ay + twist*my
         b%rotation(k, 3) = (dt*inverse)*az + twist*mz
         sx = arm*p%spin(k, 1) + far_arm*p%other_spin(k, 1) - ax
         sy = arm*p%spin(k, 2) + far_arm*p%other_spin(k, 2) - ay
         sz = arm*p%spin(k, 3) + far_arm*p%other_spin(k, 3) - az
         b%slip(k, 1) = sy*mz - sz*my
         b%slip(k, 2) = sz*mx - sx*mz
         b%slip(k, 3) = sx*my - sy*mx
         b%turn(k, 1) = p%spin(k, 1) - p%other_spin(k, 1)
         b%turn(k, 2) = p%spin(k, 2) - p%other_spin(k, 2)
         b%turn(k, 3) = p%spin(k, 3) - p%other_spin(k, 3)
      end do
   end subroutine find_rates

   !> Compute the forces of the rigid floor.
   pure subroutine floor_forces(s, beyond)
      type(assembly_t), intent(inout) :: s
      logical, intent(inout) :: beyond
      real(wp), parameter :: down(3) = [0.0_wp, 0.0_wp, -1.0_wp]
      real(wp) :: overlap, closing, d, slip(3), normal
      integer :: k, i

      s%floor_force = 0
      associate (b => s%bodies)
         do k = 1, size(s%near%low)
            i = s%near%low(k)
            d = b%x(3, i)
            overlap = b%radius(i) - d
            if (overlap <= 0 .or. s%on_base(i)) then  ! the base carries the bodies on it
               s%floor_touch(k) = touch_t()
               cycle
            end if
            beyond = beyond .or. .not. overlap <= s%floor_max_overlap(k)
            closing = -b%v(3, i) - 0.5_wp*s%dt*b%a(3, i)
            slip = in_plane(b%v(1:3, i) + cross((d - 0.5_wp*s%dt*b%v(3, i))*b%v(4:6, i), down), down)
            call press(s%floor_law(k), down, overlap, closing, slip, b%v(4:6, i), &
                       [0.0_wp, 0.0_wp, 0.5_wp*s%dt*b%v(6, i)], s%dt, s%floor_touch(k), normal)
            associate (touch => s%floor_touch(k))
               b%f(1:3, i) = b%f(1:3, i) + touch%shear - normal*down
               b%f(4:6, i) = b%f(4:6, i) + d*cross(down, touch%shear) + touch%moment
            end associate
            s%floor_force = s%floor_force + normal
         end do
      end associate
   end subroutine floor_forces

   !> Compute the forces of an absorbing base. It supports each body by the force that the floor had when the base
   !> became absorbing, and absorbs waves from above by dashpots with the impedance rho c per area (Lysmer & Kuhlemeyer
   !> 1969). The force is implicit in the velocity at the end of the step, and thus stable for any impedance. Call this
   !> after all other forces.
   pure subroutine base_forces(s)
      type(assembly_t), intent(inout) :: s
      real(wp) :: half, v(3)
      integer :: k, i

      if (.not. allocated(s%base)) return
      half = 0.5_wp*s%dt
      associate (b => s%bodies)
         do k = 1, size(s%base)
            i = s%base(k)%body
            b%f(3, i) = b%f(3, i) + s%base(k)%force
            if (in_clump(b, i)) then  ! the motion of its clump determines the force
               v = b%v(1:3, i) + half*b%a(1:3, i)
            else
               v = b%v(1:3, i) + half*b%f(1:3, i)*b%inverse(1:3, i)
               v(3) = v(3) - half*s%gravity
            end if
            b%f(1:3, i) = b%f(1:3, i) - s%base(k)%drag/(1 + half*s%base(k)%drag*b%inverse(1, i))*v
         end do
      end associate
   end subroutine base_forces

   !> Make the base absorbing from now on. It supports the bodies on the floor by constant forces and by dashpots, which
   !> share the area in proportion to the cross sections of the bodies. The margin of the energy check is kept.
   pure subroutine set_absorbing_base(s, impedance)
      type(assembly_t), intent(inout) :: s
      real(wp), intent(in) :: impedance  !! rho c of the ground below [Pa s/m]
      real(wp) :: section, slack
      integer :: k, l

      slack = s%energy_limit - total_energy(s)
      associate (low => s%near%low, r => s%bodies%radius)
         allocate (s%base(count(s%floor_touch%root > 0)))
         section = sum(r(low)**2, s%floor_touch%root > 0)
         k = 0
         do l = 1, size(low)
            if (s%floor_touch(l)%root <= 0) cycle
            k = k + 1
            s%base(k) = base_t(low(l), s%floor_law(l)%hertz*s%floor_touch(l)%root**3, &
                               impedance*s%box%width**2*r(low(l))**2/section)
            s%on_base(low(l)) = .true.
         end do
      end associate
      call set_rates(s)
      s%energy_limit = total_energy(s) + slack
   end subroutine set_absorbing_base

   !> Find the cause of an excessive overlap: Hertz's law or the step.
   pure subroutine find_beyond(s)
      type(assembly_t), intent(inout) :: s
      integer :: k
      logical :: soft

      soft = .false.
      associate (b => s%bodies)
         do k = 1, s%near%n_pairs
            associate (r => min(b%radius(s%near%pair(k)%i), b%radius(s%near%pair(k)%j)))
               soft = soft .or. s%touch(k)%root**2 > deepest_overlap*r
            end associate
         end do
         do k = 1, size(s%near%low)
            soft = soft .or. s%floor_touch(k)%root**2 > deepest_overlap*b%radius(s%near%low(k))
         end do
      end associate
      call note(s, merge(too_soft, step_too_long, soft))
   end subroutine find_beyond

   !> Rebuild the neighbour list; contacts keep their state.
   pure subroutine renew(s)
      type(assembly_t), intent(inout) :: s
      type(neighbours_t) :: old
      type(touch_t), allocatable :: touch(:), floor_touch(:)
      integer :: place(s%bodies%n), k, l

      allocate (old%pair, source=s%near%pair(:s%near%n_pairs))
      allocate (old%low, source=s%near%low)
      call move_alloc(s%touch, touch)
      call move_alloc(s%floor_touch, floor_touch)
      call find_neighbours(s%near, s%box, s%bodies%x, s%bodies%radius)
      call make_laws(s)
      do k = 1, size(old%pair)
         if (touch(k)%root <= 0) cycle
         l = find_pair(s%near, old%pair(k)%i, old%pair(k)%j)
         if (l > 0) s%touch(l) = touch(k)
      end do
      place = 0
      place(s%near%low) = [(k, k=1, size(s%near%low))]
      do k = 1, size(old%low)
         l = place(old%low(k))
         if (l > 0) s%floor_touch(l) = floor_touch(k)
      end do
   end subroutine renew

   !> Set contact laws and overlap limits for a new list of pairs, none of which is in contact yet.
   pure subroutine make_laws(s)
      type(assembly_t), intent(inout) :: s
      integer :: k, n

      if (allocated(s%law)) deallocate (s%law, s%max_overlap, s%floor_law, s%floor_max_overlap)
      n = s%near%n_pairs
      allocate (s%law(n), s%touch(n), s%max_overlap(n))
      do k = 1, n
         associate (b => s%bodies, i => s%near%pair(k)%i, j => s%near%pair(k)%j)
            s%law(k) = pair_law(s%material, b%radius(i), b%mass(i), b%radius(j), b%mass(j), &
                                merge(s%material%boulder_rolling, s%material%rolling, j > b%n - s%near%n_large))
         end associate
      end do
      n = size(s%near%low)
      allocate (s%floor_law(n), s%floor_touch(n), s%floor_max_overlap(n))
      do k = 1, n
         associate (b => s%bodies, i => s%near%low(k))
            s%floor_law(k) = plane_law(s%material, b%radius(i), b%mass(i), &
                                       merge(s%material%boulder_rolling, s%material%rolling, &
                                             i > b%n - s%near%n_large))
         end associate
      end do
      call set_limits(s)
   end subroutine make_laws

   !> Set the limits of the overlaps, which depend on the step.
   pure subroutine set_limits(s)
      type(assembly_t), intent(inout) :: s
      integer :: k

      associate (r => s%bodies%radius)
         do k = 1, s%near%n_pairs
            associate (i => s%near%pair(k)%i, j => s%near%pair(k)%j)
               s%max_overlap(k) = overlap_limit(s%law(k), min(r(i), r(j)), s%dt)
            end associate
         end do
         do k = 1, size(s%near%low)
            s%floor_max_overlap(k) = overlap_limit(s%floor_law(k), r(s%near%low(k)), s%dt)
         end do
      end associate
   end subroutine set_limits

   !> Stiffen the material: springs keep their lengths.
   pure subroutine stiffen(s, young)
      type(assembly_t), intent(inout) :: s
      real(wp), intent(in) :: young  !! [Pa]
      type(touch_t), allocatable :: touch(:), floor_touch(:)
      real(wp) :: factor

      factor = young/s%material%young
      s%material%young = young
      call move_alloc(s%touch, touch)
      call move_alloc(s%floor_touch, floor_touch)
      call scale_springs(touch, factor)
      call scale_springs(floor_touch, factor)
      call make_laws(s)
      s%touch = touch
      s%floor_touch = floor_touch
   end subroutine stiffen

   elemental subroutine scale_springs(touch, factor)
      type(touch_t), intent(inout) :: touch
      real(wp), intent(in) :: factor  !! [-]

      touch%shear = factor*touch%shear
      touch%moment = factor*touch%moment
   end subroutine scale_springs

   !> Maximum overlap permitted by Hertz's law and the step [m]: k = 1.5 hertz sqrt(overlap).
   elemental real(wp) function overlap_limit(law, radius, dt) result(limit)
      type(law_t), intent(in) :: law
      real(wp), intent(in) :: radius, dt  !! radius of the smaller body [m]; step [s]

      limit = min(deepest_overlap*radius, ((greatest_phase/dt)**2*law%mass/(1.5_wp*law%hertz))**2)
   end function overlap_limit

   !> Kinetic, potential and elastic energy [J], minus the work of the base's constant force and of the tilt of gravity
   !> on the last body.
   pure real(wp) function total_energy(s) result(energy)
      type(assembly_t), intent(in) :: s

      associate (b => s%bodies)
         energy = kinetic_energy(b) + s%gravity*mass_moment(b) - s%tilt_work &
                  + sum(stored_energy(s%law, s%touch)) &
                  + sum(stored_energy(s%floor_law, s%floor_touch))
         if (allocated(s%base)) energy = energy - sum(s%base%force*b%x(3, s%base%body))
      end associate
   end function total_energy

   !> Maximum, over all pairs, of overlap over smaller radius [-]: a measure of the validity of Hertz's law.
   pure real(wp) function deepest_share(s) result(deepest)
      type(assembly_t), intent(in) :: s
      integer :: k

      deepest = 0
      associate (r => s%bodies%radius, pair => s%near%pair)
         do k = 1, s%near%n_pairs
            if (s%touch(k)%root > 0) &
               deepest = max(deepest, s%touch(k)%root**2/min(r(pair(k)%i), r(pair(k)%j)))
         end do
      end associate
   end function deepest_share

   !> Check that no energy is gained; called at intervals.
   pure subroutine watch_energy(s)
      type(assembly_t), intent(inout) :: s

      if (.not. total_energy(s) <= s%energy_limit) call note(s, energy_grew)
   end subroutine watch_energy

   !> Text for a trouble code, with advice.
   pure function trouble_text(trouble) result(text)
      integer, intent(in) :: trouble
      character(len=:), allocatable :: text

      select case (trouble)
      case (sound); text = "sound"
      case (leapt); text = "a body moved more than 0.2 of its radius in a step: shorten the step"
      case (too_soft); text = "bodies overlap by more than a radius: too soft, raise young"
      case (step_too_long); text = "the step is too long for the stiffest contact: shorten the step"
      case (energy_grew); text = "energy grew by more than 2 % of what was put in: shorten the step"
      case default; text = "unknown trouble"
      end select
   end function trouble_text
end module lab_step
