# SPDX-License-Identifier: BSD-3-Clause
"""Make dist/: the source distribution and, from it, wheels that need no compiler.

usage: wheel.py [--once] [PYTHON...]   one wheel per interpreter; default: this Python

Each wheel is built twice. The second build, in another folder and time zone, must give identical
bytes.
"""

import hashlib
import os
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
import zipfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
DIST = ROOT / "dist"
TOOLS = ROOT / "requirements/wheel.txt"
#: netCDF for rockfall-batch, limited to reading and writing local files.
NETCDF = ROOT / "build-wheel/netcdf"
#: Libraries that auditwheel may copy into the wheel.
BUNDLED = {"libgfortran", "libgomp", "libquadmath"}


def main(words: list[str]) -> str | None:
    once = "--once" in words
    pythons = [word for word in words if word != "--once"] or [sys.executable]
    if changed := output("git", "status", "--porcelain", "--untracked-files=no"):
        print(f"wheel: made of the last commit, without changes in\n{changed}", file=sys.stderr)
    subprocess.run(["./run", "page"], cwd=ROOT, check=True)
    if not (NETCDF / "netcdf-fortran.pc").exists():
        subprocess.run([sys.executable, ROOT / "tools/static_netcdf.py", NETCDF], check=True)
    os.environ["SOURCE_DATE_EPOCH"] = output("git", "log", "-1", "--format=%ct")
    os.umask(0o022)  # a wheel stores the modes of its files
    DIST.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="rockfall-") as folder:
        for number, python in enumerate(pythons):
            tools = make_tools(Path(folder) / f"tools{number}", python)
            if number == 0:
                source = make_source(tools)
                print(f"{digest(source)}  {source.relative_to(ROOT)}")
            wheel = make_wheel(tools, source, Path(folder) / f"a{number}", zone="UTC")
            if wrong := check(wheel, folder):
                return f"{wheel.name}: {wrong}"
            if not once:
                other = Path(folder) / f"another-folder-{number}" / "below"
                again = make_wheel(tools, source, other, zone="Asia/Kolkata")
                if wheel.read_bytes() != again.read_bytes():
                    shutil.copy(again, DIST / f"{again.name}.again")
                    return f"{wheel.name}: a second build differs; it is kept as dist/*.again"
            shutil.copy(wheel, DIST)
            print(f"{digest(wheel)}  dist/{wheel.name}", "" if once else "(twice)", flush=True)
    return None


def output(*command: str) -> str:
    return subprocess.check_output(command, cwd=ROOT, text=True).strip()


def digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def make_tools(folder: Path, python: str) -> Path:
    """Folder with the programs of a new environment that has the tools to build a wheel."""
    subprocess.run([python, "-m", "venv", folder], check=True)
    install = ["-m", "pip", "install", "--quiet", "--only-binary", ":all:", "--require-hashes"]
    subprocess.run([folder / "bin/python", *install, "--requirement", TOOLS], check=True)
    return folder / "bin"


def make_source(tools: Path) -> Path:
    """Make the source distribution of the last commit, in dist."""
    code = "import mesonpy, sys; print(mesonpy.build_sdist(sys.argv[1]))"
    done = subprocess.run(
        [tools / "python", "-c", code, DIST],
        cwd=ROOT, env=surroundings(tools), stdout=subprocess.PIPE, text=True, check=True,
    )  # fmt: skip
    return DIST / done.stdout.splitlines()[-1]


def make_wheel(tools: Path, source: Path, folder: Path, zone: str) -> Path:
    """Make a wheel from the source distribution in a separate folder, and repair it; return the
    path of the repaired wheel."""
    folder.mkdir(parents=True)
    with tarfile.open(source) as archive:
        archive.extractall(folder, filter="data")
    tree = folder / source.name.removesuffix(".tar.gz")
    env = surroundings(tools) | {"TZ": zone}
    licences = [tools / "python", tree / "tools/bundled_licences.py", NETCDF]
    subprocess.run(licences, cwd=tree, check=True)
    setup = "--config-settings=setup-args=-Dnetcdf=enabled"
    build = [tools / "python", "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation"]
    subprocess.run(
        [*build, "--config-settings=build-dir=build", setup, "--wheel-dir", folder / "plain", tree],
        cwd=tree, env=env, check=True,
    )  # fmt: skip
    (plain,) = (folder / "plain").iterdir()
    subprocess.run(
        [tools / "auditwheel", "repair", "--plat", "auto", "-w", folder / "repaired", plain],
        cwd=tree, env=env, check=True, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    (wheel,) = (folder / "repaired").iterdir()
    return wheel


def surroundings(tools: Path) -> dict[str, str]:
    """Environment of a build, without the user's flags, which would change results."""
    flags = "CFLAGS", "CPPFLAGS", "FFLAGS", "FCFLAGS", "LDFLAGS", "PYTHONPATH"
    kept = {name: value for name, value in os.environ.items() if name not in flags}
    path = f"{tools}:{os.environ['PATH']}"
    return kept | {"PATH": path, "LC_ALL": "C.UTF-8", "PKG_CONFIG_PATH": str(NETCDF)}


def check(wheel: Path, folder: str) -> str | None:
    """First fault of a wheel, or None: wrong libraries, paths of this machine, exported LAPACK
    symbols."""
    inside = Path(tempfile.mkdtemp(dir=folder))
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(inside)
    libraries = {path.name.split("-")[0] for path in inside.glob("*.libs/*")}
    if libraries != BUNDLED:
        return f"holds {sorted(libraries)}, not {sorted(BUNDLED)}"
    for path in sorted(path for path in inside.rglob("*") if path.is_file()):
        content = path.read_bytes()
        if any(place.encode() in content for place in (folder, str(ROOT))):
            return f"{path.relative_to(inside)} names a folder of the build"
    for extension in inside.glob("rockfall/*.so"):
        shown = output("nm", "-D", "--defined-only", str(extension))
        if re.search(r" (dsyev|dgemm)_?$", shown, re.MULTILINE):
            return f"{extension.name} shows its LAPACK to other libraries"
    return None


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
