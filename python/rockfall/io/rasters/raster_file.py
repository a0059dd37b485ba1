# SPDX-License-Identifier: BSD-3-Clause
"""A raster file: checked on opening, and read in blocks of rows."""

from __future__ import annotations

import os
import warnings
from codecs import BOM_UTF8
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Protocol

import numpy as np

from rockfall.errors import RockfallError
from rockfall.io.coordinates.crs import crs_argument, in_plan
from rockfall.io.coordinates.projection_file import projection_crs
from rockfall.io.files import NETCDF, TIFF, start_of
from rockfall.io.foreign_files import check_foreign
from rockfall.io.gdal_files import (
    BINARY,
    IMAGINE,
    SURFER,
    TILE,
    check_imagine,
    check_nodata,
    check_vrt,
    companions,
    is_tile,
    plain_file,
)
from rockfall.io.rasters.arrays import elevation_dtype
from rockfall.io.rasters.ascii_grid import AsciiCells, is_ascii, open_ascii
from rockfall.io.rasters.grid import Box, Grid, Transform, flaw_of, row_blocks
from rockfall.io.rasters.netcdf_grid import NetcdfCells, cells_of, open_grid_file
from rockfall.limits import MACHINE_MEMORY

if TYPE_CHECKING:
    from affine import Affine
    from rasterio.crs import CRS
    from rasterio.io import DatasetReader

_CACHE = 32  # [MB] a row of tiles of a wide raster; GDAL would use 5 % of the memory
_BLOCK = 2**24  # maximum cells in a tile, or in a raster that is read at once


class Cells(Protocol):
    """Stored cells of a file, with a method that reads them."""

    @property
    def dtype(self) -> np.dtype: ...

    @property
    def packing(self) -> tuple[float, float]:
        """Scale and offset that convert stored numbers to values."""
        ...

    def rows(self, box: Box) -> Iterator[tuple[slice, np.ndarray, np.ndarray]]:
        """Yield blocks of the rows of a box: (rows in the file, stored numbers, valid mask)."""
        ...


@dataclass(frozen=True)
class GdalCells:
    """Cells of a file, read by GDAL."""

    source: DatasetReader

    @property
    def dtype(self) -> np.dtype:
        return np.dtype(self.source.dtypes[0])

    @property
    def packing(self) -> tuple[float, float]:
        return float(self.source.scales[0]), float(self.source.offsets[0])

    def rows(self, box: Box) -> Iterator[tuple[slice, np.ndarray, np.ndarray]]:
        from rasterio.windows import Window

        store = np.empty(0)  # shared by all blocks, because repeated allocation fragments the heap
        tile = self.source.block_shapes[0][0]
        start, width = box.row // tile * tile, box.shape[1]
        for rows in row_blocks((box.stop_row - start, width), tile):
            first, stop = max(start + rows.start, box.row), start + rows.stop
            window = Window(box.column, first, width, stop - first)
            if not store.size:
                store = np.empty((rows.stop - rows.start, width), self.source.dtypes[0])
            block = self.source.read(1, window=window, out=store[: window.height])
            yield slice(first, stop), block, self.source.read_masks(1, window=window) != 0


class AsciiSource:
    """Stand-in for GDAL's dataset for ESRI ASCII grids without companion files, because importing
    GDAL takes longer than reading a small grid."""

    crs, units, dtypes = None, (None,), ("float64",)

    def __init__(self, file: str, cells: AsciiCells) -> None:
        self.files, self.nodata, self.transform = [file], cells.nodata, cells.transform
        self.height, self.width = self.shape = cells.shape
        self.block_shapes = [(1, self.width)]


