# SPDX-License-Identifier: BSD-3-Clause
"""Input files: checks that they are regular files, and reading of their first bytes or their
text."""

import os
from pathlib import Path

from rockfall.errors import RockfallError
from rockfall.limits import MAX_TEXT

START = 1024  # bytes read to identify a format, as in GDAL
#: First bytes of netCDF, classic netCDF and GeoTIFF files.
CLASSIC = (b"CDF\1", b"CDF\2", b"CDF\5")
NETCDF = (*CLASSIC, b"\x89HDF\r\n\x1a\n")
TIFF = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")


def check_regular(path: str | Path) -> None:
    """Refuse a pipe or device as input: it may be endless, or block."""
    if os.path.exists(path) and not (os.path.isfile(path) or os.path.isdir(path)):
        raise RockfallError(f"{path}: is not a regular file")


def start_of(path: str | Path) -> bytes:
    """First `START` bytes of a file. Raises a RockfallError if it cannot be read."""
    try:
        with open(path, "rb") as file:
            return file.read(START)
    except OSError as error:
        raise RockfallError(f"{path}: cannot be read: {reason(error, path)}") from error


def reason(error: OSError, path: str | Path) -> str:
    """Reason why a file cannot be read. Folders are identified first, because Windows only reports
    denied permission for them."""
    return "Is a directory" if os.path.isdir(path) else error.strerror or str(error)


def relative_name(path: str | Path, folder: str | Path) -> str:
    """Name by which a case in `folder` refers to a file: relative, with `/` on every system, but
    absolute if the file is on another Windows drive."""
    try:
        return Path(os.path.relpath(path, folder)).as_posix()
    except ValueError:
        return Path(path).absolute().as_posix()


def check_text_file(path: str | Path) -> None:
    """Refuse a file that is not regular, or too large for a text file."""
    check_regular(path)
    if os.path.isfile(path) and os.path.getsize(path) > MAX_TEXT:
        raise RockfallError(f"{path}: is larger than 64 MB, so it is not a rockfall text file")


def read_text(path: str | Path) -> str:
    """Text of a regular file, without a byte order mark. Raises a RockfallError if it cannot be
    read."""
    check_text_file(path)
    try:
        return Path(path).read_text(encoding="utf-8-sig")
    except OSError as error:
        raise RockfallError(f"{path}: cannot be read: {reason(error, path)}") from error
    except UnicodeDecodeError as error:
        raise RockfallError(f"{path}: is not text (UTF-8)") from error
