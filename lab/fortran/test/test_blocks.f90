! SPDX-License-Identifier: BSD-3-Clause
!> Blocks: moments of solids known from theory, free rotation, and impacts on flat ground: no gain of energy, no loss on
!> elastic ground, no force outside the friction cone, equal results with half the step, and mirrored results for
!> mirrored input.
program test_lab_blocks
   use rockfall_kinds, only: wp, i8
   use rockfall_error, only: error_t
   use rockfall_random, only: random_key, random_words, uniform
   use lab_block, only: block_t, make_block, solid_t, solid_of
   use lab_rotation, only: rotation_matrix, rotate_free
   use lab_yielding_ground, only: ground_t, relief_t, make_relief, look_up
   use lab_pressure, only: law_t, part_t, submerged_part
   use lab_block_motion, only: motion_t, law_of, start_motion, advance, feel_ground, contact_step, spin_of, &
      kinetic_energy
   use check_m, only: check, check_close, finish
   implicit none

   real(wp), parameter :: radius = 0.4_wp, density = 2700, g = 9.81_wp

   call test_box()
   call test_refusals()
   call test_free_rotation()
   call test_submerged_part()
   call test_relief()
   call test_elastic_drop()
   call test_no_gain(plough=.false.)
   call test_no_gain(plough=.true.)
   call test_restitution()
   call test_half_the_step()
   call test_mirror()
   call test_rest()
   call finish()

