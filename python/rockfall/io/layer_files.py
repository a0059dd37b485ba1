# SPDX-License-Identifier: BSD-3-Clause
"""Files of polygons that GDAL may open, looked at before it does.

Shapefile and FlatGeobuf hold only shapes. A GeoPackage is a database, whose views may have no end;
GeoJSON is text, that could be anything else, so it is written anew.
"""

from __future__ import annotations

import json
import os
import re
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any
from urllib.parse import quote

from rockfall.errors import RockfallError
from rockfall.io.files import check_text_file
from rockfall.io.gdal_files import plain_file, start_of

DRIVERS = {"GPKG", "GeoJSON", "ESRI Shapefile", "FlatGeobuf"}
_SHAPES = (b"\0\0\x27\x0a", b"fgb\x03fgb")  # of shapefiles and FlatGeobuf
_DATABASE = b"SQLite format 3\0"
_GEOPACKAGE = (b"GPKG", b"GP10", b"GP11")  # what a database says it is, from byte 68
_CRS = re.compile(r"(urn:ogc:def:crs:)?(EPSG|OGC):[0-9.]*:?(CRS84|[0-9]{1,7})", re.IGNORECASE)
_INDEX = re.compile(r'CREATE\s+VIRTUAL\s+TABLE\s+("[^"]*"|\w+)\s+USING\s+rtree\b', re.IGNORECASE)


def plain_layer(path: str) -> str | bytes:
    """What GDAL may open for a file of polygons: its path, or a text made of it."""
    name, start = plain_file(path), start_of(path)
    if start.startswith(_SHAPES):
        return name
    if start.startswith(_DATABASE):
        _check_geopackage(path, start)
        return name
    if start.removeprefix(b"\xef\xbb\xbf").lstrip().startswith(b"{"):
        return _plain_geojson(path)
    raise RockfallError(
        f"{path}: not a polygon layer that can be read "
        "(no GeoPackage, GeoJSON, shapefile or FlatGeobuf)"
    )


def _check_geopackage(path: str, start: bytes) -> None:
    """Nothing in the database but tables of what is stored, and their spatial indexes."""
    if start[68:72] not in _GEOPACKAGE:
        raise RockfallError(f"{path}: a database that is no GeoPackage")
    for journal in ("wal", "journal"):
        if os.path.isfile(f"{path}-{journal}") and os.path.getsize(f"{path}-{journal}"):
            raise RockfallError(
                f"{path}: another program writes to it ({path}-{journal}); close it there"
            )
    place = f"file:{quote(os.path.abspath(path))}?mode=ro&immutable=1"
    try:
        with closing(sqlite3.connect(place, uri=True)) as database:
            for kind, name, text in database.execute("SELECT type, name, sql FROM sqlite_master"):
                if kind == "view":
                    raise RockfallError(f"{path}: has a view, {name}: only tables are read")
                if kind == "table":
                    _check_table(path, database, name, text)
    except (sqlite3.Error, UnicodeDecodeError) as error:
        raise RockfallError(f"{path}: not a polygon layer that can be read ({error})") from error


def _check_table(path: str, database: sqlite3.Connection, name: str, text: str) -> None:
    if re.match(r"CREATE\s+VIRTUAL", text, re.IGNORECASE):
        if not _INDEX.match(text):
            raise RockfallError(f"{path}: table {name}: is virtual: only stored tables are read")
        return
    columns = database.execute("SELECT name, hidden FROM pragma_table_xinfo(?)", (name,))
    for column, hidden in columns:
        if hidden:
            raise RockfallError(
                f"{path}: table {name}: column {column} is computed: only stored ones are read"
            )


def _plain_geojson(path: str) -> bytes:
    """The shapes of a GeoJSON file, their plain properties, and its CRS."""
    check_text_file(path)
    try:
        data = json.loads(Path(path).read_bytes().decode("utf-8-sig"), parse_constant=_no_number)
        plain = _collection(data)
        text = json.dumps(plain, allow_nan=False)
    except (ValueError, RecursionError, AttributeError) as error:
        raise RockfallError(f"{path}: not a polygon layer that can be read ({error})") from error
    return text.replace("<", "\\u003c").encode()  # nothing in it looks like XML


def _no_number(word: str) -> None:
    raise ValueError(f"{word} is no number of JSON")


def _collection(data: Any) -> dict[str, Any]:
    """A FeatureCollection, with nothing but what we take; a ValueError says what else it is."""
    kind = data.get("type") if isinstance(data, dict) else type(data).__name__
    if kind == "FeatureCollection":
        features = data.get("features")
        if not isinstance(features, list):
            raise ValueError("features: must be a list")
    elif kind in ("Polygon", "MultiPolygon"):
        features = [{"type": "Feature", "properties": {}, "geometry": data}]
    elif kind == "Feature":
        features = [data]
    else:
        raise ValueError(f"type = {str(kind)[:40]}: must be FeatureCollection, Feature or Polygon")
    plain = {"type": "FeatureCollection", "name": "polygons"}
    plain["features"] = [_feature(one) for one in features]
    if "crs" in data:
        plain["crs"] = _crs(data["crs"])
    return plain


def _feature(feature: Any) -> dict[str, Any]:
    if not isinstance(feature, dict) or feature.get("type") != "Feature":
        raise ValueError("features: each must be a Feature")
    properties = feature.get("properties") or {}
    geometry = feature.get("geometry")
    if not isinstance(properties, dict) or not isinstance(geometry, dict | None):
        raise ValueError("properties and geometry of a Feature: must be objects")
    plain = {
        key: str(value) if isinstance(value, bool) else value  # GDAL would make numbers of them
        for key, value in properties.items()
        if not isinstance(value, dict | list)
    }
    if geometry:
        geometry = {key: geometry.get(key) for key in ("type", "coordinates")}
    return {"type": "Feature", "properties": plain, "geometry": geometry}


def _crs(crs: Any) -> Any:
    """A CRS by its name, never by an address."""
    if crs is None:
        return None
    name = crs.get("properties", {}).get("name") if crs.get("type") == "name" else None
    if not isinstance(name, str) or not _CRS.fullmatch(name):
        raise ValueError(f"crs = {json.dumps(crs)[:80]}: must have a name such as EPSG:32632")
    return {"type": "name", "properties": {"name": name}}
