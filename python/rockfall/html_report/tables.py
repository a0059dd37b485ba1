# SPDX-License-Identifier: BSD-3-Clause
"""The tables of a page: numbers at the lines, return levels, precision, provenance."""

from __future__ import annotations

import json
import shlex
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rockfall.analysis.precision.history import NUMBERS
from rockfall.analysis.precision.intervals import (
    TARGETS,
    boulders_needed,
    half_width,
    rounded_up,
)
from rockfall.case import FROM_ARRAY, case_of, given_text
from rockfall.html_report.intervals import (
    STATISTICS,
    TOO_FEW,
    estimate,
    in_lines,
    in_unit,
    rising_estimates,
)
from rockfall.io.vectors.layers import REPROJECTED
from rockfall.language import Number, say, translated, word
from rockfall.protection.barriers import barrier_rows
from rockfall.protection.dams import dams_of
from rockfall.protection.stands import stands_of
from rockfall.quantities import QUANTITIES, number, percent, statistic
from rockfall.result.grounds import program_text, rebounds_by_ground, sets_followed
from rockfall.result.samples import kept_note
from rockfall.studies.ensemble.study import is_ensemble
from rockfall.text.comparison import notes
from rockfall.text.comparison import tables as comparison_tables
from rockfall.text.design import check_head, check_row, demand_rows, load_rows
from rockfall.text.hazard import class_rows, object_rows, scenario_rows
from rockfall.text.segments import segment_rows

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from rockfall.analysis.observed.compare import Comparison
    from rockfall.html_report.intervals import Numbers, Row, Rows
    from rockfall.language import Text
    from rockfall.protection.design import Design
    from rockfall.terrain.dams import DamShape


LETTERS = 108  # of the numbers of a row that fit on A4, upright, next to a label


class Table(NamedTuple):
    """A table; `kind` is its class in the style sheet. Cells may have several lines."""

    caption: str
    head: Sequence[str]
    rows: Sequence[Sequence[object]]
    kind: str = "numbers"

    @property
    def is_crowded(self) -> bool:
        """Return True if its numbers are too wide for one line each on A4: cells may then wrap."""
        columns = zip(*(row[1:] for row in self.rows), strict=True)
        longest = (max(map(len, "\n".join(map(str, column)).split("\n"))) for column in columns)
        return sum(1 + letters for letters in longest) > LETTERS


def line_tables(rows: Rows) -> Iterator[Table]:
    """Each line's mean, deviation, quantiles and maximum."""
    for line, numbers in rows.items():
        if n := numbers["speed"]["n"]:
            head = ("", *map(statistic, STATISTICS), say("tables.max_of", n=n))
            shown = [_statistics(name, row) for name, row in numbers.items()]
            if any(TOO_FEW in cell for row in shown for cell in row):
                caption = say("tables.line_caption_with_dashes", line=line, n=n)
            else:
                caption = say("tables.line_caption", line=line, n=n)
            yield Table(caption, head, shown)


def _statistics(quantity: str, row: Row) -> tuple[str, ...]:
    cells = (in_lines(*estimate(row, n, quantity)) for n in STATISTICS)
    return QUANTITIES[quantity].title, *cells, in_unit(row["max"], quantity)


def barrier_table(result: xr.Dataset) -> Table:
    """Performance of each barrier on the boulders that reached it."""
    rows = [
        (row["barrier"], word(row["outcome"]), Number(f"{row['n']:,}"),
         " ".join(map(translated, estimate(row, "fraction", "fraction"))))
        for row in barrier_rows(result)
    ]  # fmt: skip
    heads = "tables.barrier", "tables.outcome", "label.boulders", "tables.fraction"
    note = kept_note(result)
    caption = f"{say('tables.barrier_caption')}. {note}" if note else say("tables.barrier_caption")
    return Table(caption, [*map(say, heads)], rows)


def dam_tables(result: xr.Dataset) -> Iterator[Table]:
    """Dams as rasterised; no table without dams."""
    rows = [
        (f"{number}", Number(f"{dam.length:,.0f}"),
         in_lines(Number(f"{dam.height:.1f} ({dam.height_min:.1f})"), _requested(dam, 0)),
         in_lines(Number(f"{dam.slope:.0f}"), _requested(dam, 2)), Number(f"{dam.face_cells:.1f}"),
         say("interval.range", low=Number(f"{dam.crest_min:,.1f}"),
             high=Number(f"{dam.crest_max:,.1f}")),
         in_lines(Number(f"{dam.crest_width:.1f}"), _requested(dam, 1)))
        for number, dam in enumerate(dams_of(result), start=1)
    ]  # fmt: skip
    if rows:
        head = (
            say("tables.dam"), say("tables.length_m"), say("tables.height_at_its_lowest_m"),
            say("tables.slope_of_the_face_degrees"), say("tables.width_of_the_face_cells"),
            say("tables.elevation_of_the_crest_m"), say("tables.width_of_the_crest_m"),
        )  # fmt: skip
        yield Table(say("tables.dam_caption"), head, rows)


