# SPDX-License-Identifier: BSD-3-Clause
"""Ctrl-C and SIGTERM: results are kept, no file is incomplete, and a second signal ends a run at
once."""

import os
import re
import signal
import subprocess
import sys
import time

import pytest

import rockfall
from benchmarks.stability.kills import build_shim
from programs import (
    PROGRESS,
    SAYS_PROGRESS,
    find_program,
    make_full_case,
    preloads,
    sends_signals,
    wait_until_running,
)
from rockfall import interrupts
from rockfall.cli import main
from rockfall.files import export
from rockfall.scene.prepare import prepare
from rockfall.simulation.parts.part_file import boulders_in

ONE_CHUNK = """import sys
from rockfall.simulation import simulate
simulate.FIRST_CHUNK, simulate.MAX_SECONDS, call = 10**8, 1e9, simulate._run_range
simulate._run_range = lambda *of: print("begun", flush=True) or call(*of)
"""
RUN = "import sys; from rockfall.cli import main; sys.exit(main(sys.argv[1:]))"
#: Two signals count as one, however long the time between them.
TOGETHER = "from rockfall import interrupts; interrupts.TOGETHER = float('inf')\n"


def start(words, cwd, program=RUN, **env):
    command = [sys.executable, "-c", program, *words]
    return subprocess.Popen(
        command, cwd=cwd, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env=os.environ | env,
    )  # fmt: skip


@pytest.fixture(scope="session")
def shim(tmp_path_factory):
    return build_shim(tmp_path_factory.mktemp("shim"))


@pytest.mark.all
@sends_signals
def test_a_run_that_slurm_ends_goes_on(place):
    """Two SIGTERM at once count as one, because `timeout` and other programs send it both to a
    process and to its group."""
    words = ["run", "case.nml", "-o", "part.nc", "--boulders", "3000000"]
    child = start(words, place, TOGETHER + RUN, **SAYS_PROGRESS)
    wait_until_running(child)
    child.send_signal(signal.SIGTERM)
    child.send_signal(signal.SIGTERM)
    out, err = child.communicate(timeout=600)
    assert (child.returncode, out) == (143, "")
    first = "rockfall: interrupted: part.nc contains the first"
    said = re.fullmatch(rf"(?:{PROGRESS})*{first} ([\d,]+) of .*\n", err)
    assert err.endswith(" and is a valid result: continue with --resume\n")
    number = int(said[1].replace(",", ""))
    assert rockfall.read_result(place / "part.nc").sizes["boulder"] == number
    words = [*words, "--quiet", "--checkpoint", "0"]
    assert main(words) == 2  # a checkpoint exists
    assert not list(place.glob(".*"))


@sends_signals
def test_a_second_ctrl_c_ends_a_chunk_that_lasts(place):
    """The second signal is repeated until the run ends: a busy machine starts a chunk late."""
    words = ["run", "case.nml", "-o", "part.nc", "--boulders", "1000000", "--threads", "1"]
    child = start(words, place, ONE_CHUNK + RUN)
    assert child.stdout.readline() == "begun\n"
    child.send_signal(signal.SIGINT)
    time.sleep(3 * interrupts.TOGETHER)
    assert child.poll() is None
    while child.poll() is None:
        child.send_signal(signal.SIGINT)
        time.sleep(0.5)
    assert child.communicate() == ("", "") and child.returncode == 130
    assert not (place / "part.nc").exists()


def terminated(monkeypatch, module, name, when=lambda *_: True):
    """Send SIGTERM once, after a function returns; the returned list is not empty once it was
    sent."""
    do, sent = getattr(module, name), []

    def done(*arguments):
        found = do(*arguments)
        if not sent and when(*arguments):
            sent.append(True)
            signal.raise_signal(signal.SIGTERM)
        return found

    monkeypatch.setattr(module, name, done)
    return sent


@pytest.fixture
def result(place):
    rockfall.write_result(rockfall.run(rockfall.read_case("case.nml")), "out.nc")
    return place


def test_an_export_that_is_terminated_leaves_nothing(result, monkeypatch, capsys):
    before = sorted(result.rglob("*"))
    sent = terminated(monkeypatch, export, "write_map")
    assert main(["export", "out.nc", "tables"]) == 143 and sent
    assert capsys.readouterr().err == "rockfall: interrupted: no incomplete file was written\n"
    assert sorted(result.rglob("*")) == before


