# SPDX-License-Identifier: BSD-3-Clause
"""One table in every format: equal values, each with the properties of its format."""

import csv
import html
import math
import re

import numpy as np
import pandas as pd
import pytest

from rockfall.language import LANGUAGES, Number, say, speaking
from rockfall.office.document import Part, write_document
from rockfall.office.workbook import Sheet, write_workbook
from rockfall.quantities import COLUMN_UNITS, QUANTITIES
from rockfall.table import Column, Estimate, Table, as_text, data_table, in_line, write_csv

openpyxl = pytest.importorskip("openpyxl", reason="the office extra is not installed")
docx = pytest.importorskip("docx", reason="the office extra is not installed")
pytest.importorskip("jinja2", reason="the report extra is not installed")
from rockfall.html_report.render import _environment  # noqa: E402

ENERGY = Estimate(1234.5678, 1100.25, 1390.125)
ROWS = [
    ("road <b>", 12345, 2.0 / 3.0, ENERGY),
    ("=1+1", np.int64(7), math.nan, Estimate(12.5)),
    ("net", 0, np.float32(-1.5), Estimate(0.02, math.nan, 0.04, digits=2, up=True)),
]
HEADS = "line", Column("boulders"), Column("share", "m", 2), Column("energy", "kJ")
#: Displayed text of these cells, in English.
SEEN = [
    ["road <b>", "12,345", "0.67", "1,230\n(1,100–1,390)"],
    ["=1+1", "7", "-", "12.5\n(–)"],
    ["net", "0", "-1.50", "0.020\n(up to 0.040)"],
]
VALUES = [
    ["road <b>", 12345, 2.0 / 3.0, *ENERGY[:3]],
    ["=1+1", 7, None, 12.5, None, None],
    ["net", 0, -1.5, 0.02, None, 0.04],
]
TITLES = ["line", "boulders", "share [m]", "energy [kJ]"]
SPLIT = [*TITLES, "energy_low [kJ]", "energy_high [kJ]"]


@pytest.fixture
def table():
    return Table.of("Energies", HEADS, ROWS)


def of_terminal(table, _):
    """Cells as printed: separated by at least two blanks, with further lines of a row joined to its
    last cell."""
    head, *lines = as_text(table).splitlines()
    rows = []
    for line in lines:
        cells = re.split(r" {2,}", line.strip())
        if len(cells) == len(HEADS):
            rows.append(cells)
        else:
            rows[-1][-1] += f"\n{cells[0]}"
    return [re.split(r" {2,}", head.strip()), *rows]


def of_page(table, _):
    template = '{% from "parts.html.j2" import table with context %}{{ table(one) }}'
    page = _environment().from_string(template).render(one=table, on_paper=True)
    assert f"<caption>{table.caption}</caption>" in page and "<b>" not in page
    rows = re.findall(r"<tr>(.*?)</tr>", page, re.DOTALL)
    found = [re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row, re.DOTALL) for row in rows]
    return [[*map(html.unescape, row)] for row in found]


def of_document(table, folder):
    path = write_document("T", [Part("P", [], [table])], folder / "a.docx")
    (found,) = docx.Document(path).tables
    return [[cell.text for cell in row.cells] for row in found.rows]


@pytest.mark.parametrize("rendered", [of_terminal, of_page, of_document])
@pytest.mark.parametrize("language", LANGUAGES)
def test_readers_see_the_same_cells_in_every_format(table, tmp_path, rendered, language):
    with speaking(language):
        head, *rows = rendered(table, tmp_path)
        expected = [*table.texts()]
    assert head == TITLES
    assert rows == expected
    if language == "en":
        assert rows == SEEN
    else:
        assert rows[0][1] == "12\u202f345" and rows[2][2] == "-1,50"


def of_csv(table, folder):
    write_csv(table, folder / "a.csv")
    with open(folder / "a.csv", encoding="utf-8", newline="") as file:
        head, *rows = csv.reader(file)
    numbers = [[float(cell) if cell else None for cell in row[1:]] for row in rows]
    return [
        head,
        *([row[0].removeprefix("'"), *more] for row, more in zip(rows, numbers, strict=True)),
    ]


def of_workbook(table, folder):
    path = write_workbook([Sheet("T", table)], folder / "a.xlsx")
    return [[*row] for row in openpyxl.load_workbook(path)["T"].iter_rows(values_only=True)]


