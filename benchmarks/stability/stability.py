# SPDX-License-Identifier: BSD-3-Clause
"""Extreme scenes and stiff impact sets: numerical errors and their bounds.

    python -m benchmarks.stability.stability [--contacts 1e6] [--only WORD] [--builds PROGRAM...]

Runs every scene of `extremes.py` and prints one table. Builds another kernel in a temporary folder,
where each flight is audited in numbers with a 64-bit mantissa (`stability/audited_flight.f90`), and
`factors`, which draws matrices from covariances. --contacts is the number of audited contacts,
distributed evenly over the scenes. Exit status 1 if a bound is exceeded. --builds only runs the
scenes in several rockfall-batch programs (release, run-time checks, sanitizers), whose results must
be equal.

In every scene, each boulder ends with a status that the scene allows; no required value is NaN or
infinite; no boulder has more energy than at its release; no flight is `off`: below the ground, or
with a contact off its parabola. The bounds are rounding errors of double precision: 4 units in the
last place of the size of the scene (`Scene.size`) for a flight, and 4 units in energy for each
contact.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from decimal import Decimal, localcontext
from pathlib import Path
from typing import NamedTuple

import netCDF4
import numpy as np
import xarray as xr

import rockfall
from benchmarks import variant
from benchmarks.machine import machine
from benchmarks.stability.extremes import EPSILON, SPREAD, Scene, conditioned, diagonal, scenes
from rockfall.result import variables
from rockfall.result.crossings import at_lines
from rockfall.result.motion import are_met
from rockfall.scene.prepare import prepare

UNITS = 4  # units in the last place: bound for a flight, and for the energy of a contact
ALL = {"maps": list(variables.MAP), "rebounds": True}
MOST_BOULDERS = 2_000_000  # maximum number of boulders of an audited scene
TRACED = 100  # boulders per scene whose energy is followed over all contacts


class Row(NamedTuple):
    """Row of the printed table."""

    scene: str
    risk: str
    measure: str
    value: float
    bound: float

    @property
    def holds(self) -> bool:
        return self.value <= self.bound


# Every scene


def run(scene: Scene, folder: Path, boulders: int = 500) -> tuple[rockfall.Case, xr.Dataset]:
    """Run a scene with all outputs; return its case and its result."""
    south = scene.grid.south + scene.grid.cell * scene.z.shape[0] / 3
    ends = [scene.grid.west, scene.grid.west + scene.grid.cell * scene.z.shape[1]]
    case = scene.case(folder, boulders, output=ALL | {"trajectories": TRACED})
    case = case.replace(line=[{"name": "third", "x": ends, "y": [south, south]}])
    return case, rockfall.run(case, **scene.arrays())


def check(scene: Scene, case: rockfall.Case, result: xr.Dataset) -> list[Row]:
    """Rows for the requirements of any scene."""
    about = scene.name, scene.risk
    wrong = without_reason(scene, result) + not_numbers(result)
    gain, bound = energy_gain(scene, case, result)
    return [
        Row(*about, "ends without a reason, numbers that are none", wrong, 0),
        Row(*about, "energy gained [J/kg]", gain, bound),
    ]


def without_reason(scene: Scene, result: xr.Dataset) -> int:
    """Number of boulders with a status that the scene does not allow."""
    allowed = scene.statuses or set(variables.STATUS)
    numbers = [variables.STATUS[name] for name in allowed]
    return int((~np.isin(result.status.values, numbers)).sum())


def not_numbers(result: xr.Dataset) -> int:
    """Values that are NaN or infinite although the result must have a number, or negative although
    impossible."""
    wrong = 0
    crossed = ~np.isnan(at_lines(result)["line_time"].values)
    passed = result.passages.values >= 10
    for name, values in result.data_vars.items():
        if values.dtype.kind != "f":
            continue
        number = np.isfinite(values.values)
        if name.startswith("line_") and values.dims == ("line", "boulder"):
            number = number[crossed]
        elif name in variables.MAP:
            # quantiles need more passages, and maps do not show a maximum energy of zero
            number = (
                number[passed]
                if name.endswith("_mean") and "tree" not in name
                else ~np.isinf(values.values)
            )
        wrong += int((~number).sum())
        if name in ("path_length", "travel_time", "speed_max", "jump_height_max"):
            wrong += int((values.values < 0).sum())
    return wrong


def energy_gain(scene: Scene, case: rockfall.Case, result: xr.Dataset) -> tuple[float, float]:
    """Excess of a boulder's energy at a contact over its energy at release, and the bound of this
    excess, both per mass [J/kg], for the contact nearest to its bound."""
    result = result.isel(
        trajectory_vertex=are_met(result.trajectory_boulder.values, result.trajectory_leg.values)
    )
    names = "boulder", "z", "ratio", "out_t", "out_n", "out_w"
    ways = {name: result[f"trajectory_{name}"].values for name in names}
    speed2 = sum(result[f"trajectory_velocity_{axis}"].values ** 2 for axis in "xyz")
    # a rolling boulder leaves a contact at the mean speed of the roll
    speed2 = np.where(ways["ratio"] != 0, ways["out_t"] ** 2 + ways["out_n"] ** 2, speed2)
    energy = scene.gravity * ways["z"] + (speed2 + 0.4 * ways["out_w"] ** 2) / 2
    first = np.searchsorted(ways["boulder"], ways["boulder"])  # release of each boulder
    contacts = np.maximum(1, np.arange(first.size) - first)
    gain = energy - energy[first]
    bound = UNITS * EPSILON * scene.gravity * scene.size(case) * contacts
    nearest = np.argmax(gain / bound)
    return float(gain[nearest]), float(bound[nearest])


# Audit


def build(folder: Path) -> tuple[Path, Path]:
    """Build `factors` and a rockfall-batch with audited flights; return both programs."""
    variant.copy_sources(folder)
    used = "   use rockfall_flight, only: flight_t, landing_t, span_t, fly, "
    ours = "   use audited_flight, only: fly\n" + used.replace(" fly,", "")
    for name in ("paths", "trajectory"):
        variant.replace(folder / f"fortran/src/trace/{name}.f90", used, ours)
    variant.go_one_by_one(folder)
    flight = "'src/boulder/flight.f90',"
    audited = f"{flight} '../benchmarks/stability/audited_flight.f90',"
    variant.replace(folder / "fortran/meson.build", flight, audited)
    return tuple(variant.build(folder, "fortran/rockfall-batch", "benchmarks/factors"))


def audit(
    program: Path,
    some: list[tuple[Scene, rockfall.Case, xr.Dataset]],
    contacts: float,
    folder: Path,
) -> Iterator[tuple[Row, int]]:
    """Yield for each scene the deviation of flights and the number of audited contacts. Contacts
    that a scene lacks are added to the others."""
    order = sorted(some, key=lambda one: int(one[2].impacts.sum()))
    for k, (scene, case, result) in enumerate(order):
        mean = max(0.1, float(result.impacts.mean()))
        boulders = min(MOST_BOULDERS, contacts / (len(order) - k) / mean)
        off, done = audit_scene(program, scene, max(500, int(boulders)), folder / f"audit{k}")
        contacts = max(0.0, contacts - done)
        bound = UNITS * EPSILON * scene.size(case)
        measured = f"off in {done:,} contacts, at most [m]"
        yield Row(scene.name, scene.risk, measured, off, bound), done


def audit_scene(program: Path, scene: Scene, boulders: int, folder: Path) -> tuple[float, int]:
    """Maximum deviation of the flights in a scene [m], and number of contacts."""
    folder.mkdir()
    case, arrays = scene.case(folder, boulders), scene.arrays()
    prepare(case, folder / "case", **arrays)
    batch(program, folder / "case/case.nml", folder / "out.nc")
    with xr.open_dataset(folder / "out.nc", decode_times=False) as result:
        found = float(result.jump_height_max.max()), int(result.impacts.sum())
    shutil.rmtree(folder)
    return found


def batch(program: Path, case: Path, output: Path) -> None:
    """Run rockfall-batch; stop if it fails."""
    done = subprocess.run([program, case, "-o", output, "--quiet"], capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"{program} {case}: exit status {done.returncode}: {done.stderr}")


# Independently known answers


def contacts_on_plane(
    gradient: float, r_t: float, r_n: float, contacts: int, cell: float, folder: Path
) -> tuple[float, float, float]:
    """Boulder that bounces down a plane with a diagonal matrix, compared with 50-digit arithmetic:
    maximum distance from the true contact [m], path length [m], and relative error of the energy at
    the last contact."""
    z = gradient * cell * np.mgrid[599:-1:-1, 0:4][0]
    start, drop, speed = (1.5 * cell, 590.5 * cell), 5.0, 5.0
    scene = Scene(
        "plane", "", z, cell, points=[start], **diagonal(r_t, r_n),
        groups={
            "release": {"velocity": [0.0, -speed, 0.0], "drop_height": drop},
            "impact": {"stop_speed": 1e-12, "impact_limit": contacts, "turning": "to_aspect"},
            "output": {"trajectories": 1},
        },
    )  # fmt: skip
    result = rockfall.run(scene.case(folder, 1), **scene.arrays())
    y = result.trajectory_y.values[1:]
    out_t, out_n = (result[f"trajectory_out_{axis}"].values for axis in "tn")
    if len(y) < contacts:
        sys.exit(f"plane of gradient {gradient}: ended after {len(y)} of {contacts} contacts")
    off, place, energy = 0.0, Decimal(start[1]), Decimal(0)
    with localcontext(prec=50):
        steps = plane_steps(*map(Decimal, (gradient, r_t, r_n, drop, speed, scene.gravity)))
        for k in range(contacts):
            step, v_t, v_n = next(steps)
            place -= step
            off = max(off, abs(float(Decimal(float(y[k])) - place)))
            energy = v_t * v_t + v_n * v_n
        found = Decimal(float(out_t[contacts])) ** 2 + Decimal(float(out_n[contacts])) ** 2
        return off, float(Decimal(start[1]) - place), abs(float(found / energy - 1))


def plane_steps(
    gradient: Decimal, r_t: Decimal, r_n: Decimal, drop: Decimal, speed: Decimal, g: Decimal
) -> Iterator[tuple[Decimal, Decimal, Decimal]]:
    """Contacts on a plane that descends along y: plan distance [m], and V_t, V_n after the contact
    [m/s], for a release with a speed along y."""
    cosine = 1 / (1 + gradient * gradient).sqrt()
    sine = gradient * cosine
    time = (speed * gradient + (speed * speed * gradient * gradient + 2 * g * drop).sqrt()) / g
    step = speed * time
    v_t, v_n = speed * cosine + g * time * sine, speed * sine - g * time * cosine
    while True:
        v_t, v_n = r_t * v_t, -r_n * v_n
        yield step, v_t, v_n
        time = 2 * v_n / (g * cosine)
        step = (v_t * time + g * sine * time * time / 2) * cosine
        v_t, v_n = v_t + g * sine * time, -v_n


def planes(folder: Path) -> Iterator[Row]:
    """Yield rows for contacts on slopes, and for the drift over thousands of rebounds."""
    for name, gradient, r_n in (
        ("0", 0.0, 0.5), ("1e-12", 2.0**-40, 0.5), ("45", 1.0, 0.5), ("89.9", 572.9375, 0.5)
    ):  # fmt: skip
        off, way, _ = contacts_on_plane(gradient, 0.6, r_n, 50, 16.0, folder)
        size = (600 * 16.0) * (1 + gradient)
        about = f"slope {name}, 50 contacts", "contacts drift from the closed form"
        yield Row(*about, "contact off, at most [m]", off, UNITS * EPSILON * size)
    for gradient, r in ((0.0, 1.0), (0.0, 0.9999), (2.0**-10, 1.0), (2.0**-10, 0.9999)):
        off, way, energy = contacts_on_plane(gradient, r, r, 5000, 1024.0, folder)
        about = f"R_t, R_n = {r}, slope {gradient:.1g}, 5000 contacts", "drift"
        bound = 1000 * UNITS * EPSILON
        yield Row(*about, "energy off per 1000 rebounds [-]", energy / 5, bound)
        yield Row(*about, "place off per way and 1000 rebounds [-]", off / way / 5, bound)


def bowl(scene: Scene, case: rockfall.Case, result: xr.Dataset) -> Row:
    """Row for the energy error of elastic impacts over all flights and contacts."""
    boulder, z = result.trajectory_boulder.values, result.trajectory_z.values
    speed2 = sum(result[f"trajectory_velocity_{axis}"].values ** 2 for axis in "xyz")
    energy = scene.gravity * z + speed2 / 2
    first = np.searchsorted(boulder, boulder)
    # departing boulders have no velocity after a rebound at their end
    inside = np.append(boulder[1:] == boulder[:-1], False)
    contacts = np.arange(first.size) - first
    far = inside & (contacts >= 900)
    drift = np.abs(energy - energy[first])[far] / contacts[far] * 1000
    bound = 1000 * UNITS * EPSILON * scene.gravity * scene.size(case)
    return Row(scene.name, scene.risk, "energy off per 1000 rebounds [J/kg]", drift.max(), bound)


def forced(scene: Scene, result: xr.Dataset) -> Iterator[Row]:
    """Yield rows for a set without admissible draws: each rebound must be forced, counted, and
    satisfy the energy rule."""
    before, after = (
        sum(w * result[f"trajectory_{way}_{axis}"].values ** 2 for axis, w in
            (("t", 1.0), ("n", 1.0), ("w", 0.4)))
        for way in ("in", "out")
    )  # fmt: skip
    met = before > 0
    gain = float((after[met] / before[met] - 1).max())
    uncounted = abs(int(result.rebounds) - int(result.rebounds_forced))
    yield Row(scene.name, scene.risk, "rebounds not counted as forced", uncounted, 0)
    yield Row(scene.name, scene.risk, "energy after / before - 1", gain, UNITS * EPSILON)


def hops(scene: Scene, folder: Path) -> Iterator[Row]:
    """Yield rows for the cost of a boulder with ever shorter hops."""
    limit = 100_000
    case = scene.case(folder, 25, impact={"impact_limit": limit})
    result = rockfall.run(case, **scene.arrays())
    ends = [name for name, k in variables.STATUS.items() if (result.status == k).any()]
    about = scene.name, f"{scene.risk}: work without end"
    most = int(result.impacts.max())
    yield Row(*about, f"contacts of a boulder ({', '.join(ends)})", most, limit)
    cpu = result.attrs["cpu_seconds"] / result.sizes["boulder"]
    yield Row(*about, "CPU of a boulder [s]", cpu, np.inf)


def covariances() -> dict[str, np.ndarray]:
    """Stiff covariances by name."""
    named = {s.name: s.covariance for s in scenes() if s.name.startswith(("covariance", "two"))}
    more = {f"covariance of condition 1e{k}": conditioned(10.0**k) for k in (4, 12, 15)}
    uneven = {"deviations of 1e-12 to 1": np.diag(np.logspace(-24, 0, 9))}
    spread = {"all of 1e-300": np.outer(SPREAD, SPREAD) * 1e-296}
    return named | more | uneven | spread


def factor(program: Path, name: str, c: np.ndarray, draws: int = 200_000) -> Iterator[Row]:
    """Yield rows for the root of a covariance, and for the mean and covariance of matrices drawn
    with it."""
    numbers = " ".join(repr(float(x)) for x in c.ravel())
    done = subprocess.run([program], input=f"{draws} {numbers}", capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"{name}: {done.stdout}{done.stderr}")
    used, *values = done.stdout.split()
    values = np.array(values, float)
    root, mean, product = values[:81].reshape(9, 9).T, values[81:90], values[90:].reshape(9, 9)
    mean, product = mean / draws, product / draws
    greatest = np.abs(c).max()
    away = np.abs(root.astype("g") @ root.T.astype("g") - c).max()
    about = name, "the factor loses what is small, or fails"
    used = "definite" if used == "1" else "semidefinite"
    bound = 10 * UNITS * EPSILON  # sums of nine products
    yield Row(*about, f"L L^T - C, relative ({used})", float(away / (greatest or 1)), bound)
    errors = np.sqrt((np.outer(np.diag(c), np.diag(c)) + c * c) / draws)
    z = [np.abs(mean) / _or_one(np.sqrt(np.diag(c) / draws)), np.abs(product - c) / _or_one(errors)]
    worst = max(float(one.max()) for one in z)
    yield Row(*about, "sampled mean and covariance off [standard errors]", worst, 4.5)


def _or_one(errors: np.ndarray) -> np.ndarray:
    return np.where(errors > 0, errors, 1)


# Identical results


def same_bits(programs: list[Path], folder: Path) -> int:
    """Run every scene in each program; return the number of variables that differ from the first
    program."""
    differing = variables = 0
    for k, scene in enumerate(scenes()):
        place = folder / f"bits{k}"
        place.mkdir()
        case = scene.case(
            place, 100, output=ALL | {"trajectories": 5}, impact={"impact_limit": 200}
        )
        prepare(case, place / "case", **scene.arrays())
        found = []
        for n, program in enumerate(programs):
            batch(program, place / "case/case.nml", place / f"out{n}")
            found.append(content(place / f"out{n}"))
        variables += len(found[0])
        for n, other in enumerate(found[1:], 1):
            names = [name for name in found[0] | other if found[0].get(name) != other.get(name)]
            for name in names:
                print(f"{scene.name}: {name} of {programs[n]} differs")
            differing += len(names)
        shutil.rmtree(place)
    about = f"{variables} variables of {k + 1} scenes from {len(programs)} programs"
    print(f"{about}: {differing} differ")
    return differing


def content(path: Path) -> dict[str, bytes]:
    """Bytes of every variable of a part file."""
    with netCDF4.Dataset(path) as file:
        file.set_auto_maskandscale(False)
        return {name: variable[...].tobytes() for name, variable in file.variables.items()}


# Table


def table(contacts: float, only: str, folder: Path) -> Iterator[Row]:
    """Yield all rows; the audit programs are built first."""
    program, factors = build(folder / "kernel")
    some = []
    for scene in scenes():
        if only not in scene.name:
            continue
        case, result = run(scene, folder)
        some.append((scene, case, result))
        yield from check(scene, case, result)
        if scene.name == "R_t, R_n = 1 in a bowl":
            yield bowl(scene, case, result)
        if scene.name == "no admissible draw":
            yield from forced(scene, result)
        if scene.name.startswith("R_n ="):
            yield from hops(scene, folder)
    if not only:
        yield from planes(folder)
        for name, c in covariances().items():
            yield from factor(factors, name, c)
    done, worst = 0, 0.0
    for row, audited in audit(program, some, contacts, folder):
        done, worst = done + audited, max(worst, row.value)
        yield row
    yield Row("all scenes", f"{done:.3g} contacts", "flight off, at most [m]", worst, np.inf)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--contacts", type=float, default=1e6)
    parser.add_argument("--only", default="", metavar="WORD")
    parser.add_argument("--builds", nargs="+", type=Path, metavar="PROGRAM")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        if options.builds:
            programs = [program.resolve() for program in options.builds]
            sys.exit(1 if same_bits(programs, Path(name)) else 0)
        print(machine(), "\n\n| scene | what could go wrong | measured | value | bound | result |")
        print("| --- | --- | --- | --- | --- | --- |")
        broken = 0
        for row in table(options.contacts, options.only, Path(name)):
            bound = "-" if np.isinf(row.bound) else f"{row.bound:.2g}"
            result = "holds" if row.holds else "**BROKEN**"
            number = f"{row.value:.2g}" if isinstance(row.value, float) else row.value
            print("|", " | ".join([*row[:3], str(number), bound, result]), "|")
            broken += not row.holds
    print(f"\n{broken} bounds broken")
    sys.exit(1 if broken else 0)


if __name__ == "__main__":
    main()
