! SPDX-License-Identifier: BSD-3-Clause
!> Histograms of rebounds: bins follow the definitions of the quantities, and every rebound counts once in each.
program test_histogram
   use rockfall_kinds, only: wp, i8
   use rockfall_histogram, only: histograms_t, empty_histograms, count_rebound, quantities, bin_width, &
      n_bins
   use check_m, only: check, finish
   implicit none

   real(wp), parameter :: degrees = 180/acos(-1.0_wp)

   call random_init(.true., .false.)
   call test_by_hand()
   call test_random()
   call test_ends()
   call finish()

contains

   !> Return whether one rebound was counted in these bins.
   logical function in_bins(v_in, v_out, bin)
      real(wp), intent(in) :: v_in(3), v_out(3)
      integer, intent(in) :: bin(quantities)
      type(histograms_t) :: this
      integer :: k

      this = empty_histograms()
      call count_rebound(this, v_in, v_out)
      in_bins = sum(this%count) == quantities
      do k = 1, quantities
         in_bins = in_bins .and. this%count(bin(k), k) == 1
      end do
   end function in_bins

   !> V_t = 3, V_n = -4, W = 5: 53.13 degrees, energies 9, 16 and 2/5*25 of 35.
   subroutine test_by_hand()
      call check("widths are as told", all(abs(bin_width - [2.0_wp, 0.02_wp, 0.02_wp, 0.02_wp, &
                                                            0.04_wp, 0.1_wp]) <= 0))
      call check("bins cover their ranges", all(n_bins == [45, 50, 50, 50, 50, 50]))
      ! 26.57 = 53.13/2, 12.86 = 9/35/0.02, 22.86, 14.29; R_t = 0.5 = 12.5*0.04; R_n = 0.3125 = 3.125*0.1
      call check("by hand", in_bins([3.0_wp, -4.0_wp, 5.0_wp], [1.5_wp, 1.25_wp, 0.0_wp], &
                                    [27, 13, 23, 15, 13, 4]))
      call check("the sense of the spin does not matter", &
                 in_bins([3.0_wp, -4.0_wp, -5.0_wp], [1.5_wp, 1.25_wp, 9.0_wp], &
                         [27, 13, 23, 15, 13, 4]))
   end subroutine test_by_hand

   !> Bins of 10**5 rebounds, computed from the definitions with the compiler's arctangent.
   subroutine test_random()
      type(histograms_t) :: this
      integer(i8) :: want(size(this%count, 1), quantities)
      real(wp) :: v_in(3), v_out(3), energy, value(quantities)
      integer :: k, q, bin

      this = empty_histograms()
      want = 0
      do k = 1, 100000
         call random_number(v_in)
         call random_number(v_out)
         v_in = 20*[v_in(1), -v_in(2), v_in(3) - 0.5_wp]
         v_out = 10*[v_out(1) - 0.2_wp, v_out(2), v_out(3)]
         call count_rebound(this, v_in, v_out)
         energy = v_in(1)**2 + v_in(2)**2 + 0.4_wp*v_in(3)**2
         value = [atan2(-v_in(2), v_in(1))*degrees, v_in(1)**2/energy, v_in(2)**2/energy, &
                  0.4_wp*v_in(3)**2/energy, &
                  v_out(1)/v_in(1), -v_out(2)/v_in(2)]
         do q = 1, quantities
            bin = 1 + floor(max(0.0_wp, min(60.0_wp, value(q)/bin_width(q))))
            bin = min(bin, n_bins(q))
            want(bin, q) = want(bin, q) + 1
         end do
      end do
      call check("every rebound is counted in each", all(sum(this%count, 1) == 100000))
      call check("in the bins of the definitions", all(this%count == want))
   end subroutine test_random

   !> Smaller and larger values count in the first and last bin, also if a ratio is undefined.
   subroutine test_ends()
      call check("straight down", in_bins([0.0_wp, -3.0_wp, 0.0_wp], [0.0_wp, 1.5_wp, 0.0_wp], &
                                          [45, 1, 50, 1, 50, 6]))
      call check("straight down, off sideways", &
                 in_bins([0.0_wp, -3.0_wp, 0.0_wp], [1.0_wp, 1.5_wp, 0.0_wp], &
                         [45, 1, 50, 1, 50, 6]))
      call check("along the ground", &
                 in_bins([3.0_wp, 0.0_wp, 0.0_wp], [6.0_wp, 1.0_wp, 0.0_wp], [1, 50, 1, 1, 50, 50]))
      call check("bounced back", &
                 in_bins([5.0_wp, -3.0_wp, 0.0_wp], [-1.0_wp, 50.0_wp, 0.0_wp], &
                         [16, 37, 14, 1, 1, 50]))
      call check("almost no normal speed", &
                 in_bins([3.0_wp, -1.0e-300_wp, 0.0_wp], [1.5_wp, 1.0_wp, 0.0_wp], &
                         [1, 50, 1, 1, 13, 50]))
   end subroutine test_ends
end program test_histogram
