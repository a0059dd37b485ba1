# SPDX-License-Identifier: BSD-3-Clause
"""Compile static libraries of HDF5, netCDF and netCDF-Fortran from Debian's source packages.

usage: static_netcdf.py FOLDER [--windows]   FOLDER/netcdf-fortran.pc; needs CMake, a static zlib,
                                             and for Windows Wine

The libraries have no remote access, which the program does not use: no DAP or HTTP, hence no curl
and no XML. They omit folder, host and time of the build, so they are identical everywhere.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tarfile
from pathlib import Path
from typing import NamedTuple

from debian_sources import fetch

WINE = "/usr/lib/wine/wine64"
PREFIX = "/usr/x86_64-w64-mingw32"
TOOLCHAIN = f"""
set(CMAKE_SYSTEM_NAME Windows)
set(CMAKE_SYSTEM_PROCESSOR x86_64)
set(CMAKE_C_COMPILER x86_64-w64-mingw32-gcc)
set(CMAKE_RC_COMPILER x86_64-w64-mingw32-windres)
set(CMAKE_FIND_ROOT_PATH {PREFIX})
set(CMAKE_FIND_ROOT_PATH_MODE_PROGRAM NEVER)
set(CMAKE_FIND_ROOT_PATH_MODE_LIBRARY ONLY)
set(CMAKE_FIND_ROOT_PATH_MODE_INCLUDE ONLY)
set(CMAKE_CROSSCOMPILING_EMULATOR {WINE})
"""
COMMON = (
    "-DCMAKE_BUILD_TYPE=Release", "-DBUILD_SHARED_LIBS=OFF", "-DBUILD_TESTING=OFF",
    "-DCMAKE_INSTALL_LIBDIR=lib",
)  # fmt: skip
HDF5 = [
    *(f"-DHDF5_{one}=OFF" for one in ("BUILD_TOOLS", "BUILD_EXAMPLES", "BUILD_CPP_LIB")),
    "-DHDF5_BUILD_FORTRAN=OFF", "-DHDF5_ENABLE_SZIP_SUPPORT=OFF",
    "-DHDF5_ENABLE_Z_LIB_SUPPORT=ON", "-DHDF5_ENABLE_EMBEDDED_LIBINFO=OFF",
]  # fmt: skip
NETCDF = [
    f"-DENABLE_{one}=OFF"
    for one in ("DAP", "BYTERANGE", "NCZARR", "HDF4", "TESTS", "LIBXML2", "PLUGINS", "EXAMPLES")
] + ["-DENABLE_FILTER_TESTING=OFF", "-DBUILD_UTILITIES=OFF"]
#: Files of netCDF-Fortran, each after the files that it uses.
FORTRAN = """
typeSizes.f90 module_netcdf_nc_data.F90 module_netcdf_nc_interfaces.f90 module_netcdf_nf_data.F90
module_netcdf_nf_interfaces.F90 module_netcdf_f03.f90 nf_attio.F90 nf_control.F90 nf_dim.f90
nf_misc.f90 nf_genatt.f90 nf_geninq.f90 nf_genvar.f90 nf_vario.F90 nf_var1io.F90 nf_varaio.F90
nf_varmio.F90 nf_varsio.F90 nf_nc_noparallel.f90 module_netcdf4_nc_interfaces.f90
module_netcdf4_nf_interfaces.F90 module_netcdf4_f03.f90 nf_nc4.f90 netcdf4.f90
""".split()
#: Results of configure for this compiler.
KINDS = [
    f"-D{name}"
    for name in (
        "HAVE_F2008", "HAVE_TS29113_SUPPORT", "USE_NETCDF4", "NO_NETCDF_2", "NF_INT1_T=byte",
        "NF_INT1_IS_C_SIGNED_CHAR", "NF_INT2_T=integer*2", "NF_INT2_IS_C_SHORT",
        "NF_INT_IS_C_INT", "NF_INT8_IS_C_LONG_LONG", "NF_REAL_IS_C_FLOAT",
        "NF_DOUBLEPRECISION_IS_C_DOUBLE",
    )
]  # fmt: skip


class Target(NamedTuple):
    """Target system of the libraries: its build programs and existing libraries."""

    windows: bool
    compiler: str  # prefix of the compiler's names
    zlib: Path
    include: Path  # headers of zlib
    others: str  # libraries of the system

    @classmethod
    def of(cls, windows: bool) -> Target:
        if windows:
            zlib, include = Path(PREFIX, "lib/libz.a"), Path(PREFIX, "include")
            return cls(True, "x86_64-w64-mingw32-", zlib, include, "-lws2_32 -lshlwapi")
        found = subprocess.check_output(["gcc", "-print-file-name=libz.a"], text=True).strip()
        return cls(False, "", Path(found).resolve(), Path("/usr/include"), "-lm -ldl")


def main(folder: str, *options: str) -> None:
    place, target = Path(folder).resolve(), Target.of("--windows" in options)
    place.mkdir(parents=True, exist_ok=True)
    fetch(place, "hdf5", "netcdf", "netcdf-fortran")
    for archive in place.glob("*.orig.tar.*"):
        with tarfile.open(archive) as packed:
            packed.extractall(place, filter="data")
    if target.windows:
        (place / "windows.cmake").write_text(TOOLCHAIN)
    install_hdf5(place, target)
    install_netcdf(place, target)
    install_netcdf_fortran(place, target)


def install_hdf5(place: Path, target: Target) -> None:
    (tree,) = place.glob("hdf5-*/")
    build = place / "build-hdf5"
    build.mkdir(exist_ok=True)
    if target.windows:
        # MinGW has unistd.h, but not the functions that HDF5 expects in it
        edit(tree / "src/H5private.h", r"^#include <sys/wait.h>", "")
    # digits of long double and __float128, which configure would find by running a program
    (build / "pac_Cconftest.out").write_text("21;0;")
    cmake(place, target, tree, build, HDF5)


def install_netcdf(place: Path, target: Target) -> None:
    (tree,) = place.glob("netcdf-c-*/")
    edit(tree / "CMakeLists.txt", r"^LANGUAGES C CXX$", "LANGUAGES C")
    library, include = place / "lib", place / "include"
    hdf5 = [
        f"-DHDF5_C_LIBRARY={library}/libhdf5.a", f"-DHDF5_HL_LIBRARY={library}/libhdf5_hl.a",
        f"-DHDF5_INCLUDE_DIR={include}", f"-DHAVE_HDF5_H={include}", "-DHDF5_VERSION=1.10.8",
        f"-DHDF5_LIBRARIES={library}/libhdf5_hl.a;{library}/libhdf5.a;{target.zlib}"
        + ("" if target.windows else ";dl;m"),
    ]  # fmt: skip
    cmake(place, target, tree, place / "build-netcdf", [*NETCDF, *hdf5])


def install_netcdf_fortran(place: Path, target: Target) -> None:
    (tree,) = place.glob("netcdf-fortran-*/fortran")
    objects = []
    for name in FORTRAN:
        objects.append(place / f"{Path(name).stem}.o")
        flags = "-O2", "-w", "-cpp", "-fallow-argument-mismatch", "-J", "include"
        source = (tree / name).relative_to(place)  # paths shown in messages
        words = *flags, *KINDS, f"-I{source.parent}", "-c", source, "-o", objects[-1]
        run(f"{target.compiler}gfortran", *words, folder=place)
    objects.append(place / "nf_lib.o")
    compiler = f"{target.compiler}gcc", "-O2", "-w", "-DUSE_NETCDF4"
    headers = f"-I{place}/include", f"-I{tree.parent}/libsrc"
    run(*compiler, hidden(place), *headers, "-c", tree / "nf_lib.c", "-o", objects[-1])
    run(f"{target.compiler}ar", "rcs", place / "lib/libnetcdff.a", *objects)
    libraries = f"-L{place}/lib -lnetcdff -lnetcdf -lhdf5_hl -lhdf5 {target.zlib} {target.others}"
    for name in ("netcdf", "netcdf-fortran"):
        (place / f"{name}.pc").write_text(
            f"includedir={place}/include\nName: {name}\nDescription: static\nVersion: 4\n"
            f"Libs: {libraries}\nCflags: -I{place}/include\n"
        )


def cmake(place: Path, target: Target, tree: Path, build: Path, options: list[str]) -> None:
    """Configure, build and install a library into `place`."""
    where = [f"-DCMAKE_INSTALL_PREFIX={place}"]
    if target.windows:
        where.append(f"-DCMAKE_TOOLCHAIN_FILE={place}/windows.cmake")
    zlib = f"-DZLIB_LIBRARY={target.zlib}", f"-DZLIB_INCLUDE_DIR={target.include}"
    flags = f"-DCMAKE_C_FLAGS={hidden(place)}"
    # run in `place`: a program in HDF5's configuration leaves a file in its folder
    run("cmake", "-S", tree, "-B", build, *where, flags, *zlib, *COMMON, *options, folder=place)
    run("cmake", "--build", build, "--target", "install", "--parallel", os.cpu_count())


def hidden(place: Path) -> str:
    """Compiler option that replaces a folder in the paths written by the C compiler."""
    return f"-ffile-prefix-map={place}=."


def run(*command: object, folder: Path | None = None) -> None:
    env = os.environ | {"WINEDEBUG": "-all", "SOURCE_DATE_EPOCH": "0"}  # for netCDF's build time
    subprocess.run([str(word) for word in command], check=True, cwd=folder, env=env)


def edit(path: Path, pattern: str, text: str) -> None:
    path.write_text(re.sub(pattern, text, path.read_text(), flags=re.MULTILINE))


if __name__ == "__main__":
    main(*sys.argv[1:])
