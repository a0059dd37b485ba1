# SPDX-License-Identifier: BSD-3-Clause
"""Files for tests to read, and a check of refusals."""

import contextlib
import os
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import rasterio
from affine import Affine

from rockfall.errors import RockfallError
from rockfall.files import hazard_files
from rockfall.io.rasters.grid import NO_ID, Grid

UTM = "EPSG:32632"
PLACE = Affine(5.0, 0.0, 600000.0, 0.0, -5.0, 5000000.0)


def hill(ny=6, nx=4, dtype="float64"):
    """Elevations, different in every cell."""
    return (1000.0 + np.arange(ny * nx).reshape(ny, nx) * 0.25).astype(dtype)


def make_raster(path, array, transform=PLACE, crs=UTM, nodata=None, **profile):
    """Write a raster with one band, or with several from a three-dimensional array; return its
    path."""
    bands = array if array.ndim == 3 else array[None]
    with rasterio.open(
        path,
        "w",
        driver="GTiff",
        count=len(bands),
        height=bands.shape[1],
        width=bands.shape[2],
        dtype=bands.dtype.name,
        transform=transform,
        crs=crs,
        nodata=nodata,
        **profile,
    ) as file:
        file.write(bands)
    return path


def make_ascii(path, body, head="xllcorner 600000\nyllcorner 4999970\ncellsize 5\n", size=(3, 2)):
    """Write an ESRI ASCII grid of `size` (columns, rows) with `body` as its numbers; return its
    path."""
    Path(path).write_text(f"ncols {size[0]}\nnrows {size[1]}\n{head}{body}")
    return path


def make_layer(path, shapes, crs=UTM, layer=None, **columns):
    """Write a vector layer with an attribute for each of `columns`; return its path."""
    pyogrio = pytest.importorskip("pyogrio", reason="the vector extra is not installed")
    shapely = pytest.importorskip("shapely", reason="the vector extra is not installed")
    kinds = {shape.geom_type for shape in shapes if shape is not None}
    pyogrio.raw.write(
        path,
        shapely.to_wkb(np.array(shapes, object)),
        [_field(values) for values in columns.values()],
        list(columns),
        geometry_type=kinds.pop() if len(kinds) == 1 else "Unknown",
        crs=crs,
        layer=layer,
        append=layer is not None and Path(path).exists(),
    )
    return path


def _field(values):
    kinds = set(map(type, values))
    return np.array(values, object if str in kinds else float if type(None) in kinds else None)


class Frame(pd.DataFrame):
    """The part of a GeoDataFrame that rockfall uses, without geopandas."""

    _metadata = ["crs"]

    @property
    def geometry(self):
        return pd.Series(list(self["geom"]), name="geom")


def make_frame(shapes, crs=UTM, **columns):
    made = Frame({"geom": shapes, **columns}, index=[f"row {k}" for k in range(len(shapes))])
    made.crs = rasterio.crs.CRS.from_user_input(crs) if crs else None
    return made


def write_ascii(path, array, grid, nodata=-9999):
    """Write an array as an ESRI ASCII grid; NaN and NO_ID become nodata."""
    missing = np.isnan(array) if array.dtype.kind == "f" else array == NO_ID
    rows = np.where(missing, nodata, array.astype(object))
    place = f"xllcorner {grid.west!r}\nyllcorner {grid.south!r}\ncellsize {grid.cell!r}\n"
    head = f"ncols {grid.nx}\nnrows {grid.ny}\n{place}NODATA_value {nodata}\n"
    Path(path).write_text(head + "".join(" ".join(map(repr, row)) + "\n" for row in rows.tolist()))


def make_rockyfor3d(folder, elevations, sources):
    """Write a Rockyfor3D folder for elevations in cells of 5 m; `sources` is 1 where boulders
    start, else 0."""
    ones = np.ones(elevations.shape)
    rasters = {"dem": elevations, "soiltype": 4 * ones, "rockdensity": 2700 * sources}
    rasters |= dict.fromkeys(("rg70", "rg20", "rg10"), 0.1 * ones)
    rasters |= dict.fromkeys(("d1", "d2", "d3", "blshape"), sources)
    ny, nx = elevations.shape
    Path(folder).mkdir()
    for name, values in rasters.items():
        write_ascii(f"{folder}/{name}.asc", values, Grid(0.0, 5.0 * ny, 5.0, nx, ny))


@contextlib.contextmanager
def refused(message):
    """Check that the block raises a RockfallError with exactly this line and exit status 2; on
    every system paths have `/`."""
    with pytest.raises(RockfallError) as caught:
        yield
    said, expected = (text.replace(os.sep, "/") for text in (str(caught.value), message))
    assert said == expected
    assert caught.value.code == 2
    assert "\n" not in message


def every_third(parameters):
    """Parameters of a test; two of three require `--all`."""
    return [
        pytest.param(
            *(one if isinstance(one, tuple) else (one,)), marks=[pytest.mark.all] * (k % 3 > 0)
        )
        for k, one in enumerate(parameters)
    ]


def write_few_maps(patch):
    """Write only two maps of a hazard, because writing all takes longer than all other steps."""
    put = hazard_files._put_maps
    few = ["hazard_class", "hazard_class_certain", "crs"]
    patch.setattr(hazard_files, "_put_maps", lambda hazard, folder: put(hazard[few], folder))


def draw_no_hazard(patch):
    """Let the command write a hazard without figures and with a blank sheet."""
    figure = pytest.importorskip("matplotlib.figure", reason="the report extra is not installed")
    patch.setattr("rockfall.cli.commands.hazard.hazard_figures", lambda *_: [])
    sheet = "rockfall.cli.commands.hazard.hazard_sheet"
    patch.setattr(sheet, lambda *_: figure.Figure(figsize=(1, 1)))


def leave_pictures_blank(patch):
    """Make figures of pages blank but of their true size, because drawing takes longest and has its
    own tests. Texts of figures are still translated."""

    def blank(figure, _):
        wide, high = figure.get_size_inches()
        size = f'width="{wide}in" height="{high}in" viewBox="0 0 {wide} {high}"'
        return f'<svg xmlns="http://www.w3.org/2000/svg" {size}/>'.encode()

    patch.setattr("rockfall.html_report.render._saved", blank)


def surveyed_blocks():
    """Rows `volume,year` of 60 blocks from a power law; every sixth has a year."""
    years = [str(1990 + k // 2) if k % 6 == 0 else "" for k in range(60)]
    return [f"{0.4 * (1 - k / 60) ** -0.8:.4f},{year}\n" for k, year in enumerate(years)]


def make_page(folder):
    """Write files that replace the built page of the live window; return their folder."""
    folder.mkdir()
    (folder / "index.html").write_text(
        '<!doctype html><html><head><link rel="stylesheet" href="app.css"></head>'
        '<body><div id="app"></div><script src="app.js"></script></body></html>'
    )
    for name in "app.js", "app.css", "licences.txt":
        (folder / name).write_text(f"/* {name} */")
    return folder
