# SPDX-License-Identifier: BSD-3-Clause
"""Objects at risk: number of boulders that hit each object, and the resulting cost.

A boulder hits an object when its side touches the object in plan. Lines and outlines become
evaluation lines with the width of the object, at which a boulder counts once; so do points with a
width. The hits of a point without a width are those of its map cell (&hazard object_width).
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from rockfall.analysis.hazard.classes import Frequencies
from rockfall.analysis.objects.attributes import Layer
from rockfall.analysis.objects.exposure import Exposure, joined, read_exposure
from rockfall.analysis.objects.object_layers import File, distinct_names
from rockfall.analysis.objects.vulnerability import SHIPPED, Curve
from rockfall.case import Case, check_all_kept
from rockfall.errors import RockfallError
from rockfall.io.rasters.grid import Grid
from rockfall.io.vectors.layers import plain, read_features
from rockfall.io.vectors.polygons import points_inside
from rockfall.io.vectors.unused_attributes import note_marks, note_unused
from rockfall.language import Text, remark
from rockfall.result.crossings import line_values
from rockfall.result.samples import check_all_rows
from rockfall.scene.scene import Scene
from rockfall.simulation.memory import BYTES_AT_LINE, ROOM, machine_memory

#: Attribute for all intensities, or with suffix _1, _2, ... for each.
VULNERABILITY = "vulnerability"
MAX_NAMED = 5  # maximum objects listed in a remark


@dataclass
class Objects:
    """Objects at risk (points, lines and polygons) with their attributes."""

    paths: list[str] = field(default_factory=list)  # paths of the layers
    layers: list[str] = field(default_factory=list)  # layer name of each object
    shapes: np.ndarray = field(default_factory=lambda: np.empty(0, object))
    names: list[str] = field(default_factory=list)
    lines: list[dict[str, Any]] = field(default_factory=list)  # evaluation lines, as in a case
    #: Object number of each line.
    owner: np.ndarray = field(default_factory=lambda: np.empty(0, int))
    point: np.ndarray = field(default_factory=lambda: np.empty(0, int))  # points without a width
    #: x and y of these points [m].
    places: np.ndarray = field(default_factory=lambda: np.empty((0, 2)))
    vulnerability: np.ndarray | None = None  # (objects, intensities)
    exposure: np.ndarray = field(default_factory=lambda: np.empty(0))
    value: np.ndarray = field(default_factory=lambda: np.empty(0))
    exposed: Exposure = field(default_factory=Exposure)  # exposed persons and property

    def __len__(self) -> int:
        return len(self.shapes)


def read_objects(
    files: Sequence[File],
    grid: Grid,
    thresholds: np.ndarray,
    remarks: list[str],
    curves: Mapping[str, Curve] = SHIPPED,
) -> Objects:
    """Read the objects in layers: vulnerability by curve or by intensity between the thresholds
    [J], and exposed persons and values."""
    all_objects = []
    for file, (layer, own) in zip(files, named_layers(files, grid, remarks), strict=True):
        objects = Objects([str(file.path)], [file.label] * len(own), layer.shapes, own)
        widths = layer.layer.numbers("width", np.nan, missing=True)
        for number, (shape, width) in enumerate(zip(layer.shapes, widths.tolist(), strict=True)):
            _place(objects, number, shape, width, grid)
        objects.exposure = layer.layer.numbers("exposure", 1.0)
        objects.value = layer.layer.numbers("value", 1.0)
        steps = layer.layer.by_intensity(VULNERABILITY, thresholds.size + 1)
        objects.vulnerability = steps if len(steps) else None
        without_energy = objects.point.tolist()
        objects.exposed = read_exposure(layer.layer, own, thresholds, curves, without_energy)
        used = {*layer.layer.asked, "name"}
        note_unused(remarks, file.path, layer.layer.columns, sorted(used))
        note_marks(remarks, file.path, layer.layer.columns, sorted(used))
        remarks += layer.layer.unit_remarks()
        remarks += layer.layer.idle_remarks()
        remarks += _doubts(objects, layer.layer)
        all_objects.append(objects)
    return _joined(all_objects)


def _doubts(objects: Objects, layer: Layer) -> Iterator[str]:
    """Remarks on values without a vulnerability, and on duplicate objects with equal attributes
    (different objects at one place may be flats in a house)."""
    if layer.has("value") and objects.vulnerability is None and not objects.exposed:
        yield remark(layer.path, "input.value_unused")
    columns = [column for name, column in layer.columns.items() if name not in {"name", "fid"}]
    first: dict[Hashable, str] = {}
    again = [
        (name, before)
        for name, shape, *row in zip(objects.names, objects.shapes, *columns, strict=True)
        if (before := first.setdefault((shape.wkb, *map(str, row)), name)) is not name
    ]
    if again:
        (name, before), *_ = again
        yield remark(layer.path, "input.object_again", n=len(again), name=name, before=before)


def named_layers(
    files: Sequence[File], grid: Grid, remarks: list[str]
) -> list[tuple[Read, list[str]]]:
    """Layers with shapes and object names; a name that occurs in several layers includes the layer
    name."""
    read = [_read(file, grid, remarks) for file in files]
    names = distinct_names([layer.names for layer in read], [file.label for file in files])
    return list(zip(read, names, strict=True))


class Read(NamedTuple):
    """A layer with its shapes and object names."""

    layer: Layer
    shapes: np.ndarray
    names: list[str]


def _read(file: File, grid: Grid, remarks: list[str]) -> Read:
    import shapely

    shapes, columns = read_features(file.path, grid, remarks, file.layer, "--objects-layer")
    for number in [k for k, shape in enumerate(shapes, 1) if shape.geom_type == "MultiPoint"][:1]:
        raise RockfallError(
            f"{file.path}: feature {number}: has several points: split it into one object per point"
        )
    columns = {name.lower(): values for name, values in columns.items()}
    given = [plain(name) for name in columns.get("name", [None] * len(shapes))]
    names = [str(number if name is None else name) for number, name in enumerate(given, start=1)]
    return Read(Layer(str(file.path), columns, len(shapes)), shapely.force_2d(shapes), names)


def _joined(parts: Sequence[Objects]) -> Objects:
    """Combine the objects of several layers; vulnerability is NaN in layers without it."""
    objects = Objects()
    before = 0
    for part in parts:
        objects.paths += part.paths
        objects.layers += part.layers
        objects.names += part.names
        objects.lines += part.lines
        objects.owner = np.append(objects.owner, before + part.owner)
        objects.point = np.append(objects.point, before + part.point)
        before += len(part)
    for name in ("shapes", "places", "exposure", "value"):
        setattr(objects, name, np.concatenate([getattr(part, name) for part in parts]))
    steps = [part.vulnerability for part in parts]
    if given := [step for step in steps if step is not None]:
        intensities = given[0].shape[1]
        objects.vulnerability = np.concatenate([
            np.full((len(part), intensities), np.nan) if step is None else step
            for part, step in zip(parts, steps, strict=True)
        ])  # fmt: skip
    objects.exposed = joined([(part.exposed, len(part)) for part in parts])
    for k, (owner, line) in enumerate(
        zip(objects.owner.tolist(), objects.lines, strict=True), start=1
    ):
        line["name"] = f"object {owner + 1} part {k}"
    return objects


def beyond_elevations(shapes: Iterable[Any], scene: Scene) -> np.ndarray:
    """Mask of shapes with a vertex off the known terrain, where boulders stop."""
    import shapely

    grid, cells, is_beyond = scene.grid, scene.rasters, []
    for shape in shapes:
        x, y = shapely.get_coordinates(shape).T
        inside = (grid.west <= x) & (x <= grid.east) & (grid.south <= y) & (y <= grid.north)
        row, column = (k - begin for k, begin in zip(grid.cells(x, y), cells.at, strict=True))
        valid = (0 <= row) & (row < cells.z.shape[0]) & (0 <= column) & (column < cells.z.shape[1])
        is_beyond.append(
            not inside.all() or bool(np.isnan(cells.z[row[valid], column[valid]]).any())
        )
    return np.array(is_beyond, bool)


def beyond_remarks(objects: Objects, scene: Scene) -> Iterator[Text]:
    """Remark on objects with a vertex off the known terrain."""
    beyond = beyond_elevations(objects.shapes, scene)
    names = [name for name, lies in zip(objects.names, beyond, strict=True) if lies]
    if names:
        shown = [*names[:MAX_NAMED], *["..."] * (len(names) > MAX_NAMED)]
        where = ", ".join(objects.paths)
        yield remark(where, "input.objects_beyond", n=len(names), names=shown)


def source_remarks(objects: Objects, scene: Scene) -> Iterator[str]:
    """Remark on objects that contain boulder sources, or have sources within half their width."""
    width = np.full(len(objects), scene.case.hazard["object_width"])
    width[objects.owner] = [line["object_width"] for line in objects.lines]
    grounds = [shape.buffer(w / 2) for shape, w in zip(objects.shapes, width.tolist(), strict=True)]
    inside = {k: on for k, on in points_inside(np.array(grounds), scene.x, scene.y) if on.size}
    if inside:
        n, name = np.unique(np.concatenate([*inside.values()])).size, objects.names[min(inside)]
        place = ", ".join(objects.paths)
        yield remark(place, "input.sources_on_object", n=n, name=name, objects=len(inside))


def check_kept(case: Case, lines: int) -> None:
    """Raise a RockfallError before a run with lines if it would not keep all boulder rows."""
    if lines:
        check_all_kept(case, "objects with a width, lines, polygons and segments of roads need")


def check_room(paths: Sequence[str], lines: int, boulders: int) -> None:
    """Raise a RockfallError if the boulders at all lines would need more than half the memory."""
    need = BYTES_AT_LINE * lines * boulders
    if need > ROOM * machine_memory():
        raise RockfallError(
            f"{', '.join(paths)}: {lines:,} lines and outlines with {boulders:,} boulders need "
            f"{need / 1e9:.1f} GB, more than half of the memory: give fewer objects or boulders"
        )


def _place(objects: Objects, number: int, shape: Any, width: float, grid: Grid) -> None:
    """Add the evaluation lines, or the cell, of an object on the terrain; `width` may be NaN.
    Refuses objects outside the terrain."""
    west, south, east, north = shape.bounds
    if not (
        west <= grid.east and east >= grid.west and south <= grid.north and north >= grid.south
    ):
        raise RockfallError(f"{objects.paths[0]}: feature {number + 1}: lies outside the terrain")
    if shape.geom_type == "Point" and np.isnan(width):
        objects.point = np.append(objects.point, number)
        objects.places = np.vstack([objects.places, [[shape.x, shape.y]]])
        return
    for part in getattr(shape, "geoms", [shape]):
        curve = part.exterior if part.geom_type == "Polygon" else part
        x, y = np.array(curve.coords)[[0, 0] if part.geom_type == "Point" else slice(None)].T
        # The name is set when layers are combined.
        attrs = {"name": "", "object_width": 0.0 if np.isnan(width) else width}
        objects.lines.append(attrs | {"x": x.tolist(), "y": y.tolist()})
        objects.owner = np.append(objects.owner, number)


def object_hits(objects: Objects, result: xr.Dataset) -> Iterator[tuple[int, np.ndarray]]:
    """Yield the index of each object with evaluation lines, and the largest energy [J] and centre
    height [m] of each boulder at these lines (2, boulders); NaN if the boulder misses the
    object."""
    for number in np.unique(objects.owner):
        check_all_rows(result, "an object that is a line")
        hits = np.full((2, result.sizes["boulder"]), np.nan)
        for line in np.flatnonzero(objects.owner == number):
            for row, quantity in zip(hits, ("energy_total", "passing_height"), strict=True):
                row[:] = np.fmax(row, line_values(result, quantity, int(line)))
        yield int(number), hits


def object_counts(
    objects: Objects,
    energies: Mapping[int, np.ndarray],
    thresholds: np.ndarray,
    grid: Grid,
    maps: np.ndarray,
) -> np.ndarray:
    """Number of boulders that hit each object, and number above each energy threshold [J]:
    (intensities, objects). `energies` are the energies [J] of the hits on objects with lines, by
    object number; `maps` are the counts by cell (intensities, y, x), for all other objects."""
    counts = np.zeros((1 + thresholds.size, len(objects)), "i4")
    rows, columns = grid.cells(*objects.places.T)
    counts[:, objects.point] = maps[:, rows, columns]
    for number, energy in energies.items():
        counts[0, number] = energy.size
        counts[1:, number] = (energy > thresholds[:, None]).sum(axis=1)
    return counts


def risks(objects: Objects, frequencies: Frequencies) -> Frequencies | None:
    """Annual risk of each object: sum over intensities of frequency x vulnerability x exposure x
    value. Its limits follow from the limits of the frequencies, because vulnerability does not
    decrease with intensity."""
    if objects.vulnerability is None:
        return None
    # Increase from the next lower intensity.
    more = np.diff(objects.vulnerability, axis=1, prepend=0.0).T
    worth = objects.exposure * objects.value
    value, low, high = ((more * rate).sum(axis=0) * worth for rate in frequencies)
    return Frequencies(value, low, high)
