# SPDX-License-Identifier: BSD-3-Clause
"""Infer impact sets of the paper's form from its printed results.

    python cases/vaujany/infer.py bourrier2009 [--iterations 8] [--members 24] [-o FOLDER]
    python cases/vaujany/infer.py vaujany-observed ...
    python cases/vaujany/infer.py bourrier2009 --judge laboratory-spheres bourrier2009

`bourrier2009` is fitted to what Bourrier et al. (2009) simulated by methods A and B (`ratio =
'nearest'`, Rg read as a radius), `vaujany-observed` to the 100 boulders that they observed (method
B, `ratio = 'between'`). Neither has the authors' coefficients, which are unpublished. Writes
NAME.nml and NAME-ensemble.nml, with score, tolerances and judgement in the header. `--judge` fits
nothing: it prints the numbers of NAME by shipped sets, judged by point 3, and the number of targets
met.

The protocol, chosen before any run: 1. Form: 26 numbers (`Form`). Means are linear in R_b/R_m, the
scatter is geometric in it. 2. Data: `items`, each with a tolerance: of Table 2, 10 % of a mean, 20
% of a deviation, 25 % of a simulated maximum (15 % of the observed one, a mean maximum of hundreds
of boulders). A residual is the error over its tolerance; the score is the sum of squares of the
residuals. Simulated maxima are too noisy to be fitted: they are judged only. `vaujany-observed`
must also reproduce the decrease of neutral slopes with boulder size on screes (Statham 1976, quoted
by Dorren 2003): tan(slope) = c + k R_m/R_b with k = 0.17 to 0.26, taken between R_b/R_m = 2 and 5.
The rebounds at Vaujany hardly tell the smaller ratios: by a first fit without this, neutral slopes
rose by 2 degrees from 1 to 5, and large boulders went less far. 3. Slopes: reliefs of 0.15 to 0.5 m
and mean slopes of 37 to 39 degrees, 12 at a time in a Latin square. The fit uses seeds below 1000,
others in each iteration; the judgement 24 slopes from seed 1000, with 4,000 boulders each. 4.
Search: 96 sets around the present one, a linear model of the residuals by ridge regression, steps
by Levenberg-Marquardt with four damping factors; of these and the present set the best on fresh
slopes. The neighbourhood shrinks by 0.8 an iteration. Two starting points. 5. Ensemble: draws from
the normal approximation of the linear model within the prior of `PRIOR`, kept by importance on
fresh slopes; a quarter of them from the second optimum, if its score is within 4 of the first. Then
every member's a1 is shifted by a normal number with deviation 0.01: one degree of the unpublished
terrain. 6. `speed_range` and `angle_range` are the 0.5 and 99.5 % quantiles of the rebounds by
method B over the judged slopes, 200 boulders each.
"""

from __future__ import annotations

import argparse
import os
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pandas as pd

from rockfall.analysis.planes.plane_bounce import neutral_slope, set_rebound
from rockfall.result.crossings import at_lines
from rockfall.result.motion import motion_of
from rockfall.scene.rebounds.sets import Sets, read_sets, restitution
from rockfall_lab.scorecard.site import QUANTITIES, TANGENTIAL, Site, tangential_above
from rockfall_lab.scorecard.vaujany_slope import Talus
from rockfall_lab.sets.fit import ImpactSet
from rockfall_lab.sets.setfile import write_sets

