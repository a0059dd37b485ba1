# SPDX-License-Identifier: BSD-3-Clause
"""Export of a result as GeoTIFF, GeoPackage, CSV, KML and DXF."""

from __future__ import annotations

import csv
import io
import shutil
import sqlite3
import tempfile
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, nullcontext
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rockfall.case.files import files_behind
from rockfall.errors import OUR_FAULT, RockfallError, need
from rockfall.files.drawing import write_drawing
from rockfall.files.geographic import geographic
from rockfall.files.kml import write_kml
from rockfall.files.protection_lines import dam_lines, dams_in
from rockfall.files.qgis_style import write_classes
from rockfall.files.source_areas import SourceTable, are_cells, source_areas
from rockfall.files.trajectory_layers import (
    flight_features,
    in_milliseconds,
    trajectory_features,
)
from rockfall.files.vector_style import STYLES, Style, put_styles
from rockfall.io.atomic import atomic_folder, atomic_write
from rockfall.io.coordinates.crs import in_plan
from rockfall.io.decimal_text import csv_rows, real_column, whole_column, word_column
from rockfall.io.output_files import why_unwritten
from rockfall.io.rasters.arrays import north_up
from rockfall.io.rasters.geotiff import write_geotiff
from rockfall.io.tables import spreadsheet_text
from rockfall.quantities import SHOWN
from rockfall.result.crossings import HEIGHTS, columns_at, line_names
from rockfall.result.dataset import NO_COUNT, open_result
from rockfall.result.maps.classes import classes_of, shown_as
from rockfall.result.maps.flat_maps import PLAN, flat_maps
from rockfall.result.motion import TOLERANCE, Sampled, motion_of, sampled, seconds
from rockfall.result.names import distinct_words
from rockfall.result.trajectories import flags_of
from rockfall.result.validate import check_dimensions
from rockfall.result.variables import CROSSING, FRAGMENT, LINE
from rockfall.simulation.progress import add_steps, step, stepped
from rockfall.system import has_locks

if TYPE_CHECKING:
    import xarray as xr

#: Shapes, and columns of attributes.
Features = tuple[np.ndarray, dict[str, np.ndarray]]
#: Layer name -> geometry type, and features in parts.
Layers = dict[str, tuple[str, Iterable[Features]]]

USUAL = ("tif", "gpkg", "csv")
FORMATS = (*USUAL, "kml", "dxf")
GONE = {"czml": "is no longer written: use kml, which Cesium reads"}
DRAWN = ("sources", "stops", "lines", "trajectories")  # layers of KML and DXF, each feature once
GEOMETRY = "geom"  # column of a GeoPackage
MEASURED = {"LineString ZM": "Measured 3D LineString"}  # pyogrio name
WKB_KINDS = {"Point": 1, "Point Z": 1001}  # geometry types of ISO WKB
_ROWS = 32_768  # rows read and formatted at a time, in the cache of a processor
PLACES = 4  # decimals of crossing coordinates [m]
METRES = {"units": "m"}
#: Attributes of the crossing columns.
ABOUT = {**dict.fromkeys(HEIGHTS, METRES), **LINE, **CROSSING, **FRAGMENT}


class Chosen(NamedTuple):
    """Options of an export: formats, and tolerance [m] of parabolas drawn as polylines."""

    formats: Sequence[str] = USUAL
    tolerance: float = TOLERANCE


EXPORTED = Chosen()
UNIT_NAMES = {"m s-1": "m_s", "rad s-1": "rad_s", "degree": "deg"}  # units in file and field names


