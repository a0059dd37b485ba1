# SPDX-License-Identifier: BSD-3-Clause
"""Cost per rebound of crossing terrain patches, by cell size and by maps.

    python -m benchmarks.speed.walk [--boulders 100] [--repeat 5] [--program rockfall-batch]

A steep relief with cells of half a metre; coarser cells use every second node, every fifth, and so
on. Then `cases/vaujany` with maps, on one and on two threads. CPU time is the minimum of `--repeat`
runs on one thread; instructions are of rockfall-batch under callgrind, as in `costs.py`.
"""

import argparse
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from affine import Affine

import rockfall
from benchmarks.machine import NOTHING, ROOT, VAUJANY, machine
from benchmarks.speed.costs import per_rebound
from benchmarks.speed.throughput import EVERY_MAP, MAPS, measure
from benchmarks.speed.valley import SAME, relief
from rockfall.scene.prepare import prepare
from rockfall.scene.read import read_scene

FINEST, SIDE = 0.5, 2401  # cell size [m], nodes along each side
STEEPER = 1.4  # factor on the valley's relief: gradients of 48 degrees, root mean square
CELLS = (10.0, 5.0, 2.5, 1.0, 0.5)  # cell sizes [m]
SOURCES = 100
ASKED = {"nothing": None, "passages": ["passages"], "seven maps": MAPS, "every map": EVERY_MAP}


def ground() -> tuple[np.ndarray, np.ndarray]:
    """Elevations of the finest nodes, and source nodes (row, column): from the steepest fifth of
    the nodes common to all cell sizes, away from the edges."""
    random = np.random.default_rng(1)
    z = STEEPER * relief(SIDE, random, cell=FINEST)
    shared = round(max(CELLS) / FINEST)
    steep = np.hypot(*np.gradient(z[::shared, ::shared]))[10:-10, 10:-10]
    places = np.argwhere(steep > np.quantile(steep, 0.8)) + 10
    return z, shared * random.choice(places, SOURCES, replace=False)


def on_cells(cell: float, each: int, folder: Path) -> tuple[dict[str, Any], rockfall.Case]:
    """Arrays and case on cells of a given size [m], with sources at the same nodes."""
    z, nodes = ground()
    step = round(cell / FINEST)
    z = z[::step, ::step]
    x, y = nodes[:, 1] * FINEST, ((SIDE - 1) - nodes[:, 0]) * FINEST
    case = rockfall.Case(
        case={"boulders": each, "title": f"cells of {cell} m"},
        release={"x": x.tolist(), "y": y.tolist(), "drop_height": 2.0},
        output=NOTHING,
        folder=folder,
        **SAME,
    )
    north = (SIDE - 1) * FINEST + cell / 2
    return {"dem": z, "transform": Affine(cell, 0, -cell / 2, 0, -cell, north)}, case


def tell(name: str, case: rockfall.Case, options: argparse.Namespace, **arrays: Any) -> None:
    """Print a line: CPU nanoseconds and instructions per rebound, impacts per boulder."""
    runs = measure(read_scene(case, **arrays), 1, options.repeat)
    with tempfile.TemporaryDirectory() as folder:
        prepare(case, Path(folder) / "case", **arrays)
        counted = per_rebound(options.program, Path(folder) / "case/case.nml", options.few)
    print(f"{name:28}{runs.rebound():12.0f}{counted:14.0f}{runs.rebounds / runs.boulders:12.1f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--boulders", type=int, default=100, help="from each source of the relief")
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--program", type=Path, default=ROOT / "build/fortran/rockfall-batch")
    options = parser.parse_args()
    print(machine(), "\n")
    print(f"{'relief, cells of':28}{'ns/rebound':>12}{'instructions':>14}{'rebounds':>12}")
    options.few = 1
    with tempfile.TemporaryDirectory() as folder:
        for cell in CELLS:
            arrays, case = on_cells(cell, options.boulders, Path(folder))
            tell(f"{cell} m", case, options, **arrays)
        tell(f"{cell} m, seven maps", case.replace(output={"maps": MAPS}), options, **arrays)
    vaujany = rockfall.read_case(VAUJANY).replace(case={"boulders": 20_000}, line=[])
    print(f"\n{'cases/vaujany, asked for':28}")
    options.few = 100
    for name, maps in ASKED.items():
        tell(name, vaujany.replace(output=NOTHING | {"maps": maps}), options)
    print(f"\n{'two threads, one = 1':28}{'wall':>20}{'CPU':>20}")
    for name, maps in ASKED.items():
        scene = read_scene(vaujany.replace(output=NOTHING | {"maps": maps}))
        one, two = (measure(scene, threads, options.repeat) for threads in (1, 2))
        print(f"{name:28}{two.over(one)}")


if __name__ == "__main__":
    main()