HERE = Path(__file__).parent
RATIOS = np.arange(1, 6)
RISING = 0, 3, 4, 6  # elements of A that change with R_b/R_m
MEANS, CHANGES, SCATTER, RHO, GROWTH = (
    slice(0, 9), slice(9, 13), slice(13, 22), slice(22, 25), slice(25, 26),
)  # fmt: skip
#: Standard deviations of the first neighbourhood, in which boulders pass, and of the prior.
STEP = np.concatenate(([0.008] * 6 + [0.03] * 3, [0.008] * 4, [0.08] * 9, [0.08] * 3, [0.03]))
PRIOR = np.concatenate(([0.05] * 6 + [0.15] * 3, [0.05] * 4, [0.3] * 9, [0.3] * 3, [0.15]))
FREE = len(STEP)
AROUND, RIDGE, SHRINK, DAMPING = 96, 4.0, 0.8, (0.1, 0.5, 2.0, 8.0)
SLOPES, FIT_BOULDERS, JUDGED_SLOPES, JUDGED_BOULDERS, JUDGED_SEED = 12, 300, 24, 4000, 1000
AT_ONCE = 100  # number of boulders in the experiment
SHIFT = 0.01  # standard deviation of the shift of a1 in the ensemble
SECOND_WITHIN = 4.0  # maximum score of the second optimum above the first
RANGED_BOULDERS, OUTER = 200, (0.005, 0.995)
HOW = {
    "bourrier2009": {"methods": "AB", "ratio": "nearest", "reading": "radius"},
    "vaujany-observed": {"methods": "B", "ratio": "between", "reading": "radius"},
}
WITHIN = {"mean": 0.10, "std": 0.20, "max": 0.25}


@dataclass(frozen=True)
class Form:
    """The 26 parameters: means at R_b/R_m = 5; changes of a1, a4, a5, a7 from there to 1;
    logarithms of the deviations at 5 (rows t, n, W; columns V_t, V_n, W); atanh of the correlations
    tn, tW, nW within a column; logarithm of the factor of the deviations from 5 to 1."""

    numbers: np.ndarray

    def sets(self, name: str) -> Sets:
        toward_one = (5 - RATIOS) / 4
        mean = np.tile(self.numbers[MEANS], (5, 1))
        mean[:, RISING] += toward_one[:, None] * self.numbers[CHANGES]
        tn, tw, nw = np.tanh(self.numbers[RHO])
        rows = np.array([[1, tn, tw], [tn, 1, nw], [tw, nw, 1]])
        rows = nearest_correlation(rows)
        deviation = np.exp(self.numbers[SCATTER]).reshape(3, 3)
        covariance = np.zeros((9, 9))
        for column in range(3):
            at = 3 * np.arange(3) + column
            covariance[np.ix_(at, at)] = rows * np.outer(deviation[:, column], deviation[:, column])
        growth = np.exp(2 * toward_one * self.numbers[GROWTH])
        return Sets(name, mean, growth[:, None, None] * covariance)


def nearest_correlation(rows: np.ndarray) -> np.ndarray:
    """Clip eigenvalues at 0.01 and scale the diagonal to one."""
    values, vectors = np.linalg.eigh(rows)
    if values.min() >= 0.01:
        return rows
    clipped = (vectors * np.maximum(values, 0.01)) @ vectors.T
    scale = 1 / np.sqrt(np.diag(clipped))
    return clipped * np.outer(scale, scale)


#: Starting points: sets found by hand with another simulator, and the same sets with other spins.
START = {
    "bourrier2009": np.concatenate((
        [0.7037, 0.0847, 0.1279, 0.1473, -0.4109, -0.1428, 0.1848, 0.0385, 0.3392],
        [0.0151, -0.0161, 0.0226, -0.0450],
        np.log([0.0653, 0.0797, 0.0485, 0.0326, 0.0397, 0.0242, 0.3168, 0.2865, 0.2671]),
        np.arctanh([-0.473, 0.693, -0.313]), np.log([1.140]),
    )),
    "vaujany-observed": np.concatenate((
        [0.7313, 0.1144, 0.1487, 0.1446, -0.3935, -0.1814, 0.1694, -0.0152, 0.3871],
        [0.0042, -0.0077, 0.0093, -0.0382],
        np.log([0.0645, 0.0813, 0.0403, 0.0440, 0.0555, 0.0275, 0.3456, 0.2552, 0.2611]),
        np.arctanh([-0.520, 0.565, -0.412]), np.log([1.170]),
    )),
}  # fmt: skip
ELSEWHERE = np.zeros(26)
ELSEWHERE[[1, 6, 7]] = 0.08, 0.12, 0.20  # a2, a7, a8 of the second starting point


