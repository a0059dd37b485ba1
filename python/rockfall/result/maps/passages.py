# SPDX-License-Identifier: BSD-3-Clause
"""Number of boulders that contribute to each map cell of a result."""

import numpy as np
import xarray as xr

from rockfall.kernel_rules import fraction_limits
from rockfall.result.samples import simulated

PASSED = ("reach_probability", "passages")  # alternative maps of how many boulders pass


def passed_map(result: xr.Dataset) -> str | None:
    """Name of the map of how many boulders pass, or which fraction; None if there is none."""
    return next((name for name in PASSED if name in result), None)


def passages_of(result: xr.Dataset) -> np.ndarray | None:
    """Number of boulders (y, x) that passed each cell; None if the result does not count them."""
    if (passed := passed_map(result)) is None:
        return None
    return result[passed].values * (1 if passed == "passages" else simulated(result))


def thin_cells(result: xr.Dataset, name: str) -> np.ndarray | None:
    """Mask (y, x) of cells in which too few boulders passed for a reliable map value; None if the
    map has no such cells, or if passages are not counted."""
    fewest, count = result[name].attrs.get("thin_below", 0), passages_of(result)
    if not fewest or count is None:
        return None
    return np.isfinite(result[name].values) & (count < fewest - 0.5)


def of_none(result: xr.Dataset, name: str) -> float:
    """Largest map value where no boulder passed: 0, except for the upper limit of a fraction."""
    if name != "reach_probability_high":
        return 0.0
    clusters = simulated(result) / result[name].attrs.get("boulders_per_cluster", 1)
    return 1.001 * fraction_limits(0.0, clusters)[1]  # maps have seven digits
