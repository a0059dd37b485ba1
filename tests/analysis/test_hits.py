# SPDX-License-Identifier: BSD-3-Clause
"""Hits of objects: all boulders whose recorded path comes within a radius of the object in plan,
whatever the cell size, the threads and the window of the maps."""

import numpy as np
import pytest

import rockfall
import scenes
from made import make_layer, refused
from rockfall.result.crossings import at_lines, has_crossed

shapely = pytest.importorskip("shapely", reason="the vector extra is not installed")

Z = scenes.rough()
GRID = scenes.grid(Z)
MAPS = ["passages", "hits", "hits_energy_exceeded", "energy_exceeded"]
WIDTH = 10.0
NEAR = 1e-6  # [m] difference that rounding may decide
RELEASE = {"x": [120.0, 180.0], "y": [380.0, 385.0], "drop_height": 5.0}
ALL = {"maps": MAPS, "trajectories": 200, "map_extent": "terrain"}


def make_case(folder, **groups):
    groups = {"release": RELEASE, "case": {"boulders": 100}, "output": ALL} | groups
    groups = {"boulder": {"volume": "normal", "volume_mean": 2.0, "volume_std": 2.0}} | groups
    hazard = {"object_width": WIDTH, "thresholds": [0.0, 100.0]} | groups.pop("hazard", {})
    late = {"hazard": hazard} if groups["output"].get("maps") or "scenario" in groups else {}
    late |= {"scenario": groups.pop("scenario", [])}
    return scenes.make_case(folder, *scenes.sets(2.0), **groups).replace(**late)


def run(case, **how):
    return rockfall.run(case, dem=Z, transform=GRID, **how)


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    return run(make_case(tmp_path_factory.mktemp("hits")))


def paths_of(result):
    """Path of each boulder in plan, and its radius [m]."""
    at = {name: result[f"trajectory_{name}"].values for name in ("boulder", "x", "y")}
    points = np.stack([at["x"], at["y"]], axis=1)
    cuts = np.flatnonzero(np.diff(at["boulder"])) + 1
    paths = [shapely.LineString(part) for part in np.split(points, cuts)]
    return np.array(paths, dtype=object), np.cbrt(0.75 * result.volume.values / np.pi)


def test_an_object_in_a_cell_is_hit_by_the_paths_that_come_near(result):
    paths, radius = paths_of(result)
    assert len(paths) == 200
    x, y = np.meshgrid(result.x.values, result.y.values)
    distance = shapely.distance(paths[:, None, None], shapely.points(x, y))
    edge = distance - radius[:, None, None] - WIDTH / 2
    least, most = (edge <= -NEAR).sum(axis=0), (edge <= NEAR).sum(axis=0)
    hits = result.hits.values
    assert (least <= hits).all() and (hits <= most).all()
    assert hits.sum() > 1.5 * result.passages.values.sum() > 0


def test_hits_have_the_energy_of_the_cells_within_reach(result):
    """All points of a cell are within 5 m of its centre: hits are at least as many as passages,
    also above a threshold. All moving boulders exceed a threshold of zero."""
    assert (result.hits.values >= result.passages.values).all()
    hits, passages = result.hits_energy_exceeded.values, result.energy_exceeded.values
    assert (hits >= passages).all() and (hits[1] > passages[1]).any()
    assert (hits[0] == result.hits.values).all() and (np.diff(hits, axis=0) <= 0).all()
    assert hits[1].max() > 0


