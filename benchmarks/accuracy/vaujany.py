# SPDX-License-Identifier: BSD-3-Clause
"""The shipped impact sets beside what the paper prints: writes docs/validation/vaujany.md.

    python -m benchmarks.accuracy.vaujany [--slopes 48] [-o docs]

Tables 2 and 3 of Bourrier et al. (2009) by methods A and B, and what it says of its rebounds: by
`rocky-slope` with each rule of turning and each reading of Rg, and by the draws of
`rocky-slope-ensemble`, over slopes of the recipe of cases/vaujany that no calibration has seen.
"""

from __future__ import annotations

import argparse
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.machine import ROOT
from rockfall.io.files import atomic_write
from rockfall.lab.scorecard import BESIDE, Score, Target, score, targets, verdict
from rockfall.lab.sets import read_sets
from rockfall.lab.site import Site

VAUJANY = ROOT / "cases" / "vaujany"
#: Column: shipped set, rule of turning, reading of Rg.
COLUMNS = {
    "`rocky-slope`": ("rocky-slope", "past_aspect", "diameter"),
    "`'to_aspect'`": ("rocky-slope", "to_aspect", "diameter"),
    "`'lab'`": ("rocky-slope", "lab", "diameter"),
    "Rg as radius": ("rocky-slope", "past_aspect", "radius"),
    "`rocky-slope-ensemble`": ("rocky-slope-ensemble", "past_aspect", "diameter"),
}
ENSEMBLE = "`rocky-slope-ensemble`"


def measure(column: str, slopes: int) -> Score:
    name, turning, reading = COLUMNS[column]
    return score(read_sets(name), Site(VAUJANY), slopes, turning=turning, reading=reading)


def cell(one: Score, target: Target) -> str:
    """A number with its standard error, and what to think of it."""
    value, error = one.mean(target.name), one.error(target.name)
    if not np.isfinite(value):
        return "-"
    return f"{value:.3g} ± {error:.2g} {verdict(target, value, error)}"


def off(one: Score, target: Target) -> str:
    """Relative error, as in table 3 of the paper."""
    known = float(target.known)
    return f"{100 * (one.mean(target.name) - known) / known:+.0f} %"


def rows(scores: dict[str, Score], wanted: list[Target]) -> list[str]:
    names = list(scores)
    text = [f"| | paper | asked | {' | '.join(names)} | 5 to 95 % of the draws |"]
    text.append("| --- | --: | --: |" + " --: |" * (len(names) + 1))
    for target in wanted:
        cells = [cell(one, target) for one in scores.values()]
        low, high = scores[ENSEMBLE].range(target.name)
        asked = f"{target.low:.3g} to {target.high:.3g}".replace("-inf to ", "below ")
        asked = asked.replace(" to inf", " and above")
        text.append(
            f"| {target.label} | {target.known} | {asked} | {' | '.join(cells)} | "
            f"{low:.3g} to {high:.3g} |"
        )
    return text


def relative(scores: dict[str, Score], wanted: list[Target]) -> list[str]:
    text = [f"| | {' | '.join(scores)} |", "| --- |" + " --: |" * len(scores)]
    for target in (
        one for one in wanted if one.name[:2] in ("A_", "B_") and "share" not in one.name
    ):
        cells = [off(one, target) for one in scores.values()]
        text.append(f"| {target.label} | {' | '.join(cells)} |")
    return text


def beside(scores: dict[str, Score]) -> list[str]:
    text = [f"| | {' | '.join(scores)} |", "| --- |" + " --: |" * len(scores)]
    for name, label in BESIDE.items():
        cells = [f"{one.mean(name):.3g} ± {one.error(name):.2g}" for one in scores.values()]
        text.append(f"| {label} | {' | '.join(cells)} |")
    return text


HEAD = """# The paper's slope by our sets

Each number is a mean over {slopes} slopes of the recipe of
[cases/vaujany](../cases/vaujany/README.md), with 2,000 boulders on each; no calibration has seen
these slopes. ± is its standard error: of slopes, boulders and coefficients. A number within a
standard error of a bound is undecided. This page is written by `benchmarks/accuracy/vaujany.py`.

Columns: the set `rocky-slope` as it is used; with the two other rules of turning; with Rg of method
A read as a radius; the draws of the ensemble, in turns.
"""
KS = """
Table 4, Kolmogorov-Smirnov tests against the boulders observed, cannot be made again: the observed
samples were not published.
"""


def page(scores: dict[str, Score], wanted: list[Target], slopes: int) -> str:
    fitted = [one for one in wanted if not one.held_out]
    held_out = [one for one in wanted if one.held_out]
    parts = {
        "What the calibration was given (tables 1 and 2, EL1)": rows(scores, fitted),
        "Held out of the calibration": rows(scores, held_out),
        "Relative errors (table 3)": [*relative(scores, wanted), KS],
        "Without a number in the paper": beside(scores),
    }
    text = HEAD.format(slopes=slopes)
    for title, lines in parts.items():
        text += "\n".join(["", f"## {title}", "", *lines, ""])
    return text


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--slopes", type=int, default=48)
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "docs" / "validation")
    options = parser.parse_args()
    with ProcessPoolExecutor() as pool:
        found = pool.map(partial(measure, slopes=options.slopes), COLUMNS)
        scores = dict(zip(COLUMNS, found, strict=True))
    with atomic_write(options.output / "vaujany.md") as part:
        part.write_text(page(scores, targets(VAUJANY), options.slopes), encoding="utf-8")


if __name__ == "__main__":
    main()
