# SPDX-License-Identifier: BSD-3-Clause
"""Write reference pages from the program's tables and parsers, so that they cannot differ:
docs/case.md, result.md, cli.md, api.md, ground_table.md and glossary.md; and the blocks of pages
that contain evidence.

python tools/document.py           writes them
python tools/document.py --check   checks whether they are up to date (exit status 0 or 1)
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
TERMS = DOCS / "glossary.csv"

CASE = """# The case file

This page lists all keys of the namelist file that the command line, Python and the standalone
program read. File names are relative to the case file. Text is in quotes, logicals are `.true.` or
`.false.`, lists are separated by commas (`3*0.0` repeats), `!` starts a comment. Reals are
within ±1e12; positive ones are at least 1e-12. An unknown group or key, a wrong type or a value
out of range is refused; an [unlikely value](start/checks.md) gives a warning. REPEATABLE may be
repeated. The page is made from the program's own table.
"""

VARIED = """
A variant also takes every key of `&terrain`, `&surface`, `&impact`, `&boulder`, `&release` and
`&forest` with its group as prefix, such as `forest_density_factor`, `surface_zones`,
`release_drop_height` ([variants](variants.md)).
"""

FORMATS = """
## Rasters and layers

| what | formats |
| --- | --- |
| rasters | GeoTIFF, ESRI ASCII, netCDF-4, Erdas Imagine, Surfer binary grids, SRTM tiles |
| polygons, points | GeoPackage, GeoJSON, shapefile, FlatGeobuf |

The content of a file, not its name, determines its format (except SRTM tiles, such as
`N46E007.hgt`). Other formats are refused, including those with text headers (EHdr, SAGA, ENVI,
Surfer text): convert them to GeoTIFF in metres (`rio` drops scales, offsets and units), and classic
netCDF to netCDF-4 with `nccopy`. A raster has one band and square cells, with north or south up.

- **Units** are metres. A missing unit means metres; any other unit is refused, of the axes and
  heights of a CRS, of a band, and of netCDF variables and coordinates.
- **ESRI ASCII**: lines of one key and one value, then the numbers. `xllcorner` with `yllcorner`, or
  `xllcenter` with `yllcenter`; `cellsize`, or `dx` with `dy`. Nodata is -9999, or `NODATA_value`
  (a number or `nan`), also when rounded to single precision. Grouped digits and decimal commas are
  refused.
- **netCDF**: `file.nc`, or `file.nc:variable`; on `y`, `x` with evenly spaced coordinates.
  `_FillValue`, `missing_value`, `valid_min`, `valid_max` and `valid_range` mark missing data;
  `_Unsigned`, `scale_factor` and `add_offset` convert data, in double precision. These attributes
  must have the type of the variable and agree with each other.
- **Layers**: a file with several needs the name of one. Views of a GeoPackage are refused. A
  GeoJSON gives its CRS by name (`EPSG:32632`), or has none.
- Files, including `.prj`, `.msk`, `.aux.xml` and `.dbf`, must be regular files. Nothing is read
  from the network.
"""

RESULT = """# The result

This page lists the variables of a result, which is a CF netCDF file or an `xarray.Dataset`. Its
attributes contain the complete case, the version of the program, checksums of all inputs, the range
of boulders, threads, wall and CPU seconds. Only requested variables exist. The page is made from
the program's own table.

A command replaces a file only with `--overwrite`, and never an input. Python functions replace
files, but never an input. Several files are written together or not at all.

- `input_checksums`: SHA-256 of the named files.
- `decoded_checksums`: SHA-256 of the data read: elevations and their place (`dem`), the radius of
  each cell (`surface`), the `sources`. [Parts and checkpoints](part_file.md) must agree in
  both.
- `input_warnings`: JSON list of [likely mistakes of inputs](start/checks.md): place, text in
  English, id and values of the message for translation.
- `dams`: JSON list of dams on the cells of the terrain, by the names of
  `rockfall.terrain.dams.DamShape`.
- `model_warnings`, only in Python: limits of the model for this run, one per line.
"""

GROUNDS = """# The shipped table of grounds

This page lists `python/rockfall/data/grounds.csv`, from which it is made. Each row is a classical
rebound, or a ground by impact tables. For models, parameters, units and the confirmation of values,
see [grounds](grounds.md).
"""

STATUSES = ", ".join(f"{k} {name}" for name, k in variables.STATUS.items())
STATUS = "\n" + textwrap.fill(f"`status` is one of: {STATUSES}.", 100) + "\n"

MAPS = """
Maps cover the rectangle of cells that boulders can reach from the sources with their energy at the
release, or, with `&output map_extent = 'terrain'`, the whole terrain.

- **Few passages.** Values exist where at least `&output min_passages` boulders passed (default 1).
  The attribute `thin_below` is the number below which there is no 95 % interval: 10 for a mean, 100
  for a standard deviation, and 6, 45, 92, 236, 476 for quantiles of 50, 90, 95, 98 and 99 %.
  Figures hatch such cells if the result counts `passages`.
- **Limits** are separate maps, such as `energy_q95_low` and `energy_q95_high`: order statistics as
  at the lines, which take boulders as independent. For given sources they contain the true value in
  95 % of cases or more. For a sample of sources (`&release sources`) the boulders of a place count
  as one (attribute `boulders_per_cluster`), which is conservative.
