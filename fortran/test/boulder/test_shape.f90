! SPDX-License-Identifier: BSD-3-Clause
!> Volumes and moments of inertia of shapes as in textbooks; block shapes drawn by fraction.
program test_shape
   use rockfall_kinds, only: wp
   use rockfall_math, only: pi
   use rockfall_boulder, only: inertia_factor, source_boulder_t, boulder_t, boulder_of
   use rockfall_block_shape, only: shape_mix_t, shape_mix, drawn_shape, shape_of_axes, block_axes
   use rockfall_shape, only: shape_volume, shape_inertia, shapes
   use check_m, only: check, check_close, finish
   implicit none
   integer, parameter :: rectangular = 1, ellipsoid = 2, sphere = 3, disc = 4
   real(wp), parameter :: near = 1.0e-14_wp, d(3) = [0.5_wp, 0.8_wp, 1.5_wp]

   call test_volumes()
   call test_inertia()
   call test_of_source()
   call test_mix()
   call finish()

contains

   subroutine test_volumes()
      call check_close("rectangular", shape_volume(rectangular, d), 0.6_wp, near)
      call check_close("ellipsoid", shape_volume(ellipsoid, d), pi*0.1_wp, near)
      call check_close("sphere of the mean side", shape_volume(sphere, d), pi/6*(2.8_wp/3)**3, near)
      call check_close("disc", shape_volume(disc, d), pi*0.15_wp, near)
   end subroutine test_volumes

   !> Mean of the three principal moments, over m R**2; a sphere has the minimum.
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

   !> The radius of a boulder is that of the sphere of equal volume.
   subroutine test_of_source()
      type(boulder_t) :: boulder

      boulder = boulder_of(source_boulder_t(0.6_wp, 2600.0_wp, 0.5_wp), 1.1_wp)
      call check_close("volume", boulder%volume, 0.66_wp, near)
      call check_close("mass", boulder%mass, 2600*0.66_wp, near)
      call check_close("radius", 4*pi/3*boulder%radius**3, 0.66_wp, near)
   end subroutine test_of_source

   !> Fractions are intervals of (0, 1), in the order of the shapes; a shape with fraction 0 is never drawn.
   subroutine test_mix()
      real(wp), parameter :: smallest = 0.5_wp*2.0_wp**(-32)  !! the smallest uniform number
      type(shape_mix_t) :: mix
      integer :: k

      mix = shape_mix([0.5_wp, 0.3_wp, 0.2_wp])
      call check("first", all(drawn_shapes(mix, [smallest, 0.25_wp, 0.5_wp - 1.0e-9_wp]) == 1))
      call check("second", all(drawn_shapes(mix, [0.5_wp, 0.8_wp - 1.0e-9_wp]) == 2))
      call check("third", all(drawn_shapes(mix, [0.8_wp + 1.0e-9_wp, 1 - smallest]) == 3))
      mix = shape_mix([0.0_wp, 0.333_wp, 0.333_wp])
      call check("none of share 0", all(drawn_shapes(mix, [smallest, 0.49_wp, 0.51_wp, 1 - smallest]) == [2, 2, 3, 3]))
      mix = shape_mix([0.1_wp, 0.2_wp, 0.0_wp])
      call check("nor at the end", drawn_shape(mix, 1 - smallest) == 2)
      do k = 1, size(block_axes, 2)
         call check("blocks have their own shape", shape_of_axes(3*block_axes(1, k), 3*block_axes(2, k), &
                                                                 3*block_axes(3, k)) == k)
      end do
   end subroutine test_mix

   function drawn_shapes(mix, u) result(shapes)
      type(shape_mix_t), intent(in) :: mix
      real(wp), intent(in) :: u(:)
      integer :: shapes(size(u)), k

      shapes = [(drawn_shape(mix, u(k)), k=1, size(u))]
   end function drawn_shapes
end program test_shape
