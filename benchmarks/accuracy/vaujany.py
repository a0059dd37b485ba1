# SPDX-License-Identifier: BSD-3-Clause
"""The shipped impact sets beside what the paper prints: writes docs/validation/vaujany.md.

    python -m benchmarks.accuracy.vaujany [--slopes 48] [-o docs/validation]

Tables 2 and 3 of Bourrier et al. (2009) by methods A and B, and what it says of its rebounds: by
each shipped set, by `bourrier2009` turned to the aspect, and by the draws of its ensemble, over
slopes of the recipe of cases/vaujany that no calibration has seen.
"""

from __future__ import annotations

import argparse
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.machine import ROOT
from rockfall.io.files import atomic_write
from rockfall.scene.rebounds.sets import read_sets
from rockfall_lab.scorecard.score import BESIDE, Score, Target, score, targets, verdict
from rockfall_lab.scorecard.site import Site

VAUJANY = ROOT / "cases" / "vaujany"
#: Column: shipped set, rule of turning, reading of Rg, which set serves a ratio.
COLUMNS = {
    "`bourrier2009`": ("bourrier2009", "past_aspect", "radius", "nearest"),
    "turned `'to_aspect'`": ("bourrier2009", "to_aspect", "radius", "nearest"),
    "`bourrier2009-ensemble`": ("bourrier2009-ensemble", "past_aspect", "radius", "nearest"),
    "`vaujany-observed`": ("vaujany-observed", "past_aspect", "radius", "between"),
    "`laboratory-spheres`": ("laboratory-spheres", "past_aspect", "diameter", "nearest"),
}
ENSEMBLE = "`bourrier2009-ensemble`"


def measure(column: str, slopes: int) -> Score:
    name, turning, reading, ratio = COLUMNS[column]
    how = {"turning": turning, "reading": reading, "ratio": ratio}
    return score(read_sets(name), Site(VAUJANY), slopes, **how)


def cell(one: Score, target: Target) -> str:
    """A number with its standard error, and what to think of it."""
    value, error = one.mean(target.name), one.error(target.name)
    if not np.isfinite(value):
        return "-"
    return f"{value:.3g} ± {error:.2g} {verdict(target, value, error)}"


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
            f"| {target.label} | {target.printed} | {asked} | {' | '.join(cells)} | "
            f"{low:.3g} to {high:.3g} |"
        )
    return text


def beside(scores: dict[str, Score]) -> list[str]:
    text = [f"| | {' | '.join(scores)} |", "| --- |" + " --: |" * len(scores)]
    for name, label in BESIDE.items():
        cells = [f"{one.mean(name):.3g} ± {one.error(name):.2g}" for one in scores.values()]
        text.append(f"| {label} | {' | '.join(cells)} |")
    return text


HEAD = """# The paper's slope by our sets

Each number is a mean over {slopes} slopes of the recipe of
[cases/vaujany](../../cases/vaujany/README.md), with 2,000 boulders on each; no calibration has seen
these slopes. ± is its standard error: of slopes, boulders and coefficients. A number within a
standard error of a bound is undecided. This page is written by `benchmarks/accuracy/vaujany.py`.

Columns: [the shipped sets](../impact_sets.md), `bourrier2009` with another rule of turning too, and
the draws of its ensemble, in turns. `vaujany-observed` is fitted to the observed boulders and not
to these numbers. Rg of method A is read as a radius, for `laboratory-spheres` as a diameter;
`ratio` is `'between'` for `vaujany-observed`, `'nearest'` for the others.
"""
KS = """
Table 4, Kolmogorov-Smirnov tests against the boulders observed, cannot be made again: the observed
samples were not published."""


def page(scores: dict[str, Score], wanted: list[Target], slopes: int) -> str:
    parts = {
        "Beside the paper (table 2 and text)": [*rows(scores, wanted), KS],
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
