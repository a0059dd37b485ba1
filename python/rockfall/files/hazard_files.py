# SPDX-License-Identifier: BSD-3-Clause
"""Hazard files for GIS and spreadsheets: netCDF, GeoTIFF with styles, zones, objects."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from rockfall.analysis.hazard.classes import CLASSES
from rockfall.analysis.hazard.combined import LAYOUT
from rockfall.analysis.hazard.levels import period_table
from rockfall.analysis.hazard.origins import ENERGIES, SOURCES
from rockfall.analysis.hazard.variables import CLASS_ENDS
from rockfall.analysis.hazard.zones import (
    certain_fractions,
    highest_classes,
    uncertain_of,
    zones_by_cell,
    zones_of,
)
from rockfall.case.files import files_behind
from rockfall.errors import RockfallError, need
from rockfall.files.drawing import write_drawing
from rockfall.files.export import check_formats, crs_wkt, put_kml, write_geopackage, write_map
from rockfall.files.qgis_style import write_classes, write_palette
from rockfall.files.risk_files import has_risk, risk_columns, risk_layers, risk_styles, total_table
from rockfall.files.segment_files import has_segments, segment_layer, segment_table
from rockfall.files.vector_style import Style, alike, fill, marker, plain_type, thick
from rockfall.io.atomic import atomic_folder
from rockfall.io.netcdf import load_exact, open_netcdf
from rockfall.io.tables import write_csv
from rockfall.result.dataset import put_netcdf
from rockfall.result.maps.classes import classes_of, shown_as
from rockfall.result.maps.flat_maps import PLAN, flat_maps, shown
from rockfall.result.trajectories import flags_of
from rockfall.result.variables import ENDS

#: Colours of hazard (as on Swiss hazard maps) and of intensity, from pale to dark.
HAZARD_COLOURS = ("#ffffff", "#fff9c4", "#ffe14d", "#5b8ff9", "#e03131")
WEAKEST, STRONGEST = (200, 230, 201), (27, 94, 32)  # intensity colours (red, green, blue)
DOUBTFUL = "#ff8c00"
GEOMETRY = {
    "POINT": "point",
    **dict.fromkeys(("LINESTRING", "MULTILINESTRING"), "line"),
    **dict.fromkeys(("POLYGON", "MULTIPOLYGON"), "polygon"),
}
DRAWINGS = ("kml", "dxf")  # formats of `export_hazard`
MOST_PLACES = 20  # maximum lines, and maximum objects, in the layer of sources
HAZARD = "hazard.nc"  # file name in the folder of a hazard
NO_CELL = 255  # nodata value of yes-no rasters


def write_hazard(found: xr.Dataset, folder: str | Path) -> list[Path]:
    """Write a hazard to a folder: hazard.nc; a GeoTIFF and a QGIS style (.qml) for each map;
    hazard.gpkg with zones, objects and segments; and CSV tables of objects, segments, return
    periods and risk. Return the files; all are written or none, with a RockfallError.

    >>> import rockfall
    >>> case = rockfall.read_case("case.nml")
    >>> case = case.replace(scenario=[{"name": "small", "return_period": 10.0}])
    >>> files = rockfall.write_hazard(rockfall.hazard(case), "zones")
    """
    folder = Path(folder)
    with atomic_folder(folder, files_behind(found)) as part:
        return [folder / path.name for path in put_hazard(found, part)]


def read_hazard(path: str | Path) -> xr.Dataset:
    """Read a hazard from a file hazard.nc. Raises a RockfallError if it has no hazard, or one with
    the layout of a different version."""
    dataset = load_exact(path, "a hazard")
    if "hazard_class" not in dataset:
        raise RockfallError(f"{path}: is not a hazard file: hazard_class is missing")
    if (layout := dataset.attrs.get("hazard_layout")) != LAYOUT:
        raise RockfallError(f"{path}: has hazard_layout = {layout}, not {LAYOUT}: run again")
    return dataset


def is_hazard(path: str | Path) -> bool:
    """Return True if a file is the netCDF file of a hazard."""
    try:
        with open_netcdf(path) as file:
            return "hazard_class" in file.variables
    except (OSError, RockfallError):  # not readable: reading it as a result reports the error
        return False


def in_folder(path: Path) -> Path:
    """Path of hazard.nc in a hazard folder; other paths are returned unchanged."""
    return path / HAZARD if path.is_dir() and (path / HAZARD).is_file() else path


def export_hazard(path: str | Path, folder: str | Path, formats: Sequence[str]) -> list[Path]:
    """Write the zones and objects of a hazard (a file hazard.nc) to a folder in `formats` (kml,
    dxf): all files, which are returned, or none, with a RockfallError."""
    folder, chosen, hazard = Path(folder), check_formats(formats, DRAWINGS), read_hazard(path)
    need("zones need", "vector")
    with atomic_folder(folder, [path, *files_behind(hazard)]) as part:
        return [folder / file.name for file in _put_drawings(hazard, part, chosen)]


def _put_drawings(hazard: xr.Dataset, folder: Path, formats: list[str]) -> Iterator[Path]:
    """Write drawings of generalised zones and objects; refuses a hazard without any."""
    layers = {name: layer for name, layer in hazard_layers(hazard) if name in ("zones", "objects")}
    if not layers:
        raise RockfallError("the hazard has no zones and no objects")
    styles = _styles({name: kind for name, (kind, _) in layers.items()})
    if "kml" in formats:
        yield put_kml(folder / "hazard.kml", layers, hazard, styles)
    if "dxf" in formats:
        yield write_drawing(folder / "hazard.dxf", layers, styles)


def put_hazard(hazard: xr.Dataset, folder: Path) -> Iterator[Path]:
    """Write the files of `write_hazard` to a new folder."""
    need("zones need", "vector")
    put_netcdf(hazard, folder / HAZARD, folder / HAZARD)
    yield folder / HAZARD
    yield from _put_maps(hazard, folder)
    yield from _put_zones(hazard, folder)
    if "object" in hazard.dims:
        write_csv(object_table(hazard), folder / "objects.csv")
        yield folder / "objects.csv"
    if has_segments(hazard):
        write_csv(segment_table(hazard), folder / "segments.csv")
        yield folder / "segments.csv"
    if len(levels := period_table(hazard)):
        write_csv(levels, folder / "return_periods.csv")
        yield folder / "return_periods.csv"
    if has_risk(hazard):
        write_csv(total_table(hazard), folder / "risk.csv")
        yield folder / "risk.csv"


def put_zones(hazard: xr.Dataset, folder: Path) -> Iterator[Path]:
    """Write hazard.gpkg with zones and objects, and styled class maps, to a new folder."""
    need("zones need", "vector")
    classes = [name for name, data in hazard.data_vars.items() if "flag_meanings" in data.attrs]
    yield from _put_maps(hazard[[*classes, "crs"]], folder)
    yield from _put_zones(hazard, folder)


def _put_zones(hazard: xr.Dataset, folder: Path) -> Iterator[Path]:
    if layers := dict(hazard_layers(hazard)):
        styles = _styles({name: kind for name, (kind, _) in layers.items()})
        yield write_geopackage(folder / "hazard.gpkg", layers, crs_wkt(hazard), styles)


def colours_of(data: xr.DataArray) -> dict[int, str]:
    """Colour of each class on a class map, except blank classes."""
    words = flags_of(data)
    if str(data.name).endswith("certain"):
        return {0: DOUBTFUL}
    if tuple(words) == CLASSES:
        return dict(enumerate(HAZARD_COLOURS[1:], start=1))
    shades = np.linspace(np.array(WEAKEST, float), np.array(STRONGEST, float), len(words) - 1)
    texts = ("#" + bytes(shade).hex() for shade in shades.round().astype(int).tolist())
    return dict(enumerate(texts, start=1))


def _put_maps(hazard: xr.Dataset, folder: Path) -> Iterator[Path]:
    for name, data in flat_maps(hazard.set_coords("crs")).data_vars.items():
        if data.dims != PLAN:
            continue
        path = folder / f"{name}.tif"
        if "flag_meanings" not in data.attrs:
            yield write_map(path, data)
            unit, factor = shown_as(data)
            yield write_classes(path, classes_of(unit), 1 / factor)
            continue
        blank = NO_CELL if str(name).endswith("certain") else 0
        yield write_map(path, data.astype("u1").assign_attrs(_FillValue=blank))
        words = {number: word.replace("_", " ") for word, number in flags_of(data).items()}
        yield write_palette(path, words, colours_of(data))


def hazard_layers(hazard: xr.Dataset) -> Iterator[tuple[str, tuple]]:
    """Yield the non-empty layers of a hazard: zones (generalised and by cell), uncertain areas,
    objects, segments, sources and risks."""
    import shapely

    words, doubtful = np.array(CLASSES, dtype=object), uncertain_of(hazard)
    for name, zones in (("zones", zones_of(hazard)), ("zones_by_cell", zones_by_cell(hazard))):
        if zones.shapes.size:
            attrs = {
                "hazard": words[zones.number], "class": zones.number,
                "area": shapely.area(zones.shapes), "certain": certain_fractions(zones, hazard),
                "highest": words[highest_classes(zones, hazard)],
            }  # fmt: skip
            yield name, ("Polygon", [(zones.shapes, attrs)])
    if doubtful.shapes.size:
        low, high = np.divmod(doubtful.number, len(CLASSES))
        attrs = {
            "lowest": words[low], "highest": words[high], "lowest_class": low,
            "highest_class": high, "area": shapely.area(doubtful.shapes),
        }  # fmt: skip
        yield "uncertain", ("Polygon", [(doubtful.shapes, attrs)])
    if "object" in hazard.dims:
        yield "objects", _object_layer(hazard)
    if has_segments(hazard):
        yield "segments", segment_layer(hazard)
    if hazard.sizes.get("source"):
        yield "sources", _source_layer(hazard)
    if has_risk(hazard):
        yield from risk_layers(hazard)


def _styles(kinds: dict[str, str]) -> dict[str, Style]:
    """Styles of zones and objects by class, with hatching for uncertain areas."""
    colours = dict(zip(CLASSES, HAZARD_COLOURS, strict=True))
    drawn = {"Point": marker, "LineString": thick, "Polygon": fill}
    styles = {"uncertain": alike(fill(DOUBTFUL, "f_diagonal"))}
    for layer in ("zones", "zones_by_cell", "objects", "segments"):
        if symbol := drawn.get(plain_type(kinds.get(layer, ""))):
            styles[layer] = Style("hazard", [(c, c, symbol(colours[c])) for c in CLASSES])
    return styles | risk_styles(kinds)


def _source_layer(hazard: xr.Dataset) -> tuple:
    """Layer of source cells: boulders per year that start there, and that reach the most frequently
    hit lines and objects, with their energies at these places."""
    import shapely

    x, y = (hazard[f"source_{axis}"].values for axis in "xy")
    columns: dict[str, np.ndarray] = {"frequency": hazard["source_frequency"].values}
    for kind, k in _with_sources(hazard):
        name = f"to {hazard[kind].values[k]}"
        columns[name] = hazard[f"{kind}_source_frequency"].values[k]
        for energy in ENERGIES:
            columns[f"{name} {energy}"] = 1e-3 * hazard[f"{kind}_source_{energy}"].values[k]
    return "Point", [(shapely.points(x, y), columns)]


def _with_sources(hazard: xr.Dataset) -> Iterator[tuple[str, int]]:
    """Yield kind and index of lines and objects with known sources: at most `MOST_PLACES` of each
    kind, the most frequently hit."""
    for kind in SOURCES:
        if f"{kind}_source_frequency" in hazard:
            unknown = np.isnan(hazard[f"{kind}_source_frequency"].values).any(axis=1)
            order = np.argsort(-hazard[f"{kind}_frequency"].values, kind="stable")
            yield from ((kind, int(k)) for k in order[~unknown[order]][:MOST_PLACES])


def _object_layer(hazard: xr.Dataset) -> tuple:
    import shapely

    shapes = shapely.from_wkt(hazard["object_geometry"].values.astype(str))
    kinds = {shape.geom_type for shape in shapes}
    columns = {str(name): column.to_numpy() for name, column in object_table(hazard).items()}
    return kinds.pop() if len(kinds) == 1 else "Unknown", [(shapes, columns)]


def object_table(hazard: xr.Dataset) -> pd.DataFrame:
    """Table with a row for each object: frequencies and their limits, class, and risks if known."""
    words = np.array(CLASSES, dtype=object)
    geometry = [GEOMETRY[text.split(" ")[0]] for text in hazard["object_geometry"].values]
    columns: dict[str, np.ndarray] = {
        "object": hazard["object"].values.astype(object),
        "layer": hazard["object_layer"].values.astype(object),
        "geometry": np.array(geometry, dtype=object),
    }
    columns |= {f"frequency{end}": hazard[f"object_frequency{end}"].values for end in ENDS}
    for threshold in hazard["threshold"].values.tolist():
        for end in ENDS:
            values = hazard[f"object_exceedance_frequency{end}"].sel(threshold=threshold).values
            columns[f"frequency_above_{shown('threshold', threshold)}{end}"] = values
    for end in CLASS_ENDS:
        columns[f"hazard{end}"] = words[hazard[f"object_hazard_class{end}"].values]
    if "object_risk" in hazard:
        columns |= {f"risk{end}": hazard[f"object_risk{end}"].values for end in ENDS}
    return pd.DataFrame(columns | dict(risk_columns(hazard)))
