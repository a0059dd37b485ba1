# SPDX-License-Identifier: BSD-3-Clause
"""Checkpoints: `rockfall` and `rockfall-batch` resume each other's runs with bit-identical results,
however the run ended."""

import contextlib
import io
import os
import random
import signal
import subprocess
import sys
import time

import netCDF4
import numpy as np
import pytest

import rockfall
from benchmarks.stability.kills import CRASHED, INTERRUPTED, build_shim
from programs import (
    MANY,
    everything,
    find_program,
    makes_links,
    preloads,
    same_results,
    sends_signals,
    wait_until_busy,
)
from rockfall.cli import main
from rockfall.simulation.parts.part_file import boulders_in

PROGRAMS = ("rockfall", "rockfall-batch")


def command(program, output, *words):
    begin = {"rockfall": [sys.executable, "-m", "rockfall", "run", "case.nml"],
             "rockfall-batch": [find_program(), "ready/case.nml"]}[program]  # fmt: skip
    return [*begin, "--quiet", "-o", output, *words]


def kill(folder, program, *words, wait=0.0):
    """Kill a run `wait` seconds after its first save; return whether it was still running."""
    state = folder / "a.nc.checkpoint"
    before = state.stat().st_ino if state.exists() else 0
    words = ("--resume", "--checkpoint", "0.001", *words)
    process = subprocess.Popen(command(program, "a.nc", *words), cwd=folder, stderr=subprocess.PIPE)
    while process.poll() is None and not (state.exists() and state.stat().st_ino != before):
        time.sleep(0.001)
    time.sleep(wait)
    process.kill()
    process.communicate()
    return process.returncode != 0


def result_of(path):
    with netCDF4.Dataset(path) as file:
        part = "part_layout" in file.ncattrs()
    return rockfall.merge([path]) if part else rockfall.read_result(path)


def test_a_run_that_is_killed_and_changes_programs_comes_to_the_same_bits(many):
    """A source counts once per cell, also if the run is killed between its boulders."""
    instants, before = random.Random(4), 0
    for k, program in enumerate(PROGRAMS):
        assert kill(many, program, "--threads", str(1 + k % 2), wait=instants.uniform(0, 0.01))
        assert before < boulders_in(many / "a.nc.checkpoint") < 4 * MANY
        before = boulders_in(many / "a.nc.checkpoint")
    ended = subprocess.run(command("rockfall", "a.nc", "--resume"), cwd=many)
    assert ended.returncode == 0
    same_results(result_of(many / "a.nc"), rockfall.run(rockfall.read_case(many / "case.nml")))
    assert sorted(path.name for path in many.glob(".*")) == []
    assert not list(many.glob("a.nc.*"))


@pytest.mark.all
def test_shards_that_are_killed_and_change_programs_join_to_the_run(many):
    parts = []
    for k, program in enumerate(PROGRAMS, start=1):
        assert kill(many, program, "--shard", f"{k}/2")
        other = command(PROGRAMS[k % 2], "a.nc", "--resume", "--shard", f"{k}/2")
        assert subprocess.run(other, cwd=many).returncode == 0
        parts.append(many / f"{k}")
        (many / "a.nc").rename(parts[-1])
    same_results(rockfall.merge(parts), rockfall.run(rockfall.read_case(many / "case.nml")))


@pytest.fixture
def stopped(many):
    """Folder with the `a.nc.checkpoint` of a killed rockfall-batch."""
    assert kill(many, "rockfall-batch")
    (many / "a.nc.lock").unlink()
    return many


def refused(folder, words, *more):
    """Check that both programs refuse with one line that begins with `words`, and change no
    file."""
    before = everything(folder)
    said = io.StringIO()
    with contextlib.chdir(folder), contextlib.redirect_stderr(said):  # without starting Python
        status = main(["run", "case.nml", "--quiet", "-o", "a.nc", *more])
    ended = subprocess.run(
        command("rockfall-batch", "a.nc", *more), cwd=folder, capture_output=True, text=True
    )
    assert status == ended.returncode == 2
    for program, text in (("rockfall", said.getvalue()), ("rockfall-batch", ended.stderr)):
        last = text.splitlines()[-1]  # one line before it may be a warning about the line
        assert last.startswith(f"{program}: {words}")
    assert everything(folder) == before


def test_a_checkpoint_is_not_overwritten_unasked(stopped, batch):
    refused(stopped, "a.nc.checkpoint: contains ")
    refused(stopped, "a.nc.checkpoint: belongs to a different run (", "--resume", "--seed", "3")
    refused(stopped, "a.nc.checkpoint: belongs to a different run (", "--resume", "--shard", "2/3")


