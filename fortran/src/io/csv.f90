! SPDX-License-Identifier: BSD-3-Clause
!> The table of zones: radii of the surface material for each zone id, from comma-separated text.
module rockfall_csv
   use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan, ieee_positive_inf
   use rockfall_kinds, only: wp, i2, i4, i8
   use rockfall_error, only: error_t, fail
   use rockfall_decimal, only: parse_real, parse_integer, decimal_ok
   use rockfall_text_file, only: read_text
   use rockfall_text, only: check_text, after_mark, lower, integer_text, excerpt
   implicit none
   private
   public :: read_zone_table, parse_zone_table, radius_names

   !> The columns of lengths, in the order of `radii(:, i)`.
   character(len=11), parameter :: radius_names(4) = &
                                   [character(11) :: "mean_radius", "rg70", "rg20", "rg10"]
   character(len=*), parameter :: blanks = " "//achar(9)//achar(13)  !! within a line
   integer, parameter :: most_columns = 1000
   integer, parameter :: most_zones = huge(1_i2)  !! a cell holds its row in the table as i2

   type :: cell_t
      character(len=:), allocatable :: text  !! without the blanks and quotes round it
   end type cell_t

   !> Where the reader stands.
   type :: cursor_t
      integer :: pos = 1, line = 1
      character(len=1) :: separator = ","
   end type cursor_t

