# SPDX-License-Identifier: BSD-3-Clause
"""Parts of polygons and rasters where no boulder can start are counted, with advice."""

import numpy as np
import pytest

import rockfall
import scenes
from made import make_layer, make_raster, refused
from rockfall.cli import main
from rockfall.scene.read import read_scene
from rockfall.scene.rules.plausible import input_warnings

shapely = pytest.importorskip("shapely", reason="the vector extra is not installed")

CLIFF = shapely.box(100, 300, 200, 400)  # 20 x 20 cells of 5 m
LOST = "have no source cell and release nothing: check steep_cells, or use smaller cells"
UNKNOWN = (
    "lack elevations in or around them and release nothing: fill the DEM with rockfall dem --fill"
)


def terrain(*holes):
    """Slope without elevations in the cells `holes`, given as slices of rows and columns."""
    z = scenes.rough()
    for hole in holes:
        z[hole] = np.nan
    return z


def scene_of(folder, z, memory=None, **groups):
    make_raster(folder / "dem.tif", z, transform=scenes.grid(z).transform, crs="EPSG:32632")
    groups["release"] = {"polygons": "cliff.gpkg"} | groups.get("release", {})
    case = scenes.make_case(folder, *scenes.sets(), **{"terrain": {"dem": "dem.tif"}, **groups})
    return read_scene(case, memory=memory)


def texts_of(scene):
    return [str(text) for _, text in input_warnings(scene)]


HOLES = {  # cells without elevation, and number of 400 source cells that cannot start boulders
    "inside": ([np.s_[4:8, 24:28]], 16),
    "at a corner": ([np.s_[0:3, 38:45]], 6),
    "a node alone": ([np.s_[5:8, 24:27:2], np.s_[5:8:2, 25]], 9),
    "a line of nodes": ([np.s_[:, 25], np.s_[:, 27]], 60),
    "one cell": ([np.s_[10, 30]], 1),
    "none": ([], 0),
}


@pytest.mark.family(4)
@pytest.mark.parametrize("name", HOLES)
@pytest.mark.parametrize("by", ["polygons", "cells", "an array"])
def test_source_cells_without_elevation_are_counted(tmp_path, name, by):
    holes, lost = HOLES[name]
    z = terrain(*holes)
    make_layer(tmp_path / "cliff.gpkg", [CLIFF])
    cells = np.zeros(z.shape, "u1")
    cells[0:20, 20:40] = 1
    make_raster(tmp_path / "cells.tif", cells, scenes.grid(z).transform, "EPSG:32632")
    if by == "polygons":
        scene = scene_of(tmp_path, z)
    else:
        release = {"polygons": None, "cells": "cells.tif"}
        scene = scene_of(tmp_path, z, release=release)
        if by == "an array":
            scene = read_scene(scene.case, cells=cells)
    assert scene.x.size == 400 - lost and scene.known_at(scene.x, scene.y).all()
    said = [text for text in texts_of(scene) if "elevation" in text]
    assert said == [f"{lost} of 400 source cells {UNKNOWN}"] * (lost > 0)


@pytest.mark.parametrize("release", [{"steep_cells": True}, {"by_area": True}])
def test_windows_leave_out_the_same_cells(tmp_path, release):
    z = terrain(np.s_[4:8, 24:28], np.s_[60:70, 3:9])
    cells = np.zeros(z.shape, "u1")
    cells[0:20, 20:40] = cells[55:75, 0:20] = 1
    make_raster(tmp_path / "cells.tif", cells, scenes.grid(z).transform, "EPSG:32632")
    release = {"polygons": None, "cells": "cells.tif", **release}
    whole = scene_of(tmp_path, z, release=release)
    parts = scene_of(tmp_path, z, memory=20_000.0, release=release)
    assert parts.windows and whole.windows is None
    assert np.array_equal(whole.x, parts.x) and np.array_equal(whole.y, parts.y)
    for scene in whole, parts:
        assert f"76 of 800 source cells {UNKNOWN}" in texts_of(scene)


