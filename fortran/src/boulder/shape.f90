! SPDX-License-Identifier: BSD-3-Clause
!> Non-spherical boulders: volume and moment of inertia from shape and side lengths.
module rockfall_shape
   use rockfall_kinds, only: wp
   use rockfall_math, only: pi
   use rockfall_boulder, only: sphere_radius
   implicit none
   private
   public :: shape_volume, shape_inertia, shapes, sphere

   !> Shapes, numbered as in Rockyfor3D, where 0 marks a cell that is not a source.
   integer, parameter :: rectangular = 1, ellipsoid = 2, sphere = 3, disc = 4, shapes = 4

contains

   !> Volume [m3] of a boulder with three side lengths. The diameter of a sphere is their mean; a disc is an elliptic
   !> cylinder.
   pure real(wp) function shape_volume(shape, d) result(volume)
      integer, intent(in) :: shape  !! 1..4
      real(wp), intent(in) :: d(3)  !! sides, or axes [m]

      volume = d(1)*d(2)*d(3)
      select case (shape)
      case (ellipsoid); volume = pi/6*volume
      case (sphere); volume = pi/6*((d(1) + d(2) + d(3))/3)**3
      case (disc); volume = pi/4*volume
      end select
   end function shape_volume

   !> Moment of inertia I/(m R**2) [-], where R is the radius of the sphere of equal volume. The axis of rotation
   !> changes, so I is the mean of the three principal moments. The minimum, 2/5, is that of a sphere.
   pure real(wp) function shape_inertia(shape, d) result(inertia)
      integer, intent(in) :: shape  !! 1..4
      real(wp), intent(in) :: d(3)  !! sides, or axes; the shortest is the height of a disc [m]
      real(wp) :: radius, squares

      radius = sphere_radius(shape_volume(shape, d))
      squares = d(1)*d(1) + d(2)*d(2) + d(3)*d(3)
      select case (shape)
      case (rectangular); inertia = squares/18/radius**2
      case (ellipsoid); inertia = squares/30/radius**2
      case (disc); inertia = (squares/24 + minval(d)**2/72)/radius**2
      case default; inertia = 0.4_wp
      end select
   end function shape_inertia
end module rockfall_shape
