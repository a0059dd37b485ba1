# SPDX-License-Identifier: BSD-3-Clause
"""Siting of a barrier as a table and text."""

from collections.abc import Iterator

from rockfall.kernel_rules import EAD_ENERGY
from rockfall.quantities import number
from rockfall.studies.barrier_advice import ROUND, Advice
from rockfall.studies.siting import BEST, NOT_DISTINGUISHED, YES, Siting
from rockfall.table import Column, Estimate, Table, as_text, in_line
from rockfall.tables.design import class_name, factor_lines, needed, shown

ABOUT = """\
Boulders that cross each alignment; brackets: 95 % confidence intervals of the Monte Carlo error.
Heights are vertical, above the ground. `round`: boulders that reach the line without crossing the
alignment. `left`: boulders that still reach it with the required barrier there."""
WAYS = {
    "passed_over": "pass over it", "broken_through": "break through it", ROUND: "bypass its ends",
}  # fmt: skip


def siting_text(siting: Siting) -> str:
    """Text with the table of alignments, the choice, and the basis of the numbers."""
    first = (
        f"{siting.line}: {siting.come:,} of {siting.boulders:,} boulders arrive; {_limits(siting)}"
    )
    parts = [ABOUT, *(f"Warning: {note}" for note in siting.notes), "", first]
    if siting.scenarios:
        names = ", ".join(siting.scenarios)
        parts.append(
            f"All values are for the boulders of the scenarios, weighted by frequency: {names}"
        )
    parts += [
        as_text(siting_table(siting)),
        "",
        *_choice(siting),
        *(advice_lines(siting) if siting.advice else ()),
        "",
        *factor_lines(siting.factors),
    ]
    return "\n".join(parts)


def _limits(siting: Siting) -> str:
    limits = siting.limits
    given = [f"height at most {limits.height:g} m"] if limits.height is not None else []
    given += [f"class at most {limits.ead_class}"] if limits.ead_class is not None else []
    given += [f"{limits.space:g} m of space"] if limits.space is not None else []
    return ", ".join([*given, f"at most {100 * limits.bypass:g} % around it"])


def siting_table(siting: Siting) -> Table:
    """Table of alignments with requirements and costs."""
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
    """Sentences on the best alignment, and on alignments that may be equally good."""
    chosen = {name: rows for name, rows in siting.table.groupby("choice")}
    if BEST not in chosen:
        yield "Best: none"
        return
    best = chosen[BEST].iloc[0].to_dict()
    state = (
        "" if best["fits"] == YES else f", not certain to be within the limits ({best['fails']})"
    )
    yield (
        f"Best: {best['alignment']}, with the lowest cost{state}: class {class_name(best)}, "
        f"{in_line(needed(best, 'height_needed'))} m"
    )
    if NOT_DISTINGUISHED in chosen:
        names = ", ".join(chosen[NOT_DISTINGUISHED]["alignment"])
        yield f"Not significantly different with these boulders: {names}"


def advice_lines(siting: Siting) -> Iterator[str]:
    """Lines on the advised barrier, the result of a run with it, and possible improvements."""
    advice, line = siting.advice, siting.line
    assert advice is not None
    alignment, height, ead_class = advice.barrier
    energy = EAD_ENERGY[ead_class] / 1000
    yield (
        f"Advised: {alignment.name}, class {ead_class} ({energy:g} kJ), {height:g} m high, "
        f"{alignment.length:.0f} m long, {alignment.space:.0f} m from {line}"
    )
    if siting.limits.space is None:
        yield "Its braking distance is not checked: give --space"
    factor, unit = (1.0, "per year") if advice.yearly else (100.0, "% of the boulders")
    today, left = (
        in_line(Estimate(factor * value, factor * low, factor * high, digits=2))
        for value, low, high in (advice.today, advice.left)
    )
    yield (
        f"Runs with the same boulders: {today} {unit} reach {line} without the barrier, "
        f"{left} with it"
    )
    if not advice.has_effect:
        yield "No significant effect: the difference is within the error of the simulation"
    if advice.ways:
        shares = (f"{100 * part:.0f} % {WAYS[way]}" for way, part in advice.ways.items())
        yield f"Remaining boulders: {', '.join(shares)}"
    if advice.is_enough is not None:
        yield f"At most {advice.acceptable:g} per year are acceptable: {_acceptance(advice)}"


def _acceptance(advice: Advice) -> str:
    if advice.is_enough:
        return "met, by the upper limit"
    told = advice.left[0] > (advice.acceptable or 0)
    more = "" if told else ", but more boulders may show that it is met"
    return f"not met by any of {advice.tried} alignments within the limits{more}"
