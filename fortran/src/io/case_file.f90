! SPDX-License-Identifier: BSD-3-Clause
!> Case files, with values replaced by the command line.
module rockfall_case_file
   use rockfall_error, only: error_t, fail
   use rockfall_text_file, only: read_text
   use rockfall_namelist, only: namelist_t, entry_t, value_t, parse_namelist
   use rockfall_case, only: case_t, read_case
   implicit none
   private
   public :: read_case_file

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

end module rockfall_case_file
