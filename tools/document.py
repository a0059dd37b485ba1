# SPDX-License-Identifier: BSD-3-Clause
"""Write pages of reference from the program's own tables and parsers, so that they cannot differ:
docs/case.md, result.md, cli.md, api.md and ground_table.md; and the blocks of pages that hold
evidence.

python tools/document.py           writes them
python tools/document.py --check   says whether they are up to date (exit status 0 or 1)
"""

import csv
import sys
import textwrap
from itertools import groupby
from pathlib import Path

from document_evidence import BLOCK, filled
from document_interfaces import api_page, cli_page

from rockfall.case import REPEATABLE, key_table
from rockfall.result import variables

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
GROUND_TABLE = ROOT / "python/rockfall/data/grounds.csv"

CASE = """# The case file

One namelist file for the command line, for Python and for the standalone program. File names are
relative to the case file. Text stands in quotes, logicals are `.true.` or `.false.`, lists are
separated by commas (`3*0.0` repeats), `!` starts a comment. An unknown group or key, a wrong type
or a value out of range is refused in one line. Reals lie within 1e12 of zero, those that must be
above zero are at least 1e-12. What is possible but likely a mistake (a density in
t/m3, nodata that a raster does not declare, zones that overlap) is a warning of `rockfall check`,
`rockfall run` and `rockfall.run`. REPEATABLE may be repeated. This page is made from the
program's own table.
"""

VARIED = """
Besides these, a variant takes every key of `&terrain`, `&surface`, `&impact`, `&boulder`,
`&release` and `&forest` with its group before it, such as `forest_density_factor`,
`surface_zones`, `release_drop_height`: in place of that of the case. [Variants](variants.md) shows
how.
"""

FORMATS = """
## Rasters and layers

| what | formats |
| --- | --- |
| rasters | GeoTIFF, ESRI ASCII, netCDF-4, Erdas Imagine, Surfer binary grids, SRTM tiles |
| polygons, points | GeoPackage, GeoJSON, shapefile, FlatGeobuf |

The content of a file tells its format, not its name (but of SRTM tiles, such as `N46E007.hgt`).
Others are refused, those among them whose headers are text that GDAL reads loosely (EHdr, SAGA,
ENVI, Surfer text): make a GeoTIFF of them with `rio convert` or `gdal_translate`, as of a VRT; of
classic netCDF make netCDF-4 with `nccopy`. One band, square cells, north up or south up.

- **Units** are metres. A unit that is missing is taken as metre; any other is refused: of the axes
  of a coordinate reference system and of its heights, of the band, of netCDF variables and their
  coordinates.
- **ESRI ASCII**: lines of one key and one value, then the numbers. `xllcorner` with `yllcorner`, or
  `xllcenter` with `yllcenter`; `cellsize`, or `dx` with `dy`; -9999 is nodata unless
  `NODATA_value` says otherwise (`nan` too), also where numbers are rounded to single precision. No
  digit may be grouped, no comma be a decimal point.
- **netCDF**: `file.nc`, or `file.nc:variable` where it has several; on `y`, `x` with evenly spaced
  coordinates. `_FillValue`, `missing_value` (one or several), `valid_min`, `valid_max`,
  `valid_range` tell which stored numbers are data; `_Unsigned`, `scale_factor` and `add_offset`
  what they mean, in double precision. They must be of the type of the variable, and not contradict
  each other.
- **Layers**: one in the file. A GeoPackage must hold stored tables only, no views. A GeoJSON has
  its CRS by name (`EPSG:32632`), or none.
- No file leads to another place: nothing is asked of the network, and what lies beside a raster or
  a shapefile (`.prj`, `.msk`, `.aux.xml`, `.dbf`) must be a regular file.
"""

