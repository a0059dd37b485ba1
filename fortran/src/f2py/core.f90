! SPDX-License-Identifier: BSD-3-Clause
!> Python interface of the kernel: plain arrays, no physics.
!>
!> A scene is built once, by `new_scene`, `pass_array` and `build_scene`, and identified by a handle until
!> `close_scene`; it refers to the arrays passed in, which the caller must keep unchanged. Runs only read it, so several
!> may use it concurrently. A run also has a handle; its arrays belong to the kernel, and the caller gets views of them.
!> Handles and addresses are 64-bit integers instead of c_intptr_t, which f2py maps to a C long (32 bits on Windows).
module rockfall_f2py
   use ieee_arithmetic, only: ieee_value, ieee_quiet_nan
   use iso_c_binding, only: c_double, c_float, c_int, c_int8_t, c_int16_t, c_int32_t, c_int64_t, c_ptr, &
                            c_loc, c_f_pointer
   use rockfall_error, only: error_t, give_error
   use rockfall_dimensions, only: max_message, max_list, max_array_row, n_boulder_fields, n_boulder_counts, &
                             n_vertex_fields, n_line_quantities, n_impact_sets, n_set_numbers, n_incidence_limits, &
                             n_lateral_classes, n_lateral_quantiles, n_map_counts, n_map_sums, n_map_maxima, n_stacks
   use rockfall_text, only: integer_text, joined, max_text
   use rockfall_decimal, only: parse_real, decimal_ok
   use rockfall_grid, only: grid_t, is_outside
   use rockfall_terrain, only: terrain_t, is_known_at, max_elevation
   use rockfall_boulder, only: first_of, last_of, source_of, inertia_factor, boulder_t, sphere_radius, usual_volumes, &
                               kinetic_energy, distributions
   use rockfall_block_shape, only: block_shapes, block_axes, shape_of_axes
   use rockfall_shape, only: shape_volume, shape_inertia, shapes, sphere
   use rockfall_surface, only: size_weights
   use rockfall_barrier, only: barrier_outcome, ead_energy
   use rockfall_breakage, only: split_t, area_ratio, split_volume
   use rockfall_impact, only: ratio_weights, find_nearest_set, is_admissible, limit_rebound, max_draws, min_normal
   use rockfall_outcome, only: boulder_result_t, left_window
   use rockfall_scratch, only: scratch_t
   use rockfall_run_loop, only: save_rest, first_chunk, chunk_crossings
   use rockfall_bounds, only: check_sources, boulder_count, max_volumes, max_tree_hits
   use rockfall_scene_arrays, only: feature_fields, scene_array_text
   use rockfall_scene, only: object_reach
   use rockfall_flights, only: lanes
   use rockfall_impact_table, only: yielding_ground_t, largest_of_table => largest_block, max_held_speed, &
                                    usual_density, usual_weight
   use rockfall_grounds, only: parameter_of_ground => ground_parameter, model_names, rocks_of_model, &
                               model_of_table => table_model, read_yielding, max_grounds
   use rockfall_reach, only: block_side, update_block_minima, reach_box
   use rockfall_stand, only: stems_in_cell, stem_numbers, thinning_numbers
   use rockfall_random, only: random_key, normal_table_t, normal_table
   use rockfall_boulder, only: soil_draw_t
   use rockfall_draws, only: drawn_soil
   use rockfall_steep_cells, only: usual_threshold, keep_steep_cells, surface_ratios
   use rockfall_shares, only: proportional_part
   use rockfall_map_values, only: map_plan_t, plan_maps => map_plan, stack_layers, map_min_count, map_thin_below, &
                                   fraction_limit, limit_rank, z_95, min_for_mean, min_for_std, max_columns
   use rockfall_map_overflow, only: check_overflow
   use rockfall_threads, only: team_size, check_team, release_team
   use rockfall_ensemble, only: trace_boulder, recorded_boulders
   use rockfall_rows, only: boulder_row, boulder_count_row, vertex_row
   use rockfall_samples, only: sample_edge, n_sample_bins, n_coarse_bins, base_bits
   use rockfall_line_samples, only: all_quantities => line_quantities, point_along, &
                                    line_quantity, end_quantity, units_of, n_quantities, n_tails => tails
   use rockfall_line, only: line_t, new_line => line
   use rockfall_variables, only: variable_text, boulder_fields, boulder_counts, energy_fields, crossing_fields, &
                                 vertex_fields, map_fields, scene_layout, part_layout, piece, max_packing
   use rockfall_histogram, only: bin_width, n_bins
   use rockfall_values, only: refuse
   use rockfall_case_keys, only: key_text => row_text, key_table, broken_rule, n_keys, repeatable, max_real, max_name, &
                                 limits_of
   use rockfall_case, only: given_shapes, turning_rule, radius_of_reading, line_groups, barrier_strengths
   use rockfall_covariance, only: find_root => covariance_root
   use rockfall_impact_sets, only: coefficients_t, read_impact_sets => read_sets, any_speed, max_speed
   use rockfall_state_table, only: array_t, row_text
   use rockfall_run_state, only: plan_of, add_part => merge_run, settle_run, restore_run, &
                                 forget_tallies_of => forget_tallies, sort_crossings_of => sort_crossings, &
                                 forget_crossings_of => forget_crossings
   use rockfall_part, only: part_t, part_lengths_t, make_room, pack_run => pack_part, pack_samples, &
                            unpack => unpack_part, unpack_samples
   use rockfall_value_rules, only: fault_of_values => value_fault
   use rockfall_same_run, only: identity_t, difference
   use rockfall_handles, only: case_handle_t, scene_handle_t, run_handle_t, case_at, scene_at, run_at, &
                               empty_scene => new_scene, close_handle, give, limit, boulders_of
   implicit none
   private
   public :: new_scene, pass_array, build_scene, limit_terrain, close_scene, carry_in_lanes, trajectory, scan_rows, &
             reachable_box
   public :: block_of, map_plan
   public :: open_run, open_joined_run, continue_run, merge_run, close_run, advance, array, map, map_passages, &
             settle_sources, restore_sources
   public :: forget_tallies, pack_part, begin_part, unpack_part, forget_part
   public :: value_fault, run_difference, usual_radii, decimal, sphere_radii, kinetic_energies, limit_ranks, table_model
   public :: strength_deviates
   public :: largest_block
   public :: read_values, change_case, values_of, close_values
   public :: check_maps, key_limits, check_ground, refusal, table_row, read_sets, covariance_root, fields
   public :: constants, team
   public :: team_fits, end_team, slope_threshold, steep_cells, area_ratios, known_at, points_outside, boulders
   public :: boulders_of_source, recorded_numbers, sources_of_boulders, weights_of_sets, ratio_classes
   public :: stand_counts, stand_numbers, shape_numbers, shapes_of_axes
   public :: admissible_rebounds, limit_rebounds, size_to_radius, constant, boulders_in_parts, fraction_limits
   public :: line_quantities, points_along, sort_crossings, forget_crossings
   public :: check_numbers, barriers, barrier_outcomes, split_blocks

