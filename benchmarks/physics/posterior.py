# SPDX-License-Identifier: BSD-3-Clause
"""What several kinds of evidence leave open of a ground of the laboratory of blocks, by likelihood
(docs/validation/field/protocol.md, eighth calibration):

    python -m benchmarks.physics.posterior meadow FIELD TABLES --without limit "far run-outs"
    python -m benchmarks.physics.posterior talus FIELD TABLES --without contacts

FIELD is a folder with tschamut2014/ and chant_sura_esurf2019/ (rockfall.field downloads them); what
was made and measured at each point is kept in TABLES, and not made again. Prints, for each kind of
evidence alone, all, and all but each, the mean and deviation of each value of the ground and the
most probable point; then what each point gives, and the points of the ensemble.
"""

import argparse
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd

import rockfall
from benchmarks.lab.rocky import wyllie
from benchmarks.machine import machine
from benchmarks.physics.impacts import by_table
from benchmarks.physics.laws import Law, table
from benchmarks.physics.observed import CASES, measure
from benchmarks.physics.pasture import make
from benchmarks.physics.runaway import SLOPES, beyond
from benchmarks.physics.tschamut import described, observed, simulated, terrain
from rockfall.grounds.impact_tables import FIELDS, open_table
from rockfall.io.tables import read_table
from rockfall.lab.blocks.shapes import SHAPES

POINTS = {  # of each ground, for blocks of its fitted_radius, near that of the evidence
    "meadow": {"relief": [9.2, 10.9, 12.6, 14.4, 16.1], "yield_pressure": [5e5, 1e6, 2e6]},
    "talus": {
        "relief": [14.7, 16.6, 18.4, 20.3, 22.1], "yield_pressure": [1e5, 2e5, 3e5],
        "longest": [16, 32],
    },
}  # fmt: skip
THROWS, SEED, BOULDERS = 1000, 1, 100
ON_PLANES, ALLOWED, LIMIT_DEVIATION = 400, 0.05, 0.05
ON_SLOPES, SLOPE_SEEDS = 1000, range(500, 508)
MODEL_MEAN, MODEL_SPREAD, SPIN_DEVIATION = 0.1, 0.2, 0.15
BESIDE = "simulated"  # a kind that never decides
MEMBERS = 5


@dataclass(frozen=True)
class Evidence:
    """One kind: what was observed, its deviation, and what a point of the ground gives."""

    seen: dict[str, float]
    deviation: dict[str, float]
    given: Callable[[Law, Path], dict[str, float]]

    def log_likelihood(self, found: dict[str, float]) -> float:
        return -0.5 * sum(
            ((found[name] - seen) / self.deviation[name]) ** 2 for name, seen in self.seen.items()
        )


def with_model(seen: float, error: float, part: float) -> float:
    """The error of a sample and that of the model, together."""
    return float(np.hypot(error, part * seen))


NUMBERS = "mean", "std", "5 %", "50 %", "95 %"  # of run-outs


def run_outs(field: Path, names: Sequence[str] = NUMBERS) -> Evidence:
    """Numbers of the run-outs of the half of Tschamut that calibrates."""
    folder = field / "tschamut2014"
    runs, place = observed(folder, "calibration"), terrain(folder)
    out = np.array([np.hypot(*(run.rest - run.start)) for run in runs])

    def numbers(sample: np.ndarray) -> np.ndarray:
        return np.array([sample.mean(), sample.std(), *np.quantile(sample, [0.05, 0.5, 0.95])])

    again = np.random.default_rng(SEED).choice(out, (2000, len(out)))
    errors = np.array([numbers(one) for one in again]).std(axis=0)
    all_seen = dict(zip(NUMBERS, numbers(out).tolist(), strict=True))
    parts = [MODEL_SPREAD if name == "std" else MODEL_MEAN for name in NUMBERS]
    deviations = dict(zip(NUMBERS, map(with_model, all_seen.values(), errors, parts), strict=True))

    def given(law: Law, _: Path) -> dict[str, float]:
        found = described(runs, [simulated(run, law, place, BOULDERS, SEED) for run in runs])
        return {name: found[name] for name in names}

    return Evidence(*({name: of[name] for name in names} for of in (all_seen, deviations)), given)