@pytest.mark.all
@sends_signals
def test_a_result_is_not_overwritten_unasked(many):
    """Both programs refuse to overwrite a result, or a checkpoint without --resume; --overwrite
    replaces a result."""
    few = ("--boulders", "3")
    assert subprocess.run(command("rockfall", "a.nc", *few), cwd=many).returncode == 0
    refused(many, "a.nc: already exists; not overwritten (--overwrite replaces it)", *few)
    other = ("--boulders", "4")
    refused(many, "a.nc: already exists; not overwritten", "--resume", *other)
    for program in PROGRAMS:
        words = command(program, "a.nc", *few, "--overwrite")
        assert subprocess.run(words, cwd=many, stderr=subprocess.DEVNULL).returncode == 0
    (many / "a.nc").unlink()
    slow = ("--boulders", "1000000", "--checkpoint", "0.001")
    running = subprocess.Popen(command("rockfall", "a.nc", *slow), cwd=many, stderr=subprocess.PIPE)
    while not (many / "a.nc.checkpoint").exists():
        time.sleep(0.01)
    running.send_signal(signal.SIGINT)
    assert b"continue with --resume" in running.communicate()[1]
    assert (many / "a.nc").exists() and (many / "a.nc.checkpoint").exists()
    refused(many, "a.nc.checkpoint: contains ", "--boulders", "1000000")
    state = many / "a.nc.checkpoint"
    words, before = command("rockfall", "a.nc", *slow, "--resume"), state.stat().st_ino
    running = subprocess.Popen(words, cwd=many, stderr=subprocess.PIPE)
    while running.poll() is None and state.stat().st_ino == before:
        time.sleep(0.01)
    running.send_signal(signal.SIGINT)
    assert b"a.nc contains " in running.communicate()[1]


@pytest.mark.all
@makes_links
@pytest.mark.parametrize("program", PROGRAMS)
def test_no_file_is_written_through_a_link_that_somebody_placed(many, program):
    (many / "victim").write_text("mine\n")
    (many / ".a.nc.checkpoint").symlink_to("victim")
    words = ("--boulders", "2000", "--checkpoint", "1e-9")
    ended = subprocess.run(command(program, "a.nc", *words), cwd=many, stderr=subprocess.PIPE)
    assert ended.returncode == 0, ended.stderr
    assert (many / "victim").read_text() == "mine\n"
    assert (many / "a.nc").is_file() and not (many / "a.nc").is_symlink()
    assert not [path for path in many.glob(".*") if path.is_symlink()]


def test_what_differs_is_named(stopped, batch):
    def said(what):
        return (
            f"a.nc.checkpoint: belongs to a different run ({what} differs): remove it, or choose "
            "another output\n"
        )

    words = ("ready/case.nml", "-o", "a.nc", "--resume")
    assert batch(*words, "--seed", "3", cwd=stopped).stderr.endswith(said("&case seed"))
    with netCDF4.Dataset(stopped / "a.nc.checkpoint", "r+") as file:
        file.version = "9"
    assert batch(*words, cwd=stopped).stderr.endswith(said("version"))
    with netCDF4.Dataset(stopped / "a.nc.checkpoint", "r+") as file:
        file.version = rockfall.__version__
        file.input_checksums = file.input_checksums.replace("dem", "DEM")
    assert batch(*words, cwd=stopped).stderr.endswith(said("dem"))


def test_what_cannot_be_read_is_refused(stopped):
    path = stopped / "a.nc.checkpoint"
    good = path.read_bytes()
    with netCDF4.Dataset(path) as file:  # values have checksums
        at = good.index(file["travel_time"][...].data.tobytes())
    unreadable = "exists but is not a readable checkpoint: "
    damaged = good[:at] + bytes(64) + good[at + 64 :]
    for bad, said in (good[:-700], unreadable), (b"mine", unreadable), (damaged, "is damaged: "):
        path.write_bytes(bad)
        refused(stopped, f"a.nc.checkpoint: {said}", "--resume")
    path.unlink()
    path.mkdir()
    refused(stopped, f"a.nc.checkpoint: {unreadable}")


