# SPDX-License-Identifier: BSD-3-Clause
"""Hazard, origins and design checks in the live window: the same values as from commands."""

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("starlette", reason="the app extra is not installed")
shapely = pytest.importorskip("shapely", reason="the vector extra is not installed")
pytest.importorskip("matplotlib", reason="the report extra is not installed")

import rockfall  # noqa: E402
from app_messages import decoded  # noqa: E402
from made import make_layer  # noqa: E402
from rockfall.analysis.hazard.classes import CLASSES  # noqa: E402
from rockfall.app.room import Given  # noqa: E402
from rockfall.app.show import PAGE  # noqa: E402
from rockfall.app.study_messages import hazard_message, table_entry  # noqa: E402
from rockfall.language import speaking  # noqa: E402
from rockfall.protection.yearly import yearly_design  # noqa: E402
from rockfall.tables.design import check_tables, choice_table  # noqa: E402
from rockfall.tables.hazard import object_table, period_tables, segment_table  # noqa: E402
from rockfall.tables.yearly_design import check_tables as yearly_checks  # noqa: E402
from rockfall.tables.yearly_design import loads_table, verdicts  # noqa: E402

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")

W, N = 600000.0, 5000000.0
CASE = f"""&case boulders_total = 300, seed = 7, threads = 1 /
&terrain dem = 'dem.tif' /
&surface uniform_mean_radius = 0.25 /
&impact sets = 'sets.nml' /
&boulder volume = 'normal', volume_mean = 0.8, volume_std = 0.2 /
&release x = {W + 150}, {W + 120}, y = {N - 40}, {N - 50}, drop_height = 5.0 /
&line name = 'road', x = {W}, {W + 300}, y = {N - 260}, {N - 260} /
&barrier name = 'net', x = {W + 100}, {W + 200}, y = {N - 200}, {N - 200}, height = 2.0, class = 3 /
&scenario name = 'stones', return_period = 2.0, volume = 'fixed', volume_mean = 0.1 /
&scenario name = 'blocks', return_period = 30.0 /
"""
HOUSE = shapely.box(W + 140, N - 290, W + 160, N - 270)
MOVED = {
    "id": "b1", "type": "LineString",
    "coordinates": [[W + 60.0, N - 190.0], [W + 240.0, N - 190.0]],
    "properties": {"name": "net", "height": 4.5, "class": 5},
}  # fmt: skip


@pytest.fixture(autouse=True)
def place(write_place):
    write_place(CASE)
    make_layer("houses.gpkg", [HOUSE], name=["Hof"])


@pytest.fixture
def page(enter):
    page = enter("case.nml", given=Given([Path("houses.gpkg")]))
    assert page.until("welcome")["scenarios"] == 2
    page.until("batch", complete=True)
    return page


def houses(page, **view):
    page.ask(objects="houses.gpkg", **view)


def is_hazard_of(shown, case):
    """Check that a message has the values of `rockfall.hazard`; return the hazard."""
    hazard = rockfall.hazard(rockfall.read_case(case), objects="houses.gpkg")
    assert np.array_equal(shown["arrays"]["classes"], hazard["hazard_class"].values)
    assert len(shown["classes"]) == len(CLASSES) == 5
    sheet = yearly_design(hazard)
    _, loads, objects = shown["tables"]
    assert loads == table_entry(loads_table(sheet)) and objects == table_entry(object_table(hazard))
    assert {str(text) for text in verdicts(sheet)} <= {*shown["sentences"]}
    (check,) = yearly_checks(sheet)
    assert shown["nets"]["net"][0] == table_entry(check)
    return hazard


def test_the_hazard_of_the_window_is_that_of_the_command_also_after_an_edit(page):
    houses(page, hazard=True)
    page.until("hazard_begun")
    first = page.until("hazard")
    is_hazard_of(first, "case.nml")
    page.send("edit", revision=1, layers={"barriers": [MOVED]})
    moved = page.until("hazard")
    assert moved["revision"] == 1 and moved["nets"] != first["nets"]
    page.send("save", name="moved")
    page.until("saved")
    is_hazard_of(moved, "moved.nml")


