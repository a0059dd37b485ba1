! SPDX-License-Identifier: BSD-3-Clause
!> Builds the scene from a case and the arrays that it requires, for both programs.
module rockfall_scene
   use, intrinsic :: ieee_arithmetic, only: ieee_is_nan
   use rockfall_kinds, only: wp, i4, i8
   use rockfall_error, only: error_t, fail
   use rockfall_text, only: integer_text, line_of
   use rockfall_random, only: random_key, normal_table
   use rockfall_grid, only: grid_t
   use rockfall_terrain, only: terrain
   use rockfall_surface, only: method_a
   use rockfall_shares, only: last_boulders, last_boulders_by_weight, proportional_part
   use rockfall_line, only: line, object_line
   use rockfall_line_index, only: line_index, worth_indexing
   use rockfall_barrier, only: barrier_t
   use rockfall_boulder, only: release_t, mean_volume
   use rockfall_block_shape, only: shape_mix
   use rockfall_ground, only: ground_t, rest_slope_of, is_stochastic
   use rockfall_forest, only: build_forest
   use rockfall_scene_type, only: scene_t
   use rockfall_scene_arrays, only: scene_arrays_t, feature_fields
   use rockfall_bounds, only: boulder_count, max_radius
   use rockfall_case_keys, only: map_names
   use rockfall_case, only: case_t
   use rockfall_table_arrays, only: table_arrays_t, count_tables
   use rockfall_grounds, only: read_ground, table_ground, read_stochastic, rest_angle_of_rocks
   implicit none
   private
   public :: build_scene_of_case, object_reach

   !> Maximum distance of the vertices of lines from the middle of the terrain: the larger of `far_away` [m], and
   !> `far_sizes` half sides of the terrain.
   real(wp), parameter :: far_away = 1.0e5_wp, far_sizes = 20

   !> Ground type as passed to the kernel.
   type :: ground_text_t
      character(len=:), allocatable :: name
      character(len=:), allocatable :: text, file  !! as in read_ground, or row of a ground table; its file; "": none
      integer :: table = 0                         !! number of the impact table. 0 and no text: the case's impact sets
   end type ground_text_t

