! SPDX-License-Identifier: BSD-3-Clause
!> Cases, scenes and runs behind handles, for callers in other languages. A case is read once, and other cases are
!> derived from it; an empty scene receives its arrays by name and is built once; runs advance in chunks and list their
!> arrays. This module checks the requests of callers.
module rockfall_handles
   use, intrinsic :: iso_c_binding, only: c_ptr, c_f_pointer
   use rockfall_kinds, only: wp, sp, i4, i8
   use rockfall_error, only: error_t, fail
   use rockfall_grid, only: grid_t
   use rockfall_terrain, only: terrain_t, terrain, set_window
   use rockfall_scene_type, only: scene_t
   use rockfall_maps, only: maps_t
   use rockfall_map_values, only: map_row
   use rockfall_map_tallies, only: views_of
   use rockfall_threads, only: check_team, team_size
   use rockfall_namelist, only: namelist_t, parse_namelist
   use rockfall_namelist_changes, only: change_namelist
   use rockfall_namelist_json, only: json_of
   use rockfall_case_keys, only: map_names, key_table, read_keys, complete_keys, default_keys
   use rockfall_case_effects, only: mark_defaults
   use rockfall_case, only: case_t, case_of_keys
   use rockfall_bounds, only: boulder_count
   use rockfall_scene_arrays, only: scene_arrays_t
   use rockfall_scene, only: build_scene_of_case
   use rockfall_line_samples, only: layout_t
   use rockfall_state_table, only: array_t, table_t
   use rockfall_run_state, only: run_t, open_run, open_joined_run, continue_run, close_run, arrays_of, &
                                 advance_run => advance
   use rockfall_part, only: part_t, part_arrays
   use rockfall_run_loop, only: scan_terrain
   implicit none
   private
   public :: case_handle_t, scene_handle_t, run_handle_t, case_at, scene_at, run_at, new_scene, close_handle
   public :: give, limit, boulders_of

   !> Case behind a handle, or other namelist text that only provides groups.
   type :: case_handle_t
      type(namelist_t) :: list
      type(case_t) :: case
      character(len=:), allocatable :: json  !! values of the groups (rockfall_namelist_json)
   contains
      procedure :: read_values, change, finish
   end type case_handle_t

   !> Scene behind a handle.
   type :: scene_handle_t
      type(scene_t) :: scene
      type(terrain_t) :: dem  !! terrain covered by the arrays
      type(case_t) :: case
      type(scene_arrays_t), allocatable :: arrays  !! arrays until the scene is built
   contains
      procedure :: build, terrain_known
   end type scene_handle_t

   !> Run behind a handle.
   type :: run_handle_t
      type(run_t) :: run
      type(scene_handle_t), pointer :: scene => null()  !! scene of the run, if any
      type(part_t) :: part    !! part with arrays as in files, to be written, or as read
      type(table_t) :: table  !! arrays of the run or of its part, as last listed
   contains
      procedure :: begin, begin_joined, begin_continued, advance, list, write_map
   end type run_handle_t

