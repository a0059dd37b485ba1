# SPDX-License-Identifier: BSD-3-Clause
"""Trees: which boulders they stop, the energy absorbed, and no effect on boulders that hit none."""

import netCDF4
import numpy as np
import pytest
from rasterio.transform import from_origin

import rockfall
from made import make_raster
from programs import make_full_case, run_program, same_results
from rockfall.result.crossings import at_lines
from rockfall.result.dataset import read_result, write_result
from rockfall.scene.prepare import prepare
from same import same, same_numbers
from scenes import make_case, rough, sets, status

CELL, ROWS, COLUMNS = 5.0, 80, 60
TRANSFORM = from_origin(0.0, ROWS * CELL, CELL, CELL)
STAND = {
    "uniform_stems": 500.0, "uniform_dbh_mean": 30.0, "uniform_dbh_std": 10.0,
    "uniform_conifers": 60.0,
}  # fmt: skip
MAPS = ["tree_impacts", "tree_impact_height_max", "tree_impact_height_mean", "tree_energy"]
LINE = {"name": "road", "x": [0.0, 300.0], "y": [60.0, 60.0]}
NET = {"name": "net", "x": [0.0, 300.0], "y": [200.0, 200.0], "height": 3.0, "capacity": 150.0}


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    return make_case(
        tmp_path_factory.mktemp("trees"), *sets(), line=[LINE],
        case={"boulders": 400}, release={"x": [150.0, 80.0], "y": [380.0, 375.0]},
        surface={"uniform_mean_radius": 0.3},
        output={"energy_balance": True, "maps": ["passages", "deposits", "energy_max", *MAPS],
                "rebounds": True, "min_passages": 1, "trajectories": 9},
    )  # fmt: skip


def run(case, **how):
    return rockfall.run(case, dem=rough(), transform=TRANSFORM, **how)


def listed(case, rows):
    """Case with trees from `rows` of x, y, dbh, species."""
    text = "".join(",".join(map(str, row)) + "\n" for row in rows)
    (case.folder / "trees.csv").write_text("x,y,dbh,species\n" + text)
    return case.replace(forest={"trees": "trees.csv"})


@pytest.fixture(scope="module")
def bare(case):
    return run(case)


@pytest.fixture(scope="module")
def wooded(case):
    return run(case.replace(forest=STAND))


def test_a_forest_that_nobody_meets_changes_no_bit(case, bare):
    """Trees that no boulder hits change no bit, because they have random numbers of their own."""
    x, y = np.meshgrid(np.arange(200.0, 300.0, 3.0), np.arange(388.0, 398.0, 3.0))
    far = run(listed(case, [(*at, 60, "oak") for at in zip(x.flat, y.flat, strict=True)]))
    assert not far.trees_hit.any()
    same_numbers(bare, far)


def test_boulders_are_the_same_up_to_their_first_tree(case, bare, wooded):
    assert np.array_equal(bare.volume, wooded.volume)
    tracks = [one.trajectory_boulder.values for one in (bare, wooded)]
    for number in np.unique(tracks[0]):
        a, b = (
            np.stack([one[f"trajectory_{axis}"].values[track == number] for axis in "xyz"])
            for one, track in zip((bare, wooded), tracks, strict=True)
        )
        apart = np.flatnonzero((a[:, : b.shape[1]] != b[:, : a.shape[1]]).any(axis=0))
        before = apart[0] if apart.size else min(a.shape[1], b.shape[1])
        assert before >= 1  # the release
        if wooded.trees_hit.values[number - 1] == 0:
            assert a.shape == b.shape and not apart.size


def test_a_forest_holds_boulders_back(bare, wooded):
    assert "trees_hit" not in bare
    hit = wooded.trees_hit.values
    assert (hit > 0).mean() > 0.9
    stopped = np.array(status(wooded)) == "stopped_by_tree"
    assert 0.2 < stopped.mean() < 0.99
    assert (hit[stopped] > 0).all()
    assert wooded.plan_distance.mean() < 0.5 * bare.plan_distance.mean()
    passed = [np.isfinite(at_lines(one)["line_time"].values).mean() for one in (bare, wooded)]
    assert passed[1] < passed[0]


