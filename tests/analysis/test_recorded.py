# SPDX-License-Identifier: BSD-3-Clause
"""Trajectories of another program beside a result: read as written, numbers by hand, bad files."""

from pathlib import Path

import numpy as np
import pytest

import rockfall
from programs import refuses
from rockfall.analysis.observations import read_observed
from rockfall.analysis.recorded import GRAVITY, crossing, recorded_numbers
from rockfall.cli import main
from rockfall.io.ramms import read_trajectories
from scenes import grid, make_case, rough, sets

G = np.array([0.0, 0.0, -GRAVITY])


@pytest.fixture(autouse=True)
def place(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def records(time, position, velocity, energy, terrain):
    """Records of a trajectory, other numbers zero."""
    found = np.zeros((len(time), 26))
    found[:, 0], found[:, 1:4], found[:, 8:11] = time, position, velocity
    found[:, 4:8] = (0.5, 0.5, -0.5, 0.5)
    found[:, 15], found[:, 18] = energy, terrain
    return found


def flight(start, velocity, times, mass=2000.0, ground=0.0):
    """Free flight above a plane."""
    t = np.asarray(times, float)[:, None]
    v = np.asarray(velocity, float) + G * t
    p = np.asarray(start, float) + np.asarray(velocity, float) * t + G * t**2 / 2
    return records(t[:, 0], p, v, mass * (v**2).sum(axis=1) / 2, ground)


def write(path, *trajectories, header=(1.0, 2.0, 3.0, 4.0)):
    np.concatenate([header, *map(np.ravel, trajectories)]).astype("<f8").tofile(path)
    return path


def test_file_is_read_as_it_was_written():
    one = flight((150, 380, 100), (0, -12, 3), [0, 0.5, 1.1])
    two = flight((151, 379, 90), (1, -9, 4), [0, 0.25, 0.5, 0.75])
    found = read_trajectories(write("a.rts", one, two))
    assert [each.where for each in found] == ["a.rts: trajectory 1", "a.rts: trajectory 2"]
    for each, made in zip(found, (one, two), strict=True):
        np.testing.assert_array_equal(each.time, made[:, 0])
        np.testing.assert_array_equal(each.position, made[:, 1:4])
        np.testing.assert_array_equal(each.velocity, made[:, 8:11])
        np.testing.assert_array_equal(each.energy, made[:, 15])
        np.testing.assert_array_equal(each.terrain, made[:, 18])


def test_numbers_at_a_line_are_those_of_the_flight():
    """Crossing at t = 0.7 s between records at 0.4 and 1.3 s."""
    write("a.rts", flight((150, 380, 100), (2, -10, 3), [0, 0.4, 1.3], ground=60.0))
    (one,) = read_trajectories("a.rts")
    found = crossing(one, np.array([0.0, 300.0]), np.array([373.0, 373.0]))
    v = np.array([2, -10, 3 - GRAVITY * 0.7])
    assert found.speed == pytest.approx(np.linalg.norm(v), rel=1e-12)
    height = 100 + 3 * 0.7 - GRAVITY * 0.49 / 2 - 60
    assert found.passing_height == pytest.approx(height, rel=1e-12)
    energies = 1000 * ((np.array([2, -10, 3]) + G * np.array([[0.4], [1.3]])) ** 2).sum(axis=1)
    assert found.energy_total == pytest.approx(energies @ (2 / 3, 1 / 3), rel=1e-12)
    assert found.energy_total >= 1000 * v @ v  # never below that of the flight


def test_first_crossing_counts_of_any_segment():
    """A path that goes forth and back over a bent line, first over its second segment."""
    t = np.arange(5.0)
    position = np.column_stack([[0, 4, 10, 4, 0], np.zeros(5), np.full(5, 9.0)])
    velocity = np.column_stack([[1, 2, 3, 4, 5], np.zeros((5, 2))])
    write("a.rts", records(t, position, velocity, t, 0.0))
    (one,) = read_trajectories("a.rts")
    x, y = np.array([8.0, 8, 2, 2]), np.array([-1.0, 2, 2, -1])
    assert crossing(one, x, y).speed == pytest.approx(1.5)
    assert crossing(one, x, y + 9) is None


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda r: r.ravel()[:-1], "648 bytes"),
        (lambda r: r[:1], "bytes: must be a header"),
        (lambda r: put(r, (1, 20), np.nan), "record 2: a number is not finite"),
        (lambda r: put(r, (1, 4), 0.9), "record 2: norm of the quaternion = 1.249: must be 1"),
        (lambda r: put(r, (0, 0), -1.0), "record 1: time = -1: must be >= 0"),
        (lambda r: put(r, (2, 15), -3.0), "record 3: kinetic energy = -3: must be >= 0"),
        (lambda r: put(r, (2, 1), 1e300), "record 3: x or y = 1e"),
        (lambda r: put(r, (2, 18), 3e38), "record 3: elevation 3e"),
        (lambda r: put(r, (2, 0), 0.3), "record 3: time = 0.3: must be >= 0.5"),
        (lambda r: put(r, (2, 0), 0.0), "trajectory 2: one record"),
    ],
)
def test_malformed_file_is_one_line(change, message):
    made = change(flight((0, 0, 9), (1, 0, 0), [0, 0.5, 1.0]))
    write("a.rts", made)
    with pytest.raises(rockfall.RockfallError) as error:
        read_trajectories("a.rts")
    said = str(error.value)
    assert said.startswith("a.rts: ") and "\n" not in said
    assert message in said


