! SPDX-License-Identifier: BSD-3-Clause
!> First crossings of lines by the boulders whose rows are kept, with one row per line and boulder. Rows are in single
!> precision and, until sorted, in the order in which boulders arrive.
module rockfall_crossing_rows
   use rockfall_kinds, only: wp, sp, i1, i4, i8
   use rockfall_variables, only: crossing_fields
   implicit none
   private
   public :: crossing_rows_t, start_rows, make_room, append_rows, clear_rows, sort_rows, &
             first_unsorted, n_reals

   integer, parameter :: n_reals = size(crossing_fields)
   integer(i8), parameter :: first_room = 1024  !! initial capacity [rows]

   type :: column_t
      real(sp), allocatable :: of(:)
   end type column_t

   !> Columns are longer than the `n` rows in use. Columns that the case does not need have size zero.
   type :: crossing_rows_t
      integer(i8) :: n = 0
      logical :: may_break = .false., may_hit = .false.
      integer(i8), allocatable :: boulder(:)      !! boulder number
      integer(i4), allocatable :: line(:)         !! index of the line, from 0
      type(column_t) :: real(n_reals)             !! columns of crossing_fields
      real(sp), allocatable :: volume(:)          !! volume of the fragment, if boulders may break [m3]
      integer(i4), allocatable :: fragments(:)    !! number of fragments that crossed, if boulders may break
      integer(i1), allocatable :: outcome(:)      !! outcome at a barrier; 0: not hit; size zero without barriers
   end type crossing_rows_t

