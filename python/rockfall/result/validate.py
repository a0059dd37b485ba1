# SPDX-License-Identifier: BSD-3-Clause
"""Checks of a result, which refuse a damaged file with a clear message before it is used."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rockfall.case import case_of
from rockfall.errors import RockfallError
from rockfall.io.rasters.grid import Box, Grid
from rockfall.result import variables
from rockfall.result.run_arrays import RunArrays

if TYPE_CHECKING:
    import xarray as xr

#: Dimensions of each variable, by name.
_Group = dict[str, tuple[str, ...]]

ALWAYS = (  # required attributes
    "title", "source", "case", "case_file", "seed", "boulder_first", "boulder_last",
    "boulders_requested", "complete", "impact_set", "impact_set_checksum", "input_checksums",
    "threads", "wall_seconds", "cpu_seconds",
)  # fmt: skip
NUMBERS = (  # required numeric attributes
    "seed", "boulder_first", "boulder_last", "boulders_requested", "complete", "threads",
    "wall_seconds", "cpu_seconds",
)  # fmt: skip
TEXTS = ("line_name", "feature_name", "ground", "ground_model")  # text variables
#: Dimensions whose variables have no missing values.
FINITE = ("x", "y", "boulder", "crossing", "line_vertex", "trajectory_vertex")


def check_result(data: xr.Dataset, path: str | Path) -> None:
    """Refuse a result that lacks a required variable or attribute, or a part of a group."""
    if "case" not in data.attrs or "boulder" not in data.dims:
        raise RockfallError(f"{path}: is not a rockfall result")
    if "line_time" in data.variables:
        raise RockfallError(f"{path}: has the layout of rockfall 1: run the case again")
    missing = sorted({*variables.BOULDER, *variables.COUNT, "crs"} - set(data.variables))
    if missing := missing + [name for name in ALWAYS if name not in data.attrs]:
        raise RockfallError(f"{path}: incomplete rockfall result: variable {missing[0]} is missing")
    for name in NUMBERS:
        value = np.asarray(data.attrs[name])
        if value.dtype.kind not in "iuf" or value.size != 1 or not np.isfinite(value).all():
            raise RockfallError(f"{path}: {name} = {value}: is not a number")
    check_dimensions(data, path)
    _check_groups(data, path)
    if "threshold" not in data.variables and {*variables.EXCEEDED} & {*data.variables}:
        raise RockfallError(f"{path}: incomplete rockfall result: variable threshold is missing")
    ours = (*variables.BOULDER, *variables.COUNT, *variables.MAP)
    for name in (name for name in ours if name in data.variables):
        attrs = data.variables[name].attrs
        words = [attrs.get(word) for word in ("units", "long_name")]
        fewest = np.asarray(attrs.get("min_passages", 0))  # minimum passages for a map value
        if not all(isinstance(word, str) for word in words) or fewest.dtype.kind not in "iu":
            raise RockfallError(f"{path}: {name}: has no type")


def check_dimensions(data: xr.Dataset, path: str | Path) -> None:
    """Check that each known variable of a result is numeric and has the right dimensions."""
    for name, dims in known_variables().items():
        if name in data.variables:
            _check_variable(data.variables[name], name, dims, path)


def _check_groups(data: xr.Dataset, path: str | Path) -> None:
    """Check that lines, histograms, trajectories and maps are complete if present."""
    for group in _groups():
        if any(name in data.variables or name in data.dims for name in group):
            for name in group:
                if name not in data.variables:
                    raise RockfallError(
                        f"{path}: incomplete rockfall result: variable {name} is missing"
                    )


def known_variables() -> _Group:
    """All known variables with their dimensions; unknown variables of a result are not checked."""
    dims_of: _Group = {name: ("boulder",) for name in variables.BOULDER}
    dims_of |= {name: () for name in variables.COUNT}
    dims_of |= {name: variables.map_dims(name) for name in variables.MAP}
    for group in _groups():
        dims_of |= group
    return dims_of


def _groups() -> Iterator[_Group]:
    """Yield groups of variables; a result has either all variables of a group or none."""
    crossed = {f"crossing_{name}": ("crossing",) for name in variables.CROSSING}
    vertices = {f"line_vertex_{name}": ("line_vertex",) for name in variables.LINE_VERTEX}
    of_line: _Group = {name: ("line",) for name in ("line", "line_name", "row_size")}
    yield {**of_line, **crossed, **vertices}
    on_grounds = ("ground", "ground_model", "ground_block_radius", *variables.GROUND)
    yield {name: ("ground",) for name in on_grounds}
    yield {name: ("boulder",) for name in variables.ENERGY}
    yield {name: ("boulder",) for name in variables.SHAPE}
    yield {name: ("boulder",) for name in variables.MASS}
    yield {name: ("boulder",) for name in variables.SHADOW}
    yield {name: ("boulder",) for name in variables.TREE}
    yield {name: ("boulder",) for name in variables.BREAKAGE}
    yield {f"crossing_{name}": ("crossing",) for name in variables.FRAGMENT}
    of_boulders: _Group = {name: ("boulder",) for name in variables.FEATURE}
    yield of_boulders | {"feature": ("feature",), "feature_name": ("feature",)}
    yield {
        "barrier_height": ("line",), "barrier_capacity": ("line",),
        "crossing_outcome": ("crossing",),
    }  # fmt: skip
    yield {f"trajectory_{name}": ("trajectory_vertex",) for name in variables.VERTEX}
    yield {f"sample_{name}": variables.SAMPLE_DIMS[name] for name in variables.SAMPLE}
    yield {axis: (axis,) for axis in ("x", "y")}
    yield {"threshold": ("threshold",)}
    for name in variables.HISTOGRAM:
        along = f"{name}_bin"
        yield {along: (along,), f"{along}_bounds": (along, "bound"), f"{name}_histogram": (along,)}


def _check_variable(
    variable: xr.Variable, name: str, dims: tuple[str, ...], path: str | Path
) -> None:
    if variable.dims != dims:
        raise RockfallError(f"{path}: {name}: must have dimensions {', '.join(dims)}")
    if variable.dtype.kind not in "iuf" and name not in TEXTS:
        raise RockfallError(f"{path}: {name}: contains no numbers")
    if name in variables.FLAGS:
        values = np.atleast_1d(variable.attrs.get("flag_values", []))
        words = str(variable.attrs.get("flag_meanings", "")).split()
        if not words or len(values) != len(words) or values.dtype.kind not in "iu":
            raise RockfallError(f"{path}: {name}: has no flag_meanings")


def check_values(data: xr.Dataset, path: str | Path) -> None:
    """Refuse missing, infinite or impossible values, and bins that are not contiguous."""
    check_samples(data, path)
    check_crossings(data, path)
    for name, dims in known_variables().items():
        if name not in data.variables:
            continue
        values = data.variables[name].values
        along = dims[0] if len(dims) == 1 else ""
        is_complete = along in FINITE or along.endswith("_bin")
        if is_complete and name not in variables.SHADOW and not np.isfinite(values).all():
            raise RockfallError(f"{path}: {name}: must be a number for every {along}")
        if {"boulder", "crossing"} & {*dims}:
            if fault := variables.fault_of(name, values):
                raise RockfallError(f"{path}: {fault}")
        if name.endswith("_bin_bounds") and not _are_edges(values):
            raise RockfallError(f"{path}: {name}: must be increasing bin edges")


def check_crossings(data: xr.Dataset, path: str | Path) -> None:
    """Refuse crossings that are not ordered by line and boulder, or whose boulder has no row."""
    if "crossing_line" not in data:  # none, or checked on reading
        return
    sizes, kept, fault = data["row_size"].values, data["boulder"].values, ""
    if (sizes < 0).any() or sizes.sum() != data.sizes["crossing"]:
        fault = "row_size: contains impossible values"
    else:  # a line at a time, to save memory
        for k, end in enumerate(np.cumsum(sizes, dtype="i8").tolist()):
            for name in ("crossing_line", "crossing_boulder"):
                values = data[name].values[end - int(sizes[k]) : end]
                fault = fault or fault_of_crossings(name, values, np.full(values.size, k), kept)
    if fault:
        raise RockfallError(f"{path}: {fault}")


def fault_of_crossings(name: str, values: np.ndarray, line: np.ndarray, kept: np.ndarray) -> str:
    """Error text for a column of crossings at `line`; "" if valid. `kept`: boulders with rows."""
    good = True
    if name == "crossing_line":
        good = bool((values == line).all())
    elif name == "crossing_boulder":
        place = np.minimum(np.searchsorted(kept, values), max(0, kept.size - 1))
        rising = (np.diff(values) > 0) | (np.diff(line) > 0)
        good = not values.size or bool(rising.all() and (kept[place] == values).all())
    elif not np.isfinite(values).all():
        return f"{name}: must be a number for every crossing"
    return "" if good else f"{name}: contains impossible values"


def check_samples(data: xr.Dataset, path: str | Path) -> None:
    """Refuse samples that a run cannot produce."""
    if "sample_ended" not in data:
        return
    requested, first, last = (
        int(data.attrs[name]) for name in ("boulders_requested", "boulder_first", "boulder_last")
    )
    layout = (data[f"sample_{name}"].values.astype("i4") for name in ("part_last", "group_part"))
    boulders = requested, first - 1, last - first + 1
    run = RunArrays.joined(case_of(data), boulders, Box(0, 0, 0, 0), 0, False, False, *layout)
    sizes = (data.sizes[dim] for dim in ("boulder", "sample_entry", "sample_group_entry"))
    rows, *bins = map(int, sizes)
    run.begin_part(boulders[2], (rows, 0, 0, *bins, 0), str(path))
    for array in run.part_arrays():
        if array.group in ("sample", "kept"):
            values = data[array.file_name].values
            own = array.values
            if (values.shape, values.dtype.kind) != (own.shape, own.dtype.kind):
                raise RockfallError(f"{path}: {array.file_name}: contains impossible values")
            own[...] = values
    run.unpack_part(str(path), Grid(0.0, 0.0, 1.0, 0, 0), only_samples=True)


def _are_edges(bounds: np.ndarray) -> bool:
    """Return True if bins (n, 2) are contiguous."""
    if bounds.shape[1:] != (2,) or not np.isfinite(bounds).all():
        return False
    return bool((bounds[:, 0] < bounds[:, 1]).all() and (bounds[1:, 0] == bounds[:-1, 1]).all())
