! SPDX-License-Identifier: BSD-3-Clause
!> Files of raw bytes, by C's stdio: they are on disk when they are closed, and a checksum is kept of what
!> went through them.
module rockfall_bytefile
   use, intrinsic :: iso_c_binding, only: c_char, c_int, c_long, c_size_t, c_ptr, c_null_ptr, c_null_char, &
                                          c_associated, c_f_pointer, c_loc
   use rockfall_kinds, only: i4, i8
   use rockfall_pipe, only: is_pipe
   implicit none
   private
   public :: byte_file_t, read_from, write_new, write_on, open_bytes, pass_bytes, put_text, close_bytes, &
             sync_folder

   character(len=*), parameter :: read_from = "rb", write_new = "wb", write_on = "r+b"  !! modes

   !> An open file. After the first failure nothing more is asked of it.
   type :: byte_file_t
      logical :: ok = .true.
      integer(i8) :: sum(2) = 0  !! checksum of what was read or written
      integer(i8) :: bytes = 0   !! that it was
      logical :: reads = .false.
      type(c_ptr), private :: stream = c_null_ptr
   end type byte_file_t

   interface
      type(c_ptr) function c_fopen(path, mode) bind(c, name="fopen")
         import :: c_ptr, c_char
         character(kind=c_char), intent(in) :: path(*), mode(*)
      end function c_fopen
      integer(c_size_t) function c_fread(data, size, n, stream) bind(c, name="fread")
         import :: c_size_t, c_ptr
         type(*), intent(inout) :: data(*)
         integer(c_size_t), value :: size, n
         type(c_ptr), value :: stream
      end function c_fread
      integer(c_size_t) function c_fwrite(data, size, n, stream) bind(c, name="fwrite")
         import :: c_size_t, c_ptr
         type(*), intent(in) :: data(*)
         integer(c_size_t), value :: size, n
         type(c_ptr), value :: stream
      end function c_fwrite
      integer(c_int) function c_fseek(stream, offset, from) bind(c, name="fseek")
         import :: c_int, c_long, c_ptr
         type(c_ptr), value :: stream
         integer(c_long), value :: offset
         integer(c_int), value :: from
      end function c_fseek
      integer(c_int) function c_fflush(stream) bind(c, name="fflush")
         import :: c_int, c_ptr
         type(c_ptr), value :: stream
      end function c_fflush
      integer(c_int) function c_fileno(stream) bind(c, name="fileno")
         import :: c_int, c_ptr
         type(c_ptr), value :: stream
      end function c_fileno
      integer(c_int) function c_fsync(descriptor) bind(c, name="fsync")
         import :: c_int
         integer(c_int), value :: descriptor
      end function c_fsync
      integer(c_int) function c_fclose(stream) bind(c, name="fclose")
         import :: c_int, c_ptr
         type(c_ptr), value :: stream
      end function c_fclose
   end interface

contains

   !> Open a file to read from it, to write a new one, or to `write_on` after its first bytes.
   subroutine open_bytes(path, mode, file, after, sum)
      character(len=*), intent(in) :: path, mode
      type(byte_file_t), intent(out) :: file
      integer(i8), intent(in), optional :: after   !! bytes; 0 unless given
      integer(i8), intent(in), optional :: sum(2)  !! their checksum

      if (present(sum)) file%sum = sum
      if (present(after)) file%bytes = after
      file%reads = mode == read_from
      if (.not. is_pipe(path)) file%stream = c_fopen(path//c_null_char, mode//c_null_char)
      file%ok = c_associated(file%stream)
      if (file%ok .and. present(after)) file%ok = c_fseek(file%stream, int(after, c_long), 0_c_int) == 0
   end subroutine open_bytes

   !> Read or write some bytes.
   subroutine pass_bytes(file, data, bytes)
      type(byte_file_t), intent(inout) :: file
      type(*), intent(inout), target :: data(*)
      integer(i8), intent(in) :: bytes
      integer(c_size_t) :: done

      if (.not. file%ok .or. bytes == 0) return
      if (file%reads) then
         done = c_fread(data, 1_c_size_t, int(bytes, c_size_t), file%stream)
      else
         done = c_fwrite(data, 1_c_size_t, int(bytes, c_size_t), file%stream)
      end if
      file%ok = done == bytes
      file%bytes = file%bytes + done
      if (file%ok) call add_words(file%sum, data, bytes)
   end subroutine pass_bytes

   subroutine put_text(file, text)
      type(byte_file_t), intent(inout) :: file
      character(len=*), intent(in) :: text
      character(len=1) :: byte(len(text))

      byte = transfer(text, byte)
      call pass_bytes(file, byte, size(byte, kind=i8))
   end subroutine put_text

   !> Close a file; one that was written is then on disk if it is still `ok`.
   subroutine close_bytes(file)
      type(byte_file_t), intent(inout) :: file
      integer(c_int) :: status

      if (.not. c_associated(file%stream)) return
      if (.not. file%reads) then
         status = c_fflush(file%stream)
         if (status == 0) status = c_fsync(c_fileno(file%stream))
         file%ok = file%ok .and. status == 0
      end if
      status = c_fclose(file%stream)
      file%ok = file%ok .and. status == 0
      file%stream = c_null_ptr
   end subroutine close_bytes

   !> Bring the names in a folder to disk; whether it worked.
   logical function sync_folder(path) result(ok)
      character(len=*), intent(in) :: path
      type(c_ptr) :: stream
      integer(c_int) :: status

      stream = c_fopen(path//c_null_char, read_from//c_null_char)
      ok = c_associated(stream)
      if (.not. ok) return
      ok = c_fsync(c_fileno(stream)) == 0
      status = c_fclose(stream)
   end function sync_folder

   !> Fletcher's checksum (J. G. Fletcher 1982, IEEE Trans. Commun. 30) of whole words of 32 bits, modulo the
   !> first prime past 2**32, so that no two words are the same, as zeros and ones are modulo 2**32 - 1: fifty times
   !> as fast as SHA-256, for bytes that nobody forges.
   subroutine add_words(sum, data, bytes)
      integer(i8), intent(inout) :: sum(2)
      type(*), intent(in), target :: data(*)
      integer(i8), intent(in) :: bytes
      integer(i8), parameter :: low32 = 2_i8**32 - 1, modulus = 2_i8**32 + 15
      integer(i8), parameter :: piece = 2_i8**15 - 1  !! words whose sums of sums stay below 2**63
      integer(i4), pointer :: word(:)
      integer(i8) :: first, k

      call c_f_pointer(c_loc(data), word, [bytes/4])
      do first = 1, size(word, kind=i8), piece
         do k = first, min(size(word, kind=i8), first + piece - 1)
            sum(1) = sum(1) + iand(int(word(k), i8), low32)
            sum(2) = sum(2) + sum(1)
         end do
         sum = mod(sum, modulus)
      end do
   end subroutine add_words
end module rockfall_bytefile
