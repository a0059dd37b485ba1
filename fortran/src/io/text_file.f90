! SPDX-License-Identifier: BSD-3-Clause
!> Small text files as one string.
module rockfall_text_file
   use, intrinsic :: iso_fortran_env, only: iostat_end
   use rockfall_kinds, only: i8
   use rockfall_error, only: error_t, fail
   use rockfall_text, only: max_text
   use rockfall_system, only: is_regular
   implicit none
   private
   public :: read_text

contains

   !> Read a complete file, with its line ends.
   subroutine read_text(file, text, error)
      character(len=*), intent(in) :: file
      character(len=:), allocatable, intent(out) :: text
      type(error_t), allocatable, intent(out) :: error
      character(len=200) :: message
      character(len=1) :: extra
      integer :: unit, status
      integer(i8) :: size
      logical :: exists

      inquire (file=file, exist=exists)
      if (.not. exists .or. len_trim(file) == 0) then
         call fail(error, file//": no such file")
         return
      end if
      if (.not. is_regular(file)) call fail(error, file//": is not a regular file")
      if (allocated(error)) return
      open (newunit=unit, file=file, access="stream", form="unformatted", status="old", &
            action="read", iostat=status, iomsg=message)
      if (status /= 0) then
         call fail(error, file//": cannot be opened: "//trim(message))
         return
      end if
      inquire (unit=unit, size=size)
      if (size > max_text) then
         call fail(error, file//": is larger than 64 MB, so it is not a rockfall text file")
      else
         allocate (character(len=max(size, 0_i8)) :: text)
         status = 0
         if (size > 0) read (unit, iostat=status, iomsg=message) text
         if (status /= 0) call fail(error, file//": cannot be read: "//trim(message))
      end if
      if (.not. allocated(error)) then  ! the file may have grown, or may not report its size
         read (unit, iostat=status, iomsg=message) extra
         if (status == 0) then
            call fail(error, file//": is not a regular file, or grew while being read")
         else if (status /= iostat_end) then
            call fail(error, file//": cannot be read: "//trim(message))
         end if
      end if
      close (unit)
   end subroutine read_text
end module rockfall_text_file
