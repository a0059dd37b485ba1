# SPDX-License-Identifier: BSD-3-Clause
"""Map of the live window: its initial view and its layers."""

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("starlette", reason="the app extra is not installed")
pytest.importorskip("uvicorn", reason="the app extra is not installed")
pytest.importorskip("selenium", reason="selenium is not installed")
pytest.importorskip("shapely", reason="the vector extra is not installed")

import scenes  # noqa: E402
from app_window import CASE, N, W, open_window, served  # noqa: E402
from browser import resize  # noqa: E402
from made import make_raster  # noqa: E402
from rockfall.app.show import PAGE  # noqa: E402

pytestmark = [
    pytest.mark.all,
    pytest.mark.usefixtures("slope"),
    pytest.mark.filterwarnings("ignore::UserWarning"),
    pytest.mark.skipif(not (PAGE / "app.js").exists(), reason="the page is made by ./run page"),
]

OPTIONS = "[...document.querySelectorAll('[data-action=map] option')].map(({ value }) => value)"
CHOOSE = """
const list = document.querySelector('[data-action=map]');
list.value = arguments[0]; list.dispatchEvent(new Event('change'));"""


def test_the_view_opens_where_sources_and_lines_are_and_not_on_the_whole_dem(browser):
    make_raster("dem.tif", scenes.rough(1000, 1000, dtype="f4"))
    east = 1800
    text = CASE.replace(f"x = {W + 150}, y = {N - 40}", f"x = {W + east}, y = {N - 4740}")
    line = f"x = {W + east - 100}, {W + east + 100}, y = {N - 4900}, {N - 4900}"
    text = text.replace(f"x = {W}, {W + 300}, y = {N - 200}, {N - 200}", line)
    Path("case.nml").write_text(text, encoding="utf-8")
    with served("case.nml") as server:
        resize(browser, 1280, 800)
        window = open_window(browser, server)
        left, top, width, height = browser.execute_script("""
        const { left, top, width, height } = document.getElementById('map').getBoundingClientRect();
        return [left, top, width, height]""")
        ends = [W + east, N - 4740], [W + east - 100, N - 4900], [W + east + 100, N - 4900]
        places = [window.pixel(one) for one in ends]
        assert all(left < x < left + width and top < y < top + height for x, y in places)
        across, down = (max(one) - min(one) for one in zip(*places, strict=True))
        assert across > width / 4 or down > height / 4  # 160 m of 5,000 m: the rest is not in view
        before = window.pixel([W + east, N - 4740])
        window.click('[data-action="plus"]')  # from now on the view is that of the user
        moved = (
            "Math.hypot(...rockfall.pixelOf(arguments[0]).map((at, k) => at - arguments[1][k])) > 5"
        )
        window.until("a nearer view", moved, [W + east, N - 4740], before)
        zoomed = window.until("no more motion", STILL, [W + east, N - 4740])
        resize(browser, 1279, 800)
        window.draw("source", [W + east + 20, N - 4800])
        window.complete(1)
        now = window.pixel([W + east, N - 4740])
        assert abs(now[0] - zoomed[0]) < 3 and abs(now[1] - zoomed[1]) < 3
        browser.get("about:blank")


STILL = """(() => {
  const at = rockfall.pixelOf(arguments[0]);
  const same = window.lastAt && at.every((one, k) => one === window.lastAt[k]);
  window.lastAt = at;
  return same && at;
})()"""


def test_the_list_has_twelve_maps_until_it_is_unfolded(window):
    first = window.browser.execute_script(f"return {OPTIONS}")
    assert len(first) == 1 + 12 + 1 and first[0] == "" and first[-1] == "+"
    assert "passages" in first and not [one for one in first if one.endswith(("_low", "_high"))]
    window.browser.execute_script(CHOOSE, "+")
    every = window.browser.execute_script(f"return {OPTIONS}")
    assert {*first} < {*every} and len(every) == len({*every}) > 40
    limits = [one for one in every if one.endswith(("_low", "_high"))]
    assert "energy_q95_low" in limits and every[-1 - len(limits) : -1] == limits  # below all others
    window.browser.execute_script(CHOOSE, "energy_q95_low")
    window.until("the map", "rockfall.batch?.overlay?.name === 'energy_q95_low'")
    window.browser.execute_script(CHOOSE, "+")
    folded = window.browser.execute_script(f"return {OPTIONS}")
    assert len(folded) == 14 and "energy_q95_low" in folded  # the layer shown stays in it


def test_contours_are_where_the_ground_has_their_elevation(browser):
    z = scenes.rough(dtype="f4")
    z[40:60, 40:60] = np.nan
    make_raster("dem.tif", z)
    with served("case.nml") as server:
        resize(browser, 1280, 800)
        window = open_window(browser, server)
        assert browser.execute_script("return rockfall.contours") == []  # created when first shown
        window.click('[data-tab="display"]')
        window.click('[data-show="contours"]')
        shown = window.until("contours", "rockfall.contours.length && rockfall.contours")
        off = browser.execute_script("""
        return rockfall.contours.flatMap(({ elevation, vertices }) => vertices.map((place) => {
          const z = rockfall.elevation(place);
          return z === null ? 0 : Math.abs(z - elevation);
        })).reduce((a, b) => Math.max(a, b), 0)""")
        browser.get("about:blank")
    assert off < 0.01  # [m], single-precision error
    levels = np.array([one["elevation"] for one in shown])
    steps = np.diff(levels)
    assert (steps == steps[0]).all() and (levels % steps[0] == 0).all()
    assert np.nanmin(z) <= levels[0] < np.nanmin(z) + steps[0]
    assert np.nanmax(z) - steps[0] < levels[-1] <= np.nanmax(z)
    assert 8 <= levels.size <= 42 and sum(len(one["vertices"]) for one in shown) > 500
