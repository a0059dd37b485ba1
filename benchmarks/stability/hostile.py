# SPDX-License-Identifier: BSD-3-Clause
"""Malformed inputs for both programs: each must be processed, or refused with one line per fault.

Small valid inputs of every kind are made, one file of each input is altered (mutators.py), and a
command reads it: `rockfall` in a fork of a process with all imports, or `rockfall-batch` from the
build, every tenth time from a build with sanitizers, if it exists. `verdict` has the requirements.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import netCDF4
import numpy as np
import rasterio
import xarray as xr

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))

import rockfall
from benchmarks.machine import ROOT, machine
from benchmarks.stability import mutators
from made import write_ascii
from rockfall import cli
from rockfall.grounds.impact_sets import shipped_sets
from rockfall.io.rasters.geotiff import write_geotiff
from rockfall.io.rasters.grid import Grid
from rockfall.scene.prepare import prepare
from rockfall.scene.read import read_scene
from rockfall.simulation.parts.checkpoint import Checkpoint
from rockfall.simulation.simulate import run_chunks, start

PROGRAM = ROOT / "build/fortran/rockfall-batch"
SANITIZED = ROOT / "build-sanitize/fortran/rockfall-batch"
MEMORY = 2_500_000_000  # maximum memory of a process [bytes]
LONGEST = 60.0  # maximum time of a process [s]
LARGEST = 200_000_000  # maximum size of a written file [bytes]
PLACES = 0.04  # fraction of inputs where the name leads to something other than a file
GRID = Grid(west=600000.0, north=5200000.0, cell=5.0, nx=24, ny=30)
WHERE = f"x = {GRID.west + 40.3}, {GRID.west + 70}, y = {GRID.north - 22.7}, {GRID.north - 18}"
LINE_X = f"{GRID.west}, {GRID.east}"
TABLE = "zone,mean_radius,rg70,rg20,rg10\n1,0.35,0.6,0.2,0.9\n7,0.1,0.2,0.1,0.3\n-3" + 4 * ",Inf"
OBSERVED = {
    "summaries.csv": "line,quantity,unit,mean,std,max,n\nEL1,speed,m/s,12.5,5.2,28.1,80\n"
    "EL1,energy_translational,kJ,205,169,786,80\n",
    "samples.csv": "line,quantity,unit,value,note\nEL1,speed,m/s,11.8,film\nEL1,speed,m/s,14.1,\n",
    "stops.csv": f"x,y\n{GRID.west + 50},{GRID.north - 110}\n{GRID.west + 55},{GRID.north - 90}\n",
    "distances.csv": "distance\n40.5\n70\n80\n",
    "passing.csv": "distance,percent\n10,100\n50,70.5\n90,12\n",
    "tests.csv": "line,method,quantity,p\nEL1,B,speed,0.4\n",
}
RASTERS = ("dem", "zones", "cells")
MAPS = "'passages', 'deposits', 'energy_mean', 'energy_q95', 'reach_probability', 'sources'"


@dataclass(frozen=True)
class Input:
    """Kind of file, its path, the commands that read it (subcommands of `rockfall`, or commands
    that start with rockfall-batch), and the functions that alter it."""

    kind: str
    file: str
    commands: tuple[str, ...]
    mutators: tuple[mutators.Content, ...]


def _inputs() -> tuple[Input, ...]:
    doors = ("check {0}", "run {0} --boulders 3 --quiet -o out/r.nc", "prepare {0} out/p")
    batch = "rockfall-batch in/ready/case.nml --threads 1 --quiet"

    def read(kind: str, case: str, file: str, how: tuple) -> Input:
        return Input(kind, file, tuple(door.format(f"in/{case}") for door in doors), how)

    def prepared(kind: str, file: str, how: tuple) -> Input:
        return Input(kind, f"ready/{file}", (f"{batch} --boulders 3 -o out/r.nc",), how)

    resume = ("run in/asc.nml --quiet --resume -o out/half.nc", f"{batch} --resume -o out/half.nc")
    compare = "compare in/out.nc in/{0} -o out/c.csv"
    result = (
        "lines in/out.nc -o out/t.csv", "export in/out.nc out/e", "report in/out.nc -o out/r.html",
        compare.format("summaries.csv"),
    )  # fmt: skip
    merge = ("merge in/part1.nc in/part2.nc in/part3.nc -o out/m.nc",)
    text, zones = mutators.TEXT + mutators.BYTES, "asc.nml"
    return (
        *[read("namelist", case, case, text) for case in ("asc.nml", "size.nml")] * 3,
        *[read("namelist", case, case, text) for case in ("tif.nml", "json.nml")],
        *[prepared("namelist", "case.nml", text)] * 4,
        *[prepared("scene file", "scene.nc", mutators.RESULT)] * 8,
        *[read("ASCII grid", zones, f"{name}.asc", mutators.GRID) for name in RASTERS],
        read("ASCII grid", "size.nml", "rm.asc", mutators.GRID),
        *[read("GeoTIFF", "tif.nml", f"{name}.tif", mutators.TIFF) for name in RASTERS],
        *[read("netCDF grid", "nc.nml", "dem.nc", mutators.RESULT)] * 3,
        *[read("zone table", zones, "zones.csv", mutators.TABLE)] * 3,
        read("polygons", "json.nml", "zones.geojson", mutators.JSON),
        read("polygons", "json.nml", "source.geojson", mutators.JSON),
        read("polygons", "gpkg.nml", "zones.gpkg", mutators.HDF5),
        *[read("impact sets", zones, "sets.nml", text)] * 4,
        *[Input("observations", csv, (compare.format(csv),), mutators.TABLE) for csv in OBSERVED],
        *[Input("result", "out.nc", result, mutators.RESULT)] * 4,
        *[Input("part", f"part{k}.nc", merge, mutators.RESULT) for k in (1, 2)] * 2,
        *[Input("checkpoint", "out/half.nc.checkpoint", resume, mutators.RESULT)] * 6,
    )  # fmt: skip


INPUTS = _inputs()


# ---- valid inputs --------------------------------------------------------------------------------


def make_base(base: Path) -> None:
    """Make the folders `in` and `out` with valid files of every kind."""
    files = base / "in"
    make_rasters(files)
    make_cases(files)
    (base / "out").mkdir()
    for name, text in OBSERVED.items():
        (files / name).write_text(text)
    case = rockfall.read_case(files / "asc.nml")
    rockfall.write_result(rockfall.run(case), files / "out.nc")
    for k in (1, 2, 3):  # the second line crosses both sources
        rockfall.write_result(rockfall.run(case, shard=(k, 3)), files / f"part{k}.nc")
    prepare(case, files / "ready")
    _make_checkpoint(base)


def make_rasters(files: Path) -> None:
    """Make every raster and polygon layer used by the cases, in a new folder."""
    files.mkdir(parents=True)
    y, x = np.mgrid[: GRID.ny, : GRID.nx] * GRID.cell
    random = np.random.default_rng(5)
    z = 1000 - 0.8 * np.minimum(y, 100) - 0.05 * y + np.sin(x / 9) + random.normal(0, 0.1, x.shape)
    zones, cells = np.full(GRID.shape, 1, "i4"), np.zeros(GRID.shape, "i4")
    zones[12:20], zones[-3:], cells[3, 8:16:4] = 7, -3, 1
    rasters = {"dem": z, "zones": zones, "cells": cells, "rm": np.full(GRID.shape, 0.3)}
    for name, array in rasters.items():
        write_ascii(files / f"{name}.asc", array, GRID)
        dtype = "f4" if array.dtype == "f8" else "i4"
        write_geotiff(files / f"{name}.tif", array.astype(dtype), GRID)
    axes = {"y": GRID.y, "x": GRID.x}
    coords = {name: (name, at, {"axis": name.upper()}) for name, at in axes.items()}
    dem = xr.DataArray(z, coords, ("y", "x"), "z")
    dem.to_netcdf(files / "dem.nc", encoding={"z": {"zlib": True}})
    _make_polygons(files)


def _make_polygons(files: Path) -> None:
    import pyogrio
    import shapely

    box = shapely.box(GRID.west, GRID.south, GRID.east, GRID.north)
    sides = np.array([shapely.to_wkb(box)], object), [np.array([7], "i4")]
    how = {"geometry_type": "Polygon", "driver": "GPKG", "crs": None}
    with warnings.catch_warnings(action="ignore"):  # without a CRS, like the terrain
        pyogrio.raw.write(files / "zones.gpkg", *sides, ["zone"], **how)
    source = shapely.box(GRID.west + 40, GRID.north - 22, GRID.west + 61, GRID.north - 15)
    for name, shape in (("zones", box), ("source", source)):
        geometry = shapely.geometry.mapping(shape)
        feature = {"type": "Feature", "properties": {"zone": 7}, "geometry": geometry}
        (files / f"{name}.geojson").write_text(
            json.dumps({"type": "FeatureCollection", "features": [feature]})
        )


def make_cases(files: Path) -> None:
    """Make the cases, their zone table and their impact sets."""
    (files / "zones.csv").write_text(TABLE)
    shutil.copy(shipped_sets()["vaujany-observed"], files / "sets.nml")
    zones = "zones = 'zones.{0}', table = 'zones.csv', default_zone = 7"
    places, cells = f"{WHERE}, drop_height = 3.0", "cells = 'cells.{0}', drop_height = 3.0"
    kinds = {  # file type of the DEM, surface, release
        "asc": ("asc", zones, cells), "tif": ("tif", zones, cells),
        "nc": ("nc", "uniform_mean_radius = 0.3", places),
        "size": ("asc", "mean_radius = 'rm.{0}'", places + ", velocity = 1.0, 0.0, -2.0"),
        "json": ("geojson", zones, "polygons = 'source.{0}', drop_height = 3.0"),
        "gpkg": ("gpkg", zones, places),
    }  # fmt: skip
    for name, (ending, surface, release) in kinds.items():
        dem = {"json": "dem.asc", "gpkg": "dem.asc"}.get(name, f"dem.{ending}")
        (files / f"{name}.nml").write_text(f"""&case title = 'made "rough"', boulders = 20 /
