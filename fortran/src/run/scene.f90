! SPDX-License-Identifier: BSD-3-Clause
!> What both doors do to a scene before it runs: bring release points and lines into local coordinates,
!> and refuse sources where no boulder can be.
module rockfall_scene
   use rockfall_kinds, only: wp, i8
   use rockfall_error, only: error_t, fail
   use rockfall_terrain, only: terrain_t, patch_t, locate, height, on_terrain
   use rockfall_line, only: line_t, line
   use rockfall_impact, only: impact_set, impact_ratios, fitted
   use rockfall_direction, only: lateral, lateral_classes, lateral_quantiles, by_lab
   use rockfall_trajectory, only: scene_t
   use rockfall_random, only: normal_table
   implicit none
   private
   public :: coefficients_t, set_sources, check_sources, add_line, set_impacts

   real(wp), parameter :: any_speed = 1.0e100_wp  !! [m/s] above all, and its square is a number

   !> The numbers of five impact sets, as files have them.
   type :: coefficients_t
      real(wp) :: mean(9, impact_ratios) = 0.0_wp           !! of a1..a9
      real(wp) :: covariance(9, 9, impact_ratios) = 0.0_wp
      !> Lateral deviations [degree]: the incidence angles between classes, 90 where there are fewer, and the
      !> quantiles of each class, those of the last repeated.
      real(wp) :: incidence(lateral_classes - 1, impact_ratios) = 90.0_wp
      real(wp) :: lateral(lateral_quantiles, lateral_classes, impact_ratios) = 0.0_wp
      !> Least and most of the incident speed [m/s] and angle [degree] that each was fitted on.
      real(wp) :: speed_range(2, impact_ratios) = spread([0.0_wp, any_speed], 2, impact_ratios)
      real(wp) :: angle_range(2, impact_ratios) = spread([0.0_wp, 90.0_wp], 2, impact_ratios)
   end type coefficients_t

contains

   !> Release points in map coordinates [m].
   pure subroutine set_sources(scene, x, y)
      type(scene_t), intent(inout) :: scene
      real(wp), intent(in) :: x(:), y(:)

      allocate (scene%release%x(size(x)), scene%release%y(size(x)))
      scene%release%x = x - scene%dem%x0
      scene%release%y = y - scene%dem%y0
   end subroutine set_sources

   !> Sources that start from rows first to last of the raster lie on known terrain, a window of which is at
   !> hand. Raises `head` to the greatest elevation [m] that the energy of a boulder could lift it to.
   pure subroutine check_sources(scene, first, last, head, error)
      type(scene_t), intent(in) :: scene
      integer, intent(in) :: first, last  !! rows from the north
      real(wp), intent(inout) :: head
      type(error_t), allocatable, intent(out) :: error
      type(patch_t) :: patch
      character(len=300) :: text
      real(wp) :: u, w, lift
      integer :: k, row

      lift = scene%release%drop_height + dot_product(scene%release%velocity, scene%release%velocity)/(2*scene%gravity)
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
                  ") lies on nodata of the DEM, or beside it: must be on known terrain"
               call fail(error, trim(text))
               return
            end if
            head = max(head, height(patch, u, w) + lift)
         end do
      end associate
   end subroutine check_sources

   !> Add an evaluation line, in map coordinates [m].
   pure subroutine add_line(scene, x, y)
      type(scene_t), intent(inout) :: scene
      real(wp), intent(in) :: x(:), y(:)
      type(line_t), allocatable :: lines(:)
      integer :: n

      n = 0
      if (allocated(scene%lines)) n = size(scene%lines)
      allocate (lines(n + 1))
      if (n > 0) lines(:n) = scene%lines
      lines(n + 1) = line(x - scene%dem%x0, y - scene%dem%y0)
      call move_alloc(lines, scene%lines)
   end subroutine add_line

   !> The impact sets, factored, the table of normal numbers, and how boulders turn.
   subroutine set_impacts(scene, coefficients, turning, error)
      type(scene_t), intent(inout) :: scene
      type(coefficients_t), intent(in) :: coefficients
      integer, intent(in) :: turning  !! rule of turning_t
      type(error_t), allocatable, intent(out) :: error
      integer :: k

      scene%table = normal_table()
      do k = 1, impact_ratios
         call impact_set(coefficients%mean(:, k), coefficients%covariance(:, :, k), scene%sets(k), error)
         if (allocated(error)) return
         scene%sets(k)%fitted = fitted(coefficients%speed_range(:, k), coefficients%angle_range(:, k))
      end do
      scene%turning = turning
      if (turning == by_lab) then
         scene%lateral = [(lateral(coefficients%incidence(:, k), coefficients%lateral(:, :, k)), k=1, impact_ratios)]
      end if
   end subroutine set_impacts
end module rockfall_scene