RESULT = """# The result

One CF netCDF file, or the same as an `xarray.Dataset`. Attributes hold the whole case, the version
of the program, checksums of all inputs, the range of boulders, threads, wall and CPU seconds. Only
what the case asks for is there. This page is made from the program's own table.

A command replaces a file only with `--overwrite`, and never one that the case, a part or the
command reads, whatever its name there (a link, another spelling). Functions in Python replace
files, as those of other packages do, but no inputs. Several files come all together or not at all.

`input_checksums` are SHA-256 of the named files; `decoded_checksums` of what was read of them and
of all that lies beside them: elevations and their place (`dem`), the radius of each cell
(`surface`), the `sources`. Parts and checkpoints ([files.md](files.md)) must agree in both.
`input_warnings` is a JSON list of [inputs that are likely mistakes](start/checks.md), each with its
place, what may have been meant, in English, and the id and values of that message, by which a page
says it in another language; `dams` one of dams as they came out on the cells of the terrain, by
names that `rockfall.terrain.dams.DamShape` explains. Functions in Python add `model_warnings`: the
limits of the model that matter for the run, one a line; files lack it.
"""

GROUNDS = """# The shipped table of grounds

Each row is a classical rebound, or a ground by tables of impacts. [grounds.md](grounds.md) explains
models and parameters, names their units, says how far these values are confirmed, and how to use a
table of your own. This page is made from `python/rockfall/data/grounds.csv`.
"""

STATUSES = ", ".join(f"{k} {name}" for name, k in variables.STATUS.items())
STATUS = "\n" + textwrap.fill(f"`status` is one of: {STATUSES}.", 100) + "\n"

MAPS = """
Maps cover the rectangle of cells that boulders can reach from the sources: no rebound adds energy,
so terrain higher than the energy at the release could lift a boulder to bounds their way. With
`&output map_extent = 'terrain'` they cover all of the terrain.

A mean and a quantile are shown wherever a boulder passed, or where at least `&output
min_passages` did (an attribute of the map then). The attribute `thin_below` says below how many
passages they are hardly known: 10 for a mean and 100 for a standard deviation, of which there is no
95 % interval below; 6, 45, 92, 236, 476 for quantiles of 50, 90, 95, 98 and 99 %, which then lack a
limit of theirs. Figures hatch such cells where the result
counts `passages`. The limits are maps of their own, such as `energy_q95_low` and
`energy_q95_high`: order statistics as at the lines, NaN where the cell has too few boulders.
Standard deviations (n - 1) come from exact sums of squares, and need two boulders. Passing heights
are those of the centre, vertical: jump height + R / cos(slope), as at the lines, but with the
slope of the cell (Horn 1981) in place of that under the boulder. Quantiles come from counts of
classes (64 J to 8.6 GJ, 0.25 to 256 m/s, heights 0.06 to 512 m), four an octave, straight within a
class: so they add up over parts of a run. On `cases/vaujany` they stand 0 to 2 % above those of
the boulders themselves (up to 6 % where values are alike in a test), with a scatter of 2 to 5 %
for 100 boulders (r.m.s.); a q99 may exceed the greatest value, by a class (25 %) at most. They
take 440, 168 and 216 bytes in each cell that a boulder reaches, for energy, speed and each of the
heights, a standard deviation 24; where the system has no more, the run ends with a line that says
so. The limits of cells, of the reach probability too, take boulders as independent: maps do not
know how sources differ. For the given sources they hold 95 % or more, the more the sources differ,
where the intervals at lines, stratified by source, hold 95 %. For a sample of sources (`&release
sources`) the boulders of a place count as one (attribute `boulders_per_cluster`), as if all of them
did the same: the limits hold 95 % or more, and are the wider the more alike the sources are;
quantiles of cells to which few sources lead have none.

A source feeds a cell when one of its boulders passed it; `sources` counts them.
`reach_probability_by_source` is the passages over the boulders of these sources only, as
Rockyfor3D has it (Dorren 2016): it does not fall because of sources far away. With n boulders from
each source it is never below 1/n, and too high where sources reach a cell more rarely than that. In
a part of a run it is of the boulders of the part. Both maps take 4 bytes a cell more than they
show, 8 in a part that begins within a source.

`energy_exceeded` and `hits_energy_exceeded` have a layer for each of `&hazard thresholds`, along
the dimension `threshold` [J]; files and figures have a map for each, such as
`energy_exceeded_30kJ`. A boulder counts where its maximum energy in the cell is above the
threshold. `hits` counts the boulders that would hit an object of `&hazard object_width` (10 m) in
the middle of the cell: those whose centre comes within half of it and their radius
([(10.8a)](theory/10-records.md#eq-10-8a)). It does not depend on the cell size. Energy lines go
from the release of a boulder (with its drop height) to the ground in the middle of each cell that
it passed but the first, that of its release; they are known to 0.0001 degrees. A time is that at
which a boulder comes to the cell, whatever it does before and after ([hazard.md](hazard.md)).
"""

