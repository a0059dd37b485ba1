! SPDX-License-Identifier: BSD-3-Clause
!> Case file: reads the values of its keys (rockfall_case_keys) and checks the rules between keys, group by group. Keys
!> that only Python uses are checked here against their table alone; case/rules.py has the rules between them.
module rockfall_case
   use rockfall_kinds, only: wp, i8
   use rockfall_error, only: error_t, fail, gather
   use rockfall_text, only: integer_text, real_text, first_repeated
   use rockfall_namelist, only: namelist_t, group_t
   use rockfall_values, only: has_key, value_count, text_of, get_text, get_integer, get_real, get_logical, refuse, &
                              refuse_list, has_comma, key_location
   use rockfall_case_keys, only: read_keys, map_names, n_maps, text_length, max_name
   use rockfall_case_effects, only: check_effects
   use rockfall_boulder, only: volume_distribution_t, fixed_volume, uniform_volume, distributions
   use rockfall_block_shape, only: block_shapes, shape_of_axes
   use rockfall_surface, only: method_a, method_b
   use rockfall_direction, only: past_aspect, to_aspect, by_lab
   use rockfall_forest, only: tree_model_t
   use rockfall_breakage, only: breakage_t
   use rockfall_math, only: degree
   use rockfall_barrier, only: ead_energy, log_capacity
   implicit none
   private
   public :: case_t, case_line_t, read_case, case_of_keys, given_shapes, turning_rule, radius_of_reading, keeps_all
   public :: line_groups, barrier_strengths

   integer(i8), parameter :: keeps_all = huge(1_i8)
   !> Maximum volume_std/volume_mean of a normal distribution: truncation at zero then multiplies the mean by 4.4.
   integer, parameter :: max_spread = 5
   real(wp), parameter :: share_rounding = 0.002_wp  !! maximum rounding error of a sum of fractions with three decimals

   character(len=*), parameter :: line_groups(*) = [character(len=7) :: "line", "barrier"]  !! in the order of results
   !> Each barrier has exactly one of these attributes.
   character(len=*), parameter :: barrier_strengths(*) = [character(len=8) :: "capacity", "class", "diameter"]

   !> Evaluation line, or barrier.
   type :: case_line_t
      character(len=:), allocatable :: name
      real(wp), allocatable :: x(:), y(:)  !! map coordinates [m]
      real(wp) :: object_width = -1.0_wp   !! width of an object [m]; negative for a line
      real(wp) :: height = 0.0_wp          !! height of a barrier [m]; 0: evaluation line
      real(wp) :: capacity = 0.0_wp        !! capacity of a barrier [J]
   end type case_line_t

   !> Case as read; file names as written, "" if absent.
   type :: case_t
      character(len=:), allocatable :: file, title, dem, zones, table, zone_field, mean_radius, rg(:), sets, &
                                       cells, polygons, ground, ground_map, ground_table
      integer(i8) :: seed = 1
      integer(i8) :: boulders = 0, boulders_total = 0  !! boulders per source, or in total; 0 if the other is given
      integer :: threads = 0

      integer, allocatable :: default_zone
      real(wp), allocatable :: uniform_sizes(:)  !! R_m, or Rg70, Rg20, Rg10 [m]
      integer :: method = method_b
      real(wp) :: size_to_radius = 0.5_wp
      real(wp) :: stop_speed = 0.5_wp, rest_angle = -1.0_wp
      real(wp) :: gravity = 9.81_wp, drop_height = 0.0_wp, velocity(3) = 0.0_wp
      integer :: impact_limit = 100000
      integer :: turning = past_aspect           !! turning rule, as in turning_t
      logical :: by_table = .false.         !! rebounds follow impact tables by default
      logical :: between_ratios = .false.
      type(volume_distribution_t) :: volumes
      real(wp) :: shape_share(size(block_shapes)) = 0.0_wp  !! fraction of each block shape; all 0: by boulder [-]
      real(wp) :: radius_sigma = 0.0_wp          !! standard deviation of ln R_m between boulders [-]
      real(wp) :: strength_sigma = -1.0_wp       !! std of ln(strength) on all tables; < 0: as each ground gives [-]
      logical :: by_source = .false.             !! sources specify their boulders; volumes in the case are factors
      logical :: by_feature = .false.            !! the layer of the sources gives all volumes
      logical :: source_density = .false.        !! sources also give their density
      logical :: at_points = .false.             !! sources are points, not cells
      logical :: forest = .false.                !! the scene has trees
      type(tree_model_t) :: tree_model
      type(breakage_t), allocatable :: breakage  !! allocated if boulders may break
      logical :: steep_cells = .false., by_area = .false., sampled = .false.  !! sampled: sources are a sample
      real(wp), allocatable :: slope_threshold   !! [degree]
      type(case_line_t), allocatable :: lines(:)  !! lines given in the case: evaluation lines, then barriers
      character(len=:), allocatable :: unread    !! layer with further lines, barriers or dams, for messages; "": none
      logical :: map(n_maps) = .false.           !! maps requested, in the order of map_names
      logical :: full_maps = .false.             !! maps also cover cells that no boulder can reach
      integer :: min_passages = 1              !! minimum number of passages for a mean or a quantile in a cell
      logical :: rebounds = .false.
      logical :: shadow_angle = .false.        !! angle requested for each boulder, because one was observed
      logical :: energy_balance = .false.
      integer :: trajectories = 0
      integer(i8) :: kept = keeps_all            !! number of boulders for which rows are kept
      real(wp), allocatable :: thresholds(:)     !! energy thresholds of energy_exceeded and hits_energy_exceeded [J]
      real(wp) :: object_width = 0.0_wp          !! width of objects for the maps of hits [m]
      character(len=:), allocatable :: variants  !! names of the case's variants (a run needs one); "": none
   end type case_t

