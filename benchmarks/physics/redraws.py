# SPDX-License-Identifier: BSD-3-Clause
"""Effect of redrawing on an impact set: mean rebounds without and with it, and the fraction of
rejected draws.

    python -m benchmarks.physics.redraws [--ratio 5] [--spin 0.5] [--draws 400000]

A draw of the matrix is valid if the boulder leaves the surface without a gain of energy (theory,
chapter 5). For several incidence angles and W/V = spin, prints as Markdown the fraction of rejected
draws, and the means of V_t'/V, V_n'/V and W'/V over all draws and over valid draws, with the
relative shift in brackets. Then, for cases/vaujany, prints the fraction of rebounds that were
redrawn.
"""

import argparse

import numpy as np

import rockfall
from benchmarks.machine import NOTHING, VAUJANY, machine
from rockfall.scene.rebounds.coefficients import covariance_root
from rockfall.scene.rebounds.kernel_rebounds import admissible
from rockfall.scene.rebounds.sets import read_sets

SET = "vaujany-observed"
ANGLES = 5, 10, 20, 30, 45, 60, 90  # incidence angles to the surface [degree]
NAMES = "R_t", "R_n", "W'/V"


def measure(
    mean: np.ndarray, covariance: np.ndarray, angle: float, spin: float, draws: int
) -> tuple[float, float, np.ndarray, np.ndarray]:
    """Fraction of rejected draws with its standard error, and means of (V_t', V_n', W')/V over all
    draws and over valid draws."""
    theta = np.radians(angle)
    v_in = np.array([[np.cos(theta), -np.sin(theta), spin]])
    numbers = np.random.default_rng(1).standard_normal((draws, 9))
    matrices = mean + numbers @ covariance_root(covariance).T
    v_out = matrices.reshape(-1, 3, 3) @ v_in[0]
    counts = admissible(v_in, v_out)
    rejected = 1 - counts.mean()
    error = np.sqrt(rejected * (1 - rejected) / draws)
    return rejected, error, v_out.mean(axis=0), v_out[counts].mean(axis=0)


def restitution(v: np.ndarray, angle: float) -> list[float]:
    """R_t, R_n and W'/V; if V_t is zero, V_t'/V instead of R_t."""
    theta = np.radians(angle)
    along = np.cos(theta) if angle < 90 else 1.0
    return [v[0] / along, v[1] / np.sin(theta), v[2]]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--ratio", type=int, choices=range(1, 6), default=5)
    parser.add_argument("--spin", type=float, default=0.5)
    parser.add_argument("--draws", type=int, default=400_000)
    given = parser.parse_args()
    (sets,) = read_sets(SET)
    mean, covariance = sets.mean[given.ratio - 1], sets.covariance[given.ratio - 1]
    print(machine())
    print(f"{SET}, R_b/R_m = {given.ratio}, W/V = {given.spin:g}, {given.draws:,} draws")
    print("| incidence [degree] | rejected [%] | " + " | ".join(NAMES) + " |")
    print("|---|---|" + "---|" * len(NAMES))
    for angle in ANGLES:
        rejected, error, drawn, kept = measure(
            mean, covariance, angle, given.spin, given.draws
        )  # fmt: skip
        cells = [f"{100 * rejected:.1f} ± {100 * error:.1f}"]
        pairs = zip(restitution(drawn, angle), restitution(kept, angle), strict=True)
        for before, after in pairs:
            shift = f" ({after / before - 1:+.0%})" if abs(before) > 0.02 else ""
            cells.append(f"{before:.3f}, {after:.3f}{shift}")
        print(f"| {angle} | " + " | ".join(cells) + " |")
    result = rockfall.run(rockfall.read_case(VAUJANY).replace(output=NOTHING))
    total, again, forced = (
        int(result[f"rebounds{what}"]) for what in ("", "_redrawn", "_forced")
    )  # fmt: skip
    print(
        f"cases/vaujany: {total:,} rebounds, {again / total:.1%} drawn again, {forced / total:.2%} "
        "forced"
    )


if __name__ == "__main__":
    main()
