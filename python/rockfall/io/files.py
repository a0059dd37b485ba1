# SPDX-License-Identifier: BSD-3-Clause
"""Atomic writing of files: they appear under their name only when complete."""

import itertools
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rockfall.errors import RockfallError
from rockfall.limits import MAX_TEXT
from rockfall.system import replace

IN_USE = "cannot be replaced; is it open in another program?"
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


def start_of(path: str | Path) -> bytes:
    """First bytes of a file."""
    try:
        with open(path, "rb") as file:
            return file.read(START)
    except OSError as error:
        raise RockfallError(f"{path}: cannot be read: {reason(error, path)}") from error


def reason(error: OSError, path: str | Path) -> str:
    """Why a file cannot be read; Windows says of a folder that permission is denied."""
    return "Is a directory" if os.path.isdir(path) else error.strerror or str(error)


def relative_name(path: str | Path, folder: str | Path) -> str:
    """Name of a file as a case in `folder` holds it: relative, with `/` on every system; absolute
    if Windows has the file on another drive."""
    try:
        return Path(os.path.relpath(path, folder)).as_posix()
    except ValueError:
        return Path(path).absolute().as_posix()


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
        raise RockfallError(f"{path}: cannot be read: {reason(error, path)}") from error
    except UnicodeDecodeError as error:
        raise RockfallError(f"{path}: is not text (UTF-8)") from error


def keep_next_to(path: Path, new: Path) -> Path:
    """Move a file or folder next to the one that it cannot replace, as NAME-2, NAME-3, ..."""
    names = (path.with_name(f"{path.stem}-{k}{path.suffix}") for k in itertools.count(2))
    kept = next(name for name in names if not os.path.lexists(name))
    os.rename(new, kept)
    return kept


@contextmanager
def atomic_write(path: str | Path) -> Iterator[Path]:
    """Yield a temporary path of the same name, renamed to `path` if the block succeeds and removed
    if it fails. It is in a new folder next to `path` with access for its owner only, so that in a
    shared folder nobody can place a link where format drivers will write. A file that cannot be
    replaced, as on Windows one that is open, leaves the new one next to it."""
    path = Path(path)
    try:
        with tempfile.TemporaryDirectory(dir=path.parent, prefix=TEMPORARY) as folder:
            part = Path(folder) / path.name
            yield part
            try:
                replace(part, path)
            except PermissionError as error:
                kept = keep_next_to(path, part)
                raise RockfallError(f"{path}: {IN_USE} The new file is {kept}") from error
    except OSError as error:
        raise RockfallError(f"{path}: cannot be written: {error.strerror or error}") from error
