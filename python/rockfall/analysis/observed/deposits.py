# SPDX-License-Identifier: BSD-3-Clause
"""Blocks mapped at rest with unknown release, and the density of simulated boulders at rest.

A run has N simulated boulders at rest, boulder j at x_j. The predictive density of a block at y is

    p(y) = (sum_j K_j(y - x_j) + a/A) / (N + a)

with the weight a = 1 of one boulder that may be anywhere in the deposit area A: the smoothed mean
of a Dirichlet process (Ferguson 1973). Where no boulder was simulated, the density is therefore not
zero, but below the density of a single boulder, the lowest that the run resolves. A block is
*outside of all deposits* if the kernels give less than a/A.

K_j is a normal kernel. Its width is half the distance from x_j to the k-th nearest boulder, at
least a cell, so that it covers about k boulders for any spacing (Breiman et al. 1977). k maximises
the likelihood of the simulated boulders of the case, each predicted from the others by the same
formula (leave-one-out, Habbema et al. 1974). For other numbers of boulders k is proportional to
N^(2/3), and the width to N^(-1/6) (Silverman 1986). If the volume of a block is known, boulders are
weighted by a normal kernel in log volume with Silverman's width, so that positions are compared at
equal size. If the shape is known, only boulders of this shape count, provided that the run has
several.

References: docs/theory/15-references.md.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rockfall.analysis.observed.observations import Observed
from rockfall.analysis.observed.run_out import RESAMPLES, Starts, cell_of, starts
from rockfall.errors import RockfallError
from rockfall.io.rasters.arrays import corner_of
from rockfall.io.rasters.grid import Grid
from rockfall.io.vectors.point_rows import is_point_layer
from rockfall.quantities import first_of
from rockfall.result.trajectories import ended_moving

if TYPE_CHECKING:
    import xarray as xr

ANYWHERE = 1.0  # weight `a`: boulders that may be anywhere in the deposit area
MAX_FITTED = 1000  # maximum boulders used to fit the kernels
MIN_FITTED = 20  # minimum boulders at rest for a density
MIN_COMPARED = 2 * MIN_FITTED  # minimum boulders for a comparison; half of them give the density
PIECE = 2_000_000  # distances computed at a time
ROUNDING = 1e-9  # rounding error of squared distances
LOW = 0.05  # quantile of the log-densities of simulated samples, below which blocks disagree
ALL = ""  # name of an unknown source


class Blocks(NamedTuple):
    """Blocks mapped at rest, all from one source or all of unknown source: places (n, 2) [m];
    volumes [m3], NaN if unknown; mapped area (shapely), None for everywhere; block shapes, 0 if
    unknown, None if no shapes are given."""

    source: str
    place: np.ndarray
    volume: np.ndarray
    area: Any = None
    shape: np.ndarray | None = None


class Rest(NamedTuple):
    """Simulated boulders at rest: places (n, 2) [m], volumes [m3], block shapes (None: all
    equal)."""

    place: np.ndarray
    volume: np.ndarray
    shape: np.ndarray | None = None

    def of(self, chosen: np.ndarray | slice) -> Rest:
        shape = None if self.shape is None else self.shape[chosen]
        return Rest(self.place[chosen], self.volume[chosen], shape)


class Kernel(NamedTuple):
    """Kernel parameters."""

    neighbours: float  # number of neighbours that sets the width
    boulders: int  # number of boulders for which `neighbours` is valid
    of_volume: float  # width in log volume; infinite if volumes are ignored
    area: float  # deposit area [m2]
    cell: float  # cell size [m]
    by_shape: bool = False  # True if block shapes count

    @property
    def floor(self) -> float:
        """Background density of a boulder anywhere in the deposit area [m-2]."""
        return ANYWHERE / self.area


class Sums(NamedTuple):
    """Sums over boulders for each block: kernels [m-2], their squares, and similarity weights."""

    near: np.ndarray
    squares: np.ndarray
    boulders: np.ndarray


def witnesses(result: xr.Dataset, seen: Observed) -> list[Blocks]:
    """Blocks at rest without a known release, by source; blocks of unknown source come last. Empty
    if all releases are known, from columns or because there is a single place. Errors as in
    `blocks_from`."""
    return blocks_from(starts(result), seen)


def blocks_from(origins: Starts, seen: Observed) -> list[Blocks]:
    """Blocks as in `witnesses`, given the release groups.

    Raises a RockfallError for a source that the run lacks, or a block outside the mapped area.
    """
    if seen.stops is None or seen.starts is not None:
        return []
    volume = np.full(len(seen.stops), np.nan) if seen.volumes is None else seen.volumes
    shape = np.zeros(len(seen.stops), int) if seen.shapes is None else seen.shapes
    sources = np.array(seen.sources or [ALL] * len(seen.stops), object)
    if len(origins.places) == 1:
        return []
    for k in np.flatnonzero(~np.isin(sources, [ALL, *origins.names]))[:1].tolist():
        raise RockfallError(
            f"{seen.where['stops'][k]}: source = {sources[k]}: not a source of the run, sources: "
            f"{_some(origins.names)}"
        )
    names = [
        *dict.fromkeys(name for name in sources if name != ALL),
        *[ALL] * bool((sources == ALL).any()),
    ]
    if seen.area is not None:
        for k in np.flatnonzero(~_within(seen.area, seen.stops))[:1].tolist():
            x, y = seen.stops[k]
            raise RockfallError(
                f"{seen.where['stops'][k]}: x = {x:.12g}, y = {y:.12g}: is outside the area "
                "in which blocks were mapped"
            )
    return [
        Blocks(name, seen.stops[own], volume[own], seen.area, shape[own] if shape.any() else None)
        for name, own in ((name, sources == name) for name in names)
    ]


def _within(area: Any, place: np.ndarray) -> np.ndarray:
    """Mask of places (n, 2) within an area or on its edge."""
    import shapely

    shapely.prepare(area)
    return shapely.intersects_xy(area, *place.T)


def _some(names: list[str]) -> str:
    return ", ".join(first_of([*dict.fromkeys(names)], 10))


def at_rest(result: xr.Dataset, blocks: Blocks, origins: Starts | None = None) -> Rest:
    """Boulders at rest within the mapped area, from the blocks' source or from all sources."""
    source = blocks.source
    done = ~ended_moving(result)
    if source != ALL:
        origins = starts(result) if origins is None else origins
        sources = [k for k, name in enumerate(origins.names) if name == source]
        done = done & np.isin(origins.group, sources)
    place = np.column_stack([result["stop_x"].values, result["stop_y"].values])
    if blocks.area is not None:
        done = done & _within(blocks.area, place)
    shape = result["block_shape"].values if "block_shape" in result else None
    return Rest(place, result["volume"].values, shape).of(done)