@dataclass(frozen=True)
class Item:
    """Published value with its tolerance, or a bound: `side` is +1 (at least) or -1 (at most)."""

    name: str
    value: float
    tolerance: float
    side: int = 0
    fitted: bool = True

    def residual(self, number: float) -> float:
        off = (number - self.value) / self.tolerance
        if self.side:
            off = min(0.0, off) if self.side > 0 else max(0.0, off)
        return float(np.clip(off, -10, 10)) if np.isfinite(off) else 10.0


def items(name: str) -> list[Item]:
    """Values published in the paper for a set, with tolerances."""
    observed = name == "vaujany-observed"
    printed = pd.read_csv(HERE / "paper.csv").set_index(["line", "method", "quantity"])
    methods = ["observed"] if observed else ["A", "B"]
    found = []
    for method in methods:
        for line in "EL1", "EL2":
            for quantity in QUANTITIES:
                for kind, part in WITHIN.items():
                    value = float(printed.loc[(line, method, quantity), kind])
                    part = 0.15 if observed and kind == "max" else part
                    run = "B" if observed else method
                    label = f"{run}_{line}_{quantity}_{kind}"
                    found.append(Item(label, value, part * value, fitted=observed or kind != "max"))
    for line, mean, std in ("EL1", 0.06, 0.07), ("EL2", 0.08, 0.08):
        found.append(Item(f"B_{line}_rotation_mean", mean, 0.02))
        found.append(Item(f"B_{line}_rotation_std", std, 0.03))
    found += [Item(f"rn_90_{k}", 0.4, 0.05) for k in RATIOS]
    found += [Item(f"rn_10_{k}", 1.0, 0.05, side=1) for k in RATIOS]
    found += [
        Item("rt", 0.7, 0.05), Item("tangential", 0.93, 0.03),
        Item("below_50", 0.95, 0.02, side=1), Item("redrawn", 0.10, 0.02, side=-1),
    ]  # fmt: skip
    if observed:
        found.append(Item("scree_k", 0.215, 0.045))
    else:
        found += [Item("b_less_a_EL1", 1.2, 0.3), Item("b_less_a_EL2", 1.2, 0.3)]
    return found


def slopes(seed: int, count: int) -> list[Talus]:
    """Generated slopes: reliefs and mean slopes in a Latin square."""
    generator = np.random.Generator(np.random.PCG64(seed))
    middle = (np.arange(count) + 0.5) / count
    relief = 0.15 + 0.35 * middle
    angle = 37 + 2 * generator.permutation(middle)
    return [Talus(seed + k, relief=relief[k], angle=angle[k]) for k in range(count)]


def numbers(sets: Sets, name: str, on: list[Talus], boulders: int) -> dict[str, float]:
    """All statistics of sets: means over slopes, and values derived from the matrices."""
    observed = name == "vaujany-observed"
    site = Site(HERE, boulders, trajectories=0)
    rows = []
    for talus in on:
        results = site.run(sets, seed=talus.seed, talus=talus, threads=1, **HOW[name])
        row = over_rebounds(results["B"])
        for method, result in results.items():
            row |= numbers_at_lines(method, result, observed)
        if not observed:
            for line in "EL1", "EL2":
                b, a = (row.get(f"{method}_{line}_speed_mean", np.nan) for method in "BA")
                row[f"b_less_a_{line}"] = b - a
        rows.append(row)
    mean = pd.DataFrame(rows).mean().to_dict()
    for k in RATIOS:
        at = sets.mean[k - 1], sets.covariance[k - 1]
        mean[f"rn_90_{k}"] = float(restitution(*at, 90.0)[1].mean())
        mean[f"rn_10_{k}"] = float(restitution(*at, 10.0)[1].mean())
    if observed:
        two, five = (
            np.tan(np.radians(neutral_slope(set_rebound(sets.mean[k], sets.covariance[k]))))
            for k in (1, 4)
        )
        mean["scree_k"] = float(two - five) / (1 / 2 - 1 / 5)
    return mean


