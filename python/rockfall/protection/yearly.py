# SPDX-License-Identifier: BSD-3-Clause
"""Barriers designed for the frequency of passing boulders: loads by return period at the lines of
a hazard, sufficient barriers of each class, and the case's barriers."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from rockfall.analysis.hazard.levels import yearly
from rockfall.analysis.hazard.variables import CLASS_ENERGY, EXCEEDED, LEVELS, PERIODS
from rockfall.errors import RockfallError
from rockfall.protection.selection import Costs, cheapest, least_heights, read_costs
from rockfall.result.variables import ENDS

YEARS = 100.0  # default return period [year]
HIGHEST = 10.0  # maximum height of an advised barrier [m]; higher barriers are not built
_BEHIND = [f"behind{end}" for end in ENDS]
_THROUGH = [f"through{end}" for end in ENDS]
_LOADS = ["line", *(f"{name}{end}" for name in ("frequency", *LEVELS) for end in ENDS)]
_CHOICES = ["line", "ead_class", "capacity", "height", *_BEHIND, *_THROUGH, "cost", "advised"]
_CHECKS = ["line", "height", "capacity", *_BEHIND, "holds", "certain"]


@dataclass(frozen=True)
class YearlyDesign:
    """Tables for a return period [year], in SI units, with 95 % limits.

    `loads`: for each line and barrier, the annual number of arriving boulders, and the energy and
    height that are reached once in the period. `choices`: for each line and class of EAD 340059,
    the minimum height [m], up to `HIGHEST`, of a barrier that boulders pass at most once in the
    period, judged by the upper limit (NaN if there is none); the annual numbers of boulders that
    pass it (`behind`) and that would break through any barrier of the class (`through`); and the
    advised (cheapest) barrier, if boulders may arrive more often than once in the period. `checks`:
    annual number of boulders that pass the case's barriers, whether it is at most one in the
    period, and whether that verdict is certain.
    """

    period: float
    loads: pd.DataFrame
    choices: pd.DataFrame
    checks: pd.DataFrame


def yearly_design(
    hazard: xr.Dataset, return_period: float = YEARS, costs: str | Path | None = None
) -> YearlyDesign:
    """Design barriers at the lines of a hazard for a return period [year], over all scenarios.
    `costs` is a table of barrier prices, as in `rockfall.design`. Raises RockfallError for a
    hazard without lines, and for return periods for which it has no levels.

    >>> import rockfall
    >>> case = rockfall.read_case("case.nml")
    >>> case = case.replace(scenario=[{"name": "small", "return_period": 10.0}])
    >>> sheet = rockfall.yearly_design(rockfall.hazard(case), 100.0)
    >>> sheet.loads["line"].tolist()
    ['L']
    """
    if "line_class_behind" not in hazard:
        raise RockfallError(
            "design: the hazard has no lines: give the case a &line and run it again"
        )
    check_period(return_period)
    periods = hazard["event_period"].values.tolist()
    prices = None if costs is None else read_costs(costs)
    at = periods.index(return_period)
    names = [str(name) for name in hazard["line"].values]
    loads = [{"line": name} | _loads(hazard, k, at) for k, name in enumerate(names)]
    choices = [
        {"line": name} | row
        for k, name in enumerate(names)
        for row in _choices(hazard, k, 1 / return_period, prices)
    ]
    checks = [
        {"line": name} | _check(hazard, k, 1 / return_period)
        for k, name in enumerate(names)
        if not np.isnan(hazard["line_barrier_height"].values[k])
    ]
    return YearlyDesign(
        return_period,
        pd.DataFrame(loads, columns=_LOADS),
        pd.DataFrame(choices, columns=_CHOICES),
        pd.DataFrame(checks, columns=_CHECKS),
    )


def check_period(years: float) -> None:
    """Raise a RockfallError for a return period for which the hazard has no levels."""
    if years not in PERIODS:
        shown = ", ".join(f"{period:g}" for period in PERIODS)
        raise RockfallError(f"return_period = {years:g}: must be one of {shown}")


def _loads(hazard: xr.Dataset, k: int, at: int) -> dict[str, float]:
    row = {f"frequency{end}": float(hazard[f"line_frequency{end}"].values[k]) for end in ENDS}
    return row | {
        f"{name}{end}": float(hazard[f"line_{name}_by_period{end}"].values[k, at])
        for name in LEVELS
        for end in ENDS
    }


def _choices(
    hazard: xr.Dataset, k: int, allowed: float, prices: Costs | None
) -> Iterator[dict[str, Any]]:
    """Rows for each barrier class: the lowest height at which at most `allowed` boulders [1/year]
    pass the barrier, by the upper limit."""
    tall = EXCEEDED["height"] <= HIGHEST
    rates = yearly(hazard, "line", k, hazard["line_class_behind"].values[:, k])
    heights, high = EXCEEDED["height"][tall].tolist(), rates[2]
    classes = range(len(high))
    by_class = least_heights(classes, heights, lambda own, j: bool(high[own, j] <= allowed), prices)
    is_needed = float(hazard["line_frequency_high"].values[k]) > allowed
    for choice in by_class:
        own, height, cost = choice
        row = dict.fromkeys(_CHOICES[1:], np.nan)
        row |= {"ead_class": own, "capacity": CLASS_ENERGY[own], "height": height, "cost": cost}
        row |= dict(zip(_THROUGH, (rate[own, -1] for rate in rates), strict=True))
        if height in heights:
            least = heights.index(height)
            row |= dict(zip(_BEHIND, (rate[own, least] for rate in rates), strict=True))
        yield row | {"advised": is_needed and choice is cheapest(by_class)}


def _check(hazard: xr.Dataset, k: int, allowed: float) -> dict[str, Any]:
    """Row of `checks` for the barrier at a line: the boulders that pass it [1/year], whether they
    are at most `allowed`, and whether that is certain."""
    behind = hazard["line_behind"].values[:, k]
    value, low, high = (float(limit) for limit in yearly(hazard, "line", k, behind))
    names = ("height", "capacity")
    given = {name: float(hazard[f"line_barrier_{name}"].values[k]) for name in names}
    verdict = {"holds": value <= allowed, "certain": (low <= allowed) == (high <= allowed)}
    return given | dict(zip(_BEHIND, (value, low, high), strict=True)) | verdict
