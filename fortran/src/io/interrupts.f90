! SPDX-License-Identifier: BSD-3-Clause
!> Ctrl-C, and SIGTERM, which batch systems send at a time limit: they must not lose work. And a file that is damaged in
!> such a way that HDF5 crashes over it: it must be named. The only variables of a module: a signal can leave word
!> nowhere else.
module rockfall_interrupts
   use, intrinsic :: iso_c_binding, only: c_char, c_int, c_size_t, c_intptr_t, c_funptr, c_funloc
   use rockfall_kinds, only: wp, i8
   use rockfall_filesystem, only: end_at_once, remove_file, c_signal
   implicit none
   private
   public :: note_interrupts, interrupt_status, begin_reading, end_reading, note_lock

   integer(c_int), parameter :: interrupt_signal = 2, terminate_signal = 15  !! SIGINT, SIGTERM
   !> Seconds in which signals are one: `timeout` sends its own to a process and to its group.
   real(wp), parameter :: together = 0.1_wp

   integer, save, volatile :: status = 0    !! exit status after the first that came
   integer(i8), save, volatile :: came = 0  !! when it did [ticks]

   integer(c_int), parameter :: crashes(4) = [6_c_int, 7_c_int, 8_c_int, 11_c_int]  !! SIGABRT, SIGBUS, SIGFPE, SIGSEGV
   character(len=4096), save :: last_words = ""  !! of a crash
   character(len=4096), save :: lock = ""        !! a file to be removed then

   interface
      integer(c_size_t) function c_write(file, text, bytes) bind(c, name="write")
         import :: c_char, c_int, c_size_t
         integer(c_int), value :: file
         character(kind=c_char), intent(in) :: text(*)
         integer(c_size_t), value :: bytes
      end function c_write
   end interface

contains

   !> From now on a first Ctrl-C or SIGTERM is noted, no more; a second ends the process at once.
   subroutine note_interrupts()
      type(c_funptr) :: action
      integer(c_intptr_t) :: before

      action = c_funloc(take_signal)
      before = c_signal(interrupt_signal, transfer(action, before))
      before = c_signal(terminate_signal, transfer(action, before))
   end subroutine note_interrupts

   !> 0, or the exit status of a program that stops because of the signal that came: 130, 143.
   integer function interrupt_status()
      interrupt_status = status
   end function interrupt_status

   !> Until `end_reading`, a crash is the fault of a file.
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

   !> As signal() wants it.
   subroutine take_crash(number) bind(c, name="")
      integer(c_int), value :: number
      integer(c_size_t) :: written
      logical :: removed

      written = c_write(2_c_int, last_words, len_trim(last_words, c_size_t))
      if (lock /= "") removed = remove_file(trim(lock))
      if (number /= 0) call end_at_once(2)
   end subroutine take_crash

   !> The lock that this process holds, "" without one.
   subroutine note_lock(name)
      character(len=*), intent(in) :: name

      lock = name
   end subroutine note_lock

   !> As signal() wants it.
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
