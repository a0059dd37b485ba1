! SPDX-License-Identifier: BSD-3-Clause
!> Text in memory: validation, conversion of numbers and lists, quoting in messages.
module rockfall_text
   use rockfall_kinds, only: wp, i8
   use rockfall_error, only: error_t, fail
   implicit none
   private
   public :: check_text, after_mark, lower, integer_text, real_text, joined, excerpt, line_of, first_repeated
   public :: nearest_names, max_text

   integer, parameter :: max_text = 64*1024**2  !! [bytes] larger text files are rejected

   !> Format an integer without blanks.
   interface integer_text
      module procedure short_text, long_text
   end interface integer_text

contains

   !> Return line k of a text, counted from 1; "" past the end.
   pure function line_of(text, k) result(line)
      character(len=*), intent(in) :: text
      integer, intent(in) :: k
      character(len=:), allocatable :: line
      integer :: first, last, n

      line = ""
      first = 1
      do n = 1, k
         if (first > len(text)) return
         last = index(text(first:), new_line(text))
         if (last == 0) last = len(text) - first + 2
         if (n == k) line = text(first:first + last - 2)
         first = first + last
      end do
   end function line_of

   !> Index of the first name that repeats an earlier one; 0 if all are unique. Uses a hash table, so time is linear in
   !> the number of names.
   pure integer function first_repeated(names) result(k)
      character(len=*), intent(in) :: names(:)
      integer :: table(2*size(names) + 1), slot, i
      integer(i8) :: hash

      table = 0
      do k = 1, size(names)
         hash = 0
         do i = 1, len_trim(names(k))
            hash = modulo(31*hash + iachar(names(k) (i:i)), size(table, kind=i8))
         end do
         slot = int(hash) + 1
         do while (table(slot) /= 0)
            if (names(table(slot)) == names(k)) return
            slot = modulo(slot, size(table)) + 1
         end do
         table(slot) = k
      end do
      k = 0
   end function first_repeated

   !> Names closest to a word by edit distance, the closest first.
   pure function nearest_names(word, names, n) result(nearest)
      character(len=*), intent(in) :: word, names(:)
      integer, intent(in) :: n  !! number of names to return
      character(len=len(names)) :: nearest(n)
      integer :: apart(size(names)), at, k

      do k = 1, size(names)
         apart(k) = changes_between(lower(trim(word)), trim(names(k)))
      end do
      do k = 1, n
         at = minloc(apart, dim=1)
         nearest(k) = names(at)
         apart(at) = huge(apart)
      end do
   end function nearest_names

   !> Minimum number of insertions, deletions and replacements between two words (Levenshtein 1966).
   pure integer function changes_between(from, to) result(changes)
      character(len=*), intent(in) :: from, to
      integer :: row(0:len(to)), before, above, i, j

      row = [(j, j=0, len(to))]
      do i = 1, len(from)
         before = row(0)
         row(0) = i
         do j = 1, len(to)
            above = row(j)
            row(j) = min(above + 1, row(j - 1) + 1, before + merge(0, 1, from(i:i) == to(j:j)))
            before = above
         end do
      end do
      changes = row(len(to))
   end function changes_between

   !> Reject invalid text: control characters other than tabs and line ends, and malformed UTF-8.
   pure subroutine check_text(text, file, error)
      character(len=*), intent(in) :: text
      character(len=*), intent(in) :: file  !! file name, for messages
      type(error_t), allocatable, intent(out) :: error
      integer :: i, line, length

      line = 1
      i = 1
      do while (i <= len(text))
         length = character_length(text, i)
         if (length == 0) then
            call fail(error, file//": line "//integer_text(line)//": character code " &
                      //integer_text(ichar(text(i:i)))//" is not text (UTF-8 expected)")
            return
         end if
         if (text(i:i) == achar(10)) line = line + 1
         i = i + length
      end do
   end subroutine check_text

   !> Length in bytes of the character at `text(i:i)`; 0 if it is not allowed in a text file.
   pure integer function character_length(text, i) result(length)
      character(len=*), intent(in) :: text
      integer, intent(in) :: i
      integer :: code, k

      code = ichar(text(i:i))
      length = 0
      select case (code)
      case (9, 10, 32:126)
         length = 1
         return
      case (13)  ! valid only as part of a line end
         if (i == len(text)) then
            length = 1
         else if (text(i + 1:i + 1) == achar(10)) then
            length = 1
         end if
         return
      case (194:223)
         length = 2
      case (224:239)
         length = 3
      case (240:244)
         length = 4
      case default
         return
      end select

      if (i + length - 1 > len(text)) then
         length = 0
         return
      end if
      code = iand(code, ishft(255, -length - 1))
      do k = i + 1, i + length - 1
         if (iand(ichar(text(k:k)), 192) /= 128) length = 0
         if (length == 0) return
         code = 64*code + iand(ichar(text(k:k)), 63)
      end do
      if (code < ishft(1, 5*length - 4)) length = 0  ! overlong encoding
      if (code > 1114111 .or. (code >= 55296 .and. code <= 57343)) length = 0  ! not a Unicode character
   end function character_length

   !> Index of the first character after an optional byte-order mark.
   pure integer function after_mark(text)
      character(len=*), intent(in) :: text

      after_mark = 1
      if (len(text) < 3) return
      if (text(:3) == char(239)//char(187)//char(191)) after_mark = 4
   end function after_mark

   !> Convert ASCII letters to lower case; other characters are unchanged.
   elemental function lower(text)
      character(len=*), intent(in) :: text
      character(len=len(text)) :: lower
      integer :: i

      lower = text
      do i = 1, len(text)
         if (text(i:i) < "A" .or. text(i:i) > "Z") cycle
         lower(i:i) = achar(iachar(text(i:i)) + 32)
      end do
   end function lower

   pure function short_text(number) result(text)
      integer, intent(in) :: number
      character(len=:), allocatable :: text

      text = long_text(int(number, i8))
   end function short_text

   pure function long_text(number) result(text)
      integer(i8), intent(in) :: number
      character(len=:), allocatable :: text
      character(len=20) :: buffer

      write (buffer, "(i0)") number
      text = trim(buffer)
   end function long_text

   !> Format a number with at most `digits` significant digits, without trailing zeros.
   pure function real_text(number, digits) result(text)
      real(wp), intent(in) :: number
      integer, intent(in) :: digits  !! 2 to 17
      character(len=:), allocatable :: text
      character(len=32) :: buffer, form
      integer :: power, last

      write (form, "(a,i0,a)") "(es32.", digits - 1, "e3)"
      write (buffer, form) number
      read (buffer(29:), *) power
      text = buffer(:27)
      if (power >= -5 .and. power < digits) then
         write (form, "(a,i0,a)") "(f32.", digits - 1 - power, ")"
         write (buffer, form) number
         text = buffer
         power = 0
      end if
      last = len(text)
      if (index(text, ".") > 0) last = verify(text, "0", back=.true.)
      if (text(last:last) == ".") last = last - 1
      text = trim(adjustl(text(:last)))
      if (power /= 0) text = text//"e"//integer_text(power)
   end function real_text

   !> Join names, without trailing blanks, by a separator.
   pure function joined(names, separator) result(text)
      character(len=*), intent(in) :: names(:), separator
      character(len=:), allocatable :: text
      integer :: k

      text = trim(names(1))
      do k = 2, size(names)
         text = text//separator//trim(names(k))
      end do
   end function joined

   !> Shorten text for a one-line message, and replace line ends and tabs. Truncation is marked and never splits a UTF-8
   !> character.
   pure function excerpt(text)
      character(len=*), intent(in) :: text
      character(len=:), allocatable :: excerpt
      integer, parameter :: max_length = 60
      integer :: i, n

      excerpt = text
      if (len(text) > max_length) then
         n = max_length - 3
         do while (iand(ichar(text(n + 1:n + 1)), 192) == 128 .and. n > 1)
            n = n - 1
         end do
         excerpt = text(:n)//"..."
      end if
      do i = 1, len(excerpt)
         if (iachar(excerpt(i:i)) < 32) excerpt(i:i) = " "
      end do
   end function excerpt
end module rockfall_text
