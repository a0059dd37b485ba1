# SPDX-License-Identifier: BSD-3-Clause
"""Borders of polygons through cell centres: each cell and each tree belongs to only one
neighbour."""

import numpy as np
import pytest

import scenes
from made import make_layer, make_raster
from rockfall.analysis.objects.segments import _sources_on
from rockfall.cli import main
from rockfall.io.rasters.dem import read_dem
from rockfall.io.rasters.grid import NO_ID, Grid
from rockfall.io.vectors.layers import burn_polygons, numbered_polygons
from rockfall.io.vectors.polygons import held_cells, points_inside
from rockfall.scene.read import read_scene
from rockfall.scene.rules.plausible import implausible

shapely = pytest.importorskip("shapely", reason="the vector extra is not installed")

#: Corners and sizes for which centres are inexact numbers, and some for which they are exact.
GRIDS = [
    Grid(600000.0, 5000000.0, 5.0, 24, 24),
    Grid(2600000.1, 1200000.3, 0.1, 24, 24),
    Grid(-0.7, 9999999.9, 1 / 3, 24, 24),
    Grid(0.0, 0.0, 25.0, 24, 24),
]


def on_centres(grid, *corners):
    return shapely.Polygon([(grid.x[column], grid.y[row]) for column, row in corners])


def block(grid, first, last):
    (i, j), (k, m) = first, last
    return on_centres(grid, (i, j), (k, j), (k, m), (i, m))


def held(shapes, grid):
    """Number of polygons that contain each cell, if each is drawn separately."""
    alone = (held_cells([(shape, 1)], grid, np.zeros(grid.shape, "u1")) for shape in shapes)
    return np.sum([*alone], axis=0)


@pytest.mark.parametrize("grid", GRIDS)
def test_a_square_of_five_cells_has_25_wherever_it_lies(grid):
    for first in (2, 2), (7, 2), (2, 7), (7, 7), (11, 13):
        square = block(grid, first, (first[0] + 5, first[1] + 5))
        for shape in square, square.reverse():
            assert held([shape], grid).sum() == 25


@pytest.mark.family(3)
@pytest.mark.parametrize("grid", GRIDS)
@pytest.mark.parametrize("seed", range(4))
def test_triangles_that_share_corners_at_centres_share_no_cell(grid, seed):
    places = np.random.default_rng(seed).integers(0, 24, (30, 2))
    corners = [(0, 0), (0, 23), (23, 0), (23, 23), *places.tolist()]
    points = shapely.multipoints([(grid.x[column], grid.y[row]) for column, row in corners])
    triangles = shapely.get_parts(shapely.delaunay_triangles(points))
    count = held(triangles, grid)
    assert (count[:-1, 1:] == 1).all() and count.sum() == 23 * 23  # west and south edges are open
    x, y = (axis.ravel() for axis in np.meshgrid(grid.x, grid.y))
    marks = np.zeros(x.size, int)
    for _, inside in points_inside(triangles, x, y):
        marks[inside] += 1
    assert np.array_equal(marks.reshape(grid.shape), count)  # trees behave like cells


@pytest.mark.parametrize("grid", GRIDS)
def test_a_long_border_against_short_ones_and_a_hole_against_its_filling(grid):
    long = on_centres(grid, (1, 1), (21, 21), (1, 21))  # exactly through centres
    short = [
        on_centres(grid, (k, k), (k + 5, k + 5), (k + 5, k)) for k in (1, 6, 11, 16)
    ]  # fmt: skip
    assert held([long, *short], grid).max() == 1
    diagonal = np.arange(2, 21)
    assert (held([long, *short], grid)[diagonal, diagonal] == 1).all()
    filling = block(grid, (8, 8), (14, 15))
    ring = shapely.difference(block(grid, (3, 4), (20, 20)), filling)
    assert np.array_equal(held([ring, filling], grid), held([block(grid, (3, 4), (20, 20))], grid))


