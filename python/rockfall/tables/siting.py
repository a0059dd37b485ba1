# SPDX-License-Identifier: BSD-3-Clause
"""The siting of a barrier as a table, and as text."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from rockfall.quantities import number
from rockfall.studies.siting import BEST, NOT_TOLD_APART, YES
from rockfall.table import Column, Table, as_text, in_line
from rockfall.tables.design import class_name, factor_lines, needed, shown

if TYPE_CHECKING:
    from rockfall.studies.siting import Siting

ABOUT = """\
Of the boulders that cross each alignment, in brackets 95 % confidence intervals of the Monte Carlo
error. Heights are above the ground, vertical. `round` are those that come to the line without
crossing the alignment, `left` those that still come with the barrier that is needed there."""


def siting_text(siting: Siting) -> str:
    """Table of alignments, the choice, and what the numbers rest on."""
    first = (
        f"{siting.line}: {siting.come:,} of {siting.boulders:,} boulders come; {_limits(siting)}"
    )
    parts = [ABOUT, *(f"Warning: {note}" for note in siting.notes), "", first]
    parts += [
        as_text(siting_table(siting)),
        "",
        *_choice(siting),
        "",
        *factor_lines(siting.factors),
    ]
    return "\n".join(parts)


def _limits(siting: Siting) -> str:
    limits = siting.limits
    given = [f"height at most {limits.height:g} m"] if limits.height is not None else []
    given += [f"class at most {limits.ead_class}"] if limits.ead_class is not None else []
    return ", ".join([*given, f"at most {100 * limits.bypass:g} % around it"])


def siting_table(siting: Siting) -> Table:
    """Alignments: what they need, and what it costs."""
    rows = []
    for row in siting.table.to_dict("records"):
        verdict = ": ".join(filter(None, [row["fits"], row["fails"]]))
        rows.append((
            row["alignment"], row["distance"], number(row["elevation"], 4), int(row["n"]),
            shown(row, "energy_q95", 1e-3), shown(row, "height_q95"), needed(row, "E_d", 1e-3),
            needed(row, "height_needed"), class_name(row) if row["n"] else "-",
            shown(row, "bypass", 100.0), shown(row, "remaining", 100.0), shown(row, "cost"),
            verdict, row["choice"],
        ))  # fmt: skip
    heads = (
        "alignment", Column("up", "m"), Column("elevation", "m"), "boulders", Column("E95", "kJ"),
        Column("h95", "m"), Column("E_d", "kJ"), Column("height needed", "m"), "class",
        Column("round", "%"), Column("left", "%"),
        Column("cost", "" if siting.priced else "kJ m2"), "fits", "",
    )  # fmt: skip
    return Table.of("", heads, rows)


def _choice(siting: Siting) -> Iterator[str]:
    """The best alignment in a sentence, and those that may be as good."""
    chosen = {name: rows for name, rows in siting.table.groupby("choice")}
    if BEST not in chosen:
        yield "Best: none"
        return
    best = chosen[BEST].iloc[0].to_dict()
    state = (
        "" if best["fits"] == YES else f", not certain to be within the limits ({best['fails']})"
    )
    yield (
        f"Best: {best['alignment']}, of the lowest cost{state}: class {class_name(best)}, "
        f"{in_line(needed(best, 'height_needed'))} m"
    )
    if NOT_TOLD_APART in chosen:
        names = ", ".join(chosen[NOT_TOLD_APART]["alignment"])
        yield f"Not told apart from it by so few boulders: {names}"
