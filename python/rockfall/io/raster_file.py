# SPDX-License-Identifier: BSD-3-Clause
"""One raster file: checked when it is opened, read in blocks of rows."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Protocol

import numpy as np

from rockfall.errors import RockfallError
from rockfall.io.arrays import elevation_dtype
from rockfall.io.ascii_grid import AsciiCells, is_ascii, open_ascii
from rockfall.io.files import NETCDF, TIFF
from rockfall.io.gdal_files import (
    BINARY,
    IMAGINE,
    check_imagine,
    check_nodata,
    companions,
    is_vrt,
    plain_file,
    plain_vrt,
    start_of,
)
from rockfall.io.grid import Box, Grid, Transform, flaw_of, row_blocks
from rockfall.io.netcdf_grid import cells_of, open_netcdf
from rockfall.limits import MACHINE_MEMORY

if TYPE_CHECKING:
    from affine import Affine
    from rasterio.io import DatasetReader

_CACHE = 32  # MB, a row of tiles of a wide raster; GDAL would take 5 % of the machine
_BLOCK = 2**24  # cells of a tile, or else as many as the raster has


class Cells(Protocol):
    """What is stored in a file, and how it is read."""

    @property
    def dtype(self) -> np.dtype: ...

    @property
    def packing(self) -> tuple[float, float]:
        """Scale and offset, by which stored numbers become values."""
        ...

    def rows(self, box: Box) -> Iterator[tuple[slice, np.ndarray, np.ndarray]]:
        """Blocks of the rows of a box: (rows in the file, stored numbers, where they are data)."""
        ...


@dataclass(frozen=True)
class GdalCells:
    """The cells of a file as GDAL reads them."""

    source: DatasetReader

    @property
    def dtype(self) -> np.dtype:
        return np.dtype(self.source.dtypes[0])

    @property
    def packing(self) -> tuple[float, float]:
        return float(self.source.scales[0]), float(self.source.offsets[0])

    def rows(self, box: Box) -> Iterator[tuple[slice, np.ndarray, np.ndarray]]:
        from rasterio.windows import Window

        store = np.empty(0)  # one for all blocks: the heap keeps what comes and goes
        tile = self.source.block_shapes[0][0]
        start, width = box.row // tile * tile, box.shape[1]
        for rows in row_blocks((box.stop_row - start, width), tile):
            first, stop = max(start + rows.start, box.row), start + rows.stop
            window = Window(box.column, first, width, stop - first)
            if not store.size:
                store = np.empty((rows.stop - rows.start, width), self.source.dtypes[0])
            block = self.source.read(1, window=window, out=store[: window.height])
            yield slice(first, stop), block, self.source.read_masks(1, window=window) != 0


class Alone:
    """What GDAL says of an ESRI ASCII grid with no file beside it, by its names. It is not asked:
    to import it takes longer than to read a small grid."""

    crs, units, dtypes = None, (None,), ("float64",)

    def __init__(self, file: str, cells: AsciiCells) -> None:
        self.files, self.nodata, self.transform = [file], cells.nodata, cells.transform
        self.height, self.width = self.shape = cells.shape
        self.block_shapes = [(1, self.width)]


@dataclass(frozen=True)
class RasterFile:
    """An open raster file, and where its cells lie."""

    path: str
    source: DatasetReader | Alone
    cells: Cells
    transform: Affine | Transform
    grid: Grid

    @property
    def dtype(self) -> np.dtype:
        """The type that holds the elevations of the file as they are."""
        if self._packed:
            return np.dtype(np.float64)
        return elevation_dtype(self.cells.dtype, self.path)

    @property
    def flipped(self) -> bool:
        """Whether the first row of the file is the southernmost."""
        return self.transform.e > 0

    def blocks(self, box: Box | None = None) -> Iterator[tuple[slice, np.ndarray, np.ndarray]]:
        """(rows in memory, values, where they are data), north-up; good until the next one. Of a
        box, its rows count from 0."""
        box = box or self.grid.box
        scale, offset = self.cells.packing
        for rows, block, valid in self.cells.rows(self._in_file(box)):
            if self._packed:  # in double precision
                block = block.astype(np.float64) * scale + offset
            if block.dtype.kind == "f":
                valid = valid & ~np.isnan(block)
            if self.flipped:
                rows = slice(self.grid.ny - rows.stop, self.grid.ny - rows.start)
                block, valid = block[::-1], valid[::-1]
            yield slice(rows.start - box.row, rows.stop - box.row), block, valid

    def warp(self, suffix: str, options: str) -> str:
        """The command that resamples this file into dem_suffix.tif; holes become nodata, not 0."""
        if self.source.nodata is None:
            dtype = np.dtype(self.source.dtypes[0])
            mark = np.iinfo(dtype).max if dtype.kind == "u" else -9999
            options += f" --src-nodata {mark} --dst-nodata {mark}"
        path = Path(self.path.replace(".nc:", "_"))
        out = path.with_name(f"{path.stem}_{suffix}.tif")
        return f"rio warp {quote(_rio_name(self.path))} {quote(str(out))} {options}"

    def flaw(self) -> str:
        """Why its cells cannot be those of a grid; empty when they can."""
        return flaw_of(self.transform, max(self.grid.shape))

    def check_cells(self) -> None:
        """Refuse cells with a flaw; offer the command that makes square ones."""
        if not (flaw := self.flaw()):
            return
        t = self.transform
        if t.a < 0 and not t.b:
            raise RockfallError(f"{self.path}: {flaw}")
        side = min(float(np.hypot(t.a, t.d)), float(np.hypot(t.b, t.e)))
        command = self.warp("square", f"--res {side:.10g} --resampling bilinear")
        raise RockfallError(f"{self.path}: {flaw}; resample with: {command}")

    @property
    def _packed(self) -> bool:
        return self.cells.packing != (1.0, 0.0)

    def _in_file(self, box: Box) -> Box:
        """The box as the rows of the file count."""
        if not self.flipped:
            return box
        return replace(box, row=self.grid.ny - box.stop_row, stop_row=self.grid.ny - box.row)


@contextmanager
def open_raster(path: str | Path) -> Iterator[RasterFile]:
    """Open a raster of one band that says where it lies; `path` may be `file.nc:variable`.

    Whatever GDAL or netCDF have to say against it, now or while it is read, comes as one line.
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
    """Every file that a raster is read from: its own, those beside it, the tiles of a mosaic. What
    cannot be opened has its own alone; who reads it says what is wrong."""
    found, waiting = set(), {raster_file(str(path))}
    while waiting:
        found.add(file := waiting.pop())
        try:
            with ExitStack() as stack:
                files = _opened(file, stack).source.files  # a tile has files beside it, too
                waiting |= set(filter(os.path.exists, files)) - found
        except _faults(RockfallError):
            pass
    return found


