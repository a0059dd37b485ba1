# SPDX-License-Identifier: BSD-3-Clause
"""Motion between recorded contacts: free fall in the air, straight and uniform motion along the
ground, and waiting."""

import numpy as np
import pytest

import rockfall
from crossed import SINGLE
from made import every_third, refused
from rockfall.files.trajectory_layers import flight_features
from rockfall.result.contents import Contents
from rockfall.result.crossings import at_lines
from rockfall.result.motion import EXACT, motion_of, sampled
from rockfall.result.trajectories import POINTS, curves
from rockfall.result.variables import LEG
from rockfall.terrain.height import height
from scenes import grid, make_case, rough, sets

G = 9.81
FLIGHT, GROUND = LEG["flight"], LEG["ground"]
Z = rough()
LINES = [{"name": f"{y}", "x": [0.0, 300.0], "y": [float(y)] * 2} for y in range(370, 20, -10)]
TABLE = {"impact": {"form": "table", "table": "talus"}}
FOREST = {"uniform_stems": 300.0, "uniform_dbh_mean": 20.0, "uniform_dbh_std": 3.0}
#: Matrices and tables, both with rolling boulders; trees interrupt flights and slides.
RUNS = {
    "matrix": {"impact": {"rest_angle": 20.0}},
    "table": TABLE,
    "trees": TABLE | {"forest": FOREST | {"uniform_conifers": 60.0}},
    "breakage": {
        "breakage": {"at": "impact", "min_area_ratio": 0.3, "min_volume": 0.05},
        "boulder": {"volume_mean": 5.0},
    },
}


@pytest.fixture(scope="module", params=RUNS)
def moved(request, tmp_path_factory):
    case = make_case(
        tmp_path_factory.mktemp("motion"), *sets(), terrain={}, line=LINES,
        case={"boulders": 30}, output={"trajectories": 30},
        release={"x": [150.0], "y": [380.0], "drop_height": 5.0}, **RUNS[request.param],
    )  # fmt: skip
    return request.param, rockfall.run(case, dem=Z, transform=grid(Z))


def vertices(result):
    """Arrays (4, n) of x, y, z and time of the vertices, for each recorded boulder."""
    owner = result["trajectory_boulder"].values
    columns = np.stack([result[f"trajectory_{name}"].values for name in ("x", "y", "z", "time")])
    return [columns[:, owner == number] for number in np.unique(owner)]


def test_a_flight_keeps_its_energy(moved):
    name, result = moved
    motion = motion_of(result)
    flights = motion.take(motion.gravity > 0)
    assert {*flights.gravity} == {G} and flights.boulder.size > 100
    assert (motion.gravity == 0).any() == (name != "breakage")
    energies = []
    for part in (0.0, 0.3, 1.0):
        (_, _, z, _), speed = flights.at(part)
        energies.append(speed**2 / 2 + G * z)
    np.testing.assert_allclose(energies[1:], [energies[0]] * 2, rtol=1e-11, atol=G * EXACT)


def test_a_curve_goes_from_vertex_to_vertex_as_time_goes_on(moved):
    _, result = moved
    for curve, known in zip(rockfall.trajectories(result), vertices(result), strict=True):
        points = np.stack([curve.x, curve.y, curve.z, curve.time])
        assert np.array_equal(points[:, [0, -1]], known[:, [0, -1]])
        assert {*zip(*known.tolist(), strict=True)} <= {*zip(*points.tolist(), strict=True)}
        assert (np.diff(curve.time) >= 0).all()


def test_speed_is_the_rate_at_which_the_place_changes(moved):
    """Speed in the air changes by gravity alone; on the ground it is uniform in plan. At the end of
    a contact drawn from a table, a boulder is raised at once."""
    name, result = moved
    stood = 0.0
    for one in rockfall.trajectories(result):
        step, time = np.diff([one.x, one.y, one.z]), np.diff(one.time)
        length = np.linalg.norm(step, axis=0)
        flies = (one.gravity[:-1] > 0) & (time > 0)
        off = np.abs(length - one.speed[:-1] * time) - G * time**2 / 2
        assert off[flies].max() < 1e-6
        assert np.abs(step[:2, time == 0]).max() < 1e-9 and step[2, time == 0].min() > -1e-9
        assert name in ("table", "trees") or step[2, time == 0].max() < 1e-9
        fastest = result["speed_max"].sel(boulder=one.boulder).item()
        air = one.gravity > 0
        assert one.speed[air].max() <= fastest * (1 + 1e-9)
        assert one.speed.max() <= fastest * 1.15  # on steeper ground than before
        stands = (length == 0) & (time > 0)
        assert not one.speed[:-1][stands].any() and not one.speed[1:][stands].any()
        stood += time[stands].sum()
    assert (stood > 1.0) == (name in ("table", "trees"))
    motion = motion_of(result)
    motion = motion.take(motion.gravity == 0)
    step, velocity = (motion.end - motion.start)[[0, 1, 3]], motion.velocity[:2]
    assert np.abs(step[:2] - velocity * step[2]).max(initial=0.0) < 1e-9


