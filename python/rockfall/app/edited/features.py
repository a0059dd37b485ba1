# SPDX-License-Identifier: BSD-3-Clause
"""Features drawn on the map: checks of the data sent by the page, and layers made from them. A live
run and saved files use the same layers."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from rockfall.app.edited.forms import REST, Form, check_value
from rockfall.app.messages import Refused
from rockfall.language import say

LAYERS = ("sources", "lines", "barriers", "dams", "zones")
SHAPES = {"sources": ("Point", "Polygon"), "zones": ("Polygon",)}  # other layers have LineString
MAX_FEATURES = 10_000
MAX_VERTICES = 200_000
MAX_PLACE = 1e9  # maximum coordinate [m]
_ID = re.compile("[a-z0-9]{1,16}")


class Feature(NamedTuple):
    """A shape with attributes; coordinates are nested as in GeoJSON, in the CRS of the DEM."""

    id: str
    type: str  # Point, LineString or Polygon
    coordinates: Any
    properties: dict[str, Any]

    def vertices(self) -> int:
        if self.type == "Point":
            return 1
        return len(self.coordinates) if self.type == "LineString" else sum(map(len, self.rings))

    @property
    def rings(self) -> Any:
        return self.coordinates

    def shape(self) -> Any:
        """The shape as a GEOS geometry."""
        import shapely

        if self.type == "Point":
            return shapely.Point(self.coordinates)
        if self.type == "LineString":
            return shapely.LineString(self.coordinates)
        return shapely.Polygon(self.rings[0], self.rings[1:])


def check_features(
    layer: str, given: Any, form: Form, before: Sequence[Feature] = ()
) -> list[Feature]:
    """Features of a layer as sent by the page: a complete list, or changes with `set` and `remove`.
    Raises Refused for invalid features."""
    remove: Any = []
    if isinstance(given, dict):
        remove, given = given.get("remove"), given.get("set")
    else:
        before = ()
    if not isinstance(given, list) or not isinstance(remove, list):
        raise Refused(say("app.server_wrong_type", name=layer), layer=layer)
    if not all(isinstance(id, str) for id in remove):
        raise Refused(say("app.server_wrong_type", name="remove"), layer=layer)
    if len(given) > MAX_FEATURES:
        raise Refused(say("app.server_too_many", name=layer), layer=layer)
    new = [_feature(layer, feature, form) for feature in given]
    by_id = {feature.id: feature for feature in new}
    if len(by_id) < len(new):
        raise Refused(say("app.server_same_id"), layer=layer)
    removed = {*remove}
    features = [by_id.pop(feature.id, feature) for feature in before if feature.id not in removed]
    features += by_id.values()
    if len({feature.type for feature in features}) > 1:
        raise Refused(say("app.server_mixed_shapes"), layer=layer)
    return features


def _feature(layer: str, given: Any, form: Form) -> Feature:
    if not isinstance(given, dict):
        raise Refused(say("app.server_wrong_type", name=layer), layer=layer)
    id = given.get("id")
    if not isinstance(id, str) or not _ID.fullmatch(id):
        raise Refused(say("app.server_wrong_type", name="id"), layer=layer)
    place = {"layer": layer, "id": id}
    kind, properties = given.get("type"), given.get("properties", {})
    if kind not in SHAPES.get(layer, ("LineString",)):
        raise Refused(say("app.server_wrong_shape"), **place)
    if not isinstance(properties, dict):
        raise Refused(say("app.server_wrong_type", name="properties"), **place)
    values = {}
    for name, value in properties.items():
        if name not in form:
            raise Refused(say("app.server_unknown", name=str(name)[:40]), **place)
        if value is not None and value != "":
            values[name] = check_value(form[name], value, **place, key=name)
    return Feature(id, kind, _coordinates(kind, given.get("coordinates"), place), values)


def _coordinates(kind: str, given: Any, place: dict[str, str]) -> Any:
    if kind == "Point":
        return _position(given, place)
    if kind == "LineString":
        return positions(given, 2, place)
    if not isinstance(given, list) or not 0 < len(given) <= MAX_VERTICES:
        raise Refused(say("app.server_wrong_shape"), **place)
    rings = [positions(ring, 4, place) for ring in given]
    if any(ring[0] != ring[-1] for ring in rings):
        raise Refused(say("app.server_wrong_shape"), **place)
    return rings


def positions(given: Any, least: int, place: dict[str, str]) -> list[list[float]]:
    """Vertices sent by the page; raises Refused, with their place, if invalid or fewer than
    `least`."""
    if not isinstance(given, list) or not least <= len(given) <= MAX_VERTICES:
        raise Refused(say("app.server_wrong_shape"), **place)
    return [_position(vertex, place) for vertex in given]


def _position(given: Any, place: dict[str, str]) -> list[float]:
    good = isinstance(given, list) and len(given) == 2
    for coordinate in given if good else ():
        number = isinstance(coordinate, int | float) and not isinstance(coordinate, bool)
        good = good and number and abs(coordinate) <= MAX_PLACE
    if not good:
        raise Refused(say("app.server_wrong_shape"), **place)
    return [float(coordinate) for coordinate in given]


def check_size(layers: Iterable[Sequence[Feature]]) -> None:
    """Raise Refused for more features or vertices than a page can edit."""
    features = [feature for layer in layers for feature in layer]
    vertices = sum(feature.vertices() for feature in features)
    if len(features) > MAX_FEATURES or vertices > MAX_VERTICES:
        raise Refused(say("app.server_too_large", features=MAX_FEATURES, vertices=MAX_VERTICES))


@dataclass(frozen=True)
class Layer:
    """Features of a layer in order, and the kinds of their attributes."""

    features: tuple[Feature, ...]
    kinds: tuple[tuple[str, str], ...]  # name and kind of each attribute, in order

    @classmethod
    def of(cls, features: Iterable[Feature], form: Form) -> Layer:
        """Layer of these features, with the attribute kinds of their form."""
        kinds = {name: field.kind for name, field in form.items()} | {REST: "logical"}
        return cls(tuple(features), tuple(kinds.items()))

    @property
    def geometry(self) -> str:
        return self.features[0].type

    def shapes(self) -> np.ndarray:
        """The shapes as GEOS geometries."""
        import shapely

        places = [feature.coordinates for feature in self.features]
        if self.geometry == "Point":
            return shapely.points(np.array(places))
        if self.geometry == "LineString":
            vertices, line = _joined(places)
            return shapely.linestrings(vertices, indices=line)
        rings, polygon = _joined(places)
        vertices, ring = _joined(rings)
        return shapely.polygons(shapely.linearrings(vertices, indices=ring), indices=polygon)

    def columns(self) -> dict[str, np.ndarray]:
        """Columns of attributes: reals, integers (reals if a value is missing) or texts."""
        given = {
            name for feature in self.features
            for name, value in feature.properties.items() if value is not None
        }  # fmt: skip
        return {
            name: _column(kind, [feature.properties.get(name) for feature in self.features])
            for name, kind in self.kinds if name in given
        }  # fmt: skip

    def groups(self) -> Iterator[dict[str, Any]]:
        """Line features as groups of a case."""
        for line in self.features:
            x, y = (list(axis) for axis in zip(*line.coordinates, strict=True))
            yield {**line.properties, "x": x, "y": y}

    def frame(self, crs: Any) -> Frame:
        """Layer in the form that `rockfall.open` accepts."""
        return Frame(self, crs)


def _joined(parts: Sequence[Sequence[Any]]) -> tuple[Any, np.ndarray]:
    """Concatenate the items of all parts; return the items and their part indices."""
    owner = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
    return [*chain.from_iterable(parts)], owner


def _column(kind: str, values: list[Any]) -> np.ndarray:
    missing = any(value is None for value in values)
    if kind == "integer" and not missing:
        return np.array(values, np.int64)
    if kind in ("real", "integer"):
        return np.array([np.nan if value is None else value for value in values], np.float64)
    column = np.empty(len(values), object)
    column[:] = [None if value is None else str(value) for value in values]
    return column


class Frame:
    """Minimal substitute for a GeoDataFrame, with the attributes used by
    `rockfall.scene.frames`."""

    def __init__(self, layer: Layer, crs: Any) -> None:
        shapes = pd.Series(layer.shapes(), dtype=object)
        table = pd.DataFrame({**layer.columns(), "geometry": shapes})
        self.crs, self.columns, self.iloc = crs, table.columns, table.iloc
        self.geometry = table["geometry"]
