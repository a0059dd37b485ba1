# SPDX-License-Identifier: BSD-3-Clause
"""The program rockfall-batch, and a small case with everything that it can run."""

import os
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import psutil
import pytest

import rockfall
from made import make_raster
from rockfall.cli import main
from rockfall.result import variables
from rockfall.scene.prepare import prepare
from rockfall.simulation import simulate
from scenes import rough, sets, sets_text, usual

ROOT = Path(__file__).parents[1]
BOULDERS = 50  # boulders from each of four sources
MANY = 1500  # boulders from each source in a run that will be stopped
OWN = (
    "case",
    "case_file",
    "history",
    "threads",
    "date_created",
    "wall_seconds",
    "cpu_seconds",
    "model_warnings",
)  # attributes specific to a run, or to functions in Python

#: For tests that send a signal to a running program.
sends_signals = pytest.mark.skipif(
    sys.platform == "win32", reason="a process gets signals of its console alone there"
)
#: For tests that preload a library into a program (crash.c).
preloads = pytest.mark.skipif(sys.platform == "win32", reason="LD_PRELOAD is of POSIX")
#: For tests that run a shell.
runs_shell = pytest.mark.skipif(sys.platform == "win32", reason="needs a POSIX shell")
#: For tests that make symbolic links.
makes_links = pytest.mark.skipif(
    sys.platform == "win32", reason="symbolic links need a privilege there"
)


def find_program():
    """Path of rockfall-batch on the PATH, in this build or next to Python; None if there is
    none."""
    places = [ROOT / "build" / "fortran", Path(sys.executable).parent]
    beside = [place / "rockfall-batch" for place in places if (place / "rockfall-batch").is_file()]
    return shutil.which("rockfall-batch") or (str(beside[0]) if beside else None)


def run_program(*words, cwd, limit=None, env=None):
    """Run rockfall-batch in a folder; `limit` is the maximum size of its files [bytes]."""
    first = limited("RLIMIT_FSIZE", limit) if limit else None
    return subprocess.run(
        [find_program(), *map(str, words)], cwd=cwd, capture_output=True, text=True, timeout=600,
        preexec_fn=first, env={**os.environ, **(env or {})},
    )  # fmt: skip


def limited(name, size):
    """Function that a child process calls to limit a resource to `size` bytes. Larger files cannot
    be written, as on a full disk."""
    resource = pytest.importorskip("resource", reason="this system has no limits of a process")
    return lambda: resource.setrlimit(getattr(resource, name), (size, size))


def make_full_case(folder, **groups):
    """Write a case with zones, four sources and every output to `folder/case.nml`."""
    make_raster(folder / "dem.tif", rough(), crs="EPSG:32632")
    zones = np.where(np.arange(60) < 25, 4, -2) + np.zeros((80, 1), "i2")
    make_raster(folder / "zones.tif", zones.astype("i2"), crs="EPSG:32632")
    (folder / "zones.csv").write_text("zone,mean_radius\n4,0.25\n-2,0.5\n77,inf\n")
    (folder / "sets.nml").write_text(sets_text(*sets(2.0), usual))
    west, north = 600000.0, 5000000.0
    about = {
        "case": {"title": "Über 'alles'", "boulders": BOULDERS, "seed": 2**62 + 1, "threads": 1},
        "terrain": {"dem": "dem.tif"},
        "surface": {"zones": "zones.tif", "table": "zones.csv"},
        "impact": {"sets": "sets.nml"},
        "boulder": {"volume": "lognormal", "volume_mean": 0.8, "volume_std": 0.2},
        "release": {
            "x": [west + x for x in (120.0, 130.0, 140.0, 180.0)], "y": [north - 20.0] * 4,
            "drop_height": 5.0,
        },
        "output": {"maps": list(variables.MAP), "rebounds": True, "trajectories": 70,
                   "min_passages": 3},
    }  # fmt: skip
    about = {group: about.get(group, {}) | groups.get(group, {}) for group in {**about, **groups}}
    lines = [
        {"name": "Straße", "x": [west, west + 300.0], "y": [north - 130.0] * 2},
        {"name": "apart", "x": [west - 500.0, west - 300.0], "y": [north] * 2},
    ]
    case = rockfall.Case(folder=folder, name=str(folder / "case.nml"), line=lines, **about)
    (folder / "case.nml").write_text(case.text(), encoding="utf-8")
    return case


