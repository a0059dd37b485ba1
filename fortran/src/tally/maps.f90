! SPDX-License-Identifier: BSD-3-Clause
!> Maps: what boulders did in each raster cell, as counts, sums of integers, and maxima, so that no order
!> of boulders changes a bit. A boulder counts once a cell: it gathers its own visits first.
module rockfall_map
   use rockfall_kinds, only: wp, sp, i4, i8
   use rockfall_terrain, only: terrain_t
   use rockfall_flight, only: span_t, never
   use rockfall_classes, only: energy, speed, jump_height, class_of
   implicit none
   private
   public :: maps_t, layer_t, per_unit, visits_t, follows_cells, start_visits, visit_spans, visit_cell, add_visits, add_deposit, &
             lacks_columns

   real(wp), parameter :: per_unit(3) = [1.0_wp, 1000.0_wp, 1000.0_wp]  !! sums are of whole J, mm/s, mm

   !> What is kept of one quantity: energy (translational and rotational) [J], speed [m/s] or jump height
   !> [m], of each boulder the greatest in the cell.
   type :: layer_t
      integer(i8), pointer, contiguous :: sum(:, :) => null()  !! [J], [mm/s], [mm]
      real(sp), pointer, contiguous :: greatest(:, :) => null()
      integer :: classes = -1  !! its counts stand after this row of `class_counts`; -1: not counted
   end type layer_t

   !> The maps a run asks for; the others are not associated. All (nx, ny), row 1 the northernmost.
   type :: maps_t
      integer(i4), pointer, contiguous :: passages(:, :) => null()    !! boulders that passed
      integer(i4), pointer, contiguous :: deposits(:, :) => null()    !! boulders that ended there at rest
      integer(i4), pointer, contiguous :: sources(:, :) => null()     !! that feed the cell: a boulder passed
      integer(i4), pointer, contiguous :: released(:, :) => null()    !! boulders of these sources
      !> The last source that was counted here boulder by boulder (nx, ny, layers); see rockfall_sourcemap.
      integer(i4), pointer, contiguous :: stamp(:, :, :) => null()
      integer(i8) :: head = 0  !! a source that has the second layer to itself
      type(layer_t) :: layer(3)
      !> Counts of classes (classes, columns): a cell gets a column, and with it memory, when the first
      !> boulder passes it. Which one depends on the order of boulders, what stands in it does not.
      integer(i4), pointer, contiguous :: class_counts(:, :) => null()
      integer(i4), pointer, contiguous :: column(:, :) => null()      !! of each cell; 0: none yet
      integer(i4), pointer :: columns => null()  !! given away; one more than there are when they did not do
   end type maps_t

   !> One boulder's greatest values in one cell.
   type :: visit_t
      integer(i8) :: boulder = 0         !! whose visit this slot holds
      integer :: at(2) = 0               !! column, row
      real(wp) :: greatest(3) = 0.0_wp   !! speed**2, twice the energy per mass [m2/s2]; jump height [m]
   end type visit_t

   !> The cells that one boulder visited: a hash table that is never cleared, because a slot of
   !> another boulder counts as free.
   type :: visits_t
      integer(i8) :: boulder = 0
      integer :: n = 0
      integer, allocatable :: used(:)         !! slots, in order of the first visit
      type(visit_t), allocatable :: slot(:)   !! 0-based; a power of two of them
      integer :: last = -1                    !! slot of the last visit
   end type visits_t

