# SPDX-License-Identifier: BSD-3-Clause
"""Convergence study as tables and text."""

from collections.abc import Iterator

import numpy as np
import pandas as pd

from rockfall.analysis.precision.intervals import TARGETS, rounded_up
from rockfall.quantities import QUANTITIES, number
from rockfall.studies.convergence import AS_GIVEN, ERRORS, KEYS, SIZE, Convergence
from rockfall.table import Table, as_text

SMALL = 0.05  # smaller changes between steps count as small (paper)
TERRAINS = {
    "float32": "elevations rounded to it",
    "float64": "elevations of float32, plus its rounding error at random",
    "cells x2": "means of 2 x 2 elevations, the most frequent zone",
    "cells x4": "of 4 x 4",
}


def convergence_text(convergence: Convergence) -> str:
    """Results by number of boulders, Monte Carlo errors and numerical errors, as text."""
    place = f" from each of {convergence.sources:,} sources" if convergence.sources > 1 else ""
    parts = [
        f"{convergence.name}\n\nBy number of boulders{place}:\n",
        as_text(study_table(convergence.study)),
    ]
    parts += ["", *_study_says(convergence.study)]
    seconds = f"{1e6 * convergence.seconds:.0f} microseconds of CPU per boulder"
    parts += [f"\nMonte Carlo error against {convergence.reference:,} boulders, {seconds}:\n"]
    parts += [as_text(cost_table(convergence.cost)), "", *_cost_says(convergence)]
    parts += [f"\nNumerical error, {convergence.paired:,} boulders on each terrain:\n"]
    parts += [as_text(numerical_table(convergence)), "", *_numerical_says(convergence)]
    return "\n".join(parts)


def _label(key: tuple[str, str, str]) -> str:
    line, quantity, statistic = key
    if quantity == "boulders":
        return f"{line}: {QUANTITIES[statistic].title}"
    return f"{line}: {QUANTITIES[quantity].title}, {statistic}"


def study_table(study: pd.DataFrame) -> Table:
    """Table of results by number of boulders."""
    rows = []
    for key, group in study.groupby(KEYS, sort=False):
        factor = QUANTITIES[key[2] if key[1] == "boulders" else key[1]].factor
        rows.append((_label(key), *(number(factor * value, 4) for value in group["value"])))
    return Table.of("", ["", *(f"{size:,}" for size in sorted(study["boulders"].unique()))], rows)


def _study_says(study: pd.DataFrame) -> Iterator[str]:
    """Sentences on the number of boulders beyond which changes are small, and on the width of the
    last intervals."""
    sizes = sorted(study["boulders"].unique())
    table = study[study["statistic"] != "max"]
    settled = sizes[-1]
    for size, before in zip(sizes[:0:-1], sizes[-2::-1], strict=True):
        change = table[table["boulders"] == size].set_index(KEYS)["change"].abs().dropna()
        if not change.empty and change.max() >= SMALL:
            worst = _rule(change.idxmax())
            by = "from 0" if np.isinf(change.max()) else f"by {change.max():.1%}"
            yield f"At {size:,} boulders {worst} still changed {by}."
            break
        settled = before
    if settled < sizes[-1]:
        yield f"From {settled:,} boulders on, no value changes by {SMALL:.0%} or more per step."
    yield (
        "Maxima are omitted, as they grow with n. The paper reports changes below 5 % from "
        "1,000 on."
    )
    last = table[table["boulders"] == sizes[-1]].set_index(KEYS)
    half = ((last["high"] - last["low"]) / 2 / last["value"].abs())[last["value"] != 0].dropna()
    if len(half):
        yield (
            f"A small change is not a small error: the widest interval at {sizes[-1]:,} boulders "
            f"is that of {_rule(half.idxmax())}, +- {half.max():.1%}."
        )


def _rule(key: tuple[str, str, str]) -> str:
    """Rule for `rockfall run --until` that corresponds to a number of the study."""
    line, quantity, statistic = key
    return f"fraction@{line}" if quantity == "boulders" else f"{quantity}.{statistic}@{line}"


def cost_table(cost: pd.DataFrame) -> Table:
    """Table of Monte Carlo errors and the cost of reducing them."""
    targets = [f"boulders for +- {100 * target:g} %" for target in TARGETS]
    rows = []
    for row in cost.itertuples(index=False):
        slope = _changed(row.slope, row.slope_error, ".2f")
        seconds = number(row[cost.columns.get_loc("cpu_seconds_1_percent")], 2)
        needs = map(rounded_up, row[-len(TARGETS) :])
        rows.append((_label(row[:3]), slope, f"{row.error_10000:.2%}", seconds, *needs))
    return Table.of("", ("", "slope", f"at {SIZE:,}", "CPU s for 1 %", *targets), rows)


def _cost_says(convergence: Convergence) -> Iterator[str]:
    if convergence.cost.empty:
        yield "Too few boulders cross a line to measure errors there."
        return
    percent, tenth = (f"cpu_seconds_{100 * error:g}_percent" for error in ERRORS[-2:])
    cost = convergence.cost.set_index(KEYS)
    for key in (cost[percent].idxmin(), cost[percent].idxmax()):
        cpu, more = (number(cost.loc[key, name], 2) for name in (percent, tenth))
        yield f"{_rule(key)} to 1 % costs {cpu} s of CPU, one more digit {more} s."
    yield (
        "Errors are root mean squares. Half a 95 % interval, as in --until and reports, is twice "
        "as wide (boulders for +- 2 %)."
    )
    if convergence.sources > 1:
        yield "These errors do not include differences between sources."


def _changed(value: float, error: float, digits: str) -> str:
    """A number with its standard error."""
    return "-" if np.isnan(value) else f"{value:{digits}} +- {error:{digits.lstrip('+')}}"


def numerical_table(convergence: Convergence) -> Table:
    """Table of Monte Carlo errors, and of changes on other versions of the terrain."""
    all_ = convergence.numerical
    variants = [name for name in all_["variant"].unique() if name != AS_GIVEN]
    rows = []
    for key, group in all_.groupby(KEYS, sort=False):
        changes = group.set_index("variant").loc[variants]
        error = group["statistical_error"].iloc[0]
        moved = (_changed(row.change, row.change_error, "+.2%") for row in changes.itertuples())
        rows.append((_label(key), "-" if np.isnan(error) else f"{error:.2%}", *moved))
    return Table.of("", ("", f"Monte Carlo, {SIZE:,}", *variants), rows)


def _numerical_says(convergence: Convergence) -> Iterator[str]:
    """Sentences on the number of significant changes and the largest change, for each variant."""
    all_ = convergence.numerical
    for variant, group in all_[all_["variant"] != AS_GIVEN].groupby("variant", sort=False):
        changed = group[group["change"].notna()]
        if not len(changed):
            continue
        head = f"{variant} ({TERRAINS[variant]})"
        sure = changed[changed["change"].abs() > 3 * changed["change_error"]]
        if not len(sure):
            yield f"{head}: no change exceeds three standard errors."
            continue
        largest = sure.loc[sure["change"].abs().idxmax()]
        yield (
            f"{head}: {len(sure)} of {len(changed)} values change by more than three standard "
            f"errors,\n  the largest change: {_rule(largest[KEYS])}, {largest['change']:+.2%}."
        )
    for variant, why in convergence.refused.items():
        yield f"{variant}: not run: {why}"
