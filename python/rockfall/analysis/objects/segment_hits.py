# SPDX-License-Identifier: BSD-3-Clause
"""Boulders that hit road segments, and their statistics weighted by annual frequency."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr

from rockfall.analysis.objects.risk import diameters
from rockfall.analysis.objects.segments import Segments
from rockfall.analysis.precision.clusters import Clusters
from rockfall.analysis.precision.weighted import quantile_interval
from rockfall.result.crossings import line_values
from rockfall.result.samples import check_all_rows
from rockfall.result.variables import ENDS

LEVEL = 0.95
QUANTITIES = "energy", "passing_height", "upper_edge", "diameter"  # fields of `Hits`


class Hits(NamedTuple):
    """Boulders that hit a segment, their values at first contact (the largest, if the segment has
    several outlines), and the number of boulders that count as one observation."""

    energy: np.ndarray  # kinetic energy [J]
    passing_height: np.ndarray  # height of the centre above the ground, vertical [m]
    upper_edge: np.ndarray  # height of the highest point, vertical [m]
    diameter: np.ndarray  # diameter of a sphere of equal volume [m]
    per_cluster: float


def segment_hits(
    segments: Segments, result: xr.Dataset, first: int, clusters: Clusters
) -> Iterator[Hits]:
    """Boulders of a run that hit each segment; segment lines are numbered from `first`."""
    if len(segments):
        check_all_rows(result, "a segment of a road")
    of_boulders = diameters(result)
    for number in range(len(segments)):
        values = np.full((3, of_boulders.size), np.nan)
        for line in first + np.flatnonzero(segments.owner == number):
            for k, quantity in enumerate(("energy_total", "passing_height", "upper_edge")):
                values[k] = np.fmax(values[k], line_values(result, quantity, int(line)))
        hit = np.flatnonzero(np.isfinite(values[0]))
        energy, passing_height, upper_edge = values[:, hit]
        per_cluster = clusters.at(hit, energy, passing_height)
        yield Hits(energy, passing_height, upper_edge, of_boulders[hit], per_cluster)


def hit_counts(hits: Sequence[Hits], thresholds: np.ndarray) -> np.ndarray:
    """Number of hits, and number above each threshold [J] (intensities, segments)."""
    counts = np.zeros((1 + thresholds.size, len(hits)), "i4")
    for k, segment in enumerate(hits):
        counts[0, k] = segment.energy.size
        counts[1:, k] = (segment.energy > thresholds[:, None]).sum(axis=1)
    return counts


class Weighted(NamedTuple):
    """Hits of a run with an annual weight."""

    hits: Sequence[Hits]  # hits on each segment
    weight: float  # annual frequency that a boulder represents [1/year]


def segment_numbers(runs: Sequence[Weighted]) -> dict[str, np.ndarray]:
    """Statistics of the boulders that hit each segment, by name: number, and means and 95 %
    quantiles with limits of `QUANTITIES`. NaN without boulders."""
    rows = [_numbers(runs, k) for k in range(len(runs[0].hits))]
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def _numbers(runs: Sequence[Weighted], segment: int) -> dict[str, float]:
    weights = np.repeat(
        [run.weight for run in runs], [run.hits[segment].energy.size for run in runs]
    )
    # Boulders with the same number may behave alike in all runs, which share random numbers.
    unit = sum(run.weight * run.hits[segment].per_cluster for run in runs)
    numbers: dict[str, float] = {"boulders": weights.size}
    for name in QUANTITIES:
        values = np.concatenate([getattr(run.hits[segment], name) for run in runs])
        numbers[f"{name}_mean"] = float(weights @ values / weights.sum()) if values.size else np.nan
        limits = quantile_interval(values, weights, LEVEL, unit)
        numbers |= {f"{name}_q95{end}": limit for end, limit in zip(ENDS, limits, strict=True)}
    return numbers
