# SPDX-License-Identifier: BSD-3-Clause
"""A run as tables: outcomes, rebounds by ground, effects of obstacles, and run details."""

from __future__ import annotations

import json
import shlex
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from rockfall.analysis.validity.rebounds import followed_text
from rockfall.case import FROM_ARRAY, case_of, given_text
from rockfall.io.vectors.layers import REPROJECTED
from rockfall.language import Number, Text, say, word
from rockfall.protection.barriers import barrier_rows
from rockfall.quantities import percent
from rockfall.result.grounds import program_text, rebounds_by_ground, sets_followed
from rockfall.result.samples import is_ensemble, kept_note, simulated
from rockfall.result.trajectories import ended
from rockfall.table import Column, Table, stacked
from rockfall.tables.lines import estimate

if TYPE_CHECKING:
    import xarray as xr

    from rockfall.result.contents import Held
    from rockfall.scene.forest.trees import Stand
    from rockfall.terrain.dams import DamShape

ENDED = {  # message id of each status
    "stopped": "summary.came_to_rest_on_the_slope",
    "absorbed": "summary.ended_where_the_ground_absorbs_boulders",
    "left_domain": "summary.left_the_terrain_model",
    "hit_nodata": "summary.met_terrain_without_elevation",
    "impact_limit": "summary.reached_the_limit_of_contacts_and",
    "stopped_by_tree": "summary.were_stopped_by_trees",
    "stopped_by_barrier": "summary.were_stopped_by_barriers",
}


def ends_table(result: Held) -> Table:
    """Table of boulder outcomes."""
    boulders = simulated(result)
    rows = [
        (say(ENDED[name]), int(n), percent(n / boulders)) for name, n in ended(result).items() if n
    ]
    heads = "", say("label.boulders"), say("label.fraction")
    return Table.of(say("summary.how_boulders_ended"), heads, rows)


def ground_table(result: Held) -> Table:
    """Table of rebounds by ground."""
    rows = [
        (name, word(model), rebounds, percent(fraction))
        for name, model, rebounds, fraction, _ in rebounds_by_ground(result)
    ]
    heads = "tables.ground", "tables.model", "label.rebounds", "label.fraction"
    return Table.of(say("tables.rebounds_by_ground"), map(say, heads), rows)


def barrier_table(result: Held) -> Table:
    """Table of the boulders with each outcome, for each barrier."""
    rows = [
        (row["barrier"], word(row["outcome"]), row["n"], estimate(row, "fraction", "fraction"))
        for row in barrier_rows(result)
    ]
    heads = "tables.barrier", "tables.outcome", "label.boulders", "tables.fraction"
    note = kept_note(result)
    caption = f"{say('tables.barrier_caption')}. {note}" if note else say("tables.barrier_caption")
    return Table.of(caption, map(say, heads), rows)


def dam_tables(dams: Iterable[DamShape]) -> Iterator[Table]:
    """Table of dams as rasterised; none without dams."""
    rows = [
        (f"{number}", dam.length,
         stacked(Number(f"{dam.height:.1f} ({dam.height_min:.1f})"), _requested(dam, 0)),
         stacked(Number(f"{dam.slope:.0f}"), _requested(dam, 2)), dam.face_cells,
         say("interval.range", low=Number(f"{dam.crest_min:,.1f}"),
             high=Number(f"{dam.crest_max:,.1f}")),
         stacked(Number(f"{dam.crest_width:.1f}"), _requested(dam, 1)))
        for number, dam in enumerate(dams, start=1)
    ]  # fmt: skip
    if rows:
        heads = (
            say("tables.dam"), Column(say("tables.length_m"), decimals=0),
            say("tables.height_at_its_lowest_m"), say("tables.slope_of_the_face_degrees"),
            Column(say("tables.width_of_the_face_cells"), decimals=1),
            say("tables.elevation_of_the_crest_m"), say("tables.width_of_the_crest_m"),
        )  # fmt: skip
        yield Table.of(say("tables.dam_caption"), heads, rows)


def _requested(dam: DamShape, k: int) -> Text:
    return say("tables.requested", value=dam.requested[k])


def stand_tables(stands: Sequence[Stand], most: int | None = None) -> Iterator[Table]:
    """Table of forest stands with their stems. Stands beyond the first `most` are summed. No table
    without stands."""
    rows: list[tuple[object, ...]] = [
        (stand.name, Number(f"{stand.area:.3g}"), stand.stems, stand.density, stand.stated)
        for stand in stands[:most]
    ]
    if rest := stands[len(rows) :]:
        rows.append((f"{len(rest):,} more", "", sum(stand.stems for stand in rest), "", ""))
    if rows:
        heads = (
            say("tables.stand"), say("tables.area_ha"), say("tables.stems"),
            Column(say("tables.stems_a_hectare"), decimals=0),
            Column(say("tables.stems_a_hectare_in_the_layer"), decimals=0),
        )  # fmt: skip
        yield Table.of(say("tables.stand_caption"), heads, rows)


def provenance(result: xr.Dataset) -> dict[str, Any]:
    """Provenance of a result, with the command that reproduces it, if known."""
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
        *_checksums(attrs),
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
        "table": Table.of(say("tables.what_was_run"), ("", say("label.value")), rows, "facts"),
        "command": "" if FROM_ARRAY in attrs["case"] else command,
        "is_complete": is_complete,
        "case": given_text(case),
    }


def hazard_inputs(hazard: xr.Dataset) -> Table:
    """Table with program, case, seed, rebounds and files of a hazard."""
    attrs = {key: str(value) for key, value in hazard.attrs.items()}
    rows = [
        (say("label.program"), program_text(hazard)),
        (say("tables.case_file"), attrs["case_file"]),
        (say("tables.seed"), attrs["seed"]),
        (say("label.rebounds"), followed_text(hazard, attrs["impact_set"])),
        *_checksums(attrs),
    ]
    return Table.of(say("tables.what_was_run"), ("", say("label.value")), rows, "facts")


def _checksums(attrs: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    for key, noted in json.loads(attrs["input_checksums"]).items():
        yield say("tables.checksum_sha"), f"{key}: {_noted(noted)}"


def _impact_set(result: xr.Dataset) -> Iterator[tuple[str, str]]:
    """File of the case's impact sets, with a note if no rebound used them."""
    name = str(result.attrs["impact_set"])
    text = f"{name}, SHA-256 {result.attrs['impact_set_checksum']}"
    is_used = name in sets_followed(result, name)
    unused = "" if is_used else say("tables.no_rebound_followed_it")
    yield say("tables.impact_set"), text + unused


def _noted(noted: str) -> str:
    """Checksum of a file, with a note on its reprojection, if any."""
    checksum, _, remark = noted.partition(f", {REPROJECTED} ")
    if not remark:
        return checksum
    crs, _, rough = remark.partition(", but ")
    parts = [checksum, say("tables.reprojected", join=" → ".join(crs.split(" to ")))]
    return "; ".join([*parts, say("input.no_grid_of_proj")] if rough else parts)
