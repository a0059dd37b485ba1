! SPDX-License-Identifier: BSD-3-Clause
!> Contact model for two spheres, or a sphere and a plane: Hertz along the normal, Mindlin's spring with Coulomb's limit
!> in the tangent plane, and optionally viscous normal damping and rolling resistance. Procedures are pure: the caller
!> provides the geometry and stores the state of contacts.
module lab_contact
   use rockfall_kinds, only: wp
   use rockfall_error, only: error_t, fail
   use rockfall_math, only: pi, logarithm, exponential
   implicit none
   private
   public :: material_t, law_t, touch_t, pair_law, plane_law, press, stored_energy
   public :: batch_t, batch_size, put_contact, touch_in, press_batch
   public :: check_material, reduced_modulus, cross, in_plane, collision_time, rayleigh_time

   !> Material of all bodies and planes.
   type :: material_t
      real(wp) :: young = 1.0e9_wp   !! [Pa]
      real(wp) :: poisson = 0.25_wp  !! [-]
      real(wp) :: friction = 0.5_wp  !! Coulomb coefficient [-]
      real(wp) :: damping = 0.0_wp   !! fraction of critical damping [-], see `contact_law`
      real(wp) :: rolling = 0.0_wp   !! maximum rolling moment over (R* normal force), rock on rock [-]
      real(wp) :: boulder_rolling = 0.0_wp !! the same for boulder on rock [-]
   end type material_t

   !> Contact parameters of a given pair of bodies.
   type :: law_t
      real(wp) :: hertz = 0    !! normal force over overlap**1.5 [N/m1.5]
      real(wp) :: mindlin = 0  !! tangential stiffness over overlap**0.5 [N/m1.5]
      real(wp) :: viscous = 0  !! viscous force over (rate of overlap * overlap**0.25) [N s/m1.25]
      real(wp) :: bending = 0  !! rolling stiffness over overlap**0.5 [N m0.5]
      real(wp) :: friction = 0 !! maximum tangential force over normal force [-]
      real(wp) :: rolling = 0  !! maximum rolling moment over normal force [m]
      real(wp) :: overlap_fraction = 0  !! fraction of the overlap in the first body [-]
      real(wp) :: mass = 0     !! reduced mass m* [kg]
   end type law_t

   !> State of a contact.
   type :: touch_t
      real(wp) :: root = 0       !! square root of the overlap; 0: apart [m0.5]
      real(wp) :: shear(3) = 0   !! tangential force on the first body [N]
      real(wp) :: moment(3) = 0  !! rolling moment on the first body [N m]
   end type touch_t

   integer, parameter :: batch_size = 16

   !> Contacts that are advanced together: components of `law_t` and `touch_t`, and arguments of `press`.
   type :: batch_t
      integer :: count = 0
      real(wp), dimension(batch_size) :: hertz, mindlin, viscous, bending, friction, rolling
      real(wp), dimension(batch_size) :: overlap, closing, root, normal
      real(wp), dimension(batch_size, 3) :: n, slip, turn, rotation, shear, moment
   end type batch_t

   ! Beyond these limits, the viscous or rolling part of a contact is stiffer than its normal spring, which determines
   ! the step: the motion would be wrong without any sign of trouble.
   real(wp), parameter :: max_damping = 1, max_rolling = 2

