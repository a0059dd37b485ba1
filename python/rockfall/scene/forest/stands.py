# SPDX-License-Identifier: BSD-3-Clause
"""Forest stands: polygons with stems per hectare, diameters, and conifers or species.

Each cell that polygons touch draws a number of stems with the density of its densest polygon,
anywhere in the cell. A stem in a polygon is kept with the probability (density of its polygon) /
(density of the densest). A thinned Poisson process is a Poisson process (Lewis and Shedler 1979),
so in a cell cut by an edge each part gets stems in proportion to its area and density. A cell
inside a single polygon has the same stems as a cell of a raster with these values.
"""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from rockfall.errors import RockfallError
from rockfall.io.vectors.layers import read_polygons
from rockfall.io.vectors.polygons import (
    HALF,
    disjoint,
    note_outside,
    on_terrain,
    points_inside,
    touched_cells,
)
from rockfall.language import remark
from rockfall.scene.forest.attributes import NAMES, Attributes
from rockfall.scene.forest.species import Species
from rockfall.scene.forest.trees import HECTARE, Stand
from rockfall.scene.layers import Inputs

PART = re.compile(r"(?P<name>[^\d%]*[^\d%\s])\s*(?P<percent>\d+(\.\d+)?)?\s*%?")
STAND = "stems", "dbh_mean", "dbh_std", "conifers", "species", "name"  # attributes of a stand layer
WHOLE = 1.0  # tolerance for the sum of a stand's species [%]
SMALLEST = {"stems": 1.0, "dbh_mean": 4.0, "conifers": 1.0}  # smaller values: 1/m2, m, fractions?


class Mixture(NamedTuple):
    """Mixture of species in a stand."""

    limits: np.ndarray  # cumulative fractions
    factors: np.ndarray  # toughness of each species


