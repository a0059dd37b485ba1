# SPDX-License-Identifier: BSD-3-Clause
"""Remarks on the validity of a run's model: the rebounds behind its numbers and their reliability,
the unvalidated forest, conditions outside the data of the model, and boulders whose end says little
of a slope.

They are printed by `rockfall check` for its pilot run; by every command that shows or writes
numbers of results; by `ensemble` for the unchanged case; by `import-rockyfor3d` for its case.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rockfall.analysis.observed.run_out import falls_and_distances, mean_slopes
from rockfall.evidence import evidence, largest_error, only
from rockfall.grounds import IMPACT_SETS, RATIO_TABLE, block_radius, other_tables, repose
from rockfall.grounds.impact_sets import shipped_sets
from rockfall.grounds.impact_tables import open_table, own_table, shipped_tables
from rockfall.language import Text, say, word
from rockfall.limits import fraction_limits
from rockfall.quantities import first_of, part_of_boulders, part_of_rebounds, percent
from rockfall.result.crossings import MOTION, AtLine, has_crossed, line_names, stored_at
from rockfall.result.grounds import (
    classical_grounds,
    rebounds_by_ground,
    sets_followed,
    stochastic_fraction,
    table_grounds,
)
from rockfall.result.variables import STATUS

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from rockfall.case import Case
    from rockfall.result.contents import Held
    from rockfall.result.grounds import GroundRebounds

    Variables = Held | Mapping[str, ArrayLike]

MAX_OUTSIDE = 0.2  # fraction of the rebounds from which it is a warning
MAX_FAST = 0.05  # fraction of the boulders
LARGE_BLOCK = 1.25  # R_b over that of the largest blocks that a table is thrown with
MAX_LARGE = 0.2  # fraction of the boulders
SLOW = 2.0  # [m/s]: bouncing boulders pass a line faster
LOWEST_REST = 22.0  # [degree] of all shipped grounds: soft soil
MAX_SLOW = 0.1  # fraction of passing boulders from which quantiles are no design load
#: Upper envelope of observed maximum speeds [m/s] per degree of the mean slope (Dorren 2015,
#: Rockyfor3D revealed, ecorisQ; it uses 0.64 to 0.8).
SPEED_PER_DEGREE = 0.8


#: Messages on shipped sets, by how their names begin (those of ensembles are longer).
SET_MESSAGES = {
    "laboratory-spheres": "model.spheres_set",
    "vaujany-observed": "model.observed_set",
    "bourrier2009": "model.paper_set",
}
JUDGED_TABLES = "talus", "meadow"  # grounds by tables of impacts with evidence of a site each
#: Half of the rebounds of their fit had R_b/R_m above 5.5, which the set of 5 served.
FITTED_BEYOND = "vaujany-observed", "bourrier2009"
OUTSIDE = {  # messages, by the count of a result
    "range": "model.outside_range",
    "speed": "model.outside_speed",
    "angle": "model.outside_angle",
}
MAX_FINES = 0.01  # fraction of the volume from which it is a warning
MAX_CUT = 0.01  # fraction of the boulders that end while moving from which it is a warning
MAX_LOST = 0.1  # lost on the way to a line, over those that cross it, from which it is a warning
MAX_LINES = 5  # lines that a warning names
MAX_STAYED = 0.2  # fraction of the boulders that stay at their sources
STAYED = 10.0  # [m] from the release, drop included: no farther than a boulder rocks before it lies


class Remark(NamedTuple):
    """A remark on the validity of a run's model."""

    text: Text
    is_warning: bool
    is_counted: bool = True  # of the boulders of the run


def model_remarks(values: Variables, case: Case) -> Iterator[Remark]:
    """All remarks on the model, from the case and the variables of a result, or of boulders by
    name."""
    yield from end_remarks(values, case)
    yield from rebound_remarks(values, case)
    yield from set_remarks(values, case)
    yield from table_remarks(values, case)
    yield from forest_remarks(case)
    yield from log_remarks(case)
    yield from breakage_remarks(values, case)
    yield from roll_remarks(values, case)
    if "trajectory_boulder" in values and "trajectory_leg" not in values:
        yield Remark(say("model.no_legs"), True, is_counted=False)
    yield from (
        Remark(extrapolation.text, extrapolation.is_warning)
        for extrapolation in extrapolations(values, case.impact["sets"])
    )


