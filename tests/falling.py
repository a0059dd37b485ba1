# SPDX-License-Identifier: BSD-3-Clause
"""Boulders that fall onto a plane, by impact tables."""

import numpy as np

import rockfall
import scenes
from rockfall.grounds.impact_tables import (
    YieldingGround,
)
from rockfall.result.crossings import has_crossed

RADIUS, RATIO = 0.6, 4.0  # R_b [m]; R_b/R_m, at one of the table's parts
GRAVITY, DENSITY = 9.81, 2700.0  # [m/s2], [kg/m3]
MARK = 60.0  # distance down the plane [m]
BOULDERS = 300
SPREAD = 0.06  # scatter between tables of the same ground (docs/impact_tables.md)
#: Grounds that yield: laboratory blocks travel less far after a higher fall.
YIELDS = {"scree": 28.0, "soil": 23.0}
GROUNDS = {
    "firm": ("ploughed", YieldingGround(27.0, 2e6, relief=12.6)),
    "hard": ("hard", YieldingGround(31.0, 3e7, relief=15.0)),
    "scree": ("ploughed", YieldingGround(38.0, 2e5, strength_radius=0.6, relief=16.5)),
    "soil": ("ploughed", YieldingGround(24.0, 3e5, relief=14.0)),
}


def fall(folder, ground, slope, drop, *, boulders=BOULDERS, speed=0.0, **groups):
    """Run boulders that fall from `drop` [m] above a plane of `slope` [degree], with a downward
    speed [m/s]."""
    cell, rows, columns, above = 2.5, 92, 60, 8
    z = 500 + np.tan(np.radians(slope)) * cell * np.mgrid[rows - 1 : -1 : -1, 0:columns][0]
    top, width = (rows - above) * cell, columns * cell
    at = top - MARK * np.cos(np.radians(slope))
    usual = {"volume": "fixed", "volume_mean": 4 / 3 * np.pi * RADIUS**3, "density": DENSITY}
    case = rockfall.Case(
        folder=folder,
        case={"boulders": boulders, "seed": 7},
        impact={"form": "table"} | groups.get("impact", {}),
        surface={
            "uniform_mean_radius": RADIUS / RATIO, "ground": ground, "ground_table": "grounds.csv",
        },
        boulder=usual | groups.get("boulder", {}),
        release={
            "x": [width / 2], "y": [top], "drop_height": drop, "velocity": [0.0, 0.0, -speed],
        },
        line=[{"name": "line", "x": [0.0, width], "y": [at, at]}],
    )  # fmt: skip
    return rockfall.run(case, dem=z, transform=scenes.grid(z, cell))


def passing(result):
    return has_crossed(result, 0).mean()


def error(*fractions_and_numbers):
    """Standard error of a difference of fractions, from pairs of a fraction and its sample size."""
    return np.sqrt(sum(max(p * (1 - p), 0.02) / n for p, n in fractions_and_numbers))


def write_grounds(place):
    rows = [f"{name},{model},{','.join(map(repr, ground))},test\n"
            for name, (model, ground) in GROUNDS.items()]  # fmt: skip
    head = f"name,model,{','.join(YieldingGround._fields)},source\n"
    (place / "grounds.csv").write_text(head + "".join(rows))
