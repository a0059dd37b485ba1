! SPDX-License-Identifier: BSD-3-Clause
!> POSIX functions that Fortran lacks: names, durable files, and the process id.
module rockfall_filesystem
   use, intrinsic :: iso_c_binding, only: c_char, c_int, c_int64_t, c_intptr_t, c_long, c_null_char
   use rockfall_text, only: integer_text
   implicit none
   private
   public :: remove_file, replace_file, path_exists, is_folder, is_pipe, same_file, is_open_as, folder_of, name_of, &
             hidden_name, temporary_name, fail_beyond_size_limit, open_closed_streams, end_at_once, c_signal

   interface
      integer(c_int) function c_unlink(path) bind(c, name="unlink")
         import :: c_char, c_int
         character(kind=c_char), intent(in) :: path(*)
      end function c_unlink
      integer(c_int) function c_rename(from, to) bind(c, name="rename")
         import :: c_char, c_int
         character(kind=c_char), intent(in) :: from(*), to(*)
      end function c_rename
      integer(c_int) function c_stat(path, found) bind(c, name="stat")
         import :: c_char, c_int, c_int64_t
         character(kind=c_char), intent(in) :: path(*)
         integer(c_int64_t), intent(inout) :: found(*)
      end function c_stat
      integer(c_int) function c_fstat(descriptor, found) bind(c, name="fstat")
         import :: c_int, c_int64_t
         integer(c_int), value :: descriptor
         integer(c_int64_t), intent(inout) :: found(*)
      end function c_fstat
      integer(c_int) function c_fsync(descriptor) bind(c, name="fsync")
         import :: c_int
         integer(c_int), value :: descriptor
      end function c_fsync
      integer(c_int) function c_getpid() bind(c, name="getpid")
         import :: c_int
      end function c_getpid
      integer(c_int) function c_open(path, access) bind(c, name="open")
         import :: c_char, c_int
         character(kind=c_char), intent(in) :: path(*)
         integer(c_int), value :: access
      end function c_open
      integer(c_long) function c_lseek(descriptor, offset, from) bind(c, name="lseek")
         import :: c_int, c_long
         integer(c_int), value :: descriptor
         integer(c_long), value :: offset
         integer(c_int), value :: from
      end function c_lseek
      integer(c_int) function c_close(file) bind(c, name="close")
         import :: c_int
         integer(c_int), value :: file
      end function c_close
      subroutine c_exit(status) bind(c, name="_exit")
         import :: c_int
         integer(c_int), value :: status
      end subroutine c_exit
      integer(c_intptr_t) function c_signal(number, action) bind(c, name="signal")
         import :: c_int, c_intptr_t
         integer(c_int), value :: number
         integer(c_intptr_t), value :: action
      end function c_signal
   end interface

   integer(c_int), parameter :: size_signal = 25        !! SIGXFSZ of Linux and BSD
   integer(c_intptr_t), parameter :: ignore_signal = 1  !! SIG_IGN
   !> O_NONBLOCK of Linux and of BSD; the other system ignores the bit for files that are only read.
   integer(c_int), parameter :: without_waiting = 2048 + 4

contains

   !> Make exceeding the file size limit of the process (ulimit -f) a write error, as on a full disk, instead of a fatal
   !> signal.
   subroutine fail_beyond_size_limit()
      integer(c_intptr_t) :: before

      before = c_signal(size_signal, ignore_signal)
   end subroutine fail_beyond_size_limit

   !> Open closed standard streams (>&-), so that output to them is discarded and does not go to a file that is later
   !> opened under the same descriptor.
   subroutine open_closed_streams()
      integer(c_int), parameter :: read_and_write = 2
      integer(c_int) :: file

      do
         file = c_open("/dev/null"//c_null_char, read_and_write)
         if (file < 0 .or. file > 2) exit
      end do
      if (file > 2) file = c_close(file)
   end subroutine open_closed_streams

   !> End the process without the exit handlers of its libraries.
   subroutine end_at_once(code)
      integer, intent(in) :: code

      call c_exit(int(code, c_int))
   end subroutine end_at_once

   !> Remove a file; return whether it succeeded.
   logical function remove_file(path) result(ok)
      character(len=*), intent(in) :: path

      ok = c_unlink(path//c_null_char) == 0
   end function remove_file

   !> Replace a file atomically by another once it is on disk, and make the new name durable; return whether it
   !> succeeded.
   logical function replace_file(from, to) result(ok)
      character(len=*), intent(in) :: from, to

      ok = sync(from)
      if (ok) ok = c_rename(from//c_null_char, to//c_null_char) == 0
      if (ok) ok = sync(folder_of(to)//".")
   end function replace_file

   !> Flush a file, or the names in a folder, to disk; return whether it succeeded.
   logical function sync(path) result(ok)
      character(len=*), intent(in) :: path
      integer(c_int), parameter :: read_only = 0
      integer(c_int) :: descriptor, status

      descriptor = c_open(path//c_null_char, read_only)
      ok = descriptor >= 0
      if (.not. ok) return
      ok = c_fsync(descriptor) == 0
      status = c_close(descriptor)
   end function sync

   logical function path_exists(path)
      character(len=*), intent(in) :: path

      inquire (file=path, exist=path_exists)
   end function path_exists

   logical function is_folder(path)
      character(len=*), intent(in) :: path

      inquire (file=path//"/.", exist=is_folder)
   end function is_folder

   !> Return whether `path` is not seekable: a pipe, a socket, a terminal. Opening a pipe for reading would block until
   !> there is a writer.
   logical function is_pipe(path)
      character(len=*), intent(in) :: path
      integer(c_int) :: descriptor, status

      is_pipe = .false.
      descriptor = c_open(path//c_null_char, without_waiting)
      if (descriptor < 0) return
      is_pipe = c_lseek(descriptor, 0_c_long, 0_c_int) < 0
      status = c_close(descriptor)
   end function is_pipe

   !> Return whether two paths lead to the same file.
   logical function same_file(a, b)
      character(len=*), intent(in) :: a, b
      integer(c_int64_t) :: of_a(64), of_b(64)  !! large enough for any `struct stat`

      of_a = 0
      of_b = 0
      same_file = c_stat(a//c_null_char, of_a) == 0
      if (same_file) same_file = c_stat(b//c_null_char, of_b) == 0
      ! device and inode on Linux; on BSD the first word also has mode and links, which agree for one file
      if (same_file) same_file = all(of_a(:2) == of_b(:2))
   end function same_file

   !> Return whether an open file is the one with a given name.
   logical function is_open_as(descriptor, path)
      integer(c_int), intent(in) :: descriptor
      character(len=*), intent(in) :: path
      integer(c_int64_t) :: of_open(64), of_name(64)  !! as in same_file

      of_open = 0
      of_name = 0
      is_open_as = c_fstat(descriptor, of_open) == 0
      if (is_open_as) is_open_as = c_stat(path//c_null_char, of_name) == 0
      if (is_open_as) is_open_as = all(of_open(:2) == of_name(:2))
   end function is_open_as

   !> Folder of a path with its final slash; "" if there is none.
   pure function folder_of(path) result(folder)
      character(len=*), intent(in) :: path
      character(len=:), allocatable :: folder

      folder = path(:index(path, "/", back=.true.))
   end function folder_of

   !> File name of a path without its folder.
   pure function name_of(path) result(name)
      character(len=*), intent(in) :: path
      character(len=:), allocatable :: name

      name = path(index(path, "/", back=.true.) + 1:)
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
end module rockfall_filesystem
