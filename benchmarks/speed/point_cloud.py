# SPDX-License-Identifier: BSD-3-Clause
"""CPU time and memory for reading LAZ point clouds in `rockfall dem`.

    python -m benchmarks.speed.point_cloud [--million 10] [--tiles 5] [--times 2] [--thin 2.0]
                                           [--folder DIR]

Tiles of millions of points (point format 6, in centimetres) lie side by side. Points are uniform
over a slope, ten per square metre, all ground, in strips like those of a scanner. All tiles are
read `--times` times, as one cloud. Memory is the peak of the reading process above that for 1,000
points. Existing tiles in --folder are used again.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

import laspy
import numpy as np

DENSITY = 10.0  # points per area [1/m2]
READER = """
import resource, sys, time
from rockfall.io.vectors.point_clouds import read_clouds
begin = time.process_time()
points, _ = read_clouds(sys.argv[2:], thin=float(sys.argv[1]) or None)
peak = 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
print(len(points), time.process_time() - begin, peak)
"""


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--million", type=float, default=10.0, help="points of a tile")
    parser.add_argument("--tiles", type=int, default=5)
    parser.add_argument("--times", type=int, default=2)
    parser.add_argument("--thin", type=float, default=2.0, help="0: all points are kept")
    parser.add_argument("--folder", type=Path, help="default: a temporary one")
    given = parser.parse_args()
    each = round(given.million * 1e6)
    with tempfile.TemporaryDirectory() as temporary:
        folder = given.folder or Path(temporary)
        _, _, base = _measured([_tile(folder / "few.laz", 0, 1000)], 0.0)
        tiles = [_tile(folder / f"{k}.laz", k, each) for k in range(given.tiles)]
        kept, seconds, peak = _measured(tiles * given.times, given.thin)
        size = given.times * sum(tile.stat().st_size for tile in tiles)
    print(f"{each * given.tiles * given.times:,} points, {size / 1e6:,.0f} MB of LAZ")
    print(f"--thin {given.thin:g}: {kept:,.0f} points kept")
    print(f"{seconds:.0f} s of CPU, {(peak - base) / 1e6:,.0f} MB beyond {base / 1e6:,.0f} MB")


def _tile(path: Path, number: int, points: int) -> Path:
    """Write the tile with a given number, east of the previous tiles, unless it exists."""
    if path.exists():
        return path
    random = np.random.default_rng(number)
    side = (points / DENSITY) ** 0.5
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = [0.01] * 3, [2600000.0, 1200000.0, 0.0]
    las = laspy.LasData(header)
    x, y = random.uniform(0, side, (2, points))
    order = np.lexsort((x, y // 10))
    x, y = x[order], y[order]
    las.x, las.y = 2600000.0 + number * side + x, 1200000.0 + y
    las.z = 500 + 0.7 * y + random.normal(0, 0.05, points)
    las.classification = np.full(points, 2)
    las.write(path)
    return path


def _measured(tiles: list[Path], thin: float) -> tuple[float, float, float]:
    """Number of points kept, CPU time [s], and peak memory [bytes]."""
    words = [sys.executable, "-c", READER, str(thin), *map(str, tiles)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(done.stderr)
    kept, seconds, peak = map(float, done.stdout.split())
    return kept, seconds, peak


if __name__ == "__main__":
    main()
