! SPDX-License-Identifier: BSD-3-Clause
!> The product's flight, with an audit of each flight in numbers with a 64-bit mantissa (128-bit storage if the
!> processor lacks them). The audit crosses the patches by its own code, independent of the flight. Its error replaces
!> the jump height, so that the maximum of each boulder is recorded.
module audited_flight
   use rockfall_kinds, only: wp
   use rockfall_terrain, only: terrain_t
   use rockfall_flight, only: flight_t, landing_t, span_t, fly_exactly => fly
   implicit none
   private
   public :: fly

   integer, parameter :: xp = selected_real_kind(18)

contains

   !> `fly` of the product, with the error of the flight [m] as jump height: the maximum of its depth below the ground,
   !> the distance of its contact from the parabola at the time of contact, and its distance beyond the known terrain.
   pure subroutine fly(dem, gravity, start, landing, spans, n_spans)
      type(terrain_t), intent(in) :: dem
      real(wp), intent(in) :: gravity                       !! [m/s2]
      type(flight_t), intent(in) :: start
      type(landing_t), intent(out) :: landing
      type(span_t), intent(inout), optional :: spans(:)
      integer, intent(out), optional :: n_spans
      real(xp) :: off(3)

      call fly_exactly(dem, gravity, start, landing, spans, n_spans)
      off = [landing%x, landing%y, landing%z] - place(start, gravity, real(landing%time, xp))
      landing%jump_height = real(max(depth(dem, gravity, start, landing), sqrt(sum(off**2))), wp)
   end subroutine fly

   !> Position on the parabola [m] at a time after its start [s].
   pure function place(start, gravity, t)
      type(flight_t), intent(in) :: start
      real(wp), intent(in) :: gravity
      real(xp), intent(in) :: t
      real(xp) :: place(3)

      place = [real(start%x, xp), real(start%y, xp), real(start%z, xp)] + start%v*t
      place(3) = place(3) - 0.5_xp*gravity*t*t
   end function place

   !> Maximum depth [m] of a flight below the ground, from side to side of the patches below it.
   pure real(xp) function depth(dem, gravity, start, landing)
      type(terrain_t), intent(in) :: dem
      real(wp), intent(in) :: gravity
      type(flight_t), intent(in) :: start
      type(landing_t), intent(in) :: landing
      real(xp) :: t0, t1, next(2), middle(3)
      real(wp) :: across  !! speed across the side crossed last [m/s]
      integer :: node(2), axis

      depth = 0
      node = [start%patch%i, start%patch%j]
      node = node - merge(1, 0, start%v(1:2) < 0)  ! the side behind; times before the start are ignored
      t0 = 0
      across = norm2(start%v(1:2))
      do
         do axis = 1, 2
            call next_side(merge(start%x, start%y, axis == 1), start%v(axis), dem%cell, t0, node(axis), next(axis))
         end do
         t1 = min(minval(next), real(landing%time, xp))
         middle = place(start, gravity, 0.5_xp*(t0 + t1))
         depth = max(depth, depth_over(dem, gravity, start, t0, t1, across, &
                                       patch_index(middle(1), start%v(1), start%patch%i, dem%cell), &
                                       patch_index(middle(2), start%v(2), start%patch%j, dem%cell)))
         if (t1 >= landing%time) exit
         t0 = t1
         across = abs(start%v(minloc(next, dim=1)))
      end do
   end function depth

   !> First time after t0 [s] at which a coordinate reaches a side of the patch.
   pure subroutine next_side(x, v, cell, t0, node, t)
      real(wp), intent(in) :: x, v, cell
      real(xp), intent(in) :: t0
      integer, intent(inout) :: node  !! number of a side that is not beyond this side
      real(xp), intent(out) :: t

      t = huge(t)
      if (.not. abs(v) > 0) return
      do
         t = (node*real(cell, xp) - x)/v
         if (t > t0) return
         node = node + merge(1, -1, v > 0)
      end do
   end subroutine next_side

   !> Patch interval at a coordinate; for a flight along a side, that of the start.
   pure integer function patch_index(x, v, first, cell) result(i)
      real(xp), intent(in) :: x
      real(wp), intent(in) :: v, cell
      integer, intent(in) :: first

      i = first
      if (abs(v) > 0) i = floor(x/cell) + 1
   end function patch_index

   !> Maximum depth [m] of a flight below patch (i, j) from t0 to t1 [s], from the minimum of a quadratic. If the patch
   !> is unknown: the distance beyond the side that was crossed.
   pure real(xp) function depth_over(dem, gravity, start, t0, t1, across, i, j) result(depth)
      type(terrain_t), intent(in) :: dem
      real(wp), intent(in) :: gravity, across
      type(flight_t), intent(in) :: start
      real(xp), intent(in) :: t0, t1
      integer, intent(in) :: i, j
      real(xp) :: z(0:1, 0:1), p(3), u, w, du, dw, d(0:2), length

      length = t1 - t0
      if (i < 1 .or. j < 1 .or. i >= dem%nx .or. j >= dem%ny) then
         depth = length*across
         return
      end if
      z = elevations(dem, i, j)
      if (any(z /= z)) then
         depth = length*across
         return
      end if
      p = place(start, gravity, t0)
      u = p(1)/dem%cell - (i - 1)
      w = p(2)/dem%cell - (j - 1)
      du = start%v(1)/real(dem%cell, xp)
      dw = start%v(2)/real(dem%cell, xp)
      d(0) = p(3) - ((1 - w)*((1 - u)*z(0, 0) + u*z(1, 0)) + w*((1 - u)*z(0, 1) + u*z(1, 1)))
      d(1) = start%v(3) - gravity*t0 - du*((1 - w)*(z(1, 0) - z(0, 0)) + w*(z(1, 1) - z(0, 1))) &
             - dw*((1 - u)*(z(0, 1) - z(0, 0)) + u*(z(1, 1) - z(1, 0)))
      d(2) = -0.5_xp*gravity - du*dw*((z(1, 1) - z(0, 1)) - (z(1, 0) - z(0, 0)))
      depth = -min(d(0), d(0) + length*(d(1) + length*d(2)))
      if (d(2) > 0 .and. d(1) < 0 .and. -d(1) < 2*d(2)*length) depth = -(d(0) - d(1)*d(1)/(4*d(2)))
   end function depth_over

   !> Elevations of a patch's corners [m].
   pure function elevations(dem, i, j) result(z)
      type(terrain_t), intent(in) :: dem
      integer, intent(in) :: i, j
      real(xp) :: z(0:1, 0:1)
      integer :: r

      r = dem%ny + 1 - j
      if (associated(dem%z8)) then
         z = dem%z8(i:i + 1, r:r - 1:-1)
      else
         z = dem%z4(i:i + 1, r:r - 1:-1)
      end if
   end function elevations
end module audited_flight
