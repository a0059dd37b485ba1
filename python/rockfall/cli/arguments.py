# SPDX-License-Identifier: BSD-3-Clause
"""Arguments of all commands."""

import argparse
import functools
from collections.abc import Callable
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NoReturn

from rockfall.errors import RockfallError

_Commands = argparse._SubParsersAction  # argparse has no public name for it
FACTORS = "factors: columns standard, factor, condition, value, source (docs/design.md)"
COSTS = "cost per metre: columns class, height, cost; default: class energy times height"
LINES = "print line statistics with intervals and return levels, or annual frequencies of a hazard"
REPORT = "write a result or a hazard as one HTML page that works offline, or as PDF"
_RULES = "'speed.mean@EL1<2%%, energy_total.q95@EL1<5%%, fraction@EL1<3%%'"


#: Removed options and their replacements.
_GONE = {
    "--energy-unit": "was removed: give energies as CSV with a column unit",
    "--geoid": "was removed with CZML: use --formats kml",
}


class _Parser(argparse.ArgumentParser):
    package = ""  # separate package that provides the commands

    def complete(self) -> None:
        """Add the commands of the parser's package, if installed."""
        if self.package and find_spec(self.package):
            package, self.package = self.package, ""
            import_module(f"{package}.arguments").add_commands(self)

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        self.complete()
        if self.package:
            raise RockfallError(
                f"{self.prog}: the laboratory is not installed: build rockfall with -Dlab=true"
            )
        return super().parse_known_args(args, namespace)

    def error(self, message: str) -> NoReturn:
        for option in (word.partition("=")[0] for word in message.split()):
            if option in _GONE:
                raise RockfallError(f"{option}: {_GONE[option]}")
        raise RockfallError(f"{message}: see {self.prog} --help")


class _Step(argparse.Action):
    """Store an edit; edits keep the order of the command line."""

    def __call__(self, parser: Any, namespace: Any, value: Any, option: str | None = None) -> None:
        steps = [*(getattr(namespace, self.dest) or []), (str(option).lstrip("-"), value)]
        setattr(namespace, self.dest, steps)


