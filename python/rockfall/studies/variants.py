# SPDX-License-Identifier: BSD-3-Clause
"""Protection variants: runs, and paired differences from the first variant at lines.

Variants with the same sources, boulders and seed have common random numbers; see
`rockfall.analysis.precision.paired`.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from rockfall.analysis.precision.intervals import Sources, fraction_interval, sources
from rockfall.analysis.precision.paired import (
    Difference,
    difference,
    difference_of_fractions,
    mean_of,
    quantile_of,
)
from rockfall.analysis.validity.warnings import warn_each, with_model_warnings
from rockfall.case import Case, case_of, check_all_kept
from rockfall.case.text import literal
from rockfall.case.variants import naming_variant, variants
from rockfall.errors import RockfallError
from rockfall.language import say
from rockfall.result.crossings import line_names, line_values, outcomes_at
from rockfall.result.same_case import check_same_site
from rockfall.result.samples import check_rows, simulated
from rockfall.result.variables import OUTCOME
from rockfall.scene.read import read_scene
from rockfall.scene.rules.plausible import implausible
from rockfall.scene.scene import Scene
from rockfall.scene.stages import KeptStages
from rockfall.simulation.memory import machine_memory
from rockfall.simulation.parts.checkpoint import Checkpoint
from rockfall.studies.study import NO_CHECKPOINTS, Study

QUANTITIES = ("speed", "upper_edge", "energy_total")
COLUMNS = ["line", "variant", "quantity", "statistic", "n", "value", "difference",
           "difference_low", "difference_high", "verdict", "value_low", "value_high"]  # fmt: skip
LESS, MORE, UNDECIDED = "less", "more", "undecided"
STARTS = ("start_x", "start_y", "volume")


def run_variants(
    case: Case,
    *,
    progress: bool = False,
    threads: int | None = None,
    memory: float | None = None,
    **arrays: Any,
) -> dict[str, xr.Dataset]:
    """Run each &variant of a case. Return results by name, for `compare_variants` and
    `report_variants`.

    All variants use the seed of the case and thus common random numbers. All are read and checked
    before the first run; variants with different release points or volumes raise a RockfallError.
    `arrays` apply to all variants; other arguments are as in `rockfall.run`.

    >>> import rockfall
    >>> net = {"name": "net", "x": [600000.0, 600120.0], "y": [4999950.0, 4999950.0]}
    >>> case = rockfall.read_case("case.nml").replace(
    ...     barrier=[net | {"height": 3.0, "class": 4}],
    ...     variant=[{"name": "bare", "without": ["barrier"]}, {"name": "with net"}],
    ... )
    >>> results = rockfall.run_variants(case)
    >>> sorted(set(rockfall.compare_variants(results)["variant"]))
    ['bare', 'with net']
    """
    memory = memory or machine_memory()
    given = {"memory": memory, "stages": KeptStages(), **arrays}
    for remark in check_variant_scenes(case, **given):
        warnings.warn(remark, stacklevel=2)
    results, limits = run_each(case, progress=progress, threads=threads, **given)
    warn_each(limits)
    return {name: with_model_warnings(result) for name, result in results.items()}


def run_each(
    case: Case,
    *,
    progress: bool = False,
    threads: int | None = None,
    checkpoints: Mapping[str, Checkpoint] = NO_CHECKPOINTS,
    **given: Any,
) -> tuple[dict[str, xr.Dataset], tuple[str, ...]]:
    """Results of variants checked by `check_variant_scenes`, and model warnings; each run resumes
    from its checkpoint. For `given` see `read_scene`."""
    shared = "stages" in given  # the next variant uses the same rasters
    study = Study(progress=progress, threads=threads, checkpoints=checkpoints, keep=shared)
    scenes = ((name, read_scene(own, **given)) for name, own in variants(case).items())
    return dict(study.run(scenes, lambda _, result: result)), study.warnings


def check_variant_scenes(case: Case, **how: Any) -> list[str]:
    """Read each variant in turn and return remarks on likely mistakes. Raises a RockfallError for
    variants that cannot be compared. For `how` see `read_scene`."""
    cases = variants(case)
    if len(cases) < 2:
        raise RockfallError(
            f"{case.name}: &variant: has {len(cases)} variants: a comparison requires two or more"
        )
    check_all_kept(case, "a comparison of variants needs")
    remarks: list[str] = []
    first: tuple[str, dict[str, Any]] | None = None
    ours: tuple[float, ...] = ()
    for name, variant in cases.items():
        with naming_variant(case, name):
            scene = read_scene(variant, **how)
        starts = _starts(scene)
        first = first or (name, starts)
        if differing := [key for key, value in starts.items() if not _same(value, first[1][key])]:
            raise RockfallError(
                f"{case.name}: &variant name = {literal(name)}: its {differing[0]} differ from "
                f"those of {literal(first[0])}, the first variant"
            )
        for line in implausible(scene):
            remarks.append(f"variant {name}: {line.removeprefix(f'{case.name}: ')}")
        extent = scene.grid.west, scene.grid.south, scene.grid.east, scene.grid.north
        ours = ours or extent
        apart = max(abs(a - b) for a, b in zip(extent, ours, strict=True))
        if apart > scene.grid.cell:
            remarks.append(say("input.other_extent", name=name, apart=apart, first=first[0]))
    return remarks


def _starts(scene: Scene) -> dict[str, Any]:
    """Inputs that determine release points and volumes, by their names in messages."""
    own = None if scene.source_boulders is None else scene.source_boulders.volume
    features = scene.features
    of_case = {key: value for key, value in scene.case.boulder.items() if "volume" in key}
    of_layer = () if features is None else (features.number, features.law, features.value)
    return {
        "sources": (scene.x, scene.y),
        "boulders of each source": (scene.boulders, scene.weight),
        "volumes": (of_case, own, *of_layer[:2], _volumes(of_layer)),
    }


def _volumes(of_layer: tuple[Any, ...]) -> np.ndarray | None:
    """Mean, standard deviation and limits of the volumes in a layer."""
    return of_layer[2][:, :4] if of_layer and of_layer[2] is not None else None


def _same(first: tuple[Any, ...], other: tuple[Any, ...]) -> bool:
    """Return True if two sequences of numbers or arrays are equal in all values."""
    return len(first) == len(other) and all(map(_equal, first, other))


def _equal(first: Any, other: Any) -> bool:
    if isinstance(first, np.ndarray) and isinstance(other, np.ndarray):
        return np.array_equal(first, other, equal_nan=first.dtype.kind == "f")
    return type(first) is type(other) and bool(first == other)


def compare_variants(results: Mapping[str, xr.Dataset]) -> pd.DataFrame:
    """Table with a row for each line, variant, quantity and statistic, in SI units: the fraction of
    all boulders that pass the line, in total and above each energy in &hazard thresholds [kJ]; mean
    and 95 % quantile of speed, highest point and total energy of passing boulders; and the
    difference from the first variant, with its 95 % interval.

    Protection is selective: only fast boulders may pass a net. Means of passing boulders may thus
    increase although each boulder is slower or stopped; fractions above an energy avoid this bias.

    A boulder that a barrier stops at the line does not pass it. `verdict` is less or more; it is
    undecided if the interval contains 0, or if too few boulders pass for an interval. Lines that
    the first variant lacks have no difference. Variants with other sources, boulders or seeds raise
    a RockfallError.

    Limits for differences of fractions follow Newcombe (1998, method 10), with the correlation of
    boulders within sources; limits for means and quantiles are linearised.

    >>> import rockfall
    >>> case = rockfall.read_case("case.nml")
    >>> net = {"name": "net", "x": [600000.0, 600120.0], "y": [4999950.0, 4999950.0]}
    >>> variant = case.replace(barrier=[net | {"height": 3.0, "class": 4}])
    >>> results = {"bare": rockfall.run(case), "net": rockfall.run(variant)}
    >>> table = rockfall.compare_variants(results)
    >>> table["quantity"].iloc[0]
    'passing'
    """
    check_variants(results)
    name_of_first, first = next(iter(results.items()))
    source, thresholds = sources(first), case_of(first).hazard["thresholds"]
    rows = []
    for line in dict.fromkeys(name for result in results.values() for name in line_names(result)):
        before = at_line(first, line)
        for name, result in results.items():
            first_itself = name == name_of_first
            here = before if first_itself else at_line(result, line)
            if here is not None:
                made = _rows(here, None if first_itself else before, source, thresholds)
                rows += [{"line": line, "variant": name, **row} for row in made]
    return pd.DataFrame(rows, columns=COLUMNS)


def check_variants(results: Mapping[str, xr.Dataset]) -> None:
    """Raise a RockfallError for results with another site, other sources, boulders or kept rows, or
    another seed."""
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
            f"{other_name}: is not a variant of {name}: its {what} differs: run variants with the "
            f"same {needed}"
        )


def at_line(result: xr.Dataset, line: str) -> dict[str, np.ndarray] | None:
    """Values of the boulders at a line, by quantity; NaN if not passing. None without the line."""
    names = line_names(result)
    if line not in names:
        return None
    k = names.index(line)
    at_line = {quantity: line_values(result, quantity, k) for quantity in QUANTITIES}
    stopped = stopped_at(result, line)
    return {name: np.where(stopped, np.nan, values) for name, values in at_line.items()}


def stopped_at(result: xr.Dataset, line: str) -> np.ndarray:
    """Mask of the boulders that a barrier stops at a line."""
    if "crossing_outcome" not in result:
        return np.zeros(result.sizes["boulder"], bool)
    return outcomes_at(result, line_names(result).index(line)) == OUTCOME["stopped"]


def _rows(
    here: dict[str, np.ndarray],
    before: dict[str, np.ndarray] | None,
    source: Sources,
    thresholds: Sequence[float],
) -> Iterator[dict[str, object]]:
    """Rows of a variant at a line; `before` has the values of the first variant, if any."""
    n = int(np.count_nonzero(~np.isnan(here["speed"])))

    def row(quantity: str, statistic: str, value: float, *compared: float) -> dict[str, object]:
        attrs = {"quantity": quantity, "statistic": statistic, "n": n, "value": value}
        return attrs | (verdict_on(*compared) if compared else {})

    for threshold in dict.fromkeys((0.0, *thresholds)):
        passing = here["energy_total"] >= 1000.0 * threshold
        statistic = f"above_{threshold:.10g}" if threshold else "fraction"
        compared: Difference | tuple[()] = ()
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


def verdict_on(value: float, low: float, high: float) -> dict[str, object]:
    """Difference with limits, and verdict: less, more or undecided."""
    verdict = LESS if high < 0 else MORE if low > 0 else UNDECIDED
    return {
        "difference": value, "difference_low": low, "difference_high": high, "verdict": verdict,
    }  # fmt: skip
