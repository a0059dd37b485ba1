# SPDX-License-Identifier: BSD-3-Clause
"""Boulders that pass lines by source, by class of volume, and along a line, as text and as
files."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rockfall.analysis.line_statistics import line_statistics
from rockfall.analysis.lines.profile import line_profile
from rockfall.plots.along_figures import line_profile_figure
from rockfall.plots.style import save
from rockfall.quantities import DESIGN, QUANTITIES, number, with_unit
from rockfall.result.samples import kept_note
from rockfall.text.line_tables import ENDS, open_lines, write_tables
from rockfall.text.table import table as aligned

if TYPE_CHECKING:
    import pandas as pd

ABOUT = "In brackets 95 % confidence intervals; fractions are of the boulders of the group."
ALONG = """\
In brackets 95 % confidence intervals. Fractions are of all boulders; each counts where it first
crosses the line."""
NUMBERS = (
    ("speed", "mean"), ("energy_total", "mean"), ("energy_total", "q95"),
    ("passing_height", "q95"), ("upper_edge", "q95"), ("normal_height", "q95"),
)  # fmt: skip


def print_groups(
    path: str | Path,
    by: str,
    classes: Sequence[float] | None = None,
    table: str | Path | None = None,
) -> None:
    """Print the boulders that pass the lines of a result by source, class of volume or block
    shape; with `table`, a CSV file, write line_statistics of these groups to it."""
    result, places = open_lines(path, table, "")
    statistics = line_statistics(result, by, classes)
    print("\n".join(_groups(statistics, by)))
    write_tables(path, result, dict(zip(places, [statistics], strict=False)))


def print_profile(
    path: str | Path, line: str, width: float | None = None, table: str | Path | None = None
) -> None:
    """Print the boulders that pass each window of a line of a result; with `table`, a CSV file,
    write them to it, and a figure next to it as NAME.png."""
    result, places = open_lines(path, table, "", ".png")
    profile = line_profile(result, line, width)
    head = [ALONG, *filter(None, [kept_note(result)])]
    print("\n".join([*head, "", line, aligned(_along(profile))]))
    made = [profile, lambda part: save(line_profile_figure(profile), part)]
    write_tables(path, result, dict(zip(places, made, strict=False)))


def _groups(statistics: pd.DataFrame, by: str) -> Iterator[str]:
    """A table for each line, a row for each group."""
    yield ABOUT
    for line, rows in statistics.groupby("line", sort=False):
        cells = [[f"  {by}", "boulders", "pass", "fraction [%]", *_titles(NUMBERS)]]
        for group, of_group in rows.groupby(by, sort=False):
            row = {f"{record['quantity']}": record for record in of_group.to_dict("records")}
            speed = row["speed"]
            shown = (_shown(row[name], number, QUANTITIES[name].factor) for name, number in NUMBERS)
            cells.append([f"  {group}", f"{speed['boulders']:,}", f"{speed['n']:,}",
                          _shown(speed, "fraction", 100.0), *shown])  # fmt: skip
        yield from ("", str(line), aligned(cells))


def _along(profile: pd.DataFrame) -> Iterator[list[str]]:
    numbers = (("energy_total", "mean"), ("energy_total", "q95"), ("passing_height", "q95"))
    yield ["  from [m]", "to [m]", "pass", "passing a metre [%]", *_titles(numbers)]
    for row in profile.to_dict("records"):
        shown = (
            _shown(row, f"{name}_{number}", QUANTITIES[name].factor) for name, number in numbers
        )
        ends = f"  {number(row['start'], 4)}", number(row["end"], 4)
        yield [*ends, f"{row['n']:,}", _shown(row, "per_metre", 100.0), *shown]


def _titles(numbers: Iterable[tuple[str, str]]) -> list[str]:
    return [
        with_unit(f"{DESIGN[name].name}, {number}", DESIGN[name].unit) for name, number in numbers
    ]


def _shown(row: Mapping[Any, Any], name: str, factor: float) -> str:
    """Number with its interval, if it has one."""
    value, low, high = (factor * row[f"{name}{end}"] for end in ENDS)
    is_known = np.isfinite([low, high]).any()
    return number(value) + (f" ({number(low)} to {number(high)})" if is_known else "")
