! SPDX-License-Identifier: BSD-3-Clause
!> Files of impact sets: one `&impact_set ratio, mean, covariance /` for each R_b/R_m = 1..5, with optional keys (see
!> docs/impact_sets.md). For an ensemble, a file may contain several draws of all five sets.
module rockfall_impact_sets
   use rockfall_kinds, only: wp, i8
   use rockfall_dimensions, only: n_set_numbers, n_incidence_limits
   use rockfall_error, only: error_t, fail
   use rockfall_text, only: integer_text, joined
   use rockfall_namelist, only: namelist_t, group_t, parse_namelist
   use rockfall_values, only: has_key, value_count, get_integer, get_real, refuse
   use rockfall_impact, only: impact_set_t, impact_set, with_noise, impact_ratios
   use rockfall_covariance, only: covariance_root
   use rockfall_direction, only: lateral_classes, lateral_quantiles, by_lab
   implicit none
   private
   public :: coefficients_t, read_sets, any_speed, max_speed

   character(len=*), parameter :: keys(*) = [character(len=11) :: "ratio", "mean", "covariance", "noise", "draw", &
                                            "speed_range", "angle_range", "incidence", "lateral"]
   integer, parameter :: entries = n_set_numbers
   integer, parameter :: lengths(7) = [1, entries, entries*(entries + 1)/2, 6, 1, 2, 2]  !! numbers of values; lower
                                     !! triangles of matrices, row by row
   integer, parameter :: required = 3               !! number of required keys
   integer, parameter :: max_draws = 1000
   real(wp), parameter :: max_speed = 1000.0_wp     !! maximum speed of a boulder [m/s]

   real(wp), parameter :: any_speed = 1.0e100_wp  !! speed that means unbounded [m/s]; its square is finite

   !> Numbers of five impact sets, as in files.
   type :: coefficients_t
      real(wp) :: mean(n_set_numbers, impact_ratios) = 0.0_wp           !! means of a1..a9
      real(wp) :: covariance(n_set_numbers, n_set_numbers, impact_ratios) = 0.0_wp
      !> Lateral deviations [degree]: the limits of the incidence classes, padded with 90, and the quantiles of each
      !> class, padded with the quantiles of the last class.
      real(wp) :: incidence(n_incidence_limits, impact_ratios) = 90.0_wp
      real(wp) :: lateral(lateral_quantiles, lateral_classes, impact_ratios) = 0.0_wp
      !> Minimum and maximum incident speed [m/s] and angle [degree] in the data that each set was fitted to.
      real(wp) :: speed_range(2, impact_ratios) = spread([0.0_wp, any_speed], 2, impact_ratios)
      real(wp) :: angle_range(2, impact_ratios) = spread([0.0_wp, 90.0_wp], 2, impact_ratios)
   end type coefficients_t

