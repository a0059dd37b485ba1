# SPDX-License-Identifier: BSD-3-Clause
"""Tables for a terminal or a file, by rich."""

from __future__ import annotations

from collections.abc import Iterable

WIDE = 10_000  # characters: no row is broken, whatever the terminal


def table(rows: Iterable[Iterable[str]]) -> str:
    """Columns as wide as their longest cell, the first to the left, the others to the right. A row
    of one cell is a heading: it stands alone, however long."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    cells = [list(row) for row in rows]
    grid = Table.grid(padding=(0, 2, 0, 0))
    for k in range(max(map(len, cells))):
        grid.add_column(justify="right" if k else "left", no_wrap=True)
    for row in cells:
        grid.add_row(*(Text(cell) for cell in (row if len(row) > 1 else [""])))
    console = Console(width=WIDE, color_system=None, force_terminal=False)
    with console.capture() as text:
        console.print(grid)
    lines = [line.rstrip() for line in text.get().splitlines()]
    headed = zip(cells, lines, strict=True)
    return "\n".join(row[0] if len(row) == 1 else line for row, line in headed)
