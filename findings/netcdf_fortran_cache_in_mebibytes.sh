#!/bin/bash
# SPDX-License-Identifier: BSD-3-Clause
# netCDF-Fortran 4.5.4 takes `cache_size` of a variable in MiB; C and Python take bytes.
#
# Expected: nf90_def_var(..., cache_size=, cache_nelems=, cache_preemption=) passes the size in bytes to
# nc_set_var_chunk_cache, as netCDF4 for Python does (Variable.set_var_chunk_cache).
# Happens: the number is multiplied by 2**20 without a warning: 4096 gives a cache of 4 GiB. nf90_inquire_variable
# divides by 2**20 again, so a test in Fortran reads the number that it wrote.
# Matters: with the size of a chunk in bytes, nothing ever leaves the cache. A program that streams a large file keeps
# all of it in memory, variable by variable, until memory is exhausted.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
command -v nf-config >/dev/null || apt-get install -qq -y --no-install-recommends gfortran libnetcdff-dev libnetcdf-dev >/dev/null
nf-config --version
cat >cache.f90 <<'END'
program cache
   use, intrinsic :: iso_c_binding, only: c_int, c_size_t, c_float
   use netcdf
   implicit none

   interface
      integer(c_int) function nc_get_var_chunk_cache(ncid, varid, size, slots, preemption) bind(c)
         import :: c_int, c_size_t, c_float
         integer(c_int), value :: ncid, varid
         integer(c_size_t) :: size, slots
         real(c_float) :: preemption
      end function nc_get_var_chunk_cache
   end interface
   integer :: file, dim, variable, back
   integer(c_size_t) :: bytes, slots
   real(c_float) :: preemption

   call check(nf90_create("file.nc", nf90_netcdf4, file))
   call check(nf90_def_dim(file, "n", 100000, dim))
   call check(nf90_def_var(file, "v", nf90_double, [dim], variable, chunksizes=[1000], &
                           cache_size=4096, cache_nelems=101, cache_preemption=75))
   call check(nf90_inquire_variable(file, variable, cache_size=back))
   call check(nc_get_var_chunk_cache(file, variable - 1, bytes, slots, preemption))
   print "(a, i0)", "asked for ", 4096, "read back by Fortran ", back, "bytes in the C library ", bytes
   call check(nf90_close(file))

contains

   subroutine check(status)
      integer, intent(in) :: status

      if (status /= nf90_noerr) error stop 2
   end subroutine check
end program cache
END
gfortran cache.f90 $(nf-config --fflags) $(nf-config --flibs) -lnetcdf -o cache
./cache | tee said
grep -qx "bytes in the C library 4294967296" said || { echo "cache_size is in other units now"; exit 1; }
