! SPDX-License-Identifier: BSD-3-Clause
!> Maps by source: a source counts once a cell, gathered by one thread or stamped by many, and ranges of
!> boulders know the sources that they cut.
program test_sourcemap
   use rockfall_kinds, only: wp, i4, i8
   use rockfall_boulder, only: release_t
   use rockfall_map, only: maps_t, visits_t, follows_cells, start_visits, visit_cell
   use rockfall_sourcemap, only: fed_t, tells_sources, gather, add_source, stamp_source, cut_sources, head_source, &
                                 fed_cells, settle
   use check_m, only: check, finish
   implicit none

   integer, parameter :: nx = 30, ny = 20
   integer(i4), target :: sources(nx, ny), released(nx, ny), stamp(nx, ny, 2)
   type(maps_t) :: maps, none
   type(release_t) :: release

   release%boulders_per_source = 10
   maps%sources => sources
   maps%released => released
   maps%stamp => stamp
   call check("what maps ask", tells_sources(maps) .and. follows_cells(maps) .and. .not. tells_sources(none))
   call test_gathered()
   call test_stamped()
   call test_head()
   call test_cut()
   call test_settled()
   call finish()

contains

   subroutine clear()
      sources = 0
      released = 0
      stamp = 0
      maps%head = 0
   end subroutine clear

   !> Boulder b of 1..10 of a source passes columns b to b + 5 of all rows.
   pure subroutine pass(visits, number)
      type(visits_t), intent(inout) :: visits
      integer(i8), intent(in) :: number
      integer :: b, i, r

      b = int(mod(number - 1, 10_i8)) + 1
      call start_visits(visits, number)
      do r = 1, ny
         do i = b, b + 5
            call visit_cell(visits, [i, r], 0.0_wp, 0.0_wp, 0.0_wp)
         end do
      end do
   end subroutine pass

   !> Each source is one thread's; many cells, so that the table grows.
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

      call start_visits(cells, source)
      do b = 10*source - 9, 10*source
         call pass(visits, b)
         call gather(cells, visits)
      end do
      call add_source(maps, cells, 10_i8)
   end subroutine gather_all

   !> All threads share a source, one source after the other.
   subroutine test_stamped()
      integer(i8) :: s, b

      call clear()
      do s = 1, 50
         !$omp parallel do num_threads(8) schedule(dynamic, 1)
         do b = 10*s - 9, 10*s
            call stamp_twice(s, b)
         end do
         !$omp end parallel do
      end do
      call check("stamped", all(sources(:15, :) == 50) .and. all(sources(16:, :) == 0))
      call check("and their boulders", all(released == 10*sources))
      call check("the last stays", all(stamp(:15, :, 1) == 50) .and. all(stamp(:, :, 2) == 0))
   end subroutine test_stamped

   subroutine stamp_twice(source, number)
      integer(i8), intent(in) :: source, number
      type(visits_t) :: visits
      integer :: turn

      call pass(visits, number)
      do turn = 1, 2
         call stamp_source(maps, visits, source, 10_i8)
      end do
   end subroutine stamp_twice

   !> The source in which a range begins keeps its stamps.
   subroutine test_head()
      type(visits_t) :: visits
      type(fed_t) :: fed
      integer(i8) :: b
      integer :: k

      call clear()
      maps%head = head_source(release, 9_i8)
      call check("the range begins within the first source", maps%head == 1)
      do b = 9, 33
         call pass(visits, b)
         call stamp_source(maps, visits, (b + 9)/10, 10_i8)
      end do
      fed = fed_cells(maps, release, 9_i8, 33_i8)
      call check("cells of both ends", size(fed%cell) == 7*ny + 8*ny)
      associate (at => [(int(mod(fed%cell(k), int(nx, i8))) + 1, k=1, size(fed%cell))])
         call check("of the first source", all(pack(at, fed%source == 1) >= 9) .and. count(fed%source == 1) == 7*ny)
         call check("of the last", all(pack(at, fed%source == 4) <= 8) .and. count(fed%source == 4) == 8*ny)
      end associate
      call check("their boulders", all(fed%boulders == merge(2, 3, fed%source == 1)))
      call settle(maps, release, fed, 1)
      call check("boulders of the range only", all(released(1:8, :) == 20 + 3) .and. all(released(9:15, :) == 20 + 2))
      call check("sources stay", all(sources(1:15, :) == 3) .and. all(sources(16:, :) == 0))
   end subroutine test_head

   subroutine test_cut()
      call check("whole sources", size(cut_sources(release, 11_i8, 30_i8)) == 0 .and. head_source(release, 11_i8) == 0)
      call check("the first", all(cut_sources(release, 12_i8, 30_i8) == [2_i8]) .and. head_source(release, 12_i8) == 2)
      call check("the last", all(cut_sources(release, 11_i8, 29_i8) == [3_i8]))
      call check("both", all(cut_sources(release, 20_i8, 21_i8) == [2_i8, 3_i8]))
      call check("within one", all(cut_sources(release, 12_i8, 19_i8) == [2_i8]))
      call check("from its begin", all(cut_sources(release, 11_i8, 19_i8) == [2_i8]))
      call check("no boulder", size(cut_sources(release, 12_i8, 11_i8)) == 0)
   end subroutine test_cut

   !> Without a map of shares there is nothing to settle.
   subroutine test_settled()
      type(maps_t) :: some
      type(fed_t) :: fed, nothing

      call clear()
      some%sources => sources
      some%stamp => stamp
      stamp(3, 2, 1) = 1
      fed = fed_cells(some, release, 1_i8, 4_i8)
      call check("by rows from the north-west", all(fed%cell == [nx + 2_i8]) .and. all(fed%boulders == [4]))
      call settle(some, release, fed)
      call check("nothing to settle", all(sources == 0))
      nothing = fed_cells(none, release, 1_i8, 4_i8)
      call check("no map, no cells", size(nothing%cell) == 0)
   end subroutine test_settled
end program test_sourcemap
