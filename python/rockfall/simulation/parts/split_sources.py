# SPDX-License-Identifier: BSD-3-Clause
"""Sources that are split between parts of a run; they count once in maps of sources."""

from collections.abc import Mapping, Sequence

import numpy as np

from rockfall.case import Case
from rockfall.simulation.map_plan import plan_of

SHARED = (
    "shared_cell",
    "shared_source",
    "shared_boulders",
)  # arrays on split sources


def join_sources(case: Case, counts: np.ndarray, parts: Sequence[Mapping[str, np.ndarray]]) -> None:
    """Count each split source once per cell: remove the counts of the parts from the stack, and add
    a joint count over the boulders of all parts."""
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
    """Numbers of the split sources, and the boulders of each from all parts."""
    rows = []
    for part in parts:
        source, first = np.unique(part["shared_source"], return_index=True)
        rows.append((source, part["shared_boulders"][first]))
    source, boulders = (np.concatenate(column) for column in zip(*rows, strict=True))
    numbers, which = np.unique(source, return_inverse=True)
    total = np.zeros(numbers.size, "i4")
    np.add.at(total, which, boulders)
    return numbers, total
