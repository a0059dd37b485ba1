# SPDX-License-Identifier: BSD-3-Clause
"""All variables of a result, from the kernel's table: CF attributes by group and name."""

import numpy as np

from rockfall._core import rockfall_f2py as _core

_TABLE: dict[str, dict[str, dict[str, str]]] = {}  # groups in the kernel's order
TYPES: dict[str, dict[str, str]] = {}  # types in part files, by group and name
SAMPLE_DIMS: dict[str, tuple[str, ...]] = {}  # dimensions of samples in files
while _text := _core.table_row("variables", sum(map(len, TYPES.values())) + 1).decode().strip():
    _group, _name, _type, _axes, *_rest = _text.split("|")
    _about = zip(("units", "long_name", "comment"), _rest, strict=True)
    _TABLE.setdefault(_group, {})[_name] = {key: value for key, value in _about if value}
    TYPES.setdefault(_group, {})[_name] = _type
    if _axes:
        SAMPLE_DIMS[_name] = tuple(f"sample_{axis}" for axis in _axes.split())

BOULDER = _TABLE["boulder"]
COUNT = _TABLE["count"]  # sums over all boulders
GROUND = _TABLE["ground"]  # counts by ground
ENERGY = _TABLE["energy"]  # a value per boulder, on request
FEATURE = _TABLE["feature"]  # a value per boulder, if the source is from a layer
SHAPE = _TABLE["shape"]  # a value per boulder, if there are several block shapes
MASS = _TABLE["mass"]  # a value per boulder, if the source is from a layer or gives densities
SHADOW = _TABLE["shadow"]  # a value per boulder, if an angle was observed; NaN without an apex
TREE = _TABLE["tree"]  # a value per boulder, if there are trees
BREAKAGE = _TABLE["breakage"]  # a value per boulder, if boulders may break
CROSSING = _TABLE["crossing"]  # a value per line crossing: crossing_time, ...
FRAGMENT = _TABLE["fragment"]  # a value per crossing, if boulders may break: crossing_volume, ...
HIT = _TABLE["hit"]  # a value per crossing, if there are barriers: crossing_outcome
LINE = _TABLE["line"]  # quantities derived from a crossing, not in files
LINE_VERTEX = _TABLE["line_vertex"]
BARRIER = _TABLE["barrier"]  # names in files: barrier_height, ...
MAP = _TABLE["map"]
HISTOGRAM = _TABLE["histogram"]  # in the kernel's order; `units` refers to the bins
VERTEX = _TABLE["vertex"]  # names in files: trajectory_x, ...
KEPT = _TABLE["kept"]  # numbers of the boulders with rows in a part, unless all have rows
SAMPLE = _TABLE["sample"]  # names in part files and results: sample_block, ...
STATUS = {name: number for number, name in enumerate(_TABLE["status"], start=1)}
OUTCOME = {name: number for number, name in enumerate(_TABLE["outcome"], start=1)}
BLOCK_SHAPE = {
    name: number for number, name in enumerate(_core.fields("block_shape").decode().split(), 1)
}
FLAGS = {
    "status": STATUS, "block_shape": BLOCK_SHAPE, "crossing_outcome": {"not_met": 0, **OUTCOME},
}  # fmt: skip
LEG = {name: number for number, name in enumerate(_TABLE["leg"], start=1)}  # 0: the end

ENDS = "", "_low", "_high"  # suffixes for a value and its interval limits
EXCEEDED = ("energy_exceeded", "hits_energy_exceeded")  # maps with a layer for each threshold


def about(group: str, name: str) -> dict[str, str]:
    """CF attributes of a variable."""
    return _TABLE[group][name]


def map_dims(name: str) -> tuple[str, ...]:
    """Names of the dimensions of a map."""
    return ("threshold", "y", "x") if name in EXCEEDED else ("y", "x")


def fault_of(name: str, values: np.ndarray) -> str:
    """Error text for values of a variable (name in files) that are impossible; "" if valid."""
    return _core.value_fault(name, np.ravel(values)).decode().strip() if values.size else ""


def fields(rows: str) -> list[str]:
    """Names in one of the kernel's lists; `rows` names the list, such as "vertex" (columns)."""
    return _core.fields(rows).decode().split()
