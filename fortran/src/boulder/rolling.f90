! SPDX-License-Identifier: BSD-3-Clause
!> Rest or rolling of a boulder that is too slow to fly after a rebound.
!>
!> One radius ahead of the boulder, down the steepest descent of its patch, the ground is lower by the drop d. If d is
!> at most the plan distance l times the tangent of the rest angle, friction holds the boulder; otherwise it rolls there
!> and meets the ground again. The energy is that of a sphere rolling down a facet (Azzoni, La Barbera, Zaninetti 1995,
!> Int. J. Rock Mech. Min. Sci. 32, 709-724), v1**2 = v0**2 + 2 g (d - tan(rest angle) l)/(1 + k), k = I/(m R_b**2):
!> closed form, no time step.
module rockfall_rolling
   use rockfall_kinds, only: wp
   use rockfall_boulder, only: inertia_factor
   use rockfall_terrain, only: terrain_t, patch_t, read_patch, in_window, height, height_at, gradient, patch_position, &
                               fraction_of
   use rockfall_flight, only: flight_t, landing_t, flight_from, inverse_speed, side_time
   implicit none
   private
   public :: roll_t, touch_t, find_roll, find_slide, slide_on_patch, walk_patches, falls_away, time_slide, &
             flight_after_roll, speed_within, cut_roll, ground_points

   !> Maximum vertical distance between the ground and a chord of recorded points, over R_b [-].
   real(wp), parameter :: chord_tolerance = 0.01_wp

   !> A recorded point this close to the end of a path, as a fraction of the duration [-], counts as its end.
   real(wp), parameter :: end_tolerance = 1.0e-9_wp

   !> A boulder still rests if the drop exceeds the drop that friction can hold by less than this fraction [-]: on a
   !> plane at the rest angle, rounding errors must not decide.
   real(wp), parameter :: hold_tolerance = 1.0e-6_wp

   type :: roll_t
      logical :: rolls = .false.       !! false: the boulder rests
      real(wp) :: speed2(2) = 0.0_wp   !! squares of the rolling speed at its start and end [m2/s2]
      real(wp) :: direction(3)         !! from start to end, unit [-]
      type(flight_t) :: path           !! straight path at the mean speed, followed without gravity
      type(landing_t) :: landing       !! end of the path: start of the next flight, or edge of the known terrain
      logical :: from_table = .false.  !! the contact is from an impact table, and the components below are valid
      real(wp) :: length = 0.0_wp      !! distance along the ground [m]
      real(wp) :: v(3) = 0.0_wp        !! velocity at the end [m/s]
      real(wp) :: w = 0.0_wp           !! W = R_b omega at the end [m/s]
      real(wp) :: heading(2) = 0.0_wp  !! heading at the end, of any length
      real(wp) :: above = 0.0_wp       !! height above the ground at the end, where the next flight starts [m]
      real(wp) :: waits = 0.0_wp       !! waiting time at the end [s]
   end type roll_t

   !> State of a boulder after its last contact on ground with an impact table.
   type :: touch_t
      integer :: ground = 0        !! index of the ground; 0: none
      integer :: next = 0          !! table record that followed the last record in the laboratory; 0: none
      real(wp) :: ratio = 0.0_wp   !! R_b/R_m [-]
      logical :: rolling = .false.
      real(wp) :: normal = 0.0_wp  !! V_n [m/s]
      real(wp) :: height = 0.0_wp  !! height of the centre above the mean ground, over R_b [-]
      real(wp) :: lift = 0.0_wp    !! rise of the centre since the boulder landed, over R_b [-]
      integer :: part = 1          !! part of the table used for the boulder
      real(wp) :: key = 1.0_wp     !! as in approach_t [-]
      logical :: beyond = .false.  !! R_b/R_m is outside the table
   end type touch_t

