# SPDX-License-Identifier: BSD-3-Clause
"""First inputs of a project: `rockfall dem` and `rockfall new`."""

import argparse
import sys
from collections.abc import Iterable, Iterator

import numpy as np

from rockfall.cli.given import given_options
from rockfall.cli.messages import DONE, warn
from rockfall.draft.dem import (
    Dem,
    Survey,
    check_place,
    dem_of_points,
    edited,
    read_source,
    write_dem,
)
from rockfall.draft.grounds import GROUNDS
from rockfall.draft.new_case import new_case
from rockfall.draft.observed import check_angle
from rockfall.errors import RockfallError
from rockfall.importers.avaframe import import_avaframe
from rockfall.importers.imported import CASE
from rockfall.importers.platrock import import_platrock
from rockfall.io.rasters.ascii_grid import is_ascii_grid
from rockfall.io.vectors.point_clouds import is_cloud
from rockfall.rockyfor3d.imported import import_rockyfor3d

OF_POINTS = ("cell", "power", "neighbours", "within", "crs", "classes", "thin")


def new_command(arguments: argparse.Namespace) -> int:
    usual, by_zone = _grounds(arguments.ground or ())
    ask = _ask if sys.stdin.isatty() else None
    new = new_case(
        arguments.dem, arguments.layers, arguments.output, usual, by_zone, ask,
        arguments.energy_line_angle, arguments.shadow_angle, _ask_angle if ask else None,
    )  # fmt: skip
    for line in new.remarks:
        warn(line)
    print(*new.notes, sep="\n", end="\n" if new.notes else "")
    print(f"{new.sources:,} sources, {new.boulders:,} boulders in total")
    print(arguments.output)
    return DONE


def _grounds(options: Iterable[str]) -> tuple[str, dict[str, str]]:
    """Default ground, and grounds by zone, from `--ground [ZONE=]GROUND`; refuses repeated
    zones or defaults."""
    usual, by_zone = "", {}
    for option in options:
        zone, equals, ground = option.rpartition("=")
        if (zone in by_zone) if equals else usual:
            raise RockfallError(f"--ground {option}: given twice")
        if equals:
            by_zone[zone] = ground
        else:
            usual = ground
    return usual, by_zone


def _ask_angle(key: str) -> float | None:
    """Read the observed angle [degree] for a key from the terminal; None if it is not known."""
    name = key.removesuffix("_angle").replace("_", "-")
    text = f"Lowest {name} angle observed at the site or in the region [degree]?"
    print(text, file=sys.stderr)
    while True:
        try:
            answer = input("number, or Enter if unknown: ").strip()
        except EOFError:
            return None
        if not answer:
            return None
        try:
            angle = float(answer)
            check_angle(key, angle)
            return angle
        except ValueError as error:
            print(error, file=sys.stderr)


def _ask(what: str) -> str:
    """Read a ground from the terminal, by number or name; "" at the end of input."""
    print(f"What would a boulder hit? Ground of {what}:", file=sys.stderr)
    for number, (name, (meaning, _)) in enumerate(GROUNDS.items(), start=1):
        print(f"  {number} {name:<15} {meaning}", file=sys.stderr)
    names = [*GROUNDS]
    while True:
        try:
            answer = input("number or name: ").strip()
        except EOFError:
            return ""
        if answer.isdecimal() and 1 <= int(answer) <= len(names):
            return names[int(answer) - 1]
        if answer in names:
            return answer


def dem_command(arguments: argparse.Namespace) -> int:
    sources, steps = arguments.input, arguments.steps or []
    check_place(arguments.output, sources, steps)
    remarks: list[str] = []
    dem = edited(_source(arguments, remarks), steps, remarks)
    for line in remarks:
        warn(line)
    write_dem(dem, arguments.output, sources, _options(arguments))
    nonzero = np.count_nonzero(~np.isnan(dem.z))
    print(
        f"{dem.grid.nx} x {dem.grid.ny} cells of {dem.grid.cell:g} m, {nonzero:,} with an elevation"
    )
    print(arguments.output)
    return DONE


