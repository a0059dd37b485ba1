! SPDX-License-Identifier: BSD-3-Clause
!> Zeroed memory for large arrays, allocated lazily so that untouched pages cost nothing; prefetching.
module rockfall_memory
   use, intrinsic :: iso_c_binding, only: c_ptr, c_null_ptr, c_associated
   use rockfall_kinds, only: i8
   implicit none
   private
   public :: zeroed_block, free_block, prefetch

   interface
      type(c_ptr) function c_zeros(n, size) bind(c, name="rockfall_zeros")
         import :: c_ptr, i8
         integer(i8), value :: n, size
      end function c_zeros
      subroutine c_free(block) bind(c, name="free")
         import :: c_ptr
         type(c_ptr), value :: block
      end subroutine c_free

      !> Prefetch the cache line of a value.
      pure subroutine prefetch(value) bind(c, name="rockfall_prefetch")
         type(*), intent(in) :: value
      end subroutine prefetch
   end interface

contains

   !> Block of max(n, 1) zeros; null if memory is short.
   type(c_ptr) function zeroed_block(n, bytes) result(block)
      integer(i8), intent(in) :: n
      integer, intent(in) :: bytes  !! size of each [bytes]

      block = c_zeros(max(1_i8, n), int(bytes, i8))
   end function zeroed_block

   !> Free a block; no effect on null.
   impure elemental subroutine free_block(block)
      type(c_ptr), intent(inout) :: block

      if (c_associated(block)) call c_free(block)
      block = c_null_ptr
   end subroutine free_block
end module rockfall_memory
