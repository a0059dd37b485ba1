# SPDX-License-Identifier: BSD-3-Clause
"""Page that compares protection variants, with a column for each."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

import pandas as pd
import xarray as xr

from rockfall.analysis.validity.warnings import joint_warnings
from rockfall.case import case_of
from rockfall.errors import RockfallError
from rockfall.html_report.inputs import Parties
from rockfall.html_report.page import check_page, is_pdf, write_page
from rockfall.html_report.render import picture, rendered
from rockfall.html_report.validity import missing
from rockfall.language import say, speaking
from rockfall.plots.studies.difference_figures import difference_figure
from rockfall.result.samples import simulated
from rockfall.result.trajectories import Terrain
from rockfall.simulation.progress import add_steps
from rockfall.studies.difference_maps import difference_maps, have_passages, on_same_cells
from rockfall.studies.variants import compare_variants
from rockfall.tables.variants import comparison_notes, measures_table, variant_table

BESIDE_FIRST = 4  # maximum variants next to the first in a table on paper


class Given(NamedTuple):
    """Details of the variants that results do not contain."""

    frequencies: pd.DataFrame | None = None  # over all scenarios: see `yearly_variants`
    costs: Mapping[str, float] = {}  # cost of each variant, in any unit
    title: str = ""  # page title; "": title of the first result

    def check(self, results: Mapping[str, xr.Dataset]) -> None:
        """Raise a RockfallError for a negative or infinite cost, or that of an unknown variant."""
        for name, cost in self.costs.items():
            if name not in results:
                raise RockfallError(
                    f"cost of {name}: no such variant (variants: {', '.join(results)})"
                )
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
    """Write the page of variants (.html or .pdf) atomically; `inputs` are never overwritten."""
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
    add_steps(len(results) - 1)
    return rendered(
        "variants.html.j2",
        title=given.title or str(first.attrs["title"]) or "rockfall",
        on_paper=on_paper,
        facts=[
            (say("sheet.project"), parties.project),
            (say("sheet.client"), parties.client),
            (say("sheet.author"), parties.author),
            (say("sheet.signature"), ""),
            (say("sheet.computed"), str(first.attrs["date_created"])[:10]),
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
        measures=[
            measures_table({name: case_of(result) for name, result in results.items()}, given.costs)
        ],
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
    """Model limits and warnings, with the variants concerned."""
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
    """Rows of a line; on paper, in parts that fit on the page, each with the first variant."""
    first, *others = of_line["variant"].unique()
    step = BESIDE_FIRST if on_paper else max(1, len(others))
    for k in range(0, max(1, len(others)), step):
        yield of_line[of_line["variant"].isin([first, *others[k : k + step]])]
