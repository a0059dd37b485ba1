! SPDX-License-Identifier: BSD-3-Clause
!> Samples: every number lies in its bin, sums are exact beyond 64 bits, and the largest are the largest, in any order.
program test_samples
   use rockfall_kinds, only: wp, i4, i8
   use rockfall_samples, only: samples_t, add_number, add_tail, restore_tails, sample_bin, sample_edge, sample_size, &
                               sample_sum, n_sample_bins, n_coarse_bins, n_words, largest_unit
   use check_m, only: check, check_close, finish
   implicit none

   call random_init(.true., .false.)
   call test_bins()
   call test_sums()
   call test_tail()
   call test_stored_tails()
   call finish()

contains

   subroutine test_bins()
      integer(i8) :: number
      integer :: k
      real(wp) :: draw
      logical :: inside, narrow

      inside = .true.
      do k = 1, 100000
         call random_number(draw)
         number = int(2.0_wp**(draw*44.9_wp), i8) - 1
         if (mod(k, 2) == 0) number = -mod(number, 2_i8**20)
         associate (bin => sample_bin(number))
            inside = inside .and. number > sample_edge(bin) .and. number < sample_edge(bin + 1)
         end associate
      end do
      call check("whole numbers lie within their bins", inside)
      narrow = .true.
      do k = 1, n_sample_bins
         associate (low => sample_edge(k), high => sample_edge(k + 1))
            narrow = narrow .and. high - low <= max(1.0_wp, min(abs(low), abs(high))/255)
         end associate
      end do
      call check("bins are 0.4 % wide or of one number", narrow)
      call check("beyond are the last ones", sample_bin(huge(1_i8)) == n_sample_bins &
                 .and. sample_bin(-huge(1_i8)) == 1)
   end subroutine test_bins

   subroutine test_sums()
      type(samples_t) :: samples
      integer(i8), parameter :: numbers(3) = [largest_unit, -largest_unit + 7, 12_i8]
      integer :: k

      allocate (samples%bins(n_sample_bins, 1, 1, 1), samples%groups(n_coarse_bins, 1, 1, 1), source=0_i4)
      allocate (samples%sums(n_words, 1, 1, 1), source=0_i8)
      do k = 1, 3000
         call add_number(samples, numbers(mod(k, 3) + 1), 1, 1, 1, 1)
      end do
      associate (words => samples%sums(:, 1, 1, 1))
         call check("a sum of both signs is exact", words(1) == 0 .and. words(2) == 19000)
         call check_close("squares pass 64 bits", scale(real(words(3), wp), 62) + words(4), &
                          1000*(2.0_wp**90 + (2.0_wp**45 - 7)**2 + 144), 1.0e-15_wp)
         call check("digits are below their base", words(4) >= 0 .and. shiftr(words(4), 62) == 0)
         call check("the maximum", words(5) == largest_unit)
      end associate
      call check("so many numbers", sample_size(samples, 1, 1) == 3000 .and. sum(samples%groups) == 3000)
      call check_close("their sum", sample_sum(samples, 1, 1), 19000.0_wp, 0.0_wp)
   end subroutine test_sums

   subroutine test_tail()
      real(wp) :: numbers(1000), heap(100), low
      logical :: first, ordered
      integer :: k, vacant

      call random_number(numbers)
      numbers(:3) = numbers(3)  ! equal ones
      heap = -1
      vacant = size(heap)
      first = .true.
      ordered = .true.
      do k = 1, 1000
         call add_tail(heap, vacant, numbers(k))
         first = first .and. vacant == max(0, 100 - k) .and. all(heap(:vacant) < 0) .and. all(heap(vacant + 1:) >= 0)
         ordered = ordered .and. all(heap(2::2) >= heap(:50)) .and. all(heap(3::2) >= heap(:49))
      end do
      call check("nodes without a number come first", first)
      call check("no number is smaller than the one above it", ordered)
      low = minval(heap)
      call check("the least of the largest is the first", low >= heap(1) .and. low <= heap(1))
      call check("nothing larger was left out", count(numbers > low) < 100 .and. count(numbers >= low) >= 100)
      call check("all that are larger are there", abs(sum(pack(numbers, numbers > low)) - sum(pack(heap, heap > low))) &
                 < 1.0e-12_wp)
      heap = -1
      vacant = size(heap)
      call add_tail(heap, vacant, 0.0_wp)
      call check("a single one leaves room", count(heap < 0) == 99 .and. count(heap >= 0) == 1)
   end subroutine test_tail

   !> Heaps of version 1.0.0, whose nodes without a number are not the first ones.
   subroutine test_stored_tails()
      type(samples_t) :: samples
      real(wp), target :: largest(7, 1, 2)

      largest(:, 1, 1) = [-1.0_wp, -1.0_wp, 5.0_wp, -1.0_wp, -1.0_wp, 7.0_wp, 6.0_wp]
      largest(:, 1, 2) = [-1.0_wp, -1.0_wp, 3.0_wp, 4.0_wp, 5.0_wp, 8.0_wp, 7.0_wp]
      samples%largest => largest
      call restore_tails(samples)
      call check("number of nodes without a number", all(samples%vacant(1, :) == [4, 2]))
      call check("they are the first ones", all(largest(:4, 1, 1) < 0) .and. all(largest(5:, 1, 1) > 0))
      call check_close("the same numbers", sum(largest(5:, 1, 1)), 18.0_wp, 0.0_wp)
      call check("heaps that have them first stay", all(nint(largest(3:, 1, 2)) == [3, 4, 5, 8, 7]))
   end subroutine test_stored_tails
end program test_samples