def fast_impacts(field: Path) -> Evidence:
    """The mean energy left after six impacts."""
    (path,) = (field / "chant_sura_esurf2019").glob("*.csv")
    rows = list(read_table(path)[2])
    left = [row.number("published_energy_transition_ratio", 0, 10) for row in rows]
    seen = float(np.mean(left))
    deviation = float(np.hypot(np.std(left) / np.sqrt(len(left)), SPIN_DEVIATION))
    return Evidence(
        {"energy left": seen},
        {"energy left": deviation},
        lambda law, _: {"energy left": float(np.mean([by_table(row, law) for row in rows]))},
    )


def at_line(method: str) -> Evidence:
    """Means and deviations at EL1: observed, or the means that the paper simulated."""
    printed = pd.read_csv(CASES / "paper.csv").set_index(["line", "method", "quantity"])
    seen, deviation = {}, {}
    for quantity in ("speed", "passing_height", "energy_translational"):
        row = printed.loc[("EL1", method, quantity)]
        seen[f"{quantity} mean"] = float(row["mean"])
        deviation[f"{quantity} mean"] = with_model(row["mean"], row["std"] / 10, MODEL_MEAN)
        if method == "observed":
            seen[f"{quantity} std"] = float(row["std"])
            error = row["std"] / np.sqrt(2 * 99)
            deviation[f"{quantity} std"] = with_model(row["std"], error, MODEL_SPREAD)

    def given(law: Law, _: Path) -> dict[str, float]:
        case = rockfall.read_case(CASES / "case.nml").replace(**law.of("compact"))
        runs = [measure(case, seed, ON_SLOPES) for seed in SLOPE_SEEDS]
        mean = sum(runs[1:], runs[0]) / len(runs)
        return {
            f"{quantity} {number}": float(mean.loc[("EL1", quantity), number])
            for quantity in ("speed", "passing_height", "energy_translational")
            for number in ("mean", "std")
        }

    return Evidence(seen, deviation, given)


def contacts(_: Path) -> Evidence:
    """What contacts from a flight do on rocky slopes."""
    seen = {"R_n/Wyllie": 1.0, "R_n(90)": 0.4, "R_t": 0.7, "rotation": 0.07, "straight": 0.72}
    deviation = {name: MODEL_SPREAD * value for name, value in seen.items()}
    return Evidence(seen, deviation, lambda _, path: of_contacts(path))


def of_contacts(path: Path) -> dict[str, float]:
    """The same of the records of a table that begin with a flight."""
    one = open_table(str(path))
    flights = int(one.first[np.prod(one.bins["flight"])])
    r = dict(zip(FIELDS, one.record[:flights].astype(float).T, strict=True))
    angle = np.degrees(np.arctan2(-r["vn_in"], r["vt_in"]))
    r_n = np.maximum(r["vn_out"], 0) / -r["vn_in"]
    steep = (angle >= 30) & (angle < 60)
    slanting = angle < 60
    flies = r["exit"] == 0
    moving = (r["along_out"] ** 2 + r["across_out"] ** 2 + r["vn_out"] ** 2)[flies].sum()
    turning = one.inertia * (r["w_out"] ** 2)[flies].sum()
    turn = np.degrees(np.abs(np.arctan2(r["across_out"], r["along_out"])))[flies]
    return {
        "R_n/Wyllie": float(np.mean(r_n[steep] / wyllie(angle[steep]))),
        "R_n(90)": float(r_n[angle >= 80].mean()),
        "R_t": float((r["along_out"][slanting] / r["vt_in"][slanting]).mean()),
        "rotation": float(turning / (turning + moving)),
        "straight": float(np.mean(turn < 22.5)),
    }


def limit(_: Path) -> Evidence:
    """Boulders beyond the speeds that have been observed, on planes."""

    def given(law: Law, _: Path) -> dict[str, float]:
        parts = [beyond(law, slope, ON_PLANES)[0] for slope in SLOPES]
        return {"beyond": max(0.0, float(np.mean(parts)) - ALLOWED)}

    return Evidence({"beyond": 0.0}, {"beyond": LIMIT_DEVIATION}, given)


KINDS: dict[str, dict[str, Callable[[Path], Evidence]]] = {
    "meadow": {
        "run-outs": lambda field: run_outs(field, ("mean", "5 %", "50 %")),
        "far run-outs": lambda field: run_outs(field, ("std", "95 %")),  # on a plane that was added
        "impacts": fast_impacts, "limit": limit,
    },
    "talus": {
        "line EL1": lambda _: at_line("observed"), "contacts": contacts, "limit": limit,
        BESIDE: lambda _: at_line("B"),
    },
}  # fmt: skip


