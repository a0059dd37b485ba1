# SPDX-License-Identifier: BSD-3-Clause
"""Mosaics of GeoTIFFs (GDAL's VRT), written anew with nothing in them but tiles and their place.

A VRT may name any file or server, run Python, or read bytes of any file as numbers. GDAL gets to
see only what is understood here.
"""

from __future__ import annotations

import math
import os
import re
from pathlib import Path
from xml.etree import ElementTree

from rockfall.errors import RockfallError
from rockfall.io.files import check_text_file
from rockfall.io.gdal_files import TIFF, plain_file, start_of
from rockfall.io.tables import plain_decimal
from rockfall.io.tiff_tags import check_mark

_TYPES = {
    "Byte", "Int8", "UInt16", "Int16", "UInt32", "Int32", "UInt64", "Int64", "Float32", "Float64",
}  # fmt: skip
_WINDOW = ("xOff", "yOff", "xSize", "ySize")
#: What counts, and its attributes.
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
#: What tells nothing of the numbers.
_APART = {
    "Metadata", "ColorInterp", "ColorTable", "CategoryNames", "Histograms", "Description",
    "OverviewList",
}  # fmt: skip
_HOLDERS = {"VRTDataset", "VRTRasterBand", "MaskBand", "SimpleSource", "ComplexSource"}
_NUMBERS = {"GeoTransform": 6, "NoDataValue": 1, "Offset": 1, "Scale": 1, "NODATA": 1}


def is_vrt(start: bytes) -> bool:
    """Whether a file that begins so may be a VRT to GDAL."""
    return b"<VRTDataset" in start.split(b"\0")[0]


def plain_vrt(path: str) -> str:
    """The text of a VRT in a file, as GDAL may have it: with the absolute paths of its tiles."""
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
    """Refuse what is not known, take out what tells nothing, place the tiles."""
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
    """What the value of an attribute must be; empty where it is."""
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
    words = (element.text or "").replace(",", " ").split()
    may_be_nan = element.tag in ("NoDataValue", "NODATA")
    numbers = [may_be_nan and word.lower() == "nan" or not math.isnan(plain_decimal(word))
               for word in words]  # fmt: skip
    if len(numbers) != _NUMBERS[element.tag] or not all(numbers):
        text = (element.text or "").strip()[:80]
        raise RockfallError(f"{where}: '{text}': must be {_NUMBERS[element.tag]} numbers")


def _place(path: str, element: ElementTree.Element) -> None:
    """The absolute path of a tile, a GeoTIFF in the folder of the VRT or below."""
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
    check_mark(tile)
    element.attrib = {"relativeToVRT": "0"}
