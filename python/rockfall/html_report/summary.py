# SPDX-License-Identifier: BSD-3-Clause
"""A result in sentences, each made from its numbers: what happened, and how precise it is."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from rockfall.analysis.precision.intervals import half_width, sources
from rockfall.analysis.run_until import verdicts_of
from rockfall.case import case_of
from rockfall.html_report.intervals import in_unit, interval
from rockfall.protection.barriers import barriers_of
from rockfall.quantities import QUANTITIES, count, number, percent
from rockfall.result.trajectories import ends

if TYPE_CHECKING:
    import xarray as xr

    from rockfall.html_report.intervals import Numbers, Row, Rows

SHOWN = ("speed", "passing_height", "energy_total")
ENDED = {  # of the statuses whose name does not say it
    "stopped": "came to rest on the slope",
    "absorbed": "ended where the ground absorbs boulders",
    "left_domain": "left the terrain model",
    "hit_nodata": "met terrain without elevation",
    "impact_limit": "reached the limit of contacts and were ended there",
    "stopped_by_tree": "were stopped by trees",
    "stopped_by_barrier": "were stopped by barriers",
}


def summary(result: xr.Dataset, rows: Rows) -> list[str]:
    """Paragraphs: what was run, what crosses each line, how boulders ended, how precise this is."""
    boulders = result.sizes["boulder"]
    barriers = {str(result["line"].values[k]) for k in barriers_of(result)}
    return [
        _run(result),
        *(_line(line, rows[line], boulders, line in barriers) for line in rows),
        *([] if rows else ["The case has no evaluation lines."]),
        " ".join(_ends(result)),
        " ".join(_precision(result, rows)) if boulders > 1 else "One boulder has no spread.",
    ]


def _run(result: xr.Dataset) -> str:
    """Which boulders were released, where and how."""
    boulders, volume = result.sizes["boulder"], result["volume"].values
    low, mean, high = (number(v) for v in (volume.min(), volume.mean(), volume.max()))
    size = f"{low} m³" if low == high else f"{low} to {high} m³ ({mean} on average)"
    release = case_of(result).release
    drop, velocity = release["drop_height"], release["velocity"]
    start = f"{drop:g} m above the surface" if drop else "on the surface"
    if "source_feature" in result:
        start += " where their layer does not say otherwise"
    if any(velocity):
        start += " with a velocity of " + ", ".join(f"{v:g}" for v in velocity)
        start += " m/s to the east, to the north and upwards"
    was, each = ("were", "each") if boulders > 1 else ("was", "it")
    return (
        f"{count(boulders, 'boulder')} of {size} {was} released from "
        f"{count(sources(result).count, 'source')}, {start}, and followed until {each} ended."
    )


def _line(line: str, numbers: Numbers, boulders: int, is_barrier: bool) -> str:
    """The fraction that passes a line or comes to a barrier; speed, height and energy there."""
    one, many = ("comes to it", "come to it") if is_barrier else ("passes", "pass")
    row = numbers["speed"]
    n = int(row["n"])
    if not n:
        high = in_unit(row["fraction_high"], "fraction")
        text = f"the upper 95 % confidence limit of the fraction that {one} is {high} %"
        return f"{line}: no boulder of {boulders:,} {one}; {text}."
    fraction = f"{percent(row['fraction'])} {interval(row, 'fraction', 'fraction')}".strip()
    text = f"{line}: {n:,} of {count(boulders, 'boulder')} {one if n == 1 else many}, {fraction}. "
    if n == 1:
        speed, height, energy = (_known(numbers[name], name, "mean") for name in SHOWN)
        return text + (
            f"Its speed is {speed}, its passing height {height} and its total kinetic energy "
            f"{energy}. One boulder has no spread."
        )
    means, high = (
        [f"{QUANTITIES[name].label} {_known(numbers[name], name, of)}" for name in SHOWN]
        for of in ("mean", "q95")
    )
    return text + f"Means: {_joined(means)}. 95 % quantiles: {_joined(high)}."


def _known(row: Row, quantity: str, name: str) -> str:
    """A number with its unit and its interval."""
    shown = f"{in_unit(row[name], quantity)} {QUANTITIES[quantity].unit}"
    return f"{shown} {interval(row, name, quantity)}".strip()


def _ends(result: xr.Dataset) -> Iterator[str]:
    """How boulders ended, how far they came and at which angle below their release."""
    boulders = result.sizes["boulder"]
    parts = [
        f"{of.sum():,} ({percent(of.mean())}) {ENDED.get(name, 'ended: ' + name.replace('_', ' '))}"
        for name, of in ends(result).items()
        if of.any()
    ]
    yield f"Of {count(boulders, 'boulder')} {_joined(parts)}."
    distance = result["plan_distance"].values
    if not distance.any():
        yield "None left its place."
        return
    drop = result["start_z"].values - result["stop_z"].values
    if boulders == 1:
        yield f"Its run-out in plan is {number(distance[0])} m, its drop {number(drop[0])} m."
        return
    half, far = np.quantile(distance, [0.5, 0.95])
    moved = distance > 0
    angle = np.degrees(np.arctan2(drop[moved], distance[moved]))
    yield (
        f"Run-out in plan: median {number(half)} m, 95 % quantile {number(far)} m, max "
        f"{number(distance.max())} m. The straight line from release to end falls by "
        f"{number(np.median(angle))} degrees in the median and by {number(angle.min())} at min."
    )


def _joined(parts: list[str]) -> str:
    return " and ".join([", ".join(parts[:-1]), parts[-1]] if len(parts) > 1 else parts)


def _precision(result: xr.Dataset, rows: Rows) -> Iterator[str]:
    """The Monte Carlo error of the numbers above."""
    crossed = [numbers for numbers in rows.values() if numbers["speed"]["n"]]
    if not crossed:
        only = "Only the fractions that pass have" if rows else "No number has"
        yield f"{only} a confidence interval."
        return
    widths = {
        "fractions passing": [half_width(numbers["speed"], "fraction") for numbers in crossed],
        "mean speeds": [half_width(numbers["speed"], "mean") for numbers in crossed],
        "95 % quantiles of the energy": [half_width(n["energy_total"], "q95") for n in crossed],
    }
    worst = {name: np.max(width) for name, width in widths.items()}  # NaN where one is unknown
    known = [f"± {percent(w)} for the {name}" for name, w in worst.items() if np.isfinite(w)]
    unknown = [name for name, w in worst.items() if not np.isfinite(w)]
    if known:
        where = "" if len(crossed) == 1 else ", at the line where it is largest"
        yield f"Monte Carlo error (95 %, relative{where}): {_joined(known)}."
    if unknown:
        yield f"Too few boulders pass for a confidence interval of the {_joined(unknown)}."
    source = sources(result)
    if source.count > 1:
        of = f"{source.count:,} sources"
        yield (
            f"The {of} are taken for a sample of others like them."
            if source.sampled
            else f"The intervals are for as many other boulders from the same {of}."
        )
    if case_of(result).case["sampling"] == "sobol":
        yield (
            "Sobol' points spread the boulders more evenly than random numbers do: the intervals "
            "are those of as many random boulders, and too wide."
        )
    for verdict in verdicts_of(result):
        yield f"Requested: {verdict}."
    yield (
        "Brackets are 95 % confidence intervals. They hold the Monte Carlo error alone, and no "
        "error of the terrain, the ground or the model."
    )
