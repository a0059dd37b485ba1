# SPDX-License-Identifier: BSD-3-Clause
"""Queries of a hazard at a line, object or segment: frequencies by energy or height, return
periods, and energies and heights by return period."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from rockfall.analysis.hazard.classes import Frequencies, frequencies
from rockfall.analysis.hazard.variables import LEVELS
from rockfall.case import case_in
from rockfall.errors import RockfallError
from rockfall.result.variables import ENDS

PLACES = "line", "object", "segment"


class Period(NamedTuple):
    """Return period [year] with its 95 % limits; `value` and `high` are infinite if no boulder
    exceeds the level."""

    value: float
    low: float
    high: float


def exceedance(hazard: xr.Dataset, place: str, quantity: str = "energy") -> pd.DataFrame:
    """Annual frequency of boulders that exceed each energy [J], or height of the centre above the
    ground [m], at a line, object or segment of a hazard: columns `energy` or `height`, `frequency`
    [1/year], and the limits `low`, `high` of its 95 % interval. The first row, 0, counts all
    boulders. A RockfallError for an unknown place lists the known names.

    >>> import rockfall
    >>> case = rockfall.read_case("case.nml")
    >>> case = case.replace(scenario=[{"name": "small", "return_period": 10.0}])
    >>> curve = rockfall.exceedance(rockfall.hazard(case), "L")
    >>> bool((curve["frequency"].diff()[1:] <= 0).all())
    True
    """
    levels, rates = _curve(hazard, place, quantity)
    columns = dict(zip(("frequency", "low", "high"), rates, strict=True))
    return pd.DataFrame({quantity: levels, **columns})


def return_period(
    hazard: xr.Dataset, place: str, *, energy: float | None = None, height: float | None = None
) -> Period:
    """Return period [year] of boulders above an energy [J] or a height [m] at a line, object or
    segment; of all boulders if neither is given. Between two counted levels, the frequency is
    interpolated by a power law (below the first, it is that of all boulders), and the limits are
    the outer limits of the two levels. Unknown places, levels out of range, and both levels
    together raise a RockfallError.

    >>> import rockfall
    >>> case = rockfall.read_case("case.nml")
    >>> case = case.replace(scenario=[{"name": "small", "return_period": 10.0}])
    >>> found = rockfall.return_period(rockfall.hazard(case), "L", energy=30e3)
    >>> found.low <= found.value <= found.high
    True
    """
    if energy is not None and height is not None:
        raise RockfallError("return_period: give energy or height, not both")
    level = 0.0 if energy is None and height is None else (energy if height is None else height)
    assert level is not None
    levels, rates = _curve(hazard, place, "energy" if height is None else "height")
    if not 0 <= level <= levels[-1]:
        unit = "J" if height is None else "m"
        raise RockfallError(f"return_period: {level:g} {unit}: must be 0 to {levels[-1]:g}")
    above = int(np.searchsorted(levels, level))
    below = above - (levels[above] > level)
    value = rates.value[above]
    if below < above and below > 0 and value > 0:
        span = np.log(level / levels[below]) / np.log(levels[above] / levels[below])
        value = rates.value[below] * (value / rates.value[below]) ** span
    elif below < above:
        value = rates.value[below]
    with np.errstate(divide="ignore"):
        ends = 1 / np.array([value, rates.high[below], rates.low[above]])
    return Period(*(float(end) for end in ends))


def period_table(hazard: xr.Dataset) -> pd.DataFrame:
    """Table with a row for each line, object or segment and each return period: `place` (line,
    object or segment), `name`, `return_period` [year], `energy` [kJ] and `height` [m] with limits.
    0 means that boulders arrive less often; an empty or infinite upper limit means too few
    boulders."""
    periods, rows = hazard["event_period"].values.tolist(), []
    for kind in _kinds(hazard):
        columns = [
            hazard[f"{kind}_{quantity}_by_period{end}"].values.astype(float) * factor
            for quantity, factor in zip(LEVELS, (1e-3, 1.0), strict=True)
            for end in ENDS
        ]
        rows += [
            (kind, str(name), period, *(column[k, j] for column in columns))
            for k, name in enumerate(hazard[kind].values)
            for j, period in enumerate(periods)
        ]
    names = [f"{quantity}{end}" for quantity in LEVELS for end in ENDS]
    return pd.DataFrame(rows, columns=["place", "name", "return_period", *names])


def yearly(hazard: xr.Dataset, kind: str, k: int, counts: np.ndarray) -> Frequencies:
    """Frequencies [1/year] at the line, object or segment (`kind`) with index k, from its boulder
    counts in each scenario (scenario, ...)."""
    per_cluster = hazard["boulders_per_cluster"].values
    if (name := f"{kind}_boulders_per_cluster") in hazard:
        per_cluster = hazard[name].values[:, k]
    samples = hazard["boulders"].values, per_cluster, hazard["frequency"].values
    parts = (
        (row.astype("i4"), int(n), float(cluster), float(rate))
        for row, n, cluster, rate in zip(counts, *samples, strict=True)
    )
    return frequencies(parts, case_in(hazard.attrs).hazard["frequency_factor"])


def _kinds(hazard: xr.Dataset) -> Iterator[str]:
    """Kinds of places with energies by return period."""
    return (kind for kind in PLACES if f"{kind}_energy_by_period" in hazard)


def _curve(hazard: xr.Dataset, place: str, quantity: str) -> tuple[np.ndarray, Frequencies]:
    """Levels, starting with 0, and the exceedance frequency of each level. Refuses unknown
    quantities, and points without a width whose curve is not recorded."""
    if quantity not in LEVELS:
        raise RockfallError(f"{quantity}: must be one of {', '.join(LEVELS)}")
    kind, k = find_place(hazard, place)
    if np.isnan(hazard[f"{kind}_{quantity}_by_period"].values[k]).any():
        raise RockfallError(
            f"{place}: at a point without a width, boulders are only counted above &hazard "
            "thresholds: give it a width"
        )
    above = hazard[f"{kind}_{quantity}_counts"].values[:, k]
    counts = np.column_stack([hazard[f"{kind}_passages"].values[:, k], above])
    return np.append(0.0, hazard[f"exceeded_{quantity}"].values), yearly(hazard, kind, k, counts)


def find_place(hazard: xr.Dataset, place: str, among: Sequence[str] = PLACES) -> tuple[str, int]:
    """Kind (one of `among`) and index of the place with this name; raises a RockfallError if there
    is none, or several."""
    if "frequency" not in hazard:
        raise RockfallError(
            f"{place}: a run has no annual frequencies: add &scenario groups to the case, and use "
            "rockfall.hazard"
        )
    kinds = [kind for kind in _kinds(hazard) if kind in among]
    named = [
        (kind, k)
        for kind in kinds
        for k, name in enumerate(hazard[kind].values)
        if str(name) == place
    ]
    if len(named) == 1:
        return named[0]
    names = [str(name) for kind in kinds for name in hazard[kind].values]
    reason = "several places have this name" if named else f"no {' or '.join(among)}"
    raise RockfallError(f"{place}: {reason} (names: {', '.join(names[:20]) or 'none'})")
