# SPDX-License-Identifier: BSD-3-Clause
"""Products of a result: files, tables, figures, report page."""

import argparse
import math
from importlib import import_module
from pathlib import Path
from typing import Any

import xarray as xr

from rockfall.analysis.observed.compare import compare, observed_files
from rockfall.analysis.observed.deposits import grid_for
from rockfall.analysis.observed.observations import read_observed
from rockfall.analysis.observed.ranks import rank_results
from rockfall.case import case_of
from rockfall.case.files import files_behind
from rockfall.cli.commands.section import drawn
from rockfall.cli.given import given_options, warn_of_results
from rockfall.cli.messages import DONE, print_files, warnings_told
from rockfall.dossiers import report_hazard
from rockfall.errors import RockfallError
from rockfall.files.export import Chosen, export
from rockfall.files.hazard_files import DRAWINGS, export_hazard, in_folder, is_hazard
from rockfall.io.output_files import check_output
from rockfall.io.tables import plain_decimal, write_csv
from rockfall.plots.hazard.hazard_sheet import Imprint
from rockfall.products import Added, export_with, figures, report, report_variants
from rockfall.result.dataset import read_result
from rockfall.simulation.progress import working
from rockfall.studies.difference_maps import difference_maps, write_variants
from rockfall.studies.variants import compare_variants
from rockfall.tables.comparison import comparison_text, ranks_text
from rockfall.tables.variants import comparison_notes, variants_text

IMPRINT = ("language", "project", "client", "author")  # options of a page
SECTION = ("section_layer", "section_within")  # options of a report with a section
REPORTED = (*IMPRINT, "dem_date", "hazard", "models", "factors")  # options of a report


def export_command(arguments: argparse.Namespace) -> int:
    path, folder, imprint = _path(arguments), arguments.folder, _imprint(arguments)
    chosen = Chosen(**given_options(arguments, ("formats", "tolerance")))
    added = {"dem": arguments.dem, "hazard": arguments.hazard, **imprint._asdict()}
    for key, value in added.items():
        if value and not arguments.qgis:
            raise RockfallError(f"--{key} requires --qgis")
    with warnings_told(), working():
        if is_hazard(path):
            files = _export_hazard(arguments, path, folder)
        elif arguments.qgis or arguments.tables:
            files = export_with(
                path,
                folder,
                Added(arguments.qgis, arguments.tables, arguments.dem, arguments.hazard,
                      arguments.language, imprint),
                chosen,
            )  # fmt: skip
        else:
            files = export(path, folder, **chosen._asdict())
    if not is_hazard(path):
        warn_of_results(path)
    print_files(files)
    return DONE


def _export_hazard(arguments: argparse.Namespace, path: Path, folder: Path) -> list[Path]:
    """Export a hazard as drawings; it has no trajectories, tables or project."""
    for key, why in (
        ("tolerance", "is only valid for trajectories, which a hazard lacks"),
        ("qgis", "is only valid for results: export a result with --hazard"),
        ("tables", "is only valid for results"),
    ):
        if getattr(arguments, key):
            raise RockfallError(f"--{key}: {why}")
    return export_hazard(path, folder, arguments.formats or DRAWINGS)


def _imprint(arguments: argparse.Namespace) -> Imprint:
    return Imprint(arguments.project, arguments.client, arguments.author)


def compare_command(arguments: argparse.Namespace) -> int:
    paths = [path for path in arguments.files if path.suffix == ".nc"]
    sources = [path for path in arguments.files if path.suffix != ".nc"]
    results = {str(path): read_result(path) for path in paths}
    if len(arguments.files) == 1 and paths:
        sources = observed_files(case_of(results[str(paths[0])]))
    if not paths or len(paths) + len(sources) < 2:
        raise RockfallError("compare needs results (.nc) and observations (CSV), or variants (.nc)")
    if len(results) < len(paths):
        raise RockfallError("compare: a result is given twice")
    if not sources:
        return _compare_variants(results, arguments)
    for option in ("maps", "report"):
        if getattr(arguments, option):
            raise RockfallError(f"--{option} requires variants: results without observations")
    seen = read_observed(*sources, grid=grid_for(next(iter(results.values())), sources))
    if len(results) == 1:
        (result,) = results.values()
        comparison = compare(result, seen)
        table, report = comparison.table(), comparison_text(comparison)
    else:
        table = rank_results(results, seen)
        report = "\n".join([ranks_text(table), *seen.notes])
    if arguments.output:
        behind = (path for result in results.values() for path in files_behind(result))
        check_output(arguments.output, (*arguments.files, *sources, *behind))
        write_csv(table, arguments.output)
    warn_of_results(*paths)
    print(report)
    return DONE


