# SPDX-License-Identifier: BSD-3-Clause
"""What the boulders did at the evaluation lines, in numbers."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

QUANTILES = (0.50, 0.90, 0.95, 0.99)
QUANTITIES = (
    "speed",
    "jump_height",
    "passing_height",
    "omega",
    "energy_translational",
    "energy_rotational",
)


def line_statistics(result: xr.Dataset) -> pd.DataFrame:
    """One row for each line and quantity: n and share of boulders that crossed, mean, standard
    deviation (n - 1), maximum and quantiles, in the units of the result; NaN where none crossed.
    """
    import pandas as pd

    rows = []
    for k, line in enumerate(result["line"].values if "line" in result else []):
        for quantity in QUANTITIES:
            values = result[f"line_{quantity}"].values[k]
            values = values[~np.isnan(values)]
            share = values.size / max(1, result.sizes["boulder"])
            rows.append(
                {
                    "line": line,
                    "quantity": quantity,
                    "n": values.size,
                    "share": share,
                    **_moments(values),
                }
            )
    names = [
        "line",
        "quantity",
        "n",
        "share",
        "mean",
        "std",
        "max",
        *map(_quantile_name, QUANTILES),
    ]
    return pd.DataFrame(rows, columns=names)


def _moments(values: np.ndarray) -> dict[str, float]:
    if not values.size:
        return {}
    numbers = {"mean": values.mean(), "max": values.max()}
    numbers["std"] = values.std(ddof=1) if values.size > 1 else np.nan
    return numbers | dict(
        zip(map(_quantile_name, QUANTILES), np.quantile(values, QUANTILES), strict=True)
    )


def _quantile_name(share: float) -> str:
    return f"q{share * 100:.0f}"
