# SPDX-License-Identifier: BSD-3-Clause
"""Houses and forest stands in the live window."""

from io import BytesIO
from pathlib import Path

import pytest

pytest.importorskip("starlette", reason="the app extra is not installed")
shapely = pytest.importorskip("shapely", reason="the vector extra is not installed")

import rockfall  # noqa: E402
from made import make_layer  # noqa: E402
from rockfall.app.room import Given  # noqa: E402
from rockfall.app.show import PAGE  # noqa: E402
from rockfall.errors import RockfallError  # noqa: E402

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")

W, N = 600000.0, 5000000.0
CASE = f"""&case boulders_total = 200, seed = 7, threads = 1 /
&terrain dem = 'dem.tif' /
&surface uniform_mean_radius = 0.25 /
&impact sets = 'sets.nml' /
&boulder volume = 'normal', volume_mean = 0.8, volume_std = 0.2 /
&release x = {W + 150}, y = {N - 40}, drop_height = 5.0 /
&scenario name = 'blocks', return_period = 10.0 /
&forest polygons = 'wood.gpkg' /
"""
HOUSES = [
    shapely.box(W + 100, N - 250, W + 130, N - 220),
    shapely.box(W + 160, N - 250, W + 180, N - 230),
]
STAND = shapely.box(W + 60, N - 180, W + 240, N - 120)


@pytest.fixture(autouse=True)
def place(write_place):
    write_place(CASE)
    make_layer("houses.gpkg", HOUSES, name=["Hof", "Stall"])
    Path("away").mkdir()
    make_layer("away/barns.gpkg", HOUSES[:1])
    make_layer("wood.gpkg", [STAND], name=["Bannwald"], stems=[400.0], dbh_mean=[30.0],
               dbh_std=[8.0], conifers=[100.0])  # fmt: skip


def shapes(entries):
    return [shapely.from_geojson(str(one["geometry"]).replace("'", '"')) for one in entries]


def test_layers_of_the_folder_are_offered_and_one_is_shown_by_the_names_of_a_hazard(enter):
    page = enter("case.nml")
    assert {"houses.gpkg", "wood.gpkg"} <= {*page.until("welcome")["offers"]["objects"]}
    page.until("batch", complete=True)
    page.ask(objects="houses.gpkg")
    shown = page.until("objects")
    hazard = rockfall.hazard(rockfall.read_case("case.nml"), objects="houses.gpkg")
    assert [one["name"] for one in shown["objects"]] == hazard["object"].values.tolist()
    assert all(a.equals(b) for a, b in zip(shapes(shown["objects"]), HOUSES, strict=True))
    page.ask(objects="")
    assert page.until("objects")["objects"] == []


def test_stands_of_forest_are_shown_with_their_names_and_go_with_the_forest(enter):
    Path("case.nml").write_text(
        CASE + "&variant name = 'today' / &variant name = 'bare', without = 'forest' /",
        encoding="utf-8",
    )
    page = enter("case.nml")
    (stand,) = page.until("background")["stands"]
    assert stand["name"] == "Bannwald" and shapes([stand])[0].equals(STAND)
    (bare,) = [
        one for one in page.room._shown.site.variants.documents.values() if one.variant == "bare"
    ]
    page.send("edit", revision=1, settings=bare.settings | {"forest": {}}, variant="bare")
    assert page.until("background")["stands"] == []


def test_layers_that_are_given_are_shown_from_the_start(enter):
    page = enter("case.nml", given=Given([Path("away/barns.gpkg")]))
    welcome = page.until("welcome")
    assert welcome["offers"]["objects"][0] == welcome["view"]["objects"] == "barns.gpkg"
    assert len(page.until("objects")["objects"]) == 1


def test_what_cannot_be_shown_is_refused(enter):
    Path("broken.gpkg").write_bytes(b"no layer")
    page = enter("case.nml")
    assert "broken.gpkg" not in page.until("welcome")["offers"]["objects"]
    for wrong in ("../away/barns.gpkg", "away/barns.gpkg", "/etc/passwd", 1, ["houses.gpkg"]):
        page.ask(objects=wrong)
        assert page.until("refused")["text"]
    Path("houses.gpkg").unlink()
    page.ask(objects="houses.gpkg")
    assert "houses.gpkg" in page.until("refused")["text"]
    with pytest.raises(RockfallError, match=r"none\.gpkg"):
        enter("case.nml", given=Given([Path("none.gpkg")]))


@pytest.mark.all
@pytest.mark.skipif(not (PAGE / "app.js").exists(), reason="the page is made by ./run page")
def test_houses_are_drawn_where_they_are(browser):
    from matplotlib.image import imread

    from app_window import open_window, served
    from browser import resize

    def colour(page, place):
        page.browser.execute_async_script("""
        requestAnimationFrame(() => requestAnimationFrame(arguments[0]))""")
        picture = imread(BytesIO(browser.get_screenshot_as_png()))[..., :3]
        x, y = page.pixel(place)
        return picture[y, x]

    with served("case.nml") as server:
        resize(browser, 1280, 800)
        page = open_window(browser, server)
        page.click('[data-tab="display"]')
        browser.execute_script("""
        const list = document.querySelector('[data-action=objects]');
        list.value = 'houses.gpkg'; list.dispatchEvent(new Event('change'));""")
        page.until("a row", "document.querySelector('[data-show=objects]').offsetParent")
        house, beside = [W + 170, N - 236], [W + 145, N - 236]
        with_houses = colour(page, house), colour(page, beside)
        page.click("[data-show=objects]")
        without = colour(page, house), colour(page, beside)
        assert abs(with_houses[0] - without[0]).max() > 0.1  # of a maximum of 1
        assert abs(with_houses[1] - without[1]).max() < 0.01
        browser.get("about:blank")
