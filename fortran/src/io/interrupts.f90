! SPDX-License-Identifier: BSD-3-Clause
!> Ctrl-C, and SIGTERM, which batch systems send at a time limit: they must not lose work. The only variables of
!> a module: a signal can leave word nowhere else.
module rockfall_interrupts
   use, intrinsic :: iso_c_binding, only: c_int, c_intptr_t, c_funptr, c_funloc
   use rockfall_kinds, only: wp, i8
   use rockfall_filesystem, only: end_at_once
   implicit none
   private
   public :: note_interrupts, interrupt_status

   integer(c_int), parameter :: interrupt_signal = 2, terminate_signal = 15  !! SIGINT, SIGTERM
   !> Seconds in which signals are one: `timeout` sends its own to a process and to its group.
   real(wp), parameter :: together = 0.1_wp

   integer, save, volatile :: status = 0    !! exit status after the first that came
   integer(i8), save, volatile :: came = 0  !! when it did [ticks]

   interface
      integer(c_intptr_t) function c_signal(number, action) bind(c, name="signal")
         import :: c_int, c_intptr_t
         integer(c_int), value :: number
         integer(c_intptr_t), value :: action
      end function c_signal
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
