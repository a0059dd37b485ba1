! SPDX-License-Identifier: BSD-3-Clause
!> Lengths of texts and rows that interfaces to other languages declare; f2py reads them here.
module rockfall_sizes
   implicit none
   private
   public :: max_message, max_list, max_array_row
   public :: n_boulder_fields, n_boulder_counts, n_line_fields, n_vertex_fields

   integer, parameter :: max_message = 1024   !! one-line error message; as ROCKFALL_MESSAGE in include/rockfall.h
   integer, parameter :: max_list = 512       !! row of a table, list of names
   integer, parameter :: max_array_row = 256  !! row of the table of arrays; as ROCKFALL_TEXT there

   ! Columns of rows (rockfall_variables has their names):
   integer, parameter :: n_boulder_fields = 12, n_boulder_counts = 9, n_line_fields = 12, n_vertex_fields = 14
end module rockfall_sizes
