# SPDX-License-Identifier: BSD-3-Clause
"""Remarks on whether a run agrees with the site's `&observed`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from rockfall.analysis.observed.run_out import mean_slopes
from rockfall.analysis.precision.intervals import quantile, sources_of
from rockfall.analysis.validity.remark import Remark
from rockfall.language import say
from rockfall.quantities import part_of_boulders, percent
from rockfall.result.trajectories import ended_moving

if TYPE_CHECKING:
    from rockfall.analysis.validity.remark import Variables
    from rockfall.case import Case

FARTHEST = 0.01  # fraction of boulders with the lowest energy-line angles
MIN_BOULDERS = 1000  # minimum number, so that the fraction has ten boulders
LOWEST = -90.0  # [degree] lower bound of any energy line


def angle_remarks(values: Variables, case: Case) -> Iterator[Remark]:
    """Remarks on the energy-line angle of the 1 % farthest boulders, compared with the lowest
    observed angle: a warning if its interval, by sources, does not contain the observed angle.
    Boulders that left the terrain count with the angle of their exit for the upper limit, and with
    the lowest possible angle for the lower limit."""
    observed = case.observed.get("energy_line_angle")
    if observed is None or "start_x" not in values or np.size(values["start_x"]) < MIN_BOULDERS:
        return
    angles, source = mean_slopes(values), sources_of(values, case.release["sources"] == "sample")
    moving = ended_moving(values)
    angle, low, high = quantile(angles, FARTHEST, source)
    _, open_low, _ = quantile(np.where(moving, LOWEST, angles), FARTHEST, source)
    left, shown = part_of_boulders(int(moving.sum()), moving.size), {"observed": observed}
    if open_low <= observed < low:
        yield Remark(say("model.angle_open", part=left, **shown), True)
        return
    key = "flatter" if high < observed else "steeper" if low > observed else "as_observed"
    is_warning = key != "as_observed"
    shown |= {"part": percent(FARTHEST), "angle": angle}
    yield Remark(say(f"model.angle_{key}", **shown), is_warning)
    if moving.any():
        yield Remark(say("model.angle_left", part=left), is_warning)
