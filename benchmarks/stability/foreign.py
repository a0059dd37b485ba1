# SPDX-License-Identifier: BSD-3-Clause
"""Foreign files and strict readers: invalid files are refused, valid files give the correct values.

Each file is made from a description that determines, independently of any reader, whether the file
must be accepted, and with which values. `spoil` breaks one rule of a format.
"""

from __future__ import annotations

import argparse
import faulthandler
import json
import math
import os
import shutil
import sqlite3
import sys
import tempfile
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import pyogrio
import rasterio
import shapely
from affine import Affine
from rasterio.io import DatasetWriter

from benchmarks.machine import machine
from rockfall.errors import RockfallError
from rockfall.io.rasters.dem import read_dem
from rockfall.io.rasters.grid import NO_ID, Grid
from rockfall.io.vectors.layers import burn_polygons

LONGEST = 60.0  # maximum seconds per file
UTM = "EPSG:32632"
WORDS = (  # texts that are not numbers
    "abc", "600'000", "1.000,0", "1,5", "", "1 2", "0x10", "1e", "--5", "1d3", "1_000", "\u0663",
    "none", "5m", "1e999", "+", ".", "1.2.3", "inf", "-Infinity",
)  # fmt: skip
FOREIGN_UNITS = (
    "km", "ft", "feet", "foot", "US survey foot", "us-ft", "ftUS", "cm", "mm", "dm", "fathom", "yd",
    "degrees", "degrees_east", "rad", "mi", "inch", "1", "hm", "Pa", "meter above sea",
)  # fmt: skip
METRES = (None, "m", "metre", "Meter", "metres", "meters")


@dataclass
class Made:
    """File, its expected contents (None: it must be refused), and the function that reads them."""

    path: Path
    about: str
    want: Any = None
    how: Callable[[Path], Any] = field(default=lambda path: _dem(path))


def _dem(path: Path) -> tuple[np.ndarray, tuple[float, float, float]]:
    z, grid = read_dem(path)
    return z, (grid.west, grid.north, grid.cell)


def pick(random: np.random.Generator, several: Any) -> Any:
    return several[int(random.integers(len(several)))]


def elevations(random: np.random.Generator) -> np.ndarray:
    """Elevations with few digits, which never equal a nodata mark."""
    ny, nx = random.integers(2, 7, 2)
    return np.round(random.uniform(-400, 4000, (ny, nx)), int(random.integers(0, 4)))


# ---- ESRI ASCII ----------------------------------------------------------------------------------


def ascii_header(random: np.random.Generator, folder: Path) -> Made:
    """ESRI ASCII grid with a header in one of the valid forms, or with one fault."""
    z, path = elevations(random), folder / "dem.asc"
    ny, nx = z.shape
    west, south = (float(np.round(random.uniform(-1e6, 6e6), 3)) for _ in range(2))
    cell = float(pick(random, (0.25, 0.5, 1, 2, 2.5, 5, 10, 12.5, 4.997688906601)))
    centre, split = random.random() < 0.3, random.random() < 0.2
    nodata = pick(random, (None, -9999.0, -1.0, 0.1, math.nan, -3.4e38))
    place = "center" if centre else "corner"
    shift = 0.5 * cell if centre else 0.0
    rows = [["ncols", str(nx)], ["nrows", str(ny)]]
    rows += [[f"xll{place}", _spelled(random, west)], [f"yll{place}", _spelled(random, south)]]
    size = _spelled(random, cell)
    rows += [["dx", size], ["dy", size]] if split else [["cellsize", size]]
    if nodata is not None:
        rows.append(["NODATA_value", "NaN" if nodata != nodata else _spelled(random, nodata)])
    if random.random() < 0.3:  # shuffle all rows but the first: GDAL rejects a leading nodata key
        rows[1:] = [rows[k] for k in 1 + random.permutation(len(rows) - 1)]
    mark = -9999.0 if nodata is None else nodata
    z[int(random.integers(ny)), int(random.integers(nx))] = mark
    about = ""
    if random.random() < 0.6:
        about = _spoil_header(random, rows, centre, split, (nx, ny))
    end, gap = pick(random, ("\n", "\r\n")), pick(random, (" ", "\t", "    "))
    style = pick(random, (str, str.upper, str.lower, str.title))
    text = "".join(f"{style(key)}{gap}{value}{end}" for key, value in rows)
    text += end.join(" ".join(map(repr, row.tolist())) for row in z)
    path.write_bytes(text.encode())
    z = np.where(z == mark, np.nan, z)
    want = None if about or np.isnan(z).all() else (
        z, (west - shift, south - shift + ny * cell, cell)
    )  # fmt: skip
    return Made(path, about or "sound", want)


