! SPDX-License-Identifier: BSD-3-Clause
!> Ground types: rebounds by impact sets, by an impact table, or by a classical model.
module rockfall_ground
   use rockfall_kinds, only: wp, i8
   use rockfall_math, only: tangent
   use rockfall_random, only: random_key_t, normal_table_t, rebound_words
   use rockfall_boulder, only: boulder_t
   use rockfall_impact, only: impact_set_t, rebound_t, rebound
   use rockfall_direction, only: lateral_t
   use rockfall_impact_table, only: impact_table_t
   use rockfall_classical_rebound, only: classical_t, classical_rebound, lengthen_hop, by_sets
   implicit none
   private
   public :: ground_t, ground_rebound, is_stochastic, rest_slope_of

   type :: ground_t
      character(len=:), allocatable :: name
      type(classical_t) :: classical              !! rebound model, with the parameters of classical models
      type(impact_set_t), allocatable :: sets(:)  !! impact sets for R_b/R_m = 1, 2, 3, 4, 5
      type(lateral_t), allocatable :: lateral(:)  !! lateral deviations of the sets, if they determine the turn
      type(impact_table_t), allocatable :: table  !! impact table, if the model uses one
      real(wp) :: rest_slope = 1.0e30_wp          !! tangent of the maximum slope at which boulders can rest [-]
   end type ground_t

contains

   !> Tangent of a rest angle; at 90 degrees boulders can rest anywhere.
   pure real(wp) function rest_slope_of(angle)
      real(wp), intent(in) :: angle  !! [degrees]

      rest_slope_of = 1.0e30_wp
      if (angle < 90) rest_slope_of = tangent(angle)
   end function rest_slope_of

   !> Return whether the ground uses impact sets.
   pure logical function is_stochastic(ground)
      type(ground_t), intent(in) :: ground

      is_stochastic = ground%classical%model == by_sets
   end function is_stochastic

   !> Compute one rebound.
   pure subroutine ground_rebound(ground, table, key, number, impact, words, tilt, boulder, inertia, obstacle, pull, &
                                  class, v_in, out)
      type(ground_t), intent(in) :: ground
      type(normal_table_t), intent(in) :: table
      type(random_key_t), intent(in) :: key
      integer(i8), intent(in) :: number, impact       !! numbers of the boulder and of the contact
      integer(i8), intent(in) :: words(rebound_words)  !! random words of the first draw
      real(wp), intent(in) :: tilt                    !! tilt of the ground, divided by its maximum, 0 to 1 [-]
      type(boulder_t), intent(in) :: boulder
      real(wp), intent(in) :: inertia                 !! moment of inertia of the boulder, I/(m R**2) [-]
      real(wp), intent(in) :: obstacle                !! obstacle height [m]
      real(wp), intent(in) :: pull                    !! gravity along the normal of the ground [m/s2]
      integer, intent(in) :: class                    !! index of the impact set
      real(wp), intent(in) :: v_in(3)                 !! V_t, V_n, W [m/s]
      type(rebound_t), intent(out) :: out

      if (is_stochastic(ground)) then
         call rebound(ground%sets(class), table, key, number, impact, words, v_in, out)
      else
         call classical_rebound(ground%classical, table, words, tilt, boulder, inertia, obstacle, v_in, out)
         call lengthen_hop(ground%classical, boulder, pull, out%v)
      end if
   end subroutine ground_rebound
end module rockfall_ground