contains

   !> Check the properties of a material.
   pure subroutine check_material(material, error)
      type(material_t), intent(in) :: material
      type(error_t), allocatable, intent(out) :: error

      if (.not. material%young > 0) then
         call fail(error, "material: young must be > 0 [Pa]")
      else if (.not. (material%poisson > -1 .and. material%poisson <= 0.5_wp)) then
         call fail(error, "material: poisson must be above -1 and at most 0.5")
      else if (.not. (material%friction >= 0 .and. material%friction < huge(1.0_wp))) then
         call fail(error, "material: friction must be >= 0")
      else if (.not. (material%damping >= 0 .and. material%damping <= max_damping)) then
         call fail(error, "material: damping must be 0 to 1")
      else if (.not. (material%rolling >= 0 .and. material%rolling <= max_rolling)) then
         call fail(error, "material: rolling must be 0 to 2")
      else if (.not. (material%boulder_rolling >= 0 .and. material%boulder_rolling <= max_rolling)) then
         call fail(error, "material: boulder_rolling must be 0 to 2")
      end if
   end subroutine check_material

   !> Contact parameters of two spheres.
   elemental type(law_t) function pair_law(material, r1, m1, r2, m2, rolling) result(law)
      type(material_t), intent(in) :: material
      real(wp), intent(in) :: r1, r2   !! radii [m]
      real(wp), intent(in) :: m1, m2   !! masses [kg]
      real(wp), intent(in) :: rolling  !! maximum rolling moment over (R* normal force) [-]

      law = contact_law(material, r1*r2/(r1 + r2), m1*m2/(m1 + m2), rolling)
      law%overlap_fraction = r2/(r1 + r2)
   end function pair_law

   !> Contact parameters of a sphere and a fixed plane.
   elemental type(law_t) function plane_law(material, r, m, rolling) result(law)
      type(material_t), intent(in) :: material
      real(wp), intent(in) :: r, m     !! [m], [kg]
      real(wp), intent(in) :: rolling  !! maximum rolling moment over (R* normal force) [-]

      law = contact_law(material, r, m, rolling)
      law%overlap_fraction = 1
   end function plane_law

   !> Hertz: F = 4/3 E* sqrt(R*) d**1.5. Mindlin without slip: k_t = 8 G* sqrt(R* d). Viscous part of Tsuji et al.
   !> (1992): c = sqrt(5) damping sqrt(m* K) d**0.25 with K = F/d**1.5. In terms of d**1.25 the collision is then a
   !> linear oscillator with this fraction of critical damping, at any speed (Antypov & Elliott 2011). Rolling
   !> resistance of type C of Ai et al. (2011), a limited spring, without its viscous part: k_r = 2.25 k_n (rolling
   !> R*)**2.
   elemental type(law_t) function contact_law(material, radius, mass, rolling) result(law)
      type(material_t), intent(in) :: material
      real(wp), intent(in) :: radius, mass  !! R* [m], m* [kg]
      real(wp), intent(in) :: rolling       !! [-]
      real(wp) :: shear_modulus

      ! G* of two bodies of the same material
      shear_modulus = material%young/(4*(2 - material%poisson)*(1 + material%poisson))
      law%hertz = 4.0_wp/3*reduced_modulus(material)*sqrt(radius)
      law%mindlin = 8*shear_modulus*sqrt(radius)
      law%viscous = sqrt(5*mass*law%hertz)*material%damping
      law%friction = material%friction
      law%rolling = rolling*radius
      law%bending = 2.25_wp*1.5_wp*law%hertz*law%rolling**2
      law%mass = mass
   end function contact_law

   !> E* of two bodies of the same material [Pa].
   elemental real(wp) function reduced_modulus(material)
      type(material_t), intent(in) :: material

      reduced_modulus = material%young/(2*(1 - material%poisson**2))
   end function reduced_modulus

   !> Advance one contact by one time step, see `press_batch`.
   pure subroutine press(law, n, overlap, closing, slip, turn, rotation, dt, touch, normal)
      type(law_t), intent(in) :: law
      real(wp), intent(in) :: n(3)     !! unit normal at the end of the step, first to second [-]
      real(wp), intent(in) :: overlap  !! overlap at the end of the step, > 0 [m]
      real(wp), intent(in) :: closing  !! rate of overlap at the end of the step [m/s]
      real(wp), intent(in) :: slip(3)  !! tangential velocity of the first surface relative to the second [m/s]
      real(wp), intent(in) :: turn(3)  !! spin of the first body relative to the second [rad/s]
      real(wp), intent(in) :: rotation(3) !! rotation of the contact normal during the step, and about it [rad]
      real(wp), intent(in) :: dt       !! [s]
      type(touch_t), intent(inout) :: touch
      real(wp), intent(out) :: normal  !! force between the bodies, never attractive [N]
      type(batch_t) :: b

      b%count = 1
      call put_contact(b, 1, law, touch)
      b%n(1, :) = n
      b%overlap(1) = overlap
      b%closing(1) = closing
      b%slip(1, :) = slip
      b%turn(1, :) = turn
      b%rotation(1, :) = rotation
      call press_batch(b, dt)
      touch = touch_in(b, 1)
      normal = b%normal(1)
   end subroutine press

   !> Store parameters and state of a contact at a place of a batch.
   pure subroutine put_contact(b, place, law, touch)
      type(batch_t), intent(inout) :: b
      integer, intent(in) :: place
      type(law_t), intent(in) :: law
      type(touch_t), intent(in) :: touch

      b%hertz(place) = law%hertz
      b%mindlin(place) = law%mindlin
      b%viscous(place) = law%viscous
      b%bending(place) = law%bending
      b%friction(place) = law%friction
      b%rolling(place) = law%rolling
      b%root(place) = touch%root
      b%shear(place, :) = touch%shear
      b%moment(place, :) = touch%moment
   end subroutine put_contact

   !> State of a contact in a batch.
   pure type(touch_t) function touch_in(b, place) result(touch)
      type(batch_t), intent(in) :: b
      integer, intent(in) :: place

      touch%root = b%root(place)
      touch%shear = b%shear(place, :)
      touch%moment = b%moment(place, :)
   end function touch_in

   !> Advance the contacts of a batch by one time step. The normal force uses the state at the end of the step, and
   !> increments of the springs use the rates at its middle: both are second-order. A spring keeps its force while the
   !> overlap grows, and its length while the overlap shrinks, so that no cycle of load and slip gains energy. Springs
   !> rotate with the contact. Conditions are written as choices of values, so that loops over contacts vectorise.
   pure subroutine press_batch(b, dt)
      type(batch_t), intent(inout) :: b
      real(wp), intent(in) :: dt  !! [s]
      real(wp) :: root, before, mean, time
      real(wp), dimension(batch_size) :: kept, shear_gain, moment_gain, max_shear, max_moment
      integer :: k

      do k = 1, b%count
         before = b%root(k)
         root = sqrt(b%overlap(k))
         b%normal(k) = max(0.0_wp, b%hertz(k)*b%overlap(k)*root + b%viscous(k)*sqrt(root)*b%closing(k))
         kept(k) = merge(root/max(before, tiny(before)), 1.0_wp, root < before)
         ! if the overlap d grows: mean of sqrt(d), for linear growth of d
         mean = merge(root, 2*(b%overlap(k) + before*(root + before))/(3*(root + before)), root < before)
         ! the contact may have begun within the step
         time = merge(b%overlap(k)/max(b%closing(k), tiny(dt)), dt, before <= 0 .and. b%closing(k)*dt > b%overlap(k))
         shear_gain(k) = -b%mindlin(k)*mean*time
         moment_gain(k) = -b%bending(k)*mean*time
         max_shear(k) = b%friction(k)*b%normal(k)
         max_moment(k) = b%rolling(k)*b%normal(k)
         b%root(k) = root
      end do
      call move_springs(b%count, b%n, b%rotation, kept, shear_gain, b%slip, max_shear, b%shear)
      call move_springs(b%count, b%n, b%rotation, kept, moment_gain, b%turn, max_moment, b%moment)
   end subroutine press_batch

   !> Move tangential springs. Their forces change linearly and rotate (to second order), stay in the plane of the
   !> contact, and are limited.
   pure subroutine move_springs(count, n, rotation, kept, gain, rate, max_force, spring)
      integer, intent(in) :: count
      real(wp), intent(in), dimension(batch_size, 3) :: n, rotation, rate  !! [-], [rad], [m/s] or [rad/s]
      real(wp), intent(in), dimension(batch_size) :: kept, gain, max_force !! [-], force per rate, [N] or [N m]
      real(wp), intent(inout) :: spring(batch_size, 3)  !! [N] or [N m]
      real(wp) :: x, y, z, ux, uy, uz, mx, my, mz, along, square, factor
      integer :: k

      do k = 1, count
         x = kept(k)*spring(k, 1)
         y = kept(k)*spring(k, 2)
         z = kept(k)*spring(k, 3)
         ux = gain(k)*rate(k, 1)
         uy = gain(k)*rate(k, 2)
         uz = gain(k)*rate(k, 3)
         mx = x + 0.5_wp*(ux + (rotation(k, 2)*z - rotation(k, 3)*y))
         my = y + 0.5_wp*(uy + (rotation(k, 3)*x - rotation(k, 1)*z))
         mz = z + 0.5_wp*(uz + (rotation(k, 1)*y - rotation(k, 2)*x))
         x = x + ux + (rotation(k, 2)*mz - rotation(k, 3)*my)
         y = y + uy + (rotation(k, 3)*mx - rotation(k, 1)*mz)
         z = z + uz + (rotation(k, 1)*my - rotation(k, 2)*mx)
         along = x*n(k, 1) + y*n(k, 2) + z*n(k, 3)
         x = x - along*n(k, 1)
         y = y - along*n(k, 2)
         z = z - along*n(k, 3)
         square = x*x + y*y + z*z
         factor = merge(max_force(k)/sqrt(max(square, tiny(square))), 1.0_wp, square > max_force(k)**2)
         spring(k, 1) = x*factor
         spring(k, 2) = y*factor
         spring(k, 3) = z*factor
      end do
   end subroutine move_springs

   !> Component of a vector in the plane that is normal to n.
   pure function in_plane(v, n)
      real(wp), intent(in) :: v(3), n(3)  !! any [unit], unit normal [-]
      real(wp) :: in_plane(3)

      in_plane = v - (v(1)*n(1) + v(2)*n(2) + v(3)*n(3))*n
   end function in_plane

   pure function cross(a, b)
      real(wp), intent(in) :: a(3), b(3)  !! any [unit]
      real(wp) :: cross(3)

      cross = [a(2)*b(3) - a(3)*b(2), a(3)*b(1) - a(1)*b(3), a(1)*b(2) - a(2)*b(1)]
   end function cross

   !> Elastic energy stored in a contact [J].
   elemental real(wp) function stored_energy(law, touch) result(energy)
      type(law_t), intent(in) :: law
      type(touch_t), intent(in) :: touch

      energy = 0
      if (touch%root <= 0) return
      energy = 0.4_wp*law%hertz*touch%root**5
      if (law%friction > 0) energy = energy + 0.5_wp*sum(touch%shear**2)/(law%mindlin*touch%root)
      if (law%rolling > 0) energy = energy &
                                    + 0.5_wp*sum(touch%moment**2)/(law%bending*touch%root)
   end function stored_energy

   !> Duration of an elastic Hertzian collision [s]: 2.868 (m***2/(R* E***2 v))**(1/5).
   elemental real(wp) function collision_time(material, radius, mass, speed) result(time)
      type(material_t), intent(in) :: material
      real(wp), intent(in) :: radius, mass  !! R* [m], m* [kg]
      real(wp), intent(in) :: speed         !! speed of approach, > 0 [m/s]
      ! 2 int_0^1 dx/sqrt(1 - x**2.5) * (15/16)**0.4
      real(wp), parameter :: coefficient = 2.868265699195333_wp

      time = (mass/reduced_modulus(material))**2/(radius*speed)
      time = coefficient*exponential(logarithm(time)/5)
   end function collision_time

   !> Time for a Rayleigh wave to travel half round a sphere [s].
   elemental real(wp) function rayleigh_time(material, radius, density) result(time)
      type(material_t), intent(in) :: material
      real(wp), intent(in) :: radius, density  !! [m], [kg/m3]

      associate (nu => material%poisson)
         time = pi*radius*sqrt(2*(1 + nu)*density/material%young)/(0.1631_wp*nu + 0.8766_wp)
      end associate
   end function rayleigh_time
end module lab_contact
