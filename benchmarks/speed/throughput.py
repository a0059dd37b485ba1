# SPDX-License-Identifier: BSD-3-Clause
"""Cost of a rebound: CPU nanoseconds by option and by instruction set, wall time by threads, and
the parts of the time.

    python -m benchmarks.speed.throughput [--boulders 20000] [--repeat 5]

Each value is the minimum of `--repeat` runs; the first values also have a mean with standard error.
CPU time includes all threads and the kernel's calls, but not reading and writing files. On a busy
machine only ratios are meaningful.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
from typing import Any, NamedTuple

import numpy as np
from rockfall._core import rockfall_f2py as _core

import rockfall
from benchmarks.machine import LANES, NOTHING, ROOT, VAUJANY, machine
from rockfall.result import variables
from rockfall.scene.read import read_scene
from rockfall.scene.scene import Scene
from rockfall.simulation.simulate import run_scene

MAPS = ["passages", "reach_probability", "deposits", "energy_max", "energy_mean"]
MAPS += ["speed_max_map", "jump_height_max_map"]
EVERY_MAP = list(variables.MAP)


def lines_across(count: int) -> list[dict[str, Any]]:
    """Evaluation lines across the slope, from below the source down."""
    y = np.linspace(560.0, 300.0, count)
    return [{"name": f"line {k}", "x": [1.25, 198.75], "y": [at, at]} for k, at in enumerate(y)]


OPTIONS = {
    "nothing asked for": {"line": [], "output": NOTHING},
    "two evaluation lines": {"output": NOTHING},
    "lines, histograms": {"output": NOTHING | {"rebounds": True}},
    "lines, passages": {"output": NOTHING | {"maps": ["passages"]}},
    "lines, seven maps": {"output": NOTHING | {"maps": MAPS}},
    "lines, every map": {"output": NOTHING | {"maps": EVERY_MAP}},
    "method A": {"line": [], "output": NOTHING, "surface": {"method": "A"}},
    "100 lines": {"line": lines_across(100), "output": NOTHING},
    "1000 lines": {"line": lines_across(1000), "output": NOTHING},
    "100 lines, no rows": {"line": lines_across(100), "output": NOTHING | {"kept": "none"}},
}
BY_THREADS = "nothing asked for", "two evaluation lines", "lines, seven maps", "100 lines, no rows"


class Runs(NamedTuple):
    """Runs of a scene: CPU and wall seconds of each run; rebounds and boulders of one run."""

    cpu: np.ndarray
    wall: np.ndarray
    rebounds: int
    boulders: int

    def rebound(self) -> float:
        """Minimum CPU nanoseconds per rebound."""
        return 1e9 * self.cpu.min() / self.rebounds

    def over(self, one: Runs) -> str:
        """Text with the speed-up over the runs `one`, and with the ratio of the CPU times."""
        faster, dearer = one.wall.min() / self.wall.min(), self.cpu.min() / one.cpu.min()
        return f"{faster:18.2f} x{dearer:20.2f}"


def measure(scene: Scene, threads: int, repeat: int) -> Runs:
    """Run a scene `repeat` times; return times and counts."""
    runs = [run_scene(scene, threads=threads) for _ in range(repeat)]
    cpu, wall = (
        np.array([run.attrs[key] for run in runs]) for key in ("cpu_seconds", "wall_seconds")
    )
    return Runs(cpu, wall, int(runs[0]["rebounds"]), int(runs[0].attrs["boulders_requested"]))


def parts() -> None:
    """Print the time of each part of a rebound, from a program in the build folder."""
    build = ROOT / "build"
    if not (shutil.which("ninja") and (build / "build.ninja").exists()):
        print("\n(no build folder: the parts of a rebound are left out)")
        return
    subprocess.run(
        ["ninja", "-C", build, "benchmarks/parts"], check=True, stdout=subprocess.DEVNULL
    )
    print("\nParts of a rebound, each alone in a loop")
    print(subprocess.run([build / "benchmarks/parts"], capture_output=True, text=True).stdout)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--boulders", type=int, default=20_000)
    parser.add_argument("--repeat", type=int, default=5)
    options = parser.parse_args()
    print(machine(), "\n")
    vaujany = rockfall.read_case(VAUJANY)
    vaujany = vaujany.replace(case={"boulders": options.boulders})

    head = f"{'cases/vaujany, one thread':28}{'ns/rebound':>12}{'mean':>10}{'s.e.':>6}"
    print(f"{head}{'boulders/CPU s':>16}")
    for name, change in OPTIONS.items():
        runs = measure(read_scene(vaujany.replace(**change)), 1, options.repeat)
        each = 1e9 * runs.cpu / runs.rebounds
        error = each.std(ddof=1) / np.sqrt(each.size)
        print(
            f"{name:28}{each.min():12.0f}{each.mean():10.1f}{error:6.1f}"
            f"{runs.boulders / runs.cpu.min():16.0f}"
        )

    print(f"\n{'ns/rebound':28}" + "".join(f"{way:>16}" for way in LANES))
    for name in list(OPTIONS)[:5]:
        scene = read_scene(vaujany.replace(**OPTIONS[name]))
        row = f"{name:28}"
        for lanes in LANES.values():
            _core.carry_in_lanes(scene.kernel.handle, lanes)
            row += f"{measure(scene, 1, options.repeat).rebound():16.0f}"
        print(row)

    print(f"\n{'threads':28}{'wall, one = 1':>20}{'CPU':>20}")
    for name in BY_THREADS:
        scene = read_scene(vaujany.replace(**OPTIONS[name]))
        first = measure(scene, 1, options.repeat)
        for threads in (n for n in (2, 4, 8, 16, 32, 64) if n <= os.cpu_count()):
            runs = measure(scene, threads, options.repeat)
            print(f"{name:24}{threads:4}{runs.over(first)}")
    parts()


if __name__ == "__main__":
    main()
