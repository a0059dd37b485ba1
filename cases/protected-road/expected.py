"""Print the results in README.md: means over seeds with standard errors.

`python expected.py [SEEDS]` after `python make_terrain.py`; takes two minutes for 60 seeds.
"""

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import rockfall
from rockfall.protection.crossings import crossings, passes
from rockfall.result.crossings import at_lines

HERE = Path(__file__).parent
CLASS = 2  # height class of the residual hazard


def run(name: str, seed: int, **changes):
    """Result of a case with another seed and other changes."""
    case = rockfall.read_case(HERE / f"{name}.nml")
    return rockfall.run(case.replace(case={"seed": seed}, **changes))


def numbers(seed: int) -> Iterator[tuple[str, float]]:
    """Statistics of a run with a given seed."""
    results = {name: run(name, seed) for name in ("road", "net", "dam")}
    bare = rockfall.design(results["road"], residual=0.02)
    came = bare.demand.set_index("line").loc["net", "n"]
    loads = bare.loads.set_index(["line", "quantity"]).loc["net"]
    yield "come to the line of the net [%]", 100 * came / results["road"].sizes["boulder"]
    for name, result in results.items():
        road = np.isfinite(at_lines(result)["line_speed"].values[0])
        yield f"reach the road, {name}.nml [%]", 100 * road.mean()
    bare_fine = run("dam", seed, dam=[])
    fraction = np.isfinite(at_lines(bare_fine)["line_speed"].values[0]).mean()
    yield "reach the road, dam.nml without its dam [%]", 100 * fraction
    for level in "q95", "q99":
        yield f"{level} of the total energy at the net [kJ]", loads[level]["energy_total"] / 1000
        yield f"{level} of the passing height at the net [m]", loads[level]["passing_height"]
        yield f"{level} of the same, normal [m]", loads[level]["normal_height"]
    chosen = bare.choices.set_index(["line", "ead_class"]).loc[("net", CLASS)]
    yield f"height of class {CLASS} that 2 % pass [m]", chosen["height"]
    others = crossings(run("road", 1000 + seed), 1)
    left = passes(others, chosen["height"], chosen["capacity"]).mean()
    yield "of other boulders it lets pass [%]", 100 * left
    check = rockfall.design(results["net"]).checks.iloc[0]
    yield "pass the net, of those that come [%]", 100 * check["residual"]


def main(seeds: int) -> None:
    rows = [dict(numbers(seed)) for seed in range(1, seeds + 1)]
    for name in rows[0]:
        values = np.array([row[name] for row in rows])
        error = np.nanstd(values, ddof=1) / np.sqrt(np.isfinite(values).sum())
        print(f"{name:45} {np.nanmean(values):8.2f} +- {error:.2f}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 60)
