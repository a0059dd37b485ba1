! SPDX-License-Identifier: BSD-3-Clause
!> Nets and walls that intercept boulders below their top edge and absorb energy up to their capacity.
module rockfall_barrier
   use rockfall_kinds, only: wp
   use rockfall_dimensions, only: n_ead_classes
   use rockfall_terrain, only: terrain_t, patch_position
   use rockfall_flight, only: landing_t
   use rockfall_direction, only: unit_vector
   use rockfall_forest, only: max_stem_energy
   implicit none
   private
   public :: barrier_t, barrier_outcome, point_in_front, ead_energy, log_capacity
   public :: stopped_there, broken_through, passed_over

   !> Outcome at a barrier. Of several crossings the most severe counts: `stopped_there` if the boulder came to rest
   !> there, else `broken_through` if it broke through at least once.
   integer, parameter :: stopped_there = 1, broken_through = 2, passed_over = 3

   !> Energy classes of EAD 340059-00-0106, falling rock protection kits: maximum energy level of classes 0 to 7 [J].
   !> Class 8 is declared by the manufacturer: give its capacity.
   real(wp), parameter :: ead_energy(0:n_ead_classes - 1) = 1000*[100.0_wp, 250.0_wp, 500.0_wp, 1000.0_wp, 1500.0_wp, &
                                                                  2000.0_wp, 3000.0_wp, 4500.0_wp]

   !> Distance in front of a barrier at which a boulder continues, as a fraction of the width of the terrain [-]: far
   !> above the rounding of coordinates, yet only a micrometre on a slope of one kilometre.
   real(wp), parameter :: barrier_offset = 1.0e-9_wp

   !> Strength of logs relative to silver fir [-]: that of spruce and larch, the lowest in Dorren and Berger (2006).
   real(wp), parameter :: log_factor = 0.9_wp
   !> Strength of a log of decay class 1 (fresh) to 4 (soft) relative to a fresh log [-]. Assumed, as no measured values
   !> are known: a linear decrease to zero in class 5 (no firm wood).
   real(wp), parameter :: decayed_strength(4) = [1.0_wp, 0.75_wp, 0.5_wp, 0.25_wp]

   type :: barrier_t
      integer :: line = 0            !! index among the lines of the scene
      real(wp) :: height = 0.0_wp    !! height of the top edge above the ground, vertical [m]
      real(wp) :: capacity = 0.0_wp  !! maximum energy absorbed [J]
   end type barrier_t

contains

   !> Outcome for a boulder at a barrier: it passes over if its centre is above the top edge. Otherwise the barrier
   !> stops it if its energy is at most the capacity; else the boulder breaks through, and the barrier absorbs its
   !> capacity.
   elemental integer function barrier_outcome(height, capacity, passing_height, energy) result(outcome)
      real(wp), intent(in) :: height          !! height of the top edge above the ground, vertical [m]
      real(wp), intent(in) :: capacity        !! [J]
      real(wp), intent(in) :: passing_height  !! height of the boulder's centre above the ground, vertical [m]
      real(wp), intent(in) :: energy          !! translational and rotational energy of the boulder [J]

      if (passing_height > height) then
         outcome = passed_over
      else if (energy > capacity) then
         outcome = broken_through
      else
         outcome = stopped_there
      end if
   end function barrier_outcome

   !> Energy [J] that a lying log absorbs. Assumption: as much as a standing stem of the same diameter (Dorren and
   !> Berger 2006), reduced by decay.
   pure real(wp) function log_capacity(diameter, decay_class)
      real(wp), intent(in) :: diameter    !! > 0 [cm]
      integer, intent(in) :: decay_class  !! 1..4

      log_capacity = decayed_strength(decay_class)*log_factor*max_stem_energy(diameter)
   end function log_capacity

   !> Point in the air just in front of a barrier. Coordinates are rounded: the distance ensures that other features at
   !> the barrier, such as a line along it, are still ahead of the next flight.
   pure type(landing_t) function point_in_front(dem, landing, v) result(point)
      type(terrain_t), intent(in) :: dem
      type(landing_t), intent(in) :: landing  !! at the barrier
      real(wp), intent(in) :: v(2)            !! velocity in plan [m/s]
      real(wp) :: offset(2)

      point = landing
      offset = unit_vector(v)*(barrier_offset*dem%cell*max(dem%nx, dem%ny))
      point%x = point%x - offset(1)
      point%y = point%y - offset(2)
      point%u = patch_position(dem, point%x, point%patch%i)
      point%w = patch_position(dem, point%y, point%patch%j)
   end function point_in_front
end module rockfall_barrier
