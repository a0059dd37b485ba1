# SPDX-License-Identifier: BSD-3-Clause
"""Trees of a scene: listed or generated, and what thinnings leave of them."""

from __future__ import annotations

import numpy as np

from rockfall.scene.forest.listed import listed_trees
from rockfall.scene.forest.made import made_trees
from rockfall.scene.forest.thinning import thinned
from rockfall.scene.forest.trees import Stand, Trees
from rockfall.scene.layers import Inputs


def read_forest(
    inputs: Inputs, x: np.ndarray, y: np.ndarray
) -> tuple[Trees | None, tuple[Stand, ...]]:
    """Trees of a case with sources at `x`, `y`, and its stands; None and empty without them."""
    if not inputs.case.has_forest:
        return None, ()
    if "trees" in inputs.case.forest:
        return thinned(inputs, listed_trees(inputs), x, y).trees, ()
    planted, stands = made_trees(inputs)
    left = thinned(inputs, planted, x, y)
    return left.trees, () if stands is None or left.stand is None else stands.records(left.stand)
