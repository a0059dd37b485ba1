! SPDX-License-Identifier: BSD-3-Clause
!> Evaluation lines: polylines in plan where the first crossing of each boulder is recorded. A line with a width is an
!> object: a boulder meets it as soon as its side touches it.
module rockfall_line
   use rockfall_kinds, only: wp
   implicit none
   private
   public :: line_t, line, object_line, first_meeting, first_crossing, next_crossing, boxes_touch

   !> A polyline.
   type :: line_t
      real(wp), allocatable :: x(:), y(:)     !! vertices, local coordinates [m]
      real(wp) :: low(2), high(2)             !! bounding box of the centres of boulders that meet the line [m]
      real(wp) :: half_width = -1.0_wp        !! half width of an object [m]; < 0: a line, crossed by centres
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

   !> Build an object with a width along a polyline, for boulders up to a maximum radius.
   pure type(line_t) function object_line(x, y, width, max_radius) result(object)
      real(wp), intent(in) :: x(:), y(:)         !! at least two vertices, which may be equal [m]
      real(wp), intent(in) :: width, max_radius  !! [m]

      object = line(x, y)
      object%half_width = 0.5_wp*width
      object%low = object%low - (object%half_width + max_radius)
      object%high = object%high + (object%half_width + max_radius)
   end function object_line

   !> First meeting of a boulder, whose centre moves from a to b in plan, with a line or object: fraction of the path in
   !> 0..1 [-], or 2 if they do not meet. A boulder meets an object where its centre comes within
   !> one radius of the edge, or at the start of the path if it is already that near.
   pure real(wp) function first_meeting(this, a, b, radius) result(fraction)
      type(line_t), intent(in) :: this
      real(wp), intent(in) :: a(2), b(2)  !! [m]
      real(wp), intent(in) :: radius      !! R_b [m]
      real(wp) :: reach
      integer :: k

      if (this%half_width < 0) then
         fraction = first_crossing(this, a, b)
         return
      end if
      fraction = 2
      if (.not. boxes_touch(this%low(1), this%low(2), this%high(1), this%high(2), a(1), a(2), b(1), b(2)) > 0) return
      reach = this%half_width + radius
      do k = 1, size(this%x)
         fraction = min(fraction, entry_into_disc([this%x(k), this%y(k)], reach, a, b))
      end do
      do k = 2, size(this%x)
         fraction = min(fraction, entry_into_strip([this%x(k - 1), this%y(k - 1)], [this%x(k), this%y(k)], reach, a, b))
      end do
   end function first_meeting

   !> Fraction of a path at which it enters a disc; 0 if it starts inside, 2 if it does not enter.
   pure real(wp) function entry_into_disc(centre, radius, a, b) result(fraction)
      real(wp), intent(in) :: centre(2), radius  !! [m]
      real(wp), intent(in) :: a(2), b(2)         !! both ends of the path [m]
      real(wp) :: along, length2, outside, root2

      fraction = 2
      outside = dot_product(a - centre, a - centre) - radius*radius
      along = dot_product(centre - a, b - a)
      length2 = dot_product(b - a, b - a)
      root2 = along*along - length2*outside
      if (outside <= 0) then
         fraction = 0
      else if (along > 0 .and. root2 >= 0) then
         fraction = outside/(along + sqrt(root2))  ! the smaller root, without cancellation
         if (fraction > 1) fraction = 2
      end if
   end function entry_into_disc

   !> Fraction of a path at which it enters, through a long side, the rectangle that surrounds a segment at a given
   !> distance; 0 if it starts inside, 2 if it does not enter.
   pure real(wp) function entry_into_strip(p, q, distance, a, b) result(fraction)
      real(wp), intent(in) :: p(2), q(2)  !! both ends of the segment [m]
      real(wp), intent(in) :: distance    !! [m]
      real(wp), intent(in) :: a(2), b(2)  !! both ends of the path [m]
      real(wp) :: direction(2), length, side_a, side_b, edge, along, entry

      fraction = 2
      length = sqrt(dot_product(q - p, q - p))
      if (.not. length > 0) return
      direction = (q - p)/length
      side_a = cross_product(direction, a - p)
      side_b = cross_product(direction, b - p)
      edge = sign(distance, side_a)
      entry = 0
      if (abs(side_a) > distance) then
         if ((side_b - edge)*side_a > 0) return  ! both ends of the path are beyond the edge
         entry = (side_a - edge)/(side_a - side_b)
      end if
      along = dot_product(direction, a + entry*(b - a) - p)
      if (along >= 0 .and. along <= length) fraction = entry
   end function entry_into_strip

   !> First crossing of a line by the plan path from a to b: fraction of the path in 0..1 [-], or 2 if none.
   !> The side of a point is a sign (zero: left), so a path that ends on the line and continues from there crosses it
   !> once.
   pure real(wp) function first_crossing(this, a, b) result(fraction)
      type(line_t), intent(in) :: this
      real(wp), intent(in) :: a(2), b(2)  !! ends of the path [m]

      fraction = next_crossing(this, a, b, -1.0_wp)
   end function first_crossing

   !> First crossing after a given fraction of the path.
   pure real(wp) function next_crossing(this, a, b, after) result(fraction)
      type(line_t), intent(in) :: this
      real(wp), intent(in) :: a(2), b(2)  !! ends of the path [m]
      real(wp), intent(in) :: after       !! fraction of the path [-]
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

   !> Return 1 if the bounding boxes of a line and of a path from a to b touch; else 0: the path cannot cross the line.
   elemental real(wp) function boxes_touch(low1, low2, high1, high2, a1, a2, b1, b2) result(near)
      real(wp), intent(in) :: low1, low2, high1, high2  !! bounding box of the line [m]
      real(wp), intent(in) :: a1, a2, b1, b2            !! ends of the path [m]

      near = merge(1.0_wp, 0.0_wp, min(a1, b1) <= high1)
      near = merge(near, 0.0_wp, min(a2, b2) <= high2)
      near = merge(near, 0.0_wp, max(a1, b1) >= low1)
      near = merge(near, 0.0_wp, max(a2, b2) >= low2)
   end function boxes_touch

   !> Vertical component of a x b [m2]: twice the area of their triangle, > 0 if b is left of a.
   pure real(wp) function cross_product(a, b)
      real(wp), intent(in) :: a(2), b(2)  !! [m]

      cross_product = a(1)*b(2) - a(2)*b(1)
   end function cross_product
end module rockfall_line
