# SPDX-License-Identifier: BSD-3-Clause
"""Recognition of a layer's use in a case from its shapes, attributes and name."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np

from rockfall.analysis.observed.observations import START
from rockfall.errors import RockfallError
from rockfall.io.rasters.grid import Grid
from rockfall.io.vectors.layers import EXTENSIONS, layer_names, plain, read_features
from rockfall.io.zone_table import MATERIAL
from rockfall.scene.forest.attributes import matching
from rockfall.scene.releases.source_attributes import VALUES

ZONES, SOURCES, LINES = "zones", "sources", "lines"
BARRIERS, DAMS, TREES, OBJECTS = "barriers", "dams", "trees", "objects"
STANDS = "stands"
BLOCKS, SCARS = "blocks at rest", "scars"
SEVERAL = {LINES: "line", BARRIERS: "barrier", DAMS: "dam"}  # groups that can be repeated
SYMBOLS = {"mean_radius": "r_m"}  # usual symbols of keys
WORDS = {  # name prefixes: English, German, French, Italian
    SOURCES: ("source", "cliff", "release", "scarp", "start", "quelle", "fels", "wand", "ausbruch",
              "abbruch", "anriss", "liefer", "falaise", "depart", "départ", "parete", "distacco",
              "innesco", "sorgent"),
    BARRIERS: ("barrier", "net", "fence", "wall", "netz", "zaun", "mauer", "filet", "mur", "rete",
               "muro"),
    DAMS: ("dam", "embankment", "bund", "digue", "merlon", "vallo", "rilevato"),
    TREES: ("tree", "stem", "baum", "arbre", "alber"),
    BLOCKS: ("deposit", "stopped", "fallen", "ablager", "abgelagert", "liegend", "dépos", "dépôt",
             "depos", "fermi", "cadut"),
    SCARS: ("scar", "impact", "witness", "silent", "narbe", "schlagmarke", "blessure", "cicatri",
            "impatt", "ferit"),
    OBJECTS: ("object", "house", "building", "objekt", "haus", "häus", "haeus", "geb",
              "maison", "batiment", "bâtiment", "edific", "casa", "case"),
}  # fmt: skip
AVAFRAME = re.compile(r"rel(?!ief)", re.IGNORECASE)  # start of the names of AvaFrame release areas
#: Attributes of sources.
OF_SOURCES = {"volume", "volume_class", "frequency", "block_shape", *VALUES} - {"density"}
NAMES = ("name", "bezeichnun", "nom", "nome", "label")  # attributes with feature names
IMPACT = "impact"  # attribute of scars
SHORT = 10  # maximum length of attribute names in shapefiles


@dataclass
class Layer:
    """A layer on the terrain, with attributes by lower-case name."""

    path: Path
    name: str
    alone: bool  # True for the only layer in its file
    shapes: np.ndarray
    own_names: dict[str, str]
    columns: dict[str, np.ndarray]
    remarks: list[str]  # remarks of the reader

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
        """Name of the attribute for a key; None if the layer lacks it."""
        names = (key, key[:SHORT], SYMBOLS.get(key))
        return next((name for name in names if name in self.columns), None)

    def values(self, key: str) -> list[Any]:
        """Values for a key, None for missing values; empty if no attribute matches."""
        name = self.attribute(key)
        return [] if name is None else [*map(plain, self.columns[name])]

    @property
    def name_column(self) -> str | None:
        """Attribute with feature names."""
        return next((name for name in NAMES if name in self.columns), None)

    def text(self, column: str | None, k: int) -> str:
        """Attribute of a feature as text; "" if it is empty or missing."""
        value = None if column is None else plain(self.columns[column][k])
        return "" if value is None else str(value).strip()

    def has(self, key: str) -> bool:
        """Return True if features have numbers for a key. Raises a RockfallError if only some have,
        because the use of the layer is then doubtful."""
        values = self.values(key)
        if all(value is None for value in values):
            return False
        for k, value in enumerate(values, start=1):
            if not isinstance(value, int | float):
                flaw = "is empty" if value is None else f"= {value!r} is not a number"
                raise RockfallError(
                    f"{self}: feature {k}: {self.own_names[str(self.attribute(key))]} {flaw}: all "
                    "features must have a number"
                )
        return True

    def is_called(self, kind: str) -> bool:
        """Return True if a word in the layer or file name indicates this kind."""
        if kind == SOURCES and AVAFRAME.match(self.path.stem):
            return True
        words = re.split(r"[\W\d_]+", f"{self.name} {self.path.stem}".lower())
        if kind == BLOCKS and "rest" in words:
            return True
        return any(word.startswith(WORDS[kind]) for word in words)


def read_layers(path: Path, grid: Grid) -> Iterator[Layer]:
    """Yield all layers of a file that have features on the terrain; refuses files with other
    extensions."""
    if path.suffix.lower() not in EXTENSIONS:
        raise RockfallError(
            f"{path}: is not a layer: its name must end in {', '.join(sorted(EXTENSIONS))}"
        )
    names = layer_names(path)
    for name in names:
        remarks: list[str] = []
        shapes, columns = read_features(path, grid, remarks, name)
        own = {column.lower(): column for column in columns}
        lower = {name.lower(): values for name, values in columns.items()}
        yield Layer(path, name, len(names) == 1, shapes, own, lower, remarks)


def kind_of(layer: Layer) -> tuple[str, str]:
    """Use of a layer ("" if unknown), and the reason."""
    if layer.shape == "Polygon":
        return _polygons(layer)
    if layer.shape == "Line":
        return _lines(layer)
    if layer.shape != "Point":
        return "", "points, lines and polygons are mixed: use one layer for each"
    if layer.attribute(IMPACT) and not layer.is_called(TREES):
        return SCARS, f"points with {IMPACT}"
    if layer.is_called(SCARS):
        return "", f"scars need an attribute {IMPACT}, a name or number"
    if {*START} <= layer.columns.keys():
        return BLOCKS, f"points with {', '.join(START)}"
    if layer.is_called(BLOCKS) and not layer.is_called(SOURCES):
        return BLOCKS, "points, by their name"
    if layer.has("dbh"):
        return TREES, "points with dbh"
    if layer.is_called(TREES):
        return "", "trees need an attribute dbh [cm]"
    if why := _why_sources(layer):
        return SOURCES, f"points{why}"
    return _other(layer, "points with dbh are trees, layers named source or cliff are sources")


def _polygons(layer: Layer) -> tuple[str, str]:
    given = [key for key in MATERIAL if layer.attribute(key)]
    if given:
        return ZONES, f"polygons with {', '.join(given)}"
    if matching("stems", layer.columns):
        return STANDS, f"polygons with {', '.join(matching('stems', layer.columns))}"
    if why := _why_sources(layer):
        return SOURCES, f"polygons{why}"
    return _other(
        layer,
        f"polygons with {', '.join(MATERIAL)} are zones, layers named source or cliff sources",
    )


def may_be_sources(layer: Layer, kind: str) -> bool:
    """Return True for a layer of unknown use, or lines named as sources: it may contain sources."""
    if layer.is_called(SOURCES):
        return kind in ("", LINES)
    return not kind and not any(map(layer.is_called, (TREES, SCARS)))


def _why_sources(layer: Layer) -> str:
    """Reason why points or polygons count as sources; "" if they do not."""
    given = [name for name in layer.columns if name in OF_SOURCES]
    return ", by their name" if layer.is_called(SOURCES) else f" with {given[0]}" if given else ""


def _lines(layer: Layer) -> tuple[str, str]:
    if not any(isinstance(value, str) for value in layer.values("diameter")):
        if layer.has("diameter"):
            return BARRIERS, "lines with diameter [cm]: lying logs"
    strengths = [layer.values(key) for key in ("capacity", "class")]
    capacities = any(value is not None for value in strengths[0])
    classes = layer.is_called(BARRIERS) or any(isinstance(k, int | float) for k in strengths[1])
    if capacities or (classes and any(strengths) and layer.values("height")):
        if not layer.has("height"):
            raise RockfallError(f"{layer}: lines with capacity are barriers: they need height [m]")
        for k, given in enumerate(zip_longest(*strengths), start=1):
            if not any(isinstance(value, int | float) for value in given):
                raise RockfallError(
                    f"{layer}: feature {k}: a barrier needs a number for capacity [kJ] or class"
                )
        return BARRIERS, "lines with height, and capacity or class"
    if layer.is_called(DAMS):
        if layer.has("height"):
            return DAMS, "lines with height, by their name"
        return LINES, "used as lines: a dam needs an attribute height [m]"
    if layer.is_called(BARRIERS):
        return LINES, (
            "used as lines: barriers need attributes height [m], and capacity [kJ] or class"
        )
    return LINES, "lines: crossings are recorded"


def _other(layer: Layer, rule: str) -> tuple[str, str]:
    if layer.is_called(OBJECTS):
        name = "" if layer.alone else f" --objects-layer {layer.name}"
        return OBJECTS, f"for `rockfall hazard --objects {layer.path}{name}`"
    return "", rule
