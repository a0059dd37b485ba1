! SPDX-License-Identifier: BSD-3-Clause
!> Which bodies can touch: Verlet's list of the pairs, and of the bodies near floor and sides, whose
!> gap was below a skin when the list was made. A gap closes by no more than its two bodies have
!> moved, so the list holds as long as the two longest displacements together do not exceed the
!> skin.
module lab_neighbours
   use rockfall_kinds, only: wp
   implicit none
   private
   public :: box_t, pair_t, beside_t, neighbours_t, find_neighbours, outdated, find_pair
   public :: at_floor, at_left, at_right

   integer, parameter :: at_floor = 1, at_left = 2, at_right = 3

   !> A rigid floor at z = 0, and sides at x = 0 and x = width: periodic or rigid.
   type :: box_t
      real(wp) :: width = 1         !! [m]
      logical :: periodic = .true.
      logical :: floor = .true.
   end type box_t

   type :: pair_t
      integer :: i = 0, j = 0   !! i < j
      real(wp) :: shift = 0     !! added to x of j, so that it is the image next to i [m]
      real(wp) :: reach = 0     !! sum of the radii [m]
   end type pair_t

   type :: beside_t
      integer :: body = 0
      integer :: side = 0       !! at_floor, at_left, at_right
   end type beside_t

   type :: neighbours_t
      real(wp) :: skin = 0      !! [m]
      integer :: n_large = 0 !! the last bodies, much larger than the others, are compared with all
      integer :: n_pairs = 0
      type(pair_t), allocatable :: pair(:)     !! (n_pairs or more), by i
      integer, allocatable :: row(:)           !! pairs row(i) to row(i + 1) - 1 belong to i
      type(beside_t), allocatable :: beside(:)
      integer, allocatable :: order(:)         !! small bodies by x
      real(wp), allocatable :: x0(:, :)        !! centres when the list was made [m]
   end type neighbours_t

