! SPDX-License-Identifier: BSD-3-Clause
!> Cells of rasters from files: rasters of integers, and cells in messages.
module rockfall_cells
   use, intrinsic :: ieee_arithmetic, only: ieee_is_nan
   use rockfall_kinds, only: wp, i4
   use rockfall_error, only: error_t, fail
   use rockfall_decimal, only: real_text
   use rockfall_text, only: integer_text
   implicit none
   private
   public :: no_id, whole_numbers, cell_name

   integer(i4), parameter :: no_id = -huge(1_i4) - 1_i4  !! a cell of an integer raster without data

contains

   !> Rows of reals as integers, NaN as `no_id`; the first of them is row `first` of the raster.
   pure subroutine whole_numbers(file, first, rows, values, error)
      character(len=*), intent(in) :: file
      integer, intent(in) :: first
      real(wp), intent(in) :: rows(:, :)  !! NaN or finite
      integer(i4), intent(out) :: values(:, :)
      type(error_t), allocatable, intent(out) :: error
      integer :: i, j

      do j = 1, size(rows, 2)
         do i = 1, size(rows, 1)
            values(i, j) = no_id
            if (ieee_is_nan(rows(i, j))) cycle
            if (abs(rows(i, j)) <= huge(values)) then
               values(i, j) = nint(rows(i, j), i4)
               if (abs(rows(i, j) - values(i, j)) <= 0.0_wp) cycle
            end if
            call fail(error, cell_name(file, i, first + j - 1)//": "//real_text(rows(i, j)) &
                      //": must be an integer of 32 bits")
            return
         end do
      end do
   end subroutine whole_numbers

   !> `file: row j, column i`
   pure function cell_name(file, i, j)
      character(len=*), intent(in) :: file
      integer, intent(in) :: i, j
      character(len=:), allocatable :: cell_name

      cell_name = file//": row "//integer_text(j)//", column "//integer_text(i)
   end function cell_name
end module rockfall_cells
