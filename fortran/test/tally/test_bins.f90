! SPDX-License-Identifier: BSD-3-Clause
!> Logarithmic bins: every number is between the edges of its bin, and quantiles of counts agree with those of the
!> numbers to within a bin.
program test_bins
   use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_positive_inf
   use rockfall_kinds, only: wp, i4
   use rockfall_bins, only: n_log_bins, log_bin, log_bin_edge, log_bin_quantile, log_bin_value, energy, speed, &
      jump_height
   use check_m, only: check, check_close, finish
   implicit none

   call random_init(.true., .false.)
   call test_edges()
   call test_quantiles()
   call finish()

contains

   subroutine test_edges()
      real(wp) :: x, draw
      integer :: quantity, k
      logical :: inside, narrow, own

      call check("ranges are as told", all(abs([log_bin_edge(energy, 2), log_bin_edge(speed, 2), &
         log_bin_edge(jump_height, 2), log_bin_edge(energy, n_log_bins(energy)), &
         log_bin_edge(speed, n_log_bins(speed)), &
         log_bin_edge(jump_height, n_log_bins(jump_height))] - [64.0_wp, 0.25_wp, 0.0625_wp, 2.0_wp**33, 256.0_wp, &
                                                             512.0_wp]) <= 0))
      do quantity = 1, 3
         inside = .true.
         do k = 1, 10000
            call random_number(draw)
            x = 2.0_wp**(60*draw - 20)
            associate (bin => log_bin(quantity, x))
               inside = inside .and. x >= log_bin_edge(quantity, bin)
               if (bin < n_log_bins(quantity)) inside = inside .and. x < log_bin_edge(quantity, bin + 1)
            end associate
         end do
         call check("numbers lie in their bins", inside)
         own = .true.
         narrow = .true.
         do k = 2, n_log_bins(quantity) - 1
            associate (low => log_bin_edge(quantity, k), high => log_bin_edge(quantity, k + 1))
               own = own .and. log_bin(quantity, low) == k .and. log_bin(quantity, nearest(high, -1.0_wp)) == k
               narrow = narrow .and. high <= 1.25_wp*low .and. high > 1.14_wp*low
            end associate
         end do
         call check("a lower edge belongs to its bin, an upper one to the next", own)
         call check("bins are 14 to 25 % wide", narrow)
         call check("nothing and little are in the first", log_bin(quantity, 0.0_wp) == 1 &
                    .and. log_bin(quantity, tiny(x)) == 1)
         call check("whatever is great in the last", log_bin(quantity, huge(x)) == n_log_bins(quantity) &
                    .and. log_bin(quantity, ieee_value(x, ieee_positive_inf)) == n_log_bins(quantity))
      end do
   end subroutine test_edges

   subroutine test_quantiles()
      integer, parameter :: n = 20000
      integer(i4) :: counts(n_log_bins(speed))
      real(wp) :: x(n), p
      integer :: k
      logical :: close_enough

      counts = 0
      do k = 1, n  ! uniform from 3 to 40 m/s
         x(k) = 3 + 37*(k - 0.5_wp)/n
         counts(log_bin(speed, x(k))) = counts(log_bin(speed, x(k))) + 1
      end do
      close_enough = .true.
      do k = 1, 99
         p = k/100.0_wp
         close_enough = close_enough .and. abs(log_bin_quantile(speed, counts, p) - (3 + 37*p)) < 0.25_wp
      end do
      call check("quantiles of even numbers, but for the bins at their ends", close_enough)
      call check_close("within a full bin straight", log_bin_quantile(speed, counts, 0.5_wp), 21.5_wp, 1.0e-3_wp)
      counts = 0
      counts(log_bin(speed, 10.0_wp)) = 7
      call check_close("all in one bin: the middle of its first seventh", log_bin_quantile(speed, counts, 0.0_wp), &
                       10 + 1/7.0_wp, 1.0e-14_wp)
      call check_close("and of its last", log_bin_quantile(speed, counts, 1.0_wp), 12 - 1/7.0_wp, 1.0e-14_wp)
      call check_close("the second of seven", log_bin_quantile(speed, counts, 1/6.0_wp), 10 + 3/7.0_wp, 1.0e-14_wp)
      call check_close("that the third lies at", log_bin_value(speed, counts, 2.5_wp), 10 + 5/7.0_wp, 1.0e-14_wp)
      counts(n_log_bins(speed)) = 7
      call check_close("beyond all bins: where they end", log_bin_quantile(speed, counts, 0.95_wp), 256.0_wp, 0.0_wp)
   end subroutine test_quantiles
end program test_bins
