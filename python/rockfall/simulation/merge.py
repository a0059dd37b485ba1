# SPDX-License-Identifier: BSD-3-Clause
"""Parts of a run: results of some of its boulders, with tallies that add up to those of all."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rockfall.case import case_in, case_of
from rockfall.errors import RockfallError
from rockfall.io.files import check_netcdf
from rockfall.io.grid import Box
from rockfall.result.validate import are_crossings
from rockfall.simulation.source_maps import FED, join_sources

if TYPE_CHECKING:
    import xarray as xr

    from rockfall.simulation.simulate import Maps

    _Variables = Mapping[str, tuple[tuple[str, ...], np.ndarray]]  # dimensions and values
    _Template = Callable[[], xr.Dataset]

STACKS = ("counts", "sums", "maxima")  # of maps, by layer
BEFORE = "tally_"  # the names of tallies in a part
_DIMS = {
    "cell": ("tally",),
    **{name: (f"tally_{name}_layer", "tally") for name in STACKS},
    "classes": ("tally", "tally_class"),
    **{name: ("tally_fed",) for name in FED},
}
_ABOUT = {
    "cell": "index of the cell, by rows from the north-west",
    **{name: f"{name} of the maps, by layer" for name in STACKS},
    "classes": "counts of classes",
    "fed_cell": "cell that a source feeds which the part cuts",
    "fed_source": "number of that source",
    "fed_boulders": "its boulders in the part",
}
CLOCKS = ("wall_seconds", "cpu_seconds")
DECODED = "decoded_checksums"  # which rockfall-batch does not write: it sums files
#: What netCDF4 and xarray raise of a file that is damaged.
DAMAGED = (
    OSError, ValueError, TypeError, LookupError, RuntimeError, AttributeError, OverflowError,
)  # fmt: skip
NUMBERS = ("boulders_asked", "boulder_first", "boulder_last", "threads")
OWN = ("boulder", "trajectory_vertex", "tally", "tally_fed")  # dimensions as long as a part needs


def tallies(maps: Maps) -> dict[str, np.ndarray]:
    """The tallies of the cells that boulders reached, which are `cell`: `counts`, `sums`, `maxima`
    (layers, cells) and `classes` (cells, classes), as far as there are any."""
    cells = _reached(maps)
    arrays = {"cell": cells}
    for name in STACKS:
        stack = getattr(maps, name)
        if stack.size > 1:
            arrays[name] = stack.reshape(len(stack), -1)[:, cells]
    if maps.column.size > 1:
        column = maps.column.ravel()[cells]
        arrays["classes"] = np.where(column[:, None] > 0, maps.class_counts[column - 1], 0)
    return arrays


def _reached(maps: Maps) -> np.ndarray:
    """Cells in which any tally is not zero, counted from 0 by rows from the north-west."""
    layers = [layer for name in STACKS for layer in getattr(maps, name)] + [maps.column]
    reached = np.zeros(1, bool)
    for layer in layers:
        if layer.size > 1:
            reached = reached | (layer.ravel() != 0)
    return np.flatnonzero(reached)


def add_tallies(maps: Maps, arrays: Mapping[str, np.ndarray]) -> None:
    """Add what `tallies` gave."""
    cells = arrays["cell"]
    for name in STACKS:
        if name in arrays:
            stack = getattr(maps, name)
            flat = stack.reshape(len(stack), -1)
            join = np.maximum if name == "maxima" else np.add
            flat[:, cells] = join(flat[:, cells], arrays[name])
    if "classes" in arrays:
        column = maps.column.ravel()
        new = cells[column[cells] == 0]
        used = int(maps.columns[0])
        if used + new.size > len(maps.class_counts):
            raise RockfallError("the counts of quantile maps do not fit in memory")
        column[new] = np.arange(used + 1, used + new.size + 1)
        maps.class_counts[used : used + new.size] = 0
        maps.columns[0] += new.size
        maps.class_counts[column[cells] - 1] += arrays["classes"]


def tally_variables(maps: Maps, fed: Mapping[str, np.ndarray]) -> dict[str, Any]:
    """The tallies as variables of a part, with the cells fed by sources that it cuts."""
    return {
        f"{BEFORE}{name}": (_DIMS[name], values, {"units": "1", "long_name": _ABOUT[name]})
        for name, values in (tallies(maps) | dict(fed)).items()
    }


def merge(parts: Sequence[xr.Dataset | str | Path]) -> xr.Dataset:
    """The result of a whole run from its parts (results, or their files), bit for bit that of a run
    in one piece; only times and threads are their own.

    A RockfallError names parts of another run, and boulders that are missing or there twice.
    """
    joined, heads = Joined(), []
    for part in parts:
        attrs, variables, template = _read(part)
        name = "a part" if hasattr(part, "attrs") else str(part)
        heads.append(_head(attrs, variables, name))
        _check_same(heads[0], heads[-1])
        heads[0][DECODED] = heads[0][DECODED] or heads[-1][DECODED]
        _check_rows(heads[-1], variables)
        joined.take(attrs, variables, template, name)
    _check_whole(sorted(heads, key=lambda head: head["boulder_first"]))
    return joined.result()


def _read(part: xr.Dataset | str | Path) -> tuple[dict[str, Any], _Variables, _Template]:
    """Attributes and variables of a part, and how to get it as a result, which one part is asked
    for. Files are read as they are: xarray would take several times as long."""
    import netCDF4

    from rockfall.result.dataset import read_result

    if not isinstance(part, str | Path):
        variables = {name: (one.dims, one.values) for name, one in part.variables.items()}
        return part.attrs, variables, lambda: part
    check_netcdf(part)
    try:
        with netCDF4.Dataset(part) as file:
            file.set_auto_maskandscale(False)
            wanted = {name: one for name, one in file.variables.items() if _is_joined(name, one)}
            variables = {name: (one.dimensions, one[...]) for name, one in wanted.items()}
            attrs = {name: file.getncattr(name) for name in file.ncattrs()}
    except DAMAGED as error:
        raise RockfallError(f"{part}: cannot be read: {error}") from error
    return attrs, variables, lambda: read_result(part)


def _is_joined(name: str, variable: Any) -> bool:
    return name.startswith(BEFORE) or bool(_row_dimension(variable.dimensions)) or _is_sum(name)


def _is_sum(name: str) -> bool:
    return name.startswith("rebounds") or name.endswith("_histogram")


def _head(attrs: Mapping[str, Any], variables: _Variables, name: str) -> dict[str, Any]:
    """What a part says of itself, what it is called, and the shapes of what it holds."""
    texts = ("case", "case_file", "version", "input_checksums")
    if f"{BEFORE}cell" not in variables or not {*texts, *NUMBERS, *CLOCKS} <= attrs.keys():
        raise RockfallError(f"{name}: is not a part of a run, as --shard makes them")
    try:
        head = {key: int(attrs[key]) for key in NUMBERS} | {key: str(attrs[key]) for key in texts}
        head["case"] = _case_text(head["case"], head["case_file"])
        head["input_checksums"] = dict(json.loads(head["input_checksums"]))
        head[DECODED] = dict(json.loads(str(attrs.get(DECODED, "{}"))))
        if not np.isfinite([float(attrs[clock]) for clock in CLOCKS]).all():
            raise ValueError(CLOCKS)
        if not all(0 <= head[key] < 2**31 for key in NUMBERS):
            raise ValueError(NUMBERS)
    except (TypeError, ValueError, OverflowError, RecursionError) as error:
        raise RockfallError(f"{name}: is damaged: {error}") from error
    return head | {"name": name, "shapes": _shapes(variables)}


def _shapes(variables: _Variables) -> dict[str, tuple]:
    """Of each variable what all parts of a run share: dimensions, type, and the lengths that are
    not a part's own."""

    def shared(dims: tuple[str, ...], values: np.ndarray) -> list[int]:
        return [n for dim, n in zip(dims, values.shape, strict=True) if dim not in OWN]

    return {
        name: (dims, values.dtype, shared(dims, values))
        for name, (dims, values) in variables.items()
        if _row_dimension(dims) or _is_sum(name) or name.startswith(BEFORE)
    }


