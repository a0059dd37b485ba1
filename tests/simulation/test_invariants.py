# SPDX-License-Identifier: BSD-3-Clause
"""Properties of a slope with thousands of boulders: threads and chunks have no effect, and totals
add up. tests/fuzz/test_properties.py has properties of scenes that are shifted, turned, mirrored or
scaled."""

import numpy as np
import pytest

import rockfall
import scenes
from made import refused
from rockfall.analysis.precision.intervals import between_ranks
from rockfall.result import variables
from rockfall.result.crossings import at_lines
from rockfall.scene.read import read_scene
from rockfall.simulation import run_state, simulate
from same import same_numbers

CELL, SHAPE = 5.0, (80, 60)
WIDTH, HEIGHT = SHAPE[1] * CELL, SHAPE[0] * CELL
START = (152.25, 385.125)  # eighths: sums with large offsets are exact
MAPS = list(variables.MAP)
QUANTITIES = ("energy", "speed", "jump_height", "passing_height")  # in the order of the maxima
LINES = [
    {"name": "low", "x": [5.0, 295.0], "y": [200.0, 200.0]},
    {"name": "bent", "x": [5.0, 150.0, 295.0], "y": [300.0, 310.0, 290.0]},
]
ALL = {"line": LINES, "output": {"maps": MAPS, "rebounds": True, "trajectories": 20}}


def slope():
    """Rough slope with a hole."""
    z = scenes.rough()
    z[60:64, 25:28] = np.nan
    return z


def river():
    """Rock sizes, random except in an absorbing river across the foot of the slope."""
    rocks = np.random.default_rng(8).uniform(0.1, 0.6, SHAPE).astype("f4")
    rocks[74:76, :35] = np.inf
    return rocks


def make_case(folder, boulders=500, scatter=2.0, **groups):
    """Case on `slope` with `river`, whose boulders have every status unless groups are changed."""
    usual = {
        "case": {"boulders": boulders},
        "surface": {"mean_radius": "given"},
        "impact": {"impact_limit": 60},
        "boulder": {"volume": "normal", "volume_mean": 0.8, "volume_std": 0.3},
        "release": {"x": [START[0]], "y": [START[1]]},
    }
    for name, values in usual.items():
        groups[name] = {**values, **groups.get(name, {})}
    return scenes.make_case(folder, *scenes.sets(scatter), **groups)


def run(case, z=None, rocks=None, west=0.0, south=0.0, **how):
    z = slope() if z is None else z
    arrays = {"mean_radius": river() if rocks is None else rocks}
    grid = scenes.grid(z, CELL, west, south)
    return rockfall.run(case, dem=z, transform=grid, **arrays, **how)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("invariants")


@pytest.fixture(scope="module")
def crowd(folder):
    """Result of 5,000 boulders with every output, on one thread and in one chunk."""
    return run(make_case(folder, 5000, **ALL), threads=1, chunk=5000)


@pytest.fixture(scope="module")
def plain(folder):
    """Result without optional outputs."""
    return run(make_case(folder))


def test_threads_do_not_matter(folder, crowd):
    result = run(make_case(folder, 5000, **ALL), threads=4, chunk=5000)
    assert result.attrs["threads"] == 4
    assert set(result.variables) == set(crowd.variables)
    same_numbers(result, crowd)


@pytest.mark.parametrize("chunk", [7, None])
def test_chunks_do_not_matter(folder, crowd, chunk):
    same_numbers(run(make_case(folder, 5000, **ALL), threads=1, chunk=chunk), crowd)