def test_the_energy_balance_closes(wooded):
    parts = ("ground", "trees", "barriers", "left")
    found = sum(wooded[f"energy_{name}"].values for name in parts)
    released = wooded.energy_released.values
    assert (np.abs(found - released) < 1e-11 * released).all()
    assert (wooded.energy_trees.values >= 0).all()
    stopped = np.array(status(wooded)) == "stopped_by_tree"
    speed = np.sqrt(2 * wooded.energy_left.values / (2800 * wooded.volume.values))
    assert (speed[stopped] < 0.6).all()  # translation and rotation; the limit is 0.5 m/s


def test_maps_add_up_to_the_boulders(wooded):
    assert wooded.tree_impacts.dtype == np.int64
    hits = wooded.tree_impacts.values
    assert hits.sum() == wooded.trees_hit.sum()
    taken = np.nansum(wooded.tree_energy.values.astype(float))
    assert abs(taken - wooded.energy_trees.values.sum()) < 0.5 * hits.sum() + 1e-6 * taken
    top, mean = wooded.tree_impact_height_max.values, wooded.tree_impact_height_mean.values
    assert np.array_equal(np.isfinite(mean), hits > 0)
    assert (top[np.isfinite(top)] >= mean[np.isfinite(top)] - 1e-3).all()
    assert np.nanmax(top) < np.nanmax(wooded.jump_height_max.values) + 1e-3
    assert ((wooded.passages.values > 0) | (hits == 0)).all()
    ended = np.isin(status(wooded), ["stopped", "absorbed", "stopped_by_tree"])
    assert wooded.deposits.sum() == np.count_nonzero(ended)


def test_hits_are_vertices_of_trajectories(case):
    wooded = run(case.replace(forest=STAND, impact={"rest_angle": 90.0}))  # only flights
    number, vertices = np.unique(wooded.trajectory_boulder.values, return_counts=True)
    recorded = wooded.isel(boulder=number - 1)
    ends = np.isin(status(recorded), ["left_domain", "hit_nodata"])
    wanted = 1 + recorded.impacts.values + recorded.trees_hit.values + ends
    assert number.size == 9 and np.array_equal(vertices, wanted)


@pytest.mark.parametrize("how", [{"threads": 2, "chunk": 7}, {"chunk": 400}])
def test_threads_and_chunks_change_nothing(case, wooded, how):
    same(run(case.replace(forest=STAND), **how), wooded)


def test_shards_add_up(case, wooded):
    wood = case.replace(forest=STAND)
    same(rockfall.merge([run(wood, shard=(k, 3)) for k in (3, 1, 2)]), wooded)


def test_a_result_is_read_as_it_was_written(wooded, tmp_path):
    write_result(wooded, tmp_path / "wooded.nc")
    same(read_result(tmp_path / "wooded.nc"), wooded)


@pytest.mark.all
@pytest.mark.parametrize("memory", [20_000, 60_000])
def test_windows_of_the_terrain_change_nothing(case, tmp_path, memory):
    make_raster(tmp_path / "dem.tif", rough(), TRANSFORM, None)
    where = {"dem": str(tmp_path / "dem.tif")}
    wood = case.replace(forest=STAND, terrain=where, case={"boulders": 60})
    same_numbers(rockfall.run(wood), rockfall.run(wood, memory=memory))


def test_who_flies_above_the_stems_passes_over(case, wooded):
    low = run(case.replace(forest=STAND | {"stem_height": 2.0}))
    flying = case.replace(impact={"rest_angle": 90.0})  # rolling boulders hit every stem
    assert np.nanmax(low.tree_impact_height_max.values) < 2.0
    assert 0 < low.trees_hit.sum() < wooded.trees_hit.sum()
    none = run(flying.replace(forest=STAND | {"stem_height": 1e-12}))
    assert none.trees_hit.sum() == 0
    same_numbers(run(flying), none)


def test_trees_that_take_nothing_turn_boulders_and_never_stop_them(case):
    table = "species,genus,factor\nconifer,,1e-9\nbroadleaf,,1e-9\n"
    (case.folder / "weak.csv").write_text(table)
    flying = case.replace(impact={"rest_angle": 90.0})  # rolls are slower than stop_speed
    weak = run(flying.replace(forest=STAND | {"species_table": "weak.csv"}))
    assert "stopped_by_tree" not in status(weak)
    assert weak.trees_hit.sum() > 400
    assert (weak.energy_trees < 1e-3 * weak.energy_released).all()


