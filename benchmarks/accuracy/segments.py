# SPDX-License-Identifier: BSD-3-Clause
"""Accuracy and cost of segment results: the road of cases/settlement.

For small runs with many seeds: how often the 95 % intervals of frequencies and of the 95 %
quantiles of energy and upper edge contain the mean of large runs, and how often a quantile has no
upper limit. Then the CPU seconds of a hazard without segments and with increasing numbers of
segments.

    python cases/settlement/make_terrain.py && python -m benchmarks.accuracy.segments
"""

import argparse
import json
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import rockfall
from rockfall.files.segment_files import segment_table

FOLDER = Path(__file__).parents[2] / "cases/settlement"
FEW = 20  # boulders per source in a small run
LENGTH = 25.0  # length of segments [m]
LENGTHS = (25.0, 5.0, 1.0)  # lengths for which cost is measured [m]
NUMBERS = (
    "frequency", "frequency_above_30kJ", "frequency_above_300kJ",
    "energy_q95_kJ", "upper_edge_q95",
)  # fmt: skip
ENDS = ("_low", "_high")
RARE = 1e-3  # minimum frequency of the segments examined [1/year]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=4, help="of large runs")
    parser.add_argument("--small", type=int, default=40, help="small runs")
    given = parser.parse_args()
    case = rockfall.read_case(FOLDER / "case.nml")
    with TemporaryDirectory() as folder:
        road = road_layer(Path(folder))
        large = [table_of(case, road, seed) for seed in range(given.seeds)]
        truth = {name: np.mean([one[name] for one in large], axis=0) for name in NUMBERS}
        often = truth["frequency"] >= RARE
        print(f"{often.sum()} segments of {LENGTH:g} m; {given.seeds} large runs")
        few = case.replace(case={"boulders": FEW})
        small = [table_of(few, road, 1000 + seed) for seed in range(given.small)]
        for name, value in truth.items():
            low, high = (np.array([one[f"{name}{end}"] for one in small]) for end in ENDS)
            held = ((low <= value) | np.isnan(low)) & ((value <= high) | np.isnan(high))
            print(f"  {name:24} {held[:, often].mean():.3f} hold the mean of large runs; "
                  f"{np.isnan(high)[:, often].mean():.3f} without an upper limit")  # fmt: skip
        print(f"  without segments: {cpu_seconds(few):.2f} s of CPU")
        for length in LENGTHS:
            cost = {"segments": road, "segment_length": length}
            print(f"  segments of {length:g} m: {cpu_seconds(few, **cost):.2f} s of CPU")


def road_layer(folder: Path) -> Path:
    """Write a layer with only the road of the objects."""
    layer = json.loads((FOLDER / "objects.geojson").read_text())
    layer["features"] = [
        one for one in layer["features"] if one["geometry"]["type"] == "LineString"
    ]
    path = folder / "road.geojson"
    path.write_text(json.dumps(layer))
    return path


def table_of(case: rockfall.Case, road: Path, seed: int):
    """Table of segments for a seed."""
    case = case.replace(case={"seed": seed})
    return segment_table(rockfall.hazard(case, segments=road, segment_length=LENGTH))


def cpu_seconds(case: rockfall.Case, **segments: object) -> float:
    """CPU time of the runs of a hazard, minimum of three [s]."""
    return min(rockfall.hazard(case, **segments).attrs["cpu_seconds"] for _ in range(3))


if __name__ == "__main__":
    main()
