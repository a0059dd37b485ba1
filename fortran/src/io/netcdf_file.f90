! SPDX-License-Identifier: BSD-3-Clause
!> netCDF-4 files: input is validated before use; output has checksums (Fletcher, by HDF5). A file is not accessed again
!> after a failure.
module rockfall_netcdf_file
   use netcdf, only: nf90_open, nf90_create, nf90_close, nf90_nowrite, nf90_netcdf4, nf90_noclobber, nf90_nofill, &
                     nf90_set_fill, nf90_noerr, nf90_edimsize, nf90_char, nf90_string, nf90_byte, nf90_int, &
                     nf90_int64, nf90_float, nf90_double, nf90_inq_varid, nf90_inq_dimid, nf90_inquire_dimension, &
                     nf90_inquire_variable, nf90_inquire_attribute, nf90_get_att, nf90_put_att, nf90_def_dim, &
                     nf90_def_var, nf90_global
   use, intrinsic :: iso_c_binding, only: c_char, c_int, c_size_t, c_ptr, c_null_char, c_f_pointer
   use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan
   use rockfall_kinds, only: wp, sp, i1, i4, i8
   use rockfall_error, only: error_t, fail
   use rockfall_text, only: max_text
   use rockfall_variables, only: piece, max_packing
   use rockfall_system, only: is_regular, remove_file, begin_reading, end_reading
   implicit none
   private
   public :: netcdf_file_t, axis_t, definition_t, open_netcdf, create_netcdf, close_netcdf
   public :: record_status, is_ok, mark_damaged, fail_damaged, check_shape, transfer, define, &
             write_rows
   public :: length_of, kind_of, text_of, integers_of, real_of

   character(len=*), parameter :: head = char(137)//"HDF"
   integer, parameter :: cache = int(2*8*piece/2**20)  !! cache of a variable [MiB]: two pieces; the default is ten

   !> Open NetCDF file.
   type :: netcdf_file_t
      character(len=:), allocatable :: name
      integer :: id = -1
      integer :: status = nf90_noerr      !! status of the library at the first failure
      logical :: writes = .false.
      integer(i8), private :: bytes = 0   !! size of a file opened for reading
      character(len=:), allocatable, private :: at, damaged  !! last variable accessed; damaged variable
   end type netcdf_file_t

   !> Dimension.
   type :: axis_t
      character(len=40) :: name = ""
      integer(i8) :: length = 0
   end type axis_t

   !> Variable. Its attributes are written, but ignored on reading.
   type :: definition_t
      character(len=40) :: name = ""
      integer :: kind = nf90_double
      character(len=80) :: units = "", long_name = "", comment = ""
   end type definition_t

   interface  ! values of any type, and NC_STRING texts, which Python writes if they are not ASCII
      integer(c_int) function c_put_values(file, variable, start, count, values) bind(c, name="nc_put_vara")
         import :: c_int, c_size_t
         integer(c_int), value :: file, variable
         integer(c_size_t), intent(in) :: start(*), count(*)
         type(*), intent(in) :: values(*)
      end function c_put_values
      integer(c_int) function c_get_values(file, variable, start, count, values) bind(c, name="nc_get_vara")
         import :: c_int, c_size_t
         integer(c_int), value :: file, variable
         integer(c_size_t), intent(in) :: start(*), count(*)
         type(*), intent(inout) :: values(*)
      end function c_get_values
      integer(c_int) function c_get_string(file, variable, name, text) bind(c, name="nc_get_att_string")
         import :: c_char, c_int, c_ptr
         integer(c_int), value :: file, variable
         character(kind=c_char), intent(in) :: name(*)
         type(c_ptr), intent(out) :: text(*)
      end function c_get_string
      integer(c_int) function c_free_string(n, text) bind(c, name="nc_free_string")
         import :: c_int, c_size_t, c_ptr
         integer(c_size_t), value :: n
         type(c_ptr), intent(inout) :: text(*)
      end function c_free_string
      pure integer(c_size_t) function c_strlen(text) bind(c, name="strlen")
         import :: c_size_t, c_ptr
         type(c_ptr), value :: text
      end function c_strlen
   end interface

