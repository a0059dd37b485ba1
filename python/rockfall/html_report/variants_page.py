# SPDX-License-Identifier: BSD-3-Clause
"""Page that compares variants of a protection, with a column for each."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from rockfall.analysis.validity.warnings import joint_warnings
from rockfall.case import FROM_ARRAY, Case, case_of
from rockfall.errors import RockfallError
from rockfall.html_report.inputs import Parties
from rockfall.html_report.page import check_page, is_pdf, write_page
from rockfall.html_report.render import picture, rendered
from rockfall.html_report.validity import missing
from rockfall.language import localised, say, speaking
from rockfall.plots.studies.difference_figures import difference_figure
from rockfall.result.samples import simulated
from rockfall.studies.difference_maps import difference_maps, have_passages, on_same_cells
from rockfall.studies.variants import compare_variants
from rockfall.table import Table
from rockfall.tables.variants import comparison_notes, variant_table

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from rockfall.result.trajectories import Terrain

BESIDE_FIRST = 4  # variants in a table on paper


class Given(NamedTuple):
    """Facts about the variants that results do not hold."""

    frequencies: pd.DataFrame | None = None  # over scenarios, from `yearly_variants`
    costs: Mapping[str, float] = {}  # by variant, in any unit
    title: str = ""  # of the page; "": that of the first

    def check(self, results: Mapping[str, xr.Dataset]) -> None:
        """Refuse what cannot be."""
        for name, cost in self.costs.items():
            if name not in results:
                raise RockfallError(f"cost of {name}: the variants are {', '.join(results)}")
            if not 0 <= cost < math.inf:
                raise RockfallError(f"cost of {name} = {cost:g}: must be >= 0")


def write_variants_page(
    results: Mapping[str, xr.Dataset],
    path: str | Path,
    terrain: Terrain | None,
    given: Given,
    language: str,
    parties: Parties,
    inputs: Iterable[str | Path],
) -> None:
    """Write the page of variants to `path` (.html, or .pdf) atomically; `inputs` are files that
    must not be replaced."""
    path = Path(path)
    check_page(path, inputs)
    given.check(results)
    with speaking(language):
        page = _page(results, terrain, given, parties, is_pdf(path))
    write_page(page, path)


def _page(
    results: Mapping[str, xr.Dataset],
    terrain: Terrain | None,
    given: Given,
    parties: Parties,
    on_paper: bool,
) -> str:
    first = next(iter(results.values()))
    table = compare_variants(results)
    drawn = difference_maps(on_same_cells(results)) if have_passages(results) else {}
    return rendered(
        "variants.html.j2",
        title=given.title or str(first.attrs["title"]) or "rockfall",
        on_paper=on_paper,
        facts=[
            (say("sheet.project"), parties.project),
            (say("sheet.client"), parties.client),
            (say("sheet.author"), parties.author),
            (say("sheet.signature"), ""),
            (say("sheet.computed"), str(first.attrs.get("date_created", ""))[:10]),
        ],
        warnings=list(_warnings(results)),
        lines=[
            variant_table(part, given.frequencies)
            for _, of_line in table.groupby("line", sort=False)
            for part in _on_page(of_line, on_paper)
        ],
        notes=[
            say("variants.note"),
            say("variants.same_boulders", n=simulated(first)),
            *comparison_notes(results, given.frequencies is not None),
        ],
        measures=[_measures(results, given)],
        figures=[
            picture(
                difference_figure(drawn, name, terrain),
                say("variants.map_of", variant=name),
                say("variants.map_caption"),
                on_paper,
            )
            for name in list(results)[1:]
            if f"{name}_passing" in drawn
        ],
    )


def _warnings(results: Mapping[str, xr.Dataset]) -> Iterator[str]:
    """Limits of the model and warnings, with the variants that they concern."""
    notes: dict[str, list[str]] = {}
    for name, result in results.items():
        for text in missing(result):
            notes.setdefault(text, []).append(name)
    for text, names in notes.items():
        yield f"{', '.join(names)}: {text}"
    yield from (f"{text}." for text in joint_warnings(results))
    if have_passages(results) and (others := [*results.keys() - on_same_cells(results).keys()]):
        yield say("variants.other_cells", names=", ".join(sorted(others)))


def _on_page(of_line: pd.DataFrame, on_paper: bool) -> Iterator[pd.DataFrame]:
    """The numbers of a line, on paper in parts that are not wider than the page, each with the
    first variant."""
    first, *others = of_line["variant"].unique()
    step = BESIDE_FIRST if on_paper else max(1, len(others))
    for k in range(0, max(1, len(others)), step):
        yield of_line[of_line["variant"].isin([first, *others[k : k + step]])]


def _measures(results: Mapping[str, xr.Dataset], given: Given) -> Table:
    """Measures of each variant, from its case."""
    cases = {name: case_of(result) for name, result in results.items()}
    rows = [[say("variants.terrain"), *(_dem(case) for case in cases.values())]]
    rows.append([say("variants.barriers"), *(_barriers(case) for case in cases.values())])
    rows.append([say("variants.dams"), *(_dams(case) for case in cases.values())])
    rows.append([say("variants.forest"), *(_forest(case) for case in cases.values())])
    if given.costs:
        costs = (given.costs.get(name) for name in results)
        shown = ("-" if cost is None else localised(f"{cost:,.10g}") for cost in costs)
        rows.append([say("variants.cost"), *shown])
    return Table.of(say("variants.measures"), ["", *results], rows, "facts")


def _dem(case: Case) -> str:
    name = case.terrain["dem"]
    return say("variants.array") if name == FROM_ARRAY else Path(name).name


def _barriers(case: Case) -> str:
    return "\n".join(map(_barrier, case.barrier)) or "-"


def _barrier(given: Mapping[str, object]) -> str:
    if "diameter" in given:
        return f"{given.get('name') or given.get('file')}: ⌀ {_digits(given['diameter'])} cm"
    strength = f"EAD {given['class']}" if "class" in given else f"{given.get('capacity', 0.0):g} kJ"
    height = localised(f"{given.get('height', 0.0):g}")
    return f"{given.get('name') or given.get('file')}: {height} m, {strength}"


def _dams(case: Case) -> str:
    heights = (localised(f"{dam.get('height', 0.0):g}") for dam in case.dam)
    return "\n".join(f"{height} m" for height in heights) or "-"


def _digits(value: object) -> str:
    return localised(f"{value:g}")


def _forest(case: Case) -> str:
    """Origin of the trees, the fraction of them that remains, and the layer of clearings."""
    if not case.has_forest:
        return "-"
    forest = case.forest
    sources = (forest[key] for key in ("trees", "polygons", "stems") if key in forest)
    parts = [say("variants.yes") if name == FROM_ARRAY else Path(name).name for name in sources]
    if "uniform_stems" in forest:
        parts.append(f"{_digits(forest['uniform_stems'])}/ha")
    if forest["density_factor"] < 1:
        parts.append(f"× {_digits(forest['density_factor'])}")
    parts += [f"- {Path(forest['clearings']).name}"] if "clearings" in forest else []
    return "\n".join(map(str, parts))
