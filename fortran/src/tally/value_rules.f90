! SPDX-License-Identifier: BSD-3-Clause
!> Values that each variable of a run may have, by its name in files.
module rockfall_value_rules
   use, intrinsic :: ieee_arithmetic, only: ieee_is_nan, ieee_is_finite
   use rockfall_kinds, only: wp
   use rockfall_dimensions, only: n_block_shapes
   use rockfall_text, only: real_text
   use rockfall_grid, only: grid_t
   use rockfall_variables, only: statuses
   use rockfall_barrier, only: passed_over
   implicit none
   private
   public :: value_fault

   !> Range of values; the grid of the terrain, if known, limits coordinates.
   type :: range_t
      real(wp) :: lowest = 0.0_wp, highest = huge(1.0_wp)
      logical :: excludes_lowest = .false.
      character(len=16) :: place = ""  !! location, for messages
   end type range_t

contains

   !> Describe the fault in the values of a variable; "" if none.
   pure function value_fault(name, values, grid) result(fault)
      character(len=*), intent(in) :: name
      real(wp), intent(in) :: values(:)
      type(grid_t), intent(in), optional :: grid
      character(len=:), allocatable :: fault
      type(range_t) :: range
      integer :: k

      range = range_of(name, grid)
      do k = 1, size(values)
         if (name == "shadow_angle" .and. ieee_is_nan(values(k))) cycle  ! NaN: no apex
         if (ieee_is_nan(values(k))) exit  ! tested first, because comparisons with NaN trap
         if (values(k) < range%lowest .or. values(k) > range%highest) exit
         if (range%excludes_lowest .and. values(k) <= range%lowest) exit
      end do
      fault = ""
      if (k > size(values)) return
      if (.not. ieee_is_finite(values(k))) then
         fault = name//": must be a number"
      else if (range%highest < huge(1.0_wp)) then
         fault = name//" = "//real_text(values(k), 6)//": must be "//real_text(range%lowest, 10)//" to " &
                 //real_text(range%highest, 10)//trim(range%place)
      else
         fault = name//" = "//real_text(values(k), 6)//": must be "//trim(merge("> ", ">=", range%excludes_lowest)) &
                 //" "//real_text(range%lowest, 10)
      end if
   end function value_fault

   !> Range of a variable, unlimited if no rule applies; tallies, rebounds and histograms are not negative.
   pure type(range_t) function range_of(name, grid) result(range)
      character(len=*), intent(in) :: name
      type(grid_t), intent(in), optional :: grid

      select case (name)
      case ("volume", "crossing_volume"); range%excludes_lowest = .true.
      case ("source", "source_feature", "tally_shared_source", "crossing_fragments"); range%lowest = 1
      case ("status")
         range%lowest = 1
         range%highest = size(statuses)
      case ("block_shape")
         range%lowest = 1
         range%highest = n_block_shapes
      case ("crossing_outcome"); range%highest = passed_over
      case ("shadow_angle"); range%highest = 90
      case ("start_x", "stop_x", "start_y", "stop_y")
         range%lowest = -huge(1.0_wp)
         if (.not. present(grid)) return
         range%place = ", on the terrain"
         if (name(len(name):) == "x") then
            range%lowest = grid%west
            range%highest = grid%west + grid%nx*grid%cell
         else
            range%lowest = grid%north - grid%ny*grid%cell
            range%highest = grid%north
         end if
      case ("path_length", "plan_distance", "travel_time", "speed_max", "jump_height_max", "impacts", "trees_hit", &
            "crossing_time", "crossing_distance", &
            "fines_volume", "fragments", "breakages", "breakages_capped")
         range%lowest = 0
      case default
         if (index(name, "tally_") /= 1 .and. index(name, "rebounds") /= 1 .and. index(name, "_histogram") == 0) &
            range%lowest = -huge(1.0_wp)
      end select
   end function range_of
end module rockfall_value_rules
