! SPDX-License-Identifier: BSD-3-Clause
!> Many layers and impacts. A layer is a pure function of (seed, ratio, layer), an impact of (seed, layer, point,
!> impact), so results do not depend on threads and chunks.
module lab_ensemble
   use rockfall_kinds, only: wp, i8
   use rockfall_error, only: error_t, fail
   use rockfall_math, only: pi, sine_cosine
   use rockfall_threads, only: team_size
   use rockfall_random, only: random_key_t, random_words, uniform, words_per_block
   use lab_contact, only: material_t
   use lab_packing, only: packing_t, layer_t, pack_layer
   use lab_impact, only: shot_t, outcome_t, check_shot, fire
   implicit none
   private
   public :: range_t, identity_t, between, draw_shot, check_range, pack_layers, fire_shots

   integer(i8), parameter :: for_point = 66, for_shot = 67  !! purposes of the random numbers

   !> Ranges of incident states. Half of the draws are below the median; each half is uniform.
   type :: range_t
      real(wp) :: speed(3) = [2.0_wp, 10.0_wp, 25.0_wp]  !! min, median, max [m/s]
      real(wp) :: angle(3) = [3.0_wp, 20.0_wp, 60.0_wp]  !! angle to the surface [degrees]
      real(wp) :: spin(3) = [-0.5_wp, 0.25_wp, 1.0_wp]   !! W/V [-]
   end type range_t

   !> Identity of an impact.
   type :: identity_t
      integer :: place = 1        !! index of the layer in the array
      integer(i8) :: layer = 1    !! number of the layer, below 2**31
      integer(i8) :: point = 1    !! number of the point on the layer, below 2**32
      integer(i8) :: impact = 1   !! number of the impact at the point, below 2**32
   end type identity_t

contains

   !> Reject ranges that include invalid shots.
   pure subroutine check_range(template, range, error)
      type(shot_t), intent(in) :: template
      type(range_t), intent(in) :: range
      type(error_t), allocatable, intent(out) :: error
      type(shot_t) :: shot
      integer :: k

      if (.not. (rises(range%speed) .and. rises(range%angle) .and. rises(range%spin))) then
         call fail(error, "impact: speed, angle and spin must be min, median and max")
         return
      end if
      do k = 1, 3
         shot = template
         shot%speed = range%speed(k)
         shot%angle = range%angle(k)
         shot%spin = range%spin(k)
         call check_shot(shot, error)
         if (allocated(error)) return
      end do
   end subroutine check_range

   pure logical function rises(limits)
      real(wp), intent(in) :: limits(3)  !! min, median, max, any [unit]

      rises = limits(1) <= limits(2) .and. limits(2) <= limits(3)
   end function rises

   !> Draw the shot of an impact: all impacts at a point have the same aim and heading.
   pure type(shot_t) function draw_shot(template, range, key, id) result(shot)
      type(shot_t), intent(in) :: template
      type(range_t), intent(in) :: range
      type(random_key_t), intent(in) :: key
      type(identity_t), intent(in) :: id
      integer(i8) :: word(words_per_block), place
      real(wp) :: s, c
      integer :: quarter

      place = ior(shiftl(id%layer, 32), id%point)
      shot = template
      word = random_words(key, for_point, place, 0_i8, 0_i8)  ! words 1, 2: aim; 3: heading
      shot%aim = uniform(word(1:2))
      quarter = int(4*uniform(word(3)))
      call sine_cosine((4*uniform(word(3)) - quarter - 0.5_wp)*pi/2, s, c)
      shot%heading = [c, s]
      do quarter = quarter, 1, -1
         shot%heading = [-shot%heading(2), shot%heading(1)]
      end do
      word = random_words(key, for_shot, place, id%impact, 0_i8)  ! 1: speed; 2: angle; 3: spin
      shot%speed = between(range%speed, uniform(word(1)))
      shot%angle = between(range%angle, uniform(word(2)))
      shot%spin = between(range%spin, uniform(word(3)))
   end function draw_shot

   !> Draw a number: half of the draws are below the median, and each half is uniform.
   pure real(wp) function between(limits, u)
      real(wp), intent(in) :: limits(3)  !! min, median, max, any [unit]
      real(wp), intent(in) :: u          !! uniform in (0, 1) [-]

      if (u < 0.5_wp) then
         between = limits(1) + 2*u*(limits(2) - limits(1))
      else
         between = limits(2) + (2*u - 1)*(limits(3) - limits(2))
      end if
   end function between

   !> Pack layers `first` to `first + size(layers) - 1`. The error belongs to the first layer that fails.
   subroutine pack_layers(packing, material, key, first, threads, layers, error)
      type(packing_t), intent(in) :: packing
      type(material_t), intent(in) :: material
      type(random_key_t), intent(in) :: key
      integer(i8), intent(in) :: first
      integer, intent(in) :: threads  !! number of threads; 0: all
      type(layer_t), intent(out) :: layers(:)
      type(error_t), allocatable, intent(out) :: error
      type :: slot_t
         type(error_t), allocatable :: error
      end type slot_t
      type(slot_t) :: slots(size(layers))
      integer :: k

      !$omp parallel do default(none) schedule(dynamic, 1) num_threads(team_size(threads)) &
      !$omp& shared(packing, material, key, first, layers, slots) private(k)
      do k = 1, size(layers)
         call pack_layer(packing, material, key, first + k - 1, layers(k), slots(k)%error)
      end do
      !$omp end parallel do
      do k = 1, size(layers)
         if (.not. allocated(slots(k)%error)) cycle
         call move_alloc(slots(k)%error, error)
         return
      end do
   end subroutine pack_layers

   !> Draw and fire the shots `ids`.
   subroutine fire_shots(layers, packing, material, template, range, key, ids, threads, shots, outcomes)
      type(layer_t), intent(in) :: layers(:)
      type(packing_t), intent(in) :: packing
      type(material_t), intent(in) :: material
      type(shot_t), intent(in) :: template
      type(range_t), intent(in) :: range
      type(random_key_t), intent(in) :: key
      type(identity_t), intent(in) :: ids(:)
      integer, intent(in) :: threads  !! number of threads; 0: all
      type(shot_t), intent(out) :: shots(:)
      type(outcome_t), intent(out) :: outcomes(:)
      integer :: k

      !$omp parallel do default(none) schedule(dynamic, 1) num_threads(team_size(threads)) &
      !$omp& shared(layers, packing, material, template, range, key, ids, shots, outcomes) private(k)
      do k = 1, size(ids)
         shots(k) = draw_shot(template, range, key, ids(k))
         call fire(layers(ids(k)%place), packing, material, shots(k), outcomes(k))
      end do
      !$omp end parallel do
   end subroutine fire_shots
end module lab_ensemble
