# SPDX-License-Identifier: BSD-3-Clause
"""Sources from the terrain: steep cells, and how many boulders each source releases by its area."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from rockfall._core import rockfall_f2py as _core
from rockfall.errors import RockfallError

if TYPE_CHECKING:
    from rockfall.scene.scene import Scene


def threshold(scene: Scene) -> float:
    """The slope from which cells are steep [degree]: the case's, or the usual one of its cells."""
    usual = _core.slope_threshold(scene.grid.cell)
    return scene.case.release.get("slope_threshold", usual)


def steep_blocks(
    scene: Scene, blocks: Iterable[tuple[slice, np.ndarray]]
) -> Iterator[tuple[slice, np.ndarray]]:
    """Blocks of rows of possible source cells (above zero), less those that are not steep."""
    about = {"cell": scene.grid.cell, "threshold": threshold(scene), **_elevations(scene)}
    for rows, block in blocks:
        cells = np.asfortranarray((block > 0).T, np.int16)
        _core.steep_cells(**about, first=rows.start + 1, cells=cells)
        yield rows, cells.T


def area_ratios(scene: Scene) -> np.ndarray:
    """Surface over plan area of the cell of each source (Horn 1981)."""
    grid = scene.grid
    place = {"west": grid.west, "north": grid.north, "cell": grid.cell}
    return _core.area_ratios(**_elevations(scene), **place, source_x=scene.x, source_y=scene.y)


def refuse_by_area(scene: Scene, what: str) -> None:
    """Refuse what needs the same number of boulders from each source."""
    if scene.case.release["by_area"]:
        raise RockfallError(
            f"{scene.case.name}: &release by_area = .true.: {what} needs as many boulders from "
            "each source"
        )


def _elevations(scene: Scene) -> dict[str, Any]:
    arguments = scene.kernel_arguments()
    return {name: arguments[name] for name in ("z8", "z4", "nodes", "at")}
