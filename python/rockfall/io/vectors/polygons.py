# SPDX-License-Identifier: BSD-3-Clause
"""Areas of polygons: parts on the terrain, overlaps, points inside, and cells contained or
touched.

A point on the border of two polygons belongs to the western polygon or, on an east-west border, to
the southern polygon. Polygons with common borders thus share no cells and leave no gaps.
"""

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from rockfall.errors import RockfallError
from rockfall.io.rasters.grid import Grid
from rockfall.language import remark

SLIVER = 0.01  # fraction of the smaller polygon: smaller overlaps are drawing errors
SPARSE = 8  # spacing of the first samples [cells]
HALF = 0.5  # fraction off the terrain to note for zones and stands: maps often exceed a DEM
#: [m] Displacement of borders to the east and north: far below survey accuracy, far above
#: rounding, and in a direction in which no border is drawn.
ASIDE = (1e-6, 1.618034e-6)
MARGIN = 0.01  # [cells] polygons are enlarged by this, so that no touched cell is missed


def disjoint(shapes: np.ndarray, where: str) -> tuple[np.ndarray, float]:
    """Polygons without overlaps, and the overlapping area [m2]. Slivers go to the later polygon;
    larger overlaps are refused with the numbers of both features.

    >>> import shapely
    >>> squares = np.array([shapely.box(0, 0, 10, 10), shapely.box(9.99, 0, 20, 10)])
    >>> parts, shared = disjoint(squares, "stands.gpkg")
    >>> round(shared, 6), round(parts[0].area, 6)
    (0.1, 99.9)
    """
    import shapely

    shapes, shared = shapes.copy(), 0.0
    earlier, later = shapely.STRtree(shapes).query(shapes, predicate="intersects")
    for j, k in sorted((j, k) for j, k in zip(earlier, later, strict=True) if j < k):
        common = shapely.area(shapely.intersection(shapes[j], shapes[k]))
        if common > SLIVER * min(shapely.area(shapes[j]), shapely.area(shapes[k])):
            raise RockfallError(
                f"{where}: features {j + 1} and {k + 1} overlap by {common:,.4g} m2: polygons must "
                f"not overlap by more than {SLIVER:.0%} of the smaller one"
            )
        if common > 0:
            shapes[j] = shapely.difference(shapes[j], shapes[k])
            shared += float(common)
    return shapes, shared


def any_overlap(shapes: np.ndarray) -> bool:
    """Return True if polygons may overlap; False if they are all separate or only touch."""
    import shapely

    earlier, later = shapely.STRtree(shapes).query(shapes, predicate="intersects")
    pairs = (shapes[k[earlier < later]] for k in (earlier, later))
    return bool(np.any(~shapely.touches(*pairs)))


def on_terrain(shapes: np.ndarray, grid: Grid) -> np.ndarray:
    """Parts of polygons on the terrain; empty for polygons entirely outside."""
    import shapely

    return shapely.intersection(shapes, shapely.box(grid.west, grid.south, grid.east, grid.north))


def note_outside(
    path: str, shapes: np.ndarray, grid: Grid, least: float, remarks: list[str]
) -> None:
    """Add a remark on polygons with more than a fraction `least` of their area off the terrain."""
    import shapely

    area = shapely.area(shapes)
    outside = area - shapely.area(on_terrain(shapes, grid))
    if n := int(np.count_nonzero(outside > least * area)):
        numbers = {"part": n, "n": area.size, "percent": float(100 * outside.sum() / area.sum())}
        remarks.append(remark(path, "input.polygons_outside", **numbers))


def empty_polygons(cells: np.ndarray, shapes: np.ndarray, grid: Grid) -> np.ndarray:
    """Mask of polygons that contain no cell centre, given the polygon number (from 1) of each cell.
    Polygons missing in a sample of cells are searched within their bounds."""
    import shapely

    held = np.zeros(len(shapes) + 1, bool)
    held[cells[::SPARSE, ::SPARSE]] = True
    for k in np.flatnonzero(~held[1:]):
        west, south, east, north = shapely.bounds(shapes[k])
        row, column = grid.cells(np.array([west, east]), np.array([north, south]))
        held[k + 1] = (cells[row[0] : row[1] + 1, column[0] : column[1] + 1] == k + 1).any()
    return ~held[1:]


def points_inside(
    shapes: np.ndarray, x: np.ndarray, y: np.ndarray
) -> Iterator[tuple[int, np.ndarray]]:
    """Yield the index of each polygon and the indices of the points inside it."""
    import shapely

    order = np.argsort(y, kind="stable")
    sorted_y = y[order]
    shapely.prepare(shapes)
    for k, (west, south, east, north) in enumerate(shapely.bounds(shapes)):
        if np.isnan(west):  # empty polygon
            continue
        start, stop = np.searchsorted(sorted_y, [south, north + 2 * ASIDE[1]])
        near = order[start:stop]
        near = near[(x[near] >= west) & (x[near] <= east + 2 * ASIDE[0])]
        yield k, near[shapely.contains_xy(shapes[k], x[near] - ASIDE[0], y[near] - ASIDE[1])]


def held_cells(shapes: Iterable[tuple[Any, int]], grid: Grid, cells: np.ndarray) -> np.ndarray:
    """Set `cells` (ny, nx) to the number of the last polygon that contains the cell centre; return
    them."""
    from rasterio.features import rasterize

    moved = grid.moved(-ASIDE[0], -ASIDE[1])
    return rasterize(shapes, out=cells, transform=moved.transform)


def touched_cells(shapes: np.ndarray, numbers: np.ndarray, grid: Grid) -> np.ndarray:
    """Number of the last polygon that touches each cell, even at an edge; 0 if none."""
    import shapely
    from rasterio.features import rasterize

    larger = shapely.buffer(shapes, MARGIN * grid.cell, quad_segs=1)
    pairs = [(part, int(k)) for part, k in zip(larger, numbers, strict=True) if not part.is_empty]
    if not pairs:
        return np.zeros(grid.shape, "i4")
    return rasterize(
        pairs, out_shape=grid.shape, transform=grid.transform, fill=0, dtype="int32",
        all_touched=True,
    )  # fmt: skip