def test_tables_are_in_the_language_of_the_page_with_its_decimals():
    hazard = rockfall.hazard(rockfall.read_case("case.nml"), objects="houses.gpkg")
    shown = decoded(hazard_message(hazard, "de", revision=0))
    with speaking("de"):
        tables = loads_table(yearly_design(hazard)), object_table(hazard)
        assert shown["tables"][1:] == [*map(table_entry, tables)]
    cells = [text for table in shown["tables"][1:] for row in table["rows"] for text in row[1:]]
    assert any("," in text for text in cells) and not any("." in text for text in cells)


@pytest.mark.all
def test_sources_of_what_comes_to_a_place_are_those_of_origins(page):
    houses(page, hazard=True)
    page.until("hazard")
    hazard = rockfall.hazard(rockfall.read_case("case.nml"), objects="houses.gpkg")
    for name in ("road", "Hof", "net"):
        houses(page, hazard=True, origin=name)
        shown = page.until("origins", place=name)
        found = rockfall.origins(hazard, name)
        assert len(found) > 0
        for column in ("x", "y", "frequency", "share"):
            assert shown["arrays"][column].tolist() == found[column].tolist()
        assert shown["total"] == found["frequency"].sum()
        assert sum(cells for *_, cells in shown["parts"]) == len(found)
        curve = rockfall.exceedance(hazard, name)
        assert (shown["arrays"]["curve_energy"] == curve["energy"] / 1000).all()
        for column in ("frequency", "low", "high"):
            assert shown["arrays"][f"curve_{column}"].tolist() == curve[column].tolist()
        with speaking("en"):
            tables = [*map(table_entry, period_tables(hazard))]
        for own, table in zip(shown["tables"][:2], tables, strict=True):
            assert own["rows"] == [row for row in table["rows"] if row[0] == name] != []
        assert len(shown["tables"]) == (4 if name == "road" else 2)
    houses(page, hazard=True, origin="600152.5,4999802.5")
    shown = page.until("origins", place="600152.5,4999802.5")
    found = rockfall.origins(hazard, (600152.5, 4999802.5))
    assert len(found) > 0 and shown["error"] == ""
    for column in ("x", "y", "frequency", "share"):
        assert shown["arrays"][column].tolist() == found[column].tolist()
    assert len(shown["tables"]) == 2 and len(shown["arrays"]["curve_energy"]) > 0
    houses(page, hazard=True, origin="0.0,0.0")
    assert "lies outside the terrain" in page.until("origins", place="0.0,0.0")["error"]
    houses(page, hazard=True, origin="nobody")
    assert "nobody" in page.until("origins", place="nobody")["error"]


@pytest.mark.all
def test_segments_of_a_line_are_those_of_the_command(page):
    """A line of 300 m has 15 segments of 20 m, with the values of `rockfall.hazard`."""
    houses(page, hazard=True)
    page.until("hazard")
    houses(page, hazard=True, origin="road")
    *_, segments, energies = page.until("origins", place="road")["tables"]
    line = shapely.LineString([(W, N - 260), (W + 300, N - 260)])
    roads = {"segments": make_layer("roads.gpkg", [line], name=["road"]), "segment_length": 20.0}
    hazard = rockfall.hazard(rockfall.read_case("case.nml"), objects="houses.gpkg", **roads)
    with speaking("en"):
        table, periods = (
            segment_table(hazard),
            next(period_tables(hazard, *hazard["segment"].values)),
        )
    assert energies == table_entry(periods)
    assert segments["head"] == table.head and len(segments["rows"]) == 15 > 1
    assert sorted(segments["rows"]) == sorted(table_entry(table)["rows"])
    assert [row[0] for row in segments["rows"]] == [
        f"road, {start} to {start + 20} m" for start in range(0, 300, 20)
    ]
    hits = hazard["segment_frequency"].values
    assert hits.max() > 0 and hits.sum() >= hazard["line_frequency"].sel(line="road")


