! SPDX-License-Identifier: BSD-3-Clause
!> Samples: every number is in its bin, sums beyond 64 bits are exact, the largest values are kept, and files have the
!> same blocks in any order.
program test_samples
   use rockfall_kinds, only: wp, sp, i8
   use rockfall_samples, only: samples_t, add_numbers, add_tail, add_tails, allocate_samples, free_samples, &
                               merge_samples, list_blocks, find_blocks, sample_bin, sample_edge, sample_size, &
                               sample_sum, n_sample_bins, largest_unit
   use check_m, only: check, check_close, finish
   implicit none

   call random_init(.true., .false.)
   call test_bins()
   call test_sums()
   call test_tail()
   call test_length_of_tails()
   call test_blocks()
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
      logical :: fit

      call allocate_samples(samples, 1, 1, 1, 1, 1, 0, 3000_i8, .false., fit)
      do k = 1, 3000
         call add_numbers(samples, [numbers(mod(k, 3) + 1)], 1, [1], [1], 1)
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
      call check("a block for each coarse bin that has any", samples%blocks == 3)
      call free_samples(samples)
   end subroutine test_sums

   subroutine test_tail()
      real(sp) :: numbers(1000), heap(100), low
      logical :: ordered
      integer :: k

      call random_number(numbers)
      numbers(:3) = numbers(3)  ! equal numbers
      heap = 0
      ordered = .true.
      do k = 1, 1000
         call add_tail(heap, min(k - 1, 100), numbers(k))
         associate (known => heap(:min(k, 100)))
            ordered = ordered .and. all(known(2::2) >= known(:size(known)/2)) &
                      .and. all(known(3::2) >= known(:(size(known) - 1)/2)) .and. all(heap(k + 1:) <= 0)
         end associate
      end do
      call check("no number is smaller than the one above it, and none is beyond those known", ordered)
      low = minval(heap)
      call check("the least of the largest is the first", low >= heap(1) .and. low <= heap(1))
      call check("nothing larger was left out", count(numbers > low) < 100 .and. count(numbers >= low) >= 100)
      call check("all that are larger are there", abs(sum(pack(numbers, numbers > low)) - sum(pack(heap, heap > low))) &
                 < 1.0e-4_sp)
   end subroutine test_tail

   !> A line keeps all numbers of few boulders. Of many boulders, it keeps 100,000 if lines are few, and the number
   !> needed for a return level if lines are many.
   subroutine test_length_of_tails()
      call check("all of few boulders", length(1, 500_i8, .false.) == 500)
      call check("100,000 at one line", length(1, 10_i8**7, .false.) == 100000)
      call check("2,002 at thousands", length(4000, 10_i8**7, .false.) == 2002)
      call check("100,000 where sources are a sample, and boulders depend on one another", &
                 length(4000, 10_i8**7, .true.) == 100000)

   end subroutine test_length_of_tails

   integer function length(lines, boulders, sampled)
      integer, intent(in) :: lines
      integer(i8), intent(in) :: boulders
      logical, intent(in) :: sampled
      type(samples_t) :: samples
      logical :: fit

      call allocate_samples(samples, 1, 1, 1, lines + 1, 1, 1, boulders, sampled, fit)
      length = size(samples%largest, 1)
      call free_samples(samples)
   end function length

   !> Blocks do not depend on the order of numbers; samples that are read and merged equal those of all numbers.
   subroutine test_blocks()
      type(samples_t) :: samples(3), read
      integer(i8), allocatable :: places(:), others(:)
      integer(i8) :: numbers(2000)
      real(wp) :: draw
      integer :: k
      logical :: fit

      do k = 1, size(numbers)
         call random_number(draw)
         numbers(k) = int(2.0_wp**(draw*30), i8) - 5
      end do
      do k = 1, 3
         call allocate_samples(samples(k), 2, 2, 1, 3, 1, 1, 2000_i8, .false., fit)
      end do
      call allocate_samples(read, 2, 2, 1, 3, 1, 1, 2000_i8, .false., fit)
      do k = 1, size(numbers)
         call add(samples(1), numbers(k), k)
         call add(samples(2), numbers(size(numbers) + 1 - k), size(numbers) + 1 - k)
         if (mod(k, 2) == 1) call add(samples(3), numbers(k), k)
      end do
      call list_blocks(samples(1), places)
      call list_blocks(samples(2), others)
      call check("the same blocks", size(places) == samples(1)%blocks .and. size(others) == size(places))
      call check("in the same order", all(places == others) .and. all(places(2:) > places(:size(places) - 1)))
      call check("with the same counts", is_same(samples(1), samples(2)))
      call list_blocks(samples(3), places)
      read%blocks = samples(3)%blocks
      read%counts(:, :read%blocks) = samples(3)%counts(:, :read%blocks)
      read%groups = samples(3)%groups
      read%sums = samples(3)%sums
      read%largest = samples(3)%largest
      call find_blocks(read, places)
      call check("as many numbers of tails", all(read%known == samples(3)%known) .and. sum(read%known) > 0)
      do k = 2, size(numbers), 2
         call add(read, numbers(k), k)
      end do
      call list_blocks(read, places)
      call check("read again, they go on", size(places) == size(others) .and. is_same(read, samples(1)))
      call merge_samples(samples(3), samples(1))
      call check("merged, they are more", sample_size(samples(3), 1, 2) + sample_size(samples(3), 2, 3) > 0 .and. &
                 total(samples(3)) == 3000)
      do k = 1, 3
         call free_samples(samples(k))
      end do
      call free_samples(read)
   end subroutine test_blocks

   subroutine add(samples, number, k)
      type(samples_t), intent(inout) :: samples
      integer(i8), intent(in) :: number
      integer, intent(in) :: k

      associate (place => mod(k, 3) + 1)
         call add_numbers(samples, [number], mod(k/3, 2) + 1, [mod(k/7, 2) + 1], [1], place)
         if (place > 1 .and. mod(k/3, 2) == 0) &
            call add_tails(samples, place - 1, reshape([real(number + 5, sp)], [1, 1]))
      end associate
   end subroutine add

   logical function is_same(one, other)
      type(samples_t), intent(in) :: one, other

      is_same = one%blocks == other%blocks
      if (is_same) is_same = all(one%counts(:, :one%blocks) == other%counts(:, :one%blocks)) &
                             .and. all(one%sums == other%sums) .and. all(one%known == other%known)
   end function is_same

   integer(i8) function total(samples)
      type(samples_t), intent(in) :: samples
      integer :: i, j

      total = sum([((sample_size(samples, i, j), i=1, 2), j=1, 3)])
   end function total
end program test_samples
