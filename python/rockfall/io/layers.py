# SPDX-License-Identifier: BSD-3-Clause
"""Vector layers (GeoPackage, GeoJSON, shapefile, FlatGeobuf): features, and polygons as rasters on
the terrain's grid.

Files are looked at before GDAL opens them. Shapefile and FlatGeobuf hold only shapes. A GeoPackage
is a database, whose views may have no end; GeoJSON is text, that could be anything else, so it is
written anew.
"""

from __future__ import annotations

import json
import os
import re
import shlex
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

import numpy as np

from rockfall.errors import RockfallError, need
from rockfall.io.crs import crs_name, same_crs
from rockfall.io.files import SQLITE, check_text_file
from rockfall.io.gdal_files import plain_file, start_of
from rockfall.io.grid import NO_ID, Grid

if TYPE_CHECKING:
    from rasterio.crs import CRS

_DRIVERS = {"GPKG", "GeoJSON", "ESRI Shapefile", "FlatGeobuf"}
_SHAPES = (b"\0\0\x27\x0a", b"fgb\x03fgb")  # of shapefiles and FlatGeobuf
_GEOPACKAGE = (b"GPKG", b"GP10", b"GP11")  # what a database says it is, from byte 68
_CRS_NAME = re.compile(r"(urn:ogc:def:crs:)?(EPSG|OGC):[0-9.]*:?(CRS84|[0-9]{1,7})", re.IGNORECASE)
_POLYGONS = {"Polygon", "MultiPolygon"}
_LINES = {"LineString", "MultiLineString"}
_FEATURES = {"Point", *_LINES, *_POLYGONS}
_INDEX = re.compile(r'CREATE\s+VIRTUAL\s+TABLE\s+("[^"]*"|\w+)\s+USING\s+rtree\b', re.IGNORECASE)


def burn_polygons(
    path: str | Path,
    grid: Grid,
    field: str | None = None,
    remarks: list[str] | None = None,
    *,
    layer: str | None = None,
    key: str = "",
) -> np.ndarray:
    """Which polygon holds the centre of each cell; the later one where they overlap.

    With `field`, its integers (int32, `NO_ID` outside); without, a mask. Coordinates must be those
    of the terrain. A GeoJSON file that names no CRS is in degrees by its standard; where that
    cannot be (the terrain has no CRS, or the numbers are no degrees) they are taken as they are.
    What is odd but can be read is added to `remarks`. `layer` and `key` are as in `_on_terrain`.
    """
    from rasterio.features import rasterize

    path = str(path)
    remarks = [] if remarks is None else remarks
    columns = [] if field is None else [field]
    shapes, values, bounds = _on_terrain(
        path, columns, _POLYGONS, "polygons", grid, remarks, layer=layer, key=key
    )
    if field is None:
        numbers = np.ones(len(shapes), np.uint8)
    else:
        numbers = _integers(path, field, values[field])
    outside = 0 if field is None else NO_ID

    def burnt(order: int) -> np.ndarray:
        return rasterize(
            zip(shapes[::order], numbers[::order].tolist(), strict=True),
            out_shape=grid.shape,
            transform=grid.transform,
            fill=outside,
            dtype=numbers.dtype.name,
        )

    cells = burnt(1)
    if (cells == outside).all():
        raise RockfallError(
            f"{path}: no polygon holds the centre of a cell: {extent(*bounds)}; "
            f"the terrain: {extent(grid.west, grid.south, grid.east, grid.north)}"
        )
    if field is None:
        return cells.view(bool)
    if twice := np.count_nonzero(cells != burnt(-1)):
        remarks.append(
            f"{path}: polygons of different {field} overlap in {twice:,} cells: the later polygon "
            "counts there"
        )
    return cells


def layer_names(path: str | Path) -> list[str]:
    """The layers of a file that have shapes."""
    need("layers need", "vector", "pyogrio", "shapely")
    import pyogrio

    try:
        layers = pyogrio.list_layers(_plain_layer(str(path)))
    except (RuntimeError, UnicodeDecodeError) as error:  # GDAL's
        raise RockfallError(f"{path}: not a vector layer that can be read ({error})") from error
    return [str(name) for name, shape in layers if shape is not None]


