! SPDX-License-Identifier: BSD-3-Clause
!> Impact model: fixed matrices, sampled means and covariances, admissible rebounds, and refused covariances.
program test_impact
   use rockfall_kinds, only: wp, i8
   use rockfall_error, only: error_t
   use rockfall_random, only: random_key_t, random_key, random_words, normal_table_t, &
      normal_table, normal, for_impact, for_ground
   use rockfall_impact, only: impact_set_t, impact_set, with_noise, find_nearest_set, interpolated_set, ratio_weights, &
      rebound_t, rebound, fitted_t, fitted, beyond_fit, velocity_distribution_t, velocity_distribution, &
                              drawn_velocity, impact_ratios, admissible, twice_energy
   use rockfall_covariance, only: covariance_root
   use rockfall_impact_sets, only: coefficients_t, read_sets
   use rockfall_direction, only: past_aspect
   use check_m, only: check, check_close, finish
   implicit none

   real(wp), parameter :: lively(9) = [0.62_wp, 0.02_wp, 0.13_wp, 0.19_wp, -0.45_wp, -0.19_wp, &
                                       0.24_wp, 0.05_wp, 0.34_wp]
   real(wp), parameter :: spread_(9) = [0.12_wp, 0.15_wp, 0.1_wp, 0.08_wp, 0.1_wp, 0.05_wp, &
                                        0.15_wp, 0.2_wp, 0.15_wp]
   type(normal_table_t) :: table
   type(random_key_t) :: key
   real(wp), allocatable :: draws(:, :)

   call random_init(.true., .false.)
   table = normal_table()
   key = random_key(20090601_i8)
   call test_fixed()
   call draw_all()
   call test_moments()
   call test_draws()
   call test_noise()
   call test_without_noise()
   call test_admissible()
   call test_forced()
   call test_ratio_class()
   call test_ratio_between()
   call test_ratio_weights()
   call test_beyond_fit()
   call finish()

