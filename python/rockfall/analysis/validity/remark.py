# SPDX-License-Identifier: BSD-3-Clause
"""A remark on the validity of a run's model, and sums of counts over boulders."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rockfall.language import Text

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from rockfall.result.contents import Held

    Variables = Held | Mapping[str, ArrayLike]

GRADES = ("stop", "caution", "note")  # grades in display order
#: Messages about results that are wrong until the cause is removed, including places off terrain.
STOPS = {"model.cut_short", "model.impact_limit", "model.lost", "model.max_fragments",
         "input.line_beyond", "input.objects_beyond", "input.segments_beyond"}  # fmt: skip


class Remark(NamedTuple):
    """A remark on the validity of a run's model."""

    text: Text
    is_warning: bool
    is_counted: bool = True  # True if it counts boulders of the run

    @property
    def grade(self) -> str:
        """`stop` for wrong results, `caution` for other warnings, else `note`."""
        if not self.is_warning:
            return "note"
        return "stop" if self.text.key in STOPS else "caution"


def sum_of(values: Variables, name: str) -> int:
    """Sum of a count over the boulders."""
    return int(np.asarray(values[name]).sum(dtype="i8"))
