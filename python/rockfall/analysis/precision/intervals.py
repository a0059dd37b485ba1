# SPDX-License-Identifier: BSD-3-Clause
"""95 % confidence intervals for values of boulders from given sources, and required numbers of
boulders.

The sources of a case are the complete set: other samples would have the same sources, with the
same number of boulders from each. Boulders are then a stratified sample (Cochran 1977, chapter 5),
and intervals cover only the variation within sources. With &release sources = 'sample' the sources
are a sample: the boulders of each source are a cluster, and few sources represent others poorly
(Student's distribution; with two sources, intervals are 6.5 times as long as normal intervals).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from rockfall.analysis.precision.design_effect import independent_boulders, student
from rockfall.analysis.precision.weighted import Weighted
from rockfall.case import case_of
from rockfall.kernel_rules import Z, fraction_limits, limit_ranks
from rockfall.limits import MIN_FOR_MEAN
from rockfall.result.crossings import has_crossed

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from rockfall.result.contents import Held

TARGETS = (0.05, 0.02, 0.01)  # relative half-widths of intervals for planning
DENSE = 1_000_000  # maximum range of source numbers for a lookup table
CROSSED = 500  # minimum boulders past the line for intervals of statistics other than a fraction
#: Skewness divided by the coefficient of variation: exact for gamma distributions. Small samples
#: rarely show the tail of their distribution, so upper limits assume this skewness.
SKEWED = 2.0
SKEWED_SQUARES = 3.0  # the same ratio for squared deviations
WITHHELD = math.nan, math.nan  # limits if there are too few boulders


@dataclass(frozen=True)
class Sources:
    """Sources of boulders. A selection (`sources[which]`) keeps the numbers released, because the
    number of selected boulders is random, too."""

    number: np.ndarray  # source index of each boulder
    #: Stratum of each boulder: its source; single-boulder sources are merged with others.
    stratum: np.ndarray
    released: np.ndarray  # number of boulders released in each stratum
    sampled: bool = False  # True if the sources are a sample

    @classmethod
    def of(cls, number: np.ndarray, sampled: bool = False) -> Sources:
        """Boulders of these sources. Each source with a single boulder is paired with a neighbour
        by number, so that differences within a pair count as chance (collapsed strata: Cochran
        1977, section 5A.12)."""
        boulders = np.bincount(number)
        stratum = strata(boulders)[number]
        return cls(number, stratum, np.bincount(stratum, minlength=boulders.size), sampled)

    @classmethod
    def alone(cls, boulders: int) -> Sources:
        """Boulders that all come from a single source."""
        return cls.of(np.zeros(boulders, int))

    def __getitem__(self, which: np.ndarray | slice) -> Sources:
        return Sources(self.number[which], self.stratum[which], self.released, self.sampled)

    @property
    def count(self) -> int:
        """Number of sources with boulders."""
        return int(self.number.max(initial=-1)) + 1

    def sums(self, residual: np.ndarray) -> Sums:
        """Sums over boulders of a variable minus its mean (`residual`)."""
        size = self.released.size
        if size == 1:
            total, squares = (np.array([v.sum()]) for v in (residual, residual**2))
        else:
            total, squares = (np.bincount(self._of, v, size) for v in (residual, residual**2))
        return Sums(self._numbers, total, squares, self.released, self.sampled)

    def indicator(self, holds: np.ndarray) -> Sums:
        """Sums for the indicator of the chosen boulders (a mask or indices), minus its mean."""
        size, n = self.released.size, self._numbers
        if size > 1:
            held = np.bincount(self._of[holds], minlength=size).astype(float)
        else:
            held = np.array([np.count_nonzero(holds) if holds.dtype == bool else holds.size], float)
        fraction = held.sum() / max(1.0, n.sum())
        squares = held * (1 - fraction) ** 2 + (n - held) * fraction**2
        return Sums(n, held - n * fraction, squares, self.released, self.sampled)

    def effective_number(self, holds: np.ndarray) -> float:
        """Effective number of independent boulders for the fraction of True in `holds`
        (boulders,)."""
        return self.indicator(holds).effective_number(float(holds.mean()))

    @property
    def _of(self) -> np.ndarray:
        return self.number if self.sampled else self.stratum

    @cached_property
    def _numbers(self) -> np.ndarray:
        """Number of boulders in each stratum, or from each source."""
        return np.bincount(self._of, minlength=self.released.size).astype(float)


def strata(boulders: np.ndarray) -> np.ndarray:
    """Stratum of each source (sources,), from their boulder numbers; sources with a single boulder
    share strata in pairs."""
    clusters = np.arange(boulders.size)
    single = np.flatnonzero(boulders == 1)
    clusters[single[1::2]] = single[: single[1::2].size * 2 : 2]
    if single.size % 2 and boulders.size > 1:
        last = single[-1]
        clusters[last] = clusters[last - 1] if last else clusters[1]
    return clusters


@dataclass(frozen=True)
class Sums:
    """Sums over the boulders of each stratum (of each source if sources are sampled) for a
    variable minus its mean; they suffice for its interval."""

    n: np.ndarray  # number of boulders
    total: np.ndarray
    squares: np.ndarray
    released: np.ndarray  # number of boulders, including those without a value
    sampled: bool

    @property
    def size(self) -> int:
        return int(self.n.sum())

    def limits_of_mean(
        self, shape: Shape, signed: bool = False, fewest: int = MIN_FOR_MEAN, skewed: float = SKEWED
    ) -> tuple[float, float]:
        """Limits of the interval of the mean, minus the mean, for values of this shape; NaN if
        `Shape.apart` of the values (or source sums, if sampled) is below `fewest`. See `hall`."""
        n = self.size
        if shape.apart < fewest:
            return WITHHELD
        if not self.sampled:
            within = self._within()
            total = within.sum()
            if not total:
                return 0.0, 0.0
            few = np.maximum(self.n - 1, 1)
            freedom = total**2 / (within**2 / few).sum()  # Satterthwaite 1946
            return hall(math.sqrt(total / (n * (n - 1))), freedom, n, shape, signed, skewed)
        error = math.sqrt(self.squares.sum() / (n - 1) / n)
        low, high = hall(error, n - 1, n, shape, signed, skewed)
        sums = self.total[self.n > 0]
        if sums.size == 1:  # the boulders of a single source are independent
            return low, high
        clusters, m = Shape.of(sums), sums.size
        if clusters.apart < fewest:
            return WITHHELD
        apart = hall(self._error_of_clusters(), m - 1, m, clusters, signed, skewed)
        # Sources that agree by chance give no more information than their boulders.
        return min(low, apart[0]), max(high, apart[1])

    def effective_number(self, fraction: float) -> float:
        """Effective number of independent boulders for the fraction of an indicator (Korn and
        Graubard 1998); for sampled sources see `independent_boulders`.

        With few boulders, sources whose boulders all behave alike would seem too certain. The
        variance therefore includes Z**2 additional boulders of uncertain outcome, and is at most
        the variance without strata.
        """
        n = self.size
        if self.sampled:
            has = self.n > 0
            return independent_boulders(self.n[has], (self.total + self.n * fraction)[has])
        anywhere = n * fraction * (1 - fraction)
        if not anywhere:
            return float(n)
        return n * anywhere / min(anywhere, self._within().sum() + Z**2)

    def _within(self) -> np.ndarray:
        """Contribution of each stratum to the variance of the sum; boulders outside the selection
        contribute none (a domain: Cochran 1977, section 5A.14)."""
        n = self.released
        scatter = np.maximum(self.squares - self.total**2 / np.maximum(n, 1), 0)
        return scatter * (n / np.maximum(n - 1, 1)) * (1 - 1 / n.sum())

    def _error_of_clusters(self) -> float:
        """Standard error of a mean from two or more clusters (linearised; Cochran 1977)."""
        sums = self.total[self.n > 0]
        return math.sqrt((sums**2).sum() * sums.size / (sums.size - 1)) / self.size


@dataclass(frozen=True)
class Shape:
    """Properties of values, apart from their variance, that affect the interval of the mean."""

    skewness: float
    below: float  # distance from mean to lowest value, in standard deviations
    above: float  # distance from mean to highest value, in standard deviations
    apart: int  # number of values that differ from the median, plus one: ties add no information

    @classmethod
    def of(cls, values: np.ndarray, counts: np.ndarray | None = None) -> Shape:
        """Shape of values with given counts; by default each value counts once."""
        if counts is None:
            n, middle = float(values.size), (values.size - 1) // 2
            median = np.partition(values, middle)[middle] if values.size else 0.0
            apart = int(np.count_nonzero(values != median)) + 1
        else:
            order = np.argsort(values)
            middle = np.searchsorted(np.cumsum(counts[order]), counts.sum() / 2)
            median, n = values[order[middle]], float(counts.sum())
            apart = int(counts[values != median].sum()) + 1
        if apart < 3:
            return cls(0.0, 1.0, 1.0, apart)
        deviations = values - (values.sum() if counts is None else counts @ values) / n
        squares = deviations * deviations
        weighted = squares if counts is None else counts * squares
        second = weighted.sum() / n
        third = (weighted * deviations).sum() / n
        skewness = third / second**1.5 * math.sqrt(n * (n - 1)) / (n - 2)
        std = math.sqrt(second * n / (n - 1))
        below, above = -deviations.min() / std, deviations.max() / std
        if not min(below, above) > 0:  # values differ only by rounding
            return cls(0.0, 1.0, 1.0, apart)
        return cls(skewness, below, above, apart)


def hall(
    error: float, freedom: float, n: int, shape: Shape, signed: bool, skewed: float
) -> tuple[float, float]:
    """Limits of the interval of a mean of n values with this standard error, minus the mean:
    Student's t limits with Hall's cubic correction for skewness (Hall 1992). The upper limit
    assumes a skewness of at least `skewed` times the coefficient of variation, with values measured
    from the lowest. For `signed` values, so does the lower limit, with values measured from the
    highest."""
    skewness = shape.skewness
    low = min(skewness, -skewed / shape.above) if signed else skewness
    high = max(skewness, skewed / shape.below)
    limit = student(freedom)
    return (
        -error * _inverse_of_cubic(limit, low / math.sqrt(n)),
        -error * _inverse_of_cubic(-limit, high / math.sqrt(n)),
    )


def limits_of_printed(mean: float, std: float, n: float, signed: bool) -> tuple[float, float]:
    """Limits of the interval of a mean of n values from mean and standard deviation alone; values
    are non-negative unless `signed`. NaN for too few values."""
    if not n >= MIN_FOR_MEAN:
        return WITHHELD
    below = mean / std if std > 0 and mean > 0 and not signed else math.inf
    shape = Shape(0.0, below, math.inf, int(n))
    low, high = hall(std / math.sqrt(n), n - 1, int(n), shape, signed, SKEWED)
    return mean + low if signed else max(0.0, mean + low), mean + high


def _inverse_of_cubic(t: float, a: float) -> float:
    """Inverse of the increasing cubic w + a w**2 / 3 + a**2 w**3 / 27 + a / 6 = t."""
    if abs(a) < 1e-6:
        return t
    return 3 / a * (float(np.cbrt(1 + a * (t - a / 6))) - 1)


def sources(result: Held) -> Sources:
    """Sources of the boulders in a result. If sources are a sample, sources at the same place are
    merged, because the place was chosen once for all its volumes."""
    return sources_of(result, are_sampled(result))


def sources_of(values: Held | Mapping[str, ArrayLike], sampled: bool) -> Sources:
    """Sources of boulders, as in `sources`, from variables (by name) of a result or of boulders."""
    places = np.asarray(values["source"])
    if sampled:
        places = np.asarray(values["start_x"]) + 1j * np.asarray(values["start_y"])
    return Sources.of(_ranks(places), sampled)


def _ranks(values: np.ndarray) -> np.ndarray:
    """Rank (n,) of each value among the distinct values, from 0; small integers need no sorting."""
    if values.dtype.kind == "i" and values.size and 0 <= values.min() <= values.max() < DENSE:
        return (np.cumsum(np.bincount(values) > 0) - 1)[values]
    return np.unique(values, return_inverse=True)[1]


def are_sampled(result: Held) -> bool:
    """Return True if the sources of a result are a sample."""
    text = str(result.attrs.get("case", ""))
    return "sample" in text and case_of(result).release["sources"] == "sample"  # fast test first


def fraction_interval(holds: np.ndarray, source: Sources | Weighted) -> tuple[float, float, float]:
    """Fraction of True in `holds` (boulders,), with its 95 % limits (Wilson 1927)."""
    if isinstance(source, Weighted):
        return source.fraction(holds)
    fraction = float(holds.mean())
    return fraction, *fraction_limits(fraction, source.effective_number(holds))


def passing_percent(result: Held, line: int) -> tuple[int, float, float, float]:
    """Number of boulders at the line with this index, and their fraction with its interval [%]."""
    crossed = has_crossed(result, line)
    fraction, low, high = fraction_interval(crossed, sources(result))
    return int(crossed.sum()), 100 * fraction, 100 * low, 100 * high


def between_ranks(ordered: np.ndarray, level: float, effective: float) -> tuple[float, float]:
    """Order statistics that enclose a quantile, interpolated between ranks, because intervals of
    small samples would otherwise be too wide; NaN beyond the sample. (SciPy's quantile_test does
    not interpolate and has no strata.)"""
    n = ordered.size
    low, high = np.interp(
        ranks_around(n, level, effective), np.arange(1, n + 1), ordered, np.nan, np.nan
    )
    return low, high


def quantile(
    values: np.ndarray, level: float, source: Sources | Weighted
) -> tuple[float, float, float]:
    """Quantile and its 95 % interval as in line statistics, or for weighted boulders; NaN without
    values, or if `level` is NaN."""
    if not values.size or np.isnan(level):
        return np.nan, np.nan, np.nan
    if isinstance(source, Weighted):
        return source.quantile(values, level)
    ordered = np.sort(values)
    value = float(np.quantile(ordered, level))
    effective = source.effective_number(values <= value)
    low, high = between_ranks(ordered, level, effective)
    return value, float(low), float(high)


def ranks_around(n: int, level: float, effective: float) -> np.ndarray:
    """Lower and upper rank (2,), from 1, that enclose a quantile of n values, `effective` of them
    independent."""
    return limit_ranks(level, n, n / effective) + 0.5


def half_width(row: Mapping[str, float], name: str) -> float:
    """Half-width of a confidence interval relative to the estimate: 0 for equal limits and for
    `CROSSED` or more equal values, else inf for an estimate of 0; NaN without an interval."""
    value = row.get(name, np.nan)
    if name != "fraction" and row.get("std") == 0 and row["n"] >= CROSSED:
        return 0.0
    half = (row.get(f"{name}_high", np.nan) - row.get(f"{name}_low", np.nan)) / 2
    if half == 0 or np.isnan(half):
        return half
    return half / abs(value) if value else np.inf


def boulders_needed(boulders: float, width: float, limit: float, crossed: float = np.inf) -> float:
    """Number of boulders for an interval of width `limit`, given the `width` from `boulders`: the
    width decreases as 1/sqrt(n). At least `CROSSED` boulders must cross the line, if the number
    `crossed` so far is given."""
    return boulders * max((width / limit) ** 2, CROSSED / crossed if crossed else np.inf)


def rounded_up(boulders: float) -> int:
    """Number rounded up to two digits, because it is an estimate."""
    step = 10 ** max(0, math.floor(math.log10(max(boulders, 1.0))) - 1)
    return math.ceil(boulders / step - 1e-9) * step