def is_sheet_of(shown, result):
    """Check that a message has the tables of `rockfall.design` for all lines and for the net alone;
    return the first check."""
    for sheet in (rockfall.design(result), rockfall.design(result, line="net")):
        tables = [*check_tables(sheet), choice_table(sheet, "net")]
        assert shown["tables"] == [*map(table_entry, tables)]
        row = sheet.checks.iloc[0]
        assert 0 < row["residual_low"] < row["residual"] < row["residual_high"] < 1
    return row


@pytest.mark.all
def test_the_check_of_a_net_is_the_sheet_of_the_command_while_it_is_moved(page):
    page.ask(net="net")
    before = is_sheet_of(page.until("net"), rockfall.run(rockfall.read_case("case.nml")))
    lower = MOVED | {"properties": {"name": "net", "height": 3.0, "class": 3}}
    page.send("edit", revision=1, layers={"barriers": [lower]})
    page.until("batch", revision=1, complete=True)
    moved = page.until("net", revision=1)
    page.send("save", name="moved")
    page.until("saved")
    after = is_sheet_of(moved, rockfall.run(rockfall.read_case("moved.nml")))
    assert before["residual"] != after["residual"]
    page.ask(net="no such net")
    assert page.until("net")["tables"] == []


def test_an_edit_ends_the_scenarios_that_run_and_no_older_hazard_follows(page):
    houses(page, hazard=True)
    page.until("hazard")
    for revision in range(1, 4):
        page.send("edit", revision=revision, layers={"barriers": [MOVED]})
    page.until("state", revision=3)
    assert page.until("hazard")["revision"] == 3
    houses(page)
    page.send("edit", revision=4, layers={"barriers": []})
    page.until("batch", revision=4, complete=True)
    while not page.sent.empty():
        assert page.sent.get()["type"] != "hazard"


def test_a_hazard_that_cannot_be_is_told_and_the_window_lives(page):
    Path("houses.gpkg").unlink()
    houses(page, hazard=True)
    assert "houses.gpkg" in page.until("hazard_refused")["text"]
    page.send("edit", revision=1, layers={"barriers": [MOVED]})
    page.until("batch", revision=1, complete=True)
    page.send("view", map="passages", trajectories=0, hazard="yes")
    assert page.until("refused")["text"]


@pytest.mark.all
@pytest.mark.skipif(not (PAGE / "app.js").exists(), reason="the page is made by ./run page")
def test_a_click_on_a_house_shows_where_its_boulders_come_from(browser):
    from app_window import open_window, served
    from browser import resize

    with served("case.nml") as server:
        resize(browser, 1280, 800)
        window = open_window(browser, server)
        browser.execute_script("""
        const list = document.querySelector('[data-action=objects]');
        list.value = 'houses.gpkg'; list.dispatchEvent(new Event('change'));""")
        window.click('[data-tab="hazard"]')
        window.click('[data-action="hazard"]')
        window.until("a table", "document.querySelector('[data-place=Hof]')")
        assert "Hazard classes" in window.text(".legend")
        window.touch([W + 150, N - 280])
        window.until(
            "sources", "document.querySelector('.origins h3')?.textContent.includes('Hof')"
        )
        assert "1000 years" in window.text(".origins") and "energy [kJ]" in window.text(
            ".origins svg"
        )
        pressed = "document.querySelector('[data-place=Hof]').getAttribute('aria-pressed')"
        assert browser.execute_script(f"return {pressed}") == "true"
        window.touch([W + 40, N - 260])
        window.until("segments", "document.querySelector('.origins details')")
        assert "road, 280 to 300 m" in browser.execute_script(
            "return document.querySelector('.origins details').textContent"
        )
        window.click('[data-tab="features"]')
        window.click('[data-feature="b1"]')
        window.until("a check", "document.querySelector('.net-check')?.offsetParent")
        rows = window.text(".net-check")
        assert "passing" in rows and "arriving boulders per year" in rows
        window.click('[data-tab="hazard"]')
        window.click('[data-show="hazard"]')
        assert "Passages" in window.text(".legend")
        errors = [one for one in browser.get_log("browser") if one["level"] == "SEVERE"]
        browser.get("about:blank")
    assert errors == []