@pytest.mark.all
def test_values_that_no_run_has_are_refused(stopped, subtests):
    good = (stopped / "a.nc.checkpoint").read_bytes()
    wrong = {
        "status": 9,
        "tally_cell": 10**9,
        "tally_shared_source": 10**9,
        "crossing_omega": np.inf,
    }
    wrong |= {"crossing_boulder": 10**9, "crossing_line": 9}
    wrong |= {"volume": -1, "stop_x": 1e30, "start_y": -1e7, "plan_distance": -1}
    for name, value in wrong.items():
        (stopped / "a.nc.checkpoint").write_bytes(good)
        with netCDF4.Dataset(stopped / "a.nc.checkpoint", "r+") as file:
            file.set_auto_maskandscale(False)
            file[name][..., 0] = value
        with subtests.test(name=name):
            refused(stopped, f"a.nc.checkpoint: is damaged: {name}"[:37], "--resume")


def test_a_lock_is_heeded_by_both_and_ends_with_its_process(many, batch):
    """Both programs refuse an output that another run writes, and a file with the name of the lock
    that is not a lock."""
    running = subprocess.Popen(
        command("rockfall-batch", "a.nc", "--boulders", "1000000", "--checkpoint", "0"), cwd=many
    )
    while not (many / "a.nc.lock").exists():
        time.sleep(0.01)
    wait_until_busy(running.pid, 0.3)  # after it has reserved disk space
    refused(many, "a.nc.lock: another run is writing this output")
    running.kill()
    running.wait()
    few = ("--boulders", "1")
    assert subprocess.run(command("rockfall", "a.nc", *few), cwd=many).returncode == 0
    assert not (many / "a.nc.lock").exists()
    (many / "a.nc").unlink()
    (many / "a.nc.lock").write_text("mine")
    refused(many, "a.nc.lock: exists but is not a lock: choose another output")


@pytest.mark.all
def test_a_full_disk_is_said_once_and_the_last_good_checkpoint_stays(many, batch):
    """A limit of 2 MB has room for the rows (1.8 MB), but not for the result. Without the limit the
    run resumes."""
    words = ("ready/case.nml", "-o", "a.nc", "--checkpoint", "1e-9", "--quiet")
    ended = batch(*words, cwd=many, limit=2_000_000)
    *warnings, last = ended.stderr.splitlines()
    assert ended.returncode == 2 and last.startswith("rockfall-batch: a.nc: ")
    said = [line for line in warnings if "further checkpoints are written" in line]
    assert len(said) <= 1  # none if the last due save fitted
    start = "rockfall-batch: warning: a.nc.checkpoint: cannot be written: "
    assert all(line.startswith(start) for line in said)
    assert not list(many.glob(".*"))
    if (many / "a.nc.checkpoint").exists():
        assert boulders_in(many / "a.nc.checkpoint") > 0
    assert batch(*words, "--resume", cwd=many).returncode == 0
    same_results(result_of(many / "a.nc"), rockfall.run(rockfall.read_case(many / "case.nml")))


@pytest.mark.all
@preloads
def test_a_crash_at_every_step(ready):
    """A run is ended at its first file operation, then at its second, and so on. After each, one
    run is interrupted at its start and the next completes."""
    shim = build_shim(ready)
    words = ["--checkpoint", "1e-9", "--resume", "--overwrite", "--boulders", "400"]

    def run(**how):
        return subprocess.run(
            command("rockfall-batch", "a.nc", *words),
            cwd=ready,
            env=shim | how,
            capture_output=True,
        ).returncode

    assert run() == 0
    whole = rockfall.merge([ready / "a.nc"])
    (ready / "a.nc").unlink()
    ended, step = CRASHED, 0
    while ended == CRASHED:  # until a run completes
        step += 1
        ended = run(CRASH_AT=str(step))
        if ended == CRASHED:
            assert run(INTERRUPT_READY="1") in (INTERRUPTED, 0)  # 0: all boulders were saved
            assert run() == 0
        if step in (4, 8):  # after a save, and during another
            same_results(rockfall.merge([ready / "a.nc"]), whole)
        assert not list(ready.glob("a.nc.*"))
        (ready / "a.nc").unlink()
    assert step > 8  # minimum number of calls of a run with one save


@pytest.mark.all
def test_comments_and_threads_may_differ(stopped, batch):
    case = stopped / "ready/case.nml"
    case.write_text("! again\n" + case.read_text(encoding="utf-8"), encoding="utf-8")
    done = batch(case, "-o", "a.nc", "--resume", "--threads", "2", "--quiet", cwd=stopped)
    assert done.returncode == 0
    assert sorted(os.listdir(stopped)).count("a.nc.checkpoint") == 0
