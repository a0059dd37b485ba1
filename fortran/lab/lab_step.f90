! SPDX-License-Identifier: BSD-3-Clause
!> Time stepping of spheres in contact: velocity Verlet, with the step taken from the stiffest
!> contact and watched at every step. A run that explodes says so by `trouble`, and is then of no
!> further use.
module lab_step
   use rockfall_kinds, only: wp
   use lab_contact, only: material_t, law_t, touch_t, pair_law, plane_law, press, stored_energy, &
      collision_time, rayleigh_time
   use lab_bodies, only: bodies_t, sphere_mass
   use lab_neighbours, only: box_t, pair_t, neighbours_t, find_neighbours, outdated, find_pair, &
      at_floor, at_left
   implicit none
   private
   public :: assembly_t, assemble, advance, watch_energy, total_energy, deepest_share, safe_step, &
      trouble_text
   public :: sound, leapt, too_soft, step_too_long, energy_grew

   !> What may go wrong; the first is kept.
   integer, parameter :: sound = 0, leapt = 1, too_soft = 2, step_too_long = 3, energy_grew = 4

   real(wp), parameter :: steps_per_collision = 14 !! of the two smallest bodies at top speed
   real(wp), parameter :: rayleigh_share = 0.2_wp     !! of the Rayleigh time of the smallest body
   real(wp), parameter :: longest_leap = 0.2_wp       !! of the body's radius in a step
   real(wp), parameter :: deepest_overlap = 1 !! of the smaller radius: Hertz's law ends long before
   ! A body held by several such contacts swings up to 2.5 times, its spin 1.7 times as fast; Verlet
   ! needs < 2.
   real(wp), parameter :: greatest_phase = 0.4_wp     !! sqrt(k/m*) dt of a contact
   real(wp), parameter :: energy_tolerance = 0.02_wp  !! growth, of what was put in

   type :: assembly_t
      type(bodies_t) :: bodies
      type(box_t) :: box
      type(material_t) :: material
      real(wp) :: gravity = 9.81_wp                !! [m/s2]
      real(wp) :: dt = 0                           !! [s]
      type(neighbours_t) :: near
      type(law_t), allocatable :: law(:)           !! of each pair
      type(touch_t), allocatable :: touch(:)
      real(wp), allocatable :: most(:) !! overlap that the step and Hertz's law allow [m]
      type(law_t), allocatable :: beside_law(:)    !! of each body near floor or sides
      type(touch_t), allocatable :: beside_touch(:)
      real(wp), allocatable :: beside_most(:)
      real(wp) :: floor_force = 0                  !! upward force of the floor [N]
      real(wp) :: energy_limit = huge(1.0_wp)      !! [J]
      integer :: trouble = sound
   end type assembly_t

