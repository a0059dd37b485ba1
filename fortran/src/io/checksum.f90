! SPDX-License-Identifier: BSD-3-Clause
!> SHA-256 of a file (FIPS 180-4): says in a result which input it came from.
module rockfall_checksum
   use rockfall_kinds, only: i8
   use rockfall_error, only: error_t, fail
   use rockfall_pipe, only: refuse_pipe
   implicit none
   private
   public :: file_checksum, text_checksum

   integer, parameter :: block = 64                      !! [bytes]
   integer(i8), parameter :: low32 = int(z"FFFFFFFF", i8)

   !> The first 32 bits of the fractions of the square roots of the first 8 primes, and of the cube
   !> roots of the first 64. Words of 32 bits in 64, so that no sum overflows.
   integer(i8), parameter :: start(8) = [int(z"6A09E667", i8), int(z"BB67AE85", i8), &
      int(z"3C6EF372", i8), int(z"A54FF53A", i8), int(z"510E527F", i8), int(z"9B05688C", i8), &
      int(z"1F83D9AB", i8), int(z"5BE0CD19", i8)]
   integer(i8), parameter :: k(64) = [ &
      int(z"428A2F98", i8), int(z"71374491", i8), int(z"B5C0FBCF", i8), int(z"E9B5DBA5", i8), &
      int(z"3956C25B", i8), int(z"59F111F1", i8), int(z"923F82A4", i8), int(z"AB1C5ED5", i8), &
      int(z"D807AA98", i8), int(z"12835B01", i8), int(z"243185BE", i8), int(z"550C7DC3", i8), &
      int(z"72BE5D74", i8), int(z"80DEB1FE", i8), int(z"9BDC06A7", i8), int(z"C19BF174", i8), &
      int(z"E49B69C1", i8), int(z"EFBE4786", i8), int(z"0FC19DC6", i8), int(z"240CA1CC", i8), &
      int(z"2DE92C6F", i8), int(z"4A7484AA", i8), int(z"5CB0A9DC", i8), int(z"76F988DA", i8), &
      int(z"983E5152", i8), int(z"A831C66D", i8), int(z"B00327C8", i8), int(z"BF597FC7", i8), &
      int(z"C6E00BF3", i8), int(z"D5A79147", i8), int(z"06CA6351", i8), int(z"14292967", i8), &
      int(z"27B70A85", i8), int(z"2E1B2138", i8), int(z"4D2C6DFC", i8), int(z"53380D13", i8), &
      int(z"650A7354", i8), int(z"766A0ABB", i8), int(z"81C2C92E", i8), int(z"92722C85", i8), &
      int(z"A2BFE8A1", i8), int(z"A81A664B", i8), int(z"C24B8B70", i8), int(z"C76C51A3", i8), &
      int(z"D192E819", i8), int(z"D6990624", i8), int(z"F40E3585", i8), int(z"106AA070", i8), &
      int(z"19A4C116", i8), int(z"1E376C08", i8), int(z"2748774C", i8), int(z"34B0BCB5", i8), &
      int(z"391C0CB3", i8), int(z"4ED8AA4A", i8), int(z"5B9CCA4F", i8), int(z"682E6FF3", i8), &
      int(z"748F82EE", i8), int(z"78A5636F", i8), int(z"84C87814", i8), int(z"8CC70208", i8), &
      int(z"90BEFFFA", i8), int(z"A4506CEB", i8), int(z"BEF9A3F7", i8), int(z"C67178F2", i8)]