def export(
    result: xr.Dataset | str | Path,
    folder: str | Path,
    *,
    formats: Sequence[str] = USUAL,
    tolerance: float = TOLERANCE,
) -> list[Path]:
    """Write a result (a Dataset, or its netCDF file) to `folder`. Return the files written.

    `formats` are among: tif (<map>_<unit>.tif with a QGIS style .qml for each variable on (y, x),
    energies in kJ, nodata where no boulder passed); gpkg (rockfall.gpkg with the available layers
    of sources, stops, lines, crossings, trajectories and flights, energies in kJ, and styles); csv
    (in SI units: boulders.csv, and line_<name>.csv for each line, in single precision, values from
    1,000 with four decimals); kml and dxf (sources, stops, lines, trajectories). Parabolas are
    drawn with the `tolerance` [m]. Either all files are written or none, with a RockfallError.

    >>> import rockfall
    >>> result = rockfall.run(rockfall.read_case("case.nml"))
    >>> sorted(path.name for path in rockfall.export(result, "gis"))[0]
    'boulders.csv'
    >>> [path.name for path in rockfall.export(result, "cad", formats=["dxf"])]
    ['rockfall.dxf']
    """
    folder = Path(folder)
    chosen = Chosen(check_formats(formats, FORMATS), tolerance)
    files = [result] if isinstance(result, str | Path) else []
    with open_result(result) if isinstance(result, str | Path) else nullcontext(result) as data:
        for file in files:
            check_dimensions(data, file)
        with atomic_folder(folder, chain(files, files_behind(data))) as part:
            written = put_export(data, part, chosen, result)
            return [folder / path.name for path in written]


def put_export(
    data: xr.Dataset, folder: Path, chosen: Chosen = EXPORTED, result: object = "result"
) -> list[Path]:
    """Write the files of `export` to a new folder; `result` is used in messages. Raises a
    RockfallError for unknown formats, and if the result is incomplete or cannot be read."""
    data = flat_maps(data.set_coords({"crs"} & set(data.data_vars)))
    try:
        check_formats(chosen.formats, FORMATS)
        return list(_export(data, folder, *chosen))
    except RuntimeError as error:  # raised by netCDF4, as values are read during writing
        raise RockfallError(f"{result}: cannot be read: {error}") from error
    except KeyError as error:
        raise RockfallError(f"the result is incomplete: {error}") from error


def check_formats(formats: Sequence[str], allowed: Sequence[str]) -> list[str]:
    """Formats in the order of `allowed`; raises a RockfallError if empty or not allowed."""
    for name in formats:
        if name in GONE:
            raise RockfallError(f"--formats {name}: {GONE[name]}")
        if name not in allowed:
            raise RockfallError(f"--formats {name}: must be one of {', '.join(allowed)}")
    if not formats:
        raise RockfallError(f"--formats: must be one or more of {', '.join(allowed)}")
    return [name for name in allowed if name in formats]


def _export(
    data: xr.Dataset, folder: Path, formats: Sequence[str], tolerance: float
) -> Iterator[Path]:
    moving = _moving(data, tolerance) if {"gpkg", "kml", "dxf"} & {*formats} else None
    layers = _layers(data, moving) if "gpkg" in formats else {}
    maps = [str(name) for name, variable in data.data_vars.items() if variable.dims == PLAN]
    tables = 1 + len(line_names(data)) if data.sizes.get("boulder") else 0
    add_steps(("tif" in formats) * len(maps) + ("csv" in formats) * tables + len(layers))
    if "tif" in formats:
        for name in stepped(maps):
            yield from _put_map(folder, data, name)
    if "csv" in formats and data.sizes.get("boulder"):
        yield _write_table(folder / "boulders.csv", map(_columns, _boulders(data)))
        yield from _write_lines(folder, data)
    if layers:
        yield write_geopackage(folder / "rockfall.gpkg", layers, crs_wkt(data), STYLES)
    if "kml" in formats:
        drawn = _drawn(data, moving, "KML", *DRAWN, "flights")
        yield put_kml(folder / "rockfall.kml", drawn, data, STYLES)
    if "dxf" in formats:
        yield write_drawing(folder / "rockfall.dxf", _drawn(data, moving, "DXF", *DRAWN), STYLES)


