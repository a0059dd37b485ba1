# SPDX-License-Identifier: BSD-3-Clause
"""rockfall-lab: the same case gives the same bits as Python, and bad input one line."""

import os
import re
import resource
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from rockfall.lab.case import LabCase, names, read_lab_case
from rockfall.lab.experiment import run_impacts

ROOT = Path(__file__).parents[1]
CASE = """&lab title = 'tiny', seed = 77, ratios = 1, 3, 5, points = 4, impacts = 6 /
&packing mean_radius = .1, width = 20, depth = 4 /
"""
COLUMNS = ["ratio", "point", "impact", *names(5), *names(6)]


def find_program():
    """The program of this build, or of this installation."""
    places = [ROOT / "build" / "fortran" / "lab", Path(sys.executable).parent]
    beside = [place / "rockfall-lab" for place in places if (place / "rockfall-lab").is_file()]
    return shutil.which("rockfall-lab") or (str(beside[0]) if beside else None)


@pytest.fixture(scope="session")
def program():
    """Run the program in a folder; `limit` is the longest file it may write [bytes]."""
    path = find_program()
    assert path, "rockfall-lab is not built"

    def run(*arguments, cwd, limit=None):
        def lower_limit():
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

        return subprocess.run(
            [path, *map(str, arguments)], cwd=cwd, capture_output=True, text=True, timeout=120,
            preexec_fn=lower_limit if limit else None,
        )  # fmt: skip

    return run


@pytest.fixture
def made(tmp_path):
    """A folder with a case in a folder of its own, and files that are not to be lost."""
    (tmp_path / "case").mkdir()
    (tmp_path / "case" / "tiny.nml").write_text(CASE)
    (tmp_path / "notes.csv").write_text("mine\n")
    (tmp_path / "empty").touch()
    return tmp_path


def read_table(path):
    """Columns of a table, its reals as they were written."""
    header, *rows = path.read_text().splitlines()
    assert header.split(",") == COLUMNS
    return dict(zip(COLUMNS, zip(*(row.split(",") for row in rows), strict=True), strict=True))


def check_table(path, data):
    """Every number in the table is that of the impacts, bit for bit."""
    table = read_table(path)
    sizes = data["status"].shape
    ratio, point, impact = np.meshgrid(data["ratio"], *map(np.arange, sizes[1:]), indexing="ij")
    assert np.array_equal(np.array(table["ratio"], float), ratio.ravel())
    assert list(map(int, table["point"])) == (point.ravel() + 1).tolist()
    assert list(map(int, table["impact"])) == (impact.ravel() + 1).tolist()
    for name in names(5):
        assert np.array(table[name], float).tobytes() == data[name].values.tobytes(), name
    for name in names(6):
        assert list(map(int, table[name])) == data[name].values.ravel().tolist(), name


def test_same_bits_as_python_and_with_any_number_of_threads(made, program):
    case = made / "case" / "tiny.nml"
    done = program(case, cwd=made)
    assert done.returncode == 0 and done.stderr == ""
    assert done.stdout.startswith("tiny\n") and done.stdout.endswith("impacts in tiny.csv\n")
    data = run_impacts(read_lab_case(case))
    check_table(made / "tiny.csv", data)
    for k, ratio in enumerate((1, 3, 5)):
        status = data["status"].values[k]
        ends = [(status == end).sum() for end in range(1, 6)]
        assert f"{ratio} 24 " + " ".join(map(str, ends)) in " ".join(done.stdout.split())
    first = (made / "tiny.csv").read_bytes()
    for threads in (1, 2):  # a table takes the place of a table
        done = program(case, f"threads={threads}", "quiet=true", cwd=made)
        assert done.returncode == 0 and done.stdout == done.stderr == ""
        assert (made / "tiny.csv").read_bytes() == first
    assert sorted(os.listdir(made)) == ["case", "empty", "notes.csv", "tiny.csv"]


def test_values_of_the_command_line(made, program):
    case = made / "case" / "tiny.nml"
    words = "points=2", "impacts=3", "seed=9223372036854775807", "quiet=T", "output=other"
    assert program(case, *words, cwd=made).returncode == 0
    changed = {"points": 2, "impacts": 3, "seed": 2**63 - 1}
    check_table(made / "other", run_impacts(read_lab_case(case).replace(lab=changed)))