def _spelled(random: np.random.Generator, value: float) -> str:
    """Number in one of the usual formats."""
    texts = [repr(value), f"{value:.17g}", f"{value:.17e}", f"{value:.17E}"]
    texts += [f"+{value!r}"] if value > 0 else []
    texts += [str(int(value)), f"{int(value)}."] if value == int(value) and abs(value) < 1e9 else []
    return pick(random, texts)


def _spoil_header(
    random: np.random.Generator, rows: list, centre: bool, split: bool, shape: tuple[int, int]
) -> str:
    """Introduce a fault, and return its description."""
    k = int(random.integers(len(rows)))
    key = rows[k][0]
    fault = pick(random, ("word", "word", "word", "twice", "missing", "mixed", "size", "both",
                          "unknown", "value", "integer"))  # fmt: skip
    if fault == "word":
        rows[k][1] = pick(random, WORDS)
    elif fault == "twice":
        rows.insert(int(random.integers(len(rows) + 1)), list(rows[k]))
    elif fault == "missing":
        if key == "NODATA_value":
            key = rows[0][0] if rows[0][0] != "NODATA_value" else rows[1][0]
        rows[:] = [row for row in rows if row[0] != key]
    elif fault == "mixed":
        of = pick(random, ("x", "y"))
        for row in rows:
            if row[0].startswith(f"{of}ll"):
                row[0] = f"{of}ll{'corner' if centre else 'center'}"
    elif fault == "size":
        which = "dx" if split else "cellsize"
        for row in rows:
            if row[0] == which:
                row[1] = pick(random, ("0", "-5", "1e13", "nan"))
    elif fault == "both":
        rows.append(pick(random, (["cellsize", "5"], ["dx", "5"], ["dy", "5"],
                                  ["xllcorner", "0"], ["yllcenter", "0"])))  # fmt: skip
    elif fault == "unknown":
        rows.append(pick(random, (["nbands", "1"], ["xll", "3"], ["cell size", "5"], ["#", "a"])))
    elif fault == "value":
        rows[k][1] += pick(random, (" 1", " m", ";", "'", "\u00a0m", ","))
    else:
        key = pick(random, ("ncols", "nrows"))
        n = shape[0] if key == "ncols" else shape[1]
        for row in rows:
            if row[0] == key:
                row[1] = pick(random, ("0", "-3", f"{n}.0", f"{n}e0", "2147483648", f"{n + 1}"))
    return f"{fault} {key}"


# ---- netCDF --------------------------------------------------------------------------------------


