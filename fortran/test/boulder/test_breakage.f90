! SPDX-License-Identifier: BSD-3-Clause
!> Breakage: the published rule computed by hand, conservation of volume, and fragments within their cone.
program test_breakage
   use rockfall_kinds, only: wp, i8
   use rockfall_math, only: pi, degree
   use rockfall_random, only: random_key, random_words, uniform, fragment_number, boulder_number, for_breakage, &
                              words_per_block
   use rockfall_boulder, only: boulder_t
   use rockfall_breakage, only: split_t, area_ratio, fractal_dimension, surviving_fraction, split_volume, fragment_of, &
                                direction_in_cone, away_from_ground
   use check_m, only: check, check_close, finish
   implicit none

   call test_published_rule()
   call test_dimension_is_held()
   call test_series()
   call test_mass()
   call test_room()
   call test_cone()
   call test_ground()
   call test_numbers()
   call finish()

contains

   !> Computed by hand: 1 m3 of 2700 kg/m3 at 10 m/s has 135 kJ, and 0.0031*135000**0.7562 = 23.492 m2 of new surface.
   subroutine test_published_rule()
      call check_close("area ratio", area_ratio(135000.0_wp, 1.0_wp), 23.492_wp/29.492_wp, 1.0e-4_wp)
      call check_close("no energy", area_ratio(0.0_wp, 1.0_wp), 0.0_wp, 0.0_wp)
      ! with lengths doubled, the volume is eight times and S0 four times as large
      call check_close("size", area_ratio(135000.0_wp, 8.0_wp), 23.492_wp/47.492_wp, 1.0e-4_wp)
      ! A_r = 0.3: b = 2.00375, q = 0.84625, D = 3 + ln(0.15375)/ln(2.00375)
      call check_close("survives", surviving_fraction(0.3_wp), 0.84625_wp, 1.0e-12_wp)
      call check_close("dimension", fractal_dimension(0.3_wp), 3 + log(0.15375_wp)/log(2.00375_wp), 1.0e-12_wp)
   end subroutine test_published_rule

   !> The dimension D increases up to the area ratio of its published maximum, and is constant beyond it.
   subroutine test_dimension_is_held()
      real(wp) :: ratio, largest, published
      integer :: k

      largest = 0
      do k = 25, 64
         ratio = 0.01_wp*k
         published = 3 + log(0.5125_wp*ratio)/log(2.4875_wp - 1.6125_wp*ratio)
         largest = max(largest, published)
         if (k <= 43) call check_close("as published", fractal_dimension(ratio), published, 1.0e-12_wp)
         if (k > 43) call check("beyond its maximum", published < fractal_dimension(ratio))
      end do
      call check_close("held at the maximum", fractal_dimension(0.99_wp), largest, 1.0e-5_wp)
   end subroutine test_dimension_is_held

   !> Volumes of the first series are q i**(-1/D) V: the number of fragments above v is proportional to v**(-D).
   subroutine test_series()
      type(split_t) :: split
      real(wp), parameter :: ratio = 0.3_wp, volume = 5.0_wp
      real(wp) :: d, slope
      integer :: i, n

      call split_volume(volume, ratio, 1.0e-6_wp, 10000, split)
      d = fractal_dimension(ratio)
      n = 30
      do i = 1, n
         call check_close("series", split%volume(i), 0.84625_wp*volume*real(i, wp)**(-1/d), 1.0e-9_wp)
      end do
      slope = log(real(n, wp))/log(split%volume(n)/split%volume(1))
      call check_close("exponent", slope, -d, 1.0e-9_wp)
   end subroutine test_series

   !> Fragments and fines add up to the boulder for any volume, energy and limits. No fragment is smaller than allowed,
   !> and the fines would not make another fragment.
   subroutine test_mass()
      type(split_t) :: split
      real(wp) :: volume, ratio, least, q
      integer :: i, k, m

      do m = 1, 4
         least = 10.0_wp**(-m)
         do k = -3, 9
            volume = 0.7_wp*2.0_wp**k
            do i = 25, 99
               ratio = 0.01_wp*i
               q = surviving_fraction(ratio)
               call split_volume(volume, ratio, least, 10000, split)
               call check_close("sum", sum(split%volume) + split%fines, volume, 1.0e-14_wp*volume)
               if (q*volume < least) then
                  call check("too small to break", size(split%volume) == 1 .and. .not. split%fines > 0)
                  cycle
               end if
               call check("breaks", split%volume(1) < volume)
               call check("least", all(split%volume >= least))
               call check("fines", split%fines >= 0 .and. q*split%fines < least)
               call check("not capped", .not. split%capped)
            end do
         end do
      end do
   end subroutine test_mass

   !> With a small maximum number, the largest fragments are unchanged, and the remainder stays one block.
   subroutine test_room()
      type(split_t) :: full, few
      integer :: room

      call split_volume(3.0_wp, 0.8_wp, 0.001_wp, 10000, full)
      do room = 2, size(full%volume) - 1
         call split_volume(3.0_wp, 0.8_wp, 0.001_wp, room, few)
         call check("room", size(few%volume) == room .and. few%capped .and. .not. few%fines > 0)
         call check("largest", all(abs(few%volume(:room - 1) - full%volume(:room - 1)) <= 0))
         call check_close("rest", sum(few%volume), 3.0_wp, 1.0e-14_wp)
      end do
      call split_volume(3.0_wp, 0.8_wp, 0.001_wp, size(full%volume), few)
      call check("as much as needed", .not. few%capped .and. size(few%volume) == size(full%volume))
      call split_volume(3.0_wp, 0.8_wp, 0.001_wp, 1, few)
      call check("no room", few%capped .and. size(few%volume) == 1 .and. .not. few%fines > 0)
   end subroutine test_room

   !> Directions are uniform within the cone: the mean cosine of the angle to the axis is the middle of its range, and
   !> directions average to the axis. Speeds are unchanged.
   subroutine test_cone()
      integer, parameter :: n = 20000
      real(wp), parameter :: half = 25*degree
      real(wp) :: v(3), turned(3), total(3), cosine, mean
      integer(i8) :: word(words_per_block)
      integer :: axis, k

      do axis = 1, 3
         v = 0.3_wp
         v(axis) = -7
         total = 0
         mean = 0
         do k = 1, n
            word = random_words(random_key(5_i8), for_breakage, int(k, i8), 0_i8, 0_i8)
            turned = direction_in_cone(v, half, uniform(word(:2)))
            cosine = dot_product(turned, v)/dot_product(v, v)
            if (cosine < cos(half) - 1.0e-12_wp) call check("within the cone", .false.)
            if (abs(dot_product(turned, turned)/dot_product(v, v) - 1) > 1.0e-12_wp) call check("speed", .false.)
            total = total + turned/n
            mean = mean + cosine/n
         end do
         call check_close("mean cosine", mean, (1 + cos(half))/2, 1.0e-3_wp)
         call check_close("about the axis", sqrt(sum((total - mean*v)**2))/7, 0.0_wp, 0.01_wp)
      end do
      call check("at rest", all(abs(direction_in_cone([0.0_wp, 0.0_wp, 0.0_wp], half, [0.5_wp, 0.5_wp])) <= 0))
   end subroutine test_cone

   !> A direction into the ground is mirrored: only its normal component changes sign, and the speed is unchanged.
   subroutine test_ground()
      real(wp), parameter :: g(2) = [0.5_wp, -1.0_wp], normal(3) = [-0.5_wp, 1.0_wp, 1.0_wp]/1.5_wp
      real(wp) :: v(3), away(3)

      v = [1.0_wp, 2.0_wp, -8.0_wp]
      away = away_from_ground(v, g)
      call check_close("normal", dot_product(away, normal), -dot_product(v, normal), 1.0e-12_wp)
      call check_close("speed", dot_product(away, away), dot_product(v, v), 1.0e-12_wp)
      call check("already away", all(abs(away_from_ground(away, g) - away) <= 0))
   end subroutine test_ground

   !> Each fragment has a unique number, fragment 0 is the boulder itself, and mass is proportional to volume.
   subroutine test_numbers()
      type(boulder_t) :: boulder, fragment

      call check("itself", fragment_number(4711_i8, 0_i8) == 4711)
      call check("others", fragment_number(4711_i8, 3_i8) /= fragment_number(4711_i8, 4_i8))
      call check("of it", boulder_number(fragment_number(4711_i8, 123456_i8)) == 4711)
      boulder = boulder_t(2.0_wp, 0.0_wp, 5400.0_wp)
      fragment = fragment_of(boulder, 0.5_wp)
      call check_close("mass", fragment%mass, 1350.0_wp, 1.0e-9_wp)
      call check_close("radius", 4*pi/3*fragment%radius**3, 0.5_wp, 1.0e-12_wp)
   end subroutine test_numbers
end program test_breakage
