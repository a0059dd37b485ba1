! SPDX-License-Identifier: BSD-3-Clause
!> Soil of spheres, or of clumps of four spheres: radii are drawn from a grading, and the rocks fall on a floor in a
!> periodic box until their energy is dissipated. Friction during settling controls the compaction: 0 gives a dense
!> layer, large values a loose layer. The solid fraction is a result.
module lab_packing
   use rockfall_kinds, only: wp, i8
   use rockfall_error, only: error_t, fail, our_fault
   use rockfall_math, only: pi, logarithm, exponential
   use rockfall_random, only: random_key_t, random_words, uniform, words_per_block
   use lab_contact, only: material_t
   use lab_rotation, only: any_orientation
   use lab_clump, only: clump_t, clump_shape_t, tetrahedral_clump, make_clump
   use lab_bodies, only: bodies_t, bodies, set_clumps, slow_down, kinetic_energy, total_mass, mass_moment
   use lab_neighbours, only: box_t, fold_into_box
   use lab_step, only: assembly_t, assemble, stiffen, advance, watch_energy, total_energy, safe_step, &
      energy_tolerance, trouble_text, sound
   implicit none
   private
   public :: packing_t, layer_t, pack_layer, stiffen_layer, check_packing, max_spheres, size_limits, draw_radius, &
      box_width, skin_factor, rocks_at_rest, largest_extent

   integer(i8), parameter :: for_layer = 65, for_rock_attitude = 72  !! purposes of the random numbers
   real(wp), parameter :: skin_factor = 0.35_wp     !! skin of the neighbour list, over R_m [-]
   real(wp), parameter :: expected_solid = 0.64_wp  !! volume of the spheres over volume of the layer [-]
   real(wp), parameter :: bodies_limit = 3.0e5_wp   !! maximum number of spheres in a layer
   ! Even a small boulder needs rocks around it.
   real(wp), parameter :: min_width = 10            !! minimum width of the box, over R_m [-]

   ! Settings that accelerate settling; not used in impacts.
   real(wp), parameter :: drag = 0.5_wp             !! rate over sqrt(g/R_m) [-]: a terminal speed of 2 sqrt(g R_m)
   real(wp), parameter :: resting_drag = 2          !! drag while a layer springs back after the fall
   real(wp), parameter :: settling_damping = 0.3_wp !! minimum fraction of critical damping of contacts
   real(wp), parameter :: softness = 0.1_wp         !! Young's modulus during the fall, over that of the material [-]
   integer, parameter :: stages = 12, stage_steps = 60  !! stages that raise the modulus at rest; steps of a stage
   ! Kinetic energy over (mass g R_m) at which a layer has fallen, and at which it is at rest. The floor then carries
   ! the weight within 1e-2, or 1e-3 for large layers.
   real(wp), parameter :: fallen = 1.0e-4_wp, at_rest = 1.0e-5_wp
   real(wp), parameter :: creep = 1.0e-3_wp         !! energy accepted as rest at the time limit
   real(wp), parameter :: patience = 300            !! time limit after the fall [sqrt(R_m/g)]
   integer, parameter :: watch_interval = 64        !! steps between checks

   !> Parameters of a layer.
   type :: packing_t
      real(wp) :: mean_radius = 0.25_wp !! R_m, mean by number [m]
      real(wp) :: ratio = 5             !! R_b/R_m of the boulder that the layer is made for
      real(wp) :: grading = 5           !! maximum over minimum radius [-]
      logical :: by_mass = .false.      !! radii are uniform in mass (number ~ r**-3), not in number
      real(wp) :: width = 5             !! width of the periodic box [R_b]
      real(wp) :: depth = 3             !! expected height of the surface [R_b]
      real(wp) :: density = 2650        !! [kg/m3]
      real(wp) :: friction = 0.3_wp     !! friction during settling; rolling resistance is in proportion
      real(wp) :: gravity = 9.81_wp     !! [m/s2]
      logical :: rigid_base = .false.   !! false: the base absorbs waves
      real(wp) :: base_speed = 300      !! wave speed in the ground below an absorbing base [m/s]
      logical :: clumps = .false.       !! rocks are clumps; their radius is that of the sphere of equal volume
   end type packing_t

   !> A settled layer.
   type :: layer_t
      real(wp), allocatable :: x(:, :)    !! (3, n) centres of spheres [m]
      real(wp), allocatable :: radius(:)  !! (n) radii [m]
      type(clump_shape_t), allocatable :: rock  !! shape of the clumps, if any; their spheres are consecutive
      type(box_t) :: box
      real(wp) :: surface = 0             !! mean height of the surface [m]
      real(wp) :: top = 0                 !! height of the highest point [m]
      real(wp) :: solid = 0               !! volume of the rocks over (area * mean height of the surface) [-]
      real(wp) :: floor_share = 0         !! force of the floor over weight [-]
      integer :: steps = 0
   end type layer_t