def fitted_kernel(blocks: Blocks, rest: Rest, cell: float) -> Kernel:
    """Kernels for blocks, fitted to the boulders of a run; their width is at least `cell` [m]."""
    both = np.concatenate([blocks.place, rest.place])
    area = float(np.prod(np.maximum(np.ptp(both, axis=0), cell)))
    spread = np.inf
    if not np.isnan(blocks.volume).all():
        spread = silverman(np.log(rest.volume))
    n = len(rest.place)
    fitted = rest.of(np.linspace(0, max(n - 1, 0), min(n, MAX_FITTED)).astype(int))
    by_shape = blocks.shape is not None and rest.shape is not None
    kernel = Kernel(1.0, len(fitted.place), spread, area, cell, by_shape)
    if n <= MIN_FITTED:
        return kernel
    kernel = kernel._replace(neighbours=_likeliest_neighbours(kernel, fitted))
    return kernel._replace(neighbours=_neighbours(kernel, n), boulders=n)


def silverman(values: np.ndarray) -> float:
    """Width of a normal kernel by Silverman's rule (1986, equation 3.31); infinite if all values
    are equal.

    >>> float(round(silverman(np.arange(1.0, 33.0)), 2))
    4.22
    """
    if values.size < 2 or not np.ptp(values) > 1e-9 * np.abs(values).max():
        return np.inf
    low, high = np.quantile(values, (0.25, 0.75))
    scale = min(width for width in (values.std(ddof=1), (high - low) / 1.34) if width > 0)
    return float(0.9 * scale * values.size**-0.2)


def _likeliest_neighbours(kernel: Kernel, rest: Rest) -> float:
    """Number of neighbours that maximises the likelihood of each boulder given the others."""
    n = len(rest.place)
    every = np.arange(n)
    trials = np.unique(np.geomspace(2, n / 2, 12).round())
    likelihood = [
        log_densities_of_own(kernel._replace(neighbours=k, boulders=n), rest, every).mean()
        for k in trials
    ]
    return float(trials[int(np.argmax(likelihood))])


