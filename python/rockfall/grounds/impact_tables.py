# SPDX-License-Identifier: BSD-3-Clause
"""Impact tables: netCDF files, and their arrays in a scene (docs/impact_tables.md)."""

from __future__ import annotations

import importlib.resources
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cache, lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from rockfall.case import Case, facts, keys_of
from rockfall.errors import RockfallError
from rockfall.io.atomic import atomic_write
from rockfall.io.netcdf import load_dataset, write_compressed
from rockfall.kernel_rules import USUAL_WEIGHT

FIELDS = (
    "vt_in", "vn_in", "w_in", "speed_in", "height_in", "along_out", "across_out", "vn_out", "w_out",
    "duration", "advance", "rise", "pull_along", "pull_across", "exit", "follower",
)  # fmt: skip
INPUTS, MAPPED = 4, 3  # number of inputs (V_t, V_n, W, height) and outputs (along, V_n, W) of a map
BY_SOURCE = "source"  # value of block_shape if sources give the shapes
#: Block shapes, numbered from 1.
BLOCK_SHAPES = tuple(
    shape for shape in keys_of("boulder")["block_shape"].allowed.split(", ") if shape != BY_SOURCE
)
SIZE = "R_b/R_m, or rho_b g R_b / strength for yielding ground"
BY_BIN = "map", "low", "high"  # arrays with a value for each bin
KINDS = "flight", "roll"
EDGES = tuple(f"{kind}_edge_{key}" for kind in KINDS for key in (1, 2, 3))
MARGIN = 3.3  # range of strengths covered, in standard deviations

#: Laboratory parameters common to all grounds of a model (docs/impact_tables.md), with little
#: influence on contacts.
CONSTANTS: dict[str, dict[str, Any]] = {
    "ploughed": {
        "plough": True,
        "friction": 0.5,
        "soil_density": 1800.0,
        "longest": 32.0,
        "hurst": 0.8,
    },
    "hard": {
        "plough": False,
        "friction": 0.6,
        "soil_density": 0.0,
        "longest": 32.0,
        "hurst": 0.8,
    },
}


class YieldingGround(NamedTuple):
    """Ground with an impact table, as a row of a ground table (docs/grounds.md)."""

    rest_angle: float = 90.0  # stopped boulders roll again on steeper ground [degree]
    strength: float = 0.0  # median yield pressure [Pa]; 0: never yields
    strength_sigma: float = 0.0  # standard deviation of ln(strength) between boulders [-]
    strength_radius: float = 0.0  # R_b [m] of this strength if proportional to R_b; else 0
    relief: float = 0.0  # standard deviation of the slope of the relief [degree]
    relief_radius: float = 1.0  # R_b [m] at which this relief applies
    hurst: float = 1.0  # exponent: the slope is proportional to R_b**(hurst - 1)

    def sizes(self, radius: np.ndarray, weight: float = USUAL_WEIGHT) -> np.ndarray:
        """Size parameter rho_b g R_b/strength for radii R_b [m] and unit weight rho_b g [N/m3]."""
        scale = radius / self.strength_radius if self.strength_radius else np.ones_like(radius)
        return weight * radius / (self.strength * scale)

    def reliefs(self, radius: np.ndarray) -> np.ndarray:
        """Slope of the relief [degree] for boulders with radii R_b [m]."""
        return self.relief * (radius / self.relief_radius) ** (self.hurst - 1)


