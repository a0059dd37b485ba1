# SPDX-License-Identifier: BSD-3-Clause
"""The live window in a real browser: what an engineer does, and what must not happen."""

import base64
import json
import math
import re
import shutil
import subprocess
import time
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("starlette", reason="the app extra is not installed")
pytest.importorskip("uvicorn", reason="the app extra is not installed")
pytest.importorskip("selenium", reason="selenium is not installed")
pytest.importorskip("shapely", reason="the vector extra is not installed")
imread = pytest.importorskip("matplotlib.image", reason="the report extra is not installed").imread
from selenium.webdriver.common.action_chains import ActionChains  # noqa: E402
from selenium.webdriver.common.by import By  # noqa: E402
from selenium.webdriver.common.keys import Keys  # noqa: E402

import rockfall  # noqa: E402
import scenes  # noqa: E402
from app_window import CASE, PATIENCE, N, W, Window, agrees, open_window, served  # noqa: E402
from browser import resize  # noqa: E402
from made import make_raster  # noqa: E402
from rockfall.app import server as server_module  # noqa: E402
from rockfall.app.show import PAGE, show  # noqa: E402
from rockfall.draft.groups import RADIUS  # noqa: E402
from rockfall.result import variables  # noqa: E402
from rockfall.result.dataset import write_result  # noqa: E402
from rockfall.scene.read import read_scene  # noqa: E402
from rockfall.simulation.parts.checkpoint import Checkpoint  # noqa: E402
from rockfall.simulation.simulate import simulate  # noqa: E402

pytestmark = [
    pytest.mark.all,
    pytest.mark.usefixtures("slope"),
    pytest.mark.filterwarnings("ignore::UserWarning"),
    pytest.mark.skipif(not (PAGE / "app.js").exists(), reason="the page is made by ./run page"),
]

TREES = 0x00, 0x7A, 0x59  # colour of trees


def test_a_case_opens_with_its_statistics(window):
    lines = window.complete()
    assert 0 < lines["L"]["n"] <= 200
    agrees(lines, "case.nml")
    shown = window.text('[data-line="L"]')
    assert f"{lines['L']['n']} boulders" in shown.replace("\u202f", "")
    assert [one["properties"]["name"] for one in window.layers["lines"]] == ["L"]


def test_the_file_that_opens_the_browser_leads_to_the_page(browser, monkeypatch):
    monkeypatch.setattr("webbrowser.open", browser.get)
    with served("case.nml") as server, server_module.open_browser(server.url):
        assert "L" in Window(browser).complete()
        assert server.key not in browser.current_url
        browser.get("about:blank")


def test_a_source_is_drawn_dragged_and_saved_as_what_the_command_line_runs(window):
    first = window.complete()
    drawn = window.changed(lambda: window.draw("source", [W + 90, N - 60]))
    assert len(window.layers["sources"]) == 2
    window.click('[data-tool="select"]')
    dragged = window.changed(
        lambda: window.touch([W + 90, N - 60], [W + 120, N - 70], [W + 200, N - 80], drag=True)
    )
    dragged = window.complete(window.revision)
    x, y = window.layers["sources"][1]["coordinates"]
    assert abs(x - W - 200) < 10 and abs(y - N + 80) < 10
    means = [one["L"]["quantities"]["speed"]["mean"][0] for one in (first, drawn, dragged)]
    assert len({*means}) == 3
    window.save("drawn")
    agrees(dragged, "drawn.nml")


def test_a_source_is_dragged_on_four_million_cells(browser):
    make_raster("dem.tif", scenes.rough(2000, 2000, dtype="f4"))
    middle = (f"{W + 150}", W + 5000), (f"{N - 40}", N - 4000), (f"{N - 200}", N - 4300)
    text = CASE.replace(f"x = {W}, {W + 300}", f"x = {W + 3000}, {W + 7000}")
    for given, place in middle:
        text = text.replace(given, f"{place}")
    Path("large.nml").write_text(text, encoding="utf-8")
    with served("large.nml") as server:
        resize(browser, 1280, 800)
        window = open_window(browser, server)
        before = window.complete()
        places = [W + 5000, N - 4000], [W + 4800, N - 3900], [W + 4500, N - 3800]
        window.touch(places[0])
        window.until("the source", "document.querySelector('.properties:not([hidden])')")
        window.changed(lambda: window.touch(*places, drag=True))
        lines = window.complete(window.revision)
        assert lines["L"]["quantities"] != before["L"]["quantities"]
        window.save("moved")
        agrees(lines, "moved.nml")
        browser.get("about:blank")


