! SPDX-License-Identifier: BSD-3-Clause
!> What the checkpoint under test says.
module said_m
   implicit none
   integer, save :: times = 0
   character(len=:), allocatable, save :: said

contains

   subroutine say(message)
      character(len=*), intent(in) :: message

      times = times + 1
      said = message
   end subroutine say
end module said_m

!> Checkpoints: what was kept comes back, bit for bit; what a kill leaves behind does no harm; what is damaged,
!> forged or of another run is refused in words.
program test_checkpoint
   use rockfall_kinds, only: wp, sp, i4, i8
   use rockfall_error, only: error_t, bad_input
   use rockfall_text_file, only: read_text
   use rockfall_filesystem, only: path_exists, remove_file, is_folder
   use rockfall_checksum, only: text_checksum
   use rockfall_map_values, only: map_plan
   use rockfall_load, only: input_file_t
   use rockfall_simulate, only: results_t
   use rockfall_checkpoint, only: checkpoint_t, check_checkpoint, checkpoint, remove_checkpoint
   use said_m, only: say, said, times
   use check_m, only: check, finish
   implicit none

   character(len=*), parameter :: folder = "test_checkpoint.folder"
   character(len=*), parameter :: file(6) = [character(len=14) :: "fates", "crossings", "tallies-0", "tallies-1", &
                                             "state.txt", "state.txt.part"]
   character(len=*), parameter :: maps(5) = [character(len=10) :: "passages", "deposits", "energy_max", "speed_mean", &
                                             "energy_q95"]
   integer, parameter :: boulders = 50, nx = 7, ny = 5
   type(checkpoint_t) :: first

   call random_init(.true., .false.)
   first = made("case")
   call remove_checkpoint(first)  ! of an earlier test that failed
   call round_trips()
   call what_counts_is_not_touched()
   call traces_of_kills()
   call damaged_parts()
   call damaged_states()
   call other_runs()
   call what_lies_there()
   call full_disk()
   call finish()

