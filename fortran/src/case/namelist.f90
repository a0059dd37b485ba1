! SPDX-License-Identifier: BSD-3-Clause
!> Parser of namelist text in memory: groups, their keys, and values as written.
!>
!> Deliberately stricter than the language: rejects ambiguous input, such as null values, text over several lines,
!> array subscripts, and repeated keys in a group.
module rockfall_namelist
   use rockfall_kinds, only: i8
   use rockfall_error, only: error_t, fail
   use rockfall_decimal, only: parse_integer, decimal_ok
   use rockfall_text, only: check_text, after_mark, lower, integer_text, excerpt
   implicit none
   private
   public :: namelist_t, group_t, entry_t, value_t, parse_namelist, mark_repeated, raw_value

   integer, parameter :: name_length = 63         !! maximum length of names of groups and keys
   integer, parameter :: max_value_length = 4096  !! maximum length of a value [characters]
   integer, parameter :: max_values = 10000000    !! maximum number of values per file, including repeat counts
   integer, parameter :: max_repeats = 100000     !! maximum repeat count
   integer, parameter :: max_keys = 200           !! maximum number of keys per group
   integer, parameter :: max_groups = 100         !! maximum number of different groups

   character(len=*), parameter :: blanks = " "//achar(9)//achar(10)//achar(13)
   character(len=*), parameter :: word_end = blanks//",/=!&'"""
   character(len=*), parameter :: digits = "0123456789"

   !> Raw value `entry%text(first:last)`, without quotes.
   type :: value_t
      integer :: first = 1, last = 0
      logical :: quoted = .false.
   end type value_t

   !> Entry `key = values`, as written.
   type :: entry_t
      character(len=name_length) :: key = ""  !! lower case
      integer :: line = 0
      logical :: given = .true.  !! false: the entry is the default of its key
      character(len=:), allocatable :: text    !! from the first value to the last
      type(value_t), allocatable :: value(:)   !! at least one; repeat counts are expanded
   end type entry_t

   !> Group `&name ... /`.
   type :: group_t
      character(len=:), allocatable :: file      !! file name, for messages
      character(len=name_length) :: name = ""   !! lower case
      integer :: line = 0
      logical :: repeated = .false.              !! the file has several groups with this name
      type(entry_t), allocatable :: entry(:)     !! in file order
   end type group_t

   type :: namelist_t
      type(group_t), allocatable :: group(:)     !! in file order
   end type namelist_t

   !> Position of the parser.
   type :: cursor_t
      integer :: pos = 1, line = 1
      integer :: values = 0  !! number of values so far
   end type cursor_t

