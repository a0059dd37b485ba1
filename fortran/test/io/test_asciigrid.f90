! SPDX-License-Identifier: BSD-3-Clause
!> Decimal numbers and ESRI ASCII grids: bits that survive, files that are refused, in which words.
program test_asciigrid
   use, intrinsic :: ieee_arithmetic, only: ieee_is_nan, ieee_value, ieee_quiet_nan, &
                                            ieee_positive_inf
   use rockfall_kinds, only: wp, sp, i4, i8
   use rockfall_error, only: error_t
   use rockfall_decimal, only: parse_real, real_text, decimal_ok
   use rockfall_grid, only: grid_t, same_grid
   use rockfall_asciigrid, only: read_ascii_grid, write_ascii_grid, no_id
   use check_m, only: check, check_close, finish
   implicit none

   character(len=*), parameter :: lf = achar(10), crlf = achar(13)//achar(10)
   character(len=*), parameter :: name = "test_asciigrid.tmp"
   character(len=*), parameter :: head = "ncols 3"//lf//"nrows 2"//lf//"xllcorner 100.5"//lf &
                                  //"yllcorner 200"//lf//"cellsize 2.5"//lf

   call decimals_are_nearest()
   call decimals_come_back()
   call grids_are_compared()
   call headers_of_all_kinds()
   call numbers_of_all_kinds()
   call integers_and_nodata()
   call headers_refused()
   call numbers_refused()
   call no_files()
   call grids_come_back()
   call words_across_the_buffer()
   call nothing_half_written()
   call remove(name)
   call finish()

