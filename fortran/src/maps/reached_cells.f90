! SPDX-License-Identifier: BSD-3-Clause
!> Tallies of the cells that boulders reached, as stored in files.
module rockfall_reached_cells
   use rockfall_kinds, only: sp, i4, i8
   use rockfall_map_tallies, only: map_tallies_t
   implicit none
   private
   public :: reached_cells_t, find_reached_cells, allocate_reached_cells, pack_cells, unpack_cells

   type :: reached_cells_t
      integer(i8), allocatable :: cell(:)              !! cell number from 0, row by row from the north-west, ascending
      integer(i4), allocatable :: counts(:, :)         !! (cells, layers)
      integer(i8), allocatable :: sums(:, :)
      real(sp), allocatable :: maxima(:, :)
      integer(i4), allocatable :: bin_counts(:, :)     !! (bins, cells)
   end type reached_cells_t

   !> Stacks of the maps by cell and layer.
   type :: flat_stacks_t
      integer(i4), pointer, contiguous :: counts(:, :) => null(), column(:) => null()
      integer(i8), pointer, contiguous :: sums(:, :) => null()
      real(sp), pointer, contiguous :: maxima(:, :) => null()
   end type flat_stacks_t

contains

   !> Find the cells in which any tally is not zero.
   pure subroutine find_reached_cells(tallies, cells)
      type(map_tallies_t), intent(in) :: tallies
      type(reached_cells_t), intent(inout) :: cells
      integer(i8) :: found
      integer :: i, j

      allocate (cells%cell(sum([(count(reached(j), kind=i8), j=1, tallies%nodes(2))])))
      found = 0
      do j = 1, tallies%nodes(2)
         associate (is_reached => reached(j))
            do i = 1, tallies%nodes(1)
               if (.not. is_reached(i)) cycle
               found = found + 1
               cells%cell(found) = (j - 1)*int(tallies%nodes(1), i8) + i - 1
            end do
         end associate
      end do

   contains

      !> Return which cells of a row were reached.
      pure function reached(j)
         integer, intent(in) :: j
         logical :: reached(tallies%nodes(1))
         integer :: k

         reached = .false.
         do k = 1, size(tallies%counts, 3)
            reached = reached .or. tallies%counts(:, j, k) /= 0
         end do
         do k = 1, size(tallies%sums, 3)
            reached = reached .or. tallies%sums(:, j, k) /= 0
         end do
         do k = 1, size(tallies%maxima, 3)
            reached = reached .or. tallies%maxima(:, j, k) > 0
         end do
         if (size(tallies%column) > 0) reached = reached .or. tallies%column(:, j) > 0
      end function reached
   end subroutine find_reached_cells

   !> Allocate the tallies of the cells found, if memory suffices.
   pure subroutine allocate_reached_cells(tallies, cells, fit)
      type(map_tallies_t), intent(in) :: tallies
      type(reached_cells_t), intent(inout) :: cells
      logical, intent(out) :: fit
      integer :: status

      associate (n => size(cells%cell, kind=i8), bins => tallies%plan%rows)
         allocate (cells%counts(n, size(tallies%counts, 3)), cells%sums(n, size(tallies%sums, 3)), &
                   cells%maxima(n, size(tallies%maxima, 3)), cells%bin_counts(bins, merge(n, 0_i8, bins > 0)), &
                   stat=status)
      end associate
      fit = status == 0
   end subroutine allocate_reached_cells

   !> Copy the tallies of the cells found.
   subroutine pack_cells(tallies, cells)
      type(map_tallies_t), intent(in) :: tallies
      type(reached_cells_t), intent(inout) :: cells
      type(flat_stacks_t) :: stacks
      integer(i8) :: k

      stacks = flat_stacks(tallies)
      associate (at => cells%cell + 1)
         cells%counts = stacks%counts(at, :)
         cells%sums = stacks%sums(at, :)
         cells%maxima = stacks%maxima(at, :)
      end associate
      do k = 1, size(cells%bin_counts, 2, i8)
         associate (column => stacks%column(cells%cell(k) + 1))
            cells%bin_counts(:, k) = 0
            if (column > 0) cells%bin_counts(:, k) = tallies%bin_counts(:, column)
         end associate
      end do
   end subroutine pack_cells

   !> Copy the tallies of cells to empty stacks; their bin counts must fit.
   subroutine unpack_cells(cells, tallies)
      type(reached_cells_t), intent(in) :: cells
      type(map_tallies_t), intent(inout) :: tallies
      type(flat_stacks_t) :: stacks
      integer(i8) :: k, n

      stacks = flat_stacks(tallies)
      n = size(cells%cell, kind=i8)
      associate (at => cells%cell + 1)
         stacks%counts(at, :) = cells%counts
         stacks%sums(at, :) = cells%sums
         stacks%maxima(at, :) = cells%maxima
         if (tallies%plan%rows == 0) return
         tallies%bin_counts(:, :n) = cells%bin_counts
         stacks%column(at) = [(int(k, i4), k=1, n)]
         tallies%columns = int(n, i4)
      end associate
   end subroutine unpack_cells

   type(flat_stacks_t) function flat_stacks(tallies) result(stacks)
      type(map_tallies_t), intent(in) :: tallies
      integer(i8) :: n

      n = product(int(tallies%nodes, i8))
      stacks%counts(1:n, 1:size(tallies%counts, 3)) => tallies%counts
      stacks%sums(1:n, 1:size(tallies%sums, 3)) => tallies%sums
      stacks%maxima(1:n, 1:size(tallies%maxima, 3)) => tallies%maxima
      stacks%column(1:size(tallies%column, kind=i8)) => tallies%column
   end function flat_stacks
end module rockfall_reached_cells
