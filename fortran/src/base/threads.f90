! SPDX-License-Identifier: BSD-3-Clause
!> Number of threads of a run, checked against the available memory: a thread that overruns its stack or cannot be
!> created would end the process.
module rockfall_threads
   use, intrinsic :: iso_c_binding, only: c_int, c_int64_t
   use rockfall_kinds, only: wp, i8
   use rockfall_error, only: error_t, fail
   use rockfall_text, only: integer_text
   implicit none
   private
   public :: team_size, check_team, release_team, deadline_in, take_batch, batch

   integer, parameter :: batch = 16  !! boulders taken by a thread at a time
   integer, parameter :: max_threads = 1024  !! far above the cores of any machine: more is a mistake
   integer(c_int64_t), parameter :: kilobyte = 1024
   integer(c_int64_t), parameter :: headroom = 16000*kilobyte  !! memory needed apart from stacks and work space [bytes]
   integer(c_int64_t), parameter :: work_space = 1000*kilobyte  !! memory of a thread apart from its stack [bytes]
   integer(c_int64_t), parameter :: min_stack = 500*kilobyte  !! "ulimit -s 512" is enough [bytes]

   interface  ! process_memory.c
      integer(c_int64_t) function c_stack() bind(c, name="rockfall_stack")
         import :: c_int64_t
      end function c_stack
      integer(c_int) function spare_arenas() bind(c, name="rockfall_spare_arenas")
         import :: c_int
      end function spare_arenas
      integer(c_int) function c_fits(bytes) bind(c, name="rockfall_fits")
         import :: c_int, c_int64_t
         integer(c_int64_t), value :: bytes
      end function c_fits
   end interface

contains

   !> Number of threads of a run; 0 means all that OpenMP offers (OMP_NUM_THREADS, or the cores of the process).
   integer function team_size(threads)
      !$ use omp_lib, only: omp_get_max_threads
      integer, intent(in) :: threads

      team_size = max(1, threads)
      !$ if (threads == 0) team_size = omp_get_max_threads()
   end function team_size

   !> Reject too many threads, too small stacks, and stacks that do not fit in the address space. Both the stack of the
   !> calling thread and the stack size of new threads are checked.
   subroutine check_team(threads, error)
      integer, intent(in) :: threads                  !! as for team_size
      type(error_t), allocatable, intent(out) :: error
      integer(c_int64_t) :: stack, stacks
      logical :: is_limited

      if (threads < 0 .or. threads > max_threads) then
         call fail(error, "threads = "//integer_text(threads)//": must be 0 (all cores) to "//integer_text(max_threads))
         return
      else if (team_size(threads) > max_threads) then
         call fail(error, "OMP_NUM_THREADS = "//integer_text(team_size(threads))//": must be at most " &
                   //integer_text(max_threads))
         return
      end if
      is_limited = spare_arenas() /= 0
      stack = stack_of_this()
      stacks = headroom
      if (team_size(threads) > 1 .and. stack >= min_stack) then
         !$omp parallel default(none) num_threads(2) reduction(min: stack)
         stack = stack_of_this()
         !$omp end parallel
         stacks = headroom + stack*(team_size(threads) - 2) + work_space*team_size(threads)
      end if
      if (stack < min_stack) then
         call fail(error, "the stack of each thread has "//integer_text(stack/kilobyte)//" kB: must be at least " &
                   //integer_text(min_stack/kilobyte)//" kB (ulimit -s, OMP_STACKSIZE)")
      else if (.not. can_map(headroom)) then
         call fail(error, "not enough memory for this case (ulimit -v)")
      else if (.not. can_map(stacks)) then
         call fail(error, "threads = "//integer_text(team_size(threads))//": their stacks of " &
                   //integer_text(stack/kilobyte)//" kB do not fit in memory (ulimit -v): use fewer threads " &
                   //"or a smaller OMP_STACKSIZE")
      else if (is_limited) then  ! start all threads before other allocations use up the memory for their stacks
         !$omp parallel default(none) num_threads(team_size(threads)) reduction(min: stack)
         stack = stack_of_this()
         !$omp end parallel
      end if
   end subroutine check_team

   !> Clock time a number of seconds from now [ticks of system_clock].
   integer(i8) function deadline_in(seconds) result(deadline)
      real(wp), intent(in) :: seconds  !! [s]
      integer(i8) :: now, rate

      call system_clock(now, rate)
      deadline = now + int(min(seconds*rate, 0.4_wp*huge(now)), i8)
   end function deadline_in

   !> Take the next batch of indices, at most `count` and up to n, from a counter shared by all threads. The batch is
   !> empty (`from` exceeds `to`) if no index is left, or if the deadline has passed and an index was taken before.
   subroutine take_batch(next, n, count, deadline, from, to)
      integer, intent(inout) :: next       !! next index
      integer, intent(in) :: n, count
      integer(i8), intent(in) :: deadline  !! [ticks]
      integer, intent(out) :: from, to
      integer(i8) :: now

      call system_clock(now)
      from = 1
      to = 0
      if (now >= deadline) then
         !$omp atomic read
         from = next
         if (from > 1) return
      end if
      !$omp atomic capture
      from = next
      next = next + count
      !$omp end atomic
      to = min(from + count - 1, n)
   end subroutine take_batch

   !> End the idle threads of the calling thread's team; the next run starts new ones. A process forked while idle
   !> threads exist would wait for them forever.
   subroutine release_team()
      !$ use omp_lib, only: omp_pause_resource_all, omp_pause_hard
      integer :: status

      status = 0
      !$ status = omp_pause_resource_all(omp_pause_hard)
   end subroutine release_team

   !> Stack size of the calling thread [bytes]; huge if unknown or unlimited.
   integer(c_int64_t) function stack_of_this() result(bytes)
      bytes = c_stack()
      if (bytes == 0) bytes = huge(bytes)
      bytes = min(bytes, huge(bytes)/max_threads)
   end function stack_of_this

   !> Check whether the process can map `bytes` more bytes; nothing is allocated.
   logical function can_map(bytes)
      integer(c_int64_t), intent(in) :: bytes

      can_map = c_fits(bytes) /= 0
   end function can_map
end module rockfall_threads
