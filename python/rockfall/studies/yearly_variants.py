# SPDX-License-Identifier: BSD-3-Clause
"""Annual frequencies at the lines of each variant, over all scenarios of a case."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from rockfall.analysis.hazard.classes import frequencies
from rockfall.analysis.hazard.exceedance import levels_by_period
from rockfall.analysis.hazard.scenarios import base_case, scenarios_of
from rockfall.analysis.hazard.variables import PERIODS
from rockfall.analysis.precision.clusters import Clusters
from rockfall.analysis.precision.intervals import Sources
from rockfall.analysis.precision.paired import difference_of_fractions
from rockfall.case import Case
from rockfall.case.variants import variants
from rockfall.result.crossings import line_names, line_values
from rockfall.scene.read import read_scene
from rockfall.scene.scene import Scene
from rockfall.simulation.parts.checkpoint import Checkpoint
from rockfall.studies.study import NO_CHECKPOINTS, ROWS_ONLY, Study
from rockfall.studies.variants import COLUMNS, at_line, verdict_on

NO_OBJECTS: Mapping[str, np.ndarray] = {}
VALUES = "value", "value_low", "value_high"
Three = tuple[float, float, float]  # value and interval limits


class Yearly(NamedTuple):
    """Frequencies at the lines of variants, and model warnings of the runs."""

    table: pd.DataFrame
    warnings: tuple[str, ...]


class YearlyRun(NamedTuple):
    """Energies [J] of a scenario's boulders at each place, NaN if they do not pass."""

    energies: dict[str, np.ndarray]
    source: Sources
    per_cluster: dict[str, float]  # number of boulders that count as one observation, by place
    yearly: float  # annual frequency of the scenario [1/year]


def yearly_variants(
    case: Case,
    *,
    progress: bool = False,
    threads: int | None = None,
    checkpoints: Mapping[str, Checkpoint] = NO_CHECKPOINTS,
    **given: Any,
) -> Yearly:
    """Run the &scenario groups of each &variant of a case, with common random numbers.

    The table has the columns of `rockfall.compare_variants`, by line and variant: `frequency`
    [1/year] of passing boulders (statistic all, and above_E for each &hazard threshold E [kJ]),
    summed over scenarios, with the difference from the first variant; and `energy_by_period` [J]
    (statistic T [year]). Limits of sums are sums of limits, because scenarios share random
    numbers. A boulder that a barrier stops at a line does not pass it. `checkpoints` have the keys
    of `run_name`; for `given` see `read_scene`.

    >>> import rockfall
    >>> net = {"name": "net", "x": [600000.0, 600120.0], "y": [4999950.0, 4999950.0]}
    >>> case = rockfall.read_case("case.nml").replace(
    ...     barrier=[net | {"height": 3.0, "class": 4}],
    ...     variant=[{"name": "bare", "without": ["barrier"]}, {"name": "with net"}],
    ...     scenario=[{"name": "small", "return_period": 10.0}],
    ... )
    >>> table = rockfall.yearly_variants(case).table
    >>> sorted(set(table["quantity"]))
    ['energy_by_period', 'frequency']
    """
    study = Study(progress=progress, threads=threads, checkpoints=checkpoints)
    of_runs: dict[str, tuple[str, float]] = {}
    by_variant: dict[str, list[YearlyRun]] = {}
    scenes = _scenes(case, of_runs, given)
    for name, run in study.run(scenes, lambda name, result: yearly_run(result, of_runs[name][1])):
        by_variant.setdefault(of_runs[name][0], []).append(run)
    return Yearly(yearly_table(by_variant, case.hazard), study.warnings)


def yearly_table(
    by_variant: Mapping[str, Sequence[YearlyRun]], hazard: Mapping[str, Any]
) -> pd.DataFrame:
    """Table of `yearly_variants` from the runs of each variant; `hazard` is the &hazard group."""
    first = next(iter(by_variant.values()), ())
    rows = [
        {"line": line, "variant": name, **row}
        for line in dict.fromkeys(line for runs in by_variant.values() for line in runs[0].energies)
        for name, runs in by_variant.items()
        if line in runs[0].energies
        for row in _rows(line, runs, None if runs is first else first, hazard)
    ]
    return pd.DataFrame(rows, columns=COLUMNS)


def run_name(variant: str, scenario: str) -> str:
    """Name of the run for a scenario of a variant."""
    return f"{variant}/{scenario}"


