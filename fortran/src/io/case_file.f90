! SPDX-License-Identifier: BSD-3-Clause
!> Case files, with values overridden by the command line.
module rockfall_case_file
   use rockfall_error, only: error_t, fail
   use rockfall_text_file, only: read_text
   use rockfall_namelist, only: namelist_t, entry_t, value_t
   use rockfall_namelist_changes, only: change_namelist
   use rockfall_case_keys, only: read_keys, complete_keys
   use rockfall_case, only: case_t, case_of_keys
   implicit none
   private
   public :: read_case_file

contains

   !> Read a case file: its text and keys, with overridden values for keys of &case ("" = as in the file).
   subroutine read_case_file(file, boulders, total, seed, threads, text, keys, case, error)
      character(len=*), intent(in) :: file, boulders, total, seed, threads
      character(len=:), allocatable, intent(out) :: text
      type(namelist_t), intent(out) :: keys
      type(case_t), intent(out) :: case
      type(error_t), allocatable, intent(out) :: error
      type(namelist_t) :: list, new
      character(len=:), allocatable :: removed

      call read_text(file, text, error)
      if (.not. allocated(error)) call read_keys(text, file, keys, error)
      if (.not. allocated(error)) call case_of_keys(keys, file, case, error)
      if (.not. allocated(error)) call check_single(case, error)
      if (allocated(error) .or. boulders//total//seed//threads == "") return
      removed = ""
      if (boulders /= "") removed = "case%boulders_total"
      if (total /= "") removed = removed//" case%boulders"
      allocate (new%group(1))
      new%group(1)%name = "case"
      new%group(1)%entry = [entry_of("boulders", boulders), entry_of("boulders_total", total), &
                            entry_of("seed", seed), entry_of("threads", threads)]
      new%group(1)%entry = pack(new%group(1)%entry, [len(boulders), len(total), len(seed), len(threads)] > 0)
      list = keys
      call change_namelist(list, removed, new, file, keys, error)
      text = namelist_text(keys)
      if (.not. allocated(error)) call complete_keys(keys, file, error)
      if (.not. allocated(error)) call case_of_keys(keys, file, case, error)
   end subroutine read_case_file

   !> Refuse a case with variants, because a scene file is for a single variant.
   pure subroutine check_single(case, error)
      type(case_t), intent(in) :: case
      type(error_t), allocatable, intent(inout) :: error

      if (case%variants == "") return
      call fail(error, case%file//": &variant: has variants "//case%variants// &
                ": choose one with `rockfall prepare CASE DIR --variant NAME`")
   end subroutine check_single

   pure type(entry_t) function entry_of(key, value) result(entry)
      character(len=*), intent(in) :: key, value

      entry%key = key
      entry%text = value
      entry%value = [value_t(1, len(value), .false.)]
   end function entry_of

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

   !> Values as written, with the closing quote of the last value, which the text of an entry lacks.
   pure function values_text(entry) result(text)
      type(entry_t), intent(in) :: entry
      character(len=:), allocatable :: text

      text = entry%text
      associate (last => entry%value(size(entry%value)))
         if (last%quoted) text = text//entry%text(last%first - 1:last%first - 1)
      end associate
   end function values_text

end module rockfall_case_file
