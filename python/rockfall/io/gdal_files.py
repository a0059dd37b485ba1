# SPDX-License-Identifier: BSD-3-Clause
"""Files that GDAL may open: plain files of a few formats, without references elsewhere.

GDAL identifies files by content, not by name: a text may be a map service or a mosaic of other
files, and a pipe has no end. Everything GDAL would access is checked here first. A mosaic (VRT) may
name any file or server, run Python, or read bytes of any file as numbers: it is rewritten with
nothing but tiles and their positions.
"""

from __future__ import annotations

import math
import mmap
import os
import re
import struct
from pathlib import Path
from typing import BinaryIO
from xml.etree import ElementTree

from rockfall.errors import RockfallError
from rockfall.io.files import TIFF, check_regular, check_text_file
from rockfall.io.tables import plain_decimal

#: Rasters without text in their headers, where GDAL would read invalid numbers as zero.
BINARY = ("GTiff", "HFA", "GSBG", "GS7BG")
IMAGINE = b"EHFA_HEADER_TAG"
START = 1024  # bytes by which GDAL identifies a format too
_MASKS = (".msk", ".ovr")
_NODATA, _ASCII = 42113, 2  # a tag, and a type
_NOT_FINITE = re.compile(r"[+-]?(nan|inf|infinity|1\.#(qnan|ind|inf)0*)", re.IGNORECASE)
_MAX_NUMBER = 64  # bytes
_TYPES = {
    "Byte", "Int8", "UInt16", "Int16", "UInt32", "Int32", "UInt64", "Int64", "Float32", "Float64",
}  # fmt: skip
_WINDOW = ("xOff", "yOff", "xSize", "ySize")
#: Permitted elements of a VRT, and their attributes.
_ELEMENTS = {
    "VRTDataset": ("rasterXSize", "rasterYSize"),
    "SRS": ("dataAxisToSRSAxisMapping",),
    "GeoTransform": (),
    "VRTRasterBand": ("dataType", "band", "blockXSize", "blockYSize"),
    "MaskBand": (),
    "NoDataValue": (),
    "UnitType": (),
    "Offset": (),
    "Scale": (),
    "SimpleSource": (),
    "ComplexSource": (),
    "SourceFilename": ("relativeToVRT", "shared"),
    "SourceBand": (),
    "SourceProperties": ("RasterXSize", "RasterYSize", "DataType", "BlockXSize", "BlockYSize"),
    "SrcRect": _WINDOW,
    "DstRect": _WINDOW,
    "NODATA": (),
    "UseMaskBand": (),
}
#: Elements that do not affect the numbers.
_APART = {
    "Metadata", "ColorInterp", "ColorTable", "CategoryNames", "Histograms", "Description",
    "OverviewList",
}  # fmt: skip
_HOLDERS = {"VRTDataset", "VRTRasterBand", "MaskBand", "SimpleSource", "ComplexSource"}
_NUMBERS = {"GeoTransform": 6, "NoDataValue": 1, "Offset": 1, "Scale": 1, "NODATA": 1}


