# SPDX-License-Identifier: BSD-3-Clause
"""DXF drawings as layers: drawn objects are read, and objects left out are reported."""

import numpy as np
import pytest

import rockfall
import scenes
from made import every_third, make_layer, make_raster, refused
from rockfall.io.vectors.layers import (
    burn_polygons,
    layer_names,
    read_features,
    read_lines,
    read_polygons,
)
from rockfall.scene.read import read_scene

ezdxf = pytest.importorskip("ezdxf", reason="the cad extra is not installed")
shapely = pytest.importorskip("shapely", reason="the vector extra is not installed")

W, N = 600000.0, 5000000.0
GRID = scenes.grid(np.empty((80, 60)), 5.0, W, N - 400)
NO_CRS = "the drawing has no CRS: its coordinates are interpreted in the CRS of the DEM"


@pytest.fixture
def drawing():
    made = ezdxf.new("R2010")
    made.header["$INSUNITS"] = 6
    return made


def saved(drawing, folder, name="plan.dxf"):
    drawing.saveas(folder / name)
    return folder / name


def on(layer, **more):
    return {"layer": layer, **more}


def lines_of(path, layer=None, grid=GRID):
    remarks = []
    lines, columns = read_lines(path, layer, grid, remarks)
    assert columns == {}
    return [part for (part,) in lines], remarks


@pytest.mark.parametrize("version", ["R12", "R2000", "R2010", "R2018"])
def test_names_with_umlauts_and_places_come_back_in_every_version(version, tmp_path):
    drawing = ezdxf.new(version)
    xy = [(W + 10.125, N - 100.0625), (W + 60.5, N - 103.75), (W + 200.0, N - 99.0)]
    drawing.modelspace().add_polyline2d(xy, dxfattribs=on("Straße_Süd"))
    drawing.modelspace().add_line((W, N), (W + 1, N - 1), dxfattribs=on("Übriges"))
    path = saved(drawing, tmp_path, "Geländeplan.dxf")
    assert layer_names(path) == ["Straße_Süd", "Übriges"]
    (line,), _ = lines_of(path, "Straße_Süd")
    np.testing.assert_array_equal(line, xy)


def test_lines_of_every_kind_are_lines(drawing, tmp_path):
    space = drawing.modelspace()
    space.add_line((0, 0, 5), (3, 4, 9))
    space.add_lwpolyline([(0, 0), (10, 0), (10, 10)], close=True)
    space.add_polyline3d([(0, 0, 5), (10, 0, 6), (10, 10, 7)])
    space.add_arc((50, 50), 10, 0, 90)
    space.add_circle((50, 50), 20)
    space.add_ellipse((0, 0), major_axis=(10, 0), ratio=0.5)
    space.add_lwpolyline([(0, 0, 1), (10, 0, 0)], format="xyb")  # half circle
    lines, _ = lines_of(saved(drawing, tmp_path))
    lengths = [shapely.LineString(line).length for line in lines]
    wanted = [5.0, 20 + np.hypot(10, 10), 20.0, 5 * np.pi, 40 * np.pi, 48.442241, 5 * np.pi]
    np.testing.assert_allclose(lengths, wanted, rtol=2e-3)
    arc = lines[3]
    np.testing.assert_allclose(np.hypot(*(arc - 50).T), 10, atol=1e-5)
    chords = np.hypot(*((arc[1:] + arc[:-1]) / 2 - 50).T)
    assert (chords > 10 - 0.01 - 1e-6).all()  # within a centimetre
    assert (lines[1][0] == lines[1][-1]).all() and len(lines[1]) == 4


