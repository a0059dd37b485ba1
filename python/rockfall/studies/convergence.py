# SPDX-License-Identifier: BSD-3-Clause
"""Convergence of results at lines with the number of boulders and the terrain, and the cost of a
given accuracy."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import count

import numpy as np
import pandas as pd
import xarray as xr

from rockfall.analysis.line_statistics import limited, line_numbers
from rockfall.analysis.precision.history import STATISTICS
from rockfall.analysis.precision.intervals import TARGETS, boulders_needed, sources
from rockfall.analysis.precision.paired import relative_changes
from rockfall.analysis.validity.warnings import warn_each
from rockfall.case import Case
from rockfall.errors import RockfallError
from rockfall.kernel_rules import Z
from rockfall.quantities import AT_LINES
from rockfall.result.crossings import line_names, line_values
from rockfall.scene.read import read_scene
from rockfall.scene.releases.sources import refuse_by_area
from rockfall.scene.scene import Scene
from rockfall.studies.study import ROWS_ONLY, Study, with_numbers

BOULDERS = (100, 1000, 2000, 5000, 10_000)  # boulders per source, as in the paper
REFERENCE, MIN_REFERENCE = 1_000_000, 20_000  # boulders over all sources
#: Statistics of a line; the first is the fraction of boulders that cross it.
NUMBERS = (("boulders", "fraction"), *((q, s) for q in AT_LINES for s in STATISTICS))
KEYS = ["line", "quantity", "statistic"]
ERRORS = (0.1, 0.01, 0.001)  # relative errors for which a cost is estimated

PIECE = 100_000  # approximate boulders in memory
#: Minimum and maximum number of blocks per size, for measured errors.
MIN_BLOCKS, MAX_BLOCKS = 32, 1000
MIN_TURNS = 10 * MIN_BLOCKS  # minimum boulders per source for errors; a tenth on each terrain
MIN_CROSSED = 20  # minimum mean number of boulders per block past the line, and above q95
PAIRS = 50  # number of blocks that give the standard error of a change
AS_GIVEN = "as given"  # name of the unchanged terrain among its variants
SIZE = 10_000  # number of boulders to which errors and times refer


@dataclass
class Convergence:
    """Measured convergence. Each table has the columns line, quantity and statistic (or fraction,
    for boulders).

    - study: boulders from each source; value; low and high, its 95 % interval (none for the
      maximum); relative change from the previous row, which has fewer boulders.
    - error: boulders over all sources; cpu_seconds; relative error (root mean square over blocks);
      number of blocks.
    - cost: slope of the log error against the log number of boulders, with its standard error;
      relative error for 10,000 boulders (one standard deviation); CPU seconds for errors of 10, 1
      and 0.1 %; boulders over all sources for half-widths of 5, 2 and 1 % of the 95 % interval, as
      in `--until` and reports.
    - numerical: terrain variant; relative change with its standard error; statistical_error for
      10,000 boulders, from cost; CPU seconds for 10,000 boulders.
    """

    name: str
    study: pd.DataFrame
    error: pd.DataFrame
    cost: pd.DataFrame
    numerical: pd.DataFrame
    sources: int
    reference: int  # boulders that are divided into blocks, to measure errors
    paired: int  # boulders on each terrain
    seconds: float  # CPU seconds per boulder
    refused: dict[str, str]  # terrain variant -> reason for refusal
    model_warnings: tuple[str, ...]  # warnings for the boulders of the study


def converge(
    case: Case,
    boulders: Sequence[int] | None = None,
    reference: int | None = None,
    *,
    progress: bool = False,
) -> Convergence:
    """Measure how results at the lines of a case converge; see `Convergence`.

    The study simulates the first boulders of the case (as Bourrier et al. 2009 do for their site):
    by default 10,000 from each source, or a million in total if that is fewer. Statistical errors
    are measured on `reference` boulders from each source (default: a million in total) in blocks,
    relative to an equal number of boulders with different seeds. Numerical errors are changes of
    the results for a tenth of the boulders, the same boulders on each terrain. Only values at the
    lines need memory: 24 bytes per line and boulder. Invalid numbers, and cases without lines,
    raise a RockfallError.

    >>> import rockfall
    >>> case = rockfall.read_case("case.nml")
    >>> found = rockfall.convergence(case, [10, 100], reference=20_000)
    >>> sorted(set(found.study["boulders"]))
    [10, 100]
    """
    if boulders is not None and min(boulders, default=0) < 2:
        raise RockfallError(f"boulders = {min(boulders, default='')}: must be at least 2")
    if not case.lines:
        raise RockfallError(f"{case.name}: requires a &line, whose statistics are compared")
    scene = read_scene(case.replace(output=ROWS_ONLY))
    refuse_by_area(scene.case, scene, "a study of convergence")
    sources = scene.x.size
    sizes = sorted(set(_sizes(sources) if boulders is None else boulders))
    fewest = max(MIN_TURNS, -(-MIN_REFERENCE // sources))
    many = max(fewest, -(-REFERENCE // sources)) if reference is None else reference
    if many < fewest:
        raise RockfallError(
            f"reference = {many}: must be at least {fewest} boulders from each source, there are "
            f"{sources:,}"
        )
    paired = -(-many // 10)
    seed = case.case["seed"]
    total = sources * (sizes[-1] + 2 * many + 4 * paired)
    with Study(total, progress=progress) as study:
        first = {case.name: with_numbers(scene, boulders=sizes[-1], boulders_total=None)}
        ((_, table),) = study.run(first.items(), lambda _, result: _study(result, sizes))
        blocks, seconds = _sample(study, scene, many, seed + 1)
        others, again = _sample(study, scene, many, seed + 1 + many)
        truth, seconds = _numbers(others[:, :, None])[..., 0], (seconds + again) / 2
        del others
        error = _errors(blocks, truth, sources, seconds, scene.case)
        del blocks
        passed = dict(zip((line["name"] for line in scene.case.lines), truth[:, 0], strict=True))
        cost = _costs(error, seconds, passed)
        numerical, refused = _terrains(study, scene, paired, cost)
    warn_each(study.warnings)
    return Convergence(
        case.name, table, error, cost, numerical, sources, sources * many, sources * paired,
        seconds, refused, study.warnings,
    )  # fmt: skip


def _sizes(sources: int) -> list[int]:
    """Numbers of boulders from BOULDERS, proportionally reduced if there are many sources."""
    most = min(BOULDERS[-1], max(2, REFERENCE // sources))
    return [max(2, size * most // BOULDERS[-1]) for size in BOULDERS]


def _study(result: xr.Dataset, sizes: Sequence[int]) -> pd.DataFrame:
    """Statistics of the first boulders from each source, with intervals."""
    number = (result["boulder"].values - 1) % sizes[-1]  # number of each boulder within its source
    rows = []
    for size in sizes:
        part = result.isel(boulder=number < size)
        source = sources(part)
        for k, line in enumerate(line_names(part)):
            for quantity in AT_LINES:
                numbers = line_numbers(part, k, quantity, source)
                for statistic in (*STATISTICS, "max"):
                    rows.append((line, quantity, statistic, size, *limited(numbers, statistic)))
            rows.append((line, *NUMBERS[0], size, *limited(numbers, "fraction")))
    table = pd.DataFrame(rows, columns=[*KEYS, "boulders", "value", "low", "high"])
    table["change"] = table.groupby(KEYS)["value"].pct_change(fill_method=None)
    return table


def _sample(study: Study, scene: Scene, boulders: int, seed: int) -> tuple[np.ndarray, float]:
    """Values of boulders (lines, quantities, boulders), NaN without a crossing, and CPU seconds per
    boulder. Boulders are simulated in pieces with successive seeds, and their sources alternate.
    Raises a RockfallError if they do not fit in memory."""
    sources = scene.x.size
    piece = max(1, PIECE // sources)
    try:
        values = np.empty((len(scene.case.lines), len(AT_LINES), boulders * sources))
    except (MemoryError, ValueError) as error:  # NumPy raises ValueError for excessive sizes
        raise RockfallError(
            f"reference: {boulders * sources} boulders do not fit in memory"
        ) from error

    def pieces() -> Iterator[tuple[int, Scene]]:
        for k, done in enumerate(range(0, boulders, piece)):
            own = {"boulders": min(piece, boulders - done), "boulders_total": None}
            yield done, with_numbers(scene, seed=seed + k, **own)

    def keep(done: int, result: xr.Dataset) -> float:
        place = slice(done * sources, done * sources + result.sizes["boulder"])
        for k, of_line in enumerate(values):
            for quantity, row in zip(AT_LINES, of_line, strict=True):
                row[place] = line_values(result, quantity, k).reshape(sources, -1).T.ravel()
        return result.attrs["cpu_seconds"]

    seconds = sum(spent for _, spent in study.run(pieces(), keep, compared=False))
    return values, seconds / values.shape[2]


def _numbers(values: np.ndarray) -> np.ndarray:
    """Statistics (lines, numbers, blocks) of boulders in blocks; all but fractions are NaN if none
    crossed."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Mean of empty|Degrees of freedom|All-NaN")
        fraction = np.isfinite(values[:, :1]).mean(axis=3)
        three = np.stack(
            [
                np.nanmean(values, axis=3),
                np.nanstd(values, axis=3, ddof=1),
                np.nanquantile(values, 0.95, axis=3),
            ],
            axis=2,
        )
    return np.concatenate([fraction, three.reshape(len(values), -1, values.shape[2])], axis=1)