def plain_file(path: str | Path) -> str:
    """Absolute path of a regular file, whose companion files are regular too.

    GDAL never reads an absolute path as a command such as `WMS:...`.
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
    for companion in companions(Path(path)):
        check_regular(companion)
        is_mask = companion.suffix.lower() in _MASKS
        if is_mask and not start_of(companion).startswith(TIFF):
            raise RockfallError(f"{companion}: must be a GeoTIFF")
    return name


def check_imagine(path: str) -> None:
    """Refuse an Erdas Imagine file whose numbers are stored in another file."""
    with open(path, "rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        if content.find(b"ExternalRasterDMS") >= 0:
            raise RockfallError(f"{path}: its numbers are in another file; make a GeoTIFF of it")


def check_nodata(path: str) -> None:
    """Refuse a GeoTIFF whose nodata text is not a number: GDAL reads it as 0."""
    with open(path, "rb") as file:
        try:
            text = _nodata_text(file, os.path.getsize(path))
        except struct.error:  # truncated: GDAL reports it
            return
    nodata = text.strip(" \0")
    if nodata and math.isnan(plain_decimal(nodata)) and not _NOT_FINITE.fullmatch(nodata):
        raise RockfallError(f"{path}: nodata = {nodata[:40]}: must be a number or nan")


def _nodata_text(file: BinaryIO, size: int) -> str:
    """Text of the nodata tag in the first directory; empty if absent."""
    start = file.read(16)
    end = "<" if start[:2] == b"II" else ">"
    big = struct.unpack_from(f"{end}H", start, 2)[0] == 43
    count, entry = ("Q", "HHQQ") if big else ("H", "HHII")
    file.seek(struct.unpack_from(f"{end}{'Q' if big else 'I'}", start, 8 if big else 4)[0])
    (entries,) = struct.unpack(f"{end}{count}", file.read(struct.calcsize(f"{end}{count}")))
    length = struct.calcsize(f"{end}{entry}")
    for _ in range(min(entries, size // length)):
        tag, kind, many, where = struct.unpack(f"{end}{entry}", one := file.read(length))
        if tag == _NODATA and kind == _ASCII:
            inline = 8 if big else 4
            if many <= inline:
                return one[-inline:][:many].decode("latin-1")
            file.seek(where)
            return file.read(min(many, _MAX_NUMBER)).decode("latin-1")
    return ""


def start_of(path: str | Path) -> bytes:
    """First bytes of a file."""
    try:
        with open(path, "rb") as file:
            return file.read(START)
    except OSError as error:
        raise RockfallError(f"{path}: cannot be read: {error.strerror}") from error


def companions(path: Path) -> list[Path]:
    """Companion files, named after a file: masks, world files, tables."""
    stem, folder = f"{path.stem}.".lower(), path.parent
    names = [name for name in os.listdir(folder) if name.lower().startswith(stem)]
    return [folder / name for name in names if name != path.name]


def is_vrt(start: bytes) -> bool:
    """Return True if GDAL may read a file with these first bytes as a VRT."""
    return b"<VRTDataset" in start.split(b"\0")[0]


def plain_vrt(path: str) -> str:
    """Sanitised text of a VRT file for GDAL: with the absolute paths of its tiles."""
    check_text_file(path)
    try:
        text = Path(path).read_bytes().decode("utf-8-sig").strip()
        if "<!" in text.replace("<!--", ""):
            raise RockfallError(f"{path}: a VRT must not have a document type")
        root = ElementTree.fromstring(text)
    except (UnicodeDecodeError, ElementTree.ParseError, RecursionError) as error:
        raise RockfallError(f"{path}: is not XML: {error}") from error
    if root.tag != "VRTDataset":
        raise RockfallError(f"{path}: <{root.tag}>: must be VRTDataset")
    _tidy(path, root)
    return ElementTree.tostring(root, encoding="unicode")


def _tidy(path: str, element: ElementTree.Element) -> None:
    """Refuse unknown elements, remove irrelevant ones, and resolve the tiles."""
    where = f"{path}: <{element.tag}>"
    element.tail = None
    for name, value in element.attrib.items():
        if name not in _ELEMENTS[element.tag]:
            raise RockfallError(f"{where}: {name} = '{value[:40]}': is not read")
        if rule := _rule(name, value):
            raise RockfallError(f"{where}: {name} = '{value[:40]}': must be {rule}")
    if element.tag == "VRTRasterBand" and "dataType" not in element.attrib:
        raise RockfallError(f"{where}: has no dataType")
    if element.tag == "SourceFilename":
        _place(path, element)
    _check_numbers(where, element)
    if element.tag in _HOLDERS:
        element.text = None
    for child in list(element):
        if child.tag in _APART:
            element.remove(child)
        elif child.tag not in _ELEMENTS or element.tag not in _HOLDERS:
            raise RockfallError(
                f"{where}: <{str(child.tag)[:40]}>: a VRT may only put GeoTIFFs beside each other; "
                "make a GeoTIFF of it"
            )
        else:
            _tidy(path, child)


def _rule(name: str, value: str) -> str:
    """Rule that the value of an attribute breaks; empty if valid."""
    if name in ("dataType", "DataType"):
        return "" if value in _TYPES else "a type of real numbers"
    if name == "dataAxisToSRSAxisMapping":
        return "" if re.fullmatch(r"-?[123](,-?[123]){1,2}", value) else "a list of axes"
    if name in _WINDOW:
        return "a number" if math.isnan(plain_decimal(value)) else ""
    return "" if value.isascii() and value.isdigit() and len(value) < 10 else "an integer"


def _check_numbers(where: str, element: ElementTree.Element) -> None:
    if element.tag not in _NUMBERS:
        return
    tokens = (element.text or "").replace(",", " ").split()
    may_be_nan = element.tag in ("NoDataValue", "NODATA")
    numbers = [
        may_be_nan and token.lower() == "nan" or not math.isnan(plain_decimal(token))
        for token in tokens
    ]
    if len(numbers) != _NUMBERS[element.tag] or not all(numbers):
        text = (element.text or "").strip()[:80]
        raise RockfallError(f"{where}: '{text}': must be {_NUMBERS[element.tag]} numbers")


def _place(path: str, element: ElementTree.Element) -> None:
    """Absolute path of a tile, a GeoTIFF in the folder of the VRT or below."""
    folder = os.path.dirname(os.path.realpath(path))
    name = (element.text or "").strip()
    beside = element.attrib.get("relativeToVRT", "0") == "1"
    tile = os.path.join(os.path.dirname(path), name) if beside else name
    where = f"{path}: tile {name[:200]}"
    if not Path(os.path.realpath(tile)).is_relative_to(folder):
        raise RockfallError(f"{where}: must be in the folder of the VRT, or below")
    if not os.path.exists(tile):
        raise RockfallError(f"{where}: no such file")
    try:
        element.text = plain_file(tile)
    except RockfallError as error:
        raise RockfallError(f"{path}: tile {error}") from error
    if not start_of(tile).startswith(TIFF):
        raise RockfallError(f"{where}: must be a GeoTIFF")
    check_nodata(tile)
    element.attrib = {"relativeToVRT": "0"}