contains

   !> Read impact sets from text, check that the covariance of each can be factored, and read the lateral deviations if
   !> the turning rule needs them. The text must have only one draw, unless `draw` selects one.
   subroutine read_sets(text, file, turning, draw, sets, error, draws)
      character(len=*), intent(in) :: text
      character(len=*), intent(in) :: file  !! file name, for messages
      integer, intent(in) :: turning           !! turning rule, as in turning_t
      integer, intent(in) :: draw              !! index of the draw to read; 0: the text must have a single draw
      type(coefficients_t), intent(out) :: sets
      type(error_t), allocatable, intent(out) :: error
      integer, intent(out), optional :: draws  !! number of draws in the text
      type(namelist_t) :: list
      type(impact_set_t) :: set
      logical :: present_ratio(impact_ratios)
      integer(i8) :: ratio
      integer :: g, requested
      integer, allocatable :: draw_of(:)
      character(len=:), allocatable :: of_draw

      present_ratio = .false.
      requested = max(1, draw)
      if (present(draws)) draws = 1
      call parse_namelist(text, file, list, error)
      if (.not. allocated(error)) call read_draws(list, draw_of, error)
      if (allocated(error)) return
      if (present(draws)) draws = max(1, maxval(draw_of))
      if (draw == 0 .and. any(draw_of > 1)) then
         call fail(error, file//": contains "//integer_text(maxval(draw_of))// &
                   " draws of the impact sets: use it in &ensemble sets")
         return
      end if
      do g = 1, size(list%group)
         if (draw_of(g) /= requested) cycle
         call get_integer(list%group(g), "ratio", ratio, error)
         if (allocated(error)) return
         if (ratio < 1 .or. ratio > impact_ratios) then
            call refuse(list%group(g), "ratio", "must be 1 to "//integer_text(impact_ratios), error)
         else if (present_ratio(ratio)) then
            call refuse(list%group(g), "ratio", "this ratio already has a set", error)
         else
            present_ratio(ratio) = .true.
            call read_set(list%group(g), int(ratio), sets, error)
            if (.not. allocated(error)) call add_noise(list%group(g), sets%covariance(:, :, ratio), error)
            if (.not. allocated(error)) call impact_set(sets%mean(:, ratio), sets%covariance(:, :, ratio), set, error)
            if (allocated(error)) then
               error%message = located_message(list%group(g), error%message)
            else if (turning == by_lab .and. .not. has_key(list%group(g), "lateral")) then
               call refuse(list%group(g), "lateral", "is missing: needed for &impact turning = 'lab'", error)
            end if
         end if
         if (allocated(error)) return
      end do
      if (all(present_ratio)) return
      of_draw = ""
      if (any(draw_of > 1)) of_draw = " of draw "//integer_text(requested)
      call fail(error, file//": &impact_set is missing for ratio"//missing_ratios(present_ratio)//of_draw// &
                ": must have ratios 1 to "//integer_text(impact_ratios))
   end subroutine read_sets

   !> Check all groups, and find the draw that each belongs to.
   subroutine read_draws(list, draw_of, error)
      type(namelist_t), intent(in) :: list
      integer, allocatable, intent(out) :: draw_of(:)
      type(error_t), allocatable, intent(out) :: error
      integer(i8) :: draw
      integer :: g

      allocate (draw_of(size(list%group)), source=1)
      do g = 1, size(list%group)
         call check_group(list%group(g), error)
         draw = 1
         if (.not. allocated(error)) call get_integer(list%group(g), "draw", draw, error)
         if (allocated(error)) return
         if (draw < 1 .or. draw > max_draws) then
            call refuse(list%group(g), "draw", "must be 1 to "//integer_text(max_draws), error)
            return
         end if
         draw_of(g) = int(draw)
      end do
   end subroutine read_draws

   !> Check that a group has only known keys and all required ones, each with the correct number of values.
   pure subroutine check_group(group, error)
      type(group_t), intent(in) :: group
      type(error_t), allocatable, intent(out) :: error
      integer :: k

      if (group%name /= "impact_set") then
         call fail(error, group%file//": line "//integer_text(group%line)//": &"//trim(group%name) &
                   //": unknown group: must be &impact_set")
         return
      end if
      do k = 1, size(group%entry)
         if (.not. any(keys == group%entry(k)%key)) then
            call refuse(group, trim(group%entry(k)%key), "unknown key: must be one of "//joined(keys, ", "), error)
            return
         end if
      end do
      do k = 1, size(lengths)
         if (.not. has_key(group, trim(keys(k)))) then
            if (k <= required) call refuse(group, trim(keys(k)), "is missing", error)
         else if (value_count(group, trim(keys(k))) /= lengths(k)) then
            call refuse(group, trim(keys(k)), "must have "//integer_text(lengths(k))//" values, not " &
                        //integer_text(value_count(group, trim(keys(k)))), error)
         end if
         if (allocated(error)) return
      end do
   end subroutine check_group

   pure subroutine read_set(group, ratio, sets, error)
      type(group_t), intent(in) :: group
      integer, intent(in) :: ratio
      type(coefficients_t), intent(inout) :: sets
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: values(:)

      call get_real(group, "mean", values, error)
      if (allocated(error)) return
      sets%mean(:, ratio) = values
      deallocate (values)
      call get_real(group, "covariance", values, error)
      if (allocated(error)) return
      sets%covariance(:, :, ratio) = symmetric(values, entries)
      call read_range(group, "speed_range", max_speed, "m/s", sets%speed_range(:, ratio), error)
      if (allocated(error)) return
      call read_range(group, "angle_range", 90.0_wp, "degree", sets%angle_range(:, ratio), error)
      if (allocated(error)) return
      call read_lateral(group, sets%incidence(:, ratio), sets%lateral(:, :, ratio), error)
   end subroutine read_set

   !> Add the noise within an impact, if the file gives it, to the covariance of a set; both must be valid covariances.
   subroutine add_noise(group, covariance, error)
      type(group_t), intent(in) :: group
      real(wp), intent(inout) :: covariance(entries, entries)
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: values(:)
      real(wp), dimension(entries, entries) :: root, drawn
      real(wp), dimension(3, 3) :: noise, noise_root, drawn_noise

      if (.not. has_key(group, "noise")) return
      call get_real(group, "noise", values, error)
      if (allocated(error)) return
      noise = symmetric(values, 3)
      call covariance_root("covariance", covariance, root, drawn, error)
      if (.not. allocated(error)) call covariance_root("noise", noise, noise_root, drawn_noise, error)
      if (.not. allocated(error)) covariance = with_noise(covariance, noise)
   end subroutine add_noise

   !> Symmetric matrix from its lower triangle, row by row.
   pure function symmetric(values, n) result(matrix)
      real(wp), intent(in) :: values(:)
      integer, intent(in) :: n
      real(wp) :: matrix(n, n)
      integer :: i, k

      k = 0
      do i = 1, n
         matrix(i, :i) = values(k + 1:k + i)
         matrix(:i, i) = values(k + 1:k + i)
         k = k + i
      end do
   end function symmetric

   !> Read the range of the data a set was fitted to, if given.
   pure subroutine read_range(group, key, maximum, unit, range, error)
      type(group_t), intent(in) :: group
      character(len=*), intent(in) :: key, unit
      real(wp), intent(in) :: maximum
      real(wp), intent(inout) :: range(2)
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: values(:)

      if (.not. has_key(group, key)) return
      call get_real(group, key, values, error)
      if (allocated(error)) return
      range = values
      if (range(1) < 0 .or. range(2) > maximum .or. range(1) > range(2)) then
         call refuse(group, key, "must not decrease between 0 and "//integer_text(nint(maximum))//" ["//unit//"]", &
                     error)
      end if
   end subroutine read_range

   !> Read lateral deviations, if given. All incidence classes have the same number of quantiles; without `incidence`
   !> there is one class.
   pure subroutine read_lateral(group, incidence, lateral, error)
      type(group_t), intent(in) :: group
      real(wp), intent(inout) :: incidence(:), lateral(:, :)
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: bounds(:), values(:)
      integer :: classes, k

      allocate (bounds(0), values(0))
      call get_real(group, "incidence", bounds, error)
      if (.not. allocated(error)) call get_real(group, "lateral", values, error)
      if (allocated(error)) return
      classes = size(bounds) + 1
      if (has_key(group, "incidence") .and. .not. has_key(group, "lateral")) then
         call refuse(group, "incidence", "is only valid with lateral", error)
      else if (classes > lateral_classes) then
         call refuse(group, "incidence", "must have at most "//integer_text(lateral_classes - 1)//" values", error)
      else if (any(bounds <= 0 .or. bounds >= 90) .or. any(bounds(2:) <= bounds(:classes - 2))) then
         call refuse(group, "incidence", "must increase between 0 and 90 [degree]", error)
      else if (has_key(group, "lateral") .and. size(values) /= classes*lateral_quantiles) then
         call refuse(group, "lateral", "must have "//integer_text(lateral_quantiles)//" values for each of "// &
                     integer_text(classes)//" incidence classes, not "//integer_text(size(values)), error)
      else if (any(values < 0 .or. values > 90)) then
         call refuse(group, "lateral", "must be 0 to 90 [degree]", error, &
                     findloc(values < 0 .or. values > 90, .true., dim=1))
      end if
      if (allocated(error) .or. size(values) == 0) return
      incidence(:classes - 1) = bounds
      do k = 1, size(lateral, 2)
         lateral(:, k) = values((min(k, classes) - 1)*lateral_quantiles + 1:min(k, classes)*lateral_quantiles)
         if (all(lateral(2:, k) >= lateral(:lateral_quantiles - 1, k))) cycle
         call refuse(group, "lateral", "must not decrease within class "//integer_text(k), error)
         return
      end do
   end subroutine read_lateral

   !> Add the index of the impact set to an error message from covariance_root.
   pure function located_message(group, message) result(text)
      type(group_t), intent(in) :: group
      character(len=*), intent(in) :: message
      character(len=:), allocatable :: text

      text = message
      if (index(message, group%file) /= 1) then
         text = group%file//": line "//integer_text(group%line)//": &impact_set "//message
      end if
   end function located_message

   pure function missing_ratios(present_ratio) result(text)
      logical, intent(in) :: present_ratio(:)
      character(len=:), allocatable :: text
      integer :: k

      text = ""
      do k = 1, size(present_ratio)
         if (.not. present_ratio(k)) text = text//" "//integer_text(k)
      end do
   end function missing_ratios
end module rockfall_impact_sets
