# SPDX-License-Identifier: BSD-3-Clause
"""Export of a result or hazard; the code for projects and tables is only imported on request."""

import argparse
from importlib import import_module
from pathlib import Path

from rockfall.cli.given import given_options
from rockfall.cli.messages import DONE, print_files, warnings_told
from rockfall.cli.result_warnings import warn_of_results
from rockfall.errors import RockfallError
from rockfall.files.export import Chosen, export
from rockfall.files.hazard_files import DRAWINGS, export_hazard, in_folder, is_hazard
from rockfall.simulation.progress import working


def export_command(arguments: argparse.Namespace) -> int:
    path, folder = in_folder(getattr(arguments, "out.nc")), arguments.folder
    imprint = {key: getattr(arguments, key) for key in ("project", "client", "author")}
    chosen = Chosen(**given_options(arguments, ("formats", "tolerance")))
    added = {"dem": arguments.dem, "hazard": arguments.hazard, **imprint}
    for key, value in added.items():
        if value and not arguments.qgis:
            raise RockfallError(f"--{key} requires --qgis")
    with warnings_told(), working():
        if is_hazard(path):
            files = _export_hazard(arguments, path, folder)
        elif arguments.qgis or arguments.tables:
            products = import_module("rockfall.products")
            project = products.Added(
                arguments.qgis, arguments.tables, arguments.dem, arguments.hazard,
                arguments.language, products.Imprint(**imprint),
            )  # fmt: skip
            files = products.export_with(path, folder, project, chosen)
        else:
            files = export(path, folder, **chosen._asdict())
    warn_of_results(path)
    print_files(files)
    return DONE


def _export_hazard(arguments: argparse.Namespace, path: Path, folder: Path) -> list[Path]:
    """Export a hazard as drawings; refuses options for trajectories, tables or projects."""
    for key, why in (
        ("tolerance", "is only valid for trajectories, which a hazard lacks"),
        ("qgis", "is only valid for results: export a result with --hazard"),
        ("tables", "is only valid for results"),
    ):
        if getattr(arguments, key):
            raise RockfallError(f"--{key}: {why}")
    return export_hazard(path, folder, arguments.formats or DRAWINGS)