def _requested(dam: DamShape, k: int) -> Text:
    return say("tables.requested", value=dam.requested[k])


def stand_tables(result: xr.Dataset) -> Iterator[Table]:
    """Stands of trees with their stems; no table without stands."""
    rows = [
        (
            stand.name,
            *map(
                Number,
                (
                    f"{stand.area:.3g}",
                    f"{stand.stems:,}",
                    f"{stand.density:,.0f}",
                    f"{stand.stated:,.0f}",
                ),
            ),
        )
        for stand in stands_of(result)
    ]
    if rows:
        heads = (
            "tables.stand", "tables.area_ha", "tables.stems", "tables.stems_a_hectare",
            "tables.stems_a_hectare_in_the_layer",
        )  # fmt: skip
        yield Table(say("tables.stand_caption"), [*map(say, heads)], rows)


def ground_table(result: xr.Dataset) -> Table:
    """Rebounds by ground."""
    grounds = rebounds_by_ground(result)
    rows = [
        (name, word(model), Number(f"{rebounds:,}"), percent(fraction))
        for name, model, rebounds, fraction, _ in grounds
    ]
    heads = "tables.ground", "tables.model", "label.rebounds", "label.fraction"
    return Table(say("tables.rebounds_by_ground"), [*map(say, heads)], rows)


def level_table(levels: pd.DataFrame) -> Table:
    """Return levels of passing boulders, with the maximum of the run."""
    names = [n for n in levels.columns if n.startswith("level_") and n.count("_") == 1]
    shown = []
    for _, row in levels[levels["n"] > 0].iterrows():
        quantity = row["quantity"]
        cells = (in_lines(*cell) for cell in rising_estimates(row, names, quantity))
        above = say("tables.exceedances", n=row["exceedances"])
        over = in_lines(in_unit(row["threshold"], quantity), above)
        tail = (over, number(row["shape"])) if np.isfinite(row["shape"]) else ("-", "-")
        name = say("join.colon", before=row["line"], after=QUANTITIES[quantity].title)
        shown.append(
            (name, in_unit(row["max"], quantity), *cells, *tail, row["refused"].replace("; ", "\n"))
        )  # fmt: skip
    head = ["", say("tables.max"), *(say("tables.one_in_n", n=int(n[6:])) for n in names)]
    head += map(say, ("tables.threshold", "tables.shape", "tables.refused"))
    return Table(say("tables.level_caption"), head, shown, "numbers noted")


def precision_table(line: str, numbers: Numbers, boulders: int) -> Table:
    """Precision of the numbers at a line, and the number of boulders for higher precision."""
    shown = []
    for quantity, name in NUMBERS:
        row = numbers["speed" if quantity == "fraction" else quantity]
        display, half = QUANTITIES[quantity], half_width(row, name)
        label = f"{display.label}, {statistic(name)}" if name in STATISTICS else display.label
        cells = ["-"] * (1 + len(TARGETS))
        crossed = np.inf if name == "fraction" else row["n"]
        if np.isfinite(half):
            more = (boulders_needed(boulders, half, target, crossed) for target in TARGETS)
            needed = (Number(f"{rounded_up(n_needed):,}") for n_needed in more)
            cells = [Number(f"± {percent(half)}"), *needed]
        value = in_unit(row.get(name, np.nan), quantity)
        shown.append((label, Number(f"{value} {display.unit}"), *cells))
    targets = (say("tables.boulders_for_precision", target=100 * target) for target in TARGETS)
    caption = say("tables.precision_caption", line=line)
    return Table(caption, ("", say("tables.now"), say("tables.half_width"), *targets), shown)


