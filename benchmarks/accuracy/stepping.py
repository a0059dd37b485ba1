# SPDX-License-Identifier: BSD-3-Clause
"""Exact flights compared with flights in time steps, as in other programs: error against CPU time.

    python -m benchmarks.accuracy.stepping [--boulders 20000] [--repeat 3] [--dem DEM] [-o FOLDER]

Builds another kernel in a temporary folder, with the product's flags and with
`benchmarks/accuracy/stepped_flight.f90` as the flight. Rebound, turn, random numbers and terrain
are unchanged. After each step a boulder is compared with the bilinear surface. There are three
schemes:

    euler         velocity first, then position from the new velocity (symplectic Euler)
    parabola      exact parabola, evaluated only at the steps
    interpolated  the same, then back to where the interpolated height is zero

In the first two schemes, a boulder lands at the first point below the ground and is lifted
vertically. Open programs use these or similar schemes: PlatRock 3D (Euler in its source of 2019,
later the parabola, steps of 0.02 s by default), rust_rockfall (parabola, 0.02 s in a validation
case) and rockfall2d-sim (Euler, 0.005 s). STONE solves for the contact with a triangle, without
steps. No program is known to use the third scheme, the best of equal cost.

Runs cases/plane, where every contact is known in closed form, and cases/vaujany, with the same seed
and boulders for all schemes; with --dem also a terrain, with one boulder from each cell above 50
degrees. -o writes FOLDER/stepping.csv and FOLDER/stepping.png. CPU times are minima of --repeat
runs on one thread. On a busy machine only their ratios are meaningful.
"""

from __future__ import annotations

import argparse
import importlib.util
import math
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

import rockfall
from benchmarks import variant
from benchmarks.machine import NOTHING, ROOT, VAUJANY, machine
from benchmarks.stability.real_terrain import steep_cells
from rockfall.io.atomic import atomic_write
from rockfall.io.rasters.dem import read_dem
from rockfall.plots.style import BLUE, GREY, INK, STYLE, VERMILION
from rockfall.result.crossings import at_lines, line_names
from rockfall.scene.prepare import prepare

SCHEMES = {"euler": (BLUE, "o"), "parabola": (VERMILION, "s"), "interpolated": (GREY, "^")}
STEPS = [0.1, 0.03, 0.01, 0.003, 0.001]  # time steps [s]
ONE_FLIGHT = {  # printed statistics, and their headings
    "place": "landing [m]",
    "normal": "V_n [m/s]",
    "normal_rms": "V_n r.m.s.",
    "gained": "energy",
    "deepest": "deepest [m]",
    "short": "short",
    "missed": "missed",
}
Samples = dict[str, np.ndarray]  # one value per boulder, NaN if it has none
Estimates = dict[str, tuple[float, np.ndarray]]


class Run(NamedTuple):
    """Run with its scheme, step [s], printed output, and result."""

    scheme: str
    step: float
    printed: dict[str, float]
    result: xr.Dataset | None

    def cost(self) -> float:
        """CPU nanoseconds per rebound."""
        return 1e9 * self.printed["cpu"] / self.printed["contacts"]


# Program


def build(folder: Path) -> Path:
    """Build the kernel with stepped flights; return the program."""
    variant.copy_sources(folder)
    variant.go_one_by_one(folder)
    source = folder / "fortran/src"
    exact = (source / "boulder/flight.f90").rename(source / "exact_flight.f90")
    variant.replace(exact, "module rockfall_flight", "module exact_flight", 2)
    meson = folder / "fortran/meson.build"
    modules = "'src/exact_flight.f90', '../benchmarks/accuracy/stepped_flight.f90'"
    variant.replace(meson, "'src/boulder/flight.f90'", modules, 1)
    source, needs = "../benchmarks/accuracy/stepping.f90", "link_with: [batch, kernel]"
    with open(meson, "a") as file:
        file.write(f"executable('stepping', '{source}', {needs}, dependencies: netcdf)\n")
    return variant.build(folder, "fortran/stepping")[0]


