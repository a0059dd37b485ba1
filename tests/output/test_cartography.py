# SPDX-License-Identifier: BSD-3-Clause
"""Maps on paper: correct scales and labels, and no overlapping elements."""

import re
from itertools import combinations

import numpy as np
import pytest

import rockfall
from rockfall.errors import RockfallError
from rockfall.io.rasters.grid import Grid
from rockfall.plots.extent import reached
from rockfall.plots.map_figures import Look, map_figure, stops_figure
from rockfall.result.maps.classes import LIMITS, classes_of, read_limits
from scenes import grid, make_case, rough, sets

pytest.importorskip("matplotlib", reason="the report extra is not installed").use("Agg")
from rockfall.plots.cartography import basemap, marks, rasters, relief, sheet  # noqa: E402

Z = rough()
TERRAIN = (Z, grid(Z))
CROWDED = [
    {"name": f"line {k} of many", "x": [0.0, 300.0], "y": [280.0 - 6 * k, 300.0 - 12 * k]}
    for k in range(9)
]
NET = {"name": "net", "x": [100.0, 200.0], "y": [250.0, 252.0], "height": 3.0, "capacity": 500.0}


@pytest.fixture(scope="module")
def crowded(tmp_path_factory):
    """Result with lines too close to each other for all of their names."""
    groups = {"line": CROWDED, "release": {"x": 150.0, "y": 380.0}}
    output = {"maps": ["passages", "energy_max", "jump_height_max_map"]}
    folder = tmp_path_factory.mktemp("crowded")
    case = make_case(folder, *sets(), terrain={}, output=output, **groups)
    case = case.replace(barrier=[NET])
    return rockfall.run(case, dem=Z, transform=TERRAIN[1])


def texts_of(figure):
    """Every visible text, and its box [dots]."""
    from matplotlib.text import Text

    figure.draw_without_rendering()
    seen = [one for one in figure.findobj(Text) if one.get_visible() and one.get_text().strip()]
    return [(one.get_text(), one.get_window_extent()) for one in seen]


@pytest.mark.family(3)
@pytest.mark.parametrize(
    ("name", "shape"), [("passages", "upright"), ("stops", "upright"), ("energy_max", "broad")]
)
def test_no_text_lies_on_another_or_beyond_the_sheet(crowded, name, shape):
    terrain, result = TERRAIN, crowded
    if shape == "broad":  # other sheets have other places
        result = crowded.assign(stop_x=crowded["stop_x"] + 900 * (crowded["stop_x"] > 150))
        terrain = (np.tile(Z, (1, 5)), Grid(-100.0, TERRAIN[1].north, 5.0, 5 * Z.shape[1], len(Z)))
    draw = stops_figure if name == "stops" else map_figure
    figure = draw(result, *([] if name == "stops" else [name]), terrain)
    texts = texts_of(figure)
    said = [text for text, _ in texts]
    assert {"N", "0", "release", "barrier", "evaluation line"} <= {*said}
    assert any(text.startswith("contours every") for text in said)
    assert sum(text.startswith("line ") for text in said) >= 3  # some are omitted, not all
    for (one, box), (other, beside) in combinations(texts, 2):
        apart = box.x1 <= beside.x0 or beside.x1 <= box.x0
        assert apart or box.y1 <= beside.y0 or beside.y1 <= box.y0, (one, other)
    wide, high = figure.bbox.size
    for text, box in texts:
        assert box.x0 >= 0 and box.y0 >= 0 and box.x1 <= wide and box.y1 <= high, text


def test_the_scale_bar_is_as_long_as_it_says(crowded):
    from matplotlib.patches import Rectangle

    figure = map_figure(crowded, "passages", TERRAIN)
    frame = figure.axes[0]
    lengths = [one.get_width() for one in figure.artists if isinstance(one, Rectangle)]
    (end,) = (one.get_text() for one in figure.texts if re.fullmatch(r"[0-9.]+ m", one.get_text()))
    assert len(lengths) == 2
    west, east = frame.get_xlim()
    per_inch = (east - west) / (frame.get_position().width * figure.get_figwidth())
    assert sum(lengths) * per_inch == pytest.approx(float(end.split()[0]))


