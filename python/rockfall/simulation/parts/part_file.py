# SPDX-License-Identifier: BSD-3-Clause
"""Part files (docs/part_file.md): results of some boulders of a run, with tallies that can be
added. Checkpoints, results of shards and results of `rockfall-batch` are part files."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rockfall._core import rockfall_f2py as _core
from rockfall.case import Case, case_in
from rockfall.errors import RockfallError
from rockfall.grounds import GroundRule
from rockfall.io.input_warnings import InputWarning
from rockfall.io.netcdf import open_netcdf
from rockfall.io.rasters.grid import Box, Grid
from rockfall.result import variables
from rockfall.result.contents import Contents
from rockfall.result.dataset import DAMAGED, georeference
from rockfall.scene.forest.trees import Stand
from rockfall.scene.parts import Features
from rockfall.simulation.parts.split_sources import SHARED
from rockfall.simulation.run_state import Run
from rockfall.simulation.tally import Origin
from rockfall.simulation.tally_dataset import described, run_attributes, trajectory_variables
from rockfall.terrain.dams import DamShape

if TYPE_CHECKING:
    from rockfall.result.contents import Held
    from rockfall.simulation.tally import Tally

LAYOUT = int(_core.constant("part_layout"))  # layout version of the file
BEFORE = "tally_"  # name prefix of tallies
CLOCKS = ("wall_seconds", "cpu_seconds")
NUMBERS = ("boulders_requested", "boulder_first", "boulder_last", "threads")
LAYOUT_OF = {"part": "sample_part_last", "group": "sample_group_part"}  # dimensions of samples
LENGTHS = ("status", "tally_cell", "tally_shared_cell", "sample_block", "sample_group_bin",
           "crossing_boulder")  # fmt: skip
OWN = (  # dimensions whose lengths depend on the part
    "boulder", "tally", "tally_shared", "sample_part", "sample_group", "sample_entry",
    "sample_group_entry", "crossing",
)  # fmt: skip
SUMS = ("input_checksums", "decoded_checksums")
#: Optional attributes of a part.
USUAL = {
    "date_created": "", "source_features": None, "block_shapes": None, "grounds": None,
    "input_warnings": "[]", "dams": "[]", "stands": "[]", "lines_beyond": "{}",
}  # fmt: skip
PACKING = int(_core.constant("max_packing"))  # maximum compression ratio of zlib


# ---- From a tally


def make_part(tally: Tally) -> Contents:
    """Part with the completed boulders of a tally; its arrays are views, valid until the next part
    is made."""
    tally.settle()
    try:
        tally.run.pack_part()
    finally:
        tally.settle(-1)
    grid, box = tally.scene.grid, tally.window
    window = [box.column, box.row, *box.shape[::-1]]
    data = described(tally.part_arrays())
    data |= trajectory_variables(tally.trajectories)
    data["crs"] = ((), np.int32(0), georeference(grid))
    places: dict[str, Any] = {
        "terrain_cells": np.array([grid.nx, grid.ny], "i4"),
        "map_window": np.array(window, "i4"),
    }
    if tally.scene.grounds:
        radii = [ground.block_radius for ground in tally.scene.grounds]
        places["ground_block_radius"] = np.array(radii)
    return Contents(data, {"part_layout": LAYOUT} | run_attributes(tally) | places)


# ---- To a tally


@dataclass
class Part:
    """A part that was read; its values are checked when loaded."""

    name: str  # used in messages
    origin: Origin
    first: int  # first boulder
    last: int
    threads: int
    clocks: dict[str, float]
    crs: dict[str, Any]  # attributes of the grid mapping
    date: str = ""  # date of writing; "": unknown
    arrays: dict[str, np.ndarray] = field(default_factory=dict)

    def empty_run(self, before: int, boulders: int) -> Run:
        """Kernel run with room for `boulders` of this part's run, after the first `before`."""
        origin = self.origin
        layout = (self.arrays.get(name, np.zeros(1, "i4")) for name in LAYOUT_OF.values())
        return Run.joined(
            origin.case, (origin.boulders, before, boulders), origin.window,
            len(origin.grounds), origin.features is not None, bool(origin.shapes), *layout,
        )  # fmt: skip

    def loaded_run(self) -> Run:
        """Kernel run with the results of this part."""
        run = self.empty_run(self.first - 1, self.last - self.first + 1)
        self.load(run)
        return run

    def load(self, run: Run) -> None:
        """Store the part in an empty run that begins with the part's boulders. The caller must then
        join or restore the cells of split sources. Raises a RockfallError for values that are
        impossible in a run."""
        arrays, boulders = self.arrays, self.last - self.first + 1
        lengths = [arrays[name].size if name in arrays else -1 for name in LENGTHS]
        run.begin_part(boulders, lengths, self.name)
        for array in run.part_arrays():
            own, values = arrays[array.file_name], array.values
            if "boulder" in array.dims:
                values = values[..., : own.shape[-1]]
            if values.shape != own.shape:
                raise _damaged(self, array.file_name)
            values[...] = own
        run.unpack_part(self.name, self.origin.grid)

    def shared(self) -> dict[str, np.ndarray]:
        """Cells reached from sources that the part splits; {} if no map needs them."""
        if f"{BEFORE}shared_cell" not in self.arrays:
            return {}
        return {name: self.arrays[BEFORE + name] for name in SHARED}

    def trajectories(self) -> dict[int, np.ndarray]:
        """Vertices by boulder number."""
        if "trajectory_boulder" not in self.arrays:
            return {}
        rows = np.stack(
            [self.arrays[f"trajectory_{name}"] for name in variables.fields("vertex")], axis=1
        )
        numbers, begins = np.unique(self.arrays["trajectory_boulder"], return_index=True)
        return dict(zip(numbers.tolist(), np.split(rows, begins[1:]), strict=True))


