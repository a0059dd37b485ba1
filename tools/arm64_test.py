# SPDX-License-Identifier: BSD-3-Clause
"""Tests on an emulated arm64: Fortran tests, and cases that must give identical bits.

usage: arm64_test.py   needs gfortran-aarch64-linux-gnu and qemu-user

Libraries come from Debian's arm64 packages, unpacked into a folder of the build.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
BUILD = ROOT / "build-arm64"
SYSTEM = BUILD / "system"
LIBRARIES = SYSTEM / "usr/lib/aarch64-linux-gnu"
OTHERS = SYSTEM / "lib/aarch64-linux-gnu"
PACKAGES = "libc6", "libgfortran5", "libgomp1", "libnetcdff-dev", "liblapack-dev", "libblas-dev"
QEMU = "qemu-aarch64", "-L", str(SYSTEM)


def main() -> str | None:
    os.environ["OMP_WAIT_POLICY"] = "passive"  # a waiting thread in emulation would occupy a core
    if not SYSTEM.exists():
        unpack_system()
    if not (BUILD / "kernel/build.ninja").exists():
        configure()
    subprocess.run(["ninja", "-C", BUILD / "kernel", "--quiet"], check=True)
    # 100 minutes per test, since emulation on a busy machine is slow
    tests = ["meson", "test", "-C", BUILD / "kernel", "--print-errorlogs", "-t", "20"]
    if subprocess.run(tests).returncode:
        return "the Fortran tests fail"
    script = Path(__file__).with_name("system_cases.py")
    inputs, ready, here, there = (BUILD / "cases" / name for name in ("in", "ready", "x86", "arm"))
    shutil.rmtree(BUILD / "cases", ignore_errors=True)
    for words in (
        ("make", inputs),
        ("prepare", inputs, ready),
        ("batch", ready, here, shutil.which("rockfall-batch")),
        ("batch", ready, there, *QEMU, BUILD / "kernel/fortran/rockfall-batch"),
        ("compare", here, there),
    ):
        output = None if words[0] == "compare" else subprocess.DEVNULL
        if subprocess.run([sys.executable, script, *words], stdout=output).returncode:
            return f"{words[0]} of the cases fails"
    return None


def unpack_system() -> None:
    """Fetch Debian's arm64 packages with all their dependencies, and unpack them."""
    apt = BUILD / "apt"
    for part in ("lists/partial", "archives/partial"):
        (apt / part).mkdir(parents=True, exist_ok=True)
    (apt / "status").touch()
    options = [
        "-oAPT::Architecture=arm64", "-oAPT::Architectures=arm64", "-oAPT::Sandbox::User=",
        f"-oDir::State::Lists={apt}/lists", f"-oDir::State::status={apt}/status",
        f"-oDir::Cache={apt}", "-oAPT::Install-Recommends=false", "-oDebug::NoLocking=true",
    ]  # fmt: skip
    subprocess.run(["apt-get", "-qq", *options, "update"], check=True)
    install = ["install", "--download-only", "--yes", *PACKAGES]
    subprocess.run(["apt-get", "-qq", *options, *install], check=True)
    for package in sorted((apt / "archives").glob("*.deb")):
        subprocess.run(["dpkg-deb", "-x", package, SYSTEM], check=True)
    for name in ("libc.so", "libm.so", "libc.a", "libm.a"):  # the compiler has its own versions
        (LIBRARIES / name).unlink(missing_ok=True)
    for path in LIBRARIES.glob("pkgconfig/*.pc"):
        if not path.is_symlink():
            path.write_text(path.read_text().replace("/usr", f"{SYSTEM}/usr"))
            if "-netlib" in path.name:  # update-alternatives would choose this
                shutil.copy(path, path.with_name(path.name.replace("-netlib", "")))


def configure() -> None:
    """Set up the build with meson."""
    place = BUILD / "place.ini"
    link = [f"-L{LIBRARIES}", *(f"-Wl,-rpath-link,{one}" for one in (LIBRARIES, OTHERS))]
    place.write_text(
        f"[binaries]\nexe_wrapper = {list(QEMU)}\n"
        f"[properties]\npkg_config_libdir = '{LIBRARIES}/pkgconfig'\n"
        f"[built-in options]\nc_link_args = {link}\nfortran_link_args = {link}\n"
    )
    cross = "--cross-file", ROOT / "packaging/arm64-cross.ini", "--cross-file", place
    options = "-Dpython=false", "-Dnetcdf=enabled", "-Db_lto=false", "-Dwarning_level=0"
    subprocess.run(["meson", "setup", BUILD / "kernel", ROOT, *cross, *options], check=True)


if __name__ == "__main__":
    sys.exit(main())