contains

   !> Covariance of a given rank, with standard deviations of 0.01 to 0.02.
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

   !> Covariance with standard deviations `spread_` and correlations of 0.2.
   pure function related() result(c)
      real(wp) :: c(9, 9)
      integer :: i, j

      do j = 1, 9
         do i = 1, 9
            c(i, j) = spread_(i)*spread_(j)*merge(1.0_wp, 0.2_wp, i == j)
         end do
      end do
   end function related

   !> Rebound of a boulder at its impact 3.
   function rebound_of(set, boulder, v_in) result(out)
      type(impact_set_t), intent(in) :: set
      integer(i8), intent(in) :: boulder
      real(wp), intent(in) :: v_in(3)
      type(rebound_t) :: out
      integer(i8) :: word(4)

      word = random_words(key, for_impact, boulder, 3_i8, 0_i8)
      call rebound(set, table, key, boulder, 3_i8, word(:3), v_in, out)
   end function rebound_of

   !> Twice the kinetic energy per mass of a sphere with (V_t, V_n, R_b omega).
   pure real(wp) function energy(v)
      real(wp), intent(in) :: v(3)

      energy = v(1)**2 + v(2)**2 + 0.4_wp*v(3)**2
   end function energy

   !> Without scatter, V_out = A V_in, A row by row.
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

   !> Drawn V_out have the moments of A V_in with A = m + L z, L L^T = C: for the shipped sets, and for covariances with
   !> little or no scatter in some directions; from grazing to vertical.
   subroutine test_moments()
      real(wp), parameter :: v_in(3, 3) = reshape([9.0_wp, -1.0_wp, 8.0_wp, 6.0_wp, -4.0_wp, -5.0_wp, &
                                                   0.0_wp, -7.0_wp, 2.0_wp], [3, 3])
      type(error_t), allocatable :: error
      type(coefficients_t) :: shipped
      real(wp) :: faint(9, 9)
      integer :: k, i

      call read_sets(text_of(), "laboratory-spheres.nml", past_aspect, 0, shipped, error)
      call check("the sets are read", .not. allocated(error))
      do k = 1, impact_ratios
         call compare_all(shipped%mean(:, k), shipped%covariance(:, :, k), v_in)
      end do
      call compare_all(lively, mixed(1), v_in)
      call compare_all(lively, mixed(4), v_in)
      call compare_all(lively, 1.0e-9_wp*nint(1.0e9_wp*mixed(2)), v_in)  ! rounded to six digits
      call compare_all(lively, 0*mixed(1), v_in)
      faint = mixed(2)
      do i = 1, 9
         faint(i, i) = faint(i, i) + 1.0e-12_wp*maxval(faint)
      end do
      call compare_all(lively, faint, v_in)
   end subroutine test_moments

   !> Compare moments for several velocities.
   subroutine compare_all(mean, covariance, v_in)
      real(wp), intent(in) :: mean(9), covariance(9, 9), v_in(:, :)
      type(impact_set_t) :: set
      type(error_t), allocatable :: error
      real(wp) :: root(9, 9), drawn(9, 9)
      integer :: i

      call covariance_root("covariance", covariance, root, drawn, error)
      call impact_set(mean, covariance, set, error)
      do i = 1, size(v_in, 2)
         call compare_moments(set, root, v_in(:, i))
      end do
   end subroutine compare_all

   !> Text of the shipped file of impact sets.
   function text_of() result(text)
      character(len=:), allocatable :: text
      character(len=1000) :: path
      integer :: unit, bytes

      call get_command_argument(1, path)
      open (newunit=unit, file=trim(path), access="stream", form="unformatted", status="old", action="read")
      inquire (unit, size=bytes)
      allocate (character(len=bytes) :: text)
      read (unit) text
      close (unit)
   end function text_of

   !> Means, covariances, third and fourth moments of 10**6 draws are within 4.5 standard errors of those of a normal
   !> vector with covariance B B^T, where B z = L z as a matrix times V_in.
   subroutine compare_moments(set, root, v_in)
      type(impact_set_t), intent(in) :: set
      real(wp), intent(in) :: root(9, 9), v_in(3)
      integer, parameter :: n = 1000000
      type(velocity_distribution_t) :: distribution
      real(wp) :: b(3, 9), s(3, 3), x(3), first(3), second(3, 3), third(3, 3), fourth(3, 3), tolerance
      integer :: k, i, j

      do i = 1, 3
         b(i, :) = matmul(v_in, root(3*i - 2:3*i, :))
      end do
      s = matmul(b, transpose(b))
      distribution = velocity_distribution(set, v_in(1), v_in(2), v_in(3))
      x = matmul(transpose(reshape(set%mean, [3, 3])), v_in)
      call check("the mean of A times V_in", &
                 maxval(abs([distribution%mean_t, distribution%mean_n, distribution%mean_w] &
                            - x)) <= 1.0e-14_wp*norm2(v_in))
      distribution%mean_t = 0
      distribution%mean_n = 0
      distribution%mean_w = 0
      first = 0
      second = 0
      third = 0
      fourth = 0
      do k = 1, n
         x = drawn_velocity(distribution, draws(:, k))
         first = first + x
         do j = 1, 3
            second(:, j) = second(:, j) + x*x(j)
            third(:, j) = third(:, j) + x*x*x(j)
            fourth(:, j) = fourth(:, j) + x*x*(x(j)*x(j))
         end do
      end do
      tolerance = 4.5_wp/sqrt(real(n, wp))
      do j = 1, 3
         call check("means", abs(first(j))/n <= tolerance*sqrt(s(j, j)))
         do i = 1, 3
            associate (ii => s(i, i), jj => s(j, j), ij => s(i, j))
               call check("covariances", abs(second(i, j)/n - ij) <= tolerance*sqrt(ii*jj + ij**2))
               call check("third moments", abs(third(i, j)/n) <= tolerance*sqrt(3*ii**2*jj + 12*ii*ij**2))
               call check("fourth moments", abs(fourth(i, j)/n - ii*jj - 2*ij**2) &
                          <= tolerance*sqrt(8*ii**2*jj**2 + 68*ii*jj*ij**2 + 20*ij**4))
            end associate
         end do
      end do
   end subroutine compare_moments

   !> Draw the standard normal numbers of the first draw of each boulder.
   subroutine draw_all()
      integer(i8) :: k, word(4)

      allocate (draws(3, 1000000))
      do k = 1, size(draws, 2)
         word = random_words(key, for_impact, k, 3_i8, 0_i8)
         draws(:, k) = normal(table, word(:3))
      end do
   end subroutine draw_all

   !> Lower root of a definite matrix, row by row.
   pure function cholesky(c) result(l)
      real(wp), intent(in) :: c(3, 3)
      real(wp) :: l(3, 3)
      integer :: i, j

      l = 0
      do i = 1, 3
         do j = 1, i - 1
            l(i, j) = (c(i, j) - sum(l(i, :j - 1)*l(j, :j - 1)))/l(j, j)
         end do
         l(i, i) = sqrt(c(i, i) - sum(l(i, :i - 1)**2))
      end do
   end function cholesky

   !> A V_in from the words of each draw and the textbook root of the covariance, redrawn until it is admissible.
   subroutine test_draws()
      type(impact_set_t) :: set
      type(error_t), allocatable :: error
      type(rebound_t) :: out
      real(wp), parameter :: v_in(3) = [6.0_wp, -4.0_wp, 5.0_wp]
      real(wp) :: c(9, 9), l(3, 3), s(3, 3), v(3)
      integer(i8) :: k, word(4), draw
      integer :: several, i, j

      c = 4*related()
      call impact_set(lively, c, set, error)
      do j = 1, 3
         do i = 1, 3
            s(i, j) = dot_product(v_in, matmul(c(3*i - 2:3*i, 3*j - 2:3*j), v_in))
         end do
      end do
      l = cholesky(s)
      several = 0
      do k = 1, 2000
         out = rebound_of(set, k, v_in)
         do draw = 0, out%draws - 1
            word = random_words(key, for_impact, k, 3_i8, draw)
            v = matmul(transpose(reshape(lively, [3, 3])), v_in) + matmul(l, normal(table, word(:3)))
            if (draw < out%draws - 1) call check("refused for a reason", v(2) <= 0 &
                                                 .or. energy(v) > energy(v_in))
         end do
         call check("the draw that was taken", all(abs(v - out%v) < 1.0e-13_wp) &
                    .and. .not. out%forced)
         if (out%draws > 1) several = several + 1
      end do
      call check("some were drawn again", several > 100)
   end subroutine test_draws

   !> A V_in with a covariance that includes noise has the mean and covariance of A V_in + |V_in| e, with A and e
   !> separate.
   subroutine test_noise()
      real(wp), parameter :: definite(3, 3) = 1.0e-2_wp*reshape([2.0_wp, 0.5_wp, -1.0_wp, 0.0_wp, 1.5_wp, 0.4_wp, &
                                                                 0.0_wp, 0.0_wp, 2.2_wp], [3, 3]), &
                             line(3, 1) = 1.0e-2_wp*reshape([2.0_wp, -1.0_wp, 1.5_wp], [3, 1])
      call compare("definite noise", mixed(9), definite)
      call compare("noise of rank 1", mixed(1), line)
   end subroutine test_noise

   !> Compare moments within 4 standard errors of their difference.
   subroutine compare(name, c, root)
      character(len=*), intent(in) :: name
      real(wp), intent(in) :: c(9, 9), root(:, :)  !! covariance of A, root of that of e
      integer(i8), parameter :: n = 250000
      real(wp), parameter :: v_in(3) = [6.0_wp, -4.0_wp, 5.0_wp]
      real(wp), parameter :: mean(9) = 0.3_wp*[1.0_wp, 0.0_wp, 0.0_wp, 1.0_wp, -1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 1.0_wp]
      type(impact_set_t) :: plain, total
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
         word = random_words(key, for_ground, k, 3_i8, 0_i8)
         v(:, k) = out%v + norm2(v_in)*matmul(root, normal(table, word(:size(root, 2))))
         redrawn = redrawn + out%draws - 1
      end do
      call moments(v, want, q)
      call impact_set(mean, with_noise(c, matmul(root, transpose(root))), total, error)
      call check(name//" is allowed", .not. allocated(error))
      do k = 1, n
         out = rebound_of(total, n + k, v_in)
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

   !> Noise of zero changes nothing.
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

   !> For any scatter and velocity, the boulder leaves the surface and gains no energy.
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
      associate (energy => twice_energy([3.0_wp, -4.0_wp, 0.0_wp]))
         call check("up with the same energy", admissible(4.0_wp, 3.0_wp, 0.0_wp, energy) > 0)
         call check("not along the ground", .not. admissible(4.0_wp, 0.0_wp, 0.0_wp, energy) > 0)
         call check("not with more energy", .not. admissible(4.0_wp, 3.0_wp, 0.1_wp, energy) > 0)
      end associate
   end subroutine test_admissible

   !> After 32 draws, V_n is 1 % of the incoming speed if it was not positive; then the energy is reduced to the
   !> incoming energy.
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

   !> Ratios are rounded to the nearest integer within 1 to 5; beyond 0.5 to 5.5 no set is calibrated.
   subroutine test_ratio_class()
      real(wp), parameter :: ratio(13) = [1.0e-9_wp, 0.49_wp, 0.5_wp, 1.0_wp, 1.49_wp, 1.5_wp, &
                                          2.49_wp, 3.0_wp, &
                                          4.51_wp, 5.49_wp, 5.5_wp, 5.51_wp, 1.0e30_wp]
      integer, parameter :: want(13) = [1, 1, 1, 1, 1, 2, 2, 3, 5, 5, 5, 5, 5]
      integer :: k, class
      logical :: outside

      do k = 1, size(ratio)
         call find_nearest_set(ratio(k), class, outside)
         call check("the set of a ratio", class == want(k))
         call check("outside of the calibrated range", outside .eqv. (k <= 2 .or. k >= 12))
      end do
   end subroutine test_ratio_class
   !> The probability of the upper of two sets is the fractional part of the ratio; integer ratios and those beyond the
   !> sets use a single set.
   subroutine test_ratio_between()
      real(wp), parameter :: ratio(8) = [0.2_wp, 1.0_wp, 1.25_wp, 2.5_wp, 3.0_wp, 4.9_wp, 5.0_wp, 70.0_wp]
      integer, parameter :: lower(8) = [1, 1, 1, 2, 3, 4, 5, 5], upper(8) = [0, 0, 250, 500, 0, 900, 0, 0]
      integer :: k, u, hits(0:6)

      do k = 1, size(ratio)
         hits = 0
         do u = 0, 999
            associate (hit => hits(interpolated_set(ratio(k), (u + 0.5_wp)/1000)))
               hit = hit + 1
            end associate
         end do
         call check("between two sets", hits(lower(k)) == 1000 - upper(k) .and. hits(lower(k) + 1) == upper(k))
      end do
   end subroutine test_ratio_between

   !> Weights are the probabilities with which a uniform number selects each set.
   subroutine test_ratio_weights()
      real(wp), parameter :: ratio(9) = [0.2_wp, 1.0_wp, 1.25_wp, 1.5_wp, 2.5_wp, 3.0_wp, 4.9_wp, 5.0_wp, 70.0_wp]
      real(wp) :: weight(5), often(5)
      integer :: k, u, class
      logical :: outside

      do k = 1, size(ratio)
         often = 0
         do u = 0, 999
            class = interpolated_set(ratio(k), (u + 0.5_wp)/1000)
            often(class) = often(class) + 0.001_wp
         end do
         weight = ratio_weights(ratio(k), .true.)
         call check("weights between", maxval(abs(weight - often)) < 1.0e-12_wp)
         call find_nearest_set(ratio(k), class, outside)
         weight = ratio_weights(ratio(k), .false.)
         call check("weight of the nearest", abs(weight(class) - 1) <= 0 .and. abs(sum(weight) - 1) <= 0)
      end do
   end subroutine test_ratio_weights

   !> Both ends of a range are within it; a set without ranges covers everything.
   subroutine test_beyond_fit()
      real(wp), parameter :: degree = acos(-1.0_wp)/180, near = 1.0e-9_wp
      real(wp), parameter :: speeds(6) = [2.0_wp, 2 - near, 2 + near, 20.0_wp, 20 + near, 20 - near]
      real(wp), parameter :: angles(4) = [5 + near, 5 - near, 60 - near, 60 + near]
      type(fitted_t) :: this, any_
      real(wp) :: v(2), speed, angle  ! speed, angle: 1 if outside, else 0
      integer :: k

      this = fitted([2.0_wp, 20.0_wp], [5.0_wp, 60.0_wp])
      do k = 1, size(speeds)
         call beyond_fit(this, speeds(k)*0.8_wp, -speeds(k)*0.6_wp, speed, angle)
         if (mod(k, 3) /= 1) call check("beyond in speed", (speed > 0) .eqv. mod(k, 3) == 2)
         call check("but not in angle", .not. angle > 0)
      end do
      call beyond_fit(this, 0.0_wp, -2.0_wp, speed, angle)
      call check("the slowest; vertical", .not. speed > 0 .and. angle > 0)
      call beyond_fit(this, 20.0_wp, 0.0_wp, speed, angle)
      call check("the fastest; along the ground", .not. speed > 0 .and. angle > 0)
      do k = 1, size(angles)
         v = 7*[cos(angles(k)*degree), -sin(angles(k)*degree)]
         call beyond_fit(this, v(1), v(2), speed, angle)
         call check("beyond in angle", .not. speed > 0 .and. ((angle > 0) .eqv. mod(k, 2) == 0))
      end do
      do k = -300, 100, 50
         call beyond_fit(any_, 10.0_wp**k, -2*10.0_wp**k, speed, angle)
         call check("everything", .not. speed > 0 .and. .not. angle > 0)
         call beyond_fit(any_, 0.0_wp, -10.0_wp**k, speed, angle)
         call check("vertical, too", .not. speed > 0 .and. .not. angle > 0)
      end do
      call beyond_fit(fitted([0.0_wp, 1.0e100_wp], [0.0_wp, 90.0_wp]), 0.0_wp, 0.0_wp, speed, angle)
      call check("and at rest", .not. speed > 0 .and. .not. angle > 0)
   end subroutine test_beyond_fit
end program test_impact
