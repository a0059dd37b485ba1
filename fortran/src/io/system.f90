! SPDX-License-Identifier: BSD-3-Clause
!> Signals, locks and file names, implemented in system.c or system_windows.c.
module rockfall_system
   use, intrinsic :: iso_c_binding, only: c_char, c_int, c_int64_t, c_null_char
   use rockfall_error, only: error_t, fail
   use rockfall_text, only: integer_text
   implicit none
   private
   public :: start_process, end_at_once, interrupt_status, begin_reading, end_reading
   public :: take_lock, give_lock_back, say_to, remove_file, replace_file, check_place, check_space
   public :: path_exists, is_folder, is_regular, same_file, folder_of, name_of, hidden_name, temporary_name

   interface
      subroutine start_process() bind(c, name="rockfall_start")
      end subroutine start_process
      !> End the process without running the exit handlers of its libraries.
      subroutine end_at_once(code) bind(c, name="_exit")
         import :: c_int
         integer(c_int), value :: code
      end subroutine end_at_once
      integer(c_int) function interrupt_status() bind(c, name="rockfall_status")
         import :: c_int
      end function interrupt_status
      subroutine c_on_crash(message) bind(c, name="rockfall_on_crash")
         import :: c_char
         character(kind=c_char), intent(in) :: message(*)
      end subroutine c_on_crash
      integer(c_int) function c_lock(path) bind(c, name="rockfall_lock")
         import :: c_char, c_int
         character(kind=c_char), intent(in) :: path(*)
      end function c_lock
      subroutine give_lock_back() bind(c, name="rockfall_unlock")
      end subroutine give_lock_back
      integer(c_int) function c_unlink(path) bind(c, name="unlink")
         import :: c_char, c_int
         character(kind=c_char), intent(in) :: path(*)
      end function c_unlink
      integer(c_int) function c_replace(from, to, folder) bind(c, name="rockfall_replace")
         import :: c_char, c_int
         character(kind=c_char), intent(in) :: from(*), to(*), folder(*)
      end function c_replace
      integer(c_int) function c_disk_holds(path, bytes) bind(c, name="rockfall_disk_holds")
         import :: c_char, c_int, c_int64_t
         character(kind=c_char), intent(in) :: path(*)
         integer(c_int64_t), value :: bytes
      end function c_disk_holds
      integer(c_int) function c_is_folder(path) bind(c, name="rockfall_is_folder")
         import :: c_char, c_int
         character(kind=c_char), intent(in) :: path(*)
      end function c_is_folder
      integer(c_int) function c_is_regular(path) bind(c, name="rockfall_is_regular")
         import :: c_char, c_int
         character(kind=c_char), intent(in) :: path(*)
      end function c_is_regular
      integer(c_int) function c_same(a, b) bind(c, name="rockfall_same")
         import :: c_char, c_int
         character(kind=c_char), intent(in) :: a(*), b(*)
      end function c_same
      !> Second separator of folders, if the system has one in addition to "/", else "/".
      pure character(kind=c_char) function other_separator() bind(c, name="rockfall_separator")
         import :: c_char
      end function other_separator
      integer(c_int) function c_getpid() bind(c, name="getpid")
         import :: c_int
      end function c_getpid
   end interface

   abstract interface
      subroutine say_to(message)
         character(len=*), intent(in) :: message
      end subroutine say_to
   end interface

