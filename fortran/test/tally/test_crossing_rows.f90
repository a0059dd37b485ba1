! SPDX-License-Identifier: BSD-3-Clause
!> Rows of crossings: appended, sorted by line and boulder from any order of arrival, and duplicates found.
program test_crossing_rows
   use rockfall_kinds, only: sp, i8
   use rockfall_crossing_rows, only: crossing_rows_t, start_rows, make_room, append_rows, sort_rows, &
                                     first_unsorted, n_reals
   use check_m, only: check, finish
   implicit none

   integer, parameter :: lines = 7, boulders = 500
   type(crossing_rows_t) :: found, part
   logical :: fit, good
   integer(i8) :: k

   call start_rows(.true., .true., found)
   call sort_rows(lines, found, fit)
   call check("no rows are sorted", fit .and. found%n == 0 .and. first_unsorted(found) == 1)
   ! every third boulder, then the boulders in between, in parts
   call add_part(1, 3)
   call add_part(3, 3)
   call add_part(2, 3)
   call check("all came", found%n == sum([(count_of(int(k)), k=1, boulders)]))
   call sort_rows(lines, found, fit)
   good = fit
   do k = 2, found%n
      good = good .and. (found%line(k) > found%line(k - 1) .or. (found%line(k) == found%line(k - 1) .and. &
                                                             found%boulder(k) > found%boulder(k - 1)))
   end do
   call check("sorted by line, then by boulder, none twice", good .and. first_unsorted(found) == found%n + 1)
   call check("each row whole", all([(is_whole(found, k), k=1, found%n)]))
   call add_row(found, int(found%boulder(found%n)), int(found%line(found%n)))
   call check("one twice", first_unsorted(found) == found%n)
   call finish()

contains

   !> Add a part with every `step`-th boulder; each crosses some lines, in any order.
   subroutine add_part(first, step)
      integer, intent(in) :: first, step
      integer :: boulder, j
      logical :: fit

      call start_rows(.true., .true., part)
      do boulder = first, boulders, step
         do j = count_of(boulder), 1, -1
            call add_row(part, boulder, mod(boulder + 3*j, lines))
         end do
      end do
      call append_rows(found, part, fit)
      call check("a part fits", fit)
   end subroutine add_part

   !> Number of lines that a boulder crosses.
   pure integer function count_of(boulder)
      integer, intent(in) :: boulder

      count_of = mod(boulder, 5)
   end function count_of

   subroutine add_row(rows, boulder, line)
      type(crossing_rows_t), intent(inout) :: rows
      integer, intent(in) :: boulder, line
      integer :: j
      logical :: fit

      call make_room(rows, 1_i8, fit)
      rows%n = rows%n + 1
      rows%boulder(rows%n) = boulder
      rows%line(rows%n) = line
      do j = 1, n_reals
         rows%real(j)%of(rows%n) = real(100*boulder + 10*line + j, sp)
      end do
      rows%volume(rows%n) = real(boulder, sp)
      rows%fragments(rows%n) = line
      rows%outcome(rows%n) = int(mod(line, 4), kind(rows%outcome))
   end subroutine add_row

   pure logical function is_whole(rows, k)
      type(crossing_rows_t), intent(in) :: rows
      integer(i8), intent(in) :: k
      integer :: j

      is_whole = nint(rows%volume(k)) == rows%boulder(k) .and. rows%fragments(k) == rows%line(k) &
                 .and. rows%outcome(k) == mod(rows%line(k), 4)
      do j = 1, n_reals
         is_whole = is_whole .and. nint(rows%real(j)%of(k)) == 100*rows%boulder(k) + 10*rows%line(k) + j
      end do
   end function is_whole
end program test_crossing_rows
