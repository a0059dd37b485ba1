! SPDX-License-Identifier: BSD-3-Clause
!> The scene: all input of a boulder's simulation, constant during a run; built by rockfall_scene.
module rockfall_scene_type
   use rockfall_kinds, only: wp, i8
   use rockfall_random, only: random_key_t, normal_table_t, boulder_number
   use rockfall_terrain, only: terrain_t
   use rockfall_surface, only: surface_t
   use rockfall_boulder, only: source_boulder_t, feature_t, volume_distribution_t, release_t, source_of, inertia_factor
   use rockfall_block_shape, only: shape_mix_t
   use rockfall_impact, only: impact_set_t, impact_ratios
   use rockfall_ground, only: ground_t
   use rockfall_direction, only: lateral_t, past_aspect, by_lab
   use rockfall_line, only: line_t
   use rockfall_line_index, only: line_index_t
   use rockfall_barrier, only: barrier_t
   use rockfall_forest, only: forest_t
   use rockfall_breakage, only: breakage_t
   implicit none
   private
   public :: scene_t, n_grounds, goes_in_lanes, has_obstacles, needs_energies, inertia_of, is_slow
   public :: one_by_one, narrow_lanes, wide_lanes, masked_lanes

   !> Execution modes: boulders one by one, or in lanes for any processor, for AVX2, or for AVX-512.
   integer, parameter :: one_by_one = 0, narrow_lanes = 1, wide_lanes = 2, masked_lanes = 3

   !> All input of a boulder's simulation, constant during a run.
   type :: scene_t
      type(random_key_t) :: key            !! key from the seed
      type(normal_table_t) :: table

      type(terrain_t) :: dem
      type(surface_t) :: surface
      type(impact_set_t) :: sets(impact_ratios)
      logical :: between_ratios = .false.  !! if a ratio is between two sets, either set is selected at random
      logical :: has_tables = .false.      !! at least one ground has an impact table
      real(wp) :: radius_sigma = 0.0_wp    !! standard deviation of ln R_m between boulders [-]
      logical :: ground_drawn = .false.    !! ground properties are random: impacts need additional random words
      integer :: turning = past_aspect     !! turning rule, as in turning_t
      type(lateral_t), allocatable :: lateral(:)  !! lateral deviations for each ratio; only for by_lab
      type(ground_t), allocatable :: grounds(:)   !! grounds, unless `sets` applies everywhere. The first n_grounds
                                               !! belong to cells; the others replace them for a shape
      type(shape_mix_t), allocatable :: shapes    !! if boulders have several shapes
      type(volume_distribution_t) :: volumes
      type(source_boulder_t), allocatable :: of_source(:)  !! boulders given by sources; `volumes` then gives factors
      type(feature_t), allocatable :: features(:)          !! if a layer has release attributes
      type(release_t) :: release
      type(line_t), allocatable :: lines(:)        !! evaluation lines, then barriers
      type(line_index_t), allocatable :: line_index  !! if there are many lines
      type(barrier_t), allocatable :: barriers(:)
      type(forest_t), allocatable :: forest
      type(breakage_t), allocatable :: breakage    !! if boulders may break
      real(wp) :: gravity = 9.81_wp        !! [m/s2]
      real(wp) :: stop_speed = 0.5_wp      !! speed after a rebound below which a boulder rests or rolls [m/s]
      real(wp) :: rest_slope = 1.0e30_wp   !! tangent of the rest angle of `sets`: boulders roll on steeper ground [-]
      real(wp) :: object_width = 0.0_wp    !! width of objects for maps of hits [m]
      integer :: max_impacts = 100000      !! number of contacts after which a boulder ends
      logical :: histograms_requested = .false.
      logical :: energies_requested = .false.
      logical :: apexes_requested = .false.  !! find the apex of the talus below each source
      integer :: lanes = masked_lanes      !! most advanced mode to use; limited by processor and requested outputs
   end type scene_t

contains

   !> Number of grounds of the cells; 0 if there are only impact sets.
   pure integer function n_grounds(scene)
      type(scene_t), intent(in) :: scene

      n_grounds = 0
      if (allocated(scene%grounds)) n_grounds = size(scene%grounds)
      if (.not. allocated(scene%shapes)) return
      if (allocated(scene%shapes%ground)) n_grounds = size(scene%shapes%ground, 1)
   end function n_grounds

   !> Return whether boulders can run in lanes: not if they may break, or turn by deviations from the laboratory.
   pure logical function goes_in_lanes(scene)
      type(scene_t), intent(in) :: scene

      goes_in_lanes = .not. allocated(scene%breakage) .and. scene%turning /= by_lab
   end function goes_in_lanes

   !> Return whether there are trees or barriers.
   pure logical function has_obstacles(scene)
      type(scene_t), intent(in) :: scene

      has_obstacles = allocated(scene%barriers) .or. allocated(scene%forest)
   end function has_obstacles

   !> Return whether results have energy balances.
   pure logical function needs_energies(scene)
      type(scene_t), intent(in) :: scene

      needs_energies = has_obstacles(scene) .or. scene%energies_requested
   end function needs_energies

   !> Moment of inertia of a boulder, I/(m R_b**2) [-].
   pure real(wp) function inertia_of(scene, number)
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: number  !! number of a boulder or a fragment

      inertia_of = inertia_factor
      if (allocated(scene%of_source)) &
         inertia_of = scene%of_source(source_of(scene%release, boulder_number(number)))%inertia
   end function inertia_of

   !> Return whether a boulder is too slow to fly.
   pure logical function is_slow(scene, speed2)
      type(scene_t), intent(in) :: scene
      real(wp), intent(in) :: speed2  !! |v|**2 [m2/s2]

      is_slow = speed2 < scene%stop_speed**2
   end function is_slow
end module rockfall_scene_type
