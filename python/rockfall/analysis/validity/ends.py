# SPDX-License-Identifier: BSD-3-Clause
"""Remarks on boulders whose end or passage is not representative of the slope."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from rockfall.analysis.observed.run_out import falls_and_distances
from rockfall.analysis.validity.remark import Remark
from rockfall.grounds import repose
from rockfall.kernel_rules import fraction_limits
from rockfall.language import Text, say
from rockfall.quantities import first_of, part_of_boulders, percent
from rockfall.result.crossings import AtLine, has_crossed, line_names
from rockfall.result.grounds import rebounds_by_ground
from rockfall.result.trajectories import ended_moving
from rockfall.result.variables import STATUS
from rockfall.scene.rebounds.kernel_rebounds import sphere_radius

if TYPE_CHECKING:
    from rockfall.analysis.validity.remark import Variables
    from rockfall.case import Case

SLOW = 2.0  # [m/s] bouncing boulders pass a line faster
LOWEST_REST = 22.0  # [degree] lowest rest angle of the shipped grounds (soft soil)
MAX_SLOW = 0.1  # above this fraction of slow boulders, quantiles must not be used as design loads
MAX_CUT = 0.01  # above this fraction of boulders that end while moving, the remark is a warning
MAX_LOST = 0.1  # maximum boulders lost before a line, divided by its crossings
MAX_LINES = 5  # maximum lines in a warning
MAX_STAYED = 0.2  # maximum fraction of boulders that stay at their sources
STAYED = 10.0  # [m] boulders that end closer to the release (in 3-D) only rock in place


def roll_remarks(values: Variables, case: Case) -> Iterator[Remark]:
    """Remarks on lines where many passing boulders roll from rock to rock (theory, chapter 8),
    which lowers the design values. None if rows are not kept.

    A boulder rolls where the ground is steeper than the rest angle. The passing height of a boulder
    on the ground is R_b/cos(slope), which gives the slope there.
    """
    if not all(name in values for name in ("line_name", "row_size", "volume")):
        return
    lowest = LOWEST_REST if rebounds_by_ground(values) else repose()
    cosine = np.cos(np.radians(case.impact.get("rest_angle", lowest)))
    breaks = "crossing_volume" in values  # boulders break: each crossing has its own radius
    radii = np.zeros(0) if breaks else sphere_radius(np.asarray(values["volume"]))
    for k, name in enumerate(line_names(values)):
        at = AtLine(values, k)
        above = at.stored("passing_height") - at.stored("jump_height")
        radius = radii[at.boulders] if radii.size else sphere_radius(at.volumes)
        slow = sum(at.stored(f"velocity_{axis}") ** 2 for axis in "xyz") < SLOW**2
        rolls = (radius < above * cosine) & slow
        if rolls.size and (fraction := float(rolls.mean())) > MAX_SLOW:
            attrs = {"line": name, "fraction": percent(fraction), "slow": SLOW}
            yield Remark(say("model.rolling", **attrs), True)


def end_remarks(values: Variables, case: Case) -> Iterator[Remark]:
    """Remarks on released boulders that are not representative: they left the known terrain before
    a line, reached the impact limit, or stayed at their source. They make fractions and frequencies
    too low. If no rows are kept, a remark notes that their number is unknown."""
    if "status" not in values:
        return
    if not (status := np.asarray(values["status"])).size:
        yield Remark(say("model.not_kept"), True, is_counted=False)
        return
    is_gone = np.isin(status, [STATUS["left_domain"], STATUS["hit_nodata"]])
    is_moving = ended_moving(values)
    if is_gone.sum() > MAX_CUT * status.size:
        is_gone[is_gone] = _misses_line(values, case, is_gone)
    fall, distance = falls_and_distances(values)
    stayed = (status == STATUS["stopped"]) & (np.hypot(fall, distance) < STAYED)
    is_said = False  # True if a remark on all boulders makes remarks on lines superfluous
    for key, is_such, most in (
        ("model.cut_short", is_gone, MAX_CUT),
        ("model.impact_limit", status == STATUS["impact_limit"], MAX_CUT),
        ("model.stayed", stayed, MAX_STAYED),
    ):
        if (n := int(is_such.sum())) > most * status.size:
            part = part_of_boulders(n, status.size)
            yield Remark(say(key, part=part, distance=STAYED), True)
            is_said |= key != "model.stayed"
    if not is_said and (lost := [*_lost_at_lines(values, case, is_moving)]):
        yield Remark(say("model.lost", lines=first_of(lost, MAX_LINES)), True)


def _lost_at_lines(values: Variables, case: Case, is_moving: np.ndarray) -> Iterator[Text]:
    """Lines with few crossings compared with the boulders that ended while moving and would have
    crossed on a straight path: if they were included, the fraction would exceed its 95 % interval.
    The boulders that travel farthest are also the most likely to leave the terrain."""
    if not (is_moving.any() and case.lines and "row_size" in values):
        return
    n = is_moving.size
    start, stop = _ends(values, is_moving)
    for k, line in _lines_of(values, case):
        crossed = has_crossed(values, k)
        passed = int(crossed.sum())
        most = max(MAX_LOST * passed, n * fraction_limits(passed / n, n)[1] - passed)
        open_ = ~crossed[is_moving]
        if open_.sum() <= most:
            continue
        if (lost := int((_meets_line(stop, stop - start, line) & open_).sum())) > most:
            yield say("model.lost_at_line", line=line["name"], lost=lost, passed=passed)


def _lines_of(values: Variables, case: Case) -> Iterator[tuple[int, dict[str, Any]]]:
    """Index in the values, and case group, of each line that has values."""
    return zip(range(np.size(values["row_size"])), case.lines, strict=False)


def _ends(values: Variables, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Start and end points (2, chosen boulders) [m]."""
    start, stop = (
        np.array([np.asarray(values[f"{end}_{axis}"])[chosen] for axis in "xy"])
        for end in ("start", "stop")
    )
    return start, stop


