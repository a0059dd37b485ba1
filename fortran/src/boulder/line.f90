! SPDX-License-Identifier: BSD-3-Clause
!> Evaluation lines: polylines in plan where the first crossing of each boulder is recorded.
module rockfall_line
   use rockfall_kinds, only: wp
   implicit none
   private
   public :: line_t, line, first_crossing, next_crossing, boxes_touch

   !> A polyline.
   type :: line_t
      real(wp), allocatable :: x(:), y(:)     !! vertices, local coordinates [m]
      real(wp) :: low(2), high(2)             !! bounding box [m]
   end type line_t

contains

   !> Build a polyline from its vertices.
   pure type(line_t) function line(x, y)
      real(wp), intent(in) :: x(:), y(:)  !! at least two vertices [m]

      allocate (line%x, source=x)
      allocate (line%y, source=y)
      line%low = [minval(x), minval(y)]
      line%high = [maxval(x), maxval(y)]
   end function line

   !> First crossing of a line by the plan path from a to b: fraction of the path in 0..1 [-], or 2 if there is none.
   !> The side of a point is a sign, with zero on the left, so a path that ends on the line and continues from there
   !> crosses it once.
   pure real(wp) function first_crossing(this, a, b) result(fraction)
      type(line_t), intent(in) :: this
      real(wp), intent(in) :: a(2), b(2)  !! [m]

      fraction = next_crossing(this, a, b, -1.0_wp)
   end function first_crossing

   !> First crossing after a given fraction of the path.
   pure real(wp) function next_crossing(this, a, b, after) result(fraction)
      type(line_t), intent(in) :: this
      real(wp), intent(in) :: a(2), b(2)  !! [m]
      real(wp), intent(in) :: after       !! [-]
      real(wp) :: side_a, side_b, p(2), q(2), at
      integer :: k

      fraction = 2
      if (.not. boxes_touch(this%low(1), this%low(2), this%high(1), this%high(2), a(1), a(2), b(1), b(2)) > 0) return
      do k = 1, size(this%x) - 1
         p = [this%x(k), this%y(k)]
         q = [this%x(k + 1), this%y(k + 1)]
         side_a = cross_product(q - p, a - p)
         side_b = cross_product(q - p, b - p)
         if ((side_a >= 0) .eqv. (side_b >= 0)) cycle
         if ((cross_product(b - a, p - a) >= 0) .eqv. (cross_product(b - a, q - a) >= 0)) cycle
         at = side_a/(side_a - side_b)
         if (at > after) fraction = min(fraction, at)
      end do
   end function next_crossing

   !> Return 1 if the bounding boxes of a line and of a path from a to b touch, else 0 and the path does not cross the
   !> line; a number, so that loops vectorise.
   elemental real(wp) function boxes_touch(low1, low2, high1, high2, a1, a2, b1, b2) result(near)
      real(wp), intent(in) :: low1, low2, high1, high2  !! of the line [m]
      real(wp), intent(in) :: a1, a2, b1, b2            !! [m]

      near = merge(1.0_wp, 0.0_wp, min(a1, b1) <= high1)
      near = merge(near, 0.0_wp, min(a2, b2) <= high2)
      near = merge(near, 0.0_wp, max(a1, b1) >= low1)
      near = merge(near, 0.0_wp, max(a2, b2) >= low2)
   end function boxes_touch

   !> Vertical component of a x b [m2], > 0 if b is left of a: twice the area of the triangle that they span.
   pure real(wp) function cross_product(a, b)
      real(wp), intent(in) :: a(2), b(2)  !! [m]

      cross_product = a(1)*b(2) - a(2)*b(1)
   end function cross_product
end module rockfall_line