SAMPLES = """
With `&output kept = 'none'`, or a number, the rows of none or of that many boulders are kept (from
each source its part of them, the first), and memory and file do not grow with the number of
boulders: 120 bytes for each, and in the file 33 for each line that it crosses, otherwise. What
boulders did at the lines and at their ends then goes into samples, from which `rockfall lines`, its
intervals and return levels,
`run --until`, the summary and the report take their numbers. Boulders are counted in bins of whole
mm, mm/s, J, mrad/s, millionths of shares: of one unit each below 512, from there 256 an octave (up
to 2^45), straight within a bin, so that quantiles stand within 0.4 % of those of the rows, or a
unit. Mean, standard deviation and maximum come from exact sums. The 100,000 largest speeds, heights
and energies at each line are kept themselves; return levels need no others.

Confidence intervals need to know how sources differ. Each source is a group of its own, counted in
coarser bins, as long as sources times (lines + 1) are at most 2048; of more, neighbours by number
share a group, and intervals are as long or longer (those of positions along a line, which hang on
the source, 5 to 15 % in a test with 60 sources; of other quantities 1 %). Statistics by source are
exact for up to 50 features or sources (256 / (lines + 1) at most); more are 20 ranges. `rockfall
merge` adds samples up. With `&release sources = 'sample'`, sources at one place are clusters of
their own here, and maps, whose limits need all boulders, are refused.

Numbers of other kinds need rows: by volume, along a line, of barriers and design, comparisons,
distributions and stops in figures and files. They take the boulders that are kept, and say so;
with 'none' they are refused or left out. `ensemble`, `back`, `models` and `convergence` keep all
rows of their own runs.
"""

OF_MAPS = "Maps: dimensions `y`, `x`"
OF_SAMPLES = "Samples, where not all rows are kept"
CROSSINGS = "First crossings of evaluation lines: dimension `crossing`"
#: Text below the heading of a table.
BELOW = {
    CROSSINGS: """
A row for each line that a boulder crosses, sorted by `line` (from 0; `line_name` has the names),
then by `boulder`; `row_size` counts the rows of each line. Times and motion are in single
precision, within 1e-7 of their value; a place along a line of 1 km is within 0.1 mm.
`rockfall.crossings(result, line)` gives the table of a line with x, y, speed and energies, which
follow, `rockfall.at_lines(result)` dense variables `line_speed` and so on (`line`, `boulder`) of a
few lines. Until a run ends they are in a file without a name next to its output, so that the disk
needs room for them twice. The place of a boulder that touches an object (`object_width`) is the
point of the object nearest to its centre.
""",
    OF_MAPS: MAPS,
    OF_SAMPLES: SAMPLES,
}
KINDS = {
    "Boulders: dimension `boulder`": ("", variables.BOULDER),
    "Mass, where sources come from a layer or give densities: dimension `boulder`": (
        "",
        variables.MASS,
    ),
    "Block shape, where boulders have several (impact_tables.md): dimension `boulder`": (
        "",
        variables.SHAPE,
    ),
    "Trees, where the case has some: dimension `boulder`": ("", variables.TREE),
    "Breakage, where boulders may break (breakage.md): dimension `boulder`": (
        "",
        variables.BREAKAGE,
    ),
    CROSSINGS: ("crossing_", variables.CROSSING),
    "Fragments at lines, where boulders may break: dimension `crossing`": (
        "crossing_",
        variables.FRAGMENT,
    ),
    "Barriers, where there are some: dimension `crossing`": ("crossing_", variables.HIT),
    OF_MAPS: ("", variables.MAP),
    "Counts over all boulders": ("", variables.COUNT),
    OF_SAMPLES: ("sample_", variables.SAMPLE),
    "Trajectories: dimension `trajectory_vertex`": (
        "trajectory_",
        variables.VERTEX,
    ),
}


