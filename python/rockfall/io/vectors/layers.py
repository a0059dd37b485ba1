# SPDX-License-Identifier: BSD-3-Clause
"""Vector layers (GeoPackage, GeoJSON, shapefile, FlatGeobuf, drawings): features, and polygons
rasterised on the terrain's grid.

Files are checked before GDAL opens them. Shapefiles and FlatGeobuf contain only shapes. A
GeoPackage is a database whose views may be endless. GeoJSON is text that GDAL could take for
another format, so it is rewritten.
"""

from __future__ import annotations

import json
import os
import re
import shlex
import sqlite3
from collections.abc import Iterable, Mapping
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple
from urllib.parse import quote

import numpy as np

from rockfall.errors import RockfallError, need
from rockfall.io.coordinates.crs import crs_argument, crs_name, same_crs, transformation
from rockfall.io.files import check_text_file, start_of
from rockfall.io.gdal_files import plain_file
from rockfall.io.rasters.grid import NO_ID, Grid
from rockfall.io.vectors.drawing import (
    Drawing,
    Part,
    is_drawing,
    left_out,
    read_drawing,
    without_outlines,
)
from rockfall.io.vectors.polygons import (
    HALF,
    SLIVER,
    any_overlap,
    empty_polygons,
    held_cells,
    note_outside,
    on_terrain,
)
from rockfall.language import remark
from rockfall.system import has_locks

if TYPE_CHECKING:
    from rasterio.crs import CRS

#: File extensions of vector layers.
EXTENSIONS = frozenset({".gpkg", ".geojson", ".json", ".shp", ".fgb", ".dxf"})
_DRIVERS = {"GPKG", "GeoJSON", "ESRI Shapefile", "FlatGeobuf"}
_SHAPES = (b"\0\0\x27\x0a", b"fgb\x03fgb")  # shapefiles and FlatGeobuf
_GEOPACKAGE = (b"GPKG", b"GP10", b"GP11")  # application ids, at byte 68
_CRS_NAME = re.compile(r"(urn:ogc:def:crs:)?(EPSG|OGC):[0-9.]*:?(CRS84|[0-9]{1,7})", re.IGNORECASE)
_UNDEFINED = re.compile(r'\["Undefined (geographic |Cartesian )?SRS"')  # GeoPackage
_POLYGONS = {"Polygon", "MultiPolygon"}
_LINES = {"LineString", "MultiLineString"}
_POINTS = {"Point", "MultiPoint"}
_FEATURES = {*_POINTS, *_LINES, *_POLYGONS}
_TYPES = (  # sorted by type number
    "Point", "LineString", "LinearRing", "Polygon", "MultiPoint", "MultiLineString", "MultiPolygon"
)  # fmt: skip
MAX_NAMED = 5  # maximum polygons listed in a remark
NO_NAMES: Mapping[int, str] = {}
SHORT = 10  # maximum length of attribute names in shapefiles
REPROJECTED = "reprojected from"
_INDEX = re.compile(r'CREATE\s+VIRTUAL\s+TABLE\s+("[^"]*"|\w+)\s+USING\s+rtree\b', re.IGNORECASE)


def burn_polygons(
    path: str | Path,
    grid: Grid,
    field: str,
    remarks: list[str] | None = None,
    *,
    layer: str | None = None,
    key: str = "",
    numbers: np.ndarray | None = None,
    names: Mapping[int, str] = NO_NAMES,
) -> np.ndarray:
    """Integer `field`, or value in `numbers`, of the polygon that contains each cell centre (int32;
    `NO_ID` outside). Where polygons overlap, the last polygon counts. `names` of the values
    are used in remarks. Other arguments as in `_on_terrain`."""
    remarks, read = [] if remarks is None else remarks, [field] if numbers is None else []
    need("polygons need", "vector")
    import shapely

    polygons = _on_terrain(path, read, _POLYGONS, "polygons", grid, remarks, layer, key)
    if numbers is None:
        numbers = _integers(str(path), field, polygons.values[field])
    cells, owner, parts = _numbered(polygons, grid)
    ids = np.append(np.int32(NO_ID), numbers.astype(np.int32))[owner]
    first, _, _ = _numbered(polygons, grid, -1)
    differ = cells != first
    if twice := np.count_nonzero(ids[cells[differ]] != ids[first[differ]]):
        remarks.append(remark(path, "input.polygons_overlap", field=field, n=int(twice)))
    empty = empty_polygons(cells, parts, grid) & (shapely.area(on_terrain(parts, grid)) > 0)
    covered = empty & ~empty_polygons(first, parts, grid)
    for why, lost in (("covered", covered), ("empty", empty & ~covered)):
        if lost.any():
            numbers_lost = dict.fromkeys(ids[1:][lost].tolist())
            shown = [names.get(number) or f"{field} {number}" for number in numbers_lost]
            shown = [*shown[:MAX_NAMED], *["..."][: len(shown) > MAX_NAMED]]
            values = {"part": int(lost.sum()), "n": lost.size, "names": shown}
            remarks.append(remark(path, f"input.polygons_{why}", **values))
    note_outside(str(path), polygons.shapes, grid, HALF, remarks)
    return ids[cells]


