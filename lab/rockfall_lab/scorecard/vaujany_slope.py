# SPDX-License-Identifier: BSD-3-Clause
"""Stand-in for the experimental slope of Bourrier et al. (2009), whose terrain model was never
published: a talus slope with a channel, roads and a valley floor, as the paper describes it.

Properties not given in the paper are fields of `Talus`, so that a calibration can vary them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rockfall.terrain.synthetic import relief

CELL, NX, NY = 2.5, 80, 240  # [m]: 200 m across the slope, 600 m down it
WEST, NORTH = 0.0, 600.0  # [m]: outer edges of the upper left cell
BENDS = [0, 20, 330, 400, 460, 520, 600]  # plan distance from the top edge [m]
ROADS = {14: (90, 4.0), 4: (295, 4.5), 10: (450, 5.0)}  # zone id: (plan distance, width) [m]


@dataclass(frozen=True)
class Talus:
    """Unknown properties of the slope."""

    seed: int = 20090601  # seed of the relief
    relief: float = 0.3  # standard deviation of the relief [m]
    channel: float = 2.0  # depth of the channel [m]
    roads: float = 0.9  # fraction of the fall across a road that the road levels
    angle: float = 38.0  # slope of the talus [degree]

    def natural(self, s: np.ndarray) -> np.ndarray:
        """Elevation [m] along the slope at plan distance `s` [m] from its top, without roads."""
        step = 0.01
        middle = np.arange(0, 600, step) + step / 2
        angle = np.interp(middle, BENDS, [self.angle] * 3 + [30, 18, 2, 0])
        fall = np.cumsum(step * np.tan(np.radians(angle)))
        return 1400 - np.interp(s, np.append(0, middle + step / 2), np.append(0, fall))

    def profile(self, s: np.ndarray) -> np.ndarray:
        """Elevation [m] at plan distance `s` [m] with roads: benches, cut into the slope above
        their axis and filled below."""
        z = self.natural(s)
        for axis, width in ROADS.values():
            level = self.natural(np.array(axis))
            z = np.where(np.abs(s - axis) < width / 2, level + (1 - self.roads) * (z - level), z)
        return z

    def elevation(self) -> np.ndarray:
        """Elevation (NY, NX), northern row first [m]."""
        s, off_axis = _place()
        depth = np.interp(s, [0, 30, 250, 330], [self.channel / 4, self.channel, self.channel, 0])
        z = (
            self.profile(s)
            - depth * np.exp(-((off_axis / 4) ** 2))
            + relief(self.seed, (NY, NX), self.relief)
        )
        return z.astype("f4")


def zones() -> np.ndarray:
    """Zone ids of table 1, (NY, NX), northern row first."""
    s, off_axis = _place()
    x = CELL * (np.arange(NX) + 0.5)[None, :]
    ids = np.full((NY, NX), 3)  # talus
    ids[np.abs(off_axis) <= 5] = 1  # channel
    for begin, zone in (300, 5), (470, 11), (540, 12):  # rougher talus, soils, fine soils
        ids[s[:, 0] > begin] = zone
    for zone, (axis, width) in ROADS.items():
        ids[np.abs(s[:, 0] - axis) < width / 2] = zone
    ids[np.abs(s - (568 + 5 * np.sin(x / 25))) < 4] = 2  # river, 8 m wide
    return ids.astype("u1")


def _place() -> tuple[np.ndarray, np.ndarray]:
    """Plan distance from the top edge (NY, 1) and from the channel's axis (NY, NX) [m]."""
    s = (CELL * (np.arange(NY) + 0.5))[:, None]
    x = CELL * (np.arange(NX) + 0.5)[None, :]
    return s, x - (100 + 8 * np.sin(s / 90))
