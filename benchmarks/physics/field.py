# SPDX-License-Identifier: BSD-3-Clause
"""Compare simulations with observations at field sites, for each rebound model: the tables of
docs/validation/field.

    python -m benchmarks.physics.field [--site tschamut vaujany impacts mel-de-la-niva]
        [--data FOLDER] [--half calibration|held-out|all] [--seeds 301 302 303]
        [--platrock PYTHON] [--law NAME=TABLE] [--ground ROW]
        [--write]

Prints a Markdown table for each observed place and quantity: mean, standard deviation, 5, 50 and 95
% quantiles, Kolmogorov-Smirnov statistic with p, Wasserstein distance, lateral spread. Values are
means over seeds (at Vaujany, over generated slopes), with standard errors of the last digit shown.
Means within 10 % of the observation, and standard deviations within 25 %, are marked ✓, others ✗,
or ? if errors do not decide. Statistics are those of `rockfall validate`.

Data are downloaded (pip install 'rockfall[field]') or taken from FOLDER (see
benchmarks/field_data.py). Only the calibration half of Tschamut is run unless --half selects
another; docs/archive/field_protocol.md lists the choices made in advance. PYTHON is an interpreter
with PlatRock (benchmarks.speed.platrock); without it, that row is omitted with a note. --write
stores the tables in docs/archive/field_tables.md and the impacts in
docs/validation/field/impacts.md.
"""

import argparse
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import rasterio
import xarray as xr

import rockfall
from benchmarks.field_data import fetch
from benchmarks.machine import NOTHING, ROOT, machine
from benchmarks.physics import impacts, platrock_runs
from benchmarks.physics.laws import Law, add_laws, changed_ground, ground, matrix, table
from benchmarks.physics.tschamut import SHAPE_OF_BLOCK
from cases.tschamut.make_case import HALVES, make
from rockfall.analysis.observed.observations import Observed, read_observed
from rockfall.analysis.observed.run_out import Sample
from rockfall.errors import RockfallError
from rockfall.grounds import shipped_rows, yielding_ground
from rockfall.io.atomic import atomic_write
from rockfall.quantities import QUANTITIES
from rockfall.result.crossings import line_names, line_values
from rockfall.studies.validation import (
    BEYOND,
    COLUMNS,
    FEWEST,
    QUANTILES,
    RUN_OUT,
    UNDECIDED,
    WITHIN,
    Key,
    Number,
    comparable_numbers,
    over_runs,
    run_out_numbers,
)
from rockfall_lab.scorecard.vaujany_slope import CELL, NORTH, WEST, Talus, zones

TABLES = ROOT / "docs/archive/field_tables.md"
RELIEFS = 0.7, 1.4  # factors on the relief of the ground
SLOPES = 16  # number of slopes generated as in cases/vaujany
FIRST_SLOPE = 3000  # seed of the first slope; no calibration has used it
MARKS = {WITHIN: " ✓", BEYOND: " ✗", UNDECIDED: " ?", "": ""}
TITLES = {
    "mean": "mean", "std": "std", "q05": "5 %", "q50": "50 %", "q95": "95 %", "ks": "KS", "p": "p",
    "wasserstein": "Wasserstein", "lateral_std": "lateral std",
}  # fmt: skip
BARE = "ks", "p"  # columns without a unit
ON_PASTURE = (
    "soil_1", "soil_2", "rockyfor3d-2023:soil_2", "pfeiffer_soil", "constant_meadow",
    "bourrier_hungr_soft", "bourrier_hungr",
)  # fmt: skip
ON_TALUS = (
    "soil_4", "rockyfor3d-2023:soil_4", "pfeiffer_talus", "pfeiffer_rock", "constant_talus",
    "rock_ledge", "bourrier_hungr",
)  # fmt: skip
PASTURE_TABLES = "meadow", "vegetated-soil", "talus"
TALUS_TABLES = "talus", "rock"


@dataclass(frozen=True)
class Part:
    """Part of a site: a case, its observations, and the shape of its blocks."""

    case: rockfall.Case
    seen: Observed
    shape: str


def relief_laws(name: str) -> Iterator[Law]:
    """Models of a ground with its relief multiplied by RELIEFS."""
    own = yielding_ground(shipped_rows().rows[name])[1]
    for factor in RELIEFS:
        yield changed_ground(f"table {name}, relief x {factor:g}", name, relief=factor * own.relief)


def site_laws(given: argparse.Namespace, tables: Sequence[str], rows: Sequence[str]) -> list[Law]:
    """Rebound models of a site: the matrix, impact tables, the first table with other reliefs,
    classical grounds, and requested models, which replace others of the same name."""
    shipped = [table(f"table {name}={name}") for name in tables]
    laws = [matrix(), *shipped, *relief_laws(tables[0]), *map(ground, rows), *given.law]
    return [*{law.name: law for law in laws}.values()]


def rows_of(name: str, runs: Sequence[dict]) -> list[dict[str, Any]]:
    """Rows with the statistics of a model over repeated runs."""
    return [{"law": name, **row} for row in over_runs(runs)]