def read_attributes(
    path: str | Path, what: str, layer: str | None = None, key: str = ""
) -> dict[str, np.ndarray]:
    """Attributes of all features in a layer, by name; `what` and `key` are used in messages."""
    return _read(str(path), None, what, layer, key)[2]


def layer_names(path: str | Path) -> list[str]:
    """Names of the layers with shapes. Raises a RockfallError if the file is no vector file."""
    need("layers need", "vector")
    import pyogrio

    if is_drawing(path):
        drawing = read_drawing(path)
        _check_paper_space(str(path), drawing, drawing.layers, None)
        return drawing.layers
    try:
        layers = pyogrio.list_layers(_plain_layer(str(path)))
    except (RuntimeError, UnicodeDecodeError) as error:  # errors of GDAL
        raise RockfallError(f"{path}: cannot be read as a vector layer ({error})") from error
    return [str(name) for name, shape in layers if shape is not None]


def numbered_polygons(
    path: str | Path, grid: Grid, remarks: list[str], layer: str | None = None, key: str = ""
) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """Part number (from 1) of the polygon that contains each cell centre (0: none; the last where
    polygons overlap); feature number (from 1) of each part, after a leading 0; and attributes of
    all features. Other arguments as in `_on_terrain`."""
    polygons = _on_terrain(path, None, _POLYGONS, "polygons", grid, remarks, layer, key)
    note_outside(str(path), polygons.shapes, grid, SLIVER, remarks)
    cells, owner, parts = _numbered(polygons, grid)
    if polygons.values and any_overlap(parts):
        first, _, _ = _numbered(polygons, grid, -1)
        if n := np.count_nonzero(owner[cells] != owner[first]):
            remarks.append(remark(path, "input.sources_overlap", n=int(n)))
    return cells, owner, polygons.values


