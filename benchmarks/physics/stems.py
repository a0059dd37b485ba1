# SPDX-License-Identifier: BSD-3-Clause
"""Energy of a boulder after hitting a stem, compared with the discrete element model of Toe et al.
(2018), whose results are part of PlatRock 0.2 to 0.3 (GPL, on PyPI):

    python -m benchmarks.physics.stems FOLDER [--volume 0.5]

FOLDER is `platrock/Common/Toe_2018` of an unpacked `platrock-0.2.10.tar.gz`. Prints for each
diameter and speed the mean fraction of remaining translational energy, over equally probable hit
positions, and the fraction of hits that stop the boulder (at most 2 % of its energy remains). In
the discrete element model, boulders descend at 0 to 50 degrees; in the program, boulders of 2,500
kg/m3 fly horizontally at single fir stems.
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd

import rockfall
from rockfall.io.rasters.grid import Grid

SPEEDS, DIAMETERS = (5, 10, 15, 20), (20, 30, 40, 50)  # [m/s], [cm]
DENSITY, STILL = 2500.0, 0.02
# Number of hits; distances [m] between lanes, to stems and above ground:
PLACES, APART, AHEAD, ABOVE = 200, 12.0, 2.0, 5.0
CELL, GRAVITY = 5.0, 9.81  # [m], [m/s2]


def of_model(folder: Path, volume: float) -> dict[tuple[int, int], tuple[float, float]]:
    """Mean fraction of energy left, and fraction stopped, over hit positions and approach angles,
    by diameter and speed: results of the discrete element model."""
    found = {}
    for speed in SPEEDS:
        rows = np.genfromtxt(folder / f"result{speed}.0.txt", skip_header=1)
        left = (rows[:, 7:] ** 2).sum(axis=1) / speed**2
        for diameter in DIAMETERS:
            kept = np.isclose(rows[:, 1], volume) & np.isclose(rows[:, 3], diameter / 100)
            kept &= (rows[:, 4] <= 0) & (rows[:, 4] >= -50)
            place = rows[kept, 2]
            # each position represents all points nearer to it than to its neighbours
            places, at = np.unique(place, return_inverse=True)
            ends = np.r_[0, (places[1:] + places[:-1]) / 2, 1]
            weight = np.diff(ends)[at] / np.bincount(at)[at]
            found[diameter, speed] = tuple(
                float((weight * value).sum()) for value in (left[kept], left[kept] <= STILL)
            )
    return found


def of_program(diameter: float, speed: float, volume: float, folder: Path) -> tuple[float, float]:
    """Mean fraction of energy left, and fraction stopped, by this program, from horizontal flights
    at single stems."""
    reach = np.cbrt(3 * volume / (4 * np.pi)) + diameter / 200
    x = APART * (1 + np.arange(PLACES))
    trees = pd.DataFrame(
        {"x": x + reach * (np.arange(PLACES) + 0.5) / PLACES, "y": 20 + AHEAD, "dbh": diameter,
         "species": "fir"}
    )  # fmt: skip
    groups = {
        "case": {"title": "stems", "seed": 1, "boulders": 1},
        "boulder": {"volume": "fixed", "volume_mean": volume, "density": DENSITY},
        "surface": {"uniform_mean_radius": 0.2},
        "impact": {"sets": "vaujany-observed"},
        "release": {
            "x": x.tolist(), "y": [20.0] * PLACES, "drop_height": ABOVE,
            "velocity": [0.0, float(speed), 0.0],
        },
        "forest": {"trees": "trees.csv"},
        "output": {"trajectories": 0, "maps": None, "energy_balance": True},
    }  # fmt: skip
    trees.to_csv(folder / "trees.csv", index=False)
    rows, columns = 20, int(APART * (PLACES + 2) / CELL)
    result = rockfall.run(
        rockfall.Case(folder=folder, **groups),
        dem=np.zeros((rows, columns)),
        transform=Grid(0.0, rows * CELL, CELL, columns, rows),
    )
    way = AHEAD - np.sqrt(reach**2 - (trees["x"].values - x) ** 2)
    before = DENSITY * volume / 2 * (speed**2 + (GRAVITY * way / speed) ** 2)
    left = 1 - np.minimum(1, result["energy_trees"].values / before)
    return float(left.mean()), float((left <= STILL).mean())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--volume", type=float, default=0.5, help="one that the model has [m3]")
    given = parser.parse_args()
    model = of_model(given.folder, given.volume)
    print("| DBH [cm] | speed [m/s] | left: model | program | still: model | program |")
    print("|---" * 6 + "|")
    for (diameter, speed), (left, still) in sorted(model.items()):
        with tempfile.TemporaryDirectory() as folder:
            here = of_program(diameter, speed, given.volume, Path(folder))
        row = [diameter, speed, *(f"{v:.2f}" for v in (left, here[0], still, here[1]))]
        print(f"| {' | '.join(map(str, row))} |")


if __name__ == "__main__":
    main()