def test_the_scale_of_a_map_is_round_and_holds_at_its_size(crowded):
    """A line below a map has its scale, and its coordinate system or that there is none."""
    place = {
        "projected_crs_name": "ETRS89 / UTM zone 32N",
        "crs_wkt": 'X[AUTHORITY["EPSG","25832"]]',
    }
    result = crowded.assign(crs=crowded["crs"].assign_attrs(place))
    for room in (sheet.PAGE, sheet.Room(3.5, 4.0)):
        for figure in (
            map_figure(result, "passages", TERRAIN, room=room),
            stops_figure(result, TERRAIN, room=room),
        ):
            said = next(one.get_text() for one in figure.texts if " on A4" in one.get_text())
            assert said.endswith("on A4; ETRS89 / UTM zone 32N, EPSG:25832")
            denominator = float(said.split(" on ")[0].removeprefix("1:").replace(",", ""))
            frame = figure.axes[0]
            west, east = frame.get_xlim()
            printed = frame.get_position().width * figure.get_figwidth() * 0.0254  # [m]
            assert (east - west) / printed == pytest.approx(denominator)
            assert denominator == sheet.round_scale(denominator)
            assert figure.get_figwidth() == room.wide and figure.get_figheight() <= room.high
    said = [one.get_text() for one in stops_figure(crowded, TERRAIN).texts]
    assert any(one.endswith("no coordinate system is given") for one in said)


def test_classes_and_colours_are_the_same_for_every_result(crowded):
    energy = crowded["energy_max"]
    half = crowded.assign(energy_max=energy.copy(data=energy / 2))  # keeps its attributes
    for name, unit in (("energy_max", "kJ"), ("jump_height_max_map", "m")):
        bars = [map_figure(one, name).axes[1] for one in (crowded, half)]
        ticks = [[one.get_text() for one in bar.get_xticklabels()] for bar in bars]
        assert ticks[0] == ticks[1] == list(classes_of(unit).ticks)
    assert {30.0, 300.0} < {*LIMITS["kJ"]} and {1.0, 5.0} < {*LIMITS["m"]}
    values = np.array([np.nan, 30.0, np.nextafter(30, 31), 300.0, 300.1])
    chosen = classes_of("kJ", read_limits(["kJ=30,300"]))
    assert chosen.numbers(values).tolist() == [-1, 0, 1, 1, 2]
    assert chosen.labels == ["up to 30", "30 to 300", "above 300"]
    figure = map_figure(crowded, "energy_max", look=Look({"kJ": (30.0, 300.0)}))
    image = figure.axes[0].images[-1]
    shown = image.norm(np.array([30.0, 30.001, 300.0, 300.1])).tolist()
    assert shown == [0, 1, 1, 2]  # as in the legend, and in QGIS


@pytest.mark.parametrize("text", ["kJ", "kJ=", "kJ=30,x", "kJ=300,30", "kJ=1,nan", "J=3", "kJ=3,3"])
def test_limits_that_are_none_are_refused(text):
    with pytest.raises(RockfallError, match="must be unit=limit,limit"):
        read_limits([text])


@pytest.mark.parametrize("side", [3, 60])
def test_many_sources_are_outlined_and_hide_nothing(crowded, side):
    """The length of the outline of 9 or 3,600 source cells is their perimeter."""
    x, y = np.meshgrid(*[102.5 + 5.0 * np.arange(side)] * 2)
    inside, cells = marks.outlined(np.column_stack([x.ravel(), y.ravel()]), 1.0)
    sides = rasters.edges(inside, cells)
    assert inside.all() and cells.cell == 5.0
    length = np.abs(np.diff(sides, axis=1)).sum()
    assert length == pytest.approx(4 * side * 5.0)  # the perimeter, without inner edges
    assert sides.min() == 100.0 and sides.max() == pytest.approx(100 + 5 * side)
    few = marks.outlined(np.column_stack([x.ravel(), y.ravel()]), 20.0)[1]
    assert few.cell == 20.0  # cells too small to be visible are merged


