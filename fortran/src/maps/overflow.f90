! SPDX-License-Identifier: BSD-3-Clause
!> Upper bounds of the sums and maxima of maps: a run that could overflow them is rejected before it starts. No rebound
!> adds energy (theory, chapter 5): the release and the lowest elevation bound all speeds.
module rockfall_map_overflow
   use rockfall_kinds, only: wp, sp, i8
   use rockfall_error, only: error_t, fail
   use rockfall_text, only: integer_text
   use rockfall_random, only: normal_table
   use rockfall_boulder, only: volume_distribution_t, max_volume, mean_volume
   use rockfall_bins, only: energy, speed, jump_height, passing_height
   use rockfall_maps, only: per_unit, square_base
   use rockfall_passing_maps, only: max_steepness
   use rockfall_map_values, only: map_plan_t
   implicit none
   private
   public :: check_overflow

   !> Maximum sum [J], [mm/s], [mm]: below 2**63 with a margin for rounding to integers.
   real(wp), parameter :: max_sum = 9.0e18_wp
   real(wp), parameter :: rounding = 0.5_wp  !! maximum rounding error per tree hit [J], [mm]; number of hits < 2**63
   !> Maps computed from the sums of a plan.
   character(len=*), parameter :: names(10) = [character(len=23) :: "energy_mean", "speed_mean", "jump_height_mean", &
                                               "passing_height_mean", "tree_impact_height_mean", "tree_energy", &
                                               "energy_std", "speed_std", "jump_height_std", "passing_height_std"]
   character(len=*), parameter :: units(10) = [character(len=6) :: "J", "mm/s", "mm", "mm", "mm", "J", &
                                               "J2", "mm2/s2", "mm2", "mm2"]

contains

   !> Reject a run whose tallies could overflow.
   pure subroutine check_overflow(plan, distribution, gravity, fall, boulders, max_hits, error)
      type(map_plan_t), intent(in) :: plan
      type(volume_distribution_t), intent(in) :: distribution
      real(wp), intent(in) :: gravity        !! [m/s2]
      real(wp), intent(in) :: fall           !! height of the highest energy head above the lowest elevation [m]
      integer(i8), intent(in) :: boulders    !! number in the complete run: all may pass the same cell
      integer, intent(in) :: max_hits        !! maximum number of tree hits per boulder: all may be in the same cell
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: max_single(4), max_total(size(names)), limit(size(names)), volume, hits
      character(len=:), allocatable :: advice
      integer :: k, layer(size(names))

      volume = max_volume(distribution, normal_table())
      max_single(energy) = distribution%density*volume*gravity*fall
      max_single(speed) = sqrt(2*gravity*fall)
      max_single(jump_height) = fall
      max_single(passing_height) = fall + volume**(1/3.0_wp)*max_steepness  ! R_b is below the side of the cube
      hits = real(boulders, wp)*max_hits
      max_total(:4) = boulders*max_single*per_unit
      max_total(energy) = min(max_total(energy), &
                              distribution%density*gravity*fall &
                              *sum_of_many(boulders, mean_volume(distribution), volume))
      max_total(5:6) = [hits*(max_single(jump_height)*per_unit(jump_height) + rounding), &
                        max_total(energy) + hits*rounding]
      max_total(7:) = max_total(:4)*max_single*per_unit
      limit = max_sum
      limit(7:) = max_sum*square_base
      layer = [plan%sum(:6), plan%square]
      do k = 1, size(names)
         advice = ""
         if (k == 5 .or. k == 6) advice = ", or a lower &impact impact_limit"
         if (layer(k) > 0 .and. max_total(k) > limit(k)) then
            call fail(error, "&output maps: "//trim(names(k))//": the sum of "//integer_text(boulders) &
                      //" boulders can reach "//three_digits(max_total(k))//" "//trim(units(k)) &
                      //explanation(volume, fall)//": must be at most "//three_digits(limit(k)) &
                      //": use fewer or smaller boulders"//advice)
            return
         end if
      end do
      if (plan%max(energy) > 0 .and. max_single(energy) > huge(1.0_sp)) then
         call fail(error, "&output maps: energy_max: can reach "//three_digits(max_single(energy))//" J" &
                   //explanation(volume, fall)//": must be at most 3.4e38")
      end if
   end subroutine check_overflow

   !> Upper bound of the sum of n independent volumes [m3]. By Chernoff, the sum exceeds k times the maximum volume with
   !> a probability below 2**-k, if that is at least 2e times the mean of the sum; k = 128 makes an overflow practically
   !> impossible.
   pure real(wp) function sum_of_many(n, mean, max_single)
      integer(i8), intent(in) :: n
      real(wp), intent(in) :: mean, max_single  !! mean and maximum of one volume [m3]

      sum_of_many = max(6*n*mean, 128*max_single)
   end function sum_of_many

   !> Explanation of the large values, for messages.
   pure function explanation(volume, fall) result(text)
      real(wp), intent(in) :: volume, fall  !! maximum volume [m3], fall [m]
      character(len=:), allocatable :: text

      text = " (volumes up to "//three_digits(volume)//" m3 falling up to "//three_digits(fall)//" m)"
   end function explanation

   !> Format a number with three digits.
   pure function three_digits(value) result(text)
      real(wp), intent(in) :: value  !! any unit
      character(len=:), allocatable :: text
      character(len=16) :: buffer

      write (buffer, "(es9.2e2)") value
      text = trim(adjustl(buffer))
   end function three_digits
end module rockfall_map_overflow