def _numbered(
    polygons: _Features, grid: Grid, order: int = 1
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Number of the polygon part that contains each cell (the last, or for order -1 the first); the
    feature number (from 1) of each part, after a leading 0; and the parts. Refuses a layer if none
    of its polygons contains a cell centre."""
    import shapely

    parts, owner = shapely.get_parts(polygons.shapes, return_index=True)
    numbers = np.arange(1, parts.size + 1)
    cells = np.zeros(grid.shape, np.uint8 if parts.size < 2**8 else np.int32)
    held_cells(zip(parts[::order], numbers[::order].tolist(), strict=True), grid, cells)
    if not cells.any():
        raise RockfallError(
            f"{polygons.path}: no polygon contains a cell centre: {extent(*polygons.bounds)}; "
            f"the terrain: {extent(grid.west, grid.south, grid.east, grid.north)}"
        )
    return cells, np.append(0, owner + 1), parts


def read_features(
    path: str | Path, grid: Grid, remarks: list[str], layer: str | None = None, key: str = ""
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Shapes of any kind, and all attributes by name; arguments as in `_on_terrain`. A multipoint
    with a single point becomes a point."""
    import shapely

    what = "points, lines or polygons"
    _, shapes, values, _ = _on_terrain(path, None, _FEATURES, what, grid, remarks, layer, key)
    is_one = (shapely.get_type_id(shapes) == _TYPES.index("MultiPoint")) & (
        shapely.get_num_geometries(shapes) == 1
    )
    return np.where(is_one, shapely.get_geometry(shapes, 0), shapes), values


def read_polygons(
    path: str | Path, grid: Grid, remarks: list[str], layer: str | None = None, key: str = ""
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Polygons, and all attributes by name; arguments as in `_on_terrain`."""
    return _on_terrain(path, None, _POLYGONS, "polygons", grid, remarks, layer, key)[1:3]


def read_lines(
    path: str | Path, layer: str | None, grid: Grid, remarks: list[str], key: str = "layer"
) -> tuple[list[list[np.ndarray]], dict[str, np.ndarray]]:
    """Lines of a layer (None: the only layer), and all attributes by name. A line is a list of
    parts with (n, 2) coordinates [m]; connected parts are merged."""
    lines = _on_terrain(path, None, _LINES, "lines", grid, remarks, layer, key)
    return [_parts(shape) for shape in lines.shapes], lines.values


def _parts(shape: Any) -> list[np.ndarray]:
    import shapely

    parts = shapely.get_parts(shape)
    merged = shapely.get_parts(shapely.line_merge(shape))
    if len(merged) < len(parts):  # otherwise the line is kept as drawn
        parts = merged
    return [shapely.get_coordinates(part) for part in parts]


class Points(NamedTuple):
    """Points of a layer; the points of a multipoint share its attributes."""

    x: np.ndarray  # [m]
    y: np.ndarray
    values: dict[str, np.ndarray]  # attributes by name
    feature: np.ndarray  # feature number of each point, from 1


def read_points(
    path: str | Path, grid: Grid, remarks: list[str], layer: str | None = None, key: str = ""
) -> Points:
    """All points of a layer; arguments as in `_on_terrain`."""
    import shapely

    features = _on_terrain(path, None, _POINTS, "points", grid, remarks, layer, key)
    points, feature = shapely.get_parts(features.shapes, return_index=True)
    values = {name: column[feature] for name, column in features.values.items()}
    return Points(shapely.get_x(points), shapely.get_y(points), values, feature + 1)


def attribute(columns: dict[str, np.ndarray], name: str) -> np.ndarray | None:
    """Column with this name, ignoring case, or with the name as shapefiles truncate it; None if
    missing."""
    lower = {own.lower(): column for own, column in columns.items()}
    return columns.get(name, lower.get(name.lower(), lower.get(name[:SHORT].lower())))


def named_attribute(path: str | Path, columns: dict[str, np.ndarray], name: str) -> np.ndarray:
    """Column that the case selects by name; refuse a missing column."""
    if (values := attribute(columns, name)) is None:
        has = ", ".join(columns) or "none"
        raise RockfallError(f"{path}: attribute {name} is missing (attributes: {has})")
    return values


def plain(value: Any) -> Any:
    """Attribute of a feature as a Python value; None if empty or NaN."""
    value = value.item() if hasattr(value, "item") else value
    if value is None or value != value or (isinstance(value, str) and not value.strip()):
        return None
    return value


class _Features(NamedTuple):
    """A layer in the coordinates of the terrain."""

    path: str
    shapes: np.ndarray
    values: dict[str, np.ndarray]  # attributes by name
    bounds: np.ndarray  # west, south, east, north [m]


def _on_terrain(
    path: str | Path,
    columns: list[str] | None,
    kinds: set[str],
    what: str,
    grid: Grid,
    remarks: list[str],
    layer: str | None,
    key: str,
) -> _Features:
    """Read valid shapes of the given `kinds` with the attributes `columns` (None: all) from a
    `layer` (None: the only one). All layers are read by this function. `what` (a plural) and `key`
    (the case key) are used in messages.

    Coordinates in a CRS other than the terrain's are reprojected, vertex by vertex, with a note in
    `remarks`; a layer without a CRS is refused. If the terrain has no CRS, coordinates are used
    unchanged. Drawings are assumed to be in the terrain's CRS, with a note.
    """
    path = str(path)
    if is_drawing(path):
        shapes = _drawn(path, columns, kinds, what, grid, remarks, layer, key)
        return _Features(path, shapes, {}, _check_shapes(path, shapes, kinds, what))
    metadata, shapes, values = _read(path, columns, what, layer, key)
    bounds = _check_shapes(path, shapes, kinds, what)
    if grid.crs is None:
        return _Features(path, shapes, values, bounds)
    crs = _crs_of(path, metadata, bounds, crs_argument(grid.crs))
    if same_crs(crs, grid.crs):
        return _Features(path, shapes, values, bounds)
    shapes = _reprojected(name_of(path, layer), shapes, crs, grid, remarks)
    return _Features(path, shapes, values, _bounds(shapes))


def _drawn(
    path: str,
    columns: list[str] | None,
    kinds: set[str],
    what: str,
    grid: Grid,
    remarks: list[str],
    layer: str | None,
    key: str,
) -> np.ndarray:
    """Shapes in a layer of a drawing, which has neither attributes nor a CRS. Closed lines and
    hatches become polygons if polygons are allowed. Other entities, such as texts, are left out
    with a remark; an open line where polygons are required is refused."""
    need(f"{what} need", "vector")
    import shapely

    for name in columns or ():
        raise RockfallError(f"{path}: attribute {name} is missing: a drawing has no attributes")
    drawing, areas, points = read_drawing(path), bool(_POLYGONS & kinds), bool(kinds & _POINTS)

    def is_usable(part: Part) -> bool:
        return points if len(part.xy) == 1 else areas if part.rings else kinds != _POINTS

    titles = drawing.layers
    if layer is None:
        titles = [*drawing.layers_with(lambda part: areas or not part.rings)] or titles
    by_name = {name.casefold(): name for name in titles}
    asked = layer if layer is None else by_name.get(layer.casefold(), layer)
    _check_paper_space(path, drawing, titles, asked)
    name = _layer(path, [(title, "Unknown") for title in titles], what, asked, key)
    where, parts = name_of(path, name), [part for part in drawing.parts if part.layer == name]
    usable = [part for part in parts if len(part.xy) and is_usable(part)]
    if not usable:
        raise RockfallError(f"{where}: the layer has no {what}")
    used = set(map(id, usable))
    if others := [part for part in parts if id(part) not in used]:
        remarks.append(remark(where, "input.left_out", what=what, parts=left_out(others)))
    if n := drawing.on_paper(name):
        remarks.append(remark(where, "input.paper_space", n=n))
    if areas:
        usable = without_outlines(usable)
    shapes = np.empty(len(usable), object)
    for k, part in enumerate(usable):
        if len(part.xy) == 1:
            shapes[k] = shapely.Point(part.xy[0])
        elif part.closed and areas:
            shapes[k] = part.area()
        elif kinds == _POLYGONS:
            raise RockfallError(
                f"{where}: a {part.kind} from x {part.xy[0, 0]:.2f}, y {part.xy[0, 1]:.2f} is not "
                "closed: must be a polygon"
            )
        else:
            shapes[k] = shapely.LineString(part.xy)
    if grid.crs is not None or drawing.unit:
        key = "input.drawing_in_unit" if drawing.unit else "input.drawing"
        text = remark(where, key, unit=drawing.unit)
        remarks += [text] * (text not in remarks)
    return shapes


def _check_paper_space(path: str, drawing: Drawing, titles: list[str], asked: str | None) -> None:
    """Refuse a layer or drawing with entities only in paper space."""
    is_found = asked in titles if asked else titles
    if not is_found and (n := drawing.on_paper(asked)):
        raise RockfallError(
            f"{name_of(path, asked)}: {n:,} entities in paper space, none in model space: move "
            "them with _CHSPACE in CAD"
        )


def name_of(path: str | Path, layer: str | None) -> str:
    """File name, and layer name if given, for remarks."""
    return f"{path}, layer {layer}" if layer else str(path)


def _reprojected(
    where: str, shapes: np.ndarray, crs: CRS, grid: Grid, remarks: list[str]
) -> np.ndarray:
    """Shapes in the CRS of the terrain; refuses shapes that cannot be transformed."""
    import shapely

    assert grid.crs is not None
    way = transformation(crs, grid)
    shapes = shapely.transform(shapes, lambda xy: np.column_stack(way.transform(*xy.T)))
    for number in np.flatnonzero(~np.isfinite(shapely.bounds(shapes)).all(axis=1))[:1]:
        raise RockfallError(
            f"{where}: feature {number + 1}: {crs_name(crs)}: position cannot be transformed to "
            f"{crs_name(grid.crs)}, the CRS of the DEM"
        )
    key = "input.reprojected" if way.is_best else "input.reprojected_roughly"
    text = remark(where, key, crs=crs_name(crs), ours=crs_name(grid.crs))
    if text not in remarks:
        remarks.append(text)
    return shapes


def extent(west: float, south: float, east: float, north: float) -> str:
    """Bounds of a layer or grid as text, for messages."""
    return f"x {west:.12g} to {east:.12g}, y {south:.12g} to {north:.12g}"


def _read(
    path: str, columns: list[str] | None, what: str, layer: str | None, key: str
) -> tuple[dict[str, Any], np.ndarray, dict[str, np.ndarray]]:
    """Metadata, shapes, and attributes `columns` (None: all) of a layer. Refuses unsupported
    formats, empty layers and missing attributes."""
    need(f"{what} need", "vector")
    import pyogrio
    import shapely

    file = _plain_layer(path)
    try:
        layer = _layer(path, pyogrio.list_layers(file), what, layer, key)
        info = pyogrio.read_info(file, layer=layer, force_feature_count=True)
        if info["driver"] not in _DRIVERS:
            raise RockfallError(f"{path}: has format {info['driver']}: must be {_DRIVERS}")
        if info["features"] == 0:
            raise RockfallError(f"{path}: the layer is empty: must contain {what}")
        names = list(info["fields"]) if columns is None else columns
        for name in names:
            if name not in info["fields"]:
                raise RockfallError(
                    f"{path}: attribute {name} is missing (attributes: "
                    f"{', '.join(info['fields']) or 'none'})"
                )
        about_read, _, wkb, values = pyogrio.raw.read(file, layer=layer, columns=names)
        shapes = shapely.from_wkb(wkb)
    except (RuntimeError, UnicodeDecodeError, shapely.errors.ShapelyError) as error:  # from GDAL
        raise RockfallError(f"{path}: cannot be read as a vector layer ({error})") from error
    by_name = dict(zip(about_read["fields"], values, strict=True))
    # requested order, or layer order: pyogrio 0.11 sorts columns by name
    return info, shapes, {name: by_name[name] for name in names}


def _layer(path: str, layers: Iterable[Any], what: str, asked: str | None, key: str) -> str:
    """Name of the requested layer, or of the only layer with shapes; refuses several."""
    names = [name for name, shape in layers if shape is not None]
    if not names:
        raise RockfallError(f"{path}: has no layer with {what}")
    if asked is not None and asked not in names:
        raise RockfallError(f"{path}: no layer {asked} (layers: {', '.join(names)})")
    if asked is None and len(names) > 1:
        advice = f"choose one with {key}" if key else "keep one layer in the file"
        raise RockfallError(f"{path}: has {len(names)} layers ({', '.join(names)}): {advice}")
    return asked or names[0]


def _check_shapes(path: str, shapes: np.ndarray, kinds: set[str], what: str) -> np.ndarray:
    """Refuse invalid shapes and other kinds; return (west, south, east, north)."""
    import shapely

    good = ~(shapely.is_missing(shapes) | shapely.is_empty(shapes)) & shapely.is_valid(shapes)
    good &= np.isfinite(shapely.bounds(shapes)).all(axis=1)
    types = [number for number, name in enumerate(_TYPES) if name in kinds]
    good &= np.isin(shapely.get_type_id(shapes), types)
    for number in np.flatnonzero(~good)[:1]:
        shape, where = shapes[number], f"{path}: feature {number + 1}"
        if shape is None or shape.is_empty:
            raise RockfallError(f"{where}: has no geometry")
        if shape.geom_type not in kinds:
            raise RockfallError(f"{where}: is a {shape.geom_type}, but {what} are required")
        if not np.isfinite(shape.bounds).all():
            raise RockfallError(f"{where}: has coordinates that are not finite")
        kind = "polygon" if shape.geom_type in _POLYGONS else "line"
        raise RockfallError(f"{where}: invalid {kind}: {shapely.is_valid_reason(shape)}")
    return _bounds(shapes)


def _bounds(shapes: np.ndarray) -> np.ndarray:
    import shapely

    return shapely.total_bounds(shapes)


def _crs_of(path: str, metadata: dict[str, Any], bounds: np.ndarray, dem: str) -> CRS:
    """CRS of a layer; by its standard, GeoJSON without a CRS is in degrees. Refuses other layers
    without a CRS."""
    from rasterio.crs import CRS

    cure = f"ogr2ogr -a_srs {shlex.join([dem, f'{Path(path).stem}_with_crs.gpkg', path])}"
    if not metadata["crs"] or _UNDEFINED.search(metadata["crs"]):
        raise RockfallError(f"{path}: has no CRS. If it has the CRS of the DEM: {cure}")
    crs = CRS.from_user_input(metadata["crs"])
    if metadata["driver"] == "GeoJSON" and crs.is_geographic:
        if not np.all(np.abs(bounds) <= (180.0, 90.0, 180.0, 90.0)):
            raise RockfallError(
                f"{path}: has no CRS, and its coordinates are not degrees: {extent(*bounds)}. "
                f"If they are in the CRS of the DEM: {cure}"
            )
    return crs


def _integers(path: str, field: str, values: np.ndarray) -> np.ndarray:
    """Integer values of a field, as int32; refuses empty and other values."""
    if values.dtype.kind not in "iuf":
        raise RockfallError(f"{path}: attribute {field} is not a number: zone ids must be integers")
    for number, value in enumerate(values.tolist(), start=1):
        where = f"{path}: feature {number}: {field}"
        if value != value:
            raise RockfallError(f"{where} is empty")
        if not (abs(value) < 2**31 and value == int(value)):
            raise RockfallError(f"{where} = {value}: must be a 32-bit integer")
    return values.astype(np.int32)


def _plain_layer(path: str) -> str | bytes:
    """Input for GDAL from a vector file: its path, or rewritten text. Refuses unsupported files."""
    name, start = plain_file(path), start_of(path)
    if start.startswith(_SHAPES):
        return name
    if start.startswith(b"SQLite format 3\0"):
        _check_geopackage(path, start)
        return name if has_locks(name) else Path(path).read_bytes()  # SQLite could not lock it
    if start.removeprefix(b"\xef\xbb\xbf").lstrip().startswith(b"{"):
        return _plain_geojson(path)
    raise RockfallError(
        f"{path}: cannot be read as a vector layer (GeoPackage, GeoJSON, shapefile or FlatGeobuf)"
    )


def _check_geopackage(path: str, start: bytes) -> None:
    """Refuse a database that is no GeoPackage, is being written, or has views, computed columns, or
    virtual tables other than spatial indexes."""
    if start[68:72] not in _GEOPACKAGE:
        raise RockfallError(f"{path}: is a database but not a GeoPackage")
    for journal in ("wal", "journal"):
        if os.path.isfile(f"{path}-{journal}") and os.path.getsize(f"{path}-{journal}"):
            raise RockfallError(
                f"{path}: another program is writing to it ({path}-{journal}): close it there"
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
        raise RockfallError(f"{path}: cannot be read as a vector layer ({error})") from error


def _check_table(path: str, database: sqlite3.Connection, name: str, text: str) -> None:
    if re.match(r"CREATE\s+VIRTUAL", text, re.IGNORECASE):
        if not _INDEX.match(text):
            raise RockfallError(f"{path}: table {name}: is virtual: only stored tables are read")
        return
    columns = database.execute("SELECT name, hidden FROM pragma_table_xinfo(?)", (name,))
    for column, hidden in columns:
        if hidden:
            raise RockfallError(
                f"{path}: table {name}: column {column} is computed: only stored columns are read"
            )


def _plain_geojson(path: str) -> bytes:
    """Shapes, simple properties and CRS of a GeoJSON file, as text. Refuses invalid files."""
    check_text_file(path)
    try:
        data = json.loads(Path(path).read_bytes().decode("utf-8-sig"), parse_constant=_no_number)
        plain = _collection(data) | {"name": Path(path).stem}
        text = json.dumps(plain, allow_nan=False)
    except (ValueError, RecursionError, AttributeError) as error:
        raise RockfallError(f"{path}: cannot be read as a vector layer ({error})") from error
    return text.replace("<", "\\u003c").encode()  # prevents GDAL from taking it for XML


def _no_number(token: str) -> None:
    raise ValueError(f"{token} is not a JSON number")


def _collection(data: Any) -> dict[str, Any]:
    """FeatureCollection reduced to supported members; raises ValueError for anything else."""
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
    plain["features"] = [_feature(feature) for feature in features]
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
        key: str(value) if isinstance(value, bool) else value  # GDAL would convert booleans
        for key, value in properties.items()
        if not isinstance(value, dict | list)
    }
    if geometry:
        geometry = {key: geometry.get(key) for key in ("type", "coordinates")}
    return {"type": "Feature", "properties": plain, "geometry": geometry}


def _crs(crs: Any) -> Any:
    """CRS by name; URLs are refused."""
    if crs is None:
        return None
    name = crs.get("properties", {}).get("name") if crs.get("type") == "name" else None
    if not isinstance(name, str) or not _CRS_NAME.fullmatch(name):
        raise ValueError(f"crs = {json.dumps(crs)[:80]}: must have a name such as EPSG:32632")
    return {"type": "name", "properties": {"name": name}}
