! SPDX-License-Identifier: BSD-3-Clause
!> A soil of spheres: radii drawn from a distribution, let fall on a rigid floor until their energy
!> is spent. The friction while they settle sets the compaction: 0 gives a dense layer, the friction
!> of the contact a loose one.
module lab_packing
   use rockfall_kinds, only: wp, i8
   use rockfall_error, only: error_t, fail, our_fault
   use rockfall_math, only: pi
   use rockfall_random, only: random_key_t, random_words, uniform
   use lab_contact, only: material_t
   use lab_bodies, only: bodies_t, bodies
   use lab_neighbours, only: box_t
   use lab_step, only: assembly_t, assemble, advance, watch_energy, safe_step, trouble_text, sound
   implicit none
   private
   public :: packing_t, layer_t, pack_layer, check_packing, most_bodies, size_limits, &
      draw_radius, surface_height, for_layer
   public :: skin_share

   integer(i8), parameter :: for_layer = 65         !! purpose of the random numbers of a layer
   real(wp), parameter :: skin_share = 0.25_wp      !! skin of the list of neighbours / mean radius
   real(wp), parameter :: expected_solid = 0.85_wp  !! area of the discs / area that they fill

   real(wp), parameter :: bodies_limit = 1.0e5_wp   !! in a layer

   ! Aids to settle quickly; impacts have neither.
   real(wp), parameter :: drag = 0.5_wp !! rate / sqrt(g/R_m): a terminal speed of 2 sqrt(g R_m)
   real(wp), parameter :: settling_damping = 0.3_wp !! least viscous share of contacts
   real(wp), parameter :: spent = 1.0e-8_wp !! kinetic energy of a settled layer / (mass g R_m)
   real(wp), parameter :: creep = 1.0e-6_wp !! as much is taken for rest when patience ends
   real(wp), parameter :: patience = 300            !! sqrt(R_m/g), beyond the fall
   integer, parameter :: watch_interval = 64        !! steps

   !> What a layer is made from. Lengths in mean radii R_m.
   type :: packing_t
      real(wp) :: mean_radius = 0.25_wp !! R_m, by number [m]
      real(wp) :: size_ratio = 5        !! greatest / smallest radius
      logical :: by_mass = .false.      !! radii even in mass (number as r**-3), not in number
      real(wp) :: width = 60            !! [R_m]
      real(wp) :: depth = 8             !! expected height of the surface [R_m]
      logical :: periodic = .true.      !! sides
      real(wp) :: density = 2650        !! [kg/m3]
      real(wp) :: friction = 0          !! while settling; rolling resistance in proportion
      real(wp) :: gravity = 9.81_wp     !! [m/s2]
   end type packing_t

   !> A settled layer.
   type :: layer_t
      real(wp), allocatable :: x(:, :)    !! (2, n) centres [m]
      real(wp), allocatable :: radius(:)  !! [m]
      real(wp) :: mean_radius = 0         !! R_m as asked for [m]
      real(wp) :: density = 0             !! [kg/m3]
      type(box_t) :: box
      real(wp) :: surface = 0             !! mean height of the surface [m]
      real(wp) :: top = 0                 !! of the highest body [m]
      real(wp) :: solid = 0               !! area of the discs / (width * surface)
      real(wp) :: floor_share = 0         !! force of the floor / weight
      integer :: steps = 0
   end type layer_t

