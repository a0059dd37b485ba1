# SPDX-License-Identifier: BSD-3-Clause
"""What the boulders did at the evaluation lines, in numbers with their uncertainty.

Every interval is a 95 % confidence interval for as many other boulders, as
`rockfall.analysis.precision.intervals` has it: it holds the Monte Carlo error.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from rockfall.analysis.lines.groups import groups
from rockfall.analysis.lines.heights import HEIGHTS, height
from rockfall.analysis.precision.intervals import (
    Sources,
    between_ranks,
    effective_number,
    fraction_interval,
    half_of_mean,
    sources,
)
from rockfall.limits import Z
from rockfall.terrain.polyline import beside

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

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


def line_statistics(
    result: xr.Dataset, by: str | None = None, classes: Sequence[float] | None = None
) -> pd.DataFrame:
    """One row for each line and quantity: n and fraction of the boulders that crossed, then mean,
    standard deviation (n - 1), quantiles and maximum, in the units of the result; NaN where none
    crossed. `NAME_low` and `NAME_high` are the limits of the 95 % confidence interval of fraction
    (Wilson 1927), mean, std and quantiles (order statistics). The maximum has none: it grows with
    n. Where tails are heavy, those of the mean hold less than 93 % below 50 boulders, those of std
    below 200 (docs/validation/benchmarks.md).

    by = 'source' or 'volume' has these rows for each group of boulders, named in a column of that
    name beside `boulders`, how many were released, of which `fraction` is then; `classes` are the
    edges between classes of volume [m3] (see `rockfall.analysis.lines.groups.groups`). Raises
    RockfallError for another `by`, or edges that do not rise.

    energy_total is E_trans + E_rot, rotational_share is E_rot / E_total; position is how far along
    the line from its first vertex a boulder crossed [m]: its std is the lateral spread. jump_height
    is that of the boulder's point, passing_height of its centre, upper_edge of its highest point,
    all vertical; normal_height and normal_upper_edge are those normal to the slope.

    Boulders of &case sampling = 'sobol' are spread more evenly than random ones, and the intervals
    do not know it: they are those of as many random boulders, and too wide
    (docs/validation/benchmarks.md).

    >>> import rockfall
    >>> result = rockfall.run(rockfall.read_case("case.nml"))
    >>> table = rockfall.line_statistics(result)
    >>> table[["line", "quantity"]].iloc[0].tolist()
    ['L', 'speed']
    """
    import pandas as pd

    source = sources(result)
    parts = groups(result, by, classes) if by else [("", np.full(source.number.size, True))]
    rows = []
    for k, line in enumerate(result["line"].values if "line" in result else []):
        values = {quantity: line_values(result, quantity, k) for quantity in QUANTITIES}
        for name, chosen in parts:
            about = {"line": line} | ({by: name, "boulders": int(chosen.sum())} if by else {})
            for quantity in QUANTITIES:
                numbers = _numbers(values[quantity][chosen], source[chosen], quantity)
                rows.append({**about, "quantity": quantity, **numbers})
    split = [by, "boulders"] if by else []
    return pd.DataFrame(rows, columns=["line", *split, "quantity", *_COLUMNS])


def line_values(result: Held, quantity: str, line: int) -> np.ndarray:
    """A quantity of each boulder at a line; NaN where it did not cross."""
    if quantity == "position":
        return _along(result, line)

    def at_line(name: str) -> np.ndarray:
        return result[f"line_{name}"].values[line]

    if quantity in ("energy_total", "rotational_share"):
        rotation = at_line("energy_rotational")
        total = at_line("energy_translational") + rotation
        if quantity == "energy_total":
            return total
        with np.errstate(invalid="ignore"):
            return np.where(total > 0, rotation / total, np.where(np.isnan(total), np.nan, 0.0))
    if quantity in HEIGHTS:
        volume = result["volume"].values
        return height(quantity, at_line("jump_height"), at_line("passing_height"), volume)
    return at_line(quantity)


def _along(result: Held, line: int) -> np.ndarray:
    """How far from the first vertex of a line, along it, each boulder crossed."""
    mine = result["line_vertex_line"].values == line
    vertices = (result["line_vertex_x"].values + 1j * result["line_vertex_y"].values)[mine]
    at = result["line_x"].values[line] + 1j * result["line_y"].values[line]
    return beside(at, vertices)[1]


def line_numbers(result: Held, line: int, quantity: str, source: Sources) -> dict[str, float]:
    """A row of `line_statistics`: what is known of a quantity at the line of this index; `source`
    is that of each boulder."""
    return _numbers(line_values(result, quantity, line), source, quantity)


def _numbers(values: np.ndarray, source: Sources, quantity: str) -> dict[str, float]:
    """Those of a quantity of boulders from these sources, NaN where they did not cross."""
    crossed = ~np.isnan(values)
    n, all_n = int(crossed.sum()), values.size
    row: dict[str, float] = {"n": n, "fraction": n / max(1, all_n)}
    if all_n:
        _, row["fraction_low"], row["fraction_high"] = fraction_interval(crossed, source)
    if not n:
        return row
    return row | sample_numbers(values[crossed], source[crossed], signed=quantity == "omega")


def sample_numbers(v: np.ndarray, source: Sources, signed: bool = False) -> dict[str, float]:
    """Mean, standard deviation, quantiles and maximum of values of boulders from these sources,
    with their intervals; those that one value cannot have are absent. Unless they are `signed`, no
    mean is below 0, and no interval: it holds its mean as often."""
    row = {"mean": v.mean(), "max": v.max()}
    ordered = np.sort(v)
    for level, value in zip(QUANTILES, np.quantile(ordered, QUANTILES), strict=True):
        name = quantile_name(level)
        effective = effective_number((v <= value).astype(float), source)
        row[name] = value
        row[f"{name}_low"], row[f"{name}_high"] = between_ranks(ordered, level, effective)
    if v.size > 1:
        row["std"] = v.std(ddof=1)
        half = half_of_mean(v, source)
        row["mean_low"], row["mean_high"] = v.mean() - half, v.mean() + half
        if not signed:
            row["mean_low"] = max(0.0, row["mean_low"])
        if row["std"] > 0 and v.size > 2:  # of the variance, through its logarithm
            half = half_of_mean((v - _middle(ordered)) ** 2, source) / (2 * row["std"] ** 2)
            factor = np.exp(half * v.size / (v.size - Z))  # few hide their tail (Bonett 2006)
            row["std_low"], row["std_high"] = row["std"] / factor, row["std"] * factor
    return row


def _middle(ordered: np.ndarray) -> float:
    """The mean without some of both ends, the fewer the more values there are: about it the tail of
    a skewed sample weighs as much as in its population (Bonett 2006)."""
    n = ordered.size
    cut = min(int(n / (2 * math.sqrt(max(n - 4, 1)))), (n - 1) // 2)
    return float(ordered[cut : n - cut].mean())


def quantile_name(level: float) -> str:
    return f"q{level * 100:.0f}"


def with_limits(name: str) -> list[str]:
    return [name, f"{name}_low", f"{name}_high"]


_COLUMNS = ["n", *with_limits("fraction"), *with_limits("mean"), *with_limits("std"), "max"]
_COLUMNS += [name for level in QUANTILES for name in with_limits(quantile_name(level))]
