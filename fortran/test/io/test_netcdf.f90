! SPDX-License-Identifier: BSD-3-Clause
!> Rasters out of netCDF files that the test writes: what is read, what is refused.
program test_netcdf
   use, intrinsic :: ieee_arithmetic, only: ieee_is_nan, ieee_value, ieee_quiet_nan, &
                                            ieee_positive_inf
   use netcdf
   use rockfall_kinds, only: wp, sp, i4
   use rockfall_error, only: error_t
   use rockfall_grid, only: grid_t
   use rockfall_netcdf, only: read_netcdf_grid, is_single, split_name, no_id
   use check_m, only: check, check_close, finish
   implicit none

   character(len=*), parameter :: name = "test_netcdf.tmp.nc"
   integer, parameter :: nx = 4, ny = 3
   real(wp), parameter :: x(nx) = [101.25_wp, 103.75_wp, 106.25_wp, 108.75_wp]
   real(wp), parameter :: y(ny) = [206.25_wp, 203.75_wp, 201.25_wp]  !! from the north
   real(wp), parameter :: z(nx, ny) = reshape([1.1_wp, 2.1_wp, 3.1_wp, 4.1_wp, 5.1_wp, 6.1_wp, &
                                               7.1_wp, 8.1_wp, 9.1_wp, 10.1_wp, 11.1_wp, &
                                               12.1_wp], [nx, ny])

   call north_up_and_south_up()
   call kinds_of_numbers()
   call no_data()
   call integers()
   call large_rasters()
   call several_variables()
   call coordinates_refused()
   call files_refused()
   call remove(name)
   call finish()

