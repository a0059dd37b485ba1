# SPDX-License-Identifier: BSD-3-Clause
"""Calibration of the back-analysis of silent witnesses with synthetic truths.

    python -m benchmarks.accuracy.witnesses truths.csv [--truths 24] [--members 384] [--show 3]

Truths (rock size, factor on the drop height) are drawn from the prior. Observations are 40 blocks
below a slope with two cliffs, of unknown origin or from a known cliff, or scars on 20 trees along a
line across the slope, or both. Boulders of truths and analyses have different seeds. For a correct
posterior the 5-95 % range contains the truth in 90 % of the cases. `narrower` is the mean width of
that range relative to the prior range. Truths in the file are not run again. --show prints the
output of `rockfall back` for a truth.
"""

import argparse
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pandas as pd

import rockfall
from benchmarks.accuracy.truths import all_truths, parser_of
from rockfall.analysis.observed.observations import CONTACT, Observed, read_observed
from rockfall.io.rasters.grid import Grid
from rockfall.result.crossings import at_lines
from rockfall.result.trajectories import left_terrain
from rockfall.scene.read import read_scene
from rockfall.simulation.simulate import run_scene
from rockfall.studies.back.posterior import parameters, posterior_table, warnings
from rockfall.studies.back.study import Back, back_analysis
from rockfall.studies.ensemble.uncertain_inputs import Uncertain, drawn_scene
from rockfall.tables.back import back_text

NY, NX, CELL = 100, 60, 5.0
KINDS = ("at rest", "at rest, of a source", "marks", "at rest and marks")
SEED = 30_000  # seed of truths
BLOCKS, SCARS = 40, 20


def terrain() -> np.ndarray:
    """Terrain that descends to the south: a bumpy slope of gradient 0.8 that flattens out below."""
    y, x = np.mgrid[NY - 1 : -1 : -1, 0:NX] * CELL
    bumps = 2 * np.sin(x / 25) + 2 * np.sin(y / 20)
    rough = np.random.default_rng(1).normal(0, 0.2, x.shape)
    return 1000 + np.interp(y, [0, 200, 500], [0, 10, 250]) + bumps + rough


def case_of(folder: Path, boulders: int, seed: int) -> rockfall.Case:
    return rockfall.Case(
        folder=folder,
        case={"boulders": boulders, "seed": seed, "threads": 1},
        surface={"uniform_mean_radius": 0.2},
        impact={"sets": "vaujany-observed"},
        boulder={"volume": "normal", "volume_mean": 0.8, "volume_std": 0.15},
        release={"x": [100.0, 200.0], "y": [480.0, 480.0], "drop_height": 5.0},
        line=[{"name": "trees", "x": [0.0, 300.0], "y": [330.0, 330.0]}],
        ensemble={"radius_factor": 2.0, "drop_height_factor": 2.0},
    )


def observe(inputs: Uncertain, k: int) -> tuple[Observed, dict[str, float]]:
    """Witnesses of a truth, and the true parameters by name."""
    random = np.random.default_rng((SEED, k))
    draws = [inputs.at(name, random.random(inputs.ends[-1]), k) for name in inputs.names]
    result = run_scene(drawn_scene(inputs.scene, draws, inputs.boulders_seed(k)))
    seen, kind = read_observed(), KINDS[k % len(KINDS)]
    where = {}
    if kind != "marks":
        some = random.permutation(np.flatnonzero(~left_terrain(result)))[:BLOCKS]
        stops = np.column_stack([result["stop_x"], result["stop_y"]])[some]
        of = tuple(result["source"].values[some].astype(str)) if "source" in kind else ()
        where["stops"] = tuple(f"block {one}" for one in some)
        seen = replace(seen, stops=stops, sources=of, volumes=result["volume"].values[some])
    if "marks" in kind:
        crossed = np.flatnonzero(np.isfinite(at_lines(result)["line_x"].values[0]))
        some = random.permutation(crossed)[:SCARS]
        names = {"x": "line_x", "y": "line_y", "height": "line_passing_height"}
        rows = pd.DataFrame({name: result[of].values[0][some] for name, of in names.items()})
        where["contacts"] = tuple(f"tree {one}" for one in some)
        seen = replace(seen, contacts=rows.reindex(columns=list(CONTACT)).assign(dbh=40.0))
    kept = {key: value for draw in draws for key, value in draw.kept.items()}
    return replace(seen, where=where), kept | {"radius_1": float(kept["radius"][0])}


def truth(folder: Path, k: int, told: argparse.Namespace) -> tuple[Back, dict[str, float]]:
    """Posterior from the witnesses of a truth, and the truth."""
    how = {"dem": terrain(), "transform": Grid(0.0, NY * CELL, CELL, NX, NY)}
    seen, made = observe(Uncertain(read_scene(case_of(folder, 100, SEED), **how)), k)
    case = case_of(folder, told.boulders, k)
    return back_analysis(case, seen, members=told.members, **how), made


def rows_of(k: int, found: Back, made: dict[str, float]) -> pd.DataFrame:
    """Rows with posterior and truth of each parameter."""
    table = posterior_table(found)[["parameter", "q05", "median", "q95", "ratio"]]
    table["truth"] = [made[one.column] * (one.scale or 1.0) for one in parameters(found)]
    said = any("does not explain" in one for one in warnings(found))
    apart = (found.data["agreement"] == "conflict").any()
    return table.assign(k=k, kind=KINDS[k % len(KINDS)], effective=found.effective,
                        noise=found.noise, unexplained=said, conflict=apart)  # fmt: skip


def report(rows: pd.DataFrame) -> None:
    """Print the calibration. Standard errors are computed over truths, because the parameters of a
    truth are dependent."""
    rows = rows.assign(held=(rows["q05"] < rows["truth"]) & (rows["truth"] < rows["q95"]))
    rows["all"] = "all"
    for by in ("all", "kind", "parameter"):
        for name, some in rows.groupby(by, observed=True):
            held = some.groupby("k")["held"].mean()
            print(
                f"{name!s:22} {len(held):3} truths: 5-95 % holds {held.mean():.0%} "
                f"+- {held.sem():.0%}, narrower {some['ratio'].mean():.2f}, "
                f"effective {some['effective'].median():.0f}, noise {some['noise'].median():.1f}, "
                f"unexplained {some['unexplained'].mean():.0%}, "
                f"conflict {some['conflict'].mean():.0%}"
            )


def main() -> None:
    parser = parser_of(__doc__, truths=24, members=384, boulders=300)
    parser.add_argument("--show", type=int)
    told = parser.parse_args()
    if told.show is not None:
        with TemporaryDirectory() as folder:
            found, values = truth(Path(folder), told.show, told)
            print(back_text(found), values, sep="\n")
        return

    def rows(folder: Path, k: int) -> pd.DataFrame:
        return rows_of(k, *truth(folder, k, told))

    report(all_truths(told.file, ["k"], [(k,) for k in range(told.truths)], rows))


if __name__ == "__main__":
    main()