def _faults(*others: type[Exception]) -> tuple[type[Exception], ...]:
    """What GDAL and netCDF raise of a file that they cannot read; looked up when something is."""
    from rasterio.errors import RasterioError

    return RasterioError, OSError, RuntimeError, UnicodeDecodeError, *others


def raster_file(path: str) -> str:
    """The file of a raster, which may be one variable of a netCDF file: `file.nc:variable`."""
    return path.rpartition(":")[0] if ".nc:" in path and not os.path.exists(path) else path


def _opened(path: str, stack: ExitStack) -> RasterFile:
    """The file by its format; what was opened for it is closed with the stack."""
    file = raster_file(path)
    variable = path[len(file) + 1 :]
    name = plain_file(file)
    start = start_of(file)
    if start.startswith(NETCDF):
        data = stack.enter_context(open_netcdf(file))
        name = f'NETCDF:"{name}":{variable}' if variable else name
        source = _dataset(path, name, ("netCDF",), stack)
        variable = variable or source.tags(1).get("NETCDF_VARNAME", "")
        return _raster(path, source, cells_of(path, data, variable, source.transform))
    if variable:
        raise RockfallError(f"{path}: {file} is not a netCDF file")
    if is_ascii(start):
        cells = open_ascii(file)
        if not companions(Path(file)):
            return _raster(path, Alone(file, cells), cells)
        return _raster(path, _dataset(path, name, ("AAIGrid",), stack), cells)
    if start.startswith(TIFF):
        check_nodata(file)
    if start.startswith(IMAGINE):
        check_imagine(file)
    if is_vrt(start):
        source = _dataset(path, plain_vrt(file), ("VRT",), stack)
    else:
        source = _dataset(path, name, BINARY, stack)
    return _raster(path, source, GdalCells(source))


def _dataset(path: str, name: str, drivers: tuple[str, ...], stack: ExitStack) -> DatasetReader:
    """What GDAL opens by one of some drivers; one band that lies somewhere."""
    import rasterio
    from rasterio.io import DatasetReader

    stack.enter_context(rasterio.Env(GDAL_CACHEMAX=_CACHE))  # what GDAL says goes nowhere
    stack.enter_context(warnings.catch_warnings())
    warnings.simplefilter("ignore", rasterio.errors.NotGeoreferencedWarning)
    source = stack.enter_context(DatasetReader(name, driver=list(drivers)))
    _check_band(path, source)
    _check_place(path, source)
    return source


def _raster(path: str, source: DatasetReader | Alone, cells: Cells) -> RasterFile:
    t = cells.transform if isinstance(cells, AsciiCells) else source.transform
    if (source.height, source.width) != getattr(cells, "shape", source.shape):
        raise RockfallError(f"{path}: GDAL reads another header: malformed")
    north = t.f if t.e < 0 else t.f + source.height * t.e
    grid = Grid(t.c, north, t.a, source.width, source.height, source.crs, path)
    return RasterFile(path, source, cells, t, grid)


def _rio_name(path: str) -> str:
    """The name by which rio opens a file, or one variable of a netCDF file."""
    file = raster_file(path)
    return f'NETCDF:"{file}":{path[len(file) + 1 :]}' if file != path else file


def _check_band(path: str, source: DatasetReader) -> None:
    if source.count == 0 and source.subdatasets:
        names = (f"{path}:{name.rpartition(':')[2]}" for name in source.subdatasets)
        raise RockfallError(f"{path}: has several rasters, take one of: {', '.join(names)}")
    if source.count != 1:
        raise RockfallError(f"{path}: has {source.count} bands, exactly one is needed")
    if np.dtype(source.dtypes[0]).kind not in "iuf":
        raise RockfallError(f"{path}: holds {source.dtypes[0]}, real numbers are needed")


def _check_place(path: str, source: DatasetReader) -> None:
    """Refuse a raster that lies nowhere."""
    if not source.transform.is_identity:
        return
    if source.driver != "netCDF":
        raise RockfallError(f"{path}: does not say where it lies (no georeference)")
    raise RockfallError(
        f"{path}: its coordinates are not marked as such: give x the attribute axis = 'X' and "
        "y the attribute axis = 'Y'"
    )


def _check_packing(raster: RasterFile) -> None:
    scale, offset = raster.cells.packing
    if not (np.isfinite([scale, offset]).all() and scale):
        raise RockfallError(
            f"{raster.path}: scale {scale:g}, offset {offset:g}: must be finite, the scale not 0"
        )


def _check_size(raster: RasterFile) -> None:
    """Refuse a header that promises more than the machine can hold."""
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
            f"{raster.path}: tiles of {columns} x {rows} cells, of a raster of {nx} x {ny}: damaged"
        )
