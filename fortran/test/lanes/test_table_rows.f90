! SPDX-License-Identifier: BSD-3-Clause
!> Bins and rows of tables for several contacts at a time: bitwise identical to plain loops and to single contacts, in
!> all compiled versions.
program test_table_rows
   use, intrinsic :: iso_c_binding, only: c_int, c_ptr, c_loc
   use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_positive_inf, ieee_negative_inf
   use rockfall_kinds, only: wp, sp
   use rockfall_impact_table, only: bins_t, key_bin, edge_vector
   use rockfall_table_lanes, only: narrow_rows => read_rows, narrow_bins => find_bins
   use rockfall_wide_table_lanes, only: wide_rows => read_rows, wide_bins => find_bins
   use rockfall_masked_table_lanes, only: masked_rows => read_rows, masked_bins => find_bins
   use rockfall_scene_type, only: narrow_lanes, wide_lanes, masked_lanes
   use check_m, only: check, finish
   implicit none

   interface
      integer(c_int) function supported_lanes() bind(c, name="rockfall_supported_lanes")
         import :: c_int
      end function supported_lanes
   end interface

   integer :: copy

   do copy = narrow_lanes, supported_lanes()
      call check_rows()
      call check_bins([5, 3, 12])
      call check_bins([6, 4, 1])  ! last key without edges
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
      if (copy == narrow_lanes) call narrow_rows(n, column, fields, record_at, record, others, map_at, map)
      if (copy == wide_lanes) call wide_rows(n, column, fields, record_at, record, others, map_at, map)
      if (copy == masked_lanes) call masked_rows(n, column, fields, record_at, record, others, map_at, map)
      equal = .true.
      do k = 1, n
         equal = equal .and. all(abs(record(k, :) - real(single(:, row(k)), wp)) <= 0)
         equal = equal .and. all(abs(map(k, :) - double(:, row(3*k))) <= 0)
      end do
      call check("rows become columns", equal)
   end subroutine check_rows

   !> Row of a contact: any row, and some rows twice.
   pure integer function row(k)
      integer, intent(in) :: k

      row = 1 + mod(7*k*k, 31)
   end function row

   !> Compare the bins of contacts: random keys, keys equal to an edge, infinite keys; some edges are infinite.
   subroutine check_bins(count)
      integer, intent(in) :: count(3)
      integer, parameter :: n = 600, parts = 3
      type(bins_t) :: bins
      real(wp) :: key(n, 3), over(n, 2)
      integer :: contact(n), part(n), bin(n), k, m

      bins = made_bins(count, parts)
      call random_number(key)
      call random_number(over)
      key = 1.5_wp*key - 0.2_wp
      over(1, :) = 0  ! a boulder that hardly moves
      contact = [(n + 1 - k, k=1, n)]
      part = [(1 + mod(k, parts), k=1, n)]
      do m = 1, n/3
         call meet_edges(bins, part(m), key(m, :), over(m, :), 1 + mod(m, maxval(count)))
      end do
      do k = 1, 3
         key(n - 60 + k::6, k) = ieee_value(0.0_wp, ieee_positive_inf)
         key(n - 60 + k + 3::6, k) = ieee_value(0.0_wp, ieee_negative_inf)
      end do
      bin = 0
      select case (copy)
      case (narrow_lanes)
         call narrow_bins(n, contact, key(:, 1), over(:, 1), key(:, 2), over(:, 2), key(:, 3), part, bins%n, &
                          bins%vectors, bins%first_edge, bins%second_edge, bins%third_edge, bin)
      case (wide_lanes)
         call wide_bins(n, contact, key(:, 1), over(:, 1), key(:, 2), over(:, 2), key(:, 3), part, bins%n, &
                        bins%vectors, bins%first_edge, bins%second_edge, bins%third_edge, bin)
      case default
         call masked_bins(n, contact, key(:, 1), over(:, 1), key(:, 2), over(:, 2), key(:, 3), part, bins%n, &
                          bins%vectors, bins%first_edge, bins%second_edge, bins%third_edge, bin)
      end select
      call check("plain loops find these bins", &
                 all(bin == [(plain_bin(bins, part(m), key(m, :), over(m, :)), m=1, n)]))
      call check("one contact finds the same", all(bin == [(key_bin(bins, part(m), key(m, :), over(m, :)), m=1, n)]))
   end subroutine check_bins

   !> Bins with different edges for each part, and for each bin of the previous keys.
   function made_bins(count, parts) result(bins)
      integer, intent(in) :: count(3), parts
      type(bins_t) :: bins
      real(wp) :: shift
      integer :: edges(3), i, j, k, p

      bins%n = count
      bins%total = product(count)
      bins%vectors = (count - 1 + edge_vector - 1)/edge_vector
      edges = edge_vector*bins%vectors
      allocate (bins%first_edge(edges(1), parts), bins%second_edge(edges(2), count(1), parts), &
                bins%third_edge(edges(3), count(2), count(1), parts), source=huge(1.0_wp))
      do p = 1, parts
         bins%first_edge(:count(1) - 1, p) = [((k + 0.1_wp*p)/count(1), k=1, count(1) - 1)]
         do i = 1, count(1)
            bins%second_edge(:count(2) - 1, i, p) = [((k + 0.1_wp*i - 0.1_wp*p)/count(2), k=1, count(2) - 1)]
            do j = 1, count(2)
               shift = 0.1_wp*j + 0.05_wp*i
               bins%third_edge(:count(3) - 1, j, i, p) = [((k + shift)/count(3), k=1, count(3) - 1)]
            end do
         end do
      end do
      bins%first_edge(max(1, count(1) - 1):count(1) - 1, parts) = ieee_value(0.0_wp, ieee_positive_inf)
      bins%third_edge(max(1, count(3) - 1):count(3) - 1, 1, :, parts) = ieee_value(0.0_wp, ieee_positive_inf)
   end function made_bins

   !> Set the keys of a contact to an edge: of the first key, then of each next key in the bin of the previous keys.
   subroutine meet_edges(bins, part, key, over, edge)
      type(bins_t), intent(in) :: bins
      integer, intent(in) :: part, edge  !! number of the edge for each key, if it has that many
      real(wp), intent(inout) :: key(3)
      real(wp), intent(in) :: over(2)
      integer :: i, j, bin

      if (edge < bins%n(1)) key(1) = bins%first_edge(edge, part)*over(1)
      bin = plain_bin(bins, part, key, over) - 1
      i = 1 + bin/(bins%n(2)*bins%n(3))
      if (edge < bins%n(2)) key(2) = bins%second_edge(edge, i, part)*over(2)
      bin = plain_bin(bins, part, key, over) - 1
      j = 1 + mod(bin/bins%n(3), bins%n(2))
      if (edge < bins%n(3)) key(3) = bins%third_edge(edge, j, i, part)
   end subroutine meet_edges

   !> Bin of a contact, by comparison with the edges that exist.
   pure integer function plain_bin(bins, part, key, over) result(bin)
      type(bins_t), intent(in) :: bins
      integer, intent(in) :: part
      real(wp), intent(in) :: key(3), over(2)
      integer :: i, j, k

      i = 1
      do k = 1, bins%n(1) - 1
         if (bins%first_edge(k, part)*over(1) < key(1)) i = i + 1
      end do
      j = 1
      do k = 1, bins%n(2) - 1
         if (bins%second_edge(k, i, part)*over(2) < key(2)) j = j + 1
      end do
      bin = ((i - 1)*bins%n(2) + j - 1)*bins%n(3) + 1
      do k = 1, bins%n(3) - 1
         if (bins%third_edge(k, j, i, part) < key(3)) bin = bin + 1
      end do
   end function plain_bin
end program test_table_rows
