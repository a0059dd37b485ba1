# SPDX-License-Identifier: BSD-3-Clause
"""Tables as a workbook and as a document: the values of the CSV, with units and provenance."""

import math
import os
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import rockfall
import slope_case
from rockfall.case import case_of, given_text
from rockfall.cli import main
from rockfall.html_report.render import _environment
from rockfall.language import speaking
from rockfall.office.workbook import Sheet, number_format, write_workbook
from rockfall.quantities import COLUMN_UNITS as UNITS
from rockfall.result.crossings import at_lines
from rockfall.scene.layers import file_checksum
from rockfall.table import Table, data_table
from rockfall.tables.lines import line_tables, rows_of
from rockfall.tables.run import provenance

openpyxl = pytest.importorskip("openpyxl", reason="the office extra is not installed")
docx = pytest.importorskip("docx", reason="the office extra is not installed")

NET = "&barrier name = 'net', x = 600030.0, 600090.0, y = 4999940.0, 4999940.0, height = 3.0, "
#: Numeric columns without a unit.
PURE = {"n", "value", "cost", "ead_class", "shape", "exceedances", "over", "through"}


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Work in a folder with exports of a result whose line name looks like a formula; return the
    folder."""
    before = Path.cwd()
    os.chdir(folder := tmp_path_factory.mktemp("site"))
    slope_case.write_slope()
    text = (
        Path("case.nml")
        .read_text()
        .replace("'L'", "'=1+1'")
        .replace("boulders = 20", "boulders = 300")
    )
    Path("case.nml").write_text(f"{text}{NET}capacity = 50.0 /\n")
    assert main(["run", "case.nml", "-o", "out.nc", "--quiet"]) == 0
    assert main("export out.nc all --tables xlsx docx".split()) == 0
    assert main("design out.nc -o sheet --tables xlsx docx".split()) == 0
    yield folder
    os.chdir(before)


def cells(path, sheet):
    """Header and rows of a sheet; empty cells are None."""
    head, *rows = openpyxl.load_workbook(path)[sheet].iter_rows(values_only=True)
    return [*head], rows


def same(cell, value):
    if isinstance(value, str):
        return (cell or "") == value
    return cell is None if pd.isna(value) else cell == value


def check_table(path, sheet, table):
    head, rows = cells(path, sheet)
    assert len(rows) == len(table) > 0
    at = [k for k, name in enumerate(head) if name != "unit"]
    assert [head[k].partition(" [")[0] for k in at] == list(table.columns)
    for row, values in zip(rows, table.itertuples(index=False), strict=True):
        assert all(same(row[k], value) for k, value in zip(at, values, strict=True))


def test_a_workbook_of_a_result_has_the_numbers_of_its_tables(site):
    result = rockfall.read_result("out.nc")
    book = "all/tables.xlsx"
    check_table(book, "line_statistics", rockfall.line_statistics(result))
    check_table(book, "return_levels", rockfall.return_levels(result))
    check_table(book, "barriers", rockfall.barrier_statistics(result))
    head, rows = cells(book, "line_statistics")
    energy = next(row for row in rows if row[head.index("quantity")] == "energy_total")
    assert energy[head.index("unit")] == "J" and {"mean_low", "mean_high"} < {*head}


def test_a_workbook_of_a_design_has_the_numbers_of_the_csv(site):
    names = openpyxl.load_workbook("sheet/design.xlsx").sheetnames
    assert names == ["design_loads", "design_demand", "design_checks", "design_choices",
                     "design_factors", "provenance"]  # fmt: skip
    for name in names[:-1]:
        # exact, unlike the default on some systems
        table = pd.read_csv(f"sheet/{name}.csv", float_precision="round_trip")
        texts = {one: table[one].map(restored) for one in table if table[one].dtype.kind == "O"}
        check_table("sheet/design.xlsx", name, table.assign(**texts))


def restored(value):
    """Original text of a CSV cell that was made safe for spreadsheets."""
    return value.removeprefix("'") if isinstance(value, str) else value


@pytest.mark.parametrize("path", ["all/tables.xlsx", "sheet/design.xlsx"])
def test_every_column_of_numbers_has_a_unit(site, path):
    for page in openpyxl.load_workbook(path).worksheets[:-1]:
        head, rows = cells(path, page.title)
        for k, name in enumerate(head):
            numbers = any(isinstance(row[k], float) for row in rows)
            stem = name.removesuffix("_low").removesuffix("_high")
            assert not numbers or "[" in name or "unit" in head or stem in PURE, (page.title, name)
        assert page.freeze_panes == "A2"


@pytest.mark.parametrize(
    "value, shown",
    [
        (1234567.891, "1,234,568"), (999.4, "999"), (12.345, "12.3"), (-12.345, "-12.3"),
        (1.2345, "1.23"), (0.012345, "0.0123"), (0.001, "0.00100"), (0.0, "0"),
        (1.2e-9, "0.00E+00"), (100.0, "100"), (99.99, "100.0"),
    ],
)  # fmt: skip
def test_a_number_is_shown_with_its_digits_that_count(value, shown):
    """Excel shows at least three significant digits, with thousands separators."""
    form = number_format(value)
    assert re.fullmatch(r"#,##0(\.0+)?|0\.00E\+00", form)
    _, _, decimals = form.partition(".")
    assert (form if "E" in form else f"{value:,.{len(decimals)}f}") == shown


@pytest.mark.parametrize("path", ["all/tables.xlsx", "sheet/design.xlsx"])
def test_a_workbook_is_printed_one_page_wide(site, path):
    for page in openpyxl.load_workbook(path).worksheets:
        is_table = page.title != "provenance"
        assert page.sheet_properties.pageSetUpPr.fitToPage
        assert (page.page_setup.fitToWidth, page.page_setup.fitToHeight) == (1, 0)
        assert int(page.page_setup.paperSize) == int(page.PAPERSIZE_A4)
        assert page.page_setup.orientation == ("landscape" if is_table else "portrait")
        assert page.print_title_rows == ("$1:$1" if is_table else None)
        wide = sum(one.width for one in page.column_dimensions.values())
        assert wide < 460  # 4 pt letters on A4
        for cell in (cell for row in page.iter_rows(min_row=2) for cell in row):
            if cell.data_type == "n" and cell.value is not None:
                assert cell.number_format != "General", (page.title, cell.coordinate)
            assert cell.value not in ("inf", "-inf", "nan")


def test_texts_are_never_run_as_formulas(site, tmp_path):
    for path, sheet in (
        ("all/tables.xlsx", "line_statistics"),
        ("sheet/design.xlsx", "design_loads"),
    ):
        page = openpyxl.load_workbook(path)[sheet]
        found = [cell for row in page.iter_rows() for cell in row if cell.value == "=1+1"]
        assert found and {cell.data_type for cell in found} == {"s"}
    table = pd.DataFrame({"a": ["=cmd()", "bell\x07", "+1"], "b": [np.inf, np.nan, -1.5]})
    write_workbook([Sheet("hostile", data_table(table))], tmp_path / "hostile.xlsx")
    _, rows = cells(tmp_path / "hostile.xlsx", "hostile")
    assert rows == [("=cmd()", None), ("bell ", None), ("+1", -1.5)]
    page = openpyxl.load_workbook(tmp_path / "hostile.xlsx")["hostile"]
    assert page["A2"].data_type == "s"


@pytest.mark.parametrize("path", ["all/tables.xlsx", "sheet/design.xlsx"])
def test_a_workbook_says_where_it_comes_from(site, path):
    page = openpyxl.load_workbook(path)["provenance"]
    facts = {row[0]: str(row[1]) for row in page.iter_rows(values_only=True) if row[0]}
    assert facts["case"] == "Slope" and facts["seed"] == "7"
    assert facts["file of the result, SHA-256"] == file_checksum(Path("out.nc"))
    assert facts["program"].startswith(f"rockfall {rockfall.__version__}")
    assert any("95 %" in text for text in facts)


def test_a_document_has_the_tables_of_the_report(site):
    document = docx.Document("all/tables.docx")
    (expected,) = [
        one for one in line_tables(rows_of(rockfall.read_result("out.nc"))) if "=1+1" in one.caption
    ]
    found = document.tables[0]
    texts = [[cell.text for cell in row.cells] for row in found.rows]
    assert texts == [
        [*map(str, expected.head)],
        *expected.texts(),
    ]
    assert found.rows[0]._tr.trPr.xpath("w:tblHeader")
    headings = [
        one.text for one in document.paragraphs if one.style.name.startswith(("Title", "Head"))
    ]
    assert headings == ["Slope", "Lines and barriers", "What was run"]
    assert document.sections[0].page_width > document.sections[0].page_height
    facts = {row.cells[0].text: row.cells[1].text for row in document.tables[-1].rows}
    assert facts["file of the result, SHA-256"] == file_checksum(Path("out.nc"))


#: Proofing languages of Word.
SPELLING = {"en": "en-GB", "de": "de-CH", "fr": "fr-FR", "it": "it-IT", "de-AT": "de-AT"}


@pytest.mark.all
@pytest.mark.parametrize("language", SPELLING)
def test_a_document_is_of_its_language_and_splits_no_row(site, language):
    assert main(f"export out.nc d_{language} --tables docx --language {language}".split()) == 0
    document = docx.Document(f"d_{language}/tables.docx")
    (spelling,) = document.styles.element.xpath("w:docDefaults//w:lang/@w:val")
    (theme,) = document.settings.element.xpath("w:themeFontLang/@w:val")
    assert spelling == theme == document.core_properties.language == SPELLING[language]
    assert document.settings.element.xpath("w:autoHyphenation/@w:val") == ["true"]
    rows = [row for table in document.tables for row in table.rows]
    assert rows and all(row._tr.trPr.xpath("w:cantSplit/@w:val") == ["true"] for row in rows)
    heads = [table.rows[0] for table in document.tables]
    assert all(row._tr.trPr.xpath("w:tblHeader") for row in heads)


@pytest.mark.parametrize(
    "language, shown",
    [("en", "12,345"), *((language, "12\u202f345") for language in ("de", "fr", "it"))],
)
def test_numbers_of_the_provenance_are_in_the_language(site, language, shown):
    """Counts of boulders have the thousands separator of the language, in cells and on the page."""
    result = rockfall.read_result("out.nc")
    case = case_of(result)
    case = case.replace(case={"boulders": 12345})
    result = result.assign_attrs(
        boulders_requested=12345, boulder_last=12340, case=given_text(case)
    )
    with speaking(language):
        table = provenance(result)["table"]
        cells = dict(table.texts())
        page = table_html(table)
    assert f"1 – {shown[:-1]}0 / {shown}" in cells.values() and shown in cells.values()
    assert page.count(shown) == 2 and "12345" not in page
    assert cells["seed" if language == "en" else [*cells][2]] == "7"


def table_html(table):
    template = '{% from "parts.html.j2" import table with context %}{{ table(one) }}'
    return _environment().from_string(template).render(one=table, on_paper=True)


HEADINGS = {
    "de": "Linien und Schutzbauwerke",
    "fr": "Lignes et ouvrages de protection",
    "it": "Linee e opere di protezione",
}


@pytest.mark.all
@pytest.mark.parametrize("language, heading", HEADINGS.items())
def test_documents_are_in_the_language(site, language, heading):
    words = f"export out.nc in_{language} --tables docx xlsx --language {language}".split()
    assert main(words) == 0
    document = docx.Document(f"in_{language}/tables.docx")
    assert heading in [one.text for one in document.paragraphs]
    words = f"design out.nc -o in_{language} --tables docx --language {language}".split()
    assert main(words) == 0
    assert "net" in docx.Document(f"in_{language}/design.docx").tables[-2].cell(1, 0).text


@pytest.mark.family(2)
@pytest.mark.parametrize(
    "words, message",
    [
        ("export out.nc new --tables pdf", "--tables pdf: must be xlsx or docx"),
        ("export out.nc new --tables xlsx --language xx", "language = 'xx': must be one of"),
        ("design out.nc --tables xlsx", "--tables requires -o DIR"),
        ("export out.nc all --tables xlsx", "already exists; not overwritten"),
        ("design out.nc -o sheet --tables docx", "already exists; not overwritten"),
    ],
)
def test_what_is_refused_writes_nothing(site, capsys, words, message):
    before = {path: path.stat().st_mtime_ns for path in Path().rglob("*")}
    assert main(words.split()) == 2
    assert message in capsys.readouterr().err
    assert before.keys() == {*Path().rglob("*")}


def test_a_missing_package_is_named(site, capsys, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "openpyxl", None)
    assert main("export out.nc new --tables xlsx".split()) == 2
    assert "pip install 'rockfall[office]'" in capsys.readouterr().err


def test_units_are_those_of_results(site):
    result = rockfall.read_result("out.nc")
    assert UNITS["capacity"] == result["barrier_capacity"].attrs["units"]
    assert UNITS["height"] == result["barrier_height"].attrs["units"]
    assert UNITS["volume"] == result["volume"].attrs["units"]
    assert UNITS["v_d"] == at_lines(result)["line_speed"].attrs["units"]


def test_rows_are_as_high_as_their_texts(tmp_path):
    """LibreOffice overlays texts of several lines in rows without a height."""
    rows = [("short", "1"), ("a word " * 40, "2"), ("three\nshort\nlines", "3"), ("", "4")]
    table = Table.of("", ("text", "number"), rows)
    path = write_workbook([Sheet("texts", table)], tmp_path / "texts.xlsx")
    page = openpyxl.load_workbook(path).active
    width = page.column_dimensions["A"].width
    heights = [page.row_dimensions[row].height for row in range(1, 6)]
    assert heights[0] is heights[1] is heights[4] is None
    assert heights[2] >= 15 * math.ceil(len(rows[1][0]) / width) > 15
    assert heights[3] == 45
