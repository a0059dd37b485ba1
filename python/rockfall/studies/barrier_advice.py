# SPDX-License-Identifier: BSD-3-Clause
"""Barrier recommended by a siting, and the boulders that reach the line without and with it, from
runs with the same boulders."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from rockfall.analysis.hazard.classes import frequencies
from rockfall.analysis.precision.clusters import Clusters
from rockfall.analysis.precision.intervals import fraction_interval
from rockfall.analysis.precision.paired import difference_of_fractions
from rockfall.case import Case
from rockfall.errors import RockfallError
from rockfall.kernel_rules import EAD_ENERGY
from rockfall.protection.alignments import Alignment
from rockfall.protection.selection import MAX_HEIGHT, Costs, cheapest, least_heights
from rockfall.result.crossings import line_names, line_values, outcomes_at
from rockfall.result.variables import OUTCOME
from rockfall.scene.read import read_scene
from rockfall.scene.scene import Scene
from rockfall.studies.siting_runs import populations
from rockfall.studies.study import Study
from rockfall.studies.variants import stopped_at
from rockfall.studies.yearly_variants import Three, hits_at, yearly_sum

STEP = 0.5  # step of barrier heights [m]
MOST_TRIED = 5  # maximum alignments tried, the cheapest first
NAME = "advised barrier"
ROUND = "round"  # outcome of a boulder that passed around the ends
HITS = "passing_height", "energy_total"


class Wanted(NamedTuple):
    """A barrier to be tried."""

    alignment: Alignment
    height: float  # height of the upper edge above the ground, vertical [m]
    ead_class: int


class Most(NamedTuple):
    """Maximum height and EAD class of barriers, and their prices."""

    height: float = MAX_HEIGHT  # maximum height [m]
    ead_class: int = len(EAD_ENERGY) - 1
    prices: Costs | None = None


@dataclass(frozen=True)
class Advice:
    """A barrier, and the boulders that reach the protected line `today` and with the barrier
    (`left`), with 95 % limits; `change` is the paired difference. The values are annual numbers if
    the case has scenarios (`yearly`), else fractions of the released boulders.

    `ways` gives the fractions of the boulders left that pass over the barrier, break through it, or
    pass around its ends; `tried` counts alignments. `is_enough` is None without an `acceptable`.
    """

    barrier: Wanted
    yearly: bool
    today: Three
    left: Three
    change: Three
    ways: dict[str, float]
    acceptable: float | None  # acceptable frequency [1/year]
    tried: int

    @property
    def is_enough(self) -> bool | None:
        return None if self.acceptable is None else self.left[2] <= self.acceptable

    @property
    def has_effect(self) -> bool:
        """True if the barrier significantly reduces the number of boulders."""
        return self.change[2] < 0


class _Came(NamedTuple):
    """Mask (boulders,) of a run's boulders that reach the line, with their outcome at the barrier
    (0 if they did not meet it before the line), heights [m] and energies [J] there."""

    comes: np.ndarray
    outcome: np.ndarray
    height: np.ndarray
    energy: np.ndarray
    clusters: Clusters
    per_cluster: float  # number of boulders at the line that count as one observation
    yearly: float


def check_acceptable(case: Case, acceptable: float | None) -> None:
    """Raise a RockfallError for an `acceptable` frequency that is not positive and finite, or
    whose case has no scenarios."""
    if acceptable is None:
        return
    if not 0 < acceptable < math.inf:
        raise RockfallError(f"acceptable = {acceptable}: must be > 0 boulders per year")
    if not case.scenario:
        raise RockfallError(
            f"{case.name}: acceptable = {acceptable:g} per year: requires &scenario groups with "
            "frequencies"
        )


def wanted(
    rows: Sequence[Mapping[str, Any]], alignments: Sequence[Alignment], most: Most
) -> list[Wanted]:
    """Barriers to try at alignments that are not refused: those that fit first, then by cost.
    Height (in steps) and class are upper limits of their intervals where known, at most `most`."""
    able = [
        (row["fits"] != "yes", row["cost"], row["distance"], k)
        for k, row in enumerate(rows)
        if row["fits"] != "no" and not math.isnan(row["cost"])
    ]
    barriers = []
    for *_, k in sorted(able):
        row = rows[k]
        needed, asked = (
            row[name] if math.isnan(row[f"{name}_high"]) else row[f"{name}_high"]
            for name in ("height_needed", "ead_class")
        )
        high = min(max(STEP, STEP * math.ceil(needed / STEP - 1e-9)), most.height)
        barriers.append(Wanted(alignments[k], high, int(min(asked, most.ead_class))))
    return barriers


def advise(
    case: Case,
    line: str,
    barriers: Sequence[Wanted],
    most: Most,
    acceptable: float | None,
    bare: Mapping[str, tuple[xr.Dataset, float]],
    given: Mapping[str, Any],
    *,
    progress: bool = False,
) -> Advice | None:
    """First barrier (as proposed, higher, or of a higher class) for which the upper limit of
    boulders at the line is at most `acceptable` per year (None: any); if none suffices, the barrier
    with the lowest upper limit; None without barriers. `bare` has the results without a barrier
    and their frequencies [1/year], for the same scenarios or for the case."""
    if not barriers:
        return None
    yearly = {name: often for name, (_, often) in bare.items()}
    without = ((name, result) for name, (result, _) in bare.items())
    today = _came(without, yearly, line, None, progress)
    best: Advice | None = None
    for number, first in enumerate(barriers[:MOST_TRIED], start=1):
        barrier: Wanted | None = first
        while barrier:
            scenes = _with_barrier(case, barrier, given)
            after = _came(scenes, yearly, line, barrier, progress)
            advice = Advice(
                barrier, bool(case.scenario), _sum(case, today), _sum(case, after),
                _change(case, today, after), _ways(after), acceptable, number,
            )  # fmt: skip
            if best is None or advice.left[2] < best.left[2]:
                best = advice
            if acceptable is None or advice.is_enough:
                return advice
            barrier = (
                _stronger(case, barrier, after, most, acceptable) if barrier == first else None
            )
    return best and replace(best, tried=min(len(barriers), MOST_TRIED))


def _stronger(
    case: Case, barrier: Wanted, after: Sequence[_Came], most: Most, acceptable: float
) -> Wanted | None:
    """Cheapest barrier of at least this height and class for which the upper limit of boulders at
    the line would be at most `acceptable` per year; None if there is none."""

    def is_enough(ead_class: int, k: int) -> bool:
        would = (
            came._replace(comes=came.comes & (
                (came.outcome == 0)
                | (came.height > heights[k])
                | (came.energy > EAD_ENERGY[ead_class])
            ))
            for came in after
        )  # fmt: skip
        return _sum(case, list(would))[2] <= acceptable

    highest = max(float(np.nanmax(came.height, initial=barrier.height)) for came in after)
    steps = int((min(most.height, highest + STEP) - barrier.height) / STEP + 1e-9)
    # heights above the highest boulder stop no more boulders
    heights = [barrier.height + k * STEP for k in range(steps + 1)]
    classes = range(barrier.ead_class, most.ead_class + 1)
    choice = cheapest(least_heights(classes, heights, is_enough, most.prices))
    return choice and Wanted(barrier.alignment, choice.height, choice.ead_class)


def group_of(barrier: Wanted) -> dict[str, Any]:
    """Keys and values of a `&barrier` group for a barrier."""
    alignment, height, ead_class = barrier
    return {"name": NAME, "x": alignment.x, "y": alignment.y, "height": height, "class": ead_class}


def _came(
    scenes: Iterable[tuple[str, Scene | xr.Dataset]],
    yearly: Mapping[str, float],
    line: str,
    barrier: Wanted | None,
    progress: bool,
) -> list[_Came]:
    """Boulders in each run or result that reach a line, with `barrier` (None: without it)."""
    is_line = barrier is not None and barrier.alignment.name == line

    def numbers(name: str, result: xr.Dataset) -> _Came:
        at = NAME if is_line else line
        hits = np.where(stopped_at(result, at), np.nan, hits_at(result, at))
        comes = ~np.isnan(hits[0])
        outcome = np.zeros(comes.size, "i1")
        height = energy = np.full(comes.size, np.nan)
        if barrier is not None:
            names = line_names(result)
            met, there = (line_values(result, "time", names.index(own)) for own in (NAME, line))
            here = names.index(NAME)
            height, energy = (line_values(result, name, here) for name in HITS)
            outcome = outcomes_at(result, here)
            outcome = np.where(is_line | (met <= there), outcome, 0)
        came, clusters = np.flatnonzero(comes), Clusters.of(result)
        per_cluster = clusters.at(came, *hits[:, came])
        return _Came(comes, outcome, height, energy, clusters, per_cluster, yearly[name])

    return [came for _, came in Study(progress=progress).run(scenes, numbers)]


def _with_barrier(
    case: Case, barrier: Wanted, given: Mapping[str, Any]
) -> Iterator[tuple[str, Scene]]:
    """Scenes for runs of the case with a barrier."""
    scene = read_scene(case.replace(barrier=[*case.barrier, group_of(barrier)]), **given)
    for name, run in populations(scene).items():
        yield name, run.scene


def _sum(case: Case, runs: Sequence[_Came]) -> Three:
    """Number of arriving boulders per year, or their fraction without scenarios, with limits."""
    if not case.scenario:
        return fraction_interval(runs[0].comes, runs[0].clusters.source)
    parts = (
        (np.array([np.count_nonzero(run.comes)]), run.comes.size, run.per_cluster, run.yearly)
        for run in runs
    )
    value, low, high = np.ravel(frequencies(parts, case.hazard["frequency_factor"])).tolist()
    return value, low, high


def _change(case: Case, today: Sequence[_Came], after: Sequence[_Came]) -> Three:
    """Change of `_sum` due to a barrier, from the differences of the same boulders."""
    apart = (
        difference_of_fractions(here.comes, before.comes, here.clusters.source)
        for here, before in zip(after, today, strict=True)
    )
    return yearly_sum([run.yearly for run in after], apart, _factor(case))


def _factor(case: Case) -> Sequence[float]:
    """Lowest and highest factor by which the frequencies of the case are multiplied."""
    return case.hazard["frequency_factor"] if case.scenario else (1.0,)


def _ways(runs: Sequence[_Came]) -> dict[str, float]:
    """Fractions of boulders that still arrive, by how they pass the barrier."""
    masks = {name: number for name, number in OUTCOME.items() if name != "stopped"} | {ROUND: 0}
    parts = {
        name: sum(run.yearly * float(np.mean(run.comes & (run.outcome == k))) for run in runs)
        for name, k in masks.items()
    }
    total = sum(parts.values())
    return {name: part / total for name, part in parts.items() if part} if total else {}
