! SPDX-License-Identifier: BSD-3-Clause
!> Correctly rounded conversion of decimal text to numbers. Any text that is not a valid number gives an error status.
module rockfall_decimal
   use rockfall_kinds, only: wp, i8
   implicit none
   private
   public :: parse_real, parse_integer, decimal_ok, decimal_malformed

   integer, parameter :: decimal_ok = 0         !! the number was read
   integer, parameter :: decimal_malformed = 1  !! not a decimal number (Inf and NaN are not accepted)
   integer, parameter :: decimal_overflow = 2   !! valid number, too large for its type

   integer, parameter :: max_digits = 18         !! significant digits that always fit in an i8
   integer, parameter :: largest_power = 308     !! largest power of ten in a double
   integer(i8), parameter :: largest_17_digits = 17976931348623157_i8  !! first 17 digits of the largest double
   integer(i8), parameter :: max_exact = 2_i8**53  !! integers up to this are exact doubles
   integer, parameter :: exact_power = 22        !! powers of ten up to this are exact doubles
   integer, parameter :: i128 = selected_int_kind(38)
   integer :: k_
   real(wp), parameter :: ten_to(0:exact_power) = [(10.0_wp**k_, k_=0, exact_power)]
   integer(i128), parameter :: integer_ten_to(0:max_digits) = [(10_i128**k_, k_=0, max_digits)]

   !> Parsed decimal number: sign * mantissa * 10**power, if no digit was `dropped`.
   type :: decimal_t
      logical :: negative = .false., dropped = .false.
      integer(i8) :: mantissa = 0  !! the first `max_digits` significant digits
      integer :: digits = 0        !! number of digits of the mantissa
      integer :: power = 0
   end type decimal_t