def netcdf_attributes(random: np.random.Generator, folder: Path) -> Made:
    """netCDF grid with valid nodata marks, ranges, packing and units, or with one fault."""
    path = folder / "dem.nc"
    stored = np.dtype(pick(random, "i1 u1 i2 u2 i4 u4 f4 f8".split()))
    z = elevations(random)
    limit = 120 if stored.itemsize == 1 else 30_000
    raw = random.integers(1 if stored.kind == "u" else -limit, limit, z.shape).astype(stored)
    if stored.kind == "f":
        raw = z.astype(stored)
    about: dict[str, Any] = {}
    unsigned = stored.kind == "i" and random.random() < 0.25
    if unsigned:
        about["_Unsigned"] = pick(random, ("true", "True"))
    elif stored.kind in "iu" and random.random() < 0.1:
        about["_Unsigned"] = "true" if stored.kind == "u" else "false"
    meaning = np.dtype(f"u{stored.itemsize}") if unsigned else stored
    if random.random() < 0.4:
        kind = pick(random, ("f4", "f8"))
        about["scale_factor"] = np.dtype(kind).type(pick(random, (0.1, 0.01, 2.0, 1.0, -0.5)))
        if random.random() < 0.7:
            about["add_offset"] = np.dtype(kind).type(pick(random, (0.0, 100.0, -3.3)))
    fill = raw.flat[int(random.integers(raw.size))] if random.random() < 0.5 else None
    if random.random() < 0.4:
        several = raw.flat[random.integers(raw.size, size=int(random.integers(1, 4)))]
        about["missing_value"] = several if len(several) > 1 else several[0]
    least, greatest = np.sort(raw.view(meaning).ravel())[[1, -2]].view(stored)
    ranged = pick(random, ("", "", "min", "max", "range", "both"))
    if ranged in ("min", "both"):
        about["valid_min"] = least
    if ranged in ("max", "both"):
        about["valid_max"] = greatest
    if ranged == "range":
        about["valid_range"] = np.array([least, greatest], stored)
    units = [pick(random, METRES) for _ in range(3)]  # units of x, y, z
    step, west, north = float(pick(random, (0.5, 2.0, 5.0))), 600000.0, 5000000.0
    x = west + step * (np.arange(z.shape[1]) + 0.5)
    y = north - step * (np.arange(z.shape[0]) + 0.5)
    fault = ""
    if random.random() < 0.45:
        fault = _spoil_netcdf(random, about, units, stored, x, y)
    rising = random.random() < 0.5
    turn = slice(None, None, -1) if rising else slice(None)
    axes = {"x": (x, units[0]), "y": (y[turn], units[1])}
    with netCDF4.Dataset(path, "w", format="NETCDF4") as file:
        for name, (centres, unit) in axes.items():
            file.createDimension(name, centres.size)
            axis = file.createVariable(name, "f8", (name,))
            axis.axis = name.upper()
            axis[:] = centres
            if unit is not None:
                axis.units = unit
        chunks = None if random.random() < 0.5 else (2, 2)
        data = file.createVariable("z", stored, ("y", "x"), fill_value=fill, chunksizes=chunks)
        data.set_auto_maskandscale(False)
        data[:] = raw[turn]
        for key, value in about.items():
            data.setncattr(key, value)
        if units[2] is not None:
            data.units = units[2]
    if fault:
        return Made(path, fault)
    values = _decoded(raw, meaning, about, fill)
    if np.isnan(values).all() or np.nanmax(np.abs(values)) > 1e7:
        return Made(path, "nothing, or absurd")
    return Made(path, f"sound {stored} {sorted(about)}", (values, (west, north, step)))


def _decoded(raw: np.ndarray, meaning: np.dtype, about: dict, fill: Any) -> np.ndarray:
    """Values decoded one by one by the CF conventions."""
    numbers = [n.item() for n in raw.view(meaning).ravel()]
    signless = "u" == meaning.kind

    def bounds(key: str) -> list:
        values = np.atleast_1d(about.get(key, np.empty(0, raw.dtype)))
        return [v.item() % 256**raw.itemsize if signless else v.item() for v in values]

    marks = bounds("missing_value")
    if fill is not None:
        marks.append(fill.item() % 256**raw.itemsize if signless else fill.item())
    elif raw.itemsize > 1:
        default = netCDF4.default_fillvals[raw.dtype.str[1:]]
        marks.append(int(default) % 256**raw.itemsize if signless else
                     raw.dtype.type(default).item())  # fmt: skip
    low = [*bounds("valid_min"), *bounds("valid_range")[:1], -math.inf][0]
    high = [*bounds("valid_max"), *bounds("valid_range")[1:], math.inf][0]
    scale, offset = float(about.get("scale_factor", 1.0)), float(about.get("add_offset", 0.0))
    found = [
        math.nan if n in marks or not low <= n <= high
        else float(n) * scale + offset if (scale, offset) != (1.0, 0.0) else float(n)
        for n in numbers
    ]  # fmt: skip
    return np.array(found).reshape(raw.shape)


