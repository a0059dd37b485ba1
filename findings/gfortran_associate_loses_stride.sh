#!/bin/bash
# SPDX-License-Identifier: BSD-3-Clause
# gfortran 12.2.0 and 14.2.0: an ASSOCIATE name of a row loses its stride when it is passed to an explicit-shape dummy.
#
# Expected: with `associate (v => a(k, :3))`, the call f(v) passes the elements a(k, 1), a(k, 2), a(k, 3), as the call
# f(a(k, :3)) does: gfortran packs a section into a temporary for a dummy v(3).
# Happens: f(v) gets the address of a(k, 1) and no temporary, so it reads a(k, 1), a(k+1, 1), a(k+2, 1). There is no
# warning, and -fcheck=all reports nothing. Elementwise use of v within the block is right, so a block may be right in
# one statement and wrong in the next.
# Matters: ASSOCIATE is how Fortran code gives names to rows of arrays of vectors; physics with dummies such as v(3) then
# computes with components of other particles, and results look plausible.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
command -v gfortran-12 >/dev/null || apt-get install -qq -y --no-install-recommends gfortran-12 >/dev/null
gfortran-12 --version | head -n 1
cat >rows.f90 <<'END'
module sums
   implicit none
contains
   pure real function total(v)
      real, intent(in) :: v(3)
      total = v(1) + v(2) + v(3)
   end function total

   subroutine print_sums(a, n)
      integer, intent(in) :: n
      real, intent(in) :: a(n, 3)
      associate (v => a(1, :3))
         print '(a, 3f6.1)', "associated, section, in place:", total(v), total(a(1, :3)), v(1) + v(2) + v(3)
      end associate
   end subroutine print_sums
end module sums

program rows
   use sums, only: print_sums
   implicit none
   integer :: j, k
   real :: a(4, 3)
   a = reshape([((10.0*k + j, k=1, 4), j=1, 3)], [4, 3])
   call print_sums(a, 4)
end program rows
END
for options in -O0 "-O2 -fcheck=all"; do
   # shellcheck disable=SC2086
   gfortran-12 $options -Wall -Wextra rows.f90 -o rows
   ./rows 2>/dev/null | tee found
   # a(1, :) is 11, 12, 13: 36 in all; 11 + 21 + 31 is 63
   grep -qx "associated, section, in place:  63.0  36.0  36.0" found
done
echo "as stated"
