! SPDX-License-Identifier: BSD-3-Clause
!> The words of a text file of any size, one after another, with a few megabytes in memory.
module rockfall_words
   use rockfall_kinds, only: i8
   use rockfall_error, only: error_t, fail
   use rockfall_pipe, only: refuse_pipe
   implicit none
   private
   public :: words_t, open_words, next_word, close_words, bytes_left

   integer, parameter :: capacity = 4*1024**2  !! of the buffer [bytes]

   !> A word is `buffer(first:last)`; first > last after the end of the file.
   type :: words_t
      character(len=:), allocatable :: file    !! its name
      character(len=:), allocatable :: buffer
      integer :: first = 1, last = 0           !! the current word
      integer :: filled = 0                    !! bytes in the buffer
      integer(i8) :: line = 1                  !! of the current word
      integer(i8), private :: unread = 0       !! bytes still in the file
      integer, private :: unit = -1
   end type words_t

contains

   subroutine open_words(file, words, error)
      character(len=*), intent(in) :: file
      type(words_t), intent(out) :: words
      type(error_t), allocatable, intent(out) :: error
      character(len=200) :: message
      integer :: status
      logical :: exists

      words%file = file
      inquire (file=file, exist=exists)
      if (.not. exists .or. len_trim(file) == 0) then
         call fail(error, file//": no such file")
         return
      end if
      call refuse_pipe(file, file, error)
      if (allocated(error)) return
      open (newunit=words%unit, file=file, access="stream", form="unformatted", status="old", &
            action="read", iostat=status, iomsg=message)
      if (status /= 0) then
         words%unit = -1
         call fail(error, file//": cannot be opened: "//trim(message))
         return
      end if
      inquire (unit=words%unit, size=words%unread)
      if (words%unread <= 0) then
         call fail(error, file//": is empty")
      else
         allocate (character(len=capacity) :: words%buffer)
         call refill(words, error)
      end if
      if (allocated(error)) call close_words(words)
   end subroutine open_words

   subroutine close_words(words)
      type(words_t), intent(inout) :: words

      if (words%unit /= -1) close (words%unit)
      words%unit = -1
   end subroutine close_words

   !> Bytes from the current word to the end of the file.
   pure integer(i8) function bytes_left(words)
      type(words_t), intent(in) :: words

      bytes_left = words%filled - words%first + 1 + words%unread
   end function bytes_left

   !> Move on to the next word: what stands between blanks and line ends.
   subroutine next_word(words, error)
      type(words_t), intent(inout) :: words
      type(error_t), allocatable, intent(out) :: error

      words%first = words%last + 1
      do
         call find_word(words%buffer(:words%filled), words%first, words%last, words%line)
         if (words%last < words%filled .or. words%unread == 0) return
         call refill(words, error)  ! the word may go on in the file
         if (allocated(error)) return
      end do
   end subroutine next_word

   !> The first word from `first` on, which moves to its start; `last` is its end, or the end of
   !> the buffer. Lines on the way are counted.
   pure subroutine find_word(buffer, first, last, line)
      character(len=*), intent(in) :: buffer
      integer, intent(inout) :: first
      integer, intent(out) :: last
      integer(i8), intent(inout) :: line
      integer :: i

      do i = first, len(buffer)
         if (.not. is_blank(buffer(i:i))) exit
         if (buffer(i:i) == achar(10)) line = line + 1
      end do
      first = i
      do i = first, len(buffer)
         if (is_blank(buffer(i:i))) exit
      end do
      last = i - 1
   end subroutine find_word

   pure logical function is_blank(letter)
      character(len=1), intent(in) :: letter

      is_blank = letter == " " .or. (letter >= achar(9) .and. letter <= achar(13))
   end function is_blank

   !> Keep the current word, drop what is before it, read on.
   subroutine refill(words, error)
      type(words_t), intent(inout) :: words
      type(error_t), allocatable, intent(out) :: error
      character(len=200) :: message
      integer :: kept, fresh, status

      kept = words%filled - words%first + 1
      if (kept == capacity) then
         call fail(error, words%file//": not text: a word of megabytes")
         return
      end if
      if (kept > 0) words%buffer(:kept) = words%buffer(words%first:words%filled)
      fresh = int(min(words%unread, int(capacity - kept, i8)))
      read (words%unit, iostat=status, iomsg=message) words%buffer(kept + 1:kept + fresh)
      if (status /= 0) then
         call fail(error, words%file//": cannot be read: "//trim(message))
         return
      end if
      words%unread = words%unread - fresh
      words%filled = kept + fresh
      words%first = 1
      words%last = 0
   end subroutine refill
end module rockfall_words
