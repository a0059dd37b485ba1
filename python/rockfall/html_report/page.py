# SPDX-License-Identifier: BSD-3-Clause
"""Report of a result as an HTML page that works offline: text, maps, lines, figures, provenance.

The modules of this package provide numbers and texts; the files in `templates` define the page
structure.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from itertools import chain
from pathlib import Path
from typing import Any

import xarray as xr

from rockfall.analysis.lines.samples import LineSamples
from rockfall.analysis.lines.section import Section
from rockfall.analysis.observed.compare import DISAGREES, compare, disagreement
from rockfall.analysis.observed.observations import Observed
from rockfall.analysis.population import scenario_note
from rockfall.analysis.return_levels import return_levels
from rockfall.analysis.validity.remarks import model_remarks
from rockfall.case import case_of
from rockfall.case.files import files_behind
from rockfall.errors import RockfallError, need
from rockfall.html_report.front import front_of, overview
from rockfall.html_report.inputs import (
    Parties,
    doubtful_inputs,
    doubts_note,
    ground_figure,
    input_table,
    zone_table,
)
from rockfall.html_report.maps import map_section
from rockfall.html_report.pdf import check_pdf, write_pdf
from rockfall.html_report.render import Picture, embedded, picture, rendered
from rockfall.html_report.summary import (
    angle,
    answers,
    certainty,
    question,
    range_answers,
    range_words,
    requested,
    technical,
    yearly_answers,
)
from rockfall.html_report.validity import cautions, sets_of, warnings
from rockfall.io.atomic import atomic_write
from rockfall.io.output_files import check_output
from rockfall.language import say, speaking
from rockfall.plots.figures import LABORATORY, Figure, figures, section_entry
from rockfall.plots.hazard.hazard_figures import hazard_figures
from rockfall.plots.history_figure import history_figure
from rockfall.plots.left_out import LeftOut
from rockfall.plots.map_figures import Look
from rockfall.plots.style import capital
from rockfall.protection.barriers import barriers_of
from rockfall.protection.design import design
from rockfall.protection.recorded import dams_of, stands_of
from rockfall.result.crossings import MOST_LINES, line_names, most_crossed, sharing
from rockfall.result.maps.flat_maps import flat_maps
from rockfall.result.samples import has_rows, simulated
from rockfall.result.trajectories import Terrain
from rockfall.simulation.progress import add_steps
from rockfall.studies.models import Models
from rockfall.table import Table
from rockfall.tables.comparison import comparison_tables, notes
from rockfall.tables.design import check_tables, factor_lines, load_tables
from rockfall.tables.ensemble import PER_LINE, range_headline, range_tables
from rockfall.tables.hazard import hazard_tables
from rockfall.tables.lines import (
    Rows,
    headline,
    key_rows,
    level_table,
    line_tables,
    precision_table,
    rows_of,
    worst_of,
)
from rockfall.tables.models import (
    missing_spread,
    model_tables,
    spread_answer,
    spread_table,
    spread_words,
)
from rockfall.tables.run import (
    barrier_table,
    dam_tables,
    ends_table,
    ground_table,
    provenance,
    stand_tables,
)
from rockfall.text.hazard import hazard_warnings

PDF = ".pdf"
NOBODY = Parties()
GROUNDS = "page.grounds_radii_of_their_rocks"
GROUND_PART = "page.part_grounds"
DRAWN_LINES = 8  # maximum number of lines with figures


@dataclass(frozen=True)
class ReportInputs:
    """Inputs of a report page.

    `terrain`, from `rockfall.plots.terrain.terrain_of`, is the relief under the maps. Figures and
    tables compare the result with `observed`, from
    `rockfall.analysis.observed.observations.read_observed`. `look` has class limits of maps and a
    basemap. `view` is the interactive page from `rockfall.show`. `on_paper` turns all maps into
    figures. `hazard`, from `rockfall.hazard`, adds hazard zones; `models`, from
    `rockfall.studies.models`, the spread over rebound models; `section`, from `rockfall.section`,
    its figure. `factors` is a table with the numbers of a standard, as in `rockfall.design`.
    `left` collects notes on omissions, where a file of the case cannot be read.
    """

    result: xr.Dataset
    terrain: Terrain | None = None
    observed: Observed | None = None
    look: Look | None = None
    view: str = ""
    on_paper: bool = False
    parties: Parties = NOBODY
    hazard: xr.Dataset | None = None
    models: Models | None = None
    section: Section | None = None
    factors: str | Path | None = None
    of_site: bool = False  # `observed` comes from the case
    left: LeftOut = field(default_factory=LeftOut)


def write_report(inputs: ReportInputs, path: str | Path, language: str = "en") -> None:
    """Write the report page of a result to `path` (.html, or .pdf for paper) atomically."""
    path = Path(path)
    check_page(path, files_behind(inputs.result))
    with speaking(language):
        page = report(replace(inputs, on_paper=is_pdf(path)))
    write_page(page, path)


def is_pdf(path: Path) -> bool:
    """Return True if the path has the extension of a PDF."""
    return path.suffix.lower() == PDF


def write_page(page: str, path: Path) -> None:
    """Write a page, or typeset it as a PDF, atomically."""
    if is_pdf(path):
        write_pdf(page, path)
        return
    with atomic_write(path) as part:
        part.write_text(page, encoding="utf-8")


def check_page(path: str | Path, inputs: Iterable[str | Path] = ()) -> None:
    """Raise a RockfallError for a page that cannot be made or written, before the work starts."""
    check_page_needs(path)
    check_output(path, inputs)


def check_page_needs(path: str | Path) -> None:
    """Raise a RockfallError for missing packages, or an unknown file extension of the page."""
    path = Path(path)
    need("a report needs", "report", "matplotlib", "PIL", "jinja2")
    if path.suffix.lower() not in (".html", ".htm", PDF):
        raise RockfallError(f"{path}: output name must end in .html or .pdf")
    if is_pdf(path):
        check_pdf()


def report(inputs: ReportInputs) -> str:
    """HTML text of a report page in the current language; the same inputs give identical text."""
    result = flat_maps(inputs.result)
    with sharing(result):
        return _report(inputs, result)


def _report(inputs: ReportInputs, result: xr.Dataset) -> str:
    terrain, hazard, models = inputs.terrain, inputs.hazard, inputs.models
    observed, parties, on_paper = inputs.observed, inputs.parties, inputs.on_paper
    zoomed = set() if on_paper else {f"map_{name}" for name in result.data_vars}
    left = inputs.left
    drawn = figures(result, terrain, observed, inputs.look, DRAWN_LINES, left)
    shown = [figure for figure in drawn if figure.name not in zoomed]
    names = line_names(result)
    add_steps(len(names))
    key = key_rows(result)
    which = sorted(map(names.index, worst_of(key)[:MOST_LINES]))
    designed = [names[k] for k in sorted({*which, *barriers_of(result)})]
    add_steps(2 * len(which) + len(designed) + len(shown) + min(len(which), DRAWN_LINES))
    rows, levels = rows_of(result, which), return_levels(result, lines=which)
    sheet = (
        design(result, line=designed, factors=inputs.factors) if rows and has_rows(result) else None
    )
    ranges = range_tables(result, rows)
    if inputs.section is not None:
        shown.insert(0, section_entry(inputs.section))
    laboratory = [figure for figure in shown if figure.name in LABORATORY]
    if not sets_of(result):
        laboratory = []  # the reference does not apply to the model used for rebounds
    zones = left.attempt(GROUND_PART, lambda: [*zone_table(result)])
    grounds = None if zones is None else left.attempt(GROUND_PART, ground_figure, result, terrain)
    endangered = [] if hazard is None else list(hazard_tables(hazard))
    doubts = doubtful_inputs(result, hazard)
    remarks = model_remarks(result, case_of(result))
    compared = None
    if observed is not None and inputs.of_site:
        compared = left.attempt("page.part_observed", compare, result, observed)
    elif observed is not None:
        compared = compare(result, observed)
    agreement = [] if compared is None else [disagreement(compared)]
    outside = [
        *spread_answer(models), *doubts_note(doubts), *warnings(result),
        *(f"{text}." for text in agreement if text.key == DISAGREES),
        *missing_spread(result, models),
    ]  # fmt: skip
    outside += scenario_note(case_of(result))
    outside += [f"{capital(text)}." for text in left.notes()]
    texts: dict[str, Any] = {
        "title": str(result.attrs["title"]) or "rockfall",
        "question": question(rows, hazard is not None),
        "warnings": outside,
        "answers": [
            *yearly_answers(hazard),
            *(range_answers(result, rows) if ranges else answers(result, rows)),
        ],
        "certainty": [
            *certainty(result, key, not outside),
            *range_words(result, ranges),
            *spread_words(models),
        ],
    }
    shown_first = [
        *([range_headline(result) if ranges else headline(key)] if rows else ()),
        *spread_table(models),
        *endangered[:1],
        *ranges[::PER_LINE],
    ]
    front = front_of(result, key, parties, texts, shown_first)
    stops = None if observed is None else observed.stops
    drawn_first = list(overview(result, terrain, stops, hazard, inputs.look, front.room))
    return rendered(
        "page.html.j2",
        title=texts["title"],
        on_paper=on_paper,
        parties=parties,
        question=texts["question"],
        front=front,
        overview=[picture(figure, title, "", on_paper) for title, figure in drawn_first],
        doubtful_inputs=doubts,
        indices=[index for k, index in enumerate(ranges) if k % PER_LINE],
        inputs=[
            input_table(result, parties),
            *(zones or ()),
            *dam_tables(dams_of(result)),
            *stand_tables(stands_of(result)),
        ],
        ground_map=picture(grounds, say(GROUNDS), "", on_paper) if grounds else None,
        ends=[ends_table(result)],
        angle=list(angle(result)),
        cautions=cautions(result, key, levels),
        map_section=None if on_paper else map_section(result, terrain, inputs.look),
        view=embedded(inputs.view) if inputs.view else None,
        lines_shown=[]
        if len(which) == len(names)
        else [say("page.lines_shown", part=len(which), n=len(names))],
        design_shown=[]
        if len(designed) == len(names)
        else [say("page.design_shown", part=len(designed), n=len(names))],
        lines=[*line_tables(rows), level_table(levels)] if rows else [],
        design=[
            *(chain(load_tables(sheet), check_tables(sheet)) if sheet else ()),
            *([barrier_table(result)] if barriers_of(result) and has_rows(result) else ()),
        ],
        kept=[sheet.kept] if sheet and sheet.kept else [],
        factors=list(factor_lines(sheet.factors)) if sheet else [],
        hazard=endangered[1:],
        hazard_warnings=[]
        if hazard is None
        else [
            say("hazard.two_populations"),
            *hazard_warnings(hazard, {remark.text.key for remark in remarks}),
        ],
        hazard_figures=_pictures(
            [] if hazard is None else hazard_figures(hazard, terrain), on_paper
        ),
        grounds=[
            *([ground_table(result)] if "rebounds_by_ground" in result else ()),
            *model_tables(models),
        ],
        has_clusters=LineSamples(result).sampled,
        convergence=list(_convergence(result, rows, on_paper)),
        comparison=None
        if compared is None
        else {"tables": comparison_tables(compared), "notes": [*agreement, *notes(compared)]},
        figures=_pictures([figure for figure in shown if figure.name not in LABORATORY], on_paper),
        appendix=_pictures(laboratory, on_paper),
        technical=[*technical(result), *requested(result)],
        provenance=provenance(result),
    )


def _pictures(shown: Iterable[Figure], on_paper: bool) -> list[Picture]:
    return [picture(figure.draw(), figure.title, figure.caption, on_paper) for figure in shown]


def _convergence(
    result: xr.Dataset, rows: Rows, on_paper: bool
) -> Iterator[tuple[str, Picture | None, Table | None]]:
    """Precision table of each line, with a convergence figure for the most crossed lines; None if
    no boulder passes."""
    of_several = LineSamples(result).sources > 1
    key = "page.numbers_after_so_many_boulders_with"
    caption = say(key if of_several else "page.numbers_after_so_many_boulders_with_2")
    names = line_names(result)
    which = most_crossed(result, DRAWN_LINES) if has_rows(result) else []
    for line, numbers in rows.items():
        if numbers["speed"]["n"]:
            figure = None
            if (k := names.index(line)) in which:
                drawn = history_figure(result, k)
                figure = picture(drawn, say("page.convergence_at", line=line), caption, on_paper)
            yield line, figure, precision_table(line, numbers, simulated(result))
        else:
            yield line, None, None
