! SPDX-License-Identifier: BSD-3-Clause
!> Layers: sizes as their distribution says, at rest, carried by the floor, dense without friction
!> and loose with it, the same bits for the same seed.
program test_lab_packing
   use rockfall_kinds, only: wp, i8
   use rockfall_error, only: error_t
   use rockfall_random, only: random_key
   use lab_contact, only: material_t
   use lab_packing, only: packing_t, layer_t, pack_layer, check_packing, most_bodies, &
      size_limits, draw_radius, &
      surface_height
   use check_m, only: check, check_close, finish
   implicit none

   call test_sizes()
   call test_layer()
   call test_compaction()
   call test_walls()
   call test_same_bits()
   call test_refusals()
   call finish()

contains

   !> Both distributions have the mean radius by number; one is even in number, the other in mass.
   subroutine test_sizes()
      type(packing_t) :: packing
      real(wp) :: limits(2), u, r, mean, mass, low
      integer, parameter :: n = 100000
      integer :: k, form

      do form = 1, 2
         packing = packing_t(mean_radius=0.3_wp, size_ratio=5.0_wp, by_mass=form == 2)
         limits = size_limits(packing)
         call check_close("ratio of the sizes", limits(2)/limits(1), 5.0_wp, 1.0e-14_wp)
         mean = 0
         mass = 0
         low = 0
         do k = 1, n
            u = (k - 0.5_wp)/n
            r = draw_radius(packing, u)
            mean = mean + r/n
            mass = mass + r**3
            if (r < sum(limits)/2) low = low + merge(r**3, 1.0_wp, form == 2)
         end do
         call check_close("mean radius", mean, 0.3_wp, 1.0e-6_wp)
         call check_close("half below the middle size", low/merge(mass, real(n, wp), form == 2), &
            0.5_wp, 1.0e-4_wp)
         call check_close("smallest", draw_radius(packing, 0.0_wp), limits(1), 1.0e-14_wp)
         call check_close("largest", draw_radius(packing, 1.0_wp), limits(2), 1.0e-14_wp)
      end do
   end subroutine test_sizes

   subroutine test_layer()
      type(layer_t) :: layer
      type(packing_t) :: packing

      packing = packing_t(width=40.0_wp, depth=10.0_wp)
      layer = soil(packing, 1_i8)
      call check_close("the floor carries the weight", layer%floor_share, 1.0_wp, 1.0e-3_wp)
      call check_close("depth of the layer / R_m", layer%surface/packing%mean_radius, 10.0_wp, &
         0.1_wp)
      call check("solid share of a dense layer", layer%solid > 0.82_wp .and. layer%solid < 0.9_wp)
      call check("no more bodies than foretold", size(layer%radius) <= most_bodies(packing))
      call check("sizes within their limits", &
         minval(layer%radius) >= minval(size_limits(packing)) .and. &
         maxval(layer%radius) <= maxval(size_limits(packing)))
      call check("all above the floor", all(layer%x(2, :) > 0.98_wp*layer%radius))
      call check("all within the period", &
         all(layer%x(1, :) >= 0 .and. layer%x(1, :) <= layer%box%width))
      call check("no overlap but what the weight makes", overlap(layer) < 1.0e-2_wp)
      call check("everyone rests on two, or on the floor and one more, or lies", &
         floating(layer) == 0)
      call check("the surface is that of the bodies", &
         abs(surface_height(layer, layer%x(1, highest(layer))) &
         - layer%top) < 1.0e-12_wp*layer%top)
   end subroutine test_layer

   integer function highest(layer)
      type(layer_t), intent(in) :: layer

      highest = maxloc(layer%x(2, :) + layer%radius, 1)
   end function highest

   !> Gap between i and j / the sum of their radii.
   pure real(wp) function gap(layer, i, j)
      type(layer_t), intent(in) :: layer
      integer, intent(in) :: i, j
      real(wp) :: d(2)

      d = layer%x(:, j) - layer%x(:, i)
      if (layer%box%periodic) d(1) = d(1) - layer%box%width*anint(d(1)/layer%box%width)
      gap = sqrt(sum(d**2))/(layer%radius(i) + layer%radius(j)) - 1
   end function gap

   real(wp) function overlap(layer)
      type(layer_t), intent(in) :: layer
      integer :: i, j

      overlap = 0
      do j = 2, size(layer%radius)
         do i = 1, j - 1
            overlap = max(overlap, -gap(layer, i, j))
         end do
      end do
   end function overlap

   !> Bodies with nothing below that touches them.
   integer function floating(layer)
      type(layer_t), intent(in) :: layer
      integer :: i, j
      logical :: held

      floating = 0
      do j = 1, size(layer%radius)
         held = layer%x(2, j) < layer%radius(j)*(1 + 1.0e-5_wp)
         do i = 1, size(layer%radius)
            if (i == j .or. layer%x(2, i) > layer%x(2, j)) cycle
            held = held .or. gap(layer, i, j) < 1.0e-5_wp
         end do
         if (.not. held) floating = floating + 1
      end do
   end function floating

   !> Friction while settling makes the layer loose.
   subroutine test_compaction()
      type(layer_t) :: dense, loose
      real(wp) :: solid(2)
      integer(i8) :: k

      solid = 0
      do k = 1, 3
         dense = soil(packing_t(width=60.0_wp, depth=10.0_wp, friction=0.0_wp), k)
         loose = soil(packing_t(width=60.0_wp, depth=10.0_wp, friction=0.6_wp), k)
         solid = solid + [dense%solid, loose%solid]/3
      end do
      print "(a, 2f7.4)", "solid share, dense and loose:", solid
      call check("dense and loose", solid(1) > solid(2) + 0.03_wp)
   end subroutine test_compaction

   subroutine test_walls()
      type(layer_t) :: layer

      layer = soil(packing_t(width=30.0_wp, depth=8.0_wp, periodic=.false., friction=0.2_wp), 4_i8)
      call check("all between the walls", all(layer%x(1, :) > 0.98_wp*layer%radius .and. &
         layer%x(1, :) < layer%box%width - 0.98_wp*layer%radius))
      call check("no overlap between walls", overlap(layer) < 1.0e-2_wp)
      call check("walls carry a part with friction", layer%floor_share > 0.7_wp &
         .and. layer%floor_share < 1.001_wp)
   end subroutine test_walls

   subroutine test_same_bits()
      type(layer_t) :: a, b, c

      a = soil(packing_t(width=30.0_wp, depth=5.0_wp), 7_i8)
      b = soil(packing_t(width=30.0_wp, depth=5.0_wp), 7_i8)
      c = soil(packing_t(width=30.0_wp, depth=5.0_wp), 8_i8)
      call check("the same layer twice", all(abs(a%x - b%x) <= 0) &
         .and. all(abs(a%radius - b%radius) <= 0))
      call check("another number, another layer", abs(a%radius(1) - c%radius(1)) > 0)
   end subroutine test_same_bits

   subroutine test_refusals()
      call refuse("no size", packing_t(mean_radius=0.0_wp))
      call refuse("a size ratio below 1", packing_t(size_ratio=0.5_wp))
      call refuse("no depth", packing_t(depth=0.0_wp))
      call refuse("negative friction", packing_t(friction=-1.0_wp))
      call refuse("a box too narrow", packing_t(width=7.0_wp))
   end subroutine test_refusals

   subroutine refuse(what, packing)
      character(len=*), intent(in) :: what
      type(packing_t), intent(in) :: packing
      type(error_t), allocatable :: error
      type(layer_t) :: layer

      call check_packing(packing, error)
      call check("refused: "//what, allocated(error))
      call pack_layer(packing, material_t(), random_key(1_i8), 1_i8, layer, error)
      call check("and not packed: "//what, allocated(error))
   end subroutine refuse

   type(layer_t) function soil(packing, number)
      type(packing_t), intent(in) :: packing
      integer(i8), intent(in) :: number
      type(error_t), allocatable :: error

      call pack_layer(packing, material_t(young=1.0e9_wp), random_key(11_i8), number, soil, error)
      call check("packed", .not. allocated(error))
      if (allocated(error)) print "(a)", error%message
   end function soil
end program test_lab_packing