@pytest.mark.parametrize("name", ["a.gpkg", "a.shp", "a.geojson", "a.fgb"])
def test_sources_and_zones_of_every_kind_of_layer_share_borders(tmp_path, name):
    grid, layer, over = GRIDS[0], tmp_path / name, tmp_path / f"over_{name}"
    shapes = [
        block(grid, (2, 2), (7, 7)),
        block(grid, (7, 2), (12, 7)),
        block(grid, (2, 7), (12, 9)),
    ]
    make_layer(layer, shapes, zone=[1, 2, 3])
    cells, _, columns = numbered_polygons(layer, grid, [])
    cells = np.append(0, columns["zone"])[cells]  # a FlatGeobuf changes the order
    assert np.bincount(cells.ravel())[1:].tolist() == [25, 25, 20]
    remarks = []
    zones = burn_polygons(layer, grid, "zone", remarks)
    assert np.array_equal(np.where(zones == NO_ID, 0, zones), cells) and not remarks
    shapes[1] = block(grid, (6, 2), (12, 7))
    make_layer(over, shapes, zone=[1, 2, 3])
    burn_polygons(over, grid, "zone", remarks)
    assert "overlap in 5 cells" in remarks[0]


def test_a_case_has_25_sources_and_no_overlap_of_its_zones(tmp_path):
    z = scenes.rough()
    grid = scenes.grid(z)
    make_layer(tmp_path / "cliff.gpkg", [block(grid, (10, 4), (15, 9))], crs=None)
    halves = [block(grid, (0, 0), (30, 79)), block(grid, (30, 0), (59, 79))]
    outside = shapely.difference(shapely.box(-5, -5, 305, 405), shapely.union_all(halves))
    make_layer(tmp_path / "zones.gpkg", [*halves, outside], crs=None, mean_radius=[0.1, 0.2, 0.3])
    case = scenes.make_case(
        tmp_path, *scenes.sets(), release={"polygons": "cliff.gpkg"},
        surface={"uniform_mean_radius": None, "zones": "zones.gpkg"},
    )  # fmt: skip
    scene = read_scene(case, dem=z, transform=grid)
    assert scene.x.size == 25
    assert not [line for line in implausible(scene) if "overlap" in line]
    assert np.bincount(scene.rasters.zone.ravel())[1:3].tolist() == [30 * 79, 29 * 79]


def test_a_tree_on_the_border_of_two_clearings_is_felled(tmp_path):
    z = scenes.rough()
    grid = scenes.grid(z)
    halves = [block(grid, (10, 30), (20, 40)), block(grid, (20, 30), (30, 40))]
    make_layer(tmp_path / "felled.gpkg", halves, crs=None)
    trees = [(grid.x[i], grid.y[j]) for i in (10, 15, 20, 25, 30, 40) for j in (30, 35, 40)]
    lines = [f"{x},{y},30,spruce\n" for x, y in trees]
    (tmp_path / "trees.csv").write_text("x,y,dbh,species\n" + "".join(lines))
    case = scenes.make_case(
        tmp_path, *scenes.sets(), release={"x": [grid.x[30]], "y": [grid.y[4]]},
        forest={"trees": "trees.csv", "clearings": "felled.gpkg"},
    )  # fmt: skip
    left = read_scene(case, dem=z, transform=grid).trees
    rows = {
        (round((x - 2.5) / 5), round((397.5 - y) / 5)) for x, y in zip(left.x, left.y, strict=True)
    }
    assert rows == {(10, 30), (10, 35), (10, 40), (15, 40), (20, 40), (25, 40), (30, 40)} | {
        (40, 30), (40, 35), (40, 40),
    }  # fmt: skip


def test_a_cut_of_two_plots_lowers_each_cell_once(tmp_path):
    z = np.full((24, 24), 100.0)
    grid = GRIDS[0]
    make_raster(tmp_path / "dem.tif", z, transform=grid.transform)
    plots = [block(grid, (3, 3), (8, 12)), block(grid, (8, 3), (12, 12))]
    make_layer(tmp_path / "cut.gpkg", plots, depth=[2.0, 3.0])
    command = ["dem", str(tmp_path / "dem.tif"), "--cut", str(tmp_path / "cut.gpkg")]
    assert main([*command, "-o", str(tmp_path / "out.tif")]) == 0
    after, _ = read_dem(tmp_path / "out.tif")
    depths, cells = np.unique(z - after, return_counts=True)
    assert depths.tolist() == [0.0, 2.0, 3.0] and cells[1:].tolist() == [45, 36]


def test_a_source_on_the_side_of_a_road_counts_for_one_side():
    class Places:
        x, y = np.array([0.0, 5.0, 10.0, 5.0, 5.0]), np.array([5.0, 5.0, 5.0, 0.0, 10.0])

    assert _sources_on([shapely.box(0, 0, 5, 10), shapely.box(5, 0, 10, 10)], Places) == 3
