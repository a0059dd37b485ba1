# SPDX-License-Identifier: BSD-3-Clause
"""Checkpoints of rockfall-batch: a run that was killed, whenever, goes on to the same bits."""

import hashlib
import os
import random
import shutil
import signal
import subprocess
import time

import pytest
import xarray as xr

import rockfall
from batch_case import done, write_long_case
from benchmarks.stability.kills import CRASHED, INTERRUPTED, build_shim, same
from programs import find_program
from rockfall.cli import main
from rockfall.simulation.lock import LOCK
from same import same_bits

OWN = {"run.csv", "case.nml"}  # these have times and threads


@pytest.fixture
def case(made):
    return write_long_case(made)


def start(folder, *words):
    command = [find_program(), folder / "case/case.nml", "quiet=true", "checkpoint=0.001"]
    command += ["threads=1", *words]
    return subprocess.Popen(command, cwd=folder, stderr=subprocess.PIPE, text=True)


def kill(folder, output, wait, *words):
    """Kill a run some time after it has kept something; whether it had not ended before."""
    state = folder / f"{output}.checkpoint" / "state.txt"
    before = state.stat().st_mtime_ns if state.exists() else 0
    process = start(folder, f"output={output}", "resume=true", *words)
    while process.poll() is None:
        if state.exists() and state.stat().st_mtime_ns > before:
            break
        time.sleep(0.001)
    time.sleep(wait)
    process.send_signal(signal.SIGKILL)
    assert process.communicate()[1] == ""
    return process.returncode != 0


def same_files(one, other):
    assert {path.name for path in one.iterdir()} == {path.name for path in other.iterdir()}
    for path in one.iterdir():
        if path.name not in OWN:
            assert path.read_bytes() == (other / path.name).read_bytes(), path.name


def same_results(one, other):
    with xr.open_dataset(one) as a, xr.open_dataset(other) as b:
        assert set(a.variables) == set(b.variables)
        for name in b.variables:
            assert name == "line" or same_bits(a[name].values, b[name].values), name
        assert {**a.attrs, "case": 0, "threads": 0, "wall_seconds": 0, "cpu_seconds": 0} == {
            **b.attrs, "case": 0, "threads": 0, "wall_seconds": 0, "cpu_seconds": 0
        }  # fmt: skip


@pytest.mark.parametrize("output", ["killed", "killed.nc"])
def test_twenty_kills_at_random_instants(output, case, batch, request, tmp_path):
    """SIGKILL, and `resume=true`, with one thread and two in turn."""
    if output.endswith(".nc"):
        request.getfixturevalue("netcdf")
    instants = random.Random(4)
    kills, before, many = 0, 0, "boulders=6000"
    while kills < 20:
        if not kill(tmp_path, output, instants.uniform(0, 0.02), many, f"threads={1 + kills % 2}"):
            break
        kills += 1
        assert not (tmp_path / output).exists()
        assert done(tmp_path, output) >= before
        before = done(tmp_path, output)
    assert kills >= 5
    if not (tmp_path / output).exists():
        ended = batch(case, f"output={output}", many, "resume=true", cwd=tmp_path)
        assert (ended.returncode, ended.stderr) == (0, "")
    whole = output.replace("killed", "whole")
    assert batch(case, f"output={whole}", many, cwd=tmp_path).returncode == 0
    (same_results if output.endswith(".nc") else same_files)(tmp_path / output, tmp_path / whole)
    assert sorted(path.name for path in tmp_path.glob("[!.]*")) == ["case", output, whole]


@pytest.fixture
def stopped(case, tmp_path):
    """A folder with `run.checkpoint`, of a run that was killed."""
    assert kill(tmp_path, "run", 0)
    return tmp_path


def files(folder):
    """All but the lock that a killed run left: nobody holds it, and who comes next removes it."""
    paths = [path for path in sorted(folder.rglob("*")) if path.name != LOCK]
    return {path: path.is_file() and path.read_bytes() for path in paths}


def refused(batch, folder, words, *more, output="run"):
    """One line, exit status 2, and nothing changes on disk."""
    before = files(folder)
    ended = batch("case/case.nml", f"output={output}", *more, cwd=folder)
    assert (ended.returncode, ended.stdout) == (2, "")
    assert ended.stderr == f"rockfall-batch: {words}\n"
    assert files(folder) == before


def test_what_was_done_is_not_done_again_and_times_add_up(stopped, batch):
    seconds = (stopped / "run.checkpoint/state.txt").read_text().splitlines()[-2].split()[-2:]
    state = stopped / "run.checkpoint/state.txt"
    lines = state.read_text().splitlines(keepends=True)[:-1]
    lines[-1] = lines[-1].replace(" ".join(seconds), "1000.25 2000.5")
    state.write_text(signed("".join(lines)))
    ended = batch("case/case.nml", "output=run", "resume=true", cwd=stopped)
    assert ended.returncode == 0
    about = dict(line.split(",", 1) for line in (stopped / "run/run.csv").read_text().splitlines())
    assert 1000.25 < float(about["wall_seconds"]) < 1100
    assert 2000.5 < float(about["cpu_seconds"]) < 2100