contains

   !> A checkpoint that is written at every look.
   function made(case_text, input) result(this)
      character(len=*), intent(in) :: case_text
      character(len=*), intent(in), optional :: input  !! checksum of the elevations
      type(checkpoint_t) :: this
      type(input_file_t) :: files(2)

      files%key = [character(len=11) :: "dem", "sets"]
      files%checksum = "12ab"
      if (present(input)) files(1)%checksum = input
      this = checkpoint(folder, 1.0e-12_wp, case_text, files, say)
   end function made

   !> Room for results, without lines or with two, without maps or with all stacks.
   function room(lines, with_maps) result(results)
      integer, intent(in) :: lines
      logical, intent(in) :: with_maps
      type(results_t) :: results

      results%boulders = boulders
      results%before = 100
      results%asked = 1000
      if (with_maps) results%plan = map_plan(maps)
      associate (plan => results%plan)
         allocate (results%fate(boulders), results%crossing(lines, boulders))
         allocate (results%counts(nx, ny, maxval(plan%count)), source=0_i4)
         allocate (results%sums(nx, ny, maxval(plan%sum)), source=0_i8)
         allocate (results%greatest(nx, ny, maxval(plan%max)), source=0.0_sp)
         allocate (results%bin_counts(plan%rows, merge(nx*ny, 0, with_maps)), source=0_i4)
         allocate (results%column(merge(nx, 0, with_maps), merge(ny, 0, with_maps)), source=0_i4)
         allocate (results%stamp(nx, ny, merge(2, 0, with_maps)), source=0_i4)
      end associate
   end function room

   !> The next boulders, with numbers of their own, and tallies in a few more cells.
   subroutine fly(results, last)
      type(results_t), intent(inout) :: results
      integer, intent(in) :: last
      real(wp) :: x
      integer :: b, i, j

      do b = int(results%done) + 1, last
         call random_number(results%fate(b)%stop)
         results%fate(b)%status = mod(b, 4) + 1
         if (size(results%crossing, 1) > 0) call random_number(results%crossing(2, b)%v)
         call random_number(x)
         i = 1 + int(x*nx)
         j = 1 + mod(b, 3)
         if (size(results%column) == 0) cycle
         results%counts(i, j, 1) = results%counts(i, j, 1) + 1
         results%stamp(i, j, :) = [b, 2*b]
         results%sums(i, j, :) = results%sums(i, j, :) + 2_i8**40 + b
         results%greatest(i, j, :) = max(results%greatest(i, j, :), real(x, sp))
         if (results%column(i, j) == 0) then
            results%columns = results%columns + 1
            results%column(i, j) = results%columns
         end if
         results%bin_counts(b, results%column(i, j)) = b
      end do
      results%histogram = results%histogram + last
      results%done = last
      results%wall = results%wall + 1/3.0_wp
      results%cpu = results%cpu + 2/3.0_wp
   end subroutine fly

   !> Whether two runs are at the same place, bit for bit.
   logical function same(a, b)
      type(results_t), intent(in) :: a, b

      same = a%done == b%done .and. a%columns == b%columns .and. all(a%histogram == b%histogram) &
             .and. all(a%counts == b%counts) .and. all(a%sums == b%sums) .and. all(abs(a%greatest - b%greatest) <= 0) &
             .and. all(a%bin_counts == b%bin_counts) .and. all(a%column == b%column) &
             .and. all(a%stamp == b%stamp) &
             .and. abs(a%wall - b%wall) <= 0 .and. abs(a%cpu - b%cpu) <= 0
      if (.not. same) return
      same = bits(a) == bits(b)
   end function same

   !> The rows of the boulders that are done.
   function bits(a)
      type(results_t), intent(in) :: a
      character(len=:), allocatable :: bits
      integer :: b

      bits = ""
      do b = 1, int(a%done)
         associate (fate => a%fate(b), line => a%crossing(:, b))
            bits = bits//transfer([fate%stop, real(fate%status, wp)], repeat(" ", 32))
            if (size(line) > 0) bits = bits//transfer(line(2)%v, repeat(" ", 24))
         end associate
      end do
   end function bits

   !> What a new process finds.
   subroutine go_on(case_text, results, error, input)
      character(len=*), intent(in) :: case_text
      type(results_t), intent(inout) :: results
      type(error_t), allocatable, intent(out) :: error
      character(len=*), intent(in), optional :: input
      type(checkpoint_t) :: this

      this = made(case_text, input)
      call this%restore(results, error)
   end subroutine go_on

   subroutine keep(this, results)
      type(checkpoint_t), intent(inout) :: this
      type(results_t), intent(inout), target :: results
      type(error_t), allocatable :: error

      call this%look(results, error)
      call check("the run goes on", .not. allocated(error))
      call this%finish()
   end subroutine keep

   !> A run that was kept after 20 boulders (all in `results`).
   subroutine keep_20(results, this)
      type(results_t), intent(out) :: results
      type(checkpoint_t), intent(out) :: this
      type(error_t), allocatable :: error

      this = made("case")
      call remove_checkpoint(this)
      results = room(2, .true.)
      call this%restore(results, error)
      call fly(results, 20)
      call keep(this, results)
   end subroutine keep_20

   subroutine round_trips()
      integer :: lines, with_maps, last

      do lines = 0, 2, 2
         do with_maps = 0, 1
            do last = 20, 50, 30
               call round_trip(lines, with_maps == 1, last)
            end do
         end do
      end do
   end subroutine round_trips

   !> Kept twice by one process, once by the next, and read by a third.
   subroutine round_trip(lines, with_maps, last)
      integer, intent(in) :: lines, last
      logical, intent(in) :: with_maps
      type(results_t) :: results, again
      type(checkpoint_t) :: this
      type(error_t), allocatable :: error
      integer :: k

      this = made("case")
      results = room(lines, with_maps)
      call this%restore(results, error)
      call check("there is nothing to begin with", .not. allocated(error) .and. results%done == 0)
      call fly(results, 1)
      call keep(this, results)
      call fly(results, 13)
      call keep(this, results)
      this = made("case")
      again = room(lines, with_maps)
      call this%restore(again, error)
      call check("what was kept comes back", .not. allocated(error) .and. same(again, results))
      call fly(again, last)
      call keep(this, again)
      results = room(lines, with_maps)
      call go_on("case", results, error)
      call check("and so does what a second process added", .not. allocated(error) .and. same(again, results))
      call remove_checkpoint(this)
      do k = 1, size(file)
         call check("removed: "//file(k), .not. path_exists(folder//"/"//trim(file(k))))
      end do
      call check("removed", .not. is_folder(folder))
      call check("nothing was said", times == 0)
   end subroutine round_trip

   !> While the next state is made, all that the last one tells of stays as it is.
   subroutine what_counts_is_not_touched()
      type(results_t) :: results
      type(checkpoint_t) :: this
      character(len=:), allocatable :: fates, crossings, tallies, later

      call keep_20(results, this)
      fates = content("fates")
      crossings = content("crossings")
      tallies = content("tallies-1")
      call fly(results, 50)
      call keep(this, results)
      later = content("fates")
      call check("fates grow", len(later) == len(fates)/20*50 .and. index(later, fates) == 1)
      later = content("crossings")
      call check("crossings grow", len(later) == len(crossings)/20*50 .and. index(later, crossings) == 1)
      later = content("tallies-1")
      call check("tallies go elsewhere", later == tallies)
      call remove_checkpoint(this)
   end subroutine what_counts_is_not_touched

   !> A process that ends before the state is renamed leaves more rows, other tallies, a part of a state.
   subroutine traces_of_kills()
      type(results_t) :: results, again
      type(checkpoint_t) :: this
      type(error_t), allocatable :: error
      integer :: k, length
      character(len=*), parameter :: unused(4) = [character(len=14) :: "fates", "crossings", "tallies-0", &
                                                  "state.txt.part"]

      do k = 1, size(unused)
         do length = 0, 5000, 5000
            call keep_20(results, this)
            call change(unused(k), content(unused(k))//repeat("x", length))
            again = room(2, .true.)
            this = made("case")
            call this%restore(again, error)
            call check("a kill left "//unused(k), .not. allocated(error) .and. same(again, results))
            call fly(again, 50)
            call keep(this, again)
            results = room(2, .true.)
            call go_on("case", results, error)
            call check("and it goes on", .not. allocated(error) .and. same(again, results))
         end do
      end do
      call remove_checkpoint(this)
   end subroutine traces_of_kills

   !> Rows and tallies that were cut, changed, emptied, removed, or are of another checkpoint.
   subroutine damaged_parts()
      type(results_t) :: results
      type(checkpoint_t) :: this
      character(len=:), allocatable :: good, other
      character(len=*), parameter :: used(3) = [character(len=9) :: "fates", "crossings", "tallies-1"]
      integer :: k, at
      logical :: ok

      do k = 1, size(used)
         call keep_20(results, this)
         other = content(used(k))
         call keep_20(results, this)
         good = content(used(k))
         call refused(used(k), other, trim(used(k))//" is damaged")
         call refused(used(k), "", trim(used(k))//" is damaged")
         call refused(used(k), good(:len(good) - 1), trim(used(k))//" is damaged")
         call refused(used(k), repeat(char(255), len(good)), trim(used(k))//" is damaged")
         do at = 1, len(good), 97
            call refused(used(k), good(:at - 1)//char(ieor(ichar(good(at:at)), 64))//good(at + 1:), &
                         trim(used(k))//" is damaged")
         end do
         ok = remove_file(folder//"/"//trim(used(k)))
         call refused("", "", trim(used(k))//" is damaged")
      end do
      call remove_checkpoint(this)
   end subroutine damaged_parts

   !> The state, cut anywhere, with any byte changed, or made with numbers that no run has.
   subroutine damaged_states()
      type(results_t) :: results
      type(checkpoint_t) :: this
      character(len=:), allocatable :: good, identity, numbers
      integer :: k

      call keep_20(results, this)
      good = content("state.txt")
      do k = 0, len(good) - 1
         call refused("state.txt", good(:k), "state.txt is damaged")
         call refused("state.txt", good(:k)//char(ieor(ichar(good(k + 1:k + 1)), 1))//good(k + 2:), &
                      "state.txt is damaged")
      end do
      call refused("state.txt", "PK"//repeat(char(0), 5000), "state.txt is damaged")
      identity = good(:index(good, "boulders: ") + index(good(index(good, "boulders: "):), achar(10)) - 1)
      numbers = good(len(identity) + 1:index(good, "sha256") - 2)
      do k = 1, 4  ! after boulders, cells, columns, turn
         numbers = numbers(index(numbers, " ") + 1:)
      end do
      call refused("state.txt", signed(identity//"51 3 3 1 "//numbers), "state.txt is damaged")
      call refused("state.txt", signed(identity//"0 3 3 1 "//numbers), "state.txt is damaged")
      call refused("state.txt", signed(identity//"99999999999999999999 3 3 1 "//numbers), "state.txt is damaged")
      call refused("state.txt", signed(identity//"20"), "state.txt is damaged")
      call refused("state.txt", signed(identity//"20 4000000000000 3 1 "//numbers), "state.txt is damaged")
      call refused("state.txt", signed(identity//"20 3 4000000000000 1 "//numbers), "do not fit in memory")
      call refused("state.txt", signed(identity//"20 3 3 2 "//numbers), "state.txt is damaged")
      call refused("state.txt", signed(""), "of another run, its version differs")
      call remove_checkpoint(this)
   end subroutine damaged_states

   function signed(text)
      character(len=*), intent(in) :: text
      character(len=:), allocatable :: signed

      signed = text//achar(10)//"sha256: "//text_checksum(text//achar(10))//achar(10)
   end function signed

   subroutine other_runs()
      type(results_t) :: results, other
      type(checkpoint_t) :: this
      type(error_t), allocatable :: error

      call keep_20(results, this)
      call go_on("another case", results, error)
      call check_error(error, "is of another run, its case differs")
      call go_on("case", results, error, input="12ac")
      call check_error(error, "is of another run, its dem differs")
      other = room(2, .true.)
      other%before = 101
      call go_on("case", other, error)
      call check_error(error, "is of another run, its boulders differs")
      call check("nothing was taken of them", other%done == 0)
      other = room(2, .true.)
      other%boulders = boulders - 1
      call go_on("case", other, error)
      call check_error(error, "is of another run, its boulders differs")
      other = room(2, .true.)
      other%asked = 1001
      call go_on("case", other, error)
      call check_error(error, "is of another run, its boulders differs")
      call remove_checkpoint(this)
   end subroutine other_runs

   !> Before a run: one that is there is not overwritten unasked, nor is one of Python's.
   subroutine what_lies_there()
      type(results_t) :: results
      type(checkpoint_t) :: this
      type(error_t), allocatable :: error
      logical :: ok

      call check_checkpoint(folder, .false., error)
      call check("there is none", .not. allocated(error))
      call keep_20(results, this)
      call check_checkpoint(folder, .true., error)
      call check("it is to go on", .not. allocated(error))
      call check_checkpoint(folder, .false., error)
      call check_error(error, "holds a run that was stopped; go on with resume=true, or remove it")
      call change("state.json", "{}")
      call check_checkpoint(folder, .true., error)
      call check_error(error, "is of `rockfall run`; go on with that, or remove it")
      ok = remove_file(folder//"/state.json")
      call remove_checkpoint(this)
   end subroutine what_lies_there

   !> A disk that is full when one of the files is written: said once, and the last good state stays.
   subroutine full_disk()
      type(results_t) :: results
      type(checkpoint_t) :: this
      character(len=*), parameter :: written(4) = [character(len=14) :: "fates", "crossings", "tallies-0", &
                                                   "state.txt.part"]
      character(len=:), allocatable :: path, state
      logical :: ok
      integer :: k

      do k = 1, size(written)
         path = folder//"/"//trim(written(k))
         call keep_20(results, this)
         state = content("state.txt")
         ok = remove_file(path)
         call execute_command_line("ln -s /dev/full "//path)
         call fly(results, 30)
         call keep(this, results)
         call fly(results, 40)
         call keep(this, results)
         call check("said once", times == k)
         call check("in these words", said == folder//": no checkpoint: cannot be written (the disk may be full)")
         call check("the state stays", content("state.txt") == state)
         call remove_checkpoint(this)
      end do
   end subroutine full_disk

   ! ---- files ----------------------------------------------------------------------------------

   function content(name) result(text)
      character(len=*), intent(in) :: name
      character(len=:), allocatable :: text
      type(error_t), allocatable :: error

      call read_text(folder//"/"//trim(name), text, error)
      if (allocated(error)) text = ""
   end function content

   subroutine change(name, text)
      character(len=*), intent(in) :: name, text
      integer :: unit

      open (newunit=unit, file=folder//"/"//trim(name), access="stream", form="unformatted", status="replace", &
            action="write")
      write (unit) text
      close (unit)
   end subroutine change

   !> With this text in a file of the folder ("": as it is), a run is refused in these words.
   subroutine refused(name, text, words)
      character(len=*), intent(in) :: name, text, words
      type(results_t) :: results
      type(error_t), allocatable :: error

      if (name /= "") call change(name, text)
      results = room(2, .true.)
      call go_on("case", results, error)
      call check_error(error, words)
   end subroutine refused

   subroutine check_error(error, words)
      type(error_t), allocatable, intent(in) :: error
      character(len=*), intent(in) :: words
      logical :: ok

      ok = .false.
      if (allocated(error)) then
         ok = error%code == bad_input .and. index(error%message, folder//": ") == 1 &
              .and. index(error%message, words) > 0 .and. index(error%message, achar(10)) == 0
         if (.not. ok) print "(2a)", "   got ", error%message
      end if
      call check("refused: "//words, ok)
   end subroutine check_error
end program test_checkpoint
