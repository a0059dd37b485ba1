! SPDX-License-Identifier: BSD-3-Clause
!> Random initial conditions of throws: a pure function of (seed, purpose, number).
module lab_throw_range
   use rockfall_kinds, only: wp, i8
   use rockfall_error, only: error_t, fail
   use rockfall_math, only: pi, sine_cosine
   use rockfall_random, only: random_key_t, random_words, uniform, words_per_block
   use lab_contact_record, only: throw_t
   use lab_ensemble, only: between
   implicit none
   private
   public :: throw_range_t, check_throws, draw_throw

   integer, parameter :: max_contacts = 1000

   !> Ranges of initial conditions. Slopes are uniform; half of the speeds, angles and spins are below the median.
   type :: throw_range_t
      real(wp) :: slope(2) = [5.0_wp, 45.0_wp]            !! slope of the mean surface: min, max [degrees]
      real(wp) :: speed(3) = [1.0_wp, 8.0_wp, 30.0_wp]    !! min, median, max [m/s]
      real(wp) :: angle(3) = [3.0_wp, 25.0_wp, 90.0_wp]   !! angle of the path to the mean surface [degrees]
      real(wp) :: spin(3) = [-0.3_wp, 0.4_wp, 1.2_wp]     !! W/V [-]
      real(wp) :: gravity = 9.81_wp                       !! [m/s2]
   end type throw_range_t

contains

   !> Reject ranges that include invalid throws.
   pure subroutine check_throws(range, contacts, error)
      type(throw_range_t), intent(in) :: range
      integer, intent(in) :: contacts
      type(error_t), allocatable, intent(out) :: error

      if (.not. (range%slope(1) >= 0 .and. range%slope(1) <= range%slope(2) .and. range%slope(2) <= 45)) then
         call fail(error, "throw: slope must be min and max, 0 to 45 degrees")
      else if (.not. (rises(range%speed) .and. range%speed(1) >= 0.1_wp .and. range%speed(3) <= 100)) then
         call fail(error, "throw: speed must be min, median and max, 0.1 to 100 m/s")
      else if (.not. (rises(range%angle) .and. range%angle(1) >= 0.1_wp .and. range%angle(3) <= 90)) then
         call fail(error, "throw: angle must be min, median and max, 0.1 to 90 degrees")
      else if (.not. (rises(range%spin) .and. maxval(abs(range%spin)) <= 10)) then
         call fail(error, "throw: spin must be min, median and max, -10 to 10")
      else if (.not. (range%gravity >= 0.1_wp .and. range%gravity <= 100)) then
         call fail(error, "throw: gravity must be 0.1 to 100 m/s2")
      else if (contacts < 1 .or. contacts > max_contacts) then
         call fail(error, "throw: contacts must be 1 to 1000")
      end if
   end subroutine check_throws

   pure logical function rises(limits)
      real(wp), intent(in) :: limits(3)  !! min, median, max, any [unit]

      rises = limits(1) <= limits(2) .and. limits(2) <= limits(3)
   end function rises

   !> Draw throw `number`. Its position is in the unit square, and must be scaled to the ground; `choice` may select the
   !> ground.
   pure subroutine draw_throw(range, key, purpose, number, throw, choice)
      type(throw_range_t), intent(in) :: range
      type(random_key_t), intent(in) :: key
      integer(i8), intent(in) :: purpose, number
      type(throw_t), intent(out) :: throw
      real(wp), intent(out) :: choice  !! uniform in (0, 1) [-]
      integer(i8) :: word(words_per_block)
      real(wp) :: s, c
      integer :: quarter

      word = random_words(key, purpose, number, 0_i8, 0_i8)  ! words 1: choice; 2, 3: position; 4: downhill
      choice = uniform(word(1))
      throw%place = uniform(word(2:3))
      quarter = int(4*uniform(word(4)))
      call sine_cosine((4*uniform(word(4)) - quarter - 0.5_wp)*pi/2, s, c)
      throw%downhill = [c, s]
      do quarter = quarter, 1, -1
         throw%downhill = [-throw%downhill(2), throw%downhill(1)]
      end do
      word = random_words(key, purpose, number, 0_i8, 1_i8)  ! 1: slope; 2: speed; 3: angle; 4: spin
      throw%slope = range%slope(1) + uniform(word(1))*(range%slope(2) - range%slope(1))
      throw%speed = between(range%speed, uniform(word(2)))
      throw%angle = between(range%angle, uniform(word(3)))
      throw%spin = between(range%spin, uniform(word(4)))
      throw%gravity = range%gravity
   end subroutine draw_throw
end module lab_throw_range