def model_warnings(values: Variables, case: Case) -> list[Text]:
    """Remarks on the model that are warnings."""
    return [remark.text for remark in model_remarks(values, case) if remark.is_warning]


def rebound_remarks(values: Variables, case: Case) -> Iterator[Remark]:
    """Remarks on the fractions of classical rebounds and the reliability of their coefficients;
    none for runs with impact sets only."""
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
    """Ground, its model, and its fraction of the rebounds."""
    return say(
        "model.ground_part",
        name=rebounds.name,
        model=word(rebounds.model),
        fraction=percent(rebounds.fraction),
    )


def followed_text(values: Variables, case_set: str) -> str:
    """Grounds that rebounds followed, with their models and fractions, the most frequent first;
    without grounds the impact sets of the case."""
    grounds = sorted(rebounds_by_ground(values), key=lambda ground: -ground.rebounds)
    if not grounds:
        return say("inputs.impact_sets", impact_set=case_set)
    made = [ground for ground in grounds if ground.rebounds]
    return say("model.several", parts=[*map(ground_part, made)]) if made else say("label.none")


def _part_of_all(grounds: Iterable[GroundRebounds], values: Variables) -> Text:
    """Rebounds on some grounds, of all."""
    rebounds = sum(ground.rebounds for ground in grounds)
    return part_of_rebounds(rebounds, max(1, _total(values, "rebounds_by_ground")))


def set_remarks(values: Variables, case: Case) -> Iterator[Remark]:
    """Remarks on the field validation of the shipped impact sets (docs/validation); none without
    rebounds by them."""
    names = set(sets_followed(values, case.impact["sets"])) & set(shipped_sets())
    total = _total(values, "rebounds")
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
    """Largest errors of means by a shipped set [%]: speeds and energies at Vaujany, by a method of
    choosing rocks if the set was run by both, and run-outs at Tschamut."""
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


def table_remarks(values: Variables, case: Case) -> Iterator[Remark]:
    """Remarks on the fractions of rebounds by tables of impacts and their field validation, and on
    boulders much larger than the blocks thrown; none without tables."""
    if not (tables := table_grounds(values)):
        return
    names = [table.name for table in tables]
    sites = [*evidence("vaujany"), *evidence("tschamut", "held-out", "run_out_*")]
    judged = [row for row in sites if row.model in {*JUDGED_TABLES, *names}]
    means, deviations = (
        largest_error(row for row in judged if row.quantity.endswith(statistic))
        for statistic in ("_mean", "_std")
    )
    text = say(
        "model.tables",
        drawn=_part_of_all(tables, values),
        grounds=", ".join(names),
        means=means,
        deviations=deviations,
    )
    yield Remark(text, True)
    thrown = [*_largest_thrown(tables, case)]
    if thrown and "volume" in values:
        radius = LARGE_BLOCK * min(thrown)
        large = np.asarray(values["volume"]) > 4 / 3 * np.pi * radius**3
        if large.sum() > MAX_LARGE * large.size:
            part = part_of_boulders(int(large.sum()), large.size)
            yield Remark(say("model.large_blocks", part=part, radius=radius), True)


def _largest_thrown(tables: Iterable[GroundRebounds], case: Case) -> Iterator[float]:
    """R_b [m] of the largest blocks that each table was thrown with, as the result says; of a
    result without this, as the table at hand says."""
    for table in tables:
        radius, path = table.block_radius, own_table(case, table.name)
        if np.isnan(radius) and path:
            radius = block_radius(open_table(path))
        if not np.isnan(radius):
            yield radius


def has_own_grounds(case: Case) -> bool:
    """Return True if the grounds come from the user's table in place of the shipped one."""
    own = case.surface.get("ground_table")
    return bool(own) and own not in other_tables()


