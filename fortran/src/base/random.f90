! SPDX-License-Identifier: BSD-3-Clause
!> Counter-based random numbers: a pure function of (seed, purpose; boulder, impact, draw), so that results for a
!> boulder do not depend on other boulders, threads, shards or restarts.
module rockfall_random
   use rockfall_kinds, only: wp, i8
   use rockfall_math, only: logarithm, real_of, fraction_bits, exponent_bias, bits_of_one
   implicit none
   private
   public :: random_key_t, random_key, philox4x32, last_counter, random_words, uniform, side_of
   public :: normal_table_t, normal_table, normal, normal_quantile
   public :: for_release, for_impact, for_ground, for_forest, for_tree, for_breakage, for_strength, purpose_bit
   public :: fragment_number, boulder_number
   public :: words_per_block
   public :: volume_word, shape_word, deviate_word, column_word, row_word, rebound_words, turn_word, obstacle_word
   public :: ratio_word, roughness_word
   public :: normal_restitution_word, tangential_restitution_word, obstacle_spread_word
   public :: tree_class_word, tree_within_word, cone_word, around_word

   !> Purposes of random numbers, each with its own stream. Number 3 is retired; from 65, they belong to the laboratory.
   integer(i8), parameter :: for_release = 1, for_impact = 2
   integer(i8), parameter :: for_ground = 5   !! properties of the ground at an impact
   integer(i8), parameter :: for_forest = 11  !! counter: cell and stem; stem 0 gives the number of stems
   integer(i8), parameter :: for_tree = 12    !! counter: boulder, and index of this tree among those it hit
   integer(i8), parameter :: for_breakage = 13  !! counter: fragment
   integer(i8), parameter :: for_strength = 14  !! counter: boulder; a fragment has the strength of its boulder
   integer, parameter :: purpose_bit = 24  !! position of the purpose in the counter's last word, above the block number

   !> Index of the word used for each quantity within a draw. Changing them changes results.
   integer, parameter :: volume_word = 1        !! for_release: volume
   integer, parameter :: shape_word = 2         !! for_release: shape of the block, if there are several
   integer, parameter :: deviate_word = 1       !! for_strength: standard normal deviate of the ground strength
   integer, parameter :: column_word = 2, row_word = 3  !! for_strength: choices between parts of an impact table
   integer, parameter :: rebound_words = 3      !! for_impact: words 1 to 3 are the normal deviates of V_t, V_n, W
   integer, parameter :: normal_restitution_word = 1      !! for_impact, classical rebound: R_n
   integer, parameter :: tangential_restitution_word = 2  !! for_impact, classical rebound: R_t
   integer, parameter :: obstacle_spread_word = 3         !! for_impact, classical rebound: obstacle height scatter
   integer, parameter :: turn_word = 4          !! for_impact: quantile of the turn; its last bit selects the side
   integer, parameter :: obstacle_word = 1      !! for_ground: obstacle size of method A
   integer, parameter :: ratio_word = 2         !! for_ground: choice between two impact sets
   integer, parameter :: roughness_word = 3     !! for_ground: tilt of the ground in a classical rebound
   integer, parameter :: tree_class_word = 1    !! for_tree: class of the turn
   integer, parameter :: tree_within_word = 2   !! for_tree: position within the class; its last bit selects the side
   integer, parameter :: cone_word = 1          !! for_breakage: angle to the velocity of the boulder
   integer, parameter :: around_word = 2        !! direction around that velocity (for_breakage)

   integer, parameter :: words_per_block = 4
   integer, parameter :: rounds = 10  !! recommended for Philox; 7 rounds are the minimum that passes all tests
   integer(i8), parameter :: low32 = int(z"FFFFFFFF", i8)

   !> Round keys of Philox, constant during a run.
   type :: random_key_t
      integer(i8) :: round(2, rounds) = 0
   end type random_key_t

   !> Standard normal quantile as piecewise quintics, one per eighth of each binary octave of the tail
   !> probability. Absolute error below 1e-10, tails to 6.3 standard deviations (2**-33).
   type :: normal_table_t
      real(wp) :: c(6, 0:32*8 - 1)  !! ascending powers of (t - middle), t the scaled tail probability, 1..2
   end type normal_table_t

   !> The first three fraction bits select the eighth of the octave, the remaining bits the position within it.
   integer, parameter :: within_bits = fraction_bits - 3
   integer(i8), parameter :: within_mask = 2_i8**within_bits - 1
   integer, parameter :: first_piece = exponent_bias*8  !! exponent of 1.0 and three fraction bits
   real(wp), parameter :: middle = 1 + 1/16.0_wp  !! midpoint of an eighth scaled to 1 .. 1.125

