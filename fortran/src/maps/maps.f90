! SPDX-License-Identifier: BSD-3-Clause
!> Maps of statistics of the boulders in each cell. They consist of counts, integer sums and maxima, so results do
!> not depend on the order of boulders. A boulder counts once per cell: its visits are collected first.
!>
!> Threads that add to the same maps lock one band of rows at a time. A boulder's cells are adjacent, so one lock serves
!> many of them, which costs less than an atomic update of each number.
module rockfall_maps
   use omp_lib, only: omp_lock_kind, omp_init_lock, omp_set_lock, omp_unset_lock, omp_destroy_lock
   use rockfall_kinds, only: wp, sp, i4, i8
   use rockfall_terrain, only: terrain_t
   use rockfall_flight, only: flight_t, span_t, no_hit_time, inverse_speed, exit_time, max_height
   use rockfall_bins, only: energy, speed, jump_height, passing_height, log_bin
   implicit none
   private
   public :: maps_t, layer_t, per_unit, visits_t, needs_visits, needs_heights, start_visits, visit_path, visit_cell
   public :: enter_cell, enter_other_cell, raise_values, first_cell, leaving_time, mark_path, take_back_path
   public :: join_visits, merge_visits, extend_times
   public :: add_visits, add_deposit, add_value, count_bin, count_exceeded, is_requested, lacks_slots, raise_maximum
   public :: square_base, init_locks, free_locks, lock_band, unlock_band

   real(wp), parameter :: per_unit(4) = [1.0_wp, 1000.0_wp, 1000.0_wp, 1000.0_wp]  !! sums are integers: J, mm/s, mm, mm
   integer(i8), parameter :: square_base = 2_i8**31  !! base of the two digits of sums of squares
   integer, parameter :: band_rows = 16  !! rows per band
   integer, parameter :: first_visits = 512  !! initial size of a list of visits
   integer, parameter :: spare_visits = 64   !! free visits at the start of a path; enough for most paths
   real(wp), parameter :: untimed = huge(1.0_wp)  !! time [s] of a visit whose time is unknown; maps store it as 0
   !> Factor of the row in the hash of a cell, so that adjacent cells get different entries.
   integer, parameter :: row_factor = 33

   !> Tallies of one quantity: energy (translational and rotational) [J], speed [m/s], jump height or passing height
   !> [m]; each boulder contributes its maximum in the cell.
   type :: layer_t
      integer(i8), pointer, contiguous :: sum(:, :) => null()  !! [J], [mm/s], [mm]
      !> Sums of squares (nx, ny, 2): high digits, low digits.
      integer(i8), pointer, contiguous :: square(:, :, :) => null()
      real(sp), pointer, contiguous :: max(:, :) => null()     !! [J], [m/s], [m]
      integer :: bin_offset = -1  !! index of the row of `bin_counts` before this quantity's rows; -1: no bins
   end type layer_t

   !> Maps; those not requested are not associated. All are (nx, ny); row 1 is the northernmost.
   type :: maps_t
      integer(i4), pointer, contiguous :: passages(:, :) => null()    !! number of boulders that passed
      integer(i4), pointer, contiguous :: deposits(:, :) => null()    !! number of boulders that came to rest
      integer(i4), pointer, contiguous :: sources(:, :) => null()     !! number of sources with a boulder that passed
      integer(i4), pointer, contiguous :: released(:, :) => null()    !! number of boulders released by these sources
      !> Last source that was counted in the cell boulder by boulder (nx, ny, layers); see rockfall_source_maps.
      integer(i4), pointer, contiguous :: last_source(:, :, :) => null()
      integer(i8) :: first_partial = 0  !! partial source at the start of the run; it has layer 2 of `last_source`
      type(layer_t) :: layer(4)
      !> Boulders whose maximum energy exceeds each `threshold` (nx, ny, thresholds).
      integer(i4), pointer, contiguous :: exceeded(:, :, :) => null()
      !> Boulders that hit an object in the cell (rockfall_hit_maps): all, and those that exceed each `threshold`.
      integer(i4), pointer, contiguous :: hits(:, :) => null(), hits_exceeded(:, :, :) => null()
      real(wp), allocatable :: threshold(:)  !! increasing [J]
      !> Arrival of boulders, in the encoding of rockfall_travel_maps: steepest and flattest energy line, shortest time.
      real(sp), pointer, contiguous :: steepest(:, :) => null(), flattest(:, :) => null(), shortest(:, :) => null()
      integer(i8), pointer, contiguous :: tree_impacts(:, :) => null()  !! number of tree hits, including repeated hits
      type(layer_t) :: tree_height                                      !! height of the contact point
      integer(i8), pointer, contiguous :: tree_energy(:, :) => null()   !! energy absorbed by trees [J]
      !> Bin counts (bins, slots): a cell gets a slot, and with it memory, when the first boulder passes it. The order
      !> of boulders determines only the number of the slot.
      integer(i4), pointer, contiguous :: bin_counts(:, :) => null()
      integer(i4), pointer, contiguous :: slot(:, :) => null()        !! slot of each cell; 0: none yet
      integer(i4), pointer :: slots => null()  !! number of slots assigned; on overflow, one more than exist
      !> Locks of bands of rows, 0-based; not associated for a single thread.
      integer(omp_lock_kind), pointer, contiguous :: band(:) => null()
   end type maps_t

   !> Maxima of one boulder in one cell.
   type :: visit_t
      integer :: cell(2) = 0        !! column, row
      real(wp) :: max(3) = 0.0_wp   !! speed**2, twice the energy per mass [m2/s2]; jump height [m]
   end type visit_t

   !> Visits of one boulder in their order; the last visit is in the current cell. A boulder that returns to a cell
   !> visits it again; `join_visits` leaves one visit per cell.
   type :: visits_t
      integer :: n = 0
      type(visit_t), allocatable :: visit(:)
      real(wp), allocatable :: time(:)        !! start times [s]; only if a map needs times
      integer :: timed = 0                    !! number of known times
      integer :: path = 0                     !! number at the start of the current path; only for `take_back_path`
      real(wp) :: max(3) = 0.0_wp             !! maxima of the last visit, as in visit_t
   end type visits_t

   !> Cells under a straight path, along one axis.
   type :: axis_t
      integer :: cell = 0, step = 1       !! current cell; step to the next: 1 or -1
      real(wp) :: cut = no_hit_time       !! time from the start of the path to its exit from the cell [s]
      real(wp) :: x = 0.0_wp, size = 1.0_wp, inverse = 0.0_wp  !! start, cell size [m], 1/v [s/m], 0 at rest
   end type axis_t

