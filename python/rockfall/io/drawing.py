# SPDX-License-Identifier: BSD-3-Clause
"""DXF drawings: the lines, closed lines and points of the layers of their model space.

Blocks are taken apart, arcs, circles, ellipses and splines drawn as chords within `TOLERANCE`. All
is in plan. The reader is ezdxf: GDAL's garbles names with umlauts and stops at some drawings.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator
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

TOLERANCE = 0.01  # of chords [m]
COARSEST = 1e-6  # of chords, over the size of a curve: bounds their number
CURVES = 16  # cubic curves that stand for an arc: within 1e-7 of its radius
MAX_PARTS = 50_000  # entities of blocks, wherever these are inserted
MAX_DEPTH = 16  # of blocks within blocks
LINES = ("LINE", "LWPOLYLINE", "POLYLINE", "ARC", "CIRCLE", "ELLIPSE", "SPLINE", "HELIX")
PLAIN = ("AcDb2dPolyline", "AcDb3dPolyline")  # polylines that are no meshes
NOWHERE = np.empty((0, 2))
UNITS_OF_METRES = (0, 6)  # $INSUNITS: none, metres


class Part(NamedTuple):
    """An entity: its layer, its kind in the drawing, and its places in plan."""

    layer: str
    kind: str
    xy: np.ndarray  # (n, 2); one place for a point; none: neither line nor point
    closed: bool = False


class Drawing(NamedTuple):
    """Entities of the model space, and the unit it names; "" for metres or none."""

    parts: list[Part]
    unit: str

    @property
    def layers(self) -> list[str]:
        """Names of the layers with lines or points."""
        return list(dict.fromkeys(part.layer for part in self.parts if len(part.xy)))


def is_drawing(path: str | Path) -> bool:
    """Return True if the name is that of a drawing."""
    return Path(path).suffix.lower() == ".dxf"


def read_drawing(path: str | Path) -> Drawing:
    """Read a DXF file; a RockfallError refuses what is none or is damaged."""
    need("DXF needs", "cad", "ezdxf")
    file = plain_file(path)
    check_text_file(path)
    status = os.stat(file)
    return _read(str(path), file, status.st_mtime_ns, status.st_size)


@lru_cache(maxsize=1)  # each layer of a drawing is asked for alone
def _read(path: str, file: str, *_: int) -> Drawing:
    import ezdxf
    from ezdxf import units

    try:
        drawing = ezdxf.readfile(file)
        unit = int(drawing.header.get("$INSUNITS", 0))
        named = "" if unit in UNITS_OF_METRES else units.decode(unit)
        space = drawing.modelspace()
        names: dict[str, str] = {}  # DXF ignores the case of names
        parts = []
        of_blocks = count()
        for layer, entity in _taken_apart(space, "", 0, of_blocks):
            layer = layer.encode("utf-8", "replace").decode()
            parts.append(_part(path, names.setdefault(layer.casefold(), layer), entity))
    except RockfallError as error:
        raise RockfallError(str(error) if path in str(error) else f"{path}: {error}") from error
    except (  # what ezdxf raises for files that are damaged
        ezdxf.DXFError, OSError, ValueError, LookupError, TypeError, AttributeError,
        ArithmeticError, RuntimeError, StopIteration, AssertionError,
    ) as error:  # fmt: skip
        raise RockfallError(f"{path}: not a DXF drawing that can be read ({error})") from error
    return Drawing(parts, str(named or ""))


def _taken_apart(
    entities: Any, layer: str, depth: int, of_blocks: Iterator[int]
) -> Iterator[tuple[str, DXFEntity]]:
    """Layers and entities, those of blocks where they are inserted; in a block, layer 0 is that of
    the insertion. `of_blocks` counts those of blocks."""
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
            if next(of_blocks) >= MAX_PARTS:  # also where a block is empty
                raise RockfallError(f"its blocks have more than {MAX_PARTS:,} entities")
            yield from _taken_apart(insert.virtual_entities(), own, depth + 1, of_blocks)


def _part(path: str, layer: str, entity: Any) -> Part:
    """Places of an entity."""
    from ezdxf.path import make_path

    kind = entity.dxftype()
    if kind == "POINT":
        return Part(layer, kind, np.array([tuple(entity.dxf.location)[:2]], float))
    if kind not in LINES or (kind == "POLYLINE" and entity.get_mode() not in PLAIN):
        return Part(layer, kind, NOWHERE)
    curve = make_path(entity, segments=CURVES)
    corners = np.array([tuple(vertex)[:2] for vertex in curve.control_vertices()], float)
    if not np.isfinite(corners).all():
        raise RockfallError(f"{path}: layer {layer}: {kind} has coordinates that are not finite")
    size = float(np.ptp(corners, axis=0).max()) if len(corners) else 0.0
    if not size:  # a click of the mouse
        return Part(layer, f"{kind} of no length", NOWHERE)
    chord = max(TOLERANCE, COARSEST * size)
    xy = np.array([tuple(vertex)[:2] for vertex in curve.flattening(chord, segments=1)], float)
    if curve.is_closed:
        xy[-1] = xy[0]
    return Part(layer, kind, xy, curve.is_closed and len(xy) > 3)


def left_out(parts: list[Part]) -> str:
    """Kinds of entities and their numbers: "3 TEXT, 1 HATCH"."""
    counts = Counter(part.kind for part in parts)
    return ", ".join(f"{count} {kind}" for kind, count in counts.items())
