! SPDX-License-Identifier: BSD-3-Clause
!> Spheres in three dimensions, z up, each a separate body or part of a clump. Velocities and forces have six
!> components: translation, then rotation.
module lab_bodies
   use rockfall_kinds, only: wp
   use rockfall_math, only: pi
   use lab_clump, only: clump_t, place_spheres, sphere_motion, clump_energy, contact_mass
   implicit none
   private
   public :: bodies_t, bodies, set_clumps, update_spheres, slow_down, in_clump, sphere_mass, kinetic_energy, &
      total_mass, mass_moment
   public :: body_energy, body_mass, body_position, body_velocity, body_reach, first_sphere, is_touched

   type :: bodies_t
      integer :: n = 0
      real(wp), allocatable :: x(:, :)        !! (3, n) centres [m]
      real(wp), allocatable :: v(:, :)        !! (6, n) velocity [m/s], spin [rad/s]
      real(wp), allocatable :: a(:, :)        !! (6, n) accelerations [m/s2], [rad/s2]
      real(wp), allocatable :: f(:, :)        !! (6, n) contact force [N], moment [N m]
      real(wp), allocatable :: radius(:)      !! (n) radii [m]
      real(wp), allocatable :: mass(:)        !! (n) mass; for spheres of a clump, effective in a contact [kg]
      real(wp), allocatable :: inverse(:, :)  !! (6, n) 1/mass [1/kg], then 1/inertia [1/(kg m2)], each three times
      type(clump_t), allocatable :: clump(:)  !! clumps, if any, in the order of their spheres
      integer, allocatable :: owner(:)        !! (n) index of the clump, 0: separate body; allocated with `clump`
   end type bodies_t

   real(wp), parameter :: inertia_factor = 0.4_wp  !! I/(m r**2)

