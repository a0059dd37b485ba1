! SPDX-License-Identifier: BSD-3-Clause
!> Breakage of a boulder at its release or at an impact, and the fragments that start there.
module rockfall_breaking
   use rockfall_kinds, only: wp, i8
   use rockfall_math, only: squared_length
   use rockfall_random, only: random_words, uniform, for_breakage, words_per_block, cone_word, around_word
   use rockfall_terrain, only: gradient, patch_position
   use rockfall_breakage, only: area_ratio, split_volume, fragment_of, direction_in_cone, away_from_ground, kept_energy
   use rockfall_flight, only: flight_t, landing_t, flight_from
   use rockfall_rolling, only: roll_t
   use rockfall_scene_type, only: scene_t
   use rockfall_outcome, only: boulder_result_t, broken
   use rockfall_record, only: stored_part
   use rockfall_scratch, only: scratch_t, piece_t
   implicit none
   private
   public :: break_at_release, break_at_impact, fragment_piece

contains

   !> Break a block at its release, with the energy of a fall by `release_fall`.
   pure subroutine break_at_release(scene, result, scratch)
      type(scene_t), intent(in) :: scene
      type(boulder_result_t), intent(inout) :: result
      type(scratch_t), intent(inout) :: scratch

      call break_boulder(scene, result%boulder%mass*scene%gravity*scene%breakage%release_fall, result, scratch)
   end subroutine break_at_release

   !> Break a boulder after its rebound, according to the energy of its motion normal to the ground before the rebound.
   !> A boulder that rests or rolls after the rebound does not break.
   pure subroutine break_at_impact(scene, landing, v, omega_r, roll, result, flight, scratch)
      type(scene_t), intent(in) :: scene
      type(landing_t), intent(in) :: landing
      real(wp), intent(in) :: v(3)          !! incoming velocity [m/s]
      real(wp), intent(in) :: omega_r       !! W after the rebound [m/s]
      type(roll_t), intent(inout) :: roll   !! ends if the boulder breaks in a contact from a table
      type(boulder_result_t), intent(inout) :: result
      type(flight_t), intent(inout) :: flight
      type(scratch_t), intent(inout) :: scratch
      real(wp) :: g(2), normal

      if (.not. scene%breakage%at_impact .or. result%status /= 0) return
      if (roll%rolls .and. .not. roll%from_table) return
      g = gradient(scene%dem, landing%patch, landing%u, landing%w)
      normal = v(3) - dot_product(g, v(:2))
      call break_boulder(scene, 0.5_wp*result%boulder%mass*(normal*normal/(1 + dot_product(g, g))), result, scratch)
      if (result%status /= broken) return
      roll%rolls = .false.
      flight = flight_from(scene%dem, landing, flight%v, flight%heading)
      scratch%broken = piece_t(scratch%start%number, result, flight, omega_r, stored_part(scratch%record))
   end subroutine break_at_impact

   !> Break a boulder if the energy suffices and the number of fragments allows it.
   pure subroutine break_boulder(scene, energy, result, scratch)
      type(scene_t), intent(in) :: scene
      real(wp), intent(in) :: energy  !! [J]
      type(boulder_result_t), intent(inout) :: result
      type(scratch_t), intent(inout) :: scratch
      real(wp) :: ratio

      ratio = area_ratio(energy, result%boulder%volume)
      if (ratio <= scene%breakage%min_ratio) return
      call split_volume(result%boulder%volume, ratio, scene%breakage%min_volume, scratch%room, scratch%split)
      if (scratch%split%capped) result%capped = result%capped + 1
      if (size(scratch%split%volume) == 1 .and. .not. scratch%split%fines > 0) return
      result%status = broken
      result%breakages = result%breakages + 1
   end subroutine break_boulder

   !> Fragment k of the broken piece in the work space, ready to start. Its path continues the path of the piece, its
   !> counts begin at zero, and its speed and W are those of the piece times sqrt(kept_energy).
   pure type(piece_t) function fragment_piece(scene, scratch, k, number) result(piece)
      type(scene_t), intent(in) :: scene
      type(scratch_t), intent(in) :: scratch
      integer, intent(in) :: k
      integer(i8), intent(in) :: number  !! number of the fragment, from fragment_number
      integer(i8) :: word(words_per_block)
      real(wp) :: g(2), v(3)

      word = random_words(scene%key, for_breakage, number, 0_i8, 0_i8)
      associate (from => scratch%broken)
         g = gradient_below(scene, from%flight)
         v = direction_in_cone(from%flight%v, scene%breakage%half_angle, uniform(word([cone_word, around_word])))
         if (.not. from%flight%above > 0) v = away_from_ground(v, g)
         piece%number = number
         piece%flight = from%flight
         piece%flight%v = sqrt(kept_energy)*v
         piece%flight%rate = piece%flight%v(3) - dot_product(g, piece%flight%v(:2))
         if (.not. from%flight%above > 0) piece%flight%rate = max(0.0_wp, piece%flight%rate)
         piece%flight%heading = v(:2)
         piece%omega_r = sqrt(kept_energy)*from%omega_r
         piece%path = from%path
         if (allocated(piece%path%vertex)) then
            associate (n => piece%path%n, vertex => piece%path%vertex)
               if (n > 0 .and. n == size(vertex)) vertex(n)%v = piece%flight%v
            end associate
         end if
         associate (result => piece%result)
            result%boulder = fragment_of(from%result%boulder, scratch%split%volume(k))
            result%source = from%result%source
            result%block_shape = from%result%block_shape
            result%soil = from%result%soil
            result%start = from%result%start
            result%impacts = from%result%impacts
            result%path_length = from%result%path_length
            result%time = from%result%time
            result%speed_max = squared_length(piece%flight%v)
            result%energy%released = result%boulder%mass*scene%gravity*piece%flight%z
         end associate
      end associate
   end function fragment_piece

   !> Gradient of the ground below the start of a flight.
   pure function gradient_below(scene, flight) result(g)
      type(scene_t), intent(in) :: scene
      type(flight_t), intent(in) :: flight
      real(wp) :: g(2)

      associate (dem => scene%dem, patch => flight%patch)
         g = gradient(dem, patch, patch_position(dem, flight%x, patch%i), patch_position(dem, flight%y, patch%j))
      end associate
   end function gradient_below
end module rockfall_breaking