contains

   !> Parse a real number such as `-2`, `.5`, `1.5e3`, `1d-3` to the nearest double.
   pure subroutine parse_real(text, value, status)
      character(len=*), intent(in) :: text   !! without blanks
      real(wp), intent(out) :: value
      integer, intent(out) :: status
      type(decimal_t) :: number
      logical :: ok

      value = 0.0_wp
      status = decimal_malformed
      call split_number(text, number, ok)
      if (.not. ok) return
      status = decimal_overflow
      if (overflows(number)) return
      status = decimal_ok
      if (number%mantissa == 0 .or. number%power < -400) then
         value = 0.0_wp
      else if (number%dropped .or. abs(number%power) > exact_power) then
         read (text, *) value
         return
      else if (number%mantissa <= max_exact) then  ! both are exact doubles: only one rounding
         if (number%power < 0) value = real(number%mantissa, wp)/ten_to(-number%power)
         if (number%power >= 0) value = real(number%mantissa, wp)*ten_to(number%power)
      else if (number%power <= 0 .and. number%power >= -max_digits) then
         value = rounded_quotient(number%mantissa, -number%power)
      else
         read (text, *) value
         return
      end if
      if (number%negative) value = -value
   end subroutine parse_real

   !> Compute mantissa/10**power with one rounding, for 2**53 < mantissa < 10**18 and power from 0 to 18.
   pure real(wp) function rounded_quotient(mantissa, power)
      integer(i8), intent(in) :: mantissa
      integer, intent(in) :: power
      integer(i128) :: dividend, quotient_bits

      dividend = shiftl(int(mantissa, i128), 64)
      quotient_bits = dividend/integer_ten_to(power)
      ! at least 57 bits, so the last bit can serve as a sticky bit for the remainder
      if (quotient_bits*integer_ten_to(power) /= dividend) quotient_bits = ior(quotient_bits, 1_i128)
      rounded_quotient = real(quotient_bits, wp)*2.0_wp**(-64)
   end function rounded_quotient

   !> Parse text of the form [+-]digits[.digits][(e|d)[+-]digits], with at least one digit before the exponent.
   pure subroutine split_number(text, number, ok)
      character(len=*), intent(in) :: text
      type(decimal_t), intent(out) :: number
      logical, intent(out) :: ok
      integer :: i, digit, n_digits, exponent
      logical :: point

      ok = .false.
      i = 1
      if (len(text) == 0) return
      if (scan(text(1:1), "+-") == 1) i = 2
      number%negative = text(1:1) == "-"
      point = .false.
      n_digits = 0
      do i = i, len(text)
         digit = iachar(text(i:i)) - iachar("0")
         if (digit >= 0 .and. digit <= 9) then
            n_digits = n_digits + 1
            call add_digit(number, digit, point)
         else if (text(i:i) == "." .and. .not. point) then
            point = .true.
         else
            exit
         end if
      end do
      if (n_digits == 0) return
      if (i <= len(text)) then
         if (scan(text(i:i), "eEdD") == 0) return
         call read_exponent(text(i + 1:), exponent, ok)
         if (.not. ok) return
         number%power = number%power + exponent
      end if
      ok = .true.
   end subroutine split_number

   pure subroutine add_digit(number, digit, after_point)
      type(decimal_t), intent(inout) :: number
      integer, intent(in) :: digit
      logical, intent(in) :: after_point

      if (number%digits < max_digits) then
         number%mantissa = 10*number%mantissa + digit
         if (number%mantissa > 0) number%digits = number%digits + 1
         if (after_point) number%power = number%power - 1
      else
         if (digit > 0) number%dropped = .true.
         if (.not. after_point) number%power = number%power + 1
      end if
   end subroutine add_digit

   pure subroutine read_exponent(text, exponent, ok)
      character(len=*), intent(in) :: text
      integer, intent(out) :: exponent
      logical, intent(out) :: ok
      integer, parameter :: beyond_all = 100000  ! larger exponents overflow or give zero, whatever the digits
      integer :: i, first

      exponent = 0
      first = 1
      if (len(text) > 0) then
         if (scan(text(1:1), "+-") == 1) first = 2
      end if
      ok = first <= len(text) .and. verify(text(first:), "0123456789") == 0
      if (.not. ok) return
      do i = first, len(text)
         exponent = min(10*exponent + iachar(text(i:i)) - iachar("0"), beyond_all)
      end do
      if (text(1:1) == "-") exponent = -exponent
   end subroutine read_exponent

   !> Detect overflow before the conversion, which would raise the overflow flag (and trap where trapping is enabled).
   pure logical function overflows(number)
      type(decimal_t), intent(in) :: number
      integer(i8) :: first_17
      integer :: power

      overflows = .false.
      if (number%mantissa == 0) return
      power = number%power + number%digits - 1  ! power of the leading digit
      if (number%digits > 17) then
         first_17 = number%mantissa/10_i8**(number%digits - 17)
      else
         first_17 = number%mantissa*10_i8**(17 - number%digits)
      end if
      overflows = power > largest_power .or. &
                  (power == largest_power .and. first_17 > largest_17_digits)
   end function overflows

   !> Parse a 64-bit integer; `3.7` and `3.0` are malformed.
   pure subroutine parse_integer(text, value, status)
      character(len=*), intent(in) :: text  !! without blanks
      integer(i8), intent(out) :: value
      integer, intent(out) :: status
      integer :: i, first, digit

      value = 0
      status = decimal_malformed
      first = 1
      if (len(text) > 0) then
         if (scan(text(1:1), "+-") == 1) first = 2
      end if
      if (first > len(text)) return
      if (verify(text(first:), "0123456789") > 0) return
      status = decimal_overflow
      do i = first, len(text)
         digit = iachar(text(i:i)) - iachar("0")
         if (value > (huge(value) - digit)/10) return
         value = 10*value + digit
      end do
      if (text(1:1) == "-") value = -value
      status = decimal_ok
   end subroutine parse_integer
end module rockfall_decimal