def _spoil_netcdf(
    random: np.random.Generator, about: dict, units: list, stored: np.dtype,
    x: np.ndarray, y: np.ndarray,
) -> str:  # fmt: skip
    """Introduce a fault, and return its description."""
    fault = pick(random, ("unit", "unit", "unit", "scale", "offset", "range", "valid", "unsigned",
                          "missing", "uneven", "oblong", "text"))  # fmt: skip
    if fault == "unit":
        k = int(random.integers(3))
        units[k] = pick(random, FOREIGN_UNITS)
        return f"{'xyz'[k]} in {units[k]}"
    if fault in ("scale", "offset"):
        key = "scale_factor" if fault == "scale" else "add_offset"
        values = ["0.1", math.nan, math.inf, [1.0, 2.0], *([0.0] if fault == "scale" else [])]
        about[key] = pick(random, values)
    elif fault == "range":
        about["valid_range"] = pick(random, ([5, 1], [1, 2, 3], "1, 2", [5]))
        about["valid_range"] = _typed(about["valid_range"], stored)
        about.pop("valid_min", None), about.pop("valid_max", None)
    elif fault == "valid":
        about["valid_range"] = np.array([0, 100], stored)
        about[pick(random, ("valid_min", "valid_max"))] = stored.type(1)
    elif fault == "unsigned":
        about["_Unsigned"] = "true" if stored.kind == "f" else pick(random, ("yes", "2", "maybe"))
    elif fault == "missing":
        if stored.kind == "f":
            about["missing_value"] = "-9999"
        else:
            about["missing_value"] = pick(random, (0.5, "none", math.nan, 1e12))
    elif fault == "uneven":
        axis = pick(random, (x, y))
        axis[-1] += pick(random, (0.3, math.nan, math.inf, axis[0] - axis[-1]))
        return "uneven" if axis.size > 2 or not np.isfinite(axis[-1]) or axis[0] == axis[-1] else (
            "oblong"
        )  # fmt: skip
    elif fault == "oblong":
        y[:] = y[0] + 2 * (y - y[0])
    else:
        about[pick(random, ("valid_min", "valid_max", "scale_factor"))] = "many"
        about.pop("valid_range", None)
    return fault


def _typed(value: Any, stored: np.dtype) -> Any:
    return value if isinstance(value, str) else np.array(value, stored)


# ---- GeoTIFF -------------------------------------------------------------------------------------


def geotiff_structure(random: np.random.Generator, folder: Path) -> Made:
    """GeoTIFF of any type, tiling, nodata mark, packing and companions, or with one fault."""
    z, path = elevations(random), folder / "dem.tif"
    stored = np.dtype(pick(random, ("u1", "i2", "u2", "i4", "u4", "f4", "f8")))
    raw = z.astype(stored) if stored.kind == "f" else (np.abs(z) % 250).astype(stored)
    ny, nx = raw.shape
    cell = float(pick(random, (0.5, 1.0, 5.0)))
    place = Affine(cell, 0, 600000, 0, -cell, 5000000)
    up = random.random() < 0.2
    if up:
        place = Affine(cell, 0, 600000, 0, cell, 5000000 - ny * cell)
    profile: dict[str, Any] = {"crs": pick(random, (UTM, None, "EPSG:2056+5728")), "count": 1}
    valid = np.ones(raw.shape, bool)
    if random.random() < 0.5:
        profile["nodata"] = raw.flat[int(random.integers(raw.size))].item()
        valid = raw != profile["nodata"]
    if random.random() < 0.3:
        profile |= {"tiled": True, "blockxsize": 16, "blockysize": 16}
    profile["compress"] = pick(random, ("none", "deflate", "lzw", "packbits"))
    profile["bigtiff"] = pick(random, ("yes", "no"))
    scale, offset = 1.0, 0.0
    compound = "+" in (profile["crs"] or "")  # GDAL writes no scale for these
    if random.random() < 0.3 and not compound:
        scale, offset = pick(random, ((0.1, 0.0), (1.0, 100.0), (2.0, -3.3)))
    unit, bands, fault = pick(random, METRES), raw[None], ""
    if random.random() < 0.35:
        fault = pick(random, ("unit", "bands", "place", "crs", "scale", "complex", "cut", "pipe",
                              "mark"))  # fmt: skip
    if fault == "unit":
        unit = pick(random, FOREIGN_UNITS)
    elif fault == "bands":
        bands = np.stack([raw, raw])
    elif fault == "place":
        place = pick(random, (
            None, place @ Affine.rotation(10), place @ Affine.scale(1, 2),
            place @ Affine.scale(-1, 1),
        ))  # fmt: skip
    elif fault == "crs":
        profile["crs"] = pick(random, (
            "EPSG:4326", "EPSG:2225", "EPSG:32632+6360", 'LOCAL_CS["x",UNIT["foot",0.3048]]',
            "+proj=utm +zone=32 +units=km", "+proj=utm +zone=32 +towgs84=1,2,3 +units=us-ft",
        ))  # fmt: skip
    elif fault == "scale":
        profile["crs"] = UTM
        scale = pick(random, (0.0, math.nan, math.inf))
    elif fault == "mark":
        profile["nodata"] = 102938
        raw = (raw / 2).astype(raw.dtype)
        bands = raw[None].astype("f4")
    elif fault == "complex":
        bands = bands.astype("complex64")
        profile["nodata"] = None
    with rasterio.open(
        path, "w", driver="GTiff", width=nx, height=ny, dtype=bands.dtype.name, transform=place,
        **profile | {"count": len(bands)},
    ) as file:  # fmt: skip
        file.write(bands)
        _about_bands(file, scale, offset, unit)
        if "nodata" not in profile and random.random() < 0.2 and not fault:
            valid = random.random(raw.shape) < 0.8
            with rasterio.Env(GDAL_TIFF_INTERNAL_MASK=bool(random.random() < 0.5)):
                file.write_mask(np.where(valid, 255, 0).astype("u1"))
    if fault == "cut":
        os.truncate(path, int(random.integers(1, 100)))
    elif fault == "mark":
        word = pick(random, [word for word in WORDS if word and len(word.encode()) <= 6
                             and word not in ("inf", "1 2")]).encode()  # fmt: skip
        content = path.read_bytes()
        assert b"102938\0" in content
        path.write_bytes(content.replace(b"102938\0", word.ljust(7, b"\0")))
    elif fault == "pipe":
        companions = ("dem.tif.msk", "dem.tif.aux.xml", "dem.tfw", "dem.tif.ovr")
        os.mkfifo(folder / pick(random, companions))
    values = raw.astype("f8") * scale + offset if (scale, offset) != (1.0, 0.0) else raw
    values = np.where(valid, values.astype("f8"), np.nan)[:: -1 if up else 1]
    if not fault and random.random() < 0.1:
        path, fault = _elsewhere(random, folder)
    if fault or np.isnan(values).all():
        return Made(path, fault or "nothing")
    return Made(path, f"sound {stored} {profile}", (values, (600000.0, 5000000.0, cell)))