contains

   !> Check the parameters of a layer.
   pure subroutine check_packing(packing, error)
      type(packing_t), intent(in) :: packing
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: limits(2)

      associate (p => packing)
         if (.not. (p%mean_radius > 0 .and. p%density > 0 .and. p%gravity > 0)) then
            call fail(error, "packing: mean_radius, density and gravity must be > 0")
         else if (.not. p%grading >= 1) then
            call fail(error, "packing: grading must be >= 1")
         else if (.not. (p%depth > 0 .and. p%friction >= 0 .and. p%width > 0)) then
            call fail(error, "packing: depth and width must be > 0 and friction >= 0")
         else if (.not. (p%base_speed >= 0 .and. p%base_speed < huge(1.0_wp))) then
            call fail(error, "packing: base_speed must be >= 0 [m/s]")
         else
            limits = size_limits(p)
            if (.not. spheres_per_rock(p)*solid_volume(p) <= bodies_limit*4.0_wp/3*pi*limits(1)**3) then
               call fail(error, &
                  "packing: width, depth or grading is too great: more than 300000 bodies")
               return
            end if
            limits = limits*extent_of_rock(p)
            if (.not. box_width(p) > 4*limits(2) + 2*skin_factor*p%mean_radius) then
               call fail(error, &
                  "packing: width must exceed the diameters of the two largest bodies side by side")
            else if (.not. box_width(p) > 3*p%ratio*p%mean_radius) then
               call fail(error, "packing: width must be above 3 R_b")
            else if (.not. box_width(p) > 2*(limits(2) + (p%ratio + skin_factor)*p%mean_radius)) then
               call fail(error, &
                  "packing: width must exceed the diameters of boulder and largest rock side by side")
            end if
         end if
      end associate
   end subroutine check_packing

   !> Width of the box [m].
   elemental real(wp) function box_width(packing)
      type(packing_t), intent(in) :: packing

      box_width = packing%mean_radius*max(packing%width*packing%ratio, min_width)
   end function box_width

   !> Depth of the layer [m], at least two diameters of its largest rocks.
   pure real(wp) function layer_depth(packing)
      type(packing_t), intent(in) :: packing
      real(wp) :: limits(2)

      limits = size_limits(packing)
      layer_depth = max(packing%depth*packing%ratio*packing%mean_radius, 4*limits(2))
   end function layer_depth

   pure integer function spheres_per_rock(packing)
      type(packing_t), intent(in) :: packing

      spheres_per_rock = merge(4, 1, packing%clumps)
   end function spheres_per_rock

   !> Distance of the farthest point of a rock from its centre, over its radius [-].
   pure real(wp) function extent_of_rock(packing) result(extent)
      type(packing_t), intent(in) :: packing
      type(clump_shape_t) :: shape

      extent = 1
      if (.not. packing%clumps) return
      shape = tetrahedral_clump()
      extent = shape%reach
   end function extent_of_rock

   !> Minimum and maximum radius [m].
   pure function size_limits(packing) result(limits)
      type(packing_t), intent(in) :: packing
      real(wp) :: limits(2)

      associate (q => packing%grading)
         limits = packing%mean_radius*merge((q + 1)/2*[1/q, 1.0_wp], 2/(q + 1)*[1.0_wp, q], &
            packing%by_mass)
      end associate
   end function size_limits

   !> Draw a radius by inversion of its distribution [m].
   pure real(wp) function draw_radius(packing, u) result(radius)
      type(packing_t), intent(in) :: packing
      real(wp), intent(in) :: u  !! uniform in (0, 1) [-]
      real(wp) :: limits(2)

      limits = size_limits(packing)
      if (packing%by_mass) then
         radius = 1/sqrt((1 - u)/limits(1)**2 + u/limits(2)**2)
      else
         radius = limits(1) + u*(limits(2) - limits(1))
      end if
   end function draw_radius

   !> Pack layer `number` of a seed. A pure function of its arguments.
   pure subroutine pack_layer(packing, material, key, number, layer, error)
      type(packing_t), intent(in) :: packing
      type(material_t), intent(in) :: material  !! material for impacts, with its friction
      type(random_key_t), intent(in) :: key
      integer(i8), intent(in) :: number
      type(layer_t), intent(out) :: layer
      type(error_t), allocatable, intent(out) :: error
      type(assembly_t) :: s
      type(bodies_t) :: b

      call check_packing(packing, error)
      if (allocated(error)) return
      layer%box = box_t(box_width(packing))
      if (packing%clumps) layer%rock = tetrahedral_clump()
      call hang(packing, layer%rock, key, number, b)
      call start(packing, material, softness, layer%box, b, s)
      call settle(packing, drag, fallen, s, layer%steps, error)
      if (allocated(error)) return
      call harden(packing, material, softness, s, layer%steps)
      call settle(packing, resting_drag, at_rest, s, layer%steps, error)
      if (allocated(error)) return
      call describe(layer, packing%density, s)
   end subroutine pack_layer

   !> Settle a layer again with stiffer rocks.
   pure subroutine stiffen_layer(packing, material, young, layer, error)
      type(packing_t), intent(in) :: packing
      type(material_t), intent(in) :: material  !! material of the layer
      real(wp), intent(in) :: young             !! new Young's modulus, above that of the material [Pa]
      type(layer_t), intent(inout) :: layer
      type(error_t), allocatable, intent(out) :: error
      type(assembly_t) :: s
      type(material_t) :: stiff
      type(bodies_t) :: b

      b = rocks_at_rest(layer, packing%density, reshape([real(wp) ::], [3, 0]), [real(wp) ::], packing%density)
      call start(packing, material, 1.0_wp, layer%box, b, s)
      stiff = s%material
      stiff%young = young
      call harden(packing, stiff, material%young/young, s, layer%steps)
      call settle(packing, resting_drag, at_rest, s, layer%steps, error)
      if (allocated(error)) return
      call describe(layer, packing%density, s)
   end subroutine stiffen_layer

   !> Place enough bodies for the depth above the floor, in rows without overlap, with small random velocities.
   pure subroutine hang(packing, rock, key, number, b)
      type(packing_t), intent(in) :: packing
      type(clump_shape_t), allocatable, intent(in) :: rock  !! absent for spheres
      type(random_key_t), intent(in) :: key
      integer(i8), intent(in) :: number
      type(bodies_t), intent(out) :: b
      real(wp), allocatable :: x(:, :), r(:), v(:, :)
      real(wp), parameter :: apart = 1.001_wp  ! relative spacing of neighbouring rows
      integer(i8) :: word(words_per_block), gap(words_per_block)  ! words 1: radius, 2 to 4: velocity; word 1: gap
      real(wp) :: width, volume, goal, corner(3), row, tallest, kick, extent, half
      integer :: n

      width = box_width(packing)
      goal = solid_volume(packing)
      kick = 0.2_wp*sqrt(packing%gravity*packing%mean_radius)
      extent = extent_of_rock(packing)
      n = max_spheres(packing)/spheres_per_rock(packing)
      allocate (x(3, n), r(n), v(3, n))
      volume = 0
      corner = 0   ! corner of the next body: along the row, across rows, above shelves
      row = 0      ! largest body of this row
      tallest = 0  ! largest body of this shelf
      n = 0
      do while (volume < goal)
         n = n + 1
         word = random_words(key, for_layer, number, int(n, i8), 0_i8)
         gap = random_words(key, for_layer, number, int(n, i8), 1_i8)
         r(n) = draw_radius(packing, uniform(word(1)))
         v(:, n) = kick*(2*uniform(word(2:4)) - 1)
         half = extent*r(n)
         if (corner(1) + 2*half > width) then
            corner = [0.0_wp, corner(2) + row, corner(3)]
            row = 0
         end if
         if (corner(2) + 2*half > width) then
            corner = [0.0_wp, 0.0_wp, corner(3) + tallest]
            row = 0
            tallest = 0
         end if
         x(:, n) = corner + half
         corner(1) = corner(1) + 2*half*(1 + 0.1_wp*uniform(gap(1)))
         row = max(row, 2*apart*half)
         tallest = max(tallest, 2*apart*half)
         volume = volume + 4.0_wp/3*pi*r(n)**3
      end do
      if (allocated(rock)) then
         b = hanging_clumps(packing, rock, key, number, x(:, :n), r(:n), v(:, :n))
      else
         b = bodies(x(:, :n), r(:n), spread(packing%density, 1, n))
         b%v(1:3, :) = v(:, :n)
      end if
   end subroutine hang

   !> Rocks as clumps, each with a random orientation.
   pure type(bodies_t) function hanging_clumps(packing, rock, key, number, x, radius, v) result(b)
      type(packing_t), intent(in) :: packing
      type(clump_shape_t), intent(in) :: rock
      type(random_key_t), intent(in) :: key
      integer(i8), intent(in) :: number
      real(wp), intent(in) :: x(:, :), radius(:), v(:, :)  !! centres [m], [m], [m/s]
      type(clump_t) :: clump(size(radius))
      integer :: k, each

      each = size(rock%radius)
      do k = 1, size(radius)
         clump(k) = make_clump(rock, radius(k), packing%density, each*(k - 1) + 1, x(:, k), &
                               any_orientation(key, for_rock_attitude, number, int(k, i8)))
         clump(k)%v = v(:, k)
      end do
      b = spheres_of_clumps(rock, radius, packing%density)
      call set_clumps(b, clump)
   end function hanging_clumps

   !> Spheres of rocks that are clumps, before the clumps place them.
   pure type(bodies_t) function spheres_of_clumps(rock, radius, density) result(b)
      type(clump_shape_t), intent(in) :: rock
      real(wp), intent(in) :: radius(:), density  !! radii [m] and density [kg/m3] of rocks
      integer :: n, k

      n = size(rock%radius)*size(radius)
      b = bodies(spread([0.0_wp, 0.0_wp, 0.0_wp], 2, n), [(radius(k)*rock%radius, k=1, size(radius))], &
                 spread(density, 1, n))
   end function spheres_of_clumps

   !> Bodies of a settled layer, followed by the spheres of a boulder as separate bodies.
   pure type(bodies_t) function rocks_at_rest(layer, density, x, radius, boulder_density) result(b)
      type(layer_t), intent(in) :: layer
      real(wp), intent(in) :: density                    !! density of the rocks [kg/m3]
      real(wp), intent(in) :: x(:, :), radius(:)         !! centres and radii of the boulder's spheres [m]
      real(wp), intent(in) :: boulder_density            !! [kg/m3]
      real(wp) :: centres(3, size(layer%radius) + size(radius))
      integer :: n

      n = size(layer%radius)
      centres(:, :n) = layer%x
      centres(:, n + 1:) = x
      b = bodies(centres, [layer%radius, radius], [spread(density, 1, n), spread(boulder_density, 1, size(radius))])
      if (allocated(layer%rock)) call set_clumps(b, resting_clumps(layer, density))
   end function rocks_at_rest

   !> Clumps of a settled layer. Their moments of inertia are equal, so that any axes are principal axes.
   pure function resting_clumps(layer, density) result(clump)
      type(layer_t), intent(in) :: layer
      real(wp), intent(in) :: density  !! [kg/m3]
      type(clump_t), allocatable :: clump(:)
      real(wp), allocatable :: x(:, :)
      real(wp) :: width
      integer :: each, k, j, first

      each = size(layer%rock%radius)
      width = layer%box%width
      allocate (clump(size(layer%radius)/each), x(3, each))
      do k = 1, size(clump)
         first = each*(k - 1) + 1
         do j = 1, each  ! unfold: in the box, the images of a rock's spheres need not be neighbours
            x(:, j) = layer%x(:, first + j - 1)
            x(1:2, j) = x(1:2, j) - width*anint((x(1:2, j) - x(1:2, 1))/width)
         end do
         clump(k) = make_clump(layer%rock, layer%radius(first)/layer%rock%radius(1), density, first, sum(x, 2)/each, &
                               [1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp])
         clump(k)%offset = x - spread(clump(k)%x, 2, each)
      end do
   end function resting_clumps

   !> Distance of the farthest point of the largest rock of a layer from its centre [m].
   pure real(wp) function largest_extent(layer) result(extent)
      type(layer_t), intent(in) :: layer

      extent = maxval(layer%radius)
      if (allocated(layer%rock)) extent = extent/layer%rock%radius(1)*layer%rock%reach
   end function largest_extent

   !> Volume of spheres for a layer, to be reached or slightly exceeded [m3].
   pure real(wp) function solid_volume(packing)
      type(packing_t), intent(in) :: packing

      solid_volume = expected_solid*box_width(packing)**2*layer_depth(packing)
   end function solid_volume

   !> Maximum number of spheres in a layer.
   pure integer function max_spheres(packing)
      type(packing_t), intent(in) :: packing

      max_spheres = int(solid_volume(packing)/(4.0_wp/3*pi*minval(size_limits(packing))**3)) + 2
      max_spheres = spheres_per_rock(packing)*max_spheres
   end function max_spheres

   pure subroutine start(packing, material, softness, box, b, s)
      type(packing_t), intent(in) :: packing
      type(material_t), intent(in) :: material
      real(wp), intent(in) :: softness  !! Young's modulus at the start, over that of the material [-]
      type(box_t), intent(in) :: box
      type(bodies_t), intent(in) :: b
      type(assembly_t), intent(out) :: s
      type(material_t) :: settling
      real(wp) :: dt

      settling = material
      settling%young = softness*material%young
      settling%damping = max(material%damping, settling_damping)
      settling%friction = packing%friction
      settling%rolling = 0
      if (material%friction > 0) &
         settling%rolling = material%rolling*packing%friction/material%friction
      dt = safe_step(settling, minval(b%radius), packing%density, &
                     2*sqrt(packing%gravity*packing%mean_radius)/drag)
      call assemble(s, b, box, settling, packing%gravity, dt, skin_factor*packing%mean_radius, 0, &
                    packing%gravity*mass_moment(b))
   end subroutine start

   !> Step until the kinetic energy is dissipated, or only creep remains.
   pure subroutine settle(packing, drag, spent, s, steps, error)
      type(packing_t), intent(in) :: packing
      real(wp), intent(in) :: drag   !! rate over sqrt(g/R_m) [-]
      real(wp), intent(in) :: spent  !! kinetic energy that counts as zero, over (mass g R_m) [-]
      type(assembly_t), intent(inout) :: s
      integer, intent(inout) :: steps
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: rate, unit, energy, time_limit
      integer :: first

      associate (g => packing%gravity, r_m => packing%mean_radius)
         rate = drag*sqrt(g/r_m)
         time_limit = patience*sqrt(r_m/g) + 2*maxval(s%bodies%x(3, :))*rate/g
         unit = total_mass(s%bodies)*g*r_m
      end associate
      first = steps
      energy = huge(energy)
      do while ((steps - first)*s%dt < time_limit)
         call advance(s)
         call slow_down(s%bodies, 1 - rate*s%dt)
         steps = steps + 1
         if (s%trouble == sound .and. mod(steps, watch_interval) == 0) call watch_energy(s)
         if (s%trouble /= sound) then
            call fail(error, "packing exploded: "//trouble_text(s%trouble), our_fault)
            return
         end if
         if (mod(steps, watch_interval) == 0 .and. (steps - first)*s%dt*rate > 1) then
            energy = kinetic_energy(s%bodies)
            if (energy < spent*unit) return
         end if
      end do
      if (energy < creep*unit) return  ! a body at its slip limit creeps forever
      call fail(error, "packing: the layer did not come to rest in time")
   end subroutine settle

   !> Raise Young's modulus to that of the material in stages, so that the layer springs back without being thrown up.
   pure subroutine harden(packing, material, softness, s, steps)
      type(packing_t), intent(in) :: packing
      type(material_t), intent(in) :: material
      real(wp), intent(in) :: softness  !! initial Young's modulus, over that of the material [-]
      type(assembly_t), intent(inout) :: s
      integer, intent(inout) :: steps
      real(wp) :: rate, factor
      integer :: k, l

      rate = resting_drag*sqrt(packing%gravity/packing%mean_radius)
      s%dt = safe_step(material, minval(s%bodies%radius), packing%density, &
                       2*sqrt(packing%gravity*packing%mean_radius)/drag)
      factor = exponential(-logarithm(softness)/stages)
      s%energy_limit = huge(1.0_wp)
      do k = 1, stages
         call stiffen(s, merge(s%material%young*factor, material%young, k < stages))
         do l = 1, stage_steps
            call advance(s)
            call slow_down(s%bodies, 1 - rate*s%dt)
         end do
         steps = steps + stage_steps
      end do
      s%energy_limit = total_energy(s) + energy_tolerance*packing%gravity*total_mass(s%bodies)*packing%mean_radius
   end subroutine harden

   !> Store the packed layer and its properties.
   pure subroutine describe(layer, density, s)
      type(layer_t), intent(inout) :: layer
      real(wp), intent(in) :: density  !! [kg/m3]
      type(assembly_t), intent(in) :: s

      associate (b => s%bodies)
         layer%x = b%x
         layer%radius = b%radius
         call fold_into_box(layer%box, layer%x)
         layer%top = maxval(b%x(3, :) + b%radius)
         layer%surface = mean_surface(layer)
         layer%solid = 4.0_wp/3*pi*sum(b%radius**3)/(layer%box%width**2*layer%surface)
         if (allocated(b%clump)) layer%solid = total_mass(b)/density/(layer%box%width**2*layer%surface)
         layer%floor_share = s%floor_force/(s%gravity*total_mass(b))
      end associate
   end subroutine describe

   !> Mean height of the surface over a raster of points [m].
   pure real(wp) function mean_surface(layer) result(mean)
      type(layer_t), intent(in) :: layer
      integer, parameter :: n = 100
      real(wp) :: top(0:n - 1, 0:n - 1), cell, dx, dy, rest
      integer :: k, i, j, reach, at(2)

      cell = layer%box%width/n
      top = 0
      do k = 1, size(layer%radius)
         at = floor(layer%x(1:2, k)/cell)
         reach = int(layer%radius(k)/cell) + 1
         do j = at(2) - reach, at(2) + reach
            do i = at(1) - reach, at(1) + reach
               dx = (i + 0.5_wp)*cell - layer%x(1, k)
               dy = (j + 0.5_wp)*cell - layer%x(2, k)
               rest = layer%radius(k)**2 - dx**2 - dy**2
               if (rest <= 0) cycle
               associate (here => top(modulo(i, n), modulo(j, n)))
                  here = max(here, layer%x(3, k) + sqrt(rest))
               end associate
            end do
         end do
      end do
      mean = sum(top)/n**2
   end function mean_surface
end module lab_packing
