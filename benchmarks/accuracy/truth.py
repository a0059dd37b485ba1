# SPDX-License-Identifier: BSD-3-Clause
"""The kernel compared with 50-digit arithmetic, contact by contact and from release to rest.

    python -m benchmarks.accuracy.truth [DEM...] [--boulders 1000] [--slope 50] [--processes 2]

On `cases/vaujany` by methods B and A, and on each DEM with boulders from cells steeper than
`--slope` degrees. tests/reference/reference.py is the model in plain Python with 50 digits;
replay.py does the comparison and explains the bounds. The exit status is 1 if an error exceeds its
bound, a boulder deviates from the model, more than 1 in 10,000 contacts is decided by rounding, or
the ends and speeds of all boulders differ from the reference.
"""

import argparse
import math
import sys
import time
from multiprocessing import get_context
from pathlib import Path

import numpy as np

import reference
import replay
import rockfall
from benchmarks.machine import ROOT, machine
from benchmarks.stability.real_terrain import steep_cells
from rockfall.io.rasters.dem import read_dem
from rockfall.result.crossings import at_lines
from rockfall.scene.read import read_scene
from rockfall.scene.scene import Scene
from rockfall.simulation.simulate import run_scene

VAUJANY = ROOT / "cases/vaujany"
CASES = "case.nml", "case_A.nml"
PARTED = 0.001  # distance from which paths differ [m]
ALIKE = 0.001  # minimum p of a Kolmogorov-Smirnov test
MOST_UNDECIDED = 1e-4  # maximum fraction of contacts decided by rounding
TABLE_ERROR = 1e-10  # error of the kernel's normal numbers, as stated in rockfall_random
shared = {}  # data for forked processes


def vaujany(name: str, boulders: int) -> Scene:
    """Scene of the experimental slope, from the case file `name`, that records the trajectories of
    all `boulders`."""
    case = rockfall.read_case(VAUJANY / name)
    output = {"trajectories": boulders, "maps": None, "rebounds": False}
    return read_scene(case.replace(case={"boulders": boulders}, output=output))


def real(path: Path, boulders: int, slope: float) -> Scene:
    """Case with one boulder from each of `boulders` steep cells."""
    z, grid = read_dem(path)
    rows, columns = np.nonzero(steep_cells(z, grid.cell, slope))
    if not rows.size:
        sys.exit(f"{path}: no cell is steeper than {slope:g} degrees")
    these = np.linspace(0, rows.size - 1, boulders).astype(int)
    case = rockfall.Case(
        case={"boulders": 1, "title": path.name},
        terrain={"dem": path.resolve()},
        surface={"uniform_mean_radius": 0.25},
        impact={"sets": "vaujany-observed", "rest_angle": 90.0},  # only flights are compared
        boulder={"volume": "lognormal", "volume_mean": 1.0, "volume_std": 1.0},
        release={"x": grid.x[columns[these]].tolist(), "y": grid.y[rows[these]].tolist(),
                 "drop_height": 2.0},
        output={"trajectories": boulders},
    )  # fmt: skip
    return read_scene(case)


def both(number: int) -> tuple[replay.Replay, replay.Retrace]:
    """Comparisons of a boulder with the reference: by contact, and from its release."""
    world, rows = shared["world"], shared["tracks"][number - 1]
    return replay.replay(world, number, rows, shared["result"]), replay.retrace(world, number, rows)


def examine(scene: Scene, processes: int) -> bool:
    """Print a scene's tables; True if errors, undecided contacts and p-values are within bounds."""
    scene = replay.at_origin(scene)
    result = run_scene(scene)
    shared.update(world=replay.world_of(scene), tracks=replay.tracks(result), result=result)
    began = time.perf_counter()
    with get_context("fork").Pool(processes) as pool:
        found = pool.map(both, range(1, scene.boulders + 1), chunksize=8)
    replays, retraces = zip(*found, strict=True)
    contacts = sum(len(one.contacts) for one in replays)
    undecided = sum(one.undecided for one in replays)
    faults = [fault for one in replays for fault in one.faults]
    print(
        f"\n{scene.case.case['title']}: {scene.boulders} boulders, {contacts} contacts judged",
        end="",
    )
    print(f" in {time.perf_counter() - began:.0f} s; {undecided} decided by roundings")
    for fault in faults:
        print(f"  {fault}")
    shares = local_table(replays)
    right = not faults and max(shares) <= 1 and undecided <= MOST_UNDECIDED * contacts
    right &= global_table(scene, result, retraces)
    sys.stdout.flush()
    return right


