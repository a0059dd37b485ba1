# SPDX-License-Identifier: BSD-3-Clause
"""Print the results in README.md: means over seeds, and the effects of forest and net, with
standard errors.

`python expected.py [SEEDS]` after `python make_terrain.py`; takes a minute for 40 seeds. A seed
determines boulders and trees, equally in all three cases: two cases differ only by the forest or
the net.
"""

import sys
from pathlib import Path

import numpy as np
import xarray as xr
from scipy.stats import t

import rockfall
from rockfall.result.crossings import line_values

HERE = Path(__file__).parent
CASES = "bare", "forest", "forest-and-net"
QUANTITIES = "boulders that pass [%]", "energy, q95 [kJ]", "height of the centre, q95 [m]"


def run(case: rockfall.Case, seed: int, **of_case: int) -> xr.Dataset:
    """Result with another seed of boulders, and of trees, if any."""
    stand = {"forest": {"seed": seed}} if case.forest.get("stems") else {}
    return rockfall.run(case.replace(case={"seed": seed, **of_case}, **stand))


def at_road(result: xr.Dataset) -> np.ndarray:
    """QUANTITIES at the road, the first line; quantiles are of passing boulders."""
    energy, height = (line_values(result, name, 0) for name in ("energy_total", "passing_height"))
    passed = np.isfinite(energy)
    if not passed.any():
        return np.array([0.0, np.nan, np.nan])
    q95 = (np.quantile(values[passed], 0.95) for values in (energy / 1000, height))
    return np.array([100 * passed.mean(), *q95])


def mean_and_error(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and standard error over seeds (first axis); seeds without passing boulders have no
    quantile."""
    error = np.nanstd(values, axis=0, ddof=1) / np.sqrt(np.isfinite(values).sum(axis=0))
    return np.nanmean(values, axis=0), error


def shown(values: np.ndarray) -> list[str]:
    """Each quantity as its mean and standard error."""
    return [f"{mean:.3g} ± {two(error)}" for mean, error in np.transpose(mean_and_error(values))]


def two(error: float) -> str:
    """Error with two digits."""
    return f"{float(f'{error:.2g}'):g}"


def changes(values: np.ndarray) -> list[str]:
    """Paired differences with their errors; undecided if the 95 % interval contains zero."""
    wide = t.ppf(0.975, len(values) - 1)
    return [
        f"{mean:+.3g} ± {two(error)}" + ("" if abs(mean) > wide * error else ", undecided")
        for mean, error in np.transpose(mean_and_error(values))
    ]


def rows(found: dict[str, np.ndarray], pairs: list[tuple[str, str]]) -> list[str]:
    """Markdown table: passing boulders in each case, and differences between cases."""
    text = [f"| at the road | {' | '.join(QUANTITIES)} |", "|---|---|---|---|"]
    text += [f"| {name} | {' | '.join(shown(of))} |" for name, of in found.items()]
    for after, before in pairs:
        cells = changes(found[after] - found[before])
        text.append(f"| {after} - {before} | {' | '.join(cells)} |")
    return text


def main(seeds: int) -> None:
    cases = {name: rockfall.read_case(HERE / f"{name}.nml") for name in CASES}
    found = {
        name: np.array([at_road(run(case, seed)) for seed in range(1, seeds + 1)])
        for name, case in cases.items()
    }
    print(*rows(found, [("forest", "bare"), ("forest-and-net", "forest")]), sep="\n")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 40)
