# SPDX-License-Identifier: BSD-3-Clause
"""Barriers: which boulders they stop, the energy of those that continue, and no effect on
others."""

import numpy as np
import pytest
from rasterio.transform import from_origin

import rockfall
from made import make_raster
from programs import Killed, killed_after, make_full_case, run_program
from rockfall.result.crossings import at_lines, line_names
from rockfall.scene.prepare import prepare
from rockfall.scene.read import read_scene
from rockfall.simulation.parts import checkpoint
from rockfall.simulation.parts.checkpoint import Checkpoint
from rockfall.simulation.simulate import run_scene
from same import same, same_numbers
from scenes import make_case, rough, sets, status

CELL, ROWS = 5.0, 80
TRANSFORM = from_origin(0.0, ROWS * CELL, CELL, CELL)
ACROSS = {"x": [0.0, 300.0]}
ROAD = {"name": "road", **ACROSS, "y": [60.0, 60.0]}
NET = {"name": "net", **ACROSS, "y": [200.0, 200.0], "height": 3.0, "capacity": 150.0}
WALL = {
    "name": "wall",
    "x": [0.0, 140.0, 300.0],
    "y": [110.0, 140.0, 110.0],
    "height": 2.0,
    "class": 2,
}
CLASS_2 = 500e3  # [J]


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    folder = tmp_path_factory.mktemp("barriers")
    return make_case(
        folder, *sets(), line=[ROAD],
        case={"boulders": 600}, release={"x": [150.0, 80.0], "y": [380.0, 375.0]},
        surface={"uniform_mean_radius": 0.3},
        output={
            "energy_balance": True,
            "maps": ["passages", "deposits", "energy_max"],
            "trajectories": 9,
        },
    )  # fmt: skip


def run(case, **how):
    return rockfall.run(case, dem=rough(), transform=TRANSFORM, **how)


@pytest.fixture(scope="module")
def free(case):
    """Run with lines in place of the barriers."""
    lines = [{key: one[key] for key in ("name", "x", "y")} for one in (NET, WALL)]
    return run(case.replace(line=[ROAD, *lines]))


@pytest.fixture(scope="module")
def caught(case):
    return run(case.replace(barrier=[NET, WALL]))


def at(result, line, name):
    return at_lines(result)[f"line_{name}"].sel(line=line).values


def energy(result, line):
    return at(result, line, "energy_translational") + at(result, line, "energy_rotational")


def test_a_net_stops_what_is_below_its_edge_and_within_its_capacity(free, caught):
    """The outcome follows from height and energy at the line. Boulders reach the upper barrier with
    the speed and height of a run without barriers."""
    for line, height, capacity in (("wall", 2.0, CLASS_2), ("net", 3.0, 150e3)):
        high = at(caught, line, "passing_height") > height
        came = ~np.isnan(at(caught, line, "time"))
        expected = np.select([~came, high, energy(caught, line) > capacity], [0, 3, 2], 1)
        assert np.array_equal(at_lines(caught)["barrier_outcome"].sel(line=line), expected)
    assert min(np.bincount(expected)) > 20  # each outcome occurs
    ended = np.array(status(caught)) == "stopped_by_barrier"
    for name in ("x", "y", "time", "speed", "passing_height", "energy_translational"):
        assert np.array_equal(at(free, "net", name), at(caught, "net", name), equal_nan=True)
    stopped = expected == 1
    assert (
        np.array_equal((at_lines(caught)["barrier_outcome"] == 1).sum("line"), ended)
        and ended[stopped].all()
    )
    for axis in "xy":
        place = caught[f"stop_{axis}"].values[stopped]
        assert np.allclose(place, at(caught, "net", axis)[stopped], rtol=0, atol=1e-4)


def test_who_does_not_meet_a_barrier_is_the_same(free, caught):
    met = (at_lines(caught)["barrier_outcome"].values % 3 != 0).any(axis=0)
    assert 100 < met.sum() < 1100
    for name in ("stop_x", "stop_z", "travel_time", "path_length", "status", "impacts"):
        assert np.array_equal(free[name].values[~met], caught[name].values[~met]), name