def _in_blocks(values: np.ndarray, size: int, limit: int) -> np.ndarray:
    """Values split into at most `limit` blocks of `size` boulders (last dimension)."""
    blocks = min(limit, values.shape[2] // size)
    return values[:, :, : blocks * size].reshape(*values.shape[:2], blocks, size)


def _errors(
    values: np.ndarray, truth: np.ndarray, sources: int, seconds: float, case: Case
) -> pd.DataFrame:
    """Table of the root-mean-square relative errors of blocks of 100, 200, 500, ... boulders,
    compared with `truth` (lines, numbers). Values from too few crossing boulders are omitted."""
    rows = []
    steps = (digit * 10**power for power in count(2) for digit in (1, 2, 5))
    for step in steps:
        size = -(-step // sources) * sources  # equal numbers from all sources
        if size * MIN_BLOCKS > values.shape[2]:
            break
        errors = _numbers(_in_blocks(values, size, MAX_BLOCKS))
        for line, numbers, right in zip(case.lines, errors, truth, strict=True):
            for number, each, exact in zip(NUMBERS, numbers, right, strict=True):
                tail = 0.05 if number[1] == "q95" else 1.0
                if size * right[0] * tail < MIN_CROSSED:
                    continue
                each = each[np.isfinite(each)]
                error = np.sqrt(np.mean((each / exact - 1) ** 2))
                rows.append((line["name"], *number, size, size * seconds, error, each.size))
    columns = [*KEYS, "boulders", "cpu_seconds", "error", "blocks"]
    return pd.DataFrame(rows, columns=columns).drop_duplicates([*KEYS, "boulders"])


def _costs(error: pd.DataFrame, seconds: float, passed: Mapping[str, float]) -> pd.DataFrame:
    """Slopes of the errors, and CPU time and boulders for a given error, from error = c / sqrt(n);
    `passed` is the fraction that crosses each line."""
    rows = []
    groups = dict(list(error[error["error"] > 0].groupby(KEYS)))
    keys = ((line, *number) for line in error["line"].unique() for number in NUMBERS)
    for key, group in ((key, groups[key]) for key in keys if key in groups):
        log_n, log_error = np.log(group["boulders"].values), np.log(group["error"].values)
        precision = np.linalg.inv(_covariance(group["boulders"].values, group["blocks"].values))
        c = np.exp((precision @ (log_error + log_n / 2)).sum() / precision.sum())
        slope = slope_error = np.nan
        if len(group) > 1:  # generalised least squares
            line = np.stack([log_n, np.ones_like(log_n)], axis=1)
            spread = np.linalg.inv(line.T @ precision @ line)
            slope, slope_error = (spread @ line.T @ precision @ log_error)[0], spread[0, 0] ** 0.5
        costs = (seconds * (c / error) ** 2 for error in ERRORS)
        crossed = np.inf if key[2] == "fraction" else SIZE * passed[key[0]]
        at = c / np.sqrt(SIZE)
        needs = (boulders_needed(SIZE, Z * at, target, crossed) for target in TARGETS)
        rows.append((*key, slope, slope_error, at, *costs, *needs))
    named = [f"cpu_seconds_{100 * error:g}_percent" for error in ERRORS]
    named += [f"boulders_{100 * target:g}_percent" for target in TARGETS]
    return pd.DataFrame(rows, columns=[*KEYS, "slope", "slope_error", "error_10000", *named])


def _covariance(size: np.ndarray, blocks: np.ndarray) -> np.ndarray:
    """Covariance of the logarithms of root-mean-square errors over blocks with normal errors:
    the variance is 1 / (2 blocks), and for blocks of two sizes it is multiplied by the fraction of
    boulders that they share."""
    boulders = size * blocks
    shared = np.minimum.outer(boulders, boulders) / np.maximum.outer(size, size)
    return shared / (2 * np.multiply.outer(blocks, blocks))


def _terrains(
    study: Study, scene: Scene, boulders: int, cost: pd.DataFrame
) -> tuple[pd.DataFrame, dict[str, str]]:
    """Change of each statistic on each terrain variant, and the refused variants."""
    name, other = other_digits(scene)
    others = {name: other} | {f"cells x{k}": larger_cells(scene, k) for k in (2, 4)}
    seed = scene.case.case["seed"]
    values, seconds = _sample(study, scene, boulders, seed)
    size = values.shape[2] // (PAIRS * scene.x.size) * scene.x.size or scene.x.size
    each = _numbers(_in_blocks(values, size, PAIRS))
    overall = _numbers(values[:, :, None])[..., 0]
    sampled = cost.set_index(KEYS)["error_10000"]
    rows, refused = [], {}

    def add(variant: str, change: np.ndarray, error: np.ndarray, seconds: float) -> None:
        for k, line in enumerate(scene.case.lines):
            for number, value, its_error in zip(NUMBERS, change[k], error[k], strict=True):
                key = (line["name"], *number)
                statistical = sampled.get(key, np.nan)
                rows.append((*key, variant, value, its_error, statistical, SIZE * seconds))

    add(AS_GIVEN, 0 * overall, 0 * overall, seconds)
    for variant, terrain in others.items():
        try:
            values, seconds = _sample(study, terrain, boulders, seed)
        except RockfallError as error:  # larger cells may not reach a source at the edge
            refused[variant] = str(error)
            continue
        blocks = _numbers(_in_blocks(values, size, PAIRS))
        whole = _numbers(values[:, :, None])[..., 0]
        add(variant, *relative_changes(whole, overall, blocks, each), seconds)
    columns = [*KEYS, "variant", "change", "change_error", "statistical_error", "cpu_seconds"]
    return pd.DataFrame(rows, columns=columns), refused


# ---- Terrain variants


def other_digits(scene: Scene) -> tuple[str, Scene]:
    """Scene with elevations in the other floating-point precision, and the name of this precision.

    float64 elevations are rounded; float32 elevations get random digits below their resolution, up
    to half of the last binary digit.
    """
    z = scene.rasters.z
    if z.dtype == np.float64:
        return "float32", scene.replace(z=z.astype("f4"))
    lost = np.random.default_rng(0).uniform(-0.5, 0.5, z.shape) * np.spacing(z)
    return "float64", scene.replace(z=z.astype("f8") + lost)


def larger_cells(scene: Scene, factor: int) -> Scene:
    """Scene with cells whose side is `factor` times as long, from the north-western corner.

    Each larger cell gets the mean of the known elevations, the most frequent zone (the first in
    the table if tied), and the median of raster sizes.
    """
    cells = scene.rasters
    z = _merged(cells.z, factor, np.nan)
    ny, nx, _ = z.shape
    grid = replace(scene.grid, cell=factor * scene.grid.cell, nx=nx, ny=ny)
    with warnings.catch_warnings():
        # for larger cells in which all cells are nodata
        warnings.filterwarnings("ignore", "Mean of empty slice|All-NaN slice")
        z = np.nanmean(z, axis=2, dtype="f8").astype(cells.z.dtype)
        values = cells.values
        if values is not None:
            values = np.stack(
                [np.nanmedian(_merged(layer, factor, np.nan), axis=2) for layer in values]
            )
    zone = None if cells.zone is None else _most_frequent(_merged(cells.zone, factor, 0))
    return scene.replace(z=z, grid=grid, zone=zone, values=values)


def _merged(raster: np.ndarray, factor: int, fill: float) -> np.ndarray:
    """Cells that each larger cell contains, (ny, nx, cells)."""
    beyond = [(0, -size % factor) for size in raster.shape]
    padded = np.pad(raster, beyond, constant_values=fill)
    ny, nx = (size // factor for size in padded.shape)
    cells = padded.reshape(ny, factor, nx, factor).swapaxes(1, 2)
    return cells.reshape(ny, nx, factor**2)


def _most_frequent(zone: np.ndarray) -> np.ndarray:
    """Most frequent zone (0 if none): (ny, nx) from (ny, nx, cells)."""
    best, highest = np.zeros(zone.shape[:2], zone.dtype), np.zeros(zone.shape[:2], int)
    for number in np.unique(zone[zone > 0]):
        count = np.count_nonzero(zone == number, axis=2)
        best[count > highest] = number
        highest = np.maximum(highest, count)
    return best
