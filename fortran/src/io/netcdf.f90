! SPDX-License-Identifier: BSD-3-Clause
!> Rasters out of netCDF files: variables on (y, x) whose coordinates are regular cell centres.
module rockfall_netcdf
   use, intrinsic :: ieee_arithmetic, only: ieee_is_nan, ieee_value, ieee_quiet_nan
   use netcdf, only: nf90_open, nf90_close, nf90_strerror, nf90_inquire, nf90_inquire_variable, &
                     nf90_inquire_dimension, nf90_inq_varid, nf90_inq_attname, nf90_get_var, &
                     nf90_get_att, nf90_inquire_attribute, nf90_noerr, nf90_nowrite, nf90_global, &
                     nf90_max_name, nf90_max_var_dims, nf90_format_classic, &
                     nf90_format_netcdf4, nf90_format_netcdf4_classic, nf90_char, nf90_byte, &
                     nf90_ubyte, nf90_short, nf90_ushort, nf90_int, nf90_uint, nf90_int64, &
                     nf90_uint64, nf90_float, nf90_double, nf90_fill_short, nf90_fill_int, &
                     nf90_fill_float, nf90_fill_double, nf90_fill_ushort, nf90_fill_uint
   use rockfall_kinds, only: wp, sp, i4, i8
   use rockfall_error, only: error_t, fail
   use rockfall_decimal, only: real_text
   use rockfall_pipe, only: refuse_pipe
   use rockfall_classicheader, only: overstates
   use rockfall_text, only: lower
   use rockfall_grid, only: grid_t
   use rockfall_cells, only: no_id, whole_numbers, cell_name
   implicit none
   private
   public :: read_netcdf_grid, is_single, split_name, text_attribute, no_id

   integer, parameter :: block = 1024**2  !! values in memory beside the raster
   integer, parameter :: numbers(*) = [nf90_byte, nf90_ubyte, nf90_short, nf90_ushort, nf90_int, &
                                       nf90_uint, nf90_int64, nf90_uint64, nf90_float, nf90_double]

   !> A variable of an open file.
   type :: source_t
      character(len=:), allocatable :: name  !! as asked for, for messages
      integer :: file = -1, variable = 0, kind = 0
      type(grid_t) :: grid
      logical :: south_up = .false.          !! its first row is the southernmost
      integer :: rows = 1                    !! to read at a time
      integer :: fills = 0                   !! how many of `fill` mark cells without data
      real(wp) :: fill(2) = 0.0_wp
      real(wp) :: scale = 1.0_wp, offset = 0.0_wp
   end type source_t

   !> read_netcdf_grid(file, values, grid, error [, infinite]): values(nx, ny), row 1 northernmost;
   !> `file` may be `file.nc:variable`. Cells without data: NaN, or `no_id` among integers.
   interface read_netcdf_grid
      module procedure read_double, read_single, read_integer
   end interface read_netcdf_grid