def test_a_terrain_alone_asks_for_its_ground(browser):
    """Without a choice of ground the window runs nothing; the choice becomes a key of the case."""
    with served("dem.tif") as server:
        resize(browser, 1280, 800)
        browser.get("about:blank")
        browser.get(server.url)
        window = Window(browser)
        choice = "document.querySelector('dialog.grounds[open] [data-ground=rocky-slope]')"
        window.until("the choice", f"{choice}?.textContent.includes('Rocks in contact')")
        browser.execute_script(f"{choice}.click()")
        ground = {"ground": "rocky-slope", "uniform_mean_radius": RADIUS}
        assert window.until("the ground", "rockfall.document.settings.surface") == ground
        assert not browser.execute_script("return document.querySelector('dialog[open]') !== null")
        browser.get("about:blank")


def test_slides_and_waits_are_no_arcs_and_flights_have_their_own_gravity(browser):
    """A boulder on the Moon falls, slides for 6 s, waits for 5 s and hops for 4 s to the same
    height. Arcs by Earth's gravity would be 44, 31 and 20 m high."""
    case = rockfall.read_case("case.nml").replace(
        flight={"gravity": 1.62}, case={"boulders_total": 1}, output={"trajectories": 1}
    )
    result = rockfall.run(case)
    z, fall = result["start_z"].item(), math.sqrt(2 * 2.0 / 1.62)
    columns = {
        "x": [0.0, 0.0, 12.0, 12.0, 20.0],
        "z": [2.0, 0.0, 0.0, 0.0, 0.0],
        "time": [0.0, fall, fall + 6, fall + 11, fall + 15],
        "velocity_x": [0.0, 2.0, 0.0, 2.0, 0.0],
        "velocity_z": [0.0, 0.0, 0.0, 1.62 * 2, 0.0],
        "leg": [variables.LEG[name] for name in ("flight", "ground", "rest", "flight")] + [0],
    }
    columns["x"] = np.array(columns["x"]) + result["start_x"].item()
    columns["z"] = np.array(columns["z"]) + z
    columns["y"] = np.full(5, result["start_y"].item())
    columns["boulder"] = np.ones(5, int)
    slid = result.drop_dims("trajectory_vertex").assign({
        f"trajectory_{name}": ("trajectory_vertex", columns.get(name, np.zeros(5)), attrs)
        for name, attrs in variables.VERTEX.items()
    })  # fmt: skip
    write_result(slid, Path("slid.nc"))
    with served("slid.nc") as server:
        resize(browser, 1280, 800)
        window = open_window(browser, server)
        window.click('[data-view="scene"]')
        highest = "rockfall.frames.map((frame) => frame.highest).filter(Number.isFinite).at(-1)"
        apex = 1.62 * 4**2 / 8
        assert window.until("a frame", highest) == pytest.approx(z + apex, abs=0.06)
        browser.get("about:blank")


def test_undo_takes_back_a_net_and_the_numbers_with_it(window):
    before = window.complete()
    across = [W + 60, N - 150], [W + 240, N - 150]
    window.click('[data-tool="net"]')
    window.touch(*across, double=True)
    window.until("a net", "rockfall.document.layers.barriers.length === 1")
    window.fill("height", 4)
    window.fill("capacity", 2000)
    after = window.complete(window.revision)
    assert len(after) == 2
    assert after["L"]["n"] < before["L"]["n"]
    while window.layers["barriers"]:
        window.find("body").click()
        revision = window.revision
        window.undo()
        window.until("a revision", "rockfall.revision > arguments[0]", revision)
    assert window.complete(window.revision) == before