@pytest.mark.parametrize("number", [1, 4711, 5000])
def test_a_boulder_alone_is_that_of_the_crowd(folder, crowd, number):
    z = slope()
    case = make_case(folder, 5000, line=LINES)
    scene = read_scene(case, z, scenes.grid(z, CELL), mean_radius=river())
    tally = simulate.start(scene, threads=1)
    simulate._run_range(tally, number, 1)
    tally.done = number
    crossings = {array.file_name: array.values for array in tally.arrays("crossing")}
    assert (crossings["crossing_boulder"] == number).all() and {*crossings} > {"crossing_time"}
    order = np.argsort(crossings["crossing_line"])
    own = crowd["crossing_boulder"].values == number
    for name, values in crossings.items():
        assert np.array_equal(values[order], crowd[name].values[own]), name
    found = {array.file_name: array.values for array in tally.arrays("boulder")}
    assert {"volume", "status"} <= {*found}
    for name, values in found.items():
        met = crowd[name].values[..., number - 1]
        assert np.array_equal(values[..., number - 1], met, equal_nan=True), name
    row = {name: values[number - 1] for name, values in found.items() if values.ndim == 1}
    way = simulate.trajectory(scene, number)
    last = dict(zip(simulate.fields("vertex"), way[-1], strict=True))
    assert [last[axis] for axis in "xyz"] == [row[f"stop_{axis}"] for axis in "xyz"]
    assert last["time"] == row["travel_time"]


@pytest.mark.all
def test_one_map_alone_is_that_of_all(folder):
    every = run(make_case(folder, 100, **ALL))
    for name in MAPS:
        alone = run(make_case(folder, 100, output={"maps": [name]}))
        assert set(MAPS) & set(alone.variables) == {name}
        same_numbers(alone, every)


def test_another_seed_gives_other_boulders(folder, plain):
    other = run(make_case(folder, case={"seed": 20090602}))
    assert (other.volume.values != plain.volume.values).all()
    assert (other.path_length.values != plain.path_length.values).all()


def test_a_run_leaves_its_input_as_it_was(folder):
    z, rocks = slope(), river()
    run(make_case(folder, **ALL), z, rocks)
    assert np.array_equal(z, slope(), equal_nan=True)
    assert np.array_equal(rocks, river())


def test_limits_of_the_reach_probability_are_wilsons(crowd):
    n, z = crowd.sizes["boulder"], 1.959964
    low, p, high = (
        crowd[f"reach_probability{of}"].values.astype("f8") for of in ("_low", "", "_high")
    )
    for limit in low, high:  # roots of (p - limit)**2 = z**2 limit (1 - limit)/n
        inside = (limit > 1e-9) & (limit < 1 - 1e-9)
        assert inside.any()
        p_in, root = p[inside], limit[inside]
        assert (p_in - root) ** 2 * n / (root * (1 - root)) == pytest.approx(z**2, rel=2e-3)
    assert ((low <= p) & (p <= high)).all()
    never = crowd.passages.values == 0
    assert (low[never] == 0).all() and (high[never] > 0).all()


def _limits_are_those_of_the_lines(result, alone, name):
    """Limits exist in cells with at least `thin_below` passages, each where a line would have it,
    and are within one bin of the adjacent order statistics."""
    level, lowest = int(name[-2:]) / 100, {"e": 64, "s": 0.25, "j": 0.0625, "p": 0.0625}[name[0]]
    low, high = (result[f"{name}_{end}"].values for end in ("low", "high"))
    count = (~np.isnan(alone)).sum(axis=0)
    assert np.array_equal(count >= result[name].attrs["thin_below"], np.isfinite(low + high))
    for cell in zip(*np.nonzero(count), strict=True):
        ordered = np.sort(alone[:, *cell][~np.isnan(alone[:, *cell])])
        for map_, limit in zip(
            (low, high), between_ranks(ordered, level, count[cell]), strict=True
        ):
            assert np.isnan(map_[cell]) == np.isnan(limit)
            if np.isfinite(limit):
                below, above = ordered[ordered <= limit][-1], ordered[ordered >= limit][0]
                assert 0.8 * below - lowest <= map_[cell] <= 1.25 * above + lowest


