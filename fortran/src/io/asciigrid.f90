! SPDX-License-Identifier: BSD-3-Clause
!> ESRI ASCII grids: read strictly, written so that every number reads back the same.
module rockfall_asciigrid
   use, intrinsic :: ieee_arithmetic, only: ieee_is_nan, ieee_value, ieee_quiet_nan, &
                                            ieee_positive_inf
   use rockfall_kinds, only: wp, i4, i8
   use rockfall_error, only: error_t, fail, our_fault
   use rockfall_decimal, only: parse_real, parse_integer, real_text, decimal_ok
   use rockfall_text_file, only: read_text
   use rockfall_text, only: lower, integer_text, excerpt
   use rockfall_grid, only: grid_t
   use rockfall_cells, only: no_id, whole_numbers, cell_name
   use rockfall_words, only: words_t, open_words, next_word, close_words, bytes_left
   use rockfall_wholefile, only: whole_file_t, create_file, put, complete_file, discard_file
   implicit none
   private
   public :: read_ascii_grid, write_ascii_grid, no_id

   integer, parameter :: longest_number = 4096           !! [characters]
   real(wp), parameter :: nodata = -9999.0_wp            !! as written
   character(len=*), parameter :: nodata_text = "-9999"
   character(len=1), parameter :: line_end = achar(10)
   real(wp), parameter :: farthest = 1.0e12_wp           !! coordinate that is still a place [m]

   character(len=12), parameter :: keys(10) = [character(12) :: "ncols", "nrows", "xllcorner", &
      "yllcorner", "xllcenter", "yllcenter", "cellsize", "dx", "dy", "nodata_value"]
   integer, parameter :: ncols = 1, nrows = 2, xcorner = 3, ycorner = 4, xcenter = 5, ycenter = 6, &
                         cellsize = 7, dx = 8, dy = 9, nodata_value = 10

   !> What the file says before its numbers.
   type :: header_t
      logical :: given(size(keys)) = .false.
      real(wp) :: value(size(keys)) = 0.0_wp
      real(wp) :: nodata = -9999.0_wp    !! what the format means when it does not say
      logical :: nodata_is_nan = .false.
   end type header_t

   !> read_ascii_grid(file, values, grid, error [, infinite]): values(nx, ny), row 1 northernmost.
   !> Where there are no data: NaN in a real raster, `no_id` in an integer one.
   interface read_ascii_grid
      module procedure read_real, read_integer
   end interface read_ascii_grid

   !> write_ascii_grid(file, values, grid, error): NaN or `no_id` are written as -9999.
   !> The file appears when it is whole; after an error nothing is left of it.
   interface write_ascii_grid
      module procedure write_real, write_integer
   end interface write_ascii_grid