class Stands(NamedTuple):
    """Stands in the order of their layer."""

    names: list[str]
    shapes: np.ndarray  # polygons clipped to the terrain, without overlaps
    density: np.ndarray  # stems per hectare
    values: dict[str, np.ndarray]  # dbh_mean, dbh_std, conifers, if the layer has them
    mixtures: list[Mixture | None]  # None: conifers and broadleaves only
    ranks: np.ndarray  # (ny, nx) density rank of the densest stand that touches a cell; 0: none
    by_rank: np.ndarray  # stems per hectare by rank

    def at(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Index of the stand at each point x, y [m]; -1 outside all stands."""
        stand = np.full(x.size, -1, "i4")
        for k, inside in points_inside(self.shapes, x, y):
            stand[inside] = k
        return stand

    def thinned(
        self, stand: np.ndarray, row: np.ndarray, column: np.ndarray, u: np.ndarray
    ) -> np.ndarray:
        """Mark the stems to keep, given the stand, the cell, and a uniform number of each stem."""
        densest = self.by_rank[self.ranks[row, column]]
        return (stand >= 0) & (u * densest < self.density[stand])

    def draw_species(self, stand: np.ndarray, u: np.ndarray, factors: np.ndarray) -> np.ndarray:
        """Set the toughness factors of stems in stands with named species, using a uniform number
        per stem. Return a mask of these stems."""
        drawn = np.zeros(u.size, bool)
        for k, mixture in enumerate(self.mixtures):
            if mixture is not None:
                members = np.flatnonzero(stand == k)
                which = np.searchsorted(mixture.limits[:-1], u[members], side="right")
                factors[members], drawn[members] = mixture.factors[which], True
        return drawn

    def records(self, stand: np.ndarray) -> tuple[Stand, ...]:
        """Stands with their numbers of stems, counted from the stand of each stem."""
        import shapely

        area = shapely.area(self.shapes) / HECTARE
        stems = np.bincount(stand, minlength=len(self.names))
        rows = zip(self.names, area.tolist(), self.density.tolist(), stems.tolist(), strict=True)
        return tuple(Stand(*row) for row in rows)


def read_stands(inputs: Inputs, table: Species) -> Stands | None:
    """Read the stands in the layer of a case; None if it has no layer. Refuses a layer without stem
    numbers."""
    forest, grid = inputs.case.forest, inputs.grid
    if "polygons" not in forest:
        return None
    path, layer = inputs.case.path(forest["polygons"]), forest.get("polygons_layer")
    shapes, columns = read_polygons(path, grid, inputs.remarks, layer, "polygons_layer")
    inputs.note_layer("stands", path, layer)
    attributes = Attributes(str(path), columns)
    attributes.note_unused(inputs.remarks, STAND)
    everywhere = np.ones(len(shapes), bool)
    density = attributes.numbers("stems", everywhere)
    if density is None:
        raise RockfallError(
            f"{path}: attribute stems [1/ha] is missing (or {', '.join(NAMES['stems'][1:])}; "
            f"attributes: {', '.join(columns) or 'none'})"
        )
    with_trees = density > 0
    mixtures = [
        _mixture(table, attributes, k, text) for k, text in enumerate(attributes.texts("species"))
    ]
    unmixed = with_trees & np.array([mixture is None for mixture in mixtures], bool)
    values = {}
    for key, needed in ("dbh_mean", with_trees), ("dbh_std", with_trees), ("conifers", unmixed):
        numbers = attributes.numbers(key, needed)
        _check_given_once(inputs, path, attributes, key, numbers, bool(needed.any()))
        if numbers is not None:
            values[key] = numbers
    names = [name or str(k) for k, name in enumerate(attributes.texts("name"), start=1)]
    _note_units(inputs.remarks, path, {"stems": density} | values, with_trees, names)
    parts, order = _areas(inputs, path, shapes), np.argsort(density, kind="stable")
    ranks = touched_cells(parts[order], np.arange(1, order.size + 1), grid)
    return Stands(names, parts, density, values, mixtures, ranks, np.append(0.0, density[order]))


def _note_units(
    remarks: list[str],
    path: Path,
    values: Mapping[str, np.ndarray],
    with_trees: np.ndarray,
    names: Sequence[str],
) -> None:
    """Add a remark on each value with a doubtful unit in some of the stands; a unit that is wrong
    in all of them is reported with the trees."""
    for key, smallest in SMALLEST.items():
        own = np.where(with_trees, values.get(key, 0.0), 0.0)
        odd = np.flatnonzero((own > 0) & (own <= smallest))
        if 0 < odd.size < np.count_nonzero(own > 0):
            place = {"n": odd.size, "name": names[odd[0]]}
            remarks.append(remark(path, "input.stand_unit", key=key, value=own[odd[0]], **place))


def _areas(inputs: Inputs, path: Path, shapes: np.ndarray) -> np.ndarray:
    """Polygons clipped to the terrain, without overlaps; refuses stands that are all outside."""
    import shapely

    note_outside(str(path), shapes, inputs.grid, HALF, inputs.remarks)
    shapes, shared = disjoint(shapes, str(path))
    if shared > 0:
        inputs.remarks.append(remark(path, "input.stands_overlap", area=float(shared)))
    parts = on_terrain(shapes, inputs.grid)
    if not shapely.area(parts).any():
        raise RockfallError(f"{path}: all stands are outside the terrain")
    return parts


def _check_given_once(
    inputs: Inputs, path: Path, attributes: Attributes, key: str, values: Any, needed: bool
) -> None:
    """Refuse a value that both the layer and the case give, or that neither gives although
    `needed`."""
    forest = inputs.case.forest
    given = [name for name in (key, f"uniform_{key}") if name in forest]
    if values is not None and given:
        raise RockfallError(
            f"{inputs.case.name}: &forest {given[0]}: attribute {attributes.own_name(key)} of "
            f"{path} gives it: omit one of the two"
        )
    if values is None and needed and not given:
        also = " or species" if key == "conifers" else ""
        raise RockfallError(
            f"{path}: attribute {key}{also} is missing: add it, or set &forest uniform_{key} "
            f"(attributes: {', '.join(attributes.columns) or 'none'})"
        )


def _mixture(table: Species, attributes: Attributes, k: int, text: str | None) -> Mixture | None:
    """Species mixture of a stand from a text: a name, or percentages: `spruce 60, beech 40`."""
    if text is None:
        return None
    parts = [PART.fullmatch(part.strip()) for part in re.split(r"[,;/]", text)]
    if not all(parts):
        raise attributes.refuse(k, "species", repr(text), "a species, or as 'spruce 60, beech 40'")
    percents = [part["percent"] for part in parts if part]
    if len(parts) == 1 and percents[0] is None:
        percents = ["100"]
    if None in percents or abs(sum(map(float, percents)) - 100) > WHOLE:
        raise attributes.refuse(
            k, "species", repr(text), "species with percentages that add to 100"
        )
    where = f"{attributes.where}: feature {k + 1}"
    factors = [table.factor(part["name"], where) for part in parts if part]
    fractions = np.cumsum([float(percent) for percent in percents])
    return Mixture(fractions / fractions[-1], np.array(factors))