def _quantiles(values, level):
    """Quantile of each column as at lines, and the order statistics below and above it, without
    NaN. Much faster than `np.nanquantile`."""
    ordered = np.sort(values, axis=0)  # NaN last
    place = level * ((~np.isnan(values)).sum(axis=0) - 1)
    below, above = (
        np.take_along_axis(ordered, ends(place).astype(int)[None], axis=0)[0]
        for ends in (np.floor, np.ceil)
    )
    return below + (place % 1) * (above - below), below, above


def test_means_and_quantiles_of_cells_are_those_of_their_boulders(folder):
    """Boulders are run one by one to obtain their maxima in each cell."""
    case = make_case(folder, 400, scatter=1.0, output={"maps": MAPS})
    z = slope()
    scene = read_scene(case, dem=z, transform=scenes.grid(z, CELL), mean_radius=river())
    alone = []
    for number in range(1, 401):
        tally = simulate.start(scene, 1)
        simulate._run_range(tally, number, 1)
        passed = tally.array("tally_counts")[0] > 0
        alone.append(np.where(passed, tally.array("tally_maxima").astype("f8"), np.nan))
    alone = np.array(alone)  # (boulders, quantities, y, x)
    result = simulate.run_scene(scene)
    count = (~np.isnan(alone[:, 0])).sum(axis=0)
    assert np.array_equal(count, result.passages)
    seen = set()
    for k, quantity in enumerate(QUANTITIES):
        mean = result[f"{quantity}_mean"]
        shown = count > 0
        assert np.array_equal(shown, ~np.isnan(mean)) and mean.attrs["thin_below"] == 10
        expected = np.nanmean(alone[:, k][:, shown], axis=0)
        np.testing.assert_allclose(mean.values[shown], expected, rtol=1e-5, atol=1e-3)
        std, several = result[f"{quantity}_std"].values, count > 1
        assert np.array_equal(several, ~np.isnan(std))
        expected = np.nanstd(alone[:, k][:, several], axis=0, ddof=1)
        slack = 1e-3 * (1 + 999 * (k == 0))
        np.testing.assert_allclose(std[several], expected, rtol=1e-5, atol=slack)
        for percent in (50, 90, 95, 98, 99):
            about = result[f"{quantity}_q{percent}"]
            assert np.array_equal(count > 0, ~np.isnan(about))
            _limits_are_those_of_the_lines(result, alone[:, k], f"{quantity}_q{percent}")
            shown = count >= (10 if percent == 50 else about.attrs["thin_below"])
            values = alone[:, k][:, shown]
            linear, below, above = _quantiles(values, percent / 100)
            lowest = {"energy": 64, "speed": 0.25}.get(quantity, 0.0625)
            assert (about.values[shown] >= 0.8 * below - lowest).all()
            assert (about.values[shown] <= 1.25 * above + lowest).all()
            off = (about.values[shown] / linear)[linear > 4 * lowest] - 1
            if off.size > 20:  # a mean over fewer cells is too uncertain
                assert abs(off.mean()) < 0.07 and np.sqrt((off**2).mean()) < 0.09
                seen.add(quantity)
    assert len(seen) == 4


def test_quantiles_need_room_for_the_cells_that_boulders_reach(folder, monkeypatch):
    """Memory for the cells that boulders reach is sufficient, although less than for all cells;
    with less, one line reports it."""
    z, case = slope(), make_case(folder, 100, output={"maps": MAPS})
    scene = read_scene(case, dem=z, transform=scenes.grid(z, CELL), mean_radius=river())
    whole = simulate.run_scene(scene)
    reached, cells = int((whole.passages > 0).sum()), z.size
    assert reached < cells // 4
    monkeypatch.setattr(run_state, "MAX_COLUMNS", reached)
    same_numbers(simulate.run_scene(scene, threads=4), whole)
    monkeypatch.setattr(run_state, "MAX_COLUMNS", reached - 1)
    for threads, chunk in ((1, 7), (4, 500)):
        with refused(
            f"case: &output maps: boulders reach more than {reached - 1} cells, for which quantile "
            "maps do not fit in memory: omit these maps"
        ):
            simulate.run_scene(scene, threads=threads, chunk=chunk)


