# SPDX-License-Identifier: BSD-3-Clause
"""What GDAL may open: plain files of a few formats, and nothing that leads elsewhere.

GDAL goes by what a file holds, not by its name: a text may be a map service, a mosaic of other
files, a pipe has no end. What it would reach is looked at here, before it does.
"""

from __future__ import annotations

import mmap
import os
from pathlib import Path

from rockfall.errors import RockfallError
from rockfall.io.files import check_regular

#: Rasters without text in their headers: GDAL takes a word there for zero.
BINARY = ("GTiff", "HFA", "GSBG", "GS7BG")
IMAGINE = b"EHFA_HEADER_TAG"
TIFF = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
START = 1024  # bytes, of which GDAL too tells the format
_MASKS = (".msk", ".ovr")


def plain_file(path: str | Path) -> str:
    """The absolute path of a regular file, whose companions are regular files too.

    An absolute path is never a command to GDAL, as `WMS:...` would be.
    """
    name = os.path.abspath(path)
    if not os.path.exists(path):
        raise RockfallError(f"{path}: no such file")
    if name.startswith("/vsi"):
        raise RockfallError(f"{path}: /vsi names no folder of this machine to GDAL")
    if os.path.isdir(path):
        raise RockfallError(f"{path}: is a folder; a file name is needed")
    check_regular(path)
    if os.path.getsize(path) == 0:
        raise RockfallError(f"{path}: is empty")
    for companion in _companions(Path(path)):
        check_regular(companion)
        is_mask = companion.suffix.lower() in _MASKS
        if is_mask and not start_of(companion).startswith(TIFF):
            raise RockfallError(f"{companion}: must be a GeoTIFF")
    return name


def check_imagine(path: str) -> None:
    """Refuse a file of Erdas Imagine whose numbers are in another, of any name."""
    with open(path, "rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        if content.find(b"ExternalRasterDMS") >= 0:
            raise RockfallError(f"{path}: its numbers are in another file; make a GeoTIFF of it")


def start_of(path: str | Path) -> bytes:
    """The first bytes of a file."""
    try:
        with open(path, "rb") as file:
            return file.read(START)
    except OSError as error:
        raise RockfallError(f"{path}: cannot be read: {error.strerror}") from error


def _companions(path: Path) -> list[Path]:
    """What lies beside a file and is named after it, as masks, world files and tables are."""
    stem, folder = f"{path.stem}.".lower(), path.parent
    names = [name for name in os.listdir(folder) if name.lower().startswith(stem)]
    return [folder / name for name in names if name != path.name]
