# SPDX-License-Identifier: BSD-3-Clause
"""Checkpoints: a run killed at any instant resumes with bit-identical results."""

import os
import re
import shutil
from contextlib import contextmanager, suppress

import pytest

import rockfall
from programs import Killed, killed_after
from rockfall.cli import main
from rockfall.scene.read import read_scene
from rockfall.simulation import simulate
from rockfall.simulation.parts import checkpoint
from rockfall.simulation.parts.checkpoint import Checkpoint
from rockfall.simulation.parts.lock import locked
from same import same
from scenes import case_in, grid, place, rough

Z = rough()


@pytest.fixture(autouse=True)
def no_rest(monkeypatch):
    monkeypatch.setattr(checkpoint, "REST", 0.0)


@pytest.fixture
def scene(tmp_path):
    return read_scene(case_in(tmp_path, **place()), dem=Z, transform=grid(Z))


def test_a_run_goes_on_where_it_was_killed(scene, tmp_path, monkeypatch):
    whole = simulate.run_scene(scene)
    for _ in range(4):
        with monkeypatch.context() as patch:
            killed_after(patch, 3)
            with pytest.raises(Killed):
                simulate.run_scene(scene, chunk=20, checkpoint=Checkpoint(tmp_path / "c", 0.0))
    flown = []
    fly = simulate._run_range
    monkeypatch.setattr(simulate, "_run_range", lambda *a: flown.append(a[2]) or fly(*a))
    saved = Checkpoint(tmp_path / "c", 0.0)
    result = simulate.run_scene(scene, chunk=20, threads=2, checkpoint=saved)
    same(result, whole)
    assert sum(flown) == 403 - 4 * 3 * 20  # completed boulders are not run again
    assert result.attrs["cpu_seconds"] > 0


def test_saves_take_a_twentieth_of_the_time_at_most(scene, tmp_path, monkeypatch):
    """Chunks and saves take one second each: a save begins every 21 seconds."""
    now, begun = [0.0], []

    def slow(*_):
        begun.append(now[0])
        now[0] += 1.0

    monkeypatch.setattr(checkpoint, "REST", 20.0)
    monkeypatch.setattr(checkpoint.time, "monotonic", lambda: now[0])
    for name in "put_netcdf", "sync":
        monkeypatch.setattr(checkpoint, name, slow if name == "put_netcdf" else lambda _: None)
    monkeypatch.setattr(checkpoint.os, "replace", lambda *_: None)
    saved, tally = Checkpoint(tmp_path / "c", 0.5), simulate.start(scene, 1)
    for tally.done in range(1, 100):
        now[0] += 1.0
        saved.look(tally)
    assert begun[:3] == [1.0, 22.0, 43.0]


def crash_at(monkeypatch, step):
    """Raise `Killed` at call number `step`, and at all later calls, that sync, rename or remove a
    file; return the list of calls."""
    count = []

    def crashing(do):
        def call(*arguments, **how):
            count.append(do)
            if len(count) >= step:
                raise Killed
            return do(*arguments, **how)

        return call

    monkeypatch.setattr(os, "fsync", lambda _: None)  # written data outlives a process
    for name in "replace", "fsync", "unlink":
        monkeypatch.setattr(checkpoint.os, name, crashing(getattr(os, name)))
    return count


def interrupted(run, *arguments, **how):
    """Call `run`, and end it by Ctrl-C before its first chunk."""

    @contextmanager
    def at_once():
        yield lambda: True

    with pytest.MonkeyPatch.context() as patch, pytest.raises(simulate.Interrupted):
        patch.setattr(simulate, "interrupts", at_once)
        run(*arguments, **how)


@pytest.mark.all
def test_a_crash_at_every_step_of_a_save(scene, tmp_path, monkeypatch):
    """Each crash comes between two runs that are interrupted at their start; the final result is
    that of a complete run."""
    whole, step, steps = simulate.run_scene(scene), 0, []
    before = tmp_path / "before"
    with monkeypatch.context() as patch, pytest.raises(Killed):
        killed_after(patch, 2)
        simulate.run_scene(scene, chunk=20, checkpoint=Checkpoint(before, 0.0))

    def run(output):
        return simulate.run_scene(scene, chunk=200, checkpoint=Checkpoint(output, 0.0))

    while len(steps) == step:  # until a run is complete
        step += 1
        output = tmp_path / f"{step}"
        shutil.copy(f"{before}.checkpoint", f"{output}.checkpoint")
        interrupted(run, output)
        with monkeypatch.context() as patch:
            steps = crash_at(patch, step)
            with suppress(Killed):
                run(output)
        interrupted(run, output)
        same(run(output), whole)
    assert step > 2 * 3  # saves times steps per save


