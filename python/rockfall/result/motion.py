# SPDX-License-Identifier: BSD-3-Clause
"""Motion of recorded boulders between their vertices, as the kernel follows it to lines and cells.

A boulder flies on a parabola, or, while it rolls or slides on the ground, goes straight at its mean
speed; where a slide takes longer than that, it waits at the end of it. A roll or slide begins at a
rebound; the flight after it begins above its last vertex, by what the boulder rose in the contact.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import numpy as np

from rockfall.case import case_of
from rockfall.errors import RockfallError

if TYPE_CHECKING:
    from rockfall.result.contents import Held

EXACT = 1e-6  # distance [m] and time [s] up to which places and times are the same
PARALLEL = 1e-9  # sine of the angle between directions that are the same
TOLERANCE = 0.05  # [m]
_Kept = TypeVar("_Kept")
_NAMES = ("x", "y", "z", "time", "velocity_x", "velocity_y", "velocity_z", "ratio")


class Motion(NamedTuple):
    """Flights, rolls, slides and waits, in order of time for each boulder. One that never moved has
    one piece, without duration."""

    start: np.ndarray  # (4, n) x, y, z [m], time since release [s]
    end: np.ndarray  # (4, n)
    velocity: np.ndarray  # (3, n) at the start [m/s]
    gravity: np.ndarray  # (n) [m/s2]; 0: straight and steady
    boulder: np.ndarray  # (n) number
    vertex: np.ndarray  # (n) index, in the result, of the last vertex

    def take(self, pieces: Any) -> Motion:
        """Pieces of an index or mask; for None, all of them with an axis for several parts."""
        return Motion(*(values[..., pieces] for values in self))

    def at(self, part: float | np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """x, y, z [m] and time [s] (4, ...), and speed [m/s], after a part of the duration of each
        piece (0 to 1)."""
        step = self.end - self.start
        fallen = self.gravity * step[3]  # g t at the end
        place = self.start + part * step
        place[2] += 0.5 * fallen * step[3] * (part * (1 - part))
        x, y, z = self.velocity
        return np.where(part == 1, self.end, place), np.sqrt(x**2 + y**2 + (z - fallen * part) ** 2)


def spread(recorded: list[_Kept], number: int | None) -> list[_Kept]:
    """Evenly select at most `number` of the recorded trajectories, which are ordered by source."""
    if number is None or len(recorded) <= number:
        return recorded
    return [recorded[k * len(recorded) // number] for k in range(number)]


def motion_of(result: Held, number: int | None = None, gravity: float | None = None) -> Motion:
    """Motion of the recorded boulders, or of at most `number` of them, evenly selected. Gravity
    [m/s2] is that of the case, unless given."""
    if "trajectory_boulder" not in result:
        none = np.empty(0, int)
        return Motion(np.empty((4, 0)), np.empty((4, 0)), np.empty((3, 0)), none, none, none)
    boulder = result["trajectory_boulder"].values
    vertex = np.flatnonzero(np.isin(boulder, spread(np.unique(boulder).tolist(), number)))
    columns = np.stack([seconds(result[f"trajectory_{name}"].values[vertex]) for name in _NAMES])
    g = case_of(result).flight["gravity"] if gravity is None else gravity
    return _between(columns, boulder[vertex], vertex, g)


def _between(columns: np.ndarray, boulder: np.ndarray, vertex: np.ndarray, g: float) -> Motion:
    """Motion between vertices of which `columns` are _NAMES; changes them."""
    start, velocity, rebounds = columns[:4], columns[4:7], columns[7] != 0
    begins, ends = np.diff(boulder, prepend=-1) != 0, np.diff(boulder, append=-1) != 0
    end = np.where(ends, start, np.roll(start, -1, axis=1))
    step = end - start
    duration, plan_speed = step[3], np.hypot(*velocity[:2])
    steady = duration.copy()  # of the step in plan, at the velocity at its start
    np.divide(np.hypot(*step[:2]), plan_speed, out=steady, where=plan_speed > 0)
    off = step[:3] - velocity * steady
    lift = step[2] - velocity[2] * duration + 0.5 * g * duration**2  # before a flight
    # A slide that an obstacle ends is shorter, and ends on the ground, above or below its path.
    cut = (duration - steady <= EXACT) & (np.abs(lift) > EXACT)
    straight = rebounds & (np.hypot(*off[:2]) <= EXACT) & (cut | (np.abs(off[2]) <= np.abs(lift)))
    lifted = ~begins & ~rebounds & ~ends & np.roll(straight, 1) & (np.abs(lift) > EXACT)
    start[2, lifted] += lift[lifted]
    waits = np.flatnonzero(straight & (duration - steady > EXACT))
    arrival = end.copy()
    arrival[3, waits] = start[3, waits] + steady[waits]
    moves = np.flatnonzero(begins | ~ends)
    stands = np.repeat([False, True], [moves.size, waits.size])
    moves_of = np.append(moves, waits)
    return Motion(
        np.where(stands, arrival[:, moves_of], start[:, moves_of]),
        np.where(stands, end[:, moves_of], arrival[:, moves_of]),
        np.where(stands, 0.0, velocity[:, moves_of]),
        np.where(stands | straight[moves_of], 0.0, g),
        boulder[moves_of],
        vertex[moves_of],
    ).take(np.argsort(moves_of, kind="stable"))


def seconds(values: np.ndarray) -> np.ndarray:
    """Values with durations as numbers of seconds."""
    return values / np.timedelta64(1, "s") if values.dtype.kind == "m" else values


def spins(result: Held, motion: Motion) -> np.ndarray:
    """W = R_b omega [m/s] of each piece of all motion of a result. That of a roll or slide is its
    speed; at vertices without a rebound it follows from the piece before: at a hit of a tree or
    barrier a boulder loses as large a part of W as of the speed."""
    vertex, first, indices = np.unique(motion.vertex, return_index=True, return_inverse=True)
    piece = motion.take(first)
    out_w, ratio = (result[f"trajectory_{name}"].values[vertex] for name in ("out_w", "ratio"))
    straight, way = piece.gravity == 0, piece.end[:3] - piece.start[:3]
    before, after = np.roll(piece.at(1.0)[1], 1), piece.at(0.0)[1]
    follows = (ratio == 0) & (np.diff(piece.boulder, prepend=-1) == 0)
    hit = follows & ~np.roll(straight, 1)
    rolled = follows & ~hit & _are_parallel(piece.velocity, np.roll(way, 1, axis=1))
    leaves = np.where(rolled, after, out_w)  # W with which a boulder leaves each vertex
    kept = np.where(hit, after / np.where(before > 0, before, np.inf), 1.0)
    for k in np.flatnonzero(follows & ~rolled).tolist():
        leaves[k] = leaves[k - 1] * kept[k]
    return np.where(straight, after, leaves)[indices]


def _are_parallel(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """True for vectors (3, n) of one direction, or opposite ones; never for one of no length."""
    size = np.linalg.norm(a, axis=0) * np.linalg.norm(b, axis=0)
    return np.linalg.norm(np.cross(a, b, axis=0), axis=0) < PARALLEL * size


class Sampled(NamedTuple):
    """Motion as chords: each piece with both its ends, and parabolas between at equal times."""

    motion: Motion
    samples: np.ndarray  # (m, 4) x, y, z [m], time since release [s]
    piece: np.ndarray  # (m) index of its piece

    def strings(self, by: np.ndarray) -> list[np.ndarray]:
        """Samples (m, 4) of pieces that share a number `by`, each place and time once."""
        group = by[self.piece]
        begins = np.diff(group, prepend=-1) != 0
        new = begins | np.append(True, (np.diff(self.samples, axis=0) != 0).any(axis=1))
        samples, cuts = self.samples[new], np.flatnonzero(begins[new])
        return [samples[a:b] for a, b in pairwise([*cuts.tolist(), len(samples)])]


def sampled(motion: Motion, tolerance: float = TOLERANCE) -> Sampled:
    """Sample motion so that chords leave no parabola by more than `tolerance` [m].

    A parabola leaves the chord of a part that takes h seconds by at most g h^2/8, in space and,
    when the chord is followed at a constant speed, at any time.
    """
    if not 0 < tolerance < np.inf:
        raise RockfallError(f"--tolerance {tolerance:g}: must be > 0 [m]")
    sag = motion.gravity * (motion.end[3] - motion.start[3]) ** 2 / 8
    parts = np.maximum(1, np.ceil(np.sqrt(sag / tolerance))).astype(np.int64)
    piece = np.repeat(np.arange(parts.size), parts + 1)
    number = np.arange(piece.size) - np.repeat(np.cumsum(parts + 1) - (parts + 1), parts + 1)
    places, _ = motion.take(piece).at(number / parts[piece])
    return Sampled(motion, places.T, piece)
