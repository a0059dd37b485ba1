! SPDX-License-Identifier: BSD-3-Clause
!> Python interface of the laboratory: plain arrays in the order of `names`, without physics.
module lab_f2py
   use iso_c_binding, only: c_double, c_int, c_int32_t, c_int64_t
   use rockfall_error, only: error_t, fail, give_error
   use rockfall_dimensions, only: max_message, max_list
   use rockfall_random, only: random_key
   use rockfall_text, only: joined
   use rockfall_threads, only: team_size
   use lab_contact, only: material_t, check_material
   use lab_neighbours, only: box_t
   use lab_clump, only: shape_names, tetrahedral_clump
   use lab_packing, only: packing_t, layer_t, check_packing, max_spheres
   use lab_impact, only: shot_t, outcome_t, status_names
   use lab_step, only: trouble_words => trouble_text
   use lab_ensemble, only: range_t, identity_t, check_range, pack_layers, fire_shots
   use lab_case, only: lab_case_t, read_lab_case, default_ratios, impact_alone
   use lab_tables, only: material_of, packing_of, shot_of, range_of, outcome_row, &
      outcome_count_row, layer_row, &
      material_row, packing_row, shot_row, range_row, &
      material_keys, packing_keys, shot_keys, range_keys, outcome_fields, outcome_counts, &
      layer_fields, throw_range_of, throw_range_row, contact_row, contact_count_row, throw_keys, contact_fields, &
      contact_counts, boulder_of, boulder_row, boulder_keys
   use lab_rock_throw, only: boulder_t, check_boulder, shape_boulder
   use lab_rock_throws, only: throw_on_rocks
   use lab_block, only: block_t, make_block
   use lab_yielding_ground, only: relief_t, make_relief, check_ground
   use lab_block_motion, only: law_of
   use lab_contact_record, only: thrown_t, cut_time_of
   use lab_throw_range, only: throw_range_t, check_throws
   use lab_throws, only: throw_blocks
   use lab_block_tables, only: ground_of, plan_row, ground_keys, plan_keys
   use lab_block_case, only: block_case_t, is_block_case, read_block_case
   implicit none
   private
   public :: names, defaults, check_case, team, trouble_text, room_for_layer, pack, impact, &
      throw, throw_at_rocks, inertia_factor, cut_time, names_ground, check_block_case

