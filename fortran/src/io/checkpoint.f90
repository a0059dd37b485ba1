! SPDX-License-Identifier: BSD-3-Clause
!> Checkpoint of a long run: a part file that is replaced atomically, so that a killed run continues from the last
!> checkpoint. Failure to write it (a full disk) does not end the run.
module rockfall_checkpoint
   use rockfall_kinds, only: wp, i8
   use rockfall_error, only: error_t, fail
   use rockfall_text, only: integer_text
   use rockfall_system, only: path_exists, remove_file, hidden_name, interrupt_status, say_to, check_space
   use rockfall_case, only: case_t
   use rockfall_scene_file, only: inputs_t
   use rockfall_part_file, only: write_part, read_part, is_finished, row_bytes, boulders_in
   use rockfall_run_state, only: run_t
   use rockfall_spilled_crossings, only: spilled_crossings_t
   use rockfall_run_loop, only: run_observer_t, save_rest
   implicit none
   private
   public :: checkpoint_t, check_checkpoint, name_checkpoint, remove_checkpoint

   type, extends(run_observer_t) :: checkpoint_t
      character(len=:), allocatable :: output, name  !! path of the output; path of its checkpoint
      type(case_t), pointer :: case => null()
      character(len=:), allocatable :: text         !! case text, with the command-line options applied
      type(inputs_t), pointer :: inputs => null()
      real(wp) :: every = 0                         !! interval between saves [s]; 0 = never
      logical :: resumes = .false., overwrites = .false.  !! options of the command line
      type(spilled_crossings_t) :: store               !! stored crossings of the run
      procedure(say_to), pointer, nopass :: say => null()
      integer(i8), private :: next = 0              !! time of the next save [ticks]
      integer(i8), private :: kept = 0              !! number of boulders in the last save
   contains
      procedure :: on_start, on_chunk
   end type checkpoint_t

contains

   !> Refuse to overwrite a stopped run without --resume, or a file that is not a checkpoint.
   subroutine check_checkpoint(name, resume, error)
      character(len=*), intent(in) :: name
      logical, intent(in) :: resume
      type(error_t), allocatable, intent(out) :: error
      integer(i8) :: boulders

      if (.not. path_exists(name)) return
      boulders = boulders_in(name)
      if (boulders < 0) then
         call fail(error, name//": exists but is not a readable checkpoint: remove it, or choose another output")
      else if (.not. resume) then
         call fail(error, name//": contains "//integer_text(boulders)//" boulders of a stopped run: continue with " &
                   //"--resume, or remove it")
      end if
   end subroutine check_checkpoint

   !> Append the name of an existing checkpoint to the error of a result that could not be written.
   subroutine name_checkpoint(this, error)
      type(checkpoint_t), intent(in) :: this
      type(error_t), intent(inout) :: error

      if (path_exists(this%name)) error%message = error%message//". "//this%name//" contains "// &
                                                  integer_text(boulders_in(this%name))// &
                                                  " boulders: continue with --resume"
   end subroutine name_checkpoint

   !> Check output and disk, and continue from a checkpoint, if any. If the output is complete, the run ends at once.
   subroutine on_start(this, run, error)
      class(checkpoint_t), intent(inout) :: this
      type(run_t), intent(inout), target :: run
      type(error_t), allocatable, intent(out) :: error

      if (this%resumes .and. path_exists(this%output) .and. .not. path_exists(this%name)) then
         if (is_finished(this%output, this%inputs, run)) then
            call fail(error, this%output//": already contains the finished run of this case: nothing was changed", &
                      code=0)
         else if (.not. this%overwrites) then
            call fail(error, this%output//": already exists; not overwritten (--overwrite replaces it)")
         end if
      end if
      if (.not. allocated(error)) call check_space(this%output, row_bytes(run), error)
      if (allocated(error)) return
      call wait_for(this, this%every)
      if (.not. path_exists(this%name)) return
      call read_part(this%name, this%inputs, run, error)
      this%kept = run%done
   end subroutine on_start

   !> Move crossings to a file. Save if a save is due or a signal has arrived; a signal also stops the run.
   subroutine on_chunk(this, run, error)
      class(checkpoint_t), intent(inout) :: this
      type(run_t), intent(inout), target :: run
      type(error_t), allocatable, intent(out) :: error
      integer(i8) :: now
      integer :: status

      call this%store%take(run%crossings, error)
      if (allocated(error)) return
      status = interrupt_status()
      call system_clock(now)
      if (status /= 0 .or. now >= this%next) call save(this, run)
      if (status == 0) return
      if (this%kept > 0) then
         call fail(error, "interrupted: "//this%name//" contains "//integer_text(this%kept)//" of " &
                   //integer_text(run%boulders)//" boulders: continue with --resume", status)
      else
         call fail(error, "interrupted: no boulders were saved", status)
      end if
   end subroutine on_chunk

   !> Save the completed boulders, if any are new and checkpoints are enabled.
   subroutine save(this, run)
      class(checkpoint_t), intent(inout) :: this
      type(run_t), intent(inout), target :: run
      type(error_t), allocatable :: error
      integer(i8) :: begun, end, rate

      if (this%every <= 0 .or. run%done == this%kept) return
      call system_clock(begun)
      call write_part(this%name, hidden_name(this%name), this%case, this%text, this%inputs, run, this%store, &
                      error)
      call system_clock(end, rate)
      call wait_for(this, max(this%every, save_rest*real(end - begun, wp)/rate))
      this%kept = run%done
      if (.not. allocated(error)) return
      this%every = 0
      this%kept = 0
      if (path_exists(this%name)) this%kept = max(0_i8, boulders_in(this%name))
      call this%say(error%message//". No further checkpoints are written")
   end subroutine save

   subroutine wait_for(this, seconds)
      class(checkpoint_t), intent(inout) :: this
      real(wp), intent(in) :: seconds  !! [s]
      integer(i8) :: now, rate

      call system_clock(now, rate)
      this%next = now + int(min(seconds*rate, 0.4_wp*huge(now)), i8)
   end subroutine wait_for

   !> Remove the checkpoint once the results are written.
   subroutine remove_checkpoint(this)
      type(checkpoint_t), intent(in) :: this
      logical :: ok

      ok = remove_file(this%name)
      ok = remove_file(hidden_name(this%name))
   end subroutine remove_checkpoint
end module rockfall_checkpoint