def test_an_error_stands_at_its_field(window):
    window.click('[data-tab="settings"]')
    window.fill("density", -1)
    window.until("an error", "document.querySelector('.field-error:not([hidden])')")
    assert "> 0" in window.text(".field-error:not([hidden])")
    assert window.browser.execute_script("return rockfall.preliminary")
    window.fill("density", 2700)
    window.complete(window.revision)
    assert not window.browser.find_elements(By.CSS_SELECTOR, ".field-error:not([hidden])")


def test_a_long_run_is_paused_and_gives_way_to_an_edit(window):
    window.click('[data-tab="settings"]')
    window.fill("boulders_total", 5_000_000)
    running = "!rockfall.preliminary && rockfall.batch.total === 5e6"
    window.until("a long run", f"{running} && rockfall.batch.boulders > 0")
    window.click('[data-action="pause"]')
    window.until("a pause", "!rockfall.batch.running")
    paused = window.browser.execute_script("return rockfall.batch.boulders")
    time.sleep(0.5)  # nothing may arrive within this time; too short a time cannot cause a failure
    assert window.browser.execute_script("return rockfall.batch.boulders") == paused
    window.fill("boulders_total", 150)
    window.complete(window.revision)
    assert window.browser.execute_script("return rockfall.batch.boulders") == 150


def test_variants_of_the_case_are_compared_and_made_current(browser):
    net = f"name = 'N', x = {W}, {W + 300}, y = {N - 150}, {N - 150}, height = 4.0, capacity = 2e3"
    groups = f"&barrier {net} /\n&variant name = 'bare', without = 'barrier' /\n"
    make_raster("zones.tif", np.ones((80, 60), "i4"))
    Path("zones.csv").write_text("zone,mean_radius\n1,0.25\n")
    text = CASE.replace("uniform_mean_radius = 0.25", "zones = 'zones.tif', table = 'zones.csv'")
    Path("varied.nml").write_text(text + groups, encoding="utf-8")
    with served("varied.nml") as server:
        resize(browser, 1280, 800)
        window = open_window(browser, server)
        assert "N" in window.complete()
        window.click('[data-tab="variants"]')
        window.click('[data-variant="bare"] [data-action="compare"]')
        difference = "[...document.querySelectorAll('.compare-table td.difference')]"
        window.until("a comparison", f"{difference}.some((one) => /^[+−]/.test(one.innerText))")
        window.click('[data-action="close-compare"]')
        bare = window.changed(lambda: window.click('[data-variant="bare"] [data-action="restore"]'))
        assert [*bare] == ["L"] and window.layers["barriers"] == []
        assert "N" in window.changed(lambda: window.click('[data-action="base"]'))
        browser.get("about:blank")


def test_of_many_lines_one_is_sent_and_those_in_view_are_written_first(browser):
    rows = [f"&line name = 'M{k}', x = {W}, {W + 300}, y = {N - 100 - 2 * k}, {N - 100 - 2 * k} /"
            for k in range(60)]  # fmt: skip
    Path("many.nml").write_text(CASE + "\n".join(rows), encoding="utf-8")
    with served("many.nml") as server:
        resize(browser, 1280, 800)
        window = open_window(browser, server)
        window.until("the first rows", "document.querySelector('[data-line=L] .estimate')")
        assert browser.execute_script("return !document.querySelector('[data-line=M50] .estimate')")
        browser.execute_script("""window.sent = [];
            const send = WebSocket.prototype.send;
            WebSocket.prototype.send = function (text) { sent.push(text); send.call(this, text); };
            [...document.querySelectorAll('[data-feature]')].at(-10).click();
            document.querySelector('#map').focus();""")
        keys = ActionChains(browser).send_keys(Keys.ARROW_RIGHT)
        lines = window.changed(keys.perform)
        sent = [json.loads(text) for text in browser.execute_script("return sent")]
        edit = next(message for message in sent if message["type"] == "edit")
        change = edit["layers"]["lines"]
        assert [one["properties"]["name"] for one in change["set"]] == ["M50"]
        assert change["remove"] == [] and not edit["whole"]
        window.until("its row", "document.querySelector('[data-line=M50] .estimate')")
        assert window.text('[data-line="M50"]').split("\n")[0] == "M50"
        window.save("moved")
        agrees(lines, "moved.nml")
        browser.get("about:blank")


