! SPDX-License-Identifier: BSD-3-Clause
!> The case file: every group and key, its default and what it may be, in one table that both programs read;
!> and the rules that tie keys together.
module rockfall_case
   use rockfall_kinds, only: wp, i8
   use rockfall_error, only: error_t, fail
   use rockfall_text, only: integer_text, joined
   use rockfall_namelist, only: namelist_t, group_t, parse_namelist
   use rockfall_values, only: has_key, value_count, get_text, get_integer, get_real, get_logical, refuse, &
                              about, check_names
   use rockfall_variables, only: map_fields
   use rockfall_boulder, only: volume_distribution_t, fixed_volume, normal_volume, uniform_volume, lognormal_volume, &
                               list_volume
   use rockfall_surface, only: method_a, method_b
   use rockfall_decimal, only: parse_real
   use rockfall_direction, only: past_aspect, to_aspect, by_lab
   use rockfall_forest, only: tree_law_t
   use rockfall_sobol, only: max_points
   use rockfall_barrier, only: ead_energy
   implicit none
   private
   public :: case_t, case_line_t, read_case, read_keys, key_t, key_table, n_keys, key_text, row_text, check_key, &
         repeatable
   public :: map_names, n_maps, turning_rule, radius_of_reading, max_real

   integer, parameter :: many = 100000                !! values of a list
   integer, parameter :: text_length = 4096           !! characters of a text
   integer, parameter :: max_name = 60                !! of that of a line or scenario
   real(wp), parameter :: max_real = 1.0e12_wp        !! of any number, so that no product overflows
   real(wp), parameter :: min_positive = 1.0e-12_wp   !! of a number that must be > 0

   !> A key of the case file.
   type :: key_t
      character(len=8) :: group
      character(len=20) :: name
      character(len=7) :: kind      !! text, integer, real, logical
      integer :: most               !! values
      character(len=90) :: default  !! as written in a case; "required", or "absent"
      character(len=100) :: allowed  !! "", a range ("> 0", ">= 0", "1 to 10"), or words ("A, B")
      character(len=6) :: unit
      character(len=100) :: meaning
      logical :: of_scene = .false.  !! decides what stands in a scene file
      character(len=12) :: file = ""  !! that it names: raster, layer, raster layer (either), points, table, sets
   end type key_t

   logical, parameter :: in_scene = .true.  !! for rows of the table

   character(len=*), parameter :: map_names(*) = map_fields
   integer, parameter :: n_maps = size(map_names)

   integer, parameter :: max_thresholds = 8, max_periods = 8  !! between classes of intensity, of frequency
   character(len=*), parameter :: hazard_classes = "residual, low, moderate, high"  !! rising
   !> Below 30 kJ, 30 to 300 kJ, above 300 kJ, each up to 30, 100 and 300 years (docs/hazard.md says whence).
   character(len=*), parameter :: swiss_matrix = "'moderate', 2*'low', 'high', 2*'moderate', 3*'high'"

   !> Groups of which a case may have several.
   character(len=*), parameter :: repeatable(*) = [character(len=8) :: "line", "barrier", "dam", "scenario"]

   type(key_t), parameter :: key_table(*) = [ &
      key_t("case", "title", "text", 1, "''", "", "", "what the result is called"), &
      key_t("case", "seed", "integer", 1, "1", ">= 0", "", "of the random numbers"), &
      key_t("case", "boulders", "integer", 1, "required", "1 to 1e15", "", "released from each source"), &
      key_t("case", "threads", "integer", 1, "0", "0 to 1024", "", "0 = all cores"), &
      key_t("case", "sampling", "text", 1, "'random'", "random, sobol", "", &
            "sobol: volumes and first rebounds spread evenly"), &
      key_t("terrain", "dem", "text", 1, "required", "", "", &
            "elevation raster, square cells in metres", in_scene, "raster"), &
      key_t("surface", "zones", "text", 1, "absent", "", "", &
            "raster of zone ids, or polygons", in_scene, "raster layer"), &
      key_t("surface", "table", "text", 1, "absent", "", "", &
            "CSV with zone, mean_radius, rg70, rg20, rg10, ground", in_scene, "table"), &
      key_t("surface", "zone_field", "text", 1, "'zone'", "", "", "attribute of zone polygons with the id", in_scene), &
      key_t("surface", "zones_layer", "text", 1, "absent", "", "", "of a GeoPackage with several", in_scene), &
      key_t("surface", "default_zone", "integer", 1, "absent", "-2147483647 to 2147483647", "", &
            "zone of cells that have none", in_scene), &
      key_t("surface", "mean_radius", "text", 1, "absent", "", "", &
            "raster of mean rock radii [m]", in_scene, "raster"), &
      key_t("surface", "rg70", "text", 1, "absent", "", "", &
            "raster of obstacle sizes met at 70 % [m]", in_scene, "raster"), &
      key_t("surface", "rg20", "text", 1, "absent", "", "", &
            "raster of obstacle sizes met at 20 % [m]", in_scene, "raster"), &
      key_t("surface", "rg10", "text", 1, "absent", "", "", &
            "raster of obstacle sizes met at 10 % [m]", in_scene, "raster"), &
      key_t("surface", "uniform_mean_radius", "real", 1, "absent", "> 0", "m", &
            "one mean rock radius everywhere", in_scene), &
      key_t("surface", "uniform_rg", "real", 3, "absent", "> 0", "m", "Rg70, Rg20, Rg10 everywhere", in_scene), &
      key_t("surface", "method", "text", 1, "'B'", "A, B", "", &
            "A: three obstacle sizes, B: one mean radius", in_scene), &
      key_t("surface", "rg_reading", "text", 1, "'diameter'", "diameter, radius", "", "what Rg measures"), &
      key_t("surface", "ground", "text", 1, "absent", "", "", &
            "what rebounds follow where nothing else is said: a ground of the table, or an impact set", in_scene), &
      key_t("surface", "ground_map", "text", 1, "absent", "", "", "raster of ids of grounds", in_scene, "raster"), &
      key_t("surface", "ground_table", "text", 1, "absent", "", "", &
            "CSV of grounds in place of those shipped", in_scene, "table"), &
      key_t("impact", "sets", "text", 1, "'rocky-slope'", "", "", "shipped impact set, or a file", in_scene, "sets"), &
      key_t("impact", "turning", "text", 1, "'past_aspect'", "past_aspect, to_aspect, lab", "", &
            "by a random angle, past the cell's aspect or at most to it; or as in the laboratory: impact_sets.md"), &
      key_t("impact", "ratio", "text", 1, "'nearest'", "nearest, between", "", &
            "which set serves R_b/R_m: the nearest, or either of the two beside it, the nearer more often"), &
      key_t("impact", "stop_speed", "real", 1, "0.5", "> 0", "m/s", "slower after a rebound: stopped"), &
      key_t("impact", "impact_limit", "integer", 1, "100000", "1 to 2147483647", "", "contacts of a boulder at most"), &
      key_t("boulder", "volume", "text", 1, "'fixed'", "fixed, normal, uniform, lognormal, list, source", "", &
            "law; source: what rasters say at each source"), &
      key_t("boulder", "volume_mean", "real", 1, "absent", "> 0", "m3", "fixed, normal, lognormal"), &
      key_t("boulder", "volume_std", "real", 1, "absent", ">= 0", "m3", "normal (truncated at 0), lognormal"), &
      key_t("boulder", "volume_min", "real", 1, "absent", "> 0", "m3", "uniform"), &
      key_t("boulder", "volume_max", "real", 1, "absent", "> 0", "m3", "uniform"), &
      key_t("boulder", "volumes", "real", many, "absent", "> 0", "m3", "list: each with equal probability"), &
      key_t("boulder", "density", "real", 1, "2800.0", "> 0", "kg/m3", "of the boulders"), &
      key_t("boulder", "d1", "text", 1, "absent", "", "", &
            "source: raster of one of the three sides of boulders [m]", in_scene, "raster"), &
      key_t("boulder", "d2", "text", 1, "absent", "", "", "of the second [m]", in_scene, "raster"), &
      key_t("boulder", "d3", "text", 1, "absent", "", "", "of the third [m]", in_scene, "raster"), &
      key_t("boulder", "shape", "text", 1, "absent", "", "", &
            "raster: 0 none, 1 rectangular, 2 ellipsoid, 3 sphere, 4 disc; absent: spheres", in_scene, "raster"), &
      key_t("boulder", "rock_density", "text", 1, "absent", "", "", &
            "raster, in place of density [kg/m3]", in_scene, "raster"), &
      key_t("boulder", "volume_spread", "real", 1, "absent", "0 to 0.9", "", &
            "source: volumes differ by up to this fraction from that of their source, evenly"), &
      key_t("release", "x", "real", many, "absent", "", "m", "release points", in_scene), &
      key_t("release", "y", "real", many, "absent", "", "m", "release points", in_scene), &
      key_t("release", "cells", "text", 1, "absent", "", "", &
            "raster: cells above zero are sources", in_scene, "raster"), &
      key_t("release", "polygons", "text", 1, "absent", "", "", &
            "polygons: cells inside are sources", in_scene, "layer"), &
      key_t("release", "polygons_layer", "text", 1, "absent", "", "", "of a GeoPackage with several", in_scene), &
      key_t("release", "steep_cells", "logical", 1, ".false.", "", "", &
            "cells as steep as slope_threshold are sources; only those within cells or polygons, if given", in_scene), &
      key_t("release", "slope_threshold", "real", 1, "absent", "1 to 89", "degree", &
            "of steep_cells; absent: 55 RES**-0.075 for cells of RES m (Dorren 2016)", in_scene), &
      key_t("release", "by_area", "logical", 1, ".false.", "", "", &
            "a cell releases boulders in proportion to its true surface area, &case boulders if flat", in_scene), &
      key_t("release", "sources", "text", 1, "'all'", "all, sample", "", &
            "what confidence intervals take the sources for: all there are, or a sample of others like them"), &
      key_t("release", "drop_height", "real", 1, "0.0", ">= 0", "m", "above the surface"), &
      key_t("release", "velocity", "real", 3, "3*0.0", "", "m/s", "east, north, up"), &
      key_t("forest", "trees", "text", 1, "absent", "", "", &
            "CSV with x, y, dbh [cm], species; or a layer of points", in_scene, "points"), &
      key_t("forest", "stems", "text", 1, "absent", "", "", &
            "raster of stems a hectare, of which trees are made", in_scene, "raster"), &
      key_t("forest", "uniform_stems", "real", 1, "absent", "> 0", "1/ha", "as many everywhere", in_scene), &
      key_t("forest", "dbh_mean", "text", 1, "absent", "", "", &
            "raster of mean diameters at breast height [cm]", in_scene, "raster"), &
      key_t("forest", "uniform_dbh_mean", "real", 1, "absent", "> 0", "cm", &
            "one mean diameter everywhere", in_scene), &
      key_t("forest", "dbh_std", "text", 1, "absent", "", "", &
            "raster of their standard deviations [cm]", in_scene, "raster"), &
      key_t("forest", "uniform_dbh_std", "real", 1, "absent", ">= 0", "cm", &
            "one standard deviation everywhere", in_scene), &
      key_t("forest", "conifers", "text", 1, "absent", "", "", &
            "raster of the percentage of conifers among stems", in_scene, "raster"), &
      key_t("forest", "uniform_conifers", "real", 1, "absent", "0 to 100", "%", &
            "one percentage everywhere", in_scene), &
      key_t("forest", "spread", "text", 1, "'random'", "random, even", "", &
            "random: stems anywhere; even: each cell has as many as its raster says", in_scene), &
      key_t("forest", "seed", "integer", 1, "1", ">= 0", "", "of the trees that are made", in_scene), &
      key_t("forest", "species_table", "text", 1, "absent", "", "", &
            "CSV with species, genus, factor; absent: as shipped", in_scene, "table"), &
      key_t("forest", "stem_height", "real", 1, "absent", "> 0", "m", &
            "boulders that are higher pass over; absent: none does"), &
      key_t("forest", "lateral_from", "real", 1, "0.58", "0 to 1", "", &
            "place on the stem from which a hit is lateral"), &
      key_t("forest", "scratch_from", "real", 1, "0.75", "0 to 1", "", &
            "place on the stem from which a hit is a scratch"), &
      key_t("forest", "turn_frontal", "real", 3, "22.5, 45.0, 8.5", ">= 0", "", &
            "how often a frontal hit turns by 0-22.5, 22.5-67.5, 67.5-76 degrees, in any unit"), &
      key_t("forest", "turn_lateral", "real", 3, "22.5, 45.0, 8.5", ">= 0", "", "the same of a lateral hit"), &
      key_t("forest", "turn_scratch", "real", 3, "22.5, 45.0, 8.5", ">= 0", "", "the same of a scratch"), &
      key_t("flight", "gravity", "real", 1, "9.81", "> 0", "m/s2", "acceleration of gravity"), &
      key_t("line", "name", "text", 1, "absent", "", "", "of an evaluation line"), &
      key_t("line", "x", "real", many, "absent", "", "m", "vertices, two or more"), &
      key_t("line", "y", "real", many, "absent", "", "m", "vertices, two or more"), &
      key_t("line", "file", "text", 1, "absent", "", "", "in place of x and y: lines, one or more", file="layer"), &
      key_t("line", "layer", "text", 1, "absent", "", "", "of a GeoPackage with several"), &
      key_t("line", "field", "text", 1, "absent", "", "", "attribute with the name; absent: name"), &
      key_t("barrier", "name", "text", 1, "absent", "", "", "of a net or wall, which is an evaluation line too"), &
      key_t("barrier", "x", "real", many, "absent", "", "m", "vertices, two or more"), &
      key_t("barrier", "y", "real", many, "absent", "", "m", "vertices, two or more"), &
      key_t("barrier", "height", "real", 1, "absent", "> 0", "m", &
            "vertical, of the top edge above the ground; a boulder whose centre is above it passes over"), &
      key_t("barrier", "capacity", "real", 1, "absent", "> 0", "kJ", "kinetic energy that it takes at most"), &
      key_t("barrier", "class", "integer", 1, "absent", "0 to 7", "", &
            "instead of capacity: of EAD 340059, by its maximum energy level"), &
      key_t("barrier", "file", "text", 1, "absent", "", "", &
            "in place of x and y: lines, whose attributes give what the group does not", file="layer"), &
      key_t("barrier", "layer", "text", 1, "absent", "", "", "of a GeoPackage with several"), &
      key_t("barrier", "field", "text", 1, "absent", "", "", "attribute with the name; absent: name"), &
      key_t("dam", "x", "real", many, "absent", "", "m", "vertices of the crest, two or more", in_scene), &
      key_t("dam", "y", "real", many, "absent", "", "m", "vertices of the crest, two or more", in_scene), &
      key_t("dam", "height", "real", 1, "absent", "0.001 to 1000", "m", "of the crest above the terrain below it", &
            in_scene), &
      key_t("dam", "crest_width", "real", 1, "0.0", ">= 0", "m", "of its flat top", in_scene), &
      key_t("dam", "slope", "real", 1, "45.0", "1 to 89", "degree", "of its faces", in_scene), &
      key_t("dam", "file", "text", 1, "absent", "", "", &
            "in place of x and y: lines, whose attributes give what the group does not", in_scene, "layer"), &
      key_t("dam", "layer", "text", 1, "absent", "", "", "of a GeoPackage with several", in_scene), &
      key_t("output", "maps", "text", n_maps, "absent", "as in result.md", "", "rasters of results"), &
      key_t("output", "map_extent", "text", 1, "'reach'", "reach, terrain", "", &
            "reach: the cells that boulders can reach; terrain: all"), &
      key_t("output", "least_passages", "integer", 1, "1", "1 to 2147483647", "", &
            "cells with fewer show no mean and no quantile"), &
      key_t("output", "rebounds", "logical", 1, ".false.", "", "", "histograms over all rebounds"), &
      key_t("output", "energy_balance", "logical", 1, ".false.", "", "", &
            "what became of the energy of each boulder: ground, trees, barriers, left"), &
      key_t("output", "trajectories", "integer", 1, "0", "0 to 2147483647", "", &
            "record so many boulders, the first of each source in proportion to what it releases"), &
      key_t("ensemble", "runs", "integer", 1, "64", "8 to 65536", "", "draws of all that is uncertain"), &
      key_t("ensemble", "radius_factor", "real", 1, "1.0", "1 to 10", "", &
            "geometric standard deviation of R_m or Rg, zone by zone"), &
      key_t("ensemble", "volume_factor", "real", 1, "1.0", "1 to 10", "", &
            "geometric standard deviation of all volumes together"), &
      key_t("ensemble", "volume_std_factor", "real", 1, "1.0", "1 to 10", "", &
            "geometric standard deviation of volume_std"), &
      key_t("ensemble", "drop_height_factor", "real", 1, "1.0", "1 to 10", "", &
            "geometric standard deviation of drop_height"), &
      key_t("ensemble", "dem_error", "real", 1, "0.0", ">= 0", "m", "standard deviation of elevations"), &
      key_t("ensemble", "dem_correlation", "real", 1, "absent", "> 0", "m", &
            "distance at which the correlation of their errors is 1/e"), &
      key_t("ensemble", "source_shift", "real", 1, "0.0", ">= 0", "m", &
            "standard deviation of easting and northing of all sources together"), &
      key_t("ensemble", "sets", "text", 100, "absent", "", "", "impact sets, each with equal probability", &
            file="sets"), &
      key_t("scenario", "name", "text", 1, "required", "", "", "of a class of boulders, with its frequency"), &
      key_t("scenario", "frequency", "real", 1, "absent", "> 0", "1/year", "how many boulders come loose"), &
      key_t("scenario", "return_period", "real", 1, "absent", "> 0", "year", "instead of frequency: 1/frequency"), &
      key_t("scenario", "frequency_per", "text", 1, "'year'", "year, source, km2", "", &
            "year: of all sources together; source: of each; km2: of so much surface of source cells"), &
      key_t("scenario", "volume", "text", 1, "absent", "fixed, normal, uniform, lognormal, list", "", &
            "with its own keys, in place of all volume keys of &boulder"), &
      key_t("scenario", "volume_mean", "real", 1, "absent", "> 0", "m3", "in place of that of &boulder"), &
      key_t("scenario", "volume_std", "real", 1, "absent", ">= 0", "m3", "in place of that of &boulder"), &
      key_t("scenario", "volume_min", "real", 1, "absent", "> 0", "m3", "in place of that of &boulder"), &
      key_t("scenario", "volume_max", "real", 1, "absent", "> 0", "m3", "in place of that of &boulder"), &
      key_t("scenario", "volumes", "real", many, "absent", "> 0", "m3", "in place of those of &boulder"), &
      key_t("scenario", "density", "real", 1, "absent", "> 0", "kg/m3", "in place of that of &boulder"), &
      key_t("hazard", "thresholds", "real", max_thresholds, "30.0, 300.0", ">= 0", "kJ", &
            "of energy, rising: of the map energy_exceeded, and between classes of intensity"), &
      key_t("hazard", "return_periods", "real", max_periods, "30.0, 100.0, 300.0", "> 0", "year", &
            "rising: the ends of the classes of frequency"), &
      key_t("hazard", "matrix", "text", (max_thresholds + 1)*max_periods, swiss_matrix, &
            hazard_classes, "", &
            "hazard of each class of intensity, from the weakest, by return period, from the shortest"), &
      key_t("hazard", "minimum_area", "real", 1, "0.0", ">= 0", "m2", &
            "of a zone: a smaller patch takes the class of the largest beside it")]
   integer, parameter :: n_keys = size(key_table)

   !> An evaluation line, or a barrier: one that stops boulders.
   type :: case_line_t
      character(len=:), allocatable :: name
      real(wp), allocatable :: x(:), y(:)  !! map coordinates [m]
      real(wp) :: height = 0.0_wp          !! of a barrier [m]; 0: an evaluation line
      real(wp) :: capacity = 0.0_wp        !! of a barrier [J]
   end type case_line_t

   !> A case as read; file names as written, "" when absent.
   type :: case_t
      character(len=:), allocatable :: file, title, dem, zones, table, zone_field, mean_radius, rg(:), sets, &
                                       cells, polygons, ground, ground_map, ground_table
      integer(i8) :: seed = 1, boulders = 1
      integer :: threads = 0
      logical :: sobol = .false.                 !! sampling
      integer, allocatable :: default_zone
      real(wp), allocatable :: uniform_sizes(:)  !! R_m, or Rg70, Rg20, Rg10 [m]
      integer :: method = method_b
      real(wp) :: size_to_radius = 0.5_wp
      real(wp) :: stop_speed = 0.5_wp, gravity = 9.81_wp, drop_height = 0.0_wp, velocity(3) = 0.0_wp
      integer :: impact_limit = 100000
      integer :: turning = past_aspect           !! rule of turning_t
      logical :: between_ratios = .false.
      type(volume_distribution_t) :: volumes
      logical :: by_source = .false.             !! sources say what their boulders are; volumes are factors
      logical :: source_density = .false.        !! also their density
      real(wp), allocatable :: x(:), y(:)        !! release points, map coordinates [m]
      logical :: forest = .false.                !! there are trees
      type(tree_law_t) :: tree_law
      logical :: steep_cells = .false., by_area = .false.
      real(wp), allocatable :: slope_threshold   !! [degree]
      type(case_line_t), allocatable :: lines(:)  !! evaluation lines, then barriers, whose coordinates are typed
      character(len=:), allocatable :: unread    !! a layer with more of them or dams, for messages; "": none
      logical :: map(n_maps) = .false.           !! which of map_names
      logical :: whole_maps = .false.            !! also where no boulder can come
      integer :: least_passages = 1              !! for a mean or a quantile in a cell
      logical :: rebounds = .false.
      logical :: energy_balance = .false.
      integer :: trajectories = 0
      real(wp), allocatable :: thresholds(:)     !! of the map energy_exceeded [J]
   end type case_t

