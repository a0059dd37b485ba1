! SPDX-License-Identifier: BSD-3-Clause
!> Decimal commas and thousands commas in lists of numbers: `600,5` is two numbers in namelist text.
!>
!> Only a comma without adjacent blanks can be decimal. A list without blanks, `600,620,640`, is a list.
module rockfall_decimal_commas
   use rockfall_namelist, only: entry_t, raw_value
   implicit none
   private
   public :: comma_number, misread_number, point_rule

   character(len=*), parameter :: digits = "0123456789"
   integer, parameter :: joined = 1, wrapped = 2, apart = 3  !! a comma; a comma and a line end; other separators

contains

   !> Index of the integer whose decimals may follow a bare comma; 0 if none. Of several candidates, the number with
   !> the fewest decimals is chosen: `600,620,5` has 620,5.
   pure integer function comma_number(entry) result(found)
      type(entry_t), intent(in) :: entry
      integer :: k, digits_behind, fewest

      found = 0
      fewest = huge(fewest)
      do k = 1, size(entry%value) - 1
         if (.not. has_decimals(entry, k)) cycle
         digits_behind = len(raw_value(entry, k + 1))
         if (digits_behind >= fewest) cycle
         found = k
         fewest = digits_behind
      end do
   end function comma_number

   !> Index of the first number in a list whose comma is probably decimal, because blanks also separate numbers
   !> (`600,5 620,5`), or because long and short numbers alternate (`600,5,620,5`); 0 if none.
   pure integer function misread_number(entry) result(found)
      type(entry_t), intent(in) :: entry
      integer, dimension(size(entry%value)) :: gap, length  ! separator before each number; length of each number
      integer :: k, n

      n = size(gap)
      found = comma_number(entry)
      if (found == 0 .or. n < 3) then
         found = 0
         return
      end if
      gap = [apart, (gap_before(entry, k), k=2, n)]
      if (any(gap(2:) == apart)) then
         if (.not. any(gap(2:n - 1) == joined .and. gap(3:) == joined)) return
         if (all([(is_thousands(entry, gap, k), k=1, n)])) return
      else if (mod(n, 2) == 0 .and. all([(has_decimals(entry, k), k=1, n - 1, 2)])) then
         length = entry%value%last - entry%value%first + 1
         if (minval(length(1::2)) > maxval(length(2::2))) return
      end if
      found = 0
   end function misread_number

   !> Rule that shows number `k` in correct notation, if the next number gives its decimals or thousands.
   pure function point_rule(entry, k) result(rule)
      type(entry_t), intent(in) :: entry
      integer, intent(in) :: k
      character(len=:), allocatable :: rule, whole, rest

      whole = raw_value(entry, k)
      rest = raw_value(entry, k + 1)
      rule = whole//"."//rest
      if (index(rest, ".") > 0) rule = whole//rest  ! thousands comma
      if (len(rest) == 3 .and. verify(rest, digits) == 0) rule = rule//" or "//whole//rest  ! may be a thousands comma
      rule = whole//","//rest//" is two numbers: write "//rule//", or put a blank after each comma of a list"
   end function point_rule

   !> Return whether number `k` is an integer, and the number after its bare comma has no sign.
   pure logical function has_decimals(entry, k)
      type(entry_t), intent(in) :: entry
      integer, intent(in) :: k
      character(len=:), allocatable :: whole, rest

      has_decimals = .false.
      if (gap_before(entry, k + 1) /= joined) return
      whole = raw_value(entry, k)
      rest = raw_value(entry, k + 1)
      has_decimals = verify(whole(verify(whole, "+-"):), digits) == 0 .and. scan(rest(:1), digits) == 1 &
                     .and. (scan(rest, ".") == 0 .or. scan(rest, ".") == 4)
   end function has_decimals

   !> Return whether number `k` can be a group of thousands, or a separate number.
   pure logical function is_thousands(entry, gap, k)
      type(entry_t), intent(in) :: entry
      integer, intent(in) :: gap(:), k
      character(len=:), allocatable :: number
      integer :: length

      number = raw_value(entry, k)
      length = verify(number//"x", digits//"+-") - 1
      is_thousands = gap(k) /= wrapped
      if (gap(k) == joined) then
         is_thousands = length == 3 .and. verify(number, digits//".") == 0
      else if (k < size(gap)) then
         if (gap(k + 1) == joined) is_thousands = is_thousands .and. length == len(number) .and. length <= 4 &
                                                  .and. verify(number, "0+-") == 1
      end if
   end function is_thousands

   !> Separator between number `k` and the previous one.
   pure integer function gap_before(entry, k) result(gap)
      type(entry_t), intent(in) :: entry
      integer, intent(in) :: k

      integer :: first, last

      first = entry%value(k - 1)%last + 1
      last = entry%value(k)%first - 1
      gap = apart
      if (index(entry%text(first:last), ",") == 0) return
      if (first == last) gap = joined
      if (index(entry%text(first:last), achar(10)) > 0) gap = wrapped
   end function gap_before
end module rockfall_decimal_commas
