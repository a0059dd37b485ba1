! SPDX-License-Identifier: BSD-3-Clause
!> Motion of a block: forces of the ground on all facets, and time stepping.
module lab_block_motion
   use rockfall_kinds, only: wp
   use rockfall_math, only: pi
   use lab_block, only: block_t
   use lab_rotation, only: rotation_matrix, rotate_free
   use lab_yielding_ground, only: ground_t, relief_t, stiffness_of, look_up
   use lab_pressure, only: law_t, memory_t, facet_t, press, untouched
   implicit none
   private
   public :: motion_t, law_of, start_motion, advance, feel_ground, free_step, contact_step, spin_of, kinetic_energy

   type :: motion_t
      real(wp) :: x(3) = 0                          !! centre of mass, z above the mean surface [m]
      real(wp) :: v(3) = 0                          !! [m/s]
      real(wp) :: q(4) = [1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp]  !! orientation, a unit quaternion [-]
      real(wp) :: momentum(3) = 0                   !! angular momentum, in the block's axes [kg m2/s]
      real(wp) :: force(3) = 0                      !! force of the ground [N]
      real(wp) :: torque(3) = 0                     !! torque of the ground about the centre [N m]
      real(wp) :: area = 0                          !! contact area [m2]
      real(wp) :: clear = 0                         !! height of the lowest vertex above the ground [m]
      logical :: wet = .false.                      !! any part is below the ground
      type(memory_t), allocatable :: memory(:)      !! state of each facet
      real(wp), allocatable :: vertex(:, :)         !! (vertices, 3) relative to the centre of mass, in space [m]
      real(wp), allocatable :: depth(:)             !! (vertices) depth along the ground's normal [m]
      real(wp), allocatable :: normal(:, :)         !! (3, vertices) normal of the ground below [-]
   end type motion_t

   real(wp), parameter :: step_of_period = 0.15_wp  !! step over the shortest period of block and ground [-]
   real(wp), parameter :: least_area = 0.3_wp       !! minimum contact area assumed for the next step, over R_b**2 [-]
   real(wp), parameter :: step_of_radius = 0.05_wp  !! maximum displacement per step, over R_b [-]
   real(wp), parameter :: max_turn = 0.2_wp         !! maximum rotation per step of free flight [rad]
   real(wp), parameter :: caution = 0.8_wp  !! maximum fraction of the distance to the ground per free step [-]

