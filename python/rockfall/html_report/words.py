# SPDX-License-Identifier: BSD-3-Clause
"""A result in sentences, each made from its numbers: what happened, how sure, what to beware of."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np

from rockfall.analysis.extrapolation import extrapolations
from rockfall.analysis.line_statistics import line_statistics, sources
from rockfall.analysis.run_until import verdicts_of
from rockfall.case import case_of
from rockfall.html_report.markup import UNITS, limits, number
from rockfall.quantities import count, part_of, percent
from rockfall.result.trajectories import ends, left_terrain

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    Numbers = Mapping[str, Mapping[str, float]]  # quantity -> its row of line_statistics
    Rows = Mapping[str, Numbers]  # by line

FEW = 100  # boulders at a line, below which its upper quantiles are hardly known
FEW_IN_CELL = 30  # boulders through a cell, below which its numbers are mostly chance
ORIGIN = {  # of the shipped impact sets: docs/lab.md
    "rocky-slope": "comes from simulated impacts of spheres on layers of spheres, whose contact "
    "parameters were calibrated to numbers printed for one site, on a terrain rebuilt from its "
    "description",
}
SENSITIVE = (
    "The intervals hold the chance of one model with one set of inputs. Slopes near neutral, where "
    "a bounce loses about what the next flight gains, are sensitive: in cases/vaujany 2 degrees "
    "less or more than 38 move the share that passes EL1 from 81 % to 44 % or 94 %. Vary terrain, "
    "ground and volume before you trust a difference of a few per cent."
)
UNKNOWN = (
    "The model knows no trees, nets or dams. A boulder is a sphere that does not break or slide, "
    "meets no other boulder, and leaves the ground as it was."
)
HEIGHT, SPEED, ENERGY = "passing_height", "speed", "energy_total"


def rows_of(result: xr.Dataset) -> Rows:
    """`line_statistics` by line and quantity."""
    table = line_statistics(result)
    return {
        str(line): {row["quantity"]: row.to_dict() for _, row in part.iterrows()}
        for line, part in table.groupby("line", sort=False)
    }


def in_words(result: xr.Dataset, rows: Rows) -> list[str]:
    """The result in paragraphs: what was run, what passes each line, how boulders ended, how sure
    all this is."""
    return [
        _run(result),
        *(_line(line, numbers, result.sizes["boulder"]) for line, numbers in rows.items()),
        *([] if rows else ["The case has no evaluation lines."]),
        " ".join(_ends(result)),
        " ".join(_sure(result, rows)),
    ]


def _run(result: xr.Dataset) -> str:
    """Who was released, where and how."""
    boulders, volume = result.sizes["boulder"], result["volume"].values
    of = sources(result).max() + 1
    many = boulders > 1
    low, high = number(volume.min()), number(volume.max())
    size = (
        f"{low} m³" if low == high else f"{low} to {high} m³ ({number(volume.mean())} on average)"
    )
    release = case_of(result).release
    drop, velocity = release["drop_height"], release["velocity"]
    start = f"{drop:g} m above the surface" if drop else "on the surface"
    if any(velocity):
        start += " with a velocity of " + ", ".join(f"{v:g}" for v in velocity)
        start += " m/s to the east, to the north and upwards"
    return (
        f"{count(boulders, 'boulder')} of {size} {'were' if many else 'was'} released from "
        f"{count(of, 'source')}, {start}, and followed until {'each' if many else 'it'} ended."
    )


def _line(line: str, numbers: Numbers, boulders: int) -> str:
    """The share that passes a line, and speed, height and energy there."""
    speed = numbers[SPEED]
    n, upper = int(speed["n"]), speed["fraction_high"]
    if not n:
        most = f"{number(upper, UNITS['fraction'])} %"
        chance = f"by chance the share may still be up to {most} (95 %)"
        return f"{line}: no boulder of {boulders:,} passes; {chance}."
    share = f"{percent(speed['fraction'])} {limits(speed, 'fraction', UNITS['fraction'])}".strip()
    passes = "passes" if n == 1 else "pass"
    text = f"{line}: {n:,} of {count(boulders, 'boulder')} {passes}, {share}. "
    shown = {name: UNITS[name] for name in (SPEED, HEIGHT, ENERGY)}
    if n == 1:
        speed, height, energy = (
            f"{number(numbers[name]['mean'], unit)} {unit.unit}" for name, unit in shown.items()
        )
        return text + (
            f"It does so at {speed}, its centre {height} above the ground, with {energy}. "
            "One boulder tells nothing of the spread."
        )

    def known(quantity: str, name: str) -> str:
        unit, row = shown[quantity], numbers[quantity]
        return f"{number(row[name], unit)} {unit.unit} {limits(row, name, unit)}".strip()

    return text + (
        f"On average they do so at {known(SPEED, 'mean')}, with their centre "
        f"{known(HEIGHT, 'mean')} above the ground and with {known(ENERGY, 'mean')}. "
        f"95 in 100 of those that pass stay below {known(SPEED, 'q95')}, {known(HEIGHT, 'q95')} "
        f"and {known(ENERGY, 'q95')}."
    )


def _ends(result: xr.Dataset) -> Iterator[str]:
    """How boulders ended, how far they came and at which angle below their release."""
    says = {
        "stopped": "came to rest on the slope",
        "absorbed": "ended where the ground absorbs boulders",
        "left_domain": "left the terrain model",
        "hit_nodata": "met terrain without elevation",
        "impact_limit": "reached the limit of contacts and were ended there",
    }
    boulders = result.sizes["boulder"]
    parts = [
        f"{of.sum():,} ({percent(of.mean())}) {says[w]}"
        for w, of in ends(result).items()
        if of.any()
    ]
    yield f"Of {count(boulders, 'boulder')} {_joined(parts)}."
    distance = result["plan_distance"].values
    if not distance.any():
        yield "None left its place."
        return
    far = np.quantile(distance, [0.5, 0.95])
    drop = result["start_z"].values - result["stop_z"].values
    if boulders == 1:
        yield f"It came {number(distance[0])} m far in plan and {number(drop[0])} m down."
        return
    yield (
        f"Half came further than {number(far[0])} m in plan, 5 in 100 further than "
        f"{number(far[1])} m, the furthest {number(distance.max())} m."
    )
    moved = distance > 0
    angle = np.degrees(np.arctan2(drop[moved], distance[moved]))
    yield (
        f"The straight line from release to end falls by {number(np.median(angle))} degrees in the "
        f"median and by {number(angle.min())} degrees at least."
    )


def _joined(parts: list[str]) -> str:
    return " and ".join([", ".join(parts[:-1]), parts[-1]] if len(parts) > 1 else parts)


def half_width(row: Mapping[str, float], name: str) -> float:
    """Half the length of the 95 % interval, as a share of the number itself; NaN without."""
    low, high = (row.get(f"{name}_{end}", np.nan) for end in ("low", "high"))
    return (high - low) / 2 / abs(row[name]) if row.get(name, 0.0) else np.nan


def _sure(result: xr.Dataset, rows: Rows) -> Iterator[str]:
    """How far chance alone moves the numbers above."""
    crossed = [numbers for numbers in rows.values() if numbers[SPEED]["n"]]
    widths = {
        "shares passing": [half_width(numbers[SPEED], "fraction") for numbers in crossed],
        "mean speeds": [half_width(numbers[SPEED], "mean") for numbers in crossed],
        "energies that 5 in 100 exceed": [half_width(n[ENERGY], "q95") for n in crossed],
    }
    if result.sizes["boulder"] == 1:
        yield "One boulder tells nothing of chance."
        return
    if not crossed:
        yield "Only shares have an interval." if rows else "No number has an interval."
        return
    worst = {name: np.max(width) for name, width in widths.items()}  # NaN where one is unknown
    known = [f"the {name} by ± {percent(w)}" for name, w in worst.items() if np.isfinite(w)]
    unknown = [name for name, w in worst.items() if not np.isfinite(w)]
    where = "Chance" if len(crossed) == 1 else "At the least certain line chance"
    if known:
        yield f"{where} alone moves {_joined(known)} of their own value."
    if unknown:
        yield f"Too few boulders pass for an interval of the {_joined(unknown)}."
    if sources(result).max() > 0:
        yield "Boulders of one source count as a cluster, since what one does tells of the others."
    if case_of(result).case["sampling"] == "sobol":
        yield (
            "Sobol' points spread the boulders more evenly than chance would: the intervals are "
            "those of as many random boulders, and too wide."
        )
    for verdict in verdicts_of(result):
        yield f"Asked for: {verdict}."
    yield (
        "Brackets are 95 % intervals: as many other boulders would give numbers about there. "
        "They say nothing of errors in the terrain, the ground or the model."
    )


def warnings(result: xr.Dataset) -> list[str]:
    """Where so much of a run lies beyond what its model was made from that it comes first."""
    return [f"{found.text}." for found in extrapolations(result) if found.is_warning]


def cautions(result: xr.Dataset, rows: Rows, levels: pd.DataFrame) -> list[str]:
    """What limits the validity of a result, the weightiest first. The weight of a caution is the
    share of boulders, rebounds, cells or numbers that it touches; above 1 it touches the whole.
    """
    found = [*_of_run(result), *_of_model(result), *_of_lines(rows, levels), *_of_cells(result)]
    return [text for _, text in sorted(found, key=lambda one: -one[0])]


def _of_run(result: xr.Dataset) -> Iterator[tuple[float, str]]:
    """Boulders that are missing, that left, or that were ended."""
    boulders, asked = result.sizes["boulder"], int(result.attrs["boulders_asked"])
    case = case_of(result)
    if not result.attrs["complete"]:
        text = (
            f"The run was interrupted after {boulders:,} of {count(asked, 'boulder')}; "
            f"{percent(1 - boulders / asked)} are missing. All numbers are of those done."
        )
        if asked > case.case["boulders"]:
            text += " Sources are run one after the other: the last ones are missing."
        yield 3.0, text
    if boulders == 1:
        yield 2.5, "1 boulder is an example. Shares and quantiles need some hundred at least."
    left, limit = (int(of.sum()) for of in (left_terrain(result), ends(result)["impact_limit"]))
    if left:
        text = "left the known terrain: the way beyond it is not known and not counted."
        yield left / boulders, f"{part_of(left, boulders, 'boulder')} {text}"
    if limit:
        most = f"{case.impact['impact_limit']:,} contacts (impact_limit)"
        text = f"reached the limit of {most} on the way: the place of rest is not known."
        yield limit / boulders, f"{part_of(limit, boulders, 'boulder')} {text}"


def _of_model(result: xr.Dataset) -> Iterator[tuple[float, str]]:
    """What the model does not know, and rebounds for which it is not made."""
    yield 2.0, SENSITIVE
    name = str(result.attrs["impact_set"])
    origin = ORIGIN.get(name, "is the user's own: what it was calibrated on is not known here")
    yield 1.5, f"The impact set '{name}' {origin}. It stands for R_b/R_m of 1 to 5."
    yield 1.2, UNKNOWN
    for found in extrapolations(result):
        if not found.is_warning:
            yield found.fraction, f"{found.text}."
    rebounds, redrawn, forced = (int(result[f"rebounds{of}"]) for of in ("", "_redrawn", "_forced"))
    for part, text in (
        (forced, "had no admissible draw in 32: the last one was cut down to be so."),
        (redrawn, "needed more than one draw, since the first gained energy or did not rise."),
    ):  # fmt: skip
        if part:
            yield part / rebounds, f"{part_of(part, rebounds, 'rebound')} {text}"


def _of_lines(rows: Rows, levels: pd.DataFrame) -> Iterator[tuple[float, str]]:
    """Lines that few boulders pass, and the extremes there."""
    passed = {line: int(numbers[SPEED]["n"]) for line, numbers in rows.items()}
    for line, n in passed.items():
        if n < FEW:
            unknown = "high quantiles there are hardly known" if n else "no speed there is known"
            yield 1 - n / FEW, f"{line}: {count(n, 'boulder')} passed, fewer than {FEW}: {unknown}."
    if not any(passed.values()):
        return
    most = f"at a line {max(passed.values()):,} at most"
    yield 0.3, f"Maxima grow with the number of boulders ({most}): they are no bounds."
    asked = levels.filter(regex="^level_[0-9]+$")[levels["n"] > 0]
    refused = int(asked.isna().to_numpy().sum())
    if refused:
        text = "refused, since the data do not bear them; the table says why."
        yield 0.2, f"Return levels: {refused} of {asked.size} are {text}"
    if given := asked.size - refused:
        text = "given. They extend the shape of the tail, which knows no physical limit."
        yield 0.1, f"Return levels: {given} of {asked.size} are {text}"


def _of_cells(result: xr.Dataset) -> Iterator[tuple[float, str]]:
    """Cells that so few boulders passed that chance rules there."""
    if "passages" in result:
        passed = result["passages"].values
    elif "reach_probability" in result:
        passed = np.rint(result["reach_probability"].values * result.sizes["boulder"])
    else:
        return
    reached, few = int((passed > 0).sum()), int(((passed > 0) & (passed < FEW_IN_CELL)).sum())
    if few:
        text = f"saw fewer than {FEW_IN_CELL} boulders: the numbers there are mostly chance."
        yield few / reached, f"{part_of(few, reached, 'reached cell')} {text}"
