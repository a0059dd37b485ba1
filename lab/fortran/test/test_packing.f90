! SPDX-License-Identifier: BSD-3-Clause
!> Layers: sizes follow their distribution, the rocks are at rest on the floor, more friction during settling gives a
!> looser layer, and equal seeds give identical layers.
program test_lab_packing
   use rockfall_kinds, only: wp, i8
   use rockfall_error, only: error_t
   use rockfall_random, only: random_key
   use lab_contact, only: material_t
   use lab_packing, only: packing_t, layer_t, pack_layer, check_packing, max_spheres, box_width, &
      size_limits, draw_radius
   use check_m, only: check, check_close, finish
   implicit none

   call test_sizes()
   call test_layer()
   call test_compaction()
   call test_same_bits()
   call test_refusals()
   call finish()

contains

   !> Both distributions have the mean radius by number; one is uniform in number, the other in mass.
   subroutine test_sizes()
      type(packing_t) :: packing
      real(wp) :: limits(2), u, r, mean, mass, low
      integer, parameter :: n = 100000
      integer :: k, form

      do form = 1, 2
         packing = packing_t(mean_radius=0.3_wp, grading=5.0_wp, by_mass=form == 2)
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
      real(wp) :: mean

      packing = packing_t(ratio=2.5_wp)
      layer = soil(packing, 1_i8)
      print "(a, i0, a, i0, a)", "a layer of ", size(layer%radius), " bodies, ", layer%steps, " steps"
      call check_close("the floor carries the weight", layer%floor_share, 1.0_wp, 1.0e-2_wp)
      call check_close("depth of the layer / R_b", layer%surface/(2.5_wp*packing%mean_radius), &
         packing%depth, 0.2_wp)
      call check("solid fraction", layer%solid > 0.5_wp .and. layer%solid < 0.74_wp)
      call check("no more bodies than predicted", size(layer%radius) <= max_spheres(packing))
      call check("sizes within their limits", &
         minval(layer%radius) >= minval(size_limits(packing)) .and. &
         maxval(layer%radius) <= maxval(size_limits(packing)))
      call check("all above the floor", all(layer%x(3, :) > 0.98_wp*layer%radius))
      call check_close("width of the box", layer%box%width, box_width(packing), 0.0_wp)
      call check("all within the period", &
         all(layer%x(1:2, :) >= 0 .and. layer%x(1:2, :) <= layer%box%width))
      call check("no overlap but what the weight makes", overlap(layer) < 1.0e-2_wp)
      call check("all rest on something, but for the odd one that still rolls in its cage", floating(layer) <= 1)
      call check_close("the top is that of the highest", maxval(layer%x(3, :) + layer%radius), layer%top, &
         0.0_wp)
      mean = mean_height(layer)
      call check_close("the surface is that of the bodies", layer%surface, mean, 5.0e-3_wp)
   end subroutine test_layer

   !> Mean height of the surface over 20,000 quasi-random points.
   pure real(wp) function mean_height(layer) result(mean)
      type(layer_t), intent(in) :: layer
      integer, parameter :: n = 20000
      real(wp) :: place(2), d(2), height, rest
      integer :: k, l

      mean = 0
      do k = 1, n
         place = layer%box%width*modulo(k*[0.7548776662466927_wp, 0.5698402909980532_wp], 1.0_wp)
         height = 0
         do l = 1, size(layer%radius)
            d = modulo(layer%x(1:2, l) - place + layer%box%width/2, layer%box%width) - layer%box%width/2
            rest = layer%radius(l)**2 - sum(d**2)
            if (rest > 0) height = max(height, layer%x(3, l) + sqrt(rest))
         end do
         mean = mean + height/n
      end do
   end function mean_height

   !> Gap between i and j, over the sum of their radii.
   pure real(wp) function gap(layer, i, j)
      type(layer_t), intent(in) :: layer
      integer, intent(in) :: i, j
      real(wp) :: d(3)

      d = layer%x(:, j) - layer%x(:, i)
      d(1:2) = d(1:2) - layer%box%width*anint(d(1:2)/layer%box%width)
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

   !> Number of bodies that touch neither the floor nor a body below them.
   integer function floating(layer)
      type(layer_t), intent(in) :: layer
      integer :: i, j
      logical :: held

      floating = 0
      do j = 1, size(layer%radius)
         held = layer%x(3, j) < layer%radius(j)*(1 + 1.0e-5_wp)
         do i = 1, size(layer%radius)
            if (i == j .or. layer%x(3, i) > layer%x(3, j)) cycle
            held = held .or. gap(layer, i, j) < 1.0e-5_wp
         end do
         if (.not. held) floating = floating + 1
      end do
   end function floating

   !> More friction during settling gives a looser layer.
   subroutine test_compaction()
      type(layer_t) :: layer
      real(wp), parameter :: friction(3) = [0.0_wp, 0.3_wp, 1.0_wp]
      real(wp) :: solid(3)
      integer :: k

      do k = 1, 3
         layer = soil(packing_t(ratio=2.0_wp, friction=friction(k)), 1_i8)
         solid(k) = layer%solid
      end do
      print "(a, 3f7.4)", "solid fraction, from no friction to much:", solid
      call check("dense and loose", solid(1) > solid(2) + 0.01_wp .and. solid(2) > solid(3) + 0.01_wp)
   end subroutine test_compaction

   subroutine test_same_bits()
      type(layer_t) :: a, b, c

      a = soil(packing_t(ratio=1.0_wp), 7_i8)
      b = soil(packing_t(ratio=1.0_wp), 7_i8)
      c = soil(packing_t(ratio=1.0_wp), 8_i8)
      call check("the same layer twice", all(abs(a%x - b%x) <= 0) &
         .and. all(abs(a%radius - b%radius) <= 0))
      call check("another number, another layer", abs(a%radius(1) - c%radius(1)) > 0)
   end subroutine test_same_bits

   subroutine test_refusals()
      call refuse("no size", packing_t(mean_radius=0.0_wp))
      call refuse("a size ratio below 1", packing_t(grading=0.5_wp))
      call refuse("no depth", packing_t(depth=0.0_wp))
      call refuse("negative friction", packing_t(friction=-1.0_wp))
      call refuse("more bodies than fit", packing_t(grading=100.0_wp))
      call refuse("waves of no speed", packing_t(base_speed=-1.0_wp))
      call refuse("rocks too large for the box", packing_t(ratio=1.0_wp, grading=1000.0_wp, by_mass=.true.))
      call refuse("a box too narrow", packing_t(width=2.0_wp))
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
