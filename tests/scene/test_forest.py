# SPDX-License-Identifier: BSD-3-Clause
"""Trees of a case, from lists, from layers, and generated from stands."""

from pathlib import Path

import numpy as np
import pytest
from scipy import stats

import rockfall
import scenes
from made import make_layer, make_raster, refused
from rockfall.errors import RockfallError
from rockfall.scene import forest
from rockfall.scene.forest import made
from rockfall.scene.read import read_scene
from rockfall.text.preview import preview

NY, NX, CELL = 80, 60, 5.0
MADE = {
    "uniform_stems": 500.0, "uniform_dbh_mean": 30.0, "uniform_dbh_std": 12.0,
    "uniform_conifers": 70.0,
}  # fmt: skip
LIST = "x,y,dbh,species,who\n100,200,30,spruce,a\n 120.5, 210.25, 41.5, Fagus sylvatica, b\n"


def scene_of(folder, trees, nx=NX, ny=NY, cell=CELL, **arrays):
    """Scene on a slope with trees; the south-western corner of the raster is at 0, 0."""
    case = scenes.make_case(
        folder, *scenes.sets(), release={"x": [150.0], "y": [380.0]}, forest=trees
    )
    z = scenes.rough(nx, ny)
    return read_scene(case, dem=z, transform=scenes.grid(z, cell), **arrays)


def trees_of(folder, trees, **known):
    return scene_of(folder, trees, **known).trees


# ---- lists


def test_a_table_of_trees(tmp_path):
    (tmp_path / "trees.csv").write_text(LIST)
    scene = scene_of(tmp_path, {"trees": "trees.csv"})
    assert np.array_equal(scene.trees, [[100, 120.5], [200, 210.25], [30, 41.5], [0.9, 1.5]])
    assert {"trees", "species_table"} <= scene.checksums.keys() and "trees" in scene.decoded


@pytest.mark.parametrize("name", ["trees.gpkg", "trees.shp", "trees.geojson", "trees.fgb"])
def test_a_layer_of_points_holds_the_same_trees(tmp_path, name):
    shapely = pytest.importorskip("shapely")
    (tmp_path / "trees.csv").write_text(LIST)
    shapes = [shapely.Point(100, 200), shapely.Point(120.5, 210.25)]
    columns = {"DBH": [30.0, 41.5], "species": ["spruce", "Fagus sylvatica"]}
    make_layer(tmp_path / name, shapes, crs=None, **columns)
    listed = trees_of(tmp_path, {"trees": "trees.csv"})
    layer = trees_of(tmp_path, {"trees": name})
    order = np.argsort(layer.x)  # FlatGeobuf has its own order
    assert np.array_equal(np.array(layer)[:, order], listed)


def test_a_table_of_species_that_a_user_wrote(tmp_path):
    (tmp_path / "trees.csv").write_text("x,y,dbh,species\n9,9,20,Weide\n9,8,20,Abies alba\n")
    (tmp_path / "mine.csv").write_text(
        "species;genus;factor\nweide;salix;0.7\nx;abies;1.2\nconifer;;1\nbroadleaf;;2\n"
    )
    trees = trees_of(tmp_path, {"trees": "trees.csv", "species_table": "mine.csv"})
    assert trees.factor.tolist() == [0.7, 1.2]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "trees.csv: is empty"),
        ("x,y,dbh,species\n", "trees.csv: no rows below the header"),
        ("x,y,species\n1,2,fir\n",
         "trees.csv: line 1: column dbh is missing (columns: x, y, species)"),
        ("x,y,dbh,species\n1,2,nan,fir\n",
         "trees.csv: line 2: dbh = nan: must be a number >= 0 and <= 1000"),
        ("x,y,dbh,species\n1,2,-3,fir\n",
         "trees.csv: line 2: dbh = -3: must be a number >= 0 and <= 1000"),
        ("x,y,dbh,species\n1,2,3000,fir\n",
         "trees.csv: line 2: dbh = 3000: must be a number >= 0 and <= 1000"),
        ("x,y,dbh,species\n1,2,0,fir\n", "trees.csv: line 2: dbh = 0: must be > 0 [cm]"),
        ("x,y,dbh,species\ninf,2,3,fir\n",
         "trees.csv: line 2: x = inf: must be a number >= -1e+12 and <= 1e+12"),
        ("x,y,dbh,species\n1,2,3\n", "trees.csv: line 2: has 3 columns, but the header has 4"),
        ("x,y,dbh,species\n1,2,3,\n", "trees.csv: line 2: species = : must not be empty"),
        ("x,y,dbh\n1,2,3\n",
         "trees.csv: has no species: add them, or set &forest conifers or uniform_conifers"),
        ("x,y,dbh,species\n-1,2,3,fir\n1,-2,3,fir\n",
         "trees.csv: all trees are outside the terrain: x -1 to 1, y -2 to 2; "
         "the terrain: x 0 to 300, y 0 to 400"),
    ],
)  # fmt: skip
def test_a_list_with_a_fault(tmp_path, monkeypatch, text, words):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "trees.csv").write_text(text)
    with refused(words):
        scene_of(Path(), {"trees": "trees.csv"})


