! SPDX-License-Identifier: BSD-3-Clause
!> The scene: everything that a boulder needs to know, the same for all boulders of a run. rockfall_scene builds it.
module rockfall_scene_type
   use rockfall_kinds, only: wp, i8
   use rockfall_random, only: random_key_t, normal_table_t
   use rockfall_sobol, only: sobol_t
   use rockfall_terrain, only: terrain_t
   use rockfall_surface, only: surface_t
   use rockfall_boulder, only: source_boulder_t, feature_t, volume_distribution_t, release_t, source_of, inertia_factor
   use rockfall_impact, only: impact_set_t, impact_ratios
   use rockfall_ground, only: ground_t
   use rockfall_direction, only: lateral_t, past_aspect
   use rockfall_line, only: line_t
   use rockfall_barrier, only: barrier_t
   use rockfall_forest, only: forest_t
   implicit none
   private
   public :: scene_t, goes_in_lanes, has_obstacles, inertia_of, is_slow
   public :: one_by_one, narrow_lanes, wide_lanes

   !> How boulders are carried on: each alone; several at a time; more of them, where the processor can.
   integer, parameter :: one_by_one = 0, narrow_lanes = 1, wide_lanes = 2

   !> Everything that a boulder needs to know; the same for all boulders of a run.
   type :: scene_t
      type(random_key_t) :: key            !! from the seed
      type(normal_table_t) :: table
      type(sobol_t) :: sobol               !! of the volume and of the words of the first rebound
      type(terrain_t) :: dem
      type(surface_t) :: surface
      type(impact_set_t) :: sets(impact_ratios)
      logical :: between_ratios = .false.  !! a ratio between two sets is served by either, at random
      logical :: ground_drawn = .false.    !! it or something else of the ground is random: more words an impact
      integer :: turning = past_aspect     !! rule of turning_t
      type(lateral_t), allocatable :: lateral(:)  !! of each ratio; only by_lab
      type(ground_t), allocatable :: grounds(:)   !! only where there are others than `sets`
      type(volume_distribution_t) :: volumes
      type(source_boulder_t), allocatable :: of_source(:)  !! where sources say it; `volumes` are factors on these
      type(feature_t), allocatable :: features(:)          !! where a layer says more of releases than where they are
      type(release_t) :: release
      type(line_t), allocatable :: lines(:)        !! evaluation lines, and those of the barriers
      type(barrier_t), allocatable :: barriers(:)
      type(forest_t), allocatable :: forest
      real(wp) :: gravity = 9.81_wp        !! [m/s2]
      real(wp) :: stop_speed = 0.5_wp      !! slower after a rebound: it rests, or rolls on [m/s]
      real(wp) :: rest_slope = 1.0e30_wp   !! tangent of the rest angle of its sets: where it is steeper it rolls [-]
      integer :: max_impacts = 100000      !! contacts, after which a boulder ends
      logical :: histograms_requested = .false.
      logical :: energies_requested = .false.
      integer :: lanes = wide_lanes        !! or less, where the processor or what is requested has none
   end type scene_t

contains

   !> Whether several boulders may be carried on at a time: they meet nothing but the ground, and turn past the aspect.
   pure logical function goes_in_lanes(scene)
      type(scene_t), intent(in) :: scene

      goes_in_lanes = .not. (has_obstacles(scene) .or. scene%energies_requested) .and. scene%turning == past_aspect
   end function goes_in_lanes

   !> Whether there is anything but the ground to meet.
   pure logical function has_obstacles(scene)
      type(scene_t), intent(in) :: scene

      has_obstacles = allocated(scene%barriers) .or. allocated(scene%forest)
   end function has_obstacles

   !> The moment of inertia of a boulder, I/(m R_b**2) [-].
   pure real(wp) function inertia_of(scene, number)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: number

      inertia_of = inertia_factor
      if (allocated(scene%of_source)) inertia_of = scene%of_source(source_of(scene%release, number))%inertia
   end function inertia_of

   !> Whether a boulder is too slow to fly on.
   pure logical function is_slow(scene, speed2)
      type(scene_t), intent(in) :: scene
      real(wp), intent(in) :: speed2  !! |v|**2 [m2/s2]

      is_slow = speed2 < scene%stop_speed**2
   end function is_slow
end module rockfall_scene_type