def test_a_turn_of_nothing_but_its_smallest_class(case, wooded):
    """With weights for the smallest class only, turns at trees are at most 22.5 degrees."""
    ahead = dict.fromkeys(("turn_frontal", "turn_lateral", "turn_scratch"), [1.0, 0.0, 0.0])
    straight = run(case.replace(forest=STAND | ahead))
    track = straight.trajectory_boulder.values
    x, y = straight.trajectory_velocity_x.values, straight.trajectory_velocity_y.values
    by_tree = (straight.trajectory_ratio.values == 0)[1:] & (np.diff(track) == 0)
    before = np.arctan2(y, x)[:-1][by_tree]
    after = np.arctan2(y, x)[1:][by_tree]
    moved = np.hypot(x, y)[1:][by_tree] > 1e-6
    turned = np.degrees(np.abs((after - before + np.pi) % (2 * np.pi) - np.pi))[moved]
    assert turned.size > 10 and turned.max() <= 22.5 + 1e-9


def test_a_net_in_the_forest(case):
    """Trees and a net stop boulders of one run, whose energy balance is closed."""
    both = run(case.replace(forest=STAND | {"uniform_stems": 150.0}, barrier=[NET]))
    names = set(status(both))
    assert {"stopped_by_tree", "stopped_by_barrier"} <= names
    found = sum(both[f"energy_{name}"] for name in ("ground", "trees", "barriers", "left"))
    assert (abs(found - both.energy_released) < 1e-11 * both.energy_released).all()


def test_maps_of_trees_without_trees_are_empty(bare):
    assert not bare.tree_impacts.values.any()
    assert all(np.isnan(bare[name].values).all() for name in MAPS[1:])


@pytest.mark.all
def test_the_standalone_program_gives_the_same_bits(tmp_path):
    forest = STAND | {"stem_height": 12.0, "turn_frontal": [3.0, 2.0, 1.0]}
    case = make_full_case(tmp_path, forest=forest, output={"energy_balance": True})
    prepare(case, tmp_path / "ready")
    done = run_program("ready/case.nml", "-o", "out.nc", "--quiet", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    one = rockfall.run(case)
    assert one.trees_hit.sum() > 0 and "stopped_by_tree" in status(one)
    same_results(rockfall.merge([tmp_path / "out.nc"]), one)


@pytest.mark.parametrize("key", [{"seed": 2}, {"uniform_stems": 400.0}])
def test_another_forest_needs_another_scene_file(tmp_path, key):
    case = make_full_case(tmp_path, forest=STAND)
    prepare(case, tmp_path / "ready")
    file = tmp_path / "ready/case.nml"
    file.write_text(case.replace(forest=key).text())
    done = run_program("ready/case.nml", "-o", "out.nc", "--quiet", cwd=tmp_path)
    assert done.returncode == 2 and f"&forest {next(iter(key))}: differs from" in done.stderr


@pytest.mark.family(2)
@pytest.mark.parametrize(
    ("name", "value", "said"),
    [("tree_x", np.nan, "tree_x, or tree_y,"), ("tree_y", 1e13, "tree_x, or tree_y,"),
     ("tree_dbh", 0.0, "tree_dbh"), ("tree_dbh", np.nan, "tree_dbh"),
     ("tree_factor", -1.0, "tree_factor"), ("tree_factor", None, "tree_factor")],
)  # fmt: skip
def test_a_scene_file_with_trees_that_cannot_be(tmp_path, name, value, said):
    prepare(make_full_case(tmp_path, forest=STAND), tmp_path / "ready")
    with netCDF4.Dataset(tmp_path / "ready/scene.nc", "a") as file:
        if value is None:
            file.renameVariable(name, "other")
        else:
            file[name][3] = value
    done = run_program("ready/case.nml", "-o", "out.nc", "--quiet", cwd=tmp_path)
    assert done.returncode == 2 and f"is damaged: {said}" in done.stderr
    assert not (tmp_path / "out.nc").exists()
