! SPDX-License-Identifier: BSD-3-Clause
!> Ground types. Each is an impact table or is read from text: a file of impact sets, or a classical model in a row of a
!> ground table (docs/grounds.md), `&ground model = 'constant', r_n = 0.4, r_t = 0.9 /`.
module rockfall_grounds
   use rockfall_kinds, only: wp, i1
   use rockfall_error, only: error_t, fail
   use rockfall_decimal, only: parse_real
   use rockfall_namelist, only: namelist_t, group_t, parse_namelist
   use rockfall_values, only: has_key, get_text, get_real, refuse, key_location, check_names
   use rockfall_math, only: degree, tangent
   use rockfall_random, only: normal_table_t
   use rockfall_impact, only: impact_set, impact_ratios, fitted
   use rockfall_direction, only: lateral, by_lab
   use rockfall_classical_rebound, only: classical_t, scatter_t, scatter, by_sets, rockyfor3d, &
                                         pfeiffer_bowen, bourrier_hungr, constant, absorbing, by_table, by_ratio_table
   use rockfall_ground, only: ground_t, rest_slope_of
   use rockfall_impact_table, only: yielding_ground_t, has_ratios
   use rockfall_table_arrays, only: table_arrays_t, take_table
   use rockfall_case_keys, only: key_t, check_key, row_text, strength_range, relief_range
   use rockfall_impact_sets, only: coefficients_t, read_sets
   implicit none
   private
   public :: read_ground, table_ground, read_yielding, read_stochastic, rest_angle_of_rocks, ground_parameter
   public :: model_names, table_model, max_grounds, rocks_of_model

   integer, parameter :: max_grounds = huge(1_i1)  !! maximum per scene: an index is one byte

   !> Models, in the order of their numbers. The last two are for rows of a ground table that use a plane of impact
   !> tables (theory, chapter 5).
   character(len=*), parameter :: model_names(*) = [character(len=14) :: "impact_sets", "rockyfor3d", &
                                                    "pfeiffer_bowen", "bourrier_hungr", "constant", "absorbs", &
                                                    "impact_table", "ratio_table", "ploughed", "hard"]
   !> Rock data that a model requires: none; a size, possibly zero; a positive size.
   integer, parameter :: no_rocks = 0, any_rocks = 1, some_rocks = 2
   integer, parameter :: rocks_of_model(size(model_names)) = &
                         [some_rocks, any_rocks, no_rocks, no_rocks, no_rocks, no_rocks, no_rocks, some_rocks, &
                          no_rocks, no_rocks]

   !> Key of a parameter, with the models that use it.
   type :: parameter_t
      type(key_t) :: key
      character(len=72) :: models
   end type parameter_t

   character(len=*), parameter :: with_r_n = "rockyfor3d, pfeiffer_bowen, constant", &
                                  with_r_t = "pfeiffer_bowen, bourrier_hungr, constant", &
                                  classical = "rockyfor3d, pfeiffer_bowen, bourrier_hungr, constant", &
                                  yields = "ploughed, hard"
   real(wp), parameter :: min_divisor = 0.01_wp  !! minimum of R_n in models that divide by it, and of half_speed [m/s]

   type(parameter_t), parameter :: table(*) = [ &
      parameter_t(key_t("ground", "model", "text", 1, "required", &
                        "rockyfor3d, pfeiffer_bowen, bourrier_hungr, constant, absorbs, ploughed, hard", "", &
                        "rebound model; ploughed, hard: from the plane of impact tables"), ""), &
      parameter_t(key_t("ground", "r_n", "real", 1, "required", "0 to 1", "", &
                        "normal restitution"), with_r_n), &
      parameter_t(key_t("ground", "r_n_std", "real", 1, "0.0", "0 to 1", "", &
                        "standard deviation of r_n between rebounds"), with_r_n), &
      parameter_t(key_t("ground", "r_n_min", "real", 1, "0.0", "0 to 1", "", "minimum of r_n"), with_r_n), &
      parameter_t(key_t("ground", "r_n_max", "real", 1, "1.0", "0 to 1", "", "maximum of r_n"), with_r_n), &
      parameter_t(key_t("ground", "r_t", "real", 1, "required", "0 to 1", "", "tangential restitution"), with_r_t), &
      parameter_t(key_t("ground", "r_t_std", "real", 1, "0.0", "0 to 1", "", &
                        "standard deviation of r_t between rebounds"), with_r_t), &
      parameter_t(key_t("ground", "r_t_min", "real", 1, "0.0", "0 to 1", "", "minimum of r_t"), with_r_t), &
      parameter_t(key_t("ground", "r_t_max", "real", 1, "1.0", "0 to 1", "", "maximum of r_t"), with_r_t), &
      parameter_t(key_t("ground", "half_speed", "real", 1, "required", "0.01 to 1000", "m/s", &
                        "normal speed that halves the normal restitution"), "bourrier_hungr"), &
      parameter_t(key_t("ground", "half_speed_std", "real", 1, "0.0", "0 to 1000", "m/s", &
                        "standard deviation of half_speed between rebounds"), "bourrier_hungr"), &
      parameter_t(key_t("ground", "friction_angle", "real", 1, "required", "0 to 80", "degree", &
                        "friction angle between boulder and ground"), "bourrier_hungr"), &
      parameter_t(key_t("ground", "soil_density", "real", 1, "1800.0", "100 to 10000", "kg/m3", &
                        "density of the soil that a boulder penetrates"), "rockyfor3d"), &
      parameter_t(key_t("ground", "obstacle_spread", "real", 1, "0.1", "0 to 1", "", &
                        "relative spread of obstacle sizes, uniform"), "rockyfor3d"), &
      parameter_t(key_t("ground", "roughness_angle", "real", 1, "0.0", "0 to 45", "degree", &
                        "maximum random tilt of the ground against the motion"), classical), &
      parameter_t(key_t("ground", "min_hop", "real", 1, "0.0", "0 to 10", "radii", &
                        "minimum hop of a rolling boulder, while its energy lasts"), classical), &
      parameter_t(key_t("ground", "strength", "real", 1, "required", strength_range, "Pa", &
                        "median pressure at which the ground yields"), yields), &
      parameter_t(key_t("ground", "strength_sigma", "real", 1, "0.0", "0 to 1.5", "", &
                        "standard deviation of log strength between boulders"), yields), &
      parameter_t(key_t("ground", "strength_radius", "real", 1, "0.0", "0 to 100", "m", &
                        "R_b at which strength is valid, if proportional to R_b; 0: equal strength for all"), yields), &
      parameter_t(key_t("ground", "relief", "real", 1, "required", relief_range, "degree", &
                        "standard deviation of slope at the scale of the boulder"), yields), &
      parameter_t(key_t("ground", "relief_radius", "real", 1, "1.0", "0.01 to 100", "m", &
                        "R_b at which relief is valid, if hurst is not 1"), yields), &
      parameter_t(key_t("ground", "hurst", "real", 1, "1.0", "0 to 2", "", &
                        "exponent of the relief: slope is proportional to R_b**(hurst - 1)"), yields), &
      parameter_t(key_t("ground", "rest_angle", "real", 1, "38.0", "0 to 90", "degree", &
                        "steepest slope on which a boulder comes to rest; 90: any"), classical//", "//yields)]

contains

   !> Format row k of the table of parameters as text: its key, then the models that use it; blank past the end.
   pure function ground_parameter(k) result(text)
      integer, intent(in) :: k
      character(len=:), allocatable :: text

      text = ""
      if (k >= 1 .and. k <= size(table)) text = row_text(table(k)%key)//"|"//trim(table(k)%models)
   end function ground_parameter

   !> Read a ground type from text.
   subroutine read_ground(text, file, turning, numbers, ground, error)
      character(len=*), intent(in) :: text
      character(len=*), intent(in) :: file              !! file and row, for messages
      integer, intent(in) :: turning                    !! turning rule, as in turning_t
      type(normal_table_t), intent(in) :: numbers
      type(ground_t), intent(inout) :: ground
      type(error_t), allocatable, intent(out) :: error
      type(namelist_t) :: list

      call parse_namelist(text, file, list, error)
      if (allocated(error)) return
      if (size(list%group) /= 1 .or. .not. all(list%group%name == "ground")) then
         call read_stochastic(text, file, turning, 0, ground, error)
      else
         call check_names(list, table%key%group, table%key%name, [""], "", error)
         if (.not. allocated(error)) call read_classical(list%group(1), numbers, ground%classical, error)
         if (.not. allocated(error)) ground%rest_slope = rest_slope_of(value_of(list%group(1), "rest_angle"))
      end if
   end subroutine read_ground

   !> Build a ground type with impact table k, for the ground in a row of a ground table, or for the table's own ground.
   subroutine table_ground(tables, k, row, file, ground, error)
      type(table_arrays_t), intent(in) :: tables
      integer, intent(in) :: k
      character(len=*), intent(in) :: row, file  !! row of a ground table, or ""; file and row, for messages
      type(ground_t), intent(inout) :: ground
      type(error_t), allocatable, intent(out) :: error

      allocate (ground%table)
      call take_table(tables, k, file, ground%table, error)
      if (.not. allocated(error) .and. row /= "") call read_yielding(row, file, ground%table%ground, error)
      if (allocated(error)) return
      ground%classical%model = table_model(size(ground%table%size), ground%table%ground%strength)
      ground%rest_slope = rest_slope_of(ground%table%ground%rest_angle)
   end subroutine table_ground

   !> Read the ground for an impact table from a row of a ground table.
   pure subroutine read_yielding(text, file, ground, error)
      character(len=*), intent(in) :: text, file
      type(yielding_ground_t), intent(out) :: ground
      type(error_t), allocatable, intent(out) :: error
      type(namelist_t) :: list
      character(len=:), allocatable :: model

      call parse_namelist(text, file, list, error)
      if (.not. allocated(error)) call check_names(list, table%key%group, table%key%name, [""], "", error)
      if (.not. allocated(error)) call check_parameters(list%group(1), model, error)
      if (allocated(error)) return
      associate (group => list%group(1))
         ground = yielding_ground_t(value_of(group, "rest_angle"), value_of(group, "strength"), &
                                    value_of(group, "strength_sigma"), value_of(group, "strength_radius"), &
                                    value_of(group, "relief"), value_of(group, "relief_radius"), &
                                    value_of(group, "hurst"))
      end associate
   end subroutine read_yielding

   !> Model for an impact table, from has_ratios.
   pure integer function table_model(columns, strength)
      integer, intent(in) :: columns
      real(wp), intent(in) :: strength  !! [Pa]

      table_model = merge(by_ratio_table, by_table, has_ratios(columns, strength))
   end function table_model

   !> Read impact sets and their lateral deviations, and factor the covariances of the sets.
   subroutine read_stochastic(text, file, turning, draw, ground, error)
      character(len=*), intent(in) :: text, file
      integer, intent(in) :: turning  !! turning rule, as in turning_t
      integer, intent(in) :: draw     !! draw to read; 0: the file must have only one
      type(ground_t), intent(inout) :: ground
      type(error_t), allocatable, intent(out) :: error
      type(coefficients_t), allocatable :: sets  !! too large for a small stack
      integer :: k

      allocate (sets)
      call read_sets(text, file, turning, draw, sets, error)
      if (allocated(error)) return
      allocate (ground%sets(impact_ratios))
      do k = 1, impact_ratios
         call impact_set(sets%mean(:, k), sets%covariance(:, :, k), ground%sets(k), error)
         if (allocated(error)) return
         ground%sets(k)%fitted = fitted(sets%speed_range(:, k), sets%angle_range(:, k))
      end do
      ground%classical%model = by_sets
      ground%rest_slope = rest_slope_of(rest_angle_of_rocks())
      if (turning /= by_lab) return
      ground%lateral = [(lateral(sets%incidence(:, k), sets%lateral(:, :, k)), k=1, impact_ratios)]
   end subroutine read_stochastic

   !> Read the parameters of a classical model; other parameters are refused.
   pure subroutine read_classical(group, numbers, classical, error)
      type(group_t), intent(in) :: group
      type(normal_table_t), intent(in) :: numbers
      type(classical_t), intent(out) :: classical
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: model

      call check_parameters(group, model, error)
      if (allocated(error)) return
      classical%model = findloc(model_names == model, .true., dim=1)  ! gfortran 12 mishandles different text lengths
      select case (classical%model)
      case (rockyfor3d)
         call read_scatter(group, "r_n", min_divisor, numbers, classical%normal, error)
         classical%soil_density = value_of(group, "soil_density")
         classical%obstacle_spread = value_of(group, "obstacle_spread")
      case (pfeiffer_bowen)
         call read_scatter(group, "r_n", min_divisor, numbers, classical%normal, error)
      case (bourrier_hungr)
         classical%normal = scatter(numbers, value_of(group, "half_speed"), value_of(group, "half_speed_std"), &
                                    [min_divisor, huge(1.0_wp)])
         classical%friction = tangent(value_of(group, "friction_angle"))
      case (constant)
         call read_scatter(group, "r_n", 0.0_wp, numbers, classical%normal, error)
      end select
      classical%roughness = value_of(group, "roughness_angle")*degree
      classical%min_hop = value_of(group, "min_hop")
      if (allocated(error) .or. any(classical%model == [rockyfor3d, absorbing])) return
      call read_scatter(group, "r_t", 0.0_wp, numbers, classical%tangential, error)
   end subroutine read_classical

   !> Check all parameters of a model, and return its name.
   pure subroutine check_parameters(group, model, error)
      type(group_t), intent(in) :: group
      character(len=:), allocatable, intent(out) :: model
      type(error_t), allocatable, intent(out) :: error
      integer :: k

      model = ""
      call check_key(group, table(1)%key, error)
      if (.not. allocated(error)) call get_text(group, "model", model, error)
      do k = 2, size(table)
         if (allocated(error)) return
         call check_parameter(group, table(k), model, error)
      end do
   end subroutine check_parameters

   !> Check that a parameter is given and in its range if the model needs it, and is absent otherwise.
   pure subroutine check_parameter(group, parameter, model, error)
      type(group_t), intent(in) :: group
      type(parameter_t), intent(in) :: parameter
      character(len=*), intent(in) :: model
      type(error_t), allocatable, intent(out) :: error

      character(len=:), allocatable :: name

      name = trim(parameter%key%name)
      if (index(", "//trim(parameter%models)//",", ", "//model//",") == 0) then
         if (has_key(group, name)) call refuse(group, name, "is not valid for model = '"//model//"'", error)
      else if (parameter%key%default == "required" .and. .not. has_key(group, name)) then
         call fail(error, key_location(group, name)//" is missing: needed for model = '"//model//"'")
      else
         call check_key(group, parameter%key, error)
      end if
   end subroutine check_parameter

   !> Read a coefficient, its standard deviation, and its limits, which must enclose the coefficient.
   pure subroutine read_scatter(group, name, minimum, numbers, coefficient, error)
      type(group_t), intent(in) :: group
      character(len=*), intent(in) :: name
      real(wp), intent(in) :: minimum  !! minimum of the coefficient [-]
      type(normal_table_t), intent(in) :: numbers
      type(scatter_t), intent(inout) :: coefficient
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: mean, ends(2)

      mean = value_of(group, name)
      ends = [max(minimum, value_of(group, name//"_min")), value_of(group, name//"_max")]
      if (mean < minimum) then
         call refuse(group, name, "must be at least 0.01 for this model", error)
      else if (mean < ends(1) .or. mean > ends(2)) then
         call refuse(group, name, "must lie between "//name//"_min and "//name//"_max", error)
      else
         coefficient = scatter(numbers, mean, value_of(group, name//"_std"), ends)
      end if
   end subroutine read_scatter

   !> Default rest angle of rocky ground [degrees], from its key.
   pure real(wp) function rest_angle_of_rocks()
      rest_angle_of_rocks = default_of("rest_angle")
   end function rest_angle_of_rocks

   !> Value of a key, or its default.
   pure real(wp) function value_of(group, name) result(value)
      type(group_t), intent(in) :: group
      character(len=*), intent(in) :: name
      type(error_t), allocatable :: error

      value = default_of(name)
      call get_real(group, name, value, error)
   end function value_of

   !> Default of a key; 0 if it is required.
   pure real(wp) function default_of(name) result(value)
      character(len=*), intent(in) :: name
      integer :: k, status

      value = 0
      k = findloc(table%key%name == name, .true., dim=1)
      call parse_real(trim(table(k)%key%default), value, status)
   end function default_of
end module rockfall_grounds
