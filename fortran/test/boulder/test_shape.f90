! SPDX-License-Identifier: BSD-3-Clause
!> Volumes and moments of inertia of shapes, as textbooks have them.
program test_shape
   use rockfall_kinds, only: wp
   use rockfall_math, only: pi
   use rockfall_boulder, only: inertia_factor, source_boulder_t, boulder_t, boulder_of
   use rockfall_shape, only: shape_volume, shape_inertia, shapes
   use check_m, only: check, check_close, finish
   implicit none
   integer, parameter :: rectangular = 1, ellipsoid = 2, sphere = 3, disc = 4
   real(wp), parameter :: near = 1.0e-14_wp, d(3) = [0.5_wp, 0.8_wp, 1.5_wp]

   call test_volumes()
   call test_inertia()
   call test_of_source()
   call finish()

contains

   subroutine test_volumes()
      call check_close("rectangular", shape_volume(rectangular, d), 0.6_wp, near)
      call check_close("ellipsoid", shape_volume(ellipsoid, d), pi*0.1_wp, near)
      call check_close("sphere of the mean side", shape_volume(sphere, d), pi/6*(2.8_wp/3)**3, near)
      call check_close("disc", shape_volume(disc, d), pi*0.15_wp, near)
   end subroutine test_volumes

   !> The mean of the three principal moments, over m R**2: at least that of the sphere.
   subroutine test_inertia()
      real(wp), parameter :: one(3) = 1.0_wp
      real(wp) :: radius2, u(3)
      integer :: shape, k

      radius2 = (3/(4*pi))**(2.0_wp/3)
      call check_close("a cube: m a**2/6", shape_inertia(rectangular, one), 1/(6*radius2), near)
      call check_close("a round ellipsoid is a sphere", shape_inertia(ellipsoid, one), inertia_factor, near)
      call check_close("a sphere", shape_inertia(sphere, d), inertia_factor, 0.0_wp)
      radius2 = (3*0.2_wp/16)**(2.0_wp/3)
      call check_close("a disc: m r**2/2, twice m (3 r**2 + h**2)/12", shape_inertia(disc, [1.0_wp, 0.2_wp, 1.0_wp]), &
                       (0.125_wp + 2*(0.75_wp + 0.04_wp)/12)/3/radius2, near)
      do shape = 1, shapes
         do k = 1, 100
            call random_number(u)
            u = u + 0.01_wp
            call check("no less than a sphere", shape_inertia(shape, u) >= inertia_factor*(1 - near))
            call check_close("of any size", shape_inertia(shape, 7*u), shape_inertia(shape, u), 10*near)
         end do
      end do
   end subroutine test_inertia

   !> A boulder has the radius of the sphere of its volume.
   subroutine test_of_source()
      type(boulder_t) :: boulder

      boulder = boulder_of(source_boulder_t(0.6_wp, 2600.0_wp, 0.5_wp), 1.1_wp)
      call check_close("volume", boulder%volume, 0.66_wp, near)
      call check_close("mass", boulder%mass, 2600*0.66_wp, near)
      call check_close("radius", 4*pi/3*boulder%radius**3, 0.66_wp, near)
   end subroutine test_of_source
end program test_shape
