# SPDX-License-Identifier: BSD-3-Clause
"""Lines, barriers and dams that a section crosses, and the boulders that cross them nearby."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from rockfall.analysis.lines.envelopes import QUANTITIES, envelope_names, envelopes
from rockfall.analysis.precision.intervals import sources
from rockfall.case import case_of
from rockfall.result.crossings import line_values
from rockfall.result.samples import simulated
from rockfall.result.trajectories import lines
from rockfall.terrain.polyline import intersections

LINE, BARRIER, DAM = "line", "barrier", "dam"
COLUMNS = ["name", "kind", "distance", "height", "capacity", "n", *envelope_names()]


def crossed_lines(result: xr.Dataset, vertices: np.ndarray, within: float) -> pd.DataFrame:
    """Table of the lines, barriers and dams that a section (vertices x + iy [m]) crosses, in order
    along it, with height [m] and capacity [J]. Statistics are of all boulders that cross the line
    within `within` [m] on either side; NaN unless all boulder rows are kept."""
    rows = [*_lines(result, vertices, within), *_dams(result, vertices)]
    return pd.DataFrame(sorted(rows, key=lambda row: row["distance"]), columns=COLUMNS)


def _lines(result: xr.Dataset, vertices: np.ndarray, within: float) -> Iterator[dict[str, Any]]:
    """Rows of evaluation lines and barriers."""
    complete = result.sizes["boulder"] == simulated(result)
    source = sources(result) if complete else None
    for k, (name, x, y) in enumerate(lines(result)):
        row: dict[str, Any] = {"name": name, "kind": LINE}
        if "barrier_height" in result and np.isfinite(height := result["barrier_height"].values[k]):
            capacity = result["barrier_capacity"].values[k]
            row |= {"kind": BARRIER, "height": float(height), "capacity": float(capacity)}
        for distance, along in zip(*intersections(vertices, x + 1j * y), strict=True):
            row = row | {"distance": float(distance)}
            if source is not None:
                near = np.abs(line_values(result, "position", k) - along) <= within
                values = {
                    quantity: line_values(result, quantity, k)[near] for quantity in QUANTITIES
                }
                row |= {"n": int(near.sum())} | envelopes(values, source[near])
            yield row


def _dams(result: xr.Dataset, vertices: np.ndarray) -> Iterator[dict[str, Any]]:
    """Rows of dams, located at their centre lines."""
    for k, dam in enumerate(case_of(result).dam, start=1):
        middle = np.array(dam["x"]) + 1j * np.array(dam["y"])
        for distance in intersections(vertices, middle)[0]:
            attrs = {"name": f"dam {k}", "kind": DAM, "height": float(dam["height"])}
            yield attrs | {"distance": float(distance)}
