# SPDX-License-Identifier: BSD-3-Clause
"""Layers of a project, from the files of a folder and their styles there."""

import re
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

from rockfall.files.vector_style import TABLE
from rockfall.language import localised, word

#: Labels of classes of maps, in `rockfall.result.maps.classes`.
CLASS = re.compile(r"(?:up to (\S+)|(\S+) to (\S+)|above (\S+)) (\S+)")
LABELLED = "label"  # attribute of styles and their elements with a text for users


class Layer(NamedTuple):
    """A layer: title, source relative to the project, style as XML elements, and whether it is
    initially visible and in printed legends."""

    title: str
    source: str
    style: ElementTree.Element
    visible: bool = False
    in_legend: bool = True

    @property
    def id(self) -> str:
        """Name of the layer within the project, unique like its source and style."""
        renderer = next((node.get("type", "") for node in self.style.iter("rasterrenderer")), "")
        return re.sub(r"\W+", "_", f"{self.source.removeprefix('./')} {renderer}").strip("_")

    @property
    def is_raster(self) -> bool:
        return self.source.endswith(".tif")


class Group(NamedTuple):
    """A group of layers, top layer first."""

    title: str
    layers: tuple[Layer, ...]
    expanded: bool = True


def raster_layer(path: Path, title: str, **options: bool) -> Layer:
    """Layer of a GeoTIFF with the style (.qml) next to it."""
    style = ElementTree.parse(path.with_suffix(".qml")).getroot()
    return Layer(title, f"./{path.name}", _translated(style), **options)


def vector_styles(path: Path) -> dict[str, str]:
    """Style of each layer of a GeoPackage that has one, as text."""
    with closing(sqlite3.connect(path)) as database:
        return dict(database.execute(f"SELECT f_table_name, styleQML FROM {TABLE}"))


def vector_layer(path: Path, name: str, style: str, title: str, **options: bool) -> Layer:
    """Layer of a GeoPackage with a style from its table of styles."""
    root = _translated(ElementTree.fromstring(style))
    return Layer(title, f"./{path.name}|layername={name}", root, **options)


def _translated(style: ElementTree.Element) -> ElementTree.Element:
    """Style with the labels of its legend in the current language, classes by signs."""
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
