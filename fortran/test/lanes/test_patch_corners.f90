! SPDX-License-Identifier: BSD-3-Clause
!> Elevations of several patches and cells at a time: equal to plain indexing, in all compiled versions.
program test_patch_corners
   use, intrinsic :: iso_c_binding, only: c_int
   use rockfall_kinds, only: wp, sp, i8
   use rockfall_scene_type, only: narrow_lanes, wide_lanes, masked_lanes
   use rockfall_flights, only: narrow_corners => read_corners
   use rockfall_wide_flights, only: wide_corners => read_corners
   use rockfall_masked_flights, only: masked_corners => read_corners
   use rockfall_lanes, only: narrow_squares => read_squares
   use rockfall_wide_lanes, only: wide_squares => read_squares
   use rockfall_masked_lanes, only: masked_squares => read_squares
   use check_m, only: check, finish
   implicit none

   interface
      integer(c_int) function supported_lanes() bind(c, name="rockfall_supported_lanes")
         import :: c_int
      end function supported_lanes
   end interface

   integer, parameter :: n = 60, columns = 7, rows = 9, lanes = 72
   real(sp) :: z(columns, rows)
   real(wp) :: at(n), corner(n, 4), square(lanes, 9)
   integer :: column(n), row(n), west(n), north(n), copy, k

   call random_number(z)
   column = [(1 + mod(5*k, columns - 1), k=1, n)]
   row = [(2 + mod(3*k, rows - 1), k=1, n)]
   west = min(column, columns - 2)
   north = min(row, rows - 2)
   do copy = narrow_lanes, supported_lanes()
      at = column + (row - 1)*columns
      if (copy == narrow_lanes) call narrow_corners(n, at, int(columns, i8), z, corner(:, 1), corner(:, 2), &
                                                    corner(:, 3), corner(:, 4))
      if (copy == wide_lanes) call wide_corners(n, at, int(columns, i8), z, corner(:, 1), corner(:, 2), &
                                                corner(:, 3), corner(:, 4))
      if (copy == masked_lanes) call masked_corners(n, at, int(columns, i8), z, corner(:, 1), corner(:, 2), &
                                                    corner(:, 3), corner(:, 4))
      call check("corners, from the south-west", all([(corners_agree(k), k=1, n)]))

      at = west + (north - 1)*columns
      square = -1
      if (copy == narrow_lanes) call narrow_squares(n, at, int(columns, i8), z, int(lanes, i8), square)
      if (copy == wide_lanes) call wide_squares(n, at, int(columns, i8), z, int(lanes, i8), square)
      if (copy == masked_lanes) call masked_squares(n, at, int(columns, i8), z, int(lanes, i8), square)
      call check("squares, row by row", all([(square_agrees(k), k=1, n)]))
      call check("nothing else is written", all(abs(square(n + 1:, :) + 1) <= 0))
   end do
   call finish()

contains

   logical function corners_agree(k)
      integer, intent(in) :: k

      associate (i => column(k), r => row(k))
         corners_agree = all(abs(corner(k, :) - [z(i, r), z(i + 1, r), z(i, r - 1), z(i + 1, r - 1)]) <= 0)
      end associate
   end function corners_agree

   logical function square_agrees(k)
      integer, intent(in) :: k

      associate (i => west(k), r => north(k))
         square_agrees = all(abs(square(k, :) - reshape(z(i:i + 2, r:r + 2), [9])) <= 0)
      end associate
   end function square_agrees
end program test_patch_corners
