! SPDX-License-Identifier: BSD-3-Clause
!> How many threads a run uses, and whether the process has room for them: a thread that overruns its
!> stack, or cannot be made, ends the process.
module rockfall_threads
   use, intrinsic :: iso_c_binding, only: c_int, c_intptr_t, c_long, c_null_ptr, c_ptr, c_size_t
   use rockfall_error, only: error_t, fail
   use rockfall_text, only: integer_text
   implicit none
   private
   public :: team_size, check_team, release_team, max_threads

   integer, parameter :: max_threads = 1024  !! far beyond the cores of a machine: more is a mistake
   integer(c_size_t), parameter :: kilobyte = 1024
   integer(c_size_t), parameter :: min_stack = 500*kilobyte  !! [bytes] "ulimit -s 512" is enough
   integer(c_int), parameter :: private_anonymous_unreserved = int(z'4022', c_int)  !! MAP_... of Linux

   interface
      integer(c_long) function c_self() bind(c, name="pthread_self")
         import :: c_long
      end function c_self
      integer(c_int) function c_attributes(thread, attributes) bind(c, name="pthread_getattr_np")
         import :: c_int, c_long
         integer(c_long), value :: thread
         integer(c_long), intent(out) :: attributes(*)
      end function c_attributes
      integer(c_int) function c_stack_size(attributes, bytes) bind(c, name="pthread_attr_getstacksize")
         import :: c_int, c_long, c_size_t
         integer(c_long), intent(in) :: attributes(*)
         integer(c_size_t), intent(out) :: bytes
      end function c_stack_size
      integer(c_int) function c_forget(attributes) bind(c, name="pthread_attr_destroy")
         import :: c_int, c_long
         integer(c_long), intent(inout) :: attributes(*)
      end function c_forget
      integer(c_intptr_t) function c_map(at, bytes, access, flags, file, offset) bind(c, name="mmap")
         import :: c_int, c_intptr_t, c_long, c_ptr, c_size_t
         type(c_ptr), value :: at
         integer(c_size_t), value :: bytes
         integer(c_int), value :: access, flags, file
         integer(c_long), value :: offset
      end function c_map
      integer(c_int) function c_unmap(at, bytes) bind(c, name="munmap")
         import :: c_int, c_intptr_t, c_size_t
         integer(c_intptr_t), value :: at
         integer(c_size_t), value :: bytes
      end function c_unmap
   end interface

contains

   !> Threads for a run that requests so many; 0 requests all that OpenMP offers (OMP_NUM_THREADS, the
   !> cores of the process).
   integer function team_size(threads)
      !$ use omp_lib, only: omp_get_max_threads
      integer, intent(in) :: threads

      team_size = max(1, threads)
      !$ if (threads == 0) team_size = omp_get_max_threads()
   end function team_size

   !> Refuse more threads than there may be, stacks that are too small, and more stacks than fit into the
   !> address space. The stack is that of the calling thread and of a thread beside it.
   subroutine check_team(threads, error)
      integer, intent(in) :: threads                  !! as for team_size
      type(error_t), allocatable, intent(out) :: error
      integer(c_size_t) :: stack, stacks

      if (threads < 0 .or. threads > max_threads) then
         call fail(error, "threads = "//integer_text(threads)//": must be 0 (all cores) to "//integer_text(max_threads))
         return
      else if (team_size(threads) > max_threads) then
         call fail(error, "OMP_NUM_THREADS = "//integer_text(team_size(threads))//": must be at most " &
                   //integer_text(max_threads))
         return
      end if
      stack = stack_of_this()
      stacks = 0
      if (team_size(threads) > 1 .and. stack >= min_stack) then
         !$omp parallel default(none) num_threads(2) reduction(min: stack)
         stack = stack_of_this()
         !$omp end parallel
         stacks = stack*(team_size(threads) - 2)
      end if
      if (stack < min_stack) then
         call fail(error, "a thread has a stack of "//integer_text(stack/kilobyte)//" kB: must be at least " &
                   //integer_text(min_stack/kilobyte)//" kB (ulimit -s, OMP_STACKSIZE)")
      else if (.not. fits(stacks)) then
         call fail(error, "threads = "//integer_text(team_size(threads))//": their stacks of " &
                   //integer_text(stack/kilobyte)//" kB do not fit into the memory (ulimit -v); fewer do, " &
                   //"or a smaller OMP_STACKSIZE")
      end if
   end subroutine check_team

   !> End the threads that wait for the next run of the calling thread; that run starts others. A process that
   !> is forked while they wait waits for them for ever.
   subroutine release_team()
      !$ use omp_lib, only: omp_pause_resource_all, omp_pause_hard
      integer :: status

      status = 0
      !$ status = omp_pause_resource_all(omp_pause_hard)
   end subroutine release_team

   !> Bytes of the stack of the calling thread; very many where it is not known, or without limit.
   integer(c_size_t) function stack_of_this() result(bytes)
      integer(c_long) :: attributes(64)  ! no pthread_attr_t is as large

      bytes = huge(bytes)/max_threads
      if (c_attributes(c_self(), attributes) /= 0) return
      if (c_stack_size(attributes, bytes) /= 0 .or. bytes < 0) bytes = huge(bytes)
      bytes = min(bytes, huge(bytes)/max_threads)
      if (c_forget(attributes) /= 0) return
   end function stack_of_this

   !> Whether the process may have so many bytes more; they are not taken.
   logical function fits(bytes)
      integer(c_size_t), intent(in) :: bytes
      integer(c_intptr_t) :: at

      fits = bytes == 0
      if (fits) return
      at = c_map(c_null_ptr, bytes, 0_c_int, private_anonymous_unreserved, -1_c_int, 0_c_long)
      fits = at /= -1
      if (fits) fits = c_unmap(at, bytes) == 0
   end function fits
end module rockfall_threads
