# SPDX-License-Identifier: BSD-3-Clause
"""Recorded flights near barriers are checked again in plain NumPy: no boulder passed through a
barrier that could stop it, and each lost the right energy."""

import numpy as np
import pytest
from rasterio.transform import from_origin

import rockfall
from rockfall.io.rasters.grid import Grid
from rockfall.result.trajectories import ends
from rockfall.terrain.height import height
from scenes import make_case, rough, sets

CELL, G, NEAR = 5.0, 9.81, 1e-7
Z, GRID = rough(), Grid(0.0, 400.0, CELL, 60, 80)
TRACK = ("x", "y", "z", "time", "velocity_x", "velocity_y", "velocity_z", "out_w", "ratio")
BARRIERS = [
    {"name": "net", "x": [0.0, 120.0, 180.0, 295.0], "y": [260.0, 240.0, 262.0, 250.0],
     "height": 2.5, "capacity": 120.0},
    {"name": "hairpin", "x": [60.0, 240.0, 60.0], "y": [170.0, 160.0, 150.0],
     "height": 3.0, "capacity": 60.0},
    {"name": "wall", "x": [2.0, 295.0], "y": [100.0, 90.0], "height": 4.0, "class": 1},
]  # fmt: skip
CAPACITY = [120e3, 60e3, 250e3]  # [J]


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    case = make_case(
        tmp_path_factory.mktemp("reference"), *sets(),
        case={"boulders": 120}, release={"x": [150.0, 90.0], "y": [380.0, 370.0]},
        surface={"uniform_mean_radius": 0.3}, boulder={"volume_mean": 0.5},
        impact={"rest_angle": 90.0},  # only flights
        output={"trajectories": 240, "energy_balance": True},
    )  # fmt: skip
    place = from_origin(0.0, 80 * CELL, CELL, CELL)
    return rockfall.run(case.replace(barrier=BARRIERS), dem=Z, transform=place)


def ground(x, y):
    return height(Z, GRID, np.array([x]), np.array([y]))[0]


def slope_at(x, y):
    """Factor sqrt(1 + |grad z|^2) of the bilinear patch, from differences of elevations."""
    u, v = x / CELL - 0.5, y / CELL - 0.5
    i, j = np.floor(u), np.floor(v)
    (sw, se), (nw, ne) = (
        [ground((i + a + 0.5) * CELL, (j + b + 0.5) * CELL) for a in (0, 1)] for b in (0, 1)
    )
    gx = ((se - sw) * (1 - (v - j)) + (ne - nw) * (v - j)) / CELL
    gy = ((nw - sw) * (1 - (u - i)) + (ne - se) * (u - i)) / CELL
    return np.sqrt(1 + gx**2 + gy**2)


def crossings(a, v, time, barrier):
    """Yield the times at which a flight from `a` with plan velocity `v` crosses a barrier."""
    vertices = np.stack([barrier["x"], barrier["y"]], axis=1)
    for p, q in zip(vertices[:-1], vertices[1:], strict=True):
        across = np.array([[v[0], p[0] - q[0]], [v[1], p[1] - q[1]]])
        if abs(np.linalg.det(across)) < 1e-12:
            continue
        t, along = np.linalg.solve(across, p - a)
        if 0 < along < 1 and -NEAR < t < time + NEAR:
            yield t


def test_no_flight_goes_through_a_barrier_that_stands_in_its_way(result):
    met = 0
    number = result.trajectory_boulder.values
    track = {name: result[f"trajectory_{name}"].values for name in TRACK}
    taken = np.zeros(result.sizes["boulder"])
    for boulder in range(1, 241):
        rows = np.flatnonzero(number == boulder)
        volume = float(result.volume[boulder - 1])
        mass, radius = 2800.0 * volume, (3 * volume / (4 * np.pi)) ** (1 / 3)
        spin, broken = 0.0, set()
        for k, n in zip(rows[:-1], rows[1:], strict=True):
            if track["ratio"][k] > 0:
                spin = track["out_w"][k]
            start = np.array([track["x"][k], track["y"][k]])
            v = np.array([track[f"velocity_{axis}"][k] for axis in "xyz"])
            time = track["time"][n] - track["time"][k]
            hits = sorted(
                (t, b) for b, barrier in enumerate(BARRIERS) if b not in broken
                for t in crossings(start, v[:2], time, barrier)
            )  # fmt: skip
            for t, b in hits:
                x, y = start + v[:2] * t
                z = track["z"][k] + v[2] * t - G / 2 * t * t
                above = z - ground(x, y)
                top = above + radius * slope_at(x, y) - BARRIERS[b]["height"]
                if abs(top) < 1e-9 or t < NEAR:  # undecided, or at the start of the flight
                    continue
                here = abs(t - time) < NEAR and track["ratio"][n] == 0
                assert (top < 0) == here, (boulder, b, top)
                if here:
                    met += 1
                    broken.add(b)
                    at = v - [0, 0, G * time]
                    energy = mass / 2 * (at @ at + 0.4 * spin**2)
                    part = min(1.0, CAPACITY[b] / energy)
                    taken[boulder - 1] += part * energy
                    after = [track[f"velocity_{axis}"][n] for axis in "xyz"]
                    assert after == pytest.approx(np.sqrt(1 - part) * at, rel=1e-9, abs=1e-9)
                    spin *= np.sqrt(1 - part)
                    break
    assert met > 150
    assert taken == pytest.approx(result.energy_barriers.values, rel=1e-9, abs=1e-6)
    assert ends(result)["stopped_by_barrier"].sum() > 30
