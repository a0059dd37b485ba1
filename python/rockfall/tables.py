# SPDX-License-Identifier: BSD-3-Clause
"""Tables for people: CSV that they write, CSV that their spreadsheets open, columns of text."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterable, Iterator
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING

from rockfall.errors import RockfallError
from rockfall.files import check_text_file, whole_file

if TYPE_CHECKING:
    import pandas as pd

MOST_COLUMNS = 1000  # as in rockfall_csv.f90
# What rockfall_decimal.f90 takes for a number, and no more (Python would read 1_000 too).
# Texts that a spreadsheet would run as formulas, or that would be taken for such texts made safe.
_FORMULA = re.compile(r"'*[=+\-@\t\r]")
_DECIMAL = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eEdD][+-]?[0-9]+)?")


def table_rows(path: str | Path) -> Iterator[tuple[int, list[str]]]:
    """(line number, cells) of each line that is not blank; commas or semicolons part the cells.
    Those that `spreadsheet_text` made safe are as they were."""
    line = 1
    check_text_file(path)
    try:
        with open(path, encoding="utf-8-sig", newline="") as file:
            first = file.readline()
            separator = ";" if first.count(";") > first.count(",") else ","
            file.seek(0)
            reader = csv.reader(file, delimiter=separator, skipinitialspace=True, strict=True)
            for row in reader:
                if len(row) > MOST_COLUMNS:
                    raise RockfallError(f"{path}: line {line}: more than {MOST_COLUMNS} columns")
                cells = [_as_it_was(cell.strip()) for cell in row]
                if any(cells):
                    yield line, cells
                line = reader.line_num + 1
    except OSError as error:
        raise RockfallError(f"{path}: {(error.strerror or str(error)).lower()}") from error
    except UnicodeDecodeError as error:
        raise RockfallError(f"{path}: is not text in UTF-8") from error
    except csv.Error as error:
        raise RockfallError(f"{path}: line {line}: {error}") from error


def decimal(text: str) -> float:
    """The number that a text spells; NaN where it spells none, or one past all bounds."""
    if not _DECIMAL.fullmatch(text):
        return math.nan
    value = float(text.lower().replace("d", "e"))
    return value if math.isfinite(value) else math.nan


def plain_decimal(text: str) -> float:
    """The same, without the exponents that Fortran alone knows (1d3)."""
    return math.nan if "d" in text.lower() else decimal(text)


def write_csv(table: pd.DataFrame, path: str | Path) -> None:
    """Write a table without its index, whole or not at all; its texts are safe in a spreadsheet."""

    def safe(value: object) -> object:
        return spreadsheet_text(value) if isinstance(value, str) else value

    table = table.rename(columns=safe)
    texts = {name: one.map(safe) for name, one in table.items() if one.dtype.kind == "O"}
    with whole_file(path) as part, open(part, "w", encoding="utf-8", newline="") as file:
        table.assign(**texts).to_csv(file, index=False)


def spreadsheet_text(text: str) -> str:
    """A text, with an apostrophe before one that a spreadsheet would run as a formula. No number
    may come here: -1.5 is one."""
    return f"'{text}" if _FORMULA.match(text) else text


def _as_it_was(cell: str) -> str:
    return cell[1:] if cell.startswith("'") and _FORMULA.match(cell) else cell


def aligned(rows: Iterable[list[str]]) -> str:
    """Columns as wide as their longest cell, the first to the left, the others to the right."""
    rows = list(rows)
    widths = [max(map(len, column)) for column in zip_longest(*rows, fillvalue="")]
    lines = []
    for first, *cells in rows:
        padded = (f"{cell:>{wide}}" for cell, wide in zip(cells, widths[1:], strict=False))
        lines.append("  ".join([f"{first:{widths[0]}}", *padded]).rstrip())
    return "\n".join(lines)
