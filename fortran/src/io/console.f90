! SPDX-License-Identifier: BSD-3-Clause
!> What the programs have in common: a command line `CASE [key=value ...]`, and text for people. It
!> prints nothing itself.
module rockfall_console
   use rockfall_kinds, only: wp, i8
   use rockfall_error, only: error_t, fail
   use rockfall_text, only: lower, joined, excerpt
   use rockfall_decimal, only: parse_integer, parse_real, decimal_ok
   use rockfall_filesystem, only: name_of
   implicit none
   private
   public :: arguments_t, read_arguments, value_of, read_shard, read_seconds, read_logical, stem, one_line, decimal

   type :: option_t
      character(len=:), allocatable :: key, value
   end type option_t

   type :: arguments_t
      character(len=:), allocatable :: case              !! the case file, "" if none
      type(option_t), allocatable, private :: option(:)  !! one for each key; "" if not given
      logical :: quiet = .false.
      logical :: help = .false., version = .false.       !! asked for, and nothing else
   end type arguments_t

contains

   !> The words of the command line. `keys` are those of the program, beside quiet.
   subroutine read_arguments(program, keys, arguments, error)
      character(len=*), intent(in) :: program  !! its name
      character(len=*), intent(in) :: keys(:)
      type(arguments_t), intent(out) :: arguments
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: word
      integer :: k

      arguments%case = ""
      allocate (arguments%option(size(keys)))
      do k = 1, size(keys)
         arguments%option(k)%key = trim(keys(k))
         arguments%option(k)%value = ""
      end do
      do k = 1, command_argument_count()
         word = argument(k)
         select case (word)
         case ("--help", "-h"); arguments%help = .true.
         case ("--version"); arguments%version = .true.
         case default; call take_word(word, keys, arguments, error)
         end select
         if (allocated(error) .or. arguments%help .or. arguments%version) return
      end do
      if (arguments%case == "") call fail(error, "a case file is needed: "//program &
                                          //" CASE [key=value ...]; see --help")
   end subroutine read_arguments

   function argument(k) result(word)
      integer, intent(in) :: k
      character(len=:), allocatable :: word
      integer :: length

      call get_command_argument(k, length=length)
      allocate (character(len=length) :: word)
      call get_command_argument(k, word)
   end function argument

   !> `key=value`, or the case file.
   pure subroutine take_word(word, keys, arguments, error)
      character(len=*), intent(in) :: word, keys(:)
      type(arguments_t), intent(inout) :: arguments
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: key, value
      integer :: equals, k

      equals = index(word, "=")
      key = word(:max(0, equals - 1))
      value = word(equals + 1:)
      if (equals > 1 .and. value == "") then
         call fail(error, word//": a value is missing")
      else if (key == "quiet") then
         call read_logical(key, value, arguments%quiet, error)
      else if (any(keys == key)) then
         do k = 1, size(keys)
            if (keys(k) == key) arguments%option(k)%value = value
         end do
      else if (key /= "") then
         call fail(error, excerpt(word)//": unknown key; known: "//joined(keys, ", ")//", quiet")
      else if (word(:min(1, len(word))) == "-") then
         call fail(error, excerpt(word)//": unknown option; known: --help, --version")
      else if (arguments%case /= "") then
         call fail(error, excerpt(word)//": there is a case file already, "//arguments%case &
                   //"; options are key=value")
      else
         arguments%case = word
      end if
   end subroutine take_word

   !> What the command line says of a key, the last time; "" if nothing.
   pure function value_of(arguments, key) result(value)
      type(arguments_t), intent(in) :: arguments
      character(len=*), intent(in) :: key
      character(len=:), allocatable :: value
      integer :: k

      value = ""
      do k = 1, size(arguments%option)
         if (arguments%option(k)%key == key) value = arguments%option(k)%value
      end do
   end function value_of

   !> `3/16` -> [3, 16]; nothing -> [1, 1], all of it.
   pure subroutine read_shard(text, shard, error)
      character(len=*), intent(in) :: text
      integer(i8), intent(out) :: shard(2)
      type(error_t), allocatable, intent(out) :: error
      integer :: slash, status(2)

      shard = 1
      if (text == "") return
      slash = index(text, "/")
      call parse_integer(text(:max(0, slash - 1)), shard(1), status(1))
      call parse_integer(text(slash + 1:), shard(2), status(2))
      if (slash == 0 .or. any(status /= decimal_ok) .or. shard(1) < 1 .or. shard(1) > shard(2)) then
         call fail(error, "shard = "//excerpt(text)//": must be I/N with I from 1 to N")
      end if
   end subroutine read_shard

   !> A time of zero seconds or more; nothing -> `value` as it was.
   pure subroutine read_seconds(key, text, value, error)
      character(len=*), intent(in) :: key, text
      real(wp), intent(inout) :: value  !! [s]
      type(error_t), allocatable, intent(out) :: error
      integer :: status

      if (text == "") return
      call parse_real(text, value, status)
      if (status /= decimal_ok .or. value < 0) &
         call fail(error, key//" = "//excerpt(text)//": must be >= 0 seconds")
   end subroutine read_seconds

   !> True or false; nothing -> `value` as it was.
   pure subroutine read_logical(key, text, value, error)
      character(len=*), intent(in) :: key, text
      logical, intent(inout) :: value
      type(error_t), allocatable, intent(out) :: error

      if (text == "") return
      value = any(lower(text) == [character(len=6) :: "true", "t", ".true."])
      if (.not. value .and. &
          .not. any(lower(text) == [character(len=7) :: "false", "f", ".false."])) then
         call fail(error, key//" = "//excerpt(text)//": must be true or false")
      end if
   end subroutine read_logical

   !> `folder/case.nml` -> `case`
   pure function stem(path)
      character(len=*), intent(in) :: path
      character(len=:), allocatable :: stem
      integer :: dot

      stem = name_of(path)
      dot = index(stem, ".", back=.true.)
      if (dot > 1) stem = stem(:dot - 1)
   end function stem

   !> A message without line ends.
   pure function one_line(message) result(text)
      character(len=*), intent(in) :: message
      character(len=len(message)) :: text
      integer :: i

      text = message
      do i = 1, len(text)
         if (iachar(text(i:i)) < 32) text(i:i) = " "
      end do
   end function one_line

   !> A number with so many decimals.
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
