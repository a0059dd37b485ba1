# SPDX-License-Identifier: BSD-3-Clause
"""Differences between two runs with the same boulders, with 95 % intervals that account for
sources.

With common random numbers a boulder starts identically in both runs and has the same random
numbers at its rebounds. Differences are taken boulder by boulder, so common random variation
cancels. Intervals cover the Monte Carlo error of a difference, not the model error. Boulders
without a value have NaN.
"""

from __future__ import annotations

import math
import warnings
from typing import NamedTuple

import numpy as np

from rockfall.analysis.precision.intervals import (
    WITHHELD,
    Shape,
    Sources,
    between_ranks,
    fraction_interval,
)
from rockfall.kernel_rules import Z
from rockfall.limits import MIN_FOR_MEAN

LEVEL = 0.95
Difference = tuple[float, float, float]  # value and limits; NaN: too few values
NONE = 0.0, 0.0, 0.0


class Estimate(NamedTuple):
    """A statistic of the boulders that have a value, and the contribution of each released boulder
    to its error (influence with mean 0; Hampel 1974). With too few boulders, `influence` is None;
    without boulders, `value` is NaN."""

    value: float
    influence: np.ndarray | None = None


def mean_of(values: np.ndarray, fewest: int = MIN_FOR_MEAN) -> Estimate:
    """Mean of the known values (not NaN); without influences if there are fewer than `fewest`."""
    has = ~np.isnan(values)
    if has.sum() < fewest:
        return Estimate(float(np.mean(values[has])) if has.any() else math.nan)
    mean = float(values[has].mean())
    return Estimate(mean, np.where(has, values - mean, 0.0) / has.mean())


def quantile_of(values: np.ndarray, level: float = LEVEL) -> Estimate:
    """Quantile of the known values (not NaN). Its influence uses the density between the order
    statistics that enclose it (Woodruff 1952); without influences if the sample lacks these order
    statistics."""
    has = ~np.isnan(values)
    if not has.any():
        return Estimate(math.nan)
    ordered = np.sort(values[has])
    quantile = float(np.quantile(ordered, level))
    low, high = between_ranks(ordered, level, ordered.size)
    if not np.isfinite(high - low):
        return Estimate(quantile)
    of_rank = (high - low) / (2 * Z * math.sqrt(level * (1 - level) / ordered.size))
    below = np.where(has, level - (values <= quantile), 0.0)
    return Estimate(quantile, of_rank * below / has.mean())


def difference(here: Estimate, before: Estimate, source: Sources) -> Difference:
    """Difference of two estimates from the same boulders."""
    value = here.value - before.value
    if here.influence is None or before.influence is None:
        return value, *WITHHELD
    low, high = _limits(here.influence - before.influence, source)
    return value, value + low, value + high


def mean_difference(apart: np.ndarray, source: Sources) -> Difference:
    """Mean difference of boulders that all have a value in both runs."""
    if not apart.any():
        return NONE
    mean, (low, high) = float(apart.mean()), _limits(apart, source)
    return mean, mean + low, mean + high


def difference_of_means(here: np.ndarray, before: np.ndarray, source: Sources) -> Difference:
    """Difference between the means over the boulders that have a value in each run. Each mean is a
    ratio of means over all boulders; the interval is linearised (Cochran 1977)."""
    ours, theirs = mean_of(here, fewest=2), mean_of(before, fewest=2)
    value = ours.value - theirs.value
    if ours.influence is None or theirs.influence is None:
        equal = value == 0 and np.array_equal(here, before, equal_nan=True)
        return NONE if equal else (value, *WITHHELD)
    mean, *ends = mean_difference(ours.influence - theirs.influence, source)
    low, high = (value + end - mean for end in ends)
    return value + mean - mean, low, high


def changed_sides(here: np.ndarray, before: np.ndarray, source: Sources) -> Difference:
    """Difference between the fractions of the boulders chosen in each run (masks). If all changes
    are in one direction, this is the fraction that changed (negative: lost), with its limits;
    without changes, 0 between the limits of both directions."""
    gained, lost = here & ~before, before & ~here
    if gained.any() and lost.any():
        return mean_difference(here * 1.0 - before, source)
    moved, low, high = fraction_interval(gained | lost, source)
    if not moved:
        return 0.0, -high, high
    return (moved, low, high) if gained.any() else (-moved, -high, -low)


def difference_of_fractions(here: np.ndarray, before: np.ndarray, source: Sources) -> Difference:
    """Difference between two fractions, with their correlation within sources (Newcombe 1998,
    method 10)."""
    (p, p_low, p_high), (q, q_low, q_high) = (
        fraction_interval(holds, source) for holds in (here, before)
    )
    correlation = _correlation(here, before, source)
    low = _hypotenuse(p - p_low, q_high - q, correlation)
    high = _hypotenuse(p_high - p, q - q_low, correlation)
    return p - q, p - q - low, p - q + high


def relative_changes(
    whole: np.ndarray, before: np.ndarray, parts: np.ndarray, parts_before: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Relative changes of statistics (...) over all boulders, and standard errors from the values
    for parts (..., parts). NaN for changes from 0."""
    before = np.where(before == 0, np.nan, before)
    with np.errstate(invalid="ignore"), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Degrees of freedom")  # raised where no boulder crossed
        apart = (parts - parts_before) / before[..., None]
        error = np.nanstd(apart, axis=-1, ddof=1) / np.sqrt(np.isfinite(apart).sum(axis=-1))
        return whole / before - 1, error


def _limits(apart: np.ndarray, source: Sources) -> tuple[float, float]:
    """Limits of the interval of a mean, minus the mean."""
    return source.sums(apart - apart.mean()).limits_of_mean(Shape.of(apart), signed=True)


def _hypotenuse(first: float, other: float, correlation: float) -> float:
    return math.sqrt(max(0.0, first**2 - 2 * correlation * first * other + other**2))


def _correlation(here: np.ndarray, before: np.ndarray, source: Sources) -> float:
    """Correlation of two indicators within sources or, for sampled sources, of their sums."""

    def apart(indicator: np.ndarray) -> np.ndarray:
        if source.sampled:
            return np.bincount(source.number, indicator - indicator.mean())
        n = np.maximum(source.released, 1)
        return indicator - (np.bincount(source.stratum, indicator, n.size) / n)[source.stratum]

    outer, other = apart(here.astype(float)), apart(before.astype(float))
    size = math.sqrt((outer @ outer) * (other @ other))
    return float(outer @ other / size) if size else 0.0