def _drawn(data: xr.Dataset, moving: Sampled | None, what: str, *drawn: str) -> Layers:
    """Layers of a result for a drawing; refuses a result without any."""
    layers = _layers(data, moving, what)
    if not (chosen := {name: layers[name] for name in drawn if name in layers}):
        raise RockfallError(f"{what}: the result contains nothing to draw")
    return chosen


def put_kml(path: Path, layers: Layers, data: xr.Dataset, styles: Mapping[str, Style]) -> Path:
    """Write layers of a result or hazard as KML; warn if positions are not exact."""
    way = geographic(data, crs_wkt(data), "KML")
    for remark in way.remarks:
        warnings.warn(remark, stacklevel=2)
    return write_kml(path, layers, str(data.attrs.get("title") or "rockfall"), way, styles)


def _put_map(folder: Path, data: xr.Dataset, name: str) -> Iterator[Path]:
    """Write a map in its display unit (fractions unchanged), with its style."""
    variable, (unit, factor) = data[name], shown_as(data[name])
    stem, scale = _exported(name.removesuffix("_map"), variable.attrs.get("units", "1"))
    values, _ = _stored(variable)
    if values.dtype.kind == "f":
        blank, values = np.nan, values * values.dtype.type(scale)
    else:
        blank = NO_COUNT
    values = np.where(_passed(data, values), values, values.dtype.type(blank))
    attrs = {str(key): text for key, text in data.attrs.items()} | variable.attrs
    attrs |= {"variable": name}
    attrs |= {"_FillValue": blank} | ({"units": unit} if scale != 1 else {})
    path = folder / f"{stem}.tif"
    yield write_map(path, variable.copy(data=values).assign_attrs(attrs))
    yield write_classes(path, classes_of(unit), scale / factor)


def _passed(data: xr.Dataset, values: np.ndarray) -> np.ndarray:
    """Mask of cells that boulders passed, from passages or reach probability or, without these,
    from positive `values`."""
    present = [name for name in ("passages", "reach_probability") if name in data]
    return (_stored(data[present[0]])[0] if present else values) > 0


def _exported(name: str, units: str) -> tuple[str, float]:
    """Name of a map or field including its unit, and the factor to this unit; energies in kJ."""
    unit, factor = SHOWN["J"] if units == "J" else (units, 1.0)
    return name + (f"_{UNIT_NAMES.get(unit, unit)}" if unit != "1" else ""), factor


def write_map(path: Path, data: xr.DataArray) -> Path:
    """Write a plan map as GeoTIFF, with its attributes as tags."""
    stored, fill = _stored(data)
    values, grid = north_up(data, stored)
    grid = replace(grid, crs=in_plan(grid.crs) if grid.crs else None)
    tags = {
        key: str(value)
        for key, value in data.attrs.items()
        if key not in ("_FillValue", "grid_mapping")
    }
    tags["TIFFTAG_SOFTWARE"] = "rockfall"
    write_geotiff(path, values, grid, fill, **tags)
    return path


def _stored(data: xr.DataArray) -> tuple[np.ndarray, float | int | None]:
    """Stored values and their missing-data marker: NaN for reals, the fill value for integers.

    This reverses xarray's decoding of integers to reals and of seconds to durations."""
    values = seconds(data.values)
    fill = data.attrs.get("_FillValue", data.encoding.get("_FillValue"))
    if values.dtype.kind == "f" and np.dtype(data.encoding.get("dtype", "f8")).kind in "iu":
        values = np.where(np.isnan(values), fill or 0, values).astype(data.encoding["dtype"])
    if values.dtype.kind != "f":
        return values, None if fill is None else int(fill)
    if fill is not None and not np.isnan(fill):
        values = np.where(values == values.dtype.type(fill), values.dtype.type(np.nan), values)
    return values, float("nan")


def _numbers(data: xr.Dataset, dim: str) -> np.ndarray:
    """Names of lines, or boulder numbers (counted from 1 if the result has none)."""
    return data[dim].values if dim in data.coords else np.arange(1, data.sizes[dim] + 1)


