# SPDX-License-Identifier: BSD-3-Clause
"""Many boulders on real terrain: each must end for a reason, and none may pass through the ground.

    python -m benchmarks.stability.real_terrain DEM... [--boulders 100000] [--audit 100000]

Releases boulders from all cells steeper than `--slope` degrees and follows them to their end. Then
repeats `--audit` of these with recorded trajectories, and measures, independently of the kernel,
the maximum depth below the bilinear surface along every flight: at every crossing of a grid line,
at minima of the height in between, and at every contact.
"""

import argparse
import math
from pathlib import Path

import numpy as np

import rockfall
from rockfall.io.rasters.dem import read_dem
from rockfall.scene.read import read_scene
from rockfall.simulation.simulate import fields, run_scene, trajectory

GRAVITY = 9.81


def steep_cells(z: np.ndarray, cell: float, degrees: float) -> np.ndarray:
    """Cells steeper than `degrees` by Horn's differences, not at the edge or next to nodata."""
    w = z.astype(float)
    west, east = w[:, :-2], w[:, 2:]
    north, south = w[:-2], w[2:]
    gx = (east[:-2] - west[:-2]) + 2 * (east[1:-1] - west[1:-1]) + (east[2:] - west[2:])
    gy = (north[:, :-2] - south[:, :-2]) + 2 * (north[:, 1:-1] - south[:, 1:-1])
    gy += north[:, 2:] - south[:, 2:]
    steep = np.zeros(z.shape, np.int32)
    with np.errstate(invalid="ignore"):
        steep[1:-1, 1:-1] = np.hypot(gx, gy) / (8 * cell) > math.tan(math.radians(degrees))
    return steep


def height(z: np.ndarray, cell: float, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Bilinear surface [m]; x, y [m] east and south of the centre of the first cell."""
    column = np.clip((x / cell).astype(int), 0, z.shape[1] - 2)
    row = np.clip((y / cell).astype(int), 0, z.shape[0] - 2)
    u, w = x / cell - column, y / cell - row
    upper = z[row, column] * (1 - u) + z[row, column + 1] * u
    lower = z[row + 1, column] * (1 - u) + z[row + 1, column + 1] * u
    return upper * (1 - w) + lower * w


def crossings(start: np.ndarray, speed: np.ndarray, time: np.ndarray, cell: float):
    """Flight and time of every crossing of a grid line along one axis."""
    first = np.minimum(start, start + speed * time) / cell
    last = np.maximum(start, start + speed * time) / cell
    count = np.maximum(0, np.floor(last) - np.ceil(first) + 1).astype(int)
    flight = np.repeat(np.arange(start.size), count)
    place = np.arange(flight.size) - np.repeat(np.cumsum(count) - count, count)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = ((np.ceil(first)[flight] + place) * cell - start[flight]) / speed[flight]
    return flight, np.clip(np.nan_to_num(t), 0, time[flight])


def deepest(z: np.ndarray, grid, vertices: list[np.ndarray]) -> tuple[float, int]:
    """Maximum depth [m] below the surface along trajectories, and number of flights."""
    column = {name: k for k, name in enumerate(fields("vertex"))}
    start = np.concatenate([v[:-1] for v in vertices])
    end = np.concatenate([v[1:] for v in vertices])
    time = end[:, column["time"]] - start[:, column["time"]]
    x = start[:, column["x"]] - (grid.west + grid.cell / 2)
    y = (grid.north - grid.cell / 2) - start[:, column["y"]]
    vx, vy, vz = (start[:, column[f"velocity_{axis}"]] for axis in "xyz")
    vy = -vy
    parts = [crossings(x, vx, time, grid.cell), crossings(y, vy, time, grid.cell)]
    ends = np.arange(time.size)
    flight = np.concatenate([parts[0][0], parts[1][0], ends, ends])
    t = np.concatenate([parts[0][1], parts[1][1], 0 * time, time])
    order = np.lexsort((t, flight))
    flight, t = flight[order], t[order]

    def above(k: np.ndarray, t: np.ndarray) -> np.ndarray:
        ground = height(z, grid.cell, x[k] + vx[k] * t, y[k] + vy[k] * t)
        return start[k, column["z"]] + t * (vz[k] - GRAVITY * t / 2) - ground

    inner = np.flatnonzero(flight[1:] == flight[:-1])
    k, t0, t1 = flight[inner], t[inner], t[inner + 1]
    middle = (t0 + t1) / 2
    d0, dm, d1 = above(k, t0), above(k, middle), above(k, t1)
    bend = d0 - 2 * dm + d1
    with np.errstate(divide="ignore", invalid="ignore"):
        least = np.clip(np.nan_to_num(0.5 + (d0 - d1) / (4 * bend)), 0, 1)
    heights = np.concatenate([d0, dm, d1, above(k, t0 + least * (t1 - t0))])
    return float(-np.nanmin(heights)), time.size


def examine(path: Path, boulders: int, slope: float, audit: int) -> None:
    z, grid = read_dem(path)
    cells = steep_cells(z, grid.cell, slope)
    sources = int(cells.sum())
    case = rockfall.Case(
        case={"boulders": math.ceil(boulders / sources), "title": path.name},
        terrain={"dem": path},
        surface={"uniform_mean_radius": 0.25},
        impact={"sets": "vaujany-observed"},
        boulder={"volume": "lognormal", "volume_mean": 1.0, "volume_std": 1.0},
        release={"cells": "cells", "drop_height": 2.0},
        flight={"gravity": GRAVITY},
    )
    scene = read_scene(case, cells=cells)
    result = run_scene(scene, progress=True)
    print(f"\n{path.name}: {grid.nx} x {grid.ny} cells of {grid.cell:g} m, {sources} sources")
    total = result.sizes["boulder"]
    status = result["status"]
    words = status.attrs["flag_meanings"].split()
    ends = {word: int((status == k).sum()) for k, word in enumerate(words, 1)}
    print(f"  boulders {total}, ends {ends}, without a reason {total - sum(ends.values())}")
    rebounds = int(result["rebounds"])
    print(f"  rebounds {rebounds}, CPU {1e9 * result.attrs['cpu_seconds'] / rebounds:.0f} ns each")
    deep, flights = -math.inf, 0
    numbers = np.unique(np.linspace(1, total, min(audit, total)).astype(int))
    for part in np.array_split(numbers, math.ceil(numbers.size / 500)):
        depth, count = deepest(z, grid, [trajectory(scene, int(number)) for number in part])
        deep, flights = max(deep, depth), flights + count
    print(
        f"  audited {numbers.size} boulders, {flights} flights: deepest below ground {deep:.1e} m"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("dem", nargs="+", type=Path)
    parser.add_argument("--boulders", type=int, default=100_000)
    parser.add_argument("--slope", type=float, default=50.0)
    parser.add_argument("--audit", type=int, default=100_000)
    options = parser.parse_args()
    for path in options.dem:
        examine(path, options.boulders, options.slope, options.audit)


if __name__ == "__main__":
    main()
