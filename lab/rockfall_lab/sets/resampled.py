# SPDX-License-Identifier: BSD-3-Clause
"""Rebounds on a plane from resampled impacts, for comparison with a set."""

import numpy as np
from scipy.spatial import cKDTree

from rockfall.analysis.planes.plane_bounce import Rebound, speed_of
from rockfall.scene.rebounds.kernel_rebounds import limited

NEAREST = 20  # number of impacts to draw from


def resampled_rebound(v_in: np.ndarray, v_out: np.ndarray) -> Rebound:
    """Return a rebound that draws from the impacts nearest in angle and spin, scaled to the speed.

    The least-squares map of all impacts transforms an impact from its own incidence to that of the
    boulder. Without this, angles and spins would be smeared, and boulders would lose about 0.02
    more of their speed per bounce.
    """
    tree = cKDTree(_place(v_in))
    x, ratio = v_in / speed_of(v_in)[:, None], v_out / speed_of(v_in)[:, None]
    slope = np.linalg.lstsq(x, ratio, rcond=None)[0]

    def rebound(now: np.ndarray, generator: np.random.Generator) -> np.ndarray:
        _, near = tree.query(_place(now), k=min(NEAREST, len(ratio)))
        pick = near[np.arange(len(now)), generator.integers(0, near.shape[1], len(now))]
        speed = speed_of(now)[:, None]
        return limited(now, ratio[pick] * speed + (now - x[pick] * speed) @ slope)

    return rebound


def _place(v: np.ndarray) -> np.ndarray:
    """Angle and spin (n, 2) of impacts, scaled to comparable distances."""
    angle = np.arctan2(-v[:, 1], v[:, 0])
    return np.stack([np.log(np.maximum(angle, 1e-3)), 1.5 * v[:, 2] / speed_of(v)], axis=1)