def test_cells_do_not_change_hits(tmp_path):
    """Hits at common cell centres of a plane agree within 1 % for cells of 1, 3 and 9 m; passages
    depend on the cell size."""
    found, passed = [], []
    for cell in 1.0, 3.0, 9.0:
        n = round(324 / cell)
        y = 324 - (np.arange(n) + 0.5) * cell
        z = np.repeat((0.7 * y)[:, None], n, axis=1)
        release = {"x": [150.3, 171.1], "y": [310.2, 309.7], "drop_height": 3.0}
        case = make_case(tmp_path, release=release, output={"maps": MAPS, "map_extent": "terrain"})
        result = rockfall.run(case, dem=z, transform=scenes.grid(z, cell))
        step = round(9 / cell)
        found.append(result.hits.values[step // 2 :: step, step // 2 :: step])
        passed.append(result.passages.values.sum())
    fine, medium, coarse = found
    assert fine.sum() > 1000 and passed[0] > 2 * passed[1] > 4 * passed[2]
    for other in medium, coarse:  # rounding may change a path
        assert abs(other - fine).sum() < 0.01 * fine.sum()


@pytest.mark.parametrize("how", [{"threads": 3}, {"memory": 40e6}], ids=["threads", "memory"])
def test_neither_threads_nor_windows_change_hits(tmp_path, result, how):
    again = run(make_case(tmp_path), **how)
    for name in MAPS:
        assert again[name].identical(result[name])


def test_the_area_that_maps_cover_holds_all_hits(tmp_path, result):
    """Maps of the reachable area and of the terrain have the same number of hits: no hit beyond a
    boulder's path is cut off."""
    output = {"maps": MAPS, "map_extent": "reach"}
    small = run(make_case(tmp_path, output=output))
    assert small.hits.values.sum() == result.hits.values.sum()


def test_other_maps_do_not_change(tmp_path, result):
    """Without maps of hits boulders run in lanes, with them one by one: other results are
    identical."""
    alone = run(make_case(tmp_path, output=ALL | {"maps": ["passages", "energy_exceeded"]}))
    for name in "passages", "energy_exceeded", "stop_x", "speed_max":
        assert alone[name].identical(result[name])


def test_parts_add_up(tmp_path, result):
    case, parts = make_case(tmp_path), []
    for k in 1, 2, 3:
        parts.append(tmp_path / f"{k}.nc")
        rockfall.write_result(run(case, shard=(k, 3)), parts[-1])
    merged = rockfall.merge(parts)
    for name in MAPS:
        assert (merged[name].values == result[name].values).all()


# ---- objects along lines

ROAD = {"x": [90.0, 150.0, 210.0], "y": [300.0, 290.0, 305.0]}
POINT = {"x": [150.0, 150.0], "y": [250.0, 250.0]}


@pytest.mark.parametrize("width", [0.0, 6.0])
@pytest.mark.parametrize("where", [ROAD, POINT], ids=["road", "point"])
def test_a_line_with_a_width_is_met_by_what_touches_it(tmp_path, result, where, width):
    """A boulder meets a line if it comes within its radius plus half the width; its state is that
    at first contact."""
    line = [{"name": "o", **where, "object_width": width}]
    found = run(make_case(tmp_path, line=line, output={"trajectories": 200}))
    paths, radius = paths_of(found)
    points = list(zip(where["x"], where["y"], strict=True))
    edge = shapely.distance(paths, shapely.LineString(points)) - radius - width / 2
    met = has_crossed(found, 0)
    assert (met == (edge <= 0)).all() and 0 < met.sum() < 200
    touched = at_lines(found)["line_time"].values[0]
    for k in np.flatnonzero(met):
        of_boulder = found["trajectory_boulder"].values == k + 1
        time, x, y = (found[f"trajectory_{name}"].values[of_boulder] for name in ("time", *"xy"))
        at = shapely.Point(np.interp(touched[k], time, x), np.interp(touched[k], time, y))
        away = shapely.distance(at, shapely.LineString(points))
        assert away == pytest.approx(radius[k] + width / 2, abs=1e-4)  # times in single precision
    centres = run(make_case(tmp_path, line=[{"name": "o", **ROAD}]))
    assert (met >= has_crossed(centres, 0)).all() or where is POINT


def test_a_boulder_that_starts_at_an_object_has_met_it(tmp_path):
    line = [{"name": "o", "x": [100.0, 140.0], "y": [380.0, 380.0], "object_width": 2.0}]
    found = run(make_case(tmp_path, line=line))
    first = found.source.values == 1
    assert (at_lines(found)["line_time"].values[0][first] == 0).all()
    assert (at_lines(found)["line_x"].values[0][first] == 120.0).all()


def test_an_object_may_not_be_wider_than_a_hundred_metres(tmp_path):
    line = [{"name": "o", **ROAD, "object_width": 101.0}]
    with refused("case: &line object_width = 101.0: must be 0 to 100 [m]"):
        make_case(tmp_path, line=line)
    for width in -1.0, 100.5, 1000.0:
        with refused(f"case: &hazard object_width = {width}: must be 0 to 100 [m]"):
            make_case(tmp_path, hazard={"object_width": width})


# ---- objects of a hazard


def hazard(case, objects):
    return rockfall.hazard(case, dem=Z, transform=GRID, objects=objects)


def test_objects_of_a_layer_have_the_width_of_their_attribute(tmp_path):
    """A point without a width has the width that maps of hits use."""
    case = make_case(tmp_path, output={}, scenario=[{"name": "one", "frequency": 0.5}])
    shapes = [shapely.Point(122.5, 342.5)] * 3 + [shapely.LineString([(90, 300), (210, 300)])] * 2
    widths = [np.nan, 0.0, WIDTH, np.nan, 8.0]
    layer = make_layer(tmp_path / "objects.gpkg", shapes, "EPSG:32632", width=widths)
    found = hazard(case, layer)
    usual, bare, wide, road, broad = found.object_passages.values[0].tolist()
    at = {"x": 122.5, "y": 342.5}
    assert usual == found.scenario_hits.sel(at, method="nearest").values[0]
    assert 0 < bare < wide <= broad and road <= broad


@pytest.mark.parametrize("width", [-1.0, 1001.0])
def test_widths_that_cannot_be_are_refused(tmp_path, width):
    case = make_case(tmp_path, output={}, scenario=[{"name": "one", "frequency": 0.5}])
    shapes = [shapely.Point(150.0, 250.0)]
    layer = make_layer(tmp_path / "objects.gpkg", shapes, "EPSG:32632", width=[width])
    with refused(f"{layer}: feature 1: width = {width}: must be 0 to 100"):
        hazard(case, layer)


def test_a_point_is_found_where_boulders_reach_part_of_the_terrain(tmp_path):
    """The cell of a point is found on the complete terrain, not on the smaller area that boulders
    reach."""
    low = {"x": [150.0], "y": [152.5], "drop_height": 5.0}
    scenarios = [{"name": "small", "frequency": 0.5}, {"name": "large", "frequency": 0.1}]
    scenarios[1]["volume_mean"] = 20.0  # maps would otherwise cover different cells
    shapes = [shapely.Point(152.5, 142.5)] * 2
    layer = make_layer(tmp_path / "o.gpkg", shapes, "EPSG:32632", width=[np.nan, WIDTH])
    case = make_case(tmp_path, release=low, output={}, scenario=scenarios)
    found = hazard(case, layer)
    usual, disc = found.object_passages.values.T.tolist()
    assert usual == disc and min(usual) > 0