contains

   !> Vertices and facets of a box.
   pure subroutine box(sides, x, corner)
      real(wp), intent(in) :: sides(3)
      real(wp), intent(out) :: x(3, 8)
      integer, intent(out) :: corner(3, 12)
      integer :: k

      do k = 0, 7
         x(:, k + 1) = sides*([ibits(k, 0, 1), ibits(k, 1, 1), ibits(k, 2, 1)] - 0.5_wp)
      end do
      corner = reshape([1, 3, 4, 1, 4, 2, 5, 6, 8, 5, 8, 7, 1, 2, 6, 1, 6, 5, 3, 7, 8, 3, 8, 4, &
                        1, 5, 7, 1, 7, 3, 2, 4, 8, 2, 8, 6], [3, 12])
   end subroutine box

   subroutine box_block(sides, block)
      real(wp), intent(in) :: sides(3)
      type(block_t), intent(out) :: block
      type(error_t), allocatable :: error
      real(wp) :: x(3, 8)
      integer :: corner(3, 12)

      call box(sides, x, corner)
      call make_block(x, corner, radius, density, block, error)
      call check("a box is a block", .not. allocated(error))
   end subroutine box_block

   subroutine flat(relief)
      type(relief_t), intent(out) :: relief
      type(error_t), allocatable :: error

      call make_relief(reshape([0.0_wp], [1, 1]), 1.0_wp, relief, error)
   end subroutine flat

   !> The moments of a box away from the origin equal closed forms.
   subroutine test_box()
      type(solid_t) :: solid
      type(block_t) :: block
      real(wp), parameter :: a(3) = [1.0_wp, 2.0_wp, 3.0_wp]
      real(wp) :: x(3, 8)
      integer :: corner(3, 12), k

      call box(a, x, corner)
      do k = 1, 8
         x(:, k) = x(:, k) + [5.0_wp, -7.0_wp, 11.0_wp]
      end do
      solid = solid_of(x, corner)
      call check_close("volume of a box", solid%volume, 6.0_wp, 1.0e-12_wp)
      call check_close("centre of a box", solid%centre(3), 11.0_wp, 1.0e-12_wp)
      call check_close("moment of a box", solid%inertia(1, 1), 6*(a(2)**2 + a(3)**2)/12, 1.0e-9_wp)
      call check_close("product of a box", solid%inertia(1, 2), 0.0_wp, 1.0e-9_wp)
      call box_block([1.0_wp, 1.0_wp, 1.0_wp], block)
      call check_close("mass is that of the sphere of radius R_b", block%mass, &
                       density*4*3.14159265358979_wp/3*radius**3, 1.0e-12_wp)
      do k = 1, 3
         call check_close("moments of a cube", block%inertia(k), block%mass*(block%edge**2/2)/6, 1.0e-12_wp)
      end do
      call box_block([3.0_wp, 1.0_wp, 2.0_wp], block)
      call check("moments rise", block%inertia(1) < block%inertia(2) .and. block%inertia(2) < block%inertia(3))
      call check_close("axes are principal: the long side is the first", maxval(block%x(:, 1))/maxval(block%x(:, 3)), &
                       3.0_wp, 1.0e-12_wp)
   end subroutine test_box

   subroutine test_refusals()
      type(block_t) :: block
      type(error_t), allocatable :: error
      real(wp) :: x(3, 8)
      integer :: corner(3, 12)

      call box([1.0_wp, 1.0_wp, 1.0_wp], x, corner)
      call make_block(x, corner(:, :11), radius, density, block, error)
      call check("an open surface is refused", allocated(error))
      call make_block(x, corner([1, 3, 2], :), radius, density, block, error)
      call check("a surface that is inside out is refused", allocated(error))
      x(:, 8) = 0.1_wp
      call make_block(x, corner, radius, density, block, error)
      call check("a dent is refused", allocated(error))
      corner(1, 1) = 9
      call make_block(x, corner, radius, density, block, error)
      call check("a facet without a vertex is refused", allocated(error))
   end subroutine test_refusals

   !> Angular momentum in space is conserved to rounding, and the energy error stays bounded; also about the unstable
   !> middle axis.
   subroutine test_free_rotation()
      real(wp), parameter :: inertia(3) = [1.0_wp, 2.0_wp, 2.5_wp]
      real(wp) :: q(4), momentum(3), before(3), energy, worst
      integer :: k

      q = [1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp]
      momentum = [0.01_wp, 20.0_wp, 0.02_wp]
      before = momentum
      energy = 0.5_wp*sum(momentum**2/inertia)
      worst = 0
      do k = 1, 20000
         call rotate_free(q, momentum, inertia, 0.005_wp)
         worst = max(worst, abs(0.5_wp*sum(momentum**2/inertia)/energy - 1))
      end do
      call check("energy of free rotation is kept within 1e-4", worst < 1.0e-4_wp)
      call check("angular momentum is kept", &
                 maxval(abs(matmul(rotation_matrix(q), momentum) - before)) < 1.0e-10_wp)
      call check("the middle axis has turned over", minval(momentum) < 10)
   end subroutine test_free_rotation

   !> Integrals over the submerged part of a triangle, compared with sums over small pieces.
   subroutine test_submerged_part()
      real(wp), parameter :: x(3, 3) = reshape(real([0, 0, 0, 1, 0, 0, 0, 1, 0], wp), [3, 3])
      real(wp) :: depth(3), s, t, d
      type(part_t) :: part, sums
      integer :: n, i, j
      integer, parameter :: pieces = 400

      do n = 1, 4
         depth = [0.3_wp, 0.7_wp, 1.2_wp] - 0.4_wp*(n - 1)
         part = submerged_part(x, depth, 0.5_wp, 0.1_wp)
         sums = part_t()
         do i = 0, pieces - 1
            do j = 0, pieces - 1 - i
               s = (i + 1/3.0_wp)/pieces
               t = (j + 1/3.0_wp)/pieces
               d = depth(1) + s*(depth(2) - depth(1)) + t*(depth(3) - depth(1)) - 0.1_wp
               if (d <= 0) cycle
               d = d*merge(0.5_wp, 1.0_wp, i + j == pieces - 1)  ! half a cell at the edge
               sums%volume = sums%volume + d/pieces**2
               sums%moment = sums%moment + d/pieces**2*[s, t, 0.0_wp]
            end do
         end do
         call check("volume below a level", abs(part%volume - sums%volume) < 3.0e-3_wp)
         call check("its moments", maxval(abs(part%moment - sums%moment)) < 3.0e-3_wp)
      end do
   end subroutine test_submerged_part

   !> The slope is the derivative of the height, also across the edge of the patch.
   subroutine test_relief()
      type(relief_t) :: relief
      type(error_t), allocatable :: error
      real(wp) :: height(8, 8), h(3), sx, sy, ignored(2), x, y
      integer :: k, i, j

      do j = 1, 8
         do i = 1, 8
            height(i, j) = uniform(sum(random_words(random_key(1_i8), 1_i8, int(8*j + i, i8), 0_i8, 0_i8)/5))
         end do
      end do
      call make_relief(height, 4.0_wp, relief, error)
      call check("a patch", .not. allocated(error))
      do k = 1, 20
         x = 0.71_wp*k - 3
         y = 0.37_wp*k**2 - 9
         call look_up(relief, x, y, h(1), sx, sy)
         call look_up(relief, x + 1.0e-6_wp, y, h(2), ignored(1), ignored(2))
         call look_up(relief, x, y + 1.0e-6_wp, h(3), ignored(1), ignored(2))
         call check("slope of the relief", &
                    abs((h(2) - h(1))*1.0e6_wp - sx) + abs((h(3) - h(1))*1.0e6_wp - sy) < 1.0e-4_wp)
         call look_up(relief, x + 4, y - 8, h(2), ignored(1), ignored(2))
         call check_close("the patch is periodic", h(2), h(1), 1.0e-9_wp)
         call check("below the top, flatter than the steepest", &
                    h(1) <= relief%top .and. sx**2 + sy**2 <= relief%steepest**2)
      end do
      call make_relief(height(:6, :6), 4.0_wp, relief, error)
      call check("six cells are refused", allocated(error))
   end subroutine test_relief

   !> One impact on flat ground without gravity, followed until the block is 0.3 R_b above the ground.
   subroutine strike(block, ground, number, speed, angle_sine, step, m, energy)
      type(block_t), intent(in) :: block
      type(ground_t), intent(in) :: ground
      integer, intent(in) :: number             !! number of the draw of orientation and spin
      real(wp), intent(in) :: speed, angle_sine, step
      type(motion_t), intent(out) :: m
      real(wp), intent(out) :: energy           !! kinetic energy after the impact over that before [-]
      real(wp) :: q(4), v(3), spin(3), u(8)
      integer(i8) :: draw

      u = 2*uniform([(random_words(random_key(5_i8), 2_i8, int(number, i8), 0_i8, draw), draw=0, 1)]) - 1
      q = u(:4)/sqrt(sum(u(:4)**2))
      spin = speed/radius*u(5:7)
      v = speed*[sqrt(1 - angle_sine**2), 0.0_wp, -angle_sine]
      call follow(block, ground, q, v, spin, step, m, energy)
   end subroutine strike

   subroutine follow(block, ground, q, v, spin, step, m, energy)
      type(block_t), intent(in) :: block
      type(ground_t), intent(in) :: ground
      real(wp), intent(in) :: q(4), v(3), spin(3), step
      type(motion_t), intent(out) :: m
      real(wp), intent(out) :: energy
      type(relief_t) :: relief
      type(law_t) :: law
      real(wp) :: before
      integer :: k
      logical :: met

      call flat(relief)
      law = law_of(ground, radius, density)
      call start_motion(block, law, [0.0_wp, 0.0_wp, 0.0_wp], v, q, spin, m)
      call feel_ground(block, law, relief, 0.0_wp, m)
      call start_motion(block, law, [0.0_wp, 0.0_wp, 1.0e-9_wp - m%clear], v, q, spin, m)
      call feel_ground(block, law, relief, 0.0_wp, m)
      before = kinetic_energy(block, m)
      met = .false.
      do k = 1, 100000
         call advance(block, law, relief, [0.0_wp, 0.0_wp, 0.0_wp], step*contact_step(block, law, m), m)
         met = met .or. m%wet
         if (met .and. m%clear > 0.3_wp*radius) exit
      end do
      energy = kinetic_energy(block, m)/before
   end subroutine follow

   !> Elastic ground without friction returns all energy for any attitude and spin.
   subroutine test_elastic_drop()
      type(block_t) :: block
      type(motion_t) :: m
      real(wp) :: energy
      integer :: k

      call box_block([1.0_wp, 0.9_wp, 0.8_wp], block)
      do k = 1, 40
         call strike(block, ground_t(yield_pressure=1.0e12_wp, restitution=1.0e3_wp, friction=0.0_wp, &
                                     soil_density=0.0_wp, plough=.false.), k, 5.0_wp, 0.8_wp, 0.25_wp, m, energy)
         call check_close("energy on an elastic ground", energy, 1.0_wp, 2.0e-3_wp)
      end do
   end subroutine test_elastic_drop

   !> No impact on flat ground gains more than 1e-4 of its energy; on hard ground, the tangential impulse is at most mu
   !> times the normal impulse.
   subroutine test_no_gain(plough)
      logical, intent(in) :: plough
      type(block_t) :: block
      type(motion_t) :: m
      type(ground_t) :: ground
      real(wp) :: energy, sine, speed, most, normal, tangent
      integer :: k

      call box_block([1.0_wp, 0.62_wp, 0.56_wp], block)
      ground = ground_t(yield_pressure=merge(1.0e6_wp, 3.0e7_wp, plough), restitution=merge(0.2_wp, 0.5_wp, plough), &
                        soil_density=merge(1800.0_wp, 0.0_wp, plough), plough=plough)
      most = 0
      do k = 1, 200
         sine = (mod(k, 10) + 0.5_wp)/10
         speed = 1 + mod(7*k, 29)
         call strike(block, ground, k, speed, sine, 1.0_wp, m, energy)
         most = max(most, energy)
         if (plough) cycle
         normal = m%v(3) + speed*sine
         tangent = sqrt((m%v(1) - speed*sqrt(1 - sine**2))**2 + m%v(2)**2)
         call check("within the cone of friction", tangent <= ground%friction*normal*(1 + 1.0e-9_wp))
      end do
      call check("no impact gains energy", most <= 1 + 1.0e-4_wp)
      call check("and none is lost for nothing", most > 0.3_wp)
   end subroutine test_no_gain

   !> Restitution is about 1 without yielding, and decreases with speed.
   subroutine test_restitution()
      type(block_t) :: block
      type(motion_t) :: m
      real(wp) :: e(3), energy
      real(wp), parameter :: speed(3) = [0.01_wp, 5.0_wp, 20.0_wp]
      real(wp), parameter :: q(4) = [0.8880738339771153_wp, 0.3250575836718681_wp, -0.3250575836718681_wp, 0.0_wp]
      integer :: k

      call box_block([1.0_wp, 1.0_wp, 1.0_wp], block)  ! in this attitude, the diagonal is upright
      do k = 1, 3
         call follow(block, ground_t(yield_pressure=3.0e7_wp, restitution=0.5_wp, friction=0.0_wp, &
                                     soil_density=0.0_wp, plough=.false.), q, [0.0_wp, 0.0_wp, -speed(k)], &
                     [0.0_wp, 0.0_wp, 0.0_wp], 0.5_wp, m, energy)
         e(k) = m%v(3)/speed(k)
      end do
      call check("slow: elastic", e(1) > 0.9_wp)
      call check("5 m/s: some of it yields", e(2) < 0.5_wp)
      call check("faster: less", e(3) < 0.8_wp*e(2))
   end subroutine test_restitution

   !> Halving the step changes the mean results of impacts by at most 0.002 of the incident speed or energy.
   subroutine test_half_the_step()
      type(block_t) :: block
      type(motion_t) :: m
      real(wp) :: mean(4, 2), spin(3), energy
      integer :: k, j
      integer, parameter :: n = 150

      call box_block([1.0_wp, 0.9_wp, 0.8_wp], block)
      mean = 0
      do k = 1, n
         do j = 1, 2
            call strike(block, ground_t(), k, 8.0_wp, 0.5_wp, 1.0_wp/j, m, energy)
            spin = spin_of(block, m)
            mean(:, j) = mean(:, j) + [m%v(1)/8, m%v(3)/8, radius*spin(2)/8, energy]/n
         end do
      end do
      call check("half the step", maxval(abs(mean(:, 1) - mean(:, 2))) <= 2.0e-3_wp)
   end subroutine test_half_the_step

   !> The mirror image of an impact is the impact of the mirror image.
   subroutine test_mirror()
      type(block_t) :: block
      type(error_t), allocatable :: error
      type(motion_t) :: m(2)
      real(wp) :: energy, x(3, 8)
      integer :: corner(3, 12)
      real(wp), parameter :: q(4) = [0.5_wp, 0.1_wp, 0.7_wp, 0.5_wp]
      integer :: k

      call box([1.0_wp, 0.9_wp, 0.8_wp], x, corner)
      do k = 1, 2  ! y -> -y turns q into (q0, -q1, q2, -q3); spin likewise
         associate (s => real(3 - 2*k, wp))
            if (k == 2) then  ! mirror the facets too
               x(2, :) = -x(2, :)
               corner = corner([1, 3, 2], :)
            end if
            call make_block(x, corner, radius, density, block, error)
            call follow(block, ground_t(), [q(1), s*q(2), q(3), s*q(4)], [6.0_wp, s*2.0_wp, -4.0_wp], &
                        [s*3.0_wp, 9.0_wp, -s*2.0_wp], 1.0_wp, m(k), energy)
         end associate
      end do
      call check("mirrored velocity", all(abs(m(1)%v - [1, -1, 1]*m(2)%v) < 1.0e-8_wp))
      call check("mirrored spin", all(abs(spin_of(block, m(1)) - [-1, 1, -1]*spin_of(block, m(2))) < 1.0e-7_wp))
      call check("and it did turn aside", abs(m(1)%v(2)) > 1.0e-3_wp)
   end subroutine test_mirror

   !> A block on a slope below the friction angle stays, up to small oscillations; on a steeper slope it slides.
   subroutine test_rest()
      type(block_t) :: block
      type(motion_t) :: m
      type(relief_t) :: relief
      type(law_t) :: law
      real(wp) :: sine, time, dt
      integer :: k, j

      call box_block([1.0_wp, 1.0_wp, 0.5_wp], block)
      call flat(relief)
      law = law_of(ground_t(friction=0.5_wp, plough=.false., restitution=0.2_wp), radius, density)
      do k = 1, 2
         sine = merge(0.3_wp, 0.6_wp, k == 1)
         call start_motion(block, law, [0.0_wp, 0.0_wp, minval(abs(block%x(:, 3)))], [0.0_wp, 0.0_wp, 0.0_wp], &
                           [1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp], [0.0_wp, 0.0_wp, 0.0_wp], m)
         time = 0
         do j = 1, 200000
            dt = contact_step(block, law, m)
            call advance(block, law, relief, g*[sine, 0.0_wp, -sqrt(1 - sine**2)], dt, m)
            time = time + dt
            if (time > 1) exit
         end do
         if (k == 1) then
            call check("stays on a slope below its friction", sqrt(sum(m%v**2)) < 0.1_wp .and. m%x(1) < 0.05_wp)
         else
            call check_close("slides above it", m%v(1), g*time*(sine - 0.5_wp*sqrt(1 - sine**2)), 0.03_wp)
         end if
      end do
   end subroutine test_rest
end program test_lab_blocks
