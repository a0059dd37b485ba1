! SPDX-License-Identifier: BSD-3-Clause
!> Upper bounds for the boulders of a scene: number, volume, tree hits, and energy head at the start.
module rockfall_bounds
   use rockfall_kinds, only: wp, i8
   use rockfall_error, only: error_t, fail
   use rockfall_terrain, only: patch_t, locate, height, on_terrain
   use rockfall_boulder, only: volume_distribution_t, fixed_volume, last_of, max_volume, sphere_radius
   use rockfall_scene_type, only: scene_t
   implicit none
   private
   public :: boulder_count, max_volumes, max_radius, max_tree_hits, check_sources

contains

   !> Number of boulders in the complete run.
   pure integer(i8) function boulder_count(scene)
      type(scene_t), intent(in) :: scene

      boulder_count = 0
      if (size(scene%release%x) > 0) boulder_count = last_of(scene%release, size(scene%release%x, kind=i8))
   end function boulder_count

   !> Volume distribution of a scene; if sources give volumes, the distribution for the largest and heaviest boulders.
   pure type(volume_distribution_t) function max_volumes(scene) result(volumes)
      type(scene_t), intent(in) :: scene
      integer :: k

      volumes = scene%volumes
      if (allocated(scene%features)) then
         volumes%kind = fixed_volume
         volumes%mean = maxval([(max_volume(scene%features(k)%volumes, scene%table), k=1, size(scene%features))])
         volumes%density = maxval([(scene%features(k)%volumes%density, k=1, size(scene%features))])
      end if
      if (.not. allocated(scene%of_source)) return
      volumes%mean = max_volume(volumes, scene%table)*maxval(scene%of_source%volume)
      volumes%kind = fixed_volume
      volumes%density = maxval(scene%of_source%density)
   end function max_volumes

   !> Radius of the largest boulder of a scene [m], with a margin for rounding.
   pure real(wp) function max_radius(scene)
      type(scene_t), intent(in) :: scene
      real(wp), parameter :: margin = 1.001_wp

      max_radius = margin*sphere_radius(max_volume(max_volumes(scene), scene%table))
   end function max_radius

   !> Maximum number of tree hits by a boulder and its fragments.
   pure integer function max_tree_hits(scene)
      type(scene_t), intent(in) :: scene
      integer :: fragments

      fragments = 1
      if (allocated(scene%breakage)) fragments = 2*scene%breakage%max_fragments  ! fragments, and blocks that broke
      max_tree_hits = int(min(int(huge(1), i8), int(fragments, i8)*scene%max_impacts))
   end function max_tree_hits

   !> Height [m] above the ground at which the potential energy of a boulder equals its initial energy.
   pure real(wp) function lift_of(scene, source)
      type(scene_t), intent(in) :: scene
      integer, intent(in) :: source  !! 1..
      real(wp) :: v(3)

      lift_of = scene%release%drop_height
      v = scene%release%velocity
      if (allocated(scene%features)) then
         lift_of = scene%features(scene%release%feature(source))%drop_height
         v = scene%features(scene%release%feature(source))%velocity
      end if
      lift_of = lift_of + dot_product(v, v)/(2*scene%gravity)
   end function lift_of

   !> Check that the sources in raster rows first to last lie on known terrain, given a window that contains these rows.
   !> Raises `head` to the maximum energy head of their boulders.
   pure subroutine check_sources(scene, first, last, head, error)
      type(scene_t), intent(in) :: scene
      integer, intent(in) :: first, last  !! rows, counted from the north
      real(wp), intent(inout) :: head     !! maximum energy head so far [m]
      type(error_t), allocatable, intent(out) :: error
      type(patch_t) :: patch
      character(len=300) :: text
      real(wp) :: u, w
      integer :: k, row

      associate (dem => scene%dem, x => scene%release%x, y => scene%release%y)
         do k = 1, size(x)
            row = dem%ny - int(max(0.0_wp, min(dem%ny - 1.0_wp, y(k)*dem%per_cell)))
            if (row < first .or. row > last) cycle
            if (.not. on_terrain(dem, x(k), y(k))) then
               write (text, "(a,i0,6(a,f0.3),a)") "&release: source ", k, " (", x(k) + dem%x0, ", ", y(k) + dem%y0, &
                  ") lies outside the terrain between its outer cell centres: must be x ", dem%x0, " to ", &
                  dem%x0 + (dem%nx - 1)*dem%cell, ", y ", dem%y0, " to ", dem%y0 + (dem%ny - 1)*dem%cell, ""
               call fail(error, trim(text))
               return
            end if
            call locate(dem, x(k), y(k), patch, u, w)
            if (.not. patch%known) then
               write (text, "(a,i0,2(a,f0.3),a)") "&release: source ", k, " (", x(k) + dem%x0, ", ", y(k) + dem%y0, &
                  ") lies on or next to a nodata cell: must be on terrain with an elevation"
               call fail(error, trim(text))
               return
            end if
            head = max(head, height(patch, u, w) + lift_of(scene, k))
         end do
      end associate
   end subroutine check_sources
end module rockfall_bounds