def test_blocks_are_taken_apart_where_they_are_inserted(drawing, tmp_path):
    block = drawing.blocks.new("net")
    block.add_line((0, 0), (1, 0), dxfattribs=on("0"))
    block.add_line((0, 1), (1, 1), dxfattribs=on("own"))
    outer = drawing.blocks.new("outer")
    outer.add_blockref("net", (5, 0), dxfattribs=on("0", rotation=90))
    space = drawing.modelspace()
    space.add_blockref("net", (100, 200), dxfattribs=on("nets", xscale=7, yscale=7))
    space.add_blockref("outer", (300, 0), dxfattribs=on("nets"))
    space.add_blockref("net", (0, 0), dxfattribs=on("rows", column_count=3, column_spacing=10))
    path = saved(drawing, tmp_path)
    assert sorted(layer_names(path)) == ["nets", "own", "rows"]
    lines, _ = lines_of(path, "nets")
    np.testing.assert_allclose(lines, [[(100, 200), (107, 200)], [(305, 0), (305, 1)]], atol=1e-12)
    lines, _ = lines_of(path, "rows")
    assert [line[0].tolist() for line in lines] == [[0, 0], [10, 0], [20, 0]]


def test_closed_lines_are_polygons_and_others_are_refused(drawing, tmp_path):
    space = drawing.modelspace()
    corners = [(W + 50, N - 60), (W + 90, N - 60), (W + 90, N - 100)]
    space.add_lwpolyline(corners, close=True, dxfattribs=on("Quelle"))
    space.add_lwpolyline([*corners, corners[0]], dxfattribs=on("Quelle"))  # closed explicitly
    space.add_text("Fels", dxfattribs=on("Quelle"))
    space.add_lwpolyline(corners, dxfattribs=on("Kante"))
    path, remarks = saved(drawing, tmp_path), []
    shapes, _ = read_polygons(path, GRID, remarks, "quelle")  # DXF ignores case
    assert [shape.area for shape in shapes] == [800.0, 800.0]
    assert remarks == [f"{path}, layer Quelle: omitted because they are not polygons: 1 TEXT"]
    with refused(
        f"{path}, layer Kante: a LWPOLYLINE from x 600050.00, y 4999940.00 is not closed: must be "
        "a polygon"
    ):
        read_polygons(path, GRID, [], "Kante")
    shapes, _ = read_features(path, GRID, [], "Kante")
    assert [shape.geom_type for shape in shapes] == ["LineString"]


def test_what_is_left_out_and_assumed_is_said(drawing, tmp_path):
    drawing.header["$INSUNITS"] = 4
    space = drawing.modelspace()
    space.add_line((0, 0), (1, 0))
    space.add_line((5, 5), (5, 5))
    space.add_point((1, 1))
    space.add_mtext("hier")
    space.add_polymesh((3, 3))
    space.add_hatch().paths.add_polyline_path([(0, 0), (1, 0), (1, 1)])
    drawing.layout("Layout1").add_line((0, 0), (9, 9))  # paper space
    path = saved(drawing, tmp_path)
    grid = scenes.Grid(W, N, 5.0, 60, 80, crs=ezcrs())
    lines, remarks = lines_of(path, grid=grid)
    assert len(lines) == 1
    assert remarks == [
        f"{path}, layer 0: omitted because they are not lines: 1 LINE without length, 1 POINT, "
        "1 MTEXT, 1 POLYLINE, 1 HATCH",
        f"{path}, layer 0: omitted: 1 entities in paper space. Move them to model space with "
        "_CHSPACE in CAD",
        f"{path}, layer 0: {NO_CRS}, and its unit mm as metres",
    ]


def square(x, y, side):
    return [(x, y), (x + side, y), (x + side, y + side), (x, y + side)]


RINGS = {
    "a hole": [square(0, 0, 10), square(3, 3, 4)],
    "an island in a hole": [square(0, 0, 10), square(2, 2, 6), square(4, 4, 2)],
    "a hole in an island": [square(0, 0, 10), square(1, 1, 8), square(2, 2, 6), square(4, 4, 2)],
    "two areas": [square(0, 0, 10), square(20, 0, 10)],
    "two areas, a hole in the second": [square(0, 0, 10), square(20, 0, 10), square(23, 3, 4)],
    "the hole first": [square(3, 3, 4), square(0, 0, 10)],
    "a hole at the side": [square(0, 0, 10), square(0, 3, 4)],
    "areas side by side": [square(0, 0, 10), square(10, 0, 10)],
}
AREAS = {  # [m2] by style: islands in holes, one level of holes, no holes
    "a hole": (84, 84, 100), "an island in a hole": (68, 64, 100),
    "a hole in an island": (68, 36, 100), "two areas": (200, 200, 200),
    "two areas, a hole in the second": (184, 184, 200), "the hole first": (84, 84, 100),
    "a hole at the side": (84, 84, 100), "areas side by side": (200, 200, 200),
}  # fmt: skip


