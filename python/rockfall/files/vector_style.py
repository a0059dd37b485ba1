# SPDX-License-Identifier: BSD-3-Clause
"""QGIS styles for layers of a GeoPackage, stored in its table `layer_styles`."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Iterable, Mapping
from contextlib import closing
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

from rockfall.result.maps.classes import STATUS_MARKERS, classes_of

TABLE = "layer_styles"
INK, BLUE, ROCK, EARTH = "#222222", "#0072b2", "#00604a", "#8c510a"
COLUMNS = (
    "f_table_catalog TEXT, f_table_schema TEXT, f_table_name TEXT, f_geometry_column TEXT, "
    "styleName TEXT, styleQML TEXT, styleSLD TEXT, useAsDefault BOOLEAN, description TEXT, "
    "owner TEXT, ui TEXT, update_time DATETIME DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ','now'))"
)
FROM_FIELDS = "2"  # QGIS mode: time range from two fields
#: Symbol types and the type of their single layer.
KINDS = {"Point": ("marker", "SimpleMarker"), "LineString": ("line", "SimpleLine"),
         "Polygon": ("fill", "SimpleFill")}  # fmt: skip
#: Marker shapes and rotations, as in the figures.
SHAPES = {
    ".": ("circle", 0), "x": ("cross2", 0), "^": ("triangle", 0), "s": ("square", 0),
    "+": ("cross", 0), "v": ("triangle", 180), "D": ("diamond", 0),
}  # fmt: skip


class Symbol(NamedTuple):
    """A symbol: properties of its single layer by QGIS name, and opacity."""

    options: Mapping[str, object]
    opacity: float = 1.0


class Style(NamedTuple):
    """Style of a layer: uniform, by the values of a field, or by intervals of an expression, each
    with a label and a symbol. Labels come from the field `named`; the temporal controller shows a
    feature between the times in the two fields `times`."""

    field: str
    symbols: Iterable[tuple[object, str, Symbol]]
    kind: str = "categorizedSymbol"
    times: tuple[str, str] | None = None
    named: str = ""


def alike(symbol: Symbol, named: str = "") -> Style:
    """Uniform style of all features, labelled from a field if given."""
    return Style("", [("", "", symbol)], "singleSymbol", named=named)


def marker(colour: str, shape: str = ".", size: float = 1.2) -> Symbol:
    """A point symbol of a given size [mm]."""
    name, angle = SHAPES[shape]
    return Symbol({"name": name, "angle": angle, "color": rgba(colour), "size": size,
                   "outline_color": rgba(colour),
                   "outline_width": 0.3 if angle or name != "circle" else 0.0,
                   "outline_style": "no" if name == "circle" else "solid"})  # fmt: skip


def fill(colour: str, pattern: str = "solid") -> Symbol:
    """An area symbol with a thin outline."""
    return Symbol({"color": rgba(colour), "style": pattern, "outline_color": rgba(INK),
                   "outline_width": 0.1}, 0.7)  # fmt: skip


def thick(colour: str) -> Symbol:
    """A thick line symbol."""
    return Symbol({"line_color": rgba(colour), "line_width": 0.8})


def plain_type(geometry: str) -> str:
    """Geometry type without its third dimension and multiplicity."""
    return geometry.removesuffix(" Z").removesuffix(" ZM").removeprefix("Multi")


def rgba(colour: str) -> str:
    """A colour in QGIS format."""
    return ",".join(str(int(colour[k : k + 2], 16)) for k in (1, 3, 5)) + ",255"


def paint(symbol: Symbol) -> tuple[int, int, int]:
    """Red, green and blue values of a symbol's colour."""
    colour = symbol.options.get("color") or symbol.options["line_color"]
    red, green, blue, _ = map(int, str(colour).split(","))
    return red, green, blue


def _graduated(expression: str, unit: str, symbol: Callable[[str], Symbol]) -> Style:
    """Style with a symbol for each class of an expression in a given unit."""
    classes = classes_of(unit)
    ends = [0.0, *classes.limits, 1e12]
    symbols = [
        (ends[k : k + 2], f"{label} {unit}", symbol(colour))
        for k, (label, colour) in enumerate(zip(classes.labels, classes.colours, strict=True))
    ]
    return Style(expression, symbols, "graduatedSymbol")


#: Styles for the layers of an exported result.
STYLES = {
    "sources": alike(marker(INK, "^", 1.4)),
    "source_areas": alike(Symbol({"color": rgba(ROCK), "style": "b_diagonal",
                                  "outline_color": rgba(ROCK), "outline_width": 0.4})),
    "stops": Style("status", [(name, name.replace("_", " "), marker(colour, shape))
                              for name, (shape, colour) in STATUS_MARKERS.items()]),
    "lines": alike(Symbol({"line_color": rgba(INK), "line_style": "dash", "line_width": 0.5}),
                   "name"),
    "barriers": alike(thick(BLUE)),
    "dams": alike(thick(EARTH)),
    "crossings": _graduated(
        '"energy_translational_kJ" + "energy_rotational_kJ"', "kJ", marker
    ),
    "trajectories": alike(Symbol({"line_color": rgba(BLUE), "line_width": 0.2}, 0.8)),
    "flights": _graduated('"speed_m_s"', "m/s", thick)._replace(times=("begin", "end")),
}  # fmt: skip


