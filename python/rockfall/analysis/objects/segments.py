# SPDX-License-Identifier: BSD-3-Clause
"""Road segments: lines of a layer cut into pieces, which are objects that boulders may hit.

A segment with a width is a strip of ground with straight ends along its part of the axis. The
outline of the strip is an evaluation line without width: a boulder hits the segment as soon as its
side touches the strip. A boulder that touches two segments hits both; a boulder that crosses a
winding road twice counts at both places.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from rockfall.analysis.objects.at_risk import AtRisk
from rockfall.analysis.objects.attributes import Layer
from rockfall.analysis.objects.object_layers import File, only_layer
from rockfall.analysis.objects.objects import beyond_elevations
from rockfall.errors import RockfallError
from rockfall.io.vectors.layers import read_lines
from rockfall.io.vectors.polygons import points_inside
from rockfall.io.vectors.unused_attributes import note_marks, note_unused
from rockfall.language import remark, say, speaking
from rockfall.scene.frames import frame_files, is_frame, of_frames
from rockfall.scene.lines import numbered
from rockfall.scene.scene import Scene

KEY = "--segments-layer"
FRAME = "segments"  # layer name for a GeoDataFrame
TOUCHING = 1e-3  # maximum gap [m] between consecutive lines of the same road
SLIVER = 1e-6  # rounding area between strips, relative to their squared width
UNEQUAL = 2.0  # ratio of segment lengths above which their classes are not comparable
MIN_LENGTH = 1.0  # minimum segment length [m]
MAX_SEGMENTS = 20_000  # maximum number; each flight is tested against nearby segments


@dataclass
class Segments:
    """Pieces of roads, in the order of the layer."""

    path: str = ""
    roads: list[str] = field(default_factory=list)  # name of each segment's road
    names: list[str] = field(default_factory=list)  # feature name; "" if none
    start: np.ndarray = field(default_factory=lambda: np.empty(0))  # chainage of the start [m]
    end: np.ndarray = field(default_factory=lambda: np.empty(0))
    width: np.ndarray = field(default_factory=lambda: np.empty(0))  # [m]
    axes: list[Any] = field(default_factory=list)  # lines
    #: Mask of segments on the terrain.
    within: np.ndarray = field(default_factory=lambda: np.empty(0, bool))
    lines: list[dict[str, Any]] = field(default_factory=list)  # evaluation lines, as in a case
    #: Segment number of each line.
    owner: np.ndarray = field(default_factory=lambda: np.empty(0, int))

    def __len__(self) -> int:
        return len(self.axes)

    @property
    def labels(self) -> list[str]:
        """Segment names: road, start and end, in English."""
        with speaking("en"):
            return segment_names(self.roads, self.start, self.end)


class _Stretch(NamedTuple):
    """A line of a layer, and the number of its road."""

    road: int
    name: str
    width: float
    chainage: float  # chainage of the first vertex [m]
    axis: Any


class _Piece(NamedTuple):
    """A segment: its chainage [m], and the ground it covers."""

    stretch: _Stretch
    start: float
    end: float
    axis: Any
    ground: Any  # polygon; the axis for a line without a width


def segment_names(roads: Sequence[str], starts: np.ndarray, ends: np.ndarray) -> list[str]:
    """Unique names of segments between two chainages [m], in the current language."""
    places = zip(roads, starts.round(1), ends.round(1), strict=True)
    names = [say("hazard.stretch", road=road, start=start, end=end) for road, start, end in places]
    return list(numbered(names))


def check_roads(given: AtRisk) -> None:
    """Raise a RockfallError for segment lengths below 1 m, and for options without a layer."""
    length = given.segment_length
    if given.segments is None and (given.segments_layer is not None or length is not None):
        name = KEY if length is None else "--segment-length"
        raise RockfallError(f"{name} requires --segments")
    if length is not None and not MIN_LENGTH <= length < math.inf:
        raise RockfallError(f"--segment-length {length:g}: must be at least {MIN_LENGTH:g} m")


def roads_of(given: AtRisk, scene: Scene, remarks: list[str]) -> Segments:
    """Segments of the roads in a layer; none without a layer."""
    roads, layer = given.segments, given.segments_layer
    if roads is None:
        return Segments()
    own: list[str] = []
    with frame_files({FRAME: roads} if is_frame(roads) else {}) as files:
        path = files.get(FRAME, roads)
        file = File(path, layer, layer or only_layer(path))
        segments = read_segments(file, given.segment_length, scene, own)
    segments.path = of_frames(segments.path, files)
    remarks += [of_frames(path, files) for path in own]
    return segments


def read_segments(file: File, length: float | None, scene: Scene, remarks: list[str]) -> Segments:
    """Cut the lines of a layer into segments of a given length [m], or keep whole lines (None).
    Segments outside the terrain are omitted, with a remark. Raises a RockfallError for too many
    segments, or none on the terrain."""
    parts, columns = read_lines(file.path, file.layer, scene.grid, remarks, KEY)
    columns = {name.lower(): values for name, values in columns.items()}
    layer = Layer(str(file.path), columns, len(parts))
    stretches = list(_stretches(parts, layer))
    note_unused(remarks, file.path, columns, sorted(layer.asked))
    note_marks(remarks, file.path, columns, sorted(layer.asked))
    remarks += layer.unit_remarks()
    if length is None:
        remarks += _unequal(stretches, layer.path)
    number = sum(edges_along(stretch.axis.length, length).size - 1 for stretch in stretches)
    if number > MAX_SEGMENTS:
        raise RockfallError(
            f"{layer.path}: gives {number:,} segments: must be at most {MAX_SEGMENTS:,}: give a "
            "longer --segment-length"
        )
    roads = _roads(stretches, file.label)
    pieces = [piece for stretch in stretches for piece in _pieces(stretch, length, layer.path)]
    pieces = _on_terrain(pieces, scene, layer.path, remarks)
    segments = Segments(
        layer.path,
        [roads[piece.stretch.road] for piece in pieces],
        [piece.stretch.name for piece in pieces],
        np.array([piece.start for piece in pieces]),
        np.array([piece.end for piece in pieces]),
        np.array([piece.stretch.width for piece in pieces]),
        [piece.axis for piece in pieces],
        ~beyond_elevations([piece.ground for piece in pieces], scene),
    )
    remarks += _remarks(segments, pieces, layer, scene)
    for number, piece in enumerate(pieces):
        for curve in _outlines(piece.ground):
            x, y = np.array(curve.coords).T.tolist()
            name = f"segment {number + 1} part {len(segments.lines) + 1}"
            segments.lines.append({"name": name, "object_width": 0.0, "x": x, "y": y})
            segments.owner = np.append(segments.owner, number)
    return segments


def _remarks(
    segments: Segments, pieces: Sequence[_Piece], layer: Layer, scene: Scene
) -> Iterator[str]:
    """Remarks on reasons why the frequencies of segments may be too low."""
    if np.isnan(layer.numbers("width", np.nan, missing=True)).any():
        yield (
            f"{layer.path}: lines have no width, so only boulders that touch the axis count: give "
            "the attribute width"
        )
    if beyond := np.count_nonzero(~segments.within):
        numbers = {"n": int(beyond), "segments": len(segments)}
        yield remark(layer.path, "input.segments_beyond", **numbers)
    if on_road := _sources_on([piece.ground for piece in pieces if piece.stretch.width], scene):
        yield (
            f"{layer.path}: {on_road:,} sources are on the road, where resting boulders are not "
            "counted, so frequencies are too low: move the sources"
        )


def _unequal(stretches: Sequence[_Stretch], path: str) -> Iterator[str]:
    """Remark on lines with lengths that differ too much to compare their classes."""
    lengths = [stretch.axis.length for stretch in stretches]
    if max(lengths) > UNEQUAL * min(lengths):
        yield (
            f"{path}: segments are {min(lengths):,.4g} to {max(lengths):,.4g} m long, and longer "
            "segments are hit more often: use --segment-length to compare their classes"
        )


def _stretches(parts: Sequence[Sequence[np.ndarray]], layer: Layer) -> Iterator[_Stretch]:
    """Lines of a layer in turn. A line that begins where the previous line ends continues its road
    and chainage. With the attribute `chainage`, later lines of the same name also belong to the
    road."""
    import shapely

    given, names = layer.numbers("chainage", np.nan, missing=True), layer.texts("name")
    widths = np.nan_to_num(layer.numbers("width", 0.0, missing=True))
    before: _Stretch | None = None
    for k, feature in enumerate(parts):
        is_given = not math.isnan(given[k])
        if is_given and len(feature) > 1:
            rule = f"has {len(feature)} parts that are not connected: must be one line"
            layer.refuse(k, "chainage", f"{given[k]:g}", rule)
        for points in feature:
            axis = shapely.LineString(points)
            road, chainage = 0, float(given[k]) if is_given else 0.0
            if before is not None:
                goes_on = math.dist(before.axis.coords[-1], points[0]) <= TOUCHING
                is_same = goes_on or (is_given and names[k] != "" and names[k] == before.name)
                road = before.road if is_same else before.road + 1
                if goes_on and not is_given:
                    chainage = before.chainage + before.axis.length
            before = _Stretch(road, names[k], float(widths[k]), chainage, axis)
            yield before


def _roads(stretches: Sequence[_Stretch], label: str) -> list[str]:
    """Name of each road: the common name of its lines, else the layer name."""
    names: dict[int, set[str]] = {}
    for stretch in stretches:
        names.setdefault(stretch.road, set()).add(stretch.name)
    alike = (next(iter(values)) if len(values) == 1 else "" for values in names.values())
    return list(numbered([name or label for name in alike]))


def edges_along(length: float, step: float | None) -> np.ndarray:
    """Cut positions along a line [m]: multiples of a step, or only the ends (None). A remainder
    shorter than half a step is added to the previous piece, because a short piece would get too low
    a class."""
    number = 1 if step is None else max(1, math.floor(length / step + 0.5))
    return np.append((step or 0.0) * np.arange(number), length)


def _pieces(stretch: _Stretch, step: float | None, path: str) -> Iterator[_Piece]:
    from shapely.ops import substring

    edges = edges_along(stretch.axis.length, step)
    axes = [substring(stretch.axis, *ends) for ends in itertools.pairwise(edges)]
    grounds = strips_along(stretch.axis, axes, stretch.width) if stretch.width else axes
    chainage = stretch.chainage + edges
    for ends, axis, ground in zip(itertools.pairwise(chainage), axes, grounds, strict=True):
        yield _Piece(stretch, float(ends[0]), float(ends[1]), axis, ground)


def strips_along(whole: Any, axes: Sequence[Any], width: float) -> list[Any]:
    """Strips of ground with straight ends along parts of a line, which together cover the whole
    strip. The outer gap at a bend belongs to the first strip."""
    import shapely

    strips = [shapely.buffer(axis, width / 2, cap_style="flat") for axis in axes]
    left = shapely.buffer(whole, width / 2, cap_style="flat")
    left = shapely.difference(left, shapely.union_all(strips))
    for wedge in shapely.get_parts(left):
        if wedge.area > SLIVER * width**2:
            nearest = int(np.argmin(shapely.distance(strips, wedge)))
            strips[nearest] = shapely.union(strips[nearest], wedge)
    return strips


def _sources_on(grounds: Sequence[Any], scene: Scene) -> int:
    """Number of sources on the strips; their boulders need not cross an outline."""
    import shapely

    ground = np.array([shapely.union_all(grounds)])
    return sum(inside.size for _, inside in points_inside(ground, scene.x, scene.y))


def _outlines(ground: Any) -> Iterator[Any]:
    """Curves that a boulder touches first: the axis, or the outline of a strip. A closed road also
    has its inner outline, because boulders may come from inside."""
    for part in getattr(ground, "geoms", [ground]):
        yield from (part.exterior, *part.interiors) if part.geom_type == "Polygon" else (part,)


def _on_terrain(
    pieces: Sequence[_Piece], scene: Scene, path: str, remarks: list[str]
) -> list[_Piece]:
    """Segments at least partly on the terrain, with a remark on the others. Raises a RockfallError
    if no segment is on the terrain."""
    import shapely

    grid = scene.grid
    terrain = shapely.box(grid.west, grid.south, grid.east, grid.north)
    inside = [piece for piece in pieces if shapely.intersects(piece.ground, terrain)]
    if not inside:
        raise RockfallError(f"{path}: no segment lies on the terrain")
    if outside := len(pieces) - len(inside):
        remarks.append(
            f"{path}: {outside:,} of {len(pieces):,} segments lie outside the terrain and are left "
            "out"
        )
    return inside