def hatched(space, rings, edges=False, style=0, layer="Fels"):
    """Add a hatch whose boundaries have the flags of CAD programs: the first is external."""
    hatch = space.add_hatch(dxfattribs=on(layer, hatch_style=style))
    for k, ring in enumerate(rings):
        flags = (1, 16, 0)[min(k, 2)]
        if not edges:
            hatch.paths.add_polyline_path(ring, flags=flags)
            continue
        path = hatch.paths.add_edge_path(flags)
        for start, end in zip(ring, ring[1:] + ring[:1], strict=True):
            path.add_line(start, end)
    return hatch


@pytest.mark.family(5)
@pytest.mark.parametrize("name", every_third(RINGS))
@pytest.mark.parametrize("edges", [False, True])
@pytest.mark.parametrize("style", range(3))
def test_hatches_have_the_area_of_their_style(name, edges, style, drawing, tmp_path):
    space = drawing.modelspace()
    hatched(space, RINGS[name], edges, style)
    for ring in RINGS[name]:
        space.add_lwpolyline(ring, close=True, dxfattribs=on("Fels"))  # drawn around it
    space.add_lwpolyline(square(50, 50, 10), close=True, dxfattribs=on("Fels"))
    path = saved(drawing, tmp_path)
    shapes, _ = read_polygons(path, GRID, [], "Fels")
    assert [shape.area for shape in shapes] == [AREAS[name][style], 100]
    lines, remarks = lines_of(path, "Fels")
    assert len(lines) == len(RINGS[name]) + 1
    assert remarks == [f"{path}, layer Fels: omitted because they are not lines: 1 HATCH"]


def test_hatches_of_arcs_of_blocks_and_with_room_for_texts(drawing, tmp_path):
    space = drawing.modelspace()
    ring = space.add_hatch(dxfattribs=on("Kreis")).paths
    ring.add_edge_path(1).add_arc((50, 50), 20, 0, 360)
    ring.add_edge_path(16).add_ellipse((50, 50), (10, 0), 0.5, 0, 360)
    hatched(drawing.blocks.new("cliff"), RINGS["an island in a hole"], layer="0")
    space.add_blockref("cliff", (100, 100), dxfattribs=on("Block", xscale=2, yscale=3))
    text = hatched(space, [square(0, 0, 10)], layer="Text")
    text.paths.add_polyline_path(square(4, 4, 2), flags=8)
    bulge = space.add_hatch(dxfattribs=on("Bogen")).paths
    bulge.add_polyline_path([(0, 0, 1), (10, 0, 0)])  # half disc
    path = saved(drawing, tmp_path)
    for layer, area in ("Kreis", np.pi * 350), ("Block", 68 * 6), ("Text", 100), (
        "Bogen", np.pi * 12.5,
    ):  # fmt: skip
        (shape,), _ = read_polygons(path, GRID, [], layer)
        assert shape.area == pytest.approx(area, rel=3e-3)
    (shape,), _ = read_polygons(path, GRID, [], "Block")
    assert shape.bounds == (100, 100, 120, 130)


def test_a_closed_line_that_bounds_no_hatch_stays(drawing, tmp_path):
    """A circle in a hatched square has the same bounds as the square, but is not its outline."""
    space = drawing.modelspace()
    hatched(space, [square(0, 0, 10)])
    space.add_circle((5, 5), 5, dxfattribs=on("Fels"))
    shapes, _ = read_polygons(saved(drawing, tmp_path), GRID, [], "Fels")
    assert sorted(shape.area for shape in shapes) == pytest.approx([25 * np.pi, 100], rel=3e-3)