contains

   subroutine read_double(file, values, grid, error, infinite)
      character(len=*), intent(in) :: file
      real(wp), allocatable, intent(out) :: values(:, :)
      type(grid_t), intent(out) :: grid
      type(error_t), allocatable, intent(out) :: error
      logical, intent(in), optional :: infinite  !! whether Inf is a value; .false. unless given
      type(source_t) :: source
      real(wp), allocatable :: rows(:, :)
      integer :: first, last

      call open_source(file, source, error)
      if (allocated(error)) return
      grid = source%grid
      allocate (values(grid%nx, grid%ny))
      do first = 1, grid%ny, source%rows
         last = min(first + source%rows - 1, grid%ny)
         call read_rows(source, first, last, rows, error, infinite)
         if (allocated(error)) exit
         values(:, first:last) = rows
      end do
      call close_source(source)
   end subroutine read_double

   subroutine read_single(file, values, grid, error, infinite)
      character(len=*), intent(in) :: file
      real(sp), allocatable, intent(out) :: values(:, :)
      type(grid_t), intent(out) :: grid
      type(error_t), allocatable, intent(out) :: error
      logical, intent(in), optional :: infinite
      type(source_t) :: source
      real(wp), allocatable :: rows(:, :)
      integer :: first, last

      call open_source(file, source, error)
      if (allocated(error)) return
      grid = source%grid
      allocate (values(grid%nx, grid%ny))
      do first = 1, grid%ny, source%rows
         last = min(first + source%rows - 1, grid%ny)
         call read_rows(source, first, last, rows, error, infinite)
         if (allocated(error)) exit
         values(:, first:last) = real(rows, sp)
      end do
      call close_source(source)
   end subroutine read_single

   subroutine read_integer(file, values, grid, error)
      character(len=*), intent(in) :: file
      integer(i4), allocatable, intent(out) :: values(:, :)
      type(grid_t), intent(out) :: grid
      type(error_t), allocatable, intent(out) :: error
      type(source_t) :: source
      real(wp), allocatable :: rows(:, :)
      integer :: first, last

      call open_source(file, source, error)
      if (allocated(error)) return
      grid = source%grid
      allocate (values(grid%nx, grid%ny))
      do first = 1, grid%ny, source%rows
         last = min(first + source%rows - 1, grid%ny)
         call read_rows(source, first, last, rows, error)
         if (.not. allocated(error)) then
            call whole_numbers(file, first, rows, values(:, first:last), error)
         end if
         if (allocated(error)) exit
      end do
      call close_source(source)
   end subroutine read_integer

   !> Whether single precision holds all that the variable can.
   subroutine is_single(file, single, error)
      character(len=*), intent(in) :: file
      logical, intent(out) :: single
      type(error_t), allocatable, intent(out) :: error
      type(source_t) :: source

      single = .false.
      call open_source(file, source, error)
      if (allocated(error)) return
      single = any(source%kind == [nf90_byte, nf90_ubyte, nf90_short, nf90_ushort, nf90_float]) &
               .and. .not. is_scaled(source)
      call close_source(source)
   end subroutine is_single

   !> `file.nc:variable` in its parts; no variable if a file has the whole name.
   subroutine split_name(name, file, variable)
      character(len=*), intent(in) :: name
      character(len=:), allocatable, intent(out) :: file, variable
      integer :: colon
      logical :: exists

      file = name
      variable = ""
      colon = index(name, ".nc:", back=.true.) + 3
      inquire (file=name, exist=exists)
      if (exists .or. colon == 3) return
      file = name(:colon - 1)
      variable = name(colon + 1:)
   end subroutine split_name

   ! ---- finding the variable and its place ---------------------------------------------------

   subroutine open_source(name, source, error)
      character(len=*), intent(in) :: name
      type(source_t), intent(out) :: source
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: file, variable
      logical :: exists
      integer :: status

      source%name = name
      call split_name(name, file, variable)
      inquire (file=file, exist=exists)
      if (.not. exists .or. len_trim(file) == 0) then
         call fail(error, name//": no such file")
         return
      end if
      call refuse_pipe(file, name, error)
      if (allocated(error)) return
      if (overstates(file)) then
         call fail(error, name//": cannot be read as netCDF: its header claims more than the file holds")
         return
      end if
      status = nf90_open(file, nf90_nowrite, source%file)
      if (status /= nf90_noerr) then
         source%file = -1
         call refuse(source, status, error)
         return
      end if
      call check_size(source, file, error)
      if (.not. allocated(error)) call find_variable(source, file, variable, error)
      if (.not. allocated(error)) call find_grid(source, error)
      if (.not. allocated(error)) call find_meaning(source)
      if (allocated(error)) call close_source(source)
   end subroutine open_source

   subroutine close_source(source)
      type(source_t), intent(inout) :: source
      integer :: status

      if (source%file /= -1) status = nf90_close(source%file)
      source%file = -1
   end subroutine close_source

   !> What the library says against it.
   subroutine refuse(source, status, error)
      type(source_t), intent(in) :: source
      integer, intent(in) :: status
      type(error_t), allocatable, intent(out) :: error

      call fail(error, source%name//": cannot be read as netCDF: "//trim(nf90_strerror(status)))
   end subroutine refuse

   !> Of a file in the classic format that ends early the library makes zeros, without a word.
   subroutine check_size(source, file, error)
      type(source_t), intent(in) :: source
      character(len=*), intent(in) :: file
      type(error_t), allocatable, intent(out) :: error
      integer :: status, form
      integer(i8) :: size

      status = nf90_inquire(source%file, formatnum=form)
      if (status /= nf90_noerr) then
         call refuse(source, status, error)
         return
      end if
      if (form == nf90_format_netcdf4 .or. form == nf90_format_netcdf4_classic) return
      inquire (file=file, size=size)
      if (size < least_size(source%file, merge(28, 32, form == nf90_format_classic))) then
         call fail(error, source%name//": ends early: truncated")
      end if
   end subroutine check_size

   !> Bytes that a file in the classic format has at least: its header, and all of its variables.
   integer(i8) function least_size(file, bytes)
      integer, intent(in) :: file
      integer, intent(in) :: bytes  !! about a variable, besides its name and dimensions
      character(len=nf90_max_name) :: name
      integer :: i, k, status, dims, variables, attributes, kind, n, ids(nf90_max_var_dims)
      integer(i8) :: values

      status = nf90_inquire(file, dims, variables, attributes)
      least_size = 32 + attributes_size(file, nf90_global, attributes)
      do i = 1, dims
         status = nf90_inquire_dimension(file, i, name=name)
         least_size = least_size + 8 + padded(len_trim(name))
      end do
      do i = 1, variables
         status = nf90_inquire_variable(file, i, name, kind, dims, ids, attributes)
         values = 1
         do k = 1, dims
            status = nf90_inquire_dimension(file, ids(k), len=n)
            values = values*n
         end do
         least_size = least_size + bytes + padded(len_trim(name)) + 4*dims + values*bytes_of(kind) &
                      + attributes_size(file, i, attributes)
      end do
   end function least_size

   !> Bytes of the attributes of a variable in the header of the classic format.
   integer(i8) function attributes_size(file, variable, attributes)
      integer, intent(in) :: file, variable, attributes
      character(len=nf90_max_name) :: name
      integer :: i, status, kind, n

      attributes_size = 0
      do i = 1, attributes
         status = nf90_inq_attname(file, variable, i, name)
         status = nf90_inquire_attribute(file, variable, trim(name), xtype=kind, len=n)
         attributes_size = attributes_size + 12 + padded(len_trim(name)) + padded(n*bytes_of(kind))
      end do
   end function attributes_size

   pure integer function padded(bytes)
      integer, intent(in) :: bytes

      padded = 4*((bytes + 3)/4)
   end function padded

   pure integer function bytes_of(kind)
      integer, intent(in) :: kind

      select case (kind)
      case (nf90_short, nf90_ushort)
         bytes_of = 2
      case (nf90_int, nf90_uint, nf90_float)
         bytes_of = 4
      case (nf90_double, nf90_int64, nf90_uint64)
         bytes_of = 8
      case default
         bytes_of = 1
      end select
   end function bytes_of

   !> The variable of that name, or the only one on (y, x).
   subroutine find_variable(source, file, name, error)
      type(source_t), intent(inout) :: source
      character(len=*), intent(in) :: file, name
      type(error_t), allocatable, intent(out) :: error
      character(len=nf90_max_name) :: found
      character(len=:), allocatable :: known
      integer :: i, n, status, rasters

      status = nf90_inquire(source%file, nvariables=n)
      if (status /= nf90_noerr) n = 0
      rasters = 0
      known = ""
      do i = 1, n
         if (.not. is_raster(source%file, i)) cycle
         status = nf90_inquire_variable(source%file, i, name=found)
         if (name /= "" .and. found /= name) then
            known = known//", "//trim(found)
         else
            rasters = rasters + 1
            source%variable = i
            known = known//", "//file//":"//trim(found)
         end if
      end do
      if (rasters == 1) then
         status = nf90_inquire_variable(source%file, source%variable, xtype=source%kind)
      else if (rasters > 1) then
         call fail(error, source%name//": has several rasters, take one of: "//known(3:))
      else if (known /= "") then
         call fail(error, source%name//": no raster "//name//"; has: "//known(3:))
      else
         call fail(error, source%name//": has no variable of numbers on (y, x) with coordinates")
      end if
   end subroutine find_variable

   !> Numbers on two dimensions, x running fastest, both with coordinates.
   logical function is_raster(file, variable)
      integer, intent(in) :: file, variable
      integer :: status, kind, dims, ids(2)

      is_raster = .false.
      status = nf90_inquire_variable(file, variable, xtype=kind, ndims=dims)
      if (status /= nf90_noerr .or. dims /= 2 .or. .not. any(kind == numbers)) return
      status = nf90_inquire_variable(file, variable, dimids=ids)
      is_raster = is_axis(file, ids(1), "x")
      if (is_raster) is_raster = is_axis(file, ids(2), "y")
   end function is_raster

   !> A dimension whose coordinate is called or marked as that of x or y.
   logical function is_axis(file, dimension, letter)
      integer, intent(in) :: file, dimension
      character(len=1), intent(in) :: letter
      character(len=:), allocatable :: name, axis, meaning
      integer :: variable

      is_axis = .false.
      variable = coordinate_of(file, dimension)
      if (variable == 0) return
      name = lower(trim(dimension_name(file, dimension)))
      axis = lower(text_attribute(file, variable, "axis"))
      meaning = text_attribute(file, variable, "standard_name")
      is_axis = name == letter .or. axis == letter &
                .or. meaning == "projection_"//letter//"_coordinate" &
                .or. meaning == trim(merge("longitude", "latitude ", letter == "x"))
   end function is_axis

   !> The variable that has the name of a dimension; 0 = none.
   integer function coordinate_of(file, dimension) result(variable)
      integer, intent(in) :: file, dimension
      integer :: status, dims, ids(1), kind

      status = nf90_inq_varid(file, trim(dimension_name(file, dimension)), variable)
      if (status == nf90_noerr) then
         status = nf90_inquire_variable(file, variable, ndims=dims, xtype=kind)
         if (dims == 1) status = nf90_inquire_variable(file, variable, dimids=ids)
         if (dims == 1 .and. any(kind == numbers)) then
            if (ids(1) == dimension) return
         end if
      end if
      variable = 0
   end function coordinate_of

   function dimension_name(file, dimension) result(name)
      integer, intent(in) :: file, dimension
      character(len=nf90_max_name) :: name
      integer :: status

      status = nf90_inquire_dimension(file, dimension, name=name)
      if (status /= nf90_noerr) name = ""
   end function dimension_name

   !> Where the cells lie, by the expressions of GDAL, so that both doors have the same bits.
   subroutine find_grid(source, error)
      type(source_t), intent(inout) :: source
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: x(:), y(:)
      real(wp) :: step
      integer :: status, ids(2)

      status = nf90_inquire_variable(source%file, source%variable, dimids=ids)
      call read_axis(source, ids(1), "x", x, error)
      if (.not. allocated(error)) call read_axis(source, ids(2), "y", y, error)
      if (allocated(error)) return
      associate (grid => source%grid)
         grid%nx = size(x)
         grid%ny = size(y)
         source%south_up = y(1) < y(grid%ny)
         if (source%south_up) y = y(grid%ny:1:-1)
         grid%cell = (x(grid%nx) - x(1))/(grid%nx - 1)
         step = (y(grid%ny) - y(1))/(grid%ny - 1)
         grid%west = x(1) - grid%cell/2
         grid%north = y(1) - step/2
         if (grid%cell <= 0.0_wp) then
            call fail(error, source%name//": is mirrored: columns run from east to west")
         else if (abs(grid%cell + step)*max(grid%nx, grid%ny) > 1.0e-6_wp*grid%cell) then
            call fail(error, source%name//": cells are not square ("//real_text(grid%cell)//" x " &
                      //real_text(-step)//" m)")
         end if
      end associate
   end subroutine find_grid

   !> The coordinates of a dimension: in metres, and regular.
   subroutine read_axis(source, dimension, letter, x, error)
      type(source_t), intent(in) :: source
      integer, intent(in) :: dimension
      character(len=1), intent(in) :: letter
      real(wp), allocatable, intent(out) :: x(:)
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: units
      integer :: i, n, variable, status
      logical :: regular

      variable = coordinate_of(source%file, dimension)
      units = lower(text_attribute(source%file, variable, "units"))
      if (index(units, "degree") == 1) then
         call fail(error, source%name//": cells are in degrees, metres are needed")
      else if (.not. any(units == [character(6) :: "", "m", "metre", "meter", "metres", &
                                   "meters"])) then
         call fail(error, source%name//": "//letter//" is in "//units//", metres are needed")
      end if
      if (allocated(error)) return

      status = nf90_inquire_dimension(source%file, dimension, len=n)
      allocate (x(n))
      status = nf90_get_var(source%file, variable, x)
      if (status /= nf90_noerr) then
         call refuse(source, status, error)
         return
      end if
      regular = n > 1 .and. .not. any(ieee_is_nan(x))
      if (regular) regular = maxval(abs(x)) < 1.0e12_wp
      if (regular) regular = abs(x(n) - x(1)) > 0.0_wp
      if (regular) then
         associate (step => (x(n) - x(1))/(n - 1))
            regular = all(abs(x - x(1) - [(i*step, i=0, n - 1)]) < 1.0e-3_wp*abs(step))
         end associate
      end if
      if (.not. regular) then
         call fail(error, source%name//": coordinate "//letter//" is not regular")
      end if
   end subroutine read_axis

   !> What marks cells without data, how numbers are packed, how the file is cut.
   subroutine find_meaning(source)
      type(source_t), intent(inout) :: source
      integer :: status, cut(2)
      logical :: whole, found

      call number_attribute(source, "_FillValue", source%fill(1), found)
      if (.not. found) call default_fill(source%kind, source%fill(1), found)
      if (found) source%fills = 1
      call number_attribute(source, "missing_value", source%fill(source%fills + 1), found)
      if (found) source%fills = source%fills + 1
      call number_attribute(source, "scale_factor", source%scale, found)
      call number_attribute(source, "add_offset", source%offset, found)

      source%rows = max(1, block/source%grid%nx)
      status = nf90_inquire_variable(source%file, source%variable, contiguous=whole, chunksizes=cut)
      if (status == nf90_noerr .and. .not. whole) then  ! unpack no piece of the file twice
         source%rows = cut(2)*max(1, source%rows/cut(2))
      end if
      source%rows = min(source%rows, source%grid%ny)
   end subroutine find_meaning

   !> What a file that says nothing means by "not written". Bytes have no such value.
   pure subroutine default_fill(kind, fill, found)
      integer, intent(in) :: kind
      real(wp), intent(inout) :: fill
      logical, intent(out) :: found

      found = .true.
      select case (kind)
      case (nf90_short)
         fill = real(nf90_fill_short, wp)
      case (nf90_ushort)
         fill = real(nf90_fill_ushort, wp)
      case (nf90_int)
         fill = real(nf90_fill_int, wp)
      case (nf90_uint)
         fill = real(nf90_fill_uint, wp)
      case (nf90_float)
         fill = real(nf90_fill_float, wp)
      case (nf90_double)
         fill = real(nf90_fill_double, wp)
      case default
         found = .false.
      end select
   end subroutine default_fill

   !> A single number; left as it is where there is none. NaN marks itself, so it is none.
   subroutine number_attribute(source, name, value, found)
      type(source_t), intent(in) :: source
      character(len=*), intent(in) :: name
      real(wp), intent(inout) :: value
      logical, intent(out) :: found
      real(wp) :: got
      integer :: status, kind, n

      status = nf90_inquire_attribute(source%file, source%variable, name, xtype=kind, len=n)
      found = status == nf90_noerr
      if (found) found = n == 1 .and. any(kind == numbers)
      if (.not. found) return
      status = nf90_get_att(source%file, source%variable, name, got)
      if (status /= nf90_noerr) got = ieee_value(got, ieee_quiet_nan)
      found = .not. ieee_is_nan(got)
      if (found) value = got
   end subroutine number_attribute

   !> A text; empty where there is none.
   function text_attribute(file, variable, name) result(text)
      integer, intent(in) :: file, variable
      character(len=*), intent(in) :: name
      character(len=:), allocatable :: text
      integer :: status, kind, n

      text = ""
      status = nf90_inquire_attribute(file, variable, name, xtype=kind, len=n)
      if (status /= nf90_noerr) return
      if (kind /= nf90_char) return
      deallocate (text)
      allocate (character(len=n) :: text)
      status = nf90_get_att(file, variable, name, text)
      if (status /= nf90_noerr) text = ""
   end function text_attribute

   ! ---- the numbers --------------------------------------------------------------------------

   !> Rows `first` to `last` counted from the north, unpacked, NaN where there are no data.
   subroutine read_rows(source, first, last, rows, error, infinite)
      type(source_t), intent(in) :: source
      integer, intent(in) :: first, last
      real(wp), allocatable, intent(inout) :: rows(:, :)
      type(error_t), allocatable, intent(out) :: error
      logical, intent(in), optional :: infinite
      logical :: may_be_infinite
      integer :: i, j, start, status

      may_be_infinite = .false.
      if (present(infinite)) may_be_infinite = infinite
      start = merge(source%grid%ny - last + 1, first, source%south_up)
      if (allocated(rows)) deallocate (rows)
      allocate (rows(source%grid%nx, last - first + 1))
      status = nf90_get_var(source%file, source%variable, rows, start=[1, start], count=shape(rows))
      if (status /= nf90_noerr) then
         call refuse(source, status, error)
         return
      end if
      do j = 1, size(rows, 2)
         call unpack_row(source, rows(:, j))
      end do
      if (source%south_up) rows = rows(:, size(rows, 2):1:-1)
      if (may_be_infinite) return
      do j = 1, size(rows, 2)
         do i = 1, size(rows, 1)
            if (ieee_is_nan(rows(i, j))) cycle
            if (abs(rows(i, j)) <= huge(1.0_wp)) cycle
            call fail(error, cell_name(source%name, i, first + j - 1)//": must be finite or nodata")
            return
         end do
      end do
   end subroutine read_rows

   pure subroutine unpack_row(source, row)
      type(source_t), intent(in) :: source
      real(wp), intent(inout) :: row(:)
      integer :: i

      do i = 1, size(row)
         if (ieee_is_nan(row(i))) cycle
         if (any(row(i) >= source%fill(:source%fills) .and. &
                 row(i) <= source%fill(:source%fills))) then
            row(i) = ieee_value(1.0_wp, ieee_quiet_nan)
         else if (is_scaled(source)) then
            row(i) = row(i)*source%scale + source%offset
         end if
      end do
   end subroutine unpack_row

   pure logical function is_scaled(source)
      type(source_t), intent(in) :: source

      is_scaled = abs(source%scale - 1.0_wp) > 0.0_wp .or. abs(source%offset) > 0.0_wp
   end function is_scaled
end module rockfall_netcdf
