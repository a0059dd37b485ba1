! SPDX-License-Identifier: BSD-3-Clause
!> Logarithmic bins of positive numbers, four per octave, computed from the bits of a number. Counts can be added
!> exactly, and give quantiles. The width of a bin is 14 to 25 % of its value.
module rockfall_bins
   use rockfall_kinds, only: wp, i4, i8
   use rockfall_math, only: fraction_bits, exponent_bias
   implicit none
   private
   public :: n_log_bins, log_bin, log_bin_edge, log_bin_quantile, log_bin_value
   public :: energy, speed, jump_height, passing_height

   integer, parameter :: energy = 1, speed = 2, jump_height = 3, passing_height = 4  !! quantities [J], [m/s], [m]
   !> First octave as a power of two, and number of octaves: 64 J to 8.6 GJ, 0.25 to 256 m/s, heights 0.06 to 512 m.
   integer, parameter :: first(4) = [6, -2, -4, -4], octaves(4) = [27, 10, 13, 13]
   integer, parameter :: per_octave = 4
   !> Number of low bits of a double that do not affect its bin: the 52 fraction bits minus log2(per_octave).
   integer, parameter :: bits_below = fraction_bits - 2
   !> Number of bins; the first also counts smaller numbers, the last larger ones.
   integer, parameter :: n_log_bins(4) = per_octave*octaves + 2

contains

   !> Bin of a number >= 0, from 1.
   pure integer function log_bin(quantity, x)
      integer, intent(in) :: quantity
      real(wp), intent(in) :: x  !! [J], [m/s] or [m], by quantity
      integer :: quarter  ! quarter octaves above 2**first

      log_bin = 1
      if (x < log_bin_edge(quantity, 2)) return
      quarter = int(shiftr(transfer(x, 0_i8), bits_below)) - per_octave*(exponent_bias + first(quantity))
      log_bin = min(quarter + 2, n_log_bins(quantity))
   end function log_bin

   !> Lower edge of a bin, in the unit of the quantity; for n_log_bins + 1, the lower edge of the last, open-ended bin.
   pure real(wp) function log_bin_edge(quantity, bin)
      integer, intent(in) :: quantity, bin
      integer :: quarter

      log_bin_edge = 0
      if (bin < 2) return
      quarter = min(bin, n_log_bins(quantity)) - 2
      log_bin_edge = scale(1 + mod(quarter, per_octave)/real(per_octave, wp), &
                         first(quantity) + quarter/per_octave)
   end function log_bin_edge

   !> Quantile p of the counted numbers, in the unit of the quantity, with the rank definition used at the lines (type 7
   !> of Hyndman and Fan 1996, doi:10.1080/00031305.1996.10473566), assuming a uniform distribution within each bin.
   pure real(wp) function log_bin_quantile(quantity, counts, p) result(x)
      integer, intent(in) :: quantity
      integer(i4), intent(in) :: counts(:)  !! counts of the bins; at least one number
      real(wp), intent(in) :: p             !! probability, 0..1 [-]

      x = log_bin_value(quantity, counts, 0.5_wp + p*(sum(int(counts, i8)) - 1))
   end function log_bin_quantile

   !> Value of a given rank among the counted numbers, in the unit of the quantity; the k-th number has rank k - 1/2.
   pure real(wp) function log_bin_value(quantity, counts, rank) result(x)
      integer, intent(in) :: quantity
      integer(i4), intent(in) :: counts(:)  !! counts of the bins; at least one number
      real(wp), intent(in) :: rank
      integer(i8) :: before
      real(wp) :: low
      integer :: k

      before = 0
      do k = 1, size(counts) - 1
         if (real(before + counts(k), wp) >= rank .and. counts(k) > 0) exit
         before = before + counts(k)
      end do
      low = log_bin_edge(quantity, k)
      x = low
      if (counts(k) > 0) x = low + (log_bin_edge(quantity, k + 1) - low)*(rank - before)/counts(k)
   end function log_bin_value
end module rockfall_bins
