# SPDX-License-Identifier: BSD-3-Clause
"""Does a back-analysis find what made its data? Coverage of the posterior over made truths.

    python -m benchmarks.accuracy.back [--truths 32] [--members 384] [--boulders 400]

Each truth is a draw of the prior on a bumpy slope: the size of the rocks, a factor on the volume, a
shift of the source. Of `--observed` boulders of the truth the stopping places and the speeds at a
line are observed. Where the posterior is right, its 5-95 % range holds the truth in 90 % of the
cases, and the truth's rank in it is uniform (Talts et al. 2018). Then the same with stopping places
`--stretch` times as far: how often is it said that the model does not explain the data?
"""

import argparse
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import rockfall
from benchmarks.machine import machine
from rockfall.analysis.back.posterior import parameters, posterior_table, warnings
from rockfall.analysis.back.study import Back, back_analysis
from rockfall.analysis.ensemble.uncertain_inputs import Uncertain, drawn_scene
from rockfall.analysis.observations import Observed, read_observed
from rockfall.io.grid import Grid
from rockfall.scene.read import read_scene
from rockfall.simulation.simulate import run_scene

NY, NX, CELL = 80, 60, 5.0
START = np.array([150.0, 380.0])


def slope() -> tuple[np.ndarray, Grid]:
    """A southward slope of 0.8 with bumps."""
    random = np.random.default_rng(1)
    y, x = np.mgrid[NY - 1 : -1 : -1, 0:NX] * CELL
    z = 1000 + 0.8 * y + 2 * np.sin(x / 25) + 2 * np.sin(y / 20) + random.normal(0, 0.2, x.shape)
    return z, Grid(0.0, NY * CELL, CELL, NX, NY)


def case_of(folder: Path, boulders: int, seed: int) -> rockfall.Case:
    return rockfall.Case(
        folder=folder,
        case={"boulders": boulders, "seed": seed, "threads": 1},
        surface={"uniform_mean_radius": 0.2},
        impact={"sets": "rocky-slope"},
        boulder={"volume": "fixed", "volume_mean": 0.8},
        release={"x": START[:1], "y": START[1:], "drop_height": 5.0},
        line=[{"name": "L", "x": [0.0, 300.0], "y": [300.0, 300.0]}],
        ensemble={"radius_factor": 2.0, "volume_factor": 1.3, "source_shift": 5.0},
    )


def observe(inputs: Uncertain, k: int, stretch: float) -> tuple[Observed, dict[str, float]]:
    """Boulders of a truth that is a draw of the prior, and that draw."""
    draws = [inputs.draw(name, k, 0) for name in inputs.names]
    result = run_scene(drawn_scene(inputs.scene, draws, inputs.boulders_seed(k)))
    stops = np.column_stack([result["stop_x"], result["stop_y"]])
    speed = result["line_speed"].values[0]
    seen = replace(
        read_observed(),
        stops=START + stretch * (stops - START),
        samples={("L", "speed"): speed[~np.isnan(speed)]},
        lines={"L": "made"},
    )
    kept = {key: value for draw in draws for key, value in draw.kept.items()}
    return seen, kept | {"radius_1": float(kept["radius"][0])}


def look(found: Back, truth: dict[str, float]) -> list[tuple[float, float]]:
    """Of each parameter, the part of the posterior below the truth, and the ratio of ranges."""
    ratios = posterior_table(found)["ratio"]
    below = [
        float(found.weight @ (found.members[one.column] < truth[one.column]))
        for one in parameters(found)
    ]
    return list(zip(below, ratios, strict=False))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    for name, value in (("truths", 32), ("members", 384), ("boulders", 400), ("observed", 40)):
        parser.add_argument(f"--{name}", type=int, default=value)
    parser.add_argument("--stretch", type=float, default=1.6)
    told = parser.parse_args()
    print(machine())
    z, grid = slope()
    with TemporaryDirectory() as folder:
        for stretch, truths in ((1.0, told.truths), (told.stretch, told.truths // 4)):
            rows, worth, contradicted = [], [], 0
            made = case_of(Path(folder), told.observed, 10_000)
            made = made.replace(ensemble={"runs": max(8, truths)})  # evenly spread over the prior
            of_prior = Uncertain(read_scene(made, dem=z, transform=grid))
            for k in range(truths):
                seen, truth = observe(of_prior, k, stretch)
                case = case_of(Path(folder), told.boulders, k)
                found = back_analysis(case, seen, members=told.members, dem=z, transform=grid)
                names = [one.label for one in parameters(found)]
                rows.append(look(found, truth))
                worth.append(found.effective)
                contradicted += any("does not explain" in one for one in warnings(found))
                print(k, f"{found.effective:.0f}", *(f"{b:.2f}" for b, _ in rows[-1]), flush=True)
            print(f"\nstretch {stretch:g}: {truths} truths, effective members {np.mean(worth):.0f}")
            said, error = mean(np.arange(truths) < contradicted)
            print(f"said to be unexplained: {said:.0%} +- {error:.0%}")
            if stretch == 1:
                report(names, np.array(rows))


def mean(values: np.ndarray) -> tuple[float, float]:
    """With its standard error."""
    return float(values.mean()), float(values.std(ddof=1) / np.sqrt(values.size))


def report(names: list[str], rows: np.ndarray) -> None:
    for name, one in zip(names, rows.transpose(1, 0, 2), strict=True):
        below, ratio = one.T
        held, error = mean((below > 0.05) & (below < 0.95))
        rank, rank_error = mean(below)
        width, width_error = mean(ratio)
        print(
            f"{name:20} 5-95 % holds the truth in {held:.0%} +- {error:.0%}, mean rank {rank:.2f} "
            f"+- {rank_error:.2f}, range over the prior's {width:.2f} +- {width_error:.2f}"
        )


if __name__ == "__main__":
    main()
