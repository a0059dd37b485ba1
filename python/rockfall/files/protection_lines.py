# SPDX-License-Identifier: BSD-3-Clause
"""Dams of a result as lines with attributes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from rockfall.case import case_of
from rockfall.errors import RockfallError

if TYPE_CHECKING:
    import xarray as xr

Dams = list[dict[str, Any]]
FIELDS = {"height": "height_m", "crest_width": "crest_width_m", "slope": "slope_deg"}


def dams_in(data: xr.Dataset) -> Dams:
    """Dam groups in the case of a result; none if the case is unknown."""
    try:
        return case_of(data).dam
    except (RockfallError, KeyError):
        return []


def dam_lines(dams: Dams) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Crest lines of dams, and attributes whose names include units."""
    import shapely

    shapes = [shapely.LineString(np.column_stack([dam["x"], dam["y"]])) for dam in dams]
    fields = {name: np.array([dam[key] for dam in dams], "f8") for key, name in FIELDS.items()}
    return np.array(shapes, dtype=object), fields
