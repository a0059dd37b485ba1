! SPDX-License-Identifier: BSD-3-Clause
!> Keys of a case file: every group and key, its default and allowed values, in one table for both programs.
module rockfall_case_keys
   use, intrinsic :: ieee_arithmetic, only: ieee_is_nan, ieee_value, ieee_quiet_nan
   use rockfall_kinds, only: wp, i8
   use rockfall_error, only: error_t, fail, gather
   use rockfall_text, only: integer_text, joined, nearest_names
   use rockfall_namelist, only: namelist_t, group_t, parse_namelist
   use rockfall_values, only: has_key, value_count, get_text, get_integer, get_real, get_logical, refuse, &
                              refuse_list, has_comma, key_location, check_names
   use rockfall_variables, only: map_fields
   use rockfall_decimal, only: parse_real
   implicit none
   private
   public :: key_t, key_table, n_keys, row_text, read_keys, complete_keys, default_keys, check_key, repeatable
   public :: broken_rule, limits_of, plain
   public :: map_names, n_maps, many, text_length, max_name, max_real, strength_range, relief_range

   integer, parameter :: many = 100000                !! maximum number of values in a list
   integer, parameter :: text_length = 4096           !! maximum length of a text
   integer, parameter :: max_name = 60                !! maximum length of the name of a line or scenario
   real(wp), parameter :: max_real = 1.0e12_wp        !! maximum absolute value; no product of such numbers overflows
   real(wp), parameter :: min_positive = 1.0e-12_wp   !! minimum of numbers that must be positive

   !> Key of the case file.
   type :: key_t
      character(len=8) :: group
      character(len=32) :: name
      character(len=7) :: kind      !! text, integer, real, logical, or count: words or an integer
      integer :: most               !! maximum number of values
      character(len=90) :: default  !! text as in a case file; "required", or "absent"
      character(len=100) :: allowed  !! "", a range ("> 0", ">= 0", "1 to 10"), or words ("A, B")
      character(len=6) :: unit
      character(len=100) :: meaning
      logical :: of_scene = .false.  !! affects the contents of a scene file
      character(len=12) :: file = ""  !! kind of its file: raster, layer, raster layer (either), points, table, sets
   end type key_t

   logical, parameter :: in_scene = .true.  !! readable value for rows of the table

   character(len=*), parameter :: map_names(*) = map_fields
   integer, parameter :: n_maps = size(map_names)
   integer, parameter :: maps_offered = 5             !! number of names suggested for an unknown map

   integer, parameter :: max_thresholds = 8, max_periods = 8  !! maximum numbers of limits between classes
   character(len=*), parameter :: hazard_classes = "residual, low, moderate, high"  !! classes in increasing order
   !> Below 30 kJ, 30 to 300 kJ, above 300 kJ, each up to 30, 100 and 300 years (source: docs/hazard.md).
   character(len=*), parameter :: swiss_matrix = "'moderate', 2*'low', 'high', 2*'moderate', 3*'high'"

   character(len=*), parameter :: strength_range = "1000 to 1e9", relief_range = "0 to 45"  !! for grounds that yield

   !> Groups that a case may repeat.
   character(len=*), parameter :: repeatable(*) = [character(len=8) :: "line", "barrier", "dam", "scenario", "variant"]
   !> Lists that may be a single number: `1,5` alone is refused, because its comma may be decimal.
   character(len=*), parameter :: may_be_one(*) = [character(len=16) :: "volumes", "boulder_volumes", &
                                                   "frequency_factor"]
   integer, parameter :: max_names = 1000  !! maximum number of barriers or dams named by a variant

   type(key_t), parameter :: site_keys(*) = [ &
      key_t("case", "title", "text", 1, "''", "", "", "title of the result"), &
      key_t("case", "question", "text", 1, "''", "", "", "question of the client, on page 1 of a dossier"), &
      key_t("case", "seed", "integer", 1, "1", ">= 0", "", "random seed"), &
      key_t("case", "boulders", "integer", 1, "absent", "1 to 1e15", "", "boulders from each source"), &
      key_t("case", "boulders_total", "integer", 1, "absent", "1 to 2147483647", "", &
            "instead of boulders: total over all sources, distributed evenly or by their weights"), &
      key_t("case", "threads", "integer", 1, "0", "0 to 1024", "", "number of threads; 0: all cores"), &
      key_t("terrain", "dem", "text", 1, "required", "", "", &
            "elevation raster, square cells in metres", in_scene, "raster"), &
      key_t("surface", "zones", "text", 1, "absent", "", "", &
            "raster of zone ids, or polygons", in_scene, "raster layer"), &
      key_t("surface", "table", "text", 1, "absent", "", "", &
            "CSV with zone, mean_radius, rg70, rg20, rg10, ground; absent: the polygons have these attributes", &
            in_scene, "table"), &
      key_t("surface", "zone_field", "text", 1, "'zone'", "", "", &
            "attribute with the zone id of polygons", in_scene), &
      key_t("surface", "zones_layer", "text", 1, "absent", "", "", &
            "layer name, if the GeoPackage has several", in_scene), &
      key_t("surface", "default_zone", "integer", 1, "absent", "-2147483647 to 2147483647", "", &
            "zone of cells outside all zones", in_scene), &
      key_t("surface", "mean_radius", "text", 1, "absent", "", "", &
            "raster of mean rock radii [m]", in_scene, "raster"), &
      key_t("surface", "rg70", "text", 1, "absent", "", "", &
            "raster of obstacle sizes at 70 % of rebounds [m]", in_scene, "raster"), &
      key_t("surface", "rg20", "text", 1, "absent", "", "", &
            "raster of obstacle sizes at 20 % of rebounds [m]", in_scene, "raster"), &
      key_t("surface", "rg10", "text", 1, "absent", "", "", &
            "raster of obstacle sizes at 10 % of rebounds [m]", in_scene, "raster"), &
      key_t("surface", "uniform_mean_radius", "real", 1, "absent", ">= 0", "m", &
            "uniform mean rock radius", in_scene), &
      key_t("surface", "uniform_rg", "real", 3, "absent", ">= 0", "m", "uniform Rg70, Rg20, Rg10", in_scene), &
      key_t("surface", "method", "text", 1, "'B'", "A, B", "", &
            "A: three obstacle sizes, B: one mean radius", in_scene), &
      key_t("surface", "rg_reading", "text", 1, "'diameter'", "diameter, radius", "", "meaning of Rg"), &
      key_t("surface", "ground", "text", 1, "absent", "", "", &
            "default ground: a row of the table of grounds, an impact table, or impact sets", &
            in_scene), &
      key_t("surface", "ground_strength", "real", 1, "absent", strength_range, "Pa", &
            "replaces the strength of the default ground", in_scene), &
      key_t("surface", "ground_relief", "real", 1, "absent", relief_range, "degree", &
            "replaces the relief of the default ground", in_scene), &
      key_t("surface", "ground_map", "text", 1, "absent", "", "", "raster of ground ids", in_scene, "raster"), &
      key_t("surface", "ground_table", "text", 1, "absent", "", "", &
            "CSV that replaces the shipped table of grounds", in_scene, "table"), &
      key_t("impact", "form", "text", 1, "'matrix'", "matrix, table", "", &
            "rebound operator: matrix of the paper, or impact table; default: table if only a table is given", &
            in_scene), &
      key_t("impact", "table", "text", 1, "'talus'", "", "", &
            "shipped impact table, or a file .nc", in_scene, "impact_table"), &
      key_t("impact", "sets", "text", 1, "'vaujany-observed'", "", "", &
            "shipped impact set, or a file", in_scene, "sets"), &
      key_t("impact", "turning", "text", 1, "'past_aspect'", "past_aspect, to_aspect, lab", "", &
            "random turn past the aspect of the cell, at most to it, or as in the laboratory: impact_sets.md"), &
      key_t("impact", "ratio", "text", 1, "'between'", "nearest, between", "", &
            "set for R_b/R_m: the nearest, or one of the two neighbours at random, the nearer more often"), &
      key_t("impact", "stop_speed", "real", 1, "0.5", "> 0", "m/s", &
            "a slower boulder rests after a rebound, or rolls on where the ground is steeper than rest_angle"), &
      key_t("impact", "rest_angle", "real", 1, "absent", "0 to 90", "degree", &
            "steepest slope, over a radius, on which boulders rest; 90: any; absent: as given by each ground"), &
      key_t("impact", "impact_limit", "integer", 1, "100000", "1 to 2147483647", "", "maximum number of contacts"), &
      key_t("boulder", "volume", "text", 1, "'fixed'", "fixed, normal, uniform, lognormal, pareto, list, source", &
            "", "distribution; source: from rasters or layer attributes at each source"), &
      key_t("boulder", "volume_mean", "real", 1, "absent", "> 0", "m3", "mean: fixed, normal, lognormal"), &
      key_t("boulder", "volume_std", "real", 1, "absent", ">= 0", "m3", &
            "standard deviation: normal (truncated at 0), lognormal"), &
      key_t("boulder", "volume_min", "real", 1, "absent", "> 0", "m3", "minimum: uniform, pareto"), &
      key_t("boulder", "volume_max", "real", 1, "absent", "> 0", "m3", "maximum: uniform, pareto"), &
      key_t("boulder", "volume_exponent", "real", 1, "absent", "0.05 to 10", "", &
            "pareto: the number of larger boulders decreases as V**-volume_exponent; 0.4 to 0.7 is usual"), &
      key_t("boulder", "volumes", "real", many, "absent", "> 0", "m3", "list: volumes of equal probability"), &
      key_t("boulder", "density", "real", 1, "2800.0", "> 0", "kg/m3", "density of the boulders"), &
      key_t("boulder", "block_axes", "real", many, "absent", "> 0", "m", &
            "list: axes a, b, c of each volume, longest first; they give the block shapes", in_scene), &
      key_t("boulder", "block_shape", "text", many, "'compact'", "compact, elongated, platy, source", "", &
            "selects impact tables; several: drawn per boulder; source: from d1, d2, d3 or a layer", &
            in_scene), &
      key_t("boulder", "block_shape_share", "real", many, "absent", "0 to 1", "", &
            "fraction of each shape in block_shape, sum 1; absent: equal fractions", in_scene), &
      key_t("boulder", "ground_strength_sigma", "real", 1, "absent", "0 to 1.5", "", &
            "standard deviation of log strength between boulders; absent: as given by each ground"), &
      key_t("boulder", "mean_radius_sigma", "real", 1, "0.0", "0 to 1.5", "", &
            "standard deviation of log R_m between boulders, for impact sets; stronger ground: smaller R_m"), &
      key_t("boulder", "d1", "text", 1, "absent", "", "", &
            "source: raster of the first side of boulders [m]", in_scene, "raster"), &
      key_t("boulder", "d2", "text", 1, "absent", "", "", "raster of the second side [m]", in_scene, "raster"), &
      key_t("boulder", "d3", "text", 1, "absent", "", "", "raster of the third side [m]", in_scene, "raster"), &
      key_t("boulder", "shape", "text", 1, "absent", "", "", &
            "raster: 0 none, 1 rectangular, 2 ellipsoid, 3 sphere, 4 disc; absent: spheres", in_scene, "raster"), &
      key_t("boulder", "rock_density", "text", 1, "absent", "", "", &
            "raster that replaces density [kg/m3]", in_scene, "raster"), &
      key_t("boulder", "volume_spread", "real", 1, "absent", "0 to 0.9", "", &
            "source: volumes differ from that of their source by up to this fraction, uniformly"), &
      key_t("release", "x", "real", many, "absent", "", "m", "release points", in_scene), &
      key_t("release", "y", "real", many, "absent", "", "m", "release points", in_scene), &
      key_t("release", "points", "text", 1, "absent", "", "", &
            "layer of points, or CSV with x, y; their attributes: releases.md", in_scene, "points"), &
      key_t("release", "points_layer", "text", 1, "absent", "", "", &
            "layer name, if the GeoPackage has several", in_scene), &
      key_t("release", "cells", "text", 1, "absent", "", "", &
            "raster: cells above zero are sources", in_scene, "raster"), &
      key_t("release", "polygons", "text", 1, "absent", "", "", &
            "polygons: cells inside are sources; their attributes: releases.md", in_scene, "layer"), &
      key_t("release", "polygons_layer", "text", 1, "absent", "", "", &
            "layer name, if the GeoPackage has several", in_scene), &
      key_t("release", "name_field", "text", 1, "absent", "", "", &
            "attribute with the name of points or polygons; absent: name", in_scene), &
      key_t("release", "steep_cells", "logical", 1, ".false.", "", "", &
            "cells steeper than slope_threshold are sources; if given, only within cells or polygons", in_scene), &
      key_t("release", "slope_threshold", "real", 1, "absent", "1 to 89", "degree", &
            "limit of steep_cells; absent: 55 RES**-0.075 for cells of RES m (Dorren 2016)", in_scene), &
      key_t("release", "by_area", "logical", 1, ".false.", "", "", &
            "boulders in proportion to the surface area of cells; &case boulders is for a flat cell", in_scene), &
      key_t("release", "sources", "text", 1, "'all'", "all, sample", "", &
            "for confidence intervals: the sources are complete (all), or a sample of similar sources"), &
      key_t("release", "drop_height", "real", 1, "0.0", ">= 0", "m", "height of release above the surface"), &
      key_t("release", "velocity", "real", 3, "3*0.0", "", "m/s", "velocity of release: east, north, up"), &
      key_t("breakage", "at", "text", 1, "'none'", "none, release, impact, both", "", &
            "when boulders break into fragments: breakage.md"), &
      key_t("breakage", "min_area_ratio", "real", 1, "0.7", "0.25 to 0.99", "", &
            "boulders break if new surface / (new + own surface) is larger; published: 0.25 to 0.7"), &
      key_t("breakage", "release_fall", "real", 1, "absent", "0.01 to 1000", "m", &
            "free fall whose energy breaks the block at its release, for at = 'release'"), &
      key_t("breakage", "min_volume", "real", 1, "0.001", "1e-6 to 1000", "m3", &
            "minimum volume of a fragment; smaller pieces are counted in fines_volume, not traced"), &
      key_t("breakage", "max_fragments", "integer", 1, "100", "2 to 10000", "", &
            "maximum number of fragments of a boulder; the remainder stays one block, and is reported"), &
      key_t("breakage", "cone", "real", 1, "50.0", "0 to 90", "degree", &
            "full opening angle of the cone of directions about the velocity of the boulder"), &
      key_t("forest", "trees", "text", 1, "absent", "", "", &
            "CSV with x, y, dbh [cm], species; or a layer of points", in_scene, "points"), &
      key_t("forest", "trees_layer", "text", 1, "absent", "", "", &
            "layer name, if the GeoPackage has several", in_scene), &
      key_t("forest", "dbh_field", "text", 1, "'dbh'", "", "", "attribute with the diameter of trees [cm]", &
            in_scene), &
      key_t("forest", "species_field", "text", 1, "'species'", "", "", "attribute with the species of trees", &
            in_scene), &
      key_t("forest", "polygons", "text", 1, "absent", "", "", &
            "layer of stands; attributes stems, dbh_mean, dbh_std, conifers or species: forest.md", in_scene, &
            "layer"), &
      key_t("forest", "polygons_layer", "text", 1, "absent", "", "", &
            "layer name, if the GeoPackage has several", in_scene), &
      key_t("forest", "stems", "text", 1, "absent", "", "", &
            "raster of stems per hectare, for random trees", in_scene, "raster"), &
      key_t("forest", "uniform_stems", "real", 1, "absent", "> 0", "1/ha", "uniform stems per hectare", in_scene), &
      key_t("forest", "dbh_mean", "text", 1, "absent", "", "", &
            "raster of mean diameters at breast height [cm]", in_scene, "raster"), &
      key_t("forest", "uniform_dbh_mean", "real", 1, "absent", "> 0", "cm", &
            "uniform mean diameter", in_scene), &
      key_t("forest", "dbh_std", "text", 1, "absent", "", "", &
            "raster of standard deviations of diameters [cm]", in_scene, "raster"), &
      key_t("forest", "uniform_dbh_std", "real", 1, "absent", ">= 0", "cm", &
            "uniform standard deviation of diameters", in_scene), &
      key_t("forest", "conifers", "text", 1, "absent", "", "", &
            "raster of the percentage of conifers among stems", in_scene, "raster"), &
      key_t("forest", "uniform_conifers", "real", 1, "absent", "0 to 100", "%", &
            "uniform percentage of conifers", in_scene), &
      key_t("forest", "spread", "text", 1, "'random'", "random, even", "", &
            "random: stems anywhere; even: number of stems in each cell as in the raster", in_scene), &
      key_t("forest", "seed", "integer", 1, "1", ">= 0", "", "seed of random trees", in_scene), &
      key_t("forest", "clear_of_sources", "real", 1, "0.0", "0 to 1000", "m", &
            "no stems within this distance of a source, in plan", in_scene), &
      key_t("forest", "density_factor", "real", 1, "1.0", "0.001 to 1", "", &
            "fraction of stems that remain, the same stems in every variant", in_scene), &
      key_t("forest", "clearings", "text", 1, "absent", "", "", &
            "polygons without stems, or with their attribute density_factor: after felling or storm", in_scene, &
            "layer"), &
      key_t("forest", "clearings_layer", "text", 1, "absent", "", "", &
            "layer name, if the GeoPackage has several", in_scene), &
      key_t("forest", "species_table", "text", 1, "absent", "", "", &
            "CSV with species, genus, factor; absent: the shipped table", in_scene, "table"), &
      key_t("forest", "stem_height", "real", 1, "absent", "> 0", "m", &
            "higher boulders pass over; absent: no boulder passes over"), &
      key_t("forest", "lateral_from", "real", 1, "0.58", "0 to 1", "", &
            "hit position on the stem from which a hit is lateral"), &
      key_t("forest", "scratch_from", "real", 1, "0.75", "0 to 1", "", &
            "hit position on the stem from which a hit is a scratch"), &
      key_t("forest", "turn_frontal", "real", 3, "22.5, 45.0, 8.5", ">= 0", "", &
            "weights of turns by 0-22.5, 22.5-67.5, 67.5-76 degrees at a frontal hit"), &
      key_t("forest", "turn_lateral", "real", 3, "22.5, 45.0, 8.5", ">= 0", "", "weights of turns at a lateral hit"), &
      key_t("forest", "turn_scratch", "real", 3, "22.5, 45.0, 8.5", ">= 0", "", "weights of turns at a scratch")]

   type(key_t), parameter :: run_keys(*) = [ &
      key_t("flight", "gravity", "real", 1, "9.81", "> 0", "m/s2", "acceleration of gravity"), &
      key_t("line", "name", "text", 1, "absent", "", "", "name of an evaluation line"), &
      key_t("line", "x", "real", many, "absent", "", "m", "two or more vertices"), &
      key_t("line", "y", "real", many, "absent", "", "m", "two or more vertices"), &
      key_t("line", "file", "text", 1, "absent", "", "", "instead of x and y: one or more lines", file="layer"), &
      key_t("line", "layer", "text", 1, "absent", "", "", "layer name, if the GeoPackage has several"), &
      key_t("line", "field", "text", 1, "absent", "", "", "attribute with the name; absent: name"), &
      key_t("line", "object_width", "real", 1, "absent", "0 to 100", "m", &
            "makes the line an object, hit when any part of a boulder touches it"), &
      key_t("barrier", "name", "text", 1, "absent", "", "", &
            "name of a net or wall, which is also an evaluation line"), &
      key_t("barrier", "x", "real", many, "absent", "", "m", "two or more vertices"), &
      key_t("barrier", "y", "real", many, "absent", "", "m", "two or more vertices"), &
      key_t("barrier", "height", "real", 1, "absent", "0.001 to 100", "m", &
            "vertical height of the top edge; a boulder passes over if its centre is higher"), &
      key_t("barrier", "capacity", "real", 1, "absent", "1e-6 to 100000", "kJ", &
            "maximum kinetic energy that it absorbs"), &
      key_t("barrier", "class", "integer", 1, "absent", "0 to 7", "", &
            "instead of capacity: class of EAD 340059, by its maximum energy level"), &
      key_t("barrier", "diameter", "real", 1, "absent", "5 to 200", "cm", &
            "instead of capacity: diameter of a lying log, also its height unless height is given"), &
      key_t("barrier", "decay_class", "integer", 1, "absent", "1 to 4", "", &
            "decay of a log: 1 fresh, 2 dead and hard, 3 rotten, 4 soft; omit softer logs; absent: 1"), &
      key_t("barrier", "file", "text", 1, "absent", "", "", &
            "instead of x and y: lines, whose attributes give values missing in the group", file="layer"), &
      key_t("barrier", "layer", "text", 1, "absent", "", "", "layer name, if the GeoPackage has several"), &
      key_t("barrier", "field", "text", 1, "absent", "", "", "attribute with the name; absent: name"), &
      key_t("dam", "name", "text", 1, "absent", "", "", "name, for variants"), &
      key_t("dam", "x", "real", many, "absent", "", "m", "two or more vertices of the crest", in_scene), &
      key_t("dam", "y", "real", many, "absent", "", "m", "two or more vertices of the crest", in_scene), &
      key_t("dam", "height", "real", 1, "absent", "0.001 to 100", "m", &
            "height of the crest above the terrain below it", &
            in_scene), &
      key_t("dam", "crest_width", "real", 1, "0.0", "0 to 100", "m", "width of its flat top", in_scene), &
      key_t("dam", "slope", "real", 1, "45.0", "5 to 89", "degree", "slope of its faces", in_scene), &
      key_t("dam", "allow_coarse", "logical", 1, ".false.", "", "", &
            "accept a dam face narrower than two cells of the raster", in_scene), &
      key_t("dam", "file", "text", 1, "absent", "", "", &
            "instead of x and y: lines, whose attributes give values missing in the group", in_scene, "layer"), &
      key_t("dam", "layer", "text", 1, "absent", "", "", "layer name, if the GeoPackage has several", in_scene), &
      key_t("output", "maps", "text", n_maps, "absent", "as in result.md", "", "maps in the result"), &
      key_t("output", "map_extent", "text", 1, "'reach'", "reach, terrain", "", &
            "reach: cells that boulders can reach; terrain: all cells"), &
      key_t("output", "min_passages", "integer", 1, "1", "1 to 2147483647", "", &
            "cells with fewer passages have no mean and no quantile"), &
      key_t("output", "rebounds", "logical", 1, ".false.", "", "", "histograms over all rebounds"), &
      key_t("output", "energy_balance", "logical", 1, ".false.", "", "", &
            "energy that each boulder loses to ground, trees and barriers, and its remaining energy"), &
      key_t("output", "trajectories", "integer", 1, "0", "0 to 2147483647", "", &
            "number of recorded boulders, the first of each source in proportion to its boulders"), &
      key_t("output", "kept", "count", 1, "'all'", "all, none, 1 to 2147483647", "", &
            "number of boulders with a row each; unless 'all', line statistics use sums and counts"), &
      key_t("ensemble", "runs", "integer", 1, "64", "8 to 65536", "", "number of draws of the uncertain inputs"), &
      key_t("ensemble", "radius_factor", "real", 1, "1.0", "1 to 10", "", &
            "geometric standard deviation of R_m or Rg, zone by zone"), &
      key_t("ensemble", "volume_factor", "real", 1, "1.0", "1 to 10", "", &
            "geometric standard deviation of all volumes together"), &
      key_t("ensemble", "volume_std_factor", "real", 1, "1.0", "1 to 10", "", &
            "geometric standard deviation of volume_std"), &
      key_t("ensemble", "drop_height_factor", "real", 1, "1.0", "1 to 10", "", &
            "geometric standard deviation of drop_height"), &
      key_t("ensemble", "strength_factor", "real", 1, "1.0", "1 to 10", "", &
            "geometric standard deviation of strength, ground by ground"), &
      key_t("ensemble", "relief_factor", "real", 1, "1.0", "1 to 10", "", &
            "geometric standard deviation of relief, ground by ground"), &
      key_t("ensemble", "dem_error", "real", 1, "0.0", "0 to 20", "m", "standard deviation of elevations"), &
      key_t("ensemble", "dem_correlation", "real", 1, "absent", "> 0", "m", &
            "distance at which the correlation of elevation errors is 1/e"), &
      key_t("ensemble", "source_shift", "real", 1, "0.0", ">= 0", "m", &
            "standard deviation of a common shift of all sources, east and north"), &
      key_t("ensemble", "sets", "text", 100, "absent", "", "", &
            "impact sets of equal probability, or impact tables and their ensembles, to replace tables", &
            file="sets"), &
      key_t("ensemble", "draws", "text", 1, "absent", "", "", &
            "CSV of draws from `rockfall back`, which replace the inputs in its columns", file="table"), &
      key_t("observed", "files", "text", 100, "absent", "", "", &
            "CSV or layers of observations at the site: blocks, scars, speeds (docs/observed.md)", &
            file="any layer"), &
      key_t("observed", "energy_line_angle", "real", 1, "absent", "5 to 85", "degree", &
            "lowest angle from release to rest of any boulder at the site or in the region"), &
      key_t("observed", "shadow_angle", "real", 1, "absent", "5 to 85", "degree", &
            "lowest angle from the apex of the talus to any boulder at rest at the site or in the region"), &
      key_t("scenario", "name", "text", 1, "required", "", "", "name of a class of boulders with its frequency"), &
      key_t("scenario", "frequency", "real", 1, "absent", "> 0", "1/year", "boulders released per year"), &
      key_t("scenario", "return_period", "real", 1, "absent", "> 0", "year", "instead of frequency: its inverse"), &
      key_t("scenario", "activity", "real", 1, "absent", "> 0", "", &
            "instead of frequency, pareto: boulders per year above V [m3] = activity V**-volume_exponent"), &
      key_t("scenario", "frequency_per", "text", 1, "'year'", "year, source, km2, m", "", &
            "year: all sources together; source: each; km2: area of source cells; m: cliff_length"), &
      key_t("scenario", "cliff_length", "real", 1, "absent", "> 0", "m", &
            "length of all cliffs, for frequency_per = 'm'"), &
      key_t("scenario", "volume", "text", 1, "absent", "fixed, normal, uniform, lognormal, pareto, list", "", &
            "distribution; with its keys it replaces all volume keys of &boulder"), &
      key_t("scenario", "volume_mean", "real", 1, "absent", "> 0", "m3", "replaces the key of &boulder"), &
      key_t("scenario", "volume_std", "real", 1, "absent", ">= 0", "m3", "replaces the key of &boulder"), &
      key_t("scenario", "volume_min", "real", 1, "absent", "> 0", "m3", "replaces the key of &boulder"), &
      key_t("scenario", "volume_max", "real", 1, "absent", "> 0", "m3", "replaces the key of &boulder"), &
      key_t("scenario", "volume_exponent", "real", 1, "absent", "0.05 to 10", "", "replaces the key of &boulder"), &
      key_t("scenario", "volumes", "real", many, "absent", "> 0", "m3", "replaces the key of &boulder"), &
      key_t("scenario", "density", "real", 1, "absent", "> 0", "kg/m3", "replaces the key of &boulder"), &
      key_t("hazard", "thresholds", "real", max_thresholds, "30.0, 300.0", "0 to 100000", "kJ", &
            "increasing energies: limits of intensity classes, thresholds of the maps ..._exceeded"), &
      key_t("hazard", "return_periods", "real", max_periods, "30.0, 100.0, 300.0", "0.1 to 1e6", "year", &
            "increasing limits of the frequency classes"), &
      key_t("hazard", "matrix", "text", (max_thresholds + 1)*max_periods, swiss_matrix, &
            hazard_classes, "", &
            "hazard by intensity class, weakest first, and within it by return period, shortest first"), &
      key_t("hazard", "frequency_factor", "real", 2, "1.0, 1.0", "0 to 1000", "", &
            "uncertainty of all frequencies: lowest and highest factor, for the limits of results"), &
      key_t("hazard", "object_width", "real", 1, "10.0", "0 to 100", "m", &
            "width of an object in the middle of each cell, for maps of hits; 0: a point"), &
      key_t("hazard", "minimum_area", "real", 1, "0.0", ">= 0", "m2", &
            "minimum area of a zone; smaller zones take the class of the largest neighbour"), &
      key_t("hazard", "minimum_width", "real", 1, "10.0", "0 to 1000", "m", &
            "minimum width of a zone; narrower parts are widened or upgraded; 0: zones follow cells"), &
      key_t("variant", "name", "text", 1, "required", "", "", "name of the variant and of its result file"), &
      key_t("variant", "without", "text", 7, "absent", "barrier, dam, forest, surface, impact, boulder, release", "", &
            "groups of the case to omit"), &
      key_t("variant", "barriers", "text", max_names, "absent", "", "", &
            "names to include (of a layer: its name or file); absent: all"), &
      key_t("variant", "dams", "text", max_names, "absent", "", "", &
            "names to include (of a layer: its name or file); absent: all"), &
      key_t("variant", "cost", "real", 1, "absent", ">= 0", "", "cost in any unit, for the report")]

   type(key_t), parameter :: own_keys(*) = [site_keys, run_keys]

   !> Keys of the consecutive groups &terrain to &forest: a variant gives them as GROUP_KEY.
   integer, parameter :: first_varied = findloc(own_keys%group, "terrain", dim=1)
   integer, parameter :: last_varied = findloc(own_keys%group, "forest", dim=1, back=.true.)
   integer :: row  !! index of the implied loop below; never has a value
   type(key_t), parameter :: varied_keys(*) = [ &
      (key_t("variant", trim(own_keys(row)%group)//"_"//own_keys(row)%name, own_keys(row)%kind, own_keys(row)%most, &
             "absent", own_keys(row)%allowed, own_keys(row)%unit, "replaces the key of &"//own_keys(row)%group, &
             .false., own_keys(row)%file), row=first_varied, last_varied)]
   type(key_t), parameter :: key_table(*) = [own_keys, varied_keys]
   integer, parameter :: n_keys = size(key_table)

