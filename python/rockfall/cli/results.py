# SPDX-License-Identifier: BSD-3-Clause
"""What is made of a result: files, tables, figures, the page."""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Iterator
from pathlib import Path

from rockfall.analysis.compare import compare, write_comparison
from rockfall.analysis.observations import read_observed
from rockfall.analysis.ranks import rank_results
from rockfall.case_files import files_behind
from rockfall.cli.messages import DONE, warn
from rockfall.errors import RockfallError
from rockfall.html_report import check_page, write_report
from rockfall.io.raster_file import raster_files
from rockfall.plots.figures import figures, write_figures
from rockfall.plots.terrain import terrain_of
from rockfall.result.dataset import read_result
from rockfall.result.export import export
from rockfall.text.comparison import ranks_text, text
from rockfall.text.line_tables import print_lines


def export_command(arguments: argparse.Namespace) -> int:
    print(*export(_path(arguments), arguments.folder), sep="\n")
    return DONE


def compare_command(arguments: argparse.Namespace) -> int:
    paths = [path for path in arguments.files if path.suffix == ".nc"]
    sources = [path for path in arguments.files if path.suffix != ".nc"]
    if not paths or not sources:
        raise RockfallError("compare needs results (.nc) and observations (CSV)")
    results = {str(path): read_result(path) for path in paths}
    if len(results) < len(paths):
        raise RockfallError("compare: a result is given twice")
    seen = read_observed(*sources)
    if len(results) == 1:
        (result,) = results.values()
        found = compare(result, seen)
        table, said = found.table(), text(found)
    else:
        table = rank_results(results, seen)
        said = ranks_text(table)
    if arguments.output:
        behind = (path for result in results.values() for path in files_behind(result))
        write_comparison(table, arguments.output, keep=(*arguments.files, *behind))
    print(said)
    return DONE


def lines_command(arguments: argparse.Namespace) -> int:
    print_lines(_path(arguments), arguments.output)
    return DONE


def figures_command(arguments: argparse.Namespace) -> int:
    result, terrain, observed = _shown(arguments)
    shown, inputs = figures(result, terrain, observed), [*_given(arguments), *files_behind(result)]
    print(*write_figures(shown, arguments.folder, arguments.format, inputs), sep="\n")
    return DONE


def report_command(arguments: argparse.Namespace) -> int:
    given = _path(arguments)
    path = arguments.output or given.with_name(f"{given.name.removesuffix('.nc')}.html")
    check_page(path, _given(arguments))
    result, terrain, observed = _shown(arguments)
    write_report(result, path, terrain, observed)
    print(path)
    return DONE


def _path(arguments: argparse.Namespace) -> Path:
    """That of the result."""
    return getattr(arguments, "out.nc")


def _given(arguments: argparse.Namespace) -> Iterator[str | Path]:
    """The files that a command which draws a result is given."""
    yield _path(arguments)
    yield from arguments.observed or ()
    if arguments.dem:
        yield from raster_files(arguments.dem)


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
