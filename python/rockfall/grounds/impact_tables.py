# SPDX-License-Identifier: BSD-3-Clause
"""Tables of impacts: netCDF files, shipped or next to a case, and their packed bytes for the kernel
(docs/impact_tables.md)."""

from __future__ import annotations

import importlib.resources
import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rockfall.case import Case, facts, keys_of
from rockfall.errors import RockfallError
from rockfall.io.files import atomic_write
from rockfall.io.netcdf import load_dataset, open_netcdf, write_compressed

if TYPE_CHECKING:
    import xarray as xr

FIRST_LINE = b"rockfall impact table 3\n"
FIELDS = (
    "vt_in", "vn_in", "w_in", "speed_in", "height_in", "along_out", "across_out", "vn_out", "w_out",
    "duration", "advance", "rise", "pull_along", "pull_across", "exit", "follower",
)  # fmt: skip
INPUTS, MAPPED = 4, 3  # V_t, V_n, W, height; along, V_n, W
BY_SOURCE = "source"  # block_shape that sources give
#: Numbered from 1.
BLOCK_SHAPES = tuple(
    shape for shape in keys_of("boulder")["block_shape"].allowed.split(", ") if shape != BY_SOURCE
)
ENSEMBLE = "-ensemble"  # suffix of the name of an ensemble
KINDS = "flight", "roll"
OF_PART = {  # a number for each part
    "size": "R_b [m] if speed2 is given, else R_b/R_m; 0: it does not matter",
    "speed2": "g R_b of the blocks [m2 s-2] if the speed itself is a key, else 0",
    "fastest": "V^2 of the fastest record, over g R_b",
}
SCALES = "density", "inertia", "rest_angle"  # scalars of a table
EDGES = tuple(f"{kind}_edge_{key}" for kind in KINDS for key in (1, 2, 3))


@dataclass(frozen=True)
class ImpactTable:
    """Records of contacts in bins (theory, chapter 5), in parts of one size of boulders. Edges:
    (part, bins of the keys before, edges); `map` (bin, MAPPED, INPUTS), `low` and `high`
    (bin, INPUTS), `record` (record, FIELDS) in the order of their bins, bin b from `first[b]` on,
    counted from 0."""

    size: np.ndarray  # (part): R_b [m] if the speed itself is a key, else R_b/R_m [-]
    speed2: np.ndarray  # (part): g R_b of the laboratory, if the speed is a key; else 0 [m2/s2]
    fastest: np.ndarray  # (part): V^2 of the fastest incoming record, over g R_b [-]
    edges: dict[str, np.ndarray]
    first: np.ndarray
    map: np.ndarray
    low: np.ndarray
    high: np.ndarray
    record: np.ndarray
    density: float  # of its blocks [kg/m3]
    inertia: float  # I/(m R_b^2) [-]
    rest_angle: float  # of the ground: stopped boulders roll on where it is steeper [degree]
    attrs: dict[str, Any] = field(default_factory=dict)

    @property
    def bins(self) -> dict[str, list[int]]:
        """Number of bins of each key of a kind."""
        return {
            kind: [self.edges[f"{kind}_edge_{key}"].shape[-1] + 1 for key in (1, 2, 3)]
            for kind in KINDS
        }

    def pack(self) -> bytes:
        """Table in packed form for the kernel."""
        counts = [len(self.size), *self.bins["flight"], *self.bins["roll"], len(self.record)]
        scales = [getattr(self, name) for name in SCALES]
        parts = [
            np.array(counts, "i4"), *(getattr(self, name).astype("f8") for name in OF_PART),
            np.array(scales, "f8"), *(self._packed_edges(kind) for kind in KINDS),
            (self.first + 1).astype("i4"),
            np.concatenate(
                [self.map.reshape(len(self.map), -1), self.low, self.high], axis=1
            ).astype("f8"),
            self.record.astype("f4"),
        ]  # fmt: skip
        return FIRST_LINE + b"".join(part.tobytes() for part in parts) + b"\n"

    def _packed_edges(self, kind: str) -> np.ndarray:
        """Edges by part; within it each edge before those of the next key in its bin."""
        first, second, third = (self.edges[f"{kind}_edge_{key}"] for key in (1, 2, 3))
        edges: list[np.ndarray] = []
        for part in range(len(self.size)):
            edges.append(first[part])
            for i, row in enumerate(second[part]):
                edges += [row, third[part, i].ravel()]
        return np.concatenate(edges).astype("f8")


def save_table(table: ImpactTable, path: str | Path) -> None:
    """Write a table as netCDF."""
    with atomic_write(path) as part:
        _write(table, part)


def save_ensemble(tables: Sequence[ImpactTable], path: str | Path) -> None:
    """Write draws of a table as netCDF, one group each: 1, 2, ..."""
    with atomic_write(path) as part:
        for number, table in enumerate(tables, start=1):
            _write(table, part, group=str(number), mode="w" if number == 1 else "a")


