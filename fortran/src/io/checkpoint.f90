! SPDX-License-Identifier: BSD-3-Clause
!> What a long run has done so far, on disk, so that a run that was killed goes on from there.
!>
!> A folder holds `fates` and `crossings`, which only grow, `tallies-0` or `tallies-1`, written in turn,
!> and `state.txt`, which says how much of them counts, with checksums. It is replaced last, in one step,
!> when all that it tells of is on disk: at any instant it describes a whole state. A thread of its own writes
!> while boulders fly: rows that are done do not change any more, and tallies are given to the system before.
module rockfall_checkpoint
   use, intrinsic :: iso_c_binding, only: c_int, c_intptr_t, c_ptr, c_null_ptr, c_funptr, c_funloc, c_loc, c_f_pointer
   use rockfall_kinds, only: wp, i4, i8
   use rockfall_error, only: error_t, fail
   use rockfall_text_file, only: read_text
   use rockfall_text, only: integer_text
   use rockfall_decimal, only: real_text
   use rockfall_filesystem, only: make_folder, remove_folder, remove_file, rename_path, path_exists, is_folder, &
                                  is_empty, folder_of
   use rockfall_interrupts, only: interrupt_status
   use rockfall_lock, only: lock_t, lock_name, lock_folder
   use rockfall_checksum, only: text_checksum
   use rockfall_paths, only: version
   use rockfall_bytefile, only: byte_file_t, read_from, write_new, write_on, open_bytes, pass_bytes, put_text, &
                                close_bytes, sync_folder
   use rockfall_trajectory, only: boulder_result_t, crossing_t
   use rockfall_load, only: input_file_t
   use rockfall_simulate, only: keeper_t, results_t, reached_cells
   implicit none
   private
   public :: checkpoint_t, lock_checkpoint, check_checkpoint, checkpoint, remove_checkpoint

   character(len=*), parameter :: state_name = "state.txt", part_name = "state.txt.part"
   character(len=*), parameter :: name_of_python = "state.json"  !! of the checkpoints of `rockfall run`
   character(len=*), parameter :: names(4) = [character(len=9) :: "fates", "crossings", "tallies-0", "tallies-1"]
   character(len=*), parameter :: last_word = "sha256: "  !! of all before it in the state
   character(len=1), parameter :: line_end = achar(10)
   integer, parameter :: parts = 3  !! fates, crossings, tallies

   !> What the folder holds; the numbers of its state.
   type :: kept_t
      integer(i8) :: boulders = 0       !! whose rows count
      integer(i8) :: cells = 0          !! in the tallies
      integer(i8) :: columns = 0        !! of counts of classes
      integer :: turn = 0               !! which tallies, 0 or 1
      integer(i8) :: bytes(parts) = 0   !! of the files that count
      integer(i8) :: sum(2, parts) = 0  !! their checksums
   end type kept_t

   !> What is to be written, for the thread that does it.
   type :: job_t
      character(len=:), allocatable :: folder, identity, seconds
      type(kept_t) :: before, next  !! what the folder holds, and will
      type(boulder_result_t), pointer, contiguous :: fate(:)
      type(crossing_t), pointer, contiguous :: crossing(:, :)
      type(byte_file_t) :: tallies  !! all but closed
      logical :: ok = .true.
   end type job_t

   !> The checkpoint of a run. One that cannot be written (a full disk) does not end the run: `say` is told
   !> once, and the last good one stays.
   type, extends(keeper_t) :: checkpoint_t
      private
      character(len=:), allocatable :: folder
      character(len=:), allocatable :: identity  !! lines `what: value` that a run which goes on must share
      real(wp) :: every = 0                      !! [s]; 0 = never
      integer(i8) :: last = 0                    !! when it was last begun [ticks]
      procedure(say_to), pointer, nopass :: say => null()
      type(kept_t) :: kept
      type(job_t), pointer :: job => null()      !! that is being written
      integer(c_intptr_t) :: thread = 0
      logical :: threaded = .false.
   contains
      procedure :: restore, look, finish
   end type checkpoint_t

   interface
      integer(c_int) function c_pthread_create(thread, attributes, start, argument) bind(c, name="pthread_create")
         import :: c_int, c_intptr_t, c_ptr, c_funptr
         integer(c_intptr_t), intent(out) :: thread
         type(c_ptr), value :: attributes
         type(c_funptr), value :: start
         type(c_ptr), value :: argument
      end function c_pthread_create
      integer(c_int) function c_pthread_join(thread, result) bind(c, name="pthread_join")
         import :: c_int, c_intptr_t, c_ptr
         integer(c_intptr_t), value :: thread
         type(c_ptr), value :: result
      end function c_pthread_join
   end interface

   abstract interface
      subroutine say_to(message)
         character(len=*), intent(in) :: message
      end subroutine say_to
   end interface

