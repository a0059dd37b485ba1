# SPDX-License-Identifier: BSD-3-Clause
"""Rebounds and boulders outside the range of observations or fits."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rockfall.analysis.observed.run_out import mean_slopes
from rockfall.analysis.validity.remark import sum_of
from rockfall.grounds import IMPACT_SETS, RATIO_TABLE
from rockfall.grounds.impact_tables import open_table, shipped_tables
from rockfall.language import Text, say
from rockfall.quantities import part_of_boulders, part_of_rebounds
from rockfall.result.grounds import (
    rebounds_by_ground,
    sets_followed,
    stochastic_fraction,
    table_grounds,
)

if TYPE_CHECKING:
    from rockfall.analysis.validity.remark import Variables

MAX_OUTSIDE = 0.2  # above this fraction of the rebounds, the remark is a warning
MAX_FAST = 0.05  # above this fraction of the boulders, the remark is a warning
#: Upper envelope of observed maximum speeds [m/s] per degree of mean slope (Dorren 2015,
#: Rockyfor3D revealed, ecorisQ, with 0.64 to 0.8).
SPEED_PER_DEGREE = 0.8
#: Impact sets fitted beyond their largest R_b/R_m (5): half of the rebounds were above 5.5.
FITTED_BEYOND = "vaujany-observed", "bourrier2009"
OUTSIDE = {  # message for each count in a result
    "range": "model.outside_range",
    "speed": "model.outside_speed",
    "angle": "model.outside_angle",
}


class Extrapolation(NamedTuple):
    """A fraction of the rebounds or boulders as text, and whether it is a warning."""

    fraction: float
    text: Text
    is_warning: bool


def fractions_outside(values: Variables) -> dict[str, float]:
    """Fractions of the rebounds from impact sets or tables that are outside the fitted ranges of
    R_b/R_m, speed and angle; `values` as for `extrapolations`."""
    rebounds = max(1.0, _stochastic(values))
    return {what: sum_of(values, f"rebounds_out_of_{what}") / rebounds for what in OUTSIDE}


def extrapolations(values: Variables, case_set: str = "") -> Iterator[Extrapolation]:
    """Extrapolations, from variables (by name) of a result or of boulders. Counts may be totals or
    per boulder. `case_set` is the name of the case's impact sets."""
    rebounds = round(_stochastic(values))
    for what, fraction in fractions_outside(values).items():
        if fraction:
            part = part_of_rebounds(round(fraction * rebounds), rebounds)
            key = OUTSIDE[what]
            numbers: dict[str, Any] = {}
            if what == "range":
                key, numbers = _outside_ratios(values, case_set)
            is_warning = fraction > MAX_OUTSIDE and key != "model.outside_fitted"
            if what == "speed" and table_grounds(values):
                by_sets = any(
                    ground.rebounds and ground.model == IMPACT_SETS
                    for ground in rebounds_by_ground(values)
                )
                key = "model.outside_speed_both" if by_sets else "model.outside_thrown"
                # A single fast impact, such as after a fall, may determine the path.
                is_warning |= fraction * rebounds > MAX_OUTSIDE * np.size(values["speed_max"])
            text = say(key, part=part, **numbers)
            yield Extrapolation(fraction, text, is_warning)
    is_fast = faster_than_observed(values)
    if (fast := int(is_fast.sum())) > MAX_FAST * is_fast.size:
        part = part_of_boulders(fast, is_fast.size)
        text = say("model.faster", part=part, limit=SPEED_PER_DEGREE)
        yield Extrapolation(fast / is_fast.size, text, True)


def _outside_ratios(values: Variables, case_set: str) -> tuple[str, dict[str, Any]]:
    """Message, with its values, on rebounds outside the size ratios of impact sets or tables; for a
    shipped table, with the limits of its ratios."""
    followed = [ground for ground in rebounds_by_ground(values) if ground.rebounds]
    tables = [ground.name for ground in followed if ground.model == RATIO_TABLE]
    if not tables:
        of_fit = all(name.startswith(FITTED_BEYOND) for name in sets_followed(values, case_set))
        return "model.outside_fitted" if of_fit else OUTSIDE["range"], {}
    if any(ground.model == IMPACT_SETS for ground in followed):
        return "model.outside_both", {}
    if len(tables) > 1 or tables[0] not in shipped_tables():
        return "model.outside_tables", {}
    ratios = open_table(shipped_tables()[tables[0]]).size
    return "model.outside_table", {"name": tables[0], "low": ratios[0], "high": ratios[-1]}


def faster_than_observed(values: Variables) -> np.ndarray:
    """Mask (boulders,) of boulders that exceeded the envelope of observed speeds.

    The mean slope is that of the straight line from release to end. Boulders that did not end
    lower do not count.
    """
    slope = mean_slopes(values)
    return (slope > 0) & (np.asarray(values["speed_max"]) > SPEED_PER_DEGREE * slope)


def _stochastic(values: Variables) -> float:
    """Number of rebounds from impact sets or impact tables."""
    return stochastic_fraction(values) * sum_of(values, "rebounds")
