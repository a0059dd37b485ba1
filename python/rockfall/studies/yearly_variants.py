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
from rockfall.analysis.hazard.exceedance import Sample, levels_by_period
from rockfall.analysis.hazard.scenarios import base_case, scenarios_of
from rockfall.analysis.hazard.variables import PERIODS, TABLE
from rockfall.analysis.precision.clusters import Clusters
from rockfall.analysis.precision.intervals import Sources
from rockfall.analysis.precision.paired import difference_of_fractions
from rockfall.case import Case
from rockfall.case.variants import variants
from rockfall.protection.barriers import barriers_of
from rockfall.result.crossings import line_names, line_values
from rockfall.scene.read import read_scene
from rockfall.scene.scene import Scene
from rockfall.simulation.parts.checkpoint import Checkpoint
from rockfall.studies.study import NO_CHECKPOINTS, ROWS_ONLY, Study
from rockfall.studies.variants import COLUMNS, stopped_at, verdict_on

FREQUENCIES = "frequencies.csv"
NO_OBJECTS: Mapping[str, np.ndarray] = {}
VALUES = "value", "value_low", "value_high"
Three = tuple[float, float, float]  # value and interval limits


class Yearly(NamedTuple):
    """Frequencies at the lines of variants, and model warnings of the runs."""

    table: pd.DataFrame
    warnings: tuple[str, ...]


class AtPlace(NamedTuple):
    """Energies [J] of a scenario's boulders at a place, NaN for boulders that do not count, and the
    number of boulders that count as one observation."""

    energies: np.ndarray
    per_cluster: float


class YearlyRun(NamedTuple):
    """A scenario's boulders by place, and those that pass a barrier, by barrier."""

    places: dict[str, AtPlace]
    behind: dict[str, AtPlace]
    source: Sources
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
    [1/year] of boulders that arrive (statistic all, and above_E for each &hazard threshold E [kJ]),
    summed over scenarios, with the difference from the first variant; at barriers also
    `frequency_behind` of boulders that pass them; and `energy_by_period` [J] of boulders that
    arrive (statistic T [year]), as in `rockfall.hazard`. Limits of sums are sums of limits, because
    scenarios share random numbers. `checkpoints` have the keys of `run_name`; for `given` see
    `read_scene`. Invalid cases raise a RockfallError.

    >>> import rockfall
    >>> net = {"name": "net", "x": [600000.0, 600120.0], "y": [4999950.0, 4999950.0]}
    >>> case = rockfall.read_case("case.nml").replace(
    ...     barrier=[net | {"height": 3.0, "class": 4}],
    ...     variant=[{"name": "bare", "without": ["barrier"]}, {"name": "with net"}],
    ...     scenario=[{"name": "small", "return_period": 10.0}],
    ... )
    >>> table = rockfall.yearly_variants(case).table
    >>> sorted(set(table["quantity"]))
    ['energy_by_period', 'frequency', 'frequency_behind']
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
        for line in dict.fromkeys(line for runs in by_variant.values() for line in runs[0].places)
        for name, runs in by_variant.items()
        if line in runs[0].places
        for row in _rows(line, runs, None if runs is first else first, hazard)
    ]
    return pd.DataFrame(rows, columns=COLUMNS)


def frequency_file(frequencies: pd.DataFrame) -> pd.DataFrame:
    """Table as in files: with the unit of each row as in hazards, and without differences if there
    are none."""
    made = frequencies.copy()
    units = [TABLE[f"line_{name.removesuffix('_behind')}"].units for name in made["quantity"]]
    made.insert(made.columns.get_loc("quantity") + 1, "unit", units)
    if made["difference"].isna().all():
        made = made.drop(columns=["difference", "difference_low", "difference_high", "verdict"])
    return made


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
    """Boulders of a result at `lines` (None: all) and at objects; `yearly` is their annual
    frequency [1/year]. `objects` has the energies [J] and heights [m] of all boulders at each
    object, (2, boulders)."""
    names, clusters = line_names(result), Clusters.of(result)
    hits = {line: hits_at(result, line) for line in (names if lines is None else lines)}
    barriers = [names[k] for k in barriers_of(result) if names[k] in hits]
    behind = {name: np.where(stopped_at(result, name), np.nan, hits[name]) for name in barriers}
    at, past = (
        {name: _at_place(clusters, *each) for name, each in places.items()}
        for places in ({**hits, **objects}, behind)
    )
    return YearlyRun(at, past, clusters.source, yearly)


