# SPDX-License-Identifier: BSD-3-Clause
"""Trajectory files of RAMMS::ROCKFALL (.rts, .pts).

The layout is our reading of such files, not confirmed by their maker: float64, little-endian; a
header of 4 numbers, then records of 26: time, x, y, z, quaternion (4), velocity (3), angular
velocity (3), ..., kinetic energy, ..., height of the terrain. Where time falls back to that of the
first record, the next trajectory begins.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from rockfall.errors import RockfallError
from rockfall.io.gdal_files import plain_file
from rockfall.limits import MAX_ELEVATION, MAX_REAL

ENDINGS = (".rts", ".pts")
HEADER, RECORD = 4, 26  # numbers
NORM = 0.01  # maximum difference of the norm of a quaternion from 1
_TIME, _ENERGY, _TERRAIN = 0, 15, 18
_POSITION, _QUATERNION, _VELOCITY = slice(1, 4), slice(4, 8), slice(8, 11)


class Recorded(NamedTuple):
    """Records of a trajectory, from release on."""

    where: str  # file and number of the trajectory, for messages
    time: np.ndarray  # [s]
    position: np.ndarray  # (n, 3) [m]
    velocity: np.ndarray  # (n, 3) [m/s]
    energy: np.ndarray  # kinetic, in the unit of the file
    terrain: np.ndarray  # elevation below the boulder [m]


def is_trajectory_file(path: str | Path) -> bool:
    """Return True if the name is that of a trajectory file."""
    return Path(path).suffix.lower() in ENDINGS


def read_trajectories(path: str | Path) -> list[Recorded]:
    """Read the trajectories of a file; a RockfallError names the record that is not as it must be.

    >>> [len(one.time) for one in read_trajectories("block.rts")]
    [812]
    """
    size = Path(plain_file(path)).stat().st_size
    count, rest = divmod(size - 8 * HEADER, 8 * RECORD)
    if count < 2 or rest:
        raise RockfallError(
            f"{path}: {size:,} bytes: must be a header of {HEADER} numbers of 8 bytes and two or "
            f"more records of {RECORD}"
        )
    numbers = np.fromfile(path, "<f8")
    if numbers.size != HEADER + count * RECORD:
        raise RockfallError(f"{path}: changed while it was read")
    records = numbers[HEADER:].reshape(count, RECORD).astype(float)
    _check(path, records)
    time = records[:, _TIME]
    starts = np.flatnonzero(np.diff(time) < 0) + 1
    for start in starts[time[starts] != time[0]]:
        raise RockfallError(
            f"{path}: record {start + 1}: time = {time[start]:g}: must be >= "
            f"{time[start - 1]:g}, that of the record before, or {time[0]:g}, a new start"
        )
    trajectories = []
    for number, rows in enumerate(np.split(records, starts), start=1):
        where = f"{path}: trajectory {number}"
        if len(rows) < 2:
            raise RockfallError(f"{where}: one record: must have two or more")
        trajectories.append(Recorded(where, rows[:, _TIME], rows[:, _POSITION], rows[:, _VELOCITY],
                                     rows[:, _ENERGY], rows[:, _TERRAIN]))  # fmt: skip
    return trajectories


def _check(path: str | Path, records: np.ndarray) -> None:
    """Refuse records that do not hold what the layout says."""
    norms = np.linalg.norm(records[:, _QUATERNION], axis=1)
    far, heights = abs(records[:, 1:3]).max(axis=1), abs(records[:, (3, _TERRAIN)]).max(axis=1)
    energy = records[:, _ENERGY]
    for good, values, what in (
        (np.isfinite(records).all(axis=1), None, "a number is not finite"),
        (records[:, _TIME] >= 0, records[:, _TIME], "time = {:g}: must be >= 0"),
        (far <= MAX_REAL, far, f"x or y = {{:g}}: must be within {MAX_REAL:g}"),
        (heights <= MAX_ELEVATION, heights, f"elevation {{:g}}: must be within {MAX_ELEVATION:g}"),
        (abs(norms - 1) <= NORM, norms, "norm of the quaternion = {:g}: must be 1"),
        (energy >= 0, energy, "kinetic energy = {:g}: must be >= 0"),
    ):
        for k in np.flatnonzero(~good)[:1]:
            reason = what if values is None else what.format(values[k])
            raise RockfallError(f"{path}: record {k + 1}: {reason}")
