# SPDX-License-Identifier: BSD-3-Clause
"""Stands of trees from polygons, trees left by clearings, and lying logs."""

import numpy as np
import pytest

import rockfall
import scenes
from made import make_layer, refused
from rockfall.errors import RockfallError
from rockfall.kernel_rules import EAD_ENERGY
from rockfall.language import speaking, translated
from rockfall.protection.recorded import stands_of as stands_in
from rockfall.scene.forest.attributes import NAMES, matching
from rockfall.scene.read import read_scene
from rockfall.studies.variants import compare_variants
from rockfall.table import as_text
from rockfall.tables.run import stand_tables
from rockfall.text.preview import preview
from rockfall.text.summary import summary

shapely = pytest.importorskip("shapely", reason="the vector extra is not installed")

NY, NX, CELL = 80, 60, 5.0
ALL = shapely.box(-10, -10, NX * CELL + 10, NY * CELL + 10)
GIVEN = {"stems": [500.0], "dbh_mean": [30.0], "dbh_std": [12.0], "conifers": [70.0]}
MADE = {
    "uniform_stems": 500.0, "uniform_dbh_mean": 30.0, "uniform_dbh_std": 12.0,
    "uniform_conifers": 70.0,
}  # fmt: skip


def case_of(folder, trees, **groups):
    release = {"x": [150.0], "y": [380.0]}
    lists = {name: groups.pop(name) for name in ("line", "barrier") if name in groups}
    case = scenes.make_case(folder, *scenes.sets(), release=release, forest=trees, **groups)
    return case.replace(**lists)


def scene_of(folder, trees, **groups):
    z = scenes.rough(NX, NY)
    return read_scene(case_of(folder, trees, **groups), dem=z, transform=scenes.grid(z, CELL))


def stands_of(folder, shapes, forest=None, **columns):
    make_layer(folder / "stands.gpkg", shapes, crs=None, **columns)
    return scene_of(folder, {"polygons": "stands.gpkg"} | (forest or {}))


def columns_of(n, **others):
    return {key: values * n for key, values in GIVEN.items()} | others


@pytest.mark.parametrize("spread", ["random", "even"])
def test_a_stand_that_covers_the_terrain_has_the_trees_of_rasters(tmp_path, spread):
    mapped = stands_of(tmp_path, [ALL], {"spread": spread}, **GIVEN)
    uniform = scene_of(tmp_path, MADE | {"spread": spread})
    assert np.array_equal(mapped.trees, uniform.trees)
    assert mapped.stands[0].area == pytest.approx(12.0)
    assert mapped.stands[0].stems == mapped.trees.x.size


@pytest.mark.parametrize(
    ("columns", "told"),
    [
        ({"stems": [500.0, 0.04]}, "stems = 0.04 in stand 2 (1 such stands) is far below the"),
        (
            {"dbh_mean": [0.3, 30.0]},
            "dbh_mean = 0.3 in stand 1 (1 such stands) is far below the other stands",
        ),
        (
            {"conifers": [70.0, 0.7]},
            "conifers = 0.7 in stand 2 (1 such stands) is far below the other stands",
        ),
        ({"conifers": [70.0, 0.0]}, None),
        ({"stems": [500.0, 0.0]}, None),
        ({"dbh_mean": [30.0, 5.0]}, None),
    ],
)
def test_a_stand_in_another_unit_than_the_others_is_told(tmp_path, columns, told):
    west, east = shapely.box(10, 10, 140, 390), shapely.box(150, 10, 290, 390)
    scene = stands_of(tmp_path, [west, east], **columns_of(2, **columns))
    remarks = [line for line in scene.remarks if "another unit" in line]
    assert len(remarks) == (told is not None)
    assert told is None or told in remarks[0]