contains

   !> Zones of `file`: their ids, and radii(4, zones) [m], NaN where the table has no such column.
   subroutine read_zone_table(file, ids, radii, error)
      character(len=*), intent(in) :: file
      integer(i4), allocatable, intent(out) :: ids(:)
      real(wp), allocatable, intent(out) :: radii(:, :)
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: text

      call read_text(file, text, error)
      if (allocated(error)) return
      call parse_zone_table(text, file, ids, radii, error)
   end subroutine read_zone_table

   !> The same from text in memory; `file` is for messages.
   pure subroutine parse_zone_table(text, file, ids, radii, error)
      character(len=*), intent(in) :: text, file
      integer(i4), allocatable, intent(out) :: ids(:)
      real(wp), allocatable, intent(out) :: radii(:, :)
      type(error_t), allocatable, intent(out) :: error
      type(cell_t), allocatable :: row(:)
      type(cursor_t) :: at
      character(len=:), allocatable :: where
      integer :: columns, column(0:4), n

      call check_text(text, file, error)
      if (allocated(error)) return
      at%pos = after_mark(text)
      at%separator = separator_of(text(at%pos:))
      call next_row(text, file, at, row, where, error)
      if (allocated(error)) return
      call find_columns(row, file, where, column, error)
      if (allocated(error)) return
      columns = size(row)

      allocate (ids(most_zones), radii(4, most_zones))
      n = 0
      do
         call next_row(text, file, at, row, where, error)
         if (allocated(error)) return
         if (size(row) == 0) exit
         if (size(row) /= columns) then
            call fail(error, where//integer_text(size(row))//" columns, the header has " &
                      //integer_text(columns))
         else if (n == most_zones) then
            call fail(error, where//"more than "//integer_text(most_zones)//" zones")
         else
            n = n + 1
            call take_zone(row, column, where, ids(:n), radii(:, n), error)
         end if
         if (allocated(error)) return
      end do
      ids = ids(:n)
      radii = radii(:, :n)
      if (n == 0) call fail(error, file//": no zones below the header")
   end subroutine parse_zone_table

   !> Which column holds the zone (0) and the radii (1 to 4); 0 = none.
   pure subroutine find_columns(header, file, where, column, error)
      type(cell_t), intent(in) :: header(:)
      character(len=*), intent(in) :: file, where
      integer, intent(out) :: column(0:4)
      type(error_t), allocatable, intent(out) :: error
      character(len=11), parameter :: names(0:4) = [character(11) :: "zone", radius_names]
      character(len=:), allocatable :: found
      integer :: i, k

      column = 0
      if (size(header) == 0) then
         call fail(error, file//": is empty")
         return
      end if
      found = ""
      do i = 1, size(header)
         found = found//", "//header(i)%text
         do k = 0, 4
            if (lower(header(i)%text) /= names(k)) cycle
            if (column(k) > 0) then
               call fail(error, where//"column "//trim(names(k))//": is there twice")
               return
            end if
            column(k) = i
         end do
      end do
      if (column(0) == 0) then
         call fail(error, where//"no column zone; has: "//excerpt(found(3:)))
      else if (all(column(1:) == 0)) then
         call fail(error, where//"none of the columns mean_radius, rg70, rg20, rg10")
      end if
   end subroutine find_columns

   !> The last of `ids` and its radii.
   pure subroutine take_zone(row, column, where, ids, radii, error)
      type(cell_t), intent(in) :: row(:)
      integer, intent(in) :: column(0:4)
      character(len=*), intent(in) :: where
      integer(i4), intent(inout) :: ids(:)
      real(wp), intent(out) :: radii(4)
      type(error_t), allocatable, intent(out) :: error
      integer(i8) :: zone
      integer :: k, n, status

      radii = ieee_value(1.0_wp, ieee_quiet_nan)
      call parse_integer(row(column(0))%text, zone, status)
      if (status /= decimal_ok) then
         call fail(error, where//"zone = "//excerpt(row(column(0))%text)//": must be an integer")
         return
      else if (abs(zone) > huge(1_i4)) then
         call fail(error, where//"zone = "//excerpt(row(column(0))%text)//": must fit in 32 bits")
         return
      end if
      n = size(ids)
      ids(n) = int(zone, i4)
      if (any(ids(:n - 1) == ids(n))) then
         call fail(error, where//"zone "//integer_text(ids(n))//": is in the table twice")
         return
      end if
      do k = 1, 4
         if (column(k) == 0) cycle
         call take_radius(row(column(k))%text, where//trim(radius_names(k)), radii(k), error)
         if (allocated(error)) return
      end do
   end subroutine take_zone

   !> A positive length [m]; `Inf` absorbs.
   pure subroutine take_radius(text, what, radius, error)
      character(len=*), intent(in) :: text, what
      real(wp), intent(out) :: radius
      type(error_t), allocatable, intent(out) :: error
      integer :: status

      radius = 0.0_wp
      select case (lower(text))
      case ("inf", "+inf", "infinity", "+infinity")
         radius = ieee_value(1.0_wp, ieee_positive_inf)
         return
      case ("nan", "-inf", "-infinity")
         status = decimal_ok
      case default
         call parse_real(text, radius, status)
      end select
      if (status /= decimal_ok) then
         call fail(error, what//" = "//excerpt(text)//": must be a number")
      else if (radius <= 0.0_wp) then
         call fail(error, what//" = "//excerpt(text)//": must be > 0 (Inf absorbs)")
      end if
   end subroutine take_radius

   !> The semicolon if the first line has more of them than commas.
   pure function separator_of(text) result(separator)
      character(len=*), intent(in) :: text
      character(len=1) :: separator
      integer :: i, excess

      excess = 0
      do i = 1, len(text)
         if (text(i:i) == achar(10)) exit
         if (text(i:i) == ";") excess = excess + 1
         if (text(i:i) == ",") excess = excess - 1
      end do
      separator = merge(";", ",", excess > 0)
   end function separator_of

   !> The cells of the next line that is not blank; none at the end. `where` begins messages.
   pure subroutine next_row(text, file, at, row, where, error)
      character(len=*), intent(in) :: text, file
      type(cursor_t), intent(inout) :: at
      type(cell_t), allocatable, intent(out) :: row(:)
      character(len=:), allocatable, intent(out) :: where
      type(error_t), allocatable, intent(out) :: error
      type(cell_t), allocatable :: cells(:)
      logical :: last, blank
      integer :: n

      allocate (cells(most_columns))
      do
         where = file//": line "//integer_text(at%line)//": "
         n = 0
         if (at%pos > len(text)) exit
         blank = .true.
         last = .false.
         do while (.not. last)
            if (n == most_columns) then
               call fail(error, where//"more than "//integer_text(most_columns)//" columns")
               return
            end if
            n = n + 1
            call next_cell(text, at, where, cells(n)%text, last, error)
            if (allocated(error)) return
            blank = blank .and. len(cells(n)%text) == 0
         end do
         if (.not. blank) exit
      end do
      row = cells(:n)
   end subroutine next_row

   !> One cell and what ends it; `last` of its line or not. Quoted cells may hold line ends.
   pure subroutine next_cell(text, at, where, cell, last, error)
      character(len=*), intent(in) :: text, where
      type(cursor_t), intent(inout) :: at
      character(len=:), allocatable, intent(out) :: cell
      logical, intent(out) :: last
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: rest
      integer :: length

      last = .true.
      length = verify(text(at%pos:), blanks) - 1
      if (length > 0) at%pos = at%pos + length
      if (at%pos <= len(text)) then
         if (text(at%pos:at%pos) == """") call quoted_cell(text, at, where, cell, error)
         if (allocated(error)) return
      end if

      length = scan(text(at%pos:), at%separator//achar(10)) - 1
      if (length < 0) length = len(text) - at%pos + 1
      rest = stripped(text(at%pos:at%pos + length - 1))
      at%pos = at%pos + length + 1
      if (at%pos - 1 <= len(text)) last = text(at%pos - 1:at%pos - 1) == achar(10)
      if (last) at%line = at%line + 1
      if (.not. allocated(cell)) then
         cell = rest
      else if (len(rest) > 0) then
         call fail(error, where//"a "//at%separator//" is due after a quoted text, before " &
                   //excerpt(rest))
      end if
   end subroutine next_cell

   !> Text in double quotes, a doubled one stands for itself; the cursor moves behind it.
   pure subroutine quoted_cell(text, at, where, cell, error)
      character(len=*), intent(in) :: text, where
      type(cursor_t), intent(inout) :: at
      character(len=:), allocatable, intent(out) :: cell
      type(error_t), allocatable, intent(out) :: error
      integer :: i, n

      allocate (character(len=len(text) - at%pos) :: cell)
      n = 0
      i = at%pos + 1
      do
         if (i > len(text)) then
            call fail(error, where//"text without its closing quote")
            return
         end if
         if (text(i:i) == """") then
            i = i + 1
            if (i > len(text)) exit
            if (text(i:i) /= """") exit
         end if
         if (text(i:i) == achar(10)) at%line = at%line + 1
         n = n + 1
         cell(n:n) = text(i:i)
         i = i + 1
      end do
      cell = stripped(cell(:n))
      at%pos = i
   end subroutine quoted_cell

   !> Text without the blanks round it.
   pure function stripped(text)
      character(len=*), intent(in) :: text
      character(len=:), allocatable :: stripped

      stripped = text(max(1, verify(text, blanks)):verify(text, blanks, back=.true.))
   end function stripped
end module rockfall_csv
