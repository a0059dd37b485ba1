# SPDX-License-Identifier: BSD-3-Clause
"""Checkpoints: a run that was killed, at any instant, goes on to the same bits."""

# ruff: noqa: F401, F811 - fixtures of other tests are taken by name

import fcntl
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
import pytest

import rockfall
from batch_case import write_long_case
from made import refused
from programs import Killed, find_program, killed_after
from rockfall.cli import main
from rockfall.scene.read import read_scene
from rockfall.simulation import checkpoint, simulate
from rockfall.simulation.checkpoint import Checkpoint
from rockfall.simulation.lock import LOCK, locked
from same import same
from scenes import case_in, grid, place, rough

Z = rough()


@pytest.fixture
def case(made):
    return write_long_case(made)


@pytest.fixture
def scene(tmp_path):
    return read_scene(case_in(tmp_path, **place()), dem=Z, transform=grid(Z))


def test_a_run_goes_on_where_it_was_killed(scene, tmp_path, monkeypatch):
    whole = simulate.run_scene(scene)
    folder = tmp_path / "c"
    for _ in range(4):
        with monkeypatch.context() as patch:
            killed_after(patch, 3)
            with pytest.raises(Killed):
                simulate.run_scene(scene, chunk=20, checkpoint=Checkpoint(folder, 0.0))
    flown = []
    fly = simulate._fly
    monkeypatch.setattr(simulate, "_fly", lambda *a: flown.append(a[2]) or fly(*a))
    result = simulate.run_scene(scene, chunk=20, threads=2, checkpoint=Checkpoint(folder, 0.0))
    same(result, whole)
    assert sum(flown) == 403 - 4 * 3 * 20  # what was done is not done again
    assert result.attrs["cpu_seconds"] > 0


def test_a_shard_too(scene, tmp_path, monkeypatch):
    folder = tmp_path / "c"
    with monkeypatch.context() as patch:
        killed_after(patch, 2)
        with pytest.raises(Killed):
            simulate.run_scene(scene, chunk=20, shard=(2, 3), checkpoint=Checkpoint(folder, 0.0))
    with refused(
        f"{folder}: is of another run, its boulders differs; remove it, or run without --resume "
        "elsewhere"
    ):
        simulate.run_scene(scene, shard=(1, 3), checkpoint=Checkpoint(folder, 0.0))
    result = simulate.run_scene(scene, shard=(2, 3), checkpoint=Checkpoint(folder, 0.0))
    same(result, simulate.run_scene(scene, shard=(2, 3)))


def crash_at(monkeypatch, step):
    """The process ends before it brings a file to disk, names or removes it, for the n-th time;
    returns how often it has done so."""
    count = []

    def crashing(do):
        def call(*arguments, **how):
            count.append(do)
            if len(count) >= step:
                raise Killed
            return do(*arguments, **how)

        return call

    monkeypatch.setattr(os, "fsync", lambda _: None)  # what is written outlives a process
    for name in "mkdir", "replace", "fsync", "unlink":
        monkeypatch.setattr(checkpoint.os, name, crashing(getattr(os, name)))
    return count


def interrupted(run, *arguments, **how):
    """A run that Ctrl-C ends before its first chunk."""

    @contextmanager
    def at_once():
        yield lambda: True

    with pytest.MonkeyPatch.context() as patch, pytest.raises(simulate.Interrupted):
        patch.setattr(simulate, "interrupts", at_once)
        run(*arguments, **how)


def test_a_crash_at_every_step_of_a_save(scene, tmp_path, monkeypatch):
    """Each after an interrupt right after `--resume`, and with another before it goes on."""
    whole, step, steps = simulate.run_scene(scene), 0, []
    before = tmp_path / "before"
    with monkeypatch.context() as patch, pytest.raises(Killed):
        killed_after(patch, 2)
        simulate.run_scene(scene, chunk=20, checkpoint=Checkpoint(before, 0.0))

    def run(folder):
        return simulate.run_scene(scene, chunk=200, checkpoint=Checkpoint(folder, 0.0))

    while len(steps) == step:  # until a run has come to its end
        step += 1
        folder = shutil.copytree(before, tmp_path / f"{step}")
        interrupted(run, folder)
        with monkeypatch.context() as patch:
            steps = crash_at(patch, step)
            with suppress(Killed):
                run(folder)
        interrupted(run, folder)
        same(run(folder), whole)
    assert step > 2 * 3 * 3  # saves, files, steps of each


