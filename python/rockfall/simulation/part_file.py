# SPDX-License-Identifier: BSD-3-Clause
"""Part files (docs/files.md): results of some boulders of a run, with tallies that sum to those of
the complete run. Checkpoints, results of shards and results of rockfall-batch are part files."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterator, Mapping
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
from rockfall.io.grid import Box, Grid
from rockfall.io.input_warnings import InputWarning
from rockfall.io.netcdf import open_netcdf
from rockfall.result import variables
from rockfall.result.contents import Contents
from rockfall.result.dataset import DAMAGED, georeference
from rockfall.result.samples import lengths, possible, sample_dims
from rockfall.result.validate import COUNT_AT_LINES, are_counts, are_crossings, out_of_range
from rockfall.scene.forest.trees import Stand
from rockfall.scene.parts import Features
from rockfall.simulation.maps import SHARED
from rockfall.simulation.run_state import Run
from rockfall.simulation.tally import Origin
from rockfall.simulation.tally_dataset import (
    run_attributes,
    sample_variables,
    table_variables,
    trajectory_variables,
)
from rockfall.terrain.dams import DamShape

if TYPE_CHECKING:
    from rockfall.result.contents import Held
    from rockfall.simulation.tally import Tally

LAYOUT = int(_core.constant("part_layout"))  # layout version of the file
STACKS = ("counts", "sums", "maxima")  # of maps, by layer
BEFORE = "tally_"  # prefix of the names of tallies
GROUPS = (  # of the table of variables
    "kept", "boulder", "energy", "feature", "mass", "tree", "breakage", "line", "fragment",
    "barrier", "count", "ground", "histogram",
)  # fmt: skip
CLOCKS = ("wall_seconds", "cpu_seconds")
NUMBERS = ("boulders_requested", "boulder_first", "boulder_last", "threads")
LAYOUT_OF = {"part": "sample_part_last", "group": "sample_group_part"}  # of samples
SUMS = ("input_checksums", "decoded_checksums")
PACKING = int(_core.constant("max_packing"))  # maximum compression ratio of zlib


# ---- from a tally


def make_part(tally: Tally) -> Contents:
    """Part with the completed boulders of a tally, which may continue."""
    shared = tally.settle()
    try:
        arrays = tallies(tally) | shared
    finally:
        tally.settle(-1)
    grid, box = tally.scene.grid, tally.window
    window = [box.column, box.row, *box.shape[::-1]]
    data = table_variables(tally, *GROUPS) | sample_variables(tally)
    data |= {
        BEFORE + name: (_dimensions(name), values, variables.TALLY[name])
        for name, values in arrays.items()
    }
    data |= trajectory_variables(tally.trajectories)
    data["crs"] = ((), np.int32(0), georeference(grid))
    places = {
        "terrain_cells": np.array([grid.nx, grid.ny], "i4"),
        "map_window": np.array(window, "i4"),
    }
    return Contents(data, {"part_layout": LAYOUT} | run_attributes(tally) | places)


def tallies(tally: Tally) -> dict[str, np.ndarray]:
    """Tallies of the cells that boulders reached, numbered by `cell`: `counts`, `sums`, `maxima`
    (layers, cells) and `bin_counts` (cells, bins), as far as they exist."""
    stored = {array.name: array.values for array in tally.arrays("tally", "work")}
    cells = _reached(stored)
    arrays = {"cell": cells}
    for name in STACKS:
        if name in stored:
            arrays[name] = stored[name].reshape(len(stored[name]), -1)[:, cells]
    if "column" in stored:
        column = stored["column"].ravel()[cells]
        arrays["bin_counts"] = np.where(column[:, None] > 0, stored["bin_counts"][column - 1], 0)
    return arrays


def _reached(arrays: Mapping[str, np.ndarray]) -> np.ndarray:
    """Cells with a non-zero tally, counted from 0 by rows from the north-west."""
    layers = [layer for name in STACKS for layer in arrays.get(name, ())]
    reached = np.zeros(1, bool)
    for layer in layers + ([arrays["column"]] if "column" in arrays else []):
        reached = reached | (layer.ravel() != 0)
    return np.flatnonzero(reached)


# ---- to a tally


@dataclass
class Part:
    """A part that was read and checked: each value is possible in a run."""

    name: str  # for messages
    origin: Origin
    first: int  # boulder
    last: int
    threads: int
    clocks: dict[str, float]
    crs: dict[str, Any]  # attributes of the grid mapping
    date: str = ""  # when it was written; "": unknown
    arrays: dict[str, np.ndarray] = field(default_factory=dict)

    def empty_run(self, before: int, boulders: int) -> Run:
        """Run of the kernel with room for boulders of the run of this part."""
        origin = self.origin
        layout = (self.arrays.get(name, np.zeros(1, "i4")) for name in LAYOUT_OF.values())
        return Run.joined(
            origin.case.text(), (origin.boulders, before, boulders), origin.window,
            len(origin.grounds), origin.features is not None, *layout,
        )  # fmt: skip

    def loaded_run(self) -> Run:
        """Run of the kernel with the results of this part."""
        run = self.empty_run(self.first - 1, self.last - self.first + 1)
        self.load(run)
        return run

    def load(self, run: Run) -> None:
        """Store rows, sums and tallies in an empty run that begins with these boulders; the cells
        of sources that the part splits are left to be joined or continued."""
        arrays, work = self.arrays, {}
        cells, n = arrays[f"{BEFORE}cell"], arrays["status"].size
        for array in run.arrays():
            name, values = array.file_name, array.values
            if array.group == "work":
                work[array.name] = values
            elif array.group == "kept":
                empty = values[:n] > self.origin.boulders
                if n > values.size or not (empty | (values[:n] == arrays[name])).all():
                    raise _damaged(self, name)
                values[:n] = arrays[name]
            elif "boulder" in array.dims:
                values[..., :n] = arrays[name]
            elif array.dims[1:] == ("y", "x"):
                values.reshape(len(values), -1)[:, cells] = arrays[name]
            elif array.name == "bin_counts":
                if cells.size > len(values):
                    raise RockfallError("the counts of quantile maps do not fit in memory")
                values[: cells.size] = arrays[name]
            elif array.name not in SHARED:
                values[...] = arrays[name]
        for before, bins in ("", "bins"), ("group_", "groups"):
            if bins in work:
                filled = arrays[f"sample_{before}bin"]
                work[bins].reshape(-1)[filled] = arrays[f"sample_{before}count"]
        if "column" in work:
            work["column"].reshape(-1)[cells] = np.arange(1, cells.size + 1)
            work["columns"][0] = cells.size

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


# ---- from a file


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
    """Read a part from a Dataset or a file and check all its values; a RockfallError refuses other
    or damaged files. Files are read directly, since xarray would take several times as long."""
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
    _check_values(head)
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
    """Metadata of a part, without its values."""
    if attrs.get("part_layout") != LAYOUT:
        raise RockfallError(
            f"{name}: is no part of a run, as --shard, checkpoints and rockfall-batch make them"
        )
    at = ""
    try:
        for at in NUMBERS:
            if not 0 <= int(attrs[at]) < 2**31:
                raise ValueError
        for at in CLOCKS:
            if not 0 <= float(attrs[at]) < math.inf:
                raise ValueError
        at = "date_created"
        date = str(attrs.get(at, ""))
        when(date)
        at = "GeoTransform"
        west, cell, _, north, _, _ = map(float, str(crs[at]).split())
        if not (cell > 0 and all(map(math.isfinite, (west, cell, north)))):
            raise ValueError
        at = "terrain_cells"
        nx, ny = map(int, attrs[at])
        at = "map_window"
        column, row, columns, rows = map(int, attrs[at])
        if not (0 <= column <= column + columns <= nx and 0 <= row <= row + rows <= ny):
            raise ValueError
        sums = []
        for at in SUMS:
            sums.append({str(key): str(digest) for key, digest in json.loads(attrs[at]).items()})
        at = "case"
        case = _case(str(attrs["case"]), str(attrs["case_file"]))
        at = "version"
        version = str(attrs[at])
        at = "source_features"
        features = None
        if at in attrs:
            features = Features(str(attrs[at]).split("\n"), np.zeros(0, "i4"))
        at = "grounds"
        grounds = _grounds(attrs)
        at = "input_warnings"
        warnings = [InputWarning.of(row) for row in json.loads(attrs.get(at, "[]"))]
        at = "dams"
        dams = [DamShape(**row) for row in json.loads(attrs.get(at, "[]"))]
        at = "stands"
        stands = [Stand(*row) for row in json.loads(attrs.get(at, "[]"))]
        crs_attrs = {key: v for key, v in crs.items() if key not in ("_FillValue", "GeoTransform")}
    except DAMAGED as error:
        raise RockfallError(f"{name}: is damaged: {at}") from error
    grid, window = Grid(west, north, cell, nx, ny), Box(row, column, row + rows, column + columns)
    checksums, decoded = sums
    boulders = int(attrs["boulders_requested"])
    origin = Origin(
        case, boulders, grid, window, checksums, decoded, version, grounds, features, warnings,
        dams, stands,
    )  # fmt: skip
    first, last = int(attrs["boulder_first"]), int(attrs["boulder_last"])
    clocks = {clock: float(attrs[clock]) for clock in CLOCKS}
    part = Part(name, origin, first, last, int(attrs["threads"]), clocks, crs_attrs, date)
    if not 1 <= first <= last + 1 <= origin.boulders + 1:
        raise _damaged(part, "boulders")
    return part


def when(date: str) -> datetime:
    """Time of an attribute `date_created` (ISO 8601); the earliest possible if empty, a ValueError
    if invalid."""
    if not date:
        return datetime.min.replace(tzinfo=UTC)
    moment = datetime.fromisoformat(date)
    return moment if moment.tzinfo else moment.replace(tzinfo=UTC)


def _grounds(attrs: Mapping[str, Any]) -> list[GroundRule]:
    """Names and models of the grounds; none where the scene has only its impact sets."""
    if "grounds" not in attrs:
        return []
    names, models = (str(attrs[name]).split("\n") for name in ("grounds", "ground_models"))
    return [GroundRule(name, model) for name, model in zip(names, models, strict=True)]


@lru_cache(maxsize=8)
def _case(text: str, file: str) -> Case:
    return case_in({"case": text, "case_file": file})


@lru_cache(maxsize=8)
def _table(
    text: str, boulders: int, grounds: int, features: bool
) -> tuple[dict[str, tuple[Any, tuple[str, ...]]], dict[str, int]]:
    """Type and dimensions of every variable that a part of a case has, and the lengths that do not
    depend on the part, from the arrays of an empty run."""
    run = Run.joined(
        text, (boulders, 0, 0), Box(0, 0, 0, 0), grounds, features, *np.zeros((2, 1), "i4")
    )
    table: dict[str, tuple[Any, tuple[str, ...]]] = {"crs": ("i4", ())}
    table[f"{BEFORE}cell"] = variables.TYPES["tally"]["cell"], _dimensions("cell")
    shape: dict[str, int] = {}
    for array in run.arrays():
        if array.group == "work":
            continue
        dims = _dimensions(array.name) if array.group == "tally" else array.dims
        table[array.file_name] = array.values.dtype, dims
        shape |= dict(zip(array.dims, array.values.shape, strict=True))
    if "sample_ended" in table:
        for name in "bin", "count", "group_bin", "group_count":
            table[f"sample_{name}"] = variables.TYPES["sample"][name], sample_dims(name)
    for dim in "boulder", "tally_shared", "sample_part", "sample_group":
        shape.pop(dim, None)
    return table, shape


def _dimensions(tally: str) -> tuple[str, ...]:
    """Dimensions of a tally in files; those of stacks include a layer."""
    if tally in STACKS:
        return f"tally_{tally}_layer", "tally"
    return {"cell": ("tally",), "bin_counts": ("tally", "tally_bin")}.get(tally, ("tally_shared",))


def _check_shapes(
    part: Part,
    shapes: dict[str, tuple[np.dtype, tuple[str, ...], tuple[int, ...]]],
    size: int | None,
) -> None:
    """Check that all variables of its case are present, with their types and lengths, in a file (of
    `size` bytes) that can hold them; others are dropped."""
    origin = part.origin
    sizes = origin.boulders, len(origin.grounds), origin.features is not None
    table, known_lengths = _table(origin.case.text(), *sizes)
    expected, lengths = {**table}, {**known_lengths}
    if "sample_ended" not in expected:  # else a dimension of its own
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


def _check_values(part: Part) -> None:
    """Check that values are possible in a run."""
    arrays, window = part.arrays, part.origin.window
    cells = window.shape[0] * window.shape[1]
    boulders = part.last - part.first + 1
    if "sample_bin" in arrays:
        shape = lengths(part.origin.case, part.origin.boulders)
        shape |= {dim: arrays[name].size for dim, name in LAYOUT_OF.items()}
        if damaged := possible(arrays, shape, boulders):
            raise _damaged(part, damaged)
        if not are_numbers(arrays["boulder"], part.first, part.last):
            raise _damaged(part, "boulder")
    for name, values in arrays.items():
        if name.startswith("sample_"):
            continue
        if not _possible(name, values, arrays.get("line_time"), cells):
            raise _damaged(part, name)
        if fault := out_of_range(name, values, part.origin.grid):
            raise _damaged(part, fault)
    if not _are_sources(part):
        raise _damaged(part, "source: must be that from which each boulder comes")
    if "trajectory_boulder" in arrays:
        numbers = arrays["trajectory_boulder"]
        inside = (numbers >= part.first) & (numbers <= part.last)
        if not (np.diff(numbers) >= 0).all() or not inside.all():
            raise _damaged(part, "trajectory_boulder")


def _are_sources(part: Part) -> bool:
    """Check that boulders come from sources in order, and from the expected ones where each source
    releases the same number."""
    sources, case = part.arrays["source"].astype(np.int64), part.origin.case
    if not (np.diff(sources) >= 0).all():
        return False
    if "boulders" not in case.case or case.release["by_area"]:
        return bool((sources <= part.origin.boulders).all())
    numbers = part.arrays.get("boulder", np.arange(part.first, part.last + 1, dtype="i8"))
    return np.array_equal(sources, (numbers - 1) // case.case["boulders"] + 1)


def are_numbers(numbers: np.ndarray, first: int, last: int) -> bool:
    """Check for increasing boulder numbers from the first to the last."""
    rising = bool((np.diff(numbers) > 0).all())
    return rising and (not numbers.size or first <= numbers[0] <= numbers[-1] <= last)


def _possible(name: str, values: np.ndarray, times: np.ndarray | None, cells: int) -> bool:
    if name == f"line_{COUNT_AT_LINES}":
        assert times is not None
        return are_counts(values, times)
    if name.startswith("line_"):
        assert times is not None
        return are_crossings(values, times)
    if name == "status":
        return bool(np.isin(values, list(variables.STATUS.values())).all())
    if name == "barrier_outcome":
        return bool(np.isin(values, [0, *variables.OUTCOME.values()]).all())
    if name == f"{BEFORE}cell":
        return bool((np.diff(values, prepend=-1) > 0).all() and (values < cells).all())
    if name == f"{BEFORE}shared_cell":
        return bool(((values >= 0) & (values < cells)).all())
    if values.dtype.kind == "f" and not np.isfinite(values).all():
        return False
    minimum = int(name in ("source", "source_feature", f"{BEFORE}shared_source"))
    counts = values.dtype.kind == "i" or name.startswith(BEFORE)
    return not counts or bool((values >= minimum).all())