contains

   !> Create spheres at rest.
   pure type(bodies_t) function bodies(x, radius, density) result(b)
      real(wp), intent(in) :: x(:, :)                !! (3, n) centres [m]
      real(wp), intent(in) :: radius(:), density(:)  !! [m], [kg/m3]
      integer :: k

      b%n = size(radius)
      allocate (b%x, source=x)
      allocate (b%radius, source=radius)
      allocate (b%mass, source=sphere_mass(radius, density))
      allocate (b%inverse(6, b%n))
      do k = 1, b%n
         call set_inverse(b, k)
      end do
      allocate (b%v(6, b%n), b%a(6, b%n), b%f(6, b%n), source=0.0_wp)
   end function bodies

   pure subroutine set_inverse(b, k)
      type(bodies_t), intent(inout) :: b
      integer, intent(in) :: k

      b%inverse(1:3, k) = 1/b%mass(k)
      b%inverse(4:6, k) = 1/(b%mass(k)*inertia_factor*b%radius(k)**2)
   end subroutine set_inverse

   !> Join spheres into new clumps, which move them to their places.
   pure subroutine set_clumps(b, clump)
      type(bodies_t), intent(inout) :: b
      type(clump_t), intent(in) :: clump(:)
      integer :: before, c, k

      before = 0
      if (allocated(b%clump)) then
         before = size(b%clump)
         b%clump = [b%clump, clump]
      else
         b%clump = clump
         allocate (b%owner(b%n), source=0)
      end if
      do c = 1, size(clump)
         do k = clump(c)%first, clump(c)%last
            b%owner(k) = before + c
            b%mass(k) = contact_mass(clump(c), k - clump(c)%first + 1)
            call set_inverse(b, k)
         end do
         call place_spheres(clump(c), 0.0_wp, b%x)
         call update_spheres(b, before + c)
      end do
   end subroutine set_clumps

   !> Update the velocities and accelerations of the spheres of a clump.
   pure subroutine update_spheres(b, c)
      type(bodies_t), intent(inout) :: b
      integer, intent(in) :: c

      associate (first => b%clump(c)%first, last => b%clump(c)%last)
         call sphere_motion(b%clump(c), b%v(:, first:last), b%a(:, first:last))
      end associate
   end subroutine update_spheres

   !> Multiply all velocities and spins by a factor.
   pure subroutine slow_down(b, factor)
      type(bodies_t), intent(inout) :: b
      real(wp), intent(in) :: factor  !! [-]
      integer :: c

      b%v = b%v*factor
      if (.not. allocated(b%clump)) return
      do c = 1, size(b%clump)
         associate (clump => b%clump(c))
            clump%v = clump%v*factor
            clump%spin = clump%spin*factor
            clump%momentum = clump%momentum*factor
         end associate
      end do
   end subroutine slow_down

   !> Return whether sphere k is part of a clump.
   pure logical function in_clump(b, k)
      type(bodies_t), intent(in) :: b
      integer, intent(in) :: k

      in_clump = .false.
      if (allocated(b%owner)) in_clump = b%owner(k) > 0
   end function in_clump

   elemental real(wp) function sphere_mass(radius, density)
      real(wp), intent(in) :: radius, density  !! [m], [kg/m3]

      sphere_mass = 4.0_wp/3*pi*radius**3*density
   end function sphere_mass

   !> Kinetic energy of all bodies, translation and rotation [J].
   pure real(wp) function kinetic_energy(b) result(energy)
      type(bodies_t), intent(in) :: b
      integer :: k

      if (.not. allocated(b%clump)) then
         energy = 0.5_wp*sum(b%v**2/b%inverse)
         return
      end if
      energy = 0
      do k = 1, b%n
         if (b%owner(k) == 0) energy = energy + body_energy(b, k)
      end do
      do k = 1, size(b%clump)
         energy = energy + clump_energy(b%clump(k))
      end do
   end function kinetic_energy

   !> Mass of all bodies [kg].
   pure real(wp) function total_mass(b) result(mass)
      type(bodies_t), intent(in) :: b

      if (.not. allocated(b%clump)) then
         mass = sum(b%mass)
      else
         mass = sum(b%mass, b%owner == 0) + sum(b%clump%mass)
      end if
   end function total_mass

   !> Sum over bodies of mass times height of the centre [kg m].
   pure real(wp) function mass_moment(b) result(moment)
      type(bodies_t), intent(in) :: b

      if (.not. allocated(b%clump)) then
         moment = sum(b%mass*b%x(3, :))
      else
         moment = sum(b%mass*b%x(3, :), b%owner == 0) + sum(b%clump%mass*b%clump%x(3))
      end if
   end function mass_moment

   !> Kinetic energy of the body of sphere k, translation and rotation [J].
   pure real(wp) function body_energy(b, k)
      type(bodies_t), intent(in) :: b
      integer, intent(in) :: k

      if (in_clump(b, k)) then
         body_energy = clump_energy(b%clump(b%owner(k)))
      else
         body_energy = 0.5_wp*sum(b%v(:, k)**2/b%inverse(:, k))
      end if
   end function body_energy

   !> Mass of the body of sphere k [kg].
   pure real(wp) function body_mass(b, k)
      type(bodies_t), intent(in) :: b
      integer, intent(in) :: k

      body_mass = b%mass(k)
      if (in_clump(b, k)) body_mass = b%clump(b%owner(k))%mass
   end function body_mass

   !> Centre of mass of the body of sphere k, for clumps never folded into the periodic box [m].
   pure function body_position(b, k) result(x)
      type(bodies_t), intent(in) :: b
      integer, intent(in) :: k
      real(wp) :: x(3)

      x = b%x(:, k)
      if (in_clump(b, k)) x = b%clump(b%owner(k))%x
   end function body_position

   !> Velocity [m/s] and spin [rad/s] of the body of sphere k.
   pure function body_velocity(b, k) result(v)
      type(bodies_t), intent(in) :: b
      integer, intent(in) :: k
      real(wp) :: v(6)

      v = b%v(:, k)
      if (in_clump(b, k)) v = [b%clump(b%owner(k))%v, b%clump(b%owner(k))%spin]
   end function body_velocity

   !> Distance of the farthest point of the body of sphere k from its centre [m].
   pure real(wp) function body_reach(b, k) result(reach)
      type(bodies_t), intent(in) :: b
      integer, intent(in) :: k

      reach = b%radius(k)
      if (in_clump(b, k)) reach = b%clump(b%owner(k))%reach
   end function body_reach

   !> Index of the first sphere of the body to which sphere k belongs.
   pure integer function first_sphere(b, k)
      type(bodies_t), intent(in) :: b
      integer, intent(in) :: k

      first_sphere = k
      if (in_clump(b, k)) first_sphere = b%clump(b%owner(k))%first
   end function first_sphere

   !> Return whether the body whose last sphere is k has any contact.
   pure logical function is_touched(b, k)
      type(bodies_t), intent(in) :: b
      integer, intent(in) :: k

      is_touched = any(abs(b%f(:, first_sphere(b, k):k)) > 0)
   end function is_touched
end module lab_bodies
