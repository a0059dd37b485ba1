# SPDX-License-Identifier: BSD-3-Clause
"""Files that are no raster of ours, named as what they are, with what to do."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

from rockfall.errors import RockfallError
from rockfall.io.point_text import first_line, is_row

_UNPACK = "unpack it"
_CONVERT = "make a GeoTIFF of it: "
#: First bytes, what a file is, and the cure.
_STARTS = (
    (b"DSAA", "a Surfer text grid", _CONVERT),
    (b"LASF", "a point cloud", "rockfall dem makes a DEM of it"),
    (b"PK\x03\x04", "a ZIP archive", _UNPACK),
    (b"\x1f\x8b", "compressed (gzip)", _UNPACK),
    (b"7z\xbc\xaf\x27\x1c", "a 7z archive", _UNPACK),
    (b"Rar!", "a RAR archive", _UNPACK),
    (b"BZh", "compressed (bzip2)", _UNPACK),
    (b"\xfd7zXZ", "compressed (xz)", _UNPACK),
    (b"SQLite format 3", "a GeoPackage", _CONVERT),
    (b"GRIB", "a GRIB file", _CONVERT),
    (b"\x00\x00\x00\x0cjP", "a JPEG 2000 image", _CONVERT),
    (b"\x89PNG", "a picture (PNG)", "a GeoTIFF with elevations is needed"),
    (b"\xff\xd8\xff", "a picture (JPEG)", "a GeoTIFF with elevations is needed"),
    (b"%PDF", "a PDF", "a GeoTIFF with elevations is needed"),
    (b"\x00\x00\x27\x0a", "a shapefile", "a raster is needed"),
    (b"\xff\xfe", "text in UTF-16", "save it as UTF-8"),
    (b"\xfe\xff", "text in UTF-16", "save it as UTF-8"),
)
#: First lines of texts.
_LINES = (
    (r"<!doctype html|<html", "a web page", "the download failed"),
    (r"north:", "a GRASS text grid", _CONVERT),
    (r'\{\s*("|$)', "JSON", "a raster is needed"),
)
#: Rasters with a header in another file: extension, that of the header, and the name.
_HEADED = (
    (".sdat", ".sgrd", "a SAGA grid"),
    (".bil", ".hdr", "an EHdr grid"),
    (".flt", ".hdr", "an ESRI float grid"),
    (".img", ".hdr", "an ENVI grid"),
    (".rst", ".rdc", "an Idrisi grid"),
)


def check_foreign(path: str, start: bytes) -> None:
    """Refuse a file of a known kind that is not read; `start` are its first bytes."""
    file = Path(path)
    what, cure = _kind(file, start)
    if not what:
        return
    if cure == _CONVERT:
        other = file.with_suffix(".sdat") if file.suffix.lower() == ".sgrd" else file
        made = other.with_name(f"{other.stem}_{other.suffix[1:] or 'grid'}.tif")
        cure += shlex.join(["rio", "convert", str(other), str(made)])
    raise RockfallError(f"{path}: is {what}, no raster that is read; {cure}")


def _kind(file: Path, start: bytes) -> tuple[str, str]:
    """Name of the kind of a file, and the cure; "" if it is unknown."""
    for first, what, cure in _STARTS:
        if start.startswith(first):
            return what, cure
    suffix = file.suffix.lower()
    for data, header, what in _HEADED:
        if suffix == data and file.with_suffix(header).exists():
            return what, _CONVERT
        if suffix == header == ".sgrd":
            return what, _CONVERT
    line = first_line(start)
    for pattern, what, cure in _LINES:
        if re.match(pattern, line, re.IGNORECASE):
            return what, cure
    if is_row(line) or {"x", "y", "z"} <= set(re.split(r"[\s,;]+", line.lower())):
        made = file.with_name(f"{file.stem}_dem.tif")
        command = shlex.join(["rockfall", "dem", str(file), "-o", str(made)])
        return "points in rows", f"make a DEM of them: {command}"
    if re.search(rb"^\W*n(cols|rows)\b", start, re.IGNORECASE | re.MULTILINE):
        return "an ESRI ASCII grid with another header", "its first line must be: ncols NUMBER"
    if suffix == ".hgt":
        return "an SRTM tile without the name of its place", "name it such as N46E007.hgt"
    return "", ""
