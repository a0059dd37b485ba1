! SPDX-License-Identifier: BSD-3-Clause
!> Spheres in three dimensions, z up. Velocities and forces have six components: translation, then rotation.
module lab_bodies
   use rockfall_kinds, only: wp
   use rockfall_math, only: pi
   implicit none
   private
   public :: bodies_t, bodies, sphere_mass, body_energy

   type :: bodies_t
      integer :: n = 0
      real(wp), allocatable :: x(:, :)        !! (3, n) centres [m]
      real(wp), allocatable :: v(:, :)        !! (6, n) velocity [m/s], spin [rad/s]
      real(wp), allocatable :: a(:, :)        !! (6, n) accelerations [m/s2], [rad/s2]
      real(wp), allocatable :: f(:, :)        !! (6, n) contact force [N], moment [N m]
      real(wp), allocatable :: radius(:)      !! [m]
      real(wp), allocatable :: mass(:)        !! [kg]
      real(wp), allocatable :: inverse(:, :)  !! (6, n) 1/mass three times, 1/inertia three times
   end type bodies_t

   real(wp), parameter :: inertia_factor = 0.4_wp  !! I/(m r**2)

contains

   !> Create spheres at rest.
   pure type(bodies_t) function bodies(x, radius, density) result(b)
      real(wp), intent(in) :: x(:, :)                !! (3, n) [m]
      real(wp), intent(in) :: radius(:), density(:)  !! [m], [kg/m3]
      integer :: k

      b%n = size(radius)
      allocate (b%x, source=x)
      allocate (b%radius, source=radius)
      allocate (b%mass, source=sphere_mass(radius, density))
      allocate (b%inverse(6, b%n))
      do k = 1, b%n
         b%inverse(1:3, k) = 1/b%mass(k)
         b%inverse(4:6, k) = 1/(b%mass(k)*inertia_factor*radius(k)**2)
      end do
      allocate (b%v(6, b%n), b%a(6, b%n), b%f(6, b%n), source=0.0_wp)
   end function bodies

   elemental real(wp) function sphere_mass(radius, density)
      real(wp), intent(in) :: radius, density  !! [m], [kg/m3]

      sphere_mass = 4.0_wp/3*pi*radius**3*density
   end function sphere_mass

   !> Kinetic energy of body k, translation and rotation [J].
   pure real(wp) function body_energy(b, k)
      type(bodies_t), intent(in) :: b
      integer, intent(in) :: k

      body_energy = 0.5_wp*sum(b%v(:, k)**2/b%inverse(:, k))
   end function body_energy
end module lab_bodies
