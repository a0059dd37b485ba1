! SPDX-License-Identifier: BSD-3-Clause
!> Lock that allows one run at a time to write an output: an empty file next to it.
module rockfall_lock
   use, intrinsic :: iso_c_binding, only: c_char, c_int, c_ptr, c_null_ptr, c_null_char, c_associated
   use rockfall_kinds, only: i8
   use rockfall_error, only: error_t, fail
   use rockfall_filesystem, only: remove_file, is_open_as, is_pipe
   use rockfall_interrupts, only: note_lock
   implicit none
   private
   public :: lock_t, take_lock, give_lock_back, say_to

   integer(c_int), parameter :: exclusive = 2 + 4, open_again = 8  !! LOCK_EX + LOCK_NB, LOCK_UN

   !> Lock held by this process.
   type :: lock_t
      private
      character(len=:), allocatable :: name
      type(c_ptr) :: stream = c_null_ptr
   end type lock_t

   interface
      type(c_ptr) function c_fopen(path, mode) bind(c, name="fopen")
         import :: c_ptr, c_char
         character(kind=c_char), intent(in) :: path(*), mode(*)
      end function c_fopen
      integer(c_int) function c_fclose(stream) bind(c, name="fclose")
         import :: c_int, c_ptr
         type(c_ptr), value :: stream
      end function c_fclose
      integer(c_int) function c_fileno(stream) bind(c, name="fileno")
         import :: c_int, c_ptr
         type(c_ptr), value :: stream
      end function c_fileno
      integer(c_int) function c_flock(descriptor, operation) bind(c, name="flock")
         import :: c_int
         integer(c_int), value :: descriptor, operation
      end function c_flock
   end interface

   abstract interface
      subroutine say_to(message)
         character(len=*), intent(in) :: message
      end subroutine say_to
   end interface

contains

   !> Lock out other processes, also those of `rockfall run`. The system releases the lock however the process ends.
   subroutine take_lock(name, say, lock, error)
      character(len=*), intent(in) :: name
      procedure(say_to) :: say
      type(lock_t), intent(out) :: lock
      type(error_t), allocatable, intent(out) :: error
      integer(i8) :: bytes
      integer(c_int) :: status
      logical :: mine, held

      lock%name = name
      do
         inquire (file=name, size=bytes)
         mine = .not. is_pipe(name)
         if (mine) mine = bytes <= 0
         if (mine) lock%stream = c_fopen(name//c_null_char, "ab"//c_null_char)
         if (.not. mine) then
            call fail(error, name//": is there, and no lock; choose another output")
         else if (.not. c_associated(lock%stream)) then
            call fail(error, name//": cannot be written (is its folder writable?)")
         end if
         if (allocated(error)) return
         held = c_flock(c_fileno(lock%stream), exclusive) == 0
         if (.not. held) exit
         call note_lock(name)
         if (is_open_as(c_fileno(lock%stream), name)) return
         status = c_fclose(lock%stream)  ! the previous holder removed the file in the meantime
      end do
      if (c_flock(c_fileno(lock%stream), open_again) /= 0) then
         call say(name//": cannot be locked on this file system; two runs on one output would destroy it")
         return
      end if
      status = c_fclose(lock%stream)
      lock%stream = c_null_ptr
      call fail(error, name//": another run is at work on this output; wait for its end, or choose another")
   end subroutine take_lock

   !> Release the lock.
   subroutine give_lock_back(lock)
      type(lock_t), intent(inout) :: lock
      logical :: ok
      integer(c_int) :: status

      if (.not. c_associated(lock%stream)) return
      ok = remove_file(lock%name)
      call note_lock("")
      status = c_fclose(lock%stream)
      lock%stream = c_null_ptr
   end subroutine give_lock_back
end module rockfall_lock
