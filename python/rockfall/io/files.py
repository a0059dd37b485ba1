# SPDX-License-Identifier: BSD-3-Clause
"""Atomic writing of files: they appear under their name only when complete."""

import os
import shlex
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rockfall.errors import RockfallError
from rockfall.limits import MAX_TEXT

TEMPORARY = ".rockfall-"  # prefix of temporary folders
START = 1024  # bytes by which GDAL identifies a format too
#: First bytes of netCDF files, of the classic ones among them, and of GeoTIFFs.
CLASSIC = (b"CDF\1", b"CDF\2", b"CDF\5")
NETCDF = (*CLASSIC, b"\x89HDF\r\n\x1a\n")
TIFF = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")


def check_regular(path: str | Path) -> None:
    """Refuse a pipe or a device as input: it may be endless or block."""
    if os.path.exists(path) and not (os.path.isfile(path) or os.path.isdir(path)):
        raise RockfallError(f"{path}: not a regular file")


def check_netcdf(path: str | Path) -> None:
    """Refuse files that are not regular, and classic netCDF: if its header claims more than the
    file holds, the library allocates that memory, and aborts the process if there is too little."""
    check_regular(path)
    if os.path.isfile(path) and start_of(path).startswith(CLASSIC):
        new = Path(path).with_name(f"{Path(path).stem}_nc4.nc")
        command = shlex.join(["nccopy", "-k", "nc4", str(path), str(new)])
        raise RockfallError(f"{path}: is classic netCDF; make netCDF-4 of it: {command}")


def start_of(path: str | Path) -> bytes:
    """First bytes of a file."""
    try:
        with open(path, "rb") as file:
            return file.read(START)
    except OSError as error:
        raise RockfallError(f"{path}: cannot be read: {error.strerror}") from error


def check_text_file(path: str | Path) -> None:
    """Refuse files that are not regular, or too large for a text."""
    check_regular(path)
    if os.path.isfile(path) and os.path.getsize(path) > MAX_TEXT:
        raise RockfallError(f"{path}: larger than 64 MB; not a text file of ours")


def read_text(path: str | Path) -> str:
    """Text of a regular file, without a byte order mark."""
    check_text_file(path)
    try:
        return Path(path).read_text(encoding="utf-8-sig")
    except OSError as error:
        raise RockfallError(f"{path}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise RockfallError(f"{path}: is not text (UTF-8)") from error


@contextmanager
def atomic_write(path: str | Path) -> Iterator[Path]:
    """Yield a temporary path of the same name, renamed to `path` if the block succeeds and removed
    if it fails. It is in a new folder next to `path` with access for its owner only, so that in a
    shared folder nobody can place a link where format drivers will write."""
    path = Path(path)
    try:
        with tempfile.TemporaryDirectory(dir=path.parent, prefix=TEMPORARY) as folder:
            part = Path(folder) / path.name
            yield part
            os.replace(part, path)
    except OSError as error:
        raise RockfallError(f"{path}: cannot be written: {error.strerror or error}") from error