@pytest.mark.parametrize("spread", ["random", pytest.param("even", marks=pytest.mark.all)])
def test_stems_are_as_many_as_the_area_says_in_cells_cut_by_an_edge_too(tmp_path, spread):
    """Three adjacent stands with oblique edges have the expected number of stems, also in the cells
    cut by an edge. Over many seeds, differences are within four standard errors."""
    shapes = [
        shapely.Polygon([(31, 47), (148, 52), (163, 341), (42, 333)]),
        shapely.Polygon([(148, 52), (271, 66), (252, 352), (163, 341)]),
        shapely.Point(150, 370).buffer(13),
    ]
    density = [900.0, 250.0, 600.0]
    make_layer(tmp_path / "stands.gpkg", shapes, crs=None, **columns_of(3) | {"stems": density})
    cells = [shapely.box(i, j, i + CELL, j + CELL) for i in np.arange(0, 300, CELL)
             for j in np.arange(0, 400, CELL)]  # fmt: skip
    cut = [[c for c in cells if c.intersects(one.exterior)] for one in shapes]
    parts = [shapely.union_all(of).intersection(one) for of, one in zip(cut, shapes, strict=True)]
    seeds, found = 12, np.zeros((3, 2))
    for seed in range(seeds):
        forest = {"polygons": "stands.gpkg", "seed": seed, "spread": spread}
        trees = scene_of(tmp_path, forest).trees
        for k, (one, part) in enumerate(zip(shapes, parts, strict=True)):
            found[k] += [shapely.contains_xy(at, trees.x, trees.y).sum() for at in (one, part)]
        assert shapely.contains_xy(shapely.union_all(shapes).buffer(1e-9), trees.x, trees.y).all()
    expected = seeds * np.array(
        [[d * at.area / 1e4 for at in pair]
         for d, pair in zip(density, zip(shapes, parts, strict=True), strict=True)]
    )  # fmt: skip
    assert expected.min() > 30
    assert (np.abs(found - expected) < 4 * np.sqrt(expected)).all()


def test_names_of_attributes_in_four_languages(tmp_path):
    english = stands_of(tmp_path, [ALL], name=["Hang"], **GIVEN)
    for names in (
        ("Stammzahl", "BHD", "BHD_StAbw", "Nadelholz"),
        ("tiges_ha", "DHP_moyen", "écart-type", "résineux"),
        ("Fusti/ha", "DPU medio", "dev_std", "Conifere"),
    ):
        (tmp_path / "stands.gpkg").unlink()
        columns = dict(zip(names, GIVEN.values(), strict=True))
        assert np.array_equal(stands_of(tmp_path, [ALL], **columns).trees, english.trees), names
    assert english.stands[0].name == "Hang"
    for key, names in NAMES.items():  # `none` has two meanings, also in shapefiles
        for name in names:
            assert [other for other in NAMES if matching(other, [name[:10]])] == [key]


def test_species_of_a_stand(tmp_path):
    """Species may be a list with percentages in any language; without a list the stand has conifers
    and broadleaves."""
    halves = [shapely.box(0, 0, 150, 400), shapely.box(150, 0, 300, 400)]
    scene = stands_of(tmp_path, halves, **columns_of(2), Baumart=["Fichte 60, Buche 40 %", None])
    west = scene.trees.factor[scene.trees.x < 150]
    assert set(west) == {0.9, 1.5}
    assert abs((west == 0.9).mean() - 0.6) < 4 * np.sqrt(0.24 / west.size)
    assert set(scene.trees.factor[scene.trees.x > 150]) == {0.93, 1.59}


LEFT, RIGHT = shapely.box(0, 0, 160, 400), shapely.box(150, 0, 300, 400)