def test_states_are_compared_with_their_trees_and_counts_with_whole_numbers(browser):
    rows = [f"{W + 20 + 5 * k},{N - 20 - 7 * k},50,Picea" for k in range(50)]
    Path("trees.csv").write_text("\n".join(["x,y,dbh,species", *rows]))
    groups = "&forest trees = 'trees.csv' /\n&variant name = 'felled', without = 'forest' /\n"
    few = CASE.replace("boulders_total = 200", "boulders_total = 3")
    Path("wood.nml").write_text(few + groups, encoding="utf-8")
    with served("wood.nml") as server:
        resize(browser, 1280, 800)
        window = open_window(browser, server)
        ticks = window.text(".legend .ticks").split()
        assert len(ticks) > 1 and {*ticks} <= {*"123"}
        window.click('[data-tab="variants"]')
        window.click('[data-variant="felled"] [data-action="compare"]')
        window.until("a comparison", "document.querySelector('.compare-table td.difference')")
        felled, present = browser.find_elements(By.CSS_SELECTOR, ".compare-side .map")
        end = time.monotonic() + PATIENCE
        while not green(present):
            assert time.monotonic() < end, "no tree is drawn"
        assert green(felled) == 0
        browser.get("about:blank")


def green(element):
    """Number of pixels of an element that have nearly the colour of trees."""
    pixels = 255 * imread(BytesIO(element.screenshot_as_png))[..., :3]
    return (abs(pixels - TREES).max(axis=-1) < 40).sum()


def test_a_run_that_was_stopped_is_offered_and_goes_on(browser):
    Path("long.nml").write_text(CASE, encoding="utf-8")
    scene = read_scene(rockfall.read_case("long.nml"))
    simulate(scene, checkpoint=Checkpoint("long.nc", 1e9, keep=True))
    with served("case.nml") as server:
        resize(browser, 1280, 800)
        window = open_window(browser, server)
        window.click('[data-action="resume"]')
        window.until("the result", "document.querySelector('dialog[open] .files')")
        assert window.text("dialog[open] .files") == "long.nc"
        assert browser.find_elements(By.CSS_SELECTOR, '[data-action="resume"]') == []
        browser.get("about:blank")
    assert rockfall.read_result("long.nc").sizes["boulder"] == 200


def test_a_second_page_reads_until_it_takes_over(browser):
    with served("case.nml") as server:
        resize(browser, 1280, 800)
        first = open_window(browser, server)
        home = browser.current_window_handle
        browser.switch_to.new_window("tab")
        try:
            second = open_window(browser, server)
            assert not second.find('[data-tool="source"]').is_enabled()
            second.click('[data-action="take-over"]')
            tool = "document.querySelector('[data-tool=source]')"
            second.until("a tool", f"!{tool}.disabled")
            browser.switch_to.window(home)
            first.until("the loss of it", f"{tool}.disabled")
            browser.switch_to.new_window("tab")
            browser.close()
        finally:
            for handle in browser.window_handles[1:]:
                browser.switch_to.window(handle)
                browser.close()
            browser.switch_to.window(home)
            browser.get("about:blank")


