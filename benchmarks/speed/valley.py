# SPDX-License-Identifier: BSD-3-Clause
"""Large valley: cost of maps and of a large terrain, in time and memory.

    python -m benchmarks.speed.valley [--side 4000] [--sources 10000] [--each 100] [--large 10000]

First 100 boulders from each of 10,000 cells of a synthetic relief of 4000 x 4000 cells, with and
without maps: CPU time of the complete programs, and peak memory compared with `rockfall check`.
Then the cost of a rebound in a basin of 200 x 200 cells, and in the same basin within 10,000 x
10,000 cells of repeated basins: CPU time of the kernel, minimum of `--repeat` runs in turn.
"""

import argparse
import multiprocessing
import sys
import tempfile
from pathlib import Path

import numpy as np
from affine import Affine

import rockfall
from benchmarks.machine import NOTHING, machine, run_child
from rockfall.result.dataset import open_result
from rockfall.scene.read import read_scene
from rockfall.scene.scene import Scene
from rockfall.simulation.simulate import run_chunks, start

CELL = 2.5  # cell size [m]
VALLEYS = 1500.0  # width of the largest hills [m]
STEEP = 0.8  # root mean square of the gradient: half of the ground is steeper than 33 degrees
BASIN = 200  # side of the basin [cells]
MAPS = ["passages", "energy_max", "energy_q50", "energy_q95"]
SAME = {
    "impact": {"sets": "vaujany-observed"},
    "surface": {"uniform_mean_radius": 0.25},
    "boulder": {"volume": "lognormal", "volume_mean": 0.8, "volume_std": 0.4, "density": 2800.0},
}


def relief(
    side: int, random: np.random.Generator, widest: float = VALLEYS, cell: float = CELL
) -> np.ndarray:
    """Elevations [m] of a fractal, periodic relief: amplitudes decrease with the power 2.6 of the
    wave number, so that slopes come from hills rather than single cells."""
    ky, kx = np.fft.fftfreq(side, cell)[:, None], np.fft.rfftfreq(side, cell)[None]
    k2 = kx**2 + ky**2
    wave = random.normal(size=k2.shape) + 1j * random.normal(size=k2.shape)
    z = np.fft.irfft2(wave * (k2 + widest**-2.0) ** -1.3, s=(side, side))
    gradient = np.mean([np.mean(np.diff(z, axis=axis) ** 2) for axis in (0, 1)]) * 2 / cell**2
    return (2000.0 + (z - z.mean()) * STEEP / np.sqrt(gradient)).astype("f4")


def steep_cells(z: np.ndarray, number: int, random: np.random.Generator) -> np.ndarray:
    """Mask (uint8) of at most `number` random cells steeper than 50 degrees, away from the
    edges."""
    north, east = np.gradient(z[100:-100, 100:-100], CELL)
    steep = np.flatnonzero(np.pad(np.hypot(north, east) > np.tan(np.radians(50)), 100))
    cells = np.zeros(z.size, "u1")
    cells[random.choice(steep, min(number, steep.size), replace=False)] = 1
    return cells.reshape(z.shape)


def write_tiff(path: Path, values: np.ndarray) -> None:
    import rasterio

    about = {"driver": "GTiff", "count": 1, "dtype": values.dtype.name, "tiled": True}
    about |= {"height": values.shape[0], "width": values.shape[1], "compress": "deflate"}
    transform = Affine(CELL, 0, 0, 0, -CELL, values.shape[0] * CELL)
    with rasterio.open(path, "w", transform=transform, **about) as file:
        file.write(values, 1)


def program(*words: str | Path) -> tuple[str, float, int]:
    """Output of a `rockfall` command, its CPU seconds, and its peak memory [bytes]."""
    return run_child(sys.executable, "-m", "rockfall", *words)


def make_files(folder: Path, side: int, sources: int) -> None:
    random = np.random.default_rng(1)
    z = relief(side, random)
    write_tiff(folder / "dem.tif", z)
    write_tiff(folder / "cells.tif", steep_cells(z, sources, random))


