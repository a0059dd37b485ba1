# SPDX-License-Identifier: BSD-3-Clause
"""Compare results of the experiment with the program.

`python expected.py [SEEDS] [--table NAME]` after `python make_terrain.py`; takes ten seconds for 40
seeds of boulders and trees. `--table` uses an impact table instead of the matrix. `--write` stores
the results in `python/rockfall/data/field_evidence.csv`, from which `python tools/document.py`
writes the table of README.md, and the program its remarks on forests.
"""

import argparse
import sys
from pathlib import Path

import numpy as np
import xarray as xr

import rockfall
from rockfall.result.crossings import at_lines

HERE = Path(__file__).resolve().parent
sys.path.append(str(HERE.parents[1]))

from benchmarks.evidence import record, row  # noqa: E402

CASES = "bare", "forest"
AT_ONCE = 100  # number of boulders, about that released on each slope in the experiment
QUANTITIES = {  # unit; then the published value for each case
    "passing": ("%", {"bare": 95.0, "forest": 34.0}),
    "speed_mean": ("m/s", {"bare": 15.4, "forest": 11.7}),
    "speed_max": ("m/s", {"bare": 30.6, "forest": 24.2}),
}


def run(case: rockfall.Case, seed: int) -> xr.Dataset:
    """Result with another seed of boulders, and of trees if there are any."""
    stand = {"forest": {"seed": seed}} if case.has_forest else {}
    return rockfall.run(case.replace(case={"seed": seed}, **stand))


def numbers(result: xr.Dataset) -> list[float]:
    """QUANTITIES of a run. Maxima grow with the number of boulders: they are means over groups as
    large as in the experiment."""
    speed, fastest = at_lines(result)["line_speed"].values[0], result["speed_max"].values
    mixed = np.random.default_rng(0).permutation(fastest.size)
    some = fastest[mixed[: fastest.size // AT_ONCE * AT_ONCE]].reshape(-1, AT_ONCE)
    return [100 * np.isfinite(speed).mean(), float(np.nanmean(speed)), some.max(axis=1).mean()]


def passing_at_once(result: xr.Dataset) -> float:
    """Fractions [%] for groups as large as in the experiment, so that their scatter includes the
    boulders and the stand of a single experiment."""
    speed = at_lines(result)["line_speed"].values[0]
    return 100 * np.isfinite(np.random.default_rng(0).permutation(speed)[:AT_ONCE]).mean()


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("seeds", type=int, nargs="?", default=40)
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--table", metavar="NAME", help="of impacts, in place of the matrix")
    given = parser.parse_args()
    impact = {"form": "table", "table": given.table} if given.table else {}
    rows = []
    for name in CASES:
        case = rockfall.read_case(HERE / f"{name}.nml")
        model = given.table or case.impact["sets"]
        case = case.replace(impact=impact)
        runs = [run(case, seed) for seed in range(1, given.seeds + 1)]
        values = np.array([numbers(result) for result in runs])
        scatter = np.std([passing_at_once(result) for result in runs], ddof=1)
        for (quantity, (unit, printed)), of_runs in zip(QUANTITIES.items(), values.T, strict=True):
            key = "vaujany-forest", name, quantity, model
            rows.append(row(key, unit, printed[name], of_runs))
            shown = f"{rows[-1].simulated:.4g} ± {rows[-1].simulated_error:.2g} {unit}"
            print(f"{name}, {quantity}: {printed[name]:g} in the experiment, {shown}")
        print(f"{name}, passing: of {AT_ONCE} boulders ± {scatter:.2g} % from run to run")
    if given.write:
        record(rows)


if __name__ == "__main__":
    main()