def read_features(
    path: str | Path, grid: Grid, remarks: list[str], layer: str | None = None
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Points, lines and polygons, and all their attributes by name, in coordinates of the terrain;
    what is odd is added to `remarks`, as in `burn_polygons`."""
    what = "points, lines or polygons"
    return _on_terrain(str(path), None, _FEATURES, what, grid, remarks, layer=layer)[:2]


def read_lines(
    path: str | Path, layer: str | None, grid: Grid, remarks: list[str]
) -> tuple[list[list[np.ndarray]], dict[str, np.ndarray]]:
    """The lines of a layer (of the only one, for None) and all their attributes by name. A line is
    a list of its parts, (n, 2) coordinates [m]; parts that join are one."""
    shapes, values, _ = _on_terrain(
        str(path), None, _LINES, "lines", grid, remarks, layer=layer, key="layer"
    )
    return [_parts(shape) for shape in shapes], values


def _parts(shape: Any) -> list[np.ndarray]:
    import shapely

    parts = shapely.get_parts(shape)
    merged = shapely.get_parts(shapely.line_merge(shape))
    if len(merged) < len(parts):  # else as they were drawn
        parts = merged
    return [shapely.get_coordinates(part) for part in parts]


def read_points(
    path: str | Path, grid: Grid, fields: tuple[str, ...], remarks: list[str]
) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """x and y [m] of the points of a layer, and those of these attributes that it has, whether
    their names are in small or large letters."""
    import shapely

    shapes, values, _ = _on_terrain(str(path), None, {"Point"}, "points", grid, remarks)
    own = {name if name in fields else name.lower(): name for name in values}
    found = {field: values[own[field]] for field in fields if field in own}
    return shapely.get_x(shapes), shapely.get_y(shapes), found


def _on_terrain(
    path: str,
    columns: list[str] | None,
    kinds: set[str],
    what: str,
    grid: Grid,
    remarks: list[str],
    *,
    layer: str | None = None,
    key: str = "",
) -> tuple[np.ndarray, dict[str, np.ndarray], np.ndarray]:
    """Sound shapes of some kinds (a plural, for messages) in coordinates of the terrain, these
    attributes or all, and (west, south, east, north); of a `layer`, or of the only one. `key` says
    in messages how the case names a layer."""
    about, shapes, values = _read(path, columns, what, layer, key)
    bounds = _check_shapes(path, shapes, kinds, what)
    crs = _crs_of(about, bounds, grid)
    _check_crs(path, crs, grid)
    if crs is None and grid.crs is not None:
        dem = crs_name(grid.crs)
        remarks.append(f"{path}: names no CRS: taken to be in that of the DEM, {dem}")
    return shapes, values, bounds


def extent(west: float, south: float, east: float, north: float) -> str:
    return f"x {west:.12g} to {east:.12g}, y {south:.12g} to {north:.12g}"


def _read(
    path: str, columns: list[str] | None, what: str, layer: str | None, key: str
) -> tuple[dict[str, Any], np.ndarray, dict[str, np.ndarray]]:
    """(what the layer says of itself, its shapes, these attributes or all)."""
    need(f"{what} need", "vector", "pyogrio", "shapely")
    import pyogrio
    import shapely

    file = _plain_layer(path)
    try:
        layer = _layer(path, pyogrio.list_layers(file), what, layer, key)
        about = pyogrio.read_info(file, layer=layer, force_feature_count=True)
        if about["driver"] not in _DRIVERS:
            raise RockfallError(f"{path}: is read by {about['driver']}: must be {_DRIVERS}")
        if about["features"] == 0:
            raise RockfallError(f"{path}: the layer is empty, {what} are needed")
        names = list(about["fields"]) if columns is None else columns
        for name in names:
            if name not in about["fields"]:
                raise RockfallError(
                    f"{path}: no attribute {name}; has: {', '.join(about['fields']) or 'none'}"
                )
        about_read, _, wkb, values = pyogrio.raw.read(file, layer=layer, columns=names)
        shapes = shapely.from_wkb(wkb)
    except (RuntimeError, UnicodeDecodeError, shapely.errors.ShapelyError) as error:  # GDAL's
        raise RockfallError(f"{path}: not a vector layer that can be read ({error})") from error
    return about, shapes, dict(zip(about_read["fields"], values, strict=True))


def _layer(path: str, layers: np.ndarray, what: str, asked: str | None, key: str) -> str:
    """The name of the layer that is asked for, or of the only one with shapes (GeoPackages keep
    styles in tables without any)."""
    names = [name for name, shape in layers if shape is not None]
    if not names:
        raise RockfallError(f"{path}: has no layer with {what}")
    if asked is not None and asked not in names:
        raise RockfallError(f"{path}: no layer {asked}; has: {', '.join(names)}")
    if asked is None and len(names) > 1:
        advice = f"name one with {key}" if key else "keep one layer in the file"
        raise RockfallError(f"{path}: has {len(names)} layers ({', '.join(names)}); {advice}")
    return asked or names[0]


def _check_shapes(path: str, shapes: np.ndarray, kinds: set[str], what: str) -> np.ndarray:
    """Refuse what is not a sound shape of these kinds; returns (west, south, east, north)."""
    import shapely

    for number, shape in enumerate(shapes, start=1):
        where = f"{path}: feature {number}"
        if shape is None or shape.is_empty:
            raise RockfallError(f"{where}: has no geometry")
        if shape.geom_type not in kinds:
            raise RockfallError(f"{where}: is a {shape.geom_type}, {what} are needed")
        if not np.isfinite(shape.bounds).all():
            raise RockfallError(f"{where}: has coordinates that are not finite")
        if not shape.is_valid:
            kind = "polygon" if shape.geom_type in _POLYGONS else "line"
            raise RockfallError(f"{where}: invalid {kind}: {shapely.is_valid_reason(shape)}")
    return shapely.total_bounds(shapes)


def _check_crs(path: str, crs: CRS | None, grid: Grid) -> None:
    if same_crs(crs, grid.crs):
        return
    assert grid.crs is not None
    terrain = crs_name(grid.crs)
    target = terrain if terrain.startswith("EPSG:") else grid.crs.to_wkt()
    out = str(Path(path).with_name(f"{Path(path).stem}_on_dem.gpkg"))
    raise RockfallError(
        f"{path}: coordinates are in {crs_name(crs)}, those of the terrain in {terrain}; "
        f"reproject with: ogr2ogr -t_srs {shlex.join([target, out, path])}"
    )


def _crs_of(about: dict[str, Any], bounds: np.ndarray, grid: Grid) -> CRS | None:
    """The CRS of a layer; None for a GeoJSON whose coordinates cannot be the degrees it implies."""
    from rasterio.crs import CRS

    if not about["crs"]:
        return None
    crs = CRS.from_user_input(about["crs"])
    if about["driver"] == "GeoJSON" and crs.is_geographic:
        degrees = np.all(np.abs(bounds) <= (180.0, 90.0, 180.0, 90.0))
        if grid.crs is None or not degrees:
            return None
    return crs


def _integers(path: str, field: str, values: np.ndarray) -> np.ndarray:
    """The values of a field as int32."""
    if values.dtype.kind not in "iuf":
        raise RockfallError(f"{path}: attribute {field} is not a number, zone ids are integers")
    for number, value in enumerate(values.tolist(), start=1):
        where = f"{path}: feature {number}: {field}"
        if value != value:
            raise RockfallError(f"{where} is empty")
        if not (abs(value) < 2**31 and value == int(value)):
            raise RockfallError(f"{where} = {value}: must be an integer of 32 bits")
    return values.astype(np.int32)


def _plain_layer(path: str) -> str | bytes:
    """What GDAL may open for a file of polygons: its path, or a text made of it."""
    name, start = plain_file(path), start_of(path)
    if start.startswith(_SHAPES):
        return name
    if start.startswith(SQLITE):
        _check_geopackage(path, start)
        return name
    if start.removeprefix(b"\xef\xbb\xbf").lstrip().startswith(b"{"):
        return _plain_geojson(path)
    raise RockfallError(
        f"{path}: not a vector layer that can be read "
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
        raise RockfallError(f"{path}: not a vector layer that can be read ({error})") from error


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
        plain = _collection(data) | {"name": Path(path).stem}
        text = json.dumps(plain, allow_nan=False)
    except (ValueError, RecursionError, AttributeError) as error:
        raise RockfallError(f"{path}: not a vector layer that can be read ({error})") from error
    return text.replace("<", "\\u003c").encode()  # nothing in it looks like XML


def _no_number(token: str) -> None:
    raise ValueError(f"{token} is no number of JSON")


def _collection(data: Any) -> dict[str, Any]:
    """A FeatureCollection, with nothing but what we take; a ValueError says what else it is."""
    kind = data.get("type") if isinstance(data, dict) else type(data).__name__
    if kind == "FeatureCollection":
        features = data.get("features")
        if not isinstance(features, list):
            raise ValueError("features: must be a list")
    elif str(kind) in _FEATURES:
        features = [{"type": "Feature", "properties": {}, "geometry": data}]
    elif kind == "Feature":
        features = [data]
    else:
        raise ValueError(f"type = {str(kind)[:40]}: must be FeatureCollection, Feature or Polygon")
    plain: dict[str, Any] = {"type": "FeatureCollection"}
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
    if not isinstance(name, str) or not _CRS_NAME.fullmatch(name):
        raise ValueError(f"crs = {json.dumps(crs)[:80]}: must have a name such as EPSG:32632")
    return {"type": "name", "properties": {"name": name}}
