! SPDX-License-Identifier: BSD-3-Clause
!> Many random throws. A throw is a pure function of (seed, number), so results do not depend on threads and chunks.
module lab_throws
   use rockfall_kinds, only: wp, i8
   use rockfall_threads, only: team_size
   use rockfall_random, only: random_key_t
   use lab_rotation, only: any_orientation
   use lab_block, only: block_t
   use lab_yielding_ground, only: relief_t
   use lab_pressure, only: law_t
   use lab_contact_record, only: throw_t, thrown_t
   use lab_throw_range, only: throw_range_t, draw_throw
   use lab_throw, only: follow_throw
   implicit none
   private
   public :: throw_blocks

   integer(i8), parameter :: for_throw = 68, for_attitude = 69  !! purposes of the random numbers

contains

   !> Throw `first` to `first + size(thrown) - 1`. Throw k uses block mod(k - 1, blocks) + 1.
   subroutine throw_blocks(blocks, law, reliefs, range, contacts, step, key, first, threads, thrown)
      type(block_t), intent(in) :: blocks(:)
      type(law_t), intent(in) :: law
      type(relief_t), intent(in) :: reliefs(:)
      type(throw_range_t), intent(in) :: range
      integer, intent(in) :: contacts  !! maximum number of contacts per throw
      real(wp), intent(in) :: step     !! time step relative to the default [-]
      type(random_key_t), intent(in) :: key
      integer(i8), intent(in) :: first
      integer, intent(in) :: threads   !! number of threads; 0: all
      type(thrown_t), intent(out) :: thrown(:)
      integer :: k, patch

      !$omp parallel do default(none) schedule(dynamic, 4) num_threads(team_size(threads)) &
      !$omp& shared(blocks, law, reliefs, range, contacts, step, key, first, thrown) private(k, patch)
      do k = 1, size(thrown)
         associate (o => thrown(k))
            call draw_block_throw(range, key, first + k - 1, reliefs, o%throw, patch)
            o%body = int(modulo(first + k - 2, int(size(blocks), i8))) + 1
            allocate (o%contacts(contacts))
            call follow_throw(blocks(o%body), law, reliefs(patch), o%throw, step, o%contacts, o%n, o%complete)
         end associate
      end do
      !$omp end parallel do
   end subroutine throw_blocks

   !> Draw throw `number`, and the patch of relief for it.
   pure subroutine draw_block_throw(range, key, number, reliefs, throw, patch)
      type(throw_range_t), intent(in) :: range
      type(random_key_t), intent(in) :: key
      integer(i8), intent(in) :: number
      type(relief_t), intent(in) :: reliefs(:)
      type(throw_t), intent(out) :: throw
      integer, intent(out) :: patch
      real(wp) :: choice

      call draw_throw(range, key, for_throw, number, throw, choice)
      patch = int(size(reliefs)*choice) + 1
      throw%place = reliefs(patch)%cell*reliefs(patch)%cells*throw%place
      throw%orientation = any_orientation(key, for_attitude, number, 0_i8)
   end subroutine draw_block_throw
end module lab_throws
