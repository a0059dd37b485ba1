# SPDX-License-Identifier: BSD-3-Clause
"""The tables of a page: numbers at the lines, return levels, precision, provenance."""

from __future__ import annotations

import json
import shlex
from collections.abc import Iterator
from html import escape
from typing import TYPE_CHECKING

import numpy as np

from rockfall.case import FROM_ARRAY, case_of
from rockfall.html_report.markup import UNITS, limits, number, table
from rockfall.html_report.running import QUANTITIES, STATISTICS, TARGETS, needed
from rockfall.html_report.words import SPEED, half_width
from rockfall.quantities import percent

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from rockfall.html_report.words import Numbers, Rows

NAMES = {"mean": "mean", "std": "standard deviation"}
NAMES |= {f"q{share}": f"{share} % quantile" for share in (50, 90, 95, 98, 99)}


def line_tables(rows: Rows) -> Iterator[str]:
    """The shares that pass, then each line's mean, deviation, quantiles and maximum."""
    unit, passing = UNITS["fraction"], []
    for line, numbers in rows.items():
        row = numbers[SPEED]
        share = f"{percent(row['fraction'])} {limits(row, 'fraction', unit)}"
        passing.append((line, f"{row['n']:,}", share))
    head = ("line", "boulders", "fraction")
    yield table("Boulders that pass, with 95 % intervals", head, passing)
    for line, numbers in rows.items():
        if n := numbers[SPEED]["n"]:
            about = f"{line}: those that pass, with 95 % intervals"
            head = ("", *NAMES.values(), f"greatest of {n:,}")
            yield table(about, head, (_statistics(name, row) for name, row in numbers.items()))


def _statistics(name: str, row: Numbers) -> tuple[str, ...]:
    unit = UNITS[name]
    cells = (f"{number(row[n], unit)}\n{limits(row, n, unit)}" for n in NAMES)
    return f"{unit.name} [{unit.unit}]", *cells, number(row["max"], unit)


def level_table(levels: pd.DataFrame) -> str:
    """What one in so many passing boulders exceeds, beside the greatest seen."""
    names = [n for n in levels.columns if n.startswith("level_") and n.count("_") == 1]
    shown = []
    for _, row in levels[levels["n"] > 0].iterrows():
        unit = UNITS[row["quantity"]]
        cells = (f"{number(row[n], unit)}\n{limits(row, n, unit)}" for n in names)
        label = f"{row['line']}: {unit.name} [{unit.unit}]"
        over = f"{number(row['threshold'], unit)}\n({row['exceedances']:,.0f} above)"
        tail = (over, number(row["shape"])) if np.isfinite(row["shape"]) else ("–", "–")
        refused = row["refused"].replace("; ", "\n")
        shown.append((label, number(row["max"], unit), *cells, *tail, refused))
    head = ["", "greatest seen", *(f"1 in {int(n[6:]):,} exceeds" for n in names)]
    about = "Return levels from a generalised Pareto tail, with 95 % intervals"
    return table(about, [*head, "threshold", "shape", "refused"], shown, "numbers noted")


def precision_table(line: str, numbers: Numbers, boulders: int) -> str:
    """How sure the numbers at a line are, and with how many boulders they would be surer."""
    asked = [("fraction", "fraction"), *((q, name) for q in QUANTITIES for name in STATISTICS)]
    shown = []
    for quantity, name in asked:
        unit = UNITS[quantity]
        row = numbers[SPEED if quantity == "fraction" else quantity]
        half = half_width(row, name)
        label = unit.name if quantity == "fraction" else f"{unit.name}, {NAMES[name]}"
        if np.isfinite(half):
            more = (f"{needed(boulders, half, target):,}" for target in TARGETS)
            cells = (f"± {percent(half)}", *more)
        else:
            cells = ("–",) * (1 + len(TARGETS))
        shown.append((label, f"{number(row.get(name, np.nan), unit)} {unit.unit}", *cells))
    head = ("", "now", "half width", *(f"boulders for ± {100 * target:g} %" for target in TARGETS))
    return table(f"{line}: half widths of the 95 % intervals", head, shown)


def provenance(result: xr.Dataset) -> Iterator[str]:
    """What a result was made of, and how to make it again."""
    about = {key: str(value) for key, value in result.attrs.items()}
    case = case_of(result)
    per_source, asked = case.case["boulders"], int(about["boulders_asked"])
    of = "a flat source cell, more by area" if case.release["by_area"] else "each source"
    whole = "complete" if result.attrs["complete"] else f"interrupted, {asked:,} were asked for"
    wall, cpu = (float(about[f"{clock}_seconds"]) for clock in ("wall", "cpu"))
    rows = [
        ("program", about["source"]),
        ("case file", about["case_file"]),
        ("seed", about["seed"]),
        ("boulders", f"{about['boulder_first']} to {about['boulder_last']}, {whole}"),
        (f"boulders of {of}", f"{per_source:,}"),
        ("impact set", f"{about['impact_set']}, SHA-256 {about['impact_set_checksum']}"),
        *((f"SHA-256 of {key}", sha) for key, sha in json.loads(about["input_checksums"]).items()),
        ("threads", about["threads"]),
        ("time", f"{wall:.1f} s, {cpu:.1f} s of CPU"),
    ]
    yield table("What was run", ("", "value"), rows, "facts")
    if FROM_ARRAY in about["case"]:
        yield "<p>Rasters came as arrays: the script that made them must run again.</p>"
    else:
        command = (
            f"rockfall run {shlex.quote(about['case_file'])} --boulders {per_source} "
            f"--seed {about['seed']} -o again.nc"
        )
        missing = "" if result.attrs["complete"] else ", and the boulders that are missing"
        yield (
            f"<p>This gives the same numbers again, to the last bit{missing}, in the folder of the "
            "run, with files of these checksums and a case file that says what stands below:</p>\n"
            f'<pre class="command">{escape(command)}</pre>'
        )
    yield f'<h3>The case</h3>\n<pre tabindex="0">{escape(about["case"])}</pre>'
