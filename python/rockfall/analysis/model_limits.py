# SPDX-License-Identifier: BSD-3-Clause
"""Remarks on the validity of a run's model: the rebounds behind its numbers and their reliability,
the unvalidated forest, and conditions outside the data of the model.

They are printed by `rockfall check` for its pilot run; by `run`, `hazard`, `design` and the report
for their results; by `import-rockyfor3d` for its case.
"""

from __future__ import annotations

import importlib.resources
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rockfall.grounds import IMPACT_SETS, RATIO_TABLE, other_tables, repose
from rockfall.impact_tables import open_table, shipped_tables
from rockfall.io.tables import read_table
from rockfall.quantities import part_of, percent
from rockfall.result.grounds import (
    classical_grounds,
    rebounds_by_ground,
    stochastic_fraction,
    table_grounds,
)

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from rockfall.case import Case
    from rockfall.result.contents import Held

    Variables = Held | Mapping[str, ArrayLike]

MAX_OUTSIDE = 0.2  # fraction of the rebounds from which it is a warning
MAX_FAST = 0.05  # fraction of the boulders
SLOW = 2.0  # [m/s]: bouncing boulders pass a line faster
LOWEST_REST = 22.0  # [degree] of all shipped grounds: soft soil
MAX_SLOW = 0.1  # fraction of passing boulders from which quantiles are no design load
#: Upper envelope of observed maximum speeds [m/s] per degree of the mean slope (Dorren 2015,
#: Rockyfor3D revealed, ecorisQ; it uses 0.64 to 0.8).
SPEED_PER_DEGREE = 0.8
NEAREST = "the nearest ratio stood in"
OUTSIDE = {
    "range": f"had R_b/R_m outside 0.5 to 5.5, where the set is not calibrated: {NEAREST}",
    "speed": "were slower or faster than those that the set was fitted on (speed_range)",
    "angle": "were flatter or steeper than those that the set was fitted on (angle_range)",
}
OUTSIDE_TABLES = "had R_b/R_m outside those of their table of impacts"
OUTSIDE_BOTH = "had R_b/R_m outside those of their impact set or table of impacts"

QUOTED = "their coefficients are as commonly quoted, not confirmed"
OWN = "their coefficients are the user's own, and what they rest on is not known here"
UNDERSTATED = (
    "without a fit to observations of the slope, speeds, jump heights and energies may be "
    "understated (docs/grounds.md)"
)

TABLES_IN_THE_FIELD = (
    "tables are hardly validated, at two field sites: mean run-outs on a pasture 6 % too long; "
    "means of speed, height and energy on talus within 11 %, but deviations a third too small, so "
    "that 95 % quantiles err low, of speed by 12 %, of energy by a fifth; on long slopes above 30 "
    "degrees boulders on other ground than talus are faster than any observed "
    "(docs/validation/field)"
)

BREAKAGE = (
    "Breakage follows a rule fitted to limestone in a quarry, as quoted and not confirmed, and is "
    "not validated here; fragments have less energy than the boulder: look at the same run without "
    "it (&breakage at = 'none'), too"
)
MAX_FINES = 0.01  # fraction of the volume from which it is a warning

LOGS = (
    "What lying logs take is unconfirmed: as much as standing stems of their diameter, less when "
    "decayed; logs decay and move, so look at the same run without logs, too"
)


class Remark(NamedTuple):
    """A remark on the validity of a run's model."""

    text: str
    is_warning: bool
    is_counted: bool = True  # of the boulders of the run


def model_remarks(values: Variables, case: Case) -> Iterator[Remark]:
    """All remarks on the model, from the case and the variables of a result, or of boulders by
    name."""
    yield from rebound_remarks(values, case)
    yield from table_remarks(values)
    yield from forest_remarks(case)
    yield from log_remarks(case)
    yield from breakage_remarks(values, case)
    yield from roll_remarks(values, case)
    yield from (Remark(one.text, one.is_warning) for one in extrapolations(values))


def rebound_remarks(values: Variables, case: Case) -> Iterator[Remark]:
    """Remarks on the fractions of classical rebounds and the reliability of their coefficients;
    none for runs with impact sets only."""
    if not (grounds := classical_grounds(values)):
        return
    followed = part_of(
        sum(one.rebounds for one in grounds),
        max(1, _total(values, "rebounds_by_ground")),
        "rebound",
    )
    parts = "; ".join(
        f"{one.name} ({one.model.replace('_', ' ')}) {percent(one.fraction)}" for one in grounds
    )
    text = f"{followed} followed classical grounds in place of impact sets: {parts}"
    yield Remark(f"{text}; {coefficients_remark(case)}", True)


