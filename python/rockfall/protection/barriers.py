# SPDX-License-Identifier: BSD-3-Clause
"""What barriers did with the boulders that came to them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rockfall.analysis.precision.intervals import fraction_interval, sources
from rockfall.result.samples import check_rows
from rockfall.result.trajectories import flags_of

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


def barrier_statistics(result: xr.Dataset) -> pd.DataFrame:
    """One row for each barrier and outcome: n and fraction of all boulders with which the barrier
    dealt so, with the limits of its 95 % confidence interval (as line_statistics).

    Outcomes are stopped, broken_through and passed_over; the fraction that none of them holds never
    came to the barrier. `height` [m] and `capacity` [J] are the barrier's.

    >>> import rockfall
    >>> case = rockfall.read_case("case.nml")
    >>> net = {"name": "net", "x": [600000.0, 600120.0], "y": [4999950.0, 4999950.0]}
    >>> case = case.replace(barrier=[{**net, "height": 3.0, "class": 4}])
    >>> rockfall.barrier_statistics(rockfall.run(case))["outcome"].tolist()
    ['stopped', 'broken_through', 'passed_over']
    """
    import pandas as pd

    rows: list[dict] = []
    if barriers_of(result):
        check_rows(result, "what barriers did")
    for k in barriers_of(result):
        about = {
            "barrier": str(result["line"].values[k]),
            "height": float(result["barrier_height"][k]),
            "capacity": float(result["barrier_capacity"][k]),
        }
        outcome = result["barrier_outcome"].values[k]
        for name, number in flags_of(result["barrier_outcome"]).items():
            if number:
                hit = outcome == number
                fraction, low, high = fraction_interval(hit, sources(result))
                numbers = {"n": int(hit.sum()), "fraction": fraction}
                rows.append({**about, "outcome": name, **numbers, "low": low, "high": high})
    columns = ["barrier", "height", "capacity", "outcome", "n", "fraction", "low", "high"]
    return pd.DataFrame(rows, columns=columns).rename(
        columns={"low": "fraction_low", "high": "fraction_high"}
    )


def barriers_of(result: xr.Dataset) -> list[int]:
    """Which lines of a result are barriers."""
    if "barrier_height" not in result:
        return []
    return np.flatnonzero(~np.isnan(result["barrier_height"].values)).tolist()