contains

   !> Parse all groups of `text`; time and memory are linear in its length.
   pure subroutine parse_namelist(text, file, list, error)
      character(len=*), intent(in) :: text
      character(len=*), intent(in) :: file  !! file name, for messages
      type(namelist_t), intent(out) :: list
      type(error_t), allocatable, intent(out) :: error
      type(group_t), allocatable :: groups(:)
      type(entry_t), allocatable :: entries(:)  !! too large for a small stack
      type(cursor_t) :: cursor
      integer :: n

      call check_text(text, file, error)
      if (allocated(error)) return
      allocate (groups(4), entries(max_keys + 1))
      n = 0
      cursor%pos = after_mark(text)
      do
         call skip_blanks(text, cursor)
         if (cursor%pos > len(text)) exit
         if (text(cursor%pos:cursor%pos) /= "&") then
            call fail(error, location(file, cursor%line)//"text outside of a group: " &
                      //excerpt(rest_of_line(text, cursor%pos))//" (a group ends at its first / " &
                      //"outside of quotes)")
            return
         end if
         if (n == size(groups)) call enlarge_groups(groups)
         n = n + 1
         call parse_group(text, file, cursor, entries, groups(n), error)
         if (allocated(error)) return
      end do
      allocate (list%group(n))
      call move_groups(groups, list%group)
      call mark_repeated(list%group, file, error)
   end subroutine parse_namelist

   !> Parse a group from `&` to the closing `/`.
   pure subroutine parse_group(text, file, cursor, entries, group, error)
      character(len=*), intent(in) :: text, file
      type(cursor_t), intent(inout) :: cursor
      type(entry_t), intent(inout) :: entries(:)  !! buffer, one entry longer than a group may be
      type(group_t), intent(inout) :: group
      type(error_t), allocatable, intent(out) :: error
      type(cursor_t) :: start
      integer :: n

      group%file = file
      group%line = cursor%line
      cursor%pos = cursor%pos + 1
      start = cursor
      call take_word(text, cursor)
      if (.not. is_name(text(start%pos:cursor%pos - 1))) then
         call fail(error, location(file, cursor%line)//"expected a group name after &")
         return
      end if
      group%name = lower(text(start%pos:cursor%pos - 1))

      n = 0
      do
         call skip_blanks(text, cursor)
         if (cursor%pos > len(text)) exit
         if (text(cursor%pos:cursor%pos) == "/" .or. text(cursor%pos:cursor%pos) == "&") exit
         n = n + 1
         call parse_entry(text, file, cursor, entries(n), error)
         if (allocated(error)) return
         call check_key(entries(:n), file, group%name, error)
         if (allocated(error)) return
      end do
      if (cursor%pos <= len(text)) then
         if (text(cursor%pos:cursor%pos) == "/") then
            cursor%pos = cursor%pos + 1
            allocate (group%entry(n))
            call move_entries(entries, group%entry)
            return
         end if
      end if
      call fail(error, location(file, group%line)//"&"//trim(group%name)//" is not closed by /")
   end subroutine parse_group

   !> Parse `key = value, value ...`, up to the next key or the end of the group.
   pure subroutine parse_entry(text, file, cursor, entry, error)
      character(len=*), intent(in) :: text, file
      type(cursor_t), intent(inout) :: cursor
      type(entry_t), intent(inout) :: entry
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: word
      type(cursor_t) :: start
      integer :: first

      start = cursor
      call take_word(text, cursor)
      word = text(start%pos:cursor%pos - 1)
      call check_word(word, file, start%line, error)
      if (allocated(error)) return
      call skip_blanks(text, cursor)
      if (.not. is_at(text, cursor, "=") .or. len(word) == 0) then
         call fail(error, location(file, start%line)//"expected a key and = before " &
                   //excerpt(rest_of_line(text, start%pos)))
         return
      else if (.not. is_name(word)) then
         call fail(error, location(file, start%line)//"'"//excerpt(word)//"' is not a valid key")
         return
      end if
      entry%key = lower(word)
      entry%line = start%line
      cursor%pos = cursor%pos + 1
      call skip_blanks(text, cursor)
      first = cursor%pos
      call parse_values(text, file, cursor, entry%value, error)
      if (allocated(error)) return
      if (size(entry%value) == 0) then
         call fail(error, location(file, entry%line)//"'"//word//"' has no value")
         return
      end if
      entry%text = text(first:entry%value(size(entry%value))%last)
      entry%value%first = entry%value%first - first + 1
      entry%value%last = entry%value%last - first + 1
   end subroutine parse_entry

   !> Parse the values from the cursor, and move it past them.
   pure subroutine parse_values(text, file, cursor, values, error)
      character(len=*), intent(in) :: text, file
      type(cursor_t), intent(inout) :: cursor
      type(value_t), allocatable, intent(out) :: values(:)
      type(error_t), allocatable, intent(out) :: error
      type(cursor_t) :: start
      type(value_t) :: value
      integer :: n, repeats
      logical :: comma_may_come

      allocate (values(0))
      n = 0
      comma_may_come = .false.
      do
         call skip_blanks(text, cursor)
         if (cursor%pos > len(text)) exit
         if (scan(text(cursor%pos:cursor%pos), "/&") == 1) exit
         if (is_at(text, cursor, ",")) then
            if (.not. comma_may_come) then
               call fail(error, location(file, cursor%line)//"a value is missing before a comma")
               return
            end if
            comma_may_come = .false.
            cursor%pos = cursor%pos + 1
            cycle
         end if
         start = cursor
         call take_value(text, file, cursor, value, repeats, error)
         if (allocated(error)) return
         call skip_blanks(text, cursor)
         if (is_at(text, cursor, "=") .and. .not. value%quoted) then  ! the word is the next key
            cursor = start
            exit
         end if
         if (cursor%values + repeats > max_values) then
            call fail(error, location(file, cursor%line)//"more than " &
                      //integer_text(max_values)//" values in the file")
            return
         end if
         cursor%values = cursor%values + repeats
         call append(values, n, value, repeats)
         comma_may_come = .true.
      end do
      values = values(:n)
   end subroutine parse_values

   !> Parse one value with its repeat count. May also consume a word that turns out to be the next key.
   pure subroutine take_value(text, file, cursor, value, repeats, error)
      character(len=*), intent(in) :: text, file
      type(cursor_t), intent(inout) :: cursor
      type(value_t), intent(out) :: value
      integer, intent(out) :: repeats
      type(error_t), allocatable, intent(out) :: error
      integer :: star

      repeats = 1
      value%first = cursor%pos
      call take_word(text, cursor)
      value%last = cursor%pos - 1
      call check_word(text(value%first:value%last), file, cursor%line, error)
      if (allocated(error)) return
      star = verify(text(value%first:value%last), digits)
      if (star > 1) then
         if (text(value%first + star - 1:value%first + star - 1) == "*") then
            call take_repeats(text(value%first:value%first + star - 2), file, cursor%line, repeats, error)
            if (allocated(error)) return
            value%first = value%first + star
         end if
      end if
      if (cursor%pos <= len(text)) value%quoted = scan(text(cursor%pos:cursor%pos), "'""") == 1
      if (value%quoted) then
         if (value%first <= value%last) then
            call fail(error, location(file, cursor%line)//"expected a blank or comma before " &
                      //excerpt(rest_of_line(text, cursor%pos)))
            return
         end if
         call take_quoted(text, file, cursor, value, error)
      else if (value%first > value%last) then
         call fail(error, location(file, cursor%line)//"expected a value at "//excerpt(rest_of_line(text, cursor%pos)))
      end if
   end subroutine take_value

   !> Parse a quoted text on one line; a doubled quote is a literal quote.
   pure subroutine take_quoted(text, file, cursor, value, error)
      character(len=*), intent(in) :: text, file
      type(cursor_t), intent(inout) :: cursor
      type(value_t), intent(inout) :: value
      type(error_t), allocatable, intent(out) :: error
      character(len=1) :: quote
      integer :: i, step

      quote = text(cursor%pos:cursor%pos)
      value%first = cursor%pos + 1
      i = value%first
      do
         step = scan(text(i:), quote//achar(10))
         i = i + step
         if (step == 0 .or. text(i - 1:i - 1) /= quote) then
            call fail(error, location(file, cursor%line)//"closing quote is missing: " &
                      //excerpt(rest_of_line(text, cursor%pos)))
            return
         end if
         if (i > len(text)) exit
         if (text(i:i) /= quote) exit
         i = i + 1
      end do
      cursor%pos = i
      value%last = i - 2
      if (value%last - value%first + 1 > max_value_length) then
         call fail(error, location(file, cursor%line)//"text longer than "//integer_text(max_value_length) &
                   //" characters")
      else if (i <= len(text)) then
         if (scan(text(i:i), blanks//",/&!") == 0) then
            call fail(error, location(file, cursor%line)//"expected a blank or comma before " &
                      //excerpt(rest_of_line(text, i)))
         end if
      end if
   end subroutine take_quoted

   pure subroutine take_repeats(text, file, line, repeats, error)
      character(len=*), intent(in) :: text, file
      integer, intent(in) :: line
      integer, intent(out) :: repeats
      type(error_t), allocatable, intent(out) :: error
      integer(i8) :: count
      integer :: status

      repeats = 1
      call parse_integer(text, count, status)
      if (status /= decimal_ok .or. count < 1 .or. count > max_repeats) then
         call fail(error, location(file, line)//"repeat count "//excerpt(text)//"*: must be 1 to " &
                   //integer_text(max_repeats))
         return
      end if
      repeats = int(count)
   end subroutine take_repeats

   !> Reject invalid unquoted words.
   pure subroutine check_word(word, file, line, error)
      character(len=*), intent(in) :: word, file
      integer, intent(in) :: line
      type(error_t), allocatable, intent(out) :: error

      if (len(word) > max_value_length) then
         call fail(error, location(file, line)//"a value longer than "//integer_text(max_value_length)//" characters")
      else if (scan(word, "(%)") > 0) then
         call fail(error, location(file, line)//"'"//excerpt(word)//"': array subscripts, components (%) and " &
                   //"complex numbers are not supported")
      end if
   end subroutine check_word

   !> Check that the last entry does not repeat a key or exceed the maximum number of keys.
   pure subroutine check_key(entries, file, group, error)
      type(entry_t), intent(in) :: entries(:)
      character(len=*), intent(in) :: file, group  !! file name; name of the group
      type(error_t), allocatable, intent(out) :: error
      integer :: i, n

      n = size(entries)
      do i = 1, n - 1
         if (entries(i)%key /= entries(n)%key) cycle
         call fail(error, where()//" "//trim(entries(n)%key)//": is given twice in this group " &
                   //"(first in line "//integer_text(entries(i)%line)//")")
         return
      end do
      if (n > max_keys) call fail(error, where()//": more than "//integer_text(max_keys)//" keys")

   contains

      pure function where()
         character(len=:), allocatable :: where

         where = location(file, entries(n)%line)//"&"//trim(group)
      end function where
   end subroutine check_key

   !> Mark groups that share their name, so that messages identify them by line.
   pure subroutine mark_repeated(groups, file, error)
      type(group_t), intent(inout) :: groups(:)
      character(len=*), intent(in) :: file
      type(error_t), allocatable, intent(out) :: error
      integer :: first(max_groups)  ! first group with each name
      integer :: i, k, n

      n = 0
      do i = 1, size(groups)
         do k = 1, n
            if (groups(first(k))%name == groups(i)%name) exit
         end do
         if (k <= n) then
            groups(first(k))%repeated = .true.
            groups(i)%repeated = .true.
         else if (n == max_groups) then
            call fail(error, location(file, groups(i)%line)//"more than " &
                      //integer_text(max_groups)//" different groups")
            return
         else
            n = n + 1
            first(n) = i
         end if
      end do
   end subroutine mark_repeated

   !> Skip blanks, line ends and comments.
   pure subroutine skip_blanks(text, cursor)
      character(len=*), intent(in) :: text
      type(cursor_t), intent(inout) :: cursor
      logical :: comment

      comment = .false.
      do while (cursor%pos <= len(text))
         select case (text(cursor%pos:cursor%pos))
         case (achar(10))
            cursor%line = cursor%line + 1
            comment = .false.
         case (" ", achar(9), achar(13))
            continue
         case ("!")
            comment = .true.
         case default
            if (.not. comment) return
         end select
         cursor%pos = cursor%pos + 1
      end do
   end subroutine skip_blanks

   !> Skip the characters of an unquoted word, if any.
   pure subroutine take_word(text, cursor)
      character(len=*), intent(in) :: text
      type(cursor_t), intent(inout) :: cursor
      integer :: length

      length = scan(text(cursor%pos:), word_end) - 1
      if (length < 0) length = len(text) - cursor%pos + 1
      cursor%pos = cursor%pos + length
   end subroutine take_word

   pure logical function is_at(text, cursor, sign)
      character(len=*), intent(in) :: text
      type(cursor_t), intent(in) :: cursor
      character(len=1), intent(in) :: sign

      is_at = .false.
      if (cursor%pos <= len(text)) is_at = text(cursor%pos:cursor%pos) == sign
   end function is_at

   !> Return whether a word is a letter followed by letters, digits and underscores.
   pure logical function is_name(word)
      character(len=*), intent(in) :: word
      character(len=*), parameter :: letters = "abcdefghijklmnopqrstuvwxyz"

      is_name = .false.
      if (len(word) < 1 .or. len(word) > name_length) return
      is_name = verify(lower(word(1:1)), letters) == 0 .and. &
                verify(lower(word), letters//digits//"_") == 0
   end function is_name

   pure function rest_of_line(text, first)
      character(len=*), intent(in) :: text
      integer, intent(in) :: first
      character(len=:), allocatable :: rest_of_line
      integer :: length

      length = scan(text(first:), achar(10)//achar(13)) - 1
      if (length < 0) length = len(text) - first + 1
      rest_of_line = trim(text(first:first + length - 1))
   end function rest_of_line

   pure function location(file, line)
      character(len=*), intent(in) :: file
      integer, intent(in) :: line
      character(len=:), allocatable :: location

      location = file//": line "//integer_text(line)//": "
   end function location

   !> Append a value `repeats` times after the first `n` of `values`, which grow by doubling.
   pure subroutine append(values, n, value, repeats)
      type(value_t), allocatable, intent(inout) :: values(:)
      integer, intent(inout) :: n
      type(value_t), intent(in) :: value
      integer, intent(in) :: repeats
      type(value_t), allocatable :: larger(:)

      if (n + repeats > size(values)) then
         allocate (larger(max(2*n, n + repeats)))
         larger(:n) = values(:n)
         call move_alloc(larger, values)
      end if
      values(n + 1:n + repeats) = value
      n = n + repeats
   end subroutine append

   !> Move entries; their values, possibly very many, are not copied.
   pure subroutine move_entries(from, to)
      type(entry_t), intent(inout) :: from(:)
      type(entry_t), intent(inout) :: to(:)
      integer :: i

      do i = 1, size(to)
         to(i)%key = from(i)%key
         to(i)%line = from(i)%line
         call move_alloc(from(i)%text, to(i)%text)
         call move_alloc(from(i)%value, to(i)%value)
      end do
   end subroutine move_entries

   pure subroutine enlarge_groups(groups)
      type(group_t), allocatable, intent(inout) :: groups(:)
      type(group_t), allocatable :: larger(:)

      allocate (larger(2*size(groups)))
      call move_groups(groups, larger(:size(groups)))
      call move_alloc(larger, groups)
   end subroutine enlarge_groups

   pure subroutine move_groups(from, to)
      type(group_t), intent(inout) :: from(:)
      type(group_t), intent(inout) :: to(:)
      integer :: i

      do i = 1, size(to)
         to(i)%name = from(i)%name
         to(i)%line = from(i)%line
         to(i)%repeated = from(i)%repeated
         call move_alloc(from(i)%file, to(i)%file)
         call move_alloc(from(i)%entry, to(i)%entry)
      end do
   end subroutine move_groups

   !> Text of value `i` of an entry, as written, but without quotes.
   pure function raw_value(entry, i)
      type(entry_t), intent(in) :: entry
      integer, intent(in) :: i
      character(len=:), allocatable :: raw_value

      raw_value = entry%text(entry%value(i)%first:entry%value(i)%last)
   end function raw_value
end module rockfall_namelist