def _write(table: ImpactTable, path: Path, **where: Any) -> None:
    import xarray as xr

    data: dict[str, Any] = {
        **{name: ("part", getattr(table, name), {"long_name": OF_PART[name]}) for name in OF_PART},
        "first": ("bin_end", table.first.astype("i4"), {"long_name": "first record of each bin"}),
        "map": (("bin", "mapped", "input"), table.map.astype("f4")),
        "low": (("bin", "input"), table.low.astype("f4")),
        "high": (("bin", "input"), table.high.astype("f4")),
    }
    for name, values in table.edges.items():
        dims = ("part", *(f"{name}_{k}" for k in range(values.ndim - 1)))
        data[name] = (dims, values.astype("f4"))
    for k, name in enumerate(FIELDS):
        data[name] = ("record", table.record[:, k])
    scales = {name: getattr(table, name) for name in SCALES}
    dataset = xr.Dataset(data, attrs={"title": "table of impacts", **scales, **table.attrs})
    write_compressed(dataset, path, 9, **where)


@cache
def shipped_tables() -> dict[str, Path]:
    """Files of the shipped tables, by name."""
    folder = Path(str(importlib.resources.files("rockfall") / "data" / "impact_tables"))
    return {path.stem: path for path in sorted(folder.glob("*.nc"))}


def table_names() -> list[str]:
    """Names of shipped tables in cases: without the shape, which is that of the boulder."""
    return [name for name in _names() if not name.endswith(ENSEMBLE)]


def ensemble_names() -> list[str]:
    """Names of shipped ensembles of tables, which only `&ensemble sets` accepts."""
    return [name for name in _names() if name.endswith(ENSEMBLE)]


def _names() -> list[str]:
    endings = tuple(f"-{shape}" for shape in BLOCK_SHAPES)
    names = {
        name.rsplit("-", 1)[0] if name.endswith(endings) else name for name in shipped_tables()
    }
    return sorted(names)


def possible_shapes(case: Case) -> list[str]:
    """Block shapes that a case gives its boulders: with a share above zero, or by their axes."""
    given = facts(case, "boulder")
    return [shape for shape in BLOCK_SHAPES if getattr(given, f"is_{shape}")]


def find_table(case: Case, name: str) -> Path | None:
    """File of the table with a name: shipped, for the first block shape of the case if there are
    several, or next to the case; None if there is none."""
    shipped = shipped_tables()
    for full_name in (name, f"{name}-{(possible_shapes(case) or BLOCK_SHAPES)[0]}"):
        if full_name in shipped:
            return shipped[full_name]
    if name.endswith(".nc") and os.path.isfile(case.path(name)):
        return case.path(name)
    return None


def tables_by_shape(name: str, path: str | Path) -> dict[str, Path]:
    """Files of the tables of a ground by block shape, given its name and the file of one of them;
    {} if it has one table for all shapes."""
    stem, _, shape = Path(path).stem.rpartition("-")
    shipped = shipped_tables()
    if shape not in BLOCK_SHAPES or name == f"{stem}-{shape}" or Path(path) not in shipped.values():
        return {}
    files = {shape: shipped.get(f"{stem}-{shape}") for shape in BLOCK_SHAPES}
    return {shape: file for shape, file in files.items() if file is not None}


def open_table(path: str | Path) -> ImpactTable:
    """Read the table of a file written by `save_table`."""
    tables = open_tables(path)
    if len(tables) > 1:
        raise RockfallError(
            f"{path}: holds {len(tables)} draws of a table, which &ensemble sets takes; one alone "
            "is no ground"
        )
    return tables[0]


def open_tables(path: str | Path) -> tuple[ImpactTable, ...]:
    """Read all draws of a file written by `save_ensemble`, or the single table of another file. A
    file is read once, and again when it has been replaced."""
    state = os.stat(path)
    return _read_tables(os.path.abspath(path), path, (state.st_ino, state.st_mtime_ns))


@lru_cache(maxsize=32)
def _read_tables(place: str, path: str | Path, state: tuple[int, int]) -> tuple[ImpactTable, ...]:
    """Read all tables of a file; the first and last arguments are cache keys."""
    try:
        with open_netcdf(path) as file:
            groups: list[str | None] = list(file.groups) or [None]
        tables = [load_dataset(path, group=group) for group in groups]
    except RockfallError:
        raise
    except (OSError, ValueError, RuntimeError) as error:
        raise RockfallError(
            f"{path}: is not a netCDF file of a table of impacts: {error}"
        ) from error
    return tuple(_table(data, path) for data in tables)


def _table(data: xr.Dataset, path: str | Path) -> ImpactTable:
    arrays = {*OF_PART, "first", "map", "low", "high", *EDGES, *FIELDS}
    if not (arrays <= set(data.variables) and set(SCALES) <= set(data.attrs)):
        raise RockfallError(f"{path}: is not a table of impacts of this version: make it again")
    record = np.stack([data[name].values for name in FIELDS], axis=1).astype("f4")
    first, shift, low, high = (data[name].values for name in ("first", "map", "low", "high"))
    edges = {name: data[name].values for name in EDGES}
    attrs = {str(name): value for name, value in data.attrs.items() if name not in SCALES}
    scales = {name: float(data.attrs[name]) for name in SCALES}
    size, speed2, fastest = (data[name].values for name in OF_PART)
    return ImpactTable(
        size, speed2, fastest, edges, first, shift, low, high, record, **scales, attrs=attrs
    )
