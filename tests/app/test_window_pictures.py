# SPDX-License-Identifier: BSD-3-Clause
"""Background pictures of the live window, from local files."""

import json
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from io import BytesIO
from pathlib import Path
from urllib.parse import parse_qsl, urlsplit

import numpy as np
import pytest

pytest.importorskip("starlette", reason="the app extra is not installed")
pytest.importorskip("shapely", reason="the vector extra is not installed")
rasterio = pytest.importorskip("rasterio", reason="rasterio is not installed")
images = pytest.importorskip("matplotlib.image", reason="the report extra is not installed")
imread, imsave = images.imread, images.imsave

from rasterio import warp  # noqa: E402

from rockfall.app.room import Given  # noqa: E402
from rockfall.app.show import PAGE  # noqa: E402
from rockfall.app.web_map import origin_of  # noqa: E402
from rockfall.errors import RockfallError  # noqa: E402

pytestmark = [
    pytest.mark.usefixtures("slope"),
    pytest.mark.filterwarnings("ignore::UserWarning"),
]

W, N = 600000.0, 5000000.0
SIZE = 300.0, 400.0  # size of the terrain [m]
MAGENTA = 200, 0, 200


def write_picture(path, bands, west=W, north=N, cell=5.0, crs="EPSG:32632"):
    bands = np.asarray(bands)
    about = {"driver": "GTiff", "count": bands.shape[0], "dtype": bands.dtype, "crs": crs}
    height, width = bands.shape[1:]
    place = rasterio.transform.from_origin(west, north, cell, cell)
    with rasterio.open(path, "w", width=width, height=height, transform=place, **about) as file:
        file.write(bands)
    return Path(path)


def halves():
    """Picture of 60 x 40 pixels for the northern half of the terrain: magenta in the west, green in
    the east."""
    bands = np.zeros((3, 40, 60), "u1")
    bands[:, :, :30] = np.array(MAGENTA)[:, None, None]
    bands[1, :, 30:] = 180
    return bands


def colour_at(shown, x, y):
    """Red, green, blue and opacity at a point, `x` east and `y` south [m] of the north-western
    corner."""
    west, east, south, north = shown["extent"]
    rgba = shown["arrays"]["rgba"]
    assert (east - west, north - south) == SIZE
    row, column = int(y / SIZE[1] * rgba.shape[0]), int(x / SIZE[0] * rgba.shape[1])
    return rgba[row, column].tolist()


def test_a_picture_lies_where_it_lies_and_is_transparent_beyond(enter):
    write_picture("ortho.tif", halves())
    page = enter("case.nml")
    assert {"ortho.tif", "dem.tif"} <= {*page.until("welcome")["offers"]["basemaps"]}
    page.ask(basemap="ortho.tif")
    shown = page.until("basemap", chosen="ortho.tif")
    assert colour_at(shown, 70, 100) == [*MAGENTA, 255]
    assert colour_at(shown, 230, 100) == [0, 180, 0, 255]
    assert colour_at(shown, 70, 300)[3] == colour_at(shown, 230, 300)[3] == 0
    page.ask(basemap="")
    assert "rgba" not in page.until("basemap", chosen="")["arrays"]


@pytest.mark.all
def test_a_picture_of_another_crs_is_laid_over_the_terrain(enter):
    corners = [W, W + 300], [N - 200, N]
    (west, east), (south, north) = warp.transform("EPSG:32632", "EPSG:4326", *corners)
    bands = np.zeros((3, 400, 400), "u1")
    bands[:, :, :200] = np.array(MAGENTA)[:, None, None]
    about = {"driver": "GTiff", "count": 3, "dtype": "uint8", "crs": "EPSG:4326"}
    place = rasterio.transform.from_bounds(west, south, east, north, 400, 400)
    with rasterio.open("degrees.tif", "w", width=400, height=400, transform=place, **about) as file:
        file.write(bands)
    page = enter("case.nml")
    page.ask(basemap="degrees.tif")
    shown = page.until("basemap", chosen="degrees.tif")
    assert colour_at(shown, 100, 100) == [*MAGENTA, 255]
    assert colour_at(shown, 200, 100) == [0, 0, 0, 255]


def test_any_raster_can_be_one_in_greys_from_its_lowest_to_its_highest(enter):
    values = np.repeat(np.linspace(-3e3, 9e3, 60, dtype="f4")[None], 80, axis=0)
    values[:10] = np.nan
    write_picture("moisture.tif", [values])
    page = enter("case.nml")
    page.ask(basemap="moisture.tif")
    shown = page.until("basemap", chosen="moisture.tif")
    west, middle, east = (colour_at(shown, x, 200) for x in (2, 150, 298))
    assert west == [0, 0, 0, 255] and east == [255] * 4
    assert len({*middle[:3]}) == 1 and 115 < middle[0] < 140
    assert colour_at(shown, 150, 20)[3] == 0


