! SPDX-License-Identifier: BSD-3-Clause
!> Maps by source: how many sources feed a cell (one of their boulders passed it), and how many boulders these
!> release. A source counts once a cell, however its boulders are spread over threads, calls and parts.
!>
!> Boulders of a source follow each other. A source that one thread flies as a whole gathers its cells first.
!> One that several threads or calls share leaves its number in `stamp` where it was counted; calls come in
!> order, so a cell that has the number of a later source is done with the earlier one.
module rockfall_sourcemap
   use rockfall_kinds, only: wp, i4, i8
   use rockfall_boulder, only: release_t, source_of, first_of, last_of, released_by
   use rockfall_map, only: maps_t, visits_t, visit_cell
   implicit none
   private
   public :: fed_t, tells_sources, gather, add_source, stamp_source, cut_sources, head_source, fed_cells, settle

   !> The cells that the sources feed which a range of boulders cuts, by source.
   type :: fed_t
      integer(i8), allocatable :: cell(:)      !! counted from 0, by rows from the north-west
      integer(i4), allocatable :: source(:)
      integer(i4), allocatable :: boulders(:)  !! of the source, in the range
   end type fed_t

contains

   !> True if a map asks which source a boulder has.
   pure logical function tells_sources(maps)
      type(maps_t), intent(in) :: maps

      tells_sources = associated(maps%sources) .or. associated(maps%released)
   end function tells_sources

   !> Add a boulder's cells to those of its source.
   pure subroutine gather(cells, visits)
      type(visits_t), intent(inout) :: cells  !! begun with start_visits
      type(visits_t), intent(in) :: visits
      integer :: k

      do k = 1, visits%n
         call visit_cell(cells, visits%slot(visits%used(k))%at, 0.0_wp, 0.0_wp, 0.0_wp)
      end do
   end subroutine gather

   !> Count a whole source in its cells; many threads may do so at once.
   subroutine add_source(maps, cells, boulders)
      type(maps_t), intent(in) :: maps
      type(visits_t), intent(in) :: cells
      integer(i8), intent(in) :: boulders  !! of the source
      integer :: k

      do k = 1, cells%n
         call count_in(maps, cells%slot(cells%used(k))%at, int(boulders, i4))
      end do
   end subroutine add_source

   !> Count a source in those cells of one of its boulders that it is not counted in yet. Threads may do so at
   !> once, for the same source.
   subroutine stamp_source(maps, visits, source, boulders)
      type(maps_t), intent(in) :: maps
      type(visits_t), intent(in) :: visits
      integer(i8), intent(in) :: source, boulders
      integer(i4) :: number, before
      integer :: k, layer

      number = int(source, i4)
      layer = merge(2, 1, source == maps%head)
      do k = 1, visits%n
         associate (at => visits%slot(visits%used(k))%at)
            !$omp atomic read
            before = maps%stamp(at(1), at(2), layer)
            if (before == number) cycle
            !$omp atomic capture
            before = maps%stamp(at(1), at(2), layer)
            maps%stamp(at(1), at(2), layer) = number
            !$omp end atomic
            if (before /= number) call count_in(maps, at, int(boulders, i4))
         end associate
      end do
   end subroutine stamp_source

   subroutine count_in(maps, at, boulders)
      type(maps_t), intent(in) :: maps
      integer, intent(in) :: at(2)
      integer(i4), intent(in) :: boulders

      if (associated(maps%sources)) then
         !$omp atomic update
         maps%sources(at(1), at(2)) = maps%sources(at(1), at(2)) + 1
      end if
      if (associated(maps%released)) then
         !$omp atomic update
         maps%released(at(1), at(2)) = maps%released(at(1), at(2)) + boulders
      end if
   end subroutine count_in

   !> The sources of which boulders first..last are some but not all: none, one or two.
   pure function cut_sources(release, first, last) result(sources)
      type(release_t), intent(in) :: release
      integer(i8), intent(in) :: first, last
      integer(i8), allocatable :: sources(:)
      integer(i8) :: ends(2)
      logical :: cut(2)

      if (last < first) then
         allocate (sources(0))
         return
      end if
      ends = [source_of(release, first), source_of(release, last)]
      cut = [first > first_of(release, ends(1)), last < last_of(release, ends(2))]
      cut(2) = cut(2) .and. .not. (cut(1) .and. ends(1) == ends(2))
      sources = pack(ends, cut)
   end function cut_sources

   !> The source in the middle of which a range of boulders begins, 0 without one: a later source must not take
   !> its place in `stamp`.
   pure integer(i8) function head_source(release, first)
      type(release_t), intent(in) :: release
      integer(i8), intent(in) :: first

      head_source = source_of(release, first)
      if (first == first_of(release, head_source)) head_source = 0
   end function head_source

   !> The cells of the sources that a range of boulders cuts.
   pure function fed_cells(maps, release, first, last) result(fed)
      type(maps_t), intent(in) :: maps
      type(release_t), intent(in) :: release
      integer(i8), intent(in) :: first, last  !! boulders done
      type(fed_t) :: fed
      integer(i8), allocatable :: sources(:)
      integer(i8) :: n, own
      integer :: i, j, k, layer, turn

      sources = cut_sources(release, first, last)
      if (.not. tells_sources(maps)) sources = [integer(i8) ::]
      do turn = 1, 2  ! count them, then note them
         n = 0
         do k = 1, size(sources)
            layer = merge(2, 1, sources(k) == maps%head)
            own = min(last, last_of(release, sources(k))) - max(first, first_of(release, sources(k))) + 1
            do j = 1, size(maps%stamp, 2)
               do i = 1, size(maps%stamp, 1)
                  if (maps%stamp(i, j, layer) /= sources(k)) cycle
                  n = n + 1
                  if (turn == 1) cycle
                  fed%cell(n) = (j - 1)*size(maps%stamp, 1, i8) + i - 1
                  fed%source(n) = int(sources(k), i4)
                  fed%boulders(n) = int(own, i4)
               end do
            end do
         end do
         if (turn == 1) allocate (fed%cell(n), fed%source(n), fed%boulders(n))
      end do
   end function fed_cells

   !> Of the boulders of cut sources, leave only those of the range in the cells that they feed (sign 1), as a part
   !> of a run has it; or all of them again (sign -1), as a run has that goes on.
   pure subroutine settle(maps, release, fed, sign)
      type(maps_t), intent(inout) :: maps
      type(release_t), intent(in) :: release
      type(fed_t), intent(in) :: fed
      integer, intent(in) :: sign
      integer :: i, j, k

      if (.not. associated(maps%released)) return
      do k = 1, size(fed%cell)
         i = int(mod(fed%cell(k), size(maps%released, 1, i8))) + 1
         j = int(fed%cell(k)/size(maps%released, 1)) + 1
         maps%released(i, j) = maps%released(i, j) &
                               + sign*(fed%boulders(k) - int(released_by(release, int(fed%source(k), i8)), i4))
      end do
   end subroutine settle
end module rockfall_sourcemap
