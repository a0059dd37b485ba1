# SPDX-License-Identifier: BSD-3-Clause
"""Labels and units of quantities in tables, texts and figures, and formatting of numbers."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from rockfall.language import Number, Text, say, say_count
from rockfall.result.variables import HISTOGRAM, LINE

#: Display units that differ from the units of results, with conversion factors.
SHOWN = {"1": ("%", 100.0), "J": ("kJ", 1e-3), "m s-1": ("m/s", 1.0), "rad s-1": ("rad/s", 1.0)}


class Quantity(NamedTuple):
    """Description of a quantity: `key` is the message id of its label, `units` are the units in
    results, `decimals` apply to the display unit. `symbol` is a symbol or its message id; "" if
    there is none."""

    key: str
    units: str
    decimals: int
    symbol: str = ""

    @property
    def label(self) -> Text:
        """Label in the current language."""
        return say(self.key)

    @property
    def unit(self) -> str:
        """Display unit; "" if dimensionless."""
        return SHOWN.get(self.units, (self.units, 1.0))[0]

    @property
    def factor(self) -> float:
        """Factor from the unit in results to the display unit."""
        return SHOWN.get(self.units, (self.units, 1.0))[1]

    @property
    def title(self) -> str:
        """Label and unit, for an axis or a table row."""
        return with_unit(self.label, self.unit)

    @property
    def name(self) -> str:
        """Symbol, or the label if there is none."""
        return say(self.symbol or self.key)

    @property
    def short(self) -> str:
        """Symbol or label, with the unit."""
        return with_unit(self.name, self.unit)


def _of_line(name: str, key: str, decimals: int, symbol: str = "") -> Quantity:
    return Quantity(key, LINE[name]["units"], decimals, symbol)


QUANTITIES = {
    "fraction": Quantity("quantity.fraction", "1", 1),
    "speed": _of_line("speed", "quantity.speed", 1),
    "jump_height": _of_line("jump_height", "quantity.jump_height", 2),
    "passing_height": _of_line("passing_height", "quantity.passing_height", 2),
    "omega": _of_line("omega", "quantity.omega", 1, "omega"),
    "energy_translational": _of_line(
        "energy_translational", "quantity.energy_translational", 0, "E_trans"
    ),
    "energy_rotational": _of_line("energy_rotational", "quantity.energy_rotational", 0, "E_rot"),
    "energy_total": _of_line("energy_translational", "quantity.energy_total", 0, "E_tot"),
    "rotational_share": Quantity("quantity.rotational_share", "1", 1, "E_rot / E_tot"),
    "upper_edge": Quantity("quantity.upper_edge", "m", 2, "quantity.upper_edge_short"),
    "normal_height": Quantity("quantity.normal_height", "m", 2, "quantity.centre_normal"),
    "normal_upper_edge": Quantity("quantity.normal_upper_edge", "m", 2, "quantity.edge_normal"),
    "fragments": Quantity("quantity.fragments", "", 1, "quantity.fragments_short"),
    "position": Quantity("quantity.position", "m", 1, "quantity.along_line"),
    "stopping_distance": Quantity("quantity.stopping_distance", "m", 1),
}
AT_LINES = ("speed", "passing_height", "energy_total")  # quantities compared at lines
DESIGN = {  # loads on a barrier; heights above the ground
    **QUANTITIES,
    "passing_height": _of_line("passing_height", "quantity.centre_vertical", 2),
}
#: Units of data columns, as in results; "1" for fractions. Other columns have no unit.
COLUMN_UNITS = {
    "fraction": "1", "residual": "1",
    "height": "m", "height_needed": "m", "normal_height_needed": "m", "h_d": "m",
    "normal_h_d": "m", "start": "m", "end": "m", "f_min": "m",
    "capacity": "J", "energy_allowed": "J", "E_d": "J",
    "v_d": "m s-1", "m_d": "kg", "volume": "m3",
}  # fmt: skip
REBOUND = {  # quantities with histograms over all rebounds
    "tangential_share": Quantity("quantity.tangential_share", "1", 1),
    "normal_share": Quantity("quantity.normal_share", "1", 1),
    "rotational_share": QUANTITIES["rotational_share"],
    "incidence_angle": Quantity(
        "quantity.incidence_angle", HISTOGRAM["incidence_angle"]["units"], 0
    ),
    "restitution_tangential": Quantity("R_t = V_t,out / V_t,in", "", 2),
    "restitution_normal": Quantity("R_n = -V_n,out / V_n,in", "", 2),
}


def statistic(name: str) -> Text:
    """Label of a statistic (mean, std, or a quantile such as q95), in the current language."""
    if name in ("mean", "std"):
        return say("statistic.mean" if name == "mean" else "statistic.std")
    return say("statistic.quantile", level=int(name[1:]))


def with_unit(label: str, unit: str) -> str:
    """Label of an axis or column, followed by its unit if it has one."""
    return f"{label} [{unit}]" if unit else label


#: Smaller numbers are rounding errors and are shown as 0.
NOISE = 1e-12


def number(value: float, digits: int = 3, *, up: bool = False) -> Number:
    """Format a number with `digits` significant digits and thousands separators, without an
    exponent unless six decimals would show 0; "-" if it is not finite. `up` rounds up, for required
    minima."""
    value = float(value)
    if not math.isfinite(value):
        return Number("-")
    if not value:
        return Number("0")
    beyond = digits - 1 - math.floor(math.log10(abs(float(f"{value:.{digits - 1}e}"))))
    beyond, near = min(beyond, 6), round(value, min(beyond, 6))
    if up and near < value * (1 - 1e-12):
        near = round(near + 10.0**-beyond, beyond)
    if not near:
        return small(value) if abs(value) > NOISE else Number("0")
    return Number(f"{near:,.{max(0, beyond)}f}")


def small(value: float) -> Number:
    """Format a small number, such as a risk, in scientific notation: 2.3e-7."""
    if not math.isfinite(value):
        return Number("-")
    return Number(f"{value:.1e}".replace("e-0", "e-").replace("e+00", "") if value else "0")


def round_step(rough: float) -> float:
    """Round up to 1, 2, 2.5 or 5 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(max(rough, 1e-6)))
    return power * next(step for step in (1, 2, 2.5, 5, 10) if step * power >= 0.999 * rough)