@pytest.mark.family(2)
@pytest.mark.parametrize(
    ("shapes", "changes", "said"),
    [
        ([LEFT, RIGHT], {}, "features 1 and 2 overlap by 4,000 m2: polygons must not overlap"),
        ([ALL], {"stems": None, "n": [1.0]}, "attribute stems"),
        ([ALL, RIGHT], {"stems": [500.0, None]}, "feature 2: has no stems"),
        ([RIGHT], {"dbh_mean": [None]}, "feature 1: has no dbh_mean"),
        ([ALL], {"conifers": [120.0]}, "feature 1: conifers = 120: must be 0 to 100 %"),
        ([ALL], {"stems": ["many"]}, "attribute stems: must be a number"),
        ([ALL], {"BHD": [30.0]}, "attributes dbh_mean and BHD: both give dbh_mean: keep one"),
        ([ALL], {"conifers": None}, "attribute conifers or species is missing: add it, or set"),
        ([ALL], {"species": ["palm"]}, "feature 1: species = palm: is not in"),
        ([ALL], {"species": ["spruce 60, fir 20"]}, "feature 1: species = 'spruce 60, fir 20': mu"),
        ([shapely.box(900, 0, 950, 9)], {}, "all stands are outside the terrain"),
    ],
)
def test_a_layer_with_a_fault(tmp_path, shapes, changes, said):
    columns = columns_of(len(shapes)) | changes
    columns = {key: values for key, values in columns.items() if values is not None}
    with pytest.raises(RockfallError, match="stands.gpkg") as caught:
        stands_of(tmp_path, shapes, **columns)
    assert said in str(caught.value) and "\n" not in str(caught.value)


def test_values_that_the_layer_lacks_come_from_the_case_and_never_from_both(tmp_path):
    columns = {key: GIVEN[key] for key in ("stems", "dbh_mean", "dbh_std")}
    scene = stands_of(tmp_path, [ALL], {"uniform_conifers": 70.0}, **columns)
    assert np.array_equal(scene.trees, scene_of(tmp_path, MADE).trees)
    with pytest.raises(RockfallError, match="uniform_dbh_mean: attribute dbh_mean of"):
        stands_of(tmp_path, [ALL], {"uniform_dbh_mean": 20.0}, **GIVEN)
    with refused("case: &forest: give only one of polygons, trees and stems"):
        case_of(tmp_path, {"polygons": "stands.gpkg"} | MADE)


@pytest.mark.parametrize("language", ["de", "fr", "it"])
def test_remarks_on_stands_are_known_in_every_language(tmp_path, language):
    shapes = [shapely.box(0, 0, 150.1, 400), shapely.box(150, 0, 300, 400)]
    shapes += [shapely.box(900, 0, 990, 90)]
    scene = stands_of(tmp_path, shapes, **columns_of(3) | {"stems": [5.0, 4.0, 3.0]})
    remarks = [one.partition(": ")[2] for one in scene.remarks]
    assert len(remarks) == 3 and any(
        "1 of 3 polygons extend beyond the DEM" in line for line in remarks
    )
    with speaking(language):
        assert all(translated(one.values["text"]) not in remarks for one in scene.remarks)


def test_slivers_belong_to_the_later_stand(tmp_path):
    shapes = [shapely.box(0, 0, 150.1, 400), shapely.box(150, 0, 300, 400)]
    scene = stands_of(tmp_path, shapes, **columns_of(2))
    assert "stands overlap by 40 m2 in slivers: the later one is used there" in scene.remarks[-1]
    assert [one.area for one in scene.stands] == pytest.approx([6.0, 6.0])
    assert np.array_equal(scene.trees, scene_of(tmp_path, MADE).trees)


def test_density_is_reported_over_the_polygon(tmp_path):
    shape = shapely.Polygon([(31, 47), (148, 52), (163, 341), (42, 333)])
    make_layer(tmp_path / "stands.gpkg", [shape], crs=None, name=["Bannwald"], **GIVEN)
    case = case_of(tmp_path, {"polygons": "stands.gpkg"}, case={"boulders": 2})
    z = scenes.rough(NX, NY)
    scene = read_scene(case, dem=z, transform=scenes.grid(z, CELL))
    (stand,) = scene.stands
    assert stand.area == pytest.approx(shape.area / 1e4) and stand.stems == scene.trees.x.size
    result = rockfall.run(case, dem=z, transform=scenes.grid(z, CELL))
    (table,) = stand_tables(stands_in(result))
    assert as_text(table) in summary(result) and as_text(table) in preview(scene)
    cells = ["Bannwald", f"{stand.area:.3g}", f"{stand.stems:,}", f"{stand.density:,.0f}", "500"]
    assert [*table.texts()] == [cells]
    (several,) = stand_tables([stand] * 5, 2)
    more = ["3 more", "", f"{3 * stand.stems:,}", "", ""]
    assert [*several.texts()] == [cells, cells, more]


# ---- thinnings


