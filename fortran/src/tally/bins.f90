! SPDX-License-Identifier: BSD-3-Clause
!> Classes of positive numbers, four an octave, found from a number's own bits: counts of them merge
!> exactly, and give quantiles. A class is 14 to 25 % of its value wide.
module rockfall_classes
   use rockfall_kinds, only: wp, i4, i8
   implicit none
   private
   public :: n_classes, class_of, class_edge, class_quantile, fewest_for
   public :: energy, speed, jump_height

   integer, parameter :: energy = 1, speed = 2, jump_height = 3  !! quantities [J], [m/s], [m]
   !> Classes reach from 2**first for so many octaves: 64 J to 8.6 GJ, 0.25 to 256 m/s, 0.06 to 512 m.
   integer, parameter :: first(3) = [6, -2, -4], octaves(3) = [27, 10, 13]
   integer, parameter :: per_octave = 4
   !> The first class holds what lies below, the last one what lies above.
   integer, parameter :: n_classes(3) = per_octave*octaves + 2

contains

   !> The class of a number >= 0, from 1.
   pure integer function class_of(quantity, x)
      integer, intent(in) :: quantity
      real(wp), intent(in) :: x
      integer :: piece  !! octaves and quarters of them above 2**first

      class_of = 1
      if (x < class_edge(quantity, 2)) return
      piece = int(shiftr(transfer(x, 0_i8), 50)) - per_octave*(1023 + first(quantity))
      class_of = min(piece + 2, n_classes(quantity))
   end function class_of

   !> The lower edge of a class; of the one past the last: that of the last, which has no end.
   pure real(wp) function class_edge(quantity, class)
      integer, intent(in) :: quantity, class
      integer :: piece

      class_edge = 0
      if (class < 2) return
      piece = min(class, n_classes(quantity)) - 2
      class_edge = scale(1 + mod(piece, per_octave)/real(per_octave, wp), &
                         first(quantity) + piece/per_octave)
   end function class_edge

   !> The quantile p of the counted numbers, of the same rank as that at the lines (type 7 of Hyndman and Fan
   !> 1996, doi:10.1080/00031305.1996.10473566), as if they lay evenly within each class.
   pure real(wp) function class_quantile(quantity, counts, p) result(x)
      integer, intent(in) :: quantity
      integer(i4), intent(in) :: counts(:)  !! of each class; at least one number
      real(wp), intent(in) :: p             !! 0..1
      integer(i8) :: before
      real(wp) :: rank, low
      integer :: k

      rank = 0.5_wp + p*(sum(int(counts, i8)) - 1)
      before = 0
      do k = 1, size(counts) - 1
         if (real(before + counts(k), wp) >= rank .and. counts(k) > 0) exit
         before = before + counts(k)
      end do
      low = class_edge(quantity, k)
      x = low
      if (counts(k) > 0) x = low + (class_edge(quantity, k + 1) - low)*(rank - before)/counts(k)
   end function class_quantile

   !> The fewest numbers whose order statistics enclose the quantile p from both sides with 95 %
   !> confidence: p**n <= 0.025 (and the same of 1 - p).
   pure integer function fewest_for(p)
      real(wp), intent(in) :: p  !! 0 < p < 1
      real(wp) :: chance

      fewest_for = 0
      chance = 1
      do while (chance > 0.025_wp)
         chance = chance*max(p, 1 - p)
         fewest_for = fewest_for + 1
      end do
   end function fewest_for
end module rockfall_classes
