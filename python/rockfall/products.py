# SPDX-License-Identifier: BSD-3-Clause
"""Reports, figures, sections and exports of a result."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd
import xarray as xr

from rockfall.analysis.lines.section import Section, section_of
from rockfall.analysis.lines.stations import SectionLine, drawn_line
from rockfall.analysis.observed.compare import site_observations
from rockfall.analysis.observed.deposits import grid_for
from rockfall.analysis.observed.observations import Observed, read_observed
from rockfall.case.files import files_behind
from rockfall.errors import RockfallError, need
from rockfall.files.export import EXPORTED, Chosen, crs_wkt, put_export
from rockfall.files.hazard_files import put_zones, read_hazard
from rockfall.html_report.inputs import Parties
from rockfall.html_report.page import ReportInputs, check_page, is_pdf, write_report
from rockfall.html_report.variants_page import Given, write_variants_page
from rockfall.io.atomic import atomic_folder
from rockfall.io.rasters.grid import Grid
from rockfall.io.rasters.raster_file import raster_files
from rockfall.language import catalogue, say
from rockfall.office.tables import check_tables, put_tables
from rockfall.plots.cartography.basemap import read_basemap
from rockfall.plots.extent import cell_of, reached
from rockfall.plots.figures import figures as figures_of
from rockfall.plots.figures import write_figures
from rockfall.plots.hazard.hazard_sheet import NOBODY, Imprint
from rockfall.plots.left_out import LeftOut
from rockfall.plots.map_figures import Look
from rockfall.plots.terrain import terrain_of
from rockfall.qgis_project.project import put_project
from rockfall.result.dataset import read_result
from rockfall.result.maps.classes import read_limits
from rockfall.result.same_case import check_same_case
from rockfall.result.samples import has_rows
from rockfall.result.trajectories import Terrain
from rockfall.scene.layers import file_checksum
from rockfall.studies.models import read_models
from rockfall.tables.models import check_models

Result = xr.Dataset | str | Path
Place = str | Path | None
Files = Sequence[str | Path]

NO_COSTS: Mapping[str, float] = {}


class Added(NamedTuple):
    """Additions to an export: table formats, or a QGIS project with DEM, hazard and imprint."""

    project: bool = False
    tables: Sequence[str] = ()
    dem: Place = None
    hazard: Place = None
    language: str = "en"
    imprint: Imprint = NOBODY


class _Drawn(NamedTuple):
    """Inputs of figures and pages, in the order of the functions' arguments."""

    result: xr.Dataset
    terrain: Terrain | None
    observed: Observed | None
    look: Look
    left: LeftOut
    of_site: bool  # `observed` comes from the case

    def warn(self) -> None:
        """Issue a warning for each error, with the parts it prevents, attributed to the calling
        function."""
        for text in self.left.notes():
            warnings.warn(text, stacklevel=2)


