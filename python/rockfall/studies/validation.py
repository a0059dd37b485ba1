# SPDX-License-Identifier: BSD-3-Clause
"""Validation at a site with observed boulders, for all rebound models and several seeds."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from rockfall.analysis.observed.compare import check_lines
from rockfall.analysis.observed.deposits import agreement, blocks_from
from rockfall.analysis.observed.observations import Observed
from rockfall.analysis.observed.observed_doubts import check_exchanged, unit_notes
from rockfall.analysis.observed.run_out import (
    RESAMPLES,
    Distance,
    Sample,
    kolmogorov_smirnov,
    moments,
    pooled_samples,
    scene_starts,
    weights,
)
from rockfall.case import Case
from rockfall.errors import RockfallError
from rockfall.result.crossings import line_names, line_values
from rockfall.studies.model_scenes import by_tables, named_notes, variants
from rockfall.studies.study import ROWS_ONLY, Study, with_numbers

SEEDS = 5
FEWEST = 2  # minimum seeds for an error, and minimum boulders for a distribution
BOUNDS = {"mean": 0.10, "std": 0.25}  # bounds of the relative error
QUANTILES = {"q05": 0.05, "q50": 0.5, "q95": 0.95}
APART = "ks", "p", "wasserstein"  # distances between observed and simulated distribution
RUN_OUT, AT_REST = "stopping_distance", "at_rest"
LOG_DENSITY = "log_density"  # mean log density of simulated boulders at the observed blocks [m-2]
COLUMNS = ["law", "line", "quantity", "statistic", "n_observed", "observed", "observed_error",
           "simulated", "simulated_error", "verdict"]  # fmt: skip
WITHIN, BEYOND, UNDECIDED = "within", "beyond", "undecided"
SIGMAS = 1.96  # standard errors in half a 95 % interval

Key = tuple[str, str, str]  # line, quantity, statistic


class Number(NamedTuple):
    """A statistic: number of observed boulders, observed value with its error, simulated value."""

    n: float
    observed: float
    error: float
    simulated: float


@dataclass(frozen=True)
class Validation:
    """Distributions at a site, observed and from each rebound model, in SI units.

    `table` has a row for each model, place (a line, or "" for the run-out), quantity and statistic:
    mean, std, q05, q50, q95; for run-outs lateral_std (perpendicular to the line to the mean
    observed position); ks with its p, wasserstein; and for blocks at rest without a known release
    log_density, the mean log density of simulated boulders there (density in m-2). Errors are
    standard errors, for observations from resampled boulders, for simulations over seeds. Verdicts
    refer to `BOUNDS`.
    """

    title: str
    boulders: int
    seeds: tuple[int, ...]
    laws: tuple[str, ...]
    table: pd.DataFrame
    notes: tuple[str, ...]
    warnings: tuple[str, ...] = ()  # model warnings for the first seed, each once


def validate(
    case: Case,
    seen: Observed,
    tables: Sequence[str] | None = None,
    seeds: int = SEEDS,
    progress: bool = False,
) -> Validation:
    """Run a case with its own rebound model, its impact sets, each classical model, and each impact
    table (`tables`, by default all shipped tables), with `seeds` consecutive seeds after the
    case's. Compare the results with the observations: stopping points or distances, samples and
    statistics at lines. Models replace the same ground as in `run_models`; the notes list
    exceptions.

    Raises a RockfallError for fewer than two seeds, if no observation can be compared, a line or
    source is not in the case, no ground can have another model, or a table needs rock sizes that
    the case lacks.
    """
    if seeds < FEWEST:
        raise RockfallError(f"--seeds {seeds}: must be at least {FEWEST} to estimate errors")
    case = case.replace(output=ROWS_ONLY)
    notes: list[str] = []
    laws = dict(variants(case, (), notes))
    own_scene = next(iter(laws.values()))
    laws |= by_tables(case, own_scene, tables, notes)
    notes += named_notes(own_scene)
    nothing = RockfallError(
        f"{case.name}: no observation to compare with: give places or distances of rest (with "
        "start_x, start_y for several sources), or lines of the case"
    )
    check_lines(seen, [line["name"] for line in own_scene.case.lines], "case")
    at_lines = len(seen.samples) or (seen.summaries["method"] == "observed").any()
    if not at_lines and seen.stops is None and seen.distances is None:
        raise nothing
    check_exchanged(seen, own_scene.grid)
    blocks_from(scene_starts(own_scene), seen)  # raises errors before the first run
    notes += unit_notes(seen)
    first = int(case.case["seed"]) + 1
    numbers = tuple(range(first, first + seeds))
    total = sum(scene.boulders for scene in laws.values()) * seeds
    runs: dict[str, list[dict[Key, Number]]] = {name: [] for name in laws}
    with Study(total, progress=progress) as study:
        for seed in numbers:
            scenes = ((name, with_numbers(scene, seed=seed)) for name, scene in laws.items())
            for name, own in study.run(
                scenes, lambda _, result: comparable_numbers([(result, seen)])
            ):
                runs[name].append(own)
    rows = [{"law": name, **row} for name, own in runs.items() for row in over_runs(own)]
    if not rows:  # too few boulders at rest
        raise nothing
    return Validation(
        case.case["title"] or case.name, own_scene.boulders, numbers, tuple(laws),
        pd.DataFrame(rows, columns=COLUMNS), tuple(notes), study.warnings,
    )  # fmt: skip


def comparable_numbers(pairs: Sequence[tuple[xr.Dataset, Observed]]) -> dict[Key, Number]:
    """Statistics of results from a site that are comparable with its observations, by line,
    quantity and statistic. Several results, such as different kinds of blocks, are pooled, with
    each source weighted by its observed frequency."""
    by_key: dict[Key, Number] = {}
    stopped = pooled_samples(pairs)
    if stopped is not None:
        numbers = run_out_numbers(*stopped, one_frame=len(pairs) > 1)
        by_key |= {("", RUN_OUT, name): number for name, number in numbers.items()}
    if (rest := _at_rest(pairs)) is not None:
        by_key["", AT_REST, LOG_DENSITY] = rest
    for line, quantity in dict.fromkeys(key for _, seen in pairs for key in seen.samples):
        values = [
            (seen.samples[line, quantity], crossed)
            for result, seen in pairs
            if (line, quantity) in seen.samples
            and (crossed := _crossed(result, line, quantity)) is not None
        ]
        if values:
            share = [
                np.full(len(made), len(accepted) / max(len(made), 1)) for accepted, made in values
            ]
            each = np.concatenate(share)
            numerators, made = (np.concatenate(column) for column in zip(*values, strict=True))
            at_line = distribution_numbers(
                numerators, made, each / (each.mean() if each.size else 1)
            )
            by_key |= {(line, quantity, name): number for name, number in at_line.items()}
    for row in pairs[0][1].summaries.to_dict("records"):
        key = row["line"], row["quantity"]
        if row["method"] == "observed" and key not in pairs[0][1].samples:
            at_lines = [_crossed(result, *key) for result, _ in pairs]
            crossed = [sample for sample in at_lines if sample is not None]
            if crossed:
                printed = _of_printed(row, np.concatenate(crossed))
                by_key |= {(*key, name): number for name, number in printed}
    return by_key


def _at_rest(pairs: Sequence[tuple[xr.Dataset, Observed]]) -> Number | None:
    """Mean log density (in m-2) of simulated boulders at blocks at rest without a known
    release; None without such blocks, or with too few boulders at rest."""
    rests = [rest for pair in pairs for rest in agreement(*pair)]
    if not rests:
        return None
    n = sum(rest.blocks for rest in rests)
    density = sum(rest.blocks * rest.observed for rest in rests) / n
    return Number(n, np.nan, np.nan, density)


def run_out_numbers(
    observed: Sample, simulated: Sample, one_frame: bool = False
) -> dict[str, Number]:
    """Statistics of stopping distances, and of lateral offsets if each source has several boulders
    or all share a coordinate frame."""
    share = weights(observed, simulated)
    numbers = distribution_numbers(observed.values[:, 0], simulated.values[:, 0], share)
    alike = len(observed.source) if one_frame else np.unique(observed.source, return_counts=True)[1]
    if observed.values.shape[1] > 1 and np.min(alike) >= FEWEST:
        across = distribution_numbers(observed.values[:, 1], simulated.values[:, 1], share)
        numbers["lateral_std"] = across["std"]
    return numbers


def _crossed(result: xr.Dataset, line: str, quantity: str) -> np.ndarray | None:
    """Values of the boulders that crossed a line; None for a line missing in the case."""
    lines = line_names(result)
    if line not in lines:
        return None
    values = line_values(result, quantity, lines.index(line))
    return values[np.isfinite(values)]


def distribution_numbers(
    seen: np.ndarray, made: np.ndarray, share: np.ndarray
) -> dict[str, Number]:
    """Statistics of an observed sample and a weighted simulated sample, and their distances.
    Errors of observations come from resampled boulders."""
    random, weights = np.random.default_rng(0), np.ones(len(seen))
    drawn = [_numbers(random.choice(seen, len(seen)), weights) for _ in range(RESAMPLES)]
    enough = min(len(seen), len(made)) >= FEWEST
    simulated = _numbers(made, share) if enough else {}
    numbers = {}
    for name, value in _numbers(seen, weights).items():
        error = float(np.std([each[name] for each in drawn], ddof=1))
        numbers[name] = Number(len(seen), value, error, simulated.get(name, np.nan))
    apart = [np.nan] * 3
    if enough:
        apart = [*kolmogorov_smirnov(seen, made, share), Distance(seen, made)(weights, share)]
    for name, value in zip(APART, apart, strict=True):
        numbers[name] = Number(len(seen), np.nan, np.nan, float(value))
    return numbers


def _numbers(values: np.ndarray, share: np.ndarray) -> dict[str, float]:
    """Mean, standard deviation and quantiles of weighted values."""
    order = np.argsort(values)
    below = np.cumsum(share[order])
    place = {name: np.searchsorted(below, q * below[-1]) for name, q in QUANTILES.items()}
    mean, std = moments(values, share)
    quantiles = {name: float(values[order[min(k, len(order) - 1)]]) for name, k in place.items()}
    return {"mean": mean, "std": std, **quantiles}


def _of_printed(row: dict[str, Any], crossed: np.ndarray) -> Iterator[tuple[str, Number]]:
    """Comparison with a published mean and standard deviation, which count as exact if the number
    of boulders is unknown."""
    n, std = row["n"], row["std"]
    errors = {"mean": std / np.sqrt(n), "std": std / np.sqrt(2 * max(n - 1, 1))}
    made_numbers = _numbers(crossed, np.ones(len(crossed))) if len(crossed) >= FEWEST else {}
    for name, error in errors.items():
        if row[name] == row[name]:
            yield name, Number(n, row[name], error, made_numbers.get(name, np.nan))


def over_runs(runs: Sequence[dict[Key, Number]]) -> Iterator[dict[str, Any]]:
    """Rows (COLUMNS except the model `law`): means over runs, standard errors, verdicts."""
    for key, number in runs[0].items():
        values = np.array([run[key].simulated if key in run else np.nan for run in runs])
        mean, error = float(values.mean()), float(values.std(ddof=1) / np.sqrt(len(values)))
        numbers = [number.n, number.observed, number.error, mean, error]
        yield dict(zip(COLUMNS[1:], [*key, *numbers, _verdict(key[2], number, mean, error)],
                       strict=True))  # fmt: skip


def _verdict(statistic: str, seen: Number, simulated: float, error: float) -> str:
    """Verdict on a bound, if any; undecided if the interval of the error contains the bound."""
    if statistic not in BOUNDS or not seen.observed > 0 or simulated != simulated:
        return ""
    off = abs(simulated / seen.observed - 1)
    reach = SIGMAS * np.hypot(np.nan_to_num(seen.error), error) / seen.observed
    if off + reach <= BOUNDS[statistic]:
        return WITHIN
    return BEYOND if off - reach > BOUNDS[statistic] else UNDECIDED
