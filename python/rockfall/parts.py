# SPDX-License-Identifier: BSD-3-Clause
"""Parts of a run: results of some of its boulders, with tallies that add up to those of all."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rockfall.case import case_of
from rockfall.errors import RockfallError

if TYPE_CHECKING:
    import xarray as xr

    from rockfall.simulate import Maps

STACKS = ("counts", "sums", "maxima")  # of maps, by layer
BEFORE = "tally_"  # the names of tallies in a part
_DIMS = {
    "cell": ("tally",),
    **{name: (f"tally_{name}_layer", "tally") for name in STACKS},
    "classes": ("tally", "tally_class"),
}
_ABOUT = {
    "cell": "index of the cell, by rows from the north-west",
    **{name: f"{name} of the maps, by layer" for name in STACKS},
    "classes": "counts of classes",
}
CLOCKS = ("wall_seconds", "cpu_seconds")


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


def tally_variables(maps: Maps) -> dict[str, Any]:
    """The tallies as variables of a part."""
    return {
        f"{BEFORE}{name}": (_DIMS[name], values, {"units": "1", "long_name": _ABOUT[name]})
        for name, values in tallies(maps).items()
    }


def merge(parts: Sequence[xr.Dataset | str | Path]) -> xr.Dataset:
    """The result of a whole run from its parts (results, or their files), bit for bit that of a run
    in one piece; only times and threads are their own.

    A RockfallError names parts of another run, and boulders that are missing or there twice.
    """
    _check(sorted((_head(part) for part in parts), key=lambda head: head["boulder_first"]))
    joined = Joined()
    for part in parts:
        joined.add(_read(part))
    return joined.result()


def _read(part: xr.Dataset | str | Path) -> xr.Dataset:
    from rockfall.result import read_result

    return read_result(part) if isinstance(part, str | Path) else part


def _head(part: xr.Dataset | str | Path) -> dict[str, Any]:
    """Attributes of a part, and what it is called."""
    from rockfall.result import open_result

    if isinstance(part, str | Path):
        with open_result(part) as data:
            return _head_of(data, str(part))
    return _head_of(part, "a part")


def _head_of(data: xr.Dataset, name: str) -> dict[str, Any]:
    if f"{BEFORE}cell" not in data.variables or "case" not in data.attrs:
        raise RockfallError(f"{name}: is not a part of a run, as --shard makes them")
    case = case_of(data)
    return {**data.attrs, "name": name, "case": case.replace(case={"threads": 0}).text()}


def _check(heads: Sequence[dict[str, Any]]) -> None:
    """All of one run, and all of it."""
    if not heads:
        raise RockfallError("merge: needs the parts of a run")
    own = heads[0]
    for head in heads[1:]:
        for what in ("case", "boulders_asked", "version"):
            if head[what] != own[what]:
                raise RockfallError(f"{head['name']}: is of another {what} than {own['name']}")
        sums = (json.loads(one["input_checksums"]) for one in (own, head))
        for key, pair in _pairs(*sums):
            if pair[0] != pair[1]:
                raise RockfallError(f"{head['name']}: has another {key} than {own['name']}")
    done, wrong = 0, []
    for head in heads:
        first, last = int(head["boulder_first"]), int(head["boulder_last"])
        if first > done + 1:
            wrong.append(f"boulders {done + 1} to {first - 1} are missing")
        if first <= done:
            wrong.append(f"boulders {first} to {min(done, last)} are twice: {head['name']}")
        done = max(done, last)
    if done < int(own["boulders_asked"]):
        wrong.append(f"boulders {done + 1} to {own['boulders_asked']} are missing")
    if wrong:
        raise RockfallError("merge: " + "; ".join(wrong))


def _pairs(one: dict[str, str], other: dict[str, str]):
    return ((key, (one.get(key), other.get(key))) for key in sorted({*one, *other}))


class Joined:
    """Parts of one run put together as they come, in any order: rows, sums and tallies of maps."""

    def __init__(self) -> None:
        self.first: xr.Dataset | None = None  # the part with boulder 1
        self.rows: dict[int, dict[str, np.ndarray]] = {}  # by the first boulder of a part
        self.sums: dict[str, np.ndarray] = {}
        self.maps: Maps | None = None
        self.clocks = dict.fromkeys(CLOCKS, 0.0)
        self.threads = 0

    def add(self, part: xr.Dataset) -> None:
        number = int(part.attrs["boulder_first"])
        self.maps = self.maps or _empty_maps(part)
        arrays = {name: part[BEFORE + name].values for name in _DIMS if BEFORE + name in part}
        add_tallies(self.maps, arrays)
        rows = self.rows.setdefault(number, {})
        for name, variable in part.variables.items():
            if _row_dimension(variable.dims):
                rows[name] = variable.values
            elif name.startswith("rebounds") or name.endswith("_histogram"):
                self.sums[name] = self.sums.get(name, 0) + variable.values
        self.clocks = {clock: self.clocks[clock] + float(part.attrs[clock]) for clock in CLOCKS}
        self.threads = max(self.threads, int(part.attrs["threads"]))
        if number == 1:
            self.first = part

    def result(self) -> xr.Dataset:
        """That of the whole run; the parts are used up."""
        import xarray as xr

        from rockfall.result import map_variable

        boulders = int(self.first.attrs["boulders_asked"])
        least = case_of(self.first).output["least_passages"]
        ordered = [self.rows[number] for number in sorted(self.rows)]
        data: dict[str, Any] = {}
        for name, variable in self.first.variables.items():
            along = _row_dimension(variable.dims)
            if along:
                rows = [part.pop(name) for part in ordered if name in part]
                rows = np.concatenate(rows, axis=variable.dims.index(along))
                data[name] = (variable.dims, rows, variable.attrs)
            elif name in self.sums:
                data[name] = (variable.dims, self.sums[name], variable.attrs)
            elif variable.dims == ("y", "x"):
                data[name] = map_variable(name, self.maps, boulders, least)
            elif not name.startswith(BEFORE):
                data[name] = variable
        own = {"boulder_last": boulders, "complete": 1, "threads": self.threads, **self.clocks}
        attrs = dict(self.first.attrs) | own
        return xr.Dataset(data, attrs=attrs).set_coords(list(self.first.coords))


def _row_dimension(dims: tuple) -> str | None:
    """The dimension along which rows of parts follow each other."""
    return next((dim for dim in ("boulder", "trajectory_vertex") if dim in dims), None)


def _empty_maps(part: xr.Dataset) -> Maps:
    from rockfall.simulate import no_maps

    names = [name for name, variable in part.variables.items() if variable.dims == ("y", "x")]
    return no_maps(names, (part.sizes["y"], part.sizes["x"])) if names else no_maps()