contains

   subroutine north_up_and_south_up()
      real(wp), allocatable :: got(:, :)
      type(grid_t) :: grid
      type(error_t), allocatable :: error
      integer :: turn

      do turn = 1, 2
         if (turn == 1) then
            call write_raster(x, y, nf90_double, z)
         else
            call write_raster(x, y(ny:1:-1), nf90_double, z(:, ny:1:-1))
         end if
         call read_netcdf_grid(name, got, grid, error)
         call check("a raster is read", .not. allocated(error))
         if (allocated(error)) return
         call check("the same numbers, row 1 northernmost", all(abs(got - z) <= 0.0_wp))
         call check_close("west", grid%west, 100.0_wp, 0.0_wp)
         call check_close("north", grid%north, 207.5_wp, 0.0_wp)
         call check_close("cell", grid%cell, 2.5_wp, 0.0_wp)
         call check("shape", grid%nx == nx .and. grid%ny == ny)
      end do
   end subroutine north_up_and_south_up

   subroutine kinds_of_numbers()
      real(wp), allocatable :: got(:, :)
      real(sp), allocatable :: single(:, :)
      type(grid_t) :: grid
      type(error_t), allocatable :: error
      logical :: fits

      call write_raster(x, y, nf90_double, z)
      call is_single(name, fits, error)
      call check("doubles are not single", .not. fits .and. .not. allocated(error))
      call write_raster(x, y, nf90_short, 10*z)
      call is_single(name, fits, error)
      call check("short integers are single", fits)
      call write_raster(x, y, nf90_float, z)
      call is_single(name, fits, error)
      call check("floats are single", fits)
      call read_netcdf_grid(name, single, grid, error)
      call check("floats as floats", .not. allocated(error))
      if (.not. allocated(error)) then
         call check("unchanged", all(abs(single - real(z, sp)) <= 0.0_sp))
      end if
      call read_netcdf_grid(name, got, grid, error)
      call check("floats as doubles", all(abs(got - real(real(z, sp), wp)) <= 0.0_wp))

      call write_raster(x, y, nf90_int, anint(10*z), scale=0.1_wp, offset=1000.0_wp)
      call is_single(name, fits, error)
      call check("packed numbers are not single", .not. fits)
      call read_netcdf_grid(name, got, grid, error)
      call check("packed numbers", all(abs(got - (anint(10*z)*0.1_wp + 1000.0_wp)) <= 0.0_wp))
   end subroutine kinds_of_numbers

   subroutine no_data()
      real(wp), allocatable :: got(:, :)
      type(grid_t) :: grid
      type(error_t), allocatable :: error
      real(wp) :: holes(nx, ny)

      holes = z
      holes(2, 3) = -9999.0_wp
      holes(3, 3) = ieee_value(1.0_wp, ieee_quiet_nan)
      holes(4, 3) = 0.0_wp
      call write_raster(x, y, nf90_double, holes, fill=-9999.0_wp)
      call read_netcdf_grid(name, got, grid, error)
      call check("_FillValue and NaN are no data", &
                 count(ieee_is_nan(got)) == 2 .and. all(ieee_is_nan(got(2:3, 3))))
      call write_raster(x, y, nf90_double, holes, fill=ieee_value(1.0_wp, ieee_quiet_nan))
      call read_netcdf_grid(name, got, grid, error)
      call check("NaN as _FillValue", count(ieee_is_nan(got)) == 1)
      call check_close("zero is a number then", got(4, 3), 0.0_wp, 0.0_wp)
      call check_close("-9999, too", got(2, 3), -9999.0_wp, 0.0_wp)
      holes(1, 1) = nf90_fill_double
      call write_raster(x, y, nf90_double, holes)
      call read_netcdf_grid(name, got, grid, error)
      call check("what was never written", count(ieee_is_nan(got)) == 2 &
                 .and. ieee_is_nan(got(1, 1)))
      holes(1, 2) = ieee_value(1.0_wp, ieee_positive_inf)
      call write_raster(x, y, nf90_double, holes)
      call read_netcdf_grid(name, got, grid, error)
      call said(error, ": row 2, column 1: must be finite or nodata")
      call read_netcdf_grid(name, got, grid, error, infinite=.true.)
      call check("Inf where it is allowed", got(1, 2) > huge(1.0_wp))
   end subroutine no_data

   subroutine integers()
      integer(i4), allocatable :: got(:, :)
      type(grid_t) :: grid
      type(error_t), allocatable :: error

      call write_raster(x, y, nf90_double, anint(z), fill=6.0_wp)
      call read_netcdf_grid(name, got, grid, error)
      call check("integers", .not. allocated(error))
      if (.not. allocated(error)) then
         call check("their values, no data", &
                    all(got == reshape([1, 2, 3, 4, 5, no_id, 7, 8, 9, 10, 11, 12], [nx, ny])))
      end if
      call write_raster(x, y, nf90_double, z)
      call read_netcdf_grid(name, got, grid, error)
      call said(error, ": row 1, column 1: 1.1: must be an integer of 32 bits")
      call write_raster(x, y, nf90_double, anint(z)*1.0e9_wp)
      call read_netcdf_grid(name, got, grid, error)
      call said(error, ": row 1, column 3: 3000000000: must be an integer of 32 bits")
   end subroutine integers

   !> More than one block of rows, from the south.
   subroutine large_rasters()
      integer, parameter :: mx = 2000, my = 1300
      real(wp), allocatable :: big(:, :), got(:, :)
      type(grid_t) :: grid
      type(error_t), allocatable :: error
      integer :: i

      big = reshape([(real(i, wp), i=1, mx*my)], [mx, my])
      call write_raster([(10.0_wp*i, i=1, mx)], [(10.0_wp*i, i=1, my)], nf90_double, big)
      call read_netcdf_grid(name, got, grid, error)
      call check("a large raster", .not. allocated(error))
      if (.not. allocated(error)) then
         call check("all its numbers", all(abs(got - big(:, my:1:-1)) <= 0.0_wp))
      end if
   end subroutine large_rasters

   subroutine several_variables()
      real(wp), allocatable :: got(:, :)
      type(grid_t) :: grid
      type(error_t), allocatable :: error
      character(len=:), allocatable :: file, variable

      call write_raster(x, y, nf90_double, z, second="zones")
      call read_netcdf_grid(name, got, grid, error)
      call said(error, ": has several rasters, take one of: "//name//":elevation, "//name//":zones")
      call read_netcdf_grid(name//":zones", got, grid, error)
      call check("one of two", .not. allocated(error))
      if (.not. allocated(error)) call check("the right one", all(abs(got + z) <= 0.0_wp))
      call read_netcdf_grid(name//":slope", got, grid, error)
      call said(error, ":slope: no raster slope; has: elevation, zones")
      call read_netcdf_grid(name//":x", got, grid, error)
      call said(error, ":x: no raster x; has: elevation, zones")
      call split_name(name//":zones", file, variable)
      call check("names are split", file == name .and. variable == "zones")
      call split_name(name, file, variable)
      call check("names without a variable", file == name .and. variable == "")
   end subroutine several_variables

   subroutine coordinates_refused()
      call refused(x, y, "degrees_east", ": cells are in degrees, metres are needed")
      call refused(x, y, "km", ": x is in km, metres are needed")
      call refused(x, 2*y, "m", ": cells are not square (2.5 x 5 m)")
      call refused(x(nx:1:-1), y, "m", ": is mirrored: columns run from east to west")
      call refused([1.0_wp, 2.0_wp, 3.0_wp, 4.5_wp], y, "m", ": coordinate x is not regular")
      call refused(x, [1.0_wp, 1.0_wp, 1.0_wp], "m", ": coordinate y is not regular")
      call refused(x, [1.0_wp, 2.0_wp, ieee_value(1.0_wp, ieee_quiet_nan)], "m", &
                   ": coordinate y is not regular")
   end subroutine coordinates_refused

   subroutine files_refused()
      real(wp), allocatable :: got(:, :)
      type(grid_t) :: grid
      type(error_t), allocatable :: error
      integer :: unit

      open (newunit=unit, file=name, status="replace", action="write")
      write (unit, "(a)") "ncols 3"
      close (unit)
      call read_netcdf_grid(name, got, grid, error)
      call said(error, ": cannot be read as netCDF: NetCDF: Unknown file format")
      call write_raster(x, y, nf90_double, z, form=nf90_64bit_offset)
      call read_netcdf_grid(name, got, grid, error)
      call check("a whole classic file", .not. allocated(error))
      call cut_last_byte()
      call read_netcdf_grid(name, got, grid, error)
      call said(error, ": ends early: truncated")
      call write_raster(x, y, nf90_char, z)
      call read_netcdf_grid(name, got, grid, error)
      call said(error, ": has no variable of numbers on (y, x) with coordinates")
      call remove(name)
      call read_netcdf_grid(name, got, grid, error)
      call said(error, ": no such file")
      call read_netcdf_grid(name//":z", got, grid, error)
      call said(error, ":z: no such file")
   end subroutine files_refused

   !> A raster with such coordinates must be refused with the name and exactly this message.
   subroutine refused(x, y, units, message)
      real(wp), intent(in) :: x(:), y(:)
      character(len=*), intent(in) :: units, message
      real(wp), allocatable :: got(:, :)
      type(grid_t) :: grid
      type(error_t), allocatable :: error

      call write_raster(x, y, nf90_double, z, units=units)
      call read_netcdf_grid(name, got, grid, error)
      call said(error, message)
   end subroutine refused

   subroutine said(error, message)
      type(error_t), allocatable, intent(in) :: error
      character(len=*), intent(in) :: message

      if (allocated(error)) then
         call check(message//" <- "//error%message, error%message == name//message)
      else
         call check("refused: "//message, .false.)
      end if
   end subroutine said

   !> The file `name` with the raster `elevation`, and its negative as `second`.
   subroutine write_raster(x, y, kind, values, fill, scale, offset, second, units, form)
      real(wp), intent(in) :: x(:), y(:), values(:, :)
      integer, intent(in) :: kind
      real(wp), intent(in), optional :: fill, scale, offset
      character(len=*), intent(in), optional :: second, units
      integer, intent(in), optional :: form
      integer :: file, dim_x, dim_y, var_x, var_y, var, var2

      if (present(form)) then
         call ok(nf90_create(name, form, file))
      else
         call ok(nf90_create(name, nf90_netcdf4, file))
      end if
      call ok(nf90_def_dim(file, "y", size(y), dim_y))
      call ok(nf90_def_dim(file, "x", size(x), dim_x))
      call ok(nf90_def_var(file, "x", nf90_double, dim_x, var_x))
      call ok(nf90_def_var(file, "y", nf90_double, dim_y, var_y))
      call ok(nf90_def_var(file, "elevation", kind, [dim_x, dim_y], var))
      if (present(second)) call ok(nf90_def_var(file, second, kind, [dim_x, dim_y], var2))
      if (present(units)) call ok(nf90_put_att(file, var_x, "units", units))
      if (present(fill)) call ok(nf90_put_att(file, var, "_FillValue", fill))
      if (present(scale)) call ok(nf90_put_att(file, var, "scale_factor", scale))
      if (present(offset)) call ok(nf90_put_att(file, var, "add_offset", offset))
      call ok(nf90_enddef(file))
      call ok(nf90_put_var(file, var_x, (x)))  ! a copy: the library may write to it
      call ok(nf90_put_var(file, var_y, (y)))
      if (kind /= nf90_char) call ok(nf90_put_var(file, var, (values)))
      if (present(second)) call ok(nf90_put_var(file, var2, -values))
      call ok(nf90_close(file))
   end subroutine write_raster

   subroutine cut_last_byte()
      character(len=:), allocatable :: bytes
      integer :: unit, size

      open (newunit=unit, file=name, access="stream", form="unformatted", status="old")
      inquire (unit=unit, size=size)
      allocate (character(len=size - 1) :: bytes)
      read (unit) bytes
      close (unit)
      open (newunit=unit, file=name, access="stream", form="unformatted", status="replace")
      write (unit) bytes
      close (unit)
   end subroutine cut_last_byte

   subroutine ok(status)
      integer, intent(in) :: status

      if (status /= nf90_noerr) call check(trim(nf90_strerror(status)), .false.)
   end subroutine ok

   subroutine remove(file)
      character(len=*), intent(in) :: file
      integer :: unit

      open (newunit=unit, file=file)
      close (unit, status="delete")
   end subroutine remove
end program test_netcdf
