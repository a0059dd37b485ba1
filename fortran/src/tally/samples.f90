! SPDX-License-Identifier: BSD-3-Clause
!> Samples of numbers that are not stored individually: counts in narrow bins, exact sums, and the largest numbers. All
!> are integers or a set, so neither the order nor the partition of the numbers changes a bit.
module rockfall_samples
   use, intrinsic :: iso_c_binding, only: c_ptr, c_null_ptr, c_associated, c_f_pointer
   use rockfall_kinds, only: wp, i4, i8, i16
   use rockfall_memory, only: zeroed_block, free_block
   implicit none
   private
   public :: samples_t, add_number, add_tail, restore_tails, merge_samples, sample_bin, sample_edge
   public :: sample_size, sample_sum, allocate_samples, continue_samples, free_samples, forget_samples
   public :: filled_bins_t, fill_bins, filled_bins
   public :: n_sample_bins, n_coarse_bins, n_words, base_bits, largest_unit

   !> Bins of integers: width 1 below 512, then 256 per octave, so that no bin is wider than 0.4 % of its numbers; up to
   !> 2**45, and down to -2**20.
   integer, parameter :: per_octave = 256, first_octave = 8
   integer, parameter :: below_zero = 3328, from_zero = 9728
   integer, parameter :: n_sample_bins = below_zero + from_zero
   integer, parameter :: bins_per_coarse = 64, n_coarse_bins = n_sample_bins/bins_per_coarse
   integer(i8), parameter :: largest_unit = 2_i8**45  !! larger numbers are clamped
   !> Words of a sum and of a sum of squares, two digits each to the base 2**62; then the maximum.
   integer, parameter :: n_words = 5, base_bits = 62
   integer, parameter :: n_largest = 100000  !! number of largest values stored individually

   !> Samples of `quantities` at each of `places` (the ends of boulders, then each line).
   type :: samples_t
      integer(i4), pointer, contiguous :: bins(:, :, :, :) => null()    !! (bins, quantities, parts, places)
      integer(i8), pointer, contiguous :: sums(:, :, :, :) => null()    !! (words, quantities, parts, places)
      integer(i4), pointer, contiguous :: groups(:, :, :, :) => null()  !! (coarse bins, quantities, groups, places)
      real(wp), pointer, contiguous :: largest(:, :, :) => null()       !! heaps, -1 = none (numbers, tails, lines)
      integer, allocatable :: vacant(:, :)                              !! nodes without a number (tails, lines)
      integer(i8), pointer, contiguous :: ended(:) => null()            !! boulders by status
      type(c_ptr), private :: block(5) = c_null_ptr                     !! of memory: bins, groups, sums, ended, largest
   end type samples_t

   !> Bins that are not empty, 0-based over all dimensions, in order, and their counts.
   type :: filled_bins_t
      integer(i8), allocatable :: bin(:)
      integer(i4), allocatable :: count(:)
   end type filled_bins_t

