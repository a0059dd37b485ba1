# SPDX-License-Identifier: BSD-3-Clause
"""Advice on files that are not supported as rasters."""

import math
import re
import shlex
from pathlib import Path

from rockfall.errors import RockfallError
from rockfall.io import file_kinds as kinds
from rockfall.io.coordinates.length_units import unit_of
from rockfall.io.vectors.point_text import first_line, is_row

_CONVERT = "convert it to a GeoTIFF: "
#: Advice by file type; other types may be readable as rasters.
_CURES = {
    **dict.fromkeys((*kinds.ARCHIVES, kinds.KMZ), "unpack it"),
    **dict.fromkeys((kinds.SURFER, kinds.GEOPACKAGE, kinds.GRIB, kinds.JPEG_2000), _CONVERT),
    # GDAL ignores its multiplier, and reads holes as 0 unless the header has a line `null`.
    kinds.GRASS: "convert it in GRASS: r.in.ascii, then r.out.gdal",
    **dict.fromkeys((kinds.PNG, kinds.JPEG, kinds.PDF), "give a GeoTIFF with elevations"),
    **dict.fromkeys(
        (kinds.SHAPEFILE, kinds.JSON, kinds.KML, kinds.GPX, kinds.XLSX, kinds.XLS),
        "give a raster",
    ),
    kinds.CLOUD: "create a DEM from it with rockfall dem",
    kinds.UTF_16: "save it as UTF-8",
    kinds.HTML: "the download failed",
}
#: Raster formats with a separate header file: extension and format name.
_HEADED = (
    (".sdat", ".sgrd", "a SAGA grid"),
    (".bil", ".hdr", "an EHdr grid"),
    (".flt", ".hdr", "an ESRI float grid"),
    (".img", ".hdr", "an ENVI grid"),
    (".rst", ".rdc", "an Idrisi grid"),
)
#: Lines of these headers that GDAL ignores or `rio convert` drops: scale, offset, unit.
_SCALE = re.compile(
    rb"^\s*(z_factor|z_offset|data gain values|data offset values|unit|value units)\s*[=:]"
    rb"[\s{]*([^}\r\n]*)",
    re.IGNORECASE | re.MULTILINE,
)
_HEADER = 65536  # maximum bytes of a header that are searched


def check_foreign(path: str, start: bytes) -> None:
    """Refuse a file of a known but unsupported type; `start` is its first bytes."""
    file = Path(path)
    what, cure = _kind(file, start)
    if not what:
        return
    if cure == _CONVERT and (line := _scale(file)):
        cure = f"export a GeoTIFF in metres: `rio convert` loses {line}"
    elif cure == _CONVERT:
        other = file.with_suffix(".sdat") if file.suffix.lower() == ".sgrd" else file
        made = other.with_name(f"{other.stem}_{other.suffix[1:] or 'grid'}.tif")
        cure += shlex.join(["rio", "convert", str(other), str(made)])
    raise RockfallError(f"{path}: is {what}, which cannot be read as a raster: {cure}")


def _scale(file: Path) -> str:
    """First line of the header with a scale other than 1, an offset other than 0, or a unit other
    than the metre; empty without one."""
    headers = [header for data, header, _ in _HEADED if file.suffix.lower() in (data, header)]
    for header in map(file.with_suffix, headers):
        if not header.is_file():
            continue
        with open(header, "rb") as content:
            lines = _SCALE.findall(content.read(_HEADER))
        for key, value in ((key.decode(), value.decode("latin-1").strip()) for key, value in lines):
            if not _is_neutral(key.lower(), value):
                return f"{key} = {value}"
    return ""


def _is_neutral(key: str, value: str) -> bool:
    """Return True if a line of a header leaves elevations in metres unchanged."""
    if "unit" in key:
        factor = unit_of(value).factor
        return math.isnan(factor) or factor == 1
    try:
        return float(value) == (0 if "offset" in key else 1)
    except ValueError:
        return False


def _kind(file: Path, start: bytes) -> tuple[str, str]:
    """Name of a file's type, and advice; empty if the type is unknown."""
    kind = kinds.kind_of(start)
    if kind in _CURES:
        return kind.name, _CURES[kind]
    suffix = file.suffix.lower()
    for data, header, what in _HEADED:
        if suffix == data and file.with_suffix(header).exists():
            return what, _CONVERT
        if suffix == header == ".sgrd":
            return what, _CONVERT
    line = first_line(start)
    if is_row(line) or {"x", "y", "z"} <= set(re.split(r"[\s,;]+", line.lower())):
        made = file.with_name(f"{file.stem}_dem.tif")
        command = shlex.join(["rockfall", "dem", str(file), "-o", str(made)])
        return "points in rows", f"create a DEM from them: {command}"
    if re.search(rb"^\W*n(cols|rows)\b", start, re.IGNORECASE | re.MULTILINE):
        return "an ESRI ASCII grid with another header", "its first line must be: ncols NUMBER"
    if suffix == ".hgt":
        return "an SRTM tile whose name gives no position", "name it such as N46E007.hgt"
    return "", ""
