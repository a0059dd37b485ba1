! SPDX-License-Identifier: BSD-3-Clause
!> Free flight: a parabola over bilinear patches. Along its straight plan path the height above a patch is quadratic
!> in time, so the landing is the root of a quadratic: no time step, no iteration, no tolerance.
module rockfall_flight
   use rockfall_kinds, only: wp
   use rockfall_math, only: logarithm
   use rockfall_terrain, only: terrain_t, patch_t, read_patch, height, height_at, gradient, patch_position, fraction_of
   implicit none
   private
   public :: flight_t, landing_t, span_t, fly, end_flight, flight_from, launch_rate, arc_length, parabola_length, &
             no_hit_time
   public :: inverse_speed, exit_time, side_time, curvature, strikes_ground, strike_time, max_height, enter_patch, &
             place_on_patch

   real(wp), parameter :: no_hit_time = 1.0e30_wp  !! longer than any flight, and its square does not overflow [s]
   real(wp), parameter :: at_rest = 1.0e-200_wp  !! squared plan speed that is negligible for path lengths [m2/s2]

   !> Start of a flight.
   type :: flight_t
      type(patch_t) :: patch = patch_t()  !! patch below the start
      real(wp) :: x, y, z              !! [m]
      real(wp) :: v(3)                 !! [m/s]
      real(wp) :: above = 0.0_wp       !! height above the patch, >= 0 [m]
      real(wp) :: rate                 !! rate of change of `above`, known exactly after a rebound [m/s]
      real(wp) :: heading(2) = 0.0_wp  !! heading of the tangential velocity after the rebound, in plan, of any length
   end type flight_t

   !> End of a flight: the first contact, or the exit from the known terrain.
   type :: landing_t
      logical :: contact               !! false: the boulder left the domain
      real(wp) :: time                 !! flight time [s]
      real(wp) :: x, y, z              !! [m]
      type(patch_t) :: patch           !! patch of the contact
      real(wp) :: u, w                 !! position in the patch, 0..1 [cells]
      real(wp) :: jump_height          !! maximum height above the surface [m]
   end type landing_t

   !> Part of a flight over one patch: height above it = d0 + d1 s + d2 s**2 for s = t - t0 in 0..t1-t0.
   type :: span_t
      integer :: i, j         !! indices of the patch
      real(wp) :: t0, t1      !! time since the start of the flight [s]
      real(wp) :: d0, d1, d2  !! [m], [m/s], [m/s2]
   end type span_t

