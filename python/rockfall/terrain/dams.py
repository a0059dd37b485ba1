# SPDX-License-Identifier: BSD-3-Clause
"""Earth dams and walls: they raise the terrain before a run; their rasterised shape is measured."""

import math
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np

from rockfall.errors import RockfallError
from rockfall.io.rasters.grid import Grid
from rockfall.terrain.height import height
from rockfall.terrain.polyline import beside, lengths

COARSE = 2.0  # minimum cells across a face; fewer give a bump (benchmarks/stability/dam_cells)
FINE = 4.0  # cells across a face, from which results hardly depend on cell size
STATIONS = 400  # maximum profiles across a dam
PROFILE = 241  # points in a profile across a dam
WIDE = 2.0  # ratio of crest width to height, above which the crest is the cause of a narrow face
NEAR = 0.05  # the crest includes points down to this fraction of the height below the top


class DamShape(NamedTuple):
    """Rasterised shape of a dam, from profiles across its line."""

    length: float  # line length with at least half of the requested height [m]
    height: float  # median height of the crest above the original terrain at the line [m]
    height_min: float  # minimum height, except at the ends [m]
    slope: float  # median slope of the narrower face, from crest to toe [degree]
    crest_min: float  # minimum elevation of the crest [m]
    crest_max: float
    crest_width: float  # median width 5 % of the height below the top [m]
    face: float  # plan width of the narrower face, from the keys of the dam [m]
    face_cells: float  # width of the narrower face [cells]
    requested: tuple[float, float, float]  # height [m], crest width [m], slope [degree]

    def rounded(self) -> dict[str, Any]:
        """Numbers by name, rounded to 1 mm, as stored in a result."""
        return {name: np.round(value, 3).tolist() for name, value in self._asdict().items()}


def with_dam(
    z: np.ndarray, grid: Grid, dam: Mapping[str, Any], name: str
) -> tuple[np.ndarray, DamShape]:
    """Return elevations (ny, nx), northernmost row first, with a dam, and its rasterised shape;
    `name` is used in messages.

    The crest is `height` above the terrain and `crest_width` wide. On both sides the dam falls at
    `slope` to the terrain: max(z, crest - tan(slope) (d - crest_width / 2)) at the distance d from
    its line. Cells without an elevation are unchanged. Raises a RockfallError for a face narrower
    than two cells, unless the dam sets `allow_coarse`, and for a line off the known terrain.
    """
    vertices = np.array(dam["x"]) + 1j * np.array(dam["y"])
    line, crest = _crest(z, grid, vertices, name)
    crest = crest + dam["height"]
    fall = np.tan(np.radians(dam["slope"]))
    far = dam["crest_width"] / 2 + (crest.max() - np.nanmin(z)) / fall
    rows, columns = (
        slice(*np.searchsorted(sign * centres, [low - far, high + far]))
        for sign, centres, low, high in (
            (-1, grid.y, -vertices.imag.max(), -vertices.imag.min()),
            (1, grid.x, vertices.real.min(), vertices.real.max()),
        )
    )
    apart, along = beside(grid.x[columns] + 1j * grid.y[rows, None], vertices)
    top = np.interp(along, line, crest) - fall * np.maximum(0.0, apart - dam["crest_width"] / 2)
    raised = z.copy()
    raised[rows, columns] = np.maximum(z[rows, columns], top)
    shape = _shape(z, raised, grid, dam, vertices)
    if shape.face_cells < COARSE and not dam["allow_coarse"]:
        if dam["crest_width"] > WIDE * dam["height"]:
            raise RockfallError(
                f"{name}: &dam crest_width = {dam['crest_width']:g}: the crest reaches into the "
                f"slope above, with a face of {shape.face:.2g} m: make it narrower"
            )
        raise RockfallError(
            f"{name}: &dam height = {dam['height']:g}, slope = {dam['slope']:g}: its face is "
            f"{shape.face_cells:.2g} cells wide: resample to {finer(shape):g} m, raise it to "
            f"{higher(shape)} m, or give allow_coarse = .true."
        )
    return raised, shape


def with_dams(
    z: np.ndarray, grid: Grid, dams: Iterable[Mapping[str, Any]], name: str
) -> tuple[np.ndarray, tuple[DamShape, ...]]:
    """Return elevations with several dams, added in turn, and the shapes of the dams."""
    shapes = []
    for dam in dams:
        z, shape = with_dam(z, grid, dam, name)
        shapes.append(shape)
    return z, tuple(shapes)


def finer(shape: DamShape) -> float:
    """Cell size [m] with `FINE` cells across the face, rounded down to two digits."""
    cell = max(shape.face, 1e-3) / FINE
    unit = 10.0 ** (math.floor(math.log10(cell)) - 1)
    return math.floor(cell / unit) * unit


def higher(shape: DamShape) -> int:
    """Height [m] with `COARSE` cells across the face, if face width is proportional to height."""
    return math.ceil(shape.requested[0] * COARSE / max(shape.face_cells, 1e-3))


