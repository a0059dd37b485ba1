# SPDX-License-Identifier: BSD-3-Clause
"""CSV files written by the program contain no formulas, and can be read back unchanged."""

import csv
import math

import numpy as np
import pandas as pd
import pytest

import rockfall
from rockfall.cli import main
from rockfall.files.export import export
from rockfall.io.tables import table_rows, write_csv
from scenes import grid, make_case, rough, sets

FORMULAS = [
    "=1+1", "+1", "-1.5", "@SUM(A1)", "\t=1", "'=1", "''+a", '=HYPERLINK("x";1)', " =1+1", "\n=1",
    "\u00a0 +1", "\ufeff=1", "\uff1d1+1", "\uff0b1", " \uff0d1", "\uff20SUM(A1)", " '=1",
]  # fmt: skip
PLAIN = ["EL1", "1-2", "a=b", "'quoted'", "it's", "straße"]
NUMBERS = [-1.5, 0.0, 1e-300, -math.inf, 2.0, -3e20]


def cells_of(path):
    with open(path, encoding="utf-8", newline="") as file:
        return list(csv.reader(file))


def is_formula(cell):
    """Return True if a cell begins like a formula and is not a number."""
    try:
        float(cell)
    except ValueError:
        return cell[:1] in tuple("=+-@\t\r")
    return False


@pytest.mark.parametrize("text", [*FORMULAS, *PLAIN])
def test_texts_are_no_formulas_and_come_back(text, tmp_path):
    path = tmp_path / "t.csv"
    table = pd.DataFrame(
        {"line": [text] * len(NUMBERS), "mean": NUMBERS, "why": [text, *[None] * 5]}
    )
    write_csv(table.assign(n=pd.array([1, -2, None, 4, 5, 6], "Int64")), path)
    _, *rows = cells_of(path)
    assert [float(row[1]) for row in rows] == NUMBERS  # unchanged
    assert [row[3] for row in rows] == ["1", "-2", "", "4", "5", "6"]
    assert rows[0][0] == rows[0][2] == (text if text in PLAIN else f"'{text}") and rows[1][2] == ""
    assert not any(cell[:1] in tuple("=+-@\t\r") for row in rows for cell in (row[0], row[2]))
    assert {cells[0] for _, cells in list(table_rows(path))[1:]} == {text}


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    line = [{"name": "=1+1", "x": [0.0, 300.0], "y": [280.0, 280.0]}]
    case = make_case(
        tmp_path_factory.mktemp("case"), *sets(), line=line, case={"boulders": 200}, terrain={},
        release={"x": 150.0, "y": 380.0},
    )  # fmt: skip
    return rockfall.run(case, dem=rough(), transform=grid(rough()))


def test_a_line_that_is_called_like_a_formula(result, tmp_path, monkeypatch, capsys):
    """Tables with a line named `=1+1` contain no formulas, and the name copied from them still
    matches."""
    monkeypatch.chdir(tmp_path)
    rockfall.write_result(result, "out.nc")
    assert main(["lines", "out.nc", "-o", "lines.csv"]) == 0
    (tmp_path / "seen.csv").write_text("line,quantity,unit,mean\n'=1+1,speed,m/s,7\n")
    assert main(["compare", "out.nc", "seen.csv", "-o", "compared.csv"]) == 0
    data = result.assign({"=a": ("boulder", np.where(result["impacts"] > 3, "=2", "-x"))})
    export(data.drop_dims(["line", "line_vertex", "y", "x"], errors="ignore"), "out")
    for name in "lines.csv", "lines_levels.csv", "compared.csv", "out/boulders.csv":
        rows = cells_of(name)
        assert len(rows) > 1 and not any(is_formula(cell) for row in rows for cell in row), name
        assert any(cell.startswith("'") for row in rows for cell in row), name


def test_words_of_our_own_are_read_as_before(tmp_path):
    (tmp_path / "t.csv").write_text("zone;name\n1;'quoted'\n2;-1.5\n3;''\n")
    rows = [cells for _, cells in table_rows(tmp_path / "t.csv")]
    assert rows == [["zone", "name"], ["1", "'quoted'"], ["2", "-1.5"], ["3", "''"]]
