# SPDX-License-Identifier: BSD-3-Clause
"""Motion of recorded boulders between their vertices, as the kernel follows it to lines and cells.

A boulder flies on a parabola, or, while it rolls or slides on the ground, goes straight at a mean
speed without gravity, and W is that speed; it may wait at the end. What a vertex does not hold
follows from its neighbours: W after a hit of a tree or barrier, where it loses as large a part as
the speed, and W and the height at which it leaves the ground after a roll or slide.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rockfall.case import case_of
from rockfall.result.trajectories import POINTS, vertices_of

if TYPE_CHECKING:
    import xarray as xr

EXACT = 1e-6  # difference of elevations from a straight path up to which it is one [m]
PARALLEL = 1e-9  # sine of the angle between directions that are the same
NAMES = ("boulder", "x", "y", "z", "time", "velocity_x", "velocity_y", "velocity_z", "out_w",
         "ratio")  # fmt: skip


class Flights(NamedTuple):
    """Flights, rolls and slides between vertices, in order of time for each boulder: ends as
    x + iy [m]; elevation, vertical velocity and plan speed at the start, duration, vertical
    acceleration; W = R_b omega [m/s]; row of the boulder."""

    start: np.ndarray
    end: np.ndarray
    z: np.ndarray
    velocity_z: np.ndarray
    plan_speed: np.ndarray
    duration: np.ndarray
    fall: np.ndarray
    spin: np.ndarray
    row: np.ndarray


def flights_of(result: xr.Dataset) -> Flights:
    """Flights of the recorded boulders that have rows; empty if none moved."""
    boulders, gravity = result["boulder"].values, case_of(result).flight["gravity"]
    parts = []
    for boulder, *vertices in vertices_of(result, *NAMES):
        row = int(np.searchsorted(boulders, boulder[0]))
        if boulder.size > 1 and row < boulders.size and boulders[row] == boulder[0]:
            parts.append(_of_boulder(vertices, gravity, row))
    if not parts:
        return Flights(*(np.empty(0) for _ in Flights._fields))._replace(row=np.empty(0, int))
    return Flights(*map(np.concatenate, zip(*parts, strict=True)))


def curve_of(flights: Flights, row: int) -> tuple[np.ndarray, np.ndarray]:
    """Points x + iy [m] of the path of the boulder of a row, and their elevations [m]."""
    of = Flights(*(values[flights.row == row] for values in flights))
    part = np.linspace(0, 1, POINTS)
    time = of.duration[:, None] * part
    place = of.start[:, None] + (of.end - of.start)[:, None] * part
    z = of.z[:, None] + of.velocity_z[:, None] * time + of.fall[:, None] * time**2 / 2
    return place.ravel(), z.ravel()


def _of_boulder(vertices: list[np.ndarray], gravity: float, row: int) -> Flights:
    x, y, z, time, velocity_x, velocity_y, velocity_z, out_w, ratio = vertices
    place, plan_speed, rise = x + 1j * y, np.hypot(velocity_x, velocity_y)[:-1], velocity_z[:-1]
    moves = plan_speed > 0
    duration = np.diff(time)  # with the time that it waits
    duration[moves] = np.abs(np.diff(place))[moves] / plan_speed[moves]
    straight = np.abs(np.diff(z) - rise * duration) <= EXACT
    fall = np.where(straight, 0.0, -gravity)
    start = z[:-1].copy()
    after = np.append(False, straight[:-1]) & ~straight & (ratio[:-1] == 0)
    start[after] = (z[1:] - rise * duration - fall * duration**2 / 2)[after]
    speeds = np.sqrt(plan_speed**2 + np.stack([rise, rise + fall * duration]) ** 2)
    velocity = np.stack([velocity_x, velocity_y, velocity_z], axis=1)
    way = np.stack([np.diff(x), np.diff(y), np.diff(z)], axis=1)
    spin = _spins(out_w[:-1], ratio[:-1], straight, speeds, velocity, way)
    rows = np.full(duration.size, row)
    return Flights(place[:-1], place[1:], start, rise, plan_speed, duration, fall, spin, rows)


def _spins(
    out_w: np.ndarray,
    ratio: np.ndarray,
    straight: np.ndarray,
    speeds: np.ndarray,
    velocity: np.ndarray,
    way: np.ndarray,
) -> np.ndarray:
    """W of each flight; of a vertex without a rebound from the flight before. `speeds` are those at
    the start and the end of each flight."""
    leaves = out_w.copy()  # W with which a boulder leaves each vertex
    for k in np.flatnonzero(ratio == 0)[1:]:  # the first is the release, without rotation
        if not straight[k - 1]:
            before = speeds[1, k - 1]
            leaves[k] = leaves[k - 1] * (speeds[0, k] / before if before else 0.0)
        elif _is_parallel(velocity[k], way[k - 1]):
            leaves[k] = speeds[0, k]
        else:  # the end of the slide of a contact by a table
            leaves[k] = leaves[k - 1]
    return np.where(straight, speeds[0], leaves)


def _is_parallel(a: np.ndarray, b: np.ndarray) -> bool:
    """Return True for vectors of one direction, or opposite ones; never for one of no length."""
    size = np.linalg.norm(a) * np.linalg.norm(b)
    return bool(np.linalg.norm(np.cross(a, b)) < PARALLEL * size)
