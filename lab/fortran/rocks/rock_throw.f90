! SPDX-License-Identifier: BSD-3-Clause
!> Throw of a boulder, a sphere or a clump, at a tilted layer of rocks, and the records of its first contacts.
!>
!> The layer settles under gravity along its normal, which continues to act on its rocks: gravity is tilted only for the
!> boulder. Spheres have a smaller angle of repose than rocks: under tilted gravity, a layer of spheres would flow on
!> slopes where talus is stable (lab/docs/validation.md). Rocks moved by the boulder feel its push along the slope, but
!> not their own weight along it.
!>
!> Flights are computed exactly, and are assumed to end on untouched ground: each flight lands on the layer as it
!> settled. Within a contact, however long, displaced rocks stay displaced.
!>
!> Ground with a relief consists of facets, each a tilted patch of the layer. After every flight, and after every record
!> that ends rolling, the boulder is on another facet.
module lab_rock_throw
   use rockfall_kinds, only: wp, i8
   use rockfall_error, only: error_t, fail
   use rockfall_math, only: tangent
   use rockfall_text, only: joined
   use rockfall_random, only: random_key_t, random_words, uniform, normal_quantile, words_per_block
   use lab_contact, only: material_t, cross
   use lab_clump, only: clump_t, clump_shape_t, make_clump, set_motion, turn_in_flight, block_clump, shape_names, &
      sphere_shape
   use lab_rotation, only: product_of, conjugate
   use lab_bodies, only: bodies_t, set_clumps, in_clump, body_energy, body_mass, body_position, body_velocity, &
      is_touched
   use lab_packing, only: packing_t, layer_t, skin_factor, rocks_at_rest, stiffen_layer
   use lab_step, only: assembly_t, assemble, set_tilt, set_absorbing_base, advance, shorten_step, lengthen_step, &
      watch_energy, safe_step, sound, leapt, too_soft, step_too_long, energy_grew
   use lab_impact, only: will_meet, fits
   use lab_contact_record, only: throw_t, contact_t, instant_t, record, fall_line_gravity, thrown_velocity, &
      from_flight, from_rolling, flies, rolls_on, stops, cut, hop_time, hop_height, rest_energy, max_time
   implicit none
   private
   public :: boulder_t, check_boulder, shape_boulder, follow_on_rocks, gap_to_layer, find_touch, facet_t, draw_facet, &
      into_facet, out_of_facet

   !> Thrown boulder, and parameters of its simulation.
   type :: boulder_t
      real(wp) :: radius = 0.4_wp       !! R_b [m]
      real(wp) :: density = 2650        !! [kg/m3]
      real(wp) :: relief = 0            !! standard deviation of the facets' slope along a line [degrees]
      real(wp) :: step_factor = 1.4_wp  !! step relative to `safe_step`
      integer :: retries = 3            !! maximum number of halvings of a step that is too long
      integer :: kind = sphere_shape    !! shape, an index in `shape_names`; R_b is that of the sphere of equal volume
      logical :: adaptive = .false.    !! step and stiffness adapt, see `follow_on_rocks`
      type(clump_shape_t), allocatable :: shape  !! as set by `shape_boulder`; absent for a sphere
   end type boulder_t

   !> Facet of the mean surface: its rotation about a line in that surface.
   type :: facet_t
      real(wp) :: axis(3) = 0  !! axis times the sine of the rotation angle [-]
      real(wp) :: cosine = 1   !! cosine of the rotation angle [-]
   end type facet_t

   !> Motion of the boulder in the frame of the mean surface: x(3) above it.
   type :: motion_t
      real(wp) :: x(3) = 0, v(6) = 0  !! position [m]; velocity [m/s] and spin [rad/s]
      real(wp) :: time = 0            !! [s]
      real(wp) :: q(4) = [1, 0, 0, 0] !! orientation, a unit quaternion
   end type motion_t

   !> Current state of a throw.
   type :: course_t
      type(assembly_t) :: s
      type(motion_t) :: m
      type(facet_t) :: facet
      type(instant_t) :: first, last    !! first and last instant of the current contact so far
      integer :: entry = from_flight
      logical :: landed = .false.       !! the boulder touched the layer since it was placed
      real(wp) :: slow_since = 0        !! time since which the boulder has been slow [s]
      real(wp) :: wait = 0              !! time until which the boulder cannot leave the layer [s]
      integer :: steps = 0              !! number of steps since the boulder was placed on its facet
      integer(i8) :: landings = 0
   end type course_t

   integer(i8), parameter :: for_facet = 71         !! purpose of the random numbers
   real(wp), parameter :: steepest = 2.5_wp  !! maximum slope of a facet along a line, over the standard deviation [-]
   integer, parameter :: max_facets = 1000          !! maximum number of draws to find a facet that faces the boulder
   real(wp), parameter :: opening_gap = 1.0e-7_wp   !! gap between boulder and layer at the contact, over R_b [-]
   real(wp), parameter :: inside_step = 0.05_wp  !! step when leaving a volume that the layer had filled, over R_b [-]
   integer, parameter :: max_looks = 20000          !! maximum number of gap evaluations up to a contact
   real(wp), parameter :: retry_time = 0.1_wp       !! time between attempts to find another facet, over sqrt(R_b/g) [-]
   real(wp), parameter :: stiffening = 4            !! factor on the stiffness of rocks that are too soft [-]
   integer, parameter :: max_stiffenings = 4        !! maximum number of stiffenings per throw
   integer, parameter :: watch_interval = 32        !! steps between checks of the energy and of the exit path

