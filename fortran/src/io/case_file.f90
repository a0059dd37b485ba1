! SPDX-License-Identifier: BSD-3-Clause
!> Comparison of the texts of two cases, and cases with values replaced by the command line.
module rockfall_case_file
   use rockfall_kinds, only: wp, i8
   use rockfall_error, only: error_t, fail
   use rockfall_text, only: integer_text, joined
   use rockfall_text_file, only: read_text
   use rockfall_namelist, only: namelist_t, group_t, entry_t, value_t, parse_namelist
   use rockfall_values, only: has_key, get_text, get_integer, get_real, get_logical
   use rockfall_case_keys, only: read_keys, key_t, key_table
   use rockfall_case, only: case_t, read_case
   implicit none
   private
   public :: read_case_file, differing_key

   integer, parameter :: text_length = 4096  !! maximum length of a text

contains

   !> Read the case in a file, with replaced values for keys of &case ("" = as in the file), and its text.
   subroutine read_case_file(file, boulders, total, seed, threads, text, case, error)
      character(len=*), intent(in) :: file, boulders, total, seed, threads
      character(len=:), allocatable, intent(out) :: text
      type(case_t), intent(out) :: case
      type(error_t), allocatable, intent(out) :: error
      type(namelist_t) :: list

      call read_text(file, text, error)
      if (.not. allocated(error)) call read_case(text, file, case, error)
      if (.not. allocated(error)) call check_single(case, error)
      if (allocated(error) .or. boulders//total//seed//threads == "") return
      call parse_namelist(text, file, list, error)
      if (boulders /= "") call remove(list, "boulders_total")
      if (total /= "") call remove(list, "boulders")
      call override(list, "boulders", boulders)
      call override(list, "boulders_total", total)
      call override(list, "seed", seed)
      call override(list, "threads", threads)
      text = namelist_text(list)
      call read_case(text, file, case, error)
   end subroutine read_case_file

   !> Refuse a case with variants: a scene file is that of one.
   pure subroutine check_single(case, error)
      type(case_t), intent(in) :: case
      type(error_t), allocatable, intent(inout) :: error

      if (case%variants == "") return
      call fail(error, case%file//": &variant: has the variants "//case%variants//"; `rockfall prepare CASE DIR " &
                //"--variant NAME` makes the case of one")
   end subroutine check_single

   !> Replace the value of a key of &case.
   pure subroutine override(list, key, value)
      type(namelist_t), intent(inout) :: list  !! contains the group: a case must give the number of boulders
      character(len=*), intent(in) :: key, value
      type(entry_t) :: entry
      integer :: g, e

      if (value == "") return
      entry%key = key
      entry%text = value
      entry%value = [value_t(1, len(value), .false.)]
      do g = 1, size(list%group)
         if (list%group(g)%name /= "case") cycle
         do e = 1, size(list%group(g)%entry)
            if (list%group(g)%entry(e)%key == key) exit
         end do
         if (e <= size(list%group(g)%entry)) then
            list%group(g)%entry(e) = entry
         else
            list%group(g)%entry = [list%group(g)%entry, entry]
         end if
      end do
   end subroutine override

   !> Remove a key of &case that is replaced by another.
   pure subroutine remove(list, key)
      type(namelist_t), intent(inout) :: list
      character(len=*), intent(in) :: key
      integer, allocatable :: kept(:)
      integer :: g, e

      do g = 1, size(list%group)
         if (list%group(g)%name /= "case") cycle
         kept = [(e, e=1, size(list%group(g)%entry))]
         kept = pack(kept, list%group(g)%entry%key /= key)
         list%group(g)%entry = list%group(g)%entry(kept)
      end do
   end subroutine remove

   !> Format groups and values as the text of a namelist file.
   pure function namelist_text(list) result(text)
      type(namelist_t), intent(in) :: list
      character(len=:), allocatable :: text
      character(len=1), parameter :: line_end = achar(10)
      integer :: g, e

      text = ""
      do g = 1, size(list%group)
         text = text//"&"//trim(list%group(g)%name)//line_end
         do e = 1, size(list%group(g)%entry)
            text = text//"   "//trim(list%group(g)%entry(e)%key)//" = " &
               //values_text(list%group(g)%entry(e))//line_end
         end do
         text = text//"/"//line_end
      end do
   end function namelist_text

   !> Values as written; the text of an entry lacks the closing quote of its last value.
   pure function values_text(entry) result(text)
      type(entry_t), intent(in) :: entry
      character(len=:), allocatable :: text

      text = entry%text
      associate (last => entry%value(size(entry%value)))
         if (last%quoted) text = text//entry%text(last%first - 1:last%first - 1)
      end associate
   end function values_text

   !> First key, as `&group key`, whose values differ between the texts of two cases, "" if none: among the keys that
   !> determine the arrays of a scene file, or all that must agree to continue a run. "&case" if a text is not a case.
   pure function differing_key(ours, theirs, of_arrays) result(name)
      character(len=*), intent(in) :: ours, theirs
      logical, intent(in) :: of_arrays
      character(len=:), allocatable :: name
      type(namelist_t) :: lists(2)
      type(error_t), allocatable :: error
      integer :: k

      name = "&case"
      call read_keys(ours, "", lists(1), error)
      if (allocated(error)) return
      call read_keys(theirs, "", lists(2), error)
      if (allocated(error)) return
      do k = 1, size(key_table)
         associate (key => key_table(k))
            if (of_arrays .and. .not. key%of_scene) cycle
            if (key%group == "case" .and. key%name == "threads") cycle  ! does not affect results
            name = "&"//trim(key%group)//" "//trim(key%name)
            if (.not. same_values(groups_of(lists(1), key%group), groups_of(lists(2), key%group), key)) return
         end associate
      end do
      name = ""
   end function differing_key

   pure function groups_of(list, name) result(groups)
      type(namelist_t), intent(in) :: list
      character(len=*), intent(in) :: name
      type(group_t), allocatable :: groups(:)

      groups = pack(list%group, list%group%name == name)
   end function groups_of

   !> Return whether groups with the same name have equal values of a key, in any notation.
   pure logical function same_values(ours, theirs, key) result(same)
      type(group_t), intent(in) :: ours(:), theirs(:)
      type(key_t), intent(in) :: key
      integer :: g

      same = size(ours) == size(theirs)
      do g = 1, size(ours)
         if (same) same = plain(ours(g), key) == plain(theirs(g), key)
      end do
   end function same_values

   !> Canonical text of the values of a key; "" if absent.
   pure function plain(group, key) result(text)
      type(group_t), intent(in) :: group
      type(key_t), intent(in) :: key
      character(len=:), allocatable :: text
      character(len=text_length), allocatable :: words(:)
      real(wp), allocatable :: numbers(:)
      integer(i8) :: whole
      logical :: switch
      type(error_t), allocatable :: error

      text = ""
      if (.not. has_key(group, trim(key%name))) return
      select case (key%kind)
      case ("text")
         call get_text(group, trim(key%name), words, error)
         text = joined(words, achar(10))
      case ("integer")
         call get_integer(group, trim(key%name), whole, error)
         text = integer_text(whole)
      case ("real")
         call get_real(group, trim(key%name), numbers, error)
         text = repeat(" ", 25*size(numbers))
         write (text, "(*(es25.16e3))") numbers + 0.0_wp  ! avoids negative zero
      case ("count")
         call get_text(group, trim(key%name), words, error)
         if (.not. allocated(error)) then
            text = joined(words, achar(10))
         else
            call get_integer(group, trim(key%name), whole, error)
            text = integer_text(whole)
         end if
      case default
         call get_logical(group, trim(key%name), switch, error)
         text = merge("yes", "no ", switch)
      end select
   end function plain
end module rockfall_case_file
