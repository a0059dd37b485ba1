# SPDX-License-Identifier: BSD-3-Clause
"""Numbers, tables and pictures as HTML. Whatever text comes in is escaped."""

from __future__ import annotations

import base64
import math
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, NamedTuple

from rockfall.plots.style import save

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST_SVG = 400_000  # bytes; a denser picture becomes dots
DOTS_PER_INCH = 200


class Unit(NamedTuple):
    """How a quantity is shown: its name, the unit, and the factor that brings it there."""

    name: str
    unit: str
    scale: float = 1.0


UNITS = {
    "fraction": Unit("share passing", "%", 100.0),
    "speed": Unit("speed", "m/s"),
    "passing_height": Unit("passing height", "m"),
    "jump_height": Unit("jump height", "m"),
    "omega": Unit("angular velocity", "rad/s"),
    "energy_translational": Unit("translational energy", "kJ", 1e-3),
    "energy_rotational": Unit("rotational energy", "kJ", 1e-3),
    "energy_total": Unit("total energy", "kJ", 1e-3),
    "rotational_share": Unit("rotational share", "%", 100.0),
    "position": Unit("place along the line", "m"),
}


def number(value: float, unit: Unit | None = None) -> str:
    """Three digits, thousands set apart; a dash for what is not known."""
    value = float(value) * (unit.scale if unit else 1.0)
    if not math.isfinite(value):
        return "–"
    if not value:
        return "0"
    first = math.floor(math.log10(abs(float(f"{value:.2e}"))))
    return f"{round(value, 2 - first):,.{min(max(0, 2 - first), 6)}f}".replace("-", "−")


def limits(row: Mapping[str, float], name: str, unit: Unit) -> str:
    """The 95 % interval of a number in brackets; empty where it has none."""
    low, high = (row.get(f"{name}_{end}", math.nan) for end in ("low", "high"))
    if math.isnan(low) and math.isnan(high):
        return ""
    if math.isnan(high):
        return f"(from {number(low, unit)}; too few for an upper limit)"
    if math.isnan(low):
        return f"(to {number(high, unit)}; too few for a lower limit)"
    return f"({number(low, unit)} to {number(high, unit)})"


def paragraphs(texts: Iterable[str]) -> str:
    return "\n".join(f"<p>{escape(text)}</p>" for text in texts)


def bullets(texts: Iterable[str]) -> str:
    return "<ul>\n" + "\n".join(f"<li>{escape(text)}</li>" for text in texts) + "\n</ul>"


def warning_box(title: str, texts: Sequence[str]) -> str:
    """What must not be overlooked; nothing without texts."""
    if not texts:
        return ""
    return f'<aside class="warning">\n<h2>{escape(title)}</h2>\n{bullets(texts)}\n</aside>'


def table(
    caption: str, head: Sequence[str], rows: Iterable[Sequence[object]], kind: str = "numbers"
) -> str:
    """A table, of `numbers` or `facts`, which scrolls by itself where the page is narrow; a cell
    may have several lines."""

    def cell(kind: str, content: object) -> str:
        return f"<{kind}>{'<br>'.join(escape(str(content)).splitlines())}</{kind.split()[0]}>"

    lines = ["<tr>" + "".join(cell('th scope="col"', name) for name in head) + "</tr>"]
    for first, *rest in rows:
        cells = cell('th scope="row"', first) + "".join(cell("td", one) for one in rest)
        lines.append(f"<tr>{cells}</tr>")
    about = escape(caption)
    return (
        f'<div class="scroll {kind}" tabindex="0" role="region" aria-label="{about}">\n<table>\n'
        f"<caption>{about}</caption>\n<thead>{lines[0]}</thead>\n<tbody>\n"
        + "\n".join(lines[1:])
        + "\n</tbody>\n</table>\n</div>"
    )


def data_uri(content: bytes, kind: str) -> str:
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"


def picture(figure: Figure, title: str, caption: str) -> str:
    """A figure in the page; a click or Enter opens it large. The same figure gives the same bytes.

    Lines stay lines (SVG) unless there are too many of them.
    """
    content, kind = _saved(figure, ".svg"), "image/svg+xml"
    if len(content) > MOST_SVG:
        content, kind = _saved(figure, ".png"), "image/png"
    wide, high = (round(96 * inch) for inch in figure.get_size_inches())
    about = escape(title)
    return (
        '<figure class="picture">\n<div class="paper">'
        f'<button type="button" aria-label="Enlarge: {about}">'
        f'<img src="{data_uri(content, kind)}" alt="{about}: {escape(caption)}" '
        f'width="{wide}" height="{high}" style="--wide:{wide}px"></button></div>\n'
        f"<figcaption><b>{about}.</b> {escape(caption)}</figcaption>\n</figure>"
    )


def _saved(figure: Figure, ending: str) -> bytes:
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"figure{ending}"
        save(figure, path, DOTS_PER_INCH)
        return path.read_bytes()