@pytest.mark.parametrize("rendered", [of_csv, of_workbook])
@pytest.mark.parametrize("language", LANGUAGES)
def test_programs_read_the_same_numbers_in_full(table, tmp_path, rendered, language):
    """CSV and workbook have exact values, with limits in separate columns, in every language."""
    with speaking(language):
        head, *rows = rendered(table, tmp_path)
        limits = [f"energy, {say(f'interval.{end}_limit')} [kJ]" for end in ("lower", "upper")]
    assert head == (SPLIT if rendered is of_csv else [*TITLES, *limits]) and rows == VALUES


def test_a_text_never_becomes_a_formula(table, tmp_path):
    write_csv(table, tmp_path / "a.csv")
    assert "\n'=1+1," in (tmp_path / "a.csv").read_text()
    write_workbook([Sheet("T", table)], tmp_path / "a.xlsx")
    assert openpyxl.load_workbook(tmp_path / "a.xlsx")["T"]["A3"].data_type == "s"


def test_a_heading_is_of_any_length_and_shifts_no_row(tmp_path):
    heading = "a heading that is wider than all the columns of its table together"
    table = Table.of("", ("", "n"), [(heading,), ("a", 1), ("b", 22)])
    assert as_text(table, "") == f"{'':1}   n\n{heading}\na   1\nb  22"
    rows = of_document(table, tmp_path)
    assert rows == [["", "n"], [heading, ""], ["a", "1"], ["b", "22"]]
    assert [row[1] for row in table.data()[1]][1:] == [1, 22]


def test_what_has_no_room_in_a_line_is_below_it():
    heads = ["name", *(f"column {k}" for k in range(20))]
    cells = [f"{10**12 + k:,}" for k in range(20)]
    lines = as_text(Table.of("", heads, [("a", *cells)])).splitlines()
    assert len(lines) == 8 and max(map(len, lines)) <= 120
    assert [line.split()[0] for line in lines] == 4 * ["name", "a"]
    assert [cell for line in lines[1::2] for cell in line.split()[1:]] == cells


@pytest.mark.parametrize(
    ("cell", "shown"),
    [
        (Estimate(12.3456, 12.1, 12.6), "12.3 (12.1–12.6)"),
        (Estimate(12.3456, 10.1, 14.6), "12 (10–15)"),
        (Estimate(12.3456, 12.1, math.nan), "12.3 (from 12.1)"),
        (Estimate(12.3456, digits=3), "12.3"),
        (Estimate(math.nan), "-"),
        (Estimate(3e-6, 1e-6, 9e-6), "0.000003 (0.000001–0.000009)"),  # not 0
        (Estimate(3e-9, 0.0, 9e-9, digits=2), "3.0e-9 (0 to 9.0e-9)"),
        (Estimate(6.491, 6.2, 6.801, digits=2, up=True), "6.5 (6.2–6.9)"),
        (Estimate(0.0, 0.0, 0.0384), "0.00 (0.00–0.04)"),
        (Estimate(-2.0, -4.0, 1.0), "-2 (-4 to 1)"),
        (Estimate(24.46, 20.0, 31.0, decimals=2), "24.46 (20.00–31.00)"),
    ],
)
def test_an_estimate_has_the_digits_that_its_interval_justifies(cell, shown):
    assert in_line(cell) == shown


def test_data_have_the_units_of_results_by_row_or_by_column():
    rows = pd.DataFrame({"line": ["L"], "quantity": ["energy_total"], "mean": [1e5], "n": [3]})
    table = data_table(rows)
    assert table.head == ["line", "quantity", "unit", "mean", "n"]
    assert table.rows == [("L", "energy_total", QUANTITIES["energy_total"].units, 1e5, 3)]
    frame = pd.DataFrame({"height": [2.0], "height_low": [1.0], "E_d": [np.nan], "n": [1]})
    assert data_table(frame).head == ["height [m]", "height_low [m]", "E_d [J]", "n"]
    assert COLUMN_UNITS["E_d"] == "J"


def test_texts_are_in_the_language_of_the_reader_not_of_the_maker():
    table = Table.of("", ("",), [(say("label.boulders"),), (Number("1,234.5"),)])
    with speaking("de"):
        assert [row for (row,) in table.texts()] == [say("label.boulders"), "1\u202f234,5"]
        assert say("label.boulders") != "boulders"
