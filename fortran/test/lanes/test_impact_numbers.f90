! SPDX-License-Identifier: BSD-3-Clause
!> Random numbers of several impacts at a time: bitwise identical to rockfall_random, in all compiled versions.
program test_impact_numbers
   use, intrinsic :: iso_c_binding, only: c_int
   use rockfall_kinds, only: wp, i8
   use rockfall_random, only: random_key_t, random_key, random_words, normal_table_t, normal_table, normal, &
                              for_impact, last_counter, fragment_number
   use rockfall_scene_type, only: narrow_lanes, wide_lanes
   use rockfall_lanes, only: narrow_numbers => impact_numbers
   use rockfall_wide_lanes, only: wide_numbers => impact_numbers
   use rockfall_masked_lanes, only: masked_numbers => impact_numbers
   use check_m, only: check, finish
   implicit none

   interface
      integer(c_int) function supported_lanes() bind(c, name="rockfall_supported_lanes")
         import :: c_int
      end function supported_lanes
   end interface

   integer, parameter :: n = 4096
   integer(i8) :: number(n), impact(n), word(n, 4), expected(4)
   real(wp) :: z(n, 3)
   type(normal_table_t) :: table
   type(random_key_t) :: key
   integer :: copy, draw, k

   table = normal_table()
   key = random_key(1234567890123_i8)
   number = [(k*7919_i8, k=1, n)]
   number(n/2:) = fragment_number(number(n/2:), 3_i8)
   impact = [(1_i8 + mod(k, 321), k=1, n)]
   impact(n) = huge(1)
   do copy = narrow_lanes, supported_lanes()
      do draw = 0, 31
         word = -1
         select case (copy)
         case (narrow_lanes)
            call narrow_numbers(key%round, table%c, 1, n - 2, number, impact, last_counter(for_impact, int(draw, i8)), &
                                word(:, 1), word(:, 2), word(:, 3), word(:, 4), z(:, 1), z(:, 2), z(:, 3))
         case (wide_lanes)
            call wide_numbers(key%round, table%c, 1, n - 2, number, impact, last_counter(for_impact, int(draw, i8)), &
                              word(:, 1), word(:, 2), word(:, 3), word(:, 4), z(:, 1), z(:, 2), z(:, 3))
         case default
            call masked_numbers(key%round, table%c, 1, n - 2, number, impact, last_counter(for_impact, int(draw, i8)), &
                                word(:, 1), word(:, 2), word(:, 3), word(:, 4), z(:, 1), z(:, 2), z(:, 3))
         end select
         do k = 1, n - 2
            expected = random_words(key, for_impact, number(k), impact(k), int(draw, i8))
            if (all(word(k, :) == expected) .and. all(abs(z(k, :) - normal(table, expected(:3))) <= 0)) cycle
            call check("the words and numbers of one impact", .false.)
         end do
         call check("all", all(word(:n - 2, :) >= 0))
      end do
   end do
   call finish()
end program test_impact_numbers