def table_remarks(values: Variables) -> Iterator[Remark]:
    """Remarks on the fractions of rebounds by tables of impacts and their field validation; none
    without tables."""
    if not (tables := table_grounds(values)):
        return
    drawn = part_of(
        sum(one.rebounds for one in tables),
        max(1, _total(values, "rebounds_by_ground")),
        "rebound",
    )
    parts = "; ".join(f"{one.name} {percent(one.fraction)}" for one in tables)
    yield Remark(f"{drawn} were drawn from tables of impacts: {parts}; {TABLES_IN_THE_FIELD}", True)


def coefficients_remark(case: Case) -> str:
    """Reliability of the coefficients of the classical grounds of a case."""
    return f"{OWN if has_own_grounds(case) else QUOTED}; {UNDERSTATED}"


def has_own_grounds(case: Case) -> bool:
    """Return True if the grounds come from the user's table in place of the shipped one."""
    own = case.surface.get("ground_table")
    return bool(own) and own not in other_tables()


def forest_remarks(case: Case) -> Iterator[Remark]:
    """Remark that forest is not validated; none without trees."""
    if case.has_forest:
        yield Remark(forest_text(), True, is_counted=False)


def log_remarks(case: Case) -> Iterator[Remark]:
    """Remark that capacities of lying logs are unconfirmed; none without logs."""
    if any("diameter" in one for one in case.barrier):
        yield Remark(LOGS, True, is_counted=False)


def breakage_remarks(values: Variables, case: Case) -> Iterator[Remark]:
    """Remarks on breakage: that its rule is not validated, what statistics count, and boulders
    whose fragments were limited or lost as fines; none where boulders do not break."""
    if case.breakage["at"] == "none":
        return
    yield Remark(BREAKAGE, True, is_counted=False)
    if "fragments" not in values:
        return
    names = ("fragments", "breakages", "breakages_capped", "fines_volume", "volume")
    fragments, breakages, capped, fines, volume = (np.asarray(values[name]) for name in names)
    broke = breakages > 0
    if broke.any():
        yield Remark(
            f"{part_of(int(broke.sum()), broke.size, 'boulder')} broke, into "
            f"{fragments[broke].mean():.3g} fragments on average, {fragments.max()} at most: maps, "
            "lines and hits count a boulder once, with the largest values of its fragments, so "
            "that risk and the load of a barrier count one hit of several; deposits count fragments"
            + "".join(_fragments_at_lines(values)),
            True,
        )
    if (reached := int((capped > 0).sum())) > 0:
        yield Remark(
            f"{part_of(reached, capped.size, 'boulder')} reached &breakage max_fragments = "
            f"{case.breakage['max_fragments']}: what would have broken further stayed whole, so "
            "that blocks are too large and too few",
            True,
        )
    if (fraction := float(fines.sum() / volume.sum())) > MAX_FINES:
        yield Remark(
            f"{percent(fraction)} of the volume is in pieces below &breakage min_volume = "
            f"{case.breakage['min_volume']:g} m3, which are not traced",
            True,
        )


def _fragments_at_lines(values: Variables) -> Iterator[str]:
    """Mean number of fragments at each line, of the boulders that cross it."""
    if "line_fragments" not in values:
        return
    for name, counts in zip(
        np.asarray(values["line"]), np.asarray(values["line_fragments"]), strict=True
    ):
        if (counts > 0).any():
            yield f"; {name}: {counts[counts > 0].mean():.3g} fragments of each that crosses"


def forest_text() -> str:
    """Comparison with the forest experiment (cases/vaujany-forest), and its consequences."""
    known = forest_experiment()
    there, here = (
        [f"{known['passing', of][column]:g} %" for of in ("bare", "forest")]
        for column in ("experiment", "simulated")
    )
    return (
        f"The forest is not validated and acts strongly: in the published experiment {there[0]} of "
        f"the boulders passed without and {there[1]} with forest, here {here[0]} and {here[1]} "
        "(cases/vaujany-forest); what it holds back is no protective effect without the same run "
        "without forest beside it"
    )


@cache
def forest_experiment() -> dict[tuple[str, str], dict[str, float]]:
    """Results of the published forest experiment and of the program, by quantity and case (bare,
    forest); columns experiment, simulated, standard_error. Written by
    `cases/vaujany-forest/expected.py`."""
    path = importlib.resources.files("rockfall") / "data" / "forest_experiment.csv"
    _, columns, rows = read_table(Path(str(path)))
    return {
        (row.text("quantity"), row.text("case")): {name: row.number(name) for name in columns[2:]}
        for row in rows
    }


