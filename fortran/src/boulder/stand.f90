! SPDX-License-Identifier: BSD-3-Clause
!> Stand of trees with a known number of stems per hectare: number and positions of the stems in a cell. A
!> pure function of the seed and the cell, so that neither the order of cells nor other input changes a tree.
module rockfall_stand
   use rockfall_kinds, only: wp, i8
   use rockfall_math, only: exponential
   use rockfall_random, only: random_key_t, random_words, uniform, for_forest, words_per_block
   implicit none
   private
   public :: stems_in_cell, stem_numbers, thinning_numbers

   real(wp), parameter :: max_mean = 16.0_wp  !! maximum mean of a Poisson number drawn from one uniform number

contains

   !> Number of stems in a cell with a given expected number: Poisson distributed, so that the forest does not depend on
   !> the cell size. If `even`, it is the integer part, plus one with the probability of the fractional part.
   pure integer function stems_in_cell(key, cell, expected, even) result(stems)
      type(random_key_t), intent(in) :: key
      integer(i8), intent(in) :: cell       !! index in the raster
      real(wp), intent(in) :: expected      !! [-]
      logical, intent(in) :: even
      integer :: k, parts

      stems = 0
      if (even) then
         stems = int(expected + uniform(count_word(key, cell, 1)))
         return
      end if
      parts = ceiling(expected/max_mean)  ! split the mean: a sum of Poisson numbers is Poisson distributed
      do k = 1, parts
         stems = stems + poisson(expected/parts, uniform(count_word(key, cell, k)))
      end do
   end function stems_in_cell

   !> Random word k = 1, 2, ... for the number of stems of a cell.
   pure integer(i8) function count_word(key, cell, k)
      type(random_key_t), intent(in) :: key
      integer(i8), intent(in) :: cell
      integer, intent(in) :: k
      integer(i8) :: word(words_per_block)

      word = random_words(key, for_forest, cell, 0_i8, int((k - 1)/words_per_block, i8))
      count_word = word(mod(k - 1, words_per_block) + 1)
   end function count_word

   !> Draw a Poisson number by inversion of its distribution.
   pure integer function poisson(mean, u) result(n)
      real(wp), intent(in) :: mean  !! 0..max_mean [-]
      real(wp), intent(in) :: u     !! uniform in (0, 1) [-]
      real(wp) :: p, total

      n = 0
      p = exponential(-mean)
      total = p
      do while (u > total .and. p > 0)
         n = n + 1
         p = p*mean/n
         total = total + p
      end do
   end function poisson

   !> Four uniform numbers in (0, 1) for stem 1, 2, ... of a cell: for its eastward and northward position, its
   !> diameter, and its species.
   pure function stem_numbers(key, cell, stem) result(u)
      type(random_key_t), intent(in) :: key
      integer(i8), intent(in) :: cell
      integer, intent(in) :: stem
      real(wp) :: u(words_per_block)

      u = uniform(random_words(key, for_forest, cell, int(stem, i8), 0_i8))
   end function stem_numbers

   !> Two further uniform numbers in (0, 1) for a stem, independent of those from `stem_numbers`. The first decides
   !> whether the stem belongs to a stand less dense than the densest in its cell, the second whether it remains after
   !> thinning.
   pure function thinning_numbers(key, cell, stem) result(u)
      type(random_key_t), intent(in) :: key
      integer(i8), intent(in) :: cell
      integer, intent(in) :: stem
      real(wp) :: u(2)
      integer(i8) :: word(words_per_block)

      word = random_words(key, for_forest, cell, int(stem, i8), 1_i8)
      u = uniform(word(1:2))
   end function thinning_numbers
end module rockfall_stand
