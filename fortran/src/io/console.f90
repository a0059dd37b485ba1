! SPDX-License-Identifier: BSD-3-Clause
!> Command line of the standalone program, which has options of `rockfall run`; formatting of text for users. Prints
!> nothing itself.
module rockfall_console
   use rockfall_kinds, only: wp, i8
   use rockfall_error, only: error_t, fail
   use rockfall_text, only: excerpt
   use rockfall_decimal, only: parse_integer, parse_real, decimal_ok
   use rockfall_system, only: name_of
   implicit none
   private
   public :: arguments_t, read_arguments, stem, one_line, decimal

   character(len=*), parameter :: see_help = ": see rockfall-batch --help"
   character(len=*), parameter :: names(*) = [character(len=14) :: "output", "scene", "boulders", "boulders-total", &
                                              "seed", "threads", "shard", "checkpoint"]  !! options with a value

   type :: arguments_t
      character(len=:), allocatable :: case                     !! the case file
      character(len=:), allocatable :: output, scene            !! "" if not given
      character(len=:), allocatable :: boulders, total, seed, threads  !! integers; "" if not given
      integer(i8) :: shard(2) = 1                               !! part and number of parts; [1, 1]: the whole run
      real(wp) :: checkpoint = 60.0_wp                          !! interval [s]; 0 = never
      logical :: resume = .false., overwrite = .false., quiet = .false.
      logical :: help = .false., version = .false.              !! options given alone
   end type arguments_t

contains

   !> Parse the command line.
   subroutine read_arguments(arguments, error)
      type(arguments_t), intent(out) :: arguments
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: word
      integer :: k

      arguments%case = ""
      arguments%output = ""
      arguments%scene = ""
      arguments%boulders = ""
      arguments%total = ""
      arguments%seed = ""
      arguments%threads = ""
      k = 1
      do while (k <= command_argument_count())
         word = argument(k)
         select case (word)
         case ("--help", "-h"); arguments%help = .true.
         case ("--version"); arguments%version = .true.
         case ("--resume"); arguments%resume = .true.
         case ("--overwrite"); arguments%overwrite = .true.
         case ("--quiet"); arguments%quiet = .true.
         case default; call take_word(word, arguments, k, error)
         end select
         if (allocated(error) .or. arguments%help .or. arguments%version) return
         k = k + 1
      end do
      if (arguments%case == "") call fail(error, "give a case file"//see_help)
   end subroutine read_arguments

   function argument(k) result(word)
      integer, intent(in) :: k
      character(len=:), allocatable :: word
      integer :: length

      call get_command_argument(k, length=length)
      allocate (character(len=length) :: word)
      call get_command_argument(k, word)
   end function argument

   !> Parse `--name value`, `--name=value`, or the case file; k is left at the last argument used.
   subroutine take_word(word, arguments, k, error)
      character(len=*), intent(in) :: word
      type(arguments_t), intent(inout) :: arguments
      integer, intent(inout) :: k
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: name
      integer :: equals

      equals = index(word//"=", "=")
      name = word(:equals - 1)
      if (name == "-o") name = "--output"
      if (name(:min(1, len(name))) /= "-" .and. arguments%case == "") then
         arguments%case = word
      else if (name(:min(1, len(name))) /= "-") then
         call fail(error, excerpt(word)//": only one case file is allowed, and "//arguments%case//" is given"//see_help)
      else if (.not. any("--"//names == name)) then
         call fail(error, excerpt(word)//": unknown option"//see_help)
      else if (equals <= len(word)) then
         call take_value(name(3:), word(equals + 1:), arguments, error)
      else if (k == command_argument_count()) then
         call fail(error, word//": a value is missing"//see_help)
      else
         k = k + 1
         call take_value(name(3:), argument(k), arguments, error)
      end if
   end subroutine take_word

   pure subroutine take_value(name, value, arguments, error)
      character(len=*), intent(in) :: name, value
      type(arguments_t), intent(inout) :: arguments
      type(error_t), allocatable, intent(out) :: error
      integer(i8) :: number
      integer :: status, second, slash

      status = decimal_ok
      select case (name)
      case ("output"); arguments%output = value
      case ("scene"); arguments%scene = value
      case ("boulders"); arguments%boulders = value
      case ("boulders-total"); arguments%total = value
      case ("seed"); arguments%seed = value
      case ("threads"); arguments%threads = value
      case ("shard")
         slash = index(value, "/")
         call parse_integer(value(:max(0, slash - 1)), arguments%shard(1), status)
         call parse_integer(value(slash + 1:), arguments%shard(2), second)
         if (slash == 0 .or. status /= decimal_ok .or. second /= decimal_ok .or. arguments%shard(1) < 1 &
             .or. arguments%shard(1) > arguments%shard(2)) then
            call fail(error, "--shard "//excerpt(value)//": must be I/N with I from 1 to N")
         end if
         return
      case ("checkpoint")
         call parse_real(value, arguments%checkpoint, status)
         if (status /= decimal_ok .or. arguments%checkpoint < 0) &
            call fail(error, "--checkpoint "//excerpt(value)//": must be >= 0 seconds")
         return
      end select
      if (value == "") then
         call fail(error, "--"//name//": a value is missing"//see_help)
      else if (any(name == [character(len=14) :: "boulders", "boulders-total", "seed", "threads"])) then
         call parse_integer(value, number, status)
         if (status /= decimal_ok) call fail(error, "--"//name//" "//excerpt(value)//": must be an integer")
      end if
   end subroutine take_value

   !> Stem of a file name: `folder/case.nml` -> `case`
   pure function stem(path)
      character(len=*), intent(in) :: path
      character(len=:), allocatable :: stem
      integer :: dot

      stem = name_of(path)
      dot = index(stem, ".", back=.true.)
      if (dot > 1) stem = stem(:dot - 1)
   end function stem

   !> Remove line ends from a message.
   pure function one_line(message) result(text)
      character(len=*), intent(in) :: message
      character(len=len(message)) :: text
      integer :: i

      text = message
      do i = 1, len(text)
         if (iachar(text(i:i)) < 32) text(i:i) = " "
      end do
   end function one_line

   !> Format a number with a given number of decimals.
   pure function decimal(value, decimals) result(text)
      real(wp), intent(in) :: value
      integer, intent(in) :: decimals
      character(len=:), allocatable :: text
      character(len=40) :: buffer, form

      write (form, "(a,i0,a)") "(f40.", decimals, ")"
      write (buffer, form) value
      text = trim(adjustl(buffer))
   end function decimal
end module rockfall_console
