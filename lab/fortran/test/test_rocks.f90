! SPDX-License-Identifier: BSD-3-Clause
!> Boulders thrown at rocks: a drop equals a single impact, flights are exact, mirrored throws have mirrored paths,
!> contacts on flat ground lose energy, a layer under tilted gravity flows, facets have the drawn slopes, and threads do
!> not matter.
program test_lab_rocks
   use rockfall_kinds, only: wp, i8
   use rockfall_error, only: error_t
   use rockfall_math, only: degree, sine_cosine
   use rockfall_random, only: random_key
   use lab_contact, only: material_t
   use lab_bodies, only: bodies_t, bodies
   use lab_packing, only: packing_t, layer_t, pack_layer, stiffen_layer, skin_factor
   use lab_step, only: assembly_t, assemble, set_absorbing_base, advance, safe_step
   use lab_impact, only: shot_t, outcome_t, fire, rebounded
   use lab_contact_record, only: throw_t, contact_t, thrown_t, from_flight, from_rolling, flies, rolls_on, stops
   use lab_throw_range, only: throw_range_t
   use lab_rock_throw, only: boulder_t, check_boulder, follow_on_rocks, gap_to_layer, find_touch, facet_t, draw_facet, &
      into_facet, out_of_facet
   use lab_rock_throws, only: throw_on_rocks
   use check_m, only: check, check_close, finish
   implicit none

   type(layer_t) :: layer
   type(packing_t) :: packing
   type(material_t) :: stone
   type(boulder_t) :: boulder
   type(error_t), allocatable :: failure

   stone = material_t(young=2.0e8_wp, friction=0.4_wp, damping=0.1_wp, rolling=0.2_wp, boulder_rolling=0.2_wp)
   packing = packing_t(mean_radius=0.2_wp, ratio=2.0_wp, depth=2.0_wp, grading=2.0_wp, friction=0.0_wp)
   boulder = boulder_t(radius=0.4_wp, step_factor=2.0_wp)
   call pack_layer(packing, stone, random_key(1_i8), 1_i8, layer, failure)
   call check("a layer for the test", .not. allocated(failure))
   call test_drop()
   call test_course()
   call test_flight()
   call test_mirrored()
   call test_flat()
   call test_adaptive()
   call test_stiffer_layer()
   call test_touch()
   call test_facets()
   call test_flow()
   call test_threads()
   call test_refusals()
   call finish()

