! SPDX-License-Identifier: BSD-3-Clause
!> Upper bounds of the sums and maxima of maps, so that a run that could overflow them is rejected before it starts.
!> No rebound adds energy (theory, chapter 5): the release and the lowest elevation bound all speeds.
module rockfall_limits
   use rockfall_kinds, only: wp, sp, i8
   use rockfall_error, only: error_t, fail
   use rockfall_text, only: integer_text
   use rockfall_random, only: normal_table
   use rockfall_boulder, only: volume_distribution_t, max_volume, mean_volume
   use rockfall_bins, only: energy, speed, jump_height, passing_height
   use rockfall_maps, only: per_unit, square_base
   use rockfall_passing_maps, only: steepest
   use rockfall_map_values, only: map_plan_t
   implicit none
   private
   public :: check_tallies

   !> Maximum sum [J], [mm/s], [mm]: below 2**63 with a margin for rounding to integers.
   real(wp), parameter :: max_sum = 9.0e18_wp
   real(wp), parameter :: rounding = 0.5_wp  !! per hit of a tree [J], [mm]; the number of hits alone fits in 63 bits
   !> Maps that show the sums of a plan.
   character(len=*), parameter :: names(10) = [character(len=23) :: "energy_mean", "speed_mean", "jump_height_mean", &
                                               "passing_height_mean", "tree_impact_height_mean", "tree_energy", &
                                               "energy_std", "speed_std", "jump_height_std", "passing_height_std"]
   character(len=*), parameter :: units(10) = [character(len=6) :: "J", "mm/s", "mm", "mm", "mm", "J", &
                                               "J2", "mm2/s2", "mm2", "mm2"]

contains

   !> Reject a run whose tallies could overflow.
   pure subroutine check_tallies(plan, distribution, gravity, fall, boulders, max_hits, error)
      type(map_plan_t), intent(in) :: plan
      type(volume_distribution_t), intent(in) :: distribution
      real(wp), intent(in) :: gravity        !! [m/s2]
      real(wp), intent(in) :: fall           !! from the highest energy head to the lowest elevation [m]
      integer(i8), intent(in) :: boulders    !! of the whole run: all may pass the same cell
      integer, intent(in) :: max_hits        !! maximum number of tree hits per boulder: all may be in one cell
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: one(4), together(size(names)), limit(size(names)), volume, hits
      character(len=:), allocatable :: advice
      integer :: k, place(size(names))

      volume = max_volume(distribution, normal_table())
      one(energy) = distribution%density*volume*gravity*fall
      one(speed) = sqrt(2*gravity*fall)
      one(jump_height) = fall
      one(passing_height) = fall + volume**(1/3.0_wp)*steepest  ! a radius is less than the side of a cube of the volume
      hits = real(boulders, wp)*max_hits
      together(:4) = boulders*one*per_unit
      together(energy) = min(together(energy), &
                             distribution%density*gravity*fall*sum_of_many(boulders, mean_volume(distribution), volume))
      together(5:6) = [hits*(one(jump_height)*per_unit(jump_height) + rounding), together(energy) + hits*rounding]
      together(7:) = together(:4)*one*per_unit
      limit = max_sum
      limit(7:) = max_sum*square_base
      place = [plan%sum(:6), plan%square]
      do k = 1, size(names)
         advice = ""
         if (k == 5 .or. k == 6) advice = ", or a lower &impact impact_limit"
         if (place(k) > 0 .and. together(k) > limit(k)) then
            call fail(error, "&output maps: "//trim(names(k))//": the sum of "//integer_text(boulders) &
                      //" boulders can come to "//short(together(k))//" "//trim(units(k))//about(volume, fall) &
                      //": must be at most "//short(limit(k))//"; take fewer or smaller boulders"//advice)
            return
         end if
      end do
      if (plan%max(energy) > 0 .and. one(energy) > huge(1.0_sp)) then
         call fail(error, "&output maps: energy_max: can come to "//short(one(energy))//" J"//about(volume, fall) &
                   //": must be at most 3.4e38")
      end if
   end subroutine check_tallies

   !> Bound of the sum of n independent volumes [m3], by Chernoff: from 2e times its mean on, it exceeds k times the
   !> maximum of one volume with a probability below 2**-k; k = 128 means practically never.
   pure real(wp) function sum_of_many(n, mean, max_one)
      integer(i8), intent(in) :: n
      real(wp), intent(in) :: mean, max_one  !! of one volume [m3]

      sum_of_many = max(6*n*mean, 128*max_one)
   end function sum_of_many

   !> Explanation of the large numbers, for messages.
   pure function about(volume, fall) result(text)
      real(wp), intent(in) :: volume, fall  !! [m3], [m]
      character(len=:), allocatable :: text

      text = " (volumes up to "//short(volume)//" m3 falling up to "//short(fall)//" m)"
   end function about

   !> Format a number with three digits.
   pure function short(value) result(text)
      real(wp), intent(in) :: value  !! any unit
      character(len=:), allocatable :: text
      character(len=16) :: buffer

      write (buffer, "(es9.2e2)") value
      text = trim(adjustl(buffer))
   end function short
end module rockfall_limits