contains

   !> Parameters of a ground for a block of this size.
   pure type(law_t) function law_of(ground, radius, density) result(law)
      type(ground_t), intent(in) :: ground
      real(wp), intent(in) :: radius, density  !! [m], [kg/m3]

      law%stiffness = stiffness_of(ground, radius, density)
      law%reserve = ground%yield_pressure/law%stiffness
      law%friction = ground%friction
      law%soil_density = ground%soil_density
      law%plough = ground%plough
   end function law_of

   !> Start the motion of a block with position, orientation, velocity and spin.
   pure subroutine start_motion(block, law, x, v, q, spin, m)
      type(block_t), intent(in) :: block
      type(law_t), intent(in) :: law
      real(wp), intent(in) :: x(3), v(3), q(4), spin(3)  !! [m], [m/s], [-], spin in space [rad/s]
      type(motion_t), intent(out) :: m

      m%x = x
      m%v = v
      m%q = q
      m%momentum = block%inertia*matmul(spin, rotation_matrix(q))
      allocate (m%memory(size(block%area)), source=untouched(law))
      allocate (m%vertex(size(block%x, 1), 3), m%depth(size(block%x, 1)), m%normal(3, size(block%x, 1)), source=0.0_wp)
   end subroutine start_motion

   !> Advance by one step: half a kick, a drift, the new forces, half a kick. The scheme is second-order, and symplectic
   !> if the ground is elastic.
   pure subroutine advance(block, law, relief, gravity, dt, m)
      type(block_t), intent(in) :: block
      type(law_t), intent(in) :: law
      type(relief_t), intent(in) :: relief
      real(wp), intent(in) :: gravity(3), dt  !! [m/s2], [s]
      type(motion_t), intent(inout) :: m

      m%v = m%v + 0.5_wp*dt*(m%force/block%mass + gravity)
      if (m%wet) m%momentum = m%momentum + 0.5_wp*dt*matmul(m%torque, rotation_matrix(m%q))
      m%x = m%x + dt*m%v
      call rotate_free(m%q, m%momentum, block%inertia, dt)
      call feel_ground(block, law, relief, dt, m)
      m%v = m%v + 0.5_wp*dt*(m%force/block%mass + gravity)
      if (m%wet) m%momentum = m%momentum + 0.5_wp*dt*matmul(m%torque, rotation_matrix(m%q))
   end subroutine advance

   !> Compute the forces of the ground after a step of dt, and the distance of the block from it.
   pure subroutine feel_ground(block, law, relief, dt, m)
      type(block_t), intent(in) :: block
      type(law_t), intent(in) :: law
      type(relief_t), intent(in) :: relief
      real(wp), intent(in) :: dt  !! [s]
      type(motion_t), intent(inout) :: m
      real(wp) :: axes(3, 3), lowest, height, slope(2), spin(3), steep
      integer :: k

      m%force = 0
      m%torque = 0
      m%area = 0
      axes = rotation_matrix(m%q)
      m%vertex(:, 3) = axes(3, 1)*block%x(:, 1) + axes(3, 2)*block%x(:, 2) + axes(3, 3)*block%x(:, 3)
      lowest = m%x(3) + minval(m%vertex(:, 3))
      if (lowest > relief%top) then
         m%clear = lowest - relief%top
         if (m%wet) m%memory = untouched(law)
         m%wet = .false.
         return
      end if
      m%vertex(:, 1) = axes(1, 1)*block%x(:, 1) + axes(1, 2)*block%x(:, 2) + axes(1, 3)*block%x(:, 3)
      m%vertex(:, 2) = axes(2, 1)*block%x(:, 1) + axes(2, 2)*block%x(:, 2) + axes(2, 3)*block%x(:, 3)
      m%clear = huge(1.0_wp)
      do k = 1, size(m%depth)
         height = relief%top - (m%x(3) + m%vertex(k, 3))
         if (height > -block%edge) then  ! otherwise neither the facet nor a neighbour is submerged
            call look_up(relief, m%x(1) + m%vertex(k, 1), m%x(2) + m%vertex(k, 2), height, slope(1), slope(2))
            height = height - (m%x(3) + m%vertex(k, 3))
            steep = 1/sqrt(1 + slope(1)**2 + slope(2)**2)
            m%normal(:, k) = [-slope(1)*steep, -slope(2)*steep, steep]
            m%depth(k) = height*steep
         else
            m%depth(k) = height
         end if
         m%clear = min(m%clear, -height)
      end do
      if (m%clear >= 0) then
         if (m%wet) m%memory = untouched(law)
         m%wet = .false.
         return
      end if
      m%wet = .true.
      spin = matmul(axes, m%momentum/block%inertia)
      call press_facets(block, law, axes, spin, dt, m)
   end subroutine feel_ground

   !> Sum the forces on all facets that are at least partly submerged.
   pure subroutine press_facets(block, law, axes, spin, dt, m)
      type(block_t), intent(in) :: block
      type(law_t), intent(in) :: law
      real(wp), intent(in) :: axes(3, 3), spin(3), dt  !! axes [-], spin [rad/s], step [s]
      type(motion_t), intent(inout) :: m
      type(facet_t) :: facet
      real(wp) :: force(3), torque(3)
      integer :: k, i

      do k = 1, size(block%area)
         associate (c => block%corner(:, k))
            if (max(m%depth(c(1)), m%depth(c(2)), m%depth(c(3))) <= 0) then
               if (m%memory(k)%area > 0) m%memory(k) = untouched(law)
               cycle
            end if
            facet%ground = 0
            do i = 1, 3
               facet%x(:, i) = m%vertex(c(i), :)
               facet%depth(i) = m%depth(c(i))
               if (facet%depth(i) > 0) facet%ground = facet%ground + m%normal(:, c(i))
            end do
         end associate
         facet%ground = facet%ground/sqrt(sum(facet%ground**2))
         facet%normal = matmul(axes, block%normal(:, k))
         facet%area = block%area(k)
         call press(law, facet, m%v, spin, dt, m%memory(k), force, torque)
         m%force = m%force + force
         m%torque = m%torque + torque
         m%area = m%area + m%memory(k)%area
      end do
   end subroutine press_facets

   !> Step in contact [s]: a fraction of the rocking period of the block on its current contact area, or the time to
   !> move by a small part of its radius if this is shorter.
   pure real(wp) function contact_step(block, law, m) result(dt)
      type(block_t), intent(in) :: block
      type(law_t), intent(in) :: law
      type(motion_t), intent(in) :: m
      real(wp) :: frequency, speed

      associate (r => block%radius)
         frequency = sqrt(law%stiffness*(2*m%area + least_area*r**2)*(1/block%mass + r**2/block%inertia(1)))
         dt = step_of_period*2*pi/frequency
         speed = sqrt(sum(m%v**2))
         if (speed > 0) dt = min(dt, step_of_radius*r/speed)
      end associate
   end function contact_step

   !> Step in the air [s]: short enough that no part can reach the ground, but at least `min_step`.
   pure real(wp) function free_step(block, relief, gravity, min_step, m) result(dt)
      type(block_t), intent(in) :: block
      type(relief_t), intent(in) :: relief
      real(wp), intent(in) :: gravity(3), min_step  !! [m/s2], [s]
      type(motion_t), intent(in) :: m
      real(wp) :: turning, closing, g

      turning = sqrt(sum((m%momentum/block%inertia)**2))
      closing = max(0.0_wp, -m%v(3)) + relief%steepest*sqrt(m%v(1)**2 + m%v(2)**2) &
                + turning*block%reach*(1 + relief%steepest)
      g = -gravity(3) + relief%steepest*sqrt(gravity(1)**2 + gravity(2)**2)
      ! solution of closing*dt + g/2*dt**2 = clear
      dt = caution*2*m%clear/(closing + sqrt(closing**2 + 2*g*m%clear) + tiny(1.0_wp))
      if (turning > 0) dt = min(dt, max_turn/turning)
      dt = max(dt, min_step)
   end function free_step

   !> Spin in space [rad/s].
   pure function spin_of(block, m) result(spin)
      type(block_t), intent(in) :: block
      type(motion_t), intent(in) :: m
      real(wp) :: spin(3)

      spin = matmul(rotation_matrix(m%q), m%momentum/block%inertia)
   end function spin_of

   !> Kinetic energy of translation and rotation [J].
   pure real(wp) function kinetic_energy(block, m)
      type(block_t), intent(in) :: block
      type(motion_t), intent(in) :: m

      kinetic_energy = 0.5_wp*(block%mass*sum(m%v**2) + sum(m%momentum**2/block%inertia))
   end function kinetic_energy
end module lab_block_motion
