# SPDX-License-Identifier: BSD-3-Clause
"""Trees generated from rasters or polygons of stems per hectare, diameters and fraction of
conifers.

A tree depends only on the forest seed and its cell, not on threads or blocks of rows. Diameters
follow a gamma distribution, sampled by inversion, and are rounded to 0.1 mm, because the last bits
of SciPy's results may differ between platforms.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from rockfall._core import rockfall_f2py as _core
from rockfall.errors import RockfallError
from rockfall.io.rasters.grid import row_blocks
from rockfall.language import remark
from rockfall.quantities import percent
from rockfall.scene.forest.attributes import LIMITS
from rockfall.scene.forest.species import BROADLEAF, CONIFER, Species, read_species
from rockfall.scene.forest.stands import Stands, read_stands
from rockfall.scene.forest.thinning import is_thinned
from rockfall.scene.forest.trees import HECTARE, Planted, Trees
from rockfall.scene.layers import Inputs

MAX_STEMS = 1e8  # maximum stems in a forest
THINNEST = 20.0  # stems per hectare (22 m apart); fewer are single trees, not a stand
DECIMALS = 2  # decimals of a diameter in cm
NARROW, WIDE = 0.05, 1.0  # standard deviation / mean of diameters; real stands have 0.2 to 0.7
DENSER, REMAINS = 0, 1  # indices of the random numbers for stands and thinning


class Cells(NamedTuple):
    """Raster cells of trees: row indices (sorted) and column indices."""

    row: np.ndarray
    column: np.ndarray


def made_trees(inputs: Inputs) -> tuple[Planted, Stands | None]:
    """Generate trees from the stem densities of a case; return them and the stands of its layer."""
    grid, table, seed = inputs.grid, read_species(inputs), inputs.case.forest["seed"]
    stands = read_stands(inputs, table)
    columns = {row: trees for row, trees in _columns(inputs, stands) if trees.size}
    if not columns:
        raise _treeless(inputs)
    rows = sorted(columns)
    sizes = [columns[row].size for row in rows]
    cells = Cells(
        np.repeat(np.array(rows, "i4"), sizes), np.concatenate([columns[k] for k in rows])
    )
    numbers = np.empty((4, cells.row.size))
    more = np.empty((2, cells.row.size if stands or is_thinned(inputs.case) else 0))
    for row, stop, size in zip(rows, np.cumsum(sizes), sizes, strict=True):
        counts = np.bincount(columns[row], minlength=grid.nx).astype("i4")
        own, stems = slice(stop - size, stop), (seed, grid.nx, row + 1, counts)
        numbers[:, own] = _core.stand_numbers(*stems, 4, size)
        if more.size:
            more[:, own] = _core.stand_numbers(*stems, 2, size)
    x, y, quantile, species = numbers
    x[:] = grid.west + (cells.column + x) * grid.cell
    y[:] = grid.north - (cells.row + 1 - y) * grid.cell
    stand = None
    if stands is not None:
        stand = stands.at(x, y)
        remains = stands.thinned(stand, cells.row, cells.column, more[DENSER])
        if not remains.any():
            raise _treeless(inputs)
        x, y, quantile, species = numbers[:, remains]
        stand, more = stand[remains], more[:, remains]
        cells = Cells(cells.row[remains], cells.column[remains])
    dbh = _diameters(inputs, cells, quantile, stands, stand)
    factor = _factors(inputs, cells, species, stands, stand, table)
    return Planted(Trees(x, y, dbh, factor), more[REMAINS] if more.size else None, stand), stands


def _treeless(inputs: Inputs) -> RockfallError:
    return RockfallError(
        f"{inputs.case.name}: &forest: no trees on the terrain at these stems per hectare"
    )


def _columns(inputs: Inputs, stands: Stands | None) -> Iterator[tuple[int, np.ndarray]]:
    """Yield each row number with the columns of its trees; refuses too many trees."""
    forest, nx, total, densest = inputs.case.forest, inputs.grid.nx, 0.0, 0.0
    columns, even = np.arange(nx, dtype="i4"), int(forest["spread"] == "even")
    per_cell = inputs.grid.cell**2 / HECTARE
    for rows, block in _densities(inputs, stands):
        density = np.nan_to_num(np.asarray(block, float))  # no trees where the density is missing
        _check(inputs, "stems", density)
        total += density.sum() * per_cell
        densest = max(densest, density.max(initial=0.0))
        if total > MAX_STEMS:
            raise RockfallError(f"{inputs.case.name}: &forest: more than {MAX_STEMS:,.0f} trees")
        for row, expected in enumerate(density * per_cell, start=rows.start):
            counts = _core.stand_counts(forest["seed"], nx, row + 1, expected, even)
            yield row, np.repeat(columns, counts)
    if densest < THINNEST:
        key = "input.thin_cells" if stands is None else "input.thin_stands"
        inputs.remarks.append(remark("&forest stems", key, densest=float(densest)))


def _densities(inputs: Inputs, stands: Stands | None) -> Iterator[tuple[slice, np.ndarray]]:
    """Yield blocks of rows: stems per hectare, from a raster or from the densest stand in each
    cell."""
    if stands is None:
        yield from _blocks(inputs, "stems")
        return
    for rows in row_blocks(inputs.grid.shape):
        yield rows, stands.by_rank[stands.ranks[rows]]


def _diameters(
    inputs: Inputs, cells: Cells, u: np.ndarray, stands: Stands | None, stand: np.ndarray | None
) -> np.ndarray:
    """Diameters [cm]: quantiles `u` of gamma distributions (shape (mean/std)**2, scale std**2/mean)
    of the stems' stands or cells."""
    from scipy.special import gammaincinv

    mean, std = (
        _at_trees(inputs, key, cells)
        if stands is None or stand is None or key not in stands.values
        else stands.values[key][stand]
        for key in ("dbh_mean", "dbh_std")
    )
    _check(inputs, "dbh_mean", mean)
    _check(inputs, "dbh_std", std)
    _note_spread(inputs, mean, std)
    dbh, varied = mean.copy(), std > 0
    shape = (mean[varied] / std[varied]) ** 2
    dbh[varied] = gammaincinv(shape, u[varied]) / shape * mean[varied]
    return np.maximum(np.round(dbh, DECIMALS), 10.0**-DECIMALS)