def test_a_save_takes_no_name_that_the_state_has(scene, tmp_path, monkeypatch):
    folder, replace, taken = tmp_path / "c", os.replace, []

    def named(part, path):
        state = folder / "state.json"
        if state.exists() and path != state:
            archives = json.loads(state.read_text())["archives"]
            live = {f"{one['kind']}-{one['first']}-{one['last']}.npz" for one in archives}
            taken.append(path.name in live)
        replace(part, path)

    for _ in range(3):
        interrupted(simulate.run_scene, scene, checkpoint=Checkpoint(folder, 0.0))
        with monkeypatch.context() as patch, pytest.raises(Killed):
            patch.setattr(checkpoint.os, "replace", named)
            killed_after(patch, 2)
            simulate.run_scene(scene, chunk=20, checkpoint=Checkpoint(folder, 0.0))
    assert len(taken) > 6 and not any(taken)


@pytest.mark.parametrize("damage", ["other boulders", "longer", "other bytes", "missing"])
@pytest.mark.parametrize("kind", ["rows", "maps"])
def test_an_archive_that_is_not_that_of_the_state_is_refused(scene, tmp_path, kind, damage):
    """Also one that is sound, and of the same run, but of another instant."""
    folder = tmp_path / "c"
    simulate.run_scene(scene, chunk=100, checkpoint=Checkpoint(folder, 0.0))
    path = max(folder.glob(f"{kind}-*.npz"), key=lambda path: path.stat().st_size)
    good = path.read_bytes()
    if damage == "other boulders":
        simulate.run_scene(scene, chunk=37, checkpoint=Checkpoint(tmp_path / "other", 0.0))
        other = max((tmp_path / "other").glob("rows-*.npz"), key=lambda p: p.stat().st_size)
        path.write_bytes(other.read_bytes())
    elif damage == "longer":
        path.write_bytes(good + b"x")
    elif damage == "other bytes":
        path.write_bytes(good[:-1] + bytes([good[-1] ^ 1]))
    else:
        path.unlink()
    with pytest.raises(rockfall.RockfallError, match=f"^{folder}: cannot be read: .*{path.name}"):
        simulate.run_scene(scene, checkpoint=Checkpoint(folder, 0.0))


def test_a_full_disk_is_said_once_and_the_run_goes_on(scene, tmp_path, monkeypatch):
    said, sync = [], os.fsync
    saves = iter(range(100))

    def full(descriptor):
        if next(saves) > 5:
            raise OSError(28, "No space left on device")
        sync(descriptor)

    monkeypatch.setattr(checkpoint.os, "fsync", full)
    folder = tmp_path / "c"
    result = simulate.run_scene(scene, chunk=20, checkpoint=Checkpoint(folder, 0.0, said.append))
    assert said == [f"{folder}: no checkpoint: No space left on device"]
    monkeypatch.undo()
    same(result, simulate.run_scene(scene))
    assert Checkpoint(folder, 0.0).found() == 20
    same(simulate.run_scene(scene, checkpoint=Checkpoint(folder, 0.0)), result)


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ({"case": {"seed": 9}}, "case"),
        ({"impact": {"stop_speed": 0.4}}, "case"),
        ({"output": {"maps": ["passages"]}}, "case"),
    ],
)
def test_a_checkpoint_of_another_case_is_refused(scene, tmp_path, change, what):
    folder = tmp_path / "c"
    simulate.run_scene(scene, checkpoint=Checkpoint(folder, 0.0))
    other = read_scene(scene.case.replace(**change), dem=Z, transform=grid(Z))
    with pytest.raises(rockfall.RockfallError, match=f"of another run, its {what} differs"):
        simulate.run_scene(other, checkpoint=Checkpoint(folder, 0.0))
    other = read_scene(scene.case, dem=Z + 1, transform=grid(Z))
    with pytest.raises(rockfall.RockfallError, match="of another run, its input dem differs"):
        simulate.run_scene(other, checkpoint=Checkpoint(folder, 0.0))


def test_threads_may_differ_and_a_finished_checkpoint_flies_nothing(scene, tmp_path, monkeypatch):
    folder = tmp_path / "c"
    whole = simulate.run_scene(scene, checkpoint=Checkpoint(folder, 0.0))
    monkeypatch.setattr(simulate, "_fly", None)
    same(simulate.run_scene(scene, threads=2, checkpoint=Checkpoint(folder, 0.0)), whole)