def points(grid: dict[str, list[float]]) -> Iterator[dict[str, float]]:
    for values in product(*grid.values()):
        yield dict(zip(grid, values, strict=True))


def name_of(ground: str, point: dict[str, float]) -> str:
    return "-".join([ground, *(f"{key[0]}{value:g}" for key, value in point.items())])


def measured(
    ground: str, point: dict[str, float], kinds: dict[str, Evidence], folder: Path
) -> dict[str, dict[str, float]]:
    """What a point gives, by kind; kept."""
    name = name_of(ground, point)
    kept = folder / f"{name}.json"
    if kept.exists():
        return json.loads(kept.read_text())
    for shape in SHAPES if ground == "meadow" else ("compact",):
        make(folder / f"{name}-{shape}.nc", ground, shape, point, THROWS)
    law = table(f"{name}={folder.resolve() / name}-{{shape}}.nc")
    found = {kind: one.given(law, folder / f"{name}-compact.nc") for kind, one in kinds.items()}
    kept.write_text(json.dumps(found))
    return found


def posterior(log_likelihood: np.ndarray) -> np.ndarray:
    weight = np.exp(log_likelihood - log_likelihood.max())
    return weight / weight.sum()


def members(weight: np.ndarray, n: int) -> np.ndarray:
    """Places drawn by systematic resampling: the middles of n equal parts."""
    return np.searchsorted(np.cumsum(weight), (np.arange(n) + 0.5) / n)


def combinations(kinds: list[str]) -> dict[str, list[str]]:
    """Kinds that are weighed together, by what that is called."""
    deciding = [kind for kind in kinds if kind != BESIDE]
    found = {f"{kind} alone": [kind] for kind in kinds} | {"all": deciding}
    for kind in deciding:
        found[f"all but {kind}"] = [one for one in deciding if one != kind]
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("ground", choices=POINTS)
    parser.add_argument("field", type=Path)
    parser.add_argument("tables", type=Path)
    parser.add_argument("--without", nargs="*", default=[], help="kinds that do not decide")
    given = parser.parse_args()
    given.tables.mkdir(exist_ok=True)
    kinds = {name: kind(given.field) for name, kind in KINDS[given.ground].items()}
    print(machine())
    grid = POINTS[given.ground]
    places = list(points(grid))
    found = [measured(given.ground, one, kinds, given.tables) for one in places]
    score = {
        kind: np.array([evidence.log_likelihood(one[kind]) for one in found])
        for kind, evidence in kinds.items()
    }
    values = {key: np.array([one[key] for one in places]) for key in grid}
    print("| evidence | " + " | ".join(values) + " | most probable | -2 log L there |")
    print("|---" * (3 + len(values)) + "|")
    deciding = [kind for kind in kinds if kind not in given.without]
    for title, together in combinations(deciding).items():
        total = sum(score[kind] for kind in together)
        weight = posterior(total)
        cells = [
            f"{(m := float(weight @ v)):.3g} ± {np.sqrt(weight @ (v - m) ** 2):.2g}"
            for v in values.values()
        ]
        best = int(np.argmax(weight))
        print(f"| {title} | " + " | ".join(cells), end=" | ")
        print(f"{name_of(given.ground, places[best])} | {-2 * total[best]:.1f} |")
    weight = posterior(sum(score[kind] for kind in deciding if kind != BESIDE))
    names = [(kind, name) for kind, one in kinds.items() for name in one.seen]
    print("\n| point | weight | " + " | ".join(name for _, name in names) + " |")
    print("|---" * (2 + len(names)) + "|")
    print("| observed | | " + " | ".join(f"{kinds[k].seen[n]:.3g}" for k, n in names) + " |")
    for one, part, numbers in zip(places, weight, found, strict=True):
        cells = [f"{numbers[kind][name]:.3g}" for kind, name in names]
        print(f"| {name_of(given.ground, one)} | {part:.3f} | " + " | ".join(cells) + " |")
    print("\nensemble:", *(name_of(given.ground, places[k]) for k in members(weight, MEMBERS)))


if __name__ == "__main__":
    main()
