# SPDX-License-Identifier: BSD-3-Clause
"""Remarks on the agreement of a run's angles with the `&observed` group of the site."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

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

#: Angles (boulders,) [degree] by key of `&observed`; NaN if unknown.
ANGLES: dict[str, Callable[[Variables], np.ndarray]] = {
    "energy_line_angle": mean_slopes,
    "shadow_angle": lambda values: np.asarray(values["shadow_angle"]),
}
FARTHEST = 0.01  # fraction of boulders with the lowest angles
MIN_BOULDERS = 1000  # minimum boulders; the fraction is then ten of them
NEEDED = "source", "start_x", "start_y", "status"
LOWEST = -90.0  # [degree] lower bound of any angle


def angle_remarks(values: Variables, case: Case) -> Iterator[Remark]:
    """Remarks on the 1 % quantile of the energy-line and shadow angles, compared with the lowest
    observed angle: a warning if its interval does not contain the observed angle. Boulders that
    ended while moving count with the angle of their end for the upper limit, and with the lowest
    possible angle for the lower limit. Boulders without an angle do not count, and cause a warning.
    No comparison with fewer than `MIN_BOULDERS`."""
    for key, angles_of in ANGLES.items():
        observed = case.observed.get(key)
        if observed is not None and "start_x" in values:
            yield from _remarks(key, observed, angles_of(values), values, case)


def _remarks(
    key: str, observed: float, angles: np.ndarray, values: Variables, case: Case
) -> Iterator[Remark]:
    given = ~np.isnan(angles)
    if not given.all():
        part = part_of_boulders(int((~given).sum()), given.size)
        yield Remark(say("model.angle_unknown", part=part), True)
    if given.sum() < MIN_BOULDERS:
        return
    own = {name: np.asarray(values[name])[given] for name in NEEDED}
    angles, source = angles[given], sources_of(own, case.release["sources"] == "sample")
    moving = ended_moving(own)
    angle, low, high = quantile(angles, FARTHEST, source)
    _, open_low, _ = quantile(np.where(moving, LOWEST, angles), FARTHEST, source)
    left = part_of_boulders(int(moving.sum()), moving.size)
    shown: dict[str, Any] = {"observed": observed, "angle_of": say(f"model.{key}")}
    if open_low <= observed < low:
        yield Remark(say("model.angle_open", part=left, **shown), True)
        return
    verdict = "flatter" if high < observed else "steeper" if low > observed else "as_observed"
    is_warning = verdict != "as_observed"
    shown |= {"part": percent(FARTHEST), "angle": angle}
    yield Remark(say(f"model.angle_{verdict}", **shown), is_warning)
    if moving.any():
        yield Remark(say("model.angle_left", part=left), is_warning)
