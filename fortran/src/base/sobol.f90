! SPDX-License-Identifier: BSD-3-Clause
!> Scrambled Sobol' points: random words that fill their range more evenly than independent ones, each
!> a pure function of (seed, source, dimension, index).
module rockfall_sobol
   use rockfall_kinds, only: i8
   use rockfall_random, only: random_key_t, philox4x32, for_scramble, purpose_bit, words_per_block
   implicit none
   private
   public :: sobol_t, sobol_sequence, sobol_word, scrambled, max_points
   public :: volume_dimension, obstacle_dimension, max_dimensions

   integer, parameter :: bits = 32                     !! per word
   integer, parameter :: volume_dimension = 1          !! volume of a boulder; the words of its first rebound follow,
   integer, parameter :: obstacle_dimension = volume_dimension + words_per_block + 1  !! then those of the ground there
   integer, parameter :: max_dimensions = obstacle_dimension
   integer(i8), parameter :: max_points = 2_i8**bits
   integer, parameter :: levels = 7, trees = 5         !! a tree of seven levels has 127 nodes: one block of Philox

   !> Sobol' sequence; `dimensions` = 0 disables it.
   type :: sobol_t
      integer :: dimensions = 0
      integer(i8) :: direction(bits, max_dimensions) = 0  !! direction numbers
   end type sobol_t

contains

   !> Sobol' sequence of Joe and Kuo (2008, doi:10.1137/070709359), with the direction numbers new-joe-kuo-6.
   pure type(sobol_t) function sobol_sequence(dimensions) result(sobol)
      integer, intent(in) :: dimensions  !! 0 .. max_dimensions
      integer, parameter :: degree(2:max_dimensions) = [1, 2, 3, 3, 4]
      integer, parameter :: polynomial(2:max_dimensions) = [0, 1, 1, 2, 1]
      integer, parameter :: first(4, 2:max_dimensions) = reshape([ &
         1, 0, 0, 0, 1, 3, 0, 0, 1, 3, 1, 0, 1, 1, 1, 0, 1, 1, 3, 3], [4, max_dimensions - 1])
      integer :: d, j, k

      sobol%dimensions = dimensions
      sobol%direction(:, 1) = [(2_i8**(bits - k), k=1, bits)]
      do d = 2, max_dimensions
         associate (v => sobol%direction(:, d), s => degree(d))
            v(:s) = [(shiftl(int(first(k, d), i8), bits - k), k=1, s)]
            do k = s + 1, bits
               v(k) = ieor(v(k - s), shiftr(v(k - s), s))
               do j = 1, s - 1
                  if (btest(polynomial(d), s - 1 - j)) v(k) = ieor(v(k), v(k - j))
               end do
            end do
         end associate
      end do
   end function sobol_sequence

   !> Unscrambled point `index` (0, 1, ...) in one dimension, in Gray-code order (Antonov and Saleev 1979), as other
   !> programs list it.
   pure integer(i8) function sobol_word(sobol, index, dimension) result(word)
      type(sobol_t), intent(in) :: sobol
      integer(i8), intent(in) :: index   !! below max_points
      integer, intent(in) :: dimension
      integer(i8) :: left
      integer :: k

      word = 0
      left = ieor(index, shiftr(index, 1))
      do while (left /= 0)
         k = trailz(left)
         word = ieor(word, sobol%direction(k + 1, dimension))
         left = ibclr(left, k)
      end do
   end function sobol_word

   !> Nested uniform scrambling (Owen 1995, doi:10.1007/978-1-4612-2552-2_19): each bit is flipped by a random bit
   !> that depends on all higher bits. The words become uniform and the points stay evenly spread. The random bits come
   !> from Philox: one block per tree of seven levels below the given bits.
   pure integer(i8) function scrambled(word, key, source, dimension)
      integer(i8), intent(in) :: word    !! 0..2**32-1
      type(random_key_t), intent(in) :: key
      integer(i8), intent(in) :: source  !! each source has its own scramble
      integer, intent(in) :: dimension
      integer(i8) :: flip(4), path, turned
      integer :: low, leaf, node, k

      path = shiftl(word, trees*levels - bits)
      turned = 0
      do low = (trees - 1)*levels, 0, -levels  ! lowest bit of each tree
         flip = philox4x32([shiftr(path, low + levels), ibits(source, 0, bits), shiftr(source, bits), &
                            ior(shiftl(for_scramble, purpose_bit), int(64*dimension + low, i8))], key)  ! low < 64
         leaf = int(ibits(path, low, levels)) + 2**levels
         do k = 1, levels
            node = shiftr(leaf, k)
            turned = ior(turned, shiftl(ibits(flip(1 + node/bits), mod(node, bits), 1), low + k - 1))
         end do
      end do
      scrambled = ieor(word, shiftr(turned, trees*levels - bits))
   end function scrambled
end module rockfall_sobol
