! SPDX-License-Identifier: BSD-3-Clause
!> Case file of the laboratory: its groups and keys in one table. Defaults are those of the types. The modules of
!> packings, shots and throws check their limits. A case with a group &throw throws boulders at its layers; other cases
!> fire single impacts.
module lab_case
   use rockfall_kinds, only: wp, i8
   use rockfall_error, only: error_t, fail
   use rockfall_text, only: integer_text, joined
   use rockfall_namelist, only: namelist_t, group_t, parse_namelist
   use rockfall_values, only: has_key, get_text, get_integer, get_real, refuse, check_names
   use lab_case_values, only: key_t, take_row, take_range, check_whole
   use lab_contact, only: material_t, check_material
   use lab_clump, only: shape_names
   use lab_packing, only: packing_t, check_packing
   use lab_impact, only: shot_t
   use lab_ensemble, only: range_t, check_range
   use lab_throw_range, only: throw_range_t, check_throws
   use lab_rock_throw, only: boulder_t, check_boulder
   use lab_tables, only: material_keys, packing_keys, shot_keys, material_of, packing_of, shot_of, &
      material_row, packing_row, shot_row
   implicit none
   private
   public :: lab_case_t, read_lab_case, default_ratios, impact_alone

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
      key_t("packing", "clumps", "logical"), &
      key_t("impact", "speed", "range"), key_t("impact", "angle", "range"), &
      key_t("impact", "spin", "range"), key_t("impact", "density", "real"), &
      key_t("impact", "patience", "real"), key_t("impact", "spent", "real"), &
      key_t("impact", "past", "real"), key_t("impact", "wait", "real"), &
      key_t("impact", "step_factor", "real"), key_t("impact", "retries", "integer"), &
      key_t("throw", "throws", "list"), key_t("throw", "on_layer", "integer"), &
      key_t("throw", "contacts", "integer"), key_t("throw", "radius", "real"), &
      key_t("throw", "max_depth", "real"), key_t("throw", "relief", "list"), &
      key_t("throw", "shape", "text"), key_t("throw", "adaptive", "logical"), &
      key_t("throw", "slope", "range"), key_t("throw", "speed", "range"), &
      key_t("throw", "angle", "range"), key_t("throw", "spin", "range")]

   !> Keys that apply only to single impacts, as GROUP.KEY.
   character(len=19), parameter :: impact_alone(*) = [character(len=19) :: &
      "lab.layers", "lab.points", "lab.impacts", "packing.mean_radius", "impact.speed", "impact.angle", "impact.spin", &
      "impact.patience", "impact.spent", "impact.past", "impact.wait"]

   real(wp), parameter :: default_ratios(5) = [1.0_wp, 2.0_wp, 3.0_wp, 4.0_wp, 5.0_wp]  !! R_b/R_m
   integer, parameter :: max_ratios = 1000
   integer(i8), parameter :: max_shots = 10_i8**6  !! maximum number of layers, points, impacts

   !> Case as read.
   type :: lab_case_t
      character(len=:), allocatable :: file, title
      integer(i8) :: seed = 1
      real(wp), allocatable :: ratios(:)  !! R_b/R_m; `default_ratios` unless given
      integer(i8) :: layers = 50          !! number per ratio
      integer(i8) :: points = 8           !! number per layer
      integer(i8) :: impacts = 15         !! number per point
      type(material_t) :: material
      type(packing_t) :: packing
      type(shot_t) :: shot                !! template of the shots, see `shot_of_ratio`
      type(range_t) :: range
      logical :: throwing = .false.       !! the case has a group &throw
      real(wp), allocatable :: throws(:)  !! number of throws per ratio, or one number for all
      real(wp), allocatable :: relief(:)  !! relief of `boulder` per ratio, or one for all [degrees]
      integer(i8) :: on_layer = 20        !! number of throws per layer
      integer(i8) :: contacts = 8         !! maximum number of contacts per throw
      real(wp) :: max_depth = 12          !! maximum depth of a layer, if below &packing depth [R_m]
      type(boulder_t) :: boulder          !! thrown boulder; density and step are from &impact
      type(throw_range_t) :: throw_range
   end type lab_case_t