def _note_spread(inputs: Inputs, mean: np.ndarray, std: np.ndarray) -> None:
    """Add a remark on standard deviations that may be in another unit or in percent of the mean."""
    ratio = std / mean
    for key, odd in (
        ("input.dbh_narrow", (std > 0) & (ratio < NARROW)),
        ("input.dbh_wide", ratio > WIDE),
    ):
        if odd.any():
            k = int(np.argmax(odd))
            values = {"std": float(std[k]), "mean": float(mean[k]), "part": percent(odd.mean())}
            inputs.remarks.append(remark("&forest dbh_std", key, **values))


def _factors(
    inputs: Inputs, cells: Cells, u: np.ndarray, stands: Stands | None, stand: np.ndarray | None,
    table: Species,
) -> np.ndarray:  # fmt: skip
    """Toughness factor of each stem, drawn with its uniform number `u`: from the species of its
    stand, or as a conifer or broadleaf by the fraction in its cell or stand."""
    unmixed, factors = np.arange(u.size), np.empty(u.size)
    if stands is not None and stand is not None:
        unmixed = np.flatnonzero(~stands.draw_species(stand, u, factors))
    if not unmixed.size:
        return factors
    if stands is not None and stand is not None and "conifers" in stands.values:
        percent = stands.values["conifers"][stand[unmixed]]
        shares = _shares(inputs, percent)
    else:
        shares = conifer_shares(inputs, Cells(cells.row[unmixed], cells.column[unmixed]))
    conifer = u[unmixed] < shares
    factors[unmixed] = np.where(conifer, table.factors[CONIFER], table.factors[BROADLEAF])
    return factors


def conifer_shares(inputs: Inputs, cells: Cells) -> np.ndarray:
    """Fraction of conifers among the stems in cells, 0 to 1."""
    return _shares(inputs, _at_trees(inputs, "conifers", cells))


def _shares(inputs: Inputs, percent: np.ndarray) -> np.ndarray:
    """Fractions from percentages of conifers; a remark warns of values that may be fractions."""
    _check(inputs, "conifers", percent)
    if 0 < percent.max() <= 1:
        largest = float(percent.max())
        inputs.remarks.append(remark("&forest conifers", "input.conifers", largest=largest))
    return percent / 100


def _at_trees(inputs: Inputs, key: str, cells: Cells) -> np.ndarray:
    """Values of a key at the trees: from its raster, or its uniform value."""
    values = np.empty(cells.row.size)
    for rows, block in _blocks(inputs, key):
        in_rows = slice(*np.searchsorted(cells.row, [rows.start, rows.stop]))
        values[in_rows] = block[cells.row[in_rows] - rows.start, cells.column[in_rows]]
    return values


def _blocks(inputs: Inputs, key: str) -> Iterator[tuple[slice, np.ndarray]]:
    """Yield blocks of rows of a key's raster, or of its uniform value."""
    uniform = inputs.case.forest.get(f"uniform_{key}")
    if uniform is None:
        yield from inputs.blocks(key, f"values of {key}", np.float32)
        return
    for rows in row_blocks(inputs.grid.shape):
        yield rows, np.broadcast_to(uniform, (rows.stop - rows.start, inputs.grid.nx))


def _check(inputs: Inputs, key: str, values: np.ndarray) -> None:
    """Raise a RockfallError for invalid values in cells that get trees."""
    low, high, rule = LIMITS[key]
    good = (values >= low) & (values <= high)
    if good.all():
        return
    forest = inputs.case.forest
    where = inputs.case.path(forest[key]) if key in forest else f"{inputs.case.name}: &forest {key}"
    first = values[~good].flat[0]
    raise RockfallError(f"{where}: {first:g} where trees stand: must be {rule}")