def test_relief_is_lit_from_the_north_west_and_nodata_is_white():
    x, y = np.meshgrid(np.arange(40.0), np.arange(40.0)[::-1])
    cone = -np.hypot(x - 20, y - 20)
    cone[0, 0] = np.nan
    light = relief.shade(cone, 1.0)
    assert light[10, 10] > light[30, 10] > light[30, 30] and light[0, 0] == 1
    assert relief.DARKEST <= light.min() < 0.5 < light[10, 10] <= 1


def test_contours_lie_at_their_elevation():
    found = relief.contours_of(TERRAIN, reached_all())
    assert found.interval in relief.INTERVALS and found.curves
    assert all(level % found.interval == 0 for level in found.curves)
    column = TERRAIN[1].x
    for level, curves in found.curves.items():
        for x, y in curves[0][2:-2]:
            k, row = int((x - column[0]) // 5), int((TERRAIN[1].y[0] - y) // 5)
            near = Z[row : row + 2, k : k + 2]
            assert near.min() - 1e-6 <= level <= near.max() + 1e-6


def reached_all():
    one = TERRAIN[1]
    return one.west, one.east, one.south, one.north


def test_a_basemap_lies_where_it_lies_in_its_own_crs(tmp_path, monkeypatch, crowded):
    import rasterio.warp
    import xarray as xr

    monkeypatch.chdir(tmp_path)
    extent = reached(crowded, TERRAIN)
    with pytest.raises(RockfallError, match="has a CRS"):
        basemap.read_basemap("x.tif", crowded.drop_vars("crs"), extent)
    crs = rasterio.crs.CRS.from_epsg(32632)
    result = xr.Dataset({"crs": ((), 0, {"crs_wkt": crs.to_wkt()})})
    west, south = 600000.0, 5000000.0
    bounds = rasterio.warp.transform_bounds(crs, "EPSG:4326", west, south, west + 100, south + 100)
    about = {"width": 200, "height": 200, "count": 3, "dtype": "uint8", "driver": "GTiff"}
    place = rasterio.transform.from_bounds(*bounds, 200, 200)
    picture = np.zeros((3, 200, 200), "u1")
    picture[0, :, :100] = 200  # red in the west
    with rasterio.open("o.tif", "w", crs="EPSG:4326", transform=place, **about) as file:
        file.write(picture)
    found = basemap.read_basemap("o.tif", result, (west, west + 100, south, south + 100))
    middle = len(found.colours) // 2
    assert found.colours[middle, 10].tolist() == [200, 0, 0]
    assert found.colours[middle, -10].tolist() == [0, 0, 0]
    with pytest.raises(RockfallError, match="does not overlap"):
        basemap.read_basemap("o.tif", result, (0.0, 100.0, 0.0, 100.0))
    with rasterio.open("n.tif", "w", transform=place, **about) as file:
        file.write(picture)
    with pytest.raises(RockfallError, match="n.tif: has no CRS"):
        basemap.read_basemap("n.tif", result, (west, west + 100, south, south + 100))


def test_maps_share_the_shade_of_a_terrain_but_not_of_another():
    z = np.add.outer(np.arange(30.0) ** 1.5, np.sin(np.arange(20.0)))
    first = relief.shade(z, 2.0)
    assert relief.shade(z.copy(), 2.0) is first and not first.flags.writeable
    for other in (relief.shade(z, 4.0), relief.shade(z.astype("f4"), 2.0), relief.shade(-z, 2.0)):
        assert other is not first
    z[3, 4] = np.nan
    assert relief.shade(z, 2.0)[2, 4] == 1
