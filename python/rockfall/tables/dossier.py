# SPDX-License-Identifier: BSD-3-Clause
"""Sections of a dossier: sentences and tables, identical in the page, Word and Excel versions."""

from collections.abc import Iterator, Sequence
from itertools import chain
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from rockfall.analysis.hazard.classes import CLASSES
from rockfall.analysis.hazard.levels import PLACES, yearly
from rockfall.analysis.hazard.model_warnings import messages_of
from rockfall.analysis.hazard.variables import CLASS_ENDS
from rockfall.analysis.lines.around import MAX_AROUND
from rockfall.analysis.validity.warnings import joined_warnings, worst_warnings
from rockfall.case import case_in
from rockfall.files.risk_files import has_risk
from rockfall.files.segment_files import has_segments
from rockfall.io.rasters.arrays import grid_of
from rockfall.language import Text, say, translated, word
from rockfall.quantities import percent
from rockfall.result.variables import ENDS
from rockfall.studies.dossier import Designs, Dossier, Run, Second
from rockfall.studies.model_scenes import BY_SETS, CONSTANT
from rockfall.table import Column, Estimate, Table, open_limits
from rockfall.tables.hazard import (
    FACTORS,
    Place,
    Risk,
    assumptions,
    class_table,
    class_within,
    level_cell,
    object_table,
    period_tables,
    places_of,
    risk_table,
    scenario_table,
    segment_table,
    total,
    worst_caption,
)
from rockfall.tables.models import apart
from rockfall.tables.run import hazard_inputs
from rockfall.tables.variants import difference_table, measures_table
from rockfall.tables.yearly_design import (
    advice,
    check_tables,
    choice_tables,
    demands,
    loads_table,
)
from rockfall.terrain.polyline import lengths, spaced

MOST = 8  # maximum number of places on page 1
CHOICES = 2  # maximum lines with a table of barriers
STEPS = 10  # points per cell width at which a line is sampled


class Section(NamedTuple):
    """A section of a dossier: name, heading, sentences and tables."""

    name: str
    heading: str
    notes: Sequence[str]
    tables: Sequence[Table]


def sections(dossier: Dossier, designs: Designs) -> Iterator[Section]:
    """Sections after page 1."""
    hazard, several = dossier.first, len(dossier.hazards) > 1
    if designs.by_variant:
        yield _protection(dossier, designs)
    if several:
        costs = dossier.costs
        cases = {name: case_in(hazard.attrs) for name, hazard in dossier.hazards.items()}
        tables = [measures_table(cases, costs), difference_table(dossier.frequencies),
                  period_table(dossier)]  # fmt: skip
        notes = [say("dossier.common"), say("variants.note_of_mark")]
        yield Section("variants", say("dossier.variants"), notes, tables)
    tables = [*second_tables(dossier), *period_tables(hazard)]
    tables += [object_table(hazard)] if "object" in hazard.dims else []
    tables += [segment_table(hazard)] if has_segments(hazard) else []
    tables += [risk_table(hazard)] if has_risk(hazard) else []
    notes = [say("dossier.of_variant", name=name) for name in list(dossier.hazards)[: 1 * several]]
    cells = (cell for table in tables for row in table.rows for cell in row)
    yield Section("places", say("dossier.places"), [*notes, *open_limits(cells)], tables)
    tables = [scenario_table(hazard), class_table(hazard), hazard_inputs(hazard)]
    notes = [say("hazard.population"), *assumptions(hazard)]
    yield Section("inputs", say("section.inputs"), notes, tables)


def _protection(dossier: Dossier, designs: Designs) -> Section:
    """Section with the loads and barrier choices of the first variant, and the barriers of all
    variants."""
    first = next(iter(designs.by_variant.values()))
    tables = [loads_table(first), *list(choice_tables(first))[:CHOICES]]
    for name, sheet in designs.by_variant.items():
        for table in check_tables(sheet):
            caption = say("join.colon", before=name, after=table.caption) if name else table.caption
            tables.append(table._replace(caption=caption))
    notes = [*barrier_answers(designs), *barrier_verdicts(designs)]
    notes += [*second_demands(dossier, designs), say("yearly.criterion")]
    return Section("protection", say("section.protection"), notes, tables)