contains

   !> Checksum of a file, as 64 hexadecimal digits.
   subroutine file_checksum(path, checksum, error)
      character(len=*), intent(in) :: path
      character(len=64), intent(out) :: checksum
      type(error_t), allocatable, intent(out) :: error
      integer, parameter :: piece = 2**20  !! a multiple of `block` [bytes]
      character(len=:), allocatable :: text
      character(len=200) :: message
      integer(i8) :: state(8), length, done
      integer :: unit, status, n

      checksum = ""
      call refuse_pipe(path, path, error)
      if (allocated(error)) return
      open (newunit=unit, file=path, access="stream", form="unformatted", status="old", &
            action="read", iostat=status, iomsg=message)
      if (status /= 0) then
         call fail(error, path//": cannot be read: "//trim(message))
         return
      end if
      inquire (unit=unit, size=length)
      allocate (character(len=piece) :: text)
      state = start
      done = 0
      do
         n = int(min(int(piece, i8), length - done))
         if (n > 0) read (unit, iostat=status, iomsg=message) text(:n)
         if (status /= 0) exit
         done = done + n
         if (n < piece) exit
         call add(state, text)
      end do
      close (unit)
      if (status /= 0) then
         call fail(error, path//": cannot be read: "//trim(message))
      else
         checksum = finished(state, text(:n), length)
      end if
   end subroutine file_checksum

   !> Checksum of a text.
   pure function text_checksum(text) result(checksum)
      character(len=*), intent(in) :: text
      character(len=64) :: checksum
      integer(i8) :: state(8)

      state = start
      checksum = finished(state, text, len(text, kind=i8))
   end function text_checksum

   !> The digits of what came before, the last bytes, and the length of all [bytes].
   pure function finished(before, text, length) result(checksum)
      integer(i8), intent(in) :: before(8), length
      character(len=*), intent(in) :: text
      character(len=64) :: checksum
      character(len=2*block) :: tail
      integer(i8) :: state(8)
      integer :: whole, rest, last, i

      state = before
      whole = len(text)/block*block
      rest = len(text) - whole
      call add(state, text(:whole))
      last = merge(block, 2*block, rest < block - 8)  ! a 1 bit and the length must find room
      tail = repeat(achar(0), 2*block)
      tail(:rest + 1) = text(whole + 1:)//char(128)
      do i = 0, 7
         tail(last - i:last - i) = char(iand(shiftr(8*length, 8*i), 255_i8))
      end do
      call add(state, tail(:last))
      write (checksum, "(8z8.8)") state
      do i = 1, len(checksum)
         if (checksum(i:i) >= "A") checksum(i:i) = achar(iachar(checksum(i:i)) + 32)
      end do
   end function finished

   !> Whole blocks into the state.
   pure subroutine add(state, text)
      integer(i8), intent(inout) :: state(8)
      character(len=*), intent(in) :: text
      integer(i8) :: w(64), s(8), s0, s1, choice, majority
      integer :: at, t

      do at = 0, len(text) - block, block
         do t = 1, 16
            w(t) = word(text(at + 4*t - 3:at + 4*t))
         end do
         do t = 17, 64
            s0 = ieor(ieor(turned(w(t - 15), 7), turned(w(t - 15), 18)), shiftr(w(t - 15), 3))
            s1 = ieor(ieor(turned(w(t - 2), 17), turned(w(t - 2), 19)), shiftr(w(t - 2), 10))
            w(t) = iand(w(t - 16) + s0 + w(t - 7) + s1, low32)
         end do
         s = state
         do t = 1, 64
            s1 = ieor(ieor(turned(s(5), 6), turned(s(5), 11)), turned(s(5), 25))
            choice = ieor(s(7), iand(s(5), ieor(s(6), s(7))))
            s1 = s(8) + s1 + choice + k(t) + w(t)
            s0 = ieor(ieor(turned(s(1), 2), turned(s(1), 13)), turned(s(1), 22))
            majority = ior(iand(s(1), s(2)), iand(s(3), ior(s(1), s(2))))
            s(8) = s(7)
            s(7) = s(6)
            s(6) = s(5)
            s(5) = iand(s(4) + s1, low32)
            s(4) = s(3)
            s(3) = s(2)
            s(2) = s(1)
            s(1) = iand(s1 + s0 + majority, low32)
         end do
         state = iand(state + s, low32)
      end do
   end subroutine add

   !> Four bytes as a number, the first the highest.
   pure integer(i8) function word(bytes)
      character(len=4), intent(in) :: bytes

      word = ior(ior(shiftl(int(ichar(bytes(1:1)), i8), 24), &
                     shiftl(int(ichar(bytes(2:2)), i8), 16)), &
                 ior(shiftl(int(ichar(bytes(3:3)), i8), 8), int(ichar(bytes(4:4)), i8)))
   end function word

   !> 32 bits turned to the right.
   pure integer(i8) function turned(word, by)
      integer(i8), intent(in) :: word
      integer, intent(in) :: by

      turned = iand(ior(shiftr(word, by), shiftl(word, 32 - by)), low32)
   end function turned
end module rockfall_checksum
