# SPDX-License-Identifier: BSD-3-Clause
"""The arguments of every command."""

from __future__ import annotations

import argparse
import functools
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any, NoReturn

from rockfall.errors import RockfallError

_Commands = argparse._SubParsersAction  # no public name in argparse
_RULES = "'speed.mean@EL1<2%%, energy_total.q95@EL1<5%%, fraction@EL1<3%%'"


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise RockfallError(f"{message}; see {self.prog} --help")


class _Step(argparse.Action):
    """An edit, stored with the others in the order of the command line."""

    def __call__(self, parser: Any, namespace: Any, value: Any, option: str | None = None) -> None:
        steps = [*(getattr(namespace, self.dest) or []), (str(option).lstrip("-"), value)]
        setattr(namespace, self.dest, steps)


class _Version(argparse.Action):
    """Option `--version`, whose value is looked up only when requested."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        print(f"rockfall {import_module('rockfall.version').__version__}")
        parser.exit()


def _add(
    commands: _Commands, module: str, name: str, does: str, what: str = "", writes: bool = True
) -> _Parser:
    """Add a command from a module in this folder that reads one file, `what`; most commands may
    replace their earlier output, and take one variant of a case."""
    parser = commands.add_parser(name, help=does, description=does[0].upper() + does[1:] + ".")
    if what:
        parser.add_argument(what.lower(), metavar=what, type=Path)
    if what == "CASE" and name != "variants":
        text = "of a case with &variant groups, the one of this name; base: without them"
        parser.add_argument("--variant", metavar="NAME", help=text)
    if writes:
        _add_overwrite(parser)
    parser.set_defaults(command=_command(module, name.replace("-", "_")))
    return parser


def _add_overwrite(command: argparse.ArgumentParser) -> None:
    text = "replace existing files, never inputs; default: refuse"
    command.add_argument("--overwrite", action="store_true", help=text)


def _command(module: str, name: str) -> Callable[[argparse.Namespace], int]:
    """Function of a command. Its module is imported when it is called: `rockfall --help` needs no
    NumPy, and a check no figures. Files are replaced only with `--overwrite`."""

    def run(given: argparse.Namespace) -> int:
        function = getattr(import_module(f"rockfall.cli.{module}"), f"{name}_command")
        overwriting = import_module("rockfall.io.output_files").overwriting
        with overwriting(getattr(given, "overwrite", False)):
            return function(given)

    return run


@functools.cache
def make_parser() -> argparse.ArgumentParser:
    """Parser of the complete command line, made once: its `command` takes the parsed arguments."""
    parser = _Parser(
        prog="rockfall", description="Where falling rocks go, how fast, how high and how often."
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="print the version")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    _add_draft(commands)
    _add_app(commands)
    _add_runs(commands)
    _add_studies(commands)
    _add_results(commands)
    _add_lab(commands)
    return parser


def _add_draft(commands: _Commands) -> None:
    text = "write a commented case for a DEM and layers of zones, sources, lines, barriers, trees"
    new = _add(commands, "draft", "new", text, "DEM", writes=False)
    text = "GeoPackage, GeoJSON, shapefile: each layer is known by shapes, attributes and name"
    new.add_argument("layers", metavar="LAYER", type=Path, nargs="*", help=text)
    new.add_argument("-o", "--output", metavar="CASE.nml", type=Path, required=True)
    text = "make a DEM of surveyed points, or edit one: edits in the order in which they are given"
    dem = _add(commands, "draft", "dem", text)
    text = "points.csv with x, y, z; point clouds (.las, .laz, .xyz), several too; or a DEM"
    dem.add_argument("input", metavar="FILE", type=Path, nargs="+", help=text)
    dem.add_argument("-o", "--output", metavar="DEM.tif", type=Path, required=True)
    points = dem.add_argument_group("points")
    text = "side of a cell; default: 1, 2, 5, 10..., at most the mean spacing of the points"
    points.add_argument("--cell", metavar="M", type=float, help=text)
    text = "points weigh 1/distance**P; default: 2"
    points.add_argument("--power", metavar="P", type=float, help=text)
    text = "points of which a cell is made, at most; default: 12"
    points.add_argument("--neighbours", metavar="N", type=int, help=text)
    text = "nodata beyond; default: three times the mean spacing"
    points.add_argument("--within", metavar="M", type=float, help=text)
    points.add_argument(
        "--crs",
        metavar="CODE",
        help="of the points, or of a DEM that names none, such as EPSG:2056",
    )
    text = "of .las and .laz: points of these classes; default: 2, ground"
    points.add_argument("--classes", metavar="N", type=int, nargs="+", help=text)
    text = "of point clouds: the mean of the points in each square of M metres"
    points.add_argument("--thin", metavar="M", type=float, help=text)
    edits = dem.add_argument_group("edits")
    for name, metavar, kind, does in (
        ("fill", "M", float, "fill holes, as far as M from their edges"),
        ("pits", "M", float, "fill pits that are at most M deep up to where they run over"),
        ("smooth", "M", float, "by a Gaussian of this standard deviation"),
        ("dam", "LAYER", Path, "lines with height, crest_width, slope, as &dam has them"),
        ("cut", "LAYER", Path, "lower by depth or to level: polygons, or lines with a width"),
    ):
        edits.add_argument(
            f"--{name}", metavar=metavar, type=kind, action=_Step, dest="steps", help=does
        )


def _add_app(commands: _Commands) -> None:
    text = "open a window in the browser, to draw a case on a map and see it run"
    app = _add(commands, "app", "app", text, writes=False)
    text = "case, DEM or result; default: a list of those opened before"
    app.add_argument("path", metavar="PATH", type=Path, nargs="?", help=text)
    text = "de, en, fr or it; default: that of the browser"
    app.add_argument("--language", metavar="XX", default="", help=text)
    text = "port on this machine; default: any that is free"
    app.add_argument("--port", metavar="N", type=int, default=0, help=text)
    text = "go on when the last page has closed, until Ctrl-C"
    app.add_argument("--keep", action="store_true", help=text)
    text = "print the address only"
    app.add_argument("--no-browser", action="store_true", help=text)


def _add_runs(commands: _Commands) -> None:
    text = "read and check everything, simulate a few boulders, estimate time and memory"
    check = _add(commands, "check", "check", text, "CASE", writes=False)
    run = _add(commands, "run", "run", "run a case and write its result as netCDF", "CASE")
    for parser in check, run:
        _add_memory(parser)
    run.add_argument("-o", "--output", metavar="OUT.nc", type=Path, help="default: CASE.nc, here")
    text = f"run until 95 %% confidence intervals are narrow enough: {_RULES}"
    run.add_argument("--until", metavar="RULES", help=text)
    run.add_argument("--cap", metavar="N", type=int, help="with --until: maximum from each source")
    run.add_argument("--shard", metavar="I/N", help="the I-th of N parts, for `rockfall merge`")
    run.add_argument("--dask", metavar="WHERE", help="on a Dask cluster: its address, or local:N")
    _add_resume(run, "OUT.nc.checkpoint")
    _add_overrides(run)
    text = "make a case that rockfall-batch reads without Python"
    prepare = _add(commands, "parts", "prepare", text, "CASE")
    prepare.add_argument("folder", metavar="DIR", type=Path, help="is made; for the prepared files")
    text = "make a case of a folder of Rockyfor3D, whose files stay where they are"
    rocky = _add(commands, "imports", "import-rockyfor3d", text, "DIR")
    rocky.add_argument("-o", "--output", metavar="CASEDIR", type=Path, required=True)
    rocky.add_argument("--crs", metavar="CODE", help="of its rasters, such as EPSG:2056")
    text = "write a Slurm job array for a case, with its merge job"
    slurm = _add(commands, "parts", "slurm", text, "CASE")
    slurm.add_argument("folder", metavar="DIR", type=Path, help="is made; jobs, parts and result")
    slurm.add_argument("--shards", metavar="N", type=int, required=True, help="jobs of the array")
    slurm.add_argument("--program", default="python", help="python (default), or batch")
    slurm.add_argument("--threads", metavar="N", type=int, default=4, help="of each job; default 4")
    slurm.add_argument("--time", default="24:00:00", help="of each job; default 24:00:00")
    text = "merge the parts of a run; the result is that of a run in one piece, bit for bit"
    merge = _add(commands, "parts", "merge", text)
    merge.add_argument("parts", metavar="PART.nc", type=Path, nargs="+")
    merge.add_argument("-o", "--output", metavar="OUT.nc", type=Path, required=True)


def _add_memory(command: argparse.ArgumentParser) -> None:
    text = "of the run; terrain beyond half of it is read in windows; default: the machine's"
    command.add_argument("--memory", metavar="SIZE", help=text)


def _add_resume(command: argparse.ArgumentParser, place: str) -> None:
    text = "go on from the last checkpoint, if any"
    command.add_argument("--resume", action="store_true", help=text)
    text = f"between checkpoints, in {place}; default: 60, 0 = none"
    command.add_argument("--checkpoint", metavar="SECONDS", type=float, default=60.0, help=text)


def _add_overrides(command: argparse.ArgumentParser) -> None:
    """Add the options that replace values of the case."""
    command.add_argument("--boulders", metavar="N", type=int, help="released from each source")
    text = "released from all sources together"
    command.add_argument("--boulders-total", metavar="N", type=int, help=text)
    command.add_argument("--seed", metavar="N", type=int, help="of the random numbers")
    command.add_argument("--threads", metavar="N", type=int, help="0 = all cores")
    command.add_argument("--quiet", action="store_true", help="no progress, no summary")


def _add_studies(commands: _Commands) -> None:
    text = "run a case over its uncertain inputs, and say which of them matter"
    vary = _add(commands, "studies", "ensemble", text, "CASE")
    vary.add_argument("-o", "--output", metavar="OUT", type=Path, help="OUT.nc, or a table OUT.csv")
    vary.add_argument("--runs", metavar="M", type=int, help="draws of the uncertain inputs")
    _add_overrides(vary)
    text = "seek the uncertain inputs that make observations likely: a posterior"
    back = _add(commands, "studies", "back", text, "CASE")
    back.add_argument("observed", metavar="OBSERVED.csv", type=Path, nargs="+")
    back.add_argument("-o", "--output", metavar="DIR", type=Path, help="default: CASE_back")
    back.add_argument("--members", metavar="M", type=int, help="runs at most; default: 1024")
    text = "members that the posterior must be worth; default: 100"
    back.add_argument("--effective", metavar="N", type=int, help=text)
    _add_overrides(back)
    text = "run the scenarios of a case: annual frequencies, zones of hazard, objects at risk"
    zone = _add(commands, "hazard", "hazard", text, "CASE")
    zone.add_argument("-o", "--output", metavar="DIR", type=Path, help="default: CASE_hazard")
    _add_imprint(zone, "on the sheet")
    text = "points, lines, polygons, with name, vulnerability, value, persons, aadt, ...; several: "
    text += "--objects A --objects B"
    zone.add_argument(
        "--objects", metavar="LAYER", type=Path, action="append", default=[], help=text
    )
    text = "of a file with several layers; again for another of them, or one for each file"
    zone.add_argument("--objects-layer", metavar="NAME", action="append", default=[], help=text)
    text = "lines of roads, with name, width, chainage: frequencies of each segment"
    zone.add_argument("--segments", metavar="LAYER", type=Path, help=text)
    zone.add_argument("--segments-layer", metavar="NAME", help="of a file with several layers")
    text = "of the segments [m]; default: each line is one"
    zone.add_argument("--segment-length", metavar="LENGTH", type=float, help=text)
    text = "curves for the objects: name, energy [kJ], vulnerability, source"
    zone.add_argument("--vulnerability", metavar="CURVES.csv", type=Path, help=text)
    text = "write each scenario as a case, CASE_scenarioN.nml, and run nothing"
    zone.add_argument("--write-cases", action="store_true", help=text)
    text = "of these cases, one for each scenario, in place of running them"
    zone.add_argument("--results", metavar="OUT.nc", type=Path, nargs="+", default=[], help=text)
    _add_memory(zone)
    _add_resume(zone, "DIR.scenarioN.checkpoint")
    _add_overrides(zone)
    text = "run the variants of a case, with common random numbers, and compare them"
    several = _add(commands, "variants", "variants", text, "CASE")
    several.add_argument("-o", "--output", metavar="DIR", type=Path, help="default: CASE_variants")
    text = "one page, too, with a column for each variant: DIR/variants.html"
    several.add_argument("--report", action="store_true", help=text)
    several.add_argument("--pdf", action="store_true", help="the page as DIR/variants.pdf")
    _add_yearly(several, "")
    _add_imprint(several, "in the report")
    _add_memory(several)
    _add_resume(several, "DIR.NAME.checkpoint")
    _add_overrides(several)
    text = "run a case by every rebound model, with common random numbers"
    every = _add(commands, "studies", "models", text, "CASE")
    every.add_argument("-o", "--output", metavar="DIR", type=Path, help="default: CASE_models")
    text = "a ground, in place of those that stand for rocks; several: --ground A --ground B"
    every.add_argument("--ground", metavar="NAME", action="append", default=[], help=text)
    _add_overrides(every)
    text = "set a case by every law of rebound beside what was observed at its site"
    site = _add(commands, "studies", "validate", text, "CASE")
    site.add_argument("observed", metavar="OBSERVED.csv", type=Path, nargs="+")
    site.add_argument("-o", "--output", metavar="TABLE.csv", type=Path, help="all numbers as CSV")
    text = "a table of impacts; several: --table A --table B; default: all that are shipped"
    site.add_argument("--table", metavar="NAME", action="append", default=[], help=text)
    text = "runs of each law, by seeds after the case's; default: %(default)s"
    site.add_argument("--seeds", metavar="N", type=int, default=5, help=text)
    _add_overrides(site)
    text = "measure how a case's numbers converge, and the cost"
    converge = _add(commands, "studies", "convergence", text, "CASE")
    converge.add_argument(
        "-o", "--output", metavar="DIR", type=Path, help="default: CASE_convergence"
    )
    converge.add_argument("--boulders", metavar="N", type=int, nargs="+", help="from each source")
    text = "boulders from each source to measure errors; default: 1000000 over all"
    converge.add_argument("--reference", metavar="N", type=int, help=text)


def _add_results(commands: _Commands) -> None:
    def result(name: str, does: str) -> _Parser:
        return _add(commands, "results", name, does, "OUT.nc")

    text = "write a result as GeoTIFF, GeoPackage and CSV; or as CZML, KML, DXF"
    export = result("export", text)
    export.add_argument("folder", metavar="DIR", type=Path, help="is made if it is missing")
    text = "some of tif, gpkg, csv (default: these), czml, kml, dxf; of HAZARD.nc: kml, dxf"
    export.add_argument("--formats", metavar="FORMAT", nargs="+", help=text)
    text = "of drawn parabolas; default: 0.05"
    export.add_argument("--tolerance", metavar="M", type=float, help=text)
    text = "height of the DEM's vertical datum above the ellipsoid, for czml"
    export.add_argument("--geoid", metavar="M", type=float, help=text)
    _add_tables(export, "line statistics and return levels")
    text = "project.qgz, too: a project with groups, styles and layouts on A3"
    project = export.add_argument_group("project of QGIS")
    project.add_argument("--qgis", action="store_true", help=text)
    project.add_argument("--dem", metavar="FILE", type=Path, help="default: the case's, if found")
    project.add_argument("--hazard", metavar="HAZARD.nc", type=Path, help="its zones, too")
    _add_imprint(project, "on layouts", "of the project and of tables: ")
    text = "compare a result with observations (several: rank them), or variants with the first"
    compare = _add(commands, "results", "compare", text)
    text = "results OUT.nc and observations OBSERVED.csv, or trajectories .rts, .pts of RAMMS; "
    text += "or variants A.nc B.nc ... alone"
    compare.add_argument("files", metavar="FILE", type=Path, nargs="+", help=text)
    compare.add_argument("-o", "--output", metavar="TABLE.csv", type=Path, help="all tables as CSV")
    text = "of the trajectories: J or kJ; default: energies are left out"
    compare.add_argument("--energy-unit", metavar="UNIT", help=text)
    text = "of variants: maps of the differences, as GeoTIFF"
    compare.add_argument("--maps", metavar="DIR", type=Path, help=text)
    text = "of variants: one page (.html, .pdf) with a column for each"
    compare.add_argument("--report", metavar="FILE", type=Path, help=text)
    _add_yearly(compare, "of variants: ")
    text = "of variants, for the report: NAME=AMOUNT"
    compare.add_argument("--costs", metavar="COST", nargs="+", default=[], help=text)
    _add_imprint(compare, "in the report")
    lines = result("lines", "print line statistics with intervals, and return levels")
    lines.add_argument("-o", "--output", metavar="TABLE.csv", type=Path, help="write them, too")
    text = "split them: source or volume"
    lines.add_argument("--by", metavar="WHAT", help=text)
    text = "edges between classes of volume [m3], as 0.1,0.5,1; default: quarters of the boulders"
    lines.add_argument("--classes", metavar="V,V", help=text)
    text = "what passes where on this line; with -o TABLE.csv also the figure TABLE.png"
    lines.add_argument("--along", metavar="LINE", help=text)
    text = "of windows along the line; default: a round one, for about 40"
    lines.add_argument("--width", metavar="M", type=float, help=text)
    _add_section(commands)
    figures = result("figures", "draw every figure of a result, those of the paper too")
    figures.add_argument("folder", metavar="DIR", type=Path, help="is made if it is missing")
    figures.add_argument("--format", default="png", help="png (default), pdf or svg")
    report = result("report", "write a result as one HTML page, to be read offline, or as PDF")
    report.add_argument("-o", "--output", metavar="FILE", type=Path, help="default: OUT.html")
    report.add_argument("--pdf", action="store_true", help="a PDF in place of the page")
    report.add_argument(
        "--3d", dest="view", action="store_true", help="the terrain in three dimensions, too"
    )
    _add_imprint(report, "on page 1")
    text = "date of the survey of the DEM"
    report.add_argument("--dem-date", metavar="TEXT", default="", help=text)
    report.add_argument("--hazard", metavar="HAZARD.nc", type=Path, help="its zones, too")
    text = "of `rockfall models`: the spread over rebound models, on page 1"
    report.add_argument("--models", metavar="MODELS.nc", type=Path, help=text)
    text = "a section along this line, as in `rockfall section`"
    report.add_argument("--section", metavar="X,Y", nargs="+", help=text)
    report.add_argument("--section-layer", metavar="NAME", help="of a file with several layers")
    text = "boulders count so far to either side; default: %(default)s"
    report.add_argument("--section-within", metavar="M", type=float, default=10.0, help=text)
    _add_design(commands)
    for verb in figures, report:
        verb.add_argument("--dem", metavar="FILE", type=Path, help="default: the case's, if found")
        verb.add_argument("--observed", metavar="CSV", type=Path, nargs="+", help="drawn beside it")
        verb.add_argument("--basemap", metavar="FILE", type=Path, help="a picture below the maps")
        verb.add_argument(
            "--limits", metavar="UNIT=LIMITS", nargs="+", help="of classes: kJ=30,300 m=1,5"
        )


def _add_yearly(command: argparse.ArgumentParser, unit: str) -> None:
    text = f"{unit}boulders that come loose a year, for frequencies in the report"
    command.add_argument("--yearly", metavar="N", type=float, default=0.0, help=text)


def _add_section(commands: _Commands) -> None:
    text = "draw a section along a line: profile, trajectories, envelopes of energy and height"
    section = _add(commands, "section", "section", text, "OUT.nc")
    text = "its vertices, in quotes if one is negative, or a layer with one line"
    section.add_argument("--line", metavar="X,Y", nargs="+", required=True, help=text)
    section.add_argument("--line-layer", metavar="NAME", help="of a file with several layers")
    text = "boulders count so far to either side; default: 10"
    section.add_argument("--within", metavar="M", type=float, help=text)
    text = "between stations; default: a round one, for about 100"
    section.add_argument("--every", metavar="M", type=float, help=text)
    text = "tables NAME.csv, NAME_lines.csv and figure NAME.png; default: OUT_section.csv"
    section.add_argument("-o", "--output", metavar="NAME.csv", type=Path, help=text)
    section.add_argument("--dem", metavar="FILE", type=Path, help="default: the case's, if found")


def _add_tables(command: argparse.ArgumentParser, what: str) -> None:
    text = f"{what}, too, as a workbook (xlsx) and a document (docx)"
    command.add_argument("--tables", metavar="FORMAT", nargs="+", default=[], help=text)


def _add_imprint(command: argparse._ActionsContainer, where: str, what: str = "") -> None:
    help_text = f"{what}en (default), de, fr or it"
    command.add_argument("--language", metavar="XX", default="en", help=help_text)
    for name, help_text in (
        ("project", "its name or number"),
        ("client", "who asked"),
        ("author", "who signs"),
    ):
        command.add_argument(f"--{name}", metavar="TEXT", default="", help=f"{help_text}; {where}")


def _add_design(commands: _Commands) -> None:
    text = "what barriers at lines of results must be, or the block of a return period"
    sheet = _add(commands, "protection", "design", text)
    sheet.add_argument("results", metavar="OUT.nc", type=Path, nargs="*")
    sheet.add_argument("-o", "--output", metavar="DIR", type=Path, help="for tables and figures")
    _add_tables(sheet, "the tables")
    text = "of these tables: en (default), de, fr or it"
    sheet.add_argument("--language", metavar="XX", default="en", help=text)
    _add_conditions(sheet)
    text = "that may pass, of the boulders that come; default: 0.01"
    sheet.add_argument("--residual", metavar="FRACTION", type=float, help=text)
    sheet.add_argument("--along", metavar="LINE", help="its height and class, metre by metre")
    text = "of windows along the line; default: 10"
    sheet.add_argument("--width", metavar="M", type=float, help=text)
    text = "boulders that a window needs; default: 50"
    sheet.add_argument("--min-boulders", metavar="N", type=int, help=text)
    block = sheet.add_argument_group("block of a return period")
    text = "print the block that is exceeded once in so many years, from the survey --blocks"
    block.add_argument("--return-period", metavar="YEARS", type=float, help=text)
    text = "in which each fall of a block was recorded"
    block.add_argument("--years", metavar="YEARS", type=float, help=text)
    text = "blocks that fell in these years; default: those of --blocks that have a year"
    block.add_argument("--events", metavar="CSV", type=Path, help=text)
    text = "larger blocks count; default: the smallest above which a distribution fits"
    block.add_argument("--threshold", metavar="M3", type=float, help=text)
    text = "largest block of the scenario; default: that of ten return periods"
    block.add_argument("--volume-max", metavar="M3", type=float, help=text)
    _add_site(commands)


def _add_site(commands: _Commands) -> None:
    text = "compare alignments of a barrier above a line: loads, requirements, the best of them"
    site = _add(commands, "protection", "site", text, "CASE")
    site.add_argument("-o", "--output", metavar="DIR", type=Path, help="default: CASE_siting")
    text = "evaluation line of the case that is to be protected"
    site.add_argument("--line", metavar="NAME", required=True, help=text)
    text = "between alignments, which are the line shifted towards the sources; default: 10"
    site.add_argument("--every", metavar="M", type=float, help=text)
    text = "up to this distance; default: 100"
    site.add_argument("--to", metavar="M", type=float, help=text)
    text = "degrees from north, in place of perpendicular to the line"
    site.add_argument("--direction", metavar="AZIMUTH", type=float, help=text)
    text = "drawn alignments, in place of shifted ones"
    site.add_argument("--candidates", metavar="LAYER", type=Path, help=text)
    site.add_argument("--candidates-layer", metavar="NAME", help="of a file with several layers")
    text = "of the barrier"
    site.add_argument("--max-height", metavar="M", type=float, help=text)
    site.add_argument("--max-class", metavar="CLASS", type=int, help="EAD 340059 class, 0 to 7")
    text = "of the boulders that come to the line, around an alignment; default: 0.01"
    site.add_argument("--max-bypass", metavar="FRACTION", type=float, help=text)
    text = "boulders at more alignments than half of it holds take several runs; default: all"
    site.add_argument("--memory", metavar="SIZE", help=text)
    _add_conditions(site)
    _add_overrides(site)


def _add_conditions(command: argparse.ArgumentParser) -> None:
    """Add the options that decide on what a standard asks for."""
    for key, default, does in (
        ("standard", "UNI", "UNI (11211-4) or ONR (24810)"),
        ("survey", "poor", "of the topography: good or poor"),
        ("blocks", "poor", "survey: good or poor; with --return-period, its table (CSV)"),
        ("calibration", "literature", "of the rebound: back-analysed or literature"),
        ("limit-state", "MEL", "MEL: one large impact; SEL: several"),
        ("consequence", "CC2", "of a failure, for ONR: CC1, CC2 or CC3"),
    ):
        text = f"{does}; default: {default}"
        command.add_argument(f"--{key}", metavar=key.upper().replace("-", "_"), help=text)
    text = "of the design block; default: a quantile of those that come"
    command.add_argument("--volume", metavar="M3", type=float, help=text)
    text = "standard, factor, condition, value, source; default: the shipped table"
    command.add_argument("--factors", metavar="CSV", type=Path, help=text)
    text = "class, height, cost of a metre; default: class energy times height"
    command.add_argument("--costs", metavar="CSV", type=Path, help=text)


def _add_lab(commands: _Commands) -> None:
    """Add the laboratory to the commands of `rockfall`."""
    text = "impacts of spheres on rocks or of blocks on a ground, and impact sets from them"
    lab = commands.add_parser("lab", help=text, description=text.capitalize() + ".")
    verbs = lab.add_subparsers(required=True, metavar="COMMAND")

    def verb(name: str, does: str) -> argparse.ArgumentParser:
        parser = verbs.add_parser(name, help=does, description=does[0].upper() + does[1:] + ".")
        parser.set_defaults(command=_command("lab", name))
        return parser

    pack = verb("pack", "let layers settle, say what they are, draw the first")
    pack.add_argument("case", metavar="LAB.nml", type=Path)
    pack.add_argument("-o", "--output", metavar="LAYER.png", type=Path, help="a picture")
    pack.add_argument("--layers", metavar="N", type=int, default=8, help="default: 8")
    pack.add_argument("--ratio", metavar="R", type=float, default=5.0, help="R_b/R_m; default: 5")
    impact = verb("impact", "fire all impacts of a laboratory case")
    impact.add_argument("case", metavar="LAB.nml", type=Path)
    impact.add_argument("-o", "--output", metavar="OUT.nc", type=Path, help="default: LAB.nc, here")
    impact.add_argument("--resume", action="store_true", help="go on with OUT.nc")
    relief = verb("relief", "give the spectrum of a measured patch, for &ground of blocks")
    relief.add_argument("patch", metavar="PATCH.tif", type=Path, help="elevations in small cells")
    text = "R_b of the blocks [m]; default: 0.4"
    relief.add_argument("--radius", metavar="R", type=float, default=0.4, help=text)
    text = "wave over R_b; default: 2"
    relief.add_argument("--shortest", metavar="L", type=float, default=2.0, help=text)
    text = "wave over R_b; default: 16"
    relief.add_argument("--longest", metavar="L", type=float, default=16.0, help=text)
    fit = verb("fit", "make impact sets from impacts, or from measured contacts")
    fit.add_argument(
        "impacts", metavar="IMPACTS", type=Path, help=".nc of the laboratory, or .csv of contacts"
    )
    fit.add_argument("-o", "--output", metavar="SETS.nml", type=Path, help="for rockfall run")
    fit.add_argument(
        "--state", help="of the boulder in the laboratory: peak (default), loss or clear"
    )
    fit.add_argument(
        "--nearest-ratio", action="store_true",
        help="a ratio without measured contacts has the set of the nearest that has some",
    )  # fmt: skip
    tables = verb("table", "make a table of impacts from contacts of the laboratory")
    tables.add_argument("contacts", metavar="CONTACTS.nc", nargs="+", type=Path, help="of blocks")
    tables.add_argument(
        "-o", "--output", metavar="TABLE.nc", type=Path, required=True, help="for &impact table"
    )
    card = verb("scorecard", "set impact sets beside what is known of rebounds on rocky slopes")
    card.add_argument("sets", metavar="SETS", nargs="*", help="shipped or files; default: shipped")
    card.add_argument(
        "--site", metavar="DIR", type=Path, default=Path("cases/vaujany"),
        help="the case of the slope; default: cases/vaujany",
    )  # fmt: skip
    card.add_argument(
        "--slopes", metavar="N", type=int, default=32,
        help="of the site's recipe, for means and standard errors; default: 32",
    )  # fmt: skip
    card.add_argument("--turning", default="past_aspect", help="as &impact turning")
    card.add_argument("--rg-reading", default="diameter", help="as &surface rg_reading")
    remake = verb("remake", "make set files and tables again from their provenance, and compare")
    remake.add_argument("sets", metavar="FILE", nargs="+", help="shipped or files")
    for parser in (pack, impact, remake):
        parser.add_argument(
            "--threads", metavar="N", type=int, default=0, help="default: all cores"
        )
    for parser in (pack, impact, fit, tables):
        _add_overwrite(parser)
    for parser in (impact, fit, tables, card, remake):
        parser.add_argument("--quiet", action="store_true", help="no progress, no summary")
