# SPDX-License-Identifier: BSD-3-Clause
"""Compile the LAPACK procedures that the kernel calls for Windows, from Debian's source package.

usage: windows_lapack.py FOLDER FOLDER/liblapack.a and FOLDER/lapack.pc
"""

import re
import subprocess
import sys
import tarfile
from pathlib import Path

from debian_sources import fetch

COMPILER = "x86_64-w64-mingw32-gfortran"
CALLED = ("dpotrf", "dsyev")
FOLDERS = ("SRC", "BLAS/SRC", "INSTALL")
#: Files of the INSTALL folder with machine constants, which must not be optimised.
PLAIN = {"dlamch"}


def main(folder: str) -> None:
    place = Path(folder).resolve()
    place.mkdir(parents=True, exist_ok=True)
    fetch(place, "lapack")
    (archive,) = place.glob("lapack_*.orig.tar.gz")
    with tarfile.open(archive) as packed:
        packed.extractall(place, filter="data")
    (tree,) = place.glob("lapack-*")
    sources = {
        path.stem.lower(): path
        for part in reversed(FOLDERS)
        for path in (tree / part).iterdir()
        if path.suffix.lower() in (".f", ".f90")
    }
    order = sorted(needed(sources), key=lambda name: (not name.startswith("la_"), name))  # modules
    objects = [compiled(sources[name], place) for name in order]
    library = place / "liblapack.a"
    library.unlink(missing_ok=True)
    subprocess.run(["x86_64-w64-mingw32-ar", "rcs", library, *objects], check=True)
    (place / "lapack.pc").write_text(
        f"Name: lapack\nDescription: reference LAPACK\nVersion: {tree.name.partition('-')[2]}\n"
        f"Libs: -L{place} -llapack\n"
    )


def needed(sources: dict[str, Path]) -> set[str]:
    """Names of procedures called by the kernel, and of the procedures called by them."""
    found, left = set(), [*CALLED]
    while left:
        name = left.pop()
        if name not in found:
            found.add(name)
            text = sources[name].read_text(errors="replace").lower()
            words = re.findall(r"^[^*!c].*", text, re.MULTILINE)
            left += sources.keys() & set(re.findall(r"\b[a-z][a-z0-9_]*\b", "\n".join(words)))
    return found


def compiled(source: Path, place: Path) -> Path:
    """Compile a file, with the optimisation of Debian's package. Messages in the library contain
    the path given to the compiler: it is relative, for equal bytes in any folder."""
    target = place / f"{source.stem}.o"
    level = "-O0" if source.stem in PLAIN else "-O2"
    command = [COMPILER, level, "-ffp-contract=off", "-c", source.relative_to(place)]
    subprocess.run([*command, "-o", target.name], check=True, cwd=place)
    return target


if __name__ == "__main__":
    main(sys.argv[1])
