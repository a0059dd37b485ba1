# SPDX-License-Identifier: BSD-3-Clause
"""Tables for a terminal or a file."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import zip_longest

from rich.cells import cell_len  # columns on a terminal; the rest of rich takes long to import

MOST_LINES = 20  # evaluation lines that a terminal shows


def table(rows: Iterable[Iterable[str]]) -> str:
    """Columns as wide as their longest cell, the first left-aligned, the others right-aligned. A
    row of one cell is a heading of any length."""
    cells = [list(row) for row in rows]
    columns = zip_longest(*(row for row in cells if len(row) > 1), fillvalue="")
    widths = [max(map(cell_len, column)) for column in columns]
    return "\n".join(row[0] if len(row) == 1 else _line(row, widths) for row in cells)


def more_lines(lines: int) -> list[str]:
    """Note on how many evaluation lines are not shown, and where all are; none if all are shown."""
    more = lines - MOST_LINES
    return [f"  and {more:,} more: `rockfall lines OUT.nc -o FILE.csv` writes all"] * (more > 0)


def _line(row: list[str], widths: list[int]) -> str:
    blanks = [" " * (width - cell_len(cell)) for cell, width in zip(row, widths, strict=False)]
    first, *others = zip(row, blanks, strict=True)
    return "  ".join(["".join(first), *(blank + cell for cell, blank in others)]).rstrip()
