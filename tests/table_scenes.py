# SPDX-License-Identifier: BSD-3-Clause
"""Runs by an impact table on a plane."""

import numpy as np

import rockfall
from scenes import grid, rough

BY_TABLE = {"form": "table", "table": "meadow.nc"}


def terrain():
    z = rough()
    return {"dem": z, "transform": grid(z)}


def on_plane(folder, slope, boulders=200, **groups):
    """Result of boulders down a plane to the south, with all trajectories."""
    y = np.mgrid[199:-1:-1, 0:40][0] * 2.5
    z = 500 + np.tan(np.radians(slope)) * y
    case = {
        "case": {"boulders": boulders, "seed": 11},
        "impact": BY_TABLE,
        "boulder": {"volume": "fixed", "volume_mean": 0.27, "density": 2700.0},
        "release": {"x": [50.0], "y": [480.0], "drop_height": 2.0},
        "output": {"trajectories": boulders},
    }
    line = groups.pop("line", [])
    case |= {name: case.get(name, {}) | given for name, given in groups.items()}
    case = rockfall.Case(folder=folder, line=line, **case)
    return rockfall.run(case, dem=z, transform=grid(z, 2.5))