def test_a_leg_on_the_ground_follows_the_terrain(moved):
    """Legs on the ground are off the terrain by at most 2 % of the smallest boulder radius; without
    their intermediate points, by decimetres."""
    name, result = moved
    radius = (3 * result["volume"].values.min() / (4 * np.pi)) ** (1 / 3)

    def farthest(motion):
        motion = motion.take((motion.gravity == 0) & (motion.end != motion.start).any(axis=0))
        x, y, z, _ = motion.take(None).at(np.linspace(0, 1, 41))[0]
        return np.abs(z - height(Z, grid(Z), x.ravel(), y.ravel()).reshape(z.shape)).max(initial=0)

    assert farthest(motion_of(result)) < 0.02 * radius
    if name == "table":
        assert farthest(motion_of(result).straightened()) > 0.2


def test_no_point_is_higher_than_its_leg_allows(moved):
    """No point is above the higher end of its leg or the apex of its flight, and none is below the
    lower end."""
    motion = motion_of(moved[1])
    (_, _, z, _), _ = motion.take(None).at(np.linspace(0, 1, 41))
    ends = np.array([motion.start[2], motion.end[2]])
    up = np.maximum(motion.velocity[2], 0.0)
    rise = np.divide(up**2, 2 * motion.gravity, out=np.zeros(up.size), where=motion.gravity > 0)
    apex = motion.start[2] + rise
    assert (z.max(axis=1) <= np.maximum(ends.max(axis=0), apex) + 1e-6).all()
    assert (z.min(axis=1) >= ends.min(axis=0) - 1e-6).all()


@pytest.mark.parametrize(
    "moved", every_third(["matrix", "table", "trees"]), indirect=True, scope="module"
)
def test_a_curve_has_the_kernels_speed_where_it_passes_a_line(moved):
    """Linear interpolation of the squared speed, quadratic in time, has an error of at most g^2
    h^2/4. (With breakage, a line has its most energetic fragment, which may not be the recorded
    one.)"""
    compared, (_, result) = 0, moved
    crossed = at_lines(result)
    for one in rockfall.trajectories(result):
        row = np.flatnonzero(result["boulder"].values == one.boulder)[0]
        for k, line in enumerate(LINES):
            passed = np.flatnonzero((one.y[:-1] > line["y"][0]) & (one.y[1:] <= line["y"][0]))
            assert (passed.size > 0) == np.isfinite(crossed["line_speed"].values[k, row])
            if passed.size:
                a, b = passed[0], passed[0] + 1
                part = (one.y[a] - line["y"][0]) / (one.y[a] - one.y[b])
                at = {"speed": one.speed**2, "x": one.x}
                found = {name: v[a] + part * (v[b] - v[a]) for name, v in at.items()}
                wanted = float(crossed["line_speed"].values[k, row]) ** 2
                error = (G * (one.time[b] - one.time[a])) ** 2 / 4
                assert abs(found["speed"] - wanted) <= error + 2 * SINGLE * wanted
                assert found["x"] == pytest.approx(crossed["line_x"].values[k, row], rel=SINGLE)
                compared += 1
    assert compared > 100


@pytest.mark.all
@pytest.mark.parametrize("tolerance", [0.01, 0.5])
def test_chords_stay_within_the_tolerance_at_any_time(moved, tolerance):
    _, result = moved
    motion, farthest = motion_of(result), 0.0
    paths = sampled(motion, tolerance).strings(motion.boulder)
    for one, path, known in zip(curves(motion), paths, vertices(result), strict=True):
        assert {*zip(*known.tolist(), strict=True)} <= {*map(tuple, path.tolist())}
        assert (np.diff(path[:, 3]) >= 0).all() and np.diff(path, axis=0).any(axis=1).all()
        clear = np.abs(one.time[:, None] - known[3]).min(axis=1) > 1e-9  # it may rise at once there
        chords = [np.interp(one.time[clear], path[:, 3], path[:, k]) for k in range(3)]
        off = np.linalg.norm(chords - np.stack([one.x, one.y, one.z])[:, clear], axis=0)
        farthest = max(farthest, off.max())
    assert tolerance / 4 < farthest <= tolerance + 1e-6


