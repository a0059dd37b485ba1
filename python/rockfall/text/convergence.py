# SPDX-License-Identifier: BSD-3-Clause
"""A measured convergence in words and tables."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from rockfall.analysis.convergence import AS_GIVEN, ERRORS, KEYS, SIZE, Convergence

if TYPE_CHECKING:
    import pandas as pd

SMALL = 0.05  # the paper's bound for changes from step to step
NAMES = {"boulders": "share passing", "speed": "speed [m/s]", "passing_height": "height [m]"}
NAMES |= {"energy_total": "E_total [kJ]"}
TERRAINS = {
    "float32": "elevations rounded to it",
    "float64": "elevations of float32 with what that had rounded away, at random",
    "cells x2": "means of 2 x 2 elevations, the most frequent zone",
    "cells x4": "of 4 x 4",
}
SCALES = {"boulders": 100.0, "energy_total": 1e-3}  # per cent, kJ


def text(found: Convergence) -> str:
    """The study, the statistical and the numerical errors, each as a table and what it says."""
    of = f" from each of {found.sources:,} sources" if found.sources > 1 else ""
    parts = [f"{found.name}\n\nBy number of boulders{of}:\n", *_study(found.study)]
    parts += ["", *_study_says(found.study)]
    seconds = f"{1e6 * found.seconds:.0f} microseconds of CPU a boulder"
    parts += [f"\nStatistical error against {found.reference:,} boulders, {seconds}:\n"]
    parts += [*_cost(found.cost), "", *_cost_says(found)]
    parts += [f"\nNumerical error, {found.paired:,} boulders on each terrain:\n"]
    parts += [*_numerical(found), "", *_numerical_says(found)]
    return "\n".join(parts)


def _label(key: tuple[str, str, str], share: str = "") -> str:
    """Line, quantity and statistic, in columns."""
    line, quantity, statistic = key
    return f"  {line:10.10} {NAMES[quantity]:15}{share if quantity == 'boulders' else statistic:6}"


def _study(study: pd.DataFrame) -> Iterator[str]:
    sizes = sorted(study["boulders"].unique())
    yield f"{'':34}" + "".join(f"{size:>10,}" for size in sizes)
    for key, one in study.groupby(KEYS, sort=False):
        values = SCALES.get(key[1], 1.0) * one["value"]
        yield _label(key, "%") + "".join(f"{_known(value, '.4g'):>10}" for value in values)


def _study_says(study: pd.DataFrame) -> Iterator[str]:
    """From how many boulders on changes are small, and how wide the last intervals are."""
    sizes = sorted(study["boulders"].unique())
    table = study[study["statistic"] != "max"]
    settled = sizes[-1]
    for size, before in zip(sizes[:0:-1], sizes[-2::-1], strict=True):
        change = table[table["boulders"] == size].set_index(KEYS)["change"].abs().dropna()
        if not change.empty and change.max() >= SMALL:
            most = _rule(change.idxmax())
            by = "from 0" if np.isinf(change.max()) else f"by {change.max():.1%}"
            yield f"At {size:,} boulders {most} still changed {by}."
            break
        settled = before
    if settled < sizes[-1]:
        yield f"From {settled:,} boulders on no number changes by {SMALL:.0%} or more at a step."
    yield "Maxima are apart, they grow with n. The paper has changes below 5 % from 1,000 on."
    last = table[table["boulders"] == sizes[-1]].set_index(KEYS)
    half = ((last["high"] - last["low"]) / 2 / last["value"].abs())[last["value"] != 0].dropna()
    if len(half):
        yield (
            f"A small change is not a small error: the widest of the intervals at {sizes[-1]:,} is "
            f"that of {_rule(half.idxmax())}, +- {half.max():.1%}."
        )


def _rule(key: tuple[str, str, str]) -> str:
    """A number as a rule of `rockfall run --until` has it."""
    line, quantity, statistic = key
    return f"fraction@{line}" if quantity == "boulders" else f"{quantity}.{statistic}@{line}"


def _cost(cost: pd.DataFrame) -> Iterator[str]:
    costs = "".join(f"{f'{error:.3g} %':>10}" for error in 100 * np.array(ERRORS))
    yield f"{'':34}{'slope':>15}{f'{SIZE:,}':>10}   CPU s for{costs}"
    for row in cost.itertuples(index=False):
        slope = _changed(row.slope, row.slope_error, ".2f")
        seconds = "".join(f"{_short(one):>10}" for one in row[-len(ERRORS) :])
        yield f"{_label(row[:3])}{slope:>15}{row.error_10000:>10.2%}{'':12}{seconds}"


def _cost_says(found: Convergence) -> Iterator[str]:
    if found.cost.empty:
        yield "Too few boulders cross a line to measure errors there."
        return
    percent, tenth = found.cost.columns[-2:]
    cost = found.cost.set_index(KEYS)
    for key in (cost[percent].idxmin(), cost[percent].idxmax()):
        one, more = (_short(cost.loc[key, name]) for name in (percent, tenth))
        yield f"{_rule(key)} to 1 % costs {one} s of CPU; one more digit costs 100 times, {more} s."
    yield "Errors are root mean squares; half an interval of 95 % is twice as wide."
    if found.sources > 1:
        yield "The sources are as given: what they differ by is not in these errors."


def _known(value: float, digits: str) -> str:
    return "-" if np.isnan(value) else f"{value:{digits}}"


def _changed(value: float, error: float, digits: str) -> str:
    """A number with its standard error."""
    return "-" if np.isnan(value) else f"{value:{digits}} +- {error:{digits.lstrip('+')}}"


def _short(number: float) -> str:
    """Two digits, without an exponent."""
    return f"{float(f'{number:.2g}'):,.15g}"


def _numerical(found: Convergence) -> Iterator[str]:
    table = found.numerical
    variants = [name for name in table["variant"].unique() if name != AS_GIVEN]
    chance = f"chance, {SIZE:,}"
    yield f"{'':34}{chance:>15}" + "".join(f"{variant:>20}" for variant in variants)
    for key, one in table.groupby(KEYS, sort=False):
        changes = one.set_index("variant").loc[variants]
        chance = one["statistical_error"].iloc[0]
        yield f"{_label(key)}{_known(chance, '.2%'):>15}" + "".join(
            f"{_changed(row.change, row.change_error, '+.2%'):>20}" for row in changes.itertuples()
        )


def _numerical_says(found: Convergence) -> Iterator[str]:
    """For each variant, how many numbers it changes by more than chance can, and the most."""
    table = found.numerical
    for variant, one in table[table["variant"] != AS_GIVEN].groupby("variant", sort=False):
        known = one[one["change"].notna()]
        if not len(known):
            continue
        about = f"{variant} ({TERRAINS[variant]})"
        sure = known[known["change"].abs() > 3 * known["change_error"]]
        if not len(sure):
            yield f"{about}: no change beyond three standard errors of it."
            continue
        most = sure.loc[sure["change"].abs().idxmax()]
        name = _rule(most[KEYS])
        yield (
            f"{about}: {len(sure)} of {len(known)} numbers change by more than three standard "
            f"errors,\n  most {name}: {most['change']:+.2%}."
        )
    for variant, why in found.refused.items():
        yield f"{variant}: not run: {why}"
