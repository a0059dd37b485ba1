! SPDX-License-Identifier: BSD-3-Clause
!> Random numbers: published words of Philox, exact normal quantile, moments, separate streams.
program test_random
   use rockfall_kinds, only: wp, i8
   use rockfall_random, only: random_key_t, random_key, philox4x32, random_words, uniform, side_of, &
      normal_table_t, normal_table, normal, normal_quantile, for_release, for_impact
   use check_m, only: check, check_close, finish
   implicit none

   integer(i8), parameter :: low32 = 2_i8**32 - 1
   type(normal_table_t) :: table

   table = normal_table()
   call test_known_answers()
   call test_words()
   call test_streams()
   call test_uniform()
   call test_quantile()
   call test_normal_is_exact()
   call test_normal_is_monotone()
   call test_moments()
   call finish()

contains

   !> Test vectors of Random123 (tests/kat_vectors) for philox4x32 with 10 rounds.
   subroutine test_known_answers()
      integer(i8), parameter :: zero(4) = 0, ones(4) = low32
      integer(i8), parameter :: pi_words(4) = [int(z"243F6A88", i8), int(z"85A308D3", i8), &
                                               int(z"13198A2E", i8), int(z"03707344", i8)]
      integer(i8), parameter :: pi_seed = ior(shiftl(int(z"299F31D0", i8), 32), &
                                              int(z"A4093822", i8))

      call check("Philox of zeros", all(philox4x32(zero, random_key(0_i8)) == &
         [int(z"6627E8D5", i8), int(z"E169C58D", i8), int(z"BC57AC4C", i8), int(z"9B00DBD8", i8)]))
      call check("Philox of ones", all(philox4x32(ones, random_key(-1_i8)) == &
         [int(z"408F276D", i8), int(z"41C83B0E", i8), int(z"A20BC7C6", i8), int(z"6D5451FD", i8)]))
      call check("Philox of pi", all(philox4x32(pi_words, random_key(pi_seed)) == &
         [int(z"D16CFE09", i8), int(z"94FDCCEB", i8), int(z"5001E420", i8), int(z"24126EA1", i8)]))
   end subroutine test_known_answers

   !> The words of a draw are a Philox block with a counter that no other draw uses.
   subroutine test_words()
      type(random_key_t) :: key
      integer(i8) :: word(4)

      key = random_key(20090601_i8)
      word = random_words(key, for_impact, 2_i8**33 + 7, 5_i8, 4_i8)
      call check("words come from the counter of boulder, impact, purpose and draw", &
                 all(word == philox4x32([7_i8, 2_i8, 5_i8, for_impact*2_i8**24 + 4], key)))
      call check("the last bit is the side", all(abs(side_of([6_i8, 7_i8, 0_i8, 2_i8**32 - 1]) &
                                                     - [-1, 1, -1, 1]) <= 0))
      call check("words are 32 bits", all(word >= 0 .and. word <= low32))
   end subroutine test_words

   !> A different seed, purpose, boulder, impact or draw gives different words; none occurs twice.
   subroutine test_streams()
      integer, parameter :: n = 10
      integer(i8) :: word(4, n)
      integer :: k, l

      word(:, 1) = random_words(random_key(1_i8), for_impact, 1_i8, 1_i8, 0_i8)
      word(:, 2) = random_words(random_key(2_i8), for_impact, 1_i8, 1_i8, 0_i8)
      word(:, 3) = random_words(random_key(1_i8 + 2_i8**32), for_impact, 1_i8, 1_i8, 0_i8)
      word(:, 4) = random_words(random_key(1_i8), for_release, 1_i8, 1_i8, 0_i8)
      word(:, 5) = random_words(random_key(1_i8), for_impact, 2_i8, 1_i8, 0_i8)
      word(:, 6) = random_words(random_key(1_i8), for_impact, 1_i8 + 2_i8**32, 1_i8, 0_i8)
      word(:, 7) = random_words(random_key(1_i8), for_impact, 1_i8, 2_i8, 0_i8)
      word(:, 8) = random_words(random_key(1_i8), for_impact, 1_i8, 1_i8, 1_i8)
      word(:, 9) = random_words(random_key(1_i8), for_impact, 1_i8, 1_i8, 31_i8)
      word(:, 10) = random_words(random_key(1_i8), for_release, 1_i8, 0_i8, 0_i8)
      do k = 1, n
         do l = 1, k - 1
            call check("separate streams differ", &
                       .not. any(spread(word(:, k), 1, 4) == spread(word(:, l), 2, 4)))
         end do
      end do
   end subroutine test_streams

   subroutine test_uniform()
      call check_close("the smallest uniform", uniform(0_i8), 2.0_wp**(-33), 0.0_wp)
      call check_close("the largest uniform", uniform(low32), 1 - 2.0_wp**(-33), 0.0_wp)
      call check("uniforms lie between 0 and 1", uniform(0_i8) > 0 .and. uniform(low32) < 1)
   end subroutine test_uniform

   !> Algorithm AS 241 has a relative error of 1e-16, tested with the compiler's erfc.
   subroutine test_quantile()
      real(wp) :: p, worst
      integer :: k

      worst = 0
      do k = 0, 3500
         p = 0.5_wp*10.0_wp**(-k/350.0_wp)
         worst = max(worst, abs(quantile_error(normal_quantile(p), p)/min(-1.0e-3_wp, &
            normal_quantile(p))))
      end do
      call check("the quantile to 1e-14", worst < 1.0e-14_wp)
      call check_close("the median", normal_quantile(0.5_wp), 0.0_wp, 1.0e-16_wp)
   end subroutine test_quantile

   !> Difference of x from the quantile of p <= 1/2, by a Newton step on erfc.
   real(wp) function quantile_error(x, p)
      real(wp), intent(in) :: x, p
      real(wp), parameter :: root_2 = 1.41421356237309505_wp, root_2pi = 2.50662827463100050_wp

      quantile_error = (0.5_wp*erfc(-x/root_2) - p)*root_2pi*exp(0.5_wp*x*x)
   end function quantile_error

   !> The error of the table is below 1e-10, and both tails are equal.
   subroutine test_normal_is_exact()
      real(wp) :: x, worst
      integer(i8) :: word
      logical :: symmetric
      integer :: k

      worst = 0
      symmetric = .true.
      do k = 0, 400000
         word = 5368_i8*k
         if (k < 1000) word = k
         if (k > 399000) word = 2_i8**31 - 1 - (400000 - k)
         x = normal(table, word)
         worst = max(worst, abs(quantile_error(x, uniform(word))))
         symmetric = symmetric .and. abs(normal(table, low32 - word) + x) <= 0
      end do
      call check("normal numbers are the quantile to 1e-10", worst < 1.0e-10_wp)
      call check("the tails are alike", symmetric)
   end subroutine test_normal_is_exact

   !> A larger word never gives a smaller number: at the edges of all pieces of the table, and at random.
   subroutine test_normal_is_monotone()
      integer(i8) :: word
      integer :: octave, eighth, step
      logical :: rising

      rising = normal(table, 2_i8**31) > normal(table, 2_i8**31 - 1)
      do octave = 4, 31
         do eighth = 0, 7
            do step = -2, 1
               word = 2_i8**(octave - 4)*(8 + eighth) + step
               if (word < 0 .or. word + 1 > low32) cycle
               rising = rising .and. normal(table, word + 1) > normal(table, word)
            end do
         end do
      end do
      do word = 0, low32 - 1, 40009
         rising = rising .and. normal(table, word + 1) > normal(table, word)
      end do
      call check("normal numbers rise with their words", rising)
   end subroutine test_normal_is_monotone

   !> Mean, variance, third and fourth moments of three words, and correlations of neighbours, are within 4 standard
   !> errors for 10**6 numbers.
   subroutine test_moments()
      integer, parameter :: boulders = 333333, n = 3*boulders
      type(random_key_t) :: key
      real(wp) :: z(3), before(3), moment(4), shared(3), error
      integer :: k

      key = random_key(42_i8)
      moment = 0
      shared = 0
      before = 0
      do k = 1, boulders
         z = normal(table, first_three(random_words(key, for_impact, int(k, i8), 1_i8, 0_i8)))
         moment = moment + [sum(z), sum(z**2), sum(z**3), sum(z**4)]
         shared = shared + [sum(z*before), sum(z(:2)*z(2:)), sum(z(:2)**2*z(2:)**2 - 1)]
         before = z
      end do
      moment = moment/n
      shared = shared/n
      error = 4/sqrt(real(n, wp))
      call check("mean 0", abs(moment(1)) < error)
      call check("variance 1", abs(moment(2) - 1) < error*sqrt(2.0_wp))
      call check("third moment 0", abs(moment(3)) < error*sqrt(15.0_wp))
      call check("fourth moment 3", abs(moment(4) - 3) < error*sqrt(96.0_wp))
      call check("boulders have nothing in common", abs(shared(1)) < error)
      call check("words of a draw have nothing in common", abs(shared(2)) < error)
      call check("nor do their squares", abs(shared(3)) < error*sqrt(8.0_wp))
   end subroutine test_moments

   pure function first_three(word)
      integer(i8), intent(in) :: word(4)
      integer(i8) :: first_three(3)

      first_three = word(:3)
   end function first_three
end program test_random