def test_no_elevation_at_all_is_refused_and_filling_helps(tmp_path):
    z = terrain(np.s_[8:12, 24:28])
    make_layer(tmp_path / "cliff.gpkg", [shapely.box(120, 340, 140, 360)])
    with refused(
        f"{tmp_path / 'cliff.gpkg'}: none of its 16 source cells has an elevation: fill the DEM "
        "with rockfall dem --fill, or move them"
    ):
        scene_of(tmp_path, z)
    filled = str(tmp_path / "filled.tif")
    assert main(["dem", str(tmp_path / "dem.tif"), "--fill", "30", "-o", filled]) == 0
    scene = read_scene(
        rockfall.Case(
            case={"boulders": 1}, terrain={"dem": filled}, boulder={"volume_mean": 1.0},
            surface={"uniform_mean_radius": 0.5},
            release={"polygons": str(tmp_path / "cliff.gpkg")},
        )
    )  # fmt: skip
    assert scene.x.size == 16 and not any("elevation" in text for text in texts_of(scene))


NARROW, AWAY = shapely.box(50.1, 300, 50.2, 390), shapely.box(-90, 300, -50, 350)
PARTS = {  # polygons, names: expected remark
    "a part of one": ([[CLIFF, NARROW]], ["A"], "1 of 2 polygons or parts (A (1/2))"),
    "two parts of three": ([[NARROW, CLIFF, AWAY]], ["A"], "2 of 3 polygons or parts (A (2/3))"),
    "all parts of one": ([[NARROW, AWAY], [CLIFF]], ["A", "B"], "2 of 3 polygons or parts (A)"),
    "of both": ([[CLIFF], [NARROW, AWAY]], ["A", "B"], "2 of 3 polygons or parts (B)"),
    "the last, without names": ([[CLIFF], [NARROW]], None, "1 of 2 polygons or parts (2)"),
    "the last two": ([[CLIFF], [AWAY], [NARROW]], None, "2 of 3 polygons or parts (2; 3)"),
    "one under a later one": (
        [[shapely.box(110, 310, 150, 350), NARROW], [CLIFF]], None, "2 of 3 polygons or parts (1)",
    ),
    "none": ([[CLIFF, shapely.box(10, 300, 30, 330)]], ["A"], None),
}  # fmt: skip


@pytest.mark.family(2)
@pytest.mark.parametrize("name", PARTS)
def test_parts_of_polygons_without_a_cell_are_named(tmp_path, name):
    parts, names, said = PARTS[name]
    shapes = [polygons[0] if len(polygons) == 1 else shapely.MultiPolygon(polygons)
              for polygons in parts]  # fmt: skip
    make_layer(tmp_path / "cliff.gpkg", shapes, **({"name": names} if names else {}))
    texts = [text for text in texts_of(scene_of(tmp_path, terrain())) if "source cell" in text]
    assert [text.partition(" have no")[0] for text in texts] == ([said] if said else [])
    assert all(LOST in text for text in texts)


@pytest.mark.family(2)
@pytest.mark.parametrize(
    ("shapes", "said"),
    [
        ([shapely.box(-100, 300, 100, 400)], "1 of 1 polygons extend beyond the DEM by 50"),
        ([CLIFF, shapely.box(250, 300, 310, 400)], "1 of 2 polygons extend beyond the DEM"),
        ([CLIFF, AWAY], "1 of 2 polygons extend beyond the DEM by 16.7 %"),
        ([shapely.MultiPolygon([CLIFF, AWAY])], "1 of 1 polygons extend beyond the DEM by"),
        ([shapely.box(100, 300, 200, 400.5)], None),  # a sliver along the edge
        ([CLIFF], None),
    ],
)
def test_source_polygons_beyond_the_dem_are_counted(tmp_path, shapes, said):
    make_layer(tmp_path / "cliff.gpkg", shapes)
    texts = [text for text in texts_of(scene_of(tmp_path, terrain())) if "beyond" in text]
    assert len(texts) == (said is not None) and all(text.startswith(said) for text in texts)