def barrier_answers(designs: Designs) -> list[Text]:
    """Sentences on the advised barriers of the first variant, the strongest first."""
    first = next(iter(designs.by_variant.values()), None)
    return list(advice(first)) if first else []


def barrier_verdicts(designs: Designs) -> list[Text]:
    """Sentences on the barriers of the variants: first those that do not suffice."""
    held = [
        (demand.levels, say("join.colon", before=name, after=demand.text) if name else demand.text)
        for name, sheet in designs.by_variant.items()
        for line, demand in demands(sheet).items()
        if line in {*sheet.checks["line"]}
    ]
    return [text for _, text in sorted(held, key=lambda pair: pair[0], reverse=True)]


def second_demands(dossier: Dossier, designs: Designs) -> Iterator[Text]:
    """Sentences on lines and barriers of the first variant where the second model demands more, the
    highest demands first."""
    if designs.second and dossier.second:
        own, model = demands(next(iter(designs.by_variant.values()))), _shown(dossier.second.model)
        others = demands(designs.second).items()
        for line, other in sorted(others, key=lambda item: item[1].levels, reverse=True):
            if other.exceeds(own[line]):
                yield say("join.colon", before=model, after=other.text)


def around_ends(hazard: xr.Dataset) -> Iterator[Text]:
    """Sentences on lines where more than `MAX_AROUND` of the boulders, by frequency, pass around
    the ends of the barriers; none for a hazard without lines."""
    if "line_around" not in hazard:
        return
    names = [str(name) for name in hazard["line"].values]
    frequency = hazard["line_frequency"].values
    for k, name in enumerate(names):
        nets = str(hazard["line_barriers"].values[k]).splitlines()
        if not nets or not np.isnan(hazard["line_barrier_height"].values[k]):
            continue
        rates = yearly(hazard, "line", k, hazard["line_around"].values[:, k])
        around = _estimate([float(rate) for rate in rates])
        if around.value > MAX_AROUND * max(frequency[[k, *map(names.index, nets)]]):
            part = say("yearly.boulders", n=around.number, limits=around.interval)
            yield say("summary.around", line=name, part=part, nets=nets)


def second_tables(dossier: Dossier) -> Iterator[Table]:
    """Table of both models at each place: frequency, energy and height for the return period, and
    the governing model; none without a second model."""
    if dossier.second is None:
        return
    own, other, model = dossier.first, dossier.second.hazard, _shown(dossier.second.model)
    at = own["event_period"].values.tolist().index(dossier.period)
    rows = []
    for place in places_of(own):
        pairs = [[_frequency(hazard, place) for hazard in (own, other)]]
        for name, factor in FACTORS.items():
            pairs.append([_level(hazard, place, name, at, factor) for hazard in (own, other)])
        rows.append((place.name, *chain(*pairs), _governing(pairs, model)))
    years, by_model = dossier.period, say("dossier.by_model", model=model)
    heads = (
        say("hazard.place"), say("hazard.boulders_a_year"), by_model,
        say("variants.energy_by_period", years=f"{years:g}"), by_model,
        say("dossier.height_by_period", years=years), by_model, say("dossier.governs"),
    )  # fmt: skip
    name = dossier.second.model
    named = say("dossier.constants_of", grounds=name) if name.startswith(CONSTANT) else model
    yield Table.of(say("dossier.second_caption", model=named), heads, rows)


def _shown(model: str) -> Text | str:
    """Short name of a model in the current language; a ground keeps its name in the case."""
    if model.startswith(CONSTANT):
        return say("dossier.by_constants")
    if not model.startswith(BY_SETS):
        return model
    return say("dossier.by_sets", method=model.removeprefix(BY_SETS))


def _governing(pairs: Sequence[Sequence[Any]], model: Text | str) -> Text:
    """Names of the models with the higher frequency, energy and height; `pairs` are the values by
    both models. If a value is unknown, the model with the higher frequency governs."""
    names = say("dossier.the_case"), model
    higher = [
        names[other > own]
        for own, other in ([getattr(cell, "value", cell) for cell in pair] for pair in pairs)
        if "-" not in (own, other)
    ]
    if len(higher) < len(pairs) or len({*map(str, higher)}) == 1:
        return say("dossier.governs_one", model=higher[0])
    frequency, energy, height = higher
    return say("dossier.governs_each", frequency=frequency, energy=energy, height=height)


