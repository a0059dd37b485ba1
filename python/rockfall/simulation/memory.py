# SPDX-License-Identifier: BSD-3-Clause
"""Memory available for a run."""

import re
from contextlib import suppress
from pathlib import Path

import numpy as np

from rockfall.errors import RockfallError
from rockfall.limits import MACHINE_MEMORY
from rockfall.result.variables import TYPES
from rockfall.system import memory_limits

#: Memory [bytes] for a crossing at an evaluation line.
BYTES_AT_LINE = sum(np.dtype(kind).itemsize for kind in TYPES["crossing"].values())
#: Bytes for a crossing in a result file, where its integers compress to less than a byte in total.
BYTES_IN_FILE = 1 + sum(
    np.dtype(kind).itemsize for kind in TYPES["crossing"].values() if np.dtype(kind).kind == "f"
)
ROOM = 0.5  # fraction of the memory available for boulders at lines
UNITS = {"": 1, "k": 1e3, "m": 1e6, "g": 1e9, "t": 1e12}


def machine_memory() -> float:
    """Memory [bytes] available to this process: the smallest limit of machine, job (control group)
    and shell."""
    limits = [MACHINE_MEMORY, *memory_limits()]
    with suppress(OSError):
        for file in limit_files(Path("/proc/self/cgroup").read_text()):
            with suppress(OSError, ValueError):  # no limit, or "max"
                limits.append(int(file.read_text()))
    return float(min(limits))


def limit_files(groups: str) -> list[Path]:
    """Files with possible memory limits of the process's control group and its parents, in the
    unified hierarchy or the older memory hierarchy. `groups` is the text of /proc/self/cgroup."""
    files = []
    for pattern, root, name in (
        (r"^0::/(.*)$", Path("/sys/fs/cgroup"), "memory.max"),
        (
            r"^\d+:(?:.*,)?memory(?:,.*)?:/(.*)$",
            Path("/sys/fs/cgroup/memory"),
            "memory.limit_in_bytes",
        ),
    ):
        if match := re.search(pattern, groups, re.MULTILINE):
            own = root / match[1]
            files += [at / name for at in (own, *own.parents) if at.is_relative_to(root)]
    return files


def read_memory(text: str) -> float:
    """Number of bytes from a text such as 500MB, 4G or 1.5 TB.

    Other texts raise a RockfallError with the allowed form.
    """
    match = re.fullmatch(r"(\d+(?:\.\d*)?|\.\d+) *([kmgt]?)b?", text.strip(), re.IGNORECASE)
    if not match or float(match[1]) == 0:
        raise RockfallError(f"--memory {text}: must be a size such as 500MB or 4GB")
    return float(match[1]) * UNITS[match[2].lower()]
