# SPDX-License-Identifier: BSD-3-Clause
"""Layers of a project, from the files and styles in a folder."""

import re
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

from rockfall.files.vector_style import TABLE
from rockfall.language import localised, word

#: Labels of map classes in `rockfall.result.maps.classes`.
CLASS = re.compile(r"(?:up to (\S+)|(\S+) to (\S+)|above (\S+)) (\S+)")
LABELLED = "label"  # attribute with user text in styles and their elements


class Layer(NamedTuple):
    """A layer: title, source relative to the project, style as XML elements, and flags for initial
    visibility and printed legends."""

    title: str
    source: str
    style: ElementTree.Element
    visible: bool = False
    in_legend: bool = True

    @property
    def id(self) -> str:
        """Id of the layer in the project, unique for its source and style."""
        renderer = next((node.get("type", "") for node in self.style.iter("rasterrenderer")), "")
        return re.sub(r"\W+", "_", f"{self.source.removeprefix('./')} {renderer}").strip("_")

    @property
    def is_raster(self) -> bool:
        return self.source.endswith(".tif")


class Group(NamedTuple):
    """A group of layers, topmost first."""

    title: str
    layers: tuple[Layer, ...]
    expanded: bool = True


def raster_layer(path: Path, title: str, **options: bool) -> Layer:
    """Layer of a GeoTIFF with the style (.qml) next to it."""
    style = ElementTree.parse(path.with_suffix(".qml")).getroot()
    return Layer(title, f"./{path.name}", _translated(style), **options)


def vector_styles(path: Path) -> dict[str, str]:
    """Style text by layer name, for the layers of a GeoPackage that have a style."""
    with closing(sqlite3.connect(path)) as database:
        return dict(database.execute(f"SELECT f_table_name, styleQML FROM {TABLE}"))


def vector_layer(path: Path, name: str, style: str, title: str, **options: bool) -> Layer:
    """Layer of a GeoPackage with a style from its style table."""
    root = _translated(ElementTree.fromstring(style))
    return Layer(title, f"./{path.name}|layername={name}", root, **options)


def _translated(style: ElementTree.Element) -> ElementTree.Element:
    """Style with legend labels in the current language; limits of classes are written with
    signs."""
    for element in style.iter():
        if label := element.get(LABELLED):
            match = CLASS.fullmatch(label)
            element.set(LABELLED, _class(match) if match else word(label.replace(" ", "_")))
    return style


def _class(match: re.Match[str]) -> str:
    """Label of a class between limits, such as <= 10 kJ, 10 - 30 kJ, > 30 kJ."""
    most, low, high, least, unit = match.groups()
    ends = f"\u2264 {most}" if most else f"> {least}" if least else f"{low} \u2013 {high}"
    return f"{localised(ends)} {word(unit)}"
