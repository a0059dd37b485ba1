! SPDX-License-Identifier: BSD-3-Clause
!> The impact model: fixed matrices, sampled means and covariances, admissible rebounds, and covariances
!> that are refused.
program test_impact
   use rockfall_kinds, only: wp, i8
   use rockfall_error, only: error_t, bad_input
   use rockfall_random, only: random_key_t, random_key, random_words, four_words, normal_table_t, &
      normal_table, normal, for_impact, for_ratio
   use rockfall_impact, only: impact_set_t, impact_set, with_noise, ratio_class, ratio_between, ratio_weights, &
      rebound_t, rebound, fitted_t, fitted, beyond_fit
   use check_m, only: check, check_close, finish
   implicit none

   real(wp), parameter :: lively(9) = [0.62_wp, 0.02_wp, 0.13_wp, 0.19_wp, -0.45_wp, -0.19_wp, &
                                       0.24_wp, 0.05_wp, 0.34_wp]
   real(wp), parameter :: spread_(9) = [0.12_wp, 0.15_wp, 0.1_wp, 0.08_wp, 0.1_wp, 0.05_wp, &
                                        0.15_wp, 0.2_wp, 0.15_wp]
   type(normal_table_t) :: table
   type(random_key_t) :: key

   call random_init(.true., .false.)
   table = normal_table()
   key = random_key(20090601_i8)
   call test_fixed()
   call test_sampling("definite", mixed(9))
   call test_sampling("of rank 4", mixed(4))
   call test_sampling("of rank 1", mixed(1))
   call test_draws()
   call test_noise()
   call test_without_noise()
   call test_admissible()
   call test_forced()
   call test_refused()
   call test_almost_semidefinite()
   call test_ratio_class()
   call test_ratio_between()
   call test_ratio_weights()
   call test_beyond_fit()
   call finish()