- **Passing heights** are vertical heights of the centre: jump height + R_b / cos(slope), with the
  slope of the cell (Horn 1981).
- **Quantiles** are computed from counts in classes (64 J to 8.6 GJ, 0.25 to 256 m/s, heights 0.06
  to 512 m), four per octave, which can be added for several parts. On `cases/vaujany` they are 0 to
  2 % above quantiles of the boulders themselves, with a scatter of 2 to 5 % for 100 boulders; a
  99 % quantile may exceed the maximum by one class. Each reached cell needs 440 bytes for energy,
  168 for speed and 216 for each of the heights; a standard deviation needs 24.
- **Sources.** A source reaches a cell if one of its boulders passed it; `sources` counts these
  sources. `reach_probability_by_source` is the passages divided by the boulders of these sources
  only, as in Rockyfor3D (Dorren 2016). With n boulders from each source it is never below 1/n, so
  it is too high for rarer passages.
- **Thresholds.** `energy_exceeded` and `hits_energy_exceeded` have a layer for each of `&hazard
  thresholds`, along the dimension `threshold` [J]; files and figures have a map for each, such as
  `energy_exceeded_30kJ`. A boulder counts where its maximum energy in the cell exceeds the
  threshold.
- **Hits.** `hits` counts the boulders that would hit an object of `&hazard object_width` (10 m) in
  the middle of the cell ([(10.8a)](theory/10-records.md#eq-10-8a)), whatever the cell size.
- **Energy lines** go from the release to the ground in the middle of each cell passed (not of the
  cell of the release), with a resolution of 0.0001 degrees. Travel times end with the arrival in
  the cell.
"""

SAMPLES = """
With `&output kept = 'none'` no rows of boulders are kept; with a number, only the rows of that
number of boulders (the first of each source). Memory and file then do not grow with the number of
boulders. With all rows, a boulder takes 120 bytes, and in the file 33 bytes for each line that it
crosses. `rockfall lines` with intervals and return levels, `run --until`, the summary and the
report then use samples.

- Values are counted in bins of whole units (mm, mm/s, J, mrad/s, millionths): bins of one unit
  below 512 units, then 256 bins per octave (up to 2^45). Quantiles are within 0.4 % or one unit of
  the quantiles of the rows. Mean, standard deviation and maximum are exact.
- The 100,000 largest speeds, heights and energies at each line are kept for return levels.
- Intervals need the differences between sources: each source is a group, as long as sources times
  (lines + 1) are at most 2048; beyond that neighbours share a group, and intervals do not get
  shorter. Statistics by source are exact for up to 50 features or sources (256 / (lines + 1) at
  most); more of them are combined into 20 ranges.
- `rockfall merge` adds samples. With `&release sources = 'sample'`, sources at one place are
  clusters, and maps are refused.
- Statistics by volume, along a line and of barriers, design, comparisons and distributions need
  rows: they use the kept boulders, and report this; with 'none' they are refused or left out.
  `ensemble`, `back`, `models` and `convergence` keep all rows.
"""

OF_MAPS = "Maps: dimensions `y`, `x`"
OF_SAMPLES = "Samples, where not all rows are kept"
CROSSINGS = "First crossings of evaluation lines: dimension `crossing`"
#: Text below the heading of a table.
BELOW = {
    CROSSINGS: """
There is a row for each line that a boulder crosses, sorted by `line` (from 0; `line_name` has the
names), then by `boulder`; `row_size` counts the rows of each line. Times and motion are in single
precision, within 1e-7 of their value; a place along a line of 1 km is within 0.1 mm.
`rockfall.crossings(result, line)` returns the table of a line with x, y, speed and energies,
`rockfall.at_lines(result)` dense variables such as `line_speed` (`line`, `boulder`). During a run
the rows are in an unnamed file next to the output, so the disk needs twice their space. The place
of a boulder that touches an object (`object_width`) is the point of the object nearest to its
centre.
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
    "Shadow angle, where observed (observed.md): dimension `boulder`": ("", variables.SHADOW),
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
    "Trajectories: dimension `trajectory_vertex`": ("trajectory_", variables.VERTEX),
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


GLOSSARY = """# Glossary

This page defines the terms of these pages, the case and the results in four languages. The last
column gives standards and guidelines that use the term, in all languages unless one is given.
Symbols are those of Bourrier et al. (2009). The page is made from `docs/glossary.csv`, whose terms
the messages and reports use.
"""


def glossary_page() -> str:
    """Page of terms in four languages."""
    rows = csv.DictReader(TERMS.read_text(encoding="utf-8").splitlines())
    names = {"en": "term", "de": "Deutsch", "fr": "français", "it": "italiano"}
    names |= {"meaning": "meaning", "used_in": "used in"}
    return f"{GLOSSARY}\n{table([*names.values()], [[row[key] for key in names] for row in rows])}"


def main() -> int:
    pages = {
        DOCS / "case.md": case_page(),
        DOCS / "result.md": result_page(),
        DOCS / "cli.md": cli_page(table),
        DOCS / "api.md": api_page(),
        DOCS / "ground_table.md": ground_page(),
        DOCS / "glossary.md": glossary_page(),
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
