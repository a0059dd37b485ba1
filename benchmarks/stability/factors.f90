! SPDX-License-Identifier: BSD-3-Clause
!> Draws matrices A = m + L z from a covariance. Reads a number of draws and the 81 entries of the covariance. Prints
!> whether the covariance is used as given (1) or through its root (0), the 81 entries of the root by columns, the sums
!> of the nine deviations from the mean, and the sums of their 81 products.
program factors
   use rockfall_kinds, only: wp, i8
   use rockfall_error, only: error_t
   use rockfall_random, only: random_key, normal_table, normal, random_words, for_impact
   use rockfall_covariance, only: covariance_root
   implicit none
   type(error_t), allocatable :: error
   real(wp) :: c(9, 9), root(9, 9), drawn(9, 9), a(9), sums(9), products(9, 9)
   integer(i8) :: words(12), n, k, draw

   read *, n, c
   call covariance_root("covariance", c, root, drawn, error)
   if (allocated(error)) then
      print "(a)", error%message
      stop 2, quiet=.true.
   end if
   sums = 0
   products = 0
   associate (table => normal_table(), key => random_key(1_i8))
      do k = 1, n
         words = [(random_words(key, for_impact, k, 1_i8, draw), draw=0, 2)]
         a = matmul(root, normal(table, words(:9)))
         sums = sums + a
         products = products + spread(a, 2, 9)*spread(a, 1, 9)
      end do
   end associate
   print "(i0,/,*(1x,es24.16e3))", merge(1, 0, all(abs(drawn - c) <= 0)), root, sums, products
end program factors
