#!/bin/sh
# SPDX-License-Identifier: BSD-3-Clause
# The loops over lanes must be vector instructions: square roots of flight, landing, local frame, rebound and turn are
# packed; of contacts from tables only in the wide versions. MASKS: minimum in the AVX-512 version.
#
# Usage: vectorised.sh PROGRAM MASKS
objdump -d --no-show-raw-insn "$1" | awk -v least_masks="$2" '
   /^[0-9a-f]+ <.*>:$/ {
      masked = /rockfall_masked_((table_)?lanes|flights)_MOD/
      wide = /rockfall_wide_((table_)?lanes|flights)_MOD/
      narrow = /rockfall_((table_)?lanes|flights)_MOD/
   }
   narrow && /[^v]sqrtpd/ { narrow_roots++ }
   wide && /vsqrtpd.*ymm/ { wide_roots++ }
   masked && /vsqrtpd.*ymm/ { masked_roots++ }
   masked && /vcmp.*pd.*%k/ { masks++ }
   function check(what, found, least) {
      printf "%s: %d packed, %d at least\n", what, found, least
      if (found < least) fallen = 1
   }
   END {
      check("narrow roots", narrow_roots, 10)  # here gfortran 12 leaves the turn and most of tables scalar
      check("wide roots", wide_roots, 20)
      check("masked roots", masked_roots, 20)
      check("masks", masks, least_masks)
      exit fallen
   }'
