# SPDX-License-Identifier: BSD-3-Clause
"""What a benchmark ran on: a claim without its machine is no claim."""

import os
import platform
from importlib.metadata import version
from pathlib import Path

ROOT = Path(__file__).parents[1]  # of the repository


def machine() -> str:
    """One line: processor, cores, load, system, program version."""
    cpu = platform.processor() or "unknown processor"
    info = Path("/proc/cpuinfo")
    if info.exists():
        names = [line for line in info.read_text().splitlines() if line.startswith("model name")]
        cpu = names[0].split(":")[1].strip() if names else cpu
    load = f"load {os.getloadavg()[0]:.1f}"
    program = f"rockfall {version('rockfall')}"
    return ", ".join([cpu, f"{os.cpu_count()} cores", load, platform.platform(), program])
