# SPDX-License-Identifier: BSD-3-Clause
"""Surroundings of a document: objects such as houses, a basemap, forest stands."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from rockfall.analysis.objects.object_layers import files_of, given_layers
from rockfall.analysis.objects.objects import named_layers
from rockfall.app.edited.features import MAX_FEATURES, MAX_VERTICES
from rockfall.app.messages import Message, binary_message, text_message
from rockfall.app.pictures import View
from rockfall.case import FROM_ARRAY, Case
from rockfall.errors import RockfallError
from rockfall.io.coordinates.crs import plan_wkt
from rockfall.io.rasters.grid import Grid
from rockfall.io.vectors.layers import EXTENSIONS, layer_names, read_polygons
from rockfall.io.zone_table import NAMES
from rockfall.language import say
from rockfall.plots.cartography.basemap import read_picture

MAX_OFFERED = 40  # maximum layers or pictures of a folder
MAX_DOTS = 2400  # maximum pixels on the longer side of a picture
PICTURES = {".tif", ".tiff", ".png", ".jpg", ".jpeg", ".img"}


class Given(NamedTuple):
    """Layers and a basemap that the user gives in addition to the opened file."""

    objects: Sequence[Path] = ()
    objects_layer: Sequence[str] = ()
    basemap: Path | None = None
    wms: str = ""  # URL of a web map service


class Offer(NamedTuple):
    """An object layer that the page can choose, with its label."""

    label: str
    files: Sequence[Path]
    layers: Sequence[str] = ()


class Offers(NamedTuple):
    """Object layers and basemaps that the page can choose, by label."""

    objects: dict[str, Offer]
    basemaps: dict[str, Path]

    @classmethod
    def of(cls, folder: Path, given: Given) -> Offers:
        """Offers from the given layers and pictures, followed by those in a folder."""
        pictures = [] if given.basemap is None else [given.basemap]
        pictures += sorted(path for path in folder.iterdir() if path.suffix.lower() in PICTURES)
        basemaps = {path.name: path for path in reversed(pictures[:MAX_OFFERED])}
        objects = {offer.label: offer for offer in offered_objects(folder, given)}
        return cls(objects, dict(reversed(basemaps.items())))

    @property
    def labels(self) -> dict[str, list[str]]:
        """Labels in the form sent to the page."""
        return {"objects": [*self.objects], "basemaps": [*self.basemaps]}

    def messages(self, new: View, before: View, grid: Grid) -> Iterator[tuple[str, Message]]:
        """Messages for choices of a view that differ from the previous view, with their kinds."""
        if new.objects != before.objects:
            yield "objects", objects_message(self.objects.get(new.objects), grid)
        if new.basemap != before.basemap:
            yield "basemap", basemap_message(self.basemaps.get(new.basemap), new.basemap, grid)


def basemap_message(path: Path | None, label: str, grid: Grid) -> Message:
    """Message `basemap`: the part of a picture on the terrain, transparent outside the picture.
    Raises a RockfallError if it is unreadable, or if the picture or the terrain has no CRS."""
    if path is None:
        return binary_message("basemap", {}, chosen="")
    if grid.crs is None:
        raise RockfallError(f"{path.name}: a basemap needs a terrain with a CRS")
    extent = grid.west, grid.east, grid.south, grid.north
    picture = read_picture(path, plan_wkt(grid.crs), extent, MAX_DOTS, stretched=True)
    alpha = np.where(picture.seen, 255, 0).astype("u1")
    rgba = np.concatenate([picture.colours, alpha[..., None]], axis=2)
    return binary_message("basemap", {"rgba": rgba}, chosen=label, extent=extent)


def offered_objects(folder: Path, given: Given) -> list[Offer]:
    """Object layers for the page: the given layers, then all layers in a folder."""
    offers = []
    if given.objects:
        names = [*(file.name for file in given.objects), *given.objects_layer]
        offers.append(Offer(", ".join(names), given.objects, given.objects_layer))
    for file in sorted(path for path in folder.iterdir() if path.suffix.lower() in EXTENSIONS):
        names = []
        with suppress(RockfallError, OSError):  # not an object layer
            names = layer_names(file)
        several = len(names) > 1
        offers += [
            Offer(f"{file.name}: {name}" if several else file.name, [file], [name] * several)
            for name in names
        ]
    return offers[:MAX_OFFERED]


def objects_message(offer: Offer | None, grid: Grid) -> Message:
    """Message `objects`: name and shape of each object of the chosen layer, none if `offer` is
    None. Names are those of hazard results. Raises a RockfallError for an unreadable layer."""
    import shapely

    remarks: list[str] = []
    entries = []
    if offer is not None:
        files = files_of(given_layers([*offer.files], [*offer.layers]), {})
        for layer, names in named_layers(files, grid, remarks):
            if len(names) > MAX_FEATURES or shapely.get_num_coordinates(layer.shapes).sum() > (
                MAX_VERTICES
            ):
                limits = {"features": MAX_FEATURES, "vertices": MAX_VERTICES}
                raise RockfallError(say("app.server_too_large", **limits))
            entries += [
                {"name": name, "geometry": json.loads(shapely.to_geojson(shape))}
                for name, shape in zip(names, layer.shapes, strict=True)
            ]
    label = "" if offer is None else offer.label
    return text_message("objects", chosen=label, objects=entries, remarks=remarks)


def stands_of(case: Case, grid: Grid) -> list[dict[str, Any]]:
    """Names and outlines of the forest stands of a case; empty without a readable layer."""
    import shapely

    given = case.forest.get("polygons", FROM_ARRAY)
    if given == FROM_ARRAY:
        return []
    try:
        layer = case.forest.get("polygons_layer")
        shapes, columns = read_polygons(case.path(given), grid, [], layer, "polygons_layer")
    except RockfallError:  # the result file was moved
        return []
    named = next((column for column in map(columns.get, NAMES) if column is not None), None)
    names = [""] * len(shapes) if named is None else [str(name) for name in named]
    return [
        {"name": name, "geometry": json.loads(shapely.to_geojson(shapely.force_2d(shape)))}
        for name, shape in zip(names, shapes, strict=True)
    ]
