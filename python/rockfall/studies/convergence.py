# SPDX-License-Identifier: BSD-3-Clause
"""Convergence of the numbers at the lines with the number of boulders and with the terrain model,
and the cost of accuracy."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import count
from typing import TYPE_CHECKING

import numpy as np

from rockfall.analysis.line_statistics import line_numbers, with_limits
from rockfall.analysis.precision.intervals import TARGETS, boulders_needed, sources
from rockfall.analysis.validity.remarks import model_warnings
from rockfall.analysis.validity.warnings import warn_each
from rockfall.case import Case
from rockfall.errors import RockfallError
from rockfall.kernel_rules import Z
from rockfall.result.crossings import line_names, line_values
from rockfall.scene.read import read_scene
from rockfall.scene.releases.sources import refuse_by_area
from rockfall.scene.scene import Scene
from rockfall.simulation.progress import progress_bar
from rockfall.simulation.simulate import run_scene
from rockfall.studies.terrain_variants import larger_cells, other_digits

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    Advance = Callable[..., None]

BOULDERS = (100, 1000, 2000, 5000, 10_000)  # per source, as in the paper
REFERENCE, MIN_REFERENCE = 1_000_000, 20_000  # boulders over all sources; one has all of them
QUANTITIES = ("speed", "passing_height", "energy_total")
STATISTICS = ("mean", "std", "q95")
#: Numbers of a line, first the fraction of the boulders that cross it.
NUMBERS = (("boulders", "fraction"), *((q, s) for q in QUANTITIES for s in STATISTICS))
KEYS = ["line", "quantity", "statistic"]
ERRORS = (0.1, 0.01, 0.001)  # for which cost is estimated

PIECE = 100_000  # boulders in memory at a time, about
MIN_BLOCKS, MAX_BLOCKS = 32, 1000  # blocks per size, for the measurement of errors
MIN_TURNS = 10 * MIN_BLOCKS  # turns of the sources, each with a boulder; the terrains get a tenth
MIN_CROSSED = 20  # mean number of boulders of a block past the line; for q95 above it, too
PAIRS = 50  # blocks whose changes give the standard error of a change
AS_GIVEN = "as given"  # the terrain of the case, among its variants
SIZE = 10_000  # reference number of boulders for errors and seconds


@dataclass
class Convergence:
    """Measured convergence; each table has columns line, quantity, statistic (fraction of
    boulders).

    - study: boulders from each source; value; low, high of its 95 % interval (the maximum has
      none); change from the row before, with fewer boulders.
    - error: boulders over all sources, their cpu_seconds, relative error (root mean square over so
      many blocks).
    - cost: slope of log error over log boulders and its standard error; relative error of 10,000
      boulders (one standard deviation); CPU seconds for 10, 1 and 0.1 %; boulders over all sources
      for half a 95 % interval of 5, 2 and 1 %, the numbers that `--until` and reports promise too.
    - numerical: variant of the terrain; relative change and its standard error; statistical_error
      of 10,000 boulders, from cost; CPU seconds of 10,000 boulders.
    """

    name: str
    study: pd.DataFrame
    error: pd.DataFrame
    cost: pd.DataFrame
    numerical: pd.DataFrame
    sources: int
    reference: int  # boulders; as many in blocks
    paired: int  # boulders on each terrain
    seconds: float  # of CPU per boulder
    refused: dict[str, str]  # variant of the terrain -> reason for refusal
    model_warnings: tuple[str, ...]  # of the boulders of the study


def converge(
    case: Case,
    boulders: Sequence[int] | None = None,
    reference: int | None = None,
    *,
    progress: bool = False,
) -> Convergence:
    """Measure the convergence of the numbers at the lines of a case, as in `Convergence`.

    The study simulates the first boulders of the case itself (as Bourrier et al. 2009 do for
    their site; by default as many from each source, or as a million in all allow). Statistical
    errors are those of blocks out of `reference` boulders from each source (a million in all, where
    it is not given), against as many others; each has seeds of its own.
    Numerical errors are changes of the numbers of a tenth as many boulders, the same ones on each
    terrain. What boulders did at the lines is kept in memory, 24 bytes a line and boulder, and
    nothing else.

    >>> import rockfall
    >>> case = rockfall.read_case("case.nml")
    >>> found = rockfall.convergence(case, [10, 100], reference=20_000)
    >>> sorted(set(found.study["boulders"]))
    [10, 100]
    """
    if boulders is not None and min(boulders, default=0) < 2:
        raise RockfallError(f"boulders = {min(boulders, default='')}: must be at least 2")
    if not case.lines:
        raise RockfallError(f"{case.name}: has no &line; it is their numbers that converge")
    nothing = {"maps": None, "rebounds": False, "trajectories": 0, "kept": "all"}
    scene = read_scene(case.replace(output=nothing))
    refuse_by_area(scene.case, scene, "a study of convergence")
    sources = scene.x.size
    sizes = sorted(set(_sizes(sources) if boulders is None else boulders))
    fewest = max(MIN_TURNS, -(-MIN_REFERENCE // sources))
    many = max(fewest, -(-REFERENCE // sources)) if reference is None else reference
    if many < fewest:
        raise RockfallError(
            f"reference = {many}: must be at least {fewest} boulders from each source; there are "
            f"{sources:,}"
        )
    paired = -(-many // 10)
    seed = case.case["seed"]
    with progress_bar(sources * (sizes[-1] + 2 * many + 4 * paired), shown=progress) as advance:
        result = _run(scene, sizes[-1], scene.case.case["seed"], advance)
        study, limits = _study(result, sizes), tuple(model_warnings(result, scene.case))
        del result
        blocks, seconds = _sample(scene, many, seed + 1, advance)
        others, again = _sample(scene, many, seed + 1 + many, advance)
        truth, seconds = _numbers(others[:, :, None])[..., 0], (seconds + again) / 2
        del others
        error = _errors(blocks, truth, sources, seconds, scene.case)
        del blocks
        passed = dict(zip((line["name"] for line in scene.case.lines), truth[:, 0], strict=True))
        cost = _costs(error, seconds, passed)
        numerical, refused = _terrains(scene, paired, cost, advance)
    warn_each(limits)
    return Convergence(
        case.name,
        study,
        error,
        cost,
        numerical,
        sources,
        sources * many,
        sources * paired,
        seconds,
        refused,
        limits,
    )


def _sizes(sources: int) -> list[int]:
    """BOULDERS, or fewer in the same proportions where there are many sources."""
    most = min(BOULDERS[-1], max(2, REFERENCE // sources))
    return [max(2, size * most // BOULDERS[-1]) for size in BOULDERS]


def _run(scene: Scene, boulders: int, seed: int, advance: Advance) -> xr.Dataset:
    numbers = {"boulders": boulders, "boulders_total": None, "seed": seed}
    case = scene.case.replace(case=numbers)
    result = run_scene(replace(scene, case=case))
    advance(result.sizes["boulder"])
    return result


def _study(result: xr.Dataset, sizes: Sequence[int]) -> pd.DataFrame:
    """Numbers from the first boulders of each source, with their intervals."""
    import pandas as pd

    number = (result["boulder"].values - 1) % sizes[-1]  # of a boulder at its source
    rows = []
    for size in sizes:
        part = result.isel(boulder=number < size)
        source = sources(part)
        for k, line in enumerate(line_names(part)):
            for quantity in QUANTITIES:
                numbers = line_numbers(part, k, quantity, source)
                for statistic in (*STATISTICS, "max"):
                    rows.append((line, quantity, statistic, size, *_limits(numbers, statistic)))
            rows.append((line, *NUMBERS[0], size, *_limits(numbers, "fraction")))
    table = pd.DataFrame(rows, columns=[*KEYS, "boulders", "value", "low", "high"])
    table["change"] = table.groupby(KEYS)["value"].pct_change(fill_method=None)
    return table


def _limits(numbers: dict[str, float], statistic: str) -> list[float]:
    return [numbers.get(name, np.nan) for name in with_limits(statistic)]


def _sample(scene: Scene, boulders: int, seed: int, advance: Advance) -> tuple[np.ndarray, float]:
    """Values of boulders: (lines, quantities, boulders), NaN where they did not cross; CPU seconds
    per boulder. They are simulated in pieces, each with the next seed; the sources take turns."""
    sources = scene.x.size
    piece = max(1, PIECE // sources)
    try:
        values = np.empty((len(scene.case.lines), len(QUANTITIES), boulders * sources))
    except (MemoryError, ValueError) as error:  # NumPy raises the latter for excessive sizes
        raise RockfallError(
            f"reference: {boulders * sources} boulders do not fit in memory"
        ) from error
    seconds, done = 0.0, 0
    while done < boulders:
        result = _run(scene, min(piece, boulders - done), seed, advance)
        n, first = result.sizes["boulder"], done * sources
        for k, of_line in enumerate(values):
            for quantity, row in zip(QUANTITIES, of_line, strict=True):
                crossed = line_values(result, quantity, k)
                row[first : first + n] = crossed.reshape(sources, -1).T.ravel()
        seconds += result.attrs["cpu_seconds"]
        done, seed = done + n // sources, seed + 1
    return values, seconds / values.shape[2]


def _numbers(values: np.ndarray) -> np.ndarray:
    """(lines, numbers, blocks) of (lines, quantities, blocks, boulders); NaN where none crossed."""
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
    """Boulders (last dimension) in blocks of `size`, at most `limit` blocks."""
    blocks = min(limit, values.shape[2] // size)
    return values[:, :, : blocks * size].reshape(*values.shape[:2], blocks, size)


def _errors(
    values: np.ndarray, truth: np.ndarray, sources: int, seconds: float, case: Case
) -> pd.DataFrame:
    """Errors of blocks of 100, 200, 500, ... boulders; `truth` is (lines, numbers)."""
    import pandas as pd

    rows = []
    steps = (digit * 10**power for power in count(2) for digit in (1, 2, 5))
    for step in steps:
        size = -(-step // sources) * sources  # all sources give the same number
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
    """Slopes, and the CPU time and number of boulders for an error, by error = c / sqrt(n);
    `passed` is the fraction that crosses each line."""
    import pandas as pd

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
    """Covariance of the logarithms of root-mean-square errors over blocks of normal errors:
    variance 1 / (2 blocks), and the same for two sizes in proportion to the boulders their blocks
    have in common."""
    boulders = size * blocks
    shared = np.minimum.outer(boulders, boulders) / np.maximum.outer(size, size)
    return shared / (2 * np.multiply.outer(blocks, blocks))


def _terrains(
    scene: Scene, boulders: int, cost: pd.DataFrame, advance: Advance
) -> tuple[pd.DataFrame, dict[str, str]]:
    """Change of each number by each variant of the terrain, and variants that are refused."""
    import pandas as pd

    name, other = other_digits(scene)
    others = {name: other} | {f"cells x{k}": larger_cells(scene, k) for k in (2, 4)}
    seed = scene.case.case["seed"]
    values, seconds = _sample(scene, boulders, seed, advance)
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
            values, seconds = _sample(terrain, boulders, seed, advance)
        except RockfallError as error:  # a source at the edge, outside the outermost larger cells
            refused[variant] = str(error)
            continue
        change, error = _changes(values, overall, each, size)
        add(variant, change, error, seconds)
    columns = [*KEYS, "variant", "change", "change_error", "statistical_error", "cpu_seconds"]
    return pd.DataFrame(rows, columns=columns), refused


def _changes(
    values: np.ndarray, overall: np.ndarray, each: np.ndarray, size: int
) -> tuple[np.ndarray, np.ndarray]:
    """Relative changes of the numbers, and their standard errors, relative to (lines, numbers)
    `overall` and their blocks `each`, from the values of the same boulders on another terrain."""
    overall = np.where(overall == 0, np.nan, overall)  # a change from zero has no percentage
    with np.errstate(invalid="ignore"), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Degrees of freedom")  # no boulder crossed
        change = _numbers(values[:, :, None])[..., 0] / overall - 1
        apart = (_numbers(_in_blocks(values, size, PAIRS)) - each) / overall[..., None]
        return change, np.nanstd(apart, axis=2, ddof=1) / np.sqrt(np.isfinite(apart).sum(axis=2))
