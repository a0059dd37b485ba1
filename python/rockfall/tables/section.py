# SPDX-License-Identifier: BSD-3-Clause
"""Section along a drawn line as tables and text."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import pandas as pd

from rockfall.analysis.lines.crossed_lines import DAM
from rockfall.analysis.lines.envelopes import QUANTITIES as OF_SECTION
from rockfall.analysis.lines.envelopes import fewest_for
from rockfall.analysis.lines.section import RECORDED, Section
from rockfall.limits import MIN_FOR_MEAN
from rockfall.quantities import QUANTITIES, count, number
from rockfall.table import Column, Estimate, Table, as_text
from rockfall.terrain.polyline import lengths

ROWS = 20  # maximum stations printed
KEEP = "&output kept = 'all', or a larger number"
LENGTHS = ("distance", "x", "y", "elevation", "height")
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
Brackets: 95 % confidence intervals of the Monte Carlo error. E: total kinetic energy, h: vertical
height of the centre above the ground, v: speed; mean, 95 % quantile, maximum. A recorded boulder
counts where it first crosses a station. Map values are maxima of all boulders in the cell below the
station; corridor maxima cover all cells that the station crosses."""


def section_data(frame: pd.DataFrame) -> Table:
    """Table of a section with all its columns, in display units."""
    units = {str(name): _unit(str(name)) for name in frame.columns}
    scaled = (
        frame[name] if units[name][1] == 1 else units[name][1] * frame[name] for name in units
    )
    columns = [Column(name, unit) for name, (unit, _) in units.items()]
    return Table("", columns, [*zip(*scaled, strict=True)])


def _unit(name: str) -> tuple[str, float]:
    """Display unit of a column, and conversion factor from SI."""
    if name in LENGTHS:
        return "m", 1.0
    if name == "capacity":
        name = "energy_total_"
    for quantity in OF_SECTION:
        if f"{quantity}_" in name:
            return QUANTITIES[quantity].unit, QUANTITIES[quantity].factor
    return "", 1.0


def section_text(section: Section) -> str:
    """Text with the basis of a section, the lines that it crosses, and some of its stations."""
    length = float(lengths(section.line.vertices)[-1])
    first = f"{number(length, 4)} m, {section.line.within:g} m to either side"
    parts = [ABOUT, *(f"Warning: {note}" for note in section_notes(section)), "", first]
    if len(section.lines):
        head = "Lines, barriers and dams that it crosses, with all boulders in the corridor"
        parts += ["", head, as_text(crossed_table(section.lines))]
    if section.recorded:
        names = tuple(f"{RECORDED}{name}" for name in AT_LINE)
        parts += [
            "",
            "Recorded trajectories",
            as_text(station_table(section, f"{RECORDED}n", names)),
        ]
    if section.has_maps:
        parts += [
            "",
            "All boulders, from the maps",
            as_text(station_table(section, "cell_n", BY_CELL)),
        ]
    return "\n".join(parts)


def section_notes(section: Section) -> Iterator[str]:
    """Notes on the limits of a section's numbers."""
    boulders = count(section.boulders, "boulder")
    if section.recorded:
        most = int(section.table["recorded_n"].max())
        recorded = f"{section.recorded + section.not_kept:,} of {boulders} are recorded"
        if section.not_kept:
            recorded += f", the {section.recorded:,} of them that are kept count here"
        yield (
            f"{recorded}, at most {most:,} cross a station in the corridor. A mean needs "
            f"{MIN_FOR_MEAN}, a 95 % quantile {fewest_for(0.95)}: for more, set "
            f"{KEEP if section.not_kept else '&output trajectories'}"
        )
    elif section.not_kept:
        yield (
            f"the trajectories of {section.not_kept:,} of {boulders} are recorded, but none of "
            f"these boulders are kept, so none count here: {KEEP}"
        )
    else:
        yield "no trajectories of boulders that moved are recorded: &output trajectories"
    if not section.has_maps:
        yield (
            "no maps of speeds, energies or heights, so no section values for all boulders: set "
            "&output maps = 'passages', 'energy_q95', 'energy_max', 'passing_height_q95' and so on"
        )
    if section.lines.loc[section.lines["kind"] != DAM, "n"].isna().any():
        yield "numbers at lines and barriers need the rows of all boulders: &output kept = 'all'"
    if section.lacks_heights:
        yield (
            "heights of recorded trajectories are blank where the terrain of the run is unknown or "
            "was read with fewer cells (--dem)"
        )
    elif section.table["elevation"].isna().any():
        yield "the terrain is not known along all of the section"
    if unknown := section.unknown_energies:
        yield (
            f"energies of {unknown:,} recorded passages are left out: the masses of their boulders "
            "are not known"
        )


def crossed_table(lines: pd.DataFrame) -> Table:
    """Table of the lines, barriers and dams that a section crosses."""
    rows = []
    for row in lines.to_dict("records"):
        height = f", {row['height']:g} m" if np.isfinite(row["height"]) else ""
        name = f"{row['name']}" + (f" ({row['kind']}{height})" if row["kind"] != "line" else "")
        numbers = (_number(row, name) for name in AT_LINE)
        rows.append((name, number(row["distance"], 4), row["n"], *numbers))
    heads = [Column("crosses"), Column("at", "m"), Column("boulders", decimals=0)]
    return Table.of("", [*heads, *map(_column, AT_LINE)], rows)


def station_table(section: Section, counted: str, names: tuple[str, ...]) -> Table:
    """Table of evenly spaced stations, with numbers from one source."""
    records = section.table.to_dict("records")
    rows = [
        (number(row["distance"], 4), number(row["elevation"], 5), row[counted],
         *(_number(row, name) for name in names))
        for row in records[:: -(-len(records) // ROWS)]
    ]  # fmt: skip
    heads = [Column("at", "m"), Column("elevation", "m"), Column("boulders", decimals=0)]
    return Table.of("", [*heads, *map(_column, names)], rows)


def _column(name: str) -> Column:
    """Column for a number, such as E_q95 [kJ] or corridor: E_max [kJ]."""
    before, quantity, number = _parsed(name)
    corridor = "corridor: " if before == "corridor_" else ""
    return Column(f"{corridor}{SYMBOLS[quantity]}_{number}", QUANTITIES[quantity].unit)


def _parsed(name: str) -> tuple[str, str, str]:
    """Source, quantity and statistic in a column name."""
    quantity = next(quantity for quantity in OF_SECTION if f"{quantity}_" in name)
    before, _, number = name.partition(f"{quantity}_")
    return before, quantity, number


def _number(row: Mapping[Any, Any], name: str) -> Estimate:
    return Estimate.of(row, name, QUANTITIES[_parsed(name)[1]].factor, digits=3)
