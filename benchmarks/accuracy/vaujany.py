# SPDX-License-Identifier: BSD-3-Clause
"""Shipped impact sets compared with the values in the paper.

    python -m benchmarks.accuracy.vaujany [--slopes 48] [-o docs]

Tables 2 and 3 of Bourrier et al. (2009) by methods A and B, and the paper's statements on rebounds,
over slopes generated as in cases/vaujany that no calibration has used. Writes the sets of `MAIN` to
archive/vaujany_paper.md, the other columns to archive/vaujany_sets.md.
"""

from __future__ import annotations

import argparse
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.machine import ROOT
from rockfall.io.atomic import atomic_write
from rockfall.scene.rebounds.sets import read_sets
from rockfall_lab.scorecard.score import BESIDE, Score, Target, score, targets, verdict
from rockfall_lab.scorecard.site import Site

VAUJANY = ROOT / "cases" / "vaujany"
#: Column: shipped set, turning rule, reading of Rg, choice of the set for a ratio.
COLUMNS = {
    "`bourrier2009`": ("bourrier2009", "past_aspect", "radius", "nearest"),
    "turned `'to_aspect'`": ("bourrier2009", "to_aspect", "radius", "nearest"),
    "`bourrier2009-ensemble`": ("bourrier2009-ensemble", "past_aspect", "radius", "nearest"),
    "`vaujany-observed`": ("vaujany-observed", "past_aspect", "radius", "between"),
    "`laboratory-spheres`": ("laboratory-spheres", "past_aspect", "diameter", "nearest"),
}
MAIN = "`vaujany-observed`", "`bourrier2009`"
ENSEMBLE = "`bourrier2009-ensemble`"


def measure(column: str, slopes: int) -> Score:
    name, turning, reading, ratio = COLUMNS[column]
    how = {"turning": turning, "reading": reading, "ratio": ratio}
    return score(read_sets(name), Site(VAUJANY), slopes, **how)


def cell(one: Score, target: Target) -> str:
    """Value with its standard error, and the verdict unless the target is met."""
    value, error = one.mean(target.name), one.error(target.name)
    if not np.isfinite(value):
        return "-"
    outcome = {"met": "", "NOT": " not met"}.get(word := verdict(target, value, error), f" {word}")
    return f"{value:.3g} ± {error:.2g}{outcome}"


def rows(scores: dict[str, Score], wanted: list[Target], ensemble: Score | None) -> list[str]:
    """Table of the statistics with a target, with the range over the draws of an ensemble."""
    heads = [*scores, "5 to 95 % of the draws"] if ensemble else list(scores)
    text = [f"| | paper | requested | {' | '.join(heads)} |"]
    text.append("| --- | --: | --: |" + " --: |" * len(heads))
    for target in wanted:
        cells = [cell(one, target) for one in scores.values()]
        if ensemble:
            low, high = ensemble.range(target.name)
            cells.append(f"{low:.3g} to {high:.3g}")
        bounds = f"{target.low:.3g} to {target.high:.3g}".replace("-inf to ", "below ")
        bounds = bounds.replace(" to inf", " and above")
        text.append(f"| {target.label} | {target.printed} | {bounds} | {' | '.join(cells)} |")
    return text


def beside(scores: dict[str, Score]) -> list[str]:
    """Statistics without a target, except the neutral slopes, which planes.md lists."""
    text = [f"| | {' | '.join(scores)} |", "| --- |" + " --: |" * len(scores)]
    for name, label in BESIDE.items():
        if not name.startswith("neutral_"):
            cells = [f"{one.mean(name):.3g} ± {one.error(name):.2g}" for one in scores.values()]
            text.append(f"| {label} | {' | '.join(cells)} |")
    return text


HEAD = """# The paper's slope by the shipped sets

This page compares the default impact set and `bourrier2009` with the site of the paper. Each number
is a mean over {slopes} slopes made by the recipe of
[cases/vaujany](../../cases/vaujany/README.md), with 2,000 boulders on each. No calibration has seen
these slopes: `vaujany-observed` is fitted to the observed boulders, not to these numbers.

± is the standard error from slopes, boulders and coefficients. Targets are met unless a number is
marked: *not met*, or *undecided* within one standard error of a bound. Rg of method A is read as a
radius; `ratio` is `'between'` for `vaujany-observed`, `'nearest'` for `bourrier2009`.
[Planes](../validation/planes.md#neutral-slopes-degree) has the neutral slopes.
`benchmarks/accuracy/vaujany.py` writes this page and [other sets and rules](vaujany_sets.md).
"""
OTHERS = """# The paper's slope by other sets and rules

This page continues [the comparison with the paper](vaujany_paper.md), with the same slopes
and boulders: `bourrier2009` with turns to the aspect, draws of its ensemble in rotation, and the
former default `laboratory-spheres`, for which Rg of method A is read as a diameter. The last column
has the range of the ensemble's draws. `benchmarks/accuracy/vaujany.py` writes it.
"""
KS = """
Table 4 of the paper, Kolmogorov-Smirnov tests against the observed boulders, cannot be repeated:
the samples were not published."""


def page(head: str, scores: dict[str, Score], wanted: list[Target]) -> str:
    parts = {
        "Compared with the paper (table 2 and text)": [
            *rows(scores, wanted, scores.get(ENSEMBLE)),
            KS,
        ],
        "Without a number in the paper": beside(scores),
    }
    return head + "".join(
        "\n".join(["", f"## {title}", "", *lines, ""]) for title, lines in parts.items()
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--slopes", type=int, default=48)
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "docs")
    options = parser.parse_args()
    with ProcessPoolExecutor() as pool:
        found = pool.map(partial(measure, slopes=options.slopes), COLUMNS)
        scores = dict(zip(COLUMNS, found, strict=True))
    wanted = targets(VAUJANY)
    main_scores = {name: scores.pop(name) for name in MAIN}
    head = HEAD.format(slopes=options.slopes)
    with atomic_write(options.output / "archive" / "vaujany_paper.md") as part:
        part.write_text(page(head, main_scores, wanted), encoding="utf-8")
    with atomic_write(options.output / "archive" / "vaujany_sets.md") as part:
        part.write_text(page(OTHERS, scores, wanted), encoding="utf-8")


if __name__ == "__main__":
    main()
