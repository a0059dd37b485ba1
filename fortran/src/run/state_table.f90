! SPDX-License-Identifier: BSD-3-Clause
!> Table of the arrays of a run: description (row of the table of variables), dimensions in files, and address of each.
!> Files, views and checks loop over its rows.
module rockfall_state_table
   use, intrinsic :: iso_c_binding, only: c_ptr, c_null_ptr, c_loc
   use rockfall_kinds, only: i8
   use rockfall_variables, only: variable_t, variable_of, stored_as, name_in_files
   implicit none
   private
   public :: array_t, table_t, row_text

   integer, parameter :: max_rank = 4

   type :: array_t
      type(variable_t) :: variable        !! files have no variables of group "work"
      character(len=2) :: kind = ""       !! i1, i4, i8, f4, f8
      integer :: rank = 0
      character(len=40) :: axis(max_rank) = ""  !! names of the dimensions; the first varies fastest
      integer(i8) :: length(max_rank) = 1
      type(c_ptr) :: at = c_null_ptr
   end type array_t

   type :: table_t
      type(array_t), allocatable :: row(:)
   contains
      procedure :: add
   end type table_t

contains

   !> Add an array, which must be contiguous and must not be moved. Its kind and, for a sample, its dimensions come from
   !> the table of variables; for arrays not in that table, from `kind` and `axes`.
   subroutine add(this, group, name, axes, values, kind)
      class(table_t), intent(inout) :: this
      character(len=*), intent(in) :: group, name
      character(len=*), intent(in), optional :: axes(:)  !! names of dimensions
      type(*), intent(in), target :: values(..)
      character(len=*), intent(in), optional :: kind
      type(array_t) :: row
      integer :: k

      row%rank = rank(values)
      do k = 1, row%rank
         row%length(k) = size(values, k, i8)
      end do
      if (product(row%length) > 0) row%at = c_loc(values)
      if (present(kind)) then
         row%variable%group = group
         row%variable%name = name
         row%kind = kind
      else
         row%variable = variable_of(group, name)
         row%kind = stored_as(row%variable)
      end if
      if (present(axes)) then
         row%axis(:row%rank) = axes(:row%rank)
      else
         row%axis = sample_axes(row%variable)
      end if
      if (.not. allocated(this%row)) allocate (this%row(0))
      this%row = [this%row, row]
   end subroutine add

   !> Names of the dimensions of a sample; the first varies fastest.
   pure function sample_axes(variable) result(axis)
      type(variable_t), intent(in) :: variable
      character(len=40) :: axis(max_rank)
      integer :: k, first, last

      axis = ""
      last = len_trim(variable%axes)
      do k = 1, max_rank
         if (last < 1) exit
         first = index(variable%axes(:last), " ", back=.true.) + 1
         axis(k) = "sample_"//variable%axes(first:last)
         last = first - 2
      end do
   end function sample_axes

   !> Format a row as text: group, name, name in files, kind, dimensions.
   pure function row_text(row) result(text)
      type(array_t), intent(in) :: row
      character(len=:), allocatable :: text
      integer :: k

      text = trim(row%variable%group)//" "//trim(row%variable%name)//" "//name_in_files(row%variable)//" "//row%kind
      do k = 1, row%rank
         text = text//" "//trim(row%axis(k))
      end do
   end function row_text
end module rockfall_state_table
