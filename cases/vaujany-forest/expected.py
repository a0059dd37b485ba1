# SPDX-License-Identifier: BSD-3-Clause
"""Prints the table of README.md: what the experiment had, and what the program has beside it.

`python expected.py [SEEDS] [--table NAME]` after `python make_terrain.py`; ten seconds for 40
seeds, each of boulders and of trees. With `--write` the table goes into README.md, and its
numbers into `python/rockfall/data/forest_experiment.csv`, from which the program says how far its
forest is from the experiment. `--table` runs by a table of impacts in place of the matrix.
"""

import argparse
import re
from pathlib import Path

import numpy as np
import xarray as xr

import rockfall

HERE = Path(__file__).parent
STORED = HERE.parents[1] / "python" / "rockfall" / "data" / "forest_experiment.csv"
CASES = {"bare": "without forest", "forest": "with forest"}
AT_ONCE = 100  # boulders, about as many as the experiment released on each slope
QUANTITIES = {  # by case: as printed of the experiment
    "passing": ("boulders that pass [%]", {"bare": 95.0, "forest": 34.0}),
    "mean_speed": ("mean speed [m/s]", {"bare": 15.4, "forest": 11.7}),
    "max_speed": (f"maximum speed of {AT_ONCE} boulders [m/s]", {"bare": 30.6, "forest": 24.2}),
}


def run(case: rockfall.Case, seed: int) -> xr.Dataset:
    """The result with another seed of boulders, and of trees where there are any."""
    stand = {"forest": {"seed": seed}} if case.has_forest else {}
    return rockfall.run(case.replace(case={"seed": seed}, **stand))


def numbers(result: xr.Dataset) -> list[float]:
    """QUANTITIES of a run. A maximum grows with the number of boulders: it is that of as many as
    the experiment had, on average."""
    speed, fastest = result["line_speed"].values[0], result["speed_max"].values
    mixed = np.random.default_rng(0).permutation(fastest.size)
    some = fastest[mixed[: fastest.size // AT_ONCE * AT_ONCE]].reshape(-1, AT_ONCE)
    return [100 * np.isfinite(speed).mean(), float(np.nanmean(speed)), some.max(axis=1).mean()]


def simulated(seeds: int, impact: dict[str, str]) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """By case: means over the seeds and their standard errors, (quantities,)."""
    found = {}
    for name in CASES:
        case = rockfall.read_case(HERE / f"{name}.nml").replace(impact=impact)
        values = np.array([numbers(run(case, seed)) for seed in range(1, seeds + 1)])
        found[name] = values.mean(axis=0), values.std(axis=0, ddof=1) / np.sqrt(seeds)
    return found


def table(found: dict[str, tuple[np.ndarray, np.ndarray]]) -> str:
    """The table in Markdown."""
    heads = [f"{about}: {what}" for about in CASES.values() for what in ("experiment", "program")]
    rows = [f"| | {' | '.join(heads)} |", "|---|" + "---|" * len(heads)]
    for k, (label, printed) in enumerate(QUANTITIES.values()):
        cells = []
        for name, (mean, error) in found.items():
            cells += [f"{printed[name]:g}", f"{mean[k]:.1f} ± {error[k]:.2g}"]
        rows.append(f"| {label} | {' | '.join(cells)} |")
    return "\n".join(rows)


def stored(found: dict[str, tuple[np.ndarray, np.ndarray]]) -> str:
    """The same for the program, as CSV."""
    rows = ["quantity,case,experiment,simulated,standard_error"]
    for k, (quantity, (_, printed)) in enumerate(QUANTITIES.items()):
        for name, (mean, error) in found.items():
            rows.append(f"{quantity},{name},{printed[name]:g},{mean[k]:.1f},{error[k]:.2g}")
    return "\n".join([*rows, ""])


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("seeds", type=int, nargs="?", default=40)
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--table", metavar="NAME", help="of impacts, in place of the matrix")
    given = parser.parse_args()
    found = simulated(given.seeds, {"form": "table", "table": given.table} if given.table else {})
    print(table(found))
    if given.write and not given.table:
        readme = HERE / "README.md"
        text = readme.read_text(encoding="utf-8")
        readme.write_text(
            re.sub(r"(?m)^\| .*\n\|---.*\n(\|.*\n)+", table(found) + "\n", text, count=1)
        )
        STORED.write_text(stored(found), encoding="utf-8")


if __name__ == "__main__":
    main()