def table(head: list[str], rows: list[list[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n"


def case_page() -> str:
    repeatable = "Only " + ", ".join(f"`&{one}`" for one in REPEATABLE)
    head, about = CASE.replace("REPEATABLE", repeatable).split("\n\n")
    page = f"{head}\n\n{textwrap.fill(about, 100, break_on_hyphens=False)}\n"
    for group, keys in groupby(key_table(), key=lambda key: key.group):
        rows = []
        for key in keys:
            if key.is_varied:
                continue
            several = "" if key.most == 1 else f", {key.most}" if key.most == 3 else ", list"
            default = key.default if key.default in ("required", "absent") else f"`{key.default}`"
            unit = f" [{key.unit}]" if key.unit else ""
            rows.append(
                [f"`{key.name}`", key.kind + several, default, key.allowed, key.meaning + unit]
            )
        head = ["key", "type", "default", "allowed", "meaning"]
        page += f"\n## &{group}\n\n{table(head, rows)}"
    return page + VARIED + FORMATS


def result_page() -> str:
    page = RESULT
    for title, (prefix, about) in KINDS.items():
        rows = [[f"`{prefix}{name}`", a["units"], a["long_name"]] for name, a in about.items()]
        page += f"\n## {title}\n\n{table(['variable', 'units', 'meaning'], rows)}"
        page += BELOW.get(title, "")
    rows = [
        [f"`{name}_histogram`", about["units"], about["long_name"]]
        for name, about in variables.HISTOGRAM.items()
    ]
    title = "Histograms over all rebounds: dimension `<name>_bin`, with bounds"
    page += f"\n## {title}\n\n{table(['variable', 'units of the bins', 'meaning'], rows)}"
    return page + STATUS


def ground_page() -> str:
    page = GROUNDS
    with GROUND_TABLE.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    about = {"name", "id", "model", "meaning", "source"}
    for model, alike in groupby(rows, key=lambda row: row["model"]):
        alike = list(alike)
        given = [key for key in alike[0] if key not in about and any(row[key] for row in alike)]
        named = [[f"`{row['name']}`", row["id"], *(row[key] for key in given)] for row in alike]
        said = [[f"`{row['name']}`", row["meaning"], row["source"]] for row in alike]
        page += f"\n## {model}\n\n"
        if given:
            page += table(["name", "id", *(f"`{key}`" for key in given)], named) + "\n"
        page += table(["name", "meaning", "source"], said)
    return page


def main() -> int:
    pages = {
        DOCS / "case.md": case_page(),
        DOCS / "result.md": result_page(),
        DOCS / "cli.md": cli_page(table),
        DOCS / "api.md": api_page(),
        DOCS / "ground_table.md": ground_page(),
    }
    for pattern in ("README.md", "docs/**/*.md", "cases/*/README.md"):
        for path in sorted(ROOT.glob(pattern)):
            if path not in pages and BLOCK.search(text := path.read_text()):
                pages[path] = filled(text)
    if "--check" in sys.argv:
        now = {path: path.read_text() if path.exists() else "" for path in pages}
        stale = [path.name for path, text in pages.items() if now[path] != text]
        if stale:
            print(f"not up to date: {', '.join(stale)}; run python tools/document.py")
        return int(bool(stale))
    for path, text in pages.items():
        path.write_text(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