def run(program: Path, case: Path, repeat: int, flights: int) -> list[Run]:
    """Run a prepared case exactly, then by all schemes and steps; flights of the first boulders are
    compared one by one."""
    runs = []
    for scheme, step in [("exact", 0.0), *((s, dt) for s in SCHEMES for dt in STEPS)]:
        part = case.parent / f"{scheme}_{step:g}"
        words = case, case.with_name("scene.nc"), scheme, step, repeat, flights, part
        command = [program, *map(str, words)]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode:
            sys.exit(f"{scheme}, step {step:g} s: {done.stderr}")
        printed = {name: float(value) for name, value in map(str.split, done.stdout.splitlines())}
        try:
            result = rockfall.merge([part])
        except rockfall.RockfallError:  # refused: a step left the terrain
            result = None
        runs.append(Run(scheme, step, printed, result))
    return runs


def check_exact(exact: Run, case: rockfall.Case) -> None:
    """Stop unless paths, times, speeds and impacts of the exact run equal the product's bits."""
    product = rockfall.run(case)
    for name in ("path_length", "travel_time", "speed_max", "impacts"):
        if not np.array_equal(exact.result[name], product[name]):
            sys.exit(f"{name}: the exact run differs from that of rockfall.run")


# Results of a run


def line_samples(result: xr.Dataset, line: str) -> Samples:
    """Speed and passing height of each boulder at a line."""
    there = result.isel(line=line_names(result).index(line))
    return {name: at_lines(there)[f"line_{name}"].values for name in ("speed", "passing_height")}


def boulder_samples(result: xr.Dataset) -> Samples:
    return {name: result[name].values for name in ("plan_distance", "speed_max")}


def estimates(samples: Samples) -> Estimates:
    """Passing fraction, mean and standard deviation of each quantity, and each boulder's influence
    on them, for standard errors of paired differences."""
    found: Estimates = {}
    for name, v in samples.items():
        there = ~np.isnan(v)
        share = there.mean()
        found["share"] = share, there - share
        if not there.any():
            found[f"{name} mean"] = found[f"{name} std"] = np.nan, v
            continue
        mean, std = v[there].mean(), v[there].std()
        off = np.where(there, v - mean, 0.0)
        found[f"{name} mean"] = mean, off / share
        found[f"{name} std"] = std, np.where(there, (off**2 - std**2) / (2 * std), 0.0) / share
    return found


def difference(one: Estimates, other: Estimates, name: str) -> tuple[float, float]:
    """Difference of an estimate between two runs of the same boulders, with its standard error."""
    moved = one[name][1] - other[name][1]
    return one[name][0] - other[name][0], moved.std() / math.sqrt(moved.size)


# Scenes


def examine(title: str, runs: list[Run], places: dict[str, list[Samples]]) -> Iterator[dict]:
    """Print the cost of the runs and their differences from the first, exact run. Yield rows of the
    table. `places` has the samples of every run."""
    print(f"\n{title}\n{'':22}{'CPU ns a rebound':>18}{'CPU us a boulder':>18}{'rebounds':>10}")
    boulders = next(iter(next(iter(places.values()))[0].values())).size
    for one in runs:
        contacts = one.printed["contacts"] / boulders
        cost = one.cost(), 1e6 * one.printed["cpu"] / boulders, contacts
        print(f"{label(one)}{cost[0]:18.0f}{cost[1]:18.1f}{cost[2]:10.1f}")
        what = ("CPU ns a rebound", "CPU us a boulder", "rebounds a boulder")
        for name, value in zip(what, cost, strict=True):
            yield row(title, one, name, value)
    for place, samples in places.items():
        found = [estimates(one) for one in samples]
        names = [name for name in found[0] if name != "passing_height std"]
        names = [name for name in names if name != "share" or found[0][name][0] < 1]
        print(f"\n{place}: value of the exact flight, then differences from it, ± standard error")
        print(f"{'':22}" + "".join(f"{name.replace('_', ' '):>23}" for name in names))
        print(label(runs[0]) + "".join(f"{found[0][name][0]:23.4g}" for name in names))
        for name in names:
            yield row(title, runs[0], f"{place} {name}", found[0][name][0])
        for one, own in zip(runs[1:], found[1:], strict=True):
            parts = [difference(own, found[0], name) for name in names]
            print(label(one) + "".join(f"{d:+14.4f} ± {e:<6.4f}" for d, e in parts))
            for name, (d, e) in zip(names, parts, strict=True):
                yield row(title, one, f"{place} {name} difference", d, e)
    yield from flights(title, runs)


