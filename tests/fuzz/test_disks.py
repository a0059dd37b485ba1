# SPDX-License-Identifier: BSD-3-Clause
"""File systems with faults: no locks, no renaming, full disks. Faults of the last step are found
before the first boulder, and finished results are never lost."""

import errno
import os
import re
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

import rockfall
from programs import Killed, everything, find_program, killed_after, same_results
from rockfall.cli import main
from rockfall.simulation import simulate
from rockfall.simulation.parts.part_file import boulders_in

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="LD_PRELOAD is of POSIX")
PROGRAMS = ("rockfall", "rockfall-batch")
#: Runs several commands without figures, which take long, then prints their status to stderr.
SEVERAL = """import sys
from rockfall.cli import main
from rockfall.html_report import page
from rockfall.io.vectors.layers import layer_names, read_attributes
page.figures = lambda *_: []
print(*[main(words.split()) for words in sys.argv[1:]], file=sys.stderr)
print(*[len(read_attributes("tables/rockfall.gpkg", "stops", name)) > 0 for name in
        layer_names("tables/rockfall.gpkg")], file=sys.stderr)
"""
#: Errors of `flock`; ENOTSUPP of Linux, 524, has no name.
NO_LOCKS = (errno.ENOLCK, errno.EOPNOTSUPP, 524, errno.ENOSYS, errno.EINVAL, errno.EIO)
NO_RENAMES = (errno.EPERM, errno.EXDEV, errno.ENOSYS, errno.EOPNOTSUPP, errno.EACCES, errno.EIO)


@pytest.fixture(scope="session")
def disk(tmp_path_factory):
    """Environment that loads disk.c, whose faults are chosen by further variables."""
    compiler = shutil.which(os.environ.get("CC", "cc"))
    if not compiler:
        pytest.skip("needs a C compiler")
    library = tmp_path_factory.mktemp("disk") / "disk.so"
    source = Path(__file__).parents[1] / "disk.c"
    subprocess.run([compiler, "-shared", "-fPIC", "-o", library, source, "-ldl"], check=True)
    return {**os.environ, "LD_PRELOAD": str(library), "OMP_NUM_THREADS": "1"}


def run(program, output, folder, environment, *words, **faults):
    command = {"rockfall": [sys.executable, "-m", "rockfall", "run", "case.nml"],
               "rockfall-batch": [find_program(), "ready/case.nml"]}[program]  # fmt: skip
    how = environment | {name: str(value) for name, value in faults.items()}
    how |= {"MOUNT": str(folder.resolve())}
    ended = subprocess.run(
        [*command, "--quiet", "-o", output, *words], cwd=folder, env=how, capture_output=True,
        text=True,
    )  # fmt: skip
    return ended.returncode, ended.stderr


def result_of(path):
    return rockfall.read_result(path) if path.suffix == ".nc" else rockfall.merge([path])


OUTPUTS = {"rockfall": "a.nc", "rockfall-batch": "a"}


@pytest.mark.all
@pytest.mark.parametrize("program", PROGRAMS)
@pytest.mark.parametrize("fault", NO_LOCKS)
def test_runs_go_on_without_locks(program, fault, ready, disk):
    """Runs write checkpoints, whose files HDF5 would also lock."""
    output = OUTPUTS[program]
    status, said = run(program, output, ready, disk, "--checkpoint", "1e-9", NO_LOCK=fault)
    assert status == 0, said
    assert said.count("cannot be locked") == 1 and "further checkpoints are written" not in said
    same_results(result_of(ready / output), rockfall.run(rockfall.read_case(ready / "case.nml")))
    assert not list(ready.glob("a.*.*")) and not list(ready.glob(".*"))


@pytest.mark.all
def test_sound_files_are_not_called_damaged_without_locks(ready, disk):
    for k in (1, 2):
        assert run("rockfall-batch", f"p{k}", ready, os.environ, "--shard", f"{k}/2")[0] == 0
    words = ["merge p1 p2 -o out.nc", "export out.nc tables",
             "report out.nc -o out.html", "check case.nml", "prepare case.nml again"]  # fmt: skip
    ended = subprocess.run(
        [sys.executable, "-c", SEVERAL, *words], cwd=ready,
        env=disk | {"NO_LOCK": "524", "MOUNT": str(ready.resolve())},
        capture_output=True, text=True,
    )  # fmt: skip
    *_, statuses, layers = ended.stderr.splitlines()
    assert statuses == "0 0 0 0 0" and {*layers.split()} == {"True"}, ended.stderr
    assert (ready / "again/scene.nc").read_bytes() and (ready / "tables").is_dir()
    same_results(result_of(ready / "out.nc"), rockfall.run(rockfall.read_case(ready / "case.nml")))


@pytest.mark.all
def test_who_asks_for_locks_is_told_how_to_do_without(ready, disk):
    assert run("rockfall-batch", "a", ready, os.environ)[0] == 0
    how = disk | {"NO_LOCK": "37", "MOUNT": str(ready.resolve()), "HDF5_USE_FILE_LOCKING": "TRUE"}
    for words in "merge a -o out.nc", "report a -o out.html":
        ended = subprocess.run(
            [sys.executable, "-m", "rockfall", *words.split()], cwd=ready, env=how,
            capture_output=True, text=True,
        )  # fmt: skip
        told = "a: HDF5 cannot lock files on this file system: set HDF5_USE_FILE_LOCKING=FALSE"
        assert (ended.returncode, ended.stderr) == (2, f"rockfall: {told}\n")