def report(
    result: Result,
    path: str | Path,
    *,
    dem: Place = None,
    observed: Files = (),
    basemap: Place = None,
    limits: Sequence[str] = (),
    view: Any = None,
    language: str = "en",
    project: str = "",
    client: str = "",
    author: str = "",
    dem_date: str = "",
    hazard: Place = None,
    models: Place = None,
    section: Any = None,
    section_layer: str | None = None,
    section_within: float = 10.0,
    factors: Place = None,
) -> Path:
    """Write a result (a Dataset, or its netCDF file) as a single offline HTML page or a PDF,
    depending on the extension of `path`.

    `dem` is the terrain under the maps (default: the case's terrain, if its file exists).
    `observed` is a list of CSV files with observations to draw with the result. `basemap` is a
    raster image under the maps, `limits` are class limits ("kJ=30,300"). `view`, from
    `rockfall.show`, adds an interactive map and trajectories in three dimensions. The page is in
    `language` (en, de, de-AT ...). Page 1, for signature, shows `project` (name or number),
    `client`, `author` and the survey date of the terrain, `dem_date`. `hazard` (a file hazard.nc)
    adds hazard zones; `models` (a file models.nc from `rockfall models`) the spread over rebound
    models; `section` (a line as in `rockfall.section`, with `section_layer` and `section_within`
    [m]) a figure along this line; `factors` (a table as in `rockfall.design`) the requirements of
    a standard. Return the path of the page. Invalid inputs or outputs raise a RockfallError;
    missing terrain gives a UserWarning.

    >>> import rockfall
    >>> result = rockfall.run(rockfall.read_case("case.nml"))
    >>> rockfall.report(result, "report.html").name
    'report.html'
    """
    path = Path(path)
    if view is not None and is_pdf(path):
        raise RockfallError(f"{path}: a PDF has no view in three dimensions")
    line = [section] if isinstance(section, str | Path) else []
    others = [*line, *(data for data in (hazard, models, factors) if data is not None)]
    check_page(path, [*_given(result, dem, observed, basemap), *others])
    catalogue(language)
    zones = None if hazard is None else read_hazard(hazard)
    spread = None if models is None else read_models(models)
    drawn = _drawn(result, dem, observed, basemap, limits)
    if zones is not None:
        check_same_case(drawn.result, zones, str(hazard))
    if spread is not None:
        check_models(drawn.result, spread, str(models))
    checksum = file_checksum(Path(result)) if isinstance(result, str | Path) else ""
    parties = Parties(project, client, author, dem_date, checksum)
    cut = None
    if section is not None:
        cut = _section(drawn.result, drawn.terrain, section, section_layer, section_within)
    shown = "" if view is None else view.page
    inputs = ReportInputs(
        **drawn._asdict(), view=shown, parties=parties, hazard=zones, models=spread, section=cut,
        factors=factors,
    )  # fmt: skip
    write_report(inputs, path, language)
    drawn.warn()
    return path


def report_variants(
    results: Mapping[str, xr.Dataset],
    path: str | Path,
    *,
    dem: Place = None,
    frequencies: pd.DataFrame | None = None,
    costs: Mapping[str, float] = NO_COSTS,
    title: str = "",
    language: str = "en",
    project: str = "",
    client: str = "",
    author: str = "",
) -> Path:
    """Write a comparison of protection variants, given by name, as an offline HTML page or PDF with
    a column for each variant: `compare_variants` at all lines, the measures, and maps of the
    differences.

    `frequencies` is the table from `rockfall.yearly_variants` over the scenarios of a case. `costs`
    are the costs by variant, in any unit. `title` is the page title (default: the first result's
    title). The other arguments are as in `report`. Return the path of the page. Invalid inputs
    raise a RockfallError.

    >>> import rockfall
    >>> case = rockfall.read_case("case.nml")
    >>> net = {"name": "net", "x": [600000.0, 600120.0], "y": [4999950.0, 4999950.0]}
    >>> variant = case.replace(barrier=[net | {"height": 3.0, "class": 4}])
    >>> results = {"bare": rockfall.run(case), "net": rockfall.run(variant)}
    >>> rockfall.report_variants(results, "variants.html", costs={"net": 9e4}).name
    'variants.html'
    """
    path = Path(path)
    catalogue(language)
    terrain = terrain_of(next(iter(results.values())), dem)
    inputs = [file for result in results.values() for file in files_behind(result)]
    parties = Parties(project, client, author)
    given = Given(frequencies, costs, title)
    write_variants_page(results, path, terrain, given, language, parties, inputs)
    return path