def whole_valley(folder: Path, each: int, threads: int) -> None:
    case = rockfall.Case(
        case={"boulders": each, "title": "a valley", "threads": threads},
        terrain={"dem": folder / "dem.tif"},
        release={"cells": folder / "cells.tif", "drop_height": 2.0},
        **SAME,
    )
    path, out, took = folder / "case.nml", folder / "out.nc", []
    for maps in (None, MAPS):
        path.write_text(case.replace(output=NOTHING | {"maps": maps}).text())
        check, _, _ = program("check", path)
        estimated = next(line for line in check.splitlines() if line.split()[0] == "memory")
        _, cpu, peak = program("run", path, "--quiet", "-o", out)
        took.append(cpu)
        with open_result(out) as result:
            boulders, rebounds = result.sizes["boulder"], int(result["rebounds"])
            kernel = result.attrs["cpu_seconds"]
        print("with" if maps else "without", "maps:", f"{boulders:,} boulders,", end=" ")
        print(f"{rebounds:,} rebounds, {cpu:.1f} s of CPU, {kernel:.1f} s of them in the kernel")
        print(f"  {peak / 1e6:.0f} MB at most; check estimates {estimated.split(maxsplit=1)[1]}")
    print(f"maps cost {took[1] - took[0]:.1f} s of CPU; aim: 60 s for 1,000,000 boulders")


def basin() -> np.ndarray:
    """Rough periodic basin with sides of up to 43 degrees; boulders that start below the lowest
    point of its rim stay inside."""
    x = 2 * np.pi * (np.arange(BASIN) + 0.5) / BASIN
    smooth = 70.0 * (np.cos(x)[:, None] + np.cos(x)[None])
    rough = relief(BASIN, np.random.default_rng(2), widest=50.0) - 2000.0
    return (2000.0 + smooth + 0.1 * rough).astype("f4")


def basin_scene(copies: int, boulders: int, maps: list[str] | None) -> Scene:
    """Scene of `copies` x `copies` basins, with ten sources high in the central basin."""
    side = BASIN * copies
    west = BASIN * (copies // 2)
    row = west + np.linspace(0.4, 0.6, 10) * BASIN
    case = rockfall.Case(
        case={"boulders": boulders // 10},
        release={
            "x": (10 * [(west + 0.12 * BASIN) * CELL]),
            "y": ((side - row) * CELL).tolist(),
            "drop_height": 2.0,
        },
        output=NOTHING | {"maps": maps},
        **SAME,
    )
    z = np.tile(basin(), (copies, copies))
    return read_scene(case, dem=z, transform=Affine(CELL, 0, 0, 0, -CELL, side * CELL))


def nanoseconds(scene: Scene) -> tuple[float, int]:
    """CPU time of the kernel per rebound on one thread [ns], and number of rebounds."""
    tally = start(scene, threads=1)
    run_chunks(tally, None, lambda: False, lambda _: None)
    rebounds = int(tally.array("rebounds"))
    return 1e9 * tally.cpu / rebounds, rebounds


def sizes_of_terrain(large: int, boulders: int, repeat: int) -> None:
    print(f"a rebound, {boulders:,} boulders from ten sources, least of {repeat} runs; aim: 20 %")
    for maps in (None, MAPS):
        scenes = [basin_scene(copies, boulders, maps) for copies in (1, large // BASIN)]
        runs = [[nanoseconds(scene) for scene in scenes] for _ in range(repeat)]
        least = [min(run[k][0] for run in runs) for k in range(2)]
        print("with" if maps else "without", f"maps: {least[1] / least[0] - 1:+.1%}", end="")
        for scene, took, (_, rebounds) in zip(scenes, least, runs[0], strict=True):
            size = "{} x {}".format(*scene.rasters.z.shape)
            print(f"; {size} cells: {took:.0f} ns, {rebounds:,} rebounds", end="")
        print(flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--side", type=int, default=4000, help="cells of the valley, each way")
    parser.add_argument("--sources", type=int, default=10_000)
    parser.add_argument("--each", type=int, default=100, help="boulders from each source")
    parser.add_argument("--large", type=int, default=10_000, help="cells of the large terrain")
    parser.add_argument("--boulders", type=int, default=50_000, help="in the basin")
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--threads", type=int, default=1)
    options = parser.parse_args()
    print(machine(), "\n")
    with tempfile.TemporaryDirectory() as name:
        # in another process: the peak memory of child processes includes that of this one
        files = (Path(name), options.side, options.sources)
        maker = multiprocessing.get_context("spawn").Process(target=make_files, args=files)
        maker.start()
        maker.join()
        whole_valley(Path(name), options.each, options.threads)
    print()
    sizes_of_terrain(options.large, options.boulders, options.repeat)


if __name__ == "__main__":
    main()
