# SPDX-License-Identifier: BSD-3-Clause
"""Page 1 of a report can be signed: it fits on one sheet, with the line for the signature."""

import re
import shutil
import subprocess
from html import unescape

import numpy as np
import pytest

import rockfall
from made import leave_pictures_blank
from rockfall.analysis.return_levels import return_levels
from rockfall.cli import main
from rockfall.result.crossings import line_names
from scenes import grid, make_case, rough, sets

pytest.importorskip("matplotlib", reason="the report extra is not installed")
from rockfall.html_report.front import WARNING_LINES  # noqa: E402
from rockfall.html_report.inputs import Parties  # noqa: E402
from rockfall.html_report.page import ReportInputs, report  # noqa: E402
from rockfall.language import LANGUAGES, say, speaking  # noqa: E402

NAMES = ["road", "track to the upper alp", "net", "railway", "school", "campsite by the river"]
LINES = [
    {"name": name, "x": [0.0, 300.0], "y": [370.0 - 6 * k, 370.0 - 6 * k]}
    for k, name in enumerate(NAMES)
]
WARNINGS = [  # three kinds of run warnings, more than fit on one page
    f"{1000 + k:,} of 661,645 rebounds (61.9 %) had R_b/R_m outside 0.5 to 5.5, where the set is "
    "not calibrated: the nearest ratio was used."
    for k in range(12)
]
PEOPLE = Parties("2026-117", "Service of natural hazards", "A. Muster", "2024", "17f2" * 16)


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    """Result with many lines and a map."""
    groups = {"case": {"boulders": 200, "title": "Upper valley, road and railway below the face"}}
    groups |= {"release": {"x": 150.0, "y": 380.0}, "output": {"maps": ["passages"]}}
    case = make_case(tmp_path_factory.mktemp("case"), *sets(), line=LINES, terrain={}, **groups)
    found = rockfall.run(case, dem=rough(), transform=grid(rough()))
    return found.assign_attrs(date_created="2026-11-23T14:05:06+01:00")


@pytest.fixture(scope="module")
def levels(result):
    """Return levels of the result, computed once for all pages."""
    return return_levels(result)


@pytest.fixture
def bare(monkeypatch, levels):
    """Leave figures after page 1 out of reports, and figures on it blank."""
    leave_pictures_blank(monkeypatch)
    monkeypatch.setattr("rockfall.html_report.page.return_levels", lambda *_, **__: levels)
    monkeypatch.setattr("rockfall.html_report.page.figures", lambda *_: [])
    monkeypatch.setattr("rockfall.html_report.page._convergence", lambda *_: iter(()))


def warned(monkeypatch, texts):
    monkeypatch.setattr("rockfall.html_report.page.warnings", lambda *_: texts)


def text_of(page):
    return unescape(re.sub(r"<(style|script).*?</\1>|<[^>]*>", " ", page, flags=re.DOTALL))


def page_1(result, language="en", **about):
    with speaking(language):
        return report(ReportInputs(result, (rough(), grid(rough())), parties=PEOPLE, **about))


@pytest.fixture
def full_page(result, levels, monkeypatch):
    """Function that makes page 1 in a language, with more warnings than it has room for; `without`
    is the German page on paper without warnings."""
    leave_pictures_blank(monkeypatch)
    monkeypatch.setattr("rockfall.html_report.page.return_levels", lambda *_, **__: levels)
    monkeypatch.setattr("rockfall.html_report.page.figures", lambda *_: [])
    monkeypatch.setattr("rockfall.html_report.page._convergence", lambda *_: iter(()))

    def page(name):
        warned(monkeypatch, [] if name == "without" else WARNINGS)
        return page_1(result, "de", on_paper=True) if name == "without" else page_1(result, name)

    return page


@pytest.mark.parametrize(
    "name",
    ["de", *(pytest.param(one, marks=pytest.mark.all) for one in ("without", "en", "fr", "it"))],
)
def test_the_signature_is_on_page_1_in_every_language(full_page, name):
    """Reports have many lines, and either no warning or more than page 1 has room for."""
    weasyprint = pytest.importorskip("weasyprint", reason="the pdf extra is not installed")
    page = full_page(name).split('<section id="results">')[0]
    first, *others = weasyprint.HTML(string=page).render().pages
    assert "signature" in first.anchors and "inputs" not in first.anchors
    assert any("inputs" in one.anchors for one in others)
    bottom = first.anchors["signature"][1]
    assert bottom < first.height - 16 * 96 / 25.4


def test_what_a_signature_needs_is_before_it(result, bare):
    page = text_of(page_1(result).split('id="signature"')[0])
    for word in (
        "2026-117",
        "Service of natural hazards",
        "2026-11-23",
        f"rockfall {rockfall.__version__}",
        "17f2" * 16,
    ):
        assert word in page
    assert "Reliability" in page and "Pass frequency" in page


