! SPDX-License-Identifier: BSD-3-Clause
!> The laboratory's case file: its groups and keys in one table. Defaults are those of the types;
!> what can be packed and fired is for their modules to say.
module lab_case
   use rockfall_kinds, only: wp, i8
   use rockfall_error, only: error_t
   use rockfall_text, only: integer_text
   use rockfall_namelist, only: namelist_t, group_t, parse_namelist
   use rockfall_values, only: get_text, get_integer, get_real, refuse, check_names
   use lab_case_values, only: key_t, take_row, take_range, check_whole
   use lab_contact, only: material_t, check_material
   use lab_packing, only: packing_t, check_packing
   use lab_impact, only: shot_t
   use lab_ensemble, only: range_t, check_range
   use lab_tables, only: material_keys, packing_keys, shot_keys, material_of, packing_of, shot_of, &
      material_row, packing_row, shot_row
   implicit none
   private
   public :: lab_case_t, read_lab_case, default_ratios

   type(key_t), parameter :: key_table(*) = [ &
      key_t("lab", "title", "text"), key_t("lab", "seed", "integer"), &
      key_t("lab", "ratios", "list"), key_t("lab", "layers", "integer"), &
      key_t("lab", "points", "integer"), key_t("lab", "impacts", "integer"), &
      key_t("material", "young", "real"), key_t("material", "poisson", "real"), &
      key_t("material", "friction", "real"), key_t("material", "damping", "real"), &
      key_t("material", "rolling", "real"), key_t("material", "boulder_rolling", "real"), &
      key_t("packing", "mean_radius", "real"), key_t("packing", "grading", "real"), &
      key_t("packing", "by_mass", "logical"), key_t("packing", "width", "real"), &
      key_t("packing", "depth", "real"), key_t("packing", "density", "real"), &
      key_t("packing", "friction", "real"), key_t("packing", "gravity", "real"), &
      key_t("packing", "rigid_base", "logical"), key_t("packing", "base_speed", "real"), &
      key_t("impact", "speed", "range"), key_t("impact", "angle", "range"), &
      key_t("impact", "spin", "range"), key_t("impact", "density", "real"), &
      key_t("impact", "patience", "real"), key_t("impact", "spent", "real"), &
      key_t("impact", "past", "real"), key_t("impact", "wait", "real"), &
      key_t("impact", "step_factor", "real"), key_t("impact", "retries", "integer")]

   real(wp), parameter :: default_ratios(5) = [1.0_wp, 2.0_wp, 3.0_wp, 4.0_wp, 5.0_wp]  !! R_b/R_m
   integer, parameter :: max_ratios = 1000
   integer(i8), parameter :: max_shots = 10_i8**6  !! layers, points on each, and impacts at each

   !> A case as read.
   type :: lab_case_t
      character(len=:), allocatable :: file, title
      integer(i8) :: seed = 1
      real(wp), allocatable :: ratios(:)  !! R_b/R_m; `default_ratios` unless given
      integer(i8) :: layers = 50          !! for each ratio
      integer(i8) :: points = 8           !! on each layer
      integer(i8) :: impacts = 15         !! at each point
      type(material_t) :: material
      type(packing_t) :: packing
      type(shot_t) :: shot                !! see `shot_of_ratio`
      type(range_t) :: range
   end type lab_case_t

