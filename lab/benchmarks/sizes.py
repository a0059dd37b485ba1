# SPDX-License-Identifier: BSD-3-Clause
"""A plane of tables for boulders of all sizes and reliefs, compared with tables simulated for them:

    python -m lab.benchmarks.sizes talus [--radii 0.35 0.6 1 1.8 3] [--slopes 30 34 38]
        [--reliefs 12.75 17.75]

Each table is simulated with blocks of one R_b, on their ground or with another relief [degree], at
the same strength. The plane of tables selects among its parts by boulder and ground (theory, eq.
5.25). Prints for both the fraction of compact boulders that passes 200 m of a plane, with a
standard error, and the mean speed there.
"""

import argparse
import tempfile
import warnings
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

import rockfall
from benchmarks.machine import machine
from lab.benchmarks.plane import plane
from rockfall.grounds.impact_tables import save_table
from rockfall.result.crossings import at_lines
from rockfall_lab.blocks.case import BlockCase, grounds
from rockfall_lab.blocks.contacts import run_throws
from rockfall_lab.tables import table_of

SHAPE, DENSITY, BOULDERS = "compact", 2700.0, 600
# Length of the plane [m], distance of the line [m], initial speed [m/s]:
LENGTH, LINE, SPEED = 400.0, 200.0, 5.0
CELL, COLUMNS, ABOVE = 2.5, 120, 8


def on_plane(keys: dict[str, dict[str, Any]], radius: float, slope: float, folder: Path) -> str:
    """Passing fraction with its standard error, and mean speed, as text, of boulders on an even
    slope; `keys` of the case select the table."""
    angle = np.radians(slope)
    rows = int((LENGTH * np.cos(angle) + 80) / CELL)
    top, width = (rows - ABOVE) * CELL, COLUMNS * CELL
    at = top - LINE * np.cos(angle)
    case = rockfall.Case(
        folder=folder,
        case={"boulders": BOULDERS, "seed": 7},
        impact={"form": "table"} | keys["impact"],
        surface={"uniform_mean_radius": 0.1} | keys.get("surface", {}),
        boulder={
            "volume": "fixed", "volume_mean": 4 / 3 * np.pi * radius**3, "density": DENSITY,
            "ground_strength_sigma": 0.0,
        },
        release={
            "x": [width / 2], "y": [top], "drop_height": 0.5,
            "velocity": [0.0, -SPEED * np.cos(angle), -SPEED * np.sin(angle)],
        },
        line=[{"name": "line", "x": [0.0, width], "y": [at, at]}],
    )  # fmt: skip
    result = rockfall.run(case, **plane(slope, rows, COLUMNS, CELL))
    speeds = at_lines(result)["line_speed"].isel(line=0).values
    speeds = speeds[~np.isnan(speeds)]
    part = len(speeds) / BOULDERS
    error = np.sqrt(part * (1 - part) / BOULDERS)
    return f"{part:.2f} ± {error:.2f}" + (f", {speeds.mean():.1f} m/s" if len(speeds) else "")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("ground", choices=list(grounds()))
    parser.add_argument("--radii", type=float, nargs="+", default=[0.35, 0.6, 1, 1.8, 3])
    parser.add_argument("--slopes", type=float, nargs="+", default=[30, 34, 38])
    parser.add_argument("--reliefs", type=float, nargs="+", default=[None], help="[degree]")
    parser.add_argument("--throws", type=int, default=1500)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    warnings.simplefilter("ignore")  # a table needs no rock sizes
    print(machine())
    print(
        "| R_b [m] | relief [degree] | slope | by the plane of tables | by a table of this size |"
    )
    print("|---|---|---|---|---|")
    lab = {
        "ground": given.ground, "shape": SHAPE, "throws": given.throws, "seed": given.seed,
    }  # fmt: skip
    for radius, relief in product(given.radii, given.reliefs):
        case = BlockCase(lab=lab).at_radius(radius)
        shipped = {"impact": {"table": given.ground}}
        if relief is not None:
            case = case.replace(ground={"relief": relief})
            shipped["surface"] = {"ground_relief": relief}
        with tempfile.TemporaryDirectory() as folder:
            save_table(table_of([run_throws(case)]), Path(folder) / "own.nc")
            for slope in given.slopes:
                found = [
                    on_plane(keys, radius, slope, Path(folder))
                    for keys in (shipped, {"impact": {"table": "own.nc"}})
                ]
                cells = [f"{radius:g}", f"{case.ground['relief']:.1f}", f"{slope:g}", *found]
                print(f"| {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
