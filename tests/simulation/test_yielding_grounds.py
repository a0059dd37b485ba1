# SPDX-License-Identifier: BSD-3-Clause
"""Runs by tables made from planes: similar boulders of any size behave alike; results are
bit-identical however a run is divided and whichever parts within reach are loaded; users' rows."""

import itertools

import numpy as np
import pytest
from rockfall._core import rockfall_f2py as _core

import rockfall
from made import refused
from programs import make_full_case, run_program, same_results
from rockfall.grounds import parameters, shipped_rows, yielding_ground
from rockfall.grounds.impact_tables import (
    FIELDS,
    KINDS,
    MARGIN,
    YieldingGround,
    joined_rows,
    open_table,
    plane_files,
    plane_table,
    save_table,
)
from rockfall.scene.prepare import prepare
from rockfall.scene.read import read_scene
from rockfall.scene.surface import SAFER
from rockfall.simulation.simulate import run_scene
from same import same, same_numbers
from scenes import case_in, grid, place, rough

G, DENSITY = 9.81, 2700.0

# ---- reproducibility, however it is run


OWN_HEAD = "name,model,strength,strength_sigma,strength_radius,relief,relief_radius,hurst,"
OWN_HEAD += "rest_angle,source\n"
OWN_ROWS = "loose,ploughed,3e5,0.7,0.6,14.5,,,36,x\nfirm,ploughed,1.5e6,0.4,,12,0.3,0.8,28,x\n"


