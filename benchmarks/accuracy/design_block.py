# SPDX-License-Identifier: BSD-3-Clause
"""Coverage of intervals for design blocks, with surveys drawn from a known distribution
(docs/design_block.md).

python -m benchmarks.accuracy.design_block [--surveys N] [--seed N]
"""

import argparse

import numpy as np

import rockfall
from rockfall.errors import RockfallError

YEARS, PERIOD = 40.0, 100.0
THRESHOLD, SCALE = 0.5, 0.6  # [m3]
#: Number of surveyed blocks, expected number dated, shape, whether the threshold is given.
SETTINGS = [
    (30, 8, 0.7, True), (30, 8, 0.7, False), (30, 8, 1.5, True), (100, 15, 0.8, True),
    (100, 15, 0.8, False), (60, 6, 0.3, False), (200, 40, 0.5, False), (100, 4, 1.0, True),
]  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--surveys", type=int, default=300)
    parser.add_argument("--seed", type=int, default=11)
    given = parser.parse_args()
    random = np.random.default_rng(given.seed)
    print("blocks dated shape threshold  hold  below  above  refused  high/low")
    for blocks, dated, shape, known in SETTINGS:
        true = THRESHOLD + SCALE / shape * ((dated / YEARS * PERIOD) ** shape - 1)
        limits = []
        for _ in range(given.surveys):
            volumes, events = (
                THRESHOLD + SCALE * np.expm1(shape * random.exponential(size=n)) / shape
                for n in (blocks, random.poisson(dated))
            )
            try:
                found = rockfall.design_block(
                    volumes, PERIOD, years=YEARS, events=events,
                    threshold=THRESHOLD if known else None,
                )  # fmt: skip
            except RockfallError:
                continue
            limits.append((found.volume_low, found.volume_high))
        low, high = np.array(limits).T
        below, above = (true < low).mean(), (true > high).mean()
        print(
            f"{blocks:6} {dated:5} {shape:5} {'given' if known else 'found':>9} "
            f"{1 - below - above:5.1%} {below:6.1%} {above:6.1%} {given.surveys - len(limits):8} "
            f"{np.median(high / low):9.1f}"
        )


if __name__ == "__main__":
    main()
