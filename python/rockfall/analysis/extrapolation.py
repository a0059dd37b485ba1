# SPDX-License-Identifier: BSD-3-Clause
"""Where a run leaves what its model was made from: rebounds outside what impact sets were fitted
on, and boulders faster than any that were observed.

`rockfall check` says it of its pilot run, the summary and the report of a result.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rockfall.quantities import part_of
from rockfall.result.grounds import stochastic_fraction

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from rockfall.result.contents import Held

    Variables = Held | Mapping[str, ArrayLike]

MAX_OUTSIDE = 0.2  # of the rebounds, before it is a warning
MAX_FAST = 0.05  # of the boulders
#: Upper envelope of observed maximum speeds [m/s] per degree of the mean slope (Dorren 2015,
#: Rockyfor3D revealed, ecorisQ; it uses 0.64 to 0.8).
SPEED_PER_DEGREE = 0.8
OUTSIDE = {
    "range": "had R_b/R_m outside 0.5 to 5.5, where the set is not calibrated: the nearest ratio "
    "stood in",
    "speed": "were slower or faster than those that the set was fitted on (speed_range)",
    "angle": "were flatter or steeper than those that the set was fitted on (angle_range)",
}


class Extrapolation(NamedTuple):
    """A fraction of the rebounds or boulders, in words, and whether it is a warning."""

    fraction: float
    text: str
    is_warning: bool


def fractions_outside(values: Variables) -> dict[str, float]:
    """Fractions of the rebounds by impact sets outside what these were fitted on: by range (of
    R_b/R_m), speed and angle; `values` as for `extrapolations`."""
    rebounds = max(1.0, _stochastic(values))
    return {what: _total(values, f"rebounds_out_of_{what}") / rebounds for what in OUTSIDE}


def extrapolations(values: Variables) -> Iterator[Extrapolation]:
    """What there is of them in the variables of a result, or of boulders by name.

    Counts may be sums, or of each boulder.
    """
    rebounds = round(_stochastic(values))
    for what, fraction in fractions_outside(values).items():
        if fraction:
            said = part_of(round(fraction * rebounds), rebounds, "rebound")
            yield Extrapolation(fraction, f"{said} {OUTSIDE[what]}", fraction > MAX_OUTSIDE)
    is_fast = faster_than_observed(values)
    if (fast := int(is_fast.sum())) > MAX_FAST * is_fast.size:
        said = (
            f"{part_of(fast, is_fast.size, 'boulder')} exceeded {SPEED_PER_DEGREE} m/s "
            "per degree of the mean slope of their path, the upper limit of what has been observed "
            "(Dorren 2015): the bounce has no terminal velocity"
        )
        yield Extrapolation(fast / is_fast.size, said, True)


def faster_than_observed(values: Variables) -> np.ndarray:
    """Which boulders exceeded the envelope of observed speeds, (boulders,).

    The mean slope is that of the straight line from the release to the end; a boulder that ended no
    lower has none, and is not counted.
    """
    names = ("start_z", "stop_z", "plan_distance", "speed_max")
    start, stop, distance, speed = (np.asarray(values[name]) for name in names)
    slope = np.degrees(np.arctan2(start - stop, distance))
    return (slope > 0) & (speed > SPEED_PER_DEGREE * slope)


def _stochastic(values: Variables) -> float:
    """Rebounds by impact sets."""
    return stochastic_fraction(values) * _total(values, "rebounds")


def _total(values: Variables, name: str) -> int:
    return int(np.asarray(values[name]).sum(dtype="i8"))
