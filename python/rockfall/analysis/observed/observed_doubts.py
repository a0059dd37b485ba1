# SPDX-License-Identifier: BSD-3-Clause
"""Checks of observations for wrong units and swapped x and y."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from rockfall.errors import RockfallError
from rockfall.io.rasters.grid import Grid
from rockfall.language import Text, say
from rockfall.quantities import QUANTITIES
from rockfall.scene.rules.boulders import DBH, VOLUME

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from rockfall.analysis.observed.observations import Observed

SCAR = 20.0  # [m] highest marks on trees above the ground
FAR = 3.0  # [terrain sizes] places farther away are probably in another country
FEET, HUNDRED, THOUSAND = 1 / 0.3048, 100.0, 1000.0
#: Ratio of a number in the wrong unit to the number in the expected unit.
OTHER = {
    "speed": {"km/h": 3.6},
    "jump_height": {"ft": FEET, "cm": HUNDRED, "mm": THOUSAND},
    "passing_height": {"ft": FEET, "cm": HUNDRED, "mm": THOUSAND},
    "omega": {"rpm": 30 / math.pi, "degree/s": 180 / math.pi},
    "distance": {"ft": FEET, "km": 1 / THOUSAND},
    "energy": {"J": THOUSAND, "MJ": 1 / THOUSAND},
}
#: Ratio of simulated to observed value that a model error can still explain.
ERROR = {"energy": 5.0}
USUAL_ERROR = 1.6


def check_exchanged(seen: Observed, site: xr.Dataset | Grid) -> None:
    """Raise a RockfallError for observed places that are far away but fit with x and y swapped."""
    if isinstance(site, Grid):
        low, high = np.array([site.west, site.south]), np.array([site.east, site.north])
    else:
        ends = [[site[f"{end}_{axis}"].values for end in ("start", "stop")] for axis in "xy"]
        low, high = np.min(ends, axis=(1, 2)), np.max(ends, axis=(1, 2))
    size = max(float((high - low).max()), 1.0)
    for name in "stops", "contacts":
        places = getattr(seen, name)
        if places is None:
            continue
        places = np.asarray(places if name == "stops" else places[["x", "y"]], float)
        off, other = (
            np.abs(given - given.clip(low, high)).max(axis=1) for given in (places, places[:, ::-1])
        )
        wrong = np.flatnonzero((off > FAR * size) & (other < size))
        if wrong.size:
            where = seen.where[name][wrong[0]]
            x0, y0 = places[wrong[0]]
            raise RockfallError(
                f"{where}: x = {x0:.10g}, y = {y0:.10g}: {wrong.size} of {len(places)} places lie "
                "on the terrain with x and y exchanged: exchange the columns"
            )


def unit_notes(seen: Observed) -> Iterator[Text]:
    """Notes on implausible mark heights, tree diameters and block volumes."""
    if seen.contacts is not None:
        height, dbh = (seen.contacts[name].to_numpy(float) for name in ("height", "dbh"))
        if np.nanmax(height, initial=0.0) > SCAR:
            yield say("compare.scar_height", height=float(np.nanmax(height)))
        odd = dbh[(dbh < DBH[0]) | (dbh > DBH[1])]
        if odd.size:
            unit = "m" if odd[0] < DBH[0] else "mm"
            yield say("compare.tree_diameter", dbh=float(odd[0]), unit=unit)
    if seen.volumes is not None and (largest := float(np.nanmax(seen.volumes))) > VOLUME:
        yield say("compare.block_volume", volume=largest)


def ratio_notes(errors: pd.DataFrame) -> Iterator[Text]:
    """Notes on means or maxima at lines (rows of `Comparison.errors`) if the ratio to simulated
    values suggests another unit."""
    rows = errors[errors["statistic"].isin(("mean", "max")) & (errors["observed"] > 0)]
    for (line, quantity), group in rows.groupby(["line", "quantity"], sort=False):
        comparable = group[group["simulated"] > 0]
        if len(comparable):
            first = comparable.iloc[0]
            kind = "energy" if quantity.startswith("energy") else quantity
            what = f"{line}: {QUANTITIES[quantity].label}"
            yield from _ratio_note(what, kind, first.observed / first.simulated)


def distance_notes(
    ours: np.ndarray, distances: np.ndarray | None, seen: Observed
) -> Iterator[Text]:
    """Note on run-out distances if the ratio to simulated distances [m] suggests another unit."""
    if distances is not None and distances.size:
        ratio = float(distances.mean() / ours.mean())
    elif seen.passing is not None:
        part = seen.passing["fraction"].to_numpy(float)
        there = seen.passing["distance"].to_numpy(float)[(part > 0) & (part < 1)]
        part = part[(part > 0) & (part < 1)]
        if not part.size:
            return
        ratio = float(np.median(there / np.quantile(ours, 1 - part)))
    else:
        return
    yield from _ratio_note(QUANTITIES["stopping_distance"].label, "distance", ratio)


def _ratio_note(what: str, kind: str, ratio: float) -> Iterator[Text]:
    """Note on the most probable unit, allowing for a plausible model error."""
    error = ERROR.get(kind, USUAL_ERROR)
    apart = {unit: abs(math.log(ratio / factor)) for unit, factor in OTHER.get(kind, {}).items()}
    if apart and min(apart.values()) < math.log(error):
        unit = min(apart, key=apart.__getitem__)
        yield say("compare.other_unit", what=what, ratio=ratio, unit=unit)