def second_answer(dossier: Dossier) -> Iterator[Text]:
    """Sentence on the first place by the second model, or on the absence of a second model."""
    if dossier.second is None:
        yield say("dossier.one_model")
        return
    for table in second_tables(dossier):
        name, own, other, *_, governs = table.rows[0]
        assert isinstance(own, Estimate) and isinstance(other, Estimate)
        yield say(
            "dossier.second", name=name, model=_shown(dossier.second.model),
            own=own.number, other=other.number, governs=governs,
        )  # fmt: skip
    yield from _out_of_range(dossier.second)


def _out_of_range(second: Second) -> Iterator[Text]:
    """Sentence on rebounds of the second model outside its range of R_b/R_m, in the worst scenario;
    none without such rebounds."""
    if fraction := float(second.hazard["fraction_out_of_range"].max()):
        key = "sets" if second.model.startswith(BY_SETS) else "table"
        model = _shown(second.model)
        yield say(f"dossier.{key}_out_of_range", model=model, fraction=percent(fraction))


def model_texts(dossier: Dossier) -> list[Text]:
    """Model warnings, each once with the names of the first runs concerned: those of each scenario
    of each variant, and the worst of the second model."""
    by_run = {
        str(Run(name, scenario)): texts
        for name, hazard in dossier.hazards.items()
        for scenario, texts in messages_of(hazard).items()
    }
    if dossier.second:
        model, hazard = dossier.second
        by_run[translated(_shown(model))] = worst_warnings(messages_of(hazard))
    return joined_warnings(by_run)


def models_apart(dossier: Dossier) -> Iterator[Text]:
    """Sentence on the place where both models differ widely; none if they agree."""
    if dossier.second is not None:
        hazards = dossier.first, dossier.second.hazard
        places = places_of(dossier.first)
        yield from apart(
            (place.name, [_frequency(hazard, place) for hazard in hazards]) for place in places
        )


def _highest(hazard: xr.Dataset) -> Risk:
    """Highest individual risk over all objects."""
    rows = {f"risk{end}": hazard[f"object_individual_risk{end}"].values for end in ENDS}
    k = int(np.argmax(np.nan_to_num(rows["risk"])))
    return Risk.of({name: float(risks[k]) for name, risks in rows.items()}, "risk", digits=2)


def answer_table(hazard: xr.Dataset, period: float, most: int | None = None) -> Table:
    """Table of frequency, return period, energy, height and hazard class at each place."""
    at = hazard["event_period"].values.tolist().index(period)
    rows, places = [], places_of(hazard)
    for place in places[:most]:
        rates = [_number(hazard, place, f"frequency{end}") for end in ENDS]
        energy, height = (
            _level(hazard, place, name, at, factor) for name, factor in FACTORS.items()
        )
        rows.append(
            (place.name, _estimate(rates), years_between(*rates), energy, height,
             _class(hazard, place))
        )  # fmt: skip
    heads = (
        say("hazard.place"), say("hazard.boulders_a_year"), say("dossier.years"),
        say("variants.energy_by_period", years=f"{period:g}"),
        say("dossier.height_by_period", years=period), say("hazard.hazard"),
    )  # fmt: skip
    caption = worst_caption(say("dossier.answer_caption"), len(places), len(rows))
    return Table.of(caption, heads, rows)


def years_between(value: float, low: float, high: float) -> Estimate:
    """Return period [year] of a frequency and its limits [1/year]; NaN for an infinite limit."""
    with np.errstate(divide="ignore"):
        value, low, high = (float(np.divide(1.0, rate)) for rate in (value, high, low))
    ends = (end if np.isfinite(end) else np.nan for end in (low, high))
    return _estimate([value, *ends])


def _estimate(three: Sequence[float], digits: int = 2) -> Estimate:
    value, low, high = three
    return Estimate(value, low, high, digits)


def _number(hazard: xr.Dataset, place: Place, name: str) -> float:
    return float(hazard[f"{place.kind}_{name}"].values[place.k])


