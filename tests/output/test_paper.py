# SPDX-License-Identifier: BSD-3-Clause
"""Pages on paper: every text is within its sheet and cell in each locale, as WeasyPrint lays it
out. Text extracted from a PDF would lack columns that are off the sheet."""

import os
import subprocess
import sys
from collections.abc import Iterator
from functools import cache

import pytest

import rockfall
from made import leave_pictures_blank
from scenes import grid, make_case, rough, sets

pytest.importorskip("matplotlib", reason="the report extra is not installed")
weasyprint = pytest.importorskip("weasyprint", reason="the pdf extra is not installed")
from weasyprint.formatting_structure import boxes  # noqa: E402

from rockfall.html_report.inputs import Parties  # noqa: E402
from rockfall.html_report.page import ReportInputs, report  # noqa: E402
from rockfall.html_report.render import _without_styles  # noqa: E402
from rockfall.language import LANGUAGES, speaking  # noqa: E402

#: Languages of pages, and a locale with its own hyphenation rules.
LOCALES = (*LANGUAGES, "de-CH")
LINES = [
    {"name": name, "x": [0.0, 300.0], "y": [y, y]}
    for name, y in (
        ("Hauptstrasse Oberdorf–Unterdorf", 350.0),
        ("road_segment_km_12_300_to_14_900_upper_lane_of_the_north", 320.0),
    )
]
NET = {"name": "net", "x": [0.0, 300.0], "y": [300.0, 300.0], "height": 3.0, "capacity": 500.0}
PROJECT = (
    "Hazard assessment of the cantonal road from Oberdorf to Unterdorf, km 12.3 to 14.9, phase 2"
)
TITLE = "Rockfall above the cantonal road between the upper and the lower village, second survey"
HUGE = 2e4  # factor on energies: seven digits each


def run(folder, boulders=400):
    groups = {"case": {"boulders": boulders, "title": TITLE}, "line": LINES, "terrain": {}}
    groups |= {"release": {"x": 150.0, "y": 380.0}, "output": {"maps": ["passages"]}}
    case = make_case(folder, *sets(), **groups).replace(barrier=[NET])
    return rockfall.run(case, dem=rough(), transform=grid(rough()))


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    usual = run(tmp_path_factory.mktemp("case"))
    wide = usual.copy(deep=True)
    for name in [name for name in wide if "energy" in name and "line" in wide[name].dims]:
        wide[name] = wide[name] * HUGE
    return {"usual": usual, "wide": wide}


@pytest.fixture(scope="module")
def documents(results):
    """Function that lays out the page of a result in a locale; each is laid out once."""

    @cache
    def page(kind, language):
        return page_of(results[kind], language)

    @cache
    def document(kind, locale):
        text, language = page(kind, locale[:2]), f'<html lang="{locale}">'
        named = text.replace(f'<html lang="{locale[:2]}">', language, 1)
        return weasyprint.HTML(string=named).render()

    return document


def page_of(result, language):
    from matplotlib.figure import Figure

    people = Parties(PROJECT, "Service of natural hazards", "A. Muster", "2024", "17f2" * 16)
    with pytest.MonkeyPatch.context() as here, speaking(language):
        leave_pictures_blank(here)
        here.setattr("rockfall.html_report.page.figures", lambda *_: [])
        here.setattr("rockfall.html_report.page.history_figure", lambda *_: Figure())
        return report(ReportInputs(result, (rough(), grid(rough())), on_paper=True, parties=people))


def texts(document) -> Iterator[tuple[int, str, bool]]:
    """Yield each text with its page number, and whether it is within its sheet and cell."""
    for number, page in enumerate(document.pages, start=1):
        sheet = page._page_box
        left, top = sheet.content_box_x(), sheet.content_box_y()
        yield from _texts(
            sheet, number, (left, left + sheet.width), (top, top + sheet.height), rounding=0.1
        )


def _texts(box, number, wide, high, rounding):
    if isinstance(box, boxes.MarginBox):
        return
    if isinstance(box, boxes.TableCellBox):
        wide = within(wide, box.position_x, box.margin_width())
        high = within(high, box.position_y, box.margin_height())
    if isinstance(box, boxes.TextBox) and box.text.strip():
        right, bottom = box.position_x + box.width, box.position_y + box.height
        fits = (
            wide[0] - rounding <= box.position_x
            and right <= wide[1] + rounding
            and high[0] - rounding <= box.position_y
            and bottom <= high[1] + rounding
        )
        yield number, box.text.strip(), fits
    for child in getattr(box, "children", ()):
        yield from _texts(child, number, wide, high, rounding)


