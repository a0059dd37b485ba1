# SPDX-License-Identifier: BSD-3-Clause
"""Hazard map on an A3 sheet, in the form published by authorities: zones, a title block that
explains them and lists the inputs, and pages with all warnings.

Positions are in inches from the lower left corner of the paper.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import xarray as xr

from rockfall.analysis.hazard.classes import CLASSES, Matrix
from rockfall.analysis.validity.rebounds import followed_text
from rockfall.case import case_in
from rockfall.case.files import read_names
from rockfall.files.hazard_files import HAZARD_COLOURS
from rockfall.language import Number, localised, say, word
from rockfall.plots.cartography.sheet import INCH, LEFT, Room, Sheet, crs_text, finish, named_crs
from rockfall.plots.hazard.hazard_figures import HATCH, OPAQUE, begun, draw_zones
from rockfall.plots.style import INK, STYLE, plain, styled
from rockfall.quantities import number
from rockfall.result.grounds import program_text
from rockfall.result.trajectories import Terrain

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WIDE, HIGH = 420 / 25.4, 297 / 25.4
#: Paper margin, title block width, gap next to the map [inch].
MARGIN, BLOCK, GAP = 10 / 25.4, 95 / 25.4, 6 / 25.4
SMALL, NORMAL, LARGE = 7.0, 8.0, 13.0  # font sizes [pt]
LETTER = 0.52  # mean letter width relative to the font size
BOX, ROW = 0.2, 0.24  # side of a colour in the legend, height of a table row [inch]
BETWEEN = 0.14  # gap between parts of the title block [inch]
COLUMNS = 3  # number of text columns on a page of warnings
COLUMN = (WIDE - 2 * MARGIN - (COLUMNS - 1) * GAP) / COLUMNS  # column width [inch]
LINE = 1.35 * NORMAL / 72  # line height [inch]
MAX_FILES = 8
SHOWN = ("high", "moderate", "low", "residual")  # classes in the legend


class Imprint(NamedTuple):
    """Sheet details given by the user; missing details leave blank lines."""

    project: str = ""
    client: str = ""
    author: str = ""


NOBODY = Imprint()


@styled
def hazard_sheet(
    hazard: xr.Dataset,
    terrain: Terrain | None = None,
    imprint: Imprint = NOBODY,
    warnings: Sequence[str] = (),
) -> Figure:
    """Map of the zones of a hazard on A3, with a title block."""
    room = Room(WIDE - 2 * MARGIN - BLOCK - GAP, HIGH - 2 * MARGIN)
    sheet = begun(hazard, terrain, [], room)
    sheet.paper = "A3"
    draw_zones(sheet, hazard)
    finish(sheet, hazard["crs"].attrs)
    _place_on_paper(sheet)
    block = _Block(sheet.figure)
    _write_title(block, hazard, imprint)
    _write_legend(block)
    _write_matrix(block, hazard)
    _write_scenarios(block, hazard)
    _write_method(block, hazard)
    _write_sources(block, hazard, sheet)
    _write_warnings(block, warnings)
    return sheet.figure


def _place_on_paper(sheet: Sheet) -> None:
    """Move the map, which fills a figure, to the lower left of the paper. Elements placed in
    inches keep their position; others keep their size."""
    figure = sheet.figure
    wide, high = figure.get_size_inches()
    places = {axes: axes.get_position() for axes in figure.axes}
    figure.set_size_inches(WIDE, HIGH)
    for axes, at in places.items():
        axes.set_position(
            (
                at.x0 * wide / WIDE,
                at.y0 * high / HIGH,
                at.width * wide / WIDE,
                at.height * high / HIGH,
            )
        )


def wrapped(text: str, wide: float, size: float, most: int = 0) -> list[str]:
    """Lines of a paragraph wrapped to the width `wide` [inch], at most `most` unless 0."""
    letters = int(wide * 72 / (LETTER * size))
    how: dict[str, Any] = {"max_lines": most or None, "placeholder": " ..."}
    return textwrap.wrap(text, letters, break_on_hyphens=False, **how) or [""]


class _Block:
    """Title block, written from top to bottom."""

    def __init__(self, figure: Figure) -> None:
        from matplotlib.patches import Rectangle

        self.figure, self.left, self.y = figure, WIDE - MARGIN - BLOCK, HIGH - MARGIN
        self.inches: dict[str, Any] = {"transform": figure.dpi_scale_trans}
        frame = Rectangle((self.left, MARGIN), BLOCK, HIGH - 2 * MARGIN, **self.inches)
        frame.set(facecolor="white", edgecolor=INK, linewidth=0.8)
        figure.add_artist(frame)
        self.left += 0.12
        self.wide = BLOCK - 0.24
        self.skip(0.12)

    def skip(self, high: float = BETWEEN) -> None:
        self.y -= high

    def write(self, text: str, size: float = NORMAL, weight: str = "normal", most: int = 0) -> None:
        """Write a paragraph of at most `most` lines."""
        for line in wrapped(text, self.wide, size, most):
            self.put(self.left, line, size, fontweight=weight)
            self.skip(1.35 * size / 72)

    def put(self, x: float, text: str, size: float = NORMAL, **options: Any) -> None:
        """Write a line whose top is at the current position."""
        usual: dict[str, Any] = {"fontsize": size, "va": "top", "color": INK}
        self.figure.text(x, self.y, plain(text), **usual | options | self.inches)

    def fill(self, x: float, wide: float, high: float, **options: Any) -> None:
        """Draw a rectangle whose top is at the current position."""
        from matplotlib.patches import Rectangle

        usual: dict[str, Any] = {"edgecolor": INK, "linewidth": 0.5}
        corner = x, self.y - high
        self.figure.add_artist(Rectangle(corner, wide, high, **usual | options | self.inches))


def _write_title(block: _Block, hazard: xr.Dataset, imprint: Imprint) -> None:
    block.write(hazard.attrs["title"] or Path(hazard.attrs["case_file"]).stem, LARGE, "bold", 3)
    block.write(say("sheet.title"), NORMAL + 2)
    block.skip()
    for label, value in (
        (say("sheet.project"), imprint.project),
        (say("sheet.client"), imprint.client),
        (say("sheet.author"), imprint.author),
        (say("sheet.signature"), ""),
        (say("sheet.computed"), str(hazard.attrs.get("date_created", ""))[:10]),
    ):
        block.write(say("join.colon", before=label, after=value or "_" * 30), most=2)
    block.skip()


def _write_legend(block: _Block) -> None:
    for name in SHOWN:
        colour = HAZARD_COLOURS[CLASSES.index(name)]
        block.fill(block.left, 1.6 * BOX, BOX, facecolor=colour, alpha=OPAQUE)
        block.put(block.left + 2 * BOX, word(name))
        block.skip(BOX + 0.06)
    block.fill(block.left, 1.6 * BOX, BOX, facecolor="none", hatch=HATCH)
    block.put(block.left + 2 * BOX, say("sheet.uncertain"))
    block.skip(BOX + 0.06 + BETWEEN)


def _write_matrix(block: _Block, hazard: xr.Dataset) -> None:
    """Write the classes by energy and return period, highest energy at the top."""
    case = case_in(hazard.attrs)
    matrix, first = Matrix.of(case), 0.34 * block.wide
    column = (block.wide - first) / len(matrix.periods)
    block.write(say("sheet.matrix"), SMALL)
    for k, period in enumerate(matrix.periods.tolist()):
        middle = block.left + first + (k + 0.5) * column
        block.put(middle, say("sheet.years", n=Number(f"{period:g}")), SMALL, ha="center")
    block.skip(0.18)
    for energy, classes in reversed(list(zip(_energies(case), matrix.classes[1:], strict=True))):
        block.put(block.left, energy, SMALL)
        for k, class_ in enumerate(classes.tolist()):
            style = {"facecolor": HAZARD_COLOURS[class_], "alpha": OPAQUE}
            block.fill(block.left + first + k * column, column, ROW, **style)
        block.skip(ROW)
    block.skip()


def _energies(case: Any) -> Iterator[str]:
    """Labels of the intensities, weakest first."""
    ends = [f"{threshold:g}" for threshold in case.hazard["thresholds"]]
    yield say("sheet.up_to", high=Number(ends[0]))
    for low, high in zip(ends[:-1], ends[1:], strict=True):
        yield say("sheet.between", low=Number(low), high=Number(high))
    yield say("sheet.above", low=Number(ends[-1]))


def _write_scenarios(block: _Block, hazard: xr.Dataset) -> None:
    block.write(say("sheet.scenarios"), NORMAL, "bold")
    columns = (hazard[name].values for name in ("scenario", "frequency", "boulders"))
    for name, yearly, boulders in zip(*columns, strict=True):
        style = {"yearly": Number(number(yearly)), "boulders": int(boulders)}
        text = say("join.colon", before=name, after=say("sheet.scenario", **style))
        block.write(text, SMALL, most=2)
    block.write(say("hazard.population"), SMALL)
    block.skip()


def _write_method(block: _Block, hazard: xr.Dataset) -> None:
    asked = case_in(hazard.attrs).hazard
    block.write(say("sheet.method"), NORMAL, "bold")
    block.write(say("sheet.frequency", width=Number(f"{asked['object_width']:g}")), SMALL)
    if asked["minimum_width"]:
        block.write(say("sheet.outlines", width=Number(f"{asked['minimum_width']:g}")), SMALL)
    if asked["minimum_area"]:
        block.write(say("sheet.area", area=Number(f"{asked['minimum_area']:g}")), SMALL)
    block.skip()


def _write_sources(block: _Block, hazard: xr.Dataset, sheet: Sheet) -> None:
    block.write(say("sheet.sources"), NORMAL, "bold")
    files = read_names(case_in(hazard.attrs))
    more = [f"+ {len(files) - MAX_FILES}"] if len(files) > MAX_FILES else []
    block.write(", ".join([*files[:MAX_FILES], *more]) or say("sheet.no_files"), SMALL, most=3)
    followed = followed_text(hazard, str(hazard.attrs["impact_set"]))
    block.write(say("sheet.rebounds", followed=followed), SMALL, most=6)
    crs = hazard["crs"].attrs
    block.write(crs_text(crs) if named_crs(crs) else say("sheet.no_crs"), SMALL, most=2)
    block.write(f"1:{localised(f'{sheet.scale / INCH:,.0f}')} ({sheet.paper})", SMALL)
    block.write(program_text(hazard), SMALL, most=4)
    block.skip()


def _write_warnings(block: _Block, warnings: Sequence[str]) -> None:
    """Write the number of warnings, where all are listed, and as many complete warnings as fit: a
    shortened warning might lose the words "errs low"."""
    if not warnings:
        return
    block.write(say("sheet.warnings", n=len(warnings)), NORMAL, "bold")
    for text in warnings:
        lines = len(wrapped(text, block.wide, SMALL))
        if block.y - lines * 1.35 * SMALL / 72 < MARGIN + LEFT:
            break
        block.write(text, SMALL)


def warning_pages(hazard: xr.Dataset, groups: Iterable[tuple[str, Sequence[str]]]) -> list[Figure]:
    """A3 pages with all warnings, by scenario names ("" for all scenarios)."""
    import matplotlib

    with matplotlib.rc_context(STYLE):
        pages: list[_Page] = []
        for line in _warning_lines(groups):
            if not pages or not pages[-1].has_room(line):
                pages.append(_Page(hazard, len(pages) + 2))
            pages[-1].write(line)
        return [page.figure for page in pages]


class _Line(NamedTuple):
    """A line on a page: text, height with the gap below, and True for a heading."""

    text: str
    height: float
    is_head: bool = False


def _warning_lines(groups: Iterable[tuple[str, Sequence[str]]]) -> Iterator[_Line]:
    for names, texts in groups:
        for text in wrapped(names or say("sheet.all_scenarios"), COLUMN, NORMAL):
            yield _Line(text, LINE, is_head=True)
        for text in texts:
            *lines, last = wrapped(text, COLUMN, NORMAL)
            yield from (_Line(line, LINE) for line in lines)
            yield _Line(last, LINE + BETWEEN)


class _Page:
    """An A3 page with lines in columns."""

    def __init__(self, hazard: xr.Dataset, page: int) -> None:
        from matplotlib.figure import Figure

        self.figure, self.column = Figure(figsize=(WIDE, HIGH)), 0
        title = hazard.attrs["title"] or Path(hazard.attrs["case_file"]).stem
        top = HIGH - MARGIN
        self._put(MARGIN, top, wrapped(title, WIDE / 2, LARGE, 1)[0], LARGE, fontweight="bold")
        self._put(WIDE - MARGIN, top, say("sheet.page", page=page), NORMAL, ha="right")
        self._put(MARGIN, top - 0.3, say("sheet.all_warnings"), NORMAL + 2)
        self.top = self.y = top - 0.7

    def _put(self, x: float, y: float, text: str, size: float, **options: Any) -> None:
        where: dict[str, Any] = {"transform": self.figure.dpi_scale_trans, "va": "top"}
        self.figure.text(x, y, plain(text), fontsize=size, color=INK, **where | options)

    def has_room(self, line: _Line) -> bool:
        """Return True if a line fits here or in the next column."""
        return self._fits(line) or self.column + 1 < COLUMNS

    def _fits(self, line: _Line) -> bool:
        """Return True if a line fits here; a heading must fit together with lines below it."""
        return self.y - (4 * LINE if line.is_head else LINE) >= MARGIN

    def write(self, line: _Line) -> None:
        """Write a line; start the next column if this one is full."""
        if not self._fits(line):
            self.column, self.y = self.column + 1, self.top
        weight = "bold" if line.is_head else "normal"
        x = MARGIN + self.column * (COLUMN + GAP)
        self._put(x, self.y, line.text, NORMAL, fontweight=weight)
        self.y -= line.height
