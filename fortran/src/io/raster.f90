! SPDX-License-Identifier: BSD-3-Clause
!> Rasters from files of any format that the program reads: ESRI ASCII grids, and netCDF where the
!> program was built with it. Each by its contents, whatever its name.
module rockfall_raster
   use, intrinsic :: ieee_arithmetic, only: ieee_is_nan, ieee_value, ieee_quiet_nan, &
                                            ieee_positive_inf, ieee_negative_inf
   use rockfall_kinds, only: wp, sp, i4
   use rockfall_error, only: error_t, fail
   use rockfall_decimal, only: real_text
   use rockfall_pipe, only: is_pipe
   use rockfall_text_file, only: read_text
   use rockfall_text, only: integer_text, lower
   use rockfall_filesystem, only: name_of
   use rockfall_grid, only: grid_t, same_grid
   use rockfall_asciigrid, only: read_ascii_grid
#ifdef HAVE_NETCDF
   use rockfall_netcdf, only: read_netcdf_grid, is_single, split_name
#endif
   implicit none
   private
   public :: read_raster, in_single_precision, check_same_grid, crs_of, check_metres, &
             raster_file, crs_file, prepare_hint

   integer, parameter :: other_format = 0, ascii_format = 1, netcdf_format = 2
   character(len=*), parameter :: prepare_hint = &
      "make a case that this program reads with: rockfall prepare CASE FOLDER"

   !> read_raster(path, values, grid, error [, infinite]): values(nx, ny), row 1 the northernmost.
   !> Cells without data: NaN, or `no_id` among integers. `path` may be `file.nc:variable`.
   interface read_raster
      module procedure read_double, read_single, read_integer
   end interface read_raster

contains

   subroutine read_double(path, values, grid, error, infinite)
      character(len=*), intent(in) :: path
      real(wp), allocatable, intent(out) :: values(:, :)
      type(grid_t), intent(out) :: grid
      type(error_t), allocatable, intent(out) :: error
      logical, intent(in), optional :: infinite  !! whether Inf is a value; .false. unless given

      select case (format_of(path))
      case (ascii_format)
         call read_ascii_grid(path, values, grid, error, infinite)
#ifdef HAVE_NETCDF
      case (netcdf_format)
         call read_netcdf_grid(path, values, grid, error, infinite)
