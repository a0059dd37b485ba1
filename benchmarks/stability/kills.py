# SPDX-License-Identifier: BSD-3-Clause
"""Crashes at random steps of a save, interrupts and resumes between: the same bits in the end.

    python -m benchmarks.stability.kills --crashes 1000 --seed 1

Runs of both programs save after every chunk, and go on from what they find. crash.c ends them
before one of the calls by which files come to disk and get their names (rename, fsync, unlink,
mkdir, rmdir, flock), as a kill does, or interrupts them there, or right after they have begun.
Whenever a run comes to its end its result is compared with that of one in one piece, bit for bit,
and another begins. `rockfall` runs in forks of a process that has everything imported.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path

import netCDF4

from benchmarks.stability import hostile
from rockfall import cli

SHIM = Path(__file__).with_name("crash.c")
CRASHED, INTERRUPTED = 137, 130  # exit status
#: Steps within which a process crashes (a save has ten), and handlers of Ctrl-C that it sets.
STEPS = {"rockfall": range(1, 61), "rockfall-batch": range(1, 21)}
HANDLERS = {"rockfall": range(1, 5), "rockfall-batch": range(1, 2)}
PROGRESS = 50  # crashes from a line to the next
FORKS = multiprocessing.get_context("forkserver")
PRELOAD = hostile.__name__, "rockfall.simulation.checkpoint", "rockfall.text.summary"
FORKS.set_forkserver_preload(list(PRELOAD))
#: Attributes that differ between runs in one piece and in several.
OWN = {"case", "threads", "wall_seconds", "cpu_seconds"}


def build_shim(folder: Path) -> dict[str, str]:
    """An environment in which programs obey CRASH_AT and so on, see crash.c."""
    shim = folder / "crash.so"
    subprocess.run(["cc", "-O1", "-shared", "-fPIC", "-o", shim, SHIM, "-ldl"], check=True)
    return {**os.environ, "LD_PRELOAD": str(shim), "OMP_NUM_THREADS": "1"}


def commands(boulders: int) -> dict[str, list[str]]:
    """What runs the case with each program, but for the name of the result."""
    words = f"in/asc.nml boulders={boulders} checkpoint=1e-9 resume=true quiet=true output="
    options = f"run in/asc.nml --quiet --resume --boulders {boulders} --checkpoint 1e-9 --output="
    return {"rockfall": options.split(), "rockfall-batch": words.split()}


def run_program(command: list[str], folder: Path, environment: dict[str, str]) -> tuple[int, str]:
    """Run rockfall-batch; its exit status, and what it says."""
    command = [str(hostile.PROGRAM), *command]
    ended = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
    return ended.returncode, ended.stderr


def run_fork(command: list[str], folder: Path, environment: dict[str, str]) -> tuple[int, str]:
    """Run `rockfall` in a fork of a process that has the shim."""
    said = folder / "stderr.txt"
    process = FORKS.Process(target=_fork, args=(command, folder, environment, said))
    process.start()
    process.join()
    return process.exitcode, said.read_text()


def _fork(command: list[str], folder: Path, environment: dict[str, str], said: Path) -> None:
    os.chdir(folder)
    os.dup2(os.open(said, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), sys.stderr.fileno())
    signal.signal(signal.SIGINT, signal.default_int_handler)
    os.environ |= environment
    os._exit(cli.main(command))


def same(one: Path, other: Path) -> bool:
    """Whether two results have the same bits, but for times and threads."""
    with netCDF4.Dataset(one) as a, netCDF4.Dataset(other) as b:
        a.set_auto_maskandscale(False)
        b.set_auto_maskandscale(False)
        if a.variables.keys() != b.variables.keys() or not {*a.ncattrs()} == {*b.ncattrs()}:
            return False
        if any(a.getncattr(name) != b.getncattr(name) for name in {*a.ncattrs()} - OWN):
            return False
        pairs = ((a[name][...], b[name][...]) for name in a.variables)
        return all(x.tolist() == y.tolist() if x.dtype == object else x.tobytes() == y.tobytes()
                   for x, y in pairs)  # fmt: skip


class Study:
    """Runs of one program in a folder until so many have crashed."""

    def __init__(self, program: str, command: list[str], folder: Path, environment: dict):
        self.program, self.folder, self.environment = program, folder, environment
        self.command, self.ended = command, Counter[int]()
        self.results = 0  # that were compared
        self.whole = folder / f"{program}.whole.nc"
        self.output = folder / f"{program}.nc"
        assert self._run(self.whole, {}) == 0

    def _run(self, output: Path, how: dict[str, str]) -> int:
        command = [*self.command[:-1], self.command[-1] + output.name]
        run = run_fork if self.program == "rockfall" else run_program
        status, said = run(command, self.folder, self.environment | how)
        if status not in (0, CRASHED, INTERRUPTED):
            raise SystemExit(f"{self.program} {how}: {status}: {said}")
        return status

    def crash(self, crashes: int, random: random.Random) -> None:
        """Crash, interrupt and resume; a result that differs ends the study."""
        while self.ended[CRASHED] < crashes:
            what = random.choice(["CRASH_AT", "CRASH_AT", "INTERRUPT_AT", "INTERRUPT_READY"])
            numbers = HANDLERS if what == "INTERRUPT_READY" else STEPS
            how = {what: str(random.choice(numbers[self.program]))}
            status = self._run(self.output, how)
            self.ended[status] += 1
            if status == 0:
                self._compare()
            if status == CRASHED and self.ended[CRASHED] % PROGRESS == 0:
                self.say()
        while self.output.with_name(f"{self.output.name}.checkpoint").exists():
            self._run(self.output, {})
            self._compare()

    def say(self) -> None:
        crashes, interrupts = self.ended[CRASHED], self.ended[INTERRUPTED]
        print(f"{self.program}: {crashes} crashes, {interrupts} interrupts, {self.results} results "
              "with the same bits", flush=True)  # fmt: skip

    def _compare(self) -> None:
        if not same(self.output, self.whole):
            keep = Path(tempfile.mkdtemp(prefix="kills-"))
            shutil.copytree(self.folder, keep, dirs_exist_ok=True)
            raise SystemExit(f"{self.program}: another result; all files are in {keep}")
        left = [path.name for path in self.folder.glob(f"{self.output.name}*")]
        if left != [self.output.name]:
            raise SystemExit(f"{self.program}: left {left}")
        self.results += 1
        self.output.unlink()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--crashes", type=int, default=1000, help="of both programs together")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--boulders", type=int, default=4000, help="from each of two sources")
    arguments = parser.parse_args()
    signal.signal(signal.SIGINT, signal.default_int_handler)  # jobs in the background ignore it
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        hostile.make_rasters(folder / "in")
        hostile.make_cases(folder / "in")
        environment = build_shim(folder)
        os.environ |= environment  # of the process that forks
        numbers = random.Random(arguments.seed)
        for program, command in commands(arguments.boulders).items():
            study = Study(program, command, folder, environment)
            study.crash(arguments.crashes // 2, numbers)
            study.say()


if __name__ == "__main__":
    main()