def test_no_request_leaves_the_machine(browser):
    browser.get_log("performance")
    with served("case.nml") as server:
        resize(browser, 1280, 800)
        window = open_window(browser, server)
        window.click('[data-view="scene"]')
        window.until("a frame", "rockfall.frames.length")
        browser.get("about:blank")
    log = [json.loads(one["message"])["message"] for one in browser.get_log("performance")]
    asked = [one["params"] for one in log if one["method"] == "Network.requestWillBeSent"]
    sockets = [one["params"] for one in log if one["method"] == "Network.webSocketCreated"]
    urls = [one["request"]["url"] for one in asked] + [one["url"] for one in sockets]
    own = f"http://127.0.0.1:{server.port}/", f"ws://127.0.0.1:{server.port}/live"
    assert {"app.js", "live"} <= {url.rpartition("/")[2] for url in urls}
    assert [url for url in urls if not url.startswith((*own, "data:", "blob:", "about:"))] == []
    assert all(server.key not in url.partition("#")[0] for url in urls)


@pytest.mark.parametrize("view", ["map", "scene"])
def test_paper_has_the_map_and_the_table(view, window, tmp_path):
    if not shutil.which("pdftotext"):
        pytest.skip("no pdftotext here: ./run browser")
    window.click(f'[data-view="{view}"]')
    printed = window.browser.execute_cdp_cmd("Page.printToPDF", {"printBackground": True})
    Path("page.pdf").write_bytes(base64.b64decode(printed["data"]))
    commands = ["pdftotext", "-layout", "page.pdf", "-"], ["pdfimages", "-list", "page.pdf"]
    text, images = (
        subprocess.run(command, check=True, capture_output=True, text=True).stdout
        for command in commands
    )
    assert text.count("\f") == 1  # one page
    boulders = window.complete()["L"]["n"]
    assert re.search(rf" L \S+ .*{boulders} boulders", re.sub(r"\s+", " ", text))
    assert "3-D" not in text
    assert max(int(line.split()[3]) for line in images.splitlines()[2:]) > 500  # pixels
    window.until("the view of before", f"document.querySelector('[data-mode={view}]')")


@pytest.mark.parametrize("width", [390, 1280, 1920])
def test_nothing_is_wider_than_the_page(width, window):
    resize(window.browser, width, 800)
    window.until("the map", "rockfall.pixelOf(arguments[0])", [W + 150, N - 150])
    sizes = "[document.documentElement.scrollWidth, innerWidth]"
    wide, inner = window.browser.execute_script(f"return {sizes}")
    assert wide <= inner == width


def test_a_phone_has_the_legend_above_what_is_shown_and_room_for_fingers(window):
    resize(window.browser, 390, 844)
    top = "rockfall.pixelOf(arguments[0])?.[1]"
    legend = "document.querySelector('.legend').getBoundingClientRect().bottom"
    window.until(
        "a legend above the source", f"{top} >= {legend} && {legend} > 0", [W + 150, N - 40]
    )
    window.click("[data-feature]")
    sizes = window.browser.execute_script("""
    const fields = 'button, select, summary, input[type=text], [role=tab], .check';
    return [...document.querySelectorAll(fields)].filter((one) => one.offsetParent)
        .map((one) => [one.getBoundingClientRect().height, one.outerHTML.slice(0, 80)])""")
    assert len(sizes) > 20 and [one for one in sizes if one[0] < 36] == []


def test_the_page_speaks_the_language_that_is_chosen(window):
    english = window.text("body")
    choose = """
    const select = document.querySelector('[data-action="language"]');
    select.value = 'de'; select.dispatchEvent(new Event('change', {bubbles: true}));"""
    window.browser.execute_script(choose)
    window.until("German", "document.documentElement.lang === 'de'")
    window.complete()
    assert window.text("body") != english
    assert "app." not in window.text("body")


def test_a_result_is_looked_at_without_tools(browser):
    result = rockfall.run(rockfall.read_case("case.nml").replace(output={"trajectories": 5}))
    rockfall.write_result(result, "result.nc")
    show(result).save("view.html")
    with served("result.nc") as server:
        resize(browser, 1280, 800)
        lines = open_window(browser, server).complete()
        assert not browser.find_elements(By.CSS_SELECTOR, '[data-tool="source"]')
        assert lines["L"]["n"] == rockfall.line_statistics(result)["n"].max()
    browser.get(Path("view.html").resolve().as_uri())
    assert Window(browser).complete() == lines
