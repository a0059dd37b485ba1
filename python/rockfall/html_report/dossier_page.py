# SPDX-License-Identifier: BSD-3-Clause
"""Dossier of a case as pages: page 1 with question, answer, signature and, if it fits, the map;
then the barrier, the variants, all places, the inputs, and the hazard map sheet."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import xarray as xr

from rockfall.analysis.hazard.classes import CLASSES
from rockfall.analysis.validity.warnings import in_order, joined_warnings
from rockfall.case import case_in
from rockfall.files.segment_files import has_segments
from rockfall.html_report.inputs import Parties, doubtful_inputs, facts_of
from rockfall.html_report.maps import data_uri
from rockfall.html_report.page import is_pdf, write_page
from rockfall.html_report.pdf import layout
from rockfall.html_report.render import Picture, picture, rendered
from rockfall.html_report.summary import yearly_answers
from rockfall.language import Text, say, speaking, word
from rockfall.plots.cartography.sheet import Room
from rockfall.plots.hazard.close_map import close_map, is_whole, shows_places
from rockfall.plots.hazard.hazard_figures import hazard_figures
from rockfall.plots.hazard.hazard_sheet import Imprint, hazard_sheet
from rockfall.plots.hazard.origin_map import origin_map, origin_place
from rockfall.plots.studies.curves_figure import curves_figure
from rockfall.quantities import number
from rockfall.result.trajectories import Terrain
from rockfall.studies.dossier import Designs, Dossier
from rockfall.table import Table, in_line
from rockfall.tables.dossier import (
    MOST,
    Section,
    answer_table,
    around_ends,
    barrier_answers,
    barrier_verdicts,
    model_texts,
    models_apart,
    remaining_tables,
    second_answer,
    second_demands,
    sections,
    variants_table,
    years_between,
)
from rockfall.tables.hazard import Place, places_of
from rockfall.text.hazard import limits_of_hazard

MAP = Room(180 / 25.4, 246 / 25.4)  # map on a page of its own, with the title below
NO_MAP = data_uri(b'<svg xmlns="http://www.w3.org/2000/svg"/>', "image/svg+xml")  # until it fits
SHEETS, ROWS = 8, (12, 8, 5, 3)  # maximum sheets; maximum table rows, reduced until the pages fit
PLACES = (6, 4, 2)  # maximum places in a table of page 1, reduced until the signature fits
FIRST, CLOSING = 70.0, 95.0  # minimum heights of maps: page 1, below the last text [mm]
TITLE = 22.0  # height of the title of a map [mm]
HOUSES, ADVICE, WARNINGS = 3, 4, 3  # maximum sentences on page 1


class Given(NamedTuple):
    """Parties of a dossier, and the terrain under its maps."""

    parties: Parties
    terrain: Terrain | None = None


def write_dossier_page(
    dossier: Dossier,
    designs: Designs,
    given: Given,
    path: str | Path,
    language: str,
) -> None:
    """Write the pages of a dossier (.pdf or .html) atomically, in a language."""
    path = Path(path)
    with speaking(language):
        content = _content(dossier, designs, given)
        if is_pdf(path):
            page = _fitted(content, dossier, given.terrain)
        else:
            content["map"] = _map(dossier, given.terrain, MAP)
            page = rendered("dossier.html.j2", closing=None, **content)
    write_page(page, path)


def _fitted(content: dict[str, Any], dossier: Dossier, terrain: Terrain | None) -> str:
    """Fit the signature to the first sheet and a page to at most `SHEETS` sheets, with fewer table
    rows if necessary. Move the map to the first sheet if it has room, and add a map of the sources
    if there is room at the end, or a spare sheet."""
    page = rendered("dossier.html.j2", closing=None, **content)
    fitted, sections, most = layout(page), content["sections"], iter(ROWS)
    hazard, places = dossier.first, iter(PLACES)
    while not fitted.is_signed and (rows := next(places, 0)):
        content["tables_first"] = [_in_lines(table) for table in first_tables(dossier, rows)]
        page = rendered("dossier.html.j2", closing=None, **content)
        fitted = layout(page)
    room = _room(fitted.below["answered"], FIRST)
    if room and not (fitted.is_signed and shows_places(hazard, terrain, room)):
        room = None
    content |= dict(map=_map(dossier, terrain, room or MAP), on_first=room is not None)
    page = rendered("dossier.html.j2", closing=None, **content)
    if room:
        fitted = layout(page)
    while fitted.sheets > SHEETS and (rows := next(most, 0)):
        content["sections"] = [_cut(section, rows) for section in sections]
        page = rendered("dossier.html.j2", closing=None, **content)
        fitted = layout(page)
    if place := origin_place(hazard):
        spare = fitted.sheets < SHEETS
        closing = _closing(hazard, terrain, place, fitted.below["end"], spare)
        page = rendered("dossier.html.j2", closing=closing, **content)
    return page


def _room(left: float, lowest: float) -> Room | None:
    """Room for a map with its title in the remaining height [mm] of a sheet; None if the map would
    be lower than `lowest` [mm]."""
    high = left - TITLE
    return Room(MAP.wide, high / 25.4) if high >= lowest else None


def _cut(section: Section, most: int) -> Section:
    """Section with its tables of places cut to `most` rows, and a note on omissions. Only tables of
    places have a title in the first column."""
    is_of_places = section.name in ("variants", "places")
    if not is_of_places or all(len(table.rows) <= most for table in section.tables):
        return section
    tables = [
        table._replace(rows=table.rows[:most]) if table.head[0] else table
        for table in section.tables
    ]
    return section._replace(tables=tables, notes=[say("dossier.cut", n=most), *section.notes])


def _closing(
    hazard: xr.Dataset, terrain: Terrain | None, place: Place, left: float, spare: bool
) -> Picture | None:
    """Map of the sources for the remaining height [mm] on the last text page, or for a spare
    sheet; None if neither has room."""
    room = _room(left, CLOSING) or (MAP if spare else None)
    if room is None:
        return None
    title = say("dossier.origin", name=place.name)
    drawn = origin_map(hazard, terrain, place, room)
    return picture(drawn, title, say("dossier.origin_caption", name=place.name), on_paper=True)


def _content(dossier: Dossier, designs: Designs, given: Given) -> dict[str, Any]:
    """Content for the template, without the map and the closing figure."""
    hazard, parties = dossier.first, given.parties
    warnings = dossier_warnings(dossier)
    pages = {section.name: section for section in sections(dossier, designs)}
    imprint = Imprint(parties.project, parties.client, parties.author)
    sheet = hazard_sheet(hazard, given.terrain, imprint)  # other pages show these warnings
    return dict(
        title=title_of(dossier),
        on_paper=True,
        facts=facts_of(hazard, parties),
        author=parties.author,
        question=question(dossier),
        warnings=warnings[:WARNINGS],
        more_warnings=warnings[WARNINGS:],
        answers=list(answers(dossier, designs)),
        tables_first=[_in_lines(table) for table in first_tables(dossier)],
        certainty=_certainty(dossier),
        map=Picture("", "", NO_MAP, round(96 * MAP.wide), round(96 * MAP.high)),
        on_first=False,
        sections=list(pages.values()),
        figures=dict(_figures(dossier)),
        sheet=picture(sheet, say("sheet.title"), "", on_paper=True),
    )


def first_tables(dossier: Dossier, most: int = MOST) -> Iterator[Table]:
    """Tables of page 1: the first places of the complete tables, which follow later."""
    yield answer_table(dossier.first, dossier.period, most)
    if len(dossier.hazards) > 1:
        yield variants_table(dossier, most)
        yield from remaining_tables(dossier)


def _in_lines(table: Table) -> Table:
    """Table with each number and its interval on one line."""
    return table._replace(rows=[[*map(in_line, row)] for row in table.texts()])


def _map(dossier: Dossier, terrain: Terrain | None, room: Room) -> Picture:
    """Map of the hazard zones at a scale that shows houses."""
    drawn = close_map(dossier.first, terrain, room)
    whole = is_whole(dossier.first, terrain, room)
    caption = "" if whole else say("dossier.map_around")
    return picture(drawn, _map_title(dossier), caption, on_paper=True)


def _map_title(dossier: Dossier) -> str:
    title, name = say("front.zones_of_hazard"), next(iter(dossier.hazards))
    return say("join.colon", before=title, after=name) if name else title


def title_of(dossier: Dossier) -> str:
    """Title of the case, without the variant name."""
    name, attrs = next(iter(dossier.hazards)), dossier.first.attrs
    title = str(attrs["title"]).removesuffix(name).removesuffix(": ")
    return title or Path(str(attrs["case_file"])).stem


def question(dossier: Dossier) -> str:
    """The client's question: the text of the case, or the question that the numbers answer."""
    if asked := case_in(dossier.first.attrs).case["question"]:
        return str(asked)
    places = places_of(dossier.first)
    undivided = [place for place in places if place.kind != "segment"] or places
    names = [place.name for place in undivided[:MOST]]
    key = "dossier.question_of_variants" if len(dossier.hazards) > 1 else "dossier.question"
    return say(key, places=names)