def recorded(**columns):
    """Motion of one boulder between given vertices; missing columns are zero, and legs are
    flights."""
    zeros = np.zeros_like(columns["z"])
    names = ("x", "y", "z", "time", "velocity_x", "velocity_y", "velocity_z")
    columns = (
        {name: zeros for name in names}
        | {"leg": zeros + FLIGHT, "boulder": zeros.astype(int) + 1}
        | columns
    )
    data = {f"trajectory_{name}": ("vertex", np.asarray(v), {}) for name, v in columns.items()}
    return motion_of(Contents(data, {}), gravity=G)


def test_flights_are_those_of_a_falling_stone():
    """A fall of 1 s from 100 m and a bounce of 0.5 s have the elevations and speeds of a hand
    calculation."""
    t, ground = np.linspace(0, 1, POINTS), 100 - G / 2
    vertical = (90.0 - ground + G / 8) / 0.5
    (flight,) = curves(recorded(
        x=[0.0, 0.0, 1.5], z=[100.0, ground, 90.0], time=[0.0, 1.0, 1.5],
        velocity_x=[0.0, 3.0, 0.0], velocity_z=[0.0, vertical, 0.0],
    ))  # fmt: skip
    assert flight.z[:POINTS] == pytest.approx(100 - G / 2 * t**2)
    assert flight.speed[:POINTS] == pytest.approx(G * t)
    assert flight.speed[POINTS:] == pytest.approx(np.hypot(3.0, vertical - G * t / 2))
    assert flight.distance[POINTS:] == pytest.approx(1.5 * t)


def test_a_slide_waits_at_its_end_and_leaves_above_it():
    """Motion by hand: a fall, a slide of 1 m at 2 m/s over a bump, a wait of 0.3 s, and a
    horizontal throw from 0.2 m above. The slide and the wait are one contact of 0.8 s."""
    fall = np.sqrt(2 * 0.2 / G)
    motion = recorded(
        x=[0.0, 0.0, 0.4, 1.0, 1.0, 1.0 + 3 * fall], z=[0.2, 0.0, 0.1, 0.0, 0.0, 0.0],
        time=np.array([0.0, fall, fall + 0.2, fall + 0.5, fall + 0.8, 2 * fall + 0.8]),
        velocity_x=[0.0, 2.0, 2.0, 0.0, 3.0, 3.0],
        leg=[FLIGHT, GROUND, GROUND, LEG["rest"], FLIGHT, 0],
    )  # fmt: skip
    (one,) = curves(motion)
    x, z, speed, time, gravity = (
        values.reshape(5, POINTS) for values in (one.x, one.z, one.speed, one.time, one.gravity)
    )
    until = [fall, fall + 0.2, fall + 0.5, fall + 0.8, 2 * fall + 0.8]
    assert time[:, -1] == pytest.approx(until)
    assert (gravity.T == [G, 0, 0, 0, G]).all()
    assert (speed[1:3] == 2.0).all() and (speed[3] == 0.0).all() and not z[3].any()
    assert z[1, 12] == z[2, 12] == pytest.approx(0.05)
    assert x[1, 12] == pytest.approx(0.2) and (x[3] == 1.0).all()
    assert z[4, 0] == pytest.approx(0.2) and z[4, -1] == 0.0
    assert speed[4] == pytest.approx(np.hypot(3.0, G * fall * np.linspace(0, 1, POINTS)))
    _, pieces = flight_features(sampled(motion))
    assert pieces["contact"].tolist() == [1, 2, 3]
    lasts = (pieces["end"] - pieces["begin"]) / np.timedelta64(1, "s")
    assert lasts == pytest.approx([fall, 0.8, fall], abs=1e-6)
    assert pieces["duration_s"] == pytest.approx([fall, 0.8, fall], abs=1e-12)
    assert pieces["speed_m_s"] == pytest.approx([0.0, 2.0, 3.0])
    assert pieces["speed_end_m_s"] == pytest.approx([G * fall, 2.0, np.hypot(3.0, G * fall)])


def test_one_that_never_moved_is_a_point():
    motion = recorded(x=[4.0, 5.0], z=[1.0, 2.0], boulder=np.array([3, 8]))
    assert [(one.boulder, *one.x, *one.speed) for one in curves(motion)] == [(3, 4, 0), (8, 5, 0)]
    paths = sampled(motion).strings(motion.boulder)
    assert [path.tolist() for path in paths] == [[[4.0, 0.0, 1.0, 0.0]], [[5.0, 0.0, 2.0, 0.0]]]
    with refused("--tolerance nan: must be > 0 [m]"):
        sampled(motion, np.nan)
