# SPDX-License-Identifier: BSD-3-Clause
"""Tables of the lines of a result or hazard, on the terminal and as files."""

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import xarray as xr

from rockfall.analysis.hazard.levels import period_table
from rockfall.analysis.line_statistics import line_statistics
from rockfall.analysis.lines.profile import line_profile
from rockfall.analysis.lines.samples import worst_lines
from rockfall.analysis.return_levels import return_levels
from rockfall.case.files import files_behind
from rockfall.cli.messages import DONE
from rockfall.cli.result_warnings import warn_of_results
from rockfall.errors import RockfallError
from rockfall.files.hazard_files import in_folder, is_hazard, read_hazard
from rockfall.io.atomic import atomic_folder
from rockfall.io.output_files import check_output
from rockfall.io.tables import write_csv
from rockfall.plots.along_figures import line_profile_figure
from rockfall.plots.style import save
from rockfall.result.crossings import MOST_LINES, line_names
from rockfall.result.dataset import read_result
from rockfall.simulation.progress import add_steps, working
from rockfall.tables.hazard import places_of
from rockfall.text.lines import groups_text, hazard_text, lines_text, profile_text


def lines_command(arguments: argparse.Namespace) -> int:
    path, by, along, table = (
        in_folder(getattr(arguments, "out.nc")),
        arguments.by,
        arguments.along,
        arguments.output,
    )
    for option, value, needed in (
        ("--classes", arguments.classes, by == "volume" or "--by volume"),
        ("--width", arguments.width, along is not None or "--along"),
        ("--by", by, along is None or "no --along"),
    ):
        if value is not None and needed is not True:
            raise RockfallError(f"{option}: needs {needed}")
    if is_hazard(path):
        for option, value in (("--by", by), ("--along", along)):
            if value is not None:
                raise RockfallError(
                    f"{option}: is only valid for results OUT.nc: a hazard has no single boulders"
                )
        _print_hazard(path, table)
    elif by is not None:
        result, places = _open(path, table, "")
        statistics = line_statistics(result, by, _edges(arguments.classes))
        print(groups_text(statistics, by, result))
        _write(path, result, dict(zip(places, [statistics], strict=False)))
    elif along is not None:
        _print_profile(path, along, arguments.width, table)
    else:
        with working():
            _print_lines(path, table)
    warn_of_results(path)
    return DONE


def _edges(given: str | None) -> list[float] | None:
    """Class edges [m3] from numbers separated by commas; refuses texts that are not numbers."""
    if given is None:
        return None
    try:
        return [float(edge) for edge in given.split(",")]
    except ValueError as error:
        what = "must be volumes [m3] separated by commas, such as 0.1,0.5,1"
        raise RockfallError(f"--classes {given}: {what}") from error


def _print_lines(path: str | Path, table: str | Path | None = None) -> None:
    """Print line statistics and return levels (without `table`: of the worst MOST_LINES lines).
    `table` is a CSV file for the statistics; NAME_levels.csv next to it gets the levels."""
    result, places = _open(path, table, "", "_levels.csv")
    shown = None if table else worst_lines(result, MOST_LINES)
    add_steps(2 * len(line_names(result) if shown is None else shown))
    statistics, levels = line_statistics(result, lines=shown), return_levels(result, lines=shown)
    print(lines_text(statistics, levels, result))
    _write(path, result, dict(zip(places, [statistics, levels], strict=False)))


def _print_hazard(path: str | Path, table: str | Path | None = None) -> None:
    """Print frequencies, energies and heights by return period at the lines, objects and
    segments of a hazard. If `table`, a CSV file, is given, write energies and heights to it.
    Refuses hazards without such places."""
    place, hazard = table and _csv(Path(table)), read_hazard(path)
    if not places_of(hazard):
        raise RockfallError(f"{path}: has no lines, objects or segments")
    if place:
        check_output(place, [Path(path), *files_behind(hazard)])
    print(hazard_text(hazard))
    if place:
        write_csv(period_table(hazard), place)
        print(place)


def _print_profile(
    path: str | Path, line: str, width: float | None = None, table: str | Path | None = None
) -> None:
    """Print the boulders that pass each window of a line. If `table`, a CSV file, is given, write
    them to it, and a figure next to it as NAME.png."""
    result, places = _open(path, table, "", ".png")
    profile = line_profile(result, line, width)
    print(profile_text(profile, line, result))
    made = [profile, lambda part: save(line_profile_figure(profile), part)]
    _write(path, result, dict(zip(places, made, strict=False)))


def _open(
    path: str | Path, table: str | Path | None, *endings: str
) -> tuple[xr.Dataset, list[Path]]:
    """Result with lines, and the paths of its tables: `table` for the suffix "", and files of the
    same name with other suffixes. Raises a RockfallError, before the work starts, for a result
    without lines and for paths that cannot be written. Without `table` there are no paths."""
    first = table and _csv(Path(table))
    result = read_result(path)
    if not line_names(result):
        raise RockfallError(f"{path}: has no evaluation lines")
    if not first:
        return result, []
    places = [first.with_name(first.stem + (end or first.suffix)) for end in endings]
    for place in places:
        check_output(place, [Path(path), *files_behind(result)])
    return result, places


def _write(path: str | Path, result: xr.Dataset, made: Mapping[Path, Any]) -> None:
    """Write tables, or call functions that write to a path: all or none; print the paths."""
    if not made:
        return
    with atomic_folder(next(iter(made)).parent, [Path(path), *files_behind(result)]) as part:
        for place, table in made.items():
            table(part / place.name) if callable(table) else write_csv(table, part / place.name)
    print(*made, sep="\n")


def _csv(path: Path) -> Path:
    if path.suffix.lower() != ".csv":
        raise RockfallError(f"{path}: output name must end in .csv")
    return path