# ---- From a file


def boulders_in(path: Path) -> int | None:
    """Number of boulders in a part; None for any other file."""
    try:
        with _opened(path) as file:
            if getattr(file, "part_layout", None) != LAYOUT:
                return None
            return int(file.boulder_last) - int(file.boulder_first) + 1
    except (RockfallError, *DAMAGED):
        return None


def read_part(part: Held | str | Path) -> Part:
    """Read a part from a Dataset or a file; raises a RockfallError if it is not a part, or if
    variables have unexpected shapes. Files are read directly, because xarray would take several
    times as long."""
    if not isinstance(part, str | Path):
        head = _head(part.attrs, part["crs"].attrs if "crs" in part else {}, "a part")
        held: Mapping[Any, Any] = part.variables
        shapes = {name: (array.dtype, array.dims, array.shape) for name, array in held.items()}
        _check_shapes(head, shapes, None)
        head.arrays = {name: held[name].values for name in shapes}
    else:
        try:
            with _opened(part) as file:
                head = _read_file(part, file)
        except RockfallError:
            raise
        except FileNotFoundError as error:
            raise RockfallError(f"{part}: no such file") from error
        except DAMAGED as error:
            raise RockfallError(f"{part}: is damaged: {error}") from error
    _check_trajectories(head)
    return head


@contextmanager
def _opened(path: str | Path) -> Iterator[Any]:
    with open_netcdf(path) as file:
        file.set_auto_maskandscale(False)
        yield file


def _read_file(path: str | Path, file: Any) -> Part:
    attrs = {name: file.getncattr(name) for name in file.ncattrs()}
    grid = file.variables.get("crs")
    crs = {name: grid.getncattr(name) for name in grid.ncattrs()} if grid is not None else {}
    head = _head(attrs, crs, str(path))
    shapes = {
        name: (np.dtype(variable.dtype), variable.dimensions, variable.shape)
        for name, variable in file.variables.items()
    }
    _check_shapes(head, shapes, os.path.getsize(path))
    for name in shapes:
        try:
            head.arrays[name] = file.variables[name][...]
        except DAMAGED as error:
            raise _damaged(head, name) from error
    return head


