# SPDX-License-Identifier: BSD-3-Clause
"""Number of boulders that count as one in the frequency limits at a place, if sources are a
sample. It depends on how similarly boulders from a source behave at the place."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr

from rockfall.analysis.precision.design_effect import informative_clusters, student
from rockfall.analysis.precision.intervals import Sources, sources
from rockfall.case import case_of
from rockfall.kernel_rules import Z
from rockfall.limits import MIN_FOR_MEAN
from rockfall.result.maps.clusters import boulders_per_cluster


@dataclass(frozen=True)
class Clusters:
    """Boulders of a run by source."""

    source: Sources
    most: int  # number that counts as one if a source's boulders behave alike, as assumed for cells

    @classmethod
    def of(cls, result: xr.Dataset) -> Clusters:
        starts = (result[f"start_{axis}"].values for axis in "xy")
        return cls(sources(result), boulders_per_cluster(case_of(result), *starts))

    def at(self, boulders: np.ndarray, *values: np.ndarray) -> float:
        """Number of boulders that count as one at a place where `boulders` (indices) arrive with
        `values`, arrays of equal size. It is the largest design effect for the fraction above any
        value, so that a single number is valid at all levels. It is 1 for fixed sources, and `most`
        if too few boulders arrive to estimate it."""
        counts = np.bincount(self.source.number).astype(float)
        if self.most == 1 or boulders.size < MIN_FOR_MEAN or counts.size == 1:
            return float(self.most)
        largest = max(self._effect(boulders[np.argsort(-each)], counts) for each in values)
        return min(max(1.0, largest), float(self.most))

    def _effect(self, boulders: np.ndarray, counts: np.ndarray) -> float:
        """Largest design effect of the fraction formed by the first k boulders, over all k, by the
        rule of `independent_boulders`; `counts` are the boulders of each source."""
        number, n, m = self.source.number[boulders], counts.sum(), counts.size
        by_source = np.argsort(number, kind="stable")
        grouped = number[by_source]
        before = np.empty(number.size)  # number of earlier boulders from the same source
        before[by_source] = np.arange(number.size) - np.searchsorted(grouped, grouped)
        fraction = np.arange(1, number.size + 1) / n
        squares = np.cumsum(2 * before + 1) - 2 * fraction * np.cumsum(counts[number])
        squares += fraction**2 * (counts @ counts)
        levels = slice(MIN_FOR_MEAN - 1, int(n) - MIN_FOR_MEAN)
        with_others = m - np.cumsum(before + 1 == counts[number])[levels]
        informative = informative_clusters(np.cumsum(before == 0)[levels], with_others)
        numbers, places = np.unique(informative, return_inverse=True)
        scales = np.array(
            [(student(k - 1) / Z) ** 2 if k > 1 else np.inf for k in numbers.tolist()]
        )
        variance = squares[levels] * m / (m - 1) / n**2
        independent = fraction[levels] * (1 - fraction[levels]) / n
        return float((scales[places] * variance / independent).max(initial=0.0))
