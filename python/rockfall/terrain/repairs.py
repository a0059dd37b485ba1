# SPDX-License-Identifier: BSD-3-Clause
"""Repairs and edits of elevations (ny, nx) [m], NaN where missing: holes, pits, noise, cuts."""

from typing import Any

import numpy as np

from rockfall.io.rasters.grid import Grid
from rockfall.io.vectors.polygons import held_cells

AROUND = np.ones((3, 3), bool)
HALF = ((0, 1), (1, 0), (1, 1), (1, -1))  # steps to half of the eight neighbours


def without_holes(z: np.ndarray, far: float) -> np.ndarray:
    """Fill enclosed holes from the surrounding terrain, up to `far` cells from their edge (with
    GDAL). Nothing is extrapolated beyond the terrain."""
    from rasterio.fill import fillnodata
    from scipy.ndimage import label

    missing = np.isnan(z)
    parts, _ = label(missing)
    outside = np.unique(np.concatenate([parts[0], parts[-1], parts[:, 0], parts[:, -1]]))
    holes = missing & ~np.isin(parts, outside)
    base = np.nanmin(z)  # GDAL uses single precision
    lowered = np.where(missing, 0.0, z - base).astype(np.float32)
    filled = fillnodata(lowered, mask=~missing, max_search_distance=far)
    reached = fillnodata((~missing).astype(np.float32), mask=~missing, max_search_distance=far) > 0
    done = z.copy()
    done[holes & reached] = (filled + base)[holes & reached]
    return done


def without_pits(z: np.ndarray, deepest: float) -> np.ndarray:
    """Fill pits up to `deepest` [m] deep; deeper pits, such as ditches and quarries, remain."""
    from scipy.ndimage import label, maximum

    level = _spill(z)
    parts, n = label(level > z, AROUND)
    if not n:
        return z.copy()
    deep = maximum(level - z, parts, np.arange(n + 1))
    return np.where((parts > 0) & (deep[parts] <= deepest), level, z)


def _spill(z: np.ndarray) -> np.ndarray:
    """Lowest level [m] at which water drains from each cell to the edge of the terrain, found
    along a minimum spanning tree of the cells."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree

    is_known = ~np.isnan(z)
    height = np.concatenate([[0.0], z[is_known] - np.nanmin(z)])  # 0: outside
    i, j = _pairs(np.where(is_known, np.cumsum(is_known).reshape(z.shape), 0))
    pass_ = np.maximum(height[i], height[j]) + 1.0  # zero would mean no edge
    tree = minimum_spanning_tree(coo_array((pass_, (i, j)), shape=(height.size,) * 2).tocsr())
    order, before = breadth_first_order(tree, 0, directed=False)
    level, before_ = height.tolist(), before.tolist()
    for cell in order[1:].tolist():
        level[cell] = max(level[cell], level[before_[cell]])
    raised = np.array(level) > height
    spilled = z.copy()
    spilled[is_known] = np.where(raised[1:], np.array(level)[1:] + np.nanmin(z), z[is_known])
    return spilled


def _pairs(number: np.ndarray) -> np.ndarray:
    """Pairs (2, n) of adjacent cells, each once; 0 is the outside."""
    padded, pairs = np.pad(number, 1), []
    ny, nx = padded.shape
    for down, right in HALF:
        left = max(0, -right)
        here = padded[: ny - down, left : nx - max(0, right)]
        there = padded[down:, left + right : nx - max(0, right) + right]
        pairs.append(np.sort(np.stack([here.ravel(), there.ravel()]), axis=0))
    i, j = np.concatenate(pairs, axis=1)
    inner = i > 0
    rim = np.unique(j[(i == 0) & (j > 0)])
    return np.concatenate([[i[inner], j[inner]], [np.zeros_like(rim), rim]], axis=1)


def smoothed(z: np.ndarray, std: float) -> np.ndarray:
    """Smooth known cells with a Gaussian filter, `std` in cells; missing cells stay missing."""
    from scipy.ndimage import gaussian_filter

    is_known, base = ~np.isnan(z), np.nanmin(z)
    heights = gaussian_filter(np.where(is_known, z - base, 0.0), std, mode="constant")
    share = gaussian_filter(is_known.astype(float), std, mode="constant")
    smooth = z.copy()
    smooth[is_known] = heights[is_known] / share[is_known] + base
    return smooth


def lowered(z: np.ndarray, grid: Grid, shape: Any, depth: float, floor: float) -> np.ndarray:
    """Lower the cells in a polygon by `depth` [m], then at least to `floor` [m] (NaN: unused)."""
    inside = held_cells([(shape, 1)], grid, np.zeros(z.shape, np.uint8)) > 0
    done = z.copy()
    done[inside] -= 0.0 if np.isnan(depth) else depth
    done[inside] = np.fmin(done[inside], np.where(np.isnan(z[inside]), np.nan, floor))
    return done