def _damaged(part: Part, what: str) -> RockfallError:
    return RockfallError(f"{part.name}: is damaged: {what}")


def _head(attrs: Mapping[str, Any], crs: Mapping[str, Any], name: str) -> Part:
    """Metadata of a part without values; refuses other files."""
    if attrs.get("part_layout") != LAYOUT:
        raise RockfallError(
            f"{name}: is not a part of a run (from --shard, a checkpoint or rockfall-batch)"
        )
    values = USUAL | dict(attrs)

    def read(at: str, parse: Callable[[Any], Any]) -> Any:
        try:
            return parse(values[at])
        except DAMAGED as error:
            raise RockfallError(f"{name}: is damaged: {at}") from error

    boulders, first, last, threads = (read(at, _number) for at in NUMBERS)
    clocks = {at: read(at, _seconds) for at in CLOCKS}
    read("date_created", when)
    values["GeoTransform"] = crs.get("GeoTransform")
    corner = read("GeoTransform", _corner)
    grid = read("terrain_cells", lambda cells: _grid(corner, *cells))
    window = read("map_window", lambda cells: _window(grid, *map(int, cells)))
    checksums, decoded = (read(at, _checksums) for at in SUMS)
    origin = Origin(
        case=read("case", lambda text: _case(str(text), str(values["case_file"]))),
        boulders=boulders,
        grid=grid,
        window=window,
        checksums=checksums,
        decoded=decoded,
        version=read("version", str),
        features=read("source_features", _features),
        shapes=read("block_shapes", lambda names: str(names or "").split()),
        grounds=read("grounds", lambda _: _grounds(attrs)),
        warnings=read("input_warnings", lambda rows: [*map(InputWarning.of, json.loads(rows))]),
        dams=read("dams", lambda rows: [DamShape(**row) for row in json.loads(rows)]),
        stands=read("stands", lambda rows: [Stand(*row) for row in json.loads(rows)]),
        beyond=read("lines_beyond", json.loads),
    )
    crs = {key: v for key, v in crs.items() if key not in ("_FillValue", "GeoTransform")}
    part = Part(name, origin, first, last, threads, clocks, crs, str(values["date_created"]))
    if not 1 <= first <= last + 1 <= boulders + 1:
        raise _damaged(part, "boulders")
    return part


# Values of attributes; an invalid value raises a ValueError, or another error in DAMAGED.


def _number(value: Any) -> int:
    if not 0 <= int(value) < 2**31:
        raise ValueError
    return int(value)


def _seconds(value: Any) -> float:
    if not 0 <= float(value) < math.inf:
        raise ValueError
    return float(value)


def _corner(transform: Any) -> tuple[float, float, float]:
    """West, north and cell size [m] of a GeoTransform; a ValueError for other transforms."""
    west, cell, _, north, _, _ = map(float, str(transform).split())
    if not (cell > 0 and all(map(math.isfinite, (west, cell, north)))):
        raise ValueError
    return west, north, cell


def _grid(corner: tuple[float, float, float], columns: Any, rows: Any) -> Grid:
    return Grid(*corner, int(columns), int(rows))


def _window(grid: Grid, column: int, row: int, columns: int, rows: int) -> Box:
    inside = 0 <= column <= column + columns <= grid.nx and 0 <= row <= row + rows <= grid.ny
    if not inside:
        raise ValueError
    return Box(row, column, row + rows, column + columns)


def _checksums(text: Any) -> dict[str, str]:
    return {str(key): str(digest) for key, digest in json.loads(text).items()}


def _features(names: Any) -> Features | None:
    return None if names is None else Features(str(names).split("\n"), np.zeros(0, "i4"))


