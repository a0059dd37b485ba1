# SPDX-License-Identifier: BSD-3-Clause
"""Checkpoints: a run that was killed, at any instant, goes on to the same bits."""

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

import rockfall
from made import refused
from rockfall import checkpoint, simulate
from rockfall.checkpoint import Checkpoint
from rockfall.cli import main
from rockfall.scene import read_scene
from scenes import grid, rough
from test_parts import case_in, place, same

Z = rough()


@pytest.fixture
def scene(tmp_path):
    return read_scene(case_in(tmp_path, **place()), dem=Z, transform=grid(Z))


class Killed(BaseException):
    pass


def killed_after(monkeypatch, chunks):
    """A run ends like one that is killed, after so many chunks."""
    calls = iter(range(chunks))
    fly = simulate._fly

    def until(*arguments):
        if next(calls, None) is None:
            raise Killed
        return fly(*arguments)

    monkeypatch.setattr(simulate, "_fly", until)


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


@pytest.mark.parametrize("fails", range(1, 7))
def test_killed_while_writing_the_last_good_one_stays(scene, tmp_path, monkeypatch, fails):
    """Files are written, synced and renamed: stop before the k-th rename of a second save."""
    folder, whole = tmp_path / "c", simulate.run_scene(scene)
    count, replace = iter(range(1, 100)), os.replace

    def cut(*names):
        if next(count) == fails:
            raise Killed
        replace(*names)

    with monkeypatch.context() as patch:
        patch.setattr(checkpoint.os, "replace", cut)
        with pytest.raises(Killed):
            simulate.run_scene(scene, chunk=50, checkpoint=Checkpoint(folder, 0.0))
    done = Checkpoint(folder, 0.0).found()
    assert done == 50 * ((fails - 1) // 3)  # rows, maps, state of each save
    same(simulate.run_scene(scene, checkpoint=Checkpoint(folder, 0.0)), whole)


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
    for name in json.loads(text)["rows"][1], json.loads(text)["maps"]:
        shutil.copy(folder / name, tmp_path / "keep")
        (folder / name).write_bytes(b"PK\x03\x04 not a file")
        with pytest.raises(rockfall.RockfallError, match="cannot be read"):
            simulate.run_scene(scene, checkpoint=Checkpoint(folder, 0.0))
        shutil.copy(tmp_path / "keep", folder / name)


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


def test_twenty_kills_at_random_instants(few_boulders, tmp_path):
    """SIGKILL, and `--resume`, until twenty have hit a run; then it is left to end."""
    command = [sys.executable, "-m", "rockfall.cli", "run", few_boulders, "--quiet", "--boulders"]
    command += ["60000", "--checkpoint", "0.01", "--resume", "-o", tmp_path / "killed.nc"]
    instants = random.Random(4)
    environment = {**os.environ, "OMP_NUM_THREADS": "2"}
    begun = tmp_path / "killed.nc.checkpoint" / "state.json"
    kills = 0
    while kills < 20:
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
