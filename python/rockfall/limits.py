# SPDX-License-Identifier: BSD-3-Clause
"""Limits of the machine and of the kernel."""

import os

from rockfall._core import rockfall_f2py as _core
from rockfall.system import physical_memory

MACHINE_MEMORY = physical_memory()  # bytes
#: Processors available to this process; on macOS, all processors of the machine.
CORES = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
MAX_TEXT = int(_core.constant("max_text"))  # maximum bytes of a text file
MAX_ELEVATION = _core.constant("max_elevation")  # [m]; higher values are undeclared nodata
MAX_NAME = int(_core.constant("max_name"))  # maximum characters of a name in a case
MAX_REAL = _core.constant("max_real")  # maximum of numbers in a case, and of coordinates [m]
MAX_HELD = _core.constant("max_held_speed")  # [sqrt(g R_b)] boulders faster than this leave hollows
MIN_FOR_MEAN = int(_core.constant("min_for_mean"))  # minimum boulders for an interval of the mean
MIN_FOR_STD = int(_core.constant("min_for_std"))
