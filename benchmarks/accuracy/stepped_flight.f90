! SPDX-License-Identifier: BSD-3-Clause
!> Flight in time steps, as in other programs, for comparison only. Replaces the product's module of the same name,
!> which is renamed to exact_flight; only `fly` differs.
module rockfall_flight
   use rockfall_kinds, only: wp
   use rockfall_terrain, only: terrain_t, patch_t, locate, read_patch, height
   use exact_flight, only: flight_t, landing_t, span_t, end_flight, flight_from, launch_rate, arc_length, &
                           parabola_length, no_hit_time, inverse_speed, exit_time, side_time, curvature, &
                           strikes_ground, strike_time, max_height, enter_patch, place_on_patch, fly_exactly => fly
   implicit none
   private
   public :: flight_t, landing_t, span_t, fly, end_flight, flight_from, launch_rate, arc_length, parabola_length, &
             no_hit_time
   public :: inverse_speed, exit_time, side_time, curvature, strikes_ground, strike_time, max_height, enter_patch, &
             place_on_patch
   public :: fly_exactly, march, choose, scheme_names

   character(len=*), parameter :: scheme_names(*) = [character(len=12) :: &
                                                     "exact", &        ! `fly` of the product
                                                     "euler", &        ! velocity first, then position
                                                     "parabola", &     ! parabola evaluated only at the steps
                                                     "interpolated"]   ! parabola; lands between two steps
   integer, parameter :: exact = 1, euler = 2, interpolated = 4

   ! Scheme of `fly`, set by the program before it runs. The product has no such state.
   integer, protected :: scheme = exact
   real(wp), protected :: step = 0.0_wp  !! time step [s]

contains

   !> Choose the scheme of all following flights.
   subroutine choose(name, seconds)
      character(len=*), intent(in) :: name   !! one of scheme_names
      real(wp), intent(in) :: seconds        !! time step; not used by "exact" [s]

      scheme = findloc(scheme_names == name, .true., dim=1)
      step = seconds
   end subroutine choose

   !> `fly` by the chosen scheme. Only the exact scheme reports the cells on the way (for maps).
   pure subroutine fly(dem, gravity, start, landing, spans, n_spans)
      type(terrain_t), intent(in) :: dem
      real(wp), intent(in) :: gravity                       !! [m/s2]
      type(flight_t), intent(in) :: start
      type(landing_t), intent(out) :: landing
      type(span_t), intent(inout), optional :: spans(:)
      integer, intent(inout), optional :: n_spans
      real(wp) :: lift

      if (scheme == exact) then
         call fly_exactly(dem, gravity, start, landing, spans, n_spans)
      else if (present(spans)) then
         error stop "a flight in steps knows no cells: ask for no maps"
      else
         call march(dem, gravity, start, landing, lift)
      end if
   end subroutine fly

   !> Advance step by step until the boulder is below the ground or outside the known terrain. It lands there, lifted
   !> vertically to the surface; "interpolated" first goes back along the last step to zero height above the ground, by
   !> linear interpolation.
   pure subroutine march(dem, gravity, start, landing, lift)
      type(terrain_t), intent(in) :: dem
      real(wp), intent(in) :: gravity           !! [m/s2]
      type(flight_t), intent(in) :: start
      type(landing_t), intent(out) :: landing
      real(wp), intent(out) :: lift             !! depth below the ground at the landing [m]
      type(patch_t) :: patch
      real(wp) :: x, y, z, v, fall, above, before, share
      integer :: n, i, j

      fall = gravity*step
      if (scheme /= euler) fall = 0.5_wp*fall
      patch = start%patch
      x = start%x
      y = start%y
      z = start%z
      v = start%v(3)
      above = start%above
      landing%jump_height = above
      n = 0
      do
         n = n + 1
         before = above
         x = x + start%v(1)*step
         y = y + start%v(2)*step
         z = z + (v - fall)*step
         v = v - gravity*step
         i = int(x*dem%per_cell + 1)
         j = int(y*dem%per_cell + 1)
         if (i /= patch%i .or. j /= patch%j) call read_patch(dem, i, j, patch)
         if (.not. patch%known) exit
         landing%u = x*dem%per_cell - (i - 1)
         landing%w = y*dem%per_cell - (j - 1)
         above = z - height(patch, landing%u, landing%w)
         if (above < 0) exit
         landing%jump_height = max(landing%jump_height, above)
      end do
      landing%contact = patch%known
      share = 0  ! fraction of the last step to go back
      if (landing%contact .and. scheme == interpolated) then
         share = above/(above - before)
         x = x - share*start%v(1)*step
         y = y - share*start%v(2)*step
         z = z - share*(v + fall)*step
         landing%u = x*dem%per_cell - (i - 1)
         landing%w = y*dem%per_cell - (j - 1)
         if (.not. (on_patch(landing%u) .and. on_patch(landing%w))) &
            call locate(dem, x, y, patch, landing%u, landing%w)
      end if
      landing%time = (n - share)*step
      landing%patch = patch
      landing%x = x
      landing%y = y
      landing%z = z
      lift = 0
      if (.not. landing%contact) return
      landing%z = height(patch, landing%u, landing%w)
      lift = landing%z - z
   end subroutine march

   !> Return whether a position is on a patch or its edge. A boulder that descends into a patch lands on it, even if the
   !> step returns to its edge.
   pure logical function on_patch(u)
      real(wp), intent(in) :: u  !! position in the patch, 0..1 [cells]
      real(wp), parameter :: on_edge = 1.0e-9_wp

      on_patch = u > -on_edge .and. u < 1 + on_edge
   end function on_patch
end module rockfall_flight