def _about_bands(file: DatasetWriter, scale: float, offset: float, unit: str | None) -> None:
    if (scale, offset) != (1.0, 0.0):
        file.scales, file.offsets = [scale] * file.count, [offset] * file.count
    if unit is not None:
        file.units = [unit] * file.count


def _elsewhere(random: np.random.Generator, folder: Path) -> tuple[Path, str]:
    """File that GDAL would open but this program must refuse, and its description."""
    path = folder / pick(random, ("dem.tif", "dem.asc", "dem.vrt", "dem.nc", "dem.bil"))
    texts = {
        "service": "<GDAL_WMS><Service name='TMS'><ServerUrl>http://127.0.0.1:9/</ServerUrl>"
        "</Service></GDAL_WMS>",
        "points": "x y z\n0 0 1\n1 0 2\n0 1 3\n1 1 4\n",
        "service of coverages": "<WCS_GDAL><ServiceURL>http://127.0.0.1:9</ServiceURL></WCS_GDAL>",
        "index": "<GDALTileIndexDataset><IndexDataset>a.gpkg</IndexDataset></GDALTileIndexDataset>",
        "raw": "0123456789abcdef",
        "mosaic": "<VRTDataset rasterXSize='1' rasterYSize='1'></VRTDataset>",
        "surfer text": "DSAA\n2 2\n0 1\n0 1\n0 1\n1 2\n3 4\n",
    }
    name = pick(random, list(texts))
    path.write_text(texts[name])
    path.with_suffix(".hdr").write_text("nrows 2\nncols 2\nnbits 32\npixeltype float\n")
    return path, f"elsewhere: {name}"


# ---- layers of polygons --------------------------------------------------------------------------

FIELD = Grid(600000.0, 5000000.0, 5.0, 7, 6, rasterio.crs.CRS.from_epsg(32632))
DRIVERS = {"gpkg": "GPKG", "geojson": "GeoJSON", "shp": "ESRI Shapefile", "fgb": "FlatGeobuf"}