contains

   subroutine read_real(file, values, grid, error, infinite)
      character(len=*), intent(in) :: file
      real(wp), allocatable, intent(out) :: values(:, :)
      type(grid_t), intent(out) :: grid
      type(error_t), allocatable, intent(out) :: error
      logical, intent(in), optional :: infinite  !! whether Inf is a value; .false. unless given
      type(words_t) :: words
      type(header_t) :: header
      logical :: may_be_infinite
      integer :: j, status

      may_be_infinite = .false.
      if (present(infinite)) may_be_infinite = infinite
      call open_grid(file, words, header, grid, error)
      if (allocated(error)) return
      allocate (values(grid%nx, grid%ny), stat=status)
      if (status /= 0) call no_memory(file, grid, error)
      do j = 1, grid%ny
         if (allocated(error)) exit
         call read_row(words, header, grid, j, may_be_infinite, values(:, j), error)
      end do
      call close_grid(words, grid, error)
   end subroutine read_real

   subroutine read_integer(file, values, grid, error)
      character(len=*), intent(in) :: file
      integer(i4), allocatable, intent(out) :: values(:, :)
      type(grid_t), intent(out) :: grid
      type(error_t), allocatable, intent(out) :: error
      type(words_t) :: words
      type(header_t) :: header
      real(wp), allocatable :: row(:, :)
      integer :: j, status

      call open_grid(file, words, header, grid, error)
      if (allocated(error)) return
      allocate (values(grid%nx, grid%ny), row(grid%nx, 1), stat=status)
      if (status /= 0) call no_memory(file, grid, error)
      do j = 1, grid%ny
         if (allocated(error)) exit
         call read_row(words, header, grid, j, .false., row(:, 1), error)
         if (.not. allocated(error)) call whole_numbers(file, j, row, values(:, j:j), error)
      end do
      call close_grid(words, grid, error)
   end subroutine read_integer

   !> Open a file and read its header; the current word is then the first number.
   subroutine open_grid(file, words, header, grid, error)
      character(len=*), intent(in) :: file
      type(words_t), intent(out) :: words
      type(header_t), intent(out) :: header
      type(grid_t), intent(out) :: grid
      type(error_t), allocatable, intent(out) :: error

      call open_words(file, words, error)
      if (allocated(error)) return
      call check_metres(file, error)
      if (.not. allocated(error)) call read_header(words, header, error)
      if (.not. allocated(error)) call check_header(file, header, error)
      if (.not. allocated(error)) then
         grid = grid_of(header)
         if (2*int(grid%nx, i8)*grid%ny > bytes_left(words) + 1) then
            call fail(error, file//": too short for "//due(grid)//" numbers: truncated or damaged")
         end if
      end if
      if (allocated(error)) call close_words(words)
   end subroutine open_grid

   !> The grid itself does not tell its unit, but a .prj file beside it may.
   subroutine check_metres(file, error)
      character(len=*), intent(in) :: file
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: text, prj
      type(error_t), allocatable :: none
      integer :: point

      point = index(file, ".", back=.true.)
      if (point <= index(file, "/", back=.true.) + 1) point = len(file) + 1
      prj = file(:point - 1)//".prj"
      call read_text(prj, text, none)
      if (allocated(none)) return
      if (index(adjustl(text), "GEOG") == 1) then
         call fail(error, file//": cells are in degrees ("//prj//"), metres are needed")
      end if
   end subroutine check_metres

   !> No number must follow.
   subroutine close_grid(words, grid, error)
      type(words_t), intent(inout) :: words
      type(grid_t), intent(in) :: grid
      type(error_t), allocatable, intent(inout) :: error

      if (.not. allocated(error)) then
         if (words%first <= words%last) then
            call fail(error, words%file//": line "//integer_text(words%line)//": more than " &
                      //due(grid)//" numbers")
         end if
      end if
      call close_words(words)
   end subroutine close_grid

   subroutine no_memory(file, grid, error)
      character(len=*), intent(in) :: file
      type(grid_t), intent(in) :: grid
      type(error_t), allocatable, intent(out) :: error

      call fail(error, file//": no memory for "//due(grid)//" numbers")
   end subroutine no_memory

   ! ---- the header ---------------------------------------------------------------------------

   !> Pairs of key and value, up to the first number.
   subroutine read_header(words, header, error)
      type(words_t), intent(inout) :: words
      type(header_t), intent(out) :: header
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: word, where
      integer :: key

      do
         call next_word(words, error)
         if (allocated(error)) return
         word = current_word(words)
         if (begins_number(word)) exit
         key = key_of(word)
         where = words%file//": line "//integer_text(words%line)//": "
         if (key == 0 .and. .not. any(header%given)) then
            exit
         else if (len(word) == 0) then
            call fail(error, words%file//": ends within its header: truncated")
         else if (key == 0) then
            call fail(error, where//"'"//printable(word)//"': unknown in the header; known: " &
                      //"ncols, nrows, xllcorner, yllcorner, xllcenter, yllcenter, cellsize, " &
                      //"dx, dy, NODATA_value")
         else if (header%given(key)) then
            call fail(error, where//trim(keys(key))//": given twice in the header")
         end if
         if (allocated(error)) return
         header%given(key) = .true.
         call next_word(words, error)
         if (.not. allocated(error)) call read_value(current_word(words), where, key, header, error)
         if (allocated(error)) return
      end do
      if (.not. any(header%given)) then
         call fail(error, words%file//": no ESRI ASCII grid: those begin with ncols, nrows, ...")
      end if
   end subroutine read_header

   !> As much of the current word as matters.
   pure function current_word(words) result(word)
      type(words_t), intent(in) :: words
      character(len=:), allocatable :: word

      word = words%buffer(words%first:min(words%last, words%first + longest_number))
   end function current_word

   !> Numbers of the raster begin so; keys do not. The end of the file is none of both.
   pure logical function begins_number(word)
      character(len=*), intent(in) :: word

      begins_number = .false.
      if (len(word) == 0) return
      begins_number = scan(word(1:1), "+-.0123456789") == 1 &
                      .or. any(lower(word) == [character(8) :: "nan", "inf", "infinity"])
   end function begins_number

   !> Which of `keys` a word is; 0 = none.
   pure integer function key_of(word)
      character(len=*), intent(in) :: word

      key_of = 0
      if (len(word) > len(keys) .or. len(word) == 0) return
      do key_of = size(keys), 1, -1
         if (lower(word) == keys(key_of)) return
      end do
   end function key_of

   !> The value of a key; `where` begins messages.
   pure subroutine read_value(word, where, key, header, error)
      character(len=*), intent(in) :: word, where
      integer, intent(in) :: key
      type(header_t), intent(inout) :: header
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: rule
      real(wp) :: value
      integer(i8) :: whole
      integer :: status

      select case (key)
      case (ncols, nrows)
         rule = "must be an integer > 0"
         call parse_integer(word, whole, status)
         if (whole < 1 .or. whole > huge(1)) status = -1
         value = real(whole, wp)
      case (nodata_value)
         rule = "must be a number or nan"
         header%nodata_is_nan = is_nan(word)
         if (header%nodata_is_nan) return
         call parse_real(word, value, status)
         header%nodata = value
      case default
         rule = "must be a number, at most 1e12"
         call parse_real(word, value, status)
         if (abs(value) > farthest) status = -1
      end select
      header%value(key) = value
      if (status /= decimal_ok) then
         call fail(error, where//trim(keys(key))//" = "//printable(word)//": "//rule)
      end if
   end subroutine read_value

   !> Is all there, and does it make square cells?
   pure subroutine check_header(file, header, error)
      character(len=*), intent(in) :: file
      type(header_t), intent(in) :: header
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: width, height, far

      associate (given => header%given)
         if (.not. (given(ncols) .and. given(nrows))) then
            call fail(error, file//": the header lacks ncols or nrows")
         else if (given(xcorner) .eqv. given(xcenter)) then
            call fail(error, file//": the header must have xllcorner or xllcenter, and not both")
         else if (given(ycorner) .eqv. given(ycenter)) then
            call fail(error, file//": the header must have yllcorner or yllcenter, and not both")
         else if ((given(cellsize) .eqv. given(dx)) .or. (given(dx) .neqv. given(dy))) then
            call fail(error, file//": the header must have cellsize, or else dx and dy")
         end if
      end associate
      if (allocated(error)) return
      width = header%value(merge(cellsize, dx, header%given(cellsize)))
      height = header%value(merge(cellsize, dy, header%given(cellsize)))
      far = max(header%value(ncols), header%value(nrows))
      if (min(width, height) <= 0.0_wp) then
         call fail(error, file//": cellsize = "//real_text(min(width, height))//": must be > 0 [m]")
      else if (abs(width - height)*far > 1.0e-6_wp*width) then
         call fail(error, file//": cells are not square ("//real_text(width)//" x " &
                   //real_text(height)//" m); resample with: rio warp "//file &
                   //" square.tif --res "//real_text(min(width, height)) &
                   //" --resampling bilinear")
      end if
   end subroutine check_header

   !> The same expressions as GDAL, so that both doors have the same bits.
   pure type(grid_t) function grid_of(header) result(grid)
      type(header_t), intent(in) :: header
      real(wp) :: height, south

      grid%nx = nint(header%value(ncols))
      grid%ny = nint(header%value(nrows))
      grid%cell = header%value(merge(cellsize, dx, header%given(cellsize)))
      height = header%value(merge(cellsize, dy, header%given(cellsize)))
      grid%west = header%value(xcorner)
      if (header%given(xcenter)) grid%west = header%value(xcenter) - 0.5_wp*grid%cell
      south = header%value(ycorner)
      if (header%given(ycenter)) south = header%value(ycenter) - 0.5_wp*height
      grid%north = south + grid%ny*height
   end function grid_of

   ! ---- the numbers --------------------------------------------------------------------------

   !> Row `j`; the current word is its first number, and afterwards the one behind it.
   subroutine read_row(words, header, grid, j, infinite, row, error)
      type(words_t), intent(inout) :: words
      type(header_t), intent(in) :: header
      type(grid_t), intent(in) :: grid
      integer, intent(in) :: j
      logical, intent(in) :: infinite  !! whether values may be
      real(wp), intent(out) :: row(:)
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: value
      integer :: i, status

      do i = 1, size(row)
         if (words%first > words%last) then
            call fail(error, words%file//": ends in row "//integer_text(j)//" after " &
                      //integer_text((j - 1_i8)*grid%nx + i - 1)//" numbers, "//due(grid) &
                      //" are due: truncated or damaged")
            return
         end if
         call parse_real(words%buffer(words%first:words%last), value, status)
         if (status /= decimal_ok) then
            call read_special(current_word(words), infinite, value, status)
         else if (value >= header%nodata .and. value <= header%nodata) then
            if (.not. header%nodata_is_nan) value = ieee_value(value, ieee_quiet_nan)
         end if
         row(i) = value
         if (status == decimal_ok) then
            call next_word(words, error)
         else
            call fail(error, cell_name(words%file, i, j)//" (line "//integer_text(words%line)//"): '" &
                      //printable(current_word(words))//"' is not a finite number")
         end if
         if (allocated(error)) return
      end do
   end subroutine read_row

   !> NaN (no data), and Inf where it is allowed; `status` stays if it is neither.
   pure subroutine read_special(word, infinite, value, status)
      character(len=*), intent(in) :: word
      logical, intent(in) :: infinite
      real(wp), intent(out) :: value
      integer, intent(inout) :: status

      value = 0.0_wp
      if (is_nan(word)) then
         value = ieee_value(value, ieee_quiet_nan)
         status = decimal_ok
      else if (infinite .and. is_infinite(word)) then
         value = ieee_value(value, ieee_positive_inf)
         status = decimal_ok
      end if
   end subroutine read_special

   pure logical function is_nan(word)
      character(len=*), intent(in) :: word

      is_nan = any(lower(word) == [character(4) :: "nan", "+nan", "-nan"])
   end function is_nan

   pure logical function is_infinite(word)
      character(len=*), intent(in) :: word

      is_infinite = any(lower(word) == [character(9) :: "inf", "+inf", "infinity", "+infinity"])
   end function is_infinite

   ! ---- writing ------------------------------------------------------------------------------

   subroutine write_real(file, values, grid, error)
      character(len=*), intent(in) :: file
      real(wp), intent(in) :: values(:, :)
      type(grid_t), intent(in) :: grid
      type(error_t), allocatable, intent(out) :: error
      type(whole_file_t) :: out
      integer :: i, j

      call create_grid(file, grid, shape(values), out, error)
      do j = 1, grid%ny
         do i = 1, grid%nx
            if (allocated(error)) return
            if (ieee_is_nan(values(i, j))) then
               call put(out, nodata_text//separator(i, grid), error)
            else if (abs(values(i, j)) > huge(1.0_wp)) then
               call put(out, trim(merge(" inf", "-inf", values(i, j) > 0.0_wp)) &
                        //separator(i, grid), error)
            else if (abs(values(i, j) - nodata) <= 0.0_wp) then
               call mark_is_taken(out, i, j, error)
            else
               call put(out, real_text(values(i, j))//separator(i, grid), error)
            end if
         end do
      end do
      if (.not. allocated(error)) call complete_file(out, error)
   end subroutine write_real

   subroutine write_integer(file, values, grid, error)
      character(len=*), intent(in) :: file
      integer(i4), intent(in) :: values(:, :)
      type(grid_t), intent(in) :: grid
      type(error_t), allocatable, intent(out) :: error
      type(whole_file_t) :: out
      integer :: i, j

      call create_grid(file, grid, shape(values), out, error)
      do j = 1, grid%ny
         do i = 1, grid%nx
            if (allocated(error)) return
            if (values(i, j) == no_id) then
               call put(out, nodata_text//separator(i, grid), error)
            else if (values(i, j) == nint(nodata)) then
               call mark_is_taken(out, i, j, error)
            else
               call put(out, integer_text(values(i, j))//separator(i, grid), error)
            end if
         end do
      end do
      if (.not. allocated(error)) call complete_file(out, error)
   end subroutine write_integer

   !> Begin the file with the header.
   subroutine create_grid(file, grid, shape_of_values, out, error)
      character(len=*), intent(in) :: file
      type(grid_t), intent(in) :: grid
      integer, intent(in) :: shape_of_values(2)
      type(whole_file_t), intent(out) :: out
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: south
      logical :: exact

      if (any(shape_of_values /= [grid%nx, grid%ny])) then
         call fail(error, file//": array and grid differ in shape", our_fault)
         return
      end if
      call find_south(grid, south, exact)
      if (.not. exact) then
         call fail(error, file//": no yllcorner gives back the northern edge " &
                   //real_text(grid%north)//" exactly (ny = "//integer_text(grid%ny) &
                   //", cell = "//real_text(grid%cell)//"); use netCDF")
         return
      end if
      call create_file(file, out, error)
      if (allocated(error)) return
      call put(out, "ncols "//integer_text(grid%nx)//line_end//"nrows "//integer_text(grid%ny) &
               //line_end//"xllcorner "//real_text(grid%west)//line_end//"yllcorner " &
               //real_text(south)//line_end//"cellsize "//real_text(grid%cell)//line_end &
               //"NODATA_value "//nodata_text//line_end, error)
   end subroutine create_grid

   !> The southern edge with south + ny*cell == north in double arithmetic, as readers add.
   pure subroutine find_south(grid, south, exact)
      type(grid_t), intent(in) :: grid
      real(wp), intent(out) :: south
      logical, intent(out) :: exact
      real(wp) :: height, off
      integer :: k

      height = grid%ny*grid%cell
      south = grid%north - height
      do k = 1, 8
         off = grid%north - (south + height)
         exact = abs(off) <= 0.0_wp
         if (exact) return
         south = nearest(south, off)
      end do
   end subroutine find_south

   !> Cells of one line but the last end in a blank.
   pure function separator(i, grid)
      integer, intent(in) :: i
      type(grid_t), intent(in) :: grid
      character(len=1) :: separator

      separator = merge(line_end, " ", i == grid%nx)
   end function separator

   subroutine mark_is_taken(out, i, j, error)
      type(whole_file_t), intent(inout) :: out
      integer, intent(in) :: i, j
      type(error_t), allocatable, intent(out) :: error

      call discard_file(out)
      call fail(error, cell_name(out%name, i, j)//": "//nodata_text &
                //" is a value of the raster, it cannot mark nodata")
   end subroutine mark_is_taken

   ! ---- words for messages -------------------------------------------------------------------

   pure function due(grid)
      type(grid_t), intent(in) :: grid
      character(len=:), allocatable :: due

      due = "ncols x nrows = "//integer_text(grid%nx)//" x "//integer_text(grid%ny)
   end function due

   !> What may not be text at all, fit to be shown.
   pure function printable(word)
      character(len=*), intent(in) :: word
      character(len=:), allocatable :: printable
      integer :: i

      printable = word
      do i = 1, len(word)
         if (iachar(word(i:i)) < 32 .or. iachar(word(i:i)) > 126) printable(i:i) = "?"
      end do
      printable = excerpt(printable)
   end function printable
end module rockfall_asciigrid
