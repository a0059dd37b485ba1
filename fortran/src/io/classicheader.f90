! SPDX-License-Identifier: BSD-3-Clause
!> The header of a classic netCDF file tells how many dimensions, attributes and variables follow. The
!> library takes memory for as many before it reads them, and dies where there is not enough; so a header
!> that claims more than its file can hold is found here first.
!>
!> The format: NetCDF Classic Format Specification, Unidata, docs.unidata.ucar.edu/netcdf-c.
module rockfall_classicheader
   use rockfall_kinds, only: i1, i8
   implicit none
   private
   public :: overstates

   integer, parameter :: bytes_of(11) = [1, 1, 2, 4, 4, 8, 1, 2, 4, 8, 8]  !! of a value, by its type

   !> A walk through the bytes of a header.
   type :: walk_t
      integer :: unit
      integer(i8) :: at = 1, last  !! next byte, last of the file
      integer :: wide, far         !! bytes of a count, and of a place in the file
      logical :: sound = .true.
   end type walk_t

contains

   !> Whether a file is classic netCDF (CDF-1, CDF-2, CDF-5) and claims more than it holds. False for a file that
   !> cannot be read, or is of another format.
   logical function overstates(file)
      character(len=*), intent(in) :: file
      type(walk_t) :: walk
      character(len=4) :: magic
      integer(i8) :: k, n
      integer :: version, status

      overstates = .false.
      open (newunit=walk%unit, file=file, access="stream", form="unformatted", status="old", action="read", &
            iostat=status)
      if (status /= 0) return
      inquire (unit=walk%unit, size=walk%last)
      read (walk%unit, iostat=status) magic
      version = iachar(magic(4:4))
      if (status == 0 .and. magic(1:3) == "CDF" .and. any(version == [1, 2, 5])) then
         walk%wide = merge(8, 4, version == 5)
         walk%far = merge(4, 8, version == 1)
         call skip(walk, 4_i8 + walk%wide)  ! the number of records
         n = count_of(walk)
         do k = 1, n
            call skip_name(walk)
            call skip(walk, int(walk%wide, i8))
            if (.not. walk%sound) exit
         end do
         call skip_attributes(walk)
         n = count_of(walk)
         do k = 1, n
            call skip_variable(walk)
            if (.not. walk%sound) exit
         end do
         overstates = .not. walk%sound
      end if
      close (walk%unit)
   end function overstates

   !> Name, dimensions, attributes, type, size and place of a variable.
   subroutine skip_variable(walk)
      type(walk_t), intent(inout) :: walk
      integer(i8) :: n

      call skip_name(walk)
      n = number(walk, walk%wide)
      call skip(walk, n*walk%wide)
      call skip_attributes(walk)
      call skip(walk, 4_i8 + walk%wide + walk%far)
   end subroutine skip_variable

   subroutine skip_attributes(walk)
      type(walk_t), intent(inout) :: walk
      integer(i8) :: k, n, values
      integer(i8) :: kind

      n = count_of(walk)
      do k = 1, n
         call skip_name(walk)
         kind = number(walk, 4)
         values = number(walk, walk%wide)
         if (kind < 1 .or. kind > size(bytes_of)) walk%sound = .false.
         if (.not. walk%sound) exit
         call skip_padded(walk, values*bytes_of(kind))
      end do
   end subroutine skip_attributes

   subroutine skip_name(walk)
      type(walk_t), intent(inout) :: walk

      call skip_padded(walk, number(walk, walk%wide))
   end subroutine skip_name

   !> The number of entries of a list, after its tag.
   integer(i8) function count_of(walk)
      type(walk_t), intent(inout) :: walk

      call skip(walk, 4_i8)
      count_of = number(walk, walk%wide)
   end function count_of

   !> A number of what follows, each of a byte at least: never more than are left. 0 when it says so.
   integer(i8) function number(walk, width)
      type(walk_t), intent(inout) :: walk
      integer, intent(in) :: width  !! bytes, most significant first
      integer(i1) :: bytes(8)
      integer :: k, status

      number = 0
      if (.not. walk%sound) return
      read (walk%unit, pos=walk%at, iostat=status) bytes(:width)
      if (status == 0) then
         do k = 1, width
            number = ior(shiftl(number, 8), iand(int(bytes(k), i8), 255_i8))
         end do
      end if
      call skip(walk, int(width, i8))
      if (status /= 0 .or. number < 0 .or. number > walk%last - walk%at + 1) walk%sound = .false.
      if (.not. walk%sound) number = 0
   end function number

   !> Skip bytes, which are filled up to a multiple of four.
   subroutine skip_padded(walk, n)
      type(walk_t), intent(inout) :: walk
      integer(i8), intent(in) :: n

      call skip(walk, (n + 3)/4*4)
   end subroutine skip_padded

   subroutine skip(walk, n)
      type(walk_t), intent(inout) :: walk
      integer(i8), intent(in) :: n

      walk%at = walk%at + n
      if (walk%at > walk%last + 1) walk%sound = .false.
   end subroutine skip
end module rockfall_classicheader
