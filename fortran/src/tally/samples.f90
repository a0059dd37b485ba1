! SPDX-License-Identifier: BSD-3-Clause
!> Samples of numbers that are not stored individually: counts in narrow bins, exact sums, and the largest numbers.
!> Counts and sums are integers, so results do not depend on the order or partition of the numbers.
module rockfall_samples
   use, intrinsic :: iso_c_binding, only: c_ptr, c_null_ptr, c_associated, c_f_pointer
   use rockfall_kinds, only: wp, sp, i4, i8, i16
   use rockfall_math, only: fraction_bits, exponent_bias
   use rockfall_memory, only: zeroed_block, free_block, prefetch
   implicit none
   private
   public :: samples_t, add_numbers, add_tails, add_tail, merge_samples, sample_bin, sample_edge, bins_per_coarse
   public :: sample_size, sample_sum, allocate_samples, continue_samples, free_samples, forget_samples
   public :: list_blocks, find_blocks
   public :: filled_bins_t, fill_bins, filled_bins
   public :: n_sample_bins, n_coarse_bins, n_words, base_bits, largest_unit

   !> Bins of integers up to 2**45 and down to -2**20: width 1 below 512, then 256 bins per octave, so that no bin is
   !> wider than 0.4 % of its values.
   integer, parameter :: octave_bits = 8, per_octave = 2**octave_bits
   integer, parameter :: before_octaves = per_octave*(exponent_bias + octave_bits - 1)
   integer, parameter :: below_zero = 3328, from_zero = 9728
   integer, parameter :: n_sample_bins = below_zero + from_zero
   integer, parameter :: bins_per_coarse = 64, n_coarse_bins = n_sample_bins/bins_per_coarse
   integer(i8), parameter :: largest_unit = 2_i8**45  !! larger numbers are clamped
   !> Words of a sum and a sum of squares, with two digits each in base 2**62; then the maximum.
   integer, parameter :: n_words = 5, base_bits = 62
   !> Maximum number of largest values stored at a line, and over all lines. A line stores at least the number needed
   !> for a return level from independent boulders (MAX_ABOVE in return_levels.py, plus two neighbours).
   integer, parameter :: most_largest = 100000, all_largest = 2000000, fewest_largest = 2002

   integer, parameter :: batch = 256  !! numbers added at a time

   !> Samples of `quantities` at each of `places` (the ends of boulders, then each line). Counts are in blocks: a block
   !> contains the bins of one coarse bin, and is created for its first boulder. Unused memory pages cost nothing.
   type :: samples_t
      integer(i4) :: blocks = 0                                         !! number of blocks in use
      integer(i4), pointer, contiguous :: at(:, :, :, :) => null()      !! block, 0: none (coarse bins,
                                                                        !! quantities, parts, places)
      integer(i4), pointer, contiguous :: counts(:, :) => null()        !! (bins of a block, blocks)
      integer(i8), pointer, contiguous :: sums(:, :, :, :) => null()    !! (words, quantities, parts, places)
      integer(i4), pointer, contiguous :: groups(:, :, :, :) => null()  !! (coarse bins, quantities, groups, places)
      real(sp), pointer, contiguous :: largest(:, :, :) => null()       !! heaps of `known` largest values (values,
                                                                        !! tails, lines)
      integer(i4), allocatable :: known(:)                              !! number of values in each heap of a line
      integer(i8), pointer, contiguous :: ended(:) => null()            !! number of boulders by status
      type(c_ptr), private :: block(6) = c_null_ptr  !! memory of at, groups, counts, sums, ended, largest
   end type samples_t

   !> Bins that are not empty, numbered from 0 over all dimensions in ascending order, and their counts.
   type :: filled_bins_t
      integer(i8), allocatable :: bin(:)
      integer(i4), allocatable :: count(:)
   end type filled_bins_t

