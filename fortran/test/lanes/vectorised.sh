#!/bin/sh
# SPDX-License-Identifier: BSD-3-Clause
# The loops over lanes are vector instructions in a program: their roots (flight, landing, frame, law, turn) are
# packed, of contacts by tables in the wide copies. MASKS: the least in the copy for AVX-512.
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
      check("narrow roots", narrow_roots, 10)  # the turn and most of tables stay scalar there, as gfortran 12 links it
      check("wide roots", wide_roots, 20)
      check("masked roots", masked_roots, 20)
      check("masks", masks, least_masks)
      exit fallen
   }'
