! SPDX-License-Identifier: BSD-3-Clause
!> How many threads a run uses.
module rockfall_threads
   implicit none
   private
   public :: team_size

contains

   !> Threads for a run that asks for so many; 0 asks for all that OpenMP offers (OMP_NUM_THREADS, the
   !> cores of the process).
   integer function team_size(threads)
      !$ use omp_lib, only: omp_get_max_threads
      integer, intent(in) :: threads

      team_size = max(1, threads)
      !$ if (threads == 0) team_size = omp_get_max_threads()
   end function team_size
end module rockfall_threads
