# SPDX-License-Identifier: BSD-3-Clause
"""Polygon layers (GeoPackage, GeoJSON, shapefile) to rasters on the grid of the terrain."""

from __future__ import annotations

from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Any

import numpy as np

from rockfall.errors import RockfallError, need
from rockfall.io.crs import crs_name, same_crs
from rockfall.io.grid import NO_ID, Grid
from rockfall.io.layer_files import DRIVERS, plain_layer

if TYPE_CHECKING:
    from rasterio.crs import CRS


def burn_polygons(
    path: str | Path, grid: Grid, field: str | None = None, doubts: list[str] | None = None
) -> np.ndarray:
    """Which polygon holds the centre of each cell; the later one where they overlap.

    With `field`, its integers (int32, `NO_ID` outside); without, a mask. Coordinates must be those
    of the terrain. A GeoJSON file that names no CRS is in degrees by its standard; where that
    cannot be (the terrain has no CRS, or the numbers are no degrees) they are taken as they are.
    What is odd but can be read is added to `doubts`.
    """
    from rasterio.features import rasterize

    path = str(path)
    about, shapes, values = _read(path, field)
    bounds = _check_shapes(path, shapes)
    crs = _layer_crs(about, bounds, grid)
    _check_crs(path, crs, grid)
    doubts = [] if doubts is None else doubts
    if crs is None and grid.crs is not None:
        doubts.append(f"{path}: names no CRS: taken to be in that of the DEM, {crs_name(grid.crs)}")
    if field is None:
        numbers = np.ones(len(shapes), np.uint8)
    else:
        numbers = _integers(path, field, values)
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
            f"{path}: no polygon holds the centre of a cell: {_extent(*bounds)}; "
            f"the terrain: {_extent(grid.west, grid.south, grid.east, grid.north)}"
        )
    if field is None:
        return cells.view(bool)
    if twice := np.count_nonzero(cells != burnt(-1)):
        doubts.append(
            f"{path}: polygons of different {field} overlap in {twice:,} cells: the later polygon "
            "counts there"
        )
    return cells


def _extent(west: float, south: float, east: float, north: float) -> str:
    return f"x {west:.12g} to {east:.12g}, y {south:.12g} to {north:.12g}"


def _read(path: str, field: str | None) -> tuple[dict[str, Any], np.ndarray, np.ndarray | None]:
    """(what the layer says of itself, its shapes, the values of the field)."""
    need("polygons need", "vector", "pyogrio", "shapely")
    import pyogrio
    import shapely

    file = plain_layer(path)
    try:
        layer = _only_layer(path, pyogrio.list_layers(file))
        about = pyogrio.read_info(file, layer=layer, force_feature_count=True)
        if about["driver"] not in DRIVERS:
            raise RockfallError(f"{path}: is read by {about['driver']}: must be {DRIVERS}")
        if about["features"] == 0:
            raise RockfallError(f"{path}: the layer is empty, polygons are needed")
        if field is not None and field not in about["fields"]:
            raise RockfallError(
                f"{path}: no attribute {field}; has: {', '.join(about['fields']) or 'none'}"
            )
        columns = [] if field is None else [field]
        _, _, wkb, values = pyogrio.raw.read(file, layer=layer, columns=columns)
        shapes = shapely.from_wkb(wkb)
    except (RuntimeError, UnicodeDecodeError, shapely.errors.ShapelyError) as error:  # GDAL's
        raise RockfallError(f"{path}: not a polygon layer that can be read ({error})") from error
    return about, shapes, values[0] if field else None


def _only_layer(path: str, layers: np.ndarray) -> str:
    """The name of the one layer with shapes (GeoPackages keep styles in tables without any)."""
    names = [name for name, shape in layers if shape is not None]
    if not names:
        raise RockfallError(f"{path}: has no layer with polygons")
    if len(names) > 1:
        raise RockfallError(
            f"{path}: has {len(names)} layers ({', '.join(names)}); keep one layer in the file"
        )
    return names[0]


def _check_shapes(path: str, shapes: np.ndarray) -> np.ndarray:
    """Refuse what is not a sound polygon; returns (west, south, east, north)."""
    import shapely

    for number, shape in enumerate(shapes, start=1):
        where = f"{path}: feature {number}"
        if shape is None or shape.is_empty:
            raise RockfallError(f"{where}: has no geometry")
        if shape.geom_type not in ("Polygon", "MultiPolygon"):
            raise RockfallError(f"{where}: is a {shape.geom_type}, polygons are needed")
        if not np.isfinite(shape.bounds).all():
            raise RockfallError(f"{where}: has coordinates that are not finite")
        if not shape.is_valid:
            raise RockfallError(f"{where}: invalid polygon: {shapely.is_valid_reason(shape)}")
    return shapely.total_bounds(shapes)


def _check_crs(path: str, crs: CRS | None, grid: Grid) -> None:
    if same_crs(crs, grid.crs):
        return
    terrain = crs_name(grid.crs)
    target = terrain if terrain.startswith("EPSG:") else grid.crs.to_wkt()
    out = str(Path(path).with_name(f"{Path(path).stem}_on_dem.gpkg"))
    raise RockfallError(
        f"{path}: coordinates are in {crs_name(crs)}, those of the terrain in {terrain}; "
        f"reproject with: ogr2ogr -t_srs {quote(target)} {quote(out)} {quote(path)}"
    )


def _layer_crs(about: dict[str, Any], bounds: np.ndarray, grid: Grid) -> CRS | None:
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
