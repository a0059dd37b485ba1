"""Runs this case by methods A and B and sets the results beside those printed in the paper.

`./run demo`, or `python cases/vaujany/demo.py [FOLDER]` where rockfall is installed.
"""

import csv
import sys
from pathlib import Path

import numpy as np

import rockfall
from rockfall.plots import line_figure, overview
from rockfall.rasters import read_dem

HERE = Path(__file__).parent
CASES = {"A": HERE / "case_A.nml", "B": HERE / "case.nml"}
QUANTITIES = {  # label, digits
    "speed": ("speed [m/s]", 1),
    "passing_height": ("passing height [m]", 1),
    "energy_translational": ("E_trans [kJ]", 0),
    "rotational_share": ("E_rot / E_tot", 2),
}


def printed() -> dict:
    """The numbers of the paper: (line, quantity, method) -> mean, standard deviation, maximum."""
    with open(HERE / "paper.csv", encoding="utf-8") as file:
        return {
            (row["line"], row["quantity"], row["method"]): tuple(
                float(row[key] or "nan") for key in ("mean", "std", "max")
            )
            for row in csv.DictReader(file)
        }


def simulated(results: dict) -> dict:
    """The same of our runs."""
    found = {}
    for method, result in results.items():
        table = rockfall.line_statistics(result).set_index(["line", "quantity"])
        for line in result["line"].values:
            for quantity in ("speed", "passing_height", "energy_translational"):
                row = table.loc[(line, quantity), ["mean", "std", "max"]].astype(float)
                scale = 1e-3 if quantity == "energy_translational" else 1.0
                found[line, quantity, method] = tuple(scale * row)
            at = result.sel(line=line)
            rotation, motion = at["line_energy_rotational"], at["line_energy_translational"]
            share = (rotation / (rotation + motion)).values
            statistics = np.nanmean(share), np.nanstd(share, ddof=1), np.nanmax(share)
            found[line, "rotational_share", method] = statistics
    return found


def print_comparison(ours: dict, paper: dict) -> None:
    """One row for each line, quantity and method: mean, standard deviation, maximum."""
    print(f"\n{'':34}{'this run':^21}{'the paper':>17}{'mean':>15}")
    print(f"{'':34}" + 2 * f"{'mean':>7}{'std':>7}{'max':>7}   " + "differs")
    for line, quantity in dict.fromkeys(key[:2] for key in ours):
        label, digits = QUANTITIES[quantity]
        name = f"{line}  {label}"
        for method in "A", "B", "observed":
            mine, theirs = (numbers.get((line, quantity, method)) for numbers in (ours, paper))
            if not mine and not theirs:
                continue
            numbers = "   ".join(_three(three, digits) for three in (mine, theirs))
            differs = f"{mine[0] / theirs[0] - 1:+7.0%}" if mine and theirs else ""
            print(f"{name:25}{method:9}{numbers}   {differs}".rstrip())
            name = ""


def _three(numbers: tuple | None, digits: int) -> str:
    shown = numbers or 3 * (float("nan"),)
    return "".join(f"{n:7.{digits}f}" if np.isfinite(n) else f"{'-':>7}" for n in shown)


def print_run(method: str, result) -> None:
    """Where the boulders went, how the draws fared and what it cost."""
    print(f"\nMethod {method}: {result.sizes['boulder']:,} boulders")
    for line in result["line"].values:
        passing = result["line_x"].sel(line=line).notnull().mean()
        print(f"  {'pass ' + line:16}{float(passing):8.1%}")
    status = result["status"]
    names = status.attrs["flag_meanings"].split()
    for value, name in zip(status.attrs["flag_values"], names, strict=True):
        print(f"  {name.replace('_', ' '):16}{int((status == value).sum()):8,}")
    rebounds = int(result["rebounds"])
    redrawn, forced = int(result["rebounds_redrawn"]), int(result["rebounds_forced"])
    print(f"  {rebounds:,} rebounds, {redrawn / rebounds:.1%} redrawn, {forced:,} forced")
    print(f"  {result.attrs['wall_seconds']:.1f} s, {result.attrs['cpu_seconds']:.1f} s of CPU")


def main(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    results = {}
    for method, case in CASES.items():
        results[method] = rockfall.run(rockfall.read_case(case), progress=True)
        rockfall.write_result(results[method], folder / f"method_{method}.nc")
    paper = printed()
    for method, result in results.items():
        print_run(method, result)
    print_comparison(simulated(results), paper)
    if results["A"]["stop_x"].equals(results["B"]["stop_x"]):
        print("A and B coincide: the impact set is the same for all ratios R_b/R_m (see README.md)")

    dem, grid = read_dem(HERE / "dem.tif")
    overview(results["B"], dem, grid, folder / "overview.png")
    reference = {(ln, m, q): numbers[:2] for (ln, q, m), numbers in paper.items()}
    line_figure(results["A"], results["B"], reference, folder / "lines.png")
    print(f"\nResults and figures: {folder}")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else HERE.parents[1] / "out" / "vaujany")