@pytest.mark.all
def test_a_picture_that_is_given_is_shown_from_the_start(enter):
    Path("far").mkdir()
    picture = write_picture("far/photo.tif", halves())
    page = enter("case.nml", given=Given(basemap=picture))
    welcome = page.until("welcome")
    assert welcome["view"]["basemap"] == welcome["offers"]["basemaps"][0] == "photo.tif"
    assert colour_at(page.until("basemap"), 70, 100) == [*MAGENTA, 255]


def test_what_is_no_picture_of_the_place_is_refused(enter):
    write_picture("apart.tif", halves(), west=W + 1e5)
    write_picture("nowhere.tif", halves(), crs=None)
    Path("broken.png").write_bytes(b"no picture")
    page = enter("case.nml")
    for name, word in ("apart.tif", "apart"), ("nowhere.tif", "CRS"), ("broken.png", "picture"):
        page.ask(basemap=name)
        assert word in page.until("refused")["text"]
    for wrong in ("../case/ortho.tif", "/etc/passwd", "http://example.org/wms", 3):
        page.ask(basemap=wrong)
        assert page.until("refused")["text"]
    with pytest.raises(RockfallError, match=r"none\.tif"):
        enter("case.nml", given=Given(basemap=Path("none.tif")))


@pytest.mark.all
@pytest.mark.skipif(not (PAGE / "app.js").exists(), reason="the page is made by ./run page")
def test_the_picture_is_seen_below_the_results_and_no_request_leaves_the_machine(browser):
    from app_window import open_window, served
    from browser import resize

    write_picture("ortho.tif", halves())
    browser.get_log("performance")
    with served("case.nml") as server:
        resize(browser, 1280, 800)
        window = open_window(browser, server)
        window.click('[data-tab="display"]')
        browser.execute_script("""
        const list = document.querySelector('[data-action=basemap]');
        list.value = 'ortho.tif'; list.dispatchEvent(new Event('change'));""")
        window.until("a picture", "document.querySelector('[data-show=basemap]').offsetParent")
        browser.execute_async_script("""
        requestAnimationFrame(() => requestAnimationFrame(arguments[0]))""")
        pixels = imread(BytesIO(browser.get_screenshot_as_png()))[..., :3]
        x, y = window.pixel([W + 60, N - 180])  # outside the reached area
        assert np.abs(255 * pixels[y, x] - MAGENTA).max() < 6
        browser.get("about:blank")
    log = [json.loads(one["message"])["message"] for one in browser.get_log("performance")]
    asked = [one["params"] for one in log if one["method"] == "Network.requestWillBeSent"]
    own = f"http://127.0.0.1:{server.port}/", "data:", "blob:", "about:"
    assert asked and all(one["request"]["url"].startswith(own) for one in asked)


class Maps(BaseHTTPRequestHandler):
    """Web map service with a single colour, which records its requests."""

    def do_GET(self):
        self.server.asked.append(dict(parse_qsl(urlsplit(self.path).query)))
        picture = BytesIO()
        imsave(picture, np.full((8, 8, 3), MAGENTA, "u1"), format="png")
        self.send_response(200)
        self.send_header("Content-Type", "image/png")
        self.send_header("Access-Control-Allow-Origin", "*")
        self.end_headers()
        self.wfile.write(picture.getvalue())

    def log_message(self, *_):
        pass


@pytest.fixture
def maps():
    server = ThreadingHTTPServer(("127.0.0.1", 0), Maps)
    server.asked = []
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    yield server
    server.shutdown()
    thread.join()


@pytest.mark.all
@pytest.mark.skipif(not (PAGE / "app.js").exists(), reason="the page is made by ./run page")
def test_a_web_map_is_requested_only_where_the_user_has_added_it(browser, maps):
    from app_window import open_window, served
    from browser import resize

    url = f"http://127.0.0.1:{maps.server_port}/wms"
    for wms in "", f"{url}?LAYERS=ortho":
        with served("case.nml", wms) as server:
            resize(browser, 1280, 800)
            window = open_window(browser, server)
            browser.execute_async_script(
                """
            const image = new Image();
            image.onload = image.onerror = () => arguments[1]();
            image.src = arguments[0];""",
                f"{url}?by=hand",
            )
            if wms:
                end = window.until("an answer", "performance.getEntriesByType('resource').length")
                assert end
        if not wms:
            assert maps.asked == []  # not even manually: the policy of the page forbids it
            browser.get_log("browser")
    browser.get("about:blank")
    mapped = [one for one in maps.asked if "by" not in one]
    assert mapped and all(one["LAYERS"] == "ortho" for one in mapped)
    assert {one["SRS"] for one in mapped} == {"EPSG:32632"}
    west, south, east, north = map(float, mapped[-1]["BBOX"].split(","))
    assert west < W + 150 < east and south < N - 200 < north


@pytest.mark.parametrize(
    "url", ["ftp://host/wms?LAYERS=a", "https://host/wms", "https://h;img-src */w?LAYERS=a", "a"]
)
def test_an_address_that_is_no_web_map_is_refused(url):
    with pytest.raises(RockfallError, match="--wms .*LAYERS=NAME"):
        origin_of(url)
