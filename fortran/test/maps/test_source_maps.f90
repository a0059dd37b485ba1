! SPDX-License-Identifier: BSD-3-Clause
!> Maps by source: a source counts once per cell, whether run by one thread or many, and ranges of boulders find the
!> sources that they split.
program test_source_maps
   use rockfall_kinds, only: wp, i4, i8
   use rockfall_boulder, only: release_t
   use rockfall_maps, only: maps_t, visits_t, needs_visits, start_visits, visit_cell, join_visits
   use rockfall_source_maps, only: contributing_t, counts_sources, gather_cells, add_source, add_source_of_boulder, &
                                   partial_sources, first_partial, contributing_cells, adjust_released
   use check_m, only: check, finish
   implicit none

   integer, parameter :: nx = 30, ny = 20
   integer(i4), target :: sources(nx, ny), released(nx, ny), last_source(nx, ny, 2)
   type(maps_t) :: maps, none
   type(release_t) :: release

   release%boulders_per_source = 10
   maps%sources => sources
   maps%released => released
   maps%last_source => last_source
   call check("what maps ask", counts_sources(maps) .and. needs_visits(maps) .and. .not. counts_sources(none))
   call test_gathered()
   call test_shared()
   call test_first_partial()
   call test_partial()
   call test_settled()
   call finish()

contains

   subroutine clear()
      sources = 0
      released = 0
      last_source = 0
      maps%first_partial = 0
   end subroutine clear

   !> Boulder b of 1..10 of a source passes columns b to b + 5 of all rows.
   pure subroutine pass(visits, number)
      type(visits_t), intent(inout) :: visits
      integer(i8), intent(in) :: number
      integer :: b, i, r

      b = int(mod(number - 1, 10_i8)) + 1
      call start_visits(visits)
      do r = 1, ny
         do i = b, b + 5
            call visit_cell(visits, [i, r], 0.0_wp, 0.0_wp, 0.0_wp)
         end do
      end do
   end subroutine pass

   !> One thread runs each source; with so many cells, the list of visits must grow.
   subroutine test_gathered()
      integer(i8) :: s

      call clear()
      !$omp parallel do num_threads(8)
      do s = 1, 50
         call gather_all(s)
      end do
      !$omp end parallel do
      call check("gathered", all(sources(:15, :) == 50) .and. all(sources(16:, :) == 0))
      call check("and their boulders", all(released == 10*sources))
   end subroutine test_gathered

   subroutine gather_all(source)
      integer(i8), intent(in) :: source
      type(visits_t) :: visits, cells
      integer(i8) :: b

      call start_visits(cells)
      do b = 10*source - 9, 10*source
         call pass(visits, b)
         call gather_cells(cells, visits)
      end do
      call join_visits(cells)
      call add_source(maps, cells, 10_i8)
   end subroutine gather_all

   !> All threads share a source, one source after the other.
   subroutine test_shared()
      integer(i8) :: s, b

      call clear()
      do s = 1, 50
         !$omp parallel do num_threads(8) schedule(dynamic, 1)
         do b = 10*s - 9, 10*s
            call count_twice(s, b)
         end do
         !$omp end parallel do
      end do
      call check("shared", all(sources(:15, :) == 50) .and. all(sources(16:, :) == 0))
      call check("and their boulders", all(released == 10*sources))
      call check("the last stays", all(last_source(:15, :, 1) == 50) .and. all(last_source(:, :, 2) == 0))
   end subroutine test_shared

   subroutine count_twice(source, number)
      integer(i8), intent(in) :: source, number
      type(visits_t) :: visits
      integer :: turn

      call pass(visits, number)
      do turn = 1, 2
         call add_source_of_boulder(maps, visits, source, 10_i8)
      end do
   end subroutine count_twice

   !> The first source of a range is not overwritten in `last_source`.
   subroutine test_first_partial()
      type(visits_t) :: visits
      type(contributing_t) :: cells
      integer(i8) :: b
      integer :: k

      call clear()
      maps%first_partial = first_partial(release, 9_i8)
      call check("the range begins within the first source", maps%first_partial == 1)
      do b = 9, 33
         call pass(visits, b)
         call add_source_of_boulder(maps, visits, (b + 9)/10, 10_i8)
      end do
      cells = contributing_cells(maps, release, 9_i8, 33_i8)
      call check("cells of both ends", size(cells%cell) == 7*ny + 8*ny)
      associate (at => [(int(mod(cells%cell(k), int(nx, i8))) + 1, k=1, size(cells%cell))])
         call check("of the first source", all(pack(at, cells%source == 1) >= 9) .and. count(cells%source == 1) == 7*ny)
         call check("of the last", all(pack(at, cells%source == 4) <= 8) .and. count(cells%source == 4) == 8*ny)
      end associate
      call check("their boulders", all(cells%boulders == merge(2, 3, cells%source == 1)))
      call adjust_released(maps, release, cells, 1)
      call check("boulders of the range only", all(released(1:8, :) == 20 + 3) .and. all(released(9:15, :) == 20 + 2))
      call check("sources stay", all(sources(1:15, :) == 3) .and. all(sources(16:, :) == 0))
   end subroutine test_first_partial

   subroutine test_partial()
      call check("whole sources", size(partial_sources(release, 11_i8, 30_i8)) == 0 &
                 .and. first_partial(release, 11_i8) == 0)
      call check("the first", all(partial_sources(release, 12_i8, 30_i8) == [2_i8]) &
                 .and. first_partial(release, 12_i8) == 2)
      call check("the last", all(partial_sources(release, 11_i8, 29_i8) == [3_i8]))
      call check("both", all(partial_sources(release, 20_i8, 21_i8) == [2_i8, 3_i8]))
      call check("within one", all(partial_sources(release, 12_i8, 19_i8) == [2_i8]))
      call check("from its begin", all(partial_sources(release, 11_i8, 19_i8) == [2_i8]))
      call check("no boulder", size(partial_sources(release, 12_i8, 11_i8)) == 0)
   end subroutine test_partial

   !> Without a map of reach probability, nothing is adjusted.
   subroutine test_settled()
      type(maps_t) :: some
      type(contributing_t) :: cells, nothing

      call clear()
      some%sources => sources
      some%last_source => last_source
      last_source(3, 2, 1) = 1
      cells = contributing_cells(some, release, 1_i8, 4_i8)
      call check("row by row from the north-west", all(cells%cell == [nx + 2_i8]) .and. all(cells%boulders == [4]))
      call adjust_released(some, release, cells, 1)
      call check("nothing to settle", all(sources == 0))
      nothing = contributing_cells(none, release, 1_i8, 4_i8)
      call check("no map, no cells", size(nothing%cell) == 0)
   end subroutine test_settled
end program test_source_maps
