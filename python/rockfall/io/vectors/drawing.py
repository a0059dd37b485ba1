# SPDX-License-Identifier: BSD-3-Clause
"""DXF drawings: lines, closed lines, hatches and points in the layers of the model space.

Blocks are exploded; arcs, circles, ellipses and splines become chords within `TOLERANCE`. All
coordinates are in plan. The reader is ezdxf, because GDAL garbles names with umlauts, fails on
some drawings, and ignores hatch styles. Hatch areas are built here from their boundaries, because
ezdxf loses islands in holes.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterator
from functools import lru_cache
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rockfall.errors import RockfallError, need
from rockfall.io.files import check_text_file
from rockfall.io.gdal_files import plain_file

if TYPE_CHECKING:
    from ezdxf.entities import DXFEntity
    from shapely import Geometry

TOLERANCE = 0.01  # maximum deviation of chords [m]
COARSEST = 1e-6  # minimum tolerance relative to the size of a curve; limits the number of chords
CURVES = 16  # cubic curves that approximate an arc, within 1e-7 of its radius
MAX_PARTS = 50_000  # maximum entities of inserted blocks
MAX_DEPTH = 16  # maximum nesting of blocks
LINES = ("LINE", "LWPOLYLINE", "POLYLINE", "ARC", "CIRCLE", "ELLIPSE", "SPLINE", "HELIX")
HATCHES = ("HATCH", "MPOLYGON")
DRAWN = (*LINES, *HATCHES, "POINT", "INSERT")  # entity types counted in paper space
TEXT_BOX = 8  # boundary flag for a text box
# Hatch styles with one level of holes, and with none; others have islands in holes:
OUTERMOST, FILLED = 1, 2
PLAIN = ("AcDb2dPolyline", "AcDb3dPolyline")  # polylines that are not meshes
NOWHERE = np.empty((0, 2))
UNITS_OF_METRES = (0, 6)  # $INSUNITS: none, metres


class Part(NamedTuple):
    """An entity: its layer, its type in the drawing, and its plan coordinates."""

    layer: str
    kind: str
    xy: np.ndarray  # (n, 2): one row for a point, one boundary of a hatch, empty if not read
    closed: bool = False
    rings: tuple[np.ndarray, ...] = ()  # all boundaries of a hatch, (n, 2) each
    style: int = 0  # hatch style

    def area(self) -> Geometry:
        """Polygons of a closed line or hatch; the check of shapes refuses crossed boundaries."""
        import shapely

        areas = shapely.polygons([shapely.linearrings(ring) for ring in self.rings or (self.xy,)])
        for area in areas[~shapely.is_valid(areas)][:1]:
            return area
        if self.style == FILLED:
            return shapely.union_all(areas)
        if self.style == OUTERMOST:
            inner, _ = shapely.STRtree(areas).query(areas, predicate="within")
            depth = np.bincount(inner) - 1
            return shapely.difference(*(shapely.union_all(areas[depth == k]) for k in (0, 1)))
        while len(areas) > 1:
            pairs = np.append(areas, [None] * (len(areas) % 2)).reshape(-1, 2)
            odd = shapely.is_missing(pairs[:, 1])
            areas = np.where(odd, pairs[:, 0], shapely.symmetric_difference(*pairs.T))
        return areas[0]


class Drawing(NamedTuple):
    """Entities in the model space; the unit ("" for metres or none); and the number of paper-space
    entities by layer name, ignoring case."""

    parts: list[Part]
    unit: str
    paper: Counter[str]

    @property
    def layers(self) -> list[str]:
        """Names of layers with lines, hatches or points."""
        return self.layers_with(lambda _: True)

    def layers_with(self, wanted: Callable[[Part], bool]) -> list[str]:
        """Names of layers with lines, hatches or points that `wanted` accepts."""
        parts = (part for part in self.parts if len(part.xy) and wanted(part))
        return list(dict.fromkeys(part.layer for part in parts))

    def on_paper(self, layer: str | None) -> int:
        """Number of paper-space entities in a layer (None: in all layers)."""
        return self.paper.total() if layer is None else self.paper[layer.casefold()]


def is_drawing(path: str | Path) -> bool:
    """Return True if a file name is that of a drawing."""
    return Path(path).suffix.lower() == ".dxf"


def read_drawing(path: str | Path) -> Drawing:
    """Read a DXF file. Raises a RockfallError if it is damaged or no DXF."""
    need("DXF needs", "cad")
    file = plain_file(path)
    check_text_file(path)
    status = os.stat(file)
    return _read(str(path), file, status.st_mtime_ns, status.st_size)


@lru_cache(maxsize=1)  # the layers of a drawing are read in turn
def _read(path: str, file: str, *_: int) -> Drawing:
    import ezdxf
    from ezdxf import units

    try:
        drawing = ezdxf.readfile(file)
        unit = int(drawing.header.get("$INSUNITS", 0))
        named = "" if unit in UNITS_OF_METRES else units.decode(unit)
        space = drawing.modelspace()
        names: dict[str, str] = {}  # DXF names ignore case
        parts = []
        of_blocks = count()
        for layer, entity in _taken_apart(space, "", 0, of_blocks):
            layer = layer.encode("utf-8", "replace").decode()
            parts.append(_part(path, names.setdefault(layer.casefold(), layer), entity))
        paper = Counter(
            entity.dxf.get("layer", "0").casefold()
            for layout in drawing.layouts
            if layout.is_any_paperspace
            for entity in layout
            if entity.dxftype() in DRAWN
        )
    except RockfallError as error:
        raise RockfallError(str(error) if path in str(error) else f"{path}: {error}") from error
    except (  # errors of ezdxf for damaged files
        ezdxf.DXFError, OSError, ValueError, LookupError, TypeError, AttributeError,
        ArithmeticError, RuntimeError, StopIteration, AssertionError,
    ) as error:  # fmt: skip
        raise RockfallError(f"{path}: cannot be read as a DXF drawing ({error})") from error
    return Drawing(parts, str(named or ""), paper)


def _taken_apart(
    entities: Any, layer: str, depth: int, of_blocks: Iterator[int]
) -> Iterator[tuple[str, DXFEntity]]:
    """Yield layers and entities, with inserted blocks exploded; layer 0 in a block becomes the
    layer of the insertion. `of_blocks` counts the entities in blocks. Refuses too many entities or
    levels."""
    if depth > MAX_DEPTH:
        raise RockfallError(f"blocks within blocks, more than {MAX_DEPTH} deep")
    for entity in entities:
        if depth and next(of_blocks) >= MAX_PARTS:
            raise RockfallError(f"its blocks have more than {MAX_PARTS:,} entities")
        own = entity.dxf.get("layer", "0")
        own = layer if depth and own == "0" else own
        if entity.dxftype() != "INSERT":
            yield own, entity
            continue
        for insert in entity.multi_insert() if entity.mcount > 1 else [entity]:
            if next(of_blocks) >= MAX_PARTS:  # its block may be empty
                raise RockfallError(f"its blocks have more than {MAX_PARTS:,} entities")
            yield from _taken_apart(insert.virtual_entities(), own, depth + 1, of_blocks)


def _part(path: str, layer: str, entity: Any) -> Part:
    """Plan coordinates of an entity, as a Part."""
    from ezdxf.path import make_path

    kind = entity.dxftype()
    if kind == "POINT":
        return Part(layer, kind, np.array([tuple(entity.dxf.location)[:2]], float))
    if kind in HATCHES:
        return _hatch(path, layer, entity)
    if kind not in LINES or (kind == "POLYLINE" and entity.get_mode() not in PLAIN):
        return Part(layer, kind, NOWHERE)
    curve = make_path(entity, segments=CURVES)
    xy = _chords(curve, f"{path}: layer {layer}: {kind}")
    if not len(xy):  # drawn with a single click
        return Part(layer, f"{kind} without length", NOWHERE)
    return Part(layer, kind, xy, curve.is_closed and len(xy) > 3)


def _hatch(path: str, layer: str, entity: Any) -> Part:
    """Boundaries of a hatch, except text boxes; gaps are closed by straight lines."""
    from ezdxf.math import Vec3
    from ezdxf.path import from_hatch_boundary_path

    kind, rings = entity.dxftype(), []
    moved = Vec3(entity.dxf.get("offset_vector", (0, 0)) if kind == "MPOLYGON" else (0, 0))
    place = entity.ocs(), entity.dxf.elevation.z, moved
    for boundary in entity.paths:
        if boundary.path_type_flags & TEXT_BOX:
            continue
        curve = from_hatch_boundary_path(boundary, *place)
        for ring in curve.sub_paths() if curve.has_sub_paths else [curve]:
            xy = _chords(ring, f"{path}: layer {layer}: {kind}")
            if len(xy) < 3:
                continue
            rings.append(xy if (xy[0] == xy[-1]).all() else np.vstack([xy, xy[:1]]))
    if not rings:
        return Part(layer, f"{kind} without area", NOWHERE)
    return Part(layer, kind, rings[0], True, tuple(rings), entity.dxf.get("hatch_style", 0))


def _chords(curve: Any, where: str) -> np.ndarray:
    """Points (n, 2) of a curve in plan; empty if its length is zero. Refuses coordinates that are
    not finite."""
    corners = np.array([tuple(vertex)[:2] for vertex in curve.control_vertices()], float)
    if not np.isfinite(corners).all():
        raise RockfallError(f"{where} has coordinates that are not finite")
    size = float(np.ptp(corners, axis=0).max()) if len(corners) else 0.0
    if not size:
        return NOWHERE
    chord = max(TOLERANCE, COARSEST * size)
    xy = np.array([tuple(vertex)[:2] for vertex in curve.flattening(chord, segments=1)], float)
    if curve.is_closed:
        xy[-1] = xy[0]
    return xy


def without_outlines(parts: list[Part]) -> list[Part]:
    """Parts without closed lines that outline hatches or their holes: otherwise the areas would
    count twice, and holes would count as areas."""
    hatched = [_measures(ring) for part in parts for ring in part.rings]
    if not hatched:
        return parts
    near = np.array(hatched)

    def is_outline(part: Part) -> bool:
        if not part.closed or part.rings:
            return False
        apart = np.abs(near - _measures(part.xy))
        wide = np.ptp(part.xy, axis=0).sum()
        return bool((apart <= [*[2 * TOLERANCE] * 4, 4 * TOLERANCE * wide]).all(axis=1).any())

    return [part for part in parts if not is_outline(part)]


def _measures(xy: np.ndarray) -> np.ndarray:
    """Bounds [m] and area [m2] of a closed line."""
    x, y = (xy - xy[0]).T
    area = abs(x[:-1] @ y[1:] - x[1:] @ y[:-1]) / 2
    return np.array([*xy.min(axis=0), *xy.max(axis=0), area])


def left_out(parts: list[Part]) -> str:
    """Types and numbers of entities: "3 TEXT, 1 HATCH"."""
    counts = Counter(part.kind for part in parts)
    return ", ".join(f"{count} {kind}" for kind, count in counts.items())