def test_deposits_lie_where_boulders_stopped(crowd):
    rest = crowd.status.values <= 2
    found = np.zeros(SHAPE, int)
    column = np.floor(crowd.stop_x.values[rest] / CELL).astype(int)
    row = np.floor((HEIGHT - crowd.stop_y.values[rest]) / CELL).astype(int)
    np.add.at(found, (row, column), 1)
    assert np.array_equal(found, crowd.deposits)


def ways(result):
    """Yield x, y and time (3, n) at the vertices of each recorded boulder."""
    for number in np.unique(result.trajectory_boulder.values):
        mine = result.trajectory_boulder.values == number
        yield np.stack([result[f"trajectory_{name}"].values[mine] for name in ("x", "y", "time")])


def cells_under(x, y):
    """Set of the cells (row, column) below a polyline in plan."""
    found = set()
    for k in range(len(x) - 1):
        cuts = [0.0, 1.0]
        for a, b in ((x[k], x[k + 1]), (y[k], y[k + 1])):
            low, high = sorted((a / CELL, b / CELL))
            cuts += [(side * CELL - a) / (b - a) for side in range(int(low) + 1, int(high) + 1)]
        cuts = np.sort([cut for cut in cuts if 0 <= cut <= 1])
        middle = (cuts[:-1] + cuts[1:]) / 2
        row = np.floor((HEIGHT - y[k] - middle * (y[k + 1] - y[k])) / CELL).astype(int)
        column = np.floor((x[k] + middle * (x[k + 1] - x[k])) / CELL).astype(int)
        found |= set(zip(row.tolist(), column.tolist(), strict=True))
    return found


def test_passages_are_the_cells_under_the_trajectories(folder):
    output = {"maps": ["passages"], "trajectories": 200}
    result = run(make_case(folder, 200, output=output))
    passed = np.zeros(SHAPE, int)
    for x, y, _ in ways(result):
        for cell in cells_under(x, y):
            passed[cell] += 1
    assert passed.sum() > 2000
    assert np.array_equal(passed, result.passages)


@pytest.mark.parametrize(("limit", "at_start"), [(4, False), (5, True), (8, False), (10, True)])
def test_greatest_speed_is_that_of_the_trajectory(folder, limit, at_start):
    """The maximum speed is at the end of a flight or, if spin turns into speed, at its start."""
    quarter, k = np.sqrt(0.5), np.sqrt(0.4)
    fixed = np.array([quarter, 0, -quarter * k, 0.2, -0.3, 0, quarter / k, 0, quarter])
    z = scenes.rough(relief=0.0)
    case = scenes.make_case(
        folder, np.tile(0.98 * fixed, (5, 1)), np.zeros((5, 9, 9)),
        case={"boulders": 1}, output={"trajectories": 1}, impact={"impact_limit": limit},
        release={"x": [START[0]], "y": [START[1]], "drop_height": 0.1, "velocity": [0, -10, -8]},
    )  # fmt: skip
    result = rockfall.run(case, dem=z, transform=scenes.grid(z, CELL))
    after = np.sqrt(sum(result[f"trajectory_velocity_{axis}"].values ** 2 for axis in "xyz"))
    before = np.hypot(result.trajectory_in_t.values, result.trajectory_in_n.values)
    assert int(result.impacts[0]) == limit
    assert float(result.speed_max[0]) == pytest.approx(max(after.max(), before.max()), rel=1e-12)
    assert (after.max() > before.max()) == at_start


