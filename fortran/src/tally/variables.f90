! SPDX-License-Identifier: BSD-3-Clause
!> Table of all variables of a result, with units and descriptions, used by both programs.
module rockfall_variables
   use rockfall_kinds, only: i8
   use rockfall_dimensions, only: n_boulder_fields, n_boulder_counts, n_line_fields, n_vertex_fields
   implicit none
   private
   public :: variable_t, variable_table, variable_of, variable_text, stored_as, name_in_files
   public :: boulder_fields, boulder_counts, energy_fields, row_reals, row_integers, real_groups, integer_groups, &
             line_fields, crossing_fields, vertex_fields, map_fields, histogram_fields, statuses, &
             outcomes
   public :: scene_layout, part_layout, piece, max_packing

   ! Versions of scene and part files:
   integer(i8), parameter :: scene_layout = 3, part_layout = 6
   integer(i8), parameter :: piece = 2_i8**17    !! number of values per checksum
   integer(i8), parameter :: max_packing = 1100  !! maximum compression ratio of zlib

   !> Variable of a result.
   type :: variable_t
      !> boulder, count (over all boulders), ground (per ground type), energy (per boulder, on request), feature (per
      !> boulder, if sources come from a layer), shape (per boulder, if there are several shapes), mass (per boulder, if
      !> sources come from a layer or give densities), shadow (per boulder, if an angle was observed), tree (per
      !> boulder, if there are trees), breakage (per boulder, if boulders may break), crossing (first crossing of a
      !> line), fragment (with crossings, if boulders may break), hit (with crossings, if there are barriers), line
      !> (derived from a crossing, not in files), line_vertex, barrier, map, histogram, vertex (of a trajectory), tally
      !> (per cell, in part files), kept and sample (if not all rows are kept); or status, outcome and leg: values of
      !> the status of a boulder, of the outcome at a barrier, and of the motion from a vertex to the next.
      character(len=11) :: group
      character(len=27) :: name       !! in files with prefix crossing_, trajectory_, tally_ or suffix _histogram
      character(len=7) :: kind        !! real, integer, word
      character(len=7) :: units       !! CF notation; for a histogram, the unit of its bins
      character(len=80) :: long_name
      character(len=80) :: comment = ""
      character(len=2) :: stored = "" !! type in part files: i1, i4, f4; default f8, or i8 for integers
      character(len=24) :: axes = ""  !! dimensions of a sample, after sample_; the last varies fastest
   end type variable_t

   character(len=*), parameter :: ends = "the first and the last bin include all values beyond"
   character(len=*), parameter :: in_classes = "from counts in classes 14 to 25 % wide"
   character(len=*), parameter :: order_statistics = &
      "independent boulders, coverage 95 % or more for given sources, absent if too few"
   character(len=*), parameter :: lower = "lower limit of the 95 % interval of "
   character(len=*), parameter :: upper = "upper limit of the 95 % interval of "
   character(len=*), parameter :: by_cell = "jump height + R / cos(slope of the cell)"
   character(len=*), parameter :: to_middle = "below the horizontal, to the ground in the middle of the cell"
   character(len=*), parameter :: given_sources = &
      "Wilson (1927), independent boulders, coverage 95 % or more for given sources"

   character(len=*), parameter :: energies = " of the passing boulders' maximum energies"
   character(len=*), parameter :: speeds = " of the passing boulders' maximum speeds"
   character(len=*), parameter :: jump_heights = " of the passing boulders' maximum jump heights"
   character(len=*), parameter :: passing_heights = " of the passing boulders' maximum passing heights"
   character(len=3), parameter :: levels(*) = ["q50", "q90", "q95", "q98", "q99"]  !! quantiles available in maps
   character(len=13), parameter :: of_level(*) = [character(len=13) :: "median", "90 % quantile", "95 % quantile", &
                                                  "98 % quantile", "99 % quantile"]
   character(len=*), parameter :: at_crossing = " at the first crossing"

   integer :: k

   !> Within each group, reals and integers are in the order of rockfall_rows, histograms in that of rockfall_histogram,
   !> statuses by number, from 1.
   type(variable_t), parameter :: variable_table(*) = [ &
      variable_t("boulder", "volume", "real", "m3", "volume of the boulder"), &
      variable_t("boulder", "start_x", "real", "m", "easting of the release"), &
      variable_t("boulder", "start_y", "real", "m", "northing of the release"), &
      variable_t("boulder", "start_z", "real", "m", "elevation of the release"), &
      variable_t("boulder", "stop_x", "real", "m", "easting of the end"), &
      variable_t("boulder", "stop_y", "real", "m", "northing of the end"), &
      variable_t("boulder", "stop_z", "real", "m", "elevation of the end"), &
      variable_t("boulder", "path_length", "real", "m", "length of the trajectory"), &
      variable_t("boulder", "plan_distance", "real", "m", &
                 "plan distance from release to end, in a straight line"), &
      variable_t("boulder", "travel_time", "real", "s", "time from release to end"), &
      variable_t("boulder", "speed_max", "real", "m s-1", "maximum speed"), &
      variable_t("boulder", "jump_height_max", "real", "m", &
                 "maximum height of the boulder's lowest point above the surface"), &
      variable_t("boulder", "status", "integer", "1", "reason why the boulder ended", stored="i1"), &
      variable_t("boulder", "impacts", "integer", "1", "contacts with the slope", stored="i4"), &
      variable_t("boulder", "source", "integer", "1", "number of the source", "counts from 1", "i4"), &
      variable_t("count", "rebounds", "integer", "1", "rebounds of all boulders"), &
      variable_t("count", "rebounds_redrawn", "integer", "1", &
                 "rebounds whose matrix was drawn more than once"), &
      variable_t("count", "rebounds_forced", "integer", "1", &
                 "rebounds limited to be admissible; for a matrix after 32 draws"), &
      variable_t("count", "rebounds_out_of_range", "integer", "1", &
                 "rebounds with R_b/R_m outside 0.5 to 5.5, or outside their impact table"), &
      variable_t("count", "rebounds_out_of_speed", "integer", "1", &
                 "rebounds at speeds outside speed_range of the set, or above all in their table"), &
      variable_t("count", "rebounds_out_of_angle", "integer", "1", &
                 "rebounds at incidence angles outside the set's angle_range"), &
      variable_t("ground", "rebounds_by_ground", "integer", "1", "rebounds on the ground"), &
      variable_t("energy", "energy_released", "real", "J", &
                 "kinetic energy at the release plus potential energy from release to end"), &
      variable_t("energy", "energy_ground", "real", "J", "energy lost in rebounds"), &
      variable_t("energy", "energy_trees", "real", "J", "energy absorbed by trees"), &
      variable_t("energy", "energy_barriers", "real", "J", "energy absorbed by barriers"), &
      variable_t("energy", "energy_left", "real", "J", "kinetic energy at the end"), &
      variable_t("feature", "source_feature", "integer", "1", "number of the feature of the source", &
                 "counts from 1", "i4"), &
      variable_t("shape", "block_shape", "integer", "1", "shape of the block", stored="i4"), &
      variable_t("mass", "mass", "real", "kg", "mass of the boulder"), &
      variable_t("shadow", "shadow_angle", "real", "degree", "angle of the line from the talus apex to the end", &
                 "below the horizontal; 90: the end is not 20 m beyond the apex; missing: no apex found"), &
      variable_t("tree", "trees_hit", "integer", "1", "tree hits of the boulder", "each hit counts", "i4"), &
      variable_t("breakage", "fines_volume", "real", "m3", "volume of pieces below min_volume"), &
      variable_t("breakage", "energy_breakage", "real", "J", "energy lost in breaking, including fines"), &
      variable_t("breakage", "fragments", "integer", "1", "blocks into which the boulder broke", &
                 "1: it did not break", "i4"), &
      variable_t("breakage", "breakages", "integer", "1", &
                 "number of times that the boulder or one of its fragments broke", &
                 stored="i4"), &
      variable_t("breakage", "breakages_capped", "integer", "1", &
                 "number of times that max_fragments prevented further fragments", stored="i4"), &
      variable_t("line", "x", "real", "m", "easting of the first crossing"), &
      variable_t("line", "y", "real", "m", "northing of the first crossing"), &
      variable_t("line", "time", "real", "s", "time from release to the first crossing"), &
      variable_t("line", "speed", "real", "m s-1", "speed"//at_crossing), &
      variable_t("line", "velocity_x", "real", "m s-1", "eastward velocity"//at_crossing), &
      variable_t("line", "velocity_y", "real", "m s-1", "northward velocity"//at_crossing), &
      variable_t("line", "velocity_z", "real", "m s-1", "upward velocity"//at_crossing), &
      variable_t("line", "omega", "real", "rad s-1", &
                 "angular velocity at the first crossing, forward rolling > 0"), &
      variable_t("line", "jump_height", "real", "m", &
                 "height of the boulder's lowest point above the surface, 0 at a contact"), &
      variable_t("line", "passing_height", "real", "m", &
                 "height of the boulder's centre above the surface, vertical"), &
      variable_t("line", "energy_translational", "real", "J", "translational energy"//at_crossing), &
      variable_t("line", "energy_rotational", "real", "J", "rotational energy"//at_crossing), &
      variable_t("crossing", "boulder", "integer", "1", "number of the boulder"), &
      variable_t("crossing", "line", "integer", "1", "index of the line", "counts from 0", "i4"), &
      variable_t("crossing", "time", "real", "s", "time from release to the first crossing", stored="f4"), &
      variable_t("crossing", "distance", "real", "m", "distance along the line, from its first vertex", stored="f4"), &
      variable_t("crossing", "velocity_x", "real", "m s-1", "eastward velocity"//at_crossing, stored="f4"), &
      variable_t("crossing", "velocity_y", "real", "m s-1", "northward velocity"//at_crossing, stored="f4"), &
      variable_t("crossing", "velocity_z", "real", "m s-1", "upward velocity"//at_crossing, stored="f4"), &
      variable_t("crossing", "omega", "real", "rad s-1", &
                 "angular velocity at the first crossing, forward rolling > 0", stored="f4"), &
      variable_t("crossing", "jump_height", "real", "m", &
                 "height of the boulder's lowest point above the surface, 0 at a contact", stored="f4"), &
      variable_t("crossing", "passing_height", "real", "m", &
                 "height of the boulder's centre above the surface, vertical", stored="f4"), &
      variable_t("fragment", "volume", "real", "m3", "volume of the fragment of this crossing", &
                 "the fragment with the most energy; heights are maxima over all fragments", "f4"), &
      variable_t("fragment", "fragments", "integer", "1", "fragments that crossed", stored="i4"), &
      variable_t("line_vertex", "line", "integer", "1", &
                 "index of the evaluation line", "counts from 0"), &
      variable_t("line_vertex", "x", "real", "m", "easting"), &
      variable_t("line_vertex", "y", "real", "m", "northing"), &
      variable_t("barrier", "height", "real", "m", "height of the top edge above the ground"), &
      variable_t("barrier", "capacity", "real", "J", "maximum energy that the barrier absorbs"), &
      variable_t("hit", "outcome", "integer", "1", "effect of the barrier", &
                 "of several crossings, the first of stopped, broken_through, passed_over", "i1"), &
      variable_t("map", "passages", "integer", "1", &
                 "boulders that passed the cell, each counted once"), &
      variable_t("map", "reach_probability", "real", "1", &
                 "fraction of all boulders that passed the cell"), &
      variable_t("map", "reach_probability_by_source", "real", "1", &
                 "passages / boulders released from the sources that reach the cell"), &
      variable_t("map", "reach_probability_low", "real", "1", &
                 "lower limit of the 95 % interval of reach_probability", given_sources), &
      variable_t("map", "reach_probability_high", "real", "1", &
                 "upper limit of the 95 % interval of reach_probability", given_sources), &
      variable_t("map", "sources", "integer", "1", &
                 "sources from which at least one boulder passed the cell"), &
      variable_t("map", "deposits", "integer", "1", &
                 "boulders that came to rest in the cell or were absorbed there"), &
      variable_t("map", "energy_max", "real", "J", &
                 "maximum kinetic energy, translational and rotational"), &
      variable_t("map", "energy_mean", "real", "J", "mean"//energies), &
      variable_t("map", "energy_std", "real", "J", "standard deviation (n - 1)"//energies), &
      (variable_t("map", "energy_"//levels(k), "real", "J", trim(of_level(k))//energies, in_classes), &
       variable_t("map", "energy_"//levels(k)//"_low", "real", "J", lower//"energy_"//levels(k), order_statistics), &
       variable_t("map", "energy_"//levels(k)//"_high", "real", "J", upper//"energy_"//levels(k), order_statistics), &
       k=1, size(levels)), &
      variable_t("map", "energy_exceeded", "integer", "1", &
                 "boulders whose maximum energy in the cell exceeds a threshold"), &
      variable_t("map", "hits", "integer", "1", &
                 "boulders that would hit an object of object_width in the middle of the cell"), &
      variable_t("map", "hits_energy_exceeded", "integer", "1", &
                 "boulders that would hit this object with an energy that exceeds a threshold"), &
      variable_t("map", "speed_max_map", "real", "m s-1", "maximum speed"), &
      variable_t("map", "speed_mean", "real", "m s-1", "mean"//speeds), &
      variable_t("map", "speed_std", "real", "m s-1", "standard deviation (n - 1)"//speeds), &
      (variable_t("map", "speed_"//levels(k), "real", "m s-1", trim(of_level(k))//speeds, in_classes), &
       variable_t("map", "speed_"//levels(k)//"_low", "real", "m s-1", lower//"speed_"//levels(k), order_statistics), &
       variable_t("map", "speed_"//levels(k)//"_high", "real", "m s-1", upper//"speed_"//levels(k), order_statistics), &
       k=1, size(levels)), &
      variable_t("map", "jump_height_max_map", "real", "m", &
                 "maximum height of a boulder's lowest point above the surface"), &
      variable_t("map", "jump_height_mean", "real", "m", "mean"//jump_heights), &
      variable_t("map", "jump_height_std", "real", "m", "standard deviation (n - 1)"//jump_heights), &
      (variable_t("map", "jump_height_"//levels(k), "real", "m", trim(of_level(k))//jump_heights, in_classes), &
       variable_t("map", "jump_height_"//levels(k)//"_low", "real", "m", &
                   lower//"jump_height_"//levels(k), order_statistics), &
       variable_t("map", "jump_height_"//levels(k)//"_high", "real", "m", &
                   upper//"jump_height_"//levels(k), order_statistics), &
       k=1, size(levels)), &
      variable_t("map", "passing_height_max", "real", "m", &
                 "maximum height of a boulder's centre above the surface, vertical", by_cell), &
      variable_t("map", "passing_height_mean", "real", "m", "mean"//passing_heights), &
      variable_t("map", "passing_height_std", "real", "m", "standard deviation (n - 1)"//passing_heights), &
      (variable_t("map", "passing_height_"//levels(k), "real", "m", trim(of_level(k))//passing_heights, in_classes), &
       variable_t("map", "passing_height_"//levels(k)//"_low", "real", "m", &
                   lower//"passing_height_"//levels(k), order_statistics), &
       variable_t("map", "passing_height_"//levels(k)//"_high", "real", "m", &
                   upper//"passing_height_"//levels(k), order_statistics), &
       k=1, size(levels)), &
      variable_t("map", "energy_line_angle_max", "real", "degree", &
                 "maximum energy-line angle of the boulders that passed", to_middle), &
      variable_t("map", "energy_line_angle_min", "real", "degree", &
                 "minimum energy-line angle of the boulders that passed", to_middle), &
      variable_t("map", "travel_time_min", "real", "s", &
                 "shortest time from release until a boulder reaches the cell"), &
      variable_t("map", "tree_impacts", "integer", "1", "tree hits", "each hit counts"), &
      variable_t("map", "tree_impact_height_max", "real", "m", &
                 "maximum height of a boulder above the surface when it hit a tree"), &
      variable_t("map", "tree_impact_height_mean", "real", "m", &
                 "mean height of the boulders above the surface when they hit a tree"), &
      variable_t("map", "tree_energy", "real", "J", "energy that trees absorbed, all boulders"), &
      variable_t("histogram", "incidence_angle", "integer", "degree", &
                 "incidence angle from the surface, 90 = vertical", ends), &
      variable_t("histogram", "tangential_share", "integer", "1", &
                 "tangential fraction of the incident energy", ends), &
      variable_t("histogram", "normal_share", "integer", "1", &
                 "fraction of the incident energy normal to the surface", ends), &
      variable_t("histogram", "rotational_share", "integer", "1", &
                 "rotational fraction of the incident energy", ends), &
      variable_t("histogram", "restitution_tangential", "integer", "1", &
                 "R_t = V_t_out / V_t_in", ends), &
      variable_t("histogram", "restitution_normal", "integer", "1", &
                 "R_n = -V_n_out / V_n_in", ends), &
      variable_t("vertex", "boulder", "integer", "1", "number of the boulder"), &
      variable_t("vertex", "x", "real", "m", "easting"), &
      variable_t("vertex", "y", "real", "m", "northing"), &
      variable_t("vertex", "z", "real", "m", "elevation"), &
      variable_t("vertex", "time", "real", "s", "time from release"), &
      variable_t("vertex", "velocity_x", "real", "m s-1", "eastward velocity after the contact"), &
      variable_t("vertex", "velocity_y", "real", "m s-1", "northward velocity after the contact"), &
      variable_t("vertex", "velocity_z", "real", "m s-1", "upward velocity after the contact"), &
      variable_t("vertex", "in_t", "real", "m s-1", "V_t before the rebound"), &
      variable_t("vertex", "in_n", "real", "m s-1", "V_n before the rebound"), &
      variable_t("vertex", "in_w", "real", "m s-1", "W = R_b omega before the rebound"), &
      variable_t("vertex", "out_t", "real", "m s-1", &
                 "V_t after the rebound", "negative if the boulder bounces back"), &
      variable_t("vertex", "out_n", "real", "m s-1", "V_n after the rebound"), &
      variable_t("vertex", "out_w", "real", "m s-1", "W after the rebound"), &
      variable_t("vertex", "ratio", "real", "1", "R_b/R_m of the rebound", &
                 "0 without a rebound, -1 for a classical rebound"), &
      variable_t("vertex", "leg", "real", "1", "motion to the next vertex", &
                 "1 flight, 2 on the ground, 3 at rest; 0 at the end"), &
      variable_t("tally", "cell", "integer", "1", "index of the cell, row by row from the north-west"), &
      variable_t("tally", "counts", "integer", "1", "counts of the maps, by layer", stored="i4"), &
      variable_t("tally", "sums", "integer", "1", "sums of the maps, by layer"), &
      variable_t("tally", "maxima", "real", "1", "maxima of the maps, by layer", stored="f4"), &
      variable_t("tally", "bin_counts", "integer", "1", "counts by class", stored="i4"), &
      variable_t("tally", "shared_cell", "integer", "1", "cell reached from a source that the part divides"), &
      variable_t("tally", "shared_source", "integer", "1", "number of the source of the shared cell", stored="i4"), &
      variable_t("tally", "shared_boulders", "integer", "1", "boulders of this source in the part", stored="i4"), &
      variable_t("kept", "boulder", "integer", "1", "number of the boulder"), &
      variable_t("sample", "block", "integer", "1", &
                 "non-empty block of bins of place, part and quantity", axes="entry"), &
      variable_t("sample", "count", "integer", "1", &
                 "boulders in the bins of a block", stored="i4", axes="entry fine"), &
      variable_t("sample", "group_bin", "integer", "1", &
                 "non-empty coarse bin of place, group and quantity", axes="group_entry"), &
      variable_t("sample", "group_count", "integer", "1", &
                 "boulders in the coarse bin", stored="i4", axes="group_entry"), &
      variable_t("sample", "sums", "integer", "1", &
                 "sums, sums of squares, maxima, in units", axes="place part quantity word"), &
      variable_t("sample", "largest", "real", "1", &
                 "largest values at lines, increasing, padded with 0", stored="f4", axes="line tail rank"), &
      variable_t("sample", "ended", "integer", "1", "boulders by status", axes="status"), &
      variable_t("sample", "part_last", "integer", "1", &
                 "last feature or source of each part", stored="i4", axes="part"), &
      variable_t("sample", "group_part", "integer", "1", "part of each group of sources", stored="i4", axes="group"), &
      variable_t("status", "stopped", "word", "", "slower than the stop speed after a rebound"), &
      variable_t("status", "absorbed", "word", "", "met material that absorbs"), &
      variable_t("status", "left_domain", "word", "", "left the terrain between its outer cell centres"), &
      variable_t("status", "impact_limit", "word", "", &
                 "still moving at the impact limit"), &
      variable_t("status", "hit_nodata", "word", "", "met terrain without elevation"), &
      variable_t("status", "stopped_by_tree", "word", "", "lost its energy at a tree"), &
      variable_t("status", "stopped_by_barrier", "word", "", "lost its energy at a barrier"), &
      variable_t("outcome", "stopped", "word", "", &
                 "came to rest: the barrier absorbed all energy or left less than the stop speed"), &
      variable_t("outcome", "broken_through", "word", "", "continued with the remaining energy"), &
      variable_t("outcome", "passed_over", "word", "", "its centre was always above the top edge"), &
      variable_t("leg", "flight", "word", "", "in the air"), &
      variable_t("leg", "ground", "word", "", "rolling or sliding on the ground"), &
      variable_t("leg", "rest", "word", "", "at rest until the end of a contact")]

   character(len=27), parameter :: boulder_fields(n_boulder_fields) = pack(variable_table%name, &
      variable_table%group == "boulder" .and. variable_table%kind == "real")
   !> Integers per boulder; the last six are summed over all boulders.
   character(len=27), parameter :: boulder_counts(n_boulder_counts) = pack(variable_table%name, &
      (variable_table%group == "boulder" .and. variable_table%kind == "integer") &
      .or. variable_table%group == "count")
   character(len=27), parameter :: energy_fields(*) = pack(variable_table%name, &
      variable_table%group == "energy")
   !> Columns of the rows of boulders, and the group of each column; every run has those of group "boulder".
   logical, parameter :: is_row_real(*) = variable_table%kind == "real" &
      .and. (variable_table%group == "boulder" .or. variable_table%group == "energy" &
             .or. variable_table%group == "mass" .or. variable_table%group == "shadow" &
             .or. variable_table%group == "breakage")
   character(len=27), parameter :: row_reals(*) = pack(variable_table%name, is_row_real)
   character(len=11), parameter :: real_groups(*) = pack(variable_table%group, is_row_real)
   logical, parameter :: is_row_integer(*) = variable_table%kind == "integer" .and. variable_table%name /= "status" &
      .and. (variable_table%group == "boulder" .or. variable_table%group == "feature" &
             .or. variable_table%group == "shape" .or. variable_table%group == "tree" &
             .or. variable_table%group == "breakage")
   character(len=27), parameter :: row_integers(*) = pack(variable_table%name, is_row_integer)
   character(len=11), parameter :: integer_groups(*) = pack(variable_table%group, is_row_integer)
   character(len=27), parameter :: line_fields(n_line_fields) = pack(variable_table%name, &
      variable_table%group == "line")
   character(len=27), parameter :: crossing_fields(*) = pack(variable_table%name, &
      variable_table%group == "crossing" .and. variable_table%kind == "real")
   character(len=27), parameter :: vertex_fields(n_vertex_fields) = pack(variable_table%name, &
      variable_table%group == "vertex" .and. variable_table%kind == "real")
   character(len=27), parameter :: map_fields(*) = pack(variable_table%name, &
      variable_table%group == "map")
   character(len=27), parameter :: histogram_fields(*) = pack(variable_table%name, &
      variable_table%group == "histogram")
   character(len=27), parameter :: statuses(*) = pack(variable_table%name, &
      variable_table%group == "status")
   character(len=27), parameter :: outcomes(*) = pack(variable_table%name, &
      variable_table%group == "outcome")

contains

   !> Type of a variable in part files, in NumPy notation.
   elemental character(len=2) function stored_as(row)
      type(variable_t), intent(in) :: row

      stored_as = row%stored
      if (row%stored == "") stored_as = merge("i8", "f8", row%kind == "integer")
   end function stored_as

   !> Row of a variable, which must exist.
   pure type(variable_t) function variable_of(group, name) result(row)
      character(len=*), intent(in) :: group, name
      integer :: k

      do k = 1, size(variable_table)
         row = variable_table(k)
         if (row%group == group .and. row%name == name) exit
      end do
   end function variable_of

   !> Name of a variable in files.
   pure function name_in_files(row) result(name)
      type(variable_t), intent(in) :: row
      character(len=:), allocatable :: name

      name = trim(row%name)
      select case (row%group)
      case ("line", "crossing", "barrier", "tally", "sample"); name = trim(row%group)//"_"//name
      case ("fragment", "hit"); name = "crossing_"//name
      case ("vertex"); name = "trajectory_"//name
      case ("histogram"); name = name//"_histogram"
      end select
   end function name_in_files

   !> Format a row of the table as text: group|name|type in part files|axes|units|long_name|comment; ""
   !> past the end.
   pure function variable_text(k) result(text)
      integer, intent(in) :: k
      character(len=:), allocatable :: text
      type(variable_t) :: row

      text = ""
      if (k < 1 .or. k > size(variable_table)) return
      row = variable_table(k)
      text = trim(row%group)//"|"//trim(row%name)//"|"//stored_as(row)//"|"//trim(row%axes)//"|" &
             //trim(row%units)//"|"//trim(row%long_name)//"|"//trim(row%comment)
   end function variable_text
end module rockfall_variables
