# SPDX-License-Identifier: BSD-3-Clause
"""Impacts and their fit in a few lines of text."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rockfall.errors import RockfallError
from rockfall.lab.case import COEFFICIENTS
from rockfall.lab.experiment import STATUS
from rockfall.lab.fit import impacts_of, linearity, normality, point_maps, points_needed

if TYPE_CHECKING:
    import xarray as xr

    from rockfall.lab.fit import ImpactSet

ENDS = [name for name in STATUS if name != "not_done"]


def impact_summary(data: xr.Dataset) -> str:
    """How the impacts of each ratio ended."""
    lines = [f"{'R_b/R_m':>8}{'impacts':>9}" + "".join(f"{name:>11}" for name in ENDS)]
    for ratio in data["ratio"].values:
        status = data["status"].sel(ratio=ratio).values
        counts = "".join(f"{int((status == STATUS[name]).sum()):11,}" for name in ENDS)
        lines.append(f"{ratio:8g}{status.size:9,}{counts}")
    lines.append(f"{data.attrs['cpu_seconds']:.0f} s of CPU")
    return "\n".join(lines)


def fit_summary(data: xr.Dataset, sets: dict[int, ImpactSet]) -> str:
    """Each ratio: a1..a9, mean +- deviation, and how far to believe them."""
    lines = []
    for ratio, found in sets.items():
        impacts = impacts_of(data, ratio)
        maps = point_maps(*impacts)
        lines.append(f"R_b/R_m = {ratio}: {found.points} points, {maps.skipped} skipped")
        rows = [
            ("mean", found.mean, "7.3f"),
            ("standard error", found.mean_error, "7.3f"),
            ("deviation", np.sqrt(np.diag(found.covariance)), "7.3f"),
            ("normal: p", normality(maps.a), "7.3f"),
        ]
        try:
            difference, error = linearity(*impacts)
            rows.append(("fast less slow [s.e.]", difference / error, "7.1f"))
        except RockfallError:
            pass  # too few impacts a point to part them
        lines.append(f"  {'':22}" + "".join(f"{name:>7}" for name in COEFFICIENTS))
        lines += [f"  {name:22}" + "".join(f"{v:{how}}" for v in row) for name, row, how in rows]
        lines.append(
            f"  residual within points {maps.residual.mean():.3f} of the incident speed; "
            f"{found.lost_variance:.1%} of the variance cut off; "
            f"means to 0.01 with {points_needed(found):,} points"
        )
    return "\n".join(lines)
