# SPDX-License-Identifier: BSD-3-Clause
"""cases/plane run from Python: all results compared with the closed form in its folder."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

import rockfall
from rockfall.result.crossings import at_lines

PLANE = Path(__file__).parents[2] / "cases" / "plane"
REBOUNDS, DROP, START = 100, 2.0, 20.0


def script(name):
    spec = importlib.util.spec_from_file_location(f"plane_{name}", PLANE / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


THEORY, GRADIENT = script("closed_form"), script("make_terrain").GRADIENT
COSINE = 1 / np.hypot(1, GRADIENT)
SINE = GRADIENT * COSINE


@pytest.fixture(scope="module")
def result():
    maps = ["passages", "deposits", "speed_max_map"]
    output = {"maps": maps, "rebounds": True}
    return rockfall.run(rockfall.read_case(PLANE / "case.nml").replace(output=output))


@pytest.fixture(scope="module")
def expected():
    return THEORY.contacts(REBOUNDS, GRADIENT, DROP)


def contacts(result, name):
    """Values of a trajectory column at the contacts; the first vertex is the release."""
    return result[f"trajectory_{name}"].values[1:]


def close(got, wanted):
    """Return True if no value differs by more than 1e-10 of the largest expected value."""
    return np.abs(got - wanted).max() <= 1e-10 * np.abs(wanted).max()


def test_every_contact_is_that_of_the_closed_form(result, expected):
    level = result.trajectory_z.values[0] - DROP
    assert result.sizes["trajectory_vertex"] == REBOUNDS + 1
    assert close(contacts(result, "x") - START, expected.distance)
    assert close(contacts(result, "z") - level, -GRADIENT * expected.distance)
    assert np.abs(contacts(result, "y") - 20).max() < 1e-10
    assert np.allclose(contacts(result, "time"), expected.time, rtol=1e-10, atol=0)
    for k, part in enumerate("tnw"):
        assert close(contacts(result, f"in_{part}"), expected.incoming[:, k])
        assert close(contacts(result, f"out_{part}"), expected.outgoing[:, k])
    v_t, v_n, _ = expected.outgoing.T
    assert close(contacts(result, "velocity_x"), v_t * COSINE + v_n * SINE)
    assert close(contacts(result, "velocity_z"), v_n * COSINE - v_t * SINE)


def test_what_became_of_the_boulder(result, expected):
    one = result.isel(boulder=0)
    assert int(one.status) == 4 and int(one.impacts) == REBOUNDS
    radius = (3 * 0.8 / (4 * np.pi)) ** (1 / 3)
    assert np.allclose(contacts(result, "ratio"), radius / 0.25, rtol=1e-14)
    assert float(one.plan_distance) == pytest.approx(expected.distance[-1], rel=1e-10)
    assert float(one.travel_time) == pytest.approx(expected.time[-1], rel=1e-10)
    speeds = np.hypot(*np.concatenate([expected.incoming, expected.outgoing])[:, :2].T)
    assert float(one.speed_max) == pytest.approx(speeds.max(), rel=1e-10)
    jumps = (expected.outgoing[:-1, 1] / COSINE) ** 2 / (2 * THEORY.GRAVITY)
    assert float(one.jump_height_max) == pytest.approx(max(DROP, jumps.max()), rel=1e-10)


def test_path_length_is_that_of_the_parabolas(result, expected):
    v_t, v_n, _ = expected.outgoing[:-1].T
    along, up = v_t * COSINE + v_n * SINE, v_n * COSINE - v_t * SINE
    share, weight = np.polynomial.legendre.leggauss(60)
    flight = np.diff(expected.time)
    time = flight[:, None] * (share + 1) / 2
    speed = np.hypot(along[:, None], up[:, None] - THEORY.GRAVITY * time)
    length = DROP + (speed @ weight * flight / 2).sum()
    assert float(result.path_length[0]) == pytest.approx(length, rel=1e-10)


def test_the_line_is_met_on_the_right_parabola(result, expected):
    met = at_lines(result).isel(line=0, boulder=0)
    k = int(np.searchsorted(expected.distance, 100.0)) - 1  # flight over x = 120
    v_t, v_n, w = expected.outgoing[k]
    along, up = v_t * COSINE + v_n * SINE, v_n * COSINE - v_t * SINE
    time = (100.0 - expected.distance[k]) / along
    down = up - THEORY.GRAVITY * time
    height = (up + GRADIENT * along) * time - THEORY.GRAVITY * time**2 / 2
    radius = (3 * 0.8 / (4 * np.pi)) ** (1 / 3)
    wanted = {
        "x": 120.0, "y": 20.0, "time": expected.time[k] + time, "speed": np.hypot(along, down),
        "velocity_x": along, "velocity_z": down, "omega": w / radius, "jump_height": height,
        "passing_height": height + radius / COSINE,
        "energy_translational": 0.5 * 2240 * (along**2 + down**2),
        "energy_rotational": 0.2 * 2240 * w**2,
    }  # fmt: skip
    for name, value in wanted.items():
        assert float(met[f"line_{name}"]) == pytest.approx(value, rel=1e-6), name


def test_maps_and_histograms_of_one_boulder(result, expected):
    passages = result.passages
    last = int(START + expected.distance[-1])
    assert passages.sum() == last - 20 + 1
    beside = passages.sel(x=slice(20, last + 1), y=slice(21, 19))  # y = 20 is the side of two cells
    assert beside.shape == (2, last - 20 + 1) and (beside.sum("y") == 1).all()
    assert int(result.deposits.sum()) == 0  # still moving at the impact limit
    incidence = np.degrees(np.arctan2(-expected.incoming[:, 1], expected.incoming[:, 0]))
    wanted = np.histogram(incidence, 45, (0, 90))[0]
    assert np.array_equal(result.incidence_angle_histogram, wanted)
    restitution = -expected.outgoing[:, 1] / expected.incoming[:, 1]
    wanted = np.histogram(restitution, 50, (0, 5))[0]
    assert np.array_equal(result.restitution_normal_histogram, wanted)


@pytest.mark.parametrize("drop", [0.5, 8.0])
def test_another_drop_scales_everything(drop):
    case = rockfall.read_case(PLANE / "case.nml").replace(
        release={"drop_height": drop}, impact={"impact_limit": 25}
    )
    result, expected = rockfall.run(case), THEORY.contacts(25, GRADIENT, drop)
    assert close(contacts(result, "x") - START, expected.distance)
    assert close(contacts(result, "time"), expected.time)
    assert close(contacts(result, "out_w"), expected.outgoing[:, 2])
