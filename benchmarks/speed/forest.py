# SPDX-License-Identifier: BSD-3-Clause
"""Cost of trees per rebound, and the memory of a large forest.

    python -m benchmarks.speed.forest [--boulders 20000] [--repeat 3] [--trees 1000000]

The slope of `cases/vaujany` without options, on one thread; stems of 30 cm. With trees of real
strength, boulders stop early. With stems that absorb no energy and turn boulders by at most 22.5
degrees, they continue as without trees, which gives the cost per rebound. CPU time is the kernel's,
the minimum of `--repeat` runs. Memory is the increase of the process by a scene with these trees,
at its peak and once it is built.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

import rockfall
from benchmarks.machine import NOTHING, VAUJANY, machine
from rockfall.scene.read import read_scene
from rockfall.simulation.simulate import run_scene

DENSITIES = (0, 100, 500, 1000)  # stems per hectare
AIM = 2.0  # times the cost without trees, at 500 stems
STAND = {"uniform_dbh_mean": 30.0, "uniform_dbh_std": 0.0, "uniform_conifers": 60.0}
AHEAD = dict.fromkeys(("turn_frontal", "turn_lateral", "turn_scratch"), [1.0, 0.0, 0.0])
WEAK = "species,genus,factor\nconifer,,1e-9\nbroadleaf,,1e-9\n"
MEMORY = """
import sys
import numpy as np
import rockfall
from rockfall.io.rasters.grid import Grid
from rockfall.scene.read import read_scene
import scipy.special, rasterio
trees, side = int(sys.argv[1]), 2000
case = rockfall.Case(
    case={"boulders": 1}, surface={"uniform_mean_radius": 0.2}, boulder={"volume_mean": 1.0},
    release={"x": [5000.0], "y": [5000.0], "drop_height": 1.0},
    forest={} if not trees else {
        "uniform_stems": trees / (side * 5.0) ** 2 * 1e4, "uniform_dbh_mean": 30.0,
        "uniform_dbh_std": 10.0, "uniform_conifers": 60.0},
)
z = np.zeros((side, side), "f4") + np.arange(side, dtype="f4")
scene = read_scene(case, dem=z, transform=Grid(0.0, side * 5.0, 5.0, side, side))
_ = scene.kernel
about = dict(line.split(":") for line in open("/proc/self/status"))
print(*(1024 * int(about[key].split()[0]) for key in ("VmRSS", "VmHWM")))
"""


def nanoseconds(case: rockfall.Case, repeat: int) -> tuple[float, float, float]:
    """CPU time per rebound [ns], and rebounds and tree hits per boulder."""
    scene, least = read_scene(case), np.inf
    for _ in range(repeat):
        result = run_scene(scene, threads=1)
        least = min(least, result.attrs["cpu_seconds"])
    rebounds = int(result["rebounds"])
    hits = float(result["trees_hit"].mean()) if "trees_hit" in result else 0.0
    return least / rebounds * 1e9, rebounds / result.sizes["boulder"], hits


def resident(trees: int) -> np.ndarray:
    """Memory of a process with trees [bytes]: once the scene is built, and at the peak."""
    done = subprocess.run(
        [sys.executable, "-c", MEMORY, str(trees)], capture_output=True, text=True, check=True
    )
    return np.array(done.stdout.split(), float)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--boulders", type=int, default=20_000)
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--trees", type=int, default=1_000_000)
    arguments = parser.parse_args()
    print(machine())
    case = rockfall.read_case(VAUJANY)
    case = case.replace(line=[], output=NOTHING, case={"boulders": arguments.boulders})
    with tempfile.TemporaryDirectory() as folder:
        weak = Path(folder) / "weak.csv"
        weak.write_text(WEAK)
        for about, more in (
            ("as they are", {}),
            ("that take nothing", {"species_table": weak} | AHEAD),
        ):
            print(f"\nTrees {about}\nstems/ha  ns/rebound  ratio  rebounds  hits of a boulder")
            first = 0.0
            for density in DENSITIES:
                forest = STAND | more | {"uniform_stems": density} if density else {}
                cost, rebounds, hits = nanoseconds(case.replace(forest=forest), arguments.repeat)
                first = first or cost
                print(
                    f"{density:8}  {cost:10.0f}  {cost / first:5.2f}  {rebounds:8.1f}  {hits:.2f}"
                )
    added = (resident(arguments.trees) - resident(0)) / 1e6
    print(f"\n{arguments.trees:,} trees: {added[0]:.0f} MB when they stand, {added[1]:.0f} at most")


if __name__ == "__main__":
    main()
