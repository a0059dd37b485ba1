# SPDX-License-Identifier: BSD-3-Clause
"""Selection of the cheapest barrier that lets at most a given fraction of the boulders pass."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from rockfall.analysis.precision.intervals import Sources, fraction_interval
from rockfall.analysis.precision.weighted import Weighted
from rockfall.io.tables import check_columns, check_needed, read_table
from rockfall.kernel_rules import EAD_ENERGY
from rockfall.language import Text, say
from rockfall.protection.crossings import Crossings, passes
from rockfall.scene.rules.protection import NET

Costs = dict[tuple[int, float], float]  # price per metre by class and maximum height [m]
MAX_HEIGHT = 100.0  # maximum barrier height, as in a case [m]
COST_COLUMNS = ["class", "height", "cost"]


class Choice(NamedTuple):
    """Barrier of a class: height [m] (NaN if none suffices) and cost per metre (NaN if unknown)."""

    ead_class: int
    height: float
    cost: float

    @classmethod
    def of(cls, ead_class: int, height: float, costs: Costs | None) -> Choice:
        """Barrier with this class and height, including its cost."""
        return cls(ead_class, height, cost_of(ead_class, height, costs))


def height_for(came: Crossings, capacity: float, residual: float) -> float:
    """Minimum height [m] at which at most the fraction `residual` of the boulders passes over or
    through a barrier of this capacity [J]; NaN if too many break through, or without
    boulders. A single sort suffices: of the boulders that do not break through, as many may pass
    over as `residual` still allows."""
    heights = np.sort(came.passing_height[came.energy_total <= capacity])
    over = math.floor(residual * came.n * (1 + 1e-12)) - (came.n - heights.size)
    if not came.n or over < 0:
        return math.nan
    return float(heights[-1 - over]) if over < heights.size else 0.0


def choices(
    came: Crossings, residual: float, costs: Costs | None = None
) -> list[dict[str, float | bool]]:
    """For each EAD class, the height at which at most the fraction `residual` passes, the actual
    fraction with its 95 % interval, and the cost per metre; `cheapest` marks the cheapest barrier.
    """
    rows: list[dict[str, float | bool]] = []
    by_class = [
        Choice.of(k, height_for(came, capacity, residual), costs)
        for k, capacity in enumerate(EAD_ENERGY)
    ]
    for choice in by_class:
        k, height, cost = choice
        row: dict[str, float | bool] = {"ead_class": k, "capacity": EAD_ENERGY[k], "height": height}
        left = (math.nan,) * 3
        if height == height:
            left = residual_of(passes(came, height, EAD_ENERGY[k]), came.source)
        row |= zip(("residual", "residual_low", "residual_high"), left, strict=True)
        rows.append(row | {"cost": cost, "cheapest": choice is cheapest(by_class)})
    return rows


def least_heights(
    classes: Iterable[int],
    heights: Sequence[float],
    is_enough: Callable[[int, int], bool],
    costs: Costs | None,
) -> list[Choice]:
    """Barrier of each class with the lowest of the ascending `heights` [m] (by index) for which
    `is_enough(class, index)`; every higher barrier must suffice, too. NaN if none does."""
    numbers, ends = range(len(heights)), [*heights, math.nan]
    return [
        Choice.of(own, ends[bisect_left(numbers, True, key=partial(is_enough, own))], costs)
        for own in classes
    ]


def cheapest(choices: Iterable[Choice]) -> Choice | None:
    """Barrier with the lowest cost (the first if several have it); None if no cost is known."""
    priced = [choice for choice in choices if not math.isnan(choice.cost)]
    return min(priced, key=lambda choice: choice.cost, default=None)


def residual_of(passing: np.ndarray, source: Sources | Weighted) -> tuple[float, float, float]:
    """Fraction of True in `passing`, with its 95 % interval; NaN without boulders."""
    if not passing.size:
        return math.nan, math.nan, math.nan
    return fraction_interval(passing, source)


def cost_of(ead_class: int, height: float, costs: Costs | None) -> float:
    """Cost per metre: the lowest price of a sufficiently high barrier of this class. Without
    prices, energy x height [kJ m], which favours no manufacturer. NaN if no such barrier has a
    price, or if `height` is NaN."""
    if math.isnan(height):
        return math.nan
    if costs is None:
        return EAD_ENERGY[ead_class] / 1000 * height
    prices = [cost for (k, high), cost in costs.items() if k == ead_class and high >= height]
    return min(prices, default=math.nan)


def read_costs(path: str | Path) -> Costs:
    """Read barrier prices per metre from a table with the columns class, height [m] and cost."""
    where, columns, rows = read_table(path)
    check_columns(where, columns, COST_COLUMNS)
    check_needed(where, columns, COST_COLUMNS)
    costs: Costs = {}
    for row in rows:
        ead_class = int(row.choice("class", [str(k) for k in range(len(EAD_ENERGY))]))
        key = ead_class, row.number("height", 0.0, MAX_HEIGHT)
        if key in costs:
            row.refuse("height", "occurs twice for this class")
        costs[key] = row.number("cost", 0.0)
    return costs


def cost_remarks(costs: Costs | None) -> Iterator[Text]:
    """Remark on prices for implausibly high barriers."""
    highest = max((height for _, height in costs or {}), default=0.0)
    if highest > NET:
        yield say("design.high_prices", height=highest)
