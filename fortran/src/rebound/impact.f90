! SPDX-License-Identifier: BSD-3-Clause
!> Stochastic impact model (Bourrier et al. 2009, eqs 4-7): V_out = A V_in with V = (V_t, V_n, W), W = R_b omega, and
!> a multivariate normal random 3x3 matrix A. Its distribution depends only on the ratio of boulder size to rock size
!> on the slope.
module rockfall_impact
   use rockfall_kinds, only: wp, i8
   use rockfall_dimensions, only: n_impact_sets, n_set_numbers
   use rockfall_error, only: error_t
   use rockfall_covariance, only: covariance_root
   use rockfall_random, only: random_key_t, normal_table_t, normal, random_words, for_impact, words_per_block, &
                              rebound_words
   use rockfall_boulder, only: inertia_factor
   use rockfall_math, only: squared_sine
   implicit none
   private
   public :: impact_set_t, impact_set, with_noise, fitted_t, fitted, beyond_fit
   public :: velocity_distribution_t, velocity_distribution, drawn_velocity
   public :: max_draws, min_normal, impact_ratios, find_nearest_set, interpolated_set, ratio_weights, rebound_t, rebound
   public :: admissible, is_admissible, limit_rebound, twice_energy, redraw_rebound, draw_rebound, energy_of

   integer, parameter :: impact_ratios = n_impact_sets  !! sets for R_b/R_m = 1, 2, 3, 4, 5
   integer, parameter :: entries = n_set_numbers  !! number of elements of the matrix A
   integer, parameter :: max_draws = 32    !! draws of A; then the last is limited; our assumption (theory, chapter 5)
   !> V_n of a limited rebound that would not leave the surface, over the incoming speed [-]; our assumption.
   real(wp), parameter :: min_normal = 0.01_wp
   !> Relative pivot size below which a pivot is zero up to rounding [-].
   real(wp), parameter :: pivot_tolerance = 64*epsilon(1.0_wp)

   !> Ranges of incident speed and of angle to the surface for which a set was fitted, as squares of both ends:
   !> comparisons then need neither roots nor arcsines.
   type :: fitted_t
      real(wp) :: speed2(2) = [0.0_wp, huge(1.0_wp)]  !! [m2/s2]
      real(wp) :: sine2(2) = [0.0_wp, 1.0_wp]           !! [-]
   end type fitted_t

   !> Distribution of V_out = A V_in, where the elements a1..a9 (A row by row) are normal with mean m and a covariance;
   !> all [-].
   type :: impact_set_t
      real(wp) :: mean(entries) = 0.0_wp
      !> Covariances of V_out (11, 21, 31, 22, 32, 33), rows, as linear functions of the products of V_in
      !> (11, 22, 33, 21, 31, 32), columns.
      real(wp) :: covariance(6, 6) = 0.0_wp
      real(wp) :: rounding(3) = 0.0_wp  !! rounding error of a variance of V_out, over |V_in|**2
      type(fitted_t) :: fitted
   end type impact_set_t

   !> Distribution of V_out = A V_in for one V_in: normal, with the covariance S = F D F^T, F unit lower triangular, D
   !> diagonal.
   type :: velocity_distribution_t
      real(wp) :: mean_t, mean_n, mean_w        !! [m/s]
      real(wp) :: std_t, std_n, std_w           !! sqrt(D) [m/s]
      real(wp) :: factor21, factor31, factor32  !! F [-]
   end type velocity_distribution_t

   !> Result of one rebound.
   type :: rebound_t
      real(wp) :: v(3)            !! V_t, V_n, W after the rebound [m/s]
      integer :: draws = 1        !! number of draws of A
      logical :: forced = .false. !! no draw was admissible: the last draw was limited
   end type rebound_t