def _misses_line(values: Variables, case: Case, chosen: np.ndarray) -> np.ndarray:
    """Mask (chosen boulders,) of boulders that crossed no line, or would meet an uncrossed line on
    a straight path; all True if there are no lines."""
    if not case.lines or "row_size" not in values:
        return np.ones(int(chosen.sum()), bool)
    start, stop = _ends(values, chosen)
    misses, meets = np.ones(int(chosen.sum()), bool), np.zeros(int(chosen.sum()), bool)
    for k, line in _lines_of(values, case):
        crossed = has_crossed(values, k)[chosen]
        misses &= ~crossed
        meets |= _meets_line(stop, stop - start, line) & ~crossed
    return misses | meets


def _meets_line(origin: np.ndarray, direction: np.ndarray, line: dict[str, Any]) -> np.ndarray:
    """Mask (n,) of the rays from `origin` (2, n) that intersect a polyline."""
    meets = np.zeros(origin.shape[1], bool)
    for first, last in pairwise(np.column_stack([line["x"], line["y"]])):
        meets |= _meets(origin, direction, first, last)
    return meets


def _meets(
    origin: np.ndarray, direction: np.ndarray, first: np.ndarray, last: np.ndarray
) -> np.ndarray:
    """Mask (n,) of rays from `origin` (2, n) that meet the segment from `first` to `last`."""
    (along_x, along_y), (to_x, to_y) = last - first, first[:, None] - origin
    determinant = direction[0] * along_y - direction[1] * along_x
    ray = to_x * along_y - to_y * along_x  # multiplied by the determinant
    segment = to_x * direction[1] - to_y * direction[0]
    sign, size = np.sign(determinant), np.abs(determinant)
    return (size > 0) & (sign * ray >= 0) & (sign * segment >= 0) & (sign * segment <= size)
