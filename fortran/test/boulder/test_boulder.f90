! SPDX-License-Identifier: BSD-3-Clause
!> Boulders: radius and mass of a sphere, distributions of volumes, and the source of each boulder.
program test_boulder
   use rockfall_kinds, only: wp, i8
   use rockfall_random, only: random_key_t, random_key, normal_table_t, normal_table
   use rockfall_boulder, only: boulder_t, volume_distribution_t, release_t, draw_boulder, max_volume, mean_volume, &
      source_of, inertia_factor, normal_volume, uniform_volume, lognormal_volume, list_volume
   use check_m, only: check, check_close, finish
   implicit none

   integer, parameter :: n = 400000
   real(wp), parameter :: pi = acos(-1.0_wp)
   type(normal_table_t) :: table
   type(random_key_t) :: key
   real(wp) :: volume(n)

   table = normal_table()
   key = random_key(7_i8)
   call test_sphere()
   call test_normal()
   call test_truncation()
   call test_uniform()
   call test_lognormal()
   call test_list()
   call test_sources()
   call finish()

contains

   !> Draw the volumes of boulders 1 to n, and check the bounds of the distribution.
   subroutine draw(volumes)
      type(volume_distribution_t), intent(in) :: volumes
      type(boulder_t) :: boulder
      integer :: k

      do k = 1, n
         boulder = draw_boulder(volumes, table, key, int(k, i8))
         volume(k) = boulder%volume
      end do
      call check("the largest volume", maxval(volume) <= max_volume(volumes, table))
      call check("the bound of the mean", sum(volume)/n < 1.01_wp*mean_volume(volumes))
   end subroutine draw

   !> Check mean and standard deviation of volumes within 4 standard errors (for the latter from the fourth moment).
   subroutine check_moments(name, mean, std)
      character(len=*), intent(in) :: name
      real(wp), intent(in) :: mean, std
      real(wp) :: variance, fourth

      call check(name//": mean", abs(sum(volume)/n - mean) < 4*std/sqrt(real(n, wp)))
      variance = sum((volume - mean)**2)/n
      fourth = sum((volume - mean)**4)/n
      call check(name//": std", &
                 abs(variance - std**2) < 4*sqrt((fourth - variance**2)/n))
   end subroutine check_moments

   subroutine test_sphere()
      type(volume_distribution_t) :: volumes
      type(boulder_t) :: boulder

      volumes%mean = 0.8_wp
      volumes%density = 2700
      boulder = draw_boulder(volumes, table, key, 5_i8)
      call check_close("a fixed volume", boulder%volume, 0.8_wp, 0.0_wp)
      call check_close("the volume of its radius", 4*pi/3*boulder%radius**3, 0.8_wp, 1.0e-15_wp)
      call check_close("its mass", boulder%mass, 2160.0_wp, 1.0e-15_wp)
      call check_close("inertia of a sphere", inertia_factor, 0.4_wp, 0.0_wp)
   end subroutine test_sphere

   subroutine test_normal()
      call draw(volume_distribution_t(kind=normal_volume, mean=0.8_wp, std=0.15_wp))
      call check_moments("normal", 0.8_wp, 0.15_wp)  ! the mean is 5 standard deviations above zero
      call check("no two alike", abs(volume(1) - volume(2)) > 0)
   end subroutine test_normal

   !> Check the moments of a normal distribution truncated at zero.
   subroutine test_truncation()
      real(wp), parameter :: mean = 0.5_wp, std = 1.0_wp
      real(wp) :: density, above, shift

      call draw(volume_distribution_t(kind=normal_volume, mean=mean, std=std))
      call check("no volume below zero", all(volume > 0))
      density = exp(-0.5_wp*(mean/std)**2)/sqrt(2*pi)
      above = 0.5_wp*erfc(-mean/std/sqrt(2.0_wp))
      shift = density/above
      call check_moments("truncated", mean + std*shift, &
                         std*sqrt(1 - shift*mean/std - shift**2))
   end subroutine test_truncation

   subroutine test_uniform()
      call draw(volume_distribution_t(kind=uniform_volume, min=0.4_wp, max=1.6_wp))
      call check("uniform within its bounds", minval(volume) > 0.4_wp .and. maxval(volume) < 1.6_wp)
      call check("and up to them", minval(volume) < 0.4001_wp .and. maxval(volume) > 1.5999_wp)
      call check_moments("uniform", 1.0_wp, 1.2_wp/sqrt(12.0_wp))
   end subroutine test_uniform

   !> The given mean and standard deviation are those of the volume; its logarithm is normal.
   subroutine test_lognormal()
      real(wp) :: variance

      call draw(volume_distribution_t(kind=lognormal_volume, mean=2.0_wp, std=1.5_wp))
      call check_moments("lognormal", 2.0_wp, 1.5_wp)
      volume = log(volume)
      variance = log(1 + 0.75_wp**2)
      call check_moments("its logarithm", log(2.0_wp) - variance/2, sqrt(variance))
   end subroutine test_lognormal

   subroutine test_list()
      real(wp), parameter :: list(4) = [0.5_wp, 1.0_wp, 2.0_wp, 1.0_wp]
      type(volume_distribution_t) :: volumes

      volumes%kind = list_volume
      volumes%list = list
      call draw(volumes)
      call check("only volumes of the list", all(volume >= 2 .or. volume <= 0.5_wp &
                                                 .or. (volume >= 1 .and. volume <= 1)))
      call check_moments("list", 1.125_wp, sqrt(sum((list - 1.125_wp)**2)/4))
   end subroutine test_list

   !> Boulder b has source (b - 1)/n + 1.
   subroutine test_sources()
      type(release_t) :: release
      integer(i8), parameter :: number(6) = [1_i8, 1000_i8, 1001_i8, 2000_i8, 2001_i8, 10_i8**12]
      integer(i8), parameter :: source(6) = [1_i8, 1_i8, 2_i8, 2_i8, 3_i8, 10_i8**9]
      integer :: k

      release%boulders_per_source = 1000
      do k = 1, 6
         call check("the source of a boulder", source_of(release, number(k)) == source(k))
      end do
   end subroutine test_sources
end program test_boulder
