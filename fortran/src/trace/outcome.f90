! SPDX-License-Identifier: BSD-3-Clause
!> Result of a boulder: its status, distances, speeds, and energy balance (theory, chapter 10).
module rockfall_outcome
   use rockfall_kinds, only: wp
   use rockfall_terrain, only: terrain_t, patch_t, in_window
   use rockfall_boulder, only: boulder_t, soil_draw_t, kinetic_energy
   use rockfall_impact, only: rebound_t
   implicit none
   private
   public :: boulder_result_t, at_rest, departure_status, add_flight, count_outcome, add_ground_loss, &
             close_energy_balance
   public :: stopped, absorbed, left_domain, impact_limit, hit_nodata, stopped_by_tree, stopped_by_barrier
   public :: left_window, broken

   !> Status codes, in the order of the table of rockfall_variables; 0 while the boulder moves.
   integer, parameter :: stopped = 1, absorbed = 2, left_domain = 3, impact_limit = 4, hit_nodata = 5, &
                         stopped_by_tree = 6, stopped_by_barrier = 7
   integer, parameter :: broken = -2       !! broken into fragments, which continue; never in results
   integer, parameter :: left_window = -1  !! at the edge of the loaded window: traced again; never in results

   !> Energy balance of a boulder: released = ground + trees + barriers + left + breakage [J].
   type :: energy_balance_t
      real(wp) :: released = 0.0_wp  !! kinetic energy at release, plus the loss of potential energy on the path
      real(wp) :: ground = 0.0_wp, trees = 0.0_wp, barriers = 0.0_wp  !! energy absorbed by each
      real(wp) :: left = 0.0_wp      !! kinetic energy at the end
      real(wp) :: breakage = 0.0_wp  !! kinetic energy lost in breaking, including the energy of fines
   end type energy_balance_t

   !> Result of a boulder (theory, chapter 10). Components that change at each contact come first, so that they are
   !> contiguous in memory.
   type :: boulder_result_t
      type(boulder_t) :: boulder = boulder_t()
      integer :: status = 0
      integer :: impacts = 0               !! number of contacts with the ground
      real(wp) :: path_length = 0.0_wp     !! [m]
      real(wp) :: time = 0.0_wp            !! [s]
      real(wp) :: speed_max = 0.0_wp       !! maximum speed [m/s]; squared until the boulder ends
      real(wp) :: jump_height_max = 0.0_wp !! [m]
      integer :: rebounds = 0, redrawn = 0, forced = 0
      integer :: out_of_range = 0, out_of_speed = 0, out_of_angle = 0  !! numbers of rebounds outside the fitted ranges
      integer :: source = 0                !! index of the source
      integer :: block_shape = 0           !! shape, as in shape_mix_t; 0: the scene has only one
      type(soil_draw_t) :: soil = soil_draw_t()  !! if a ground has an impact table
      real(wp) :: start(3) = 0.0_wp, stop(3) = 0.0_wp  !! local coordinates [m]
      real(wp) :: apex(3) = 0.0_wp         !! apex of the talus, on request; local coordinates [m]
      logical :: has_apex = .false.        !! the apex was found
      integer :: stop_cell(2) = 0          !! column, row; only valid after a contact
      integer :: trees_hit = 0             !! number of tree hits, including repeated hits
      integer :: fragments = 1             !! number of fragments; 1: the boulder did not break
      integer :: breakages = 0, capped = 0 !! number of breakages; number of them limited by max_fragments
      real(wp) :: fines = 0.0_wp           !! volume that became fines [m3]
      type(energy_balance_t) :: energy = energy_balance_t()  !! if the scene has trees or barriers, or on request
   end type boulder_result_t

contains

   !> Return whether a boulder has come to rest.
   elemental logical function at_rest(status)
      integer, intent(in) :: status

      at_rest = any(status == [stopped, absorbed, stopped_by_tree, stopped_by_barrier])
   end function at_rest

   !> Status of a boulder that reaches an unknown patch.
   pure integer function departure_status(dem, patch) result(status)
      type(terrain_t), intent(in) :: dem
      type(patch_t), intent(in) :: patch

      status = merge(left_domain, left_window, min(patch%i, patch%j) < 1 .or. patch%i >= dem%nx .or. patch%j >= dem%ny)
      if (in_window(dem, patch%i, patch%j)) status = hit_nodata
   end function departure_status

   pure subroutine add_flight(length, time, speed2, jump_height, result)
      real(wp), intent(in) :: length, time  !! [m], [s]
      real(wp), intent(in) :: speed2        !! |v|**2 at the end of the flight [m2/s2]
      real(wp), intent(in) :: jump_height   !! maximum height [m]
      type(boulder_result_t), intent(inout) :: result

      result%path_length = result%path_length + length
      result%time = result%time + time
      result%speed_max = max(result%speed_max, speed2)
      result%jump_height_max = max(result%jump_height_max, jump_height)
   end subroutine add_flight

   !> Count a rebound, and whether it was limited or outside the fitted ranges. No branches: they would be mispredicted.
   pure subroutine count_outcome(out, outside, fast, steep, result)
      type(rebound_t), intent(in) :: out
      logical, intent(in) :: outside, fast, steep
      type(boulder_result_t), intent(inout) :: result

      result%rebounds = result%rebounds + 1
      result%redrawn = result%redrawn + merge(1, 0, out%draws > 1)
      result%forced = result%forced + merge(1, 0, out%forced)
      result%out_of_range = result%out_of_range + merge(1, 0, outside)
      result%out_of_speed = result%out_of_speed + merge(1, 0, fast)
      result%out_of_angle = result%out_of_angle + merge(1, 0, steep)
   end subroutine count_outcome

   !> Add the kinetic energy lost to the ground in a contact. Energies are per mass, times two [m2/s2].
   pure subroutine add_ground_loss(before, after, spin, result)
      real(wp), intent(in) :: before  !! energy before the contact
      real(wp), intent(in) :: after   !! energy after the contact, without `spin`
      real(wp), intent(in) :: spin    !! rotational energy after the contact that `after` does not include
      type(boulder_result_t), intent(inout) :: result

      result%energy%ground = result%energy%ground + 0.5_wp*result%boulder%mass*(before - after - spin)
   end subroutine add_ground_loss

   !> Close the energy balance with the kinetic energy at the end and the energy released along the path.
   pure subroutine close_energy_balance(gravity, z, v, omega_r, result)
      real(wp), intent(in) :: gravity  !! [m/s2]
      real(wp), intent(in) :: z        !! elevation at the end [m]
      real(wp), intent(in) :: v(3)     !! velocity at the end [m/s]
      real(wp), intent(in) :: omega_r  !! W at the end [m/s]
      type(boulder_result_t), intent(inout) :: result
      real(wp) :: kinetic

      kinetic = sum(kinetic_energy(result%boulder, v, omega_r/result%boulder%radius))
      associate (energy => result%energy)
         energy%released = energy%released - result%boulder%mass*gravity*z
         if (result%status == absorbed) then
            energy%ground = energy%ground + kinetic
         else if (result%status /= broken) then
            energy%left = kinetic
         end if
      end associate
   end subroutine close_energy_balance
end module rockfall_outcome
