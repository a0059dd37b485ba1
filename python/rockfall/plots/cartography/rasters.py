# SPDX-License-Identifier: BSD-3-Clause
"""Rasters as images: cropped, thinned, outlined."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from rockfall.io.rasters.grid import Grid
from rockfall.plots.extent import Extent

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Colormap

DOTS = 1500  # maximum cells along the longer side of a map; images have fewer dots


def cropped(
    values: np.ndarray, grid: Grid, extent: Extent, merge: np.ufunc, dots: int = 0
) -> tuple[np.ndarray, Grid]:
    """Part of a raster within an extent, with at most `dots` cells per side (0: `DOTS`). `merge`
    combines several cells (np.add gives their mean)."""
    west, east, south, north = extent
    columns = _span(west - grid.west, east - grid.west, grid.cell, grid.nx)
    rows = _span(grid.north - north, grid.north - south, grid.cell, grid.ny)
    part = values[rows, columns]
    step = int(max(part.shape) / (dots or DOTS)) + 1
    sizes = merged(np.ones_like(part), step, np.add) if merge is np.add else 1
    part = merged(part, step, merge) / sizes
    west, north = grid.west + columns.start * grid.cell, grid.north - rows.start * grid.cell
    return part, Grid(west, north, grid.cell * step, part.shape[1], part.shape[0])


def merged(values: np.ndarray, step: int, merge: np.ufunc) -> np.ndarray:
    """Raster in which blocks of `step` x `step` cells are merged; blocks at the south and east
    edges may be smaller."""
    for axis in (0, 1) if step > 1 else ():
        values = merge.reduceat(values, np.arange(0, values.shape[axis], step), axis=axis)
    return values


def _span(first: float, last: float, cell: float, size: int) -> slice:
    """Range of at least two cells between two distances [m] from the raster edge."""
    start = int(np.clip(first // cell, 0, size - 2))
    return slice(start, int(np.clip(np.ceil(last / cell), start + 2, size)))


def draw_image(
    axes: Axes,
    values: np.ndarray,
    grid: Grid,
    cmap: Colormap | None = None,
    opacity: float = 1.0,
    **options: Any,
) -> None:
    """Draw an image at the position of its cells: values in the colours of `cmap`, or colours.
    Matplotlib draws pcolor images several times as fast as those of `imshow`."""
    from matplotlib.colors import ListedColormap
    from matplotlib.image import PcolorImage

    if cmap is not None:  # pcolor images ignore the artist's alpha
        options["cmap"] = ListedColormap(cmap(np.arange(cmap.N), opacity))
    x = np.linspace(grid.west, grid.east, grid.nx + 1)
    y = np.linspace(grid.south, grid.north, grid.ny + 1)
    extent = (grid.west, grid.east, grid.south, grid.north)
    axes.add_image(PcolorImage(axes, x, y, values[::-1], extent=extent, **options))


def edges(inside: np.ndarray, grid: Grid) -> np.ndarray:
    """Sides (n, 2, 2) [m] that separate cells inside from cells outside."""
    inside = np.pad(inside, 1)
    row, column = np.nonzero(inside[:, 1:] != inside[:, :-1])
    upright = np.stack([[column, row - 1], [column, row]])
    row, column = np.nonzero(inside[1:] != inside[:-1])
    level = np.stack([[column - 1, row], [column, row]])
    ends = np.concatenate([upright, level], axis=2).transpose(2, 0, 1)  # (sides, ends, x and y)
    return (grid.west, grid.north) + ends * (grid.cell, -grid.cell)


def occupied(points: np.ndarray, cell: float) -> tuple[np.ndarray, Grid]:
    """Mask of the cells of side `cell` [m] that contain points (n, 2), and the grid of the mask."""
    west, south = np.floor(points.min(axis=0) / cell) * cell
    column, row = np.floor((points - (west, south)) / cell).astype(int).T
    inside = np.zeros((row.max() + 1, column.max() + 1), bool)
    inside[row.max() - row, column] = True
    return inside, Grid(west, south + cell * len(inside), cell, inside.shape[1], len(inside))
