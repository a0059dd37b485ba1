! SPDX-License-Identifier: BSD-3-Clause
!> C interface of the kernel (include/rockfall.h): rockfall_handles with C types and strings.
module rockfall_c
   use, intrinsic :: iso_c_binding, only: c_char, c_double, c_float, c_int, c_int32_t, c_int64_t, c_null_char, &
                                          c_null_ptr, c_ptr, c_loc, c_associated
   use rockfall_error, only: error_t, fault_mark
   use rockfall_dimensions, only: max_message, max_array_row
   use rockfall_grid, only: grid_t
   use rockfall_case, only: case_t, read_case
   use rockfall_state_table, only: array_t, row_text
   use rockfall_run_state, only: sort_crossings
   use rockfall_handles, only: scene_handle_t, run_handle_t, scene_at, run_at, new_scene, close_handle, &
                               give, boulders_of
   implicit none
   private
   public :: c_new_scene, c_give, c_build_scene, c_boulders, c_close_scene
   public :: c_open_run, c_advance, c_array, c_map, c_close_run

contains

   function c_new_scene(west, north, cell, nx, ny) result(handle) bind(c, name="rockfall_new_scene")
      real(c_double), value :: west, north, cell
      integer(c_int32_t), value :: nx, ny
      type(c_ptr) :: handle
      type(scene_handle_t), pointer :: scene

      scene => new_scene(grid_t(west, north, cell, nx, ny), [1, 1], 0)
      handle = c_loc(scene)
   end function c_new_scene

   subroutine c_give(handle, name, kind, length, values) bind(c, name="rockfall_give")
      type(c_ptr), value :: handle, values
      character(kind=c_char), intent(in) :: name(*), kind(*)
      integer(c_int64_t), intent(in) :: length(3)

      call give(scene_at(handle), text_of(name), text_of(kind), length, values)
   end subroutine c_give

   integer(c_int) function c_build_scene(handle, text, name, message) result(code) bind(c, name="rockfall_build_scene")
      type(c_ptr), value :: handle
      character(kind=c_char), intent(in) :: text(*), name(*)
      character(kind=c_char), intent(out) :: message(max_message)
      type(scene_handle_t), pointer :: scene
      type(error_t), allocatable :: error
      type(case_t) :: case

      scene => scene_at(handle)
      call read_case(text_of(text), text_of(name), case, error)
      if (.not. allocated(error)) call scene%build(case, error)
      call return_error(error, code, message)
   end function c_build_scene

   integer(c_int64_t) function c_boulders(handle) result(boulders) bind(c, name="rockfall_boulders")
      type(c_ptr), value :: handle

      boulders = boulders_of(scene_at(handle))
   end function c_boulders

   subroutine c_close_scene(handle) bind(c, name="rockfall_close_scene")
      type(c_ptr), value :: handle
      type(scene_handle_t), pointer :: scene

      if (.not. c_associated(handle)) return
      scene => scene_at(handle)
      deallocate (scene)
   end subroutine c_close_scene

   integer(c_int) function c_open_run(handle, before, boulders, threads, run, message) result(code) &
      bind(c, name="rockfall_open_run")
      type(c_ptr), value :: handle
      integer(c_int64_t), value :: before, boulders
      integer(c_int), value :: threads
      type(c_ptr), intent(out) :: run
      character(kind=c_char), intent(out) :: message(max_message)
      type(run_handle_t), pointer :: opened
      type(error_t), allocatable :: error

      allocate (opened)
      call opened%begin(scene_at(handle), before, boulders, threads, error)
      run = c_loc(opened)
      if (allocated(error)) then
         call close_handle(opened)
         run = c_null_ptr
      end if
      call return_error(error, code, message)
   end function c_open_run

   integer(c_int) function c_advance(handle, n, message) result(code) bind(c, name="rockfall_advance")
      type(c_ptr), value :: handle
      integer(c_int64_t), value :: n
      character(kind=c_char), intent(out) :: message(max_message)
      type(run_handle_t), pointer :: opened
      type(error_t), allocatable :: error
      integer(c_int64_t) :: done

      opened => run_at(handle)
      associate (run => opened%run)
         call opened%advance(opened%scene%scene, run%before + run%done + 1, 1_c_int64_t, n, huge(1.0_c_double), done, &
                             error)
      end associate
      call return_error(error, code, message)
   end function c_advance

   integer(c_int) function c_array(run, k, text, length, at) result(exists) bind(c, name="rockfall_array")
      type(c_ptr), value :: run
      integer(c_int), value :: k
      character(kind=c_char), intent(out) :: text(max_array_row)
      integer(c_int64_t), intent(out) :: length(4)
      type(c_ptr), intent(out) :: at
      type(run_handle_t), pointer :: opened
      type(array_t), pointer :: row
      type(error_t), allocatable :: error

      opened => run_at(run)
      exists = 0
      if (k == 0) call sort_crossings(opened%run, error)
      if (allocated(error)) return
      row => opened%list(k + 1, of_part=.false.)
      exists = merge(1, 0, associated(row))
      if (.not. associated(row)) return
      call put(row_text(row), text)
      length = row%length
      at = row%at
   end function c_array

   integer(c_int) function c_map(run, name, per_cluster, values, message) result(code) bind(c, name="rockfall_map")
      type(c_ptr), value :: run
      character(kind=c_char), intent(in) :: name(*)
      integer(c_int64_t), value :: per_cluster
      real(c_float), intent(inout), target :: values(*)
      character(kind=c_char), intent(out) :: message(max_message)
      type(run_handle_t), pointer :: opened
      real(c_float), pointer, contiguous :: cells(:, :)
      type(error_t), allocatable :: error

      opened => run_at(run)
      associate (nodes => opened%run%maps%nodes)
         cells(1:nodes(1), 1:nodes(2)) => values(:product(nodes))
      end associate
      call opened%write_map(text_of(name), opened%run%done, per_cluster, cells, error)
      call return_error(error, code, message)
   end function c_map

   subroutine c_close_run(run) bind(c, name="rockfall_close_run")
      type(c_ptr), value :: run
      type(run_handle_t), pointer :: opened

      if (.not. c_associated(run)) return
      opened => run_at(run)
      call close_handle(opened)
   end subroutine c_close_run

   !> Text of a C string.
   pure function text_of(string) result(text)
      character(kind=c_char), intent(in) :: string(*)
      character(len=:), allocatable :: text
      integer :: n

      n = 0
      do while (string(n + 1) /= c_null_char)
         n = n + 1
      end do
      text = transfer(string(:n), repeat(" ", n))
   end function text_of

   !> Write a text as a C string, truncated to its length.
   pure subroutine put(text, string)
      character(len=*), intent(in) :: text
      character(kind=c_char), intent(out) :: string(:)
      integer :: n

      n = min(len_trim(text), size(string) - 1)
      string = c_null_char
      string(:n) = transfer(text(:n), string, n)
   end subroutine put

   !> Convert an error: code 0 and an empty message mean success.
   pure subroutine return_error(error, code, message)
      type(error_t), allocatable, intent(in) :: error
      integer(c_int), intent(out) :: code
      character(kind=c_char), intent(out) :: message(:)  !! one line for each fault
      character(len=:), allocatable :: text
      integer :: k

      code = 0
      message = c_null_char
      if (.not. allocated(error)) return
      code = error%code
      text = error%message
      do k = 1, len(text)
         if (text(k:k) == fault_mark) text(k:k) = achar(10)
      end do
      call put(text, message)
   end subroutine return_error
end module rockfall_c
