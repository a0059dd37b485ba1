# SPDX-License-Identifier: BSD-3-Clause
"""Cost of safety in long runs: checkpoints, parts, merging, Dask, the Python interface.

    python -m benchmarks.speed.cluster [--boulders 1000000] [--parts 100]

`cases/vaujany` with passages, maximum energy and its quantiles. All results are ratios within one
run of this script; use an idle machine.
"""

import argparse
import math
import shutil
import sys
import tempfile
import time
from pathlib import Path

import rockfall
from benchmarks.machine import NOTHING, VAUJANY, machine, run_child
from rockfall.scene.prepare import prepare
from rockfall.scene.read import read_scene
from rockfall.simulation.dask import run_on_cluster
from rockfall.simulation.parts.checkpoint import Checkpoint
from rockfall.simulation.simulate import run_scene

OUTPUT = NOTHING | {"maps": ["passages", "energy_max", "energy_q95"]}


def seconds(do, *arguments, **named) -> tuple[float, object]:
    """Wall seconds of a call, and its return value."""
    begin = time.perf_counter()
    found = do(*arguments, **named)
    return time.perf_counter() - begin, found


def processes(scene) -> None:
    """Print the speed of two Dask workers relative to one, on clusters that are running."""
    from distributed import Client, LocalCluster

    took = []
    for workers in (1, 2):
        about = {"n_workers": workers, "threads_per_worker": 1, "dashboard_address": None}
        with LocalCluster(**about) as local, Client(local, set_as_default=False) as client:
            client.run(read_scene, scene.case)  # warm-up: imports, and files in the page cache
            took.append(seconds(run_on_cluster, scene, local.scheduler_address)[0])
    print(f"two Dask workers: {took[0] / took[1]:.2f} times the speed of one ({took[0]:.1f} s)")


def checkpoints(scene, folder: Path) -> None:
    """Print the cost of a checkpoint every 5 s. The cost of rows is proportional to the boulders
    since the last checkpoint, so the fraction hardly depends on the interval."""
    plain, saved = [], []
    for _ in range(3):
        plain.append(seconds(run_scene, scene, threads=2)[0])
        checkpoint = Checkpoint(folder / "checkpoint", 5.0)
        saved.append(seconds(run_scene, scene, threads=2, checkpoint=checkpoint)[0])
        checkpoint.remove()
    print(f"checkpoints: {min(saved) / min(plain) - 1:+.2%} of the {min(plain):.1f} s without")


def merging(scene, parts: int, folder: Path) -> None:
    paths, flown = [], 0.0
    for k in range(1, parts + 1):
        part = run_scene(scene, shard=(k, parts), threads=1)
        flown += part.attrs["cpu_seconds"]
        paths.append(folder / f"{k}.nc")
        rockfall.write_result(part, paths[-1])

    begin = time.process_time()
    rockfall.write_result(rockfall.merge(paths), folder / "all.nc")
    took = time.process_time() - begin
    print(f"merging {parts} parts: {took:.2f} s of CPU, {took / flown:.1%} of their {flown:.1f} s")


def doors(case: rockfall.Case, folder: Path) -> None:
    """Print the CPU seconds of both programs from start to written file: one thread, minimum of
    three."""
    prepare(case, folder / "prepared")
    files = {key: str(VAUJANY.parent / case.surface[key]) for key in ("zones", "table")}
    case = case.replace(terrain={"dem": str(VAUJANY.parent / "dem.tif")}, surface=files)
    (folder / "case.nml").write_text(case.text(), encoding="utf-8")
    boulders = case.case["boulders"]
    program = shutil.which("rockfall-batch")
    if not program:
        sys.exit("rockfall-batch is not on the PATH; see ./run setup")
    commands = {
        "rockfall run": [sys.executable, "-m", "rockfall", "run", folder / "case.nml", "--quiet"]
        + ["--threads", "1", "-o", folder / "python.nc"],
        "rockfall-batch": [program, folder / "prepared/case.nml", "--quiet", "--threads", "1"]
        + ["-o", folder / "batch.nc"],
    }
    cpu = dict.fromkeys(commands, math.inf)
    for _ in range(3):
        for name, command in commands.items():
            cpu[name] = min(cpu[name], run_child(*command)[1])
            for output in folder.glob("*.nc"):
                output.unlink()  # freeing its disk space must not count in the next run
    more = cpu["rockfall run"] / cpu["rockfall-batch"] - 1
    about = ", ".join(f"{name} {value:.1f} s" for name, value in cpu.items())
    print(f"{boulders:,} boulders: {about} of CPU: {more:+.1%} by the Python interface")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--boulders", type=int, default=1_000_000)
    parser.add_argument("--parts", type=int, default=100)
    options = parser.parse_args()
    print(machine(), "\n")
    case = rockfall.read_case(VAUJANY).replace(case={"boulders": options.boulders}, output=OUTPUT)
    scene = read_scene(case)
    with tempfile.TemporaryDirectory() as name:
        processes(scene)
        checkpoints(scene, Path(name))
        merging(scene, options.parts, Path(name))
        doors(case, Path(name))


if __name__ == "__main__":
    main()