#endif
      case default
         call refuse_format(path, error)
      end select
   end subroutine read_double

   subroutine read_single(path, values, grid, error, infinite)
      character(len=*), intent(in) :: path
      real(sp), allocatable, intent(out) :: values(:, :)
      type(grid_t), intent(out) :: grid
      type(error_t), allocatable, intent(out) :: error
      logical, intent(in), optional :: infinite
      real(wp), allocatable :: wide(:, :)
      integer :: j, status

      select case (format_of(path))
      case (ascii_format)
         call read_ascii_grid(path, wide, grid, error, infinite)
         if (allocated(error)) return
         allocate (values(grid%nx, grid%ny), stat=status)
         if (status /= 0) then
            call fail(error, path//": no memory for its numbers")
            return
         end if
         do j = 1, grid%ny
            values(:, j) = narrow(wide(:, j))
         end do
#ifdef HAVE_NETCDF
      case (netcdf_format)
         call read_netcdf_grid(path, values, grid, error, infinite)
#endif
      case default
         call refuse_format(path, error)
      end select
   end subroutine read_single

   subroutine read_integer(path, values, grid, error)
      character(len=*), intent(in) :: path
      integer(i4), allocatable, intent(out) :: values(:, :)
      type(grid_t), intent(out) :: grid
      type(error_t), allocatable, intent(out) :: error

      select case (format_of(path))
      case (ascii_format)
         call read_ascii_grid(path, values, grid, error)
#ifdef HAVE_NETCDF
      case (netcdf_format)
         call read_netcdf_grid(path, values, grid, error)
#endif
      case default
         call refuse_format(path, error)
      end select
   end subroutine read_integer

   !> Single precision by rounding; beyond it is infinite, without the overflow that could trap.
   elemental real(sp) function narrow(value)
      real(wp), intent(in) :: value
      real(wp), parameter :: beyond = 3.40282356779733661637e38_wp  !! rounds to infinity

      if (ieee_is_nan(value)) then
         narrow = ieee_value(1.0_sp, ieee_quiet_nan)
      else if (value >= beyond) then
         narrow = ieee_value(1.0_sp, ieee_positive_inf)
      else if (value <= -beyond) then
         narrow = ieee_value(1.0_sp, ieee_negative_inf)
      else
         narrow = real(value, sp)
      end if
   end function narrow

   !> Whether elevations of this file are kept in single precision, which holds all of them.
   subroutine in_single_precision(path, single, error)
      character(len=*), intent(in) :: path
      logical, intent(out) :: single
      type(error_t), allocatable, intent(out) :: error

      single = .false.
#ifdef HAVE_NETCDF
      if (format_of(path) == netcdf_format) call is_single(path, single, error)
#endif
   end subroutine in_single_precision

   !> What the first bytes say. A file that is not there, or a pipe, counts as ASCII, whose
   !> reader says so.
   integer function format_of(path) result(format)
      character(len=*), intent(in) :: path
      character(len=1) :: byte(4)
      integer :: unit, status, k

      format = ascii_format
      if (is_pipe(raster_file(path))) return
      open (newunit=unit, file=raster_file(path), access="stream", form="unformatted", &
            status="old", action="read", iostat=status)
      if (status /= 0) return
      do k = 1, size(byte)
         read (unit, iostat=status) byte(k)
         if (status /= 0) byte(k) = " "
      end do
      close (unit)
      if (all(byte(1:3) == ["C", "D", "F"]) .or. all(byte == [char(137), "H", "D", "F"])) then
         format = netcdf_format
      else if (any(iachar(byte) > 126 .or. (iachar(byte) < 32 .and. byte /= achar(9) &
                   .and. byte /= achar(10) .and. byte /= achar(13)))) then
         format = other_format
      else if (byte(1) == "<" .or. byte(1) == "{") then  ! a virtual raster, polygons
         format = other_format
      end if
   end function format_of

   !> The file of `file.nc:variable`.
   function raster_file(path) result(file)
      character(len=*), intent(in) :: path
      character(len=:), allocatable :: file
#ifdef HAVE_NETCDF
      character(len=:), allocatable :: variable

      call split_name(path, file, variable)
#else
      file = path
      if (index(path, ".nc:") > 0) file = path(:index(path, ".nc:", back=.true.) + 2)
#endif
   end function raster_file

   subroutine refuse_format(path, error)
      character(len=*), intent(in) :: path
      type(error_t), allocatable, intent(out) :: error

      if (format_of(path) == netcdf_format) then
         call fail(error, path//": netCDF, which this program was built without; "//prepare_hint)
      else
         call fail(error, path//": not an ESRI ASCII grid or netCDF; "//prepare_hint)
      end if
   end subroutine refuse_format

   !> The coordinate reference system of an ESRI ASCII grid from its .prj file; "" without one.
   function crs_of(path) result(crs)
      character(len=*), intent(in) :: path
      character(len=:), allocatable :: crs
      type(error_t), allocatable :: error
      logical :: exists

      crs = ""
      if (format_of(path) /= ascii_format) return
      inquire (file=crs_file(path), exist=exists)
      if (exists) call read_text(crs_file(path), crs, error)
      if (allocated(error)) crs = ""  ! nobody named this file, so it may say nothing
   end function crs_of

   !> The file beside an ESRI ASCII grid that tells its coordinate reference system.
   pure function crs_file(path)
      character(len=*), intent(in) :: path
      character(len=:), allocatable :: crs_file

      crs_file = stem(path)//".prj"
   end function crs_file

   !> Refuse cells in feet (degrees are refused where the grid is read).
   pure subroutine check_metres(path, crs, error)
      character(len=*), intent(in) :: path, crs
      type(error_t), allocatable, intent(out) :: error

      if (index(lower(crs), "unit[""foot") + index(lower(crs), "unit[""us survey foot") > 0) then
         call fail(error, path//": cells are in feet ("//crs_file(path)//"), metres are needed")
      end if
   end subroutine check_metres

   !> Refuse a raster of `what` (a plural) that does not lie on the cells of the DEM.
   subroutine check_same_grid(path, grid, what, resampling, dem, dem_grid, error)
      character(len=*), intent(in) :: path, what, resampling, dem
      type(grid_t), intent(in) :: grid, dem_grid
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: message

      if (same_grid(grid, dem_grid)) return
      if (overlap(grid, dem_grid)) then
         message = " are not on the cells of "//dem//" ("//extent(dem_grid)//"); resample with: " &
                   //"rio warp "//path//" "//stem(path)//"_on_"//stem(name_of(dem))//".tif" &
                   //" --like "//dem//" --resampling "//resampling
      else
         message = " lie apart from the cells of "//dem//" ("//extent(dem_grid)//")"
      end if
      call fail(error, path//": "//what//" ("//extent(grid)//")"//message)
   end subroutine check_same_grid

   pure logical function overlap(a, b)
      type(grid_t), intent(in) :: a, b

      overlap = max(a%west, b%west) < min(a%west + a%nx*a%cell, b%west + b%nx*b%cell) .and. &
                min(a%north, b%north) > max(a%north - a%ny*a%cell, b%north - b%ny*b%cell)
   end function overlap

   !> How a grid lies, in a few words.
   pure function extent(grid) result(text)
      type(grid_t), intent(in) :: grid
      character(len=:), allocatable :: text

      text = integer_text(grid%nx)//" x "//integer_text(grid%ny)//" cells of " &
             //real_text(grid%cell)//", corner "//real_text(grid%west)//", "//real_text(grid%north)
   end function extent

   !> A path without its ending.
   pure function stem(path)
      character(len=*), intent(in) :: path
      character(len=:), allocatable :: stem
      integer :: dot

      dot = index(path, ".", back=.true.)
      stem = path
      if (dot > index(path, "/", back=.true.) + 1) stem = path(:dot - 1)
   end function stem
end module rockfall_raster
