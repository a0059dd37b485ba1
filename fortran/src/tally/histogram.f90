! SPDX-License-Identifier: BSD-3-Clause
!> Histograms of all rebounds (Bourrier et al. 2009, section 3.6 and eqs 6-11).
module rockfall_histogram
   use rockfall_kinds, only: wp, i8
   use rockfall_dimensions, only: n_histograms
   use rockfall_math, only: degree, sine_cosine
   use rockfall_boulder, only: inertia_factor
   implicit none
   private
   public :: histograms_t, empty_histograms, count_rebound, bins, quantities, bin_width, n_bins

   integer, parameter :: bins = 50, quantities = n_histograms  !! maximum number of bins; number of quantities
   !> Quantities of histograms: incidence angle [degree]; tangential, normal and rotational fraction of the
   !> incident energy (eqs 8-11); R_t and R_n (eqs 6, 7) [-]. Bins start at zero; the first and last also count smaller
   !> and larger values.
   integer, parameter :: angle = 1, tangential = 2, normal = 3, rotational = 4, r_t = 5, r_n = 6
   real(wp), parameter :: bin_width(quantities) = [2.0_wp, 0.02_wp, 0.02_wp, 0.02_wp, 0.04_wp, 0.1_wp]
   integer, parameter :: n_bins(quantities) = [45, 50, 50, 50, 50, 50]

   type :: histograms_t
      integer(i8) :: count(bins, quantities) = 0
      real(wp) :: sine2(n_bins(angle) - 1) = 0.0_wp  !! squared sines of the inner edges of the angle bins [-]
   end type histograms_t

contains

   !> Create empty histograms.
   pure function empty_histograms() result(this)
      type(histograms_t) :: this
      real(wp) :: s, c
      integer :: k

      do k = 1, (n_bins(angle) - 1)/2  ! edges up to 44 degrees; the remaining edges by symmetry
         call sine_cosine(bin_width(angle)*k*degree, s, c)
         this%sine2(k) = s*s
         this%sine2(n_bins(angle) - k) = c*c
      end do
   end function empty_histograms

   !> Count one rebound. The incident energy is V_t**2 + V_n**2 + (I/m R_b**2) W**2 up to a factor; the angle is found
   !> from its squared sine, without libm.
   pure subroutine count_rebound(this, v_in, v_out)
      type(histograms_t), intent(inout) :: this
      real(wp), intent(in) :: v_in(3), v_out(3)  !! V_t, V_n, W before and after [m/s]
      real(wp) :: parts(3), energy

      parts = v_in**2*[1.0_wp, 1.0_wp, inertia_factor]
      energy = sum(parts)
      if (energy <= 0) return
      call increment(this, angle, 1 + count(parts(2) >= this%sine2*(parts(1) + parts(2))))
      call increment(this, tangential, bin_of(parts(1)/energy, tangential))
      call increment(this, normal, bin_of(parts(2)/energy, normal))
      call increment(this, rotational, bin_of(parts(3)/energy, rotational))
      call increment(this, r_t, bin_of_ratio(v_out(1), v_in(1), r_t))
      call increment(this, r_n, bin_of_ratio(v_out(2), -v_in(2), r_n))
   end subroutine count_rebound

   pure subroutine increment(this, quantity, bin)
      type(histograms_t), intent(inout) :: this
      integer, intent(in) :: quantity, bin

      this%count(bin, quantity) = this%count(bin, quantity) + 1
   end subroutine increment

   pure integer function bin_of(value, quantity)
      real(wp), intent(in) :: value  !! in the unit of the quantity
      integer, intent(in) :: quantity

      bin_of = 1 + int(max(0.0_wp, min(n_bins(quantity) - 1.0_wp, value/bin_width(quantity))))
   end function bin_of

   !> Bin of a/b, b >= 0, without overflow for tiny b.
   pure integer function bin_of_ratio(a, b, quantity)
      real(wp), intent(in) :: a, b  !! [m/s]
      integer, intent(in) :: quantity

      bin_of_ratio = n_bins(quantity)
      if (a < n_bins(quantity)*bin_width(quantity)*b) then
         bin_of_ratio = 1
         if (a > 0) bin_of_ratio = bin_of(a/b, quantity)
      end if
   end function bin_of_ratio
end module rockfall_histogram
