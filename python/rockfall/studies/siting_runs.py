# SPDX-License-Identifier: BSD-3-Clause
"""Boulders at candidate alignments: from a single run, or from a run of each scenario, pooled by
frequency."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import xarray as xr

from rockfall.analysis.hazard.scenarios import base_case, scenarios_of
from rockfall.analysis.lines.around import goes_around
from rockfall.analysis.precision.intervals import Sources, sources
from rockfall.analysis.precision.weighted import Weighted
from rockfall.case import Case
from rockfall.errors import RockfallError
from rockfall.protection.alignments import Alignment
from rockfall.protection.crossings import Crossings, crossings
from rockfall.result.crossings import has_crossed, line_names
from rockfall.scene.scene import Scene
from rockfall.simulation.memory import BYTES_AT_LINE, ROOM
from rockfall.studies.study import ROWS_ONLY


class Population(NamedTuple):
    """Scene of a run, and the annual frequency of its boulders [1/year] (1 without scenarios)."""

    scene: Scene
    yearly: float


class AtAlignment(NamedTuple):
    """Boulders of a run at an alignment: crossings, and masks (boulders,) of boulders that cross
    it, that reach the protected line, and that reach the line without crossing it."""

    came: Crossings
    crossed: np.ndarray
    comes: np.ndarray
    around: np.ndarray
    source: Sources | Weighted  # sources of all boulders


def sited_case(case: Case) -> Case:
    """Case for the scene that all runs of a siting share."""
    return base_case(case, ROWS_ONLY) if case.scenario else case.replace(output=ROWS_ONLY)


def populations(scene: Scene) -> dict[str, Population]:
    """Population of each scenario of a siting, with the scene's lines; without scenarios, a single
    population named ""."""
    if not scene.case.scenario:
        return {"": Population(scene, 1.0)}
    return {
        own.name: Population(replace(scene, case=own.case), own.frequency)
        for own in scenarios_of(scene, scene.case.line)
    }


def boulders_at(result: xr.Dataset, line: str, alignment: str) -> AtAlignment:
    """Boulders of a result at an alignment above the protected line."""
    names = line_names(result)
    number, protected = names.index(alignment), names.index(line)
    return AtAlignment(
        crossings(result, number), has_crossed(result, number), has_crossed(result, protected),
        goes_around(result, protected, [number]), sources(result),
    )  # fmt: skip


def _bytes(scene: Scene) -> int:
    """Memory for the boulders at a line [bytes]. The boulders of all scenarios are pooled, so
    results and copies of the crossing boulders are in memory at the same time."""
    scenarios = len(scene.case.scenario)
    return BYTES_AT_LINE * scene.boulders * (1 + 2 * scenarios)


def pooled(each: Sequence[AtAlignment], yearly: Sequence[float]) -> AtAlignment:
    """Boulders of several runs, pooled by frequency [1/year]. A boulder represents the frequency
    of its run divided by the number of boulders released. A single run is unchanged."""
    if len(each) == 1:
        return each[0]
    weights = [often / at.crossed.size for at, often in zip(each, yearly, strict=True)]
    released = [at.source for at in each if isinstance(at.source, Sources)]
    clusters = [own.number if own.sampled else np.arange(own.number.size) for own in released]

    def weighted(which: Sequence[np.ndarray]) -> Weighted:
        sizes = [np.count_nonzero(mask) for mask in which]
        own = (cluster[mask] for cluster, mask in zip(clusters, which, strict=True))
        return Weighted(np.repeat(weights, sizes), np.concatenate([*own]))

    values = (np.concatenate(parts) for parts in zip(*(at.came[1:] for at in each), strict=True))
    came = Crossings(weighted([at.crossed for at in each]), *values)
    crossed, comes, around = (
        np.concatenate(parts) for parts in zip(*(at[1:4] for at in each), strict=True)
    )
    source = weighted([np.full(at.crossed.size, True) for at in each])
    return AtAlignment(came, crossed, comes, around, source)


def in_batches(
    scene: Scene, line: str, alignments: Sequence[Alignment], memory: float
) -> list[list[Alignment]]:
    """Split alignments into batches whose boulders, including those at other lines, need at most
    half of the memory [bytes]. Raises a RockfallError if a single alignment needs more."""
    others = len(scene.case.lines) - sum(alignment.name != line for alignment in alignments)
    each = _bytes(scene)
    most = int(ROOM * memory / each) - others
    if most < 1:
        raise RockfallError(
            f"site: {scene.boulders:,} boulders at {others + 1} lines need "
            f"{each * (others + 1) / 1e9:.2g} GB, more than half of the memory: give fewer boulders"
        )
    number = -(-len(alignments) // most)
    parts = np.array_split(np.arange(len(alignments)), number)
    return [[alignments[k] for k in part] for part in parts]


def scene_with(
    scene: Scene, line: str, alignments: Sequence[Alignment], drawn: Sequence[Alignment]
) -> Scene:
    """Scene whose evaluation lines are those of the case and the alignments `drawn`."""
    left_out = {alignment.name for alignment in alignments} - {item.name for item in drawn} - {line}
    if not left_out:
        return scene
    lines = [item for item in scene.case.line if item["name"] not in left_out]
    return scene.replace(case=scene.case.replace(line=lines))


def memory_note(
    scene: Scene, alignments: Sequence[Alignment], batches: Sequence[Sequence[Alignment]]
) -> str:
    """Note that a case runs several times, with the memory that a single run would need."""
    need, scenarios = _bytes(scene) * len(alignments) / 1e9, len(scene.case.scenario) or 1
    return (
        f"{scenarios * scene.boulders:,} boulders at {len(alignments)} alignments need {need:.2g} "
        f"GB, more than half of the memory: {scenarios * len(batches)} runs, and only the best "
        "alignment is kept"
    )
