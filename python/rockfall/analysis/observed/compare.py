# SPDX-License-Identifier: BSD-3-Clause
"""Comparison of a result with observations: errors, tests, run-out, stopping places and impacts."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rockfall.analysis.line_statistics import SIGNED, line_numbers, sample_numbers
from rockfall.analysis.observed.contacts import REACH, contacts_table, stops_table
from rockfall.analysis.observed.deposits import (
    MIN_COMPARED,
    agreement,
    at_rest,
    grid_for,
    witnesses,
)
from rockfall.analysis.observed.observations import UNITS, Observed, read_observed
from rockfall.analysis.observed.observed_doubts import (
    check_exchanged,
    distance_notes,
    ratio_notes,
    unit_notes,
)
from rockfall.analysis.observed.run_out import (
    DIFFERS,
    UNDECIDED,
    compared,
    kolmogorov_smirnov,
    run_out,
    samples,
    weights,
)
from rockfall.analysis.precision.intervals import (
    Sources,
    fraction_interval,
    limits_of_printed,
    sources,
)
from rockfall.case import Case, case_of
from rockfall.errors import RockfallError
from rockfall.language import Text, say
from rockfall.limits import MIN_FOR_MEAN, MIN_FOR_STD
from rockfall.result.crossings import line_names, line_values
from rockfall.result.samples import check_rows, kept_note
from rockfall.result.trajectories import ended_moving
from rockfall.result.variables import ENDS
from rockfall.scene.scene import Scene

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

TABLES = ("errors", "ks", "passing", "run_out", "at_rest", "stops", "contacts")
STATISTICS = ("mean", "std", "max")
DISAGREES = "compare.disagrees"
LEVEL = 0.05  # p-value below which two samples differ significantly
#: Minimum number of boulders for a verdict.
MIN_OBSERVED = {"mean": MIN_FOR_MEAN, "std": MIN_FOR_STD}
STOPPING = "stopping_distance"
_VERDICTS = {"within_interval": "boolean", "consistent": "boolean"}  # columns and their dtypes
_BESIDE = [f"{whose}{end}" for whose in ("observed", "simulated") for end in ENDS]


@dataclass(frozen=True)
class Comparison:
    """Tables of a comparison in SI units; a table is empty without observations of its kind.

    `_low` and `_high` are 95 % limits, NaN without an interval. `within_interval` is True if the
    interval of the simulated value contains the observed value; `consistent` is True if their
    difference is within the sampling errors of both.
    """

    title: str
    errors: pd.DataFrame  # mean, std, max at the lines; printed_error: published error of a method
    ks: pd.DataFrame  # two-sample Kolmogorov-Smirnov tests; printed_p: published p
    passing: pd.DataFrame  # fraction of boulders that travel at least each distance [m]
    run_out: pd.DataFrame  # stopping distances and lateral spread, as in `run_out`
    at_rest: pd.DataFrame  # density of simulated boulders at blocks without a known release [m-2]
    stops: pd.DataFrame  # fraction of boulders that pass the cell of an observed stop
    contacts: pd.DataFrame  # reach probability at impacts, with speeds and heights
    notes: tuple[str, ...]  # notes on the tables

    def table(self) -> pd.DataFrame:
        """All tables concatenated; the column `table` has their names."""
        import pandas as pd

        parts = {name: getattr(self, name) for name in TABLES}
        parts = {name: part for name, part in parts.items() if len(part)}
        return pd.concat(parts, names=["table"]).reset_index(level="table").reset_index(drop=True)


def compare(result: xr.Dataset, *observed: str | Path | Observed) -> Comparison:
    """Compare a result with observations: files (docs/observed.md), or an `Observed`.

    Published numbers are used if they were observed, or simulated by the method (A or B) of the
    result. Raises RockfallError if nothing can be compared.

    >>> import rockfall
    >>> result = rockfall.run(rockfall.read_case("case.nml"))
    >>> found = rockfall.compare(result, "observed.csv")
    >>> found.errors["statistic"].tolist()
    ['mean', 'std', 'max']
    """
    seen = read_observed(*observed, grid=grid_for(result, observed))
    names = line_names(result)
    check_lines(seen, names, "result")
    check_rows(result, "a comparison")
    check_exchanged(seen, result)
    method = case_of(result).surface["method"]
    source = sources(result)
    distances, notes = _observed_distances(result, seen, source)
    which, difference = compared(result, seen)
    ours = result.isel(boulder=np.flatnonzero(which))  # boulders from the observed starts
    stopped = samples(result, seen)
    share = np.ones(which.sum()) if stopped is None else weights(*stopped)
    errors = _errors(result, seen, method, source, names)
    units: list[str] = [*unit_notes(seen), *ratio_notes(errors)]
    units += distance_notes(ours["plan_distance"].values, distances, seen)
    units += [difference] if difference else []
    done = Comparison(
        title=f"{result.attrs['title'] or 'rockfall'}, compared with observations",
        errors=errors,
        ks=_ks(result, seen, method, distances, names, ours["plan_distance"].values, share),
        passing=_passing(ours, seen, distances, sources(ours)),
        run_out=run_out(result, seen),
        at_rest=_at_rest(result, seen),
        stops=stops_table(result, seen),
        contacts=contacts_table(result, seen),
        notes=(*units, *notes, *_notes(result, seen, source)),
    )
    if not any(len(getattr(done, name)) for name in TABLES):
        raise RockfallError(" ".join([_nothing(seen, method), *done.notes]))
    return done


def _nothing(seen: Observed, method: str) -> str:
    """Message that no observation can be compared with a result of this method, with advice."""
    others = {*seen.summaries["method"], *seen.tests["method"]} - {"observed", method}
    if not others:
        return "nothing to compare: no row has a counterpart in the result: see docs/observed.md."
    where, other = next(iter(seen.lines.values())), min(others)
    return (
        f"{where}: nothing to compare: row of method {other}, result of method {method}: run it "
        f"with &surface method = '{other}', or give observed rows."
    )


def observed_files(case: Case) -> list[Path]:
    """Observation files in the `&observed` group of a case."""
    return [case.path(name) for name in case.observed.get("files", [])]


def site_observations(site: xr.Dataset | Scene) -> Observed | None:
    """Observations given by the case of a result or scene; None without observations. Raises a
    RockfallError for invalid files, unknown lines, and places with x and y swapped."""
    case = site.case if isinstance(site, Scene) else case_of(site)
    if not (files := observed_files(case)):
        return None
    grid = site.grid if isinstance(site, Scene) else grid_for(site, files)
    seen = read_observed(*files, grid=grid)
    check_lines(seen, [line["name"] for line in case.lines], "case")
    check_exchanged(seen, site.grid if isinstance(site, Scene) else site)
    return seen


def check_lines(seen: Observed, names: list[str], where: str) -> None:
    """Raise a RockfallError for observations at lines that the case or result lacks."""
    for line, place in seen.lines.items():
        if line not in names:
            has = ", ".join(names) or "none"
            raise RockfallError(f"{place}: line {line}: is not in the {where} (lines: {has})")


def disagreement(comparison: Comparison) -> Text:
    """Sentence with the number of compared values that differ by more than the sampling errors. If
    chance does not explain this number, it adds the value with the largest error, preferably a
    mean."""
    tested, differing = 0, []
    tables = [name for name in TABLES if name != "passing" or not len(comparison.run_out)]
    for name in tables:  # stopping distances share a sample, so their fractions are dependent
        for row in getattr(comparison, name).to_dict("records"):
            differs = _differs(row)
            tested += differs is not None
            if differs:
                differing.append(_named(name, row))
    n = len(differing)
    if n <= _by_chance(tested):
        return say("compare.agrees", n=n, tested=tested)
    *_, most = min(differing)
    return say(DISAGREES, n=n, tested=tested, most=most)


def _by_chance(tested: int) -> int:
    """95 % quantile of the number of chance rejections in independent tests at LEVEL."""
    below = 0.0
    for n in range(tested + 1):
        below += math.comb(tested, n) * LEVEL**n * (1 - LEVEL) ** (tested - n)
        if below >= 1 - LEVEL:
            return n
    return tested


def _named(table: str, row: dict[str, Any]) -> tuple[bool, float, str]:
    """Sort key (means first, then the largest error) and name of a compared value."""
    keys = ("line", "quantity", "statistic") if "line" in row else ("source", "statistic")
    words = [f"{row[key]}" for key in keys if row.get(key)]
    error = row.get("error_percent", math.nan)
    size = 0.0 if math.isnan(error) else abs(error)
    words = words if "line" in row else [table.replace("_", "-"), *words]
    words += [f"{error:+.0f} %"] if size else []
    return row.get("statistic") != "mean", -size, " ".join(words)


def _differs(row: dict[str, Any]) -> bool | None:
    """Return True if a row shows a significant difference; None if it was not tested."""
    if "p" in row:
        return None if np.isnan(row["p"]) else row["p"] < LEVEL
    if "verdict" in row:
        return row["verdict"] != UNDECIDED
    consistent, against = row.get("consistent"), row.get("against", "observed")
    is_tested = isinstance(consistent, bool | np.bool_) and against in ("observed", "sample")
    return not consistent if is_tested else None


def _errors(
    result: xr.Dataset, seen: Observed, method: str, source: Sources, names: list[str]
) -> pd.DataFrame:
    """Relative errors of mean, standard deviation and maximum (paper, table 3)."""
    import pandas as pd

    printed = seen.summaries[seen.summaries["method"].isin(("observed", method))]
    field = printed[printed["method"] == "observed"].set_index(["line", "quantity"])
    references = [*map(_with_interval, printed.to_dict("records"))]
    references += map(_summary_of, seen.samples.items())
    order = _order(names)

    @cache
    def simulated(line: str, quantity: str) -> dict[str, float]:
        return line_numbers(result, names.index(line), quantity, source)

    rows = []
    for reference in sorted(
        references, key=lambda reference: order((reference["line"], reference["quantity"]))
    ):
        for name in STATISTICS:
            place = [
                reference["line"],
                reference["quantity"],
                name,
                reference["method"],
                reference["n"],
            ]
            beside = [
                numbers.get(f"{name}{end}", np.nan)
                for numbers in (reference, simulated(reference["line"], reference["quantity"]))
                for end in ENDS
            ]
            theirs = np.nan
            if (
                reference["method"] == method
                and (reference["line"], reference["quantity"]) in field.index
            ):
                theirs = _error(
                    reference[name], field.loc[(reference["line"], reference["quantity"]), name]
                )
            error, (within, consistent) = _error(beside[3], beside[0]), _verdicts(*beside)
            consistent = None if reference["n"] < MIN_OBSERVED.get(name, 0) else consistent
            rows.append([*place, *beside, error, within, consistent, theirs])
    columns = ["line", "quantity", "statistic", "against", "n_observed", *_BESIDE, "error_percent"]
    table = pd.DataFrame(rows, columns=[*columns, *_VERDICTS, "printed_error_percent"])
    return table.astype({"n_observed": "Int64", **_VERDICTS})


def _error(value: float, reference: float) -> float:
    """Relative error in percent."""
    return 100 * (value / reference - 1) if reference else np.nan


def _with_interval(printed: dict) -> dict:
    """Row of `Observed.summaries`, with the interval of the mean if n is large enough."""
    limits = limits_of_printed(
        printed["mean"], printed["std"], printed["n"], printed["quantity"] in SIGNED
    )
    return {**printed, "mean_low": limits[0], "mean_high": limits[1]}


def _summary_of(sample: tuple[tuple[str, str], np.ndarray]) -> dict:
    (line, quantity), v = sample
    attrs = {"line": line, "quantity": quantity, "method": "sample", "n": v.size}
    return {**attrs, **sample_numbers(v, Sources.alone(v.size), quantity in SIGNED)}


def _verdicts(
    observed: float, low: float, high: float, simulated: float, from_: float, to: float
) -> tuple[bool | None, bool | None]:
    """Verdicts: whether the interval of the simulated value contains the observed value, and
    whether the interval of their difference (Zou and Donner 2008) contains 0. An observed value
    without an interval counts as exact; None if the observed value is NaN, or the simulated value
    has no interval."""
    if np.isnan(observed) or np.isnan(from_):
        return None, None
    low, high = (observed, observed) if np.isnan(low) else (low, high)
    if simulated > observed:
        half = np.hypot(simulated - from_, high - observed)
    else:
        half = np.hypot(to - simulated, observed - low)
    return bool(from_ <= observed <= to), bool(abs(simulated - observed) <= half)


def _order(names: list[str]) -> Callable[[tuple[str, str]], tuple[int, int]]:
    """Sort key of a line and quantity in a table."""
    quantities = list(UNITS)
    return lambda key: (names.index(key[0]), quantities.index(key[1]))


def _ks(
    result: xr.Dataset,
    seen: Observed,
    method: str,
    distances: np.ndarray | None,
    names: list[str],
    ours: np.ndarray,
    share: np.ndarray,
) -> pd.DataFrame:
    """Two-sample Kolmogorov-Smirnov tests, and published tests of the method (paper, table 4).
    `share` are the weights of simulated boulders in the test of distances."""
    import pandas as pd

    own = seen.tests[seen.tests["method"] == method]
    printed = {(row.line, row.quantity): row.p for row in own.itertuples()}
    rows = []
    for line, quantity in sorted({*seen.samples, *printed}, key=_order(names)):
        test = np.nan, np.nan, np.nan, np.nan
        if (line, quantity) in seen.samples:
            values = line_values(result, quantity, names.index(line))
            values = values[~np.isnan(values)]
            test = _test(seen.samples[line, quantity], values, np.ones(values.size))
        rows.append([line, quantity, *test, printed.get((line, quantity), np.nan)])
    if distances is not None:
        test = _test(distances, ours, share)
        rows.append(["", STOPPING, *test, np.nan])
    sizes = ["n_observed", "n_simulated"]
    columns = ["line", "quantity", *sizes, "ks_statistic", "p", "printed_p"]
    return pd.DataFrame(rows, columns=columns).astype(dict.fromkeys(sizes, "Int64"))


def _test(
    observed: np.ndarray, simulated: np.ndarray, share: np.ndarray
) -> tuple[int, int, float, float]:
    """Numbers of observed and simulated values, statistic and p; statistic and p are NaN without
    simulated values."""
    if not simulated.size:
        return observed.size, 0, np.nan, np.nan
    statistic, p = kolmogorov_smirnov(observed, simulated, share)
    return observed.size, simulated.size, statistic, p


def _observed_distances(
    result: xr.Dataset, seen: Observed, source: Sources
) -> tuple[np.ndarray | None, list[str]]:
    """Plan distances of observed boulders [m], as given or from stopping places with known
    releases (None if unknown), and notes."""
    if seen.stops is None:
        return seen.distances, []
    if seen.distances is not None:
        return seen.distances, [say("compare.distances_given")]
    if seen.starts is not None:
        return np.sort(np.hypot(*(seen.stops - seen.starts).T)), []
    if source.count > 1:
        return None, [say("compare.no_distances", n=source.count)]
    x, y = (seen.stops[:, k] - result[f"start_{axis}"].values[0] for k, axis in enumerate("xy"))
    return np.sort(np.hypot(x, y)), []


def _passing(
    result: xr.Dataset, seen: Observed, distances: np.ndarray | None, source: Sources
) -> pd.DataFrame:
    """Fraction of boulders that travel at least each observed distance (paper, Fig. 9)."""
    import pandas as pd

    rows = []
    ours = result["plan_distance"].values
    if distances is not None:
        one_source = Sources.alone(distances.size)
        for d in np.unique(distances):
            rows.append([d, *fraction_interval(distances >= d, one_source)])
    if seen.passing is not None:
        rows += [[*pair, np.nan, np.nan] for pair in seen.passing.to_numpy()]
    for row in rows:
        row += fraction_interval(ours >= row[0], source)
        row += [100 * (row[4] - row[1]), *_verdicts(*row[1:])]
    columns = ["distance", *_BESIDE, "difference_percent", *_VERDICTS]
    table = pd.DataFrame(sorted(rows, key=lambda row: row[0]), columns=columns)
    return table.astype(_VERDICTS)


def _at_rest(result: xr.Dataset, seen: Observed) -> pd.DataFrame:
    """Geometric mean of the simulated density at blocks at rest, and at simulated boulders."""
    import pandas as pd

    rows = [
        [rest.source or "all", rest.blocks, rest.boulders, rest.outside,
         *np.exp([rest.observed, rest.own, rest.own_low]),
         DIFFERS if rest.observed < rest.own_low else UNDECIDED]
        for rest in agreement(result, seen)
    ]  # fmt: skip
    columns = ["source", "n_observed", "n_simulated", "outside", "density", "own_density"]
    return pd.DataFrame(rows, columns=[*columns, "own_density_low", "verdict"])


def _notes(result: xr.Dataset, seen: Observed, source: Sources) -> Iterator[str]:
    yield from seen.notes
    if note := kept_note(result):
        yield note
    if "fragments" in result:
        yield say("compare.fragments")
    if not {*REACH} & set(result):
        if seen.stops is not None:
            yield say("compare.no_map_at_stops")
        if seen.contacts is not None:
            yield say("compare.no_map_at_impacts")
    for blocks in witnesses(result, seen):
        if len(at_rest(result, blocks).place) < MIN_COMPARED:
            key = "compare.few_at_rest_of_source" if blocks.source else "compare.few_at_rest"
            yield say(key, source=blocks.source, fewest=MIN_COMPARED)
    names = sorted({str(name) for table in seen.kept.values() for name in table.columns})
    if names:
        yield say("compare.columns", names=", ".join(names))
    count = ended_moving(result).sum()
    if count and any(item is not None for item in (seen.passing, seen.distances, seen.stops)):
        yield say("compare.never_at_rest", n=count)
    if len(seen.tests) and not seen.samples:
        yield say("compare.other_runs")
    if source.count > 1 and (seen.samples or seen.distances is not None):
        yield say("compare.dependent", n=source.count)
