! SPDX-License-Identifier: BSD-3-Clause
!> Errors are values: unallocated means success, and only programs print or stop.
module rockfall_error
   implicit none
   private
   public :: error_t, fail, bad_input, our_fault

   integer, parameter :: bad_input = 2  !! the user can mend it; exit status 2
   integer, parameter :: our_fault = 1  !! a defect of the program; exit status 1

   type :: error_t
      integer :: code = our_fault            !! bad_input or our_fault
      character(len=:), allocatable :: message  !! one line: file, group, key, value, what is allowed
   end type error_t

contains

   !> Set `error`; `message` says what is wrong, where, and what is allowed, in one line.
   pure subroutine fail(error, message, code)
      type(error_t), allocatable, intent(out) :: error
      character(len=*), intent(in) :: message
      integer, intent(in), optional :: code  !! bad_input unless given

      allocate (error)
      error%code = bad_input
      if (present(code)) error%code = code
      error%message = message
   end subroutine fail
end module rockfall_error
