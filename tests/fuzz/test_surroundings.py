# SPDX-License-Identifier: BSD-3-Clause
"""Environment of a run: streams, names, locale, threads, stacks, memory, forks. Faults give one
line before the first boulder."""

import os
import re
import subprocess
import sys

import pytest

import rockfall
from programs import find_program, make_prepared
from rockfall import cli

ASCII = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
MANY = "OMP_NUM_THREADS = 100000: must be at most 1024"
STACK = "the stack of each thread has [0-9]+ kB: must be at least 500 kB (ulimit -s, OMP_STACKSIZE)"
MEMORY = "threads = 1000: their stacks of 81[0-9]{2} kB do not fit in memory (ulimit -v): "
MEMORY += "use fewer threads or a smaller OMP_STACKSIZE"


@pytest.fixture
def programs(few_boulders, tmp_path, monkeypatch):
    """Command line of each program, for a valid case in the current folder."""
    monkeypatch.chdir(tmp_path)
    rockfall.cli.main(["prepare", "case.nml", "ready"])
    return {
        "rockfall": [sys.executable, "-m", "rockfall", "run", "case.nml", "-o", "out.nc"],
        "rockfall-batch": [find_program(), "ready/case.nml", "-o", "out"],
    }


def ran(command, prefix="", env=None, **options):
    """Run a command in a shell, after the shell command `prefix`."""
    if sys.platform == "win32":
        pytest.skip("needs a POSIX shell")
    line = ["sh", "-c", f'{prefix} exec "$@"', "sh", *command]
    env = {**os.environ, **(env or {})}
    return subprocess.run(line, capture_output=True, timeout=600, env=env, **options)


@pytest.mark.all
@pytest.mark.parametrize("program", ["rockfall", "rockfall-batch"])
@pytest.mark.parametrize(
    ("prefix", "env", "message"),
    [
        ("", {"OMP_NUM_THREADS": "100000"}, MANY),
        ("ulimit -s 128;", {}, STACK),
        ("", {"OMP_STACKSIZE": "64k", "OMP_NUM_THREADS": "2"}, STACK),
        ("ulimit -v 4000000;", {"OMP_STACKSIZE": "8M", "OMP_NUM_THREADS": "1000"}, MEMORY),
    ],
)
def test_no_room_for_threads_is_one_line_and_nothing_is_written(
    programs, program, prefix, env, message
):
    before = sorted(os.listdir())
    done = ran(programs[program], prefix, env)
    said = done.stderr.decode()
    message = message.replace("(", r"\(").replace(")", r"\)")
    assert done.returncode == 2 and done.stdout == b""
    assert re.fullmatch(f"{program}: {message}\n", said), said
    assert sorted(os.listdir()) == before


NO_MEMORY = (
    r"(.*: )?(not enough memory for this case.*|threads = 16: their stacks .* do not fit in "
)
NO_MEMORY += r"memory.*|cannot be written: .*|.* do not fit in memory.*)"
LIMITS = [
    *(("rockfall-batch", "v", size) for size in (90, 150, 200, 215, 240, 270, 330, 500, 800, 1000)),
    *(("rockfall", "v", size) for size in (400, 500, 800, 1300)),
    ("rockfall-batch", "d", 100), ("rockfall-batch", "d", 200), ("rockfall", "d", 300),
]  # fmt: skip


@pytest.mark.all
@pytest.mark.skipif(sys.platform != "linux", reason="the limits are those of Linux")
@pytest.mark.parametrize(("program", "kind", "size"), LIMITS)
def test_sixteen_threads_in_little_memory_run_or_say_so(programs, program, kind, size):
    """The C library reserves 64 MB of address space per thread, and batch systems limit it."""
    command = [*programs[program], "--quiet", "--threads", "16"]
    done = ran(command, f"ulimit -{kind} {size * 1000};", {"OPENBLAS_NUM_THREADS": "1"})
    said, output = done.stderr.decode(), programs[program][-1]
    assert done.returncode in (0, 2), said
    assert os.path.exists(output) == (done.returncode == 0)
    if done.returncode:
        assert re.fullmatch(f"rockfall(-batch)?: {NO_MEMORY}\n", said), said
    else:
        assert said == ""


def test_a_generous_limit_is_enough(programs):
    """16 threads have stacks of 128 MB in total, and the C library reserves no more for them."""
    done = ran([*programs["rockfall-batch"], "--threads", "16"], "ulimit -v 400000;")
    assert done.returncode == 0, done.stderr.decode()


SMALLEST = "ulimit -s 500;", {"OMP_STACKSIZE": "500k", "OMP_NUM_THREADS": "2"}


@pytest.mark.parametrize(
    "program", [pytest.param("rockfall", marks=pytest.mark.all), "rockfall-batch"]
)
def test_the_smallest_stack_is_enough(programs, program):
    done = ran(programs[program], *SMALLEST)
    assert done.returncode == 0, done.stderr.decode()


