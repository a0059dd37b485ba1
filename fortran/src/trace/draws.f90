! SPDX-License-Identifier: BSD-3-Clause
!> Random numbers of a boulder: volume, rebounds, and ground properties. With Sobol' sampling, those of its volume and
!> its first rebound are a scrambled Sobol' point.
module rockfall_draws
   use rockfall_kinds, only: wp, i8
   use rockfall_random, only: random_words, uniform, for_release, for_impact, for_ground, words_per_block, &
                              volume_word, shape_word, obstacle_word, boulder_number
   use rockfall_sobol, only: sobol_word, scrambled, volume_dimension, obstacle_dimension
   use rockfall_boulder, only: boulder_t, volume_distribution_t, list_volume, draw_boulder, list_item, source_of, &
                               first_of
   use rockfall_block_shape, only: drawn_shape
   use rockfall_scene_type, only: scene_t
   implicit none
   private
   public :: drawn_boulder, block_shape_of, impact_words, ground_uniforms

contains

   !> Draw boulder `number` from a volume distribution.
   pure type(boulder_t) function drawn_boulder(scene, volumes, number) result(boulder)
      type(scene_t), intent(in) :: scene
      type(volume_distribution_t), intent(in) :: volumes
      integer(i8), intent(in) :: number

      if (scene%sobol%dimensions > 0) then
         boulder = draw_boulder(volumes, scene%table, scene%key, number, &
                                scrambled_word(scene, number, volume_dimension))
      else
         boulder = draw_boulder(volumes, scene%table, scene%key, number)
      end if
   end function drawn_boulder

   !> Shape of a boulder: that of its source, of its volume in a list, or drawn; 0 if the scene has only one.
   pure integer function block_shape_of(scene, volumes, source, number) result(shape)
      type(scene_t), intent(in) :: scene
      type(volume_distribution_t), intent(in) :: volumes  !! of its source
      integer, intent(in) :: source
      integer(i8), intent(in) :: number
      integer(i8) :: word(words_per_block)

      shape = 0
      if (.not. allocated(scene%shapes)) return
      if (allocated(scene%shapes%of_source)) shape = scene%shapes%of_source(source)
      if (shape > 0) return
      word = random_words(scene%key, for_release, number, 0_i8, 0_i8)
      if (volumes%kind == list_volume .and. allocated(volumes%list_shape)) then
         if (scene%sobol%dimensions > 0) word(volume_word) = scrambled_word(scene, number, volume_dimension)
         shape = volumes%list_shape(list_item(volumes, word(volume_word)))
         return
      end if
      shape = drawn_shape(scene%shapes, uniform(word(shape_word)))
   end function block_shape_of

   !> Random words of a rebound.
   pure function impact_words(scene, number, impact) result(word)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: number
      integer, intent(in) :: impact  !! 1..
      integer(i8) :: word(words_per_block)

      word = random_words(scene%key, for_impact, number, int(impact, i8), 0_i8)
      if (impact == 1 .and. scene%sobol%dimensions > 1) then
         if (number == boulder_number(number)) word = scrambled_words(scene, number)  ! a fragment has no point
      end if
   end function impact_words

   !> Scrambled words of the first rebound. All at once: a variable index would keep the usual words in memory.
   pure function scrambled_words(scene, number) result(word)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: number
      integer(i8) :: word(words_per_block)
      integer :: k

      do k = 1, size(word)
         word(k) = scrambled_word(scene, number, volume_dimension + k)
      end do
   end function scrambled_words

   !> Uniform numbers in (0, 1) [-] for the ground properties at a contact.
   pure function ground_uniforms(scene, number, impact) result(u)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: number
      integer, intent(in) :: impact
      integer(i8) :: word(words_per_block)
      real(wp) :: u(words_per_block)

      word = random_words(scene%key, for_ground, number, int(impact, i8), 0_i8)
      if (impact == 1 .and. scene%sobol%dimensions > 1) then
         if (number == boulder_number(number)) word(obstacle_word) = scrambled_word(scene, number, obstacle_dimension)
      end if
      u = uniform(word)
   end function ground_uniforms

   !> Word of the boulder's scrambled Sobol' point: its volume, then the words of its first rebound.
   pure integer(i8) function scrambled_word(scene, number, dimension)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: number
      integer, intent(in) :: dimension
      integer(i8) :: source, index

      source = source_of(scene%release, number)
      index = number - first_of(scene%release, source)
      scrambled_word = scrambled(sobol_word(scene%sobol, index, dimension), scene%key, source, dimension)
   end function scrambled_word
end module rockfall_draws