&terrain dem = '{dem}' /
&surface {surface.format(ending)} /
&impact sets = 'sets.nml', stop_speed = 0.4 /
&boulder volume = 'normal', volume_mean = 0.8, volume_std = 0.15 /
&release {release.format(ending)} /
&line name = 'EL1', x = {LINE_X}, y = 2*{GRID.north - 70} /
&line name = 'EL 2/ö', x = {LINE_X}, y = 2*{GRID.north - 100} /
&output maps = {MAPS}, rebounds = .true., trajectories = 2 /
""")


def _make_checkpoint(base: Path) -> None:
    """Make the files left by a killed program."""
    with contextlib.chdir(base):  # the name by which a case is read is stored
        tally = start(read_scene(rockfall.read_case(Path("in/asc.nml"))), 1)
        run_chunks(tally, 20, lambda: tally.done >= 20, lambda _: None)
        checkpoint = Checkpoint("out/half.nc", 0.0)
        checkpoint.save(tally)
        assert checkpoint.found() == 20


# ---- one input -----------------------------------------------------------------------------------


@dataclass
class Ran:
    """End of a command: its exit status (negative: the signal that killed it; None: it ran too
    long), its output and its duration."""

    status: int | None
    said: str
    seconds: float


def run_python(words: list[str], work: Path) -> Ran:
    """Run `rockfall` in a fork of this process."""
    begin = time.monotonic()
    child = os.fork()
    if child == 0:
        _be_rockfall(words, work)
    status = _wait(child, begin)
    said = (work / "stderr").read_text(errors="replace")
    return Ran(status, said, time.monotonic() - begin)


def _be_rockfall(words: list[str], work: Path) -> None:
    """Run `rockfall` in the child process; never return."""
    status = 99
    try:
        os.chdir(work)
        for number, name in ((1, "stdout"), (2, "stderr")):
            os.dup2(os.open(name, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), number)
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        streams = [io.FileIO(number, "w", closefd=False) for number in (1, 2)]
        sys.stdout, sys.stderr = (io.TextIOWrapper(s, write_through=True) for s in streams)
        _limit()
        status = cli.main(words)
        sys.stdout.flush()
    finally:
        os._exit(status)


def _limit(memory: bool = True) -> None:
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_FSIZE, (LARGEST, LARGEST))
    if memory:
        resource.setrlimit(resource.RLIMIT_DATA, (MEMORY, MEMORY))


def _wait(child: int, begin: float) -> int | None:
    """Wait for the status of a child process; None if it had to be killed."""
    pause = 0.001
    while time.monotonic() - begin < LONGEST:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status)
        time.sleep(pause)
        pause = min(0.05, 1.5 * pause)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return None


def run_batch(words: list[str], work: Path, sanitized: bool) -> Ran:
    """Run `rockfall-batch`, or its build with sanitizers, which reserves very much memory."""
    about = "detect_leaks=0:allocator_may_return_null=1:max_allocation_size_mb=2500:exitcode=98"
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "ASAN_OPTIONS": about}
    begin = time.monotonic()
    with open(work / "stdout", "wb") as out, open(work / "stderr", "wb") as said:
        child = subprocess.Popen(
            [work.parent / (SANITIZED if sanitized else PROGRAM).parts[-3], *words], cwd=work,
            stdin=subprocess.DEVNULL, stdout=out, stderr=said, env=environment,
            preexec_fn=lambda: _limit(not sanitized),
        )  # fmt: skip
        try:
            status = child.wait(LONGEST)
        except subprocess.TimeoutExpired:
            child.kill()
            child.wait()
            status = None
    return Ran(status, (work / "stderr").read_text(errors="replace"), time.monotonic() - begin)


def snapshot(folder: Path) -> dict[str, tuple]:
    """List every name in a folder, with properties that any change affects."""
    found = {}
    for place, folders, names in os.walk(folder):
        for name in (*folders, *names):
            path = os.path.join(place, name)
            about = os.lstat(path)
            found[path] = (about.st_mode, about.st_ino) if name in folders else (
                about.st_mode, about.st_ino, about.st_size, about.st_mtime_ns,
            )  # fmt: skip
    return found


def verdict(ran: Ran, work: Path, before: dict[str, tuple], batch: bool) -> str:
    """Return `done`, `refused`, or the fault."""
    lines = [line for line in ran.said.splitlines() if line]
    if ran.status is None:
        return f"HANG: more than {LONGEST:g} s"
    if ran.status not in (0, 2):
        return f"STATUS {ran.status}: {lines[-1] if lines else ''}"
    after = snapshot(work)
    inside = str(work / "out")
    changed = {path for path in {*before, *after} if before.get(path) != after.get(path)}
    changed -= {str(work / "stdout"), str(work / "stderr")}
    outside = sorted(path for path in changed if not path.startswith(inside))
    if outside:
        return f"OUTSIDE: {outside[:3]}"
    about = f"rockfall{'-batch' if batch else ''}: "
    plain = [line for line in lines if not line.startswith(f"{about}warning: ")]
    if ran.status == 2:
        if not plain or not all(line.startswith(about) for line in plain):  # one line per fault
            return f"LINES: {plain[:4]}"
        if changed - {inside}:
            return f"LEFT: {sorted(changed)[:3]}"
        return "refused"
    if plain:
        return f"LINES with status 0: {plain[:4]}"
    names = {path: Path(path).name for path in after}
    if half := [path for path in names if names[path].startswith(".") or path.endswith(".part")]:
        return f"HALF: {half[:3]}"
    for path in (work / "out").glob("[rm].nc"):
        if not_numbers := bad_numbers(path):
            return f"NAN: {path.name}: {not_numbers}"
    return "done"


def bad_numbers(path: Path) -> list[str]:
    """Names of variables with invalid numbers: NaN or infinite in variables per boulder or path
    vertex, infinite in others; and "lines" if variables at lines lack values for different
    boulders."""
    bad = []
    with netCDF4.Dataset(path) as file:
        file.set_auto_mask(False)
        missing = []
        for name, variable in file.variables.items():
            if variable.dtype is str or variable.dtype.kind != "f":
                continue
            values = variable[...]
            if variable.dimensions in (("boulder",), ("trajectory_vertex",)):
                bad += [] if np.isfinite(values).all() else [name]
            elif variable.dimensions == ("line", "boulder"):
                bad += [name] if np.isinf(values).any() else []
                missing.append(np.isnan(values))
            elif np.isinf(values).any():
                bad.append(name)
        if any((one != missing[0]).any() for one in missing[1:]):
            bad.append("lines")
    return bad


@dataclass(frozen=True)
class Tried:
    """Input and its outcome."""

    number: int
    kind: str
    file: str
    mutator: str
    command: str
    sanitized: bool
    verdict: str
    seconds: float


def attempt(base: Path, work: Path, seed: int, number: int, inputs: list[Input]) -> Tried:
    """Alter the file of input `number`, and run a command on it."""
    random, one, command = _drawn(seed, number, inputs)
    _copy(base, work, command)
    found = sorted(work.glob(one.file if one.file.startswith("out/") else f"in/{one.file}"))
    path = found[int(random.integers(len(found)))]
    name = _spoil(random, one, path)
    sanitized = bool(random.random() < 0.1) and _is_batch(command) and SANITIZED.exists()
    found, seconds = _give(command, work, sanitized)
    return Tried(number, one.kind, one.file, name, command, sanitized, found, seconds)


def _drawn(seed: int, number: int, inputs: list[Input]) -> tuple[np.random.Generator, Input, str]:
    """Draw an input and the command that reads it; also return the random generator."""
    random = np.random.default_rng((seed, number))
    one = inputs[int(random.integers(len(inputs)))]
    return random, one, one.commands[int(random.integers(len(one.commands)))]


def check_valid(base: Path, work: Path, commands: set[str]) -> None:
    """Check that all inputs are accepted before they are altered."""
    for command in sorted(commands):
        _copy(base, work, command)
        if (found := _give(command, work, False)[0]) != "done":
            raise SystemExit(f"{command}: {found}: {(work / 'stderr').read_text()}")


def _is_batch(command: str) -> bool:
    return command.startswith("rockfall-batch")


def _copy(base: Path, work: Path, command: str) -> None:
    """Copy the valid inputs; files of killed runs only for commands that resume from them."""
    shutil.rmtree(work, ignore_errors=True)
    shutil.copytree(base, work)
    if "half" not in command:
        shutil.rmtree(work / "out")
        (work / "out").mkdir()


def _give(command: str, work: Path, sanitized: bool) -> tuple[str, float]:
    """Run a command; return the verdict and its duration [s]."""
    before, words = snapshot(work), command.split()
    batch = _is_batch(command)
    ran = run_batch(words[1:], work, sanitized) if batch else run_python(words, work)
    return verdict(ran, work, before, batch), ran.seconds


def _spoil(random: np.random.Generator, one: Input, path: Path) -> str:
    """Alter a file; return the names of the mutators."""
    if random.random() < PLACES:
        place = mutators.PLACES[int(random.integers(len(mutators.PLACES)))]
        place(random, path)
        return place.__name__
    content, alike = path.read_bytes(), sorted(path.parent.glob(f"*{path.suffix}"))
    other = alike[int(random.integers(len(alike)))].read_bytes()
    names = []
    for _ in range(int(random.choice((1, 1, 1, 2, 3)))):
        spoil = one.mutators[int(random.integers(len(one.mutators)))]
        if spoil is mutators.structure and names:
            spoil = mutators.bits
        content = spoil(random, content, other)[: mutators.MOST]
        names.append(spoil.__name__)
    path.write_bytes(content)
    return "+".join(names)


# ---- all -----------------------------------------------------------------------------------------


def attempts(folder: Path, seed: int, numbers: range, kind: str | None = None) -> Iterator[Tried]:
    """Process inputs with the given numbers in folders inside `folder`; yield the outcomes."""
    _import_all()
    for program in (PROGRAM, SANITIZED):  # copies, because the programs may be rebuilt meanwhile
        if program.exists():
            shutil.copy(program, folder / program.parts[-3])
    child = os.fork()  # fork before OpenMP creates threads that the child would lack
    if child == 0:
        try:
            make_base(folder / "base")
            os._exit(0)
        except BaseException:
            traceback.print_exc()
        os._exit(1)
    if _wait(child, time.monotonic()) != 0:
        raise SystemExit("the valid inputs could not be made")
    inputs = [one for one in INPUTS if kind in (None, one.kind)]
    commands = {_drawn(seed, number, inputs)[2] for number in numbers}
    check_valid(folder / "base", folder / "work", commands)
    for number in numbers:
        yield attempt(folder / "base", folder / "work", seed, number, inputs)


def _import_all() -> None:
    """Import everything that forked processes must not import again."""
    import dask.base  # noqa: F401
    import jinja2  # noqa: F401
    import matplotlib.figure  # noqa: F401
    import pandas  # noqa: F401
    import pyogrio  # noqa: F401
    import pyproj  # noqa: F401
    import scipy.stats  # noqa: F401

    import rockfall.cli.commands.export
    import rockfall.cli.commands.lines
    import rockfall.cli.commands.results
    import rockfall.cli.commands.run  # noqa: F401

    rasterio.Env().__enter__()


def table(tried: list[Tried]) -> str:
    """Count outcomes by kind of input."""
    counts = Counter((one.kind, _word(one.verdict)) for one in tried)
    rows = [f"| {'input':14} | {'inputs':>6} | {'done':>6} | {'refused':>7} | {'wrong':>5} |"]
    rows.append("| --- | --: | --: | --: | --: |")
    for kind in (*dict.fromkeys(one.kind for one in INPUTS), "all"):
        own = [sum(n for (k, w), n in counts.items() if kind in (k, "all") and w == word)
               for word in ("done", "refused", "wrong")]  # fmt: skip
        rows.append(f"| {kind:14} | {sum(own):6} | {own[0]:6} | {own[1]:7} | {own[2]:5} |")
    return "\n".join(rows)


def _word(verdict: str) -> str:
    return verdict if verdict in ("done", "refused") else "wrong"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--inputs", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, default=0, help="number of the first input")
    parser.add_argument("--kind", help="of input; default: all")
    parser.add_argument("--keep", type=Path, help="a folder for the inputs that went wrong")
    given = parser.parse_args()
    if not PROGRAM.exists():
        sys.exit(f"{PROGRAM}: is not built")
    tried = []
    with tempfile.TemporaryDirectory() as name, contextlib.suppress(KeyboardInterrupt):
        folder, numbers = Path(name), range(given.first, given.first + given.inputs)
        for one in attempts(folder, given.seed, numbers, given.kind):
            tried.append(one)
            if _word(one.verdict) == "wrong":
                print(one, flush=True)
                if given.keep and "fifo" not in one.mutator:
                    shutil.copytree(folder / "work", given.keep / str(one.number), symlinks=True)
    print(machine(), f"seed {given.seed}", "", table(tried), sep="\n")
    slowest = max(tried, key=lambda one: one.seconds)
    batch = sum(_is_batch(one.command) for one in tried)
    sanitized = sum(one.sanitized for one in tried)
    print(
        f"\nrockfall {len(tried) - batch}, rockfall-batch {batch}, of these {sanitized} with ",
        end="",
    )
    print(f"sanitizers; the slowest took {slowest.seconds:.1f} s")
    return any(_word(one.verdict) == "wrong" for one in tried)


if __name__ == "__main__":
    sys.exit(main())
