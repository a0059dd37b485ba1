# SPDX-License-Identifier: BSD-3-Clause
"""Trees made of what is known of a stand: stems a hectare, their diameters, the share of conifers.

A tree is a function of the seed of the forest and of its cell: neither threads nor blocks of rows
change it. Diameters follow a gamma distribution, by inversion. SciPy may choose other last bits
elsewhere: they are rounded to a tenth of a millimetre.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rockfall._core import rockfall_f2py as _core
from rockfall.errors import RockfallError
from rockfall.io.grid import row_blocks
from rockfall.scene.forest.species import BROADLEAF, CONIFER, read_species
from rockfall.scene.forest.trees import HECTARE, MAX_DBH, Trees
from rockfall.scene.layers import layer_blocks

if TYPE_CHECKING:
    from rockfall.scene.scene import Scene

MAX_DENSITY = 1e6  # stems a hectare
MAX_STEMS = 1e8  # of a forest
DECIMALS = 2  # of a diameter [cm]


class Cells(NamedTuple):
    """Where trees stand on the raster: sorted rows, and columns."""

    row: np.ndarray
    column: np.ndarray


def made_trees(scene: Scene, rasters: dict[str, Any]) -> Trees:
    """Those of a case with stems a hectare."""
    grid, table = scene.grid, read_species(scene)
    rows = {row: found for row, found in _rows(scene, rasters) if found[0].size}
    if not rows:
        raise RockfallError(f"{scene.case.name}: &forest: no tree stands on the terrain")
    order = sorted(rows)
    column = np.concatenate([rows[row][0] for row in order])
    row = np.repeat(np.array(order, "i4"), [rows[row][0].size for row in order])
    u = np.concatenate([rows.pop(row)[1] for row in order], axis=1)
    cells = Cells(row, column)
    x = grid.west + (column + u[0]) * grid.cell
    y = grid.north - (row + 1 - u[1]) * grid.cell
    dbh = _diameters(scene, cells, u[2], rasters)
    conifer = u[3] < conifer_shares(scene, cells, rasters)
    return Trees(x, y, dbh, np.where(conifer, table.factors[CONIFER], table.factors[BROADLEAF]))


def _rows(
    scene: Scene, rasters: dict[str, Any]
) -> Iterator[tuple[int, tuple[np.ndarray, np.ndarray]]]:
    """Of each row the columns of its trees, and four random numbers of each, (4, trees)."""
    forest, nx, total = scene.case.forest, scene.grid.nx, 0.0
    columns, even = np.arange(nx, dtype="i4"), int(forest["spread"] == "even")
    per_cell = scene.grid.cell**2 / HECTARE
    for rows, block in _blocks(scene, "stems", rasters):
        density = np.nan_to_num(np.asarray(block, float))  # none where nothing is known
        _check(scene, "stems", density, (density >= 0) & (density <= MAX_DENSITY))
        total += density.sum() * per_cell
        if total > MAX_STEMS:
            raise RockfallError(f"{scene.case.name}: &forest: more than {MAX_STEMS:,.0f} trees")
        for k, expected in enumerate(density * per_cell):
            at = forest["seed"], nx, rows.start + k + 1
            counts = _core.stand_counts(*at, expected, even)
            numbers = _core.stand_numbers(*at, counts, max(1, counts.sum()))
            yield rows.start + k, (np.repeat(columns, counts), numbers[:, : counts.sum()])


def _diameters(scene: Scene, cells: Cells, u: np.ndarray, rasters: dict[str, Any]) -> np.ndarray:
    """Quantiles `u` of the gamma distributions of the cells [cm]: shape (mean/std)**2, scale
    std**2/mean."""
    from scipy.special import gammaincinv

    mean = _at_trees(scene, "dbh_mean", cells, rasters)
    std = _at_trees(scene, "dbh_std", cells, rasters)
    _check(scene, "dbh_mean", mean, (mean > 0) & (mean <= MAX_DBH))
    _check(scene, "dbh_std", std, (std >= 0) & (std <= MAX_DBH))
    dbh, varied = mean.copy(), std > 0
    shape = (mean[varied] / std[varied]) ** 2
    dbh[varied] = gammaincinv(shape, u[varied]) / shape * mean[varied]
    return np.maximum(np.round(dbh, DECIMALS), 10.0**-DECIMALS)


def conifer_shares(scene: Scene, cells: Cells, rasters: dict[str, Any]) -> np.ndarray:
    """Of conifers among the stems of cells, 0 to 1."""
    percent = _at_trees(scene, "conifers", cells, rasters)
    _check(scene, "conifers", percent, (percent >= 0) & (percent <= 100))
    return percent / 100


def _at_trees(scene: Scene, key: str, cells: Cells, rasters: dict[str, Any]) -> np.ndarray:
    """The values of a raster at trees, or the one value everywhere."""
    found = np.empty(cells.row.size)
    for rows, block in _blocks(scene, key, rasters):
        mine = slice(*np.searchsorted(cells.row, [rows.start, rows.stop]))
        found[mine] = block[cells.row[mine] - rows.start, cells.column[mine]]
    return found


def _blocks(scene: Scene, key: str, rasters: dict[str, Any]) -> Iterator[tuple[slice, np.ndarray]]:
    """Blocks of rows of a raster, or of the one value everywhere."""
    uniform = scene.case.forest.get(f"uniform_{key}")
    if uniform is None:
        yield from layer_blocks(scene, key, f"values of {key}", np.float32, rasters)
        return
    for rows in row_blocks(scene.grid.shape):
        yield rows, np.broadcast_to(uniform, (rows.stop - rows.start, scene.grid.nx))


def _check(scene: Scene, key: str, values: np.ndarray, good: np.ndarray) -> None:
    """Refuse what cannot be where trees stand, or are to stand."""
    if good.all():
        return
    forest, limits = scene.case.forest, {
        "stems": f"0 to {MAX_DENSITY:,.0f} a hectare", "conifers": "0 to 100 %",
        "dbh_mean": f"> 0 and at most {MAX_DBH:g} cm", "dbh_std": f"0 to {MAX_DBH:g} cm",
    }  # fmt: skip
    about = scene.case.path(forest[key]) if key in forest else f"{scene.case.name}: &forest {key}"
    first = values[~good].flat[0]
    raise RockfallError(f"{about}: {first:g} where trees stand: must be {limits[key]}")