def figures(
    result: Result,
    folder: str | Path,
    *,
    format: str = "png",
    dem: Place = None,
    observed: Files = (),
    basemap: Place = None,
    limits: Sequence[str] = (),
) -> list[Path]:
    """Write all figures that a result supports to a folder, as png, pdf or svg. Return the files. A
    result without drawable data raises a RockfallError. The other arguments are as in `report`.

    >>> import rockfall
    >>> result = rockfall.run(rockfall.read_case("case.nml"))
    >>> files = rockfall.figures(result, "figures", format="svg")
    >>> "passing.svg" in [path.name for path in files]
    True
    """
    drawn = _drawn(result, dem, observed, basemap, limits)
    shown = figures_of(*drawn[:4], left=drawn.left)
    inputs = _given(result, dem, observed, basemap)
    drawn.warn()
    if not has_rows(drawn.result):
        need_rows = "require rows of boulders (&output kept), which the result does not have"
        if not shown:
            raise RockfallError(
                f"no figure can be drawn: run-outs, stops and line statistics {need_rows}, and "
                "maps, trajectories and rebounds are not in the result (&output)"
            )
        warnings.warn(
            f"run-outs, stops and line statistics are not drawn: they {need_rows}", stacklevel=1
        )
    return write_figures(shown, folder, format, [*inputs, *files_behind(drawn.result)])


def section(
    result: Result,
    line: Any,
    *,
    layer: str | None = None,
    within: float = 10.0,
    every: float | None = None,
    dem: Place = None,
) -> Section:
    """Compute a section of a result (a Dataset, or its netCDF file) along a drawn line: ground,
    energies, speeds and heights of the boulders within a corridor, and the evaluation lines that
    the section crosses.

    `line` is a list of pairs x, y in the CRS of the terrain, or a file with a single line; choose
    its `layer` if it has several. Boulders within `within` [m] on either side count, at stations
    spaced `every` [m] (default: a round interval that gives about 100 stations). `dem` is as in
    `report`; without terrain, elevations and trajectory heights are unknown. Invalid inputs, and
    results without trajectories and maps of these quantities, raise a RockfallError. Missing
    terrain, or a layer in another CRS, gives a UserWarning.

    >>> import rockfall
    >>> case = rockfall.read_case("case.nml").replace(output={"trajectories": 10})
    >>> result = rockfall.run(case)
    >>> down = [(600060.0, 4999990.0), (600060.0, 4999890.0)]
    >>> found = rockfall.section(result, down, within=20.0, every=10.0)
    >>> found.lines["distance"].tolist()
    [60.0]
    """
    data = read_result(result) if isinstance(result, str | Path) else result
    beside = Path(result).parent if isinstance(result, str | Path) else None
    return _section(data, terrain_of(data, dem, beside), line, layer, within, every)


def _section(
    result: xr.Dataset,
    terrain: Terrain | None,
    line: Any,
    layer: str | None,
    within: float,
    every: float | None = None,
) -> Section:
    remarks: list[str] = []
    vertices = drawn_line(line, layer, _grid(result, terrain), remarks)
    for remark in remarks:
        warnings.warn(remark, stacklevel=2)
    return section_of(result, SectionLine(vertices, within, every), terrain)


def _grid(result: xr.Dataset, terrain: Terrain | None) -> Grid:
    """Grid of a result's terrain, with its CRS; without terrain, the area reached by boulders."""
    if terrain is not None:
        return terrain[1]
    from rasterio.crs import CRS

    west, east, south, north = reached(result)
    cell, wkt = cell_of(result), crs_wkt(result)
    nx, ny = (math.ceil(size / cell) for size in (east - west, north - south))
    return Grid(west, north, cell, nx, ny, CRS.from_wkt(wkt) if wkt else None)


def export_project(
    result: Result,
    folder: str | Path,
    *,
    dem: Place = None,
    hazard: Place = None,
    language: str = "en",
    project: str = "",
    client: str = "",
    author: str = "",
) -> list[Path]:
    """Write a result to `folder` as `export` does, with a QGIS project, project.qgz: styled layers
    in groups, themes, and for each theme an A3 layout with title, legend, scale bar, north arrow,
    coordinate system and date. Return the files written.

    `dem` is the terrain (default: the case's terrain, if its file exists); the part around the
    boulders becomes elevation_m.tif, drawn as relief and contours. `hazard` (a file hazard.nc)
    adds hazard zones and classes. Titles and texts are in `language` (en, de, de-AT ...); layouts
    show `project` (name or number), `client` and `author`. The project uses relative paths, so the
    folder can be moved. Either all files are written or none, with a RockfallError. Missing
    terrain gives a UserWarning.

    >>> import rockfall
    >>> result = rockfall.run(rockfall.read_case("case.nml"))
    >>> rockfall.export_project(result, "gis")[-1].name
    'project.qgz'
    """
    added = Added(True, (), dem, hazard, language, Imprint(project, client, author))
    return export_with(result, folder, added)


