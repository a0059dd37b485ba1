# SPDX-License-Identifier: BSD-3-Clause
"""Peak memory of a run on a large DEM, compared with its limit.

    python -m benchmarks.speed.memory [--side 10000]

Makes DEMs with `--side` squared cells in a temporary folder, runs `rockfall run` and, if found,
`rockfall-batch`, and reads the peak memory of each from the system. A run may use 8 bytes per DEM
cell, 4 per zone cell, the requested outputs (4 per map cell, 8 more for the sums of energy_mean,
120 per boulder), and 100 MB. Boulders start all over the DEM, so that no page of a map stays
untouched.
"""

import argparse
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from affine import Affine

from benchmarks.machine import machine, run_child

CELL = 2.5
ROWS = 256  # rows per tile

CASE = """&case boulders = 1, seed = 1, title = 'memory' /
&terrain dem = '{dem}' /
&surface {surface} /
&impact sets = 'vaujany-observed' /
&boulder volume = 'fixed', volume_mean = 1.0 /
&release cells = '{cells}', drop_height = 5.0 /
&output maps = {maps} /
"""
MAPS = "passages reach_probability deposits energy_max energy_mean speed_max_map".split()
MAPS += ["jump_height_max_map"]
UNIFORM, ZONES = "uniform_mean_radius = 0.25", "zones = 'zones.tif', table = 'zones.csv'"


def profile(side: int) -> np.ndarray:
    """Elevations of a row [m]: valleys 2 km wide, with slopes of up to 45 degrees."""
    x = (np.arange(side) + 0.5) * CELL
    return np.round(1000.0 + 318.0 * np.cos(2 * np.pi * x / 2000.0), 2)


def sources(side: int) -> np.ndarray:
    """Mask of the source cells in a row (uint8): one per valley, high on its slope."""
    return (np.arange(side) % int(2000.0 / CELL) == 80).astype("u1")


def make_tiff(path: Path, row: np.ndarray) -> None:
    """Write a tiled and compressed GeoTIFF with identical rows."""
    import rasterio
    from rasterio.windows import Window

    side = row.size
    about = {
        "driver": "GTiff", "width": side, "height": side, "count": 1, "dtype": row.dtype.name,
        "transform": Affine(CELL, 0, 0, 0, -CELL, side * CELL), "tiled": True,
        "blockxsize": ROWS, "blockysize": ROWS, "compress": "deflate", "zlevel": 1,
    }  # fmt: skip
    with rasterio.Env(GDAL_CACHEMAX=16), rasterio.open(path, "w", **about) as file:
        for first in range(0, side, ROWS):
            rows = min(ROWS, side - first)
            block = np.broadcast_to(row, (rows, side))
            file.write(block, 1, window=Window(0, first, side, rows))


def make_files(folder: Path, side: int) -> None:
    z = profile(side)
    make_tiff(folder / "single.tif", z.astype("f4"))
    make_tiff(folder / "double.tif", z)
    make_tiff(folder / "zones.tif", (1 + np.arange(side) * 8 // side).astype("u1"))
    make_tiff(folder / "cells.tif", sources(side))
    radii = "\n".join(f"{zone},{0.1 + 0.05 * zone:.2f}" for zone in range(1, 9))
    (folder / "zones.csv").write_text(f"zone,mean_radius\n{radii}\n")


def measure(folder: Path, what: str, side: int, program: str = "", **case: str) -> None:
    """Print a row of the table: memory allowed for a run, and used by it."""
    asked = MAPS if case["maps"] == "all" else [case["maps"]]
    case["maps"] = ", ".join(f"'{name}'" for name in asked)
    (folder / "case.nml").write_text(CASE.format(**case))
    cell = 8 + 4 * (case["surface"] == ZONES) + 4 * len(asked) + 8 * ("energy_mean" in asked)
    most = cell * side**2 + 120 * int(sources(side).sum()) * side + 100_000_000
    rockfall = [sys.executable, "-m", "rockfall"]  # a child's peak includes that of its parent
    command = [*rockfall, "run", "case.nml", "--quiet"]
    if program:
        shutil.rmtree(folder / "ready", ignore_errors=True)
        subprocess.run([*rockfall, "prepare", "case.nml", "ready"], cwd=folder, check=True)
        command = [program, "ready/case.nml", "--quiet"]
    found = run_child(*command, cwd=folder)[2]
    verdict = "within" if found <= most else f"OVER by {(found - most) / 1e6:.0f} MB"
    door = "rockfall-batch" if program else "rockfall run"
    print(f"{door:16}{what:36}{most / 1e6:10.0f}{found / 1e6:10.0f}   {verdict}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--side", type=int, default=10_000)
    side = parser.parse_args().side
    print(machine())
    print(f"{side} x {side} cells, {sources(side).sum() * side:,} boulders\n")
    print(f"{'':52}{'may MB':>10}{'takes MB':>10}")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        make_files(folder, side)
        tiff = {"dem": "single.tif", "surface": UNIFORM, "cells": "cells.tif", "maps": "passages"}
        measure(folder, "float32, one R_m, passages", side, **tiff)
        measure(folder, "float32, zones, passages", side, **tiff | {"surface": ZONES})
        measure(
            folder, "float32, zones, all maps", side, **tiff | {"surface": ZONES, "maps": "all"}
        )
        tiff["dem"] = "double.tif"
        measure(folder, "float64, one R_m, passages", side, **tiff)
        measure(folder, "float64, zones, passages", side, **tiff | {"surface": ZONES})
        if program := shutil.which("rockfall-batch"):
            measure(folder, "float64, one R_m, passages", side, program, **tiff)
        else:
            print("(rockfall-batch is not on the PATH)")


if __name__ == "__main__":
    main()
