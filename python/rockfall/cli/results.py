# SPDX-License-Identifier: BSD-3-Clause
"""What is made of a result: files, tables, figures, the page."""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Iterator
from pathlib import Path

from rockfall.analysis.compare import compare, write_comparison
from rockfall.analysis.observations import read_observed
from rockfall.case_files import files_behind
from rockfall.cli.messages import DONE, warn
from rockfall.errors import RockfallError
from rockfall.html_report import check_page, write_report
from rockfall.io.raster_file import raster_files
from rockfall.plots.figures import figures, write_figures
from rockfall.plots.terrain import terrain_of
from rockfall.result.dataset import read_result
from rockfall.result.export import export
from rockfall.text.comparison import text
from rockfall.text.line_details import print_groups, print_profile
from rockfall.text.line_tables import print_lines


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
    path, by, along, table = _path(arguments), arguments.by, arguments.along, arguments.output
    for option, value, needed in (
        ("--classes", arguments.classes, by == "volume" or "--by volume"),
        ("--width", arguments.width, along is not None or "--along"),
        ("--by", by, along is None or "to be without --along"),
    ):
        if value is not None and needed is not True:
            raise RockfallError(f"{option}: needs {needed}")
    if by is not None:
        print_groups(path, by, _edges(arguments.classes), table)
    elif along is not None:
        print_profile(path, along, arguments.width, table)
    else:
        print_lines(path, table)
    return DONE


def _edges(given: str | None) -> list[float] | None:
    """Numbers between commas."""
    if given is None:
        return None
    try:
        return [float(one) for one in given.split(",")]
    except ValueError as error:
        what = "must be volumes [m3] between commas, as 0.1,0.5,1"
        raise RockfallError(f"--classes {given}: {what}") from error


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
