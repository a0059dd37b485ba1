# SPDX-License-Identifier: BSD-3-Clause
"""Word document with the tables of a report."""

from collections.abc import Iterable, Sequence
from itertools import zip_longest
from pathlib import Path
from typing import Any, NamedTuple

from rockfall.io.atomic import atomic_write
from rockfall.language import spoken, translated
from rockfall.office.workbook import CONTROL
from rockfall.table import Table

SMALL = 8  # font size in tables [pt]
SHORT = 12  # maximum rows of a table that must stay on one page
MARGIN = 1.8  # [cm]
A4 = 29.7, 21.0  # width, height [cm]
#: Language for spelling and hyphenation in Word; German is Swiss, without sharp s.
PROOFED = {"en": "en-GB", "de": "de-CH", "fr": "fr-FR", "it": "it-IT"}


class Part(NamedTuple):
    """A chapter: its heading, remarks, and tables."""

    heading: str
    notes: Sequence[str]
    tables: Sequence[Table]


def write_document(title: str, parts: Iterable[Part], path: Path) -> Path:
    """Write tables to an A4 landscape document, atomically, in the current language."""
    from docx import Document
    from docx.shared import Cm

    document = Document()
    _set_language(document, PROOFED.get(spoken(), spoken()))
    section = document.sections[0]
    section.page_width, section.page_height = map(Cm, A4)
    for side in ("left", "right", "top", "bottom"):
        setattr(section, f"{side}_margin", Cm(MARGIN))
    document.core_properties.title = _clean(title)
    document.core_properties.author = ""
    document.core_properties.comments = ""
    document.add_heading(_clean(title), 0)
    for part in parts:
        document.add_heading(_clean(part.heading), 1)
        for note in part.notes:
            document.add_paragraph(_clean(translated(note)))
        for table in part.tables:
            if table.caption != part.heading:
                caption = document.add_paragraph(_clean(table.caption))
                caption.paragraph_format.keep_with_next = True
            _add_table(document, table)
    with atomic_write(path) as where:
        document.save(str(where))
    return path


def _set_language(document: Any, language: str) -> None:
    """Set the language of all texts, which controls hyphenation."""
    from docx.oxml.ns import qn

    document.core_properties.language = language
    settings = document.settings.element
    for lang in (
        *document.styles.element.xpath("w:docDefaults/w:rPrDefault/w:rPr/w:lang"),
        *settings.xpath("w:themeFontLang"),
    ):
        lang.set(qn("w:val"), language)
    for tab_stop in settings.xpath("w:defaultTabStop"):
        tab_stop.addnext(_flag("w:autoHyphenation"))


def _add_table(document: Any, table: Table) -> None:
    """Add a table. Its first row is repeated on each page, rows are not split, and a short table
    stays on one page."""
    rows = [table.head, *table.texts()]
    grid = document.add_table(len(rows), len(table.head), style="Table Grid")
    cells = iter(grid._cells)  # grid.cell(i, j) would build this list for each cell
    for number, row in enumerate(rows):
        for _, value in zip_longest(table.head, row, fillvalue=""):
            cell = next(cells)
            _write(cell, translated(value), bold=number == 0)
            stays = number == 0 or number < len(rows) - 1 <= SHORT
            cell.paragraphs[0].paragraph_format.keep_with_next = stays
    for row in grid.rows:
        row._tr.get_or_add_trPr().append(_flag("w:cantSplit"))
    grid.rows[0]._tr.get_or_add_trPr().append(_flag("w:tblHeader"))
    document.add_paragraph()


def _flag(name: str) -> Any:
    """Element that enables a property."""
    from docx.oxml import OxmlElement
    from docx.oxml.ns import qn

    flag = OxmlElement(name)
    flag.set(qn("w:val"), "true")
    return flag


def _write(cell: Any, text: str, bold: bool) -> None:
    from docx.shared import Pt

    paragraph = cell.paragraphs[0]
    paragraph.paragraph_format.space_after = Pt(0)
    run = paragraph.add_run(_clean(text).strip())
    run.bold, run.font.size = bold, Pt(SMALL)


def _clean(text: object) -> str:
    return CONTROL.sub(" ", str(text))
