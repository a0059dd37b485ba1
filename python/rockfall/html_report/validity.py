# SPDX-License-Identifier: BSD-3-Clause
"""What limits the validity of a result, each limit in a sentence made from its numbers."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from rockfall.analysis.extrapolation import extrapolations
from rockfall.case import case_of
from rockfall.quantities import count, part_of, percent
from rockfall.result.trajectories import ends, left_terrain

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from rockfall.case import Case
    from rockfall.html_report.intervals import Rows

FEW = 100  # boulders at a line, below which its upper quantiles are hardly known
FEW_IN_CELL = 30  # boulders through a cell, below which its numbers are mostly Monte Carlo error
ORIGIN = {  # of the shipped impact sets: docs/validation/lab.md
    "rocky-slope": "comes from simulated impacts of spheres on layers of spheres, whose contact "
    "parameters were calibrated to numbers printed for one site, on a terrain rebuilt from its "
    "description",
}
SENSITIVE = (
    "The confidence intervals hold the Monte Carlo error of one model with one set of inputs, not "
    "the epistemic uncertainty. Slopes near neutral, where a bounce loses about what the next "
    "flight gains, are sensitive: in cases/vaujany 2 degrees less or more than 38 move the "
    "fraction that passes EL1 from 81 % to 44 % or 94 %. Vary terrain, ground and volume before "
    "you trust a difference of a few per cent."
)
ABSENT = {  # by the group of the case that would bring it
    "forest": ["trees"],
    "barrier": ["nets", "walls"],
    "dam": ["dams"],
}
BOULDER = (
    "A boulder is a sphere that does not break or slide, meets no other boulder, and leaves the "
    "ground as it was."
)
FOREST = (
    "Stems are vertical and as thick as at breast height. How high on the stem a hit is, crowns, "
    "lying stems, undergrowth and roots are not modelled, and later boulders find every tree as it "
    "was. By default a turn at a stem is neutral, not measured."
)
BARRIER = (
    "A barrier takes as much at its edge as in its middle, has no posts and no gap below, and is "
    "whole for each boulder."
)


def warnings(result: xr.Dataset) -> list[str]:
    """Where so much of a run lies outside what its model was made from that it comes first."""
    return [f"{found.text}." for found in extrapolations(result) if found.is_warning]


def cautions(result: xr.Dataset, rows: Rows, levels: pd.DataFrame) -> list[str]:
    """The limits, the weightiest first. The weight is the fraction of boulders, rebounds, cells or
    numbers that a limit concerns; above 1 it concerns the whole."""
    found = [*_of_run(result), *_of_model(result), *_of_lines(rows, levels), *_of_cells(result)]
    return [text for _, text in sorted(found, key=lambda one: -one[0])]


def _of_run(result: xr.Dataset) -> Iterator[tuple[float, str]]:
    """Boulders that are missing, that left, or that were ended."""
    boulders, requested = result.sizes["boulder"], int(result.attrs["boulders_asked"])
    case = case_of(result)
    if not result.attrs["complete"]:
        text = (
            f"The run was interrupted after {boulders:,} of {count(requested, 'boulder')}; "
            f"{percent(1 - boulders / requested)} are missing. All numbers are of those done."
        )
        if requested > case.case.get("boulders", 1):
            text += " Sources are run one after the other: the last ones are missing."
        yield 3.0, text
    if boulders == 1:
        yield 2.5, "1 boulder is an example. Fractions and quantiles need at least some hundred."
    ended = ends(result)
    if left := int(left_terrain(result).sum()):
        text = "left the terrain model: their trajectory beyond it is not known and not counted."
        yield left / boulders, f"{part_of(left, boulders, 'boulder')} {text}"
    if limit := int(ended["impact_limit"].sum()):
        of = f"{case.impact['impact_limit']:,} contacts (impact_limit)"
        text = f"reached the limit of {of} while moving: where they come to rest is not known."
        yield limit / boulders, f"{part_of(limit, boulders, 'boulder')} {text}"


def _of_model(result: xr.Dataset) -> Iterator[tuple[float, str]]:
    """What the model leaves out, and rebounds for which it is not made."""
    yield 2.0, SENSITIVE
    name = str(result.attrs["impact_set"])
    origin = ORIGIN.get(name, "is the user's own: what it was calibrated on is not known here")
    yield 1.5, f"The impact set '{name}' {origin}. It is for R_b/R_m of 1 to 5."
    yield 1.2, _left_out(result)
    for found in extrapolations(result):
        if not found.is_warning:
            yield found.fraction, f"{found.text}."
    rebounds, redrawn, forced = (int(result[f"rebounds{of}"]) for of in ("", "_redrawn", "_forced"))
    for part, text in (
        (forced, "had no admissible draw in 32: the last one was limited so as to be admissible."),
        (redrawn, "needed more than one draw, since the first gained energy or did not rise."),
    ):  # fmt: skip
        if part:
            yield part / rebounds, f"{part_of(part, rebounds, 'rebound')} {text}"


def _left_out(result: xr.Dataset) -> str:
    """What the model of this case does not have; what is not modelled of what it has."""
    case = case_of(result)
    absent = [name for group, names in ABSENT.items() if not _has(case, group) for name in names]
    sentences = [f"The case has no {_either(absent)}."] if absent else []
    sentences += [FOREST] if _has(case, "forest") else []
    sentences += [BARRIER] if _has(case, "barrier") else []
    return " ".join([*sentences, BOULDER])


def _has(case: Case, group: str) -> bool:
    """Whether a case has trees (of &forest some keys have defaults), or a repeated group."""
    given = getattr(case, group)
    if group != "forest":
        return bool(given)
    return any(given.get(key) is not None for key in ("trees", "stems", "uniform_stems"))


def _either(names: list[str]) -> str:
    """Names with commas, and `or` before the last."""
    return " or ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)


def _of_lines(rows: Rows, levels: pd.DataFrame) -> Iterator[tuple[float, str]]:
    """Lines that few boulders pass, and the extremes there."""
    passed = {line: int(numbers["speed"]["n"]) for line, numbers in rows.items()}
    for line, n in passed.items():
        if n < FEW:
            unknown = "high quantiles there are hardly known" if n else "no speed there is known"
            yield 1 - n / FEW, f"{line}: {count(n, 'boulder')} passed, fewer than {FEW}: {unknown}."
    if not any(passed.values()):
        return
    largest = f"at a line up to {max(passed.values()):,}"
    yield 0.3, f"Maxima grow with the number of boulders ({largest}): they are no bounds."
    wanted = levels.filter(regex="^level_[0-9]+$")[levels["n"] > 0]
    refused = int(wanted.isna().to_numpy().sum())
    if refused:
        text = "refused, since the data do not support them; the table says why."
        yield 0.2, f"Return levels: {refused} of {wanted.size} are {text}"
    if given := wanted.size - refused:
        text = "given. They extrapolate the tail, which has no physical limit."
        yield 0.1, f"Return levels: {given} of {wanted.size} are {text}"


def _of_cells(result: xr.Dataset) -> Iterator[tuple[float, str]]:
    """Cells that so few boulders passed that Monte Carlo error rules there."""
    if "passages" in result:
        passed = result["passages"].values
    elif "reach_probability" in result:
        passed = np.rint(result["reach_probability"].values * result.sizes["boulder"])
    else:
        return
    reached, few = int((passed > 0).sum()), int(((passed > 0) & (passed < FEW_IN_CELL)).sum())
    if few:
        text = f"saw fewer than {FEW_IN_CELL} boulders: mostly Monte Carlo error."
        yield few / reached, f"{part_of(few, reached, 'reached cell')} {text}"