def answers(dossier: Dossier, designs: Designs) -> Iterator[str]:
    """Sentences on page 1: on models that differ widely, on lines, on the most frequently hit
    objects, and on the barrier."""
    hazard, apart = dossier.first, list(models_apart(dossier))
    yield from [*apart, *second_answer(dossier)] if apart else ()
    yield from yearly_answers(hazard, dossier.period)
    objects = [place for place in places_of(hazard) if place.kind == "object"]
    for _, k, name in objects[:HOUSES]:
        yield _of_object(hazard, k, name)
    yield from () if apart else second_answer(dossier)
    on_barriers = (
        barrier_answers(designs), barrier_verdicts(designs), [*second_demands(dossier, designs)]
    )  # fmt: skip
    yield from chain.from_iterable(texts[:ADVICE] for texts in on_barriers)
    if left := sum(len(texts[ADVICE:]) for texts in on_barriers):
        yield say("dossier.more_on_barriers", n=left, section=say("section.protection"))
    for name, own in dossier.hazards.items():
        for text in around_ends(own):
            yield say("join.colon", before=name, after=text) if name else text


def _of_object(hazard: xr.Dataset, k: int, name: str) -> Text:
    """Sentence on an object: its impact frequency and its class."""
    rates = [float(hazard[f"object_frequency{end}"].values[k]) for end in ("", "_low", "_high")]
    hazard_class = word(CLASSES[int(hazard["object_hazard_class"].values[k])])
    years = years_between(*rates)
    if not rates[0]:
        return say("dossier.not_hit", name=name, limits=years.interval)
    values = {"years": years.number, "limits": years.interval, "hazard": hazard_class}
    return say("dossier.hit", name=name, **values)