def test_the_energy_of_each_boulder_is_accounted_for(free, caught):
    for result in (free, caught):
        parts = sum(result[f"energy_{what}"] for what in ("ground", "trees", "barriers", "left"))
        released = result.energy_released
        assert float(abs(parts - released).max() / released.max()) < 1e-12
    assert float(free.energy_barriers.max()) == 0.0


def test_barriers_take_what_they_can(caught):
    """Barriers absorb all energy of boulders that they stop, and their capacity of boulders that
    break through."""
    taken = np.zeros(caught.sizes["boulder"])
    for line, capacity in (("net", 150e3), ("wall", CLASS_2)):
        outcome = at_lines(caught)["barrier_outcome"].sel(line=line).values
        taken += np.select([outcome == 1, outcome == 2], [energy(caught, line), capacity], 0.0)
    assert np.allclose(caught.energy_barriers.values, taken, rtol=1e-6)


def test_second_barrier_behind_the_first(caught):
    """Boulders that break through the net, or pass over it, reach the wall."""
    outcome = at_lines(caught)["barrier_outcome"]
    net, wall = outcome.sel(line="net").values, outcome.sel(line="wall").values
    assert ((net == 2) & (wall > 0)).any() and ((net == 3) & (wall == 1)).any()
    assert not ((net == 1) & (wall > 0)).any()
    assert caught.barrier_capacity[line_names(caught).index("wall")] == CLASS_2
    assert np.isnan(caught.barrier_height[line_names(caught).index("road")])


def test_no_boulder_passes_an_endless_strong_barrier(case):
    result = run(case.replace(barrier=[NET | {"height": 100.0, "capacity": 1e5}]))
    assert not (at(result, "road", "time") >= 0).any()
    assert (at(result, "net", "time") > 0).sum() == status(result).count("stopped_by_barrier") > 500


def test_barrier_without_strength_or_height_changes_nothing(case, free):
    """A net of one millimetre stops no boulder and changes none."""
    low = run(case.replace(barrier=[NET | {"height": 1e-3}]))
    assert np.array_equal(low.stop_x, free.stop_x) and np.array_equal(low.status, free.status)
    assert (at_lines(low)["barrier_outcome"].sel(line="net").values % 3 == 0).all()


HAIRPIN = {"name": "u", "x": [30.0, 30.0, 48.0, 48.0], "y": [5.0, 35.0, 35.0, 5.0], "height": 4.0}


def shot_over(folder, *barriers, **groups):
    """Run one boulder that is shot eastward from x = 20 over level ground."""
    z = np.zeros((40, 40)) + np.linspace(0, 1e-3, 40)[:, None]
    shot = {"x": [20.0], "y": [20.0], "velocity": [12.0, 0.0, 12.0], "drop_height": 0.0}
    case = make_case(
        folder, *sets(0.0), release=shot, case={"boulders": 1}, boulder={"volume_mean": 0.1},
        output={"energy_balance": True}, **groups,
    )  # fmt: skip
    return rockfall.run(
        case.replace(barrier=list(barriers)), dem=z, transform=from_origin(0.0, 200.0, 5.0, 5.0)
    )


@pytest.mark.parametrize(
    ("capacity", "second_arm", "outcome"),
    [(1e5, 48.0, 1), (1e5, 51.0, 1), (0.01, 48.0, 2), (0.01, 51.0, 2), (1e5, 36.0, 3)],
)
def test_bent_barrier_over_and_then_under(tmp_path, capacity, second_arm, outcome):
    """A boulder passes over the first arm of a hairpin, and hits the second in the same flight or
    later, or passes over both. The crossing is at the arm that it hits, else at the first."""
    bent = HAIRPIN | {"x": [30.0, 30.0, second_arm, second_arm], "capacity": capacity}
    result = shot_over(tmp_path, bent)
    assert float(at_lines(result)["line_x"][0, 0]) == pytest.approx(
        30.0 if outcome == 3 else second_arm
    )
    assert (float(at_lines(result)["line_passing_height"][0, 0]) > HAIRPIN["height"]) == (
        outcome == 3
    )
    assert at_lines(result)["barrier_outcome"].values.tolist() == [[outcome]]
    assert (status(result) == ["stopped_by_barrier"]) == (outcome == 1)
    assert (float(result.energy_barriers[0]) > 0) == (outcome < 3)
    if outcome == 1:
        assert float(result.stop_x[0]) == pytest.approx(second_arm)
        assert (result.impacts.item() > 0) == (second_arm > 50.0)