contains

   !> Build the scene of a case. Reports errors that the text of the case alone does not reveal.
   subroutine build_scene_of_case(case, arrays, scene, error)
      type(case_t), intent(in) :: case
      type(scene_arrays_t), intent(in) :: arrays
      type(scene_t), intent(out) :: scene
      type(error_t), allocatable, intent(out) :: error

      if (case%unread /= "") then
         call fail(error, case%unread//": is a layer, which cannot be read here: run `rockfall prepare` first")
         return
      end if
      scene%key = random_key(case%seed)
      scene%table = normal_table()
      scene%gravity = case%gravity
      scene%stop_speed = case%stop_speed
      scene%rest_slope = rest_slope_of(merge(case%rest_angle, rest_angle_of_rocks(), case%rest_angle >= 0))
      scene%between_ratios = case%between_ratios
      scene%radius_sigma = case%radius_sigma
      scene%ground_drawn = case%method == method_a .or. case%between_ratios
      scene%max_impacts = case%impact_limit
      scene%histograms_requested = case%rebounds
      scene%apexes_requested = case%shadow_angle
      scene%energies_requested = case%energy_balance
      scene%object_width = case%object_width
      scene%volumes = case%volumes
      if (allocated(case%breakage)) scene%breakage = case%breakage
      call set_ground(case, arrays, scene)
      call set_release(case, arrays, scene)
      call set_boulders(case, arrays, scene)
      call set_features(case, arrays, scene)
      call set_shapes(case, arrays, scene)
      call set_lines(case, scene)
      call set_forest(case, arrays, scene)
      call check_number(case, scene, error)
      if (.not. allocated(error)) call check_lines(case, arrays%grid, error)
      if (.not. allocated(error)) call check_features(case, arrays, scene, error)
      if (.not. allocated(error)) call set_impacts(case, arrays, scene, error)
      if (.not. allocated(error)) call set_grounds(case, arrays, scene, error)
   end subroutine build_scene_of_case

   !> Split grounds from concatenated texts; `ground_names` has two lines for each, its name and its file.
   pure function parsed_grounds(arrays) result(grounds)
      type(scene_arrays_t), intent(in) :: arrays
      type(ground_text_t), allocatable :: grounds(:)
      integer :: k, first

      allocate (grounds(size(arrays%ground_length)))
      if (allocated(arrays%ground_table)) grounds%table = arrays%ground_table
      first = 1
      do k = 1, size(grounds)
         grounds(k)%name = line_of(arrays%ground_names, 2*k - 1)
         grounds(k)%file = line_of(arrays%ground_names, 2*k)
         grounds(k)%text = arrays%ground_text(first:first + arrays%ground_length(k) - 1)
         first = first + arrays%ground_length(k)
      end do
   end function parsed_grounds

   !> Set the views of the elevations and of the surface.
   subroutine set_ground(case, arrays, scene)
      type(case_t), intent(in) :: case
      type(scene_arrays_t), intent(in) :: arrays
      type(scene_t), intent(inout) :: scene

      associate (grid => arrays%grid, first => arrays%first, surface => scene%surface)
         scene%dem = terrain(grid%west, grid%north, grid%cell, arrays%z8, arrays%z4, [grid%nx, grid%ny], first)
         surface%method = case%method
         surface%size_to_radius = case%size_to_radius
         surface%sizes = arrays%sizes
         if (associated(arrays%zone1)) surface%zone1(first(1):, first(2):) => arrays%zone1
         if (associated(arrays%zone2)) surface%zone2(first(1):, first(2):) => arrays%zone2
         if (associated(arrays%values)) surface%values(first(1):, first(2):, 1:) => arrays%values
         if (allocated(arrays%material_ground)) surface%material_ground = arrays%material_ground
         if (associated(arrays%cell_ground)) surface%cell_ground(first(1):, first(2):) => arrays%cell_ground
      end associate
   end subroutine set_ground

   !> Set the sources in local coordinates, and the number of boulders of each.
   pure subroutine set_release(case, arrays, scene)
      type(case_t), intent(in) :: case
      type(scene_arrays_t), intent(in) :: arrays
      type(scene_t), intent(inout) :: scene

      associate (release => scene%release)
         release%x = arrays%source_x - scene%dem%x0
         release%y = arrays%source_y - scene%dem%y0
         release%boulders_per_source = case%boulders
         call set_numbers(case, arrays, release)
         if (allocated(arrays%source_feature)) release%feature = arrays%source_feature
         release%drop_height = case%drop_height
         release%velocity = case%velocity
      end associate
   end subroutine set_release

   !> Set the number of boulders per source: fixed, in proportion to area, or a fraction of the total.
   pure subroutine set_numbers(case, arrays, release)
      type(case_t), intent(in) :: case
      type(scene_arrays_t), intent(in) :: arrays
      type(release_t), intent(inout) :: release
      integer(i8) :: sources, k

      sources = size(release%x)
      if (case%boulders_total == 0) then
         if (case%by_area .and. allocated(arrays%area_ratio)) &
            release%last = last_boulders(arrays%area_ratio, case%boulders)
      else if (allocated(arrays%source_frequency)) then
         release%last = last_boulders_by_weight(arrays%source_frequency, case%boulders_total)
      else if (case%by_area .and. allocated(arrays%area_ratio)) then
         release%last = last_boulders_by_weight(arrays%area_ratio, case%boulders_total)
      else
         release%boulders_per_source = max(1_i8, case%boulders_total/max(1_i8, sources))
         if (release%boulders_per_source*sources /= case%boulders_total) &
            release%last = [(proportional_part(case%boulders_total, k, sources), k=1, sources)]
      end if
   end subroutine set_numbers

   !> Set the boulders and release conditions specified by the features of a layer.
   pure subroutine set_features(case, arrays, scene)
      type(case_t), intent(in) :: case
      type(scene_arrays_t), intent(in) :: arrays
      type(scene_t), intent(inout) :: scene
      real(wp), dimension(size(feature_fields)) :: usual, value
      integer :: k

      if (.not. allocated(arrays%feature_distribution)) return
      allocate (scene%features(size(arrays%feature_distribution)))
      associate (volumes => case%volumes)
         usual = [volumes%mean, volumes%std, volumes%min, volumes%max, volumes%density, case%drop_height, case%velocity]
      end associate
      do k = 1, size(scene%features)
         value = merge(usual, arrays%feature_value(:, k), ieee_is_nan(arrays%feature_value(:, k)))
         associate (feature => scene%features(k))
            feature%volumes = case%volumes
            if (arrays%feature_distribution(k) > 0) feature%volumes%kind = arrays%feature_distribution(k)
            feature%volumes%mean = value(1)
            feature%volumes%std = value(2)
            feature%volumes%min = value(3)
            feature%volumes%max = value(4)
            feature%volumes%density = value(5)
            feature%drop_height = value(6)
            feature%velocity = value(7:9)
         end associate
      end do
   end subroutine set_features

   !> Set the boulders specified by sources.
   pure subroutine set_boulders(case, arrays, scene)
      type(case_t), intent(in) :: case
      type(scene_arrays_t), intent(in) :: arrays
      type(scene_t), intent(inout) :: scene

      if (.not. case%by_source) return
      allocate (scene%of_source(size(arrays%source_x)))
      scene%of_source%volume = arrays%source_volume
      scene%of_source%inertia = arrays%source_inertia
      scene%of_source%density = case%volumes%density
      if (case%source_density) scene%of_source%density = arrays%source_density
   end subroutine set_boulders

   !> Set the block shapes, if boulders have several.
   pure subroutine set_shapes(case, arrays, scene)
      type(case_t), intent(in) :: case
      type(scene_arrays_t), intent(in) :: arrays
      type(scene_t), intent(inout) :: scene

      if (.not. (count(case%shape_share > 0) > 1 .or. allocated(arrays%source_shape) &
                 .or. allocated(case%volumes%list_shape))) return
      scene%shapes = shape_mix(case%shape_share)
      if (allocated(arrays%source_shape)) scene%shapes%of_source = arrays%source_shape
      if (allocated(arrays%shape_ground)) scene%shapes%ground = arrays%shape_ground
   end subroutine set_shapes

   !> Set the evaluation lines, and the barriers among them.
   pure subroutine set_lines(case, scene)
      type(case_t), intent(in) :: case
      type(scene_t), intent(inout) :: scene
      integer :: k

      if (size(case%lines) == 0) return
      allocate (scene%lines(size(case%lines)))
      do k = 1, size(case%lines)
         associate (x => case%lines(k)%x - scene%dem%x0, y => case%lines(k)%y - scene%dem%y0)
            if (case%lines(k)%object_width < 0) then
               scene%lines(k) = line(x, y)
            else
               scene%lines(k) = object_line(x, y, case%lines(k)%object_width, max_radius(scene))
            end if
         end associate
      end do
      if (size(scene%lines) >= worth_indexing) scene%line_index = line_index(scene%lines)
      if (all(case%lines%height <= 0)) return
      scene%barriers = pack([(barrier_t(k, case%lines(k)%height, case%lines(k)%capacity), k=1, size(case%lines))], &
                            case%lines%height > 0)
   end subroutine set_lines

   !> Refuse lines with some vertices near the terrain and others far away: a decimal comma, or a vertex in another CRS.
   !> Lines completely outside the terrain only cause a warning.
   pure subroutine check_lines(case, grid, error)
      type(case_t), intent(in) :: case
      type(grid_t), intent(in) :: grid
      type(error_t), allocatable, intent(out) :: error
      logical, allocatable :: is_far(:)
      character(len=:), allocatable :: group
      real(wp) :: half(2), far
      integer :: k

      half = 0.5_wp*grid%cell*[grid%nx, grid%ny]
      far = max(far_away, far_sizes*maxval(half))
      do k = 1, size(case%lines)
         associate (line => case%lines(k))
            is_far = max(abs(line%x - grid%west - half(1)), abs(line%y - grid%north + half(2))) > far
            if (all(is_far) .or. .not. any(is_far)) cycle
            group = "line"
            if (line%height > 0) group = "barrier"
            call fail(error, case%file//": &"//group//" name = '"//line%name//"': vertex " &
                      //integer_text(findloc(is_far, .true., dim=1))//" is more than " &
                      //integer_text(int(0.001_wp*far))// &
                      " km from the terrain: use decimal points, and coordinates in the CRS of the terrain")
            return
         end associate
      end do
   end subroutine check_lines

   pure subroutine set_forest(case, arrays, scene)
      type(case_t), intent(in) :: case
      type(scene_arrays_t), intent(in) :: arrays
      type(scene_t), intent(inout) :: scene

      if (.not. case%forest) return
      allocate (scene%forest)
      call build_forest(arrays%tree_x, arrays%tree_y, [scene%dem%x0, scene%dem%y0], arrays%tree_dbh, &
                        arrays%tree_factor, case%tree_model, scene%forest)
   end subroutine set_forest

   !> Check that features give volumes if the case does not, and that the parameters of each distribution are given.
   pure subroutine check_features(case, arrays, scene, error)
      type(case_t), intent(in) :: case
      type(scene_arrays_t), intent(in) :: arrays
      type(scene_t), intent(in) :: scene
      type(error_t), allocatable, intent(out) :: error
      logical :: complete
      integer :: k

      complete = .not. case%by_feature
      if (allocated(arrays%feature_distribution)) complete = complete .or. all(arrays%feature_distribution > 0)
      if (allocated(scene%features)) &
         complete = complete .and. all([(mean_volume(scene%features(k)%volumes) > 0, k=1, size(scene%features))])
      if (.not. complete) &
         call fail(error, case%file//": &boulder volume: some of its keys are missing: give them in &boulder or "// &
                   "as attributes of the source layer")
   end subroutine check_features

   !> Check the number of boulders: maps use 32-bit counts.
   pure subroutine check_number(case, scene, error)
      type(case_t), intent(in) :: case
      type(scene_t), intent(in) :: scene
      type(error_t), allocatable, intent(out) :: error
      integer(i8) :: sources

      sources = size(scene%release%x)
      if (sources == 0) return
      if (case%boulders_total > 0 .or. case%boulders <= huge(1_i4)/sources) then
         if (boulder_count(scene) <= huge(1_i4)) then
            if (allocated(case%breakage)) call check_fragments(case, scene, error)
            return
         end if
      end if
      call fail(error, case%file//": &case boulders = "//integer_text(case%boulders)//" from each of " &
                //integer_text(sources)//" sources: must be at most "//integer_text(huge(1_i4))// &
                " in total: use boulders_total")
   end subroutine check_number

   !> Check that 32-bit counts, as in maps, suffice for the fragments of all boulders.
   pure subroutine check_fragments(case, scene, error)
      type(case_t), intent(in) :: case
      type(scene_t), intent(in) :: scene
      type(error_t), allocatable, intent(out) :: error

      if (boulder_count(scene) <= huge(1_i4)/case%breakage%max_fragments) return
      call fail(error, case%file//": &breakage max_fragments = "//integer_text(case%breakage%max_fragments)//" "// &
                "for "//integer_text(boulder_count(scene))//" boulders: must be at most "// &
                integer_text(huge(1_i4))//" in total")
   end subroutine check_fragments

   !> Build the impact sets, and set the turning rule.
   subroutine set_impacts(case, arrays, scene, error)
      type(case_t), intent(in) :: case
      type(scene_arrays_t), intent(in) :: arrays
      type(scene_t), intent(inout) :: scene
      type(error_t), allocatable, intent(out) :: error
      type(ground_t) :: usual

      call read_stochastic(arrays%sets_text, arrays%sets_name, case%turning, arrays%draw, usual, error)
      if (allocated(error)) return
      scene%sets = usual%sets
      scene%turning = case%turning
      if (allocated(usual%lateral)) call move_alloc(usual%lateral, scene%lateral)
   end subroutine set_impacts

   !> Set the ground types, unless only the case's impact sets apply.
   subroutine set_grounds(case, arrays, scene, error)
      type(case_t), intent(in) :: case
      type(scene_arrays_t), intent(in) :: arrays
      type(scene_t), intent(inout) :: scene
      type(error_t), allocatable, intent(out) :: error
      type(ground_text_t), allocatable :: given(:)
      type(ground_t), allocatable :: grounds(:)
      integer :: k

      if (.not. allocated(arrays%ground_length)) return
      if (.not. tables_agree(arrays)) then
         call fail(error, case%file//": arrays table_... are inconsistent with each other or with ground_table")
         return
      end if
      given = parsed_grounds(arrays)
      allocate (grounds(size(given)))
      do k = 1, size(grounds)
         call set_ground_of(given(k), arrays%tables, case, scene, grounds(k), error)
         if (allocated(error)) return
      end do
      scene%ground_drawn = case%method == method_a .or. any(grounds%classical%roughness > 0) &
                           .or. (case%between_ratios .and. any([(is_stochastic(grounds(k)), k=1, size(grounds))]))
      scene%has_tables = any([(allocated(grounds(k)%table), k=1, size(grounds))])
      call move_alloc(grounds, scene%grounds)
   end subroutine set_grounds

   pure logical function tables_agree(arrays)
      type(scene_arrays_t), intent(in) :: arrays

      tables_agree = count_tables(arrays%tables) >= 0
      if (.not. (allocated(arrays%ground_table) .and. tables_agree)) return
      tables_agree = size(arrays%ground_table) == size(arrays%ground_length) &
                     .and. all(arrays%ground_table >= 0) &
                     .and. all(arrays%ground_table <= count_tables(arrays%tables))
   end function tables_agree

   subroutine set_ground_of(given, tables, case, scene, ground, error)
      type(ground_text_t), intent(in) :: given
      type(table_arrays_t), intent(in) :: tables
      type(case_t), intent(in) :: case
      type(scene_t), intent(in) :: scene
      type(ground_t), intent(out) :: ground
      type(error_t), allocatable, intent(out) :: error

      ground%name = given%name
      if (given%table > 0) then
         call table_ground(tables, given%table, given%text, given%file, ground, error)
      else if (given%text /= "") then
         call read_ground(given%text, given%file, case%turning, scene%table, ground, error)
      else
         ground%sets = scene%sets
         if (allocated(scene%lateral)) ground%lateral = scene%lateral
         ground%rest_slope = scene%rest_slope
      end if
      if (case%rest_angle >= 0) ground%rest_slope = scene%rest_slope
      if (.not. allocated(ground%table)) return
      if (case%strength_sigma >= 0) ground%table%ground%strength_sigma = case%strength_sigma
   end subroutine set_ground_of

   !> Maximum distance [cells] between a boulder's path and a cell for which maps show a hit.
   pure integer function object_reach(scene, case)
      type(scene_t), intent(in) :: scene
      type(case_t), intent(in) :: case

      object_reach = 0
      if (any(case%map .and. index(map_names, "hits") == 1)) &
         object_reach = ceiling((0.5_wp*scene%object_width + max_radius(scene))*scene%dem%per_cell)
   end function object_reach
end module rockfall_scene