contains

   !> Report crashes until `end_reading` as caused by a file.
   subroutine begin_reading(name)
      character(len=*), intent(in) :: name

      call c_on_crash("rockfall-batch: "//name//": cannot be read as netCDF-4: it is damaged"//achar(10)//c_null_char)
   end subroutine begin_reading

   subroutine end_reading()
      call c_on_crash(c_null_char)
   end subroutine end_reading

   !> Lock an output against other processes, including `rockfall run`, by a file next to it.
   subroutine take_lock(name, say, error)
      character(len=*), intent(in) :: name
      procedure(say_to) :: say
      type(error_t), allocatable, intent(out) :: error

      select case (c_lock(name//c_null_char))
      case (1)
         call fail(error, name//": another run is writing this output: wait, or choose another output")
      case (2)
         call say(name//": cannot be locked on this file system: do not start a second run with this output")
      case (3)
         call fail(error, name//": cannot be written (is its folder writable?)")
      case (4)
         call fail(error, name//": exists but is not a lock: choose another output")
      end select
   end subroutine take_lock

   !> Remove a file; return whether it succeeded.
   logical function remove_file(path)
      character(len=*), intent(in) :: path

      remove_file = c_unlink(path//c_null_char) == 0
   end function remove_file

   !> Replace a file atomically and durably; return whether it succeeded.
   logical function replace_file(from, to)
      character(len=*), intent(in) :: from, to

      replace_file = c_replace(from//c_null_char, to//c_null_char, folder_of(to)//"."//c_null_char) /= 0
   end function replace_file

   !> Refuse an output in a folder that is not writable, or where a file cannot be renamed over another.
   subroutine check_place(name, error)
      character(len=*), intent(in) :: name
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: from, to
      logical :: ok

      from = temporary_name(name)
      to = from//".renamed"
      ok = make_empty(from)
      if (.not. ok) then
         call fail(error, name//": cannot be written (is its folder writable?)")
         return
      end if
      if (make_empty(to)) ok = replace_file(from, to)
      if (.not. ok) call fail(error, name//": its folder cannot rename files: choose another folder")
      if (.not. ok) ok = remove_file(from)
      ok = remove_file(to)
   end subroutine check_place

   !> Create an empty file; return whether it succeeded.
   logical function make_empty(name)
      character(len=*), intent(in) :: name
      integer :: unit, status

      open (newunit=unit, file=name, status="new", action="write", iostat=status)
      make_empty = status == 0
      if (make_empty) close (unit, iostat=status)
   end function make_empty

   !> Refuse an output of at least this size [bytes] if the disk of its folder has too little space.
   subroutine check_space(name, bytes, error)
      character(len=*), intent(in) :: name
      integer(c_int64_t), intent(in) :: bytes
      type(error_t), allocatable, intent(out) :: error

      if (bytes <= 0) return
      if (c_disk_holds(temporary_name(name)//c_null_char, bytes) == 0) &
         call fail(error, name//": needs at least "//integer_text(bytes/1000000 + 1) &
                   //" MB of disk space, more than its folder has")
   end subroutine check_space

   logical function path_exists(path)
      character(len=*), intent(in) :: path

      inquire (file=path, exist=path_exists)
   end function path_exists

   logical function is_folder(path)
      character(len=*), intent(in) :: path

      is_folder = c_is_folder(path//c_null_char) /= 0
   end function is_folder

   !> Return whether a path leads to a file, not to a folder, a pipe or a device.
   logical function is_regular(path)
      character(len=*), intent(in) :: path

      is_regular = c_is_regular(path//c_null_char) /= 0
   end function is_regular

   !> Return whether two paths lead to the same file.
   logical function same_file(a, b)
      character(len=*), intent(in) :: a, b

      same_file = c_same(a//c_null_char, b//c_null_char) /= 0
   end function same_file

   !> Folder of a path, with a final slash; "" if there is none.
   pure function folder_of(path) result(folder)
      character(len=*), intent(in) :: path
      character(len=:), allocatable :: folder

      folder = path(:scan(path, "/"//other_separator(), back=.true.))
   end function folder_of

   !> File name of a path without its folder.
   pure function name_of(path) result(name)
      character(len=*), intent(in) :: path
      character(len=:), allocatable :: name

      name = path(scan(path, "/"//other_separator(), back=.true.) + 1:)
   end function name_of

   !> Hidden file name in the same folder.
   pure function hidden_name(path) result(name)
      character(len=*), intent(in) :: path
      character(len=:), allocatable :: name

      name = folder_of(path)//"."//name_of(path)
   end function hidden_name

   !> Hidden file name unique to this process.
   function temporary_name(path) result(name)
      character(len=*), intent(in) :: path
      character(len=:), allocatable :: name

      name = hidden_name(path)//"."//integer_text(int(c_getpid()))
   end function temporary_name
end module rockfall_system
