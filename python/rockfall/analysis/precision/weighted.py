# SPDX-License-Identifier: BSD-3-Clause
"""Quantiles and fractions of weighted values, such as boulders of unequal frequency."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rockfall.analysis.precision.design_effect import independent_boulders
from rockfall.kernel_rules import Z, fraction_limits


@dataclass(frozen=True)
class Weighted:
    """Boulders of several runs with common random numbers: weights and cluster indices. A cluster
    is the boulders with the same number or, if sources are sampled, from the same place."""

    weight: np.ndarray
    cluster: np.ndarray

    def __getitem__(self, which: np.ndarray) -> Weighted:
        return Weighted(self.weight[which], self.cluster[which])

    def fraction(self, holds: np.ndarray) -> tuple[float, float, float]:
        """Weighted fraction for which `holds` (boulders,) is True, with its 95 % limits (Wilson
        1927)."""
        fraction = float(self.weight[holds].sum() / self.weight.sum())
        return fraction, *fraction_limits(fraction, self._independent(holds))

    def quantile(self, values: np.ndarray, level: float) -> tuple[float, float, float]:
        """Quantile of boulder values with its limits, as in `quantile_interval`."""
        number = self._independent(values <= value_at(values, self.weight, level))
        return quantile_interval(values, self.weight, level, float(self.weight.sum()) / number)

    def _independent(self, holds: np.ndarray) -> float:
        n = np.bincount(self.cluster, self.weight)
        held = np.bincount(self.cluster[holds], self.weight[holds], n.size)
        return independent_boulders(n[n > 0], held[n > 0], float(self.weight.max()))


def value_at(values: np.ndarray, weights: np.ndarray, level: float) -> float:
    """Value with a given fraction of the weight below it, interpolated between the middles of the
    steps; beyond these, the lowest or highest value (weighted Hazen rule)."""
    ordered, middles = _steps(values, weights)
    return float(np.interp(level, middles, ordered))


def quantile_interval(
    values: np.ndarray, weights: np.ndarray, level: float, unit: float | None = None
) -> tuple[float, float, float]:
    """Quantile with its 95 % limits: order statistics that enclose it, as in `between_ranks` for
    equal weights. NaN without values; a limit beyond the values is NaN.

    Each value is treated as if it had the largest weight. This bounds the variance of the fraction
    below the quantile, w_max p (1 - p)/sum(w), for any values above it; limits from the mean weight
    (Kish 1965) would be too narrow if these have large weights. `unit` is the weight that counts as
    one value (default: the largest). Values from fixed sources vary less (stratification), so the
    limits are never too narrow for them.
    """
    if not values.size:
        return math.nan, math.nan, math.nan
    ordered, middles = _steps(values, weights)
    effective = weights.sum() / (weights.max() if unit is None else unit)
    half = Z * math.sqrt(level * (1 - level) / effective)
    value = float(np.interp(level, middles, ordered))
    low, high = np.interp([level - half, level + half], middles, ordered, np.nan, np.nan)
    return value, float(low), float(high)


def _steps(values: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values in increasing order, and the cumulative weight at the middle of each as a fraction."""
    order = np.argsort(values, kind="stable")
    ordered = weights[order]
    return values[order], (np.cumsum(ordered) - ordered / 2) / ordered.sum()
