# SPDX-License-Identifier: BSD-3-Clause
"""Surroundings of the edited document: objects of a layer, such as houses, and stands of forest."""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from rockfall.analysis.objects.object_layers import files_of, given_layers
from rockfall.analysis.objects.objects import named_layers
from rockfall.app.edited.features import MAX_FEATURES, MAX_VERTICES
from rockfall.app.messages import Message, text_message
from rockfall.case import FROM_ARRAY, Case
from rockfall.errors import RockfallError
from rockfall.io.vectors.layers import EXTENSIONS, layer_names, read_polygons
from rockfall.io.zone_table import NAMES
from rockfall.language import say

if TYPE_CHECKING:
    from rockfall.io.rasters.grid import Grid

MAX_OFFERED = 40  # layers of a folder


class Given(NamedTuple):
    """Layers given by the user in addition to the opened file."""

    objects: Sequence[Path] = ()
    objects_layer: Sequence[str] = ()


class Offer(NamedTuple):
    """A choice of object layers, with its label on the page."""

    label: str
    files: Sequence[Path]
    layers: Sequence[str] = ()


def offered_objects(folder: Path, given: Given) -> list[Offer]:
    """Object layers that the page can choose: those given, then all in a folder."""
    offers = []
    if given.objects:
        names = [*(file.name for file in given.objects), *given.objects_layer]
        offers.append(Offer(", ".join(names), given.objects, given.objects_layer))
    for file in sorted(path for path in folder.iterdir() if path.suffix.lower() in EXTENSIONS):
        names = []
        with suppress(RockfallError, OSError):  # another kind of file
            names = layer_names(file)
        several = len(names) > 1
        offers += [
            Offer(f"{file.name}: {name}" if several else file.name, [file], [name] * several)
            for name in names
        ]
    return offers[:MAX_OFFERED]


def objects_message(offer: Offer | None, grid: Grid) -> Message:
    """Message `objects`: names, as in a hazard, and shapes; empty without an offer. Raises
    RockfallError if a layer cannot be read.
    """
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
    """Forest stands of a case with their names; empty if their layer cannot be found."""
    import shapely

    given = case.forest.get("polygons", FROM_ARRAY)
    if given == FROM_ARRAY:
        return []
    try:
        layer = case.forest.get("polygons_layer")
        shapes, columns = read_polygons(case.path(given), grid, [], layer, "polygons_layer")
    except RockfallError:  # of a result that was moved
        return []
    named = next((column for column in map(columns.get, NAMES) if column is not None), None)
    names = [""] * len(shapes) if named is None else [str(name) for name in named]
    return [
        {"name": name, "geometry": json.loads(shapely.to_geojson(shapely.force_2d(shape)))}
        for name, shape in zip(names, shapes, strict=True)
    ]