contains

   !> First contacts of a throw.
   subroutine thrown(throw, found, n, of, relief)
      type(throw_t), intent(in) :: throw
      type(contact_t), intent(out) :: found(:)
      integer, intent(out) :: n
      type(layer_t), intent(in), optional :: of
      real(wp), intent(in), optional :: relief
      type(boulder_t) :: what
      logical :: complete

      what = boulder
      if (present(relief)) what%relief = relief
      if (present(of)) then
         call follow_on_rocks(of, packing, stone, what, throw, random_key(3_i8), 1_i8, found, n, complete)
      else
         call follow_on_rocks(layer, packing, stone, what, throw, random_key(3_i8), 1_i8, found, n, complete)
      end if
   end subroutine thrown

   type(throw_t) function aimed(k, slope) result(throw)
      integer, intent(in) :: k
      real(wp), intent(in) :: slope

      throw = throw_t(place=layer%box%width*modulo([0.37_wp, 0.73_wp]*k, 1.0_wp), slope=slope, &
                      downhill=[cos(1.1_wp*k), sin(1.1_wp*k)], &
                      speed=2.0_wp + mod(k, 7)*1.7_wp, angle=10.0_wp + mod(11*k, 77), &
                      spin=0.1_wp*mod(k, 8))
   end function aimed

   !> On level ground, the contact of a throw equals a single impact, if the impact left the layer for good.
   subroutine test_drop()
      type(contact_t) :: found(1)
      type(throw_t) :: throw
      type(outcome_t) :: outcome
      real(wp) :: worst
      integer :: k, n, alike

      worst = 0
      alike = 0
      do k = 1, 80
         throw = aimed(k, 0.0_wp)
         throw%speed = 8
         call thrown(throw, found, n)
         call fire(layer, packing, stone, shot_t(radius=boulder%radius, density=boulder%density, speed=throw%speed, &
                   angle=throw%angle, spin=throw%spin, aim=throw%place/layer%box%width, heading=throw%downhill, &
                   step_factor=boulder%step_factor), outcome)
         if (n < 1 .or. outcome%status /= rebounded .or. found(1)%exit /= flies) cycle
         if (found(1)%duration > 0.05_wp) cycle  ! skip: it rolled before its flight, or touched again
         alike = alike + 1
         worst = max(worst, maxval(abs(found(1)%outgoing - outcome%clear%v))/throw%speed)
      end do
      call check("drops and impacts to compare", alike >= 8)
      call check("a drop on level ground is the single impact", worst < 0.05_wp)
   end subroutine test_drop

   !> Entries follow exits, and only the last contact stops.
   subroutine test_course()
      type(contact_t) :: found(8)
      integer :: k, l, n
      logical :: begins, follows, down

      begins = .true.
      follows = .true.
      down = .true.
      do k = 1, 12
         call thrown(aimed(k, 25.0_wp), found, n, relief=merge(10.0_wp, 0.0_wp, k > 6))
         begins = begins .and. n > 0
         if (n < 1) cycle
         begins = begins .and. found(1)%entry == from_flight
         do l = 1, n
            if (found(l)%exit == flies) down = down .and. found(l)%outgoing(2) > 0
            if (found(l)%entry == from_flight) down = down .and. found(l)%incoming(2) < 0
            if (l < n) follows = follows .and. found(l)%exit /= stops &
                                 .and. (found(l)%exit == rolls_on .eqv. found(l + 1)%entry == from_rolling)
         end do
      end do
      call check("a throw begins with a flight", begins)
      call check("what rolls on rolls, and what flies lands", follows)
      call check("flights begin upwards and end downwards", down)
   end subroutine test_course

   !> From the end of the first contact to the beginning of the second, only gravity acts.
   subroutine test_flight()
      type(contact_t) :: found(2)
      type(throw_t) :: throw
      real(wp) :: s, c, before, after, worst
      integer :: k, n, flights

      worst = 0
      flights = 0
      do k = 1, 30
         throw = aimed(k, 30.0_wp)
         call thrown(throw, found, n)
         if (n < 2) cycle
         if (found(1)%exit /= flies) cycle
         flights = flights + 1
         call sine_cosine(throw%slope*degree, s, c)
         associate (a => found(1), b => found(2), g => throw%gravity)
            ! add the work of gravity along the fall line, which was removed; the heading was downhill
            before = a%outgoing(1)**2 + 2*a%outgoing(1)*sqrt(1 - a%lateral**2)*g*s*a%duration &
                     + (g*s*a%duration)**2 + a%outgoing(2)**2
            before = before + 2*g*(s*(b%downhill - a%downhill - a%advance) - c*(b%height - a%height - a%rise))
            after = b%incoming(1)**2 + b%incoming(2)**2
            worst = max(worst, abs(after/before - 1))
         end associate
      end do
      call check("flights to check", flights > 5)
      call check("a flight keeps its energy", worst < 5.0e-3_wp)
   end subroutine test_flight

   subroutine test_mirrored()
      type(contact_t) :: found(2), other(2)
      type(layer_t) :: mirror
      type(throw_t) :: throw
      real(wp) :: worst
      integer :: k, n, m

      mirror = layer
      mirror%x(2, :) = layer%box%width - layer%x(2, :)
      worst = 0
      do k = 1, 6
         throw = aimed(k, 20.0_wp)
         call thrown(throw, found, n)
         throw%place(2) = layer%box%width - throw%place(2)
         throw%downhill(2) = -throw%downhill(2)
         call thrown(throw, other, m, of=mirror)
         if (n < 1 .or. m < 1) cycle
         worst = max(worst, maxval(abs(found(1)%outgoing - other(1)%outgoing)), &
                     abs(found(1)%lateral + other(1)%lateral))
      end do
      call check("a mirrored throw has a mirrored contact", worst < 1.0e-4_wp)
   end subroutine test_mirrored

   !> On level ground, only the fall during a contact can add energy.
   subroutine test_flat()
      type(contact_t) :: found(4)
      real(wp) :: most, square
      integer :: k, l, n

      most = 0
      do k = 1, 40
         call thrown(aimed(k, 0.0_wp), found, n)
         do l = 1, n
            associate (c => found(l))
               square = sum(c%incoming(1:2)**2) + 0.4_wp*c%incoming(3)**2
               most = max(most, c%energy - 2*9.81_wp*max(0.0_wp, -c%rise)/max(square, 1.0e-3_wp))
            end associate
         end do
      end do
      call check("no contact on level ground gains energy", most <= 1.0_wp)
   end subroutine test_flat

   !> A throw at rocks that are too soft fails. An adaptive throw instead equals a throw at rocks four times as stiff.
   subroutine test_adaptive()
      type(boulder_t) :: adaptive
      type(throw_t) :: throw
      type(material_t) :: soft, stiff
      type(layer_t) :: other
      type(contact_t) :: found(2), again(2)
      type(error_t), allocatable :: error
      integer :: n, m
      logical :: complete

      throw = aimed(3, 0.0_wp)
      throw%speed = 60
      throw%angle = 60
      soft = stone
      soft%young = 0.1_wp*stone%young
      call follow_on_rocks(layer, packing, soft, boulder, throw, random_key(3_i8), 1_i8, found, n, complete)
      call check("a throw at rocks that are too soft is lost", n == 0)
      adaptive = boulder
      adaptive%adaptive = .true.
      call follow_on_rocks(layer, packing, soft, adaptive, throw, random_key(3_i8), 1_i8, found, n, complete)
      call check("an adaptive one is not", n == 2 .and. complete)
      call check("and loses energy", found(1)%energy < 1)
      stiff = soft
      stiff%young = 4*soft%young
      other = layer
      call stiffen_layer(packing, soft, stiff%young, other, error)
      call follow_on_rocks(other, packing, stiff, adaptive, throw, random_key(3_i8), 1_i8, again, m, complete)
      call check("it is the throw at stiffer rocks", all(found%energy == again%energy) .and. m == n)
   end subroutine test_adaptive

   !> A layer of stiffer rocks supports its weight with smaller overlaps, at nearly the same positions.
   subroutine test_stiffer_layer()
      type(layer_t) :: other
      type(error_t), allocatable :: error

      other = layer
      call stiffen_layer(packing, stone, 4*stone%young, other, error)
      call check("a layer settles again with stiffer rocks", .not. allocated(error))
      call check_close("its floor carries its weight", other%floor_share, 1.0_wp, 2.0e-2_wp)
      call check("it springs back", other%surface > layer%surface)
      call check_close("by little", other%surface, layer%surface, 1.0e-2_wp)
   end subroutine test_stiffer_layer

   !> A path, straight or parabolic, touches nothing before its first contact with the layer.
   subroutine test_touch()
      real(wp) :: x(3), v(3), g(3), time, highest, t
      integer :: k, l
      logical :: touches, clear

      touches = .true.
      clear = .true.
      do k = 1, 40
         x = [layer%box%width*modulo([0.61_wp, 0.17_wp]*k, 1.0_wp), layer%top + 0.41_wp]
         v = [3.0_wp + mod(k, 9), 1.0_wp, -0.5_wp - mod(k, 5)]
         g = merge([1.0_wp, 0.5_wp, -8.0_wp], [0.0_wp, 0.0_wp, 0.0_wp], mod(k, 2) == 0)
         if (mod(k, 4) == 0) v(3) = -v(3)
         call find_touch(layer, boulder%radius, x, v, g, time, highest)
         touches = touches .and. abs(gap_to_layer(layer, boulder%radius, x + time*(v + 0.5_wp*time*g))) < 1.0e-6_wp
         do l = 0, 400
            t = time*l/401
            clear = clear .and. gap_to_layer(layer, boulder%radius, x + t*(v + 0.5_wp*t*g)) > 0
         end do
      end do
      call check("a path ends where it touches", touches)
      call check("and touched nothing before", clear)
   end subroutine test_touch

   subroutine test_facets()
      type(facet_t) :: facet
      real(wp) :: v(3), square, slope, facing
      integer :: k
      logical :: faces, turns

      square = 0
      facing = 0
      turns = .true.
      v = [0.3_wp, -0.4_wp, 1.2_wp]
      do k = 1, 4000
         call draw_facet(10.0_wp, random_key(5_i8), int(k, i8), 1_i8, [0.0_wp, 0.0_wp, -3.0_wp], facet, faces)
         turns = turns .and. faces .and. maxval(abs(out_of_facet(facet, into_facet(facet, v)) - v)) < 1.0e-12_wp
         slope = facet%axis(2)/facet%cosine  ! slope along x
         square = square + slope**2/4000
         call draw_facet(10.0_wp, random_key(5_i8), int(k, i8), 2_i8, [3.0_wp, 0.0_wp, -0.5_wp], facet, faces)
         turns = turns .and. sum(into_facet(facet, [3.0_wp, 0.0_wp, -0.5_wp])*[0.0_wp, 0.0_wp, 1.0_wp]) < 0
         facing = facing + facet%axis(2)/facet%cosine/4000  ! mean rise along x
      end do
      call check("a facet turns there and back", turns)
      call check_close("facets have their slope", sqrt(square), 0.95_wp*tan(10*degree), 0.04_wp)
      call check("what comes in flat meets facets that face it", facing > 0.08_wp)
   end subroutine test_facets

   !> Reason for tilting gravity only for the boulder: if gravity along the slope acts on all rocks, a layer of spheres
   !> flows on steep slopes of the laboratory. Rocks on the base are supported.
   subroutine test_flow()
      call check("a layer as it settled stays", creep(0.0_wp) < 0.01_wp)
      call check("and flows where its weight is tilted", creep(45.0_wp) > 0.3_wp)
   end subroutine test_flow

   !> Mean speed of the rocks along the slope after 2 s [m/s].
   real(wp) function creep(slope)
      real(wp), intent(in) :: slope
      type(assembly_t) :: s
      type(bodies_t) :: b
      real(wp) :: dt, si, co
      integer :: k, n

      n = size(layer%radius)
      b = bodies(layer%x, layer%radius, spread(packing%density, 1, n))
      dt = safe_step(stone, minval(layer%radius), packing%density, 2.0_wp)
      call assemble(s, b, layer%box, stone, 9.81_wp, dt, skin_factor*packing%mean_radius, 0, 1.0e9_wp)
      call set_absorbing_base(s, packing%density*layer%solid*packing%base_speed)
      call sine_cosine(slope*degree, si, co)
      do k = 1, int(2/dt)
         call advance(s)
         where (.not. s%on_base) s%bodies%v(1, :) = s%bodies%v(1, :) + dt*9.81_wp*si
         where (.not. s%on_base) s%bodies%v(3, :) = s%bodies%v(3, :) + dt*9.81_wp*(1 - co)
      end do
      creep = sum(abs(s%bodies%v(1, :)))/n
   end function creep

   !> Throws are equal on one and on two threads, in another order, and in smaller parts.
   subroutine test_threads()
      type(thrown_t) :: one(6), two(6), part(2)
      integer(i8) :: number(6)
      integer :: k
      logical :: same

      number = [(int(k, i8), k=1, 6)]
      call throw_on_rocks([layer], packing, stone, boulder, throw_range_t(), 3, random_key(7_i8), [1, 1, 1, 1, 1, 1], &
                          [1, 1, 1, 1, 1, 1], number, 1, one)
      call throw_on_rocks([layer], packing, stone, boulder, throw_range_t(), 3, random_key(7_i8), [1, 1, 1, 1, 1, 1], &
                          [1, 1, 1, 1, 1, 1], number(6:1:-1), 2, two)
      call throw_on_rocks([layer], packing, stone, boulder, throw_range_t(), 3, random_key(7_i8), [1, 1], [1, 1], &
                          number(4:5), 2, part)
      same = .true.
      do k = 1, 6
         same = same .and. alike(one(k), two(7 - k))
      end do
      same = same .and. alike(one(4), part(1)) .and. alike(one(5), part(2))
      call check("threads, order and parts change no bit", same)
   end subroutine test_threads

   logical function alike(a, b)
      type(thrown_t), intent(in) :: a, b
      integer :: k

      alike = a%n == b%n .and. a%n > 0
      do k = 1, min(a%n, b%n)
         alike = alike .and. all(a%contacts(k)%outgoing == b%contacts(k)%outgoing) &
                 .and. a%contacts(k)%duration == b%contacts(k)%duration &
                 .and. a%contacts(k)%downhill == b%contacts(k)%downhill
      end do
   end function alike

   subroutine test_refusals()
      type(error_t), allocatable :: error
      type(contact_t) :: found(1)
      logical :: complete
      integer :: n

      call check_boulder(boulder_t(radius=0.0_wp), error)
      call check("no boulder of no size", allocated(error))
      call check_boulder(boulder_t(relief=60.0_wp), error)
      call check("no facets that overhang", allocated(error))
      call check_boulder(boulder_t(), error)
      call check("the boulder that is thrown unless told", .not. allocated(error))
      call follow_on_rocks(layer, packing, stone, boulder_t(radius=5.0_wp), throw_t(), random_key(1_i8), 1_i8, &
                           found, n, complete)
      call check("a boulder wider than its layer has no contacts", n == 0 .and. .not. complete)
   end subroutine test_refusals
end program test_lab_rocks
