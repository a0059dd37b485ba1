# SPDX-License-Identifier: BSD-3-Clause
"""Layers as KML 2.2 (OGC 07-147r2), for Google Earth and similar viewers."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any, TextIO
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from rockfall.files.geographic import Geographic
from rockfall.files.vector_style import Style, Symbol, paint
from rockfall.io.atomic import atomic_write

#: Geometry types with heights; the viewer drapes the others on its ground.
IN_THE_AIR = ("LineString ZM",)
NAMING = ("name", "object", "hazard")  # attributes that name a feature, in order of preference
DOT = "http://maps.google.com/mapfiles/kml/shapes/shaded_dot.png"
HEAD = '<?xml version="1.0" encoding="UTF-8"?>\n<kml xmlns="http://www.opengis.net/kml/2.2">\n'


def write_kml(
    path: Path,
    layers: Mapping[str, tuple],
    title: str,
    way: Geographic,
    styles: Mapping[str, Style],
) -> Path:
    """Write layers as folders of a KML file, atomically: degrees, with heights unchanged."""
    text = (
        f"Trajectory heights: DEM in metres (vertical datum: {way.heights}), read by KML as above "
        f"EGM96. All else on the ground. Places: {way.crs} to WGS 84."
    )
    with atomic_write(path) as part, open(part, "w", encoding="utf-8") as file:
        file.write(f"{HEAD}<Document><name>{_text(title)}</name>")
        file.write(f"<description>{_text(text)}</description>\n")
        for name, (kind, features) in layers.items():
            _write_folder(file, name, kind, features, way, styles.get(name))
        file.write("</Document></kml>\n")
    return path


def _write_folder(
    file: TextIO, name: str, kind: str, parts: Iterable[tuple], way: Geographic, style: Style | None
) -> None:
    """Write the styles and features of a layer."""
    import shapely

    file.write(f"<Folder><name>{_text(name)}</name>\n")
    symbols = list(style.symbols) if style and style.kind != "graduatedSymbol" else []
    for k, (_, _, symbol) in enumerate(symbols):
        file.write(f'<Style id="{name}{k}">{_drawn(symbol)}</Style>\n')
    numbers = {str(value): k for k, (value, *_) in enumerate(symbols)}
    mode = "absolute" if kind in IN_THE_AIR else "clampToGround"
    for shapes, fields in parts:
        shapes = shapely.from_wkb(shapes) if kind.endswith(" ZM") else shapes
        rows = zip(*(column.tolist() for column in fields.values()), strict=True)
        for shape, values in zip(shapes, rows, strict=True):
            if shape is None or shape.is_empty:
                continue
            row = dict(zip(fields, values, strict=True))
            number = numbers.get(str(row.get(style.field, "")) if style and style.field else "")
            file.write("<Placemark>")
            file.write(f"<name>{_text(_title(row))}</name>{_span(row)}")
            if number is not None:
                file.write(f"<styleUrl>#{name}{number}</styleUrl>")
            file.write(f"{_attributes(row)}{_geometry(shape, way, mode)}</Placemark>\n")
    file.write("</Folder>\n")


def _title(row: Mapping[str, Any]) -> str:
    """Title of a feature: its name, its class, or the value in the first column."""
    first = next(iter(row), "")
    own = (row.get(key) for key in NAMING)
    return str(next((name for name in own if name), f"{first} {row.get(first, '')}"))


def _span(row: dict[str, Any]) -> str:
    """Time span of a feature whose `row` has times, which are removed from it. The feature stays
    hidden until played, because it would cover its trajectory."""
    if not isinstance(row.get("begin"), datetime):
        return ""
    begin, end = (f"{row.pop(key).isoformat(timespec='microseconds')}Z" for key in ("begin", "end"))
    span = f"<TimeSpan><begin>{begin}</begin><end>{end}</end></TimeSpan>"
    return f"<visibility>0</visibility>{span}"


def _attributes(row: Mapping[str, Any]) -> str:
    """Non-missing attributes of a feature."""
    given = ((key, value) for key, value in row.items() if value is not None and value == value)
    data = "".join(
        f"<Data name={quoteattr(key)}><value>{_text(value)}</value></Data>" for key, value in given
    )
    return f"<ExtendedData>{data}</ExtendedData>"


def _geometry(shape: Any, way: Geographic, mode: str) -> str:
    """KML geometry of a shape, in degrees."""
    parts = list(getattr(shape, "geoms", [shape]))
    drawn = [_SHAPES[part.geom_type](part, way, mode) for part in parts]
    if len(drawn) == 1:
        return drawn[0]
    return f"<MultiGeometry>{''.join(drawn)}</MultiGeometry>"


def _point(shape: Any, way: Geographic, mode: str) -> str:
    return f"<Point><altitudeMode>{mode}</altitudeMode>{_places(shape, way)}</Point>"


def _line(shape: Any, way: Geographic, mode: str) -> str:
    flat = "<tessellate>1</tessellate>" if mode == "clampToGround" else ""
    mode = f"<altitudeMode>{mode}</altitudeMode>"
    return f"<LineString>{flat}{mode}{_places(shape, way)}</LineString>"


def _polygon(shape: Any, way: Geographic, mode: str) -> str:
    rings = [("outer", shape.exterior), *(("inner", ring) for ring in shape.interiors)]
    drawn = "".join(
        f"<{side}BoundaryIs><LinearRing>{_places(ring, way)}</LinearRing></{side}BoundaryIs>"
        for side, ring in rings
    )
    return f"<Polygon><altitudeMode>{mode}</altitudeMode>{drawn}</Polygon>"


_SHAPES: dict[str, Callable[[Any, Geographic, str], str]] = {
    "Point": _point, "LineString": _line, "LinearRing": _line, "Polygon": _polygon,
}  # fmt: skip


def _places(shape: Any, way: Geographic) -> str:
    """Coordinates as text: longitude and latitude (about 0.1 mm), height (1 mm)."""
    import shapely

    xyz = way.degrees(shapely.get_coordinates(shape, include_z=True))
    return f"<coordinates>{' '.join(_triples(xyz))}</coordinates>"


def _triples(xyz: np.ndarray) -> Iterator[str]:
    for longitude, latitude, height in xyz.tolist():
        yield f"{longitude:.9f},{latitude:.9f}" + (f",{height:.3f}" if height == height else "")


def _drawn(symbol: Symbol) -> str:
    """Style of points, lines and areas in a colour."""
    red, green, blue = paint(symbol)
    colour = f"{blue:02x}{green:02x}{red:02x}"
    opaque = f"{round(255 * symbol.opacity):02x}"
    width = 3 if float(str(symbol.options.get("line_width", 0))) >= 0.5 else 1.5
    return (
        f"<IconStyle><color>ff{colour}</color><scale>0.5</scale>"
        f"<Icon><href>{DOT}</href></Icon></IconStyle><LabelStyle><scale>0</scale></LabelStyle>"
        f"<LineStyle><color>ff{colour}</color><width>{width}</width></LineStyle>"
        f"<PolyStyle><color>{opaque}{colour}</color></PolyStyle>"
    )


def _text(value: object) -> str:
    """Value as XML text, escaped and without invalid characters."""
    return escape("".join(sign for sign in str(value) if sign in "\t\n" or sign >= " "))
