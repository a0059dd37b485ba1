! SPDX-License-Identifier: BSD-3-Clause
!> Clumps: rigid bodies made of overlapping spheres, for angular rocks and boulders. Mass and inertia are computed for
!> the union of the spheres: overlaps count once.
module lab_clump
   use rockfall_kinds, only: wp
   use rockfall_math, only: pi, cube_root
   use rockfall_block_shape, only: block_shapes, block_axes
   use lab_contact, only: cross
   use lab_rotation, only: rotation_matrix, rotate_free
   implicit none
   private
   public :: clump_t, clump_shape_t, tetrahedral_clump, block_clump, shape_names, sphere_shape
   public :: make_clump, move_clump, place_spheres, sphere_motion, set_motion, turn_in_flight, &
      accelerate_clump, clump_energy, contact_mass

   !> Shapes of boulders: a sphere, and boxes with rounded edges and the axis ratios `block_axes`.
   integer, parameter :: sphere_shape = 1
   character(len=9), parameter :: shape_names(4) = [character(len=9) :: "sphere", block_shapes]
   real(wp), parameter :: edge_radius = 0.65_wp     !! edge radius of a box, over half its shortest axis [-]
   real(wp), parameter :: sphere_spacing = 0.8_wp  !! maximum distance of spheres along a face, over edge radius [-]
   real(wp), parameter :: rock_spread = 0.9_wp  !! distance of sphere centres from the rock's centre, over radius [-]
   integer, parameter :: columns = 200              !! number of columns per side, for integrals over a union of spheres

   !> Shape of a clump; R is the radius of the sphere of equal volume.
   type :: clump_shape_t
      real(wp), allocatable :: x(:, :)     !! (3, spheres) relative to the centre of mass, in principal axes [R]
      real(wp), allocatable :: radius(:)   !! (spheres) radii [R]
      real(wp) :: inertia(3) = 0           !! principal moments, over m R**2 [-]
      real(wp) :: reach = 0                !! distance of the farthest point from the centre [R]
   end type clump_shape_t

   !> Clump of spheres `first` to `last`.
   type :: clump_t
      integer :: first = 0, last = 0
      real(wp) :: mass = 0                   !! [kg]
      real(wp) :: inertia(3) = 0             !! principal moments [kg m2]
      real(wp) :: reach = 0                  !! distance of the farthest point from the centre [m]
      real(wp) :: x(3) = 0                   !! centre of mass, never folded into the periodic box [m]
      real(wp) :: v(3) = 0, a(3) = 0         !! velocity [m/s], acceleration [m/s2]
      real(wp) :: q(4) = [1, 0, 0, 0]        !! orientation of the principal axes, a unit quaternion
      real(wp) :: momentum(3) = 0            !! angular momentum, in space [kg m2/s]
      real(wp) :: spin(3) = 0                !! spin in space [rad/s]
      real(wp) :: spin_rate(3) = 0           !! rate of change of the spin, in space [rad/s2]
      real(wp) :: moment(3) = 0              !! moment of the contact forces about the centre, in space [N m]
      real(wp), allocatable :: offset(:, :)  !! (3, spheres) relative to the centre, in principal axes [m]
   end type clump_t