contains

   !> Take `folder` for this run alone; one of somebody else's is refused.
   subroutine lock_checkpoint(folder, say, lock, error)
      character(len=*), intent(in) :: folder
      procedure(say_to) :: say
      type(lock_t), intent(out) :: lock
      type(error_t), allocatable, intent(out) :: error
      character(len=14), parameter :: own(8) = [character(len=14) :: lock_name, state_name, part_name, &
                                                name_of_python, names]
      logical :: foreign, ours
      integer :: k

      foreign = is_folder(folder)
      if (foreign) foreign = .not. is_empty(folder)
      do k = 1, size(own)
         ours = path_exists(folder//"/"//trim(own(k)))
         foreign = foreign .and. .not. ours
      end do
      if (foreign) then
         call fail(error, folder//": is there, and no checkpoint; choose another output")
      else
         call lock_folder(folder, say, lock, error)
      end if
   end subroutine lock_checkpoint

   !> Refuse to overwrite, unasked, a checkpoint that lies in `folder`, and one of `rockfall run`.
   subroutine check_checkpoint(folder, resume, error)
      character(len=*), intent(in) :: folder
      logical, intent(in) :: resume
      type(error_t), allocatable, intent(out) :: error
      logical :: ours, of_python

      ours = path_exists(folder//"/"//state_name)
      of_python = path_exists(folder//"/"//name_of_python)
      if (of_python) then
         call fail(error, folder//": is of `rockfall run`; go on with that, or remove it")
      else if (ours .and. .not. resume) then
         call fail(error, folder//": holds a run that was stopped; go on with resume=true, or remove it")
      end if
   end subroutine check_checkpoint

   !> A checkpoint in `folder`, written every so many seconds (0 = never).
   function checkpoint(folder, every, case_text, files, say) result(this)
      character(len=*), intent(in) :: folder
      real(wp), intent(in) :: every                !! [s]
      character(len=*), intent(in) :: case_text    !! without what changes no number
      type(input_file_t), intent(in) :: files(:)   !! that the case names
      procedure(say_to) :: say
      type(checkpoint_t) :: this
      integer :: k

      this%folder = folder
      this%every = every
      this%say => say
      this%identity = "version: rockfall-batch "//version//line_end//"case: "//text_checksum(case_text)//line_end
      do k = 1, size(files)
         this%identity = this%identity//trim(files(k)%key)//": "//files(k)%checksum//line_end
      end do
   end function checkpoint

   ! ---- from disk ----------------------------------------------------------------------------

   !> Bring results to the state of the folder; nothing is done where there is none. A checkpoint of another
   !> case, input, version or range of boulders, or one that is damaged, is refused.
   subroutine restore(this, results, error)
      class(checkpoint_t), intent(inout) :: this
      type(results_t), intent(inout) :: results
      type(error_t), allocatable, intent(out) :: error
      type(byte_file_t) :: file
      character(len=:), allocatable :: name
      logical :: exists
      integer(i8) :: length
      integer :: k

      this%identity = this%identity//"boulders: "//integer_text(results%before + 1)//" to " &
                      //integer_text(results%before + results%boulders)//" of "//integer_text(results%asked)//line_end
      call system_clock(this%last)
      exists = path_exists(this%folder//"/"//state_name)
      if (.not. exists) return
      call read_state(this, results, error)
      if (allocated(error)) return
      results%done = this%kept%boulders
      do k = 1, parts
         name = name_of(k, this%kept%turn)
         inquire (file=this%folder//"/"//name, size=length)
         call open_bytes(this%folder//"/"//name, read_from, file)
         if (k < parts) then
            call pass_rows(file, k, results%fate, results%crossing, 1_i8, results%done)
         else
            call pass_tallies(file, results, this%kept)
         end if
         call close_bytes(file)
         if (k < parts) length = min(length, this%kept%bytes(k))  ! a kill left more rows than count
         if (file%ok .and. length == this%kept%bytes(k) .and. file%bytes == length &
             .and. all(file%sum == this%kept%sum(:, k))) cycle
         call fail_damaged(this, name, error)
         return
      end do
   end subroutine restore

   !> What the folder holds, and that it is of this run.
   subroutine read_state(this, results, error)
      type(checkpoint_t), intent(inout) :: this
      type(results_t), intent(inout) :: results
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: text, numbers
      integer :: last, status

      call read_text(this%folder//"/"//state_name, text, error)
      if (allocated(error)) return
      last = index(text, last_word, back=.true.)
      if (text(max(1, last):) /= signed(text(:last - 1))) then
         call fail_damaged(this, state_name, error)
      else if (index(text, this%identity) /= 1) then
         call fail(error, this%folder//": is of another run, its "//difference(this%identity, text) &
                   //" differs; remove it, or run elsewhere")
      end if
      if (allocated(error)) return
      numbers = text(len(this%identity) + 1:last - 2)
      read (numbers, *, iostat=status) this%kept, results%wall, results%cpu
      if (status /= 0 .or. .not. possible(this%kept, results)) then
         call fail_damaged(this, state_name, error)
      else if (this%kept%columns > size(results%bin_counts, 2)) then
         call fail(error, this%folder//": the counts of quantile maps in "//integer_text(this%kept%columns) &
                   //" cells do not fit in memory")
      end if
   end subroutine read_state

   !> The last line of the state, from what stands before it.
   pure function signed(text) result(line)
      character(len=*), intent(in) :: text
      character(len=:), allocatable :: line

      line = last_word//text_checksum(text)//line_end
   end function signed

   !> The first `what` of the lines of an identity in which another differs.
   pure function difference(identity, other) result(what)
      character(len=*), intent(in) :: identity, other
      character(len=:), allocatable :: what
      integer :: k, first

      do k = 1, min(len(identity), len(other)) - 1
         if (identity(k:k) /= other(k:k)) exit
      end do
      first = index(identity(:k - 1), line_end, back=.true.) + 1
      what = identity(first:first + index(identity(first:), ":") - 2)
   end function difference

   !> Whether a run with room for such results can have got there.
   pure logical function possible(kept, results)
      type(kept_t), intent(in) :: kept
      type(results_t), intent(in) :: results

      possible = kept%boulders >= 1 .and. kept%boulders <= results%boulders &
                 .and. kept%cells >= 0 .and. kept%cells <= cells_of(results) &
                 .and. kept%columns >= 0 .and. any(kept%turn == [0, 1])
   end function possible

   subroutine fail_damaged(this, name, error)
      type(checkpoint_t), intent(in) :: this
      character(len=*), intent(in) :: name
      type(error_t), allocatable, intent(out) :: error

      call fail(error, this%folder//": "//trim(name)//" is damaged; remove the folder to begin anew")
   end subroutine fail_damaged

   ! ---- to disk ------------------------------------------------------------------------------

   !> Begin to write a checkpoint, if it is time to. After a signal it is time, and the run is to stop.
   subroutine look(this, results, error)
      class(checkpoint_t), intent(inout) :: this
      type(results_t), intent(inout), target :: results
      type(error_t), allocatable, intent(out) :: error
      integer(i8) :: now, rate
      integer :: status

      status = interrupt_status()
      call system_clock(now, rate)
      if (status /= 0 .or. real(now - this%last, wp) >= this%every*rate) call save(this, results, now)
      if (status == 0) return
      call this%finish()
      if (this%kept%boulders > 0) then
         call fail(error, "interrupted: "//this%folder//" holds "//integer_text(this%kept%boulders)//" of " &
                   //integer_text(results%boulders)//" boulders; resume=true goes on", status)
      else
         call fail(error, "interrupted; nothing was kept", status)
      end if
   end subroutine look

   !> Begin to write what was done since the last checkpoint, if there is anything, and if there are to be any.
   subroutine save(this, results, now)
      class(checkpoint_t), intent(inout) :: this
      type(results_t), intent(inout), target :: results
      integer(i8), intent(in) :: now  !! [ticks]

      call this%finish()
      if (this%every <= 0 .or. results%done == this%kept%boulders) return
      this%last = now
      allocate (this%job)
      call prepare(this, results, this%job)
      this%threaded = c_pthread_create(this%thread, c_null_ptr, c_funloc(write_beside), c_loc(this%job)) == 0
      if (.not. this%threaded) call write_job(this%job)
   end subroutine save

   !> Wait for what is being written.
   subroutine finish(this)
      class(checkpoint_t), intent(inout) :: this
      integer(c_int) :: status

      if (.not. associated(this%job)) return
      if (this%threaded) status = c_pthread_join(this%thread, c_null_ptr)
      if (this%job%ok) then
         this%kept = this%job%next
      else
         call this%say(this%folder//": no checkpoint: cannot be written (the disk may be full)")
         this%every = 0
      end if
      deallocate (this%job)
   end subroutine finish

   !> All that a job needs of a run that goes on; tallies go to the system at once.
   subroutine prepare(this, results, job)
      type(checkpoint_t), intent(in) :: this
      type(results_t), intent(inout), target :: results
      type(job_t), intent(inout) :: job

      job%folder = this%folder
      job%identity = this%identity
      job%seconds = real_text(results%wall)//" "//real_text(results%cpu)
      job%before = this%kept
      job%next = kept_t(results%done, 0, results%columns, 1 - this%kept%turn, 0, 0)
      job%fate => results%fate
      job%crossing => results%crossing
      job%ok = is_folder(job%folder)
      if (.not. job%ok) then
         job%ok = make_folder(job%folder)
         if (job%ok) job%ok = sync_folder(folder_of(job%folder)//".")
      end if
      call open_bytes(job%folder//"/"//name_of(parts, job%next%turn), write_new, job%tallies)
      call pass_tallies(job%tallies, results, job%next)
   end subroutine prepare

   !> As pthreads want it.
   function write_beside(job) result(nothing) bind(c, name="")
      type(c_ptr), value :: job
      type(c_ptr) :: nothing
      type(job_t), pointer :: this

      call c_f_pointer(job, this)
      call write_job(this)
      nothing = c_null_ptr
   end function write_beside

   !> Rows of the boulders done since the last checkpoint, the end of the tallies, and the state that tells of
   !> them.
   subroutine write_job(job)
      type(job_t), intent(inout) :: job
      type(byte_file_t) :: file
      integer :: k

      call close_bytes(job%tallies)
      job%next%bytes(parts) = job%tallies%bytes
      job%next%sum(:, parts) = job%tallies%sum
      job%ok = job%ok .and. job%tallies%ok
      do k = 1, parts - 1
         if (.not. job%ok) return
         associate (path => job%folder//"/"//name_of(k, 0), before => job%before%boulders)
            if (before > 0) then
               call open_bytes(path, write_on, file, before*row_bytes(k, job%crossing), job%before%sum(:, k))
            else
               call open_bytes(path, write_new, file)
            end if
            call pass_rows(file, k, job%fate, job%crossing, before + 1, job%next%boulders)
         end associate
         call close_bytes(file)
         job%next%bytes(k) = file%bytes
         job%next%sum(:, k) = file%sum
         job%ok = file%ok
      end do
      if (job%ok) job%ok = sync_folder(job%folder)
      if (job%ok) call write_state(job)
   end subroutine write_job

   subroutine write_state(job)
      type(job_t), intent(inout) :: job
      type(byte_file_t) :: file
      character(len=:), allocatable :: text
      character(len=300) :: numbers

      write (numbers, "(*(i0,1x))") job%next
      text = job%identity//trim(numbers)//" "//job%seconds//line_end
      call open_bytes(job%folder//"/"//part_name, write_new, file)
      call put_text(file, text//signed(text))
      call close_bytes(file)
      job%ok = file%ok
      if (job%ok) job%ok = rename_path(job%folder//"/"//part_name, job%folder//"/"//state_name)
      if (job%ok) job%ok = sync_folder(job%folder)
   end subroutine write_state

   !> The run is done and written. The state goes first: without it the rest is nothing.
   subroutine remove_checkpoint(this)
      type(checkpoint_t), intent(in) :: this
      logical :: ok
      integer :: k

      ok = remove_file(this%folder//"/"//state_name)
      ok = remove_file(this%folder//"/"//part_name)
      do k = 1, size(names)
         ok = remove_file(this%folder//"/"//trim(names(k)))
      end do
      ok = remove_folder(this%folder)
   end subroutine remove_checkpoint

   ! ---- its parts, from or to a file: 1 fates, 2 crossings, 3 tallies --------------------------

   pure function name_of(part, turn) result(name)
      integer, intent(in) :: part, turn
      character(len=:), allocatable :: name

      name = trim(names(merge(part, part + turn, part < parts)))
   end function name_of

   !> Bytes of a boulder among the fates or crossings.
   pure integer(i8) function row_bytes(part, crossing) result(bytes)
      integer, intent(in) :: part
      type(crossing_t), intent(in) :: crossing(:, :)
      type(boulder_result_t) :: fate

      bytes = storage_size(fate, i8)/8
      if (part == 2) bytes = storage_size(crossing, i8)/8*size(crossing, 1)
   end function row_bytes

   !> Fates or crossings of some boulders.
   subroutine pass_rows(file, part, fate, crossing, first, last)
      type(byte_file_t), intent(inout) :: file
      integer, intent(in) :: part
      type(boulder_result_t), intent(inout), contiguous :: fate(:)
      type(crossing_t), intent(inout), contiguous :: crossing(:, :)
      integer(i8), intent(in) :: first, last
      integer(i8) :: bytes

      bytes = row_bytes(part, crossing)*(last - first + 1)
      if (part == 1) then
         call pass_bytes(file, fate(first:last), bytes)
      else
         call pass_bytes(file, crossing(:, first:last), bytes)
      end if
   end subroutine pass_rows

   !> All tallies, those of cells only where boulders came.
   subroutine pass_tallies(file, results, kept)
      type(byte_file_t), intent(inout) :: file
      type(results_t), intent(inout) :: results
      type(kept_t), intent(inout) :: kept
      integer(i8), allocatable :: cell(:)

      if (file%reads) then
         allocate (cell(kept%cells))
      else
         cell = reached_cells(results)
         kept%cells = size(cell, kind=i8)
      end if
      call pass_bytes(file, cell, storage_size(cell, i8)/8*kept%cells)
      if (file%ok) file%ok = all(cell >= 0 .and. cell < cells_of(results))
      call pass_bytes(file, results%histogram, storage_size(results%histogram, i8)/8*size(results%histogram))
      call pass_cells(results%counts, storage_size(results%counts), size(results%counts, 3))
      call pass_cells(results%sums, storage_size(results%sums), size(results%sums, 3))
      call pass_cells(results%greatest, storage_size(results%greatest), size(results%greatest, 3))
      call pass_cells(results%column, storage_size(results%column), min(1, size(results%column)))
      call pass_cells(results%stamp, storage_size(results%stamp), size(results%stamp, 3))
      call pass_bytes(file, results%bin_counts, &
                      storage_size(results%bin_counts, i8)/8*size(results%bin_counts, 1)*kept%columns)
      results%columns = int(kept%columns, i4)

   contains

      !> A stack of layers: the values of the cells of each.
      subroutine pass_cells(stack, bits, layers)
         type(*), intent(inout), target :: stack(*)  !! (nx, ny, layers)
         integer, intent(in) :: bits, layers         !! of a value; 32 or 64
         integer(i4), pointer :: value(:, :, :)
         integer(i4), allocatable :: some(:, :)
         integer :: layer

         if (layers == 0 .or. .not. file%ok) return
         call c_f_pointer(c_loc(stack), value, [int(bits/32, i8), cells_of(results), int(layers, i8)])
         do layer = 1, layers
            some = value(:, cell + 1, layer)
            call pass_bytes(file, some, 4*size(some, kind=i8))
            if (file%ok .and. file%reads) value(:, cell + 1, layer) = some
         end do
      end subroutine pass_cells
   end subroutine pass_tallies

   !> Cells of the terrain.
   pure integer(i8) function cells_of(results)
      type(results_t), intent(in) :: results

      cells_of = size(results%counts, 1, i8)*size(results%counts, 2, i8)
   end function cells_of
end module rockfall_checkpoint