def _check_rows(head: dict[str, Any], variables: _Variables) -> None:
    """A part has a row for each of its boulders, which lies somewhere, and cells in their order."""
    due = head["boulder_last"] - head["boulder_first"] + 1
    cells = variables[f"{BEFORE}cell"][1]
    _, times = variables.get("line_time", ((), np.empty(0)))
    wrong = [] if (np.diff(cells, prepend=-1) > 0).all() else [f"{BEFORE}cell"]
    for name, (dims, values) in variables.items():
        if "boulder" in dims and values.shape[dims.index("boulder")] != due:
            wrong.append(name)
        elif dims in (("boulder",), ("trajectory_vertex",)) and not np.isfinite(values).all():
            wrong.append(name)
        elif dims == ("line", "boulder") and not are_crossings(values, times):
            wrong.append(name)
    first, last = head["boulder_first"], head["boulder_last"]
    if wrong or not 1 <= first <= last + 1 <= head["boulders_asked"] + 1:
        raise RockfallError(f"{head['name']}: is damaged: {', '.join(wrong) or 'boulders'}")


@lru_cache(maxsize=8)
def _case_text(text: str, file: str) -> str:
    """A case as any of its parts has it: threads may differ, and how it is written."""
    return case_in({"case": text, "case_file": file}).replace(case={"threads": 0}).text()