def test_a_species_that_is_not_known(tmp_path):
    (tmp_path / "trees.csv").write_text("x,y,dbh,species\n1,2,3,fir\n1,2,3,bamboo\n")
    with pytest.raises(
        RockfallError, match=r"tree 2: species = bamboo: is not in .*species: .*oak"
    ):
        trees_of(tmp_path, {"trees": "trees.csv"})


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        ({"dbh": [30.0, None], "species": ["fir", "fir"]},
         r"feature 2: dbh = nan: must be > 0 and at most 1000 \[cm\]"),
        ({"dbh": [-30.0, 3.0], "species": ["fir", "fir"]}, r"feature 1: dbh = -30: must be > 0"),
        ({"dbh": ["30", "30"], "species": ["fir", "fir"]}, "attribute dbh: must be a number"),
        ({"species": ["fir", "fir"]}, r"attribute dbh is missing \(attributes: species\)"),
        ({"dbh": [30.0, 30.0], "species": ["fir", None]}, "feature 2: has no species"),
        ({"dbh": [30.0, 30.0]}, "has no species"),
    ],
)  # fmt: skip
def test_a_layer_with_a_fault(tmp_path, columns, words):
    shapely = pytest.importorskip("shapely")
    shapes = [shapely.Point(100, 200), shapely.Point(120, 210)]
    make_layer(tmp_path / "trees.gpkg", shapes, crs=None, **columns)
    with pytest.raises(RockfallError, match=rf"trees\.gpkg: {words}"):
        trees_of(tmp_path, {"trees": "trees.gpkg"})


@pytest.mark.parametrize("other", ["LINESTRING (0 0, 9 9)", "POLYGON ((0 0, 9 0, 9 9, 0 0))"])
def test_a_layer_of_other_shapes(tmp_path, other):
    shapely = pytest.importorskip("shapely")
    shapes = [shapely.Point(100, 200), shapely.from_wkt(other)]
    make_layer(tmp_path / "trees.gpkg", shapes, crs=None, dbh=[30.0, 3.0], species=["fir", "fir"])
    with pytest.raises(RockfallError, match="feature 2: is a .*, but points are required"):
        trees_of(tmp_path, {"trees": "trees.gpkg"})


def test_trees_outside_the_terrain_are_left_out_and_counted(tmp_path):
    (tmp_path / "trees.csv").write_text(LIST + "-5,3,3,fir,\n1e9,3,3,fir,\n")
    scene = scene_of(tmp_path, {"trees": "trees.csv"})
    assert scene.trees.x.tolist() == [100, 120.5]
    assert any("2 of 4 trees are outside the terrain" in one for one in scene.remarks)


# ---- generated from stands


def test_stems_a_hectare_diameters_and_conifers_are_as_they_should(tmp_path):
    trees = trees_of(tmp_path, MADE)
    expected = 500 * NX * NY * CELL**2 / 1e4
    assert abs(trees.x.size - expected) < 4 * np.sqrt(expected)
    shape, scale = (30 / 12) ** 2, 12**2 / 30
    assert stats.kstest(trees.dbh, stats.gamma(shape, scale=scale).cdf).pvalue > 1e-3
    assert abs(trees.dbh.mean() - 30) < 4 * 12 / np.sqrt(trees.x.size)
    kurtosis = 3 + 6 / shape  # variance of a variance
    assert abs(trees.dbh.var() / 144 - 1) < 4 * np.sqrt((kurtosis - 1) / trees.x.size)
    assert set(trees.factor) == {0.93, 1.59}
    assert abs((trees.factor == 0.93).mean() - 0.7) < 4 * np.sqrt(0.21 / trees.x.size)
    for places, size in ((trees.x, NX * CELL), (trees.y, NY * CELL)):
        assert stats.kstest(places / size, "uniform").pvalue > 1e-3


