# SPDX-License-Identifier: BSD-3-Clause
"""Cost of many evaluation lines from a layer: check and run of a case with few boulders, and report
of a result with a few dozen lines.

    python -m benchmarks.speed.lines [--lines 1000 4000 20000] [--reported 40]

Prints wall and CPU seconds of each command; on a busy machine use the CPU times.
"""

import argparse
import contextlib
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pyogrio
import rasterio
import shapely

from benchmarks.machine import machine

WEST, NORTH, CELL, CRS = 2600000.0, 1200000.0, 5.0, "EPSG:2056"
ROWS, COLUMNS = 400, 300
CASE = """&case boulders = {boulders} /
&terrain dem = 'dem.tif' /
&surface uniform_mean_radius = 0.3 /
&boulder volume_mean = 1.0 /
&release x = 2600700.0, 2600710.0, y = 1199950.0, 1199950.0, drop_height = 5.0 /
&line file = 'lines.gpkg' /
"""


def write_inputs(folder: Path, count: int, boulders: int) -> None:
    """Write a slope of 31 degrees, and lines across it from the top down."""
    z = 2000.0 - 3.0 * np.arange(ROWS)[:, None] + np.zeros((ROWS, COLUMNS))
    place = rasterio.transform.from_origin(WEST, NORTH, CELL, CELL)
    about = {"width": COLUMNS, "height": ROWS, "count": 1, "dtype": "float64", "crs": CRS}
    with rasterio.open(folder / "dem.tif", "w", driver="GTiff", transform=place, **about) as file:
        file.write(z, 1)
    y = NORTH - 100 - np.linspace(0, 1000, count)
    shapes = [shapely.LineString([(WEST + 100, at), (WEST + 1400, at)]) for at in y]
    names = np.array([f"line {k}" for k in range(count)], object)
    wkb = np.array([shapely.to_wkb(one) for one in shapes], object)
    pyogrio.raw.write(
        folder / "lines.gpkg", wkb, [names], ["name"], geometry_type="LineString", crs=CRS,
        driver="GPKG",
    )  # fmt: skip
    (folder / "case.nml").write_text(CASE.format(boulders=boulders))


def timed(*words: str) -> tuple[float, float]:
    """Wall and CPU seconds of a command."""
    before, begun = os.times(), time.perf_counter()
    command = [sys.executable, "-m", "rockfall", *words]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    after = os.times()
    cpu = after.children_user + after.children_system
    return time.perf_counter() - begun, cpu - before.children_user - before.children_system


@contextlib.contextmanager
def site(count: int, boulders: int) -> Iterator[None]:
    with TemporaryDirectory() as folder, contextlib.chdir(folder):
        write_inputs(Path(folder), count, boulders)
        yield


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--lines", type=int, nargs="+", default=[1000, 4000, 20000])
    parser.add_argument("--reported", type=int, default=40)
    options = parser.parse_args()
    print(machine())
    print(f"{'lines':>7} {'command':<8} {'wall [s]':>9} {'CPU [s]':>9}")
    for count in options.lines:
        with site(count, boulders=1):
            for words in (["check", "case.nml"], ["run", "case.nml", "--quiet"]):
                wall, cpu = timed(*words)
                print(f"{count:7d} {words[0]:<8} {wall:9.1f} {cpu:9.1f}", flush=True)
    with site(options.reported, boulders=1000):
        timed("run", "case.nml", "--quiet")
        wall, cpu = timed("report", "case.nc")
        print(f"{options.reported:7d} {'report':<8} {wall:9.1f} {cpu:9.1f}")


if __name__ == "__main__":
    main()
