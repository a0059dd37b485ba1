# SPDX-License-Identifier: BSD-3-Clause
"""What is made of a result: files, tables, figures, the page."""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from rockfall.analysis.compare import compare, write_comparison
from rockfall.analysis.hazard.files import read_hazard
from rockfall.analysis.observations import read_observed
from rockfall.case_files import files_behind
from rockfall.cli.messages import DONE, warn
from rockfall.errors import RockfallError
from rockfall.html_report import check_page, write_report
from rockfall.html_report.inputs import Parties
from rockfall.html_report.language import catalogue
from rockfall.html_report.terrain_view import check_view
from rockfall.io.raster_file import raster_files
from rockfall.plots.cartography.basemap import read_basemap
from rockfall.plots.extent import reached
from rockfall.plots.figures import figures, write_figures
from rockfall.plots.map_figures import Look
from rockfall.plots.terrain import terrain_of
from rockfall.result.classes import read_limits
from rockfall.result.dataset import read_result
from rockfall.result.export import export
from rockfall.text.comparison import text
from rockfall.text.line_tables import print_lines

if TYPE_CHECKING:
    import xarray as xr

    from rockfall.result.trajectories import Terrain


def export_command(arguments: argparse.Namespace) -> int:
    print(*export(_path(arguments), arguments.folder), sep="\n")
    return DONE


def compare_command(arguments: argparse.Namespace) -> int:
    path, sources = _path(arguments), arguments.observed
    result = read_result(path)
    found = compare(result, *sources)
    if arguments.output:
        write_comparison(found, arguments.output, keep=(path, *sources, *files_behind(result)))
    print(text(found))
    return DONE


def lines_command(arguments: argparse.Namespace) -> int:
    print_lines(_path(arguments), arguments.output)
    return DONE


def figures_command(arguments: argparse.Namespace) -> int:
    result, terrain, observed = _shown(arguments)
    look = _look(arguments, result, terrain)
    shown, inputs = (
        figures(result, terrain, observed, look),
        [*_given(arguments), *files_behind(result)],
    )
    print(*write_figures(shown, arguments.folder, arguments.format, inputs), sep="\n")
    return DONE


def report_command(arguments: argparse.Namespace) -> int:
    given = _path(arguments)
    ending = ".pdf" if arguments.pdf else ".html"
    path = arguments.output or given.with_name(f"{given.name.removesuffix('.nc')}{ending}")
    if arguments.pdf and path.suffix.lower() != ending:
        raise RockfallError(f"{path}: is no name for a PDF; it must end in .pdf")
    check_page(path, _given(arguments))
    catalogue(arguments.language)
    if arguments.view:
        check_view()
    result, terrain, observed = _shown(arguments)
    look = _look(arguments, result, terrain)
    parties = Parties(arguments.project, arguments.client, arguments.author, arguments.dem_date)
    hazard = read_hazard(arguments.hazard) if arguments.hazard else None
    write_report(
        result, path, terrain, observed, look, arguments.view, arguments.language, parties, hazard
    )
    print(path)
    return DONE


def _path(arguments: argparse.Namespace) -> Path:
    """That of the result."""
    return getattr(arguments, "out.nc")


def _given(arguments: argparse.Namespace) -> Iterator[str | Path]:
    """The files that a command which draws a result is given."""
    yield _path(arguments)
    yield from arguments.observed or ()
    if arguments.basemap:
        yield arguments.basemap
    if getattr(arguments, "hazard", None):
        yield arguments.hazard
    if arguments.dem:
        yield from raster_files(arguments.dem)


def _look(arguments: argparse.Namespace, result: xr.Dataset, terrain: Terrain | None) -> Look:
    """What the user chooses of maps."""
    basemap, limits = arguments.basemap, read_limits(arguments.limits or ())
    extent = reached(result, terrain)
    return Look(limits, read_basemap(basemap, result, extent) if basemap else None)


def _shown(arguments: argparse.Namespace) -> tuple:
    """The result, its terrain and the observations that a command is to draw."""
    result = read_result(_path(arguments))
    observed = read_observed(*arguments.observed) if arguments.observed else None
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always", UserWarning)
        terrain = terrain_of(result, arguments.dem)
    for warning in said:
        warn(str(warning.message))
    return result, terrain, observed