@pytest.mark.parametrize(("left", "outcome"), [(0.49, 1), (0.51, 2)])
def test_who_is_left_with_less_than_the_stop_speed_was_stopped(tmp_path, left, outcome):
    """The energy exceeds the capacity by the kinetic energy at `left` m/s; the stop speed is 0.5
    m/s. A boulder that would be slower counts as stopped."""
    net = NET | {"x": [40.0, 40.0], "y": [0.0, 100.0], "height": 90.0, "capacity": 1e5}
    whole = shot_over(tmp_path, net)
    energy, speed = float(whole.energy_barriers[0]), float(at_lines(whole)["line_speed"][0, 0])
    weak = net | {"capacity": energy * (1 - (left / speed) ** 2) / 1e3}
    result = shot_over(tmp_path, weak)
    assert at_lines(result)["barrier_outcome"].values.tolist() == [[outcome]]
    assert (status(result) == ["stopped_by_barrier"]) == (outcome == 1)
    if outcome == 1:
        assert float(result.energy_left[0]) == pytest.approx(energy * (left / speed) ** 2)


@pytest.mark.parametrize("angle", [0.0, 7.3, -13.1])
def test_barrier_and_line_along_a_barrier_are_met_behind_it(case, angle):
    """Boulders that break through a weak net meet a line, or a strong net, along the same straight
    line with other ends."""
    side = np.tan(np.radians(angle))

    def along(west, east):
        return {"x": [west, east], "y": [200.0 + side * (x - 150.0) for x in (west, east)]}

    weak = {"name": "weak", "height": 100.0, "capacity": 1e-6} | along(30.0, 270.0)
    strong = {"name": "strong", "height": 100.0, "capacity": 1e5} | along(5.0, 290.0)
    line = {"name": "line"} | along(5.0, 290.0)
    alone = run(case.replace(line=[line], barrier=[weak]))
    broke = at_lines(alone)["barrier_outcome"].sel(line="weak").values == 2
    assert broke.sum() > 800 and np.isfinite(at(alone, "line", "time"))[broke].all()
    both = run(case.replace(barrier=[weak, strong]))
    assert not np.isfinite(at(both, "road", "time")).any()
    assert np.array_equal(at_lines(both)["barrier_outcome"].sel(line="strong").values == 1,
                          np.isfinite(at(alone, "line", "time")))  # fmt: skip


def test_bits_do_not_depend_on_threads_chunks_or_shards(case, caught, tmp_path):
    case = case.replace(barrier=[NET, WALL])
    same(run(case, threads=2, chunk=37), caught)
    parts = [run(case, shard=(k, 3)) for k in (3, 1, 2)]
    same(rockfall.merge(parts), caught)