def make_prepared(folder, **groups):
    """Write the case of `make_full_case`, and prepare it in `folder/ready` for rockfall-batch."""
    case = make_full_case(folder, **groups)
    prepare(case, folder / "ready")
    return case


def same_results(one, other):
    """Check that variables and attributes are bit-identical, except attributes such as run
    times."""
    assert {*one.variables} == {*other.variables}
    for name, variable in other.variables.items():
        mine = one.variables[name]
        assert (mine.dtype, mine.dims) == (variable.dtype, variable.dims), name
        if mine.dtype.kind == "O":
            assert mine.values.tolist() == variable.values.tolist()
        else:
            assert mine.values.tobytes() == variable.values.tobytes(), name
        assert {*mine.attrs} == {*variable.attrs}, name
        for key, value in variable.attrs.items():
            assert np.array_equal(*map(np.atleast_1d, (mine.attrs[key], value))), (name, key)
    assert {*one.attrs, *OWN} == {*other.attrs, *OWN}
    for key in {*other.attrs} - {*OWN}:
        assert one.attrs[key] == other.attrs[key], key


def refused_in_one_line(done, words):
    """Check that rockfall-batch ended with status 2 and exactly this line."""
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == f"rockfall-batch: {words}\n"


def refuses(words, message, capture):
    """Check that `rockfall` ends with status 2 and one line that matches `message`, and writes
    nothing. Paths in the line are matched with `/` on every system."""
    assert Path.cwd() != ROOT
    before = everything(Path())
    capture.readouterr()
    assert main([*map(str, words)]) == 2
    out, err = capture.readouterr()
    err = err.replace(os.sep, "/")
    assert out == "" and re.fullmatch(f"rockfall: {message}\n", err), err
    assert everything(Path()) == before


def everything(folder):
    """Bytes of every file in a folder, by path; False for folders."""
    return {path: path.is_file() and path.read_bytes() for path in sorted(folder.rglob("*"))}


def wait_until_busy(pid, seconds=1.5):
    """Wait until a process has used some CPU time, so that it has read its case and is running."""
    process = psutil.Process(pid)
    for _ in range(6000):  # five minutes, because others use the machine
        spent = process.cpu_times()
        if spent.user + spent.system > seconds:
            return
        time.sleep(0.05)
    raise TimeoutError("the program does not run")


#: Makes `rockfall` report the number of completed boulders in lines on stderr.
SAYS_PROGRESS = {"ROCKFALL_PROGRESS": "lines"}
PROGRESS = r"rockfall: \d+ of \d+ \w+(?:, run \d+ of \d+ \([^)\n]*\))?\n"


def wait_until_running(child):
    """Wait until a child with `SAYS_PROGRESS` has completed its first boulders."""
    while (line := child.stderr.readline()).startswith("rockfall: 0 of "):
        pass
    assert re.fullmatch(PROGRESS, line), line


class Killed(BaseException):
    pass


def killed_after(monkeypatch, chunks):
    """Make a run raise `Killed` after some chunks."""
    calls = iter(range(chunks))
    fly = simulate._run_range

    def until(*arguments):
        if next(calls, None) is None:
            raise Killed
        return fly(*arguments)

    monkeypatch.setattr(simulate, "_run_range", until)
    monkeypatch.setattr(simulate, "MAX_SECONDS", 1e6)  # complete chunks, also on a slow machine