@pytest.mark.parametrize("changes", [
    {},
    {"output": {"maps": None, "min_passages": None, "rebounds": False, "trajectories": 0}},
    {"surface": {"ground": "talus"}, "impact": {"form": "table"}},
], ids=["everything", "little", "table"])  # fmt: skip
def test_the_smallest_stack_is_enough_for_every_kind_of_scene(batch, tmp_path, changes):
    """Scenes with every output, with few outputs, and with an impact table run on the smallest
    stack."""
    make_prepared(tmp_path, **changes)
    done = ran([find_program(), str(tmp_path / "ready/case.nml"), "-o", "out"], *SMALLEST,
               cwd=tmp_path)  # fmt: skip
    assert done.returncode == 0, done.stderr.decode()


@pytest.mark.all
@pytest.mark.parametrize("program", ["rockfall", "rockfall-batch"])
@pytest.mark.parametrize("closed", [">&-", "2>&-", "<&- >&- 2>&-"])
def test_a_run_without_streams_is_a_run(programs, program, closed):
    done = ran(programs[program], f"exec {closed};")
    assert done.returncode == 0 and done.stderr == b""
    if program == "rockfall":
        assert rockfall.read_result("out.nc").equals(rockfall.run(rockfall.read_case("case.nml")))
    else:
        assert rockfall.merge(["out"]).equals(rockfall.run(rockfall.read_case("case.nml")))
    if closed == "2>&-":
        assert b"50 boulders" in done.stdout
        assert ran([programs[program][0], "no.nml"], "exec 2>&-;").returncode != 0


@pytest.mark.skipif(sys.platform == "win32", reason="names are texts there")
def test_names_that_are_no_text_are_one_line(programs):
    bad = os.fsdecode(b"d\xff")
    os.rename("ready", bad)
    for command in (
        ["check", f"{bad}/case.nml"],
        ["run", "case.nml", "-o", f"{bad}.nc"],
        ["report", f"{bad}.nc"],
        ["compare", "out.nc", "seen.csv", f"{bad}.csv"],
    ):
        done = ran([sys.executable, "-m", "rockfall", *command])
        name = next(word for word in command if bad in word).encode(errors="backslashreplace")
        assert (done.returncode, done.stdout) == (2, b"")
        assert done.stderr == b"rockfall: " + name + b": is not a UTF-8 file name\n"
    done = ran([sys.executable, "-m", "rockfall", "run", "case.nml"], cwd=bad)
    assert done.returncode == 2 and done.stderr.endswith(b"d\\udcff: is not a UTF-8 file name\n")
    command = [find_program(), f"{bad}/case.nml", "-o", "out", "--quiet"]
    done = ran(command)  # names are bytes there
    assert (done.returncode, done.stderr) == (0, b"")


def test_a_locale_without_names_in_utf_8_is_one_line(programs):
    done = ran(programs["rockfall"], env=ASCII)
    told = b"rockfall: file names are in ascii here: set LC_ALL=C.UTF-8\n"
    assert (done.returncode, done.stdout, done.stderr) == (2, b"", told)
    assert not os.path.exists("out.nc")
    assert ran([sys.executable, "-m", "rockfall", "--version"], env=ASCII).returncode == 0


@pytest.mark.parametrize(
    "error",
    [
        MemoryError(),
        OSError(12, "Cannot allocate memory", "/lib/xarray"),
        ImportError("libcrypto.so.3: failed to map segment from shared object"),
    ],
)
def test_memory_that_ends_anywhere_is_one_line(error, monkeypatch, capsys, few_boulders):
    def fail(arguments):
        raise error

    monkeypatch.setattr("rockfall.cli.commands.run.preview", fail)
    assert cli.main(["check", str(few_boulders)]) == 2
    assert capsys.readouterr().err.startswith("rockfall: not enough memory for this case: ")


FORK = """
import multiprocessing, sys, rockfall
case = rockfall.read_case(sys.argv[1])

def fly(queue=None):
    return queue.put(rockfall.run(case, threads=2)) if queue else rockfall.run(case, threads=2)

before = fly()
context = multiprocessing.get_context("fork")
queue = context.Queue()
child = context.Process(target=fly, args=(queue,))
child.start()
try:
    assert queue.get(timeout=600).equals(before)
finally:
    child.kill()
assert fly().equals(before)
print("the same")
"""


def test_a_child_of_a_fork_runs_as_its_parent(few_boulders):
    """A forked child runs like its parent, although it does not have the threads of libgomp that
    wait for the next run."""
    done = ran([sys.executable, "-c", FORK, few_boulders])
    assert (done.returncode, done.stdout) == (0, b"the same\n"), done.stderr.decode()
