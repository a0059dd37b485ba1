! SPDX-License-Identifier: BSD-3-Clause
!> Maps of the boulders that would hit an object of a given width in the middle of each cell: those whose centre comes
!> within half the width and a radius of it in plan. Unlike passages of a cell they do not depend on the cell size.
module rockfall_hit_maps
   use rockfall_kinds, only: wp
   use rockfall_terrain, only: terrain_t
   use rockfall_flight, only: flight_t
   use rockfall_maps, only: maps_t, visits_t, visit_cell, count_exceeded, lock_band, unlock_band
   implicit none
   private
   public :: needs_hits, find_hits, add_hits

contains

   !> Return whether any map shows hits.
   pure logical function needs_hits(maps)
      type(maps_t), intent(in) :: maps

      needs_hits = associated(maps%hits) .or. associated(maps%hits_exceeded)
   end function needs_hits

   !> Add the cells whose middle is within a distance of the path of a flight, up to a time, each with the maximum speed
   !> within that distance: that at one of its two ends, because the vertical speed changes steadily.
   pure subroutine find_hits(hits, dem, gravity, flight, time, spin, distance)
      type(visits_t), intent(inout) :: hits
      type(terrain_t), intent(in) :: dem
      real(wp), intent(in) :: gravity      !! of the path [m/s2]
      type(flight_t), intent(in) :: flight
      real(wp), intent(in) :: time         !! since its start [s]
      real(wp), intent(in) :: spin         !! twice the rotational energy per mass [m2/s2]
      real(wp), intent(in) :: distance     !! [m]
      real(wp) :: start(2), v(2), from, to, middle(2), speed2
      real(wp) :: times(2)
      integer :: column, row, rows(2), columns(2)

      start = [flight%x, flight%y]
      v = flight%v(:2)
      rows = nodes_between(min(start(2), start(2) + v(2)*time) - distance, &
                           max(start(2), start(2) + v(2)*time) + distance, dem%per_cell, dem%ny)
      do row = rows(1), rows(2)
         middle(2) = (row - 1)*dem%cell
         call restrict_times(start(2) - middle(2), v(2), distance, time, times)
         from = start(1) + v(1)*times(1)
         to = start(1) + v(1)*times(2)
         columns = nodes_between(min(from, to) - distance, max(from, to) + distance, dem%per_cell, dem%nx)
         do column = columns(1), columns(2)
            middle(1) = (column - 1)*dem%cell
            call times_within(start - middle, v, distance, time, times)
            if (times(2) < times(1)) cycle
            speed2 = v(1)*v(1) + v(2)*v(2) + maxval((flight%v(3) - gravity*times)**2)
            call visit_cell(hits, [column, dem%ny + 1 - row], speed2, spin, 0.0_wp)
         end do
      end do
   end subroutine find_hits

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

   !> Part of a path during which it is within a distance of a point; reversed if it never is.
   pure subroutine times_within(offset, v, distance, time, times)
      real(wp), intent(in) :: offset(2), v(2)  !! of the start from the point [m]; [m/s]
      real(wp), intent(in) :: distance, time   !! [m], [s]
      real(wp), intent(out) :: times(2)        !! since the start [s]
      real(wp) :: outside, along, speed2, root2

      outside = offset(1)*offset(1) + offset(2)*offset(2) - distance*distance
      along = -(offset(1)*v(1) + offset(2)*v(2))
      speed2 = v(1)*v(1) + v(2)*v(2)
      root2 = along*along - speed2*outside
      times = [1.0_wp, 0.0_wp]
      if (.not. speed2 > 0) then
         if (outside <= 0) times = [0.0_wp, time]
      else if (root2 >= 0) then
         times = [max(0.0_wp, (along - sqrt(root2))/speed2), min(time, (along + sqrt(root2))/speed2)]
      end if
   end subroutine times_within

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