def design_tables(sheet: Design) -> Iterator[Table]:
    """Requirements of a standard for a barrier at each line, and checks of the barriers."""
    standard = sheet.factors.conditions.standard
    for asked in sheet.demand.to_dict("records"):
        if asked["n"]:
            loads = sheet.loads[sheet.loads["line"] == asked["line"]].to_dict("records")
            head, *rows = load_rows(loads)
            caption = say("tables.loads_alone", line=asked["line"])
            if not sheet.factors.open:
                _, *design = demand_rows(asked, standard)
                rows += [[name, value, "", ""] for name, value in design]
                caption = say("tables.loads_caption", line=asked["line"], standard=standard)
            yield Table(caption, head, rows)
    if len(sheet.checks):
        rows = [check_row(row) for row in sheet.checks.to_dict("records")]
        yield Table(say("tables.checks_caption", standard=standard), check_head(), rows)


def hazard_tables(data: xr.Dataset) -> Iterator[Table]:
    """Areas of the classes, objects at risk, segments of roads, scenarios."""
    parts: list[tuple[str, Any]] = [(say("tables.classes_of_hazard"), class_rows)]
    if "object" in data.dims:
        parts.append((say("tables.objects"), object_rows))
    if "segment" in data.dims:
        parts.append((say("tables.segments"), segment_rows))
    for caption, rows_of_part in (*parts, (say("sheet.scenarios"), scenario_rows)):
        head, *rows = rows_of_part(data)
        cells = ((translated(cell).replace(" (", "\n(") for cell in row) for row in rows)
        yield Table(caption, head, [[*row] for row in cells])


class Compared(NamedTuple):
    """Comparison with observations: tables and notes."""

    tables: list[Table]
    notes: list[str]


def compared(comparison: Comparison) -> Compared:
    """Tables of a comparison, with notes for the reader."""
    shown = [Table(caption, head, rows) for caption, (head, *rows) in comparison_tables(comparison)]
    return Compared(shown, notes(comparison))


def provenance(result: xr.Dataset) -> dict[str, Any]:
    """Provenance of a result, and the command that reproduces it, if one can."""
    attrs = {key: str(value) for key, value in result.attrs.items()}
    case, is_complete = case_of(result), bool(result.attrs["complete"])
    clocks = {clock: result.attrs[f"{clock}_seconds"] for clock in ("wall", "cpu")}
    first, last, requested = (
        f"{int(attrs[f'boulder{end}']):,}" for end in ("_first", "_last", "s_requested")
    )
    total = "boulders_total" in case.case
    number = case.case["boulders_total" if total else "boulders"]
    if total:
        released = say("tables.boulders_of_all_sources_together")
    elif case.release["by_area"]:
        released = say("tables.boulders_by_area")
    else:
        released = say("tables.boulders_of_each_source")
    rows = [
        (say("label.program"), program_text(result)),
        (say("tables.case_file"), attrs["case_file"]),
        (say("tables.seed"), attrs["seed"]),
        (say("label.boulders"), Number(f"{first} – {last} / {requested}")),
        (released, Number(f"{number:,}")),
        *_impact_set(result),
        *(
            (say("tables.checksum_sha"), f"{key}: {_noted(noted)}")
            for key, noted in json.loads(attrs["input_checksums"]).items()
        ),
        (say("tables.threads"), attrs["threads"]),
        (say("tables.time"), say("tables.seconds", **clocks)),
    ]
    option = "--boulders-total" if total else "--boulders"
    verb = "ensemble" if is_ensemble(result) else "run"
    command = (
        f"rockfall {verb} {shlex.quote(attrs['case_file'])} {option} {number} "
        f"--seed {attrs['seed']} -o again.nc"
    )
    return {
        "table": Table(say("tables.what_was_run"), ("", say("label.value")), rows, "facts"),
        "command": "" if FROM_ARRAY in attrs["case"] else command,
        "is_complete": is_complete,
        "case": given_text(case),
    }


def _impact_set(result: xr.Dataset) -> Iterator[tuple[str, str]]:
    """File of the case's impact sets, with a note if no rebound followed any."""
    name = str(result.attrs["impact_set"])
    text = f"{name}, SHA-256 {result.attrs['impact_set_checksum']}"
    is_used = name in sets_followed(result, name)
    unused = "" if is_used else say("tables.no_rebound_followed_it")
    yield say("tables.impact_set"), text + unused


def _noted(noted: str) -> str:
    """Checksum of a file, and a note on its CRS."""
    checksum, _, remark = noted.partition(f", {REPROJECTED} ")
    if not remark:
        return checksum
    crs, _, rough = remark.partition("; ")
    parts = [checksum, say("tables.reprojected", join=" → ".join(crs.split(" to ")))]
    return "; ".join([*parts, say("input.no_grid_of_proj")] if rough else parts)
