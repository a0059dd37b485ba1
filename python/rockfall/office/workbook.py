# SPDX-License-Identifier: BSD-3-Clause
"""Excel workbook with a sheet for each table, like the CSV files, but with units in the headers."""

import math
import re
from collections.abc import Iterable
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from rockfall.io.atomic import atomic_write
from rockfall.language import say, translated
from rockfall.table import Table

CONTROL = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f]")  # characters not allowed in XML
WIDEST, PAD = 60, 2  # maximum column width and padding, in letters
NARROWEST_HEAD = 12  # minimum letters of a header that is wrapped
DIGITS = 3  # minimum digits displayed; the cell keeps full precision
LONGEST_HEADER = 120  # maximum letters of a printed page header; Excel allows 255 with its codes
LINE = 15.0  # line height [pt]
LETTER = 1.2  # maximum mean letter width, in units of the column width


class Sheet(NamedTuple):
    """A sheet: name, and a table or rows of texts."""

    name: str
    table: Table
    is_table: bool = True


def write_workbook(sheets: Iterable[Sheet], path: Path) -> Path:
    """Write sheets to a workbook, atomically.

    Numbers keep all digits, as in a CSV file, but fewer are displayed; missing and infinite
    numbers are empty cells. Texts are never executed as formulas. Each sheet prints one page wide.
    """
    from openpyxl import Workbook

    book = Workbook()
    book.remove(book.active)
    book.properties.creator = "rockfall"
    ends = "", *(f", {say(f'interval.{end}_limit')}" for end in ("lower", "upper"))
    for sheet in sheets:
        page = book.create_sheet(sheet.name)
        columns, rows = sheet.table.data(ends)
        head: list[list[object]] = [[column.title for column in columns]] * sheet.is_table
        for number, row in enumerate(chain(head, rows), start=1):
            for column, value in enumerate(row, start=1):
                _put(page, number, column, value, is_head=number <= len(head))
        if sheet.is_table:
            page.freeze_panes = "A2"
        _widen(page, sheet.is_table)
        _heighten(page)
        _set_print(page, sheet.is_table)
        caption = CONTROL.sub(" ", translated(sheet.table.caption))
        page.oddHeader.left.text = caption[:LONGEST_HEADER].replace("&", "&&") or None
    with atomic_write(path) as part, open(part, "wb") as file:
        book.save(file)
    return path


def _put(page: Any, row: int, column: int, value: Any, is_head: bool) -> None:
    from openpyxl.styles import Alignment, Font

    value = value.item() if isinstance(value, np.generic) else value
    if isinstance(value, float) and not np.isfinite(value):
        value = None
    cell = page.cell(row, column)
    if isinstance(value, float):
        cell.value, cell.data_type = repr(value), "n"  # openpyxl would write 16 of 17 digits
        cell.number_format = number_format(value)
    elif isinstance(value, str):
        cell.value = CONTROL.sub(" ", value)
        cell.data_type = "s"  # openpyxl takes texts that start with = for formulas
        cell.alignment = Alignment(wrap_text=True, vertical="top")
    else:
        cell.value = value
        if isinstance(value, int) and not isinstance(value, bool):
            cell.number_format = "#,##0"
    if is_head:
        cell.font = Font(bold=True)


def number_format(value: float) -> str:
    """Number format that shows at least `DIGITS` digits and the whole integer part."""
    size = abs(value)
    if size and size < 10.0**-DIGITS:
        return "0.00E+00"
    decimals = DIGITS - 1 - math.floor(math.log10(size)) if size else 0
    return "#,##0" + (f".{'0' * min(decimals, 2 + DIGITS)}" if decimals > 0 else "")


def _widen(page: Any, is_table: bool) -> None:
    """Fit column widths to their displayed contents, within limits; long headers wrap."""
    for column in page.columns:
        head, *cells = column
        longest = max((len(_shown(cell)) for cell in cells), default=0)
        first = len(str(head.value or ""))
        longest = max(longest, min(first, NARROWEST_HEAD) if is_table else first)
        page.column_dimensions[head.column_letter].width = min(longest, WIDEST) + PAD


def _heighten(page: Any) -> None:
    """Set the height of rows with multi-line texts, because LibreOffice does not."""
    for row in page.rows:
        lines = max(_lines(cell, page.column_dimensions[cell.column_letter].width) for cell in row)
        if lines > 1:
            page.row_dimensions[row[0].row].height = LINE * lines


def _lines(cell: Any, width: float) -> int:
    """Number of lines of a cell in a column of this width."""
    if cell.data_type != "s":
        return 1
    return sum(max(1, math.ceil(len(line) * LETTER / width)) for line in cell.value.split("\n"))


def _shown(cell: Any) -> str:
    """Text of a cell, about as long as displayed."""
    if cell.data_type != "n" or cell.value is None:
        return str(cell.value or "")
    _, _, decimals = cell.number_format.partition(".")
    if "E" in decimals:
        return cell.number_format
    return f"{float(cell.value):,.{len(decimals)}f}"


def _set_print(page: Any, is_table: bool) -> None:
    """Set up A4 printing with page numbers; tables are landscape and repeat their header."""
    page.page_setup.paperSize = page.PAPERSIZE_A4
    page.page_setup.orientation = "landscape" if is_table else "portrait"
    page.page_setup.fitToWidth, page.page_setup.fitToHeight = 1, 0
    page.sheet_properties.pageSetUpPr.fitToPage = True
    page.oddFooter.left.text, page.oddFooter.right.text = "&A", "&P / &N"
    margins = page.page_margins
    margins.left = margins.right = 0.4  # [inch]
    if is_table:
        page.print_title_rows = "1:1"
        page.print_options.gridLines = True