def put(values, index, value):
    values = values.copy()
    values[index] = value
    return values


def test_big_endian_is_refused():
    flight((0, 0, 9), (1, 0, 0), [0, 0.5, 1.0]).astype(">f8").tofile("b")
    Path("a.rts").write_bytes(bytes(32) + Path("b").read_bytes())
    with pytest.raises(rockfall.RockfallError, match="a.rts: record 3: elevation"):
        read_trajectories("a.rts")


def test_energies_need_their_unit():
    write("a.rts", flight((150, 380, 100), (0, -10, 0), [0, 1.0, 2.0]))
    lines = [("N", np.array([0.0, 300]), np.array([370.0, 370]))]
    samples, stops, notes = recorded_numbers(["a.rts"], lines)
    assert {one["quantity"] for one in samples} == {"speed", "passing_height"}
    assert "J would be a block of at most 2e+03 kg, kJ would be" in notes[1].replace(
        "2,000", "2e+03"
    )
    assert stops[0]["start_x"] == 150 and stops[0]["y"] == 360
    assert notes[0].endswith("not confirmed; 1 cross N.") and "end faster than 1 m/s" in notes[2]
    values = {
        unit: next(
            one["value"]
            for one in recorded_numbers(["a.rts"], lines, unit)[0]
            if one["quantity"] == "energy_total"
        )
        for unit in ("J", "kJ")
    }
    assert values["kJ"] == 1000 * values["J"] == pytest.approx(1e6 * (100 + GRAVITY**2))
    with pytest.raises(rockfall.RockfallError, match="energy unit MJ: must be J or kJ"):
        recorded_numbers(["a.rts"], lines, "MJ")


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    line = [{"name": "N", "x": [0.0, 300.0], "y": [330.0, 330.0]}]
    case = make_case(
        folder, *sets(), line=line, case={"boulders": 300}, terrain={},
        release={"x": 150.0, "y": 380.0}, output={"maps": "passages", "trajectories": 300},
    )  # fmt: skip
    return rockfall.run(case, dem=rough(), transform=grid(rough()))


def as_trajectories(result):
    """The trajectories of a result, in the layout of RAMMS, with the mass of each boulder."""
    terrain, owner = rough(), result["trajectory_boulder"].values
    for number in np.unique(owner):
        mine = owner == number
        place = np.column_stack([result[f"trajectory_{a}"].values[mine] for a in "xyz"])
        speed = np.column_stack([result[f"trajectory_velocity_{a}"].values[mine] for a in "xyz"])
        if len(place) > 1:
            yield records(result["trajectory_time"].values[mine], place, speed,
                          1000.0 * (speed**2).sum(axis=1), float(terrain.min()))  # fmt: skip


def test_own_trajectories_give_own_numbers(result, capsys):
    """Written as those of another program, the trajectories of a result stop where it says."""
    write("own.rts", *as_trajectories(result))
    rockfall.write_result(result, "r.nc")
    found = rockfall.compare(result, "own.rts", energy_unit="J")
    distances = found.ks.set_index("quantity").loc["stopping_distance"]
    assert distances["p"] > 0.99 and distances["n_observed"] == 300
    observed = read_observed("own.rts", lines=[("N", np.array([0.0, 300]), np.array([330.0, 330]))])
    crossed = np.isfinite(result["line_speed"].values[0]).sum()
    assert observed.samples["N", "speed"].size == crossed
    assert {"speed", "energy_total"} <= set(found.errors["quantity"])
    assert main(["compare", "r.nc", "own.rts"]) == 0
    out = capsys.readouterr().out
    assert "not confirmed" in out and "--energy-unit gives it" in out


def test_trajectories_need_lines_and_a_purpose(result, capsys):
    write("own.rts", *as_trajectories(result))
    rockfall.write_result(result, "r.nc")
    with pytest.raises(rockfall.RockfallError, match="own.rts: trajectories are read by"):
        read_observed("own.rts")
    Path("o.csv").write_text("distance\n12\n")
    refuses(["compare", "r.nc", "o.csv", "--energy-unit", "J"], ".*needs trajectories.*", capsys)
