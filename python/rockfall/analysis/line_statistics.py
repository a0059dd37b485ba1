# SPDX-License-Identifier: BSD-3-Clause
"""What the boulders did at the evaluation lines, in numbers with their uncertainty.

Every interval is a 95 % confidence interval for as many other boulders: it holds the Monte Carlo
error. Where there are several sources, the boulders of each are a cluster: what one of them does
tells of the others. Few sources tell little of what others would do: the intervals of two are 6.5
times as long as a normal distribution would have them (Student's).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from rockfall.limits import Z, fraction_limits
from rockfall.terrain.polyline import beside

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

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
    "position",
)


def line_statistics(result: xr.Dataset) -> pd.DataFrame:
    """One row for each line and quantity: n and fraction of the boulders that crossed, then mean,
    standard deviation (n - 1), quantiles and maximum, in the units of the result; NaN where none
    crossed. `NAME_low` and `NAME_high` are the limits of the 95 % confidence interval of fraction
    (Wilson 1927), mean, std and quantiles (order statistics). The maximum has none: it grows with
    n.

    energy_total is E_trans + E_rot, rotational_share is E_rot / E_total; position is how far along
    the line from its first vertex a boulder crossed [m]: its std is the lateral spread.

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
    rows = []
    for k, line in enumerate(result["line"].values if "line" in result else []):
        for quantity in QUANTITIES:
            numbers = line_numbers(result, k, quantity, source)
            rows.append({"line": line, "quantity": quantity, **numbers})
    return pd.DataFrame(rows, columns=["line", "quantity", *_COLUMNS])


def line_values(result: xr.Dataset, quantity: str, line: int) -> np.ndarray:
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
    return at_line(quantity)


def _along(result: xr.Dataset, line: int) -> np.ndarray:
    """How far from the first vertex of a line, along it, each boulder crossed."""
    mine = result["line_vertex_line"].values == line
    vertices = (result["line_vertex_x"].values + 1j * result["line_vertex_y"].values)[mine]
    at = result["line_x"].values[line] + 1j * result["line_y"].values[line]
    return beside(at, vertices)[1]


def sources(result: xr.Dataset) -> np.ndarray:
    """Number of the source of each boulder, from 0; boulders of a source start at one place."""
    start = result["start_x"].values + 1j * result["start_y"].values
    return np.unique(start, return_inverse=True)[1]


def line_numbers(
    result: xr.Dataset, line: int, quantity: str, source: np.ndarray
) -> dict[str, float]:
    """A row of `line_statistics`: what is known of a quantity at the line of this index; `source`
    is that of each boulder, from `sources`."""
    values = line_values(result, quantity, line)
    crossed = ~np.isnan(values)
    n, all_n = int(crossed.sum()), values.size
    row: dict[str, float] = {"n": n, "fraction": n / max(1, all_n)}
    if all_n:
        _, row["fraction_low"], row["fraction_high"] = fraction_interval(crossed, source)
    return row | (sample_numbers(values[crossed], source[crossed]) if n else {})


def sample_numbers(v: np.ndarray, cluster: np.ndarray) -> dict[str, float]:
    """Mean, standard deviation, quantiles and maximum of values that come in clusters, with their
    intervals; those that one value cannot have are absent."""
    row = {"mean": v.mean(), "max": v.max()}
    ordered = np.sort(v)
    for level, value in zip(QUANTILES, np.quantile(ordered, QUANTILES), strict=True):
        name = quantile_name(level)
        effective = effective_number((v <= value).astype(float), cluster)
        row[name] = value
        row[f"{name}_low"], row[f"{name}_high"] = between_ranks(ordered, level, effective)
    if v.size > 1:
        row["std"] = v.std(ddof=1)
        half = _half_of_mean(v, cluster)
        row["mean_low"], row["mean_high"] = v.mean() - half, v.mean() + half
        if row["std"] > 0 and v.size > 2:  # of the variance, through its logarithm
            half = _half_of_mean((v - v.mean()) ** 2, cluster) / (2 * row["std"] ** 2)
            factor = np.exp(half * v.size / (v.size - Z))  # few hide their tail (Bonett 2006)
            row["std_low"], row["std_high"] = row["std"] / factor, row["std"] * factor
    return row


def half_width(row: Mapping[str, float], name: str) -> float:
    """Half the length of a confidence interval, relative to its number: 0 of equal values, inf of
    the number 0, NaN without an interval."""
    value = row.get(name, np.nan)
    if name == "std" and value == 0:
        return 0.0
    half = (row.get(f"{name}_high", np.nan) - row.get(f"{name}_low", np.nan)) / 2
    if half == 0 or np.isnan(half):
        return half
    return half / abs(value) if value else np.inf


def fraction_interval(holds: np.ndarray, source: np.ndarray) -> tuple[float, float, float]:
    """Fraction of the boulders of which something holds, and the limits of its 95 % interval."""
    fraction = float(holds.mean())
    return fraction, *fraction_limits(fraction, effective_number(holds.astype(float), source))


def _half_of_mean(v: np.ndarray, cluster: np.ndarray) -> float:
    """Half the interval of the mean of values that come in clusters: that of as many independent
    values, or what the clusters tell where that is more."""
    alone = student(v.size - 1) * v.std(ddof=1) / np.sqrt(v.size)
    return max(alone, _half_of_clusters(v, cluster))


def _half_of_clusters(v: np.ndarray, cluster: np.ndarray) -> float:
    """The same as the clusters differ (linearised; Cochran 1977); 0 where there is but one. Few
    clusters hardly know how much: Student's distribution has their number less one."""
    sums = np.bincount(cluster, v - v.mean())[np.bincount(cluster) > 0]
    if sums.size == 1:  # one source: its boulders are independent
        return 0.0
    error = np.sqrt((sums**2).sum() * sums.size / (sums.size - 1)) / v.size
    return student(sums.size - 1) * error


def effective_number(indicator: np.ndarray, cluster: np.ndarray) -> float:
    """As many independent boulders would know the fraction of an indicator as well (Korn and
    Graubard 1998)."""
    half = _half_of_clusters(indicator, cluster)
    fraction = indicator.mean()
    plain = Z**2 * fraction * (1 - fraction)
    return min(float(indicator.size), plain / half**2) if half else float(indicator.size)


def student(freedom: int) -> float:
    """Student's t that 97.5 % do not exceed."""
    from scipy.special import stdtrit

    return float(stdtrit(freedom, 0.975))


def between_ranks(ordered: np.ndarray, level: float, effective: float) -> tuple[float, float]:
    """The order statistics that enclose a quantile, interpolated between ranks, without which a
    small sample's intervals would hold too much; NaN where the sample ends before them. (SciPy's
    quantile_test does not interpolate, and knows no clusters.)"""
    half = Z * np.sqrt(level * (1 - level) / effective)
    n = ordered.size
    low, high = np.interp(
        n * np.array([level - half, level + half]) + 0.5,
        np.arange(1, n + 1),
        ordered,
        np.nan,
        np.nan,
    )
    return low, high


def quantile_name(level: float) -> str:
    return f"q{level * 100:.0f}"


def with_limits(name: str) -> list[str]:
    return [name, f"{name}_low", f"{name}_high"]


_COLUMNS = ["n", *with_limits("fraction"), *with_limits("mean"), *with_limits("std"), "max"]
_COLUMNS += [name for level in QUANTILES for name in with_limits(quantile_name(level))]
