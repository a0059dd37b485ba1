! SPDX-License-Identifier: BSD-3-Clause
!> Tallies of the maps of a run, in stacks of layers: allocated for a window of cells, viewed as maps, summed over
!> threads and parts, and adjusted where a part ends in the middle of a source.
module rockfall_map_tallies
   use, intrinsic :: iso_c_binding, only: c_ptr, c_null_ptr, c_associated, c_f_pointer
   use rockfall_kinds, only: wp, sp, i4, i8
   use rockfall_memory, only: zeroed_block, free_block
   use rockfall_boulder, only: release_t
   use rockfall_maps, only: maps_t
   use rockfall_map_values, only: map_plan_t, stack_layers, map_views, max_columns, halvings
   use rockfall_source_maps, only: contributing_t, contributing_cells, partial_sources, boulders_within, adjust_released
   implicit none
   private
   public :: map_tallies_t, tells_sources, allocate_tallies, move_tallies, free_tallies, forget_tallies
   public :: views_of, views_of_threads, take_own_tallies, add_tallies, settle_partial_sources, restore_sources

   integer, parameter :: n_blocks = 7

   !> Private stacks of a thread.
   type :: stacks_t
      integer(i4), allocatable :: counts(:, :, :)
      integer(i8), allocatable :: sums(:, :, :)
      real(sp), allocatable :: maxima(:, :, :)
   end type stacks_t

   !> Tallies of the cells of a window. Stacks that the maps do not need have size zero.
   type :: map_tallies_t
      integer :: at(2) = 1, nodes(2) = 0                  !! first column and row of the window; its columns and rows
      type(map_plan_t) :: plan                            !! positions of maps in the stacks
      real(wp), allocatable :: thresholds(:)              !! energy thresholds [J]
      integer(i4), pointer, contiguous :: counts(:, :, :) => null()
      integer(i8), pointer, contiguous :: sums(:, :, :) => null()
      real(sp), pointer, contiguous :: maxima(:, :, :) => null()
      integer(i4), pointer, contiguous :: column(:, :) => null(), bin_counts(:, :) => null()
      integer(i4), pointer :: columns(:) => null()        !! number of columns assigned (a scalar)
      integer(i4), pointer, contiguous :: last_source(:, :, :) => null()  !! as in maps_t
      integer(i8) :: first_partial = 0
      type(stacks_t), allocatable :: own(:)               !! stacks of the threads after the first, if private
      integer(i8) :: max_columns = max_columns            !! maximum number of columns of `bin_counts`
      type(contributing_t) :: shared                      !! cells of partial sources, set by `settle_partial_sources`
      type(c_ptr), private :: block(n_blocks) = c_null_ptr  !! memory of all arrays above
   end type map_tallies_t

   !> Maximum size of private tallies of threads, in total and per boulder of a call. Tracing a
   !> boulder takes about 30 us; adding these bytes at the end takes less than 1 us.
   integer(i8), parameter :: max_own = 2_i8**23, own_per_boulder = 4096  !! [bytes]