@pytest.mark.parametrize("ratio", ["nearest", "between"])
def test_rebounds_outside_what_the_set_was_fitted_on(folder, ratio):
    """Counts of rebounds outside the fit ranges are those of the trajectories, by the ranges of the
    set that each rebound used."""
    case = make_case(folder, 300, impact={"ratio": ratio}, output={"trajectories": 300})
    result = run(case)
    size, in_t, in_n = (result[f"trajectory_{name}"].values for name in ("ratio", "in_t", "in_n"))
    hit = size > 0
    assert hit.sum() == result.rebounds > 3000
    speed, angle = np.hypot(in_t, in_n)[hit], np.degrees(np.arctan2(-in_n, in_t))[hit]
    near = np.clip(size[hit], 1, 5)
    found = {"speed": [], "angle": []}
    for sets in (np.floor(near), np.ceil(near)) if ratio == "between" else [np.floor(near + 0.5)]:
        found["speed"].append((speed < 0.5 * sets) | (speed > 10 + sets))
        found["angle"].append((angle < 3 + sets) | (angle > 50 + sets))
    for name, outside in found.items():
        counted = int(result[f"rebounds_out_of_{name}"])
        assert np.all(outside, axis=0).sum() <= counted <= np.any(outside, axis=0).sum()
        assert 100 < counted < result.rebounds - 100
    scene = read_scene(case, slope(), scenes.grid(slope(), CELL), mean_radius=river())
    assert scene.coefficients.speed_range[:, 2].tolist() == [1.5, 13.0]
    assert scene.coefficients.angle_range[:, 2].tolist() == [6.0, 53.0]


def test_what_a_set_was_fitted_on_changes_no_boulder(folder):
    """Fit ranges change no boulder; without ranges no rebound is counted as outside."""
    told = run(make_case(folder, 200, **ALL))
    untold = run(make_case(folder, 200, more=scenes.lateral, **ALL))
    counts = {"rebounds_out_of_speed", "rebounds_out_of_angle"}
    same_numbers(told, untold, sorted(set(told.variables) - counts))
    for name in counts:
        assert told[name] > 0 == untold[name]


def test_lines_are_met_where_the_trajectories_cross_them(folder):
    level = LINES[0]["y"][0]
    result = run(make_case(folder, 200, line=LINES, output={"trajectories": 200}))
    met = at_lines(result).isel(line=0)
    for k, (x, y, time) in enumerate(ways(result)):
        over = np.flatnonzero((y[:-1] > level) & (y[1:] < level))
        if not over.size:
            assert np.isnan(met["line_time"][k])
            continue
        a = over[0]
        share = (y[a] - level) / (y[a] - y[a + 1])
        assert met["line_y"][k] == pytest.approx(level, abs=1e-9)
        assert met["line_x"][k] == pytest.approx(x[a] + share * (x[a + 1] - x[a]), abs=2e-5)
        at = time[a] + share * (time[a + 1] - time[a])
        assert met["line_time"][k] == pytest.approx(at, rel=1e-7)
    assert 20 < met["line_time"].count() < 200


def test_numbers_at_a_line_agree_with_each_other(crowd):
    mass = 2800.0 * crowd.volume
    radius = (3 * crowd.volume / (4 * np.pi)) ** (1 / 3)
    found = at_lines(crowd)
    speed2 = sum(found[f"line_velocity_{axis}"] ** 2 for axis in "xyz")
    expected = {
        "line_speed": np.sqrt(speed2),
        "line_energy_translational": mass * speed2 / 2,
        "line_energy_rotational": 0.2 * mass * (radius * found["line_omega"]) ** 2,
    }
    for name, values in expected.items():
        values = values.transpose(*found[name].dims)
        assert np.allclose(found[name], values, rtol=1e-12, atol=0, equal_nan=True), name
    met = found["line_time"].notnull()
    assert (met.sum("boulder") > 100).all()
    assert (found["line_jump_height"].values[met] >= 0).all()
    clear = found["line_passing_height"] - found["line_jump_height"] - radius
    for holds in (clear > -1e-6, found["line_speed"] <= crowd.speed_max * (1 + 1e-7),
                  found["line_time"] <= crowd.travel_time * (1 + 1e-7)):  # fmt: skip
        assert holds.transpose(*met.dims).values[met].all()