contains

   !> Allocate empty samples, if memory suffices (`fit`): quantities by part and coarsely by group, at all places;
   !> boulders by status; and the largest values of each tail at lines. Each boulder has at most one value per place.
   subroutine allocate_samples(samples, quantities, parts, groups, places, statuses, tails, boulders, sampled, fit)
      type(samples_t), intent(inout) :: samples
      integer, intent(in) :: quantities, parts, groups, places, statuses, tails
      integer(i8), intent(in) :: boulders
      logical, intent(in) :: sampled  !! the sources are a sample of all sources
      logical, intent(out) :: fit
      integer(i8) :: n, blocks
      integer :: k

      n = int(quantities, i8)*places
      blocks = n*min(int(n_coarse_bins, i8)*parts, boulders)
      fit = blocks < huge(1_i4)
      if (.not. fit) return
      associate (block => samples%block)
         block(1) = zeroed_block(n_coarse_bins*parts*n, 4)
         block(2) = zeroed_block(n_coarse_bins*groups*n, 4)
         block(3) = zeroed_block(bins_per_coarse*blocks, 4)
         block(4) = zeroed_block(n_words*parts*n, 8)
         block(5) = zeroed_block(int(statuses, i8), 8)
         fit = all([(c_associated(block(k)), k=1, 5)])
         if (.not. fit) return
         call c_f_pointer(block(1), samples%at, [n_coarse_bins, quantities, parts, places])
         call c_f_pointer(block(2), samples%groups, [n_coarse_bins, quantities, groups, places])
         call c_f_pointer(block(3), samples%counts, [bins_per_coarse, int(blocks)])
         call c_f_pointer(block(4), samples%sums, [n_words, quantities, parts, places])
         call c_f_pointer(block(5), samples%ended, [statuses])
      end associate
      call allocate_tails(samples, tails, places - 1, boulders, sampled, fit)
   end subroutine allocate_samples

   !> Allocate empty tails.
   subroutine allocate_tails(samples, tails, lines, boulders, sampled, fit)
      type(samples_t), intent(inout) :: samples
      integer, intent(in) :: tails, lines
      integer(i8), intent(in) :: boulders
      logical, intent(in) :: sampled
      logical, intent(out) :: fit
      integer :: shape(3)

      shape = [most_largest, tails, lines]
      if (.not. sampled) shape(1) = min(most_largest, max(fewest_largest, all_largest/max(1, lines)))
      shape(1) = int(min(int(shape(1), i8), boulders))
      samples%block(6) = zeroed_block(product(int(shape, i8)), 4)
      fit = c_associated(samples%block(6))
      if (.not. fit) return
      call c_f_pointer(samples%block(6), samples%largest, shape)
      samples%known = spread(0, 1, lines)
   end subroutine allocate_tails

   !> Move samples to memory for a run of `boulders` boulders, with more blocks and longer tails, if memory suffices
   !> (`fit`).
   subroutine continue_samples(from, to, boulders, sampled, fit)
      type(samples_t), intent(inout) :: from
      type(samples_t), intent(inout) :: to
      integer(i8), intent(in) :: boulders
      logical, intent(in) :: sampled
      logical, intent(out) :: fit

      call allocate_samples(to, size(from%at, 2), size(from%at, 3), size(from%groups, 3), size(from%at, 4), &
                            size(from%ended), size(from%largest, 2), boulders, sampled, fit)
      if (.not. fit) return
      call merge_samples(to, from)
      call free_samples(from)
   end subroutine continue_samples

   !> Free the memory.
   subroutine free_samples(samples)
      type(samples_t), intent(inout) :: samples

      call free_block(samples%block)
   end subroutine free_samples

   !> Free data needed only for counting, once all results are computed. The counts remain, because results are views of
   !> them.
   subroutine forget_samples(samples)
      type(samples_t), intent(inout) :: samples

      call free_block(samples%block(:2))
      call c_f_pointer(c_null_ptr, samples%at, [0, 0, 0, 0])
      call c_f_pointer(c_null_ptr, samples%groups, [0, 0, 0, 0])
   end subroutine forget_samples

   ! ---- blocks -------------------------------------------------------------------------------

   !> Sort blocks by bin, quantity, part and place, so that their order does not depend on threads, and list their
   !> places (from 0) in this order.
   subroutine list_blocks(samples, places)
      type(samples_t), intent(inout), target :: samples
      integer(i8), allocatable, intent(out) :: places(:)
      integer(i4), pointer, contiguous :: at(:)
      integer(i4) :: moved(bins_per_coarse)
      integer(i4), allocatable :: from(:)  !! block to be moved to each place
      integer(i8) :: k
      integer :: n, place, next

      allocate (places(samples%blocks), from(samples%blocks))
      call c_f_pointer(samples%block(1), at, [size(samples%at, kind=i8)])
      n = 0
      do k = 1, size(at, kind=i8)
         if (at(k) == 0) cycle
         n = n + 1
         places(n) = k - 1
         from(n) = at(k)
         at(k) = n
      end do
      do n = 1, samples%blocks
         if (from(n) == n) cycle
         moved = samples%counts(:, n)  ! start of a cycle of blocks that replace each other
         place = n
         do
            next = from(place)
            from(place) = place
            if (next == n) exit
            samples%counts(:, place) = samples%counts(:, next)
            place = next
         end do
         samples%counts(:, place) = moved
      end do
   end subroutine list_blocks

   !> Restore the places of blocks, and the lengths of tails.
   subroutine find_blocks(samples, places)
      type(samples_t), intent(inout), target :: samples
      integer(i8), intent(in) :: places(:)  !! places of the blocks, as listed
      integer(i4), pointer, contiguous :: at(:)
      integer :: k

      call c_f_pointer(samples%block(1), at, [size(samples%at, kind=i8)])
      at(places + 1) = [(k, k=1, size(places))]
      do k = 1, size(samples%known)
         samples%known(k) = int(min(sample_size(samples, 1, k + 1), size(samples%largest, 1, i8)))
      end do
   end subroutine find_blocks

   !> Find the block of a coarse bin, or assign a new block. Threads add at different places, but share the blocks.
   subroutine find_block(samples, at, block)
      type(samples_t), intent(inout) :: samples
      integer(i4), intent(inout) :: at
      integer(i4), intent(out) :: block

      block = at
      if (block > 0) return
      !$omp atomic capture
      samples%blocks = samples%blocks + 1
      block = samples%blocks
      !$omp end atomic
      at = block
   end subroutine find_block

   !> Indices and counts of the non-empty bins among n.
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

      size = min(abs(number), largest_unit - 1)
      ! the upper bits of exponent and fraction count octaves and their parts; the real is exact
      bin = int(shiftr(transfer(real(size, wp), size), fraction_bits - octave_bits)) - before_octaves
      bin = merge(int(iand(size, per_octave - 1_i8)), bin, size < per_octave)
      bin = below_zero + 1 + merge(bin, -min(bin, below_zero), number >= 0)
   end function sample_bin

   !> Lower edge of a bin, in units, before rounding to integers; for n_sample_bins + 1, the upper edge of the last bin.
   pure real(wp) function sample_edge(bin) result(edge)
      integer, intent(in) :: bin
      integer :: place, octave

      place = abs(bin - below_zero - 1)
      if (bin <= below_zero) place = place + 1
      octave = max(0, place/per_octave - 1)
      edge = scale(real(place - per_octave*octave, wp), octave) - 0.5_wp
      if (bin <= below_zero) edge = -edge
   end function sample_edge

   !> Add values to the samples of a quantity at a place. Separate loops for each step let memory accesses overlap.
   subroutine add_numbers(samples, numbers, quantity, part, group, place)
      type(samples_t), intent(inout) :: samples
      integer(i8), intent(in) :: numbers(:)               !! values in units of the sample
      integer, intent(in) :: quantity, part(:), group(:)  !! part and group of each value
      integer, intent(in) :: place
      integer(i4) :: block(batch)
      integer :: bin(batch), coarse(batch), first, k, n

      do first = 0, size(numbers) - 1, batch
         n = min(batch, size(numbers) - first)
         do k = 1, n
            bin(k) = sample_bin(numbers(first + k))
            coarse(k) = (bin(k) - 1)/bins_per_coarse + 1
            bin(k) = bin(k) - (coarse(k) - 1)*bins_per_coarse
         end do
         do k = 1, n
            call find_block(samples, samples%at(coarse(k), quantity, part(first + k), place), block(k))
            call prefetch(samples%counts(bin(k), block(k)))
         end do
         do k = 1, n
            associate (counts => samples%counts(bin(k), block(k)))
               counts = counts + 1
            end associate
         end do
         do k = 1, n
            associate (counts => samples%groups(coarse(k), quantity, group(first + k), place))
               counts = counts + 1
            end associate
         end do
      end do
      call add_to_sums(samples%sums(:, quantity, :, place), numbers, part)
   end subroutine add_numbers

   !> Add values to the sums of their parts; values of a part are mostly consecutive.
   pure subroutine add_to_sums(words, numbers, part)
      integer(i8), intent(inout) :: words(:, :)  !! (words, parts)
      integer(i8), intent(in) :: numbers(:)
      integer, intent(in) :: part(:)             !! part of each value
      integer(i16) :: total, squares
      integer :: first, last, k

      last = 0
      do while (last < size(numbers))
         first = last + 1
         total = 0
         squares = 0
         do k = first, size(numbers)
            if (part(k) /= part(first)) exit
            total = total + numbers(k)
            squares = squares + int(numbers(k), i16)*numbers(k)
         end do
         last = k - 1
         call add_digits(words(1:2, part(first)), total)
         call add_digits(words(3:4, part(first)), squares)
         words(5, part(first)) = max(words(5, part(first)), maxval(numbers(first:last)))
      end do
   end subroutine add_to_sums

   !> Add the samples of another run.
   subroutine merge_samples(samples, other)
      type(samples_t), intent(inout) :: samples
      type(samples_t), intent(in) :: other
      integer(i4) :: block
      integer :: i, j, k, coarse

      do k = 1, size(samples%at, 4)
         do i = 1, size(samples%at, 2)
            do j = 1, size(samples%at, 3)
               do coarse = 1, n_coarse_bins
                  if (other%at(coarse, i, j, k) == 0) cycle
                  call find_block(samples, samples%at(coarse, i, j, k), block)
                  samples%counts(:, block) = samples%counts(:, block) + other%counts(:, other%at(coarse, i, j, k))
               end do
               associate (words => samples%sums(:, i, j, k), more_words => other%sums(:, i, j, k))
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
      do k = 1, size(other%known)
         call add_tails(samples, k, other%largest(:other%known(k), :, k))
      end do
   end subroutine merge_samples

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
      integer :: coarse, part

      sample_size = 0
      do part = 1, size(samples%at, 3)
         do coarse = 1, n_coarse_bins
            associate (block => samples%at(coarse, quantity, part, place))
               if (block > 0) sample_size = sample_size + sum(int(samples%counts(:, block), i8))
            end associate
         end do
      end do
   end function sample_size

   !> Sum of the values in a sample, in the unit of the sample.
   pure real(wp) function sample_sum(samples, quantity, place)
      type(samples_t), intent(in) :: samples
      integer, intent(in) :: quantity, place

      associate (sums => samples%sums(:, quantity, :, place))
         sample_sum = scale(real(sum(sums(1, :)), wp), base_bits) + sum(real(sums(2, :), wp))
      end associate
   end function sample_sum

   !> Add values from boulders to the tail samples of a line.
   pure subroutine add_tails(samples, line, numbers)
      type(samples_t), intent(inout) :: samples
      integer, intent(in) :: line
      real(sp), intent(in) :: numbers(:, :)  !! values >= 0 (boulders, tails)
      integer :: j, k, most

      most = size(samples%largest, 1)
      associate (known => samples%known(line))
         do k = 1, size(numbers, 2)
            do j = 1, size(numbers, 1)
               call add_tail(samples%largest(:, k, line), min(known + j - 1, most), numbers(j, k))
            end do
         end do
         known = min(known + size(numbers, 1), most)
      end associate
   end subroutine add_tails

   !> Insert a value into a heap of the largest values. Its first `known` nodes are in use, and its root is the
   !> smallest value. In a full heap, the nodes on the path of smaller children move up by one, and the value rises from
   !> the end of that path, without unpredictable branches (Wegener 1993, doi:10.1016/0304-3975(93)90364-Y).
   pure subroutine add_tail(heap, known, number)
      real(sp), intent(inout) :: heap(:)
      integer, intent(in) :: known
      real(sp), intent(in) :: number
      integer :: node, next

      node = known + 1
      if (known == size(heap)) then
         if (known == 0) return
         if (number <= heap(1)) return
         node = 1
         do
            next = 2*node
            if (next >= known) exit
            next = next + merge(1, 0, heap(next + 1) < heap(next))
            heap(node) = heap(next)
            node = next
            call prefetch(heap(min(known, 16*node + 1)))  ! node four levels down, on either path
         end do
         if (next == known) then
            heap(node) = heap(next)
            node = next
         end if
      end if
      do while (node > 1)
         next = node/2
         if (heap(next) <= number) exit
         heap(node) = heap(next)
         node = next
      end do
      heap(node) = number
   end subroutine add_tail
end module rockfall_samples
