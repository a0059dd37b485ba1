# SPDX-License-Identifier: BSD-3-Clause
"""Statistics of boulders at evaluation lines, with uncertainty.

Intervals are 95 % confidence intervals from `rockfall.analysis.precision.intervals`; they cover
the Monte Carlo error.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from rockfall.analysis.lines.samples import LineSamples
from rockfall.analysis.precision.intervals import Sources
from rockfall.analysis.precision.samples import Sample, Values
from rockfall.errors import RockfallError
from rockfall.kernel_rules import fraction_limits
from rockfall.result.crossings import HEIGHTS, chosen_lines
from rockfall.simulation.progress import stepped

if TYPE_CHECKING:
    import pandas as pd

    from rockfall.result.contents import Held

QUANTILES = (0.50, 0.90, 0.95, 0.98, 0.99)
QUANTITIES = (
    "speed",
    "jump_height",
    "passing_height",
    "omega",
    "energy_translational",
    "energy_rotational",
    "energy_total",
    "rotational_share",
    *HEIGHTS,
    "position",
)

FRAGMENTS = "fragments"  # additional quantity if boulders may break

SIGNED = ("omega", "position")  # signed quantities, unbounded in both directions


def line_statistics(
    result: Held,
    by: str | None = None,
    classes: Sequence[float] | None = None,
    quantities: Sequence[str] | None = None,
    lines: Sequence[str | int] | None = None,
) -> pd.DataFrame:
    """One row for each line and quantity (or for the chosen `lines`, by name or index, and
    `quantities`): number n and fraction of the boulders that crossed, then mean, standard deviation
    (n - 1), quantiles and maximum, in the units of the result; NaN where none crossed. `NAME_low`
    and `NAME_high` are the limits of the 95 % confidence interval of fraction (Wilson 1927), mean,
    std (Hall 1992) and quantiles (order statistics). The maximum has no interval, because it grows
    with n. With too few boulders limits are NaN: for the mean below 10 boulders, for std below 100,
    and for quantiles whose limits lie beyond the sample. `withheld` lists the statistics without an
    interval.

    by = 'source', 'volume' or 'shape' gives these rows for each group of boulders. A column of that
    name has the group, and `boulders` its released number, the denominator of `fraction`; `classes`
    are the edges between classes of volume [m3] (see `rockfall.analysis.lines.groups.groups`).
    Raises RockfallError for an unknown `by`, quantity or line, or edges that do not increase.

    energy_total is E_trans + E_rot, and rotational_share is E_rot / E_total. position is the
    distance from the first vertex along the line to the crossing [m]; its std is the lateral
    spread. jump_height refers to the boulder's point, passing_height to its centre, upper_edge to
    its highest point, all vertical; normal_height and normal_upper_edge are normal to the slope.
    Where boulders may break, fragments is the number of fragments of a boulder that crossed; the
    other numbers refer to its most energetic fragment (docs/breakage.md).

    >>> import rockfall
    >>> result = rockfall.run(rockfall.read_case("case.nml"))
    >>> table = rockfall.line_statistics(result)
    >>> table[["line", "quantity"]].iloc[0].tolist()
    ['L', 'speed']
    """
    import pandas as pd

    known_quantities = QUANTITIES + ((FRAGMENTS,) if f"crossing_{FRAGMENTS}" in result else ())
    chosen_quantities = known_quantities if quantities is None else quantities
    for chosen_quantity in chosen_quantities:
        if chosen_quantity not in known_quantities:
            all_ = ", ".join(known_quantities)
            raise RockfallError(
                f"quantities: unknown quantity '{chosen_quantity}': must be one of {all_}"
            )
    samples = LineSamples(result)
    parts = samples.groups(by, classes) if by else [("", None)]
    rows = []
    for k, line in stepped(chosen_lines(result, lines)):
        for name, chosen in parts:
            for quantity in chosen_quantities:
                attrs: dict[str, object] = {"line": line}
                if by is None:
                    row = numbers_at(samples, k, quantity)
                else:
                    sample = samples.sample(k, quantity, chosen)
                    row = numbers(sample, quantity)
                    attrs |= {by: name, "boulders": sample.released}
                attrs |= {"quantity": quantity, "withheld": ", ".join(withheld(row))}
                rows.append({**attrs, **row})
    split = [by, "boulders"] if by else []
    return pd.DataFrame(rows, columns=["line", *split, "quantity", *COLUMNS])


def line_numbers(
    result: Held, line: int, quantity: str, source: Sources | None = None
) -> dict[str, float]:
    """Row of `line_statistics` for a quantity at the line with index `line`; `source` replaces the
    sources of the boulders."""
    return numbers(LineSamples(result, source).sample(line, quantity), quantity)


def numbers_at(samples: LineSamples, line: int, quantity: str) -> dict[str, float]:
    """Statistics of a quantity for all boulders at the line with this index, cached."""
    kept = samples.kept(line)
    if quantity not in kept:
        kept[quantity] = numbers(samples.sample(line, quantity), quantity)
    return kept[quantity]


def numbers(sample: Sample, quantity: str) -> dict[str, float]:
    """Row of `line_statistics` for a quantity, from a sample."""
    row: dict[str, float] = {"n": sample.n, "fraction": sample.n / max(1, sample.released)}
    if sample.released:
        row["fraction_low"], row["fraction_high"] = fraction_limits(
            row["fraction"], sample.effective_passing()
        )
    return row | (numbers_of(sample, quantity in SIGNED) if sample.n else {})


def sample_numbers(v: np.ndarray, source: Sources, signed: bool = False) -> dict[str, float]:
    """Mean, standard deviation, quantiles and maximum of one value per boulder, with intervals.
    Statistics that a single value does not define are absent; limits from too few values are NaN.
    Unless `signed`, the lower limit of the mean is at least 0."""
    return numbers_of(Values(v, source), signed)


def numbers_of(sample: Sample, signed: bool = False) -> dict[str, float]:
    """Mean, standard deviation, quantiles and maximum of a non-empty sample, with intervals. Unless
    `signed`, the lower limit of the mean is at least 0."""
    row = {"mean": sample.mean(), "max": sample.max()}
    for level, value in zip(QUANTILES, sample.quantile(QUANTILES), strict=True):
        name = quantile_name(level)
        row[name] = value
        effective = sample.effective_below(value)
        row[f"{name}_low"], row[f"{name}_high"] = sample.between(level, effective)
    low, high = sample.limits_of_mean(signed)
    row["mean_low"], row["mean_high"] = row["mean"] + low, row["mean"] + high
    if not signed:
        row["mean_low"] = np.maximum(0.0, row["mean_low"])  # NaN stays NaN
    if sample.n > 1:
        row["std"] = sample.std()
        low, high = np.maximum(0.0, row["std"] ** 2 + np.array(sample.limits_of_variance()))
        row["std_low"], row["std_high"] = float(np.sqrt(low)), float(np.sqrt(high))
    return row


def withheld(row: Mapping[str, float]) -> list[str]:
    """Names of the statistics in a row that lack a complete interval: too few boulders crossed."""
    return [
        name
        for name in ("mean", "std", *map(quantile_name, QUANTILES))
        if np.isfinite(row.get(name, np.nan))
        and not np.isfinite([row[f"{name}_low"], row[f"{name}_high"]]).all()
    ]


def row_name(quantity: str) -> str:
    """Quantity of the row that has the statistics of `quantity`: the speed for "fraction", which
    has no row of its own."""
    return "speed" if quantity == "fraction" else quantity


def quantile_name(level: float) -> str:
    """Name of a quantile in tables, such as q95 for 0.95."""
    return f"q{level * 100:.0f}"


def with_limits(name: str) -> list[str]:
    """Column names of a statistic and its 95 % limits."""
    return [name, f"{name}_low", f"{name}_high"]


def limited(numbers: Mapping[str, float], name: str) -> list[float]:
    """Statistic and its limits, from a row; NaN where missing."""
    return [numbers.get(key, np.nan) for key in with_limits(name)]


COLUMNS = ["n", *with_limits("fraction"), *with_limits("mean"), *with_limits("std"), "max"]
COLUMNS += [name for level in QUANTILES for name in with_limits(quantile_name(level))]
COLUMNS += ["withheld"]
