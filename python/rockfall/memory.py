# SPDX-License-Identifier: BSD-3-Clause
"""How much memory there is for a run."""

from __future__ import annotations

import os
import re
import resource
from pathlib import Path

from rockfall.errors import RockfallError

UNITS = {"": 1, "k": 1e3, "m": 1e6, "g": 1e9, "t": 1e12}


def machine_memory() -> float:
    """Bytes that this process may use: of the machine, of its job (control group), of its shell."""
    limits = [os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")]
    limits += [limit for limit in resource.getrlimit(resource.RLIMIT_AS)[:1] if limit > 0]
    for file in _control_group():
        try:
            limits.append(int(file.read_text()))
        except (OSError, ValueError):  # no such limit, or "max"
            continue
    return float(min(limits))


def _control_group() -> list[Path]:
    """The files that may hold a limit: of the process's group and of all above it."""
    root = Path("/sys/fs/cgroup")
    try:
        own = re.search(r"^0::/(.*)$", Path("/proc/self/cgroup").read_text(), re.MULTILINE)
    except OSError:
        return []
    group = root / own[1] if own else root
    above = [place for place in (group, *group.parents) if place.is_relative_to(root)]
    return [place / "memory.max" for place in above]


def read_memory(text: str) -> float:
    """Bytes from a text such as 500MB, 4G or 1.5 TB.

    A RockfallError says what it must be.
    """
    found = re.fullmatch(r"(\d+(?:\.\d*)?|\.\d+) *([kmgt]?)b?", text.strip(), re.IGNORECASE)
    if not found or float(found[1]) == 0:
        raise RockfallError(f"--memory {text}: must be a size such as 500MB or 4GB")
    return float(found[1]) * UNITS[found[2].lower()]