def vector_layer(random: np.random.Generator, folder: Path) -> Made:
    """Layer of rectangles with ids, in any format, or with one fault."""
    ending = pick(random, list(DRIVERS))
    path = folder / f"zones.{ending}"
    corners, ids = [], random.integers(-50, 5000, int(random.integers(1, 5))).astype("i4")
    cells = np.full(FIELD.shape, NO_ID, "i4")
    for number in ids:
        row, column = int(random.integers(5)), int(random.integers(6))
        tall, wide = int(random.integers(1, 4)), int(random.integers(1, 4))
        corners.append((column, row, column + wide, row + tall))
        cells[row : row + tall, column : column + wide] = number
    shapes = [shapely.box(600000 + 5 * a, 5000000 - 5 * d, 600000 + 5 * c, 5000000 - 5 * b)
              for a, b, c, d in corners]  # fmt: skip
    fault = ""
    if random.random() < 0.6:
        faults = ["field", "words", "fraction", "shape", "empty", "cross", "crs", "text"]
        own = {"gpkg": ["view", "virtual", "computed", "endless", "layers", "wal", "cut"],
               "geojson": ["address", "nan", "pipeline", "type", "vrt", "word", "large"],
               "shp": ["pipe", "cut"], "fgb": ["cut"]}  # fmt: skip
        fault = pick(random, faults + 2 * own[ending])
    values: Any = ids
    crs, name = UTM, "zone"
    if fault == "field":
        name = "klass"
    elif fault == "words":
        values = np.array([f"a{n}" for n in ids], object)
    elif fault == "fraction":
        values = ids + 0.5
    elif fault == "shape":
        shapes = [shape.exterior for shape in shapes]
    elif fault == "empty":
        shapes, values = [], ids[:0]
    elif fault == "cross":
        a, b, c, d = shapes[0].bounds
        shapes[0] = shapely.Polygon([(a, b), (c, d), (c, b), (a, d)])
    elif fault == "crs":
        crs = "EPSG:25833" if ending != "geojson" else "EPSG:2056"
    wkb = np.array([shapely.to_wkb(shape) for shape in shapes], object)
    kind = "LineString" if fault == "shape" else "Polygon"
    how = {"geometry_type": kind, "driver": DRIVERS[ending], "crs": crs}
    if ending == "fgb":
        how["SPATIAL_INDEX"] = "NO"  # an index would change the order of shapes
    pyogrio.raw.write(path, wkb, [values], [name], **how)
    if fault:
        _spoil_layer(random, path, fault, wkb, values)
    want = None if fault else cells
    about = f"{ending}: {fault or 'sound'}"
    return Made(path, about, want, lambda path: burn_polygons(path, FIELD, "zone"))


STATEMENTS = {
    "view": "CREATE VIEW extra AS SELECT * FROM zones",
    "virtual": "CREATE VIRTUAL TABLE extra USING fts4(a)",
    "computed": "CREATE TABLE extra (a INTEGER, b AS (a + 1))",
}
ENDLESS = """
CREATE TABLE store AS SELECT * FROM zones;
DROP TABLE zones;
CREATE VIEW zones AS WITH RECURSIVE n(fid, geom, zone) AS (
    SELECT fid, geom, zone FROM store UNION ALL SELECT fid + 1, geom, zone FROM n) SELECT * FROM n;
"""


def _spoil_layer(
    random: np.random.Generator, path: Path, fault: str, wkb: np.ndarray, values: np.ndarray
) -> None:
    if fault in STATEMENTS or fault == "endless":
        with closing(sqlite3.connect(path)) as database:
            for trigger in database.execute(
                "SELECT name FROM sqlite_master WHERE type = 'trigger'"
            ).fetchall():
                database.execute(f'DROP TRIGGER "{trigger[0]}"')
            database.executescript(ENDLESS if fault == "endless" else STATEMENTS[fault])
            database.commit()
    elif fault == "layers":
        pyogrio.raw.write(path, wkb, [values], ["zone"], layer="b", geometry_type="Polygon",
                          driver="GPKG", crs=UTM)  # fmt: skip
    elif fault == "wal":
        Path(f"{path}-{pick(random, ('wal', 'journal'))}").write_bytes(b"x")
    elif fault == "cut":
        os.truncate(path, int(random.integers(1, 90)))
    elif fault == "text":
        path.write_text(pick(random, (
            "<OGRWFSDataSource><URL>http://127.0.0.1:9</URL></OGRWFSDataSource>",
            "<OGRVRTDataSource><OGRVRTLayer name='a'><SrcDataSource>b</SrcDataSource></OGRVRTLayer>"
            "</OGRVRTDataSource>", "<gpx></gpx>", "hello", "WKT,zone\n",
        )))  # fmt: skip
    elif fault == "pipe":
        companion = path.with_suffix(pick(random, (".dbf", ".shx", ".prj", ".cpg", ".qix")))
        companion.unlink(missing_ok=True)
        os.mkfifo(companion)
    elif path.suffix == ".geojson" and fault not in ("field", "words", "fraction", "shape", "empty",
                                                      "cross", "crs"):  # fmt: skip
        _spoil_geojson(random, path, fault)


