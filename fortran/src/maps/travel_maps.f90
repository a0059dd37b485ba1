! SPDX-License-Identifier: BSD-3-Clause
!> Maps of the arrival of boulders: steepest and flattest energy line, and shortest time. All are stored as maxima of
!> positive numbers, so that the order of boulders does not matter; 0 if no boulder arrived.
module rockfall_travel_maps
   use rockfall_kinds, only: wp, sp
   use rockfall_math, only: degree, arcsine
   use rockfall_terrain, only: terrain_t, node_height
   use rockfall_maps, only: maps_t, visits_t, extend_times, raise_maximum, lock_band, unlock_band
   implicit none
   private
   public :: needs_times, needs_travel, time_visits, add_travel, steepest_angle, flattest_angle, shortest_time

   real(wp), parameter :: offset = 2.0_wp            !! added to a sine of either sign to make it positive [-]
   real(wp), parameter :: sine_steps = 2.0_wp**22    !! steps per unit: offset +- sine is exact in single precision

contains

   !> Return whether a map needs arrival times.
   pure logical function needs_times(maps)
      type(maps_t), intent(in) :: maps

      needs_times = associated(maps%shortest)
   end function needs_times

   !> Return whether any map needs the arrival of boulders.
   pure logical function needs_travel(maps)
      type(maps_t), intent(in) :: maps

      needs_travel = associated(maps%steepest) .or. associated(maps%flattest) .or. associated(maps%shortest)
   end function needs_travel

   !> Record the time at which each visit of a flight begins.
   pure subroutine time_visits(visits, dem, start, v, start_time, duration)
      type(visits_t), intent(inout) :: visits
      type(terrain_t), intent(in) :: dem
      real(wp), intent(in) :: start(2)  !! start of the flight [m]
      real(wp), intent(in) :: v(2)      !! velocity in plan [m/s]
      real(wp), intent(in) :: start_time  !! time since the release [s]
      real(wp), intent(in) :: duration  !! duration of the flight [s]
      real(wp) :: t(2)
      integer :: k

      call extend_times(visits)
      do k = visits%timed + 1, visits%n
         associate (cell => visits%visit(k)%cell)
            t(1) = arrival_time((cell(1) - 1)*dem%cell - start(1), dem%cell, v(1))
            t(2) = arrival_time((dem%ny - cell(2))*dem%cell - start(2), dem%cell, v(2))
            visits%time(k) = start_time + min(duration, max(0.0_wp, t(1), t(2)))
         end associate
      end do
      visits%timed = visits%n
   end subroutine time_visits

   !> Time along one axis at which a straight path enters a cell [s]; not positive if it starts there.
   pure real(wp) function arrival_time(middle, cell, v)
      real(wp), intent(in) :: middle  !! cell centre relative to the start of the path [m]
      real(wp), intent(in) :: cell    !! cell size [m]
      real(wp), intent(in) :: v       !! velocity along the axis [m/s]

      arrival_time = 0
      if (abs(v) > 0) arrival_time = (middle - sign(0.5_wp*cell, v))/v
   end function arrival_time

   !> Add the arrival of a boulder in its visited cells; thread-safe. The first cell contains the release, where no
   !> energy line is defined.
   subroutine add_travel(maps, visits, dem, start)
      type(maps_t), intent(in) :: maps
      type(visits_t), intent(in) :: visits
      type(terrain_t), intent(in) :: dem
      real(wp), intent(in) :: start(3)  !! start of the boulder [m]
      real(wp) :: sine
      integer :: k, held

      held = -1
      do k = 1, visits%n
         associate (cell => visits%visit(k)%cell)
            call lock_band(maps, cell(2), held)
            if (k > 1) then
               sine = sine_of_line(dem, start, cell)
               if (associated(maps%steepest)) &
                  call raise_maximum(maps%steepest(cell(1), cell(2)), real(offset + sine, sp))
               if (associated(maps%flattest)) &
                  call raise_maximum(maps%flattest(cell(1), cell(2)), real(offset - sine, sp))
            end if
            if (associated(maps%shortest) .and. k <= visits%timed) &
               call raise_maximum(maps%shortest(cell(1), cell(2)), real(1/(1 + visits%time(k)), sp))
         end associate
      end do
      call unlock_band(maps, held)
   end subroutine add_travel

   !> Sine [-] of the angle below the horizontal of the line from a release to the ground at a cell centre.
   pure real(wp) function sine_of_line(dem, start, cell) result(sine)
      type(terrain_t), intent(in) :: dem
      real(wp), intent(in) :: start(3)  !! position of the release [m]
      integer, intent(in) :: cell(2)    !! column, row
      real(wp) :: d(3)

      d(1) = (cell(1) - 1)*dem%cell - start(1)
      d(2) = (dem%ny - cell(2))*dem%cell - start(2)
      d(3) = start(3) - node_height(dem, cell)
      sine = anint(sine_steps*d(3)/sqrt(d(1)*d(1) + d(2)*d(2) + d(3)*d(3)))/sine_steps
   end function sine_of_line

   !> Angle of the steepest energy line [degree], from its stored value.
   elemental real(sp) function steepest_angle(stored)
      real(sp), intent(in) :: stored  !! > 0 [-]

      steepest_angle = real(arcsine(stored - offset)/degree, sp)
   end function steepest_angle

   !> Angle of the flattest energy line [degree], from its stored value.
   elemental real(sp) function flattest_angle(stored)
      real(sp), intent(in) :: stored  !! > 0 [-]

      flattest_angle = real(arcsine(offset - stored)/degree, sp)
   end function flattest_angle

   !> Shortest time [s], from its stored value 1/(1 + t).
   elemental real(sp) function shortest_time(stored)
      real(sp), intent(in) :: stored  !! > 0 [1/s]

      shortest_time = real(1/real(stored, wp) - 1, sp)
   end function shortest_time
end module rockfall_travel_maps
