! SPDX-License-Identifier: BSD-3-Clause
!> Neighbour search by Verlet lists. A list contains pairs of bodies, and bodies near the floor, whose gap was below the
!> skin when the list was built. A gap shrinks by at most the displacements of both bodies, so the list is valid as long
!> as the two largest displacements together do not exceed the skin.
module lab_neighbours
   use rockfall_kinds, only: wp
   implicit none
   private
   public :: box_t, pair_t, neighbours_t, find_neighbours, outdated, find_pair, fold_into_box

   !> Box that is periodic in x and y, with or without a floor at z = 0.
   type :: box_t
      real(wp) :: width = 1     !! length of the sides in x and y [m]; 0: not periodic
      logical :: floor = .true.
   end type box_t

   type :: pair_t
      integer :: i = 0, j = 0      !! i < j
      real(wp) :: shift(2) = 0     !! shift of x, y of j to the image nearest to i [m]
      real(wp) :: reach = 0        !! sum of the radii [m]
   end type pair_t

   type :: neighbours_t
      real(wp) :: skin = 0      !! maximum gap of listed pairs [m]
      integer :: n_large = 0    !! number of large bodies, last in the list, that are compared with all others
      integer, allocatable :: owner(:)      !! clump of each body; 0: none. Spheres of the same clump form no pairs
      integer :: n_pairs = 0
      type(pair_t), allocatable :: pair(:)  !! (n_pairs or more) pairs, sorted by i
      integer, allocatable :: row(:)        !! pairs row(i) to row(i + 1) - 1 belong to i
      integer, allocatable :: low(:)        !! indices of bodies near the floor
      real(wp), allocatable :: x0(:, :)     !! centres when the list was built [m]
   end type neighbours_t

   real(wp), parameter :: slack = 1.0e-12_wp  !! relative margin for rounding
   integer, parameter :: far = 2  !! search range for the largest small body, in grid cells
   integer, parameter :: max_spans = ((2*far + 1)**3 + 1)/2