def signed(text):
    """With the last line of a state."""
    return f"{text}sha256: {hashlib.sha256(text.encode()).hexdigest()}\n"


def test_a_checkpoint_that_lies_there_is_not_overwritten_unasked(stopped, batch):
    words = "run.checkpoint: holds a run that was stopped; go on with resume=true, or remove it"
    refused(batch, stopped, words)
    refused(batch, stopped, words, "resume=false", "checkpoint=0")
    shutil.rmtree(stopped / "run.checkpoint")
    ended = batch("case/case.nml", "output=run", "resume=true", cwd=stopped)  # from nothing
    assert ended.returncode == 0 and sorted(os.listdir(stopped)) == ["case", "run"]


def test_none_is_written_where_none_is_asked(case, tmp_path):
    process = start(tmp_path, "output=run", "checkpoint=0")
    while process.poll() is None:
        if (tmp_path / "run.checkpoint").exists():
            assert set(os.listdir(tmp_path / "run.checkpoint")) <= {LOCK}
        time.sleep(0.01)
    assert process.communicate()[1] == "" and process.returncode == 0


def test_a_crash_at_every_step(case, netcdf, tmp_path):
    """Each is followed by an interrupt right after the next has begun."""
    shim = build_shim(tmp_path)
    words = ["case/case.nml", "boulders=400", "quiet=true", "checkpoint=1e-9", "resume=true"]

    def run(output, **how):
        command = [find_program(), *words, f"output={output}.nc"]
        return subprocess.run(command, cwd=tmp_path, env=shim | how, capture_output=True).returncode

    assert run("whole") == 0
    ended, step = CRASHED, 0
    while ended == CRASHED:  # until a run has come to its end
        step += 1
        ended = run("killed", CRASH_AT=str(step))
        if ended == CRASHED:
            assert run("killed", INTERRUPT_READY="1") == INTERRUPTED
            assert run("killed") == 0
        assert same(tmp_path / "killed.nc", tmp_path / "whole.nc")
        assert not (tmp_path / "killed.nc.checkpoint").exists()
        (tmp_path / "killed.nc").unlink()
    assert step > 12  # the fewest calls of a run with one save


def change(name, old, new):
    def do(folder):
        path = folder / "case" / name
        path.write_text(path.read_text().replace(old, new, 1))

    return do


def other_dem(folder):
    path = folder / "case/dem.asc"
    path.write_text(path.read_text() + "\n")


def other_version(folder):
    path = folder / "run.checkpoint/state.txt"
    text = path.read_text().replace("rockfall-batch ", "rockfall-batch 9", 1)
    path.write_text(signed("".join(text.splitlines(keepends=True)[:-1])))


OTHERS = {
    "seed": (change("case.nml", "seed = 1", "seed = 2"), "case", []),
    "seed=": (None, "case", ["seed=3"]),
    "boulders=": (None, "case", ["boulders=60"]),
    "stop_speed": (change("case.nml", "stop_speed = 0.4", "stop_speed = 0.5"), "case", []),
    "maps": (change("case.nml", "'passages', ", ""), "case", []),
    "dem": (other_dem, "dem", []),
    "table": (change("zones.csv", "0.35", "0.36"), "table", []),
    "sets": (change("sets.nml", "ratio", " ratio"), "sets", []),
    "version": (other_version, "version", []),
}


@pytest.mark.parametrize("what", OTHERS)
def test_a_checkpoint_of_another_run_is_refused(what, stopped, batch):
    edit, differs, words = OTHERS[what]
    if edit:
        edit(stopped)
    message = (
        f"run.checkpoint: is of another run, its {differs} differs; remove it, or run elsewhere"
    )
    refused(batch, stopped, message, "resume=true", *words)


def test_comments_and_threads_may_differ(stopped, batch):
    case = stopped / "case/case.nml"
    case.write_text("! again\n" + case.read_text())
    ended = batch(case, "output=run", "resume=true", "threads=1", cwd=stopped)
    assert (ended.returncode, ended.stderr) == (0, "")
    assert batch(case, "output=whole", cwd=stopped).returncode == 0
    same_files(stopped / "run", stopped / "whole")


@pytest.mark.parametrize("damage", ["cut", "emptied", "removed", "other"])
def test_damaged_files_are_refused(damage, stopped, batch):
    folder = stopped / "run.checkpoint"
    turn = (folder / "state.txt").read_text().splitlines()[-2].split()[3]
    for name in ("fates", "crossings", f"tallies-{turn}", "state.txt"):
        good = (folder / name).read_bytes()
        if damage == "removed":
            (folder / name).unlink()
        else:
            bad = {"cut": good[:-700], "emptied": b"", "other": os.urandom(len(good))}[damage]
            if name in ("fates", "crossings") and damage == "cut":
                bad = good[:9000]  # there may be more rows than count
            (folder / name).write_bytes(bad)
        if name != "state.txt" or damage != "removed":  # else there is no checkpoint
            message = f"run.checkpoint: {name} is damaged; remove the folder to begin anew"
            refused(batch, stopped, message, "resume=true")
        (folder / name).write_bytes(good)