@dataclass(frozen=True)
class RasterFile:
    """An open raster file and its grid."""

    path: str
    source: DatasetReader | AsciiSource
    cells: Cells
    transform: Affine | Transform
    grid: Grid

    @property
    def dtype(self) -> np.dtype:
        """Type that represents the elevations of the file exactly."""
        if self._packed:
            return np.dtype(np.float64)
        return elevation_dtype(self.cells.dtype, self.path)

    @property
    def flipped(self) -> bool:
        """True if the first row of the file is the southernmost."""
        return self.transform.e > 0

    def blocks(self, box: Box | None = None) -> Iterator[tuple[slice, np.ndarray, np.ndarray]]:
        """Yield blocks north-up: (rows of the box, values, valid mask), overwritten by the next."""
        box = box or self.grid.box
        scale, offset = self.cells.packing
        for rows, block, valid in self.cells.rows(self._in_file(box)):
            if self._packed:  # unpack in double precision
                block = block.astype(np.float64) * scale + offset
            if block.dtype.kind == "f":
                valid = valid & ~np.isnan(block)
            if self.flipped:
                rows = slice(self.grid.ny - rows.stop, self.grid.ny - rows.start)
                block, valid = block[::-1], valid[::-1]
            yield slice(rows.start - box.row, rows.stop - box.row), block, valid

    def warp(self, suffix: str, options: str, factor: float = 1.0) -> str:
        """Command that resamples this file to STEM_SUFFIX.tif, with holes as nodata instead of 0.
        Values are unpacked and multiplied by `factor` afterwards, as `rio warp` does neither."""
        if self.source.nodata is None:
            dtype = np.dtype(self.source.dtypes[0])
            mark = np.iinfo(dtype).max if dtype.kind == "u" else -9999
            options += f" --src-nodata {mark} --dst-nodata {mark}"
        values = self._expression(factor)
        warped, out = self._beside(f"{suffix}_raw" if values else suffix), self._beside(suffix)
        command = f"rio warp {quote(_rio_name(self.path))} {warped} {options}"
        return (
            f"{command} && rio calc --dtype float64 {values} {warped} {out}" if values else command
        )

    def in_metres(self, plan: str | None, factor: float) -> str:
        """Command that writes STEM_utm.tif in another plan CRS, or STEM_m.tif in the same CRS, with
        elevations multiplied by a factor. The vertical CRS is dropped, because readers would
        convert again."""
        if plan is not None:
            return self.warp("utm", f"--dst-crs {plan} --resampling bilinear", factor)
        out, values = self._beside("m"), self._expression(factor)
        whole = " --not-masked" if self.source.nodata is None else ""
        command = f"rio calc --dtype float64{whole} {values} {quote(_rio_name(self.path))} {out}"
        if (crs := self.grid.crs) is None or in_plan(crs) == crs:
            return command
        return f"{command} && rio edit-info {out} --crs {quote(crs_argument(crs))}"

    def _beside(self, suffix: str) -> str:
        """Quoted name of a new file in the same folder."""
        path = Path(self.path.replace(".nc:", "_"))
        return quote(str(path.with_name(f"{path.stem}_{suffix}.tif")))

    def _expression(self, factor: float) -> str:
        """Quoted expression for `rio calc`; empty if the stored numbers are used unchanged."""
        scale, offset = (factor * number for number in self.cells.packing)
        if (scale, offset) == (1.0, 0.0):
            return ""
        product = f"(* {scale!r} (read 1))"
        return quote(f"(+ {offset!r} {product})" if offset else product)

    def flaw(self) -> str:
        """Reason why the cells cannot form a grid; "" if they can."""
        return flaw_of(self.transform, max(self.grid.shape))

    def check_cells(self) -> None:
        """Refuse cells with a flaw, and suggest the command that makes square cells."""
        if not (flaw := self.flaw()):
            return
        t = self.transform
        if t.a < 0 and not t.b:
            raise RockfallError(f"{self.path}: {flaw}")
        side = min(float(np.hypot(t.a, t.d)), float(np.hypot(t.b, t.e)))
        command = self.warp("square", f"--res {side:.10g} --resampling bilinear")
        raise RockfallError(f"{self.path}: {flaw}: resample with: {command}")

    @property
    def _packed(self) -> bool:
        return self.cells.packing != (1.0, 0.0)

    def _in_file(self, box: Box) -> Box:
        """Box in the row order of the file."""
        if not self.flipped:
            return box
        return replace(box, row=self.grid.ny - box.stop_row, stop_row=self.grid.ny - box.row)


@contextmanager
def open_raster(path: str | Path) -> Iterator[RasterFile]:
    """Open a georeferenced raster with a single band; `path` may be `file.nc:variable`.

    Errors of GDAL or netCDF during opening or reading become one-line RockfallErrors.
    """
    path = str(path)
    with ExitStack() as stack:
        try:
            raster = _opened(path, stack)
            _check_packing(raster)
            _check_size(raster)
            yield raster
        except _faults() as error:
            raise RockfallError(
                f"{path}: cannot be read as a raster (unknown format, truncated or damaged): "
                f"{error.__cause__ or error}"
            ) from error


def raster_files(path: str | Path) -> set[str]:
    """All files of a raster: the file and its companions. A file that cannot be opened is returned
    alone; its reader will report the error."""
    files = {raster_file(str(path))}
    with ExitStack() as stack:
        try:
            files |= set(filter(os.path.exists, _opened(str(path), stack).source.files))
        except RockfallError:
            pass
        except _faults():  # evaluated only on an error, because it imports GDAL
            pass
    return files


def _faults() -> tuple[type[Exception], ...]:
    """Exceptions of GDAL and netCDF for unreadable files; evaluated on demand."""
    from rasterio.errors import RasterioError

    return RasterioError, OSError, RuntimeError, UnicodeDecodeError


def raster_file(path: str) -> str:
    """File of a raster, which may be a variable of a netCDF file: `file.nc:variable`."""
    return path.rpartition(":")[0] if ".nc:" in path and not os.path.exists(path) else path


