! SPDX-License-Identifier: BSD-3-Clause
!> Maps of the boulders that would hit an object of a given width in the middle of each cell: in plan, their centre
!> comes closer than half the width plus their radius. Unlike passages, hits do not depend on the cell size.
module rockfall_hit_maps
   use rockfall_kinds, only: wp
   use rockfall_terrain, only: terrain_t
   use rockfall_flight, only: flight_t
   use rockfall_maps, only: maps_t, visits_t, start_visits, enter_other_cell, count_exceeded, lock_band, unlock_band
   implicit none
   private
   public :: path_t, paths_t, needs_hits, record_path, find_hits, add_hits

   integer, parameter :: at_once = 64           !! cells processed together
   integer, parameter :: first_paths = 128     !! initial size of a list of paths
   real(wp), parameter :: none = -1.0_wp       !! marks cells that no path hits; below any energy

   !> Straight path in plan: a flight, or motion along the ground (gravity 0).
   type :: path_t
      real(wp) :: x, y, v(3)  !! start [m]; velocity there [m/s]
      real(wp) :: gravity     !! [m/s2]
      real(wp) :: time        !! [s]
      real(wp) :: spin        !! twice the rotational energy per mass [m2/s2]
   end type path_t

   !> Paths of a boulder. Hits are computed when the boulder ends, because the cells near all moving boulders would not
   !> fit in the cache.
   type :: paths_t
      integer :: n = 0
      type(path_t), allocatable :: path(:)
   end type paths_t

