# SPDX-License-Identifier: BSD-3-Clause
"""Layers given as GeoDataFrames or similar objects (a shapely `geometry`, a `crs`, columns). They
are written to temporary files while a scene is read, and then handled as files."""

import shutil
import weakref
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import numpy as np

from rockfall.case import FROM_ARRAY, Case, key_table
from rockfall.errors import RockfallError, need
from rockfall.io.zone_table import MATERIAL
from rockfall.language import Text, say
from rockfall.scene.scene import Scene

GROUPS = {"lines": "line", "barriers": "barrier", "dams": "dam"}  # layer -> case group
KEYS = {
    "zones": ("surface", "zones"), "trees": ("forest", "trees"), "stands": ("forest", "polygons"),
    "clearings": ("forest", "clearings"),
}  # fmt: skip
PLACES = {"x", "y", "cells", "polygons", "polygons_layer", "points", "points_layer"}
SIZES = {"uniform_mean_radius", "uniform_rg", "mean_radius", "rg70", "rg20", "rg10"}
SOURCES = {"Polygon": ("release", "polygons"), "Point": ("release", "points")}


def is_frame(given: Any) -> bool:
    """Return True for a GeoDataFrame or a similar object."""
    return hasattr(given, "geometry") and hasattr(given, "columns")


class FrameFiles:
    """Temporary files of frames, kept until they are removed or their owner is deleted. A frame
    that is written again keeps its file."""

    def __init__(self) -> None:
        self._folder: Path | None = None
        self._known: dict[str, tuple[Any, Path]] = {}
        self._written = 0

    def write(self, frames: Mapping[str, Any]) -> dict[str, Path]:
        """Write these frames; return the files by name."""
        for name, frame in frames.items():
            if name not in self._known or self._known[name][0] is not frame:
                self._known[name] = frame, _write(frame, name, self._next_folder())
        return {name: self._known[name][1] for name in frames}

    def remove(self) -> None:
        if self._folder is not None:
            self._remove()
            self._folder = None
        self._known.clear()

    def _next_folder(self) -> Path:
        """A new empty folder, in which a file can have the name of its frame."""
        if self._folder is None:
            self._folder = Path(mkdtemp())
            self._remove = weakref.finalize(self, shutil.rmtree, self._folder, True)
        self._written += 1
        folder = self._folder / str(self._written)
        folder.mkdir()
        return folder


@contextmanager
def frame_files(
    frames: Mapping[str, Any], store: FrameFiles | None = None
) -> Iterator[dict[str, Path]]:
    """Write frames to files; yield the files by name. The files are removed after the block or, if
    a `store` is given, with the store. In errors, the names of frames replace those of files."""
    own = store or FrameFiles()
    try:
        files = own.write(frames)
        try:
            yield files
        except RockfallError as error:
            raise RockfallError(of_frames(str(error), files), error.code) from error
    finally:
        if store is None:
            own.remove()


def of_frames(text: str, files: Mapping[str, Path]) -> str:
    """Replace file names in a text by the names of the frames; a remark stays a remark."""
    if isinstance(text, Text) and text.key == "input.remark":
        return _of_frames(text, files)
    for name, file in files.items():
        text = text.replace(str(file), f"{name} = (GeoDataFrame)")
    return text


def _of_frames(remark: str, files: Mapping[str, Path]) -> Text:
    assert isinstance(remark, Text)
    where, text = (remark.values[name] for name in ("where", "text"))
    return say("input.remark", where=of_frames(where, files), text=text)


