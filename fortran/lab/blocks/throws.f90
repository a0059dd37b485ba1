! SPDX-License-Identifier: BSD-3-Clause
!> Many throws, drawn at random. A throw is a pure function of (seed, number), so threads and chunks
!> cannot change a bit.
module lab_throws
   use rockfall_kinds, only: wp, i8
   use rockfall_error, only: error_t, fail
   use rockfall_math, only: pi, sine_cosine
   use rockfall_threads, only: team_size
   use rockfall_random, only: random_key_t, random_words, uniform, words_per_block
   use lab_block, only: block_t
   use lab_yielding_ground, only: relief_t
   use lab_pressure, only: law_t
   use lab_ensemble, only: between
   use lab_throw, only: throw_t, contact_t, follow_throw
   implicit none
   private
   public :: throw_range_t, thrown_t, check_throws, draw_throw, throw_blocks

   integer(i8), parameter :: for_throw = 68, for_attitude = 69  !! purposes of random numbers
   integer, parameter :: max_contacts = 1000

   !> Slopes are uniform; speed, angle and spin have half of their draws below the median.
   type :: throw_range_t
      real(wp) :: slope(2) = [5.0_wp, 45.0_wp]            !! of the mean surface: min, max [degrees]
      real(wp) :: speed(3) = [1.0_wp, 8.0_wp, 30.0_wp]    !! min, median, max [m/s]
      real(wp) :: angle(3) = [3.0_wp, 25.0_wp, 90.0_wp]   !! of the path from the mean surface [degrees]
      real(wp) :: spin(3) = [-0.3_wp, 0.4_wp, 1.2_wp]     !! W/V [-]
      real(wp) :: gravity = 9.81_wp                       !! [m/s2]
   end type throw_range_t

   !> A throw: what was thrown, and its contacts.
   type :: thrown_t
      integer :: block = 0
      type(throw_t) :: throw
      integer :: n = 0                             !! contacts
      logical :: complete = .true.
      type(contact_t), allocatable :: contacts(:)  !! the first n are
   end type thrown_t

contains

   !> Refuse ranges of which some throw has no meaning.
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

   !> Throws `first` to `first + size(thrown) - 1`. Throw k takes block mod(k - 1, blocks) + 1.
   subroutine throw_blocks(blocks, law, reliefs, range, contacts, step, key, first, threads, thrown)
      type(block_t), intent(in) :: blocks(:)
      type(law_t), intent(in) :: law
      type(relief_t), intent(in) :: reliefs(:)
      type(throw_range_t), intent(in) :: range
      integer, intent(in) :: contacts  !! of a throw, at most
      real(wp), intent(in) :: step     !! time step over the usual one [-]
      type(random_key_t), intent(in) :: key
      integer(i8), intent(in) :: first
      integer, intent(in) :: threads   !! 0: all
      type(thrown_t), intent(out) :: thrown(:)
      integer :: k, patch

      !$omp parallel do default(none) schedule(dynamic, 4) num_threads(team_size(threads)) &
      !$omp& shared(blocks, law, reliefs, range, contacts, step, key, first, thrown) private(k, patch)
      do k = 1, size(thrown)
         associate (o => thrown(k))
            call draw_throw(range, key, first + k - 1, reliefs, o%throw, patch)
            o%block = int(modulo(first + k - 2, int(size(blocks), i8))) + 1
            allocate (o%contacts(contacts))
            call follow_throw(blocks(o%block), law, reliefs(patch), o%throw, step, o%contacts, o%n, o%complete)
         end associate
      end do
      !$omp end parallel do
   end subroutine throw_blocks

   !> The throw of a number, and its patch.
   pure subroutine draw_throw(range, key, number, reliefs, throw, patch)
      type(throw_range_t), intent(in) :: range
      type(random_key_t), intent(in) :: key
      integer(i8), intent(in) :: number
      type(relief_t), intent(in) :: reliefs(:)
      type(throw_t), intent(out) :: throw
      integer, intent(out) :: patch
      integer(i8) :: word(words_per_block)
      real(wp) :: s, c
      integer :: quarter

      word = random_words(key, for_throw, number, 0_i8, 0_i8)  ! words 1: patch; 2, 3: place; 4: downhill
      patch = int(size(reliefs)*uniform(word(1))) + 1
      throw%place = reliefs(patch)%cell*reliefs(patch)%cells*uniform(word(2:3))
      quarter = int(4*uniform(word(4)))
      call sine_cosine((4*uniform(word(4)) - quarter - 0.5_wp)*pi/2, s, c)
      throw%downhill = [c, s]
      do quarter = quarter, 1, -1
         throw%downhill = [-throw%downhill(2), throw%downhill(1)]
      end do
      word = random_words(key, for_throw, number, 0_i8, 1_i8)  ! 1: slope; 2: speed; 3: angle; 4: spin
      throw%slope = range%slope(1) + uniform(word(1))*(range%slope(2) - range%slope(1))
      throw%speed = between(range%speed, uniform(word(2)))
      throw%angle = between(range%angle, uniform(word(3)))
      throw%spin = between(range%spin, uniform(word(4)))
      throw%gravity = range%gravity
      throw%orientation = any_orientation(key, number)
   end subroutine draw_throw

   !> Uniform over all orientations: the direction of a point that is uniform in a ball of four dimensions.
   pure function any_orientation(key, number) result(q)
      type(random_key_t), intent(in) :: key
      integer(i8), intent(in) :: number
      real(wp) :: q(4), square
      integer(i8) :: draw

      draw = 0
      do
         q = 2*uniform(random_words(key, for_attitude, number, 0_i8, draw)) - 1
         square = sum(q**2)
         if (square <= 1 .and. square > 0) exit
         draw = draw + 1
      end do
      q = q/sqrt(square)
   end function any_orientation
end module lab_throws
