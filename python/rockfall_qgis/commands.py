# SPDX-License-Identifier: BSD-3-Clause
"""Commands of the program in the toolbox and arguments of their parameters: data."""

from dataclasses import dataclass

POINT, LINE, POLYGON = "point", "line", "polygon"


@dataclass(frozen=True)
class Option:
    """A parameter of a command; `kind` is a key of `algorithm.MAKERS`."""

    name: str
    label: str
    kind: str
    flag: str = ""  #: "": its value has no flag
    optional: bool = True
    advanced: bool = False
    choices: tuple[str, ...] = ()  #: texts of a choice, shapes of a layer, endings of a file


@dataclass(frozen=True)
class Command:
    """A command of the program as an algorithm of QGIS."""

    name: str
    title: str
    about: str
    options: tuple[Option, ...]


CASE = Option("CASE", "Case", "file", optional=False, choices=("nml",))
RESULT = Option("RESULT", "Result of a run", "file", optional=False, choices=("nc",))
FOLDER = Option("FOLDER", "Folder of the results", "folder", "-o", optional=False)
OVERWRITE = Option("OVERWRITE", "Replace earlier results", "yes", "--overwrite")
OVERRIDES = (
    Option("BOULDERS", "Boulders from each source (empty: the case's)", "count", "--boulders"),
    Option("BOULDERS_TOTAL", "or: boulders from all sources together", "count",
           "--boulders-total"),
    Option("SEED", "Seed of the random numbers (empty: the case's)", "number", "--seed"),
    Option("THREADS", "Threads (0: all cores; empty: the case's)", "number", "--threads",
           advanced=True),
)  # fmt: skip
RESUME = Option("RESUME", "Continue a stopped run", "yes", "--resume", advanced=True)
RUNS = (*OVERRIDES, RESUME)
#: Layers of a project from which `rockfall new` makes a case, by their names in files.
DRAFTS = (
    Option("SOURCES", "Sources (default: steep cells)", "layer", choices=(POINT, POLYGON)),
    Option("ZONES", "Zones with mean_radius, rg70 to rg10 or ground", "layer", choices=(POLYGON,)),
    Option("LINES", "Lines: where crossings are recorded, or barriers with height and capacity",
           "layer", choices=(LINE,)),
    Option("BARRIERS", "Barriers with height [m], and capacity [kJ] or class", "layer",
           choices=(LINE,)),
    Option("DAMS", "Dams with height [m]", "layer", choices=(LINE,)),
    Option("FOREST", "Forest: trees with dbh [cm], or stands with stems per hectare", "layer",
           choices=(POINT, POLYGON)),
)  # fmt: skip
#: Ground of zones without one, for `rockfall new`.
GROUND = Option(
    "GROUND", "Ground of zones without one, or of the slope", "choice",
    choices=("rock", "rocky-slope", "talus", "compact", "meadow", "vegetated-soil", "soft-soil"),
)  # fmt: skip
#: Uses that `rockfall new` may give to such a layer, apart from its own name.
KINDS = {"lines": {"lines", "barriers", "dams"}, "forest": {"trees", "stands"}}