contains

   !> Create an empty scene, which receives the arrays of scene_arrays_t before it is built.
   subroutine new_scene(west, north, cell, nodes, first, draw, handle)
      real(c_double), intent(in) :: west, north, cell       !! outer edges, cell size [m]
      integer(c_int), intent(in) :: nodes(2), first(2)  !! columns and rows of the raster; column and row of the first
                                                        !! array element
      integer(c_int), intent(in) :: draw                    !! index of the draw of the impact sets; 0: the only draw
      integer(c_int64_t), intent(out) :: handle

      handle = transfer(c_loc(empty_scene(grid_t(west, north, cell, nodes(1), nodes(2)), first, draw)), handle)
   end subroutine new_scene

   !> Pass an array to a scene: its name, kind, lengths (the first varies fastest), and address.
   subroutine pass_array(handle, name, kind, length, address)
      integer(c_int64_t), intent(in) :: handle, address
      character(len=*), intent(in) :: name, kind
      integer(c_int64_t), intent(in) :: length(3)

      call give(scene_of(handle), name, kind, length, pointer_of(address))
   end subroutine pass_array

   !> Build a scene from a case and the arrays passed; on error it is closed.
   subroutine build_scene(handle, case, code, message)
      integer(c_int64_t), intent(in) :: handle, case
      integer(c_int), intent(out) :: code                   !! 0 = success
      character(len=max_message), intent(out) :: message
      type(case_handle_t), pointer :: given
      type(scene_handle_t), pointer :: opened
      type(error_t), allocatable :: error

      given => case_at(pointer_of(case))
      opened => scene_of(handle)
      call opened%build(given%case, error)
      if (allocated(error)) call close_scene(handle)
      call give_error(error, code, message)
   end subroutine build_scene

   !> Restrict boulders to the columns and rows of the maps. All runs of a scene must have the same restriction, set
   !> before the first run.
   subroutine limit_terrain(handle, map_at, map_last)
      integer(c_int64_t), intent(in) :: handle
      integer(c_int), intent(in) :: map_at(2), map_last(2)  !! first and last column, row

      call limit(scene_of(handle), map_at, map_last)
   end subroutine limit_terrain

   !> Close a scene; the handle becomes invalid.
   subroutine close_scene(handle)
      integer(c_int64_t), intent(in) :: handle
      type(scene_handle_t), pointer :: opened

      opened => scene_of(handle)
      deallocate (opened)
   end subroutine close_scene

   !> Set the execution mode, as in rockfall_scene_type; results do not depend on it.
   subroutine carry_in_lanes(handle, lanes)
      integer(c_int64_t), intent(in) :: handle
      integer(c_int), intent(in) :: lanes
      type(scene_handle_t), pointer :: opened

      opened => scene_of(handle)
      opened%scene%lanes = lanes
   end subroutine carry_in_lanes

   pure type(c_ptr) function pointer_of(address) result(place)
      integer(c_int64_t), intent(in) :: address

      place = transfer(address, place)
   end function pointer_of

   function scene_of(handle) result(opened)
      integer(c_int64_t), intent(in) :: handle
      type(scene_handle_t), pointer :: opened

      opened => scene_at(pointer_of(handle))
   end function scene_of

   !> Open a run of a scene, or of the `boulders` boulders after the first `before`, with maps of a window (first column
   !> and row, numbers of columns and rows).
   subroutine open_run(handle, before, boulders, window, threads, most_columns, run, code, message)
      integer(c_int64_t), intent(in) :: handle, before, boulders
      integer(c_int), intent(in) :: window(4), threads
      integer(c_int64_t), intent(in) :: most_columns  !! maximum number of columns of bin counts
      integer(c_int64_t), intent(out) :: run  !! 0 on error
      integer(c_int), intent(out) :: code      !! 0 = success
      character(len=max_message), intent(out) :: message
      type(run_handle_t), pointer :: opened
      type(error_t), allocatable :: error

      allocate (opened)
      call opened%begin(scene_of(handle), before, boulders, threads, error, window, most_columns)
      call return_run(opened, error, run, code, message)
   end subroutine open_run

   !> Open a run without a scene: a part, or the sum of parts. `grounds` is the number of grounds (0: only impact sets);
   !> `features` and `shapes` are 1 if sources have features of a layer and if boulders have several shapes, else 0.
   subroutine open_joined_run(case, boulders, window, grounds, features, shapes, part_last, group_part, run, code, &
                              message, np, ng)
      integer(c_int), intent(in) :: np, ng
      integer(c_int64_t), intent(in) :: case
      integer(c_int64_t), intent(in) :: boulders(3)  !! numbers in the complete run, before the part, in the part
      integer(c_int), intent(in) :: window(4), grounds, features, shapes
      integer(c_int32_t), intent(in) :: part_last(np), group_part(ng)  !! as in layout_t
      integer(c_int64_t), intent(out) :: run
      integer(c_int), intent(out) :: code
      character(len=max_message), intent(out) :: message
      type(case_handle_t), pointer :: given
      type(run_handle_t), pointer :: opened
      type(error_t), allocatable :: error

      given => case_at(pointer_of(case))
      allocate (opened)
      call opened%begin_joined(given%case, boulders, window, grounds, features /= 0, shapes /= 0, part_last, &
                               group_part, error)
      call return_run(opened, error, run, code, message)
   end subroutine open_joined_run

   !> Open a run of a scene that continues another run, which then cannot be continued itself.
   subroutine continue_run(handle, other, run, code, message)
      integer(c_int64_t), intent(in) :: handle, other
      integer(c_int64_t), intent(out) :: run
      integer(c_int), intent(out) :: code
      character(len=max_message), intent(out) :: message
      type(run_handle_t), pointer :: opened
      type(error_t), allocatable :: error

      allocate (opened)
      call opened%begin_continued(scene_of(handle), run_of(other), error)
      call return_run(opened, error, run, code, message)
   end subroutine continue_run

   !> Return the address of a run; null after an error.
   subroutine return_run(opened, error, run, code, message)
      type(run_handle_t), pointer, intent(inout) :: opened
      type(error_t), allocatable, intent(in) :: error
      integer(c_int64_t), intent(out) :: run
      integer(c_int), intent(out) :: code
      character(len=max_message), intent(out) :: message

      run = transfer(c_loc(opened), run)
      if (allocated(error)) then
         call close_handle(opened)
         run = 0
      end if
      call give_error(error, code, message)
   end subroutine return_run

   !> Add a part to a run; both come from open_joined_run.
   subroutine merge_run(run, part, code, message)
      !f2py threadsafe
      integer(c_int64_t), intent(in) :: run, part
      integer(c_int), intent(out) :: code
      character(len=max_message), intent(out) :: message
      type(run_handle_t), pointer :: joined, other
      type(error_t), allocatable :: error

      joined => run_of(run)
      other => run_of(part)
      call add_part(joined%run, other%run, error)
      call give_error(error, code, message)
   end subroutine merge_run

   !> Close a run; the handle becomes invalid.
   subroutine close_run(run)
      integer(c_int64_t), intent(in) :: run
      type(run_handle_t), pointer :: opened

      opened => run_of(run)
      call close_handle(opened)
   end subroutine close_run

   function run_of(run) result(opened)
      integer(c_int64_t), intent(in) :: run
      type(run_handle_t), pointer :: opened

      opened => run_at(pointer_of(run))
   end function run_of

   !> Run n boulders, every `step`-th from the first, on a scene, which may be a window of the run's terrain. Boulders
   !> that left the window must be rerun; `left` is their number. No boulder starts after `seconds`; `done` is the
   !> number completed.
   subroutine advance(run, handle, first, step, n, seconds, done, left, code, message)
      !f2py threadsafe
      integer(c_int64_t), intent(in) :: run, handle, first, step, n
      real(c_double), intent(in) :: seconds  !! [s]
      integer(c_int64_t), intent(out) :: done
      integer(c_int), intent(out) :: left, code
      character(len=max_message), intent(out) :: message
      type(scene_handle_t), pointer :: scene
      type(run_handle_t), pointer :: opened
      type(error_t), allocatable :: error

      scene => scene_of(handle)
      opened => run_of(run)
      call opened%advance(scene%scene, first, step, n, seconds, done, error)
      left = 0
      if (.not. allocated(error)) left = size(opened%run%left)
      call give_error(error, code, message)
   end subroutine advance

   !> Array k of a run, from 1, or of its part (of_part 1): description from row_text, lengths of the dimensions (the
   !> first varies fastest), and address; blank past the end. A call with k = 1 renews the list of arrays.
   subroutine array(run, of_part, k, text, length, address)
      integer(c_int64_t), intent(in) :: run
      integer(c_int), intent(in) :: of_part, k
      character(len=max_array_row), intent(out) :: text
      integer(c_int64_t), intent(out) :: length(4), address
      type(run_handle_t), pointer :: opened
      type(array_t), pointer :: row

      opened => run_of(run)
      row => opened%list(k, of_part /= 0)
      text = ""
      length = 1
      address = 0
      if (.not. associated(row)) return
      text = row_text(row)
      length = row%length
      address = transfer(row%at, address)
   end subroutine array

   !> Pack a run (or, with only_samples 1, its samples) into a part; views of its last part become invalid.
   subroutine pack_part(run, only_samples, code, message)
      !f2py threadsafe
      integer(c_int64_t), intent(in) :: run
      integer(c_int), intent(in) :: only_samples
      integer(c_int), intent(out) :: code
      character(len=max_message), intent(out) :: message
      type(run_handle_t), pointer :: opened
      type(error_t), allocatable :: error

      opened => run_of(run)
      if (only_samples /= 0) then
         call pack_samples(opened%run, opened%part)
      else
         call pack_run(opened%run, opened%part, error)
      end if
      call give_error(error, code, message)
   end subroutine pack_part

   !> Allocate a part for the first `done` boulders of a run, with lengths as in part_lengths_t; the caller fills it.
   subroutine begin_part(run, done, lengths, code, message)
      integer(c_int64_t), intent(in) :: run, done, lengths(6)
      integer(c_int), intent(out) :: code
      character(len=max_message), intent(out) :: message
      type(run_handle_t), pointer :: opened
      type(error_t), allocatable :: error

      opened => run_of(run)
      opened%run%done = done
      associate (n => lengths)
         call make_room(opened%run, opened%part, part_lengths_t(n(1), n(2), n(3), n(4), n(5), n(6)), error)
      end associate
      call give_error(error, code, message)
   end subroutine begin_part

   !> Store a filled part in its run, if its values are possible on a terrain with this raster. With only_samples 1,
   !> store only samples and numbers of rows.
   subroutine unpack_part(run, only_samples, corner, nodes, code, message)
      !f2py threadsafe
      integer(c_int64_t), intent(in) :: run
      integer(c_int), intent(in) :: only_samples
      real(c_double), intent(in) :: corner(3)               !! west, north, cell [m]
      integer(c_int), intent(in) :: nodes(2)
      integer(c_int), intent(out) :: code
      character(len=max_message), intent(out) :: message
      type(run_handle_t), pointer :: opened
      type(error_t), allocatable :: error

      opened => run_of(run)
      if (only_samples /= 0) then
         call unpack_samples(opened%run, opened%part, error)
      else
         call unpack(opened%run, opened%part, grid_of(corner, nodes), error)
      end if
      opened%part = part_t()
      call give_error(error, code, message)
   end subroutine unpack_part

   !> Free the memory of the part of a run; views of it become invalid.
   subroutine forget_part(run)
      integer(c_int64_t), intent(in) :: run
      type(run_handle_t), pointer :: opened

      opened => run_of(run)
      opened%part = part_t()
   end subroutine forget_part

   pure type(grid_t) function grid_of(corner, nodes) result(grid)
      real(c_double), intent(in) :: corner(3)  !! west, north, cell [m]
      integer(c_int), intent(in) :: nodes(2)

      grid = grid_t(corner(1), corner(2), corner(3), nodes(1), nodes(2))
   end function grid_of

   !> Describe the fault in the values of a variable, given its name in files; blank if none.
   subroutine value_fault(name, values, fault, n)
      integer(c_int), intent(in) :: n
      character(len=*), intent(in) :: name
      real(c_double), intent(in) :: values(n)
      character(len=max_message), intent(out) :: fault

      fault = fault_of_values(name, values)
   end subroutine value_fault

   !> Describe the first difference between two runs; blank if the other run begins this one. Texts are the version and
   !> the two checksums of identity_t, separated by character 1. Numbers are boulders (total, first, last), nodes of the
   !> grid (2), and window (4).
   subroutine run_difference(our_case, their_case, ours, theirs, numbers, corners, what)
      integer(c_int64_t), intent(in) :: our_case, their_case
      character(len=*), intent(in) :: ours, theirs
      integer(c_int64_t), intent(in) :: numbers(9, 2)
      real(c_double), intent(in) :: corners(3, 2)           !! west, north, cell [m]
      character(len=max_message), intent(out) :: what

      what = difference(identity_of(our_case, ours, numbers(:, 1), corners(:, 1)), &
                        identity_of(their_case, theirs, numbers(:, 2), corners(:, 2)))
   end subroutine run_difference

   type(identity_t) function identity_of(case, texts, numbers, corner) result(identity)
      integer(c_int64_t), intent(in) :: case
      character(len=*), intent(in) :: texts
      integer(c_int64_t), intent(in) :: numbers(9)
      real(c_double), intent(in) :: corner(3)  !! west, north, cell [m]
      type(case_handle_t), pointer :: given
      integer :: first, second

      given => case_at(pointer_of(case))
      first = index(texts, achar(1))
      second = index(texts, achar(1), back=.true.)
      identity%version = texts(:first - 1)
      identity%keys = given%list
      identity%read = texts(first + 1:second - 1)
      identity%decoded = texts(second + 1:)
      identity%total = numbers(1)
      identity%first = numbers(2)
      identity%last = numbers(3)
      identity%grid = grid_of(corner, int(numbers(4:5)))
      identity%window = int(numbers(6:9))
   end function identity_of

   !> Compute a map of a run, and write it to an array at an address. `boulders` are the completed boulders, and the
   !> number of boulders that may behave alike (1: independent).
   subroutine map(run, name, boulders, address, code, message)
      !f2py threadsafe
      integer(c_int64_t), intent(in) :: run, address
      character(len=*), intent(in) :: name
      integer(c_int64_t), intent(in) :: boulders(2)
      integer(c_int), intent(out) :: code
      character(len=max_message), intent(out) :: message
      type(run_handle_t), pointer :: opened
      real(c_float), pointer, contiguous :: values(:, :)
      type(error_t), allocatable :: error

      opened => run_of(run)
      call c_f_pointer(pointer_of(address), values, opened%run%maps%nodes)
      call opened%write_map(name, boulders(1), boulders(2), values, error)
      call give_error(error, code, message)
   end subroutine map

   !> Numbers of passages in a map cell: the minimum for a value, and the number below which a value is unreliable.
   subroutine map_passages(run, name, per_cluster, passages)
      integer(c_int64_t), intent(in) :: run
      character(len=*), intent(in) :: name
      integer(c_int64_t), intent(in) :: per_cluster
      integer(c_int), intent(out) :: passages(2)
      type(run_handle_t), pointer :: opened

      opened => run_of(run)
      passages = [map_min_count(name, opened%run%min_passages), map_thin_below(name, per_cluster)]
   end subroutine map_passages

   !> Free the tallies and samples of a run once all results are computed. `go` is 1 to free also the counts, the sums,
   !> and the maxima of maps, else 0. Their views become invalid.
   subroutine forget_tallies(run, go)
      integer(c_int64_t), intent(in) :: run
      integer(c_int), intent(in) :: go(3)
      type(run_handle_t), pointer :: opened

      opened => run_of(run)
      call forget_tallies_of(opened%run, go /= 0)
   end subroutine forget_tallies

   !> Sort the crossings of a run by line, then by boulder; views of them become invalid.
   subroutine sort_crossings(run, code, message)
      !f2py threadsafe
      integer(c_int64_t), intent(in) :: run
      integer(c_int), intent(out) :: code
      character(len=max_message), intent(out) :: message
      type(run_handle_t), pointer :: opened
      type(error_t), allocatable :: error

      opened => run_of(run)
      call sort_crossings_of(opened%run, error)
      call give_error(error, code, message)
   end subroutine sort_crossings

   !> Discard the crossings of a run once the caller has copied them; views of them become invalid.
   subroutine forget_crossings(run)
      integer(c_int64_t), intent(in) :: run
      type(run_handle_t), pointer :: opened

      opened => run_of(run)
      call forget_crossings_of(opened%run)
   end subroutine forget_crossings

   !> Make the maps of a run count only completed boulders of sources that are partly done (sign 1), or undo this (-1).
   subroutine settle_sources(run, handle, done, sign)
      integer(c_int64_t), intent(in) :: run, handle, done
      integer(c_int), intent(in) :: sign
      type(scene_handle_t), pointer :: scene
      type(run_handle_t), pointer :: opened

      scene => scene_of(handle)
      opened => run_of(run)
      opened%run%done = done
      call settle_run(opened%run, scene%scene%release, sign)
   end subroutine settle_sources

   !> Restore the cells of partly completed sources from an unpacked part. good: 1 if successful, else 0.
   subroutine restore_sources(run, handle, good)
      integer(c_int64_t), intent(in) :: run, handle
      integer(c_int), intent(out) :: good
      type(scene_handle_t), pointer :: scene
      type(run_handle_t), pointer :: opened
      logical :: is_good

      scene => scene_of(handle)
      opened => run_of(run)
      call restore_run(opened%run, scene%scene%release, is_good)
      good = merge(1, 0, is_good)
   end subroutine restore_sources

   !> Compute the line quantities, except the last, of boulders or fragments that crossed a line.
   subroutine line_quantities(motion, volume, mass, quantities, n)
      integer(c_int), intent(in) :: n
      real(c_double), intent(in) :: motion(n, 6)   !! velocity [m/s], omega [rad/s], jump and passing height [m]
      real(c_double), intent(in) :: volume(n), mass(n)  !! [m3], [kg]
      real(c_double), intent(out) :: quantities(n, n_line_quantities)
      real(c_double) :: row(6)
      type(boulder_t) :: boulder
      integer :: k

      do k = 1, n
         boulder = boulder_t(volume(k), sphere_radius(volume(k)), mass(k))
         row = motion(k, :)  ! a copy: gfortran 12 to 14 lose the stride of an associated row that is an argument
         associate (v => row(:3), omega => row(4))
            quantities(k, :) = all_quantities([0.0_c_double, 0.0_c_double, 0.0_c_double, &
                                               sqrt(v(1)**2 + v(2)**2 + v(3)**2), &
                                               row, kinetic_energy(boulder, v, omega)], boulder%radius)
         end associate
      end do
   end subroutine line_quantities

   !> Points of a line at distances [m] along it.
   subroutine points_along(line_x, line_y, along, points, nv, n)
      integer(c_int), intent(in) :: nv, n
      real(c_double), intent(in) :: line_x(nv), line_y(nv), along(n)  !! [m]
      real(c_double), intent(out) :: points(2, n)  !! [m]
      type(line_t) :: line
      integer :: k

      line = new_line(line_x, line_y)
      do k = 1, n
         points(:, k) = point_along(line, along(k))
      end do
   end subroutine points_along

   !> Split blocks by the breakage rule of a case: area ratios [-]; fragment volumes, padded with 0 [m3]; volumes of
   !> fines [m3]; capped: 1 if the maximum number of fragments was reached, else 0. An unbroken block is its only
   !> fragment.
   subroutine split_blocks(case, volume, energy, ratio, fragments, fines, capped, n, room)
      integer(c_int), intent(in) :: n, room
      integer(c_int64_t), intent(in) :: case
      real(c_double), intent(in) :: volume(n), energy(n)  !! volume [m3]; energy of the motion normal to the ground [J]
      real(c_double), intent(out) :: ratio(n)
      real(c_double), intent(inout) :: fragments(room, n)
      real(c_double), intent(out) :: fines(n)
      integer(c_int), intent(out) :: capped(n)
      type(case_handle_t), pointer :: given
      type(split_t) :: split
      integer :: k

      given => case_at(pointer_of(case))
      ratio = area_ratio(energy, volume)
      fragments = 0
      do k = 1, n
         split = split_t([volume(k)])
         associate (rule => given%case%breakage)
            if (ratio(k) > rule%min_ratio) &
               call split_volume(volume(k), ratio(k), rule%min_volume, rule%max_fragments, split)
         end associate
         fragments(:size(split%volume), k) = split%volume
         fines(k) = split%fines
         capped(k) = merge(1, 0, split%capped)
      end do
   end subroutine split_blocks

   !> Run one boulder, and store at most `max_vertices` of the `recorded` vertices of its trajectory; nothing is
   !> tallied.
   subroutine trajectory(handle, number, vertex, recorded, boulder, counts, max_vertices)
      !f2py threadsafe
      integer(c_int), intent(in) :: max_vertices
      integer(c_int64_t), intent(in) :: handle, number
      real(c_double), intent(inout) :: vertex(n_vertex_fields, max_vertices)  !! columns as vertex_fields
      integer(c_int), intent(out) :: recorded
      real(c_double), intent(out) :: boulder(n_boulder_fields)           !! columns as boulder_fields
      integer(c_int32_t), intent(out) :: counts(n_boulder_counts)       !! columns as boulder_counts
      type(scene_handle_t), pointer :: opened
      type(boulder_result_t) :: result
      type(scratch_t) :: scratch
      integer :: k

      opened => scene_of(handle)
      associate (scene => opened%scene)
         call trace_boulder(scene, number, max_vertices, result, scratch)
         boulder = boulder_row(scene%dem, result)
         counts = boulder_count_row(result)
         recorded = scratch%record%n
         do k = 1, min(max_vertices, recorded)
            vertex(:, k) = vertex_row(scene%dem, scratch%record%vertex(k))
         end do
      end associate
   end subroutine trajectory

   !> Process the terrain rows from first to last as in rockfall_reach and check_sources: update the minima of blocks,
   !> check the sources there, and raise the maximum energy head.
   subroutine scan_rows(handle, first, last, minima, max_head, code, message, nbx, nby)
      !f2py threadsafe
      integer(c_int), intent(in) :: nbx, nby
      integer(c_int64_t), intent(in) :: handle
      integer(c_int), intent(in) :: first, last
      real(c_double), intent(inout) :: minima(nbx, nby), max_head(1)  !! [m]
      integer(c_int), intent(out) :: code
      character(len=max_message), intent(out) :: message
      type(scene_handle_t), pointer :: opened
      type(error_t), allocatable :: error

      opened => scene_of(handle)
      call check_sources(opened%scene, first, last, max_head(1), error)
      call give_error(error, code, message)
      if (code == 0 .and. size(minima) > 1) call update_block_minima(opened%dem, first, last, minima)
   end subroutine scan_rows

   !> Terrain of a scene whose elevations are set.
   function terrain_of(handle) result(dem)
      integer(c_int64_t), intent(in) :: handle
      type(terrain_t) :: dem
      type(scene_handle_t), pointer :: opened

      opened => scene_of(handle)
      dem = opened%terrain_known()
   end function terrain_of

   !> First and last column and row, from 1, of the cells that boulders can reach.
   subroutine reachable_box(handle, minima, max_head, box, nbx, nby)
      !f2py threadsafe
      integer(c_int), intent(in) :: nbx, nby
      integer(c_int64_t), intent(in) :: handle
      real(c_double), intent(in) :: minima(nbx, nby), max_head  !! [m]
      integer(c_int), intent(out) :: box(4)
      type(scene_handle_t), pointer :: opened

      opened => scene_of(handle)
      box = reach_box(opened%dem, minima, max_head, opened%scene%release%x, opened%scene%release%y, &
                      object_reach(opened%scene, opened%case))
   end subroutine reachable_box

   !> Side length in cells of the blocks for which `scan_rows` finds the minimum elevation.
   subroutine block_of(nodes, side)
      integer(c_int), intent(in) :: nodes(2)
      integer(c_int), intent(out) :: side

      side = block_side(nodes)
   end subroutine block_of

   !> Plan of the tallies needed by maps. `counts`, `sums` and `maxima`: index in its stack of each layer of map_plan_t,
   !> from 1 (0: none); the last two counts are the first layers of passages and of hits above energy thresholds.
   !> `bins`: rows of the bin counts for quantiles. `layers`: number of layers of each stack.
   subroutine map_plan(names, thresholds, counts, sums, maxima, bins, layers)
      character(len=*), intent(in) :: names     !! names of maps, separated by spaces
      integer(c_int), intent(in) :: thresholds  !! number of thresholds
      integer(c_int), intent(out) :: counts(n_map_counts), sums(n_map_sums), maxima(n_map_maxima), bins, &
                                     layers(n_stacks)
      type(map_plan_t) :: plan
      integer :: k

      plan = plan_maps(pack(map_fields, [(index(" "//names//" ", " "//trim(map_fields(k))//" ") > 0, &
                                          k=1, size(map_fields))]), thresholds)
      counts = [plan%count, plan%exceeded]
      sums = plan%sum
      maxima = plan%max
      bins = plan%rows
      layers = stack_layers(plan)
   end subroutine map_plan

   !> Reject a run whose maps could overflow; `fall` is the height [m] from the maximum energy head to the minimum
   !> elevation.
   subroutine check_maps(handle, fall, code, message)
      integer(c_int64_t), intent(in) :: handle
      real(c_double), intent(in) :: fall
      integer(c_int), intent(out) :: code
      character(len=max_message), intent(out) :: message
      type(scene_handle_t), pointer :: opened
      type(error_t), allocatable :: error

      opened => scene_of(handle)
      associate (scene => opened%scene)
         call check_overflow(plan_of(opened%case), max_volumes(scene), scene%gravity, fall, boulder_count(scene), &
                            max_tree_hits(scene), error)
      end associate
      call give_error(error, code, message)
   end subroutine check_maps

   !> Number of stems in each cell of one row, in a raster with nx columns, for a stand of trees (rockfall_stand).
   subroutine stand_counts(seed, nx, row, expected, even, counts, n)
      !f2py threadsafe
      integer(c_int), intent(in) :: n
      integer(c_int64_t), intent(in) :: seed
      integer(c_int), intent(in) :: nx, row, even       !! row from 1; even: 1 or 0
      real(c_double), intent(in) :: expected(n)         !! expected number of stems in each cell
      integer(c_int32_t), intent(out) :: counts(n)
      integer :: i

      counts = [(stems_in_cell(random_key(seed), cell_number(nx, row, i), expected(i), even /= 0), i=1, n)]
   end subroutine stand_counts

   !> Uniform numbers for each stem, cell by cell: four that place the stem, or two that decide whether it is kept
   !> (rockfall_stand).
   subroutine stand_numbers(seed, nx, row, counts, numbers, n, m, nt)
      !f2py threadsafe
      integer(c_int), intent(in) :: n, m, nt
      integer(c_int64_t), intent(in) :: seed
      integer(c_int), intent(in) :: nx, row
      integer(c_int32_t), intent(in) :: counts(n)       !! number of stems in each cell, nt in all
      real(c_double), intent(out) :: numbers(m, nt)     !! m: 4 or 2
      integer :: i, k, stem

      k = 0
      do i = 1, n
         do stem = 1, counts(i)
            k = k + 1
            associate (key => random_key(seed), cell => cell_number(nx, row, i))
               if (m == 4) numbers(:, k) = stem_numbers(key, cell, stem)
               if (m == 2) numbers(:, k) = thinning_numbers(key, cell, stem)
            end associate
         end do
      end do
   end subroutine stand_numbers

   !> Volume [m3] and moment of inertia I/(m R**2) [-] of boulders by shape and sides, as in rockfall_shape.
   subroutine shape_numbers(shape, d, volume, inertia, n)
      integer(c_int), intent(in) :: n
      integer(c_int), intent(in) :: shape(n)
      real(c_double), intent(in) :: d(3, n)  !! [m]
      real(c_double), intent(out) :: volume(n), inertia(n)
      integer :: k

      do k = 1, n
         volume(k) = shape_volume(shape(k), d(:, k))
         inertia(k) = shape_inertia(shape(k), d(:, k))
      end do
   end subroutine shape_numbers

   !> Nearest block shape of boulders with these axes, in any unit, in non-increasing order.
   subroutine shapes_of_axes(axes, shape, n)
      integer(c_int), intent(in) :: n
      real(c_double), intent(in) :: axes(3, n)
      integer(c_int8_t), intent(out) :: shape(n)
      integer :: k

      do k = 1, n
         shape(k) = int(shape_of_axes(axes(1, k), axes(2, k), axes(3, k)), c_int8_t)
      end do
   end subroutine shapes_of_axes

   !> Number of a cell, counted from 1 row by row from the north-west.
   pure integer(c_int64_t) function cell_number(nx, row, column)
      integer(c_int), intent(in) :: nx, row
      integer, intent(in) :: column

      cell_number = (row - 1)*int(nx, c_int64_t) + column
   end function cell_number

   !> Default slope threshold of sources for a cell size [degree].
   subroutine slope_threshold(cell, slope)
      real(c_double), intent(in) :: cell  !! [m]
      real(c_double), intent(out) :: slope  !! [degree]

      slope = usual_threshold(cell)
   end subroutine slope_threshold

   !> Set positive cells to 1 if they are steep, else to 0, from row `first` (1..) on. The scene need not be built.
   subroutine steep_cells(handle, threshold, first, cells, nx, ny)
      !f2py threadsafe
      integer(c_int), intent(in) :: nx, ny, first
      integer(c_int64_t), intent(in) :: handle
      real(c_double), intent(in) :: threshold  !! [degree]
      integer(c_int16_t), intent(inout) :: cells(nx, ny)

      call keep_steep_cells(terrain_of(handle), threshold, first, cells)
   end subroutine steep_cells

   !> Ratio of surface to plan area of source cells at map coordinates [m]. The scene need not be built.
   subroutine area_ratios(handle, source_x, source_y, ratio, ns)
      !f2py threadsafe
      integer(c_int), intent(in) :: ns
      integer(c_int64_t), intent(in) :: handle
      real(c_double), intent(in) :: source_x(ns), source_y(ns)
      real(c_double), intent(out) :: ratio(ns)
      type(terrain_t) :: dem

      dem = terrain_of(handle)
      ratio = surface_ratios(dem, source_x - dem%x0, source_y - dem%y0)
   end subroutine area_ratios

   !> Return whether boulders can start from points in map coordinates [m]; the scene need not be built.
   subroutine known_at(handle, x, y, is_known, n)
      integer(c_int), intent(in) :: n
      integer(c_int64_t), intent(in) :: handle
      real(c_double), intent(in) :: x(n), y(n)
      integer(c_int), intent(out) :: is_known(n)             !! 1 or 0
      type(terrain_t) :: dem
      integer :: k

      dem = terrain_of(handle)
      is_known = [(merge(1, 0, is_known_at(dem, x(k) - dem%x0, y(k) - dem%y0)), k=1, n)]
   end subroutine known_at

   !> Return whether a line of points [m] is on the outer side of one edge of a raster.
   subroutine points_outside(west, north, cell, nodes, x, y, is, n)
      integer(c_int), intent(in) :: n, nodes(2)
      real(c_double), intent(in) :: west, north, cell, x(n), y(n)  !! map coordinates; cell size [m]
      integer(c_int), intent(out) :: is                   !! 1 or 0

      is = merge(1, 0, is_outside(grid_t(west, north, cell, nodes(1), nodes(2)), x, y))
   end subroutine points_outside

   !> Number of boulders of a scene.
   subroutine boulders(handle, number)
      integer(c_int64_t), intent(in) :: handle
      integer(c_int64_t), intent(out) :: number

      number = boulders_of(scene_of(handle))
   end subroutine boulders

   !> First and last boulder of a source, from 1.
   subroutine boulders_of_source(handle, source, first, last)
      integer(c_int64_t), intent(in) :: handle, source
      integer(c_int64_t), intent(out) :: first, last
      type(scene_handle_t), pointer :: opened

      opened => scene_of(handle)
      first = first_of(opened%scene%release, source)
      last = last_of(opened%scene%release, source)
   end subroutine boulders_of_source

   !> Numbers of the n boulders in first..last whose trajectories are recorded, if `requested` are recorded in total.
   subroutine recorded_numbers(handle, first, last, number, n, requested)
      integer(c_int64_t), intent(in) :: handle, first, last
      integer, intent(in) :: requested
      integer(c_int64_t), intent(out) :: number(requested)
      integer(c_int), intent(out) :: n
      type(scene_handle_t), pointer :: opened

      opened => scene_of(handle)
      associate (numbers => recorded_boulders(opened%scene%release, int(requested, c_int64_t), first, last))
         n = size(numbers)
         number = 0
         number(:n) = numbers
      end associate
   end subroutine recorded_numbers

   !> Number of boulders in the first `part` of `parts` equal parts of a run of n boulders.
   subroutine boulders_in_parts(n, part, parts, boulders)
      integer(c_int64_t), intent(in) :: n, part, parts
      integer(c_int64_t), intent(out) :: boulders

      boulders = proportional_part(n, part, parts)
   end subroutine boulders_in_parts

   !> Limits of the 95 % intervals of fractions [-] of a number of boulders.
   subroutine fraction_limits(fraction, boulders, low, high, n)
      integer(c_int), intent(in) :: n
      real(c_double), intent(in) :: fraction(n), boulders  !! [-]; number of boulders
      real(c_double), intent(out) :: low(n), high(n)

      low = fraction_limit(fraction, boulders, -1)
      high = fraction_limit(fraction, boulders, 1)
   end subroutine fraction_limits

   !> Index, from 1, of the source of each boulder.
   subroutine sources_of_boulders(handle, boulder, source, n)
      integer(c_int), intent(in) :: n
      integer(c_int64_t), intent(in) :: handle, boulder(n)
      integer(c_int64_t), intent(out) :: source(n)
      type(scene_handle_t), pointer :: opened
      integer :: k

      opened => scene_of(handle)
      source = [(source_of(opened%scene%release, boulder(k)), k=1, n)]
   end subroutine sources_of_boulders

   !> Index, from 1, of the first number that is invalid for a key of the case (0: none), and the rule that it violates.
   subroutine check_numbers(group, name, values, first, rule, n)
      integer(c_int), intent(in) :: n
      character(len=*), intent(in) :: group, name
      real(c_double), intent(in) :: values(n)
      integer(c_int), intent(out) :: first
      character(len=max_list), intent(out) :: rule
      integer :: key

      do key = 1, n_keys
         if (key_table(key)%group == group .and. key_table(key)%name == name) exit
      end do
      do first = 1, n
         rule = broken_rule(key_table(key), values(first))
         if (rule /= "") return
      end do
      first = 0
   end subroutine check_numbers

   !> Lowest and highest number allowed for key k of a case; NaN if unlimited.
   subroutine key_limits(k, limits)
      integer(c_int), intent(in) :: k
      real(c_double), intent(out) :: limits(2)

      limits = limits_of(key_table(k))
   end subroutine key_limits

   !> Read text in namelist format, in one of the forms in rockfall_handles. Returns a handle and the length of its
   !> values as JSON. `facts` of a case, each 1 or 0: it has trees; sources are points; the source layer gives boulders;
   !> rasters give boulders; impact tables are the default; boulders can have each of the block shapes (3).
   subroutine read_values(form, text, name, handle, facts, length, code, message)
      character(len=*), intent(in) :: form, text, name
      integer(c_int64_t), intent(out) :: handle  !! 0 on error
      integer(c_int), intent(out) :: facts(8), length, code
      character(len=max_message), intent(out) :: message
      type(case_handle_t), pointer :: opened
      type(error_t), allocatable :: error

      allocate (opened)
      call opened%read_values(form, text, name, error)
      call return_values(opened, error, handle, facts, length, code, message)
   end subroutine read_values

   !> Derive a case from another by changes, as in change_namelist; results as returned by read_values.
   subroutine change_case(other, removed, text, name, handle, facts, length, code, message)
      integer(c_int64_t), intent(in) :: other
      character(len=*), intent(in) :: removed, text, name
      integer(c_int64_t), intent(out) :: handle
      integer(c_int), intent(out) :: facts(8), length, code
      character(len=max_message), intent(out) :: message
      type(case_handle_t), pointer :: opened
      type(error_t), allocatable :: error

      allocate (opened)
      call opened%change(case_at(pointer_of(other)), removed, text, name, error)
      call return_values(opened, error, handle, facts, length, code, message)
   end subroutine change_case

   subroutine return_values(opened, error, handle, facts, length, code, message)
      type(case_handle_t), pointer, intent(inout) :: opened
      type(error_t), allocatable, intent(in) :: error
      integer(c_int64_t), intent(out) :: handle
      integer(c_int), intent(out) :: facts(8), length, code
      character(len=max_message), intent(out) :: message

      handle = 0
      facts = 0
      length = 0
      if (allocated(error)) then
         deallocate (opened)
      else
         handle = transfer(c_loc(opened), handle)
         length = len(opened%json)
         associate (case => opened%case)
            facts = merge(1, 0, [case%forest, case%at_points, case%by_feature, case%by_source, case%by_table, &
                                 given_shapes(case)])
         end associate
      end if
      call give_error(error, code, message)
   end subroutine return_values

   !> Values of the groups of a handle as JSON (rockfall_namelist_json).
   subroutine values_of(handle, json, length)
      integer(c_int), intent(in) :: length
      integer(c_int64_t), intent(in) :: handle
      integer(c_int8_t), intent(out) :: json(length)
      type(case_handle_t), pointer :: opened

      opened => case_at(pointer_of(handle))
      json = transfer(opened%json, json)
      deallocate (opened%json)
   end subroutine values_of

   !> Close a handle from read_values or change_case; it becomes invalid.
   subroutine close_values(handle)
      integer(c_int64_t), intent(in) :: handle
      type(case_handle_t), pointer :: opened

      opened => case_at(pointer_of(handle))
      deallocate (opened)
   end subroutine close_values

   !> Strength of the ground for boulders with these numbers, as a standard normal number (theory, eq. 5.25a).
   subroutine strength_deviates(seed, number, deviate, n)
      integer(c_int64_t), intent(in) :: seed
      integer(c_int), intent(in) :: n
      integer(c_int64_t), intent(in) :: number(n)
      real(c_double), intent(out) :: deviate(n)  !! [-]
      type(soil_draw_t) :: soil
      type(normal_table_t) :: table
      integer :: k

      table = normal_table()
      do k = 1, n
         soil = drawn_soil(random_key(seed), table, 0.0_c_double, number(k))
         deviate(k) = soil%deviate
      end do
   end subroutine strength_deviates

   !> Check a row of a ground table that uses a plane of impact tables.
   subroutine check_ground(text, name, code, message)
      character(len=*), intent(in) :: text, name
      integer(c_int), intent(out) :: code
      character(len=max_message), intent(out) :: message
      type(yielding_ground_t) :: ground
      type(error_t), allocatable :: error

      call read_yielding(text, name, ground, error)
      call give_error(error, code, message)
   end subroutine check_ground

   !> Build a one-line error message that refuses a key by a rule.
   subroutine refusal(case, group, number, key, rule, message)
      integer(c_int64_t), intent(in) :: case
      character(len=*), intent(in) :: group, key, rule
      integer(c_int), intent(in) :: number  !! index among groups with this name, from 1
      character(len=max_message), intent(out) :: message
      type(case_handle_t), pointer :: opened
      type(error_t), allocatable :: error
      integer(c_int) :: code

      opened => case_at(pointer_of(case))
      associate (groups => pack(opened%list%group, opened%list%group%name == group))
         call refuse(groups(number), key, rule, error)
      end associate
      call give_error(error, code, message)
   end subroutine refusal

   !> Range [m] of R_b that contains all but a few boulders of a case; the case alone must determine their volumes.
   subroutine usual_radii(case, radii)
      integer(c_int64_t), intent(in) :: case
      real(c_double), intent(out) :: radii(2)
      type(case_handle_t), pointer :: opened

      opened => case_at(pointer_of(case))
      radii = sphere_radius(usual_volumes(opened%case%volumes))
   end subroutine usual_radii

   !> Convert a text to a number by the rules for files; NaN if invalid.
   subroutine decimal(text, value)
      character(len=*), intent(in) :: text
      real(c_double), intent(out) :: value
      integer :: status

      call parse_real(text, value, status)
      if (status /= decimal_ok) value = ieee_value(value, ieee_quiet_nan)
   end subroutine decimal

   !> Radii of spheres [m].
   subroutine sphere_radii(volume, radius, n)
      integer(c_int), intent(in) :: n
      real(c_double), intent(in) :: volume(n)  !! [m3]
      real(c_double), intent(out) :: radius(n)

      radius = sphere_radius(volume)
   end subroutine sphere_radii

   !> Kinetic energy [J] of boulders with these velocities and rotations W = R_b omega [m/s].
   subroutine kinetic_energies(mass, v, w, energy, n)
      integer(c_int), intent(in) :: n
      real(c_double), intent(in) :: mass(n), v(3, n), w(n)  !! [kg], [m/s]
      real(c_double), intent(out) :: energy(n)
      integer :: k

      do k = 1, n
         energy(k) = sum(kinetic_energy(boulder_t(mass=mass(k), radius=1.0_c_double), v(:, k), w(k)))
      end do
   end subroutine kinetic_energies

   !> Ranks of the limits of the interval for a quantile of n numbers, as in limit_rank.
   subroutine limit_ranks(level, n, per_cluster, ranks)
      real(c_double), intent(in) :: level, per_cluster
      integer(c_int64_t), intent(in) :: n
      real(c_double), intent(out) :: ranks(2)

      ranks = [limit_rank(level, n, per_cluster, -1), limit_rank(level, n, per_cluster, 1)]
   end subroutine limit_ranks

   !> Name of the model for an impact table, given its number of columns and the strength of its ground [Pa].
   subroutine table_model(columns, strength, text)
      integer(c_int), intent(in) :: columns
      real(c_double), intent(in) :: strength
      character(len=max_list), intent(out) :: text

      text = model_names(model_of_table(columns, strength))
   end subroutine table_model

   !> R_b [m] of the largest blocks of an impact table, given the table's largest size, the strength of its ground [Pa]
   !> and the R_b for that strength [m]; NaN if undefined.
   subroutine largest_block(size, strength, strength_radius, radius)
      real(c_double), intent(in) :: size, strength, strength_radius
      real(c_double), intent(out) :: radius

      radius = largest_of_table(size, strength, strength_radius)
   end subroutine largest_block

   !> Height of the top edge [m] and capacity [J] of each line of a case, evaluation lines first, then barriers; 0 for
   !> evaluation lines.
   subroutine barriers(case, height, capacity, n)
      integer(c_int64_t), intent(in) :: case
      integer(c_int), intent(in) :: n
      real(c_double), intent(out) :: height(n), capacity(n)
      type(case_handle_t), pointer :: given

      given => case_at(pointer_of(case))
      height = given%case%lines%height
      capacity = given%case%lines%capacity
   end subroutine barriers

   !> Outcomes for boulders that crossed a barrier, as numbered in the table of variables.
   subroutine barrier_outcomes(height, capacity, passing_height, energy, outcome, n)
      integer(c_int), intent(in) :: n
      real(c_double), intent(in) :: height, capacity             !! [m], [J]
      real(c_double), intent(in) :: passing_height(n), energy(n) !! [m], [J]
      integer(c_int8_t), intent(out) :: outcome(n)

      outcome = int(barrier_outcome(height, capacity, passing_height, energy), c_int8_t)
   end subroutine barrier_outcomes

   !> Row k of a table, blank past the end: keys of a case (group|key|kind|most|default|allowed|unit|meaning|file),
   !> parameters of grounds (also |models), models of grounds (name|rocks, as in rockfall_grounds), result variables
   !> (variable_text), scene arrays (scene_array_text).
   subroutine table_row(table, k, text)
      character(len=*), intent(in) :: table
      integer(c_int), intent(in) :: k
      character(len=max_list), intent(out) :: text

      text = ""
      if (table == "keys" .and. k >= 1 .and. k <= n_keys) text = key_text(key_table(k))
      if (table == "ground_parameters") text = parameter_of_ground(k)
      if (table == "ground_models" .and. k >= 1 .and. k <= size(model_names)) &
         text = trim(model_names(k))//"|"//integer_text(rocks_of_model(k))
      if (table == "variables") text = variable_text(k)
      if (table == "scene") text = scene_array_text(k)
   end subroutine table_row

   !> Root L of a covariance C = L L^T, used for all draws.
   subroutine covariance_root(name, covariance, root, code, message, n)
      integer(c_int), intent(in) :: n
      character(len=*), intent(in) :: name                 !! name of the covariance, for messages
      real(c_double), intent(in) :: covariance(n, n)       !! any [unit]
      real(c_double), intent(out) :: root(n, n)
      integer(c_int), intent(out) :: code                  !! 0 = success
      character(len=max_message), intent(out) :: message
      real(c_double) :: drawn(n, n)
      type(error_t), allocatable :: error

      call find_root(name, covariance, root, drawn, error)
      call give_error(error, code, message)
   end subroutine covariance_root

   !> Numbers of the five impact sets in a text, as in coefficients_t, for a turning rule.
   subroutine read_sets(text, name, turning, draw, mean, covariance, incidence, lateral, ranges, draws, code, message)
      character(len=*), intent(in) :: text, name
      character(len=*), intent(in) :: turning  !! word as in a case
      integer(c_int), intent(in) :: draw       !! index of the draw; 0: the text must have a single draw
      real(c_double), intent(out) :: mean(n_set_numbers, n_impact_sets), &
                                     covariance(n_set_numbers, n_set_numbers, n_impact_sets), &
                                     incidence(n_incidence_limits, n_impact_sets), &
                                     lateral(n_lateral_quantiles, n_lateral_classes, n_impact_sets)
      real(c_double), intent(out) :: ranges(2, n_impact_sets, 2)  !! ranges of speeds [m/s], then of angles [degree]
      integer(c_int), intent(out) :: draws, code
      character(len=max_message), intent(out) :: message
      type(coefficients_t) :: sets
      type(error_t), allocatable :: error

      call read_impact_sets(text, name, turning_rule(turning), draw, sets, error, draws)
      mean = sets%mean
      covariance = sets%covariance
      incidence = sets%incidence
      lateral = sets%lateral
      ranges(:, :, 1) = sets%speed_range
      ranges(:, :, 2) = sets%angle_range
      call give_error(error, code, message)
   end subroutine read_sets

   !> Probability of each impact set, given a ratio R_b/R_m.
   subroutine weights_of_sets(ratio, between, weights)
      real(c_double), intent(in) :: ratio  !! R_b/R_m [-]
      integer(c_int), intent(in) :: between  !! stochastic interpolation between sets: 1 or 0
      real(c_double), intent(out) :: weights(n_impact_sets)

      weights = ratio_weights(ratio, between /= 0)
   end subroutine weights_of_sets

   !> Impact set, 1 to 5, for each ratio R_b/R_m.
   subroutine ratio_classes(ratio, class, n)
      integer(c_int), intent(in) :: n
      real(c_double), intent(in) :: ratio(n)  !! R_b/R_m [-]
      integer(c_int), intent(out) :: class(n)
      logical :: outside
      integer :: k

      do k = 1, n
         call find_nearest_set(ratio(k), class(k), outside)
      end do
   end subroutine ratio_classes

   !> Return whether rebounds are admissible, given V_t, V_n, W [m/s] before and after.
   subroutine admissible_rebounds(v_in, v_out, may, n)
      integer(c_int), intent(in) :: n
      real(c_double), intent(in) :: v_in(3, n), v_out(3, n)
      integer(c_int), intent(out) :: may(n)  !! 1 or 0
      integer :: k

      may = [(merge(1, 0, is_admissible(v_in(:, k), v_out(:, k))), k=1, n)]
   end subroutine admissible_rebounds

   !> Limit rebounds in the same way as the kernel.
   subroutine limit_rebounds(v_in, v_out, n)
      integer(c_int), intent(in) :: n
      real(c_double), intent(in) :: v_in(3, n)  !! V_t, V_n, W [m/s]
      real(c_double), intent(inout) :: v_out(3, n)  !! V_t, V_n, W [m/s]
      integer :: k

      do k = 1, n
         call limit_rebound(v_out(:, k), v_in(:, k))
      end do
   end subroutine limit_rebounds

   !> Ratio of radius to Rg, given the word in a case.
   subroutine size_to_radius(reading, factor)
      character(len=*), intent(in) :: reading
      real(c_double), intent(out) :: factor

      factor = radius_of_reading(reading)
   end subroutine size_to_radius

   !> Constant of the kernel by name; NaN for unknown names.
   subroutine constant(name, value)
      character(len=*), intent(in) :: name
      real(c_double), intent(out) :: value

      select case (name)
      case ("any_speed"); value = any_speed          ! stands for no upper limit of a set's speeds [m/s]
      case ("inertia_factor"); value = inertia_factor  ! [-]
      case ("min_normal"); value = min_normal
      case ("shapes"); value = shapes                ! block shapes of boulders
      case ("sphere"); value = sphere                ! default shape of boulders
      case ("first_chunk"); value = real(first_chunk, c_double)  ! boulders in the first chunk
      case ("max_speed"); value = max_speed         ! maximum speed of a boulder [m/s]
      case ("max_draws"); value = max_draws          ! maximum number of draws per rebound
      case ("left_window"); value = left_window      ! status of a boulder to be rerun in a larger window
      case ("max_text"); value = max_text            ! [bytes]
      case ("max_elevation"); value = max_elevation  ! [m]
      case ("max_real"); value = max_real            ! maximum absolute number in a case
      case ("max_name"); value = max_name            ! [characters]
      case ("max_held_speed"); value = max_held_speed  ! maximum speed of a held boulder, over sqrt(g R_b)
      case ("usual_density"); value = usual_density  ! usual density of boulders [kg/m3]
      case ("usual_weight"); value = usual_weight    ! weight per volume of boulders [N/m3]
      case ("lanes"); value = lanes                  ! number of boulders that a thread processes together
      case ("max_grounds"); value = max_grounds      ! maximum number of grounds in a scene
      case ("save_rest"); value = save_rest          ! minimum pause between saves, over the duration of the last save
      case ("chunk_crossings"); value = real(chunk_crossings, c_double)
      case ("z_95"); value = z_95                    ! [-]
      case ("min_for_mean"); value = min_for_mean    ! number of passages for a reliable interval of a mean
      case ("min_for_std"); value = min_for_std
      case ("scene_layout"); value = scene_layout
      case ("part_layout"); value = part_layout
      case ("piece"); value = piece                  ! values per checksum
      case ("max_packing"); value = max_packing
      case ("sample_bins"); value = n_sample_bins
      case ("coarse_bins"); value = n_coarse_bins
      case ("base_bits"); value = base_bits          ! bits per digit of a sum
      case ("sample_tails"); value = n_tails         ! number of line quantities that have tails; they come first
      case ("sample_quantities"); value = n_quantities
      case ("max_columns"); value = max_columns      ! maximum number of columns of bin counts
      case default; value = ieee_value(value, ieee_quiet_nan)
      end select
   end subroutine constant

   !> Constant numbers of the kernel by name. `n` is their number, at most `room`; 0 for unknown names.
   subroutine constants(name, values, n, room)
      integer(c_int), intent(in) :: room
      character(len=*), intent(in) :: name
      real(c_double), intent(out) :: values(room)
      integer(c_int), intent(out) :: n
      real(c_double), allocatable :: found(:)
      integer :: k

      allocate (found(0))
      select case (name)
      case ("block_axes"); found = [block_axes]  ! axes of the shapes over the longest axis, (3, shapes) [-]
      case ("size_weights"); found = size_weights  ! probabilities of the obstacle sizes of method A
      case ("ead_energy"); found = ead_energy    ! maximum energy of each class of EAD 340059, from class 0 [J]
      case ("sample_units"); found = [units_of]  ! units per SI unit: quantities (rows), at lines and at ends (columns)
      case ("sample_edges")  ! edges of sample bins, in the units of sample_units; too many for the stack
         deallocate (found)
         allocate (found(n_sample_bins + 1))
         do k = 1, size(found)
            found(k) = sample_edge(k)
         end do
      case ("histogram_bins"); found = n_bins    ! number for each histogram, in the order of rockfall_histogram
      case ("histogram_widths"); found = bin_width
      end select
      n = min(room, size(found))
      values = 0
      values(:n) = found(:n)
   end subroutine constants

   !> Names of row columns, volume distributions, sample quantities, and case items: groups of lines, groups that may
   !> repeat, strengths of barriers.
   subroutine fields(rows, text)
      character(len=*), intent(in) :: rows
      character(len=max_list), intent(out) :: text

      select case (rows)
      case ("boulder"); text = joined(boulder_fields, " ")
      case ("count"); text = joined(boulder_counts, " ")
      case ("crossing"); text = joined(crossing_fields, " ")
      case ("vertex"); text = joined(vertex_fields, " ")
      case ("energy"); text = joined(energy_fields, " ")
      case ("feature"); text = joined(feature_fields, " ")
      case ("distribution"); text = joined(distributions, " ")
      case ("block_shape"); text = joined(block_shapes, " ")
      case ("line_quantity"); text = joined(line_quantity, " ")
      case ("end_quantity"); text = joined(end_quantity, " ")
      case ("line_group"); text = joined(line_groups, " ")
      case ("repeatable_group"); text = joined(repeatable, " ")
      case ("strength"); text = joined(barrier_strengths, " ")
      case default; text = ""
      end select
   end subroutine fields

   !> Number of threads used for a requested number.
   subroutine team(threads, size)
      integer(c_int), intent(in) :: threads
      integer(c_int), intent(out) :: size

      size = team_size(threads)
   end subroutine team

   !> Check that the process has memory for the threads: code 0, or a one-line error message.
   subroutine team_fits(threads, code, message)
      integer(c_int), intent(in) :: threads
      integer(c_int), intent(out) :: code
      character(len=max_message), intent(out) :: message
      type(error_t), allocatable :: error

      call check_team(threads, error)
      call give_error(error, code, message)
   end subroutine team_fits

   !> End idle threads before a fork: the child process would lack them and wait for them forever.
   subroutine end_team()
      call release_team()
   end subroutine end_team
end module rockfall_f2py
