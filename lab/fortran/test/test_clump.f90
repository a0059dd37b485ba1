! SPDX-License-Identifier: BSD-3-Clause
!> Clumps: volume and inertia of unions of spheres by closed forms, free motion, clumps of one sphere, layers at rest,
!> and throws that lose energy.
program test_lab_clump
   use rockfall_kinds, only: wp, i8
   use rockfall_error, only: error_t
   use rockfall_math, only: pi
   use rockfall_random, only: random_key
   use lab_contact, only: material_t
   use lab_rotation, only: any_orientation
   use lab_clump, only: clump_t, clump_shape_t, tetrahedral_clump, block_clump, make_clump, move_clump, set_motion, &
      clump_energy, shape_names
   use lab_bodies, only: bodies_t, bodies, set_clumps, kinetic_energy, total_mass, body_position, body_velocity
   use lab_neighbours, only: box_t
   use lab_packing, only: packing_t, layer_t, pack_layer, rocks_at_rest
   use lab_step, only: assembly_t, assemble, advance, safe_step, total_energy, sound
   use lab_contact_record, only: throw_t, contact_t
   use lab_rock_throw, only: boulder_t, shape_boulder, follow_on_rocks
   use check_m, only: check, check_close, finish
   implicit none

   call test_shapes()
   call test_free_motion()
   call test_one_sphere()
   call test_fall()
   call test_layer()
   call finish()