contains

   !> Decide whether a boulder rests; if not, find where it rolls.
   pure subroutine find_roll(dem, gravity, friction, radius, landing, speed2, w, roll)
      type(terrain_t), intent(in) :: dem
      real(wp), intent(in) :: gravity         !! [m/s2]
      real(wp), intent(in) :: friction        !! tangent of the rest angle [-]
      real(wp), intent(in) :: radius          !! R_b [m]
      type(landing_t), intent(in) :: landing  !! the contact
      real(wp), intent(in) :: speed2          !! |v|**2 after the contact [m2/s2]
      real(wp), intent(in) :: w               !! W = R_b omega after the contact [m/s]
      type(roll_t), intent(inout) :: roll
      real(wp) :: g(2), steepness, length, drop, distance, mean

      roll%rolls = .false.
      roll%from_table = .false.
      g = gradient(dem, landing%patch, landing%u, landing%w)
      steepness = sqrt(g(1)*g(1) + g(2)*g(2))
      if (.not. steepness > 0) return
      length = radius/sqrt(1 + steepness*steepness)
      roll%path%heading = -g/steepness
      call move_along(dem, landing, length, roll)
      drop = landing%z - roll%landing%z
      if (roll%landing%contact) then
         roll%rolls = drop > friction*length*(1 + hold_tolerance)
      else  ! unknown terrain ahead: assume the slope of the current position
         roll%rolls = steepness > friction*(1 + hold_tolerance) .or. outside_window(dem, roll%landing%patch)
      end if
      if (.not. roll%rolls) return
      roll%speed2(1) = (speed2 + inertia_factor*min(w*w, speed2))/(1 + inertia_factor)
      roll%speed2(2) = roll%speed2(1) + 2*gravity*max(0.0_wp, drop - friction*length)/(1 + inertia_factor)
      mean = 0.5_wp*(sqrt(roll%speed2(1)) + sqrt(roll%speed2(2)))  ! constant acceleration
      distance = sqrt(length*length + drop*drop)
      roll%direction = [roll%path%heading, -steepness]/sqrt(1 + steepness*steepness)
      if (distance > 0) roll%direction = [roll%path%heading*length, -drop]/distance
      roll%landing%time = distance/max(mean, tiny(mean)/epsilon(mean))
      roll%path%patch = landing%patch
      roll%path%x = landing%x
      roll%path%y = landing%y
      roll%path%z = landing%z
      roll%path%v = mean*roll%direction
      roll%path%above = 0
      roll%path%rate = 0
   end subroutine find_roll

   !> Path of a contact drawn from an impact table: along a tangent of the ground, in a given time. The boulder moves at
   !> the speed of the contact's mean energy, so that line crossings show that energy, or faster if it would not arrive
   !> in time. It then waits for the remaining time.
   !>
   !> `off`: the ground falls away faster than the boulder falls, so the boulder leaves the ground at once.
   pure subroutine find_slide(dem, gravity, landing, t, length, time, speed, roll, off)
      type(terrain_t), intent(in) :: dem
      real(wp), intent(in) :: gravity         !! [m/s2]
      type(landing_t), intent(in) :: landing  !! the contact
      real(wp), intent(in) :: t(3)            !! unit tangent of the ground [-]
      real(wp), intent(in) :: length, time    !! length along the tangent [m], duration [s]
      real(wp), intent(in) :: speed           !! [m/s]
      type(roll_t), intent(inout) :: roll
      logical, intent(out) :: off
      real(wp) :: slide_length, duration, drop

      roll%rolls = .true.
      roll%from_table = .true.
      roll%path%heading = t(1:2)
      slide_length = length
      duration = time
      call find_slide_end(dem, landing, slide_length, roll)
      off = falls_away(landing%z - roll%landing%z, t(3), slide_length, gravity, time) > 0
      if (off) then
         slide_length = 0
         duration = 0
         call find_slide_end(dem, landing, slide_length, roll)
      end if
      drop = landing%z - roll%landing%z
      call time_slide(t(1), t(2), slide_length, drop, duration, speed, roll%length, roll%landing%time, roll%waits)
      roll%path%patch = landing%patch
      roll%path%x = landing%x
      roll%path%y = landing%y
      roll%path%z = landing%z
      roll%path%v = 0
      if (roll%landing%time > 0) roll%path%v = 1/roll%landing%time*[slide_length*t(1), slide_length*t(2), -drop]
      roll%path%above = 0
      roll%path%rate = 0
   end subroutine find_slide

   !> Find the end of a slide: on its first patch, or where `move_along` ends.
   pure subroutine find_slide_end(dem, start, length, roll)
      type(terrain_t), intent(in) :: dem
      type(landing_t), intent(in) :: start
      real(wp), intent(inout) :: length  !! as in walk_patches
      type(roll_t), intent(inout) :: roll
      real(wp) :: inside

      associate (p => start%patch, end => roll%landing)
         call slide_on_patch(start%x, start%y, start%z, start%u, start%w, roll%path%heading(1), &
                             roll%path%heading(2), length, dem%per_cell, real(p%i, wp), real(p%j, wp), p%z00, p%a, &
                             p%b, p%c, end%x, end%y, end%z, end%u, end%w, inside)
         end%contact = .true.
         end%jump_height = 0
         end%patch = p
      end associate
      if (.not. inside > 0) call move_along(dem, start, length, roll)
   end subroutine find_slide_end

   !> End of a slide that stays inside its first patch; a slide without length ends exactly at its start.
   elemental subroutine slide_on_patch(x, y, z, u, w, t1, t2, length, per_cell, i, j, z00, a, b, c, x_end, y_end, &
                                       z_end, u_end, w_end, inside)
      real(wp), intent(in) :: x, y, z, u, w       !! start of the slide, as in landing_t [m], [cells]
      real(wp), intent(in) :: t1, t2, length      !! as in find_slide [-], [m]
      real(wp), intent(in) :: per_cell            !! [1/m]
      real(wp), intent(in) :: i, j, z00, a, b, c  !! as in patch_t [-], [m]
      real(wp), intent(out) :: x_end, y_end, z_end  !! [m]
      real(wp), intent(out) :: u_end, w_end         !! position in the patch, 0..1 [cells]
      real(wp), intent(out) :: inside               !! 1 if the slide ends inside the patch, else 0
      real(wp) :: beyond

      x_end = x + length*t1
      y_end = y + length*t2
      u_end = fraction_of(per_cell, x_end, i)
      w_end = fraction_of(per_cell, y_end, j)
      beyond = abs(x_end*per_cell - (i - 1) - u_end) + abs(y_end*per_cell - (j - 1) - w_end)
      inside = merge(0.0_wp, 1.0_wp, beyond > 0)
      inside = merge(inside, 1.0_wp, length > 0)
      u_end = merge(u_end, u, length > 0)
      w_end = merge(w_end, w, length > 0)
      z_end = merge(height_at(z00, a, b, c, u_end, w_end), z, length > 0)
   end subroutine slide_on_patch

   !> Return 1 if the ground falls away from a boulder during a slide, else 0.
   elemental real(wp) function falls_away(drop, t3, length, gravity, time)
      real(wp), intent(in) :: drop              !! drop of the ground [m]
      real(wp), intent(in) :: t3, length, time  !! as in find_slide [-], [m], [s]
      real(wp), intent(in) :: gravity           !! [m/s2]

      falls_away = merge(1.0_wp, 0.0_wp, drop + length*t3 > 0.5_wp*gravity*time*time + hold_tolerance*length)
   end function falls_away

   !> Length of a slide, its duration, and the waiting time at its end.
   elemental subroutine time_slide(t1, t2, length, drop, time, speed, distance, slides, waits)
      real(wp), intent(in) :: t1, t2, length, time, speed  !! as in find_slide [-], [m], [s], [m/s]
      real(wp), intent(in) :: drop                         !! drop of the ground [m]
      real(wp), intent(out) :: distance                    !! length of the slide [m]
      real(wp), intent(out) :: slides, waits               !! duration of the slide and waiting time [s]

      distance = sqrt(length*length*(t1*t1 + t2*t2) + drop*drop)
      distance = merge(distance, 0.0_wp, length > 0)  ! without length, the drop is a rounding error
      slides = min(time, distance/max(speed, tiny(speed)/epsilon(speed)))
      waits = time - slides
   end subroutine time_slide

   pure type(flight_t) function flight_after_roll(dem, roll, landing, v) result(flight)
      type(terrain_t), intent(in) :: dem
      type(roll_t), intent(in) :: roll
      type(landing_t), intent(in) :: landing
      real(wp), intent(in) :: v(3)  !! [m/s]

      if (.not. roll%from_table) then
         flight = flight_from(dem, landing, v, roll%path%heading)
      else
         flight = flight_from(dem, landing, v, roll%heading)
         flight%above = flight%above + roll%above
         flight%z = flight%z + roll%above
      end if
   end function flight_after_roll

   !> Move a distance along the heading, patch by patch, up to its end or to the edge of the known terrain.
   pure subroutine move_along(dem, start, length, roll)
      type(terrain_t), intent(in) :: dem
      type(landing_t), intent(in) :: start
      real(wp), intent(inout) :: length  !! length in plan; on return the distance covered [m]
      type(roll_t), intent(inout) :: roll
      type(patch_t) :: patch, beyond

      patch = start%patch
      associate (end => roll%landing)
         call walk_patches(dem, start%x, start%y, roll%path%heading, length, patch, beyond, end%contact)
         end%x = start%x + length*roll%path%heading(1)
         end%y = start%y + length*roll%path%heading(2)
         end%u = patch_position(dem, end%x, patch%i)
         end%w = patch_position(dem, end%y, patch%j)
         end%z = height(patch, end%u, end%w)
         end%jump_height = 0
         end%patch = patch
         if (.not. end%contact) end%patch = beyond
      end associate
   end subroutine move_along

   !> Find the patch on which a straight path ends, or the last known patch on the way.
   pure subroutine walk_patches(dem, x, y, heading, length, patch, beyond, known)
      type(terrain_t), intent(in) :: dem
      real(wp), intent(in) :: x, y           !! start of the path [m]
      real(wp), intent(in) :: heading(2)     !! heading of any length
      real(wp), intent(inout) :: length      !! path length over |heading|; on return, that of the known part [-]
      type(patch_t), intent(inout) :: patch  !! patch at the start; on return at the end
      type(patch_t), intent(out) :: beyond   !! the unknown patch, if any
      logical, intent(out) :: known          !! the whole path is known
      type(patch_t) :: next
      real(wp) :: inverse(2), tx, ty
      integer :: step(2)

      step = merge(1, -1, heading > 0)
      inverse = inverse_speed(heading, dem%cell)
      known = .true.
      do
         tx = side_time(x, heading(1), real(patch%i, wp), dem%cell, inverse(1))
         ty = side_time(y, heading(2), real(patch%j, wp), dem%cell, inverse(2))
         if (min(tx, ty) >= length) return
         call read_patch(dem, patch%i + merge(step(1), 0, tx <= ty), patch%j + merge(0, step(2), tx <= ty), next)
         if (.not. next%known) exit
         patch = next
      end do
      known = .false.
      beyond = next
      length = max(0.0_wp, min(tx, ty))
   end subroutine walk_patches

   !> Return whether a patch of the terrain lies outside the current window. If so, the window cannot show whether a
   !> boulder at its edge comes to rest: the boulder leaves the window and is traced again.
   pure logical function outside_window(dem, patch)
      type(terrain_t), intent(in) :: dem
      type(patch_t), intent(in) :: patch

      outside_window = patch%i >= 1 .and. patch%j >= 1 .and. patch%i < dem%nx .and. patch%j < dem%ny &
                       .and. .not. in_window(dem, patch%i, patch%j)
   end function outside_window

   !> Rolling speed [m/s] after a fraction of the path.
   pure real(wp) function speed_within(roll, fraction)
      type(roll_t), intent(in) :: roll
      real(wp), intent(in) :: fraction  !! 0..1 [-]

      speed_within = sqrt(roll%speed2(1) + fraction*(roll%speed2(2) - roll%speed2(1)))
   end function speed_within

   !> End a roll at an obstacle, at the given time after its start.
   pure subroutine cut_roll(dem, roll, time, landing)
      type(terrain_t), intent(in) :: dem
      type(roll_t), intent(in) :: roll
      real(wp), intent(in) :: time  !! time since the start of the roll [s]
      type(landing_t), intent(out) :: landing

      landing = roll%landing
      landing%contact = .false.
      landing%time = time
      landing%x = roll%path%x + time*roll%path%v(1)
      landing%y = roll%path%y + time*roll%path%v(2)
      call read_patch(dem, floor(landing%x*dem%per_cell) + 1, floor(landing%y*dem%per_cell) + 1, landing%patch)
      if (.not. landing%patch%known) landing%patch = roll%path%patch  ! the obstacle is at the edge of the known terrain
      landing%u = patch_position(dem, landing%x, landing%patch%i)
      landing%w = patch_position(dem, landing%y, landing%patch%j)
      landing%z = height(landing%patch, landing%u, landing%w)
   end subroutine cut_roll

   !> Points between the start and the end of a straight path along the ground, so that chords follow the terrain: where
   !> the path enters a new patch, and within a patch as its curvature requires.
   pure subroutine ground_points(dem, path, duration, radius, time, place)
      type(terrain_t), intent(in) :: dem
      type(flight_t), intent(in) :: path
      real(wp), intent(in) :: duration  !! [s]
      real(wp), intent(in) :: radius    !! R_b [m]
      real(wp), allocatable, intent(out) :: time(:)      !! times since the start of the path, increasing [s]
      real(wp), allocatable, intent(out) :: place(:, :)  !! (3, size(time)): x, y, z [m]
      type(patch_t) :: patch, next
      real(wp) :: inverse(2), tx, ty, entered, left, sag, at
      integer :: step(2), parts, k

      allocate (time(0), place(3, 0))
      patch = path%patch
      step = merge(1, -1, path%v(1:2) > 0)
      inverse = inverse_speed(path%v(1:2), dem%cell)
      entered = 0
      do
         tx = side_time(path%x, path%v(1), real(patch%i, wp), dem%cell, inverse(1))
         ty = side_time(path%y, path%v(2), real(patch%j, wp), dem%cell, inverse(2))
         left = min(tx, ty, duration)
         if (left > entered) then
            sag = abs(patch%c*path%v(1)*path%v(2))*(0.5_wp*(left - entered)*dem%per_cell)**2
            parts = ceiling(sqrt(min(sag/(chord_tolerance*radius), 1.0e6_wp)))
            do k = 1, max(1, parts)
               at = merge(left, entered + (left - entered)*k/max(1, parts), k >= parts)
               if (.not. at < duration*(1 - end_tolerance)) exit
               associate (x => path%x + at*path%v(1), y => path%y + at*path%v(2))
                  time = [time, at]
                  place = reshape([place, x, y, height(patch, patch_position(dem, x, patch%i), &
                                                       patch_position(dem, y, patch%j))], [3, size(time)])
               end associate
            end do
            entered = left
         end if
         if (min(tx, ty) >= duration) return
         call read_patch(dem, patch%i + merge(step(1), 0, tx <= ty), patch%j + merge(0, step(2), tx <= ty), next)
         if (.not. next%known) return
         patch = next
      end do
   end subroutine ground_points
end module rockfall_rolling