def _check_same(own: dict[str, Any], head: dict[str, Any]) -> None:
    """Both are of one run."""
    for what in ("case", "boulders_asked", "version"):
        if head[what] != own[what]:
            raise RockfallError(f"{head['name']}: is of another {what} than {own['name']}")
    for sums in ("input_checksums", DECODED):
        one, other = own[sums], head[sums]
        for key in sorted({*one, *other} if one and other else ()):
            if one.get(key) != other.get(key):
                raise RockfallError(f"{head['name']}: has another {key} than {own['name']}")
    one, other = own["shapes"], head["shapes"]
    for name in sorted({*one, *other}):
        if one.get(name) != other.get(name) and not name.startswith("trajectory"):
            raise RockfallError(f"{head['name']}: has another {name} than {own['name']}")


def _check_whole(heads: Sequence[dict[str, Any]]) -> None:
    """All boulders are there, once."""
    if not heads:
        raise RockfallError("merge: needs the parts of a run")
    done, asked, wrong = 0, int(heads[0]["boulders_asked"]), []
    for head in heads:
        first, last = int(head["boulder_first"]), int(head["boulder_last"])
        if first > done + 1:
            wrong.append(f"boulders {done + 1} to {first - 1} are missing")
        if first <= done:
            wrong.append(f"boulders {first} to {min(done, last)} are twice: {head['name']}")
        done = max(done, last)
    if done < asked:
        wrong.append(f"boulders {done + 1} to {asked} are missing")
    if wrong:
        raise RockfallError("merge: " + "; ".join(wrong))