contains

   !> Names in the order of the arrays of a kind. For `status`, names are numbered from 1; `impact_alone` are the keys
   !> that do not apply to throws at rocks.
   subroutine names(kind, text)
      character(len=*), intent(in) :: kind
      character(len=max_list), intent(out) :: text

      select case (kind)
      case ("material"); text = joined(material_keys, " ")
      case ("packing"); text = joined(packing_keys, " ")
      case ("shot"); text = joined(shot_keys, " ")
      case ("range"); text = joined(range_keys, " ")
      case ("outcome"); text = joined(outcome_fields, " ")
      case ("outcome_counts"); text = joined(outcome_counts, " ")
      case ("layer"); text = joined(layer_fields, " ")
      case ("status"); text = joined(status_names, " ")
      case ("ground"); text = joined(ground_keys, " ")
      case ("throw"); text = joined(throw_keys, " ")
      case ("contact"); text = joined(contact_fields, " ")
      case ("contact_counts"); text = joined(contact_counts, " ")
      case ("plan"); text = joined(plan_keys, " ")
      case ("boulder"); text = joined(boulder_keys, " ")
      case ("impact_alone"); text = joined(impact_alone, " ")
      case ("shape"); text = joined(shape_names, " ")
      case default; text = ""
      end select
   end subroutine names

   !> Defaults in the order of `names(kind)`. For a `case`: seed, five ratios, layers, points, impacts. For a
   !> `block_case`: seed, throws, contacts. For `throws` at rocks: throws, throws per layer, contacts, maximum depth of
   !> a layer.
   subroutine defaults(kind, row)
      character(len=*), intent(in) :: kind
      real(c_double), intent(out) :: row(16)
      type(material_t) :: material
      type(packing_t) :: packing
      type(shot_t) :: shot
      type(range_t) :: range
      type(lab_case_t) :: case
      type(throw_range_t) :: range_of_throws
      type(boulder_t) :: boulder
      type(block_case_t) :: block_case

      row = 0
      select case (kind)
      case ("material"); row(:size(material_keys)) = material_row(material)
      case ("packing"); row(:size(packing_keys)) = packing_row(packing)
      case ("shot"); row(:size(shot_keys)) = shot_row(shot)
      case ("range"); row(:size(range_keys)) = range_row(range)
      case ("case")
         row(:9) = real([case%seed, int(default_ratios, c_int64_t), case%layers, case%points, &
                         case%impacts], c_double)
      case ("throw"); row(:size(throw_keys)) = throw_range_row(range_of_throws)
      case ("plan"); row(:size(plan_keys)) = plan_row(block_case%plan)
      case ("boulder"); row(:size(boulder_keys)) = boulder_row(boulder)
      case ("throws"); row(:4) = [500.0_c_double, real([case%on_layer, case%contacts], c_double), case%max_depth]
      case ("block_case"); row(:3) = real([block_case%seed, block_case%throws, block_case%contacts], c_double)
      end select
   end subroutine defaults

   !> Check the text of a laboratory case.
   subroutine check_case(text, name, code, message)
      character(len=*), intent(in) :: text, name
      integer(c_int), intent(out) :: code
      character(len=max_message), intent(out) :: message
      type(lab_case_t) :: case
      type(error_t), allocatable :: error

      call read_lab_case(text, name, case, error)
      call give_error(error, code, message)
   end subroutine check_case

   !> Return 1 if the text is a block-laboratory case, else 0.
   subroutine names_ground(text, name, yes)
      character(len=*), intent(in) :: text, name
      integer(c_int), intent(out) :: yes

      yes = merge(1, 0, is_block_case(text, name))
   end subroutine names_ground

   !> Check the text of a block-laboratory case.
   subroutine check_block_case(text, name, code, message)
      character(len=*), intent(in) :: text, name
      integer(c_int), intent(out) :: code
      character(len=max_message), intent(out) :: message
      type(block_case_t) :: case
      type(error_t), allocatable :: error

      call read_block_case(text, name, case, error)
      call give_error(error, code, message)
   end subroutine check_block_case

   !> Number of threads used for a requested number.
   subroutine team(threads, size)
      integer(c_int), intent(in) :: threads
      integer(c_int), intent(out) :: size

      size = team_size(threads)
   end subroutine team

   !> Text for a trouble code of an outcome.
   subroutine trouble_text(trouble, text)
      integer(c_int), intent(in) :: trouble
      character(len=max_list), intent(out) :: text

      text = trouble_words(trouble)
   end subroutine trouble_text

   !> Maximum number of spheres in a layer.
   subroutine room_for_layer(packing, room, code, message)
      real(c_double), intent(in) :: packing(12)
      integer(c_int), intent(out) :: room, code
      character(len=max_message), intent(out) :: message
      type(error_t), allocatable :: error

      room = 0
      call check_packing(packing_of(packing), error)
      if (.not. allocated(error)) room = max_spheres(packing_of(packing))
      call give_error(error, code, message)
   end subroutine room_for_layer

   !> Pack layers `first` to `first + n - 1` of a seed.
   subroutine pack(material, packing, seed, first, threads, x, radius, bodies, facts, code, &
      message, room, n)
      !f2py threadsafe
      integer(c_int), intent(in) :: room, n           !! maximum number of bodies in a layer; number of layers
      real(c_double), intent(in) :: material(6), packing(12)
      integer(c_int64_t), intent(in) :: seed, first
      integer(c_int), intent(in) :: threads           !! number of threads; 0: all
      real(c_double), intent(out) :: x(3, room, n)    !! centres [m]
      real(c_double), intent(out) :: radius(room, n)  !! [m]
      integer(c_int32_t), intent(out) :: bodies(n)    !! number of bodies in each layer
      real(c_double), intent(out) :: facts(6, n)      !! columns as listed by names("layer")
      integer(c_int), intent(out) :: code
      character(len=max_message), intent(out) :: message
      type(layer_t), allocatable :: layers(:)
      type(error_t), allocatable :: error
      integer :: k

      x = 0
      radius = 0
      bodies = 0
      facts = 0
      allocate (layers(n))
      call check_material(material_of(material), error)
      if (.not. allocated(error)) call check_packing(packing_of(packing), error)
      if (.not. allocated(error)) then
         if (room < max_spheres(packing_of(packing))) &
            call fail(error, "pack: room is below room_for_layer")
      end if
      if (.not. allocated(error)) then
         call pack_layers(packing_of(packing), material_of(material), random_key(seed), first, &
            threads, layers, error)
      end if
      call give_error(error, code, message)
      if (code /= 0) return
      do k = 1, n
         bodies(k) = size(layers(k)%radius)
         x(:, :bodies(k), k) = layers(k)%x
         radius(:bodies(k), k) = layers(k)%radius
         facts(:, k) = layer_row(layers(k))
      end do
   end subroutine pack

   !> Fire impacts at layers: shot k is impact number(k) at point(k) of layer(k), whose data are element place(k) of the
   !> arrays.
   subroutine impact(material, packing, shot, ranges, seed, threads, x, radius, bodies, facts, &
                     place, layer, point, number, outcome, counts, code, message, room, nl, n)
      !f2py threadsafe
      integer(c_int), intent(in) :: room, nl, n
      real(c_double), intent(in) :: material(6), packing(12), ranges(9)
      real(c_double), intent(in) :: shot(16)           !! template; speed, angle, spin and aim are drawn
      integer(c_int64_t), intent(in) :: seed
      integer(c_int), intent(in) :: threads            !! number of threads; 0: all
      real(c_double), intent(in) :: x(3, room, nl), radius(room, nl), facts(6, nl)  !! as returned by `pack`
      integer(c_int32_t), intent(in) :: bodies(nl)
      integer(c_int32_t), intent(in) :: place(n)
      integer(c_int64_t), intent(in) :: layer(n), point(n), number(n)
      real(c_double), intent(out) :: outcome(26, n)    !! columns as listed by names("outcome")
      integer(c_int32_t), intent(out) :: counts(4, n)  !! columns as listed by names("outcome_counts")
      integer(c_int), intent(out) :: code
      character(len=max_message), intent(out) :: message
      type(layer_t), allocatable :: layers(:)
      type(identity_t), allocatable :: ids(:)
      type(shot_t), allocatable :: shots(:)
      type(outcome_t), allocatable :: outcomes(:)
      type(error_t), allocatable :: error
      integer :: k

      outcome = 0
      counts = 0
      call check_material(material_of(material), error)
      if (.not. allocated(error)) call check_packing(packing_of(packing), error)
      if (.not. allocated(error)) call check_range(shot_of(shot), range_of(ranges), error)
      if (.not. allocated(error)) &
         call check_places(room, bodies, place, layer, point, number, error)
      call give_error(error, code, message)
      if (code /= 0) return
      allocate (layers(nl), ids(n), shots(n), outcomes(n))
      do k = 1, nl
         layers(k) = layer_of(packing, x(:, :bodies(k), k), radius(:bodies(k), k), facts(:, k))
      end do
      do k = 1, n
         ids(k) = identity_t(place(k), layer(k), point(k), number(k))
      end do
      call fire_shots(layers, packing_of(packing), material_of(material), shot_of(shot), &
                      range_of(ranges), random_key(seed), ids, threads, shots, outcomes)
      do k = 1, n
         outcome(:, k) = outcome_row(shots(k), outcomes(k))
         counts(:, k) = outcome_count_row(outcomes(k))
      end do
   end subroutine impact

   !> Compute throws `first` to `first + n - 1` of a seed, each with its first contacts. Vertices and facets of all
   !> blocks are concatenated: block k has vertices(k) vertices and facets(k) facets.
   subroutine throw(ground, ranges, radius, density, x, corner, vertices, facets, heights, width, step, seed, first, &
                    threads, contacts, rows, counts, n_contacts, complete, inertia, code, message, &
                    nv, nf, nb, nc, np, n)
      !f2py threadsafe
      integer(c_int), intent(in) :: contacts, nv, nf, nb, nc, np, n
      real(c_double), intent(in) :: ground(5), ranges(12)         !! ordered as names("ground"), names("throw")
      real(c_double), intent(in) :: radius, density               !! R_b [m], [kg/m3]
      real(c_double), intent(in) :: x(3, nv)                      !! in any unit of length
      integer(c_int32_t), intent(in) :: corner(3, nf)             !! vertex indices, from 1 for each block
      integer(c_int32_t), intent(in) :: vertices(nb), facets(nb)
      real(c_double), intent(in) :: heights(nc, nc, np), width    !! heights and width of patches [m]
      real(c_double), intent(in) :: step                          !! time step relative to the default
      integer(c_int64_t), intent(in) :: seed, first
      integer(c_int), intent(in) :: threads                       !! number of threads; 0: all
      real(c_double), intent(out) :: rows(16, contacts, n)        !! columns as listed by names("contact")
      integer(c_int32_t), intent(out) :: counts(3, contacts, n)   !! columns as listed by names("contact_counts")
      integer(c_int32_t), intent(out) :: n_contacts(n), complete(n)  !! number of contacts; 1, 0: time limit reached
      real(c_double), intent(out) :: inertia(nb)                  !! mean principal moment/(m R_b**2)
      integer(c_int), intent(out) :: code
      character(len=max_message), intent(out) :: message
      type(block_t), allocatable :: blocks(:)
      type(relief_t), allocatable :: reliefs(:)
      type(thrown_t), allocatable :: thrown(:)
      type(error_t), allocatable :: error
      integer :: k, j, iv, jf

      rows = 0
      counts = 0
      n_contacts = 0
      complete = 0
      inertia = 0
      allocate (blocks(nb), reliefs(np), thrown(n))
      call check_ground(ground_of(ground), error)
      if (.not. allocated(error)) call check_throws(throw_range_of(ranges), contacts, error)
      if (.not. allocated(error) .and. .not. (radius > 0 .and. density > 0 .and. step > 0)) &
         call fail(error, "throw: radius, density and step must be > 0")
      if (.not. allocated(error) .and. (sum(vertices) /= nv .or. sum(facets) /= nf .or. nb < 1 .or. np < 1)) &
         call fail(error, "throw: vertices and facets must be those of the blocks")
      iv = 0
      jf = 0
      do k = 1, nb
         if (allocated(error)) exit
         call make_block(x(:, iv + 1:iv + vertices(k)), corner(:, jf + 1:jf + facets(k)), radius, density, &
                         blocks(k), error)
         iv = iv + vertices(k)
         jf = jf + facets(k)
         inertia(k) = sum(blocks(k)%inertia)/(3*blocks(k)%mass*radius**2)
      end do
      do k = 1, np
         if (allocated(error)) exit
         call make_relief(heights(:, :, k), width, reliefs(k), error)
      end do
      call give_error(error, code, message)
      if (code /= 0) return
      call throw_blocks(blocks, law_of(ground_of(ground), radius, density), reliefs, throw_range_of(ranges), contacts, &
                        step, random_key(seed), first, threads, thrown)
      do k = 1, n
         n_contacts(k) = thrown(k)%n
         complete(k) = merge(1, 0, thrown(k)%complete)
         do j = 1, thrown(k)%n
            rows(:, j, k) = contact_row(thrown(k), j, radius, 2*ground(1)/density)
            counts(:, j, k) = contact_count_row(thrown(k), j)
         end do
      end do
   end subroutine throw

   !> Throw boulders at layers of rocks: throw number(k) hits layer(k), whose data are element place(k) of the arrays.
   subroutine throw_at_rocks(material, packing, boulder, ranges, seed, threads, x, radius, bodies, facts, place, &
                             layer, number, contacts, rows, counts, n_contacts, complete, code, message, room, nl, n)
      !f2py threadsafe
      integer(c_int), intent(in) :: room, nl, n, contacts         !! contacts: maximum number per throw
      real(c_double), intent(in) :: material(6), packing(12), boulder(7), ranges(12)
      integer(c_int64_t), intent(in) :: seed
      integer(c_int), intent(in) :: threads                       !! number of threads; 0: all
      real(c_double), intent(in) :: x(3, room, nl), radius(room, nl), facts(6, nl)  !! as returned by `pack`
      integer(c_int32_t), intent(in) :: bodies(nl)
      integer(c_int32_t), intent(in) :: place(n), layer(n)
      integer(c_int64_t), intent(in) :: number(n)
      real(c_double), intent(out) :: rows(16, contacts, n)        !! columns as listed by names("contact")
      integer(c_int32_t), intent(out) :: counts(3, contacts, n)   !! columns as listed by names("contact_counts")
      integer(c_int32_t), intent(out) :: n_contacts(n), complete(n)    !! number of contacts; 1, or 0 if incomplete
      integer(c_int), intent(out) :: code
      character(len=max_message), intent(out) :: message
      type(layer_t), allocatable :: layers(:)
      type(boulder_t) :: thrown_boulder
      type(thrown_t), allocatable :: thrown(:)
      type(error_t), allocatable :: error
      integer :: k, j

      rows = 0
      counts = 0
      n_contacts = 0
      complete = 0
      call check_material(material_of(material), error)
      if (.not. allocated(error)) call check_packing(packing_of(packing), error)
      if (.not. allocated(error)) call check_boulder(boulder_of(boulder), error)
      if (.not. allocated(error)) call check_throws(throw_range_of(ranges), contacts, error)
      if (.not. allocated(error)) &
         call check_places(room, bodies, place, int(layer, c_int64_t), number, number, error)
      call give_error(error, code, message)
      if (code /= 0) return
      allocate (layers(nl), thrown(n))
      thrown_boulder = boulder_of(boulder)
      call shape_boulder(thrown_boulder)
      do k = 1, nl
         layers(k) = layer_of(packing, x(:, :bodies(k), k), radius(:bodies(k), k), facts(:, k))
      end do
      call throw_on_rocks(layers, packing_of(packing), material_of(material), thrown_boulder, &
                          throw_range_of(ranges), contacts, random_key(seed), place, layer, number, threads, thrown)
      do k = 1, n
         n_contacts(k) = thrown(k)%n
         complete(k) = merge(1, 0, thrown(k)%complete)
         do j = 1, thrown(k)%n
            rows(:, j, k) = contact_row(thrown(k), j, boulder(1), huge(1.0_c_double))
            counts(:, j, k) = contact_count_row(thrown(k), j)
         end do
      end do
   end subroutine throw_at_rocks

   !> Mean principal moment of inertia, over m R_b**2 [-], of a boulder thrown at rocks.
   subroutine inertia_factor(boulder, factor)
      real(c_double), intent(in) :: boulder(7)
      real(c_double), intent(out) :: factor
      type(boulder_t) :: thrown

      thrown = boulder_of(boulder)
      call shape_boulder(thrown)
      factor = 0.4_c_double
      if (allocated(thrown%shape)) factor = sum(thrown%shape%inertia)/3
   end subroutine inertia_factor

   !> Time after which a contact is cut into records [s].
   subroutine cut_time(radius, gravity, time)
      real(c_double), intent(in) :: radius, gravity  !! [m], [m/s2]
      real(c_double), intent(out) :: time  !! [s]

      time = cut_time_of(radius, gravity)
   end subroutine cut_time

   pure type(layer_t) function layer_of(packing, x, radius, facts) result(layer)
      real(c_double), intent(in) :: packing(12), x(:, :), radius(:), facts(6)
      type(packing_t) :: made

      allocate (layer%x, source=x)
      allocate (layer%radius, source=radius)
      layer%box = box_t(facts(5))
      layer%surface = facts(1)
      layer%top = facts(2)
      layer%solid = facts(3)
      made = packing_of(packing)
      if (made%clumps) layer%rock = tetrahedral_clump()
   end function layer_of

   !> Check for indices beyond the arrays, and for numbers that would share random words.
   pure subroutine check_places(room, bodies, place, layer, point, number, error)
      integer(c_int), intent(in) :: room
      integer(c_int32_t), intent(in) :: bodies(:), place(:)
      integer(c_int64_t), intent(in) :: layer(:), point(:), number(:)
      type(error_t), allocatable, intent(out) :: error

      if (any(bodies < 1 .or. bodies > room)) then
         call fail(error, "impact: bodies must be 1 to the room of a layer")
      else if (any(place < 1 .or. place > size(bodies))) then
         call fail(error, "impact: place must be 1 to the number of layers given")
      else if (any(layer < 0 .or. layer >= 2_c_int64_t**31)) then
         call fail(error, "impact: layer must be 0 to 2**31 - 1")
      else if (any(min(point, number) < 0 .or. max(point, number) >= 2_c_int64_t**32)) then
         call fail(error, "impact: point and number must be 0 to 2**32 - 1")
      end if
   end subroutine check_places
end module lab_f2py