@pytest.mark.all
@pytest.mark.parametrize("program", PROGRAMS)
@pytest.mark.parametrize("fault", NO_RENAMES)
def test_a_folder_that_cannot_rename_is_refused_before_the_flight(program, fault, ready, disk):
    before = everything(ready)
    status, said = run(program, OUTPUTS[program], ready, disk, NO_RENAME=fault)
    assert status == 2 and re.search(r": (its )?folder .*cannot rename files", said)
    assert said.count("\n") == 1 and everything(ready) == before


@pytest.mark.parametrize("command", [
    "run case.nml -o new.nc", "run case.nml --until fraction@L<5% -o new.nc",
    "variants case.nml -o new", "hazard case.nml -o new", "ensemble case.nml -o new.nc",
    "models case.nml -o new", "convergence case.nml -o new", "back case.nml seen.csv -o new",
    "prepare case.nml new", "merge none -o new.nc", "report none.nc -o new.html",
    *(["lab impact lab.nml -o new.nc"] if find_spec("rockfall_lab") else []),
])  # fmt: skip
def test_commands_that_work_for_long_try_to_rename_first(command, place, monkeypatch, capsys):
    def refuses(source, target):
        raise PermissionError(1, "Operation not permitted", str(source), None, str(target))

    groups = {
        "hazard": "&scenario name = 'a', frequency = 1.0, volume_mean = 0.5 /\n",
        "variants": "&variant name = 'a' /\n&variant name = 'b', impact_stop_speed = 0.4 /\n",
    }
    more = groups.get(command.split()[0], "")
    Path("case.nml").write_text(Path("case.nml").read_text() + more)
    Path("seen.csv").write_text("x,y,energy\n600100,4999900,1\n")
    monkeypatch.setattr("rockfall.io.output_files.replace", refuses)
    before = everything(place)
    assert main(command.split()) == 2
    assert "cannot rename files: Operation not permitted" in capsys.readouterr().err
    assert everything(place) == before


@pytest.mark.all
@pytest.mark.parametrize("program", PROGRAMS)
@pytest.mark.parametrize("fault", [errno.EPERM, errno.EIO])
def test_a_finished_file_that_cannot_take_its_name_stays_and_is_named(program, fault, ready, disk):
    """The rename before the run is a trial; the second, of the result, fails. The new file stays
    under the name in the message."""
    how = {"NO_RENAME": fault, "LATE_RENAME": 1}
    status, said = run(program, OUTPUTS[program], ready, disk, "--checkpoint", "0", **how)
    assert status == 2
    assert (named := re.search(r"The new file is (\S+)\n$", said)), said
    kept = ready / named[1]
    assert kept.is_file() and not (ready / OUTPUTS[program]).exists()
    whole = rockfall.run(rockfall.read_case(ready / "case.nml"))
    same_results(result_of(kept), whole)


@pytest.mark.family(2)
@pytest.mark.parametrize("program", PROGRAMS)
@pytest.mark.parametrize(
    "reserves",
    [pytest.param(True, id="fallocate"), pytest.param(False, id="statvfs", marks=pytest.mark.all)],
)
def test_a_result_larger_than_the_disk_is_refused_before_the_flight(program, reserves, ready, disk):
    """The disk has 15 kB; the rows of 200 boulders take 20 kB."""
    before = everything(ready)
    how = {"DISK": 15_000} | ({} if reserves else {"NO_FALLOCATE": 1})
    status, said = run(program, OUTPUTS[program], ready, disk, **how)
    told = rf"{program}: {OUTPUTS[program]}: needs at least (0\.021|1) MB of disk"
    assert status == 2 and re.search(told, said.splitlines()[-1])
    assert everything(ready) == before


@pytest.mark.parametrize(
    "program", [pytest.param("rockfall", marks=pytest.mark.all), "rockfall-batch"]
)
def test_a_disk_that_fills_up_leaves_a_checkpoint_that_is_named(program, ready, disk, monkeypatch):
    monkeypatch.chdir(ready)
    output = OUTPUTS[program]
    with monkeypatch.context() as patch, pytest.raises(Killed):
        patch.setattr(simulate, "FIRST_CHUNK", 40)
        killed_after(patch, 1)
        main(["run", "case.nml", "--quiet", "--checkpoint", "1e-9", "-o", "a.nc"])
    state = Path(f"{output}.checkpoint")
    Path("a.nc.checkpoint").rename(state)
    kept = state.read_bytes()
    words = ("--resume", "--checkpoint", "0")
    status, said = run(program, output, ready, disk, *words, DISK=200_000)
    assert status == 2
    last = said.splitlines()[-1]
    assert last.startswith(f"{program}: {output}: cannot be written: ")
    assert last.endswith(
        f". {state} contains {boulders_in(state)} boulders: continue with --resume"
    )
    assert state.read_bytes() == kept and not Path(output).exists()
    assert run(program, output, ready, disk, *words)[0] == 0
    same_results(result_of(Path(output)), rockfall.run(rockfall.read_case("case.nml")))
