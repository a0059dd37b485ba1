# SPDX-License-Identifier: BSD-3-Clause
"""Line statistics and return levels as text and as CSV."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rockfall.analysis.line_statistics import QUANTILES, line_statistics, quantile_name
from rockfall.analysis.return_levels import LEVELS, return_levels
from rockfall.case.files import files_behind
from rockfall.errors import RockfallError
from rockfall.io.output_files import atomic_folder, check_output
from rockfall.io.tables import write_csv
from rockfall.quantities import QUANTITIES, TOO_FEW, number
from rockfall.result.crossings import line_names
from rockfall.result.dataset import read_result
from rockfall.result.samples import simulated
from rockfall.studies.ensemble.study import is_ensemble
from rockfall.text.ensemble import ensemble_summary
from rockfall.text.table import MOST_LINES, more_lines
from rockfall.text.table import table as aligned

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

ABOUT = """\
Below each number its 95 % confidence interval; "n too small" where too few boulders pass for one
that holds, "-" for the limit that they cannot give. The std of the position along the line is the
lateral spread. The maximum grows with the number of boulders. 1 in N: the level that one in N of
the boulders that pass exceeds, from the sample where 25 or more boulders exceed it, else from a
generalised Pareto tail of the boulders above the threshold."""


ENDS = "", "_low", "_high"


def print_lines(path: str | Path, table: str | Path | None = None) -> None:
    """Print both tables of a result; with `table`, a CSV file, write line_statistics to it and
    return_levels next to it as NAME_levels.csv, in the units of the result."""
    result, places = open_lines(path, table, "", "_levels.csv")
    statistics, levels = line_statistics(result), return_levels(result)
    print("\n".join(_text(statistics, levels, simulated(result))))
    if is_ensemble(result):
        print("", ensemble_summary(result), sep="\n")
    write_tables(path, result, dict(zip(places, [statistics, levels], strict=False)))


def open_lines(
    path: str | Path, table: str | Path | None, *endings: str
) -> tuple[xr.Dataset, list[Path]]:
    """Result with lines, and the paths of its tables: `table` for the ending "", and files with the
    same name and other endings; refused before the work if they may not be written. No paths
    without `table`."""
    first = table and _csv(Path(table))
    result = read_result(path)
    if not line_names(result):
        raise RockfallError(f"{path}: has no evaluation lines")
    if not first:
        return result, []
    places = [first.with_name(first.stem + (end or first.suffix)) for end in endings]
    for place in places:
        check_output(place, [Path(path), *files_behind(result)])
    return result, places


def write_tables(path: str | Path, result: xr.Dataset, made: Mapping[Path, Any]) -> None:
    """Write tables, or objects that write themselves to a path, all or none, and print the
    paths."""
    if not made:
        return
    with atomic_folder(next(iter(made)).parent, [Path(path), *files_behind(result)]) as part:
        for place, table in made.items():
            table(part / place.name) if callable(table) else write_csv(table, part / place.name)
    print(*made, sep="\n")


def _csv(path: Path) -> Path:
    if path.suffix.lower() != ".csv":
        raise RockfallError(f"{path}: must be a file name that ends in .csv")
    return path


def _text(statistics: pd.DataFrame, levels: pd.DataFrame, boulders: int) -> Iterator[str]:
    """Both tables, line after line, of the first ones."""
    yield ABOUT
    by_line = statistics.groupby("line", sort=False)
    for line, rows in itertools.islice(by_line, MOST_LINES):
        first = rows.iloc[0]
        fraction, low, high = (number(100 * first[f"fraction{end}"], 4) for end in ENDS)
        yield ""
        yield f"{line}: {first['n']:,} of {boulders:,} boulders, {fraction} % ({low} to {high} %)"
        if first["n"]:
            yield aligned(_statistics(rows))
            tails = levels[levels["line"] == line]
            yield aligned(_levels(tails))
            yield from _bounded(tails)
            yield from _refused(tails)
    yield from more_lines(by_line.ngroups)


def _statistics(rows: pd.DataFrame) -> Iterator[list[str]]:
    names = ["mean", "std", *map(quantile_name, QUANTILES)]
    yield ["", *names]
    for _, row in rows.iterrows():
        yield from _row(row, names, TOO_FEW)


def _levels(tails: pd.DataFrame) -> Iterator[list[str]]:
    yield ["", "max", *(f"1 in {N:,}" for N in LEVELS), "threshold", "above", "shape"]
    names = [f"level_{N}" for N in LEVELS]
    for _, row in tails.iterrows():
        yield from _row(row, ["max", *names, "threshold", "exceedances", "shape"])


def _row(row: pd.Series, names: list[str], without: str = "") -> Iterator[list[str]]:
    """Numbers of a quantity, and below them their intervals, or a note if there is none."""
    display = QUANTITIES[row["quantity"]]
    numbers, limits = [f"  {display.short}"], [""]
    for name in names:
        factor = 1 if name in ("exceedances", "shape") else display.factor
        value, low, high = (factor * row.get(f"{name}{end}", np.nan) for end in ENDS)
        is_count = name == "exceedances" and np.isfinite(value)
        numbers.append(f"{value:,.0f}" if is_count else number(value, 4))
        is_known = np.isfinite([low, high]).any()
        absent = without if np.isfinite(value) else ""
        limits.append(f"{number(low, 4)}..{number(high, 4)}" if is_known else absent)
    yield numbers
    if any(limits):
        yield limits


def _bounded(tails: pd.DataFrame) -> Iterator[str]:
    """Upper end points of tails."""
    for _, row in tails[np.isfinite(tails["end"])].iterrows():
        display = QUANTITIES[row["quantity"]]
        end, high = (number(display.factor * row[limit], 4) for limit in ("end", "end_high"))
        yield f"  bounded: {display.label} ends at {end} {display.unit}, 95 % interval up to {high}"


def _refused(tails: pd.DataFrame) -> Iterator[str]:
    """Reasons for refusal, each with its quantities."""
    for reason, rows in tails[tails["refused"] != ""].groupby("refused", sort=False):
        names = ", ".join(QUANTITIES[quantity].name for quantity in rows["quantity"])
        yield f"  refused: {reason} ({'all' if len(rows) == len(tails) else names})"