contains

   !> Return whether any map shows hits.
   pure logical function needs_hits(maps)
      type(maps_t), intent(in) :: maps

      needs_hits = associated(maps%hits) .or. associated(maps%hits_exceeded)
   end function needs_hits

   !> Record a path, up to a time after its start.
   pure subroutine record_path(paths, gravity, flight, time, spin)
      type(paths_t), intent(inout) :: paths
      real(wp), intent(in) :: gravity, time, spin  !! as in path_t
      type(flight_t), intent(in) :: flight
      type(path_t), allocatable :: longer(:)

      if (.not. allocated(paths%path)) allocate (paths%path(first_paths))
      if (paths%n == size(paths%path)) then
         allocate (longer(2*paths%n))
         longer(:paths%n) = paths%path
         call move_alloc(longer, paths%path)
      end if
      paths%n = paths%n + 1
      paths%path(paths%n) = path_t(flight%x, flight%y, flight%v, gravity, time, spin)
   end subroutine record_path

   !> Find the cells whose centre comes within a distance of a boulder's paths, each cell once, with the maximum energy
   !> there. The vertical speed changes monotonically, so the maximum is at one end of the path within that distance.
   !> For each row, an array covers the columns near the paths: this is faster than searching for the cell.
   pure subroutine find_hits(hits, dem, paths, distance)
      type(visits_t), intent(inout) :: hits
      type(terrain_t), intent(in) :: dem
      type(paths_t), intent(in) :: paths
      real(wp), intent(in) :: distance                 !! [m]
      real(wp), allocatable :: twice(:)                !! maxima of twice the energy per mass [m2/s2]
      integer, allocatable :: columns(:, :), first(:)  !! columns of each row; offset of a row's columns in `twice`
      integer :: near(2, 2), rows(2), row, column, k, n

      call start_visits(hits)
      rows = [dem%ny, 0]
      do k = 1, paths%n
         near = nodes_near(paths%path(k), dem, distance)
         rows = [min(rows(1), near(1, 2)), max(rows(2), near(2, 2))]
      end do
      allocate (columns(2, rows(1):rows(2)), first(rows(1):rows(2)))
      columns(1, :) = dem%nx
      columns(2, :) = 0
      do k = 1, paths%n
         near = nodes_near(paths%path(k), dem, distance)
         do row = near(1, 2), near(2, 2)
            columns(1, row) = min(columns(1, row), near(1, 1))
            columns(2, row) = max(columns(2, row), near(2, 1))
         end do
      end do
      n = 0
      do row = rows(1), rows(2)
         first(row) = n - columns(1, row) + 1
         n = n + max(0, columns(2, row) - columns(1, row) + 1)
      end do
      allocate (twice(n), source=none)
      do k = 1, paths%n
         call raise_near(twice, first, rows(1), dem, paths%path(k), distance)
      end do
      do row = rows(1), rows(2)
         do column = columns(1, row), columns(2, row)
            if (.not. twice(first(row) + column) > none) cycle
            call enter_other_cell(hits, [column, dem%ny + 1 - row])
            hits%visit(hits%n)%max(2) = twice(first(row) + column)
         end do
      end do
   end subroutine find_hits

   !> Raise the maxima of the cells whose centre is within a distance of a path.
   pure subroutine raise_near(twice, first, low, dem, path, distance)
      real(wp), intent(inout), contiguous :: twice(:)  !! as in find_hits
      integer, intent(in) :: low                       !! row of the first element of `first`
      integer, intent(in), contiguous :: first(low:)   !! as in find_hits
      type(terrain_t), intent(in) :: dem
      type(path_t), intent(in) :: path
      real(wp), intent(in) :: distance                 !! [m]
      real(wp), dimension(at_once) :: east, north      !! start of the path relative to the cells [m]
      integer :: at(at_once)                           !! index of each cell in `twice`
      real(wp) :: offset, from, to, times(2)
      integer :: near(2, 2), columns(2), row, column, n

      n = 0
      near = nodes_near(path, dem, distance)
      do row = near(1, 2), near(2, 2)
         offset = path%y - (row - 1)*dem%cell
         call restrict_times(offset, path%v(2), distance, path%time, times)
         from = path%x + path%v(1)*times(1)
         to = path%x + path%v(1)*times(2)
         columns = nodes_between(min(from, to) - distance, max(from, to) + distance, dem%per_cell, dem%nx)
         do column = columns(1), columns(2)
            n = n + 1
            east(n) = path%x - (column - 1)*dem%cell
            north(n) = offset
            at(n) = first(row) + column
            if (n < at_once) cycle
            call raise_cells(twice, at, path, distance, east, north)
            n = 0
         end do
      end do
      call raise_cells(twice, at(:n), path, distance, east, north)
   end subroutine raise_near

   !> Raise the maxima of the cells whose centre is within a distance of the path. Branchless, because branches would be
   !> mispredicted.
   pure subroutine raise_cells(twice, at, path, distance, east, north)
      real(wp), intent(inout), contiguous :: twice(:)  !! as in find_hits
      integer, intent(in), contiguous :: at(:)
      type(path_t), intent(in) :: path
      real(wp), intent(in) :: distance                 !! [m]
      real(wp), intent(in), dimension(at_once) :: east, north  !! as in raise_near
      real(wp) :: energy(at_once), plan2, inverse, speed2, meets
      integer :: k

      plan2 = max(path%v(1)*path%v(1) + path%v(2)*path%v(2), tiny(plan2))
      inverse = 1/plan2
      !$omp simd private(speed2, meets)
      do k = 1, size(at)
         call meet_object(east(k), north(k), path%v(1), path%v(2), path%v(3), plan2, inverse, path%gravity, distance, &
                          path%time, speed2, meets)
         energy(k) = meets*(speed2 + path%spin) + (meets - 1)  ! `none` if the path misses the cell
      end do
      do k = 1, size(at)
         twice(at(k)) = max(twice(at(k)), energy(k))
      end do
   end subroutine raise_cells

   !> First and last columns (:, 1) and rows (:, 2) of the nodes that may be within a distance of a path.
   pure function nodes_near(path, dem, distance) result(nodes)
      type(path_t), intent(in) :: path
      type(terrain_t), intent(in) :: dem
      real(wp), intent(in) :: distance  !! [m]
      integer :: nodes(2, 2)
      real(wp) :: end(2)

      end = [path%x, path%y] + path%v(:2)*path%time
      nodes(:, 1) = nodes_between(min(path%x, end(1)) - distance, max(path%x, end(1)) + distance, dem%per_cell, dem%nx)
      nodes(:, 2) = nodes_between(min(path%y, end(2)) - distance, max(path%y, end(2)) + distance, dem%per_cell, dem%ny)
   end function nodes_near

   !> First and last node between two coordinates along an axis.
   pure function nodes_between(low, high, per_cell, n) result(nodes)
      real(wp), intent(in) :: low, high  !! [m]
      real(wp), intent(in) :: per_cell   !! [1/m]
      integer, intent(in) :: n           !! number of nodes along the axis
      integer :: nodes(2)

      nodes = [max(1, ceiling(low*per_cell) + 1), min(n, floor(high*per_cell) + 1)]
   end function nodes_between

   !> Times during which a path is within a distance of a node along one axis; the times of the whole path if rounding
   !> leaves none.
   pure subroutine restrict_times(offset, v, distance, time, times)
      real(wp), intent(in) :: offset, v       !! start relative to the node [m]; velocity along the axis [m/s]
      real(wp), intent(in) :: distance, time  !! distance [m]; duration of the path [s]
      real(wp), intent(out) :: times(2)       !! times since the start [s]
      real(wp) :: ends(2)

      times = [0.0_wp, time]
      if (abs(v)*time <= distance) return
      ends = [-distance - offset, distance - offset]/v
      times = [max(0.0_wp, min(time, minval(ends))), min(time, max(0.0_wp, maxval(ends)))]
   end subroutine restrict_times

   !> Maximum squared speed while a path is within a distance of a point, and whether it ever is.
   elemental subroutine meet_object(offset1, offset2, v1, v2, v3, plan2, inverse, gravity, distance, time, speed2, &
                                    meets)
      real(wp), intent(in) :: offset1, offset2, v1, v2, v3  !! start relative to the point [m]; velocity [m/s]
      real(wp), intent(in) :: plan2, inverse                !! squared speed in plan [m2/s2]; 1/plan2
      real(wp), intent(in) :: gravity, distance, time       !! [m/s2], [m], [s]
      real(wp), intent(out) :: speed2  !! [m2/s2]
      real(wp), intent(out) :: meets   !! 1 if the path meets the point, else 0
      real(wp) :: outside, along, root2, root, first, last

      outside = offset1*offset1 + offset2*offset2 - distance*distance
      along = -(offset1*v1 + offset2*v2)
      root2 = along*along - plan2*outside
      root = sqrt(max(0.0_wp, root2))
      first = max(0.0_wp, (along - root)*inverse)
      last = min(time, (along + root)*inverse)
      meets = merge(1.0_wp, 0.0_wp, first <= last)
      meets = merge(meets, 0.0_wp, root2 >= 0)
      first = v3 - gravity*first
      last = v3 - gravity*last
      speed2 = plan2 + max(first*first, last*last)
   end subroutine meet_object

   !> Add the hits of a boulder to the maps; thread-safe.
   subroutine add_hits(maps, hits, mass)
      type(maps_t), intent(in) :: maps
      type(visits_t), intent(in) :: hits
      real(wp), intent(in) :: mass  !! [kg]
      integer :: k, held

      held = -1
      do k = 1, hits%n
         associate (at => hits%visit(k)%cell)
            call lock_band(maps, at(2), held)
            if (associated(maps%hits)) maps%hits(at(1), at(2)) = maps%hits(at(1), at(2)) + 1
            if (associated(maps%hits_exceeded)) &
               call count_exceeded(maps%hits_exceeded, maps%threshold, at, 0.5_wp*mass*hits%visit(k)%max(2))
         end associate
      end do
      call unlock_band(maps, held)
   end subroutine add_hits
end module rockfall_hit_maps
