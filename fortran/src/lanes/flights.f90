! SPDX-License-Identifier: BSD-3-Clause
!> Flights of several boulders at a time. In each round all flights cross their current patch; flights that end are
!> removed, and the last flights move to their places. Each flight performs the operations of `fly` in the same order,
!> so results are bitwise identical.
!>
!> Loops over flights take their constants by value or from a local copy: a constant in memory that is needed only
!> under a condition makes the compiler leave the whole loop scalar.
!>
!> Compiled three times, like rockfall_lanes.
module rockfall_flights
   use, intrinsic :: iso_c_binding, only: c_int, c_int64_t, c_double, c_float
   use rockfall_kinds, only: wp, i8
   use rockfall_terrain, only: terrain_t, patch_t, find_coefficients
   use rockfall_flight, only: flight_t, landing_t, inverse_speed, side_time, curvature, strikes_ground, strike_time, &
                              max_height, enter_patch, place_on_patch
   use rockfall_boulder, only: inertia_factor
   use rockfall_maps, only: enter_cell, enter_other_cell, raise_values, first_cell, leaving_time, mark_path
   use rockfall_scratch, only: scratch_t
   implicit none
   private
   public :: flights_t, landings_t, take_off, take_off_again, take_off_from, fly_to_landings, flight_of, landing_of
   public :: replace_landing, read_corners, read_next_corners, lanes, width, padded

   !> Number of simultaneous flights: a multiple of `width`, but not a power of two, which would map arrays to the same
   !> few sets of the cache. More flights would need a stack above the minimum (rockfall_threads).
   integer, parameter :: lanes = 136
   integer, parameter :: width = 4   !! flights per instruction on the widest processors

   !> Values of each flight when it leaves a cell.
   type :: cell_t
      real(wp), dimension(lanes) :: i = 0, j = 0     !! next cell, as in axis_t [-]
      real(wp), dimension(lanes) :: left_cell = 0    !! 1 if the flight leaves the cell, else 0
      real(wp), dimension(lanes) :: until = 0        !! time at which the flight leaves the cell [s]
      real(wp), dimension(lanes) :: speed2 = 0       !! maximum squared speed over the cell [m2/s2]
      real(wp), dimension(lanes) :: top = 0          !! maximum height over the cell [m]
   end type cell_t

   !> Flights in the air, the first `n` elements. Other elements keep their old values.
   type :: flights_t
      integer :: n = 0
      integer :: n_started = 0                                        !! flights that have already been started
      integer :: refill_below = 12  !! number of flights in the air below which landed boulders are handled
      integer :: lane(lanes) = 0                                      !! lane of the boulder
      real(wp), dimension(lanes) :: x = 0, y = 0, z = 0               !! start [m]
      real(wp), dimension(lanes) :: v1 = 0, v2 = 0, v3 = 0            !! velocity at the start [m/s]
      real(wp), dimension(lanes) :: inverse1 = 0, inverse2 = 0        !! inverse speeds [s/m]
      real(wp), dimension(lanes) :: i = 0, j = 0                      !! indices of the patch [-]
      real(wp), dimension(lanes) :: z00 = 0, a = 0, b = 0, c = 0      !! as in patch_t [m]
      real(wp), dimension(lanes) :: t = 0, d0 = 0, d1 = 0             !! time [s]; height [m] and its rate [m/s]
      real(wp), dimension(lanes) :: jump_height = 0                   !! maximum height so far [m]
      real(wp), dimension(lanes) :: next_i = 0, next_j = 0            !! indices of the next patch [-]
      real(wp), dimension(lanes) :: next_t = 0                        !! time of entering that patch, or of contact [s]
      real(wp), dimension(lanes) :: contact = 0                       !! 1 if the flight has a contact, else 0
      real(wp), dimension(lanes) :: known = 1                         !! 1 if the next patch is known, else 0
      real(wp), dimension(lanes) :: z10 = 0, z01 = 0, z11 = 0         !! other corners of the next patch [m]
      real(wp), dimension(lanes) :: at = 1                            !! index of the next patch's south-western corner
      ! Only used if cells are recorded:
      real(wp), dimension(lanes) :: d2 = 0, end = 0                   !! d2 as in span_t [m/s2]; end of the span [s]
      real(wp), dimension(lanes) :: cell_i = 0, cell_j = 0            !! current cell, as in axis_t [-]
      real(wp), dimension(lanes) :: v3_in = 0                         !! vertical speed on entry to the cell [m/s]
      real(wp), dimension(lanes) :: top = 0                           !! maximum height over the cell so far [m]
      type(cell_t) :: left(2)                                         !! up to two cells left over the patch
      real(wp), dimension(lanes) :: speed2 = 0                        !! as in cell_t, for the current cell
      ! Only used if flights may meet obstacles:
      type(flight_t), allocatable :: start(:)                         !! start of each flight, without heading
   end type flights_t

   !> Flights that have ended.
   type :: landings_t
      integer :: n = 0
      integer :: lane(lanes) = 0
      real(wp), dimension(lanes) :: x0 = 0, y0 = 0, z0 = 0            !! start [m]
      real(wp), dimension(lanes) :: v1 = 0, v2 = 0, v3 = 0            !! velocity at the start [m/s]
      real(wp), dimension(lanes) :: x = 0, y = 0, z = 0               !! end [m]
      real(wp), dimension(lanes) :: time = 0                          !! flight time [s]
      real(wp), dimension(lanes) :: i = 0, j = 0                      !! indices of the patch [-]
      real(wp), dimension(lanes) :: z00 = 0, a = 0, b = 0, c = 0      !! as in patch_t; 0 without a contact [m]
      real(wp), dimension(lanes) :: u = 0, w = 0                      !! position in the patch, 0..1 [cells]
      real(wp), dimension(lanes) :: jump_height = 0                   !! maximum height [m]
      real(wp), dimension(lanes) :: contact = 0                       !! 1: contact; 0: the boulder left the domain
   end type landings_t

   interface
      !> Read the corners of n patches in vectorised loops.
      subroutine read_corners(n, at, row, z, z00, z10, z01, z11) bind(c, name="rockfall_read_corners")
         import :: c_int, c_int64_t, c_double, c_float
         integer(c_int), value :: n
         real(c_double), intent(in) :: at(*)      !! index of each south-western corner, padded to a multiple of `width`
         integer(c_int64_t), value :: row         !! columns of the raster
         real(c_float), intent(in) :: z(*)        !! elevations [m]
         real(c_double), dimension(*), intent(inout) :: z00, z10, z01, z11  !! [m]
      end subroutine read_corners
   end interface

