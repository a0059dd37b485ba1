# SPDX-License-Identifier: BSD-3-Clause
"""Maps in the making: the kernel's tallies by cell."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from rockfall._core import rockfall_f2py as _core
from rockfall.case import Case
from rockfall.io.grid import Box

MAX_ROWS = int(_core.constant("max_columns"))  # of class_counts, and one more can be counted
ALL = Box(0, 0, 2**31 - 1, 2**31 - 1)  # any cells
HITS = "tree_impacts"  # a map of counts; they are among the sums, which hold more
HALVINGS = int(_core.constant("halvings"))  # of these rows, before they are too few to begin with


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


@dataclass
class Maps:
    """The kernel's tallies by cell, in stacks (layers, ny, nx), where `plan` says; what the case
    does not ask for has a single element."""

    names: str  # of the maps, as the kernel wants them
    plan: Plan
    counts: np.ndarray
    sums: np.ndarray
    maxima: np.ndarray
    class_counts: np.ndarray  # (cells, classes): rows are given away as cells are reached
    column: np.ndarray  # (ny, nx): row of class_counts, from 1
    columns: np.ndarray  # (1,): rows given away; one more than there are when they did not do
    box: Box  # the cells of the terrain that they are of
    #: (1 or 2, ny, nx): the source that was last counted there boulder by boulder; `head` has the
    #: second layer to itself
    stamp: np.ndarray = field(default_factory=lambda: np.zeros((1, 1, 1), "i4"))
    head: int = 0

    def arguments(self) -> dict[str, np.ndarray]:
        """As the kernel wants them."""
        return {
            "map_counts": self.counts.T, "map_sums": self.sums.T,
            "map_reals": self.maxima.T, "class_counts": self.class_counts.T,
            "column": self.column.T, "columns": self.columns,
        }  # fmt: skip

    def run_arguments(self) -> dict[str, Any]:
        """What a run of the kernel wants besides: where they lie, and to tell sources apart."""
        return {"stamp": self.stamp.T, "head": self.head, "map_at": self.box.corners()["map_at"]}


def no_maps(case: Case, box: Box = ALL) -> Maps:
    """Empty tallies for the maps of a case, on these cells."""
    names = case.output.get("maps", [])
    shape, plan = box.shape if names else (1, 1), plan_of(case)

    def stack(name: str, dtype: str) -> np.ndarray:
        layers = plan.layers[name]
        return np.zeros((layers, *shape) if layers else (1, 1, 1), dtype)

    return Maps(
        " ".join(names), plan, stack("counts", "i4"), stack("sums", "i8"), stack("maxima", "f4"),
        class_counts=_class_counts(shape[0] * shape[1], plan.bins),
        column=np.zeros(shape if plan.bins else (1, 1), "i4"),
        columns=np.zeros(1, "i4"),
        box=box,
    )  # fmt: skip


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


def _class_counts(cells: int, classes: int) -> np.ndarray:
    """Rows for all cells, or for half as many as the system grants (the run needs memory for other
    things too): it takes the memory of a row when a boulder first passes the cell, and few may be
    passed."""
    if not classes:
        return np.empty((1, 1), "i4")
    rows = min(cells, MAX_ROWS)
    for k in range(HALVINGS + 1):
        try:
            np.empty((rows >> k, classes), "i4")  # is it granted?
        except MemoryError:
            continue
        return np.empty((rows >> k + (k > 0), classes), "i4")
    raise MemoryError