def _source(arguments: argparse.Namespace, remarks: list[str]) -> Dem:
    """Elevations from a raster or from points; print the properties of the points. Refuses options
    for the other kind."""
    given = given_options(arguments, OF_POINTS)
    path, *others = arguments.input
    if not (is_cloud(path) or path.suffix.lower() in (".csv", ".txt")) or is_ascii_grid(path):
        crs = given.pop("crs", None)
        for key in given:
            raise RockfallError(
                f"--{key}: is only valid for points (.csv, .las ...), but {path} is a raster"
            )
        if others:
            raise RockfallError(f"{path}: is a raster: only one raster can be edited")
        if not arguments.steps and crs is None:
            raise RockfallError(f"{path}: give at least one edit: see rockfall dem --help")
        return read_source(path, crs, remarks)
    dem, survey = dem_of_points(*arguments.input, **given)
    remarks += survey.remarks
    print(*(_nodes(survey, dem) if survey.nodes else _points(survey)), sep="\n")
    return dem


def _points(survey: Survey) -> Iterator[str]:
    """Text lines about interpolated points."""
    yield f"{survey.points:,} points, {survey.spacing:.3g} m apart"
    few = len(survey.errors) < survey.points
    total = f" of {len(survey.errors):,}" if few else ""
    if np.isnan(survey.errors).all():
        yield "standard error: unknown, because no two points are close enough"
        return
    yield (
        f"standard error, each point{total} left out: {survey.standard_error:.3g} m "
        f"(bias {np.nanmean(survey.errors):+.3g} m, max {np.nanmax(abs(survey.errors)):.3g} m)"
    )


def _nodes(survey: Survey, dem: Dem) -> Iterator[str]:
    """Text lines about points that are the nodes of a regular grid."""
    assert survey.nodes is not None
    grid, gaps, shared = survey.nodes.grid, survey.nodes.gaps, survey.nodes.shared
    yield (
        f"{survey.points:,} points are nodes of a grid of {grid.nx} x {grid.ny}, "
        f"{grid.cell:g} m apart"
    )
    if dem.grid.matches(grid):
        yield (
            "nodes used unchanged as cell centres (corner of the grid "
            f"{dem.grid.west:.10g}, {dem.grid.north:.10g})"
        )
    else:
        yield f"interpolated bilinearly at the centres of cells of {dem.grid.cell:g} m"
    if shared:
        yield f"{shared:,} nodes have several points of different elevation: their mean is used"
    if gaps:
        yield f"{gaps:,} nodes without a point are nodata: --within M or --fill M fills them"


def _options(arguments: argparse.Namespace) -> Iterator[str]:
    """Command-line options, for the history of the file."""
    for key in OF_POINTS:
        if (value := getattr(arguments, key)) is not None:
            yield from (f"--{key}", *map(str, value if isinstance(value, list) else [value]))
    for name, value in arguments.steps or ():
        yield from (f"--{name}", str(value))


def import_rockyfor3d_command(arguments: argparse.Namespace) -> int:
    notes = import_rockyfor3d(arguments.dir, arguments.output, crs=arguments.crs)
    print("not imported, or imported with changes:", *(f"  {note}" for note in notes), sep="\n")
    print(arguments.output / CASE)
    return DONE


def import_platrock_command(arguments: argparse.Namespace) -> int:
    lists = import_platrock(arguments.dir, arguments.output, crs=arguments.crs)
    return _print_import(lists, arguments)


def import_avaframe_command(arguments: argparse.Namespace) -> int:
    lists = import_avaframe(
        arguments.dir, arguments.output, ground=arguments.ground or "", crs=arguments.crs,
        no_forest=arguments.no_forest, ask=_ask if sys.stdin.isatty() else None,
    )  # fmt: skip
    return _print_import(lists, arguments)


def _print_import(lists: dict[str, list[str]], arguments: argparse.Namespace) -> int:
    for head, lines in lists.items():
        print(f"{head}:", *(f"  {line}" for line in lines), sep="\n")
    print(arguments.output / CASE)
    return DONE