# ---- Tschamut


def pasture_parts(folder: Path) -> list[Part]:
    """Blocks of Tschamut, each with its shape."""
    case = rockfall.read_case(ROOT / "cases" / "tschamut" / "case.nml")
    parts = []
    for block, shape in SHAPE_OF_BLOCK.items():
        part = case.replace(
            terrain={"dem": str(folder / "dem.asc")},
            release={"points": str(folder / f"releases-{block}.csv")},
            boulder={"block_shape": None},
            impact={"form": "matrix", "table": None},
            output=NOTHING,
        )
        parts.append(Part(part, read_observed(folder / f"observed-{block}.csv"), shape))
    return parts


def pasture(given: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """Rows for every rebound model at Tschamut."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        make(given.half, given.data, folder)
        parts = pasture_parts(folder)
        for law in site_laws(given, PASTURE_TABLES, ON_PASTURE):
            runs = []
            for seed in given.seeds:
                pairs = []
                for part in parts:
                    case = part.case.replace(case={"seed": seed}, **law.everywhere(part.shape))
                    pairs.append((rockfall.run(case), part.seen))
                runs.append(comparable_numbers(pairs))
            yield from rows_of(law.name, runs)
        if given.platrock is None:
            print("PlatRock is left out: --platrock names no Python that has it")
            return
        yield from _by_platrock(given, folder)


def _by_platrock(given: argparse.Namespace, folder: Path) -> Iterator[dict[str, Any]]:
    """Rows for PlatRock; none, and a printed message, if it does not run."""
    seen = pd.read_csv(folder / "observed.csv")
    ways = seen[["x", "y"]].values - seen[["start_x", "start_y"]].values
    x, y = ways.mean(axis=0)
    across = np.array([-y, x]) / np.hypot(x, y)

    def sample(ways: np.ndarray, source: np.ndarray) -> Sample:
        return Sample(np.column_stack([np.hypot(*ways.T), ways @ across]), source)

    observed = sample(ways, np.arange(len(ways)))
    runs = []
    for seed in given.seeds:
        try:
            ways, source = platrock_runs.stops(given.platrock, folder, seed)
        except platrock_runs.PlatRockError as error:
            print(f"PlatRock is left out: {error}")
            return
        numbers = run_out_numbers(observed, sample(ways, source), one_frame=True)
        runs.append({("", RUN_OUT, name): one for name, one in numbers.items()})
    yield from rows_of(platrock_runs.NAME, runs)


# ---- Vaujany


def talus(given: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """Rows for every rebound model at the two lines of Vaujany, over generated slopes."""
    folder = ROOT / "cases" / "vaujany"
    paper = {
        f"`bourrier2009`, {method}": rockfall.read_case(folder / name)
        for method, name in (("A", "case_A.nml"), ("B", "case.nml"))
    }
    of_method_b = paper["`bourrier2009`, B"]
    observed = of_method_b.replace(impact={"sets": "vaujany-observed", "ratio": "between"})
    cases = paper | {"`vaujany-observed`, B": observed}
    for law in site_laws(given, TALUS_TABLES, ON_TALUS)[1:]:
        cases[law.name] = of_method_b.replace(**law.of("compact"))
    seen = read_observed(folder / "paper.csv")
    place = rasterio.Affine(CELL, 0, WEST, 0, -CELL, NORTH)
    for name, case in cases.items():
        runs = []
        for k in range(given.slopes):
            one = case.replace(
                case={"boulders": given.boulders, "seed": FIRST_SLOPE + k}, output=NOTHING
            )
            z = Talus(seed=FIRST_SLOPE + k).elevation()
            result = rockfall.run(one, dem=z, transform=place, zones=zones())
            runs.append(comparable_numbers([(result, seen)]) | dict(_quantiles(result, seen)))
        yield from rows_of(name, runs)


def _quantiles(result: xr.Dataset, seen: Observed) -> Iterator[tuple[Key, Number]]:
    """Simulated quantiles at the lines, for which no printed values exist."""
    names = line_names(result)
    observed = seen.summaries[seen.summaries["method"] == "observed"]
    for line, quantity in observed[["line", "quantity"]].values:
        values = line_values(result, quantity, names.index(line))
        values = values[np.isfinite(values)]
        for name, q in QUANTILES.items():
            value = float(np.quantile(values, q)) if values.size >= FEWEST else np.nan
            yield (line, quantity, name), Number(np.nan, np.nan, np.nan, value)


# ---- Mel de la Niva


def event(given: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """Rows for every rebound model at the Mel de la Niva, with inputs from its `make_case.py`.
    Raises a RockfallError if its folder has no observed.csv."""
    folder = ROOT / "cases" / "mel-de-la-niva"
    if not (folder / "observed.csv").exists():
        raise RockfallError(f"{folder}: has no observed.csv: run make_case.py there first")
    seen = read_observed(folder / "observed.csv")
    case = rockfall.read_case(folder / "case.nml").replace(
        case={"boulders": given.boulders}, output=NOTHING
    )
    for law in site_laws(given, TALUS_TABLES, ON_TALUS):
        of_law = case.replace(**law.everywhere("compact"))
        runs = [
            comparable_numbers([(rockfall.run(of_law.replace(case={"seed": seed})), seen)])
            for seed in given.seeds
        ]
        yield from rows_of(law.name, runs)


# ---- tables


def markdown(rows: list[dict[str, Any]]) -> Iterator[str]:
    """Markdown table for each place and quantity."""
    found = pd.DataFrame(rows, columns=COLUMNS)
    for (line, quantity), of_place in found.groupby(["line", "quantity"], sort=False):
        about = QUANTITIES[quantity]
        n = of_place["n_observed"].max()
        count = f"{n:.0f} observed" if np.isfinite(n) else "observed numbers as printed"
        yield f"\n{line + ', ' if line else ''}{about.label} [{about.unit}], {count}\n"
        yield "| law | " + " | ".join(TITLES.values()) + " |"
        yield "|---" * (len(TITLES) + 1) + "|"
        first = of_place.drop_duplicates("statistic").set_index("statistic")
        cells = [_cell(first, name, "observed", about.factor) for name in TITLES]
        yield "| observed | " + " | ".join(cells) + " |"
        for law, of_law in of_place.groupby("law", sort=False):
            each = of_law.set_index("statistic")
            cells = [_cell(each, name, "simulated", about.factor) for name in TITLES]
            yield f"| {law} | " + " | ".join(cells) + " |"


def _cell(rows: pd.DataFrame, name: str, whose: str, factor: float) -> str:
    """Cell of a table: value with its standard error and, if simulated, the mark of its verdict;
    "-" for a missing value."""
    if name not in rows.index or not np.isfinite(rows.loc[name, whose]):
        return "-"
    row = rows.loc[name]
    factor = 1.0 if name in BARE else factor
    value, error = factor * row[whose], factor * row[f"{whose}_error"]
    text = f"{value:.2g}" if name == "p" else f"{float(f'{value:.3g}'):g}"
    if name != "p" and np.isfinite(error):
        text += f" ± {float(f'{error:.1g}'):g}"
    return text + (MARKS[row["verdict"]] if whose == "simulated" else "")


def place(name: str, half: str) -> str:
    """Marker for the position of a site's tables on the page."""
    return f"{name}, {half} half" if name == "tschamut" else name


def put(name: str, text: str) -> None:
    """Insert tables at the position with this name on their page. Raises a RockfallError unless the
    page has this position once."""
    path = PAGES.get(name, TABLES)
    page = path.read_text(encoding="utf-8")
    begin, end = f"<!-- {name} -->\n", f"<!-- end of {name} -->\n"
    if page.count(begin) != 1 or page.count(end) != 1:
        raise RockfallError(f"{path}: expected one place '{begin.strip()}' to '{end.strip()}'")
    before, _, rest = page.partition(begin)
    _, _, after = rest.partition(end)
    with atomic_write(path) as part:
        part.write_text(f"{before}{begin}\n{text.strip()}\n\n{end}{after}", encoding="utf-8")


SITES = {"tschamut": pasture, "vaujany": talus, "mel-de-la-niva": event}
IMPACTS = "impacts"
PAGES = {IMPACTS: ROOT / "docs/validation/field/impacts.md"}  # other sites: TABLES


def _of_site(name: str, given: argparse.Namespace) -> Iterator[str]:
    if name == IMPACTS:
        yield from impacts.page(fetch("chant_sura_esurf2019", given.data)["impacts.csv"])
    else:
        yield from markdown(list(SITES[name](given)))


def main(words: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    names = [*SITES, IMPACTS]
    parser.add_argument(
        "--site", nargs="+", choices=names, default=["tschamut", "vaujany", IMPACTS]
    )
    parser.add_argument("--data", type=Path, help="folder of field data, in place of downloads")
    parser.add_argument("--half", choices=HALVES, default="calibration")
    parser.add_argument("--seeds", type=int, nargs="+", default=[301, 302, 303])
    parser.add_argument("--slopes", type=int, default=SLOPES, help="of Vaujany")
    parser.add_argument("--boulders", type=int, default=1000, help="of each source but at Tschamut")
    parser.add_argument("--platrock", type=Path, help="a Python that has PlatRock")
    parser.add_argument("--write", action="store_true", help="put the tables on their page")
    add_laws(parser)
    given = parser.parse_args(words)
    if min(len(given.seeds), given.slopes) < 2:
        parser.error("at least 2 seeds, and 2 slopes, are needed for an error")
    print(machine())
    try:
        for name in given.site:
            print(f"\n## {place(name, given.half)}")
            text = "\n".join(_of_site(name, given))
            print(text, flush=True)
            if given.write:
                put(place(name, given.half), text)
    except RockfallError as error:
        print(f"field.py: {error}", file=sys.stderr)
        return error.code
    return 0


if __name__ == "__main__":
    sys.exit(main())