contains

   !> The case in a text; one clear error for anything that is not as it must be.
   pure subroutine read_lab_case(text, file, case, error)
      character(len=*), intent(in) :: text
      character(len=*), intent(in) :: file  !! its name, for messages
      type(lab_case_t), intent(out) :: case
      type(error_t), allocatable, intent(out) :: error
      type(namelist_t) :: list
      integer :: g

      case%file = file
      case%title = ""
      case%ratios = default_ratios
      call parse_namelist(text, file, list, error)
      if (.not. allocated(error)) call check_names(list, key_table%group, key_table%name, [character(len=1) ::], &
                                                   "stands more than once", error)
      if (allocated(error)) return
      do g = 1, size(list%group)
         call take_group(list%group(g), case, error)
         if (allocated(error)) return
      end do
      call check_lab_case(case, error)
   end subroutine read_lab_case

   !> What is fired at a ratio R_b/R_m, but for speed, angle, spin and aim, which are drawn.
   pure type(shot_t) function shot_of_ratio(case, ratio) result(shot)
      type(lab_case_t), intent(in) :: case
      real(wp), intent(in) :: ratio  !! R_b/R_m [-]

      shot = case%shot
      shot%radius = ratio*case%packing%mean_radius
      shot%gravity = case%packing%gravity
   end function shot_of_ratio

   !> What a group says, in place of the defaults.
   pure subroutine take_group(group, case, error)
      type(group_t), intent(in) :: group
      type(lab_case_t), intent(inout) :: case
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: material(size(material_keys)), packing(size(packing_keys)), shot(size(shot_keys))

      select case (group%name)
      case ("lab")
         call take_plan(group, case, error)
      case ("material")
         material = material_row(case%material)
         call take_row(group, key_table, material_keys, material, error)
         if (.not. allocated(error)) case%material = material_of(material)
      case ("packing")
         packing = packing_row(case%packing)
         call take_row(group, key_table, packing_keys, packing, error)
         if (.not. allocated(error)) case%packing = packing_of(packing)
      case ("impact")
         shot = shot_row(case%shot)
         call take_row(group, key_table, shot_keys, shot, error)
         if (.not. allocated(error)) case%shot = shot_of(shot)
         if (.not. allocated(error)) call take_range(group, "speed", case%range%speed, error)
         if (.not. allocated(error)) call take_range(group, "angle", case%range%angle, error)
         if (.not. allocated(error)) call take_range(group, "spin", case%range%spin, error)
      end select
   end subroutine take_group

   pure subroutine take_plan(group, case, error)
      type(group_t), intent(in) :: group
      type(lab_case_t), intent(inout) :: case
      type(error_t), allocatable, intent(out) :: error
      integer :: k

      call get_text(group, "title", case%title, error)
      if (.not. allocated(error)) call get_integer(group, "seed", case%seed, error)
      if (.not. allocated(error)) call get_integer(group, "layers", case%layers, error)
      if (.not. allocated(error)) call get_integer(group, "points", case%points, error)
      if (.not. allocated(error)) call get_integer(group, "impacts", case%impacts, error)
      if (.not. allocated(error)) call get_real(group, "ratios", case%ratios, error)
      if (allocated(error)) return
      if (size(case%ratios) > max_ratios) then
         call refuse(group, "ratios", "must be at most "//integer_text(max_ratios)//" values", &
                     error)
         return
      end if
      do k = 1, size(case%ratios)
         if (case%ratios(k) > 0 .and. all(case%ratios(:k - 1) /= case%ratios(k))) cycle
         call refuse(group, "ratios", "must be > 0, each once", error, k)
         return
      end do
   end subroutine take_plan

   !> Refuse a plan out of its bounds, and what cannot be packed or fired.
   pure subroutine check_lab_case(case, error)
      type(lab_case_t), intent(in) :: case
      type(error_t), allocatable, intent(out) :: error
      type(packing_t) :: packing
      integer :: k

      call check_whole(case%file, "seed", case%seed, 0_i8, huge(1_i8), error)
      if (.not. allocated(error)) call check_whole(case%file, "layers", case%layers, 1_i8, max_shots, error)
      if (.not. allocated(error)) call check_whole(case%file, "points", case%points, 1_i8, max_shots, error)
      if (.not. allocated(error)) call check_whole(case%file, "impacts", case%impacts, 1_i8, max_shots, error)
      if (allocated(error)) return
      call check_material(case%material, error)
      do k = 1, size(case%ratios)
         if (allocated(error)) exit
         packing = case%packing
         packing%ratio = case%ratios(k)
         call check_packing(packing, error)
         if (allocated(error)) exit
         call check_range(shot_of_ratio(case, case%ratios(k)), case%range, error)
      end do
      if (allocated(error)) error%message = case%file//": "//error%message
   end subroutine check_lab_case
end module lab_case