def test_once_it_gives_files_their_names_it_gives_all(result, monkeypatch):
    named = terminated(monkeypatch, os, "replace", lambda _, to: to.parent.name == "tables")
    assert main(["export", "out.nc", "tables"]) == 0 and named
    assert main(["export", "out.nc", "again"]) == 0
    assert {*os.listdir("tables")} == {*os.listdir("again")} and not list(result.glob(".*"))


@pytest.mark.family(2)
@pytest.mark.parametrize("command", ["merge p1.nc p2.nc -o new.nc", "report out.nc -o new.html"])
def test_no_command_leaves_a_half_file(command, result, monkeypatch):
    """The signal arrives after the file is written, before it is renamed."""
    case = rockfall.read_case("case.nml")
    for k in (1, 2):
        rockfall.write_result(rockfall.run(case, shard=(k, 2)), f"p{k}.nc")
    before = sorted(result.rglob("*"))
    monkeypatch.setattr(os, "replace", lambda *_: signal.raise_signal(signal.SIGTERM))
    assert main(command.split()) == 143
    assert sorted(result.rglob("*")) == before


def test_sigterm_is_what_it_was_after_a_command(place):
    before = signal.getsignal(signal.SIGTERM)
    assert main(["check", "case.nml"]) == 0
    assert signal.getsignal(signal.SIGTERM) == before
    with interrupts.interrupts() as outer, interrupts.interrupts() as inner:
        signal.raise_signal(signal.SIGTERM)
        assert outer() and inner()
    assert signal.getsignal(signal.SIGTERM) == before
    with interrupts.interrupts() as again:
        assert not again()


# ---- rockfall-batch


@pytest.fixture
def prepared(batch, tmp_path):
    prepare(make_full_case(tmp_path, case={"boulders": 50_000}), tmp_path / "ready")
    return tmp_path


def start_batch(folder, environment, *words):
    command = [find_program(), "ready/case.nml", "-o", "a", "--quiet", "--threads", "1", *words]
    return subprocess.Popen(command, cwd=folder, env=environment, stderr=subprocess.PIPE, text=True)


def wait_for(process, path):
    while process.poll() is None and not path.exists():
        time.sleep(0.002)


@sends_signals
@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_saves_what_rockfall_batch_has_done(number, status, prepared):
    before = {path.name for path in prepared.iterdir()}
    process = start_batch(prepared, os.environ, "--checkpoint", "1e-9")
    wait_for(process, prepared / "a.checkpoint")
    process.send_signal(number)
    process.send_signal(number)
    _, err = process.communicate(timeout=600)
    assert process.returncode == status
    kept = boulders_in(prepared / "a.checkpoint")
    assert f"interrupted: a.checkpoint contains {kept} of 200000 boulders" in err
    assert {path.name for path in prepared.iterdir()} == before | {"a.checkpoint"}


@preloads
def test_rockfall_batch_keeps_nothing_where_none_is_asked(prepared, shim):
    before = sorted(prepared.iterdir())
    process = start_batch(prepared, shim | {"INTERRUPT_READY": "1"}, "--checkpoint", "0")
    _, err = process.communicate(timeout=600)
    assert process.returncode == 130 and err.endswith("interrupted: no boulders were saved\n")
    assert sorted(prepared.iterdir()) == before


@preloads
def test_a_second_signal_ends_rockfall_batch_though_the_disk_hangs(prepared, shim):
    """The first signal arrives during the second save, which hangs; the first save is kept."""
    process = start_batch(prepared, shim | {"STALL_AT": "13"}, "--checkpoint", "1e-9")
    wait_for(process, prepared / "a.checkpoint")
    process.send_signal(signal.SIGINT)
    time.sleep(3 * interrupts.TOGETHER)
    assert process.poll() is None
    while process.poll() is None:  # a busy machine may count two signals as one
        process.send_signal(signal.SIGINT)
        time.sleep(0.5)
    assert "interrupted" not in process.communicate()[1] and process.returncode == 130
    assert boulders_in(prepared / "a.checkpoint") > 0
