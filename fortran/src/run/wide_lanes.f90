! SPDX-License-Identifier: BSD-3-Clause
! lanes.f90 once more, for processors with AVX2, under another name.
#define rockfall_lanes rockfall_lanes_once_more
#include "lanes.f90"

module rockfall_wide_lanes
   use rockfall_lanes_once_more, only: run_in_wide_lanes => run_in_lanes
   implicit none
   private
   public :: run_in_wide_lanes
end module rockfall_wide_lanes
