# SPDX-License-Identifier: BSD-3-Clause
"""Stiff and extreme impacts in the laboratory: each must end as a result or as a reported
explosion.

    python -m lab.benchmarks.stability [--only WORD]

A row is the base case with one change, or a corner with several. The energy V_t^2 + V_n^2 + 0.4 W^2
after an impact that ended (rebounded, lifted, rolled on) must not exceed the energy before plus the
work of its weight, at most 2 g times the fall from the top of the layer to its deepest point:
`with fall` is the maximum ratio, `out/in` the ratio without the weight. Exit status 1 if an impact
gains more than 2 %, has a NaN, or explodes without a reason. A layer that cannot be packed is
reported with the reason.

Undetected errors: `by step` is the median of |V_out - V_out,half| / |V_in|, at the peak, for some
impacts repeated with half the step.
"""

import argparse
import sys

import numpy as np
from rockfall_lab._lab import lab_f2py as _lab

from benchmarks.machine import machine
from rockfall.errors import RockfallError
from rockfall.scene.rebounds.kernel_rebounds import INERTIA_FACTOR
from rockfall_lab.case import LabCase, names
from rockfall_lab.spheres.experiment import ENDED, STATUS, run_impacts

TOLERANCE = 0.02  # fraction of the energy before: as in the kernel's own check
ENDS = [name for name in STATUS if name != "not_done"]
BASE = LabCase(
    name="lab_stability",
    lab={"layers": 4, "points": 4, "impacts": 4, "ratios": [2]},
    material={"friction": 0.3, "rolling": 0.01, "damping": 0.15},
    packing={"mean_radius": 0.1, "depth": 2, "grading": 3, "friction": 0.2},
)
FEW, FEWER = {"layers": 2, "points": 2}, {"layers": 1, "points": 1}  # for slow impacts


SHALLOW = {"depth": 0.5, "width": 3.5}  # otherwise R_b/R_m = 10 would need a hundred thousand rocks


def speed(value: float) -> dict[str, list[float]]:
    return {"speed": 3 * [value]}


def ratio(value: float, **plan: int) -> dict[str, object]:
    return {"ratios": [value], **plan}


ELASTIC = {"friction": 0.0, "rolling": 0.0, "damping": 0.0}
CHANGES = {
    "nothing": {},
    "young 1e7": {"material": {"young": 1e7}},
    "young 1e8": {"material": {"young": 1e8}},
    "young 1e10": {"material": {"young": 1e10}},
    "young 1e11": {"material": {"young": 1e11}, "lab": FEW},
    "speed 0.1": {"impact": speed(0.1), "lab": FEW},
    "speed 0.1, gravity 0.001": {
        "impact": speed(0.1), "packing": {"gravity": 0.001}, "lab": FEWER
    },
    "speed 1": {"impact": speed(1.0)},
    "speed 100": {"impact": speed(100.0)},
    "R_b/R_m 0.5": {"lab": ratio(0.5)},
    "R_b/R_m 10": {"lab": ratio(10, **FEWER), "packing": SHALLOW},
    "sizes alike": {"packing": {"grading": 1}},
    "sizes 1:10": {"packing": {"grading": 10}},
    "sizes 1:4 by mass": {"packing": {"grading": 4, "by_mass": True}},
    "friction 0": {"material": {"friction": 0.0}},
    "friction 1.5": {"material": {"friction": 1.5}},
    "rolling 1": {"material": {"rolling": 1.0}},
    "rolling 1 of the boulder": {"material": {"boulder_rolling": 1.0}},
    "rolling 5": {"material": {"rolling": 5.0}},
    "damping 0": {"material": {"damping": 0.0}},
    "damping 1": {"material": {"damping": 1.0}},
    "damping 2": {"material": {"damping": 2.0}},
    "damping 10": {"material": {"damping": 10.0}},
    "no loss at all": {"material": ELASTIC},
    "poisson 0": {"material": {"poisson": 0.0}},
    "poisson 0.499": {"material": {"poisson": 0.499}},
    "poisson -0.9": {"material": {"poisson": -0.9}},
    "angle 1": {"impact": {"angle": [1, 1, 1]}},
    "angle 90, spin 0": {"impact": {"angle": [90, 90, 90], "spin": [0, 0, 0]}},
    "spin -10": {"impact": {"spin": [-10, -10, -10]}},
    "spin 10": {"impact": {"spin": [10, 10, 10]}},
    "gravity 0.1": {"packing": {"gravity": 0.1}},
    "gravity 100": {"packing": {"gravity": 100.0}},
    "light sphere": {"impact": {"density": 100.0}},
    "heavy sphere": {"impact": {"density": 20000.0}},
    "depth 1": {"packing": {"depth": 1}},
    "rigid base": {"packing": {"rigid_base": True}},
    "base_speed 0": {"packing": {"base_speed": 0.0}},
    "base_speed 1e5": {"packing": {"base_speed": 1e5}},
    "loose, friction 1": {"packing": {"friction": 1.0}},
    "step x 4": {"impact": {"step_factor": 4.0}},
    "step x 100": {"impact": {"step_factor": 100.0}},
    "step x 100, 9 retries": {"impact": {"step_factor": 100.0, "retries": 9}},
    "young 1e7, speed 100": {"material": {"young": 1e7}, "impact": speed(100.0)},
    "young 1e7, gravity 100": {"material": {"young": 1e7}, "packing": {"gravity": 100.0}},
    "young 1e11, speed 100": {"material": {"young": 1e11}, "impact": speed(100.0), "lab": FEW},
    "young 1e11, speed 0.1": {"material": {"young": 1e11}, "impact": speed(0.1), "lab": FEWER},
    "1e11, no loss at all": {"material": ELASTIC | {"young": 1e11}, "lab": FEW},
    "R_b/R_m 0.5, speed 100": {"lab": ratio(0.5), "impact": speed(100.0)},
    "R_b/R_m 0.5, depth 1": {"lab": ratio(0.5), "packing": {"depth": 1}},
    "spin 10, friction 1.5": {"material": {"friction": 1.5}, "impact": {"spin": [10, 10, 10]}},
    "damping 1, speed 100": {"material": {"damping": 1.0}, "impact": speed(100.0)},
}  # fmt: skip


