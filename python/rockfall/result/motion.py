# SPDX-License-Identifier: BSD-3-Clause
"""Motion of recorded boulders between their vertices.

A boulder flies on a parabola. On the ground it follows the terrain, straight in plan at its mean
speed; if a contact takes longer, it waits at the end. A roll or slide begins at a rebound. The next
flight may begin above the last vertex, because the boulder rises during the contact.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import numpy as np

from rockfall.case import case_of
from rockfall.errors import RockfallError
from rockfall.result.variables import LEG

if TYPE_CHECKING:
    from rockfall.result.contents import Held

EXACT = 1e-6  # tolerance for equal positions [m] and times [s]
PARALLEL = 1e-9  # sine of the maximum angle between parallel directions
TOLERANCE = 0.05  # default tolerance of `sampled` [m]
_Kept = TypeVar("_Kept")
_NAMES = ("x", "y", "z", "time", "velocity_x", "velocity_y", "velocity_z")


class Motion(NamedTuple):
    """Motion segments (flights, ground legs, waits) of each boulder in chronological order. A
    boulder that never moved has a single segment of zero duration."""

    start: np.ndarray  # (4, n): x, y, z [m], time since release [s]
    end: np.ndarray  # (4, n)
    velocity: np.ndarray  # (3, n): at the start [m/s]
    gravity: np.ndarray  # (n): [m/s2]; 0 for straight and steady motion
    boulder: np.ndarray  # (n): boulder number
    vertex: np.ndarray  # (n): index, in the result, of the last contact, release or obstacle hit

    def take(self, pieces: Any) -> Motion:
        """Select segments by index or mask; None selects all and adds an axis."""
        return Motion(*(values[..., pieces] for values in self))

    def straightened(self) -> Motion:
        """Motion with straight ground legs, as the kernel traces lines and cells."""
        slides = (self.gravity == 0) & self.velocity.any(axis=0)
        joins = slides & np.roll(slides, 1) & (np.diff(self.vertex, prepend=-1) == 0)
        first = np.flatnonzero(~joins)
        last = np.append(first, joins.size)[1:] - 1
        return self.take(first)._replace(end=self.end[:, last])

    def at(self, part: float | np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """x, y, z [m], time [s] (4, ...) and speed [m/s] at a fraction (0 to 1) of each segment."""
        step = self.end - self.start
        fallen = self.gravity * step[3]  # g t at the end of the step
        place = self.start + part * step
        place[2] += 0.5 * fallen * step[3] * (part * (1 - part))
        x, y, z = self.velocity
        return np.where(part == 1, self.end, place), np.sqrt(x**2 + y**2 + (z - fallen * part) ** 2)


def spread(recorded: list[_Kept], number: int | None) -> list[_Kept]:
    """Select at most `number` (None: all) of the recorded trajectories, evenly spaced in their
    order, which is by source."""
    if number is None or len(recorded) <= number:
        return recorded
    return [recorded[k * len(recorded) // number] for k in range(number)]


def motion_of(result: Held, number: int | None = None, gravity: float | None = None) -> Motion:
    """Motion of the recorded boulders, or of at most `number` of them, evenly selected. The default
    gravity [m/s2] is that of the case."""
    if "trajectory_boulder" not in result:
        none = np.empty(0, int)
        return Motion(np.empty((4, 0)), np.empty((4, 0)), np.empty((3, 0)), none, none, none)
    boulder = result["trajectory_boulder"].values
    vertex = np.flatnonzero(np.isin(boulder, spread(np.unique(boulder).tolist(), number)))
    columns = np.stack([seconds(result[f"trajectory_{name}"].values[vertex]) for name in _NAMES])
    leg = result["trajectory_leg"].values[vertex]
    g = case_of(result).flight["gravity"] if gravity is None else gravity
    return _between(columns, boulder[vertex], vertex, leg, g)


def are_met(boulder: np.ndarray, leg: np.ndarray) -> np.ndarray:
    """Mask of vertices that are releases, contacts, hits or ends, not points on a ground leg."""
    straight, same = leg > LEG["flight"], np.diff(boulder, prepend=-1) == 0
    return ~(straight & np.roll(straight, 1) & same)


def _between(
    columns: np.ndarray, boulder: np.ndarray, vertex: np.ndarray, leg: np.ndarray, g: float
) -> Motion:
    """Motion between vertices, from `columns` in the order of _NAMES, which are overwritten."""
    start, velocity = columns[:4], columns[4:]
    begins, ends = np.diff(boulder, prepend=-1) != 0, np.diff(boulder, append=-1) != 0
    straight = leg > LEG["flight"]
    after_straight = np.roll(straight, 1) & ~begins
    end = np.where(ends, start, np.roll(start, -1, axis=1))
    step = end - start
    lift = step[2] - velocity[2] * step[3] + 0.5 * g * step[3] ** 2  # rise before a flight
    lifted = after_straight & ~straight & ~ends & (np.abs(lift) > EXACT)
    start[2, lifted] += lift[lifted]
    contact = np.maximum.accumulate(np.where(are_met(boulder, leg), np.arange(vertex.size), 0))
    moves = np.flatnonzero(begins | ~ends)
    return Motion(
        start[:, moves],
        end[:, moves],
        velocity[:, moves],
        np.where(straight, 0.0, g)[moves],
        boulder[moves],
        vertex[contact[moves]],
    )


def seconds(values: np.ndarray) -> np.ndarray:
    """Durations as numbers of seconds; other values are unchanged."""
    return values / np.timedelta64(1, "s") if values.dtype.kind == "m" else values


def spins(result: Held, motion: Motion) -> np.ndarray:
    """W = R_b omega [m/s] for each motion segment of the recorded boulders. On a roll or slide, W
    is the speed. At vertices without a rebound, W follows from the previous segment: a tree or
    barrier reduces W and speed by the same fraction."""
    vertex, first, indices = np.unique(motion.vertex, return_index=True, return_inverse=True)
    piece = motion.take(first)
    out_w, ratio = (result[f"trajectory_{name}"].values[vertex] for name in ("out_w", "ratio"))
    straight = piece.gravity == 0
    before, after = np.roll(piece.at(1.0)[1], 1), piece.at(0.0)[1]
    follows = (ratio == 0) & (np.diff(piece.boulder, prepend=-1) == 0)
    hit = follows & ~np.roll(straight, 1)
    rolled = follows & ~hit & _are_parallel(piece.velocity, np.roll(piece.velocity, 1, axis=1))
    leaves = np.where(rolled, after, out_w)  # W after each vertex
    kept = np.where(hit, after / np.where(before > 0, before, np.inf), 1.0)
    for k in np.flatnonzero(follows & ~rolled).tolist():
        leaves[k] = leaves[k - 1] * kept[k]
    return np.where(straight, after, leaves)[indices]


def _are_parallel(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """True for vectors (3, n) in equal or opposite directions; False for zero vectors."""
    size = np.linalg.norm(a, axis=0) * np.linalg.norm(b, axis=0)
    return np.linalg.norm(np.cross(a, b, axis=0), axis=0) < PARALLEL * size


class Sampled(NamedTuple):
    """Motion as chords: both ends of each segment, and parabolas sampled at equal time steps."""

    motion: Motion
    samples: np.ndarray  # (m, 4): x, y, z [m], time since release [s]
    piece: np.ndarray  # (m): index of the segment

    def strings(self, by: np.ndarray) -> list[np.ndarray]:
        """Samples (m, 4) of each group of segments with equal numbers in `by`, each point once."""
        group = by[self.piece]
        begins = np.diff(group, prepend=-1) != 0
        new = begins | np.append(True, (np.diff(self.samples, axis=0) != 0).any(axis=1))
        samples, cuts = self.samples[new], np.flatnonzero(begins[new])
        return [samples[a:b] for a, b in pairwise([*cuts.tolist(), len(samples)])]


def sampled(motion: Motion, tolerance: float = TOLERANCE) -> Sampled:
    """Sample motion so that chords deviate from parabolas by at most `tolerance` [m], which must be
    > 0.

    A chord over h seconds deviates by at most g h^2/8, in space and, if followed at constant
    speed, at any time.
    """
    if not 0 < tolerance < np.inf:
        raise RockfallError(f"--tolerance {tolerance:g}: must be > 0 [m]")
    sag = motion.gravity * (motion.end[3] - motion.start[3]) ** 2 / 8
    parts = np.maximum(1, np.ceil(np.sqrt(sag / tolerance))).astype(np.int64)
    piece = np.repeat(np.arange(parts.size), parts + 1)
    number = np.arange(piece.size) - np.repeat(np.cumsum(parts + 1) - (parts + 1), parts + 1)
    places, _ = motion.take(piece).at(number / parts[piece])
    return Sampled(motion, places.T, piece)
