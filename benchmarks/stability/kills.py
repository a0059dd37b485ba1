# SPDX-License-Identifier: BSD-3-Clause
"""Crashes at random steps of a save, interrupts and resumption: results must be bit-identical.

    python -m benchmarks.stability.kills --crashes 1000 --seed 1 --folders 50

Runs save as often as possible, and resume from existing files, also from those of the other
program. crash.c ends or interrupts them before a call that writes or renames files (rename, fsync,
unlink, flock), or interrupts them right after the start. Each complete result is compared bit for
bit with an uninterrupted run, then another run begins. `rockfall` runs in forks of a process with
all imports. Then commands that fill a folder crash and run again: the folder must have exactly the
files of an uninterrupted command.
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

import rockfall
from programs import find_program, make_prepared, same_results
from rockfall import cli
from rockfall.io.atomic import OLD, UNLOCKED
from rockfall.io.output_files import TEMPORARY
from scenes import FACTORS

SHIM = Path(__file__).with_name("crash.c")
CRASHED, INTERRUPTED = 137, 130  # exit statuses
#: Number of steps within which a process crashes (a save has four), and of its Ctrl-C handlers.
STEPS = {"rockfall": range(1, 35), "rockfall-batch": range(1, 18)}
HANDLERS = {"rockfall": range(1, 5), "rockfall-batch": range(1, 2)}
MOST_STEPS = 400  # initial number of steps of a command that fills a folder
FOLDERS = (  # commands that fill a folder
    [
        "site",
        "case.nml",
        "--line",
        "Straße",
        "--every",
        "20",
        "--to",
        "40",
        "--factors",
        str(FACTORS),
        "-o",
        "made",
        "--boulders",
        "20",
        "--quiet",
    ],
    ["export", "whole.nc", "made"],
)
SAME_BYTES = (".csv", ".png", ".nml", ".asc", ".tif")
PROGRESS = 50  # crashes between two lines of progress
PRELOAD = ["__main__", "rockfall.simulation.parts.checkpoint", "rockfall.text.summary"]


def build_shim(folder: Path) -> dict[str, str]:
    """Build crash.c; return an environment that loads it into programs, which then obey CRASH_AT
    and its other variables."""
    shim = folder / "crash.so"
    subprocess.run(["cc", "-O1", "-shared", "-fPIC", "-o", shim, SHIM, "-ldl"], check=True)
    return {**os.environ, "LD_PRELOAD": str(shim), "OMP_NUM_THREADS": "1"}


def run_program(words: list[str], folder: Path, environment: dict[str, str]) -> tuple[int, str]:
    """Run rockfall-batch; return exit status and standard error."""
    command = [find_program(), "ready/case.nml", *words]
    ended = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
    return ended.returncode, ended.stderr


def run_fork(words: list[str], folder: Path, environment: dict[str, str]) -> tuple[int, str]:
    """Run `rockfall run` in a fork that has the shim; return exit status and standard error."""
    return fork_command(["run", "case.nml", *words], folder, environment)


def fork_command(command: list[str], folder: Path, environment: dict[str, str]) -> tuple[int, str]:
    """Run a `rockfall` command in a fork with the shim; return exit status and standard error."""
    said = folder / "stderr.txt"
    forks = multiprocessing.get_context("forkserver")
    forks.set_forkserver_preload(PRELOAD)
    process = forks.Process(target=_fork, args=(command, folder, environment, said))
    process.start()
    process.join()
    return process.exitcode, said.read_text()


def _fork(command: list[str], folder: Path, environment: dict[str, str], said: Path) -> None:
    os.chdir(folder)
    os.dup2(os.open(said, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), sys.stderr.fileno())
    signal.signal(signal.SIGINT, signal.default_int_handler)
    os.environ |= environment
    os._exit(cli.main(command))


RUN = {"rockfall": run_fork, "rockfall-batch": run_program}


class Study:
    """Runs of both programs in a folder, until a given number of runs has crashed."""

    def __init__(self, folder: Path, environment: dict, boulders: int, numbers: random.Random):
        self.folder, self.environment, self.random = folder, environment, numbers
        self.words = ["--boulders", f"{boulders}", "--checkpoint", "1e-9", "--resume", "--quiet"]
        self.output, self.ended = folder / "out.nc", Counter[tuple[str, int]]()
        self.results = 0  # number of results compared
        case = rockfall.read_case(folder / "case.nml").replace(case={"boulders": boulders})
        self.whole = rockfall.run(case)

    def _run(self, how: dict[str, str], program: str) -> int:
        words, environment = [*self.words, "-o", self.output.name], self.environment | how
        status, said = RUN[program](words, self.folder, environment)
        if status not in (0, CRASHED, INTERRUPTED):
            raise SystemExit(f"{program} {how}: {status}: {said}")
        self.ended[program, status] += 1
        if status == 0:
            self._compare()
        return status

    def crashed(self) -> int:
        return sum(self.ended[program, CRASHED] for program in RUN)

    def crash(self, crashes: int) -> None:
        """Crash, interrupt and resume runs; a result that differs ends the study."""
        while self.crashed() < crashes:
            program = self.random.choice([*RUN])
            what = self.random.choice(["CRASH_AT", "CRASH_AT", "INTERRUPT_AT", "INTERRUPT_READY"])
            numbers = HANDLERS if what == "INTERRUPT_READY" else STEPS
            how = {what: str(self.random.choice(numbers[program]))}
            if self._run(how, program) == CRASHED and self.crashed() % PROGRESS == 0:
                self.say()
        while self.output.with_name(f"{self.output.name}.checkpoint").exists():
            self._run({}, "rockfall")

    def say(self) -> None:
        counts = ", ".join(
            f"{program}: {self.ended[program, CRASHED]} crashes, "
            f"{self.ended[program, INTERRUPTED]} interrupts" for program in RUN
        )  # fmt: skip
        print(f"{counts}; {self.results} results with the same bits", flush=True)

    def _compare(self) -> None:
        with netCDF4.Dataset(self.output) as file:
            is_part = "part_layout" in file.ncattrs()
        result = rockfall.merge([self.output]) if is_part else rockfall.read_result(self.output)
        left = [path.name for path in self.folder.glob(f"{self.output.name}*")]
        try:
            same_results(result, self.whole)
            assert left == [self.output.name], left
        except AssertionError as error:
            keep = Path(tempfile.mkdtemp(prefix="kills-"))
            shutil.copytree(self.folder, keep, dirs_exist_ok=True)
            raise SystemExit(f"another result: {error}; all files are in {keep}") from error
        self.results += 1
        self.output.unlink()


def crash_folder(command: list[str], folder: Path, crashes: int, numbers: random.Random) -> None:
    """Crash a command that fills the folder `made`, and run it again."""
    made, environment = folder / "made", dict(os.environ)
    command = [*command, "--overwrite"]
    inputs, most = {*os.listdir(folder), "stderr.txt", "made"}, MOST_STEPS
    _finish(command, folder, environment)
    whole = _contents(made)
    for number in range(crashes):
        if number % 2:
            shutil.rmtree(made)
        while True:
            step = numbers.randrange(1, most)
            status, said = fork_command(command, folder, environment | {"CRASH_AT": f"{step}"})
            if status == CRASHED:
                break
            assert status == 0, said
            most = min(most, step + 1)
        _finish(command, folder, environment)
        assert _contents(made) == whole, f"other files after a crash at step {step}"
        for place in folder, made:
            for left in {*place.iterdir()} - {folder / name for name in inputs}:
                if left.name.startswith(TEMPORARY) and _may_stay(left):
                    left.unlink() if left.is_file() else shutil.rmtree(left)
                else:
                    assert place == made and left.name in whole, f"{left} after step {step}"
    print(f"{command[0]}: {crashes} crashes within {most} steps, {len(whole)} files again the same")
    shutil.rmtree(made)


def _finish(command: list[str], folder: Path, environment: dict[str, str]) -> None:
    status, said = fork_command(command, folder, environment)
    assert status == 0, said


def _may_stay(left: Path) -> bool:
    """Return True for what may remain after a crash: an empty file, an unused folder, or a
    temporary folder with files that were about to be replaced."""
    if left.is_file():
        return left.stat().st_size == 0
    return any(left.glob(f"{OLD}/*")) or {path.name for path in left.iterdir()} <= {UNLOCKED}


def _contents(folder: Path) -> dict[str, object]:
    """Bytes of tables and pictures by name; only names for files that contain the time."""
    return {
        path.name: path.read_bytes() if path.suffix in SAME_BYTES else None
        for path in folder.iterdir()
        if not path.name.startswith(TEMPORARY)
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--crashes", type=int, default=1000, help="of both programs together")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--boulders", type=int, default=2000, help="from each of four sources")
    parser.add_argument("--folders", type=int, default=50, help="crashes of each command")
    arguments = parser.parse_args()
    signal.signal(signal.SIGINT, signal.default_int_handler)  # background jobs ignore it
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        make_prepared(folder)
        environment = build_shim(folder)
        os.environ |= environment  # environment of the forking process
        study = Study(folder, environment, arguments.boulders, random.Random(arguments.seed))
        study.crash(arguments.crashes)
        study.say()
        rockfall.write_result(study.whole, folder / "whole.nc")
        for command in FOLDERS:
            crash_folder(command, folder, arguments.folders, study.random)


if __name__ == "__main__":
    main()
