# SPDX-License-Identifier: BSD-3-Clause
"""Text files with a point in each row (XYZ): the first line names the columns, or the first three
columns are used.

Shifted columns are refused, because values from a wrong column may look like elevations.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rockfall.errors import RockfallError
from rockfall.io.coordinates.length_units import Stated, refuse_units, unit_in_words
from rockfall.io.coordinates.projection_file import projection_heights
from rockfall.io.files import start_of
from rockfall.io.gdal_files import plain_file
from rockfall.io.tables import SEPARATOR_LINE
from rockfall.limits import MAX_REAL

if TYPE_CHECKING:
    import pandas as pd

TEXT = ".xyz"
#: Extensions of text files that may contain points.
MAYBE_TEXT = (".asc", ".txt", ".dat", ".xyz")
CHUNK = 1_000_000  # points
HEIGHTS = (-500.0, 9000.0)  # elevation range of all land [m]
#: Swapped coordinates: no national system has x above the first and y between the others [m].
NORTHING, LOCAL, EASTING = 2e6, 1e5, 1e6
#: Elevations that mark missing data.
MISSING = (-9999.0, -99999.0, -32767.0, -32768.0)

_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")
_IN_METRES = re.compile(r"[ _]?[\[(]m[\])]$")
_LONGER = re.compile(r"Expected \d+ fields in line (\d+), saw")
_COMMA_NUMBER = re.compile(r"[-+]?\d+,\d+")


class _Layout(NamedTuple):
    """Column layout of a text."""

    separator: str
    columns: tuple[int, int, int]  # indices of x, y and z
    total: int  # number of columns
    head: int  # number of header lines
    named: bool = True


def is_point_text(path: str | Path) -> bool:
    """Return True for an existing file with a text extension whose first line describes points:
    at least three numbers, or the names x, y and z. Text (.txt) with commas or semicolons is a
    table."""
    path = Path(path)
    if path.suffix.lower() not in MAYBE_TEXT or not path.is_file():
        return False
    line = first_line(start_of(path))
    cells, _ = _cells(line)
    names = [cell.lower().lstrip("#/") for cell in cells]
    if path.suffix.lower() == ".txt" and re.search("[,;]", line):
        return False  # the file is a table
    return is_row(line) or {"x", "y", "z"} <= set(names)


def is_row(line: str) -> bool:
    """Return True for a line with at least three numbers.

    >>> is_row("600000.5;5000000.5;812.3"), is_row("ncols 4")
    (True, False)
    """
    cells, _ = _cells(line)
    return len(cells) >= 3 and all(map(_NUMBER.fullmatch, cells))


def first_line(start: bytes) -> str:
    """First line of a file from its first bytes, without a byte order mark."""
    text = start.decode("utf-8-sig", "replace")
    return text.splitlines()[0].strip() if text.strip() else ""


def text_chunks(path: str | Path) -> Iterator[np.ndarray]:
    """Yield chunks (n, 3) of x, y, z [m]. Refuses rows that are not numbers."""
    import pandas as pd

    name, layout = plain_file(path), _layout(path)
    first = True
    try:
        with pd.read_csv(
            name, sep=layout.separator, header=None, skiprows=layout.head,
            dtype={column: np.float64 for column in layout.columns}, chunksize=CHUNK,
            index_col=False, encoding="utf-8-sig", na_values=[""], keep_default_na=False,
        ) as reader:  # fmt: skip
            for table in reader:
                _check_rows(path, table, layout, first)
                first = False
                yield table[list(layout.columns)].to_numpy()
    except pd.errors.EmptyDataError:
        return
    except RockfallError:  # subclass of ValueError
        raise
    except (ValueError, OverflowError, MemoryError) as error:  # includes ParserError
        if longer := _LONGER.search(str(error)):
            raise RockfallError(_longer(path, int(longer[1]), layout)) from error
        raise RockfallError(f"{path}: does not consist of rows of numbers ({error})") from error


def _longer(path: str | Path, line: int, layout: _Layout) -> str:
    return (
        f"{path}: line {line}: more than the {layout.total} columns of line 1: name every column "
        "in line 1"
    )


def _check_rows(path: str | Path, table: pd.DataFrame, layout: _Layout, first: bool) -> None:
    """Refuse rows longer than the first line, and unnamed columns that are not x, y, z."""
    surplus = table.iloc[:, layout.total :].notna().any(axis=1)  # a separator may end a line
    if surplus.any():
        line = int(table.index[surplus][0]) + 1 + layout.head
        raise RockfallError(_longer(path, line, layout))
    if layout.named:
        return
    cure = "name the columns in a first line, such as x y z"
    x, y, z = (table[column].to_numpy() for column in layout.columns)
    if first and layout.total > 3 and len(x) > 2 and (np.diff(x) == 1).all() and x[0] in (0, 1):
        raise RockfallError(f"{path}: the first column is a row number: {cure}")
    if first and len(x) and min(x) > NORTHING and LOCAL < max(y) < EASTING:
        raise RockfallError(f"{path}: x {x[0]:.0f}, y {y[0]:.0f} look exchanged: {cure}")
    odd = ~((z >= HEIGHTS[0]) & (z <= HEIGHTS[1])) & ~np.isin(z, MISSING) & (abs(z) <= MAX_REAL)
    for row in np.flatnonzero(odd)[:1].tolist():
        line = int(table.index[row]) + 1 + layout.head
        raise RockfallError(
            f"{path}: line {line}: the third column, {z[row]:.10g}, is not a plausible "
            f"land elevation [m]: {cure}"
        )


def _cells(line: str) -> tuple[list[str], str]:
    """Cells of a line, and the separator in pandas notation."""
    for mark in ";", ",":
        decimal = mark == "," and len(line.split()) > 2
        decimal = decimal and all(map(_COMMA_NUMBER.fullmatch, line.split()[:3]))
        if mark in line and not decimal:
            return [cell.strip() for cell in line.split(mark)], mark
    return line.split(), r"\s+"


def _in_metres(path: Path, factor: str, cells: list[str], separator: str, head: int) -> str:
    """Command that writes the points after the header, with z multiplied by a factor."""
    is_head = not all(map(_NUMBER.fullmatch, filter(None, cells)))
    names = [cell.lower().lstrip("#/")[:1] for cell in cells] if is_head else ["x", "y", "z"]
    names = names[1:] if names[0] == "" else names
    x, y, z = (names.index(axis) + 1 if axis in names else k for k, axis in enumerate("xyz", 1))
    skip = f"NR > {head + is_head} " if head + is_head else ""
    program = f'{skip}{{printf "%s %s %.4f\\n", ${x}, ${y}, ${z} * {factor}}}'
    options = [] if separator == r"\s+" else ["-F", separator]
    made = shlex.quote(str(path.with_name(f"{path.stem}_m.xyz")))
    return f"{shlex.join(['awk', *options, program, str(path)])} > {made}"


def _layout(path: str | Path) -> _Layout:
    line, head = first_line(start_of(path)), 0
    if SEPARATOR_LINE.fullmatch(line):
        line, head = first_line(start_of(path).partition(b"\n")[2]), 1
    cells, separator = _cells(line)
    unit = unit_in_words(line)
    stated = [*projection_heights(path), *([Stated(unit, "line 1")] if unit else [])]
    refuse_units(
        path, stated, lambda factor: _in_metres(Path(path), factor, cells, separator, head)
    )
    if any(map(_COMMA_NUMBER.fullmatch, cells)):
        raise RockfallError(f"{path}: line 1: has decimal commas: use decimal points")
    if all(map(_NUMBER.fullmatch, filter(None, cells))):
        if len(cells) < 3:
            raise RockfallError(f"{path}: line 1: {len(cells)} columns: must have x, y and z")
        return _Layout(separator, (0, 1, 2), len(cells), head, False)
    if len(cells) > 1 and cells[0] in ("#", "//"):
        del cells[0]
    names = [_IN_METRES.sub("", name.lower().lstrip("#/").strip(' "')) for name in cells]
    for axis in "xyz":
        if names.count(axis) != 1:
            raise RockfallError(
                f"{path}: line 1: must have exactly one column {axis}, or contain only numbers"
            )
    x, y, z = map(names.index, "xyz")
    return _Layout(separator, (x, y, z), len(names), head + 1)
