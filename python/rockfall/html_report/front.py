# SPDX-License-Identifier: BSD-3-Clause
"""Page 1 of a report, for signature: its contents are cut to one A4 sheet, with a note on
omissions.

Neither WeasyPrint nor a browser shrinks a map to fit a page, and shrinking would falsify its
scale. Texts are therefore cut to a maximum number of lines, and the map fills the remaining space.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import xarray as xr

from rockfall.html_report.inputs import Parties, facts_of
from rockfall.language import say
from rockfall.plots.cartography.sheet import Room
from rockfall.plots.extent import reached
from rockfall.plots.hazard.hazard_figures import zones_figure
from rockfall.plots.map_figures import Look, map_figure, stops_figure
from rockfall.plots.style import NARROW, WIDE
from rockfall.result.maps.passages import passed_map
from rockfall.result.samples import has_rows
from rockfall.result.trajectories import Terrain
from rockfall.table import Table, in_line
from rockfall.tables.lines import Rows, worst_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MM = 25.4  # millimetres per inch
SHEET = 263.0  # height between the margins [mm], which templates/page.css sets
FIXED = 41.0  # height of labels, date, program, headings, signature and gaps [mm]
WARNING_LINES, ANSWER_LINES, SURE_LINES, BESIDE_LINES = 6, 4, 6, 20  # maximum lines of each part
HEAD = 3  # rows for the caption and header of a table
CHARACTERS = {
    "title": 62,
    "question": 88,
    "warning": 98,
    "answer": 84,
    "sure": 112,
    "narrow": 50,
    "fact": 90,
}
LINE = {
    "title": 7.0,
    "question": 5.0,
    "warning": 3.9,
    "answer": 4.6,
    "sure": 3.9,
    "fact": 4.3,
}  # [mm]
ROW = 4.3  # height of a table row [mm]
BETWEEN, MORE, BOX = 1.2, 4.5, 9.0  # paragraph gap, note on omissions, warning frame [mm]
NAME = 20  # letters per line in the first cell of a row
#: Minimum height [mm] of a map with text next to it, and of a wide map, including about 40 mm for
#: scale and legend.
LOWEST = {True: 105.0, False: 85.0}
TALLEST = 165.0  # maximum height of a map [mm]
UPRIGHT = 0.8  # height-to-width ratio above which there is room for text next to a map


class Front(NamedTuple):
    """Contents of page 1, and for each part the contents that appear only on later pages."""

    facts: list[tuple[str, str]]  # label and value; "" leaves a blank to fill in
    warnings: list[str]
    more_warnings: list[str]
    answers: list[str]
    more_answers: list[str]
    tables: list[Table]
    more_tables: list[Table]  # complete versions of tables that page 1 shows in part
    certainty: list[str]
    more_certainty: list[str]
    room: Room  # space for the map
    beside: bool  # True if text is next to the map, False if above


def front_of(
    result: xr.Dataset,
    rows: Rows,
    parties: Parties,
    texts: dict[str, Sequence[str]],
    tables: Sequence[Table],
) -> Front:
    """Page 1 from texts (title, question, warnings, answers, certainty) and tables, cut to the
    length that fits in the current language."""
    west, east, south, north = reached(result)
    beside = (north - south) > UPRIGHT * (east - west)
    warnings, more_warnings = _fitted(texts["warnings"], "warning", WARNING_LINES)
    answers, more_answers = _fitted(texts["answers"], "answer", ANSWER_LINES)
    sure = "narrow" if beside else "sure"
    most = BESIDE_LINES if beside else SURE_LINES
    certainty, more_certainty = _fitted(texts["certainty"], sure, most)
    lines = {
        "title": _lines(texts["title"], "title"),
        "fact": _lines([parties.project, parties.client], "fact"),
        "question": _lines(texts["question"], "question"),
        "warning": _lines(warnings, "warning"),
        "answer": _lines(answers, "answer"),
        "sure": 0 if beside else _lines(certainty, "sure"),
    }
    used = FIXED + sum(LINE[kind] * n for kind, n in lines.items())
    used += BETWEEN * len([*warnings, *answers, *([] if beside else certainty)])
    used += MORE * sum(map(bool, (more_warnings, more_answers)))
    used += BOX if warnings else 0.0
    places = {line: k for k, line in enumerate(rows)}
    order = [places[line] for line in worst_of(rows)]
    shown, more_tables = _cut(tables, order, int((SHEET - used - LOWEST[beside]) / ROW))
    used += ROW * sum(HEAD + sum(map(_high, row.rows)) for row in shown)
    high = min(TALLEST, max(LOWEST[beside], SHEET - used)) / MM
    room = Room(NARROW if beside else WIDE, high)
    return Front(
        facts_of(result, parties), warnings, more_warnings, answers, more_answers, shown,
        more_tables, certainty, more_certainty, room, beside,
    )  # fmt: skip


def _lines(texts: str | Sequence[str], kind: str) -> int:
    several = [texts] if isinstance(texts, str) else texts
    return sum(-(-len(text) // CHARACTERS[kind]) for text in several)


def _fitted(texts: Sequence[str], kind: str, most: int) -> tuple[list[str], list[str]]:
    """Split texts into those that fit in `most` lines (at least one), in order, and the rest."""
    texts, used = list(texts), 0
    for k, text in enumerate(texts):
        used += _lines(text, kind)
        if used > most and k:
            return texts[:k], texts[k:]
    return texts, []


def _cut(tables: Sequence[Table], order: list[int], left: int) -> tuple[list[Table], list[Table]]:
    """Tables cut to a number of rows, with single-line cells and at least one row of the first
    table; also the complete versions of tables that are cut or omitted."""
    shown: list[Table] = []
    more: list[Table] = []
    for k, table in enumerate(tables):
        rows = [tuple(map(in_line, row)) for row in table.texts()]
        room = max(left - HEAD, 0 if k else 1)
        if room < sum(map(_high, rows)):
            more.append(table)
            if k:
                continue
            most = max(1, room // max(map(_high, rows)))
            rows = [rows[k] for k in (order or range(len(rows)))[:most]]
        shown.append(table._replace(rows=rows))
        left -= HEAD + sum(map(_high, rows))
    return shown, more


def _high(row: Sequence[object]) -> int:
    """Height of a row in lines: one, or more for long names."""
    return -(-len(str(row[0])) // NAME)


def overview(
    result: xr.Dataset,
    terrain: Terrain | None,
    stops: np.ndarray | None,
    hazard: xr.Dataset | None,
    look: Look | None,
    room: Room,
) -> Iterator[tuple[str, Figure]]:
    """Title and map of page 1: hazard zones, else passages, else stops; nothing without them."""
    if hazard is not None:
        yield say("front.zones_of_hazard"), zones_figure(hazard, terrain, room)
    elif name := passed_map(result):
        yield say("front.pass_frequency"), map_figure(result, name, terrain, stops, look, room)
    elif has_rows(result):
        yield say("label.stopping_points"), stops_figure(result, terrain, stops, look, room)