def test_damaged_checkpoints_are_refused(scene, tmp_path):
    folder = tmp_path / "c"
    simulate.run_scene(scene, chunk=100, checkpoint=Checkpoint(folder, 0.0))
    good = folder / "state.json"
    text = good.read_text()
    for bad in ("", "{", "\x00", "[1]"):
        good.write_text(bad)
        with pytest.raises(rockfall.RockfallError, match="cannot be read"):
            simulate.run_scene(scene, checkpoint=Checkpoint(folder, 0.0))
    good.write_text(text)


# ---- the folder: for one run alone, and for nobody else's files


@pytest.fixture
def case_here(few_boulders, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


RUN = ["run", "case.nml", "--quiet"]


def everything(folder):
    return {path: path.is_file() and path.read_bytes() for path in folder.rglob("*")}


@pytest.mark.parametrize("more", [[], ["--resume"], ["--checkpoint", "0"]])
def test_a_second_run_on_an_output_is_refused(case_here, capsys, more):
    with locked(case_here / "case.nc.checkpoint", print):
        before = everything(case_here)
        assert main([*RUN, *more]) == 2
        words = "another run is at work on it; wait for its end, or choose another output"
        assert capsys.readouterr().err == f"rockfall: case.nc.checkpoint: {words}\n"
        if program := find_program():
            Path("case.nc.checkpoint").rename("b.nc.checkpoint")
            command = [program, "case.nml", "output=b.nc", f"checkpoint={len(more)}"]
            ended = subprocess.run(command, capture_output=True, text=True)
            assert ended.returncode == 2
            assert ended.stderr == f"rockfall-batch: b.nc.checkpoint: {words}\n"
            Path("b.nc.checkpoint").rename("case.nc.checkpoint")
        assert everything(case_here) == before
    assert not Path("case.nc.checkpoint").exists()
    assert main([*RUN, *more]) == 0


def test_the_lock_of_rockfall_batch_is_seen(case, tmp_path, monkeypatch, capsys):
    """A run of it that lasts; killed, it holds the lock no more."""
    monkeypatch.chdir(case.parent)
    command = [find_program(), "case.nml", "output=b.nc", "boulders=1000000", "checkpoint=0"]
    process = subprocess.Popen(command)
    lock = Path("b.nc.checkpoint") / LOCK
    while not (lock.exists() and lock.read_text()):
        time.sleep(0.01)
    run = [*RUN, "--boulders", "1", "-o", "b.nc"]
    assert main(run) == 2 and "another run is at work on it" in capsys.readouterr().err
    assert subprocess.run(command, capture_output=True).returncode == 2
    process.kill()
    process.wait()
    assert main(run) == 0
    assert not lock.parent.exists()


def test_a_lock_that_was_removed_in_between_is_taken_anew(tmp_path, monkeypatch):
    """Who held it ends between our open and our lock: the file that we have open has no name."""
    folder, flock, tries = tmp_path / "c", fcntl.flock, []

    def late(*arguments):
        if not tries:
            (folder / LOCK).unlink()
        tries.append(flock(*arguments))

    monkeypatch.setattr(fcntl, "flock", late)
    with locked(folder, print), pytest.raises(rockfall.RockfallError, match="another run"):
        assert len(tries) == 2
        with locked(folder, print):
            pass
    assert not folder.exists()


def test_where_there_are_no_locks_the_run_says_so(tmp_path, monkeypatch):
    def without(*_):
        raise OSError(38, "Function not implemented")

    said = []
    monkeypatch.setattr(fcntl, "flock", without)
    with locked(tmp_path / "c", said.append):
        pass
    assert len(said) == 1 and "cannot be locked (Function not implemented)" in said[0]


def test_a_folder_of_somebody_else_is_refused_and_left_alone(case_here, capsys):
    mine = case_here / "case.nc.checkpoint"
    mine.mkdir()
    (mine / "notes.txt").write_text("mine")
    before = everything(case_here)
    for more in [], ["--resume"]:
        assert main([*RUN, *more]) == 2
        assert capsys.readouterr().err == (
            "rockfall: case.nc.checkpoint: is there, and no checkpoint; choose another output\n"
        )
    assert everything(case_here) == before
    shutil.rmtree(mine)
    mine.write_text("a file")
    assert main(RUN) == 2 and mine.read_text() == "a file"


def test_an_end_that_is_interrupted_does_no_harm(case_here, monkeypatch):
    """The state is gone, the result is there: what else is left is ours, and goes with the next."""
    unlink, gone = Path.unlink, []

    def pressed(path, **how):
        if path.name.startswith("maps-") and "state.json" in gone:
            raise KeyboardInterrupt
        gone.append(path.name)
        unlink(path, **how)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "unlink", pressed)
        assert main([*RUN, "--checkpoint", "1e-9"]) == 130
    assert Path("case.nc").exists() and Path("case.nc.checkpoint").exists()
    assert main(RUN) == 0
    assert not Path("case.nc.checkpoint").exists()