ALL = shapely.box(0, 0, 300, 400)
ZONES = {  # polygons: expected remark
    "narrow": ([ALL, NARROW], "1 of 2 polygons or parts (zone 2) are too narrow to have a cell"),
    "a narrow part": (
        [ALL, shapely.MultiPolygon([CLIFF, NARROW])],
        "1 of 3 polygons or parts (zone 2) are too narrow to have a cell",
    ),
    "covered": ([CLIFF, ALL], "1 of 2 polygons or parts (zone 1) are covered by later polygons"),
    "beyond": (
        [ALL, shapely.box(290, 0, 390, 400)], "1 of 2 polygons extend beyond the DEM by",
    ),
    "far beyond": ([ALL, AWAY], "1 of 2 polygons extend beyond the DEM by 1.6 %"),
    "a margin": ([ALL.buffer(50)], None),
    "halves": ([shapely.box(0, 0, 152.5, 400), shapely.box(152.5, 0, 300, 400)], None),
}  # fmt: skip


@pytest.mark.family(2)
@pytest.mark.parametrize("name", ZONES)
def test_zones_without_a_cell_or_beyond_the_dem_are_counted(tmp_path, name):
    shapes, said = ZONES[name]
    make_layer(tmp_path / "zones.gpkg", shapes, mean_radius=[0.1, 0.2][: len(shapes)])
    make_layer(tmp_path / "cliff.gpkg", [CLIFF])
    surface = {"uniform_mean_radius": None, "zones": "zones.gpkg"}
    texts = texts_of(scene_of(tmp_path, terrain(), surface=surface))
    texts = [text for text in texts if "no effect" in text or "beyond" in text]
    assert len(texts) == (said is not None) and all(text.startswith(said) for text in texts)


def test_clearings_without_a_stem_are_counted(tmp_path):
    make_layer(tmp_path / "cliff.gpkg", [CLIFF])
    make_layer(tmp_path / "felled.gpkg", [shapely.box(0, 0, 300, 100), NARROW, AWAY])
    forest = {
        "uniform_stems": 500.0, "uniform_dbh_mean": 30.0, "uniform_dbh_std": 5.0,
        "uniform_conifers": 70.0, "clearings": "felled.gpkg",
    }  # fmt: skip
    texts = texts_of(scene_of(tmp_path, terrain(), forest=forest))
    assert "2 of 3 clearings contain no stem: check their position" in texts


@pytest.mark.parametrize(
    ("second", "cells"),
    [
        (shapely.box(150, 300, 250, 400), 200),  # half inside
        (shapely.box(120, 320, 160, 360), 64),  # inside
        (shapely.box(200, 300, 250, 400), 0),  # at a border
        (shapely.box(199.9, 300, 250, 400), 0),  # a sliver without a cell centre
        (shapely.box(210, 300, 250, 400), 0),
    ],
)
def test_overlaps_of_sources_with_attributes_are_counted(tmp_path, second, cells):
    make_layer(tmp_path / "cliff.gpkg", [CLIFF, second], volume_mean=[1.0, 2.0])
    texts = [text for text in texts_of(scene_of(tmp_path, terrain())) if "overlap" in text]
    said = f"polygons overlap in {cells} cells: the later polygon's attributes are used there"
    assert texts == [said] * (cells > 0)


def test_a_covered_zone_is_reported_by_its_name(tmp_path):
    make_layer(tmp_path / "zones.gpkg", [CLIFF, ALL], mean_radius=[0.1, 0.2], name=["wall", "all"])
    make_layer(tmp_path / "cliff.gpkg", [CLIFF])
    surface = {"uniform_mean_radius": None, "zones": "zones.gpkg"}
    texts = texts_of(scene_of(tmp_path, terrain(), surface=surface))
    said = "1 of 2 polygons or parts (wall) are covered by later polygons and have no effect"
    assert [text for text in texts if "no effect" in text][0].startswith(said)
