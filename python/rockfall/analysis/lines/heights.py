# SPDX-License-Identifier: BSD-3-Clause
"""How high boulders pass: of the centre and of the upper edge, vertical and normal to the slope."""

from __future__ import annotations

import numpy as np

from rockfall.scene.rebound import sphere_radius

HEIGHTS = ("upper_edge", "normal_height", "normal_upper_edge")


def height(name: str, jump: np.ndarray, passing: np.ndarray, volume: np.ndarray) -> np.ndarray:
    """One of `HEIGHTS` [m], of jump heights and passing heights (of the centre, vertical) [m] of
    boulders of these volumes [m3].

    A boulder that touches the ground has its centre R / cos(slope) above it, vertically, and R
    normal to it; so has one that flies, above the place of its jump height.
    """
    radius = sphere_radius(volume)
    if name == "upper_edge":
        return passing + radius
    normal = jump * np.minimum(1.0, radius / (passing - jump)) + radius
    return normal + radius if name == "normal_upper_edge" else normal
