# SPDX-License-Identifier: BSD-3-Clause
"""What is made of a result: files, tables, figures, the page."""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rockfall.analysis.compare import compare, write_comparison
from rockfall.case_files import files_behind
from rockfall.cli.messages import DONE, warn
from rockfall.products import figures, report
from rockfall.result.dataset import read_result
from rockfall.result.export import export
from rockfall.text.comparison import text
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
    print_lines(_path(arguments), arguments.output)
    return DONE


def figures_command(arguments: argparse.Namespace) -> int:
    with _warnings_told():
        files = figures(
            _path(arguments), arguments.folder, format=arguments.format, **_beside(arguments)
        )
    print(*files, sep="\n")
    return DONE


def report_command(arguments: argparse.Namespace) -> int:
    given = _path(arguments)
    path = arguments.output or given.with_name(f"{given.name.removesuffix('.nc')}.html")
    with _warnings_told():
        print(report(given, path, **_beside(arguments)))
    return DONE


def _path(arguments: argparse.Namespace) -> Path:
    """That of the result."""
    return getattr(arguments, "out.nc")


def _beside(arguments: argparse.Namespace) -> dict[str, Any]:
    """What is drawn with a result."""
    return {"dem": arguments.dem, "observed": arguments.observed or ()}


@contextmanager
def _warnings_told() -> Iterator[None]:
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("ignore")  # of the packages below us
        warnings.filterwarnings("always", module=r"rockfall\.products")
        yield
    for warning in said:
        warn(str(warning.message))
