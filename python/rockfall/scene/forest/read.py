# SPDX-License-Identifier: BSD-3-Clause
"""Trees for the kernel: from a list, or generated from the density of a stand."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rockfall.scene.forest.listed import listed_trees
from rockfall.scene.forest.made import made_trees

if TYPE_CHECKING:
    from rockfall.scene.scene import Scene


def read_forest(scene: Scene, rasters: dict[str, Any]) -> None:
    """Read or generate the trees of the case, if it has any."""
    if "trees" in scene.case.forest:
        scene.trees = listed_trees(scene, rasters)
    elif scene.case.has_forest:
        scene.trees = made_trees(scene, rasters)
