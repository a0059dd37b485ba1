# SPDX-License-Identifier: BSD-3-Clause
"""Limits of the machine, and limits and rules of the kernel that files and statistics share."""

import os

from rockfall._core import rockfall_f2py as _core

MACHINE_MEMORY = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")  # bytes
MAX_TEXT = int(_core.constant("max_text"))  # bytes of a file of text
MAX_ELEVATION = _core.constant("max_elevation")  # [m]; more is an undeclared nodata value
MAX_REAL = _core.constant("max_real")  # of a case, and coordinates [m]
PIECE = int(_core.constant("piece"))  # values of a part or a scene that share a checksum
Z = _core.constant("z_95")  # of a normal distribution, 95 % within
fraction_limits = _core.fraction_limits  # of the 95 % interval of a fraction of n (Wilson 1927)
EAD_ENERGY = tuple(_core.ead_energies().tolist())  # of barriers of classes 0 to 7 [J]
barrier_outcomes = _core.barrier_outcomes  # of a barrier with boulders that come to it