contains

   !> Check the parameters of a boulder.
   pure subroutine check_boulder(boulder, error)
      type(boulder_t), intent(in) :: boulder
      type(error_t), allocatable, intent(out) :: error

      if (.not. (boulder%radius >= 0.01_wp .and. boulder%radius <= 10)) then
         call fail(error, "throw: radius must be 0.01 to 10 m")
      else if (.not. (boulder%density >= 100 .and. boulder%density <= 10000)) then
         call fail(error, "impact: density must be 100 to 10000 kg/m3 where boulders are thrown")
      else if (.not. (boulder%relief >= 0 .and. boulder%relief <= 30)) then
         call fail(error, "throw: relief must be 0 (none) to 30 degrees")
      else if (boulder%kind < 1 .or. boulder%kind > size(shape_names)) then
         call fail(error, "throw: shape must be one of "//joined(shape_names, ", "))
      end if
   end subroutine check_boulder

   !> Set the spheres of a boulder according to its shape.
   pure subroutine shape_boulder(boulder)
      type(boulder_t), intent(inout) :: boulder

      if (boulder%kind /= sphere_shape) boulder%shape = block_clump(boulder%kind)
   end subroutine shape_boulder

   !> Compute the first contacts of a throw, up to the size of `contacts`. `complete` is false if the time limit was
   !> reached; and, without contacts, if the boulder does not fit or no step was stable. A pure function.
   !>
   !> If the step of a throw is too long, the throw is repeated with half the step. In an adaptive throw, the step is
   !> shortened at once, and lengthened when all contacts permit it; and if two bodies overlap by more than a radius,
   !> beyond the validity of Hertz's law, the throw is repeated with rocks four times as stiff. In collisions, where
   !> gravity is negligible, the overlap over the radius is proportional to (rho v**2/E)**(2/5), so it decreases to 0.57
   !> of its value.
   pure subroutine follow_on_rocks(layer, packing, material, boulder, throw, key, number, contacts, n, complete)
      type(layer_t), intent(in) :: layer
      type(packing_t), intent(in) :: packing
      type(material_t), intent(in) :: material
      type(boulder_t), intent(in) :: boulder
      type(throw_t), intent(in) :: throw
      type(random_key_t), intent(in) :: key  !! random key for the facets, together with the number
      integer(i8), intent(in) :: number
      type(contact_t), intent(out) :: contacts(:)
      integer, intent(out) :: n              !! number of contacts
      logical, intent(out) :: complete
      type(layer_t) :: stiff_layer
      type(material_t) :: stiff
      type(error_t), allocatable :: error
      integer :: k, trouble

      complete = .false.
      n = 0
      if (.not. fits(layer, packing, extent(boulder))) return
      call follow_by_any_step(layer, packing, material, boulder, throw, key, number, contacts, n, complete, trouble)
      if (.not. boulder%adaptive) return
      do k = 1, max_stiffenings
         if (trouble /= too_soft) return
         stiff = material
         stiff%young = stiffening**k*material%young
         stiff_layer = layer
         call stiffen_layer(packing, material, stiff%young, stiff_layer, error)
         if (allocated(error)) return
         call follow_by_any_step(stiff_layer, packing, stiff, boulder, throw, key, number, contacts, n, complete, &
                                 trouble)
      end do
   end subroutine follow_on_rocks

   !> Follow a throw with shorter and shorter steps.
   pure subroutine follow_by_any_step(layer, packing, material, boulder, throw, key, number, contacts, n, complete, &
                                      trouble)
      type(layer_t), intent(in) :: layer
      type(packing_t), intent(in) :: packing
      type(material_t), intent(in) :: material
      type(boulder_t), intent(in) :: boulder
      type(throw_t), intent(in) :: throw
      type(random_key_t), intent(in) :: key
      integer(i8), intent(in) :: number
      type(contact_t), intent(out) :: contacts(:)
      integer, intent(out) :: n, trouble
      logical, intent(out) :: complete
      integer :: k

      trouble = sound
      do k = 0, boulder%retries
         call follow(layer, packing, material, boulder, throw, key, number, 0.5_wp**k, contacts, n, complete, trouble)
         if (.not. any(trouble == [step_too_long, leapt, energy_grew])) exit
      end do
      if (trouble == sound) return
      n = 0
      complete = .false.
   end subroutine follow_by_any_step

   !> Follow a throw with a given step; any trouble ends it.
   pure subroutine follow(layer, packing, material, boulder, thrown, key, number, factor, contacts, n, complete, &
                          trouble)
      type(layer_t), intent(in) :: layer
      type(packing_t), intent(in) :: packing
      type(material_t), intent(in) :: material
      type(boulder_t), intent(in) :: boulder
      type(throw_t), intent(in) :: thrown
      type(random_key_t), intent(in) :: key
      integer(i8), intent(in) :: number
      real(wp), intent(in) :: factor         !! factor on the step [-]
      type(contact_t), intent(out) :: contacts(:)
      integer, intent(out) :: n, trouble
      logical, intent(out) :: complete
      type(course_t) :: c
      type(throw_t) :: throw
      real(wp) :: gravity(3), unit, flight_time
      logical :: rests, cut_now, leaves, on_facet

      throw = thrown
      unit = sqrt(boulder%radius/throw%gravity)
      gravity = fall_line_gravity(throw)
      c%m = motion_t([throw%place, 0.0_wp], thrown_velocity(throw, boulder%radius), q=throw%orientation)
      n = 0
      call land(c, .true.)
      throw%place = c%m%x(1:2)
      complete = .true.
      trouble = sound
      do while (n < size(contacts))
         if (.not. c%landed) call await_touch(c)
         call step_on(c%s, c%facet, c%m)
         c%steps = c%steps + 1
         if (mod(c%steps, watch_interval) == 0) call watch_energy(c%s)
         if (boulder%adaptive) call adapt_step(c)
         trouble = c%s%trouble
         if (trouble /= sound) return
         if (touches(c%s)) then
            c%last = instant_of(c%s, c%m)
            if (c%last%energy > rest_energy*body_mass(c%s%bodies, c%s%bodies%n)*throw%gravity*boulder%radius) &
               c%slow_since = c%m%time
            rests = c%m%time - c%slow_since > cut*unit
            cut_now = c%m%time - c%first%time > cut*unit
            if (rests .or. cut_now) then
               n = n + 1
               contacts(n) = record(boulder%radius, throw, c%entry, merge(stops, rolls_on, rests), c%first, c%last)
               if (rests) return
               c%entry = from_rolling
               c%first = c%last
               if (boulder%relief > 0) then
                  call continue_on_facet(c, on_facet)
                  if (on_facet) c%first%x = c%m%x
               end if
               cycle
            end if
         end if
         if (mod(c%steps, watch_interval) == 0 .and. c%m%time > c%wait) then
            if (.not. is_free(layer, boulder, c%s)) cycle
            call look_ahead(layer, boulder, gravity, c%m, c%last%time, unit, leaves, flight_time)
            if (leaves) then
               n = n + 1
               contacts(n) = record(boulder%radius, throw, c%entry, flies, c%first, c%last)
               if (n == size(contacts)) exit
               call fly(boulder, gravity, flight_time, c%m)
               call land(c, boulder%relief > 0)
            else if (boulder%relief > 0) then
               call continue_on_facet(c, on_facet)
               if (.not. on_facet) c%wait = c%m%time + retry_time*unit
            else
               c%wait = c%m%time + flight_time
            end if
         end if
         if (c%m%time > max_time*unit) exit
      end do
      complete = n == size(contacts)

   contains

      !> Begin a contact: on a facet that the path hits, or at the end of the flight.
      pure subroutine land(c, on_straight_path)
         type(course_t), intent(inout) :: c
         logical, intent(in) :: on_straight_path
         logical :: faces

         c%facet = facet_t()
         if (boulder%relief > 0) &
            call draw_facet(boulder%relief, key, number, c%landings, c%m%v(1:3), c%facet, faces)
         call begin(c, on_straight_path)
         c%first = instant_of(c%s, c%m)
         c%last = c%first
         c%slow_since = c%m%time
         c%entry = from_flight
      end subroutine land

      !> Continue the contact on another facet, if one faces the boulder.
      pure subroutine continue_on_facet(c, on_facet)
         type(course_t), intent(inout) :: c
         logical, intent(out) :: on_facet
         type(facet_t) :: other

         call draw_facet(boulder%relief, key, number, c%landings, c%m%v(1:3), other, on_facet)
         if (.not. on_facet) return
         c%facet = other
         call begin(c, .true.)
      end subroutine continue_on_facet

      pure subroutine begin(c, on_straight_path)
         type(course_t), intent(inout) :: c
         logical, intent(in) :: on_straight_path

         c%landings = c%landings + 1
         call load(layer, packing, material, boulder, throw, gravity, c%facet, factor, on_straight_path, c%m, c%s)
         c%steps = 0
         c%wait = 0
         c%landed = .not. allocated(boulder%shape)
      end subroutine begin

      pure subroutine adapt_step(c)
         type(course_t), intent(inout) :: c

         call shorten_step(c%s)
         if (c%s%trouble == sound .and. mod(c%steps, watch_interval) == 0) call lengthen_step(c%s)
      end subroutine adapt_step

      !> Extend the flight of a clump until it touches the layer; so far, only the sphere around it does.
      pure subroutine await_touch(c)
         type(course_t), intent(inout) :: c

         c%landed = touches(c%s)
         if (c%landed .or. c%entry /= from_flight) return
         c%first = instant_of(c%s, c%m)
         c%last = c%first
         c%slow_since = c%m%time
      end subroutine await_touch
   end subroutine follow

   !> Return whether a boulder that moves away from the layer has left it: nothing touches it or lies in its path, or it
   !> is above the settled surface, among rocks that fly along with it.
   pure logical function is_free(layer, boulder, s)
      type(layer_t), intent(in) :: layer
      type(boulder_t), intent(in) :: boulder
      type(assembly_t), intent(in) :: s
      real(wp) :: v(6)

      associate (b => s%bodies)
         is_free = .false.
         v = body_velocity(b, b%n)
         if (.not. v(3) > 0) return
         if (.not. touches(s)) is_free = .not. will_meet(s)
         if (.not. is_free) is_free = gap_to_layer(layer, extent(boulder), body_position(b, b%n)) &
            > hop_height*boulder%radius
      end associate
   end function is_free

   !> Return whether the boulder touches any body.
   pure logical function touches(s)
      type(assembly_t), intent(in) :: s

      touches = is_touched(s%bodies, s%bodies%n)
   end function touches

   !> Radius of the sphere around a boulder [m].
   pure real(wp) function extent(boulder)
      type(boulder_t), intent(in) :: boulder

      extent = boulder%radius
      if (allocated(boulder%shape)) extent = boulder%radius*boulder%shape%reach
   end function extent

   !> Clump of a boulder in the frame of a facet.
   pure type(clump_t) function clump_on_facet(boulder, facet, m, first, x, v) result(clump)
      type(boulder_t), intent(in) :: boulder
      type(facet_t), intent(in) :: facet
      type(motion_t), intent(in) :: m
      integer, intent(in) :: first        !! index of the clump's first sphere
      real(wp), intent(in) :: x(3), v(6)  !! in the frame of the facet [m], [m/s] and [rad/s]

      clump = make_clump(boulder%shape, boulder%radius, boulder%density, first, x, &
                         product_of(quaternion_into(facet), m%q))
      call set_motion(clump, v)
   end function clump_on_facet

   !> Assemble layer and boulder for time stepping. On a straight path the boulder is placed where it first touches the
   !> layer on the way to the mean surface; otherwise its position is already that of the contact.
   pure subroutine load(layer, packing, material, boulder, throw, gravity, facet, factor, on_straight_path, m, s)
      type(layer_t), intent(in) :: layer
      type(packing_t), intent(in) :: packing
      type(material_t), intent(in) :: material
      type(boulder_t), intent(in) :: boulder
      type(throw_t), intent(in) :: throw
      real(wp), intent(in) :: gravity(3)  !! [m/s2]
      type(facet_t), intent(in) :: facet
      real(wp), intent(in) :: factor      !! factor on the step [-]
      logical, intent(in) :: on_straight_path
      type(motion_t), intent(inout) :: m
      type(assembly_t), intent(out) :: s
      type(bodies_t) :: b
      real(wp) :: v(6), start(3), time, dt, highest
      integer :: n

      v(1:3) = into_facet(facet, m%v(1:3))
      v(4:6) = into_facet(facet, m%v(4:6))
      start = m%x
      if (on_straight_path) then
         ! back along the path from the mean surface to a point above all rocks
         start(3) = layer%top - layer%surface + 2*extent(boulder)
         start(1:2) = start(1:2) + v(1:2)/v(3)*start(3)
         start(3) = start(3) + layer%surface
         call find_touch(layer, extent(boulder), start, v(1:3), [0.0_wp, 0.0_wp, 0.0_wp], time, highest)
         start = start + time*v(1:3)
         m%x(3) = start(3) - layer%surface
         if (all(facet%axis == 0)) m%x(1:2) = start(1:2)
      else
         start(3) = start(3) + layer%surface
      end if
      call assemble_bodies(layer, packing, boulder, facet, m, start, v, b, n)
      dt = factor*boulder%step_factor*safe_step(material, minval(layer%radius), packing%density, &
                                                max(sqrt(sum(v(1:3)**2)), sqrt(throw%gravity*boulder%radius)))
      call assemble(s, b, layer%box, material, throw%gravity, dt, skin_factor*packing%mean_radius, &
                    b%n - size(layer%radius), &
                    body_energy(b, n) + throw%gravity*body_mass(b, n)*(layer%top + boulder%radius))
      call set_tilt(s, into_facet(facet, gravity) + [0.0_wp, 0.0_wp, throw%gravity])
      if (.not. packing%rigid_base) call set_absorbing_base(s, packing%density*layer%solid*packing%base_speed)
   end subroutine load

   !> Bodies of the layer, then the boulder.
   pure subroutine assemble_bodies(layer, packing, boulder, facet, m, x, v, b, n)
      type(layer_t), intent(in) :: layer
      type(packing_t), intent(in) :: packing
      type(boulder_t), intent(in) :: boulder
      type(facet_t), intent(in) :: facet
      type(motion_t), intent(in) :: m
      real(wp), intent(in) :: x(3), v(6)  !! boulder, in the frame of the facet: [m], [m/s] and [rad/s]
      type(bodies_t), intent(out) :: b
      integer, intent(out) :: n           !! number of bodies
      integer :: first

      first = size(layer%radius) + 1
      if (allocated(boulder%shape)) then
         b = rocks_at_rest(layer, packing%density, spread(x, 2, size(boulder%shape%radius)), &
                           boulder%radius*boulder%shape%radius, boulder%density)
         call set_clumps(b, [clump_on_facet(boulder, facet, m, first, x, v)])
      else
         b = rocks_at_rest(layer, packing%density, reshape(x, [3, 1]), [boulder%radius], boulder%density)
         b%v(:, first) = v
      end if
      n = b%n
   end subroutine assemble_bodies

   !> Advance by one step, and update the position of the boulder, whose path is not periodic, unlike the layer.
   pure subroutine step_on(s, facet, m)
      type(assembly_t), intent(inout) :: s
      type(facet_t), intent(in) :: facet
      type(motion_t), intent(inout) :: m
      real(wp) :: before(3), displacement(3), v(6)

      before = body_position(s%bodies, s%bodies%n)
      call advance(s)
      associate (b => s%bodies)
         displacement = body_position(b, b%n) - before
         displacement(1:2) = displacement(1:2) - s%box%width*anint(displacement(1:2)/s%box%width)
         v = body_velocity(b, b%n)
         m%x = m%x + out_of_facet(facet, displacement)
         m%v(1:3) = out_of_facet(facet, v(1:3))
         m%v(4:6) = out_of_facet(facet, v(4:6))
         if (in_clump(b, b%n)) m%q = product_of(conjugate(quaternion_into(facet)), b%clump(b%owner(b%n))%q)
         m%time = m%time + s%dt
      end associate
   end subroutine step_on

   pure type(instant_t) function instant_of(s, m) result(now)
      type(assembly_t), intent(in) :: s
      type(motion_t), intent(in) :: m

      now = instant_t(m%time, m%x, m%v(1:3), m%v(4:6), body_energy(s%bodies, s%bodies%n))
   end function instant_of

   !> Determine whether a boulder without contact leaves for a flight, and the duration of the flight or of the time
   !> without contact. The heights of facets are unknown, so over facets the boulder flies if it rises. It lands when
   !> its centre descends to R_b above the mean surface, at the earliest at the top of its path.
   pure subroutine look_ahead(layer, boulder, gravity, m, last_touch, unit, leaves, time)
      type(layer_t), intent(in) :: layer
      type(boulder_t), intent(in) :: boulder
      real(wp), intent(in) :: gravity(3)        !! [m/s2]
      type(motion_t), intent(in) :: m
      real(wp), intent(in) :: last_touch, unit  !! time of last contact; sqrt(R_b/g) [s]
      logical, intent(out) :: leaves
      real(wp), intent(out) :: time             !! duration from now [s]
      real(wp) :: highest, top

      if (boulder%relief > 0) then
         highest = max(0.0_wp, m%v(3))**2/(-2*gravity(3))
         top = max(0.0_wp, m%v(3))/(-gravity(3))
         time = top + sqrt(2*max(0.0_wp, m%x(3) + highest - boulder%radius)/(-gravity(3)))
      else
         call find_touch(layer, extent(boulder), m%x + [0.0_wp, 0.0_wp, layer%surface], m%v(1:3), gravity, time, &
                         highest)
      end if
      leaves = highest > hop_height*boulder%radius .and. m%v(3) > 0 .and. m%v(3) + time*gravity(3) <= 0 &
               .and. m%time + time - last_touch > hop_time*unit
   end subroutine look_ahead

   !> Move along a parabola; a clump turns freely.
   pure subroutine fly(boulder, gravity, time, m)
      type(boulder_t), intent(in) :: boulder
      real(wp), intent(in) :: gravity(3), time  !! [m/s2], [s]
      type(motion_t), intent(inout) :: m
      type(clump_t) :: clump

      m%x = m%x + time*(m%v(1:3) + 0.5_wp*time*gravity)
      m%v(1:3) = m%v(1:3) + time*gravity
      m%time = m%time + time
      if (.not. allocated(boulder%shape)) return
      clump = clump_on_facet(boulder, facet_t(), m, 1, m%x, m%v)
      call turn_in_flight(clump, time)
      m%q = clump%q
      m%v(4:6) = clump%spin
   end subroutine fly

   !> Time of the first contact of a sphere with the settled layer on its path. A sphere that starts inside the layer,
   !> where rocks were pushed aside, first leaves it. Gap and speed limit each step, so no contact is missed.
   pure subroutine find_touch(layer, radius, x, v, gravity, time, highest)
      type(layer_t), intent(in) :: layer
      real(wp), intent(in) :: radius                      !! [m]
      real(wp), intent(in) :: x(3), v(3), gravity(3)      !! position, floor at 0 [m]; velocity [m/s]; gravity [m/s2]
      real(wp), intent(out) :: time     !! time until the contact [s]
      real(wp), intent(out) :: highest  !! maximum gap on the part of the path examined [m]
      real(wp) :: gap, here(3), now(3), speed, pull, ceiling
      integer :: look
      logical :: outside

      time = 0
      highest = 0
      outside = .false.
      pull = sqrt(sum(gravity**2))
      ceiling = layer%top + radius
      do look = 1, max_looks
         here = x + time*(v + 0.5_wp*time*gravity)
         now = v + time*gravity
         if (here(3) > ceiling + radius) then  ! above all rocks: skip directly to their top
            highest = here(3) - ceiling
            time = time + fall_time(here(3) - ceiling - 0.5_wp*radius, now(3), gravity(3))
            outside = .true.
            cycle
         end if
         gap = gap_to_layer(layer, radius, here)
         outside = outside .or. gap > opening_gap*radius
         speed = max(sqrt(sum(now**2)), tiny(speed))
         if (.not. outside) then
            time = time + inside_step*radius/speed
            cycle
         end if
         if (gap <= opening_gap*radius) return
         highest = max(highest, gap)
         gap = gap - 0.5_wp*opening_gap*radius
         time = time + 2*gap/(speed + sqrt(speed**2 + 2*pull*gap))
      end do
   end subroutine find_touch

   !> Time to descend by a height [s].
   pure real(wp) function fall_time(height, v, gravity)
      real(wp), intent(in) :: height      !! > 0 [m]
      real(wp), intent(in) :: v, gravity  !! upward velocity [m/s]; acceleration <= 0 [m/s2]; at least one is negative

      if (gravity < 0) then
         fall_time = (v + sqrt(v**2 - 2*gravity*height))/(-gravity)
      else
         fall_time = height/(-v)
      end if
   end function fall_time

   !> Distance [m] from a sphere to the floor, or to the nearest rock of the settled layer or of its periodic images;
   !> negative inside.
   pure real(wp) function gap_to_layer(layer, radius, x) result(gap)
      type(layer_t), intent(in) :: layer
      real(wp), intent(in) :: radius, x(3)  !! [m]
      real(wp) :: width, at(2), dx, dy, dz
      integer :: k

      width = layer%box%width
      at = x(1:2) - width*floor(x(1:2)/width)  ! position in the box, as for the rocks
      gap = x(3) - radius
      do k = 1, size(layer%radius)
         dz = x(3) - layer%x(3, k)
         if (dz - layer%radius(k) - radius > gap) cycle
         dx = abs(at(1) - layer%x(1, k))
         dy = abs(at(2) - layer%x(2, k))
         dx = min(dx, width - dx)
         dy = min(dy, width - dy)
         gap = min(gap, sqrt(dx*dx + dy*dy + dz*dz) - layer%radius(k) - radius)
      end do
   end function gap_to_layer

   !> Draw a facet hit by a boulder: its slopes along two lines have truncated normal distributions, and the probability
   !> of a hit is proportional to the facet's area projected along the path.
   pure subroutine draw_facet(relief, key, number, landing, v, facet, faces)
      real(wp), intent(in) :: relief            !! standard deviation of the slope along a line [degrees]
      type(random_key_t), intent(in) :: key
      integer(i8), intent(in) :: number, landing
      real(wp), intent(in) :: v(3)              !! [m/s]
      type(facet_t), intent(out) :: facet
      logical, intent(out) :: faces             !! false if no facet faces the boulder
      integer(i8) :: word(words_per_block), draw
      real(wp) :: deviation, slope(2), normal(3), shown, max_speed
      integer :: k

      deviation = tangent(relief)
      max_speed = abs(v(3)) + steepest*deviation*(abs(v(1)) + abs(v(2)))
      do draw = 1, max_facets
         word = random_words(key, for_facet, number, landing, draw)
         do k = 1, 2
            slope(k) = normal_deviate(uniform(word(k)))
         end do
         if (any(abs(slope) > steepest)) cycle
         slope = deviation*slope
         shown = v(1)*slope(1) + v(2)*slope(2) - v(3)
         faces = shown > uniform(word(3))*max_speed
         if (.not. faces) cycle
         normal = [-slope, 1.0_wp]/sqrt(1 + sum(slope**2))
         facet = facet_t([normal(2), -normal(1), 0.0_wp], normal(3))
         return
      end do
      faces = .false.
   end subroutine draw_facet

   pure real(wp) function normal_deviate(u)
      real(wp), intent(in) :: u  !! uniform in (0, 1) [-]

      normal_deviate = sign(normal_quantile(max(min(u, 1 - u), 1.0e-10_wp)), u - 0.5_wp)
   end function normal_deviate

   !> Transform a vector to the frame of a facet, whose normal is up.
   pure function into_facet(facet, v) result(turned)
      type(facet_t), intent(in) :: facet
      real(wp), intent(in) :: v(3)  !! any [unit]
      real(wp) :: turned(3)

      turned = facet%cosine*v + cross(facet%axis, v) + dot_product(facet%axis, v)/(1 + facet%cosine)*facet%axis
   end function into_facet

   !> Rotation into the frame of a facet as a quaternion.
   pure function quaternion_into(facet) result(q)
      type(facet_t), intent(in) :: facet
      real(wp) :: q(4)

      q = [1 + facet%cosine, facet%axis]
      q = q/sqrt(sum(q**2))
   end function quaternion_into

   !> Transform a vector from the frame of a facet.
   pure function out_of_facet(facet, v) result(turned)
      type(facet_t), intent(in) :: facet
      real(wp), intent(in) :: v(3)  !! any [unit]
      real(wp) :: turned(3)

      turned = into_facet(facet_t(-facet%axis, facet%cosine), v)
   end function out_of_facet
end module lab_rock_throw