def export_tables(
    result: Result,
    folder: str | Path,
    formats: Sequence[str] = ("xlsx", "docx"),
    *,
    language: str = "en",
) -> list[Path]:
    """Write the tables of a result to `folder`: line statistics, return levels, effects of
    barriers, and details of the run. Return the files written.

    tables.xlsx has a sheet for each table, with the numbers of the CSV tables, units, and separate
    columns for the limits of 95 % confidence intervals. tables.docx has the rounded tables of the
    report, with intervals in brackets, in `language` (en, de, de-AT ...). Both need the extra
    `office`. Other `formats` raise a RockfallError.

    >>> import rockfall
    >>> result = rockfall.run(rockfall.read_case("case.nml"))
    >>> [path.name for path in rockfall.export_tables(result, "tables", ["xlsx"])]
    ['tables.xlsx']
    """
    return export_with(result, folder, Added(tables=tuple(formats), language=language), None)


def export_with(
    result: Result, folder: str | Path, added: Added, chosen: Chosen | None = EXPORTED
) -> list[Path]:
    """Write the export `chosen` (None: no export) and the products in `added`: all files or none.
    Return the files."""
    folder, hazard = Path(folder), added.hazard
    if added.tables:
        check_tables(added.tables, added.language)
    if added.project:
        need("a project needs", "report")
        catalogue(added.language)
    given = Path(result) if isinstance(result, str | Path) else None
    data = read_result(result) if isinstance(result, str | Path) else result
    zones = None if hazard is None else read_hazard(hazard)
    if zones is not None:
        check_same_case(data, zones, str(hazard))
        warnings.warn(say("hazard.two_populations"), stacklevel=2)
    beside = given.parent if given else None
    terrain = terrain_of(data, added.dem, beside) if added.project else None
    inputs = [*_given(result, added.dem, (), None), *files_behind(data)]
    inputs += [] if hazard is None else [hazard]
    with atomic_folder(folder, inputs) as part:
        made = [] if chosen is None else put_export(data, part, chosen, result)
        made += [] if zones is None else put_zones(zones, part)
        if added.tables:
            checksum = file_checksum(given) if given else ""
            made += put_tables(data, part, added.tables, added.language, checksum)
        if added.project:
            shown = [path for path in made if path.suffix == ".tif"]
            made += put_project(data, part, shown, terrain, added.imprint, added.language)
        return [folder / path.name for path in made]


def _drawn(
    result: Result, dem: Place, observed: Files, basemap: Place, limits: Sequence[str]
) -> _Drawn:
    """Read all inputs of figures and pages."""
    data = read_result(result) if isinstance(result, str | Path) else result
    left = LeftOut()
    if observed:
        seen = read_observed(*observed, grid=grid_for(data, observed))
    else:
        seen = left.attempt("page.part_observed", site_observations, data)
    beside = Path(result).parent if isinstance(result, str | Path) else None
    terrain = terrain_of(data, dem, beside)
    picture = None if basemap is None else read_basemap(basemap, data, reached(data, terrain))
    return _Drawn(data, terrain, seen, Look(read_limits(limits), picture), left, not observed)


def _given(result: Result, dem: Place, observed: Files, basemap: Place) -> Iterator[str | Path]:
    """The input files given by the user."""
    if isinstance(result, str | Path):
        yield result
    yield from observed
    if basemap is not None:
        yield basemap
    if dem is not None:
        yield from raster_files(dem)