@pytest.fixture(scope="module")
def spread(tmp_path_factory):
    """Case, arrays and result of boulders of all sizes, with every output, on two grounds whose
    strength varies between boulders."""
    folder = tmp_path_factory.mktemp("spread")
    (folder / "own.csv").write_text(OWN_HEAD + OWN_ROWS)
    (folder / "zones.csv").write_text("zone,ground,mean_radius\n1,loose,\n2,firm,\n")
    surface = {"zones": "given", "table": "zones.csv", "ground_table": "own.csv"}
    case = case_in(
        folder, surface=surface, case={"boulders": 150}, **place(),
        boulder={"volume": "lognormal", "volume_mean": 0.6, "volume_std": 0.6},
    )  # fmt: skip
    z = rough()
    zones = (np.arange(80)[:, None] // 6 % 2 + np.ones((1, 60))).astype("i4")
    arrays = {"dem": z, "transform": grid(z), "zones": zones}
    return case, arrays, rockfall.run(case, **arrays)


@pytest.mark.family(2)
@pytest.mark.parametrize("lanes", [0, 1, 2, 3])
def test_no_bit_depends_on_lanes(spread, lanes):
    case, arrays, result = spread
    assert (result["rebounds_by_ground"] > 1000).all()
    scene = read_scene(case, **arrays)
    _core.carry_in_lanes(scene.kernel.handle, lanes)
    same(run_scene(scene), result)


@pytest.mark.all
def test_threads_chunks_and_parts_change_nothing(spread):
    case, arrays, result = spread
    same(rockfall.run(case, threads=3, chunk=17, **arrays), result)
    parts = [rockfall.run(case, shard=(k, 3), **arrays) for k in (1, 2, 3)]
    same(rockfall.merge(parts), result)


@pytest.mark.all
def test_both_programs_give_the_same(tmp_path):
    (tmp_path / "own.csv").write_text(OWN_HEAD + OWN_ROWS)
    case = make_full_case(
        tmp_path, surface={"ground_table": "own.csv"}, impact={"form": "table", "table": "talus"},
        boulder={"ground_strength_sigma": 0.9},
    )  # fmt: skip
    (tmp_path / "zones.csv").write_text(
        "zone,mean_radius,ground\n4,0.25,loose\n-2,0.5,firm\n77,inf,\n"
    )
    prepare(case, tmp_path / "ready")
    done = run_program("case.nml", "-o", "out.nc", "--quiet", cwd=tmp_path / "ready")
    assert done.returncode == 0, done.stderr
    same_results(rockfall.merge([tmp_path / "ready" / "out.nc"]), rockfall.run(case))


def on_row(folder, cells, boulders=60, *, scale=1.0, **groups):
    """Result on a user's row, with all lengths multiplied by `scale`."""
    columns = [*dict.fromkeys(("name", "model", "source", *cells))]
    values = {"name": "mine", "source": "x"} | cells
    row = ",".join(f'"{values[column]}"' for column in columns)
    (folder / "mine.csv").write_text(f"{','.join(columns)}\n{row}\n")
    usual = {
        "case": {"boulders": boulders, "seed": 3},
        "boulder": {"volume": "fixed", "volume_mean": 0.3 * scale**3, "density": DENSITY},
        "surface": {"ground": values["name"], "ground_table": "mine.csv"},
        "release": {"x": [150.0 * scale], "y": [380.0 * scale], "drop_height": 5.0 * scale},
        "output": {"trajectories": boulders},
    }
    groups = {name: usual.get(name, {}) | groups.get(name, {}) for name in {**usual, **groups}}
    case = rockfall.Case(folder=folder, **groups)
    z = scale * rough()
    return rockfall.run(case, dem=z, transform=grid(z, 5.0 * scale))


LOOSE = {"model": "ploughed", "strength": 4e5, "relief": 14.3, "rest_angle": 36.0}


@pytest.mark.parametrize("cells", [
    LOOSE, LOOSE | {"strength_sigma": 0.8}, {**LOOSE, "model": "hard", "strength": 2e7},
])  # fmt: skip
def test_a_boulder_16_times_as_large_goes_16_times_as_far(tmp_path, cells):
    """Boulders 16 times as large travel 16 times as far, if terrain and strength are multiplied by
    16 and speeds by 4."""
    velocity = np.array([1.5, -4.0, 0.5])
    small, large = (
        on_row(
            tmp_path, cells | {"strength": scale * cells["strength"]}, scale=scale,
            release={"velocity": (scale**0.5 * velocity).tolist()},
            impact={"stop_speed": 0.4 * scale**0.5},
        )
        for scale in (1.0, 16.0)
    )  # fmt: skip
    assert int(small["rebounds"]) == int(large["rebounds"]) > 500
    assert np.array_equal(small["status"], large["status"])
    scales = {"stop_x": 16, "stop_y": 16, "stop_z": 16, "path_length": 16, "travel_time": 4,
              "speed_max": 4, "jump_height_max": 16, "trajectory_x": 16,
              "trajectory_velocity_x": 4}  # fmt: skip
    for name, scale in scales.items():
        assert np.allclose(scale * small[name], large[name], rtol=1e-9, atol=1e-9), name


def test_no_sigma_is_a_sigma_of_zero(tmp_path):
    usual = on_row(tmp_path, LOOSE)
    usual = usual.drop_vars("ground_block_radius")  # by the parts within reach
    same_numbers(on_row(tmp_path, LOOSE | {"strength_sigma": 0.0}), usual)
    spread = LOOSE | {"strength_sigma": 0.6}
    same_numbers(on_row(tmp_path, spread, boulder={"ground_strength_sigma": 0.0}), usual)
    other = on_row(tmp_path, spread)
    assert not np.array_equal(other["stop_y"], usual["stop_y"])
    told = on_row(tmp_path, LOOSE, boulder={"ground_strength_sigma": 0.6})
    same_numbers(told.drop_vars("ground_block_radius"), other)


@pytest.mark.family(3)
@pytest.mark.parametrize("name", shipped_rows().yielding)
def test_a_users_row_equal_to_a_shipped_one_gives_the_same(tmp_path, name):
    """A user's copy of a shipped row, the row by name, and the impact table of that name give equal
    results."""
    cells = {key: cell for key, cell in shipped_rows().rows[name].cells.items() if cell}
    mine = on_row(tmp_path, cells | {"name": "mine"})
    shipped = on_row(tmp_path, cells, surface={"ground": name, "ground_table": None})
    table = on_row(tmp_path, cells, surface={"ground": None, "ground_table": None},
                   impact={"table": name})  # fmt: skip
    same_numbers(mine, shipped, [*set(mine.variables) - {"ground"}])
    same_numbers(table, shipped)
    assert mine["ground_model"].values.tolist() == ["impact_table"]


# ---- parts beyond the reach of a case change nothing


@pytest.mark.all
@pytest.mark.parametrize("sigma", [0.0, 0.7])
@pytest.mark.parametrize("model", ["ploughed", "hard"])
def test_parts_beyond_the_reach_change_nothing(tmp_path, model, sigma):
    """A table with all parts of a plane is bit-identical to one with only the parts around the
    boulders."""
    strength = {"ploughed": 6e5, "hard": 4e6}[model]
    ground = YieldingGround(33.0, strength, sigma, 0.7, 14.1, 0.5, 0.8)
    paths = plane_files(model, "compact")
    rows = [open_table(paths[relief]) for relief in paths if abs(relief - 14) < 5]
    assert len(rows) > 2 and len(rows[0].size) > 5
    save_table(joined_rows(rows, ground), tmp_path / "all.nc")
    cells = {"model": model, **ground._asdict()}
    by_row = on_row(tmp_path, cells, 200)
    by_all = on_row(tmp_path, cells, 200, surface={"ground": None, "ground_table": None},
                    impact={"form": "table", "table": "all.nc"})  # fmt: skip
    within = np.abs(rockfall.ground_strength(by_row).values) < (MARGIN if sigma else np.inf)
    assert within.mean() > 0.95
    for name in "stop_x", "stop_z", "path_length", "impacts", "speed_max", "travel_time":
        one, other = (result[name].values[within] for result in (by_row, by_all))
        assert np.array_equal(one, other, equal_nan=True), name


@pytest.mark.parametrize("model", ["ploughed", "hard"])
def test_a_plane_has_the_parts_that_enclose_a_reach(model):
    rows = [open_table(path) for path in plane_files(model, "compact").values()]
    sizes, reliefs = rows[0].size, np.concatenate([row.relief for row in rows])
    for column, relief, radii in itertools.product((0, 2, 5), (1.0, 14.2, 44.0), (1.0, 1.7)):
        strength = DENSITY * G * 0.4 / (1.1 * sizes[column])
        ground = YieldingGround(38.0, strength, relief=relief)
        found = plane_table(model, "compact", ground, np.array([0.4, 0.4 * radii]))
        own = ground.sizes(np.array([0.4, 0.4 * radii]))
        beyond = np.clip(own, sizes[0], sizes[-1])
        assert found.size[0] <= beyond[0] and found.size[-1] >= beyond[1]
        inner = found.size[1:-1]
        assert ((inner > own[0]) & (inner < own[1])).all()
        near = np.clip(relief, reliefs[0], reliefs[-1])
        assert found.relief[0] <= near <= found.relief[-1] and len(found.relief) <= 2
        parts = [(row, k) for row in rows for k in range(len(sizes))
                 if row.relief[0] in found.relief and sizes[k] in found.size]  # fmt: skip
        assert len(found.first) - 1 == len(parts) * bins_of(rows[0])
        records = np.concatenate([part_of(row, k) for row, k in parts])
        follower = FIELDS.index("follower")
        columns = np.arange(len(FIELDS)) != follower
        assert np.array_equal(found.record[:, columns], records[:, columns])
        known = found.record[:, follower]
        assert np.array_equal(known > 0, records[:, follower] > 0)
        assert known.max() <= len(found.record)


def bins_of(row):
    return sum(int(np.prod(row.bins[kind])) for kind in KINDS)


def part_of(row, column):
    n = bins_of(row)
    return row.record[slice(*row.first[[column * n, (column + 1) * n]])]


@pytest.mark.parametrize("density, gravity", [(1000.0, 9.81), (7000.0, 9.81), (2700.0, 1.62)])
def test_parts_are_those_of_the_weight_of_the_boulders(density, gravity):
    """The part for boulders of unusual density or gravity is among the columns of the loaded
    table."""
    boulder = {"volume": "fixed", "volume_mean": 0.27, "density": density}
    case = rockfall.Case(
        case={"boulders": 1}, impact={"form": "table", "table": "meadow"}, boulder=boulder,
        flight={"gravity": gravity}, release={"x": [1.0], "y": [1.0]},
    )  # fmt: skip
    plane = shipped_rows().ground("meadow", case).plane
    table = plane_table(plane.model, "compact", plane.ground, np.array(plane.radii), plane.weight)
    own = density * gravity * plane.radii[0] / plane.ground.strength
    assert table.size[0] <= own <= table.size[-1]


def test_followers_stay_those_of_their_records():
    """The record that follows another is the same in any selection of parts."""
    model, ground = yielding_ground(shipped_rows().rows["talus"])
    follower = FIELDS.index("follower")
    rows = [open_table(path) for path in plane_files(model, "compact").values()]
    whole = joined_rows(rows, ground)
    some = plane_table(model, "compact", ground, np.array([0.3, 0.5]))

    def pairs(table):
        next_ = table.record[:, follower].astype(int)
        known = next_ > 0
        own = np.delete(table.record, follower, axis=1)
        return {one.tobytes() + two.tobytes()
                for one, two in zip(own[known], own[next_[known] - 1], strict=True)}  # fmt: skip

    assert len(pairs(some)) > 1000 and pairs(some) <= pairs(whole)


# ---- refused rows of users


GOOD = {"model": "ploughed", "strength": "3e5", "relief": "14"}
BOUNDS = {  # for each parameter: values out of range, and the text of the range
    "strength": (("0", "999", "1.1e9", "-3e5"), "1000 to 1e9 [Pa]"),
    "strength_sigma": (("-0.1", "1.6"), "0 to 1.5"),
    "strength_radius": (("-1", "101"), "0 to 100 [m]"),
    "relief": (("-1", "45.5"), "0 to 45 [degree]"),
    "relief_radius": (("0", "-0.3", "101"), "0.01 to 100 [m]"),
    "hurst": (("-0.1", "2.1"), "0 to 2"),
    "rest_angle": (("-1", "91"), "0 to 90 [degree]"),
}


@pytest.mark.parametrize("model", ["ploughed", "hard"])
@pytest.mark.parametrize("key", BOUNDS)
def test_numbers_of_rows_that_cannot_be_are_refused(tmp_path, model, key):
    values, allowed = BOUNDS[key]
    for value in values:
        with pytest.raises(rockfall.RockfallError) as caught:
            on_row(tmp_path, GOOD | {"model": model, key: value})
        said = str(caught.value)
        assert said.startswith(f"{tmp_path / 'mine.csv'}: line 2: &ground {key} = ")
        assert said.endswith(f": must be {allowed}") and caught.value.code == 2
        assert "\n" not in said and float(said.split(" = ")[1].split(":")[0]) == float(value)
    for value in "nan", "inf", "soft":
        with refused(f"{tmp_path}/mine.csv: line 2: {key} = {value}: must be a number"):
            on_row(tmp_path, GOOD | {"model": model, key: value})


@pytest.mark.parametrize("model", ["ploughed", "hard"])
@pytest.mark.parametrize("key", ["strength", "relief"])
def test_rows_without_a_number_that_is_needed_are_refused(tmp_path, model, key):
    where = f"{tmp_path}/mine.csv: line 2"
    for cells in (GOOD | {key: ""}, {name: cell for name, cell in GOOD.items() if name != key}):
        with refused(f"{where}: &ground {key} is missing: needed for model = '{model}'"):
            on_row(tmp_path, cells | {"model": model})


@pytest.mark.parametrize("key", [one.name for one in parameters() if "ploughed" not in one.models])
def test_numbers_of_other_models_are_refused(tmp_path, key):
    with pytest.raises(rockfall.RockfallError, match=f"&ground {key} = .*: is not valid for model"):
        on_row(tmp_path, GOOD | {key: "0.3"})


@pytest.mark.parametrize("key", [*BOUNDS][:-1])
def test_numbers_of_planes_are_refused_of_other_models(tmp_path, key):
    cells = {"model": "constant", "r_n": "0.4", "r_t": "0.8", key: "0.5"}
    with pytest.raises(rockfall.RockfallError, match=f"&ground {key} = .*: is not valid for model"):
        on_row(tmp_path, cells)


def test_the_ends_of_the_ranges_are_accepted(tmp_path):
    for ends in (
        {"strength": "1000", "strength_sigma": "0", "strength_radius": "0", "relief": "0",
         "relief_radius": "0.01", "hurst": "0", "rest_angle": "0"},
        {"strength": "1e9", "strength_sigma": "1.5", "strength_radius": "100", "relief": "45",
         "relief_radius": "100", "hurst": "2", "rest_angle": "90"},
    ):  # fmt: skip
        for model in "ploughed", "hard":
            result = on_row(tmp_path, ends | {"model": model}, 10)
            assert np.isfinite(result["stop_z"]).all()


@pytest.mark.parametrize(
    ("value", "said"),
    [(-0.1, "= -0.1: must be 0 to 1.5"), (1.6, "= 1.6: must be 0 to 1.5"),
     (float("nan"), "= nan: must be a finite real number")],
)  # fmt: skip
def test_a_sigma_that_cannot_be_is_refused(value, said):
    with refused(f"case: &boulder ground_strength_sigma {said}"):
        rockfall.Case(
            case={"boulders": 1}, impact={"table": "talus"}, release={"x": [1.0], "y": [1.0]},
            boulder={"volume_mean": 1.0, "ground_strength_sigma": value},
        )  # fmt: skip


# ---- between simulated reliefs


@pytest.mark.parametrize(("model", "n", "relief", "slope", "thrown"), [
    ("ploughed", 96, 12.75, 20, 0.82), ("ploughed", 24, 12.75, 22, 0.89),
    ("ploughed", 96, 10.25, 18, 0.91), ("hard", 190, 14.5, 22, 0.95),
])  # fmt: skip
def test_with_the_relief_advised_no_fewer_boulders_pass_than_as_thrown(
    tmp_path, model, n, relief, slope, thrown
):
    """The fraction that passes 200 m along a plane near its neutral slope, with the relief that a
    remark advises, is at most 0.1 below `thrown`: the fraction for blocks thrown on this relief
    (docs/archive/field_protocol.md)."""
    radius, cell, rows = 0.4, 5.0, 64
    fall = np.tan(np.radians(slope))
    z = np.repeat(500 + fall * cell * np.arange(rows)[::-1, None], 40, axis=1)
    down = -5 * np.cos(np.radians(slope))
    cells = {"model": model, "strength": n * DENSITY * G * radius, "relief": relief - SAFER}
    (tmp_path / "own.csv").write_text(
        "name,source,rest_angle," + ",".join(cells) + "\nown,x,27,"
        + ",".join(f"{value}" for value in cells.values()) + "\n"
    )  # fmt: skip
    case = rockfall.Case(
        folder=tmp_path, case={"boulders": 300, "seed": 7},
        surface={"ground": "own", "ground_table": "own.csv"},
        boulder={"volume": "fixed", "volume_mean": 4 / 3 * np.pi * radius**3, "density": DENSITY},
        release={"x": [100.0], "y": [300.0], "drop_height": 0.5,
                 "velocity": [0.0, down, fall * down]},
    )  # fmt: skip
    result = rockfall.run(case, dem=z, transform=grid(z, cell))
    passed = 300.0 - result["stop_y"].values > 200 * np.cos(np.radians(slope))
    assert passed.mean() > thrown - 0.1