def _flag_words(data: xr.DataArray) -> tuple[list[str], np.ndarray]:
    """Words of a CF flag variable, then "unknown", and for each value the index of its word."""
    stored, flags = _stored(data)[0], flags_of(data)
    which = np.full(stored.shape, len(flags))
    for k, flag in enumerate(flags.values()):
        which[stored == flag] = k
    return [*flags, "unknown"], which


def _boulders(data: xr.Dataset) -> Iterator[xr.Dataset]:
    """Yield the variables by boulder, in chunks."""
    number = _numbers(data, "boulder")
    data = data[[name for name in data.data_vars if data[name].dims == ("boulder",)]]
    for first in range(0, number.size, _ROWS):
        rows = slice(first, first + _ROWS)
        yield data.isel(boulder=rows).assign_coords(boulder=number[rows])


def _columns(data: xr.Dataset) -> dict[str, xr.DataArray]:
    """All variables with a value per boulder."""
    names = (str(name) for name in data.data_vars if data[name].dims == ("boulder",))
    return {"boulder": data["boulder"], **{name: data[name] for name in names}}


def _write_lines(folder: Path, data: xr.Dataset) -> Iterator[Path]:
    """Write a table of crossing boulders for each evaluation line."""
    if "line" in data.dims:
        for k, name in enumerate(distinct_words(line_names(data))):
            yield _write_table(folder / f"line_{name}.csv", _parts(_crossings(data, k)))


def _parts(columns: dict[str, xr.DataArray]) -> Iterator[dict[str, xr.DataArray]]:
    """Yield columns in chunks of rows, at least one chunk."""
    for first in range(0, max(1, next(iter(columns.values())).size), _ROWS):
        rows = slice(first, first + _ROWS)
        yield {name: column[rows] for name, column in columns.items()}


def _crossings(data: xr.Dataset, line: int) -> dict[str, xr.DataArray]:
    """Columns of the boulders that cross a line: x and y with `PLACES` decimals, other reals in
    single precision."""
    import xarray as xr

    columns = {}
    for name, values in columns_at(data, line).items():
        attrs = ABOUT.get(name, {})
        if name == "outcome":
            attrs = data["crossing_outcome"].attrs
        values = np.round(values, PLACES) if name in ("x", "y") else values
        if values.dtype == np.float64 and name not in ("x", "y"):
            values = values.astype("f4")
        columns[name] = xr.DataArray(values, dims="boulder", attrs=attrs)
    return columns


def _write_table(path: Path, tables: Iterable[dict[str, xr.DataArray]]) -> Path:
    """Write tables with equal columns one below the other; missing values are empty."""
    with atomic_write(path) as part, open(part, "wb") as file:
        for k, columns in enumerate(tables):
            if k == 0:
                file.write((",".join(map(_cell, columns)) + "\n").encode())
            file.write(csv_rows([*map(_column, columns.values())]))
    step()
    return path


def _column(column: xr.DataArray) -> np.ndarray:
    """Values of a table column as texts; missing values are empty."""
    values, fill = _stored(column)
    if "flag_meanings" in column.attrs:
        words, which = _flag_words(column)
        return word_column([_cell(word) for word in words], which)
    if values.dtype.kind == "f":
        return real_column(values)
    if values.dtype.kind in "iub":
        return whole_column(values, False if fill is None else values == fill)
    texts, which = np.unique(values.astype(str), return_inverse=True)
    return word_column([_cell(text) for text in texts.tolist()], which)


def _cell(text: str) -> str:
    """Text of a CSV cell, quoted where necessary."""
    csv.writer(cell := io.StringIO(), lineterminator="").writerow([spreadsheet_text(text)])
    return cell.getvalue()


def export_layers(data: xr.Dataset) -> Layers:
    """Layers of rockfall.gpkg by name, with parabolas drawn to `TOLERANCE`."""
    data = flat_maps(data.set_coords({"crs"} & set(data.data_vars)))
    return _layers(data, _moving(data, TOLERANCE))