def test_only_own_files_are_removed_at_the_end(case_here, monkeypatch):
    with monkeypatch.context() as patch, pytest.raises(Killed):
        patch.setattr(simulate, "FIRST_CHUNK", 10)
        killed_after(patch, 1)
        main([*RUN, "--checkpoint", "1e-9"])
    folder = case_here / "case.nc.checkpoint"
    notes = {"notes.txt", "rows-1.npz", "state.json.bak"}
    for name in notes:
        (folder / name).write_text("mine")
    (folder / "rows-11-30.npz.part").write_text("of a run that was killed")
    assert main([*RUN, "--resume"]) == 0
    assert {*os.listdir(folder)} == notes


def test_the_commands_keep_a_checkpoint_until_the_result_is_written(
    few_boulders,
    tmp_path,
    monkeypatch,
    capsys,
):
    monkeypatch.chdir(tmp_path)
    run = ["run", "case.nml", "--quiet", "--checkpoint", "1e-9"]
    with monkeypatch.context() as patch:
        patch.setattr(simulate, "FIRST_CHUNK", 10)
        killed_after(patch, 1)
        with pytest.raises(Killed):
            main(run)
    assert (tmp_path / "case.nc.checkpoint").is_dir() and not (tmp_path / "case.nc").exists()
    assert main(run) == 2
    assert "go on with --resume, or remove it" in capsys.readouterr().err
    assert main([*run, "--resume"]) == 0
    assert not (tmp_path / "case.nc.checkpoint").exists()
    resumed = rockfall.read_result("case.nc")
    assert main([*run, "--resume"]) == 0  # nothing to go on from: all of it
    same(resumed, rockfall.read_result("case.nc"))
    assert main(["run", "case.nml", "--checkpoint", "-1"]) == 2
    assert main(["run", "case.nml", "--resume", "--until", "share@EL1<5%"]) == 2


def test_kills_at_random_instants(few_boulders, tmp_path):
    """SIGKILL, and `--resume`, until eight have hit a run; then it is left to end."""
    command = [sys.executable, "-m", "rockfall", "run", few_boulders, "--quiet", "--boulders"]
    command += ["60000", "--checkpoint", "0.01", "--resume", "-o", tmp_path / "killed.nc"]
    instants = random.Random(4)
    environment = {**os.environ, "OMP_NUM_THREADS": "2"}
    begun = tmp_path / "killed.nc.checkpoint" / "state.json"
    kills = 0
    while kills < 8:
        before = begun.stat().st_mtime_ns if begun.exists() else 0
        process = subprocess.Popen(command, env=environment)
        while process.poll() is None:  # until it has done something this time
            if begun.exists() and begun.stat().st_mtime_ns > before:
                break
            time.sleep(0.002)
        time.sleep(instants.uniform(0, 0.03))
        process.send_signal(signal.SIGKILL)
        if process.wait() == 0:
            break
        kills += 1
        assert not (tmp_path / "killed.nc").exists()
    assert kills >= 1
    if not (tmp_path / "killed.nc").exists():
        assert subprocess.run(command, env=environment).returncode == 0
    case = rockfall.read_case(few_boulders).replace(case={"boulders": 60000})
    rockfall.write_result(rockfall.run(case), tmp_path / "whole.nc")
    killed, whole = (rockfall.read_result(tmp_path / f"{name}.nc") for name in ("killed", "whole"))
    same(killed, whole)
    assert np.array_equal(killed["boulder"], np.arange(1, 60001))
    assert sorted(path.name for path in tmp_path.glob("*.nc*")) == ["killed.nc", "whole.nc"]