class _Version(argparse.Action):
    """Option `--version`; the version is only looked up on request."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        print(f"rockfall {import_module('rockfall.version').__version__}")
        parser.exit()


def _add(
    commands: _Commands, module: str, name: str, does: str, what: str = "", writes: bool = True
) -> _Parser:
    """Add a command from a module in the folder `commands`; `what` is the file that it reads. Most
    commands get options to overwrite outputs and to select a variant of the case."""
    parser = commands.add_parser(name, help=does, description=does[0].upper() + does[1:] + ".")
    if what:
        parser.add_argument(what.lower(), metavar=what, type=Path)
    if what == "CASE" and name not in ("variants", "dossier"):
        text = "variant of the case to use; base: the case without its variants"
        _option(parser, "--variant NAME", str, text)
    if writes:
        _switch(parser, "--overwrite", "replace existing outputs, never inputs")
    module = f"rockfall.cli.commands.{module}"
    parser.set_defaults(command=command_of(module, name.replace("-", "_")))
    return parser


def _option(
    parser: argparse._ActionsContainer, names: str, kind: Any, does: str | None = None, **more: Any
) -> None:
    """Add an option with a value; `names` ends with a name for the value: `-o --output DIR`."""
    *flags, value = names.split()
    if kind is not str:
        more["type"] = kind
    parser.add_argument(*flags, metavar=value, help=does, **more)


def _switch(parser: argparse._ActionsContainer, names: str, does: str) -> None:
    """Add an option without a value."""
    parser.add_argument(*names.split(), action="store_true", help=does)


def command_of(module: str, name: str) -> Callable[[argparse.Namespace], int]:
    """Return a function that imports a command's module only when called: `rockfall --help` needs
    no NumPy, `check` no plotting. Files are replaced only with `--overwrite`."""

    def run(given: argparse.Namespace) -> int:
        function = getattr(import_module(module), f"{name}_command")
        overwriting = import_module("rockfall.io.output_files").overwriting
        with overwriting(getattr(given, "overwrite", False)):
            return function(given)

    return run


@functools.cache
def make_parser() -> argparse.ArgumentParser:
    """Create the parser of the whole command line. It sets `command`, a function that runs the
    command with the parsed arguments and returns the exit status."""
    parser = _Parser(
        prog="rockfall",
        description="Simulate rockfall: reach, speed, height, energy and frequency.",
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="print the version")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    _add_draft(commands)
    _add_app(commands)
    _add_runs(commands)
    _add_studies(commands)
    _add_results(commands)
    _add_ground(commands)
    _add_lab(commands)
    return parser


def _add_draft(commands: _Commands) -> None:
    text = "write a commented case from a DEM and layers: zones, sources, lines, barriers, trees"
    new = _add(commands, "draft", "new", text, "DEM", writes=False)
    text = "GeoPackage, GeoJSON or shapefile; shapes, attributes and name decide what a layer is"
    new.add_argument("layers", metavar="LAYER", type=Path, nargs="*", help=text)
    _option(new, "-o --output CASE.nml", Path, required=True)
    text = (
        "ground of this zone, or of all zones without a ground: talus, rocky-slope, rock, meadow, "
        "vegetated-soil, compact, soft-soil or another (repeatable)"
    )
    _option(new, "--ground [ZONE=]GROUND", str, text, action="append")
    text = "lowest angle observed at the site or in the region; runs are compared with it"
    _option(new, "--energy-line-angle DEGREE", float, text)
    text = "lowest shadow angle, from the apex of the talus; runs are compared with it"
    _option(new, "--shadow-angle DEGREE", float, text)
    text = "create a DEM from surveyed points, or edit a DEM; edits are applied in the given order"
    dem = _add(commands, "draft", "dem", text)
    text = "points.csv with x, y, z, one or more point clouds (.las, .laz, .xyz), or a DEM"
    dem.add_argument("input", metavar="FILE", type=Path, nargs="+", help=text)
    _option(dem, "-o --output DEM.tif", Path, required=True)
    points = dem.add_argument_group("points")
    text = "cell size; default: grid spacing, else 1, 2, 5... up to the mean point spacing"
    _option(points, "--cell M", float, text)
    _option(points, "--power P", float, "weight of points: 1/distance**P; default: 2")
    _option(points, "--neighbours N", int, "maximum number of points per cell; default: 12")
    _option(
        points,
        "--within M",
        float,
        "nodata beyond this distance; default: three mean point spacings, 0 for grids",
    )
    _option(points, "--crs CODE", str, "CRS of points or a DEM without a CRS, such as EPSG:2056")
    text = "point classes of .las and .laz; default: 2, ground"
    _option(points, "--classes N", int, text, nargs="+")
    text = "thin point clouds to one mean point in each square of M metres"
    _option(points, "--thin M", float, text)
    edits = dem.add_argument_group("edits")
    for name, metavar, kind, does in (
        ("fill", "M", float, "fill holes up to M from their edges"),
        ("pits", "M", float, "fill pits at most M deep up to their outlet"),
        ("smooth", "M", float, "smooth by a Gaussian of this standard deviation"),
        ("dam", "LAYER", Path, "add dams: lines with height, crest_width and slope, as in &dam"),
        ("cut", "LAYER", Path, "cut polygons, or lines with a width, by depth or down to level"),
    ):
        edits.add_argument(
            f"--{name}", metavar=metavar, type=kind, action=_Step, dest="steps", help=does
        )


def _add_app(commands: _Commands) -> None:
    text = "open a window in the browser to draw a case on a map and run it"
    app = _add(commands, "app", "app", text, writes=False)
    text = "case, DEM or result; default: list of recent files"
    app.add_argument("path", metavar="PATH", type=Path, nargs="?", help=text)
    _option(
        app, "--language XX", str, "de, en, fr or it; default: language of the browser", default=""
    )
    _option(app, "--port N", int, "port on this machine; default: any free port", default=0)
    _add_object_layers(app)
    _option(app, "--basemap FILE", Path, "background image, such as an orthophoto")
    text = "web map service as background: https://HOST/PATH?LAYERS=NAME"
    _option(app, "--wms URL", str, text, default="")
    _switch(app, "--keep", "keep running until Ctrl-C, even when the last page is closed")
    _switch(app, "--no-browser", "only print the address")


def _add_runs(commands: _Commands) -> None:
    text = "check all inputs, simulate a few boulders, estimate time and memory"
    check = _add(commands, "run", "check", text, "CASE", writes=False)
    run = _add(commands, "run", "run", "run a case and write its result as netCDF", "CASE")
    for parser in check, run:
        _add_memory(parser)
    _option(run, "-o --output OUT.nc", Path, "default: CASE.nc in the current folder")
    text = f"run until 95 %% confidence intervals are narrow enough: {_RULES}"
    _option(run, "--until RULES", str, text)
    _option(run, "--cap N", int, "with --until: maximum number of boulders from each source")
    _option(run, "--shard I/N", str, "run part I of N, for `rockfall merge`")
    _option(run, "--dask WHERE", str, "address of a Dask cluster, or local:N")
    _add_resume(run, "OUT.nc.checkpoint")
    _add_overrides(run)
    text = "prepare a case for rockfall-batch, which needs no Python"
    prepare = _add(commands, "parts", "prepare", text, "CASE")
    prepare.add_argument("folder", metavar="DIR", type=Path, help="output folder (created)")
    text = "create a case from a Rockyfor3D folder, whose files remain in place"
    rocky = _add(commands, "draft", "import-rockyfor3d", text, "DIR")
    _option(rocky, "-o --output CASEDIR", Path, required=True)
    _option(rocky, "--crs CODE", str, "CRS of its rasters, such as EPSG:2056")
    text = "create a case from the layers of PlatRock: DEM, rocks, soils, forest, checkpoints"
    platrock = _add(commands, "draft", "import-platrock", text, "DIR")
    _option(platrock, "-o --output CASEDIR", Path, required=True)
    _option(platrock, "--crs CODE", str, "CRS of all its files, such as EPSG:2154")
    text = "create a case from the inputs of an AvaFrame folder: DEM, REL, INFRA"
    avaframe = _add(commands, "draft", "import-avaframe", text, "DIR")
    _option(avaframe, "-o --output CASEDIR", Path, required=True)
    _option(avaframe, "--crs CODE", str, "CRS of the DEM, if its file has none")
    _option(avaframe, "--ground GROUND", str, "ground of the slope; default: ask on the terminal")
    avaframe.add_argument(
        "--no-forest", action="store_true", help="ignore the forest raster in RES"
    )
    text = "write a Slurm job array for a case, with a merge job"
    slurm = _add(commands, "parts", "slurm", text, "CASE")
    slurm.add_argument("folder", metavar="DIR", type=Path, help="output folder (created)")
    _option(slurm, "--shards N", int, "number of jobs in the array", required=True)
    slurm.add_argument("--program", default="python", help="program: python (default) or batch")
    _option(slurm, "--threads N", int, "threads per job; default: 4", default=4)
    slurm.add_argument(
        "--time", default="24:00:00", help="time limit of each job; default: 24:00:00"
    )
    text = "merge the parts of a run into one result, bit-identical to an undivided run"
    merge = _add(commands, "parts", "merge", text)
    merge.add_argument("parts", metavar="PART.nc", type=Path, nargs="+")
    _option(merge, "-o --output OUT.nc", Path, required=True)


def _add_memory(command: argparse.ArgumentParser) -> None:
    text = (
        "memory for the run; terrain that needs more than half is read in windows; default: "
        "all memory"
    )
    _option(command, "--memory SIZE", str, text)


def _add_resume(command: argparse.ArgumentParser, place: str) -> None:
    _switch(command, "--resume", "continue from the last checkpoint, if any")
    text = f"time between checkpoints in {place}; default: 60, 0 = none"
    _option(command, "--checkpoint SECONDS", float, text, default=60.0)


def _add_overrides(command: argparse.ArgumentParser) -> None:
    """Add options that replace values of the case."""
    _option(command, "--boulders N", int, "boulders from each source")
    _option(command, "--boulders-total N", int, "boulders from all sources together")
    _option(command, "--seed N", int, "random seed")
    _option(command, "--threads N", int, "number of threads; 0 = all cores")
    _switch(command, "--quiet", "print no progress and no summary")


def _add_studies(commands: _Commands) -> None:
    text = "vary the uncertain inputs of a case, and rank them by effect"
    vary = _add(commands, "studies", "ensemble", text, "CASE")
    _option(vary, "-o --output OUT", Path, "result OUT.nc, or table OUT.csv")
    _option(vary, "--runs M", int, "number of draws of the uncertain inputs")
    _add_overrides(vary)
    text = "fit the uncertain inputs to observations (posterior distribution)"
    back = _add(commands, "studies", "back", text, "CASE")
    text = "observations; default: files of &observed in the case"
    back.add_argument("observed", metavar="OBSERVED.csv", type=Path, nargs="*", help=text)
    _option(back, "-o --output DIR", Path, "default: CASE_back")
    _option(back, "--members M", int, "maximum number of runs; default: 1024")
    _option(back, "--effective N", int, "effective sample size of the posterior; default: 100")
    _add_overrides(back)
    text = "run the scenarios of a case: annual frequencies, hazard zones, objects at risk"
    zone = _add(commands, "hazard", "hazard", text, "CASE")
    _option(zone, "-o --output DIR", Path, "default: CASE_hazard")
    _add_imprint(zone, "on the sheet")
    _add_objects(zone)
    text = "only write each scenario as a case, CASE_scenarioN.nml"
    _switch(zone, "--write-cases", text)
    text = "use results of these cases, one for each scenario, instead of running them"
    _option(zone, "--results OUT.nc", Path, text, nargs="+", default=[])
    _add_memory(zone)
    _add_resume(zone, "DIR.scenarioN.checkpoint")
    _add_overrides(zone)
    text = "map the sources of the boulders that reach a place of a hazard"
    origins = _add(commands, "hazard", "origins", text, "HAZARD.nc")
    place = origins.add_mutually_exclusive_group(required=True)
    _option(place, "--line NAME", str, "line or barrier")
    _option(place, "--object NAME", str, "object")
    text = "circle, default radius: half of &hazard object_width; runs the scenarios again; "
    text += "--at=X,Y if X is negative"
    _option(place, "--at X,Y[,RADIUS]", str, text)
    _option(origins, "-o --output DIR", Path, "default: HAZARD_origins")
    text = "side of the squares of the table of source areas; default: %(default)s"
    _option(origins, "--side M", float, text, default=50.0)
    _add_dossier(commands)
    text = "run the variants of a case, with common random numbers, and compare them"
    several = _add(commands, "variants", "variants", text, "CASE")
    _option(several, "-o --output DIR", Path, "default: CASE_variants")
    _switch(
        several, "--report", "also write one page with a column for each variant: DIR/variants.html"
    )
    _switch(several, "--pdf", "also write the page as DIR/variants.pdf")
    _add_imprint(several, "in the report")
    _add_memory(several)
    _add_resume(several, "DIR.NAME.checkpoint")
    _add_overrides(several)
    text = "run a case with every rebound model and common random numbers"
    every = _add(commands, "studies", "models", text, "CASE")
    _option(every, "-o --output DIR", Path, "default: CASE_models")
    text = "ground to use instead of the grounds for rocks (repeatable)"
    _option(every, "--ground NAME", str, text, action="append", default=[])
    text = "additional impact table (repeatable)"
    _option(every, "--table NAME", str, text, action="append", default=[])
    _add_overrides(every)
    text = "compare every rebound model with observations at the site"
    site = _add(commands, "studies", "validate", text, "CASE")
    site.add_argument("observed", metavar="OBSERVED.csv", type=Path, nargs="+")
    _option(site, "-o --output TABLE.csv", Path, "all values as CSV")
    text = "impact table (repeatable); default: all shipped tables"
    _option(site, "--table NAME", str, text, action="append", default=[])
    text = "number of runs of each model, with consecutive seeds; default: %(default)s"
    _option(site, "--seeds N", int, text, default=5)
    _add_overrides(site)
    text = "measure how the results of a case converge, and the cost"
    converge = _add(commands, "studies", "convergence", text, "CASE")
    _option(converge, "-o --output DIR", Path, "default: CASE_convergence")
    _option(converge, "--boulders N", int, "numbers of boulders from each source", nargs="+")
    text = "boulders from each source in the reference run; default: 1000000 from all sources"
    _option(converge, "--reference N", int, text)


def _add_dossier(commands: _Commands) -> None:
    text = "run the scenarios of each variant, and write a dossier to sign"
    dossier = _add(commands, "dossier", "dossier", text, "CASE")
    _option(dossier, "-o --output DIR", Path, "default: CASE_dossier")
    _add_imprint(dossier, "on page 1")
    _add_objects(dossier)
    text = "return period of loads and of passing boulders: 10, 30, 100 (default), 300, 1000"
    _option(dossier, "--return-period YEARS", float, text, default=100.0)
    _option(dossier, "--costs CSV", Path, COSTS)
    _switch(dossier, "--one-model", "do not run a second rebound model for the first variant")
    _add_memory(dossier)
    _add_resume(dossier, "DIR.run*.checkpoint")
    _add_overrides(dossier)


def _add_objects(command: argparse.ArgumentParser) -> None:
    """Add options for layers of objects at risk, roads, and vulnerability curves."""
    _add_object_layers(command)
    text = "road lines with name, width, chainage: frequencies of each segment"
    _option(command, "--segments LAYER", Path, text)
    _option(command, "--segments-layer NAME", str, "layer name, if the file has several")
    text = "length of segments [m]; default: whole lines"
    _option(command, "--segment-length LENGTH", float, text)
    text = "vulnerability curves: columns name, energy [kJ], vulnerability, source"
    _option(command, "--vulnerability CURVES.csv", Path, text)


def _add_object_layers(command: argparse.ArgumentParser) -> None:
    text = "points, lines, polygons with name, vulnerability, value, persons, aadt ... (repeatable)"
    command.add_argument(
        "--objects", metavar="LAYER", type=Path, action="append", default=[], help=text
    )
    text = "layer name, if the file has several (repeatable)"
    _option(command, "--objects-layer NAME", str, text, action="append", default=[])


def _add_results(commands: _Commands) -> None:
    def result(name: str, does: str, module: str = "results") -> _Parser:
        return _add(commands, module, name, does, "OUT.nc")

    text = "write a result as GeoTIFF, GeoPackage, CSV, KML or DXF"
    export = result("export", text, "export")
    export.add_argument("folder", metavar="DIR", type=Path, help="output folder (created)")
    text = "tif, gpkg, csv (default: these three), kml, dxf; of HAZARD.nc: kml, dxf"
    _option(export, "--formats FORMAT", str, text, nargs="+")
    _option(export, "--tolerance M", float, "tolerance of drawn parabolas; default: 0.05")
    _add_tables(export, "line statistics and return levels")
    text = "also write project.qgz, with groups, styles and layouts on A3"
    project = export.add_argument_group("QGIS project")
    project.add_argument("--qgis", action="store_true", help=text)
    _option(project, "--dem FILE", Path, "default: DEM of the case, if found")
    _option(project, "--hazard HAZARD.nc", Path, "add the zones of this hazard")
    _add_imprint(project, "on layouts", "language of project and tables: ")
    text = "compare results with observations, or variants with the first of them"
    compare = _add(commands, "variants", "compare", text)
    text = "results OUT.nc and observations OBSERVED.csv, or only variants A.nc B.nc ..."
    compare.add_argument("files", metavar="FILE", type=Path, nargs="+", help=text)
    _option(compare, "-o --output TABLE.csv", Path, "write all tables as CSV")
    _option(compare, "--maps DIR", Path, "difference maps of variants, as GeoTIFF")
    text = "one page (.html, .pdf) with a column for each variant"
    _option(compare, "--report FILE", Path, text)
    text = "costs of variants in the report: NAME=AMOUNT"
    _option(compare, "--costs COST", str, text, nargs="+", default=[])
    _add_imprint(compare, "in the report")
    lines = _add(commands, "lines", "lines", LINES, "OUT.nc")
    _option(lines, "-o --output TABLE.csv", Path, "also write the table")
    _option(lines, "--by WHAT", str, "split by source, volume or block shape (shape)")
    text = "limits of volume classes [m3], such as 0.1,0.5,1; default: quartiles"
    _option(lines, "--classes V,V", str, text)
    text = "distribution along this line; with -o TABLE.csv also a figure TABLE.png"
    _option(lines, "--along LINE", str, text)
    text = "width of windows along the line; default: a round number, about 40 windows"
    _option(lines, "--width M", float, text)
    _add_section(commands)
    figures = result("figures", "draw all figures of a result")
    figures.add_argument("folder", metavar="DIR", type=Path, help="output folder (created)")
    figures.add_argument("--format", default="png", help="png (default), pdf or svg")
    report = result("report", REPORT)
    _option(report, "-o --output FILE", Path, "default: OUT.html")
    _switch(report, "--pdf", "write a PDF instead of the page")
    text = "add an interactive map and trajectories in three dimensions"
    report.add_argument("--3d", dest="view", action="store_true", help=text)
    _add_imprint(report, "on page 1")
    _option(report, "--dem-date TEXT", str, "date of the survey of the DEM", default="")
    _option(report, "--hazard HAZARD.nc", Path, "add the zones of this hazard")
    text = "add the spread over rebound models, from `rockfall models`, on page 1"
    _option(report, "--models MODELS.nc", Path, text)
    _option(report, "--factors CSV", Path, FACTORS)
    text = "add a section along this line, as in `rockfall section`"
    _option(report, "--section X,Y", str, text, nargs="+")
    _option(report, "--section-layer NAME", str, "layer name, if the file has several")
    text = "half width of the section; default: %(default)s"
    _option(report, "--section-within M", float, text, default=10.0)
    _add_design(commands)
    for verb in figures, report:
        _option(verb, "--dem FILE", Path, "default: DEM of the case, if found")
        _option(verb, "--observed CSV", Path, "observations to draw next to the results", nargs="+")
        _option(verb, "--basemap FILE", Path, "background image of the maps")
        _option(verb, "--limits UNIT=LIMITS", str, "limits of classes: kJ=30,300 m=1,5", nargs="+")


def _add_section(commands: _Commands) -> None:
    text = "draw a section along a line: profile, trajectories, envelopes of energy and height"
    section = _add(commands, "results", "section", text, "OUT.nc")
    text = "vertices, in quotes if any is negative, or a layer with one line"
    _option(section, "--line X,Y", str, text, nargs="+", required=True)
    _option(section, "--line-layer NAME", str, "layer name, if the file has several")
    _option(section, "--within M", float, "half width of the section; default: 10")
    _option(
        section,
        "--every M",
        float,
        "distance between stations; default: a round number, about 100 stations",
    )
    text = "tables NAME.csv, NAME_lines.csv and figure NAME.png; default: OUT_section.csv"
    _option(section, "-o --output NAME.csv", Path, text)
    _option(section, "--dem FILE", Path, "default: DEM of the case, if found")


def _add_tables(command: argparse.ArgumentParser, what: str) -> None:
    text = f"also write {what} as a workbook (xlsx) or a document (docx)"
    _option(command, "--tables FORMAT", str, text, nargs="+", default=[])


def _add_imprint(command: argparse._ActionsContainer, where: str, what: str = "") -> None:
    help_text = f"{what}en (default), de, fr, it, or with a region such as de-AT"
    _option(command, "--language XX", str, help_text, default="en")
    for name, help_text in (
        ("project", "project name or number"),
        ("client", "client"),
        ("author", "author, who signs"),
    ):
        command.add_argument(f"--{name}", metavar="TEXT", default="", help=f"{help_text}; {where}")


def _add_design(commands: _Commands) -> None:
    text = "print requirements for barriers at lines, or the block of a return period"
    sheet = _add(commands, "protection", "design", text)
    text = "results; or hazards, as HAZARD.nc or folder, with --return-period and --costs only"
    sheet.add_argument("results", metavar="OUT.nc", type=Path, nargs="*", help=text)
    _option(sheet, "-o --output DIR", Path, "folder for tables and figures")
    _add_tables(sheet, "the tables")
    text = "language of these tables: en (default), de, fr, it, or with a region such as de-AT"
    _option(sheet, "--language XX", str, text, default="en")
    _add_conditions(sheet)
    text = "acceptable passing fraction of the arriving boulders; default: 0.01"
    _option(sheet, "--residual FRACTION", float, text)
    _option(sheet, "--along LINE", str, "height and class along this line, metre by metre")
    _option(sheet, "--width M", float, "width of windows along the line; default: 10")
    _option(sheet, "--min-boulders N", int, "minimum number of boulders in a window; default: 50")
    block = sheet.add_argument_group("block of a return period")
    text = (
        "block exceeded once in this period, from the survey --blocks; for a hazard: at most one "
    )
    text += "boulder may pass a barrier in this period (default: 100)"
    _option(block, "--return-period YEARS", float, text)
    _option(block, "--years YEARS", float, "length of the complete record of falls")
    text = "dated blocks; default: blocks of --blocks with a year"
    _option(block, "--events CSV", Path, text)
    text = "minimum volume of the fit; default: lowest volume above which a distribution fits"
    _option(block, "--threshold M3", float, text)
    text = "largest block of the scenario; default: block of ten return periods"
    _option(block, "--volume-max M3", float, text)
    _add_site(commands)


def _add_site(commands: _Commands) -> None:
    text = "compare alignments of a barrier above a line: loads, requirements, best choice"
    site = _add(commands, "protection", "site", text, "CASE")
    _option(site, "-o --output DIR", Path, "default: CASE_siting")
    text = "evaluation line to protect"
    _option(site, "--line NAME", str, text, required=True)
    text = "distance between alignments, shifted towards the sources; default: 10"
    _option(site, "--every M", float, text)
    _option(site, "--to M", float, "maximum distance from the line; default: 100")
    text = "direction of the shift, in degrees from north; default: perpendicular to the line"
    _option(site, "--direction AZIMUTH", float, text)
    _option(site, "--candidates LAYER", Path, "drawn alignments instead of shifted lines")
    _option(site, "--candidates-layer NAME", str, "layer name, if the file has several")
    _option(site, "--max-height M", float, "maximum height of the barrier")
    _option(site, "--max-class CLASS", int, "maximum EAD 340059 class, 0 to 7")
    text = "maximum fraction of boulders that bypass an alignment; default: 0.01"
    _option(site, "--max-bypass FRACTION", float, text)
    _option(site, "--space M", float, "braking distance available between barrier and line")
    text = "boulders per year that may still reach the line, over all &scenario groups"
    _option(site, "--acceptable PER_YEAR", float, text)
    text = "memory for the run; if half of it is too small, the run is split; default: all"
    _option(site, "--memory SIZE", str, text)
    _add_conditions(site)
    _add_overrides(site)


def _add_conditions(command: argparse.ArgumentParser) -> None:
    """Add options for the requirements of a standard."""
    for key, default, does in (
        ("standard", "UNI", "UNI (11211-4) or ONR (24810)"),
        ("survey", "poor", "survey of the topography: good or poor"),
        ("blocks", "poor", "survey of blocks: good or poor; with --return-period, its table (CSV)"),
        ("calibration", "literature", "calibration of the rebound: back-analysed or literature"),
        ("limit-state", "MEL", "MEL: one large impact, SEL: several"),
        ("consequence", "CC2", "consequence of a failure, for ONR: CC1, CC2 or CC3"),
    ):
        text = f"{does}; default: {default}"
        command.add_argument(f"--{key}", metavar=key.upper().replace("-", "_"), help=text)
    text = "volume of the design block; default: a quantile of the arriving boulders"
    _option(command, "--volume M3", float, text)
    _option(command, "--factors CSV", Path, FACTORS)
    _option(command, "--costs CSV", Path, COSTS)


def _add_ground(commands: _Commands) -> None:
    text = "measure strength and relief of a ground, as a row of a table of grounds"
    ground = commands.add_parser("ground", help=text, description=text.capitalize() + ".")
    ground.set_defaults(command=command_of("rockfall.cli.commands.ground", "ground"))
    text = "scars, with columns named as the options below: depth, mass, fall..."
    ground.add_argument("scars", metavar="SCARS.csv", type=Path, nargs="?", help=text)
    for names, does in (
        ("--depth M", "depth of the lowest point of each scar"),
        ("--depth-error M", "standard error of the depth; default: 0"),
        ("--mass KG", "mass of each block"),
        ("--volume M3", "volume of each block, instead of its mass"),
        ("--density KG_M3", "density of the blocks; default: 2700"),
        ("--fall M", "height of each vertical fall"),
        ("--fall-error M", "standard error of the fall; default: 0"),
        ("--speed M_S", "speed normal to the ground, instead of the fall"),
        ("--speed-error M_S", "standard error of the speed; default: 0"),
    ):
        _option(ground, names, float, does, nargs="+")
    _option(ground, "--patch PATCH.tif", Path, "DEM of a patch in small cells, for the relief")
    _option(ground, "--radius R", float, "R_b for the relief [m]; default: mean of the scars")
    _option(
        ground, "--shortest L", float, "shortest wave of the patch, in R_b; default: 2", default=2.0
    )
    _option(
        ground, "--longest L", float, "longest wave of the patch, in R_b; default: 32", default=32.0
    )
    _option(
        ground, "--model MODEL", str, "ground model: ploughed (default) or hard", default="ploughed"
    )
    text = "block shape: sphere, compact (default), elongated or platy"
    _option(ground, "--shape SHAPE", str, text, default="compact")
    _switch(ground, "--proportional", "strength in proportion to R_b; default: equal for all sizes")
    _option(
        ground, "--rest-angle DEGREE", float, "default: rest angle of the nearest shipped ground"
    )
    _option(
        ground, "--name NAME", str, "name of the row; default: own-ground", default="own-ground"
    )
    text = "source of the row; default: measured scars and relief"
    _option(ground, "--source TEXT", str, text, default="measured scars and relief")
    text = "table of grounds to write or extend"
    _option(ground, "-o --output GROUNDS.csv", Path, text)


def _add_lab(commands: _Commands) -> None:
    """Add the laboratory, a separate package that adds its commands on demand."""
    text = "impacts of spheres on rocks or of blocks on a ground, and impact sets from them"
    lab = commands.add_parser("lab", help=text, description=text.capitalize() + ".")
    lab.package = "rockfall_lab"
