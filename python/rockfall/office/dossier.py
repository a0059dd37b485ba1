# SPDX-License-Identifier: BSD-3-Clause
"""Tables of a dossier as a workbook and as a document, in the current language."""

from collections.abc import Sequence
from pathlib import Path

from rockfall.language import say, translated
from rockfall.office.document import Part, write_document
from rockfall.office.workbook import Sheet, write_workbook
from rockfall.table import Table
from rockfall.tables.dossier import Section


def write_dossier_document(title: str, sections: Sequence[Section], path: Path) -> Path:
    """Write all sentences and tables as a Word document."""
    return write_document(
        title, [Part(section.heading, section.notes, section.tables) for section in sections], path
    )


def write_dossier_workbook(title: str, sections: Sequence[Section], path: Path) -> Path:
    """Write each table to a sheet of a workbook, after a sheet with the sentences. Numbers have
    all digits; interval limits have separate columns."""
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
