# SPDX-License-Identifier: BSD-3-Clause
"""Recorded trajectories in space and time: parabolas sampled within a tolerance.

A parabola leaves the chord of a part that takes h seconds by at most g h^2/8, in space and, when
the chord is followed at a constant speed, at any time; so the vertices of a flight, which are at
equal times, are as many as keep this below the tolerance.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rockfall.errors import RockfallError

if TYPE_CHECKING:
    import xarray as xr

EPOCH = np.datetime64("2000-01-01T00:00:00.000", "ms")  # release of all boulders, in time stamps
TOLERANCE = 0.05  # [m]
STRAIGHT = 1e-6  # difference [m] of a flight in plan from its velocity times its duration
_NAMES = ("x", "y", "z", "time", "velocity_x", "velocity_y", "velocity_z")
_LINE_ZM = 3002  # ISO/IEC 13249-3, well-known binary


class Flights(NamedTuple):
    """Sampled trajectories, by increasing number of the boulder. Contact k begins at sample
    `first[k]`; the last contact of a boulder is its end."""

    samples: np.ndarray  # (n, 4) x, y, z [m], time since release [s]
    first: np.ndarray  # (contacts + 1) sample of each contact, and n
    boulder: np.ndarray  # (contacts) number
    velocity: np.ndarray  # (contacts, 3) after the contact [m/s]
    falls: np.ndarray  # (contacts) -g t^2/2 of the flight that starts there [m]; 0: a roll
    ends: np.ndarray  # (contacts) True at the last contact of a boulder

    @property
    def boulders(self) -> np.ndarray:
        """Numbers of the boulders."""
        return self.boulder[self.ends]

    def paths(self) -> list[np.ndarray]:
        """Samples of each boulder, from release to rest."""
        return np.split(self.samples, self.first[1:][self.ends][:-1])

    @property
    def starts(self) -> np.ndarray:
        """Contacts from which a boulder moves on, by a flight or a roll that takes time."""
        time = self.samples[self.first[:-1], 3]
        return np.flatnonzero(~self.ends & (np.append(time[1:], 0.0) > time))

    def pieces(self) -> list[np.ndarray]:
        """Samples from each of `starts` to the next contact, both included."""
        return [self.samples[self.first[k] : self.first[k + 1] + 1] for k in self.starts]


def flights_of(result: xr.Dataset, tolerance: float = TOLERANCE) -> Flights:
    """Sample the recorded trajectories so that chords leave no parabola by more than `tolerance`
    [m]. What a boulder rolls is straight from contact to contact."""
    if not 0 < tolerance < np.inf:
        raise RockfallError(f"--tolerance {tolerance:g}: must be > 0 [m]")
    boulder = result["trajectory_boulder"].values
    order = np.argsort(boulder, kind="stable")
    boulder = boulder[order]
    columns = [_numbers(result[f"trajectory_{name}"].values)[order] for name in _NAMES]
    place, velocity = np.column_stack(columns[:4]), np.column_stack(columns[4:])
    ends = np.append(boulder[1:] != boulder[:-1], True)
    step = np.where(ends[:, None], 0.0, np.roll(place, -1, axis=0) - place)
    fall = _falls(step, velocity)
    parts = np.maximum(1, np.ceil(np.sqrt(np.abs(fall) / (4 * tolerance)))).astype(np.int64)
    first = np.append(0, np.cumsum(parts))
    contact = np.repeat(np.arange(boulder.size), parts)
    part = ((np.arange(first[-1]) - first[contact]) / parts[contact])[:, None]
    samples = place[contact] + part * step[contact]
    samples[:, 2] -= fall[contact] * (part * (1 - part))[:, 0]
    return Flights(samples, first, boulder, velocity, fall, ends)


def _falls(step: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """Height [m] by which each flight ends off its first tangent, -g t^2/2; zero for a roll."""
    off = step[:, :3] - velocity * step[:, 3:]
    flies = (np.abs(off[:, :2]) <= STRAIGHT).all(axis=1) & (off[:, 2] < 0)
    return np.where(flies, off[:, 2], 0.0)


def _numbers(values: np.ndarray) -> np.ndarray:
    """Values as float64, durations in seconds."""
    return (values / np.timedelta64(1, "s") if values.dtype.kind == "m" else values).astype(float)


def lines_zm(paths: list[np.ndarray]) -> np.ndarray:
    """Line strings of samples (n, 4) as well-known binary, time as measure M; a single sample
    becomes a string of zero length. (shapely makes no measures.)"""
    lines = np.empty(len(paths), object)
    for k, path in enumerate(paths):
        path = np.ascontiguousarray(path if len(path) > 1 else np.repeat(path, 2, axis=0), "<f8")
        lines[k] = struct.pack("<BII", 1, _LINE_ZM, len(path)) + path.tobytes()
    return lines


def trajectory_features(flights: Flights) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Trajectories as LineString ZM, with the number of contacts and the travel time [s]."""
    last = np.flatnonzero(flights.ends)
    contacts = np.diff(last, prepend=-1)
    return lines_zm(flights.paths()), {
        "boulder": flights.boulders.astype(np.int64),
        "vertices": contacts.astype(np.int64),
        "travel_time": flights.samples[flights.first[last], 3],
    }


def flight_features(flights: Flights) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Flights and rolls as LineString ZM: the contact of the boulder that starts it, counted from
    1, time stamps from `EPOCH`, and the speeds [m/s] after that contact and before the next."""
    starts = flights.starts
    begin, end = (flights.samples[flights.first[k], 3] for k in (starts, starts + 1))
    velocity = flights.velocity[starts]
    faster = 2 * flights.falls[starts] / (end - begin)  # -g t
    before_next = velocity + faster[:, None] * (0.0, 0.0, 1.0)
    contact = starts - np.searchsorted(flights.boulder, flights.boulder[starts]) + 1
    return lines_zm(flights.pieces()), {
        "boulder": flights.boulder[starts].astype(np.int64),
        "contact": contact.astype(np.int64),
        "begin": time_stamps(begin),
        "end": time_stamps(end),
        "speed_m_s": np.linalg.norm(velocity, axis=1),
        "speed_end_m_s": np.linalg.norm(before_next, axis=1),
    }


def time_stamps(seconds: np.ndarray) -> np.ndarray:
    """Times since release as time stamps, to the millisecond."""
    return EPOCH + np.rint(1000 * seconds).astype("m8[ms]")