def _moving(data: xr.Dataset, tolerance: float) -> Sampled | None:
    """Sampled trajectories, if any were recorded."""
    has_any = data.sizes.get("trajectory_vertex")
    return sampled(motion_of(data), tolerance) if has_any else None


def _layers(data: xr.Dataset, moving: Sampled | None, what: str = "GeoPackages") -> Layers:
    """Layers of a result; `what` is the product, for messages."""
    layers: Layers = {}
    has_rows = data.sizes.get("boulder", 1) > 0
    has_crossings = has_rows and "row_size" in data
    if "stop_x" in data or {"line_vertex", "trajectory_vertex"} & set(data.dims):
        need(f"{what} need" + "s" * (what != "GeoPackages"), "vector")
    if "start_x" in data and has_rows:
        sources = _source_table(data)
        layers["sources"] = "Point", [_sources(sources)]
        if are_cells(data):
            layers["source_areas"] = "MultiPolygon", [source_areas(data, sources)]
    if "stop_x" in data and has_rows:
        layers["stops"] = "Point Z", map(_stops, _boulders(data))
    if "line_vertex" in data.dims:
        layers["lines"] = "LineString", [_lines(data)]
        if "barrier_height" in data:
            layers["barriers"] = "LineString", [_barriers(data)]
    if has_crossings:
        layers["crossings"] = "Point", _crossing_points(data)
    if dams := dams_in(data):
        layers["dams"] = "LineString", [dam_lines(dams)]
    if moving is not None:
        layers["trajectories"] = "LineString ZM", [trajectory_features(data, moving)]
        if len((pieces := flight_features(moving))[0]):
            layers["flights"] = "LineString ZM", [pieces]
    return layers


def _stops(data: xr.Dataset) -> Features:
    """End points of boulders, with all their variables."""
    import shapely

    places = [_stored(data[f"stop_{axis}"])[0].astype(np.float64) for axis in "xyz"]
    points = shapely.points(*places)
    points[np.isnan(places).any(axis=0)] = None
    return points, dict(_field(*column) for column in _columns(data).items())


def _source_table(data: xr.Dataset) -> SourceTable:
    """Distinct start points with their features, numbers of boulders and maximum plan distances."""
    places = np.column_stack([_stored(data[f"start_{axis}"])[0] for axis in "xy"])
    places, first, source, boulders = np.unique(
        places, axis=0, return_index=True, return_inverse=True, return_counts=True
    )
    feature, names = np.ones(len(places), np.int64), ("",)
    if "source_feature" in data and "feature_name" in data.variables:
        feature = _stored(data["source_feature"])[0][first].astype(np.int64)
        names = tuple(map(str, data["feature_name"].values))
    furthest = None
    if "plan_distance" in data:
        furthest = np.zeros(len(places))
        np.maximum.at(furthest, source, np.nan_to_num(_stored(data["plan_distance"])[0]))
    return SourceTable(places, feature, boulders.astype(np.int64), furthest, names)


def _sources(sources: SourceTable) -> Features:
    """Start points of boulders, with the number of boulders and their maximum plan distance."""
    import shapely

    fields: dict[str, np.ndarray] = {
        "source": np.arange(1, len(sources.places) + 1),
        "boulders": sources.boulders,
    }
    if sources.furthest is not None:
        fields["plan_distance_max_m"] = sources.furthest
    return shapely.points(sources.places), fields


def _crossing_points(data: xr.Dataset) -> Iterator[Features]:
    """Yield the first crossings of lines, with all variables, in parts."""
    import shapely

    for k, name in enumerate(line_names(data)):
        for columns in _parts(_crossings(data, k)):
            points = shapely.points(columns["x"].values, columns["y"].values)
            line = {"line": np.full(points.size, name, dtype=object)}
            yield points, line | dict(_field(*column) for column in columns.items())


