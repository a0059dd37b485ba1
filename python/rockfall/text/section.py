# SPDX-License-Identifier: BSD-3-Clause
"""Section along a drawn line as text, and its tables with units."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from rockfall.analysis.lines.crossed_lines import DAM
from rockfall.analysis.lines.envelopes import QUANTITIES as OF_SECTION
from rockfall.analysis.lines.envelopes import fewest_for
from rockfall.analysis.lines.section import RECORDED
from rockfall.limits import MIN_FOR_MEAN
from rockfall.quantities import QUANTITIES, count, number, with_unit
from rockfall.terrain.polyline import lengths
from rockfall.text.line_tables import ENDS
from rockfall.text.table import table as aligned

if TYPE_CHECKING:
    import pandas as pd

    from rockfall.analysis.lines.section import Section

ROWS = 20  # stations printed, at most
KEEP = "&output kept = 'all', or a larger number"
LENGTHS = ("distance", "x", "y", "elevation", "height")
SHOWN = ("energy_total", "passing_height", "speed")
SYMBOLS = {"energy_total": "E", "jump_height": "j", "passing_height": "h", "speed": "v"}
AT_LINE = (
    "energy_total_mean", "energy_total_q95", "energy_total_max", "passing_height_q95",
    "passing_height_max", "speed_q95", "speed_max",
)  # fmt: skip
BY_CELL = (
    "cell_energy_total_mean", "cell_energy_total_q95", "corridor_energy_total_max",
    "cell_passing_height_q95", "corridor_passing_height_max", "cell_speed_q95",
    "corridor_speed_max",
)  # fmt: skip
ABOUT = """\
In brackets 95 % confidence intervals of the Monte Carlo error. E: total kinetic energy, h: height
of the centre above the ground, vertical, v: speed; mean, 95 % quantile, maximum. A recorded boulder
counts where it first crosses a station, all boulders by their maxima in the cell of the maps below
it; a maximum of the corridor is that of all cells which the station crosses."""


def with_units(table: pd.DataFrame) -> pd.DataFrame:
    """Table of a section in the units in which numbers are shown, named in its columns."""
    columns = {}
    for name, column in table.items():
        unit, factor = _unit(str(name))
        columns[with_unit(str(name), unit)] = column if factor == 1 else factor * column
    return table.__class__(columns)


def _unit(name: str) -> tuple[str, float]:
    """Unit of a column, and the factor to it from SI."""
    if name in LENGTHS:
        return "m", 1.0
    if name == "capacity":
        name = "energy_total_"
    for quantity in OF_SECTION:
        if f"{quantity}_" in name:
            return QUANTITIES[quantity].unit, QUANTITIES[quantity].factor
    return "", 1.0


def section_text(section: Section) -> str:
    """Basis of a section, the lines that it crosses, and some of its stations."""
    length = float(lengths(section.line.vertices)[-1])
    first = f"{number(length, 4)} m, {section.line.within:g} m to either side"
    parts = [ABOUT, *(f"Warning: {note}" for note in section_notes(section)), "", first]
    if len(section.lines):
        head = "Lines, barriers and dams that it crosses, with all boulders in the corridor"
        parts += ["", head, aligned(_lines(section.lines))]
    if section.recorded:
        names = tuple(f"{RECORDED}{name}" for name in AT_LINE)
        parts += ["", "Recorded trajectories", aligned(_stations(section, f"{RECORDED}n", names))]
    if section.has_maps:
        parts += ["", "All boulders, by the maps", aligned(_stations(section, "cell_n", BY_CELL))]
    return "\n".join(parts)


def section_notes(section: Section) -> Iterator[str]:
    """Limits of the numbers of a section."""
    boulders = count(section.boulders, "boulder")
    if section.recorded:
        most = int(section.table["recorded_n"].max())
        recorded = f"{section.recorded + section.not_kept:,} of {boulders} are recorded"
        if section.not_kept:
            recorded += f", the {section.recorded:,} of them that are kept count here"
        yield (
            f"{recorded}, at most {most:,} cross a station in the corridor: a mean needs "
            f"{MIN_FOR_MEAN}, a 95 % quantile {fewest_for(0.95)}, and is blank below; more: "
            f"{KEEP if section.not_kept else '&output trajectories'}"
        )
    elif section.not_kept:
        yield (
            f"the trajectories of {section.not_kept:,} of {boulders} are recorded, and none of "
            f"these boulders are kept, so that none count here: {KEEP}"
        )
    else:
        yield "no trajectories of boulders that moved are recorded: &output trajectories"
    if not section.has_maps:
        yield (
            "no maps of speeds, energies or heights: no number along the section is of all "
            "boulders; &output maps = 'passages', 'energy_q95', 'energy_max', 'passing_height_q95' "
            "and so on"
        )
    if section.lines.loc[section.lines["kind"] != DAM, "n"].isna().any():
        yield "numbers at lines and barriers need the rows of all boulders: &output kept = 'all'"
    if section.lacks_heights:
        yield (
            "heights of recorded trajectories are blank where the terrain of the run is not known, "
            "or read with fewer cells (--dem)"
        )
    elif section.table["elevation"].isna().any():
        yield "the terrain is not known along all of the section"
    if unknown := section.unknown_energies:
        yield (
            f"energies of {unknown:,} recorded passages are left out: the masses of their boulders "
            "are not known"
        )


def _lines(lines: pd.DataFrame) -> Iterator[list[str]]:
    yield ["  crosses", "at [m]", "boulders", *map(_title, AT_LINE)]
    for row in lines.to_dict("records"):
        text = f", {row['height']:g} m" if np.isfinite(row["height"]) else ""
        name = f"  {row['name']}" + (f" ({row['kind']}{text})" if row["kind"] != "line" else "")
        numbers = (_number(row, name) for name in AT_LINE)
        yield [name, number(row["distance"], 4), _count(row["n"]), *numbers]


def _stations(section: Section, counted: str, names: tuple[str, ...]) -> Iterator[list[str]]:
    """Stations, evenly selected, with numbers from one source."""
    yield ["  at [m]", "elevation [m]", "boulders", *map(_title, names)]
    rows = section.table.to_dict("records")
    for row in rows[:: -(-len(rows) // ROWS)]:
        place = f"  {number(row['distance'], 4)}", number(row["elevation"], 5)
        yield [*place, _count(row[counted]), *(_number(row, name) for name in names)]


def _title(name: str) -> str:
    """Title of a column: E95 [kJ], corridor: E_max [kJ]."""
    before, quantity, number = _parsed(name)
    corridor = "corridor: " if before == "corridor_" else ""
    return corridor + with_unit(f"{SYMBOLS[quantity]}_{number}", QUANTITIES[quantity].unit)


def _parsed(name: str) -> tuple[str, str, str]:
    """Source, quantity and statistic of a column."""
    quantity = next(quantity for quantity in OF_SECTION if f"{quantity}_" in name)
    before, _, number = name.partition(f"{quantity}_")
    return before, quantity, number


def _count(n: float) -> str:
    return f"{n:,.0f}" if np.isfinite(n) else "-"


def _number(row: Mapping[Any, Any], name: str) -> str:
    """Number with its interval, if it has one."""
    factor = QUANTITIES[_parsed(name)[1]].factor
    value, low, high = (factor * row.get(name + end, np.nan) for end in ENDS)
    is_known = np.isfinite([low, high]).all()
    return number(value) + (f" ({number(low)} to {number(high)})" if is_known else "")
