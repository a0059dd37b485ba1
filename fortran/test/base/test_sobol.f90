! SPDX-License-Identifier: BSD-3-Clause
!> Sobol' points: the published numbers; after scrambling the same even spread, and chance where it belongs.
program test_sobol
   use rockfall_kinds, only: wp, i8
   use rockfall_random, only: random_key_t, random_key, philox4x32, uniform
   use rockfall_sobol, only: sobol_t, sobol_sequence, sobol_word, scrambled, max_dimensions
   use check_m, only: check, check_close, finish
   implicit none

   type(sobol_t) :: sobol
   type(random_key_t) :: key

   sobol = sobol_sequence(max_dimensions)
   key = random_key(20090601_i8)
   call test_published()
   call test_strata()
   call test_elementary_intervals()
   call test_nested()
   call test_uniform()
   call test_streams()
   call test_independent_below_a_fork()
   call test_bits()
   call test_error_of_a_mean()
   call finish()

contains

   !> The first ten points in three dimensions as Joe and Kuo print them with their program, and two far
   !> points in all dimensions from the direction numbers of SciPy 1.17 (scipy.stats.qmc.Sobol, 32 bits).
   subroutine test_published()
      real(wp), parameter :: first(3, 0:9) = reshape([ &
         0.0_wp, 0.0_wp, 0.0_wp, 0.5_wp, 0.5_wp, 0.5_wp, 0.75_wp, 0.25_wp, 0.25_wp, 0.25_wp, 0.75_wp, 0.75_wp, &
         0.375_wp, 0.375_wp, 0.625_wp, 0.875_wp, 0.875_wp, 0.125_wp, 0.625_wp, 0.125_wp, 0.875_wp, &
         0.125_wp, 0.625_wp, 0.375_wp, 0.1875_wp, 0.3125_wp, 0.9375_wp, 0.6875_wp, 0.8125_wp, 0.4375_wp], [3, 10])
      integer(i8), parameter :: far(max_dimensions) = [ &
         3601401703_i8, 3786301689_i8, 83550855_i8, 3216287653_i8, 2759811163_i8, 1343791977_i8]
      integer(i8), parameter :: last(max_dimensions) = [ &
         1_i8, 4294967295_i8, 3305133397_i8, 1342505107_i8, 2953698205_i8, 1086045115_i8]
      integer :: d, k

      call check("the first points", all([((abs(sobol_word(sobol, int(k, i8), d) - first(d, k)*2.0_wp**32) < 0.5_wp, &
                                            d=1, 3), k=0, 9)]))
      call check("a far point", all([(sobol_word(sobol, 3141592653_i8, d) == far(d), d=1, max_dimensions)]))
      call check("the last point", all([(sobol_word(sobol, 2_i8**32 - 1, d) == last(d), d=1, max_dimensions)]))
   end subroutine test_published

   !> Dimension `d` of the scrambled point `index` of a source.
   integer(i8) function word(index, d, source)
      integer, intent(in) :: index, d, source

      word = scrambled(sobol_word(sobol, int(index, i8), d), key, int(source, i8), d)
   end function word

   !> Each of 2**m strata of each dimension holds one of 2**m points, from whatever multiple of 2**m on.
   subroutine test_strata()
      integer, parameter :: m = 9, n = 2**m
      integer :: hits(0:n - 1), d, k, from
      logical :: even

      even = .true.
      do d = 1, max_dimensions
         do from = 0, 5*n, 5*n
            hits = 0
            do k = from, from + n - 1
               call add(hits, int(shiftr(word(k, d, 3), 32 - m)))
            end do
            even = even .and. all(hits == 1)
         end do
      end do
      call check("one point in each stratum of each dimension", even)
   end subroutine test_strata

   !> Dimensions 1 and 2 make a (0, 2)-sequence: each rectangle of sides 2**-a, 2**-(m-a) holds one of 2**m.
   subroutine test_elementary_intervals()
      integer, parameter :: m = 10, n = 2**m
      integer :: hits(0:n - 1), a, k
      logical :: even

      even = .true.
      do a = 0, m
         hits = 0
         do k = 0, n - 1
            call add(hits, int(shiftl(shiftr(word(k, 1, 8), 32 - a), m - a) + shiftr(word(k, 2, 8), 32 - m + a)))
         end do
         even = even .and. all(hits == 1)
      end do
      call check("one point in each elementary interval of two dimensions", even)
   end subroutine test_elementary_intervals

   subroutine add(hits, k)
      integer, intent(inout) :: hits(0:)
      integer, intent(in) :: k

      hits(k) = hits(k) + 1
   end subroutine add

   !> Two words that part at a bit part at the same bit when scrambled.
   subroutine test_nested()
      integer(i8) :: a, b, x(4)
      integer :: k
      logical :: nested

      nested = .true.
      do k = 1, 20000
         x = philox4x32([int(k, i8), 0_i8, 0_i8, 0_i8], key)
         a = x(1)
         b = ieor(a, shiftr(x(2), mod(k, 32)))
         nested = nested .and. leadz(ieor(a, b)) == leadz(ieor(scrambled(a, key, x(3), 1), scrambled(b, key, x(3), 1)))
      end do
      call check("scrambling keeps the length of what words have in common", nested)
   end subroutine test_nested

   !> One point over many scrambles is uniform: each bit one half, mean, variance, within 4.5 standard errors.
   subroutine test_uniform()
      integer, parameter :: n = 40000
      integer :: ones(0:31), k, bit
      real(wp) :: u, moment(2)
      integer(i8) :: w

      ones = 0
      moment = 0
      do k = 1, n
         w = word(4711, 6, k)
         do bit = 0, 31
            if (btest(w, bit)) ones(bit) = ones(bit) + 1
         end do
         u = uniform(w) - 0.5_wp
         moment = moment + [u, u*u]/n
      end do
      call check("every bit is set half the time", maxval(abs(ones - n/2)) < 4.5_wp*sqrt(n/4.0_wp))
      call check("mean 1/2", abs(moment(1)) < 4.5_wp/sqrt(12.0_wp*n))
      call check("variance 1/12", abs(moment(2) - 1/12.0_wp) < 4.5_wp/sqrt(180.0_wp*n))
   end subroutine test_uniform

   !> Another seed, source or dimension scrambles in another way.
   subroutine test_streams()
      integer(i8) :: w(5)
      integer :: k

      w = [scrambled(0_i8, key, 1_i8, 1), scrambled(0_i8, key, 2_i8, 1), scrambled(0_i8, key, 1_i8 + 2_i8**32, 1), &
           scrambled(0_i8, key, 1_i8, 2), scrambled(0_i8, random_key(7_i8), 1_i8, 1)]
      call check("separate scrambles differ", all([(count(w == w(k)) == 1, k=1, 5)]))
   end subroutine test_streams

   !> Below the bit where two words part, and from one dimension to the other, what is turned over has nothing
   !> in common: 31 - p bits agree half the time, within 4.5 standard errors.
   subroutine test_independent_below_a_fork()
      integer, parameter :: n = 3000
      integer :: p, k, agree, bits
      integer(i8) :: a, b
      logical :: independent

      independent = .true.
      do p = 0, 30
         agree = 0
         do k = 1, n
            a = scrambled(0_i8, key, int(k, i8), 4)
            b = ieor(scrambled(2_i8**(31 - p), key, int(k, i8), 4), 2_i8**(31 - p))
            agree = agree + (31 - p) - popcnt(ieor(a, b))
         end do
         bits = n*(31 - p)
         independent = independent .and. abs(agree - bits/2.0_wp) < 4.5_wp*sqrt(bits/4.0_wp)
      end do
      call check("chance below a fork is fresh", independent)
      agree = 0
      do k = 1, n
         agree = agree + 32 - popcnt(ieor(scrambled(0_i8, key, int(k, i8), 4), scrambled(0_i8, key, int(k, i8), 5)))
      end do
      call check("chance of another dimension is fresh", abs(agree - 16.0_wp*n) < 4.5_wp*sqrt(8.0_wp*n))
   end subroutine test_independent_below_a_fork

   !> What is turned over at one bit has nothing in common with what is at another: it agrees half the time,
   !> within 4.5 standard errors, for every distance of two bits.
   subroutine test_bits()
      integer, parameter :: n = 3000
      integer :: agree(31), apart, k
      integer(i8) :: w
      logical :: independent

      independent = .true.
      agree = 0
      do k = 1, n
         w = scrambled(0_i8, key, int(k, i8), 4)
         do apart = 1, 31
            agree(apart) = agree(apart) + (32 - apart) - popcnt(ibits(ieor(w, shiftr(w, apart)), 0, 32 - apart))
         end do
      end do
      do apart = 1, 31
         independent = independent .and. abs(agree(apart) - n*(32 - apart)/2.0_wp) < 4.5_wp*sqrt(n*(32 - apart)/4.0_wp)
      end do
      call check("chance of another bit is fresh", independent)
   end subroutine test_bits

   !> Owen (1997): in one dimension n = 2**m points are one uniform number in each stratum, so the mean of x over
   !> them has the variance 1/(12 n**3); within 4 standard errors over 3000 scrambles.
   subroutine test_error_of_a_mean()
      integer, parameter :: n = 64, scrambles = 3000
      real(wp) :: mean, variance, error
      integer :: d, k, source

      do d = 1, max_dimensions, 6
         variance = 0
         do source = 1, scrambles
            mean = sum([(uniform(word(k, d, source)), k=0, n - 1)])/n
            variance = variance + (mean - 0.5_wp)**2/scrambles
         end do
         error = 4*sqrt(2.0_wp/scrambles)
         call check_close("variance of a mean over strata", variance*12*real(n, wp)**3, 1.0_wp, error)
      end do
   end subroutine test_error_of_a_mean
end program test_sobol