def flights(title: str, runs: list[Run]) -> Iterator[dict]:
    """Print and yield the errors of single flights with the same start as exact flights."""
    number = int(runs[1].printed["flights"])
    print(
        f"\nErrors of one flight from the same start, over {number} flights: place of the landing,"
    )
    print(
        "r.m.s.; normal speed there, mean and r.m.s.; energy gained, share of that at the landing;"
    )
    print("depth there. Shares of flights shorter than a step, and whose first contact no step saw")
    print(f"{'':22}" + "".join(f"{head:>13}" for head in ONE_FLIGHT.values()))
    for one in runs[1:]:
        print(label(one) + "".join(f"{one.printed[key]:13.2g}" for key in ONE_FLIGHT))
        for key, head in ONE_FLIGHT.items():
            yield row(title, one, f"one flight: {head}", one.printed[key])


def label(one: Run) -> str:
    return f"{one.scheme:14}" + (f"{one.step:6g} s" if one.step else f"{'':8}")


def row(scene: str, one: Run, what: str, value: float, error: float = math.nan) -> dict:
    about = {"scene": scene, "scheme": one.scheme, "step": one.step, "what": what}
    return about | {"value": value, "standard_error": error}


def plane(program: Path, folder: Path, repeat: int) -> tuple[list[Run], list[float]]:
    """Runs of cases/plane, and the distance of the last contact from its closed form [m]; NaN if
    the boulder left the terrain earlier."""
    place = ROOT / "cases/plane"
    spec = importlib.util.spec_from_file_location("closed_form", place / "closed_form.py")
    closed_form = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(closed_form)
    case = rockfall.read_case(place / "case.nml").replace(case={"boulders": 5000})
    dem, grid = read_dem(place / "dem.asc")
    gradient = float(dem[0, 0] - dem[0, -1]) / (grid.cell * (grid.nx - 1))
    number, drop = case.impact["impact_limit"], case.release["drop_height"]
    true = closed_form.contacts(number, gradient, drop).distance[-1]
    prepare(case, folder)
    runs = run(program, folder / "case.nml", repeat, 1)
    errors = []
    for one in runs:
        if one.result is None:
            errors.append(math.nan)
            continue
        contacts = one.result.trajectory_x.values[one.result.trajectory_ratio.values > 0]
        whole = contacts.size == number
        errors.append(abs(contacts[-1] - contacts[0] - true) if whole else math.nan)
    return runs, errors


def examine_plane(runs: list[Run], errors: list[float]) -> Iterator[dict]:
    """Print errors on the plane, and the order of a flight's error in the step; yield rows."""
    title = "cases/plane"
    print(f"\n{title}\n{'':22}{'CPU ns a rebound':>18}{'one landing [m]':>18}", end="")
    print(f"{'100th contact [m]':>20}")
    for one, last in zip(runs, errors, strict=True):
        landing = one.printed.get("place", math.nan)
        chain = "left the terrain" if math.isnan(last) else f"{last:.2g}"
        print(f"{label(one)}{one.cost():18.0f}{landing:18.2g}{chain:>20}")
        yield row(title, one, "CPU ns a rebound", one.cost())
        yield row(title, one, "one flight: landing, r.m.s. [m]", landing)
        yield row(title, one, "100th contact [m]", last)
    for scheme in SCHEMES:
        print(f"{scheme}: error of one landing ~ step to the power {slope(runs, scheme):.2f}")


def slope(runs: list[Run], scheme: str) -> float:
    """Order of the landing error in the step, from a fit of logarithms."""
    some = [one for one in runs if one.scheme == scheme]
    place = [one.printed["place"] for one in some]
    return float(np.polyfit(np.log([one.step for one in some]), np.log(place), 1)[0])


def terrain(dem: Path) -> tuple[rockfall.Case, np.ndarray]:
    """Case with one boulder from each steep cell of a terrain, and these cells."""
    z, grid = read_dem(dem)
    case = rockfall.Case(
        case={"boulders": 1},
        terrain={"dem": dem},
        surface={"uniform_mean_radius": 0.25},
        boulder={"volume": "lognormal", "volume_mean": 1.0, "volume_std": 1.0},
        release={"cells": "cells", "drop_height": 2.0},
    )
    return case, steep_cells(z, grid.cell, 50.0)


