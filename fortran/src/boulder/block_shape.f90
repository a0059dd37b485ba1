! SPDX-License-Identifier: BSD-3-Clause
!> Shapes of the blocks simulated for impact tables, and choice of a shape for each boulder (theory, chapter 3).
module rockfall_block_shape
   use rockfall_kinds, only: wp, i1
   use rockfall_dimensions, only: n_block_shapes
   implicit none
   private
   public :: block_shapes, block_axes, shape_mix_t, shape_mix, drawn_shape, ground_of_shape, shape_of_axes

   character(len=*), parameter :: block_shapes(n_block_shapes) = [character(len=9) :: "compact", "elongated", "platy"]
   !> Axes a >= b >= c of the laboratory's blocks, divided by a [-].
   real(wp), parameter :: block_axes(3, n_block_shapes) = reshape([1.0_wp, 0.9_wp, 0.8_wp, 1.0_wp, 0.62_wp, 0.56_wp, &
                                                                   1.0_wp, 0.8_wp, 0.42_wp], [3, 3])

   !> Shapes of the boulders of a scene, numbered as block_shapes.
   type :: shape_mix_t
      real(wp) :: below(n_block_shapes) = 1.0_wp   !! cumulative fractions of the shapes; the last is 1 [-]
      integer(i1), allocatable :: of_source(:)     !! shape of each source's boulders, if sources give shapes; 0: drawn
      integer, allocatable :: ground(:, :)  !! (grounds, shapes): index of the ground whose table is for a shape; not
                                            !! allocated if tables apply to all shapes
   end type shape_mix_t

contains

   !> Shape mix with the given fractions >= 0; if all are zero, each boulder's shape is given.
   pure type(shape_mix_t) function shape_mix(shares) result(mix)
      real(wp), intent(in) :: shares(n_block_shapes)  !! [-]
      integer :: k

      if (.not. sum(shares) > 0) return
      mix%below = [(sum(shares(:k)), k=1, n_block_shapes)]
      mix%below = mix%below/mix%below(n_block_shapes)
   end function shape_mix

   !> Shape of a boulder from a uniform number in (0, 1). A shape with fraction 0 has an empty interval.
   pure integer function drawn_shape(mix, u)
      type(shape_mix_t), intent(in) :: mix
      real(wp), intent(in) :: u  !! [-]

      drawn_shape = 1 + count(u >= mix%below)
   end function drawn_shape

   !> Index of the ground whose table is used for a shape on a ground.
   pure integer function ground_of_shape(mix, ground, shape)
      type(shape_mix_t), intent(in) :: mix
      integer, intent(in) :: ground, shape

      ground_of_shape = ground
      if (allocated(mix%ground)) ground_of_shape = mix%ground(ground, shape)
   end function ground_of_shape

   !> Shape whose blocks have the nearest (b/a, c/b).
   pure integer function shape_of_axes(a, b, c)
      real(wp), intent(in) :: a, b, c  !! axes of a boulder, a >= b >= c > 0 [m]

      associate (middle => block_axes(2, :), short => block_axes(3, :))  ! relative to the longest axis, which is 1
         shape_of_axes = minloc((middle - b/a)**2 + (short/middle - c/b)**2, dim=1)
      end associate
   end function shape_of_axes
end module rockfall_block_shape