def numbers_at_lines(method: str, result, in_hundreds: bool) -> dict[str, float]:
    """Statistics at the lines by a method, for lines that at least `AT_ONCE` boulders pass."""
    found = {}
    for line in "EL1", "EL2":
        at = at_lines(result).sel(line=line)
        passed = at["line_speed"].notnull().values
        found[f"{method}_{line}_passing"] = float(passed.mean())
        if passed.sum() < AT_ONCE:
            continue
        for quantity, (variable, scale) in QUANTITIES.items():
            values = at[variable].values[passed] * scale
            largest = values.max()
            if in_hundreds:
                hundreds = values[: values.size // AT_ONCE * AT_ONCE].reshape(-1, AT_ONCE)
                largest = hundreds.max(axis=1).mean()
            kinds = {"mean": values.mean(), "std": values.std(ddof=1), "max": largest}
            found |= {f"{method}_{line}_{quantity}_{kind}": float(v) for kind, v in kinds.items()}
        rotation = at["line_energy_rotational"].values[passed]
        fraction = rotation / (rotation + at["line_energy_translational"].values[passed])
        found[f"{method}_{line}_rotation_mean"] = float(fraction.mean())
        found[f"{method}_{line}_rotation_std"] = float(fraction.std(ddof=1))
    return found


def over_rebounds(result) -> dict[str, float]:
    return {
        "rt": histogram_median(result, "restitution_tangential"),
        "tangential": tangential_above(result, TANGENTIAL),
        "below_50": histogram_below(result, "incidence_angle", 50.0),
        "redrawn": float(result["rebounds_redrawn"].sum() / result["rebounds"].sum()),
    }


def cumulative(result, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Upper ends of the bins, and the fraction below each end."""
    count = result[f"{name}_histogram"].values.astype(float)
    return result[f"{name}_bin_bounds"].values[:, 1], count.cumsum() / count.sum()


def histogram_below(result, name: str, limit: float) -> float:
    ends, below = cumulative(result, name)
    return float(np.interp(limit, ends, below))


def histogram_median(result, name: str) -> float:
    ends, below = cumulative(result, name)
    finite = np.isfinite(ends)
    return float(np.interp(0.5, below[finite], ends[finite]))


class Search:
    """Levenberg-Marquardt steps on local linear models of the program's results."""

    def __init__(self, name: str, pool: ProcessPoolExecutor, start: np.ndarray, seed: int) -> None:
        self.name, self.pool, self.best, self.score = name, pool, start, np.inf
        self.wanted = [item for item in items(name) if item.fitted]
        self.seed = seed  # seed of the slopes and neighbourhoods
        self.generator = np.random.Generator(np.random.PCG64(seed))
        self.step = STEP.copy()

    def residuals(self, points: list[np.ndarray]) -> np.ndarray:
        """Residuals (points, items), all on the same new slopes."""
        on = slopes(self.seed, SLOPES)
        self.seed += SLOPES
        function = partial(residuals_at, name=self.name, wanted=self.wanted, on=on)
        return np.array(list(self.pool.map(function, points)))

    def iterate(self) -> None:
        off = self.generator.standard_normal((AROUND, FREE))
        values = self.residuals(list(self.best + self.step * off))
        # ridge: without it, noise of the boulders in 27 unknowns enters the step
        design = np.column_stack((np.ones(AROUND), off))
        ridge = np.diag([0.0] + [RIDGE] * FREE)
        constant, *slope = np.linalg.solve(design.T @ design + ridge, design.T @ values)
        self.slope = np.array(slope)  # slopes of the residuals, for each step
        moves = [
            -np.linalg.solve(
                self.slope @ self.slope.T + damping * np.eye(FREE), self.slope @ constant
            )
            for damping in DAMPING
        ]
        candidates = [self.best, *(self.best + self.step * np.clip(move, -2, 2) for move in moves)]
        scores = (self.residuals(candidates) ** 2).sum(axis=1)
        self.best, self.score = candidates[int(scores.argmin())], float(scores.min())
        self.scale = self.step.copy()
        self.step = SHRINK * self.step

    def members(self, count: int) -> np.ndarray:
        """Draws from the normal approximation at the optimum, kept by importance on new slopes."""
        precision = self.slope @ self.slope.T / np.outer(self.scale, self.scale)
        covariance = np.linalg.inv(precision + np.diag(PRIOR**-2.0))
        tried = self.generator.multivariate_normal(self.best, covariance, 4 * count, method="eigh")
        scores = (self.residuals(list(tried)) ** 2).sum(axis=1)
        weights = np.exp(-(scores - scores.min()) / 2)
        # temper: scores are noisy, and a single point would take all the weight
        for power in np.linspace(1, 0, 101):
            chance = weights**power / (weights**power).sum()
            if 1 / (chance**2).sum() >= 2 * count:
                break
        return tried[self.generator.choice(4 * count, count, replace=False, p=chance)]


def residuals_at(point: np.ndarray, name: str, wanted: list[Item], on: list[Talus]) -> np.ndarray:
    found = numbers(Form(point).sets(name), name, on, FIT_BOULDERS)
    return np.array([item.residual(found.get(item.name, np.nan)) for item in wanted])


def judged(
    sets: Sets, name: str, pool: ProcessPoolExecutor, boulders: int = JUDGED_BOULDERS
) -> pd.DataFrame:
    """Statistics on each slope not used by any fit."""
    function = partial(numbers, sets, name, boulders=boulders)
    return pd.DataFrame(
        list(pool.map(function, [[one] for one in slopes(JUDGED_SEED, JUDGED_SLOPES)]))
    )


def ranges(sets: Sets, name: str) -> dict[str, tuple[float, float]]:
    """Incident speeds [m/s] and angles [degree] of the rebounds on the judged slopes."""
    site = Site(HERE, RANGED_BOULDERS, trajectories=RANGED_BOULDERS)
    speeds, angles = [], 0.0
    for talus in slopes(JUDGED_SEED, JUDGED_SLOPES):
        how = HOW[name] | {"seed": talus.seed, "talus": talus, "threads": 1, "methods": "B"}
        result = site.run(sets, **how)["B"]
        motion = motion_of(result)
        speeds.append(motion.take(motion.gravity > 0).at(1.0)[1])
        ends, below = cumulative(result, "incidence_angle")
        angles = angles + np.interp(OUTER, below, ends) / JUDGED_SLOPES
    low, high = np.quantile(np.concatenate(speeds), OUTER)
    return {
        "speed_range": (round(float(low), 2), round(float(high), 1)),
        "angle_range": (round(float(angles[0]), 1), round(float(angles[1]), 1)),
    }


def infer(name: str, iterations: int, members: int, pool: ProcessPoolExecutor) -> Inference:
    searches = []
    for start, seed in (START[name], 1), (START[name] + ELSEWHERE, 501):
        search = Search(name, pool, start, seed)
        for k in range(iterations):
            search.iterate()
            print(f"{name}, start {seed}, iteration {k + 1}: score {search.score:.1f}", flush=True)
        searches.append(search)
    first, second = sorted(searches, key=lambda search: search.score)
    close = second.score - first.score < SECOND_WITHIN
    drawn = first.members(members - members // 4 * close)
    if close:
        drawn = np.concatenate((drawn, second.members(members // 4)))
    drawn[:, 0] += SHIFT * first.generator.standard_normal(members)
    sets = Form(first.best).sets(name)
    return Inference(
        name, first.best, first.score, second.score, drawn, judged(sets, name, pool),
        ranges(sets, name),
    )  # fmt: skip


@dataclass(frozen=True)
class Inference:
    """Optimum and its score, score of the second optimum, members (n, 26), judgement by slopes, and
    keys of the ranges of speed and angle."""

    name: str
    best: np.ndarray
    score: float
    second: float
    members: np.ndarray
    slopes: pd.DataFrame
    ranges: dict[str, tuple[float, float]]

    def header(self) -> list[str]:
        """Comments of a set file: the fitted values, the quality of the fit, and comparisons."""
        wanted = items(self.name)
        mean, error = self.slopes.mean(), self.slopes.std() / np.sqrt(len(self.slopes))
        off = {item.name: item.residual(mean[item.name]) for item in wanted}
        met = sum(abs(one) <= 1 for one in off.values())
        lines = [
            f"{self.name}: inferred by cases/vaujany/infer.py from Bourrier et al. (2009).",
            "Not the authors' coefficients, which are unpublished.",
            f"Score of the fit {self.score:.1f}; of the second optimum {self.second:.1f}.",
            f"On {len(self.slopes)} slopes that no fit used, {met} of {len(wanted)} numbers are"
            " within their tolerance:",
        ]
        for item in wanted:
            bound = {0: "", 1: " at least", -1: " at most"}[item.side]
            reached = f"{mean[item.name]:.4g}"
            if error[item.name] > 1e-9:  # values derived from the matrices alone have no error
                reached += f" +- {error[item.name]:.2g}"
            missed = "" if abs(off[item.name]) <= 1 else " NOT MET"
            lines.append(
                f"  {item.name}:{bound} {item.value:.4g} +- {item.tolerance:.2g}, {reached}{missed}"
            )
        return lines


def as_file(point: np.ndarray, found: Inference) -> dict[int, ImpactSet]:
    sets = Form(point).sets(found.name)
    nothing = np.zeros(9), np.zeros((9, 9)), 0, 0.0
    pairs = zip(sets.mean, sets.covariance, strict=True)
    return {
        k: ImpactSet(mean, covariance, *nothing, **found.ranges)
        for k, (mean, covariance) in enumerate(pairs, 1)
    }


def judgement(name: str, means: dict[str, pd.Series]) -> str:
    """Markdown table of the statistics of `name` by sets, with values beyond their tolerance in
    bold."""
    wanted, sign = items(name), {0: "", 1: ">= ", -1: "<= "}
    off = {
        item.name: [abs(item.residual(mean[item.name])) > 1 for mean in means.values()]
        for item in wanted
    }
    met = [
        f"{len(wanted) - sum(beyond)} of {len(wanted)}"
        for beyond in zip(*off.values(), strict=True)
    ]
    rows = [["", "printed", *means], ["---"] * (2 + len(means)), ["met", "", *met]]
    for item in wanted:
        values = [f"{mean[item.name]:.4g}" for mean in means.values()]
        marked = [
            f"**{value}**" if beyond else value
            for value, beyond in zip(values, off[item.name], strict=True)
        ]
        rows.append(
            [item.name, f"{sign[item.side]}{item.value:.4g} ± {item.tolerance:.2g}", *marked]
        )
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("name", choices=START)
    parser.add_argument("--iterations", type=int, default=8)
    parser.add_argument("--members", type=int, default=24)
    parser.add_argument(
        "--judge", nargs="+", metavar="SET", help="shipped sets: judge, fit nothing"
    )
    parser.add_argument("--boulders", type=int, default=JUDGED_BOULDERS, help="on a judged slope")
    parser.add_argument("-o", "--output", type=Path, default=Path())
    given = parser.parse_args()
    with ProcessPoolExecutor(os.cpu_count(), mp_context=get_context("spawn")) as pool:
        if given.judge:
            of_sets = {one: read_sets(one)[0] for one in given.judge}
            means = {
                one: judged(sets, given.name, pool, given.boulders).mean()
                for one, sets in of_sets.items()
            }
            print(judgement(given.name, means))
            return
        found = infer(given.name, given.iterations, given.members, pool)
    header = found.header()
    write_sets(given.output / f"{given.name}.nml", as_file(found.best, found), header)
    first, *more = (as_file(point, found) for point in found.members)
    head = [
        f"{given.members} members of {given.name}, equally likely: what the fit leaves open.",
        *header[:3],
    ]
    write_sets(given.output / f"{given.name}-ensemble.nml", first, head, *more)


if __name__ == "__main__":
    main()