contains

   !> Number of lanes rounded up to a full vector width; padding is cheaper than a remainder loop.
   pure integer function padded(n)
      integer, intent(in) :: n

      padded = (n + width - 1)/width*width
   end function padded

   !> Add a flight.
   subroutine take_off(f, lane, start)
      type(flights_t), intent(inout) :: f
      integer, intent(in) :: lane
      type(flight_t), intent(in) :: start
      integer :: n

      n = f%n + 1
      f%n = n
      f%lane(n) = lane
      f%x(n) = start%x
      f%y(n) = start%y
      f%z(n) = start%z
      f%v1(n) = start%v(1)
      f%v2(n) = start%v(2)
      f%v3(n) = start%v(3)
      f%d0(n) = start%above
      f%d1(n) = start%rate
      call set_patch(f, n, start%patch)
   end subroutine take_off

   !> Add the next flight of a boulder from its last landing.
   subroutine take_off_again(f, l, k, v1, v2, v3, rate)
      type(flights_t), intent(inout) :: f
      type(landings_t), intent(in) :: l
      integer, intent(in) :: k
      real(wp), intent(in) :: v1, v2, v3, rate  !! [m/s]
      integer :: n

      n = f%n + 1
      f%n = n
      f%lane(n) = l%lane(k)
      f%x(n) = l%x(k)
      f%y(n) = l%y(k)
      f%z(n) = l%z(k)
      f%v1(n) = v1
      f%v2(n) = v2
      f%v3(n) = v3
      f%d0(n) = 0
      f%d1(n) = rate
      f%i(n) = l%i(k)
      f%j(n) = l%j(k)
      f%z00(n) = l%z00(k)
      f%a(n) = l%a(k)
      f%b(n) = l%b(k)
      f%c(n) = l%c(k)
   end subroutine take_off_again

   !> Add the next flight of a boulder, which starts from another point, or above it.
   subroutine take_off_from(f, l, k, x, y, z, i, j, z00, a, b, c, above, v1, v2, v3, rate)
      type(flights_t), intent(inout) :: f
      type(landings_t), intent(in) :: l
      integer, intent(in) :: k
      real(wp), intent(in) :: x, y, z            !! start on a patch [m]
      real(wp), intent(in) :: i, j, z00, a, b, c !! patch, as in patch_t [-], [m]
      real(wp), intent(in) :: above              !! height above the patch [m]
      real(wp), intent(in) :: v1, v2, v3, rate   !! [m/s]

      call take_off_again(f, l, k, v1, v2, v3, rate)
      f%x(f%n) = x
      f%y(f%n) = y
      f%z(f%n) = z + above
      f%d0(f%n) = above
      f%i(f%n) = i
      f%j(f%n) = j
      f%z00(f%n) = z00
      f%a(f%n) = a
      f%b(f%n) = b
      f%c(f%n) = c
   end subroutine take_off_from

   !> Set the patch below a flight.
   subroutine set_patch(f, k, patch)
      type(flights_t), intent(inout) :: f
      integer, intent(in) :: k
      type(patch_t), intent(in) :: patch

      f%i(k) = patch%i
      f%j(k) = patch%j
      f%z00(k) = patch%z00
      f%a(k) = patch%a
      f%b(k) = patch%b
      f%c(k) = patch%c
   end subroutine set_patch

   !> Advance the flights until most have landed or left the known terrain; record the cells on the way if maps need
   !> them.
   subroutine fly_to_landings(dem, gravity, w, f, l, scratch)
      type(terrain_t), intent(in) :: dem
      real(wp), intent(in) :: gravity                 !! [m/s2]
      real(wp), intent(in) :: w(:)                    !! W of each lane's boulder [m/s]
      type(flights_t), intent(inout) :: f
      type(landings_t), intent(inout) :: l
      type(scratch_t), intent(inout) :: scratch(:)    !! work space of each lane

      if (scratch(1)%heights_requested) then
         call fly_patches(dem, gravity, w, f, l, scratch, .true., .true.)
      else if (scratch(1)%cells_requested) then
         call fly_patches(dem, gravity, w, f, l, scratch, .true., .false.)
      else
         call fly_patches(dem, gravity, w, f, l, scratch, .false., .false.)
      end if
      call place_landings(l, gravity, dem%cell, dem%per_cell)
   end subroutine fly_to_landings

   !> Advance patch by patch. `cells` and `heights` are compile-time constants at each call, so the compiler specialises
   !> the procedure.
   subroutine fly_patches(dem, gravity, w, f, l, scratch, cells, heights)
      type(terrain_t), intent(in) :: dem
      real(wp), intent(in) :: gravity, w(:)  !! [m/s2]; as in fly_to_landings [m/s]
      type(flights_t), intent(inout) :: f
      type(landings_t), intent(inout) :: l
      type(scratch_t), intent(inout) :: scratch(:)
      logical, value :: cells, heights  !! whether to record the cells, and the heights over them

      call start_flights(f, dem, scratch, cells)
      l%n = 0
      do while (f%n > 0 .and. (l%n == 0 .or. f%n > f%refill_below))
         call cross_patches(f, gravity, dem%cell, dem%per_cell)
         if (cells) then
            call leave_cells(f, gravity, dem%cell, heights)
            call record_left_cells(f%left(1), f, dem%ny, w, scratch)
            call record_left_cells(f%left(2), f, dem%ny, w, scratch)
         end if
         call remove_landed(dem, gravity, w, f, l, scratch, cells)
         call enter_patches(dem, gravity, f)
         call remove_departed(dem, gravity, w, f, l, scratch, cells)
      end do
      f%n_started = f%n
   end subroutine fly_patches

   !> Initialise the flights that have just been added.
   subroutine start_flights(f, dem, scratch, cells)
      type(flights_t), intent(inout) :: f
      type(terrain_t), intent(in) :: dem
      type(scratch_t), intent(inout) :: scratch(:)
      logical, intent(in) :: cells  !! as in fly_patches
      real(wp) :: cell
      integer :: k

      cell = dem%cell
      !$omp simd
      do k = f%n_started + 1, f%n
         f%inverse1(k) = inverse_speed(f%v1(k), cell)
         f%inverse2(k) = inverse_speed(f%v2(k), cell)
         f%t(k) = 0
         f%jump_height(k) = 0
      end do
      if (allocated(f%start)) then
         do k = f%n_started + 1, f%n
            f%start(f%lane(k)) = flight_t(patch_t(int(f%i(k)), int(f%j(k)), f%z00(k), f%a(k), f%b(k), f%c(k), .true.), &
                                          f%x(k), f%y(k), f%z(k), [f%v1(k), f%v2(k), f%v3(k)], f%d0(k), f%d1(k))
         end do
      end if
      if (.not. cells) return
      !$omp simd
      do k = f%n_started + 1, f%n
         f%cell_i(k) = first_cell(f%x(k), f%inverse1(k), cell, f%i(k))
         f%cell_j(k) = first_cell(f%y(k), f%inverse2(k), cell, f%j(k))
         f%v3_in(k) = f%v3(k)
         f%top(k) = 0
      end do
      do k = f%n_started + 1, f%n
         call enter_cell(scratch(f%lane(k))%visits, [int(f%cell_i(k)), dem%ny + 1 - int(f%cell_j(k))])
      end do
      if (.not. allocated(f%start)) return
      do k = f%n_started + 1, f%n
         call mark_path(scratch(f%lane(k))%visits)
      end do
   end subroutine start_flights

   !> Cross a patch, or find the contact on it.
   subroutine cross_patches(f, gravity, cell, per_cell)
      type(flights_t), intent(inout) :: f
      real(wp), value :: gravity, cell, per_cell  !! [m/s2], [m], [1/m]
      real(wp) :: tx, ty, d0, d1, d2, t, next, length, s, east, north, contact
      integer :: k

      !$omp simd private(tx, ty, d0, d1, d2, t, next, length, s, east, north, contact)
      do k = 1, padded(f%n)
         east = merge(1.0_wp, -1.0_wp, f%v1(k) > 0)
         north = merge(1.0_wp, -1.0_wp, f%v2(k) > 0)
         tx = side_time(f%x(k), f%v1(k), f%i(k), cell, f%inverse1(k))
         ty = side_time(f%y(k), f%v2(k), f%j(k), cell, f%inverse2(k))
         t = f%t(k)
         next = max(t, min(tx, ty))
         length = next - t
         d0 = f%d0(k)
         d1 = f%d1(k)
         d2 = curvature(gravity, f%c(k), f%v1(k)*per_cell, f%v2(k)*per_cell)
         contact = strikes_ground(d0, d1, d2, length)
         s = strike_time(d0, d1, d2, length)
         s = merge(s, length, contact > 0)
         f%jump_height(k) = max(f%jump_height(k), max_height(d0, d1, d2, 0.0_wp, s))
         s = t + s
         f%d2(k) = d2
         f%end(k) = s
         f%next_t(k) = merge(s, next, contact > 0)
         east = merge(east, 0.0_wp, tx <= ty)
         north = merge(0.0_wp, north, tx <= ty)
         f%next_i(k) = f%i(k) + east
         f%next_j(k) = f%j(k) + north
         f%contact(k) = contact
      end do
   end subroutine cross_patches

   !> Find up to two cells that a flight leaves over its patch: along each axis, one cell boundary crosses the middle of
   !> the patch. Cell values equal those of `visit_path`.
   subroutine leave_cells(f, gravity, cell, heights)
      type(flights_t), intent(inout) :: f
      real(wp), value :: gravity, cell  !! [m/s2], [m]
      logical, intent(in) :: heights    !! as in fly_patches
      real(wp) :: plan2, v3, before, t, end, i, j, left_cell, first, second, left_first, left_second, last, top, &
                  top1, top2, top3
      integer :: k

      !$omp simd private(plan2, v3, before, end, i, j, left_cell, last)
      do k = 1, padded(f%n)
         plan2 = f%v1(k)*f%v1(k) + f%v2(k)*f%v2(k)
         v3 = f%v3(k)
         before = f%v3_in(k)
         end = f%end(k)
         i = f%cell_i(k)
         j = f%cell_j(k)
         left_cell = 1
         call leave_cell(f%x(k), f%y(k), f%inverse1(k), f%inverse2(k), cell, plan2, v3, gravity, end, i, j, before, &
                         left_cell, f%left(1)%until(k), f%left(1)%speed2(k))
         f%left(1)%left_cell(k) = left_cell
         f%left(1)%i(k) = i
         f%left(1)%j(k) = j
         call leave_cell(f%x(k), f%y(k), f%inverse1(k), f%inverse2(k), cell, plan2, v3, gravity, end, i, j, before, &
                         left_cell, f%left(2)%until(k), f%left(2)%speed2(k))
         f%left(2)%left_cell(k) = left_cell
         f%left(2)%i(k) = i
         f%left(2)%j(k) = j
         f%cell_i(k) = i
         f%cell_j(k) = j
         f%v3_in(k) = before
         last = v3 - gravity*f%next_t(k)
         f%speed2(k) = plan2 + max(before*before, last*last)
      end do
      if (.not. heights) return
      !$omp simd private(t, end, first, second, left_first, left_second, top, top1, top2, top3)
      do k = 1, padded(f%n)
         t = f%t(k)
         end = f%end(k)
         first = f%left(1)%until(k)
         second = f%left(2)%until(k)
         left_first = f%left(1)%left_cell(k)
         left_second = f%left(2)%left_cell(k)
         top = f%top(k)
         top1 = max(top, max_height(f%d0(k), f%d1(k), f%d2(k), 0.0_wp, min(first, end) - t))
         top1 = merge(top1, top, first > t)  ! otherwise the flight left this cell at the end of the previous patch
         top2 = max(0.0_wp, max_height(f%d0(k), f%d1(k), f%d2(k), max(first, t) - t, min(second, end) - t))
         top3 = max(0.0_wp, max_height(f%d0(k), f%d1(k), f%d2(k), max(second, t) - t, end - t))
         f%left(1)%top(k) = top1
         f%left(2)%top(k) = top2
         top = merge(top2, top1, left_first > 0)
         f%top(k) = merge(top3, top, left_second > 0)
      end do
   end subroutine leave_cells

   !> Leave the current cell of a flight if the flight leaves it before a given time.
   elemental subroutine leave_cell(x, y, inverse1, inverse2, cell, plan2, v3, gravity, end, i, j, v3_in, left_cell, &
                                   until, speed2)
      real(wp), intent(in) :: x, y                !! start of the flight [m]
      real(wp), intent(in) :: inverse1, inverse2  !! inverse speeds [s/m]
      real(wp), intent(in) :: cell                !! cell size [m]
      real(wp), intent(in) :: plan2               !! squared speed in plan [m2/s2]
      real(wp), intent(in) :: v3                  !! vertical speed at the start [m/s]
      real(wp), intent(in) :: gravity             !! [m/s2]
      real(wp), intent(in) :: end                 !! given time, since the start [s]
      real(wp), intent(inout) :: i, j             !! indices of the cell, as in axis_t [-]
      real(wp), intent(inout) :: v3_in            !! vertical speed on entry to the cell [m/s]
      real(wp), intent(inout) :: left_cell        !! 1 if the flight leaves the cell, else 0
      real(wp), intent(out) :: until              !! time of leaving, since the start [s]
      real(wp), intent(out) :: speed2             !! maximum squared speed over the cell [m2/s2]
      real(wp) :: tx, ty, east, north, v3_out

      tx = leaving_time(x, inverse1, cell, i)
      ty = leaving_time(y, inverse2, cell, j)
      until = min(tx, ty)
      v3_out = v3 - gravity*until
      speed2 = plan2 + max(v3_in*v3_in, v3_out*v3_out)
      left_cell = merge(left_cell, 0.0_wp, until < end)
      v3_in = merge(v3_out, v3_in, left_cell > 0)
      east = merge(1.0_wp, -1.0_wp, inverse1 > 0)
      north = merge(1.0_wp, -1.0_wp, inverse2 > 0)
      east = merge(east, 0.0_wp, tx <= ty)
      north = merge(0.0_wp, north, tx <= ty)
      i = i + left_cell*east
      j = j + left_cell*north
   end subroutine leave_cell

   !> Record the cells that the flights have just left.
   subroutine record_left_cells(left, f, ny, w, scratch)
      type(cell_t), intent(in) :: left
      type(flights_t), intent(in) :: f
      integer, intent(in) :: ny        !! rows of the raster
      real(wp), intent(in) :: w(:)     !! W of each lane's boulder [m/s]
      type(scratch_t), intent(inout) :: scratch(:)
      integer :: flight(lanes + 1), n, k, m

      n = 0
      do k = 1, f%n  ! branchless for the same reason as in `remove_landed`
         flight(n + 1) = k
         n = n + int(left%left_cell(k))
      end do
      do m = 1, n
         k = flight(m)
         associate (visits => scratch(f%lane(k))%visits)
            call raise_values(visits, left%speed2(k), inertia_factor*w(f%lane(k))**2, left%top(k))
            call enter_other_cell(visits, [int(left%i(k)), ny + 1 - int(left%j(k))])
         end associate
      end do
   end subroutine record_left_cells

   !> Record the cell in which a flight ends.
   subroutine record_last_cell(f, k, contact, dem, gravity, w, scratch)
      type(flights_t), intent(inout) :: f
      integer, intent(in) :: k
      real(wp), intent(in) :: contact  !! as in landings_t
      type(terrain_t), intent(in) :: dem
      real(wp), intent(in) :: gravity  !! [m/s2]
      real(wp), intent(in) :: w        !! W [m/s]
      type(scratch_t), intent(inout) :: scratch
      real(wp) :: plan2, left_cell, until, speed2

      plan2 = f%v1(k)*f%v1(k) + f%v2(k)*f%v2(k)
      left_cell = max(f%left(2)%left_cell(k), 1 - contact)  ! otherwise `leave_cells` has already found the last cell
      do while (left_cell > 0)  ! a flight may have left cells in which it spent no time
         call leave_cell(f%x(k), f%y(k), f%inverse1(k), f%inverse2(k), dem%cell, plan2, f%v3(k), gravity, f%next_t(k), &
                         f%cell_i(k), f%cell_j(k), f%v3_in(k), left_cell, until, speed2)
         if (.not. left_cell > 0) exit
         call raise_values(scratch%visits, speed2, inertia_factor*w**2, f%top(k))
         f%top(k) = 0
         call enter_other_cell(scratch%visits, [int(f%cell_i(k)), dem%ny + 1 - int(f%cell_j(k))])
      end do
      call raise_values(scratch%visits, f%speed2(k), inertia_factor*w**2, f%top(k))
   end subroutine record_last_cell

   !> Remove the flights that hit the ground on their current patch.
   subroutine remove_landed(dem, gravity, w, f, l, scratch, cells)
      type(terrain_t), intent(in) :: dem
      real(wp), intent(in) :: gravity, w(:)  !! [m/s2]; as in fly_to_landings [m/s]
      type(flights_t), intent(inout) :: f
      type(landings_t), intent(inout) :: l
      type(scratch_t), intent(inout) :: scratch(:)
      logical, intent(in) :: cells  !! as in fly_patches
      integer :: ended(lanes + 1), n_ended, k, m

      n_ended = 0
      do k = 1, f%n  ! branchless, because the outcome is unpredictable
         ended(n_ended + 1) = k
         n_ended = n_ended + int(f%contact(k))
      end do
      do m = n_ended, 1, -1
         call remove_flight(ended(m), 1.0_wp, dem, gravity, w, f, l, scratch, cells)
      end do
   end subroutine remove_landed

   !> Remove the flights that left the known terrain.
   subroutine remove_departed(dem, gravity, w, f, l, scratch, cells)
      type(terrain_t), intent(in) :: dem
      real(wp), intent(in) :: gravity, w(:)  !! [m/s2]; as in fly_to_landings [m/s]
      type(flights_t), intent(inout) :: f
      type(landings_t), intent(inout) :: l
      type(scratch_t), intent(inout) :: scratch(:)
      logical, intent(in) :: cells  !! as in fly_patches
      real(wp) :: known
      integer :: k

      known = 1
      !$omp simd reduction(min: known)
      do k = 1, f%n
         known = min(known, f%known(k))
      end do
      if (known > 0) return
      do k = f%n, 1, -1
         if (f%known(k) > 0) cycle
         call set_patch(f, k, patch_t(int(f%i(k)), int(f%j(k))))
         call remove_flight(k, 0.0_wp, dem, gravity, w, f, l, scratch, cells)
         if (k <= f%n) call move_patch(f, f%n + 1, k)
      end do
   end subroutine remove_departed

   !> Store the end of a flight; the last flight takes its place.
   subroutine remove_flight(k, contact, dem, gravity, w, f, l, scratch, cells)
      integer, intent(in) :: k
      real(wp), intent(in) :: contact  !! as in landings_t
      type(terrain_t), intent(in) :: dem
      real(wp), intent(in) :: gravity, w(:)  !! [m/s2]; as in fly_to_landings [m/s]
      type(flights_t), intent(inout) :: f
      type(landings_t), intent(inout) :: l
      type(scratch_t), intent(inout) :: scratch(:)
      logical, intent(in) :: cells  !! as in fly_patches

      call set_landing(f, k, contact, l)
      if (cells) call record_last_cell(f, k, contact, dem, gravity, w(f%lane(k)), scratch(f%lane(k)))
      if (k < f%n) call move_flight(f, f%n, k, cells)
      f%n = f%n - 1
   end subroutine remove_flight

   !> Move a flight, except its patch, to the place of another flight.
   subroutine move_flight(f, from, to, cells)
      type(flights_t), intent(inout) :: f
      integer, intent(in) :: from, to
      logical, intent(in) :: cells  !! as in fly_patches

      f%lane(to) = f%lane(from)
      f%x(to) = f%x(from)
      f%y(to) = f%y(from)
      f%z(to) = f%z(from)
      f%v1(to) = f%v1(from)
      f%v2(to) = f%v2(from)
      f%v3(to) = f%v3(from)
      f%inverse1(to) = f%inverse1(from)
      f%inverse2(to) = f%inverse2(from)
      f%jump_height(to) = f%jump_height(from)
      f%next_i(to) = f%next_i(from)
      f%next_j(to) = f%next_j(from)
      f%next_t(to) = f%next_t(from)
      if (.not. cells) return
      f%cell_i(to) = f%cell_i(from)
      f%cell_j(to) = f%cell_j(from)
      f%v3_in(to) = f%v3_in(from)
      f%speed2(to) = f%speed2(from)
      f%top(to) = f%top(from)
   end subroutine move_flight

   !> Move the patch of a flight, and its height above the patch, to another place.
   subroutine move_patch(f, from, to)
      type(flights_t), intent(inout) :: f
      integer, intent(in) :: from, to

      f%i(to) = f%i(from)
      f%j(to) = f%j(from)
      f%z00(to) = f%z00(from)
      f%a(to) = f%a(from)
      f%b(to) = f%b(from)
      f%c(to) = f%c(from)
      f%t(to) = f%t(from)
      f%d0(to) = f%d0(from)
      f%d1(to) = f%d1(from)
   end subroutine move_patch

   !> Store the end of a flight.
   subroutine set_landing(f, k, contact, l)
      type(flights_t), intent(in) :: f
      integer, intent(in) :: k
      real(wp), intent(in) :: contact  !! as in landings_t
      type(landings_t), intent(inout) :: l
      integer :: n

      n = l%n + 1
      l%n = n
      l%lane(n) = f%lane(k)
      l%x0(n) = f%x(k)
      l%y0(n) = f%y(k)
      l%z0(n) = f%z(k)
      l%v1(n) = f%v1(k)
      l%v2(n) = f%v2(k)
      l%v3(n) = f%v3(k)
      l%time(n) = f%next_t(k)
      l%i(n) = f%i(k)
      l%j(n) = f%j(k)
      l%z00(n) = f%z00(k)
      l%a(n) = f%a(k)
      l%b(n) = f%b(k)
      l%c(n) = f%c(k)
      l%jump_height(n) = f%jump_height(k)
      l%contact(n) = contact
   end subroutine set_landing

   !> Enter the next patches: read them, and find the heights of the flights above them.
   subroutine enter_patches(dem, gravity, f)
      type(terrain_t), intent(in) :: dem
      real(wp), value :: gravity  !! [m/s2]
      type(flights_t), intent(inout) :: f
      real(wp) :: known, per_cell
      integer :: k

      call read_next_corners(dem, f%n, f%next_i, f%next_j, f%known, f%at, f%z00, f%z10, f%z01, f%z11)
      per_cell = dem%per_cell
      !$omp simd private(known)
      do k = 1, padded(f%n)
         call find_coefficients(f%z00(k), f%z10(k), f%z01(k), f%z11(k), f%a(k), f%b(k), f%c(k), known)
         f%known(k) = min(f%known(k), known)
         f%i(k) = f%next_i(k)
         f%j(k) = f%next_j(k)
         f%t(k) = f%next_t(k)
         call enter_patch(f%x(k), f%y(k), f%z(k), f%v1(k), f%v2(k), f%v3(k), gravity, per_cell, f%t(k), &
                          f%i(k), f%j(k), f%z00(k), f%a(k), f%b(k), f%c(k), f%d0(k), f%d1(k))
      end do
   end subroutine enter_patches

   !> Read the corners of the next patches. For a patch beyond the window another patch is read, which avoids branches.
   subroutine read_next_corners(dem, n, next_i, next_j, known, at, z00, z10, z01, z11)
      type(terrain_t), intent(in) :: dem
      integer, intent(in) :: n                                        !! number of patches
      real(wp), dimension(lanes), intent(in) :: next_i, next_j        !! indices of the patches [-]
      real(wp), dimension(lanes), intent(inout) :: known              !! 1 if the patch is in the window, else 0
      real(wp), dimension(lanes), intent(inout) :: at                 !! as in flights_t
      real(wp), dimension(lanes), intent(inout) :: z00, z10, z01, z11 !! corners of the patches [m]
      real(wp), pointer, contiguous :: z8(:)
      real(wp) :: low(2), high(2), first(2), columns, inside, i, j
      integer(i8) :: row, corner
      integer :: k

      low = dem%lo
      high = dem%hi
      if (associated(dem%z8)) then
         row = size(dem%z8, 1, i8)
         first = lbound(dem%z8)
      else
         row = size(dem%z4, 1, i8)
         first = lbound(dem%z4)
      end if
      first(2) = dem%ny + 1 - first(2)  ! counted from the south
      columns = real(row, wp)
      !$omp simd private(inside, i, j)
      do k = 1, padded(n)
         i = next_i(k)
         j = next_j(k)
         inside = merge(1.0_wp, 0.0_wp, i >= low(1))
         inside = merge(inside, 0.0_wp, j >= low(2))
         inside = merge(inside, 0.0_wp, i <= high(1))
         inside = merge(inside, 0.0_wp, j <= high(2))
         i = merge(i, low(1), inside > 0)
         j = merge(j, low(2), inside > 0)
         known(k) = inside
         at(k) = 1 + (i - first(1)) + (first(2) - j)*columns
      end do
      if (.not. associated(dem%z8)) then
         call read_corners(padded(n), at, row, dem%z4, z00, z10, z01, z11)
         return
      end if
      z8(1:size(dem%z8, kind=i8)) => dem%z8
      do k = 1, n
         corner = int(at(k), i8)
         z00(k) = z8(corner)
         z10(k) = z8(corner + 1)
         z01(k) = z8(corner - row)
         z11(k) = z8(corner - row + 1)
      end do
   end subroutine read_next_corners

   !> Place landings exactly on their patches.
   subroutine place_landings(l, gravity, cell, per_cell)
      type(landings_t), intent(inout) :: l
      real(wp), value :: gravity, cell, per_cell  !! [m/s2], [m], [1/m]
      real(wp) :: x, y, z, t, contact, x_on, y_on, z_on
      integer :: k

      !$omp simd private(x, y, z, t, contact, x_on, y_on, z_on)
      do k = 1, padded(l%n)
         t = l%time(k)
         x = l%x0(k) + l%v1(k)*t
         y = l%y0(k) + l%v2(k)*t
         z = l%z0(k) + t*(l%v3(k) - 0.5_wp*gravity*t)
         call place_on_patch(x, y, cell, per_cell, l%i(k), l%j(k), l%z00(k), l%a(k), l%b(k), l%c(k), l%u(k), l%w(k), &
                             x_on, y_on, z_on)
         contact = l%contact(k)
         l%x(k) = merge(x_on, x, contact > 0)
         l%y(k) = merge(y_on, y, contact > 0)
         l%z(k) = merge(z_on, z, contact > 0)
      end do
   end subroutine place_landings

   !> Start of a flight that has ended, without heading and height above the ground.
   pure type(flight_t) function flight_of(l, k) result(flight)
      type(landings_t), intent(in) :: l
      integer, intent(in) :: k

      flight%x = l%x0(k)
      flight%y = l%y0(k)
      flight%z = l%z0(k)
      flight%v = [l%v1(k), l%v2(k), l%v3(k)]
   end function flight_of

   !> Landing k as a single landing_t.
   pure type(landing_t) function landing_of(l, k) result(landing)
      type(landings_t), intent(in) :: l
      integer, intent(in) :: k

      landing%contact = l%contact(k) > 0
      landing%time = l%time(k)
      landing%x = l%x(k)
      landing%y = l%y(k)
      landing%z = l%z(k)
      landing%patch = patch_t(int(l%i(k)), int(l%j(k)), l%z00(k), l%a(k), l%b(k), l%c(k), landing%contact)
      landing%u = l%u(k)
      landing%w = l%w(k)
      landing%jump_height = l%jump_height(k)
   end function landing_of

   !> Replace landing k by another point, such as the end of a roll.
   pure subroutine replace_landing(l, k, landing)
      type(landings_t), intent(inout) :: l
      integer, intent(in) :: k
      type(landing_t), intent(in) :: landing

      l%contact(k) = merge(1.0_wp, 0.0_wp, landing%contact)
      l%time(k) = landing%time
      l%x(k) = landing%x
      l%y(k) = landing%y
      l%z(k) = landing%z
      l%i(k) = landing%patch%i
      l%j(k) = landing%patch%j
      l%z00(k) = landing%patch%z00
      l%a(k) = landing%patch%a
      l%b(k) = landing%patch%b
      l%c(k) = landing%patch%c
      l%u(k) = landing%u
      l%w(k) = landing%w
      l%jump_height(k) = landing%jump_height
   end subroutine replace_landing
end module rockfall_flights