contains

   !> A step for bodies of radius `radius` or more that meet at `speed` or less [s].
   elemental real(wp) function safe_step(material, radius, density, speed) result(dt)
      type(material_t), intent(in) :: material
      real(wp), intent(in) :: radius, density, speed  !! [m], [kg/m3], > 0 [m/s]

      dt = collision_time(material, radius/2, sphere_mass(radius, density)/2, speed)
      dt = min(dt/steps_per_collision, &
               rayleigh_time(material, radius, density)*rayleigh_share)
   end function safe_step

   !> Ready to step: neighbours and forces of the initial state. `input` is the energy scale for the
   !> watch on explosions: what moves or falls at the start [J].
   pure subroutine assemble(s, bodies, box, material, gravity, dt, skin, n_large, input)
      type(assembly_t), intent(out) :: s
      type(bodies_t), intent(in) :: bodies
      type(box_t), intent(in) :: box
      type(material_t), intent(in) :: material
      real(wp), intent(in) :: gravity, dt, skin, input
      integer, intent(in) :: n_large

      s%bodies = bodies
      s%box = box
      s%material = material
      s%gravity = gravity
      s%dt = dt
      s%near%skin = skin
      s%near%n_large = n_large
      call find_neighbours(s%near, s%box, s%bodies%x, s%bodies%radius)
      call make_laws(s)
      call find_forces(s)
      call set_rates(s)
      s%energy_limit = total_energy(s) + energy_tolerance*input
   end subroutine assemble

   !> One step.
   pure subroutine advance(s)
      type(assembly_t), intent(inout) :: s
      real(wp) :: half, leap(2)
      integer :: k
      logical :: sound_step

      half = 0.5_wp*s%dt
      associate (b => s%bodies)
         call kick(3*b%n, half, b%a, b%v)
         sound_step = .true.
         do k = 1, b%n
            leap(1) = s%dt*b%v(1, k)
            leap(2) = s%dt*b%v(2, k)
            b%x(1, k) = b%x(1, k) + leap(1)
            b%x(2, k) = b%x(2, k) + leap(2)
            sound_step = sound_step .and. leap(1)**2 + leap(2)**2 <= (longest_leap*b%radius(k))**2
         end do
         if (.not. sound_step) then  ! a NaN comes here as well
            call note(s, leapt)
            return
         end if
         if (outdated(s%near, b%x)) call renew(s)
         call find_forces(s)
         call set_rates(s)
         call kick(3*b%n, half, b%a, b%v)
      end associate
   end subroutine advance

   !> Change velocities by accelerations.
   pure subroutine kick(n, time, a, v)
      integer, intent(in) :: n
      real(wp), intent(in) :: time, a(n)
      real(wp), intent(inout) :: v(n)

      v = v + time*a
   end subroutine kick

   pure subroutine set_rates(s)
      type(assembly_t), intent(inout) :: s
      integer :: k

      associate (b => s%bodies)
         do k = 1, b%n
            b%a(1, k) = b%f(1, k)*b%inverse(1, k)
            b%a(2, k) = b%f(2, k)*b%inverse(2, k) - s%gravity
            b%a(3, k) = b%f(3, k)*b%inverse(3, k)
         end do
      end associate
   end subroutine set_rates

   !> The first trouble stays.
   elemental subroutine note(s, trouble)
      type(assembly_t), intent(inout) :: s
      integer, intent(in) :: trouble

      if (s%trouble == sound) s%trouble = trouble
   end subroutine note

   pure subroutine find_forces(s)
      type(assembly_t), intent(inout) :: s
      logical :: beyond

      associate (b => s%bodies)
         b%f = 0
         call pair_forces(b%n, s%near%n_pairs, s%near%pair, s%law, s%most, s%dt, b%x, b%v, b%a, &
            b%radius, &
                          s%touch, b%f, beyond)
         call beside_forces(s, beyond)
      end associate
      if (beyond) call find_beyond(s)
   end subroutine find_forces

   !> The pairs that touch, and the distance of their centres; the others forget.
   pure subroutine find_touching(n, n_pairs, pair, x, touch, count, place, distance)
      integer, intent(in) :: n, n_pairs
      type(pair_t), intent(in) :: pair(n_pairs)
      real(wp), intent(in) :: x(2, n)
      type(touch_t), intent(inout) :: touch(n_pairs)
      integer, intent(out) :: count, place(n_pairs)
      real(wp), intent(out) :: distance(n_pairs)
      real(wp) :: dx, dz, square
      integer :: k

      count = 0
      do k = 1, n_pairs
         dx = x(1, pair(k)%j) + pair(k)%shift - x(1, pair(k)%i)
         dz = x(2, pair(k)%j) - x(2, pair(k)%i)
         square = dx*dx + dz*dz
         if (square < pair(k)%reach**2) then
            count = count + 1
            place(count) = k
            distance(count) = max(sqrt(square), tiny(square))
         else if (touch(k)%root > 0) then
            touch(k) = touch_t()
         end if
      end do
   end subroutine find_touching

   !> Forces of all pairs. `v` is the velocity in the middle of the step, `a` the acceleration at
   !> its start.
   pure subroutine pair_forces(n, n_pairs, pair, law, most, dt, x, v, a, radius, touch, f, beyond)
      integer, intent(in) :: n, n_pairs
      type(pair_t), intent(in) :: pair(n_pairs)
      type(law_t), intent(in) :: law(n_pairs)
      real(wp), intent(in) :: most(n_pairs), dt, x(2, n), v(3, n), a(3, n), radius(n)
      type(touch_t), intent(inout) :: touch(n_pairs)
      real(wp), intent(inout) :: f(3, n)
      logical, intent(out) :: beyond
      real(wp) :: d, nx, nz, ux, uz, overlap, opening, closing, drift, arm, slip, normal, fx, fz
      real(wp) :: distance(n_pairs)
      integer :: place(n_pairs), count, c, k, i, j

      call find_touching(n, n_pairs, pair, x, touch, count, place, distance)
      beyond = .false.
      do c = 1, count
         k = place(c)
         i = pair(k)%i
         j = pair(k)%j
         d = distance(c)
         overlap = pair(k)%reach - d
         beyond = beyond .or. .not. overlap <= most(k)
         nx = (x(1, j) + pair(k)%shift - x(1, i))*(1/d)
         nz = (x(2, j) - x(2, i))*(1/d)
         ux = v(1, j) - v(1, i)
         uz = v(2, j) - v(2, i)
         opening = ux*nx + uz*nz
         closing = -opening - 0.5_wp*dt*((a(1, j) - a(1, i))*nx + (a(2, j) - a(2, i))*nz)
         ! to the middle of the step, where the tangent was d/(d - drift) as long
         drift = 0.5_wp*dt*opening
         arm = radius(i) - law(k)%share*(overlap + drift)
         slip = (uz*nx - ux*nz)*(1 + drift*(1/d)) + v(3, i)*arm + v(3, j)*(d - drift - arm)
         call press(law(k), overlap, closing, slip, v(3, i) - v(3, j), dt, touch(k), normal)
         arm = radius(i) - law(k)%share*overlap
         fx = normal*nx - touch(k)%shear*nz
         fz = normal*nz + touch(k)%shear*nx
         f(1, i) = f(1, i) - fx
         f(2, i) = f(2, i) - fz
         f(3, i) = f(3, i) + touch(k)%shear*arm + touch(k)%moment
         f(1, j) = f(1, j) + fx
         f(2, j) = f(2, j) + fz
         f(3, j) = f(3, j) + touch(k)%shear*(d - arm) - touch(k)%moment
      end do
   end subroutine pair_forces

   !> Forces of floor and sides.
   pure subroutine beside_forces(s, beyond)
      type(assembly_t), intent(inout) :: s
      logical, intent(inout) :: beyond
      real(wp) :: n(2), overlap, opening, closing, slip, normal
      integer :: k, i

      s%floor_force = 0
      associate (b => s%bodies)
         do k = 1, size(s%near%beside)
            i = s%near%beside(k)%body
            call plane_of(s, k, n, overlap)
            if (overlap <= 0) then
               s%beside_touch(k) = touch_t()
               cycle
            end if
            beyond = beyond .or. .not. overlap <= s%beside_most(k)
            opening = -sum(b%v(1:2, i)*n)
            closing = -opening + 0.5_wp*s%dt*sum(b%a(1:2, i)*n)
            slip = b%v(1, i)*n(2) - b%v(2, i)*n(1) &
                   + b%v(3, i)*(b%radius(i) - overlap - 0.5_wp*s%dt*opening)
            call press(s%beside_law(k), overlap, closing, slip, b%v(3, i), s%dt, &
               s%beside_touch(k), normal)
            associate (shear => s%beside_touch(k)%shear, moment => s%beside_touch(k)%moment)
               b%f(1, i) = b%f(1, i) - normal*n(1) + shear*n(2)
               b%f(2, i) = b%f(2, i) - normal*n(2) - shear*n(1)
               b%f(3, i) = b%f(3, i) + shear*(b%radius(i) - overlap) + moment
            end associate
            if (s%near%beside(k)%side == at_floor) s%floor_force = s%floor_force + normal
         end do
      end associate
   end subroutine beside_forces

   !> Normal from the body to the plane that it is near, and overlap with it [m].
   pure subroutine plane_of(s, k, n, overlap)
      type(assembly_t), intent(in) :: s
      integer, intent(in) :: k
      real(wp), intent(out) :: n(2), overlap
      real(wp) :: gap

      associate (x => s%bodies%x(:, s%near%beside(k)%body))
         select case (s%near%beside(k)%side)
         case (at_floor)
            n = [0.0_wp, -1.0_wp]
            gap = x(2)
         case (at_left)
            n = [-1.0_wp, 0.0_wp]
            gap = x(1)
         case default
            n = [1.0_wp, 0.0_wp]
            gap = s%box%width - x(1)
         end select
      end associate
      overlap = s%bodies%radius(s%near%beside(k)%body) - gap
   end subroutine plane_of

   !> Some overlap exceeds what is allowed: by the law, or by the step?
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
         do k = 1, size(s%near%beside)
            soft = soft &
               .or. s%beside_touch(k)%root**2 > deepest_overlap*b%radius(s%near%beside(k)%body)
         end do
      end associate
      call note(s, merge(too_soft, step_too_long, soft))
   end subroutine find_beyond

   !> A new list of neighbours; contacts keep what they remember.
   pure subroutine renew(s)
      type(assembly_t), intent(inout) :: s
      type(neighbours_t) :: old
      type(touch_t), allocatable :: touch(:), beside_touch(:)
      integer :: k, l

      allocate (old%pair, source=s%near%pair(:s%near%n_pairs))
      allocate (old%beside, source=s%near%beside)
      call move_alloc(s%touch, touch)
      call move_alloc(s%beside_touch, beside_touch)
      call find_neighbours(s%near, s%box, s%bodies%x, s%bodies%radius)
      call make_laws(s)
      do k = 1, size(old%pair)
         if (touch(k)%root <= 0) cycle
         l = find_pair(s%near, old%pair(k)%i, old%pair(k)%j)
         if (l > 0) s%touch(l) = touch(k)
      end do
      do k = 1, size(old%beside)
         if (beside_touch(k)%root <= 0) cycle
         do l = 1, size(s%near%beside)
            if (s%near%beside(l)%body == old%beside(k)%body &
               .and. s%near%beside(l)%side == old%beside(k)%side) &
               s%beside_touch(l) = beside_touch(k)
         end do
      end do
   end subroutine renew

   !> Laws and limits of the pairs of a new list; nothing touches yet.
   pure subroutine make_laws(s)
      type(assembly_t), intent(inout) :: s
      integer :: k, n

      if (allocated(s%law)) deallocate (s%law, s%most, s%beside_law, s%beside_most)
      n = s%near%n_pairs
      allocate (s%law(n), s%touch(n), s%most(n))
      do k = 1, n
         associate (b => s%bodies, i => s%near%pair(k)%i, j => s%near%pair(k)%j)
            s%law(k) = pair_law(s%material, b%radius(i), b%mass(i), b%radius(j), b%mass(j))
            s%most(k) = overlap_limit(s%law(k), min(b%radius(i), b%radius(j)), s%dt)
         end associate
      end do
      n = size(s%near%beside)
      allocate (s%beside_law(n), s%beside_touch(n), s%beside_most(n))
      do k = 1, n
         associate (b => s%bodies, i => s%near%beside(k)%body)
            s%beside_law(k) = plane_law(s%material, b%radius(i), b%mass(i))
            s%beside_most(k) = overlap_limit(s%beside_law(k), b%radius(i), s%dt)
         end associate
      end do
   end subroutine make_laws

   !> Overlap up to which Hertz's law and the step hold [m]: k = 1.5 hertz sqrt(overlap).
   elemental real(wp) function overlap_limit(law, radius, dt) result(most)
      type(law_t), intent(in) :: law
      real(wp), intent(in) :: radius, dt

      most = min(deepest_overlap*radius, ((greatest_phase/dt)**2*law%mass/(1.5_wp*law%hertz))**2)
   end function overlap_limit

   !> Kinetic, gravitational and elastic energy [J].
   pure real(wp) function total_energy(s) result(energy)
      type(assembly_t), intent(in) :: s

      associate (b => s%bodies)
         energy = 0.5_wp*sum(b%v**2/b%inverse) + s%gravity*sum(b%mass*b%x(2, :)) &
                  + sum(stored_energy(s%law, s%touch)) &
                  + sum(stored_energy(s%beside_law, s%beside_touch))
      end associate
   end function total_energy

   !> Deepest overlap of two bodies / the smaller radius: how far from Hertz's small ones.
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

   !> Energy may only be lost: to be called now and then.
   pure subroutine watch_energy(s)
      type(assembly_t), intent(inout) :: s

      if (.not. total_energy(s) <= s%energy_limit) call note(s, energy_grew)
   end subroutine watch_energy

   !> What `trouble` means, and what helps.
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
