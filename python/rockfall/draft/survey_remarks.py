# SPDX-License-Identifier: BSD-3-Clause
"""Remarks on probable mistakes in surveyed points and in cells made from them."""

import math
from collections.abc import Iterator

import numpy as np

from rockfall.errors import RockfallError
from rockfall.io.vectors.point_text import HEIGHTS
from rockfall.language import Text, say
from rockfall.scene.ground import SPIKE
from rockfall.scene.rules.terrain import GAP, USUAL, USUAL_GAP, is_too_steep

HIGHER = 1.0  # [m] height difference at the same place; exceeds survey errors
AROUND = 16  # neighbours compared with a spike; eight may all be across a cliff
SAMPLES = 1000  # rows and columns sampled for slopes
COARSE, FINE = 5.0, 10.0  # spacings per cell, and cells per spacing, that trigger a remark
FINEST = 100.0  # cells per spacing above which the cell size is refused


def check_cell(cell: float, extent: np.ndarray, spacing: float) -> None:
    """Raise a RockfallError for cells [m] larger than half the extent (2,) of the points, or far
    smaller than their spacing."""
    if cell > extent.max() / 2:
        raise RockfallError(
            f"--cell {cell:g}: the points cover {extent[0]:,.4g} x {extent[1]:,.4g} m: must be at "
            "most half of this extent"
        )
    if cell < spacing / FINEST:
        raise RockfallError(
            f"--cell {cell:g}: points are {spacing:.3g} m apart: must be at least "
            f"{spacing / FINEST:.3g}"
        )


def cell_remarks(cell: float, spacing: float) -> Iterator[Text]:
    """Remark on cells [m] that are much larger or smaller than the point spacing."""
    if cell > COARSE * spacing:
        yield say("input.coarse_cells", cell=cell, spacing=spacing)
    if cell < spacing / FINE:
        yield say("input.fine_cells", cell=cell, spacing=spacing)


def height_remarks(points: np.ndarray) -> Iterator[Text]:
    """Remarks on points (n, 3) [m] with elevations impossible on land or far from all others."""
    z = points[:, 2]
    low, high = float(z.min()), float(z.max())
    if low < HEIGHTS[0] or high > HEIGHTS[1]:
        yield say("input.no_height_of_land", low=low, high=high)
        return
    for value, sign, key in (low, 1, "input.points_below"), (high, -1, "input.points_above"):
        apart = sign * (z[z != value] - value)
        usual = sign > 0 and value in USUAL
        if apart.size and (gap := float(apart.min())) > (USUAL_GAP if usual else GAP):
            yield say(key, n=z.size - apart.size, total=z.size, value=value, apart=gap)


def place_remarks(points: np.ndarray) -> Iterator[Text]:
    """Remark on points (n, 3) [m] at the same place with different heights."""
    x, y, z = points[np.lexsort(points.T[::-1])].T
    again = (np.diff(x) == 0) & (np.diff(y) == 0)
    apart = np.where(again, np.diff(z), 0.0)
    if apart.max(initial=0.0) > HIGHER:
        n = int(np.count_nonzero(apart > HIGHER))
        yield say("input.points_again", n=n, apart=float(apart.max()))


def spike_remarks(points: np.ndarray, errors: np.ndarray, spacing: float) -> Iterator[Text]:
    """Remark on points (n, 3) [m] that are higher or lower than all neighbours by more than the
    height of any rock; `errors` are leave-one-out errors of evenly selected points."""
    from scipy.spatial import cKDTree

    limit = max(SPIKE[0], SPIKE[1] * spacing)
    every = math.ceil(len(points) / errors.size) if errors.size else 1
    odd = np.flatnonzero(np.abs(np.nan_to_num(errors)) > limit) * every
    if not odd.size or len(points) <= AROUND:
        return
    _, which = cKDTree(points[:, :2]).query(points[odd, :2], AROUND + 1)
    own = which == odd[:, None]
    own[~own.any(axis=1), -1] = True  # more coincident points than neighbours
    around = points[which[~own].reshape(odd.size, AROUND), 2]
    rise = points[odd, 2, None] - around
    apart = np.maximum(rise.min(axis=1), -rise.max(axis=1))
    if apart.max() > limit:
        x, y, _ = points[odd[int(np.argmax(apart))]]
        n = int(np.count_nonzero(apart > limit))
        yield say("input.point_spikes", n=n, x=float(x), y=float(y), apart=float(apart.max()))


def slope_remarks(z: np.ndarray, cell: float) -> Iterator[Text]:
    """Remark on elevations (ny, nx) [m] that are steeper than any terrain, for instance in feet."""
    if min(z.shape) < 3:
        return
    row, column = (np.arange(1, size - 1, math.ceil(size / SAMPLES)) for size in z.shape)
    rise = z[np.ix_(row, column + 1)] - z[np.ix_(row, column - 1)]
    fall = z[np.ix_(row + 1, column)] - z[np.ix_(row - 1, column)]
    slopes = np.degrees(np.arctan(np.hypot(rise, fall) / (2 * cell)))
    if not np.isnan(slopes).all():
        half, steep = np.nanquantile(slopes, (0.5, 0.9)).tolist()
        if is_too_steep(half, steep):
            yield say("input.steep", half=half)
