#!/bin/sh
# SPDX-License-Identifier: BSD-3-Clause
# Check that the loops over lanes are vectorised, by counting packed square roots and divisions. The link copies each
# loop for each kind of run, and a single copy may become scalar, so the minimum numbers are those of gfortran 12: adapt
# them when the loops change. QUOTIENTS: minimum number of divisions with AVX2, and with AVX-512; MASKS: minimum number
# of masked instructions with AVX-512.
#
# Usage: vectorised.sh PROGRAM QUOTIENTS MASKS
objdump -d --no-show-raw-insn "$1" | awk -v least_quotients="$2" -v least_masks="$3" '
   /^[0-9a-f]+ <.*>:$/ {
      masked = /rockfall_masked_((table_)?lanes|flights)_MOD/
      wide = /rockfall_wide_((table_)?lanes|flights)_MOD/
      narrow = /rockfall_((table_)?lanes|flights)_MOD/
   }
   narrow && /[^v]sqrtpd/ { narrow_roots++ }
   narrow && /[^v]divpd/ { narrow_quotients++ }
   wide && /vsqrtpd.*ymm/ { wide_roots++ }
   wide && /vdivpd.*ymm/ { wide_quotients++ }
   masked && /vsqrtpd.*ymm/ { masked_roots++ }
   masked && /vdivpd.*ymm/ { masked_quotients++ }
   masked && /vcmp.*pd.*%k/ { masks++ }
   function check(what, found, least) {
      printf "%s: %d packed, %d at least\n", what, found, least
      if (found < least) fallen = 1
   }
   END {
      check("narrow roots", narrow_roots, 18)  # here gfortran 12 leaves the turn and most of tables scalar
      check("narrow quotients", narrow_quotients, 33)
      check("wide roots", wide_roots, 36)
      check("wide quotients", wide_quotients, least_quotients)
      check("masked roots", masked_roots, 36)
      check("masked quotients", masked_quotients, least_quotients)
      check("masks", masks, least_masks)
      exit fallen
   }'
