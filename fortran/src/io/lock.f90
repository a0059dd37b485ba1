! SPDX-License-Identifier: BSD-3-Clause
!> A folder that one run at a time works in: two would destroy each other's files.
module rockfall_lock
   use, intrinsic :: iso_c_binding, only: c_char, c_int, c_size_t, c_ptr, c_null_ptr, c_null_char, c_associated
   use rockfall_kinds, only: i8
   use rockfall_error, only: error_t, fail
   use rockfall_text_file, only: read_text
   use rockfall_text, only: integer_text
   use rockfall_filesystem, only: make_folder, remove_folder, remove_file, is_folder, process_number
   implicit none
   private
   public :: lock_t, lock_name, lock_folder, unlock_folder

   character(len=*), parameter :: lock_name = "rockfall.lock"  !! as in lock.py
   integer(c_int), parameter :: exclusive = 2 + 4, open_again = 8  !! LOCK_EX + LOCK_NB, LOCK_UN

   !> A lock that is held.
   type :: lock_t
      private
      character(len=:), allocatable :: folder
      type(c_ptr) :: stream = c_null_ptr
   end type lock_t

   interface
      type(c_ptr) function c_fopen(path, mode) bind(c, name="fopen")
         import :: c_ptr, c_char
         character(kind=c_char), intent(in) :: path(*), mode(*)
      end function c_fopen
      integer(c_int) function c_fputs(text, stream) bind(c, name="fputs")
         import :: c_int, c_ptr, c_char
         character(kind=c_char), intent(in) :: text(*)
         type(c_ptr), value :: stream
      end function c_fputs
      integer(c_int) function c_fflush(stream) bind(c, name="fflush")
         import :: c_int, c_ptr
         type(c_ptr), value :: stream
      end function c_fflush
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

   !> Keep other processes, `rockfall run` too, out of a folder, which is made where it is missing. However the
   !> process ends, the kernel opens the lock.
   subroutine lock_folder(folder, say, lock, error)
      character(len=*), intent(in) :: folder
      procedure(say_to) :: say
      type(lock_t), intent(out) :: lock
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: word
      logical :: made
      integer(c_int) :: status

      lock%folder = folder
      do
         made = make_folder(folder)
         lock%stream = c_null_ptr
         if (made .or. is_folder(folder)) &
            lock%stream = c_fopen(folder//"/"//lock_name//c_null_char, "ab"//c_null_char)
         if (.not. c_associated(lock%stream)) then
            call fail(error, folder//": cannot be written (is it a folder, and writable?)")
            return
         end if
         if (c_flock(c_fileno(lock%stream), exclusive) /= 0) exit
         call put_word(lock, word, error)
         if (allocated(error)) return
         if (last_word(lock, len(word)) == word) return
         status = c_fclose(lock%stream)
      end do
      if (c_flock(c_fileno(lock%stream), open_again) /= 0) then
         call say(folder//": cannot be locked on this file system; two runs on it would destroy it")
         return
      end if
      status = c_fclose(lock%stream)
      lock%stream = c_null_ptr
      call fail(error, folder//": another run is at work on it; wait for its end, or choose another output")
   end subroutine lock_folder

   !> Put a word of this process and instant into the file. It may not be the one of that name any more: who held
   !> it may have removed it just before. So the word is looked for under the name.
   subroutine put_word(lock, word, error)
      type(lock_t), intent(inout) :: lock
      character(len=:), allocatable, intent(out) :: word
      type(error_t), allocatable, intent(inout) :: error
      integer(i8) :: now

      call system_clock(now)
      word = integer_text(process_number())//" "//integer_text(now)//achar(10)
      if (c_fputs(word//c_null_char, lock%stream) >= 0) then
         if (c_fflush(lock%stream) == 0) return
      end if
      call unlock_folder(lock)
      call fail(error, lock%folder//": cannot be written (the disk may be full)")
   end subroutine put_word

   !> The last characters under the name of the lock, so many or fewer.
   function last_word(lock, length) result(word)
      type(lock_t), intent(in) :: lock
      integer, intent(in) :: length
      character(len=:), allocatable :: word
      type(error_t), allocatable :: error

      call read_text(lock%folder//"/"//lock_name, word, error)
      if (allocated(error)) word = ""
      word = word(max(1, len(word) - length + 1):)
   end function last_word

   !> Let others in; the folder is removed if it is empty.
   subroutine unlock_folder(lock)
      type(lock_t), intent(inout) :: lock
      logical :: ok
      integer(c_int) :: status

      if (.not. c_associated(lock%stream)) return
      ok = remove_file(lock%folder//"/"//lock_name)
      status = c_fclose(lock%stream)
      lock%stream = c_null_ptr
      ok = remove_folder(lock%folder)
   end subroutine unlock_folder
end module rockfall_lock
