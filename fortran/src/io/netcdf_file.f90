! SPDX-License-Identifier: BSD-3-Clause
!> netCDF-4 files: what is read is checked before it is used, what is written carries checksums (Fletcher, by HDF5).
!> After the first failure nothing more is asked of a file.
module rockfall_netcdf_file
   use netcdf, only: nf90_open, nf90_create, nf90_close, nf90_nowrite, nf90_netcdf4, nf90_clobber, nf90_nofill, &
                     nf90_set_fill, nf90_noerr, nf90_edimsize, nf90_global, nf90_char, nf90_byte, &
                     nf90_int, nf90_int64, nf90_float, nf90_double, nf90_inq_varid, nf90_inq_dimid, &
                     nf90_inquire_dimension, nf90_inquire_variable, nf90_inquire_attribute, nf90_get_att, nf90_put_att, &
                     nf90_def_dim, nf90_def_var
   use netcdf, only: nf90_string
   use, intrinsic :: iso_c_binding, only: c_char, c_int, c_size_t, c_ptr, c_null_char, c_f_pointer
   use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan
   use rockfall_kinds, only: wp, sp, i1, i4, i8
   use rockfall_error, only: error_t, fail
   use rockfall_filesystem, only: is_pipe
   use rockfall_interrupts, only: begin_reading, end_reading
   implicit none
   private
   public :: netcdf_file_t, open_netcdf, create_netcdf, close_netcdf, keep, sound, mark_damaged, fail_damaged
   public :: length_of, expected, kind_of, text_of, integer_of, integers_of, real_of
   public :: dimension, variable, note

   integer(i8), parameter :: piece = 2_i8**17       !! values that share a checksum
   integer(i8), parameter :: max_packing = 1100     !! zlib packs no closer than this
   integer, parameter :: max_text = 64*1024**2      !! [bytes]
   character(len=*), parameter :: head = char(137)//"HDF"

   !> An open file.
   type :: netcdf_file_t
      character(len=:), allocatable :: name
      integer :: id = -1
      integer :: status = nf90_noerr             !! of the library, at the first failure
      integer(i8), private :: bytes = 0          !! of the file
      character(len=:), allocatable, private :: at, damaged  !! the variable looked at last; that which is damaged
   end type netcdf_file_t

   interface  ! netCDF-Fortran has no texts of NC_STRING, which Python writes where a letter is not ASCII
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

   !> Open a file to read from it. Only netCDF-4 is: the library would believe the header of any other.
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
      if (.not. is_pipe(name)) then
         open (newunit=unit, file=name, access="stream", form="unformatted", status="old", action="read", iostat=status)
         if (status == 0) read (unit, iostat=status) begin
         if (status == 0) close (unit)
      end if
      file%status = -1
      call begin_reading(name)
      if (begin == head) file%status = nf90_open(name, nf90_nowrite, file%id)
      if (file%status /= nf90_noerr) call fail(error, name//": cannot be read as netCDF-4")
   end subroutine open_netcdf

   !> Begin a new file, over one that may be there.
   subroutine create_netcdf(name, file)
      character(len=*), intent(in) :: name
      type(netcdf_file_t), intent(out) :: file
      integer :: before

      file%name = name
      file%status = nf90_create(name, ior(nf90_netcdf4, nf90_clobber), file%id)
      call keep(file, nf90_set_fill(file%id, nf90_nofill, before))
   end subroutine create_netcdf

   subroutine close_netcdf(file)
      type(netcdf_file_t), intent(inout) :: file

      if (file%id < 0) return
      call keep(file, nf90_close(file%id))
      call end_reading()
      file%id = -1
   end subroutine close_netcdf

   !> Keep the first failure, and the variable at which it came.
   subroutine keep(file, status)
      type(netcdf_file_t), intent(inout) :: file
      integer, intent(in) :: status

      if (.not. sound(file) .or. status == nf90_noerr) return
      file%status = status
      file%damaged = "the file"
      if (allocated(file%at)) file%damaged = file%at
   end subroutine keep

   pure logical function sound(file)
      type(netcdf_file_t), intent(in) :: file

      sound = file%status == nf90_noerr .and. .not. allocated(file%damaged)
   end function sound

   !> Something in it cannot be.
   subroutine mark_damaged(file, what)
      type(netcdf_file_t), intent(inout) :: file
      character(len=*), intent(in) :: what

      if (sound(file)) file%damaged = what
   end subroutine mark_damaged

   !> The error of a file that is not sound.
   subroutine fail_damaged(file, error)
      type(netcdf_file_t), intent(in) :: file
      type(error_t), allocatable, intent(out) :: error

      call fail(error, file%name//": is damaged: "//file%damaged)
   end subroutine fail_damaged

   ! ---- what there is ------------------------------------------------------------------------

   !> The length of a dimension; -1 if there is none of that name.
   integer function length_of(file, name) result(length)
      type(netcdf_file_t), intent(in) :: file
      character(len=*), intent(in) :: name
      integer :: dim

      length = -1
      if (nf90_inq_dimid(file%id, name, dim) /= nf90_noerr) return
      if (nf90_inquire_dimension(file%id, dim, len=length) /= nf90_noerr) length = -1
   end function length_of

   !> The type of a variable; 0 if there is none of that name.
   integer function kind_of(file, name) result(kind)
      type(netcdf_file_t), intent(in) :: file
      character(len=*), intent(in) :: name
      integer :: id

      kind = 0
      if (nf90_inq_varid(file%id, name, id) /= nf90_noerr) return
      if (nf90_inquire_variable(file%id, id, xtype=kind) /= nf90_noerr) kind = 0
   end function kind_of

   !> The number of a variable that must be there, of a type and along dimensions of these lengths (the first runs
   !> fastest), in a file long enough to hold it; the file is not sound any more where it is not.
   integer function expected(file, name, kind, lengths) result(id)
      type(netcdf_file_t), intent(inout) :: file
      character(len=*), intent(in) :: name
      integer, intent(in) :: kind, lengths(:)
      integer :: found, dims, dim(8), k, length

      file%at = name
      id = -1
      if (.not. sound(file)) return
      call keep(file, nf90_inq_varid(file%id, name, id))
      if (sound(file)) call keep(file, nf90_inquire_variable(file%id, id, ndims=dims))
      if (.not. sound(file)) return
      if (dims /= size(lengths)) call mark_damaged(file, name)
      if (sound(file)) call keep(file, nf90_inquire_variable(file%id, id, xtype=found, dimids=dim(:dims)))
      if (sound(file) .and. found /= kind) call mark_damaged(file, name)
      do k = 1, size(lengths)
         if (.not. sound(file)) exit
         call keep(file, nf90_inquire_dimension(file%id, dim(k), len=length))
         if (length /= lengths(k)) call mark_damaged(file, name)
      end do
      if (product(int(lengths, i8)) > max_packing*file%bytes) call mark_damaged(file, name)
      if (.not. sound(file)) id = -1
   end function expected

   !> A text attribute; "" if there is none.
   function text_of(file, id, name) result(text)
      type(netcdf_file_t), intent(in) :: file
      integer, intent(in) :: id  !! of a variable, or nf90_global
      character(len=*), intent(in) :: name
      character(len=:), allocatable :: text
      integer :: kind, length

      text = ""
      if (nf90_inquire_attribute(file%id, id, name, xtype=kind, len=length) /= nf90_noerr) return
      if (kind == nf90_char .and. length <= max_text) then
         text = repeat(" ", length)
         if (nf90_get_att(file%id, id, name, text) /= nf90_noerr) text = ""
      else if (kind == nf90_string .and. length == 1) then
         text = string_of(file, id, name)
      end if
   end function text_of

   function string_of(file, id, name) result(text)
      type(netcdf_file_t), intent(in) :: file
      integer, intent(in) :: id
      character(len=*), intent(in) :: name
      character(len=:), allocatable :: text
      character(kind=c_char), pointer :: letter(:)
      type(c_ptr) :: found(1)
      integer :: k, status

      text = ""
      if (c_get_string(file%id, id - 1, name//c_null_char, found) /= nf90_noerr) return
      call c_f_pointer(found(1), letter, [c_strlen(found(1))])
      text = repeat(" ", size(letter))
      do k = 1, size(letter)
         text(k:k) = letter(k)
      end do
      status = c_free_string(1_c_size_t, found)
   end function string_of

   !> A global attribute that is an integer; -1 if there is none.
   integer(i8) function integer_of(file, name) result(value)
      type(netcdf_file_t), intent(in) :: file
      character(len=*), intent(in) :: name
      integer(i8) :: values(1)

      values = integers_of(file, name, 1)
      value = values(1)
   end function integer_of

   !> One of n integers; -1 if there is none.
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

   !> A global attribute that is a real; -1 if there is none.
   real(wp) function real_of(file, name) result(value)
      type(netcdf_file_t), intent(in) :: file
      character(len=*), intent(in) :: name
      integer :: kind, length

      value = -1
      if (nf90_inquire_attribute(file%id, nf90_global, name, xtype=kind, len=length) /= nf90_noerr) return
      if (length /= 1 .or. kind /= nf90_double) return
      if (nf90_get_att(file%id, nf90_global, name, value) /= nf90_noerr) value = -1
   end function real_of

   ! ---- what is to be ------------------------------------------------------------------------

   integer function dimension(file, name, length) result(id)
      type(netcdf_file_t), intent(inout) :: file
      character(len=*), intent(in) :: name
      integer(i8), intent(in) :: length

      id = 0
      if (length > huge(1)) then
         call keep(file, nf90_edimsize)
      else
         call keep(file, nf90_def_dim(file%id, name, int(length), id))
      end if
   end function dimension

   !> A variable with a checksum, units and a long name; NaN stands for a missing value, or -1 among integers.
   integer function variable(file, name, kind, dims, units, long_name, comment) result(id)
      type(netcdf_file_t), intent(inout) :: file
      character(len=*), intent(in) :: name, units, long_name, comment
      integer, intent(in) :: kind, dims(:)
      integer :: pieces(size(dims)), k, length
      integer(i8) :: room

      id = 0
      room = piece
      do k = 1, size(dims)
         call keep(file, nf90_inquire_dimension(file%id, dims(k), len=length))
         pieces(k) = int(max(1_i8, min(int(length, i8), room)))
         room = room/pieces(k)
      end do
      if (size(dims) == 0) then
         call keep(file, nf90_def_var(file%id, name, kind, id))
      else
         call keep(file, nf90_def_var(file%id, name, kind, dims, id, chunksizes=pieces, fletcher32=.true.))
      end if
      call note(file, id, "units", units)
      call note(file, id, "long_name", long_name)
      if (comment /= "") call note(file, id, "comment", comment)
      call set_fill(file, id, kind)
   end function variable

   subroutine set_fill(file, id, kind)
      type(netcdf_file_t), intent(inout) :: file
      integer, intent(in) :: id, kind
      real(wp) :: nan

      nan = ieee_value(nan, ieee_quiet_nan)
      select case (kind)
      case (nf90_byte); call keep(file, nf90_put_att(file%id, id, "_FillValue", -1_i1))
      case (nf90_int); call keep(file, nf90_put_att(file%id, id, "_FillValue", -1_i4))
      case (nf90_int64); call keep(file, nf90_put_att(file%id, id, "_FillValue", -1_i8))
      case (nf90_float); call keep(file, nf90_put_att(file%id, id, "_FillValue", real(nan, sp)))
      case (nf90_double); call keep(file, nf90_put_att(file%id, id, "_FillValue", nan))
      end select
   end subroutine set_fill

   subroutine note(file, id, name, text)
      type(netcdf_file_t), intent(inout) :: file
      integer, intent(in) :: id
      character(len=*), intent(in) :: name, text

      call keep(file, nf90_put_att(file%id, id, name, text))
   end subroutine note
end module rockfall_netcdf_file
