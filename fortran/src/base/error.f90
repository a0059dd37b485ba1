! SPDX-License-Identifier: BSD-3-Clause
!> Errors are values: unallocated means success, and only programs print or stop.
module rockfall_error
   use, intrinsic :: iso_c_binding, only: c_int
   implicit none
   private
   public :: error_t, fail, give_error, bad_input, our_fault

   integer, parameter :: bad_input = 2  !! invalid input that the user can correct; exit status 2
   integer, parameter :: our_fault = 1  !! internal error of the program; exit status 1

   type :: error_t
      integer :: code = our_fault            !! bad_input or our_fault
      character(len=:), allocatable :: message  !! one line: file, group, key, value, what is allowed
   end type error_t

contains

   !> Set `error`; `message` is one line: what is wrong, where, and what is allowed.
   pure subroutine fail(error, message, code)
      type(error_t), allocatable, intent(out) :: error
      character(len=*), intent(in) :: message
      integer, intent(in), optional :: code  !! default bad_input

      allocate (error)
      error%code = bad_input
      if (present(code)) error%code = code
      error%message = message
   end subroutine fail

   !> Convert an error for the Python interfaces: code 0 and an empty message mean success.
   pure subroutine give_error(error, code, message)
      type(error_t), allocatable, intent(in) :: error
      integer(c_int), intent(out) :: code
      character(len=*), intent(out) :: message

      code = 0
      message = ""
      if (.not. allocated(error)) return
      code = error%code
      message = error%message
   end subroutine give_error
end module rockfall_error
