! SPDX-License-Identifier: BSD-3-Clause
!> Error values: an unallocated error means success. Only programs print or stop.
module rockfall_error
   use, intrinsic :: iso_c_binding, only: c_int
   use rockfall_dimensions, only: max_message
   implicit none
   private
   public :: error_t, fail, gather, give_error, bad_input, our_fault, fault_mark

   integer, parameter :: bad_input = 2  !! invalid input that the user can correct; exit status 2
   integer, parameter :: our_fault = 1  !! internal error of the program; exit status 1

   character(len=1), parameter :: fault_mark = achar(30)  !! separates the messages of several faults

   type :: error_t
      integer :: code = our_fault            !! bad_input or our_fault
      character(len=:), allocatable :: message  !! one line for each fault: file, group, key, value, what is allowed
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

   !> Append a fault to the earlier ones, so that a user can correct all of them at once.
   pure subroutine gather(fault, error)
      type(error_t), allocatable, intent(inout) :: fault  !! not allocated afterwards
      type(error_t), allocatable, intent(inout) :: error
      character(len=*), parameter :: more = fault_mark//"more errors follow: correct these first"

      if (.not. allocated(fault)) return
      if (.not. allocated(error)) then
         call move_alloc(fault, error)
      else if (len(error%message) + len(fault%message) + 1 <= max_message - len(more)) then
         error%message = error%message//fault_mark//fault%message
      else if (len(error%message) <= max_message - len(more)) then
         error%message = error%message//more
      end if
      if (allocated(fault)) deallocate (fault)
   end subroutine gather

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
