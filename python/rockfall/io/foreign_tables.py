# SPDX-License-Identifier: BSD-3-Clause
"""Files given for a table that are something else, named as what they are, with what to do."""

from __future__ import annotations

import re
from pathlib import Path

from rockfall.errors import RockfallError
from rockfall.io.files import start_of

_TABLE, _LAYER = "save the table as CSV", "save it as a GeoPackage (.gpkg), as QGIS does"
#: First bytes (ignoring case), what a file is, and the cure.
_KINDS = (
    (rb"PK\x03\x04.{0,26}doc\.kml", "zipped KML", _LAYER),
    (rb"PK\x03\x04", "a spreadsheet or an archive", _TABLE),
    (rb"\xd0\xcf\x11\xe0", "a spreadsheet of Excel 97", _TABLE),
    (rb"\x1f\x8b", "compressed (gzip)", "unpack it"),
    (rb"SQLite format 3", "a GeoPackage", "name it .gpkg"),
    (rb"\x00\x00\x27\x0a", "a shapefile", "name it .shp"),
    (rb"\xff\xfe|\xfe\xff", "text in UTF-16", "save it as UTF-8"),
    (rb"LASF", "a point cloud", _TABLE),
    (rb"%PDF", "a PDF", _TABLE),
    (rb"\s*(<!doctype html|<html)", "a web page", "the download failed"),
    (rb'\s*\{\s*"', "GeoJSON", "name it .geojson"),
    (rb"\s*<.*<kml\b|\s*<kml\b", "KML", _LAYER),
    (rb"\s*<.*<gpx\b|\s*<gpx\b", "GPX", _LAYER),
    (rb"\s*<", "XML", _LAYER),
)
#: Trajectories of RAMMS, whose layout is not published.
_TRAJECTORIES = (".rts", ".pts")


def check_table(path: str | Path) -> None:
    """Refuse a file of a known kind that is no table; files that cannot be read pass."""
    if not Path(path).is_file():
        return
    if Path(path).suffix.lower() in _TRAJECTORIES:
        raise RockfallError(f"{path}: trajectories are not read: give samples and stops as CSV")
    start = start_of(path).removeprefix(b"\xef\xbb\xbf")
    for first, what, cure in _KINDS:
        if re.match(first, start, re.IGNORECASE | re.DOTALL):
            raise RockfallError(f"{path}: is {what}, no table in CSV: {cure}")