contains

   !> Read a case from text; errors as in `read_keys` and `case_of_keys`.
   pure subroutine read_case(text, file, this, error)
      character(len=*), intent(in) :: text
      character(len=*), intent(in) :: file  !! file name, for messages
      type(case_t), intent(out) :: this
      type(error_t), allocatable, intent(out) :: error
      type(namelist_t) :: list

      call read_keys(text, file, list, error)
      if (.not. allocated(error)) call case_of_keys(list, file, this, error)
   end subroutine read_case

   !> Build a case from its checked keys; the error lists the first fault of each group.
   pure subroutine case_of_keys(list, file, this, error)
      type(namelist_t), intent(in) :: list
      character(len=*), intent(in) :: file
      type(case_t), intent(out) :: this
      type(error_t), allocatable, intent(out) :: error

      type(error_t), allocatable :: fault

      this%file = file
      call read_run(list, this, error)
      call read_surface(group_of(list, "surface"), this, fault)
      call gather(fault, error)
      call read_boulder(group_of(list, "boulder"), group_of(list, "release"), this, fault)
      if (.not. allocated(fault)) &
         call read_shapes(group_of(list, "boulder"), group_of(list, "release"), this, fault)
      call gather(fault, error)
      call read_release(group_of(list, "release"), this, fault)
      call gather(fault, error)
      call read_forest(group_of(list, "forest"), this, fault)
      call gather(fault, error)
      call read_lines(list, this, fault)
      call gather(fault, error)
      call read_output(group_of(list, "output"), group_of(list, "release"), this, fault)
      call gather(fault, error)
      call read_breakage(group_of(list, "breakage"), group_of(list, "output"), this, fault)
      call gather(fault, error)
      call read_hazard(group_of(list, "hazard"), this, fault)
      call gather(fault, error)
      this%shadow_angle = has_key(group_of(list, "observed"), "shadow_angle")
      if (.not. allocated(error)) call check_effects(list, error)
      this%variants = variant_names(list)
   end subroutine case_of_keys

   !> Find a group by name, which exists because `complete` has added absent groups.
   pure type(group_t) function group_of(list, name)
      type(namelist_t), intent(in) :: list
      character(len=*), intent(in) :: name
      integer :: g

      do g = 1, size(list%group)
         if (list%group(g)%name == name) group_of = list%group(g)
      end do
   end function group_of

   ! From here on, the kind and range of each value have been checked. What follows are rules between keys.

   pure integer(i8) function integer_of(group, key) result(value)
      type(group_t), intent(in) :: group
      character(len=*), intent(in) :: key
      type(error_t), allocatable :: error

      value = 0
      call get_integer(group, key, value, error)
   end function integer_of

   pure real(wp) function real_of(group, key) result(value)
      type(group_t), intent(in) :: group
      character(len=*), intent(in) :: key
      type(error_t), allocatable :: error

      value = 0
      call get_real(group, key, value, error)
   end function real_of

   pure function reals_of(group, key) result(values)
      type(group_t), intent(in) :: group
      character(len=*), intent(in) :: key
      real(wp), allocatable :: values(:)
      type(error_t), allocatable :: error

      allocate (values(0))
      call get_real(group, key, values, error)
   end function reals_of

   pure subroutine read_run(list, this, error)
      type(namelist_t), intent(in) :: list
      type(case_t), intent(inout) :: this
      type(error_t), allocatable, intent(out) :: error
      type(group_t) :: group

      group = group_of(list, "case")
      this%title = text_of(group, "title")
      this%seed = integer_of(group, "seed")
      this%boulders = integer_of(group, "boulders")
      this%boulders_total = integer_of(group, "boulders_total")
      if (has_key(group, "boulders") .eqv. has_key(group, "boulders_total")) &
         call fail(error, key_location(group, "boulders, boulders_total")// &
                   ": give one of the two: boulders from each source, or from all together")
      this%threads = int(integer_of(group, "threads"))
      group = group_of(list, "terrain")
      this%dem = text_of(group, "dem")
      group = group_of(list, "flight")
      this%gravity = real_of(group, "gravity")
      group = group_of(list, "impact")
      this%sets = text_of(group, "sets")
      this%by_table = text_of(group, "form") == "table"
      this%between_ratios = text_of(group, "ratio") == "between"
      this%turning = turning_rule(text_of(group, "turning"))
      this%stop_speed = real_of(group, "stop_speed")
      if (has_key(group, "rest_angle")) this%rest_angle = real_of(group, "rest_angle")
      this%impact_limit = int(integer_of(group, "impact_limit"))
      group = group_of(list, "boulder")
      this%radius_sigma = real_of(group, "mean_radius_sigma")
      if (has_key(group, "ground_strength_sigma")) this%strength_sigma = real_of(group, "ground_strength_sigma")
   end subroutine read_run

   !> Turning rule, as in turning_t, from `&impact turning`.
   pure integer function turning_rule(word)
      character(len=*), intent(in) :: word

      select case (word)
      case ("to_aspect"); turning_rule = to_aspect
      case ("lab"); turning_rule = by_lab
      case default; turning_rule = past_aspect
      end select
   end function turning_rule

   !> Ratio of radius to Rg from `&surface rg_reading`.
   pure real(wp) function radius_of_reading(word)
      character(len=*), intent(in) :: word

      radius_of_reading = merge(0.5_wp, 1.0_wp, word == "diameter")
   end function radius_of_reading

   !> Read the surface, given by zones with a table or attributes, by rasters of values, or by one value; skipped if
   !> the default ground needs no rock sizes.
   pure subroutine read_surface(group, this, error)
      type(group_t), intent(in) :: group
      type(case_t), intent(inout) :: this
      type(error_t), allocatable, intent(out) :: error
      character(len=*), parameter :: rasters(4) = [character(len=11) :: "mean_radius", "rg70", "rg20", "rg10"]
      logical :: zones, by_raster, uniform
      integer :: k

      this%method = merge(method_a, method_b, text_of(group, "method") == "A")
      this%size_to_radius = radius_of_reading(text_of(group, "rg_reading"))
      this%zones = text_of(group, "zones")
      this%table = text_of(group, "table")
      this%zone_field = text_of(group, "zone_field")
      this%mean_radius = text_of(group, "mean_radius")
      this%ground = text_of(group, "ground")
      this%ground_map = text_of(group, "ground_map")
      this%ground_table = text_of(group, "ground_table")
      allocate (character(len=text_length) :: this%rg(3))
      do k = 1, 3
         this%rg(k) = text_of(group, trim(rasters(k + 1)))
      end do
      call check_use(group, "zones_layer", has_key(group, "zones"), "zones", error)
      if (allocated(error)) return
      if (has_key(group, "default_zone")) this%default_zone = int(integer_of(group, "default_zone"))
      zones = has_key(group, "zones") .or. has_key(group, "table") .or. has_key(group, "default_zone")
      by_raster = any([(has_key(group, trim(rasters(k))), k=1, 4)])
      uniform = has_key(group, "uniform_mean_radius") .or. has_key(group, "uniform_rg")
      if (.not. any([zones, by_raster, uniform]) &
          .and. (this%ground /= "" .or. this%ground_map /= "" .or. this%by_table)) then
         return
      else if (count([zones, by_raster, uniform]) /= 1) then
         call fail(error, group%file//": &surface: give a ground, or one of: zones with table; mean_radius " &
                   //"(method B) or rg70, rg20, rg10 (method A) rasters; uniform_mean_radius (B) or uniform_rg (A)")
      else if (zones) then
         call require_key(group, "zones", "to locate the zones", error)
      else if (by_raster .and. this%method == method_b) then
         call require_key(group, "mean_radius", "for method B", error)
      else if (by_raster) then
         do k = 2, 4
            if (.not. allocated(error)) call require_key(group, trim(rasters(k)), "for method A", error)
         end do
      else if (this%method == method_b) then
         call require_key(group, "uniform_mean_radius", "for method B", error)
         this%uniform_sizes = reals_of(group, "uniform_mean_radius")
      else
         call require_key(group, "uniform_rg", "for method A", error)
         this%uniform_sizes = reals_of(group, "uniform_rg")
      end if
   end subroutine read_surface

   pure subroutine require_key(group, key, why, error)
      type(group_t), intent(in) :: group
      character(len=*), intent(in) :: key, why
      type(error_t), allocatable, intent(inout) :: error

      if (has_key(group, key)) return
      call fail(error, key_location(group, key)//" is missing: needed "//why)
   end subroutine require_key

   !> Refuse a key that is only valid with a feature that the case lacks.
   pure subroutine check_use(group, key, valid, with, error)
      type(group_t), intent(in) :: group
      character(len=*), intent(in) :: key, with
      logical, intent(in) :: valid
      type(error_t), allocatable, intent(inout) :: error

      if (.not. (allocated(error) .or. valid) .and. has_key(group, key)) &
         call refuse(group, key, "is only valid with "//with, error)
   end subroutine check_use

   !> Read the volume distribution, which requires exactly the keys of its type.
   pure subroutine read_boulder(group, release, this, error)
      type(group_t), intent(in) :: group, release
      type(case_t), intent(inout) :: this
      type(error_t), allocatable, intent(out) :: error
      character(len=*), parameter :: keys(13) = [character(len=15) :: "volume_mean", "volume_std", "volume_min", &
                                                 "volume_max", "volumes", "volume_exponent", "d1", "d2", "d3", &
                                                 "shape", "rock_density", "volume_spread", "block_axes"]
      logical :: needs(size(keys)), takes(size(keys))
      character(len=:), allocatable :: distribution
      integer :: k

      distribution = text_of(group, "volume")
      needs = .false.
      select case (distribution)
      case ("normal", "lognormal"); needs(1:2) = .true.
      case ("uniform"); needs(3:4) = .true.
      case ("list"); needs(5) = .true.
      case ("pareto"); needs([3, 4, 6]) = .true.
      case ("source")
         this%by_feature = (has_key(release, "points") .or. has_key(release, "polygons")) &
                           .and. .not. any([(has_key(group, trim(keys(k))), k=7, 12)])
         this%by_source = .not. this%by_feature
         needs(7:9) = this%by_source
      case default; needs(1) = .true.
      end select
      ! not findloc(distributions, distribution): gfortran 12 mishandles different text lengths
      this%volumes%kind = max(fixed_volume, findloc(distributions == distribution, .true., dim=1))
      takes = needs
      takes(10:12) = this%by_source
      takes(13) = distribution == "list"
      do k = 1, size(keys)
         if (needs(k)) call require_key(group, trim(keys(k)), "for volume = '"//distribution//"'", error)
         if (.not. takes(k) .and. has_key(group, trim(keys(k)))) then
            call refuse(group, trim(keys(k)), "is not valid for volume = '"//distribution//"'", error)
         end if
         if (allocated(error)) return
      end do
      this%volumes%mean = real_of(group, "volume_mean")
      this%volumes%std = real_of(group, "volume_std")
      this%volumes%min = real_of(group, "volume_min")
      this%volumes%max = real_of(group, "volume_max")
      this%volumes%list = reals_of(group, "volumes")
      if (distribution == "pareto") this%volumes%exponent = real_of(group, "volume_exponent")
      this%volumes%density = real_of(group, "density")
      if (this%volumes%max < this%volumes%min) then
         call refuse(group, "volume_max", "must not be below volume_min", error)
      else if (distribution == "normal" .and. this%volumes%std > max_spread*this%volumes%mean) then
         call refuse(group, "volume_std", "must be at most "//integer_text(max_spread)// &
                     " times volume_mean: give it in m3, not in percent", error)
      end if
      if (this%by_source) call set_factors(group, this)
   end subroutine read_boulder

   !> Read the fractions of the block shapes, or the axes of the blocks in a volume list.
   pure subroutine read_shapes(group, release, this, error)
      type(group_t), intent(in) :: group, release
      type(case_t), intent(inout) :: this
      type(error_t), allocatable, intent(out) :: error
      character(len=len(block_shapes)), allocatable :: names(:)
      real(wp), allocatable :: shares(:)
      integer :: k, n

      allocate (names(0))
      call get_text(group, "block_shape", names, error)
      if (allocated(error)) return
      n = size(names)
      if (has_key(group, "block_axes")) call read_axes(group, names, this, error)
      if (any(names == "source") .and. .not. allocated(error)) then
         if (n > 1) call refuse(group, "block_shape", "'source' cannot be combined with other shapes", error)
         if (.not. allocated(error)) call check_use(group, "block_shape_share", .false., &
                                                    "several shapes in block_shape", error)
         if (.not. (allocated(error) .or. this%by_source .or. has_key(release, "points") &
                    .or. has_key(release, "polygons"))) &
            call refuse(group, "block_shape", &
                        "'source' requires a layer or table of sources, or the rasters d1, d2, d3", error)
         return
      end if
      if (allocated(error)) return
      shares = reals_of(group, "block_shape_share")
      if (size(shares) == 0) shares = [(1.0_wp/n, k=1, n)]
      if (first_repeated(names) > 0) then
         call refuse(group, "block_shape", "must list each shape once", error)
      else if (size(shares) /= n) then
         call refuse_list(group, "block_shape_share", "must have "//integer_text(n)// &
                          " values, one for each block_shape", error)
      else if (abs(sum(shares) - 1) > share_rounding) then
         call refuse_list(group, "block_shape_share", "must sum to 1, but sums to "//real_text(sum(shares), 4), error)
      else
         this%shape_share = [(sum(shares, mask=names == block_shapes(k)), k=1, size(block_shapes))]
      end if
   end subroutine read_shapes

   !> Read the axes of each volume in a list.
   pure subroutine read_axes(group, names, this, error)
      type(group_t), intent(in) :: group
      character(len=*), intent(in) :: names(:)  !! names of block shapes
      type(case_t), intent(inout) :: this
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: axes(:, :)
      integer :: k

      axes = reshape(reals_of(group, "block_axes"), [3, value_count(group, "block_axes")/3])
      if (size(names) > 1 .or. names(1) /= block_shapes(1)) then
         call refuse(group, "block_shape", "is not valid together with block_axes", error)
      else if (value_count(group, "block_axes") /= 3*size(this%volumes%list)) then
         call refuse_list(group, "block_axes", "must have three values for each value of volumes", error)
      else
         do k = 1, size(axes, 2)
            if (axes(1, k) >= axes(2, k) .and. axes(2, k) >= axes(3, k)) cycle
            call refuse(group, "block_axes", "must be a, b, c of each block, with a >= b >= c", error, 3*k - 2)
            return
         end do
         this%volumes%list_shape = [(shape_of_axes(axes(1, k), axes(2, k), axes(3, k)), k=1, size(axes, 2))]
      end if
   end subroutine read_axes

   !> Mask of the block shapes of boulders whose volumes the case gives: those in the list, or with a fraction.
   pure function given_shapes(case) result(given)
      type(case_t), intent(in) :: case
      logical :: given(size(block_shapes))
      integer :: k

      given = case%shape_share > 0
      if (allocated(case%volumes%list_shape)) &
         given = [(any(case%volumes%list_shape == k), k=1, size(block_shapes))]
   end function given_shapes

   !> Read the keys of boulders specified by sources: the volume distribution is then a distribution of factors.
   pure subroutine set_factors(group, this)
      type(group_t), intent(in) :: group
      type(case_t), intent(inout) :: this
      real(wp) :: spread

      spread = real_of(group, "volume_spread")
      this%source_density = has_key(group, "rock_density")
      this%volumes%kind = fixed_volume
      this%volumes%mean = 1
      if (spread <= 0) return
      this%volumes%kind = uniform_volume
      this%volumes%min = 1 - spread
      this%volumes%max = 1 + spread
   end subroutine set_factors

   pure subroutine read_release(group, this, error)
      type(group_t), intent(in) :: group
      type(case_t), intent(inout) :: this
      type(error_t), allocatable, intent(out) :: error
      logical :: points
      integer :: n_given

      call get_logical(group, "steep_cells", this%steep_cells, error)
      call get_logical(group, "by_area", this%by_area, error)
      points = has_key(group, "x") .or. has_key(group, "y")
      n_given = count([points, has_key(group, "points"), has_key(group, "cells"), has_key(group, "polygons")])
      points = points .or. has_key(group, "points")
      if (n_given > 1 .or. (n_given == 0 .and. .not. this%steep_cells)) then
         call fail(error, group%file//": &release: give one of: points (x, y, or a layer); cells; polygons; "// &
                   "or steep_cells, alone or with cells or polygons")
      else if (points .and. this%steep_cells) then
         call refuse(group, "steep_cells", "is not valid for points", error)
      else if (points .and. this%by_area) then
         call refuse(group, "by_area", "is not valid for points", error)
      end if
      associate (in_layer => has_key(group, "points"), in_polygons => has_key(group, "polygons"))
         call check_use(group, "slope_threshold", this%steep_cells, "steep_cells = .true.", error)
         call check_use(group, "polygons_layer", in_polygons, "polygons", error)
         call check_use(group, "points_layer", in_layer, "points", error)
         call check_use(group, "name_field", in_layer .or. in_polygons, "points or polygons", error)
      end associate
      if (.not. allocated(error) .and. (has_key(group, "x") .or. has_key(group, "y"))) &
         call check_points(group, 1, error)
      if (has_key(group, "slope_threshold")) this%slope_threshold = real_of(group, "slope_threshold")
      this%at_points = points
      this%cells = text_of(group, "cells")
      this%polygons = text_of(group, "polygons")
      this%drop_height = real_of(group, "drop_height")
      this%velocity = reals_of(group, "velocity")
   end subroutine read_release

   !> Read the conditions of breakage and the parameters of fragments.
   pure subroutine read_breakage(group, output, this, error)
      type(group_t), intent(in) :: group, output
      type(case_t), intent(inout) :: this
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: at
      type(breakage_t) :: breakage

      at = text_of(group, "at")
      breakage%at_release = at == "release" .or. at == "both"
      breakage%at_impact = at == "impact" .or. at == "both"
      if (breakage%at_release) call require_key(group, "release_fall", "for at = '"//at//"'", error)
      call check_use(group, "release_fall", breakage%at_release, "at = 'release' or 'both'", error)
      if (allocated(error) .or. at == "none") return
      if (this%kept /= keeps_all) then
         call refuse(output, "kept", "must be 'all' if boulders break (&breakage at): fragments are counted " &
                     //"for each boulder", error)
         return
      end if
      breakage%min_ratio = real_of(group, "min_area_ratio")
      breakage%release_fall = real_of(group, "release_fall")
      breakage%min_volume = real_of(group, "min_volume")
      breakage%max_fragments = int(integer_of(group, "max_fragments"))
      breakage%half_angle = 0.5_wp*degree*real_of(group, "cone")
      this%breakage = breakage
   end subroutine read_breakage

   !> Read the forest: trees are listed, or generated from stands in polygons or rasters. The other keys concern
   !> hits.
   pure subroutine read_forest(group, this, error)
      type(group_t), intent(in) :: group
      type(case_t), intent(inout) :: this
      type(error_t), allocatable, intent(out) :: error
      character(len=*), parameter :: turn_keys(3) = [character(len=12) :: "turn_frontal", "turn_lateral", &
                                                     "turn_scratch"]
      logical :: listed, mapped, made
      integer :: k

      listed = has_key(group, "trees")
      mapped = has_key(group, "polygons")
      made = has_key(group, "stems") .or. has_key(group, "uniform_stems")
      this%forest = listed .or. mapped .or. made
      if (count([listed, mapped, made]) > 1) then
         if (.not. mapped) call fail(error, group%file//": &forest: give either trees or stems")
         if (mapped) call fail(error, group%file//": &forest: give only one of polygons, trees and stems")
         return
      end if
      call check_either(group, "stems", made, made, error)
      call check_either(group, "dbh_mean", made, made .or. mapped, error)
      call check_either(group, "dbh_std", made, made .or. mapped, error)
      call check_either(group, "conifers", made, this%forest, error)
      if (allocated(error)) return
      call check_use(group, "trees_layer", listed, "trees", error)
      call check_use(group, "polygons_layer", mapped, "polygons", error)
      call check_use(group, "clearings", this%forest, "trees, polygons or stems", error)
      call check_use(group, "clearings_layer", has_key(group, "clearings"), "clearings", error)
      call check_use(group, "species_table", this%forest, "trees or stems", error)
      call check_use(group, "stem_height", this%forest, "trees or stems", error)
      associate (model => this%tree_model)
         if (has_key(group, "stem_height")) model%stem_height = real_of(group, "stem_height")
         model%limit = [real_of(group, "lateral_from"), real_of(group, "scratch_from")]
         if (model%limit(2) < model%limit(1)) &
            call refuse(group, "scratch_from", "must not be below lateral_from", error)
         do k = 1, 3
            model%weight(:, k) = reals_of(group, trim(turn_keys(k)))
            if (.not. sum(model%weight(:, k)) > 0) &
               call refuse(group, trim(turn_keys(k)), "at least one weight must be > 0", error)
         end do
      end associate
   end subroutine read_forest

   !> Check a value given as a raster or a constant: exactly one of them if it is needed, neither if it is not valid.
   pure subroutine check_either(group, key, needed, allowed, error)
      type(group_t), intent(in) :: group
      character(len=*), intent(in) :: key
      logical, intent(in) :: needed, allowed
      type(error_t), allocatable, intent(inout) :: error
      character(len=:), allocatable :: uniform

      if (allocated(error)) return
      uniform = "uniform_"//key
      call check_use(group, key, allowed, "stems", error)
      call check_use(group, uniform, allowed, "stems", error)
      if (allocated(error)) return
      if (has_key(group, key) .and. has_key(group, uniform)) then
         call refuse(group, uniform, "cannot be combined with "//key, error)
      else if (needed .and. .not. (has_key(group, key) .or. has_key(group, uniform))) then
         call fail(error, key_location(group, key)//" is missing: random trees require this raster, or "//uniform)
      end if
   end subroutine check_either

   !> Check that x and y have equal length and at least the minimum number of points.
   pure subroutine check_points(group, min_points, error)
      type(group_t), intent(in) :: group
      integer, intent(in) :: min_points
      type(error_t), allocatable, intent(out) :: error
      logical :: equal, single  ! x and y have equal length; there would be a single point if commas were decimal

      equal = value_count(group, "x") == value_count(group, "y")
      single = min_points == 1 .and. value_count(group, "x") == 2 .and. has_comma(group, "y")
      if (has_comma(group, "x") .and. (single .or. .not. equal)) then
         call refuse_list(group, "x", "", error)
      else if (has_comma(group, "y") .and. .not. equal) then
         call refuse_list(group, "y", "", error)
      else if (.not. equal) then
         call fail(error, key_location(group, "x, y")//": x has "//integer_text(value_count(group, "x"))// &
                   " values, y has "//integer_text(value_count(group, "y"))//": the numbers must be equal")
      else if (value_count(group, "x") < min_points) then
         call refuse(group, "x", "must have at least "//integer_text(min_points)//" values", error)
      end if
   end subroutine check_points

   !> Read evaluation lines, then barriers; check that dams have only valid keys.
   pure subroutine read_lines(list, this, error)
      type(namelist_t), intent(in) :: list
      type(case_t), intent(inout) :: this
      type(error_t), allocatable, intent(out) :: error
      type(group_t), allocatable :: groups(:)
      character(len=max_name), allocatable :: names(:)
      integer :: n

      call check_layers(list, this, error)
      if (allocated(error)) return
      groups = [inline_groups(list, line_groups(1)), inline_groups(list, line_groups(2))]
      allocate (this%lines(size(groups)))
      do n = 1, size(groups)
         call read_line(groups(n), this%lines(n), error)
         if (allocated(error)) return
         if (groups(n)%name == "barrier") call read_barrier(groups(n), this%lines(n), error)
         if (allocated(error)) return
      end do
      allocate (names(size(groups)))
      do n = 1, size(groups)
         names(n) = this%lines(n)%name
      end do
      n = first_repeated(names)
      if (n > 0) then
         call refuse(groups(n), "name", "must be unique among lines and barriers", error)
         return
      end if
      groups = inline_groups(list, "dam")
      do n = 1, size(groups)
         call check_polyline(groups(n), error)
         if (.not. allocated(error)) call require_key(groups(n), "height", "here or as an attribute of a layer", error)
         if (allocated(error)) return
      end do
   end subroutine read_lines

   !> Groups with a given name whose coordinates are inline.
   pure function inline_groups(list, name) result(groups)
      type(namelist_t), intent(in) :: list
      character(len=*), intent(in) :: name
      type(group_t), allocatable :: groups(:)
      integer :: g

      groups = pack(list%group, [(list%group(g)%name == name .and. .not. has_key(list%group(g), "file"), &
                                  g=1, size(list%group))])
   end function inline_groups

   !> Check lines, barriers and dams from layers. Python reads and checks their coordinates.
   pure subroutine check_layers(list, this, error)
      type(namelist_t), intent(in) :: list
      type(case_t), intent(inout) :: this
      type(error_t), allocatable, intent(out) :: error
      integer :: g

      this%unread = ""
      do g = 1, size(list%group)
         associate (group => list%group(g))
            if (all(group%name /= [character(len=7) :: "line", "barrier", "dam"])) cycle
            call check_layer(group, error)
            if (allocated(error)) return
            if (has_key(group, "file")) this%unread = key_location(group, "file")//" = '"//text_of(group, "file")//"'"
         end associate
      end do
   end subroutine check_layers

   pure subroutine check_layer(group, error)
      type(group_t), intent(in) :: group
      type(error_t), allocatable, intent(inout) :: error
      logical :: points
      integer :: k

      points = has_key(group, "x") .or. has_key(group, "y")
      if (has_key(group, "file") .eqv. points) then
         call fail(error, key_location(group, "x, y")//": give both, or a layer of lines as file")
      end if
      call check_use(group, "layer", .not. points, "file", error)
      call check_use(group, "field", .not. points, "file", error)
      if (allocated(error)) return
      if (has_key(group, "name") .and. has_key(group, "field")) then
         call refuse(group, "field", "is not valid together with name", error)
      else if (has_key(group, "capacity") .and. has_key(group, "class")) then
         call fail(error, key_location(group, "capacity, class")//": give one of the two")
      else if (count([(has_key(group, trim(barrier_strengths(k))), k=1, size(barrier_strengths))]) > 1) then
         call refuse(group, "diameter", "determines the capacity of a log: omit capacity and class", error)
      end if
   end subroutine check_layer

   pure subroutine read_line(group, line, error)
      type(group_t), intent(in) :: group
      type(case_line_t), intent(inout) :: line
      type(error_t), allocatable, intent(out) :: error

      call check_polyline(group, error)
      if (.not. allocated(error)) call require_key(group, "name", "to distinguish it from others", error)
      if (allocated(error)) return
      line%name = text_of(group, "name")
      if (has_key(group, "object_width")) line%object_width = real_of(group, "object_width")
      line%x = reals_of(group, "x")
      line%y = reals_of(group, "y")
      if (len(line%name) > max_name) &
         call refuse(group, "name", "must be at most "//integer_text(max_name)//" characters", error)
   end subroutine read_line

   !> Check that x and y have equal length and at least two points; points differ, except for objects.
   pure subroutine check_polyline(group, error)
      type(group_t), intent(in) :: group
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: x(:), y(:)

      call check_points(group, 2, error)
      if (allocated(error) .or. has_key(group, "object_width")) return
      x = reals_of(group, "x")
      y = reals_of(group, "y")
      if (all(x >= x(1)) .and. all(x <= x(1)) .and. all(y >= y(1)) .and. all(y <= y(1))) &
         call refuse(group, "x", "the vertices must not all coincide", error)
   end subroutine check_polyline

   !> Read the height and the capacity of a barrier.
   pure subroutine read_barrier(group, barrier, error)
      type(group_t), intent(in) :: group
      type(case_line_t), intent(inout) :: barrier
      type(error_t), allocatable, intent(out) :: error

      if (has_key(group, "diameter")) then
         call read_log(group, barrier)
         return
      end if
      call check_use(group, "decay_class", .false., "diameter", error)
      if (.not. allocated(error)) call require_key(group, "height", "here or as an attribute of a layer", error)
      if (allocated(error)) return
      barrier%height = real_of(group, "height")
      if (has_key(group, "class")) then
         barrier%capacity = ead_energy(int(integer_of(group, "class")))
      else if (has_key(group, "capacity")) then
         barrier%capacity = 1000*real_of(group, "capacity")
      else
         call fail(error, key_location(group, "capacity, class")//": give one of the two")
      end if
   end subroutine read_barrier

   !> Read a lying log, whose capacity follows from its diameter. Without a height, it lies on the ground.
   pure subroutine read_log(group, barrier)
      type(group_t), intent(in) :: group
      type(case_line_t), intent(inout) :: barrier
      integer :: decay_class

      decay_class = 1
      if (has_key(group, "decay_class")) decay_class = int(integer_of(group, "decay_class"))
      barrier%capacity = log_capacity(real_of(group, "diameter"), decay_class)
      barrier%height = 0.01_wp*real_of(group, "diameter")
      if (has_key(group, "height")) barrier%height = real_of(group, "height")
   end subroutine read_log

   pure subroutine read_output(group, release, this, error)
      type(group_t), intent(in) :: group, release
      type(case_t), intent(inout) :: this
      type(error_t), allocatable, intent(out) :: error
      character(len=len(map_names)), allocatable :: maps(:)
      integer :: k

      allocate (maps(0))
      call get_text(group, "maps", maps, error)
      if (.not. allocated(error)) call get_logical(group, "rebounds", this%rebounds, error)
      if (.not. allocated(error)) call get_logical(group, "energy_balance", this%energy_balance, error)
      this%full_maps = text_of(group, "map_extent") == "terrain"
      this%min_passages = int(integer_of(group, "min_passages"))
      this%trajectories = int(integer_of(group, "trajectories"))
      if (text_of(group, "kept") /= "all") this%kept = integer_of(group, "kept")  ! 'none' gives 0
      this%map = [(any(maps == map_names(k)), k=1, n_maps)]
      this%sampled = text_of(release, "sources") == "sample"
      if (allocated(error) .or. this%kept == keeps_all .or. .not. any(this%map)) return
      if (this%sampled) &
         call refuse(group, "kept", "must be 'all' for maps with &release sources = 'sample': map intervals "// &
                     "require all boulders", error)
   end subroutine read_output

   !> Read the energy thresholds of maps, and the width of their objects.
   pure subroutine read_hazard(group, this, error)
      type(group_t), intent(in) :: group
      type(case_t), intent(inout) :: this
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: kilojoules(:)

      kilojoules = reals_of(group, "thresholds")
      this%thresholds = 1000*kilojoules
      this%object_width = real_of(group, "object_width")
      if (any(kilojoules(2:) <= kilojoules(:size(kilojoules) - 1))) &
         call refuse_list(group, "thresholds", "must increase", error)
   end subroutine read_hazard

   !> Names of the variants of a case, separated by commas.
   pure function variant_names(list) result(names)
      type(namelist_t), intent(in) :: list
      character(len=:), allocatable :: names
      integer :: g

      names = ""
      do g = 1, size(list%group)
         if (list%group(g)%name == "variant") names = names//", "//text_of(list%group(g), "name")
      end do
      names = names(min(3, len(names) + 1):)
   end function variant_names
end module rockfall_case
