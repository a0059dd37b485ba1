# SPDX-License-Identifier: BSD-3-Clause
"""Recognition of the use of a layer in a case, by its shapes, its attributes and its name."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rockfall.errors import RockfallError
from rockfall.io.grid import Grid
from rockfall.io.layers import EXTENSIONS, layer_names, read_features
from rockfall.io.zone_table import RADII
from rockfall.scene.forest.attributes import matching

ZONES, SOURCES, LINES = "zones", "sources", "lines"
BARRIERS, DAMS, TREES, OBJECTS = "barriers", "dams", "trees", "objects"
STANDS = "stands"
SEVERAL = {LINES: "line", BARRIERS: "barrier", DAMS: "dam"}  # groups that may occur several times
OF_ZONES = (*RADII, "ground")  # attributes, of which zones have at least one
SYMBOLS = {"mean_radius": "r_m"}  # common field symbols for them
WORDS = {  # prefixes of names: English, German, French, Italian
    SOURCES: ("source", "cliff", "release", "scarp", "quelle", "fels", "wand", "ausbruch", "anriss",
              "falaise", "depart", "parete", "distacco", "sorgent"),
    BARRIERS: ("barrier", "net", "fence", "wall", "netz", "zaun", "mauer", "filet", "mur", "rete",
               "muro"),
    DAMS: ("dam", "embankment", "bund", "digue", "merlon", "vallo", "rilevato"),
    TREES: ("tree", "stem", "baum", "arbre", "alber"),
    OBJECTS: ("object", "house", "building", "objekt", "haus", "geb", "maison", "batiment",
              "edific", "casa"),
}  # fmt: skip
NAMES = ("name", "bezeichnun", "nom", "nome", "label")  # attributes with the name of a line
SHORT = 10  # maximum length of attribute names in a shapefile


@dataclass
class Layer:
    """A layer on the terrain; attributes by their lower-case names."""

    path: Path
    name: str
    alone: bool  # in its file
    shapes: np.ndarray
    own_names: dict[str, str]
    columns: dict[str, np.ndarray]

    def __str__(self) -> str:
        return str(self.path) if self.alone else f"{self.path}, layer {self.name}"

    @property
    def shape(self) -> str:
        """Point, Line or Polygon; "" if mixed."""
        kinds = {
            shape.geom_type.removeprefix("Multi").removesuffix("String") for shape in self.shapes
        }
        return kinds.pop() if len(kinds) == 1 else ""

    def attribute(self, key: str) -> str | None:
        """Name of the attribute that gives a key."""
        names = (key, key[:SHORT], SYMBOLS.get(key))
        return next((name for name in names if name in self.columns), None)

    def has(self, key: str) -> bool:
        """Return True if each feature has a number for a key."""
        name = self.attribute(key)
        if name is None or self.columns[name].dtype.kind not in "iuf":
            return False
        return not np.isnan(self.columns[name].astype(float)).any()

    def is_called(self, kind: str) -> bool:
        """Return True if a word in its name, or in its file's, indicates this kind."""
        words = re.split(r"[\W\d_]+", f"{self.name} {self.path.stem}".lower())
        return any(word.startswith(WORDS[kind]) for word in words)


def read_layers(path: Path, grid: Grid, remarks: list[str]) -> Iterator[Layer]:
    """All layers of a file, on the terrain."""
    if path.suffix.lower() not in EXTENSIONS:
        raise RockfallError(f"{path}: is no layer: must end in {', '.join(sorted(EXTENSIONS))}")
    names = layer_names(path)
    for name in names:
        shapes, columns = read_features(path, grid, remarks, name)
        own = {column.lower(): column for column in columns}
        lower = {name.lower(): values for name, values in columns.items()}
        yield Layer(path, name, len(names) == 1, shapes, own, lower)


def kind_of(layer: Layer) -> tuple[str, str]:
    """Use of a layer, "" if none; and a remark about it."""
    if layer.shape == "Polygon":
        return _polygons(layer)
    if layer.shape == "Line":
        return _lines(layer)
    if layer.shape != "Point":
        return "", "points, lines and polygons are mixed: one kind to a layer"
    if layer.has("dbh"):
        return TREES, "points with dbh"
    if layer.is_called(TREES):
        return "", "trees need an attribute dbh [cm]"
    if layer.is_called(SOURCES):
        return SOURCES, "points, by their name"
    return _other(layer, "points with dbh are trees, those named source or cliff are sources")


def _polygons(layer: Layer) -> tuple[str, str]:
    given = [key for key in OF_ZONES if layer.attribute(key)]
    if given:
        return ZONES, f"polygons with {', '.join(given)}"
    if matching("stems", layer.columns):
        return STANDS, f"polygons with {', '.join(matching('stems', layer.columns))}"
    if layer.is_called(SOURCES):
        return SOURCES, "polygons, by their name"
    return _other(
        layer, f"polygons with {', '.join(OF_ZONES)} are zones, those named source or cliff sources"
    )


def _lines(layer: Layer) -> tuple[str, str]:
    if layer.has("diameter"):
        return BARRIERS, "lines with diameter [cm]: lying logs"
    strong = layer.has("capacity") or layer.has("class")
    if strong and layer.has("height"):
        return BARRIERS, "lines with height, and capacity or class"
    if layer.is_called(DAMS):
        if layer.has("height"):
            return DAMS, "lines with height, by their name"
        return LINES, "for a dam they need an attribute height [m]: here they only record"
    if layer.is_called(BARRIERS):
        return LINES, (
            "for barriers they need attributes height [m], and capacity [kJ] or class: here they "
            "only record"
        )
    return LINES, "lines: crossings are recorded"


def _other(layer: Layer, rule: str) -> tuple[str, str]:
    if layer.is_called(OBJECTS):
        name = "" if layer.alone else f" --objects-layer {layer.name}"
        return OBJECTS, f"for `rockfall hazard --objects {layer.path}{name}`: no part of a case"
    return "", rule