def _neighbours(kernel: Kernel, n: int) -> float:
    """Number of neighbours in the kernels, scaled to another number of boulders."""
    return max(kernel.neighbours * (max(n, 1) / max(kernel.boulders, 1)) ** (2 / 3), 1.0)


def kernel_widths(kernel: Kernel, rest: Rest) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """For each boulder: kernel width [m], kernel width if one of the nearest boulders that set it
    is left out [m], and squared distance to the farthest of these [m2]."""
    from scipy.spatial import KDTree

    n = len(rest.place)
    if n < 2:
        alone = np.full(n, np.sqrt(kernel.area) / 4)
        return alone, alone, np.zeros(n)
    k = min(round(_neighbours(kernel, n)), n - 1)
    # The first neighbour is the boulder itself.
    far = KDTree(rest.place).query(rest.place, [k + 1, min(k + 2, n)])[0]
    widths = np.maximum(far / 2, kernel.cell)
    return widths[:, 0], widths[:, 1], far[:, 0] ** 2 * (1 + ROUNDING)


def kernel_sums(kernel: Kernel, blocks: Blocks | Rest, rest: Rest) -> Sums:
    """Sums over boulders at rest for each block."""
    sums, widths = np.empty((3, len(blocks.place))), kernel_widths(kernel, rest)[0]
    for piece in _pieces(len(blocks.place), len(rest.place)):
        own = Rest(blocks.place, blocks.volume, blocks.shape).of(piece)
        alike, near = kernel_values(kernel, own, rest, widths)
        sums[:, piece] = near.sum(axis=1), (near**2).sum(axis=1), alike.sum(axis=1)
    return Sums(*sums)


def log_densities_of_own(kernel: Kernel, rest: Rest, chosen: np.ndarray) -> np.ndarray:
    """Log-densities (chosen,) of selected simulated boulders, each given the others."""
    widths, without, far = kernel_widths(kernel, rest)
    densities = np.empty(chosen.size)
    for piece in _pieces(chosen.size, len(rest.place)):
        rows = chosen[piece]
        squares = _squares(rest.place[rows], rest)
        near = _normal(squares, np.where(squares <= far, without, widths))
        alike = like_weights(kernel, rest.of(rows), rest)
        alike[np.arange(rows.size), rows] = 0.0
        densities[piece] = log_density(kernel, (alike * near).sum(axis=1), alike.sum(axis=1))
    return densities


def log_densities_again(
    kernel: Kernel, blocks: Blocks, rest: Rest, times: int, random: np.random.Generator
) -> np.ndarray:
    """Sums of log-densities (times,) over random samples of a run's boulders, each given the
    others. A sample has as many boulders as there are blocks, with similar volumes and shapes."""
    if not len(rest.place):
        return np.full(times, np.log(kernel.floor) * len(blocks.place))
    chosen = _like(kernel, blocks, rest, times, random)
    which, place = np.unique(chosen, return_inverse=True)
    return log_densities_of_own(kernel, rest, which)[place].reshape(chosen.shape).sum(axis=1)


def _like(
    kernel: Kernel, blocks: Blocks, rest: Rest, times: int, random: np.random.Generator
) -> np.ndarray:
    """Indices (times, blocks) of random boulders, similar to each block in volume and shape."""
    n, uniform = len(rest.place), random.random((times, len(blocks.place)))
    if np.isinf(kernel.of_volume) and not kernel.by_shape:
        return (uniform * n).astype(int)
    below = np.cumsum(like_weights(kernel, blocks, rest), axis=1)
    rows = zip(below, uniform.T, strict=True)
    return np.array([np.searchsorted(row, u * row[-1]).clip(max=n - 1) for row, u in rows]).T