def _field(name: str, column: xr.DataArray) -> tuple[str, np.ndarray]:
    """Name with its unit, and the values of a column in a GeoPackage type; energies in kJ."""
    if "flag_meanings" in column.attrs:
        words, which = _flag_words(column)
        return name, np.array(words, dtype=object)[which]
    values, _ = _stored(column)
    kind = {"i": np.int64, "u": np.int64, "b": np.int64, "f": np.float64}
    name, factor = _exported(name, column.attrs.get("units", "1"))
    values = values.astype(kind.get(values.dtype.kind, object))
    return name, values if factor == 1 else values * factor


def _lines(data: xr.Dataset) -> Features:
    """Evaluation lines in plan; `line_vertex_line` is the 0-based index of the line. Other
    numbering is an internal error."""
    names, line = line_names(data), data["line_vertex_line"].values
    if not np.array_equal(np.unique(line), np.arange(len(names))):
        raise RockfallError(
            "line_vertex_line: must have every line, counted from 0", code=OUR_FAULT
        )
    shapes = _strings(line, [data[f"line_vertex_{axis}"].values for axis in "xy"])
    return shapes, {"name": np.array(names, dtype=object)}


def _barriers(data: xr.Dataset) -> Features:
    """Evaluation lines that are barriers, with height and energy capacity."""
    shapes, fields = _lines(data)
    height, capacity = (_stored(data[f"barrier_{name}"])[0] for name in ("height", "capacity"))
    chosen = ~np.isnan(height)
    fields |= {"height_m": height.astype(np.float64), "capacity_kJ": 1e-3 * capacity}
    return shapes[chosen], {name: values[chosen] for name, values in fields.items()}


def _strings(owner: np.ndarray, coordinates: list[np.ndarray]) -> np.ndarray:
    """Line string for each owner, by increasing number, from its ordered vertices.

    An owner with a single vertex (a boulder that never moved) gets a string of zero length.
    """
    import shapely

    order = np.argsort(owner, kind="stable")
    _, index, counts = np.unique(owner[order], return_inverse=True, return_counts=True)
    repeat = np.where(counts == 1, 2, 1)[index]
    vertices = np.column_stack(coordinates).astype(np.float64)[order]
    return shapely.linestrings(np.repeat(vertices, repeat, axis=0), indices=index.repeat(repeat))


def crs_wkt(data: xr.Dataset) -> str | None:
    """Well-known text of the horizontal CRS in the variable `crs`; None if there is none."""
    return data["crs"].attrs.get("crs_wkt") or None if "crs" in data.variables else None


def write_geopackage(
    path: Path, layers: Layers, crs: str | None, styles: Mapping[str, Style] | None = None
) -> Path:
    """Write layers to a GeoPackage, with any QGIS styles, atomically. Raises a RockfallError if it
    cannot be written.

    The parts of a layer go to GDAL as one stream by a temporary file, because GDAL indexes the rows
    of a second call individually, six times slower."""
    need("GeoPackages need", "vector")
    import pyogrio
    from nanoarrow.ipc import InputStream, StreamWriter

    with atomic_write(path) as named, _lockable(named) as part, warnings.catch_warnings():
        warnings.filterwarnings("ignore", "'crs' was not provided")
        try:
            counts = {layer: 0 for layer in layers}
            for layer, (kind, parts) in layers.items():
                with tempfile.TemporaryFile(dir=path.parent) as file:
                    with StreamWriter.from_writable(file) as stream:
                        for shapes, fields in parts:
                            stream.write_array(_arrow(_wkb(kind, shapes), in_milliseconds(fields)))
                            counts[layer] += len(shapes)
                    file.seek(0)
                    pyogrio.raw.write_arrow(
                        InputStream.from_readable(file), part, layer=layer, driver="GPKG",
                        geometry_type=MEASURED.get(kind, kind), geometry_name=GEOMETRY, crs=crs,
                        append=part.exists(),
                    )  # fmt: skip
                step()
            _check_arrived(part, counts)
            if styles:
                put_styles(part, {layer: kind for layer, (kind, _) in layers.items()}, styles)
        except (
            pyogrio.errors.DataSourceError,
            pyogrio.errors.DataLayerError,
            sqlite3.Error,
        ) as error:
            reason = why_unwritten(error, part.parent)
            raise RockfallError(f"{path}: cannot be written: {reason}") from error
    return path