contains

   !> Create the locks for several threads that add to the maps of a raster.
   subroutine init_locks(maps, rows)
      type(maps_t), intent(inout) :: maps
      integer, intent(in) :: rows
      integer :: k

      allocate (maps%band(0:rows/band_rows))
      do k = 0, ubound(maps%band, 1)
         call omp_init_lock(maps%band(k))
      end do
   end subroutine init_locks

   subroutine free_locks(maps)
      type(maps_t), intent(inout) :: maps
      integer :: k

      do k = 0, ubound(maps%band, 1)
         call omp_destroy_lock(maps%band(k))
      end do
      deallocate (maps%band)
   end subroutine free_locks

   !> Lock the band of a row, and release the previous band. `held` is -1 if no band is locked.
   subroutine lock_band(maps, row, held)
      type(maps_t), intent(in) :: maps
      integer, intent(in) :: row
      integer, intent(inout) :: held

      if (.not. associated(maps%band)) return
      if (row/band_rows == held) return
      call unlock_band(maps, held)
      held = row/band_rows
      call omp_set_lock(maps%band(held))
   end subroutine lock_band

   !> Release the locked band.
   subroutine unlock_band(maps, held)
      type(maps_t), intent(in) :: maps
      integer, intent(inout) :: held

      if (held < 0) return
      call omp_unset_lock(maps%band(held))
      held = -1
   end subroutine unlock_band

   !> Return whether a map needs the cells along the trajectories.
   pure logical function needs_visits(maps)
      type(maps_t), intent(in) :: maps

      needs_visits = associated(maps%passages) .or. associated(maps%sources) .or. associated(maps%released) &
                      .or. has_layers(maps) .or. associated(maps%steepest) .or. associated(maps%flattest) &
                      .or. associated(maps%shortest) .or. associated(maps%hits) .or. associated(maps%hits_exceeded)
   end function needs_visits

   !> Return whether a map also needs heights in the visited cells.
   pure logical function needs_heights(maps)
      type(maps_t), intent(in) :: maps

      needs_heights = is_requested(maps%layer(jump_height)) .or. is_requested(maps%layer(passing_height))
   end function needs_heights

   !> Start the visits of a boulder.
   pure subroutine start_visits(visits)
      type(visits_t), intent(inout) :: visits

      if (.not. allocated(visits%visit)) allocate (visits%visit(first_visits))
      visits%n = 0
      visits%timed = 0
   end subroutine start_visits

   !> Add the cells under a flight up to a time. A cell extends half a cell around its node, so along each axis the path
   !> changes cells in the middle of a patch. The vertical speeds at both ends of a cell are its extremes. Heights are
   !> computed from the spans if maps need them.
   pure subroutine visit_path(visits, dem, gravity, start, time, spin, spans)
      type(visits_t), intent(inout) :: visits
      type(terrain_t), intent(in) :: dem
      real(wp), intent(in) :: gravity    !! [m/s2]
      type(flight_t), intent(in) :: start
      real(wp), intent(in) :: time       !! time since the start [s]
      real(wp), intent(in) :: spin       !! twice the rotational energy per mass [m2/s2]
      type(span_t), intent(in), contiguous, optional :: spans(:)
      type(axis_t) :: east, north
      real(wp) :: plan2, next, w(2), t, top
      integer :: k
      logical :: eastward

      plan2 = start%v(1)*start%v(1) + start%v(2)*start%v(2)
      east = path_axis(start%x, start%v(1), dem%cell, start%patch%i)
      north = path_axis(start%y, start%v(2), dem%cell, start%patch%j)
      w(1) = start%v(3)
      t = 0
      k = 1
      top = 0
      call enter_cell(visits, [east%cell, dem%ny + 1 - north%cell])
      do
         next = min(east%cut, north%cut, time)
         w(2) = start%v(3) - gravity*next
         if (present(spans)) call find_max_height(spans, next, k, t, top)
         call raise_values(visits, plan2 + max(w(1)*w(1), w(2)*w(2)), spin, top)
         if (next >= time) exit
         eastward = east%cut <= north%cut
         call step_axis(east, eastward)
         call step_axis(north, .not. eastward)
         call enter_other_cell(visits, [east%cell, dem%ny + 1 - north%cell])
         w(1) = w(2)
      end do
   end subroutine visit_path

   !> Maximum height [m] from time t of span k to a later time. On return, k and t are the start for the next call.
   pure subroutine find_max_height(spans, until, k, t, top)
      type(span_t), intent(in), contiguous :: spans(:)
      real(wp), intent(in) :: until    !! time since the start of the flight [s]
      integer, intent(inout) :: k
      real(wp), intent(inout) :: t     !! time since the start of the flight [s]
      real(wp), intent(out) :: top

      top = 0
      do
         associate (s => spans(k))
            top = max(top, max_height(s%d0, s%d1, s%d2, t - s%t0, min(until, s%t1) - s%t0))
         end associate
         t = until
         if (until < spans(k)%t1 .or. k == size(spans)) exit
         k = k + 1
         t = spans(k)%t0
         if (until <= t) exit
      end do
   end subroutine find_max_height

   !> Start of a path over patch interval i, along one axis.
   pure type(axis_t) function path_axis(x, v, size, i)
      real(wp), intent(in) :: x, v     !! start of the path [m], velocity [m/s]
      real(wp), intent(in) :: size     !! cell size [m]
      integer, intent(in) :: i

      path_axis%x = x
      path_axis%size = size
      path_axis%step = merge(1, -1, v > 0)
      path_axis%inverse = inverse_speed(v, size)
      path_axis%cell = int(first_cell(x, path_axis%inverse, size, real(i, wp)))
      call step_axis(path_axis, .false.)
   end function path_axis

   !> Cell in which a path starts.
   elemental real(wp) function first_cell(x, inverse, size, i) result(cell)
      real(wp), intent(in) :: x        !! start of the path [m]
      real(wp), intent(in) :: inverse  !! from inverse_speed [s/m]
      real(wp), intent(in) :: size     !! cell size [m]
      real(wp), intent(in) :: i        !! index of the patch, an integer [-]
      real(wp) :: cut, step

      cell = i + merge(0.0_wp, 1.0_wp, (i - 0.5_wp)*size > x)
      cut = leaving_time(x, inverse, size, cell)
      step = merge(1.0_wp, -1.0_wp, inverse > 0)
      cell = cell + merge(step, 0.0_wp, cut <= 0)  ! a path that starts between two cells continues in the next
   end function first_cell

   !> Time at which a path leaves its current cell [s].
   elemental real(wp) function leaving_time(x, inverse, size, cell)
      real(wp), intent(in) :: x        !! start of the path [m]
      real(wp), intent(in) :: inverse  !! from inverse_speed [s/m]
      real(wp), intent(in) :: size     !! cell size [m]
      real(wp), intent(in) :: cell     !! an integer [-]

      leaving_time = exit_time(x, cell + merge(-0.5_wp, -1.5_wp, inverse > 0), size, inverse)
   end function leaving_time

   !> If `crosses`, move to the next cell; then compute the time at which the path leaves its current cell.
   pure subroutine step_axis(axis, crosses)
      type(axis_t), intent(inout) :: axis
      logical, intent(in) :: crosses

      axis%cell = axis%cell + axis%step*merge(1, 0, crosses)  ! branchless, because the outcome is unpredictable
      axis%cut = leaving_time(axis%x, axis%inverse, axis%size, real(axis%cell, wp))
   end subroutine step_axis

   !> Add a visit with its maxima.
   pure subroutine visit_cell(visits, cell, speed2, spin, jump_height)
      type(visits_t), intent(inout) :: visits
      integer, intent(in) :: cell(2)              !! column, row
      real(wp), intent(in) :: speed2, spin        !! maximum squared speed; twice the rotational energy per mass [m2/s2]
      real(wp), intent(in) :: jump_height         !! [m]

      call enter_cell(visits, cell)
      call raise_values(visits, speed2, spin, jump_height)
   end subroutine visit_cell

   !> Update the maxima in the current cell.
   pure subroutine raise_values(visits, speed2, spin, jump_height)
      type(visits_t), intent(inout) :: visits
      real(wp), intent(in) :: speed2, spin, jump_height  !! as in visit_cell

      associate (visit => visits%visit(visits%n))
         visit%max(1) = max(visit%max(1), speed2)
         visit%max(2) = max(visit%max(2), speed2 + spin)
         visit%max(3) = max(visit%max(3), jump_height)
      end associate
   end subroutine raise_values

   !> Enter the first cell of a path, usually the current cell, because a flight starts where the previous flight ended.
   !> Visits are joined only at this point, so that the visits of a path can be removed.
   pure subroutine enter_cell(visits, cell)
      type(visits_t), intent(inout) :: visits
      integer, intent(in) :: cell(2)  !! column, row

      call make_room(visits)
      if (visits%n > 0) then
         if (all(visits%visit(visits%n)%cell == cell)) return
      end if
      call enter_other_cell(visits, cell)
   end subroutine enter_cell

   !> Record the start of a path whose visits may be removed.
   pure subroutine mark_path(visits)
      type(visits_t), intent(inout) :: visits

      visits%path = visits%n
      visits%max = visits%visit(visits%n)%max
   end subroutine mark_path

   !> Remove the visits of the current path, except in the cell where it starts.
   pure subroutine take_back_path(visits)
      type(visits_t), intent(inout) :: visits

      visits%n = visits%path
      visits%visit(visits%n)%max = visits%max
   end subroutine take_back_path

   !> Enter a different cell.
   pure subroutine enter_other_cell(visits, cell)
      type(visits_t), intent(inout) :: visits
      integer, intent(in) :: cell(2)  !! column, row

      if (visits%n == size(visits%visit)) call lengthen(visits)
      visits%n = visits%n + 1
      visits%visit(visits%n) = visit_t(cell)
   end subroutine enter_other_cell

   !> Join the visits if the list is almost full, and lengthen it if less than half becomes free.
   pure subroutine make_room(visits)
      type(visits_t), intent(inout) :: visits

      if (visits%n <= size(visits%visit) - spare_visits) return
      call join_visits(visits)
      if (2*visits%n > size(visits%visit)) call lengthen(visits)
   end subroutine make_room

   !> Double the capacity of the list.
   pure subroutine lengthen(visits)
      type(visits_t), intent(inout) :: visits
      type(visit_t), allocatable :: longer(:)

      allocate (longer(2*size(visits%visit)))
      longer(:visits%n) = visits%visit(:visits%n)
      call move_alloc(longer, visits%visit)
   end subroutine lengthen

   !> Join the visits of each cell to one visit, with the maxima and the earliest time, in order of the first visits.
   !> Called when a boulder ends: a single hash table of indices (open addressing) fits in the first-level cache, but
   !> tables for all boulders in flight would not.
   pure subroutine join_visits(visits)
      type(visits_t), intent(inout) :: visits
      integer, allocatable :: entry(:)  ! hash table, 0-based, of a power-of-two size; 0: free
      integer :: entries, n, timed, first, k

      entries = 1
      do while (entries < 2*visits%n)
         entries = 2*entries
      end do
      allocate (entry(0:entries - 1), source=0)
      n = 0
      timed = 0
      do k = 1, visits%n
         call find_visit(visits%visit(:n), visits%visit(k)%cell, entry, first)
         if (first > n) then
            n = first
            visits%visit(n) = visits%visit(k)
            if (k <= visits%timed) then
               timed = n
               visits%time(n) = visits%time(k)
            end if
         else
            visits%visit(first)%max = max(visits%visit(first)%max, visits%visit(k)%max)
            if (k <= visits%timed) visits%time(first) = min(visits%time(first), visits%time(k))
         end if
      end do
      visits%n = n
      visits%timed = timed
   end subroutine join_visits

   !> Index of the visit to a cell; a new cell gets the next index, which is entered in the table.
   pure subroutine find_visit(visit, cell, entry, index)
      type(visit_t), intent(in) :: visit(:)
      integer, intent(in) :: cell(2)         !! column, row
      integer, intent(inout) :: entry(0:)
      integer, intent(out) :: index
      integer :: k

      k = iand(cell(1) + row_factor*cell(2), size(entry) - 1)
      do while (entry(k) > 0)
         index = entry(k)
         if (all(visit(index)%cell == cell)) return
         k = iand(k + 1, size(entry) - 1)
      end do
      index = size(visit) + 1
      entry(k) = index
   end subroutine find_visit

   !> Add the visits of a fragment, with energies multiplied by its mass, to the visits of its boulder. A boulder of
   !> unit mass then counts once per cell, with the maxima over its fragments.
   pure subroutine merge_visits(visits, fragment, mass)
      type(visits_t), intent(inout) :: visits
      type(visits_t), intent(in) :: fragment
      real(wp), intent(in) :: mass  !! mass of the fragment [kg]
      integer :: k

      do k = 1, fragment%n
         call make_room(visits)
         call enter_other_cell(visits, fragment%visit(k)%cell)
         visits%visit(visits%n)%max = fragment%visit(k)%max*[1.0_wp, mass, 1.0_wp]
         if (.not. allocated(visits%time)) cycle
         call extend_times(visits)
         visits%time(visits%n) = untimed
         if (k <= fragment%timed) visits%time(visits%n) = fragment%time(k)
         visits%timed = visits%n
      end do
   end subroutine merge_visits

   !> Extend the list of times to the length of the list of visits.
   pure subroutine extend_times(visits)
      type(visits_t), intent(inout) :: visits

      if (visits%n > size(visits%time)) &
         visits%time = [visits%time, spread(untimed, 1, size(visits%visit) - size(visits%time))]
   end subroutine extend_times

   !> Add a boulder's visits to the maps; thread-safe.
   subroutine add_visits(maps, visits, mass)
      type(maps_t), intent(in) :: maps
      type(visits_t), intent(in) :: visits
      real(wp), intent(in) :: mass  !! [kg]
      logical :: values_requested
      integer :: k, held

      values_requested = has_layers(maps)
      held = -1
      do k = 1, visits%n
         associate (visit => visits%visit(k))
            call lock_band(maps, visit%cell(2), held)
            if (associated(maps%passages)) &
               maps%passages(visit%cell(1), visit%cell(2)) = maps%passages(visit%cell(1), visit%cell(2)) + 1
            if (values_requested) call add_values(maps, visit%cell(1), visit%cell(2), values_of(visit, mass))
         end associate
      end do
      call unlock_band(maps, held)
   end subroutine add_visits

   pure logical function has_layers(maps)
      type(maps_t), intent(in) :: maps
      integer :: k

      has_layers = associated(maps%bin_counts) .or. associated(maps%exceeded)
      do k = 1, size(maps%layer)
         has_layers = has_layers .or. is_requested(maps%layer(k))
      end do
   end function has_layers

   !> Return whether any tally of a quantity is requested.
   pure logical function is_requested(layer)
      type(layer_t), intent(in) :: layer

      is_requested = associated(layer%sum) .or. associated(layer%max) .or. layer%bin_offset >= 0
   end function is_requested

   !> Energy E = m (v**2 + (I/m R_b**2) W**2)/2 (eqs 1-3), speed and jump height of a visit.
   pure function values_of(visit, mass) result(values)
      type(visit_t), intent(in) :: visit
      real(wp), intent(in) :: mass  !! [kg]
      real(wp) :: values(3)         !! [J], [m/s], [m]

      values(energy) = 0.5_wp*mass*visit%max(2)
      values(speed) = sqrt(visit%max(1))
      values(jump_height) = visit%max(3)
   end function values_of

   subroutine add_values(maps, i, r, values)
      type(maps_t), intent(in) :: maps
      integer, intent(in) :: i, r
      real(wp), intent(in) :: values(3)  !! [J], [m/s], [m]
      integer :: k

      do k = 1, 3
         call add_value(maps%layer(k), i, r, values(k), per_unit(k))
      end do
      if (associated(maps%bin_counts)) call count_bins(maps, i, r, values)
      if (associated(maps%exceeded)) call count_exceeded(maps%exceeded, maps%threshold, [i, r], values(energy))
   end subroutine add_values

   !> Count a boulder for each threshold exceeded by its energy.
   subroutine count_exceeded(exceeded, threshold, cell, value)
      integer(i4), intent(in), pointer, contiguous :: exceeded(:, :, :)  !! as in maps_t
      real(wp), intent(in) :: threshold(:)  !! increasing [J]
      integer, intent(in) :: cell(2)        !! column, row
      real(wp), intent(in) :: value         !! [J]
      integer :: k

      do k = 1, size(threshold)
         if (value <= threshold(k)) return
         exceeded(cell(1), cell(2), k) = exceeded(cell(1), cell(2), k) + 1
      end do
   end subroutine count_exceeded

   subroutine add_value(layer, i, r, value, units)
      type(layer_t), intent(in) :: layer
      integer, intent(in) :: i, r
      real(wp), intent(in) :: value  !! [J], [m/s] or [m]
      real(wp), intent(in) :: units  !! units of `sum` per unit of the value [-]
      integer(i8) :: rounded

      if (associated(layer%sum)) then
         rounded = nint(units*value, i8)
         layer%sum(i, r) = layer%sum(i, r) + rounded
         if (associated(layer%square)) call add_square(layer%square, i, r, rounded)
      end if
      if (associated(layer%max)) call raise_maximum(layer%max(i, r), real(value, sp))
   end subroutine add_value

   !> Add the square of a number, which may overflow an integer. With n = a*base + b, the square is (a*a*base +
   !> 2*a*b)*base + b*b.
   subroutine add_square(square, i, r, n)
      integer(i8), intent(in), pointer, contiguous :: square(:, :, :)  !! as in layer_t
      integer, intent(in) :: i, r
      integer(i8), intent(in) :: n                   !! in J, mm/s or mm
      integer(i8) :: a, b, digits(2)

      a = n/square_base
      b = mod(n, square_base)
      digits = [a*a*square_base + 2*a*b + b*b/square_base, mod(b*b, square_base)]
      square(i, r, 1) = square(i, r, 1) + digits(1)
      square(i, r, 2) = square(i, r, 2) + digits(2)
   end subroutine add_square

   subroutine count_bins(maps, i, r, values)
      type(maps_t), intent(in) :: maps
      integer, intent(in) :: i, r
      real(wp), intent(in) :: values(3)  !! [J], [m/s], [m]
      integer(i4) :: slot
      integer :: k, bin

      slot = maps%slot(i, r)
      if (slot == 0) call assign_slot(maps, i, r, slot)
      if (slot == 0) return
      do k = 1, 3
         if (maps%layer(k)%bin_offset < 0) cycle
         bin = maps%layer(k)%bin_offset + log_bin(k, values(k))
         maps%bin_counts(bin, slot) = maps%bin_counts(bin, slot) + 1
      end do
   end subroutine count_bins

   !> Count a boulder in the histogram of one quantity; `count_bins` assigned the slot of the cell before.
   subroutine count_bin(maps, quantity, i, r, value)
      type(maps_t), intent(in) :: maps
      integer, intent(in) :: quantity, i, r
      real(wp), intent(in) :: value  !! [J], [m/s] or [m]
      integer(i4) :: slot
      integer :: bin

      if (maps%layer(quantity)%bin_offset < 0) return
      slot = maps%slot(i, r)
      if (slot == 0) return  ! no slot is available
      bin = maps%layer(quantity)%bin_offset + log_bin(quantity, value)
      maps%bin_counts(bin, slot) = maps%bin_counts(bin, slot) + 1
   end subroutine count_bin

   !> Assign a slot for counts to a cell; 0 if none is available. The new slot is set to zero, because its memory may
   !> have any contents.
   subroutine assign_slot(maps, i, r, slot)
      type(maps_t), intent(in) :: maps
      integer, intent(in) :: i, r
      integer(i4), intent(out) :: slot

      slot = 0
      !$omp critical (slots_of_cells)
      maps%slots = min(maps%slots, size(maps%bin_counts, 2)) + 1
      if (.not. lacks_slots(maps)) slot = maps%slots
      !$omp end critical (slots_of_cells)
      if (slot == 0) return
      maps%bin_counts(:, slot) = 0
      maps%slot(i, r) = slot
   end subroutine assign_slot

   !> Return whether boulders passed more cells than there are slots, which invalidates the counts.
   pure logical function lacks_slots(maps)
      type(maps_t), intent(in) :: maps

      lacks_slots = .false.
      if (associated(maps%slots)) lacks_slots = maps%slots > size(maps%bin_counts, 2)
   end function lacks_slots

   !> Raise a maximum to `value` if that is larger; most visits only read it.
   elemental subroutine raise_maximum(maximum, value)
      real(sp), intent(inout) :: maximum  !! in J, m/s or m, or as stored by rockfall_travel_maps
      real(sp), intent(in) :: value       !! in the unit of `maximum`

      if (value > maximum) maximum = value
   end subroutine raise_maximum

   !> Count a boulder that came to rest in a cell; thread-safe.
   subroutine add_deposit(maps, cell)
      type(maps_t), intent(in) :: maps
      integer, intent(in) :: cell(2)  !! column, row
      integer :: held

      if (.not. associated(maps%deposits)) return
      held = -1
      call lock_band(maps, cell(2), held)
      maps%deposits(cell(1), cell(2)) = maps%deposits(cell(1), cell(2)) + 1
      call unlock_band(maps, held)
   end subroutine add_deposit
end module rockfall_maps