contains

   !> The reading of the run-time library is the witness.
   subroutine decimals_are_nearest()
      real(wp) :: u(3), got, want
      character(len=60) :: text
      integer :: k, wrong, status

      wrong = 0
      do k = 1, 20000
         call random_number(u)
         select case (modulo(k, 5))
         case (0)
            write (text, "(f0.3)") 9000*u(1) - 500
         case (1)  ! halves of units in the last place: the hardest to round
            write (text, "(i0, a)") 2*(2_i8**52 + int(u(1)*2.0_wp**52, i8)) + 1, ".5"
         case (2)
            write (text, "(f0.13)") real(9000*u(1), sp)
         case (3)
            write (text, "(es25.17)") (u(1) - 0.5_wp)*10.0_wp**int(60*u(2) - 30)
         case (4)
            write (text, "(i0, i0, a, i0)") int(u(1)*1e9_wp, i8), int(u(2)*1e9_wp, i8), "e-", &
               int(u(3)*25)
         end select
         text = adjustl(text)
         call parse_real(trim(text), got, status)
         read (text, *) want
         if (status /= decimal_ok .or. got < want .or. got > want) wrong = wrong + 1
      end do
      call check("parse_real gives the nearest double", wrong == 0)
   end subroutine decimals_are_nearest

   subroutine decimals_come_back()
      real(wp), parameter :: special(9) = [0.1_wp, huge(1.0_wp), tiny(1.0_wp), -1.0_wp/3.0_wp, &
                                           2.0_wp**53, 2.0_wp**53 + 2, 1.0e22_wp, 1.0e-7_wp, &
                                           4.5e-300_wp]
      real(wp) :: u(2)
      integer :: k, wrong

      wrong = 0
      do k = 1, size(special)
         if (.not. comes_back(special(k))) wrong = wrong + 1
      end do
      do k = 1, 20000
         call random_number(u)
         u(1) = (u(1) - 0.5_wp)*10.0_wp**int(70*u(2) - 35)
         if (modulo(k, 2) == 0) u(1) = real(real(u(1), sp), wp)
         if (.not. comes_back(u(1))) wrong = wrong + 1
      end do
      call check("real_text reads back to the same double", wrong == 0)
      call check("short where that suffices", real_text(1411.25_wp) == "1411.25" &
                 .and. real_text(-0.1_wp) == "-0.1" .and. real_text(5.0e6_wp) == "5000000")
      call check("zero and its sign", real_text(0.0_wp) == "0" &
                 .and. real_text(-0.0_wp) == "-0")
   end subroutine decimals_come_back

   logical function comes_back(value)
      real(wp), intent(in) :: value
      real(wp) :: back
      integer :: status

      call parse_real(real_text(value), back, status)
      comes_back = status == decimal_ok .and. back >= value .and. back <= value &
                   .and. len(real_text(value)) <= 24
   end function comes_back

   subroutine grids_are_compared()
      type(grid_t), parameter :: a = grid_t(77665.0_wp, 5.0e6_wp, 10.0_wp, 300, 400)

      call check("a grid is itself", same_grid(a, a))
      call check("a hair apart", same_grid(a, grid_t(77665.000009_wp, 5.0e6_wp, 10.0_wp, 300, 400)))
      call check("further apart", .not. same_grid(a, grid_t(77665.0001_wp, 5.0e6_wp, 10.0_wp, &
                                                            300, 400)))
      call check("more rows", .not. same_grid(a, grid_t(77665.0_wp, 5.0e6_wp, 10.0_wp, 300, 401)))
      call check("cells that add up to a difference", &
                 .not. same_grid(a, grid_t(77665.0_wp, 5.0e6_wp, 10.000001_wp, 300, 400)))
   end subroutine grids_are_compared

   subroutine headers_of_all_kinds()
      type(grid_t) :: grid
      real(wp), allocatable :: z(:, :)
      type(error_t), allocatable :: error

      call put_file(head//"1 2 3"//lf//"4 5 6"//lf)
      call read_ascii_grid(name, z, grid, error)
      call check("a plain grid is read", .not. allocated(error))
      if (allocated(error)) return
      call check("its shape", all(shape(z) == [3, 2]) .and. grid%nx == 3 .and. grid%ny == 2)
      call check("row 1 is the northernmost", all(nint(z) == reshape([1, 2, 3, 4, 5, 6], [3, 2])))
      call check_close("west", grid%west, 100.5_wp, 0.0_wp)
      call check_close("north", grid%north, 205.0_wp, 0.0_wp)
      call check_close("cell", grid%cell, 2.5_wp, 0.0_wp)

      call put_file("  NODATA_VALUE -1e3 YLLcenter"//crlf//"201.25 DX 2.5 nrows 2 dy 2.5"//crlf &
                    //"XLLCENTER 101.75 NCols 3"//crlf//"1"//crlf//"2 3 4 -1000.0 6")
      call read_ascii_grid(name, z, grid, error)
      call check("any case, any order, centres, wrapped rows", .not. allocated(error))
      if (allocated(error)) return
      call check_close("west from a centre", grid%west, 100.5_wp, 0.0_wp)
      call check_close("north from a centre", grid%north, 205.0_wp, 0.0_wp)
      call check("nodata is NaN", ieee_is_nan(z(2, 2)) .and. count(ieee_is_nan(z)) == 1)
   end subroutine headers_of_all_kinds

   subroutine numbers_of_all_kinds()
      type(grid_t) :: grid
      real(wp), allocatable :: z(:, :)
      type(error_t), allocatable :: error

      call put_file(head//"-9999 -9999.0 1.5e3"//lf//"+.5 nan 1411.3780517578125"//lf)
      call read_ascii_grid(name, z, grid, error)
      call check("numbers in every form", .not. allocated(error))
      if (allocated(error)) return
      call check("-9999 is nodata where the header is silent", all(ieee_is_nan(z(:2, 1))))
      call check("nan is nodata", ieee_is_nan(z(2, 2)))
      call check_close("an exponent", z(3, 1), 1500.0_wp, 0.0_wp)
      call check_close("17 digits", z(3, 2), 1411.3780517578125_wp, 0.0_wp)

      call put_file(head//"NODATA_value nan"//lf//"-9999 nan 1 2 Inf 3"//lf)
      call read_ascii_grid(name, z, grid, error, infinite=.true.)
      call check("nodata nan, and Inf where it is allowed", .not. allocated(error))
      if (allocated(error)) return
      call check_close("-9999 is a number then", z(1, 1), -9999.0_wp, 0.0_wp)
      call check("nan is nodata then", ieee_is_nan(z(2, 1)))
      call check("Inf", z(2, 2) > huge(1.0_wp))
   end subroutine numbers_of_all_kinds

   subroutine integers_and_nodata()
      type(grid_t) :: grid
      integer(i4), allocatable :: ids(:, :)
      type(error_t), allocatable :: error

      call put_file(head//"NODATA_value 0"//lf//"1 2.0 0"//lf//"-2147483647 2147483647 nan"//lf)
      call read_ascii_grid(name, ids, grid, error)
      call check("integers are read", .not. allocated(error))
      if (.not. allocated(error)) then
         call check("their values", all(ids == reshape([1_i4, 2_i4, no_id, -huge(1_i4), &
                                                        huge(1_i4), no_id], [3, 2])))
      end if
      call put_file(head//"1 2 3 4 5.5 6")
      call read_ascii_grid(name, ids, grid, error)
      call said(error, ": row 2, column 2: 5.5: must be an integer of 32 bits")
      call put_file(head//"1 2 3 4 5 -2147483648")
      call read_ascii_grid(name, ids, grid, error)
      call said(error, ": row 2, column 3: -2147483648: must be an integer of 32 bits")
      call put_file(head//"1 2 3 4 inf 6")
      call read_ascii_grid(name, ids, grid, error)
      call said(error, ": row 2, column 2 (line 6): 'inf' is not a finite number")
   end subroutine integers_and_nodata

   subroutine headers_refused()
      character(len=*), parameter :: numbers = " 1 2 3 4 5 6"
      character(len=*), parameter :: size_ = "ncols 3 nrows 2", place = " xllcorner 1 yllcorner 1 "
      character(len=*), parameter :: no_grid = &
                                     ": no ESRI ASCII grid: those begin with ncols, nrows, ..."

      call refused(size_//place//numbers, ": the header must have cellsize, or else dx and dy")
      call refused(size_//place//"dx 1"//numbers, &
                   ": the header must have cellsize, or else dx and dy")
      call refused(size_//place//"dx 1 dy 1 cellsize 1"//numbers, &
                   ": the header must have cellsize, or else dx and dy")
      call refused(size_//place//"dx 2.5 dy 3"//numbers, &
                   ": cells are not square (2.5 x 3 m); resample with: rio warp "//name &
                   //" square.tif --res 2.5 --resampling bilinear")
      call refused(size_//place//"cellsize 0"//numbers, ": cellsize = 0: must be > 0 [m]")
      call refused(size_//place//"dx 1 dy -1"//numbers, ": cellsize = -1: must be > 0 [m]")
      call refused(size_//place//"cellsize nan"//numbers, &
                   ": line 1: cellsize = nan: must be a number, at most 1e12")
      call refused(size_//place//"cellsize 1e300"//numbers, &
                   ": line 1: cellsize = 1e300: must be a number, at most 1e12")
      call refused("ncols 3 "//place//" cellsize 1"//numbers, ": the header lacks ncols or nrows")
      call refused(size_//" xllcorner 1 cellsize 1"//numbers, &
                   ": the header must have yllcorner or yllcenter, and not both")
      call refused(size_//place//"xllcenter 1 cellsize 1"//numbers, &
                   ": the header must have xllcorner or xllcenter, and not both")
      call refused("ncols -3", ": line 1: ncols = -3: must be an integer > 0")
      call refused("ncols"//lf//"3.0", ": line 1: ncols = 3.0: must be an integer > 0")
      call refused("nrows 0", ": line 1: nrows = 0: must be an integer > 0")
      call refused("nrows 1e999", ": line 1: nrows = 1e999: must be an integer > 0")
      call refused("nrows", ": line 1: nrows = : must be an integer > 0")
      call refused("nrows 3", ": ends within its header: truncated")
      call refused("nrows 3"//lf//"ncols 3"//lf//"NROWS 3", &
                   ": line 3: nrows: given twice in the header")
      call refused("nrows 3"//lf//"north 3", ": line 2: 'north': unknown in the header; known: " &
                   //"ncols, nrows, xllcorner, yllcorner, xllcenter, yllcenter, cellsize, dx, " &
                   //"dy, NODATA_value")
      call refused("nodata_value none", ": line 1: nodata_value = none: must be a number or nan")
      call refused("II*"//achar(0)//achar(8)//char(200), no_grid)
      call refused(" "//lf//lf, no_grid)
      call refused("1 2 3", no_grid)
      call refused(repeat("x", 10000), no_grid)
      call refused(repeat("x", 5*1024**2), ": not text: a word of megabytes")
   end subroutine headers_refused

   subroutine numbers_refused()
      call refused(head//"1 2 3 4 x 6", &
                   ": row 2, column 2 (line 6): 'x' is not a finite number")
      call refused(head//"1 2 3"//lf//"4 1,5 6", &
                   ": row 2, column 2 (line 7): '1,5' is not a finite number")
      call refused(head//"1 2 3"//lf//"4 inf 6", &
                   ": row 2, column 2 (line 7): 'inf' is not a finite number")
      call refused(head//"1 1e999 3 4 5 6", &
                   ": row 1, column 2 (line 6): '1e999' is not a finite number")
      call refused(head//"1 2 "//char(200)//achar(0)//" 4 5 6", &
                   ": row 1, column 3 (line 6): '??' is not a finite number")
      call refused(head//"1 2 "//repeat("x", 5000)//" 4 5 6", &
                   ": row 1, column 3 (line 6): '"//repeat("x", 57)//"...' is not a finite number")
      call refused(head//"1 2 3"//lf//"4      5"//lf, ": ends in row 2 after 5 numbers, " &
                   //"ncols x nrows = 3 x 2 are due: truncated or damaged")
      call refused(head//"1 2 3"//lf//"4 5 6"//lf//"7", &
                   ": line 8: more than ncols x nrows = 3 x 2 numbers")
      call refused(head//"1 2 3 4 5", &
                   ": too short for ncols x nrows = 3 x 2 numbers: truncated or damaged")
      call refused("ncols 2147483647 nrows 2147483647 xllcorner 0 yllcorner 0 cellsize 1 1", &
                   ": too short for ncols x nrows = 2147483647 x 2147483647 numbers: truncated " &
                   //"or damaged")
   end subroutine numbers_refused

   subroutine no_files()
      type(grid_t) :: grid
      real(wp), allocatable :: z(:, :)
      type(error_t), allocatable :: error

      call refused("", ": is empty")
      call remove(name)
      call read_ascii_grid(name, z, grid, error)
      call said(error, ": no such file")
      call read_ascii_grid(".", z, grid, error)
      call check("a folder is refused", allocated(error))

      call put_file("GEOGCS[""WGS 84"", ...]", "test_asciigrid.prj")
      call refused(head//"1 2 3 4 5 6", ": cells are in degrees (test_asciigrid.prj), metres are " &
                   //"needed")
      call put_file("PROJCS[""UTM"", GEOGCS[""WGS 84"", ...]]", "test_asciigrid.prj")
      call read_ascii_grid(name, z, grid, error)
      call check("a projected system is read", .not. allocated(error))
      call remove("test_asciigrid.prj")
   end subroutine no_files

   subroutine grids_come_back()
      integer, parameter :: nx = 37, ny = 23
      type(grid_t) :: grid, back
      real(wp) :: z(nx, ny)
      real(wp), allocatable :: again(:, :)
      integer(i4) :: ids(nx, ny)
      integer(i4), allocatable :: ids_again(:, :)
      type(error_t), allocatable :: error
      integer :: i

      grid = grid_t(west=176973.437998359208_wp, north=378821.6415409_wp, cell=4.997688906601_wp, &
                    nx=nx, ny=ny)
      call random_number(z)
      z = (z - 0.25_wp)*3000
      z(::2, :) = real(real(z(::2, :), sp), wp)
      z(:5, 1) = [0.0_wp, -0.0_wp, 1.0_wp/3.0_wp, huge(1.0_wp), tiny(1.0_wp)]
      z(7, 7) = ieee_value(1.0_wp, ieee_quiet_nan)
      call write_ascii_grid(name, z, grid, error)
      call check("a grid is written", .not. allocated(error))
      call read_ascii_grid(name, again, back, error)
      call check("and read", .not. allocated(error))
      if (allocated(error)) return
      call check("the same bits", all(transfer(z, [0_i8]) == transfer(again, [0_i8]) &
                                      .or. [ieee_is_nan(z)]))
      call check("the same nodata", all(ieee_is_nan(z) .eqv. ieee_is_nan(again)))
      call check_close("the same west", back%west, grid%west, 0.0_wp)
      call check_close("the same north", back%north, grid%north, 0.0_wp)
      call check_close("the same cell", back%cell, grid%cell, 0.0_wp)

      ids = reshape([(7919_i4*(i - 400), i=1, nx*ny)], [nx, ny])
      ids(4, 1) = no_id
      ids(5, 1) = huge(1_i4)
      call write_ascii_grid(name, ids, grid, error)
      call check("integers are written", .not. allocated(error))
      call read_ascii_grid(name, ids_again, back, error)
      call check("and read back", .not. allocated(error))
      if (.not. allocated(error)) call check("the same integers", all(ids == ids_again))

      z(7, 7) = ieee_value(1.0_wp, ieee_positive_inf)
      call write_ascii_grid(name, z, grid, error)
      call read_ascii_grid(name, again, back, error, infinite=.true.)
      call check("Inf comes back", .not. allocated(error))
      if (.not. allocated(error)) call check("as Inf", again(7, 7) > huge(1.0_wp))
   end subroutine grids_come_back

   !> More than two buffers of text; words lie across their ends.
   subroutine words_across_the_buffer()
      integer, parameter :: nx = 1000, ny = 1200
      type(grid_t) :: grid
      real(wp), allocatable :: z(:, :), again(:, :)
      type(error_t), allocatable :: error
      integer :: i

      z = reshape([(real(i, wp)/8, i=1, nx*ny)], [nx, ny])
      call write_ascii_grid(name, z, grid_t(0.0_wp, 1200.0_wp, 1.0_wp, nx, ny), error)
      call read_ascii_grid(name, again, grid, error)
      call check("a large grid", .not. allocated(error))
      if (.not. allocated(error)) call check("all its numbers", all(abs(z - again) <= 0))
   end subroutine words_across_the_buffer

   subroutine nothing_half_written()
      type(grid_t), parameter :: grid = grid_t(0.0_wp, 3.0_wp, 1.0_wp, 2, 3)
      real(wp) :: z(2, 3)
      type(error_t), allocatable :: error
      integer :: unit, status

      z = 1.0_wp
      call remove(name)
      call write_ascii_grid("no_such_folder/x.asc", z, grid, error)
      call check("a missing folder is refused", allocated(error))
      z(2, 3) = -9999.0_wp
      call write_ascii_grid(name, z, grid, error)
      call said(error, ": row 3, column 2: -9999 is a value of the raster, it cannot mark nodata")
      call check("no file is left", .not. exists(name))
      call check("no part is left", .not. exists(name//".part"))
      call write_ascii_grid(name, z(:, :2), grid, error)
      call said(error, ": array and grid differ in shape")

      open (newunit=unit, file="/dev/full", status="old", action="write", iostat=status)
      if (status /= 0) return  ! a system without this device
      close (unit)
      call execute_command_line("ln -sf /dev/full "//name//".part")
      z = 1.0_wp
      call write_ascii_grid(name, z, grid, error)
      call said(error, ": cannot be written: the disk may be full")
      call check("no file is left on a full disk", .not. exists(name))
      call check("no part is left on a full disk", .not. exists(name//".part"))
   end subroutine nothing_half_written

   !> A file with this text must be refused, as reals, with the name and exactly this message.
   subroutine refused(text, message)
      character(len=*), intent(in) :: text, message
      type(grid_t) :: grid
      real(wp), allocatable :: z(:, :)
      type(error_t), allocatable :: error

      call put_file(text)
      call read_ascii_grid(name, z, grid, error)
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

   !> `text` as the file `name`, or `other`.
   subroutine put_file(text, other)
      character(len=*), intent(in) :: text
      character(len=*), intent(in), optional :: other
      character(len=:), allocatable :: file
      integer :: unit

      file = name
      if (present(other)) file = other
      open (newunit=unit, file=file, access="stream", form="unformatted", status="replace", &
            action="write")
      write (unit) text
      close (unit)
   end subroutine put_file

   subroutine remove(file)
      character(len=*), intent(in) :: file
      integer :: unit

      open (newunit=unit, file=file)
      close (unit, status="delete")
   end subroutine remove

   logical function exists(file)
      character(len=*), intent(in) :: file

      inquire (file=file, exist=exists)
   end function exists
end program test_asciigrid
