# SPDX-License-Identifier: BSD-3-Clause
"""CPU time of a rebound by the paper's matrix and by an impact table, in lanes and one by one:

    python -m benchmarks.speed.table_rebound [--boulders 20000] [--repeat 7]

The slope of cases/vaujany with R_m = 0.1 m everywhere, without options, on one thread; minima of
repeated runs, which take turns. The time of the complete run is divided by its rebounds and thus
includes flights, the cells they cross, and rolling.
"""

import argparse

from rockfall._core import rockfall_f2py as _core

import rockfall
from benchmarks.machine import LANES, NOTHING, VAUJANY, machine
from rockfall.scene.read import read_scene
from rockfall.simulation.simulate import run_scene

RADIUS = 0.1  # radius of the rocks [m]
TABLES = "talus", "meadow"


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--boulders", type=int, default=20_000)
    parser.add_argument("--repeat", type=int, default=7)
    given = parser.parse_args()
    bare = rockfall.read_case(VAUJANY).replace(
        case={"boulders": given.boulders, "threads": 1},
        surface={"zones": None, "table": None, "uniform_mean_radius": RADIUS},
        output=NOTHING, line=[],
    )  # fmt: skip
    cases = {"matrix": bare}
    unused = {"ratio": None, "sets": None}
    cases |= {
        f"table {name}": bare.replace(impact={"form": "table", "table": name} | unused)
        for name in TABLES
    }
    least: dict[tuple[str, str], tuple[float, float]] = {}
    for _ in range(given.repeat):
        for law, case in cases.items():
            for way, lanes in LANES.items():
                scene = read_scene(case)
                _core.carry_in_lanes(scene.kernel.handle, lanes)
                result = run_scene(scene)
                rebounds = int(result["rebounds"])
                time = result.attrs["cpu_seconds"] / rebounds * 1e9
                found = time, rebounds / given.boulders
                least[law, way] = min(found, least.get((law, way), found))
    print(machine())
    print("| law | " + " | ".join(f"{way} [ns]" for way in LANES) + " | rebounds a boulder |")
    print("|---" * (len(LANES) + 2) + "|")
    for law in cases:
        times = " | ".join(f"{least[law, way][0]:.0f}" for way in LANES)
        print(f"| {law} | {times} | {least[law, 'one by one'][1]:.1f} |")


if __name__ == "__main__":
    main()
