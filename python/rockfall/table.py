# SPDX-License-Identifier: BSD-3-Clause
"""Tables of columns and rows, independent of the output format.

Each format has a renderer: `as_text` (terminal) and `write_csv` in this module, the macro `table`
in html_report/templates/parts.html.j2, office/workbook.py and office/document.py.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import zip_longest
from numbers import Integral, Real
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Self

from rich.cells import cell_len  # text width in terminal columns; importing all of rich takes long

from rockfall.io import tables
from rockfall.language import Number, Text, say, translated
from rockfall.quantities import COLUMN_UNITS, QUANTITIES, Quantity, number, statistic, with_unit
from rockfall.result.variables import ENDS

if TYPE_CHECKING:
    import pandas as pd

TOO_FEW = "(–)"  # shown instead of an interval if there are too few boulders for a valid interval
BY_ROW = "unit"  # column of a data table with the unit of each row
HEAD = 16  # letters in the terminal at which column heads wrap, unless a cell is wider
WIDEST = 120  # maximum line width in the terminal
LETTERS = 108  # maximum total width of the numbers in a row, next to a label, on an upright A4 page


class Estimate(NamedTuple):
    """A table cell: a number and the limits of its interval, in the unit of its column; NaN if
    unknown.

    All are shown with `digits` significant digits or, by default, with the digits that the
    interval justifies: the unit of the last digit is 1/20 to 1/2 of the half-width. `up` rounds
    up, for required minima.
    """

    value: float
    low: float = math.nan
    high: float = math.nan
    digits: int | None = None
    up: bool = False
    decimals: int | None = None  # fixed number of decimals, regardless of the interval

    @classmethod
    def of(cls, row: Mapping[Any, Any], name: str, factor: float = 1.0, **how: Any) -> Self:
        """Cell from the columns NAME, NAME_low and NAME_high (if present) of a row."""
        return cls(*(factor * row.get(f"{name}{end}", math.nan) for end in ENDS), **how)

    @property
    def has_interval(self) -> bool:
        """Return True if at least one limit is known."""
        return not (math.isnan(self.low) and math.isnan(self.high))

    @property
    def justified(self) -> int:
        """Number of decimals that the interval justifies."""
        limits = [end for end in (self.low, self.high) if not math.isnan(end)]
        half = max(abs(self.value - end) for end in limits)
        if not half:
            return 2
        largest = max(abs(self.value), *map(abs, limits))
        most = max(4, 1 - math.floor(math.log10(largest)))  # keeps a digit of small values
        return min(most, -math.floor(math.log10(half / 2)))

    def shown(self, value: float, *, up: bool = False) -> Number:
        """Format the number, or a limit, with the digits of the cell."""
        if self.digits or not self.has_interval:
            return number(value, self.digits or 3, up=up)
        decimals = self.justified if self.decimals is None else self.decimals
        near = round(value, decimals)
        return Number("-" if math.isnan(value) else f"{near:,.{max(decimals, 0)}f}")

    @property
    def number(self) -> Number:
        return self.shown(self.value, up=self.up)

    @property
    def interval(self) -> str:
        """The interval in brackets. Without limits: `TOO_FEW`, or "" if the number is unknown or
        has fixed `digits`."""
        if not self.has_interval:
            return "" if self.digits or math.isnan(self.value) else TOO_FEW
        low, high = self.shown(self.low), self.shown(self.high, up=self.up)
        return TOO_FEW if low == high == "-" else between(low, high)

    def __str__(self) -> str:
        return stacked(self.number, *filter(None, [self.interval]))


def open_limits(cells: Iterable[object]) -> Iterator[Text]:
    """Explanation of limits that too few boulders leave open, if cells have any."""
    estimates = [cell for cell in cells if isinstance(cell, Estimate)]
    if any(math.isfinite(cell.low) != math.isfinite(cell.high) for cell in estimates):
        yield say("summary.where_only_one_limit_is_given")
    if any(cell.interval == TOO_FEW for cell in estimates):
        yield say("summary.a_dash_in_brackets_too_few")


def in_line(cell: object) -> str:
    """Text of a multi-line cell, joined to one line."""
    return translated(cell).replace("\n", " ")


def stacked(*lines: object) -> str:
    """Cell with several lines, in the current language."""
    return "\n".join(map(translated, lines))


def between(low: object, high: object) -> str:
    """Format two limits in brackets; if one is unknown ("-"), as "from" or "up to" the other."""
    if low == high == "-":
        return "-"
    if high == "-":
        return say("interval.from", low=low)
    if low == "-":
        return say("interval.up_to", high=high)
    if "-" in f"{low}{high}":  # minus sign of a negative limit, which an en dash would hide
        return f"({say('interval.range', low=low, high=high)})"
    return say("interval.both", low=low, high=high)


class Column(NamedTuple):
    """A table column: label (in a data table: name), unit, and decimals shown in texts (None:
    three significant digits)."""

    label: str = ""
    unit: str = ""
    decimals: int | None = None

    @classmethod
    def of(cls, display: Quantity, number: str, *, short: bool = False) -> Column:
        """Column for a statistic of a quantity: short, such as E_tot, q95 [kJ], or in words."""
        words = (display.name, number) if short else (display.label, statistic(number))
        return cls(", ".join(words), display.unit, display.decimals)

    @property
    def title(self) -> str:
        """Label and unit."""
        return with_unit(translated(self.label), self.unit) if self.unit else self.label

    def text(self, cell: object) -> str:
        """Text of a cell in the current language; it may have several lines."""
        if isinstance(cell, Integral) and not isinstance(cell, bool):
            return translated(Number(f"{int(cell):,}"))
        if isinstance(cell, Real):
            value, is_exact = float(cell), self.decimals is not None and math.isfinite(cell)
            return translated(Number(f"{value:,.{self.decimals}f}") if is_exact else number(value))
        return translated(cell)


class Table(NamedTuple):
    """A table. Cells are texts (of one or several lines), numbers in the units of their columns,
    or estimates. A row with a single text is a heading. `kind` is the CSS class."""

    caption: str
    columns: Sequence[Column]
    rows: Sequence[Sequence[object]]
    kind: str = "numbers"

    @classmethod
    def of(
        cls, caption: str, heads: Iterable[str | Column], rows: Iterable[Sequence[object]],
        kind: str = "numbers",
    ) -> Table:  # fmt: skip
        """Table from column heads; a plain text becomes a column without a unit."""
        columns = [head if isinstance(head, Column) else Column(head) for head in heads]
        return cls(caption, columns, [*rows], kind)

    @property
    def head(self) -> list[str]:
        return [column.title for column in self.columns]

    def texts(self) -> Iterator[list[str]]:
        """Texts of all cells in the current language."""
        for row in self.rows:
            yield [column.text(cell) for column, cell in zip(self.columns, row, strict=False)]

    def is_crowded(self) -> bool:
        """Return True if the numbers are too wide for one line on A4, so that cells may wrap."""
        columns = zip(*(row[1:] for row in self.texts() if len(row) > 1), strict=True)
        longest = (max(map(len, "\n".join(column).split("\n"))) for column in columns)
        return sum(1 + letters for letters in longest) > LETTERS

    def data(self, ends: Sequence[str] = ENDS) -> tuple[list[Column], Iterator[list[object]]]:
        """Columns and rows. A column with estimates becomes one column for the value and one for
        each limit, whose labels end in `ends`."""
        columns: list[Column] = []
        split = [any(isinstance(row[k], Estimate) for row in self.rows if len(row) > k)
                 for k in range(len(self.columns))]  # fmt: skip
        for column, is_split in zip(self.columns, split, strict=True):
            own = ends if is_split else ("",)
            columns += [column._replace(label=f"{column.label}{end}") for end in own]
        return columns, (_spread(row, split) for row in self.rows)


def _spread(row: Sequence[object], split: Sequence[bool]) -> list[object]:
    cells: list[object] = []
    for cell, is_split in zip_longest(row, split, fillvalue=None):
        limits = cell[:3] if isinstance(cell, Estimate) else (cell, None, None)
        cells += limits if is_split else [cell]
    return cells


def data_table(frame: pd.DataFrame) -> Table:
    """Convert a data frame. Units are as in results, by column or, with a column `quantity`, by
    row."""
    by_row = "quantity" in frame.columns
    if by_row:
        frame = frame.copy()
        units = [QUANTITIES[name].units for name in frame["quantity"]]
        frame.insert(frame.columns.get_loc("quantity") + 1, BY_ROW, units)
    columns = []
    for name in map(str, frame.columns):
        stem = name.removesuffix("_low").removesuffix("_high")
        unit = "" if by_row and stem != "fraction" else COLUMN_UNITS.get(stem, "")
        columns.append(Column(name, unit))
    return Table("", columns, [*frame.itertuples(index=False, name=None)])


def as_text(table: Table, indent: str = "  ") -> str:
    """Format a table for a terminal, without its caption. The first column is left-aligned, the
    others right-aligned. Long heads wrap. Columns that do not fit follow below, next to a copy of
    the first column."""
    cells = [*table.texts()]
    head = [[_wrapped(name, cells, k) for k, name in enumerate(table.head)]] * any(table.head)
    lines: list[list[str]] = []
    for row in [*head, *cells]:
        split = (cell.split("\n") for cell in row)
        lines += [[row[0]]] if len(row) == 1 else map(list, zip_longest(*split, fillvalue=""))
    columns = zip(*(line for line in lines if len(line) > 1), strict=True)
    widths = [max(map(cell_len, column)) for column in columns]
    return "\n".join(
        indent + (line[0] if len(line) == 1 else _aligned([line[k] for k in part], part, widths))
        for part in _parts(widths, WIDEST - len(indent))
        for line in lines
        if len(line) == 1 or any(line[k] for k in part)
    )


def _wrapped(head: str, rows: Sequence[Sequence[str]], k: int) -> str:
    """Head of column k > 0, wrapped to about the width of its cells."""
    if not k:
        return head
    lines = (line for row in rows if len(row) > 1 for line in row[k].split("\n"))
    return "\n".join(textwrap.wrap(head, max([HEAD, *map(cell_len, lines)]))) or head


def _parts(widths: Sequence[int], room: int) -> list[list[int]]:
    """Column indices in groups that fit into `room` letters; each group starts with column 0."""
    parts: list[list[int]] = [[0][: len(widths)]]
    for k in range(1, len(widths)):
        if len(parts[-1]) > 1 and sum(2 + widths[j] for j in (*parts[-1], k)) - 2 > room:
            parts.append([0])
        parts[-1].append(k)
    return parts


def _aligned(cells: Sequence[str], part: Sequence[int], widths: Sequence[int]) -> str:
    blanks = (" " * (widths[k] - cell_len(cell)) for k, cell in zip(part, cells, strict=True))
    first, *others = zip(cells, blanks, strict=True)
    return "  ".join(["".join(first), *(blank + cell for cell, blank in others)]).rstrip()


def write_csv(table: Table, path: str | Path) -> None:
    """Write a table as CSV with unrounded numbers, atomically; texts cannot run as formulas in a
    spreadsheet."""
    import pandas as pd

    columns, rows = table.data()
    tables.write_csv(pd.DataFrame([*rows], columns=[column.title for column in columns]), path)