@dataclass(frozen=True, eq=False)
class ImpactTable:
    """Records of contacts in bins (theory, chapter 5), in parts by boulder size (columns) and
    ground relief (rows), stored row by row. Arrays of edges: (part, bins of the previous keys,
    edges). `map` (bin, MAPPED, INPUTS), `low` and `high` (bin, INPUTS). `record` (record, FIELDS)
    is ordered by bin; bin b starts at the 0-based index `first[b]`."""

    size: np.ndarray  # (column): R_b/R_m, or rho_b g R_b/strength for yielding ground
    relief: np.ndarray  # (row): slope of the relief [degree]
    edges: dict[str, np.ndarray]
    first: np.ndarray
    map: np.ndarray
    low: np.ndarray
    high: np.ndarray
    record: np.ndarray
    inertia: float  # I/(m R_b^2)
    ground: YieldingGround
    attrs: dict[str, Any] = field(default_factory=dict)

    @property
    def bins(self) -> dict[str, list[int]]:
        """Numbers of bins by key, for each kind of contact."""
        return {
            kind: [self.edges[f"{kind}_edge_{key}"].shape[-1] + 1 for key in (1, 2, 3)]
            for kind in KINDS
        }

    def equals(self, other: ImpactTable) -> bool:
        """Return True if another table is bit-identical for the kernel."""
        own, others = table_arrays([self]), table_arrays([other])
        return own.keys() == others.keys() and all(
            np.array_equal(array, others[name]) for name, array in own.items()
        )

    def columns(self, low: float, high: float) -> ImpactTable:
        """Part of a table with a single row: the columns for sizes from `low` to `high`."""
        kept = _around(self.size, low, high)
        per_part = (len(self.first) - 1) // len(self.size)
        bins = slice(kept.start * per_part, kept.stop * per_part)
        first = self.first[bins.start : bins.stop + 1]
        record = self.record[first[0] : first[-1]].copy()
        follower = record[:, FIELDS.index("follower")]
        follower[follower > 0] -= first[0]
        return replace(
            self, size=self.size[kept], first=first - first[0], record=record,
            edges={name: values[kept] for name, values in self.edges.items()},
            map=self.map[bins], low=self.low[bins], high=self.high[bins],
        )  # fmt: skip


def table_arrays(tables: Sequence[ImpactTable]) -> dict[str, np.ndarray]:
    """Arrays of consecutive tables in a scene (docs/files.md); {} without tables."""
    arrays: dict[str, list[np.ndarray]] = {}
    for table in tables:
        sizes = len(table.size), len(table.relief)
        shape = [*sizes, *table.bins["flight"], *table.bins["roll"], len(table.record)]
        bins = len(table.map)
        own = {
            "shape": np.array([shape], "i4"),
            "scale": np.array([[table.inertia, *table.ground]]),
            "size": table.size,
            "relief": table.relief,
            "edge": np.concatenate([table.edges[name].ravel() for name in EDGES]),
            "first": (table.first + 1).astype("i4"),
            "map": np.concatenate([table.map.reshape(bins, -1), table.low, table.high], axis=1),
            "record": table.record,
        }
        for name, values in own.items():
            arrays.setdefault(f"table_{name}", []).append(values)
    whole = {name: parts[0] if len(parts) == 1 else np.concatenate(parts)
             for name, parts in arrays.items()}  # fmt: skip
    return {name: values for name, values in whole.items() if values.size}


def _around(values: np.ndarray, low: float, high: float) -> slice:
    """Slice of increasing values that encloses a range, or the nearest values."""
    last = len(values) - 1
    first = min(max(int(np.searchsorted(values, low, "right")) - 1, 0), last)
    return slice(first, max(first, min(int(np.searchsorted(values, high)), last)) + 1)


def joined_rows(rows: Sequence[ImpactTable], ground: YieldingGround) -> ImpactTable:
    """Join rows with equal columns and bins to the table of a ground."""
    before = np.cumsum([0, *(len(row.record) for row in rows)])
    records = [row.record.copy() for row in rows]
    for record, start in zip(records, before, strict=False):
        follower = record[:, FIELDS.index("follower")]
        follower[follower > 0] += start
    whole: dict[str, Any] = {
        name: np.concatenate([getattr(row, name) for row in rows]) for name in BY_BIN
    }
    firsts = [row.first[:-1] + start for row, start in zip(rows, before, strict=False)]
    return ImpactTable(
        size=rows[0].size, relief=np.concatenate([row.relief for row in rows]),
        edges={name: np.concatenate([row.edges[name] for row in rows]) for name in EDGES},
        first=np.append(np.concatenate(firsts), before[-1]), record=np.concatenate(records),
        inertia=float(np.mean([row.inertia for row in rows])), ground=ground, **whole,
    )  # fmt: skip


def plane_table(
    model: str,
    shape: str,
    ground: YieldingGround,
    radii: np.ndarray,
    weight: float = USUAL_WEIGHT,
) -> ImpactTable:
    """Parts of a plane of impact tables that boulders need if R_b is between radii[0] and radii[1]
    [m], with this unit weight [N/m3]. The ground's strength varies by MARGIN standard deviations.
    """
    files = plane_files(model, shape)
    reliefs = np.array(list(files))
    sizes, slopes = np.sort(ground.sizes(radii, weight)), np.sort(ground.reliefs(radii))
    spread = float(np.exp(MARGIN * ground.strength_sigma))
    rows = [open_table(files[relief]) for relief in reliefs[_around(reliefs, *slopes)].tolist()]
    low, high = sizes[0] / spread, sizes[1] * spread
    return joined_rows([row.columns(low, high) for row in rows], ground)


