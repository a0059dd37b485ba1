! SPDX-License-Identifier: BSD-3-Clause
!> Door 2: from a case to a scene with the rasters, sources and impact sets that the case names.
module rockfall_load
   use, intrinsic :: ieee_arithmetic, only: ieee_is_nan
   use rockfall_kinds, only: wp, sp, i1, i2, i4
   use rockfall_error, only: error_t, fail
   use rockfall_text, only: integer_text
   use rockfall_text_file, only: read_text
   use rockfall_decimal, only: real_text
   use rockfall_terrain, only: terrain
   use rockfall_surface, only: method_a
   use rockfall_trajectory, only: scene_t
   use rockfall_sources, only: usual_threshold, keep_steep, surface_ratios
   use rockfall_scene, only: scene_arrays_t, scene_from, check_sources
   use rockfall_case, only: case_t
   use rockfall_paths, only: installed_sets, source_sets
   use rockfall_grid, only: grid_t, is_outside
   use rockfall_csv, only: read_zone_table
   use rockfall_console, only: decimal
   use rockfall_filesystem, only: folder_of, same_file
   use rockfall_checksum, only: file_checksum
   use rockfall_raster, only: read_raster, in_single_precision, check_same_grid, crs_of, &
                              check_metres, raster_file, crs_file, prepare_hint
   use rockfall_material, only: index_zones, without_row, check_sizes
   implicit none
   private
   public :: inputs_t, input_file_t, load, refuse_input, lines_outside

   real(wp), parameter :: highest = 1.0e7_wp  !! [m] higher is a mark that the file does not tell of

   !> A file that a case named.
   type :: input_file_t
      character(len=11) :: key = ""
      character(len=64) :: checksum = ""  !! SHA-256
   end type input_file_t

   !> A scene and the arrays that it looks at. What holds it must be a target.
   type :: inputs_t
      type(scene_t) :: scene
      type(grid_t) :: grid
      real(wp) :: head = -huge(1.0_wp)            !! greatest energy head of all sources [m]
      real(wp) :: lowest = huge(1.0_wp)           !! elevation [m]
      type(scene_arrays_t) :: arrays
      real(wp), allocatable :: z8(:, :)           !! elevations [m], or
      real(sp), allocatable :: z4(:, :)           !! in single precision; NaN = none
      integer(i1), allocatable :: zone1(:, :)     !! row of the table, or
      integer(i2), allocatable :: zone2(:, :)     !! of more than 127
      real(sp), allocatable :: values(:, :, :)    !! sizes of each cell [m]
      character(len=:), allocatable :: crs        !! coordinate reference system as WKT, or ""
      type(input_file_t), allocatable :: files(:)
   end type inputs_t

