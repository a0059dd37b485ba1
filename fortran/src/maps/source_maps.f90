! SPDX-License-Identifier: BSD-3-Clause
!> Maps by source: the number of sources that contribute to a cell (at least one of their boulders passed it), and the
!> number of boulders released by these sources. A source counts once per cell, however its boulders are distributed
!> over threads, calls and parts.
!>
!> Boulders of a source are consecutive. If one thread runs all boulders of a source, it collects the cells first. If
!> several threads or calls share a source, its number is written to `last_source` when it is counted. Calls come in
!> order: where a cell has the number of a later source, earlier sources are complete.
module rockfall_source_maps
   use rockfall_kinds, only: wp, i4, i8
   use rockfall_boulder, only: release_t, source_of, first_of, last_of, released_by
   use rockfall_maps, only: maps_t, visits_t, visit_cell
   implicit none
   private
   public :: contributing_t, counts_sources, gather_cells, add_source, add_source_of_boulder
   public :: partial_sources, first_partial, contributing_cells, boulders_within, adjust_released

   !> Cells to which partial sources (with only some of their boulders in the range) contribute, by source.
   type :: contributing_t
      integer(i8), allocatable :: cell(:)      !! cell number from 0, row by row from the north-west
      integer(i4), allocatable :: source(:)
      integer(i4), allocatable :: boulders(:)  !! number of the source's boulders in the range
   end type contributing_t

