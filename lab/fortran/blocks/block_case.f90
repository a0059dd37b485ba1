! SPDX-License-Identifier: BSD-3-Clause
!> Case file of the block laboratory: its groups and keys in one table. A case belongs to this laboratory if its group
!> &lab has a ground, which provides the defaults of &ground.
module lab_block_case
   use rockfall_kinds, only: wp, i8
   use rockfall_error, only: error_t
   use rockfall_namelist, only: namelist_t, group_t, parse_namelist
   use rockfall_values, only: has_key, get_text, get_integer, get_real, check_names, refuse
   use lab_case_values, only: key_t, take_row, take_range, check_whole
   use lab_yielding_ground, only: ground_t, check_ground
   use lab_throw_range, only: throw_range_t, check_throws
   use lab_block_tables, only: ground_keys, ground_of, ground_row, plan_t, plan_keys, plan_of, plan_row, check_plan
   implicit none
   private
   public :: block_case_t, is_block_case, read_block_case

   type(key_t), parameter :: key_table(*) = [ &
      key_t("lab", "title", "text"), key_t("lab", "seed", "integer"), &
      key_t("lab", "ground", "text"), key_t("lab", "shape", "text"), &
      key_t("lab", "throws", "integer"), key_t("lab", "contacts", "integer"), &
      key_t("block", "radius", "real"), key_t("block", "density", "real"), &
      key_t("block", "count", "integer"), key_t("block", "edge", "real"), &
      key_t("block", "points", "text"), key_t("block", "axes", "list"), &
      key_t("ground", "yield_pressure", "real"), key_t("ground", "restitution", "real"), &
      key_t("ground", "friction", "real"), key_t("ground", "soil_density", "real"), &
      key_t("ground", "plough", "logical"), key_t("ground", "relief", "real"), &
      key_t("ground", "shortest", "real"), key_t("ground", "longest", "real"), &
      key_t("ground", "hurst", "real"), key_t("ground", "patches", "integer"), &
      key_t("ground", "rest_angle", "real"), key_t("ground", "yield_exponent", "real"), &
      key_t("ground", "fitted_radius", "real"), &
      key_t("throw", "slope", "range"), key_t("throw", "speed", "range"), &
      key_t("throw", "angle", "range"), key_t("throw", "spin", "range"), &
      key_t("throw", "gravity", "real"), key_t("throw", "step_factor", "real")]

   integer(i8), parameter :: max_throws = 10_i8**7
   real(wp), parameter :: longest = 5  !! maximum axis of a block over its shortest

   type :: block_case_t
      character(len=:), allocatable :: file, title, ground, shape, points
      integer(i8) :: seed = 1
      integer(i8) :: throws = 2000   !! about 50,000 contacts
      integer(i8) :: contacts = 32   !! maximum number of contacts per throw
      type(plan_t) :: plan
      type(ground_t) :: strength
      type(throw_range_t) :: range
   end type block_case_t

contains

   !> Return whether the text of a case has a ground. Errors in the text are left to its reader.
   pure logical function is_block_case(text, file)
      character(len=*), intent(in) :: text, file
      type(namelist_t) :: list
      type(error_t), allocatable :: error
      integer :: g

      is_block_case = .false.
      call parse_namelist(text, file, list, error)
      if (allocated(error)) return
      do g = 1, size(list%group)
         if (list%group(g)%name == "lab") is_block_case = is_block_case .or. has_key(list%group(g), "ground")
      end do
   end function is_block_case

   !> Read a case from text; the error is the first invalid item.
   pure subroutine read_block_case(text, file, case, error)
      character(len=*), intent(in) :: text, file  !! text of the case; file name, for messages
      type(block_case_t), intent(out) :: case
      type(error_t), allocatable, intent(out) :: error
      type(namelist_t) :: list
      integer :: g

      case%file = file
      case%title = ""
      case%ground = ""
      case%shape = "compact"
      case%points = ""
      call parse_namelist(text, file, list, error)
      if (.not. allocated(error)) call check_names(list, key_table%group, key_table%name, [character(len=1) ::], &
                                                   "stands more than once", error)
      if (allocated(error)) return
      do g = 1, size(list%group)
         call take_group(list%group(g), case, error)
         if (allocated(error)) return
      end do
      call check_whole(file, "seed", case%seed, 0_i8, huge(1_i8), error)
      if (.not. allocated(error)) call check_whole(file, "throws", case%throws, 1_i8, max_throws, error)
      if (.not. allocated(error)) call check_whole(file, "contacts", case%contacts, 1_i8, 1000_i8, error)
      if (allocated(error)) return
      call check_ground(case%strength, error)
      if (.not. allocated(error)) call check_plan(case%plan, error)
      if (.not. allocated(error)) call check_throws(case%range, int(case%contacts), error)
      if (allocated(error)) error%message = file//": "//error%message
   end subroutine read_block_case

   !> Apply the values of a group to the defaults.
   pure subroutine take_group(group, case, error)
      type(group_t), intent(in) :: group
      type(block_case_t), intent(inout) :: case
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: strength(size(ground_keys)), plan(size(plan_keys)), gravity(1)

      select case (group%name)
      case ("lab")
         call get_text(group, "title", case%title, error)
         if (.not. allocated(error)) call get_text(group, "ground", case%ground, error)
         if (.not. allocated(error)) call get_text(group, "shape", case%shape, error)
         if (.not. allocated(error)) call get_integer(group, "seed", case%seed, error)
         if (.not. allocated(error)) call get_integer(group, "throws", case%throws, error)
         if (.not. allocated(error)) call get_integer(group, "contacts", case%contacts, error)
      case ("ground")
         strength = ground_row(case%strength)
         call take_row(group, key_table, ground_keys, strength, error)
         if (.not. allocated(error)) case%strength = ground_of(strength)
      case ("throw")
         gravity = case%range%gravity
         call take_row(group, key_table, ["gravity"], gravity, error)
         if (.not. allocated(error)) case%range%gravity = gravity(1)
         if (.not. allocated(error)) call take_range(group, "slope", case%range%slope, error)
         if (.not. allocated(error)) call take_range(group, "speed", case%range%speed, error)
         if (.not. allocated(error)) call take_range(group, "angle", case%range%angle, error)
         if (.not. allocated(error)) call take_range(group, "spin", case%range%spin, error)
      case ("block")
         call get_text(group, "points", case%points, error)
         if (.not. allocated(error)) call check_axes(group, error)
      end select
      if (allocated(error)) return
      plan = plan_row(case%plan)
      call take_row(group, key_table, plan_keys, plan, error)
      if (.not. allocated(error)) case%plan = plan_of(plan)
   end subroutine take_group

   !> Check the lengths of the axes of a block.
   pure subroutine check_axes(group, error)
      type(group_t), intent(in) :: group
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: axes(:)

      if (.not. has_key(group, "axes")) return
      call get_real(group, "axes", axes, error)
      if (allocated(error)) return
      if (size(axes) /= 3) then
         call refuse(group, "axes", "must be three lengths", error)
      else if (.not. (minval(axes) > 0 .and. maxval(axes) <= longest*minval(axes))) then
         call refuse(group, "axes", "must be > 0, the longest at most five times the shortest", error)
      end if
   end subroutine check_axes
end module lab_block_case
