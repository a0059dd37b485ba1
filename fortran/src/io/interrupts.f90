! SPDX-License-Identifier: BSD-3-Clause
!> Signals. Ctrl-C, and SIGTERM, which batch systems send at a time limit, must not lose work; and if HDF5 crashes on a
!> damaged file, the message must name it. Module variables are needed only here: a signal handler cannot pass state
!> otherwise.
module rockfall_interrupts
   use, intrinsic :: iso_c_binding, only: c_char, c_int, c_size_t, c_intptr_t, c_funptr, c_funloc
   use rockfall_kinds, only: wp, i8
   use rockfall_filesystem, only: end_at_once, remove_file, c_signal
   implicit none
   private
   public :: note_interrupts, interrupt_status, begin_reading, end_reading, note_lock

   integer(c_int), parameter :: interrupt_signal = 2, terminate_signal = 15  !! SIGINT, SIGTERM
   !> Seconds within which signals count as one: `timeout` signals both a process and its group.
   real(wp), parameter :: together = 0.1_wp

   integer, save, volatile :: status = 0    !! exit status for the first signal
   integer(i8), save, volatile :: came = 0  !! time of the first signal [ticks]

   integer(c_int), parameter :: crashes(4) = [6_c_int, 7_c_int, 8_c_int, 11_c_int]  !! SIGABRT, SIGBUS, SIGFPE, SIGSEGV
   character(len=4096), save :: last_words = ""  !! message in case of a crash
   character(len=4096), save :: lock = ""        !! file to remove in case of a crash

   interface
      integer(c_size_t) function c_write(file, text, bytes) bind(c, name="write")
         import :: c_char, c_int, c_size_t
         integer(c_int), value :: file
         character(kind=c_char), intent(in) :: text(*)
         integer(c_size_t), value :: bytes
      end function c_write
   end interface

contains

   !> Record the first Ctrl-C or SIGTERM only; a second one ends the process at once.
   subroutine note_interrupts()
      type(c_funptr) :: action
      integer(c_intptr_t) :: before

      action = c_funloc(take_signal)
      before = c_signal(interrupt_signal, transfer(action, before))
      before = c_signal(terminate_signal, transfer(action, before))
   end subroutine note_interrupts

   !> Exit status of a program that stops because of a signal: 130, 143; 0 without one.
   integer function interrupt_status()
      interrupt_status = status
   end function interrupt_status

   !> Attribute crashes to a file until `end_reading`.
   subroutine begin_reading(name)
      character(len=*), intent(in) :: name
      type(c_funptr) :: action
      integer(c_intptr_t) :: before
      integer :: k

      last_words = "rockfall-batch: "//name//": cannot be read as netCDF-4: it is damaged"//achar(10)
      action = c_funloc(take_crash)
      do k = 1, size(crashes)
         before = c_signal(crashes(k), transfer(action, before))
      end do
   end subroutine begin_reading

   subroutine end_reading()
      integer(c_intptr_t) :: before
      integer :: k

      do k = 1, size(crashes)
         before = c_signal(crashes(k), 0_c_intptr_t)  ! SIG_DFL
      end do
   end subroutine end_reading

   !> Signal handler for crashes.
   subroutine take_crash(number) bind(c, name="")
      integer(c_int), value :: number
      integer(c_size_t) :: written
      logical :: removed

      written = c_write(2_c_int, last_words, len_trim(last_words, c_size_t))
      if (lock /= "") removed = remove_file(trim(lock))
      if (number /= 0) call end_at_once(2)
   end subroutine take_crash

   !> Set the lock file that this process holds; "" for none.
   subroutine note_lock(name)
      character(len=*), intent(in) :: name

      lock = name
   end subroutine note_lock

   !> Signal handler for Ctrl-C and SIGTERM.
   subroutine take_signal(number) bind(c, name="")
      integer(c_int), value :: number
      integer(i8) :: now, rate

      call system_clock(now, rate)
      if (status == 0) then
         came = now
         status = 128 + int(number)
      else if (now - came > together*rate) then
         call end_at_once(128 + int(number))
      end if
   end subroutine take_signal
end module rockfall_interrupts