def within(limits, start, size):
    return max(limits[0], start), min(limits[1], start + size)


def laid_out(*locales):
    """Parametrise a test by locale; locales not given need --all, because each takes some
    seconds."""
    extra = [pytest.param(one, marks=pytest.mark.all) for one in LOCALES if one not in locales]
    return pytest.mark.parametrize("locale", [*locales, *extra])


@pytest.mark.all
@laid_out("de", "fr", "it")
def test_every_text_is_within_its_sheet_and_cell(documents, locale):
    """All texts are within sheet and cell, even if energies have seven digits."""
    document = documents("wide", locale)
    all_within(document)
    assert "signature" in document.pages[0].anchors


def all_within(document):
    found = [*texts(document)]
    assert len(found) > 300
    assert [(page, text) for page, text, fits in found if not fits] == []


@pytest.mark.all
@laid_out("en", "de-CH")
def test_a_page_of_usual_numbers_fits_wraps_no_interval_and_has_a_map_to_read(documents, locale):
    """Page 1 has the complete project and title, and a map more than 100 mm high; no interval is
    broken across lines."""
    document = documents("usual", locale)
    all_within(document)
    intervals = [text for _, text, _ in texts(document) if text.startswith("(")]
    assert len([text for text in intervals if "–" in text]) > 60
    assert [text for text in intervals if text.endswith("–")] == []
    words = " ".join(text for page, text, _ in texts(document) if page == 1)
    assert PROJECT in words and TITLE in words
    assert "signature" in document.pages[0].anchors
    pictures = [
        box
        for box in document.pages[0]._page_box.descendants()
        if isinstance(box, boxes.ReplacedBox)
    ]
    (picture,) = pictures
    assert picture.height * 25.4 / 96 > 100 > 0.35 * picture.width * 25.4 / 96


def test_the_walk_finds_text_beyond_the_margin_and_beyond_its_cell():
    html = weasyprint.HTML(
        string="<style>@page {size: A4; margin: 2cm} td {width: 5mm; max-width: 5mm}"
        "table {table-layout: fixed; width: 2cm}</style><p>inside</p>"
        "<p style='position:relative; left:19cm'>far</p><table><tr><td>uuuuuuuuuuuuuuuuu</td>"
        "<td>v</td></tr></table>"
    )
    found = {text: fits for _, text, fits in texts(html.render())}
    assert found == {"inside": True, "far": False, "uuuuuuuuuuuuuuuuu": False, "v": True}


@pytest.mark.all
@pytest.mark.parametrize("command", ["report out.nc --pdf", "report out.nc -o page.pdf"])
def test_without_fonts_a_pdf_is_refused_in_one_line(results, tmp_path, command):
    """A PDF without fonts is refused: Pango would end the process by a signal."""
    rockfall.write_result(results["usual"], tmp_path / "out.nc")
    (tmp_path / "fonts.conf").write_text("<fontconfig><cachedir>cache</cachedir></fontconfig>")
    done = subprocess.run(
        [sys.executable, "-m", "rockfall", *command.split()], cwd=tmp_path, text=True,
        env=os.environ | {"FONTCONFIG_FILE": str(tmp_path / "fonts.conf")}, capture_output=True,
        check=False,
    )  # fmt: skip
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert line.endswith("a PDF needs fonts, as root: apt-get install fonts-dejavu-core")
    assert not [*tmp_path.glob("*.pdf")]


def test_svg_on_paper_has_attributes_in_place_of_styles():
    """Texts keep the style that has their font; the rule for all elements is on the root, from
    which they inherit."""
    svg = (
        "<?xml version='1.0'?><svg width='9'><defs>"
        '<style type="text/css">*{stroke-linejoin: round; stroke-linecap: butt}</style></defs>'
        '<path d="M0 0" style="fill: none; stroke-linecap: square"/>'
        """<text style="font: 8px 'DejaVu Sans'; text-anchor: end">9</text></svg>"""
    )
    assert _without_styles(svg) == (
        "<?xml version='1.0'?>"
        """<svg stroke-linejoin="round" stroke-linecap="butt" width='9'><defs></defs>"""
        '<path d="M0 0" fill="none" stroke-linecap="square"/>'
        """<text style="font: 8px 'DejaVu Sans'; text-anchor: end">9</text></svg>"""
    )
