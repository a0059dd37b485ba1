! SPDX-License-Identifier: BSD-3-Clause
!> Histograms over all rebounds (Bourrier et al. 2009, section 3.6 and eqs 6-11).
module rockfall_histogram
   use rockfall_kinds, only: wp, i8
   use rockfall_math, only: degree, sine_cosine
   use rockfall_boulder, only: spin_inertia
   implicit none
   private
   public :: histograms_t, histograms, count_rebound, bins, quantities, bin_width, n_bins

   integer, parameter :: bins = 50, quantities = 6
   !> Incidence angle [degrees], tangential, normal and rotational share of the incident energy, R_t, R_n.
   !> Bins start at zero; the first and the last also hold what lies below and above.
   real(wp), parameter :: bin_width(quantities) = [2.0_wp, 0.02_wp, 0.02_wp, 0.02_wp, 0.04_wp, 0.1_wp]
   integer, parameter :: n_bins(quantities) = [45, 50, 50, 50, 50, 50]

   type :: histograms_t
      integer(i8) :: count(bins, quantities) = 0
      real(wp) :: sine2(44) = 0.0_wp  !! squared sines of the inner edges of the angle's bins
   end type histograms_t

contains

   !> Empty histograms.
   pure function histograms() result(this)
      type(histograms_t) :: this
      real(wp) :: s, c
      integer :: k

      do k = 1, 22  ! 2 to 44 degrees; the rest by symmetry
         call sine_cosine(bin_width(1)*k*degree, s, c)
         this%sine2(k) = s*s
         this%sine2(45 - k) = c*c
      end do
   end function histograms

   !> Count one rebound.
   pure subroutine count_rebound(this, v_in, v_out)
      type(histograms_t), intent(inout) :: this
      real(wp), intent(in) :: v_in(3), v_out(3)  !! V_t, V_n, W before and after [m/s]
      real(wp) :: part(3), energy

      part = v_in**2*[1.0_wp, 1.0_wp, spin_inertia]
      energy = sum(part)
      if (energy <= 0) return
      call add(this, 1, 1 + count(part(2) >= this%sine2*(part(1) + part(2))))
      call add(this, 2, bin_of(part(1)/energy, 2))
      call add(this, 3, bin_of(part(2)/energy, 3))
      call add(this, 4, bin_of(part(3)/energy, 4))
      call add(this, 5, bin_of_ratio(v_out(1), v_in(1), 5))
      call add(this, 6, bin_of_ratio(v_out(2), -v_in(2), 6))
   end subroutine count_rebound

   pure subroutine add(this, quantity, bin)
      type(histograms_t), intent(inout) :: this
      integer, intent(in) :: quantity, bin

      this%count(bin, quantity) = this%count(bin, quantity) + 1
   end subroutine add

   pure integer function bin_of(value, quantity)
      real(wp), intent(in) :: value
      integer, intent(in) :: quantity

      bin_of = 1 + int(max(0.0_wp, min(n_bins(quantity) - 1.0_wp, value/bin_width(quantity))))
   end function bin_of

   !> Bin of a/b, b >= 0; without overflow when b is tiny.
   pure integer function bin_of_ratio(a, b, quantity)
      real(wp), intent(in) :: a, b
      integer, intent(in) :: quantity

      bin_of_ratio = n_bins(quantity)
      if (a < n_bins(quantity)*bin_width(quantity)*b) then
         bin_of_ratio = 1
         if (a > 0) bin_of_ratio = bin_of(a/b, quantity)
      end if
   end function bin_of_ratio
end module rockfall_histogram