contains

   !> Build a set from its mean and covariance. Errors as in covariance_root.
   pure subroutine impact_set(mean, covariance, set, error)
      real(wp), intent(in) :: mean(entries), covariance(entries, entries)  !! mean and covariance of a1..a9 [-]
      type(impact_set_t), intent(out) :: set
      type(error_t), allocatable, intent(out) :: error
      real(wp), dimension(entries, entries) :: root, drawn

      call covariance_root("covariance", covariance, root, drawn, error)
      if (allocated(error)) return
      set%mean = mean
      call set_covariance(set, drawn)
   end subroutine impact_set

   !> Precompute the terms of the covariance C of A for `velocity_distribution`: S_ij = sum over k, l of C(3(i-1)+k,
   !> 3(j-1)+l) V_k V_l.
   pure subroutine set_covariance(set, c)
      type(impact_set_t), intent(inout) :: set
      real(wp), intent(in) :: c(entries, entries)  !! [-]
      integer, parameter :: row(6) = [1, 2, 3, 2, 3, 3], column(6) = [1, 1, 1, 2, 2, 3]
      integer, parameter :: low(6) = [1, 2, 3, 1, 1, 2], high(6) = [1, 2, 3, 2, 3, 3]
      integer :: n, m

      do m = 1, 6
         do n = 1, 6
            associate (i => 3*row(n) - 3, j => 3*column(n) - 3, k => low(m), l => high(m))
               set%covariance(n, m) = c(i + k, j + l)
               if (k /= l) set%covariance(n, m) = set%covariance(n, m) + c(i + l, j + k)
            end associate
         end do
      end do
      do n = 1, 3
         set%rounding(n) = pivot_tolerance*(c(3*n - 2, 3*n - 2) + c(3*n - 1, 3*n - 1) + c(3*n, 3*n))
      end do
   end subroutine set_covariance

   !> Covariance C + S (x) I of A + E. Adding noise |V_in| e to A V_in has the same effect, where A has the covariance
   !> C, e is normal with covariance S, and |V|**2 = V_t**2 + V_n**2 + W**2 (theory, chapter 5): |V_in| e is distributed
   !> as E V_in, where E has independent columns of covariance S.
   pure function with_noise(c, s) result(total)
      real(wp), intent(in) :: c(entries, entries), s(3, 3)  !! [-]
      real(wp) :: total(entries, entries)
      integer :: k

      total = c
      do k = 1, 3
         total(k::3, k::3) = total(k::3, k::3) + s
      end do
   end function with_noise

   !> Fitted ranges from the minimum and maximum of speed and angle.
   pure type(fitted_t) function fitted(speed, angle)
      real(wp), intent(in) :: speed(2)  !! [m/s]
      real(wp), intent(in) :: angle(2)  !! angle to the surface [degree]

      fitted%speed2 = speed**2
      fitted%sine2 = squared_sine(angle)
   end function fitted

   !> For speed and for angle: return 1 if an incoming velocity lies outside the fitted range, else 0.
   elemental subroutine beyond_fit(this, t, n, speed, angle)
      type(fitted_t), intent(in) :: this
      real(wp), intent(in) :: t, n          !! V_t, V_n [m/s]
      real(wp), intent(out) :: speed, angle
      real(wp) :: speed2, normal2

      normal2 = n*n
      speed2 = t*t + normal2
      speed = merge(1.0_wp, 0.0_wp, speed2 < this%speed2(1))
      speed = merge(1.0_wp, speed, speed2 > this%speed2(2))
      angle = merge(1.0_wp, 0.0_wp, normal2 < this%sine2(1)*speed2)
      angle = merge(1.0_wp, angle, normal2 > this%sine2(2)*speed2)
   end subroutine beyond_fit

   !> Number of the impact set for a ratio R_b/R_m, which is rounded and limited to 1..5 (theory, chapter 5). `outside`:
   !> the ratio is beyond 0.5..5.5, where no set is calibrated.
   pure subroutine find_nearest_set(ratio, number, outside)
      real(wp), intent(in) :: ratio  !! R_b/R_m [-]
      integer, intent(out) :: number
      logical, intent(out) :: outside

      outside = ratio < 0.5_wp .or. ratio > impact_ratios + 0.5_wp
      number = int(0.5_wp + max(1.0_wp, min(real(impact_ratios, wp), ratio)))
   end subroutine find_nearest_set

   !> Impact set for a ratio by stochastic interpolation: the lower or upper neighbour, with probabilities that
   !> interpolate linearly, within 1..5.
   pure integer function interpolated_set(ratio, u) result(number)
      real(wp), intent(in) :: ratio  !! R_b/R_m [-]
      real(wp), intent(in) :: u      !! uniform in (0, 1) [-]
      real(wp) :: within

      within = max(1.0_wp, min(real(impact_ratios, wp), ratio))
      number = int(within)
      if (u < within - number) number = number + 1
   end function interpolated_set

   !> Probability of each set for a ratio [-]: only the nearest set, or its two neighbours.
   pure function ratio_weights(ratio, between) result(weight)
      real(wp), intent(in) :: ratio  !! R_b/R_m [-]
      logical, intent(in) :: between
      real(wp) :: weight(impact_ratios)
      integer :: number
      logical :: outside

      weight = 0
      call find_nearest_set(ratio, number, outside)
      if (between) number = interpolated_set(ratio, 1.0_wp)
      weight(number) = 1
      if (.not. between .or. number == impact_ratios) return
      weight(number + 1) = max(0.0_wp, ratio - number)
      weight(number) = 1 - weight(number + 1)
   end function ratio_weights

   !> Draw a rebound: V_out = A V_in with a random A (eqs 4, 5). A draw is admissible if the boulder leaves the surface
   !> without gaining kinetic energy; otherwise A is redrawn, and after 32 draws the last draw is limited.
   !>
   !> Local frame: t along the tangential velocity before the impact, so V_t_in >= 0; n the surface normal, away from
   !> the ground, so V_n_in <= 0; W = R_b omega, > 0 for forward rolling. W is also a velocity, so A is dimensionless
   !> and a set applies to boulders of any size (our assumption; theory, chapter 5). R_t = V_t_out/V_t_in and R_n =
   !> -V_n_out/V_n_in (eqs 6, 7) are results of A, not inputs.
   pure subroutine rebound(set, table, key, boulder, impact, words, v_in, out)
      type(impact_set_t), intent(in) :: set
      type(normal_table_t), intent(in) :: table
      type(random_key_t), intent(in) :: key
      integer(i8), intent(in) :: boulder, impact
      integer(i8), intent(in) :: words(rebound_words)  !! random words of the first draw
      real(wp), intent(in) :: v_in(3)                  !! V_t, V_n, W [m/s]
      type(rebound_t), intent(out) :: out

      call draw_rebound(set, v_in(1), v_in(2), v_in(3), normal(table, words(1)), normal(table, words(2)), &
                        normal(table, words(3)), out%v(1), out%v(2), out%v(3))
      if (.not. is_admissible(v_in, out%v)) call redraw_rebound(set, table, key, boulder, impact, v_in, out)
   end subroutine rebound

   !> Draw V_out for V_in from three independent standard normal numbers.
   elemental subroutine draw_rebound(set, t_in, n_in, w_in, z1, z2, z3, t, n, w)
      type(impact_set_t), intent(in) :: set
      real(wp), intent(in) :: t_in, n_in, w_in  !! V_t, V_n, W before the rebound [m/s]
      real(wp), intent(in) :: z1, z2, z3        !! [-]
      real(wp), intent(out) :: t, n, w          !! V_t, V_n, W after the rebound [m/s]

      call draw_velocity(velocity_distribution(set, t_in, n_in, w_in), z1, z2, z3, t, n, w)
   end subroutine draw_rebound

   !> Continue to redraw after `out%draws` inadmissible draws.
   pure subroutine redraw_rebound(set, table, key, boulder, impact, v_in, out)
      type(impact_set_t), intent(in) :: set
      type(normal_table_t), intent(in) :: table
      type(random_key_t), intent(in) :: key
      integer(i8), intent(in) :: boulder, impact
      real(wp), intent(in) :: v_in(3)       !! V_t, V_n, W [m/s]
      type(rebound_t), intent(inout) :: out
      type(velocity_distribution_t) :: distribution
      integer(i8) :: again(words_per_block)
      real(wp) :: energy_in, z(rebound_words)
      integer :: draw

      energy_in = twice_energy(v_in)
      distribution = velocity_distribution(set, v_in(1), v_in(2), v_in(3))
      do draw = out%draws, max_draws - 1
         again = random_words(key, for_impact, boulder, impact, int(draw, i8))
         z = normal(table, again(:rebound_words))
         out%v = drawn_velocity(distribution, z)
         out%draws = out%draws + 1
         if (admissible(out%v(1), out%v(2), out%v(3), energy_in) > 0) return
      end do
      out%forced = .true.
      call limit_rebound(out%v, v_in)
   end subroutine redraw_rebound

   !> Distribution of A V_in: linear in the normal A, hence normal, with the mean m V_in and the covariance S of
   !> `set_covariance` (eqs 4, 5; theory, chapter 5). Three normal numbers sample it, instead of nine for A.
   elemental type(velocity_distribution_t) function velocity_distribution(set, t, n, w) result(distribution)
      type(impact_set_t), intent(in) :: set
      real(wp), intent(in) :: t, n, w  !! V_t, V_n, W before the rebound [m/s]
      real(wp) :: tt, nn, ww, nt, wt, wn, s11, s21, s31, s22, s32, s33, d1, d2, d3, sum2, zero1, zero2, zero3

      tt = t*t; nn = n*n; ww = w*w; nt = n*t; wt = w*t; wn = w*n
      associate (c => set%covariance, m => set%mean)
         s11 = c(1, 1)*tt + c(1, 2)*nn + c(1, 3)*ww + c(1, 4)*nt + c(1, 5)*wt + c(1, 6)*wn
         s21 = c(2, 1)*tt + c(2, 2)*nn + c(2, 3)*ww + c(2, 4)*nt + c(2, 5)*wt + c(2, 6)*wn
         s31 = c(3, 1)*tt + c(3, 2)*nn + c(3, 3)*ww + c(3, 4)*nt + c(3, 5)*wt + c(3, 6)*wn
         s22 = c(4, 1)*tt + c(4, 2)*nn + c(4, 3)*ww + c(4, 4)*nt + c(4, 5)*wt + c(4, 6)*wn
         s32 = c(5, 1)*tt + c(5, 2)*nn + c(5, 3)*ww + c(5, 4)*nt + c(5, 5)*wt + c(5, 6)*wn
         s33 = c(6, 1)*tt + c(6, 2)*nn + c(6, 3)*ww + c(6, 4)*nt + c(6, 5)*wt + c(6, 6)*wn
         distribution%mean_t = m(1)*t + m(2)*n + m(3)*w
         distribution%mean_n = m(4)*t + m(5)*n + m(6)*w
         distribution%mean_w = m(7)*t + m(8)*n + m(9)*w
      end associate
      sum2 = tt + nn + ww
      zero1 = set%rounding(1)*sum2
      zero2 = set%rounding(2)*sum2
      zero3 = set%rounding(3)*sum2
      d1 = s11
      distribution%factor21 = s21*inverse(d1, zero1)
      distribution%factor31 = s31*inverse(d1, zero1)
      d2 = s22 - distribution%factor21*s21
      s32 = s32 - distribution%factor31*s21
      distribution%factor32 = s32*inverse(d2, zero2)
      d3 = s33 - distribution%factor31*s31 - distribution%factor32*s32
      distribution%std_t = clipped_root(d1, zero1)
      distribution%std_n = clipped_root(d2, zero2)
      distribution%std_w = clipped_root(d3, zero3)
   end function velocity_distribution

   !> Return 1/x, or 0 if x is zero up to rounding.
   elemental real(wp) function inverse(x, zero)
      real(wp), intent(in) :: x, zero  !! any unit

      inverse = 1/merge(x, 1.0_wp, x > zero)
      inverse = merge(inverse, 0.0_wp, x > zero)
   end function inverse

   !> Return the square root of x, or 0 if x is zero up to rounding.
   elemental real(wp) function clipped_root(x, zero)
      real(wp), intent(in) :: x, zero  !! any unit

      clipped_root = sqrt(merge(x, 0.0_wp, x > zero))
   end function clipped_root

   !> Compute V_out [m/s] from three normal numbers.
   elemental subroutine draw_velocity(distribution, z1, z2, z3, t, n, w)
      type(velocity_distribution_t), intent(in) :: distribution
      real(wp), intent(in) :: z1, z2, z3  !! independent standard normal deviates [-]
      real(wp), intent(out) :: t, n, w    !! V_t, V_n, W after the rebound [m/s]
      real(wp) :: x1, x2

      x1 = distribution%std_t*z1
      x2 = distribution%std_n*z2
      t = distribution%mean_t + x1
      n = distribution%mean_n + distribution%factor21*x1 + x2
      w = distribution%mean_w + distribution%factor31*x1 + distribution%factor32*x2 + distribution%std_w*z3
   end subroutine draw_velocity

   !> Compute V_out [m/s] as an array.
   pure function drawn_velocity(distribution, z) result(v)
      type(velocity_distribution_t), intent(in) :: distribution
      real(wp), intent(in) :: z(3)  !! independent standard normal deviates [-]
      real(wp) :: v(3)              !! V_t, V_n, W after the rebound [m/s]

      call draw_velocity(distribution, z(1), z(2), z(3), v(1), v(2), v(3))
   end function drawn_velocity

   !> Twice the kinetic energy per mass [m2/s2]: V_t**2 + V_n**2 + I omega**2/m, I = 2/5 m R_b**2.
   pure real(wp) function twice_energy(v)
      real(wp), intent(in) :: v(3)  !! V_t, V_n, W [m/s]

      twice_energy = energy_of(v(1), v(2), v(3))
   end function twice_energy

   !> Twice the kinetic energy per mass [m2/s2], from components.
   elemental real(wp) function energy_of(t, n, w)
      real(wp), intent(in) :: t, n, w  !! V_t, V_n, W [m/s]

      energy_of = t*t + n*n + inertia_factor*w*w
   end function energy_of

   !> Return 1 if a rebound velocity is admissible (the boulder leaves the surface without gaining energy; theory,
   !> chapter 5), else 0.
   elemental real(wp) function admissible(t, n, w, energy_in)
      real(wp), intent(in) :: t, n, w    !! V_t, V_n, W after the rebound [m/s]
      real(wp), intent(in) :: energy_in  !! twice_energy before the rebound [m2/s2]

      admissible = merge(1.0_wp, 0.0_wp, n > 0)
      admissible = merge(admissible, 0.0_wp, energy_of(t, n, w) <= energy_in)
   end function admissible

   !> Return whether a rebound from one velocity to another is admissible.
   pure logical function is_admissible(v_in, v_out)
      real(wp), intent(in) :: v_in(3), v_out(3)  !! V_t, V_n, W [m/s]

      is_admissible = admissible(v_out(1), v_out(2), v_out(3), twice_energy(v_in)) > 0
   end function is_admissible

   !> Limit a rebound: V_n becomes 1 % of the incoming speed if it would not leave the surface; no energy is gained.
   pure subroutine limit_rebound(v, v_in)
      real(wp), intent(inout) :: v(3)  !! V_t, V_n, W after the rebound [m/s]
      real(wp), intent(in) :: v_in(3)  !! V_t, V_n, W before the rebound [m/s]

      if (v(2) <= 0) v(2) = min_normal*sqrt(v_in(1)**2 + v_in(2)**2)
      if (twice_energy(v) > twice_energy(v_in)) v = v*sqrt(twice_energy(v_in)/twice_energy(v))
   end subroutine limit_rebound
end module rockfall_impact
