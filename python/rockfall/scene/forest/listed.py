# SPDX-License-Identifier: BSD-3-Clause
"""Trees from a list: a CSV file, or a layer of points."""

from array import array
from pathlib import Path
from sys import intern
from typing import NamedTuple

import numpy as np

from rockfall._core import rockfall_f2py as _core
from rockfall.case import is_given
from rockfall.errors import RockfallError
from rockfall.io.tables import check_needed, read_table
from rockfall.io.vectors.layers import EXTENSIONS, attribute, extent, named_attribute, read_points
from rockfall.io.vectors.unused_attributes import note_marks, note_unused
from rockfall.language import remark
from rockfall.limits import MAX_REAL
from rockfall.scene.forest.made import Cells, conifer_shares
from rockfall.scene.forest.species import BROADLEAF, CONIFER, Species, read_species
from rockfall.scene.forest.thinning import numbers_of_list
from rockfall.scene.forest.trees import MAX_DBH, Planted, Trees
from rockfall.scene.layers import Inputs

COLUMNS = "x", "y", "dbh", "species"  # columns of a CSV file
FIELDS = "dbh_field", "species_field"  # keys with the names of layer attributes
SPECIES_NUMBER = 3  # index of the random number that selects the species of a stem


class Listed(NamedTuple):
    """Listed trees, inside or outside the terrain."""

    x: np.ndarray  # map coordinates [m]
    y: np.ndarray
    dbh: np.ndarray  # [cm]
    species: list[str] | None  # None if the list has no species


def listed_trees(inputs: Inputs) -> Planted:
    """Trees of the case's list that are on the terrain; refuses a list without any."""
    path, grid = inputs.case.path(inputs.case.forest["trees"]), inputs.grid
    if path.suffix.lower() in EXTENSIONS:
        listed = _from_layer(path, inputs)
    elif "trees_layer" in inputs.case.forest:
        raise RockfallError(f"{inputs.case.name}: &forest trees_layer: is not valid for a table")
    else:
        listed = _from_table(path, inputs)
    inputs.note_layer("trees", path, inputs.case.forest.get("trees_layer"))
    note_marks(inputs.remarks, path, {"dbh": listed.dbh}, ["dbh"])
    x, y = listed.x, listed.y
    inside = (x >= grid.west) & (x < grid.east) & (y > grid.south) & (y <= grid.north)
    if not inside.any():
        raise RockfallError(
            f"{path}: all trees are outside the terrain: "
            f"{extent(x.min(), y.min(), x.max(), y.max())}; "
            f"the terrain: {extent(grid.west, grid.south, grid.east, grid.north)}"
        )
    if out := np.count_nonzero(~inside):
        numbers = {"part": int(out), "n": x.size}
        inputs.remarks.append(remark(path, "input.trees_outside", **numbers))
    if listed.species is None:
        factor = _drawn_factors(inputs, path, listed, inside)
    else:
        factor = _factors(read_species(inputs), path, listed.species)[inside]
    remain = numbers_of_list(inputs.case, x.size)
    trees = Trees(x[inside], y[inside], listed.dbh[inside], factor)
    return Planted(trees, None if remain is None else remain[inside])


def _from_table(path: Path, inputs: Inputs) -> Listed:
    """Read trees from a CSV file with fixed column names; refuses keys that name columns."""
    for key in FIELDS:
        if is_given(inputs.case, "forest", key):
            raise RockfallError(
                f"{inputs.case.name}: &forest {key}: is only valid with a layer: name the columns "
                f"of a table {', '.join(COLUMNS)}"
            )
    where, columns, rows = read_table(path)
    note_unused(inputs.remarks, path, columns, COLUMNS)
    check_needed(where, columns, ("x", "y", "dbh"))
    numbers = array("d")
    species: list[str] | None = [] if "species" in columns else None
    for row in rows:
        dbh = row.number("dbh", 0.0, MAX_DBH)
        if not dbh > 0:
            row.refuse("dbh", "must be > 0 [cm]")
        numbers.extend([row.number(axis, -MAX_REAL, MAX_REAL) for axis in "xy"])
        numbers.append(dbh)
        if species is not None:
            species.append(intern(row.text("species")))
    x, y, dbh = np.array(numbers).reshape(-1, 3).T.copy()
    return Listed(x, y, dbh, species)


def _from_layer(path: Path, inputs: Inputs) -> Listed:
    """Read trees from a point layer; the keys in FIELDS name its attributes. Refuses missing and
    invalid values."""
    forest = inputs.case.forest
    x, y, columns, feature = read_points(
        path, inputs.grid, inputs.remarks, forest.get("trees_layer"), "trees_layer"
    )
    field = forest["dbh_field"]
    column = named_attribute(path, columns, field)
    if column.dtype.kind not in "iuf":
        raise RockfallError(f"{path}: attribute {field}: must be a number [cm]")
    dbh = column.astype(float)
    for k in np.flatnonzero(~((dbh > 0) & (dbh <= MAX_DBH)))[:1]:
        raise RockfallError(
            f"{path}: feature {feature[k]}: {field} = {dbh[k]:g}: must be > 0 and at most "
            f"{MAX_DBH:g} [cm]"
        )
    field = forest["species_field"]
    names = attribute(columns, field)
    note_unused(inputs.remarks, path, columns, (forest["dbh_field"], field))
    if names is None and field == "species":
        return Listed(x, y, dbh, None)
    species = named_attribute(path, columns, field).tolist()
    for k, name in zip(feature, species, strict=True):
        if not isinstance(name, str) or not name.strip():
            raise RockfallError(f"{path}: feature {k}: has no {field}")
    return Listed(x, y, dbh, species)


def _factors(table: Species, path: Path, species: list[str]) -> np.ndarray:
    """Toughness factor of each tree, from its species."""
    factors: dict[str, float] = {}
    for k, name in enumerate(species, start=1):
        if name not in factors:
            factors[name] = table.factor(name, f"{path}: tree {k}")
    return np.array([factors[name] for name in species])


def _drawn_factors(inputs: Inputs, path: Path, listed: Listed, inside: np.ndarray) -> np.ndarray:
    """Toughness factor of each stem, drawn as conifer or broadleaf by the fraction in its cell.
    Refuses a forest without this fraction."""
    forest, grid, table = inputs.case.forest, inputs.grid, read_species(inputs)
    if "conifers" not in forest and "uniform_conifers" not in forest:
        raise RockfallError(
            f"{path}: has no species: add them, or set &forest conifers or uniform_conifers"
        )
    n = inside.size
    u = _core.stand_numbers(forest["seed"], n, 1, np.ones(n, "i4"), 4, n)[SPECIES_NUMBER, inside]
    row = ((grid.north - listed.y[inside]) / grid.cell).astype("i4").clip(0, grid.ny - 1)
    column = ((listed.x[inside] - grid.west) / grid.cell).astype("i4").clip(0, grid.nx - 1)
    order, share = np.argsort(row, kind="stable"), np.empty(row.size)
    share[order] = conifer_shares(inputs, Cells(row[order], column[order]))
    return np.where(u < share, table.factors[CONIFER], table.factors[BROADLEAF])
