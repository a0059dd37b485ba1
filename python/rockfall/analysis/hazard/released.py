# SPDX-License-Identifier: BSD-3-Clause
"""Boulders released in a scenario: volumes, densities, drop heights and speeds."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from rockfall.result.samples import simulated

if TYPE_CHECKING:
    import xarray as xr

    from rockfall.scene.scene import Scene

RELEASED = {  # unit and meaning
    "volume": ("m3", "volume of the released boulders"),
    "density": ("kg m-3", "density of the released boulders"),
    "drop_height": ("m", "height of the release above the surface"),
    "release_speed": ("m s-1", "speed of the release"),
}
EXTENT: dict[str, Callable[[np.ndarray], float]] = {"min": np.min, "mean": np.mean, "max": np.max}


def released_numbers(result: xr.Dataset, scene: Scene) -> dict[str, float]:
    """Minimum, mean and maximum of each quantity in `RELEASED`, volumes over the boulders of a
    result and the others over the sources of its scene. Volumes are NaN if rows were not kept."""
    volumes, values = result["volume"].values, scene.release_values
    if volumes.size < simulated(result):
        volumes = np.array([np.nan])
    speeds = np.linalg.norm(values[:, 2:], axis=1)
    columns = zip(RELEASED, (volumes, values[:, 0], values[:, 1], speeds), strict=True)
    return {
        f"released_{name}_{end}": float(reduce(column))
        for name, column in columns
        for end, reduce in EXTENT.items()
    }