@pytest.mark.all
@pytest.mark.parametrize("spread", ["random", "even"])
def test_the_mean_distance_from_tree_to_tree_along_a_line(tmp_path, spread):
    """The mean distance between trees hit along a line is 10000/(stems per ha (2 R_b + DBH)); for
    random trees so is the distance to the first."""
    wide = MADE | {"uniform_dbh_std": 0.0, "spread": spread}
    trees = trees_of(tmp_path, wide, nx=200, ny=200)
    rng = np.random.default_rng(2)
    radius, reach, lines = 0.5, 300.0, 4000
    start = rng.uniform(reach, 200 * CELL - reach, (lines, 2))
    angle = rng.uniform(0, 2 * np.pi, lines)
    hits, first = np.empty(lines), np.empty(lines)
    for k in range(lines):
        dx, dy = trees.x - start[k, 0], trees.y - start[k, 1]
        c, s = np.cos(angle[k]), np.sin(angle[k])
        along, across = dx * c + dy * s, dy * c - dx * s
        near = (np.abs(across) < radius + 0.15) & (along > 0)
        hits[k] = np.count_nonzero(near & (along < reach))
        first[k] = along[near].min(initial=np.inf)
    expected = 1e4 / (trees.x.size / 100 * 1.3)
    mean, error = reach / hits.mean(), reach / hits.mean() ** 2 * hits.std() / np.sqrt(lines)
    assert error < 0.01 * expected and abs(mean - expected) < 4 * error + 0.01 * expected
    if spread == "random":
        assert abs(first.mean() - expected) < 4 * first.std() / np.sqrt(lines)


def test_even_cells_hold_what_their_raster_says(tmp_path):
    per_cell = np.random.default_rng(1).integers(0, 4, (NY, NX))
    stems = per_cell / CELL**2 * 1e4
    even = MADE | {"uniform_stems": None, "stems": "given", "spread": "even"}
    trees = trees_of(tmp_path, even, stems=stems)
    row, column = ((NY * CELL - trees.y) // CELL).astype(int), (trees.x // CELL).astype(int)
    found = np.zeros((NY, NX), int)
    np.add.at(found, (row, column), 1)
    assert np.array_equal(found, per_cell)


def test_a_tree_is_a_function_of_the_seed_and_its_cell(tmp_path, monkeypatch):
    """A tree depends on the seed of the forest and on its cell, but not on the number of cells or
    blocks of rows."""
    stems = np.full((NY, NX), 500.0)
    given = MADE | {"uniform_stems": None, "stems": "given"}
    one = np.array(trees_of(tmp_path, given, stems=stems))
    assert np.array_equal(one, trees_of(tmp_path, MADE))
    assert not np.array_equal(one[:, :9], np.array(trees_of(tmp_path, MADE | {"seed": 2}))[:, :9])
    stems[40:] = 0
    half = np.array(trees_of(tmp_path, given, stems=stems))
    assert np.array_equal(one[:, one[1] > 40 * CELL], half)
    monkeypatch.setattr(
        made, "row_blocks", lambda shape: (slice(k, k + 1) for k in range(shape[0]))
    )
    assert np.array_equal(one, trees_of(tmp_path, MADE))


def test_rasters_in_files_give_the_same_as_arrays(tmp_path):
    rng = np.random.default_rng(5)
    rasters = {
        "stems": rng.uniform(0, 900, (NY, NX)), "dbh_mean": rng.uniform(10, 50, (NY, NX)),
        "dbh_std": rng.uniform(0, 20, (NY, NX)), "conifers": rng.uniform(0, 100, (NY, NX)),
    }  # fmt: skip
    rasters = {name: values.astype("f4") for name, values in rasters.items()}
    one = trees_of(tmp_path, dict.fromkeys(rasters, "given"), **rasters)
    z = scenes.rough()
    place = scenes.grid(z).transform
    make_raster(tmp_path / "dem.tif", z, place, None)
    for name, values in rasters.items():
        make_raster(tmp_path / f"{name}.tif", values, place, None)
    case = scenes.make_case(
        tmp_path, *scenes.sets(), release={"x": [150.0], "y": [380.0]},
        forest={name: f"{name}.tif" for name in rasters}, terrain={"dem": "dem.tif"},
    )  # fmt: skip
    scene = read_scene(case)
    assert np.array_equal(one, scene.trees)
    assert rasters.keys() <= scene.checksums.keys()
    windowed = read_scene(case, memory=20_000)
    assert windowed.windows and np.array_equal(one, windowed.trees)
    assert windowed.decoded == scene.decoded


def test_no_trees_where_no_number_is_known(tmp_path):
    stems = np.full((NY, NX), np.nan)
    stems[:, 10:20] = 800.0
    trees = trees_of(tmp_path, MADE | {"uniform_stems": None, "stems": "given"}, stems=stems)
    assert 10 * CELL <= trees.x.min() and trees.x.max() < 20 * CELL


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("stems", -1.0, "-1 where trees stand: must be 0 to 1,000,000 stems per hectare"),
        ("stems", 2e6, r"2e\+06 where trees stand"),
        ("stems", 0.0, "no trees on the terrain at these stems per hectare"),
        ("dbh_mean", np.nan, "nan where trees stand: must be > 0 and at most 1000 cm"),
        ("dbh_mean", 0.0, "0 where trees stand"),
        ("dbh_std", -1.0, "-1 where trees stand: must be 0 to 1000 cm"),
        ("conifers", 101.0, "101 where trees stand: must be 0 to 100 %"),
    ],
)
def test_a_raster_with_a_fault(tmp_path, key, value, words):
    known = MADE | {f"uniform_{key}": None, key: "given"}
    with pytest.raises(RockfallError, match=words):
        trees_of(tmp_path, known, **{key: np.full((NY, NX), value)})


