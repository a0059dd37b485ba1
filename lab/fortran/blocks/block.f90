! SPDX-License-Identifier: BSD-3-Clause
!> Rigid convex block: its surface as triangles, with the exact volume, centre of mass and inertia. Stored relative to
!> its centre of mass along its principal axes.
module lab_block
   use rockfall_kinds, only: wp
   use rockfall_error, only: error_t, fail
   use rockfall_math, only: pi, cube_root
   use lab_contact, only: cross
   implicit none
   private
   public :: block_t, make_block, solid_t, solid_of

   type :: block_t
      real(wp), allocatable :: x(:, :)        !! (vertices, 3) relative to the centre of mass, in principal axes [m]
      integer, allocatable :: corner(:, :)    !! (3, facets) vertex indices, counterclockwise from outside
      real(wp), allocatable :: normal(:, :)   !! (3, facets) outward unit normals [-]
      real(wp), allocatable :: area(:)        !! (facets) areas [m2]
      real(wp) :: radius = 0                  !! R_b, radius of the sphere of equal volume [m]
      real(wp) :: reach = 0                   !! distance of the farthest vertex from the centre [m]
      real(wp) :: edge = 0                    !! longest edge of a facet [m]
      real(wp) :: mass = 0                    !! [kg]
      real(wp) :: inertia(3) = 0              !! principal moments, ascending [kg m2]
   end type block_t

   !> Moments of a solid with unit density.
   type :: solid_t
      real(wp) :: volume = 0          !! [m3]
      real(wp) :: centre(3) = 0       !! [m]
      real(wp) :: inertia(3, 3) = 0   !! moments of inertia about the centre [m5]
   end type solid_t

   real(wp), parameter :: convex_within = 1.0e-6_wp  !! maximum height of a vertex above a facet, over R_b [-]

   interface
      subroutine dsyev(jobz, uplo, n, a, lda, w, work, lwork, info)
         import :: wp
         character, intent(in) :: jobz, uplo
         integer, intent(in) :: n, lda, lwork
         real(wp), intent(inout) :: a(lda, *)
         real(wp), intent(out) :: w(*), work(*)
         integer, intent(out) :: info
      end subroutine dsyev
   end interface

contains

   !> Make a block of a given shape, scaled to an equivalent radius; rejects surfaces that are not closed,
   !> counterclockwise and convex.
   subroutine make_block(x, corner, radius, density, block, error)
      real(wp), intent(in) :: x(:, :)         !! (3, vertices) coordinates, in any unit of length
      integer, intent(in) :: corner(:, :)     !! (3, facets) vertex indices
      real(wp), intent(in) :: radius, density !! R_b [m], [kg/m3]
      type(block_t), intent(out) :: block
      type(error_t), allocatable, intent(out) :: error
      type(solid_t) :: solid
      real(wp) :: scale, axes(3, 3), side(3)
      integer :: k

      if (size(x, 2) < 4 .or. size(corner, 2) < 4) then
         call fail(error, "block: at least 4 vertices and 4 facets are needed")
         return
      else if (any(corner < 1 .or. corner > size(x, 2))) then
         call fail(error, "block: a facet names a vertex that does not exist")
         return
      end if
      solid = solid_of(x, corner)
      if (.not. solid%volume > 0) then
         call fail(error, "block: the volume is not positive: facets must be counterclockwise from outside")
         return
      end if
      scale = radius/cube_root(3*solid%volume/(4*pi))
      call principal_axes(solid%inertia, block%inertia, axes)
      block%radius = radius
      block%mass = density*solid%volume*scale**3
      block%inertia = density*scale**5*block%inertia
      block%corner = corner
      allocate (block%x(size(x, 2), 3), block%normal(3, size(corner, 2)), block%area(size(corner, 2)))
      do k = 1, size(x, 2)
         block%x(k, :) = matmul(scale*(x(:, k) - solid%centre), axes)
      end do
      block%reach = sqrt(maxval(sum(block%x**2, 2)))
      side = 0
      do k = 1, size(corner, 2)
         associate (a => block%x(corner(1, k), :), b => block%x(corner(2, k), :), c => block%x(corner(3, k), :))
            block%normal(:, k) = 0.5_wp*cross(b - a, c - a)
            side = side + block%normal(:, k)
            block%edge = max(block%edge, sqrt(max(sum((b - a)**2), sum((c - b)**2), sum((a - c)**2))))
            block%area(k) = sqrt(sum(block%normal(:, k)**2))
            if (.not. block%area(k) > 0) then
               call fail(error, "block: a facet has no area")
               return
            end if
            block%normal(:, k) = block%normal(:, k)/block%area(k)
            if (any(matmul(block%x, block%normal(:, k)) - dot_product(a, block%normal(:, k)) &
                    > convex_within*radius)) then
               call fail(error, "block: the surface is not convex")
               return
            end if
         end associate
      end do
      if (any(abs(side) > convex_within*radius**2)) call fail(error, "block: the surface is not closed")
   end subroutine make_block

   !> Exact moments from the facets, as tetrahedra between each facet and the origin.
   pure type(solid_t) function solid_of(x, corner) result(solid)
      real(wp), intent(in) :: x(:, :)      !! (3, vertices) [m]
      integer, intent(in) :: corner(:, :)  !! (3, facets)
      real(wp) :: a(3), b(3), c(3), s(3), six_volumes, second(3, 3)
      integer :: k, i, j

      second = 0
      do k = 1, size(corner, 2)
         a = x(:, corner(1, k))
         b = x(:, corner(2, k))
         c = x(:, corner(3, k))
         s = a + b + c
         six_volumes = dot_product(a, cross(b, c))
         solid%volume = solid%volume + six_volumes/6
         solid%centre = solid%centre + six_volumes/24*s
         do j = 1, 3
            do i = 1, 3
               second(i, j) = second(i, j) + six_volumes/120*(s(i)*s(j) + a(i)*a(j) + b(i)*b(j) + c(i)*c(j))
            end do
         end do
      end do
      if (.not. solid%volume > 0) return
      solid%centre = solid%centre/solid%volume
      do j = 1, 3
         do i = 1, 3
            second(i, j) = second(i, j) - solid%volume*solid%centre(i)*solid%centre(j)
         end do
      end do
      solid%inertia = -second
      do i = 1, 3
         solid%inertia(i, i) = solid%inertia(i, i) + second(1, 1) + second(2, 2) + second(3, 3)
      end do
   end function solid_of

   !> Principal moments and right-handed principal axes, whose signs do not depend on the LAPACK library.
   subroutine principal_axes(inertia, moments, axes)
      real(wp), intent(in) :: inertia(3, 3)              !! any [unit]
      real(wp), intent(out) :: moments(3), axes(3, 3)    !! ascending moments; axes as columns [-]
      real(wp) :: work(32)
      integer :: info, k

      axes = inertia
      call dsyev("V", "U", 3, axes, 3, moments, work, size(work), info)
      do k = 1, 2
         axes(:, k) = sign(1.0_wp, axes(maxloc(abs(axes(:, k)), 1), k))*axes(:, k)
      end do
      axes(:, 3) = cross(axes(:, 1), axes(:, 2))
   end subroutine principal_axes
end module lab_block
