# SPDX-License-Identifier: BSD-3-Clause
"""Project of an exported result: layers, groups, themes and layouts."""

import sqlite3
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing
from operator import attrgetter
from pathlib import Path
from typing import NamedTuple

import xarray as xr

from rockfall.case import case_of
from rockfall.case.files import read_names
from rockfall.files.export import crs_wkt
from rockfall.files.qgis_style import contour_style, write_relief
from rockfall.io.rasters.geotiff import write_geotiff
from rockfall.language import Number, say, speaking, word
from rockfall.plots.cartography.relief import INDEX, contours_of
from rockfall.plots.cartography.sheet import crs_text, named_crs
from rockfall.plots.extent import Extent, reached
from rockfall.plots.hazard.hazard_sheet import NOBODY, Imprint
from rockfall.plots.style import capital
from rockfall.qgis_project.document import Project, Theme, write_project
from rockfall.qgis_project.layers import Group, Layer, raster_layer, vector_layer, vector_styles
from rockfall.qgis_project.layout import Texts, layout
from rockfall.quantities import with_unit
from rockfall.result.grounds import program_text
from rockfall.result.maps.classes import UNITS
from rockfall.result.maps.map_labels import map_label
from rockfall.result.maps.passages import PASSED
from rockfall.result.trajectories import Terrain

PROJECT, ELEVATION = "project.qgz", "elevation_m.tif"
RESULT, HAZARD = "rockfall.gpkg", "hazard.gpkg"
CONTOUR = "#5a4632"
MAX_FILES = 8  # maximum file names on paper
#: Titles of GeoPackage layers, by file and layer name.
TITLES = {
    RESULT: {
        "trajectories": "qgis.trajectories", "crossings": "qgis.crossings", "stops": "qgis.stops",
        "lines": "map.evaluation_lines", "barriers": "label.barriers", "dams": "qgis.dams",
        "source_areas": "qgis.sources", "sources": "qgis.starts",
    },
    HAZARD: {
        "objects": "qgis.objects", "uncertain": "sheet.uncertain", "zones": "qgis.zones",
        "zones_by_cell": "qgis.zones_by_cell",
    },
}  # fmt: skip
NOT_IN_LEGEND = "lines"  # the map shows their names


class _Layers(NamedTuple):
    """Layers of a project: of the GeoPackages `result` and `hazard` by name, of maps by file stem,
    and of the terrain."""

    result: dict[str, Layer]
    hazard: dict[str, Layer]
    maps: dict[str, Layer]
    classes: dict[str, Layer]
    terrain: tuple[Layer, ...]


def put_project(
    data: xr.Dataset,
    folder: Path,
    files: Sequence[Path],
    terrain: Terrain | None = None,
    imprint: Imprint = NOBODY,
    language: str = "en",
) -> Iterator[Path]:
    """Write project.qgz for the files of an export to a new folder; if the terrain is known, also
    elevation_m.tif with its style. `files` may include the files of a hazard."""
    extent = reached(data, terrain)
    with speaking(language):
        relief: list[Layer] = []
        if terrain is not None:
            yield from _put_terrain(terrain, folder)
            relief = _relief(terrain, extent, folder)
        maps, classes = _maps(files)
        layers = _Layers(
            _vectors(folder / RESULT), _vectors(folder / HAZARD),
            maps, classes, tuple(relief),
        )  # fmt: skip
        themes = list(_themes(layers))
        title = str(data.attrs.get("title") or Path(str(data.attrs["case_file"])).stem)
        drawn = [
            layout(theme.name, theme.name, extent, filter(attrgetter("in_legend"), theme.layers),
                   _texts(data, title, theme.name, imprint, relief))
            for theme in themes
        ]  # fmt: skip
        project = Project(title, crs_wkt(data), extent, list(_groups(layers)), themes, drawn)
    yield write_project(project, folder / PROJECT)


def _put_terrain(terrain: Terrain, folder: Path) -> Iterator[Path]:
    z, grid = terrain
    path = folder / ELEVATION
    write_geotiff(path, z, grid, float("nan"), units="m", long_name="elevation")
    yield path
    yield write_relief(path)


def _relief(terrain: Terrain, extent: Extent, folder: Path) -> list[Layer]:
    """Contours over shaded relief, both from the elevation file."""
    interval = contours_of(terrain, extent).interval
    path = folder / ELEVATION
    style, title = contour_style(interval, INDEX, CONTOUR), say("map.contours", interval=interval)
    relief = raster_layer(path, say("qgis.relief"), visible=True, in_legend=False)
    return [Layer(capital(title), relief.source, style, True, in_legend=False), relief]