def energy(data, when: str):
    t, n, w = (data[f"{v}_{when}"] for v in ("vt", "vn", "w"))
    return t**2 + n**2 + INERTIA_FACTOR * w**2


def velocities(data, when: str) -> np.ndarray:
    return np.stack([data[f"{v}_{when}"].values for v in ("vt", "vn", "w")], axis=-1)


def step_error(case: LabCase, data) -> float:
    """Median change of V_out by halving the step, relative to |V_in|, over the first layer."""
    step = case.impact["step_factor"] / 2
    half = run_impacts(case.replace(lab={"layers": 1}, impact={"step_factor": step}))
    data = data.isel(layer=slice(1))
    results = [STATUS[name] for name in ENDED]
    both = data["status"].isin(results).values & half["status"].isin(results).values
    change = np.linalg.norm(velocities(data, "peak") - velocities(half, "peak"), axis=-1)
    share = (change / np.linalg.norm(velocities(data, "in"), axis=-1))[both]
    return float(np.median(share)) if share.size else np.nan


def fire(case: LabCase) -> tuple[str, bool]:
    """Text about the impacts of a case, and whether a limit is exceeded."""
    data = run_impacts(case)
    status, trouble = data["status"], data["trouble"].values
    ended = status.isin([STATUS[name] for name in ENDED])
    counts = "".join(f"{int((status == STATUS[name]).sum()):10d}" for name in ENDS)
    nan = sum(int((~np.isfinite(data[name]) & ended).sum()) for name in names("outcome"))
    fall = data["depth"] + data["top"] - data["surface"]
    before, after = energy(data, "in").where(ended), energy(data, "peak").where(ended)
    raw = float((after / before).max())
    gain = float((after / (before + 2 * case.packing["gravity"] * fall.clip(0))).max())
    words = [
        f"{int((trouble == k).sum())} {_lab.trouble_text(k).decode().split(':')[0]}"
        for k in np.unique(trouble[trouble > 0])
    ]
    unnamed = int(((trouble > 0) != (status == STATUS["exploded"]).values).sum())
    broken = gain > 1 + TOLERANCE or nan > 0 or unnamed > 0
    numbers = [
        f"{float(data['halvings'].mean()):9.2f}{raw:8.2f}{gain:11.2f}{step_error(case, data):9.4f}",
        f"{float(data['overlap'].where(ended).max()):9.3f}{nan:5d}{unnamed:9d}",
        f"{1e3 * data.attrs['cpu_seconds'] / status.size:8.1f}  {'BROKEN  ' * broken}",
    ]
    return f"{status.size:8d}{counts}{''.join(numbers)}{', '.join(words)}", broken


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", metavar="WORD", default="", help="rows with this in their name")
    only = parser.parse_args().only
    print(machine(), "\n")
    head = f"{'changed':28}{'impacts':>8}" + "".join(f"{name:>10}" for name in ENDS)
    head += f"{'halvings':>9}{'out/in':>8}{'with fall':>11}{'by step':>9}{'overlap':>9}{'NaN':>5}"
    print(f"{head}{'unnamed':>9}{'CPU ms':>8}  troubles")
    broken = []
    for name, change in CHANGES.items():
        if only not in name:
            continue
        try:
            row, bad = fire(BASE.replace(**change))
        except RockfallError as error:
            row, bad = f"  {error}", False
        print(f"{name:28}{row}", flush=True)
        broken += [name] * bad
    print(f"\nbounds broken: {', '.join(broken)}" if broken else "\nno bound was broken")
    sys.exit(bool(broken))


if __name__ == "__main__":
    main()
