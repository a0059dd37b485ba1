! SPDX-License-Identifier: BSD-3-Clause
!> Random numbers of a boulder in its scene: block shape, rebounds, and ground properties.
module rockfall_draws
   use rockfall_kinds, only: wp, i8
   use rockfall_math, only: exponential
   use rockfall_random, only: random_key_t, normal_table_t, random_words, uniform, normal, for_release, for_impact, &
                              for_ground, for_strength, words_per_block, volume_word, shape_word, deviate_word, &
                              column_word, row_word
   use rockfall_boulder, only: soil_draw_t, volume_distribution_t, list_volume, list_item
   use rockfall_block_shape, only: drawn_shape
   use rockfall_scene_type, only: scene_t
   implicit none
   private
   public :: block_shape_of, drawn_soil, impact_words, ground_uniforms

contains

   !> Shape of a boulder: given by its source or by its volume in a list, or drawn; 0 if the scene has only one shape.
   pure integer function block_shape_of(scene, volumes, source, number) result(shape)
      type(scene_t), intent(in) :: scene
      type(volume_distribution_t), intent(in) :: volumes  !! volume distribution of the source
      integer, intent(in) :: source
      integer(i8), intent(in) :: number
      integer(i8) :: word(words_per_block)

      shape = 0
      if (.not. allocated(scene%shapes)) return
      if (allocated(scene%shapes%of_source)) shape = scene%shapes%of_source(source)
      if (shape > 0) return
      word = random_words(scene%key, for_release, number, 0_i8, 0_i8)
      if (volumes%kind == list_volume .and. allocated(volumes%list_shape)) then
         shape = volumes%list_shape(list_item(volumes, word(volume_word)))
         return
      end if
      shape = drawn_shape(scene%shapes, uniform(word(shape_word)))
   end function block_shape_of

   !> Properties of the ground for a boulder along its whole path: ground that is stronger for this boulder at one point
   !> is stronger for it everywhere.
   pure type(soil_draw_t) function drawn_soil(key, table, radius_sigma, number) result(soil)
      type(random_key_t), intent(in) :: key
      type(normal_table_t), intent(in) :: table
      real(wp), intent(in) :: radius_sigma  !! standard deviation of ln R_m [-]
      integer(i8), intent(in) :: number
      integer(i8) :: word(words_per_block)

      word = random_words(key, for_strength, number, 0_i8, 0_i8)
      soil = soil_draw_t(normal(table, word(deviate_word)), uniform(word(column_word)), uniform(word(row_word)))
      soil%ratio_factor = exponential(radius_sigma*soil%deviate)
   end function drawn_soil

   !> Random words of a rebound.
   pure function impact_words(scene, number, impact) result(word)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: number
      integer, intent(in) :: impact  !! 1..
      integer(i8) :: word(words_per_block)

      word = random_words(scene%key, for_impact, number, int(impact, i8), 0_i8)
   end function impact_words

   !> Uniform numbers in (0, 1) [-] for the ground properties at a contact.
   pure function ground_uniforms(scene, number, impact) result(u)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: number
      integer, intent(in) :: impact
      real(wp) :: u(words_per_block)

      u = uniform(random_words(scene%key, for_ground, number, int(impact, i8), 0_i8))
   end function ground_uniforms
end module rockfall_draws
