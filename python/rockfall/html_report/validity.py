# SPDX-License-Identifier: BSD-3-Clause
"""Limits to the validity of a result on its slope, each in a sentence with its numbers."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from rockfall.analysis.model_limits import model_remarks
from rockfall.case import case_of
from rockfall.quantities import count, part_of, percent
from rockfall.result.grounds import sets_followed
from rockfall.result.samples import simulated
from rockfall.result.trajectories import ended, gone

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from rockfall.case import Case
    from rockfall.html_report.intervals import Rows

FEW = 100  # boulders at a line, below which its upper quantiles are uncertain
FEW_IN_CELL = 30  # boulders through a cell, below which its numbers are mostly Monte Carlo error
SHIPPED = {  # impact sets: docs/validation/lab.md
    "rocky-slope": "The rebound comes from simulated impacts of spheres on layers of spheres; it "
    "was not calibrated on this slope.",
}
OWN = "The impact set is the user's own: what it was calibrated on is not known here."
AS_GIVEN = (
    "Terrain, ground, sources and volumes are taken as given. Where a bounce loses about what the "
    "next flight gains, small changes of slope or ground change the run-out much."
)
ABSENT = {  # by the group of the case that would add it
    "forest": "The case has no trees.",
    "barrier": "The case has no nets or walls.",
    "dam": "The case has no dams.",
}
BOULDER = (
    "A boulder is a sphere that does not break or slide, meets no other boulder, and leaves the "
    "ground as it was."
)
FOREST = (
    "Stems are vertical and as thick as at breast height. Crowns, lying stems, undergrowth and "
    "roots are not modelled, and later boulders find every tree as it was."
)
BARRIER = (
    "A barrier takes as much at its edge as in its middle, has no posts and no gap below, and is "
    "whole for each boulder."
)


def warnings(result: xr.Dataset) -> list[str]:
    """Most important warnings: missing boulders, and large parts of a run outside the data of its
    model."""
    return [
        *_missing(result),
        *(f"{one.text}." for one in model_remarks(result, case_of(result)) if one.is_warning),
    ]


def cautions(result: xr.Dataset, rows: Rows, levels: pd.DataFrame) -> list[str]:
    """Limits to validity, in the order of their importance for a decision: unobserved events,
    conditions at the edge of the model, assumed inputs, processes not modelled."""
    return [
        *_few(rows),
        *_ended(result),
        *(f"{one.text}." for one in model_remarks(result, case_of(result)) if not one.is_warning),
        AS_GIVEN,
        *dict.fromkeys(SHIPPED.get(name, OWN) for name in sets_of(result)),
        *_left_out(case_of(result)),
        *_extremes(rows, levels),
        *_of_cells(result),
    ]


def sets_of(result: xr.Dataset) -> list[str]:
    """Names of the impact sets that made rebounds of the run."""
    return sets_followed(result, str(result.attrs["impact_set"]))


def _missing(result: xr.Dataset) -> Iterator[str]:
    boulders, requested = simulated(result), int(result.attrs["boulders_requested"])
    if not result.attrs["complete"]:
        yield (
            f"The run was interrupted after {boulders:,} of {count(requested, 'boulder')}; "
            f"{percent(1 - boulders / requested)} are missing. All numbers are of those done."
        )
        if requested > case_of(result).case.get("boulders", 1):
            yield "Sources are run one after the other: the last ones are missing."


def _few(rows: Rows) -> Iterator[str]:
    """Lines crossed by few boulders."""
    for line, numbers in rows.items():
        if (n := int(numbers["speed"]["n"])) < FEW:
            unknown = "high quantiles there are hardly known" if n else "no speed there is known"
            yield f"{line}: {count(n, 'boulder')} passed, fewer than {FEW}: {unknown}."


def _ended(result: xr.Dataset) -> Iterator[str]:
    """Boulders that left the terrain or were stopped by a limit."""
    boulders, limit = simulated(result), ended(result)["impact_limit"]
    if boulders == 1:
        yield "1 boulder is an example. Fractions and quantiles need at least some hundred."
    if left := gone(result):
        text = "left the terrain model: their trajectory beyond it is not known and not counted."
        yield f"{part_of(left, boulders, 'boulder')} {text}"
    if limit:
        text = "reached the limit of contacts while moving: where they come to rest is not known."
        yield f"{part_of(limit, boulders, 'boulder')} {text}"


def _left_out(case: Case) -> Iterator[str]:
    """Processes that the model of this case omits or simplifies."""
    yield from (text for group, text in ABSENT.items() if not has(case, group))
    yield from [FOREST] if has(case, "forest") else []
    yield from [BARRIER] if has(case, "barrier") else []
    yield BOULDER


def has(case: Case, group: str) -> bool:
    """Return True if a case has trees (some keys of &forest have defaults), or a repeated group."""
    given = getattr(case, group)
    if group != "forest":
        return bool(given)
    return any(given.get(key) is not None for key in ("trees", "stems", "uniform_stems"))


def _extremes(rows: Rows, levels: pd.DataFrame) -> Iterator[str]:
    """Reliability of maxima and return levels."""
    if not any(numbers["speed"]["n"] for numbers in rows.values()):
        return
    yield "Maxima grow with the number of boulders: they are no bounds."
    wanted = levels.filter(regex="^level_[0-9]+$")[levels["n"] > 0]
    if given := wanted.size - int(wanted.isna().to_numpy().sum()):
        text = "given. They extrapolate the tail, which has no physical limit."
        yield f"Return levels: {given} of {wanted.size} are {text}"


def _of_cells(result: xr.Dataset) -> Iterator[str]:
    """Cells that too few boulders passed, where the Monte Carlo error dominates."""
    if "passages" in result:
        passed = result["passages"].values
    elif "reach_probability" in result:
        passed = np.rint(result["reach_probability"].values * simulated(result))
    else:
        return
    reached, few = int((passed > 0).sum()), int(((passed > 0) & (passed < FEW_IN_CELL)).sum())
    if few:
        text = f"saw fewer than {FEW_IN_CELL} boulders: mostly Monte Carlo error."
        yield f"{part_of(few, reached, 'reached cell')} {text}"
