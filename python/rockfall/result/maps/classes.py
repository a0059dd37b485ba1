# SPDX-License-Identifier: BSD-3-Clause
"""Map classes: limits that are the same for all results, and colours.

A value equal to a limit belongs to the class below: "above 300 kJ" excludes 300 kJ.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rockfall.errors import RockfallError
from rockfall.quantities import SHOWN

if TYPE_CHECKING:
    import xarray as xr

#: Class limits by displayed unit; they replace LIMITS.
Limits = Mapping[str, tuple[float, ...]]

COUNTED = {"tree_impacts": "hits", "sources": "sources"}  # what count maps count, if not boulders
DECADES = (1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0)
LIMITS = {  # keys: displayed units; the Swiss intensity classes end at 30 and 300 kJ
    "kJ": (10.0, 30.0, 100.0, 300.0, 1000.0, 3000.0, 10000.0),
    "m": (0.5, 1.0, 2.0, 3.0, 5.0, 10.0, 20.0),
    "m/s": (5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 40.0),
    "%": (0.01, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0),
    "degree": (20.0, 25.0, 28.0, 30.0, 32.0, 35.0, 40.0),
    "s": (5.0, 10.0, 20.0, 30.0, 45.0, 60.0, 90.0),
    "year-1": (0.0001, 0.001, 0.0033, 0.01, 0.033, 0.1, 1.0),
}
UNITS = (*LIMITS, "boulders", *COUNTED.values())
#: From pale to dark, also in grey print, and distinct from the hues of relief and water.
RAMP = ("#fff7bc", "#fed976", "#fdae4f", "#f87d3a", "#e6432b", "#bd1b43", "#84115f", "#430b52")
STATUS_MARKERS = {  # marker (Matplotlib name) and colour by boulder status
    "stopped": (".", "#d55e00"),
    "absorbed": ("x", "#0072b2"),
    "left_domain": ("^", "#222222"),
    "impact_limit": ("s", "#222222"),
    "hit_nodata": ("+", "#222222"),
    "stopped_by_tree": ("v", "#009e73"),
    "stopped_by_barrier": ("D", "#0072b2"),
}


class Classes(NamedTuple):
    """Classes of a map: unit, limits, and a colour for each class."""

    unit: str
    limits: tuple[float, ...]
    colours: tuple[str, ...]

    def numbers(self, values: np.ndarray) -> np.ndarray:
        """Class of each value, from 0; -1 for missing values."""
        return np.where(np.isnan(values), -1, np.digitize(values, self.limits, right=True))

    @property
    def ticks(self) -> tuple[str, ...]:
        """Limits as text."""
        return tuple(f"{limit:,g}" for limit in self.limits)

    @property
    def labels(self) -> list[str]:
        between = [
            f"{low} to {high}" for low, high in zip(self.ticks, self.ticks[1:], strict=False)
        ]
        return [f"up to {self.ticks[0]}", *between, f"above {self.ticks[-1]}"]


def shown_as(variable: xr.DataArray) -> tuple[str, float]:
    """Display unit of a map, and the factor from the unit in results."""
    return map_unit(str(variable.name), variable.attrs.get("units", "1"), variable.dtype)


def map_unit(name: str, units: str, dtype: np.dtype) -> tuple[str, float]:
    """Display unit of a map with these units and type, and the factor."""
    if dtype.kind in "iu" and units == "1":
        return COUNTED.get(name, "boulders"), 1.0
    return SHOWN.get(units, (units, 1.0))


def classes_of(unit: str, limits: Limits | None = None) -> Classes:
    """Map classes for a unit, with the user's limits if given."""
    chosen = ((limits or {}).get(unit)) or LIMITS.get(unit, DECADES)
    return Classes(unit, chosen, tuple(ramp(len(chosen) + 1)))


def read_limits(texts: Iterable[str]) -> Limits:
    """Read limits from `unit=limit,limit...`, such as kJ=30,300; refuses other texts."""
    limits = {}
    for text in texts:
        unit, _, numbers = text.partition("=")
        try:
            values = tuple(float(number) for number in numbers.split(","))
        except ValueError:
            values = ()
        rising = all(low < high for low, high in pairwise(values))
        if unit not in UNITS or not values or not rising or not np.isfinite(values).all():
            raise RockfallError(
                f"--limits {text}: must be unit=limit,limit... with increasing limits, such as "
                f"kJ=30,300 (units: {', '.join(UNITS)})"
            )
        limits[unit] = values
    return limits


def ramp(number: int) -> list[str]:
    """`number` evenly spaced colours from the ramp."""
    table = np.array([[int(colour[k : k + 2], 16) for k in (1, 3, 5)] for colour in RAMP], float)
    places = np.linspace(0, len(RAMP) - 1, number)
    mixed = np.column_stack([np.interp(places, range(len(RAMP)), part) for part in table.T])
    return ["#" + bytes(rgb).hex() for rgb in mixed.round().astype(int).tolist()]
