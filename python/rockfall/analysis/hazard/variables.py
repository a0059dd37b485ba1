# SPDX-License-Identifier: BSD-3-Clause
"""Table of all variables of a hazard: dimensions, units and meaning."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from rockfall.analysis.hazard.classes import CLASSES, intensity_words
from rockfall.analysis.hazard.released import EXTENT, RELEASED
from rockfall.analysis.objects.risk import CLASSES as RISK_CLASSES
from rockfall.case import Case
from rockfall.kernel_rules import EAD_ENERGY
from rockfall.result.maps.flat_maps import BEYOND, PLAN, shown
from rockfall.result.variables import ENDS, MAP

MEANINGS = ("", "lower limit of the 95 % interval of ", "upper limit of the 95 % interval of ")
CLASS_ENDS = {"": "", "_lower": "lowest ", "_upper": "highest "}
EXTREMES = {  # maps with the minimum or maximum over the scenarios
    "energy_line_angle_max": np.fmax,
    "energy_line_angle_min": np.fmin,
    "travel_time_min": np.fmin,
}
YEARLY, YEARS, PART = "year-1", "year", "1"
PERIODS = (10.0, 30.0, 100.0, 300.0, 1000.0)  # [year] for energies and heights
LEVELS = {  # unit and meaning of quantities by return period
    "energy": ("J", "kinetic energy"),
    "height": ("m", "vertical height of the centre above the ground"),
}
#: Energies [J] and heights [m] for which exceeding boulders are counted.
EXCEEDED = {
    "energy": 1e3 * np.array([digit * 10.0**k for k in range(6) for digit in (1, 1.5, 2, 3, 5, 7)]),
    "height": np.concatenate([np.arange(0.5, 10, 0.5), np.arange(10, 20, 1), np.arange(20, 51, 5)]),
}
COORDINATES = (
    "x",
    "y",
    "threshold",
    "return_period",
    "event_period",
    "exceeded_energy",
    "exceeded_height",
    "ead_class",
    "scenario",
    "line",
    "object",
    "segment",
    "ground",
    "ground_model",
)


class Variable(NamedTuple):
    """Dimensions, unit and meaning of a variable."""

    dims: tuple[str, ...]
    units: str
    long_name: str
    words: str = ""  # kind of words for the numbers: hazard, intensity, certain or risk
    comment: str = ""

    @property
    def is_map(self) -> bool:
        """Return True if the variable is one or several plan maps."""
        return self.dims[-2:] == PLAN and {*self.dims} <= {*PLAN, *BEYOND}

    def about(self, case: Case) -> dict[str, Any]:
        """Attributes of the variable in a file."""
        texts = {"units": self.units, "long_name": self.long_name, "comment": self.comment}
        attrs: dict[str, Any] = {name: text for name, text in texts.items() if text}
        if self.words:
            words = words_of(self.words, case)
            numbers = np.arange(len(words), dtype="i1")
            attrs |= {"flag_values": numbers, "flag_meanings": " ".join(words)}
        return attrs | ({"grid_mapping": "crs"} if self.dims[-2:] == PLAN else {})


def words_of(kind: str, case: Case) -> Sequence[str]:
    """Words for the numbers 0, 1, ... of a variable."""
    words = {"hazard": CLASSES, "certain": ("no", "yes"), "risk": RISK_CLASSES}
    return intensity_words(case) if kind == "intensity" else words[kind]


def _with_ends(
    name: str, dims: tuple[str, ...], what: str, units: str = YEARLY
) -> Iterator[tuple[str, Variable]]:
    for end, suffix in zip(ENDS, MEANINGS, strict=True):
        yield f"{name}{end}", Variable(dims, units, suffix + what)


def _classes(prefix: str, dims: tuple[str, ...]) -> Iterator[tuple[str, Variable]]:
    what = "strongest intensity that occurs at least once per return period"
    yield f"{prefix}intensity", Variable(("return_period", *dims), PART, what, "intensity")
    for end, suffix in CLASS_ENDS.items():
        what = f"{suffix}hazard class" + (" within the 95 % interval" if suffix else "")
        yield f"{prefix}hazard_class{end}", Variable(dims, PART, what, "hazard")
    what = "1: the 95 % interval excludes all other hazard classes"
    yield f"{prefix}hazard_class_certain", Variable(dims, PART, what, "certain")


def _by_period(prefix: str, dims: tuple[str, ...], where: str) -> Iterator[tuple[str, Variable]]:
    """Energies and heights by return period, counts for exceedance curves, and the number of
    boulders that count as one observation."""
    what = f"boulders {where} that count as one independent boulder in the intervals"
    yield f"{prefix}boulders_per_cluster", Variable(("scenario", *dims), PART, what)
    for name, (units, quantity) in LEVELS.items():
        what = f"{quantity} reached once per return period by a boulder {where}"
        yield from _with_ends(f"{prefix}{name}_by_period", (*dims, "event_period"), what, units)
        what = f"simulated boulders {where} with more {quantity}"
        yield (
            f"{prefix}{name}_counts",
            Variable(("scenario", *dims, f"exceeded_{name}"), PART, what),
        )


def _table() -> Iterator[tuple[str, Variable]]:
    each, above = PLAN, ("threshold", *PLAN)
    energy = "whose energy in the cell exceeds a threshold"
    yield from _with_ends("passage_frequency", each, "annual frequency of boulders that pass")
    yield from _with_ends("exceedance_frequency", above, f"annual frequency of boulders {energy}")
    of_object = "boulders that would hit an object of object_width in the middle of the cell"
    yield from _with_ends("hit_frequency", each, f"annual frequency of {of_object}")
    what = f"annual frequency of {of_object}, with more energy than a threshold"
    yield from _with_ends("hit_exceedance_frequency", above, what)
    yield "passage_return_period", Variable(each, YEARS, "return period of a boulder that passes")
    what = f"return period of a boulder {energy}"
    yield "exceedance_return_period", Variable(above, YEARS, what)
    yield "reach_probability", Variable(each, PART, "fraction of all boulders that pass")
    yield "exceedance_probability", Variable(above, PART, f"fraction of all boulders {energy}")
    yield from _classes("", each)
    for name in EXTREMES:
        attrs = MAP[name]
        comment = attrs.get("comment", "")
        yield name, Variable(each, attrs["units"], attrs["long_name"], comment=comment)
    yield (
        "frequency",
        Variable(("scenario",), YEARLY, "annual frequency of boulders released, all sources"),
    )
    yield "boulders", Variable(("scenario",), PART, "simulated boulders")
    what = "for sampled sources: boulders that count as one independent boulder in the intervals"
    yield "boulders_per_cluster", Variable(("scenario",), PART, what)
    for name, (units, what) in RELEASED.items():
        for end in EXTENT:
            yield f"released_{name}_{end}", Variable(("scenario",), units, f"{end} {what}")
    what = "fraction of the rebounds by impact sets or tables outside their range of R_b/R_m"
    yield "fraction_out_of_range", Variable(("scenario",), PART, what)
    what = "warnings on the model in the scenario, one per line"
    yield "scenario_warnings", Variable(("scenario",), "", what)
    what = "these warnings as message ids with values, a JSON list"
    yield "scenario_messages", Variable(("scenario",), "", what)
    yield "ground_model", Variable(("ground",), "", "rebound model of the ground")
    what = "rebounds on the ground in all scenarios"
    yield "rebounds_by_ground", Variable(("ground",), PART, what)
    what = "simulated boulders that passed"
    yield "scenario_passages", Variable(("scenario", *each), PART, what)
    what = f"simulated boulders {energy}"
    yield "scenario_energy_exceeded", Variable(("scenario", *above), PART, what)
    yield "scenario_hits", Variable(("scenario", *each), PART, f"simulated {of_object}")
    what = f"simulated {of_object}, with more energy than a threshold"
    yield "scenario_hits_energy_exceeded", Variable(("scenario", *above), PART, what)
    yield "object_layer", Variable(("object",), "", "name of the layer of the object")
    yield "object_geometry", Variable(("object",), "", "well-known text")
    what = "annual frequency of boulders that hit the object"
    yield from _with_ends("object_frequency", ("object",), what)
    what += ", with more energy than a threshold"
    yield from _with_ends("object_exceedance_frequency", ("threshold", "object"), what)
    yield from _classes("object_", ("object",))
    yield from _with_ends("object_risk", ("object",), "annual risk, in the unit of the value")
    yield from _exposed()
    what = "simulated boulders that hit the object"
    yield "object_passages", Variable(("scenario", "object"), PART, what)
    what += ", with more energy than a threshold"
    yield "object_energy_exceeded", Variable(("scenario", "threshold", "object"), PART, what)
    yield from _by_period("object_", ("object",), "that hits the object")
    yield from _segments()
    yield from _lines()
    yield from _sources()


def _sources() -> Iterator[tuple[str, Variable]]:
    """Variables of cells in which boulders start."""
    dims, where = ("source",), "that start in the cell"
    for axis in "xy":
        yield f"source_{axis}", Variable(dims, "m", f"{axis} of the centre of a cell with sources")
    yield "source_frequency", Variable(dims, YEARLY, f"boulders {where}")
    of_runs = "scenario", *dims
    yield "source_boulders", Variable(of_runs, PART, f"simulated boulders {where}")
    for kind, come in (("line", "reach the line or barrier"), ("object", "hit the object")):
        what = f"annual frequency of boulders {where} and {come}"
        yield f"{kind}_source_frequency", Variable((kind, *dims), YEARLY, what)
        what = f"simulated boulders {where} and {come}"
        yield f"{kind}_source_boulders", Variable(("scenario", kind, *dims), PART, what)
        what = f"kinetic energy of the boulders {where} and {come}"
        yield f"{kind}_source_energy_mean", Variable((kind, *dims), "J", f"mean {what}")
        yield from _with_ends(
            f"{kind}_source_energy_q95", (kind, *dims), f"95 % quantile of the {what}", "J"
        )


def _lines() -> Iterator[tuple[str, Variable]]:
    dims = ("scenario", "line")
    what = "annual frequency of boulders that reach the line or barrier"
    yield from _with_ends("line_frequency", ("line",), what)
    what = "simulated boulders that reach the line or barrier"
    yield "line_passages", Variable(dims, PART, what)
    yield from _by_period("line_", ("line",), "that reaches the line or barrier")
    what = "of these boulders, those that pass the barrier, if any"
    yield "line_behind", Variable(dims, PART, what)
    what = "of these boulders, those that hit none of the barriers above before"
    yield "line_around", Variable(dims, PART, what)
    what = "names of the barriers above the line, one per text line"
    yield "line_barriers", Variable(("line",), "", what)
    what = "of these boulders, those that would pass a barrier of this class and height"
    yield "line_class_behind", Variable((*dims, "ead_class", "exceeded_height"), PART, what)
    yield "line_barrier_height", Variable(("line",), "m", "height of the barrier; NaN for a line")
    what = "energy capacity of the barrier; NaN for a line"
    yield "line_barrier_capacity", Variable(("line",), "J", what)


def _segments() -> Iterator[tuple[str, Variable]]:
    dims, where = ("segment",), "where they first touch the segment"
    yield "segment_geometry", Variable(dims, "", "axis of the segment, well-known text")
    yield "segment_road", Variable(dims, "", "road of the segment")
    yield "segment_name", Variable(dims, "", "name of its feature in the layer")
    yield "segment_start", Variable(dims, "m", "chainage at which the segment begins")
    yield "segment_end", Variable(dims, "m", "chainage at which the segment ends")
    yield "segment_width", Variable(dims, "m", "width of the road")
    what = "1: all elevations below the segment are known"
    yield "segment_within", Variable(dims, PART, what, "certain")
    what = "annual frequency of boulders that touch the segment"
    yield from _with_ends("segment_frequency", dims, what)
    what += ", with more energy than a threshold"
    yield from _with_ends("segment_exceedance_frequency", ("threshold", *dims), what)
    yield from _classes("segment_", dims)
    for name, units, what in (
        ("energy", "J", f"kinetic energy of these boulders {where}"),
        ("passing_height", "m", f"vertical height of their centres above the ground {where}"),
        ("upper_edge", "m", f"vertical height of their highest points above the ground {where}"),
        ("diameter", "m", "equivalent diameter of these boulders (sphere of the same volume)"),
    ):
        yield f"segment_{name}_mean", Variable(dims, units, f"mean of the {what}")
        quantile = f"95 % quantile of the {what}"
        yield from _with_ends(f"segment_{name}_q95", dims, quantile, units)
    what = "simulated boulders that touched the segment"
    yield from _by_period("segment_", dims, "that touches the segment")
    yield "segment_boulders", Variable(dims, PART, f"{what}, in all scenarios")
    yield "segment_passages", Variable(("scenario", *dims), PART, what)
    what += ", with more energy than a threshold"
    yield "segment_energy_exceeded", Variable(("scenario", "threshold", *dims), PART, what)


def _exposed() -> Iterator[tuple[str, Variable]]:
    """Variables of risk to property and persons."""
    dims, all_of = ("object",), "objects; intervals account for boulders that hit several"
    yield "object_kind", Variable(dims, "", "kind of the object")
    damage = "expected annual damage to property, in the unit of the value"
    yield from _with_ends("object_damage", dims, damage)
    what = "annual individual risk of death of the most exposed person"
    yield from _with_ends("object_individual_risk", dims, what)
    for end, extreme in CLASS_ENDS.items():
        label = f"{extreme}individual risk class" + (" within the 95 % interval" * bool(extreme))
        yield f"object_risk_class{end}", Variable(dims, PART, label, "risk")
    deaths = "annual collective risk: expected deaths"
    yield from _with_ends("object_collective_risk", dims, deaths)
    yield from _with_ends("total_damage", (), f"{damage}, of all {all_of}")
    yield from _with_ends("total_collective_risk", (), f"{deaths}, of all {all_of}")


TABLE = dict(_table())
CLASS_ENERGY = np.array(EAD_ENERGY)  # capacity of a barrier of each class [J]


def map_names(case: Case) -> Iterator[tuple[str, Variable]]:
    """Names and variables of the plan maps in the hazard of a case."""
    places = {
        "threshold": [1000 * threshold for threshold in case.hazard["thresholds"]],
        "return_period": case.hazard["return_periods"],
    }
    for name, variable in TABLE.items():
        if variable.is_map:
            beyond = variable.dims[:-2]
            for place in product(*(places[dim] for dim in beyond)):
                ends = (shown(dim, value) for dim, value in zip(beyond, place, strict=True))
                yield "_".join([name, *ends]), variable
