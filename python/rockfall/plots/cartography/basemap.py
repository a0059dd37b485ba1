# SPDX-License-Identifier: BSD-3-Clause
"""Map background from the user's image, such as an orthophoto."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from rockfall.errors import RockfallError
from rockfall.io.gdal_files import plain_file
from rockfall.plots.cartography.rasters import DOTS
from rockfall.plots.extent import Extent

FORMATS = ["GTiff", "JPEG", "PNG", "HFA"]
BYTE = "uint8"


class Basemap(NamedTuple):
    """Colours (ny, nx, 3), 0 to 255, white outside the image, and position [m]."""

    colours: np.ndarray
    extent: Extent


class Picture(NamedTuple):
    """Colours (ny, nx, 3), 0 to 255, and a mask (ny, nx) of pixels that the image covers."""

    colours: np.ndarray
    seen: np.ndarray


def read_basemap(path: str | Path, result: xr.Dataset, extent: Extent) -> Basemap:
    """Read the part of an image within an extent, in the CRS of the result.

    Accepts georeferenced GeoTIFF, JPEG, PNG or Erdas Imagine with a CRS, and one band (grey, or
    with a palette) or three bands of 8 bits. Anything else raises a RockfallError.
    """
    crs = result["crs"].attrs.get("crs_wkt") if "crs" in result else None
    if not crs:
        raise RockfallError(f"{path}: a basemap needs a result whose terrain has a CRS")
    colours, seen = read_picture(path, crs, extent)
    return Basemap(np.where(seen[..., None], colours, 255).astype("u1"), extent)


def read_picture(
    path: str | Path, crs: str, extent: Extent, dots: int = DOTS, *, stretched: bool = False
) -> Picture:
    """Read the part of an image within an extent, in a CRS (WKT), with `dots` pixels along the
    longer side. If `stretched`, bands with more than 8 bits are scaled from their 2 % to their 98 %
    quantile; otherwise they raise a RockfallError."""
    import rasterio
    from rasterio.io import DatasetReader

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", rasterio.errors.NotGeoreferencedWarning)
        try:
            with DatasetReader(plain_file(path), driver=FORMATS) as source:
                _check(source, path, stretched)
                return _warped(source, crs, extent, path, dots)
        except rasterio.errors.RasterioError as error:
            raise RockfallError(f"{path}: cannot be read as a picture: {error}") from error


def _check(source: Any, path: str | Path, stretched: bool) -> None:
    if source.crs is None:
        raise RockfallError(f"{path}: has no CRS, which a basemap needs")
    if {*source.dtypes} != {BYTE} and not stretched:
        raise RockfallError(f"{path}: a basemap requires 8-bit bands, not {source.dtypes[0]}")


def _warped(source: Any, crs: str, extent: Extent, path: str | Path, dots: int) -> Picture:
    from rasterio.enums import ColorInterp, Resampling
    from rasterio.transform import from_bounds
    from rasterio.vrt import WarpedVRT

    west, east, south, north = extent
    dot = max(east - west, north - south) / dots
    nx, ny = (max(2, round(side / dot)) for side in (east - west, north - south))
    style = {"crs": crs, "transform": from_bounds(west, south, east, north, nx, ny)}
    palette = source.colorinterp[0] == ColorInterp.palette
    how = Resampling.nearest if palette else Resampling.bilinear
    with WarpedVRT(source, width=nx, height=ny, resampling=how, add_alpha=True, **style) as warped:
        bands = warped.read([1, 2, 3] if warped.count > 3 else [1])
        seen = warped.dataset_mask() > 0
    if not seen.any():
        raise RockfallError(f"{path}: does not overlap the area that boulders reached")
    if palette:
        table = source.colormap(1)
        bands = np.array([table[k][:3] for k in range(256)], "u1")[bands[0]].transpose(2, 0, 1)
    elif bands.dtype != BYTE:
        seen = seen & np.isfinite(bands).all(axis=0)
        bands = _stretch(bands, seen)
    return Picture(bands.astype("u1").repeat(3 // len(bands), axis=0).transpose(1, 2, 0), seen)


def _stretch(bands: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Bands (n, ny, nx) scaled from their joint 2 and 98 % quantiles to 0 and 255; unseen: 255."""
    low, high = np.percentile(bands[:, seen], [2, 98]) if seen.any() else (0.0, 1.0)
    scaled = (bands.astype("f8") - low) / ((high - low) or 1.0)
    return np.where(seen, np.clip(255 * scaled, 0, 255), 255)
