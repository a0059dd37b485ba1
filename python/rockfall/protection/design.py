# SPDX-License-Identifier: BSD-3-Clause
"""Design sheet of a result: loads at lines, requirements of standards, checks of barriers."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from rockfall.analysis.line_statistics import numbers_at, with_limits
from rockfall.analysis.lines.profile import line_number, windows
from rockfall.analysis.lines.samples import LineSamples
from rockfall.analysis.population import population_notes
from rockfall.analysis.precision.intervals import passing_percent
from rockfall.analysis.return_levels import LEVELS, tail_at
from rockfall.analysis.validity.rebounds import has_own_grounds
from rockfall.analysis.validity.remarks import model_warnings
from rockfall.case import Case, case_of
from rockfall.errors import RockfallError
from rockfall.language import say, word
from rockfall.protection.barriers import barriers_of
from rockfall.protection.crossings import Crossings, crossings
from rockfall.protection.demand import demand, usable
from rockfall.protection.factors import BACK_ANALYSED, Conditions, Factors, read_factors
from rockfall.protection.selection import choices, cost_remarks, read_costs, residual_of
from rockfall.result.crossings import line_names, stored_at
from rockfall.result.grounds import classical_grounds
from rockfall.result.samples import check_rows, kept_note
from rockfall.result.trajectories import flags_of
from rockfall.result.variables import ENDS
from rockfall.simulation.progress import stepped

LOADS = (
    "speed", "energy_total", "energy_translational",
    "passing_height", "upper_edge", "normal_height", "normal_upper_edge",
)  # fmt: skip
DESIGN = ("v_d", "E_d", "h_d", "normal_h_d", "height_needed", "normal_height_needed")
_WITH_LIMITS = [name + end for name in DESIGN for end in ENDS]
_LOADS = ["line", "n", "quantity", *with_limits("q95"), *with_limits("q99")]
_LOADS += [name for N in LEVELS for name in with_limits(f"level_{N}")]
FAR = 10.0  # ratio of design block to boulder volume that triggers a remark
_DEMAND = ["n", "volume", "m_d", *_WITH_LIMITS, "f_min", *with_limits("ead_class"), "unconfirmed"]
_CHECKS = [
    "line", "n", "height", "capacity", "height_needed", "height_holds", "height_certain", "E_d",
    "energy_allowed", "energy_holds", "energy_certain", "holds", "over", "through",
    *with_limits("residual"), "unconfirmed", "verdict",
]  # fmt: skip
_CHOICES = ["line", "n", "ead_class", "capacity", "height", *with_limits("residual")]
_CHOICES += ["cost", "cheapest", "unconfirmed"]
_ALONG = ["line", "start", "end", *_DEMAND]


@dataclass(frozen=True)
class Design:
    """Tables of a design, in SI units; intervals are 95 % confidence intervals.

    `loads` has a row for each line and quantity, `demand` the requirements of the standard at each
    line, `checks` a check of each barrier, and `choices` for each line and EAD class the height at
    which at most the fraction `residual` passes. `along` is like `demand` for windows of a line, if
    requested, else None. The column `unconfirmed` lists unconfirmed assumptions behind the loads
    (rebounds, forest, logs): a passed check is not proven under such assumptions. `warnings`
    are model remarks. If a run did not keep all boulders, `kept` is a note on the boulders used;
    else "".
    """

    factors: Factors
    residual: float
    loads: pd.DataFrame
    demand: pd.DataFrame
    checks: pd.DataFrame
    choices: pd.DataFrame
    along: pd.DataFrame | None
    warnings: tuple[str, ...] = ()
    kept: str = ""
    population: tuple[str, ...] = ()  # notes on the boulders used
    priced: bool = False  # True if costs come from prices, else class energy [kJ] x height


def design(
    result: xr.Dataset,
    *,
    line: str | Collection[str] | None = None,
    along: str | None = None,
    width: float = 10.0,
    min_boulders: int = 50,
    residual: float = 0.01,
    volume: float | None = None,
    factors: str | Path | None = None,
    costs: str | Path | None = None,
    **conditions: str,
) -> Design:
    """Requirements for a barrier on each line of a result, and checks of its barriers.

    `line` selects lines and barriers for the sheet by name. `along` selects a line to be cut into
    windows of `width` [m]; windows with fewer than `min_boulders` boulders are blank. `residual` is
    the fraction of boulders that may pass, `volume` [m3] the design block. `factors` is a table
    with the factors of the standard; without it, requirements are NaN and `along` is refused.
    `costs` is a table of prices. `conditions` are fields of
    `rockfall.protection.factors.Conditions`. Invalid arguments raise a RockfallError.

    >>> import rockfall
    >>> result = rockfall.run(rockfall.read_case("case.nml"))
    >>> sheet = rockfall.design(result, survey="good")
    """
    lines = [line] if isinstance(line, str) else line
    _check(result, lines, along, width, min_boulders, residual, volume)
    standard = read_factors(conditions_of(conditions), factors)
    if along is not None:
        standard.require(f"along {along}")
    prices = read_costs(costs) if costs is not None else None
    case = case_of(result)
    how = standard, case.boulder["density"], volume
    doubts: dict[str, Any] = {"unconfirmed": unconfirmed_of(result, case, standard)}
    names, nets, samples = line_names(result), barriers_of(result), LineSamples(result)
    asked, barriers, chosen = [], [], []
    loads: list[dict[str, Any]] = []
    shown = [(k, name) for k, name in enumerate(names) if lines is None or name in lines]
    for k, name in stepped(shown):  # with the boulders of one line in memory at a time
        came = crossings(result, k)
        _, *percents = passing_percent(result, k)
        fractions = (value / 100 for value in percents)
        limits = dict(zip(with_limits("fraction"), fractions, strict=True))
        asked.append({"line": name, **demand(came, *how), **doubts, **limits})
        if k in nets:
            row = _check_of(result, k, came, asked[-1], standard) | doubts
            barriers.append(row | {"verdict": verdict_of(row)})
        rows = choices(came, residual, prices)
        chosen += [{"line": name, "n": came.n} | row | doubts for row in rows]
        loads += _loads(name, samples, k)
    parts = None
    if along is not None:
        came = crossings(result, names.index(along))
        rows = _along(result, along, came, width, min_boulders, *how)
        parts = _table([row | doubts for row in rows], _ALONG)
    return Design(
        standard,
        residual,
        loads=_table(loads, _LOADS),
        demand=_table(asked, ["line", *_DEMAND, *with_limits("fraction")]),
        checks=_table(barriers, _CHECKS),
        choices=_table(chosen, _CHOICES),
        along=parts,
        warnings=(
            *model_warnings(result, case),
            *_block_remarks(result, volume),
            *cost_remarks(prices),
        ),  # fmt: skip
        kept=kept_note(result),
        population=tuple(population_notes(case)),
        priced=prices is not None,
    )


def _block_remarks(result: xr.Dataset, volume: float | None) -> Iterator[str]:
    """Remark on a design block that is much larger or smaller than the boulders that give its
    speed."""
    low, high = float(result["volume"].min()), float(result["volume"].max())
    if volume is not None and not low / FAR <= volume <= high * FAR:
        yield say("design.far_block", volume=volume, low=low, high=high)


def unconfirmed_of(result: xr.Dataset, case: Case, factors: Factors) -> str:
    """Unconfirmed assumptions behind the loads. The user confirms own grounds by declaring the
    rebound back-analysed; shipped classical grounds, forest and logs are always unconfirmed."""
    is_fitted = has_own_grounds(case) and factors.conditions.calibration == BACK_ANALYSED
    rebounds = ["rebounds"] if classical_grounds(result) and not is_fitted else []
    forest = ["forest"] if case.has_forest else []
    logs = ["logs"] if any("diameter" in barrier for barrier in case.barrier) else []
    return "; ".join([*rebounds, *forest, *logs])


def _table(rows: list[dict[str, Any]], columns: list[str]) -> pd.DataFrame:
    return pd.DataFrame(rows, columns=columns)


def conditions_of(given: dict[str, str]) -> Conditions:
    """Conditions of the standard from the options; a TypeError for unknown options."""
    unknown = given.keys() - Conditions.__dataclass_fields__.keys()
    if unknown:
        raise TypeError(f"design: unknown option {sorted(unknown)[0]!r}")
    return Conditions(**given)


def _check(
    result: xr.Dataset,
    lines: Collection[str] | None,
    along: str | None,
    width: float,
    min_boulders: int,
    residual: float,
    volume: float | None,
) -> None:
    names = line_names(result)
    if not names:
        raise RockfallError("design: the result has no evaluation lines and no barriers")
    check_rows(result, "design")
    if not result.sizes["boulder"]:
        raise RockfallError("design: the result has no boulders")
    for name in (*(lines or ()), *([] if along is None else [along])):
        line_number(result, name)
    if not 0 <= residual < 1:
        raise RockfallError(f"residual = {residual}: must be >= 0 and < 1")
    if not 0 < width < np.inf:
        raise RockfallError(f"width = {width}: must be > 0 m")
    if min_boulders < 1:
        raise RockfallError(f"min_boulders = {min_boulders}: must be >= 1")
    if volume is not None and not 0 < volume < np.inf:
        raise RockfallError(f"volume = {volume}: must be > 0 m3")


def _loads(line: str, samples: LineSamples, k: int) -> Iterator[dict[str, Any]]:
    """Statistics and return levels for the boulders that reach the line with this index."""
    for quantity in LOADS:
        sample, tail = tail_at(samples, k, quantity)
        row: dict[str, Any] = {"line": line, "n": sample.n, "quantity": quantity}
        if sample.n:
            row |= numbers_at(samples, k, quantity)
            for N, level in tail.levels.items():
                row |= zip(with_limits(f"level_{N}"), level[:3], strict=True)
        yield row


def _check_of(
    result: xr.Dataset, k: int, came: Crossings, asked: dict[str, Any], factors: Factors
) -> dict[str, Any]:
    """Check of a barrier against the standard, and the boulders that passed it in the run."""
    height, capacity = (float(result[f"barrier_{name}"][k]) for name in ("height", "capacity"))
    flags = flags_of(result["crossing_outcome"])
    outcome = stored_at(result, "outcome", k)
    over, through = (outcome == flags[name] for name in ("passed_over", "broken_through"))
    allowed = usable(capacity, factors)
    high, high_certain = _verdict(asked, "height_needed", lambda needed: height >= needed)
    strong, strong_certain = _verdict(asked, "E_d", lambda energy: energy < allowed)
    left = zip(with_limits("residual"), residual_of(over | through, came.source), strict=True)
    return {
        "line": asked["line"], "n": came.n, "height": height, "capacity": capacity,
        "height_needed": asked["height_needed"],
        "height_holds": high, "height_certain": high_certain,
        "E_d": asked["E_d"], "energy_allowed": allowed,
        "energy_holds": strong, "energy_certain": strong_certain,
        "holds": high and strong, "over": int(over.sum()), "through": int(through.sum()),
        **dict(left),
    }  # fmt: skip


def verdict_of(row: Mapping[str, Any]) -> str:
    """Verdict on a barrier with the governing requirements, for tables and texts: "no" if a
    requirement certainly fails; "undecided" if the interval of a requirement includes its limit,
    or if loads depend on unconfirmed assumptions; else "yes". "" for a barrier that no boulder
    reaches."""
    if not row["n"]:
        return ""
    unsure = [what for what in ("height", "energy") if not row[f"{what}_certain"]]
    failed = [
        what for what in ("height", "energy") if not row[f"{what}_holds"] and what not in unsure
    ]
    attrs = {"no": failed, "undecided": unsure}
    parts = [
        f"{word(answer)}: {', '.join(map(word, what))}" for answer, what in attrs.items() if what
    ]
    doubt = [] if failed else [word for word in row.get("unconfirmed", "").split("; ") if word]
    answer = "; ".join(parts) or word("undecided" if doubt else "yes")
    return f"{answer}; {word('unconfirmed')}: {'; '.join(map(word, doubt))}" if doubt else answer


def _verdict(
    asked: dict[str, Any], name: str, suffices: Callable[[float], bool]
) -> tuple[bool, bool]:
    """Verdict on a requirement, and True if it is certain: the whole interval agrees, and its
    decisive limit is known."""
    value, low, high = (asked[f"{name}{end}"] for end in ENDS)
    if suffices(value):
        return True, suffices(high)
    return False, not suffices(low) and not np.isnan(low)


def _along(
    result: xr.Dataset, line: str, came: Crossings, width: float, min_boulders: int, *how: Any
) -> Iterator[dict[str, Any]]:
    """Requirements of the standard in windows of `width` [m] along a line; blank where fewer than
    `min_boulders` boulders pass."""
    edges, window = windows(result, line_number(result, line), width)
    window = window[window >= 0]
    for k, (start, end) in enumerate(itertools.pairwise(edges)):
        here = came.where(window == k)
        row: dict[str, Any] = {"line": line, "start": start, "end": end}
        yield row | (demand(here, *how) if here.n >= min_boulders else {"n": here.n})
