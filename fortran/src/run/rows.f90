! SPDX-License-Identifier: BSD-3-Clause
!> Results as rows of numbers in map coordinates, for both programs.
module rockfall_rows
   use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan
   use rockfall_kinds, only: wp, i8
   use rockfall_apex, only: baseline
   use rockfall_math, only: arcsine, degree
   use rockfall_terrain, only: terrain_t
   use rockfall_line, only: line_t
   use rockfall_line_samples, only: place_along
   use rockfall_boulder, only: boulder_t, release_t, feature_of, kinetic_energy
   use rockfall_outcome, only: boulder_result_t
   use rockfall_crossings, only: crossing_t
   use rockfall_record, only: vertex_t
   use rockfall_variables, only: boulder_fields, boulder_counts, line_fields, vertex_fields, row_reals, row_integers, &
                                 crossing_fields
   implicit none
   private
   public :: boulder_row, boulder_count_row, real_row, integer_row, line_row, crossing_row, vertex_row

contains

   !> Values of `boulder_fields`.
   pure function boulder_row(dem, outcome) result(row)
      type(terrain_t), intent(in) :: dem
      type(boulder_result_t), intent(in) :: outcome
      real(wp) :: row(size(boulder_fields))
      real(wp) :: origin(3)

      origin = [dem%x0, dem%y0, 0.0_wp]
      row = [outcome%boulder%volume, outcome%start + origin, outcome%stop + origin, outcome%path_length, &
             sqrt((outcome%stop(1) - outcome%start(1))**2 + (outcome%stop(2) - outcome%start(2))**2), &
             outcome%time, outcome%speed_max, outcome%jump_height_max]
   end function boulder_row

   !> Values of `boulder_counts`.
   pure function boulder_count_row(outcome) result(row)
      type(boulder_result_t), intent(in) :: outcome
      integer :: row(size(boulder_counts))

      row = [outcome%status, outcome%impacts, outcome%source, outcome%rebounds, outcome%redrawn, outcome%forced, &
             outcome%out_of_range, outcome%out_of_speed, outcome%out_of_angle]
   end function boulder_count_row

   !> Values of `row_reals`.
   pure function real_row(dem, outcome) result(row)
      type(terrain_t), intent(in) :: dem
      type(boulder_result_t), intent(in) :: outcome
      real(wp) :: row(size(row_reals))

      associate (e => outcome%energy)
         row = [boulder_row(dem, outcome), e%released, e%ground, e%trees, e%barriers, e%left, outcome%boulder%mass, &
                shadow_angle(outcome), outcome%fines, e%breakage]
      end associate
   end function real_row

   !> Angle below the horizontal [degree] of the line from the apex of the talus to the end of a boulder; NaN without an
   !> apex. The plan distance is the difference of their distances from the source, so that a boulder to the side of the
   !> apex does not count as far away. The angle is 90 unless the end is below the apex and at least `baseline` beyond
   !> it.
   pure real(wp) function shadow_angle(outcome)
      type(boulder_result_t), intent(in) :: outcome
      real(wp) :: fall, distance

      shadow_angle = ieee_value(shadow_angle, ieee_quiet_nan)
      if (.not. outcome%has_apex) return
      fall = outcome%apex(3) - outcome%stop(3)
      distance = sqrt(sum((outcome%stop(:2) - outcome%start(:2))**2)) &
                 - sqrt(sum((outcome%apex(:2) - outcome%start(:2))**2))
      shadow_angle = 90
      if (fall > 0 .and. distance >= baseline) shadow_angle = arcsine(fall/sqrt(fall**2 + distance**2))/degree
   end function shadow_angle

   !> Values of `row_integers`.
   pure function integer_row(release, outcome) result(row)
      type(release_t), intent(in) :: release
      type(boulder_result_t), intent(in) :: outcome
      integer :: row(size(row_integers))

      row = [outcome%impacts, outcome%source, feature_of(release, int(outcome%source, i8)), outcome%block_shape, &
             outcome%trees_hit, outcome%fragments, outcome%breakages, outcome%capped]
   end function integer_row

   !> Values of `line_fields`. Energies: Bourrier et al. 2009, eqs 1-3.
   pure function line_row(dem, outcome, crossing) result(row)
      type(terrain_t), intent(in) :: dem
      type(boulder_result_t), intent(in) :: outcome
      type(crossing_t), intent(in) :: crossing
      real(wp) :: row(size(line_fields))
      type(boulder_t) :: boulder

      boulder = outcome%boulder
      if (crossing%fragments > 0) boulder = crossing%fragment
      row = [crossing%x + dem%x0, crossing%y + dem%y0, crossing%time, &
             sqrt(crossing%v(1)**2 + crossing%v(2)**2 + crossing%v(3)**2), crossing%v, crossing%omega, &
             crossing%jump_height, crossing%passing_height, &
             kinetic_energy(boulder, crossing%v, crossing%omega)]
   end function line_row

   !> Values of `crossing_fields`.
   pure function crossing_row(line, crossing) result(row)
      type(line_t), intent(in) :: line
      type(crossing_t), intent(in) :: crossing
      real(wp) :: row(size(crossing_fields))

      row = [crossing%time, place_along(line, [crossing%x, crossing%y]), crossing%v, crossing%omega, &
             crossing%jump_height, crossing%passing_height]
   end function crossing_row

   !> Values of `vertex_fields`.
   pure function vertex_row(dem, vertex) result(row)
      type(terrain_t), intent(in) :: dem
      type(vertex_t), intent(in) :: vertex
      real(wp) :: row(size(vertex_fields))

      row = [vertex%x + dem%x0, vertex%y + dem%y0, vertex%z, vertex%time, vertex%v, vertex%v_in, vertex%v_out, &
             vertex%ratio, real(vertex%leg, wp)]
   end function vertex_row
end module rockfall_rows
