! SPDX-License-Identifier: BSD-3-Clause
!> Elementary functions built only from + - * / and sqrt, for bitwise identical results on all machines. The last bits
!> of libm depend on the type of processor.
module rockfall_math
   use rockfall_kinds, only: wp, sp, i4, i8
   implicit none
   private
   public :: pi, degree, real_of, squared_length, logarithm, exponential, cube_root, power, sine_cosine, squared_sine
   public :: tangent, arcsine, rounded_up, fraction_bits, exponent_bias, bits_of_one

   real(wp), parameter :: pi = 3.14159265358979323846_wp
   real(wp), parameter :: degree = pi/180.0_wp  !! one degree [rad]
   real(wp), parameter :: ln2 = 0.69314718055994530942_wp
   !> Layout of an IEEE double: sign, 11 bits of exponent + 1023, 52 bits of fraction.
   integer, parameter :: fraction_bits = 52, exponent_bias = 1023
   integer(i8), parameter :: fraction_mask = int(z"000FFFFFFFFFFFFF", i8)
   integer(i8), parameter :: bits_of_one = int(z"3FF0000000000000", i8)
   real(wp), parameter :: sqrt2 = 1.4142135623730951_wp
   real(wp), parameter :: first_whole = 2.0_wp**fraction_bits  !! doubles from here to twice this value are integers
   integer(i8), parameter :: bits_of_whole = int(z"4330000000000000", i8)