def count(number: int, singular: str, plural: str | None = None) -> str:
    """Format a count with its noun: 1 boulder, 2,000 boulders."""
    return f"{number:,} {singular if number == 1 else plural or singular + 's'}"


def percent(fraction: float) -> Number:
    """Fraction as a percentage, never rounded to 0 or 100 %."""
    shown = f"{100 * fraction:.1f}"
    if 0 < fraction < 1 and shown in ("0.0", "100.0"):
        return Number("< 0.1 %" if fraction < 0.5 else "> 99.9 %")
    return Number(f"{shown.removesuffix('.0')} %" if fraction in (0, 1) else f"{shown} %")


def first_of(items: Sequence[Any], most: int) -> list[Any]:
    """First items of a list for a message, followed by "..." if there are more."""
    return [*items[:most], *["..."][: len(items) > most]]


def worst_first(*loads: ArrayLike) -> list[int]:
    """Indices of places by their best rank in any load (highest first; NaN last), then by the first
    load: if a table ends after a few places, it contains the highest of each load."""
    ranks = [
        np.unique(-np.nan_to_num(np.asarray(load, "f8")), return_inverse=True)[1] for load in loads
    ]
    return [int(k) for k in np.lexsort((ranks[0], np.min(ranks, axis=0)))]


def part_of_boulders(part: int, whole: int) -> Text:
    """Number and percentage of boulders: 20 of 1,000 boulders (2.0 %)."""
    fraction = percent(part / whole)
    return say_count("count.part_of_boulders", whole, part=part, fraction=fraction)


def part_of_rebounds(part: int, whole: int) -> Text:
    """Number and percentage of rebounds: 20 of 1,000 rebounds (2.0 %)."""
    fraction = percent(part / whole)
    return say_count("count.part_of_rebounds", whole, part=part, fraction=fraction)