contains

   !> True if a map asks what happened along the way.
   pure logical function follows_cells(maps)
      type(maps_t), intent(in) :: maps

      follows_cells = associated(maps%passages) .or. associated(maps%sources) .or. associated(maps%released) &
                      .or. wants_layers(maps)
   end function follows_cells

   !> Begin the visits of a boulder (numbers count from 1).
   pure subroutine start_visits(visits, boulder)
      type(visits_t), intent(inout) :: visits
      integer(i8), intent(in) :: boulder

      if (.not. allocated(visits%slot)) call make_room(visits, 1024)
      visits%boulder = boulder
      visits%n = 0
      visits%last = -1
   end subroutine start_visits

   !> Add the cells under a flight. A cell reaches half a cell round its node, so a patch is met in
   !> up to three quarters, each of another cell.
   pure subroutine visit_spans(visits, dem, gravity, x, y, v, spin, spans)
      type(visits_t), intent(inout) :: visits
      type(terrain_t), intent(in) :: dem
      real(wp), intent(in) :: gravity    !! [m/s2]
      real(wp), intent(in) :: x, y, v(3) !! start of the flight [m], [m/s]
      real(wp), intent(in) :: spin       !! twice the rotational energy per mass [m2/s2]
      type(span_t), intent(in) :: spans(:)
      real(wp) :: plan2, inverse(2), cut(2), t, next, d(2), w(2)
      integer :: k, cell(2), step(2)

      plan2 = v(1)*v(1) + v(2)*v(2)
      step = merge(1, -1, v(1:2) > 0)
      inverse = 0
      if (abs(v(1))*never > dem%cell) inverse(1) = 1/v(1)
      if (abs(v(2))*never > dem%cell) inverse(2) = 1/v(2)
      do k = 1, size(spans)
         associate (s => spans(k))
            call enter((s%patch%i - 0.5_wp)*dem%cell - x, inverse(1), step(1), s%patch%i, s%t0, cut(1), cell(1))
            call enter((s%patch%j - 0.5_wp)*dem%cell - y, inverse(2), step(2), s%patch%j, s%t0, cut(2), cell(2))
            t = s%t0
            d(1) = s%d0
            w(1) = v(3) - gravity*t
            do
               next = min(cut(1), cut(2), s%t1)
               d(2) = s%d0 + (next - s%t0)*(s%d1 + (next - s%t0)*s%d2)
               w(2) = v(3) - gravity*next
               call visit_cell(visits, [cell(1), dem%ny + 1 - cell(2)], plan2 + max(w(1)*w(1), w(2)*w(2)), spin, &
                               highest(s, t, next, d))
               if (next >= s%t1) exit
               if (cut(1) <= cut(2)) then
                  cell(1) = cell(1) + step(1)
                  cut(1) = never
               else
                  cell(2) = cell(2) + step(2)
                  cut(2) = never
               end if
               t = next
               d(1) = d(2)
               w(1) = w(2)
            end do
         end associate
      end do
   end subroutine visit_spans

   !> On one axis: the cell over which a path enters patch interval i at time t0, and when it passes
   !> to the next cell in the middle of the patch.
   pure subroutine enter(middle, inverse, step, i, t0, cut, cell)
      real(wp), intent(in) :: middle   !! of the patch, from the start of the flight [m]
      real(wp), intent(in) :: inverse  !! 1/v [s/m]; 0 at rest
      integer, intent(in) :: step      !! 1 or -1, the way it goes
      integer, intent(in) :: i
      real(wp), intent(in) :: t0
      real(wp), intent(out) :: cut     !! [s]; `never` when it does not
      integer, intent(out) :: cell     !! i or i + 1
      logical :: before

      cut = never
      before = middle > 0
      if (abs(inverse) > 0) then
         cut = middle*inverse
         before = cut > t0 .eqv. step > 0
         if (cut <= t0) cut = never
      end if
      cell = i + merge(0, 1, before)
   end subroutine enter

   !> Greatest height above the patch within t0..t1 of a span, d its heights at both.
   pure real(wp) function highest(s, t0, t1, d)
      type(span_t), intent(in) :: s
      real(wp), intent(in) :: t0, t1, d(2)

      highest = max(0.0_wp, d(1), d(2))
      if (s%d1 > -2*s%d2*(t0 - s%t0) .and. s%d1 < -2*s%d2*(t1 - s%t0)) highest = s%d0 - s%d1*s%d1/(4*s%d2)
   end function highest

   !> Add one visit: raises the boulder's values in that cell.
   pure subroutine visit_cell(visits, at, speed2, spin, jump_height)
      type(visits_t), intent(inout) :: visits
      integer, intent(in) :: at(2)                !! column, row
      real(wp), intent(in) :: speed2, spin        !! as in visit_spans
      real(wp), intent(in) :: jump_height         !! [m]

      call raise_visit(visits, at, [speed2, speed2 + spin, jump_height])
   end subroutine visit_cell

   pure subroutine raise_visit(visits, at, values)
      type(visits_t), intent(inout) :: visits
      integer, intent(in) :: at(2)
      real(wp), intent(in) :: values(3)  !! as in visit_t

      if (visits%last >= 0) then  ! most visits go on in the same cell
         if (all(visits%slot(visits%last)%at == at)) then
            call raise(visits%slot(visits%last)%greatest, values)
            return
         end if
      end if
      if (2*visits%n >= size(visits%slot)) call make_room(visits, 2*size(visits%slot))
      visits%last = find(visits, at)
      associate (slot => visits%slot(visits%last))
         if (slot%boulder == visits%boulder) then
            call raise(slot%greatest, values)
         else
            slot = visit_t(visits%boulder, at, values)
            visits%n = visits%n + 1
            visits%used(visits%n) = visits%last
         end if
      end associate
   end subroutine raise_visit

   pure subroutine raise(greatest, values)
      real(wp), intent(inout) :: greatest(3)
      real(wp), intent(in) :: values(3)

      greatest = max(greatest, values)
   end subroutine raise

   !> The slot of a cell: its own, or the free one where it belongs.
   pure integer function find(visits, at) result(k)
      type(visits_t), intent(in) :: visits
      integer, intent(in) :: at(2)
      integer :: mask

      mask = size(visits%slot) - 1
      k = iand(at(1) + 33*at(2), mask)  ! neighbours fall into different slots
      do while (visits%slot(k)%boulder == visits%boulder)
         if (all(visits%slot(k)%at == at)) return
         k = iand(k + 1, mask)
      end do
   end function find

   !> A table of `slots` slots with the same visits.
   pure subroutine make_room(visits, slots)
      type(visits_t), intent(inout) :: visits
      integer, intent(in) :: slots  !! a power of two
      type(visits_t) :: larger
      integer :: k

      allocate (larger%slot(0:slots - 1), larger%used(slots))
      larger%boulder = visits%boulder
      do k = 1, visits%n
         associate (slot => visits%slot(visits%used(k)))
            call raise_visit(larger, slot%at, slot%greatest)
         end associate
      end do
      call move_alloc(larger%slot, visits%slot)
      call move_alloc(larger%used, visits%used)
      visits%last = larger%last
   end subroutine make_room

   !> Add a boulder's visits to the maps; many threads may do so at once.
   subroutine add_visits(maps, visits, mass)
      type(maps_t), intent(in) :: maps
      type(visits_t), intent(in) :: visits
      real(wp), intent(in) :: mass  !! of the boulder [kg]
      logical :: wants_values
      integer :: k

      wants_values = wants_layers(maps)
      do k = 1, visits%n
         associate (slot => visits%slot(visits%used(k)))
            if (associated(maps%passages)) then
               !$omp atomic update
               maps%passages(slot%at(1), slot%at(2)) = maps%passages(slot%at(1), slot%at(2)) + 1
            end if
            if (wants_values) call add_values(maps, slot%at(1), slot%at(2), values_of(slot, mass))
         end associate
      end do
   end subroutine add_visits

   pure logical function wants_layers(maps)
      type(maps_t), intent(in) :: maps
      integer :: k

      wants_layers = associated(maps%class_counts)
      do k = 1, size(maps%layer)
         wants_layers = wants_layers .or. associated(maps%layer(k)%sum) .or. associated(maps%layer(k)%greatest)
      end do
   end function wants_layers

   pure function values_of(visit, mass) result(values)
      type(visit_t), intent(in) :: visit
      real(wp), intent(in) :: mass  !! [kg]
      real(wp) :: values(3)         !! [J], [m/s], [m]

      values(energy) = 0.5_wp*mass*visit%greatest(2)
      values(speed) = sqrt(visit%greatest(1))
      values(jump_height) = visit%greatest(3)
   end function values_of

   subroutine add_values(maps, i, r, values)
      type(maps_t), intent(in) :: maps
      integer, intent(in) :: i, r
      real(wp), intent(in) :: values(3)  !! [J], [m/s], [m]
      integer :: k

      do k = 1, 3
         call add_value(maps%layer(k), i, r, values(k), per_unit(k))
      end do
      if (associated(maps%class_counts)) call count_classes(maps, i, r, values)
   end subroutine add_values

   subroutine add_value(layer, i, r, value, units)
      type(layer_t), intent(in) :: layer
      integer, intent(in) :: i, r
      real(wp), intent(in) :: value, units  !! units of `sum` in one of the value

      if (associated(layer%sum)) then
         !$omp atomic update
         layer%sum(i, r) = layer%sum(i, r) + nint(units*value, i8)
      end if
      if (associated(layer%greatest)) call raise_cell(layer%greatest(i, r), real(value, sp))
   end subroutine add_value

   subroutine count_classes(maps, i, r, values)
      type(maps_t), intent(in) :: maps
      integer, intent(in) :: i, r
      real(wp), intent(in) :: values(3)  !! [J], [m/s], [m]
      integer(i4) :: column
      integer :: k, row

      !$omp atomic read seq_cst
      column = maps%column(i, r)
      if (column == 0) call give_column(maps, i, r, column)
      if (column == 0) return
      do k = 1, 3
         if (maps%layer(k)%classes < 0) cycle
         row = maps%layer(k)%classes + class_of(k, values(k))
         !$omp atomic update
         maps%class_counts(row, column) = maps%class_counts(row, column) + 1
      end do
   end subroutine count_classes

   !> A cell's column of counts, from now on; 0 when there is none left. Memory that was never touched
   !> may hold anything.
   subroutine give_column(maps, i, r, column)
      type(maps_t), intent(in) :: maps
      integer, intent(in) :: i, r
      integer(i4), intent(out) :: column

      !$omp critical (columns_of_cells)
      column = maps%column(i, r)
      if (column == 0) maps%columns = min(maps%columns, size(maps%class_counts, 2)) + 1
      if (column == 0 .and. .not. lacks_columns(maps)) then
         column = maps%columns
         maps%class_counts(:, column) = 0
         !$omp atomic write seq_cst
         maps%column(i, r) = column
      end if
      !$omp end critical (columns_of_cells)
   end subroutine give_column

   !> True if boulders passed more cells than there are columns: then the counts are of no use.
   pure logical function lacks_columns(maps)
      type(maps_t), intent(in) :: maps

      lacks_columns = .false.
      if (associated(maps%columns)) lacks_columns = maps%columns > size(maps%class_counts, 2)
   end function lacks_columns

   !> Raise a shared maximum; most visits do not, and then only read it.
   subroutine raise_cell(greatest, value)
      real(sp), intent(inout) :: greatest
      real(sp), intent(in) :: value
      real(sp) :: now

      !$omp atomic read
      now = greatest
      if (value <= now) return
      !$omp atomic update
      greatest = max(greatest, value)
   end subroutine raise_cell

   !> Count a boulder that came to rest in a cell.
   subroutine add_deposit(maps, at)
      type(maps_t), intent(in) :: maps
      integer, intent(in) :: at(2)  !! column, row

      if (.not. associated(maps%deposits)) return
      !$omp atomic update
      maps%deposits(at(1), at(2)) = maps%deposits(at(1), at(2)) + 1
   end subroutine add_deposit
end module rockfall_map