def reliefs_thrown(model: str, shapes: Sequence[str]) -> tuple[float, float]:
    """Minimum and maximum relief [degree] for which a plane has tables of all these shapes."""
    rows = [list(plane_files(model, shape)) for shape in shapes]
    return max(reliefs[0] for reliefs in rows), min(reliefs[-1] for reliefs in rows)


def softest_thrown(model: str) -> float:
    """Largest size parameter, rho_b g R_b/strength, for which a plane has tables."""
    return float(open_table(next(iter(plane_files(model, BLOCK_SHAPES[0]).values()))).size[-1])


@cache
def plane_files(model: str, shape: str) -> dict[float, Path]:
    """Files with the rows of a plane, by increasing relief [degree]."""
    files = {
        float(name.rpartition("-")[2]): path
        for name, path in shipped_tables().items()
        if name.startswith(f"{model}-{shape}-")
    }
    return dict(sorted(files.items()))


def save_table(table: ImpactTable, path: str | Path) -> None:
    """Write a table as netCDF."""
    with atomic_write(path) as part:
        _write(table, part)


def _write(table: ImpactTable, path: Path) -> None:
    import xarray as xr

    data: dict[str, Any] = {
        "size": ("column", table.size, {"long_name": SIZE}),
        "relief": ("row", table.relief, {"long_name": "slope of the relief", "units": "degree"}),
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
    scales = {"inertia": table.inertia, **table.ground._asdict()}
    dataset = xr.Dataset(data, attrs={"title": "impact table", **scales, **table.attrs})
    write_compressed(dataset, path, 6)  # 9 takes four times as long for 0.5 % less


@cache
def shipped_tables() -> dict[str, Path]:
    """Files of shipped tables, by name."""
    folder = Path(str(importlib.resources.files("rockfall") / "data" / "impact_tables"))
    return {path.stem: path for path in sorted(folder.glob("*.nc"))}


def possible_shapes(case: Case) -> list[str]:
    """Block shapes of a case's boulders: shapes with a fraction above zero, or given by axes."""
    given = facts(case, "boulder")
    return [shape for shape in BLOCK_SHAPES if getattr(given, f"is_{shape}")]


def own_table(case: Case, name: str) -> Path | None:
    """File of a table that a case names: shipped for all shapes, or a .nc file; None for others."""
    if name in tables_of_all_shapes():
        return shipped_tables()[name]
    if name.endswith(".nc") and os.path.isfile(case.path(name)):
        return case.path(name)
    return None


@cache
def tables_of_all_shapes() -> list[str]:
    """Names of shipped tables that do not belong to planes."""
    return [name for name in shipped_tables() if not re.search(r"-[0-9.]+$", name)]


@lru_cache(maxsize=64)
def _read_table(place: str, path: str | Path, state: tuple[int, int]) -> ImpactTable:
    """Read a table from a file; the first and last arguments are only cache keys. Raises a
    RockfallError for a file that is not such a table."""
    try:
        data = load_dataset(path)
    except RockfallError:
        raise
    except (OSError, ValueError, RuntimeError) as error:
        raise RockfallError(f"{path}: is not a netCDF impact table: {error}") from error
    arrays = {"size", "relief", "first", *BY_BIN, *EDGES, *FIELDS}
    numbers = {"inertia", *YieldingGround._fields}
    if not (arrays <= set(data.variables) and numbers <= set(data.attrs)):
        raise RockfallError(f"{path}: is not an impact table of this version: create it again")
    ground = YieldingGround(*(float(data.attrs[name]) for name in YieldingGround._fields))
    return ImpactTable(
        **{name: data[name].values for name in ("size", "relief", "first", *BY_BIN)},
        edges={name: data[name].values for name in EDGES},
        record=np.stack([data[name].values for name in FIELDS], axis=1).astype("f4"),
        inertia=float(data.attrs["inertia"]), ground=ground,
        attrs={str(name): value for name, value in data.attrs.items() if name not in numbers},
    )  # fmt: skip


def open_table(path: str | Path) -> ImpactTable:
    """Read a file written by `save_table`; cached until the file changes."""
    state = os.stat(path)
    return _read_table(os.path.abspath(path), path, (state.st_ino, state.st_mtime_ns))