def _compare_variants(results: dict[str, xr.Dataset], arguments: argparse.Namespace) -> int:
    names = [Path(path).stem for path in results]
    if len({*names}) < len(names):
        raise RockfallError("compare: variants need different file names")
    variants = dict(zip(names, results.values(), strict=True))
    if arguments.costs and not arguments.report:
        raise RockfallError("--costs requires --report")
    table = compare_variants(variants)
    inputs = [
        *arguments.files,
        *(path for result in results.values() for path in files_behind(result)),
    ]
    if arguments.output:
        check_output(arguments.output, inputs)
        write_csv(table, arguments.output)
    if arguments.maps:
        write_variants(table, difference_maps(variants), arguments.maps, inputs)
    if arguments.report:
        costs = dict(map(_cost, arguments.costs))
        named = {name: getattr(arguments, name) for name in IMPRINT}
        check_output(arguments.report, inputs)
        with warnings_told():
            report_variants(variants, arguments.report, costs=costs, **named)
    warn_of_results(*map(Path, results))
    print(variants_text(table, "\n".join(comparison_notes(variants))))
    return DONE


def _cost(given: str) -> tuple[str, float]:
    """Variant and cost from NAME=AMOUNT."""
    name, _, amount = given.rpartition("=")
    if not name or math.isnan(cost := plain_decimal(amount)):
        raise RockfallError(f"--costs {given}: must be NAME=AMOUNT")
    return name, cost


def figures_command(arguments: argparse.Namespace) -> int:
    with warnings_told() as told, working():
        files = figures(
            _path(arguments), arguments.folder, format=arguments.format, **_beside(arguments)
        )
    warn_of_results(_path(arguments), told=told)
    print(*files, sep="\n")
    return DONE


def report_command(arguments: argparse.Namespace) -> int:
    given = _path(arguments)
    if is_hazard(given):
        return _report_hazard(arguments, given)
    ending = ".pdf" if arguments.pdf else ".html"
    path = arguments.output or given.with_name(f"{given.name.removesuffix('.nc')}{ending}")
    if arguments.pdf and path.suffix.lower() != ending:
        raise RockfallError(f"{path}: output name must end in .pdf")
    with warnings_told(), working():
        named = {key: getattr(arguments, key) for key in REPORTED}
        if arguments.section:
            named["section"] = drawn(arguments.section, "--section")
            named |= {key: getattr(arguments, key) for key in SECTION}
        view = None
        if arguments.view:
            view = import_module("rockfall.app.show").show(given, arguments.language)
        print(report(given, path, view=view, **named, **_beside(arguments)))
    return DONE


def _report_hazard(arguments: argparse.Namespace, given: Path) -> int:
    """Write the dossier page of a hazard."""
    ending = ".pdf" if arguments.pdf else ".html"
    path = arguments.output or given.with_suffix(ending)
    if arguments.pdf and path.suffix.lower() != ending:
        raise RockfallError(f"{path}: output name must end in .pdf")
    for key in ("observed", "basemap", "limits", "section", "view", "models", "factors", "hazard"):
        if getattr(arguments, key):
            option = "3d" if key == "view" else key
            raise RockfallError(
                f"--{option} is only valid for results OUT.nc: a hazard has no single boulders"
            )
    named = {key: getattr(arguments, key) for key in IMPRINT}
    with warnings_told(), working():
        print(report_hazard(given, path, dem=arguments.dem, **named))
    return DONE


def _path(arguments: argparse.Namespace) -> Path:
    """Path of a result, or of the hazard in a folder."""
    return in_folder(getattr(arguments, "out.nc"))


def _beside(arguments: argparse.Namespace) -> dict[str, Any]:
    """Arguments of figures and reports: DEM, observations, basemap, class limits."""
    return {
        "dem": arguments.dem,
        "observed": arguments.observed or (),
        "basemap": arguments.basemap,
        "limits": arguments.limits or (),
    }
