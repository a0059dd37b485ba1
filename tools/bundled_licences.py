# SPDX-License-Identifier: BSD-3-Clause
"""Add the licences of bundled libraries to the source tree in this folder, before a wheel is built.

usage: bundled_licences.py [FOLDER]   FOLDER of static_netcdf.py, if rockfall-batch is in the wheel

A wheel contains libgfortran, libgomp and libquadmath of GCC; LAPACK and BLAS, linked into its
extensions; and netCDF, HDF5 and zlib in rockfall-batch. Their licences must be included, and are
taken from the building machine.
"""

import os
import shutil
import sys
from glob import glob
from pathlib import Path

BREW = "/opt/homebrew/opt", "/usr/local/opt"
MSYS2 = f"{os.environ.get('RUNNER_TEMP', '')}/msys64/ucrt64/share/licenses"
PLACES = {  # locations of each licence in Debian, Fedora, Homebrew and MSYS2
    "gcc": [
        "/usr/share/doc/libgfortran5/copyright",
        "/usr/share/common-licenses/GPL-3",
        "/usr/share/common-licenses/LGPL-2.1",
        "/usr/share/licenses/libgcc/COPYING*",
        *(f"{folder}/gcc/COPYING*" for folder in BREW),
        f"{MSYS2}/gcc-libs/*",
    ],
    "lapack": [
        "/usr/share/doc/liblapack-dev/copyright",
        "/usr/share/licenses/lapack*/LICENSE*",
        *(f"{folder}/lapack/LICENSE*" for folder in BREW),
        f"{MSYS2}/lapack/*",
    ],
}
OF_NETCDF = {  # licences in the folder of static_netcdf.py
    "netcdf": ["netcdf-c-*/COPYRIGHT"],
    "netcdf-fortran": ["netcdf-fortran-*/COPYRIGHT"],
    "hdf5": ["hdf5-*/COPYING"],
    "zlib": ["/usr/share/doc/zlib1g-dev/copyright"],
}
OWN = 'license-files = ["LICENSE"]'


def main(folders: list[str]) -> str | None:
    """Copy licences to `licences` and list them in pyproject.toml; return the fault, if any."""
    project = Path("pyproject.toml")
    text = project.read_text("utf-8")
    if OWN not in text:
        return f"pyproject.toml has no line {OWN}"
    all_places = dict(PLACES)
    for folder in folders:
        for name, places in OF_NETCDF.items():
            all_places[name] = [os.path.join(folder, place) for place in places]
    for name, places in all_places.items():
        found = [path for place in places for path in sorted(glob(place))]
        if not found:
            return f"no licence of {name} on this machine: a wheel must not go without"
        (Path("licences") / name).mkdir(parents=True)
        for path in found:
            shutil.copyfile(path, Path("licences") / name / Path(path).name)
    project.write_text(text.replace(OWN, OWN.replace("]", ', "licences/*/*"]')), "utf-8")
    return None


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
