# SPDX-License-Identifier: BSD-3-Clause
"""Time and memory in which `rockfall dem` makes a DEM of a point cloud.

    python -m benchmarks.speed.point_cloud [--million 100] [--tiles 10] [--thin 1.0] [--folder DIR]

Tiles of LAZ (point format 6, hundredths of a metre) lie side by side; their points are drawn evenly
over a slope, ten to the square metre, all ground. Memory is the peak of the process that reads
them, beyond what it takes for a cloud of 1,000 points.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import laspy
import numpy as np

DENSITY = 10.0  # [1/m2]
MADE_OF = """
import resource, sys
from rockfall.cli import main
status = main(sys.argv[1:])
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, file=sys.stderr)
sys.exit(status)
"""


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--million", type=float, default=100.0, help="points")
    parser.add_argument("--tiles", type=int, default=10)
    parser.add_argument("--thin", type=float, default=1.0, help="0: all points are kept")
    parser.add_argument("--folder", type=Path, help="for the tiles; default: a temporary one")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=given.folder) as folder:
        few = [_tile(Path(folder) / "few.laz", 0, 1000)]
        _, base = _measured(few, 0.0, Path(folder))
        each = round(given.million * 1e6 / given.tiles)
        tiles = [_tile(Path(folder) / f"{k}.laz", k, each) for k in range(given.tiles)]
        seconds, memory = _measured(tiles, given.thin, Path(folder))
        size = sum(tile.stat().st_size for tile in tiles)
    points = each * given.tiles
    print(f"{points:,} points, {size / 1e6:,.0f} MB of LAZ, --thin {given.thin:g}")
    print(f"{seconds:.0f} s, {(memory - base) / 1e6:,.0f} MB beyond {base / 1e6:,.0f} MB")


def _tile(path: Path, number: int, points: int) -> Path:
    """Write the tile of a number, east of those before it."""
    random = np.random.default_rng(number)
    side = (points / DENSITY) ** 0.5
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = [0.01] * 3, [2600000.0, 1200000.0, 0.0]
    las = laspy.LasData(header)
    x, y = random.uniform(0, side, (2, points))
    order = np.lexsort((x, y // 10))  # in strips, as a scanner flies
    x, y = x[order], y[order]
    las.x, las.y = 2600000.0 + number * side + x, 1200000.0 + y
    las.z = 500 + 0.7 * y + random.normal(0, 0.05, points)
    las.classification = np.full(points, 2)
    las.write(path)
    return path


def _measured(tiles: list[Path], thin: float, folder: Path) -> tuple[float, float]:
    """Seconds, and bytes at the peak."""
    options = ["--thin", str(thin)] if thin else []
    words = ["dem", *map(str, tiles), "-o", str(folder / "dem.tif"), "--overwrite", *options]
    begin = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-c", MADE_OF, *words], capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise SystemExit(done.stderr)
    return time.perf_counter() - begin, 1024.0 * int(done.stderr.split()[-1])


if __name__ == "__main__":
    main()