def _shape(
    z: np.ndarray, raised: np.ndarray, grid: Grid, dam: Mapping[str, Any], vertices: np.ndarray
) -> DamShape:
    """Rasterised shape of a dam, from profiles across the surface that boulders meet."""
    base, wide, fall = dam["height"], dam["crest_width"], np.tan(np.radians(dam["slope"]))
    places, normal = _stations(vertices)
    half = wide / 2 + 2 * grid.cell + 3 * base / fall
    off = np.linspace(-half, half, PROFILE)
    points = places[:, None] + normal[:, None] * off
    x, y = _within(points, grid)
    before, after = height(z, grid, x, y), height(raised, grid, x, y)
    middle = before[:, PROFILE // 2]
    added = np.nan_to_num(after - before)
    own = added > NEAR * base  # True if noticeably raised by the dam
    near = own & (abs(off) <= wide / 2 + grid.cell)
    top = np.max(np.where(near, after, -np.inf), axis=1)
    top = np.where(np.isfinite(top), top, after[:, PROFILE // 2])
    high = top - middle
    face, side = _face(before, off, middle + base, wide, fall)
    stands = high >= base / 2
    if not stands.any():
        stands = high >= np.nanmax(high)
    inner = high[1:-1] if len(high) > 2 else high
    broad = np.count_nonzero(own & (after >= (top - NEAR * high)[:, None]), axis=1)
    return DamShape(
        length=float(lengths(vertices)[-1] * np.count_nonzero(stands) / stands.size),
        height=float(np.median(high)),
        height_min=float(inner.min()),
        slope=_slope(after, own, top, off, side),
        crest_min=float(top[stands].min()),
        crest_max=float(top[stands].max()),
        crest_width=float(np.median(broad) * (off[1] - off[0])),
        face=face,
        face_cells=face / grid.cell,
        requested=(float(base), float(wide), float(dam["slope"])),
    )


def _stations(vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """STATIONS evenly spaced points x + iy [m] on a polyline, away from its ends, and the unit
    normals there."""
    ends = lengths(vertices)
    line = (np.arange(STATIONS) + 0.5) * ends[-1] / STATIONS
    sides = np.diff(vertices)
    which = np.clip(np.searchsorted(ends, line, side="right") - 1, 0, sides.size - 1)
    places = np.interp(line, ends, vertices.real) + 1j * np.interp(line, ends, vertices.imag)
    return places, 1j * sides[which] / abs(sides[which])


def _within(points: np.ndarray, grid: Grid) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates x and y [m] of points x + iy, clipped to the outer cell centres."""
    margin = grid.cell / 2
    x = np.clip(points.real, grid.west + margin, grid.east - margin)
    return x, np.clip(points.imag, grid.south + margin, grid.north - margin)


def _face(
    before: np.ndarray, off: np.ndarray, crest: np.ndarray, wide: float, fall: float
) -> tuple[float, int]:
    """Median plan width [m] of the narrower face, from crest to terrain, and its side (-1 or 1)."""
    above = crest[:, None] - fall * np.maximum(0.0, abs(off) - wide / 2) - before
    toe = {}
    for side in (-1, 1):
        on_side = side * off > 0
        out, over = abs(off[on_side])[::side], above[:, on_side][:, ::side]
        last = np.argmax(over <= 0, axis=1)  # first point beyond the face
        last[(over > 0).all(axis=1)] = out.size - 1
        row, before_last = np.arange(last.size), np.maximum(last - 1, 0)
        down = np.maximum(over[row, before_last] - over[row, last], 1e-9)
        part = np.clip(over[row, before_last] / down, 0.0, 1.0)
        ends = out[before_last] + part * (out[last] - out[before_last])
        toe[side] = max(0.0, float(np.median(ends)) - wide / 2)
    narrow = min(toe, key=lambda side: toe[side])
    return toe[narrow], narrow


def _slope(
    after: np.ndarray, own: np.ndarray, top: np.ndarray, off: np.ndarray, side: int
) -> float:
    """Median angle [degree] of the chord between 10 and 90 % of a face's height; NaN without a
    face."""
    on_side = side * off >= 0
    z, of_dam, out = after[:, on_side], own[:, on_side], abs(off[on_side])
    if side < 0:
        z, of_dam, out = z[:, ::-1], of_dam[:, ::-1], out[::-1]
    toe = np.min(np.where(of_dam, z, np.inf), axis=1)
    drop = top - toe
    angles = [
        math.degrees(math.atan2(0.8 * drop[k], out[low] - out[high]))
        for k in np.flatnonzero(np.isfinite(drop) & (drop > 0))
        for high in [int(np.argmax(z[k] <= top[k] - 0.1 * drop[k]))]
        for low in [int(np.argmax(z[k] <= top[k] - 0.9 * drop[k]))]
        if out[low] > out[high]
    ]
    return float(np.median(angles)) if angles else math.nan


def _crest(
    z: np.ndarray, grid: Grid, vertices: np.ndarray, name: str
) -> tuple[np.ndarray, np.ndarray]:
    """Distances [m] along a crest line, at most half a cell apart, and terrain elevations there.
    Refuses crests outside the known terrain."""
    ends = lengths(vertices)
    line = np.union1d(ends, np.arange(0.0, ends[-1], grid.cell / 2))
    x, y = (np.interp(line, ends, part) for part in (vertices.real, vertices.imag))
    margin = grid.cell / 2
    if not (
        (x >= grid.west + margin).all() and (x <= grid.east - margin).all()
        and (y >= grid.south + margin).all() and (y <= grid.north - margin).all()
    ):  # fmt: skip
        raise RockfallError(
            f"{name}: &dam x, y: must lie between the outer cell centres of the DEM"
        )
    elevations = height(z, grid, x, y)
    if np.isnan(elevations).any():
        raise RockfallError(f"{name}: &dam x, y: must lie on terrain with an elevation")
    return line, elevations
