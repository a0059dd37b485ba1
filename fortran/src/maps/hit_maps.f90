! SPDX-License-Identifier: BSD-3-Clause
!> Maps of the boulders that would hit an object of a given width in the middle of each cell: those whose centre comes
!> within half the width and a radius of it in plan. Unlike passages of a cell they do not depend on the cell size.
module rockfall_hit_maps
   use rockfall_kinds, only: wp
   use rockfall_terrain, only: terrain_t
   use rockfall_flight, only: flight_t
   use rockfall_maps, only: maps_t, visits_t, visit_nearby, spare_visits, count_exceeded, lock_band, unlock_band
   implicit none
   private
   public :: path_t, paths_t, needs_hits, record_path, find_hits, add_hits

   integer, parameter :: at_once = spare_visits  !! cells
   integer, parameter :: first_paths = 128       !! initial size of a list of paths

   !> Straight path in plan: a flight, or one along the ground, which is without gravity.
   type :: path_t
      real(wp) :: x, y, v(3)  !! its start [m]; velocity there [m/s]
      real(wp) :: gravity     !! [m/s2]
      real(wp) :: time        !! [s]
      real(wp) :: spin        !! twice the rotational energy per mass [m2/s2]
   end type path_t

   !> Paths of a boulder. Its hits are found at its end: the cells near all boulders that go at a time would not stay
   !> in the cache.
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

   !> Record a path, up to a time.
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

   !> Add the cells whose middle is within a distance of a path, each with the maximum energy within that distance: that
   !> at one of its two ends, because the vertical speed changes steadily.
   pure subroutine find_hits(hits, dem, path, distance)
      type(visits_t), intent(inout) :: hits
      type(terrain_t), intent(in) :: dem
      type(path_t), intent(in) :: path
      real(wp), intent(in) :: distance     !! [m]
      real(wp) :: start(2), v(2), from, to, times(2)
      real(wp), dimension(at_once) :: east, north
      integer :: n, column, row, rows(2), columns(2)

      start = [path%x, path%y]
      v = path%v(:2)
      n = 0
      rows = nodes_between(min(start(2), start(2) + v(2)*path%time) - distance, &
                           max(start(2), start(2) + v(2)*path%time) + distance, dem%per_cell, dem%ny)
      do row = rows(1), rows(2)
         call restrict_times(start(2) - (row - 1)*dem%cell, v(2), distance, path%time, times)
         from = start(1) + v(1)*times(1)
         to = start(1) + v(1)*times(2)
         columns = nodes_between(min(from, to) - distance, max(from, to) + distance, dem%per_cell, dem%nx)
         do column = columns(1), columns(2)
            n = n + 1
            east(n) = column - 1
            north(n) = row - 1
            if (n < at_once) cycle
            call hit_cells(hits, dem, path, distance, n, east, north)
            n = 0
         end do
      end do
      call hit_cells(hits, dem, path, distance, n, east, north)
   end subroutine find_hits

   !> Add those of n cells whose middle is within a distance of the path. Branchless, as a branch for each would be
   !> mispredicted.
   pure subroutine hit_cells(hits, dem, path, distance, n, east, north)
      type(visits_t), intent(inout) :: hits
      type(terrain_t), intent(in) :: dem
      type(path_t), intent(in) :: path
      real(wp), intent(in) :: distance  !! [m]
      integer, intent(in) :: n
      real(wp), dimension(at_once), intent(in) :: east, north  !! cells from the south-western one, integers [-]
      real(wp), dimension(at_once) :: energy, meets
      real(wp) :: size, speed2, meeting
      integer :: cell(2, at_once + 1), hit, k

      size = dem%cell
      !$omp simd private(speed2, meeting)
      do k = 1, n
         call meet_object(path%x - east(k)*size, path%y - north(k)*size, path%v(1), path%v(2), path%v(3), &
                          path%gravity, distance, path%time, speed2, meeting)
         energy(k) = speed2 + path%spin
         meets(k) = meeting
      end do
      hit = 0
      do k = 1, n
         cell(:, hit + 1) = [int(east(k)) + 1, dem%ny - int(north(k))]
         energy(hit + 1) = energy(k)
         hit = hit + int(meets(k))
      end do
      call visit_nearby(hits, cell(:, :hit), energy)
   end subroutine hit_cells

   !> First and last node between two coordinates along an axis.
   pure function nodes_between(low, high, per_cell, n) result(nodes)
      real(wp), intent(in) :: low, high  !! [m]
      real(wp), intent(in) :: per_cell   !! [1/m]
      integer, intent(in) :: n           !! nodes of the axis
      integer :: nodes(2)

      nodes = [max(1, ceiling(low*per_cell) + 1), min(n, floor(high*per_cell) + 1)]
   end function nodes_between

   !> Part of a path during which it is within a distance of a node along one axis; some of it, or all, if rounding
   !> leaves none.
   pure subroutine restrict_times(offset, v, distance, time, times)
      real(wp), intent(in) :: offset, v       !! of the start from the node [m], along the axis [m/s]
      real(wp), intent(in) :: distance, time  !! [m], [s]
      real(wp), intent(out) :: times(2)       !! since the start [s]
      real(wp) :: ends(2)

      times = [0.0_wp, time]
      if (abs(v)*time <= distance) return
      ends = [-distance - offset, distance - offset]/v
      times = [max(0.0_wp, min(time, minval(ends))), min(time, max(0.0_wp, maxval(ends)))]
   end subroutine restrict_times

   !> Maximum squared speed while a path is within a distance of a point, and whether it is.
   elemental subroutine meet_object(offset1, offset2, v1, v2, v3, gravity, distance, time, speed2, meets)
      real(wp), intent(in) :: offset1, offset2, v1, v2, v3  !! of the start from the point [m]; [m/s]
      real(wp), intent(in) :: gravity, distance, time       !! [m/s2], [m], [s]
      real(wp), intent(out) :: speed2  !! [m2/s2]
      real(wp), intent(out) :: meets   !! 1 or 0
      real(wp) :: outside, along, plan2, root2, root, first, last

      outside = offset1*offset1 + offset2*offset2 - distance*distance
      along = -(offset1*v1 + offset2*v2)
      plan2 = max(v1*v1 + v2*v2, tiny(plan2))
      root2 = along*along - plan2*outside
      root = sqrt(max(0.0_wp, root2))
      first = max(0.0_wp, (along - root)/plan2)
      last = min(time, (along + root)/plan2)
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
      real(wp), intent(in) :: mass  !! of the boulder [kg]
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
