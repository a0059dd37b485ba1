! SPDX-License-Identifier: BSD-3-Clause
!> Groups of a namelist as JSON, from which callers take typed values. Each group has its name, the given values, and
!> the defaults of the other keys: `[["case", {"seed": 8}, {"threads": 0}], ...]`.
module rockfall_namelist_json
   use rockfall_kinds, only: wp, i8
   use rockfall_text, only: integer_text
   use rockfall_decimal, only: parse_integer, parse_real, decimal_ok
   use rockfall_namelist, only: namelist_t, group_t, entry_t
   use rockfall_values, only: unquoted, read_logical
   use rockfall_case_keys, only: key_t
   implicit none
   private
   public :: json_of

   !> Text buffer for appending; its capacity is doubled when exceeded.
   type :: growing_t
      character(len=:), allocatable :: text
      integer :: n = 0
   contains
      procedure, private :: put
   end type growing_t

contains

   !> Format groups as JSON. Keys in the table have the kind given there, and are lists if they may have several values.
   !> For other keys the kind is inferred from the text of the value.
   pure function json_of(list, table) result(text)
      type(namelist_t), intent(in) :: list
      type(key_t), intent(in) :: table(:)
      character(len=:), allocatable :: text
      type(growing_t) :: json
      integer :: g

      allocate (character(len=4096) :: json%text)
      call json%put("[")
      do g = 1, size(list%group)
         if (g > 1) call json%put(",")
         call json%put('["'//trim(list%group(g)%name)//'",')
         call put_entries(json, list%group(g), table, given=.true.)
         call json%put(",")
         call put_entries(json, list%group(g), table, given=.false.)
         call json%put("]")
      end do
      call json%put("]")
      text = json%text(:json%n)
   end function json_of

   pure subroutine put(this, piece)
      class(growing_t), intent(inout) :: this
      character(len=*), intent(in) :: piece
      character(len=:), allocatable :: larger

      if (this%n + len(piece) > len(this%text)) then
         allocate (character(len=2*(this%n + len(piece))) :: larger)
         larger(:this%n) = this%text(:this%n)
         call move_alloc(larger, this%text)
      end if
      this%text(this%n + 1:this%n + len(piece)) = piece
      this%n = this%n + len(piece)
   end subroutine put

   !> Append the given entries of a group, or the entries with defaults.
   pure subroutine put_entries(json, group, table, given)
      type(growing_t), intent(inout) :: json
      type(group_t), intent(in) :: group
      type(key_t), intent(in) :: table(:)
      logical, intent(in) :: given
      character(len=1) :: sign
      integer :: e, row

      sign = "{"
      do e = 1, size(group%entry)
         if (group%entry(e)%given .neqv. given) cycle
         call json%put(sign//'"'//trim(group%entry(e)%key)//'":')
         do row = 1, size(table)
            if (table(row)%group == group%name .and. table(row)%name == group%entry(e)%key) exit
         end do
         call put_values(json, group%entry(e), table(row:min(row, size(table))))
         sign = ","
      end do
      if (sign == "{") call json%put("{")
      call json%put("}")
   end subroutine put_entries

   pure subroutine put_values(json, entry, key)
      type(growing_t), intent(inout) :: json
      type(entry_t), intent(in) :: entry
      type(key_t), intent(in) :: key(:)  !! row of the table, if the key has one
      character(len=:), allocatable :: kind
      logical :: several
      integer :: k

      kind = ""
      several = size(entry%value) > 1
      if (size(key) > 0) then
         kind = trim(key(1)%kind)
         several = key(1)%most > 1
      end if
      if (several) call json%put("[")
      do k = 1, size(entry%value)
         if (k > 1) call json%put(",")
         if (entry%value(k)%quoted) then
            call json%put(json_text(unquoted(entry, k)))
         else
            call put_word(json, entry%text(entry%value(k)%first:entry%value(k)%last), kind)
         end if
      end do
      if (several) call json%put("]")
   end subroutine put_values

   !> Append an unquoted value: of the given kind if it has been checked, else of the kind inferred from its text.
   pure subroutine put_word(json, word, kind)
      type(growing_t), intent(inout) :: json
      character(len=*), intent(in) :: word, kind
      integer(i8) :: whole
      real(wp) :: number
      integer :: status
      logical :: switch, is_switch

      if (kind == "real") then
         call put_real(json, word)
         return
      end if
      call read_logical(word, switch, is_switch)
      call parse_integer(word, whole, status)
      if (is_switch) then
         call json%put(trim(merge("true ", "false", switch)))
      else if (status == decimal_ok) then
         call json%put(integer_text(whole))
      else
         call parse_real(word, number, status)
         if (status == decimal_ok) call put_real(json, word)
         if (status /= decimal_ok) call json%put(json_text(word))
      end if
   end subroutine put_word

   !> Append a decimal number such as `-2`, `.5`, `1.` or `1d-3` with digits on both sides of its point.
   pure subroutine put_real(json, word)
      type(growing_t), intent(inout) :: json
      character(len=*), intent(in) :: word
      character(len=:), allocatable :: whole, decimals
      integer :: first, point, power

      point = index(word, ".")
      if (point > 1 .and. point < len(word) .and. verify(word, "0123456789.") == 0 .and. word(1:1) /= "0") then
         call json%put(word)  ! usual case: nothing to add
         return
      end if
      first = verify(word, "+-")
      power = scan(word//"e", "eEdD")
      point = index(word(:power - 1)//".", ".")
      whole = word(first:point - 1)
      whole = whole(verify(whole//"1", "0"):)
      decimals = word(min(point + 1, power):power - 1)
      if (len(whole) == 0) whole = "0"
      if (len(decimals) == 0) decimals = "0"
      if (word(1:1) == "-") call json%put("-")
      call json%put(whole//"."//decimals)
      if (power <= len(word)) call json%put("e"//word(power + 1:))
   end subroutine put_real

   !> Text as a quoted JSON string. Namelist texts can contain only three of the characters that JSON escapes.
   pure function json_text(text) result(json)
      character(len=*), intent(in) :: text
      character(len=:), allocatable :: json
      integer :: k, n

      allocate (character(len=2*len(text) + 2) :: json)
      n = 1
      json(1:1) = '"'
      do k = 1, len(text)
         if (scan(text(k:k), '"\'//achar(9)) > 0) then
            json(n + 1:n + 2) = "\"//merge("t", text(k:k), text(k:k) == achar(9))
            n = n + 2
         else
            json(n + 1:n + 1) = text(k:k)
            n = n + 1
         end if
      end do
      json = json(:n)//'"'
   end function json_text
end module rockfall_namelist_json
