# SPDX-License-Identifier: BSD-3-Clause
"""Breakage: fragments of blocks, and the balances of mass and energy over many fragments.

    python -m benchmarks.physics.breakage [--fragments 1000000] [--threads 0]

Prints as Markdown, for blocks that fall from several heights: area ratio, number of fragments, and
largest fragment, by the published rule with the defaults of `&breakage`. Then, for random volumes
and energies with the requested number of fragments: the maximum difference between a block and the
sum of its fragments and fines [g]. Then, for boulders of cases/vaujany that break at release and at
impacts, up to the same number of fragments: the maximum relative difference between the energy
released and the sum of energy absorbed by the ground, lost in breaking and left at the end.
Finally, the effect of breakage at line EL1.
"""

import argparse
import math

import numpy as np

import rockfall
from benchmarks.machine import VAUJANY, machine
from rockfall.case import Case
from rockfall.result.crossings import at_lines, line_names
from rockfall.scene.rebounds.breakage import split_blocks

VOLUMES = 0.1, 1.0, 10.0  # volumes [m3]
FALLS = 1.0, 3.0, 10.0, 30.0  # fall heights [m]
DENSITY = 2800.0
BLOCKS = 20_000  # blocks per call


def breaking(case: Case, **keys: object) -> Case:
    """Case in which boulders break at release and at impacts."""
    return case.replace(breakage={"at": "both", "release_fall": 10.0} | keys)


def table(case: Case) -> None:
    print("| volume [m3] | fall [m] | area ratio | fragments | largest / block |")
    print("|---|---|---|---|---|")
    for volume in VOLUMES:
        energy = DENSITY * volume * 9.81 * np.array(FALLS)
        split = split_blocks(case, np.full(len(FALLS), volume), energy)
        for k, fall in enumerate(FALLS):
            number, largest = np.count_nonzero(split.volumes[k]), split.volumes[k, 0] / volume
            print(
                f"| {volume:g} | {fall:g} | {split.area_ratio[k]:.2f} | {number} | {largest:.2f} |"
            )


def mass(case: Case, wanted: int) -> None:
    random = np.random.default_rng(1)
    number, difference, fines, total = 0, 0.0, 0.0, 0.0
    while number < wanted:
        volume = 10 ** random.uniform(-1, 2, BLOCKS)
        energy = DENSITY * volume * 9.81 * 10 ** random.uniform(0, 2, BLOCKS)
        split = split_blocks(case, volume, energy)
        sums = np.array([math.fsum([*row, rest]) for row, rest in
                         zip(split.volumes, split.fines, strict=True)])  # fmt: skip
        difference = max(difference, float((DENSITY * np.abs(sums - volume)).max()))
        number += np.count_nonzero(split.volumes)
        fines, total = fines + split.fines.sum(), total + volume.sum()
    print(f"\n{number:,} fragments and fines: at most {1000 * difference:.1e} g from their block; "
          f"fines are {100 * fines / total:.2g} % of the volume")  # fmt: skip


def energy(case: Case, wanted: int) -> None:
    case = case.replace(output={"energy_balance": True})
    number, difference, boulders, breakages = 0, 0.0, 0, 0
    for seed in range(1, 1000):
        result = rockfall.run(case.replace(case={"seed": seed}))
        taken = ("ground", "trees", "barriers", "left", "breakage")
        released = result["energy_released"].values
        gap = released - sum(result[f"energy_{name}"].values for name in taken)
        difference = max(difference, float(np.abs(gap / released).max()))
        number += int(result["fragments"].sum())
        boulders += result.sizes["boulder"]
        breakages += int(result["breakages"].sum())
        if number >= wanted:
            break
    print(f"\n{number:,} fragments of {boulders:,} boulders, by {breakages:,} breakages: energy "
          f"balance of each boulder within {difference:.1e}")  # fmt: skip


def effect(case: Case) -> None:
    case = case.replace(case={"boulders": 2000}, output={"maps": None})
    head = "breakage", "pass", "mean energy", "95 % quantile", "height, 95 %", "fragments", ""
    print("\n| " + " | ".join(head) + " |")
    print("|---|---|---|---|---|---|---|")
    for at, fall in (("none", None), ("release", 10.0), ("impact", None), ("both", 10.0)):
        result = rockfall.run(case.replace(breakage={"at": at, "release_fall": fall}))
        table = rockfall.line_statistics(result).set_index(["line", "quantity"])
        energy, height = table.loc["EL1", "energy_total"], table.loc["EL1", "passing_height"]
        number, limits = 1.0, ""
        if "line_fragments" in result:
            capped = 100 * float((result["breakages_capped"] > 0).mean())
            fines = 100 * float(result["fines_volume"].sum() / result["volume"].sum())
            outside = 100 * float(result["rebounds_out_of_range"] / result["rebounds"])
            limits = f"{capped:.0f} % capped, {fines:.1f} % fines, {outside:.0f} % out of range"
            counts = at_lines(result)["line_fragments"].values[line_names(result).index("EL1")]
            number = counts[counts > 0].mean()
        print(
            f"| {at} | {100 * energy['fraction']:.0f} % | {energy['mean'] / 1000:.0f} kJ "
            f"| {energy['q95'] / 1000:.0f} kJ | {height['q95']:.1f} m | {number:.1f} | {limits} |"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--fragments", type=int, default=1_000_000)
    parser.add_argument("--threads", type=int, default=0)
    given = parser.parse_args()
    print(machine())
    case = breaking(rockfall.read_case(VAUJANY), max_fragments=1000)
    table(case.replace(breakage={"min_area_ratio": 0.25}))
    mass(case, given.fragments)
    energy(case.replace(case={"threads": given.threads}), given.fragments)
    effect(rockfall.read_case(VAUJANY))


if __name__ == "__main__":
    main()
