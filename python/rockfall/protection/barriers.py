# SPDX-License-Identifier: BSD-3-Clause
"""Outcomes of the boulders that reach barriers."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from rockfall.analysis.line_statistics import with_limits
from rockfall.analysis.precision.intervals import fraction_interval, sources
from rockfall.result.crossings import line_names, outcomes_at
from rockfall.result.samples import check_rows
from rockfall.result.trajectories import flags_of

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from rockfall.result.contents import Held

COLUMNS = ["barrier", "height", "capacity", "outcome", "n"]
COLUMNS += with_limits("fraction")


def barrier_statistics(result: xr.Dataset) -> pd.DataFrame:
    """Table with a row for each barrier and outcome: n and fraction of all boulders with this
    outcome at the barrier, with its 95 % limits (as in `line_statistics`).

    Outcomes are stopped, broken_through and passed_over; the remaining fraction never reached the
    barrier. `height` [m] and `capacity` [J] describe the barrier. A result with
    barriers but without boulder rows raises a RockfallError.

    >>> import rockfall
    >>> case = rockfall.read_case("case.nml")
    >>> net = {"name": "net", "x": [600000.0, 600120.0], "y": [4999950.0, 4999950.0]}
    >>> case = case.replace(barrier=[{**net, "height": 3.0, "class": 4}])
    >>> rockfall.barrier_statistics(rockfall.run(case))["outcome"].tolist()
    ['stopped', 'broken_through', 'passed_over']
    """
    import pandas as pd

    return pd.DataFrame(barrier_rows(result), columns=COLUMNS)


def barrier_rows(result: Held) -> Iterator[dict[str, Any]]:
    """Rows of the table `barrier_statistics`. Raises a RockfallError for barriers in a result
    without boulder rows."""
    if barriers_of(result):
        check_rows(result, "what barriers did")
    for k in barriers_of(result):
        attrs = {
            "barrier": line_names(result)[k],
            "height": float(result["barrier_height"].values[k]),
            "capacity": float(result["barrier_capacity"].values[k]),
        }
        outcome = outcomes_at(result, k)
        for name, number in flags_of(result["crossing_outcome"]).items():
            if number:
                hit = outcome == number
                interval = fraction_interval(hit, sources(result))
                numbers = dict(zip(with_limits("fraction"), interval, strict=True))
                yield {**attrs, "outcome": name, "n": int(hit.sum()), **numbers}


def barriers_of(result: Held) -> list[int]:
    """Line indices of the barriers in a result."""
    if "barrier_height" not in result:
        return []
    return np.flatnonzero(~np.isnan(result["barrier_height"].values)).tolist()
