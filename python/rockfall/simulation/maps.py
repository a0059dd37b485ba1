# SPDX-License-Identifier: BSD-3-Clause
"""Maps of a running simulation: the kernel's tallies by cell in its stacks, and the sums over
parts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from rockfall._core import rockfall_f2py as _core
from rockfall.case import Case
from rockfall.result.variables import EXCEEDED

HITS = "tree_impacts"  # a map of counts, kept among the sums because they hold larger numbers
SHARED = ("shared_cell", "shared_source", "shared_boulders")  # of the sources that a range cuts


class Plan(NamedTuple):
    """Tallies needed for the maps of a case: layers by name, from 1 in their stacks; 0: not
    needed."""

    #: passages, deposits, sources; released: boulders of these sources; hits; energy_exceeded and
    #: hits_energy_exceeded: the first of those for thresholds
    counts: dict[str, int]
    sums: dict[str, int]  # of the quantities below, by name, followed by their squares
    maxima: dict[str, int]
    bins: int  # count bins for quantiles
    layers: dict[str, int]  # number of layers of each stack (counts, sums, maxima)


def plan_of(case: Case) -> Plan:
    """Tallies needed for the maps of a case."""
    return _plan(" ".join(case.output.get("maps", [])), len(case.hazard["thresholds"]))


@lru_cache(maxsize=16)
def _plan(names: str, thresholds: int) -> Plan:
    counts, sums, maxima, bins, layers = _core.map_plan(names, thresholds)
    quantities = (
        "energy", "speed", "jump_height", "passing_height", "tree_height", "tree_energy", HITS,
    )  # fmt: skip
    kinds = "passages", "deposits", "sources", "released", "hits", *EXCEEDED
    return Plan(
        dict(zip(kinds, counts.tolist(), strict=True)),
        dict(zip(quantities, sums.tolist(), strict=True)),
        dict(zip(quantities[:5], maxima.tolist(), strict=True)),
        int(bins),
        dict(zip(("counts", "sums", "maxima"), layers.tolist(), strict=True)),
    )


def boulders_per_cluster(case: Case, x: np.ndarray, y: np.ndarray) -> int:
    """Number of boulders from these places that count as one in the intervals of cells. With
    sampled sources, the boulders of a place may all behave alike, and maps do not record their
    differences; the number is then that of the place that released the most. With given sources it
    is 1."""
    if case.release["sources"] != "sample" or not len(x):
        return 1
    import pandas as pd

    return int(np.bincount(pd.factorize(x + 1j * y)[0]).max())


def count_limits(
    counts: np.ndarray, boulders: int, per_cluster: int
) -> tuple[np.ndarray, np.ndarray]:
    """Limits of the 95 % intervals of fractions of the boulders, computed by the kernel."""
    low, high = _core.fraction_limits(np.ravel(counts) / boulders, boulders / per_cluster)
    return low.reshape(np.shape(counts)), high.reshape(np.shape(counts))


def tells_sources(case: Case) -> bool:
    """Return True if a map needs the source of each boulder."""
    plan = plan_of(case).counts
    return bool(plan["sources"] or plan["released"])


def join_sources(case: Case, counts: np.ndarray, parts: Sequence[Mapping[str, np.ndarray]]) -> None:
    """Count each source that parts split once per cell, with all its boulders: the counts of the
    parts are removed from the stack, and one joint count is added."""
    plan = plan_of(case).counts
    cell, source, boulders = (np.concatenate([part[name] for part in parts]) for name in SHARED)
    layers = counts.reshape(len(counts), -1)
    cells = layers.shape[1]
    once_source, once_cell = np.divmod(np.unique(source * np.int64(cells) + cell), cells)
    if plan["sources"]:
        layer = layers[plan["sources"] - 1]
        np.subtract.at(layer, cell, np.int32(1))
        np.add.at(layer, once_cell, np.int32(1))
    if plan["released"]:
        numbers, total = _boulders_of(parts)
        layer = layers[plan["released"] - 1]
        np.subtract.at(layer, cell, boulders)
        np.add.at(layer, once_cell, total[np.searchsorted(numbers, once_source)])


def _boulders_of(parts: Sequence[Mapping[str, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of the split sources, and the boulders of each over all parts."""
    rows = []
    for part in parts:
        source, first = np.unique(part["shared_source"], return_index=True)
        rows.append((source, part["shared_boulders"][first]))
    source, boulders = (np.concatenate(column) for column in zip(*rows, strict=True))
    numbers, which = np.unique(source, return_inverse=True)
    total = np.zeros(numbers.size, "i4")
    np.add.at(total, which, boulders)
    return numbers, total