def test_species_of_a_list_by_the_share_of_conifers(tmp_path):
    rows = "".join(f"{k % 300},{k % 400},20\n" for k in range(4000))
    (tmp_path / "trees.csv").write_text("x,y,dbh\n" + rows)
    conifers = np.where(np.arange(NX) < 30, 100.0, 25.0) + np.zeros((NY, 1))
    trees = trees_of(tmp_path, {"trees": "trees.csv", "conifers": "given"}, conifers=conifers)
    west = trees.x < 30 * CELL
    assert (trees.factor[west] == 0.93).all()
    share = (trees.factor[~west] == 0.93).mean()
    assert abs(share - 0.25) < 4 * np.sqrt(0.1875 / np.count_nonzero(~west))


def test_a_share_of_conifers_in_place_of_a_percentage_is_doubted(tmp_path):
    found = scene_of(tmp_path, MADE | {"uniform_conifers": 0.7})
    assert any("conifers: at most 0.7 %: is the value a fraction" in one for one in found.remarks)
    assert not scene_of(tmp_path, MADE).remarks


def test_a_stand_is_described_before_it_is_run(tmp_path):
    page = preview(scene_of(tmp_path, MADE))
    trees = trees_of(tmp_path, MADE)
    row = next(line for line in page.splitlines() if line.split()[:1] == ["forest"])
    assert f"{trees.x.size:,} stems on 12 ha" in row
    assert f"mean DBH {trees.dbh.mean():.1f} cm" in row
    assert "trees 1 MB" in page
    assert " forest " not in preview(scene_of(tmp_path, {}))


@pytest.mark.parametrize(("dbh", "unit"), [(0.3, "m"), (300.0, "mm")])
def test_diameters_in_another_unit_are_doubted(tmp_path, dbh, unit):
    with pytest.warns(UserWarning, match=f"mean diameter of {dbh:g} cm: is the value in {unit}"):
        case = scenes.make_case(
            tmp_path, *scenes.sets(), case={"boulders": 1}, release={"x": [150.0], "y": [380.0]},
            forest=MADE | {"uniform_dbh_mean": dbh, "uniform_dbh_std": 0.0},
        )  # fmt: skip
        rockfall.run(case, dem=scenes.rough(), transform=scenes.grid(scenes.rough()))


def test_memory_of_a_large_forest(tmp_path):
    """Stems take 64 bytes each, in Python and in the kernel together, without the kernel's grid."""
    trees = forest.trees.Trees(*np.zeros((4, 1000)))
    assert trees.bytes == 64_000