contains

   !> Shape of a rock: four equal spheres at the corners of a tetrahedron. Its moments of inertia are equal.
   pure type(clump_shape_t) function tetrahedral_clump() result(shape)
      real(wp), parameter :: corner(3, 4) = reshape([1.0_wp, 1.0_wp, 1.0_wp, 1.0_wp, -1.0_wp, -1.0_wp, &
                                                     -1.0_wp, 1.0_wp, -1.0_wp, -1.0_wp, -1.0_wp, 1.0_wp], [3, 4])

      shape = scaled(rock_spread/sqrt(3.0_wp)*corner, 1.0_wp)
      shape%inertia = sum(shape%inertia)/3
   end function tetrahedral_clump

   !> Shape of a boulder: a box with rounded edges, covered by spheres side by side.
   pure type(clump_shape_t) function block_clump(kind) result(shape)
      integer, intent(in) :: kind  !! index in `shape_names`, except sphere_shape
      real(wp) :: half(3), radius
      real(wp), allocatable :: x(:, :)
      integer :: pieces(3), i, j, k, n

      half = 0.5_wp*block_axes(:, kind - 1)
      radius = edge_radius*minval(half)
      half = half - radius
      pieces = max(1, ceiling(2*half/(sphere_spacing*radius)))
      allocate (x(3, product(pieces + 1)))
      n = 0
      do k = 0, pieces(3)
         do j = 0, pieces(2)
            do i = 0, pieces(1)
               if (.not. any([i, j, k] == 0 .or. [i, j, k] == pieces)) cycle  ! skip inner points
               n = n + 1
               x(:, n) = half*(2.0_wp*[i, j, k]/pieces - 1)
            end do
         end do
      end do
      shape = scaled(x(:, :n), radius)
   end function block_clump

   !> Shape of equal spheres that are symmetric about the axes, scaled to the volume of a unit sphere. The inside of a
   !> shell of spheres counts as solid.
   pure type(clump_shape_t) function scaled(x, radius) result(shape)
      real(wp), intent(in) :: x(:, :), radius  !! in any unit of length
      real(wp) :: volume, second(3), scale
      integer :: k

      call integrate_union(x, radius, volume, second)
      scale = 1/cube_root(3*volume/(4*pi))
      shape%x = scale*x
      shape%radius = [(scale*radius, k=1, size(x, 2))]
      shape%inertia = scale**2/volume*(sum(second) - second)
      shape%reach = scale*(sqrt(maxval(sum(x**2, 1))) + radius)
   end function scaled

   !> Volume and second moments of a union of spheres. It is divided into columns along z, which are integrated exactly.
   pure subroutine integrate_union(x, radius, volume, second)
      real(wp), intent(in) :: x(:, :), radius       !! in any unit of length
      real(wp), intent(out) :: volume, second(3)    !! [unit3], integrals of x**2, y**2, z**2 [unit5]
      real(wp) :: low(2), cell(2), at(2), half, bottom, top
      integer :: i, j, k

      low = minval(x(1:2, :), 2) - radius
      cell = (maxval(x(1:2, :), 2) + radius - low)/columns
      volume = 0
      second = 0
      do j = 1, columns
         do i = 1, columns
            at = low + ([i, j] - 0.5_wp)*cell
            bottom = huge(bottom)
            top = -huge(top)
            do k = 1, size(x, 2)
               half = radius**2 - sum((at - x(1:2, k))**2)
               if (half <= 0) cycle
               half = sqrt(half)
               bottom = min(bottom, x(3, k) - half)
               top = max(top, x(3, k) + half)
            end do
            if (top < bottom) cycle
            volume = volume + product(cell)*(top - bottom)
            second = second + product(cell)*[at**2*(top - bottom), (top**3 - bottom**3)/3]
         end do
      end do
   end subroutine integrate_union

   !> Make a clump at rest.
   pure type(clump_t) function make_clump(shape, radius, density, first, x, q) result(clump)
      type(clump_shape_t), intent(in) :: shape
      real(wp), intent(in) :: radius, density  !! radius of the sphere of equal volume [m]; density [kg/m3]
      integer, intent(in) :: first             !! index of the clump's first sphere
      real(wp), intent(in) :: x(3), q(4)       !! position [m]; orientation, a unit quaternion

      clump%first = first
      clump%last = first + size(shape%radius) - 1
      clump%mass = 4.0_wp/3*pi*radius**3*density
      clump%inertia = clump%mass*radius**2*shape%inertia
      clump%reach = radius*shape%reach
      clump%x = x
      clump%q = q
      clump%offset = radius*shape%x
   end function make_clump

   !> Move a clump over a step with the velocity and angular momentum at the middle of the step.
   pure subroutine move_clump(clump, dt)
      type(clump_t), intent(inout) :: clump
      real(wp), intent(in) :: dt  !! [s]
      real(wp) :: momentum(3)

      clump%v = clump%v + 0.5_wp*dt*clump%a
      clump%momentum = clump%momentum + 0.5_wp*dt*clump%moment
      clump%x = clump%x + dt*clump%v
      momentum = matmul(clump%momentum, rotation_matrix(clump%q))
      call rotate_free(clump%q, momentum, clump%inertia, dt)
   end subroutine move_clump

   !> Place the spheres of a clump, each at the periodic image nearest to its current position.
   pure subroutine place_spheres(clump, width, x)
      type(clump_t), intent(in) :: clump
      real(wp), intent(in) :: width       !! width of the periodic box; 0: not periodic [m]
      real(wp), intent(inout) :: x(:, :)  !! (3, n) centres of all spheres [m]
      real(wp) :: axes(3, 3), centre(3)
      integer :: k

      axes = rotation_matrix(clump%q)
      do k = clump%first, clump%last
         centre = clump%x + matmul(axes, clump%offset(:, k - clump%first + 1))
         if (width > 0) centre(1:2) = centre(1:2) + width*anint((x(1:2, k) - centre(1:2))/width)
         x(:, k) = centre
      end do
   end subroutine place_spheres

   !> Update acceleration and moment of a clump from the forces on its spheres, and advance its motion by `time`.
   pure subroutine accelerate_clump(clump, gravity, time, f)
      type(clump_t), intent(inout) :: clump
      real(wp), intent(in) :: gravity(3), time  !! [m/s2], [s]
      real(wp), intent(in) :: f(:, :)           !! (6, spheres) forces on the clump's spheres [N], [N m]
      real(wp) :: axes(3, 3), spin(3), force(3)
      integer :: k

      axes = rotation_matrix(clump%q)
      force = 0
      clump%moment = 0
      do k = 1, size(f, 2)
         force = force + f(1:3, k)
         clump%moment = clump%moment + f(4:6, k) + cross(matmul(axes, clump%offset(:, k)), f(1:3, k))
      end do
      clump%a = force/clump%mass + gravity
      clump%v = clump%v + time*clump%a
      clump%momentum = clump%momentum + time*clump%moment
      spin = matmul(clump%momentum, axes)/clump%inertia
      clump%spin = matmul(axes, spin)
      clump%spin_rate = matmul(axes, (matmul(clump%moment, axes) - cross(spin, clump%inertia*spin))/clump%inertia)
   end subroutine accelerate_clump

   !> Velocities and accelerations of the spheres of a clump.
   pure subroutine sphere_motion(clump, v, a)
      type(clump_t), intent(in) :: clump
      real(wp), intent(out) :: v(:, :)  !! (6, spheres) velocity [m/s], spin [rad/s]
      real(wp), intent(out) :: a(:, :)  !! (6, spheres) acceleration [m/s2], rate of change of the spin [rad/s2]
      real(wp) :: axes(3, 3), arm(3), across(3)
      integer :: k

      axes = rotation_matrix(clump%q)
      do k = 1, size(clump%offset, 2)
         arm = matmul(axes, clump%offset(:, k))
         across = cross(clump%spin, arm)
         v(1:3, k) = clump%v + across
         v(4:6, k) = clump%spin
         a(1:3, k) = clump%a + cross(clump%spin_rate, arm) + cross(clump%spin, across)
         a(4:6, k) = clump%spin_rate
      end do
   end subroutine sphere_motion

   !> Set the velocity and spin of a clump.
   pure subroutine set_motion(clump, v)
      type(clump_t), intent(inout) :: clump
      real(wp), intent(in) :: v(6)  !! [m/s], [rad/s]
      real(wp) :: axes(3, 3)

      axes = rotation_matrix(clump%q)
      clump%v = v(1:3)
      clump%spin = v(4:6)
      clump%momentum = matmul(axes, clump%inertia*matmul(clump%spin, axes))
   end subroutine set_motion

   !> Rotate a clump in free flight, in steps of at most a hundredth of a radian.
   pure subroutine turn_in_flight(clump, time)
      type(clump_t), intent(inout) :: clump
      real(wp), intent(in) :: time  !! [s]
      real(wp) :: momentum(3)
      integer :: steps, k

      momentum = matmul(clump%momentum, rotation_matrix(clump%q))
      steps = 1 + int(100*time*sqrt(sum(clump%momentum**2))/minval(clump%inertia))
      do k = 1, steps
         call rotate_free(clump%q, momentum, clump%inertia, time/steps)
      end do
      clump%spin = matmul(rotation_matrix(clump%q), momentum/clump%inertia)
   end subroutine turn_in_flight

   !> Kinetic energy, translation and rotation [J].
   pure real(wp) function clump_energy(clump) result(energy)
      type(clump_t), intent(in) :: clump

      energy = 0.5_wp*(clump%mass*sum(clump%v**2) &
                       + sum(matmul(clump%momentum, rotation_matrix(clump%q))**2/clump%inertia))
   end function clump_energy

   !> Effective mass [kg] of a clump for a force at sphere k, normal to its lever arm: the minimum over all directions.
   pure real(wp) function contact_mass(clump, k) result(mass)
      type(clump_t), intent(in) :: clump
      integer, intent(in) :: k

      mass = 1/(1/clump%mass + sum(clump%offset(:, k)**2)/minval(clump%inertia))
   end function contact_mass
end module lab_clump