def local_table(replays: list[replay.Replay]) -> list[float]:
    """Print the errors of each quantity; return their maximum fractions of the bounds."""
    print(f"  {'one flight and rebound':24}{'':6}{'median':>9}{'99 %':>9}{'worst':>9}", end="")
    print(f"{'ulps: median':>14}{'99 %':>9}{'worst / bound':>15}")
    groups = [
        (replay.QUANTITIES, [one for boulder in replays for one in boulder.contacts]),
        (replay.CROSSED, [one for boulder in replays for one in boulder.crossings]),
        (dict.fromkeys(replay.TOTALS, ""), [one.totals for one in replays]),
    ]
    shares = []
    for names, rows in groups:
        for k, (name, unit) in enumerate(names.items()):
            errors = [row[k] for row in rows if k < len(row)]
            if not errors:
                continue
            sizes = np.array([one.size for one in errors])
            ulps = sizes / [one.ulp for one in errors]
            shares.append(max(one.share for one in errors))
            row = [*np.quantile(sizes, [0.5, 0.99, 1]), *np.quantile(ulps, [0.5, 0.99])]
            print(f"  {name:24}{unit:6}{row[0]:9.1e}{row[1]:9.1e}{row[2]:9.1e}", end="")
            print(f"{row[3]:14.1f}{row[4]:9.1f}{shares[-1]:15.2g}")
    return shares


def global_table(scene: Scene, result, retraces: list[replay.Retrace]) -> bool:
    """Print the deviations of boulders from the reference; return True if their distributions
    agree."""
    from scipy.stats import ks_2samp

    n = len(retraces)
    print("  from the release to the end, the reference by itself")
    longest = max(len(one.apart) for one in retraces)
    apart = np.full((n, longest), np.nan)
    for row, one in zip(apart, retraces, strict=True):
        row[: len(one.apart)] = one.apart
    for k in (1, 5, 10, 20, 30, 50, 100, 200):
        here = apart[:, k - 1][~np.isnan(apart[:, k - 1])] if k <= longest else np.empty(0)
        if here.size > n / 20:
            low, high = np.quantile(here, [0.5, 0.95])
            print(f"    contact {k:4}: apart {low:.1e} m (median), {high:.1e} m (95 %)", end="")
            print(f", more than {PARTED} m {(here > PARTED).mean():.1%}, of {here.size}")
    print(f"    grows by a factor of {growth(apart):.2f} a contact (median)")
    parted = (apart > PARTED).any(axis=1)
    status = [replay.status_of(result, k) for k in range(1, n + 1)]
    ends = sum(a == b.status for a, b in zip(status, retraces, strict=True))
    stops = np.array([one.stop for one in retraces])
    kernel = np.stack([result["stop_x"].values, result["stop_y"].values], axis=1)
    near = np.hypot(*(stops - kernel).T) < PARTED
    impacts = sum(
        int(a) == b.impacts for a, b in zip(result["impacts"].values, retraces, strict=True)
    )
    print(f"    of {n} boulders {parted.sum()} part by more than {PARTED} m on their way;", end="")
    print(f" the same end {ends}, number of contacts {impacts}, place of the end {near.sum()}")
    starts = np.stack([result["start_x"].values, result["start_y"].values], axis=1)
    tests = {"run-out": (np.hypot(*(kernel - starts).T), np.hypot(*(stops - starts).T))}
    for k, line in enumerate(scene.case.line):
        ours, theirs = (
            at_lines(result)["line_speed"].values[k],
            np.array([one.speeds[k] for one in retraces]),
        )
        tests[f"speed at {line['name']}"] = ours[~np.isnan(ours)], theirs[~np.isnan(theirs)]
    right = True
    for name, (ours, theirs) in tests.items():
        if min(ours.size, theirs.size) < 2:
            right &= ours.size == theirs.size
            continue
        p = ks_2samp(ours, theirs, method="asymp").pvalue
        right &= p >= ALIKE
        print(f"    {name}: n {ours.size} and {theirs.size}, mean {ours.mean():.3f} and", end="")
        print(f" {theirs.mean():.3f}, Kolmogorov-Smirnov p {p:.3f}")
    return right


def growth(apart: np.ndarray) -> float:
    """Factor per contact by which paths diverge, from the median slope of log(apart) while their
    distance is between rounding and one millimetre."""
    slopes = []
    for row in apart:
        good = np.flatnonzero((row > 1e-14) & (row < PARTED))
        if good.size > 5:
            slopes.append(np.polyfit(good, np.log(row[good]), 1)[0])
    return math.exp(np.median(slopes)) if slopes else math.nan


def table_error() -> float:
    """Maximum difference of the kernel's normal numbers from the true quantile."""
    worst = 0.0
    for octave in range(32):
        for share in np.linspace(1, 2, 97)[:-1]:
            word = int(share * 2**octave) // 2  # its tail is (2 word + 1)/2**33
            tail = reference.uniform(word)
            worst = max(worst, float(abs(reference.normal(word) + reference.quantile(tail))))
    return worst


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("dem", nargs="*", type=Path)
    parser.add_argument("--boulders", type=int, default=1000)
    parser.add_argument("--slope", type=float, default=50.0)
    parser.add_argument("--processes", type=int, default=2)
    options = parser.parse_args()
    print(machine())
    error = table_error()
    print(f"normal numbers: quintic pieces against the quantile {error:.1e} ({TABLE_ERROR:.0e})")
    right = error <= TABLE_ERROR
    scenes = [lambda name=name: vaujany(name, options.boulders) for name in CASES]
    for path in options.dem:
        scenes.append(lambda path=path: real(path, options.boulders, options.slope))
    for scene in scenes:
        right &= examine(scene(), options.processes)
    print("\nall within their bounds" if right else "\nBEYOND A BOUND")
    return 0 if right else 1


if __name__ == "__main__":
    sys.exit(main())
