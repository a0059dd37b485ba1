# SPDX-License-Identifier: BSD-3-Clause
"""Results of runs as an xarray.Dataset and a CF netCDF file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rockfall.case.files import files_behind
from rockfall.errors import RockfallError
from rockfall.io.atomic import atomic_write
from rockfall.io.coordinates.crs import grid_mapping
from rockfall.io.input_warnings import stored_warnings
from rockfall.io.netcdf import CACHE, open_dataset, open_netcdf
from rockfall.io.output_files import check_result_path, why_unwritten
from rockfall.io.rasters.grid import row_blocks
from rockfall.kernel_rules import PIECE
from rockfall.result.crossings import without_absent
from rockfall.result.stored_crossings import crossings_in_file
from rockfall.result.validate import TEXTS, check_result, check_values

if TYPE_CHECKING:
    import xarray as xr

    from rockfall.io.rasters.grid import Grid
    from rockfall.result.contents import Held, HeldVariable

CONVENTIONS = "CF-1.11"
NO_COUNT = -1  # fill value of counts
#: Exceptions of netCDF4 and xarray on a damaged file.
DAMAGED = (
    OSError, ValueError, TypeError, LookupError, RuntimeError, AttributeError, OverflowError,
)  # fmt: skip
CHUNK = 32_768  # crossings per chunk
SAMPLES = {"sample_entry": 2048, "sample_line": 1}  # rows of samples in a chunk
TILE = 256  # width of a compressed tile [cells]


def centre_variables(x: np.ndarray, y: np.ndarray) -> dict[str, tuple]:
    """Cell-centre coordinates as CF variables."""
    words = (("x", x, "easting"), ("y", y, "northing"))
    return {
        axis: (axis, centres, {
            "units": "m", "long_name": f"{word} of cell centres",
            "standard_name": f"projection_{axis}_coordinate", "axis": axis.upper(),
        })
        for axis, centres, word in words
    }  # fmt: skip


def georeference(grid: Grid) -> dict[str, Any]:
    """Attributes that georeference a grid (CF, and GDAL's GeoTransform)."""
    transform = f"{grid.west!r} {grid.cell!r} 0.0 {grid.north!r} 0.0 {-grid.cell!r}"
    attrs = {"units": "1", "long_name": "coordinate reference system", "GeoTransform": transform}
    return attrs | (grid_mapping(grid.crs) if grid.crs else {})


def provenance(scene: Any) -> dict[str, str]:
    """Attributes for a scene: checksums and warnings of its inputs, stretches of lines off the
    terrain, dams, and stands."""
    return {
        "impact_set_checksum": scene.checksums.get("sets", ""),
        "input_checksums": json.dumps(scene.checksums, sort_keys=True),
        "decoded_checksums": json.dumps(scene.decoded, sort_keys=True),
        "input_warnings": stored_warnings(scene.warnings or []),
        "lines_beyond": json.dumps(scene.beyond),
        "dams": json.dumps([dam.rounded() for dam in scene.dams]),
        **({"stands": json.dumps(scene.stands)} if scene.stands else {}),
    }


def feature_names(scene: Any) -> dict[str, str]:
    """Attribute with the feature names of the source layer, one per line; {} without a layer."""
    return {"source_features": "\n".join(scene.features.names)} if scene.features else {}


def open_result(path: str | Path) -> xr.Dataset:
    """Open a netCDF result without decoding: counts stay integers, times stay seconds. Raises a
    RockfallError for a folder, a file that cannot be opened as netCDF, or a part of a run."""
    if Path(path).is_dir():
        names = ", ".join(sorted(each.name for each in Path(path).glob("*.nc"))[:5])
        raise RockfallError(f"{path}: is a folder: give one of its files, {names or 'OUT.nc'}")
    try:
        data = open_dataset(path, mask_and_scale=False, decode_times=False)
    except RockfallError:
        raise
    except FileNotFoundError:
        raise RockfallError(f"{path}: no such file") from None
    except DAMAGED as error:
        raise RockfallError(f"{path}: is not a netCDF result: {error}") from error
    if "part_layout" in data.attrs:
        data.close()
        raise RockfallError(
            f"{path}: is a part of a run: convert it to a result with `rockfall merge`"
        )
    return data


def read_result(path: str | Path) -> xr.Dataset:
    """Read the result of a run from its netCDF file, in the form that `rockfall.run` returns. More
    than a million line crossings stay in the file and are read on demand until the result is
    closed. Raises a RockfallError for a file that cannot be read, or is not a valid result.

    >>> import rockfall
    >>> rockfall.write_result(rockfall.run(rockfall.read_case("case.nml")), "result.nc")
    >>> rockfall.read_result("result.nc").sizes["boulder"]
    20
    """
    data = open_result(path)
    stored: dict[str, xr.Variable] = {}
    try:
        check_result(data, path)
        try:
            in_file = crossings_in_file(data, path)
            result = data.drop_vars([*in_file]).load()
        except DAMAGED as error:
            raise RockfallError(f"{path}: cannot be read: {error}") from error
        check_values(result, path)
        stored = in_file
    finally:
        if not stored:
            data.close()
    for name in TEXTS:
        if name in result.variables:
            result[name] = result[name].astype(str).astype(object)
    result = result.assign(stored)
    if stored:
        result.set_close(data.close)
    for variable in result.variables.values():
        variable.attrs.pop("_FillValue", None)
    return result


#: Attribute of results in memory; not written, because the other data of a result determine it.
MODEL_WARNINGS = "model_warnings"


def write_result(result: Held, path: str | Path) -> None:
    """Write a result as netCDF, atomically, and never over an input of its case.

    >>> import rockfall
    >>> rockfall.write_result(rockfall.run(rockfall.read_case("case.nml")), "other.nc")
    """
    check_result_path(path, files_behind(result), tries=False)
    with atomic_write(path) as part:
        put_netcdf(without_absent(result), part, path)


def put_netcdf(data: Held, path: str | Path, name: str | Path) -> None:
    """Write data to a new file, never through a link; `name` is used in messages. netCDF4 is used
    directly, because xarray would copy whole maps and load Dask, if installed. Raises a
    RockfallError if the file cannot be written."""
    try:
        with open_netcdf(path, "x") as file:
            file.setncatts({key: data.attrs[key] for key in data.attrs if key != MODEL_WARNINGS})
            for dim, size in data.sizes.items():
                file.createDimension(str(dim), size)
            for stored in map(str, data.variables):
                variable = data.variables[stored]
                how = _storage(variable, {"part_layout", "scene_layout"} & data.attrs.keys())
                _write_variable(file, stored, variable, how, _attached(data, stored))
    except (RuntimeError, PermissionError) as error:  # errors of netCDF4 for a failed write
        reason = why_unwritten(error, Path(path).parent)
        raise RockfallError(f"{name}: cannot be written: {reason}") from error


def _attached(result: Held, name: str) -> dict[str, Any]:
    """Attributes of a variable that exist only in files: missing value and auxiliary coordinates
    (CF). Coordinates and texts have no missing values."""
    variable = result.variables[name]
    if name in result.coords:
        return {}
    beside = [  # without DataArrays, which take longer than writing
        other for other in map(str, result.coords)
        if other not in result.sizes and {*result.variables[other].dims} <= {*variable.dims}
    ]  # fmt: skip
    attrs: dict[str, Any] = {"coordinates": " ".join(beside)} if beside else {}
    if name.endswith("_bounds"):  # CF: bounds inherit attributes
        return attrs
    if variable.dtype.kind == "f":
        attrs["_FillValue"] = np.nan
    elif variable.dtype.kind == "i":
        attrs["_FillValue"] = variable.dtype.type(NO_COUNT)
    return attrs


def _storage(variable: HeldVariable, checksums: Any) -> dict[str, Any]:
    """Storage options of a variable: rasters are compressed in tiles; data needed to resume runs
    have checksums (Fletcher, by HDF5)."""
    how: dict[str, Any] = {}
    if variable.dims[-2:] == ("y", "x"):
        tile = [1] * (variable.ndim - 2) + [min(TILE, size) for size in variable.shape[-2:]]
        how = {"chunksizes": tile, "zlib": True, "complevel": 1, "shuffle": True}
    if not checksums and variable.dims == ("crossing",) and variable.shape[0]:
        # With default chunks, reading a line would read most of a variable. Compression would
        # reduce reals by a quarter, but would dominate the writing time.
        how = {"chunksizes": [min(variable.shape[0], CHUNK)], "chunk_cache": CACHE}
        if variable.dtype.kind == "i":
            how |= {"zlib": True, "complevel": 1, "shuffle": True}
    if not checksums and variable.ndim and (rows := SAMPLES.get(str(variable.dims[0]))):
        sizes = [min(rows, variable.shape[0]), *variable.shape[1:]]
        how = {"chunksizes": [max(1, size) for size in sizes], "chunk_cache": CACHE}
        how |= {"zlib": True, "complevel": 1, "shuffle": True}
    if not checksums or not variable.ndim:
        return how
    room, pieces = PIECE, []
    for size in variable.shape[::-1]:
        pieces.append(max(1, min(size, room)))
        room //= pieces[-1]
    return {"chunksizes": pieces[::-1], "fletcher32": True, "chunk_cache": CACHE} | how


def _write_variable(
    file: Any, name: str, variable: HeldVariable, how: dict[str, Any], attached: dict[str, Any]
) -> None:
    """Write a variable; rasters in blocks of rows."""
    text, is_map = variable.dtype.kind in "OU", variable.dims == ("y", "x")
    how |= {"fill_value": attached.pop("_FillValue", None)}
    stored = file.createVariable(name, str if text else variable.dtype, variable.dims, **how)
    stored.setncatts(variable.attrs | attached)
    stored.set_auto_maskandscale(False)
    if pieces := getattr(getattr(variable, "held", None), "pieces", None):
        first = 0
        for piece in pieces():
            stored[first : first + piece.size] = piece
            first += piece.size
        return
    values = variable.values.astype(object) if text else variable.values
    for rows in row_blocks(values.shape, TILE) if is_map else [...]:
        stored[rows] = values[rows]