contains

   !> Return whether a pair that is not in the list might touch, or might have touched.
   pure logical function outdated(list, x)
      type(neighbours_t), intent(in) :: list
      real(wp), intent(in) :: x(:, :)  !! centres [m]
      real(wp) :: d, max_distance2, second_distance2
      integer :: k

      max_distance2 = 0
      second_distance2 = 0
      do k = 1, size(x, 2)
         d = (x(1, k) - list%x0(1, k))**2 + (x(2, k) - list%x0(2, k))**2 + (x(3, k) - list%x0(3, k))**2
         if (d > second_distance2) then
            second_distance2 = min(d, max_distance2)
            max_distance2 = max(d, max_distance2)
         end if
      end do
      outdated = sqrt(max_distance2) + sqrt(second_distance2) > list%skin
   end function outdated

   !> Rebuild the list; bodies that left the box re-enter on its other side.
   pure subroutine find_neighbours(list, box, x, radius)
      type(neighbours_t), intent(inout) :: list
      type(box_t), intent(in) :: box
      real(wp), intent(inout) :: x(:, :)   !! centres [m]
      real(wp), intent(in) :: radius(:)    !! [m]
      type(pair_t), allocatable :: pairs(:)
      integer :: n, n_small, i, j, count

      n = size(radius)
      n_small = n - list%n_large
      call fold_into_box(box, x)
      allocate (pairs(10*n + 16))
      count = 0
      call pair_small_bodies(list, box, x, radius, n_small, pairs, count)
      do j = n_small + 1, n
         do i = 1, j - 1
            call add_if_near(list, box, x, radius, i, j, pairs, count)
         end do
      end do
      call sort_pairs(list, n, pairs(:count))
      list%low = pack([(i, i=1, n)], box%floor .and. x(3, :) - radius < list%skin)
      list%x0 = x
   end subroutine find_neighbours

   !> Move bodies outside the periodic box back into it.
   pure subroutine fold_into_box(box, x)
      type(box_t), intent(in) :: box
      real(wp), intent(inout) :: x(:, :)  !! (3, n) centres [m]

      if (box%width > 0) x(1:2, :) = x(1:2, :) - box%width*floor(x(1:2, :)/box%width)
   end subroutine fold_into_box

   !> Plan shift of a body to its image nearest to another body, both in the box.
   pure function nearest_image(box, d) result(shift)
      type(box_t), intent(in) :: box
      real(wp), intent(in) :: d(2)  !! position relative to the other body [m]
      real(wp) :: shift(2)

      shift = 0
      if (box%width > 0) shift = merge(-sign(box%width, d), 0.0_wp, abs(d) > 0.5_wp*box%width)
   end function nearest_image

   !> Find pairs among small bodies with a grid of cells half as wide as the range of the largest body. Each body is
   !> compared with later bodies in its cell and with all bodies in the following neighbour cells.
   pure subroutine pair_small_bodies(list, box, x, radius, n_small, pairs, count)
      type(neighbours_t), intent(in) :: list
      type(box_t), intent(in) :: box
      real(wp), intent(in) :: x(:, :), radius(:)  !! [m]
      integer, intent(in) :: n_small
      type(pair_t), allocatable, intent(inout) :: pairs(:)
      integer, intent(inout) :: count
      real(wp) :: side, origin(3), extent(3), size_of(3), d(3), sorted_x(3, n_small), sorted_radius(n_small)
      integer :: cells(3), cell(3, n_small), place(n_small), order(n_small), spans(2, max_spans), n_spans, k, l, m
      integer, allocatable :: first(:), next(:)

      if (n_small < 2) return
      side = (2*maxval(radius(:n_small)) + list%skin)/far
      origin = minval(x(:, :n_small), 2)
      extent = maxval(x(:, :n_small), 2) - origin
      if (box%width > 0) then
         origin(1:2) = 0
         extent(1:2) = box%width
      end if
      cells = min(max(1, int(extent/side)), 200)
      if (box%width > 0 .and. minval(cells(1:2)) < 2*far + 1) cells = 1  ! otherwise a cell would be visited twice
      size_of = max(extent/cells, tiny(side))
      do k = 1, n_small
         cell(:, k) = min(1 + int((x(:, k) - origin)/size_of), cells)
      end do
      place = cell(1, :) + cells(1)*(cell(2, :) - 1 + cells(2)*(cell(3, :) - 1))
      first = row_starts(product(cells), place)
      next = first
      do k = 1, n_small
         order(next(place(k))) = k
         next(place(k)) = next(place(k)) + 1
      end do
      sorted_x = x(:, order)
      sorted_radius = radius(order)
      do l = 1, n_small
         call spans_after(box, cells, cell(:, order(l)), first, spans, n_spans)
         spans(1, 1) = l + 1  ! later bodies in its own cell
         do k = 1, n_spans
            do m = spans(1, k), spans(2, k)
               d = abs(sorted_x(:, m) - sorted_x(:, l))
               if (box%width > 0) d(1:2) = min(d(1:2), box%width - d(1:2))
               if (d(1)**2 + d(2)**2 + d(3)**2 > (1 + slack)*(sorted_radius(m) + sorted_radius(l) + list%skin)**2) cycle
               call add_if_near(list, box, x, radius, min(order(l), order(m)), max(order(l), order(m)), pairs, count)
            end do
         end do
      end do
   end subroutine pair_small_bodies

   !> Positions, in the order of cells, of the bodies in a cell and in the following half of its neighbour cells, as
   !> spans from first to last. Spans of neighbouring cells along x are contiguous.
   pure subroutine spans_after(box, cells, c, first, spans, n)
      type(box_t), intent(in) :: box
      integer, intent(in) :: cells(3), c(3), first(:)
      integer, intent(out) :: spans(2, max_spans), n
      integer :: columns(-far:far), rows(-far:far), dx, dy, dz, p

      columns = cells_around(c(1), cells(1), box)
      rows = cells_around(c(2), cells(2), box)
      n = 0
      do dz = 0, min(far, cells(3) - c(3))
         do dy = merge(-far, 0, dz > 0), far
            if (rows(dy) == 0) cycle
            do dx = merge(-far, 0, dz > 0 .or. dy > 0), far
               if (columns(dx) == 0) cycle
               p = columns(dx) + cells(1)*(rows(dy) - 1 + cells(2)*(c(3) + dz - 1))
               if (n > 0) then
                  if (spans(2, n) + 1 == first(p)) then
                     spans(2, n) = first(p + 1) - 1
                     cycle
                  end if
               end if
               n = n + 1
               spans(:, n) = [first(p), first(p + 1) - 1]
            end do
         end do
      end do
   end subroutine spans_after

   !> Indices of the cells around a cell along one direction; 0: none.
   pure function cells_around(cell, cells, box) result(near)
      integer, intent(in) :: cell, cells
      type(box_t), intent(in) :: box
      integer :: near(-far:far), k

      near = [(cell + k, k=-far, far)]
      if (box%width > 0 .and. cells > 1) near = 1 + modulo(near - 1, cells)
      where (near < 1 .or. near > cells) near = 0
   end function cells_around

   pure subroutine add_if_near(list, box, x, radius, i, j, pairs, count)
      type(neighbours_t), intent(in) :: list
      type(box_t), intent(in) :: box
      real(wp), intent(in) :: x(:, :), radius(:)  !! [m]
      integer, intent(in) :: i, j  !! i < j
      type(pair_t), allocatable, intent(inout) :: pairs(:)
      integer, intent(inout) :: count
      real(wp) :: reach, d(3), shift(2)

      if (allocated(list%owner)) then
         if (list%owner(i) == list%owner(j) .and. list%owner(i) > 0) return
      end if
      reach = radius(i) + radius(j)
      d = x(:, j) - x(:, i)
      if (abs(d(3)) > reach + list%skin) return
      shift = nearest_image(box, d(1:2))
      d(1:2) = d(1:2) + shift
      if (d(1)**2 + d(2)**2 + d(3)**2 > (reach + list%skin)**2) return
      if (count == size(pairs)) pairs = [pairs, pairs]
      count = count + 1
      pairs(count) = pair_t(i, j, shift, reach)
   end subroutine add_if_near

   !> Sort pairs by first, then by second body: for locality, fast search, and a fixed order of summation.
   pure subroutine sort_pairs(list, n, pairs)
      type(neighbours_t), intent(inout) :: list
      integer, intent(in) :: n
      type(pair_t), intent(in) :: pairs(:)
      type(pair_t) :: by_second(size(pairs))
      integer :: row(n + 1)

      if (.not. allocated(list%row)) allocate (list%row(n + 1))
      if (allocated(list%pair)) then
         if (size(list%pair) < size(pairs)) deallocate (list%pair)
      end if
      if (.not. allocated(list%pair)) allocate (list%pair(size(pairs) + size(pairs)/4))
      list%n_pairs = size(pairs)
      call sort_by_body(n, pairs, pairs%j, row, by_second)
      call sort_by_body(n, by_second, by_second%i, list%row, list%pair)
   end subroutine sort_pairs

   !> Sort pairs by one of their bodies, in stable order: pairs of body k are row(k) to row(k + 1) - 1.
   pure subroutine sort_by_body(n, pairs, body, row, sorted)
      integer, intent(in) :: n
      type(pair_t), intent(in) :: pairs(:)
      integer, intent(in) :: body(:)
      integer, intent(out) :: row(:)
      type(pair_t), intent(inout) :: sorted(:)
      integer :: next(n), k

      row = row_starts(n, body)
      next = row(:n)
      do k = 1, size(pairs)
         sorted(next(body(k))) = pairs(k)
         next(body(k)) = next(body(k)) + 1
      end do
   end subroutine sort_by_body

   !> First position of each of n groups, and the position after the last group.
   pure function row_starts(n, group) result(row)
      integer, intent(in) :: n, group(:)
      integer :: row(n + 1), k

      row = 0
      do k = 1, size(group)
         row(group(k) + 1) = row(group(k) + 1) + 1
      end do
      row(1) = 1
      do k = 1, n
         row(k + 1) = row(k) + row(k + 1)
      end do
   end function row_starts

   !> Index of the pair (i, j), i < j, in the list; 0 if it is not listed.
   pure integer function find_pair(list, i, j) result(place)
      type(neighbours_t), intent(in) :: list
      integer, intent(in) :: i, j

      do place = list%row(i), list%row(i + 1) - 1
         if (list%pair(place)%j == j) return
      end do
      place = 0
   end function find_pair
end module lab_neighbours
