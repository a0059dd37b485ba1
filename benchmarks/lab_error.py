# SPDX-License-Identifier: BSD-3-Clause
"""What the choices of the laboratory cost and change: error against run time.

    python benchmarks/lab_error.py [LAB.nml] [--points 40] [--impacts 20] [--ratios 1 3 5]

Runs a laboratory case, and again with one thing changed and the same seed. For each ratio: by how
much the means of a1..a9 then differ, the largest difference in combined standard errors (of nine
without any effect it is about 2) and the root mean square of all nine. Where layers and shots stay
the same, the impacts are also compared one by one, with a quarter of the step or with the base:
|V_out - V_out,ref| / |V_in|, V = (V_t, V_n, W), its median and 90 % quantile, and the share of
impacts with more than 0.01. CPU seconds include the packing of the layers.
"""

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from machine import machine

from rockfall.errors import RockfallError
from rockfall.lab.case import COEFFICIENTS, LabCase, read_lab_case
from rockfall.lab.experiment import STATUS, run_impacts
from rockfall.lab.fit import ENDED, ImpactSet, fit_set, impacts_of, point_maps

ROCKY_SLOPE = Path(__file__).parents[1] / "cases/rocky-slope/lab.nml"
FINEST, BASE = "step x 0.25", "base"
FAR = 3.0  # combined standard errors
CHANGED = 0.01  # of the speed before


def variants(case: LabCase) -> dict[str, dict[str, dict[str, Any]]]:
    """Name and change of each; times x where the name says so, else the value."""

    def times(group: str, key: str, factor: float) -> dict[str, dict[str, Any]]:
        value = getattr(case, group)[key] * factor
        return {group: {key: max(1, round(value)) if group == "lab" else value}}

    step = case.impact["step_share"]
    return {
        FINEST: times("impact", "step_share", 0.25),
        "step x 0.5": times("impact", "step_share", 0.5),
        BASE: {},
        "step x 2": times("impact", "step_share", 2),
        "step x 2, retries 0": {"impact": {"step_share": 2 * step, "retries": 0}},
        "retries 0": {"impact": {"retries": 0}},
        "past 0.25": {"impact": {"past": 0.25}},
        "past 0.75": {"impact": {"past": 0.75}},
        "wait 1": {"impact": {"wait": 1.0}},
        "wait 4": {"impact": {"wait": 4.0}},
        "wait 16": {"impact": {"wait": 16.0}},
        "spent x 0.01": times("impact", "spent", 0.01),
        "spent x 10": times("impact", "spent", 10),
        "patience x 4": times("impact", "patience", 4),
        "points x 2": times("lab", "points", 2),
        "points x 4": times("lab", "points", 4),
        "impacts x 0.5": times("lab", "impacts", 0.5),
        "impacts x 2": times("lab", "impacts", 2),
        "width x 2": times("packing", "width", 2),
        "depth x 0.67": times("packing", "depth", 0.67),
        "depth x 1.5": times("packing", "depth", 1.5),
        "young x 0.1": times("material", "young", 0.1),
        "young x 10": times("material", "young", 10),
        "damping 0": {"material": {"damping": 0.0}},
    }  # fmt: skip


def fitted(data, ratio: float) -> ImpactSet | None:
    try:
        return fit_set(point_maps(*impacts_of(data, ratio)), replicates=300)
    except RockfallError:  # too many exploded
        return None


def differences(found: ImpactSet | None, base: ImpactSet | None) -> np.ndarray | None:
    """Of the means of a1..a9, and in combined standard errors: (2, 9)."""
    if found is None or base is None:
        return None
    difference = found.mean - base.mean
    return np.array([difference, difference / np.hypot(found.mean_error, base.mean_error)])


def velocities(data, when: str) -> np.ndarray:
    return np.stack([data[f"{v}_{when}"].values for v in ("vt", "vn", "w")], axis=-1)


def one_by_one(data, reference) -> tuple[float, float, float] | None:
    """Over the impacts that ended in both; None if they are not paired."""
    if data["status"].shape != reference["status"].shape or not all(
        np.array_equal(data[name].values, reference[name].values) for name in ("surface", "vt_in")
    ):
        return None
    results = [STATUS[name] for name in ENDED]
    ended = data["status"].isin(results).values & reference["status"].isin(results).values
    change = np.linalg.norm(velocities(data, "out") - velocities(reference, "out"), axis=-1)
    share = (change / np.linalg.norm(velocities(data, "in"), axis=-1))[ended]
    if not share.size:
        return None
    return (*np.quantile(share, [0.5, 0.9]), (share > CHANGED).mean())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("case", metavar="LAB.nml", nargs="?", type=Path, default=ROCKY_SLOPE)
    parser.add_argument("--points", type=int, default=40)
    parser.add_argument("--impacts", type=int, default=20)
    parser.add_argument("--ratios", type=float, nargs="+", default=[1, 3, 5])
    options = parser.parse_args()
    ratios = options.ratios
    plan = {"points": options.points, "impacts": options.impacts, "ratios": ratios}
    case = read_lab_case(options.case).replace(lab=plan)
    print(machine())
    print(f"{options.case}: {options.points} points, {options.impacts} impacts at each", flush=True)

    base = run_impacts(case)
    sets = {ratio: fitted(base, ratio) for ratio in ratios}
    finest = run_impacts(case.replace(**variants(case)[FINEST]))
    known = {BASE: base, FINEST: finest}
    print(f"\n{'':44}" + "".join(f"{f'R_b/R_m = {ratio:g}':>19}" for ratio in ratios), end="")
    print(f"{'impact by impact':>22}\n{'standard errors of the base, r.m.s.':44}", end="")
    for found in sets.values():
        error = f"{np.sqrt((found.mean_error**2).mean()):.4f}" if found else "-"
        print(f"{error:>19}", end="")
    print(f"\n{'changed':22}{'CPU s/1000':>11}{'exploded':>11}", end="")
    print(f"{'largest':>9}{'r.m.s.':>10}" * len(ratios) + f"{'median':>10}{'90 %':>9}{'> 0.01':>8}")

    far = []
    for name, change in variants(case).items():
        try:
            data = known[name] if name in known else run_impacts(case.replace(**change))
        except RockfallError as error:
            print(f"{name:22}  {error}")
            continue
        exploded = float((data["status"] == STATUS["exploded"]).mean())
        cost = 1000 * data.attrs["cpu_seconds"] / data["status"].size
        row = f"{name:22}{cost:11.2f}{exploded:11.2%}"
        for ratio in ratios:
            both = None if name == BASE else differences(fitted(data, ratio), sets[ratio])
            if both is None:
                row += f"{'-':>19}"
                continue
            row += f"{abs(both[1]).max():9.1f}{np.sqrt((both[0] ** 2).mean()):10.4f}"
            for k in np.flatnonzero(abs(both[1]) > FAR):
                change_of = f"{COEFFICIENTS[k]} {both[0, k]:+.3f}, {both[1, k]:+.1f}"
                far.append(f"{name}, R_b/R_m = {ratio:g}: {change_of}")
        by_step = name == BASE or name.startswith("step")
        if name != FINEST and (shares := one_by_one(data, finest if by_step else base)):
            row += "{:10.5f}{:9.5f}{:8.1%}".format(*shares) + f"  of {FINEST if by_step else BASE}"
        print(row, flush=True)
    print(f"\nBeyond {FAR:g} combined standard errors:", *(far or ["nothing"]), sep="\n  ")


if __name__ == "__main__":
    main()
