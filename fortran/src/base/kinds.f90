! SPDX-License-Identifier: BSD-3-Clause
!> Number kinds used by the whole program.
module rockfall_kinds
   use, intrinsic :: iso_fortran_env, only: int8, int16, int32, int64, real32, real64
   implicit none
   private
   public :: wp, sp, i1, i2, i4, i8, i16

   integer, parameter :: wp = real64  !! working precision: all physics
   integer, parameter :: sp = real32  !! single-precision rasters
   integer, parameter :: i1 = int8    !! zone indices of cells, with few zones
   integer, parameter :: i2 = int16   !! zone indices of cells
   integer, parameter :: i4 = int32   !! counts per cell
   integer, parameter :: i8 = int64   !! boulder numbers, random words, sums
   integer, parameter :: i16 = selected_int_kind(38)  !! products of sums
end module rockfall_kinds