@pytest.mark.all
def test_either_program_goes_on_to_the_same_bits(tmp_path, monkeypatch):
    """A run of Python is killed, and rockfall-batch resumes its checkpoint: merged with another
    part, it is bit-identical to one run."""
    make_full_case(tmp_path)
    case = rockfall.read_case(tmp_path / "case.nml")
    nets = [
        line | {"name": f"net at {line['name']}", "height": 2.0, "capacity": 100.0}
        for line in case.line
    ]
    case = case.replace(barrier=nets, output={"energy_balance": True})
    prepare(case, tmp_path / "prepared")
    ours = rockfall.run(case)
    saved = Checkpoint(tmp_path / "part.nc.checkpoint", 0.0)
    monkeypatch.setattr(checkpoint, "REST", 0.0)
    with monkeypatch.context() as patch, pytest.raises(Killed):
        killed_after(patch, 3)
        run_scene(read_scene(case), chunk=20, shard=(1, 2), checkpoint=saved)
    words = "--output", "part.nc", "--shard", "1/2", "--resume", "--quiet"
    done = run_program("prepared/case.nml", *words, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    theirs = rockfall.merge([tmp_path / "part.nc", rockfall.run(case, shard=(2, 2))])
    same_numbers(theirs, ours)
    assert np.array_equal(np.unique(at_lines(ours)["barrier_outcome"]), [0, 1, 2, 3])
    assert ours.attrs["wall_seconds"] != theirs.attrs["wall_seconds"]


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"capacity": 150.0, "class": 2}, "&barrier capacity, class: give one of the two"),
        ({"capacity": None}, "&barrier capacity, class: give one of the two"),
        ({"capacity": None, "class": 8}, "&barrier class = 8: must be 0 to 7"),
        ({"height": 0.0}, "&barrier height = 0.0: must be 0.001 to 100 [m]"),
        ({"name": "road"}, "must be unique among lines and barriers"),
        ({"x": [1.0, 1.0], "y": [2.0, 2.0]}, "the vertices must not all coincide"),
        ({"x": [1.0]}, "x has 1 values, y has 2: the numbers must be equal"),
    ],
)  # fmt: skip
def test_refused_in_one_line(case, wrong, message):
    with pytest.raises(rockfall.RockfallError) as error:
        case.replace(barrier=[NET | wrong])
    assert message in str(error.value) and "\n" not in str(error.value)


def test_statistics_of_barriers(caught):
    table = rockfall.barrier_statistics(caught).set_index(["barrier", "outcome"])
    counts = np.bincount(at_lines(caught)["barrier_outcome"].sel(line="net").values, minlength=4)
    assert table.loc["net"]["n"].tolist() == counts[1:].tolist()
    assert (table.fraction_low <= table.fraction).all() and (
        table.fraction <= table.fraction_high
    ).all()


def test_dam_is_as_high_as_said_and_no_wider(tmp_path):
    """A dam on a plane has the given crest height and slopes; the terrain farther away is
    unchanged."""
    plane = np.repeat(0.5 * CELL * np.arange(ROWS - 1, -1, -1.0)[:, None], 60, axis=1)
    make_raster(tmp_path / "dem.tif", plane, TRANSFORM, crs="EPSG:32632")
    dam = {
        "x": [50.0, 250.0],
        "y": [102.5, 102.5],
        "height": 6.0,
        "crest_width": 4.0,
        "slope": 60.0,
        "allow_coarse": True,
    }
    case = make_case(
        tmp_path, *sets(), terrain={"dem": "dem.tif"}, release={"x": [150.0], "y": [380.0]}
    ).replace(dam=[dam])
    prepare(case, tmp_path / "prepared")
    import xarray as xr

    z = xr.open_dataset(tmp_path / "prepared" / "scene.nc")
    added = z.elevation.values - plane
    row = int((ROWS * CELL - 102.5) / CELL)  # cell centres on the crest
    assert added[row, 20:40] == pytest.approx(6.0)
    assert added.max() == pytest.approx(6.0) and added.min() == 0.0
    crest, fall = plane[row, 0] + 6.0, np.tan(np.radians(60.0))
    for k in (-1, 1):
        face = crest - fall * (CELL - 2.0)
        assert z.elevation.values[row + k, 30] == pytest.approx(max(plane[row + k, 0], face))
    assert not added[row + 5 :].any() and not added[: row - 5].any()


DAM = {"x": [5.0, 290.0], "y": [120.0, 120.0], "height": 30.0, "slope": 60.0}


def test_a_dam_stops_boulders(case):
    plain, dammed = (
        run(case.replace(dam=dam))
        for dam in ([], [DAM])
    )  # fmt: skip
    passed = [np.isfinite(at(one, "road", "time")).mean() for one in (plain, dammed)]
    assert passed[1] < 0.3 * passed[0]


def test_dam_beyond_the_terrain_is_refused(case):
    dam = {"x": [-50.0, 290.0], "y": [120.0, 120.0], "height": 15.0}
    with pytest.raises(rockfall.RockfallError, match="&dam x, y: must lie between"):
        run(case.replace(dam=[dam]))
