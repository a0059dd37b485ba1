# SPDX-License-Identifier: BSD-3-Clause
"""Remarks on whether a run agrees with `&observed` of its site."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from rockfall.analysis.observed.run_out import falls_and_distances
from rockfall.analysis.precision.intervals import between_ranks
from rockfall.analysis.validity.remark import Remark
from rockfall.language import say
from rockfall.quantities import percent

if TYPE_CHECKING:
    from rockfall.analysis.validity.remark import Variables
    from rockfall.case import Case

FARTHEST = 0.01  # fraction of the boulders that comes to the lowest energy-line angles
MIN_BOULDERS = 1000  # then the fraction is ten


def angle_remarks(values: Variables, case: Case) -> Iterator[Remark]:
    """Remark on the energy-line angle that 1 % of the boulders come below, compared with the lowest
    observed angle: a warning if its interval does not contain the observed angle."""
    observed = case.observed.get("energy_line_angle")
    if observed is None or "start_x" not in values or np.size(values["start_x"]) < MIN_BOULDERS:
        return
    fall, distance = falls_and_distances(values)
    angles = np.sort(np.degrees(np.arctan2(fall, distance)))
    low, high = between_ranks(angles, FARTHEST, float(angles.size))
    key = "flatter" if high < observed else "steeper" if low > observed else "as_observed"
    angle = float(np.quantile(angles, FARTHEST))
    text = say(f"model.angle_{key}", part=percent(FARTHEST), angle=angle, observed=observed)
    yield Remark(text, key != "as_observed")