def _wkb(kind: str, shapes: np.ndarray) -> Any:
    """Shapes of a layer as an Arrow array of WKB; points without calls of GEOS for each."""
    import nanoarrow
    import shapely

    if not kind.startswith("Point"):
        wkb = shapes if kind.endswith(" ZM") else shapely.to_wkb(shapes)
        return nanoarrow.c_array(wkb.tolist(), nanoarrow.binary())
    places = shapely.get_coordinates(shapes, include_z=kind == "Point Z")
    record = [("order", "u1"), ("kind", "<u4"), ("place", "<f8", places.shape[1])]
    wkb = np.empty(len(places), record)
    wkb["order"], wkb["kind"], wkb["place"] = 1, WKB_KINDS[kind], places
    exists = ~shapely.is_missing(shapes)
    ends = np.append(0, np.cumsum(exists) * wkb.itemsize)
    buffers = [np.packbits(exists, bitorder="little"), ends, wkb.view("u1")]
    return nanoarrow.c_array_from_buffers(nanoarrow.large_binary(), len(shapes), buffers)


def _arrow(shapes: Any, fields: Mapping[str, np.ndarray]) -> Any:
    """Features as an Arrow array, which GDAL reads in half the time of NumPy arrays; times are in
    milliseconds."""
    import nanoarrow

    columns = {GEOMETRY: shapes}
    for name, values in fields.items():
        if values.dtype.kind in "OUb":
            typed = nanoarrow.bool_() if values.dtype.kind == "b" else nanoarrow.string()
            entries = values.tolist()
            if values.dtype.kind == "O":  # attributes of any layer; only NaN differs from itself
                entries = [None if v is None or v != v else str(v) for v in entries]
            columns[name] = nanoarrow.c_array(entries, typed)
            continue
        typed = nanoarrow.timestamp("ms")
        if values.dtype.kind != "M":
            typed = getattr(nanoarrow, values.dtype.name)()
        native = np.ascontiguousarray(values, values.dtype.newbyteorder("="))
        buffers = [None, native.view("u1")]  # `c_array` refuses empty arrays
        columns[name] = nanoarrow.c_array_from_buffers(typed, values.size, buffers)
    table = nanoarrow.struct({name: column.schema for name, column in columns.items()})
    parts = columns.values()
    return nanoarrow.Array(
        nanoarrow.c_array_from_buffers(table, shapes.length, [None], children=parts)
    )


@contextmanager
def _lockable(path: Path) -> Iterator[Path]:
    """Yield the path or, if SQLite cannot lock it, a temporary file that is moved there later."""
    if has_locks(str(path.parent)):
        yield path
        return
    with tempfile.TemporaryDirectory() as folder:
        yield (place := Path(folder) / path.name)
        shutil.copyfile(place, path)


def _check_arrived(path: Path, features: Mapping[str, int]) -> None:
    """Raise a DatabaseError for a layer that lacks features, because GDAL ignores a full disk on
    closing."""
    index = "SELECT count(*) FROM sqlite_master WHERE name = ?"
    with closing(sqlite3.connect(path)) as database:
        (state,) = database.execute("PRAGMA quick_check(1)").fetchone()
        for layer, expected in features.items():
            (count,) = database.execute(f'SELECT count(*) FROM "{layer}"').fetchone()
            (indexed,) = database.execute(index, [f"rtree_{layer}_geom"]).fetchone()
            if count != expected or not indexed or state != "ok":
                raise sqlite3.DatabaseError(f"layer {layer} is incomplete")