contains

   !> Read all groups and keys of a case as text, with defaults for absent ones, and check them against the table.
   pure subroutine read_keys(text, file, list, error)
      character(len=*), intent(in) :: text
      character(len=*), intent(in) :: file  !! file name, for messages
      type(namelist_t), intent(out) :: list
      type(error_t), allocatable, intent(out) :: error

      call parse_namelist(text, file, list, error)
      if (.not. allocated(error)) call complete_keys(list, file, error)
   end subroutine read_keys

   !> Add defaults for absent groups and keys, and check all against the table; the error lists all faults of names and
   !> values. A missing key is not reported together with an unknown key, which may be its misspelling.
   pure subroutine complete_keys(list, file, error)
      type(namelist_t), intent(inout) :: list
      character(len=*), intent(in) :: file  !! file name, for messages
      type(error_t), allocatable, intent(out) :: error

      type(error_t), allocatable :: fault
      logical :: all_known

      call check_removed(list, error)
      if (allocated(error)) return
      call check_names(list, key_table%group, key_table%name, repeatable, "this group must occur only once; only &" &
                       //joined(repeatable, ", &")//" may repeat", error)
      all_known = .not. allocated(error)
      call check_operator(list, fault)
      call gather(fault, error)
      call complete(list, file)
      call check_keys(list, all_known, error)
   end subroutine complete_keys

   !> Refuse keys of earlier versions; the message contains the replacement.
   pure subroutine check_removed(list, error)
      type(namelist_t), intent(in) :: list
      type(error_t), allocatable, intent(out) :: error
      integer :: g

      do g = 1, size(list%group)
         if (list%group(g)%name == "case" .and. has_key(list%group(g), "sampling")) &
            call refuse(list%group(g), "sampling", "was removed: omit it, boulders are always drawn at random", error)
      end do
   end subroutine check_removed

   !> Format a key as text: group|key|kind|most|default|allowed|unit|meaning|file.
   pure function row_text(key) result(text)
      type(key_t), intent(in) :: key
      character(len=:), allocatable :: text

      text = trim(key%group)//"|"//trim(key%name)//"|"//trim(key%kind)//"|"//integer_text(key%most)//"|" &
             //trim(key%default)//"|"//trim(key%allowed)//"|"//trim(key%unit)//"|"//trim(key%meaning) &
             //"|"//trim(key%file)
   end function row_text

   !> Refuse a case that names impact sets and an impact table but lacks `form`, which chooses between them.
   pure subroutine check_operator(list, error)
      type(namelist_t), intent(in) :: list
      type(error_t), allocatable, intent(out) :: error

      if (is_given(list, "impact", "form")) return
      if (is_given(list, "impact", "sets") .and. is_given(list, "impact", "table")) &
         call fail(error, list%group(findloc(list%group%name, "impact", dim=1))%file &
                   //": &impact sets, table: give only one, or choose with form = 'matrix' or 'table'")
   end subroutine check_operator

   pure logical function is_given(list, group, key)
      type(namelist_t), intent(in) :: list
      character(len=*), intent(in) :: group, key
      integer :: g

      is_given = .false.
      do g = 1, size(list%group)
         if (list%group(g)%name == group) is_given = is_given .or. has_key(list%group(g), key)
      end do
   end function is_given

   !> Get every group of a case once, with the defaults of its keys.
   pure subroutine default_keys(list)
      type(namelist_t), intent(out) :: list
      type(error_t), allocatable :: error

      call parse_namelist("&"//joined(repeatable, " / &")//" /", "", list, error)
      call complete(list, "")
   end subroutine default_keys

   !> Add absent groups and the defaults of absent keys, except keys that a named layer may provide.
   pure subroutine complete(list, file)
      type(namelist_t), intent(inout) :: list
      character(len=*), intent(in) :: file
      type(namelist_t) :: defaults
      type(error_t), allocatable :: error
      integer :: d, e, g

      call parse_namelist(default_case(list), file, defaults, error)
      do d = 1, size(defaults%group)
         defaults%group(d)%entry%given = .false.
         associate (default => defaults%group(d))
            if (.not. any([repeatable == default%name, list%group%name == default%name])) then
               list%group = [list%group, default]
               cycle
            end if
            do g = 1, size(list%group)
               if (list%group(g)%name /= default%name .or. has_key(list%group(g), "file")) cycle
               do e = 1, size(default%entry)
                  if (has_key(list%group(g), trim(default%entry(e)%key))) cycle
                  list%group(g)%entry = [list%group(g)%entry, default%entry(e)]
               end do
            end do
         end associate
      end do
   end subroutine complete

   !> Format the defaults of a case as text. They are from the table, except that an impact table implies its rebounds.
   pure function default_case(list) result(text)
      type(namelist_t), intent(in) :: list
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
         if (key%group == "impact" .and. key%name == "form" .and. is_given(list, "impact", "table")) &
            key%default = "'table'"
         if (key%default == "required" .or. key%default == "absent") cycle
         text = text//" "//trim(key%name)//" = "//trim(key%default)
      end do
      text = text//" /"
   end function default_case

   !> Check the kind, number and range of every value against the table.
   pure subroutine check_keys(list, all_known, error)
      type(namelist_t), intent(in) :: list
      logical, intent(in) :: all_known  !! all keys are known
      type(error_t), allocatable, intent(inout) :: error
      type(error_t), allocatable :: fault
      integer :: g, k

      do g = 1, size(list%group)
         do k = 1, n_keys
            if (key_table(k)%group /= list%group(g)%name) cycle
            if (.not. (all_known .or. has_key(list%group(g), trim(key_table(k)%name)))) cycle
            call check_key(list%group(g), key_table(k), fault)
            call gather(fault, error)
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
         if (key%default == "required") call fail(error, key_location(group, name)//" is missing: " &
                                                  //trim(key%kind)//", "//trim(key%meaning))
      else if (n > key%most .or. (key%most == 3 .and. n < 3)) then
         if (key%most == 1) call refuse_list(group, name, "must be one value", error)
         if (key%most == 3) call refuse_list(group, name, "must be three values", error)
         if (all(key%most /= [1, 3])) call refuse_list(group, name, "must have at most "//integer_text(key%most)// &
                                                       " values", error)
      else
         select case (key%kind)
         case ("text"); call check_texts(group, key, error)
         case ("integer"); call check_integers(group, key, error)
         case ("real"); call check_reals(group, key, error)
         case ("count"); call check_count(group, key, error)
         case default; call get_logical(group, name, switch, error)
         end select
      end if
   end subroutine check_key

   pure subroutine check_texts(group, key, error)
      type(group_t), intent(in) :: group
      type(key_t), intent(in) :: key
      type(error_t), allocatable, intent(out) :: error
      character(len=text_length), allocatable :: values(:)
      character(len=:), allocatable :: words, must
      integer :: k

      words = trim(key%allowed)
      if (key%name == "maps") words = joined(map_names, ", ")
      allocate (values(0))
      call get_text(group, trim(key%name), values, error)
      if (allocated(error)) then
         if (key%name == "block_shape") error%message = error%message//", give fractions in block_shape_share"
         return
      end if
      do k = 1, size(values)
         if (len_trim(values(k)) == 0 .and. key%name /= "title" .and. key%name /= "question") then
            call refuse(group, trim(key%name), "must not be empty", error, k)
         else if (words /= "" .and. index(", "//words//",", ", "//trim(values(k))//",") == 0) then
            must = "must be one of: "//words
            if (key%name == "maps") &
               must = "must be a map such as "//joined(nearest_names(values(k), map_names, maps_offered), ", ") &
                      //" (all maps: docs/result.md, Maps)"
            call refuse(group, trim(key%name), must, error, k)
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

   !> Check a value that must be one of several words, or an integer in a range.
   pure subroutine check_count(group, key, error)
      type(group_t), intent(in) :: group
      type(key_t), intent(in) :: key
      type(error_t), allocatable, intent(out) :: error
      character(len=text_length), allocatable :: words(:)
      type(key_t) :: number
      type(error_t), allocatable :: other
      integer :: cut

      cut = index(key%allowed, ", ", back=.true.)
      number = key
      number%allowed = key%allowed(cut + 2:)
      allocate (words(0))
      call get_text(group, trim(key%name), words, error)
      if (.not. allocated(error)) then
         if (index(", "//key%allowed(:cut), ", "//trim(words(1))//",") > 0) return
      else
         deallocate (error)
         call check_integers(group, number, other)
         if (.not. allocated(other)) return
      end if
      call refuse(group, trim(key%name), "must be one of: "//trim(key%allowed), error)
   end subroutine check_count

   pure subroutine check_reals(group, key, error)
      type(group_t), intent(in) :: group
      type(key_t), intent(in) :: key
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: values(:)
      character(len=:), allocatable :: rule
      integer :: k

      call get_real(group, trim(key%name), values, error)
      if (allocated(error)) return
      if (size(values) == 2 .and. any(key%name == may_be_one) .and. has_comma(group, trim(key%name))) then
         call refuse_list(group, trim(key%name), "", error)
         return
      end if
      do k = 1, size(values)
         rule = broken_rule(key, values(k))
         if (rule /= "") call refuse(group, trim(key%name), rule, error, k)
         if (allocated(error)) return
      end do
   end subroutine check_reals

   !> Lowest and highest number of a key; NaN if only the general limit applies.
   pure function limits_of(key) result(limits)
      type(key_t), intent(in) :: key
      real(wp) :: limits(2)

      limits = ieee_value(limits, ieee_quiet_nan)
      if (key%kind == "real" .or. key%kind == "integer") limits = range_of(key%allowed, limits)
   end function limits_of

   !> Rule that a number violates, given its key; "" if none.
   pure function broken_rule(key, value) result(rule)
      type(key_t), intent(in) :: key
      real(wp), intent(in) :: value
      character(len=:), allocatable :: rule
      real(wp) :: range(2)
      logical :: positive

      rule = ""
      range = range_of(key%allowed, [-max_real, max_real])
      positive = key%allowed(:2) == "> "
      if (ieee_is_nan(value)) then
         rule = "must be a number"
      else if (value < range(1) .or. (positive .and. value <= range(1)) .or. &
               (value > range(2) .and. range(2) < max_real)) then
         rule = "must be "//trim(key%allowed)
      else if (abs(value) > max_real) then
         rule = "must be at most 1e12"
      else if (positive .and. value < min_positive) then
         rule = "must be at least 1e-12"
      else
         rule = other_unit(trim(key%unit), value)
         return
      end if
      if (rule /= "" .and. key%unit /= "") rule = rule//" ["//trim(key%unit)//"]"
   end function broken_rule

   !> Rule for a number that is probably in another unit; "" if not. Other implausible numbers are allowed, for tests.
   pure function other_unit(unit, value) result(rule)
      character(len=*), intent(in) :: unit
      real(wp), intent(in) :: value
      character(len=:), allocatable :: rule

      rule = ""
      if (unit == "kg/m3" .and. value >= 1 .and. value <= 4) rule = "must be in kg/m3: multiply t/m3 by 1000"
      if (unit == "m/s2" .and. value > 900 .and. value < 1000) rule = "must be in m/s2: divide cm/s2 by 100"
   end function other_unit

   !> Parse the ends of "a to b", "> a" or ">= a"; `outer` provides missing ends.
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

   !> Canonical text of the values of a key; "" if absent.
   pure function plain(group, key) result(text)
      type(group_t), intent(in) :: group
      type(key_t), intent(in) :: key
      character(len=:), allocatable :: text
      character(len=text_length), allocatable :: words(:)
      real(wp), allocatable :: numbers(:)
      integer(i8) :: whole
      logical :: switch
      type(error_t), allocatable :: error

      text = ""
      if (.not. has_key(group, trim(key%name))) return
      select case (key%kind)
      case ("text")
         call get_text(group, trim(key%name), words, error)
         text = joined(words, achar(10))
      case ("integer")
         call get_integer(group, trim(key%name), whole, error)
         text = integer_text(whole)
      case ("real")
         call get_real(group, trim(key%name), numbers, error)
         text = repeat(" ", 25*size(numbers))
         write (text, "(*(es25.16e3))") numbers + 0.0_wp  ! avoids negative zero
      case ("count")
         call get_text(group, trim(key%name), words, error)
         if (.not. allocated(error)) then
            text = joined(words, achar(10))
         else
            call get_integer(group, trim(key%name), whole, error)
            text = integer_text(whole)
         end if
      case default
         call get_logical(group, trim(key%name), switch, error)
         text = merge("yes", "no ", switch)
      end select
   end function plain
end module rockfall_case_keys
