# SPDX-License-Identifier: BSD-3-Clause
"""File types, recognised by their first bytes."""

import re
from typing import NamedTuple


class Kind(NamedTuple):
    """File type: a name for messages, and a pattern for the first bytes."""

    name: str
    first: bytes


KMZ = Kind("zipped KML", rb"PK\x03\x04.{0,26}doc\.kml")
XLSX = Kind("a spreadsheet (.xlsx)", rb"PK\x03\x04.{0,26}(\[Content_Types\]|_rels/)")
ZIP = Kind("a ZIP archive", rb"PK\x03\x04")
XLS = Kind("an Excel 97 spreadsheet", rb"\xd0\xcf\x11\xe0")
GZIP = Kind("compressed (gzip)", rb"\x1f\x8b")
BZIP2 = Kind("compressed (bzip2)", rb"BZh")
XZ = Kind("compressed (xz)", rb"\xfd7zXZ")
SEVEN_ZIP = Kind("a 7z archive", rb"7z\xbc\xaf\x27\x1c")
RAR = Kind("a RAR archive", rb"Rar!")
GEOPACKAGE = Kind("a GeoPackage", rb"SQLite format 3")
SHAPEFILE = Kind("a shapefile", rb"\x00\x00\x27\x0a")
UTF_16 = Kind("text in UTF-16", rb"\xff\xfe|\xfe\xff")
CLOUD = Kind("a point cloud", rb"LASF")
PDF = Kind("a PDF", rb"%PDF")
PNG = Kind("a picture (PNG)", rb"\x89PNG")
JPEG = Kind("a picture (JPEG)", rb"\xff\xd8\xff")
JPEG_2000 = Kind("a JPEG 2000 image", rb"\x00\x00\x00\x0cjP")
SURFER = Kind("a Surfer text grid", rb"DSAA")
GRASS = Kind("a GRASS text grid", rb"(?i)\s*north:")
GRIB = Kind("a GRIB file", rb"GRIB")
HTML = Kind("a web page", rb"(?i)\s*(<!doctype html|<html)")
JSON = Kind("JSON", rb'\s*\{\s*("|$)')
KML = Kind("KML", rb"(?i)\s*<(.*<)?kml\b")
GPX = Kind("GPX", rb"(?i)\s*<(.*<)?gpx\b")
XML = Kind("XML", rb"\s*<")

#: File types; the first match counts.
KINDS = (
    KMZ, XLSX, ZIP, XLS, GZIP, BZIP2, XZ, SEVEN_ZIP, RAR, GEOPACKAGE, SHAPEFILE, UTF_16, CLOUD, PDF,
    PNG, JPEG, JPEG_2000, SURFER, GRASS, GRIB, HTML, JSON, KML, GPX, XML,
)  # fmt: skip
ARCHIVES = ZIP, GZIP, BZIP2, XZ, SEVEN_ZIP, RAR


def kind_of(start: bytes) -> Kind | None:
    """Type of a file from its first bytes; None if unknown."""
    start = start.removeprefix(b"\xef\xbb\xbf")
    for kind in KINDS:
        if re.match(kind.first, start, re.DOTALL):
            return kind
    return None