contains

   !> Refuse what cannot be packed.
   pure subroutine check_packing(packing, error)
      type(packing_t), intent(in) :: packing
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: limits(2)

      associate (p => packing)
         if (.not. (p%mean_radius > 0 .and. p%density > 0 .and. p%gravity > 0)) then
            call fail(error, "packing: mean_radius, density and gravity must be > 0")
         else if (.not. p%size_ratio >= 1) then
            call fail(error, "packing: size_ratio must be >= 1")
         else if (.not. (p%depth > 0 .and. p%friction >= 0)) then
            call fail(error, "packing: depth must be > 0 and friction >= 0")
         else
            limits = size_limits(p)
            if (.not. solid_area(p) <= bodies_limit*pi*limits(1)**2) then
               call fail(error, &
                  "packing: width, depth or size_ratio is too great: more than 100000 bodies")
            else if (.not. p%width*p%mean_radius > 4*limits(2) + 2*skin_share*p%mean_radius) then
               call fail(error, &
                  "packing: width must exceed the diameters of the two largest bodies side by side")
            end if
         end if
      end associate
   end subroutine check_packing

   !> Smallest and greatest radius [m].
   pure function size_limits(packing) result(limits)
      type(packing_t), intent(in) :: packing
      real(wp) :: limits(2)

      associate (q => packing%size_ratio)
         limits = packing%mean_radius*merge((q + 1)/2*[1/q, 1.0_wp], 2/(q + 1)*[1.0_wp, q], &
            packing%by_mass)
      end associate
   end function size_limits

   !> A radius by inversion of its distribution [m].
   pure real(wp) function draw_radius(packing, u) result(radius)
      type(packing_t), intent(in) :: packing
      real(wp), intent(in) :: u  !! uniform in (0, 1)
      real(wp) :: limits(2)

      limits = size_limits(packing)
      if (packing%by_mass) then
         radius = 1/sqrt((1 - u)/limits(1)**2 + u/limits(2)**2)
      else
         radius = limits(1) + u*(limits(2) - limits(1))
      end if
   end function draw_radius

   !> Layer `number` of a seed: a pure function of its arguments.
   pure subroutine pack_layer(packing, material, key, number, layer, error)
      type(packing_t), intent(in) :: packing
      type(material_t), intent(in) :: material  !! its friction is that of impacts
      type(random_key_t), intent(in) :: key
      integer(i8), intent(in) :: number
      type(layer_t), intent(out) :: layer
      type(error_t), allocatable, intent(out) :: error
      type(assembly_t) :: s
      type(bodies_t) :: b

      call check_packing(packing, error)
      if (allocated(error)) return
      layer%box = box_t(packing%width*packing%mean_radius, packing%periodic)
      layer%mean_radius = packing%mean_radius
      layer%density = packing%density
      call hang(packing, key, number, b)
      call start(packing, material, layer%box, b, s)
      call settle(packing, s, layer%steps, error)
      if (allocated(error)) return
      call describe(layer, s)
   end subroutine pack_layer

   !> Bodies in loose rows above the floor, without overlap, enough of them to fill the depth.
   pure subroutine hang(packing, key, number, b)
      type(packing_t), intent(in) :: packing
      type(random_key_t), intent(in) :: key
      integer(i8), intent(in) :: number
      type(bodies_t), intent(out) :: b
      real(wp), allocatable :: x(:, :), r(:), v(:)
      integer(i8) :: word(12)
      real(wp) :: width, area, goal, across, base, tallest, kick
      integer :: n

      width = packing%width*packing%mean_radius
      goal = solid_area(packing)
      kick = 0.2_wp*sqrt(packing%gravity*packing%mean_radius)
      n = most_bodies(packing)
      allocate (x(2, n), r(n), v(n))
      area = 0
      across = 0
      base = 0
      tallest = 0
      n = 0
      do while (area < goal)
         n = n + 1
         word = random_words(key, for_layer, number, int(n, i8), 0_i8)
         r(n) = draw_radius(packing, uniform(word(1)))
         v(n) = kick*(2*uniform(word(2)) - 1)
         if (across + 2*r(n) > width) then  ! next row
            base = base + tallest
            across = 0
            tallest = 0
         end if
         x(:, n) = [across, base] + r(n)
         across = across + 2*r(n)*(1 + 0.2_wp*uniform(word(3)))
         tallest = max(tallest, 2.001_wp*r(n))
         area = area + pi*r(n)**2
      end do
      b = bodies(x(:, :n), r(:n), spread(packing%density, 1, n))
      b%v(1, :) = v(:n)
   end subroutine hang

   !> Area of the discs of a layer, to be reached or just exceeded [m2].
   pure real(wp) function solid_area(packing)
      type(packing_t), intent(in) :: packing

      solid_area = expected_solid*packing%width*packing%depth*packing%mean_radius**2
   end function solid_area

   !> No layer has more bodies.
   pure integer function most_bodies(packing)
      type(packing_t), intent(in) :: packing

      most_bodies = int(solid_area(packing)/(pi*minval(size_limits(packing))**2)) + 2
   end function most_bodies

   pure subroutine start(packing, material, box, b, s)
      type(packing_t), intent(in) :: packing
      type(material_t), intent(in) :: material
      type(box_t), intent(in) :: box
      type(bodies_t), intent(in) :: b
      type(assembly_t), intent(out) :: s
      type(material_t) :: settling
      real(wp) :: dt

      settling = material
      settling%damping = max(material%damping, settling_damping)
      settling%friction = packing%friction
      settling%rolling = 0
      if (material%friction > 0) &
         settling%rolling = material%rolling*packing%friction/material%friction
      dt = safe_step(material, minval(b%radius), packing%density, &
                     2*sqrt(packing%gravity*packing%mean_radius)/drag)
      call assemble(s, b, box, settling, packing%gravity, dt, skin_share*packing%mean_radius, 0, &
                    packing%gravity*sum(b%mass*b%x(2, :)))
   end subroutine start

   !> Step until the kinetic energy is spent, or creeps.
   pure subroutine settle(packing, s, steps, error)
      type(packing_t), intent(in) :: packing
      type(assembly_t), intent(inout) :: s
      integer, intent(out) :: steps
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: rate, unit, energy, time_limit

      associate (g => packing%gravity, r_m => packing%mean_radius)
         rate = drag*sqrt(g/r_m)
         time_limit = patience*sqrt(r_m/g) + 2*maxval(s%bodies%x(2, :))*rate/g
         unit = sum(s%bodies%mass)*g*r_m
      end associate
      steps = 0
      energy = huge(energy)
      do while (steps*s%dt < time_limit)
         call advance(s)
         s%bodies%v = s%bodies%v*(1 - rate*s%dt)
         steps = steps + 1
         if (s%trouble == sound .and. mod(steps, watch_interval) == 0) call watch_energy(s)
         if (s%trouble /= sound) then
            call fail(error, "packing exploded: "//trouble_text(s%trouble), our_fault)
            return
         end if
         if (mod(steps, watch_interval) == 0 .and. steps*s%dt*rate > 1) then
            energy = 0.5_wp*sum(s%bodies%v**2/s%bodies%inverse)
            if (energy < spent*unit) return
         end if
      end do
      if (energy < creep*unit) return  ! a body at its limit of slip creeps for ever
      call fail(error, "packing: the layer did not come to rest in time")
   end subroutine settle

   !> What there is now.
   pure subroutine describe(layer, s)
      type(layer_t), intent(inout) :: layer
      type(assembly_t), intent(in) :: s
      integer, parameter :: samples = 2000
      real(wp) :: mean
      integer :: k

      associate (b => s%bodies)
         allocate (layer%x, source=b%x)
         allocate (layer%radius, source=b%radius)
         if (layer%box%periodic) layer%x(1, :) = modulo(b%x(1, :), layer%box%width)
         layer%top = maxval(b%x(2, :) + b%radius)
         mean = 0
         do k = 1, samples
            mean = mean + surface_height(layer, layer%box%width*(k - 0.5_wp)/samples)/samples
         end do
         layer%surface = mean
         layer%solid = pi*sum(b%radius**2)/(layer%box%width*layer%surface)
         layer%floor_share = s%floor_force/(s%gravity*sum(b%mass))
      end associate
   end subroutine describe

   !> Height of the surface at x [m]: the highest point of a body there; 0 on the bare floor.
   pure real(wp) function surface_height(layer, x) result(height)
      type(layer_t), intent(in) :: layer
      real(wp), intent(in) :: x  !! [m]
      real(wp) :: dx
      integer :: k

      height = 0
      do k = 1, size(layer%radius)
         dx = x - layer%x(1, k)
         if (layer%box%periodic) dx = dx - layer%box%width*nint(dx/layer%box%width)
         if (abs(dx) >= layer%radius(k)) cycle
         height = max(height, layer%x(2, k) + sqrt(layer%radius(k)**2 - dx*dx))
      end do
   end function surface_height
end module lab_packing
