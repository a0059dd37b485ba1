# SPDX-License-Identifier: BSD-3-Clause
"""Messages with results of other commands: design check of a net, hazard of the scenarios, and
sources of the boulders that reach a place.
"""

import math
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import xarray as xr

from rockfall.analysis.hazard.classes import CLASSES
from rockfall.analysis.hazard.levels import exceedance
from rockfall.analysis.hazard.origins import SOURCES, origins_at
from rockfall.analysis.objects.at_risk import AtRisk
from rockfall.analysis.objects.segments import MIN_LENGTH
from rockfall.app.messages import Message, binary_message, text_message
from rockfall.app.surroundings import Offer
from rockfall.case import Case
from rockfall.errors import RockfallError
from rockfall.files.hazard_files import HAZARD_COLOURS
from rockfall.io.rasters.arrays import grid_of, north_up
from rockfall.io.rasters.grid import Grid
from rockfall.language import speaking, word
from rockfall.plots.cartography.rasters import merged
from rockfall.plots.hazard.origin_map import COLOURS, parts_and_words
from rockfall.protection.design import design
from rockfall.protection.yearly import YearlyDesign, yearly_design
from rockfall.quantities import round_step
from rockfall.result.crossings import line_names
from rockfall.scene.frames import GROUPS
from rockfall.studies.hazard import coordinates_of, read_study, run_study, traced
from rockfall.table import Table
from rockfall.tables.design import check_tables, choice_table
from rockfall.tables.hazard import object_table, period_tables, scenario_table, stretch_tables
from rockfall.tables.yearly_design import advice, choice_tables, loads_table, verdicts
from rockfall.tables.yearly_design import check_tables as yearly_check_tables

MAX_CELLS = 1001  # along a side of the class map
SEGMENTS = 20  # approximate number of segments along all drawn lines; none if there are more lines


def table_entry(table: Table) -> dict[str, Any]:
    """A table as texts in the current language, in JSON form."""
    return {"caption": str(table.caption), "head": table.head, "rows": [*table.texts()]}


def net_message(result: xr.Dataset, net: str, language: str, **fields: Any) -> Message:
    """Message `net`: design sheet of a line or barrier, from the boulders simulated so far."""
    tables: list[Table] = []
    if net in line_names(result) and result.sizes["boulder"]:
        with speaking(language):
            sheet = design(result, line=net)
            tables = [*check_tables(sheet)]
            if sheet.demand["n"].iloc[0]:
                tables.append(choice_table(sheet, net))
            return text_message("net", net=net, tables=[*map(table_entry, tables)], **fields)
    return text_message("net", net=net, tables=[], **fields)


def hazard_of(case: Case, frames: Mapping[str, Any], offer: Offer | None, grid: Grid) -> xr.Dataset:
    """Hazard of a case with layers, as from `rockfall.hazard`, for the objects of `offer`, and for
    segments of a round length along the drawn lines."""
    import shapely

    given = AtRisk([*offer.files], [*offer.layers]) if offer else AtRisk()
    lines = [*frames["lines"].geometry] if "lines" in frames else []
    terrain = shapely.box(grid.west, grid.south, grid.east, grid.north)
    is_on = shapely.intersects(lines, terrain).any() and len(lines) <= SEGMENTS
    if is_on and case.output["kept"] == "all":
        length = max(round_step(shapely.length(lines).sum() / SEGMENTS), MIN_LENGTH)
        given = given._replace(segments=frames["lines"], segment_length=length)
    return run_study(read_study(case.replace(variant=[]), given, **frames))


def hazard_message(hazard: xr.Dataset, language: str, **fields: Any) -> bytes:
    """Message `hazard`: class map (maxima of blocks of cells), tables, sentences on nets."""
    values, grid = north_up(hazard["hazard_class"])
    step = int(max(values.shape) / MAX_CELLS) + 1
    with speaking(language):
        tables, sentences = [scenario_table(hazard)], list[str]()
        nets: dict[str, list[dict[str, Any]]] = {}
        if "line" in hazard.dims:
            sheet = yearly_design(hazard)
            tables.append(loads_table(sheet))
            sentences = [*map(str, advice(sheet)), *map(str, verdicts(sheet))]
            nets = {
                name: [*map(table_entry, _of_line(sheet, name))] for name in sheet.loads["line"]
            }
        if "object" in hazard.dims:
            tables.append(object_table(hazard))
        words = [str(word(name)) for name in CLASSES]
        entries = [*map(table_entry, tables)]
    return binary_message(
        "hazard", {"classes": merged(values, step, np.maximum).astype("u1")}, **fields,
        west=grid.west, north=grid.north, cell=grid.cell * step, error="",
        classes=[*map(list, zip(words, HAZARD_COLOURS, strict=True))],
        tables=entries, sentences=sentences, nets=nets,
        places=[str(name) for kind in ("line", "object") if kind in hazard.dims
                for name in hazard[kind].values],
    )  # fmt: skip


def _of_line(sheet: YearlyDesign, name: str) -> Iterable[Table]:
    """Tables for a barrier or line: boulders that pass per year, and sufficient barriers."""
    own = YearlyDesign(
        sheet.period,
        *(frame[frame["line"] == name] for frame in (sheet.loads, sheet.choices, sheet.checks)),
    )
    return [*yearly_check_tables(own), *choice_tables(own)]


def point_of(hazard: xr.Dataset, place: str) -> tuple[float, ...]:
    """Coordinates of a place "X,Y" [m]; empty for the name of a line or object."""
    named = any(place in hazard[kind].values for kind in SOURCES if kind in hazard.dims)
    numbers = () if named else coordinates_of(place)
    return numbers if len(numbers) == 2 and all(map(math.isfinite, numbers)) else ()


def origins_message(
    hazard: xr.Dataset | None, place: str, language: str, frames: Mapping[str, Any], **fields: Any
) -> bytes:
    """Message `origins`: cells from which boulders reach a place, with the class of their
    contribution; levels by return period; frequency by energy [kJ], with limits (`curve_...`). An
    unknown place gives an `error`. For a point "X,Y" [m] the scenarios run again; their lines,
    barriers and dams are in the case of the hazard, not in `frames`."""
    fields |= {"place": place, "error": "", "parts": [], "tables": []}
    if hazard is None or not place:
        return binary_message("origins", {}, **fields | {"place": ""})
    try:
        layers = {name: frame for name, frame in frames.items() if name not in GROUPS}
        hazard, kind, k = traced(hazard, point_of(hazard, place) or place, **layers)
        table, name = origins_at(hazard, kind, k), str(hazard[kind].values[k])
    except RockfallError as error:
        return binary_message("origins", {}, **fields | {"error": str(error)})
    with speaking(language):
        classes, words = parts_and_words(table)
        tables = *period_tables(hazard, name), *stretch_tables(hazard, name)
        fields["tables"] = [*map(table_entry, tables)]
    fields["parts"] = [
        [str(text), colour, int(np.count_nonzero(classes == k))]
        for k, (text, colour) in enumerate(zip(words, COLOURS, strict=False))
    ]
    arrays = {name: table[name].to_numpy("f8") for name in ("x", "y", "frequency", "share")}
    arrays |= {"class": classes.astype("u1")}
    if fields["tables"]:
        curve = exceedance(hazard, name).assign(energy=lambda rows: rows["energy"] / 1000)
        arrays |= {f"curve_{name}": curve[name].to_numpy("f8") for name in curve}
    fields["cell"] = grid_of(hazard["hazard_class"])[0].cell
    fields["total"] = float(table["frequency"].sum())
    return binary_message("origins", arrays, **fields)