def _level(hazard: xr.Dataset, place: Place, name: str, at: int, factor: float) -> Any:
    """Cell with the level at a place for a return period; "-" if unknown."""
    names = [f"{place.kind}_{name}_by_period{end}" for end in ENDS]
    if names[0] not in hazard:
        return "-"
    levels = [factor * float(hazard[each].values[place.k, at]) for each in names]
    return "-" if np.isnan(levels[0]) else level_cell(*levels)


def _class(hazard: xr.Dataset, place: Place) -> str:
    """Hazard class of a place, with limits; for a line, the highest class of the cells that it
    crosses, or a dash if it lies outside the map."""
    if place.kind == "line":
        cells = _cells_on(hazard, place.name)
        if not cells[0].size:
            return "-"
        numbers = {end: int(hazard[f"hazard_class{end}"].values[cells].max()) for end in CLASS_ENDS}
    else:
        numbers = {end: int(_number(hazard, place, f"hazard_class{end}")) for end in CLASS_ENDS}
    return class_within({f"hazard{end}": CLASSES[number] for end, number in numbers.items()})


def _cells_on(hazard: xr.Dataset, line: str) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of the map cells that a line of the case crosses."""
    group = next(own for own in case_in(hazard.attrs).lines if own["name"] == line)
    grid, _ = grid_of(hazard["hazard_class"])
    vertices = np.array(group["x"]) + 1j * np.array(group["y"])
    steps = int(lengths(vertices)[-1] / grid.cell * STEPS) + 2
    places = spaced(vertices, steps)
    inside = (places.real >= grid.west) & (places.real <= grid.east)
    inside &= (places.imag >= grid.south) & (places.imag <= grid.north)
    return grid.cells(places.real[inside], places.imag[inside])


def variants_table(dossier: Dossier, most: int | None = None) -> Table:
    """Table of boulders per year at each place, with a column for each variant."""
    places = places_of(dossier.first)
    rows = [
        (place.name, *(_frequency(hazard, place) for hazard in dossier.hazards.values()))
        for place in places[:most]
    ]
    heads = say("hazard.place"), *dossier.hazards
    caption = worst_caption(say("dossier.variants_caption"), len(places), len(rows))
    return Table.of(caption, heads, rows)


def _frequency(hazard: xr.Dataset, place: Place) -> Estimate:
    return _estimate([_number(hazard, place, f"frequency{end}") for end in ENDS])


def period_table(dossier: Dossier) -> Table:
    """Table of energies at the return period for each place, with a column for each variant."""
    at = dossier.first["event_period"].values.tolist().index(dossier.period)
    rows = [
        (
            place.name,
            *(_level(hazard, place, "energy", at, 1e-3) for hazard in dossier.hazards.values()),
        )
        for place in places_of(dossier.first)
    ]
    heads = say("hazard.place"), *dossier.hazards
    return Table.of(say("dossier.energy_caption", years=dossier.period), heads, rows)


def remaining_tables(dossier: Dossier) -> Iterator[Table]:
    """Tables of the residual hazard of each variant: highest class of a place, damage, expected
    deaths per year, highest annual individual risk, and cost. No table if none of them is known."""
    costs, risky = dossier.costs, has_risk(dossier.first)
    kinds = [kind for kind in PLACES if f"{kind}_hazard_class" in dossier.first]
    if not (kinds or risky or costs):
        return
    heads: list[str | Column] = [say("dossier.variant")]
    heads += [say("dossier.highest_class")] * bool(kinds)
    heads += [say(f"dossier.{name}") for name in ("damage", "deaths", "individual")] * risky
    heads += [Column(say("variants.cost"), decimals=0)] * bool(costs)
    rows = []
    for name, hazard in dossier.hazards.items():
        worst = [int(hazard[f"{kind}_hazard_class"].max()) for kind in kinds]
        row: list[object] = [name, *([word(CLASSES[max(worst)])] if worst else [])]
        if risky:
            damage, deaths = total(hazard, "damage"), total(hazard, "collective_risk")
            row += [_estimate(damage, 3), _estimate(deaths), _highest(hazard)]
        rows.append([*row, *[costs.get(name, "-")] * bool(costs)])
    yield Table.of(say("dossier.remaining_caption"), heads, rows)
