! SPDX-License-Identifier: BSD-3-Clause
!> Bins and rows of tables for several contacts at a time: those that plain loops find, to the bit, in both copies.
program test_table_rows
   use, intrinsic :: iso_c_binding, only: c_int, c_ptr, c_loc
   use rockfall_kinds, only: wp, sp
   use rockfall_table_lanes, only: narrow_rows => read_rows, narrow_bins => find_bins
   use rockfall_wide_table_lanes, only: wide_rows => read_rows, wide_bins => find_bins
   use check_m, only: check, finish
   implicit none

   interface
      integer(c_int) function is_wide() bind(c, name="rockfall_is_wide")
         import :: c_int
      end function is_wide
   end interface

   integer :: copy

   do copy = 1, merge(2, 1, is_wide() == 1)
      call check_rows()
      call check_bins([5, 3, 12])
      call check_bins([6, 4, 1])  ! no edges of the last key
      call check_bins([1, 1, 1])
   end do
   call finish()

contains

   subroutine check_rows()
      integer, parameter :: n = 12, column = 20, fields = 16, others = 20, rows = 31
      real(sp), target :: single(fields, rows)
      real(wp), target :: double(others, rows)
      real(wp) :: record(column, fields), map(column, others)
      type(c_ptr) :: record_at(n), map_at(n)
      logical :: equal
      integer :: k

      call random_number(single)
      call random_number(double)
      do k = 1, n
         record_at(k) = c_loc(single(1, row(k)))
         map_at(k) = c_loc(double(1, row(3*k)))
      end do
      if (copy == 1) call narrow_rows(n, column, fields, record_at, record, others, map_at, map)
      if (copy == 2) call wide_rows(n, column, fields, record_at, record, others, map_at, map)
      equal = .true.
      do k = 1, n
         equal = equal .and. all(abs(record(k, :) - real(single(:, row(k)), wp)) <= 0)
         equal = equal .and. all(abs(map(k, :) - double(:, row(3*k))) <= 0)
      end do
      call check("rows become columns", equal)
   end subroutine check_rows

   !> Row of a contact: any, and some twice.
   pure integer function row(k)
      integer, intent(in) :: k

      row = 1 + mod(7*k*k, 31)
   end function row

   subroutine check_bins(count)
      integer, intent(in) :: count(3)
      integer, parameter :: n = 200, parts = 3
      real(wp) :: key(n, 3), over(n, 2), sorted
      real(wp), allocatable :: first(:, :), second(:, :, :), third(:, :, :, :)
      integer :: vectors(3), contact(n), part(n), bin(n), expected, i, j, k, m, p

      vectors = (count + 2)/4
      allocate (first(4*vectors(1), parts), second(4*vectors(2), count(1), parts), &
                third(4*vectors(3), count(2), count(1), parts), source=huge(1.0_wp))
      do p = 1, parts
         first(:count(1) - 1, p) = [((k + 0.1_wp*p)/count(1), k=1, count(1) - 1)]
         do i = 1, count(1)
            second(:count(2) - 1, i, p) = [((k + 0.1_wp*i - 0.1_wp*p)/count(2), k=1, count(2) - 1)]
            do j = 1, count(2)
               sorted = 0.1_wp*j + 0.05_wp*i
               third(:count(3) - 1, j, i, p) = [((k + sorted)/count(3), k=1, count(3) - 1)]
            end do
         end do
      end do
      call random_number(key)
      call random_number(over)
      key = 1.5_wp*key - 0.2_wp
      over(1, :) = 0  ! of a boulder that is hardly moving
      contact = [(n + 1 - k, k=1, n)]
      part = [(1 + mod(k, parts), k=1, n)]
      bin = 0
      if (copy == 1) call narrow_bins(n, contact, key(:, 1), over(:, 1), key(:, 2), over(:, 2), key(:, 3), part, &
                                      count, vectors, first, second, third, bin)
      if (copy == 2) call wide_bins(n, contact, key(:, 1), over(:, 1), key(:, 2), over(:, 2), key(:, 3), part, &
                                    count, vectors, first, second, third, bin)
      do m = 1, n
         p = part(m)
         i = 1
         do k = 1, count(1) - 1
            if (first(k, p)*over(m, 1) < key(m, 1)) i = i + 1
         end do
         j = 1
         do k = 1, count(2) - 1
            if (second(k, i, p)*over(m, 2) < key(m, 2)) j = j + 1
         end do
         expected = ((i - 1)*count(2) + j - 1)*count(3) + 1
         do k = 1, count(3) - 1
            if (third(k, j, i, p) < key(m, 3)) expected = expected + 1
         end do
         if (bin(m) /= expected) call check("the bin of one contact", .false.)
      end do
      call check("all have a bin", all(bin > 0))
   end subroutine check_bins
end program test_table_rows