contains

   !> Allocate empty samples, if they fit in memory: of quantities by part and coarsely by group, at all places; of the
   !> boulders by status; and `numbers` of each tail at lines.
   subroutine allocate_samples(samples, quantities, parts, groups, places, statuses, tails, numbers, fit)
      type(samples_t), intent(inout) :: samples
      integer, intent(in) :: quantities, parts, groups, places, statuses, tails
      integer(i8), intent(in) :: numbers
      logical, intent(out) :: fit
      integer(i8) :: n
      integer :: k

      n = int(quantities, i8)*places
      associate (block => samples%block)
         block(1) = zeroed_block(n_sample_bins*parts*n, 4)
         block(2) = zeroed_block(n_coarse_bins*groups*n, 4)
         block(3) = zeroed_block(n_words*parts*n, 8)
         block(4) = zeroed_block(int(statuses, i8), 8)
         fit = all([(c_associated(block(k)), k=1, 4)])
         if (.not. fit) return
         call c_f_pointer(block(1), samples%bins, [n_sample_bins, quantities, parts, places])
         call c_f_pointer(block(2), samples%groups, [n_coarse_bins, quantities, groups, places])
         call c_f_pointer(block(3), samples%sums, [n_words, quantities, parts, places])
         call c_f_pointer(block(4), samples%ended, [statuses])
      end associate
      call allocate_tails(samples, tails, places - 1, numbers, fit)
   end subroutine allocate_samples

   !> Allocate tails without a number.
   subroutine allocate_tails(samples, tails, lines, numbers, fit)
      type(samples_t), intent(inout) :: samples
      integer, intent(in) :: tails, lines
      integer(i8), intent(in) :: numbers
      logical, intent(out) :: fit
      integer :: shape(3)

      shape = [int(min(numbers, int(n_largest, i8))), tails, lines]
      samples%block(5) = zeroed_block(product(int(shape, i8)), 8)
      fit = c_associated(samples%block(5))
      if (.not. fit) return
      call c_f_pointer(samples%block(5), samples%largest, shape)
      samples%largest = -1
      samples%vacant = spread(spread(shape(1), 1, tails), 2, lines)
   end subroutine allocate_tails

   !> Continue samples with longer tails of up to `numbers`, if they fit in memory; the rest is moved.
   subroutine continue_samples(from, to, numbers, fit)
      type(samples_t), intent(inout) :: from
      type(samples_t), intent(inout) :: to
      integer(i8), intent(in) :: numbers
      logical, intent(out) :: fit

      to = from
      from%block(:4) = c_null_ptr
      call allocate_tails(to, size(from%largest, 2), size(from%largest, 3), numbers, fit)
      if (fit) call merge_tails(to, from%largest)
   end subroutine continue_samples

   !> Free the memory.
   subroutine free_samples(samples)
      type(samples_t), intent(inout) :: samples

      call free_block(samples%block)
   end subroutine free_samples

   !> Forget the bins once all results are computed.
   subroutine forget_samples(samples)
      type(samples_t), intent(inout) :: samples

      call free_block(samples%block(:2))
      call c_f_pointer(c_null_ptr, samples%bins, [0, 0, 0, 0])
      call c_f_pointer(c_null_ptr, samples%groups, [0, 0, 0, 0])
   end subroutine forget_samples

   !> Bins of n that are not empty.
   pure type(filled_bins_t) function filled_bins(n, counts) result(filled)
      integer(i8), intent(in) :: n
      integer(i4), intent(in) :: counts(n)
      integer(i8) :: k, last

      allocate (filled%bin(count(counts /= 0, kind=i8)))
      last = 0
      do k = 1, n
         if (counts(k) == 0) cycle
         last = last + 1
         filled%bin(last) = k - 1
      end do
      filled%count = counts(filled%bin + 1)
   end function filled_bins

   !> Fill n empty bins.
   pure subroutine fill_bins(n, filled, counts)
      integer(i8), intent(in) :: n
      type(filled_bins_t), intent(in) :: filled
      integer(i4), intent(inout) :: counts(n)

      counts(filled%bin + 1) = filled%count
   end subroutine fill_bins

   !> Bin of an integer number of units, from 1.
   pure integer function sample_bin(number) result(bin)
      integer(i8), intent(in) :: number
      integer(i8) :: size
      integer :: octave

      size = min(abs(number), largest_unit - 1)
      octave = max(0, int(bit_size(size)) - 1 - leadz(size) - first_octave)
      bin = per_octave*octave + int(shiftr(size, octave))
      bin = below_zero + 1 + merge(bin, -min(bin, below_zero), number >= 0)
   end function sample_bin

   !> Lower edge of a bin, in units, before rounding to integers; past the last bin: its upper edge.
   pure real(wp) function sample_edge(bin) result(edge)
      integer, intent(in) :: bin
      integer :: place, octave

      place = abs(bin - below_zero - 1)
      if (bin <= below_zero) place = place + 1
      octave = max(0, place/per_octave - 1)
      edge = scale(real(place - per_octave*octave, wp), octave) - 0.5_wp
      if (bin <= below_zero) edge = -edge
   end function sample_edge

   !> Add a number to a sample.
   pure subroutine add_number(samples, number, quantity, part, group, place)
      type(samples_t), intent(inout) :: samples
      integer(i8), intent(in) :: number  !! of units
      integer, intent(in) :: quantity, part, group, place
      integer :: bin, coarse

      bin = sample_bin(number)
      coarse = (bin - 1)/bins_per_coarse + 1
      samples%bins(bin, quantity, part, place) = samples%bins(bin, quantity, part, place) + 1
      samples%groups(coarse, quantity, group, place) = samples%groups(coarse, quantity, group, place) + 1
      associate (words => samples%sums(:, quantity, part, place))
         call add_digits(words(1:2), int(number, i16))
         call add_digits(words(3:4), int(number, i16)*number)
         words(5) = max(words(5), number)
      end associate
   end subroutine add_number

   !> Add the samples of other numbers; memory of bins without any remains untouched.
   pure subroutine merge_samples(samples, other)
      type(samples_t), intent(inout) :: samples
      type(samples_t), intent(in) :: other
      integer :: i, j, k

      do k = 1, size(samples%bins, 4)
         do i = 1, size(samples%bins, 2)
            do j = 1, size(samples%bins, 3)
               associate (counts => samples%bins(:, i, j, k), words => samples%sums(:, i, j, k), &
                          more_counts => other%bins(:, i, j, k), more_words => other%sums(:, i, j, k))
                  where (more_counts /= 0) counts = counts + more_counts
                  call add_digits(words(1:2), combined_digits(more_words(1:2)))
                  call add_digits(words(3:4), combined_digits(more_words(3:4)))
                  words(5) = max(words(5), more_words(5))
               end associate
            end do
            do j = 1, size(samples%groups, 3)
               associate (counts => samples%groups(:, i, j, k), more_counts => other%groups(:, i, j, k))
                  where (more_counts /= 0) counts = counts + more_counts
               end associate
            end do
         end do
      end do
      samples%ended = samples%ended + other%ended
      call merge_tails(samples, other%largest)
   end subroutine merge_samples

   !> Insert heaps into those of the same lines and tails.
   pure subroutine merge_tails(samples, other)
      type(samples_t), intent(inout) :: samples
      real(wp), intent(in) :: other(:, :, :)
      integer :: i, j, k

      do k = 1, size(other, 3)
         do j = 1, size(other, 2)
            do i = 1, size(other, 1)
               call add_tail(samples%largest(:, j, k), samples%vacant(j, k), other(i, j, k))
            end do
         end do
      end do
   end subroutine merge_tails

   pure subroutine add_digits(digits, number)
      integer(i8), intent(inout) :: digits(2)
      integer(i16), intent(in) :: number
      integer(i16) :: total

      total = combined_digits(digits) + number
      digits(1) = int(shifta(total, base_bits), i8)
      digits(2) = int(iand(total, 2_i16**base_bits - 1), i8)
   end subroutine add_digits

   pure integer(i16) function combined_digits(digits)
      integer(i8), intent(in) :: digits(2)

      combined_digits = shiftl(int(digits(1), i16), base_bits) + digits(2)
   end function combined_digits

   !> Size of a sample, over all parts.
   pure integer(i8) function sample_size(samples, quantity, place)
      type(samples_t), intent(in) :: samples
      integer, intent(in) :: quantity, place

      sample_size = sum(int(samples%bins(:, quantity, :, place), i8))
   end function sample_size

   !> Sum of a sample, in units.
   pure real(wp) function sample_sum(samples, quantity, place)
      type(samples_t), intent(in) :: samples
      integer, intent(in) :: quantity, place

      associate (sums => samples%sums(:, quantity, :, place))
         sample_sum = scale(real(sum(sums(1, :)), wp), base_bits) + sum(real(sums(2, :), wp))
      end associate
   end function sample_sum

   !> Insert a number into a heap of the largest, whose root is the smallest. A heap is filled from its last node, where
   !> most numbers stay, in few steps a number (Floyd 1964, doi:10.1145/355588.365103).
   pure subroutine add_tail(heap, vacant, number)
      real(wp), intent(inout) :: heap(:)
      integer, intent(inout) :: vacant  !! nodes without a number: the first ones
      real(wp), intent(in) :: number    !! >= 0
      integer :: node, next

      if (size(heap) == 0) return
      if (number <= heap(1)) return
      node = max(1, vacant)
      vacant = max(0, vacant - 1)
      do
         next = 2*node
         if (next > size(heap)) exit
         if (next < size(heap)) next = next + merge(1, 0, heap(min(next + 1, size(heap))) < heap(next))
         if (heap(next) >= number) exit
         heap(node) = heap(next)
         node = next
      end do
      heap(node) = number
   end subroutine add_tail

   !> Restore heaps read from a file: version 1.0.0 left nodes without a number anywhere; they are to be the first ones.
   pure subroutine restore_tails(samples)
      type(samples_t), intent(inout) :: samples
      real(wp), allocatable :: stored(:)
      integer :: i, j, k

      samples%vacant = count(samples%largest < 0, dim=1)
      do k = 1, size(samples%vacant, 2)
         do j = 1, size(samples%vacant, 1)
            associate (heap => samples%largest(:, j, k), vacant => samples%vacant(j, k))
               if (all(heap(vacant + 1:) >= 0)) cycle
               stored = heap
               heap = -1
               vacant = size(heap)
               do i = 1, size(heap)
                  call add_tail(heap, vacant, stored(i))
               end do
            end associate
         end do
      end do
   end subroutine restore_tails
end module rockfall_samples