def test_every_key_is_read_as_python_reads_it(made, program):
    case = LabCase(
        lab={"title": "it's \"all\"", "seed": 3, "ratios": [0.7, 2.5], "points": 2, "impacts": 2},
        material={
            "young": 5e8, "poisson": 0.3, "friction": 0.4, "damping": 0.1, "rolling": 0.2
        },
        packing={
            "mean_radius": 0.2, "size_ratio": 3.0, "by_mass": True, "width": 14.0, "depth": 3.0,
            "periodic": False, "density": 2500.0, "friction": 0.1, "gravity": 9.0,
        },
        impact={
            "density": 2700.0, "speed": [4.0, 12.0], "angle": [30.0, 80.0], "spin": [-0.2, 0.3],
            "patience": 35.0, "spent": 1e-3, "past": 0.4, "wait": 1.5, "step_share": 0.9,
            "retries": 2,
        },
        correction={f"a{k}": 0.5 * k for k in range(1, 10)},
    )  # fmt: skip
    (made / "all.nml").write_text(case.text())
    done = program("all.nml", cwd=made)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith('it\'s "all"\n')
    check_table(made / "all.csv", run_impacts(case))


def test_defaults_are_those_of_python(made, program):
    (made / "few.nml").write_text("&lab points = 1, impacts = 1 /")
    assert program("few.nml", cwd=made).returncode == 0
    check_table(made / "few.csv", run_impacts(LabCase(lab={"points": 1, "impacts": 1})))
    narrow = "&packing size_ratio = 1, width = 5, depth = 1 / &lab ratios = 5, "  # misfit: quick
    usual = LabCase().lab
    for given, default in ("points", "impacts"), ("impacts", "points"):
        (made / "many.nml").write_text(f"{narrow} {given} = 1 /")
        assert program("many.nml", cwd=made).returncode == 0
        assert len(read_table(made / "many.csv")["status"]) == usual[default]


@pytest.mark.parametrize("group", ["lab", "material", "packing", "impact", "correction"])
def test_the_keys_are_those_of_python(group, made, program):
    (made / "case" / "tiny.nml").write_text(f"&{group} strange = 1 /")
    done = program("case/tiny.nml", cwd=made)
    found = re.fullmatch(
        f"rockfall-lab: case/tiny.nml: line 1: &{group} strange: unknown key; known: (.*)\n",
        done.stderr,
    )
    assert sorted(found[1].split(", ")) == sorted(getattr(LabCase(), group))


HOSTILE = {
    "empty quote": ("&lab title = 'x /", "without its closing quote"),
    "open group": ("&lab points = 3", "line 1: &lab is not closed by /"),
    "no group": ("points = 3", "line 1: text outside of a group"),
    "bytes": (b"\x89PNG\r\n\x1a\n\xff\xfe", "is not text (UTF-8 is due)"),
    "group": ("&pakcing /", "line 1: &pakcing: unknown group; known: &lab, &material, &packing"),
    "group twice": ("&lab /\n&lab /", "line 1: &lab: stands more than once"),
    "key": ("&packing dept = 3 /", "line 1: &packing dept: unknown key; known: mean_radius"),
    "key set elsewhere": ("&impact radius = 1 /", "&impact radius: unknown key"),
    "key twice": ("&lab seed = 1, seed = 2 /", "&lab seed"),
    "text for a number": ("&packing depth = 'deep' /", "&packing depth = 'deep': must be a real"),
    "NaN": ("&packing depth = NaN /", "&packing depth = NaN: must be a finite real number"),
    "Inf": ("&impact speed = 5, Inf /", "&impact speed (value 2) = Inf: must be a finite real"),
    "number for a text": ("&lab title = 3 /", "&lab title = 3: must be text in quotes"),
    "number for a logical": ("&packing periodic = 1 /", "&packing periodic = 1: must be .true."),
    "real for an integer": ("&lab points = 2.5 /", "&lab points = 2.5: must be an integer"),
    "two for one": ("&material young = 1e9, 2e9 /", "must be one value, not 2"),
    "no points": ("&lab points = 0 /", "&lab points = 0: must be 1 to 1000000"),
    "no impacts": ("&lab impacts = -1 /", "&lab impacts = -1: must be 1 to 1000000"),
    "seed": ("&lab seed = -1 /", "&lab seed = -1: must be 0 to 9223372036854775807"),
    "seed of 65 bits": (f"&lab seed = {2**63} /", f"seed = {2**63}: must be an integer of 64 bits"),
    "ratio twice": ("&lab ratios = 1, 2, 1 /", "&lab ratios (value 3) = 1: must be > 0, each once"),
    "ratio of zero": ("&lab ratios = 0 /", "&lab ratios = 0: must be > 0, each once"),
    "ratios": ("&lab ratios = 1001*2.0 /", "must be at most 1000 values"),
    "angle reversed": ("&impact angle = 90, 10 /", "angle = 90, 10: must be least and greatest"),
    "one angle": ("&impact angle = 45 /", "angle = 45: must be two values, least and greatest"),
    "angle from below": ("&impact angle = -5, 90 /", "impact: angle must be 1 to 90 degrees"),
    "retries": ("&impact retries = -1 /", "past, wait and retries must be >= 0"),
    "too many retries": ("&impact retries = 3000000000 /", "must be at most 2147483647"),
    "young": ("&material young = -1.0 /", "material: young must be > 0 [Pa]"),
    "too narrow": ("&packing width = 2.0 /", "packing: width must exceed"),
    "factor": ("&correction a3 = 101 /", "&correction a3 = 101: must be -100 to 100"),
    "memory": ("&lab points = 1000000, impacts = 1000000 /", "5000000000000 impacts do not fit"),
}


