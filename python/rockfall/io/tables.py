# SPDX-License-Identifier: BSD-3-Clause
"""Reading of users' CSV tables, and writing of CSV tables for spreadsheets."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, NoReturn

import numpy as np

from rockfall import kernel_rules
from rockfall.errors import RockfallError
from rockfall.io.atomic import atomic_write
from rockfall.io.files import check_text_file, reason
from rockfall.io.foreign_tables import check_table

if TYPE_CHECKING:
    import pandas as pd

MAX_COLUMNS = 1000
#: First line of a CSV file that sets its separator for spreadsheets.
SEPARATOR_LINE = re.compile(r'"?sep=([,;\t|])"?', re.IGNORECASE)
# Texts that a spreadsheet would execute as formulas, or that look like escaped formulas. Some
# programs skip blanks and invisible characters, and accept full-width East Asian signs.
_FORMULA = re.compile(r"['\s\x00-\x1f\u200b\ufeff]*[=+\-@\uff1d\uff0b\uff0d\uff20]|'*[\t\r]")


def table_rows(path: str | Path) -> Iterator[tuple[int, list[str]]]:
    """Yield the number and the cells of each non-blank line. Cells are separated by commas or
    semicolons; escaping by `spreadsheet_text` is undone. Raises a RockfallError for a damaged
    table."""
    line = 1
    check_text_file(path)
    check_table(path)
    try:
        with open(path, encoding="utf-8-sig", newline="") as file:
            first = file.readline()
            separator = ";" if first.count(";") > first.count(",") else ","
            if named := SEPARATOR_LINE.fullmatch(first.strip("\r\n")):
                separator, line = named[1], 2
            else:
                file.seek(0)
            first_row = line
            reader = csv.reader(file, delimiter=separator, skipinitialspace=True, strict=True)
            for row in reader:
                if len(row) > MAX_COLUMNS:
                    raise RockfallError(f"{path}: line {line}: more than {MAX_COLUMNS} columns")
                cells = [_as_it_was(cell.strip()) for cell in row]
                if any(cells):
                    yield line, cells
                line = first_row + reader.line_num
    except OSError as error:
        raise RockfallError(f"{path}: {reason(error, path).lower()}") from error
    except UnicodeDecodeError as error:
        raise RockfallError(f"{path}: is not text in UTF-8") from error
    except csv.Error as error:
        raise RockfallError(f"{path}: line {line}: {error}") from error


def decimal(text: str) -> float:
    """Convert a text to a number; NaN if invalid or out of range."""
    return float(kernel_rules.decimal(text.encode() or b"-"))


def plain_decimal(text: str) -> float:
    """Convert a text to a number; NaN if invalid or with a Fortran exponent (1d3)."""
    return math.nan if "d" in text.lower() else decimal(text)


class Row(NamedTuple):
    """A table row: its position in the file, and its cells by column."""

    where: str
    cells: dict[str, str]

    def refuse(self, column: str, rule: str) -> NoReturn:
        raise RockfallError(f"{self.where}: {column} = {self.cells[column]}: {rule}")

    def text(self, column: str) -> str:
        return self.cells[column] or self.refuse(column, "must not be empty")

    def choice(self, column: str, allowed: Iterable[str]) -> str:
        if self.cells[column] not in allowed:
            self.refuse(column, _one_of(allowed))
        return self.cells[column]

    def number(self, column: str, min: float = -math.inf, max: float = math.inf) -> float:
        value = decimal(self.cells[column])
        if not min <= value <= max:
            limits = (f" {sign} {limit:g}" for sign, limit in ((">=", min), ("<=", max)))
            shown = [text for text in limits if "inf" not in text]
            self.refuse(column, "must be a number" + " and".join(shown))
        return value

    def maybe(self, column: str, min: float = -math.inf, max: float = math.inf) -> float:
        """Number in a cell; NaN if the column is missing or the cell empty."""
        return self.number(column, min, max) if self.cells.get(column) else math.nan


def read_table(path: str | Path) -> tuple[str, list[str], Iterator[Row]]:
    """Return the header's position (for messages), the columns in lower case, and the rows of a
    table. Refuse a table without rows, or with rows of another length than the header."""
    lines = table_rows(path)
    number, header = next(lines, (1, []))
    columns = [name.lower() for name in header]
    if not columns:
        raise RockfallError(f"{path}: is empty")
    return f"{path}: line {number}", columns, _rows(path, columns, lines)


def read_columns(
    path: str | Path, needed: Iterable[str]
) -> tuple[list[str], dict[str, np.ndarray]]:
    """Return the position of each row (for messages), and the texts by column (object arrays).
    Refuse a table without the `needed` columns, or with a repeated column."""
    where, columns, rows = read_table(path)
    check_needed(where, columns, needed)
    check_columns(where, columns, columns)
    read = list(rows)
    values = {name: np.array([row.cells[name] for row in read], object) for name in columns}
    return [row.where for row in read], values


def check_columns(where: str, columns: list[str], allowed: Iterable[str]) -> None:
    """Refuse unknown and duplicate columns."""
    for name in columns:
        if columns.count(name) > 1:
            raise RockfallError(f"{where}: column {name} occurs twice")
        if name not in allowed:
            raise RockfallError(f"{where}: column {name}: {_one_of(allowed)}")


def check_needed(where: str, columns: list[str], needed: Iterable[str]) -> None:
    """Refuse a table without a needed column."""
    for name in needed:
        if name not in columns:
            raise RockfallError(
                f"{where}: column {name} is missing (columns: {', '.join(columns)})"
            )


def _one_of(allowed: Iterable[str]) -> str:
    """Rule for a cell with allowed names: "must be one of a, b"."""
    names = [*allowed]
    return f"must be {'one of ' if len(names) > 1 else ''}{', '.join(names)}"


def _rows(
    path: str | Path, columns: list[str], lines: Iterator[tuple[int, list[str]]]
) -> Iterator[Row]:
    any_row = False
    for number, cells in lines:
        where, any_row = f"{path}: line {number}", True
        if len(cells) != len(columns):
            raise RockfallError(
                f"{where}: has {len(cells)} columns, but the header has {len(columns)}"
            )
        yield Row(where, dict(zip(columns, cells, strict=True)))
    if not any_row:
        raise RockfallError(f"{path}: no rows below the header")


def write_csv(table: pd.DataFrame, path: str | Path) -> None:
    """Write a table atomically, without its index; texts are safe for spreadsheets."""

    def safe(value: object) -> object:
        return spreadsheet_text(value) if isinstance(value, str) else value

    table = table.rename(columns=safe)
    texts = {name: column.map(safe) for name, column in table.items() if column.dtype.kind == "O"}
    with atomic_write(path) as part, open(part, "w", encoding="utf-8", newline="") as file:
        table.assign(**texts).to_csv(file, index=False)


def spreadsheet_text(text: str) -> str:
    """Add an apostrophe to a text (not a number) that a spreadsheet would execute as a formula."""
    return f"'{text}" if _FORMULA.match(text) else text


def _as_it_was(cell: str) -> str:
    return cell[1:] if cell.startswith("'") and _FORMULA.match(cell) else cell
