! SPDX-License-Identifier: BSD-3-Clause
!> Evaluation lines: crossing points, also at vertices and for paths that end on the line; objects: points of contact.
program test_line
   use rockfall_kinds, only: wp
   use rockfall_line, only: line_t, line, object_line, first_crossing, first_meeting
   use check_m, only: check, check_close, finish
   implicit none

   call random_init(.true., .false.)
   call test_straight()
   call test_polyline()
   call test_end_on_line()
   call test_vertex()
   call test_along()
   call test_random_paths()
   call test_objects()
   call finish()

contains

   subroutine test_straight()
      type(line_t) :: this

      this = line([0.0_wp, 10.0_wp], [5.0_wp, 5.0_wp])
      call check_close("crossed in the middle", &
                       first_crossing(this, [3.0_wp, 4.0_wp], [4.0_wp, 6.0_wp]), 0.5_wp, 1.0e-15_wp)
      call check_close("from the other side", first_crossing(this, [4.0_wp, 6.0_wp], &
         [3.0_wp, 4.0_wp]), 0.5_wp, 1.0e-15_wp)
      call check("before it", first_crossing(this, [3.0_wp, 1.0_wp], [4.0_wp, 4.9_wp]) > 1)
      call check("beside it", first_crossing(this, [9.0_wp, 4.0_wp], [12.0_wp, 6.0_wp]) > 1)
      call check("nowhere near", first_crossing(this, [30.0_wp, 40.0_wp], [31.0_wp, 50.0_wp]) > 1)
      call check("a path of no length", first_crossing(this, [3.0_wp, 5.0_wp], &
                                                       [3.0_wp, 5.0_wp]) > 1)
   end subroutine test_straight

   !> Of several crossings, the first along the path counts, not the first along the line.
   subroutine test_polyline()
      type(line_t) :: this

      this = line([6.0_wp, 6.0_wp, 2.0_wp, 2.0_wp], [0.0_wp, 10.0_wp, 10.0_wp, 0.0_wp])
      call check_close("the nearer part", first_crossing(this, [0.0_wp, 5.0_wp], &
                                                         [8.0_wp, 5.0_wp]), 0.25_wp, 1.0e-15_wp)
      call check_close("from the other end", first_crossing(this, [8.0_wp, 5.0_wp], &
                                                            [0.0_wp, 5.0_wp]), 0.25_wp, 1.0e-15_wp)
      call check("inside its bend", first_crossing(this, [3.0_wp, 5.0_wp], [5.0_wp, 9.0_wp]) > 1)
   end subroutine test_polyline

   !> A path in two pieces that meet on the line crosses it in exactly one of them. A path that only touches the line
   !> crosses it twice or never.
   subroutine test_end_on_line()
      type(line_t) :: this
      real(wp), parameter :: below(2) = [3.0_wp, 4.0_wp], on(2) = [4.0_wp, 5.0_wp], &
         above(2) = [5.0_wp, 7.0_wp]

      this = line([0.0_wp, 10.0_wp], [5.0_wp, 5.0_wp])
      call check("ending on it, up: once", crossings(this, below, on) + crossings(this, on, &
         above) == 1)
      call check("ending on it, down: once", crossings(this, above, on) + crossings(this, on, &
         below) == 1)
      call check("touched from above", crossings(this, above, on) + crossings(this, on, above) /= 1)
      call check("touched from below", crossings(this, below, on) + crossings(this, on, below) /= 1)
   end subroutine test_end_on_line

   integer function crossings(this, a, b)
      type(line_t), intent(in) :: this
      real(wp), intent(in) :: a(2), b(2)

      crossings = merge(1, 0, first_crossing(this, a, b) <= 1)
   end function crossings

   !> A path through a vertex always crosses the line.
   subroutine test_vertex()
      type(line_t) :: this

      this = line([0.0_wp, 5.0_wp, 10.0_wp], [5.0_wp, 5.0_wp, 5.0_wp])
      call check_close("through a vertex of a straight line", &
                       first_crossing(this, [4.0_wp, 4.0_wp], [6.0_wp, 6.0_wp]), 0.5_wp, 1.0e-15_wp)
      call check_close("and back", first_crossing(this, [6.0_wp, 6.0_wp], [4.0_wp, 4.0_wp]), &
                       0.5_wp, 1.0e-15_wp)
      this = line([0.0_wp, 5.0_wp, 5.0_wp], [5.0_wp, 5.0_wp, 20.0_wp])
      call check_close("through a corner, out", &
                       first_crossing(this, [4.0_wp, 6.0_wp], [6.0_wp, 4.0_wp]), 0.5_wp, 1.0e-15_wp)
      call check_close("through a corner, in", &
                       first_crossing(this, [6.0_wp, 4.0_wp], [4.0_wp, 6.0_wp]), 0.5_wp, 1.0e-15_wp)
   end subroutine test_vertex

   !> A path along the line does not cross until it leaves to the other side.
   subroutine test_along()
      type(line_t) :: this

      this = line([0.0_wp, 10.0_wp], [5.0_wp, 5.0_wp])
      call check("a path along the line has no place of crossing", &
                 first_crossing(this, [2.0_wp, 5.0_wp], [8.0_wp, 5.0_wp]) > 1)
      call check("onto it, along it and through: once", &
                 crossings(this, [2.0_wp, 4.0_wp], [3.0_wp, 5.0_wp]) &
                 + crossings(this, [3.0_wp, 5.0_wp], [6.0_wp, 5.0_wp]) &
                 + crossings(this, [6.0_wp, 5.0_wp], [7.0_wp, 6.0_wp]) == 1)
   end subroutine test_along

   !> Random crossings agree with the solution of two equations.
   subroutine test_random_paths()
      real(wp) :: p(2), q(2), a(2), b(2), det, along, share, got
      integer :: k, met

      met = 0
      do k = 1, 10000
         call random_number(p)
         call random_number(q)
         call random_number(a)
         call random_number(b)
         det = (b(1) - a(1))*(q(2) - p(2)) - (b(2) - a(2))*(q(1) - p(1))
         share = ((p(1) - a(1))*(q(2) - p(2)) - (p(2) - a(2))*(q(1) - p(1)))/det
         along = ((p(1) - a(1))*(b(2) - a(2)) - (p(2) - a(2))*(b(1) - a(1)))/det
         got = first_crossing(line([p(1), q(1)], [p(2), q(2)]), a, b)
         if (min(share, along) > 0 .and. max(share, along) < 1) then
            met = met + 1
            call check("the share of the way", abs(got - share) < 1.0e-9_wp)
         else
            call check("no crossing", got > 1)
         end if
      end do
      call check("both happen", met > 1000 .and. met < 9000)
   end subroutine test_random_paths

   !> A boulder touches an object where its centre is first half a width plus a radius away; a path that comes this near
   !> always touches.
   subroutine test_objects()
      type(line_t) :: this
      real(wp) :: x(3), y(3), a(2), b(2), width, radius, got, nearest, away
      integer, parameter :: samples = 1000
      integer :: k, n, met, inside

      met = 0
      inside = 0
      do k = 1, 3000
         call random_number(x)
         call random_number(y)
         if (mod(k, 7) == 0) x(2:) = x(1)
         if (mod(k, 14) == 0) y(2:) = y(1)  ! degenerate to a point
         call random_number(a)
         call random_number(b)
         call random_number(width)
         call random_number(radius)
         width = 0.1_wp*width
         radius = 0.2_wp*radius
         this = object_line(x, y, width, radius)
         got = first_meeting(this, a, b, radius)
         nearest = huge(nearest)
         do n = 0, samples
            if (n >= min(got, 1.0_wp)*samples) exit
            nearest = min(nearest, distance(x, y, a + n*(b - a)/samples))
         end do
         call check("not near before", nearest >= 0.5_wp*width + radius)
         if (got > 1) cycle
         met = met + 1
         away = distance(x, y, a + got*(b - a)) - 0.5_wp*width - radius
         if (got > 0) then
            call check("touches there", abs(away) < 1.0e-12_wp)
         else
            inside = inside + 1
            call check("touches from the start", away <= 1.0e-15_wp)
         end if
      end do
      call check("all happen", met > 500 .and. inside > 200 .and. met - inside > 300 .and. met < 2900)
   end subroutine test_objects

   !> Distance between a point and a polyline.
   pure real(wp) function distance(x, y, point)
      real(wp), intent(in) :: x(:), y(:), point(2)
      real(wp) :: side(2), along
      integer :: k

      distance = huge(distance)
      do k = 1, size(x) - 1
         side = [x(k + 1) - x(k), y(k + 1) - y(k)]
         along = 0
         if (any(abs(side) > 0)) &
            along = max(0.0_wp, min(1.0_wp, dot_product(point - [x(k), y(k)], side)/dot_product(side, side)))
         distance = min(distance, norm2(point - [x(k), y(k)] - along*side))
      end do
   end function distance
end program test_line
