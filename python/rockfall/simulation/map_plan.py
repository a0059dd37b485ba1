# SPDX-License-Identifier: BSD-3-Clause
"""Plan of a run's maps: the layers that a case needs in the kernel's stacks."""

from functools import lru_cache
from typing import NamedTuple

from rockfall._core import rockfall_f2py as _core
from rockfall.case import Case
from rockfall.result.variables import EXCEEDED

HITS = "tree_impacts"  # counts stored with the sums, because of their larger range


class Plan(NamedTuple):
    """Tallies needed for the maps of a case. A value is the layer number in its stack, from 1; 0
    means not needed."""

    #: Layers of passages, deposits, sources, released (boulders from these sources) and hits; first
    #: threshold layers of energy_exceeded and hits_energy_exceeded.
    counts: dict[str, int]
    sums: dict[str, int]  # sums of the quantities below; layers with their squares follow
    maxima: dict[str, int]
    bins: int  # counting bins for quantiles
    layers: dict[str, int]  # number of layers in each stack (counts, sums, maxima)


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


def tells_sources(case: Case) -> bool:
    """Return True if a map requires the source of each boulder."""
    plan = plan_of(case).counts
    return bool(plan["sources"] or plan["released"])