def dossier_warnings(dossier: Dossier) -> list[Text]:
    """Warnings on the models of all runs, on the hazards and on their inputs; each appears once,
    with the names of the first runs concerned."""
    by_variant = {name: list(limits_of_hazard(figure)) for name, figure in dossier.hazards.items()}
    doubts = dict.fromkeys(
        say("join.colon", before=where, after=text)
        for hazard in dossier.hazards.values()
        for where, text in doubtful_inputs(hazard, None)
    )
    return in_order([*model_texts(dossier), *joined_warnings(by_variant), *doubts])


def _figures(dossier: Dossier) -> Iterator[tuple[str, list[Picture]]]:
    """Yield sections with figures; the page puts each figure after two tables of its section."""
    curves = curves_figure(dossier.hazards)
    shown = [picture(curves, say("dossier.curves"), say("dossier.curves_caption"), on_paper=True)]
    if has_segments(dossier.first):
        shown += [
            picture(figure.draw(), figure.title, figure.caption, on_paper=True)
            for figure in hazard_figures(dossier.first)
            if figure.name.startswith("segments")
        ][:1]
    yield "places", shown


def _certainty(dossier: Dossier) -> list[Text]:
    """Sentences on what the intervals include."""
    released = number(float(dossier.first["frequency"].sum()), 2)
    return [
        say("office.intervals"), say("summary.the_brackets_hold_no_error_of"),
        say("dossier.assumed_frequency", n=released),
    ]  # fmt: skip


def parts_of(dossier: Dossier, designs: Designs) -> Iterator[Section]:
    """Sections of page 1, and of the following pages."""
    notes = [question(dossier), *answers(dossier, designs), *_certainty(dossier)]
    tables = [answer_table(dossier.first, dossier.period)]
    if len(dossier.hazards) > 1:
        tables += [variants_table(dossier), *remaining_tables(dossier)]
    yield Section("answer", say("section.answer"), notes, tables)
    yield from sections(dossier, designs)
    yield Section("validity", say("section.validity"), dossier_warnings(dossier), [])