def roll_remarks(values: Variables, case: Case) -> Iterator[Remark]:
    """Remarks on lines where many of the passing boulders roll from rock to rock (theory, chapter
    8), which lowers the numbers on which designs rest. None if rows are not kept.

    A boulder rolls where the ground is steeper than the rest angle. The passing height of a boulder
    on the ground is R_b/cos(slope), which gives the slope there.
    """
    volumes = "line_volume" if "line_volume" in values else "volume"
    names = ("line", "line_speed", "line_passing_height", "line_jump_height", volumes)
    if not all(name in values for name in names):
        return
    lines, speeds, passing, jump, volume = (np.asarray(values[name]) for name in names)
    radius = np.cbrt(0.75 / np.pi * volume)
    lowest = LOWEST_REST if rebounds_by_ground(values) else repose()
    rests = np.radians(case.impact.get("rest_angle", lowest))
    steep = radius < (passing - jump) * np.cos(rests)
    for name, speed, rolls in zip(lines, speeds, steep & (speeds < SLOW), strict=True):
        passed = np.isfinite(speed)
        if passed.any() and (fraction := float(rolls[passed].mean())) > MAX_SLOW:
            yield Remark(
                f"{name}: {percent(fraction)} of the boulders that pass are slower than {SLOW:g} "
                "m/s: they roll from rock to rock, and lower the means and quantiles of those that "
                "pass; compare with &impact rest_angle = 90",
                True,
            )


class Extrapolation(NamedTuple):
    """A fraction of the rebounds or boulders, in words, and its status as a warning."""

    fraction: float
    text: str
    is_warning: bool


def fractions_outside(values: Variables) -> dict[str, float]:
    """Fractions of the rebounds by impact sets or tables outside the fitted ranges: by range (of
    R_b/R_m), speed and angle; `values` as for `extrapolations`."""
    rebounds = max(1.0, _stochastic(values))
    return {what: _total(values, f"rebounds_out_of_{what}") / rebounds for what in OUTSIDE}


def extrapolations(values: Variables) -> Iterator[Extrapolation]:
    """Extrapolations in the variables of a result, or of boulders by name.

    Counts may be sums, or of each boulder.
    """
    rebounds = round(_stochastic(values))
    for what, fraction in fractions_outside(values).items():
        if fraction:
            said = part_of(round(fraction * rebounds), rebounds, "rebound")
            text = _outside_ratios(values) if what == "range" else OUTSIDE[what]
            yield Extrapolation(fraction, f"{said} {text}", fraction > MAX_OUTSIDE)
    is_fast = faster_than_observed(values)
    if (fast := int(is_fast.sum())) > MAX_FAST * is_fast.size:
        said = (
            f"{part_of(fast, is_fast.size, 'boulder')} exceeded {SPEED_PER_DEGREE} m/s "
            "per degree of the mean slope of their path, the upper limit of what has been observed "
            "(Dorren 2015): the bounce has no terminal velocity"
        )
        yield Extrapolation(fast / is_fast.size, said, True)


def _outside_ratios(values: Variables) -> str:
    """Text on rebounds outside the ratios of the impact sets or tables that made them; the ratios
    of a shipped table are part of it."""
    followed = [one for one in rebounds_by_ground(values) if one.rebounds]
    tables = [one.name for one in followed if one.model == RATIO_TABLE]
    if not tables:
        return OUTSIDE["range"]
    if any(one.model == IMPACT_SETS for one in followed):
        return f"{OUTSIDE_BOTH}: {NEAREST}"
    if len(tables) > 1 or tables[0] not in shipped_tables():
        return f"{OUTSIDE_TABLES}: {NEAREST}"
    ratios = open_table(shipped_tables()[tables[0]]).ratio
    return f"{OUTSIDE_TABLES} ({tables[0]}: {ratios[0]:g} to {ratios[-1]:g}): {NEAREST}"


def faster_than_observed(values: Variables) -> np.ndarray:
    """Mask (boulders,) of boulders that exceeded the envelope of observed speeds.

    The mean slope is that of the straight line from the release to the end; a boulder that ended no
    lower has none, and is not counted.
    """
    names = ("start_z", "stop_z", "plan_distance", "speed_max")
    start, stop, distance, speed = (np.asarray(values[name]) for name in names)
    slope = np.degrees(np.arctan2(start - stop, distance))
    return (slope > 0) & (speed > SPEED_PER_DEGREE * slope)


def _stochastic(values: Variables) -> float:
    """Number of rebounds by impact sets or tables of impacts."""
    return stochastic_fraction(values) * _total(values, "rebounds")


def _total(values: Variables, name: str) -> int:
    return int(np.asarray(values[name]).sum(dtype="i8"))