contains

   !> The case in a text; one clear error for anything that is not as the table and the rules want it.
   pure subroutine read_case(text, file, case, error)
      character(len=*), intent(in) :: text
      character(len=*), intent(in) :: file  !! its name, for messages
      type(case_t), intent(out) :: case
      type(error_t), allocatable, intent(out) :: error
      type(namelist_t) :: list

      call read_keys(text, file, list, error)
      if (allocated(error)) return
      case%file = file
      call read_run(list, case, error)
      if (.not. allocated(error)) call read_surface(group_of(list, "surface"), case, error)
      if (.not. allocated(error)) call read_boulder(group_of(list, "boulder"), case, error)
      if (.not. allocated(error)) call read_release(group_of(list, "release"), case, error)
      if (.not. allocated(error)) call read_forest(group_of(list, "forest"), case, error)
      if (.not. allocated(error)) call read_lines(list, case, error)
      if (.not. allocated(error)) call read_output(group_of(list, "output"), case, error)
      if (.not. allocated(error)) call check_ensemble(group_of(list, "ensemble"), case, error)
      if (.not. allocated(error)) call read_hazard(group_of(list, "hazard"), list, case, error)
      if (.not. allocated(error)) call check_scenarios(list, case, error)
   end subroutine read_case

   !> All groups and keys of a case with their values as written, those that are absent with their defaults; each is as
   !> the table wants it.
   pure subroutine read_keys(text, file, list, error)
      character(len=*), intent(in) :: text
      character(len=*), intent(in) :: file  !! its name, for messages
      type(namelist_t), intent(out) :: list
      type(error_t), allocatable, intent(out) :: error

      call parse_namelist(text, file, list, error)
      if (.not. allocated(error)) call check_names(list, key_table%group, key_table%name, repeatable, &
                                                   "a case has one such group; only &" &
                                                   //joined(repeatable, ", &")//" may repeat", error)
      if (.not. allocated(error)) call complete(list, file)
      if (.not. allocated(error)) call check_keys(list, error)
   end subroutine read_keys

   !> A row of the table as text.
   pure function key_text(k) result(text)
      integer, intent(in) :: k
      character(len=:), allocatable :: text

      text = row_text(key_table(k))
   end function key_text

   !> A key as text: group|key|kind|most|default|allowed|unit|meaning|file.
   pure function row_text(key) result(text)
      type(key_t), intent(in) :: key
      character(len=:), allocatable :: text

      text = trim(key%group)//"|"//trim(key%name)//"|"//trim(key%kind)//"|"//integer_text(key%most)//"|" &
             //trim(key%default)//"|"//trim(key%allowed)//"|"//trim(key%unit)//"|"//trim(key%meaning) &
             //"|"//trim(key%file)
   end function row_text

   !> Add the groups that are absent and the defaults of keys that are absent.
   pure subroutine complete(list, file)
      type(namelist_t), intent(inout) :: list
      character(len=*), intent(in) :: file
      type(namelist_t) :: defaults
      type(error_t), allocatable :: error
      integer :: d, e, g

      call parse_namelist(default_case(), file, defaults, error)
      do d = 1, size(defaults%group)
         associate (default => defaults%group(d))
            if (.not. any([repeatable == default%name, list%group%name == default%name])) then
               list%group = [list%group, default]
               cycle
            end if
            do g = 1, size(list%group)
               if (list%group(g)%name /= default%name) cycle
               do e = 1, size(default%entry)
                  if (has_key(list%group(g), trim(default%entry(e)%key))) cycle
                  list%group(g)%entry = [list%group(g)%entry, default%entry(e)]
               end do
            end do
         end associate
      end do
   end subroutine complete

   !> The defaults of the table as the text of a case.
   pure function default_case() result(text)
      character(len=:), allocatable :: text
      type(key_t) :: key
      character(len=len(key%group)) :: group
      integer :: k

      text = ""
      group = ""
      do k = 1, n_keys
         key = key_table(k)
         if (key%group /= group) then
            if (k > 1) text = text//" / "
            text = text//"&"//trim(key%group)
            group = key%group
         end if
         if (key%default == "required" .or. key%default == "absent") cycle
         text = text//" "//trim(key%name)//" = "//trim(key%default)
      end do
      text = text//" /"
   end function default_case

   !> The group of a name, which `complete` made sure is there.
   pure type(group_t) function group_of(list, name)
      type(namelist_t), intent(in) :: list
      character(len=*), intent(in) :: name
      integer :: g

      do g = 1, size(list%group)
         if (list%group(g)%name == name) group_of = list%group(g)
      end do
   end function group_of

   !> Every value is of the kind, number and range that the table says.
   pure subroutine check_keys(list, error)
      type(namelist_t), intent(in) :: list
      type(error_t), allocatable, intent(out) :: error
      integer :: g, k

      do g = 1, size(list%group)
         do k = 1, n_keys
            if (key_table(k)%group /= list%group(g)%name) cycle
            call check_key(list%group(g), key_table(k), error)
            if (allocated(error)) return
         end do
      end do
   end subroutine check_keys

   pure subroutine check_key(group, key, error)
      type(group_t), intent(in) :: group
      type(key_t), intent(in) :: key
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: name
      logical :: switch
      integer :: n

      name = trim(key%name)
      n = value_count(group, name)
      if (n == 0) then
         if (key%default == "required") call fail(error, about(group, name)//" is missing: " &
                                                  //trim(key%kind)//", "//trim(key%meaning))
      else if (n > key%most .or. (key%most == 3 .and. n < 3)) then
         if (key%most == 1) call refuse(group, name, "must be one value", error)
         if (key%most == 3) call refuse(group, name, "must be three values", error)
         if (key%most > 3) call refuse(group, name, "must be at most "//integer_text(key%most)//" values", error)
      else
         select case (key%kind)
         case ("text"); call check_texts(group, key, error)
         case ("integer"); call check_integers(group, key, error)
         case ("real"); call check_reals(group, key, error)
         case default; call get_logical(group, name, switch, error)
         end select
      end if
   end subroutine check_key

   pure subroutine check_texts(group, key, error)
      type(group_t), intent(in) :: group
      type(key_t), intent(in) :: key
      type(error_t), allocatable, intent(out) :: error
      character(len=text_length), allocatable :: values(:)
      character(len=:), allocatable :: words
      integer :: k

      words = trim(key%allowed)
      if (key%name == "maps") words = joined(map_names, ", ")
      allocate (values(0))
      call get_text(group, trim(key%name), values, error)
      if (allocated(error)) return
      do k = 1, size(values)
         if (len_trim(values(k)) == 0 .and. key%name /= "title") then
            call refuse(group, trim(key%name), "must not be empty", error, k)
         else if (words /= "" .and. index(", "//words//",", ", "//trim(values(k))//",") == 0) then
            call refuse(group, trim(key%name), "must be one of: "//words, error, k)
         end if
         if (allocated(error)) return
      end do
   end subroutine check_texts

   pure subroutine check_integers(group, key, error)
      type(group_t), intent(in) :: group
      type(key_t), intent(in) :: key
      type(error_t), allocatable, intent(out) :: error
      integer(i8) :: value
      real(wp) :: range(2)

      call get_integer(group, trim(key%name), value, error)
      if (allocated(error)) return
      range = range_of(key%allowed, [-real(huge(1_i8), wp), real(huge(1_i8), wp)])
      if (value < range(1) .or. value > range(2)) &
         call refuse(group, trim(key%name), "must be "//trim(key%allowed), error)
   end subroutine check_integers

   pure subroutine check_reals(group, key, error)
      type(group_t), intent(in) :: group
      type(key_t), intent(in) :: key
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: values(:)
      real(wp) :: range(2)
      character(len=:), allocatable :: unit
      logical :: positive
      integer :: k

      call get_real(group, trim(key%name), values, error)
      if (allocated(error)) return
      unit = ""
      if (key%unit /= "") unit = " ["//trim(key%unit)//"]"
      range = range_of(key%allowed, [-max_real, max_real])
      positive = key%allowed(:2) == "> "
      do k = 1, size(values)
         if (values(k) < range(1) .or. (positive .and. values(k) <= range(1)) .or. &
             (values(k) > range(2) .and. range(2) < max_real)) then
            call refuse(group, trim(key%name), "must be "//trim(key%allowed)//unit, error, k)
         else if (abs(values(k)) > max_real) then
            call refuse(group, trim(key%name), "must be at most 1e12"//unit, error, k)
         else if (positive .and. values(k) < min_positive) then
            call refuse(group, trim(key%name), "must be at least 1e-12"//unit, error, k)
         end if
         if (allocated(error)) return
      end do
   end subroutine check_reals

   !> The ends of "a to b", "> a" or ">= a"; `outer` gives those that are not told.
   pure function range_of(allowed, outer) result(range)
      character(len=*), intent(in) :: allowed
      real(wp), intent(in) :: outer(2)
      real(wp) :: range(2)
      integer :: to, status

      range = outer
      to = index(allowed, " to ")
      if (to > 0) then
         call parse_real(allowed(:to - 1), range(1), status)
         call parse_real(trim(allowed(to + 4:)), range(2), status)
      else if (allowed(:1) == ">") then
         call parse_real(trim(allowed(index(allowed, " ") + 1:)), range(1), status)
      end if
   end function range_of

   ! From here on every value is known to be of its kind and range; what is left are the rules between keys.

   pure function text_of(group, key) result(value)
      type(group_t), intent(in) :: group
      character(len=*), intent(in) :: key
      character(len=:), allocatable :: value  !! "" when absent
      type(error_t), allocatable :: error

      value = ""
      call get_text(group, key, value, error)
   end function text_of

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

   pure subroutine read_run(list, case, error)
      type(namelist_t), intent(in) :: list
      type(case_t), intent(inout) :: case
      type(error_t), allocatable, intent(out) :: error
      type(group_t) :: group

      group = group_of(list, "case")
      case%title = text_of(group, "title")
      case%seed = integer_of(group, "seed")
      case%boulders = integer_of(group, "boulders")
      case%threads = int(integer_of(group, "threads"))
      case%sobol = text_of(group, "sampling") == "sobol"
      if (case%sobol .and. case%boulders > max_points) then
         call refuse(group, "boulders", "must be at most 2**32 with sampling = 'sobol'", error)
      end if
      group = group_of(list, "terrain")
      case%dem = text_of(group, "dem")
      group = group_of(list, "flight")
      case%gravity = real_of(group, "gravity")
      group = group_of(list, "impact")
      case%sets = text_of(group, "sets")
      case%between_ratios = text_of(group, "ratio") == "between"
      case%turning = turning_rule(text_of(group, "turning"))
      case%stop_speed = real_of(group, "stop_speed")
      case%impact_limit = int(integer_of(group, "impact_limit"))
   end subroutine read_run

   !> The rule of turning_t of `&impact turning`.
   pure integer function turning_rule(word)
      character(len=*), intent(in) :: word

      select case (word)
      case ("to_aspect"); turning_rule = to_aspect
      case ("lab"); turning_rule = by_lab
      case default; turning_rule = past_aspect
      end select
   end function turning_rule

   !> Radius over Rg, by `&surface rg_reading`.
   pure real(wp) function radius_of_reading(word)
      character(len=*), intent(in) :: word

      radius_of_reading = merge(0.5_wp, 1.0_wp, word == "diameter")
   end function radius_of_reading

   !> The material is given in one of three ways: zones with a table, rasters of values, or one value; in none, where
   !> the ground is said to be one that needs to know of no rocks.
   pure subroutine read_surface(group, case, error)
      type(group_t), intent(in) :: group
      type(case_t), intent(inout) :: case
      type(error_t), allocatable, intent(out) :: error
      character(len=*), parameter :: rasters(4) = [character(len=11) :: "mean_radius", "rg70", "rg20", "rg10"]
      logical :: zones, by_raster, uniform
      integer :: k

      case%method = merge(method_a, method_b, text_of(group, "method") == "A")
      case%size_to_radius = radius_of_reading(text_of(group, "rg_reading"))
      case%zones = text_of(group, "zones")
      case%table = text_of(group, "table")
      case%zone_field = text_of(group, "zone_field")
      case%mean_radius = text_of(group, "mean_radius")
      case%ground = text_of(group, "ground")
      case%ground_map = text_of(group, "ground_map")
      case%ground_table = text_of(group, "ground_table")
      allocate (character(len=text_length) :: case%rg(3))
      do k = 1, 3
         case%rg(k) = text_of(group, trim(rasters(k + 1)))
      end do
      if (has_key(group, "zones_layer") .and. .not. has_key(group, "zones")) then
         call refuse(group, "zones_layer", "has no meaning without zones", error)
         return
      end if
      if (has_key(group, "default_zone")) case%default_zone = int(integer_of(group, "default_zone"))
      zones = has_key(group, "zones") .or. has_key(group, "table") .or. has_key(group, "default_zone")
      by_raster = any([(has_key(group, trim(rasters(k))), k=1, 4)])
      uniform = has_key(group, "uniform_mean_radius") .or. has_key(group, "uniform_rg")
      if (.not. any([zones, by_raster, uniform]) .and. (case%ground /= "" .or. case%ground_map /= "")) then
         return
      else if (count([zones, by_raster, uniform]) /= 1) then
         call fail(error, group%file//": &surface: give one of: zones with table; mean_radius (method B) or rg70, " &
                   //"rg20, rg10 (method A) rasters; uniform_mean_radius (B) or uniform_rg (A)")
      else if (zones) then
         call need(group, "zones", "to say where the zones of the table are", error)
         if (.not. allocated(error)) call need(group, "table", "to say what the zones are made of", error)
      else if (by_raster .and. case%method == method_b) then
         call need(group, "mean_radius", "for method B", error)
      else if (by_raster) then
         do k = 2, 4
            if (.not. allocated(error)) call need(group, trim(rasters(k)), "for method A", error)
         end do
      else if (case%method == method_b) then
         call need(group, "uniform_mean_radius", "for method B", error)
         case%uniform_sizes = reals_of(group, "uniform_mean_radius")
      else
         call need(group, "uniform_rg", "for method A", error)
         case%uniform_sizes = reals_of(group, "uniform_rg")
      end if
   end subroutine read_surface

   pure subroutine need(group, key, why, error)
      type(group_t), intent(in) :: group
      character(len=*), intent(in) :: key, why
      type(error_t), allocatable, intent(inout) :: error

      if (has_key(group, key)) return
      call fail(error, about(group, key)//" is missing: needed "//why)
   end subroutine need

   !> The volume law, with the keys that it needs and no others.
   pure subroutine read_boulder(group, case, error)
      type(group_t), intent(in) :: group
      type(case_t), intent(inout) :: case
      type(error_t), allocatable, intent(out) :: error
      character(len=*), parameter :: keys(11) = [character(len=13) :: "volume_mean", "volume_std", "volume_min", &
                                                 "volume_max", "volumes", "d1", "d2", "d3", "shape", "rock_density", &
                                                 "volume_spread"]
      logical :: needs(size(keys)), takes(size(keys))
      character(len=:), allocatable :: law
      integer :: k

      law = text_of(group, "volume")
      needs = .false.
      select case (law)
      case ("normal"); case%volumes%kind = normal_volume; needs(1:2) = .true.
      case ("lognormal"); case%volumes%kind = lognormal_volume; needs(1:2) = .true.
      case ("uniform"); case%volumes%kind = uniform_volume; needs(3:4) = .true.
      case ("list"); case%volumes%kind = list_volume; needs(5) = .true.
      case ("source"); case%by_source = .true.; needs(6:8) = .true.
      case default; case%volumes%kind = fixed_volume; needs(1) = .true.
      end select
      takes = needs
      takes(9:) = case%by_source
      do k = 1, size(keys)
         if (needs(k)) call need(group, trim(keys(k)), "for volume = '"//law//"'", error)
         if (.not. takes(k) .and. has_key(group, trim(keys(k)))) then
            call refuse(group, trim(keys(k)), "has no meaning for volume = '"//law//"'", error)
         end if
         if (allocated(error)) return
      end do
      case%volumes%mean = real_of(group, "volume_mean")
      case%volumes%std = real_of(group, "volume_std")
      case%volumes%min = real_of(group, "volume_min")
      case%volumes%max = real_of(group, "volume_max")
      case%volumes%list = reals_of(group, "volumes")
      case%volumes%density = real_of(group, "density")
      if (case%volumes%max < case%volumes%min) then
         call refuse(group, "volume_max", "must not be below volume_min", error)
      end if
      if (case%by_source) call set_factors(group, case)
   end subroutine read_boulder

   !> Sources say what their boulders are: the law of volumes is that of factors on these.
   pure subroutine set_factors(group, case)
      type(group_t), intent(in) :: group
      type(case_t), intent(inout) :: case
      real(wp) :: spread

      spread = real_of(group, "volume_spread")
      case%source_density = has_key(group, "rock_density")
      case%volumes%kind = fixed_volume
      case%volumes%mean = 1
      if (spread <= 0) return
      case%volumes%kind = uniform_volume
      case%volumes%min = 1 - spread
      case%volumes%max = 1 + spread
   end subroutine set_factors

   pure subroutine read_release(group, case, error)
      type(group_t), intent(in) :: group
      type(case_t), intent(inout) :: case
      type(error_t), allocatable, intent(out) :: error
      logical :: points
      integer :: ways

      call get_logical(group, "steep_cells", case%steep_cells, error)
      call get_logical(group, "by_area", case%by_area, error)
      points = has_key(group, "x") .or. has_key(group, "y")
      ways = count([points, has_key(group, "cells"), has_key(group, "polygons")])
      if (ways > 1 .or. (ways == 0 .and. .not. case%steep_cells)) then
         call fail(error, group%file//": &release: give one of: points (x, y); cells; polygons; or steep_cells, " &
                   //"alone or with cells or polygons")
      else if (points .and. case%steep_cells) then
         call refuse(group, "steep_cells", "has no meaning for points (x, y)", error)
      else if (points .and. case%by_area) then
         call refuse(group, "by_area", "has no meaning for points (x, y)", error)
      else if (has_key(group, "slope_threshold") .and. .not. case%steep_cells) then
         call refuse(group, "slope_threshold", "has no meaning without steep_cells = .true.", error)
      else if (has_key(group, "polygons_layer") .and. .not. has_key(group, "polygons")) then
         call refuse(group, "polygons_layer", "has no meaning without polygons", error)
      else if (points) then
         call check_points(group, 1, error)
      end if
      if (has_key(group, "slope_threshold")) case%slope_threshold = real_of(group, "slope_threshold")
      case%x = reals_of(group, "x")
      case%y = reals_of(group, "y")
      case%cells = text_of(group, "cells")
      case%polygons = text_of(group, "polygons")
      case%drop_height = real_of(group, "drop_height")
      case%velocity = reals_of(group, "velocity")
   end subroutine read_release

   !> Trees are listed, or made of what is known of the stand; the rest is about hits.
   pure subroutine read_forest(group, case, error)
      type(group_t), intent(in) :: group
      type(case_t), intent(inout) :: case
      type(error_t), allocatable, intent(out) :: error
      character(len=*), parameter :: turns(3) = [character(len=12) :: "turn_frontal", "turn_lateral", "turn_scratch"]
      logical :: listed, made
      integer :: k

      listed = has_key(group, "trees")
      made = has_key(group, "stems") .or. has_key(group, "uniform_stems")
      case%forest = listed .or. made
      if (listed .and. made) then
         call fail(error, group%file//": &forest: give trees, or stems, not both")
         return
      end if
      call read_either(group, "stems", made, made, error)
      call read_either(group, "dbh_mean", made, made, error)
      call read_either(group, "dbh_std", made, made, error)
      call read_either(group, "conifers", made, case%forest, error)
      if (allocated(error)) return
      if (has_key(group, "species_table") .and. .not. case%forest) then
         call refuse(group, "species_table", "has no meaning without trees or stems", error)
      else if (has_key(group, "stem_height") .and. .not. case%forest) then
         call refuse(group, "stem_height", "has no meaning without trees or stems", error)
      end if
      associate (law => case%tree_law)
         if (has_key(group, "stem_height")) law%stem_height = real_of(group, "stem_height")
         law%limit = [real_of(group, "lateral_from"), real_of(group, "scratch_from")]
         if (law%limit(2) < law%limit(1)) call refuse(group, "scratch_from", "must not be below lateral_from", error)
         do k = 1, 3
            law%weight(:, k) = reals_of(group, trim(turns(k)))
            if (.not. sum(law%weight(:, k)) > 0) call refuse(group, trim(turns(k)), "one of them must be > 0", error)
         end do
      end associate
   end subroutine read_forest

   !> A raster, or one number everywhere: one of them where it is needed, none where it has no meaning.
   pure subroutine read_either(group, key, needed, allowed, error)
      type(group_t), intent(in) :: group
      character(len=*), intent(in) :: key
      logical, intent(in) :: needed, allowed
      type(error_t), allocatable, intent(inout) :: error
      character(len=:), allocatable :: uniform

      if (allocated(error)) return
      uniform = "uniform_"//key
      if (has_key(group, key) .and. has_key(group, uniform)) then
         call refuse(group, uniform, "give this or "//key//", not both", error)
      else if (has_key(group, key) .and. .not. allowed) then
         call refuse(group, key, "has no meaning without stems", error)
      else if (has_key(group, uniform) .and. .not. allowed) then
         call refuse(group, uniform, "has no meaning without stems", error)
      else if (needed .and. .not. (has_key(group, key) .or. has_key(group, uniform))) then
         call fail(error, about(group, key)//" is missing: a raster, or "//uniform//", to make trees of")
      end if
   end subroutine read_either

   !> As many y as x, and at least so many of them.
   pure subroutine check_points(group, least, error)
      type(group_t), intent(in) :: group
      integer, intent(in) :: least
      type(error_t), allocatable, intent(out) :: error

      if (value_count(group, "x") /= value_count(group, "y")) then
         call fail(error, about(group, "x, y")//": "//integer_text(value_count(group, "x"))//" x and " &
                   //integer_text(value_count(group, "y"))//" y: must be as many")
      else if (value_count(group, "x") < least) then
         call refuse(group, "x", "must be at least "//integer_text(least)//" values", error)
      end if
   end subroutine check_points

   !> Evaluation lines, then barriers; what a dam may not be.
   pure subroutine read_lines(list, case, error)
      type(namelist_t), intent(in) :: list
      type(case_t), intent(inout) :: case
      type(error_t), allocatable, intent(out) :: error
      type(group_t), allocatable :: groups(:)
      integer :: n

      call check_layers(list, case, error)
      if (allocated(error)) return
      groups = [typed(list, "line"), typed(list, "barrier")]
      allocate (case%lines(size(groups)))
      do n = 1, size(groups)
         call read_line(groups(n), case%lines(:n), error)
         if (allocated(error)) return
         if (groups(n)%name == "barrier") call read_barrier(groups(n), case%lines(n), error)
         if (allocated(error)) return
      end do
      groups = typed(list, "dam")
      do n = 1, size(groups)
         call check_polyline(groups(n), error)
         if (.not. allocated(error)) call need(groups(n), "height", "here, or as attribute of a layer", error)
         if (allocated(error)) return
      end do
   end subroutine read_lines

   !> Groups of a name whose coordinates are typed.
   pure function typed(list, name) result(groups)
      type(namelist_t), intent(in) :: list
      character(len=*), intent(in) :: name
      type(group_t), allocatable :: groups(:)
      integer :: g

      groups = pack(list%group, [(list%group(g)%name == name .and. .not. has_key(list%group(g), "file"), &
                                  g=1, size(list%group))])
   end function typed

   !> Lines, barriers and dams of layers. Their coordinates are read elsewhere, and checked as if they were typed.
   pure subroutine check_layers(list, case, error)
      type(namelist_t), intent(in) :: list
      type(case_t), intent(inout) :: case
      type(error_t), allocatable, intent(out) :: error
      integer :: g

      case%unread = ""
      do g = 1, size(list%group)
         associate (group => list%group(g))
            if (all(group%name /= [character(len=7) :: "line", "barrier", "dam"])) cycle
            call check_layer(group, error)
            if (allocated(error)) return
            if (has_key(group, "file")) case%unread = about(group, "file")//" = '"//text_of(group, "file")//"'"
         end associate
      end do
   end subroutine check_layers

   pure subroutine check_layer(group, error)
      type(group_t), intent(in) :: group
      type(error_t), allocatable, intent(inout) :: error
      logical :: points

      points = has_key(group, "x") .or. has_key(group, "y")
      if (has_key(group, "file") .eqv. points) then
         call fail(error, about(group, "x, y")//": give these, or file with lines in a layer")
      else if (points .and. has_key(group, "layer")) then
         call refuse(group, "layer", "has no meaning without file", error)
      else if (points .and. has_key(group, "field")) then
         call refuse(group, "field", "has no meaning without file", error)
      else if (has_key(group, "name") .and. has_key(group, "field")) then
         call refuse(group, "field", "has no meaning where name is given", error)
      else if (has_key(group, "capacity") .and. has_key(group, "class")) then
         call fail(error, about(group, "capacity, class")//": give one of the two")
      end if
   end subroutine check_layer

   !> The last of some lines.
   pure subroutine read_line(group, lines, error)
      type(group_t), intent(in) :: group
      type(case_line_t), intent(inout) :: lines(:)
      type(error_t), allocatable, intent(out) :: error
      integer :: k

      call check_polyline(group, error)
      if (.not. allocated(error)) call need(group, "name", "to tell it from others", error)
      if (allocated(error)) return
      associate (line => lines(size(lines)))
         line%name = text_of(group, "name")
         line%x = reals_of(group, "x")
         line%y = reals_of(group, "y")
         do k = 1, size(lines) - 1
            if (lines(k)%name == line%name) &
               call refuse(group, "name", "must be another for each line and barrier", error)
         end do
         if (len(line%name) > max_name) &
            call refuse(group, "name", "must be at most "//integer_text(max_name)//" characters", error)
      end associate
   end subroutine read_line

   !> As many y as x, and two different points.
   pure subroutine check_polyline(group, error)
      type(group_t), intent(in) :: group
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: x(:), y(:)

      call check_points(group, 2, error)
      if (allocated(error)) return
      x = reals_of(group, "x")
      y = reals_of(group, "y")
      if (all(x >= x(1)) .and. all(x <= x(1)) .and. all(y >= y(1)) .and. all(y <= y(1))) &
         call refuse(group, "x", "a line must have two different points", error)
   end subroutine check_polyline

   !> How high a barrier is, and how much energy it takes.
   pure subroutine read_barrier(group, barrier, error)
      type(group_t), intent(in) :: group
      type(case_line_t), intent(inout) :: barrier
      type(error_t), allocatable, intent(out) :: error

      call need(group, "height", "here, or as attribute of a layer", error)
      if (allocated(error)) return
      barrier%height = real_of(group, "height")
      if (has_key(group, "class")) then
         barrier%capacity = ead_energy(int(integer_of(group, "class")))
      else if (has_key(group, "capacity")) then
         barrier%capacity = 1000*real_of(group, "capacity")
      else
         call fail(error, about(group, "capacity, class")//": give one of the two")
      end if
   end subroutine read_barrier

   pure subroutine read_output(group, case, error)
      type(group_t), intent(in) :: group
      type(case_t), intent(inout) :: case
      type(error_t), allocatable, intent(out) :: error
      character(len=len(map_names)), allocatable :: maps(:)
      integer :: k

      allocate (maps(0))
      call get_text(group, "maps", maps, error)
      if (.not. allocated(error)) call get_logical(group, "rebounds", case%rebounds, error)
      if (.not. allocated(error)) call get_logical(group, "energy_balance", case%energy_balance, error)
      case%whole_maps = text_of(group, "map_extent") == "terrain"
      case%least_passages = int(integer_of(group, "least_passages"))
      case%trajectories = int(integer_of(group, "trajectories"))
      case%map = [(any(maps == map_names(k)), k=1, n_maps)]
   end subroutine read_output

   !> What `rockfall ensemble` varies; a run takes no notice of it.
   pure subroutine check_ensemble(group, case, error)
      type(group_t), intent(in) :: group
      type(case_t), intent(in) :: case
      type(error_t), allocatable, intent(out) :: error

      if (real_of(group, "dem_error") > 0) call need(group, "dem_correlation", "for dem_error", error)
      if (allocated(error)) return
      if (real_of(group, "volume_std_factor") > 1 .and. case%volumes%std <= 0) then
         call refuse(group, "volume_std_factor", "has no meaning without a volume_std", error)
      else if (real_of(group, "volume_factor") > 1 .and. case%by_source) then
         call refuse(group, "volume_factor", "has no meaning for volume = 'source'", error)
      else if (real_of(group, "drop_height_factor") > 1 .and. case%drop_height <= 0) then
         call refuse(group, "drop_height_factor", "has no meaning without a drop_height", error)
      end if
   end subroutine check_ensemble

   !> Thresholds for a map; the rest is for `rockfall hazard`, and a run takes no notice of it.
   pure subroutine read_hazard(group, list, case, error)
      type(group_t), intent(in) :: group
      type(namelist_t), intent(in) :: list
      type(case_t), intent(inout) :: case
      type(error_t), allocatable, intent(out) :: error
      real(wp), parameter :: joules = 1000.0_wp  !! of a kJ

      call check_rising(group, "thresholds", error)
      if (.not. allocated(error)) call check_rising(group, "return_periods", error)
      if (allocated(error)) return
      case%thresholds = joules*reals_of(group, "thresholds")
      if (any(list%group%name == "scenario")) call check_matrix(group, error)
   end subroutine read_hazard

   pure subroutine check_rising(group, key, error)
      type(group_t), intent(in) :: group
      character(len=*), intent(in) :: key
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: values(:)

      values = reals_of(group, key)
      if (any(values(2:) <= values(:size(values) - 1))) &
         call refuse(group, key, "each must be above the one before", error)
   end subroutine check_rising

   !> A class for each intensity and return period, which does not fall where boulders are stronger or more frequent:
   !> so the classes at both ends of an interval of frequencies enclose all between.
   pure subroutine check_matrix(group, error)
      type(group_t), intent(in) :: group
      type(error_t), allocatable, intent(out) :: error
      character(len=len(hazard_classes)), allocatable :: words(:)
      integer, allocatable :: hazard(:, :)  !! rises with the class (return periods, intensities)
      integer :: k, periods, intensities

      periods = value_count(group, "return_periods")
      intensities = value_count(group, "thresholds") + 1
      allocate (words(0))
      call get_text(group, "matrix", words, error)
      if (size(words) /= periods*intensities) then
         call refuse(group, "matrix", "must be "//integer_text(intensities)//" times "//integer_text(periods) &
                     //" classes: below, between and above the thresholds, for each of return_periods", error)
         return
      end if
      hazard = reshape([(index(hazard_classes, trim(words(k))), k=1, size(words))], [periods, intensities])
      if (any(hazard(2:, :) > hazard(:periods - 1, :)) .or. any(hazard(:, 2:) < hazard(:, :intensities - 1))) then
         call refuse(group, "matrix", "must not fall where boulders are stronger or more frequent", error)
      end if
   end subroutine check_matrix

   !> What `rockfall hazard` runs.
   pure subroutine check_scenarios(list, case, error)
      type(namelist_t), intent(in) :: list
      type(case_t), intent(in) :: case
      type(error_t), allocatable, intent(out) :: error
      integer :: g, other

      do g = 1, size(list%group)
         if (list%group(g)%name /= "scenario") cycle
         associate (group => list%group(g))
            do other = 1, g - 1
               if (list%group(other)%name /= "scenario") cycle
               if (text_of(list%group(other), "name") == text_of(group, "name")) &
                  call refuse(group, "name", "must be another for each scenario", error)
            end do
            if (len(text_of(group, "name")) > max_name) then
               call refuse(group, "name", "must be at most "//integer_text(max_name)//" characters", error)
            else if (has_key(group, "frequency") .eqv. has_key(group, "return_period")) then
               call fail(error, about(group, "frequency, return_period")//": give one of the two")
            else if (text_of(group, "frequency_per") == "km2" .and. size(case%x) > 0) then
               call refuse(group, "frequency_per", "has no meaning for points (x, y), which have no area", error)
            end if
            if (allocated(error)) return
         end associate
      end do
   end subroutine check_scenarios
end module rockfall_case