def with_frames(
    frames: Mapping[str, Any],
    case: Case,
    read: Callable[[Case], Scene],
    store: FrameFiles | None = None,
) -> Scene:
    """Read the scene of a case with layers from frames. Layers in GROUPS are added to the case;
    others (zones, trees, stands, clearings, sources) replace its own."""
    keys = {name: _key(name, frame) for name, frame in frames.items() if name not in GROUPS}
    if "zones" in frames and _says_ground(frames["zones"], case.surface["zone_field"]):
        case = case.replace(surface={"table": None})
    with frame_files(frames, store) as files:
        scene = read(_naming(case, files, keys))
    changes: dict[str, dict[str, Any]] = {}
    for group, key in keys.values():
        changes.setdefault(group, {})[key] = FROM_ARRAY
    return scene.replace(
        case=scene.case.replace(**changes),
        remarks=tuple(_of_frames(remark, files) for remark in scene.remarks),
        checksums={of_frames(key, files): checksum for key, checksum in scene.checksums.items()},
    )


def _write(frame: Any, name: str, folder: Path) -> Path:
    """Write a frame as a FlatGeobuf, in row order and with reproducible bytes. Refuses empty and
    unreadable frames."""
    need("GeoDataFrames need", "vector")
    import pyogrio
    import shapely

    path, crs = folder / f"{name}.fgb", frame.crs
    columns = [k for k, column in enumerate(frame.columns) if column != frame.geometry.name]
    try:
        shapes = shapely.to_wkb(np.array(frame.geometry, object))
        if not len(shapes):
            raise RockfallError(f"{name}: the GeoDataFrame is empty")
        pyogrio.raw.write(
            path, shapes, [_column(frame.iloc[:, k]) for k in columns],
            [str(frame.columns[k]) for k in columns], geometry_type="Unknown",
            crs=None if crs is None else crs.to_wkt(), driver="FlatGeobuf", SPATIAL_INDEX="NO",
        )  # fmt: skip
    except (TypeError, ValueError, RuntimeError, AttributeError) as error:
        if isinstance(error, RockfallError):
            raise
        raise RockfallError(f"{name}: cannot be read as a GeoDataFrame ({error})") from error
    return path


def _column(column: Any) -> np.ndarray:
    """Column as numbers (NaN if missing) or texts (None if missing), for a file."""
    if column.dtype.kind in "iu" and not column.isna().any():
        return column.to_numpy(np.int64)
    if column.dtype.kind in "iuf":
        return column.to_numpy(np.float64, na_value=np.nan)
    return np.array([None if raw is None or raw != raw else str(raw) for raw in column], object)


def _key(name: str, frame: Any) -> tuple[str, str]:
    """Case group and key of a layer; refuses unknown layers."""
    if name in KEYS:
        return KEYS[name]
    if name != "sources":
        raise RockfallError(
            f"{name}: unknown layer: must be one of {', '.join([*GROUPS, *KEYS, 'sources'])}"
        )
    keys = {(key.group, key.name) for key in key_table()}
    kinds = {shape.geom_type.removeprefix("Multi") for shape in frame.geometry if shape is not None}
    key = SOURCES.get(kinds.pop()) if len(kinds) == 1 else None
    if key not in keys:
        allowed = " or ".join(f"{kind}s" for kind, key in SOURCES.items() if key in keys)
        raise RockfallError(f"sources: must be {allowed}")
    return key


def _says_ground(frame: Any, field: str) -> bool:
    """Return True if zones have ground attributes but no table id."""
    columns = {str(column).lower() for column in frame.columns}
    return field.lower() not in columns and not columns.isdisjoint(MATERIAL)


def _naming(case: Case, files: Mapping[str, Path], keys: Mapping[str, tuple[str, str]]) -> Case:
    """Case with these files, without the keys that they replace or that select a replaced layer."""
    groups: dict[str, Any] = {}
    if "sources" in files:
        groups["release"] = dict.fromkeys(PLACES & case.release.keys())
    if "zones" in files:
        groups["surface"] = dict.fromkeys(SIZES & case.surface.keys())
    for name, file in files.items():
        if name in GROUPS:
            groups[GROUPS[name]] = [*getattr(case, GROUPS[name]), {"file": str(file)}]
        else:
            group, key = keys[name]
            own = {f"{key}_layer": None} if f"{key}_layer" in getattr(case, group) else {}
            groups.setdefault(group, {}).update({**own, key: str(file)})
    return case.replace(**groups)
