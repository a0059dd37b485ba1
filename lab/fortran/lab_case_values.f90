! SPDX-License-Identifier: BSD-3-Clause
!> Values of a laboratory case file, as rows of numbers.
module lab_case_values
   use rockfall_kinds, only: wp, i8
   use rockfall_error, only: error_t, fail
   use rockfall_text, only: integer_text
   use rockfall_namelist, only: group_t
   use rockfall_values, only: has_key, get_integer, get_real, get_logical, refuse
   implicit none
   private
   public :: key_t, take_row, take_range, check_whole

   type :: key_t
      character(len=10) :: group
      character(len=15) :: name
      character(len=7) :: kind  !! text, integer, real, logical; range: min, median, max; list
   end type key_t

contains

   !> Read the named numbers of a row.
   pure subroutine take_row(group, table, names, row, error)
      type(group_t), intent(in) :: group
      type(key_t), intent(in) :: table(:)           !! kinds of the keys
      character(len=*), intent(in) :: names(:)
      real(wp), intent(inout) :: row(:)  !! values in the [unit] of each key
      type(error_t), allocatable, intent(out) :: error
      integer :: k

      do k = 1, size(names)
         if (.not. has_key(group, trim(names(k)))) cycle
         call take_number(group, table, trim(names(k)), row(k), error)
         if (allocated(error)) return
      end do
   end subroutine take_row

   !> Read a real, integer or logical as a number of a row.
   pure subroutine take_number(group, table, key, number, error)
      type(group_t), intent(in) :: group
      type(key_t), intent(in) :: table(:)
      character(len=*), intent(in) :: key
      real(wp), intent(inout) :: number  !! value in the [unit] of its key
      type(error_t), allocatable, intent(out) :: error
      integer(i8) :: integer_value
      logical :: switch
      integer :: k

      do k = 1, size(table)
         if (table(k)%group == group%name .and. table(k)%name == key) exit
      end do
      select case (table(k)%kind)
      case ("logical")
         call get_logical(group, key, switch, error)
         if (.not. allocated(error)) number = merge(1.0_wp, 0.0_wp, switch)
      case ("integer")
         call get_integer(group, key, integer_value, error)
         if (allocated(error)) return
         number = real(integer_value, wp)
         if (abs(number) > huge(1)) &
            call refuse(group, key, "must be at most "//integer_text(huge(1)), error)
      case ("real")
         call get_real(group, key, number, error)
      end select
   end subroutine take_number

   !> Read a range: minimum, median and maximum, or minimum and maximum.
   pure subroutine take_range(group, key, range, error)
      type(group_t), intent(in) :: group
      character(len=*), intent(in) :: key
      real(wp), intent(inout) :: range(:)  !! three or two numbers in the [unit] of the key
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: values(:)
      character(len=:), allocatable :: count, ends

      count = "three values: min, median, max"
      ends = "min, median and max"
      if (size(range) == 2) then
         count = "two values: min, max"
         ends = "min and max"
      end if
      allocate (values, source=range)
      call get_real(group, key, values, error)
      if (allocated(error)) return
      if (size(values) /= size(range)) then
         call refuse(group, key, "must be "//count, error)
      else if (any(values(2:) < values(:size(values) - 1))) then
         call refuse(group, key, "must be "//ends//", in this order", error)
      else
         range = values
      end if
   end subroutine take_range

   !> Check the limits of an integer of &lab.
   pure subroutine check_whole(file, key, value, min, max, error)
      character(len=*), intent(in) :: file, key
      integer(i8), intent(in) :: value, min, max
      type(error_t), allocatable, intent(out) :: error
      character(len=80) :: rule

      if (value >= min .and. value <= max) return
      write (rule, "(3(i0,a))") value, ": must be ", min, " to ", max
      call fail(error, file//": &lab "//key//" = "//trim(rule))
   end subroutine check_whole
end module lab_case_values