def positions(trees):
    return set(zip(trees.x.tolist(), trees.y.tolist(), trees.dbh.tolist(), strict=True))


def test_no_stems_near_the_sources_and_all_others_as_before(tmp_path):
    full = scene_of(tmp_path, MADE)
    clear = scene_of(tmp_path, MADE | {"clear_of_sources": 20.0})
    far = np.hypot(full.trees.x - 150, full.trees.y - 380) > 20
    assert 0 < np.count_nonzero(~far) < 200
    assert np.array_equal(np.array(full.trees)[:, far], clear.trees)
    same = scene_of(tmp_path, MADE | {"clear_of_sources": 0.0, "density_factor": 1.0})
    assert np.array_equal(same.trees, full.trees)
    with refused(f"case: &forest: no stem remains of {full.trees.x.size:,}: leave out &forest to "
                 "run without trees"):  # fmt: skip
        scene_of(tmp_path, MADE | {"clear_of_sources": 900.0})


def test_a_thinned_stand_is_a_part_of_the_full_one(tmp_path):
    full, half, few = (
        positions(scene_of(tmp_path, MADE | {"density_factor": factor}).trees)
        for factor in (1.0, 0.5, 0.2)
    )
    assert few < half < full
    assert abs(len(half) / len(full) - 0.5) < 4 * np.sqrt(0.25 / len(full))
    assert abs(len(few) / len(full) - 0.2) < 4 * np.sqrt(0.16 / len(full))


def test_clearings_take_stems_out_of_lists_and_stands(tmp_path):
    """A clearing leaves none or a fraction of the stems; where two overlap, the smaller
    fraction."""
    shapes = [shapely.box(0, 200, 150, 400), shapely.box(0, 100, 300, 300)]
    make_layer(tmp_path / "storm.gpkg", shapes, crs=None, Restanteil=[0.0, 0.4])
    storm = {"clearings": "storm.gpkg"}
    full, after = scene_of(tmp_path, MADE).trees, scene_of(tmp_path, MADE | storm).trees
    assert positions(after) < positions(full)
    gone, part = (
        [shapely.contains_xy(shape, one.x, one.y).sum() for one in (full, after)]
        for shape in (shapes[0], shapes[1].difference(shapes[0]))
    )
    assert gone[0] > 900 and gone[1] == 0
    assert abs(part[1] / part[0] - 0.4) < 4 * np.sqrt(0.24 / part[0])
    rows = zip(full.x, full.y, full.dbh, strict=True)
    text = "".join(f"{x!r},{y!r},{dbh!r},fir\n" for x, y, dbh in np.array([*rows]).tolist())
    (tmp_path / "trees.csv").write_text("x,y,dbh,species\n" + text)
    listed = scene_of(tmp_path, {"trees": "trees.csv"} | storm).trees
    assert positions(listed) < positions(full)
    assert not shapely.contains_xy(shapes[0], listed.x, listed.y).any()


def test_clearings_with_a_fault(tmp_path):
    make_layer(tmp_path / "storm.gpkg", [ALL], crs=None, density_factor=[1.5])
    with pytest.raises(RockfallError, match="feature 1: density_factor = 1.5: must be 0 to 1"):
        scene_of(tmp_path, MADE | {"clearings": "storm.gpkg"})
    make_layer(tmp_path / "far.gpkg", [shapely.box(900, 0, 950, 9)], crs=None, id=[1])
    with pytest.raises(RockfallError, match="no stem is in a polygon of the clearings"):
        scene_of(tmp_path, MADE | {"clearings": "far.gpkg"})
    with refused("case: &forest clearings = 'far.gpkg': is only valid with trees, polygons or "
                 "stems"):  # fmt: skip
        case_of(tmp_path, {"clearings": "far.gpkg"})