def test_a_full_disk_is_said_once_and_the_run_goes_on(scene, tmp_path, monkeypatch):
    said = []
    saved = Checkpoint(tmp_path / "c", 0.0, said.append)

    def full(path):
        if path == saved.part and saved.path.exists():
            raise OSError(28, "No space left on device")

    monkeypatch.setattr(checkpoint, "sync", full)
    result = simulate.run_scene(scene, chunk=20, checkpoint=saved)
    assert said == [f"{saved.path}: no further checkpoints are written: No space left on device"]
    monkeypatch.undo()
    same(result, simulate.run_scene(scene))
    assert Checkpoint(tmp_path / "c", 0.0).found() == 20 and not saved.part.exists()
    same(simulate.run_scene(scene, checkpoint=Checkpoint(tmp_path / "c", 0.0)), result)


def test_a_checkpoint_of_another_run_is_refused(scene, tmp_path):
    simulate.run_scene(scene, checkpoint=Checkpoint(tmp_path / "c", 0.0))

    def differs(other, what):
        said = re.escape(f"belongs to a different run ({what} differs)")
        with pytest.raises(rockfall.RockfallError, match=said):
            simulate.run_scene(other, checkpoint=Checkpoint(tmp_path / "c", 0.0))

    for group, key, value in ("case", "seed", 9), ("impact", "stop_speed", 0.4):
        changed = scene.case.replace(**{group: {key: value}})
        differs(read_scene(changed, dem=Z, transform=grid(Z)), f"&{group} {key}")
    differs(read_scene(scene.case, dem=Z + 1, transform=grid(Z)), "dem")


@pytest.mark.all
def test_threads_may_differ_and_a_finished_checkpoint_flies_nothing(scene, tmp_path, monkeypatch):
    whole = simulate.run_scene(scene, checkpoint=Checkpoint(tmp_path / "c", 0.0))
    monkeypatch.setattr(simulate, "_run_range", None)
    same(simulate.run_scene(scene, threads=2, checkpoint=Checkpoint(tmp_path / "c", 0.0)), whole)


# ---- files next to an output belong to one run and owner


RUN = ["run", "case.nml", "--quiet"]


def test_a_lock_that_was_removed_in_between_is_taken_anew(tmp_path, monkeypatch):
    """The previous owner removes the lock file after it is opened and before it is locked: the lock
    is taken again."""
    fcntl = pytest.importorskip("fcntl", reason="POSIX has these locks")
    output, flock, tries = tmp_path / "c", fcntl.flock, []

    def late(*arguments):
        if not tries:
            (tmp_path / "c.lock").unlink()
        tries.append(flock(*arguments))

    monkeypatch.setattr(fcntl, "flock", late)
    with locked(output, print), pytest.raises(rockfall.RockfallError, match="another run"):
        assert len(tries) == 2
        with locked(output, print):
            pass
    assert not list(tmp_path.iterdir())


def test_where_there_are_no_locks_the_run_says_so(tmp_path, monkeypatch):
    fcntl = pytest.importorskip("fcntl", reason="POSIX has these locks")

    def without(*_):
        raise OSError(38, "Function not implemented")

    said = []
    monkeypatch.setattr(fcntl, "flock", without)
    with locked(tmp_path / "c", said.append):
        pass
    assert len(said) == 1 and "cannot be locked (Function not implemented)" in said[0]


def test_the_commands_keep_a_checkpoint_until_the_result_is_written(
    few_boulders, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    run = [*RUN, "--checkpoint", "1e-9"]
    with monkeypatch.context() as patch:
        patch.setattr(simulate, "FIRST_CHUNK", 10)
        killed_after(patch, 1)
        with pytest.raises(Killed):
            main(run)
    assert sorted(os.listdir()) == ["case.nc.checkpoint", "case.nml"]
    assert main(run) == 2
    assert "continue with --resume, or remove it" in capsys.readouterr().err
    assert main([*run, "--resume"]) == 0
    assert sorted(os.listdir()) == ["case.nc", "case.nml"]
    resumed = rockfall.read_result("case.nc")
    same(resumed, rockfall.run(rockfall.read_case("case.nml")))
    assert main(["run", "case.nml", "--checkpoint", "-1"]) == 2
    assert main(["run", "case.nml", "--resume", "--until", "fraction@EL1<5%"]) == 2