def _vectors(path: Path) -> dict[str, Layer]:
    """Styled layers of a GeoPackage in drawing order; none without a file. Objects of several
    shape types are omitted, because QGIS would choose a random colour; risk layers show them."""
    if not path.exists():
        return {}
    with closing(sqlite3.connect(path)) as database:
        text = "SELECT table_name FROM gpkg_contents WHERE data_type = 'features'"
        names = {name for (name,) in database.execute(text)}
    styles, titles = vector_styles(path), TITLES[path.name]
    others = sorted(names - titles.keys())
    risk = [name for name in others if name.startswith("risk")]  # small: drawn above zones
    ordered = [*risk, *(name for name in titles if name in names)]
    ordered += [name for name in others if name not in risk]
    return {
        name: vector_layer(
            path, name, styles[name],
            capital(say(titles[name]) if name in titles else word(name)),
            in_legend=name != NOT_IN_LEGEND,
        )
        for name in ordered
        if name in styles
    }  # fmt: skip


def _maps(files: Iterable[Path]) -> tuple[dict[str, Layer], dict[str, Layer]]:
    """Maps of numbers, and class maps of a hazard, with their long names."""
    import rasterio

    maps: dict[str, Layer] = {}
    classes: dict[str, Layer] = {}
    for path in files:
        if path.suffix == ".tif":
            with rasterio.open(path) as file:
                tags = file.tags()
            unit = tags.get("units", "1")
            label = map_label(tags.get("variable", path.stem), tags.get("long_name", path.stem))
            title = capital(with_unit(label, word(unit) if unit in UNITS else ""))
            chosen = classes if "flag_meanings" in tags else maps
            chosen[path.stem] = raster_layer(path, title)
    return maps, classes


def _themes(layers: _Layers) -> Iterator[Theme]:
    """Themes: trajectories, zones, and each map, together with sources, lines, nets and relief."""
    above, below = _base(layers)
    shown = [layer for name, layer in layers.hazard.items() if name != "zones_by_cell"]
    if "trajectories" in layers.result:
        path = layers.result["trajectories"]
        yield Theme(path.title, (path, *above, *below))
    if shown:
        yield Theme(say("qgis.hazard"), (*shown, *above, *below))
    for layer in (*layers.maps.values(), *layers.classes.values()):
        yield Theme(layer.title, (*above, layer, *below))
    if not (layers.maps or layers.classes or shown or "trajectories" in layers.result):
        yield Theme(say("map.map"), (*above, *below))


def _base(layers: _Layers) -> tuple[tuple[Layer, ...], tuple[Layer, ...]]:
    """Layers above and below a map, which all themes share."""
    sources = "source_areas" if "source_areas" in layers.result else "sources"
    names = "lines", "barriers", "dams", sources
    above = tuple(layers.result[name] for name in names if name in layers.result)
    return above, layers.terrain


def _groups(layers: _Layers) -> Iterator[Group]:
    """Groups from the top to the bottom of the map, with initial visibility."""
    above, _ = _base(layers)
    first = next((name for name in PASSED if name in layers.maps), next(iter(layers.maps), ""))
    chosen = {layer.id for layer in above} | {name for name in (_id(layers.maps, first),) if name}
    chosen |= {_id(layers.result, "trajectories")}

    def group(key: str, by_name: dict[str, Layer], *names: str, expanded: bool = True):
        layers = [by_name[name] for name in names if name in by_name]
        shown = (layer._replace(visible=layer.visible or layer.id in chosen) for layer in layers)
        return Group(capital(say(key)), tuple(shown), expanded)

    result, maps = layers.result, layers.maps
    for layer_group in (
        group("qgis.trajectories", result, "trajectories", "crossings", "stops"),
        group("map.evaluation_lines", result, "lines"),
        group("qgis.protection", result, "barriers", "dams"),
        group("qgis.sources", result, "source_areas", "sources"),
        group("qgis.hazard", layers.hazard | layers.classes, *layers.hazard, *layers.classes,
              expanded=False),
        group("qgis.maps", maps, *maps),
        Group(say("qgis.terrain"), layers.terrain, False),
    ):  # fmt: skip
        if layer_group.layers:
            yield layer_group


def _id(layers: dict[str, Layer], name: str) -> str:
    return layers[name].id if name in layers else ""


def _texts(
    data: xr.Dataset, title: str, theme: str, imprint: Imprint, relief: Sequence[Layer]
) -> Texts:
    """Texts of a layout: author and date, contours, coordinate system, data, program and seed."""
    crs = data["crs"].attrs
    files = read_names(case_of(data))
    more = [f"+ {len(files) - MAX_FILES}"] if len(files) > MAX_FILES else []
    seed = say("qgis.seed", seed=Number(str(data.attrs["seed"])))
    return Texts(
        title,
        theme,
        [
            f"{say('sheet.project')}: {imprint.project or '_' * 30}",
            f"{say('sheet.client')}: {imprint.client or '_' * 30}",
            f"{say('sheet.author')}: {imprint.author or '_' * 30}",
            f"{say('sheet.computed')}: {str(data.attrs['date_created'])[:10]}",
        ],
        [
            *(layer.title for layer in relief[:1]),
            crs_text(crs) if named_crs(crs) else say("sheet.no_crs"),
            f"{say('sheet.sources')}: {', '.join([*files[:MAX_FILES], *more])}",
            f"{program_text(data)}, {seed}",
        ],
        say("qgis.scale"),
        say("qgis.printed"),
    )