contains

   !> Return whether a map counts sources.
   pure logical function counts_sources(maps)
      type(maps_t), intent(in) :: maps

      counts_sources = associated(maps%sources) .or. associated(maps%released)
   end function counts_sources

   !> Add a boulder's cells to the cells of its source; after `join_visits` each cell occurs once.
   pure subroutine gather_cells(cells, visits)
      type(visits_t), intent(inout) :: cells  !! started with start_visits
      type(visits_t), intent(in) :: visits
      integer :: k

      do k = 1, visits%n
         call visit_cell(cells, visits%visit(k)%cell, 0.0_wp, 0.0_wp, 0.0_wp)
      end do
   end subroutine gather_cells

   !> Count a complete source in its cells; thread-safe.
   subroutine add_source(maps, cells, boulders)
      type(maps_t), intent(in) :: maps
      type(visits_t), intent(in) :: cells
      integer(i8), intent(in) :: boulders  !! number of the source's boulders
      integer :: k

      do k = 1, cells%n
         call count_source(maps, cells%visit(k)%cell, int(boulders, i4))
      end do
   end subroutine add_source

   !> Count a source in the cells of one of its boulders, unless it is already counted there. Thread-safe for boulders
   !> of the same source.
   subroutine add_source_of_boulder(maps, visits, source, boulders)
      type(maps_t), intent(in) :: maps
      type(visits_t), intent(in) :: visits
      integer(i8), intent(in) :: source, boulders
      integer(i4) :: number, counted
      integer :: k, layer

      number = int(source, i4)
      layer = source_layer(maps, source)
      do k = 1, visits%n
         associate (cell => visits%visit(k)%cell)
            !$omp atomic read
            counted = maps%last_source(cell(1), cell(2), layer)
            if (counted == number) cycle
            !$omp atomic capture
            counted = maps%last_source(cell(1), cell(2), layer)
            maps%last_source(cell(1), cell(2), layer) = number
            !$omp end atomic
            if (counted /= number) call count_source(maps, cell, int(boulders, i4))
         end associate
      end do
   end subroutine add_source_of_boulder

   !> Layer of `last_source` for a source. The second layer is reserved for `first_partial`: its cells are needed at the
   !> end of the run, when later sources may have overwritten the first layer.
   pure integer function source_layer(maps, source) result(layer)
      type(maps_t), intent(in) :: maps
      integer(i8), intent(in) :: source

      layer = merge(2, 1, source == maps%first_partial)
   end function source_layer

   subroutine count_source(maps, cell, boulders)
      type(maps_t), intent(in) :: maps
      integer, intent(in) :: cell(2)
      integer(i4), intent(in) :: boulders

      if (associated(maps%sources)) then
         !$omp atomic update
         maps%sources(cell(1), cell(2)) = maps%sources(cell(1), cell(2)) + 1
      end if
      if (associated(maps%released)) then
         !$omp atomic update
         maps%released(cell(1), cell(2)) = maps%released(cell(1), cell(2)) + boulders
      end if
   end subroutine count_source

   !> Sources with some but not all boulders in the range first..last: at most two.
   pure function partial_sources(release, first, last) result(sources)
      type(release_t), intent(in) :: release
      integer(i8), intent(in) :: first, last
      integer(i8), allocatable :: sources(:)
      integer(i8) :: ends(2)
      logical :: partial(2)

      if (last < first) then
         allocate (sources(0))
         return
      end if
      ends = [source_of(release, first), source_of(release, last)]
      partial = [first > first_of(release, ends(1)), last < last_of(release, ends(2))]
      partial(2) = partial(2) .and. .not. (partial(1) .and. ends(1) == ends(2))
      sources = pack(ends, partial)
   end function partial_sources

   !> Source split by the start of a range of boulders, 0 if none. Later sources must not overwrite it in `last_source`.
   pure integer(i8) function first_partial(release, first)
      type(release_t), intent(in) :: release
      integer(i8), intent(in) :: first

      first_partial = source_of(release, first)
      if (first == first_of(release, first_partial)) first_partial = 0
   end function first_partial

   !> Number of boulders of a source within a range of boulders.
   pure integer(i8) function boulders_within(release, source, first, last) result(n)
      type(release_t), intent(in) :: release
      integer(i8), intent(in) :: source, first, last

      n = min(last, last_of(release, source)) - max(first, first_of(release, source)) + 1
   end function boulders_within

   !> Cells to which the partial sources of a range of boulders contribute.
   pure function contributing_cells(maps, release, first, last) result(contributing)
      type(maps_t), intent(in) :: maps
      type(release_t), intent(in) :: release
      integer(i8), intent(in) :: first, last  !! completed boulders
      type(contributing_t) :: contributing
      integer(i8), allocatable :: sources(:)
      integer(i8) :: n, n_own
      integer :: i, j, k, layer, pass

      sources = partial_sources(release, first, last)
      if (.not. counts_sources(maps)) sources = [integer(i8) ::]
      do pass = 1, 2  ! count first, then store
         n = 0
         do k = 1, size(sources)
            layer = source_layer(maps, sources(k))
            n_own = boulders_within(release, sources(k), first, last)
            do j = 1, size(maps%last_source, 2)
               do i = 1, size(maps%last_source, 1)
                  if (maps%last_source(i, j, layer) /= sources(k)) cycle
                  n = n + 1
                  if (pass == 1) cycle
                  contributing%cell(n) = (j - 1)*size(maps%last_source, 1, i8) + i - 1
                  contributing%source(n) = int(sources(k), i4)
                  contributing%boulders(n) = int(n_own, i4)
               end do
            end do
         end do
         if (pass == 1) allocate (contributing%cell(n), contributing%source(n), contributing%boulders(n))
      end do
   end function contributing_cells

   !> In the cells to which partial sources contribute, count only their boulders in the range (sign 1): this is the
   !> denominator of the reach probability in a part of a run. Sign -1 reverts this, so that a run can continue.
   pure subroutine adjust_released(maps, release, contributing, sign)
      type(maps_t), intent(inout) :: maps
      type(release_t), intent(in) :: release
      type(contributing_t), intent(in) :: contributing
      integer, intent(in) :: sign
      integer(i4) :: n_released
      integer :: i, j, k

      if (.not. associated(maps%released)) return
      do k = 1, size(contributing%cell)
         i = int(mod(contributing%cell(k), size(maps%released, 1, i8))) + 1
         j = int(contributing%cell(k)/size(maps%released, 1)) + 1
         n_released = int(released_by(release, int(contributing%source(k), i8)), i4)
         maps%released(i, j) = maps%released(i, j) + sign*(contributing%boulders(k) - n_released)
      end do
   end subroutine adjust_released
end module rockfall_source_maps
