# SPDX-License-Identifier: BSD-3-Clause
"""Recorded trajectories as curves; evaluation lines; distances and ends of boulders."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rockfall.io.rasters.grid import Grid
from rockfall.result.motion import Motion, motion_of
from rockfall.result.variables import STATUS

if TYPE_CHECKING:
    import xarray as xr
    from numpy.typing import ArrayLike

    from rockfall.result.contents import Held, HeldVariable

Terrain = tuple[np.ndarray, Grid]  # elevations (ny, nx) [m], and grid

POINTS = 25  # points of each motion segment
MOVING = "left_domain", "hit_nodata", "impact_limit"  # statuses of boulders that are not at rest


class Trajectory(NamedTuple):
    """A smooth curve: coordinates, plan distance from the start [m], speed [m/s], time [s]."""

    x: np.ndarray
    y: np.ndarray
    z: np.ndarray
    distance: np.ndarray
    speed: np.ndarray
    time: np.ndarray
    boulder: int  # boulder number
    gravity: np.ndarray  # [m/s2] in flight; 0 on the ground and at rest


def vertices_of(result: Held, *names: str) -> list[np.ndarray]:
    """Variables trajectory_NAME as an array (names, vertices) for each recorded trajectory."""
    if "trajectory_boulder" not in result:
        return []
    cuts = np.flatnonzero(np.diff(result["trajectory_boulder"].values)) + 1
    columns = np.stack([result[f"trajectory_{name}"].values for name in names])
    return np.split(columns, cuts, axis=1)


def trajectories(result: Held, number: int | None = None) -> list[Trajectory]:
    """Return the recorded trajectories, or at most `number` evenly selected, as curves with
    parabolas between contacts.

    The velocity after a contact, the time and gravity define a parabola. Boulders roll and slide
    along the terrain at their mean speed; at rest the speed is 0. `&output trajectories` defines
    which trajectories are recorded. A trajectory is a named tuple of arrays x, y, z, distance [m],
    speed [m/s] and time [s], the boulder number, and gravity [m/s2] (0 on the ground and at rest).

    >>> import rockfall
    >>> case = rockfall.read_case("case.nml").replace(output={"trajectories": 3})
    >>> path, *others = rockfall.trajectories(rockfall.run(case))
    >>> path.x.shape == path.speed.shape, len(others)
    (True, 2)
    """
    return curves(motion_of(result, number))


def curves(motion: Motion) -> list[Trajectory]:
    """Curve for each boulder: `POINTS` points per motion segment, or one if it never moved."""
    # Where the ground falls away after a contact from a table, the slide has neither length nor
    # duration.
    motion = motion.take((motion.gravity > 0) | (motion.end[3] > motion.start[3]))
    (x, y, z, time), speed = motion.take(None).at(np.linspace(0, 1, POINTS))
    numbers, first, size = np.unique(motion.boulder, return_index=True, return_counts=True)
    start = np.repeat(motion.start[:2, first], size, axis=1)[..., None]
    distance = np.hypot(x - start[0], y - start[1])
    columns = [values.ravel() for values in (x, y, z, distance, speed, time)]
    gravity = np.repeat(motion.gravity, POINTS)
    still = (motion.start == motion.end)[:, first].all(axis=0)
    points = np.where(still & (size == 1), 1, POINTS * size)
    return [
        Trajectory._make([*(values[k : k + n] for values in columns), number, gravity[k : k + n]])
        for number, k, n in zip(numbers.tolist(), POINTS * first, points, strict=True)
    ]


def lines(result: xr.Dataset) -> list[tuple[str, np.ndarray, np.ndarray]]:
    """Name, x and y of each evaluation line."""
    if "line_vertex_line" not in result:
        return []
    owner = result["line_vertex_line"].values
    x, y = result["line_vertex_x"].values, result["line_vertex_y"].values
    names = result["line_name"].values
    return [(str(name), x[owner == k], y[owner == k]) for k, name in enumerate(names)]


def from_start(
    result: xr.Dataset, x: np.ndarray, y: np.ndarray, boulders: np.ndarray | slice = slice(None)
) -> np.ndarray:
    """Plan distance [m] from the start of each boulder (or of selected boulders) to its x, y."""
    start_x, start_y = (result[f"start_{axis}"].values[boulders] for axis in "xy")
    return np.hypot(x - start_x, y - start_y)


def stop_distances(result: xr.Dataset) -> np.ndarray:
    """Plan distance [m] from the start to the end of each boulder."""
    return from_start(result, result["stop_x"].values, result["stop_y"].values)


def ends(result: Held) -> dict[str, np.ndarray]:
    """Mask of boulders with each status, by name."""
    status = result["status"]
    return {name: status.values == flag for name, flag in flags_of(status).items()}


def ended(result: Held) -> dict[str, int]:
    """Number of boulders with each status, by name, with or without rows."""
    if "sample_ended" in result:
        return dict(zip(ends(result), result["sample_ended"].values.tolist(), strict=True))
    return {name: int(marked.sum()) for name, marked in ends(result).items()}


def gone(result: Held) -> int:
    """Number of boulders that left the known terrain; see `left_terrain`."""
    end = ended(result)
    return end["left_domain"] + end["hit_nodata"]


def left_terrain(result: xr.Dataset) -> np.ndarray:
    """Mask of boulders that left the known terrain; their full distance is unknown."""
    ended = ends(result)
    return ended["left_domain"] | ended["hit_nodata"]


def ended_moving(values: Held | Mapping[str, ArrayLike]) -> np.ndarray:
    """Mask of boulders not at rest: they left the terrain, or reached the impact limit."""
    return np.isin(np.asarray(values["status"]), [STATUS[name] for name in MOVING])


def flags_of(variable: HeldVariable) -> dict[str, int]:
    """Numbers of a CF flag variable by name."""
    values = np.atleast_1d(variable.attrs["flag_values"]).tolist()
    return dict(zip(variable.attrs["flag_meanings"].split(), values, strict=True))
