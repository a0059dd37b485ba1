! SPDX-License-Identifier: BSD-3-Clause
!> Lengths of texts and rows declared by interfaces to other languages; f2py reads them here.
module rockfall_dimensions
   implicit none
   private
   public :: max_message, max_list, max_array_row
   public :: n_boulder_fields, n_boulder_counts, n_line_fields, n_vertex_fields, n_line_quantities
   public :: n_impact_sets, n_set_numbers, n_incidence_limits, n_lateral_classes, n_lateral_quantiles
   public :: n_map_counts, n_map_sums, n_map_maxima, n_stacks, n_histograms, n_ead_classes, n_block_shapes

   integer, parameter :: max_message = 1024   !! one-line error message; equals ROCKFALL_MESSAGE in include/rockfall.h
   integer, parameter :: max_list = 512       !! row of a table, list of names
   integer, parameter :: max_array_row = 256  !! row of the table of arrays; equals ROCKFALL_TEXT in include/rockfall.h

   ! Numbers of columns of each kind of row (names in rockfall_variables):
   integer, parameter :: n_boulder_fields = 12, n_boulder_counts = 9, n_line_fields = 12, n_vertex_fields = 15
   integer, parameter :: n_line_quantities = 11  !! quantities of line samples, computed from a row
   ! Number of impact sets, and the lengths of their arrays: means, class limits of incidence, incidence classes,
   ! quantiles of a class.
   integer, parameter :: n_impact_sets = 5, n_set_numbers = 9, n_incidence_limits = 8, n_lateral_classes = 9, &
                         n_lateral_quantiles = 13
   ! Map tallies: numbers of counts (including thresholds), sums and maxima in `map_plan_t`; number of stacks.
   integer, parameter :: n_map_counts = 7, n_map_sums = 7, n_map_maxima = 5, n_stacks = 3
   integer, parameter :: n_histograms = 6, n_ead_classes = 8  !! quantities of rebounds; energy classes of EAD 340059
   integer, parameter :: n_block_shapes = 3  !! block shapes of the laboratory
end module rockfall_dimensions
