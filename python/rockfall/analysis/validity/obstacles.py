# SPDX-License-Identifier: BSD-3-Clause
"""Remarks on forest, lying logs and breakage, for which the models are not validated."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from rockfall.analysis.validity.remark import Remark
from rockfall.evidence import only
from rockfall.language import Text, say
from rockfall.quantities import part_of_boulders, percent
from rockfall.result.crossings import line_names, stored_at
from rockfall.result.grounds import table_grounds

if TYPE_CHECKING:
    from rockfall.analysis.validity.remark import Variables
    from rockfall.case import Case

MAX_FINES = 0.01  # above this fraction of the volume, the remark is a warning


def forest_remarks(values: Variables, case: Case) -> Iterator[Remark]:
    """Remark that the forest model is not validated, with the results of the forest experiment (by
    impact tables if most rebounds used tables, else by the default impact set); none without
    trees."""
    if case.has_forest:
        by_table = sum(ground.fraction for ground in table_grounds(values)) > 0.5
        by_table = by_table or case.impact["form"] == "table"
        model = "talus" if by_table else "vaujany-observed"
        yield Remark(forest_text(model), True, is_counted=False)


def forest_text(model: str = "vaujany-observed") -> Text:
    """Text on a model in the forest experiment (cases/vaujany-forest): too many boulders pass."""
    bare, forest = (only("vaujany-forest", state, "passing", model) for state in ("bare", "forest"))
    return say(
        "model.forest",
        model=model,
        bare=bare.observed,
        forest=forest.observed,
        bare_here=round(bare.simulated),
        forest_here=round(forest.simulated),
    )


def log_remarks(case: Case) -> Iterator[Remark]:
    """Remark that the capacities of lying logs are unconfirmed; none without logs."""
    if any("diameter" in barrier for barrier in case.barrier):
        yield Remark(say("model.logs"), True, is_counted=False)


def breakage_remarks(values: Variables, case: Case) -> Iterator[Remark]:
    """Remarks on breakage: the rule is not validated, statistics count certain fragments, and
    fragments of some boulders were limited or lost as fines; empty if boulders do not break."""
    if case.breakage["at"] == "none":
        return
    yield Remark(say("model.breakage"), True, is_counted=False)
    if "fragments" not in values:
        return
    names = ("fragments", "breakages", "breakages_capped", "fines_volume", "volume")
    fragments, breakages, capped, fines, volume = (np.asarray(values[name]) for name in names)
    broke = breakages > 0
    if broke.any():
        text = say(
            "model.broke",
            part=part_of_boulders(int(broke.sum()), broke.size),
            mean=fragments[broke].mean(),
            most=fragments.max(),
        )
        at_lines = [*_fragments_at_lines(values)]
        yield Remark(say("model.several", parts=[text, *at_lines]) if at_lines else text, True)
    if (reached := int((capped > 0).sum())) > 0:
        part = part_of_boulders(reached, capped.size)
        most = case.breakage["max_fragments"]
        yield Remark(say("model.max_fragments", part=part, most=most), True)
    if (fraction := float(fines.sum() / volume.sum())) > MAX_FINES:
        least = case.breakage["min_volume"]
        yield Remark(say("model.fines", fraction=percent(fraction), least=least), True)


def _fragments_at_lines(values: Variables) -> Iterator[Text]:
    """Mean number of fragments at each line, over boulders that cross the line."""
    if not all(name in values for name in ("crossing_fragments", "line_name", "row_size")):
        return
    for k, name in enumerate(line_names(values)):
        if (counts := stored_at(values, "fragments", k)).size:
            yield say("model.fragments", line=name, mean=counts.mean())
