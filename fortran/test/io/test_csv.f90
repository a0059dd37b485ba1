! SPDX-License-Identifier: BSD-3-Clause
!> The table of zones: what is read, what is refused, in which words.
program test_csv
   use, intrinsic :: ieee_arithmetic, only: ieee_is_nan
   use rockfall_kinds, only: wp, i4
   use rockfall_error, only: error_t
   use rockfall_csv, only: read_zone_table, parse_zone_table
   use check_m, only: check, check_close, finish
   implicit none

   character(len=*), parameter :: lf = achar(10), crlf = achar(13)//achar(10)
   character(len=*), parameter :: mark = char(239)//char(187)//char(191)
   character(len=*), parameter :: head = "zone,mean_radius"//lf

   call columns_in_any_order()
   call quotes_blanks_and_line_ends()
   call tables_refused()
   call values_refused()
   call files()
   call finish()

contains

   subroutine columns_in_any_order()
      integer(i4), allocatable :: ids(:)
      real(wp), allocatable :: radii(:, :)
      type(error_t), allocatable :: error

      call parse_zone_table("rg70,description,Zone,mean_radius,rg10,rg20"//lf &
                            //"0.3,""talus, old"",-3,.18,0.45,1e-1"//lf &
                            //"Inf,river,2147483647,inf,+Infinity,INF", "z.csv", ids, radii, error)
      call check("a full table is read", .not. allocated(error))
      if (allocated(error)) return
      call check("ids", all(ids == [-3_i4, 2147483647_i4]))
      call check("radii", all(abs(radii(:, 1) - [0.18_wp, 0.3_wp, 0.1_wp, 0.45_wp]) <= 0))
      call check("Inf absorbs", all(radii(:, 2) > huge(1.0_wp)))

      call parse_zone_table("zone;mean_radius;a,b"//lf//"7;0.25;x,y", "z.csv", ids, radii, error)
      call check("semicolons", .not. allocated(error))
      call check_close("a radius after a semicolon", radii(1, 1), 0.25_wp, 0.0_wp)
      call check("absent columns are NaN", all(ieee_is_nan(radii(2:, 1))))
      call parse_zone_table("rg70,zone"//lf//"2,1", "z.csv", ids, radii, error)
      call check("mean_radius may be absent", ieee_is_nan(radii(1, 1)) .and. size(ids) == 1)
   end subroutine columns_in_any_order

   subroutine quotes_blanks_and_line_ends()
      integer(i4), allocatable :: ids(:)
      real(wp), allocatable :: radii(:, :)
      type(error_t), allocatable :: error

      call parse_zone_table(mark//crlf//" zone , ""mean_radius"" ,text "//crlf//crlf &
                            //" 1 , ""0.5"" , ""a """"b"""" ,"//crlf//"c"" "//crlf &
                            //"2,0.75,"//crlf//" "//crlf//",,"//crlf//"3,1,ü"//crlf, &
                            "z.csv", ids, radii, error)
      call check("mark, blanks, quotes, blank lines", .not. allocated(error))
      if (allocated(error)) return
      call check("its ids", size(ids) == 3)
      call check("its radii", all(abs(radii(1, :) - [0.5_wp, 0.75_wp, 1.0_wp]) <= 0))
      call refused(head//"1,"" 1 "//lf//"2""", &
                   "z.csv: line 2: mean_radius = 1  2: must be a number")
      call refused(crlf//head//"1,"" 1"//" """//lf//lf//"2,x", &
                   "z.csv: line 5: mean_radius = x: must be a number")
   end subroutine quotes_blanks_and_line_ends

   subroutine tables_refused()
      call refused("", "z.csv: is empty")
      call refused(lf//" "//lf, "z.csv: is empty")
      call refused("zone,rg70", "z.csv: no zones below the header")
      call refused(lf//"id,rg70"//lf//"1,2", "z.csv: line 2: no column zone; has: id, rg70")
      call refused("zone,radius"//lf//"1,2", &
                   "z.csv: line 1: none of the columns mean_radius, rg70, rg20, rg10")
      call refused("zone,rg70,RG70"//lf//"1,2,3", "z.csv: line 1: column rg70: is there twice")
      call refused(head//"1", "z.csv: line 2: 1 columns, the header has 2")
      call refused(head//"1,2"//lf//"2,3,4", "z.csv: line 3: 3 columns, the header has 2")
      call refused(head//"1,2,", "z.csv: line 2: 3 columns, the header has 2")
      call refused(head//"1,2"//lf//"1,3", "z.csv: line 3: zone 1: is in the table twice")
      call refused(head//"1,""2", "z.csv: line 2: text without its closing quote")
      call refused(head//"1,""2""", "")
      call refused(head//"1,""2"" x"//lf, &
                   "z.csv: line 2: a , is due after a quoted text, before x")
      call refused(head//"1,2"//achar(0), &
                   "z.csv: line 2: character code 0 is not text (UTF-8 is due)")
      call refused(repeat("a,", 1000), "z.csv: line 1: more than 1000 columns")
   end subroutine tables_refused

   subroutine values_refused()
      call refused(head//"1.0,2", "z.csv: line 2: zone = 1.0: must be an integer")
      call refused(head//",2", "z.csv: line 2: zone = : must be an integer")
      call refused(head//"3000000000,2", "z.csv: line 2: zone = 3000000000: must fit in 32 bits")
      call refused(head//"-2147483648,2", "z.csv: line 2: zone = -2147483648: must fit in 32 bits")
      call refused(head//"1,2"//lf//"2,-0.1", &
                   "z.csv: line 3: mean_radius = -0.1: must be > 0 (Inf absorbs)")
      call refused(head//"1,0", "z.csv: line 2: mean_radius = 0: must be > 0 (Inf absorbs)")
      call refused(head//"1,NaN", "z.csv: line 2: mean_radius = NaN: must be > 0 (Inf absorbs)")
      call refused(head//"1,-Inf", "z.csv: line 2: mean_radius = -Inf: must be > 0 (Inf absorbs)")
      call refused(head//"1,", "z.csv: line 2: mean_radius = : must be a number")
      call refused(head//"1,two", "z.csv: line 2: mean_radius = two: must be a number")
      call refused(head//"1,1e999", "z.csv: line 2: mean_radius = 1e999: must be a number")
      call refused("zone;mean_radius"//lf//"1;0,5", &
                   "z.csv: line 2: mean_radius = 0,5: must be a number")
   end subroutine values_refused

   !> `text` must be refused with exactly this message; read, if the message is empty.
   subroutine refused(text, message)
      character(len=*), intent(in) :: text, message
      integer(i4), allocatable :: ids(:)
      real(wp), allocatable :: radii(:, :)
      type(error_t), allocatable :: error

      call parse_zone_table(text, "z.csv", ids, radii, error)
      if (allocated(error)) then
         call check(message//" <- "//error%message, error%message == message)
      else
         call check("refused: "//message, message == "")
      end if
   end subroutine refused

   subroutine files()
      integer(i4), allocatable :: ids(:)
      real(wp), allocatable :: radii(:, :)
      type(error_t), allocatable :: error
      integer :: unit

      open (newunit=unit, file="test_csv.tmp", access="stream", form="unformatted", &
            status="replace", action="write")
      write (unit) head//"5,0.5"//lf
      close (unit)
      call read_zone_table("test_csv.tmp", ids, radii, error)
      call check("a file is read", .not. allocated(error))
      call check("its zone", size(ids) == 1 .and. ids(1) == 5)
      open (newunit=unit, file="test_csv.tmp")
      close (unit, status="delete")
      call read_zone_table("test_csv.tmp", ids, radii, error)
      call check("a missing file", allocated(error))
      if (allocated(error)) call check("its message", error%message == "test_csv.tmp: no such file")
   end subroutine files
end program test_csv
