# SPDX-License-Identifier: BSD-3-Clause
"""Generalised outlines of hazard zones: smooth, without parts narrower than a given width.

Every step errs on the safe side: an outline encloses all cells of its class and of higher classes;
narrow parts are widened, or get the next higher class if it is adjacent.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from shapely import Geometry

ARC = 4  # segments per quarter circle
TOLERANCE = 0.25  # tolerance of simplified outlines, in cells
NEGLIGIBLE = 0.01  # area attributed to rounding, in cells
TOUCHING = 1e-6  # distance at which parts count as touching [m]
GRID = 2.0**-20  # coordinate grid, in cells; without it, overlays fail with some GEOS builds
PASSES = 2  # repetitions: widening a narrow part may narrow its neighbours


def generalised(areas: Sequence[Geometry], width: float, cell: float) -> list[Geometry]:
    """Generalise the areas of the classes, lowest class first. The resulting areas do not overlap,
    and together enclose the given areas to within the coordinate resolution. `width` and `cell` are
    in metres."""
    import shapely

    least, grid = NEGLIGIBLE * cell**2, {"grid_size": GRID * cell}
    above = [
        _enclosing(shapely.union_all(areas[k:], **grid), width, cell) for k in range(len(areas))
    ]
    for k in reversed(range(len(above))):
        narrow = _narrow_parts(above[k], width, cell**2, grid)
        inner = above[k + 1] if k + 1 < len(above) else shapely.Polygon()
        widened = [part.buffer(width / 2, ARC) for part in narrow]
        above[k] = shapely.union_all([above[k], inner, *widened], **grid)
    for _ in range(PASSES):
        for k in range(len(above) - 1):
            ring = above[k].difference(above[k + 1], **grid)
            narrow = shapely.union_all(_narrow_parts(ring, width, least, grid), **grid)
            near = narrow.intersection(above[k + 1].buffer(width, ARC), **grid)
            beside = [
                polygon
                for polygon in polygons_of(near)
                if polygon.distance(above[k + 1]) < TOUCHING
            ]
            above[k + 1] = shapely.union_all([above[k + 1], *beside], **grid)
    above.append(shapely.Polygon())
    return [above[k].difference(above[k + 1], **grid) for k in range(len(areas))]


def polygons_of(area: Geometry, least: float = 0.0) -> Iterator[Geometry]:
    """Polygons of an area that are larger than `least` [m2]."""
    for part in getattr(area, "geoms", [area]):
        if part.geom_type == "Polygon" and part.area > least:
            yield part


def _enclosing(area: Geometry, width: float, cell: float) -> Geometry:
    """Smooth outline around an area; gaps narrower than `width` are filled. The outline is offset
    by the tolerance before it is simplified; parts of the area that it still cuts are added."""
    out, tolerance = width / 2, TOLERANCE * cell
    smooth = area.buffer(out, ARC).buffer(tolerance - out, ARC).simplify(tolerance)
    return smooth.union(area, grid_size=GRID * cell)


def _narrow_parts(
    area: Geometry, width: float, least: float, grid: dict[str, float]
) -> list[Geometry]:
    """Parts of an area, larger than `least` [m2], that are narrower than `width`."""
    attrs = {"join_style": "mitre", "mitre_limit": 2.0}
    wide = area.buffer(-width / 2, **attrs).buffer(width / 2 * (1 + 1e-9), **attrs)
    return list(polygons_of(area.difference(wide, **grid), least))
