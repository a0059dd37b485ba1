# SPDX-License-Identifier: BSD-3-Clause
"""Limits to the validity of a result on its slope: a sentence with numbers for each."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pandas as pd
import xarray as xr

from rockfall.analysis.validity.remarks import model_remarks
from rockfall.case import Case, case_of
from rockfall.grounds import BLOCK_TABLE, TABLES
from rockfall.language import say, say_count, word
from rockfall.quantities import percent
from rockfall.result.grounds import rebounds_by_ground, sets_followed
from rockfall.result.samples import is_ensemble, simulated
from rockfall.result.trajectories import ended, gone
from rockfall.tables.lines import Rows

FEW = 100  # with fewer boulders at a line, its upper quantiles are uncertain
FEW_LINES = 3  # maximum number of lines with a caution of their own
FEW_IN_CELL = 30  # with fewer boulders in a cell, Monte Carlo error dominates
SHIPPED = {  # impact sets described in docs/impact_sets.md
    "laboratory-spheres": "validity.the_rebound_comes_from_simulated_impacts",
    "bourrier2009": "validity.the_rebound_was_fitted_to_simulations",
    "vaujany-observed": "validity.the_rebound_was_fitted",
}
OWN = "validity.the_impact_set_is_the_users"
AS_GIVEN = "validity.terrain_ground_sources_and_volumes_are"
NOT_DRAWN = "validity.not_drawn"  # message for an ensemble
ABSENT = {  # message by the missing group of the case
    "forest": "validity.the_case_has_no_trees",
    "barrier": "validity.the_case_has_no_nets_or",
    "dam": "validity.the_case_has_no_dams",
}
FOREST = "validity.stems_are_vertical_and_as_thick"
FOREST_AND_LOGS = "validity.stems_and_logs"
BARRIER = "validity.a_barrier_takes_as_much_at"
BREAKS = {  # value of &breakage at -> message
    "none": "validity.whole",
    "release": "validity.whole_after_release",
    "impact": "validity.whole_at_release",
}


def warnings(result: xr.Dataset) -> list[str]:
    """The most important warnings: missing boulders first, then model warnings by grade."""
    return [
        *missing(result),
        *(
            say("join.colon", before=word(remark.grade).capitalize(), after=f"{remark.text}.")
            for remark in model_remarks(result, case_of(result))
            if remark.is_warning
        ),
    ]


def cautions(result: xr.Dataset, rows: Rows, levels: pd.DataFrame) -> list[str]:
    """Limits to validity, ordered by importance for a decision: unobserved events, conditions at
    the edge of the model, assumed inputs, processes not modelled."""
    return [
        *_few(rows),
        *_ended(result),
        *(
            f"{remark.text}."
            for remark in model_remarks(result, case_of(result))
            if not remark.is_warning
        ),
        say(NOT_DRAWN if is_ensemble(result) else AS_GIVEN),
        *dict.fromkeys(say(SHIPPED.get(name, OWN)) for name in sets_of(result)),
        *_left_out(case_of(result)),
        *_boulder(result, case_of(result)),
        *_extremes(rows, levels),
        *_of_cells(result),
    ]


def sets_of(result: xr.Dataset) -> list[str]:
    """Names of the impact sets used for rebounds of the run."""
    return sets_followed(result, str(result.attrs["impact_set"]))


def missing(result: xr.Dataset) -> Iterator[str]:
    """Warnings on boulders that a result lacks."""
    boulders, requested = simulated(result), int(result.attrs["boulders_requested"])
    if not result.attrs["complete"]:
        attrs = {"requested": requested, "fraction": percent(1 - boulders / requested)}
        yield say("validity.interrupted", boulders=boulders, **attrs)
        if requested > case_of(result).case.get("boulders", 1):
            yield say("validity.sources_are_run_one_after_the")


def _few(rows: Rows) -> Iterator[str]:
    """Caution on lines crossed by few boulders."""
    passed = {line: int(numbers["speed"]["n"]) for line, numbers in rows.items()}
    few = {line: n for line, n in passed.items() if n < FEW}
    if len(few) > FEW_LINES:
        none = list(few.values()).count(0)
        yield say("validity.few_at_lines", part=len(few), n=len(rows), few=FEW, none=none)
        return
    for line, n in few.items():
        if n:
            yield say_count("validity.few_at_line", n, line=line, few=FEW)
        else:
            yield say("validity.none_at_line", line=line, n=n, few=FEW)


def _ended(result: xr.Dataset) -> Iterator[str]:
    """Cautions: a single boulder, and boulders that left the terrain or reached the impact
    limit."""
    boulders, limit = simulated(result), ended(result)["impact_limit"]
    if boulders == 1:
        yield say("validity.one_boulder")
    if left := gone(result):
        fraction = percent(left / boulders)
        yield say_count("validity.left_terrain", boulders, left=left, fraction=fraction)
    if limit:
        fraction = percent(limit / boulders)
        yield say_count("validity.impact_limit", boulders, limit=limit, fraction=fraction)


def _left_out(case: Case) -> Iterator[str]:
    """Caution on processes that the model of this case omits or simplifies."""
    yield from (say(key) for group, key in ABSENT.items() if not has(case, group))
    if has(case, "forest"):
        has_logs = any("diameter" in barrier for barrier in case.barrier)
        yield say(FOREST_AND_LOGS if has_logs else FOREST)
    yield from [say(BARRIER)] if has(case, "barrier") else []


def _boulder(result: xr.Dataset, case: Case) -> Iterator[str]:
    """Caution on the shape, sliding and breaking of boulders in this run."""
    followed = {ground.model for ground in rebounds_by_ground(result) if ground.rebounds}
    if case.boulder["volume"] == "source":
        yield say("validity.shapes_of_sources")
    elif BLOCK_TABLE not in followed:
        yield say("validity.spheres")
    if BLOCK_TABLE in followed:
        yield say("validity.blocks_of_tables")
    if not followed.intersection(TABLES):
        yield say("validity.no_sliding")
    elif followed.difference(TABLES):
        yield say("validity.slide_by_tables")
    if key := BREAKS.get(case.breakage["at"]):
        yield say(key)
    yield say("validity.alone")


def has(case: Case, group: str) -> bool:
    """Return True if a case has trees (&forest keys may be defaults), or a group of this name."""
    return case.has_forest if group == "forest" else bool(getattr(case, group))


def _extremes(rows: Rows, levels: pd.DataFrame) -> Iterator[str]:
    """Caution on the reliability of maxima and return levels."""
    if not any(numbers["speed"]["n"] for numbers in rows.values()):
        return
    yield say("validity.maxima_grow_with_the_number_of")
    wanted = levels.filter(regex="^level_[0-9]+$")[levels["n"] > 0]
    if given := wanted.size - int(wanted.isna().to_numpy().sum()):
        yield say("validity.return_levels", given=given, size=wanted.size)


def _of_cells(result: xr.Dataset) -> Iterator[str]:
    """Caution on cells with few passing boulders, where Monte Carlo error dominates."""
    if "passages" in result:
        passed = result["passages"].values
    elif "reach_probability" in result:
        passed = np.rint(result["reach_probability"].values * simulated(result))
    else:
        return
    reached, few = int((passed > 0).sum()), int(((passed > 0) & (passed < FEW_IN_CELL)).sum())
    if few:
        attrs = {"fraction": percent(few / reached), "few_in_cell": FEW_IN_CELL}
        yield say_count("validity.few_in_cells", reached, part=few, **attrs)
