! SPDX-License-Identifier: BSD-3-Clause
!> A case file with values of the command line put in place of its own, under the same rules.
module rockfall_override
   use rockfall_kinds, only: i8
   use rockfall_error, only: error_t, fail
   use rockfall_text_file, only: read_text
   use rockfall_text, only: excerpt
   use rockfall_decimal, only: parse_integer, decimal_ok
   use rockfall_namelist, only: namelist_t, group_t, entry_t, value_t, parse_namelist
   use rockfall_case, only: case_t, read_case
   implicit none
   private
   public :: read_case_file, bare_case_text

contains

   !> The case in a file, with values for keys of &case ("" = as in the file), and its text.
   subroutine read_case_file(file, boulders, seed, threads, text, case, error)
      character(len=*), intent(in) :: file, boulders, seed, threads
      character(len=:), allocatable, intent(out) :: text
      type(case_t), intent(out) :: case
      type(error_t), allocatable, intent(out) :: error
      type(namelist_t) :: list

      call read_text(file, text, error)
      if (.not. allocated(error)) call read_case(text, file, case, error)
      if (allocated(error) .or. boulders//seed//threads == "") return
      call parse_namelist(text, file, list, error)
      call override(list, "boulders", boulders, error)
      if (.not. allocated(error)) call override(list, "seed", seed, error)
      if (.not. allocated(error)) call override(list, "threads", threads, error)
      if (allocated(error)) return
      text = namelist_text(list)
      call read_case(text, file, case, error)
   end subroutine read_case_file

   !> The text of a case, as it was read, without what changes no number: comments and threads.
   pure function bare_case_text(text) result(bare)
      character(len=*), intent(in) :: text
      character(len=:), allocatable :: bare
      type(namelist_t) :: list
      type(error_t), allocatable :: error

      call parse_namelist(text, "", list, error)
      call override(list, "threads", "0", error)
      bare = namelist_text(list)
   end function bare_case_text

   !> Give an integer key of &case another value.
   pure subroutine override(list, key, value, error)
      type(namelist_t), intent(inout) :: list  !! has the group: a case must say how many boulders
      character(len=*), intent(in) :: key, value
      type(error_t), allocatable, intent(out) :: error
      type(entry_t) :: entry
      integer(i8) :: number
      integer :: g, e, status

      if (value == "") return
      call parse_integer(value, number, status)
      if (status /= decimal_ok) then
         call fail(error, key//" = "//excerpt(value)//": must be an integer")
         return
      end if
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

   !> Groups and values as the text of a namelist file.
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

   !> The values as written; the closing quote of the last is not in the text of an entry.
   pure function values_text(entry) result(text)
      type(entry_t), intent(in) :: entry
      character(len=:), allocatable :: text

      text = entry%text
      associate (last => entry%value(size(entry%value)))
         if (last%quoted) text = text//entry%text(last%first - 1:last%first - 1)
      end associate
   end function values_text
end module rockfall_override
