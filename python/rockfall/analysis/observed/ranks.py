# SPDX-License-Identifier: BSD-3-Clause
"""Ranking of results by their distance from the same observations, with the possible ranks of each.

Each measure is a distance between a result and the observations. All results share the resamples of
observed boulders, so the difference of two results excludes their shared error.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
import pandas as pd
import xarray as xr

from rockfall.analysis.observed.observations import Observed
from rockfall.analysis.observed.observed_doubts import check_exchanged
from rockfall.analysis.observed.run_out import (
    LIMITS,
    RESAMPLES,
    Distance,
    Sample,
    resampled,
    samples,
    weights,
)
from rockfall.analysis.precision.intervals import sources
from rockfall.errors import RockfallError
from rockfall.result.crossings import line_names, line_values
from rockfall.result.same_case import check_same_site

OVERALL = "overall"
COLUMNS = ["measure", "result", "distance", "distance_low", "distance_high", "rank", "rank_low",
           "rank_high"]  # fmt: skip


def rank_results(results: Mapping[str, xr.Dataset], seen: Observed) -> pd.DataFrame:
    """Table of results ranked by each measure, nearest first: `measure`, `result`, `distance` and
    `rank` with limits. Measures are Wasserstein distances for stopping distances and samples at
    lines, and differences from published means, in SI units. The overall measure is the mean of all
    distances, each divided by its mean over the results.

    `rank_low` and `rank_high` are the possible ranks of a result: two results are tied if the 95 %
    interval of their difference contains 0. Results must be from one site, in one CRS.
    """
    check_same_site(results)
    by_measure: dict[str, dict[str, np.ndarray]] = {}
    for name, result in results.items():
        check_exchanged(seen, result)
        for measure, values in _distances(result, seen):
            by_measure.setdefault(measure, {})[name] = values
    by_measure = {
        measure: numbers for measure, numbers in by_measure.items() if len(numbers) == len(results)
    }
    if not by_measure:
        raise RockfallError("results cannot be ranked: observations need stops, samples or means")
    stacks = {
        key: np.array([numbers[name] for name in results]) for key, numbers in by_measure.items()
    }
    complete = [stack for stack in stacks.values() if np.isfinite(stack).all()]
    if len(complete) > 1:
        stacks[OVERALL] = np.mean([stack / stack.mean(axis=0) for stack in complete], axis=0)
    rows = [row for measure, stack in stacks.items() for row in _ranked(measure, [*results], stack)]
    return pd.DataFrame(rows, columns=COLUMNS)


def _distances(result: xr.Dataset, seen: Observed) -> Iterator[tuple[str, np.ndarray]]:
    """Name of each measure, with its distance and the resampled distances (1 + RESAMPLES,)."""
    pair = samples(result, seen)
    if pair is not None:
        yield "stopping_distance", _resampled(*pair)
    names = line_names(result)
    source = sources(result).number
    for (line, quantity), values in seen.samples.items():
        if line in names:
            made = line_values(result, quantity, names.index(line))
            crossed = ~np.isnan(made)
            alike = Sample(values[:, None], np.zeros(values.size, int))
            ours = Sample(made[crossed][:, None], np.zeros(crossed.sum(), int))
            yield f"{line}.{quantity}", _resampled(alike, ours)
    observed = seen.summaries[seen.summaries["method"] == "observed"]
    for row in observed.to_dict("records"):
        key = row["line"], row["quantity"]
        if row["line"] in names and key not in seen.samples and np.isfinite(row["mean"]):
            made = line_values(result, row["quantity"], names.index(row["line"]))
            yield f"{key[0]}.{key[1]}.mean", _mean_apart(row, made, source)


def _resampled(seen: Sample, made: Sample) -> np.ndarray:
    if not made.source.size:
        return np.full(1 + RESAMPLES, np.inf)
    theirs, ours = np.random.default_rng(0), np.random.default_rng(1)
    distance = Distance(seen.values[:, 0], made.values[:, 0])
    share = weights(seen, made)
    value = distance(np.ones(seen.source.size), share)
    again = [
        distance(resampled(seen, theirs), share * resampled(made, ours)) for _ in range(RESAMPLES)
    ]
    return np.array([value, *again])


def _mean_apart(printed: dict, values: np.ndarray, source: np.ndarray) -> np.ndarray:
    """Distances (1 + RESAMPLES,) of the simulated mean from a published mean, which has a normal
    sampling error if n is known, else none."""
    crossed = ~np.isnan(values)
    if not crossed.any():
        return np.full(1 + RESAMPLES, np.inf)
    theirs, ours = np.random.default_rng(0), np.random.default_rng(1)
    error = printed["std"] / np.sqrt(printed["n"])
    means = printed["mean"] + np.nan_to_num(error) * theirs.standard_normal(RESAMPLES)
    sample = Sample(values[crossed][:, None], source[crossed])
    made = [
        np.average(sample.values[:, 0], weights=resampled(sample, ours)) for _ in range(RESAMPLES)
    ]
    value = sample.values.mean() - printed["mean"]
    return np.abs([value, *(np.array(made) - means)])


def _ranked(measure: str, names: list[str], values: np.ndarray) -> Iterator[list]:
    """Rows of a measure, ranked by `values`, the distances (results, 1 + RESAMPLES)."""
    order = np.argsort(values[:, 0], kind="stable")
    with np.errstate(invalid="ignore"):
        apart = np.nan_to_num(values[:, None] - values[None], nan=0.0)
    low, high = np.quantile(apart[..., 1:], LIMITS, axis=-1)
    surely_farther, surely_nearer = (low > 0), (high < 0)  # each result compared with every other
    for rank, k in enumerate(order, start=1):
        with np.errstate(invalid="ignore"):
            ends = 2 * values[k, 0] - np.quantile(values[k, 1:], LIMITS[::-1])
        ends = np.array([max(ends[0], 0.0), max(ends[1], values[k, 0])])
        best, worst = 1 + surely_farther[k].sum(), len(names) - surely_nearer[k].sum()
        yield [measure, names[k], values[k, 0], *ends, rank, int(best), int(worst)]