contains

   pure type(random_key_t) function random_key(seed) result(key)
      integer(i8), intent(in) :: seed
      integer(i8), parameter :: step(2) = [int(z"9E3779B9", i8), int(z"BB67AE85", i8)]
      integer :: k

      key%round(:, 1) = [iand(seed, low32), shiftr(seed, 32)]
      do k = 2, rounds
         key%round(:, k) = iand(key%round(:, k - 1) + step, low32)
      end do
   end function random_key

   !> Philox4x32-10 (Salmon et al. 2011, doi:10.1145/2063384.2063405): four random words from a counter
   !> and a key. Words are 32 bits, kept in int64.
   pure function philox4x32(counter, key) result(x)
      integer(i8), intent(in) :: counter(words_per_block)
      type(random_key_t), intent(in) :: key
      integer(i8) :: x(words_per_block)

      x = counter
      call philox(key, x(1), x(2), x(3), x(4))
   end function philox4x32

   !> Philox4x32-10 on four scalars: the counter on entry, the words on return.
   elemental subroutine philox(key, c0, c1, c2, c3)
      type(random_key_t), intent(in) :: key
      integer(i8), intent(inout) :: c0, c1, c2, c3
      ! M*c overflows int64; (M - 2**32)*c does not, has the same low word, and a high word that is lower by c.
      integer(i8), parameter :: m0 = int(z"D2511F53", i8) - low32 - 1, m1 = int(z"CD9E8D57", i8) - low32 - 1
      integer(i8) :: p0, p1
      integer :: k

      !GCC$ unroll 10
      do k = 1, rounds
         p0 = m0*c0
         p1 = m1*c2
         c1 = ieor(ieor(iand(shiftr(p1, 32) + c2, low32), c1), key%round(1, k))
         c3 = ieor(ieor(iand(shiftr(p0, 32) + c0, low32), c3), key%round(2, k))
         c0 = c1
         c2 = c3
         c1 = iand(p1, low32)
         c3 = iand(p0, low32)
      end do
   end subroutine philox

   !> Random words of draw `draw` (0, 1, ...) for an impact of a boulder (impact 0: its release).
   pure function random_words(key, purpose, boulder, impact, draw) result(x)
      type(random_key_t), intent(in) :: key
      integer(i8), intent(in) :: purpose, boulder, impact, draw
      integer(i8) :: x(words_per_block)

      call set_counter(purpose, boulder, impact, draw, x(1), x(2), x(3), x(4))
      x = philox4x32(x, key)
   end function random_words

   !> Set the counter that `philox` turns into the random words of a draw.
   elemental subroutine set_counter(purpose, boulder, impact, draw, c0, c1, c2, c3)
      integer(i8), intent(in) :: purpose, boulder, impact, draw  !! as for random_words
      integer(i8), intent(out) :: c0, c1, c2, c3

      c0 = iand(boulder, low32)
      c1 = shiftr(boulder, 32)
      c2 = iand(impact, low32)
      c3 = last_counter(purpose, draw)
   end subroutine set_counter

   !> Last word of the counter: purpose, and number of the draw.
   elemental integer(i8) function last_counter(purpose, draw)
      integer(i8), intent(in) :: purpose, draw  !! as for random_words

      last_counter = ior(shiftl(purpose, purpose_bit), draw)
   end function last_counter

   !> Number of a fragment in the numbering of boulders, so that it has random numbers of its own. Boulders have numbers
   !> below 2**32, and fragment 0 is the boulder itself.
   elemental integer(i8) function fragment_number(boulder, fragment)
      integer(i8), intent(in) :: boulder, fragment

      fragment_number = ior(boulder, shiftl(fragment, 32))
   end function fragment_number

   !> Number of the boulder to which a fragment belongs.
   elemental integer(i8) function boulder_number(number)
      integer(i8), intent(in) :: number

      boulder_number = iand(number, low32)
   end function boulder_number

   !> Random side, 1 or -1, from the last bit of a word.
   elemental real(wp) function side_of(word)
      integer(i8), intent(in) :: word  !! 0..2**32-1

      side_of = 2*real_of(iand(word, 1_i8)) - 1
   end function side_of

   !> Uniform number in (0, 1) from a word: the centre of its interval of 2**-32, so neither end occurs.
   elemental real(wp) function uniform(word)
      integer(i8), intent(in) :: word  !! 0..2**32-1

      uniform = (real_of(word) + 0.5_wp)*2.0_wp**(-32)
   end function uniform

   !> Standard normal number [-] from a word by inversion: one word, no rejection, no branch, monotone.
   elemental real(wp) function normal(table, word)
      type(normal_table_t), intent(in) :: table
      integer(i8), intent(in) :: word  !! 0..2**32-1
      integer(i8) :: bits, piece
      real(wp) :: side, x

      side = 2*real_of(word) + (1 - 2.0_wp**32)
      bits = transfer(2.0_wp**32 - abs(side), bits)  ! tail probability * 2**33, 1 .. 2**32 - 1
      piece = shiftr(bits, within_bits) - first_piece
      x = transfer(ior(iand(bits, within_mask), bits_of_one), x) - middle
      associate (c => table%c)
         normal = c(1, piece) + x*(c(2, piece) + x*(c(3, piece) + x*(c(4, piece) + x*(c(5, piece) + x*c(6, piece)))))
      end associate
      normal = sign(normal, side)
   end function normal

   !> Build the table for `normal` by interpolating the quantile at six Chebyshev points of each piece.
   pure function normal_table() result(table)
      type(normal_table_t) :: table
      ! nodes cos((2k+1) pi/12)/16, k = 0..5, from square roots
      real(wp), parameter :: far = 0.060370364143066768_wp, mid = 0.044194173824159216_wp, &
                             near = 0.016176190318907546_wp
      real(wp), parameter :: node(0:5) = [-far, -mid, -near, near, mid, far]
      real(wp) :: f(0:5), tail
      integer :: piece, k, j

      do piece = 0, size(table%c, 2) - 1
         do k = 0, 5
            tail = scale(1 + (mod(piece, 8) + 0.5_wp)/8 + node(k), piece/8 - 33)
            f(k) = -normal_quantile(tail)
         end do
         do j = 1, 5  ! divided differences
            do k = 5, j, -1
               f(k) = (f(k) - f(k - 1))/(node(k) - node(k - j))
            end do
         end do
         table%c(:, piece) = powers(f, node)
      end do
   end function normal_table

   !> Convert the Newton form with differences f at the nodes to coefficients of powers of x.
   pure function powers(f, node) result(c)
      real(wp), intent(in) :: f(0:5), node(0:5)  !! [-]
      real(wp) :: c(0:5)
      integer :: k

      c = 0
      c(0) = f(5)
      do k = 4, 0, -1
         c(1:5) = c(0:4) - node(k)*c(1:5)
         c(0) = f(k) - node(k)*c(0)
      end do
   end function powers

   !> Quantile of the standard normal distribution for 1.4e-11 < p <= 1/2
   !> (Wichura 1988, Algorithm AS 241, PPND16, doi:10.2307/2347330).
   elemental real(wp) function normal_quantile(p)
      real(wp), intent(in) :: p  !! probability [-]
      real(wp), parameter :: a(0:7) = [3.3871328727963666080_wp, 1.3314166789178437745e2_wp, &
         1.9715909503065514427e3_wp, 1.3731693765509461125e4_wp, 4.5921953931549871457e4_wp, &
         6.7265770927008700853e4_wp, 3.3430575583588128105e4_wp, 2.5090809287301226727e3_wp]
      real(wp), parameter :: b(0:7) = [1.0_wp, 4.2313330701600911252e1_wp, &
         6.8718700749205790830e2_wp, 5.3941960214247511077e3_wp, 2.1213794301586595867e4_wp, &
         3.9307895800092710610e4_wp, 2.8729085735721942674e4_wp, 5.2264952788528545610e3_wp]
      real(wp), parameter :: c(0:7) = [1.42343711074968357734_wp, 4.63033784615654529590_wp, &
         5.76949722146069140550_wp, 3.64784832476320460504_wp, 1.27045825245236838258_wp, &
         2.41780725177450611770e-1_wp, 2.27238449892691845833e-2_wp, 7.74545014278341407640e-4_wp]
      real(wp), parameter :: d(0:7) = [1.0_wp, 2.05319162663775882187_wp, &
         1.67638483018380384940_wp, 6.89767334985100004550e-1_wp, 1.48103976427480074590e-1_wp, &
         1.51986665636164571966e-2_wp, 5.47593808499534494600e-4_wp, 1.05075007164441684324e-9_wp]
      real(wp) :: q, r

      q = p - 0.5_wp
      if (abs(q) <= 0.425_wp) then
         r = 0.180625_wp - q*q
         normal_quantile = q*polynomial(a, r)/polynomial(b, r)
      else
         r = sqrt(-logarithm(p)) - 1.6_wp
         normal_quantile = -polynomial(c, r)/polynomial(d, r)
      end if
   end function normal_quantile

   !> Evaluate a polynomial by Horner's rule.
   pure real(wp) function polynomial(c, x)
      real(wp), intent(in) :: c(0:7), x  !! ascending powers [-]
      integer :: k

      polynomial = c(7)
      do k = 6, 0, -1
         polynomial = polynomial*x + c(k)
      end do
   end function polynomial
end module rockfall_random
