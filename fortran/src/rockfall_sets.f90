! SPDX-License-Identifier: BSD-3-Clause
!> Files of impact sets: one `&impact_set ratio, mean, covariance /` for each R_b/R_m = 1..5.
module rockfall_sets
   use rockfall_kinds, only: wp, i8
   use rockfall_error, only: error_t, fail
   use rockfall_textfile, only: integer_text
   use rockfall_namelist, only: namelist_t, group_t, parse_namelist
   use rockfall_values, only: has_key, value_count, get_integer, get_real, refuse
   use rockfall_impact, only: impact_set_t, impact_set, impact_ratios
   implicit none
   private
   public :: read_sets

   character(len=*), parameter :: keys(3) = [character(len=10) :: "ratio", "mean", "covariance"]
   integer, parameter :: lengths(3) = [1, 9, 45]  !! the covariance by its lower triangle, by rows

contains

   !> Means (9, ratio) and covariances (9, 9, ratio) of a1..a9 from a text, each checked by factoring it.
   subroutine read_sets(text, file, mean, covariance, error)
      character(len=*), intent(in) :: text
      character(len=*), intent(in) :: file  !! its name, for messages
      real(wp), intent(out) :: mean(9, impact_ratios), covariance(9, 9, impact_ratios)
      type(error_t), allocatable, intent(out) :: error
      type(namelist_t) :: list
      type(impact_set_t) :: set
      logical :: found(impact_ratios)
      integer(i8) :: ratio
      integer :: g

      mean = 0
      covariance = 0
      found = .false.
      call parse_namelist(text, file, list, error)
      if (allocated(error)) return
      do g = 1, size(list%group)
         call check_group(list%group(g), error)
         if (.not. allocated(error)) call get_integer(list%group(g), "ratio", ratio, error)
         if (allocated(error)) return
         if (ratio < 1 .or. ratio > impact_ratios) then
            call refuse(list%group(g), "ratio", "must be 1 to "//integer_text(impact_ratios), error)
         else if (found(ratio)) then
            call refuse(list%group(g), "ratio", "this ratio has a set already", error)
         else
            found(ratio) = .true.
            call read_set(list%group(g), mean(:, ratio), covariance(:, :, ratio), error)
            if (.not. allocated(error)) call impact_set(mean(:, ratio), covariance(:, :, ratio), set, error)
            if (allocated(error)) error%message = with_place(list%group(g), error%message)
         end if
         if (allocated(error)) return
      end do
      if (.not. all(found)) call fail(error, file//": no &impact_set for ratio" &
                                      //missing(found)//"; a file needs ratios 1 to "//integer_text(impact_ratios))
   end subroutine read_sets

   !> Only the three keys, each with its number of values.
   pure subroutine check_group(group, error)
      type(group_t), intent(in) :: group
      type(error_t), allocatable, intent(out) :: error
      integer :: k

      if (group%name /= "impact_set") then
         call fail(error, group%file//": line "//integer_text(group%line)//": &"//trim(group%name) &
                   //": unknown group; known: &impact_set")
         return
      end if
      do k = 1, size(group%entry)
         if (.not. any(keys == group%entry(k)%key)) then
            call refuse(group, trim(group%entry(k)%key), "unknown key; known: ratio, mean, covariance", error)
            return
         end if
      end do
      do k = 1, 3
         if (.not. has_key(group, trim(keys(k)))) then
            call refuse(group, trim(keys(k)), "is missing", error)
         else if (value_count(group, trim(keys(k))) /= lengths(k)) then
            call refuse(group, trim(keys(k)), "must be "//integer_text(lengths(k))//" values, not " &
                        //integer_text(value_count(group, trim(keys(k)))), error)
         end if
         if (allocated(error)) return
      end do
   end subroutine check_group

   pure subroutine read_set(group, mean, covariance, error)
      type(group_t), intent(in) :: group
      real(wp), intent(out) :: mean(9), covariance(9, 9)
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: values(:)
      integer :: i, k

      call get_real(group, "mean", values, error)
      if (allocated(error)) return
      mean = values
      deallocate (values)
      call get_real(group, "covariance", values, error)
      if (allocated(error)) return
      k = 0
      do i = 1, 9
         covariance(i, :i) = values(k + 1:k + i)
         covariance(:i, i) = values(k + 1:k + i)
         k = k + i
      end do
   end subroutine read_set

   !> A message of the factoring, with the set it is about.
   pure function with_place(group, message) result(text)
      type(group_t), intent(in) :: group
      character(len=*), intent(in) :: message
      character(len=:), allocatable :: text

      text = message
      if (index(message, group%file) /= 1) then
         text = group%file//": line "//integer_text(group%line)//": &impact_set "//message
      end if
   end function with_place

   pure function missing(found) result(text)
      logical, intent(in) :: found(:)
      character(len=:), allocatable :: text
      integer :: k

      text = ""
      do k = 1, size(found)
         if (.not. found(k)) text = text//" "//integer_text(k)
      end do
   end function missing
end module rockfall_sets
