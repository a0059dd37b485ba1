# SPDX-License-Identifier: BSD-3-Clause
"""Pages, figures and sections of a result."""

import argparse
import itertools
import math
import re
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

from rockfall.case.files import files_behind
from rockfall.cli.given import given_options
from rockfall.cli.messages import DONE, warnings_told
from rockfall.cli.result_warnings import warn_of_results
from rockfall.errors import RockfallError, need
from rockfall.files.hazard_files import in_folder, is_hazard
from rockfall.io.atomic import atomic_folder
from rockfall.io.output_files import check_output
from rockfall.io.tables import plain_decimal
from rockfall.plots.section_figure import section_figure
from rockfall.plots.style import FORMATS, save
from rockfall.products import figures, report, section
from rockfall.result.dataset import open_result
from rockfall.simulation.progress import working
from rockfall.table import write_csv
from rockfall.tables.section import section_data, section_text

IMPRINT = ("language", "project", "client", "author")  # options of a page
SECTION = ("section_layer", "section_within")  # options of a report with a section
REPORTED = (*IMPRINT, "dem_date", "hazard", "models", "factors")  # options of a report
TABLE = ".csv"
ENDINGS = [TABLE, *(f".{form}" for form in FORMATS)]  # of a section


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
    """Write the dossier page of a hazard; refuses options for results and, with `--pdf`, names not
    ending in .pdf."""
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
        report_hazard = import_module("rockfall.dossiers").report_hazard
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


def section_command(arguments: argparse.Namespace) -> int:
    path: Path = getattr(arguments, "out.nc")
    need("a section needs", "report")
    line = drawn(arguments.line, "--line")
    places = _places(arguments.output or Path(f"{path.name.removesuffix('.nc')}_section.csv"))
    with open_result(path) as data:
        inputs = [path, *files_behind(data), *([line] if isinstance(line, Path) else [])]
    for place in places:
        check_output(place, inputs)
    given = given_options(arguments, ("within", "every"))
    with warnings_told() as told:
        cut = section(path, line, layer=arguments.line_layer, dem=arguments.dem, **given)
    table, lines, picture = places
    with atomic_folder(table.parent, inputs) as part:
        write_csv(section_data(cut.table), part / table.name)
        write_csv(section_data(cut.lines), part / lines.name)
        save(section_figure(cut), part / picture.name)
    warn_of_results(path, told=told)
    print(section_text(cut))
    print(*places, sep="\n")
    return DONE


def drawn(given: Sequence[str], option: str) -> Path | list[tuple[float, float]]:
    """Path of a file with a section's line, or the vertices of the line from pairs X,Y. Refuses
    anything else."""
    words = " ".join(given).split()
    pairs = [tuple(map(plain_decimal, word.split(","))) for word in words if word.count(",") == 1]
    if len(pairs) == len(words) > 1 and all(map(math.isfinite, itertools.chain(*pairs))):
        return [(x, y) for x, y in pairs]
    numbers = [plain_decimal(text) for text in re.split(r"[,;\s]+", " ".join(given)) if text]
    if len(given) == 1 and (not all(map(math.isfinite, numbers)) or Path(given[0]).exists()):
        return Path(given[0])
    raise RockfallError(
        f"{option} {' '.join(given)}: must be X,Y X,Y ... (two vertices or more, separated by "
        "spaces), or a file with one line"
    )


def _places(output: Path) -> list[Path]:
    """Files of a section: tables, and the figure in the format of the output. Refuses unknown
    formats."""
    ending = output.suffix.lower()
    if ending not in ENDINGS:
        raise RockfallError(f"{output}: output name must end in {', '.join(ENDINGS)}")
    figure = output if ending != TABLE else output.with_suffix(".png")
    return [
        output if ending == TABLE else output.with_suffix(TABLE),
        output.with_name(f"{output.stem}_lines{TABLE}"),
        figure,
    ]
