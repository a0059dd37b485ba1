# SPDX-License-Identifier: BSD-3-Clause
"""Samples for statistics: values of each boulder, or the bins, sums and largest values that a run
keeps instead (rockfall.result.samples)."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from functools import cached_property
from statistics import NormalDist
from typing import Any

import numpy as np

from rockfall.analysis.precision.intervals import (
    SKEWED_SQUARES,
    Shape,
    Sources,
    Sums,
    between_ranks,
    ranks_around,
    strata,
)
from rockfall.kernel_rules import SAMPLE_BITS, SAMPLE_COARSE, SAMPLE_EDGES
from rockfall.limits import MIN_FOR_STD

OF_SQUARES = False, MIN_FOR_STD, SKEWED_SQUARES  # arguments of `Sums.limits_of_mean` for squares
FITTED, FITTED_POINTS = 3.0, 41  # fit window relative to the interval, and number of points fitted
#: Lower edges and widths of bins, in stored units. A bin of width 1 contains a single number.
LOW, WIDTH = SAMPLE_EDGES[:-1], np.diff(SAMPLE_EDGES)


class Sample(ABC):
    """Values of n boulders among the released boulders."""

    n: int
    released: int

    @abstractmethod
    def mean(self) -> float:
        """Mean; requires n > 0."""

    @abstractmethod
    def std(self) -> float:
        """Standard deviation (n - 1); requires n > 1."""

    @abstractmethod
    def max(self) -> float:
        """Maximum; requires n > 0."""

    @abstractmethod
    def quantile(self, levels: Sequence[float]) -> np.ndarray:
        """Quantiles of type 7 of Hyndman and Fan (1996)."""

    @abstractmethod
    def between(self, level: float, effective: float) -> tuple[float, float]:
        """Order statistics that enclose a quantile, as in `between_ranks`."""

    def fitted_between(self, level: float, effective: float) -> tuple[float, float]:
        """Estimates of the order statistics that enclose a quantile, from a fit of the values in a
        wider range (of their logarithms if all are positive) against normal scores. In a tail, the
        error of the distance between two order statistics is twice that of the fitted distance."""
        ranks = np.clip(ranks_around(self.n, level, effective), 0.5, self.n + 0.5)
        middle = 1 + level * (self.n - 1)
        ends = np.clip(middle + FITTED * (ranks - middle), 1, self.n)
        window = np.linspace(float(ends[0]), float(ends[1]), FITTED_POINTS)
        values = self.quantile(((window - 1) / max(1, self.n - 1)).tolist())
        is_positive = bool((values > 0).all())
        slope, constant = np.polyfit(
            self._scores(window), np.log(values) if is_positive else values, 1
        )
        low, high = constant + slope * self._scores(ranks)
        return (math.exp(low), math.exp(high)) if is_positive else (low, high)

    def _scores(self, ranks: np.ndarray) -> np.ndarray:
        """Normal scores of ranks from 1."""
        levels = np.clip((ranks - 0.5) / self.n, 0.25 / self.n, 1 - 0.25 / self.n)
        return np.array([NormalDist().inv_cdf(level) for level in levels])

    @abstractmethod
    def largest(self, n: int) -> np.ndarray:
        """Largest n known values, in increasing order."""

    @abstractmethod
    def effective_passing(self) -> float:
        """Effective number of independent boulders for the fraction with a value."""

    @abstractmethod
    def effective_below(self, value: float) -> float:
        """Effective number of independent boulders for the fraction of values up to `value`."""

    @abstractmethod
    def limits_of_mean(self, signed: bool) -> tuple[float, float]:
        """Limits of the interval of the mean, minus the mean; NaN for too few values. Unless
        `signed`, values have a lower bound."""

    @abstractmethod
    def limits_of_variance(self) -> tuple[float, float]:
        """Limits of the interval of the mean squared deviation from the trimmed mean, minus this
        mean. The trimmed fraction decreases with the number of values, so that the tail of a
        skewed sample has the same weight as in the population (Bonett 2006)."""

    @property
    def _cut(self) -> int:
        """Number of values trimmed at each end."""
        return min(int(self.n / (2 * math.sqrt(max(self.n - 4, 1)))), (self.n - 1) // 2)


def quantiles(ordered: np.ndarray, levels: Sequence[float]) -> np.ndarray:
    """Quantiles of type 7 of ascending values, faster than `np.quantile`, which partitions
    again."""
    place = np.asarray(levels) * (ordered.size - 1)
    below = place.astype(int)
    part = place - below
    low, high = ordered[below], ordered[np.minimum(below + 1, ordered.size - 1)]
    step = high - low  # bitwise as in NumPy
    return np.where(part < 0.5, low + step * part, high - step * (1 - part))


class Passing:
    """Boulders that have a value, among all released boulders."""

    def __init__(self, everyone: Sources, which: np.ndarray) -> None:
        """`which` are the boulders with a value, as indices or a mask."""
        self.released, self.source = everyone.number.size, everyone[which]
        self.fraction = everyone.indicator(which)


class Values(Sample):
    """Values of individual boulders."""

    def __init__(self, values: np.ndarray, source: Sources | Passing) -> None:
        """Values of the boulders in a `Passing`, or of all boulders of `Sources`, where missing
        values are NaN."""
        if isinstance(source, Sources):
            has = ~np.isnan(values)
            values, source = values[has], Passing(source, has)
        self.values, self._source = values, source.source
        self._fraction = source.fraction
        self.n, self.released = values.size, source.released

    @cached_property
    def _ordered(self) -> np.ndarray:
        return np.sort(self.values)

    def mean(self) -> float:
        return self.values.mean()

    def std(self) -> float:
        return self.values.std(ddof=1)

    def max(self) -> float:
        return self.values.max()

    def quantile(self, levels: Sequence[float]) -> np.ndarray:
        return quantiles(self._ordered, levels)

    def between(self, level: float, effective: float) -> tuple[float, float]:
        return between_ranks(self._ordered, level, effective)

    def largest(self, n: int) -> np.ndarray:
        return self._ordered[max(0, self.n - n) :]

    def effective_passing(self) -> float:
        return self._fraction.effective_number(self.n / self.released)

    def effective_below(self, value: float) -> float:
        return self._source.effective_number(self.values <= value)

    def limits_of_mean(self, signed: bool) -> tuple[float, float]:
        return self._limits_of(self.values, signed)

    def limits_of_variance(self) -> tuple[float, float]:
        middle = float(self._ordered[self._cut : self.n - self._cut].mean())
        return self._limits_of((self.values - middle) ** 2, *OF_SQUARES)

    def _limits_of(self, values: np.ndarray, *rule: Any) -> tuple[float, float]:
        sums = self._source.sums(values - values.mean())
        return sums.limits_of_mean(Shape.of(values), *rule)


class Counts(Sample):
    """Counts of boulders instead of their values. Mean, standard deviation and maximum follow from
    values in integer units; quantiles are accurate within a bin (0.4 % wide). Intervals use the
    counts of each source group in coarse bins, and assume that all groups have the same
    distribution within a bin."""

    def __init__(
        self,
        bins: np.ndarray,
        words: np.ndarray,
        groups: np.ndarray,
        released: np.ndarray,
        unit: float,
        tail: np.ndarray,
        sampled: bool,
    ) -> None:
        """`bins` are counts, `words` (parts, 5) sums, `groups` coarse counts by source group,
        `released` the boulders released from each group, `unit` the stored units per unit of the
        quantity, and `tail` the largest values (may be empty)."""
        used = np.flatnonzero(bins)
        self._bins, self._low, self._width = bins[used], LOW[used], WIDTH[used]
        self._coarse = used // (bins.size // SAMPLE_COARSE)
        self._groups, self._unit, self._sampled = groups, unit, sampled
        self._released, self._tail = released, tail
        self._before = np.cumsum(self._bins) - self._bins
        self.n, self.released = int(bins.sum()), int(released.sum())
        high_, low_, high, low = (int(word) for word in words[:, :4].sum(axis=0, dtype=object))
        self._sum = (high_ << SAMPLE_BITS) + low_
        self._squares = (high << SAMPLE_BITS) + low
        self._max = words[:, 4].max() / unit

    def mean(self) -> float:
        return self._sum / self.n / self._unit

    def std(self) -> float:
        squares = self.n * self._squares - self._sum**2
        return math.sqrt(squares / (self.n * (self.n - 1))) / self._unit

    def max(self) -> float:
        return float(self._tail[-1]) if self._tail.size else self._max

    def quantile(self, levels: Sequence[float]) -> np.ndarray:
        return self._at(np.asarray(levels) * (self.n - 1))

    def between(self, level: float, effective: float) -> tuple[float, float]:
        ranks = ranks_around(self.n, level, effective) - 1
        is_inside = (ranks >= 0) & (ranks <= self.n - 1)
        low, high = np.where(is_inside, self._at(np.clip(ranks, 0, self.n - 1)), np.nan)
        return low, high

    def largest(self, n: int) -> np.ndarray:
        return self._tail[max(0, self._tail.size - n) :]

    def _at(self, ranks: np.ndarray) -> np.ndarray:
        """Interpolated values at 0-based ranks."""
        below = np.floor(ranks).astype(int)
        low, high = self._ranked(below), self._ranked(np.minimum(below + 1, self.n - 1))
        return low + (high - low) * (ranks - below)

    def _ranked(self, rank: np.ndarray) -> np.ndarray:
        """Values at integer ranks: exact for the largest values, uniform within bins for others."""
        k = np.searchsorted(self._before + self._bins, rank, side="right")
        alone = self._width[k] == 1
        within = np.where(alone, 0.5, (rank - self._before[k] + 0.5) / self._bins[k])
        values = (self._low[k] + self._width[k] * within) / self._unit
        if not self._tail.size:
            return values
        place = rank - (self.n - self._tail.size)
        return np.where(
            place >= 0, self._tail[np.maximum(place, 0)], np.minimum(values, self._tail[0])
        )

    def effective_passing(self) -> float:
        fraction = self.n / self.released
        passed = self._groups.sum(axis=1)
        missed = self._released - passed
        total = passed * (1 - fraction) - missed * fraction
        squares = passed * (1 - fraction) ** 2 + missed * fraction**2
        return self._sums(self._released, total, squares).effective_number(fraction)

    def effective_below(self, value: float) -> float:
        above = value * self._unit - self._low
        share = np.where(self._width == 1, above + 1e-6 >= 0.5, np.clip(above / self._width, 0, 1))
        fraction = float(self._bins @ share) / self.n
        squares = share * (1 - fraction) ** 2 + (1 - share) * fraction**2
        return self._by_group(share - fraction, squares).effective_number(fraction)

    def limits_of_mean(self, signed: bool) -> tuple[float, float]:
        return self._limits_of((self._low + self._width / 2) / self._unit, signed)

    def limits_of_variance(self) -> tuple[float, float]:
        values = (self._low + self._width / 2) / self._unit
        ends = np.clip([self._before, self._before + self._bins], self._cut, self.n - self._cut)
        within = ends[1] - ends[0]
        middle = within @ values / within.sum()
        return self._limits_of((values - middle) ** 2, *OF_SQUARES)

    def _limits_of(self, numbers: np.ndarray, *rule: Any) -> tuple[float, float]:
        """Limits for the mean of a variable that has one value per bin."""
        shape = Shape.of(numbers, self._bins)
        numbers = numbers - self._bins @ numbers / self.n
        return self._by_group(numbers, numbers**2).limits_of_mean(shape, *rule)

    def _by_group(self, numbers: np.ndarray, squares: np.ndarray) -> Sums:
        """Sums of a variable and its square in each bin, by group."""
        n, *sums = (
            np.bincount(self._coarse, self._bins * v, SAMPLE_COARSE)
            for v in (np.ones(self._bins.size), numbers, squares)
        )
        means = (v / np.maximum(n, 1) for v in sums)
        return self._sums(self._groups.sum(axis=1), *(self._groups @ mean for mean in means))

    def _sums(self, n: np.ndarray, total: np.ndarray, squares: np.ndarray) -> Sums:
        """Sums by stratum, or by group if sources are sampled."""
        size = self._released.size
        clusters = np.arange(size) if self._sampled else strata(self._released)
        n, total, squares, released = (
            np.bincount(clusters, v, size) for v in (n, total, squares, self._released)
        )
        return Sums(n, total, squares, released, self._sampled)
