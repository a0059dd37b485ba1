! SPDX-License-Identifier: BSD-3-Clause
!> C interface of the kernel (include/rockfall.h): a scene and its runs behind handles, arrays by name.
module rockfall_c
   use, intrinsic :: iso_c_binding, only: c_char, c_double, c_float, c_int, c_int32_t, c_int64_t, c_null_char, &
                                          c_null_ptr, c_ptr, c_loc, c_f_pointer, c_associated
   use rockfall_error, only: error_t, fail
   use rockfall_grid, only: grid_t
   use rockfall_terrain, only: set_window
   use rockfall_scene_type, only: scene_t
   use rockfall_maps, only: maps_t
   use rockfall_map_values, only: map_row
   use rockfall_threads, only: check_team, team_size
   use rockfall_case_keys, only: map_names
   use rockfall_case, only: case_t, read_case
   use rockfall_scene, only: scene_arrays_t, build_scene_of_case, boulder_count
   use rockfall_state_table, only: table_t, row_text
   use rockfall_run_state, only: run_t, open_run, close_run, advance, arrays_of, map_tallies
   use rockfall_run_loop, only: scan_terrain
   implicit none
   private
   public :: c_new_scene, c_give, c_build_scene, c_boulders, c_close_scene
   public :: c_open_run, c_advance, c_array, c_map, c_close_run

   integer, parameter :: message_length = 1024, text_length = 256  !! as in the header, with the final zero

   !> Scene behind a handle.
   type :: open_scene_t
      type(scene_t) :: scene
      type(case_t) :: case
      type(scene_arrays_t) :: arrays
      logical :: is_built = .false.
   end type open_scene_t

   !> Run behind a handle.
   type :: open_run_t
      type(run_t) :: run
      type(table_t) :: table  !! table of its arrays
      type(open_scene_t), pointer :: of => null()
   end type open_run_t