def forest_remarks(case: Case) -> Iterator[Remark]:
    """Remark that forest is not validated; none without trees."""
    if case.has_forest:
        model = "talus" if case.impact["form"] == "table" else "vaujany-observed"
        yield Remark(forest_text(model), True, is_counted=False)


def log_remarks(case: Case) -> Iterator[Remark]:
    """Remark that capacities of lying logs are unconfirmed; none without logs."""
    if any("diameter" in barrier for barrier in case.barrier):
        yield Remark(say("model.logs"), True, is_counted=False)


def breakage_remarks(values: Variables, case: Case) -> Iterator[Remark]:
    """Remarks on breakage: that its rule is not validated, what statistics count, and boulders
    whose fragments were limited or lost as fines; none where boulders do not break."""
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
    """Mean number of fragments at each line, of the boulders that cross it."""
    if not all(name in values for name in ("crossing_fragments", "line_name", "row_size")):
        return
    for k, name in enumerate(line_names(values)):
        if (counts := stored_at(values, "fragments", k)).size:
            yield say("model.fragments", line=name, mean=counts.mean())


def forest_text(model: str = "vaujany-observed") -> Text:
    """Comparison of a model with the forest experiment (cases/vaujany-forest), and its
    consequences."""
    bare, forest = (only("vaujany-forest", state, "passing", model) for state in ("bare", "forest"))
    return say(
        "model.forest",
        bare=bare.observed,
        forest=forest.observed,
        bare_here=round(bare.simulated, 1),
        forest_here=round(forest.simulated, 1),
    )


def roll_remarks(values: Variables, case: Case) -> Iterator[Remark]:
    """Remarks on lines where many of the passing boulders roll from rock to rock (theory, chapter
    8), which lowers the numbers on which designs rest. None if rows are not kept.

    A boulder rolls where the ground is steeper than the rest angle. The passing height of a boulder
    on the ground is R_b/cos(slope), which gives the slope there.
    """
    if not all(name in values for name in ("line_name", "row_size", "volume")):
        return
    lowest = LOWEST_REST if rebounds_by_ground(values) else repose()
    cosine = np.cos(np.radians(case.impact.get("rest_angle", lowest)))
    for k, name in enumerate(line_names(values)):
        at = AtLine(values, k)
        motion = np.array([at.stored(part) for part in MOTION], "f8")
        radius = np.cbrt(0.75 / np.pi * at.volumes)
        above = motion[MOTION.index("passing_height")] - motion[MOTION.index("jump_height")]
        rolls = (radius < above * cosine) & (np.hypot.reduce(motion[:3]) < SLOW)
        if rolls.size and (fraction := float(rolls.mean())) > MAX_SLOW:
            attrs = {"line": name, "fraction": percent(fraction), "slow": SLOW}
            yield Remark(say("model.rolling", **attrs), True)


def end_remarks(values: Variables, case: Case) -> Iterator[Remark]:
    """Remarks on boulders that count as released but tell little of the slope: that left the known
    terrain before a line, reached the limit of contacts, or stayed at their source. Fractions and
    frequencies err low by them. That nothing is known of these if no rows are kept."""
    if "status" not in values:
        return
    if not (status := np.asarray(values["status"])).size:
        yield Remark(say("model.not_kept"), True, is_counted=False)
        return
    is_gone = np.isin(status, [STATUS["left_domain"], STATUS["hit_nodata"]])
    is_moving = is_gone | (status == STATUS["impact_limit"])
    if is_gone.sum() > MAX_CUT * status.size:
        is_gone[is_gone] = _misses_line(values, case, is_gone)
    fall, distance = falls_and_distances(values)
    stayed = (status == STATUS["stopped"]) & (np.hypot(fall, distance) < STAYED)
    is_said = False  # of all lines
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
    """Lines that few boulders cross, beside those that ended while moving and would meet them if
    they went straight on: with these the fraction would be above its 95 % interval. Boulders that
    come far are the few that leave the terrain, too."""
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
    """Index and group of the lines of a case that the values are of, its first ones."""
    return zip(range(np.size(values["row_size"])), case.lines, strict=False)


