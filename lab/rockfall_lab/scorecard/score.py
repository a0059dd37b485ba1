# SPDX-License-Identifier: BSD-3-Clause
"""Comparison of impact sets with published data on rebounds on rocky slopes.

The data are published by Bourrier et al. (2009): R_t and R_n of their impacts, and results of their
methods A and B on the slope of Vaujany, here on the stand-in of cases/vaujany. Because its bumps
differ from the site, each statistic is a mean over slopes with the same parameters.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rockfall.analysis.planes.plane_bounce import neutral_slope, set_rebound
from rockfall.errors import RockfallError
from rockfall.scene.rebounds.sets import Sets, restitution
from rockfall_lab.scorecard.site import QUANTITIES, Site
from rockfall_lab.scorecard.vaujany_slope import Talus

INF = float("inf")
FIRST_SEED = 1000  # seed of slopes and boulders; no calibration has used seeds from here on
REDRAWN = 8  # sets with perturbed means, each run on some of the slopes
SLOPE_BOULDERS = 400  # boulders for a neutral slope
BOUNDS = {"": 0.10, "_std": 0.25, "_max": 0.20}  # relative tolerances of the values in table 2
UNITS = {"speed": "m/s", "passing_height": "m", "energy_translational": "kJ"}


@dataclass(frozen=True)
class Target:
    """Target range of a statistic: from `low` to `high`, or one-sided; `printed` is the value in
    the paper."""

    name: str
    label: str
    low: float
    high: float
    printed: str
    held_out: bool = False  # not used in any calibration


OTHERS = (
    Target("a_slower", "EL1: speed of B less that of A [m/s]", 0.3, 2.5, "1.2"),
    Target("rt", "B: R_t, median over all rebounds", 0.65, 0.75, "0.7"),
    Target("rn_5_15", "B: R_n at 5-15 degrees", 1.0, INF, "> 1"),
    Target("tangential", "B: rebounds with tangential fraction > 0.75", 0.90, 0.96, "0.93"),
    Target("stop_short", "B: boulders that stop within 20-40 m", -INF, 0.05, "not 0.05"),
    Target("neutral_rise", "Neutral slope, max rise to the next R_b/R_m", -INF, 0.0, "-"),
    Target("rn_vertical", "B: R_n at vertical impact", 0.35, 0.45, "0.4", True),
    Target("B_EL1_rotational_share", "EL1, B: E_rot / E_tot, mean", 0.03, 0.10, "0.06", True),
    Target("B_EL1_rotational_share_std", "EL1, B: E_rot / E_tot, std", 0.035, 0.105, "0.07", True),
    Target("B_EL2_rotational_share", "EL2, B: E_rot / E_tot, mean", 0.04, 0.12, "0.08", True),
    Target("B_EL2_rotational_share_std", "EL2, B: E_rot / E_tot, std", 0.04, 0.12, "0.08", True),
)
#: Statistics without a target, because the paper gives no value.
BESIDE = {
    "B_EL1_passing": "EL1, B: fraction passing", "B_EL2_passing": "EL2, B: fraction passing",
    "A_EL1_passing": "EL1, A: fraction passing", "A_EL2_passing": "EL2, A: fraction passing",
    "B_EL1_spread": "EL1, B: lateral spread, std [m]",
    "B_EL2_spread": "EL2, B: lateral spread, std [m]",
    "turns_small": "B: turns below 22.5 degrees", "turns_large": "B: turns above 45 degrees",
    **{f"neutral_{k}": f"Neutral slope, R_b/R_m = {k} [degrees]" for k in range(1, 6)},
}  # fmt: skip


def targets(folder: str | Path) -> list[Target]:
    """All targets: those from table 2 (paper.csv in the site's folder), and OTHERS. Raises a
    RockfallError for an unreadable table."""
    path = Path(folder) / "paper.csv"
    try:
        rows = list(csv.DictReader(path.read_text(encoding="utf-8").splitlines()))
    except (OSError, UnicodeDecodeError) as error:
        raise RockfallError(f"{path}: cannot be read: {error}") from error
    all_targets = []
    try:
        for row in rows:
            line, method, quantity = row["line"], row["method"], row["quantity"]
            if method == "observed" or quantity not in QUANTITIES:
                continue
            for kind, fraction in BOUNDS.items():
                value = float(row[kind[1:] or "mean"])
                words = f"{line}, {method}: {quantity.replace('_', ' ')}, {kind[1:] or 'mean'}"
                all_targets.append(
                    Target(
                        f"{method}_{line}_{quantity}{kind}", f"{words} [{UNITS[quantity]}]",
                        value * (1 - fraction), value * (1 + fraction), row[kind[1:] or "mean"],
                        held_out=line != "EL1" or kind == "_max",
                    )
                )  # fmt: skip
    except (KeyError, TypeError, ValueError) as error:
        raise RockfallError(f"{path}: is not a table of the paper: {error}") from error
    return sorted([*all_targets, *OTHERS], key=lambda target: target.held_out)


@dataclass(frozen=True)
class Score:
    """Statistics of sets on each slope, (slopes,), NaN if too few boulders pass; and, where known,
    their standard errors due to the uncertainty of the sets."""

    name: str
    numbers: dict[str, np.ndarray]
    of_sets: dict[str, float] | None = None

    def mean(self, name: str) -> float:
        return _quiet(np.nanmean, self.numbers[name])

    def error(self, name: str) -> float:
        """Standard error of the mean: one part from slopes and boulders, which decreases with more
        slopes, one from the sets."""
        values = self.numbers[name]
        count = np.isfinite(values).sum()
        if count < 2:
            return np.nan
        of_sets = self.of_sets[name] if self.of_sets else 0.0
        return float(np.sqrt(np.nanvar(values, ddof=1) / count + of_sets**2))

    def range(self, name: str) -> tuple[float, float]:
        """5 and 95 % quantiles of a statistic over the slopes."""
        low, high = _quiet(np.nanquantile, self.numbers[name], [0.05, 0.95])
        return float(low), float(high)


def _quiet(function: Callable, values: np.ndarray, *args, **options):
    """Apply a function to values; NaN without a warning if no value is finite."""
    if not np.isfinite(values).any():
        return np.full(np.shape(args[0]) if args else (), np.nan)
    return function(values, *args, **options)


def score(
    draws: Sequence[Sets], site: Site, slopes: int, advance: Callable[[int], None] = lambda _: None,
    **how,
) -> Score:  # fmt: skip
    """Statistics of sets on a number of slopes, each with its own boulders; several draws of the
    sets are used in turn. If a single set has standard errors, perturbed sets are run too. Raises a
    RockfallError without sets."""
    if not draws:
        raise RockfallError("no impact sets to score")
    generator = np.random.default_rng(FIRST_SEED)
    others = []
    if len(draws) == 1 and draws[0].error is not None:
        others = [draws[0].redrawn(generator) for _ in range(min(REDRAWN, slopes // 2))]
    all_runs, changed = [], []
    for k in range(slopes):
        seed = FIRST_SEED + k
        all_runs.append(_numbers(draws[k % len(draws)], site, seed, how))
        if others:
            changed.append(_numbers(others[k % len(others)], site, seed, how))
        advance(1)
    numbers = {name: np.array([run[name] for run in all_runs]) for name in all_runs[0]}
    of_sets = None
    if others:
        group = np.arange(slopes) % len(others)
        off = {name: [run[name] for run in changed] - numbers[name] for name in numbers}
        of_sets = {name: _between(values, group) for name, values in off.items()}
    elif len(draws) > 1:
        group = np.arange(slopes) % len(draws)
        of_sets = {name: _between(v - _quiet(np.nanmean, v), group) for name, v in numbers.items()}
    return Score(draws[0].name, numbers, of_sets)


def _between(off: np.ndarray, group: np.ndarray) -> float:
    """Standard deviation between the means of groups, without their Monte Carlo errors."""
    groups = [off[(group == k) & np.isfinite(off)] for k in np.unique(group)]
    groups = [group for group in groups if group.size]
    if not groups:
        return np.nan
    noise = [group.var(ddof=1) / group.size for group in groups if group.size > 1]
    square = np.mean([group.mean() ** 2 for group in groups]) - (np.mean(noise) if noise else 0)
    return float(np.sqrt(max(square, 0.0)))


def _numbers(sets: Sets, site: Site, seed: int, how: dict) -> dict[str, float]:
    """Statistics at the site, whose slope and boulders are generated from a seed, and neutral
    slopes of the sets."""
    numbers = site.numbers(sets, seed=seed, talus=Talus(seed), **how)
    return numbers | neutral_slopes(sets, seed)


def neutral_slopes(sets: Sets, seed: int = 1) -> dict[str, float]:
    """Neutral slope of each ratio, and its maximum increase between ratios [degrees]."""
    slopes = [
        neutral_slope(set_rebound(mean, covariance), SLOPE_BOULDERS, seed)
        for mean, covariance in zip(sets.mean, sets.covariance, strict=True)
    ]
    return {f"neutral_{k}": slope for k, slope in enumerate(slopes, 1)} | {
        "neutral_rise": float(np.diff(slopes).max())
    }


def verdict(target: Target, value: float, error: float) -> str:
    """Verdict on a target: met, NOT, or undecided if the standard error straddles a limit."""
    if not np.isfinite(value):
        return "NOT"
    if min(abs(value - target.low), abs(value - target.high)) < error:
        return "undecided"
    return "met" if target.low < value < target.high else "NOT"


def table(scores: Iterable[Score], wanted: Sequence[Target]) -> str:
    """Scorecard as text."""
    scores = list(scores)
    width = max(26, *(len(score.name) + 2 for score in scores))
    lines = [
        f"{'':50}{'paper':>10}{'target':>15}"
        + "".join(f"{score.name:>{width}}" for score in scores)
    ]
    for held_out in (False, True):
        if held_out:
            lines += ["", "Held out of every calibration:"]
        for target in (goal for goal in wanted if goal.held_out == held_out):
            line = f"{target.label:50}{target.printed:>10}{_range(target):>15}"
            for score in scores:
                value, error = score.mean(target.name), score.error(target.name)
                text = f"{value:.2f} +- {error:.2f} {verdict(target, value, error):9}"
                line += f"{text:>{width}}"
            lines.append(line)
    lines.append("")
    for name, label in BESIDE.items():
        line = f"{label:75}"
        for score in scores:
            line += f"{f'{score.mean(name):.2f} +- {score.error(name):.2f}':>{width - 10}}{'':10}"
        lines.append(line)
    lines.append("")
    for score in scores:
        verdicts = [
            verdict(t, score.mean(t.name), score.error(t.name)) for t in wanted if not t.held_out
        ]
        count = {word: verdicts.count(word) for word in ("met", "undecided")}
        lines.append(
            f"{score.name}: {count['met']} of {len(verdicts)} met, {count['undecided']} undecided"
        )
    return "\n".join(line.rstrip() for line in lines)


def by_ratio(sets: Sets) -> str:
    """R_t and R_n of each ratio, without spin: mean +- standard deviation over admissible draws."""
    angles = 10.0, 15.0, 22.5, 30.0, 90.0
    lines = [f"{sets.name}: R_t | R_n at incidence angles, no spin, mean +- deviation"]
    lines.append("  R_b/R_m" + "".join(f"{angle:>32g}" for angle in angles))
    for k in range(5):
        cells = []
        for angle in angles:
            r_t, r_n = restitution(sets.mean[k], sets.covariance[k], angle)
            left = "-" if angle == 90 else f"{r_t.mean():.2f} +- {r_t.std():.2f}"
            cells.append(f"{f'{left} | {r_n.mean():.2f} +- {r_n.std():.2f}':>32}")
        lines.append(f"  {k + 1:7d}" + "".join(cells))
    return "\n".join(lines)


def _range(target: Target) -> str:
    if target.high == INF:
        return f"> {target.low:g}"
    if target.low == -INF:
        return f"< {target.high:g}"
    return f"{target.low:.3g} to {target.high:.3g}"
