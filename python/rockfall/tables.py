# SPDX-License-Identifier: BSD-3-Clause
"""Tables for people: CSV that they write, CSV that their spreadsheets open, columns of text."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterable, Iterator
from itertools import zip_longest
from pathlib import Path

from rockfall.errors import RockfallError
from rockfall.files import check_text_file

MOST_COLUMNS = 1000  # as in rockfall_csv.f90
# What rockfall_decimal.f90 takes for a number, and no more (Python would read 1_000 too).
_DECIMAL = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eEdD][+-]?[0-9]+)?")


def table_rows(path: str | Path) -> Iterator[tuple[int, list[str]]]:
    """(line number, cells) of each line that is not blank; commas or semicolons part the cells."""
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
                cells = [cell.strip() for cell in row]
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


def aligned(rows: Iterable[list[str]]) -> str:
    """Columns as wide as their longest cell, the first to the left, the others to the right."""
    rows = list(rows)
    widths = [max(map(len, column)) for column in zip_longest(*rows, fillvalue="")]
    lines = []
    for first, *cells in rows:
        padded = (f"{cell:>{wide}}" for cell, wide in zip(cells, widths[1:], strict=False))
        lines.append("  ".join([f"{first:{widths[0]}}", *padded]).rstrip())
    return "\n".join(lines)