def _opened(path: str, stack: ExitStack) -> RasterFile:
    """Open a raster according to its format; `stack` closes its resources. Refuses unsupported
    formats."""
    file = raster_file(path)
    variable = path[len(file) + 1 :]
    name = plain_file(file)
    start = start_of(file)
    if start.startswith(NETCDF):
        data = stack.enter_context(open_grid_file(file))
        name = f'NETCDF:"{name}":{variable}' if variable else name
        source = _dataset(path, name, ("netCDF",), stack)
        variable = variable or source.tags(1).get("NETCDF_VARNAME", "")
        return _raster(path, source, cells_of(path, data, variable, source.transform))
    if variable:
        raise RockfallError(f"{path}: {file} is not a netCDF file")
    if is_ascii(start):
        cells = open_ascii(file)
        beside = companions(Path(file))
        if beside and start.startswith(BOM_UTF8):  # GDAL would misidentify the format
            beside = [other for other in beside if other.suffix.lower() in (".prj", ".xml")]
            if beside:
                raise RockfallError(
                    f"{path}: begins with a byte-order mark, so that {beside[0].name} cannot be "
                    "read: save it as UTF-8 without this mark"
                )
        if not beside:
            return _raster(path, AsciiSource(file, cells), cells)
        source = _dataset(path, name, ("AAIGrid",), stack)
        return _raster(path, source, cells, source.crs or projection_crs(file))
    if start.startswith(TIFF):
        check_nodata(file)
    if start.startswith(IMAGINE):
        check_imagine(file)
    check_vrt(file, start)
    drivers = (*BINARY, *TILE) if is_tile(file) else BINARY
    if not (is_tile(file) or start.startswith((*TIFF, IMAGINE, *SURFER))):
        check_foreign(file, start)
    source = _dataset(path, name, drivers, stack)
    return _raster(path, source, GdalCells(source))


def _dataset(path: str, name: str, drivers: tuple[str, ...], stack: ExitStack) -> DatasetReader:
    """Open a georeferenced single-band file with one of these GDAL drivers."""
    import rasterio
    from rasterio.io import DatasetReader

    stack.enter_context(rasterio.Env(GDAL_CACHEMAX=_CACHE))  # suppresses GDAL's messages
    stack.enter_context(warnings.catch_warnings())
    warnings.simplefilter("ignore", rasterio.errors.NotGeoreferencedWarning)
    source = stack.enter_context(DatasetReader(name, driver=list(drivers)))
    _check_band(path, source)
    _check_place(path, source)
    return source


def _raster(
    path: str, source: DatasetReader | AsciiSource, cells: Cells, crs: CRS | None = None
) -> RasterFile:
    t = cells.transform if isinstance(cells, (AsciiCells, NetcdfCells)) else source.transform
    if (source.height, source.width) != getattr(cells, "shape", source.shape):
        raise RockfallError(f"{path}: malformed header (GDAL reads different values)")
    north = t.f if t.e < 0 else t.f + source.height * t.e
    grid = Grid(t.c, north, t.a, source.width, source.height, crs or source.crs, path)
    return RasterFile(path, source, cells, t, grid)


def _rio_name(path: str) -> str:
    """Name with which rio opens a file or netCDF variable."""
    file = raster_file(path)
    return f'NETCDF:"{file}":{path[len(file) + 1 :]}' if file != path else file


def _check_band(path: str, source: DatasetReader) -> None:
    if source.count == 0 and source.subdatasets:
        names = (f"{path}:{name.rpartition(':')[2]}" for name in source.subdatasets)
        raise RockfallError(f"{path}: has several rasters: choose one of {', '.join(names)}")
    if source.count != 1:
        raise RockfallError(f"{path}: has {source.count} bands: must have exactly one")
    if np.dtype(source.dtypes[0]).kind not in "iuf":
        raise RockfallError(f"{path}: contains {source.dtypes[0]}: must be real numbers")


def _check_place(path: str, source: DatasetReader) -> None:
    """Refuse a raster without a position."""
    if not source.transform.is_identity:
        return
    if source.driver != "netCDF":
        raise RockfallError(f"{path}: is not georeferenced")
    raise RockfallError(
        f"{path}: its coordinates are not identified: give x the attribute axis = 'X' and y the "
        "attribute axis = 'Y'"
    )


def _check_packing(raster: RasterFile) -> None:
    scale, offset = raster.cells.packing
    if not (np.isfinite([scale, offset]).all() and scale):
        raise RockfallError(
            f"{raster.path}: scale {scale:g}, offset {offset:g}: must be finite, the scale not 0"
        )


def _check_size(raster: RasterFile) -> None:
    """Refuse a file whose header implies more cells than fit in memory, or oversized tiles."""
    ny, nx = raster.grid.shape
    need = 4e-9 * nx * ny
    have = 1e-9 * MACHINE_MEMORY
    if need > have:
        raise RockfallError(
            f"{raster.path}: {nx} x {ny} cells need {need:.0f} GB of memory, "
            f"this machine has {have:.0f} GB"
        )
    rows, columns = raster.source.block_shapes[0]
    if rows * columns > max(nx * ny, _BLOCK):
        raise RockfallError(
            f"{raster.path}: tiles of {columns} x {rows} cells do not fit a raster of {nx} x {ny}: "
            "damaged"
        )
