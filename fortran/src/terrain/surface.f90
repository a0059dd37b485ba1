! SPDX-License-Identifier: BSD-3-Clause
!> Surface properties at a contact: the radius R_m of the rocks, by method B (one mean radius) or method A (three
!> obstacle sizes with probabilities 0.7, 0.2, 0.1); Bourrier et al. 2009, section 3.4 and table 1. An infinite
!> radius absorbs the boulder.
module rockfall_surface
   use rockfall_kinds, only: wp, sp, i1, i2
   implicit none
   private
   public :: surface_t, rock_radius, ground_at, size_weights, method_a, method_b

   integer, parameter :: method_a = 1, method_b = 2

   !> Thresholds in (0, 1) of the second and third obstacle size of method A (section 3.4: 70, 20 and 10 %).
   real(wp), parameter :: second_from = 0.7_wp, third_from = 0.9_wp
   real(wp), parameter :: size_weights(3) = [second_from, third_from - second_from, 1 - third_from]

   !> Surface given as a constant (no array), as zones with a table, or as rasters of values. Arrays start at the
   !> same cell as the arrays of the terrain.
   type :: surface_t
      integer :: method = method_b
      real(wp) :: size_to_radius = 0.5_wp  !! method A: 1/2 treats Rg as a diameter, 1 as a radius [-]
      !> Sizes of material m [m]: mean radius (1, m), or Rg70, Rg20, Rg10 (1:3, m).
      real(wp), allocatable :: sizes(:, :)
      integer(i1), pointer, contiguous :: zone1(:, :) => null()   !! (nx, ny) column of `sizes`, or
      integer(i2), pointer, contiguous :: zone2(:, :) => null()   !! the same for more than 127 materials
      real(sp), pointer, contiguous :: values(:, :, :) => null()  !! (nx, ny, 1 or 3) sizes of each cell [m]
      !> Index of the ground type per material or cell, if there are several.
      integer(i1), allocatable :: material_ground(:)
      integer(i1), pointer, contiguous :: cell_ground(:, :) => null()
   end type surface_t

contains

   !> Rock radius R_m [m] at a raster cell for one rebound; `u` selects an obstacle size of method A (theory, chapter
   !> 7).
   pure real(wp) function rock_radius(surface, at, u)
      type(surface_t), intent(in) :: surface
      integer, intent(in) :: at(2)  !! column, row from the north
      real(wp), intent(in) :: u     !! uniform in (0, 1) [-]
      integer :: k

      k = 1
      if (surface%method == method_a) then
         if (u >= third_from) then
            k = 3
         else if (u >= second_from) then
            k = 2
         end if
      end if
      if (associated(surface%zone1)) then
         rock_radius = surface%sizes(k, surface%zone1(at(1), at(2)))
      else if (associated(surface%zone2)) then
         rock_radius = surface%sizes(k, surface%zone2(at(1), at(2)))
      else if (associated(surface%values)) then
         rock_radius = surface%values(at(1), at(2), k)
      else
         rock_radius = surface%sizes(k, 1)
      end if
      if (surface%method == method_a) rock_radius = rock_radius*surface%size_to_radius
   end function rock_radius

   !> Index of the ground type at a raster cell; 1 if there is only one.
   pure integer function ground_at(surface, at)
      type(surface_t), intent(in) :: surface
      integer, intent(in) :: at(2)  !! column, row from the north

      ground_at = 1
      if (associated(surface%cell_ground)) then
         ground_at = surface%cell_ground(at(1), at(2))
      else if (.not. allocated(surface%material_ground)) then
         return
      else if (associated(surface%zone1)) then
         ground_at = surface%material_ground(surface%zone1(at(1), at(2)))
      else if (associated(surface%zone2)) then
         ground_at = surface%material_ground(surface%zone2(at(1), at(2)))
      end if
   end function ground_at
end module rockfall_surface