contains

   !> Volumes of four equal spheres, by inclusion and exclusion of pairs and triples, and of a box with rounded edges.
   subroutine test_shapes()
      type(clump_shape_t) :: rock, block
      real(wp) :: half(3), inner(3), edge, volume
      integer :: k

      rock = tetrahedral_clump()
      call check_close("a rock has the volume of the unit sphere", union_by_points(rock%x, rock%radius(1)), &
                       4*pi/3, 5.0e-3_wp*4*pi/3)
      call check("a rock is between its sphere and the one around it", &
                 rock%inertia(1) > 0.4_wp .and. rock%inertia(1) < 0.4_wp*rock%reach**2)
      call check_close("the centre of a rock", sum(abs(sum(rock%x, 2))), 0.0_wp, 1.0e-12_wp)
      do k = 2, size(shape_names)
         block = block_clump(k)
         edge = block%radius(1)
         inner = maxval(block%x, 2)
         half = inner + edge
         ! box with smooth rounded edges and corners: the spheres leave notches in between
         volume = 8*product(inner) + 8*edge*(inner(1)*inner(2) + inner(2)*inner(3) + inner(3)*inner(1)) &
                  + 2*pi*edge**2*sum(inner) + 4*pi/3*edge**3
         call check(trim(shape_names(k))//": notches of at most 5 %", volume > 4*pi/3 .and. volume < 1.05_wp*4*pi/3)
         call check(trim(shape_names(k))//": moments between those of the inscribed and the circumscribed box", &
                    all(block%inertia < (sum(half**2) - half**2)/3) &
                    .and. all(block%inertia > (sum(inner**2) - inner**2)/3))
         call check(trim(shape_names(k))//": no moment exceeds the sum of the others", &
                    2*maxval(block%inertia) < sum(block%inertia))
      end do
   end subroutine test_shapes

   !> Volume by a lattice of points, independent of the columns in the module.
   real(wp) function union_by_points(x, radius) result(volume)
      real(wp), intent(in) :: x(:, :), radius
      integer, parameter :: n = 80
      real(wp) :: p(3), size_of
      integer :: i, j, k, inside

      size_of = maxval(abs(x)) + radius
      inside = 0
      do i = 1, n
         do j = 1, n
            do k = 1, n
               p = size_of*(2*[i, j, k] - n - 1.0_wp)/n
               if (any((x(1, :) - p(1))**2 + (x(2, :) - p(2))**2 + (x(3, :) - p(3))**2 < radius**2)) inside = inside + 1
            end do
         end do
      end do
      volume = inside*(2*size_of/n)**3
   end function union_by_points

   !> Without forces, angular momentum is conserved exactly, and energy to 1e-6.
   subroutine test_free_motion()
      type(clump_t) :: clump
      real(wp) :: before, momentum(3)
      integer :: k

      clump = make_clump(block_clump(4), 0.5_wp, 2600.0_wp, 1, [0.0_wp, 0.0_wp, 0.0_wp], &
                         any_orientation(random_key(1_i8), 99_i8, 1_i8, 0_i8))
      call set_motion(clump, [1.0_wp, 2.0_wp, 3.0_wp, 4.0_wp, -11.0_wp, 7.0_wp])
      before = clump_energy(clump)
      momentum = clump%momentum
      do k = 1, 20000
         call move_clump(clump, 1.0e-4_wp)
      end do
      call check_close("a free clump keeps its energy", clump_energy(clump), before, 1.0e-6_wp*before)
      call check("a free clump keeps its momentum", all(abs(clump%momentum - momentum) <= 0))
      call check_close("a free clump moves on", clump%x(3), 6.0_wp, 1.0e-9_wp)
      call check("and turns", abs(clump%q(1)) < 1)
   end subroutine test_free_motion

   !> A clump of one sphere hits the floor like the sphere.
   subroutine test_one_sphere()
      type(assembly_t) :: alone, clumped
      type(bodies_t) :: b
      type(clump_shape_t) :: one
      type(material_t) :: stone
      real(wp) :: dt, x(3, 1)
      integer :: k

      stone = material_t(young=1.0e8_wp, friction=0.4_wp, damping=0.1_wp)
      one%x = reshape([0.0_wp, 0.0_wp, 0.0_wp], [3, 1])
      one%radius = [1.0_wp]
      one%inertia = 0.4_wp
      one%reach = 1
      x(:, 1) = [0.3_wp, 0.4_wp, 0.51_wp]
      dt = safe_step(stone, 0.5_wp, 2600.0_wp, 5.0_wp)
      b = bodies(x, [0.5_wp], [2600.0_wp])
      b%v(:, 1) = [3.0_wp, 1.0_wp, -4.0_wp, 2.0_wp, -1.0_wp, 0.5_wp]
      call assemble(alone, b, box_t(10.0_wp), stone, 9.81_wp, dt, 0.1_wp, 0, 1.0e4_wp)
      call set_clumps(b, [spinning(make_clump(one, 0.5_wp, 2600.0_wp, 1, x(:, 1), [1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp]), &
                                   b%v(:, 1))])
      call assemble(clumped, b, box_t(10.0_wp), stone, 9.81_wp, dt, 0.1_wp, 0, 1.0e4_wp)
      do k = 1, 400
         call advance(alone)
         call advance(clumped)
      end do
      call check("the sphere has rebounded", alone%bodies%v(3, 1) > 0)
      call check("a clump of one sphere moves as the sphere", &
                 all(abs(alone%bodies%v(:, 1) - body_velocity(clumped%bodies, 1)) < 1.0e-9_wp) &
                 .and. all(abs(alone%bodies%x(:, 1) - body_position(clumped%bodies, 1)) < 1.0e-9_wp))
   end subroutine test_one_sphere

   type(clump_t) function spinning(clump, v)
      type(clump_t), intent(in) :: clump
      real(wp), intent(in) :: v(6)

      spinning = clump
      call set_motion(spinning, v)
   end function spinning

   !> A block that falls on the floor without friction and damping conserves energy, part of which becomes rotation.
   subroutine test_fall()
      type(assembly_t) :: s
      type(bodies_t) :: b
      type(clump_shape_t) :: shape
      type(clump_t) :: clump
      real(wp) :: before, worst, v(6)
      integer :: n, k

      shape = block_clump(3)
      n = size(shape%radius)
      clump = make_clump(shape, 0.5_wp, 2600.0_wp, 1, [5.0_wp, 5.0_wp, 0.9_wp], &
                         any_orientation(random_key(2_i8), 99_i8, 1_i8, 0_i8))
      call set_motion(clump, [2.0_wp, 0.0_wp, -6.0_wp, 0.0_wp, 0.0_wp, 0.0_wp])
      b = bodies(spread(clump%x, 2, n), 0.5_wp*shape%radius, spread(2600.0_wp, 1, n))
      call set_clumps(b, [clump])
      call assemble(s, b, box_t(10.0_wp), material_t(young=1.0e8_wp, friction=0.0_wp), 9.81_wp, 2.0e-5_wp, 0.1_wp, 0, &
                    1.0e5_wp)
      before = total_energy(s)
      worst = 0
      do k = 1, 10000
         call advance(s)
         worst = max(worst, abs(total_energy(s) - before))
      end do
      v = body_velocity(s%bodies, n)
      call check("no trouble", s%trouble == sound)
      call check_close("a block that falls keeps its energy", worst/before, 0.0_wp, 2.0e-3_wp)
      call check("it spins after it fell on an edge", sum(v(4:6)**2) > 0.1_wp)
      call check_close("its motion along the floor stays", v(1), 2.0_wp, 1.0e-9_wp)
   end subroutine test_fall

   !> A layer of clumps is at rest and stays at rest; boulders thrown at it lose energy.
   subroutine test_layer()
      type(packing_t) :: packing
      type(material_t) :: stone
      type(layer_t) :: layer
      type(error_t), allocatable :: error
      type(boulder_t) :: boulder
      type(throw_t) :: throw
      type(contact_t) :: found(3)
      type(bodies_t) :: b
      real(wp) :: square
      integer :: k, l, n, made
      logical :: complete, loses

      stone = material_t(young=2.0e8_wp, friction=0.4_wp, damping=0.1_wp)
      packing = packing_t(mean_radius=0.2_wp, ratio=2.0_wp, depth=1.5_wp, grading=2.0_wp, friction=0.2_wp, &
                          clumps=.true.)
      call pack_layer(packing, stone, random_key(1_i8), 1_i8, layer, error)
      call check("a layer of clumps", .not. allocated(error))
      if (allocated(error)) return
      call check_close("the floor carries it", layer%floor_share, 1.0_wp, 0.02_wp)
      call check("solid fraction of angular rocks", layer%solid > 0.45_wp .and. layer%solid < 0.75_wp)
      b = rocks_at_rest(layer, packing%density, reshape([0.0_wp, 0.0_wp, 9.0_wp], [3, 1]), [0.1_wp], 2650.0_wp)
      call check_close("mass of the clumps", total_mass(b) - b%mass(b%n), &
                       packing%density*layer%solid*layer%box%width**2*layer%surface, 1.0e-6_wp*total_mass(b))
      call check("at rest", kinetic_energy(b) <= 0)
      boulder = boulder_t(radius=0.4_wp, kind=3)
      call shape_boulder(boulder)
      loses = .true.
      made = 0
      do k = 1, 6
         throw = throw_t(place=layer%box%width*modulo([0.37_wp, 0.73_wp]*k, 1.0_wp), speed=4.0_wp + k, &
                         angle=20.0_wp + 10*k, spin=0.1_wp*k, &
                         orientation=any_orientation(random_key(3_i8), 99_i8, int(k, i8), 0_i8))
         call follow_on_rocks(layer, packing, stone, boulder, throw, random_key(3_i8), int(k, i8), found, n, complete)
         if (n < 1) cycle
         made = made + n
         do l = 1, n  ! the energy of its fall may be gained
            square = max(sum(found(l)%incoming(1:2)**2), 1.0e-3_wp)
            loses = loses .and. found(l)%energy < 1 + 2*9.81_wp*max(0.0_wp, -found(l)%rise)/square
         end do
      end do
      call check("contacts of blocks with clumps", made >= 6)
      call check("on level ground they lose energy", loses)
   end subroutine test_layer
end program test_lab_clump
