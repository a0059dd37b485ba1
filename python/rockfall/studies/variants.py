# SPDX-License-Identifier: BSD-3-Clause
"""Variants of a protection compared with the first of them: paired differences at lines, and maps
of difference.

Variants with the same sources, boulders and seed have common random numbers: a boulder starts alike
in each and draws the same numbers at its rebounds. Differences are taken boulder by boulder, so
that chance common to both cancels. Intervals cover 95 % of the Monte Carlo error of a difference,
not that of the model.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rockfall.analysis.precision.intervals import (
    WITHHELD,
    Shape,
    Sources,
    between_ranks,
    fraction_interval,
    sources,
)
from rockfall.case import case_of
from rockfall.errors import RockfallError
from rockfall.files.export import write_map
from rockfall.io.output_files import atomic_folder
from rockfall.io.rasters.arrays import grid_of
from rockfall.io.tables import write_csv
from rockfall.kernel_rules import Z
from rockfall.limits import MIN_FOR_MEAN
from rockfall.result.crossings import line_names, line_values, outcomes_at
from rockfall.result.same_case import check_same_site
from rockfall.result.samples import check_rows, simulated
from rockfall.result.variables import OUTCOME
from rockfall.simulation.maps import boulders_per_cluster, count_limits

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

QUANTITIES = ("speed", "upper_edge", "energy_total")
LEVEL = 0.95
COLUMNS = ["line", "variant", "quantity", "statistic", "n", "value", "difference",
           "difference_low", "difference_high", "verdict", "value_low", "value_high"]  # fmt: skip
LESS, MORE, UNDECIDED = "less", "more", "undecided"
OF_A_CELL = 1e-6  # tolerance of the places of cells
STARTS = ("start_x", "start_y", "volume")
MAPS = re.compile(r"(energy|speed|jump_height|passing_height)_(mean|max|max_map|q\d+)")


class Estimate(NamedTuple):
    """A statistic of the boulders that pass a line, and what each released boulder contributes to
    its error (its influence, of mean 0; Hampel 1974). NaN, and no influence, from too few."""

    value: float
    influence: np.ndarray | None = None


def compare_variants(results: Mapping[str, xr.Dataset]) -> pd.DataFrame:
    """Rows of COLUMNS by line, variant, quantity and statistic, in SI units: the fraction of all
    boulders that pass the line, also with at least each energy of &hazard thresholds [kJ]; of
    those that pass, mean and 95 % quantile of speed, highest point and total energy; and the
    difference from the first variant, with the limits of its 95 % interval.

    Protection selects: few may pass a net, but fast ones. Numbers of those that pass may rise where
    each boulder is slower or stopped; fractions above an energy do not mislead so.

    A boulder that a barrier stops at the line does not pass it. `verdict` is less, more, or
    undecided if the interval contains 0 or too few boulders pass to have one. Lines of some
    variants only have no difference. Variants must have the same sources, boulders and seed.

    Differences of fractions have the limits of Newcombe (1998, Statistics in Medicine 17, 2635,
    method 10) with the correlation of boulders within their sources, those of means and quantiles
    are linearised.

    >>> import rockfall
    >>> case = rockfall.read_case("case.nml")
    >>> net = {"name": "net", "x": [600000.0, 600120.0], "y": [4999950.0, 4999950.0]}
    >>> variant = case.replace(barrier=[net | {"height": 3.0, "class": 4}])
    >>> results = {"bare": rockfall.run(case), "net": rockfall.run(variant)}
    >>> table = rockfall.compare_variants(results)
    >>> table["quantity"].iloc[0]
    'passing'
    """
    import pandas as pd

    check_variants(results)
    name_of_first, first = next(iter(results.items()))
    source, thresholds = sources(first), case_of(first).hazard["thresholds"]
    rows = []
    for line in dict.fromkeys(name for result in results.values() for name in line_names(result)):
        before = _at_line(first, line)
        for name, result in results.items():
            first_itself = name == name_of_first
            here = before if first_itself else _at_line(result, line)
            if here is not None:
                made = _rows(here, None if first_itself else before, source, thresholds)
                rows += [{"line": line, "variant": name, **row} for row in made]
    return pd.DataFrame(rows, columns=COLUMNS)


def check_variants(results: Mapping[str, xr.Dataset]) -> None:
    """Refuse results that are not variants of one run: another site, other boulders or seed."""
    check_same_site(results)
    (name, first), *others = results.items()
    for other_name, other in [(name, first), *others]:
        check_rows(other, other_name)
        needed = "sources, boulders and seed"
        if simulated(other) != simulated(first):
            what = "number of boulders"
        elif other.sizes["boulder"] != first.sizes["boulder"]:
            kept, of_first = (result.sizes["boulder"] for result in (other, first))
            what = f"number of kept boulders ({kept:,}, not {of_first:,})"
            needed = "&output kept"
        elif any(not np.array_equal(first[start].values, other[start].values) for start in STARTS):
            what = "sources or volumes"
        elif first.attrs["seed"] != other.attrs["seed"]:
            what = "seed"
        else:
            continue
        raise RockfallError(
            f"{other_name}: is no variant of {name}: its {what} differs; run variants with the "
            f"same {needed}"
        )


def _at_line(result: xr.Dataset, line: str) -> dict[str, np.ndarray] | None:
    """Values of each boulder at a line, NaN for those that do not pass it; None without the
    line."""
    names = line_names(result)
    if line not in names:
        return None
    k = names.index(line)
    at_line = {quantity: line_values(result, quantity, k) for quantity in QUANTITIES}
    if "crossing_outcome" in result:
        stopped = outcomes_at(result, k) == OUTCOME["stopped"]
        at_line = {name: np.where(stopped, np.nan, values) for name, values in at_line.items()}
    return at_line


def _rows(
    here: dict[str, np.ndarray],
    before: dict[str, np.ndarray] | None,
    source: Sources,
    thresholds: Sequence[float],
) -> Iterator[dict[str, object]]:
    """Rows of a variant at a line; `before`: of the first variant, None if it lacks the line or is
    this one."""
    n = int(np.count_nonzero(~np.isnan(here["speed"])))

    def row(quantity: str, statistic: str, value: float, *compared: float) -> dict[str, object]:
        attrs = {"quantity": quantity, "statistic": statistic, "n": n, "value": value}
        return attrs | (_verdict(*compared) if compared else {})

    for threshold in dict.fromkeys((0.0, *thresholds)):
        passing = here["energy_total"] >= 1000.0 * threshold
        statistic = f"above_{threshold:.10g}" if threshold else "fraction"
        compared: tuple[float, ...] = ()
        if before is not None:
            was_passing = before["energy_total"] >= 1000.0 * threshold
            compared = difference_of_fractions(passing, was_passing, source)
        value, low, high = fraction_interval(passing, source)
        limits = {"value_low": low, "value_high": high}
        yield row("passing", statistic, value, *compared) | limits
    for quantity in QUANTITIES:
        for statistic, estimate in (("mean", mean_of), ("q95", quantile_of)):
            own = estimate(here[quantity])
            compared = ()
            if before is not None:
                compared = difference(own, estimate(before[quantity]), source)
            yield row(quantity, statistic, own.value, *compared)


def _verdict(value: float, low: float, high: float) -> dict[str, object]:
    verdict = LESS if high < 0 else MORE if low > 0 else UNDECIDED
    return {
        "difference": value, "difference_low": low, "difference_high": high, "verdict": verdict,
    }  # fmt: skip


# ---- differences


def difference_of_fractions(
    passing: np.ndarray, before: np.ndarray, source: Sources
) -> tuple[float, float, float]:
    """Difference of the fractions of the boulders that pass, and the limits of its interval."""
    (p, p_low, p_high), (q, q_low, q_high) = (
        fraction_interval(fraction, source) for fraction in (passing, before)
    )
    correlation = _correlation(passing, before, source)
    low = _hypotenuse(p - p_low, q_high - q, correlation)
    high = _hypotenuse(p_high - p, q - q_low, correlation)
    return p - q, p - q - low, p - q + high


def _hypotenuse(first: float, other: float, correlation: float) -> float:
    return math.sqrt(max(0.0, first**2 - 2 * correlation * first * other + other**2))


def _correlation(passing: np.ndarray, before: np.ndarray, source: Sources) -> float:
    """Correlation of two indicators of boulders within their sources, or, if these are sampled, of
    their sums over sources."""

    def apart(indicator: np.ndarray) -> np.ndarray:
        if source.sampled:
            return np.bincount(source.number, indicator - indicator.mean())
        n = np.maximum(source.released, 1)
        return indicator - (np.bincount(source.stratum, indicator, n.size) / n)[source.stratum]

    outer, other = apart(passing.astype(float)), apart(before.astype(float))
    size = math.sqrt((outer @ outer) * (other @ other))
    return float(outer @ other / size) if size else 0.0


def difference(here: Estimate, before: Estimate, source: Sources) -> tuple[float, float, float]:
    """Difference of two estimates from the same boulders, and the limits of its interval; NaN if
    either comes from too few."""
    value = here.value - before.value
    if here.influence is None or before.influence is None:
        return value, *WITHHELD
    apart = here.influence - before.influence
    low, high = source.sums(apart - apart.mean()).limits_of_mean(Shape.of(apart), signed=True)
    return value, value + low, value + high


def mean_of(values: np.ndarray) -> Estimate:
    """Mean of the values that are not NaN."""
    has = ~np.isnan(values)
    if has.sum() < MIN_FOR_MEAN:
        return Estimate(float(np.mean(values[has])) if has.any() else math.nan)
    mean = float(values[has].mean())
    return Estimate(mean, np.where(has, values - mean, 0.0) / has.mean())


def quantile_of(values: np.ndarray, level: float = LEVEL) -> Estimate:
    """Quantile of the values that are not NaN. The density at it, which its influence needs, is
    that between the order statistics that enclose it (Woodruff 1952)."""
    has = ~np.isnan(values)
    if not has.any():
        return Estimate(math.nan)
    ordered = np.sort(values[has])
    quantile = float(np.quantile(ordered, level))
    low, high = between_ranks(ordered, level, ordered.size)
    if not np.isfinite(high - low):
        return Estimate(quantile)
    of_rank = (high - low) / (2 * Z * math.sqrt(level * (1 - level) / ordered.size))
    below = np.where(has, level - (values <= quantile), 0.0)
    return Estimate(quantile, of_rank * below / has.mean())


# ---- maps


def difference_maps(results: Mapping[str, xr.Dataset]) -> dict[str, xr.DataArray]:
    """Maps of the difference of each variant from the first, by name: of the fraction of boulders
    that pass a cell, its verdict (-1 less, 1 more, 0 undecided), and of those maps of energy, speed
    and height that both have, where boulders pass in both.

    Results do not record which boulders pass a cell, so that the fractions are taken as
    independent. The intervals are then too wide for common random numbers: the verdict of a cell
    may be undecided where a line would show a difference, never the reverse.
    """
    import xarray as xr

    check_variants(results)
    if not have_passages(results):
        raise RockfallError("maps of difference need &output maps = 'passages' in all variants")
    (_, first), *others = results.items()
    maps: dict[str, xr.DataArray] = {}
    for name, other in others:
        _check_grid(first, other, name)
        keys = [
            key
            for key, of_first in first.data_vars.items()
            if of_first.dims == ("y", "x") and MAPS.fullmatch(str(key)) and key in other
        ]
        pair = xr.align(first[["passages", *keys]], other[["passages", *keys]], join="outer")
        (p, p_low, p_high), (q, q_low, q_high) = (
            _fractions(passages["passages"].fillna(0).values, result)
            for passages, result in zip(pair, (first, other), strict=True)
        )
        low = q - p - np.hypot(q - q_low, p_high - p)
        high = q - p + np.hypot(q_high - q, p - p_low)
        verdict = np.where(high < 0, -1, np.where(low > 0, 1, 0))
        of_variant = {
            "passing": (
                (q - p).astype("f4"),
                {"units": "1", "long_name": f"fraction of boulders that pass: {name} less first"},
            ),
            "verdict": (
                verdict.astype("i1"),
                {"units": "1", "long_name": f"{name}: passes less -1, more 1, undecided 0"},
            ),
        } | {key: ((pair[1][key] - pair[0][key]).values, dict(first[key].attrs)) for key in keys}
        for key, (values, attrs) in of_variant.items():
            like = pair[0]["passages"].assign_coords(crs=first["crs"]).drop_encoding()
            maps[f"{name}_{key}"] = like.copy(data=values)
            maps[f"{name}_{key}"].attrs = attrs | {"grid_mapping": "crs"}
    return maps


def have_passages(results: Mapping[str, xr.Dataset]) -> bool:
    """Return True if all variants have the map on which maps of difference are based."""
    return all("passages" in result for result in results.values())


def on_same_cells(results: Mapping[str, xr.Dataset]) -> dict[str, xr.Dataset]:
    """The first variant, and those whose maps have its cells."""
    first = next(iter(results.values()))
    return {name: result for name, result in results.items() if _same_cells(first, result)}


def _same_cells(first: xr.Dataset, other: xr.Dataset) -> bool:
    """Return True if maps of two results are on the cells of one grid."""
    ours, theirs = (grid_of(data["passages"])[0] for data in (first, other))
    steps = np.array([theirs.west - ours.west, theirs.north - ours.north]) / ours.cell
    return theirs.cell == ours.cell and float(np.abs(steps - np.round(steps)).max()) <= OF_A_CELL


def _check_grid(first: xr.Dataset, other: xr.Dataset, name: str) -> None:
    """Refuse maps of other cells."""
    if not _same_cells(first, other):
        ours, theirs = (grid_of(data["passages"])[0] for data in (first, other))
        raise RockfallError(
            f"{name}: maps of difference need the cells of the first variant, of {ours.cell:g} m; "
            f"its terrain has others, of {theirs.cell:g} m: compare without maps"
        )


def _fractions(counts: np.ndarray, result: xr.Dataset) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Fractions of the boulders that pass cells, and the limits of their intervals."""
    boulders = simulated(result)
    starts = (result[f"start_{axis}"].values for axis in "xy")
    per_cluster = boulders_per_cluster(case_of(result), *starts)
    low, high = count_limits(counts.astype("i4"), boulders, per_cluster)
    return counts / boulders, low, high


def write_variants(
    table: pd.DataFrame,
    maps: Mapping[str, xr.DataArray],
    folder: str | Path,
    inputs: Iterable[str | Path] = (),
) -> list[Path]:
    """Write the table as differences.csv, and maps as GeoTIFF, to a folder: all of them or, with a
    RockfallError, none; `inputs` are files that must not be replaced."""
    folder = Path(folder)
    with atomic_folder(folder, inputs) as part:
        write_csv(table, part / "differences.csv")
        made = [write_map(part / f"{name}.tif", data) for name, data in maps.items()]
    return [folder / "differences.csv", *(folder / path.name for path in made)]