contains

   !> Read the groups of a text. `form` is "case" (values are checked and completed), "defaults" (any text; all groups
   !> of a case are added), or "any" (unknown groups and keys are allowed).
   subroutine read_values(this, form, text, name, error)
      class(case_handle_t), intent(inout) :: this
      character(len=*), intent(in) :: form, text, name  !! text; `form`; name of the text for messages
      type(error_t), allocatable, intent(out) :: error

      select case (form)
      case ("case")
         call read_keys(text, name, this%list, error)
         if (.not. allocated(error)) call this%finish(name, error)
      case ("defaults")
         call default_keys(this%list)
         this%json = json_of(this%list, key_table)
      case default
         call parse_namelist(text, name, this%list, error)
         if (.not. allocated(error)) this%json = json_of(this%list, key_table(:0))
      end select
   end subroutine read_values

   !> Derive a case from another by changes in text, as in change_namelist.
   subroutine change(this, other, removed, text, name, error)
      class(case_handle_t), intent(inout) :: this
      type(case_handle_t), intent(in) :: other
      character(len=*), intent(in) :: removed, text, name
      type(error_t), allocatable, intent(out) :: error
      type(namelist_t) :: new

      call parse_namelist(text, name, new, error)
      if (.not. allocated(error)) call change_namelist(other%list, removed, new, name, this%list, error)
      if (.not. allocated(error)) call complete_keys(this%list, name, error)
      if (.not. allocated(error)) call this%finish(name, error)
   end subroutine change

   !> Check the rules between the keys of a case, and mark keys that have defaults.
   subroutine finish(this, name, error)
      class(case_handle_t), intent(inout) :: this
      character(len=*), intent(in) :: name
      type(error_t), allocatable, intent(out) :: error

      call case_of_keys(this%list, name, this%case, error)
      if (allocated(error)) return
      call mark_defaults(this%list)
      this%json = json_of(this%list, key_table)
   end subroutine finish

   function case_at(at) result(case)
      type(c_ptr), intent(in) :: at
      type(case_handle_t), pointer :: case

      call c_f_pointer(at, case)
   end function case_at

   function scene_at(at) result(scene)
      type(c_ptr), intent(in) :: at
      type(scene_handle_t), pointer :: scene

      call c_f_pointer(at, scene)
   end function scene_at

   function run_at(at) result(run)
      type(c_ptr), intent(in) :: at
      type(run_handle_t), pointer :: run

      call c_f_pointer(at, run)
   end function run_at

   !> Create an empty scene.
   function new_scene(grid, first, draw) result(scene)
      type(grid_t), intent(in) :: grid
      integer, intent(in) :: first(2)  !! column and row of the first array element
      integer, intent(in) :: draw      !! index of the draw of the impact sets; 0: the only draw
      type(scene_handle_t), pointer :: scene

      allocate (scene)
      allocate (scene%arrays)
      scene%arrays%grid = grid
      scene%arrays%first = first
      scene%arrays%draw = draw
   end function new_scene

   !> Pass an array to a scene, as in set_array. No effect once the scene is built.
   subroutine give(this, name, kind, length, at)
      type(scene_handle_t), intent(inout) :: this
      character(len=*), intent(in) :: name, kind
      integer(i8), intent(in) :: length(3)
      type(c_ptr), intent(in) :: at

      if (allocated(this%arrays)) call this%arrays%set_array(name, kind, length, at)
   end subroutine give

   !> Build a scene from a case and its arrays.
   subroutine build(this, case, error)
      class(scene_handle_t), intent(inout) :: this
      type(case_t), intent(in) :: case
      type(error_t), allocatable, intent(out) :: error

      if (.not. allocated(this%arrays)) then
         call fail(error, case%file//": the scene is already built")
      else if (.not. is_complete(this%arrays)) then
         call fail(error, case%file//": arrays elevation, source_x, source_y and impact_sets are required")
      else
         if (.not. allocated(this%arrays%sets_name)) this%arrays%sets_name = "impact_sets"
         this%case = case
         call build_scene_of_case(case, this%arrays, this%scene, error)
         if (allocated(error)) return
         this%dem = this%scene%dem
         deallocate (this%arrays)
      end if
   end subroutine build

   !> Return whether all arrays required by every scene were passed.
   pure logical function is_complete(arrays)
      type(scene_arrays_t), intent(in) :: arrays

      is_complete = (associated(arrays%z8) .or. associated(arrays%z4)) .and. allocated(arrays%source_x) &
                    .and. allocated(arrays%source_y) .and. allocated(arrays%sets_text)
   end function is_complete

   !> Terrain of a scene that has received elevations; the scene need not be built.
   type(terrain_t) function terrain_known(this) result(dem)
      class(scene_handle_t), intent(in) :: this

      dem = this%dem
      if (.not. allocated(this%arrays)) return
      associate (arrays => this%arrays, grid => this%arrays%grid)
         dem = terrain(grid%west, grid%north, grid%cell, arrays%z8, arrays%z4, [grid%nx, grid%ny], arrays%first)
      end associate
   end function terrain_known

   !> Confine boulders to these columns and rows of the maps. All runs of a scene must have the same limits.
   subroutine limit(this, first, last)
      type(scene_handle_t), intent(inout) :: this
      integer, intent(in) :: first(2), last(2)

      this%scene%dem = this%dem
      call set_window(this%scene%dem, first, last)
   end subroutine limit

   !> Number of boulders of a scene; 0 until it is built.
   pure integer(i8) function boulders_of(this) result(boulders)
      type(scene_handle_t), intent(in) :: this

      boulders = 0
      if (.not. allocated(this%arrays)) boulders = boulder_count(this%scene)
   end function boulders_of

   !> Open a run of n boulders of a scene after the first `before`, with maps of a window (first column and row, numbers
   !> of columns and rows). The default is the box of cells that boulders can reach; the scene is then confined to it.
   subroutine begin(this, scene, before, n, threads, error, window, max_columns)
      class(run_handle_t), intent(inout) :: this
      type(scene_handle_t), pointer, intent(in) :: scene
      integer(i8), intent(in) :: before, n
      integer, intent(in) :: threads  !! 0: all cores
      type(error_t), allocatable, intent(out) :: error
      integer, intent(in), optional :: window(4)
      integer(i8), intent(in), optional :: max_columns  !! as in map_tallies_t
      integer :: cells(4)

      if (allocated(scene%arrays)) then
         call fail(error, "the scene has not been built")
      else if (before < 0 .or. n < 1 .or. before > boulders_of(scene) - n) then
         call fail(error, "the boulder range of the run exceeds the boulders of the scene")
      else
         call check_team(threads, error)
      end if
      if (allocated(error)) return
      this%scene => scene
      this%run%threads = team_size(threads)
      if (present(max_columns)) this%run%maps%max_columns = max_columns
      cells = [1, 1, scene%dem%nx, scene%dem%ny]
      if (present(window)) then
         cells = window
      else
         call scan_terrain(scene%case, scene%scene, cells, error)
         if (allocated(error)) return
         call limit(scene, cells(:2), cells(:2) + cells(3:) - 1)
      end if
      call open_run(scene%case, scene%scene, before, n, cells, this%run, error)
   end subroutine begin

   !> Open a run without a scene, as in open_joined_run.
   subroutine begin_joined(this, case, boulders, window, grounds, features, shapes, part_last, group_part, error)
      class(run_handle_t), intent(inout) :: this
      type(case_t), intent(in) :: case
      integer(i8), intent(in) :: boulders(3)  !! number in the complete run, before the part, and in the part
      integer, intent(in) :: window(4), grounds
      logical, intent(in) :: features, shapes
      integer(i4), intent(in) :: part_last(:), group_part(:)  !! as in layout_t
      type(error_t), allocatable, intent(out) :: error
      type(layout_t) :: layout

      layout%part_last = part_last
      layout%group_part = group_part
      call open_joined_run(case, boulders(1), boulders(2), boulders(3), window, grounds, features, shapes, layout, &
                           this%run, error)
   end subroutine begin_joined

   !> Open a run of a scene, as continue_run of rockfall_run_state.
   subroutine begin_continued(this, scene, other, error)
      class(run_handle_t), intent(inout) :: this
      type(scene_handle_t), pointer, intent(in) :: scene
      class(run_handle_t), intent(inout) :: other
      type(error_t), allocatable, intent(out) :: error

      this%scene => scene
      call continue_run(scene%case, scene%scene, other%run, this%run, error)
   end subroutine begin_continued

   !> Run boulders, as advance of rockfall_run_state.
   subroutine advance(this, scene, first, step, n, seconds, done, error)
      class(run_handle_t), intent(inout) :: this
      type(scene_t), intent(in) :: scene
      integer(i8), intent(in) :: first, step, n
      real(wp), intent(in) :: seconds  !! [s]
      integer(i8), intent(out) :: done
      type(error_t), allocatable, intent(out) :: error

      associate (last => this%run%before + this%run%boulders)
         if (n < 0 .or. first <= this%run%before .or. first + (n - 1)*step > last) then
            done = 0
            call fail(error, "the run has fewer remaining boulders")
            return
         end if
      end associate
      call advance_run(this%run, scene, first, step, n, seconds, done, error)
   end subroutine advance

   !> Array k of a run, or of its part, from 1; null past the last. A call with k = 1 renews the list.
   function list(this, k, of_part) result(row)
      class(run_handle_t), intent(inout), target :: this
      integer, intent(in) :: k
      logical, intent(in) :: of_part
      type(array_t), pointer :: row

      if (k == 1 .and. of_part) this%table = part_arrays(this%run, this%part)
      if (k == 1 .and. .not. of_part) this%table = arrays_of(this%run)
      row => null()
      if (.not. allocated(this%table%row)) return
      if (k >= 1 .and. k <= size(this%table%row)) row => this%table%row(k)
   end function list

   !> Compute a requested map that has one layer, on the cells of the run's maps.
   subroutine write_map(this, name, done, per_cluster, values, error)
      class(run_handle_t), intent(in) :: this
      character(len=*), intent(in) :: name
      integer(i8), intent(in) :: done         !! number of completed boulders
      integer(i8), intent(in) :: per_cluster  !! number of boulders that may behave alike; 1: independent
      real(sp), intent(inout) :: values(:, :)
      type(error_t), allocatable, intent(out) :: error
      type(maps_t) :: maps
      integer :: j

      if (.not. any(this%run%map .and. map_names == name)) then
         call fail(error, name//": must be one of the maps in &output maps")
      else if (index(name, "exceeded") > 0) then
         call fail(error, name//": has one layer per threshold: use tally_counts")
      end if
      if (allocated(error)) return
      maps = views_of(this%run%maps, [1, 1])
      do j = 1, size(values, 2)
         call map_row(maps, name, j, done, per_cluster, this%run%min_passages, values(:, j))
      end do
   end subroutine write_map

   !> Free a run.
   subroutine close_handle(run)
      type(run_handle_t), pointer, intent(inout) :: run

      call close_run(run%run)
      deallocate (run)
   end subroutine close_handle
end module rockfall_handles
