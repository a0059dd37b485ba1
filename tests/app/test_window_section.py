# SPDX-License-Identifier: BSD-3-Clause
"""Section in the live window: the same values as from the command. Two clicks draw it."""

import numpy as np
import pytest

pytest.importorskip("starlette", reason="the app extra is not installed")
pytest.importorskip("shapely", reason="the vector extra is not installed")

import rockfall
from rockfall.app.sections import COLUMNS, MAPS
from rockfall.app.show import PAGE
from rockfall.result.dataset import write_result
from same import same_bits

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")

W, N = 600000.0, 5000000.0
CASE = f"""&case boulders_total = 1000, seed = 7, threads = 1 /
&terrain dem = 'dem.tif' /
&surface uniform_mean_radius = 0.25 /
&impact sets = 'sets.nml' /
&boulder volume = 'normal', volume_mean = 0.8, volume_std = 0.2 /
&release x = {W + 150}, y = {N - 40}, drop_height = 5.0 /
&line name = 'L', x = {W}, {W + 300}, y = {N - 200}, {N - 200} /
&barrier name = 'net', x = {W + 50}, {W + 250}, y = {N - 250}, {N - 250}, height = 4.0, class = 3 /
"""
LINE = [[W + 150.0, N - 30.0], [W + 170.0, N - 300.0]]


@pytest.fixture(autouse=True)
def place(write_place):
    write_place(CASE)


def numbers_agree(shown, cut):
    assert shown["error"] == ""
    for name in COLUMNS:
        assert same_bits(shown["arrays"][name], cut.table[name].to_numpy("f8")), name
    lines = cut.lines.to_dict("records")
    assert [one["name"] for one in shown["lines"]] == [row["name"] for row in lines]
    for one, row in zip(shown["lines"], lines, strict=True):
        assert one["distance"] == row["distance"]
        for name, values in one["q95"].items():
            ends = (row[f"{name}_q95{end}"] for end in ("", "_low", "_high"))
            assert values == [None if np.isnan(value) else value for value in ends]


@pytest.mark.all
def test_a_section_of_a_live_run_has_the_numbers_of_the_command(enter):
    page = enter("case.nml")
    page.until("batch", complete=True)
    page.ask(section=LINE)
    page.until("batch", complete=True)
    shown = page.until("section")
    output = {"maps": [*MAPS], "trajectories": 200}
    result = rockfall.run(rockfall.read_case("case.nml").replace(output=output))
    cut = rockfall.section(result, LINE)
    numbers_agree(shown, cut)
    known = np.isfinite(shown["arrays"]["cell_energy_total_q95"])
    assert known.any() and (shown["arrays"]["cell_energy_total_q95"][known] > 0).all()
    assert [one["name"] for one in shown["lines"]] == ["L", "net"]
    gaps = np.isnan(shown["arrays"]["paths"]).any(axis=1).sum()
    assert gaps >= len(cut.paths) > 0


def test_another_section_needs_no_other_run_and_none_ends_it(enter):
    page = enter("case.nml")
    page.until("batch", complete=True)
    page.ask(section=LINE)
    page.until("batch", complete=True)
    page.until("section")
    page.ask(section=LINE[::-1])
    other = page.until("section")
    assert other["vertices"] == LINE[::-1]
    page.ask(section=[])
    assert page.until("section")["vertices"] == []
    assert not [one for one in iter_of(page.sent) if one["type"] == "batch"]


def iter_of(sent):
    while not sent.empty():
        yield sent.get()


@pytest.mark.all
def test_a_section_of_a_result_has_what_the_file_holds(enter):
    case = rockfall.read_case("case.nml").replace(output={"maps": ["passages"], "trajectories": 90})
    write_result(rockfall.run(case), "result.nc")
    page = enter("result.nc")
    page.ask(section=LINE)
    shown = page.until("section")
    numbers_agree(shown, rockfall.section("result.nc", LINE))
    assert np.isnan(shown["arrays"]["cell_energy_total_q95"]).all()
    assert np.isfinite(shown["arrays"]["recorded_energy_total_max"]).any()


def test_a_section_that_cannot_be_is_told_and_the_window_lives(enter):
    case = rockfall.read_case("case.nml").replace(output={"maps": ["passages"]})
    write_result(rockfall.run(case), "bare.nc")
    page = enter("bare.nc")
    page.ask(section=LINE)
    assert "trajectories" in page.until("section")["error"]
    for wrong in ([[W, N]], [[W, "x"], [W, N]], "A", [[W, N], [W, 1e300]], [[True, N], [W, N]]):
        page.ask(section=wrong)
        assert page.until("refused")["text"]
    live = enter("case.nml")
    live.until("batch", complete=True)
    live.ask(section=[[W + 10, N - 10]] * 2)
    assert "length" in live.until("section")["error"]


@pytest.mark.all
@pytest.mark.skipif(not (PAGE / "app.js").exists(), reason="the page is made by ./run page")
def test_two_clicks_show_a_section_whose_numbers_can_be_read(window):
    from selenium.webdriver.common.action_chains import ActionChains

    lines = window.complete()
    window.click('[data-tool="section"]')
    window.touch([W + 150, N - 60], [W + 160, N - 240])
    window.until("a section", "document.querySelectorAll('.drawings svg').length === 4")
    assert window.complete() == lines  # same boulders
    assert "180 m" in window.text(".section-panel h3")
    drawing = window.find(".drawings .stack svg")
    ActionChains(window.browser).move_to_element(drawing).perform()
    reading = window.until("a reading", "document.querySelector('[data-read=section]').textContent")
    assert reading.startswith("At ") and "kJ" in reading and "m/s" in reading
    window.click('[data-action="close-section"]')
    window.until("no section", "document.querySelector('.section-panel').hidden")
