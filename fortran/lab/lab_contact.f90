! SPDX-License-Identifier: BSD-3-Clause
!> Contact model for two spheres, or a sphere and a plane: Hertz along the normal, Mindlin's spring with Coulomb's
!> limit in the tangent plane, and optionally viscous normal damping and rolling resistance. Pure: the caller provides
!> the geometry, and stores the state of contacts.
module lab_contact
   use rockfall_kinds, only: wp
   use rockfall_error, only: error_t, fail
   use rockfall_math, only: pi, logarithm, exponential
   implicit none
   private
   public :: material_t, law_t, touch_t, pair_law, plane_law, press, stored_energy
   public :: check_material, reduced_modulus, cross, in_plane, collision_time, rayleigh_time

   !> One material for all bodies and planes.
   type :: material_t
      real(wp) :: young = 1.0e9_wp   !! [Pa]
      real(wp) :: poisson = 0.25_wp  !! [-]
      real(wp) :: friction = 0.5_wp  !! Coulomb coefficient [-]
      real(wp) :: damping = 0.0_wp   !! fraction of critical damping [-]: see `press`
      real(wp) :: rolling = 0.0_wp   !! max rolling moment / (R* normal force), rock on rock [-]
      real(wp) :: boulder_rolling = 0.0_wp !! as `rolling`, boulder on rock [-]
   end type material_t

   !> Contact parameters of a given pair of bodies.
   type :: law_t
      real(wp) :: hertz = 0    !! normal force / overlap**1.5 [N/m1.5]
      real(wp) :: mindlin = 0  !! tangential stiffness / overlap**0.5 [N/m1.5]
      real(wp) :: viscous = 0  !! viscous force / (rate of overlap * overlap**0.25) [N s/m1.25]
      real(wp) :: bending = 0  !! rolling stiffness / overlap**0.5 [N m0.5]
      real(wp) :: friction = 0 !! max tangential / normal force [-]
      real(wp) :: rolling = 0  !! max rolling moment / normal force [m]
      real(wp) :: overlap_fraction = 0  !! fraction of the overlap in the first body [-]
      real(wp) :: mass = 0     !! reduced mass m* [kg]
   end type law_t

   !> State of a contact.
   type :: touch_t
      real(wp) :: root = 0       !! square root of the overlap; 0: apart [m0.5]
      real(wp) :: shear(3) = 0   !! tangential force on the first body [N]
      real(wp) :: moment(3) = 0  !! rolling moment on the first body [N m]
   end type touch_t

   ! Beyond these, the viscous or rolling part of a contact is stiffer than its normal spring, which determines the
   ! step, and the motion becomes wrong without notice.
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
      real(wp), intent(in) :: rolling  !! max rolling moment / (R* normal force) [-]

      law = contact_law(material, r1*r2/(r1 + r2), m1*m2/(m1 + m2), rolling)
      law%overlap_fraction = r2/(r1 + r2)
   end function pair_law

   !> Contact parameters of a sphere and a fixed plane.
   elemental type(law_t) function plane_law(material, r, m, rolling) result(law)
      type(material_t), intent(in) :: material
      real(wp), intent(in) :: r, m     !! [m], [kg]
      real(wp), intent(in) :: rolling  !! max rolling moment / (R* normal force) [-]

      law = contact_law(material, r, m, rolling)
      law%overlap_fraction = 1
   end function plane_law

   !> Hertz: F = 4/3 E* sqrt(R*) d**1.5. Mindlin without slip: k_t = 8 G* sqrt(R* d). Viscous part of Tsuji et al.
   !> (1992), c = sqrt(5) damping sqrt(m* K) d**0.25 with K = F/d**1.5: in terms of d**1.25 the collision is a linear
   !> oscillator with this fraction of critical damping, at any speed (Antypov & Elliott 2011). Rolling as type C of Ai
   !> et al. (2011), a spring with a limit, without the viscous part: k_r = 2.25 k_n (rolling R*)**2.
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

   !> Advance a contact by one time step. The normal force is that of the state at the end of the step, the increments
   !> of the springs use the rates at its middle: both of second order. A spring keeps its force while the overlap grows
   !> and its length while it shrinks, so that no cycle of load and slip yields energy. It rotates with the contact.
   pure subroutine press(law, n, overlap, closing, slip, turn, rotation, dt, touch, normal)
      type(law_t), intent(in) :: law
      real(wp), intent(in) :: n(3)     !! unit normal at the end of the step, first to second [-]
      real(wp), intent(in) :: overlap  !! at the end of the step, > 0 [m]
      real(wp), intent(in) :: closing  !! rate of overlap at the end of the step [m/s]
      real(wp), intent(in) :: slip(3)  !! velocity of the first surface over the second, tangential [m/s]
      real(wp), intent(in) :: turn(3)  !! spin of the first body relative to the second [rad/s]
      real(wp), intent(in) :: rotation(3) !! of the contact normal during the step, and about it [rad]
      real(wp), intent(in) :: dt       !! [s]
      type(touch_t), intent(inout) :: touch
      real(wp), intent(out) :: normal  !! force between the bodies, never attractive [N]
      real(wp) :: root, before, mean, kept, time

      root = sqrt(overlap)
      normal = law%hertz*overlap*root
      if (law%viscous > 0) normal = max(0.0_wp, normal + law%viscous*sqrt(root)*closing)
      if (law%friction > 0) then
         before = touch%root
         kept = 1
         mean = root
         if (root < before) then
            kept = root/before
         else  ! mean of sqrt(d) for a linear growth of d
            mean = 2*(overlap + before*(root + before))/(3*(root + before))
         end if
         time = dt
         ! the contact began within the step
         if (before <= 0 .and. closing*dt > overlap) time = overlap/closing
         touch%shear = in_plane(moved(kept*touch%shear, (-law%mindlin*mean*time)*slip, rotation), n)
         call limit(touch%shear, law%friction*normal)
         if (law%rolling > 0) then
            touch%moment = in_plane(moved(kept*touch%moment, (-law%bending*mean*time)*turn, rotation), n)
            call limit(touch%moment, law%rolling*normal)
         end if
      end if
      touch%root = root
   end subroutine press

   !> Vector that changes linearly while it rotates, to second order in the rotation.
   pure function moved(before, change, rotation) result(now)
      real(wp), intent(in) :: before(3), change(3)  !! [N] or [N m]
      real(wp), intent(in) :: rotation(3)           !! [rad]
      real(wp) :: now(3)

      now = before + change + cross(rotation, before + 0.5_wp*(change + cross(rotation, before)))
   end function moved

   !> Component of a vector in the plane of a normal.
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

   !> Limit the length of a vector.
   pure subroutine limit(v, length)
      real(wp), intent(inout) :: v(3)  !! any [unit]
      real(wp), intent(in) :: length   !! >= 0, the same [unit]
      real(wp) :: square

      square = dot_product(v, v)
      if (square > length**2) v = v*(length/sqrt(square))
   end subroutine limit

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
      real(wp), intent(in) :: speed         !! of approach, > 0 [m/s]
      ! 2 int_0^1 dx/sqrt(1 - x**2.5) * (15/16)**0.4
      real(wp), parameter :: coefficient = 2.868265699195333_wp

      time = (mass/reduced_modulus(material))**2/(radius*speed)
      time = coefficient*exponential(logarithm(time)/5)
   end function collision_time

   !> Time in which a Rayleigh wave travels half round a sphere [s].
   elemental real(wp) function rayleigh_time(material, radius, density) result(time)
      type(material_t), intent(in) :: material
      real(wp), intent(in) :: radius, density  !! [m], [kg/m3]

      associate (nu => material%poisson)
         time = pi*radius*sqrt(2*(1 + nu)*density/material%young)/(0.1631_wp*nu + 0.8766_wp)
      end associate
   end function rayleigh_time
end module lab_contact