COMMANDS = (
    Command(
        "new",
        "Make a case from layers of the project",
        "Writes case.nml, with comments on what to choose, and layers.gpkg into the folder, "
        "from a DEM and layers of the project. Nothing is run: edit the case there, check it, and "
        "run it.",
        (
            Option("DEM", "Elevations (DEM)", "raster", optional=False),
            *DRAFTS,
            GROUND,
            Option("FOLDER", "Folder of the case", "folder", "-o", optional=False),
        ),
    ),
    Command(
        "check",
        "Check a case",
        "Reads and checks everything that a case names, simulates a few boulders, and prints what "
        "would run and how long it would take.",
        (CASE,),
    ),
    Command(
        "run",
        "Run a case, or layers of the project",
        "Runs a case file. Or, of a DEM and layers of the project, first writes case.nml into the "
        "folder, with comments on what to choose, and runs it; edit it there, and run it "
        "again as a case. The folder then has result.nc, and in maps GeoTIFF, GeoPackage and CSV, "
        "which are loaded with their styles. When it is cancelled it keeps what has been done.",
        (
            Option("CASE", "Case", "file", choices=("nml",)),
            Option("DEM", "or: elevations (DEM)", "raster"),
            *DRAFTS,
            GROUND,
            *RUNS,
            Option("UNTIL", "Until intervals are narrow enough, as 'fraction@road<3%'", "text",
                   "--until", advanced=True),
            FOLDER,
            OVERWRITE,
        ),
    ),
    Command(
        "export",
        "Load a result",
        "Writes a result as GeoTIFF, GeoPackage and CSV, and loads them with their styles.",
        (
            RESULT,
            Option("FOLDER", "Folder of the maps", "folder", optional=False),
            Option("QGIS", "With a project of QGIS (project.qgz), and layouts", "yes", "--qgis"),
            Option("HAZARD", "Zones in this project (hazard.nc)", "file", "--hazard",
                   choices=("nc",)),
            OVERWRITE,
        ),
    ),
    Command(
        "report",
        "Write a report",
        "Writes a result as one page, to be read offline.",
        (
            RESULT,
            Option("DEM", "Elevations (default: the case's)", "raster", "--dem", advanced=True),
            Option("OBSERVED", "Observations", "file", "--observed", choices=("csv",)),
            Option("VIEW", "With a view in three dimensions", "yes", "--3d"),
            Option("PAGE", "Page", "page", "-o", optional=False),
            OVERWRITE,
        ),
    ),
    Command(
        "hazard",
        "Hazard zones",
        "Runs the scenarios of a case: annual frequencies, zones of hazard, objects at risk.",
        (
            CASE,
            Option("OBJECTS", "Objects at risk", "layer", "--objects",
                   choices=(POINT, LINE, POLYGON)),
            *RUNS,
            FOLDER,
            OVERWRITE,
        ),
    ),
    Command(
        "ensemble",
        "Vary the uncertain inputs",
        "Runs a case over the uncertain inputs that it names, and ranks them by effect.",
        (
            CASE,
            Option("RUNS", "Draws of the uncertain inputs (empty: the case's)", "count", "--runs"),
            *OVERRIDES,
            Option("OUT", "Result (.nc), or a table (.csv)", "runs", "-o", optional=False),
            OVERWRITE,
        ),
    ),
    Command(
        "back",
        "Back-analysis",
        "Fits the uncertain inputs of a case to observations.",
        (
            CASE,
            Option("OBSERVED", "Observations (CSV)", "files", optional=False),
            Option("MEMBERS", "Maximum number of runs", "count", "--members"),
            Option("EFFECTIVE", "Effective sample size of the posterior", "count", "--effective",
                   advanced=True),
            *OVERRIDES,
            FOLDER,
            OVERWRITE,
        ),
    ),
    Command(
        "compare",
        "Compare results",
        "Compares results with observations; or variants with the first of them, without "
        "observations, with maps of the differences and a page.",
        (
            Option("RESULTS", "Results; of variants the bare one first", "files", optional=False),
            Option("OBSERVED", "Observations (CSV)", "files"),
            Option("TABLE", "Table (CSV)", "table", "-o"),
            Option("MAPS", "Folder of the maps of differences", "maps", "--maps"),
            Option("PAGE", "Page on the variants", "page", "--report"),
            OVERWRITE,
        ),
    ),
    Command(
        "design",
        "Design of barriers",
        "Requirements for barriers at the lines of a result, and a check of its barriers.",
        (
            RESULT,
            Option("ALONG", "Line to analyse metre by metre", "text", "--along"),
            Option("STANDARD", "Standard", "choice", "--standard", choices=("UNI", "ONR")),
            Option("SURVEY", "Survey of the topography", "choice", "--survey",
                   choices=("poor", "good")),
            Option("BLOCKS", "Survey of the blocks", "choice", "--blocks",
                   choices=("poor", "good")),
            Option("CALIBRATION", "Calibration of the rebound", "choice", "--calibration",
                   choices=("literature", "back-analysed")),
            Option("LIMIT_STATE", "Limit state", "choice", "--limit-state",
                   choices=("MEL", "SEL")),
            Option("CONSEQUENCE", "Consequence of a failure (ONR)", "choice", "--consequence",
                   choices=("CC1", "CC2", "CC3")),
            Option("RESIDUAL", "Fraction that may pass", "real", "--residual"),
            Option("VOLUME", "Volume of the design block [m3]", "real", "--volume"),
            Option("FACTORS", "Table of factors", "file", "--factors", advanced=True,
                   choices=("csv",)),
            Option("COSTS", "Table of costs", "file", "--costs", advanced=True, choices=("csv",)),
            FOLDER,
            OVERWRITE,
        ),
    ),
)  # fmt: skip
