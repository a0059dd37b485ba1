! SPDX-License-Identifier: BSD-3-Clause
!> Crossings of a long run in an unnamed file in the folder of its output, so that memory does not grow with their
!> number. Blocks are in the order in which boulders end, as in part files.
module rockfall_spilled_crossings
   use rockfall_kinds, only: i8
   use rockfall_error, only: error_t, fail
   use rockfall_system, only: remove_file
   use rockfall_crossing_rows, only: crossing_rows_t, start_rows, make_room, clear_rows, n_reals
   implicit none
   private
   public :: spilled_crossings_t, block_crossings

   !> Number of crossings in memory above which they are moved to the file.
   integer(i8), parameter :: block_crossings = 1000000

   type :: spilled_crossings_t
      character(len=:), allocatable :: name       !! name of the file, if the system keeps names of open files
      integer, private :: unit = -1
      integer(i8) :: n = 0                        !! crossings in the file
      integer(i8), allocatable :: size(:)         !! crossings of each block
      integer(i8), allocatable, private :: at(:)  !! position of each block
   contains
      procedure :: take, read_block, close => close_store
   end type spilled_crossings_t

contains

   !> Move crossings to the store, if there are enough for a block.
   subroutine take(this, rows, error)
      class(spilled_crossings_t), intent(inout) :: this
      type(crossing_rows_t), intent(inout) :: rows
      type(error_t), allocatable, intent(out) :: error
      integer(i8) :: at
      integer :: k, status
      logical :: removed

      if (rows%n < block_crossings) return
      status = 0
      if (this%unit == -1) then
         open (newunit=this%unit, file=this%name, access="stream", form="unformatted", status="replace", &
               action="readwrite", iostat=status)
         if (status == 0) removed = remove_file(this%name)  ! fails if open files keep their names, see close_store
         this%size = [integer(i8) ::]
         this%at = [integer(i8) ::]
      end if
      if (status == 0) inquire (unit=this%unit, size=at)
      associate (n => rows%n)
         if (status == 0) write (this%unit, pos=at + 1, iostat=status) rows%boulder(:n), rows%line(:n)
         do k = 1, n_reals
            if (status == 0) write (this%unit, iostat=status) rows%real(k)%of(:n)
         end do
         if (status == 0 .and. rows%may_break) write (this%unit, iostat=status) rows%volume(:n), rows%fragments(:n)
         if (status == 0 .and. rows%may_hit) write (this%unit, iostat=status) rows%outcome(:n)
      end associate
      if (status == 0) flush (this%unit, iostat=status)
      if (status /= 0) then
         call fail(error, this%name//": cannot store line crossings: free disk space, or use fewer lines")
         return
      end if
      this%size = [this%size, rows%n]
      this%at = [this%at, at + 1]
      this%n = this%n + rows%n
      call clear_rows(rows)
   end subroutine take

   !> Read a block; `good` is false if the file lacks it or memory is short.
   subroutine read_block(this, block, like, rows, good)
      class(spilled_crossings_t), intent(in) :: this
      integer, intent(in) :: block
      type(crossing_rows_t), intent(in) :: like  !! rows with the same columns
      type(crossing_rows_t), intent(inout) :: rows
      logical, intent(out) :: good
      integer :: k, status

      if (.not. allocated(rows%boulder)) call start_rows(like%may_break, like%may_hit, rows)
      call clear_rows(rows)
      call make_room(rows, this%size(block), good)
      if (.not. good) return
      rows%n = this%size(block)
      associate (n => rows%n)
         read (this%unit, pos=this%at(block), iostat=status) rows%boulder(:n), rows%line(:n)
         do k = 1, n_reals
            if (status == 0) read (this%unit, iostat=status) rows%real(k)%of(:n)
         end do
         if (status == 0 .and. rows%may_break) read (this%unit, iostat=status) rows%volume(:n), rows%fragments(:n)
         if (status == 0 .and. rows%may_hit) read (this%unit, iostat=status) rows%outcome(:n)
      end associate
      good = status == 0
   end subroutine read_block

   !> Discard the blocks and the file.
   subroutine close_store(this)
      class(spilled_crossings_t), intent(inout) :: this
      integer :: status

      if (this%unit /= -1) close (this%unit, status="delete", iostat=status)
      this%unit = -1
      this%n = 0
   end subroutine close_store
end module rockfall_spilled_crossings
