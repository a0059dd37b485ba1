# SPDX-License-Identifier: BSD-3-Clause
"""Cost and effect of laboratory settings: error against run time.

    python -m lab.benchmarks.error [LAB.nml] [--layers 12] [--ratio 2] [--only WORD]

Runs a laboratory case at one ratio, and again with single changes and the same seed. Prints a1 and
a4 with standard errors, the neutral slopes by the set and by resampled impacts, the solid fraction,
and CPU milliseconds per impact, including its share of the layer. If layers and shots are
unchanged, also prints the median and 90 % quantile of |V_out - V_out,base| / |V_in| at the peak.
"""

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.machine import ROOT, machine
from rockfall.analysis.planes.plane_bounce import neutral_slope, set_rebound
from rockfall.errors import RockfallError
from rockfall_lab.case import LabCase, read_lab_case
from rockfall_lab.sets.fit import as_rebounds, fit_set, impacts_of
from rockfall_lab.sets.resampled import resampled_rebound
from rockfall_lab.spheres.experiment import ENDED, STATES, STATUS, run_impacts

ROCKY_SLOPE = ROOT / "lab/cases/rocky-slope/lab.nml"
BASE = "base"


def variants(case: LabCase) -> dict[str, dict[str, dict[str, Any]]]:
    """Changes of the case by the name of each variant; "x 2" in a name means that the value is
    doubled."""

    def times(group: str, key: str, factor: float) -> dict[str, dict[str, Any]]:
        return {group: {key: getattr(case, group)[key] * factor}}

    return {
        BASE: {},
        "step x 0.5": times("impact", "step_factor", 0.5),
        "step x 2": times("impact", "step_factor", 2),
        "another seed": {"lab": {"seed": case.lab["seed"] + 1}},
        "width x 1.5": times("packing", "width", 1.5),
        "depth x 1.67": times("packing", "depth", 5 / 3),
        "rigid base": {"packing": {"rigid_base": not case.packing["rigid_base"]}},
        "base_speed x 2": times("packing", "base_speed", 2),
        "R_m 1 cm": {"packing": {"mean_radius": 0.01}},
        "past 0.25": {"impact": {"past": 0.25}},
        "wait x 4": times("impact", "wait", 4),
        "patience x 2": times("impact", "patience", 2),
        "young x 10": times("material", "young", 10),
        "damping 0": {"material": {"damping": 0.0}},
    }


def peak_change(data, base) -> str:
    """Median and 90 % quantile of the relative change of V_out, as text, for impacts that ended in
    both runs; empty for the base itself, or if shots or layers differ."""
    same = data["status"].shape == base["status"].shape and all(
        np.array_equal(data[name], base[name]) for name in ("surface", "vt_in")
    )
    if data is base or not same:
        return ""
    results = [STATUS[name] for name in ENDED]
    both = data["status"].isin(results).values & base["status"].isin(results).values
    square = sum((data[f"{v}_peak"] - base[f"{v}_peak"]).values ** 2 for v in ("vt", "vn", "w"))
    share = (np.sqrt(square) / base["speed"].values)[both]
    return "{:9.4f}{:9.4f}".format(*np.quantile(share, [0.5, 0.9]))


def numbers(data, ratio: float, state: str) -> str:
    impacts = as_rebounds(impacts_of(data, ratio, state))
    found = fit_set(impacts)
    slopes = (
        neutral_slope(set_rebound(found.mean, found.covariance)),
        neutral_slope(resampled_rebound(impacts.v_in, impacts.v_out)),
    )
    a1, a4 = (f"{found.mean[k]:.3f} +- {found.mean_error[k]:.3f}" for k in (0, 3))
    return f"{a1:>18}{a4:>18}{slopes[0]:8.1f}{slopes[1]:9.1f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("case", metavar="LAB.nml", nargs="?", type=Path, default=ROCKY_SLOPE)
    parser.add_argument("--layers", type=int, default=12)
    parser.add_argument("--ratio", type=float, default=2.0)
    parser.add_argument("--only", metavar="WORD", default="", help="variants with this in the name")
    options = parser.parse_args()
    case = read_lab_case(options.case).replace(
        lab={"layers": options.layers, "ratios": [options.ratio]}
    )
    print(machine())
    print(f"{options.case}: R_b/R_m = {options.ratio:g}, {options.layers} layers\n")
    print(f"{'changed':18}{'CPU ms':>8}{'solid':>7}{'exploded':>9}{'a1':>18}{'a4':>18}", end="")
    print(f"{'neutral':>8}{'by data':>9}{'median':>9}{'90 %':>9}")
    base = None
    for name, change in variants(case).items():
        if name != BASE and options.only not in name:
            continue
        try:
            data = run_impacts(case.replace(**change))
        except RockfallError as error:
            print(f"{name:18}  {error}")
            continue
        base = data if base is None else base
        cost = 1000 * data.attrs["cpu_seconds"] / data["status"].size
        exploded = float((data["status"] == STATUS["exploded"]).mean())
        row = f"{name:18}{cost:8.0f}{float(data['solid'].mean()):7.3f}{exploded:9.2%}"
        row += numbers(data, options.ratio, "peak") + peak_change(data, base)
        print(row, flush=True)
    for state in [state for state in STATES if state != "peak"]:
        print(f"{'state ' + state:42}{numbers(base, options.ratio, state)}")


if __name__ == "__main__":
    main()