class Joined:
    """Parts of one run put together as they come, in any order: rows, sums and tallies of maps."""

    def __init__(self, maps: Maps | None = None) -> None:
        """`maps`: where tallies are added up; without it, made like those of the first part."""
        self.first: xr.Dataset | None = None  # the part with boulder 1
        self.rows: dict[str, np.ndarray] = {}  # of all boulders
        self.vertices: dict[int, dict[str, np.ndarray]] = {}  # by the first boulder of a part
        self.sums: dict[str, np.ndarray] = {}
        self.maps = maps
        self.fed: list[dict[str, np.ndarray]] = []  # by sources that a part cuts
        self.clocks = dict.fromkeys(CLOCKS, 0.0)
        self.threads = 0

    def add(self, part: xr.Dataset) -> None:
        self.take(*_read(part))

    def take(
        self,
        attrs: Mapping[str, Any],
        variables: _Variables,
        template: _Template,
        name: str = "a part",
    ) -> None:
        """Add a part as `_read` gives it; `name` is for messages."""
        number = int(attrs["boulder_first"])
        if self.maps is None or number == 1:
            part = template()
            self.maps = self.maps or _empty_maps(part)
            if number == 1:
                self.first = part
        arrays = {name: variables[BEFORE + name][1] for name in _DIMS if BEFORE + name in variables}
        self._check_cells(arrays, name)
        add_tallies(self.maps, arrays)
        if arrays.keys() >= set(FED):
            self.fed.append({name: arrays[name] for name in FED})
        for name, (dims, values) in variables.items():
            if "boulder" in dims:
                self._put(name, dims.index("boulder"), values, attrs)
            elif _row_dimension(dims):
                self.vertices.setdefault(number, {})[name] = values
            elif _is_sum(name):
                self.sums[name] = self.sums.get(name, 0) + values
        self.clocks = {clock: self.clocks[clock] + float(attrs[clock]) for clock in CLOCKS}
        self.threads = max(self.threads, int(attrs["threads"]))

    def _put(self, name: str, axis: int, values: np.ndarray, attrs: Mapping[str, Any]) -> None:
        """Rows of a part to their place among those of all boulders."""
        first, asked = int(attrs["boulder_first"]), int(attrs["boulders_asked"])
        if name not in self.rows:
            shape = (*values.shape[:axis], asked, *values.shape[axis + 1 :])
            try:
                self.rows[name] = np.empty(shape, values.dtype)
            except (MemoryError, ValueError) as error:
                raise RockfallError(f"merge: {asked} boulders do not fit in memory") from error
        place = [slice(None)] * values.ndim
        place[axis] = slice(first - 1, first - 1 + values.shape[axis])
        self.rows[name][tuple(place)] = values

    def _check_cells(self, arrays: Mapping[str, np.ndarray], name: str) -> None:
        """The cells of a part are cells of the maps, and it has tallies for their layers alone."""
        ny, nx = self.maps.box.shape
        for one in STACKS:
            layers = getattr(self.maps, one)
            if one in arrays and (layers.size == 1 or len(layers) != len(arrays[one])):
                raise RockfallError(f"{name}: is damaged: {BEFORE}{one}")
        if "classes" in arrays and self.maps.column.size == 1:
            raise RockfallError(f"{name}: is damaged: {BEFORE}classes")
        for one in ("cell", "fed_cell"):
            cells = arrays.get(one, np.empty(0))
            if cells.size and not (0 <= cells.min() and cells.max() < ny * nx):
                raise RockfallError(f"{name}: is damaged: {BEFORE}{one}")

    def result(self) -> xr.Dataset:
        """That of the whole run; the parts are used up."""
        import xarray as xr

        from rockfall.result.dataset import as_variables, map_variable

        join_sources(self.maps, self.fed)
        boulders = int(self.first.attrs["boulders_asked"])
        least = case_of(self.first).output["least_passages"]
        ordered = [self.vertices[number] for number in sorted(self.vertices)]
        data: dict[str, Any] = {}
        for name, variable in self.first.variables.items():
            if name in self.rows:
                data[name] = (variable.dims, self.rows[name], variable.attrs)
            elif _row_dimension(variable.dims):
                rows = np.concatenate([part[name] for part in ordered])
                data[name] = (variable.dims, rows, variable.attrs)
            elif name in self.sums:
                data[name] = (variable.dims, self.sums[name], variable.attrs)
            elif variable.dims == ("y", "x"):
                data[name] = map_variable(name, self.maps, boulders, least)
            elif not name.startswith(BEFORE):
                data[name] = (variable.dims, variable.values, variable.attrs)
        own = {"boulder_last": boulders, "complete": 1, "threads": self.threads, **self.clocks}
        attrs = dict(self.first.attrs) | own
        return xr.Dataset(as_variables(data), attrs=attrs).set_coords(list(self.first.coords))


def _row_dimension(dims: tuple) -> str | None:
    """The dimension along which rows of parts follow each other."""
    return next((dim for dim in ("boulder", "trajectory_vertex") if dim in dims), None)


def _empty_maps(part: xr.Dataset) -> Maps:
    from rockfall.simulation.simulate import no_maps

    names = [name for name, variable in part.variables.items() if variable.dims == ("y", "x")]
    return no_maps(names, Box(0, 0, part.sizes["y"], part.sizes["x"])) if names else no_maps()