def test_a_full_disk_is_said_once_and_the_last_good_state_stays(case, batch, tmp_path):
    """Here the result does not fit either: with more room the run goes on."""
    limit = 136 * 3000  # bytes: the first 1024 boulders fit
    ended = batch(case, "output=run", "checkpoint=0.001", cwd=tmp_path, limit=limit)
    first, second = ended.stderr.splitlines()
    assert ended.returncode == 2
    assert first == (
        "rockfall-batch: warning: run.checkpoint: no checkpoint: cannot be written "
        "(the disk may be full)"
    )
    assert second.startswith("rockfall-batch: run: cannot be written")
    assert done(tmp_path, "run") == 1024
    assert batch(case, "output=run", "resume=true", cwd=tmp_path).returncode == 0
    assert batch(case, "output=whole", cwd=tmp_path).returncode == 0
    same_files(tmp_path / "run", tmp_path / "whole")
    assert sorted(os.listdir(tmp_path)) == ["case", "run", "whole"]


def test_what_is_no_checkpoint_is_refused_and_left_alone(case, batch, tmp_path):
    place = tmp_path / "run.checkpoint"
    place.write_text("a file")
    refused(batch, tmp_path, "run.checkpoint: cannot be written (is it a folder, and writable?)")
    place.unlink()
    place.mkdir()
    (place / "notes.txt").write_text("mine")
    refused(batch, tmp_path, "run.checkpoint: is there, and no checkpoint; choose another output")


def test_only_own_files_are_removed_at_the_end(stopped, batch):
    (stopped / "run.checkpoint/notes.txt").write_text("mine")
    ended = batch("case/case.nml", "output=run", "resume=true", cwd=stopped)
    assert (ended.returncode, ended.stderr) == (0, "")
    assert os.listdir(stopped / "run.checkpoint") == ["notes.txt"]


def test_parts_killed_and_resumed_join_to_the_run(case, batch, netcdf, tmp_path):
    parts = [f"{k}.nc" for k in (1, 2, 3)]
    for k, part in enumerate(parts, start=1):
        kill(tmp_path, part, 0, f"shard={k}/3")
    message = (
        "1.nc.checkpoint: is of another run, its boulders differs; remove it, or run elsewhere"
    )
    refused(batch, tmp_path, message, "resume=true", "shard=2/3", output="1.nc")
    for k, part in enumerate(parts, start=1):
        ended = batch(case, f"shard={k}/3", f"output={part}", "resume=true", cwd=tmp_path)
        assert (ended.returncode, ended.stderr) == (0, "")
    assert batch(case, "output=whole.nc", cwd=tmp_path).returncode == 0
    joined = rockfall.merge([tmp_path / part for part in parts])
    whole = rockfall.read_result(tmp_path / "whole.nc")
    xr.testing.assert_equal(joined, whole)
    for name in whole.variables:
        assert name == "line" or same_bits(joined[name].values, whole[name].values), name


def test_each_door_refuses_the_checkpoint_of_the_other(stopped, batch, capsys, monkeypatch):
    monkeypatch.chdir(stopped)
    (stopped / "run.checkpoint").rename("run.nc.checkpoint")
    before = files(stopped)
    for resume in ([], ["--resume"]):
        assert main(["run", "case/case.nml", "--quiet", "-o", "run.nc", *resume]) == 2
        assert capsys.readouterr().err == (
            "rockfall: run.nc.checkpoint: is of rockfall-batch; go on with that, or remove it\n"
        )
    assert files(stopped) == before
    (stopped / "run.nc.checkpoint/state.txt").rename("run.nc.checkpoint/state.json")
    for resume in ("true", "false"):
        words = "run.nc.checkpoint: is of `rockfall run`; go on with that, or remove it"
        refused(batch, stopped, words, f"resume={resume}", output="run.nc")


@pytest.mark.parametrize(
    ("word", "message"),
    [
        ("checkpoint=-1", "checkpoint = -1: must be >= 0 seconds"),
        ("checkpoint=nan", "checkpoint = nan: must be >= 0 seconds"),
        ("checkpoint=1e999", "checkpoint = 1e999: must be >= 0 seconds"),
        ("checkpoint=often", "checkpoint = often: must be >= 0 seconds"),
        ("resume=perhaps", "resume = perhaps: must be true or false"),
    ],
)
def test_bad_arguments_are_one_line(word, message, case, batch, tmp_path):
    refused(batch, tmp_path, message, word)