contains

   !> Convert an integer 0..2**52 - 1 exactly to a real. Most processors lack a vector conversion of 64-bit integers;
   !> this form vectorises everywhere.
   elemental real(wp) function real_of(n)
      integer(i8), intent(in) :: n

      real_of = transfer(ior(n, bits_of_whole), real_of) - first_whole
   end function real_of

   !> Smallest single-precision number not below a given number.
   elemental real(sp) function rounded_up(x)
      real(wp), intent(in) :: x

      integer(i4) :: bits

      rounded_up = real(x, sp)
      bits = transfer(rounded_up, bits)
      bits = bits + merge(1, -1, bits >= 0)  ! bits of the next larger number; `nearest` would call the system's library
      if (real(rounded_up, wp) < x) rounded_up = transfer(bits, rounded_up)
   end function rounded_up

   pure real(wp) function squared_length(v)
      real(wp), intent(in) :: v(3)  !! any unit

      squared_length = v(1)*v(1) + v(2)*v(2) + v(3)*v(3)
   end function squared_length

   !> Natural logarithm of a positive normal number, within 5 units in the last place.
   elemental real(wp) function logarithm(x)
      real(wp), intent(in) :: x  !! > 0 [-]
      integer(i8) :: bits
      real(wp) :: e, m, s, q, q2, q4
      real(wp), parameter :: r(9) = [1.0_wp/3, 1.0_wp/5, 1.0_wp/7, 1.0_wp/9, 1.0_wp/11, 1.0_wp/13, &
                                     1.0_wp/15, 1.0_wp/17, 1.0_wp/19]

      bits = transfer(x, bits)
      e = real_of(shiftr(bits, fraction_bits)) - exponent_bias  ! x = m 2**e, 1 <= m < 2
      m = transfer(ior(iand(bits, fraction_mask), bits_of_one), m)
      if (m > sqrt2) then
         m = 0.5_wp*m
         e = e + 1
      end if
      s = (m - 1)/(m + 1)  ! log m = 2 artanh s, |s| <= 0.172: the series to s**19 leaves 1e-17
      q = s*s
      q2 = q*q
      q4 = q2*q2
      logarithm = e*ln2 + 2*s*(((1 + q*r(1)) + q2*(r(2) + q*r(3))) + q4*((r(4) + q*r(5)) + q2*(r(6) + q*r(7)) &
                                                                           + q4*(r(8) + q*r(9))))
   end function logarithm

   !> e**x for |x| < 700, within 5 + 2 |x| units in the last place: e**x = 2**k e**r.
   elemental real(wp) function exponential(x)
      real(wp), intent(in) :: x  !! [-]
      integer :: k, n
      real(wp) :: r, term

      k = nint(x/ln2)
      r = x - k*ln2
      term = 1
      exponential = 1
      do n = 1, 18  ! |r| <= 0.35: r**19/19! < 2e-26
         term = term*r/n
         exponential = exponential + term
      end do
      exponential = scale(exponential, k)
   end function exponential

   !> Power of a positive number.
   elemental real(wp) function power(base, exponent)
      real(wp), intent(in) :: base      !! > 0, any [unit]
      real(wp), intent(in) :: exponent  !! [-]

      power = exponential(exponent*logarithm(base))
   end function power

   !> Cube root of a positive number.
   elemental real(wp) function cube_root(x)
      real(wp), intent(in) :: x  !! > 0, any unit
      integer :: n

      cube_root = exponential(logarithm(x)/3)
      do n = 1, 2  ! two Newton steps remove the rounding errors of logarithm and exponential
         cube_root = cube_root - (cube_root - x/(cube_root*cube_root))/3
      end do
   end function cube_root

   !> Sine and cosine for |angle| <= 0.88 rad (50 degrees), by Taylor series.
   elemental subroutine sine_cosine(angle, s, c)
      real(wp), intent(in) :: angle  !! [rad]
      real(wp), intent(out) :: s, c  !! [-]
      real(wp), parameter :: s3 = -1.0_wp/6, s5 = -s3/20, s7 = -s5/42, s9 = -s7/72, s11 = -s9/110, &
                             s13 = -s11/156, s15 = -s13/210
      real(wp), parameter :: c2 = -0.5_wp, c4 = -c2/12, c6 = -c4/30, c8 = -c6/56, c10 = -c8/90, &
                             c12 = -c10/132, c14 = -c12/182, c16 = -c14/240
      real(wp) :: q

      q = angle*angle
      s = angle*(1 + q*(s3 + q*(s5 + q*(s7 + q*(s9 + q*(s11 + q*(s13 + q*s15)))))))
      c = 1 + q*(c2 + q*(c4 + q*(c6 + q*(c8 + q*(c10 + q*(c12 + q*(c14 + q*c16)))))))
   end subroutine sine_cosine

   !> Arcsine [rad], within 2e-15: half angles down to 11 degrees or less, then the series.
   elemental real(wp) function arcsine(x) result(angle)
      real(wp), intent(in) :: x  !! -1..1 [-]
      real(wp) :: s, q, term
      integer :: n

      s = max(-1.0_wp, min(1.0_wp, x))
      do n = 1, 3
         s = s/sqrt(2*(1 + sqrt((1 - s)*(1 + s))))  ! sin(a/2) = sin(a)/(2 cos(a/2))
      end do
      q = s*s
      term = s
      angle = s
      do n = 1, 11  ! |s| <= 0.196: each term is at least 26 times smaller than the previous
         term = term*q*(2*n - 1)/(2*n)
         angle = angle + term/(2*n + 1)
      end do
      angle = 8*angle
   end function arcsine

   !> Squared sine [-] of an angle from 0 to 90 degrees; exact at both ends.
   elemental real(wp) function squared_sine(degrees)
      real(wp), intent(in) :: degrees  !! [degree]
      real(wp) :: s, c

      call sine_cosine(min(degrees, 90 - degrees)*degree, s, c)
      squared_sine = merge(s, c, degrees <= 45)**2
   end function squared_sine

   !> Tangent [-] of an angle from 0 to less than 90 degrees, without libm; exactly 1 at 45 degrees.
   elemental real(wp) function tangent(degrees)
      real(wp), intent(in) :: degrees  !! [degree]
      real(wp) :: s, c

      if (degrees < 22.5_wp) then
         call sine_cosine(degrees*degree, s, c)
         tangent = s/c
      else  ! tan(45 + b) = (cos b + sin b)/(cos b - sin b)
         call sine_cosine((degrees - 45)*degree, s, c)
         tangent = (c + s)/(c - s)
      end if
   end function tangent
end module rockfall_math
