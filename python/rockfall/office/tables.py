# SPDX-License-Identifier: BSD-3-Clause
"""Tables of results, designs and dossiers for workbooks and documents."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

import pandas as pd
import xarray as xr

from rockfall.analysis.line_statistics import line_statistics
from rockfall.analysis.return_levels import return_levels
from rockfall.errors import RockfallError, need
from rockfall.language import catalogue, say, speaking, translated
from rockfall.office.document import Part, write_document
from rockfall.office.workbook import Sheet, write_workbook
from rockfall.protection.barriers import barrier_statistics, barriers_of
from rockfall.protection.design import Design
from rockfall.result.crossings import line_names
from rockfall.result.samples import has_rows, kept_note
from rockfall.table import Table, data_table
from rockfall.tables.design import check_tables as barrier_checks
from rockfall.tables.design import factor_lines, load_tables
from rockfall.tables.dossier import Section
from rockfall.tables.lines import level_table, line_tables, rows_of
from rockfall.tables.run import barrier_table, provenance

FORMATS = {"xlsx": "openpyxl", "docx": "docx"}  # extensions, and packages that write them


def check_tables(formats: Iterable[str], language: str) -> None:
    """Raise a RockfallError for unknown formats and languages, and for missing packages."""
    for form in formats:
        if form not in FORMATS:
            raise RockfallError(f"--tables {form}: must be {' or '.join(FORMATS)}")
        need(f"tables as {form} need", "office", FORMATS[form])
    need("tables need", "report")
    catalogue(language)


def put_tables(
    result: xr.Dataset, folder: Path, formats: Sequence[str], language: str, checksum: str = ""
) -> Iterator[Path]:
    """Write line statistics, return levels and effects of barriers to tables.xlsx and tables.docx
    in a new folder, with details of the run; `checksum` belongs to the result file, if any."""
    sheets = [*_result_sheets(result)] if "xlsx" in formats else []  # texts as in CSV files
    with speaking(language):
        facts = _facts(result, checksum)
        if "xlsx" in formats:
            notes = [kept_note(result)] if barriers_of(result) and has_rows(result) else []
            page = _fact_sheet([facts], _notes_of("barriers", notes))
            yield write_workbook([*sheets, page], folder / "tables.xlsx")
        if "docx" in formats:
            parts = [*_result_parts(result), Part(say("tables.what_was_run"), [], [facts])]
            yield write_document(_title(result), parts, folder / "tables.docx")


def put_design(
    designs: Mapping[str, Design],
    results: Mapping[str, xr.Dataset],
    tables: Mapping[str, pd.DataFrame],
    folder: Path,
    formats: Sequence[str],
    language: str,
    checksums: Mapping[str, str],
) -> Iterator[Path]:
    """Write designs, by the names of their results, to design.xlsx and design.docx in a new
    folder; `tables` are the tables of the CSV files, by name."""
    if not formats:
        return
    with speaking(language):
        facts = {name: _facts(result, checksums[name]) for name, result in results.items()}
        if "xlsx" in formats:
            sheets = [Sheet(name, data_table(table)) for name, table in tables.items()]
            notes = [
                note
                for name, sheet in designs.items()
                for note in _notes_of(name, [sheet.kept, *sheet.population])
            ]
            page = _fact_sheet(facts.values(), notes)
            yield write_workbook([*sheets, page], folder / "design.xlsx")
        if "docx" in formats:
            parts = []
            for name, design in designs.items():
                kept = [design.kept] if design.kept else []
                notes = [*kept, *design.population, say("office.intervals"), *design.warnings]
                notes += factor_lines(design.factors)
                shown = [*load_tables(design), *barrier_checks(design), facts[name]]
                parts.append(Part(f"{name}", notes, shown))
            title = _title(next(iter(results.values())))
            yield write_document(title, parts, folder / "design.docx")


def write_dossier_document(title: str, sections: Sequence[Section], path: Path) -> Path:
    """Write all sentences and tables of a dossier as a Word document, in the current language."""
    return write_document(
        title, [Part(section.heading, section.notes, section.tables) for section in sections], path
    )


def write_dossier_workbook(title: str, sections: Sequence[Section], path: Path) -> Path:
    """Write each table of a dossier to a sheet of a workbook, after a sheet with the sentences, in
    the current language. Numbers have all digits; interval limits have separate columns."""
    rows: list[tuple[str, str]] = [("", title)]
    sheets, number = [], 0
    for section in sections:
        rows += [
            ("", ""),
            ("", section.heading),
            *(("", translated(note)) for note in section.notes),
        ]
        for table in section.tables:
            number += 1
            rows.append((f"{number}", translated(table.caption)))
            sheets.append(Sheet(f"{number}", table))
    first = Sheet(say("section.answer"), Table.of("", ("", ""), rows), is_table=False)
    return write_workbook([first, *sheets], path)


def _result_sheets(result: xr.Dataset) -> Iterator[Sheet]:
    """Tables of a result as in CSV files."""
    if line_names(result):
        yield Sheet("line_statistics", data_table(line_statistics(result)))
        yield Sheet("return_levels", data_table(return_levels(result)))
        if barriers_of(result) and has_rows(result):
            yield Sheet("barriers", data_table(barrier_statistics(result)))


def _result_parts(result: xr.Dataset) -> Iterator[Part]:
    """Tables of a result as in a report."""
    if line_names(result):
        shown = [*line_tables(rows_of(result)), level_table(return_levels(result))]
        if barriers_of(result) and has_rows(result):
            shown.append(barrier_table(result))
        yield Part(say("office.lines"), [say("office.intervals")], shown)


def _facts(result: xr.Dataset, checksum: str) -> Table:
    """Details of the run, with the title of the case and the checksum of the result file."""
    table = provenance(result)["table"]
    first = [(say("office.case"), str(result.attrs["title"]))]
    first += [(say("office.result"), checksum)] if checksum else []
    created = (say("sheet.computed"), str(result.attrs["date_created"]))
    return table._replace(rows=[*first, created, *table.rows])


def _fact_sheet(facts: Iterable[Table], notes: Iterable[str]) -> Sheet:
    """Sheet with details of the run, units, intervals, and notes on values."""
    rows: list[Sequence[str]] = [(say("office.units"),), (say("office.intervals"),)]
    rows += [(note,) for note in notes]
    for table in facts:
        rows += [("",), *table.texts()]
    return Sheet("provenance", Table.of("", ("", ""), rows), is_table=False)


def _notes_of(name: str, notes: Iterable[str]) -> Iterator[str]:
    """Non-empty notes, each preceded by the name of its subject."""
    for note in filter(None, notes):
        yield say("join.colon", before=name, after=translated(note))


def _title(result: xr.Dataset) -> str:
    return str(result.attrs["title"]) or Path(str(result.attrs["case_file"])).stem