contains

   !> Return whether maps need the source of each boulder.
   pure logical function tells_sources(tallies)
      type(map_tallies_t), intent(in) :: tallies

      tells_sources = any(tallies%plan%count(3:4) > 0)
   end function tells_sources

   ! ---- memory -------------------------------------------------------------------------------

   !> Allocate the stacks of a window, if memory suffices.
   subroutine allocate_tallies(tallies, fit)
      type(map_tallies_t), intent(inout) :: tallies
      logical, intent(out) :: fit
      integer(i8) :: cells, with_bins
      integer :: stacks(3), layers, k

      stacks = stack_layers(tallies%plan)
      cells = product(int(tallies%nodes, i8))
      with_bins = merge(cells, 0_i8, tallies%plan%rows > 0)
      layers = 0
      if (tells_sources(tallies)) layers = merge(2, 1, tallies%first_partial > 0)
      associate (block => tallies%block, nx => tallies%nodes(1), ny => tallies%nodes(2))
         block(1) = zeroed_block(cells*stacks(1), 4)
         block(2) = zeroed_block(cells*stacks(2), 8)
         block(3) = zeroed_block(cells*stacks(3), 4)
         block(4) = zeroed_block(with_bins, 4)
         block(6) = zeroed_block(cells*layers, 4)
         block(7) = zeroed_block(1_i8, 4)
         call c_f_pointer(block(1), tallies%counts, [nx, ny, stacks(1)])
         call c_f_pointer(block(2), tallies%sums, [nx, ny, stacks(2)])
         call c_f_pointer(block(3), tallies%maxima, [nx, ny, stacks(3)])
         call c_f_pointer(block(4), tallies%column, merge([nx, ny], 0, with_bins > 0))
         call c_f_pointer(block(6), tallies%last_source, [nx, ny, layers])
         call c_f_pointer(block(7), tallies%columns, [1])
         call allocate_bin_counts(tallies, with_bins)
         fit = all([(c_associated(block(k)), k=1, n_blocks)])
      end associate
   end subroutine allocate_tallies

   !> Allocate bin counts for all cells. If memory is short, try half the number, repeatedly, and leave half of the
   !> available memory to other data. A column uses memory only after a boulder passes its cell.
   subroutine allocate_bin_counts(tallies, cells)
      type(map_tallies_t), intent(inout) :: tallies
      integer(i8), intent(in) :: cells
      integer(i8) :: columns
      integer :: k

      associate (block => tallies%block(5), rows => tallies%plan%rows)
         columns = min(cells, tallies%max_columns)
         do k = 0, halvings
            block = zeroed_block(columns*rows, 4)
            if (c_associated(block)) exit
            columns = columns/2
         end do
         if (k > 0 .and. c_associated(block)) then  ! leave half of the available memory to other data
            call free_block(block)
            columns = columns/2
            block = zeroed_block(columns*rows, 4)
         end if
         call c_f_pointer(block, tallies%bin_counts, [int(rows, i8), columns])
      end associate
   end subroutine allocate_bin_counts

   !> Move the stacks of another run with the same maps.
   subroutine move_tallies(from, to)
      type(map_tallies_t), intent(inout) :: from
      type(map_tallies_t), intent(inout) :: to

      to%counts => from%counts
      to%sums => from%sums
      to%maxima => from%maxima
      to%column => from%column
      to%bin_counts => from%bin_counts
      to%columns => from%columns
      to%last_source => from%last_source
      to%block = from%block
      from%block = c_null_ptr
   end subroutine move_tallies

   !> Free the memory.
   subroutine free_tallies(tallies)
      type(map_tallies_t), intent(inout) :: tallies

      call free_block(tallies%block)
   end subroutine free_tallies

   !> Free the tallies once all maps are computed; counts, sums and maxima only where `stacks` is true.
   subroutine forget_tallies(tallies, stacks)
      type(map_tallies_t), intent(inout) :: tallies
      logical, intent(in) :: stacks(3)
      integer :: k

      do k = 1, 3
         if (stacks(k)) call free_block(tallies%block(k))
      end do
      if (stacks(1)) call c_f_pointer(c_null_ptr, tallies%counts, [0, 0, 0])
      if (stacks(2)) call c_f_pointer(c_null_ptr, tallies%sums, [0, 0, 0])
      if (stacks(3)) call c_f_pointer(c_null_ptr, tallies%maxima, [0, 0, 0])
      call free_block(tallies%block(4:6))
      call c_f_pointer(c_null_ptr, tallies%column, [0, 0])
      call c_f_pointer(c_null_ptr, tallies%bin_counts, [0, 0])
      call c_f_pointer(c_null_ptr, tallies%last_source, [0, 0, 0])
   end subroutine forget_tallies

   ! ---- maps ---------------------------------------------------------------------------------

   !> Views of the maps, starting at a column and row.
   function views_of(tallies, at) result(maps)
      type(map_tallies_t), intent(in), target :: tallies
      integer, intent(in) :: at(2)
      type(maps_t) :: maps

      maps = map_views(tallies%plan, tallies%thresholds, at, tallies%counts, tallies%sums, tallies%maxima, &
                       tallies%bin_counts, tallies%column, tallies%columns(1))
      maps%last_source(at(1):, at(2):, 1:) => tallies%last_source
      maps%first_partial = tallies%first_partial
   end function views_of

   !> Maps to which each thread adds in a call for n boulders. Threads with common maps wait for each other, so maps are
   !> private if they are small and need neither bin counts nor sources.
   function views_of_threads(tallies, threads, n) result(maps)
      type(map_tallies_t), intent(inout), target :: tallies
      integer, intent(in) :: threads
      integer(i8), intent(in) :: n
      type(maps_t), allocatable :: maps(:)
      integer(i8) :: bytes
      logical :: share
      integer :: k

      associate (counts => tallies%counts, sums => tallies%sums, maxima => tallies%maxima)
         bytes = (4*size(counts, kind=i8) + 8*size(sums, kind=i8) + 4*size(maxima, kind=i8))*(threads - 1)
         share = tallies%plan%rows > 0 .or. tells_sources(tallies) .or. bytes > min(max_own, own_per_boulder*n)
         allocate (maps(merge(1, threads, share)))
         maps(1) = views_of(tallies, tallies%at)
         if (share) return
         if (.not. allocated(tallies%own)) then
            allocate (tallies%own(threads - 1))
            do k = 1, size(tallies%own)
               allocate (tallies%own(k)%counts(size(counts, 1), size(counts, 2), size(counts, 3)), source=0_i4)
               allocate (tallies%own(k)%sums(size(sums, 1), size(sums, 2), size(sums, 3)), source=0_i8)
               allocate (tallies%own(k)%maxima(size(maxima, 1), size(maxima, 2), size(maxima, 3)), source=0.0_sp)
            end do
         end if
      end associate
      do k = 1, size(tallies%own)
         maps(k + 1) = map_views(tallies%plan, tallies%thresholds, tallies%at, tallies%own(k)%counts, &
                                 tallies%own(k)%sums, tallies%own(k)%maxima, tallies%bin_counts, tallies%column, &
                                 tallies%columns(1))
      end do
   end function views_of_threads

   ! ---- sums ---------------------------------------------------------------------------------

   !> Add the private stacks of the other threads to the stacks of the first thread.
   pure subroutine take_own_tallies(tallies)
      type(map_tallies_t), intent(inout) :: tallies
      integer :: k, j

      do k = 1, size(tallies%own)
         associate (own => tallies%own(k))
            do j = 1, tallies%nodes(2)
               call add_row(j, own%counts, own%sums, own%maxima, tallies)
            end do
            own%counts = 0
            own%sums = 0
            own%maxima = 0
         end associate
      end do
   end subroutine take_own_tallies

   !> Add tallies of the same cells, if memory suffices for their bin counts (`fit`); cells without tallies take no
   !> memory.
   pure subroutine add_tallies(tallies, part, fit)
      type(map_tallies_t), intent(inout) :: tallies
      type(map_tallies_t), intent(in) :: part
      logical, intent(out) :: fit
      integer :: i, j

      fit = .true.
      do j = 1, tallies%nodes(2)
         call add_row(j, part%counts, part%sums, part%maxima, tallies)
         do i = 1, merge(tallies%nodes(1), 0, size(part%column) > 0)
            if (part%column(i, j) == 0) cycle
            if (tallies%column(i, j) == 0) then
               fit = tallies%columns(1) < size(tallies%bin_counts, 2)
               if (.not. fit) return
               tallies%columns = tallies%columns + 1
               tallies%column(i, j) = tallies%columns(1)
            end if
            associate (counts => tallies%bin_counts(:, tallies%column(i, j)))
               counts = counts + part%bin_counts(:, part%column(i, j))
            end associate
         end do
      end do
   end subroutine add_tallies

   !> Add row j of another run's stacks for the same cells.
   pure subroutine add_row(j, counts, sums, maxima, tallies)
      integer, intent(in) :: j
      integer(i4), intent(in) :: counts(:, :, :)
      integer(i8), intent(in) :: sums(:, :, :)
      real(sp), intent(in) :: maxima(:, :, :)
      type(map_tallies_t), intent(inout) :: tallies
      integer :: k

      do k = 1, size(counts, 3)
         where (counts(:, j, k) /= 0) tallies%counts(:, j, k) = tallies%counts(:, j, k) + counts(:, j, k)
      end do
      do k = 1, size(sums, 3)
         where (sums(:, j, k) /= 0) tallies%sums(:, j, k) = tallies%sums(:, j, k) + sums(:, j, k)
      end do
      do k = 1, size(maxima, 3)
         where (maxima(:, j, k) > tallies%maxima(:, j, k)) tallies%maxima(:, j, k) = maxima(:, j, k)
      end do
   end subroutine add_row

   ! ---- partial sources ----------------------------------------------------------------------

   !> For a part: count only the boulders first..last in the cells of partial sources (sign 1), and store these cells in
   !> `shared`. Sign -1 reverts this, so that a run can continue.
   subroutine settle_partial_sources(tallies, release, first, last, sign)
      type(map_tallies_t), intent(inout) :: tallies
      type(release_t), intent(in) :: release
      integer(i8), intent(in) :: first, last
      integer, intent(in) :: sign
      type(maps_t) :: maps

      if (.not. tells_sources(tallies)) return
      maps = views_of(tallies, [1, 1])
      if (sign > 0) tallies%shared = contributing_cells(maps, release, first, last)
      call adjust_released(maps, release, tallies%shared, sign)
   end subroutine settle_partial_sources

   !> Restore the cells of partial sources from `shared`, as read from a file. `good`: they belong to the sources split
   !> by the range of boulders first..last, their numbers of boulders are correct, and their cells ascend.
   subroutine restore_sources(tallies, release, first, last, good)
      type(map_tallies_t), intent(inout) :: tallies
      type(release_t), intent(in) :: release
      integer(i8), intent(in) :: first, last
      logical, intent(out) :: good
      integer(i8), allocatable :: sources(:)
      integer :: k, n, left

      associate (shared => tallies%shared)
         sources = partial_sources(release, first, last)
         n = size(shared%cell)
         good = all(shared%cell >= 0 .and. shared%cell < product(int(tallies%nodes, i8)))
         good = good .and. all(shared%source(2:) > shared%source(:n - 1) &
                               .or. (shared%source(2:) == shared%source(:n - 1) &
                                     .and. shared%cell(2:) > shared%cell(:n - 1)))
         left = n
         do k = 1, size(sources)
            left = left - count(shared%source == sources(k) &
                                .and. shared%boulders == boulders_within(release, sources(k), first, last))
         end do
         good = good .and. left == 0
         if (.not. good) return
         do k = 1, n
            associate (layer => merge(2, 1, shared%source(k) == tallies%first_partial), &
                       nx => int(tallies%nodes(1), i8))
               tallies%last_source(mod(shared%cell(k), nx) + 1, shared%cell(k)/nx + 1, layer) = shared%source(k)
            end associate
         end do
      end associate
      call settle_partial_sources(tallies, release, first, last, -1)
   end subroutine restore_sources
end module rockfall_map_tallies