def test_gaps_of_hatches_are_closed_and_boundaries_across_themselves_refused(drawing, tmp_path):
    space = drawing.modelspace()
    path = space.add_hatch(dxfattribs=on("Lücke")).paths.add_edge_path(1)
    for start, end in ((0, 0), (8.99, 0)), ((9, 0), (9, 9)), ((8.99, 9), (0, 9)):
        path.add_line(start, end)
    hatched(space, [[(0, 0), (9, 9), (9, 0), (0, 9)]], layer="kreuz")
    file = saved(drawing, tmp_path)
    (shape,), _ = read_polygons(file, GRID, [], "Lücke")
    assert shape.area == pytest.approx(81, rel=2e-3)
    with pytest.raises(rockfall.RockfallError, match=r"feature 1: invalid polygon: Self-inters"):
        read_polygons(file, GRID, [], "kreuz")


def test_a_layer_of_hatches_does_not_stand_between_lines_and_their_only_layer(drawing, tmp_path):
    space = drawing.modelspace()
    hatched(space, [square(0, 0, 10)])
    space.add_line((0, 0), (9, 9), dxfattribs=on("road"))
    lines, _ = lines_of(saved(drawing, tmp_path))
    assert len(lines) == 1


def test_paper_space_is_counted_and_refused_where_it_has_all(drawing, tmp_path):
    hatched(drawing.modelspace(), [square(0, 0, 10)])
    for layout in (drawing.layout("Layout1"), drawing.layouts.new("A3")):
        layout.add_line((0, 0), (9, 9), dxfattribs=on("fels"))
        layout.add_line((0, 0), (9, 9), dxfattribs=on("road"))
        layout.add_text("legend", dxfattribs=on("fels"))
    path, remarks = saved(drawing, tmp_path), []
    read_polygons(path, GRID, remarks)
    move = "move them with _CHSPACE in CAD"
    assert remarks == [
        f"{path}, layer Fels: omitted: 2 entities in paper space. Move them to model space with "
        "_CHSPACE in CAD"
    ]
    with refused(f"{path}, layer Road: 2 entities in paper space, none in model space: {move}"):
        lines_of(path, "Road")
    drawing.modelspace().delete_all_entities()
    path = saved(drawing, tmp_path)
    for read in lines_of, layer_names:
        with refused(f"{path}: 4 entities in paper space, none in model space: {move}"):
            read(path)


def ezcrs():
    from rasterio.crs import CRS

    return CRS.from_epsg(32632)