def put_styles(path: Path, layers: Mapping[str, str], styles: Mapping[str, Style]) -> None:
    """Write the styles and geometry types of layers into their GeoPackage."""
    kinds = {name: KINDS.get(plain_type(kind)) for name, kind in layers.items()}
    texts = {name: qml(styles[name], *kind) for name, kind in kinds.items()
             if kind and name in styles}  # fmt: skip
    with closing(sqlite3.connect(path)) as database, database:
        database.execute(
            f"CREATE TABLE {TABLE} (id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, {COLUMNS})"
        )
        database.execute(
            "INSERT INTO gpkg_contents (table_name, data_type, identifier) "
            "VALUES (?, 'attributes', ?)", [TABLE, TABLE]
        )  # fmt: skip
        database.executemany(
            f"INSERT INTO {TABLE} (f_table_catalog, f_table_schema, f_table_name, "
            "f_geometry_column, styleName, styleQML, styleSLD, useAsDefault, description, owner) "
            "VALUES ('', '', ?, 'geom', 'rockfall', ?, '', 1, '', '')",
            list(texts.items()),
        )


def qml(style: Style, kind: str, layer: str) -> str:
    """A style as QGIS XML, with symbols of a given type and layer type."""
    kinds = "Symbology|Temporal" if style.times else "Symbology"
    root = ElementTree.Element("qgis", version="3.16", styleCategories=kinds)
    if style.times:
        begin, end = style.times
        shown = {"enabled": "1", "mode": FROM_FIELDS, "startField": begin, "endField": end}
        ElementTree.SubElement(root, "temporal", shown)
    attrs = {"type": style.kind, "attr": style.field} if style.field else {"type": style.kind}
    renderer = ElementTree.SubElement(root, "renderer-v2", attrs)
    rules = ElementTree.SubElement(renderer, "ranges" if "grad" in style.kind else "categories")
    symbols = ElementTree.SubElement(renderer, "symbols")
    for k, (value, label, symbol) in enumerate(style.symbols):
        number = {"symbol": str(k), "label": label, "render": "true"}
        if style.kind == "graduatedSymbol":
            low, high = map(str, value)  # type: ignore[call-overload]
            ElementTree.SubElement(rules, "range", number | {"lower": low, "upper": high})
        elif style.field:
            ElementTree.SubElement(rules, "category", number | {"value": str(value)})
        symbols.append(symbol_element(str(k), kind, layer, symbol))
    if style.named:
        root.set("styleCategories", "Symbology|Labeling")
        root.set("labelsEnabled", "1")
        root.append(_labelling(style.named))
    return ElementTree.tostring(root, encoding="unicode")


def symbol_element(name: str, kind: str, layer: str, symbol: Symbol) -> ElementTree.Element:
    """A symbol as QGIS XML, with its type and layer type."""
    drawn = {"name": name, "type": kind, "alpha": str(symbol.opacity)}
    element = ElementTree.Element("symbol", drawn)
    node = ElementTree.SubElement(element, "layer", {"class": layer, "enabled": "1"})
    node = ElementTree.SubElement(node, "Option", type="Map")
    for key, text in symbol.options.items():
        ElementTree.SubElement(node, "Option", type="QString", name=key, value=str(text))
    return element


def _labelling(field: str) -> ElementTree.Element:
    """Labels of features from a field, with a white halo."""
    element = ElementTree.Element("labeling", type="simple")
    settings = ElementTree.SubElement(element, "settings", calloutType="simple")
    text = ElementTree.SubElement(settings, "text-style", {
        "fieldName": field, "fontFamily": "Arial", "fontSize": "8", "fontSizeUnit": "Point",
        "fontWeight": "75", "textColor": rgba(INK), "textOpacity": "1", "isExpression": "0",
    })  # fmt: skip
    ElementTree.SubElement(text, "text-buffer", {
        "bufferDraw": "1", "bufferSize": "0.8", "bufferSizeUnits": "MM", "bufferOpacity": "0.8",
        "bufferColor": rgba("#ffffff"), "bufferNoFill": "1", "bufferJoinStyle": "128",
    })  # fmt: skip
    ElementTree.SubElement(settings, "placement", placement="2", placementFlags="10", dist="1",
                           distUnits="MM", priority="5")  # fmt: skip
    ElementTree.SubElement(settings, "rendering", drawLabels="1", obstacle="1", displayAll="0")
    return element