def _at_place(clusters: Clusters, energy: np.ndarray, height: np.ndarray) -> AtPlace:
    came = np.flatnonzero(~np.isnan(energy))
    return AtPlace(energy, clusters.at(came, energy[came], height[came]))


def hits_at(result: xr.Dataset, line: str) -> np.ndarray:
    """Energies [J] and centre heights [m] at a line, (2, boulders); NaN for boulders that do not
    arrive."""
    k = line_names(result).index(line)
    return np.array([line_values(result, name, k) for name in ("energy_total", "passing_height")])


def _rows(
    line: str,
    runs: Sequence[YearlyRun],
    first: Sequence[YearlyRun] | None,
    hazard: Mapping[str, Any],
) -> Iterator[dict[str, object]]:
    """Rows of a variant at a line; `first` has the runs of the first variant (None for the first
    variant itself)."""
    counted = {"frequency": [run.places for run in runs]}
    if line in runs[0].behind:
        counted["frequency_behind"] = [run.behind for run in runs]
    for quantity, by_run in counted.items():
        before = [run.places if quantity == "frequency" else run.behind for run in first or ()]
        yield from _rates(
            quantity,
            [places[line] for places in by_run],
            [places[line].energies for places in before if line in places],
            runs,
            hazard,
        )
    at = [run.places[line] for run in runs]
    came = [place.energies[~np.isnan(place.energies)] for place in at]
    levels = levels_by_period(came, _samples(at, runs), hazard["frequency_factor"])
    for period, three in zip(PERIODS, levels.T.tolist(), strict=True):
        values = dict(zip(VALUES, three, strict=True)) | {"n": sum(map(len, came))}
        yield {"quantity": "energy_by_period", "statistic": f"{period:g}", **values}


def _samples(places: Sequence[AtPlace], runs: Sequence[YearlyRun]) -> list[Sample]:
    return [
        (place.energies.size, place.per_cluster, run.yearly)
        for place, run in zip(places, runs, strict=True)
    ]


def _rates(
    quantity: str,
    places: Sequence[AtPlace],
    before: Sequence[np.ndarray],
    runs: Sequence[YearlyRun],
    hazard: Mapping[str, Any],
) -> Iterator[dict[str, object]]:
    """Rows of a frequency at a place; `before` has the energies [J] in the first variant."""
    factor, yearly = hazard["frequency_factor"], [run.yearly for run in runs]
    energies, samples = [place.energies for place in places], _samples(places, runs)
    n = sum(int(np.count_nonzero(~np.isnan(each))) for each in energies)
    for threshold in dict.fromkeys((0.0, *hazard["thresholds"])):
        passing = [each >= 1000.0 * threshold for each in energies]
        counts = ([np.count_nonzero(mask)] for mask in passing)
        rates = frequencies(
            ((np.array(count), *each) for count, each in zip(counts, samples, strict=True)), factor
        )
        three = (float(rate[0]) for rate in rates)
        row = {"quantity": quantity, "n": n, **dict(zip(VALUES, three, strict=True))}
        row["statistic"] = f"above_{threshold:.10g}" if threshold else "all"
        if before:
            others = [each >= 1000.0 * threshold for each in before]
            apart = (
                difference_of_fractions(mask, other, run.source)
                for mask, other, run in zip(passing, others, runs, strict=True)
            )
            row |= verdict_on(*yearly_sum(yearly, apart, factor))
        yield row


def yearly_sum(
    frequencies: Iterable[float], fractions: Iterable[Sequence[float]], factor: Sequence[float]
) -> Three:
    """Sum over scenarios of frequency [1/year] times a fraction (or difference of fractions) of
    boulders, with limits. The limits are multiplied by the lowest and highest `factor` of the
    frequencies."""
    each = [yearly * np.array(three) for yearly, three in zip(frequencies, fractions, strict=True)]
    value, low, high = np.sum(each, axis=0).tolist()
    return value, min(by * low for by in factor), max(by * high for by in factor)