def figure(
    flat: list[Run], last: float, rough: list[Run], samples: list[Samples], path: Path
) -> None:
    """Plot the error of a landing on the plane against step and CPU time, and the error of the
    fraction passing the first line of cases/vaujany against CPU time. `last` is the error of the
    last contact on the plane with exact flights [m]."""
    import matplotlib.pyplot as plt

    found = [estimates(one) for one in samples]
    indicator = found[0]["share"][1]
    chance = 100 * 1.96 * indicator.std() / math.sqrt(indicator.size)
    with plt.rc_context(STYLE):
        drawing, axes = plt.subplots(1, 3, figsize=(9.6, 3.4), layout="constrained")
        for scheme, (colour, marker) in SCHEMES.items():
            about = {"color": colour, "marker": marker, "ms": 4.5, "lw": 1}
            some = [one for one in flat if one.scheme == scheme]
            place = [one.printed["place"] for one in some]
            name = f"{scheme} ~ step$^{{{slope(flat, scheme):.1f}}}$"
            axes[0].plot([one.step for one in some], place, label=name, **about)
            axes[1].plot([one.cost() for one in some], place, **about)
            pairs = [
                (one.cost(), 100 * abs(difference(own, found[0], "share")[0]))
                for one, own in zip(rough, found, strict=True)
                if one.scheme == scheme
            ]
            axes[2].plot(*zip(*pairs, strict=True), **about)
        star = {"color": INK, "marker": "*", "ms": 9, "lw": 0}
        axes[0].plot([], [], label="exact (ours), no step", **star)
        drawing.legend(loc="outside lower center", ncols=4)
        axes[1].plot(flat[0].cost(), last, **star)
        axes[1].annotate(
            "exact, after 100 contacts", (flat[0].cost(), last), (7, -3), textcoords="offset points"
        )
        axes[2].axhspan(chance / 100, chance, color=GREY, alpha=0.15, lw=0)
        axes[2].plot(rough[0].cost(), chance, **star)
        words = f"chance with {indicator.size:,} boulders (95 %)"
        axes[2].text(0.98, 0.03, words, transform=axes[2].transAxes, ha="right")
        axes[0].set(title="Plane: one landing", xlabel="step [s]", ylabel="error, r.m.s. [m]")
        axes[1].set(title="Plane: one landing", ylabel="error, r.m.s. [m]")
        axes[2].set(title="Vaujany: share passing EL1", ylabel="error [percentage points]")
        for one in axes:
            one.set(xscale="log", yscale="log")
        axes[2].set_ylim(bottom=chance / 20)
        for one in axes[1:]:
            one.set_xlabel("CPU time of a rebound [ns]")
            one.set_xticks([200, 500, 1000, 2000], ["200", "500", "1000", "2000"])
            one.minorticks_off()
        with atomic_write(path) as part:
            drawing.savefig(part)
        plt.close(drawing)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--boulders", type=int, default=20_000)
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--dem", metavar="DEM", type=Path, help="also on this terrain")
    parser.add_argument("-o", metavar="FOLDER", type=Path, dest="folder")
    options = parser.parse_args()
    print(machine())
    with tempfile.TemporaryDirectory() as place:
        scratch = Path(place)
        program = build(scratch / "source")
        flat, errors = plane(program, scratch / "plane", options.repeat)
        rows = list(examine_plane(flat, errors))

        case = rockfall.read_case(VAUJANY)
        case = case.replace(case={"boulders": options.boulders}, output=NOTHING)
        prepare(case, scratch / "vaujany")
        runs = run(program, scratch / "vaujany/case.nml", options.repeat, 300)
        check_exact(runs[0], case)
        lines = [line["name"] for line in case.line]
        places = {name: [line_samples(one.result, name) for one in runs] for name in lines}
        rows += examine("cases/vaujany", runs, places)

        if options.dem:
            case, cells = terrain(options.dem)
            prepare(case, scratch / "dem", cells=cells)
            real = run(program, scratch / "dem/case.nml", options.repeat, 300)
            samples = {"all boulders": [boulder_samples(one.result) for one in real]}
            rows += examine(options.dem.name, real, samples)
    if options.folder:
        options.folder.mkdir(parents=True, exist_ok=True)
        with atomic_write(options.folder / "stepping.csv") as part:
            pd.DataFrame(rows).to_csv(part, index=False, float_format="%.6g")
        figure(flat, errors[0], runs, places[lines[0]], options.folder / "stepping.png")


if __name__ == "__main__":
    main()
