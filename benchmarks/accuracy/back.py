# SPDX-License-Identifier: BSD-3-Clause
"""Calibration of the back-analysis posterior with synthetic truths.

    python -m benchmarks.accuracy.back truths.csv [--truths 30] [--members 512] [--boulders 150]

Truths (rock size, volume factor, shift of the source) are drawn from the prior on two terrains that
flatten out, a bumpy slope and a channel. For each truth, the observations of `observed` boulders
are one of: stopping places and speeds at a line; speeds and heights there; published means and
standard deviations; fractions beyond distances. For a correct posterior the 5-95 % range contains
the truth in 90 % of the cases, and the posterior fraction below the truth is uniform (Talts et al.
2018). Truths in the file are not run again. --stretch 1.6 multiplies stopping distances, to count
how often the analysis reports that the model does not explain the data.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

import rockfall
from benchmarks.accuracy.truths import all_truths, parser_of
from rockfall.analysis.observed.observations import Observed, read_observed
from rockfall.io.rasters.grid import Grid
from rockfall.result.crossings import line_values
from rockfall.scene.read import read_scene
from rockfall.simulation.simulate import run_scene
from rockfall.studies.back.posterior import parameters, posterior_table, warnings
from rockfall.studies.back.study import back_analysis
from rockfall.studies.ensemble.uncertain_inputs import Uncertain, drawn_scene

NY, NX, CELL = 80, 60, 5.0
START = np.array([150.0, 380.0])
PLACES = ("slope", "channel")
KINDS = ("stops, speeds", "speeds, heights", "printed", "fractions")
SEED = 20_000  # seed of truths; their boulders and those of analyses use other seeds


def terrain(name: str) -> np.ndarray:
    """Terrain that descends to the south: a bumpy slope of gradient 0.8 above one of 0.2, or a
    cliff, a talus and a flat with a channel."""
    random = np.random.default_rng(1)
    y, x = np.mgrid[NY - 1 : -1 : -1, 0:NX] * CELL
    rough = random.normal(0, 0.2, x.shape)
    if name == "slope":
        bumps = 2 * np.sin(x / 25) + 2 * np.sin(y / 20)
        return 1000 + np.interp(y, [0, 150, 400], [0, 30, 230]) + bumps + rough
    profile = np.interp(y, [0, 120, 300, 400], [0, 12, 140, 260])
    return 800 + profile + 6 * np.tanh((x - 150) / 40) ** 2 + rough


def case_of(folder: Path, boulders: int, seed: int) -> rockfall.Case:
    return rockfall.Case(
        folder=folder,
        case={"boulders": boulders, "seed": seed, "threads": 1},
        surface={"uniform_mean_radius": 0.2},
        impact={"sets": "vaujany-observed"},
        boulder={"volume": "normal", "volume_mean": 0.8, "volume_std": 0.15},
        release={"x": START[:1], "y": START[1:], "drop_height": 5.0},
        line=[{"name": "L", "x": [0.0, 300.0], "y": [300.0, 300.0]}],
        ensemble={"radius_factor": 2.0, "volume_factor": 1.3, "source_shift": 5.0},
    )


def observe(
    inputs: Uncertain, k: int, stream: tuple[int, ...], stretch: float
) -> tuple[Observed, dict[str, float]]:
    """Observations from a run with drawn parameters, and these parameters by name."""
    point = np.random.default_rng(stream).random(inputs.ends[-1])
    draws = [inputs.at(name, point, k) for name in inputs.names]
    result = run_scene(drawn_scene(inputs.scene, draws, inputs.boulders_seed(k)))
    seen, kind = replace(read_observed(), lines={"L": "made"}), KINDS[k % len(KINDS)]
    at_line = {name: line_values(result, name, 0) for name in ("speed", "passing_height")}
    at_line = {name: values[~np.isnan(values)] for name, values in at_line.items()}
    stops = np.column_stack([result["stop_x"], result["stop_y"]])
    if kind == "stops, speeds":
        seen = replace(seen, stops=START + stretch * (stops - START))
    if kind == "printed":
        columns = ["line", "quantity", "method", "mean", "std", "n"]
        rows = [("L", name, "observed", v.mean(), v.std(ddof=1), v.size)
                for name, v in at_line.items()]  # fmt: skip
        seen = replace(seen, summaries=pd.DataFrame(rows, columns=columns))
    elif kind == "fractions":
        distance = np.unique(np.quantile(result["plan_distance"], (0.2, 0.4, 0.6, 0.8)))
        reached = [(result["plan_distance"].values > one).mean() for one in distance]
        passing = pd.DataFrame({"distance": distance, "fraction": reached})
        seen = replace(seen, passing=passing, passing_n=float(len(stops)))
    else:
        some = ["speed"] if kind == "stops, speeds" else [*at_line]
        seen = replace(seen, samples={("L", name): at_line[name] for name in some})
    kept = {key: value for draw in draws for key, value in draw.kept.items()}
    return seen, kept | {"radius_1": float(kept["radius"][0])}


def truth(folder: Path, place: str, k: int, told: argparse.Namespace) -> pd.DataFrame:
    """Rows with the posterior and the truth of each parameter."""
    how = {"dem": terrain(place), "transform": Grid(0.0, NY * CELL, CELL, NX, NY)}
    scene = read_scene(case_of(folder, told.observed, SEED), **how)
    seen, made = observe(Uncertain(scene), k, (SEED, PLACES.index(place), k), told.stretch)
    found = back_analysis(case_of(folder, told.boulders, k), seen, members=told.members, **how)
    table = posterior_table(found)[["parameter", "q05", "q95", "ratio"]]
    table["truth"] = [made[one.column] * (one.scale or 1.0) for one in parameters(found)]
    table["below"] = [
        found.weight @ (found.members[one.column] < made[one.column]) for one in parameters(found)
    ]
    said = any("does not explain" in one for one in warnings(found))
    return table.assign(terrain=place, k=k, kind=KINDS[k % len(KINDS)], members=len(found.members),
                        effective=found.effective, unexplained=said)  # fmt: skip


def report(rows: pd.DataFrame) -> None:
    """Print the calibration. Standard errors are computed over truths, because the parameters of a
    truth are dependent."""
    rows = rows.assign(held=(rows["q05"] < rows["truth"]) & (rows["truth"] < rows["q95"]))
    rows["worth"] = pd.cut(rows["effective"], [0, 20, 100, np.inf])
    rows["all"] = "all"
    for by in ("all", "terrain", "kind", "parameter", "worth"):
        for name, some in rows.groupby(by, observed=True):
            one = some.groupby(["terrain", "k"])
            held, below = one["held"].mean(), one["below"].mean()
            print(
                f"{name!s:20} {len(held):3} truths: 5-95 % holds {held.mean():.1%} "
                f"+- {held.sem():.1%}, part below {below.mean():.2f} +- {below.sem():.2f}, "
                f"range {some['ratio'].mean():.2f}, "
                f"effective {one['effective'].mean().median():.0f}"
                f", unexplained {one['unexplained'].mean().mean():.0%}"
            )


def main() -> None:
    parser = parser_of(__doc__, truths=30, members=512, boulders=150, observed=20)
    parser.add_argument("--stretch", type=float, default=1.0)
    told = parser.parse_args()
    truths = [(place, k) for k in range(told.truths) for place in PLACES]
    report(all_truths(told.file, ["terrain", "k"], truths, lambda *of: truth(*of, told)))


if __name__ == "__main__":
    main()
