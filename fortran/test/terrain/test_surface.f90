! SPDX-License-Identifier: BSD-3-Clause
!> Surface: methods A and B, from one value, from zones and from rasters.
program test_surface
   use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_positive_inf
   use rockfall_kinds, only: wp, sp, i2
   use rockfall_surface, only: surface_t, rock_radius, method_a
   use check_m, only: check, check_close, finish
   implicit none

   integer, parameter :: n = 1000000
   real(wp), parameter :: u(5) = [1.0e-10_wp, 0.6999_wp, 0.7001_wp, 0.8999_wp, 0.9001_wp]
   integer, parameter :: drawn(5) = [1, 1, 2, 2, 3]

   call random_init(.true., .false.)
   call test_uniform()
   call test_zones()
   call test_rasters()
   call test_absorbing()
   call test_shares()
   call finish()

contains

   subroutine test_uniform()
      type(surface_t) :: surface
      integer :: k

      surface%sizes = reshape([0.25_wp], [1, 1])
      call check_close("method B has its radius as it is", &
                       rock_radius(surface, [3, 4], 0.99_wp), 0.25_wp, 0.0_wp)
      surface%method = method_a
      surface%sizes = reshape([0.3_wp, 0.1_wp, 0.45_wp], [3, 1])
      do k = 1, 5
         surface%size_to_radius = 0.5_wp
         call check_close("a diameter is halved", rock_radius(surface, [3, 4], u(k)), &
                          surface%sizes(drawn(k), 1)/2, 0.0_wp)
         surface%size_to_radius = 1
         call check_close("a radius is not", rock_radius(surface, [3, 4], u(k)), &
                          surface%sizes(drawn(k), 1), 0.0_wp)
      end do
   end subroutine test_uniform

   !> Cells are given by column and row from the north; the zone is the column of the table.
   subroutine test_zones()
      type(surface_t) :: surface
      integer(i2), target :: zone(3, 2)
      integer :: i, r, k

      zone = reshape([1_i2, 2_i2, 3_i2, 3_i2, 1_i2, 2_i2], [3, 2])
      surface%zone2 => zone
      surface%sizes = reshape([0.1_wp, 0.2_wp, 0.3_wp], [1, 3])
      do r = 1, 2
         do i = 1, 3
            call check_close("the zone's radius", rock_radius(surface, [i, r], 0.9_wp), &
                             zone(i, r)*0.1_wp, 1.0e-15_wp)
         end do
      end do
      surface%method = method_a
      surface%sizes = reshape([(0.1_wp*k, k=1, 9)], [3, 3])
      do k = 1, 5
         call check_close("the zone's sizes", rock_radius(surface, [1, 2], u(k)), &
                          0.05_wp*(6 + drawn(k)), 1.0e-15_wp)
      end do
   end subroutine test_zones

   subroutine test_rasters()
      type(surface_t) :: surface
      real(sp), target :: values(3, 2, 3)
      integer :: k

      call random_number(values)
      surface%values => values
      call check_close("the cell's radius", rock_radius(surface, [2, 1], 0.9_wp), &
                       real(values(2, 1, 1), wp), 0.0_wp)
      surface%method = method_a
      do k = 1, 5
         call check_close("the cell's sizes", rock_radius(surface, [3, 2], u(k)), &
                          values(3, 2, drawn(k))/2.0_wp, 0.0_wp)
      end do
   end subroutine test_rasters

   subroutine test_absorbing()
      type(surface_t) :: surface

      surface%sizes = reshape([ieee_value(0.0_wp, ieee_positive_inf)], [1, 1])
      call check("a river stays infinite", rock_radius(surface, [1, 1], 0.5_wp) > huge(1.0_wp))
      surface%method = method_a
      surface%sizes = spread([ieee_value(0.0_wp, ieee_positive_inf)], 1, 3)
      call check("by method A too", rock_radius(surface, [1, 1], 0.5_wp) > huge(1.0_wp))
   end subroutine test_absorbing

   !> Fractions of the draws are within 4 standard errors of 0.7, 0.2 and 0.1.
   subroutine test_shares()
      type(surface_t) :: surface
      real(wp), parameter :: p(3) = [0.7_wp, 0.2_wp, 0.1_wp]
      real(wp) :: draw
      integer :: k, size, hits(3)

      surface%method = method_a
      surface%size_to_radius = 1
      surface%sizes = reshape([1.0_wp, 2.0_wp, 3.0_wp], [3, 1])
      hits = 0
      do k = 1, n
         call random_number(draw)
         size = nint(rock_radius(surface, [1, 1], draw))
         hits(size) = hits(size) + 1
      end do
      do k = 1, 3
         call check("Rg70, Rg20, Rg10 by their shares", &
                    abs(hits(k) - n*p(k)) < 4*sqrt(n*p(k)*(1 - p(k))))
      end do
   end subroutine test_shares
end program test_surface