def _ends(values: Variables, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First and last places (2, chosen boulders) [m]."""
    start, stop = (
        np.array([np.asarray(values[f"{end}_{axis}"])[chosen] for axis in "xy"])
        for end in ("start", "stop")
    )
    return start, stop


def _misses_line(values: Variables, case: Case, chosen: np.ndarray) -> np.ndarray:
    """Mask (chosen boulders,) of those that crossed no line, or that would meet one that they did
    not cross if they went straight on; all without lines."""
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
    """Mask (n,) of the rays from `origin` (2, n) that meet a polyline."""
    meets = np.zeros(origin.shape[1], bool)
    for first, last in pairwise(np.column_stack([line["x"], line["y"]])):
        meets |= _meets(origin, direction, first, last)
    return meets


def _meets(
    origin: np.ndarray, direction: np.ndarray, first: np.ndarray, last: np.ndarray
) -> np.ndarray:
    """Mask (n,) of the rays from `origin` (2, n) that meet the segment from `first` to `last`."""
    (along_x, along_y), (to_x, to_y) = last - first, first[:, None] - origin
    determinant = direction[0] * along_y - direction[1] * along_x
    ray = to_x * along_y - to_y * along_x  # times the determinant
    segment = to_x * direction[1] - to_y * direction[0]
    sign, size = np.sign(determinant), np.abs(determinant)
    return (size > 0) & (sign * ray >= 0) & (sign * segment >= 0) & (sign * segment <= size)


class Extrapolation(NamedTuple):
    """A fraction of the rebounds or boulders, in words, and its status as a warning."""

    fraction: float
    text: Text
    is_warning: bool


def fractions_outside(values: Variables) -> dict[str, float]:
    """Fractions of the rebounds by impact sets or tables outside the fitted ranges: by range (of
    R_b/R_m), speed and angle; `values` as for `extrapolations`."""
    rebounds = max(1.0, _stochastic(values))
    return {what: _total(values, f"rebounds_out_of_{what}") / rebounds for what in OUTSIDE}


def extrapolations(values: Variables, case_set: str = "") -> Iterator[Extrapolation]:
    """Extrapolations in the variables of a result, or of boulders by name, for the sets of a case.

    Counts may be sums, or of each boulder.
    """
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
                key = _outside_speeds(values)
                # one fast hit, as after a fall, decides what a boulder does
                is_warning |= fraction * rebounds > MAX_OUTSIDE * np.size(values["speed_max"])
            text = say(key, part=part, **numbers)
            yield Extrapolation(fraction, text, is_warning)
    is_fast = faster_than_observed(values)
    if (fast := int(is_fast.sum())) > MAX_FAST * is_fast.size:
        part = part_of_boulders(fast, is_fast.size)
        text = say("model.faster", part=part, limit=SPEED_PER_DEGREE)
        yield Extrapolation(fast / is_fast.size, text, True)


def _outside_ratios(values: Variables, case_set: str) -> tuple[str, dict[str, Any]]:
    """Message on rebounds outside the ratios of the impact sets or tables that made them, and its
    values: the ratios of a shipped table."""
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


def _outside_speeds(values: Variables) -> str:
    """Message on rebounds outside the speeds of the tables, and impact sets, that made them."""
    by_sets = any(
        ground.rebounds and ground.model == IMPACT_SETS for ground in rebounds_by_ground(values)
    )
    return "model.outside_speed_both" if by_sets else "model.outside_thrown"


def faster_than_observed(values: Variables) -> np.ndarray:
    """Mask (boulders,) of boulders that exceeded the envelope of observed speeds.

    The mean slope is that of the straight line from the release to the end; a boulder that ended no
    lower has none, and is not counted.
    """
    slope = mean_slopes(values)
    return (slope > 0) & (np.asarray(values["speed_max"]) > SPEED_PER_DEGREE * slope)


def _stochastic(values: Variables) -> float:
    """Number of rebounds by impact sets or tables of impacts."""
    return stochastic_fraction(values) * _total(values, "rebounds")


def _total(values: Variables, name: str) -> int:
    return int(np.asarray(values[name]).sum(dtype="i8"))
