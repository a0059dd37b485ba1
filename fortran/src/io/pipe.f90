! SPDX-License-Identifier: BSD-3-Clause
!> A name may lead to a pipe: to open it for reading waits until someone writes.
module rockfall_pipe
   use, intrinsic :: iso_c_binding, only: c_char, c_int, c_long, c_null_char
   use rockfall_error, only: error_t, fail
   implicit none
   private
   public :: is_pipe, refuse_pipe

   interface
      integer(c_int) function c_open(path, flags) bind(c, name="open")
         import :: c_char, c_int
         character(kind=c_char), intent(in) :: path(*)
         integer(c_int), value :: flags
      end function c_open
      integer(c_long) function c_lseek(descriptor, offset, from) bind(c, name="lseek")
         import :: c_int, c_long
         integer(c_int), value :: descriptor
         integer(c_long), value :: offset
         integer(c_int), value :: from
      end function c_lseek
      integer(c_int) function c_close(descriptor) bind(c, name="close")
         import :: c_int
         integer(c_int), value :: descriptor
      end function c_close
   end interface

   !> O_NONBLOCK of Linux and that of BSD; each means nothing to the other where a file is only read.
   integer(c_int), parameter :: without_waiting = 2048 + 4

contains

   !> Whether `path` leads to what has no places to go to: a pipe, a socket, a terminal.
   logical function is_pipe(path)
      character(len=*), intent(in) :: path
      integer(c_int) :: descriptor, status

      is_pipe = .false.
      descriptor = c_open(path//c_null_char, without_waiting)
      if (descriptor < 0) return
      is_pipe = c_lseek(descriptor, 0_c_long, 0_c_int) < 0
      status = c_close(descriptor)
   end function is_pipe

   !> An error with the file's `name` where `path` leads to what is_pipe tells.
   subroutine refuse_pipe(path, name, error)
      character(len=*), intent(in) :: path, name
      type(error_t), allocatable, intent(inout) :: error

      if (is_pipe(path)) call fail(error, name//": not a regular file")
   end subroutine refuse_pipe
end module rockfall_pipe
