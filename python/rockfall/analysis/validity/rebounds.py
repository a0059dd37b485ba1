# SPDX-License-Identifier: BSD-3-Clause
"""Remarks on the rebound models of a run and their reliability."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

import numpy as np

from rockfall.analysis.validity.remark import Remark, sum_of
from rockfall.evidence import error_range, evidence, largest_error
from rockfall.grounds import other_tables
from rockfall.grounds.impact_sets import shipped_sets
from rockfall.language import Text, say, word
from rockfall.quantities import part_of_boulders, part_of_rebounds, percent
from rockfall.result.grounds import (
    classical_grounds,
    rebounds_by_ground,
    sets_followed,
    table_grounds,
)

if TYPE_CHECKING:
    from rockfall.analysis.validity.remark import Variables
    from rockfall.case import Case
    from rockfall.result.grounds import GroundRebounds

#: Ratio of R_b to the largest simulated blocks of a table, above which a block is large.
LARGE_BLOCK = 1.25
MAX_LARGE = 0.2  # above this fraction of large boulders, the remark is a warning
#: Messages on shipped sets, by name prefix (names of ensembles are longer).
SET_MESSAGES = {
    "laboratory-spheres": "model.spheres_set",
    "vaujany-observed": "model.observed_set",
    "bourrier2009": "model.paper_set",
}
JUDGED_TABLES = "talus", "meadow"  # grounds with impact tables that were compared with a site


def rebound_remarks(values: Variables, case: Case) -> Iterator[Remark]:
    """Remarks on classical rebound models and their coefficients; none without such grounds."""
    if not (grounds := classical_grounds(values)):
        return
    own = "model.own_coefficients" if has_own_grounds(case) else "model.quoted_coefficients"
    text = say(
        "model.classical",
        followed=_part_of_all(grounds, values),
        grounds=[*map(ground_part, grounds)],
        coefficients=say(own),
        understated=say("model.understated"),
    )
    yield Remark(text, True)


def ground_part(rebounds: GroundRebounds) -> Text:
    """Text with a ground, its model, and its fraction of the rebounds."""
    return say(
        "model.ground_part",
        name=rebounds.name,
        model=word(rebounds.model),
        fraction=percent(rebounds.fraction),
    )


def followed_text(values: Variables, case_set: str) -> str:
    """Text on the grounds on which boulders rebounded, with models and fractions, most frequent
    first; for a run without grounds, on the case's impact sets."""
    grounds = sorted(rebounds_by_ground(values), key=lambda ground: -ground.rebounds)
    if not grounds:
        return say("inputs.impact_sets", impact_set=case_set)
    made = [ground for ground in grounds if ground.rebounds]
    return say("model.several", parts=[*map(ground_part, made)]) if made else say("label.none")


def _part_of_all(grounds: Iterable[GroundRebounds], values: Variables) -> Text:
    """Rebounds on some grounds as a fraction of all rebounds."""
    rebounds = sum(ground.rebounds for ground in grounds)
    return part_of_rebounds(rebounds, max(1, sum_of(values, "rebounds_by_ground")))


def set_remarks(values: Variables, case: Case) -> Iterator[Remark]:
    """Remarks on the field validation of shipped impact sets that rebounds used."""
    names = set(sets_followed(values, case.impact["sets"])) & set(shipped_sets())
    total = sum_of(values, "rebounds")
    if not total:
        return
    for start, key in SET_MESSAGES.items():
        own = {name for name in names if name.startswith(start)}
        grounds = [ground for ground in rebounds_by_ground(values) if ground.name in own]
        if own and (grounds or own == names):
            part = _part_of_all(grounds, values) if grounds else part_of_rebounds(total, total)
            errors = _set_errors(start, case.surface["method"])
            text = say(key, followed=part, names=", ".join(sorted(own)), **errors)
            yield Remark(text, True)


def _set_errors(name: str, method: str) -> dict[str, int]:
    """Largest errors of mean values with a shipped impact set [%]: speeds and energies at Vaujany
    (by `method`, if the set was run with both methods), and run-out distances at Tschamut."""
    chosen = {
        "speed": evidence("vaujany", quantity="speed_mean", model=f"{name}*"),
        "energy": evidence("vaujany", quantity="energy_translational_mean", model=f"{name}*"),
        "run_out": evidence("tschamut", quantity="run_out_mean", model=name),
    }
    by_method = {
        what: [row for row in rows if row.model in {name, f"{name}, {method}"}]
        for what, rows in chosen.items()
    }
    return {what: largest_error(rows) for what, rows in by_method.items() if rows}


def table_remarks(values: Variables) -> Iterator[Remark]:
    """Remarks on the fraction of rebounds from impact tables, on their field validation, and on
    boulders much larger than the simulated blocks; none without tables."""
    if not (tables := table_grounds(values)):
        return
    names = [table.name for table in tables]
    sites = [*evidence("vaujany"), *evidence("tschamut", "held-out", "run_out_*")]
    judged = [row for row in sites if row.model in {*JUDGED_TABLES, *names}]
    tested = {row.model for row in judged}
    compared, untested = (
        ", ".join(name for name in names if (name in tested) == is_tested)
        for is_tested in (True, False)
    )
    grounds = [compared] * bool(compared)
    grounds += [say("model.untested", names=untested)] * bool(untested)
    means, deviations = (
        error_range(row for row in judged if row.quantity.endswith(statistic))
        for statistic in ("_mean", "_std")
    )
    text = say(
        "model.tables",
        drawn=_part_of_all(tables, values),
        grounds=grounds,
        mean_low=means[0],
        mean_high=means[1],
        std_low=deviations[0],
        std_high=deviations[1],
    )
    yield Remark(text, True)
    thrown = [table.block_radius for table in tables if not np.isnan(table.block_radius)]
    if thrown and "volume" in values:
        radius = LARGE_BLOCK * min(thrown)
        large = np.asarray(values["volume"]) > 4 / 3 * np.pi * radius**3
        if large.sum() > MAX_LARGE * large.size:
            part = part_of_boulders(int(large.sum()), large.size)
            yield Remark(say("model.large_blocks", part=part, radius=radius), True)


def has_own_grounds(case: Case) -> bool:
    """Return True if the grounds come from the user's table, not a shipped table."""
    own = case.surface.get("ground_table")
    return bool(own) and own not in other_tables()