contains

   !> True when a pair that is not in the list might touch, now or before.
   pure logical function outdated(list, x)
      type(neighbours_t), intent(in) :: list
      real(wp), intent(in) :: x(:, :)
      real(wp) :: d, most, second
      integer :: k

      most = 0
      second = 0
      do k = 1, size(x, 2)
         d = (x(1, k) - list%x0(1, k))**2 + (x(2, k) - list%x0(2, k))**2
         if (d > second) then
            second = min(d, most)
            most = max(d, most)
         end if
      end do
      outdated = sqrt(most) + sqrt(second) > list%skin
   end function outdated

   !> Make the list anew; bodies that left a periodic box come back on its other side.
   pure subroutine find_neighbours(list, box, x, radius)
      type(neighbours_t), intent(inout) :: list
      type(box_t), intent(in) :: box
      real(wp), intent(inout) :: x(:, :)
      real(wp), intent(in) :: radius(:)
      type(pair_t), allocatable :: found(:)
      integer :: n, n_small, k, count

      n = size(radius)
      n_small = n - list%n_large
      if (box%periodic) x(1, :) = x(1, :) - box%width*floor(x(1, :)/box%width)
      if (.not. allocated(list%order)) list%order = [(k, k=1, n_small)]
      call sort_by_x(list%order, x)
      allocate (found(8*n + 16))
      count = 0
      call sweep(list, box, x, radius, found, count)
      do k = n_small + 1, n
         call scan(list, box, x, radius, k, found, count)
      end do
      call by_first_body(list, n, found(:count))
      call find_beside(list, box, x, radius)
      list%x0 = x
   end subroutine find_neighbours

   !> Insertion: the order has changed little since the last time.
   pure subroutine sort_by_x(order, x)
      integer, intent(inout) :: order(:)
      real(wp), intent(in) :: x(:, :)
      integer :: k, l, body

      do k = 2, size(order)
         body = order(k)
         l = k - 1
         do while (l >= 1)
            if (x(1, order(l)) <= x(1, body)) exit
            order(l + 1) = order(l)
            l = l - 1
         end do
         order(l + 1) = body
      end do
   end subroutine sort_by_x

   !> Pairs among small bodies: from each to the right, round the period, as far as the largest
   !> could reach. The box is more than twice as wide, so each pair is met once.
   pure subroutine sweep(list, box, x, radius, found, count)
      type(neighbours_t), intent(in) :: list
      type(box_t), intent(in) :: box
      real(wp), intent(in) :: x(:, :), radius(:)
      type(pair_t), allocatable, intent(inout) :: found(:)
      integer, intent(inout) :: count
      real(wp) :: largest, shift
      integer :: k, l, m, i, j, n

      n = size(list%order)
      largest = 0
      if (n > 0) largest = maxval(radius(:n))
      do k = 1, n
         i = list%order(k)
         do l = k + 1, k + n - 1
            m = l
            shift = 0
            if (l > n) then
               if (.not. box%periodic) exit
               m = l - n
               shift = box%width
            end if
            j = list%order(m)
            if (x(1, j) + shift - x(1, i) > radius(i) + largest + list%skin) exit
            call keep_if_near(list, x, radius, i, j, shift, found, count)
         end do
      end do
   end subroutine sweep

   !> Pairs of a large body with all before it.
   pure subroutine scan(list, box, x, radius, large, found, count)
      type(neighbours_t), intent(in) :: list
      type(box_t), intent(in) :: box
      real(wp), intent(in) :: x(:, :), radius(:)
      integer, intent(in) :: large
      type(pair_t), allocatable, intent(inout) :: found(:)
      integer, intent(inout) :: count
      real(wp) :: shift
      integer :: i

      do i = 1, large - 1
         shift = 0
         if (box%periodic) shift = -box%width*nint((x(1, large) - x(1, i))/box%width)
         call keep_if_near(list, x, radius, i, large, shift, found, count)
      end do
   end subroutine scan

   pure subroutine keep_if_near(list, x, radius, i, j, shift, found, count)
      type(neighbours_t), intent(in) :: list
      real(wp), intent(in) :: x(:, :), radius(:), shift
      integer, intent(in) :: i, j
      type(pair_t), allocatable, intent(inout) :: found(:)
      integer, intent(inout) :: count
      real(wp) :: reach

      reach = radius(i) + radius(j)
      if ((x(1, j) + shift - x(1, i))**2 + (x(2, j) - x(2, i))**2 > (reach + list%skin)**2) return
      if (count == size(found)) found = [found, found]
      count = count + 1
      if (i < j) then
         found(count) = pair_t(i, j, shift, reach)
      else
         found(count) = pair_t(j, i, -shift, reach)
      end if
   end subroutine keep_if_near

   !> Order pairs by their first body: neighbours in memory, and quick to find.
   pure subroutine by_first_body(list, n, found)
      type(neighbours_t), intent(inout) :: list
      integer, intent(in) :: n
      type(pair_t), intent(in) :: found(:)
      integer :: next(n), k, i

      if (.not. allocated(list%row)) allocate (list%row(n + 1))
      if (allocated(list%pair)) then
         if (size(list%pair) < size(found)) deallocate (list%pair)
      end if
      if (.not. allocated(list%pair)) allocate (list%pair(size(found) + size(found)/4))
      list%n_pairs = size(found)
      list%row = 0
      do k = 1, size(found)
         list%row(found(k)%i + 1) = list%row(found(k)%i + 1) + 1
      end do
      list%row(1) = 1
      do i = 1, n
         list%row(i + 1) = list%row(i) + list%row(i + 1)
      end do
      next = list%row(:n)
      do k = 1, size(found)
         i = found(k)%i
         list%pair(next(i)) = found(k)
         next(i) = next(i) + 1
      end do
   end subroutine by_first_body

   pure subroutine find_beside(list, box, x, radius)
      type(neighbours_t), intent(inout) :: list
      type(box_t), intent(in) :: box
      real(wp), intent(in) :: x(:, :), radius(:)
      logical :: near(3, size(radius))
      integer :: k, side, n

      near(at_floor, :) = box%floor .and. x(2, :) - radius < list%skin
      near(at_left, :) = .not. box%periodic .and. x(1, :) - radius < list%skin
      near(at_right, :) = .not. box%periodic .and. box%width - x(1, :) - radius < list%skin
      if (allocated(list%beside)) deallocate (list%beside)
      allocate (list%beside(count(near)))
      n = 0
      do k = 1, size(radius)
         do side = at_floor, at_right
            if (.not. near(side, k)) cycle
            n = n + 1
            list%beside(n) = beside_t(k, side)
         end do
      end do
   end subroutine find_beside

   !> Place of the pair (i, j), i < j, in the list; 0: not there.
   pure integer function find_pair(list, i, j) result(place)
      type(neighbours_t), intent(in) :: list
      integer, intent(in) :: i, j

      do place = list%row(i), list%row(i + 1) - 1
         if (list%pair(place)%j == j) return
      end do
      place = 0
   end function find_pair
end module lab_neighbours