contains

   !> Rate of change of the height above a patch [m/s].
   pure real(wp) function launch_rate(dem, patch, u, w, v)
      type(terrain_t), intent(in) :: dem
      type(patch_t), intent(in) :: patch
      real(wp), intent(in) :: u, w  !! position in the patch, 0..1 [cells]
      real(wp), intent(in) :: v(3)  !! [m/s]

      launch_rate = v(3) - dot_product(gradient(dem, patch, u, w), v(1:2))
   end function launch_rate

   !> Compute a flight to its first contact after the start, or to the edge of the known terrain.
   !>
   !> The height at the entry to a patch is always >= 0, so no boulder can pass through the ground: it equals the height
   !> at the exit from the previous patch, and negative rounding errors count as zero. At zero height a descending
   !> boulder is in contact at once, a rising boulder is not.
   !>
   !> Over the patch z00 + a u + b w + c u w the path has u = u0 + p t, w = w0 + q t [cells], so the height above it,
   !> z(t) - z_patch(u(t), w(t)), is d0 + d1 s + d2 s**2 with d1 = vz - (a + c w) p - (b + c u) q and d2 = -g/2 - c p q
   !> (theory, chapter 4).
   pure subroutine fly(dem, gravity, start, landing, spans, n_spans)
      type(terrain_t), intent(in) :: dem
      real(wp), intent(in) :: gravity                       !! [m/s2]
      type(flight_t), intent(in) :: start
      type(landing_t), intent(out) :: landing
      type(span_t), intent(inout), contiguous, optional :: spans(:)  !! at least nx + ny elements
      integer, intent(out), optional :: n_spans
      type(patch_t) :: patch
      real(wp) :: inverse(2), p, q, t0, t1, tx, ty, s, d0, d1, d2
      integer :: step(2), i, j
      logical :: contact

      patch = start%patch
      step = merge(1, -1, start%v(1:2) > 0)
      inverse = inverse_speed(start%v(1:2), dem%cell)
      p = start%v(1)*dem%per_cell
      q = start%v(2)*dem%per_cell
      t0 = 0
      d0 = start%above
      d1 = start%rate
      landing%jump_height = 0
      if (present(n_spans)) n_spans = 0
      do
         tx = side_time(start%x, start%v(1), real(patch%i, wp), dem%cell, inverse(1))
         ty = side_time(start%y, start%v(2), real(patch%j, wp), dem%cell, inverse(2))
         t1 = max(t0, min(tx, ty))
         d2 = curvature(gravity, patch%c, p, q)
         contact = strikes_ground(d0, d1, d2, t1 - t0) > 0
         s = t1 - t0
         if (contact) s = strike_time(d0, d1, d2, t1 - t0)
         landing%jump_height = max(landing%jump_height, max_height(d0, d1, d2, 0.0_wp, s))
         if (present(spans)) then
            n_spans = n_spans + 1
            spans(n_spans) = span_t(patch%i, patch%j, t0, t0 + s, d0, d1, d2)
         end if
         if (contact) exit
         t0 = t1
         i = patch%i + merge(step(1), 0, tx <= ty)
         j = patch%j + merge(0, step(2), tx <= ty)
         call read_patch(dem, i, j, patch)
         if (.not. patch%known) exit
         call enter_patch(start%x, start%y, start%z, start%v(1), start%v(2), start%v(3), gravity, dem%per_cell, t0, &
                          real(patch%i, wp), real(patch%j, wp), patch%z00, patch%a, patch%b, patch%c, d0, d1)
      end do
      landing%contact = contact
      landing%patch = patch
      landing%time = t0
      if (contact) landing%time = t0 + s
      landing%x = start%x + start%v(1)*landing%time
      landing%y = start%y + start%v(2)*landing%time
      landing%z = start%z + landing%time*(start%v(3) - 0.5_wp*gravity*landing%time)
      if (contact) call put_on_surface(dem, landing)
   end subroutine fly

   !> End a flight in the air, at a time within its first n spans.
   pure subroutine end_flight(dem, gravity, start, time, spans, n, landing)
      type(terrain_t), intent(in) :: dem
      real(wp), intent(in) :: gravity     !! [m/s2]
      type(flight_t), intent(in) :: start
      real(wp), intent(in) :: time        !! time since the start of the flight [s]
      type(span_t), intent(inout), contiguous :: spans(:)
      integer, intent(inout) :: n
      type(landing_t), intent(inout) :: landing
      integer :: k

      do k = 1, n - 1
         if (spans(k)%t1 >= time) exit
      end do
      n = min(k, n)
      spans(n)%t1 = time
      landing%contact = .false.
      landing%time = time
      landing%x = start%x + start%v(1)*time
      landing%y = start%y + start%v(2)*time
      landing%z = start%z + time*(start%v(3) - 0.5_wp*gravity*time)
      call read_patch(dem, spans(n)%i, spans(n)%j, landing%patch)
      landing%u = patch_position(dem, landing%x, landing%patch%i)
      landing%w = patch_position(dem, landing%y, landing%patch%j)
      landing%jump_height = 0
      do k = 1, n
         associate (s => spans(k))
            landing%jump_height = max(landing%jump_height, max_height(s%d0, s%d1, s%d2, 0.0_wp, s%t1 - s%t0))
         end associate
      end do
   end subroutine end_flight

   !> Continue from a point in the air with a new velocity.
   pure type(flight_t) function flight_from(dem, landing, v, heading) result(flight)
      type(terrain_t), intent(in) :: dem
      type(landing_t), intent(in) :: landing
      real(wp), intent(in) :: v(3)        !! [m/s]
      real(wp), intent(in) :: heading(2)  !! as in flight_t

      flight%patch = landing%patch
      flight%x = landing%x
      flight%y = landing%y
      flight%z = landing%z
      flight%v = v
      flight%above = max(0.0_wp, landing%z - height(landing%patch, landing%u, landing%w))
      flight%rate = launch_rate(dem, landing%patch, landing%u, landing%w, v)
      flight%heading = heading
   end function flight_from

   !> Inverse speed [s/m]; 0 if the boulder is practically at rest.
   elemental real(wp) function inverse_speed(v, cell)
      real(wp), intent(in) :: v     !! [m/s]
      real(wp), intent(in) :: cell  !! cell size [m]

      inverse_speed = 1/merge(v, 1.0_wp, abs(v)*no_hit_time > cell)
      inverse_speed = merge(inverse_speed, 0.0_wp, abs(v)*no_hit_time > cell)
   end function inverse_speed

   !> Time at which a coordinate reaches an edge between patches [s].
   elemental real(wp) function exit_time(x, edge, cell, inverse)
      real(wp), intent(in) :: x, cell  !! coordinate at the start [m]; cell size [m]
      real(wp), intent(in) :: edge     !! index of the edge, 0.. [-]
      real(wp), intent(in) :: inverse  !! as returned by inverse_speed [s/m]

      exit_time = (edge*cell - x)*inverse
      exit_time = merge(exit_time, no_hit_time, abs(inverse) > 0)
   end function exit_time

   !> Time at which a coordinate reaches the side of patch interval k in its direction of motion [s].
   elemental real(wp) function side_time(x, v, k, cell, inverse)
      real(wp), intent(in) :: x, v, cell  !! coordinate and velocity at the start [m], [m/s]; cell size [m]
      real(wp), intent(in) :: k           !! an integer [-]
      real(wp), intent(in) :: inverse     !! as returned by inverse_speed [s/m]

      side_time = exit_time(x, k + merge(0.0_wp, -1.0_wp, v > 0), cell, inverse)
   end function side_time

   !> d2 of the height d0 + d1 s + d2 s**2 above a patch [m/s2].
   elemental real(wp) function curvature(gravity, c, p, q)
      real(wp), intent(in) :: gravity  !! [m/s2]
      real(wp), intent(in) :: c        !! as in patch_t [m]
      real(wp), intent(in) :: p, q     !! speeds in plan [cells/s]

      curvature = -0.5_wp*gravity - c*p*q
   end function curvature

   !> Return 1 if d0 + d1 s + d2 s**2, with d0 >= 0, becomes negative for s in 0..length, else 0.
   elemental real(wp) function strikes_ground(d0, d1, d2, length)
      real(wp), intent(in) :: d0, d1, d2  !! [m], [m/s], [m/s2]
      real(wp), intent(in) :: length      !! length of the span [s]
      real(wp) :: dips  ! minimum inside the span

      dips = merge(1.0_wp, 0.0_wp, d1*d1 >= 4*d2*d0)
      dips = merge(dips, 0.0_wp, -d1 < 2*d2*length)
      dips = merge(dips, 0.0_wp, d1 < 0)
      dips = merge(dips, 0.0_wp, d2 > 0)
      strikes_ground = merge(1.0_wp, dips, d0 + length*(d1 + length*d2) < 0)
   end function strikes_ground

   !> First time [s] at which the height becomes negative, if it does. The form of the root avoids cancellation.
   elemental real(wp) function strike_time(d0, d1, d2, length) result(s)
      real(wp), intent(in) :: d0, d1, d2  !! as in strikes_ground
      real(wp), intent(in) :: length      !! length of the span [s]
      real(wp) :: root, numerator, denominator

      root = sqrt(max(0.0_wp, d1*d1 - 4*d2*d0))
      numerator = merge(2*d0, d1 + root, d1 < 0)
      denominator = merge(root - d1, merge(-2*d2, 1.0_wp, d2 < 0), d1 < 0)
      s = min(numerator/denominator, length)
   end function strike_time

   !> Maximum of d0 + d1 s + d2 s**2 in from..to [m]: at either end, or at the vertex s = -d1/(2 d2).
   elemental real(wp) function max_height(d0, d1, d2, from, to)
      real(wp), intent(in) :: d0, d1, d2  !! [m], [m/s], [m/s2]
      real(wp), intent(in) :: from, to    !! 0 <= from <= to [s]
      real(wp) :: vertex, within  ! 1 if the vertex lies within the interval, else 0

      vertex = d0 - d1*d1/merge(4*d2, 1.0_wp, d2 < 0)
      within = merge(1.0_wp, 0.0_wp, d1 < -2*d2*to)
      within = merge(within, 0.0_wp, d1 > -2*d2*from)
      max_height = max(d0 + from*(d1 + from*d2), d0 + to*(d1 + to*d2))
      max_height = merge(vertex, max_height, within > 0)
   end function max_height

   !> Height above a patch where a flight enters it, and rate of change of this height.
   elemental subroutine enter_patch(x, y, z, v1, v2, v3, gravity, per_cell, t, i, j, z00, a, b, c, d0, d1)
      real(wp), intent(in) :: x, y, z, v1, v2, v3  !! start of the flight [m], [m/s]
      real(wp), intent(in) :: gravity              !! [m/s2]
      real(wp), intent(in) :: per_cell             !! [1/m]
      real(wp), intent(in) :: t                    !! time since the start [s]
      real(wp), intent(in) :: i, j, z00, a, b, c   !! as in patch_t [-], [m]
      real(wp), intent(out) :: d0, d1              !! [m], [m/s]
      real(wp) :: u, w

      u = fraction_of(per_cell, x + v1*t, i)
      w = fraction_of(per_cell, y + v2*t, j)
      d0 = max(0.0_wp, z + t*(v3 - 0.5_wp*gravity*t) - height_at(z00, a, b, c, u, w))
      d1 = (v3 - gravity*t) - ((a + c*w)*(v1*per_cell) + (b + c*u)*(v2*per_cell))
   end subroutine enter_patch

   !> Place a contact exactly on its patch, so that rounding errors do not accumulate over thousands of rebounds.
   pure subroutine put_on_surface(dem, landing)
      type(terrain_t), intent(in) :: dem
      type(landing_t), intent(inout) :: landing

      real(wp) :: x, y

      x = landing%x
      y = landing%y
      associate (p => landing%patch)
         call place_on_patch(x, y, dem%cell, dem%per_cell, real(p%i, wp), real(p%j, wp), p%z00, p%a, p%b, p%c, &
                             landing%u, landing%w, landing%x, landing%y, landing%z)
      end associate
   end subroutine put_on_surface

   !> Nearest point of a patch in plan: position in the patch, and coordinates.
   elemental subroutine place_on_patch(x, y, cell, per_cell, i, j, z00, a, b, c, u, w, x_on, y_on, z_on)
      real(wp), intent(in) :: x, y                !! [m]
      real(wp), intent(in) :: cell, per_cell      !! cell size, its inverse [m], [1/m]
      real(wp), intent(in) :: i, j, z00, a, b, c  !! as in patch_t [-], [m]
      real(wp), intent(out) :: u, w               !! 0..1 [cells]
      real(wp), intent(out) :: x_on, y_on, z_on   !! [m]

      u = fraction_of(per_cell, x, i)
      w = fraction_of(per_cell, y, j)
      x_on = (i - 1 + u)*cell
      y_on = (j - 1 + w)*cell
      z_on = height_at(z00, a, b, c, u, w)
   end subroutine place_on_patch

   !> Length [m] of a parabola over a time: with the plan speed h and the vertical speed w = v3 - g t, the integral
   !> of s = sqrt(h**2 + w**2) over dt is (F(w0) - F(w1))/(2 g), F(w) = w s + h**2 ln(w + s). And since
   !> (w + s)(s - w) = h**2 at both ends, (w0 + s0)/(w1 + s1) = (s0 + s1 + g t)/(s0 + s1 - g t).
   pure real(wp) function arc_length(v, gravity, time)
      real(wp), intent(in) :: v(3)     !! velocity at the start [m/s]
      real(wp), intent(in) :: gravity  !! [m/s2]
      real(wp), intent(in) :: time     !! flight time [s]

      arc_length = parabola_length(v(1)*v(1) + v(2)*v(2), v(3), gravity, time)
   end function arc_length

   !> Length [m] of a parabola from the squared plan speed and the vertical speed.
   elemental real(wp) function parabola_length(plan2, v3, gravity, time) result(length)
      real(wp), intent(in) :: plan2    !! [m2/s2]
      real(wp), intent(in) :: v3       !! vertical speed at the start [m/s]
      real(wp), intent(in) :: gravity  !! [m/s2]
      real(wp), intent(in) :: time     !! flight time [s]
      real(wp) :: fall, v1, s0, s1, speed_sum, area

      fall = gravity*time
      v1 = v3 - fall
      s0 = sqrt(plan2 + v3*v3)
      s1 = sqrt(plan2 + v1*v1)
      speed_sum = s0 + s1
      ! If rounding cancels the whole difference, plan2 is negligible.
      area = plan2*logarithm((speed_sum + fall)/max(speed_sum - fall, epsilon(speed_sum)*speed_sum, tiny(speed_sum)))
      if (.not. plan2 > at_rest) area = 0
      length = max(0.0_wp, 0.5_wp*(v3*s0 - v1*s1 + area)/gravity)  ! terms cancel for short hops
   end function parabola_length
end module rockfall_flight
