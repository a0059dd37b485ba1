# SPDX-License-Identifier: BSD-3-Clause
"""Remarks on the validity of a run's model: rebounds and their reliability, the unvalidated forest
model, conditions outside the data, and boulders whose ends are not representative of the slope.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from rockfall.analysis.validity.ends import end_remarks, roll_remarks
from rockfall.analysis.validity.extrapolation import extrapolations
from rockfall.analysis.validity.obstacles import breakage_remarks, forest_remarks, log_remarks
from rockfall.analysis.validity.rebounds import rebound_remarks, set_remarks, table_remarks
from rockfall.analysis.validity.remark import GRADES, Remark
from rockfall.analysis.validity.site import angle_remarks
from rockfall.language import Text
from rockfall.result.crossings import kept_of

if TYPE_CHECKING:
    from rockfall.analysis.validity.remark import Variables
    from rockfall.case import Case


def model_remarks(values: Variables, case: Case) -> list[Remark]:
    """All remarks on the model, each once and ordered by grade, from the case and from variables
    (by name) of a result or of boulders."""
    kept = kept_of(values)
    if "remarks" not in kept:
        columns = getattr(values, "variables", values)  # faster than through the Dataset
        remarks = dict.fromkeys(_found(columns, case))
        kept["remarks"] = sorted(remarks, key=lambda remark: GRADES.index(remark.grade))
    return [*kept["remarks"]]


def _found(values: Variables, case: Case) -> Iterator[Remark]:
    yield from end_remarks(values, case)
    yield from rebound_remarks(values, case)
    yield from set_remarks(values, case)
    yield from table_remarks(values)
    yield from forest_remarks(values, case)
    yield from log_remarks(case)
    yield from breakage_remarks(values, case)
    yield from roll_remarks(values, case)
    yield from angle_remarks(values, case)
    yield from (
        Remark(extrapolation.text, extrapolation.is_warning)
        for extrapolation in extrapolations(values, case.impact["sets"])
    )


def model_warnings(values: Variables, case: Case) -> list[Text]:
    """Remarks on the model that are warnings."""
    return [remark.text for remark in model_remarks(values, case) if remark.is_warning]
