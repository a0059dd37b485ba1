# SPDX-License-Identifier: BSD-3-Clause
"""Siting of a barrier: required energy and height at candidate alignments above a protected line.
A single run has all alignments as evaluation lines, so that they share boulders."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from rockfall.analysis.line_statistics import with_limits
from rockfall.analysis.lines.around import MAX_AROUND
from rockfall.analysis.precision.intervals import fraction_interval, quantile
from rockfall.analysis.validity.warnings import joint_warnings
from rockfall.case import Case
from rockfall.errors import RockfallError
from rockfall.kernel_rules import EAD_ENERGY
from rockfall.protection.alignments import Alignment, Shift, drawn_scene, shifted_scene
from rockfall.protection.crossings import passes
from rockfall.protection.demand import demand
from rockfall.protection.design import conditions_of, unconfirmed_of
from rockfall.protection.factors import Conditions, Factors, read_factors
from rockfall.protection.selection import MAX_HEIGHT, Costs, cost_of, read_costs, residual_of
from rockfall.result.crossings import has_crossed, line_names
from rockfall.result.variables import ENDS
from rockfall.scene.read import read_scene
from rockfall.scene.rules.plausible import warn_of
from rockfall.simulation.memory import machine_memory
from rockfall.simulation.simulate import run_scene
from rockfall.studies.barrier_advice import Advice, Most, advise, check_acceptable, wanted
from rockfall.studies.siting_runs import (
    AtAlignment,
    boulders_at,
    in_batches,
    memory_note,
    pooled,
    populations,
    scene_with,
    sited_case,
)
from rockfall.studies.study import Study

YES, NO, UNDECIDED = "yes", "no", "undecided"
BEST, NOT_DISTINGUISHED = "best", "not distinguished"
LEVEL = 0.95  # quantile of the loads
CONDITIONS = {field.name for field in fields(Conditions)}
NUMBERS = ("fraction", "energy_q95", "height_q95", "bypass", "E_d", "height_needed", "ead_class",
           "remaining", "cost")  # fmt: skip
COLUMNS = ["alignment", "distance", "space", "elevation", "length", "n"]
COLUMNS += [name for number in NUMBERS for name in with_limits(number)]
COLUMNS += ["fits", "fails", "choice", "unconfirmed"]


@dataclass(frozen=True)
class Limits:
    """Limits of available barriers: height [m], EAD class, fraction of arriving boulders that may
    pass around the ends, and braking distance to the protected line [m]. None means no limit."""

    height: float | None = None
    ead_class: int | None = None
    bypass: float = MAX_AROUND
    space: float | None = None


@dataclass(frozen=True)
class Siting:
    """Candidate alignments above a protected line, in SI units; intervals are 95 % confidence
    intervals.

    `table` has a row for each alignment. From boulders that cross the alignment: `energy_q95`
    (total), `height_q95` (of the centre, vertical), and the values of E_d, height and EAD class
    that the standard requires. From boulders that reach the protected line: `bypass`, the fraction
    that did not cross the alignment before, and `remaining`, the fraction that would still arrive
    past a barrier of this height and class. `cost` applies to the full length. `fits` is yes, no or
    undecided; `fails` lists exceeded or undecided limits and unconfirmed assumptions. `choice`
    marks the best alignment under these assumptions. `advice` is the resulting barrier, verified by
    a run; None if no alignment is within the limits. With &scenario groups, the values cover the
    boulders of all scenarios, weighted by frequency.
    """

    line: str
    boulders: int
    come: int  # number of boulders that reach the protected line
    limits: Limits
    factors: Factors
    priced: bool  # True if costs are from prices
    table: pd.DataFrame
    alignments: tuple[Alignment, ...]
    advice: Advice | None
    #: Runs with evaluation lines at all alignments, or at the best alignment.
    results: Mapping[str, xr.Dataset]
    notes: tuple[str, ...]

    @property
    def scenarios(self) -> list[str]:
        """Names of the scenarios; none if the boulders are those of &boulder."""
        return [name for name in self.results if name]

    @property
    def result(self) -> xr.Dataset:
        """Result of the case, or of its first scenario."""
        return next(iter(self.results.values()))


def site(
    case: Case,
    line: str,
    *,
    every: float = 10.0,
    to: float = 100.0,
    direction: float | None = None,
    candidates: Any = None,
    candidates_layer: str | None = None,
    max_height: float | None = None,
    max_class: int | None = None,
    max_bypass: float = 0.01,
    space: float | None = None,
    acceptable: float | None = None,
    volume: float | None = None,
    factors: str | Path | None = None,
    costs: str | Path | None = None,
    progress: bool = False,
    memory: float | None = None,
    **given: Any,
) -> Siting:
    """Compare alignments of a barrier above `line`, an evaluation line of a case.

    Candidates are the line and copies of it, shifted by multiples of `every` [m] up to `to` [m],
    perpendicular to the line towards the sources, or in a `direction` [degree from north].
    Alternatively, they are the lines of a layer `candidates` (a file or GeoDataFrame). The case, or
    each of its &scenario groups (with boulders weighted by frequency), is run with all candidates
    as evaluation lines. If the boulders need more than half of `memory` [bytes] (default: the
    machine's memory), the candidates are distributed over several runs with the same boulders.
    `max_height` [m] and `max_class` (0 to 7) limit the barrier, `max_bypass` the fraction of the
    boulders that may pass around its ends. Alignments closer to the line than the braking distance
    `space` [m] are refused. `volume`, `factors`, `costs` and the conditions of the standard are as
    in `rockfall.design`; `given` are arrays and layers as in `rockfall.run`.

    The resulting barrier is verified by a run with the same boulders, or by a run for each
    &scenario. If the upper limit of arriving boulders (95 % interval) exceeds `acceptable` per
    year, stronger barriers and the next cheapest alignments are tried. Invalid arguments raise a
    RockfallError.

    >>> import rockfall
    >>> case = rockfall.read_case("case.nml")
    >>> how = {"every": 10.0, "to": 20.0, "max_height": 5.0}
    >>> found = rockfall.site(case, "L", factors="factors.csv", **how)
    >>> found.table["alignment"].tolist()
    ['L', 'L +10 m', 'L +20 m']
    """
    limits = _limits(max_height, max_class, max_bypass, space)
    check_acceptable(case, acceptable)
    conditions = {key: given.pop(key) for key in CONDITIONS & given.keys()}
    standard = read_factors(conditions_of(conditions), factors)
    standard.require("site")
    prices = read_costs(costs) if costs is not None else None
    if volume is not None and not 0 < volume < math.inf:
        raise RockfallError(f"volume = {volume}: must be > 0 m3")
    case = sited_case(case)
    scene = read_scene(case, **given)
    warn_of(scene)
    if candidates is None:
        scene, alignments = shifted_scene(scene, line, Shift(every, to, direction))
    else:
        scene, alignments = drawn_scene(case, scene, line, candidates, candidates_layer, given)
    runs = populations(scene)
    yearly = {name: run.yearly for name, run in runs.items()}
    batches = in_batches(scene, line, alignments, machine_memory() if memory is None else memory)
    design_of = standard, case.boulder["density"], volume
    results: dict[str, xr.Dataset] = {}
    held: list[Iterable[AtAlignment]] = []  # boulders by batch of alignments

    def numbers(key: tuple[int, str], result: xr.Dataset) -> list[dict[str, Any]]:
        k, name = key
        if len(batches) == 1:
            results[name] = result
        at = (boulders_at(result, line, place.name) for place in batches[k])
        held.append(at if name == [*runs][-1] else list(at))
        if len(held) < len(runs):
            return []
        rows = [
            _row(pooled(own, [*yearly.values()]), place, design_of, prices, limits)
            for place, own in zip(batches[k], zip(*held, strict=True), strict=True)
        ]
        held.clear()
        return rows

    scenes = (
        ((k, name), scene_with(run.scene, line, alignments, batch))
        for k, batch in enumerate(batches)
        for name, run in runs.items()
    )
    rows: list[dict[str, Any]] = []
    with Study(scene.boulders * len(batches) * len(runs), progress=progress) as study:
        for _, own in study.run(scenes, numbers, compared=False):
            rows += own
    choose(rows)
    if not results:
        chosen = [spot for spot, row in zip(alignments, rows, strict=True) if row["choice"] == BEST]
        for name, run in runs.items():
            results[name] = run_scene(scene_with(run.scene, line, alignments, chosen))
    unconfirmed = "; ".join(dict.fromkeys(
        doubt
        for result in results.values()
        for doubt in filter(None, unconfirmed_of(result, scene.case, standard).split("; "))
    ))  # fmt: skip
    rows = [row | under_doubt(row, unconfirmed) for row in rows]
    come = sum(
        int(np.count_nonzero(has_crossed(result, line_names(result).index(line))))
        for result in results.values()
    )
    notes = (*_notes(scene.case, line, come, alignments, rows), *joint_warnings(results))
    if len(batches) > 1:
        notes = (memory_note(scene, alignments, batches), *notes)
    if candidates is None and alignments[-1].distance + every <= to * (1 + 1e-9):
        beyond = f"alignments beyond {alignments[-1].distance:g} m are outside the terrain"
        notes = (f"{beyond}: left out", *notes)
    most = Most(prices=prices)
    most = most if max_height is None else most._replace(height=max_height)
    most = most if max_class is None else most._replace(ead_class=max_class)
    barriers = wanted(rows, alignments, most) if come else []
    bare = {name: (result, yearly[name]) for name, result in results.items()}
    advice = advise(case, line, barriers, most, acceptable, bare, given, progress=progress)
    boulders = sum(result.sizes["boulder"] for result in results.values())
    return Siting(
        line, boulders, come, limits, standard, prices is not None,
        pd.DataFrame(rows, columns=COLUMNS), tuple(alignments), advice, results, notes,
    )  # fmt: skip


def _limits(
    height: float | None, ead_class: int | None, bypass: float, space: float | None
) -> Limits:
    if height is not None and not 0 < height <= MAX_HEIGHT:
        raise RockfallError(f"max_height = {height}: must be > 0 and <= {MAX_HEIGHT:g} m")
    if ead_class is not None and ead_class not in range(len(EAD_ENERGY)):
        raise RockfallError(f"max_class = {ead_class}: must be 0 to {len(EAD_ENERGY) - 1}")
    if not 0 <= bypass <= 1:
        raise RockfallError(f"max_bypass = {bypass}: must be 0 to 1")
    if space is not None and not 0 <= space < math.inf:
        raise RockfallError(f"space = {space}: must be >= 0 m")
    return Limits(height, ead_class, bypass, space)


def _row(
    at: AtAlignment,
    alignment: Alignment,
    design_of: tuple[Factors, float, float | None],
    prices: Costs | None,
    limits: Limits,
) -> dict[str, Any]:
    came, crossed, comes, around, source = at[:5]
    row: dict[str, Any] = {
        "alignment": alignment.name, "distance": alignment.distance, "space": alignment.space,
        "elevation": alignment.elevation, "length": alignment.length, "n": came.n,
    }  # fmt: skip
    row |= _named("fraction", fraction_interval(crossed, source))
    row |= _named("energy_q95", quantile(came.energy_total, LEVEL, came.source))
    row |= _named("height_q95", quantile(came.passing_height, LEVEL, came.source))
    asked = demand(came, *design_of)
    for name in ("E_d", "height_needed", "ead_class"):
        row |= {f"{name}{end}": asked[f"{name}{end}"] for end in ENDS}
    row |= _named("bypass", residual_of(around[comes], source[comes]))
    left = around.copy()
    if (capacity := _capacity(row["ead_class"])) is not None:
        left[crossed] |= passes(came, row["height_needed"], capacity)
        row |= _named("remaining", residual_of(left[comes], source[comes]))
    row |= {f"cost{end}": _cost(row, end, prices) for end in ENDS}
    return row | _verdicts(row, limits)


def _named(name: str, values: tuple[float, float, float]) -> dict[str, float]:
    return dict(zip(with_limits(name), values, strict=True))


def _capacity(ead_class: float) -> float | None:
    """Energy [J] of an EAD class; None for a class above the list, or without boulders."""
    return EAD_ENERGY[int(ead_class)] if ead_class < len(EAD_ENERGY) else None


def _cost(row: Mapping[str, Any], end: str, prices: Costs | None) -> float:
    """Cost of an alignment over its length, with the cheapest barrier of at least the required
    class and height; NaN if there is none. Without prices, the cost is class energy x height x
    length [kJ m2]."""
    ead_class, high = row[f"ead_class{end}"], row[f"height_needed{end}"]
    if math.isnan(ead_class) or math.isnan(high):
        return math.nan
    each = [cost_of(k, high, prices) for k in range(int(ead_class), len(EAD_ENERGY))]
    return min((cost for cost in each if not math.isnan(cost)), default=math.nan) * row["length"]


def _verdicts(row: Mapping[str, Any], limits: Limits) -> dict[str, str]:
    """Verdict from the intervals of the requirements; undecided if an upper limit is unknown."""
    checks = {"height": ("height_needed", limits.height), "class": ("ead_class", limits.ead_class),
              "bypass": ("bypass", limits.bypass)}  # fmt: skip
    verdicts = {}
    for name, (number, limit) in checks.items():
        value, low, high = (row[f"{number}{end}"] for end in ENDS)
        if limit is None or (value <= limit and high <= limit):
            continue
        verdicts[name] = NO if value > limit and low > limit else UNDECIDED
    if limits.space is not None and row["space"] < limits.space:
        verdicts["space"] = NO
    verdict = NO if NO in verdicts.values() else UNDECIDED if verdicts else YES
    return {
        "fits": verdict,
        "fails": ", ".join(k for k, answer in verdicts.items() if answer == verdict),
    }


def under_doubt(row: Mapping[str, Any], unconfirmed: str) -> dict[str, str]:
    """Columns of a verdict: undecided instead of yes if loads depend on unconfirmed assumptions."""
    fits, fails = row["fits"], row["fails"]
    if unconfirmed and fits != NO:
        fails = "; ".join(filter(None, [fails, f"unconfirmed: {unconfirmed}"]))
        fits = UNDECIDED
    return {"unconfirmed": unconfirmed, "fits": fits, "fails": fails}


def choose(rows: list[dict[str, Any]]) -> None:
    """Mark the cheapest alignment within the limits (or, if there is none, the cheapest undecided
    alignment), and those whose cost does not differ significantly. Overlapping intervals count as
    not significant, which is conservative because the alignments share boulders."""
    for row in rows:
        row["choice"] = ""
    open_ones = [row for row in rows if row["fits"] != NO and not math.isnan(row["cost"])]
    sure = [row for row in open_ones if row["fits"] == YES]
    if not open_ones:
        return
    best = min(sure or open_ones, key=lambda row: (row["cost"], row["distance"]))
    highest = math.inf if math.isnan(best["cost_high"]) else best["cost_high"]
    for row in open_ones:
        if not row["cost_low"] > highest:  # unknown limits exclude nothing
            row["choice"] = NOT_DISTINGUISHED
    best["choice"] = BEST


def _notes(
    case: Case, line: str, come: int, alignments: list[Alignment], rows: list[dict[str, Any]]
) -> Iterator[str]:
    if not come:
        yield f"no boulder reaches {line}: the fraction that bypasses an alignment is unknown"
    if case.barrier:
        yield (
            "the run includes the barriers of the case: alignments below them only receive "
            "boulders that pass them"
        )
    own = next((alignment for alignment in alignments if alignment.name == line), None)
    if own is not None and all(alignment.elevation <= own.elevation for alignment in alignments):
        yield f"no alignment is higher than {line}: give the uphill direction"
    if all(row["fits"] == NO for row in rows):
        yield "no alignment is within the limits"
