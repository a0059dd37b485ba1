# SPDX-License-Identifier: BSD-3-Clause
"""Cost of each option per rebound, and a check that unused options cost nothing.

    python -m benchmarks.speed.costs [--boulders 20000] [--repeat 3] [--cuts]

The slope of `cases/vaujany` with one rock radius and no options; then each option alone, such that
every boulder has an identical path. CPU time is for the complete run in Python, from scene to
result, minimum of `--repeat` runs. Instructions are for rockfall-batch (valgrind --tool=callgrind),
from the difference of two runs with different numbers of boulders. Bytes are the sizes of the run's
arrays.

--cuts builds another kernel for each option (meson, gfortran) in a temporary folder, with the
product's flags but without lanes, and with the option's code removed. Three scenes that do not use
the option must need the same number of instructions with and without the code, within 1 %.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import netCDF4
import numpy as np

import rockfall
from benchmarks.machine import NOTHING, ROOT, VAUJANY, machine
from benchmarks.variant import build, copy_sources, go_one_by_one, replace
from rockfall.io.rasters.dem import read_dem
from rockfall.io.rasters.grid import Grid
from rockfall.scene.prepare import prepare
from rockfall.scene.read import read_scene
from rockfall.scene.scene import Scene
from rockfall.simulation.parts.checkpoint import Checkpoint
from rockfall.simulation.simulate import fields, run_scene, start
from rockfall.simulation.tally import Tally

RADIUS = 0.1  # radius of all rocks [m]
FEW, MANY = 100, 300  # numbers of boulders under callgrind
AIM = 0.01
UNIFORM = {
    "zones": None, "table": None, "method": "B", "mean_radius": None, "uniform_rg": None,
    "uniform_mean_radius": RADIUS,
}  # fmt: skip
MAPS = {
    "passages": ["passages"],
    "deposits": ["deposits"],
    "a maximum": ["energy_max"],
    "a mean": ["energy_mean"],
    "quantiles of energy": ["energy_q50", "energy_q95"],
    "quantiles of speed": ["speed_q50", "speed_q95"],
    "quantiles of jump height": ["jump_height_q50", "jump_height_q95"],
    "sources": ["sources"],
    "reach probability by source": ["reach_probability_by_source"],
    "hits of objects": ["hits"],
}


class Option(NamedTuple):
    """Option that is turned on: changes of the case, rasters, and arguments of the run."""

    change: dict[str, Any] = {}
    rasters: dict[str, np.ndarray] = {}
    memory: float | None = None  # limit for windows of terrain [bytes]
    checkpoint: bool = False
    other_boulders: bool = False  # the option changes the set of boulders


def options(z: np.ndarray, grid: Grid, case: rockfall.Case, folder: Path) -> dict[str, Option]:
    """All options; the first is the run without any."""
    found = {"nothing asked for": Option()}
    found["two evaluation lines"] = Option({"line": case.line})
    found["six histograms"] = Option({"output": {"rebounds": True}})
    found |= {f"map: {name}": Option({"output": {"maps": maps}}) for name, maps in MAPS.items()}
    recorded = {"case": {"boulders": MANY}, "output": {"trajectories": MANY}}
    found["trajectories of all"] = Option(recorded, other_boulders=True)
    for few, name in ((True, "up to 127"), (False, "200")):
        ids = np.arange(z.size).reshape(z.shape) % (100 if few else 200) + 1
        table = folder / f"zones{ids.max()}.csv"
        rows = "".join(f"{k},{RADIUS}\n" for k in range(1, ids.max() + 1))
        table.write_text(f"zone,mean_radius\n{rows}")
        surface = {"zones": "given", "table": table, "uniform_mean_radius": None}
        found[f"{name} zones"] = Option({"surface": surface}, {"zones": ids})
    raster = {"mean_radius": np.full(z.shape, RADIUS, "f4")}
    surface = {"mean_radius": "given", "uniform_mean_radius": None}
    found["raster of radii"] = Option({"surface": surface}, raster, other_boulders=True)
    surface = {"method": "A", "uniform_rg": 3 * [2 * RADIUS], "uniform_mean_radius": None}
    found["method A"] = Option({"surface": surface})
    found["elevations in float64"] = Option(rasters={"dem": z.astype("f8")})
    release = {"x": None, "y": None, "cells": "given"}
    cells = np.zeros(z.shape, "i4")
    x, y = case.release["x"][0], case.release["y"][0]
    cells[int((grid.north - y) / grid.cell), int((x - grid.west) / grid.cell)] = 1
    found["a source cell, by_area"] = Option(
        {"release": release | {"by_area": True}}, {"cells": cells}, other_boulders=True
    )
    found["windows of terrain"] = Option(memory=1.5 * z.nbytes)
    found["checkpoints without pause"] = Option(checkpoint=True)
    return found


# Cost of runs


def scene_of(option: Option, bare: rockfall.Case, z: np.ndarray, grid: Grid) -> Scene:
    case = bare.replace(**option.change)
    if option.memory:
        return read_scene(case, memory=option.memory)
    return read_scene(case, **{"dem": z, "transform": grid, **option.rasters})


def cpu(scene: Scene, option: Option, repeat: int, folder: Path) -> tuple[float, int]:
    """Minimum CPU seconds of repeated runs, and their rebounds."""
    run_scene(scene, shard=(1, scene.boulders))  # warm-up of imports
    least = np.inf
    for _ in range(repeat):
        saved = Checkpoint(folder / "checkpoint", 0.0) if option.checkpoint else None
        begin = time.process_time()
        result = run_scene(scene, threads=1, checkpoint=saved)
        least = min(least, time.process_time() - begin)
        if saved:
            saved.remove()
    return least, int(result["rebounds"])


def held(scene: Scene) -> dict[str, float]:
    """Bytes of a run per cell of the terrain, boulder, map cell and reached map cell."""
    tally: Tally = start(scene, 1)
    terrain, arrays = scene.rasters, [*tally.run.arrays()]
    cells, of_cells = terrain.z.size or 1, (terrain.z, terrain.zone, terrain.values)
    rasters = [a for a in of_cells if a is not None and a.size]
    rows = sum(a.values.nbytes for a in arrays if "boulder" in a.dims)
    layers = sum(a.values.nbytes for a in arrays if "y" in a.dims)
    counted = sum(a.values.shape[1] for a in arrays if a.file_name == "tally_bin_counts")
    return {
        "terrain": sum(a.nbytes for a in rasters) / cells,
        "boulder": rows / tally.boulders,
        "map cell": layers / tally.box.shape[0] / tally.box.shape[1],
        "reached": 4 * counted,
    }


# Instructions


def instructions(program: Path, case: Path, boulders: int) -> tuple[int, int]:
    """Instructions of a rockfall-batch run on one thread, and its rebounds."""
    output = case.parent / "counted.nc"
    command = ["valgrind", "--tool=callgrind", "--callgrind-out-file=/dev/null", program, case]
    command += ["--boulders", str(boulders), "--threads", "1", "-o", output, "--checkpoint", "0"]
    command += ["--overwrite"]
    done = subprocess.run(command, capture_output=True, text=True)
    collected = re.search(r"Collected : (\d+)", done.stderr)
    if done.returncode or not collected:
        sys.exit(f"{' '.join(map(str, command))} failed:\n{done.stderr}")
    return int(collected[1]), _rebounds(output)


def _rebounds(part: Path) -> int:
    with netCDF4.Dataset(part) as file:
        return int(file["rebounds"][...])


def per_rebound(program: Path, case: Path, few_boulders: int = FEW) -> float:
    """Instructions per rebound, from the difference of two runs with different numbers of
    boulders."""
    numbers = few_boulders, few_boulders * MANY // FEW
    (few, before), (many, after) = (instructions(program, case, n) for n in numbers)
    return (many - few) / (after - before)


# Kernels without an option

Edit = tuple[str, str, str, int]  # file, text, replacement, number of occurrences
_TRAJECTORY, _PATHS, _CONTACT, _SCRATCH, _RECORD, _START, _TALLIES = (
    f"trace/{name}.f90" for name in "trajectory paths contact scratch record start tallies".split()
)
_ENSEMBLE = "run/ensemble.f90"
_CELLS = "if (scratch%cells_requested)"
_MAPS = "if (level >= with_maps .and. scratch%cells_requested)"
_HISTOGRAMS = "if (scene%histograms_requested)"
_LINES = "level >= with_lines .and. allocated(scene%lines)"
NEVER = "if (.false.)"
#: Edits that leave nothing of an option; the compiler drops unreachable code.
CUTS: dict[str, list[Edit]] = {
    "evaluation lines": [
        (_TRAJECTORY, _LINES, ".false.", 1),
        (_PATHS, _LINES, ".false.", 1),
        (_SCRATCH, "if (allocated(scratch%crossings))", NEVER, 1),
        (_ENSEMBLE, "if (allocated(worker%scratch%crossings))", NEVER, 1),
        (_TALLIES, "if (allocated(scene%lines))", NEVER, 1),
    ],
    "histograms": [
        (_CONTACT, "if (level >= with_lines .and. scene%histograms_requested)", NEVER, 1),
        (_CONTACT, _HISTOGRAMS, NEVER, 1),
        (_SCRATCH, _HISTOGRAMS, NEVER, 1),
        (_TALLIES, _HISTOGRAMS, NEVER, 2),
        (_ENSEMBLE, _HISTOGRAMS, NEVER, 1),
    ],
    "maps": [
        *[(file, _MAPS, NEVER, 1) for file in (_TRAJECTORY, _PATHS, _SCRATCH, _START)],
        (_PATHS, _CELLS, NEVER, 1),
        (_TALLIES, _CELLS, NEVER, 2),
        (_TALLIES, "if (at_rest(result%status))", NEVER, 1),
        (_ENSEMBLE, "if (counts_sources(maps))", NEVER, 1),
        ("boulder/flight.f90", "if (present(spans))", NEVER, 1),
        ("boulder/flight.f90", "if (present(n_spans))", NEVER, 1),
    ],
    "maps by source": [(_ENSEMBLE, "if (counts_sources(maps))", NEVER, 1)],
    "trajectories": [(_RECORD, "if (.not. allocated(record%vertex))", "if (.true.)", 4)],
    "zones, rasters of radii": [
        ("terrain/surface.f90", f"associated(surface%{name})", ".false.", often)
        for name, often in {"zone1": 2, "zone2": 2, "values": 1}.items()
    ],
    "method A": [("terrain/surface.f90", "surface%method == method_a", ".false.", 2)],
    "elevations in float32": [
        ("terrain/terrain.f90", "associated(dem%z8)", ".true.", 3)
    ],
    "by_area": [("boulder/boulder.f90", "allocated(release%last)", ".false.", 2)],
    "windows of terrain": [
        ("terrain/terrain.f90", "in_window = i >= dem%lo(1) .and. j >= dem%lo(2) .and. "
         "i <= dem%hi(1) .and. j <= dem%hi(2)",
         "in_window = i >= 1 .and. j >= 1 .and. i < dem%nx .and. j < dem%ny", 1),
        (_TRAJECTORY, "departure_status(scene%dem, landing%patch)", "left_domain", 1),
        (_START, "if (flight%patch%known)", "if (.true.)", 1),
        (_TALLIES, "if (result%status == left_window)", NEVER, 1),
    ],
    "grounds": [
        (_CONTACT, "level >= with_all .and. allocated(scene%grounds)", ".false.", 1),
        (_CONTACT, "level >= with_all .and. ground > 0", ".false.", 3),
        (_SCRATCH, "if (allocated(scratch%by_ground))", NEVER, 1),
        (_TALLIES, "if (allocated(scratch%by_ground))", NEVER, 1),
        (_TALLIES, "if (allocated(scene%grounds))", NEVER, 1),
        (_ENSEMBLE, "if (allocated(scene%grounds))", NEVER, 2),
    ],
    "checkpoints": [
        ("run/run_loop.f90", "call observer%on_chunk(run, error)", "", 1),
    ],
}  # fmt: skip


EVERY = "all of these"
#: Scenes in addition to the scene without options, and the code they need.
NEEDED = {
    "two lines": ("evaluation lines", EVERY),
    "passages": ("maps", EVERY),
}


def builds(folder: Path) -> Iterator[tuple[str, Path]]:
    """Yield name and path of rockfall-batch without lanes: complete, then without the code of each
    option, then without the code of all of them."""
    copy_sources(folder)
    go_one_by_one(folder)
    every = [edit for name, edits in CUTS.items() if name != "maps by source" for edit in edits]
    for name, edits in {"": [], **CUTS, EVERY: every}.items():
        texts = {file: (folder / "fortran/src" / file).read_text() for file, *_ in edits}
        for file, old, new, often in edits:
            replace(folder / "fortran/src" / file, old, new, often)
        yield name, *build(folder, "fortran/rockfall-batch")
        for file, text in texts.items():
            (folder / "fortran/src" / file).write_text(text)


# Tables


def costs(
    bare: rockfall.Case, z: np.ndarray, grid: Grid, program: Path | None, repeat: int, folder: Path
) -> None:
    """Print the cost of each option alone."""
    print(f"{'':34}{'':>8}{'instruc-':>10}{'bytes of':>9}")
    print(f"{'alone':34}{'CPU ns':>8}{'tions':>10}{'terrain':>9}{'boulder':>9}{'map cell':>9}"
          f"{'reached':>9}")  # fmt: skip
    usual = None
    full = rockfall.read_case(VAUJANY)
    for k, (name, option) in enumerate(options(z, grid, full, folder).items()):
        scene = scene_of(option, bare, z, grid)
        took, rebounds = cpu(scene, option, repeat, folder)
        usual = usual or rebounds
        if not option.other_boulders and rebounds != usual:
            sys.exit(f"{name}: {rebounds} rebounds, {usual} without it")
        counted = ""
        if program and not (option.memory or option.checkpoint):
            prepared = folder / f"prepared{k}"
            arrays = {"dem": z, "transform": grid, **option.rasters}
            prepare(bare.replace(**option.change), prepared, **arrays)
            counted = f"{per_rebound(program, prepared / 'case.nml'):.0f}"
        bytes_ = "".join(f"{value:9.1f}" for value in held(scene).values())
        print(f"{name:34}{1e9 * took / rebounds:8.0f}{counted:>10}{bytes_}", flush=True)
    print(f"A vertex of a trajectory: {8 * len(fields('vertex'))} bytes.")


def cuts(scenes: dict[str, rockfall.Case], z: np.ndarray, grid: Grid, folder: Path) -> bool:
    """Run scenes in kernels without their unused options; return True if all meet the target."""
    for name, case in scenes.items():
        prepare(case, folder / name, dem=z, transform=grid)
    (folder / "sources").mkdir()
    print("\ninstructions a rebound, and what more they are with the code than without it")
    print(f"{'':42}" + "".join(f"{name:>22}" for name in scenes))
    whole: dict[str, float] = {}
    good = True
    for cut, program in builds(folder / "sources"):
        cells = ""
        for name in scenes:
            if cut in NEEDED.get(name, ()):
                cells += f"{'':22}"
                continue
            found = per_rebound(program, folder / name / "case.nml")
            more = whole.setdefault(name, found) / found - 1
            good = good and (more <= AIM or cut == EVERY)
            cells += f"{found:12.1f}{more:+10.2%}"
        print(f"{f'without the code of {cut}' if cut else 'as it is':42}{cells}", flush=True)
    return good


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--boulders", type=int, default=20_000)
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--cuts", action="store_true", help="build the kernel without each option")
    words = parser.parse_args()
    program = shutil.which("rockfall-batch", path=f"{ROOT / 'build/fortran'}{os.pathsep}"
                           f"{os.environ['PATH']}")  # fmt: skip
    if not shutil.which("valgrind"):
        print("(no valgrind: instructions are left out)")
        program = None
    print(machine(), "\n")
    case = rockfall.read_case(VAUJANY)
    bare = case.replace(case={"boulders": words.boulders}, surface=UNIFORM, line=[], output=NOTHING)
    z, grid = read_dem(case.path(case.terrain["dem"]))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        costs(bare, z, grid, program, words.repeat, folder)
        scenes = {
            "nothing asked for": bare,
            "two lines": bare.replace(line=case.line),
            "passages": bare.replace(output={"maps": ["passages"]}),
        }
        if words.cuts and program and not cuts(scenes, z, grid, folder):
            sys.exit("an option that is off costs more than 1 %")


if __name__ == "__main__":
    main()