def _spoil_geojson(random: np.random.Generator, path: Path, fault: str) -> None:
    data = json.loads(path.read_text())
    ring = data["features"][0]["geometry"]["coordinates"][0]
    if fault == "address":
        data["crs"] = {"type": "link", "properties": {"href": "http://127.0.0.1:9/crs"}}
        if random.random() < 0.5:
            data["crs"] = {"type": "name", "properties": {"name": "http://127.0.0.1:9/crs"}}
    elif fault == "nan":
        ring[1][0] = pick(random, (math.nan, math.inf, "1", None))
    elif fault == "pipeline":
        data = {"type": "gdal_streamed_alg", "command_line": "gdal vector pipeline ! read a.gpkg"}
    elif fault == "type":
        data["type"] = pick(random, ("Topology", "Features", 3, None, "GeometryCollection"))
    elif fault == "vrt":
        data = {"<OGRVRTDataSource>": data}
    elif fault == "word":
        data["features"][0]["properties"]["zone"] = pick(random, ("x", 1.5, None, True, [1], 2**40))
    else:
        ring[1][0] = 10**400
    path.write_text(json.dumps(data))


# ---- all -----------------------------------------------------------------------------------------

KINDS_OF_FILES: dict[str, Callable[[np.random.Generator, Path], Made]] = {
    "ASCII header": ascii_header,
    "netCDF attributes": netcdf_attributes,
    "GeoTIFF structure": geotiff_structure,
    "vector layer": vector_layer,
}


def verdict(made: Made) -> str:
    """Return `accepted`, `refused`, or the fault."""
    try:
        with warnings.catch_warnings(action="ignore"):
            found = made.how(made.path)
    except RockfallError as error:
        if made.want is None or made.want is ...:
            return "refused" if error.code == 2 and "\n" not in str(error) else f"WRONG {error}"
        return f"WRONG, must be accepted: {error}"
    except BaseException:
        return f"CRASH {traceback.format_exc()}"
    if made.want is None:
        return "WRONG, must be refused"
    return "accepted" if _same(found, made.want) else f"WRONG numbers: {found}, not {made.want}"


def _same(found: Any, want: Any) -> bool:
    if isinstance(want, tuple):
        return len(found) == len(want) and all(map(_same, found, want))
    if isinstance(want, np.ndarray):
        return found.shape == want.shape and np.array_equal(
            found.astype("f8"), want.astype("f8"), equal_nan=True
        )
    return found == want


def tried(kind: str, seed: int, numbers: range) -> Iterator[tuple[int, Made, str]]:
    """Process files of a kind in turn, each in a new folder; yield number, file and verdict."""
    shared = Path("/dev/shm")  # Wine shows this folder to Windows programs too
    place = shared if os.name == "posix" and shared.is_dir() else None
    with tempfile.TemporaryDirectory(dir=place) as name:
        for number in numbers:
            folder = Path(name) / "in"
            folder.mkdir()
            random = np.random.default_rng((seed, number))
            with warnings.catch_warnings(action="ignore"):
                made = KINDS_OF_FILES[kind](random, folder)
            faulthandler.dump_traceback_later(LONGEST, exit=True)  # do not wait for pipes
            yield number, made, verdict(made)
            faulthandler.cancel_dump_traceback_later()
            shutil.rmtree(folder)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--files", type=int, default=10_000, help="of each kind")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--kind", choices=KINDS_OF_FILES)
    given = parser.parse_args()
    counts: Counter[tuple[str, str]] = Counter()
    wrong = 0
    for kind in [given.kind] if given.kind else KINDS_OF_FILES:
        for number, made, found in tried(
            kind, given.seed, range(given.first, given.first + given.files)
        ):
            if found not in ("accepted", "refused"):
                wrong += 1
                print(f"{kind} {number}: {made.about}: {found}", flush=True)
            counts[kind, found if found in ("accepted", "refused") else "wrong"] += 1
    print(machine(), f"seed {given.seed}", "", sep="\n")
    print(f"| {'kind':17} | accepted | refused | wrong |\n| --- | --: | --: | --: |")
    for kind in dict.fromkeys(kind for kind, _ in counts):
        row = [counts[kind, word] for word in ("accepted", "refused", "wrong")]
        print(f"| {kind:17} | {row[0]:8,} | {row[1]:7,} | {row[2]:5,} |")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