contains

   !> Read a case from text; the error is the first invalid item.
   pure subroutine read_lab_case(text, file, case, error)
      character(len=*), intent(in) :: text
      character(len=*), intent(in) :: file  !! file name, for messages
      type(lab_case_t), intent(out) :: case
      type(error_t), allocatable, intent(out) :: error
      type(namelist_t) :: list
      integer :: g

      case%file = file
      case%title = ""
      case%ratios = default_ratios
      case%throws = [500.0_wp]
      case%relief = [case%boulder%relief]
      call parse_namelist(text, file, list, error)
      if (.not. allocated(error)) call check_names(list, key_table%group, key_table%name, [character(len=1) ::], &
                                                   "stands more than once", error)
      if (allocated(error)) return
      case%throwing = any([(list%group(g)%name == "throw", g=1, size(list%group))])
      do g = 1, size(list%group)
         if (case%throwing) call refuse_impact_alone(list%group(g), error)
         if (.not. allocated(error)) call take_group(list%group(g), case, error)
         if (allocated(error)) return
      end do
      case%boulder%density = case%shot%density
      case%boulder%step_factor = case%shot%step_factor
      case%boulder%retries = case%shot%retries
      case%throw_range%gravity = case%packing%gravity
      call check_lab_case(case, error)
   end subroutine read_lab_case

   !> Template of the shots at a ratio R_b/R_m; speed, angle, spin and aim are drawn later.
   pure type(shot_t) function shot_of_ratio(case, ratio) result(shot)
      type(lab_case_t), intent(in) :: case
      real(wp), intent(in) :: ratio  !! R_b/R_m [-]

      shot = case%shot
      shot%radius = ratio*case%packing%mean_radius
      shot%gravity = case%packing%gravity
   end function shot_of_ratio

   !> Packing at a ratio R_b/R_m. The boulder radius is the same for all rock sizes. A layer of small rocks may be
   !> shallower than the boulder diameter, because the base absorbs waves.
   pure type(packing_t) function packing_of_ratio(case, ratio) result(packing)
      type(lab_case_t), intent(in) :: case
      real(wp), intent(in) :: ratio  !! R_b/R_m [-]

      packing = case%packing
      packing%ratio = ratio
      if (.not. case%throwing) return
      packing%mean_radius = case%boulder%radius/ratio
      packing%depth = min(packing%depth, case%max_depth/ratio)
   end function packing_of_ratio

   !> Reject a key that does not apply to throws.
   pure subroutine refuse_impact_alone(group, error)
      type(group_t), intent(in) :: group
      type(error_t), allocatable, intent(out) :: error
      integer :: k, dot

      do k = 1, size(impact_alone)
         dot = index(impact_alone(k), ".")
         if (group%name /= impact_alone(k)(:dot - 1)) cycle
         if (.not. has_key(group, trim(impact_alone(k)(dot + 1:)))) cycle
         call refuse(group, trim(impact_alone(k)(dot + 1:)), "is for single impacts: not together with &throw", error)
         return
      end do
   end subroutine refuse_impact_alone

   !> Apply the values of a group to the defaults.
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
      case ("throw")
         call take_throws(group, case, error)
      end select
   end subroutine take_group

   pure subroutine take_throws(group, case, error)
      type(group_t), intent(in) :: group
      type(lab_case_t), intent(inout) :: case
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: numbers(3)

      numbers = [case%boulder%radius, case%max_depth, merge(1.0_wp, 0.0_wp, case%boulder%adaptive)]
      call take_row(group, key_table, [character(len=9) :: "radius", "max_depth", "adaptive"], numbers, error)
      if (.not. allocated(error)) then
         case%boulder%radius = numbers(1)
         case%max_depth = numbers(2)
         case%boulder%adaptive = numbers(3) > 0
         call get_real(group, "throws", case%throws, error)
      end if
      if (.not. allocated(error)) call get_real(group, "relief", case%relief, error)
      if (.not. allocated(error)) call take_shape(group, case%boulder%kind, error)
      if (.not. allocated(error)) call get_integer(group, "on_layer", case%on_layer, error)
      if (.not. allocated(error)) call get_integer(group, "contacts", case%contacts, error)
      if (.not. allocated(error)) call take_range(group, "slope", case%throw_range%slope, error)
      if (.not. allocated(error)) call take_range(group, "speed", case%throw_range%speed, error)
      if (.not. allocated(error)) call take_range(group, "angle", case%throw_range%angle, error)
      if (.not. allocated(error)) call take_range(group, "spin", case%throw_range%spin, error)
      if (allocated(error)) return
      if (any(case%throws < 1 .or. case%throws > real(max_shots, wp) .or. case%throws /= aint(case%throws))) &
         call refuse(group, "throws", "must be whole numbers, 1 to "//integer_text(int(max_shots)), error)
   end subroutine take_throws

   pure subroutine take_shape(group, kind, error)
      type(group_t), intent(in) :: group
      integer, intent(inout) :: kind  !! index in `shape_names`
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: shape
      integer :: k

      shape = trim(shape_names(kind))
      call get_text(group, "shape", shape, error)
      if (allocated(error)) return
      kind = findloc([(shape_names(k) == shape, k=1, size(shape_names))], .true., 1)
      if (kind == 0) call refuse(group, "shape", "must be one of "//joined(shape_names, ", "), error)
   end subroutine take_shape

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

   !> Check the limits of a case, and that its layers, shots and throws are possible.
   pure subroutine check_lab_case(case, error)
      type(lab_case_t), intent(in) :: case
      type(error_t), allocatable, intent(out) :: error
      integer :: k

      call check_whole(case%file, "seed", case%seed, 0_i8, huge(1_i8), error)
      if (.not. allocated(error)) call check_whole(case%file, "layers", case%layers, 1_i8, max_shots, error)
      if (.not. allocated(error)) call check_whole(case%file, "points", case%points, 1_i8, max_shots, error)
      if (.not. allocated(error)) call check_whole(case%file, "impacts", case%impacts, 1_i8, max_shots, error)
      if (allocated(error)) return
      call check_material(case%material, error)
      if (.not. allocated(error) .and. case%throwing) call check_thrown(case, error)
      do k = 1, size(case%ratios)
         if (allocated(error)) exit
         call check_packing(packing_of_ratio(case, case%ratios(k)), error)
         if (allocated(error)) exit
         call check_range(shot_of_ratio(case, case%ratios(k)), case%range, error)
      end do
      if (allocated(error)) error%message = case%file//": "//error%message
   end subroutine check_lab_case

   pure subroutine check_thrown(case, error)
      type(lab_case_t), intent(in) :: case
      type(error_t), allocatable, intent(out) :: error
      type(boulder_t) :: boulder
      integer :: k

      if (all(size(case%throws) /= [1, size(case%ratios)])) then
         call fail(error, "&throw throws: must be one number, or one for each of &lab ratios")
      else if (all(size(case%relief) /= [1, size(case%ratios)])) then
         call fail(error, "&throw relief: must be one number, or one for each of &lab ratios")
      else if (case%on_layer < 1 .or. case%on_layer > max_shots) then
         call fail(error, "&throw on_layer: must be 1 to "//integer_text(int(max_shots)))
      else if (case%contacts < 1) then
         call fail(error, "&throw contacts: must be 1 to 1000")
      else if (.not. case%max_depth > 0) then
         call fail(error, "&throw max_depth: must be > 0 [R_m]")
      else
         boulder = case%boulder
         do k = 1, size(case%relief)
            boulder%relief = case%relief(k)
            if (.not. allocated(error)) call check_boulder(boulder, error)
         end do
         if (.not. allocated(error)) call check_throws(case%throw_range, int(min(case%contacts, 2000_i8)), error)
      end if
   end subroutine check_thrown
end module lab_case