contains

   !> Read and check all that a case names. The surface comes before the elevations, so that what
   !> its reading needs is free again when they come.
   subroutine load(case, inputs, error)
      type(case_t), intent(in) :: case
      type(inputs_t), intent(out), target :: inputs
      type(error_t), allocatable, intent(out) :: error
      type(grid_t) :: surface_grid
      integer(i4), allocatable :: table_ids(:)

      allocate (inputs%files(0))
      call refuse_polygons(case, error)
      if (.not. allocated(error)) call check_files(case, error)
      if (.not. allocated(error)) call read_surface(case, inputs, surface_grid, table_ids, error)
      if (.not. allocated(error)) call read_dem(case, inputs, error)
      if (.not. allocated(error)) call check_surface(case, inputs, surface_grid, table_ids, error)
      if (.not. allocated(error)) call read_sources(case, inputs, error)
      if (.not. allocated(error)) call read_impacts(case, inputs, error)
      if (allocated(error)) return
      call gather_arrays(case, inputs)
      call scene_from(case, inputs%arrays, inputs%scene, error)
      if (allocated(error)) return
      call check_sources(inputs%scene, 1, inputs%grid%ny, inputs%head, error)
      if (allocated(error)) error%message = case%file//": "//error%message
   end subroutine load

   !> The path of a file that the case names.
   pure function path_of(case, file) result(path)
      type(case_t), intent(in) :: case
      character(len=*), intent(in) :: file
      character(len=:), allocatable :: path

      path = trim(file)
      if (file(1:1) /= "/") path = folder_of(case%file)//path
   end function path_of

   !> Refuse to write to a path where the case reads, by whatever name.
   subroutine refuse_input(case, path, error)
      type(case_t), intent(in) :: case
      character(len=*), intent(in) :: path
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: sets, dem
      type(error_t), allocatable :: no_sets
      logical :: is_input
      integer :: k

      dem = path_of(case, case%dem)
      is_input = same_file(path, case%file) .or. same_file(path, crs_file(dem)) .or. is_of(case%dem) &
                 .or. is_of(case%zones) .or. is_of(case%table) .or. is_of(case%mean_radius) .or. is_of(case%cells)
      do k = 1, size(case%rg)
         is_input = is_input .or. is_of(trim(case%rg(k)))
      end do
      call find_sets(case, sets, no_sets)
      if (.not. allocated(no_sets)) is_input = is_input .or. same_file(path, sets)
      if (is_input) call fail(error, path//": is an input; it is not overwritten")

   contains

      logical function is_of(file)
         character(len=*), intent(in) :: file  !! "" when the case does not name it

         is_of = .false.
         if (file /= "") is_of = same_file(path, raster_file(path_of(case, file)))
      end function is_of
   end subroutine refuse_input

   !> Note which file a key named; by the keys in order.
   subroutine note_file(inputs, key, path, error)
      type(inputs_t), intent(inout) :: inputs
      character(len=*), intent(in) :: key, path
      type(error_t), allocatable, intent(out) :: error
      type(input_file_t) :: file
      integer :: k

      file%key = key
      call file_checksum(raster_file(path), file%checksum, error)
      k = count(inputs%files%key < key)
      inputs%files = [inputs%files(:k), file, inputs%files(k + 1:)]
   end subroutine note_file

   !> Every file that the case names and that is to be read is there.
   subroutine check_files(case, error)
      type(case_t), intent(in) :: case
      type(error_t), allocatable, intent(out) :: error
      integer :: k

      call check_file(case, "&terrain dem", case%dem, error)
      if (.not. allocated(error)) call check_file(case, "&surface zones", case%zones, error)
      if (.not. allocated(error)) call check_file(case, "&surface table", case%table, error)
      do k = 1, merge(3, 1, case%method == method_a)
         if (allocated(error)) return
         call check_file(case, "&surface "//values_key(case, k), values_file(case, k), error)
      end do
      if (.not. allocated(error)) call check_file(case, "&release cells", case%cells, error)
   end subroutine check_files

   subroutine check_file(case, key, file, error)
      type(case_t), intent(in) :: case
      character(len=*), intent(in) :: key, file  !! "" when the case does not name it
      type(error_t), allocatable, intent(out) :: error
      logical :: exists

      if (file == "") return
      inquire (file=raster_file(path_of(case, file)), exist=exists)
      if (.not. exists) call fail(error, case%file//": "//key//" = '"//file//"': no such file")
   end subroutine check_file

   subroutine refuse_polygons(case, error)
      type(case_t), intent(in) :: case
      type(error_t), allocatable, intent(out) :: error
      character(len=*), parameter :: endings(5) = [character(len=8) :: ".gpkg", ".geojson", &
         ".json", ".shp", ".fgb"]
      integer :: dot

      if (case%polygons /= "") then
         call fail(error, case%file//": &release polygons = '"//case%polygons &
                   //"': this program reads no polygons; "//prepare_hint)
         return
      end if
      dot = max(1, index(case%zones, ".", back=.true.))
      if (any(endings == case%zones(dot:))) then
         call fail(error, case%file//": &surface zones = '"//case%zones &
                   //"': this program reads no polygons; "//prepare_hint)
      end if
   end subroutine refuse_polygons

   ! ---- elevations ---------------------------------------------------------------------------

   subroutine read_dem(case, inputs, error)
      type(case_t), intent(in) :: case
      type(inputs_t), intent(inout), target :: inputs
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: path
      logical :: single

      path = path_of(case, case%dem)
      inputs%crs = crs_of(path)
      call check_metres(path, inputs%crs, error)
      if (.not. allocated(error)) call in_single_precision(path, single, error)
      if (allocated(error)) return
      if (single) then
         call read_raster(path, inputs%z4, inputs%grid, error)
      else
         call read_raster(path, inputs%z8, inputs%grid, error)
      end if
      if (.not. allocated(error)) call note_file(inputs, "dem", path, error)
      if (.not. allocated(error)) call check_elevations(path, inputs, error)
      if (allocated(error)) return
      associate (grid => inputs%grid)
         if (single) then
            inputs%scene%dem = terrain(grid%west, grid%north, grid%cell, z4=inputs%z4)
         else
            inputs%scene%dem = terrain(grid%west, grid%north, grid%cell, z8=inputs%z8)
         end if
      end associate
   end subroutine read_dem

   !> Refuse rasters too small for a patch, elevations that are none, and rasters without any.
   subroutine check_elevations(path, inputs, error)
      character(len=*), intent(in) :: path
      type(inputs_t), intent(inout) :: inputs
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: z(inputs%grid%nx)
      logical :: here(inputs%grid%nx), some
      integer :: i, j

      associate (grid => inputs%grid)
         if (min(grid%nx, grid%ny) < 2) then
            call fail(error, path//": "//integer_text(grid%nx)//" x "//integer_text(grid%ny) &
                      //" cells, at least 2 x 2 are needed")
            return
         end if
         some = .false.
         do j = 1, grid%ny
            here = known(inputs, j)
            some = some .or. any(here)
            z = 0
            if (allocated(inputs%z4)) then
               where (here) z = inputs%z4(:, j)
            else
               where (here) z = inputs%z8(:, j)
            end if
            inputs%lowest = min(inputs%lowest, minval(z, mask=here))
            i = findloc(abs(z) > highest, .true., dim=1)
            if (i == 0) cycle
            call fail(error, path//": row "//integer_text(j)//", column "//integer_text(i)//": elevation " &
                      //real_text(z(i))//": must be within 1e7 m of zero or nodata")
            return
         end do
      end associate
      if (.not. some) call fail(error, path//": all cells are nodata")
   end subroutine check_elevations

   !> Where a row of the raster has elevations.
   pure function known(inputs, j)
      type(inputs_t), intent(in) :: inputs
      integer, intent(in) :: j
      logical :: known(inputs%grid%nx)

      if (allocated(inputs%z4)) then
         known = .not. ieee_is_nan(inputs%z4(:, j))
      else
         known = .not. ieee_is_nan(inputs%z8(:, j))
      end if
   end function known

   ! ---- the surface --------------------------------------------------------------------------

   !> One of: the same everywhere, zones with a table, rasters of values.
   subroutine read_surface(case, inputs, grid, table_ids, error)
      type(case_t), intent(in) :: case
      type(inputs_t), intent(inout), target :: inputs
      type(grid_t), intent(out) :: grid
      integer(i4), allocatable, intent(out) :: table_ids(:)
      type(error_t), allocatable, intent(out) :: error

      associate (surface => inputs%scene%surface)
         surface%method = case%method
         surface%size_to_radius = case%size_to_radius
         if (allocated(case%uniform_sizes)) then
            surface%sizes = reshape(case%uniform_sizes, [size(case%uniform_sizes), 1])
         else if (case%zones /= "") then
            call read_zones(case, inputs, grid, table_ids, error)
         else
            call read_values(case, inputs, grid, error)
            if (.not. allocated(error)) surface%values => inputs%values
         end if
      end associate
   end subroutine read_surface

   subroutine read_zones(case, inputs, grid, table_ids, error)
      type(case_t), intent(in) :: case
      type(inputs_t), intent(inout) :: inputs
      type(grid_t), intent(out) :: grid
      integer(i4), allocatable, intent(out) :: table_ids(:)
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: path, table
      real(wp), allocatable :: radii(:, :)
      integer(i4), allocatable :: ids(:, :)
      integer :: status

      path = path_of(case, case%zones)
      table = path_of(case, case%table)
      call read_zone_table(table, table_ids, radii, error)
      if (.not. allocated(error)) call note_file(inputs, "table", table, error)
      if (.not. allocated(error) .and. allocated(case%default_zone)) then
         if (.not. any(table_ids == case%default_zone)) then
            call fail(error, "&surface default_zone = "//integer_text(case%default_zone) &
                      //": has no row in "//table)
         end if
      end if
      if (.not. allocated(error)) call read_raster(path, ids, grid, error)
      if (.not. allocated(error)) call note_file(inputs, "zones", path, error)
      if (allocated(error)) return
      inputs%scene%surface%sizes = merge_columns(case, radii)
      allocate (inputs%zone2(grid%nx, grid%ny), stat=status)
      if (status /= 0) then
         call fail(error, path//": no memory for the zones of its cells")
         return
      end if
      call index_zones(ids, table_ids, case%default_zone, inputs%zone2)
   end subroutine read_zones

   !> The columns of the table (mean_radius, rg70, rg20, rg10) that the method needs.
   pure function merge_columns(case, radii) result(sizes)
      type(case_t), intent(in) :: case
      real(wp), intent(in) :: radii(:, :)  !! (4, rows) [m]
      real(wp), allocatable :: sizes(:, :)

      if (case%method == method_a) then
         sizes = radii(2:4, :)
      else
         sizes = radii(1:1, :)
      end if
   end function merge_columns

   !> Rasters of the sizes themselves.
   subroutine read_values(case, inputs, grid, error)
      type(case_t), intent(in) :: case
      type(inputs_t), intent(inout) :: inputs
      type(grid_t), intent(out) :: grid
      type(error_t), allocatable, intent(out) :: error
      real(sp), allocatable :: layer(:, :)
      type(grid_t) :: own
      character(len=:), allocatable :: path
      integer :: k, n, status

      n = merge(3, 1, case%method == method_a)
      do k = 1, n
         path = path_of(case, values_file(case, k))
         call read_raster(path, layer, own, error, infinite=.true.)
         if (.not. allocated(error)) call note_file(inputs, values_key(case, k), path, error)
         if (allocated(error)) return
         if (k == 1) then
            grid = own
            allocate (inputs%values(grid%nx, grid%ny, n), stat=status)
            if (status /= 0) call fail(error, path//": no memory for rasters of its size")
         else
            call check_same_grid(path, own, "values of "//values_key(case, k), "bilinear", &
                                 path_of(case, values_file(case, 1)), grid, error)
         end if
         if (allocated(error)) return
         inputs%values(:, :, k) = layer
      end do
   end subroutine read_values

   !> The name of a raster of values, and the key that names it.
   pure function values_file(case, k) result(file)
      type(case_t), intent(in) :: case
      integer, intent(in) :: k
      character(len=:), allocatable :: file

      file = case%mean_radius
      if (case%method == method_a) file = trim(case%rg(k))
   end function values_file

   pure function values_key(case, k) result(key)
      type(case_t), intent(in) :: case
      integer, intent(in) :: k
      character(len=:), allocatable :: key
      character(len=*), parameter :: keys(3) = ["rg70", "rg20", "rg10"]

      key = "mean_radius"
      if (case%method == method_a) key = keys(k)
   end function values_key

   !> The surface lies on the cells of the DEM, and is known wherever there is terrain.
   subroutine check_surface(case, inputs, grid, table_ids, error)
      type(case_t), intent(in) :: case
      type(inputs_t), intent(inout), target :: inputs
      type(grid_t), intent(in) :: grid
      integer(i4), allocatable, intent(in) :: table_ids(:)
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: dem
      integer :: k

      dem = path_of(case, case%dem)
      if (allocated(inputs%zone2)) then
         call check_same_grid(path_of(case, case%zones), grid, "zones", "nearest", dem, &
                              inputs%grid, error)
         if (.not. allocated(error)) call check_zones(case, inputs, table_ids, error)
         if (.not. allocated(error)) call keep_zones(inputs)
      else if (allocated(inputs%values)) then
         call check_same_grid(path_of(case, values_file(case, 1)), grid, &
                              "values of "//values_key(case, 1), "bilinear", dem, inputs%grid, &
                              error)
         do k = 1, size(inputs%values, 3)
            if (allocated(error)) return
            call check_values(path_of(case, values_file(case, k)), inputs, k, error)
         end do
      end if
   end subroutine check_surface

   !> Zones as the kernel sees them, in the smallest integers.
   subroutine keep_zones(inputs)
      type(inputs_t), intent(inout), target :: inputs

      if (size(inputs%scene%surface%sizes, 2) > huge(1_i1)) then
         inputs%scene%surface%zone2 => inputs%zone2
      else
         inputs%zone1 = int(inputs%zone2, i1)
         deallocate (inputs%zone2)
         inputs%scene%surface%zone1 => inputs%zone1
      end if
   end subroutine keep_zones

   subroutine check_zones(case, inputs, table_ids, error)
      type(case_t), intent(in) :: case
      type(inputs_t), intent(in) :: inputs
      integer(i4), intent(in) :: table_ids(:)
      type(error_t), allocatable, intent(out) :: error
      logical :: used(0:size(table_ids)), here(inputs%grid%nx)
      integer :: i, j

      used = .false.
      do j = 1, inputs%grid%ny
         here = known(inputs, j)
         do i = 1, inputs%grid%nx
            if (here(i)) used(inputs%zone2(i, j)) = .true.
         end do
      end do
      if (used(0)) then
         call explain_zones(case, inputs, error)
      else if (case%method == method_a) then
         call check_sizes(inputs%scene%surface%sizes, used(1:), table_ids, "rg70, rg20, rg10", &
                          "A", path_of(case, case%table), error)
      else
         call check_sizes(inputs%scene%surface%sizes, used(1:), table_ids, "mean_radius", "B", &
                          path_of(case, case%table), error)
      end if
   end subroutine check_zones

   !> Read the zones again, to say which have no row in the table.
   subroutine explain_zones(case, inputs, error)
      type(case_t), intent(in) :: case
      type(inputs_t), intent(in) :: inputs
      type(error_t), allocatable, intent(out) :: error
      integer(i4), allocatable :: ids(:, :)
      logical, allocatable :: here(:, :)
      type(grid_t) :: grid
      integer :: j

      call read_raster(path_of(case, case%zones), ids, grid, error)
      if (allocated(error)) return
      allocate (here(grid%nx, grid%ny))
      do j = 1, grid%ny
         here(:, j) = known(inputs, j)
      end do
      call without_row(ids, inputs%zone2, here, path_of(case, case%zones), &
                       path_of(case, case%table), error)
   end subroutine explain_zones

   subroutine check_values(path, inputs, k, error)
      character(len=*), intent(in) :: path
      type(inputs_t), intent(in) :: inputs
      integer, intent(in) :: k
      type(error_t), allocatable, intent(out) :: error
      logical :: none(inputs%grid%nx)
      integer :: j, missing, not_positive

      missing = 0
      not_positive = 0
      do j = 1, inputs%grid%ny
         none = ieee_is_nan(inputs%values(:, j, k))
         missing = missing + count(none .and. known(inputs, j))
         not_positive = not_positive + count(merge(1.0_sp, inputs%values(:, j, k), none) <= 0)
      end do
      if (missing + not_positive > 0) then
         call fail(error, path//": "//integer_text(missing) &
                   //" cells of the terrain without a value, " &
                   //integer_text(not_positive)//" not > 0 (Inf absorbs)")
      end if
   end subroutine check_values

   ! ---- sources, lines, impact sets ----------------------------------------------------------

   !> Release points, or the centres of source cells in the order of the raster.
   subroutine read_sources(case, inputs, error)
      type(case_t), intent(in) :: case
      type(inputs_t), intent(inout) :: inputs
      type(error_t), allocatable, intent(out) :: error
      integer(i2), allocatable :: cells(:, :)
      real(wp), allocatable :: x(:), y(:)
      type(grid_t) :: grid
      integer :: i, j, n, status

      if (case%cells == "" .and. .not. case%steep_cells) then
         inputs%arrays%source_x = case%x
         inputs%arrays%source_y = case%y
         return
      end if
      call read_cells(case, inputs, cells, error)
      if (.not. allocated(error) .and. case%steep_cells) call select_steep(case, inputs, cells, error)
      if (allocated(error)) return
      grid = inputs%grid
      n = count(cells > 0)
      allocate (x(n), y(n), stat=status)
      if (status /= 0) call fail(error, case%file//": &release: no memory for "//integer_text(n)//" sources")
      if (allocated(error)) return
      n = 0
      do j = 1, grid%ny
         do i = 1, grid%nx
            if (cells(i, j) <= 0) cycle
            n = n + 1
            x(n) = grid%west + (i - 0.5_wp)*grid%cell
            y(n) = grid%north - (j - 0.5_wp)*grid%cell
         end do
      end do
      inputs%arrays%source_x = x
      inputs%arrays%source_y = y
   end subroutine read_sources

   !> Cells that may be sources: 1, the others 0; all of them where the case names no raster.
   subroutine read_cells(case, inputs, cells, error)
      type(case_t), intent(in) :: case
      type(inputs_t), intent(inout) :: inputs
      integer(i2), allocatable, intent(out) :: cells(:, :)
      type(error_t), allocatable, intent(out) :: error
      integer(i4), allocatable :: values(:, :)
      type(grid_t) :: grid
      character(len=:), allocatable :: path
      integer :: j, status

      allocate (cells(inputs%grid%nx, inputs%grid%ny), source=1_i2, stat=status)
      if (status /= 0) call fail(error, case%file//": &release: no memory for the source cells")
      if (allocated(error) .or. case%cells == "") return
      path = path_of(case, case%cells)
      call read_raster(path, values, grid, error)
      if (.not. allocated(error)) call note_file(inputs, "cells", path, error)
      if (.not. allocated(error)) then
         call check_same_grid(path, grid, "source cells", "nearest", path_of(case, case%dem), &
                              inputs%grid, error)
      end if
      if (allocated(error)) return
      do j = 1, size(cells, 2)
         cells(:, j) = merge(1_i2, 0_i2, values(:, j) > 0)
      end do
      if (.not. any(cells > 0)) call fail(error, path//": no source cells: must have cells above zero")
   end subroutine read_cells

   !> Leave those cells that are as steep as the case wants.
   subroutine select_steep(case, inputs, cells, error)
      type(case_t), intent(in) :: case
      type(inputs_t), intent(in) :: inputs
      integer(i2), intent(inout) :: cells(:, :)
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: threshold

      threshold = usual_threshold(inputs%grid%cell)
      if (allocated(case%slope_threshold)) threshold = case%slope_threshold
      call keep_steep(inputs%scene%dem, threshold, 1, cells)
      if (any(cells > 0)) return
      call fail(error, case%file//": &release steep_cells: no cell is as steep as "//decimal(threshold, 1)//" degrees")
   end subroutine select_steep

   subroutine read_impacts(case, inputs, error)
      type(case_t), intent(in) :: case
      type(inputs_t), intent(inout) :: inputs
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: path, text

      call find_sets(case, path, error)
      if (.not. allocated(error)) call read_text(path, text, error)
      if (.not. allocated(error)) call note_file(inputs, "sets", path, error)
      if (allocated(error)) return
      inputs%arrays%sets_text = text
      inputs%arrays%sets_name = path
   end subroutine read_impacts

   !> The file of the case's impact sets: shipped with the program, or beside the case.
   subroutine find_sets(case, path, error)
      type(case_t), intent(in) :: case
      character(len=:), allocatable, intent(out) :: path
      type(error_t), allocatable, intent(out) :: error
      character(len=4096), parameter :: folders(2) = [character(len=4096) :: installed_sets, source_sets]
      logical :: exists
      integer :: k

      if (index(case%sets, "/") == 0) then
         do k = 1, size(folders)
            path = trim(folders(k))//"/"//case%sets//".nml"
            inquire (file=path, exist=exists)
            if (exists) return
         end do
      end if
      path = path_of(case, case%sets)
      inquire (file=path, exist=exists)
      if (exists) return
      call fail(error, case%file//": &impact sets = '"//case%sets//"': no such file, and no shipped set")
   end subroutine find_sets

   !> What was read, as the scene is made of it.
   subroutine gather_arrays(case, inputs)
      type(case_t), intent(in) :: case
      type(inputs_t), intent(inout), target :: inputs

      associate (arrays => inputs%arrays, scene => inputs%scene)
         arrays%grid = inputs%grid
         if (allocated(inputs%z8)) arrays%z8 => inputs%z8
         if (allocated(inputs%z4)) arrays%z4 => inputs%z4
         if (allocated(inputs%zone1)) arrays%zone1 => inputs%zone1
         if (allocated(inputs%zone2)) arrays%zone2 => inputs%zone2
         if (allocated(inputs%values)) arrays%values => inputs%values
         allocate (arrays%sizes(merge(3, 1, case%method == method_a), 1), source=0.0_wp)
         if (allocated(scene%surface%sizes)) arrays%sizes = scene%surface%sizes
         if (case%by_area) arrays%area_ratio = surface_ratios(scene%dem, arrays%source_x - scene%dem%x0, &
                                                              arrays%source_y - scene%dem%y0)
      end associate
   end subroutine gather_arrays

   !> Names of the evaluation lines of which no part lies over the terrain, with commas between.
   pure function lines_outside(case, grid) result(names)
      type(case_t), intent(in) :: case
      type(grid_t), intent(in) :: grid
      character(len=:), allocatable :: names
      integer :: k

      names = ""
      do k = 1, size(case%lines)
         associate (x => case%lines(k)%x, y => case%lines(k)%y)
            if (is_outside(grid, x, y)) names = names//", "//case%lines(k)%name
         end associate
      end do
      if (names /= "") names = names(3:)
   end function lines_outside
end module rockfall_load
