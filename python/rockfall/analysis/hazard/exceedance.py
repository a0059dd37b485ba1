# SPDX-License-Identifier: BSD-3-Clause
"""Energies and heights by return period, and exceedance counts, at lines, objects and segments,
over all scenarios."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr

from rockfall.analysis.hazard.classes import frequencies
from rockfall.analysis.hazard.variables import CLASS_ENERGY, EXCEEDED, LEVELS, PERIODS
from rockfall.result.crossings import AtLine
from rockfall.result.variables import ENDS, OUTCOME


class Passing(NamedTuple):
    """Boulders of a run that pass a place."""

    energy: np.ndarray  # kinetic energy [J]
    height: np.ndarray  # height of the centre above the ground, vertical [m]


def passing_of(result: xr.Dataset, line: int) -> Passing:
    """Boulders of a result that cross the line with this index."""
    at = AtLine(result, line)
    return Passing(at.values("energy_total"), at.values("passing_height"))


def behind(result: xr.Dataset, line: int) -> int:
    """Number of boulders that reach the line with this index and are not stopped there."""
    at = AtLine(result, line)
    if "crossing_outcome" not in result:
        return at.boulders.size
    return int(np.count_nonzero(at.stored("outcome") != OUTCOME["stopped"]))


def class_behind(at: Passing) -> np.ndarray:
    """Number of boulders (classes, heights) that would pass through or over a barrier, for each
    class of EAD 340059 and height in `EXCEEDED`."""
    counts = np.empty((CLASS_ENERGY.size, EXCEEDED["height"].size), "i4")
    for row, capacity in zip(counts, CLASS_ENERGY, strict=True):
        held = np.sort(at.height[at.energy <= capacity])
        row[:] = at.height.size - np.searchsorted(held, EXCEEDED["height"], side="right")
    return counts


#: Boulders of a run, boulders that count as one observation, and scenario frequency [1/year].
Sample = tuple[int, float, float]


def exceedance_numbers(
    passing: Sequence[Sequence[Passing | None]],
    runs: Sequence[Sequence[Sample]],
    factor: Sequence[float] = (1.0, 1.0),
) -> dict[str, np.ndarray]:
    """Hazard variables at places, by name without the prefix: energies and heights by return period
    with their limits, and counts above each level of `EXCEEDED`.

    `passing` [run][place] has the boulders that pass; None if only counts are known, which gives
    NaN and counts of 0. `runs` [run][place] has their samples. `factor` is as in
    `rockfall.analysis.hazard.classes.frequencies`.
    """
    places = [*zip(*passing, strict=True)]
    by_place = [*zip(*runs, strict=True)]
    values: dict[str, np.ndarray] = {}
    for name in LEVELS:
        levels = np.full((3, len(places), len(PERIODS)), np.nan)
        counts = np.zeros((len(runs), len(places), EXCEEDED[name].size), "i4")
        for place, at in enumerate(places):
            samples = [getattr(each, name) for each in at if each is not None]
            if len(samples) < len(runs):
                continue
            levels[:, place] = levels_by_period(samples, by_place[place], factor)
            counts[:, place] = [
                sample.size - np.searchsorted(np.sort(sample), EXCEEDED[name], side="right")
                for sample in samples
            ]
        values |= {f"{name}_by_period{end}": row for end, row in zip(ENDS, levels, strict=True)}
        values[f"{name}_counts"] = counts
    return values


def levels_by_period(
    values: Sequence[np.ndarray], runs: Sequence[Sample], factor: Sequence[float] = (1.0, 1.0)
) -> np.ndarray:
    """Value exceeded once in each of `PERIODS`, with its 95 % limits, (3, periods), from the values
    of passing boulders in each run.

    The value is 0 if boulders pass less often. Its lower and upper limits are the values at which
    the lower and upper limits of the exceedance frequency are once per period. The upper limit is
    infinite if values above the simulated maximum may be that frequent.
    """
    sample = np.concatenate(values)
    of_run = np.repeat(np.arange(len(runs)), [part.size for part in values])
    order = np.argsort(-sample, kind="stable")
    counts = np.cumsum(of_run[order, None] == np.arange(len(runs)), axis=0, dtype="i4")
    # the first row is the count above infinity: no boulders
    counts = np.concatenate([np.zeros((1, len(runs)), "i4"), counts])
    rates = frequencies(((counts[:, k], *run) for k, run in enumerate(runs)), factor)
    steps = np.concatenate([[np.inf], sample[order], [0.0]])
    return np.array([steps[np.searchsorted(rate, [1 / T for T in PERIODS])] for rate in rates])
