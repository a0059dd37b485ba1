! SPDX-License-Identifier: BSD-3-Clause
!> Parser of namelist text and typed values: accepted and refused input, and the messages.
program test_namelist
   use rockfall_kinds, only: wp, i8
   use rockfall_error, only: error_t
   use rockfall_text, only: first_repeated
   use rockfall_namelist, only: namelist_t, parse_namelist
   use rockfall_values, only: has_key, value_count, get_text, get_integer, get_real, &
                              get_logical, refuse
   use rockfall_text_file, only: read_text
   use check_m, only: check, check_close, finish
   implicit none

   character(len=*), parameter :: lf = achar(10), crlf = achar(13)//achar(10), tab = achar(9)
   character(len=*), parameter :: mark = char(239)//char(187)//char(191)

   call groups_and_keys()
   call values_of_every_type()
   call lists()
   call defaults_stay()
   call structure_refused()
   call characters_refused()
   call values_refused()
   call commas()
   call repeated_groups()
   call large_text()
   call repeated_names()
   call files()
   call finish()

contains

   !> The first name that repeats an earlier one is found, also among 1000 names.
   subroutine repeated_names()
      character(len=8) :: names(1000)
      integer :: k

      do k = 1, size(names)
         write (names(k), "(i0)") k
      end do
      call check("all names differ", first_repeated(names) == 0)
      names(700) = names(3)
      names(900) = names(4)
      call check("the first that repeats another", first_repeated(names) == 700)
      call check("of no names", first_repeated(names(:0)) == 0)
      call check("of two", first_repeated([names(1), names(1)]) == 2)
   end subroutine repeated_names

   subroutine groups_and_keys()
      type(namelist_t) :: list
      type(error_t), allocatable :: error
      integer :: style

      do style = 1, 2
         if (style == 1) then
            call parse_namelist(sample(lf), "case.nml", list, error)
         else
            call parse_namelist(mark//sample(crlf), "case.nml", list, error)
         end if
         call check("the sample is read", .not. allocated(error))
         if (allocated(error)) return
         call check("four groups", size(list%group) == 4)
         call check("group names in lower case", list%group(2)%name == "surface")
         call check("group lines", all(list%group%line == [2, 5, 9, 9]))
         call check("keys in the order of the file", &
                    all(list%group(1)%entry%key == [character(8) :: "title", "seed", "boulders"]))
         call check("key lines", all(list%group(1)%entry%line == [2, 3, 3]))
         call check("an empty group", size(list%group(3)%entry) == 0)
         call check("no group is repeated", .not. any(list%group%repeated))
      end do
      call parse_namelist("", "case.nml", list, error)
      call check("an empty text has no group", .not. allocated(error) .and. size(list%group) == 0)
   end subroutine groups_and_keys

   pure function sample(line_end) result(text)
      character(len=*), intent(in) :: line_end
      character(len=:), allocatable :: text

      text = "! a comment with 'a quote and a / and &"//line_end &
             //" &case title = 'It''s / a ""test"" & more! = ü', ! comment /"//line_end &
             //tab//"seed=42 ,BOULDERS = +1000"//line_end &
             //"/ ! after the group"//line_end &
             //"&SurFace"//line_end//"  rg = 3*1.5,"//line_end &
             //"       -2.5d-1, 7"//line_end//"  zones = ""a'b.tif""/"//line_end &
             //"&empty/&last ok=.TRUE. no = f"//line_end//"/"
   end function sample

   subroutine values_of_every_type()
      type(namelist_t) :: list
      type(error_t), allocatable :: error
      character(len=:), allocatable :: text
      integer(i8) :: number
      real(wp) :: x
      logical :: yes, no

      call parse_namelist(sample(lf), "case.nml", list, error)
      call get_text(list%group(1), "title", text, error)
      call check("text with doubled and other quotes, signs, UTF-8", &
                 text == "It's / a ""test"" & more! = ü")
      call get_text(list%group(2), "zones", text, error)
      call check("text in double quotes", text == "a'b.tif")
      call get_integer(list%group(1), "seed", number, error)
      call check("an integer", number == 42_i8)
      call get_real(list%group(1), "boulders", x, error)
      call check_close("an integer is a real, too", x, 1000.0_wp, 0.0_wp)
      call get_logical(list%group(4), "ok", yes, error)
      call get_logical(list%group(4), "no", no, error)
      call check("logical values", yes .and. .not. no)

      call check("an integer of 64 bits", integer_of("9223372036854775807") == huge(1_i8))
      call check("and its negative", integer_of("-9223372036854775807") == -huge(1_i8))
      call check_close(".5", real_of(".5"), 0.5_wp, 0.0_wp)
      call check_close("-5.", real_of("-5."), -5.0_wp, 0.0_wp)
      call check_close("1E3", real_of("1E3"), 1000.0_wp, 0.0_wp)
      call check_close("+1.d+2", real_of("+1.d+2"), 100.0_wp, 0.0_wp)
      call check_close("2.5e-3", real_of("2.5e-3"), 2.5e-3_wp, 0.0_wp)
      call check_close("20 digits", real_of("0.12345678901234567890"), &
                       0.12345678901234567890_wp, 0.0_wp)
      call check_close("the largest double", real_of("1.7976931348623157e308"), &
                       huge(1.0_wp), 0.0_wp)
      call check_close("the smallest normal", real_of("2.2250738585072014e-308"), &
                       tiny(1.0_wp), 0.0_wp)
      call check_close("below the smallest is zero", real_of("1e-400"), 0.0_wp, 0.0_wp)
      call check_close("zero times a power", real_of("0e999"), 0.0_wp, 0.0_wp)
      call check_close("a power of ten out of leading zeros", &
                       real_of("0."//repeat("0", 400)//"1e401"), 1.0_wp, 0.0_wp)
      call check_close("a power of ten out of digits", &
                       real_of("1"//repeat("0", 400)//"e-400"), 1.0_wp, 0.0_wp)
   end subroutine values_of_every_type

   function integer_of(word) result(number)
      character(len=*), intent(in) :: word
      integer(i8) :: number
      type(namelist_t) :: list
      type(error_t), allocatable :: error

      number = 0
      call parse_namelist("&a k = "//word//" /", "f", list, error)
      call get_integer(list%group(1), "k", number, error)
      call check("integer "//word, .not. allocated(error))
   end function integer_of

   function real_of(word) result(x)
      character(len=*), intent(in) :: word
      real(wp) :: x
      type(namelist_t) :: list
      type(error_t), allocatable :: error

      x = -1.0_wp
      call parse_namelist("&a k = "//word//" /", "f", list, error)
      call get_real(list%group(1), "k", x, error)
      call check("real "//word(:min(20, len(word))), .not. allocated(error))
   end function real_of

   subroutine lists()
      type(namelist_t) :: list
      type(error_t), allocatable :: error
      real(wp), allocatable :: x(:)
      character(len=8), allocatable :: names(:)
      character(len=7), allocatable :: short(:)

      call parse_namelist(sample(lf), "case.nml", list, error)
      call get_real(list%group(2), "rg", x, error)
      call check("a list of reals with a repeat count", size(x) == 5)
      call check("its values", all(abs(x - [1.5_wp, 1.5_wp, 1.5_wp, -0.25_wp, 7.0_wp]) <= 0))

      call parse_namelist("&output n = 2*3 4, maps = 'a', 2*""deposits"" 'b', /", "f", list, error)
      call get_text(list%group(1), "maps", names, error)
      call check("a list of texts", size(names) == 4)
      call check("padded", all(names == [character(8) :: "a", "deposits", "deposits", "b"]))
      call get_text(list%group(1), "maps", short, error)
      call said(error, "f: &output maps (value 2) = ""deposits"": must be at most 7 characters")
      call check("and nothing is returned", .not. allocated(short))
      call get_real(list%group(1), "n", x, error)
      call check("a list replaces what was there", size(x) == 3)
   end subroutine lists

   subroutine defaults_stay()
      type(namelist_t) :: list
      type(error_t), allocatable :: error
      real(wp) :: x
      character(len=:), allocatable :: text

      call parse_namelist("&boulder density = 3 x = 'a' /", "f", list, error)
      x = 9.81_wp
      call get_real(list%group(1), "gravity", x, error)
      call check("an absent key is no error", .not. allocated(error))
      call check_close("and leaves the default", x, 9.81_wp, 0.0_wp)
      call get_real(list%group(1), "x", x, error)
      call check("a refused value is an error", allocated(error))
      call check_close("and leaves the default, too", x, 9.81_wp, 0.0_wp)
      call get_text(list%group(1), "title", text, error)
      call check("an absent text stays unallocated", .not. allocated(text))
      call check("has_key", has_key(list%group(1), "density") &
                 .and. .not. has_key(list%group(1), "title"))
      call check("value_count", value_count(list%group(1), "x") == 1 &
                 .and. value_count(list%group(1), "title") == 0)
   end subroutine defaults_stay

   !> Check that `text` is refused with exactly this message.
   subroutine refused(text, message)
      character(len=*), intent(in) :: text, message
      type(namelist_t) :: list
      type(error_t), allocatable :: error

      call parse_namelist(text, "c.nml", list, error)
      call said(error, message)
   end subroutine refused

   subroutine said(error, message)
      type(error_t), allocatable, intent(in) :: error
      character(len=*), intent(in) :: message

      call check("refused: "//message, allocated(error))
      if (.not. allocated(error)) return
      call check(message//" <- "//error%message, error%message == message)
      call check("one line", scan(error%message, lf//achar(13)) == 0)
   end subroutine said

   subroutine structure_refused()
      character(len=*), parameter :: outside = &
                                     " (a group ends at its first / outside of quotes)"

      call refused("hello &a /", "c.nml: line 1: text outside of a group: hello &a /"//outside)
      call refused("&terrain"//lf//"dem = data/dem.tif /", &
                   "c.nml: line 2: text outside of a group: dem.tif /"//outside)
      call refused("&a k = 1"//lf//"&b /", "c.nml: line 1: &a is not closed by /")
      call refused("! x"//lf//"&a k = 1", "c.nml: line 2: &a is not closed by /")
      call refused("&a k = 1 ! /", "c.nml: line 1: &a is not closed by /")
      call refused("&a", "c.nml: line 1: &a is not closed by /")
      call refused("&", "c.nml: line 1: expected a group name after &")
      call refused("& a /", "c.nml: line 1: expected a group name after &")
      call refused("&a"//lf//" k ="//lf//" j = 1 /", "c.nml: line 2: 'k' has no value")
      call refused("&a k = /", "c.nml: line 1: 'k' has no value")
      call refused("&a k = , j = 1 /", "c.nml: line 1: a value is missing before a comma")
      call refused("&a k = 1,"//lf//", 2 /", "c.nml: line 2: a value is missing before a comma")
      call refused("&a 5 /", "c.nml: line 1: expected a key and = before 5 /")
      call refused("&a 'b' = 5 /", "c.nml: line 1: expected a key and = before 'b' = 5 /")
      call refused("&a = 5 /", "c.nml: line 1: expected a key and = before = 5 /")
      call refused("&a , k = 5 /", "c.nml: line 1: expected a key and = before , k = 5 /")
      call refused("&a title 'x' /", "c.nml: line 1: expected a key and = before title 'x' /")
      call refused("&a k = 1 = 2 /", "c.nml: line 1: 'k' has no value")
      call refused("&a k = 'a' = 2 /", "c.nml: line 1: expected a value at = 2 /")
      call refused("&a 2k = 1 /", "c.nml: line 1: '2k' is not a valid key")
      call refused("&a "//repeat("k", 64)//" = 1 /", &
                   "c.nml: line 1: '"//repeat("k", 57)//"...' is not a valid key")
      call refused("&a k = 1"//lf//"K = 2 /", &
                   "c.nml: line 2: &a k: is given twice in this group (first in line 1)")
      call refused("&a x(1) = 2 /", "c.nml: line 1: 'x(1)': array subscripts, " &
                   //"components (%) and complex numbers are not supported")
      call refused("&a x = 3"//lf//"y(1:2) = 2 /", "c.nml: line 2: 'y(1:2)': array subscripts, " &
                   //"components (%) and complex numbers are not supported")
      call refused("&a x%y = 2 /", "c.nml: line 1: 'x%y': array subscripts, " &
                   //"components (%) and complex numbers are not supported")
   end subroutine structure_refused

   subroutine characters_refused()
      call refused("&a k = 1"//lf//achar(0)//" /", &
                   "c.nml: line 2: character code 0 is not text (UTF-8 expected)")
      call refused("&a k = 'x"//achar(27)//"' /", &
                   "c.nml: line 1: character code 27 is not text (UTF-8 expected)")
      call refused("! "//char(252), "c.nml: line 1: character code 252 is not text (UTF-8 expected)")
      call refused("! "//char(195), "c.nml: line 1: character code 195 is not text (UTF-8 expected)")
      call refused("! "//char(192)//char(128), &
                   "c.nml: line 1: character code 192 is not text (UTF-8 expected)")
      call refused("! "//char(237)//char(160)//char(128), &
                   "c.nml: line 1: character code 237 is not text (UTF-8 expected)")
      call refused("&a"//achar(13)//"k = 1 /", &
                   "c.nml: line 1: character code 13 is not text (UTF-8 expected)")
   end subroutine characters_refused

   !> Decimal and thousands commas are refused, with the number in correct notation; lists are accepted.
   subroutine commas()
      call comma("600,5 620,5", "600,5", "600.5")
      call comma("600,5, 620,25", "600,5", "600.5")
      call comma("600,5"//lf//"620,5", "600,5", "600.5")
      call comma("600,5 , 620", "600,5", "600.5")
      call comma("600.5, 620,5", "620,5", "620.5")
      call comma("-600,5 -620,5", "-600,5", "-600.5")
      call comma("+0,05 1", "+0,05", "+0.05")
      call comma("2*0,5 1", "0,5", "0.5")
      call comma("1,5e3 2", "1,5e3", "1.5e3")
      call comma("600,5,620,25", "600,5", "600.5")
      call comma("2600000,5,"//lf//" 2600100,25", "2600000,5", "2600000.5")
      call comma("1,200.5 1,300.5", "1,200.5", "1200.5")
      call comma("2,600,100 2,600,200", "2,600", "2.600 or 2600")

      call list("600,620,640", 3)
      call list("600,620", 2)
      call list("600, 5, 620, 5", 4)
      call list("0,1,0,1", 4)
      call list("0,5,10,50", 4)
      call list("600,620,640,"//lf//"  660,680", 5)
      call list("100,200, ! south"//lf//" 300,400", 4)
      call list("600.5,620.5 640.5", 3)
      call list("0.5,2 1.5,3", 4)
      call list("600 5 620 5", 4)
      call list("1,-5 2,-5", 4)
      call list("1,.5 2,.5", 4)
      call list("0,200,300 1.5", 4)
      call list("3*1,2*2", 5)
   end subroutine commas

   subroutine comma(values, pair, number)
      character(len=*), intent(in) :: values, pair, number
      type(error_t), allocatable :: error
      real(wp), allocatable :: read(:)

      call read_list(values, read, error)
      call said(error, "c.nml: &a x: "//pair//" is two numbers: write "//number &
                //", or put a blank after each comma of a list")
   end subroutine comma

   subroutine list(values, n)
      character(len=*), intent(in) :: values
      integer, intent(in) :: n
      type(error_t), allocatable :: error
      real(wp), allocatable :: read(:)

      call read_list(values, read, error)
      call check("a list: "//values, .not. allocated(error))
      if (.not. allocated(error)) call check("its length: "//values, size(read) == n)
   end subroutine list

   subroutine read_list(values, read, error)
      character(len=*), intent(in) :: values
      real(wp), allocatable, intent(out) :: read(:)
      type(error_t), allocatable, intent(out) :: error
      type(namelist_t) :: list

      allocate (read(0))
      call parse_namelist("&a x = "//values//" /", "c.nml", list, error)
      if (.not. allocated(error)) call get_real(list%group(1), "x", read, error)
   end subroutine read_list

   subroutine values_refused()
      call refused("&a k = 'abc /"//lf//"&b j = 'd' /", &
                   "c.nml: line 1: closing quote is missing: 'abc /")
      call refused("&a k = ""abc'", "c.nml: line 1: closing quote is missing: ""abc'")
      call refused("&a k = '", "c.nml: line 1: closing quote is missing: '")
      call refused("&a k = 'a'b /", "c.nml: line 1: expected a blank or comma before b /")
      call refused("&a k = 1'b' /", "c.nml: line 1: expected a blank or comma before 'b' /")
      call refused("&a k = '"//repeat("x", 4097)//"' /", &
                   "c.nml: line 1: text longer than 4096 characters")
      call refused("&a k = "//repeat("1", 4097)//" /", &
                   "c.nml: line 1: a value longer than 4096 characters")
      call refused("&a k = 100001*1 /", "c.nml: line 1: repeat count 100001*: must be 1 to 100000")
      call refused("&a k = 0*1 /", "c.nml: line 1: repeat count 0*: must be 1 to 100000")
      call refused("&a k = 99999999999999999999*1 /", &
                   "c.nml: line 1: repeat count 99999999999999999999*: must be 1 to 100000")
      call refused("&a k = 3* /", "c.nml: line 1: expected a value at  /")
      call refused("&a k ="//repeat(" 100000*1", 101)//" /", &
                   "c.nml: line 1: more than 10000000 values in the file")

      call refused_real("'abc'", "'abc': must be a real number")
      call refused_real("abc", "abc: must be a real number")
      call refused_real("'1.0'", "'1.0': must be a real number")
      call refused_real("1.0.0", "1.0.0: must be a real number")
      call refused_real("1e", "1e: must be a real number")
      call refused_real("1e+", "1e+: must be a real number")
      call refused_real("1+5", "1+5: must be a real number")
      call refused_real(".", ".: must be a real number")
      call refused_real("-", "-: must be a real number")
      call refused_real("NaN", "NaN: must be a finite real number")
      call refused_real("-Infinity", "-Infinity: must be a finite real number")
      call refused_real("1e999", "1e999: must be a finite real number")
      call refused_real("1.8e308", "1.8e308: must be a finite real number")
      call refused_real("1e99999999999", "1e99999999999: must be a finite real number")
      call refused_real(repeat("9", 70), repeat("9", 57)//"...: must be a real number")
   end subroutine values_refused

   !> Check that a word is no real (unless it has 70 digits), no integer, no logical and no text.
   subroutine refused_real(word, message)
      character(len=*), intent(in) :: word, message
      type(namelist_t) :: list
      type(error_t), allocatable :: error
      character(len=:), allocatable :: text
      real(wp) :: x
      integer(i8) :: n
      logical :: yes

      call parse_namelist("&boulder density = "//word//" /", "c.nml", list, error)
      call get_real(list%group(1), "density", x, error)
      if (len(word) < 70) call said(error, "c.nml: &boulder density = "//message)
      call get_integer(list%group(1), "density", n, error)
      call check("no integer: "//word, allocated(error))
      call get_logical(list%group(1), "density", yes, error)
      call check("no logical: "//word, allocated(error))
      if (word(1:1) == "'") return
      call get_text(list%group(1), "density", text, error)
      call check("no text: "//word, allocated(error))
   end subroutine refused_real

   !> A message about one of several groups with the same name includes its line.
   subroutine repeated_groups()
      type(namelist_t) :: list
      type(error_t), allocatable :: error
      real(wp), allocatable :: x(:)
      integer(i8) :: n
      logical :: yes
      character(len=:), allocatable :: text

      call parse_namelist("&line x = 1 2 /"//lf//"&case n = 3.7, m = 9223372036854775808"//lf &
                          //"yes = 1, text = abc /"//lf//"&line x = 1, 3*'b' /", "c.nml", &
                          list, error)
      call get_real(list%group(3), "x", x, error)
      call said(error, "c.nml: line 4: &line x (value 2) = 'b': must be a real number")
      call get_integer(list%group(2), "n", n, error)
      call said(error, "c.nml: &case n = 3.7: must be an integer")
      call get_integer(list%group(2), "m", n, error)
      call said(error, "c.nml: &case m = 9223372036854775808: must be a 64-bit integer")
      call get_logical(list%group(2), "yes", yes, error)
      call said(error, "c.nml: &case yes = 1: must be .true. or .false.")
      call get_text(list%group(2), "text", text, error)
      call said(error, "c.nml: &case text = abc: must be text in quotes")
      call refuse(list%group(2), "n", "must be > 5 [kg]", error)
      call said(error, "c.nml: &case n = 3.7: must be > 5 [kg]")
      call refuse(list%group(2), "volume", "required", error)
      call said(error, "c.nml: &case volume: required")
      call refuse(list%group(1), "x", "must be three", error)
      call said(error, "c.nml: line 1: &line x = 1, 2: must be three")
   end subroutine repeated_groups

   !> A polyline of 10**5 vertices, and the maximum number of values: takes seconds if time is not linear in length.
   subroutine large_text()
      integer, parameter :: n = 100000
      type(namelist_t) :: list
      type(error_t), allocatable :: error
      character(len=:), allocatable :: text
      real(wp), allocatable :: x(:)
      integer :: i

      allocate (character(len=12*n) :: text)
      do i = 1, n
         write (text(12*i - 11:12*i), "(f10.2, 2a)") 0.25_wp*i, ",", merge(lf, " ", mod(i, 8) == 0)
      end do
      call parse_namelist("&line x = "//text//"/"//lf//"&b y = 100000*2.5 /", "f", list, error)
      call check("a long polyline is read", .not. allocated(error))
      call get_real(list%group(1), "x", x, error)
      call check("all its vertices", size(x) == n)
      call check("their values", all(abs(x - [(0.25_wp*i, i=1, n)]) < 0.006_wp))
      call check("lines are counted", list%group(2)%line == 2 + n/8)
      call get_real(list%group(2), "y", x, error)
      call check("the longest repeat", size(x) == n)

      call parse_namelist(repeat("&line x = 1 /"//lf, 5000), "f", list, error)
      call check("many groups", size(list%group) == 5000)
      call check("all repeated", all(list%group%repeated))
   end subroutine large_text

   subroutine files()
      type(error_t), allocatable :: error
      character(len=:), allocatable :: text
      integer :: unit

      open (newunit=unit, file="test_namelist.tmp", access="stream", form="unformatted", &
            status="replace", action="write")
      write (unit) "&a k = 1 /"//crlf//"ü"
      close (unit)
      call read_text("test_namelist.tmp", text, error)
      call check("a file is read", .not. allocated(error))
      call check("byte for byte", text == "&a k = 1 /"//crlf//"ü")
      open (newunit=unit, file="test_namelist.tmp", status="replace", action="write")
      close (unit)
      call read_text("test_namelist.tmp", text, error)
      call check("an empty file is an empty text", len(text) == 0 .and. .not. allocated(error))
      open (newunit=unit, file="test_namelist.tmp", access="stream", form="unformatted", &
            status="replace", action="write")
      write (unit, pos=64*1024**2 + 1) "x"
      close (unit)
      call read_text("test_namelist.tmp", text, error)
      call said(error, "test_namelist.tmp: is larger than 64 MB, so it is not a rockfall text file")
      open (newunit=unit, file="test_namelist.tmp")
      close (unit, status="delete")
      call read_text("test_namelist.tmp", text, error)
      call said(error, "test_namelist.tmp: no such file")
      call read_text("", text, error)
      call said(error, ": no such file")
      call read_text(".", text, error)
      call check("a directory is refused", allocated(error))
   end subroutine files
end program test_namelist
