# SPDX-License-Identifier: BSD-3-Clause
"""Maps in the making: where the kernel's tallies by cell are in its stacks, and what parts add."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from rockfall._core import rockfall_f2py as _core
from rockfall.case import Case

HITS = "tree_impacts"  # a map of counts; they are among the sums, which hold more
SHARED = ("shared_cell", "shared_source", "shared_boulders")  # of the sources that a range cuts


class Plan(NamedTuple):
    """The tallies that some maps need: layers by name, from 1 in their stacks; 0: none."""

    #: passages, deposits, sources; released: boulders of these sources; energy_exceeded: the first
    #: of those for thresholds
    counts: dict[str, int]
    sums: dict[str, int]  # of the quantities below, by name; squares stand behind them
    maxima: dict[str, int]
    bins: int  # of counts for quantiles
    layers: dict[str, int]  # of each stack (counts, sums, maxima)


def plan_of(case: Case) -> Plan:
    """That of the maps of a case."""
    names = " ".join(case.output.get("maps", []))
    counts, sums, maxima, bins, layers = _core.map_plan(names, len(case.hazard["thresholds"]))
    quantities = (
        "energy", "speed", "jump_height", "passing_height", "tree_height", "tree_energy", HITS,
    )  # fmt: skip
    kinds = "passages", "deposits", "sources", "released", "energy_exceeded"
    return Plan(
        dict(zip(kinds, counts.tolist(), strict=True)),
        dict(zip(quantities, sums.tolist(), strict=True)),
        dict(zip(quantities[:5], maxima.tolist(), strict=True)),
        int(bins),
        dict(zip(("counts", "sums", "maxima"), layers.tolist(), strict=True)),
    )


def boulders_per_cluster(case: Case, x: np.ndarray, y: np.ndarray) -> int:
    """How many boulders that started at these places count as one in intervals of cells: where
    sources are a sample, those of a place may all do the same, and maps do not know how they
    differ; so all of them, of the place that released the most. Given sources: 1."""
    if case.release["sources"] != "sample" or not len(x):
        return 1
    import pandas as pd

    return int(np.bincount(pd.factorize(x + 1j * y)[0]).max())


def count_limits(
    counts: np.ndarray, boulders: int, per_cluster: int
) -> tuple[np.ndarray, np.ndarray]:
    """The limits of the 95 % intervals of fractions of the boulders, as the kernel has them."""
    low, high = _core.count_limits(np.ravel(counts), boulders, per_cluster)
    return low.reshape(np.shape(counts)), high.reshape(np.shape(counts))


def tells_sources(case: Case) -> bool:
    """Whether a map asks which source a boulder has."""
    plan = plan_of(case).counts
    return bool(plan["sources"] or plan["released"])


def join_sources(case: Case, counts: np.ndarray, parts: Sequence[Mapping[str, np.ndarray]]) -> None:
    """Count the sources that several parts cut once a cell, with all their boulders: what the parts
    counted of them is taken out of the stack of counts, and put back once."""
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
    """Numbers of the cut sources, and the boulders of each over all parts."""
    rows = []
    for part in parts:
        source, first = np.unique(part["shared_source"], return_index=True)
        rows.append((source, part["shared_boulders"][first]))
    source, boulders = (np.concatenate(column) for column in zip(*rows, strict=True))
    numbers, which = np.unique(source, return_inverse=True)
    total = np.zeros(numbers.size, "i4")
    np.add.at(total, which, boulders)
    return numbers, total
