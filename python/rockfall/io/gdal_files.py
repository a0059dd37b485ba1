# SPDX-License-Identifier: BSD-3-Clause
"""Checks of files before GDAL opens them: plain files in a few formats, without references to
other files.

GDAL identifies files by content, not by name: a text may define a map service or a mosaic of other
files, and a pipe may be endless. Every file that GDAL would access is checked here first. Mosaics
(VRT) are refused, because they may access any file or server, and run Python.
"""

import math
import mmap
import os
import re
import shlex
import struct
from pathlib import Path
from typing import BinaryIO

from rockfall.errors import RockfallError
from rockfall.io.files import TIFF, check_regular, start_of
from rockfall.io.tables import plain_decimal

#: Formats without header texts that GDAL could misread as zero.
BINARY = ("GTiff", "HFA", "GSBG", "GS7BG")
#: GDAL driver of SRTM tiles, which are recognised by names such as N46E007.hgt.
TILE = ("SRTMHGT",)
SURFER = (b"DSBB", b"DSRB")
_TILE_NAME = re.compile(r"[NS]\d\d[EW]\d{3}(\.SRTM\w*)?\.hgt", re.IGNORECASE)
IMAGINE = b"EHFA_HEADER_TAG"
_MASKS = (".msk", ".ovr")
_NODATA = 42113  # TIFF tag
_ASCII, _SHORT = 2, 3  # TIFF types
_SIZES = {_ASCII: 1, _SHORT: 2}  # bytes
_NOT_FINITE = re.compile(r"[+-]?(nan|inf|infinity|1\.#(qnan|ind|inf)0*)", re.IGNORECASE)
_MAX_TAG = 65536  # bytes


def plain_file(path: str | Path) -> str:
    """Return the absolute path of a file. Refuses missing and empty files, folders, paths under
    /vsi, files (also companions) that are not regular, and masks other than GeoTIFF.

    GDAL never reads an absolute path as a command such as `WMS:...`.
    """
    name = os.path.abspath(path)
    if not os.path.exists(path):
        raise RockfallError(f"{path}: no such file")
    if name.startswith("/vsi"):
        raise RockfallError(
            f"{path}: GDAL reads /vsi as a virtual file system: give a path without it"
        )
    if os.path.isdir(path):
        raise RockfallError(f"{path}: is a folder: give a file name")
    check_regular(path)
    if os.path.getsize(path) == 0:
        raise RockfallError(f"{path}: is empty")
    for companion in companions(Path(path)):
        check_regular(companion)
        is_mask = companion.suffix.lower() in _MASKS
        if is_mask and not start_of(companion).startswith(TIFF):
            raise RockfallError(f"{companion}: must be a GeoTIFF")
    return name


def is_tile(path: str | Path) -> bool:
    """Return True for the name of an SRTM tile.

    >>> is_tile("dem/N46E007.hgt"), is_tile("dem/alps.hgt")
    (True, False)
    """
    return _TILE_NAME.fullmatch(Path(path).name) is not None


def check_imagine(path: str) -> None:
    """Refuse an Erdas Imagine file whose values are stored in another file."""
    with open(path, "rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        if content.find(b"ExternalRasterDMS") >= 0:
            raise RockfallError(f"{path}: its values are in another file: convert it to a GeoTIFF")


def check_nodata(path: str) -> None:
    """Refuse a GeoTIFF whose nodata text is not a number, because GDAL reads it as 0."""
    nodata = tiff_text(path, _NODATA).strip(" \0")
    if nodata and math.isnan(plain_decimal(nodata)) and not _NOT_FINITE.fullmatch(nodata):
        raise RockfallError(f"{path}: nodata = {nodata[:40]}: must be a number or nan")


def tiff_text(path: str | Path, tag: int) -> str:
    """Text of a tag in the first directory; "" if the tag is missing or the file truncated."""
    return _tiff_tag(path, tag, _ASCII)[0].decode("latin-1")


def tiff_numbers(path: str | Path, tag: int) -> tuple[int, ...]:
    """16-bit integers of a tag in the first directory; empty if missing or truncated."""
    raw, end = _tiff_tag(path, tag, _SHORT)
    return struct.unpack(f"{end}{len(raw) // 2}H", raw[: len(raw) // 2 * 2])


def _tiff_tag(path: str | Path, tag: int, kind: int) -> tuple[bytes, str]:
    """Bytes of a tag of the given type, with their byte order; no bytes if the file is
    truncated."""
    with open(path, "rb") as file:
        try:
            return _tag_bytes(file, os.path.getsize(path), tag, kind)
        except struct.error:
            return b"", "<"


def _tag_bytes(file: BinaryIO, size: int, wanted: int, wanted_kind: int) -> tuple[bytes, str]:
    start = file.read(16)
    end = "<" if start[:2] == b"II" else ">"
    big = struct.unpack_from(f"{end}H", start, 2)[0] == 43
    count, entry = ("Q", "HHQQ") if big else ("H", "HHII")
    file.seek(struct.unpack_from(f"{end}{'Q' if big else 'I'}", start, 8 if big else 4)[0])
    (entries,) = struct.unpack(f"{end}{count}", file.read(struct.calcsize(f"{end}{count}")))
    length = struct.calcsize(f"{end}{entry}")
    for _ in range(min(entries, size // length)):
        tag, kind, many, where = struct.unpack(f"{end}{entry}", raw := file.read(length))
        if tag == wanted and kind == wanted_kind:
            inline, many = 8 if big else 4, many * _SIZES[kind]
            if many <= inline:
                return raw[-inline:][:many], end
            file.seek(where)
            return file.read(min(many, _MAX_TAG)), end
    return b"", end


def companions(path: Path) -> list[Path]:
    """Files that share the stem of `path`, such as masks, world files and tables."""
    stem, folder = f"{path.stem}.".lower(), path.parent
    names = [name for name in os.listdir(folder) if name.lower().startswith(stem)]
    return [folder / name for name in names if name != path.name]


def check_vrt(path: str, start: bytes) -> None:
    """Refuse a file whose first bytes GDAL may take for a VRT."""
    if b"<VRTDataset" in start.split(b"\0")[0]:
        tiff = Path(path).with_name(f"{Path(path).stem}_vrt.tif")
        command = shlex.join(["gdal_translate", path, str(tiff)])
        raise RockfallError(f"{path}: is a VRT: convert it to a GeoTIFF: {command}")