contains

   !> A covariance of a rank, with standard deviations of 0.01 to 0.02.
   function mixed(rank) result(c)
      integer, intent(in) :: rank
      real(wp) :: c(9, 9), b(9, rank)
      integer :: i

      call random_number(b)
      b = 2*b - 1
      do i = 1, 9
         b(i, :) = b(i, :)*(0.01_wp + 0.001_wp*i)/sqrt(sum(b(i, :)**2))
      end do
      c = matmul(b, transpose(b))
      c = 0.5_wp*(c + transpose(c))
   end function mixed

   !> Standard deviations `spread_`, correlations 0.2.
   pure function related() result(c)
      real(wp) :: c(9, 9)
      integer :: i, j

      do j = 1, 9
         do i = 1, 9
            c(i, j) = spread_(i)*spread_(j)*merge(1.0_wp, 0.2_wp, i == j)
         end do
      end do
   end function related

   !> The rebound of a boulder at its impact 3.
   function rebound_of(set, boulder, v_in) result(out)
      type(impact_set_t), intent(in) :: set
      integer(i8), intent(in) :: boulder
      real(wp), intent(in) :: v_in(3)
      type(rebound_t) :: out
      integer(i8) :: word(12)

      word = random_words(key, for_impact, boulder, 3_i8, 0_i8)
      call rebound(set, table, key, boulder, 3_i8, word(:9), v_in, out)
   end function rebound_of

   !> Kinetic energy, twice and per mass, of (V_t, V_n, R_b omega) of a sphere.
   pure real(wp) function energy(v)
      real(wp), intent(in) :: v(3)

      energy = v(1)**2 + v(2)**2 + 0.4_wp*v(3)**2
   end function energy

   !> Without scatter V_out = A V_in, A by rows.
   subroutine test_fixed()
      type(impact_set_t) :: set
      type(error_t), allocatable :: error
      type(rebound_t) :: out
      real(wp) :: none(9, 9)

      none = 0
      call impact_set(lively, none, set, error)
      call check("no scatter is allowed", .not. allocated(error))
      out = rebound_of(set, 1_i8, [8.0_wp, -5.0_wp, 2.0_wp])
      call check_close("V_t", out%v(1), 0.62_wp*8 - 0.02_wp*5 + 0.13_wp*2, 1.0e-15_wp)
      call check_close("V_n", out%v(2), 0.19_wp*8 + 0.45_wp*5 - 0.19_wp*2, 1.0e-15_wp)
      call check_close("W", out%v(3), 0.24_wp*8 - 0.05_wp*5 + 0.34_wp*2, 1.0e-15_wp)
      call check("one draw", out%draws == 1 .and. .not. out%forced)
   end subroutine test_fixed

   !> Means and covariances of a1..a9 over 10**6 draws within 4 standard errors. Three incoming velocities
   !> show the three columns of A; with a small scatter round a mild mean every draw is admissible.
   subroutine test_sampling(name, c)
      character(len=*), intent(in) :: name
      real(wp), intent(in) :: c(9, 9)
      integer(i8), parameter :: n = 1000000
      real(wp), parameter :: mean(9) = [0.5_wp, 0.1_wp, 0.1_wp, 0.3_wp, -0.3_wp, 0.2_wp, 0.3_wp, &
                                        -0.1_wp, 0.3_wp]
      real(wp), parameter :: columns(3, 3) = reshape([1, 0, 0, 0, -1, 0, 0, 0, 1], [3, 3])
      type(impact_set_t) :: set
      type(error_t), allocatable :: error
      type(rebound_t) :: out
      real(wp) :: a(9), total(9), products(9, 9)
      integer(i8) :: k
      integer :: i, j, redrawn

      call impact_set(mean, c, set, error)
      call check("a covariance "//name//" is allowed", .not. allocated(error))
      total = 0
      products = 0
      redrawn = 0
      do k = 1, n
         do j = 1, 3
            out = rebound_of(set, k, columns(:, j))
            a(j::3) = sum(columns(:, j))*out%v
            redrawn = redrawn + out%draws - 1
         end do
         a = a - mean
         total = total + a
         do j = 1, 9
            products(:, j) = products(:, j) + a*a(j)
         end do
      end do
      total = total/n
      products = products/n
      call check("every draw is admissible", redrawn == 0)
      do j = 1, 9
         call check("a mean, "//name, abs(total(j)) < 4*sqrt(c(j, j)/n))
         do i = j, 9
            call check("a covariance, "//name, &
                       abs(products(i, j) - c(i, j)) < 4*sqrt((c(i, i)*c(j, j) + c(i, j)**2)/n))
         end do
      end do
   end subroutine test_sampling

   !> Lower root of a definite matrix, row by row.
   pure function cholesky(c) result(l)
      real(wp), intent(in) :: c(9, 9)
      real(wp) :: l(9, 9)
      integer :: i, j

      l = 0
      do i = 1, 9
         do j = 1, i - 1
            l(i, j) = (c(i, j) - sum(l(i, :j - 1)*l(j, :j - 1)))/l(j, j)
         end do
         l(i, i) = sqrt(c(i, i) - sum(l(i, :i - 1)**2))
      end do
   end function cholesky

   !> A = m + L z from the words of each draw, again until it is admissible.
   subroutine test_draws()
      type(impact_set_t) :: set
      type(error_t), allocatable :: error
      type(rebound_t) :: out
      real(wp), parameter :: v_in(3) = [6.0_wp, -4.0_wp, 5.0_wp]
      real(wp) :: l(9, 9), v(3)
      integer(i8) :: k, word(12), draw
      integer :: several

      call impact_set(lively, 4*related(), set, error)
      l = cholesky(4*related())
      several = 0
      do k = 1, 2000
         out = rebound_of(set, k, v_in)
         do draw = 0, out%draws - 1
            word = random_words(key, for_impact, k, 3_i8, draw)
            v = matmul(transpose(reshape(lively + matmul(l, normal(table, word(:9))), [3, 3])), &
                       v_in)
            if (draw < out%draws - 1) call check("refused for a reason", v(2) <= 0 &
                                                 .or. energy(v) > energy(v_in))
         end do
         call check("the draw that was taken", all(abs(v - out%v) < 1.0e-13_wp) &
                    .and. .not. out%forced)
         if (out%draws > 1) several = several + 1
      end do
      call check("some were drawn again", several > 100)
   end subroutine test_draws

   !> A V_in of a covariance with noise and A V_in + |V_in| e, A and e drawn apart, have the same mean and covariance.
   subroutine test_noise()
      real(wp), parameter :: definite(3, 3) = 1.0e-2_wp*reshape([2.0_wp, 0.5_wp, -1.0_wp, 0.0_wp, 1.5_wp, 0.4_wp, &
                                                                 0.0_wp, 0.0_wp, 2.2_wp], [3, 3]), &
                             line(3, 1) = 1.0e-2_wp*reshape([2.0_wp, -1.0_wp, 1.5_wp], [3, 1])
      call compare("definite noise", mixed(9), definite)
      call compare("noise of rank 1", mixed(1), line)
   end subroutine test_noise

   !> The moments within 4 standard errors of their difference.
   subroutine compare(name, c, root)
      character(len=*), intent(in) :: name
      real(wp), intent(in) :: c(9, 9), root(:, :)  !! of the covariance of e
      integer(i8), parameter :: n = 250000
      real(wp), parameter :: v_in(3) = [6.0_wp, -4.0_wp, 5.0_wp]
      real(wp), parameter :: mean(9) = 0.3_wp*[1.0_wp, 0.0_wp, 0.0_wp, 1.0_wp, -1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 1.0_wp]
      type(impact_set_t) :: plain, folded
      type(error_t), allocatable :: error
      type(rebound_t) :: out
      real(wp), allocatable :: v(:, :)
      real(wp) :: m(3), want(3), p(3, 3), q(3, 3)
      integer(i8) :: k, word(4)
      integer :: i, j, redrawn

      allocate (v(3, n))
      redrawn = 0
      call impact_set(mean, c, plain, error)
      do k = 1, n
         out = rebound_of(plain, k, v_in)
         word = four_words(key, for_ratio, k, 3_i8, 0_i8)
         v(:, k) = out%v + norm2(v_in)*matmul(root, normal(table, word(:size(root, 2))))
         redrawn = redrawn + out%draws - 1
      end do
      call moments(v, want, q)
      call impact_set(mean, with_noise(c, matmul(root, transpose(root))), folded, error)
      call check(name//" is allowed", .not. allocated(error))
      do k = 1, n
         out = rebound_of(folded, n + k, v_in)
         v(:, k) = out%v
         redrawn = redrawn + out%draws - 1
      end do
      call moments(v, m, p)
      call check("every draw is admissible, "//name, redrawn == 0)
      do j = 1, 3
         call check("mean with "//name, abs(m(j) - want(j)) < 4*sqrt(2*q(j, j)/n))
         do i = j, 3
            call check("covariance with "//name, &
                       abs(p(i, j) - q(i, j)) < 4*sqrt(2*(q(i, i)*q(j, j) + q(i, j)**2)/n))
         end do
      end do
   end subroutine compare

   pure subroutine moments(v, mean, covariance)
      real(wp), intent(in) :: v(:, :)
      real(wp), intent(out) :: mean(3), covariance(3, 3)
      integer :: i, j

      mean = sum(v, dim=2)/size(v, 2)
      do j = 1, 3
         do i = 1, 3
            covariance(i, j) = sum((v(i, :) - mean(i))*(v(j, :) - mean(j)))/size(v, 2)
         end do
      end do
   end subroutine moments

   !> Noise of zeros changes no bit.
   subroutine test_without_noise()
      type(impact_set_t) :: plain, quiet
      type(error_t), allocatable :: error
      type(rebound_t) :: a, b
      real(wp) :: none(3, 3)
      integer(i8) :: k

      none = 0
      call impact_set(lively, related(), plain, error)
      call impact_set(lively, with_noise(related(), none), quiet, error)
      do k = 1, 1000
         a = rebound_of(plain, k, [6.0_wp, -4.0_wp, 5.0_wp])
         b = rebound_of(quiet, k, [6.0_wp, -4.0_wp, 5.0_wp])
         call check("no noise, no change", all(abs(a%v - b%v) <= 0) .and. a%draws == b%draws)
      end do
   end subroutine test_without_noise

   !> Whatever the scatter and the velocity: the boulder leaves the surface and gains no energy.
   subroutine test_admissible()
      type(impact_set_t) :: set
      type(error_t), allocatable :: error
      type(rebound_t) :: out
      real(wp) :: v_in(3), size
      integer(i8) :: k
      integer :: forced
      logical :: up, gained

      call impact_set(3*lively, 20*related(), set, error)
      up = .true.
      gained = .false.
      forced = 0
      do k = 1, 100000
         call random_number(v_in)
         call random_number(size)
         v_in = [v_in(1), -v_in(2), 2*v_in(3) - 1]*10.0_wp**(40*size - 30)
         out = rebound_of(set, k, v_in)
         up = up .and. out%v(2) > 0
         gained = gained .or. energy(out%v) > energy(v_in)*(1 + 4*epsilon(1.0_wp))
         if (out%forced) forced = forced + 1
      end do
      call check("V_n is positive after every rebound", up)
      call check("no rebound gains energy", .not. gained)
      call check("some were forced", forced > 100 .and. forced < 99000)
   end subroutine test_admissible

   !> After 32 draws: V_n of 1 % of the incoming speed when it was not positive, then down to the incoming
   !> energy.
   subroutine test_forced()
      type(impact_set_t) :: set
      type(error_t), allocatable :: error
      type(rebound_t) :: out
      real(wp), parameter :: v_in(3) = [8.0_wp, -6.0_wp, 5.0_wp]
      real(wp) :: none(9, 9), want(3)

      none = 0
      call impact_set([0.5_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.5_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.5_wp], &
                      none, set, error)
      out = rebound_of(set, 1_i8, v_in)
      call check("never up: forced after 32 draws", out%forced .and. out%draws == 32)
      call check("up at 1 % of the incoming speed", &
                 all(abs(out%v - [4.0_wp, 0.1_wp, 2.5_wp]) < 1.0e-15_wp))

      call impact_set([1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, -3.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 1.0_wp], &
                      none, set, error)
      out = rebound_of(set, 1_i8, v_in)
      want = [8.0_wp, 18.0_wp, 5.0_wp]
      want = want*sqrt(energy(v_in)/energy(want))
      call check("gains energy: forced after 32 draws", out%forced .and. out%draws == 32)
      call check("scaled down to the incoming energy", all(abs(out%v - want) < 1.0e-14_wp))

      call impact_set([2.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 2.0_wp], &
                      none, set, error)
      out = rebound_of(set, 1_i8, v_in)
      want = [16.0_wp, 0.1_wp, 10.0_wp]
      want = want*sqrt(energy(v_in)/energy(want))
      call check("both at once", all(abs(out%v - want) < 1.0e-14_wp) .and. out%forced)
   end subroutine test_forced

   subroutine test_refused()
      type(impact_set_t) :: set
      type(error_t), allocatable :: error
      real(wp) :: c(9, 9)

      c = related()
      c(7, 2) = 0.5_wp*c(7, 2)
      call impact_set(lively, c, set, error)
      call check("not symmetric is refused", allocated(error))
      if (allocated(error)) then
         call check("its entry is named", index(error%message, "not symmetric: entry (7, 2)") > 0)
         call check("as bad input", error%code == bad_input)
      end if
      c = related()
      c(7, 2) = 1.01_wp*spread_(7)*spread_(2)
      c(2, 7) = c(7, 2)
      call impact_set(lively, c, set, error)
      call check("indefinite is refused", allocated(error))
      if (allocated(error)) then
         call check("its eigenvalue is named", &
                    index(error%message, "indefinite: smallest eigenvalue  -") > 0)
         call check("as bad input", error%code == bad_input)
      end if
      c = 0
      c(3, 3) = -1.0e-3_wp
      call impact_set(lively, c, set, error)
      call check("a negative variance is refused", allocated(error))
   end subroutine test_refused

   !> A semidefinite covariance that was printed with seven digits may have eigenvalues just below zero.
   subroutine test_almost_semidefinite()
      type(impact_set_t) :: set
      type(error_t), allocatable :: error
      real(wp) :: c(9, 9)
      integer :: i

      c = mixed(3)
      do i = 1, 9
         c(i, i) = c(i, i) - 1.0e-8_wp*maxval(c)
      end do
      call impact_set(lively, c, set, error)
      call check("rounded semidefinite is allowed", .not. allocated(error))
      c = matmul(set%root(:9, :), transpose(set%root(:9, :))) - c
      call check("and its root gives it back", maxval(abs(c)) < 1.0e-6_wp*4.0e-4_wp)
   end subroutine test_almost_semidefinite

   !> Rounded to the nearest integer, kept within 1 to 5; beyond 0.5 to 5.5 no set is calibrated.
   subroutine test_ratio_class()
      real(wp), parameter :: ratio(13) = [1.0e-9_wp, 0.49_wp, 0.5_wp, 1.0_wp, 1.49_wp, 1.5_wp, &
                                          2.49_wp, 3.0_wp, &
                                          4.51_wp, 5.49_wp, 5.5_wp, 5.51_wp, 1.0e30_wp]
      integer, parameter :: want(13) = [1, 1, 1, 1, 1, 2, 2, 3, 5, 5, 5, 5, 5]
      integer :: k, class
      logical :: outside

      do k = 1, size(ratio)
         call ratio_class(ratio(k), class, outside)
         call check("the set of a ratio", class == want(k))
         call check("outside of the calibrated range", outside .eqv. (k <= 2 .or. k >= 12))
      end do
   end subroutine test_ratio_class
   !> The upper of two sets as often as the ratio is beyond the lower; whole ratios and those beyond the sets are
   !> served by one.
   subroutine test_ratio_between()
      real(wp), parameter :: ratio(8) = [0.2_wp, 1.0_wp, 1.25_wp, 2.5_wp, 3.0_wp, 4.9_wp, 5.0_wp, 70.0_wp]
      integer, parameter :: lower(8) = [1, 1, 1, 2, 3, 4, 5, 5], upper(8) = [0, 0, 250, 500, 0, 900, 0, 0]
      integer :: k, u, hits(0:6)

      do k = 1, size(ratio)
         hits = 0
         do u = 0, 999
            associate (hit => hits(ratio_between(ratio(k), (u + 0.5_wp)/1000)))
               hit = hit + 1
            end associate
         end do
         call check("between two sets", hits(lower(k)) == 1000 - upper(k) .and. hits(lower(k) + 1) == upper(k))
      end do
   end subroutine test_ratio_between

   !> They are how often a uniform number chooses each set.
   subroutine test_ratio_weights()
      real(wp), parameter :: ratio(9) = [0.2_wp, 1.0_wp, 1.25_wp, 1.5_wp, 2.5_wp, 3.0_wp, 4.9_wp, 5.0_wp, 70.0_wp]
      real(wp) :: weight(5), often(5)
      integer :: k, u, class
      logical :: outside

      do k = 1, size(ratio)
         often = 0
         do u = 0, 999
            class = ratio_between(ratio(k), (u + 0.5_wp)/1000)
            often(class) = often(class) + 0.001_wp
         end do
         weight = ratio_weights(ratio(k), .true.)
         call check("weights between", maxval(abs(weight - often)) < 1.0e-12_wp)
         call ratio_class(ratio(k), class, outside)
         weight = ratio_weights(ratio(k), .false.)
         call check("weight of the nearest", abs(weight(class) - 1) <= 0 .and. abs(sum(weight) - 1) <= 0)
      end do
   end subroutine test_ratio_weights

   !> Both ends of a range lie within it; a set that says nothing was fitted on everything.
   subroutine test_beyond_fit()
      real(wp), parameter :: degree = acos(-1.0_wp)/180, near = 1.0e-9_wp
      real(wp), parameter :: speeds(6) = [2.0_wp, 2 - near, 2 + near, 20.0_wp, 20 + near, 20 - near]
      real(wp), parameter :: angles(4) = [5 + near, 5 - near, 60 - near, 60 + near]
      type(fitted_t) :: this, any_
      real(wp) :: v(2)
      logical :: speed, angle
      integer :: k

      this = fitted([2.0_wp, 20.0_wp], [5.0_wp, 60.0_wp])
      do k = 1, size(speeds)
         call beyond_fit(this, [speeds(k)*0.8_wp, -speeds(k)*0.6_wp], speed, angle)
         if (mod(k, 3) /= 1) call check("beyond in speed", speed .eqv. mod(k, 3) == 2)
         call check("but not in angle", .not. angle)
      end do
      call beyond_fit(this, [0.0_wp, -2.0_wp], speed, angle)
      call check("the slowest; vertical", .not. speed .and. angle)
      call beyond_fit(this, [20.0_wp, 0.0_wp], speed, angle)
      call check("the fastest; along the ground", .not. speed .and. angle)
      do k = 1, size(angles)
         v = 7*[cos(angles(k)*degree), -sin(angles(k)*degree)]
         call beyond_fit(this, v, speed, angle)
         call check("beyond in angle", .not. speed .and. (angle .eqv. mod(k, 2) == 0))
      end do
      do k = -300, 100, 50
         call beyond_fit(any_, 10.0_wp**k*[1.0_wp, -2.0_wp], speed, angle)
         call check("everything", .not. speed .and. .not. angle)
         call beyond_fit(any_, 10.0_wp**k*[0.0_wp, -1.0_wp], speed, angle)
         call check("vertical, too", .not. speed .and. .not. angle)
      end do
      call beyond_fit(fitted([0.0_wp, 1.0e100_wp], [0.0_wp, 90.0_wp]), [0.0_wp, 0.0_wp], speed, angle)
      call check("and at rest", .not. speed .and. .not. angle)
   end subroutine test_beyond_fit
end program test_impact