@pytest.mark.parametrize("what", HOSTILE)
def test_a_bad_case_is_one_line_and_nothing_is_written(what, made, program):
    text, words = HOSTILE[what]
    (made / "case" / "tiny.nml").write_bytes(text if isinstance(text, bytes) else text.encode())
    check_refusal(program, made, "case/tiny.nml", words=words)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "a case file is needed: rockfall-lab CASE [key=value ...]; see --help"),
        (["none.nml"], "none.nml: no such file"),
        (["case/tiny.nml", "case/tiny.nml"], "there is a case file already"),
        (["case/tiny.nml", "boulders=3"], "unknown key; known: output, points, impacts, seed, thr"),
        (["case/tiny.nml", "--fast"], "--fast: unknown option; known: --help, --version"),
        (["case/tiny.nml", "points=many"], "points = many: must be an integer"),
        (["case/tiny.nml", "points=0"], "case/tiny.nml: &lab points = 0: must be 1 to 1000000"),
        (["case/tiny.nml", "seed=1 / &lab"], "must be an integer"),
        (["case/tiny.nml", "seed=-1"], "&lab seed = -1: must be 0 to"),
        (["case/tiny.nml", "threads=-1"], "threads = -1: must be 0 (all cores) to 1024"),
        (["case/tiny.nml", "threads=1025"], "threads = 1025: must be 0 (all cores) to 1024"),
        (["case/tiny.nml", "threads="], "a value is missing"),
        (["case/tiny.nml", "quiet=maybe"], "quiet = maybe: must be true or false"),
        (["case/tiny.nml", "output=none/x.csv"], "none/x.csv: cannot be written"),
        (["case/tiny.nml", "output=case"], "case: is a folder; a file name is needed"),
        (["case/tiny.nml", "output=./case/tiny.nml"], "is there, and no table of impacts"),
        (["case/tiny.nml", "output=notes.csv"], "is there, and no table of impacts"),
        (["case/tiny.nml", "output=empty"], "is there, and no table of impacts"),
        (["case/tiny.nml", "output=/dev/null"], "/dev/null: is there, and no table of impacts"),
        (["case/tiny.nml", "output=/proc/x.csv"], "/proc/x.csv: cannot be written"),
    ],
)
def test_bad_arguments_are_one_line_and_nothing_is_written(arguments, words, made, program):
    check_refusal(program, made, *arguments, words=words)


def test_a_full_disk_is_one_line(made, program):
    check_refusal(program, made, "case/tiny.nml", words="tiny.csv: cannot be written", limit=5000)


def check_refusal(program, folder, *arguments, words, limit=None):
    before = {path: path.is_file() and path.read_bytes() for path in folder.rglob("*")}
    done = program(*arguments, cwd=folder, limit=limit)
    assert done.returncode == 2 and done.stdout == ""
    assert done.stderr.startswith("rockfall-lab: ") and words in done.stderr
    assert done.stderr.count("\n") == 1 and done.stderr.endswith("\n")
    assert {path: path.is_file() and path.read_bytes() for path in folder.rglob("*")} == before


def test_help_and_version(program, tmp_path):
    done = program("--help", cwd=tmp_path)
    assert done.returncode == 0 and "rockfall-lab CASE [key=value ...]" in done.stdout
    done = program("--version", cwd=tmp_path)
    assert done.returncode == 0 and done.stdout.startswith("rockfall-lab ")