def test_today_and_after_a_storm_are_compared_boulder_by_boulder(tmp_path):
    make_layer(tmp_path / "stands.gpkg", [shapely.box(0, 100, 300, 360)], crs=None, **GIVEN)
    make_layer(tmp_path / "storm.gpkg", [shapely.box(0, 100, 300, 300)], crs=None, id=[1])
    z = scenes.rough(NX, NY)
    today = case_of(
        tmp_path, {"polygons": "stands.gpkg"}, case={"boulders": 300},
        surface={"uniform_mean_radius": 0.3},
        line=[{"name": "road", "x": [0.0, 300.0], "y": [60.0, 60.0]}],
    )  # fmt: skip
    one, other = (
        rockfall.run(case, dem=z, transform=scenes.grid(z, CELL))
        for case in (today, today.replace(forest={"clearings": "storm.gpkg"}))
    )
    untouched = (one.trees_hit.values == 0) & (other.trees_hit.values == 0)
    assert untouched.any() and (other.trees_hit.values < one.trees_hit.values).any()
    assert np.array_equal(one.stop_x.values[untouched], other.stop_x.values[untouched])
    table = compare_variants({"today": one, "storm": other})
    rows = table[(table.line == "road") & (table.statistic == "fraction")]
    assert rows.loc[rows.variant == "storm", "difference"].iloc[0] > 0


# ---- lying logs


def test_logs_of_a_layer_are_low_barriers(tmp_path):
    """A log is as high as it is thick, unless the layer has a height. It has the strength of a
    standing stem of the same diameter (38.7 DBH^2.31, spruce 0.9), less a quarter of it for each
    decay class above 1."""
    logs = [shapely.LineString([(100, y), (200, y)]) for y in (300.0, 250.0, 200.0)]
    make_layer(
        tmp_path / "logs.gpkg", logs, crs=None, diameter=[40.0, 40.0, 30.0],
        decay_class=[None, 3, 1], height=[None, None, 0.8],
    )  # fmt: skip
    case = case_of(tmp_path, {}, case={"boulders": 40}, barrier=[{"file": "logs.gpkg"}])
    z = scenes.rough(NX, NY)
    result = rockfall.run(case, dem=z, transform=scenes.grid(z, CELL))
    assert result.barrier_height.values == pytest.approx([0.4, 0.4, 0.8])
    full = 0.9 * 38.7 * np.array([40.0, 40.0, 30.0]) ** 2.31
    assert result.barrier_capacity.values == pytest.approx(full * [1, 0.5, 1])
    assert full.max() < EAD_ENERGY[1] * 2
    assert set(rockfall.design(result).checks["unconfirmed"]) == {"logs"}
    assert "Capacities of lying logs are unconfirmed" in preview(read_scene(
        case, dem=z, transform=scenes.grid(z, CELL)))  # fmt: skip


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"diameter": 40.0, "capacity": 5.0}, "diameter = 40.0: determines the capacity of a log"),
        ({"decay_class": 2, "capacity": 5.0, "height": 1.0}, "is only valid with diameter"),
        ({"decay_class": 5, "diameter": 40.0}, "must be 1 to 4"),
    ],
)
def test_a_log_with_a_fault(tmp_path, keys, said):
    log = {"name": "log", "x": [100.0, 200.0], "y": [300.0, 300.0]}
    with pytest.raises(RockfallError, match=said):
        case_of(tmp_path, {}, barrier=[log | keys])


@pytest.mark.parametrize("std, told", [
    ([12.0, 0.12], "0.12 cm at a mean of 30 cm"),
    ([0.12, 0.15], "0.12 cm at a mean of 30 cm (100 % of the stems): is the value in m"),
    ([12.0, 40.0], "40 cm at a mean of 30 cm"),
    ([12.0, 29.0], None),
    ([0.0, 0.0], None),  # all with the same diameter
])  # fmt: skip
def test_deviations_in_another_unit_are_told(tmp_path, std, told):
    half = [shapely.box(0, 0, 150, 400), shapely.box(150, 0, 300, 400)]
    scene = stands_of(tmp_path, half, **columns_of(2, dbh_std=std))
    mine = [line for line in scene.remarks if line.startswith("&forest dbh_std")]
    assert len(mine) == bool(told) and all(told in line for line in mine)
    if told and std[0] == 12.0:  # fraction of the stems with this attribute
        stands = scene.trees.x > 150.0
        assert f"({100 * stands.mean():.3g} % of the stems)" in mine[0]