contains

   !> Create a table without rows.
   pure subroutine start_rows(may_break, may_hit, rows)
      logical, intent(in) :: may_break, may_hit  !! boulders may break; barriers may be hit
      type(crossing_rows_t), intent(out) :: rows
      integer :: k

      rows%may_break = may_break
      rows%may_hit = may_hit
      allocate (rows%boulder(0), rows%line(0), rows%volume(0), rows%fragments(0), rows%outcome(0))
      do k = 1, n_reals
         allocate (rows%real(k)%of(0))
      end do
   end subroutine start_rows

   !> Allocate more rows, column by column, so that at most one column is in memory twice. `fit`: memory suffices.
   pure subroutine make_room(rows, more, fit)
      type(crossing_rows_t), intent(inout) :: rows
      integer(i8), intent(in) :: more
      logical, intent(out) :: fit
      integer(i8), allocatable :: numbers(:)
      integer(i4), allocatable :: integers(:)
      integer(i1), allocatable :: bytes(:)
      integer(i8) :: room, n
      integer :: k, status

      n = rows%n
      fit = .true.
      if (n + more <= size(rows%boulder, kind=i8)) return
      room = max(n + more, first_room, n + n/2)
      allocate (numbers(room), integers(room), stat=status)
      if (status == 0) then
         numbers(:n) = rows%boulder(:n)
         call move_alloc(numbers, rows%boulder)
         integers(:n) = rows%line(:n)
         call move_alloc(integers, rows%line)
      end if
      do k = 1, n_reals
         if (status == 0) call lengthen(rows%real(k)%of, n, room, status)
      end do
      if (rows%may_break .and. status == 0) then
         call lengthen(rows%volume, n, room, status)
         if (status == 0) allocate (integers(room), stat=status)
         if (status == 0) then
            integers(:n) = rows%fragments(:n)
            call move_alloc(integers, rows%fragments)
         end if
      end if
      if (rows%may_hit .and. status == 0) then
         allocate (bytes(room), stat=status)
         if (status == 0) then
            bytes(:n) = rows%outcome(:n)
            call move_alloc(bytes, rows%outcome)
         end if
      end if
      fit = status == 0
   end subroutine make_room

   pure subroutine lengthen(column, n, room, status)
      real(sp), allocatable, intent(inout) :: column(:)
      integer(i8), intent(in) :: n, room  !! number of rows to keep; new length
      integer, intent(out) :: status
      real(sp), allocatable :: longer(:)

      allocate (longer(room), stat=status)
      if (status /= 0) return
      longer(:n) = column(:n)
      call move_alloc(longer, column)
   end subroutine lengthen

   !> Append rows from another object, if memory suffices (`fit`).
   pure subroutine append_rows(rows, others, fit)
      type(crossing_rows_t), intent(inout) :: rows
      type(crossing_rows_t), intent(in) :: others
      logical, intent(out) :: fit
      integer :: k

      call make_room(rows, others%n, fit)
      if (.not. fit) return
      associate (first => rows%n + 1, last => rows%n + others%n, n => others%n)
         rows%boulder(first:last) = others%boulder(:n)
         rows%line(first:last) = others%line(:n)
         do k = 1, n_reals
            rows%real(k)%of(first:last) = others%real(k)%of(:n)
         end do
         if (rows%may_break) then
            rows%volume(first:last) = others%volume(:n)
            rows%fragments(first:last) = others%fragments(:n)
         end if
         if (rows%may_hit) rows%outcome(first:last) = others%outcome(:n)
      end associate
      rows%n = rows%n + others%n
   end subroutine append_rows

   !> Discard all rows, but keep their memory.
   pure subroutine clear_rows(rows)
      type(crossing_rows_t), intent(inout) :: rows

      rows%n = 0
   end subroutine clear_rows

   !> Sort rows by line, then by boulder, if memory suffices (`fit`) for two orders and a column.
   subroutine sort_rows(lines, rows, fit)
      integer, intent(in) :: lines  !! number of lines
      type(crossing_rows_t), intent(inout) :: rows
      logical, intent(out) :: fit
      integer(i8), allocatable :: order(:), merged(:)
      integer(i8) :: first(0:lines)
      integer :: k, status

      fit = .true.
      if (first_unsorted(rows) > rows%n) return
      allocate (order(rows%n), merged(rows%n), stat=status)
      fit = status == 0
      if (.not. fit) return
      call order_by_line(rows%line(:rows%n), first, order)
      !$omp parallel do default(none) schedule(dynamic) shared(lines, first, rows, order, merged)
      do k = 0, lines - 1
         associate (a => first(k) + 1, b => first(k + 1))
            call order_by_boulder(rows%boulder, order(a:b), merged(a:b))
         end associate
      end do
      !$omp end parallel do
      associate (n => rows%n)
         rows%boulder(:n) = rows%boulder(order)
         rows%line(:n) = rows%line(order)
         !$omp parallel do default(none) shared(rows, order)
         do k = 1, n_reals
            rows%real(k)%of(:rows%n) = rows%real(k)%of(order)
         end do
         !$omp end parallel do
         if (rows%may_break) then
            rows%volume(:n) = rows%volume(order)
            rows%fragments(:n) = rows%fragments(order)
         end if
         if (rows%may_hit) rows%outcome(:n) = rows%outcome(order)
      end associate
   end subroutine sort_rows

   !> First row that is not strictly ordered by line, then by boulder; one beyond the last row if none. In sorted rows,
   !> such a row is a second crossing of a line by the same boulder.
   pure integer(i8) function first_unsorted(rows) result(k)
      type(crossing_rows_t), intent(in) :: rows

      do k = 2, rows%n
         if (rows%line(k) < rows%line(k - 1)) return
         if (rows%line(k) == rows%line(k - 1) .and. rows%boulder(k) <= rows%boulder(k - 1)) return
      end do
      k = rows%n + 1
   end function first_unsorted

   !> Stable order of rows by line, and the number of rows before each line.
   pure subroutine order_by_line(line, first, order)
      integer(i4), intent(in) :: line(:)
      integer(i8), intent(out) :: first(0:)
      integer(i8), intent(out) :: order(:)
      integer(i8) :: next(0:ubound(first, 1)), k

      first = 0
      do k = 1, size(line, kind=i8)
         first(line(k) + 1) = first(line(k) + 1) + 1
      end do
      do k = 1, ubound(first, 1)
         first(k) = first(k) + first(k - 1)
      end do
      next = first
      do k = 1, size(line, kind=i8)
         associate (at => next(line(k)))
            at = at + 1
            order(at) = k
         end associate
      end do
   end subroutine order_by_line

   !> Sort an order by boulder: long ascending runs are merged pairwise until a single run is left.
   pure subroutine order_by_boulder(number, order, merged)
      integer(i8), intent(in) :: number(:)
      integer(i8), intent(inout) :: order(:)
      integer(i8), intent(out) :: merged(:)  !! work space
      integer(i8) :: first, middle, last

      do
         first = 1
         middle = end_of(number, order, first)
         if (middle >= size(order, kind=i8)) return
         do while (first <= size(order, kind=i8))
            middle = end_of(number, order, first)
            last = middle
            if (middle < size(order, kind=i8)) last = end_of(number, order, middle + 1)
            call merge_two(number, order(first:last), middle - first + 1, merged(first:last))
            first = last + 1
         end do
         order = merged
      end do
   end subroutine order_by_boulder

   !> End of the ascending run that begins at a given position of an order.
   pure integer(i8) function end_of(number, order, begin) result(k)
      integer(i8), intent(in) :: number(:), order(:), begin

      do k = begin, size(order, kind=i8) - 1
         if (number(order(k + 1)) < number(order(k))) return
      end do
   end function end_of

   !> Merge the first `n` elements of an order with the remaining elements; both parts ascend.
   pure subroutine merge_two(number, order, n, merged)
      integer(i8), intent(in) :: number(:), order(:), n
      integer(i8), intent(out) :: merged(:)
      integer(i8) :: a, b, k
      logical :: take

      a = 1
      b = n + 1
      do k = 1, size(order, kind=i8)
         take = a <= n
         if (take .and. b <= size(order, kind=i8)) take = number(order(a)) <= number(order(b))
         if (take) then
            merged(k) = order(a)
            a = a + 1
         else
            merged(k) = order(b)
            b = b + 1
         end if
      end do
   end subroutine merge_two
end module rockfall_crossing_rows