def when(date: str) -> datetime:
    """Time from an attribute `date_created` (ISO 8601); the earliest time if empty; raises
    ValueError if invalid."""
    if not date:
        return datetime.min.replace(tzinfo=UTC)
    moment = datetime.fromisoformat(date)
    return moment if moment.tzinfo else moment.replace(tzinfo=UTC)


def _grounds(attrs: Mapping[str, Any]) -> list[GroundRule]:
    """Grounds with name, model and block radius; empty if the scene has only impact sets."""
    if "grounds" not in attrs:
        return []
    names, models = (str(attrs[name]).split("\n") for name in ("grounds", "ground_models"))
    radii = np.atleast_1d(attrs["ground_block_radius"])
    return [
        GroundRule(name, model, block_radius=float(radius))
        for name, model, radius in zip(names, models, radii, strict=True)
    ]


@lru_cache(maxsize=8)
def _case(text: str, file: str) -> Case:
    return case_in({"case": text, "case_file": file})


@lru_cache(maxsize=8)
def _table(
    case: Case, boulders: int, grounds: int, features: bool, shapes: bool
) -> tuple[dict[str, tuple[Any, tuple[str, ...]]], dict[str, int]]:
    """Type and dimensions of each variable in a part of a case, and the lengths that do not depend
    on the part."""
    run = Run.joined(
        case, (boulders, 0, 0), Box(0, 0, 0, 0), grounds, features, shapes, *np.zeros((2, 1), "i4")
    )
    table: dict[str, tuple[Any, tuple[str, ...]]] = {"crs": ("i4", ())}
    shape: dict[str, int] = {}
    run.begin_part(0, (0,) * len(LENGTHS), "")
    for array in run.part_arrays():
        table[array.file_name] = array.values.dtype, array.dims
        shape |= dict(zip(array.dims, array.values.shape, strict=True))
    for dim in OWN:
        shape.pop(dim, None)
    return table, shape


def _check_shapes(
    part: Part,
    shapes: dict[str, tuple[np.dtype, tuple[str, ...], tuple[int, ...]]],
    size: int | None,
) -> None:
    """Check that all variables of the case are present with the right types and lengths, in a file
    of sufficient `size` [bytes]; other variables are dropped."""
    origin = part.origin
    has = origin.features is not None, bool(origin.shapes)
    table, known_lengths = _table(origin.case, origin.boulders, len(origin.grounds), *has)
    expected, lengths = {**table}, {**known_lengths}
    if "sample_ended" not in expected:  # all boulders of the part have rows
        lengths["boulder"] = part.last - part.first + 1
    if "trajectory_boulder" in shapes:
        for name, kind in variables.TYPES["vertex"].items():
            expected[f"trajectory_{name}"] = kind, ("trajectory_vertex",)
    for name in sorted(set(shapes) - set(expected)):
        del shapes[name]
    for name, (kind, dims) in expected.items():
        dtype, own_dims, shape = shapes.get(name, (None, (), ()))
        if dtype != kind or own_dims != dims:
            raise _damaged(part, name)
        for dim, length in zip(dims, shape, strict=True):
            if length != lengths.setdefault(dim, length):
                raise _damaged(part, name)
        if size is not None and math.prod(shape) > PACKING * size:
            raise _damaged(part, name)


def _check_trajectories(part: Part) -> None:
    """Check that vertices are finite, ordered, and belong to boulders of the part."""
    vertices = {name: part.arrays[name] for name in part.arrays if name.startswith("trajectory_")}
    for name, values in vertices.items():
        if not np.isfinite(values).all():
            raise _damaged(part, name)
    if vertices:
        numbers = vertices["trajectory_boulder"]
        inside = (numbers >= part.first) & (numbers <= part.last)
        if not (np.diff(numbers) >= 0).all() or not inside.all():
            raise _damaged(part, "trajectory_boulder")
