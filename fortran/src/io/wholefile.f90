! SPDX-License-Identifier: BSD-3-Clause
!> Files that appear under their name only when they are whole.
module rockfall_wholefile
   use, intrinsic :: iso_c_binding, only: c_char, c_int, c_null_char
   use rockfall_kinds, only: i8
   use rockfall_error, only: error_t, fail
   implicit none
   private
   public :: whole_file_t, create_file, put, complete_file, discard_file

   integer, parameter :: capacity = 1024**2  !! of the buffer [bytes]

   !> A file in the making: written under another name beside its own.
   type :: whole_file_t
      character(len=:), allocatable :: name
      character(len=:), allocatable, private :: part, buffer
      integer, private :: filled = 0, unit = -1
      integer(i8), private :: written = 0  !! bytes
   end type whole_file_t

   interface
      integer(c_int) function c_rename(from, to) bind(c, name="rename")
         import :: c_char, c_int
         character(kind=c_char), intent(in) :: from(*), to(*)
      end function c_rename
   end interface

contains

   !> Begin a file; end it with `complete_file` or `discard_file`. After an error it is discarded.
   subroutine create_file(name, file, error)
      character(len=*), intent(in) :: name
      type(whole_file_t), intent(out) :: file
      type(error_t), allocatable, intent(out) :: error
      character(len=200) :: message
      integer :: status

      file%name = name
      file%part = name//".part"
      open (newunit=file%unit, file=file%part, access="stream", form="unformatted", &
            status="replace", action="write", iostat=status, iomsg=message)
      if (status /= 0) then
         file%unit = -1
         call fail(error, name//": cannot be written: "//trim(message))
         return
      end if
      allocate (character(len=capacity) :: file%buffer)
   end subroutine create_file

   subroutine put(file, text, error)
      type(whole_file_t), intent(inout) :: file
      character(len=*), intent(in) :: text
      type(error_t), allocatable, intent(out) :: error
      integer :: done, n

      done = 0
      do while (done < len(text))
         if (file%filled == capacity) then
            call empty_buffer(file, error)
            if (allocated(error)) return
         end if
         n = min(len(text) - done, capacity - file%filled)
         file%buffer(file%filled + 1:file%filled + n) = text(done + 1:done + n)
         file%filled = file%filled + n
         done = done + n
      end do
   end subroutine put

   !> The last bytes, then the name.
   subroutine complete_file(file, error)
      type(whole_file_t), intent(inout) :: file
      type(error_t), allocatable, intent(out) :: error
      character(len=200) :: message
      integer :: status
      integer(i8) :: size

      call empty_buffer(file, error)
      if (allocated(error)) return
      message = "the disk may be full"
      close (file%unit, iostat=status, iomsg=message)
      file%unit = -1
      inquire (file=file%part, size=size)  ! not every lost byte is an error of write or close
      if (status /= 0 .or. size /= file%written) then
         call give_up(file, message, error)
      else if (c_rename(file%part//c_null_char, file%name//c_null_char) /= 0) then
         call give_up(file, "cannot take its name (is that a folder?)", error)
      end if
   end subroutine complete_file

   !> Leave nothing behind.
   subroutine discard_file(file)
      type(whole_file_t), intent(inout) :: file
      integer :: status

      if (file%unit == -1) open (newunit=file%unit, file=file%part, iostat=status)
      close (file%unit, status="delete", iostat=status)
      file%unit = -1
   end subroutine discard_file

   subroutine empty_buffer(file, error)
      type(whole_file_t), intent(inout) :: file
      type(error_t), allocatable, intent(out) :: error
      character(len=200) :: message
      integer :: status

      write (file%unit, iostat=status, iomsg=message) file%buffer(:file%filled)
      if (status == 0) flush (file%unit, iostat=status, iomsg=message)
      if (status /= 0) then
         call give_up(file, message, error)
         return
      end if
      file%written = file%written + file%filled
      file%filled = 0
   end subroutine empty_buffer

   subroutine give_up(file, reason, error)
      type(whole_file_t), intent(inout) :: file
      character(len=*), intent(in) :: reason
      type(error_t), allocatable, intent(out) :: error

      call discard_file(file)
      call fail(error, file%name//": cannot be written: "//trim(reason))
   end subroutine give_up
end module rockfall_wholefile
