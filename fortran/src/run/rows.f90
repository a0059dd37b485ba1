! SPDX-License-Identifier: BSD-3-Clause
!> Results as rows of numbers in map coordinates, the same for both programs.
module rockfall_result
   use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan
   use rockfall_kinds, only: wp, i8
   use rockfall_terrain, only: terrain_t
   use rockfall_boulder, only: release_t, feature_of, kinetic_energy
   use rockfall_outcome, only: boulder_result_t
   use rockfall_crossings, only: crossing_t
   use rockfall_scratch, only: contact_t
   use rockfall_variables, only: boulder_fields, boulder_counts, line_fields, vertex_fields, row_reals, row_integers
   implicit none
   private
   public :: boulder_row, boulder_count_row, real_row, integer_row, line_row, vertex_row

contains

   !> Values of `boulder_fields`.
   pure function boulder_row(dem, fate) result(row)
      type(terrain_t), intent(in) :: dem
      type(boulder_result_t), intent(in) :: fate
      real(wp) :: row(size(boulder_fields))
      real(wp) :: origin(3)

      origin = [dem%x0, dem%y0, 0.0_wp]
      row = [fate%boulder%volume, fate%start + origin, fate%stop + origin, fate%path_length, &
             sqrt((fate%stop(1) - fate%start(1))**2 + (fate%stop(2) - fate%start(2))**2), fate%time, &
             fate%speed_max, fate%jump_height_max]
   end function boulder_row

   !> Values of `boulder_counts`.
   pure function boulder_count_row(fate) result(row)
      type(boulder_result_t), intent(in) :: fate
      integer :: row(size(boulder_counts))

      row = [fate%status, fate%impacts, fate%source, fate%rebounds, fate%redrawn, fate%forced, fate%out_of_range, &
             fate%out_of_speed, fate%out_of_angle]
   end function boulder_count_row

   !> Values of `row_reals`.
   pure function real_row(dem, fate) result(row)
      type(terrain_t), intent(in) :: dem
      type(boulder_result_t), intent(in) :: fate
      real(wp) :: row(size(row_reals))

      associate (e => fate%energy)
         row = [boulder_row(dem, fate), e%released, e%ground, e%trees, e%barriers, e%left]
      end associate
   end function real_row

   !> Values of `row_integers`.
   pure function integer_row(release, fate) result(row)
      type(release_t), intent(in) :: release
      type(boulder_result_t), intent(in) :: fate
      integer :: row(size(row_integers))

      row = [fate%impacts, fate%source, feature_of(release, int(fate%source, i8)), fate%trees_hit]
   end function integer_row

   !> Values of `line_fields`; NaN if the boulder did not cross. Energies: Bourrier et al. 2009, eqs 1-3.
   pure function line_row(dem, fate, crossing) result(row)
      type(terrain_t), intent(in) :: dem
      type(boulder_result_t), intent(in) :: fate
      type(crossing_t), intent(in) :: crossing
      real(wp) :: row(size(line_fields))

      row = ieee_value(0.0_wp, ieee_quiet_nan)
      if (.not. crossing%crossed) return
      row = [crossing%x + dem%x0, crossing%y + dem%y0, crossing%time, &
             sqrt(crossing%v(1)**2 + crossing%v(2)**2 + crossing%v(3)**2), crossing%v, crossing%omega, &
             crossing%jump_height, crossing%passing_height, &
             kinetic_energy(fate%boulder, crossing%v, crossing%omega)]
   end function line_row

   !> Values of `vertex_fields`.
   pure function vertex_row(dem, vertex) result(row)
      type(terrain_t), intent(in) :: dem
      type(contact_t), intent(in) :: vertex
      real(wp) :: row(size(vertex_fields))

      row = [vertex%x + dem%x0, vertex%y + dem%y0, vertex%z, vertex%time, vertex%v, vertex%v_in, vertex%v_out, &
             vertex%ratio]
   end function vertex_row
end module rockfall_result
