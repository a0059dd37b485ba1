# SPDX-License-Identifier: BSD-3-Clause
"""Trees of a scene, listed or generated, and thinned."""

import numpy as np

from rockfall.scene.forest.listed import listed_trees
from rockfall.scene.forest.made import made_trees
from rockfall.scene.forest.stands import Stands
from rockfall.scene.forest.thinning import thinned
from rockfall.scene.forest.trees import Planted, Stand, Trees
from rockfall.scene.layers import Inputs, take_inputs
from rockfall.scene.stages import FRESH, Stages


def read_forest(
    inputs: Inputs, x: np.ndarray, y: np.ndarray, stages: Stages = FRESH
) -> tuple[Trees | None, tuple[Stand, ...]]:
    """Trees and stands of a case whose sources are at `x`, `y` [m]; (None, ()) without trees."""
    if not inputs.case.has_forest:
        return None, ()
    planted, stands = take_inputs(stages, "planted", inputs, (), _planted)
    sources = (x, y) if inputs.case.forest["clear_of_sources"] > 0 else ()
    left = take_inputs(
        stages, "thinned", inputs, (planted, *sources),
        lambda inputs: thinned(inputs, planted, x, y),
    )  # fmt: skip
    records = () if stands is None or left.stand is None else stands.records(left.stand)
    return left.trees, records


def _planted(inputs: Inputs) -> tuple[Planted, Stands | None]:
    """Trees before thinning, and their stands, if any."""
    if "trees" in inputs.case.forest:
        return listed_trees(inputs), None
    return made_trees(inputs)
