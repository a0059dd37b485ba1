# SPDX-License-Identifier: BSD-3-Clause
"""Description of the machine, needed for every result, and code shared by benchmarks."""

import os
import platform
import subprocess
import sys
import time
from importlib.metadata import version
from pathlib import Path

ROOT = Path(__file__).parents[1]  # folder of the repository
VAUJANY = ROOT / "cases/vaujany/case.nml"
NOTHING = {"maps": None, "rebounds": False, "trajectories": 0}  # &output without optional outputs
# Execution modes, as in rockfall_scene_type:
LANES = {"one by one": 0, "any processor": 1, "with AVX2": 2, "with AVX-512": 3}


def machine() -> str:
    """One line with processor, cores, load, system and program version."""
    cpu = platform.processor() or "unknown processor"
    info = Path("/proc/cpuinfo")
    if info.exists():
        names = [line for line in info.read_text().splitlines() if line.startswith("model name")]
        cpu = names[0].split(":")[1].strip() if names else cpu
    load = f"load {os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else "load unknown"
    program = f"rockfall {version('rockfall')}"
    return ", ".join([cpu, f"{os.cpu_count()} cores", load, platform.platform(), program])


def best_turns(pythons: list, folders: list[Path], words: list[str], repeat: int) -> list[tuple]:
    """Minimum wall and CPU seconds and peak memory [bytes] of a rockfall command, run in turn by
    several Python programs, each in its folder."""
    best = [(float("inf"),) * 3] * len(pythons)
    for _ in range(repeat):
        for k, (python, folder) in enumerate(zip(pythons, folders, strict=True)):
            begun = time.perf_counter()
            _, cpu, peak = run_child(python, "-m", "rockfall", *words, cwd=folder)
            best[k] = tuple(map(min, best[k], (time.perf_counter() - begun, cpu, peak)))
    return best


def run_child(*words: str | Path, cwd: Path | None = None) -> tuple[str, float, int]:
    """Output of a command, its CPU seconds, and its peak memory [bytes]."""
    env = os.environ | {"PYTHONDONTWRITEBYTECODE": ""}  # compiled modules are kept, as usual
    child = subprocess.Popen(
        [*map(str, words)], cwd=cwd, stdout=subprocess.PIPE, text=True, env=env
    )
    said = child.stdout.read()
    _, status, usage = os.wait4(child.pid, 0)
    if status:
        sys.exit(f"{' '.join(map(str, words))}: failed")
    return said, usage.ru_utime + usage.ru_stime, usage.ru_maxrss * 1024
