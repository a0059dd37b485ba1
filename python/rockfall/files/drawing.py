# SPDX-License-Identifier: BSD-3-Clause
"""Layers as a DXF drawing in metres (AutoCAD 2010, UTF-8), for CAD."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from rockfall.errors import need
from rockfall.files.vector_style import Style, paint
from rockfall.io.atomic import atomic_write

NAMING = ("name", "object")  # attributes drawn as text
TEXT_HEIGHT = 5.0  # [m]
DARK = 64  # grey value, 0 to 255
METRES = 6  # value of $INSUNITS


def write_drawing(path: Path, layers: Mapping[str, tuple], styles: Mapping[str, Style]) -> Path:
    """Write layers to a drawing, atomically: trajectories as 3-D polylines, other lines and
    polygons as plan polylines, points with heights, names of lines and objects as text.

    A layer that is styled by a field is split into a layer for each value, such as `zones_high`,
    because DXF has no attributes.
    """
    need("DXF needs", "cad")
    import ezdxf
    import shapely

    drawing = ezdxf.new("R2010", setup=False)
    drawing.header["$INSUNITS"] = METRES
    space = drawing.modelspace()
    for name, (kind, parts) in layers.items():
        style = styles.get(name)
        field = style.field if style and style.kind == "categorizedSymbol" else ""
        colours = _colours(style)
        for shapes, fields in parts:
            shapes = shapely.from_wkb(shapes) if kind.endswith(" ZM") else shapes
            values = fields[field].tolist() if field in fields else [""] * len(shapes)
            named = next((key for key in NAMING if key in fields), "")
            texts = fields[named].tolist() if named else [""] * len(shapes)
            for shape, value, text in zip(shapes, values, texts, strict=True):
                if shape is None or shape.is_empty:
                    continue
                layer = f"{name}_{value}" if field in fields else name
                if layer not in drawing.layers:
                    _colour(drawing.layers.add(layer), colours.get(str(value), (0, 0, 0)))
                for part in getattr(shape, "geoms", [shape]):
                    _DRAWN[part.geom_type](space, part, layer)
                if text:
                    _write_text(space, shape, str(text), layer)
    with atomic_write(path) as part:
        drawing.saveas(part)
    return path


def _colour(layer: Any, colour: tuple[int, int, int]) -> None:
    """Set the colour of a layer; dark colours become DXF colour 7 (white on dark backgrounds)."""
    if max(colour) > DARK:
        layer.rgb = colour


def _colours(style: Style | None) -> dict[str, tuple[int, int, int]]:
    """Colour for each value of a style's field; "" for a uniform style; no colours for a style by
    intervals."""
    if style is None or style.kind == "graduatedSymbol":
        return {}
    return {str(value): paint(symbol) for value, _, symbol in style.symbols}


def _coordinates(shape: Any, height: bool) -> np.ndarray:
    import shapely

    return shapely.get_coordinates(shape, include_z=height)


def _draw_point(space: Any, shape: Any, layer: str) -> None:
    space.add_point(_coordinates(shape, shape.has_z)[0].tolist(), dxfattribs={"layer": layer})


def _draw_line(space: Any, shape: Any, layer: str) -> None:
    draw = space.add_polyline3d if shape.has_z else space.add_lwpolyline
    draw(_coordinates(shape, shape.has_z).tolist(), dxfattribs={"layer": layer})


def _draw_polygon(space: Any, shape: Any, layer: str) -> None:
    for ring in (shape.exterior, *shape.interiors):
        places = _coordinates(ring, False)[:-1].tolist()
        space.add_lwpolyline(places, close=True, dxfattribs={"layer": layer})


_DRAWN: dict[str, Callable[[Any, Any, str], None]] = {
    "Point": _draw_point, "LineString": _draw_line, "Polygon": _draw_polygon,
}  # fmt: skip


def _write_text(space: Any, shape: Any, text: str, layer: str) -> None:
    """Write the name of a feature at its first vertex."""
    at = _coordinates(shape, False)[0].tolist()
    space.add_text(text, height=TEXT_HEIGHT, dxfattribs={"layer": layer, "insert": at})