@pytest.mark.filterwarnings("ignore:case")
def test_a_case_of_a_drawing_is_the_case_of_a_geopackage(drawing, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    make_raster(tmp_path / "dem.tif", scenes.rough(nx=60, ny=80))
    road = [(W + 10, N - 200), (W + 150, N - 205), (W + 290, N - 200)]
    net = [(W + 10, N - 150), (W + 290, N - 150)]
    cliff = [(W + 140, N - 12), (W + 160, N - 12), (W + 160, N - 22), (W + 140, N - 22)]
    space = drawing.modelspace()
    space.add_lwpolyline(road, dxfattribs=on("Straße"))
    space.add_lwpolyline(net, dxfattribs=on("Netz"))
    space.add_lwpolyline(cliff, close=True, dxfattribs=on("Fels"))
    saved(drawing, tmp_path)
    for name, shape in (
        ("Straße", shapely.LineString(road)),
        ("Netz", shapely.LineString(net)),
        ("Fels", shapely.Polygon(cliff)),
    ):
        make_layer(tmp_path / "plan.gpkg", [shape], layer=name)
    results = []
    for name in ("plan.dxf", "plan.gpkg"):
        case = scenes.make_case(
            tmp_path, *scenes.sets(), terrain={"dem": "dem.tif"}, case={"boulders": 3, "seed": 5},
            release={"polygons": name, "polygons_layer": "Fels", "drop_height": 2.0},
            line=[{"file": name, "layer": "Straße"}],
        )  # fmt: skip
        case = case.replace(
            barrier=[{"file": name, "layer": "Netz", "height": 4.0, "capacity": 500.0}]
        )
        scene = read_scene(case)
        results.append(rockfall.run(case))
        assert [line["name"] for line in scene.case.line] == ["Straße"]
    drawn, layers = results
    assert NO_CRS in drawn.attrs["input_warnings"]
    for name in ("stop_x", "stop_y", "crossing_time", "crossing_outcome"):
        np.testing.assert_array_equal(drawn[name].values, layers[name].values)


def bomb(drawing):
    """Draw ten nested blocks, each with ten copies of the previous: 10^10 lines."""
    drawing.blocks.new("b0").add_line((0, 0), (1, 1))
    for k in range(1, 11):
        block = drawing.blocks.new(f"b{k}")
        for _ in range(10):
            block.add_blockref(f"b{k - 1}", (0, 0))
    drawing.modelspace().add_blockref("b10", (0, 0))


def grid_bomb(drawing):
    drawing.blocks.new("one").add_line((0, 0), (1, 1))
    counts = on("0", column_count=30000, row_count=30000, column_spacing=1, row_spacing=1)
    drawing.modelspace().add_blockref("one", (0, 0), dxfattribs=counts)


def circle_of_blocks(drawing):
    drawing.blocks.new("a").add_blockref("b", (0, 0))
    drawing.blocks.new("b").add_blockref("a", (0, 0))
    drawing.modelspace().add_blockref("a", (0, 0))


def nowhere(drawing):
    drawing.modelspace().add_line((float("nan"), 0), (1, 1))


@pytest.mark.family(2)
@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (bomb, "its blocks have more than 1,000 entities"),
        (grid_bomb, "its blocks have more than 1,000 entities"),
        (circle_of_blocks, "blocks within blocks, more than 16 deep"),
        (nowhere, "layer 0: LINE has coordinates that are not finite"),
    ],
)
def test_drawings_without_an_end_are_one_line(spoil, message, drawing, tmp_path, monkeypatch):
    monkeypatch.setattr("rockfall.io.vectors.drawing.MAX_PARTS", 1000)
    spoil(drawing)
    path = saved(drawing, tmp_path)
    with refused(f"{path}: {message}"):
        lines_of(path)


def test_a_circle_as_large_as_the_sun_has_few_chords(drawing, tmp_path):
    drawing.modelspace().add_circle((0, 0), 7e8)
    (line,), _ = lines_of(saved(drawing, tmp_path))
    assert 100 < len(line) < 5000


def test_damaged_drawings_are_one_line(drawing, tmp_path):
    drawing.modelspace().add_lwpolyline([(0, 0), (10, 0), (10, 10)])
    whole = saved(drawing, tmp_path).read_bytes()
    path = tmp_path / "cut.dxf"
    refusals = 0
    for size in range(0, len(whole), len(whole) // 40):
        path.write_bytes(whole[:size])
        try:
            lines_of(path)
        except rockfall.RockfallError as error:
            refusals += 1
            assert str(error).startswith(f"{path}: ") and error.code == 2
    assert refusals > 20
    path.write_bytes(b"PK\x03\x04 no drawing \xff" * 50)
    with pytest.raises(rockfall.RockfallError, match="cannot be read as a DXF drawing"):
        lines_of(path)


def test_layers_and_attributes_that_are_not_there_are_one_line(drawing, tmp_path):
    for name in ("a", "b"):
        drawing.modelspace().add_line((0, 0), (1, 0), dxfattribs=on(name))
    drawing.modelspace().add_text("x", dxfattribs=on("texts"))
    path = saved(drawing, tmp_path)
    with refused(f"{path}: no layer texts (layers: a, b)"):
        lines_of(path, "texts")
    with refused(f"{path}: has 2 layers (a, b): choose one with layer"):
        lines_of(path)
    with refused(f"{path}: attribute zone is missing: a drawing has no attributes"):
        burn_polygons(path, GRID, "zone")
