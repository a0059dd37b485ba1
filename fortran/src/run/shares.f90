! SPDX-License-Identifier: BSD-3-Clause
!> Distribution of boulders: to sources, in proportion to area or weight, and to equal ranges.
module rockfall_shares
   use rockfall_kinds, only: wp, i8
   implicit none
   private
   public :: last_boulders, last_boulders_by_weight, proportional_part

contains

   !> Last boulder of each source for n boulders per unit of `ratio`: cumulative sums of n*ratio,
   !> rounded down. Rounding the sums keeps the totals correct even with n = 1.
   pure function last_boulders(ratio, n) result(last)
      real(wp), intent(in) :: ratio(:)  !! surface over plan area [-]
      integer(i8), intent(in) :: n
      integer(i8) :: last(size(ratio))
      real(wp) :: total
      integer :: k

      total = 0
      do k = 1, size(ratio)
         total = total + ratio(k)
         last(k) = int(min(n*total, 0.5_wp*huge(1_i8)), i8)  ! excessive numbers are rejected later: no wraparound
      end do
   end function last_boulders

   !> Last boulder of each source for n boulders distributed in proportion to weights: n*w rounded down, where w is the
   !> cumulative fraction of the weights.
   pure function last_boulders_by_weight(weight, n) result(last)
      real(wp), intent(in) :: weight(:)  !! > 0
      integer(i8), intent(in) :: n
      integer(i8) :: last(size(weight))
      real(wp) :: total, part
      integer :: k

      total = 0
      do k = 1, size(weight)
         total = total + weight(k)
      end do
      part = 0
      do k = 1, size(weight)
         part = part + weight(k)
         last(k) = int(n*(part/total), i8)
      end do
   end function last_boulders_by_weight

   !> Number of boulders in the first `part` of `parts` equal ranges, n*part/parts without overflow.
   pure integer(i8) function proportional_part(n, part, parts)
      integer(i8), intent(in) :: n, part, parts

      proportional_part = n/parts*part + mod(n, parts)*part/parts
   end function proportional_part
end module rockfall_shares