def _pieces(n: int, boulders: int) -> Iterator[slice]:
    step = max(1, PIECE // max(boulders, 1))
    return (slice(first, first + step) for first in range(0, n, step))


def _squares(place: np.ndarray, rest: Rest) -> np.ndarray:
    """Squared distances [m2] between places and boulders (places, boulders)."""
    from scipy.spatial.distance import cdist

    return cdist(place, rest.place, "sqeuclidean")


def _normal(squares: np.ndarray, widths: np.ndarray) -> np.ndarray:
    """Normal densities in plan [m-2]."""
    return np.exp(-squares / (2 * widths**2)) / (2 * np.pi * widths**2)


def like_weights(kernel: Kernel, blocks: Blocks | Rest, rest: Rest) -> np.ndarray:
    """Similarity of boulders to blocks in volume and shape, 0 to 1: (blocks, boulders)."""
    if np.isinf(kernel.of_volume):
        alike = np.ones((len(blocks.place), len(rest.place)))
    else:
        apart = (np.log(blocks.volume)[:, None] - np.log(rest.volume)) / kernel.of_volume
        alike = np.exp(-(np.nan_to_num(apart) ** 2) / 2)
    if kernel.by_shape and blocks.shape is not None and rest.shape is not None:
        shape = blocks.shape[:, None]
        alike[(shape > 0) & (rest.shape > 0) & (shape != rest.shape)] = 0.0
    return alike


def kernel_values(
    kernel: Kernel, blocks: Blocks | Rest, rest: Rest, widths: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Weights of boulders by volume and shape, and these weights multiplied by kernels of the given
    widths [m], in m-2: (blocks, boulders)."""
    alike = like_weights(kernel, blocks, rest)
    return alike, alike * _normal(_squares(blocks.place, rest), widths)


def log_density(kernel: Kernel, near: np.ndarray, boulders: np.ndarray) -> np.ndarray:
    """Logarithm of the predictive density [m-2] from sums over boulders."""
    return np.log((near + kernel.floor) / (boulders + ANYWHERE))


def outside(kernel: Kernel, near: np.ndarray) -> np.ndarray:
    """Mask of blocks outside all deposits, from their kernel sums `near` (blocks,)."""
    return near < kernel.floor


class Agreement(NamedTuple):
    """Comparison of a source's blocks at rest with a result: mean log-density at the blocks; its
    mean and 5 % quantile for samples of an equal number of simulated boulders; number of blocks
    outside all deposits."""

    source: str
    blocks: int
    boulders: int
    outside: int
    observed: float
    own: float
    own_low: float


def agreement(result: xr.Dataset, seen: Observed) -> list[Agreement]:
    """Agreement of a result with blocks at rest without a known release, by source; empty if too
    few boulders came to rest. Half of the boulders give the density. The other half are the
    reference, because like the blocks they do not contribute to it."""
    random, agreements = np.random.default_rng(0), []
    for blocks in witnesses(result, seen):
        rest = at_rest(result, blocks)
        every = np.arange(len(rest.place))
        half, other = rest.of(every % 2 == 0), rest.of(every % 2 == 1)
        if every.size < MIN_COMPARED:
            continue
        kernel = fitted_kernel(blocks, half, cell_of(result))
        observed, sums = _densities(kernel, blocks, half)
        own = _densities(kernel, other, half)[0]
        chosen = _like(kernel, blocks, other, RESAMPLES, random)
        again = own[chosen].mean(axis=1)
        beyond = int(outside(kernel, sums.near).sum())
        numbers = float(observed.mean()), float(again.mean()), float(np.quantile(again, LOW))
        agreements.append(Agreement(blocks.source, len(blocks.place), every.size, beyond, *numbers))
    return agreements


def _densities(kernel: Kernel, blocks: Blocks | Rest, rest: Rest) -> tuple[np.ndarray, Sums]:
    """Log-densities at blocks, and the kernel sums that give them."""
    sums = kernel_sums(kernel, blocks, rest)
    return log_density(kernel, sums.near, sums.boulders), sums


def grid_for(result: xr.Dataset, given: Iterable[str | Path | Observed]) -> Grid | None:
    """Grid for reading layers: the terrain cells of the result, in its CRS, from the north-western
    corner to the extent of the boulders; None if no observation is a layer."""
    if not any(is_point_layer(item) for item in given if not isinstance(item, Observed)):
        return None
    from rasterio.crs import CRS

    west, north, cell = corner_of(result["crs"].attrs)
    east = max((float(result[f"{end}_x"].max()) for end in ("start", "stop")), default=west)
    south = min((float(result[f"{end}_y"].min()) for end in ("start", "stop")), default=north)
    nx, ny = (max(int(side // cell) + 1, 1) for side in (east - west, north - south))
    wkt = result["crs"].attrs.get("crs_wkt")
    return Grid(west, north, cell, nx, ny, CRS.from_user_input(wkt) if wkt else None)