def test_what_page_1_has_no_room_for_is_on_page_2(result, bare, monkeypatch):
    warned(monkeypatch, WARNINGS)
    page = page_1(result)
    first, second = page.split('class="rest"')
    on_paper = first.split('class="on-screen"')[0]
    shown = [one for one in WARNINGS if one in unescape(on_paper).replace("\u00a0", " ")]
    assert shown == WARNINGS[: len(shown)] and 0 < len(shown) <= WARNING_LINES
    rest = unescape(second).replace("\u00a0", " ")
    assert all(one in rest for one in WARNINGS[len(shown) :])
    assert f"and {len(WARNINGS) - len(shown)} more on page 2" in first
    for name in NAMES:  # sentences and rows of all lines
        assert f"{name}: " in first and f">{name}<" in page
    warned(monkeypatch, WARNINGS[:1])
    assert "more on page 2" not in page_1(result).split("answers")[0]


@pytest.mark.all
@pytest.mark.parametrize("language", LANGUAGES)
def test_a_browser_prints_the_signature_on_page_1_of_a4(full_page, tmp_path, language):
    chromium = next(filter(None, map(shutil.which, ("chromium", "google-chrome"))), None)
    if not (chromium and shutil.which("pdftotext")):
        pytest.skip("no chromium and pdftotext here: ./run browser")
    page = tmp_path / "page.html"
    page.write_text(full_page(language), encoding="utf-8")
    options = ["--headless=new", "--no-sandbox", "--disable-gpu", "--no-pdf-header-footer"]
    options += [f"--user-data-dir={tmp_path / 'profile'}", "--print-to-pdf=page.pdf"]
    printed([chromium, *options, page.as_uri()], tmp_path)
    first, *others = printed(["pdftotext", "-layout", "page.pdf", "-"], tmp_path).split("\f")
    with speaking(language):
        word = say("page.place_and_date")
    assert word in first and not any(word in one for one in others)
    assert "A4" in printed(["pdfinfo", "page.pdf"], tmp_path)


def printed(words, folder):
    done = subprocess.run(
        words, cwd=folder, check=True, capture_output=True, text=True, timeout=600
    )
    return done.stdout


def test_the_command_states_the_checksum_of_the_result(result, bare, tmp_path, monkeypatch, capsys):
    import hashlib

    monkeypatch.chdir(tmp_path)
    rockfall.write_result(result, "out.nc")
    assert main(["report", "out.nc", "--project", "P 17"]) == 0
    page = text_of((tmp_path / "out.html").read_text())
    assert hashlib.sha256((tmp_path / "out.nc").read_bytes()).hexdigest() in page
    assert "P 17" in page


def test_many_lines_share_one_table_and_the_worst_have_their_own(tmp_path, monkeypatch):
    """Three of 25 lines are above the release, 21 across the slope below it, one at the edge."""
    leave_pictures_blank(monkeypatch)
    monkeypatch.setattr("rockfall.html_report.page.figures", lambda *_: [])
    monkeypatch.setattr("rockfall.html_report.page._convergence", lambda *_: iter(()))
    ends = [(0.0, 300.0, y) for y in [396.0, 397.0, 398.0, *np.linspace(370.0, 330.0, 21)]]
    ends.append((0.0, 5.0, 330.0))
    lines = [{"name": f"L{k:02}", "x": [west, east], "y": [y, y]}
             for k, (west, east, y) in enumerate(ends)]  # fmt: skip
    groups = {"case": {"boulders": 150}, "release": {"x": 150.0, "y": 380.0}}
    case = make_case(tmp_path, *sets(), line=lines, terrain={}, **groups)
    result = rockfall.run(case, dem=rough(), transform=grid(rough()))
    passed = dict(zip(line_names(result), result["row_size"].values.tolist(), strict=True))
    statistics = rockfall.line_statistics(result).set_index(["quantity", "line"])
    worst = {max(passed, key=passed.get)}
    worst |= {statistics["max"][name].idxmax() for name in ("energy_total", "passing_height")}
    page = page_1(result)
    first, rest = page.split('<section id="inputs">')
    assert all(name in text_of(first) for name in passed)
    tables = re.findall(r"<caption>(L\d\d): [0-9,]+ boulders cross it", rest)
    assert len(tables) == 20 and worst <= {*tables}
    said = "20 of 25 lines, those with the most boulders, highest energies and heights"
    assert said in text_of(rest)
    protection = text_of(rest.split('<section id="protection">')[1])
    assert "Loads: 20 of 25 lines" in protection and "may be higher" in protection
    few = [name for name, n in passed.items() if n < 100]
    said = f"{len(few)} of 25 lines: fewer than 100 boulders passed (none at 4)"
    assert said in text_of(rest)