def _scenes(
    case: Case, of_runs: dict[str, tuple[str, float]], given: Mapping[str, Any]
) -> Iterator[tuple[str, Scene]]:
    """Scenes by run name; the variant and frequency of each are added to `of_runs`."""
    for variant, own in variants(case).items():
        scene = read_scene(base_case(own, ROWS_ONLY), **given)
        for scenario in scenarios_of(scene, scene.case.line):
            name = run_name(variant, scenario.name)
            of_runs[name] = variant, scenario.frequency
            yield name, replace(scene, case=scenario.case)


def yearly_run(
    result: xr.Dataset,
    yearly: float,
    lines: Sequence[str] | None = None,
    objects: Mapping[str, np.ndarray] = NO_OBJECTS,
) -> YearlyRun:
    """Energies from a result with its frequency [1/year] at all or some lines, and at objects,
    given the energies [J] and heights [m] of all boulders there, (2, boulders)."""
    names, clusters = line_names(result), Clusters.of(result)
    at_places = {line: hits_at(result, line) for line in (names if lines is None else lines)}
    at_places |= objects
    per_cluster = {}
    for place, (energy, height) in at_places.items():
        came = np.flatnonzero(~np.isnan(energy))
        per_cluster[place] = clusters.at(came, energy[came], height[came])
    energies = {place: energy for place, (energy, _) in at_places.items()}
    return YearlyRun(energies, clusters.source, per_cluster, yearly)


def hits_at(result: xr.Dataset, line: str) -> np.ndarray:
    """Energies [J] and centre heights [m] at a line, (2, boulders); NaN without a passage."""
    at = at_line(result, line)
    assert at is not None
    height = line_values(result, "passing_height", line_names(result).index(line))
    return np.array([at["energy_total"], np.where(np.isnan(at["energy_total"]), np.nan, height)])


def _rows(
    line: str,
    runs: Sequence[YearlyRun],
    first: Sequence[YearlyRun] | None,
    hazard: Mapping[str, Any],
) -> Iterator[dict[str, object]]:
    """Rows of a variant at a line; `first` has the runs of the first variant (None for the first
    variant itself)."""
    factor, yearly = hazard["frequency_factor"], [run.yearly for run in runs]
    energies = [run.energies[line] for run in runs]
    before = [run.energies[line] for run in first or () if line in run.energies]
    n = sum(int(np.count_nonzero(~np.isnan(each))) for each in energies)
    samples = [
        (each.size, run.per_cluster[line], run.yearly)
        for each, run in zip(energies, runs, strict=True)
    ]
    for threshold in dict.fromkeys((0.0, *hazard["thresholds"])):
        passing = [each >= 1000.0 * threshold for each in energies]
        counts = ([np.count_nonzero(mask)] for mask in passing)
        rates = frequencies(
            ((np.array(count), *each) for count, each in zip(counts, samples, strict=True)), factor
        )
        three = (float(rate[0]) for rate in rates)
        row = {"quantity": "frequency", "n": n, **dict(zip(VALUES, three, strict=True))}
        row["statistic"] = f"above_{threshold:.10g}" if threshold else "all"
        if before:
            others = [each >= 1000.0 * threshold for each in before]
            apart = (
                difference_of_fractions(mask, other, run.source)
                for mask, other, run in zip(passing, others, runs, strict=True)
            )
            row |= verdict_on(*yearly_sum(yearly, apart, factor))
        yield row
    levels = levels_by_period([each[~np.isnan(each)] for each in energies], samples, factor)
    for period, three in zip(PERIODS, levels.T.tolist(), strict=True):
        values = dict(zip(VALUES, three, strict=True))
        yield {"quantity": "energy_by_period", "statistic": f"{period:g}", "n": n, **values}


def yearly_sum(
    frequencies: Iterable[float], fractions: Iterable[Sequence[float]], factor: Sequence[float]
) -> Three:
    """Sum over scenarios of frequency [1/year] times a fraction (or difference of fractions) of
    boulders, with limits. The limits include the lowest and highest `factor` on the frequencies."""
    each = [yearly * np.array(three) for yearly, three in zip(frequencies, fractions, strict=True)]
    value, low, high = np.sum(each, axis=0).tolist()
    return value, min(by * low for by in factor), max(by * high for by in factor)
