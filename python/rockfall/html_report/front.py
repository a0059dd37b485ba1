# SPDX-License-Identifier: BSD-3-Clause
"""Page 1 of a report, which is signed: what it holds is cut to a sheet of A4, and says so.

Neither WeasyPrint nor a browser shrinks a map until a page fits, and a map that is shrunk has
another scale. So texts are cut to a number of lines, and the map is drawn for what they leave.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple

from rockfall.html_report.tables import Table
from rockfall.plots.cartography.sheet import Room
from rockfall.plots.extent import passed_map, reached
from rockfall.plots.hazard_figures import zones_figure
from rockfall.plots.map_figures import map_figure, stops_figure
from rockfall.plots.style import NARROW, WIDE
from rockfall.result.samples import has_rows

if TYPE_CHECKING:
    import numpy as np
    import xarray as xr
    from matplotlib.figure import Figure

    from rockfall.html_report.inputs import Parties
    from rockfall.html_report.intervals import Rows
    from rockfall.html_report.language import Speaker
    from rockfall.plots.map_figures import Look
    from rockfall.result.trajectories import Terrain

MM = 25.4  # of an inch
SHEET = 263.0  # height between the margins [mm]; templates/page.css has the margins
FIXED = 54.0  # of it: project, author, date; headings, signature, and the space between parts [mm]
WARNING_LINES, ANSWER_LINES, SURE_LINES, BESIDE_LINES = 8, 8, 6, 14  # at most
HEAD = 4  # rows that the caption and the head of a table take
CHARACTERS = {"title": 62, "question": 95, "warning": 104, "answer": 88, "sure": 112, "narrow": 50}
LINE = {"title": 7.0, "question": 5.0, "warning": 3.9, "answer": 4.6, "sure": 3.9}  # [mm]
ROW = 4.3  # of a table [mm]
BETWEEN, MORE = 1.2, 4.5  # two paragraphs; a line that says that there are more [mm]
NAME = 15  # letters of the first cell of a row
LOWEST = {True: 62.0, False: 45.0}  # of a map with words beside it, of a broad one [mm]
TALLEST = 165.0  # [mm]
UPRIGHT = 0.8  # height by width from which a map leaves room for words beside it


class Front(NamedTuple):
    """What page 1 holds, and after each part how many of its kind stand on later pages alone."""

    facts: list[tuple[str, str]]  # label, value; "" is a place to write
    warnings: list[str]
    more_warnings: list[str]
    answers: list[str]
    more_answers: list[str]
    tables: list[Table]
    more_tables: list[Table]  # whole, where page 1 has a part
    certainty: list[str]
    more_certainty: list[str]
    room: Room  # of the map
    beside: bool  # the words stand beside the map, not above it


def front_of(
    result: xr.Dataset,
    rows: Rows,
    parties: Parties,
    texts: dict[str, Sequence[str]],
    tables: Sequence[Table],
    say: Speaker,
) -> Front:
    """Page 1 of these texts (title, question, warnings, answers, certainty) and tables, as long as
    they are in the language of the page."""
    fit = _fitter(say)
    west, east, south, north = reached(result)
    beside = (north - south) > UPRIGHT * (east - west)
    warnings, more_warnings = fit(texts["warnings"], "warning", WARNING_LINES)
    order = _most_passed(rows)
    sentences = [texts["answers"][k] for k in order] + list(texts["answers"][len(rows) :])
    answers, more_answers = fit(sentences, "answer", ANSWER_LINES)
    sure = "narrow" if beside else "sure"
    most = BESIDE_LINES if beside else SURE_LINES
    certainty, more_certainty = fit(texts["certainty"], sure, most)
    lines = {
        "title": min(
            2, -(-len(texts["title"]) // CHARACTERS["title"])
        ),  # of the user: not translated
        "question": _lines(say, texts["question"], "question"),
        "warning": _lines(say, warnings, "warning"),
        "answer": _lines(say, answers, "answer"),
        "sure": 0 if beside else _lines(say, certainty, "sure"),
    }
    used = FIXED + sum(LINE[kind] * n for kind, n in lines.items())
    used += BETWEEN * len([*warnings, *answers, *([] if beside else certainty)])
    used += MORE * sum(map(bool, (more_warnings, more_answers)))
    shown, more_tables = _cut(tables, order, int((SHEET - used - LOWEST[beside]) / ROW))
    used += ROW * sum(HEAD + sum(map(_high, one.rows)) for one in shown)
    high = min(TALLEST, max(LOWEST[beside], SHEET - used)) / MM
    room = Room(NARROW if beside else WIDE, high)
    return Front(
        _facts(result, parties, say), warnings, more_warnings, answers, more_answers, shown,
        more_tables, certainty, more_certainty, room, beside,
    )  # fmt: skip


def _facts(result: xr.Dataset, parties: Parties, say: Speaker) -> list[tuple[str, str]]:
    """Whose report it is, and of which run."""
    program, _, _ = str(result.attrs["source"]).partition(", ")
    return [
        ("Project", parties.project),
        ("Client", parties.client),
        ("date of the run", str(result.attrs.get("date_created", ""))[:10] or say("not recorded")),
        ("program", program),
        ("result (SHA-256)", parties.result or say("not read from a file")),
    ]


def _lines(say: Speaker, texts: str | Sequence[str], kind: str) -> int:
    several = [texts] if isinstance(texts, str) else texts
    return sum(-(-len(say(text)) // CHARACTERS[kind]) for text in several)


def _fitter(say: Speaker) -> Callable[[Sequence[str], str, int], tuple[list[str], list[str]]]:
    def fit(texts: Sequence[str], kind: str, most: int) -> tuple[list[str], list[str]]:
        """Those that take so many lines at most, the first ones; and the others."""
        texts, used = list(texts), 0
        for k, text in enumerate(texts):
            used += _lines(say, text, kind)
            if used > most and k:
                return texts[:k], texts[k:]
        return texts, []

    return fit


def _most_passed(rows: Rows) -> list[int]:
    """The lines, those that most boulders pass first: a page may have no room for all."""
    passed = [numbers["speed"]["n"] for numbers in rows.values()]
    return sorted(range(len(passed)), key=lambda k: -passed[k])


def _cut(tables: Sequence[Table], order: list[int], left: int) -> tuple[list[Table], list[Table]]:
    """The tables that so many rows have room for, in cells of one line, of the first one at least
    a row; and whole those that are cut or left out."""
    shown: list[Table] = []
    more: list[Table] = []
    for k, one in enumerate(tables):
        rows = [tuple(_on_one_line(cell) for cell in row) for row in one.rows]
        room = max(left - HEAD, 0 if k else 1)
        if room < sum(map(_high, rows)):
            more.append(one)
            if k:
                continue
            rows = [rows[k] for k in order[: max(1, room // max(map(_high, rows)))]]
        shown.append(one._replace(rows=rows))
        left -= HEAD + sum(map(_high, rows))
    return shown, more


def _high(row: Sequence[object]) -> int:
    """Lines of a row: its cells have one, its name may have more."""
    return -(-len(str(row[0])) // NAME)


def _on_one_line(cell: object) -> str:
    return " ".join(str(cell).split("\n"))


def overview(
    result: xr.Dataset,
    terrain: Terrain | None,
    stops: np.ndarray | None,
    hazard: xr.Dataset | None,
    look: Look | None,
    room: Room,
) -> Iterator[tuple[str, Figure]]:
    """The map of page 1 and its title: zones of hazard, or where boulders pass, or where they came
    to rest; none where the result has none."""
    if hazard is not None:
        yield "Zones of hazard", zones_figure(hazard, terrain, room)
    elif name := passed_map(result):
        yield "Pass frequency", map_figure(result, name, terrain, stops, look, room)
    elif has_rows(result):
        yield "Stopping points", stops_figure(result, terrain, stops, look, room)