contains

   function c_new_scene(west, north, cell, nx, ny) result(handle) bind(c, name="rockfall_new_scene")
      real(c_double), value :: west, north, cell
      integer(c_int32_t), value :: nx, ny
      type(c_ptr) :: handle
      type(open_scene_t), pointer :: opened

      allocate (opened)
      opened%arrays%grid = grid_t(west, north, cell, nx, ny)
      handle = c_loc(opened)
   end function c_new_scene

   subroutine c_give(handle, name, kind, length, values) bind(c, name="rockfall_give")
      type(c_ptr), value :: handle, values
      character(kind=c_char), intent(in) :: name(*), kind(*)
      integer(c_int64_t), intent(in) :: length(3)
      type(open_scene_t), pointer :: opened

      call c_f_pointer(handle, opened)
      call opened%arrays%set_array(text_of(name), text_of(kind), length, values)
   end subroutine c_give

   integer(c_int) function c_build_scene(handle, text, name, message) result(code) bind(c, name="rockfall_build_scene")
      type(c_ptr), value :: handle
      character(kind=c_char), intent(in) :: text(*), name(*)
      character(kind=c_char), intent(out) :: message(message_length)
      type(open_scene_t), pointer :: opened
      type(error_t), allocatable :: error

      call c_f_pointer(handle, opened)
      if (opened%is_built) then
         call fail(error, text_of(name)//": the scene has been built")
      else if (.not. has_arrays(opened%arrays)) then
         call fail(error, text_of(name)//": arrays elevation, source_x, source_y and impact_sets are needed")
      else
         if (.not. allocated(opened%arrays%sets_name)) opened%arrays%sets_name = "impact_sets"
         call read_case(text_of(text), text_of(name), opened%case, error)
         if (.not. allocated(error)) call build_scene_of_case(opened%case, opened%arrays, opened%scene, error)
         opened%is_built = .not. allocated(error)
      end if
      call give(error, code, message)
   end function c_build_scene

   !> Return whether the arrays are given without which no scene can be built.
   pure logical function has_arrays(arrays)
      type(scene_arrays_t), intent(in) :: arrays

      has_arrays = (associated(arrays%z8) .or. associated(arrays%z4)) .and. allocated(arrays%source_x) &
                   .and. allocated(arrays%source_y) .and. allocated(arrays%sets_text)
   end function has_arrays

   integer(c_int64_t) function c_boulders(handle) result(boulders) bind(c, name="rockfall_boulders")
      type(c_ptr), value :: handle
      type(open_scene_t), pointer :: opened

      call c_f_pointer(handle, opened)
      boulders = 0
      if (opened%is_built) boulders = boulder_count(opened%scene)
   end function c_boulders

   subroutine c_close_scene(handle) bind(c, name="rockfall_close_scene")
      type(c_ptr), value :: handle
      type(open_scene_t), pointer :: opened

      if (.not. c_associated(handle)) return
      call c_f_pointer(handle, opened)
      deallocate (opened)
   end subroutine c_close_scene

   integer(c_int) function c_open_run(handle, before, boulders, threads, run, message) result(code) &
      bind(c, name="rockfall_open_run")
      type(c_ptr), value :: handle
      integer(c_int64_t), value :: before, boulders
      integer(c_int), value :: threads
      type(c_ptr), intent(out) :: run
      character(kind=c_char), intent(out) :: message(message_length)
      type(open_scene_t), pointer :: scene
      type(open_run_t), pointer :: opened
      type(error_t), allocatable :: error
      integer :: window(4)

      call c_f_pointer(handle, scene)
      run = c_null_ptr
      if (.not. scene%is_built) then
         call fail(error, "the scene has not been built")
      else if (before < 0 .or. boulders < 1 .or. before > boulder_count(scene%scene) - boulders) then
         call fail(error, "the boulders of a run must be some of the scene's")
      else
         call check_team(threads, error)
      end if
      if (.not. allocated(error)) then
         allocate (opened)
         window = [1, 1, scene%scene%dem%nx, scene%scene%dem%ny]
         call scan_terrain(scene%case, scene%scene, window, error)
         if (.not. allocated(error)) then
            opened%run%threads = team_size(threads)
            call open_run(scene%case, scene%scene, before, boulders, window, opened%run, error)
         end if
         if (allocated(error)) then
            deallocate (opened)
         else
            call set_window(scene%scene%dem, opened%run%at, opened%run%at + opened%run%nodes - 1)
            opened%of => scene
            run = c_loc(opened)
         end if
      end if
      call give(error, code, message)
   end function c_open_run

   integer(c_int) function c_advance(run, n, message) result(code) bind(c, name="rockfall_advance")
      type(c_ptr), value :: run
      integer(c_int64_t), value :: n
      character(kind=c_char), intent(out) :: message(message_length)
      type(open_run_t), pointer :: opened
      type(error_t), allocatable :: error

      call c_f_pointer(run, opened)
      associate (state => opened%run)
         if (n < 0 .or. n > state%boulders - state%done) then
            call fail(error, "the run does not have so many boulders left")
         else
            call advance(state, opened%of%scene, state%before + state%done + 1, 1_c_int64_t, n, error)
         end if
      end associate
      call give(error, code, message)
   end function c_advance

   integer(c_int) function c_array(run, k, text, length, at) result(is_there) bind(c, name="rockfall_array")
      type(c_ptr), value :: run
      integer(c_int), value :: k
      character(kind=c_char), intent(out) :: text(text_length)
      integer(c_int64_t), intent(out) :: length(4)
      type(c_ptr), intent(out) :: at
      type(open_run_t), pointer :: opened

      call c_f_pointer(run, opened)
      if (k == 0) opened%table = arrays_of(opened%run)
      is_there = 0
      if (.not. allocated(opened%table%row)) return
      if (k < 0 .or. k >= size(opened%table%row)) return
      is_there = 1
      associate (row => opened%table%row(k + 1))
         call put(row_text(row), text)
         length = row%length
         at = row%at
      end associate
   end function c_array

   integer(c_int) function c_map(run, name, per_cluster, values, message) result(code) bind(c, name="rockfall_map")
      type(c_ptr), value :: run
      character(kind=c_char), intent(in) :: name(*)
      integer(c_int64_t), value :: per_cluster
      real(c_float), intent(inout) :: values(*)
      character(kind=c_char), intent(out) :: message(message_length)
      type(open_run_t), pointer :: opened
      type(maps_t) :: maps
      type(error_t), allocatable :: error
      integer :: j

      call c_f_pointer(run, opened)
      if (.not. any(pack(map_names, opened%of%case%map) == text_of(name))) then
         call fail(error, text_of(name)//": must be one of &output maps")
      else if (index(text_of(name), "exceeded") > 0) then
         call fail(error, text_of(name)//": has a layer for each threshold: take them from tally_counts")
      end if
      if (.not. allocated(error)) then
         associate (nodes => opened%run%nodes, case => opened%of%case)
            maps = map_tallies(opened%run, [1, 1])
            do j = 1, nodes(2)
               call map_row(maps, text_of(name), j, opened%run%done, per_cluster, case%min_passages, &
                            values((j - 1)*nodes(1) + 1:j*nodes(1)))
            end do
         end associate
      end if
      call give(error, code, message)
   end function c_map

   subroutine c_close_run(run) bind(c, name="rockfall_close_run")
      type(c_ptr), value :: run
      type(open_run_t), pointer :: opened

      if (.not. c_associated(run)) return
      call c_f_pointer(run, opened)
      call close_run(opened%run)
      deallocate (opened)
   end subroutine c_close_run

   !> Text of a C string.
   pure function text_of(string) result(text)
      character(kind=c_char), intent(in) :: string(*)
      character(len=:), allocatable :: text
      integer :: n, k

      n = 0
      do while (string(n + 1) /= c_null_char)
         n = n + 1
      end do
      allocate (character(len=n) :: text)
      do k = 1, n
         text(k:k) = string(k)
      end do
   end function text_of

   !> Write a text as a C string, cut to the room that there is.
   pure subroutine put(text, string)
      character(len=*), intent(in) :: text
      character(kind=c_char), intent(out) :: string(:)
      integer :: k, n

      n = min(len_trim(text), size(string) - 1)
      do k = 1, n
         string(k) = text(k:k)
      end do
      string(n + 1:) = c_null_char
   end subroutine put

   pure subroutine give(error, code, message)
      type(error_t), allocatable, intent(in) :: error
      integer(c_int), intent(out) :: code
      character(kind=c_char), intent(out) :: message(:)

      code = 0
      message = c_null_char
      if (.not. allocated(error)) return
      code = error%code
      call put(error%message, message)
   end subroutine give
end module rockfall_c