contains

   !> Open a file for reading. Only netCDF-4 is accepted: the library does not validate the headers of other formats.
   subroutine open_netcdf(name, file, error)
      character(len=*), intent(in) :: name
      type(netcdf_file_t), intent(out) :: file
      type(error_t), allocatable, intent(out) :: error
      character(len=len(head)) :: begin
      logical :: exists
      integer :: unit, status

      file%name = name
      inquire (file=name, exist=exists, size=file%bytes)
      if (.not. exists) then
         call fail(error, name//": no such file")
         return
      end if
      begin = ""
      if (is_regular(name)) then
         open (newunit=unit, file=name, access="stream", form="unformatted", status="old", action="read", iostat=status)
         if (status == 0) read (unit, iostat=status) begin
         if (status == 0) close (unit)
      end if
      file%status = -1
      call begin_reading(name)
      if (begin == head) file%status = nf90_open(name, nf90_nowrite, file%id)
      if (file%status /= nf90_noerr) call fail(error, name//": cannot be read as netCDF-4")
   end subroutine open_netcdf

   !> Create a file. An existing file is removed first, so that nothing is written through a link.
   subroutine create_netcdf(name, file)
      character(len=*), intent(in) :: name
      type(netcdf_file_t), intent(out) :: file
      integer :: before
      logical :: removed

      file%name = name
      file%writes = .true.
      removed = remove_file(name)
      file%status = nf90_create(name, ior(nf90_netcdf4, nf90_noclobber), file%id)
      call record_status(file, nf90_set_fill(file%id, nf90_nofill, before))
   end subroutine create_netcdf

   subroutine close_netcdf(file)
      type(netcdf_file_t), intent(inout) :: file

      if (file%id < 0) return
      call record_status(file, nf90_close(file%id))
      call end_reading()
      file%id = -1
   end subroutine close_netcdf

   !> Record the first failure, and the variable at which it occurred.
   subroutine record_status(file, status)
      type(netcdf_file_t), intent(inout) :: file
      integer, intent(in) :: status

      if (.not. is_ok(file) .or. status == nf90_noerr) return
      file%status = status
      file%damaged = "the file"
      if (allocated(file%at)) file%damaged = file%at
   end subroutine record_status

   pure logical function is_ok(file)
      type(netcdf_file_t), intent(in) :: file

      is_ok = file%status == nf90_noerr .and. .not. allocated(file%damaged)
   end function is_ok

   !> Record an invalid value.
   subroutine mark_damaged(file, what)
      type(netcdf_file_t), intent(inout) :: file
      character(len=*), intent(in) :: what

      if (is_ok(file)) file%damaged = what
   end subroutine mark_damaged

   !> Set the error of a damaged file.
   subroutine fail_damaged(file, error)
      type(netcdf_file_t), intent(in) :: file
      type(error_t), allocatable, intent(out) :: error

      call fail(error, file%name//": is damaged: "//file%damaged)
   end subroutine fail_damaged

   ! ---- values -------------------------------------------------------------------------------

   !> Transfer a variable: write it, or read it if it exists with the same type and axis lengths (the first varies
   !> fastest) and the file is large enough to contain it. Transfers all values, or one layer along the last axis.
   subroutine transfer(file, definition, axes, values, layer)
      type(netcdf_file_t), intent(inout) :: file
      type(definition_t), intent(in) :: definition
      type(axis_t), intent(in) :: axes(:)
      type(*), intent(inout) :: values(*)  !! array of this type and size
      integer, intent(in), optional :: layer
      integer(c_size_t) :: start(size(axes)), count(size(axes))
      integer :: id, n

      n = size(axes)
      file%at = trim(definition%name)
      start = 0
      count = axes(n:1:-1)%length
      if (present(layer)) then
         start(1) = layer - 1
         count(1) = 1
      end if
      if (.not. is_ok(file)) return
      if (.not. file%writes) then
         call check_shape(file, definition, axes)
         if (is_ok(file)) call record_status(file, nf90_inq_varid(file%id, trim(definition%name), id))
         if (is_ok(file)) call record_status(file, c_get_values(file%id, id - 1, start, count, values))
      else if (all(start == 0)) then
         id = variable(file, definition, axes)
         call record_status(file, c_put_values(file%id, id - 1, start, count, values))
      else
         call record_status(file, nf90_inq_varid(file%id, trim(definition%name), id))
         call record_status(file, c_put_values(file%id, id - 1, start, count, values))
      end if
   end subroutine transfer

   !> Define a variable whose values are written later.
   subroutine define(file, definition, axes)
      type(netcdf_file_t), intent(inout) :: file
      type(definition_t), intent(in) :: definition
      type(axis_t), intent(in) :: axes(:)
      integer :: id

      file%at = trim(definition%name)
      if (is_ok(file)) id = variable(file, definition, axes)
   end subroutine define

   !> Write n rows of a one-dimensional variable, after its first `first` rows.
   subroutine write_rows(file, name, first, n, values)
      type(netcdf_file_t), intent(inout) :: file
      character(len=*), intent(in) :: name
      integer(i8), intent(in) :: first, n
      type(*), intent(in) :: values(*)
      integer :: id

      file%at = name
      if (is_ok(file)) call record_status(file, nf90_inq_varid(file%id, name, id))
      if (is_ok(file)) call record_status(file, c_put_values(file%id, id - 1, [first], [n], values))
   end subroutine write_rows

   !> Mark the file as damaged unless a variable has this type and these axes.
   subroutine check_shape(file, definition, axes)
      type(netcdf_file_t), intent(inout) :: file
      type(definition_t), intent(in) :: definition
      type(axis_t), intent(in) :: axes(:)
      integer :: id, kind, dims, dim(8), k, length

      file%at = trim(definition%name)
      if (is_ok(file)) call record_status(file, nf90_inq_varid(file%id, trim(definition%name), id))
      if (is_ok(file)) call record_status(file, nf90_inquire_variable(file%id, id, xtype=kind, ndims=dims))
      if (.not. is_ok(file)) return
      if (dims /= size(axes) .or. kind /= definition%kind) call mark_damaged(file, trim(definition%name))
      if (is_ok(file)) call record_status(file, nf90_inquire_variable(file%id, id, dimids=dim(:dims)))
      do k = 1, size(axes)
         if (.not. is_ok(file)) return
         call record_status(file, nf90_inquire_dimension(file%id, dim(k), len=length))
         if (length /= axes(k)%length) call mark_damaged(file, trim(definition%name))
      end do
      if (product(axes%length) > max_packing*file%bytes) call mark_damaged(file, trim(definition%name))
   end subroutine check_shape

   !> Define a variable with a checksum; fill value NaN, or -1 for integers.
   integer function variable(file, definition, axes) result(id)
      type(netcdf_file_t), intent(inout) :: file
      type(definition_t), intent(in) :: definition
      type(axis_t), intent(in) :: axes(:)
      integer :: dims(size(axes)), pieces(size(axes)), k
      integer(i8) :: room
      real(wp) :: nan

      room = piece
      do k = 1, size(axes)
         dims(k) = dimension(file, axes(k))
         pieces(k) = int(max(1_i8, min(axes(k)%length, room)))
         room = room/pieces(k)
      end do
      if (size(axes) == 0) then
         call record_status(file, nf90_def_var(file%id, trim(definition%name), definition%kind, id))
      else
         call record_status(file, nf90_def_var(file%id, trim(definition%name), definition%kind, dims, id, &
                                               chunksizes=pieces, fletcher32=.true., cache_size=cache))
      end if
      call record_status(file, nf90_put_att(file%id, id, "units", trim(definition%units)))
      call record_status(file, nf90_put_att(file%id, id, "long_name", trim(definition%long_name)))
      if (definition%comment /= "") &
         call record_status(file, nf90_put_att(file%id, id, "comment", trim(definition%comment)))
      nan = ieee_value(nan, ieee_quiet_nan)
      select case (definition%kind)
      case (nf90_byte); call record_status(file, nf90_put_att(file%id, id, "_FillValue", -1_i1))
      case (nf90_int); call record_status(file, nf90_put_att(file%id, id, "_FillValue", -1_i4))
      case (nf90_int64); call record_status(file, nf90_put_att(file%id, id, "_FillValue", -1_i8))
      case (nf90_float); call record_status(file, nf90_put_att(file%id, id, "_FillValue", real(nan, sp)))
      case (nf90_double); call record_status(file, nf90_put_att(file%id, id, "_FillValue", nan))
      end select
   end function variable

   !> Id of a dimension; a new dimension is defined.
   integer function dimension(file, axis) result(id)
      type(netcdf_file_t), intent(inout) :: file
      type(axis_t), intent(in) :: axis

      id = 0
      if (axis%length > huge(1)) then
         call record_status(file, nf90_edimsize)
      else if (nf90_inq_dimid(file%id, trim(axis%name), id) /= nf90_noerr) then
         call record_status(file, nf90_def_dim(file%id, trim(axis%name), int(axis%length), id))
      end if
   end function dimension

   ! ---- dimensions, types, attributes --------------------------------------------------------

   !> Length of a dimension; -1 if it does not exist.
   integer function length_of(file, name) result(length)
      type(netcdf_file_t), intent(in) :: file
      character(len=*), intent(in) :: name
      integer :: dim

      length = -1
      if (nf90_inq_dimid(file%id, name, dim) /= nf90_noerr) return
      if (nf90_inquire_dimension(file%id, dim, len=length) /= nf90_noerr) length = -1
   end function length_of

   !> Type of a variable; 0 if it does not exist.
   integer function kind_of(file, name) result(kind)
      type(netcdf_file_t), intent(in) :: file
      character(len=*), intent(in) :: name
      integer :: id

      kind = 0
      if (nf90_inq_varid(file%id, name, id) /= nf90_noerr) return
      if (nf90_inquire_variable(file%id, id, xtype=kind) /= nf90_noerr) kind = 0
   end function kind_of

   !> Text attribute of a variable, or of the file (nf90_global); "" if it does not exist.
   function text_of(file, id, name) result(text)
      type(netcdf_file_t), intent(in) :: file
      integer, intent(in) :: id
      character(len=*), intent(in) :: name
      character(len=:), allocatable :: text
      character(kind=c_char), pointer :: letter(:)
      type(c_ptr) :: string(1)
      integer :: kind, length, k

      text = ""
      if (nf90_inquire_attribute(file%id, id, name, xtype=kind, len=length) /= nf90_noerr) return
      if (kind == nf90_char .and. length <= max_text) then
         text = repeat(" ", length)
         if (nf90_get_att(file%id, id, name, text) /= nf90_noerr) text = ""
      else if (kind == nf90_string .and. length == 1) then
         if (c_get_string(file%id, id - 1, name//c_null_char, string) /= nf90_noerr) return
         call c_f_pointer(string(1), letter, [c_strlen(string(1))])
         text = repeat(" ", size(letter))
         do k = 1, size(letter)
            text(k:k) = letter(k)
         end do
         if (c_free_string(1_c_size_t, string) /= nf90_noerr) text = ""
      end if
   end function text_of

   !> Global attribute of n integers; -1 if it does not exist.
   function integers_of(file, name, n) result(values)
      type(netcdf_file_t), intent(in) :: file
      character(len=*), intent(in) :: name
      integer, intent(in) :: n
      integer(i8) :: values(n)
      integer :: kind, length

      values = -1
      if (nf90_inquire_attribute(file%id, nf90_global, name, xtype=kind, len=length) /= nf90_noerr) return
      if (length /= n .or. .not. any(kind == [nf90_int, nf90_int64])) return
      if (nf90_get_att(file%id, nf90_global, name, values) /= nf90_noerr) values = -1
   end function integers_of

   !> Global real attribute; -1 if it does not exist.
   real(wp) function real_of(file, name) result(value)
      type(netcdf_file_t), intent(in) :: file
      character(len=*), intent(in) :: name
      integer :: kind, length

      value = -1
      if (nf90_inquire_attribute(file%id, nf90_global, name, xtype=kind, len=length) /= nf90_noerr) return
      if (length /= 1 .or. kind /= nf90_double) return
      if (nf90_get_att(file%id, nf90_global, name, value) /= nf90_noerr) value = -1
   end function real_of
end module rockfall_netcdf_file
